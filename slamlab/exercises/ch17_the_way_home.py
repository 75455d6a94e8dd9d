"""Checks of chapter 17: a constrained fit, a loop inside one cubic, gains for the way home.

P3 section 2 (two points), section 3 (closed form instead of boxes) and step 2.3 (return law).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from slamlab.exercises._report import Array, Check, Function
from slamlab.localization import DeadReckoning
from slamlab.navigation import Homer, PathMemory, ReturnLaw
from slamlab.robots import RelativePose, Unicycle
from slamlab.sensors import VisualOdometer
from slamlab.simulation import record

__all__ = ["check_fit", "check_loop", "check_tune"]


# Exercise 1: a fit through two points.


def _fit_between(t: Array, points: Array) -> Array:
    """Coefficients (4, 2), rows are powers of tau, of the cubic through first and last point."""
    tau = (t - t[0]) / (t[-1] - t[0])
    line = points[0] + tau[:, None] * (points[-1] - points[0])
    bulge = tau * (1 - tau)
    shapes = np.stack([bulge, tau * bulge], 1)
    alpha, beta = np.linalg.lstsq(shapes, points - line, rcond=None)[0]
    return np.array([points[0], points[-1] - points[0] + alpha, beta - alpha, -beta])


def _free(t: Array, points: Array) -> Array:
    tau = (t - t[0]) / (t[-1] - t[0])
    c: Array = np.linalg.lstsq(tau[:, None] ** np.arange(4), points, rcond=None)[0]
    return c


def _straightened(t: Array, points: Array) -> Array:
    c = _free(t, points)
    c[1] += points[-1] - points[0] - (c.sum(0) - c[0])
    c[0] = points[0]
    return c


def _start_only(t: Array, points: Array) -> Array:
    tau = (t - t[0]) / (t[-1] - t[0])
    shapes = np.stack([tau, tau**2, tau**3], 1)
    return np.vstack([points[:1], np.linalg.lstsq(shapes, points - points[0], rcond=None)[0]])


def _divided(t: Array, points: Array) -> Array:
    tau = (t - t[0]) / (t[-1] - t[0])
    line = points[0] + tau[:, None] * (points[-1] - points[0])
    due = (points - line)[1:-1] / (tau * (1 - tau))[1:-1, None]
    shapes = np.stack([np.ones(len(due)), tau[1:-1]], 1)
    alpha, beta = np.linalg.lstsq(shapes, due, rcond=None)[0]
    return np.stack([points[0], points[-1] - points[0] + alpha, beta - alpha, -beta])


def _path(n: int) -> Any:
    def draw(rng: np.random.Generator) -> Any:
        t = np.cumsum(np.round(rng.uniform(0.1, 1, n), 2)) + np.round(rng.uniform(-9, 9), 1)
        return t, np.round(rng.normal(0, 1, (n, 2)), 2) + np.round(rng.normal(0, 9, 2), 1)

    return draw


_T = np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.8])

check_fit = Check(
    _fit_between,
    "coefficients",
    {
        "a cubic is reproduced": (_T, np.stack([_T, _T**2 - _T**3], 1)),
        "four points: the curve meets all": _path(4),
        "ends hold, the rest is least squares": _path(7),
        "many points": _path(40),
    },
    {
        "no constraint: the curve must pass through the first and the last point": _free,
        "a free fit was bent to its ends afterwards: that is not the best curve through them": (
            _straightened
        ),
        "the end is not held: only the first point is on the curve": _start_only,
        "the equation was divided by tau (1 - tau): points near the ends count too much": (
            _divided
        ),
        "one shape only: tau (1 - tau) and tau^2 (1 - tau) are both free": (
            "np.stack([bulge, tau * bulge], 1)",
            "np.stack([bulge, 0 * bulge], 1)",
        ),
        "the sign of beta was lost in multiplying out: tau^2 (1 - tau) has -tau^3": (
            "-beta])",
            "beta])",
        ),
        "the sign of alpha was lost in multiplying out: tau (1 - tau) has -tau^2": (
            "beta - alpha",
            "beta + alpha",
        ),
        "these are powers of t - t0: tau = (t - t0) / (t1 - t0)": (
            lambda t, points: _fit_between(t, points) / (t[-1] - t[0]) ** np.arange(4)[:, None]
        ),
        "tau must grow with t, not with the number of the point": (
            "tau = (t - t[0]) / (t[-1] - t[0])",
            "tau = np.linspace(0, 1, len(t))",
        ),
        "highest power first: row 0 is the constant": (
            lambda t, points: _fit_between(t, points)[::-1]
        ),
        "this is the transpose: rows are powers, columns x and y": (
            lambda t, points: _fit_between(t, points).T
        ),
        "the line alone came: the bulges are missing": (
            "np.linalg.lstsq(shapes, points - line, rcond=None)[0]",
            "np.zeros((2, 2))",
        ),
    },
    tolerance=1e-7,
)


# Exercise 2: a loop inside one cubic.


def _find_loop(c: Array) -> tuple[float, float]:
    """Parameters t_a < t_b in [0, 1] where a cubic meets itself; NaN twice if it does not."""
    if abs(np.linalg.det(c[2:])) < 1e-12:  # a line or a parabola has no loop
        return np.nan, np.nan
    sigma, w = np.linalg.solve(c[2:].T, -c[1])
    root = np.sqrt(4 * w - 3 * sigma**2) if 4 * w > 3 * sigma**2 else np.nan
    t_a, t_b = 0.5 * (sigma - root), 0.5 * (sigma + root)
    return (t_a, t_b) if t_a >= 0 and t_b <= 1 else (np.nan, np.nan)


def _handles(points: Any) -> Array:
    powers = [[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]
    c: Array = np.array(powers, float) @ np.array(points, float)
    return c


def _with_loop(t_a: float, t_b: float) -> Any:
    """Draw cubics that meet themselves at t_a and t_b."""

    def draw(rng: np.random.Generator) -> Any:
        high = np.round(rng.normal(0, 3, (2, 2)), 1) + 6 * np.eye(2)
        high[:, 1] *= rng.choice([-1, 1])  # loops that turn left, and right
        sigma, w = t_a + t_b, (t_a + t_b) ** 2 - t_a * t_b
        return (np.array([rng.normal(size=2), -high[0] * sigma - high[1] * w, *high]),)

    return draw


check_loop = Check(
    _find_loop,
    "t_a, t_b",
    {
        "a loop that is the same from both sides": (_handles([[0, 0], [3, 2], [-2, 2], [1, 0]]),),
        "another loop": (_handles([[0, 0], [2.5, 2.4], [-1.6, 1.5], [1.2, 0.3]]),),
        "an arc without a loop": (_handles([[0, 0], [1, 2], [2.2, 2], [3, 0.2]]),),
        "an S has no loop": (_handles([[0, 0], [1, 1], [2, -1], [3.3, 0.2]]),),
        "loops of any size": lambda rng: _with_loop(rng.uniform(0, 0.4), rng.uniform(0.5, 1))(rng),
        "half of a loop: it does not close": _with_loop(0.3, 1.4),
        "a loop that begins before the segment": _with_loop(-0.2, 0.6),
        "a loop of millimetres": lambda rng: (1e-3 * _with_loop(0.2, 0.7)(rng)[0],),
        "a loop that begins with the segment": ([[0, 0], [2, 0], [-8, 4], [8, -8]],),
        "a loop that ends with the segment": ([[0, 0], [-2, 8], [-8, 4], [8, -8]],),
        "a loop whose first leg was turned round": lambda rng: (
            _with_loop(0.2, 0.7)(rng)[0] * [[1], [-1], [1], [1]],
        ),
        "a straight line": ([[0, 0], [1, 2], [0, 0], [0, 0]],),
        "a parabola": ([[0, 0], [1, 0], [0, 1], [0, 0]],),
    },
    {
        "the right side lost its minus: a_2 sigma + a_3 w = -a_1": ("-c[1]", "c[1]"),
        "no loop was found at all: w is sigma^2 - t_a t_b, the root is of 4 w - 3 sigma^2": (
            "np.sqrt(4 * w - 3 * sigma**2) if 4 * w > 3 * sigma**2",
            "np.sqrt(sigma**2 - 4 * w) if sigma**2 > 4 * w",
        ),
        "twice too large: t = (sigma -+ root) / 2": (
            "0.5 * (sigma - root), 0.5 * (sigma + root)",
            "sigma - root, sigma + root",
            "t_a >= 0 and t_b <= 1",
            "t_a >= 0 and t_b <= 2",
        ),
        "a loop outside [0, 1] is no loop of this segment: return NaN twice": (
            "t_a >= 0 and t_b <= 1",
            "True",
        ),
        "a loop that begins before the segment does not close in it: t_a must not be negative": (
            "t_a >= 0 and t_b <= 1",
            "t_b <= 1",
        ),
        "a loop that ends after the segment does not close in it: t_b is at most 1": (
            "t_a >= 0 and t_b <= 1",
            "t_a >= 0",
        ),
        "t_a is the earlier of the two": lambda c: _find_loop(c)[::-1],
        "these are sigma and w: the two parameters are due": (
            lambda c: np.linalg.solve(c[2:].T, -c[1])
        ),
        "t_a and t_b differ: this is their mean twice": (
            "0.5 * (sigma - root), 0.5 * (sigma + root)",
            "0.5 * sigma, 0.5 * sigma",
        ),
    },
    tolerance=1e-7,
    edges=("a straight line", "a parabola"),
)


# Exercise 3: gains for the way home.


def _tune() -> tuple[float, float, float]:
    """Return k_v (1/s), k_omega (1/s) and the look-ahead distance (m)."""
    return 1.0, 2.0, 0.15


@lru_cache(maxsize=1)
def _stairs() -> PathMemory:
    memory = PathMemory(0.02)
    corners = 0.5 * np.array([[0, 0], [1, 0], [1, 1], [2, 1], [2, 2], [3, 2]])
    for a, b in zip(corners[:-1], corners[1:], strict=True):
        for point in np.linspace(a, b, 21):
            memory.add(point)
    memory.close()
    return memory


@lru_cache(maxsize=64)
def _drive(k_v: float, k_omega: float, lookahead: float) -> tuple[str, ...]:
    """Say what is wrong with each aspect of the way home: nothing where it is well."""
    path, exact = _stairs(), VisualOdometer.simple(0.0, 0.0)
    law = ReturnLaw(k_v, k_omega, lookahead, max_speed=0.2, max_turn_rate=1.5)
    start = [*path.point_at(path.length), np.pi]
    pilot, belief = Homer(path, law), DeadReckoning(RelativePose(), start)
    rng = np.random.default_rng(0)
    home = record(
        None, Unicycle(), None, pilot, belief, rng, start=start, odometer=exact, max_time=90.0
    )
    truth = home.notes["believed"]  # the odometer is exact
    away = path.nearest(truth[:, :2])[1].max()
    full = np.mean(np.abs(home.notes["command"][1:, 1]) > 1.49)
    # The stairs lie between two lines through their corners, x - y = 0 and x - y = 0.5.
    band = (truth[:, 0] - truth[:, 1]) / np.sqrt(2)
    past = max(-band.min(), band.max() - 0.5 / np.sqrt(2))
    seconds = home.times[-1]
    left = f"it leaves the path by {100 * away:.0f} cm, 6 are allowed: "
    return (
        "" if pilot.arrived else "it does not come home within 90 s",
        "" if away <= 0.06 else left + "the look-ahead distance is too long, or k_omega too small",
        ""
        if seconds <= 40.0
        else f"it needs {seconds:.0f} s, 40 are allowed: v = k_v |P_f P_r|, and |P_f P_r| is "
        "about the look-ahead distance",
        ""
        if full < 1 / 3
        else f"it shakes: it turns at full rate for {100 * full:.0f} % of the time, a third is "
        "allowed; k_omega is so large that the turn rate flies from limit to limit",
        ""
        if past <= 0.04
        else f"it swings past a corner by {100 * past:.0f} cm, 4 are allowed: k_omega is too "
        "small for the speed",
    )


def _aspect(gains: Function, aspect: int) -> Any:
    given = gains()
    if given is None or given is Ellipsis:
        return None
    try:
        k_v, k_omega, lookahead = (float(value) for value in given)
    except (TypeError, ValueError):
        return "three numbers are due: k_v, k_omega and the look-ahead distance"
    if not all(np.isfinite(gain) and gain > 0 for gain in (k_v, k_omega, lookahead)):
        return "gains and look-ahead distance must be positive numbers"
    return _drive(k_v, k_omega, lookahead)[aspect]


check_tune = Check(
    _tune,
    "what is to be said",
    {
        "it comes home": (0,),
        "it never leaves the path by more than 6 cm": (1,),
        "it needs 40 s at most": (2,),
        "it turns at full rate for less than a third of the time": (3,),
        "it swings past no corner by more than 4 cm": (4,),
    },
    use=_aspect,
)
