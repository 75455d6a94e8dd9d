"""Exercises, chapter 17: a constrained fit, a loop, the law and its gains, a memory driven home.

P3 section 2 (two points), section 3 (closed form instead of boxes) and step 2.3 (return law).
"""

# mypy: disable-error-code="no-untyped-def"
# A solution is written as a student writes it, without types inside.

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


# %% [markdown] tags=["chapter"]
# # Exercises 17: the way home
#
# A fit under constraints, a loop in closed form, a bug in the law that drives home, its gains,
# and a memory that you assemble and that brings a robot home; the chapter is [The way
# home](../17_the_way_home.ipynb). Replace each `...` and run the check below it as often as you
# like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 17: the way home
#
# The exercises are in [Exercises 17](../exercises/17_the_way_home.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: a cubic through two points
#
# Derive it first. In $\tau = (t - t_0)/(t_1 - t_0)$ the line from the first point to the last
# meets both constraints. Which cubics are zero at $\tau = 0$ and at $\tau = 1$? Add them with
# free factors, and fit the factors by least squares.


# %% tags=["exercise"]
def fit_between(t: Array, points: Array) -> Array:
    """Least-squares cubic through the first and the last point.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Parameters of the points, increasing.
    points : ndarray, shape (n, 2)
        Points of the plane (m).

    Returns
    -------
    ndarray, shape (4, 2)
        Coefficients; row m belongs to tau^m, columns are x and y.
    """
    tau = (t - t[0]) / (t[-1] - t[0])
    line = points[0] + tau[:, None] * (points[-1] - points[0])
    bulge = tau * (1 - tau)
    shapes = np.stack([bulge, tau * bulge], 1)
    lam, mu = np.linalg.lstsq(shapes, points - line, rcond=None)[0]
    return np.stack([points[0], points[-1] - points[0] + lam, mu - lam, -mu])


# %% active="ipynb" tags=["try"]
# points = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 1.5], [4.0, 0.0]])
# fit_between(np.array([0.0, 1.0, 2.0, 4.0]), points)

# %% [markdown] tags=["hint"]
# A cubic that is zero at 0 and at 1 has the factor $\tau(1 - \tau)$. What is left over is linear.

# %% [markdown] tags=["hint"]
# Subtract the line from the points. What remains is $\tau(1-\tau)(\lambda + \mu\tau)$ plus
# noise: two unknowns for each coordinate, one `np.linalg.lstsq` for both.

# %% [markdown] tags=["hint"]
# Multiply out: $\tau(1-\tau)(\lambda + \mu\tau) = \lambda\tau + (\mu - \lambda)\tau^2 -
# \mu\tau^3$.


# %% tags=["cases"]
@drawn
def _path(rng: np.random.Generator, n: int) -> Any:
    t = np.cumsum(np.round(rng.uniform(0.1, 1, n), 2)) + np.round(rng.uniform(-9, 9), 1)
    return t, np.round(rng.normal(0, 1, (n, 2)), 2) + np.round(rng.normal(0, 9, 2), 1)


_T = np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.8])


def _curve(coefficients: Any, tau: Any) -> Array:
    """Points of a cubic of the plane at these parameters."""
    return np.asarray(tau, float)[..., None] ** np.arange(4) @ np.asarray(coefficients, float)


def _fit_drawn(ax: Any, function: Any) -> None:
    """Draw sixteen noisy points of a way and the cubic through the first and the last of them."""
    from slamlab import plots

    s, rng = np.linspace(0, 1, 16), np.random.default_rng(1)
    points = np.column_stack([3 * s, np.sin(5 * s) + s]) + rng.normal(0, 0.06, (16, 2))
    t = 2.0 + 4.0 * s
    plots.lidar_points(ax, points, s=4)
    ax.plot(*points[[0, -1]].T, "o", color=plots.COLOURS["truth"], mfc="none", markersize=9)
    plots.path(ax, _curve(function(t, points), np.linspace(0, 1, 100)))
    plots.floor(ax)


check_fit = Check(
    fit_between,
    "coefficients",
    {
        "a cubic is reproduced": (_T, np.stack([_T, _T**2 - _T**3], 1)),
        "four points: the curve meets all": _path(4),
        "ends hold, the rest is least squares": _path(7),
        "many points": _path(40),
    },
    tolerance=1e-7,
    picture=_fit_drawn,
)


# %% tags=["mistakes"]
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
    lam, mu = np.linalg.lstsq(shapes, due, rcond=None)[0]
    return np.stack([points[0], points[-1] - points[0] + lam, mu - lam, -mu])


check_fit.mistakes = {
    "no constraint: the curve must pass through the first and the last point": _free,
    "a free fit was bent to its ends afterwards: that is not the best curve through them": (
        _straightened
    ),
    "the end is not held: only the first point is on the curve": _start_only,
    "the equation was divided by tau (1 - tau): points near the ends count too much": (_divided),
    "one shape only: tau (1 - tau) and tau^2 (1 - tau) are both free": (
        "np.stack([bulge, tau * bulge], 1) => np.stack([bulge, 0 * bulge], 1)"
    ),
    "the sign of mu was lost in multiplying out: tau^2 (1 - tau) has -tau^3": ("-mu]) => mu])"),
    "the sign of lambda was lost in multiplying out: tau (1 - tau) has -tau^2": (
        "mu - lam => mu + lam"
    ),
    "these are powers of t - t0: tau = (t - t0) / (t1 - t0)": (
        lambda t, points: fit_between(t, points) / (t[-1] - t[0]) ** np.arange(4)[:, None]
    ),
    "tau must grow with t, not with the number of the point": (
        "tau = (t - t[0]) / (t[-1] - t[0]) => tau = np.linspace(0, 1, len(t))"
    ),
    "highest power first: row 0 is the constant": (lambda t, points: fit_between(t, points)[::-1]),
    "this is the transpose: rows are powers, columns x and y": (
        lambda t, points: fit_between(t, points).T
    ),
    "the line alone was returned: the bulges are missing": (
        "np.linalg.lstsq(shapes, points - line, rcond=None)[0] => np.zeros((2, 2))"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: a cubic through two points
#
# The line meets both constraints, and everything that may be added to it has the factor $\tau(1 -
# \tau)$. So there are two free factors, $\lambda$ and $\mu$, and the residual is the true one:
# nothing was multiplied or divided.

# %% [markdown] tags=["solution"]
# It is tempting to divide by $\tau(1 - \tau)$, so that only $\lambda + \mu\tau$ is left to fit.
# The constraints still hold, and cubic data are still reproduced. But the residual of a point
# near an end has been divided by almost nothing, and its noise rules the fit:

# %% active="ipynb" tags=["solution"]
# def divided(t, points):
#     tau = (t - t[0]) / (t[-1] - t[0])
#     line = points[0] + tau[:, None] * (points[-1] - points[0])
#     due = (points - line)[1:-1] / (tau * (1 - tau))[1:-1, None]
#     A = np.stack([np.ones(len(due)), tau[1:-1]], 1)
#     lam, mu = np.linalg.lstsq(A, due, rcond=None)[0]
#     return np.stack([points[0], points[-1] - points[0] + lam, mu - lam, -mu])
#
# check_fit(divided)

# %% [markdown] tags=["statement"]
# ## Exercise 2: where does a cubic meet itself?
#
# With $\sigma = t_a + t_b$ and $w = \sigma^2 - t_a t_b$ the conditions $x(t_a) = x(t_b)$ and
# $y(t_a) = y(t_b)$ are two linear equations.


# %% tags=["exercise"]
def find_loop(c: Array) -> tuple[float, float]:
    """Parameters at which a cubic crosses itself.

    Parameters
    ----------
    c : ndarray, shape (4, 2)
        Coefficients; row m belongs to t^m, columns are x and y. The segment is
        0 <= t <= 1.

    Returns
    -------
    tuple of two floats
        t_a < t_b, both in [0, 1]; (nan, nan) if the segment has no loop,
        as a straight line has none.
    """
    if abs(np.linalg.det(c[2:])) < 1e-12:  # a line or a parabola
        return np.nan, np.nan
    sigma, w = np.linalg.solve(c[2:].T, -c[1])
    disc = 4 * w - 3 * sigma**2
    if disc <= 0:
        return np.nan, np.nan
    t_a, t_b = 0.5 * (sigma - np.sqrt(disc)), 0.5 * (sigma + np.sqrt(disc))
    return (t_a, t_b) if t_a >= 0 and t_b <= 1 else (np.nan, np.nan)


# %% active="ipynb" tags=["try"]
# find_loop(np.array([[0, 0], [9, 6], [-24, -6], [16, 0.0]]))

# %% [markdown] tags=["hint"]
# $x(t_b) - x(t_a)$, divided by $t_b - t_a$, is $a_1 + a_2 (t_a + t_b) + a_3 (t_a^2 + t_a t_b +
# t_b^2)$. How is the last bracket written in $\sigma$ and $t_a t_b$?

# %% [markdown] tags=["hint"]
# `sigma, w = np.linalg.solve(c[2:].T, -c[1])`. Then $t_a$ and $t_b$ are the roots of $t^2 -
# \sigma t + (\sigma^2 - w) = 0$.

# %% [markdown] tags=["hint"]
# The discriminant is $\sigma^2 - 4(\sigma^2 - w) = 4w - 3\sigma^2$. Not positive: no loop. One of
# the roots outside $[0, 1]$: no loop of this segment.


# %% tags=["cases"]
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


def _loop_drawn(ax: Any, function: Any) -> None:
    """Draw four cubics, and a ring at both parameters at which each crosses itself."""
    from slamlab import plots

    cubics = (
        _handles([[0, 0], [3, 2], [-2, 2], [1, 0]]),
        _handles([[1.5, 0], [4.0, 2.4], [-0.1, 1.5], [2.7, 0.3]]),
        _handles([[0, -2.2], [0.6, -1], [1.2, -1], [1.6, -2.2]]),
        _handles([[2, -2], [2.6, -0.6], [3, -2.8], [3.4, -1.2]]),
    )
    for c in cubics:
        plots.path(ax, _curve(c, np.linspace(0, 1, 80)), "truth")
        t_a, t_b = (float(one) for one in function(c))
        for t, size in ((t_a, 6), (t_b, 11)):
            place = _curve(c, t)
            ax.plot(*place, "o", color=plots.COLOURS["estimate"], markersize=size, mfc="none")
    plots.floor(ax)


check_loop = Check(
    find_loop,
    "t_a, t_b",
    {
        "a loop that is the same from both sides": (_handles([[0, 0], [3, 2], [-2, 2], [1, 0]]),),
        "another loop": (_handles([[0, 0], [2.5, 2.4], [-1.6, 1.5], [1.2, 0.3]]),),
        "an arc without a loop": (_handles([[0, 0], [1, 2], [2.2, 2], [3, 0.2]]),),
        "an S has no loop": (_handles([[0, 0], [1, 1], [2, -1], [3.3, 0.2]]),),
        "loops of any size": lambda rng: _with_loop(rng.uniform(0, 0.4), rng.uniform(0.5, 1))(rng),
        "almost a loop: the legs do not meet": ([[0, 0], [-0.2, -7.4], [3, 6], [-4, 2]],),
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
    tolerance=1e-7,
    edges=("a straight line", "a parabola"),
    picture=_loop_drawn,
)

# %% tags=["mistakes"]
check_loop.mistakes = {
    "the right side lost its minus: a_2 sigma + a_3 w = -a_1": "-c[1] => c[1]",
    "no loop was found at all: one row for x and one for y, and the root of 4 w - 3 sigma^2": (
        "disc = 4 * w - 3 * sigma**2 => disc = sigma**2 - 4 * w"
    ),
    "twice too large: t = (sigma -+ root) / 2": (
        (
            "0.5 * (sigma - np.sqrt(disc)), 0.5 * (sigma + np.sqrt(disc))"
            " => sigma - np.sqrt(disc), sigma + np.sqrt(disc)"
        ),
        ("t_b <= 1 => t_b <= 2"),
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
    "t_a is the earlier of the two": lambda c: find_loop(c)[::-1],
    "these are sigma and w: expected the two parameters": (
        lambda c: np.linalg.solve(c[2:].T, -c[1])
    ),
    "t_a and t_b differ: this is their mean twice": (
        "0.5 * (sigma - np.sqrt(disc)), 0.5 * (sigma + np.sqrt(disc)) => 0.5 * sigma, 0.5 * sigma"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: where does a cubic meet itself?

# %% [markdown] tags=["solution"]
# The formula knows nothing of the segment's ends. Without the last line half a loop, which does
# not close, is reported as one, and the memory would cut out a piece of path that is no loop:

# %% active="ipynb" tags=["solution"]
# def anywhere(c):
#     sigma, w = np.linalg.solve(c[2:].T, -c[1])
#     root = np.sqrt(4 * w - 3 * sigma**2) if 4 * w > 3 * sigma**2 else np.nan
#     return 0.5 * (sigma - root), 0.5 * (sigma + root)
#
# check_loop(anywhere)

# %% [markdown] tags=["statement"]
# ## Exercise 3: a bug to find
#
# Step 2.3 of P3: the robot drives towards a point $P_f$ with $v = k_v |P_f P_r|$ and $\omega =
# k_\omega \alpha$, where $\alpha$ is the direction to $P_f$ seen from its front; both have
# limits. This version has brought robots home from the west of their start, again and again. From
# the east one of them drove circles.


# %% tags=["exercise"]
def steer(pose: Array, point: Array, gains: Array, limits: Array) -> tuple[float, float]:
    """Control that drives towards a point.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        Place (m) and heading (rad) of the robot.
    point : ndarray, shape (2,)
        Where it is to drive (m).
    gains : ndarray, shape (2,)
        k_v and k_omega (1/s).
    limits : ndarray, shape (2,)
        Largest speed (m/s) and largest turn rate (rad/s), to either side.

    Returns
    -------
    v, omega : float
    """
    dx, dy = point - pose[:2]
    alpha = wrap_angle(np.arctan2(dy, dx) - pose[2])
    v = min(gains[0] * np.hypot(dx, dy), limits[0])
    omega = min(max(gains[1] * alpha, -limits[1]), limits[1])
    return v, omega


# %% active="ipynb" tags=["stub"]
#     dx, dy = point - pose[:2]
#     alpha = np.arctan2(dy, dx) - pose[2]
#     v = min(gains[0] * np.hypot(dx, dy), limits[0])
#     omega = min(max(gains[1] * alpha, -limits[1]), limits[1])
#     return v, omega

# %% active="ipynb" tags=["try"]
# steer(np.array([1.0, 0.0, 3.1]), np.array([0.9, -0.01]), np.array([1.0, 2.0]),
#       np.array([0.2, 1.5]))

# %% [markdown] tags=["hint"]
# In the call above the robot looks almost to the west, and the point lies ahead of it, a little
# to its left. Which turn rate came?

# %% [markdown] tags=["hint"]
# Print `alpha`. By how much is it off? In which range must an angle be before it is multiplied by
# a gain?


# %% tags=["cases"]
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


def _steer_drawn(ax: Any, function: Any) -> None:
    """Draw five robots on their way to the origin, three of them from the east."""
    from slamlab import plots

    gains, limits = np.array([1.0, 2.0]), np.array([0.2, 1.5])
    starts = [[1.2, 0.5, 2.0], [1.3, 0.0, -1.9], [1.1, -0.6, 3.0], [-1.2, 0.5, 1.0], [-1, -0.5, 0]]
    for pose in np.array(starts, float):
        path = [pose]
        while len(path) < 200 and np.hypot(*pose[:2]) > 0.03:
            v, omega = (float(one) for one in function(pose, np.zeros(2), gains, limits))
            half = pose[2] + 0.05 * omega
            pose = pose + 0.1 * np.array([v * np.cos(half), v * np.sin(half), omega])
            pose[2] = (pose[2] + np.pi) % (2 * np.pi) - np.pi
            path.append(pose)
        plots.path(ax, np.array(path))
        ax.plot(*path[0][:2], "o", color=plots.COLOURS["estimate"], markersize=5)
    ax.plot(0, 0, "*", color=plots.COLOURS["truth"], markersize=11, mfc="none")
    plots.floor(ax)


check_steer = Check(
    steer,
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
        "almost half a turn": ([0, 0, 0.0], [-0.1, 0.001], [1.0, 0.3], [0.2, 1.5]),
        "limits that never hold": _aim(limits=(9.0, 99.0)),
        "any point": _aim(limits=(0.25, 1.2)),
    },
    picture=_steer_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_steer.mistakes = {
    "the angle is not wrapped: a robot that looks to the west turns the long way round": (
        "wrap_angle(np.arctan2(dy, dx) - pose[2]) => np.arctan2(dy, dx) - pose[2]"
    ),
    "the turn rate was limited to the left only: a turn to the right has a limit too": (
        "min(max(gains[1] * alpha, -limits[1]), limits[1]) => min(gains[1] * alpha, limits[1])"
    ),
    "the turn rate was limited to the right only: a turn to the left has a limit too": (
        "min(max(gains[1] * alpha, -limits[1]), limits[1]) => max(gains[1] * alpha, -limits[1])"
    ),
    "neither speed nor turn rate was limited": (
        "min(gains[0] * np.hypot(dx, dy), limits[0]) => gains[0] * np.hypot(dx, dy)",
        "min(max(gains[1] * alpha, -limits[1]), limits[1]) => gains[1] * alpha",
    ),
    "wrapped into [0, 2 pi): a point to the right becomes nearly a full turn to the left": (
        "wrap_angle(np.arctan2(dy, dx) - pose[2]) => (np.arctan2(dy, dx) - pose[2]) % (2 * np.pi)"
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
        lambda pose, point, gains, limits: steer(pose, point, gains[::-1], limits)
    ),
    "the limits are exchanged: the first is that of the speed": (
        lambda pose, point, gains, limits: steer(pose, point, gains, limits[::-1])
    ),
    "the distance along x alone was taken": "np.hypot(dx, dy) => abs(dx)",
    "the angle is limited, not the rate: multiply by the gain first": (
        "min(max(gains[1] * alpha, -limits[1]), limits[1])"
        " => gains[1] * min(max(alpha, -limits[1]), limits[1])"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a bug to find
#
# The difference of two directions may be anything between $-2\pi$ and $2\pi$. A robot on its way
# home from the east looks to the west, where headings jump from $\pi$ to $-\pi$: the point lies
# 0.14 rad to its left, the difference says 6.14 rad to the right, and the turn rate goes to its
# limit, the wrong way round.

# %% [markdown] tags=["solution"]
# Limits hide such a bug: a turn rate of 1.5 looks alike whether the angle is 3 or 6. Taken off on
# one side only they are a bug of their own, which shows to the right and never to the left:

# %% active="ipynb" tags=["solution"]
# def one_sided(pose, point, gains, limits):
#     v, _ = steer(pose, point, gains, limits)
#     dx, dy = point - pose[:2]
#     return v, min(gains[1] * wrap_angle(np.arctan2(dy, dx) - pose[2]), limits[1])
#
# check_steer(one_sided)

# %% [markdown] tags=["statement"]
# ## Exercise 4: bring it home
#
# P3's law drives with $v = k_v |P_f P_r|$ and $\omega = k_\omega \alpha$ towards a point $P_f$
# that lies `lookahead` ahead. The speed is limited to 0.2 m/s, the turn rate to 1.5 rad/s. On the
# floor the path has the shape of stairs: legs of 0.5 m and right angles. The check drives home
# with your gains and says what it does not like; many gains are right.


# %% tags=["exercise"]
def tune() -> tuple[float, float, float]:
    """Gains for the way home.

    Returns
    -------
    tuple of three floats
        k_v (1/s), k_omega (1/s) and the look-ahead distance (m).
    """
    return 1.0, 2.0, 0.15


# %% active="ipynb" tags=["try"]
# tune()

# %% [markdown] tags=["hint"]
# Where the path is straight $|P_f P_r|$ is the look-ahead distance. Which $k_v$ then gives the
# full speed, or nearly?

# %% [markdown] tags=["hint"]
# At a right angle the robot begins to turn when $P_f$ has gone round the corner, a look-ahead
# distance early. Six centimetres off a corner of 90° allow about 0.2 m.

# %% [markdown] tags=["hint"]
# $1/k_\omega$ is the time in which the robot turns to $P_f$. In that time it should not drive
# much farther than the look-ahead distance; and $k_\omega \Delta t$ with $\Delta t$ = 0.1 s
# should stay well below 1.


# %% tags=["cases"]
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
def _homeward(k_v: float, k_omega: float, lookahead: float) -> Any:
    """Drive down the stairs: whether the robot has arrived, and the log."""
    path, exact = _stairs(), VisualOdometer.simple(0.0, 0.0)
    law = ReturnLaw(k_v, k_omega, lookahead, max_speed=0.2, max_turn_rate=1.5)
    start = [*path.point_at(path.length), np.pi]
    pilot, belief = PathFollower(path, law), DeadReckoning(RelativePose(), start)
    rng = np.random.default_rng(0)
    home = record(
        None, Unicycle(), None, pilot, belief, rng, start=start, odometer=exact, max_time=90.0
    )
    return pilot.arrived, home


def _drive(k_v: float, k_omega: float, lookahead: float) -> tuple[str, ...]:
    """Say what is wrong with each aspect of the way home: nothing where it is well."""
    path, (arrived, home) = _stairs(), _homeward(k_v, k_omega, lookahead)
    truth = home.notes["believed"]  # the odometer is exact
    away = path.nearest(truth[:, :2])[1].max()
    full = np.mean(np.abs(home.notes["command"][1:, 1]) > 1.49)
    # The stairs lie between two lines through their corners, x - y = 0 and x - y = 0.5.
    band = (truth[:, 0] - truth[:, 1]) / np.sqrt(2)
    past = max(-band.min(), band.max() - 0.5 / np.sqrt(2))
    seconds = home.times[-1]
    left = f"it leaves the path by {100 * away:.0f} cm, 6 are allowed: "
    return (
        "" if arrived else "it does not come home within 90 s",
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
        return "expected three numbers: k_v, k_omega and the look-ahead distance"
    if not all(np.isfinite(gain) and gain > 0 for gain in (k_v, k_omega, lookahead)):
        return "gains and look-ahead distance must be positive numbers"
    return _drive(k_v, k_omega, lookahead)[aspect]


def _tune_drawn(ax: Any, function: Any) -> None:
    """Draw the stairs and the way home with these gains."""
    from slamlab import plots

    k_v, k_omega, lookahead = (float(one) for one in function())
    stairs = _stairs()
    way = np.array([stairs.point_at(s) for s in np.linspace(0, stairs.length, 200)])
    plots.path(ax, way, "truth")
    plots.path(ax, _homeward(k_v, k_omega, lookahead)[1].notes["believed"])
    plots.floor(ax)


check_tune = Check(
    tune,
    "what is to be said",
    {
        "it comes home": (0,),
        "it never leaves the path by more than 6 cm": (1,),
        "it needs 40 s at most": (2,),
        "it turns at full rate for less than a third of the time": (3,),
        "it swings past no corner by more than 4 cm": (4,),
    },
    use=_aspect,
    picture=_tune_drawn,
)

# %% [markdown] tags=["solution"]
# ## Solution 4: bring it home
#
# On a straight path $v = k_v \cdot$ `lookahead`: 1.0 and 0.15 m give 0.15 m/s, below the limit.
# In $1/k_\omega$ = 0.5 s the robot drives 7.5 cm, half the look-ahead distance, so it is round
# before it has gone far; and $k_\omega \Delta t = 0.2$ leaves no room for shaking.

# %% [markdown] tags=["solution"]
# A long look-ahead is smooth, but it begins to turn half a metre early and cuts the corner:

# %% active="ipynb" tags=["solution"]
# def farsighted():
#     return 1.0, 2.0, 0.5
#
# check_tune(farsighted)

# %% [markdown] tags=["statement"]
# ## Exercise 5: a memory, assembled
#
# Now store a whole way. Its points come one after the other; `fit_between` of exercise 1 puts a
# cubic through the first and the last of a run of points. Let the run grow as long as every point
# of it lies within the tolerance of the cubic, at its own $\tau$. The run before the first one
# that does not is stored, and the next run begins at its last point. As parameter take the way
# driven so far, from point to point. A run of two or three points does not determine the cubic:
# take the smallest $\lambda$ and $\mu$ then, as `np.linalg.lstsq` does.
#
# The check then drives a robot home along your cubics, with the law of exercise 3 repaired: over
# a way of four metres from 121 points it must not leave the points by more than 8 cm, must end
# within 5 cm of home, and your memory must need no more than six cubics.


# %% tags=["exercise"]
def remember(points: Array, tolerance: float) -> Array:
    """Cubics that pass all points of a way within a tolerance.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        The way out (m), n at least 2, no two points alike.
    tolerance : float
        Largest distance of a point from its cubic (m).

    Returns
    -------
    ndarray, shape (m, 4, 2)
        One cubic after the other, each as `fit_between` gives it.
    """
    t = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))

    def farthest(run):
        tau = (t[run] - t[run][0]) / (t[run][-1] - t[run][0])
        curve = tau[:, None] ** np.arange(4) @ fit_between(t[run], points[run])
        return np.hypot(*(curve - points[run]).T).max()

    first, cubics = 0, []
    while first < len(points) - 1:
        last = first + 1
        while last < len(points) - 1 and farthest(slice(first, last + 2)) <= tolerance:
            last += 1
        run = slice(first, last + 1)
        cubics.append(fit_between(t[run], points[run]))
        first = last
    return np.array(cubics)


# %% active="ipynb" tags=["try"]
# remember(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]), 0.05)

# %% [markdown] tags=["hint"]
# `np.cumsum` of the distances between neighbours, with a zero in front, is the way driven. Then a
# run is two numbers: its first point and its last.

# %% [markdown] tags=["hint"]
# Two loops: the outer one over runs, the inner one moves the end of a run on as long as the run
# with one more point still fits. At the end of the points the run that is open is stored too.

# %% [markdown] tags=["hint"]
# `tau[:, None] ** np.arange(4) @ c` are the points of a cubic. The distance is that in the plane,
# and the farthest point decides.


# %% tags=["cases"]
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
        return f"expected an array of shape (m, 4, 2), got shape {c.shape}"
    tau = np.linspace(0, 1, 40)[:, None] ** np.arange(4)
    path = (tau @ c).reshape(-1, 2)
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))
    pose, at, away = np.append(path[-1], np.pi), len(path) - 1, 0.0
    for _ in range(800):
        at = int(np.argmin(np.hypot(*(path[: at + 1] - pose[:2]).T)))
        ahead = path[int(np.argmin(np.abs(along[: at + 1] - along[at] + 0.15)))]
        v, omega = steer(pose, ahead, np.array([1.0, 2.0]), np.array([0.2, 1.5]))
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


def _remember_drawn(ax: Any, function: Any) -> None:
    """Draw the points of a way of four metres, the cubics that are stored, and where they join."""
    from slamlab import plots

    points = _way_out()[0]
    plots.lidar_points(ax, points, s=3)
    cubics = np.asarray(function(points, 0.03), float)
    for c in cubics.reshape(-1, 4, 2):
        plots.path(ax, _curve(c, np.linspace(0, 1, 40)))
        ax.plot(*_curve(c, [0.0, 1.0]).T, "o", color=plots.COLOURS["estimate"], markersize=6)
    plots.floor(ax)


check_remember = Check(
    remember,
    "cubics",
    {
        "two points make one cubic": ([[0.0, 0.0], [1.0, 2.0]], 0.05),
        "a straight way needs one": ([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], 1e-9),
        "no tolerance: a cubic passes four points, not five": lambda rng: (
            _walk(7, 1e-6)(rng)[0],
            1e-6,
        ),
        "a corner": ([[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [3, 2], [3, 3.0]], 0.05),
        "a short way": _walk(8, 0.02),
        "a long way": _walk(40, 0.05),
        "out, and home along the memory": (_way_out(), 0.03),
    },
    tolerance=1e-6,
    use=_memory_of,
    picture=_remember_drawn,
)


# %% tags=["mistakes"]
def _point_to_point(points: Array, tolerance: float) -> Any:
    pairs = zip(points[:-1], points[1:], strict=True)
    return np.array([fit_between(np.arange(2.0), np.array(pair)) for pair in pairs])


check_remember.mistakes = {
    "the last cubic is missing: what is open at the end of the way is stored too": (
        lambda points, tolerance: remember(points, tolerance)[:-1]
    ),
    "the cubic that left the tolerance was stored: expected the one before it": (
        "run = slice(first, last + 1) => run = slice(first, last + 2)"
    ),
    "the next cubic begins one point too late: it begins where the last one ends": (
        "first = last => first = last + 1"
    ),
    "only the last point but one was tested: a longer cubic moves away from the old ones too": (
        "(curve - points[run]).T).max() => (curve - points[run]).T)[-2]"
    ),
    "the mean distance was tested: every point must lie within the tolerance": (
        ".max() => .mean()"
    ),
    "squared distances were compared with the tolerance": (".max() => .max() ** 2"),
    "x and y were tested one by one: the distance in the plane counts": (
        "np.hypot(*(curve - points[run]).T).max() => np.abs(curve - points[run]).max()"
    ),
    "the parameter is the number of the point: let it grow with the way": (
        "np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))"
        " => 1.0 * np.arange(len(points))"
    ),
    "one cubic for the whole way: begin a new one where the tolerance is left": (
        lambda points, tolerance: remember(points, np.inf)
    ),
    "a cubic from point to point: it should be as long as the tolerance allows": (_point_to_point),
    "the cubics are in the wrong order: the first begins at the first point": (
        lambda points, tolerance: remember(points, tolerance)[::-1]
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: a memory, assembled
#
# Try the run with one more point before it is taken. What leaves the tolerance is never stored,
# and what is open at the end is.

# %% [markdown] tags=["solution"]
# It is tempting to test only what is new. The newest point is on the cubic by construction, so
# take its neighbour, the last but one: that one is near all the same, and it is older points that
# the longer cubic leaves. The robot then cuts through what it drove round:

# %% active="ipynb" tags=["solution"]
# def last_but_one(points, tolerance):
#     t = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
#     first, cubics = 0, []
#     while first < len(points) - 1:
#         last = first + 1
#         while last < len(points) - 1:
#             run = slice(first, last + 2)
#             tau = (t[run] - t[run][0]) / (t[run][-1] - t[run][0])
#             curve = tau[:, None] ** np.arange(4) @ fit_between(t[run], points[run])
#             if np.hypot(*(curve - points[run])[-2]) > tolerance:
#                 break
#             last += 1
#         run = slice(first, last + 1)
#         cubics.append(fit_between(t[run], points[run]))
#         first = last
#     return np.array(cubics)
#
# check_remember(last_but_one)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 17](../solutions/17_the_way_home.ipynb).
