"""Where a new cubic meets an old path: a growing tree of boxes, halved to a given accuracy.

P3 section 3 (figure 2) in compiled loops; the plain twin stands in `slamlab.navigation.boxes`.
Between its extrema a cubic is monotone in x and in y, so the box of such a piece is the box of
its two ends, and stays so however often it is halved.
"""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit
from slamlab.kernels.cubic import X, Y, monotone_cuts, slope, value

# Two curves that meet at less than this sine run beside one another rather than cross.
_STEEP = 0.2


@njit(cache=True)
def search(c, low, high, path, boxes, last_tau, accuracy):  # type: ignore[no-untyped-def]
    """Find the last place where the piece [low, high] of `c` meets the path (n, 4, 2).

    Of the last segment only [0, last_tau] counts. Returns (t, segment, tau) of the last crossing
    and of the last place within `accuracy`, t is -1 where there is none; and how many boxes were
    compared. boxes (2 * capacity, 4) is a heap. A pair is split until both pieces are straight
    within the accuracy, and decided exactly.
    """
    n, tests, floor = len(path), 0, -1.0
    crossed, touched = (-1.0, -1, -1.0), (-1.0, -1, -1.0)
    # Pairs that wait: t from, t to, box, segment (-1: all that the box holds), tau from, tau to.
    stack = np.empty((2048, 6))
    top = _push_pieces(stack, 0, c, low, high)
    old, new = np.empty(4), np.empty(4)
    while top > 0:
        top -= 1
        t0, t1, a0, a1 = stack[top, 0], stack[top, 1], stack[top, 4], stack[top, 5]
        node, i = int(stack[top, 2]), int(stack[top, 3])
        if t1 <= floor or t1 <= crossed[0]:
            continue
        _ends_box(c, t0, t1, new)
        if i >= 0:
            _ends_box(path[i], a0, a1, old)
        else:
            for k in range(4):
                old[k] = boxes[node, k]
        tests += 1
        if not _overlap(old, new, accuracy):
            continue
        if i < 0:
            top = _open_box(stack, top, path, len(boxes) // 2, n, last_tau)
            continue
        bend_new, bend_old = _bend(c, t0, t1), _bend(path[i], a0, a1)
        if bend_new + bend_old > 0.25 * accuracy and (t1 - t0 > 1e-13 or a1 - a0 > 1e-13):
            top = _halve(stack, top, bend_new >= bend_old)
            continue
        a, t = crossing(path[i], a0, a1, c, t0, t1)
        last = last_tau if i == n - 1 else 1.0
        if 0.0 <= a <= last and low <= t <= high and t > crossed[0]:
            crossed = (t, i, a)
        a, t = last_touch(path[i], a0, a1, c, t0, t1, 0.75 * accuracy)
        if t > touched[0]:
            touched = (t, i, a)
            # Nothing earlier than a few accuracies before the last touch can matter.
            speed = np.hypot(slope(c, t, X), slope(c, t, Y))
            floor = t - (20.0 * accuracy / speed if speed > 0.0 else 0.0)
    return crossed, touched, tests


@njit(cache=True)
def _push_pieces(stack, top, c, t_low, t_high):  # type: ignore[no-untyped-def]
    """Pair each monotone piece of the new cubic with the box of everything, the last on top."""
    cuts = np.empty(6)
    for k in range(monotone_cuts(c, cuts) - 1):
        low, high = max(cuts[k], t_low), min(cuts[k + 1], t_high)
        if low < high:
            stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3] = low, high, 1, -1
            top += 1
    return top


@njit(cache=True)
def _open_box(stack, top, coefficients, half, n, last_tau):  # type: ignore[no-untyped-def]
    """Replace the box on top by its two halves, or that of one segment by its monotone pieces."""
    t0, t1, node = stack[top, 0], stack[top, 1], int(stack[top, 2])
    if node < half:
        for child in (2 * node, 2 * node + 1):
            first = child
            while first < half:
                first *= 2
            if first - half < n:
                stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3] = t0, t1, child, -1
                top += 1
        return top
    cuts = np.empty(6)
    end = last_tau if node - half == n - 1 else 1.0
    for k in range(monotone_cuts(coefficients[node - half], cuts) - 1):
        if cuts[k] < end:
            stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3] = t0, t1, node, node - half
            stack[top, 4], stack[top, 5] = cuts[k], min(cuts[k + 1], end)
            top += 1
    return top


@njit(cache=True)
def _halve(stack, top, new):  # type: ignore[no-untyped-def]
    """Replace the pair on top by two, the new piece or the old one halved, the later on top."""
    column = 0 if new else 4
    middle = 0.5 * (stack[top, column] + stack[top, column + 1])
    for k in range(6):  # number by number: a slice takes two seconds to compile
        stack[top + 1, k] = stack[top, k]
    stack[top, column + 1], stack[top + 1, column] = middle, middle
    return top + 2


@njit(cache=True)
def _ends_box(c, t0, t1, box):  # type: ignore[no-untyped-def]
    for k in range(2):
        first, last = value(c, t0, k), value(c, t1, k)
        box[k], box[2 + k] = min(first, last), max(first, last)


@njit(cache=True)
def _overlap(a, b, margin):  # type: ignore[no-untyped-def]
    in_x = a[0] <= b[2] + margin and b[0] <= a[2] + margin
    in_y = a[1] <= b[3] + margin and b[1] <= a[3] + margin
    return in_x and in_y


@njit(cache=True)
def _bend(c, t0, t1):  # type: ignore[no-untyped-def]
    """Bound on how far a piece strays from its chord: h^2 / 8 times the second derivative."""
    worst, h = 0.0, t1 - t0
    for t in (t0, t1):
        ax, ay = 2.0 * c[2, 0] + 6.0 * t * c[3, 0], 2.0 * c[2, 1] + 6.0 * t * c[3, 1]
        worst = max(worst, np.hypot(ax, ay))
    return 0.125 * h * h * worst


@njit(cache=True)
def crossing(old, a0, a1, c, t0, t1):  # type: ignore[no-untyped-def]
    """Parameters (a, t) at which two straight pieces cross, NaN where they do not."""
    px, py = value(old, a0, X), value(old, a0, Y)
    qx, qy = value(c, t0, X), value(c, t0, Y)
    dx, dy = value(old, a1, X) - px, value(old, a1, Y) - py
    ex, ey = value(c, t1, X) - qx, value(c, t1, Y) - qy
    rx, ry = qx - px, qy - py
    det = dx * ey - dy * ex
    if abs(det) > _STEEP * np.hypot(dx, dy) * np.hypot(ex, ey):
        # p + u d = q + v e
        u, v = (rx * ey - ry * ex) / det, (rx * dy - ry * dx) / det
        if -0.2 <= u <= 1.2 and -0.2 <= v <= 1.2:
            a, t, ok = _polish(old, a0 + u * (a1 - a0), c, t0 + v * (t1 - t0))
            if ok:
                return a, t
    return np.nan, np.nan


@njit(cache=True)
def last_touch(old, a0, a1, c, t0, t1, radius):  # type: ignore[no-untyped-def]
    """Parameters (a, t) of the last point of a piece within `radius` of another, or -1."""
    px, py = value(old, a0, X), value(old, a0, Y)
    qx, qy = value(c, t0, X), value(c, t0, Y)
    dx, dy = value(old, a1, X) - px, value(old, a1, Y) - py
    ex, ey = value(c, t1, X) - qx, value(c, t1, Y) - qy
    v, u = _last_touch(qx - px, qy - py, dx, dy, ex, ey, radius)
    if v < 0.0:
        return -1.0, -1.0
    return a0 + u * (a1 - a0), t0 + v * (t1 - t0)


@njit(cache=True)
def _polish(old, a, c, t):  # type: ignore[no-untyped-def]
    """Newton's method for old(a) = c(t); whether it arrived."""
    for _ in range(20):
        fx, fy = value(old, a, X) - value(c, t, X), value(old, a, Y) - value(c, t, Y)
        ax, ay, tx, ty = slope(old, a, X), slope(old, a, Y), slope(c, t, X), slope(c, t, Y)
        det = ay * tx - ax * ty
        if det == 0.0:
            return a, t, False
        # [a' -t'] (da, dt) = -f
        da, dt = (fx * ty - fy * tx) / det, (fx * ay - fy * ax) / det
        a, t = a + da, t + dt
        if not (-0.5 <= a <= 1.5 and -0.5 <= t <= 1.5):
            return a, t, False
        if abs(da) + abs(dt) < 1e-15:
            break
    gap = np.hypot(value(old, a, X) - value(c, t, X), value(old, a, Y) - value(c, t, Y))
    size = np.hypot(value(c, t, X), value(c, t, Y))
    return a, t, gap <= 1e-13 * (1.0 + size)


@njit(cache=True)
def _last_touch(rx, ry, dx, dy, ex, ey, radius):  # type: ignore[no-untyped-def]
    """Largest v in [0, 1] with r + v e within `radius` of the segment from 0 to d; and u there.

    The places within `radius` of a segment are two discs and a rectangle; -1 if all are missed.
    """
    dd, ee = dx * dx + dy * dy, ex * ex + ey * ey
    best = -1.0
    if _reaches(rx + ex, ry + ey, dx, dy, dd, radius):
        best = 1.0
    elif ee > 0.0:
        for k in range(2):
            # |r + v e - centre|^2 = radius^2
            wx, wy = rx - k * dx, ry - k * dy
            b, q = wx * ex + wy * ey, wx * wx + wy * wy - radius * radius
            disc = b * b - ee * q
            if disc >= 0.0:
                v = (-b + np.sqrt(disc)) / ee
                if 0.0 <= v <= 1.0:
                    best = max(best, v)
        long = np.sqrt(dd)
        rise = dx * ey - dy * ex
        if rise != 0.0:
            for side in (-radius, radius):
                # The side lines of the rectangle: d x (r + v e) = +- radius |d|
                v = (side * long - (dx * ry - dy * rx)) / rise
                along = dx * (rx + v * ex) + dy * (ry + v * ey)
                if 0.0 <= v <= 1.0 and 0.0 <= along <= dd:
                    best = max(best, v)
        if best < 0.0 and _reaches(rx, ry, dx, dy, dd, radius):
            best = 0.0
    along = dx * (rx + best * ex) + dy * (ry + best * ey)
    u = min(max(along / dd, 0.0), 1.0) if dd > 0.0 else 0.0
    return best, u


@njit(cache=True)
def _reaches(x, y, dx, dy, dd, radius):  # type: ignore[no-untyped-def]
    u = min(max((x * dx + y * dy) / dd, 0.0), 1.0) if dd > 0.0 else 0.0
    return (x - u * dx) ** 2 + (y - u * dy) ** 2 <= radius * radius
