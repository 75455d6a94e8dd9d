"""Exercises, chapter 03: masts that hear a robot, from the predicted reading to the filter.

P5 (10)-(13), the extended filter, for another sensor than the lesson's: loop antennas that read
the line, of two directions the same, on which they hear a transmitter on the robot's boom.
"""

# mypy: disable-error-code="arg-type, assignment"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, drawn
from slamlab.exercises._report import Array, Check
from slamlab.geometry import wrap_angle

__all__ = [
    "check_first_fix",
    "check_follow",
    "check_innovation",
    "check_jacobian",
    "check_readings",
    "check_row_end",
]


# %% [markdown] tags=["chapter"]
# # Exercises 03: the extended Kalman filter
#
# One robot, six exercises. It mows between the trees of an orchard, where leaves weaken GPS, so
# it is followed as biologists follow wolves: it carries a small radio transmitter, and
# antennas on masts around the orchard hear it. You predict what a mast reads, compare, take the
# derivative, find a pose to begin with, repair a program with a bug, and drive with a filter of
# your own pieces. The chapter is [The extended Kalman
# filter](../03_extended_kalman_filter.ipynb). Replace each `...` and run the check below it as
# often as you like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 03: the extended Kalman filter
#
# The exercises are in [Exercises 03](../exercises/03_extended_kalman_filter.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: what a mast reads
#
# In the lesson the robot measures. Here it is measured, from outside, and at another point than
# the one whose pose it estimates: the transmitter is at the tip of a boom, `boom` metres ahead of
# the axle. Each mast has a loop antenna. It reads the direction of the line from the mast to the
# tip, counted counterclockwise from the x axis of the world, in radians.
#
# And it has a peculiarity: a loop hears as well ahead as behind. It reads a *line*, not a ray, so
# a tip in the direction of 130° is read as −50°: every reading is in $[-\pi/2, \pi/2]$. (Both
# ends are the same line; the check does not try them.)
#
# **On paper first.** The robot is at the origin and faces along x, its boom is 1 m long, a mast
# is at (2, −1). What does the mast read? And after the robot has turned right by 90° on the spot?


# %% tags=["exercise"]
def readings(pose: Array, masts: Array, boom: float) -> Array:
    """Predict what the masts read.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x (m), y (m) and heading (rad) of the axle, in the world.
    masts : ndarray, shape (n, 2)
        Positions in the world (m).
    boom : float
        How far ahead of the axle the transmitter is (m); negative: behind it.

    Returns
    -------
    ndarray, shape (n,)
        Direction of the line on which each mast hears the transmitter (rad), in
        [-pi/2, pi/2].
    """
    ahead = np.array([np.cos(pose[2]), np.sin(pose[2])])
    dx, dy = (pose[:2] + boom * ahead - masts).T
    return np.arctan(dy / dx)


# %% active="ipynb" tags=["try"]
# readings(np.array([0.0, 0.0, 0.0]), np.array([[2.0, -1.0]]), 1.0)

# %% [markdown] tags=["hint"]
# Three places: the axle, the tip, the mast. In which of them does the heading of the robot count?

# %% [markdown] tags=["hint"]
# `masts` has one row a mast. A point less an array of shape (n, 2) gives n differences at once,
# and `dx, dy = (...).T` takes its two columns.

# %% [markdown] tags=["hint"]
# The lesson takes `arctan2`, so that a landmark behind is not confused with one ahead. This
# antenna does confuse them. Which function of $d_y/d_x$ does the same?


# %% tags=["cases"]
def _scene(rng: np.random.Generator) -> Any:
    return a_pose(rng), np.round(rng.uniform(-9, 9, (3, 2)), 2), np.round(rng.uniform(0.3, 2), 2)


def _readings_drawn(ax: Any, function: Any) -> None:
    """Draw a robot with its boom, three masts, and through each mast the line that it reads."""
    from slamlab import plots

    pose, masts = np.array([1.0, 0.5, 2.2]), np.array([[-5.0, 0.5], [4.0, -3.5], [3.5, 5.0]])
    angles = np.asarray(function(pose, masts, 1.8), float)
    for mast, angle in zip(masts, angles, strict=True):
        ends = mast + np.outer([-14, 14], [np.cos(angle), np.sin(angle)])
        plots.path(ax, ends, "lidar", linewidth=1.2)
    tip = pose[:2] + 1.8 * np.array([np.cos(pose[2]), np.sin(pose[2])])
    plots.path(ax, np.array([pose[:2], tip]), "truth", linewidth=3)
    ax.plot(*pose[:2], "o", color=plots.COLOURS["truth"], markersize=8)
    plots.landmarks(ax, masts)
    plots.floor(ax)
    ax.set(xlim=(-6, 6), ylim=(-5, 6))


check_readings = Check(
    readings,
    "readings",
    {
        "the call below the stub": ([0, 0, 0], [[2, -1]], 1.0),
        "the robot has turned right by 90°": ([0, 0, -np.pi / 2], [[2.5, -1.5]], 1.0),
        "no boom": ([1.0, 2.0, 0.6], [[4.0, 3.0], [-2.0, -5.0]], 0.0),
        "the transmitter behind the axle": ([1.0, 2.0, 0.4], [[-2.0, 1.0], [5.0, 2.5]], -0.8),
        "a mast between the axle and the tip": ([0.0, 0.0, 0.3], [[0.8, 0.2]], 2.0),
        "three masts, anywhere": _scene,
    },
    picture=_readings_drawn,
)

# %% tags=["mistakes"]
_LINE, _TIP = "np.arctan(dy / dx)", "pose[:2] + boom * ahead"

check_readings.mistakes = {
    "these are rays, in (-pi, pi]: the antenna reads a line, in [-pi/2, pi/2]": (
        f"{_LINE} => np.arctan2(dy, dx)"
    ),
    "these are lines in [0, pi): expected [-pi/2, pi/2]": (
        f"{_LINE} => np.arctan2(dy, dx) % np.pi"
    ),
    "the heading was subtracted: a mast reads in the world, it does not turn with the robot": (
        f"{_LINE} => wrap_angle(2 * (np.arctan2(dy, dx) - pose[2])) / 2"
    ),
    "the heading was subtracted from a ray, as in the lesson: a mast does not turn": (
        f"{_LINE} => wrap_angle(np.arctan2(dy, dx) - pose[2])"
    ),
    "the transmitter was put at the axle: it is at the tip of the boom": (
        f"{_TIP} => pose[:2] + 0 * ahead"
    ),
    "the boom was laid along x: it turns with the robot": f"{_TIP} => pose[:2] + [boom, 0.0]",
    "the boom points to the left: ahead is (cos, sin) of the heading": (
        "np.cos(pose[2]), np.sin(pose[2]) => -np.sin(pose[2]), np.cos(pose[2])"
    ),
    "cosine and sine are exchanged: ahead is (cos, sin) of the heading": (
        "np.cos(pose[2]), np.sin(pose[2]) => np.sin(pose[2]), np.cos(pose[2])"
    ),
    "the boom points backwards: the transmitter is ahead of the axle": (
        f"{_TIP} => pose[:2] - boom * ahead"
    ),
    "the fraction is upside down: the direction has dy over dx": f"{_LINE} => np.arctan(dx / dy)",
    "the place of the masts was forgotten: a reading is from the mast to the tip": (
        "boom * ahead - masts => boom * ahead - 0 * masts"
    ),
    "the place of the robot was forgotten: the boom begins at the axle": (
        f"{_TIP} => boom * ahead"
    ),
    "wrapped into [-pi/2, pi/2] by clipping: a ray and its opposite are one line": (
        f"{_LINE} => np.clip(np.arctan2(dy, dx), -np.pi / 2, np.pi / 2)"
    ),
    "this is the slope dy / dx: expected its angle": f"{_LINE} => dy / dx",
    "this is the lesson's bearing, from the robot to the mast: here the mast measures, a line in "
    "the world": f"{_LINE} => np.arctan2(-dy, -dx) - pose[2]",
    "this is the lesson's bearing, wrapped: here the mast measures, a line in the world": (
        f"{_LINE} => wrap_angle(np.arctan2(-dy, -dx) - pose[2])"
    ),
    "this is the lesson's bearing, from the axle to the mast: here the mast measures, the tip": (
        f"{_LINE} => np.arctan2(-dy, -dx) - pose[2]",
        f"{_TIP} => pose[:2] + 0 * ahead",
    ),
    "this is the lesson's bearing, from the axle and wrapped: here the mast measures, the tip": (
        f"{_LINE} => wrap_angle(np.arctan2(-dy, -dx) - pose[2])",
        f"{_TIP} => pose[:2] + 0 * ahead",
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: what a mast reads
#
# From the axle along the heading to the tip, from there the difference to each mast. The heading
# is in it once, in the boom, and is not subtracted: the masts do not turn. On paper the tip is at
# (1, 0), a metre to the left of the mast and a metre above it: 135°, read as −45°. After the turn
# it is at (0, −1), straight to the left of the mast: 180°, read as 0.

# %% [markdown] tags=["solution"]
# `arctan` of a quotient loses the quadrant; here that is what the antenna does. A ray to a tip on
# the left of the mast differs from what is read by half a turn:

# %% active="ipynb" tags=["solution"]
# def rays(pose, masts, boom):
#     ahead = np.array([np.cos(pose[2]), np.sin(pose[2])])
#     dx, dy = (pose[:2] + boom * ahead - masts).T
#     return np.arctan2(dy, dx)
#
# check_readings(rays)

# %% [markdown] tags=["statement"]
# ## Exercise 2: the innovation of a line
#
# The robot passes north of a mast. The mast reads 89°, the filter predicted −89°. As bearings
# these differ by 178°, and the lesson's `wrap_angle` leaves that as it is: the filter would throw
# the robot across the orchard. As lines they are 2° apart.
#
# Write the innovation of lines: the smallest turn that carries the predicted line into the
# measured one, counterclockwise positive. Two directions that differ by half a turn, or by any
# number of half turns, are the same line, in `z` as in `predicted`. (Lines at right angles have no
# smallest turn; the check does not try them.) What you write compares walls and doors as well.
#
# In the picture a robot drives once round a mast, always 8° ahead of where the filter predicts it.
# So the innovation must be 8° all the way round.


# %% tags=["exercise"]
def innovation(z: Array, predicted: Array) -> Array:
    """Compare readings with their predictions, as lines.

    Parameters
    ----------
    z, predicted : ndarray, shape (n,)
        Directions of lines (rad), not only from [-pi/2, pi/2].

    Returns
    -------
    ndarray, shape (n,)
        Turns from predicted to measured (rad), in (-pi/2, pi/2).
    """
    return wrap_angle(2 * (z - predicted)) / 2


# %% active="ipynb" tags=["try"]
# innovation(np.deg2rad([89.0, 12.0]), np.deg2rad([-89.0, 10.0]))

# %% [markdown] tags=["hint"]
# `wrap_angle` takes away full turns. You want to take away half turns. What becomes of half a turn
# when every angle is doubled?

# %% [markdown] tags=["hint"]
# Three steps: subtract, double and wrap, and then undo what you did to the size of the angle.


# %% tags=["cases"]
def _line_pairs(rng: np.random.Generator) -> Any:
    predicted = np.round(rng.uniform(-3, 3, 4), 2)
    turns = np.round(rng.uniform(-1.5, 1.5, 4), 2)
    return predicted + turns + np.pi * rng.integers(-1, 2, 4), predicted


def _innovation_drawn(ax: Any, function: Any) -> None:
    """Draw the innovation while a robot drives round a mast, 8° ahead of its prediction."""
    from slamlab import plots

    predicted = np.deg2rad(np.arange(0.0, 360.0, 5.0))
    z = np.arctan(np.tan(predicted + np.deg2rad(8)))
    turns = np.asarray(function(z, np.arctan(np.tan(predicted))), float)
    ax.plot(np.rad2deg(predicted), np.rad2deg(turns), "o-", color=plots.COLOURS["estimate"], ms=3)
    ax.set(xlabel="direction from the mast (°)", ylabel="innovation (°)", ylim=(-190, 190))


check_innovation = Check(
    innovation,
    "innovation",
    {
        "a plain difference": ([0.3, -0.2], [0.2, -0.1]),
        "89° measured, −89° predicted, and the other way": (
            np.deg2rad([89.0, -89.0]),
            np.deg2rad([-89.0, 89.0]),
        ),
        "more than 90° apart, to either side": ([1.2, -1.2, 0.9], [-1.0, 0.8, -1.3]),
        "a ray and its opposite are one line": ([0.4, -2.9], [0.3 + np.pi, 0.2]),
        "almost a full turn apart": ([3.0, -3.0], [-3.1, 3.05]),
        "four lines": _line_pairs,
    },
    picture=_innovation_drawn,
)

# %% tags=["mistakes"]
_TURN = "wrap_angle(2 * (z - predicted)) / 2"

check_innovation.mistakes = {
    "the difference is not wrapped: 89° and −89° are 2° apart": f"{_TURN} => z - predicted",
    "wrapped as a bearing: for a line half a turn is nothing": (
        f"{_TURN} => wrap_angle(z - predicted)"
    ),
    "doubled and wrapped, and not halved again": f"{_TURN} => wrap_angle(2 * (z - predicted))",
    "both were wrapped first and the difference is not": (
        f"{_TURN} => wrap_angle(2 * z) / 2 - wrap_angle(2 * predicted) / 2"
    ),
    "wrapped to [0, pi): a small turn to the right became a large one to the left": (
        f"{_TURN} => (z - predicted) % np.pi"
    ),
    "the sign is reversed: measured less predicted": (
        f"{_TURN} => wrap_angle(2 * (predicted - z)) / 2"
    ),
    "the sign was lost: a turn to the right is negative": (
        f"{_TURN} => np.abs(wrap_angle(2 * (z - predicted))) / 2"
    ),
    "this is the sine of the turn: it is nearly the turn while that is small": (
        f"{_TURN} => np.sin(wrap_angle(2 * (z - predicted)) / 2)"
    ),
    "this is the tangent of the turn: it is nearly the turn while that is small": (
        f"{_TURN} => np.tan(z - predicted)"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: the innovation of a line
#
# Doubled, half a turn is a full one, which `wrap_angle` takes away; halved, the angle has its size
# again. The same three steps compare whatever has a direction and no front.

# %% [markdown] tags=["solution"]
# Wrapping both readings first looks careful. Both are in $[-\pi/2, \pi/2]$ already, so it changes
# nothing that comes from an antenna, and the difference is as wrong as before:

# %% active="ipynb" tags=["solution"]
# def wrapped_too_early(z, predicted):
#     return wrap_angle(2 * z) / 2 - wrap_angle(2 * predicted) / 2
#
# check_innovation(wrapped_too_early)

# %% [markdown] tags=["statement"]
# ## Exercise 3: the Jacobian of a robot that is heard
#
# How does each reading change when the axle moves a little along x, along y, or when the robot
# turns a little? The lesson's bearing has −1 in the column of the heading: turn left by one degree
# and every landmark moves one degree to the right. Is it so here?
#
# **On paper first.** What is that column if the boom has no length? With the boom straight away
# from the mast, does a small turn to the left make the reading larger or smaller? And with the
# boom across the line, at a right angle? The picture shows whether your matrix is a tangent: 1000
# robots that might be there, and the ellipse of $J P J^\top$.


# %% tags=["exercise"]
def jacobian(pose: Array, masts: Array, boom: float) -> Array:
    """Derivative of `readings` with respect to the pose.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x (m), y (m) and heading (rad) of the axle.
    masts : ndarray, shape (n, 2)
        Positions in the world (m).
    boom : float
        How far ahead of the axle the transmitter is (m); negative: behind it.

    Returns
    -------
    ndarray, shape (n, 3)
        One row a mast. Columns: x, y, heading.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    dx, dy = (pose[:2] + boom * np.array([c, s]) - masts).T
    q = dx**2 + dy**2
    return np.column_stack([-dy / q, dx / q, boom * (dx * c + dy * s) / q])


# %% active="ipynb" tags=["try"]
# jacobian(np.array([0.0, 0.0, 0.0]), np.array([[-3.0, 0.0], [2.0, -4.0]]), 1.0)

# %% [markdown] tags=["hint"]
# Folding a ray to a line adds a constant. What does that do to a derivative?

# %% [markdown] tags=["hint"]
# For the direction $\varphi = \operatorname{atan2}(d_y, d_x)$: $\partial\varphi/\partial d_x =
# -d_y/\rho^2$ and $\partial\varphi/\partial d_y = d_x/\rho^2$ with $\rho^2 = d_x^2 + d_y^2$. From
# mast to tip, how do $d_x$ and $d_y$ change with x and with y?

# %% [markdown] tags=["hint"]
# A turn moves the tip and nothing else: differentiate $b\cos\theta$ and $b\sin\theta$, with $b$
# the length of the boom, and chain them to the two derivatives of the hint before.


# %% tags=["cases"]
def _jacobian_drawn(ax: Any, function: Any) -> None:
    """Draw what two masts read of 1000 uncertain robots, and the ellipse of J P J^T."""
    from slamlab import plots

    rng, masts = np.random.default_rng(1), np.array([[-4.0, -1.0], [2.0, -4.5]])
    pose, boom = np.array([0.5, -0.4, 0.4]), 1.5
    # Its heading is correlated with its place: the sign of a column shows.
    P = np.array([[0.006, -0.003, -0.006], [-0.003, 0.014, 0.012], [-0.006, 0.012, 0.0144]])
    robots = rng.multivariate_normal(pose, P, 1000)
    J = np.rad2deg(np.asarray(function(pose, masts, boom), float))
    cloud = np.array(
        [innovation(readings(r, masts, boom), readings(pose, masts, boom)) for r in robots]
    )
    plots.lidar_points(ax, np.rad2deg(cloud), s=1.6)
    plots.ellipse(ax, [0, 0], J @ P @ J.T)
    ax.set(xlabel="first mast, error (°)", ylabel="second mast, error (°)")


check_jacobian = Check(
    jacobian,
    "J",
    {
        "the call below the stub": ([0, 0, 0], [[-3, 0], [2, -4]], 1.0),
        "no boom: a turn changes nothing": ([1.0, 2.0, 0.6], [[4.0, 6.0], [-2.0, 1.0]], 0.0),
        "the boom away from the mast": ([0.0, 0.0, 0.5], [[-4.0, -2.2]], 1.5),
        "the boom towards the mast": ([0.0, 0.0, 0.5], [[4.0, 2.2]], 1.5),
        "the transmitter behind the axle": ([1.0, 2.0, -2.0], [[-2.0, 1.0], [5.0, 2.5]], -0.8),
        "a mast near the tip": ([0.0, 0.0, 1.0], [[1.0, 1.4]], 1.0),
        "three masts, anywhere": _scene,
    },
    tolerance=1e-4,
    picture=_jacobian_drawn,
)

# %% tags=["mistakes"]
_BY_TURN = "boom * (dx * c + dy * s) / q"

check_jacobian.mistakes = {
    "the last column is that of the lesson: a mast does not turn with the robot": (
        f"{_BY_TURN} => -np.ones_like(q)"
    ),
    "the last column has the lesson's −1 beside the boom: a mast does not turn": (
        f"{_BY_TURN} => {_BY_TURN} - 1"
    ),
    "the last column is zero: a turn moves the tip of the boom": f"{_BY_TURN} => 0 * q",
    "the sign of the last column is reversed: a turn to the left moves the tip to the left": (
        f"{_BY_TURN} => -{_BY_TURN}"
    ),
    "the last column belongs to a boom of 1 m: multiply by its length": (
        f"{_BY_TURN} => (dx * c + dy * s) / q"
    ),
    "the last column counts how the tip moves along the line: it is the motion across it": (
        "(dx * c + dy * s) => (dx * s - dy * c)"
    ),
    "a sign in the last column: the derivative of the cosine is minus the sine": (
        "(dx * c + dy * s) => (dx * c - dy * s)"
    ),
    "the signs are those of the lesson, where the robot measures: here it is measured": (
        "-dy / q, dx / q => dy / q, -dx / q"
    ),
    "d is taken from the mast to the axle: the transmitter is at the tip": (
        "boom * np.array([c, s]) => 0 * np.array([c, s])"
    ),
    "divided by the distance: a direction changes with one over its square, times d": (
        "q = dx**2 + dy**2 => q = np.sqrt(dx**2 + dy**2)"
    ),
    "dx and dy are exchanged": "-dy / q, dx / q => dx / q, -dy / q",
    "this is how the distance changes: expected the direction": (
        "-dy / q, dx / q, boom * (dx * c + dy * s) / q"
        " => dx / np.sqrt(q), dy / np.sqrt(q), boom * (dy * c - dx * s) / np.sqrt(q)"
    ),
    "this is the transpose: one row a mast": lambda p, m, b: jacobian(p, m, b).T,
}

# %% [markdown] tags=["solution"]
# ## Solution 3: the Jacobian of a robot that is heard
#
# Folding adds a constant, so the derivative is that of the ray. The first two columns are the
# lesson's with the signs turned round: the robot is now at the other end of $d$. The heading works
# through the boom alone. With $\varphi$ the direction from mast to tip its column is
# $b\cos(\theta - \varphi)/\rho$: nothing without a boom, largest when the boom points away from
# the mast, nothing when it lies across the line, negative when it points at the mast.

# %% [markdown] tags=["solution"]
# With the column of the lesson, −1, each reading would count as one of the heading. The check
# names it; what it costs is at the end of this page.

# %% active="ipynb" tags=["solution"]
# def as_in_the_lesson(pose, masts, boom):
#     return np.column_stack([jacobian(pose, masts, boom)[:, :2], -np.ones(len(masts))])
#
# check_jacobian(as_in_the_lesson)

# %% [markdown] tags=["statement"]
# ## Exercise 4: where to begin?
#
# In the morning the robot is switched on somewhere in the orchard. A filter needs a mean and a
# covariance to begin with, and there is neither. The motors are off, so the compass can be read,
# and two masts hear the transmitter. Two lines and a heading: exactly one pose agrees with them.
# (That an antenna cannot tell ahead from behind does no harm here. Why?)
#
# A point $(x, y)$ is on the line through the mast $(m_x, m_y)$ in the direction $z$ if
#
# $$-\sin z\,(x - m_x) + \cos z\,(y - m_y) = 0 .$$
#
# And how sure is it? The three readings together have the covariance $R$. The pose is a function
# of the readings, the inverse of one whose tangent you have: three readings from a pose. The
# tangent of an inverse function is the inverse matrix.
#
# In the picture the robot is switched on 300 times at one place, and each dot is a fix that you
# found from noisy readings. Every fix has its own 95 % ellipse (one is drawn); the title says how
# many of the 300 ellipses hold the true place. With a right covariance it is about 95 %.


# %% tags=["exercise"]
def first_fix(
    z: Array, masts: Array, boom: float, compass: float, R: Array
) -> tuple[Array, Array]:
    """Find the pose that agrees with two lines and a compass, and its covariance.

    Parameters
    ----------
    z : ndarray, shape (2,)
        What the two masts read (rad); the lines are not parallel.
    masts : ndarray, shape (2, 2)
        One row a mast (m).
    boom : float
        How far ahead of the axle the transmitter is (m).
    compass : float
        Heading that was read (rad), in (-pi, pi].
    R : ndarray, shape (3, 3)
        Covariance of the first line, the second line and the compass.

    Returns
    -------
    mean : ndarray, shape (3,)
        x, y and heading of the axle.
    cov : ndarray, shape (3, 3)
    """
    across = np.column_stack([-np.sin(z), np.cos(z)])
    tip = np.linalg.solve(across, np.sum(across * masts, axis=1))
    mean = np.append(tip - boom * np.array([np.cos(compass), np.sin(compass)]), compass)
    back = np.linalg.inv(np.vstack([jacobian(mean, masts, boom), [0.0, 0.0, 1.0]]))
    return mean, back @ R @ back.T


# %% active="ipynb" tags=["try"]
# first_fix(np.deg2rad([45.0, -45.0]), np.array([[-3.0, -3.0], [3.0, -3.0]]), 1.0, 0.0,
#           np.diag([0.03, 0.03, 0.02]) ** 2)

# %% [markdown] tags=["hint"]
# Two lines are two equations for the two unknowns of one point. Of which point of the robot? Write
# them as $A\,(x, y)^\top = b$ and let `np.linalg.solve` do the rest.

# %% [markdown] tags=["hint"]
# $b$ is what $A$ makes of each mast's own position. From the point that you found the heading
# leads back to the axle.

# %% [markdown] tags=["hint"]
# How do *three* readings change with the pose? Your `jacobian` has the rows of the masts; the row
# of a compass has three numbers that you know without a pencil. If $e_z = J e_x$, what is $e_x$,
# and what its covariance?


# %% tags=["cases"]
@drawn
def _morning(rng: np.random.Generator, behind: bool = False) -> Any:
    """Draw two masts and what they read of a robot, where their lines cross at a good angle."""
    boom = float(np.round(rng.uniform(0.3, 2), 2)) * (-1 if behind else 1)
    while True:
        pose, masts = a_pose(rng), np.round(rng.uniform(-9, 9, (2, 2)), 2)
        z = readings(pose, masts, boom)
        far = np.hypot(*(pose[:2] - masts).T).min() > 3
        if far and abs(innovation(z[:1], z[1:])[0]) > 0.4:
            return np.round(z, 3), masts, boom, pose[2], a_covariance(rng, 3) / 1000


def _fix_drawn(ax: Any, function: Any) -> None:
    """Draw two masts, their lines, 300 first fixes from noisy readings, and a 95 % ellipse."""
    from slamlab import plots

    rng, boom = np.random.default_rng(3), 1.8
    pose, masts = np.array([0.0, 0.0, 0.9]), np.array([[-3.0, 1.5], [2.5, -2.5]])
    R = np.diag(np.deg2rad([3.0, 3.0, 8.0])) ** 2
    exact = np.append(readings(pose, masts, boom), pose[2])
    found = [
        function(read[:2], masts, boom, float(read[2]), R)
        for read in exact + rng.multivariate_normal(np.zeros(3), R, 300)
    ]
    mean, cov = function(exact[:2], masts, boom, float(exact[2]), R)
    means = np.array([np.asarray(one[0], float) for one in found])
    inside = [
        (e := m[:2] - pose[:2]) @ np.linalg.solve(np.asarray(P, float)[:2, :2], e) < 5.991
        for m, (_, P) in zip(means, found, strict=True)
    ]
    plots.lidar_points(ax, means[:, :2], s=2.0)
    plots.ellipse(ax, np.asarray(mean, float)[:2], np.asarray(cov, float)[:2, :2])
    tip = pose[:2] + boom * np.array([np.cos(pose[2]), np.sin(pose[2])])
    for mast in masts:
        plots.path(ax, np.array([mast, tip]), "lidar", linewidth=1.0)
    plots.path(ax, np.array([pose[:2], tip]), "truth", linewidth=2.5)
    plots.landmarks(ax, masts)
    plots.floor(ax)
    ax.set_title(f"{np.mean(inside):.0%} of the ellipses\nhold the robot")


check_first_fix = Check(
    first_fix,
    "mean, cov",
    {
        "two lines at a right angle": (
            np.deg2rad([45.0, -45.0]),
            [[-3, -3], [3, -3]],
            1.0,
            0.0,
            np.diag([0.03, 0.02, 0.01]) ** 2,
        ),
        "no boom": ([0.3, -1.1], [[-6.0, -1.0], [3.0, 5.0]], 0.0, 2.0, 0.001 * np.eye(3)),
        "one line is twice as good": (
            [0.3, 1.2],
            [[-6.0, -1.0], [2.0, -5.0]],
            0.8,
            -1.0,
            np.diag([0.02, 0.04, 0.05]) ** 2,
        ),
        "the transmitter behind the axle": _morning(True),
        "any morning, errors that are correlated": _morning(),
    },
    tolerance=1e-5,
    picture=_fix_drawn,
)

# %% tags=["mistakes"]
_AXLE = "tip - boom * np.array([np.cos(compass), np.sin(compass)])"

check_first_fix.mistakes = {
    "this is the tip of the boom: the pose is that of the axle": f"{_AXLE} => tip",
    "the boom was added: the axle is behind the tip": _AXLE + " => " + _AXLE.replace("-", "+"),
    "cosine and sine are exchanged on the way back to the axle": (
        "np.cos(compass), np.sin(compass) => np.sin(compass), np.cos(compass)"
    ),
    "this is J R J^T, which carries a covariance from the pose to the readings": (
        "np.linalg.inv(np.vstack([jacobian(mean, masts, boom), [0.0, 0.0, 1.0]]))"
        " => np.vstack([jacobian(mean, masts, boom), [0.0, 0.0, 1.0]])"
    ),
    "the inverse is on the wrong side: J^-1 R J^-T": "back @ R @ back.T => back.T @ R @ back",
    "this is J^T R^-1 J, the information: expected the covariance, its inverse": (
        "back @ R @ back.T => np.linalg.inv(back @ R @ back.T)"
    ),
    "this is R: it must go through the tangent": "back @ R @ back.T => R",
    "J was taken at the tip: expected at the pose of the axle": (
        "jacobian(mean, masts, boom) => jacobian(np.append(tip, compass), masts, boom)"
    ),
    "the covariance is that of a robot without a boom": (
        "jacobian(mean, masts, boom) => jacobian(mean, masts, 0.0)"
    ),
    "the covariance of x and y is that of the tip: a heading error swings the boom": (
        "jacobian(mean, masts, boom) => jacobian(mean, masts, boom) * [1, 1, 0]"
    ),
    "the covariance has the lesson's column −1: a mast does not turn with the robot": (
        "jacobian(mean, masts, boom)"
        " => np.column_stack([jacobian(mean, masts, boom)[:, :2], [-1.0, -1.0]])"
    ),
    "sine and cosine of the lines are exchanged": (
        "[-np.sin(z), np.cos(z)] => [-np.cos(z), np.sin(z)]"
    ),
    "a sign in the equation of the line: -sin z and cos z": (
        "[-np.sin(z), np.cos(z)] => [np.sin(z), np.cos(z)]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: where to begin?
#
# Each line is one equation, and a line turned by 180° has the same equation with all its signs
# changed: that is why the peculiarity of the antenna does no harm. The two equations give the tip,
# the compass leads back to the axle. A small error of the pose makes $e_z = J e_x$, so $e_x =
# J^{-1} e_z$, and its covariance is $J^{-1} R J^{-\top}$. The robot need not be carried to a known
# place in the morning.

# %% [markdown] tags=["solution"]
# The lines give the tip; the axle depends on the compass as well, through the boom. With a zero in
# that column of $J$ the ellipse is that of the tip, and the picture counts how many of 300 such
# ellipses hold the robot, of which 95 % are expected:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: two masts, their lines, 300 fixes; in the left one the ellipse is too small for the cloud."}}
# def of_the_tip(z, masts, boom, compass, R):
#     mean, _ = first_fix(z, masts, boom, compass, R)
#     J = np.vstack([jacobian(mean, masts, boom) * [1, 1, 0], [0.0, 0.0, 1.0]])
#     return mean, np.linalg.inv(J) @ R @ np.linalg.inv(J).T
#
# check_first_fix.draw(of_the_tip)

# %% [markdown] tags=["statement"]
# ## Exercise 5: a program with a bug, at the end of the row
#
# Between the old walnut trees no mast hears the robot. It drives a row blind. At its end it stops
# the motors and reads the compass once, and this program predicts step by step and then updates.
# In a step of `dt` seconds the robot moves by $v\,dt$ along the heading it had before the step,
# then turns by $\omega\,dt$.
#
# Its first half was tested: at the end of 200 rows the 95 % ellipse of x and y held the robot as
# often as it should. Then the compass was added, which should more than halve the error of the
# position. The error about doubled, and the covariance does not show it: the ellipse is the one
# that a right program would report. The picture has the errors of 200 rows after the compass, and
# the mean NEES of the pose, of which 3 is expected.
#
# Find the bug. And a question to begin with: how can a compass improve the *position* at all?


# %% tags=["exercise"]
def row_end(
    mean: Array, cov: Array, u: Array, dt: float, V: Array, compass: float, variance: float
) -> tuple[Array, Array]:
    """Drive a row blind, then read the compass once.

    Parameters
    ----------
    mean : ndarray, shape (3,)
        Pose of the axle at the start of the row.
    cov : ndarray, shape (3, 3)
    u : ndarray, shape (T, 2)
        Speed (m/s) and turn rate (rad/s) of every step.
    dt : float
        Duration of a step (s).
    V : ndarray, shape (2, 2)
        Covariance of speed and turn rate, in every step anew.
    compass : float
        Heading that is read after the last step (rad).
    variance : float
        Variance of that reading (rad^2).

    Returns
    -------
    mean : ndarray, shape (3,)
        Pose after the reading, heading in (-pi, pi].
    cov : ndarray, shape (3, 3)
    """
    for v, omega in u:
        c, s = np.cos(mean[2]), np.sin(mean[2])
        step = np.array([v * dt * c, v * dt * s])
        F = np.eye(3)
        F[:2, 2] = -step[1], step[0]
        F_u = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])
        mean = mean + np.append(step, omega * dt)
        cov = F @ cov @ F.T + F_u @ V @ F_u.T
    K = cov[:, 2] / (cov[2, 2] + variance)
    mean = mean + K * wrap_angle(compass - mean[2])
    cov = cov - np.outer(K, cov[2])
    return np.append(mean[:2], wrap_angle(mean[2])), cov


# %% active="ipynb" tags=["stub"]
#     for v, omega in u:
#         c, s = np.cos(mean[2]), np.sin(mean[2])
#         step = np.array([v * dt * c, v * dt * s])
#         F = np.eye(3)
#         F[:2, 2] = step[1], -step[0]
#         F_u = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])
#         mean = mean + np.append(step, omega * dt)
#         cov = F @ cov @ F.T + F_u @ V @ F_u.T
#     K = cov[:, 2] / (cov[2, 2] + variance)
#     mean = mean + K * wrap_angle(compass - mean[2])
#     cov = cov - np.outer(K, cov[2])
#     return np.append(mean[:2], wrap_angle(mean[2])), cov

# %% active="ipynb" tags=["try"]
# row_end(np.zeros(3), np.diag([0.05, 0.05, 0.1]) ** 2, np.tile([0.8, 0.0], (30, 1)), 0.5,
#         np.diag([0.1, 0.03]) ** 2, 0.1, 0.0003)

# %% [markdown] tags=["hint"]
# In the call above the robot believes that it drove 12 m along x, and the compass says that its
# heading is 0.1 rad, to the left. On which side of the x axis is it more likely to be? On which
# side does the program put it?

# %% [markdown] tags=["hint"]
# The gain of a compass is the last column of the covariance, divided by a number. An ellipse of x
# and y does not show that column: a test of the ellipse alone says nothing about it. What does its
# sign say at the end of the row, and which line of the program makes it?

# %% [markdown] tags=["hint"]
# Take the derivatives by a finite difference, as the lesson does: one step at the heading 0, once
# more at a heading of a millionth. Where does y go?


# %% tags=["cases"]
@drawn
def _row(rng: np.random.Generator, n: int, dt: float = 0.4) -> Any:
    mean, cov = a_pose(rng), a_covariance(rng, 3, 0.02)
    u = np.round(rng.uniform([-0.3, -0.8], [1.5, 0.8], (n, 2)), 2)
    compass = wrap_angle(mean[2] + dt * u[:, 1].sum() + np.round(rng.uniform(-0.3, 0.3), 2))
    return mean, cov, u, dt, a_covariance(rng, 2, 0.02), compass, rng.choice([0.001, 0.01, 0.04])


def _error_of(found: Any, truth: Array) -> tuple[float, float, Array]:
    """Return a position's squared error, the NEES of the pose, and where the robot is."""
    mean, cov = (np.asarray(part, float) for part in found)
    e = mean - truth
    e[2] = wrap_angle(float(e[2]))
    return float(e[:2] @ e[:2]), float(e @ np.linalg.solve(cov, e)), -e[:2]


def _row_end_drawn(ax: Any, function: Any) -> None:
    """Draw the errors of 200 robots at the end of a row, and the 95 % ellipse reported."""
    from slamlab import plots

    rng, n, dt, V = np.random.default_rng(0), 200, 0.5, np.diag([0.1, 0.03]) ** 2
    start, P = np.array([0.0, 0.0, 0.5]), np.diag([0.05, 0.05, 0.1]) ** 2
    u = np.tile([0.8, 0.0], (30, 1))
    x = start + rng.standard_normal((n, 3)) * np.sqrt(np.diag(P))
    for command in u:
        v, omega = (command + rng.standard_normal((n, 2)) * np.sqrt(np.diag(V))).T
        x += dt * np.column_stack([v * np.cos(x[:, 2]), v * np.sin(x[:, 2]), omega])
    compass = x[:, 2] + 0.02 * rng.standard_normal(n)
    found = [function(start, P, u, dt, V, float(one), 0.02**2) for one in compass]
    scores = [_error_of(one, truth) for one, truth in zip(found, x, strict=True)]
    squared, nees, errors = (np.array(part) for part in zip(*scores, strict=True))
    plots.lidar_points(ax, errors, s=3.0)
    plots.ellipse(ax, [0, 0], np.asarray(found[0][1], float)[:2, :2])
    plots.floor(ax)
    ax.set(xlabel="error of x (m)", ylabel="error of y (m)", xlim=(-4, 4), ylim=(-4, 4))
    ax.set_title(f"error {np.sqrt(squared.mean()):.1f} m, NEES {nees.mean():.1f}")


check_row_end = Check(
    row_end,
    "mean, cov",
    {
        "one step along x, then the compass": (
            [0, 0, 0],
            np.diag([0.01, 0.02, 0.04]),
            [[1.0, 0.0]],
            0.5,
            np.diag([0.01, 0.02]),
            0.2,
            0.01,
        ),
        "a row along x, the compass says left": (
            [0, 0, 0],
            np.diag([0.05, 0.04, 0.1]) ** 2,
            np.tile([0.8, 0.0], (10, 1)),
            0.5,
            np.diag([0.1, 0.03]) ** 2,
            0.1,
            0.0003,
        ),
        "a row in which the robot turns on the spot": (
            [1, -2, 0.4],
            [[0.02, 0.0, 0.01], [0.0, 0.03, 0.0], [0.01, 0.0, 0.02]],
            np.tile([0.0, 0.3], (3, 1)),
            0.5,
            [[0.01, 0.004], [0.004, 0.02]],
            0.7,
            0.001,
        ),
        "the heading passes half a turn to the left": (
            [0, 0, 3.0],
            0.05 * np.eye(3),
            [[0.5, 0.6], [0.4, 0.7]],
            0.4,
            0.01 * np.eye(2),
            -2.7,
            0.01,
        ),
        "the heading passes half a turn to the right": (
            [0, 0, -3.0],
            0.05 * np.eye(3),
            [[0.5, -0.6], [0.4, -0.7]],
            0.4,
            0.01 * np.eye(2),
            2.8,
            0.01,
        ),
        "any row": _row(8),
        "a row with longer steps": _row(5, 0.9),
    },
    tolerance=1e-5,
    picture=_row_end_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_row_end.mistakes = {
    "F has the wrong sign: a heading error to the left swings the step to the left": (
        "-step[1], step[0] => step[1], -step[0]"
    ),
    "F has the step along itself: a turn moves it across": (
        "-step[1], step[0] => step[0], step[1]"
    ),
    "F is mirrored: minus belongs to the sine": "-step[1], step[0] => step[1], step[0]",
    "F is the identity: a heading error becomes one of the position": (
        "-step[1], step[0] => 0.0, 0.0"
    ),
    "dt is missing in F_u: a velocity acts for dt": "dt * np.array([[c => np.array([[c",
    "F_u has cosine and sine exchanged": "[[c, 0.0], [s, 0.0] => [[s, 0.0], [c, 0.0]",
    "this is F^T P F: expected F P F^T": "F @ cov @ F.T => F.T @ cov @ F",
    "the noise of the wheels is missing": " + F_u @ V @ F_u.T => ",
    "the variance of the compass is missing in the gain": ("(cov[2, 2] + variance) => cov[2, 2]"),
    "the compass has only corrected the heading: it is correlated with x and y": (
        "K * wrap_angle(compass - mean[2]) => K * [0.0, 0.0, 1.0] * wrap_angle(compass - mean[2])"
    ),
    "the innovation of the compass is not wrapped": (
        "wrap_angle(compass - mean[2]) => (compass - mean[2])"
    ),
    "the sign of the innovation is reversed: measured less predicted": (
        "wrap_angle(compass - mean[2]) => wrap_angle(mean[2] - compass)"
    ),
    "the covariance did not shrink": "cov - np.outer(K, cov[2]) => cov + 0 * np.outer(K, cov[2])",
    "the heading is not wrapped": "wrap_angle(mean[2])), cov => mean[2]), cov",
}

# %% [markdown] tags=["solution"]
# ## Solution 5: a program with a bug, at the end of the row
#
# A robot whose heading is a little too far to the left ends its row a little too far to the left.
# So the heading and the place across the row are correlated, and that is how a compass improves a
# position: it reveals the heading error, and the correlation says where that has led. The column
# of the heading in $F$ is the step, turned by 90° to the *left*: $(-\Delta y, \Delta x)$. The
# program turned it to the right. Where the row begins without correlation, the ellipse of x and y
# has the column times itself: its sign is not in it, and the test of the ellipse passes. The
# correlation with the heading has the column once. So the program takes "left" for "right" and
# corrects by the right amount in the wrong direction. The NEES of the whole pose has the
# correlations in it, and is as large before the compass as after: that is the test to make.

# %% [markdown] tags=["solution"]
# Without any column in $F$ the program is no better than before the compass, and far more
# overconfident:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: errors of 200 robots at the end of a row; in the left one a wide cloud and a tiny ellipse."}}
# def without_column(mean, cov, u, dt, V, compass, variance):
#     for v, omega in u:
#         c, s = np.cos(mean[2]), np.sin(mean[2])
#         F_u = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])
#         mean = mean + dt * np.array([v * c, v * s, omega])
#         cov = cov + F_u @ V @ F_u.T
#     K = cov[:, 2] / (cov[2, 2] + variance)
#     mean = mean + K * wrap_angle(compass - mean[2])
#     return np.append(mean[:2], wrap_angle(mean[2])), cov - np.outer(K, cov[2])
#
# check_row_end.draw(without_column)

# %% [markdown] tags=["statement"]
# ## Exercise 6: your filter follows the robot
#
# Now let it mow. Assemble the filter from your own pieces: the motion of exercise 5, and from
# exercises 1 to 3 the prediction, the innovation and the Jacobian. After each step several masts
# may hear the robot, or one, or none, each with the standard deviation `sigma`, independent of the
# others.
#
# The lesson updates with one landmark after the other and takes $H$ again after each, at the mean
# that has just moved. So its answer depends, a little, on the order of the landmarks. Your masts
# hear the robot at one moment and have no order. Take all that heard it as *one* measurement of
# several numbers, with one $H$, at the predicted pose. The two answers differ by millimetres,
# which the check can tell apart; over the drives of the picture both are equally
# good.
#
# The picture is the experiment: 20 drives of 60 steps, a circle between three masts (the trees and
# the mower are left out). It shows one of them (black; dashed is dead reckoning) and, over all,
# your error of the position and your mean NEES, of which 3 is expected. By its wheels alone the
# robot is more than 2 m off; your filter should stay below a third of a metre.


# %% tags=["exercise"]
def follow(
    mean: Array,
    cov: Array,
    u: Array,
    dt: float,
    V: Array,
    z: Array,
    masts: Array,
    boom: float,
    sigma: float,
) -> tuple[Array, Array]:
    """Follow the robot by its wheels and by the masts that hear it.

    Parameters
    ----------
    mean : ndarray, shape (3,)
        Pose of the axle before the first step.
    cov : ndarray, shape (3, 3)
    u : ndarray, shape (T, 2)
        Speed (m/s) and turn rate (rad/s) of every step.
    dt : float
        Duration of a step (s).
    V : ndarray, shape (2, 2)
        Covariance of speed and turn rate, in every step anew.
    z : ndarray, shape (T, n)
        Reading of each mast after every step (rad), NaN where it heard nothing.
    masts : ndarray, shape (n, 2)
    boom : float
        How far ahead of the axle the transmitter is (m); negative: behind it.
    sigma : float
        Standard deviation of a reading (rad).

    Returns
    -------
    means : ndarray, shape (T, 3)
        Poses after every step, headings in (-pi, pi].
    covs : ndarray, shape (T, 3, 3)
    """
    means, covs = [], []
    for (v, omega), read in zip(u, z):
        c, s = np.cos(mean[2]), np.sin(mean[2])
        F = np.array([[1, 0, -v * dt * s], [0, 1, v * dt * c], [0, 0, 1]])
        F_u = dt * np.array([[c, 0], [s, 0], [0, 1]])
        mean = mean + dt * np.array([v * c, v * s, omega])
        cov = F @ cov @ F.T + F_u @ V @ F_u.T
        heard = np.isfinite(read)
        H = jacobian(mean, masts[heard], boom)
        S = H @ cov @ H.T + sigma**2 * np.eye(len(H))
        K = cov @ H.T @ np.linalg.inv(S)
        mean = mean + K @ innovation(read[heard], readings(mean, masts[heard], boom))
        cov = (np.eye(3) - K @ H) @ cov
        mean = np.append(mean[:2], wrap_angle(mean[2]))
        means.append(mean)
        covs.append(cov)
    return np.array(means), np.array(covs)


# %% active="ipynb" tags=["try"]
# follow(np.zeros(3), np.diag([0.1, 0.1, 0.05]) ** 2, np.array([[0.8, 0.2]]), 0.5,
#        np.diag([0.15, 0.12]) ** 2, np.array([[0.4, np.nan]]),
#        np.array([[-6.0, -2.0], [7.0, 4.0]]), 1.2, 0.035)

# %% [markdown] tags=["hint"]
# `heard = np.isfinite(z[t])` is a mask. `z[t][heard]` and `masts[heard]` are what your functions
# need; with `k` masts heard, which shapes have $H$, $R$, $S$ and $K$?

# %% [markdown] tags=["hint"]
# `readings` and `jacobian` belong to the same pose. Before the motion, or after it?

# %% [markdown] tags=["hint"]
# Begin without the masts: your ellipses should grow along the drive. Then the update, three lines
# of matrices as in the lesson; where no mast was heard, leave it out.


# %% tags=["cases"]
def _heard(rng: np.random.Generator, pose: Array, masts: Array, boom: float, sigma: float) -> Any:
    """Draw noisy readings of a pose, as lines in [-pi/2, pi/2]."""
    angles = readings(pose, masts, boom) + sigma * rng.standard_normal(len(masts))
    return wrap_angle(2 * angles) / 2


@drawn
def _mowing(rng: np.random.Generator, T: int, unheard: float, dt: float = 0.4, n: int = 3) -> Any:
    mean, masts = a_pose(rng), np.round(rng.uniform(5, 9, (n, 2)), 2)
    masts *= rng.choice([-1, 1], (n, 2))
    boom, sigma = np.round(rng.uniform(-0.8, 1.8), 2), rng.choice([0.03, 0.05, 0.1])
    u = np.round(rng.uniform([-0.2, -1.2], [1.0, 1.2], (T, 2)), 2)
    pose, read = mean, []
    for v, omega in u:
        pose = pose + dt * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), omega])
        read.append(_heard(rng, pose, masts, boom, sigma))
    z = np.where(rng.random((T, n)) < unheard, np.nan, np.round(read, 3))
    return (
        mean,
        a_covariance(rng, 3, 0.02),
        u,
        dt,
        a_covariance(rng, 2, 0.02),
        z,
        masts,
        boom,
        sigma,
    )


def _follow_drawn(ax: Any, function: Any) -> None:
    """Draw one of 20 drives: true path, odometry, your path and ellipses, and three masts."""
    from slamlab import plots

    rng, T, dt, boom, sigma = np.random.default_rng(4), 60, 0.5, 2.0, 0.02
    masts, u = np.array([[-9.0, 8.0], [10.0, 6.0], [4.0, -10.0]]), np.tile([0.8, 0.2], (T, 1))
    start, P = np.array([0.0, -4.0, 0.0]), np.diag([0.1, 0.1, 0.05]) ** 2
    V = np.diag([0.15, 0.15]) ** 2
    drives = []
    for _ in range(20):
        pose = start + rng.standard_normal(3) * np.sqrt(np.diag(P))
        truth, z = [], np.full((T, 3), np.nan)
        for k, command in enumerate(u):
            v, omega = command + rng.standard_normal(2) * np.sqrt(np.diag(V))
            pose = pose + dt * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), omega])
            truth.append(pose)
            if k % 3 == 2:
                read = _heard(rng, pose, masts, boom, sigma)
                z[k] = np.where(rng.random(3) < 0.4, np.nan, read)
        drives.append((np.array(truth), z, function(start, P, u, dt, V, z, masts, boom, sigma)))
    squared, nees = np.array(
        [
            _error_of(one, pose)[:2]
            for truth, _, found in drives
            for *one, pose in zip(*found, truth, strict=True)
        ]
    ).T
    truth, _, (means, covs) = drives[0]
    plots.path(ax, truth, "truth")
    plots.path(
        ax,
        follow(start, P, u, dt, V, drives[0][1] * np.nan, masts, boom, sigma)[0],
        "dead_reckoning",
    )
    plots.landmarks(ax, masts)
    plots.path(ax, np.asarray(means, float))
    for k in range(0, T, 5):
        plots.ellipse(ax, np.asarray(means[k], float)[:2], np.asarray(covs[k], float)[:2, :2])
    plots.floor(ax)
    ax.set(xlim=(-10, 10), ylim=(-10, 10))
    ax.set_title(f"error {np.sqrt(squared.mean()):.2f} m, NEES {nees.mean():.1f}")


check_follow = Check(
    follow,
    "means, covs",
    {
        "one step, nothing heard": _mowing(1, 1.0),
        "one step, heard by one mast": _mowing(1, 0.0, 0.7, 1),
        "one step, heard by three": _mowing(1, 0.0),
        "the heading passes half a turn to the left, the line is vertical": (
            [0, 0, 3.0],
            0.05 * np.eye(3),
            [[0.5, 0.6]],
            0.4,
            0.01 * np.eye(2),
            [[-1.52, 0.6]],
            [[-1.6, -6.0], [-5.0, -3.0]],
            1.0,
            0.05,
        ),
        "the heading passes half a turn to the right, the line is vertical": (
            [0, 0, -3.0],
            0.05 * np.eye(3),
            [[0.5, -0.6]],
            0.4,
            0.01 * np.eye(2),
            [[1.52, 0.6]],
            [[-0.8, -6.0], [-5.0, -3.0]],
            1.0,
            0.05,
        ),
        "a drive, all masts hear it": _mowing(12, 0.0),
        "a drive on which it is heard now and then": _mowing(12, 0.6, 0.25),
    },
    tolerance=1e-5,
    picture=_follow_drawn,
)


# %% tags=["mistakes"]
def _in_turn(
    mean: Array,
    cov: Array,
    u: Array,
    dt: float,
    V: Array,
    z: Array,
    masts: Array,
    boom: float,
    sigma: float,
) -> Any:
    means, covs = [], []
    for command, read in zip(u, z, strict=True):
        blind = np.full((1, 1), np.nan)
        (mean,), (cov,) = follow(mean, cov, command[None], dt, V, blind, masts[:1], boom, sigma)
        for k in np.flatnonzero(np.isfinite(read)):
            one = read[None, k : k + 1]
            still = np.zeros((1, 2)), 0.0, 0 * V  # no motion: the update alone
            (mean,), (cov,) = follow(mean, cov, *still, one, masts[k : k + 1], boom, sigma)
        means.append(mean)
        covs.append(cov)
    return np.array(means), np.array(covs)


_NU = "innovation(read[heard], readings(mean, masts[heard], boom))"

check_follow.mistakes = {
    "the innovation was wrapped as a bearing: the antennas read lines": (
        f"{_NU} => wrap_angle(read[heard] - readings(mean, masts[heard], boom))"
    ),
    "the masts that heard nothing were counted with a reading of zero": (
        "heard = np.isfinite(read) => heard, read = np.ones(len(read), bool), np.nan_to_num(read)"
    ),
    "where one mast heard nothing the others were dropped too": (
        "heard = np.isfinite(read) => heard = np.isfinite(read) & np.isfinite(read).all()"
    ),
    "H was taken at the pose before the motion: expected the predicted one": (
        "mean = mean + dt => old, mean = mean, mean + dt",
        "jacobian(mean, masts[heard], boom) => jacobian(old, masts[heard], boom)",
    ),
    "F and F_u were taken at the heading after the motion: expected the one before it": (
        "F = np => ahead = np.array([v * c, v * s, omega])\n        "
        "turned = mean[2] + dt * omega\n        c, s = np.cos(turned), np.sin(turned)\n        "
        "F = np",
        "np.array([v * c, v * s, omega])\n        cov => ahead\n        cov",
    ),
    "the column of the heading in H is that of the lesson, −1": (
        "H = jacobian(mean, masts[heard], boom) => H = jacobian(mean, masts[heard], boom)\n"
        "        H[:, 2] = -1.0"
    ),
    "the column of the heading in H is zero: a turn moves the tip of the boom": (
        "H = jacobian(mean, masts[heard], boom) => H = jacobian(mean, masts[heard], boom)\n"
        "        H[:, 2] = 0.0"
    ),
    "the masts were taken one after the other, with H again after each: expected one update of "
    "all, with H at the predicted pose": _in_turn,
    "the motion is the lesson's arc: here the robot moves along the heading it had, then turns": (
        "mean = mean + dt * np.array([v * c, v * s, omega]) => a = omega * dt / 2\n        "
        "c, s = np.sinc(a / np.pi) * np.array([np.cos(mean[2] + a), np.sin(mean[2] + a)])\n        "
        "bend = v * dt**2 / 2 * (np.cos(a) - np.sinc(a / np.pi)) / (a + 1e-12)\n        "
        "F = np.array([[1, 0, -v * dt * s], [0, 1, v * dt * c], [0, 0, 1]])\n        "
        "F_u = dt * np.array([[c, 0], [s, 0], [0, 1]])\n        "
        "F_u[:2, 1] = bend * np.array([np.cos(mean[2] + a), np.sin(mean[2] + a)])"
        " + dt / 2 * v * dt * np.array([-s, c])\n        "
        "mean = mean + dt * np.array([v * c, v * s, omega])"
    ),
    "F has the wrong sign in its last column, as in exercise 5": (
        "-v * dt * s], [0, 1, v * dt * c] => v * dt * s], [0, 1, -v * dt * c]"
    ),
    "F is the identity here: a heading error becomes one of the position": (
        "F @ cov @ F.T => cov"
    ),
    "this is F^T P F: expected F P F^T": "F @ cov @ F.T => F.T @ cov @ F",
    "the noise of the motion is missing": " + F_u @ V @ F_u.T => ",
    "dt is missing in F_u: a velocity acts for dt": "F_u = dt * np => F_u = np",
    "sigma is a standard deviation: R has its square": "sigma**2 * => sigma *",
    "R is missing in S: the antennas are not perfect": (
        " + sigma**2 * np.eye(len(H)) =>  + 1e-12 * np.eye(len(H))"
    ),
    "the heading is not wrapped: it must lie in (-pi, pi]": "wrap_angle(mean[2]) => mean[2]",
    "the sign of the innovation is reversed: measured less predicted": (
        "mean + K @ innovation => mean - K @ innovation"
    ),
    "the covariance did not shrink: expected (I - K H) P": "(np.eye(3) - K @ H) @ cov => cov",
    "only the last belief was returned: expected one after each step": (
        lambda *given: (follow(*given)[0][-1], follow(*given)[1][-1])
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 6: your filter follows the robot
#
# Five lines of motion, six of measurement. Both Jacobians of the motion are taken at the pose
# before it, that of the measurement at the predicted pose. Where no mast was heard, $H$ has no row
# and $K$ three rows and no column: $K\nu$ and $K H$ are zero, and the update changes nothing. No
# sensor measures the heading; a little of it comes through the boom. The rest is from the
# correlation of exercise 5: a robot that is found too far left has been heading too far left.

# %% [markdown] tags=["solution"]
# What does each piece buy? With the lesson's wrap in the innovation the drive looks well until the
# line of a mast passes the vertical:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: a drive round the orchard; in the left one the estimated path jumps across the orchard."}}
# of_lines = innovation
# innovation = lambda z, predicted: wrap_angle(z - predicted)
# check_follow.draw(follow)

# %% [markdown] tags=["solution"]
# With the lesson's column of the heading, −1, in the Jacobian:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: a drive round the orchard; in the left one the estimated path leaves the true one."}}
# innovation, of_the_boom = of_lines, jacobian
# jacobian = lambda pose, masts, boom: np.column_stack(
#     [of_the_boom(pose, masts, boom)[:, :2], -np.ones(len(masts))])
# check_follow.draw(follow)

# %% [markdown] tags=["solution"]
# A heading error of 1° moves the tip of a 2 m boom by 3.5 cm, and ten metres away a mast reads
# that as 0.2°. With the −1 the filter takes each reading for one of the heading, degree for
# degree: the error is about five times as large. Next a zero in that column, as if the transmitter
# were at the axle:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: a drive round the orchard; in the left one the error and the NEES in the title are larger."}}
# jacobian = lambda pose, masts, boom: of_the_boom(pose, masts, boom) * [1, 1, 0]
# check_follow.draw(follow)

# %% [markdown] tags=["solution"]
# That is hard to see in the path, and shows in the numbers: the filter takes a swing of the boom
# for a motion of the robot. All three answers run, and two of them look plausible: it is the error
# and the NEES of many drives that say which filter is right.

# %% [markdown] tags=["statement"]
# *What you have now*: an extended filter for a robot that carries no sensor but its wheels, with
# a measurement, an innovation and a Jacobian that were in no lesson, a pose to begin with and its
# covariance. In [chapter 09](../09_ekf_slam.ipynb) the masts are unknown as well: the same filter
# estimates the robot and the map.

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 03](../solutions/03_extended_kalman_filter.ipynb).
