"""Sort a picture of heights into the cells of many particles, for Gamma-SLAM."""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit

__all__ = ["gather"]


@njit(cache=True)
def gather(points, heights, poses, frame):  # type: ignore[no-untyped-def]
    """Do what `slamlab.slam.gamma.gather` does, one particle after the other."""
    M, k = len(poses), len(points)
    most = M * (k // 2)
    particle, cells = np.empty(most, np.int64), np.empty((most, 2), np.int64)
    nu, squares = np.empty(most), np.empty(most, np.float32)
    column, row, found = np.empty(k, np.int64), np.empty(k, np.int64), 0
    for i in range(M):
        c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        for j in range(k):
            x = poses[i, 0] + c * points[j, 0] - s * points[j, 1]
            y = poses[i, 1] + s * points[j, 0] + c * points[j, 1]
            column[j] = int(np.floor((x - frame[1]) / frame[0]))
            row[j] = int(np.floor((y - frame[2]) / frame[0]))
        left, bottom = column.min(), row.min()
        sums = np.zeros((row.max() - bottom + 1, column.max() - left + 1, 3))
        for j in range(k):
            cell, h = sums[row[j] - bottom, column[j] - left], heights[j]
            cell[0] += 1.0
            cell[1] += h
            cell[2] += h * h
        for r in range(sums.shape[0]):
            for q in range(sums.shape[1]):
                n, total, square = sums[r, q]
                if n >= 2.0:
                    particle[found], nu[found] = i, n - 1.0
                    cells[found, 0], cells[found, 1] = left + q, bottom + r
                    squares[found] = max(square - total * total / n, 0.0)
                    found += 1
    return particle[:found], cells[:found], nu[:found], squares[:found]
