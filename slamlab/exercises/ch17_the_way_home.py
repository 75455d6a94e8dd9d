"""Exercises, chapter 17: a smooth fit, its bends, a law with a bug, its gains, a memory, home.

P3 section 2 (pieces that join) and step 2.3 (return law, front or tail first).
"""

# mypy: disable-error-code="arg-type"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_pose, drawn
from slamlab.exercises._report import Array, Check, Function
from slamlab.geometry import compose, wrap_angle

__all__ = [
    "check_bend",
    "check_come_home",
    "check_gains",
    "check_remember",
    "check_smooth_fit",
    "check_steer",
]


# %% [markdown] tags=["chapter"]
# # Exercises 17: the way home
#
# Six exercises: a cubic that joins without a kink, its bends, a law with a bug, its gains with a
# pencil, the memory, and the way home: your robot drives back along your own spline,
# by your own law, and the picture tells where it ends. The chapter is [The way
# home](../17_the_way_home.ipynb). Replace each `...` and run the check below it as often as you
# like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 17: the way home
#
# The exercises are in [Exercises 17](../exercises/17_the_way_home.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import compose, wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: a cubic that joins without a kink
#
# The lesson's cubics join: each begins at the point where the last one ends. But they join with a
# kink, of some 40° on the way of exercise 5. The lesson's robot aims at a point ahead and rounds
# it off. A robot that drives close to its path turns as the path bends, and no turn rate turns it
# by 40° at once: it leaves its path (exercise 5 shows how far). So let a piece begin with the
# slope with which the last one ended as well.
#
# As in the lesson, the points $d_0, \dots, d_n$ have the parameters $\tau_i = t_i / t_n$, where
# $t_i$ is the length of the polygon up to $d_i$ (m), and the cubic is
#
# $$
# c(\tau) = d_0 + (d_n - d_0)\,\tau + \tau(1-\tau)(\lambda + \mu\tau).
# $$
#
# Its slope per metre of the polygon is $c'(\tau)/t_n$, a vector with a direction and a length. At
# the beginning, $c'(0)/t_n$, it is given now. The lesson fits $\lambda$ and $\mu$. Which of the
# two is decided by the slope? Fit the other one by least squares to all points. Two points leave
# nothing to fit: take $\mu = 0$ there, and the curve is a parabola.


# %% tags=["exercise"]
def smooth_fit(points: Array, slope: Array) -> Array:
    """Cubic through the first and the last point that begins with a given slope.

    Parameters
    ----------
    points : ndarray, shape (n + 1, 2)
        d_0 to d_n (m), n at least 1, neighbours apart.
    slope : ndarray, shape (2,)
        Change of x and y per metre of the polygon, at d_0; of any length.

    Returns
    -------
    ndarray, shape (4, 2)
        Coefficients; row m belongs to tau^m, columns are x and y.
    """
    t = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    tau, chord = t / t[-1], points[-1] - points[0]
    lam = slope * t[-1] - chord
    known = points[0] + tau[:, None] * chord + (tau * (1 - tau))[:, None] * lam
    shape = tau**2 * (1 - tau)
    mu = np.zeros(2)
    if len(points) > 2:
        mu = shape @ (points - known) / (shape @ shape)
    return np.array([points[0], chord + lam, mu - lam, -mu])


# %% active="ipynb" tags=["try"]
# smooth_fit(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.5]]), np.array([1.0, 0.0]))

# %% [markdown] tags=["hint"]
# Differentiate $c(\tau)$ and put in $\tau = 0$. Which letters are left? How many metres does the
# robot drive while $\tau$ goes from 0 to 1?

# %% [markdown] tags=["hint"]
# $\lambda$ is known before a single point is fitted. Take all that is known away from the points;
# what remains is $\mu\,\tau^2(1-\tau)$ and noise.

# %% [markdown] tags=["hint"]
# One unknown $a$ and errors $r_i - a\,s_i$: the lesson's example in the section *A line that must
# begin where the last one ended* has the same form. Here once for $x$, once for $y$.


# %% tags=["cases"]
@drawn
def _run(rng: np.random.Generator, n: int) -> Any:
    heading = rng.uniform(-3, 3) + np.cumsum(rng.normal(0, 0.3, n))
    hops = rng.uniform(0.1, 1.0, n)[:, None]
    points = np.cumsum(hops * np.stack([np.cos(heading), np.sin(heading)], 1), 0)
    slope = rng.uniform(0.6, 1.1) * np.array([np.cos(heading[0]), np.sin(heading[0])])
    return np.round(points + rng.normal(0, 9, 2), 2), np.round(slope + rng.normal(0, 0.1, 2), 2)


def _curve(coefficients: Any, tau: Any) -> Array:
    """Points of a cubic of the plane at these parameters."""
    return np.asarray(tau, float)[..., None] ** np.arange(4) @ np.asarray(coefficients, float)


def _ends(c: Any) -> tuple[Array, Array]:
    """Directions (rad) in which cubics begin and end."""
    c = np.asarray(c, float)
    first, last = c[..., 1, :], c[..., 1, :] + 2 * c[..., 2, :] + 3 * c[..., 3, :]
    return np.arctan2(first[..., 1], first[..., 0]), np.arctan2(last[..., 1], last[..., 0])


def _kink(cubics: Any) -> float:
    """Largest turn at the joints of cubics (degrees)."""
    begin, end = _ends(cubics)
    return float(np.rad2deg(np.abs(wrap_angle(begin[1:] - end[:-1])).max(initial=0.0)))


def _smooth_fit_drawn(ax: Any, function: Any) -> None:
    """Draw noisy points of a way in a bend, two cubics through them, and the joint."""
    from slamlab import plots

    s, rng = np.linspace(0, 1, 33), np.random.default_rng(1)
    points = np.column_stack([3 * s, np.sin(5 * s) + s]) + rng.normal(0, 0.05, (33, 2))
    first = smooth_fit(points[:17], np.array([0.5, 0.85]))
    metres = np.hypot(*np.diff(points[:17], axis=0).T).sum()
    slope = (first[1] + 2 * first[2] + 3 * first[3]) / metres
    second = np.asarray(function(points[16:], slope), float)
    plots.lidar_points(ax, points, s=4)
    plots.path(ax, _curve(first, np.linspace(0, 1, 100)), "truth")
    plots.path(ax, _curve(second, np.linspace(0, 1, 100)))
    ax.plot(*points[16], "o", color=plots.COLOURS["truth"], mfc="none", markersize=9)
    near = _curve(second, np.linspace(0, 1, 400))
    off = np.hypot(*np.moveaxis(near[:, None] - points[16:], -1, 0)).min(0)
    ax.set_title(
        f"kink at the joint {_kink([first, second]):.0f}°,\n"
        f"points off by {1000 * np.sqrt(np.mean(off**2)):.0f} mm (RMS)"
    )
    plots.floor(ax)


check_smooth_fit = Check(
    smooth_fit,
    "coefficients",
    {
        "two points: a parabola": ([[1.0, 2.0], [3.0, 2.5]], [0.8, -0.4]),
        "three points: the curve meets all": _run(3),
        "a straight way": ([[0.0, 0.0], [1.0, 2.0], [3.0, 6.0]], [0.4472135955, 0.894427191]),
        "a robot that leaves sideways": ([[0, 0], [0.5, 0.3], [1, 0.4], [2, 0.1]], [0.0, 1.0]),
        "ends and slope hold, the rest is least squares": _run(7),
        "many points": _run(40),
    },
    tolerance=1e-7,
    picture=_smooth_fit_drawn,
)


# %% tags=["mistakes"]
def _lesson_fit(points: Array) -> Array:
    """The lesson's fit: both factors are free."""
    t = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    tau, chord, free = t / t[-1], points[-1] - points[0], np.zeros((2, 2))
    shapes = (tau * (1 - tau))[:, None] * np.stack([np.ones_like(tau), tau], 1)
    rest, m = points - points[0] - tau[:, None] * chord, min(len(points) - 2, 2)
    free[:m] = np.linalg.lstsq(shapes[:, :m], rest, rcond=None)[0]
    lam, mu = free
    return np.array([points[0], chord + lam, mu - lam, -mu])


def _bent_afterwards(points: Array, slope: Array) -> Array:
    """The lesson's fit, with lambda exchanged at the end."""
    c, metres = _lesson_fit(points), np.hypot(*np.diff(points, axis=0).T).sum()
    lam = slope * metres - points[-1] + points[0]
    return np.array([c[0], points[-1] - points[0] + lam, -c[3] - lam, c[3]])


def _divided(points: Array, slope: Array) -> Array:
    """The equation of each point divided by its shape, and the mean taken."""
    t = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    tau, chord = t / t[-1], points[-1] - points[0]
    lam, mu = slope * t[-1] - chord, np.zeros(2)
    known = points[0] + tau[:, None] * chord + (tau * (1 - tau))[:, None] * lam
    if len(points) > 2:
        mu = ((points - known)[1:-1] / (tau**2 * (1 - tau))[1:-1, None]).mean(0)
    return np.array([points[0], chord + lam, mu - lam, -mu])


check_smooth_fit.mistakes = {
    "lambda and mu are both free, as in the lesson: the slope decides lambda": (
        lambda points, slope: _lesson_fit(points)
    ),
    "mu was fitted together with a free lambda: fit it after lambda is decided": _bent_afterwards,
    "the equations were divided by tau^2 (1 - tau): points near the ends count too much": _divided,
    "the slope is per metre, and tau runs over all metres of the polygon: c'(0) = t_n slope": (
        "lam = slope * t[-1] - chord => lam = slope - chord"
    ),
    "the slope was divided by t_n: c'(0) / t_n is the slope": (
        "lam = slope * t[-1] - chord => lam = slope / t[-1] - chord"
    ),
    "the chord was taken for the length: t_n is that of the polygon": (
        "slope * t[-1] - chord => slope * np.hypot(*chord) - chord"
    ),
    "the chord is missing in lambda: c'(0) = d_n - d_0 + lambda": (
        "lam = slope * t[-1] - chord => lam = slope * t[-1]"
    ),
    "lambda has the wrong sign: c'(0) = d_n - d_0 + lambda": (
        "lam = slope * t[-1] - chord => lam = chord - slope * t[-1]"
    ),
    "mu was fitted to points from which lambda tau (1 - tau) had not been taken": (
        "+ (tau * (1 - tau))[:, None] * lam => "
    ),
    "the shape of mu is tau^2 (1 - tau): tau (1 - tau) changes the slope": (
        "shape = tau**2 * (1 - tau) => shape = tau * (1 - tau)"
    ),
    "nothing was fitted: mu is missing": ("if len(points) > 2: => if False:"),
    "two points leave 0 / 0: mu is 0 there": ("if len(points) > 2: => if True:"),
    "the sign of mu was lost in multiplying out: tau^2 (1 - tau) has -tau^3": ("-mu]) => mu])"),
    "the sign of lambda was lost in multiplying out: tau (1 - tau) has -tau^2": (
        "mu - lam => mu + lam"
    ),
    "tau must grow with the length of the polygon, not with the number of the point": (
        "tau, chord = t / t[-1], points[-1] - points[0]"
        " => tau, chord = np.linspace(0, 1, len(t)), points[-1] - points[0]"
    ),
    "the slope was held at the last point: expected at the first": (
        lambda points, slope: _turned_round(smooth_fit(points[::-1], -slope))
    ),
    "highest power first: row 0 is the constant": lambda points, slope: smooth_fit(points, slope)[
        ::-1
    ],
    "this is the transpose: rows are powers, columns x and y": lambda points, slope: (
        smooth_fit(points, slope).T
    ),
}


def _turned_round(c: Array) -> Array:
    """The same cubic, driven from its end to its beginning."""
    c0, c1, c2, c3 = c
    return np.array([c0 + c1 + c2 + c3, -c1 - 2 * c2 - 3 * c3, c2 + 3 * c3, -c3])


# %% [markdown] tags=["solution"]
# ## Solution 1: a cubic that joins without a kink
#
# At $\tau = 0$ the derivative is $c'(0) = d_n - d_0 + \lambda$: the shape of $\mu$ begins with
# $\tau^2$ and does not change the slope. While $\tau$ goes from 0 to 1 the robot drives $t_n$
# metres, so $\lambda = t_n \cdot \text{slope} - (d_n - d_0)$. What remains is one unknown for each
# coordinate, as in the lesson's first example: $\mu = \sum s_i r_i / \sum s_i^2$. All three
# constraints hold exactly, whatever the noise is.

# %% [markdown] tags=["solution"]
# It is tempting to take the lesson's fit and to exchange its $\lambda$ at the end. The kink is
# gone, but $\mu$ was chosen for another $\lambda$. The curve misses the points, and the picture
# shows by how much:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels: on the left the second cubic leaves its points by far, on the right it follows them."}}
# def exchanged(points, slope):
#     t = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
#     tau, chord = t / t[-1], points[-1] - points[0]
#     shapes = (tau * (1 - tau))[:, None] * np.stack([np.ones_like(tau), tau], 1)
#     rest = points - points[0] - tau[:, None] * chord
#     mu = np.linalg.lstsq(shapes, rest, rcond=None)[0][1]
#     lam = slope * t[-1] - chord
#     return np.array([points[0], chord + lam, mu - lam, -mu])
#
# check_smooth_fit.draw(exchanged)

# %% [markdown] tags=["statement"]
# ## Exercise 2: how fast through the bend?
#
# A robot that stays close to its way turns as the way bends, at 1.5 rad/s at most. At 0.5 m/s it
# came to a bend that was too sharp for that, and left its way on the outside. The robot of
# exercise 5 asks at each place of its cubic how sharp the bend is there, and slows down.
#
# The measure is the curvature $\kappa$: by how many radians the robot's heading turns in each
# metre that it drives along the curve, to the left positive. But a cubic $c(\tau)$ does not run in
# metres, nor evenly. With a pencil: the heading is the direction of $c'(\tau) = (x', y')$. By how
# much does it turn while $\tau$ goes on by a little? And how many metres does the robot drive
# meanwhile?
#
# Return $\kappa$, and with it the largest speed that is allowed: neither the robot's largest speed
# nor its largest turn rate may be exceeded. Try $x = \tau$, $y = \tau^2$ (m): $\kappa$ is 2 rad/m
# at $\tau = 0$, and $1/\sqrt2$ at $\tau = \frac12$.
#
# The picture draws three circles of radius $1/|\kappa|$ beside the curve, on the side to which it
# bends, and sends exercise 5's robot along it, with your $\kappa$ and at your speeds. (Exercise 5
# calls your `bend` with 1.35 rad/s in place of 1.5; the rest is left for corrections.)


# %% tags=["exercise"]
def bend(c: Array, tau: Array, limits: Array) -> tuple[Array, Array]:
    """Curvature of a cubic, and how fast a robot may be there.

    Parameters
    ----------
    c : ndarray, shape (4, 2)
        Coefficients; row m belongs to tau^m, columns are x and y (m).
    tau : ndarray, shape (k,)
        Parameters, 0 to 1. The robot drives towards larger ones; c' is not zero there.
    limits : ndarray, shape (2,)
        Largest speed (m/s) and largest turn rate (rad/s, to either side).

    Returns
    -------
    kappa, v : ndarray, shape (k,)
        Curvature (rad/m), positive to the left, and speed (m/s); on a straight line
        kappa is 0 and v the largest speed.
    """
    powers = tau[:, None] ** np.arange(3)
    x1, y1 = (powers @ (c[1:] * [[1], [2], [3]])).T
    x2, y2 = (powers[:, :2] @ (c[2:] * [[2], [6]])).T
    kappa = (x1 * y2 - y1 * x2) / np.hypot(x1, y1) ** 3
    v = limits[1] / np.maximum(np.abs(kappa), limits[1] / limits[0])
    return kappa, v


# %% active="ipynb" tags=["try"]
# parabola = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
# bend(parabola, np.array([0.0, 0.5]), np.array([1.0, 1.5]))

# %% [markdown] tags=["hint"]
# How long is $c'(\tau)$, in which unit? It is a speed, with $\tau$ as the clock. What is
# $c''(\tau)$?

# %% [markdown] tags=["hint"]
# The heading is `arctan2(y', x')`; of $\arctan(y'/x')$ you know the derivative. It is the turn
# per $\tau$. The curvature is the turn per metre.

# %% [markdown] tags=["hint"]
# At the speed $v$ the robot drives $v$ metres in a second, and turns by $\kappa$ in each. So how
# large may $v$ be? Where $\kappa = 0$ do not divide by it.


# %% tags=["cases"]
def _handles(points: Any) -> Array:
    powers = [[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]
    c: Array = np.array(powers, float) @ np.array(points, float)
    return c


_FAST = np.array([1.5, 1.5])


@drawn
def _a_bend(rng: np.random.Generator, n: int, size: float = 1.0) -> Any:
    """Draw a cubic whose c' is nowhere zero: its four handles turn by less than a right angle."""
    heading = rng.uniform(-3, 3) + np.array([0.0, *rng.uniform(-0.7, 0.7, 2)])
    hops = size * rng.uniform(0.2, 0.6, 3)[:, None]
    steps = hops * np.stack([np.cos(heading), np.sin(heading)], 1)
    points = rng.uniform(-3, 3, 2) + np.vstack([[0, 0], np.cumsum(steps, 0)])
    limits = np.round([size**0.5 * rng.uniform(1, 4), rng.uniform(0.5, 2)], 2)
    return np.round(_handles(points), 2), np.sort(np.round(rng.uniform(0, 1, n), 2)), limits


def _one_side(rng: np.random.Generator) -> Any:
    """Draw an arc to the left or to the right, at both ends and in the middle."""
    y = rng.choice([-1, 1]) * float(np.round(rng.uniform(0.3, 0.6), 2))
    c = np.round(_handles([[0, 0], [0.4, 0], [0.8, y], [0.9, 2 * y]]), 2)
    return c + 0.0, [0, 0.5, 1], _FAST


_BENT = _handles([[0, 0], [2.2, -0.1], [-0.2, 1.1], [1.8, 1.0]])


def _bend_drawn(ax: Any, function: Any) -> None:
    """Draw a way, three circles of radius 1 / |kappa| beside it, and a drive along it (dashed)."""
    from slamlab import plots

    chosen = np.array([0.06, 0.32, 0.68])
    kappas, _ = np.asarray(function(_BENT, chosen, np.array([0.5, 1.35])), float)
    places, seconds, far = _ridden(_BENT[None], 0.5, np.arctan2(-0.1, 2.2), function)
    plots.path(ax, _curve(_BENT, np.linspace(0, 1, 200)))
    tangents = chosen[:, None] ** np.arange(3) @ (_BENT[1:] * [[1], [2], [3]])
    for place, kappa, (x, y) in zip(_curve(_BENT, chosen), kappas, tangents, strict=True):
        if abs(kappa) > 0.2:
            middle = place + np.array([-y, x]) / np.hypot(x, y) / kappa
            angle = np.linspace(0, 2 * np.pi, 90)
            ring = middle + np.stack([np.cos(angle), np.sin(angle)], 1) / abs(kappa)
            ax.plot(*ring.T, ":", color=plots.COLOURS["wrong"], lw=1.2)
        ax.plot(*place, "o", color=plots.COLOURS["wrong"], ms=5)
    ax.plot(*places.T, "--", color=plots.COLOURS["dead_reckoning"], lw=1.8)
    ax.set_title(f"drive (dashed): {1000 * far:.0f} mm\nfrom the curve, {seconds:.1f} s")
    plots.floor(ax)
    ax.set(xlim=(-0.2, 1.9), ylim=(-0.3, 1.3))


check_bend = Check(
    bend,
    "kappa, v",
    {
        "the pencil's parabola": (
            [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 0.0]],
            [0.0, 0.5],
            _FAST,
        ),
        "a straight line": ([[1.0, 0], [1, 2], [0, 0], [0, 0]], [0.0, 0.5, 1.0], [0.5, 1.5]),
        "a straight line that is not run through evenly": (
            [[0.0, 1.0], [1.0, 2.0], [0.5, 1.0], [0.25, 0.5]],
            [0.0, 0.3, 1.0],
            [0.4, 1.2],
        ),
        "an arc to the left, to the right": _one_side,
        "an S, and the place where it turns over": (
            _handles([[0, 0], [1, 0.5], [0, 0.5], [1, 1.0]]),
            [0.0, 0.25, 0.5, 0.75, 1.0],
            _FAST,
        ),
        "one place": _a_bend(1),
        "a car on its road": _a_bend(5, 10.0),
        "any way": _a_bend(6),
    },
    tolerance=1e-7,
    edges=("a straight line",),
    picture=_bend_drawn,
)

# %% tags=["mistakes"]
check_bend.mistakes = {
    "this is the turn per tau, not per metre: |c'| metres are driven while tau goes on by 1": (
        "np.hypot(x1, y1) ** 3 => np.hypot(x1, y1) ** 2"
    ),
    "x'y'' - y'x'' alone is no angle: a long c' turns less": " / np.hypot(x1, y1) ** 3 => ",
    "x'y'' - y'x'' over |c'| is no angle: how does atan2(y', x') change?": (
        "np.hypot(x1, y1) ** 3 => np.hypot(x1, y1)"
    ),
    "divided by the metres once too often: the turn per tau has |c'| twice, the metres once": (
        "np.hypot(x1, y1) ** 3 => np.hypot(x1, y1) ** 4"
    ),
    "the sign of kappa is missing: to the right it is negative": (
        "(x1 * y2 - y1 * x2) => np.abs(x1 * y2 - y1 * x2)"
    ),
    "kappa has the wrong sign: positive to the left": (
        "(x1 * y2 - y1 * x2) => (y1 * x2 - x1 * y2)"
    ),
    "the length of c'' was taken: it also grows where the robot drives straight on, but unevenly": (
        "(x1 * y2 - y1 * x2) / np.hypot(x1, y1) ** 3 => np.hypot(x2, y2)"
    ),
    "the length of c'' over |c'|^2 was taken: only its part across the way turns the robot": (
        "(x1 * y2 - y1 * x2) / np.hypot(x1, y1) ** 3 => np.hypot(x2, y2) / np.hypot(x1, y1) ** 2"
    ),
    "y'' / (1 + y'^2)^1.5 is for a curve y(x): here x runs too": (
        "(x1 * y2 - y1 * x2) / np.hypot(x1, y1) ** 3 => y2 / (1 + y1**2) ** 1.5"
    ),
    "c' = c_1 + 2 c_2 tau + 3 c_3 tau^2: the factors are missing": "[[1], [2], [3]] => 1",
    "c'' = 2 c_2 + 6 c_3 tau: the factors are missing": "[[2], [6]] => 1",
    "c'' has 6 c_3 tau: the 3 of c' is multiplied by 2 again": "[[2], [6]] => [[2], [3]]",
    "the radius was returned: the curvature is one over it": (
        "return kappa, v => return 1 / np.where(kappa == 0, 1e-12, kappa), v"
    ),
    "v kappa is the turn rate: divide the limit by kappa": (
        "v = limits[1] / np.maximum(np.abs(kappa), limits[1] / limits[0])"
        " => v = np.minimum(limits[1] * np.abs(kappa), limits[0])"
    ),
    "in a wide bend the robot's largest speed is the limit": (
        "np.maximum(np.abs(kappa), limits[1] / limits[0]) => np.maximum(np.abs(kappa), 1e-12)"
    ),
    "only where kappa is 0 the largest speed was kept to: it is the limit in a wide bend, too": (
        "limits[1] / np.maximum(np.abs(kappa), limits[1] / limits[0])"
        " => np.where(kappa == 0, limits[0], limits[1] / np.abs(kappa))"
    ),
    "the speed in a bend to the right is wrong: the size of kappa counts": (
        "np.maximum(np.abs(kappa), limits[1] / limits[0])"
        " => np.maximum(kappa, limits[1] / limits[0])"
    ),
    "the limits are exchanged: the first is that of the speed": (
        lambda c, tau, limits: bend(c, tau, limits[::-1])
    ),
    "the largest speed everywhere: in a sharp bend the turn rate is the limit": (
        "limits[1] / np.maximum(np.abs(kappa), limits[1] / limits[0])"
        " => np.full(len(tau), limits[0])"
    ),
    "one speed for the whole way: each place has its own": (
        "np.maximum(np.abs(kappa), limits[1] / limits[0])"
        " => np.full(len(tau), max(np.abs(kappa).max(), limits[1] / limits[0]))"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: how fast through the bend?
#
# The heading is $\theta = \arctan(y'/x')$. Its derivative with respect to $\tau$, and the metres
# driven, are
#
# $$
# \frac{d\theta}{d\tau} = \frac{x'y'' - y'x''}{x'^2 + y'^2}, \qquad
# \frac{ds}{d\tau} = |c'| \quad\Rightarrow\quad
# \kappa = \frac{d\theta}{ds} = \frac{x'y'' - y'x''}{|c'|^3} .
# $$
#
# At the speed $v$ the robot turns by $v\kappa$ in a second, so $v \le \omega_{\max}/|\kappa|$.
# Where that is more than the largest speed, as on a straight line, the largest speed holds: the
# larger of $|\kappa|$ and $\omega_{\max}/v_{\max}$ is never 0 and divides for all places at once.

# %% [markdown] tags=["solution"]
# A robot that knows $\kappa$ but does not slow down turns as fast as it can, and drives up to 12 cm
# past the bends:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels of a way with a sharp bend: on the left the robot leaves it on the outside, on the right it stays on it."}}
# def at_full_speed(c, tau, limits):
#     kappa, _ = bend(c, tau, limits)
#     return kappa, np.full(len(tau), limits[0])
#
# check_bend.draw(at_full_speed)

# %% [markdown] tags=["statement"]
# ## Exercise 3: a bug to find
#
# A robot that has driven into a narrow corridor has no room to turn. On its way home it is to
# drive tail first as long as the way lies behind it, and front first otherwise. So this law
# decides by itself: with $\alpha$, the direction to the point $P_f$ seen from the robot's front,
# to the left positive, it drives tail first if $|\alpha| > 90°$. Then the speed is negative, and
# $\alpha$ is the direction seen from the tail: 0° if $P_f$ is straight behind. A positive $\omega$
# turns the robot to its left in both cases. The rest is step 2.3 of P3, $v = k_v |P_f - P_r|$ and
# $\omega = k_\omega \alpha$, with limits.
#
# In the first corridor the robot backed out as it should. In the next one its front swung round
# and hit the wall. Begin with the picture, not with the report: four robots back out, each in its
# corridor. What do those have in common that hit the wall? Find the bug and repair it.


# %% tags=["exercise"]
def steer(pose: Array, point: Array, gains: Array, limits: Array) -> tuple[float, float]:
    """Control that drives towards a point, front or tail first.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        Place (m) and heading (rad) of the robot.
    point : ndarray, shape (2,)
        Where it is to drive (m); front first where it is exactly beside the robot.
    gains : ndarray, shape (2,)
        k_v and k_omega (1/s).
    limits : ndarray, shape (2,)
        Largest speed (m/s) and largest turn rate (rad/s), to either side.

    Returns
    -------
    v, omega : float
        Speed, negative if tail first, and turn rate.
    """
    dx, dy = point - pose[:2]
    alpha = wrap_angle(np.arctan2(dy, dx) - pose[2])
    v = min(gains[0] * np.hypot(dx, dy), limits[0])
    if abs(alpha) > np.pi / 2:
        v, alpha = -v, alpha - np.copysign(np.pi, alpha)
    omega = min(max(gains[1] * alpha, -limits[1]), limits[1])
    return v, omega


# %% active="ipynb" tags=["stub"]
#     dx, dy = point - pose[:2]
#     alpha = wrap_angle(np.arctan2(dy, dx) - pose[2])
#     v = min(gains[0] * np.hypot(dx, dy), limits[0])
#     if abs(alpha) > np.pi / 2:
#         v, alpha = -v, alpha - np.pi
#     omega = min(max(gains[1] * alpha, -limits[1]), limits[1])
#     return v, omega

# %% active="ipynb" tags=["try"]
# steer(np.zeros(3), np.array([0.15, 0.01]), np.array([1.0, 2.0]), np.array([0.2, 1.5]))

# %% [markdown] tags=["hint"]
# Which robots hit the wall: those on one side of their corridor? Take one of them and its mirror
# image: a robot at `np.zeros(3)`, and a point at (-0.15, 0.01), then at (-0.15, -0.01). By how
# much should it turn in each case, and to which side? Call `steer` for both.

# %% [markdown] tags=["hint"]
# Follow `alpha` through these two calls with a pencil, line by line, in degrees. What is it before
# the `if`, and what after it?

# %% [markdown] tags=["hint"]
# An angle that was in range once need not be in range after a sum.


# %% tags=["cases"]
@drawn
def _aim(
    rng: np.random.Generator, around: float | None = None, limits: tuple[float, float] = (0.2, 1.5)
) -> Any:
    """Draw a point: in any direction, or within half a radian of `around` seen from the front."""
    pose = a_pose(rng)
    alpha = rng.uniform(-3, 3) if around is None else around + rng.uniform(-0.5, 0.5)
    way = float(np.round(rng.uniform(0.05, 0.4), 2))
    point = pose[:2] + way * np.array([np.cos(pose[2] + alpha), np.sin(pose[2] + alpha)])
    return pose, np.round(point, 3), np.round(rng.uniform(0.6, 3.0, 2), 2), limits


@drawn
def _towards_west(rng: np.random.Generator) -> Any:
    pose, point, gains, limits = _aim(around=0.0)(rng)
    turn = rng.choice([-1, 1]) * 3.0 - pose[2]
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    pose[2] += turn
    return pose, np.round(pose[:2] + turned @ (point - pose[:2]), 3), gains, limits


def _driven(function: Any, pose: Any, law: Any, target: Any, steps: int) -> Array:
    """Poses of a robot that always steers to `target(pose)`."""
    path = [np.array(pose, float)]
    for _ in range(steps):
        pose = path[-1]
        v, omega = (float(one) for one in function(pose, target(pose), *law))
        step = [0.1 * v * np.cos(0.05 * omega), 0.1 * v * np.sin(0.05 * omega), 0.1 * omega]
        path.append(compose(pose, np.array(step)))
    return np.array(path)


def _steer_drawn(ax: Any, function: Any) -> None:
    """Draw four robots, each in a corridor, that back out to the left, and their fronts."""
    from slamlab import plots

    law, inside = (np.array([0.8, 5.0]), np.array([0.2, 1.5])), 0
    starts = [(0.03, 0.15), (-0.03, -0.15), (0.02, 0.1), (-0.02, -0.1)]
    for k, (y, heading) in enumerate(starts):
        path = _driven(
            function, [1.2, y, heading], law, lambda p: np.array([p[0] - 0.25, 0.0]), 60
        )
        front = path[:, :2] + 0.12 * np.stack([np.cos(path[:, 2]), np.sin(path[:, 2])], 1)
        floor = np.array([0.0, 0.35 * k])
        for wall in (-0.1, 0.1):
            ax.plot([-0.2, 1.4], np.full(2, wall) + floor[1], color=plots.COLOURS["wall"])
        ax.plot([-0.2, 1.4], floor[[1, 1]], color=plots.COLOURS["wall"], linewidth=0.6)
        plots.path(ax, front + floor, "dead_reckoning")
        plots.path(ax, path[:, :2] + floor)
        ax.plot(*(path[0, :2] + floor), "o", color=plots.COLOURS["estimate"], markersize=5)
        inside += bool(max(np.abs(front[:, 1]).max(), np.abs(path[:, 1]).max()) < 0.1)
    ax.set_title(f"clear of the walls: {inside} of 4")
    plots.floor(ax)
    ax.set(xlim=(-0.2, 1.4), ylim=(-0.2, 1.25))


check_steer = Check(
    steer,
    "v, omega",
    {
        "a point straight ahead": ([0, 0, 0], [0.1, 0.0], [1.0, 2.0], [0.2, 1.5]),
        "ahead to the left, to the right": lambda rng: (
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
        "a robot that faces west": _towards_west(),
        "exactly beside it": ([0, 0, 0.0], [0.0, 0.1], [1.0, 0.3], [0.2, 1.5]),
        "behind, A": _aim(around=np.pi - 0.5),
        "behind, B": _aim(around=0.5 - np.pi),
        "limits that never hold": _aim(limits=(9.0, 99.0)),
        "any point": _aim(limits=(0.25, 1.2)),
    },
    picture=_steer_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
_TAIL = "alpha - np.copysign(np.pi, alpha)"
check_steer.mistakes = {
    "alpha leaves (-pi, pi] when pi is taken off: the robot turns the long way to one side": (
        f"{_TAIL} => alpha - np.pi"
    ),
    "pi was added: alpha leaves (-pi, pi] on the other side now": f"{_TAIL} => alpha + np.pi",
    "tail first alpha stayed as seen from the front: the robot turns round": f"{_TAIL} => alpha",
    "tail first the turn has the wrong sign: a turn to the left is one, front or tail first": (
        f"{_TAIL} => np.copysign(np.pi, alpha) - alpha"
    ),
    "the speed stayed positive tail first": "v, alpha = -v, => v, alpha = v,",
    "never tail first: a point behind is nearer to the tail": "> np.pi / 2 => > np.pi",
    "always tail first: a point ahead is nearer to the front": "> np.pi / 2 => >= 0",
    "only points behind to the left are driven to tail first": (
        "abs(alpha) > np.pi / 2 => alpha > np.pi / 2"
    ),
    "the first difference is not wrapped any more": (
        "wrap_angle(np.arctan2(dy, dx) - pose[2]) => np.arctan2(dy, dx) - pose[2]"
    ),
    "the turn rate was limited to the left only: a turn to the right has a limit too": (
        "min(max(gains[1] * alpha, -limits[1]), limits[1]) => min(gains[1] * alpha, limits[1])"
    ),
    "the turn rate was limited to the right only: a turn to the left has a limit too": (
        "min(max(gains[1] * alpha, -limits[1]), limits[1]) => max(gains[1] * alpha, -limits[1])"
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
    "the gains are exchanged: the first is that of the speed": (
        lambda pose, point, gains, limits: steer(pose, point, gains[::-1], limits)
    ),
    "the limits are exchanged: the first is that of the speed": (
        lambda pose, point, gains, limits: steer(pose, point, gains, limits[::-1])
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a bug to find
#
# The difference was wrapped, and then $\pi$ was taken off. Behind to the left $\alpha$ is 176°,
# seen from the tail $-4°$: right. Behind to the right it is $-176°$, and $-176° - 180° = -356°$
# is the same direction as 4°, but a gain does not know that: the turn rate goes to its limit,
# the wrong way round. Take $\pi$ off with the sign of $\alpha$, or wrap once more. After each sum
# of angles ask whether the range still holds.

# %% [markdown] tags=["solution"]
# Adding $\pi$ in place of taking it off repairs the two robots that hit the wall, and now the other
# two do. A test of one side only would pass:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels of four corridors: on the left robots swing into the walls, on the right all back out."}}
# def other_side(pose, point, gains, limits):
#     dx, dy = point - pose[:2]
#     alpha = wrap_angle(np.arctan2(dy, dx) - pose[2])
#     v = min(gains[0] * np.hypot(dx, dy), limits[0])
#     if abs(alpha) > np.pi / 2:
#         v, alpha = -v, alpha + np.pi
#     return v, min(max(gains[1] * alpha, -limits[1]), limits[1])
#
# check_steer.draw(other_side)

# %% [markdown] tags=["statement"]
# ## Exercise 4: gains with a pencil
#
# A larger robot, 1 m/s fast, got the lesson's gains $k_v = 1$ and $k_\omega = 2$ (1/s). With
# $P_f$ 0.3 m ahead it crept at 0.3 m/s. With a larger $k_v$ it drove 1 m/s and swung to and fro
# about its path. Find the gains for any robot on paper, before it drives.
#
# The path is straight, the $x$ axis, and the robot drives along it front first; it is $e$ to the
# left of the path, and its heading points $\varphi$ to the left of it. Both are small, so that
# $\sin\varphi \approx \varphi$ and $\cos\varphi \approx 1$. $P_f$ is on the path, the look-ahead
# distance $L$ farther on than the robot's nearest point. The law is $v = k_v |P_f - P_r|$ and
# $\omega = k_\omega\alpha$. How do $e$ and $\varphi$ change per second? Put the two together;
# compare with a mass on a spring,
#
# $$
# \ddot e + 2\,\zeta\,\omega_0\,\dot e + \omega_0^2\,e = 0 .
# $$
#
# Its damping ratio $\zeta$ says how it comes to rest: below 1 it swings past, at 1 it is as fast
# as it can be without that. Return the gains with which the robot drives at a given speed, on its
# path, and comes back to it with a given damping ratio. The picture sets three robots 5 cm beside
# their paths.
#
# Exercise 6 drives tail first, with these gains. Let $\varphi$ be the direction of the tail then:
# a turn turns the tail as it turns the front, and all the equations stay as they are.


# %% tags=["exercise"]
def gains(speed: float, lookahead: float, damping: float) -> tuple[float, float]:
    """Gains of the law that drives home.

    Parameters
    ----------
    speed : float
        Speed on a straight path (m/s).
    lookahead : float
        Distance from the nearest point of the path to P_f (m).
    damping : float
        Damping ratio zeta of the robot's swing about its path.

    Returns
    -------
    k_v, k_omega : float
        In 1/s.
    """
    return speed / lookahead, 4 * damping**2 * speed / lookahead


# %% active="ipynb" tags=["try"]
# gains(1.0, 0.3, 1.0)

# %% [markdown] tags=["hint"]
# On the path $|P_f - P_r|$ is $L$. And if the robot is $e$ to the left of it, in which direction
# is $P_f$, seen from the path's direction? From the robot's front?

# %% [markdown] tags=["hint"]
# $\dot e = v\,\varphi$, and $\dot\varphi = \omega = k_\omega\alpha$. Write $\alpha$ with $e$, $L$
# and $\varphi$; differentiate the first, and put the second in.

# %% [markdown] tags=["hint"]
# $\alpha = -e/L - \varphi$. The factor of $\dot e$ is $k_\omega$, that of $e$ is $k_\omega v / L$.
# So $\omega_0$ is known, and with it $\zeta$. Solve for $k_\omega$.


# %% tags=["cases"]
def _a_robot(rng: np.random.Generator) -> Any:
    return tuple(np.round([rng.uniform(0.1, 3), rng.uniform(0.1, 2), rng.uniform(0.3, 2)], 2))


def _gains_drawn(ax: Any, function: Any) -> None:
    """Draw how three robots, set 5 cm beside a straight path, come back to it.

    L is the look-ahead distance; no limit holds.
    """
    from slamlab import plots

    past, driven = 0.0, list[float]()
    for (speed, ahead), style in zip(_ROBOTS, ("-", "--", ":"), strict=True):
        law = np.array(function(speed, ahead, 1.0), float), np.array([9.0, 9.0])
        pose, path = np.array([0.0, 0.05, 0.0]), []
        for _ in range(400):
            path.append(pose)
            v, omega = steer(pose, np.array([pose[0] + ahead, 0.0]), *law)
            pose = compose(pose, [0.01 * v, 0.0, 0.01 * omega])
        x, y, _ = np.array(path).T
        ax.plot(0.01 * np.arange(400), 100 * y, style, color=plots.COLOURS["estimate"],
                label=f"{speed:g} m/s, L = {ahead:g} m")  # fmt: skip
        past, driven = max(past, -y.min()), [*driven, (x[-1] - x[200]) / 1.99]
    ax.axhline(0, color=plots.COLOURS["truth"], linewidth=1)
    ax.set(xlabel="time (s)", ylabel="beside the path (cm)", xlim=(0, 4), ylim=(-2.5, 5.5))
    ax.legend(fontsize=8)
    said = " / ".join(f"{v:.1f}" for v in driven)
    ax.set_title(f"{1000 * past:.0f} mm past the path,\nat {said} m/s")


_ROBOTS = ((0.2, 0.15), (0.5, 0.3), (1.0, 0.3))

check_gains = Check(
    gains,
    "k_v, k_omega",
    {
        "the lesson's robot": (0.15, 0.15, 0.5**0.5),
        "a fast robot, as damped as it can be": (1.0, 0.3, 1.0),
        "a robot that may swing a little": (0.5, 0.4, 0.7),
        "an overdamped robot": (0.2, 0.25, 1.5),
        "any robot": _a_robot,
    },
    picture=_gains_drawn,
)

# %% tags=["mistakes"]
check_gains.mistakes = {
    "k_v is the speed: v = k_v |P_f - P_r|, and |P_f - P_r| is the look-ahead distance": (
        "return speed / lookahead => return speed"
    ),
    "k_v was multiplied by the look-ahead distance: v = k_v L": (
        "return speed / lookahead => return speed * lookahead"
    ),
    "the 4 is missing: (2 zeta omega_0)^2 = 4 zeta^2 omega_0^2": "4 * damping => damping",
    "2 in place of 4: the 2 of 2 zeta omega_0 is squared as well": "4 * damping => 2 * damping",
    "zeta is not squared: k_omega = 2 zeta omega_0, and omega_0 depends on k_omega": (
        "damping**2 => damping"
    ),
    "zeta has no effect": ("damping**2 => 1"),
    "omega_0^2 is k_omega v / L: the L is missing": (
        "4 * damping**2 * speed / lookahead => 4 * damping**2 * speed"
    ),
    "omega_0^2 is k_omega v / L: the speed is missing": (
        "4 * damping**2 * speed / lookahead => 4 * damping**2 / lookahead"
    ),
    "speed and look-ahead distance are exchanged: P_f far ahead needs a small k_omega": (
        "4 * damping**2 * speed / lookahead => 4 * damping**2 * lookahead / speed"
    ),
    "2 zeta omega_0 with omega_0 = v / L: k_omega is part of omega_0": (
        "4 * damping**2 * speed / lookahead => 2 * damping * speed / lookahead"
    ),
    "2 zeta omega_0 with omega_0 = sqrt(v / L): k_omega is part of omega_0": (
        "4 * damping**2 * speed / lookahead => 2 * damping * np.sqrt(speed / lookahead)"
    ),
    "the gains are in the wrong order: k_v first": (
        "return speed / lookahead, 4 * damping**2 * speed / lookahead"
        " => return 4 * damping**2 * speed / lookahead, speed / lookahead"
    ),
    "only k_omega was returned": "return speed / lookahead, => return",
}

# %% [markdown] tags=["solution"]
# ## Solution 4: gains with a pencil
#
# On the path $|P_f - P_r| = L$, so $k_v = v/L$. Beside it $P_f$ is in the direction $-e/L$, seen
# from the front $\alpha = -e/L - \varphi$. From $\dot e = v\varphi$ and $\dot\varphi =
# k_\omega\alpha$ follows
#
# $$
# \ddot e = v\dot\varphi = -\frac{k_\omega v}{L}\,e - k_\omega v\varphi
# \quad\Rightarrow\quad \ddot e + k_\omega\,\dot e + \frac{k_\omega v}{L}\,e = 0 .
# $$
#
# So $\omega_0^2 = k_\omega v / L$ and $2\zeta\omega_0 = k_\omega$. Squared, $4\zeta^2 k_\omega v/L
# = k_\omega^2$: $k_\omega = 4\zeta^2 v/L$. With $k_v = v/L$ it is $4\zeta^2 k_v$: the lesson's
# pair of gains, 1 and 2, has $\zeta = \sqrt{1/2} \approx 0.7$, at any look-ahead distance. What
# counts is their ratio.

# %% [markdown] tags=["solution"]
# All this holds for small $e$ and $\varphi$, and without limits. The robot of exercise 6 has
# $k_\omega = 4 \cdot 0.2/0.15 = 5.3$ per second: its limit of 1.5 rad/s holds from $|\alpha| =
# 0.28$ on, 16°. Farther off it turns as fast as it can, and no longer by this equation.

# %% [markdown] tags=["solution"]
# This is how the robots swing with the lesson's $k_\omega = 2$ at their own speeds:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels: on the left all three robots swing past the path, on the right all three come back without that."}}
# check_gains.draw(lambda speed, lookahead, damping: (speed / lookahead, 2.0))

# %% [markdown] tags=["statement"]
# ## Exercise 5: a memory without kinks
#
# The robot drives out and cannot keep all points. As in the lesson it grows a piece: as long as
# `smooth_fit` of all points since the knot passes each of them, at its own $\tau$, within the
# tolerance, the next point is taken. If one point is farther than the tolerance, the cubic
# *without* the newest point is stored. The next piece begins at that cubic's last point, and the
# newest point is its second. What is open at the end is stored too.
#
# What is new: a piece begins with the slope with which the last one *ended*, and the first piece
# with the direction of the robot's heading. A slope has two units here. *Per metre* of polygon:
# the heading's $(\cos\theta, \sin\theta)$, and what `smooth_fit` wants. *Per $\tau$*: $c'(\tau)$
# of a cubic, metres while $\tau$ goes from 0 to 1. From the second piece on the length of the
# slope per metre need not be 1: carry the slope along as it is, not its direction alone.
#
# That is all you write. The picture has a way of its own. The lesson's `remember` stores it in
# three cubics, with a kink of 41°; a robot drives along those, and along yours. It stays close, and
# drives at the speed that exercise 2's `bend` returns, 0.5 m/s at most. **Guess** before you unfold
# the picture: how many cubics are needed without kinks? How far from its curve does the robot come,
# with kinks and without? With which of them is it earlier at the end?
#
# <details><summary>How the picture's robot drives</summary>
#
# At the nearest point of the curve it takes the curvature $\kappa$ and the speed $v$ that `bend`
# returns (limits of 0.5 m/s and 1.35 rad/s), and corrects by how far it is to the left of the
# curve, $e$, and by how far it heads to the left of it, $\varphi$ (with exercise 4's pencil: the
# damping ratio is 1):
#
# $$
# \omega = v\,\kappa - v\,(e/\ell^2 + 2\varphi/\ell), \qquad \ell = 0.15\ \mathrm{m}.
# $$
#
# It turns at 1.5 rad/s at most.
#
# </details>


# %% tags=["exercise", "predict"]
def remember(points: Array, heading: float, tolerance: float) -> Array:
    """Cubics that pass all points of a way within a tolerance, without kinks.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        The way out (m), n at least 2, neighbours apart.
    heading : float
        Direction of the robot at the first point (rad).
    tolerance : float
        Largest distance of a point from the curve's point at its tau (m).

    Returns
    -------
    ndarray, shape (m, 4, 2)
        One cubic after the other, each as `smooth_fit` gives it.
    """
    t = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    slope = np.array([np.cos(heading), np.sin(heading)])
    cubics, first, last = [], 0, 1
    c = smooth_fit(points[:2], slope)
    for new in range(2, len(points)):
        run = slice(first, new + 1)
        longer = smooth_fit(points[run], slope)
        tau = (t[run] - t[first]) / (t[new] - t[first])
        away = np.hypot(*(tau[:, None] ** np.arange(4) @ longer - points[run]).T)
        if away.max() > tolerance:
            cubics.append(c)
            slope = (c[1] + 2 * c[2] + 3 * c[3]) / (t[last] - t[first])
            first = last
            longer = smooth_fit(points[first : new + 1], slope)
        c, last = longer, new
    return np.array([*cubics, c])


# %% active="ipynb" tags=["try"]
# remember(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]), 0.0, 0.05)

# %% [markdown] tags=["hint"]
# The loop is that of the lesson's `remember`, with one thing more to carry along: the slope at
# the knot. When does it change?

# %% [markdown] tags=["hint"]
# The slope of a cubic at its end, per $\tau$, is $c'(1) = c_1 + 2c_2 + 3c_3$. How many metres of
# polygon did this piece cover? The newest point is not one of its points.

# %% [markdown] tags=["hint"]
# A piece of two points always fits (both are held), and one of three points, too: its $\mu$ is
# free. So the test begins to matter with the fourth.


# %% tags=["cases"]
@drawn
def _walk(rng: np.random.Generator, n: int, tolerance: float) -> Any:
    heading = rng.uniform(-3, 3) + np.cumsum(rng.normal(0, 0.25, n))
    hops = rng.uniform(0.1, 0.3, n)[:, None]
    points = np.cumsum(hops * np.stack([np.cos(heading), np.sin(heading)], 1), 0)
    return points, float(heading[0]), tolerance


def _way_out() -> Array:
    """Points (n, 2) that a camera would note on a way of four metres, off by millimetres."""
    s = np.linspace(0, 1, 121)
    way = np.stack([2.4 * s, 0.9 * np.sin(6.0 * s) + 0.4 * s**2], 1)
    return np.round(way + np.random.default_rng(7).normal(0, 0.004, way.shape), 4)


def _ridden(
    cubics: Array, speed: float, theta: float, function: Function = bend
) -> tuple[Array, float, float]:
    """Places of a drive without look-ahead, its seconds, how far from the curve it comes (m)."""
    tau, limits = np.linspace(0, 1, 200), np.array([speed, 1.35])
    p = _curve(cubics[:, None], tau).reshape(-1, 2)
    found = [np.asarray(function(c, tau, limits), float) for c in cubics]
    kappa, fast = np.array(found).swapaxes(0, 1).reshape(2, -1)
    d = (tau[:, None] ** np.arange(3) @ (cubics[:, 1:] * [[1], [2], [3]])).reshape(-1, 2)
    s, along = np.append(0.0, np.cumsum(np.hypot(*np.diff(p, axis=0).T))), np.arctan2(*d.T[::-1])
    i, far, pose = 0, 0.0, [np.array([*p[0], theta])]
    while i < len(p) - 2 and len(pose) < 2000:
        x, y, theta = pose[-1]
        seen = slice(i, int(np.searchsorted(s, s[i] + 0.1)) + 1)
        i += int(np.hypot(p[seen, 0] - x, p[seen, 1] - y).argmin())
        e = (y - p[i, 1]) * np.cos(along[i]) - (x - p[i, 0]) * np.sin(along[i])
        omega = fast[i] * (kappa[i] - e / 0.15**2 - 2 * wrap_angle(theta - along[i]) / 0.15)
        half = 0.01 * min(max(omega, -1.5), 1.5)
        step = [0.02 * fast[i] * np.cos(half), 0.02 * fast[i] * np.sin(half), 2 * half]
        far, pose = max(far, abs(e)), [*pose, compose(pose[-1], step)]
    return np.array(pose)[:, :2], 0.02 * (len(pose) - 1), far


def _remember_drawn(ax: Any, function: Any) -> None:
    """Draw the points of a way, the cubics that are stored, and a drive along them (dashed).

    Below: the lesson's cubics, with kinks, and a drive along those.
    """
    from slamlab import plots

    points, blue = _way_out(), plots.COLOURS["estimate"]
    yours = np.asarray(function(points, 1.15, 0.03), float).reshape(-1, 4, 2)
    said = []
    for cubics, low in ((yours, 0.0), (_pieces(points, 1.15, 0.03), 2.3)):
        down = np.array([0.0, low])
        plots.lidar_points(ax, points - down, s=2)
        for c in cubics:
            plots.path(ax, _curve(c, np.linspace(0, 1, 40)) - down)
            ax.plot(*(_curve(c, [0.0, 1.0]) - down).T, "o", color=blue, markersize=5)
        places, seconds, far = _ridden(cubics, 0.5, 1.15)
        ax.plot(*(places - down).T, "--", color=plots.COLOURS["dead_reckoning"], lw=1.8)
        said += [f"{len(cubics)} cubics, largest kink {_kink(cubics):.0f}°,\n"
                 f"{1000 * far:.0f} mm from its curve, {seconds:.1f} s"]  # fmt: skip
    ax.set_title(said[0])
    ax.text(1.2, -1.12, "The lesson's: " + said[1], ha="center", va="center", fontsize=9.5)
    plots.floor(ax)
    ax.set(xlim=(-0.05, 2.45), ylim=(-2.85, 1.1))
    ax.figure.set_size_inches(7, 6.2)


check_remember = Check(
    remember,
    "cubics",
    {
        "two points make one cubic": ([[0.0, 0.0], [1.0, 2.0]], 0.8, 0.05),
        "a straight way needs one": ([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], 0.0, 1e-6),
        "a start that goes off sideways": ([[0, 0], [1, 0], [2, 0], [3, 0], [4, 0]], 1.2, 0.05),
        "a corner": (
            [[0, 0], [1, 0], [2, 0], [3, 0], [4, 0], [4, 1], [4, 2], [4, 3.0], [4, 4.0]],
            0.0,
            0.05,
        ),
        "a short way": _walk(8, 0.02),
        "a long way": _walk(40, 0.05),
        "121 points of a camera": (_way_out(), 1.15, 0.03),
    },
    tolerance=1e-6,
    picture=_remember_drawn,
)


# %% tags=["mistakes"]
def _pieces(points: Array, heading: float, tolerance: float) -> Any:
    """The lesson's memory: its pieces join with kinks."""
    cubics, first, last = [], 0, 1
    t = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    for new in range(2, len(points)):
        run = slice(first, new + 1)
        tau = (t[run] - t[first]) / (t[new] - t[first])
        away = np.hypot(*(_curve(_lesson_fit(points[run]), tau) - points[run]).T)
        if away.max() > tolerance:
            cubics.append(_lesson_fit(points[first : last + 1]))
            first = last
        last = new
    return np.array([*cubics, _lesson_fit(points[first:])])


check_remember.mistakes = {
    "these are the lesson's pieces, which join with kinks: use `smooth_fit`": _pieces,
    "each piece began with the robot's first heading: the slope goes on from the last piece": (
        "slope = (c[1] + 2 * c[2] + 3 * c[3]) / (t[last] - t[first]) => pass"
    ),
    "the slope at the end is per tau: divide by the metres of that piece": (
        " / (t[last] - t[first]) => "
    ),
    "the slope was divided by the way to the newest point: it is not on the stored piece": (
        "(t[last] - t[first]) => (t[new] - t[first])"
    ),
    "the slope was divided by all metres driven so far: expected those of its piece": (
        "(t[last] - t[first]) => t[last]"
    ),
    "the slope of the cubic that left the tolerance was carried on: expected the stored one's": (
        "slope = (c[1] + 2 * c[2] + 3 * c[3])"
        " => slope = (longer[1] + 2 * longer[2] + 3 * longer[3])"
    ),
    "only the direction was carried on: the slope has a length too, c'(1) over the metres": (
        "slope = (c[1] + 2 * c[2] + 3 * c[3]) / (t[last] - t[first])"
        " => slope = (c[1] + 2 * c[2] + 3 * c[3]) / np.hypot(*(c[1] + 2 * c[2] + 3 * c[3]))"
    ),
    "c'(1) = c_1 + 2 c_2 + 3 c_3: the factors are missing": (
        "c[1] + 2 * c[2] + 3 * c[3] => c[1] + c[2] + c[3]"
    ),
    "the last cubic is missing: what is open at the end of the way is stored too": (
        "[*cubics, c] => cubics"
    ),
    "the cubic that left the tolerance was stored: expected the one before it": (
        "cubics.append(c) => cubics.append(longer)"
    ),
    "the next piece begins at the newest point: it begins where the last one ends": (
        "first = last => first = new - 1 + (new < len(points) - 1)"
    ),
    "only the last point but one was tested: a longer cubic moves away from older ones too": (
        "away.max() => away[-2]"
    ),
    "the mean distance was tested: every point must be within the tolerance": (
        "away.max() => away.mean()"
    ),
    "the squared distance was compared with the tolerance": "away.max() => away.max() ** 2",
    "x and y were tested one by one: the distance in the plane counts": (
        "away = np.hypot(*(tau[:, None] ** np.arange(4) @ longer - points[run]).T)"
        " => away = np.abs(tau[:, None] ** np.arange(4) @ longer - points[run])"
    ),
    "tau of the test was counted in points: it grows with the length of the polygon": (
        "tau = (t[run] - t[first]) / (t[new] - t[first])"
        " => tau = np.linspace(0, 1, new + 1 - first)"
    ),
    "one cubic for the whole way: begin a new one where the tolerance is left": (
        lambda points, heading, tolerance: remember(points, heading, np.inf)
    ),
    "sine and cosine of the heading are exchanged": (
        "[np.cos(heading), np.sin(heading)] => [np.sin(heading), np.cos(heading)]"
    ),
    "the cubics are in the wrong order: the first begins at the first point": (
        lambda points, heading, tolerance: remember(points, heading, tolerance)[::-1]
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: a memory without kinks
#
# One thing more is carried along. The slope of the stored cubic at its end is $c'(1)$ per
# $\tau$; divided by the metres of its polygon it is per metre, and the next piece, however long,
# multiplies by its own.

# %% [markdown] tags=["solution"]
# The guesses: without kinks the way needs six cubics, with them three, and along the three the
# robot is at the end a second earlier. But at the kink it drives past: it turns as fast as it can,
# and comes 18 cm from a curve that was stored to 3 cm. The curvature tells it where to
# slow down; at a kink the curvature does not grow.
#
# Is it the kink? The same robot on the same pieces, one by one: it stops where one ends and turns
# on the spot. Twenty other ways, the same curve with other noise:

# %% active="ipynb" tags=["solution"]
# def lesson_fit(points):
#     t = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
#     tau, chord, free = t / t[-1], points[-1] - points[0], np.zeros((2, 2))
#     shapes = (tau * (1 - tau))[:, None] * np.stack([np.ones_like(tau), tau], 1)
#     rest, m = points - points[0] - tau[:, None] * chord, len(points) - 2
#     free[:m] = np.linalg.lstsq(shapes[:, :m], rest, rcond=None)[0]
#     lam, mu = free
#     c = np.array([points[0], chord + lam, mu - lam, -mu])
#     return c, np.hypot(*(tau[:, None] ** np.arange(4) @ c - points).T).max()

# %% active="ipynb" tags=["solution"]
# def with_kinks(points, heading, tolerance):
#     cubics, run = [], [points[0]]
#     for d in points[1:]:
#         if len(run) > 1 and lesson_fit(np.array([*run, d]))[1] > tolerance:
#             cubics.append(lesson_fit(np.array(run))[0])
#             run = run[-1:]
#         run.append(d)
#     return np.array([*cubics, lesson_fit(np.array(run))[0]])

# %% active="ipynb" tags=["solution"]
# def ride(cubics, theta):
#     """Seconds that the picture's robot drives; how far from the curve it comes (m)."""
#     tau, limits = np.linspace(0, 1, 200), np.array([0.5, 1.35])
#     p = (tau[:, None] ** np.arange(4) @ cubics).reshape(-1, 2)
#     slopes = cubics[:, 1:] * [[1], [2], [3]]                            # of c'
#     d = (tau[:, None] ** np.arange(3) @ slopes).reshape(-1, 2)
#     kappa, v = np.hstack([bend(c, tau, limits) for c in cubics])
#     s = np.append(0.0, np.cumsum(np.hypot(*np.diff(p, axis=0).T)))
#     along, pose = np.arctan2(d[:, 1], d[:, 0]), np.array([*p[0], theta])
#     i, n, far = 0, 0, 0.0
#     while i < len(p) - 2:
#         high = np.searchsorted(s, s[i] + 0.1)
#         i += np.hypot(*(p[i:high + 1] - pose[:2]).T).argmin()
#         x, y = pose[:2] - p[i]
#         e = y * np.cos(along[i]) - x * np.sin(along[i])
#         phi = wrap_angle(pose[2] - along[i])
#         omega = v[i] * (kappa[i] - e / 0.15**2 - 2 * phi / 0.15)
#         half, ds = 0.01 * np.clip(omega, -1.5, 1.5), 0.02 * v[i]
#         pose = compose(pose, [ds * np.cos(half), ds * np.sin(half), 2 * half])
#         n, far = n + 1, max(far, abs(e))
#     return 0.02 * n, far

# %% active="ipynb" tags=["solution"]
# def stop_and_turn(cubics, theta):
#     found = []
#     for c in cubics:
#         begin, end = c[1], c[1] + 2 * c[2] + 3 * c[3]
#         found.append(ride(c[None], np.arctan2(*begin[::-1])))
#         turn = abs(wrap_angle(np.arctan2(*begin[::-1]) - theta))
#         found.append((turn / 1.5, 0.0))
#         theta = np.arctan2(*end[::-1])
#     seconds, far = np.array(found).T
#     return seconds.sum(), far.max()

# %% active="ipynb" tags=["solution"]
# s = np.linspace(0, 1, 121)
# curve = np.stack([2.4 * s, 0.9 * np.sin(6.0 * s) + 0.4 * s**2], 1)
# rngs = [np.random.default_rng(seed) for seed in range(20)]
# ways = [curve + rng.normal(0, 0.004, curve.shape) for rng in rngs]
# for text, store, drive in (("without kinks", remember, ride),
#                            ("with kinks", with_kinks, ride),
#                            ("kinks, stops there", with_kinks, stop_and_turn)):
#     kept = [store(way, 1.15, 0.03) for way in ways]
#     seconds, far = np.array([drive(cubics, 1.15) for cubics in kept]).T
#     print(f"{text:19} {np.median([len(c) for c in kept]):g} cubics, "
#           f"{np.median(seconds):.1f} s, "
#           f"{100 * np.median(far):.0f} cm from the curve")

# %% [markdown] tags=["solution"]
# It is the kink: with a stop at each joint the robot stays on the same pieces. So this is what
# smoothness buys: a robot that drives close to its way need not stop. The price is twice the
# memory or more (each piece has one free factor in place of two) and sharper bends, where it slows
# down. No seconds are won here, where braking and starting again cost none.
#
# And it buys nothing for a law that looks ahead. The one of exercise 6 aims at a point 0.15 m on,
# rounds the kinks off, and ends as near to the start along the lesson's pieces: there half of the
# memory would do (the end of solution 6 counts it).

# %% [markdown] tags=["statement"]
# ## Exercise 6: the way home
#
# The radio link is gone, and the robot's memory is small: before it turns back it has to make
# room. It keeps the cubics that `remember` makes of its points (tolerance 0.05 m), and forgets the
# points: `turn_back(cubics)` does both, and from then on all of `points` is NaN. Then it drives
# home by the cubics alone, with what you have built: `steer` with limits of 0.2 m/s and 1.5 rad/s,
# and `gains` for 0.2 m/s, 0.15 m ahead and a damping ratio of 1 (tail first, and exercise 4 says
# why the gains hold).
#
# Loops stay in: it drives all of its way. A cut joins two places that only the odometer takes for
# one; past it the robot is beside its true way, 19 cm in the lesson.
#
# Four rules: three are the lesson's, the fourth stops earlier, at 0.03 m. The cubics become points
# at most 1 cm apart (400 in each cubic are enough here). The nearest point of the way is sought
# only in the 0.3 m before the last one found, towards the start (some centimetres to the other side
# do no harm, the whole way does); at first the end of the way is the last one found. $P_f$ is
# 0.15 m nearer to the start along the way, or the start itself if that is nearer. The robot stops
# when less than 0.03 m are left *along* the way, which may come past its start.
#
# `move` drives 0.1 s and returns what the odometer measured. This time it errs, on the way out
# and on the way home. The picture has one robot whose ways you see, and the ends of twelve.
# **Write down** before you unfold it: a way of 4.4 m, twelve robots. P3's forty all ended within
# 16 % of the length, 0.70 m here. How many of the twelve will? How far from the start are they, in
# the median? And where does the robot *believe* that it ends?


# %% tags=["exercise", "predict"]
def come_home(points: Array, heading: float, turn_back: Function) -> Array:
    """Drive home along the way that the robot came, by the cubics that it keeps.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        The way out as the odometer has it (m), neighbours apart; NaN once the robot
        has turned back.
    heading : float
        Direction of the robot at the first point (rad).
    turn_back : callable
        `pose, move = turn_back(cubics)`, to be called once: the robot keeps the
        cubics, an array (m, 4, 2), and forgets the points. `pose` (3,) is where it
        believes that it is: at the last point, and its heading. `move(v, omega)`
        drives for 0.1 s at a speed (m/s) and a turn rate (rad/s), and returns the
        pose afterwards in the frame of the pose before, as measured: an array (3,).
        `compose(pose, increment)` adds it up.

    Returns
    -------
    ndarray, shape (k, 3)
        The poses that the robot believed, from `pose` to the last.
    """
    cubics = remember(points, heading, 0.05)
    pose, move = turn_back(cubics)
    tau = np.linspace(0, 1, 400)[:, None] ** np.arange(4)
    way = (tau @ cubics).reshape(-1, 2)
    s = np.append(0.0, np.cumsum(np.hypot(*np.diff(way, axis=0).T)))
    law, limits = gains(0.2, 0.15, 1.0), (0.2, 1.5)
    near, believed = len(way) - 1, [pose]
    while s[near] > 0.03:
        low = np.searchsorted(s, s[near] - 0.3)
        near = low + np.hypot(*(way[low : near + 1] - believed[-1][:2]).T).argmin()
        ahead = way[np.searchsorted(s, s[near] - 0.15)]
        v, omega = steer(believed[-1], ahead, law, limits)
        believed.append(compose(believed[-1], move(v, omega)))
    return np.array(believed)


# %% active="ipynb" tags=["try"]
# points = np.stack([np.linspace(0, 1, 51), np.zeros(51)], 1)
# come_home(points, 0.0, lambda cubics: (
#     np.array([1.0, 0.0, 0.0]), lambda v, omega: np.array([0.1 * v, 0.0, 0.1 * omega])))

# %% [markdown] tags=["hint"]
# Points of all cubics at once: `tau[:, None] ** np.arange(4) @ cubics` has the shape (m, k, 2).
# Let an array `s` hold for each of these points how many metres it is from the start. (A cubic is
# not run through evenly: with 400 points the widest gap is 5 mm. Or space them with `np.interp` in
# `s`.)

# %% [markdown] tags=["hint"]
# Carry one index along, that of the nearest point found last. `s[index] - 0.3` and `s[index] -
# 0.15` are found in `s` by `np.searchsorted`, which gives 0 where the start is nearer than that.

# %% [markdown] tags=["hint"]
# One turn of the loop: seek the nearest point, take the point ahead, ask `steer` from where the
# robot *believes* to be, move, and compose. The loop ends by `s` of the nearest point.


# %% tags=["cases"]
def _arc(v: float, omega: float) -> Array:
    half = 0.05 * omega
    return np.array([0.1 * v * np.cos(half), 0.1 * v * np.sin(half), 0.1 * omega])


def _driven_out(start: Any, parts: Any, noise: Any, rng: Any) -> tuple[Array, Array]:
    """True and believed poses of a way out, made of (metres, turn in degrees) at 0.2 m/s."""
    true, believed = [np.array(start, float)], [np.array(start, float)]
    for metres, degrees in parts:
        steps = round(metres / 0.02)
        for _ in range(steps):
            step = _arc(0.2, np.deg2rad(degrees) / steps / 0.1)
            true.append(compose(true[-1], step))
            believed.append(compose(believed[-1], step + rng.normal(0, 1, 3) * noise))
    return np.array(true), np.array(believed)


class _Lost(Exception):
    """The robot has not come to rest."""


def _back(function: Any, true: Any, believed: Any, noise: Any, rng: Any) -> Any:
    """True poses of a way home, increments, what is kept, what is returned, what is wrong."""
    trail, seen, kept, faults, came = [true[-1]], list[Array](), list[Array](), list[str](), None

    def move(v: float, omega: float) -> Array:
        if len(seen) > 100 + 1.5 * len(true):
            raise _Lost
        step = _arc(float(v), float(omega))
        if abs(v) > 0.2 + 1e-9 or abs(omega) > 1.5 + 1e-9:
            faults.append(
                f"v = {v:.2f} m/s, omega = {omega:.2f} rad/s: the limits are 0.2 and 1.5"
            )
        trail.append(compose(trail[-1], step))
        seen.append(step + rng.normal(0, 1, 3) * noise)
        return seen[-1].copy()

    points = _noted(believed)

    def turn_back(cubics: Any) -> tuple[Array, Function]:
        kept.append(np.array(cubics, float))
        points[:] = np.nan
        return believed[-1].copy(), move

    try:
        came = function(points, float(believed[0, 2]), turn_back)
    except _Lost:
        off = float(np.hypot(*(trail[-1] - true[0])[:2]))
        faults.append(f"it is still driving after {0.1 * len(seen):.0f} s, {off:.2f} m from home")
    return np.array(trail), seen, kept, came, "".join(faults[:1])


def _noted(believed: Array) -> Array:
    """The points of a way out: every second step."""
    return np.vstack([believed[:-1:2, :2], believed[-1:, :2]])


def _kept_wrong(kept: list[Array], believed: Array) -> str:
    """Say what is wrong with what a robot keeps."""
    points = _noted(believed)
    if len(kept) != 1:
        return f"it turned back {len(kept)} times: call turn_back(cubics) once"
    if kept[0].ndim != 3 or kept[0].shape[1:] != (4, 2):
        return f"expected cubics of shape (m, 4, 2) to be kept, got shape {kept[0].shape}"
    asked = remember(points, believed[0, 2], 0.05)
    if kept[0].size > asked.size + 8:
        return f"it keeps {kept[0].size} numbers in place of {points.size}: expected {asked.size}"
    curve = _curve(kept[0][:, None], np.linspace(0, 1, 100)).reshape(-1, 2)
    off = np.hypot(*np.moveaxis(curve[:, None] - points, -1, 0)).min(0).max()
    if off > 0.055:
        return f"what it keeps is {100 * off:.0f} cm beside a point of its way: expected 5 cm"
    if kept[0].shape != asked.shape or np.abs(kept[0] - asked).max() > 1e-6:
        return "it does not keep the cubics of `remember` (0.05 m): does exercise 5's check pass?"
    return ""


_NOISE = np.array([0.002, 0.002, 0.018])
_START = (2.0, -1.0, 0.6)
_BENDS = ((1.0, 0), (0.785, 180), (0.8, 0), (0.785, -180), (1.0, 0))


def _fault(function: Function, start: Any, way_out: Any, noise: float, seed: int) -> str | None:
    """Drive out and home; say what is wrong, nothing if it is well."""
    rng = np.random.default_rng(seed)
    true, believed = _driven_out(start, way_out, noise * _NOISE, rng)
    _, seen, kept, came, wrong = _back(function, true, believed, noise * _NOISE, rng)
    if wrong or came is None:
        return wrong or None
    wrong = _kept_wrong(kept, believed)
    if wrong:
        return wrong
    poses = np.asarray(came, float)
    if poses.shape != (len(seen) + 1, 3):
        return f"{len(seen)} moves: expected {len(seen) + 1} poses, got shape {poses.shape}"
    due = [believed[-1]]
    for step in seen:
        due.append(compose(due[-1], step))
    off = np.abs(poses - due)
    off[:, 2] = np.abs(wrap_angle(off[:, 2]))
    if off.max() > 1e-6:
        return "the poses are not what the odometer measured: compose(pose, what `move` returned)"
    ways = np.hypot(*np.moveaxis(poses[:, None, :2] - believed[:, :2], -1, 0))
    left, missed, end = ways.min(1).max(), ways.min(0).max(), ways[-1, 0]
    front = np.mean([step[0] > 0 for step in seen]) if seen else 0.0
    if end > 0.045:
        return f"it stops where it believes that it is {100 * end:.0f} cm from home: 3 are asked"
    if end < 0.01:
        return f"it drives on to {100 * end:.1f} cm from home: stop where 3 cm of the way are left"
    if missed > 0.15:
        return f"it left out a part of its way, {missed:.2f} m from where it drove"
    if left > 0.10:
        return f"it drives {100 * left:.0f} cm beside its points, 10 are allowed"
    astray = 0.0 if noise else _astray(poses, believed)
    if astray > _ASTRAY:
        return (
            "a robot with your cubics, exercise 3's law and exercise 4's gains drives elsewhere, up"
            f" to {100 * astray:.1f} cm away: do you drive along the cubics, and do the checks of"
            " exercises 3 and 4 pass?"
        )
    if front > 0.1:
        return f"it drives front first {100 * front:.0f} % of the time: tail first is shorter"
    late = 0.1 * len(seen) - 5.05 * sum(metres for metres, _ in way_out)
    return f"it is {late:.0f} s slower than 0.2 m/s" if late > 6 else ""


_ASTRAY = 0.02


def _astray(poses: Array, believed: Array) -> float:
    """How far a drive by a perfect odometer is from ours, along the cubics of `remember` (m)."""
    ours = _back(come_home, believed, believed, np.zeros(3), np.random.default_rng(0))[0]
    gaps = np.hypot(*np.moveaxis(poses[:, None, :2] - ours[:, :2], -1, 0))
    return float(gaps.min(1).max())


def _come_home_drawn(ax: Any, function: Any) -> None:
    """Draw one robot: what it keeps, the way home that it believes and the true one.

    Below: where twelve robots end, enlarged. The dotted ring is at 16 % of the way's length.
    """
    from slamlab import plots

    ends, colours = [], plots.COLOURS
    blue, orange, black = colours["estimate"], colours["dead_reckoning"], colours["truth"]
    for seed in _TWELVE:
        rng = np.random.default_rng(seed)
        true, believed = _driven_out(np.zeros(3), _BENDS, _NOISE, rng)
        trail, _, kept, came, wrong = _back(function, true, believed, _NOISE, rng)
        poses = np.zeros((0, 3)) if wrong else np.asarray(came, float).reshape(-1, 3)
        ends.append(trail[-1, :2])
        if seed == _SHOWN:
            size, points = sum(one.size for one in kept[:1]), 2 * len(_noted(believed))
            plots.path(ax, true[:, :2], "truth", "way out", linewidth=1)
            stored = {"color": blue, "lw": 4, "alpha": 0.45}
            for c in kept[0].reshape(-1, 4, 2) if kept else ():
                ax.plot(*_curve(c, np.linspace(0, 1, 60)).T, **stored)
                ax.plot(*_curve(c, [0.0, 1.0]).T, "o", color=blue, ms=3)
            ax.plot([], [], **stored, label="cubics kept")
            ax.plot(*poses[:, :2].T, "--", lw=1.2, color=orange, label="home, believed")
            place = np.where(trail[:, 1:2] > -0.5, trail[:, :2], np.nan)  # below are the ends
            ax.plot(*place.T, "-", lw=1.6, color=orange, label="home, true")
            ax.plot(*place[-1], "s", color=orange, ms=7, label="its true end")
    ax.plot(0, 0, "*", color=black, markersize=11)
    off = np.hypot(*np.array(ends).T)
    plots.floor(ax)
    ax.set(xlim=(-0.5, 1.5), ylim=(-3.1, 1.35))
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 0.605), fontsize=8, frameon=False, ncols=2)
    limit, angle = 0.16 * 4.37, np.linspace(0, 2 * np.pi, 90)
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    middle, larger = np.array([0.5, -2.1]), 1.25
    ax.plot(*(middle + larger * limit * ring).T, ":", color=colours["wrong"])
    for seed, end in zip(_TWELVE, ends, strict=True):
        shown = {"color": orange, "marker": "s", "ms": 7} if seed == _SHOWN else {}
        shown = shown or {"color": black, "marker": "x", "ms": 6}
        if np.hypot(*end) < 1.2 * limit:
            ax.plot(*(middle + larger * end), ls="", **shown)
    ax.plot(*middle, "*", color=black, markersize=11)
    away = int(np.sum(off >= 1.2 * limit))
    text = f"twelve ends (ring: {limit:.2f} m)" + f",\n{away} too far off to be shown" * (away > 0)
    ax.text(0.5, -1.17, text, ha="center", fontsize=9)
    ax.set_yticks([0.0, 0.5, 1.0])
    ax.set_title(
        f"kept: {size} of {points} numbers,\n"
        f"{np.sum(off <= limit)} in ring, {np.median(off):.2f} m (median)"
    )
    ax.figure.set_size_inches(7, 7.2)


_TWELVE, _SHOWN = range(36, 48), 38

check_come_home = Check(
    come_home,
    "what is to be said",
    {
        "a straight way, a perfect odometer": ([0, 0, 0], ((1.0, 0),), 0, 0),
        "two bends": (_START, _BENDS, 0, 0),
        "a tight right angle": (_START, ((0.8, 0), (0.1, 90), (0.8, 0)), 0, 0),
        "a way that crosses itself: all of it": (_START, ((0.7, 0), (2.4, 450)), 0, 0),
        "a way that comes past its start": (
            [0, 0, 0],
            ((0.5, 0), (1.5 * np.pi * 0.5, 270), (1.2, 0)),
            0,
            0,
        ),
        "two bends, an odometer that errs": (_START, _BENDS, 1, 3),
        "to the right, an odometer that errs": (
            [1.0, 3.0, -2.0],
            ((0.6, -30), (0.6, -120), (0.8, 0)),
            0.7,
            5,
        ),
    },
    use=_fault,
    picture=_come_home_drawn,
)

# %% tags=["mistakes"]
_AHEAD = "way[np.searchsorted(s, s[near] - 0.15)]"
_MOVED = "compose(believed[-1], move(v, omega))"


def _straight(points: Array) -> Array:
    """A straight piece from each point to the next."""
    none = np.zeros_like(points[1:])
    return np.stack([points[:-1], np.diff(points, axis=0), none, none], 1)


check_come_home.mistakes = {
    "a straight piece for each point was kept, which is more than the points": (
        "remember(points, heading, 0.05) => _straight(points)"
    ),
    "the points were kept: expected the cubics of `remember`": (
        "turn_back(cubics) => turn_back(points)"
    ),
    "a copy of the points was driven along: what the robot keeps are the cubics": (
        "cubics = remember(points, heading, 0.05)"
        " => points, cubics = points.copy(), remember(points, heading, 0.05)",
        "(tau @ cubics).reshape(-1, 2) => points",
    ),
    "one cubic for the whole way was kept: the tolerance is 0.05 m": (
        "remember(points, heading, 0.05) => remember(points, heading, 5.0)"
    ),
    "the lesson's gains were taken: expected those of `gains` for 0.2 m/s, 0.15 m and 1": (
        "gains(0.2, 0.15, 1.0) => (1.0, 2.0)"
    ),
    "the nearest of all points was taken: at a crossing it is on another branch": (
        "low = np.searchsorted(s, s[near] - 0.3) => low, near = 0, len(way) - 1"
    ),
    "P_f is the nearest point itself: where the robot already is, it need not drive": (
        f"{_AHEAD} => way[near]"
    ),
    "P_f is nearer to the end, not to the start: the robot turns back": (
        f"{_AHEAD} => way[min(np.searchsorted(s, s[near] + 0.15), len(way) - 1)]"
    ),
    "the robot drives straight to the start, not along its way": f"{_AHEAD} => way[0]",
    "the increment was added as if it were in the world: it is in the frame of the robot": (
        f"{_MOVED} => believed[-1] + move(v, omega)"
    ),
    "the increment was composed on the wrong side: compose(pose, increment)": (
        f"{_MOVED} => compose(move(v, omega), believed[-1])"
    ),
    "what was commanded was added up: expected what the odometer measured": (
        f"{_MOVED} => compose(believed[-1], (move(v, omega), _arc(v, omega))[1])"
    ),
    "the law was asked from the first pose again and again: ask it from the latest": (
        "steer(believed[-1], ahead => steer(pose, ahead"
    ),
    "it stops too early: less than 0.03 m of the way must be left": (
        "s[near] > 0.03 => s[near] > 0.1"
    ),
    "the straight distance to the start was taken: what is left of the way counts": (
        "while s[near] > 0.03: => while np.hypot(*(believed[-1][:2] - way[0])) > 0.03:"
    ),
    "the nearest point was never sought again: the robot drives to one place": (
        "near = low + np.hypot(*(way[low : near + 1] - believed[-1][:2]).T).argmin()"
        " => near = near if len(believed) < 400 else 0"
    ),
    "the robot turns round and drives front first: let the law decide": (
        "compose(believed[-1], move(v, omega)) => compose(believed[-1], move(*_front_first("
        "believed[-1], ahead, law, limits)))"
    ),
    "only the last pose was returned: expected all of them": (
        "np.array(believed) => np.array(believed[-1])"
    ),
    "the pose at which the robot began is missing": (
        "np.array(believed) => np.array(believed[1:])"
    ),
}


def _front_first(pose: Any, point: Any, law: Any, limits: Any) -> tuple[float, float]:
    """The law without its tail."""
    dx, dy = point - pose[:2]
    alpha = wrap_angle(np.arctan2(dy, dx) - pose[2])
    return min(law[0] * np.hypot(dx, dy), limits[0]), np.clip(law[1] * alpha, -1.5, 1.5)


# %% [markdown] tags=["solution"]
# ## Solution 6: the way home
#
# Each of the twelve robots keeps 32 to 48 numbers in place of 220, and drives by them alone. With
# a copy of the points it would come home as well, but a way of an hour has thousands of them.
#
# The robot acts on the pose that it believes; its true place is known to the picture alone. In its
# own numbers (dashed) each of the twelve ends at the start. In truth (solid) it began beside the
# end of its cubics, turned, and it ends beside the start.
#
# All twelve are in the ring. Twelve are few: below are ten dozens, the picture's is the fourth.
# How far one may trust P3's 16 % depends on a noise that P3 does not print.
#
# Two errors add up: that of the way out, which comes home as a rigid motion, and that of the way
# home. Which of them counts more?

# %% active="ipynb" tags=["solution"]
# SIGMA = np.array([0.002, 0.002, 0.018])        # of the odometer, in 0.1 s
#
# def arc(v, omega):
#     half = 0.05 * omega
#     return np.array([0.1 * v * np.cos(half), 0.1 * v * np.sin(half), 0.1 * omega])
#
# def way_out(noise, rng):
#     """True pose at the end of the way, and all poses that the odometer adds up."""
#     true, log = np.zeros(3), [np.zeros(3)]
#     for n, turn in ((50, 0.0), (39, np.pi), (40, 0.0), (39, -np.pi), (50, 0.0)):
#         for _ in range(n):
#             step = arc(0.2, 10 * turn / n)
#             true = compose(true, step)
#             log.append(compose(log[-1], step + noise * SIGMA * rng.normal(0, 1, 3)))
#     return true, np.array(log)

# %% active="ipynb" tags=["solution"]
# def end(seed, noise_out, noise_home):
#     """Metres from the start at which a robot ends."""
#     rng = np.random.default_rng(seed)
#     true, log = way_out(noise_out, rng)
#     place = [true]
#
#     def move(v, omega):
#         step = arc(v, omega)
#         place.append(compose(place[-1], step))
#         return step + noise_home * SIGMA * rng.normal(0, 1, 3)
#
#     come_home(log[::2, :2].copy(), 0.0, lambda cubics: (log[-1], move))
#     return np.hypot(*place[-1][:2])

# %% active="ipynb" tags=["solution"]
# ends = np.array([end(seed, 1, 1) for seed in range(120)])
# inside = ends <= 0.70
# share, error = inside.mean(), inside.std() / len(ends)**0.5
# print("in the ring, ten dozens:", *inside.reshape(10, 12).sum(1))
# print(f"of all 120: {share:.1%}, standard error {error:.1%}")

# %% [markdown] tags=["solution"]
# By the first dozen one robot in six is lost, by most dozens none. Neither is true, and 120 drives
# still leave some per cent open.

# %% active="ipynb" tags=["solution"]
# def rms(noise_out, noise_home):
#     ends = [end(seed, noise_out, noise_home) for seed in range(0, 120, 3)]
#     return np.sqrt(np.mean(np.square(ends)))
#
# out, home, both = rms(1, 0), rms(0, 1), np.sqrt(np.mean(ends[::3] ** 2))
# print(f"RMS of 40 drives: out only {out:.2f} m, home only {home:.2f} m")
# print(f"added in squares {np.hypot(out, home):.2f} m, both {both:.2f} m")
# print(f"neither: {end(0, 0, 0):.2f} m")

# %% [markdown] tags=["solution"]
# They count about the same: 40 drives cannot tell which is larger. The two are independent, so
# they add in squares, not in metres: without one of them about $1/\sqrt2 \approx 0.7$ of the whole
# remains. With neither the robot ends 3 cm from the start, where it is to stop: that is all that a
# better law could win. The rest needs a robot that recognises a place (chapter
# [14](../14_scan_matching_and_hector.ipynb)).

# %% [markdown] tags=["solution"]
# And the kinks, which exercise 5 took so much care to avoid? The same 120 drives once more, along
# the lesson's pieces:

# %% active="ipynb" tags=["solution"]
# smooth, remember = remember, with_kinks     # of which `come_home` asks for its cubics
# kinked = np.array([end(seed, 1, 1) for seed in range(120)])
# remember = smooth
# for text, found in (("without kinks", ends), ("with kinks", kinked)):
#     print(f"{text}: {np.median(found):.2f} m from the start (median), "
#           f"{np.sum(found <= 0.70)} of 120 in the ring")

# %% [markdown] tags=["solution"]
# A mistake that costs more than both: the increments of the odometer added as if they were in the
# frame of the world. Such a robot leaves its way, and is still driving when the picture stops it:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels: on the left the robot leaves its way and drives off, on the right it ends beside the start."}}
# def in_the_world(points, heading, turn_back):
#     cubics = remember(points, heading, 0.05)
#     pose, move = turn_back(cubics)
#     tau = np.linspace(0, 1, 400)[:, None] ** np.arange(4)
#     way = (tau @ cubics).reshape(-1, 2)
#     s = np.append(0.0, np.cumsum(np.hypot(*np.diff(way, axis=0).T)))
#     near, believed = len(way) - 1, [pose]
#     while s[near] > 0.03:
#         low = np.searchsorted(s, s[near] - 0.3)
#         near = low + np.hypot(*(way[low:near + 1] - believed[-1][:2]).T).argmin()
#         ahead = way[np.searchsorted(s, s[near] - 0.15)]
#         v, omega = steer(believed[-1], ahead, gains(0.2, 0.15, 1.0), (0.2, 1.5))
#         believed.append(believed[-1] + move(v, omega))
#     return np.array(believed)
#
# check_come_home.draw(in_the_world)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 17](../solutions/17_the_way_home.ipynb).
