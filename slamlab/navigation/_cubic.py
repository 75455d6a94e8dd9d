"""One cubic of the plane on [0, 1]: value, box, fit, arc length, nearest point, own crossing.

P3 sections 2 and 4, with `slamlab.kernels.cubic`; a cubic is an array (4, 2), rows are powers of
tau. Chapter 17 reaches them through `slamlab.navigation.path_memory`.
"""

from __future__ import annotations

from math import hypot, nan, sqrt

import numpy as np

from slamlab._checks import Array


def point(c: Array, t: float) -> Array:
    """Point (2,) at t, for callers outside the compiled loops."""
    at: Array = c[0] + t * (c[1] + t * (c[2] + t * c[3]))
    return at


def restrict(c: Array, a: float, b: float) -> Array:
    """Coefficients of the piece from a to b, again on [0, 1]."""
    h, slope = b - a, c[1] + a * (2.0 * c[2] + a * 3.0 * c[3])
    return np.stack([point(c, a), h * slope, h * h * (c[2] + 3.0 * a * c[3]), h * h * h * c[3]])


# Arc length.


# Nearest point.


# Shape.


def runs_forward(c: Array) -> bool:
    """Whether the cubic always advances along its chord, so that it cannot meet itself."""
    (x1, y1), (x2, y2), (x3, y3) = c[1:].tolist()
    nx, ny = x1 + x2 + x3, y1 + y2 + y3
    d0 = nx * x1 + ny * y1
    d1 = d0 + nx * x2 + ny * y2
    d2 = 2.0 * d1 - d0 + 3.0 * (nx * x3 + ny * y3)
    return d0 > 0.0 and d1 > 0.0 and d2 > 0.0


def own_crossing(c: Array) -> tuple[float, float]:
    """Parameters t_a < t_b in [0, 1] at which the cubic crosses itself; NaN twice without.

    x(t_b) = x(t_a), divided by t_b - t_a, is linear in sigma = t_a + t_b and
    w = sigma^2 - t_a t_b: a_1 + a_2 sigma + a_3 w = 0, and the same in y.
    """
    (x1, y1), (x2, y2), (x3, y3) = c[1:].tolist()
    det = x2 * y3 - x3 * y2
    if abs(det) <= 1e-12 * hypot(x2, y2) * hypot(x3, y3) or det == 0.0:
        return nan, nan
    sigma = (x3 * y1 - x1 * y3) / det
    w = (x1 * y2 - x2 * y1) / det
    # Both are roots of t^2 - sigma t + (sigma^2 - w): real and distinct if 4 w > 3 sigma^2.
    disc = 4.0 * w - 3.0 * sigma * sigma
    if disc <= 0.0:
        return nan, nan
    first, second = 0.5 * (sigma - sqrt(disc)), 0.5 * (sigma + sqrt(disc))
    return (first, second) if first >= 0.0 and second <= 1.0 else (nan, nan)


# Constrained least squares.
