"""Distances to the nearest cell or segment: compiled loops under `clearance`."""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit


@njit(cache=True)
def grid_clearance(before, after, points, out):  # type: ignore[no-untyped-def]
    """Distance (cells) of points (n, 2: x, y in cells) to the nearest occupied square.

    In each row only the nearest occupied column on either side can matter; rows farther away than
    the best distance so far need no look.
    """
    rows, columns = before.shape
    for i in range(len(points)):
        x, y = points[i]
        if not (0 <= x < columns and 0 <= y < rows):
            out[i] = 0.0
            continue
        c, r = int(x), int(y)
        best = np.inf
        for k in range(rows):
            down, up = y - (r - k + 1), (r + k) - y
            if max(min(down, up), 0.0) ** 2 >= best:
                break
            for row, dy in ((r - k, max(down, 0.0)), (r + k, max(up, 0.0))):
                if 0 <= row < rows:
                    left = max(x - (before[row, c] + 1), 0.0)
                    right = max(after[row, c] - x, 0.0)
                    dx = min(left, right)
                    if dx < 1e8:
                        best = min(best, dx * dx + dy * dy)
        out[i] = np.sqrt(best)


@njit(cache=True)
def segment_clearance(segments, points, out):  # type: ignore[no-untyped-def]
    """Distance of points (n, 2) to the nearest of segments (k, 2, 2)."""
    for i in range(len(points)):
        x, y = points[i]
        best = np.inf
        for segment in segments:
            px, py = segment[0]
            ex, ey = segment[1, 0] - px, segment[1, 1] - py
            u = ((x - px) * ex + (y - py) * ey) / (ex * ex + ey * ey)
            u = min(max(u, 0.0), 1.0)
            dx, dy = px + u * ex - x, py + u * ey - y
            best = min(best, dx * dx + dy * dy)
        out[i] = np.sqrt(best)
