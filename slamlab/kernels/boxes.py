"""Where a new cubic meets an old path: a growing tree of boxes, halved to a given accuracy.

P3 section 3 (figure 2) in compiled loops. Between its extrema a cubic is monotone in x and in y,
so the box of such a piece is the box of its two ends, and stays so however often it is halved.
"""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit
from slamlab.kernels.cubic import X, Y, fill_box, monotone_cuts, slope, value

# Columns of the answer of `search`.
TESTS, CROSS_T, CROSS_I, CROSS_TAU, TOUCH_T, TOUCH_I, TOUCH_TAU = range(7)
# Two curves that meet at less than this sine run beside one another rather than cross.
_STEEP = 0.2


@njit(cache=True)
def set_box(boxes, coefficients, i, n):  # type: ignore[no-untyped-def]
    """Renew the box of segment i and of all boxes above it, with segments 0 to n - 1 alive.

    boxes (2 * capacity, 4) is a heap: box 1 holds all, boxes 2 k and 2 k + 1 the halves of k.
    """
    half = len(boxes) // 2
    fill_box(coefficients[i], boxes[half + i])
    node, first, size = half + i, i, 1
    while node > 1:
        node //= 2
        size *= 2
        first = i // size * size
        right_lives = first + size // 2 < n
        for k in range(2):
            low, high = boxes[2 * node, k], boxes[2 * node, 2 + k]
            if right_lives:
                low = min(low, boxes[2 * node + 1, k])
                high = max(high, boxes[2 * node + 1, 2 + k])
            boxes[node, k], boxes[node, 2 + k] = low, high


@njit(cache=True)
def set_boxes(boxes, coefficients, n):  # type: ignore[no-untyped-def]
    """Renew all boxes of segments 0 to n - 1."""
    for i in range(n):
        set_box(boxes, coefficients, i, i + 1)


@njit(cache=True)
def search(c, t_low, t_high, coefficients, boxes, n, last_tau, accuracy, small_boxes):  # type: ignore[no-untyped-def]
    """Find the last place where the piece [t_low, t_high] of `c` meets the first n segments.

    Of segment n - 1 only [0, last_tau] counts. Returns numbers in the order of the constants
    above: how many boxes were compared, then t, segment and tau of the last crossing and of the
    last place within `accuracy`; t is -1 where there is none.

    With `small_boxes` a pair is split until both boxes are smaller than `accuracy` and is then
    called a meeting, as in P3; else until both pieces are straight within it, and decided exactly.
    """
    found = np.full(7, -1.0)
    found[TESTS] = 0.0
    # Pairs that wait: t from, t to, box, segment (-1: all that the box holds), tau from, tau to.
    stack = np.empty((2048, 6))
    top = _push_pieces(stack, 0, c, t_low, t_high)
    floor, margin = -1.0, (0.0 if small_boxes else accuracy)
    old, new = np.empty(4), np.empty(4)
    while top > 0:
        top -= 1
        t0, t1, a0, a1 = stack[top, 0], stack[top, 1], stack[top, 4], stack[top, 5]
        node, i = int(stack[top, 2]), int(stack[top, 3])
        if t1 <= floor or t1 <= found[CROSS_T]:
            continue
        _ends_box(c, t0, t1, new)
        if i >= 0:
            _ends_box(coefficients[i], a0, a1, old)
        else:
            for k in range(4):
                old[k] = boxes[node, k]
        found[TESTS] += 1.0
        if not _overlap(old, new, margin):
            continue
        if i < 0:
            top = _open_box(stack, top, coefficients, len(boxes) // 2, n, last_tau)
            continue
        if small_boxes:
            size_new, size_old = _size(new), _size(old)
            leaf = max(size_new, size_old) <= accuracy
        else:
            size_new, size_old = _bend(c, t0, t1), _bend(coefficients[i], a0, a1)
            leaf = size_new + size_old <= 0.25 * accuracy
        if not leaf and (t1 - t0 > 1e-13 or a1 - a0 > 1e-13):
            top = _halve(stack, top, size_new >= size_old)
        elif small_boxes:
            found[TOUCH_T], found[TOUCH_I], found[TOUCH_TAU] = t1, i, a1
            return found
        else:
            last = last_tau if i == n - 1 else 1.0
            window = (t_low, t_high, last)
            if _decide(c, t0, t1, coefficients[i], a0, a1, accuracy, i, window, found):
                # Nothing earlier than a few accuracies before the last touch can matter.
                speed = np.hypot(slope(c, found[TOUCH_T], X), slope(c, found[TOUCH_T], Y))
                floor = found[TOUCH_T] - (20.0 * accuracy / speed if speed > 0.0 else 0.0)
    return found


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
def _size(box):  # type: ignore[no-untyped-def]
    return max(box[2] - box[0], box[3] - box[1])


@njit(cache=True)
def _bend(c, t0, t1):  # type: ignore[no-untyped-def]
    """Bound on how far a piece strays from its chord: h^2 / 8 times the second derivative."""
    worst, h = 0.0, t1 - t0
    for t in (t0, t1):
        ax, ay = 2.0 * c[2, 0] + 6.0 * t * c[3, 0], 2.0 * c[2, 1] + 6.0 * t * c[3, 1]
        worst = max(worst, np.hypot(ax, ay))
    return 0.125 * h * h * worst


@njit(cache=True)
def _decide(c, t0, t1, old, a0, a1, accuracy, i, window, found):  # type: ignore[no-untyped-def]
    """Compare two straight pieces; note crossing and touch if later. True if a touch is new."""
    t_low, t_high, last_tau = window
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
            a, t = a0 + u * (a1 - a0), t0 + v * (t1 - t0)
            a, t, ok = polish(old, a, c, t)
            if ok and 0.0 <= a <= last_tau and t_low <= t <= t_high and t > found[CROSS_T]:
                found[CROSS_T], found[CROSS_I], found[CROSS_TAU] = t, i, a
    v, u = _last_touch(rx, ry, dx, dy, ex, ey, 0.75 * accuracy)
    t = t0 + v * (t1 - t0)
    if v < 0.0 or t <= found[TOUCH_T]:
        return False
    found[TOUCH_T], found[TOUCH_I], found[TOUCH_TAU] = t, i, a0 + u * (a1 - a0)
    return True


@njit(cache=True)
def polish(old, a, c, t):  # type: ignore[no-untyped-def]
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
