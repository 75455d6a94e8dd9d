"""Checks of chapter 17: a constrained fit, a loop inside one cubic, gains for the way home.

P3 section 2 (two points), section 3 (closed form instead of boxes) and step 2.3 (return law).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Mistake, Property, Report, run_cases, run_checks
from slamlab.navigation import PathMemory, ReturnLaw, return_to_start
from slamlab.robots import Unicycle
from slamlab.sensors import VisualOdometer

__all__ = [
    "MISTAKES_FIT",
    "MISTAKES_LOOP",
    "MISTAKES_TUNE",
    "check_fit",
    "check_loop",
    "check_tune",
    "find_loop",
    "fit_between",
    "tune",
]

Function = Callable[..., Any]


# Exercise 1: a fit through two points.


def fit_between(t: Array, points: Array) -> Array:
    """Coefficients (4, 2), rows are powers of tau, of the cubic through first and last point."""
    tau = (t - t[0]) / (t[-1] - t[0])
    line = points[0] + tau[:, None] * (points[-1] - points[0])
    bulge = tau * (1 - tau)
    shapes = np.stack([bulge, tau * bulge], 1)
    alpha, beta = np.linalg.lstsq(shapes, points - line, rcond=None)[0]
    rows: Array = np.array([points[0], points[-1] - points[0] + alpha, beta - alpha, -beta])
    return rows


def _free(t: Array, points: Array) -> Array:
    tau = (t - t[0]) / (t[-1] - t[0])
    return np.linalg.lstsq(tau[:, None] ** np.arange(4), points, rcond=None)[0]


def _start_only(t: Array, points: Array) -> Array:
    tau = (t - t[0]) / (t[-1] - t[0])
    shapes = np.stack([tau, tau**2, tau**3], 1)
    return np.vstack([points[:1], np.linalg.lstsq(shapes, points - points[0], rcond=None)[0]])


def _divided(t: Array, points: Array) -> Array:
    tau = (t - t[0]) / (t[-1] - t[0])
    inner = slice(1, -1)
    line = points[0] + tau[:, None] * (points[-1] - points[0])
    due = (points - line)[inner] / (tau * (1 - tau))[inner, None]
    shapes = np.stack([np.ones(len(tau) - 2), tau[inner]], 1)
    alpha, beta = np.linalg.lstsq(shapes, due, rcond=None)[0]
    return np.stack([points[0], points[-1] - points[0] + alpha, beta - alpha, -beta])


def _one_shape(t: Array, points: Array) -> Array:
    tau = (t - t[0]) / (t[-1] - t[0])
    bulge = tau * (1 - tau)
    line = points[0] + tau[:, None] * (points[-1] - points[0])
    alpha = bulge @ (points - line) / (bulge @ bulge)
    return np.stack([points[0], points[-1] - points[0] + alpha, -alpha, np.zeros(2)])


def _in_powers_of_t(t: Array, points: Array) -> Array:
    return fit_between(t, points) / (t[-1] - t[0]) ** np.arange(4)[:, None]


MISTAKES_FIT: dict[str, Function] = {
    "no constraint: the curve must pass through the first and the last point": _free,
    "the end is not held: only the first point is on the curve": _start_only,
    "the equation was divided by tau (1 - tau): points near the ends count too much": _divided,
    "one shape only: tau (1 - tau) and tau^2 (1 - tau) are both free": _one_shape,
    "these are powers of t - t0: tau = (t - t0) / (t1 - t0)": _in_powers_of_t,
    "tau must grow with t, not with the number of the point": (
        lambda t, points: fit_between(np.arange(len(t), dtype=np.float64), points)
    ),
    "highest power first: row 0 is the constant": lambda t, points: fit_between(t, points)[::-1],
    "this is the transpose: rows are powers, columns x and y": (
        lambda t, points: fit_between(t, points).T
    ),
}


def check_fit(student: Function) -> Report:
    """Check ``student(t (n,), points (n, 2)) -> coefficients (4, 2)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    rng = np.random.default_rng(17)
    t = np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.8])
    bend = np.stack([t, t**2 - t**3], 1)
    cases = [
        ("a cubic is reproduced", t, bend),
        ("ends hold, the rest is least squares", t, bend + rng.normal(0, 0.02, bend.shape)),
        ("far from the start of the path", t + 30.0, bend + rng.normal(0, 0.02, bend.shape) + 9),
        ("many points", np.sort(rng.uniform(2, 5, 40)), rng.normal(0, 1, (40, 2))),
    ]
    return run_cases("fit_between", student, fit_between, cases, MISTAKES_FIT)


# Exercise 2: a loop inside one cubic.


def _sigma_and_w(c: Array) -> tuple[float, float]:
    """Solve a_1 + a_2 sigma + a_3 w = 0 and the same in y."""
    sigma, w = np.linalg.solve(c[2:4].T, -c[1])
    return float(sigma), float(w)


def _roots(c: Array, disc: float, sigma: float, check: bool = True) -> Array:
    root = np.sqrt(disc) if disc > 0 else np.nan
    both = np.array([0.5 * (sigma - root), 0.5 * (sigma + root)])
    inside = both[0] >= 0 and both[1] <= 1
    return both if inside or not check else np.full(2, np.nan)


def find_loop(c: Array) -> Any:
    """Parameters t_a < t_b in [0, 1] where a cubic meets itself; NaN twice if it does not."""
    sigma, w = _sigma_and_w(c)
    return _roots(c, 4 * w - 3 * sigma**2, sigma)


def _wrong_sign(c: Array) -> Array:
    sigma, w = np.linalg.solve(c[2:4].T, c[1])
    return _roots(c, 4 * w - 3 * sigma**2, sigma)


def _as_product(c: Array) -> Array:
    sigma, w = _sigma_and_w(c)
    return _roots(c, sigma**2 - 4 * w, sigma, check=False)


def _unhalved(c: Array) -> Array:
    return 2 * find_loop(c)


def _anywhere(c: Array) -> Array:
    sigma, w = _sigma_and_w(c)
    return _roots(c, 4 * w - 3 * sigma**2, sigma, check=False)


MISTAKES_LOOP: dict[str, Function] = {
    "the right side lost its minus: a_2 sigma + a_3 w = -a_1": _wrong_sign,
    "w is sigma^2 - t_a t_b, not the product: the root is of 4 w - 3 sigma^2": _as_product,
    "twice too large: t = (sigma -+ root) / 2": _unhalved,
    "a loop outside [0, 1] is no loop of this segment: return NaN twice": _anywhere,
    "t_a is the earlier of the two": lambda c: find_loop(c)[::-1],
    "these are sigma and w: the two parameters are due": lambda c: np.array(_sigma_and_w(c)),
    "t_a and t_b differ: this is twice their mean": (
        lambda c: np.full(2, 0.5 * _sigma_and_w(c)[0])
    ),
}


def _from_handles(handles: Any) -> Array:
    powers = [[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]
    return np.array(powers, float) @ np.array(handles, float)


def check_loop(student: Function) -> Report:
    """Check ``student(c (4, 2)) -> (t_a, t_b)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    loop = _from_handles([[0, 0], [3, 2], [-2, 2], [1, 0]])
    half = np.stack([loop[0], 0.5 * loop[1], 0.25 * loop[2], 0.125 * loop[3]])
    cases = [
        ("a loop that is the same from both sides", loop),
        ("another loop", _from_handles([[0, 0], [2.5, 2.4], [-1.6, 1.5], [1.2, 0.3]])),
        ("an arc without a loop", _from_handles([[0, 0], [1, 2], [2.2, 2], [3, 0.2]])),
        ("half of a loop: it does not close", half),
        ("an S has no loop", _from_handles([[0, 0], [1, 1], [2, -1], [3.3, 0.2]])),
    ]
    return run_cases("find_loop", student, find_loop, cases, MISTAKES_LOOP)


# Exercise 3: gains for the way home.

ASPECTS = (
    "it comes home",
    "it never leaves the path by more than 6 cm",
    "it needs 40 s at most",
    "it turns at full rate for less than a third of the time",
    "it swings past no corner by more than 4 cm",
)


def tune() -> tuple[float, float, float]:
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
def _drive(k_v: float, k_omega: float, lookahead: float) -> tuple[float, ...]:
    """One figure for each of the aspects: 1 where it holds; -1 for gains that are none."""
    if not (k_v > 0 and k_omega > 0 and lookahead > 0 and np.isfinite([k_v, k_omega]).all()):
        return (-1.0,) * len(ASPECTS)
    path, exact = _stairs(), VisualOdometer.simple(0.0, 0.0)
    law = ReturnLaw(k_v, k_omega, lookahead, max_speed=0.2, max_turn_rate=1.5)
    start = [*path.point_at(path.length), np.pi]
    rng = np.random.default_rng(0)
    home = return_to_start(path, start, law, Unicycle(), exact, rng, max_time=90.0)
    away = path.nearest(home.truth[:, :2])[1].max()
    full = np.mean(np.abs(home.controls[:, 1]) > 1.49)
    # The stairs lie between two lines through their corners, x - y = 0 and x - y = 0.5.
    band = (home.truth[:, 0] - home.truth[:, 1]) / np.sqrt(2)
    past = max(-band.min(), band.max() - 0.5 / np.sqrt(2))
    quick, calm = home.times[-1] <= 40.0, full < 1 / 3
    holds = (bool(home.arrived), away <= 0.06, quick, calm, past <= 0.04)
    return tuple(float(value) for value in holds)


def _aspect_of(gains: Function) -> Function:
    """Turn a function that returns gains into one that returns how they do in one aspect."""

    def judge(aspect: float) -> Any:
        given = gains()
        if given is None or given is Ellipsis:
            return given
        k_v, k_omega, lookahead = (float(value) for value in given)
        return _drive(k_v, k_omega, lookahead)[int(aspect)]

    return judge


MISTAKES_TUNE: dict[str, Function] = {
    "gains and look-ahead distance must be positive numbers": lambda: (1.0, -2.0, 0.15),
    "corners are cut: the look-ahead distance is too long, or k_omega too small": (
        lambda: (1.0, 2.0, 0.5)
    ),
    "too slow: v = k_v |P_f P_r|, and |P_f P_r| is about the look-ahead distance": (
        lambda: (0.3, 2.0, 0.15)
    ),
    "it shakes: k_omega is so large that the turn rate flies from limit to limit": (
        lambda: (1.0, 60.0, 0.15)
    ),
    "it turns too lazily and swings past the corners: k_omega is too small for the speed": (
        lambda: (1.0, 0.25, 0.15)
    ),
}


def check_tune(student: Function) -> Report:
    """Check ``student() -> (k_v, k_omega, lookahead)`` by driving home with it.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property. Any gains that drive well pass.
    """
    properties = [Property(name, (number,), 1.0) for number, name in enumerate(ASPECTS)]
    mistakes = [Mistake(text, _aspect_of(gains)) for text, gains in MISTAKES_TUNE.items()]
    return run_checks("tune", _aspect_of(student), properties, mistakes)
