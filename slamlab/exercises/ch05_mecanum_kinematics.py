"""Exercises, chapter 05: omni wheels, exact step, process noise, a worn wheel, odometry.

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
# wheel, and an odometry whose ellipse you put to the test. The chapter is [Mecanum kinematics and
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
#
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: a robot on omni wheels, with a pencil
#
# Your next robot is round and stands on three **omni wheels**. Their rollers do not stand at 45
# degrees: they lie along the rim, so a wheel slides freely along its own axle and grips across it.
# Every axle points to the centre of the robot. A wheel sits at the distance $d$ from the centre,
# in the direction $\beta$ (0 ahead, $\pi/2$ to the left).
#
# The lesson's derivation works here as well: take one wheel, write down the velocity of its hub
# and of its lowest point, and say in which direction nothing may move. A wheel that spins with
# positive speed drives its hub *counterclockwise* round the centre: the wheel at $\beta = 0$
# drives to the left. Robots with any number of wheels shall use your function.


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
# Where is the hub of the wheel, and how fast does it move if the body moves with $(V_1, V_2)$ and
# turns with $\omega$? A hub at $(x, y)$ moves with $(V_1 - \omega y,\ V_2 + \omega x)$.

# %% [markdown] tags=["hint"]
# Only the part across the axle makes the wheel spin. The axle points along $(\cos\beta,
# \sin\beta)$; which unit vector stands across it, counterclockwise?

# %% [markdown] tags=["hint"]
# Multiply the hub's velocity by $(-\sin\beta, \cos\beta)$. The turn contributes $d\,\omega$
# whatever $\beta$ is.


# %% tags=["cases"]
def _platform(rng: np.random.Generator) -> Any:
    beta = np.round(rng.uniform(-3.1, 3.1, int(rng.integers(3, 6))), 2)
    r, distance = np.round(rng.uniform([0.03, 0.1], [0.1, 0.5]), 3)
    return np.round(rng.uniform(-1, 1, 3), 2), r, distance, beta


_KIWI = (0.05, 0.2, np.deg2rad([60.0, 180.0, 300.0]))


def _wheels_drawn(ax: Any, function: Any) -> None:
    """Draw the path that a robot is to drive (black), and the one that its wheels make (blue)."""
    from slamlab import plots

    r, d, beta = _KIWI
    t = np.linspace(0, 8, 161)
    wished = np.column_stack([0.5 + 0 * t, 0.3 * np.sin(0.8 * t), 0.7 * np.cos(0.5 * t)])
    wheels = np.array([np.asarray(function(u, r, d, beta), float) for u in wished])
    J = np.column_stack([-np.sin(beta), np.cos(beta), np.full(3, d)]) / r
    for velocities, kind in ((wished, "truth"), (wheels @ np.linalg.inv(J).T, "estimate")):
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
# Three wheels, three speeds: the map can be inverted, and there is no fourth equation. Such a
# robot cannot see slip in its encoders; one with four wheels can. The number of equations that
# are left over, for three and for four wheels:

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
# A robot that drives in a circle and reads its encoders twice per second finds itself outside the
# circle: the lesson's step, P1 (10), moves along the heading at the *start* of the interval, along
# a tangent. In truth the heading turns from $\theta$ to $\theta + \omega\,dt$ while the robot
# moves, and the velocity turns with it. Where does the robot end?
#
# Give the exact answer. It must hold for a turn rate of 0, too, and for one of $10^{-12}$ rad/s,
# where a difference of two sines has no digits left.


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
        "a turn that is almost none": ([1.0, 2.0, 0.9], [0.5, -0.3, 1e-12], 0.4),
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
# ## Exercise 3: an ellipse that lies the wrong way, two bugs to find
#
# A robot's velocity is measured with the covariance $V$, three times better sideways than forward.
# How uncertain does one step of length $dt$ make its pose? The program below answered that for
# years, on a robot that read its encoders once per second and drove along $x$. Now it reads them
# ten times per second, and its ellipse is three times too long; and when it drives north-east, the
# ellipse points north-west.
#
# Run the check, find the two bugs, repair them.


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


# %% active="ipynb" tags=["stub"]
#     c, s = np.cos(theta), np.sin(theta)
#     F_u = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
#     return dt * F_u @ V @ F_u.T

# %% active="ipynb" tags=["try"]
# process_noise(0.0, 0.1, np.diag([0.09, 0.01, 0.04]))

# %% [markdown] tags=["hint"]
# Check the units: $V$ is a covariance of speeds, $Q$ one of places. With a pencil: a speed that is
# off by 0.3 m/s for 0.1 s makes an error of how many metres? And what is its square?

# %% [markdown] tags=["hint"]
# Write down where a robot with heading $\theta$ goes if it drives 1 m forward. Which column of
# `F_u` must that be?

# %% tags=["cases"]
_V = np.diag([0.09, 0.01, 0.04])


def _noise_drawn(ax: Any, function: Any) -> None:
    """Draw where 1000 robots with noisy velocities stand after half a second, and Q's ellipse."""
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
        "looking along x, a step of a second": (0.0, 1.0, _V),
        "looking along x": (0.0, 0.1, _V),
        "at an angle, a step of a second": (0.7, 1.0, _V),
        "heading along y, the variances change places": (np.pi / 2, 0.1, _V),
        "at an angle": (0.7, 0.1, _V),
        "another step": (0.7, 0.2, _V),
        "correlated speeds of a robot with one bad wheel": lambda rng: (
            an_angle(rng),
            float(np.round(rng.uniform(0.1, 2), 2)),
            a_covariance(rng, 3, 0.1),
        ),
    },
    picture=_noise_drawn,
    hunt=True,
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
#
# An error of a speed acts for the time $dt$, so $dt$ stands in $F_u$, and $F_u$ stands on both
# sides of $V$: the variance grows with $dt^2$. At $dt$ = 1 s that is no difference. And `F_u`
# turned the wrong way round: the first column must be where *forward* points, $(\cos\theta,
# \sin\theta)$. Along an axis of the world this does not show either, as long as $V$ is diagonal:
# the variances are multiplied by $(\pm 1)^2$.

# %% [markdown] tags=["solution"]
# With the paper's (17), without any dt, Q keeps the units of V, those of speeds. At dt = 0.1 s it
# is a hundred times too large:

# %% active="ipynb" tags=["solution"]
# def printed_17(theta, dt, V):
#     c, s = np.cos(theta), np.sin(theta)
#     F_u = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
#     return F_u @ V @ F_u.T
#
# check_noise(printed_17)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a worn wheel
#
# The lesson's robot has a wheel that is worn by 1 %, and its residual of *one* reading shows a
# tenth of a standard deviation: no alarm will ever ring. But noise cancels in a sum of many
# readings, and wear does not.
#
# Build an alarm that listens for a while. From the wheel speeds of a drive (four mecanum wheels)
# make, for every window of `n` readings in a row, one number: it is 0 without slip and noise,
# whatever the robot drives, and it has standard deviation 1 if each wheel speed in each reading
# has an independent error of standard deviation `sigma`.


# %% tags=["exercise"]
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
        too fast.
    """
    slip = wheels @ np.array([1, 1, -1, -1])
    sums = np.convolve(slip, np.ones(n), "valid")
    return sums / (2 * sigma * np.sqrt(n))


# %% active="ipynb" tags=["try"]
# slip_alarm(np.array([[8.0, 5, 5, 5], [6, 5, 5, 5], [5, 5, 5, 5]]), 0.5, 2)

# %% [markdown] tags=["hint"]
# Which combination of the four speeds is 0 for forward, for left and for turning? (The lesson's
# $n$ has it.)

# %% [markdown] tags=["hint"]
# Variances of independent errors add: what is the standard deviation of a + b - c - d, and of the
# sum of n such numbers?

# %% [markdown] tags=["hint"]
# Sums over windows: `np.convolve(x, np.ones(n), "valid")`, or differences of `np.cumsum`.


# %% tags=["cases"]
def _slip_drawn(ax: Any, function: Any) -> None:
    """Draw the alarm of single readings (thin) and of 400 in a row; 1 % of wear begins at 30 s."""
    from slamlab import plots

    rng, t, half = np.random.default_rng(2), 0.1 * np.arange(1200), 0.385
    u = np.column_stack([10 + 0 * t, 2 * np.sin(t), 3 * np.cos(0.5 * t)])
    map_of_wheels = np.array([[1, -1, -half], [1, 1, half], [1, 1, -half], [1, -1, half]])
    wheels = u @ map_of_wheels.T
    wheels[300:, 0] *= 1.01
    wheels += rng.normal(0, 0.2, wheels.shape)
    for n, style in ((1, {"lw": 0.4, "alpha": 0.5}), (400, {"lw": 2.0})):
        alarm = np.asarray(function(wheels, 0.2, n), float)
        ax.plot(t[n - 1 :], alarm, color=plots.COLOURS["estimate"], **style)
    for level in (-3, 3):
        ax.axhline(level, **plots.line_style("truth"))
    ax.set(xlabel="time (s)", ylabel="alarm (standard deviations)", ylim=(-6, 9))


@drawn
def _drive(rng: np.random.Generator, length: int, n: int) -> Any:
    return np.round(rng.uniform(-9, 9, (length, 4)), 1), 0.43, n


check_slip = Check(
    slip_alarm,
    "alarm",
    {
        "one reading, a spinning front-left wheel": ([[8.0, 5.0, 5.0, 5.0]], 0.5, 1),
        "a locked rear axle, two readings": ([[5.0, 5.0, 1.0, 1.0]] * 2, 0.5, 2),
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
    "the sum of four independent errors has 2 sigma, not 4: variances add": (
        "(2 * sigma => (4 * sigma"
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
# four times that of a wheel, and that of a sum of $n$ such numbers $4 n \sigma^2$. What is always
# of the same sign grows with $n$, the noise with $\sqrt n$.

# %% [markdown] tags=["solution"]
# Who divides by $n$ instead reports a worn wheel *less* surely the longer he listens:

# %% active="ipynb" tags=["solution"]
# def by_the_mean(wheels, sigma, n):
#     slip = wheels @ np.array([1, 1, -1, -1])
#     return np.convolve(slip, np.ones(n), "valid") / (2 * sigma * n)
#
# check_slip(by_the_mean)

# %% [markdown] tags=["statement"]
# ## Exercise 5: your odometry, and 300 robots that test it
#
# One encoder of the lesson's mecanum robot was replaced by a cheap one, so the wheels are no
# longer equally good. Assemble an odometry that knows it. From four wheel speeds comes a body
# velocity, $u = A\,\omega_w$ with (9a) of the lesson,
#
# $$
# A = \frac r4\begin{bmatrix} 1 & 1 & 1 & 1\\ -1 & 1 & 1 & -1\\ -1/l & 1/l & -1/l & 1/l
# \end{bmatrix}.
# $$
#
# The errors of the four speeds are independent, each with its own standard deviation. Move the
# pose with your `exact_step`; move its covariance with $P \leftarrow F P F^\top + Q$, where $F$ is
# the derivative of *that* step by the pose before it (the lesson's is Euler's), and $Q$ is your
# `process_noise` at the heading before the step.
#
# Then draw. 300 robots drive two metres ahead, and their wheels do not do quite what the encoders
# say, the cheap one, front left, least of all. Predict: along which line will the robots lie at
# the end? Your 95 % ellipse knows nothing of them. Does it hold about 95 % of the robots, and is
# the mean NEES of their poses near 3?


# %% tags=["exercise"]
def odometry(
    pose: Array, P: Array, wheels: Array, dt: float, r: float, lever: float, sigma: Array
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
    sigma : ndarray, shape (4,)
        Standard deviations of the speeds of the four wheels (rad/s).

    Returns
    -------
    poses : ndarray, shape (T, 3)
        After each step.
    covs : ndarray, shape (T, 3, 3)
    """
    turning = np.array([-1, 1, -1, 1]) / lever
    A = r / 4 * np.array([[1, 1, 1, 1], [-1, 1, 1, -1], turning])
    V = A @ np.diag(sigma**2) @ A.T
    poses, covs = [], []
    for speeds in wheels:
        new, F = exact_step(pose, A @ speeds, dt), np.eye(3)
        F[:2, 2] = pose[1] - new[1], new[0] - pose[0]
        P = F @ P @ F.T + process_noise(pose[2], dt, V)
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
# How do $x$ and $y$ after a step change if the heading before it was a little larger? The way that
# was driven swings to the left. That is the third column of $F$; the rest is the identity.

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


def _odometry_drawn(ax: Any, function: Any) -> None:
    """Draw where 300 robots end that drove ahead from the left, and the ellipse as computed."""
    from slamlab import plots

    rng, dt, r, lever = np.random.default_rng(5), 0.2, 0.05, 0.38
    sigma = np.array([2.0, 0.4, 0.4, 0.4])
    wheels = np.full((20, 4), 10.0)
    start = np.array([-2.0, 0.0, 0.0])
    poses, covs = (
        np.asarray(part, float)
        for part in function(start, np.zeros((3, 3)), wheels, dt, r, lever, sigma)
    )
    A = r / 4 * np.array([[1, 1, 1, 1], [-1, 1, 1, -1], np.array([-1, 1, -1, 1]) / lever])
    robots = np.tile(start, (300, 1))
    for speeds in wheels:
        u = (speeds + sigma * rng.normal(size=(300, 4))) @ A.T
        h = u[:, 2] * dt / 2
        c, s = np.cos(robots[:, 2] + h), np.sin(robots[:, 2] + h)
        chord = dt * np.sinc(h / np.pi)
        moved = [chord * (c * u[:, 0] - s * u[:, 1]), chord * (s * u[:, 0] + c * u[:, 1])]
        robots = robots + np.column_stack([*moved, 2 * h])
    e = robots - poses[-1]
    e[:, 2] = wrap_angle(e[:, 2])
    nees = np.sum(e * np.linalg.solve(covs[-1], e.T).T, axis=1).mean()
    inside = np.sum(e[:, :2] * np.linalg.solve(covs[-1, :2, :2], e[:, :2].T).T, axis=1) < 5.991
    plots.lidar_points(ax, robots[:, :2], s=1.6)
    plots.path(ax, poses)
    plots.ellipse(ax, poses[-1, :2], covs[-1, :2, :2])
    plots.floor(ax)
    ax.set(xlim=(-0.45, 0.45), ylim=(-0.6, 0.6))
    ax.set_title(f"holds {inside.mean():.0%}, mean NEES {nees:.1f}")


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
    "the noise of the wheels is missing": " + process_noise(pose[2], dt, V) => ",
    "sigma is a standard deviation: V holds its square": "sigma**2 => sigma",
    "the noise of the wheels was taken for that of the body: it goes through A": (
        "A @ np.diag(sigma**2) @ A.T => np.diag(sigma[:3] ** 2)"
    ),
    "all wheels were taken for equally good: each has its own sigma": (
        "np.diag(sigma**2) => (np.mean(sigma**2) * np.eye(4))"
    ),
    "the noise was taken at the heading after the step": (
        "        P = F @ P @ F.T + process_noise(pose[2], dt, V)\n        pose = new\n"
        " =>         pose = new\n        P = F @ P @ F.T + process_noise(pose[2], dt, V)\n"
    ),
    "F is that of Euler's step: this step is exact, and its way swings as a whole": (
        "F[:2, 2] = pose[1] - new[1], new[0] - pose[0]"
        " => F[:2, 2] = np.diff([pose, euler(pose, A @ speeds, dt)], axis=0)[0, [1, 0]] * [-1, 1]"
    ),
    "the pose moved by Euler's step: use your `exact_step`": (
        "exact_step(pose, A @ speeds, dt) => euler(pose, A @ speeds, dt)"
    ),
    "the way swings the wrong way round: a heading that is larger moves the end to the left": (
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

# %% [markdown] tags=["solution"]
# ## Solution 5: odometry
#
# What to notice: the covariance of a robot that drives straight on grows fastest sideways. An
# uncertain heading makes the position uncertain, in proportion to the distance driven. And a wheel
# that is worse than the others makes errors of forward, left and turn *together*: $V$ has entries
# beside its diagonal, and the robots lie along one line.

# %% [markdown] tags=["solution"]
# Take all four wheels for equally good, with the mean of the variances, and the ellipse is too
# wide across that line and too short along it. The mean NEES does not find it: each wheel has the
# same share in the least squares, so the mean stays what it was. The share of robots inside does,
# and the eye (draw it):

# %% active="ipynb" tags=["solution"]
# def equally_good(pose, P, wheels, dt, r, lever, sigma):
#     mean = np.full(4, np.sqrt(np.mean(sigma**2)))
#     return odometry(pose, P, wheels, dt, r, lever, mean)
#
# check_odometry(equally_good)

# %% [markdown] tags=["solution"]
# Adding the noise and never moving the covariance looks harmless. It forgets what the
# uncertain heading does to the position:

# %% active="ipynb" tags=["solution"]
# def covariance_that_stays(pose, P, wheels, dt, r, lever, sigma):
#     turning = np.array([-1, 1, -1, 1]) / lever
#     A = r / 4 * np.array([[1, 1, 1, 1], [-1, 1, 1, -1], turning])
#     V = A @ np.diag(sigma**2) @ A.T
#     poses, _ = odometry(pose, P, wheels, dt, r, lever, sigma)
#     headings = [pose[2], *poses[:-1, 2]]
#     covs = P + np.cumsum([process_noise(theta, dt, V) for theta in headings], axis=0)
#     return poses, covs
#
# check_odometry(covariance_that_stays)

# %% [markdown] tags=["solution"]
# You have now an odometry that says how far it may be off, for any robot whose wheel map you can
# derive, and a test that tells whether it is right.

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 05](../solutions/05_mecanum_kinematics.ipynb).
