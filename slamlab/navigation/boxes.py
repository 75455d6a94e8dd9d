"""Where a new cubic meets a path: boxes, halved until the pieces in them are straight.

P3 section 3: the tree of boxes of figure 2, the last crossing and the last touch. `spline` cuts
the loops out that this finds; data is trusted. Chapter 17.
"""

from __future__ import annotations

import numpy as np

from slamlab._checks import Array
from slamlab.kernels import compiled
from slamlab.navigation.cubic import cross, monotone_cuts, point, slope

__all__: list[str] = []

Meeting = tuple[float, int, float]  # tau of the new cubic, segment of the path, tau there
NOWHERE: Meeting = (-1.0, -1, -1.0)
STEEP = 0.2  # curves that meet at less than this sine run beside one another rather than cross


@compiled("boxes.search")
def search(
    c: Array,
    low: float,
    high: float,
    path: Array,
    boxes: Array,
    last_tau: float,
    accuracy: float,
) -> tuple[Meeting, Meeting, int]:
    """Last crossing and last touch of c in [low, high] with the path (n, 4, 2); boxes compared.

    Of the last segment only [0, last_tau] counts. Between its extrema a cubic is monotone in x
    and y, so the box of such a piece is that of its two ends, however often it is halved. A pair
    is halved until both pieces are straight within the accuracy.
    """
    n, half, tests, floor = len(path), len(boxes) // 2, 0, -1.0
    crossed = touched = NOWHERE
    # Pairs that wait, the last of the new cubic on top: its piece, a box, and a piece of the
    # segment that the box holds (None: all that is in it).
    pairs: list[tuple[tuple[float, float], int, tuple[float, float] | None]]
    pairs = [(piece, 1, None) for piece in _pieces(c, low, high)]
    while pairs:
        new, node, old = pairs.pop()
        if new[1] <= max(floor, crossed[0]):
            continue
        tests += 1
        box = boxes[node] if old is None else _ends_box(path[node - half], *old)
        if not _overlap(box, _ends_box(c, *new), accuracy):
            continue
        i = node - half
        if old is None:
            if node < half:  # both halves of the box, as far as they hold a segment
                pairs += [(new, k, None) for k in (2 * node, 2 * node + 1) if _first(k, half) < n]
            else:
                end = last_tau if i == n - 1 else 1.0
                pairs += [(new, node, piece) for piece in _pieces(path[i], 0.0, end)]
            continue
        bends = _bend(c, *new), _bend(path[i], *old)
        if sum(bends) > 0.25 * accuracy and max(new[1] - new[0], old[1] - old[0]) > 1e-13:
            if bends[0] >= bends[1]:
                pairs += [(piece, node, old) for piece in _halves(*new)]
            else:
                pairs += [(new, node, piece) for piece in _halves(*old)]
            continue
        tau, t = crossing(path[i], *old, c, *new)
        if 0.0 <= tau <= (last_tau if i == n - 1 else 1.0) and low <= t <= high and t > crossed[0]:
            crossed = (t, i, tau)
        tau, t = last_touch(path[i], *old, c, *new, 0.75 * accuracy)
        if t > touched[0]:
            touched = (t, i, tau)
            # Nothing earlier than a few accuracies before the last touch can matter.
            speed = np.hypot(*slope(c, t))
            floor = t - (20.0 * accuracy / speed if speed > 0.0 else 0.0)
    return crossed, touched, tests


def crossing(
    old: Array, a0: float, a1: float, c: Array, t0: float, t1: float
) -> tuple[float, float]:
    """Parameters (a, t) with old(a) = c(t): where the chords cross, then Newton; NaN without."""
    none = (np.nan, np.nan)
    p, q = point(old, a0), point(c, t0)
    d, e, r = point(old, a1) - p, point(c, t1) - q, q - p
    det = cross(d, e)
    if abs(det) <= STEEP * np.hypot(*d) * np.hypot(*e):
        return none
    u, v = cross(r, e) / det, cross(r, d) / det  # p + u d = q + v e
    if min(u, v) < -0.2 or max(u, v) > 1.2:
        return none
    a, t = a0 + u * (a1 - a0), t0 + v * (t1 - t0)
    for _ in range(20):
        f, da, dt = point(old, a) - point(c, t), slope(old, a), slope(c, t)
        det = -cross(da, dt)
        if det == 0.0:
            return none
        step = cross(f, dt) / det, cross(f, da) / det  # [a' -t'] step = -f
        a, t = a + step[0], t + step[1]
        if min(a, t) < -0.5 or max(a, t) > 1.5:
            return none
        if abs(step[0]) + abs(step[1]) < 1e-15:
            break
    gap = np.hypot(*(point(old, a) - point(c, t)))
    return (a, t) if gap <= 1e-13 * (1.0 + np.hypot(*point(c, t))) else none


def last_touch(
    old: Array, a0: float, a1: float, c: Array, t0: float, t1: float, radius: float
) -> tuple[float, float]:
    """Parameters (a, t) of the last point of a straight piece within `radius` of another, or -1.

    The places within `radius` of a segment are two discs and a rectangle between them.
    """
    p, q = point(old, a0), point(c, t0)
    d, e, r = point(old, a1) - p, point(c, t1) - q, q - p
    dd, ee = d @ d, e @ e

    def along(v: float) -> float:
        return float(np.clip((r + v * e) @ d / dd, 0.0, 1.0)) if dd > 0.0 else 0.0

    candidates = [0.0, 1.0]
    for w in (r, r - d):  # |w + v e| = radius
        b, disc = w @ e, (w @ e) ** 2 - ee * (w @ w - radius**2)
        if ee > 0.0 and disc >= 0.0:
            candidates.append(float((-b + np.sqrt(disc)) / ee))
    if cross(d, e) != 0.0:  # d x (r + v e) = +- radius |d|
        sides = np.array([-radius, radius]) * np.sqrt(dd)
        candidates += ((sides - cross(d, r)) / cross(d, e)).tolist()
    reach = radius * (1.0 + 1e-9)
    best = max(
        (v for v in candidates if 0 <= v <= 1 and np.hypot(*(r + v * e - along(v) * d)) <= reach),
        default=-1.0,
    )
    return (a0 + along(best) * (a1 - a0), t0 + best * (t1 - t0)) if best >= 0.0 else (-1.0, -1.0)


def _pieces(c: Array, low: float, high: float) -> list[tuple[float, float]]:
    """Pieces of [low, high] between the extrema of a cubic."""
    cuts = np.clip(monotone_cuts(c), low, high).tolist()
    return [(a, b) for a, b in zip(cuts[:-1], cuts[1:], strict=True) if a < b]


def _halves(a: float, b: float) -> list[tuple[float, float]]:
    return [(a, 0.5 * (a + b)), (0.5 * (a + b), b)]


def _first(node: int, half: int) -> int:
    """First segment below a box of the heap."""
    while node < half:
        node *= 2
    return node - half


def _ends_box(c: Array, t0: float, t1: float) -> Array:
    ends = point(c, t0), point(c, t1)
    return np.concatenate([np.minimum(*ends), np.maximum(*ends)])


def _overlap(a: Array, b: Array, margin: float) -> bool:
    return bool((a[:2] <= b[2:] + margin).all() and (b[:2] <= a[2:] + margin).all())


def _bend(c: Array, t0: float, t1: float) -> float:
    """Bound on how far a piece strays from its chord: h^2 / 8 times the second derivative."""
    second = [np.hypot(*(2.0 * c[2] + 6.0 * t * c[3])) for t in (t0, t1)]
    return float(0.125 * (t1 - t0) ** 2 * max(second))
