"""Compiled loop under the stereo rig: rays that march over the ground until they meet it."""

from __future__ import annotations

import numpy as np

from slamlab._compiling import njit


@njit(cache=True)
def height_at(heights, frame, x, y):  # type: ignore[no-untyped-def]
    """Height at (x, y), between the centres of four cells; `frame` is (resolution, x0, y0)."""
    rows, columns = heights.shape
    u = min(max((x - frame[1]) / frame[0] - 0.5, 0.0), columns - 1.0)
    v = min(max((y - frame[2]) / frame[0] - 0.5, 0.0), rows - 1.0)
    c, r = min(int(u), columns - 2), min(int(v), rows - 2)
    u, v = u - c, v - r
    low = (1 - u) * heights[r, c] + u * heights[r, c + 1]
    return (1 - v) * low + v * ((1 - u) * heights[r + 1, c] + u * heights[r + 1, c + 1])


@njit(cache=True)
def march(heights, frame, origin, rays, reach, out):  # type: ignore[no-untyped-def]
    """Distance along each ray (n, 3, unit) from `origin` (3,) to the ground, inf beyond `reach`.

    Steps of half a cell; the last one is cut where a straight line between its ends meets it.
    """
    step = 0.5 * frame[0]
    for k in range(len(rays)):
        dx, dy, dz = rays[k]
        out[k] = np.inf
        t, above = 0.0, origin[2] - height_at(heights, frame, origin[0], origin[1])
        while t < reach:
            t += step
            z = origin[2] + t * dz
            gap = z - height_at(heights, frame, origin[0] + t * dx, origin[1] + t * dy)
            if gap <= 0.0:
                out[k] = t - step * gap / (gap - above)
                break
            above = gap
