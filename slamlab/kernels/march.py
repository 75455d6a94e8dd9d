"""Compiled loop under the stereo rig: rays that march over the ground until they meet it."""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit

# Cells on each side of a block of `tops_of`.
BLOCK = 8


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
def tops_of(heights):  # type: ignore[no-untyped-def]
    """Greatest height in and around each block of cells: what is above meets no ground there."""
    rows, columns = heights.shape
    tops = np.empty((rows // BLOCK + 1, columns // BLOCK + 1))
    for r in range(tops.shape[0]):
        for c in range(tops.shape[1]):
            top, left = max(r * BLOCK - 2, 0), max(c * BLOCK - 2, 0)
            around = heights[top : (r + 1) * BLOCK + 2, left : (c + 1) * BLOCK + 2]
            tops[r, c] = around.max() + 1e-9
    return tops


@njit(cache=True)
def march(heights, frame, origin, rays, reach):  # type: ignore[no-untyped-def]
    """Do what `slamlab.sensors.stereo.march` does; high above a block the ground is not asked."""
    tops, out = tops_of(heights), np.empty(len(rays))
    step, scale = 0.5 * frame[0], 1.0 / (frame[0] * BLOCK)
    last_row, last_column = tops.shape[0] - 1, tops.shape[1] - 1
    for k in range(len(rays)):
        dx, dy, dz = rays[k]
        out[k], t = np.inf, 0.0
        while t < reach:
            before = t
            t += step
            x, y, z = origin[0] + t * dx, origin[1] + t * dy, origin[2] + t * dz
            column = min(max(int((x - frame[1]) * scale), 0), last_column)
            row = min(max(int((y - frame[2]) * scale), 0), last_row)
            if z > tops[row, column]:
                continue
            gap = z - height_at(heights, frame, x, y)
            if gap <= 0.0:
                x, y = origin[0] + before * dx, origin[1] + before * dy
                above = origin[2] + before * dz - height_at(heights, frame, x, y)
                out[k] = t - step * gap / (gap - above)
                break
    return out
