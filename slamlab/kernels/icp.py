"""ICP for `slamlab.matching.icp`: neighbours in a hash of cells, and the Gauss-Newton loop."""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit
from slamlab.kernels.linear import solve3


@njit(cache=True)
def hashed(points, side):  # type: ignore[no-untyped-def]
    """Sort points into squares: frame (x, y, side, columns, rows), starts, order, points in it."""
    x0, y0 = points[:, 0].min(), points[:, 1].min()
    wide, high = points[:, 0].max() - x0, points[:, 1].max() - y0
    columns, rows = int(wide / side) + 1, int(high / side) + 1
    while columns * rows > 16 * len(points) + 65536:
        side *= 2.0
        columns, rows = int(wide / side) + 1, int(high / side) + 1
    start = np.zeros(columns * rows + 1, np.int64)
    cell = np.empty(len(points), np.int64)
    for k in range(len(points)):
        cell[k] = int((points[k, 1] - y0) / side) * columns + int((points[k, 0] - x0) / side)
        start[cell[k] + 1] += 1
    start = np.cumsum(start)
    fill = start.copy()
    order, laid = np.empty(len(points), np.int64), np.empty_like(points)
    for k in range(len(points)):
        at = fill[cell[k]]
        order[at], laid[at, 0], laid[at, 1] = k, points[k, 0], points[k, 1]
        fill[cell[k]] += 1
    return (x0, y0, side, columns, rows), start, order, laid


@njit(cache=True)
def nearest(hashes, x, y, limit):  # type: ignore[no-untyped-def]
    """Row and distance of the nearest point within `limit`, else -1; and how near no other is."""
    (x0, y0, side, columns, rows), start, order, laid = hashes
    # Most points have a partner near by: a look at few squares finds it.
    for reach in (min(0.25 * side, limit), limit):
        best, least, second = -1, limit * limit, limit * limit
        left, low = max(0, int(np.floor((x - reach - x0) / side))), y - reach - y0
        right, high = min(int((x + reach - x0) / side), columns - 1), y + reach - y0
        for r in range(max(0, int(np.floor(low / side))), min(int(high / side), rows - 1) + 1):
            if left > right:
                break
            # The squares of a row follow one another.
            for n in range(start[r * columns + left], start[r * columns + right + 1]):
                d = (laid[n, 0] - x) ** 2 + (laid[n, 1] - y) ** 2
                if d < least:
                    best, least, second = n, d, least
                elif d < second:
                    second = d
        if least <= reach * reach:
            break
    return order[best] if best >= 0 else -1, np.sqrt(least), min(np.sqrt(second), reach)


@njit(cache=True)
def _pairs(reference, hashes, points, pose, gate, pair, places):  # type: ignore[no-untyped-def]
    """Nearest reference point of each moved point, -1 beyond the gate; returns how many.

    `places` (k, 3) says where each point was when its partner was looked for, and how near no
    other was. While others cannot have come nearer than the partner, nobody looks again.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    count = 0
    for k in range(len(points)):
        x = c * points[k, 0] - s * points[k, 1] + pose[0]
        y = s * points[k, 0] + c * points[k, 1] + pose[1]
        others = places[k, 2] - np.sqrt((x - places[k, 0]) ** 2 + (y - places[k, 1]) ** 2)
        j, d = pair[k], gate
        if j >= 0:
            d = np.sqrt((x - reference[j, 0]) ** 2 + (y - reference[j, 1]) ** 2)
        if (j >= 0 and d >= gate) or d > others:
            # A little beyond the gate: who finds nobody there may move a little unasked.
            j, d, others = nearest(hashes, x, y, 1.1 * gate)
            if d >= gate:
                j, others = -1, d
            pair[k], places[k, 0], places[k, 1], places[k, 2] = j, x, y, others
        count += j >= 0
    return count


@njit(cache=True)
def _equations(reference, normals, points, pose, pair, width, line, H, g):  # type: ignore[no-untyped-def]
    """J^T w J and -J^T w e of all pairs."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    H[:], g[:] = 0.0, 0.0
    J = np.zeros((2, 3))
    e = np.zeros(2)
    for k in range(len(points)):
        j = pair[k]
        if j < 0:
            continue
        px, py = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        dx, dy = px + pose[0] - reference[j, 0], py + pose[1] - reference[j, 1]
        if line:  # n . (R p + t - q)
            nx, ny = normals[j, 0], normals[j, 1]
            e[0] = nx * dx + ny * dy
            J[0, 0], J[0, 1], J[0, 2] = nx, ny, ny * px - nx * py
        else:
            e[0], e[1] = dx, dy
            J[0, 0], J[0, 1], J[0, 2] = 1.0, 0.0, -py
            J[1, 0], J[1, 1], J[1, 2] = 0.0, 1.0, px
        w = (width**2 / (width**2 + e[0] ** 2 + e[1] ** 2)) ** 2  # Geman and McClure
        for q in range(1 if line else 2):
            for i in range(3):
                g[i] -= w * J[q, i] * e[q]
                for m in range(3):
                    H[i, m] += w * J[q, i] * J[q, m]


@njit(cache=True)
def align(reference, normals, points, pose, width, gates, n_iterations, line, prior):  # type: ignore[no-untyped-def]
    """Do what `slamlab.matching.icp.align` does."""
    guess = pose.copy()
    hashes = hashed(reference, 0.5 * gates[0])
    pair, places = np.full(len(points), -1), np.zeros((len(points), 3))
    H, g, step = np.empty((3, 3)), np.empty(3), np.zeros(3)
    for gate in gates:
        for _ in range(n_iterations):
            if _pairs(reference, hashes, points, pose, gate, pair, places) < 3:
                return np.full(len(points), -1)
            _equations(reference, normals, points, pose, pair, width, line, H, g)
            little = 1e-9 * (H[0, 0] + H[1, 1])
            for i in range(3):
                H[i, i] += little
                for m in range(3):
                    H[i, m] += prior[i, m]
                    g[i] -= prior[i, m] * (pose[m] - guess[m])
            if not solve3(H, g, step):
                return np.full(len(points), -1)
            pose += step
            if abs(step[0]) + abs(step[1]) < 1e-6 and abs(step[2]) < 1e-7:
                break
    _pairs(reference, hashes, points, pose, gates[-1], pair, places)
    return pair
