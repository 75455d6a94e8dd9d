"""Exercises, chapter 05: omni wheels, exact step, noise of a curve, a worn wheel, odometry.

P1 (10), (14) and (17) with its dt, and the wheel map (9a) that P1 leaves out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, an_angle, drawn
from slamlab.exercises._report import Array, Check
from slamlab.geometry import wrap_angle

__all__ = ["check_noise", "check_odometry", "check_slip", "check_step", "check_wheels"]


# %% [markdown] tags=["chapter"]
# # Exercises 05: mecanum kinematics
#
# Five exercises: a robot on other wheels, a step along an arc, an ellipse with two bugs, a worn
# wheel, and an odometry whose ellipses you put to the test. The chapter is [Mecanum kinematics and
# odometry](../05_mecanum_kinematics.ipynb). Replace each `...` and run the check below it as often
# as you like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 05: mecanum kinematics
#
# The exercises are in [Exercises 05](../exercises/05_mecanum_kinematics.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
# from scipy.stats import binom
#
# from slamlab.evaluation import chi2_band
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: a robot on omni wheels, with a pencil
#
# Your next robot is round and stands on three **omni wheels**. Their rollers do not stand at 45
# degrees: the roller's axis lies along the rim, so the wheel grips along its rim, and it slides
# freely along its own axle. Every axle points to the centre of the robot. A wheel sits at the
# distance $d$ from the centre, in the direction $\beta$ (0 ahead, $\pi/2$ to the left).
#
# ![Left, one omni wheel from above: its axle points to the centre of the robot, at the distance d
# and the angle beta from ahead to the left; along the axle it slides freely, across the axle it
# grips. Right, a robot on three wheels at 60, 180 and 300 degrees with the directions in which
# positive spins drive their hubs, counterclockwise round the
# centre.](../../book/static/drawings/05_omni_wheel.svg)
#
# The lesson's derivation works here as well: take one wheel, write down the velocity of its hub
# and of its lowest point, and say in which direction nothing may move. A wheel that spins with
# positive speed drives its hub *counterclockwise* round the centre: the wheel at $\beta = 0$
# drives to the left. Your function shall serve robots with any number of wheels. The picture
# drives one with three up to a table and once round it, facing it all the time; no car can do
# that.
#
# **Write down**, when your check holds: the residual (A) of the lesson's four wheels shows some
# slip. Which slip can the encoders of three omni wheels show?


# %% tags=["exercise"]
def wheel_speeds(u: Array, r: float, distance: float, beta: Array) -> Array:
    """Wheel speeds of a robot on omni wheels.

    Parameters
    ----------
    u : ndarray, shape (3,)
        Body velocity: forward (m/s), to the left (m/s), turning left (rad/s).
    r, distance : float
        Wheel radius, and distance of every wheel from the centre (m).
    beta : ndarray, shape (k,)
        Directions from the centre to the wheels (rad).

    Returns
    -------
    ndarray, shape (k,)
        Speeds of the wheels (rad/s).
    """
    return (-np.sin(beta) * u[0] + np.cos(beta) * u[1] + distance * u[2]) / r


# %% active="ipynb" tags=["try"]
# three = np.deg2rad([60.0, 180.0, 300.0])
# wheel_speeds(np.array([0.4, 0.0, 0.0]), 0.05, 0.2, three)

# %% [markdown] tags=["hint"]
# Where is the hub of the wheel? As in the lesson, a hub at $(x, y)$ moves with $(V_1 - \omega y,\
# V_2 + \omega x)$.

# %% [markdown] tags=["hint"]
# Only the part across the axle makes the wheel spin. The axle points along $(\cos\beta,
# \sin\beta)$; which unit vector stands across it, counterclockwise?

# %% [markdown] tags=["hint"]
# Test your unit vector: at $\beta = 0$ it points to the left, at $\pi/2$ backward. The hub's speed
# along it is what the spinning wheel rolls. Check with a turn on the spot: each hub runs round a
# circle of radius $d$, wherever the wheel sits.


# %% tags=["cases"]
def _platform(rng: np.random.Generator) -> Any:
    beta = np.round(rng.uniform(-3.1, 3.1, int(rng.integers(3, 6))), 2)
    r, distance = np.round(rng.uniform([0.03, 0.1], [0.1, 0.5]), 3)
    return np.round(rng.uniform(-1, 1, 3), 2), r, distance, beta


_KIWI = (0.05, 0.2, np.deg2rad([60.0, 180.0, 300.0]))


def _wheels_drawn(ax: Any, function: Any) -> None:
    """Draw a robot that drives to a table and round it: grey as wished, blue as its wheels go."""
    from slamlab import plots

    r, d, beta = _KIWI
    wished = np.repeat([[0.5, 0.0, 0.0], [0.0, -0.5, 5 / 6]], [24, 151], axis=0)
    wheels = np.array([np.asarray(function(u, r, d, beta), float) for u in wished])
    J = np.column_stack([-np.sin(beta), np.cos(beta), np.full(3, d)]) / r
    paths = []
    for velocities in (wished, wheels @ np.linalg.inv(J).T):
        driven = [np.array([-1.2, 0.0, 0.0])]
        for u in velocities:
            driven.append(exact_step(driven[-1], u, 0.05))
        paths.append(np.array(driven))
    around = np.linspace(0, 2 * np.pi, 60)
    circle = np.array([np.cos(around), np.sin(around)])
    gap = np.full((2, 1), np.nan)
    robot = [0.8 * d * circle, gap, np.array([[0.0, 0.3], [0.0, 0.0]])]
    for c, s in zip(np.cos(beta), np.sin(beta), strict=True):
        robot += [gap, d * np.array([[c, c], [s, s]]) + 0.08 * np.array([[s, -s], [-c, c]])]
    along, left = np.hstack(robot)
    ax.fill(*(0.25 * circle), color="0.85")
    for poses, kind, lw, alpha in zip(
        paths, ("truth", "estimate"), (6, 1.5), (0.2, 1.0), strict=True
    ):
        style: Any = {"color": plots.COLOURS[kind], "lw": lw, "alpha": alpha}
        ax.plot(*poses[:, :2].T, **style)
        for x, y, theta in poses[[0, 62, 99, 137]]:
            c, s = np.cos(theta), np.sin(theta)
            ax.plot(x + c * along - s * left, y + s * along + c * left, **style)
    plots.floor(ax)


check_wheels = Check(
    wheel_speeds,
    "speeds",
    {
        "straight ahead, the wheel behind stands still": ([0.4, 0.0, 0.0], *_KIWI),
        "to the left, the wheel behind turns backward": ([0.0, 0.3, 0.0], *_KIWI),
        "turning left, all wheels alike": ([0.0, 0.0, 0.8], *_KIWI),
        "all three at once": ([0.4, -0.2, 0.5], *_KIWI),
        "four wheels": ([-0.3, 0.1, 1.0], 0.1, 0.4, np.deg2rad([45.0, 135.0, 225.0, 315.0])),
        "any robot": _platform,
    },
    picture=_wheels_drawn,
)

# %% tags=["mistakes"]
check_wheels.mistakes = {
    "this is the velocity along the axle, where the wheel slides freely: expected across it": (
        "-np.sin(beta) * u[0] + np.cos(beta) * u[1] => np.cos(beta) * u[0] + np.sin(beta) * u[1]"
    ),
    "forward has the wrong sign: a wheel on the left must turn backward": (
        "-np.sin(beta) => np.sin(beta)"
    ),
    "the wheels turn the other way: positive is counterclockwise round the centre": (
        lambda *given: -wheel_speeds(*given)
    ),
    "beta counts from ahead, towards the left: these are the wheels of a robot turned by 90 "
    "degrees": (
        "-np.sin(beta) * u[0] + np.cos(beta) * u[1] => np.cos(beta) * u[0] - np.sin(beta) * u[1]"
    ),
    "the turn has the wrong sign: turning left carries every wheel counterclockwise": (
        "+ distance * u[2] => - distance * u[2]"
    ),
    "the turn acts at a lever: multiply omega by the distance": "distance * u[2] => u[2]",
    "the turn is missing": " + distance * u[2] => ",
    "the turn was projected too: a wheel stands across its lever wherever it is": (
        "distance * u[2] => distance * np.cos(beta) * u[2]"
    ),
    "multiplied by the wheel radius: a speed over the floor divided by r is a spin": (
        "/ r => * r"
    ),
    "these are speeds over the floor (m/s): divide by the wheel radius": " / r => ",
    "divided by the wheel's diameter: expected the radius": "/ r => / (2 * r)",
    "a roller at 45 degrees belongs to a mecanum wheel: an omni wheel grips straight across": (
        "-np.sin(beta) * u[0] + np.cos(beta) * u[1]"
        " => (np.cos(beta) - np.sin(beta)) * u[0] + (np.sin(beta) + np.cos(beta)) * u[1]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: omni wheels
#
# The hub at $d\,(\cos\beta, \sin\beta)$ moves with $(V_1 - \omega d \sin\beta,\ V_2 + \omega d
# \cos\beta)$. Across the axle, along $(-\sin\beta, \cos\beta)$, that is $-V_1 \sin\beta + V_2
# \cos\beta + \omega d$, and where the wheel touches the floor nothing moves in this direction:
# $r s$ takes it all.

# %% [markdown] tags=["solution"]
# **Which slip can three wheels show?** None. Three wheels, three speeds: the map can be inverted,
# so any three readings are those of some motion, and the residual is always zero. With four
# wheels, one equation is left over, as in the lesson. The number of equations that are left over,
# for three and for four wheels:

# %% active="ipynb" tags=["solution"]
# for degrees in ([60.0, 180.0, 300.0], [45.0, 135.0, 225.0, 315.0]):
#     beta = np.deg2rad(degrees)
#     J = np.column_stack([wheel_speeds(u, 0.05, 0.2, beta) for u in np.eye(3)])
#     print(len(beta), "wheels, left over:", len(beta) - np.linalg.matrix_rank(J))

# %% [markdown] tags=["solution"]
# The velocity along the axle looks as good on paper. It is the part that the rollers let go:

# %% active="ipynb" tags=["solution"]
# def along_the_axle(u, r, distance, beta):
#     return (np.cos(beta) * u[0] + np.sin(beta) * u[1] + distance * u[2]) / r
#
# check_wheels(along_the_axle)

# %% [markdown] tags=["statement"]
# ## Exercise 2: the exact step
#
# A robot drives in a circle and reads its encoders every 0.7 s. The lesson's step, P1 (10), moves
# it along the heading at the *start* of each interval, along a tangent; so the computed circle is
# beside the driven one, by half a step (dashed in the picture). In truth the heading turns from
# $\theta$ to $\theta + \omega\,dt$ while the robot moves, and the velocity turns with it. Where
# does the robot end?
#
# Do this before you read [05b](../05b_mecanum_kinematics.ipynb), which shows the form. Give the
# exact answer, for every turn rate. At 0 the robot drives straight on. From four wheels that are
# nearly alike comes a rate of $10^{-12}$ rad/s: there a difference of two sines has only three or
# four digits left.


# %% tags=["exercise"]
def exact_step(pose: Array, u: Array, dt: float) -> Array:
    """Move with a constant body velocity.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x, y (m), theta (rad) in the world.
    u : ndarray, shape (3,)
        Body velocity (m/s, m/s, rad/s); the turn rate may be 0.
    dt : float
        Duration (s).

    Returns
    -------
    ndarray, shape (3,)
        Pose at the end, heading in (-pi, pi].
    """
    h = 0.5 * u[2] * dt
    middle, chord = pose[2] + h, dt * np.sinc(h / np.pi)
    c, s = np.cos(middle), np.sin(middle)
    x = pose[0] + chord * (c * u[0] - s * u[1])
    y = pose[1] + chord * (s * u[0] + c * u[1])
    return np.array([x, y, wrap_angle(pose[2] + u[2] * dt)])


# %% active="ipynb" tags=["try"]
# exact_step(np.zeros(3), np.array([1.0, 0.0, np.pi / 2]), 1.0)

# %% [markdown] tags=["hint"]
# In the world, the velocity at the time $t$ of the step is $(V_1, V_2)$ rotated by $\theta +
# \omega t$. The displacement is its integral from 0 to $dt$.

# %% [markdown] tags=["hint"]
# $V_1$ and $V_2$ are constant, so what is wanted is the mean of a unit vector that turns evenly,
# from $-h$ to $+h$ about its middle direction; $h = \omega\,dt/2$. Draw it: in which direction
# does the mean point? The parts across that direction cancel. What is the mean of the parts along
# it?

# %% [markdown] tags=["hint"]
# The mean along it is that of the cosine from $-h$ to $h$, which is $\sin(h)/h$. This is 0/0 at $h
# = 0$, and 1 in the limit. NumPy's `np.sinc` knows this limit. Read its help before you use it:
# `np.sinc(h)` is not $\sin(h)/h$.


# %% tags=["cases"]
def _driven(rng: np.random.Generator) -> Any:
    return a_pose(rng), np.round(rng.uniform(-2, 2, 3), 2), float(np.round(rng.uniform(0.1, 2), 2))


def _step_drawn(ax: Any, function: Any) -> None:
    """Draw a circle as driven (line), in nine exact steps (blue) and in the lesson's (dashed)."""
    from slamlab import plots

    u, pose = np.array([0.8, 0.3, 0.9]), np.array([0.5, 0.2, 2.0])
    turned = pose[2] + 0.9 * np.linspace(0, 6.3, 1801)[:, None]
    c, s = np.cos(turned), np.sin(turned)
    speeds = np.hstack([c * u[0] - s * u[1], s * u[0] + c * u[1]])
    plots.path(ax, pose[:2] + np.cumsum(0.0035 * speeds, axis=0), "truth")
    lesson = [pose]
    for _ in range(9):
        lesson.append(euler(lesson[-1], u, 0.7))
        pose = np.asarray(function(pose, u, 0.7), float)
        nose = pose[:2] + 0.25 * np.array([[0, 0], [np.cos(pose[2]), np.sin(pose[2])]])
        plots.path(ax, nose)
        ax.plot(pose[0], pose[1], "o", color=plots.COLOURS["estimate"], markersize=5)
    plots.path(ax, np.array(lesson), "dead_reckoning")
    plots.floor(ax)


check_step = Check(
    exact_step,
    "pose",
    {
        "straight ahead": ([1.0, 2.0, 0.0], [0.5, 0.0, 0.0], 0.4),
        "a diagonal at another heading": ([1.0, 2.0, 0.9], [0.5, -0.3, 0.0], 0.4),
        "a quarter circle": ([0.0, 0.0, 0.3], [1.0, 0.0, np.pi / 2], 1.0),
        # Powers of two: what a difference of sines leaves is the same in every order of terms.
        "a turn that is almost none": ([1.0, 2.0, 0.9], [0.5, -0.25, 2.0**-40], 0.5),
        "a very slow turn": ([1.0, 2.0, 0.9], [0.5, -0.3, 5e-4], 0.4),
        "a slow turn": ([1.0, 2.0, 0.9], [0.5, -0.3, 0.05], 0.4),
        "a full circle comes back": ([1.0, 2.0, 0.5], [0.7, 0.2, 2 * np.pi], 1.0),
        "no time, no motion": ([1.0, 2.0, 0.5], [0.7, 0.2, 1.0], 0.0),
        "the heading passes pi": ([0.0, 0.0, 3.0], [0.3, 0.1, 1.0], 0.5),
        "the heading passes -pi": ([0.0, 0.0, -3.0], [0.3, 0.1, -1.0], 0.5),
        "turning while strafing": _driven,
    },
    picture=_step_drawn,
)


# %% tags=["mistakes"]
def _by_sines(pose: Array, u: Array, dt: float, straight: float = 0.0) -> Array:
    """Integrate to a difference of sines; at or below a turn rate take Euler's step."""
    if abs(u[2]) <= straight:
        return euler(pose, u, dt)
    end = pose[2] + u[2] * dt
    s, c = (np.sin(end) - np.sin(pose[2])) / u[2], (np.cos(end) - np.cos(pose[2])) / u[2]
    x, y = pose[0] + s * u[0] + c * u[1], pose[1] - c * u[0] + s * u[1]
    return np.array([x, y, wrap_angle(end)])


check_step.mistakes = {
    "a difference of two sines, divided by a tiny omega, has lost its digits: `omega == 0` is not "
    "the only case to care for": _by_sines,
    "0/0 without a turn, and a difference of two sines that loses its digits next to it": (
        lambda pose, u, dt: _by_sines(pose, u, dt, -1.0)
    ),
    "below some turn rate this is Euler's step: a slow turn is a turn, at 0.05 rad/s too": (
        lambda pose, u, dt: _by_sines(pose, u, dt, 0.1)
    ),
    "below some turn rate this is Euler's step: a very slow turn is a turn, too": (
        lambda pose, u, dt: _by_sines(pose, u, dt, 0.01)
    ),
    "this is Euler's step: the velocity turns with the robot during dt": (
        "pose[2] + h, dt * np.sinc(h / np.pi) => pose[2], dt"
    ),
    "this is the midpoint rule: the chord is shorter than the arc, by sin(h)/h": (
        "dt * np.sinc(h / np.pi) => dt"
    ),
    "the heading of the end of the step was used: expected that of its middle": (
        "pose[2] + h, => pose[2] + 2 * h,"
    ),
    "the heading of the start of the step was used: expected that of its middle": (
        "pose[2] + h, => pose[2],"
    ),
    "h is half the turn of the step, in the factor too": (
        "np.sinc(h / np.pi) => np.sinc(2 * h / np.pi)"
    ),
    "np.sinc(x) is sin(pi x) / (pi x): divide h by pi": "h / np.pi => h",
    "0/0 without a turn: sin(h)/h is 1 at h = 0, and np.sinc(h / np.pi) knows it": (
        "np.sinc(h / np.pi) => np.sin(h) / h"
    ),
    "rotated the wrong way round: body to world turns by plus theta": (
        "c, s = np.cos(middle), np.sin(middle) => c, s = np.cos(middle), -np.sin(middle)"
    ),
    "u is a velocity of the body: rotate it into the world": (
        "middle, chord = pose[2] + h => middle, chord = h"
    ),
    "the heading leaves (-pi, pi]: wrap it": "wrap_angle( => (",
    "V_2 is missing: this robot also moves to its left": (
        " - s * u[1] => ",
        " + c * u[1] => ",
    ),
    "the step alone was returned: it is added to the pose": (
        "x = pose[0] +  => x = ",
        "y = pose[1] +  => y = ",
    ),
    "the heading did not turn": "pose[2] + u[2] * dt => pose[2]",
    "dt is missing in the heading: omega acts for dt": "u[2] * dt) => u[2])",
    "dt is missing in the place: a velocity acts for dt": "dt * np.sinc => np.sinc",
}

# %% [markdown] tags=["solution"]
# ## Solution 2: the exact step
#
# The velocity turns with the body. Its mean over the step points half way between the first and
# the last heading, and it is shorter than the velocity by sin(h)/h, as a chord is shorter than
# its arc.

# %% [markdown] tags=["solution"]
# Integrating gives $(\sin(\theta + \omega\,dt) - \sin\theta)/\omega$, which is right on paper. A
# product instead of the difference keeps all digits: $\sin a - \sin b = 2 \cos\frac{a+b}2
# \sin\frac{a-b}2$, and this is the form above. Euler's step, P1 (10), passes where nothing turns,
# and where no time passes:

# %% active="ipynb" tags=["solution"]
# def euler(pose, u, dt):
#     c, s = np.cos(pose[2]), np.sin(pose[2])
#     return np.array([pose[0] + dt * (c * u[0] - s * u[1]),
#                      pose[1] + dt * (s * u[0] + c * u[1]),
#                      wrap_angle(pose[2] + dt * u[2])])
#
# check_step(euler)

# %% [markdown] tags=["solution"]
# What it costs: on a circle with a radius of 0.5 m, at 0.3 m/s and two readings per second,
# Euler's poses are first outside the circle and then inside it. They are on a circle of their own,
# displaced by half a step, 7.5 cm. It closes as well, so a test of the end of a lap alone finds
# nothing.

# %% active="ipynb" tags=["solution"]
# for step in (euler, exact_step):
#     pose, far = np.zeros(3), []
#     for _ in range(21):
#         pose = step(pose, np.array([0.3, 0.0, 0.6]), 0.5)
#         far.append(np.hypot(pose[0], pose[1] - 0.5))
#     print(f"{step.__name__}: {min(far):.3f} to {max(far):.3f} m from the centre")

# %% [markdown] tags=["statement"]
# ## Exercise 3: an ellipse across the cloud, two bugs to find
#
# A robot in a hurry reads its encoders about once per second, and drives curves. In each step the
# program moves it straight, along the chord of the arc that it would drive in Exercise 2, as far
# as the arc is long: it leaves out the factor by which the chord is shorter, in the covariance
# too. How uncertain does one such step make the pose, if $u$ has the covariance $V$? The lesson's
# $F_u$ belongs to Euler's step and is not enough here: an error of $\omega$ also turns the chord,
# and the end of the step moves with it.
#
# The program below knows that. On the test track, straight along $x$, its ellipse held 95 % of the
# robots. In the first curve the robots lie along one line, and its ellipse along another: draw it.
#
# Run the check, compare the rows that hold with those that do not, find the two bugs, repair them.


# %% tags=["exercise"]
def process_noise(theta: float, u: Array, dt: float, V: Array) -> Array:
    """Covariance that a noisy velocity adds to the pose in one step.

    The step goes along the chord of the arc, as far as the arc is long: the factor
    sin(h)/h of Exercise 2 is left out.

    Parameters
    ----------
    theta : float
        Heading at the start of the step (rad).
    u : ndarray, shape (3,)
        Body velocity: forward, to the left (m/s), turning left (rad/s).
    dt : float
        Duration (s).
    V : ndarray, shape (3, 3)
        Covariance of u, in (m/s)^2 and (rad/s)^2.

    Returns
    -------
    ndarray, shape (3, 3)
        Covariance of x, y and theta after the step, in m^2 and rad^2.
    """
    heading = theta + u[2] * dt / 2
    c, s = np.cos(heading), np.sin(heading)
    x, y = dt * (c * u[0] - s * u[1]), dt * (s * u[0] + c * u[1])
    F_u = dt * np.array([[c, -s, -y / 2], [s, c, x / 2], [0, 0, 1]])
    return F_u @ V @ F_u.T


# %% active="ipynb" tags=["stub"]
#     heading = theta + u[2] * dt
#     c, s = np.cos(heading), np.sin(heading)
#     x, y = dt * (c * u[0] - s * u[1]), dt * (s * u[0] + c * u[1])
#     F_u = dt * np.array([[c, -s, y / 2], [s, c, x / 2], [0, 0, 1]])
#     return F_u @ V @ F_u.T

# %% active="ipynb" tags=["try"]
# process_noise(0.3, np.array([0.8, 0.0, 0.6]), 0.8, np.diag([0.0004, 0.0004, 0.04]))

# %% [markdown] tags=["hint"]
# Two rows have an $\omega$ that is known exactly, `V[2, 2]` = 0; one of them holds, one does not.
# In what do they differ? Two rows move along $y$ without turning, and fail; in what do they differ
# from the first row, which holds? Each pair shows one of the bugs.

# %% [markdown] tags=["hint"]
# With a pencil: a robot drives 1 m along $y$, $\theta = \pi/2$, and $\omega$ is a little larger
# than measured. To which side does it end, and which sign does that give to the change of $x$?
# Then the same along $x$, $\theta = 0$: which sign has the change of $y$?

# %% [markdown] tags=["hint"]
# A robot drives 1 m in a step in which it turns by 90 degrees. It is a little faster than
# measured: in which direction does its end move? The first column of `F_u` should say that.

# %% tags=["cases"]
_V = np.diag([0.01, 0.002, 0.04])
_V_EXACT_TURN = np.diag([0.01, 0.002, 0.0])


def _moved(robots: Array, u: Array, dt: float) -> Array:
    """Move robots (n, 3), each with its own constant velocity (n, 3), exactly."""
    h = u[:, 2] * dt / 2
    c, s, chord = np.cos(robots[:, 2] + h), np.sin(robots[:, 2] + h), dt * np.sinc(h / np.pi)
    place = [chord * (c * u[:, 0] - s * u[:, 1]), chord * (s * u[:, 0] + c * u[:, 1])]
    moved: Array = robots + np.column_stack([*place, 2 * h])
    return moved


def _noise_drawn(ax: Any, function: Any) -> None:
    """Draw where 1000 robots end after one step in a curve, and the 95 % ellipse of the place."""
    from slamlab import plots

    rng, theta, u, dt = np.random.default_rng(0), 0.3, np.array([0.8, 0.0, 0.6]), 0.8
    V = np.diag([0.02, 0.02, 0.2]) ** 2
    Q = np.asarray(function(theta, u, dt, V), float)[:2, :2]
    start = np.array([[0.0, 0.0, theta]])
    robots = _moved(start, rng.multivariate_normal(u, V, 1000), dt)[:, :2]
    path = np.array([_moved(start, u[None], t)[0, :2] for t in np.linspace(0, dt, 30)])
    e = robots - path[-1]
    inside = np.sum(e * np.linalg.solve(Q, e.T).T, axis=1) < 5.991
    plots.lidar_points(ax, robots, s=1.6)
    plots.path(ax, path, "truth")
    plots.ellipse(ax, path[-1], Q)
    plots.floor(ax)
    ax.set_title(f"holds {inside.mean():.0%} of the robots")


check_noise = Check(
    process_noise,
    "Q",
    {
        "straight along x": (0.0, [1.0, 0.0, 0.0], 0.5, _V),
        "straight along y": (np.pi / 2, [1.0, 0.0, 0.0], 0.5, _V),
        "heading along x, moving to the left": (0.0, [0.0, 0.6, 0.0], 0.5, _V),
        "straight at an angle, omega known exactly": (0.7, [1.0, 0.2, 0.0], 0.5, _V_EXACT_TURN),
        "in a curve, omega known exactly": (0.7, [1.0, 0.2, 0.8], 0.5, _V_EXACT_TURN),
        "turning on the spot": (0.0, [0.0, 0.0, 0.8], 0.5, _V),
        "in a curve": (0.3, [1.0, 0.0, 0.8], 0.5, _V),
        "in a curve, a step of a second": (0.3, [1.0, 0.0, 0.8], 1.0, _V),
        "correlated speeds of a robot with one bad wheel": lambda rng: (
            an_angle(rng),
            np.round(rng.uniform(-1, 1, 3), 2),
            float(np.round(rng.uniform(0.1, 2), 2)),
            a_covariance(rng, 3, 0.1),
        ),
    },
    picture=_noise_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
_SWING = "-y / 2], [s, c, x / 2]"


def _both_bugs(theta: float, u: Array, dt: float, V: Array) -> Array:
    """Return what the program of the exercise gives as it is handed out."""
    return _swung(theta + u[2] * dt, u, dt, V, 1, 1)


def _sign_bug(theta: float, u: Array, dt: float, V: Array) -> Array:
    """Return what it gives with the heading repaired only."""
    return _swung(theta + u[2] * dt / 2, u, dt, V, 1, 1)


def _swung(heading: float, u: Array, dt: float, V: Array, chord: float, sign: float) -> Array:
    """Return the noise of a step along a heading, its length multiplied by chord."""
    c, s = np.cos(heading), np.sin(heading)
    k = dt * chord
    x, y = k * (c * u[0] - s * u[1]), k * (s * u[0] + c * u[1])
    F_u = np.array([[k * c, -k * s, sign * dt * y / 2], [k * s, k * c, dt * x / 2], [0, 0, dt]])
    return F_u @ V @ F_u.T


def _with_the_factor(theta: float, u: Array, dt: float, V: Array) -> Array:
    """Return the noise of the chord, its factor taken for a constant."""
    h = u[2] * dt / 2
    return _swung(theta + h, u, dt, V, np.sinc(h / np.pi), -1)


def _exact_noise(theta: float, u: Array, dt: float, V: Array) -> Array:
    """Return the noise of the exact step, its derivatives taken by small differences."""
    start, small = np.array([0.0, 0.0, theta]), 1e-5 * np.eye(3)
    moves = [exact_step(start, u + e, dt) - exact_step(start, u - e, dt) for e in small]
    F_u = np.array([[*m[:2], wrap_angle(m[2])] for m in moves]).T / 2e-5
    return F_u @ V @ F_u.T


check_noise.mistakes = {
    "this is the heading of the end of the step: expected that of its middle": (
        "u[2] * dt / 2 => u[2] * dt"
    ),
    "this is the heading of the start of the step: expected that of its middle": (
        "theta + u[2] * dt / 2 => theta"
    ),
    "a sign in the third column: turning further to the left, a robot that drives along y ends at "
    "a smaller x": f"{_SWING} => y / 2], [s, c, x / 2]",
    "the third column has the wrong sign: turning further to the left moves the end to the left": (
        f"{_SWING} => y / 2], [s, c, -x / 2]"
    ),
    "an error of the turn rate moves the end across the chord, not along it": (
        f"{_SWING} => x / 2], [s, c, y / 2]"
    ),
    "the heading of the middle turns by half of what the end turns": f"{_SWING} => -y], [s, c, x]",
    "this F_u is that of Euler's step: an error of omega turns the heading of the middle, too": (
        f"{_SWING} => 0], [s, c, 0]"
    ),
    "the third column needs the displacement of the step, not its velocity": (
        "dt * (c * u[0] - s * u[1]), dt * (s * u[0] + c * u[1])"
        " => (c * u[0] - s * u[1]), (s * u[0] + c * u[1])"
    ),
    "V_2 is missing in the displacement of the step": ("(c * u[0] - s * u[1]) => c * u[0]"),
    "dt is missing in F_u: a velocity acts for the time dt": "F_u = dt * np => F_u = np",
    "dt enters once: it stands in F_u on both sides": "F_u @ V @ F_u.T => F_u @ V @ F_u.T / dt",
    "the velocity was rotated the wrong way round: forward is (cos, sin) in the world": (
        "[[c, -s, => [[c, s,",
        "[s, c, => [-s, c,",
    ),
    "the second F_u is not transposed": "F_u.T => F_u",
    "the second F_u is missing: a covariance is turned from both sides": " @ F_u.T => ",
    "the heading's noise got lost: omega acts for dt as well": "[0, 0, 1]] => [0, 0, 0]]",
    "V is a covariance already: it is not squared": "@ V @ => @ V @ V @",
    "this is the noise of the exact step: leave out the chord's factor, sin(h)/h": _exact_noise,
    "the chord's factor, sin(h)/h, is in this F_u: leave it out": _with_the_factor,
}

# %% [markdown] tags=["solution"]
# ## Solution 3: the noise of a step in a curve
#
# The displacement of the step is $(x, y)$, along the heading of its middle, $\theta +
# \omega\,dt/2$. If $\omega$ is larger by $\delta$, the middle heading is larger by
# $\delta\,dt/2$, and the displacement swings to the left: $x$ changes by
# $-y\,\delta\,dt/2$, and $y$ by $+x\,\delta\,dt/2$. That is the third column. The program had
# $+y$. Along $x$ this does not show, there $y = 0$. Its other bug took the heading of the end of
# the step, and that shows in a turn only.

# %% [markdown] tags=["solution"]
# How much does the third column matter? The standard deviation of the place across the chord, in
# one step of the picture, and in one that is ten times shorter; with it, and with the lesson's
# $F_u$:

# %% active="ipynb" tags=["solution"]
# def lesson_noise(theta, u, dt, V):
#     c, s = np.cos(theta), np.sin(theta)
#     F_u = dt * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
#     return F_u @ V @ F_u.T
#
#
# u, V = np.array([0.8, 0.0, 0.6]), np.diag([0.02, 0.02, 0.2]) ** 2
# for dt in (0.8, 0.08):
#     middle = 0.3 + u[2] * dt / 2
#     across = np.array([-np.sin(middle), np.cos(middle), 0])
#     for name, noise in (("this F_u", process_noise), ("the lesson's", lesson_noise)):
#         sigma = np.sqrt(across @ noise(0.3, u, dt, V) @ across)
#         print(f"dt {dt} s, {name}: {1000 * sigma:.1f} mm across the chord")

# %% [markdown] tags=["solution"]
# In short steps it hardly matters, and the lesson may leave it out; in a step of 0.8 s it makes
# the ellipse more than three times as long. With the lesson's $F_u$:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: a step in a curve and 1000 robots at its end; in the left one the ellipse is round and holds half of the cloud, in the right one it covers the cloud."}}
# check_noise.draw(lesson_noise)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a worn wheel
#
# A robot has a front wheel that is worn by 1 %: at 10 rad/s it is 0.1 rad/s faster than the
# others. The error of each wheel speed has a standard deviation of 0.2 rad/s. So in *one* reading
# the wear is a quarter of a standard deviation of the residual, and an alarm on single readings
# cannot tell it from noise. But in a sum of many readings the errors cancel in part, and the wear
# adds up.
#
# Build an alarm that sums for a while. From the wheel speeds of a drive (four mecanum wheels)
# make, for every window of `n` readings in a row, one number: it is 0 without slip and noise,
# whatever the robot drives, and it has standard deviation 1 if each wheel speed in each reading
# has an independent error of standard deviation `sigma`.
#
# The picture shows the alarm on a drive of 150 s, ten readings per second, with windows of 400.
# The wheels turn at 10 rad/s on average; the error of each has a standard deviation of 0.2 rad/s.
# At 50 s the wear of the *front*-left wheel begins, 1 %. At 100 s the robot reverses and drives
# home backward, as fast as it drove out. **Write down** before you open it: about when does the
# alarm pass 3, and what does it say while the robot drives home?


# %% tags=["exercise", "predict"]
def slip_alarm(wheels: Array, sigma: float, n: int) -> Any:
    """How far windows of wheel speeds are from any motion, in standard deviations.

    Parameters
    ----------
    wheels : ndarray, shape (T, 4)
        Front-left, front-right, rear-left, rear-right (rad/s).
    sigma : float
        Standard deviation of each wheel speed (rad/s).
    n : int
        Readings in a window, at most T.

    Returns
    -------
    ndarray, shape (T - n + 1,)
        Entry k is of the readings k to k + n - 1; positive if the front axle spins
        too fast while the robot drives forward.
    """
    slip = wheels @ np.array([1, 1, -1, -1])
    sums = np.convolve(slip, np.ones(n), "valid")
    return sums / (2 * sigma * np.sqrt(n))


# %% active="ipynb" tags=["try"]
# slip_alarm(np.array([[8.0, 5, 5, 5], [6, 5, 5, 5], [5, 5, 5, 5]]), 0.5, 2)

# %% [markdown] tags=["hint"]
# Which combination of the four speeds is 0 for forward, for left and for turning, whatever the
# speeds are? It is in the lesson's (A).

# %% [markdown] tags=["hint"]
# Variances of independent errors add: what is the standard deviation of a + b - c - d, and of the
# sum of n such numbers?

# %% [markdown] tags=["hint"]
# Sums over windows: `np.convolve(x, np.ones(n), "valid")`, or differences of `np.cumsum`.


# %% tags=["cases"]
def _slip_drawn(ax: Any, function: Any) -> None:
    """Draw alarms of 1 reading (thin) and of 400 (thick); dotted: the wear begins, the way home."""
    from slamlab import plots

    rng, t, half = np.random.default_rng(2), 0.1 * np.arange(1500), 0.385
    u = np.column_stack([10 + 0 * t, 2 * np.sin(t), 3 * np.cos(0.5 * t)])
    u[1000:] *= -1
    map_of_wheels = np.array([[1, -1, -half], [1, 1, half], [1, 1, -half], [1, -1, half]])
    wheels = u @ map_of_wheels.T
    wheels[500:, 0] *= 1.01
    wheels += rng.normal(0, 0.2, wheels.shape)
    for n, style in ((1, {"lw": 0.4, "alpha": 0.5}), (400, {"lw": 2.0})):
        alarm = np.asarray(function(wheels, 0.2, n), float)
        ax.plot(t[n - 1 :], alarm, color=plots.COLOURS["estimate"], **style)
    for level in (-3, 3):
        ax.axhline(level, **plots.line_style("truth"))
    for when, what in ((50, "wear"), (100, "home")):
        ax.axvline(when, color="0.4", lw=1.2, ls=":")
        ax.text(when + 2, 7.2, what, fontsize=10)
    ax.set(xlabel="time (s)", ylabel="alarm (standard deviations)", ylim=(-7, 9))


@drawn
def _drive(rng: np.random.Generator, length: int, n: int) -> Any:
    return np.round(rng.uniform(-9, 9, (length, 4)), 1), 0.43, n


check_slip = Check(
    slip_alarm,
    "alarm",
    {
        "one reading, a spinning front-left wheel": ([[8.0, 5.0, 5.0, 5.0]], 0.5, 1),
        "a slow rear axle, two readings": ([[5.0, 5.0, 1.0, 1.0]] * 2, 0.5, 2),
        "turning and strafing": ([[2.0, 9.0, 6.0, 5.0], [-1, 3, 0, 2]], 0.3, 2),
        "windows overlap": ([[8.0, 5, 5, 5], [6, 5, 5, 5], [5, 5, 5, 4], [5, 5, 5, 5]], 0.5, 2),
        "single readings of a drive": _drive(5, 1),
        "windows of a drive": _drive(12, 4),
        "one window": _drive(7, 7),
    },
    picture=_slip_drawn,
)

# %% tags=["mistakes"]
_PATTERN = "[1, 1, -1, -1]"


check_slip.mistakes = {
    "this pattern is strafing to the right: diagonal against diagonal is a motion": (
        f"{_PATTERN} => [1.0, -1.0, -1.0, 1.0]"
    ),
    "this pattern is a turn: right against left is what a rotating robot does": (
        f"{_PATTERN} => [-1.0, 1.0, -1.0, 1.0]"
    ),
    "this pattern is a turn to the right: left against right": (
        f"{_PATTERN} => [1.0, -1.0, 1.0, -1.0]"
    ),
    "this pattern is strafing: diagonal against diagonal is a motion": (
        f"{_PATTERN} => [-1.0, 1.0, 1.0, -1.0]"
    ),
    "all wheels together are forward motion, not slip": (f"{_PATTERN} => [1.0, 1.0, 1.0, 1.0]"),
    "the sum of four independent errors has 2 sigma, not sigma": "(2 * sigma => (sigma",
    "this is half of what is expected: variances add, so front minus rear, a + b - c - d, has 2 "
    "sigma, and a quarter of it has half a sigma": "(2 * sigma => (4 * sigma",
    "this is a quarter of what is expected: a quarter of the pattern has half a sigma, not 2": (
        f"{_PATTERN} => [0.25, 0.25, -0.25, -0.25]"
    ),
    "divide by the standard deviation: 2 sigma, not 4 sigma squared": (
        "(2 * sigma => (4 * sigma**2"
    ),
    "n readings have a standard deviation sqrt(n) times as large, not n times: variances add": (
        "np.sqrt(n) => n"
    ),
    "the standard deviation of a sum of n readings grows with sqrt(n)": " * np.sqrt(n)) => )",
    "the sign is reversed: a front axle that spins too fast is positive": (
        f"{_PATTERN} => [-1.0, -1.0, 1.0, 1.0]"
    ),
    "only one side was compared: all four wheels have a say": (
        f"{_PATTERN} => [1.0, 0.0, -1.0, 0.0]"
    ),
    "the windows were padded with zeros: only whole windows are asked for": ('"valid" => "full"'),
    "the size alone was returned: the sign tells which axle spins": (
        lambda *given: np.abs(slip_alarm(*given))
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: a worn wheel
#
# Front minus rear is the one combination that vanishes for all three motions. Its variance is
# four times that of a wheel, and that of a sum of $n$ such numbers $4 n \sigma^2$. What keeps its
# sign grows with $n$, the noise with $\sqrt n$.

# %% [markdown] tags=["solution"]
# Dividing by $n$ looks natural, as a mean. But then the number that a worn wheel gives is on
# average the same for each $n$, and never comes nearer to an alarm at 3, however long it sums:

# %% active="ipynb" tags=["solution"]
# def by_the_mean(wheels, sigma, n):
#     slip = wheels @ np.array([1, 1, -1, -1])
#     return np.convolve(slip, np.ones(n), "valid") / (2 * sigma * n)
#
# check_slip(by_the_mean)

# %% active="ipynb" tags=["solution"]
# errors = np.random.default_rng(0).normal(0, 0.2, (4000, 4))
# worn = np.array([10.1, 10, 10, 10]) + errors
# for n in (1, 10, 100, 400):
#     right, mean = slip_alarm(worn, 0.2, n).mean(), by_the_mean(worn, 0.2, n).mean()
#     print(f"{n:3d} readings: alarm {right:.2f}, divided by n {mean:.2f}")

# %% [markdown] tags=["solution"]
# What this buys: 400 readings, forty seconds at ten per second, make five standard deviations of a
# wear of which one reading shows a quarter of one. The price is a delay: for forty seconds the
# window still holds readings of before, and it takes 24 of them to pass 3, on average.

# %% [markdown] tags=["solution"]
# **What does the alarm say on the way home?** It goes back to 0, and then to the other side. Wear
# is 1 % of the wheel's *speed*, and changes its sign with the direction. Twenty seconds after the
# robot has turned back, half of the window is forward and half is backward, and the two cancel;
# forty seconds after, the alarm is near -5, as if a rear wheel were worn. Where a robot drives to
# and fro within each window, the wear does not show at all. The same without noise, for three
# windows of 400 and one of the whole drive:

# %% active="ipynb" tags=["solution"]
# direction = np.repeat([1, -1], 400)[:, None]
# to_and_fro = direction * np.array([10.1, 10, 10, 10])
# alarm = slip_alarm(to_and_fro, 0.2, 400)
# whole = slip_alarm(to_and_fro, 0.2, 800)[0]
# print(f"out {alarm[0]:+.1f}, half and half {abs(alarm[200]):.1f}, "
#       f"home {alarm[400]:+.1f}, the whole drive {abs(whole):.1f}")
# forward = np.sign(to_and_fro.mean(axis=1))[:, None]  # -1 where it drives backward
# alarm = slip_alarm(forward * to_and_fro, 0.2, 400)
# print(f"with the sign of the direction: {alarm.min():+.1f} to {alarm.max():+.1f}")

# %% [markdown] tags=["solution"]
# Turn the sign of the readings that are driven backward, and the alarm is at +5 all along. It
# tells that an axle is wrong, not which wheel.

# %% [markdown] tags=["statement"]
# ## Exercise 5: your odometry, and 1000 robots that test it
#
# One wheel of the lesson's mecanum robot, the front-left one, has grease on its rollers. It slips
# at random, five times as much as each of the others, and slip adds up. Assemble an odometry that
# knows it. From four wheel speeds comes a body velocity, $u = A\,\omega_w$ with (9a) of the
# lesson,
#
# $$
# A = \frac r4\begin{bmatrix} 1 & 1 & 1 & 1\\ -1 & 1 & 1 & -1\\ -1/l & 1/l & -1/l & 1/l
# \end{bmatrix}.
# $$
#
# The errors of the four speeds are independent, each with its own standard deviation. Move the
# pose with your `exact_step`; move its covariance with $P \leftarrow F P F^\top + Q$, where $F$ is
# the derivative of *that* step by the pose before it (the lesson's is Euler's), and $Q$ is your
# `process_noise` for the heading before the step. This $Q$ is an approximation: it leaves out the
# factor $\sin(h)/h$ of the chord, which is 0.998 in the corner of the picture.
#
# The picture tests it: 1000 robots drive one metre ahead, round a corner to the left and one metre
# more ($l$ = 0.38 m), and their wheels do not do quite what the encoders say. **Write down**
# before you open it: along which line do the robots lie after the first metre: ahead, across, or
# at which angle between? If the front-left wheel alone moves the robot more than its encoder says,
# the body is faster forward and to the right, by the same amount, and it turns right.


# %% tags=["exercise", "predict"]
def odometry(
    pose: Array, P: Array, wheels: Array, dt: float, r: float, lever: float, sigma: Array
) -> tuple[Array, Array]:
    """Poses and covariances of a drive, after each step; the start is not among them.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        Before the first step (m, m, rad).
    P : ndarray, shape (3, 3)
        Covariance of that pose, in m^2 and rad^2; zeros if it is known exactly.
    wheels : ndarray, shape (T, 4)
        Wheel speeds (rad/s): front left, front right, rear left, rear right.
    dt : float
        Duration of a step (s).
    r, lever : float
        Radius of a wheel, and l of the formula (m).
    sigma : ndarray, shape (4,)
        Standard deviations of the speeds of the four wheels (rad/s).

    Returns
    -------
    poses : ndarray, shape (T, 3)
        The first is that after the first step.
    covs : ndarray, shape (T, 3, 3)
        Their covariances.
    """
    turning = np.array([-1, 1, -1, 1]) / lever
    A = r / 4 * np.array([[1, 1, 1, 1], [-1, 1, 1, -1], turning])
    V = A @ np.diag(sigma**2) @ A.T
    poses, covs = [], []
    for speeds in wheels:
        u = A @ speeds
        new, F = exact_step(pose, u, dt), np.eye(3)
        F[:2, 2] = pose[1] - new[1], new[0] - pose[0]
        P = F @ P @ F.T + process_noise(pose[2], u, dt, V)
        pose = new
        poses.append(pose)
        covs.append(P)
    return np.array(poses), np.array(covs)


# %% active="ipynb" tags=["try"]
# odometry(np.zeros(3), np.zeros((3, 3)), np.full((2, 4), 8.0), 0.2, 0.05, 0.38,
#          np.array([0.9, 0.3, 0.3, 0.3]))

# %% [markdown] tags=["hint"]
# The covariance of $u$ comes from that of the wheels, a diagonal matrix, through $A$ on both
# sides.

# %% [markdown] tags=["hint"]
# How do $x$ and $y$ after a step change if the heading before it was a little larger? The whole
# displacement swings to the left. That is the third column of $F$; the rest is the identity.

# %% [markdown] tags=["hint"]
# Order matters: the noise at the old heading, and $F$ from the old place to the new one.


# %% tags=["cases"]
@drawn
def _driving(
    rng: np.random.Generator,
    n: int,
    scale: float,
    sigma: float,
    robot: tuple[float, ...] = (0.2, 0.05, 0.38),
) -> Any:
    root = rng.normal(size=(3, 3))
    wheels = np.round(rng.uniform(-2, 9, (n, 4)), 1)
    return a_pose(rng), scale * root @ root.T, wheels, *robot, sigma * np.array([3, 1, 0.5, 1])


_GREASY = np.array([2.5, 0.5, 0.5, 0.5])
_TURNING = np.array([-1, 1, -1, 1]) / 0.38
_NINE_A = 0.05 / 4 * np.array([[1, 1, 1, 1], [-1, 1, 1, -1], _TURNING])


def _odometry_drawn(ax: Any, function: Any) -> None:
    """Draw 1000 robots and 95 % ellipses after 1 m (also enlarged), the corner and 1 m more.

    Numbers: share inside the ellipse, mean NEES of the place (2 expected) and of the pose (3).
    """
    from slamlab import plots

    rng, dt, robots = np.random.default_rng(5), 0.2, np.zeros((1000, 3))
    u = np.repeat([[0.5, 0, 0], [0.4, 0, np.pi / 3.2], [0.5, 0, 0]], [10, 8, 10], axis=0)
    wheels = u @ np.linalg.pinv(_NINE_A).T
    start = np.zeros(3)
    poses, covs = (
        np.asarray(part, float)
        for part in function(start, np.zeros((3, 3)), wheels, dt, 0.05, 0.38, _GREASY)
    )
    lines = []
    zoom = ax.inset_axes((0.04, 0.42, 0.46, 0.56), xticks=[], yticks=[])
    for k, speeds in enumerate(wheels):
        robots = _moved(robots, (speeds + _GREASY * rng.normal(size=(1000, 4))) @ _NINE_A.T, dt)
        if k not in (9, 17, 27):
            continue
        for panel in (ax, zoom) if k == 9 else (ax,):
            plots.lidar_points(panel, robots[:, :2], s=0.5)
            plots.ellipse(panel, poses[k, :2], covs[k, :2, :2])
        e = robots - poses[k]
        e[:, 2] = wrap_angle(e[:, 2])
        place, pose = (
            np.sum(e[:, :m] * np.linalg.solve(covs[k, :m, :m], e[:, :m].T).T, axis=1)
            for m in (2, 3)
        )
        lines.append(f"{(place < 5.991).mean():.0%}, {place.mean():.2f}, {pose.mean():.2f}")
    plots.path(ax, np.vstack([start, poses]))
    ax.plot(0, 0, "o", color=plots.COLOURS["estimate"], markersize=6)
    plots.floor(ax)
    ax.set(xlim=(0, 1.9), ylim=(-0.15, 1.65))
    zoom.set_aspect("equal", adjustable="box")
    zoom.set(xlim=(0.82, 1.18), ylim=(-0.22, 0.22))
    zoom.spines[:].set(visible=True, color="0.6")
    box = np.array([[0.82, 1.18, 1.18, 0.82, 0.82], [-0.22, -0.22, 0.22, 0.22, -0.22]])
    ax.plot(*box, color="0.6", lw=0.8)
    ax.set_title(f"inside, place, pose\nafter 1 m: {lines[0]}\nat the end: {lines[-1]}")


def draw_equal_wheels(odometry: Any) -> Any:
    """Draw an odometry that takes all wheels for equally good, beside one that knows better."""
    from slamlab.exercises._pictures import side_by_side

    def equal(*given: Any) -> Any:
        mean = np.full(4, np.sqrt(np.mean(given[-1] ** 2)))
        return odometry(*given[:-1], mean)

    names = "Yours, all wheels alike", "As it should be"
    return side_by_side(_odometry_drawn, equal, check_odometry.reference, names)


check_odometry = Check(
    odometry,
    "poses, covs",
    {
        "one step from a known place": _driving(1, 0.0, 0.3, (0.5, 0.0475, 0.6)),
        "one step with exact wheels": _driving(1, 0.02, 0.0),
        "a drive": _driving(10, 0.02, 0.2, (0.1, 0.1, 0.25)),
        "straight on, the heading uncertain": (
            [0, 0, 0.5],
            np.diag([0, 0, 0.01]),
            np.full((5, 4), 8.0),
            0.2,
            0.05,
            0.38,
            np.zeros(4),
        ),
        "a turn to the right, through half a turn": (
            [1, 0, -3.1],
            np.diag([0.01, 0.02, 0.01]),
            np.tile([6.0, 2.0, 6.0, 2.0], (4, 1)),
            0.2,
            0.05,
            0.38,
            [0.2, 0.3, 0.15, 0.25],
        ),
    },
    tolerance=1e-8,
    picture=_odometry_drawn,
)


# %% tags=["mistakes"]
def euler(pose: Array, u: Array, dt: float) -> Array:
    """Move along the heading at the start of the step."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    step = np.array([c * u[0] - s * u[1], s * u[0] + c * u[1], u[2]])
    return np.append((pose + dt * step)[:2], wrap_angle(pose[2] + dt * u[2]))


check_odometry.mistakes = {
    "this is F^T P F: expected F P F^T": "F @ P @ F.T => F.T @ P @ F",
    "an error of the heading becomes one of the position: expected F P F^T": "F @ P @ F.T => P",
    "the noise of the wheels is missing": " + process_noise(pose[2], u, dt, V) => ",
    "sigma is a standard deviation: V holds its square": "sigma**2 => sigma",
    "the noise of the wheels was taken for that of the body: it goes through A": (
        "A @ np.diag(sigma**2) @ A.T => np.diag(sigma[:3] ** 2)"
    ),
    "all wheels were taken for equally good: each has its own sigma": (
        "np.diag(sigma**2) => (np.mean(sigma**2) * np.eye(4))"
    ),
    "the noise was taken at the heading after the step": (
        "        P = F @ P @ F.T + process_noise(pose[2], u, dt, V)\n        pose = new\n"
        " =>         pose = new\n        P = F @ P @ F.T + process_noise(pose[2], u, dt, V)\n"
    ),
    "F is that of Euler's step: this step is exact, and its displacement swings as a whole": (
        "F[:2, 2] = pose[1] - new[1], new[0] - pose[0]"
        " => F[:2, 2] = np.diff([pose, euler(pose, u, dt)], axis=0)[0, [1, 0]] * [-1, 1]"
    ),
    "the pose moved by Euler's step: use your `exact_step`": (
        "exact_step(pose, u, dt) => euler(pose, u, dt)"
    ),
    "the noise is that of Euler's step: an error of omega moves the end, too (`process_noise`)": (
        "process_noise(pose[2], u, => process_noise(pose[2], 0 * u,"
    ),
    "your `process_noise` still has the two bugs of Exercise 3: repair them first": (
        "process_noise( => _both_bugs("
    ),
    "your `process_noise` still has a bug of Exercise 3: its check fails along y": (
        "process_noise( => _sign_bug("
    ),
    "your `process_noise` still has a bug of Exercise 3: its check fails in a curve": (
        "process_noise(pose[2], => process_noise(pose[2] + 0.5 * u[2] * dt,"
    ),
    "your `process_noise` takes the heading of the start of the step: see Exercise 3": (
        "process_noise(pose[2], => process_noise(pose[2] - 0.5 * u[2] * dt,"
    ),
    "this Q is that of the exact step: leave out the chord's factor, sin(h)/h": (
        "process_noise( => _exact_noise("
    ),
    "the chord's factor, sin(h)/h, is in the F_u of this Q: leave it out": (
        "process_noise( => _with_the_factor("
    ),
    "the displacement swings to the wrong side: a heading that is larger moves the end to the left": (
        "pose[1] - new[1], new[0] - pose[0] => new[1] - pose[1], pose[0] - new[0]"
    ),
    "the lever multiplies: turning at omega needs wheel speeds of lever omega": (
        "/ lever => * lever"
    ),
    "the turn has the wrong sign: the right wheels are faster when it turns left": (
        "/ lever => / -lever"
    ),
    "a quarter is missing: four wheels share the motion": "r / 4 * => r *",
    "the wheels come in another order: front left, front right, rear left, rear right": (
        "[-1, 1, 1, -1] => [1, -1, -1, 1]"
    ),
    "only the last belief was returned: expected the one after each step": (
        lambda *given: (odometry(*given)[0][-1], odometry(*given)[1][-1])
    ),
}

# %% [markdown] tags=["statement"]
# ### Which test finds it?
#
# The numbers above each panel are tests, after the first metre and at the end: the share of robots
# inside the 95 % ellipse of the place, the mean NEES of the place, and that of the whole pose.
# Where the covariance is right, each test is in its band in about 99 % of runs with 1000 robots:
#
# | test | expected | band |
# |---|---|---|
# | inside | 95 % | 93 to 97 % |
# | place | 2 | 1.84 to 2.17 |
# | pose | 3 | 2.80 to 3.20 |
#
# A colleague saves a line: all four wheels get one sigma, the root of the mean of their variances.
# **Write down**: which of the three tests find this after the first metre, and which at the end?
# Then open the picture; it runs your odometry.

# %% active="ipynb" tags=["statement", "hide-output"] mystnb={"image": {"alt": "Two panels, your odometry with all wheels alike and the right one: 1000 robots after 1 m, after a corner and at the end, with 95 % ellipses and three tests of them."}}
# from slamlab.exercises.ch05_mecanum_kinematics import draw_equal_wheels
#
# draw_equal_wheels(odometry)

# %% [markdown] tags=["solution"]
# ## Solution 5: odometry
#
# **Along which line?** A front-left wheel that is faster than its encoder says makes the body
# faster forward and to the right by the same amount. That alone would be a line at 45 degrees
# between ahead and right. But it also turns the body right, by $1/l$ of that amount, and the rest
# of the path swings to the right with it: at the start, with 1 m to go and $l$ = 0.38 m, by 2.6
# times as much as the direct error. So the line is nearer to across the path.

# %% [markdown] tags=["solution"]
# $F$ is what makes the path swing. With $F$ the identity the noise of the steps is added up
# without it (but for the swing within each step):

# %% active="ipynb" tags=["solution"]
# def covariance_that_stays(pose, P, wheels, dt, r, lever, sigma):
#     turning = np.array([-1, 1, -1, 1]) / lever
#     A = r / 4 * np.array([[1, 1, 1, 1], [-1, 1, 1, -1], turning])
#     V = A @ np.diag(sigma**2) @ A.T
#     poses, _ = odometry(pose, P, wheels, dt, r, lever, sigma)
#     before = [pose, *poses[:-1]]
#     Q = [process_noise(p[2], A @ w, dt, V) for p, w in zip(before, wheels)]
#     return poses, P + np.cumsum(Q, axis=0)
#
# check_odometry(covariance_that_stays)

# %% [markdown] tags=["solution"]
# The first metre of the picture, computed by both. With $F$ the line is at 69 degrees, far nearer
# to across the path than the 45 that a first guess gives; without it, at 49, and the ellipse is
# little more than half as long:

# %% active="ipynb" tags=["solution"]
# wheels, sigma = np.full((10, 4), 10.0), np.array([2.5, 0.5, 0.5, 0.5])
# drive = np.zeros(3), np.zeros((3, 3)), wheels, 0.2, 0.05, 0.38, sigma
# methods = {"F of the step": odometry, "F identity": covariance_that_stays}
# for name, method in methods.items():
#     xy = method(*drive)[1][-1, :2, :2]
#     (low, high), axes = np.linalg.eigh(xy)
#     to_right = np.degrees(np.arctan2(-axes[1, 1], axes[0, 1])) % 180
#     print(f"{name}: line {to_right:.0f} degrees to the right of ahead, "
#           f"sigma {100 * np.sqrt(high):.1f} by {100 * np.sqrt(low):.1f} cm, "
#           f"correlation of x and y {xy[0, 1] / np.sqrt(xy[0, 0] * xy[1, 1]):.2f}")

# %% [markdown] tags=["solution"]
# **Which test?** Take all four wheels for equally good, and the ellipse of the first metre is
# upright and too round: it covers empty floor and misses the ends of the cloud. Both tests of the
# place find it, after the first metre and at the end. The mean NEES of the pose finds it at the
# end only: after the first metre it is near 3, as it should be. The bands of 1000 robots, from the
# binomial and the chi-square distribution:

# %% active="ipynb" tags=["solution"]
# print("inside: {:.1%} to {:.1%}".format(*binom.ppf([0.005, 0.995], 1000, 0.95) / 1000))
# print("NEES of the place: {:.2f} to {:.2f}".format(*chi2_band(2, 1000)))
# print("NEES of the pose: {:.2f} to {:.2f}".format(*chi2_band(3, 1000)))

# %% [markdown] tags=["solution"]
# With one sigma for all wheels:

# %% active="ipynb" tags=["solution"]
# def equally_good(pose, P, wheels, dt, r, lever, sigma):
#     mean = np.full(4, np.sqrt(np.mean(sigma**2)))
#     return odometry(pose, P, wheels, dt, r, lever, mean)
#
# check_odometry(equally_good)

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: 1000 robots after 1 m, after a corner and at the end; in the left one the first ellipse is upright and too round and holds 88 % of its leaning cloud, in the right one the ellipses lean with the clouds and hold 95 %."}}
# check_odometry.draw(equally_good)

# %% [markdown] tags=["solution"]
# Is that luck? If the errors have the covariance $P$ and the program says $\hat P$, the mean NEES
# to expect is the trace of $\hat P^{-1} P$, the sum of its eigenvalues; no robot has to drive for
# it. For the first metre, and for a corner to either side:

# %% active="ipynb" tags=["solution"]
# turning = np.array([-1, 1, -1, 1]) / 0.38
# A = 0.05 / 4 * np.array([[1, 1, 1, 1], [-1, 1, 1, -1], turning])
# drives = {"first metre": 0, "corner to the left": 1, "to the right": -1}
# for name, side in drives.items():
#     parts = [0.5, 0, 0], [0.4, 0, side * np.pi / 3.2], [0.5, 0, 0]
#     u = np.repeat(parts, [10, 8, 10], axis=0)
#     wheels = u[: 28 if side else 10] @ np.linalg.pinv(A).T
#     drive = np.zeros(3), np.zeros((3, 3)), wheels, 0.2, 0.05, 0.38, sigma
#     P, said = (method(*drive)[1][-1] for method in (odometry, equally_good))
#     place, pose = (np.linalg.eigvals(np.linalg.solve(said[:m, :m], P[:m, :m])).real
#                    for m in (2, 3))
#     ratios = " + ".join(f"{ratio:.2f}" for ratio in np.sort(pose))
#     print(f"{name}: mean NEES of the place {place.sum():.2f}, "
#           f"of the pose {pose.sum():.2f} = {ratios}")

# %% [markdown] tags=["solution"]
# On the straight metre the mean NEES of the pose is 3.00 with the bug, too. Each wheel has the
# same share in the least squares, so the variances of forward, left and turn stay what they are,
# and only the entries beside the diagonal of $V$ are lost. In one direction the variance is 2.5
# times what the program says, in the two others it is less than half, and the sum hides it. In the
# corner to the right the sum of the *place* hides it. A mean NEES that is right says that the
# errors are as large as the covariance says on average over the directions, on this drive. So test
# on several drives, and draw the cloud.

# %% [markdown] tags=["solution"]
# You now have an odometry of a mecanum robot that says how far it may be off, and tests that find
# mistakes in it, though none of them finds all. For the robot of Exercise 1, put the inverse of
# its wheel map in the place of $A$.

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 05](../solutions/05_mecanum_kinematics.ipynb).
