"""One cubic of the plane on [0, 1] in compiled loops: value, box, fit, arc length, nearest point.

P3 sections 2 and 4; a cubic is an array (4, 2), its rows are powers of tau.

Chapter 17 calls `fit` 34 803 times, `arc_length_table` 5 349 times and `parameter_at` 6 248 times;
the plain code takes 20, 78 and 140 times as long, in all 1.9, 4.0 and 1.7 s more. The other
functions are called by these and by the chain of cubics in `spline`.
"""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit

# Pieces of a segment whose lengths the inverse table t(s) keeps.
PIECES = 16
# Coordinates. A bare 0 or 1 has a type of its own, and a loop is compiled anew for each.
X, Y = np.int64(0), np.int64(1)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)


@njit(cache=True)
def value(c, t, k):  # type: ignore[no-untyped-def]
    """Coordinate k of the point at t."""
    return c[0, k] + t * (c[1, k] + t * (c[2, k] + t * c[3, k]))


@njit(cache=True)
def slope(c, t, k):  # type: ignore[no-untyped-def]
    """Coordinate k of the derivative at t."""
    return c[1, k] + t * (2.0 * c[2, k] + t * 3.0 * c[3, k])


@njit(cache=True)
def _gauss(c, a, b):  # type: ignore[no-untyped-def]
    half, middle, total = 0.5 * (b - a), 0.5 * (a + b), 0.0
    for i in range(len(_NODES)):
        t = middle + half * _NODES[i]
        total += _WEIGHTS[i] * np.hypot(slope(c, t, X), slope(c, t, Y))
    return half * total


@njit(cache=True)
def arc_length(c, a, b):  # type: ignore[no-untyped-def]
    """Arc length from a to b, piece by piece between the extrema of x and y.

    Where a curve folds the speed has a kink that the nodes of a quadrature may all miss; a fold
    is an extremum, so it can be only at the end of a piece.
    """
    cuts, total = np.empty(6), 0.0
    for k in range(monotone_cuts(c, cuts) - 1):
        low, high = max(cuts[k], a), min(cuts[k + 1], b)
        if low < high:
            total += _smooth_length(c, low, high, _gauss(c, low, high), 0.0)
    return total


@njit(cache=True)
def _smooth_length(c, a, b, whole, before):  # type: ignore[no-untyped-def]
    """`before` and Gauss-Legendre from a to b, halved until both halves agree with the whole."""
    middle = 0.5 * (a + b)
    left, right = _gauss(c, a, middle), _gauss(c, middle, b)
    if abs(left + right - whole) <= 1e-14 * (abs(whole) + abs(before)) + 1e-300 or b - a < 1e-12:
        return before + (left + right)
    return _smooth_length(c, middle, b, right, _smooth_length(c, a, middle, left, before))


@njit(cache=True)
def arc_length_table(c):  # type: ignore[no-untyped-def]
    """Lengths (PIECES + 1) from 0 to each of the evenly spaced parameters: the table s(t)."""
    table = np.zeros(PIECES + 1)
    for i in range(PIECES):
        table[i + 1] = table[i] + arc_length(c, i / PIECES, (i + 1) / PIECES)
    return table


@njit(cache=True)
def length_to(c, table, t):  # type: ignore[no-untyped-def]
    """Arc length from 0 to t."""
    i = min(int(t * PIECES), PIECES - 1)
    return table[i] + arc_length(c, i / PIECES, t)


@njit(cache=True)
def parameter_at(c, table, s):  # type: ignore[no-untyped-def]
    """Parameter t(s): the piece from the table, then Newton kept inside a shrinking bracket."""
    if s <= 0.0:
        return 0.0
    if s >= table[PIECES]:
        return 1.0
    i = np.searchsorted(table, s, side="right") - 1
    low, high = i / PIECES, (i + 1) / PIECES
    base, start = table[i], low
    t = low + (high - low) * (s - base) / (table[i + 1] - base)
    for _ in range(60):
        error = base + arc_length(c, start, t) - s
        if abs(error) <= 2e-16 * s or high - low < 1e-16:
            break
        if error > 0.0:
            high = t
        else:
            low = t
        speed = np.hypot(slope(c, t, X), slope(c, t, Y))
        step = t - error / speed if speed > 0.0 else low
        before, t = t, step if low < step < high else 0.5 * (low + high)
        if abs(t - before) < 1e-8:  # a step of Newton's leaves of its length the square
            break
    return t


@njit(cache=True)
def _pull(c, t, x, y):  # type: ignore[no-untyped-def]
    return (value(c, t, X) - x) * slope(c, t, X) + (value(c, t, Y) - y) * slope(c, t, Y)


@njit(cache=True)
def _foot(c, x, y, low, high):  # type: ignore[no-untyped-def]
    """Root of the pull between low, where it is negative, and high: Newton in that bracket."""
    t = 0.5 * (low + high)
    for _ in range(60):
        off_x, off_y = value(c, t, X) - x, value(c, t, Y) - y
        dx, dy = slope(c, t, X), slope(c, t, Y)
        pull = off_x * dx + off_y * dy
        if pull < 0.0:
            low = t
        else:
            high = t
        bend_x, bend_y = 2.0 * c[2, X] + 6.0 * t * c[3, X], 2.0 * c[2, Y] + 6.0 * t * c[3, Y]
        rise = dx * dx + dy * dy + off_x * bend_x + off_y * bend_y
        step = t - pull / rise if rise > 0.0 else low
        before, t = t, step if low < step < high else 0.5 * (low + high)
        if abs(t - before) < 1e-14:
            break
    return t


@njit(cache=True)
def nearest_parameter(c, x, y, a, b):  # type: ignore[no-untyped-def]
    """Parameter in [a, b] of the point nearest to (x, y), and the squared distance there.

    The distance is flat where derivative and offset are orthogonal: at each place where their
    product, on a grid, turns from negative to positive.
    """
    best_t, best = a, (value(c, a, X) - x) ** 2 + (value(c, a, Y) - y) ** 2
    n, before, pull_before = 24, a, _pull(c, a, x, y)
    for i in range(1, n + 1):
        t = a + (b - a) * i / n
        pull = _pull(c, t, x, y)
        found = _foot(c, x, y, before, t) if pull_before < 0.0 < pull else t
        squared = (value(c, found, X) - x) ** 2 + (value(c, found, Y) - y) ** 2
        if squared < best:
            best_t, best = found, squared
        before, pull_before = t, pull
    return best_t, best


@njit(cache=True)
def monotone_cuts(c, cuts):  # type: ignore[no-untyped-def]
    """Write 0, the extrema of x and y in between, and 1 to `cuts` (6,); return how many."""
    count = 1
    cuts[0] = 0.0
    for k in range(2):
        # Roots of the derivative c1 + 2 c2 t + 3 c3 t^2, in the form that does not cancel.
        A, B, C = 3.0 * c[3, k], 2.0 * c[2, k], c[1, k]
        disc = B * B - 4.0 * A * C
        if disc < 0.0:
            continue
        q = -0.5 * (B + (np.sqrt(disc) if B >= 0.0 else -np.sqrt(disc)))
        for upper, lower in ((q, A), (C, q)):
            if lower != 0.0 and abs(upper) < abs(lower) and upper * lower > 0.0:
                # Sorted in as it comes: to compile a call of `sort` takes two seconds.
                root, place = upper / lower, count
                while cuts[place - 1] > root:
                    cuts[place] = cuts[place - 1]
                    place -= 1
                cuts[place] = root
                count += 1
    cuts[count] = 1.0
    return count + 1


@njit(cache=True)
def fit(tau, points, has_end, has_slope, slope_x, slope_y):  # type: ignore[no-untyped-def]
    """Constrained least-squares cubic through points[0], P3 section 2, by orthogonalisation.

    tau (n,) runs from 0 to 1; points (n, 2). The slope is by tau. Free shapes:
    1: tau, tau^2, tau^3;             2 (slope): tau^2, tau^3;
    3 (end): tau(1-tau), tau^2(1-tau); 4 (both): tau^2(tau-1).
    Shapes that the data cannot tell from the earlier ones are left out: a lower degree.
    """
    n = len(tau)
    m = 3 - int(has_end) - int(has_slope)
    W, base = np.empty((n, m + 2)), np.zeros((4, 2))
    base[0, 0], base[0, 1] = points[0, 0], points[0, 1]
    if has_slope:
        base[1, 0], base[1, 1] = slope_x, slope_y
    for k in range(2):
        if has_end:
            row = 2 if has_slope else 1
            base[row, k] = points[n - 1, k] - base[0, k] - (base[1, k] if has_slope else 0.0)
        for i in range(n):
            W[i, m + k] = points[i, k] - value(base, tau[i], k)
    for i in range(n):
        t = tau[i]
        shape = t * t if has_slope else t
        if has_end:
            shape *= t - 1.0 if has_slope else 1.0 - t
        for j in range(m):
            W[i, j] = shape
            shape *= t
    x = _least_squares(W)
    for k in range(2):
        for j in range(m):
            if has_end and has_slope:
                base[2, k] -= x[j, k]
                base[3, k] += x[j, k]
            elif has_end:
                base[1 + j, k] += x[j, k]
                base[2 + j, k] -= x[j, k]
            else:
                base[4 - m + j, k] += x[j, k]
    return base


@njit(cache=True)
def _least_squares(W):  # type: ignore[no-untyped-def]
    """Solve A x = b, W = [A | b], by modified Gram-Schmidt, which is backward stable."""
    n, m = W.shape[0], W.shape[1] - 2
    R, x, least = np.zeros((m, m + 2)), np.zeros((m, 2)), np.empty(m)
    for j in range(m):
        least[j] = 1e-9 * np.sqrt(_dot(W, j, j))
    for j in range(m):
        norm = np.sqrt(_dot(W, j, j))
        if norm > least[j]:
            R[j, j] = norm
            for i in range(n):
                W[i, j] /= norm
            for k in range(j + 1, m + 2):
                R[j, k] = _dot(W, j, k)
                for i in range(n):
                    W[i, k] -= R[j, k] * W[i, j]
    for j in range(m - 1, -1, -1):
        if R[j, j] > 0.0:
            for k in range(2):
                total = R[j, m + k]
                for later in range(j + 1, m):
                    total -= R[j, later] * x[later, k]
                x[j, k] = total / R[j, j]
    return x


@njit(cache=True)
def _dot(W, j, k):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(W.shape[0]):
        total += W[i, j] * W[i, k]
    return total
