"""Convex footprints against cells, standing, driving and turning: the compiled loop.

A straight drive sweeps the Minkowski sum of the footprint and the way: separating axes decide. A
turn on the spot first meets an obstacle where a vertex of one touches an edge of the other, and a
turning vertex draws an arc. Both are exact; touching is no collision.
"""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit

# The footprint is drawn in by this much (m), so that touching does not count.
_DRAW_IN = 1e-9


@njit(cache=True)
def hits_grid(solid, resolution, left, bottom, footprint, starts, ends):  # type: ignore[no-untyped-def]
    """Tell for each motion whether the footprint sweeps over a solid cell or leaves the grid."""
    cell, out = np.empty((4, 2)), np.zeros(len(starts), np.bool_)
    for i in range(len(out)):
        a, b, turn = _placed(footprint, starts[i], ends[i])
        box = _reach(a, b, starts[i], turn)
        right, top = left + resolution * solid.shape[1], bottom + resolution * solid.shape[0]
        if box[1] <= left or box[0] >= right or box[3] <= bottom or box[2] >= top:
            out[i] = True
            continue
        c0, c1 = int((box[0] - left) // resolution), int((box[1] - left) // resolution)
        r0, r1 = int((box[2] - bottom) // resolution), int((box[3] - bottom) // resolution)
        for r in range(r0, r1 + 1):
            for c in range(c0, c1 + 1):
                if 0 <= r < solid.shape[0] and 0 <= c < solid.shape[1] and not solid[r, c]:
                    continue
                x, y = left + c * resolution, bottom + r * resolution
                cell[0, 0] = cell[3, 0] = x
                cell[1, 0] = cell[2, 0] = x + resolution
                cell[0, 1] = cell[1, 1] = y
                cell[2, 1] = cell[3, 1] = y + resolution
                if _swept(a, b, starts[i], turn, cell):
                    out[i] = True
                    break
            if out[i]:
                break
    return out


@njit(cache=True)
def _placed(footprint, start, end):  # type: ignore[no-untyped-def]
    """Footprint at both poses, drawn in a little, and the turn between them (shorter way)."""
    n = len(footprint)
    centre_x, centre_y = footprint[:, 0].mean(), footprint[:, 1].mean()
    a, b = np.empty((n, 2)), np.empty((n, 2))
    for k in range(n):
        x, y = footprint[k, 0] - centre_x, footprint[k, 1] - centre_y
        scale = max(1.0 - _DRAW_IN / max(np.hypot(x, y), _DRAW_IN), 0.0)
        x, y = centre_x + scale * x, centre_y + scale * y
        for pose, out in ((start, a), (end, b)):
            c, s = np.cos(pose[2]), np.sin(pose[2])
            out[k, 0] = pose[0] + c * x - s * y
            out[k, 1] = pose[1] + s * x + c * y
    turn = end[2] - start[2]
    return a, b, turn - 2 * np.pi * np.rint(turn / (2 * np.pi))


@njit(cache=True)
def _reach(a, b, pivot, turn):  # type: ignore[no-untyped-def]
    """Left, right, bottom and top of a box that holds the swept area."""
    box = np.array([a[0, 0], a[0, 0], a[0, 1], a[0, 1]])
    for polygon in (a, b):
        for k in range(len(polygon)):
            box[0], box[1] = min(box[0], polygon[k, 0]), max(box[1], polygon[k, 0])
            box[2], box[3] = min(box[2], polygon[k, 1]), max(box[3], polygon[k, 1])
    if turn != 0.0:
        radius = 0.0
        for k in range(len(a)):
            radius = max(radius, np.hypot(a[k, 0] - pivot[0], a[k, 1] - pivot[1]))
        box[0], box[1] = min(box[0], pivot[0] - radius), max(box[1], pivot[0] + radius)
        box[2], box[3] = min(box[2], pivot[1] - radius), max(box[3], pivot[1] + radius)
    return box


@njit(cache=True)
def _swept(a, b, pivot, turn, obstacle):  # type: ignore[no-untyped-def]
    """Tell whether the footprint, moved from `a` to `b`, meets the convex obstacle."""
    if turn == 0.0:
        return _overlap(a, b, obstacle)
    if _overlap(a, a, obstacle) or _overlap(b, b, obstacle):
        return True
    for k in range(len(a)):
        if _arc_meets(a[k], pivot, turn, obstacle):
            return True
    for k in range(len(obstacle)):
        # Seen from the footprint the obstacle turns the other way.
        if _arc_meets(obstacle[k], pivot, -turn, a):
            return True
    return False


@njit(cache=True)
def _overlap(a, b, obstacle):  # type: ignore[no-untyped-def]
    """Tell whether the hull of `a` and its shifted copy `b` overlaps the obstacle."""
    dx, dy = b[0, 0] - a[0, 0], b[0, 1] - a[0, 1]
    if (dx != 0.0 or dy != 0.0) and _apart(-dy, dx, a, b, obstacle):
        return False
    for polygon in (a, obstacle):
        n = len(polygon)
        for k in range(n):
            m = (k + 1) % n
            nx, ny = polygon[k, 1] - polygon[m, 1], polygon[m, 0] - polygon[k, 0]
            if (nx != 0.0 or ny != 0.0) and _apart(nx, ny, a, b, obstacle):
                return False
    return True


@njit(cache=True)
def _apart(nx, ny, a, b, obstacle):  # type: ignore[no-untyped-def]
    """Tell whether the axis (nx, ny) separates both copies from the obstacle."""
    low, high = np.inf, -np.inf
    for polygon in (a, b):
        for k in range(len(polygon)):
            value = nx * polygon[k, 0] + ny * polygon[k, 1]
            low, high = min(low, value), max(high, value)
    least, most = np.inf, -np.inf
    for k in range(len(obstacle)):
        value = nx * obstacle[k, 0] + ny * obstacle[k, 1]
        least, most = min(least, value), max(most, value)
    return high < least or most < low


@njit(cache=True)
def _arc_meets(point, pivot, turn, polygon):  # type: ignore[no-untyped-def]
    """Tell whether a point that turns about the pivot crosses an edge of the polygon."""
    x, y = point[0] - pivot[0], point[1] - pivot[1]
    squared, begin = x * x + y * y, np.arctan2(y, x)
    n = len(polygon)
    for k in range(n):
        px, py = polygon[k, 0] - pivot[0], polygon[k, 1] - pivot[1]
        ex = polygon[(k + 1) % n, 0] - pivot[0] - px
        ey = polygon[(k + 1) % n, 1] - pivot[1] - py
        # |p + u e| = radius, a quadratic in u.
        A, B = ex * ex + ey * ey, px * ex + py * ey
        root = B * B - A * (px * px + py * py - squared)
        if root < 0.0 or A == 0.0:
            continue
        for sign in (-1.0, 1.0):
            u = (-B + sign * np.sqrt(root)) / A
            if 0.0 <= u <= 1.0:
                angle = np.arctan2(py + u * ey, px + u * ex) - begin
                if turn < 0.0:
                    angle = -angle
                if angle % (2 * np.pi) <= abs(turn):
                    return True
    return False
