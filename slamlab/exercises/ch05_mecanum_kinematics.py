"""Exercises, chapter 05: wheel map, exact step, process noise, slip alarm, odometry.

P1 (9), (10), (14) and (17) with its dt, and the wheel map (9a) that P1 leaves out.
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
# Five exercises, from four wheels to a pose with its covariance; the chapter is [Mecanum
# kinematics and odometry](../05_mecanum_kinematics.ipynb). Replace each `...` and run the check
# below it as often as you like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 05: mecanum kinematics
#
# The exercises are in [Exercises 05](../exercises/05_mecanum_kinematics.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: the wheel map
#
# What must the four wheels do so that the body moves with a given velocity?


# %% tags=["exercise"]
def wheel_speeds(u: Array, r: float, half_length: float, half_width: float) -> Array:
    """Wheel speeds of a mecanum platform.

    Parameters
    ----------
    u : ndarray, shape (3,)
        Body velocity: forward (m/s), to the left (m/s), turning left (rad/s).
    r, half_length, half_width : float
        Wheel radius and the two half distances of the wheels (m).

    Returns
    -------
    ndarray, shape (4,)
        Front-left, front-right, rear-left, rear-right (rad/s).
    """
    forward, left, turn = u[0], u[1], (half_length + half_width) * u[2]
    front = forward - left - turn, forward + left + turn
    rear = forward + left - turn, forward - left + turn
    return np.array([*front, *rear]) / r


# %% active="ipynb" tags=["try"]
# wheel_speeds(np.array([0.4, 0.0, 0.0]), 0.0475, 0.235, 0.15)

# %% [markdown] tags=["hint"]
# Take one motion at a time. Forward: all wheels alike. To the left: the front-left wheel turns
# backward. Which one stands on the same diagonal?

# %% [markdown] tags=["hint"]
# Turning left speeds up both right wheels. Its lever is the half length plus the half width.

# %% [markdown] tags=["hint"]
# Front-left is `(u[0] - u[1] - (half_length + half_width) * u[2]) / r`.


# %% tags=["cases"]
def _platform(rng: np.random.Generator) -> Any:
    return np.round(rng.uniform(-1, 1, 3), 2), 0.05, 0.2, float(np.round(rng.uniform(0.1, 0.5), 2))


_YOUBOT = (0.0475, 0.235, 0.15)


def _wheels_drawn(ax: Any, function: Any) -> None:
    """Draw the path that a robot is to drive, strafing and turning, and the one of its wheels."""
    from slamlab import plots

    r, lever, t = 0.0475, 0.385, np.linspace(0, 8, 161)
    wished = np.column_stack([0.5 + 0 * t, 0.3 * np.sin(0.8 * t), 0.7 * np.cos(0.5 * t)])
    wheels = np.array([np.asarray(function(u, r, 0.235, 0.15), float) for u in wished])
    B = r / 4 * np.array([[1, 1, 1, 1], [-1, 1, 1, -1], [-1, 1, -1, 1]])
    B[2] /= lever
    for velocities, kind in ((wished, "truth"), (wheels @ B.T, "estimate")):
        pose, path = np.zeros(3), [np.zeros(3)]
        for u in velocities:
            pose = exact_step(pose, u, 0.05)
            path.append(pose)
        plots.path(ax, np.array(path), kind)
    plots.floor(ax)


check_wheels = Check(
    wheel_speeds,
    "speeds",
    {
        "straight ahead, all wheels alike": ([0.4, 0.0, 0.0], *_YOUBOT),
        "to the left, diagonals against each other": ([0.0, 0.3, 0.0], *_YOUBOT),
        "turning left, right against left": ([0.0, 0.0, 0.8], *_YOUBOT),
        "all three at once": ([0.4, -0.2, 0.5], 0.0475, 0.3, 0.15),
        "another robot": ([-0.3, 0.1, 1.0], 0.1, 0.2, 0.4),
        "any robot": _platform,
    },
    picture=_wheels_drawn,
)

# %% tags=["mistakes"]
check_wheels.mistakes = {
    "the wheels come in another order: the left side first": (
        lambda *given: wheel_speeds(*given)[[0, 2, 1, 3]]
    ),
    "left and right are swapped: V_2 is positive to the left, so front-left slows down": (
        "= u[0], u[1] => = u[0], -u[1]"
    ),
    "the turn has the wrong sign: turning left speeds the right wheels up": ("* u[2] => * -u[2]"),
    "the lever is half length plus half width: one of them is missing": (
        "(half_length + half_width) => half_length"
    ),
    "the lever is half length plus half width: the half length is missing": (
        "(half_length + half_width) => half_width"
    ),
    "the lever is the sum of the half lengths; their difference belongs to wheels mounted "
    "the other way round": "half_length + half_width => half_length - half_width",
    "the lever of this wheel is the sum of the half lengths, not the distance to the centre": (
        "(half_length + half_width) => np.hypot(half_length, half_width)"
    ),
    "the lever is the sum of the half lengths, not twice that": (
        "(half_length + half_width) => 2 * (half_length + half_width)"
    ),
    "the lever is the sum of the half lengths, not their mean": (
        "(half_length + half_width) => (half_length + half_width) / 2"
    ),
    "the turn acts at a lever: multiply omega by the half lengths": (
        "(half_length + half_width) *  => "
    ),
    "multiplied by the wheel radius: a speed over the floor divided by r is a spin": (
        "/ r => * r"
    ),
    "these are speeds over the floor (m/s): divide by the wheel radius": " / r => ",
    "divided by the wheel's diameter: expected the radius": "/ r => / (2 * r)",
    "the wheels come in another order: front-left, front-right, rear-left, rear-right": (
        lambda *given: wheel_speeds(*given)[[0, 1, 3, 2]]
    ),
    "left and right wheels are exchanged: front-left, front-right, rear-left, rear-right": (
        lambda *given: wheel_speeds(*given)[[1, 0, 3, 2]]
    ),
    "the rear wheels strafe like the front ones: their rollers point the other way": (
        "forward + left - turn, forward - left + turn"
        " => forward - left - turn, forward + left + turn"
    ),
    "this is the inverse map with its quarter: the wheels are asked for": "/ r => / r / 4",
}

# %% [markdown] tags=["solution"]
# ## Solution 1: the wheel map
#
# Each motion has its own pattern of signs, and the patterns add because the constraint of a
# roller is linear. Half length and half width enter as a sum: at each wheel, a turn moves the
# floor contact forward by one of them and sideways by the other, and the roller at 45 degrees
# counts both alike.

# %% [markdown] tags=["solution"]
# The distance from the centre to the wheel looks like the natural lever, and it is right for a
# wheel that grips across that distance. A roller does not:

# %% active="ipynb" tags=["solution"]
# def by_distance(u, r, half_length, half_width):
#     lever = np.hypot(half_length, half_width)
#     return wheel_speeds(u, r, lever, 0.0)
#
# check_wheels(by_distance)

# %% [markdown] tags=["statement"]
# ## Exercise 2: the exact step
#
# While the robot moves for a time dt, its heading turns from theta to theta + omega dt, and the
# velocity turns with it. Where does it end?


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
# The mean direction of the velocity is that of the middle of the step, theta + h with h = omega
# dt / 2.

# %% [markdown] tags=["hint"]
# The mean of a unit vector that turns evenly from -h to h has length sin(h)/h. `np.sinc(h /
# np.pi)` is this number, 1 at h = 0 included.

# %% [markdown] tags=["hint"]
# Rotate `(u[0], u[1])` by `pose[2] + h`, multiply by `dt * np.sinc(h / np.pi)`, add. Then the
# heading; `slamlab.geometry.wrap_angle` wraps it.


# %% tags=["cases"]
def _driven(rng: np.random.Generator) -> Any:
    return a_pose(rng), np.round(rng.uniform(-2, 2, 3), 2), float(np.round(rng.uniform(0.1, 2), 2))


def _step_drawn(ax: Any, function: Any) -> None:
    """Draw a drive in nine long steps as poses, and in 1800 short ones as a line."""
    from slamlab import plots

    u, pose = np.array([0.8, 0.3, 0.9]), np.array([0.5, 0.2, 2.0])
    turned = pose[2] + 0.9 * np.linspace(0, 6.3, 1801)[:, None]
    c, s = np.cos(turned), np.sin(turned)
    speeds = np.hstack([c * u[0] - s * u[1], s * u[0] + c * u[1]])
    plots.path(ax, pose[:2] + np.cumsum(0.0035 * speeds, axis=0), "truth")
    for _ in range(9):
        pose = np.asarray(function(pose, u, 0.7), float)
        nose = pose[:2] + 0.25 * np.array([[0, 0], [np.cos(pose[2]), np.sin(pose[2])]])
        plots.path(ax, nose)
        ax.plot(pose[0], pose[1], "o", color=plots.COLOURS["estimate"], markersize=5)
    plots.floor(ax)


check_step = Check(
    exact_step,
    "pose",
    {
        "straight ahead": ([1.0, 2.0, 0.0], [0.5, 0.0, 0.0], 0.4),
        "a diagonal at another heading": ([1.0, 2.0, 0.9], [0.5, -0.3, 0.0], 0.4),
        "a quarter circle": ([0.0, 0.0, 0.3], [1.0, 0.0, np.pi / 2], 1.0),
        "a turn that is almost none": ([1.0, 2.0, 0.9], [0.5, -0.3, 1e-7], 0.4),
        "a full circle comes back": ([1.0, 2.0, 0.5], [0.7, 0.2, 2 * np.pi], 1.0),
        "no time, no motion": ([1.0, 2.0, 0.5], [0.7, 0.2, 1.0], 0.0),
        "the heading passes pi": ([0.0, 0.0, 3.0], [0.3, 0.1, 1.0], 0.5),
        "the heading passes -pi": ([0.0, 0.0, -3.0], [0.3, 0.1, -1.0], 0.5),
        "turning while strafing": _driven,
    },
    picture=_step_drawn,
)

# %% tags=["mistakes"]
check_step.mistakes = {
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
# Euler's step, P1 (10), passes where nothing turns, and where no time passes:

# %% active="ipynb" tags=["solution"]
# def euler(pose, u, dt):
#     c, s = np.cos(pose[2]), np.sin(pose[2])
#     return np.array([pose[0] + dt * (c * u[0] - s * u[1]),
#                      pose[1] + dt * (s * u[0] + c * u[1]),
#                      wrap_angle(pose[2] + dt * u[2])])
#
# check_step(euler)

# %% [markdown] tags=["statement"]
# ## Exercise 3: the process noise
#
# P1 (14) with the (17) that it should have printed.


# %% tags=["exercise"]
def process_noise(theta: float, dt: float, V: Array) -> Array:
    """Covariance that noisy velocities add to the pose in one step of Euler's method.

    Parameters
    ----------
    theta : float
        Heading at the start of the step (rad).
    dt : float
        Duration (s).
    V : ndarray, shape (3, 3)
        Covariance of the body velocity, (m/s)^2 and (rad/s)^2.

    Returns
    -------
    ndarray, shape (3, 3)
        Q, in m^2 and rad^2.
    """
    c, s = np.cos(theta), np.sin(theta)
    F_u = dt * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return F_u @ V @ F_u.T


# %% active="ipynb" tags=["try"]
# process_noise(0.0, 0.1, np.diag([0.04, 0.01, 0.09]))

# %% [markdown] tags=["hint"]
# Check the units: V is a covariance of speeds, Q one of places.

# %% [markdown] tags=["hint"]
# F_u is dt times the rotation by theta, with a 1 for the heading.

# %% tags=["cases"]
_V = np.diag([0.04, 0.01, 0.09])


def _noise_drawn(ax: Any, function: Any) -> None:
    """Draw where 1000 robots with noisy velocities stand after a step, and the ellipse of Q."""
    from slamlab import plots

    rng, theta, V = np.random.default_rng(1), 0.6, np.diag([0.16, 0.02, 0.09])
    c, s = np.cos(theta), np.sin(theta)
    noise = rng.multivariate_normal([0, 0, 0], V, 1000)[:, :2]
    plots.lidar_points(ax, 0.5 * noise @ np.array([[c, s], [-s, c]]), s=1.6)
    Q = np.asarray(function(theta, 0.5, V), float)
    plots.ellipse(ax, [0, 0], Q[:2, :2])
    plots.floor(ax)


check_noise = Check(
    process_noise,
    "Q",
    {
        "looking along x": (0.0, 0.1, _V),
        "heading along y, the variances change places": (np.pi / 2, 0.1, _V),
        "at an angle": (0.7, 0.1, _V),
        "twice the step, four times the noise": (0.7, 0.2, _V),
        "correlated speeds of a robot with one bad wheel": lambda rng: (
            an_angle(rng),
            float(np.round(rng.uniform(0.1, 2), 2)),
            a_covariance(rng, 3, 0.1),
        ),
    },
    picture=_noise_drawn,
)

# %% tags=["mistakes"]
check_noise.mistakes = {
    "dt is missing, as in the printed (17): a velocity acts for the time dt": "dt *  => ",
    "dt enters once: it stands in F_u on both sides": (
        lambda theta, dt, V: process_noise(theta, 1.0, V) * dt
    ),
    "the noise was not turned into the world": (lambda theta, dt, V: dt**2 * V),
    "rotated the wrong way round: F_u V F_u^T, not F_u^T V F_u": (
        "F_u @ V @ F_u.T => F_u.T @ V @ F_u"
    ),
    "the second F_u is not transposed": "F_u.T => F_u",
    "the second F_u is missing: a covariance is turned from both sides": " @ F_u.T => ",
    "this is F_u: expected the covariance F_u V F_u^T": "F_u @ V @ F_u.T => F_u",
    "the heading's noise got lost: omega acts for dt as well": ("[0, 0, 1]] => [0, 0, 0]]"),
    "dt was left out for the heading: omega acts for dt as well": (
        "[0, 0, 1]] => [0, 0, 1 / dt]]"
    ),
    "V is a covariance already: it is not squared": "@ V @ => @ V @ V @",
}

# %% [markdown] tags=["solution"]
# ## Solution 3: the process noise

# %% [markdown] tags=["solution"]
# With the paper's (17), without dt, Q keeps the units of V, those of speeds. At dt = 0.1 s it is a
# hundred times too large:

# %% active="ipynb" tags=["solution"]
# def printed_17(theta, dt, V):
#     c, s = np.cos(theta), np.sin(theta)
#     F_u = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
#     return F_u @ V @ F_u.T
#
# check_noise(printed_17)

# %% [markdown] tags=["statement"]
# ## Exercise 4: the slip alarm
#
# Four wheels that roll without slip cannot have any four speeds. Build a number that is 0 without
# slip and noise, and that has standard deviation 1 if each wheel speed has an independent error
# of standard deviation sigma.


# %% tags=["exercise"]
def slip_alarm(wheels: Array, sigma: float) -> Any:
    """How far the wheel speeds are from any motion, in standard deviations.

    Parameters
    ----------
    wheels : ndarray, shape (..., 4)
        Front-left, front-right, rear-left, rear-right (rad/s).
    sigma : float
        Standard deviation of each wheel speed (rad/s).

    Returns
    -------
    ndarray, shape (...)
        Positive if the front axle spins too fast.
    """
    return (wheels @ np.array([1, 1, -1, -1])) / (2 * sigma)


# %% active="ipynb" tags=["try"]
# slip_alarm(np.array([8.0, 5.0, 5.0, 5.0]), 0.5)

# %% [markdown] tags=["hint"]
# Which combination of the four speeds is 0 for forward, for left and for turning?

# %% [markdown] tags=["hint"]
# Variances of independent errors add: what is the standard deviation of a + b - c - d?


# %% tags=["cases"]
def _slip_drawn(ax: Any, function: Any) -> None:
    """Draw the alarm along a drive on which a front wheel spins from 8 s to 11 s, and 3 sigma."""
    from slamlab import plots

    rng, t, half = np.random.default_rng(2), 0.1 * np.arange(200), 0.385
    u = np.column_stack([8 + 0 * t, 2 * np.sin(t), 3 * np.cos(0.5 * t)])
    map_of_wheels = np.array([[1, -1, -half], [1, 1, half], [1, 1, -half], [1, -1, half]])
    wheels = u @ map_of_wheels.T + rng.normal(0, 0.5, (200, 4))
    wheels[80:110, 0] += 4.0
    ax.plot(t, np.asarray(function(wheels, 0.5), float), **plots.line_style("estimate"))
    for level in (-3, 3):
        ax.axhline(level, **plots.line_style("truth"))
    ax.set(xlabel="time (s)", ylabel="alarm (standard deviations)", ylim=(-8, 10))


check_slip = Check(
    slip_alarm,
    "alarm",
    {
        "a spinning front-left wheel": ([8.0, 5.0, 5.0, 5.0], 0.5),
        "a locked rear axle": ([5.0, 5.0, 1.0, 1.0], 0.5),
        "turning and strafing": ([2.0, 9.0, 6.0, 5.0], 0.3),
        "any four speeds": lambda rng: (np.round(rng.uniform(-9, 9, 4), 1), 0.4),
        "several readings at once": lambda rng: (np.round(rng.uniform(-9, 9, (3, 4)), 1), 0.3),
        "a table of readings": lambda rng: (np.round(rng.uniform(-9, 9, (2, 5, 4)), 1), 1.5),
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
    "the sum of four independent errors has 2 sigma, not sigma": "(2 * sigma) => sigma",
    "the sum of four independent errors has 2 sigma, not 4: variances add": (
        "(2 * sigma) => (4 * sigma)"
    ),
    "the sum of four independent errors has 2 sigma, not sqrt(2): four wheels are in it": (
        "(2 * sigma) => (np.sqrt(2) * sigma)"
    ),
    "divide by the standard deviation: 2 sigma, not 4 sigma squared": (
        "(2 * sigma) => (4 * sigma**2)"
    ),
    "this is not yet in units of its standard deviation": " / (2 * sigma) => ",
    "the sign is reversed: a front axle that spins too fast is positive": (
        f"{_PATTERN} => [-1.0, -1.0, 1.0, 1.0]"
    ),
    "only one side was compared: all four wheels have a say": (
        f"{_PATTERN} => [1.0, 0.0, -1.0, 0.0]"
    ),
    "the size alone was returned: the sign tells which axle spins": (
        lambda wheels, sigma: np.abs(slip_alarm(wheels, sigma))
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: the slip alarm
#
# Front minus rear is the one combination that vanishes for all three motions. Its variance is
# four times that of a wheel.

# %% [markdown] tags=["solution"]
# Right against left looks like a difference that should not be, and every turn would ring the
# alarm:

# %% active="ipynb" tags=["solution"]
# def right_against_left(wheels, sigma):
#     return (wheels @ np.array([-1, 1, -1, 1])) / (2 * sigma)
#
# check_slip(right_against_left)

# %% [markdown] tags=["statement"]
# ## Exercise 5: your odometry
#
# Assemble it. From four wheel speeds comes a body velocity, $\mathbf u = B\,\mathbf w$ with
#
# $$
# B = \frac r4\begin{bmatrix} 1 & 1 & 1 & 1\\ -1 & 1 & 1 & -1\\ -1/l & 1/l & -1/l & 1/l
# \end{bmatrix},
# $$
#
# where $l$ is half the length plus half the width. Every wheel's speed has an error of `sigma`,
# independent of the others. Move the pose with your `exact_step`; move its covariance with
# Euler's derivative by the pose and your `process_noise`, both at the heading before the step.


# %% tags=["exercise"]
def odometry(
    pose: Array, P: Array, wheels: Array, dt: float, r: float, lever: float, sigma: float
) -> tuple[Array, Array]:
    """Poses and covariances of a drive.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        Before the first step (m, m, rad).
    P : ndarray, shape (3, 3)
    wheels : ndarray, shape (T, 4)
        Wheel speeds (rad/s): front left, front right, rear left, rear right.
    dt : float
        Duration of a step (s).
    r, lever : float
        Radius of a wheel, and l of the formula (m).
    sigma : float
        Standard deviation of a wheel's speed (rad/s).

    Returns
    -------
    poses : ndarray, shape (T, 3)
    covs : ndarray, shape (T, 3, 3)
    """
    turning = np.array([-1, 1, -1, 1]) / lever
    B = r / 4 * np.array([[1, 1, 1, 1], [-1, 1, 1, -1], turning])
    V = sigma**2 * B @ B.T
    poses, covs = [], []
    for speeds in wheels:
        u, c, s = B @ speeds, np.cos(pose[2]), np.sin(pose[2])
        F = np.eye(3)
        F[:2, 2] = dt * np.array([-s * u[0] - c * u[1], c * u[0] - s * u[1]])
        P = F @ P @ F.T + process_noise(pose[2], dt, V)
        pose = exact_step(pose, u, dt)
        poses.append(pose)
        covs.append(P)
    return np.array(poses), np.array(covs)


# %% active="ipynb" tags=["try"]
# odometry(np.zeros(3), np.zeros((3, 3)), np.full((2, 4), 8.0), 0.2, 0.05, 0.38, 0.3)

# %% [markdown] tags=["hint"]
# The covariance of $\mathbf u$ comes from that of the wheels: $V = B\,\sigma^2 I\,B^\top$.

# %% [markdown] tags=["hint"]
# How do $x$ and $y$ change after a step if the heading before it was a little larger? That is the
# third column of $F$; the rest is the identity.

# %% [markdown] tags=["hint"]
# Order matters: the derivative at the old heading, then the step. The noise of four equal wheels
# is the same at every heading.


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
    return a_pose(rng), scale * root @ root.T, wheels, *robot, sigma


def _odometry_drawn(ax: Any, function: Any) -> None:
    """Draw 300 drives by wheels with errors, and the path and ellipses of the odometry."""
    from slamlab import plots

    rng, r, lever, sigma = np.random.default_rng(3), 0.05, 0.38, 1.5
    wheels = np.array([[9.0, 11, 9, 11]] * 12 + [[8.0, 12, 12, 8]] * 6 + [[11.0, 9, 11, 9]] * 12)
    turning = np.array([-1, 1, -1, 1]) / lever
    B = r / 4 * np.array([[1, 1, 1, 1], [-1, 1, 1, -1], turning])
    robots = np.zeros((300, 3))
    for speeds in wheels:
        v = (speeds + rng.normal(0, sigma, (300, 4))) @ B.T
        c, s = np.cos(robots[:, 2]), np.sin(robots[:, 2])
        steps = [c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]]
        robots = robots + 0.4 * np.column_stack(steps)
    plots.lidar_points(ax, robots[:, :2], s=1.6)
    poses, covs = function(np.zeros(3), np.zeros((3, 3)), wheels, 0.4, r, lever, sigma)
    plots.path(ax, np.asarray(poses, float))
    for k in (9, 19, 29):
        plots.ellipse(ax, np.asarray(poses[k], float)[:2], np.asarray(covs[k], float)[:2, :2])
    plots.floor(ax)


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
            0.0,
        ),
        "a turn to the right, through half a turn": (
            [1, 0, -3.1],
            np.diag([0.01, 0.02, 0.01]),
            np.tile([6.0, 2.0, 6.0, 2.0], (4, 1)),
            0.2,
            0.05,
            0.38,
            0.2,
        ),
    },
    tolerance=1e-8,
    picture=_odometry_drawn,
)

# %% tags=["mistakes"]
check_odometry.mistakes = {
    "this is F^T P F: expected F P F^T": "F @ P @ F.T => F.T @ P @ F",
    "an error of the heading becomes one of the position: expected F P F^T": "F @ P @ F.T => P",
    "the noise of the wheels is missing": " + process_noise(pose[2], dt, V) => ",
    "sigma is a standard deviation: V holds its square": "sigma**2 * B => sigma * B",
    "the noise of the wheels was taken for that of the body: V = sigma^2 B B^T": (
        "sigma**2 * B @ B.T => sigma**2 * np.eye(3)"
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
    "F lacks the sideways speed": (
        "[-s * u[0] - c * u[1], c * u[0] - s * u[1]] => [-s * u[0], c * u[0]]"
    ),
    "dt is missing in F": "dt * np.array([-s => np.array([-s",
    "only the last belief was returned: expected the one after each step": (
        lambda *given: (odometry(*given)[0][-1], odometry(*given)[1][-1])
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: odometry
#
# What to notice: the covariance of a robot that drives straight on grows fastest sideways. An
# uncertain heading makes the position uncertain, in proportion to the distance driven.

# %% [markdown] tags=["solution"]
# Adding the noise and never moving the covariance looks harmless. It forgets what the
# uncertain heading does to the position, the largest part:

# %% active="ipynb" tags=["solution"]
# def covariance_that_stays(pose, P, wheels, dt, r, lever, sigma):
#     turning = np.array([-1, 1, -1, 1]) / lever
#     B = r / 4 * np.array([[1, 1, 1, 1], [-1, 1, 1, -1], turning])
#     V = sigma**2 * B @ B.T
#     poses, _ = odometry(pose, P, wheels, dt, r, lever, sigma)
#     headings = [pose[2], *poses[:-1, 2]]
#     covs = P + np.cumsum([process_noise(theta, dt, V) for theta in headings], axis=0)
#     return poses, covs
#
# check_odometry(covariance_that_stays)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 05](../solutions/05_mecanum_kinematics.ipynb).
