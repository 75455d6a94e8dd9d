"""Distances to the nearest cell: the compiled loop under `BitmapWorld.clearance`."""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit


@njit(cache=True)
def grid_clearance(before, after, points):  # type: ignore[no-untyped-def]
    """Distance (cells) of points (n, 2: x, y in cells) to the nearest occupied square.

    In each row only the nearest occupied column on either side can matter; rows farther away than
    the best distance so far need no look.
    """
    rows, columns = before.shape
    out = np.empty(len(points))
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
    return out
