"""Checks of chapter 17: a constrained fit, a loop, the law and its gains, a memory driven home.

P3 section 2 (two points), section 3 (closed form instead of boxes) and step 2.3 (return law).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from slamlab.exercises._draw import a_pose, drawn
from slamlab.exercises._report import Array, Check, Function
from slamlab.geometry import wrap_angle
from slamlab.localization import DeadReckoning
from slamlab.navigation import PathFollower, PathMemory, ReturnLaw
from slamlab.robots import RelativePose, Unicycle
from slamlab.sensors import VisualOdometer
from slamlab.simulation import record

__all__ = ["check_fit", "check_loop", "check_remember", "check_steer", "check_tune"]


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


@drawn
def _path(rng: np.random.Generator, n: int) -> Any:
    t = np.cumsum(np.round(rng.uniform(0.1, 1, n), 2)) + np.round(rng.uniform(-9, 9), 1)
    return t, np.round(rng.normal(0, 1, (n, 2)), 2) + np.round(rng.normal(0, 9, 2), 1)


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
            "np.stack([bulge, tau * bulge], 1) => np.stack([bulge, 0 * bulge], 1)"
        ),
        "the sign of beta was lost in multiplying out: tau^2 (1 - tau) has -tau^3": (
            "-beta]) => beta])"
        ),
        "the sign of alpha was lost in multiplying out: tau (1 - tau) has -tau^2": (
            "beta - alpha => beta + alpha"
        ),
        "these are powers of t - t0: tau = (t - t0) / (t1 - t0)": (
            lambda t, points: _fit_between(t, points) / (t[-1] - t[0]) ** np.arange(4)[:, None]
        ),
        "tau must grow with t, not with the number of the point": (
            "tau = (t - t[0]) / (t[-1] - t[0]) => tau = np.linspace(0, 1, len(t))"
        ),
        "highest power first: row 0 is the constant": (
            lambda t, points: _fit_between(t, points)[::-1]
        ),
        "this is the transpose: rows are powers, columns x and y": (
            lambda t, points: _fit_between(t, points).T
        ),
        "the line alone came: the bulges are missing": (
            "np.linalg.lstsq(shapes, points - line, rcond=None)[0] => np.zeros((2, 2))"
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


@drawn
def _with_loop(rng: np.random.Generator, t_a: float, t_b: float) -> Any:
    """Draw cubics that meet themselves at t_a and t_b."""
    high = np.round(rng.normal(0, 3, (2, 2)), 1) + 6 * np.eye(2)
    high[:, 1] *= rng.choice([-1, 1])  # loops that turn left, and right
    sigma, w = t_a + t_b, (t_a + t_b) ** 2 - t_a * t_b
    return (np.array([rng.normal(size=2), -high[0] * sigma - high[1] * w, *high]),)


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
        "the right side lost its minus: a_2 sigma + a_3 w = -a_1": "-c[1] => c[1]",
        "no loop was found at all: w is sigma^2 - t_a t_b, the root is of 4 w - 3 sigma^2": (
            "np.sqrt(4 * w - 3 * sigma**2) if 4 * w > 3 * sigma**2"
            " => np.sqrt(sigma**2 - 4 * w) if sigma**2 > 4 * w"
        ),
        "twice too large: t = (sigma -+ root) / 2": (
            "0.5 * (sigma - root), 0.5 * (sigma + root) => sigma - root, sigma + root",
            "t_a >= 0 and t_b <= 1 => t_a >= 0 and t_b <= 2",
        ),
        "a loop outside [0, 1] is no loop of this segment: return NaN twice": (
            "t_a >= 0 and t_b <= 1 => True"
        ),
        "a loop that begins before the segment does not close in it: t_a must not be negative": (
            "t_a >= 0 and t_b <= 1 => t_b <= 1"
        ),
        "a loop that ends after the segment does not close in it: t_b is at most 1": (
            "t_a >= 0 and t_b <= 1 => t_a >= 0"
        ),
        "t_a is the earlier of the two": lambda c: _find_loop(c)[::-1],
        "these are sigma and w: the two parameters are due": (
            lambda c: np.linalg.solve(c[2:].T, -c[1])
        ),
        "t_a and t_b differ: this is their mean twice": (
            "0.5 * (sigma - root), 0.5 * (sigma + root) => 0.5 * sigma, 0.5 * sigma"
        ),
    },
    tolerance=1e-7,
    edges=("a straight line", "a parabola"),
)


# Exercise 3: a bug to find.


def _steer(pose: Array, point: Array, gains: Array, limits: Array) -> tuple[float, float]:
    """Speed and turn rate of P3's step 2.3 towards a point; gains and limits for v and omega."""
    dx, dy = point - pose[:2]
    alpha = wrap_angle(np.arctan2(dy, dx) - pose[2])
    v = min(gains[0] * np.hypot(dx, dy), limits[0])
    omega = min(max(gains[1] * alpha, -limits[1]), limits[1])
    return float(v), float(omega)


@drawn
def _aim(
    rng: np.random.Generator, behind: float | None = None, limits: tuple[float, float] = (0.2, 1.5)
) -> Any:
    pose = a_pose(rng)
    if behind is not None:
        pose[2] = rng.choice([-1, 1]) * behind
    alpha = rng.uniform(-0.5, 0.5) if behind is not None else rng.uniform(-3, 3)
    way = float(np.round(rng.uniform(0.05, 0.4), 2))
    point = pose[:2] + way * np.array([np.cos(pose[2] + alpha), np.sin(pose[2] + alpha)])
    return pose, np.round(point, 3), np.round(rng.uniform(0.6, 3.0, 2), 2), limits


check_steer = Check(
    _steer,
    "v, omega",
    {
        "a point straight ahead": ([0, 0, 0], [0.1, 0.0], [1.0, 2.0], [0.2, 1.5]),
        "to the left, to the right": lambda rng: (
            [1.0, 1.0, 0.3],
            [1.1, 1.03 + rng.choice([-0.05, 0.05])],
            [1.0, 2.0],
            [0.2, 1.5],
        ),
        "far away: both limits hold": lambda rng: (
            [0, 0, rng.choice([-1.5, 1.5])],
            [2.0, 0.0],
            [1.0, 2.0],
            [0.2, 1.5],
        ),
        "a robot that looks to the west": _aim(behind=3.0),
        "almost half a turn is due": ([0, 0, 0.0], [-0.1, 0.001], [1.0, 0.3], [0.2, 1.5]),
        "limits that never hold": _aim(limits=(9.0, 99.0)),
        "any point": _aim(),
    },
    {
        "the angle is not wrapped: a robot that looks to the west turns the long way round": (
            "wrap_angle(np.arctan2(dy, dx) - pose[2]) => np.arctan2(dy, dx) - pose[2]"
        ),
        "the turn rate was limited to the left only: a turn to the right has a limit too": (
            "min(max(gains[1] * alpha, -limits[1]), limits[1]) => min(gains[1] * alpha, limits[1])"
        ),
        "the turn rate was limited to the right only: a turn to the left has a limit too": (
            "min(max(gains[1] * alpha, -limits[1]), limits[1])"
            " => max(gains[1] * alpha, -limits[1])"
        ),
        "the turn rate was not limited": (
            "min(max(gains[1] * alpha, -limits[1]), limits[1]) => gains[1] * alpha"
        ),
        "the speed was not limited": (
            "min(gains[0] * np.hypot(dx, dy), limits[0]) => gains[0] * np.hypot(dx, dy)"
        ),
        "the robot turns away from the point: alpha is the direction less the heading": (
            "wrap_angle(np.arctan2(dy, dx) - pose[2]) => -wrap_angle(np.arctan2(dy, dx) - pose[2])"
        ),
        "the heading is missing: alpha is seen from the front of the robot": (
            "wrap_angle(np.arctan2(dy, dx) - pose[2]) => np.arctan2(dy, dx)"
        ),
        "the arctangent takes y first, then x": "np.arctan2(dy, dx) => np.arctan2(dx, dy)",
        "the arctangent of dy / dx forgets on which side the point lies: arctan2(dy, dx)": (
            "np.arctan2(dy, dx) => np.arctan(dy / dx)"
        ),
        "the gains are exchanged: the first is that of the speed": (
            lambda pose, point, gains, limits: _steer(pose, point, gains[::-1], limits)
        ),
        "the limits are exchanged: the first is that of the speed": (
            lambda pose, point, gains, limits: _steer(pose, point, gains, limits[::-1])
        ),
        "the distance along x alone was taken": "np.hypot(dx, dy) => abs(dx)",
        "the angle is limited, not the rate: multiply by the gain first": (
            "min(max(gains[1] * alpha, -limits[1]), limits[1])"
            " => gains[1] * min(max(alpha, -limits[1]), limits[1])"
        ),
    },
)


# Exercise 4: gains for the way home.


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
    pilot, belief = PathFollower(path, law), DeadReckoning(RelativePose(), start)
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
    try:
        k_v, k_omega, lookahead = map(float, given)
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


# Exercise 5: a memory assembled, and driven home.


def _remember(points: Array, tolerance: float) -> Array:
    """Cubics (m, 4, 2) that pass every point (n, 2) of a way within a tolerance (m).

    Each is as long as it can be: it ends at the last point with which all points between its
    ends still lie within the tolerance. The next begins where it ends.
    """
    t = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    first, cubics = 0, []
    while first < len(points) - 1:
        last = first + 1
        while last < len(points) - 1:
            if _gaps(t[first : last + 2], points[first : last + 2]).max() > tolerance:
                break
            last += 1
        cubics.append(_fit_between(t[first : last + 1], points[first : last + 1]))
        first = last
    return np.array(cubics)


def _misses(t: Array, points: Array) -> Any:
    tau = (t - t[0]) / (t[-1] - t[0])
    return tau[:, None] ** np.arange(4) @ _fit_between(t, points) - points


def _gaps(t: Array, points: Array) -> Any:
    """Distances (n,) of points from the cubic that is fitted to them."""
    return np.hypot(*_misses(t, points).T)


def _point_to_point(points: Array, tolerance: float) -> Any:
    pairs = zip(points[:-1], points[1:], strict=True)
    return np.array([_fit_between(np.arange(2.0), np.array(pair)) for pair in pairs])


@drawn
def _walk(rng: np.random.Generator, n: int, tolerance: float) -> Any:
    heading = np.cumsum(rng.normal(0, 0.5, n))
    hops = rng.uniform(0.05, 0.4, n)[:, None]
    return np.cumsum(hops * np.stack([np.cos(heading), np.sin(heading)], 1), 0), tolerance


def _way_out() -> Array:
    """Points (1, n, 2) that a camera would note on a way of four metres, off by millimetres."""
    s = np.linspace(0, 1, 121)
    way = np.stack([2.4 * s, 0.9 * np.sin(6.0 * s) + 0.4 * s**2], 1)
    return np.round(way + np.random.default_rng(7).normal(0, 0.004, way.shape), 4)[None]


def _home_along(cubics: Any, points: Array) -> str:
    """Drive home along cubics, from the last point to the first; say what is wrong."""
    c = np.asarray(cubics, dtype=float)
    if c.ndim != 3 or c.shape[1:] != (4, 2):
        return f"an array of shape (m, 4, 2) is due, one of shape {c.shape} came"
    tau = np.linspace(0, 1, 40)[:, None] ** np.arange(4)
    path = (tau @ c).reshape(-1, 2)
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))
    pose, at, away = np.append(path[-1], np.pi), len(path) - 1, 0.0
    for _ in range(800):
        at = int(np.argmin(np.hypot(*(path[: at + 1] - pose[:2]).T)))
        ahead = path[int(np.argmin(np.abs(along[: at + 1] - along[at] + 0.15)))]
        v, omega = _steer(pose, ahead, np.array([1.0, 2.0]), np.array([0.2, 1.5]))
        half = pose[2] + 0.05 * omega
        pose = pose + 0.1 * np.array([v * np.cos(half), v * np.sin(half), omega])
        away = max(away, float(np.hypot(*(points - pose[:2]).T).min()))
    off = float(np.hypot(*(pose[:2] - points[0])))
    if not off <= 0.05:
        return f"the robot comes to rest {off:.2f} m from home, 0.05 m are allowed"
    if away > 0.08:
        return f"the robot drives {100 * away:.0f} cm from its way out, 8 are allowed"
    if len(c) > 6:
        return f"{len(c)} cubics are no saving for {len(points)} points, six are allowed"
    return ""


def _memory_of(remember: Function, points: Array, tolerance: float) -> Any:
    """Return the cubics, or, for the way out, what its way home says."""
    if points.ndim == 2:
        return remember(points, tolerance)
    return _home_along(remember(points[0], tolerance), points[0])


check_remember = Check(
    _remember,
    "cubics",
    {
        "two points make one cubic": ([[0.0, 0.0], [1.0, 2.0]], 0.05),
        "a straight way needs one, even without tolerance": (
            [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]],
            0.0,
        ),
        "no tolerance: a cubic passes four points, not five": lambda rng: (
            _walk(7, 1e-6)(rng)[0],
            1e-6,
        ),
        "a corner": ([[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [3, 2], [3, 3.0]], 0.05),
        "a short way": _walk(8, 0.02),
        "a long way": _walk(40, 0.05),
        "out, and home along the memory": (_way_out(), 0.03),
    },
    {
        "the last cubic is missing: what is open at the end of the way is stored too": (
            lambda points, tolerance: _remember(points, tolerance)[:-1]
        ),
        "the cubic that left the tolerance was stored: the one before it is due": (
            "_fit_between(t[first : last + 1], points[first : last + 1])"
            " => _fit_between(t[first : last + 2], points[first : last + 2])"
        ),
        "the next cubic begins one point too late: it begins where the last one ends": (
            "first = last => first = last + 1"
        ),
        "only the newest point was tested: a longer cubic moves away from the old ones too": (
            ".max() > tolerance => [-2] > tolerance"
        ),
        "the mean distance was tested: every point must lie within the tolerance": (
            ".max() > tolerance => .mean() > tolerance"
        ),
        "squared distances were compared with the tolerance": (
            ".max() > tolerance => .max() ** 2 > tolerance"
        ),
        "x and y were tested one by one: the distance in the plane counts": (
            "_gaps(t[first : last + 2], points[first : last + 2])"
            " => np.abs(_misses(t[first : last + 2], points[first : last + 2]))"
        ),
        "the parameter is the number of the point: let it grow with the way": (
            "np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))"
            " => 1.0 * np.arange(len(points))"
        ),
        "one cubic for the whole way: begin a new one where the tolerance is left": (
            lambda points, tolerance: _remember(points, np.inf)
        ),
        "a cubic from point to point: it should be as long as the tolerance allows": (
            _point_to_point
        ),
        "the cubics came in the wrong order: the first begins at the first point": (
            lambda points, tolerance: _remember(points, tolerance)[::-1]
        ),
        "exactly at the tolerance is still within": "> tolerance => >= tolerance",
    },
    tolerance=1e-6,
    use=_memory_of,
)
