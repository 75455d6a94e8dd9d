"""Exercises, chapter 03: a range-bearing prediction, its innovation, its Jacobian, and a filter.

The measurement is that of P1 (18) for a sensor in the centre of the robot (L = 0), with the
bearing repaired; P5 (11) and (13) are the innovation and the Jacobian of the extended filter.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, an_angle, drawn
from slamlab.exercises._report import Array, Check
from slamlab.geometry import wrap_angle

__all__ = ["check_follow", "check_innovation", "check_jacobian", "check_range_bearing"]


# %% [markdown] tags=["chapter"]
# # Exercises 03: the extended Kalman filter
#
# Three functions of a filter that sees landmarks, and the filter; the chapter is [The extended
# Kalman filter](../03_extended_kalman_filter.ipynb). Replace each `...` and run the check below
# it as often as you like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 03: the extended Kalman filter
#
# The exercises are in [Exercises 03](../exercises/03_extended_kalman_filter.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: the predicted measurement
#
# A sensor in the centre of the robot sees a landmark. At which range, and at which bearing from
# where the robot faces?


# %% tags=["exercise"]
def range_bearing(pose: Array, landmark: Array) -> Array:
    """Predict what the sensor sees.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x (m), y (m), theta (rad) in the world.
    landmark : ndarray, shape (2,)
        Position in the world (m).

    Returns
    -------
    ndarray, shape (2,)
        Range (m) and bearing (rad) in (-pi, pi].
    """
    dx, dy = landmark - pose[:2]
    return np.array([np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - pose[2])])


# %% active="ipynb" tags=["try"]
# range_bearing(np.zeros(3), np.array([3.0, 4.0]))

# %% [markdown] tags=["hint"]
# Two numbers decide everything: how far the landmark lies ahead in x and in y, in the world.

# %% [markdown] tags=["hint"]
# `np.arctan2(dy, dx)` is the direction of the landmark in the world, with its quadrant. The robot
# measures from its own heading.

# %% [markdown] tags=["hint"]
# Wrap last: `wrap_angle(np.arctan2(dy, dx) - pose[2])`.


# %% tags=["cases"]
def _scene(rng: np.random.Generator) -> Any:
    return a_pose(rng), np.round(rng.uniform(-6, 6, 2), 2)


def _range_bearing_drawn(ax: Any, function: Any) -> None:
    """Draw a robot, landmarks round it, and where range and bearing put each of them."""
    from slamlab import plots

    pose, angles = np.array([1.0, 0.5, 2.4]), 2.4 + np.linspace(-3, 3, 11)
    polar = np.column_stack([np.cos(angles), np.sin(angles)])
    landmarks = pose[:2] + np.linspace(1.5, 4, 11)[:, None] * polar
    plots.landmarks(ax, landmarks)
    ax.plot(*pose[:2], "o", color=plots.COLOURS["truth"])
    plots.path(ax, pose[:2] + [[0, 0], [np.cos(pose[2]), np.sin(pose[2])]], "truth")
    found = np.array([np.asarray(function(pose, of), float) for of in landmarks])
    r, direction = found[:, 0], found[:, 1] + pose[2]
    seen = pose[:2] + np.column_stack([r * np.cos(direction), r * np.sin(direction)])
    plots.landmarks(ax, seen, estimated=True)
    plots.floor(ax)


check_range_bearing = Check(
    range_bearing,
    "measurement",
    {
        "three ahead, four to the left": ([0, 0, 0], [3, 4]),
        "the robot has turned": ([1.0, 2.0, 0.6], [4.0, 3.0]),
        "the landmark is behind": ([1.0, 2.0, 0.4], [-2.0, 1.0]),
        "straight behind: pi, not -pi": ([0.0, 0.0, -np.pi / 2], [0.0, 3.0]),
        "ahead, across half a turn: the bearing stays wrapped": ([0.0, 0.0, 3.0], [-4.0, -1.0]),
        "ahead, across half a turn from the other side": ([0.0, 0.0, -3.0], [-4.0, 1.0]),
        "anywhere": _scene,
    },
    picture=_range_bearing_drawn,
)

# %% tags=["mistakes"]
check_range_bearing.mistakes = {
    "the bearing is not wrapped: it must lie in (-pi, pi]": (
        "wrap_angle(np.arctan2(dy, dx) - pose[2]) => np.arctan2(dy, dx) - pose[2]"
    ),
    "the bearing was wrapped to [0, 2 pi): it must lie in (-pi, pi]": (
        "wrap_angle(np.arctan2(dy, dx) - pose[2]) => (np.arctan2(dy, dx) - pose[2]) % (2 * np.pi)"
    ),
    "arctan(dy/dx) loses the quadrant: a landmark behind appears in front; use arctan2": (
        "arctan2(dy, dx) => arctan(dy / dx)"
    ),
    "the fraction is upside down, as P1 prints (18): arctan2 takes dy first": (
        "arctan2(dy, dx) => arctan2(dx, dy)"
    ),
    "the heading is missing: a bearing is measured from where the robot faces": (" - pose[2] => "),
    "the heading is added: it must be subtracted": " - pose[2] =>  + pose[2]",
    "the direction is reversed: from the robot to the landmark, not back": (
        "landmark - pose[:2] => pose[:2] - landmark"
    ),
    "the range is squared: take the square root": "np.hypot(dx, dy) => dx**2 + dy**2",
    "the range is the sum of the sides: take the root of the sum of their squares": (
        "np.hypot(dx, dy) => abs(dx) + abs(dy)"
    ),
    "the bearing is in degrees: expected radians": (
        "wrap_angle(np.arctan2(dy, dx) - pose[2])"
        " => np.rad2deg(wrap_angle(np.arctan2(dy, dx) - pose[2]))"
    ),
    "the robot's own place was forgotten: measure from where it stands": (
        "landmark - pose[:2] => landmark"
    ),
    "bearing and range are exchanged: the range comes first": (
        lambda pose, landmark: range_bearing(pose, landmark)[::-1]
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: the predicted measurement
#
# The landmark's direction in the world, less the heading of the robot, wrapped. `arctan2` keeps
# the quadrant, which a quotient forgets.

# %% [markdown] tags=["solution"]
# P1 prints the fraction upside down in its formula (18). For a robot that faces along x, this
# mirrors the world at the diagonal:

# %% active="ipynb" tags=["solution"]
# def as_printed_in_p1(pose, landmark):
#     dx, dy = landmark - pose[:2]
#     return np.array([np.hypot(dx, dy), wrap_angle(np.arctan2(dx, dy) - pose[2])])
#
# check_range_bearing(as_printed_in_p1)

# %% [markdown] tags=["statement"]
# ## Exercise 2: the innovation
#
# Formula (11) of P5 subtracts the prediction from the measurement. One of the two entries is an
# angle.


# %% tags=["exercise"]
def innovation(z: Array, predicted: Array) -> Array:
    """Compare a measurement with its prediction.

    Parameters
    ----------
    z, predicted : ndarray, shape (2,)
        Range (m) and bearing (rad).

    Returns
    -------
    ndarray, shape (2,)
        Measured minus predicted; the bearing in (-pi, pi].
    """
    difference = z - predicted
    difference[1] = wrap_angle(difference[1])
    return difference


# %% active="ipynb" tags=["try"]
# innovation(np.array([5.0, -3.1]), np.array([5.0, 3.1]))

# %% [markdown] tags=["hint"]
# Which way is shorter from 3.1 to -3.1 radians: through zero, or across the back?

# %% [markdown] tags=["hint"]
# Subtract first, wrap the difference then, and leave the range alone.


# %% tags=["cases"]
def _bearings(rng: np.random.Generator) -> Any:
    return [rng.integers(1, 9), an_angle(rng)], [rng.integers(1, 9), an_angle(rng)]


def _innovation_drawn(ax: Any, function: Any) -> None:
    """Draw the innovation of a landmark that goes round the robot, ahead of its prediction."""
    from slamlab import plots

    bearings = (np.linspace(0, 2 * np.pi, 61) + np.pi) % (2 * np.pi) - np.pi
    early = (bearings + 0.8 + np.pi) % (2 * np.pi) - np.pi
    pairs = zip(early, bearings, strict=True)
    found = [function(np.array([4.0, z]), np.array([2.0, b])) for z, b in pairs]
    d_range, d_bearing = np.array([np.asarray(one, float) for one in found]).T
    turned = np.linspace(0, 360, 61)
    ax.plot(turned, d_range, **plots.line_style("lidar"))
    ax.plot(turned, d_bearing, **plots.line_style("estimate"))
    ax.set(xlabel="direction of the landmark (°)", ylim=(-6, 6))
    ax.set(ylabel="innovation (rad; dotted: m)")


check_innovation = Check(
    innovation,
    "innovation",
    {
        "a plain difference": ([5.0, 0.3], [4.8, 0.2]),
        "negative differences stay negative": ([4.0, 0.1], [4.8, 0.25]),
        "across the back, to the left": ([5.0, -3.1], [5.0, 3.1]),
        "across the back, to the right": ([9.0, 3.1], [5.0, -3.0]),
        "half a turn is pi, not -pi": ([2.0, np.pi / 2], [1.0, -np.pi / 2]),
        "a full turn changes nothing": ([5.0, 0.3 + 2 * np.pi], [4.8, 0.2]),
        "any two measurements": _bearings,
    },
    picture=_innovation_drawn,
)

# %% tags=["mistakes"]
check_innovation.mistakes = {
    "the bearing is off by 2 pi: wrap the difference": "wrap_angle( => (",
    "the sign is reversed: expected measured minus predicted": (
        lambda z, p: np.array([p[0] - z[0], wrap_angle(p[1] - z[1])])
    ),
    "the range was wrapped too: only the bearing is an angle": (lambda z, p: wrap_angle(z - p)),
    "the bearings were wrapped before the subtraction: wrap the difference itself": (
        "wrap_angle(difference[1]) => wrap_angle(z[1]) - wrap_angle(predicted[1])"
    ),
    "the absolute difference loses its sign: the filter must know which way to turn": (
        lambda z, p: np.abs(innovation(z, p))
    ),
    "wrapped to [0, 2 pi): a small turn to the right must be a small negative number": (
        "wrap_angle(difference[1]) => difference[1] % (2 * np.pi)"
    ),
    "wrapped to [-pi, pi): half a turn is pi": (
        "wrap_angle(difference[1]) => (difference[1] + np.pi) % (2 * np.pi) - np.pi"
    ),
    "wrapped by pi: a full turn is 2 pi": (
        "wrap_angle(difference[1]) => (difference[1] + np.pi / 2) % np.pi - np.pi / 2"
    ),
    "the bearing was not subtracted": ("wrap_angle(difference[1]) => wrap_angle(z[1])"),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: the innovation

# %% [markdown] tags=["solution"]
# Wrapping both bearings beforehand looks careful and is not enough: two wrapped angles can still
# lie almost a full turn apart.

# %% active="ipynb" tags=["solution"]
# def wrapped_too_early(z, predicted):
#     return np.array([z[0] - predicted[0], wrap_angle(z[1]) - wrap_angle(predicted[1])])
#
# check_innovation(wrapped_too_early)

# %% [markdown] tags=["statement"]
# ## Exercise 3: the Jacobian
#
# Formula (13) of P5 for your function of exercise 1: how do range and bearing change when the
# robot moves a little?


# %% tags=["exercise"]
def jacobian(pose: Array, landmark: Array) -> Array:
    """Derivative of `range_bearing` with respect to the pose.

    Parameters
    ----------
    pose : ndarray, shape (3,)
    landmark : ndarray, shape (2,)

    Returns
    -------
    ndarray, shape (2, 3)
        Rows: range, bearing. Columns: x, y, theta.
    """
    dx, dy = landmark - pose[:2]
    q = dx**2 + dy**2
    r = np.sqrt(q)
    return np.array([[-dx / r, -dy / r, 0.0], [dy / q, -dx / q, -1.0]])


# %% active="ipynb" tags=["try"]
# jacobian(np.zeros(3), np.array([2.0, 0.0]))

# %% [markdown] tags=["hint"]
# Begin with the column of theta: what happens to the range when the robot turns on the spot, and
# what to the bearing?

# %% [markdown] tags=["hint"]
# With $d_x, d_y$ from robot to landmark and $r$ the range: $\partial r/\partial x = -d_x/r$.

# %% [markdown] tags=["hint"]
# For the bearing, $\partial\,\mathrm{atan2}(d_y, d_x)/\partial d_x = -d_y/r^2$ and $d_x$ falls
# when $x$ grows.


# %% tags=["cases"]
def _jacobian_drawn(ax: Any, function: Any) -> None:
    """Draw what 1000 uncertain robots measure, and the ellipse of J P J^T."""
    from slamlab import plots

    rng, degrees = np.random.default_rng(1), np.diag([1.0, np.degrees(1)])
    pose, landmark = np.array([0.5, -0.4, 0.3]), np.array([2.0, 1.1])
    P = np.array([[0.0144, 0.006, 0.0], [0.006, 0.0049, 0.001], [0.0, 0.001, 0.0009]])
    robots = rng.multivariate_normal(pose, P, 1000)
    cloud = np.array([range_bearing(robot, landmark) for robot in robots])
    plots.lidar_points(ax, (cloud - range_bearing(pose, landmark)) @ degrees, s=1.6)
    J = degrees @ np.asarray(function(pose, landmark), float)
    plots.ellipse(ax, [0, 0], J @ P @ J.T)
    ax.set(xlabel="error of the range (m)", ylabel="error of the bearing (°)")


check_jacobian = Check(
    jacobian,
    "J",
    {
        "straight ahead": ([0, 0, 0], [2, 0]),
        "ahead and to the left": ([1.0, 2.0, 0.6], [4.0, 6.0]),
        "behind, far away": ([1.0, 2.0, -2.0], [-20.0, -13.0]),
        "close by, where the bearing is quick": ([0.0, 0.0, 1.0], [0.2, -0.1]),
        "anywhere": _scene,
    },
    tolerance=1e-4,
    picture=_jacobian_drawn,
)

# %% tags=["mistakes"]
check_jacobian.mistakes = {
    "this is the transpose: rows are range and bearing, columns are x, y, theta": (
        lambda p, m: jacobian(p, m).T
    ),
    "this is the Jacobian by the landmark's position: the pose moves the other way": (
        lambda p, m: jacobian(p, m) * [-1, -1, 1]
    ),
    "this is the Jacobian by the landmark, (2, 2): the pose has three numbers": (
        lambda p, m: -jacobian(p, m)[:, :2]
    ),
    "the last column is zero: turning the robot changes the bearing one to one": ("-1.0] => 0.0]"),
    "the sign of the heading column is wrong: turn left and the landmark moves right": (
        "-1.0] => 1.0]"
    ),
    "the bearing row must be divided by the range squared, not by the range": (
        "dy / q, -dx / q => dy / r, -dx / r"
    ),
    "the range row must be divided by the range, not by its square": (
        "-dx / r, -dy / r => -dx / q, -dy / q"
    ),
    "the signs of the bearing row are exchanged, as in P1 (26), (27)": (
        "dy / q, -dx / q => -dy / q, dx / q"
    ),
    "dx and dy are exchanged in the bearing row": "dy / q, -dx / q => -dx / q, dy / q",
    "the signs of the range row are reversed: nearer means a shorter range": (
        "-dx / r, -dy / r => dx / r, dy / r"
    ),
    "the rows are exchanged: range first, then bearing": (lambda p, m: jacobian(p, m)[::-1]),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: the Jacobian
#
# The range grows when the robot backs away: the first row is minus the unit vector towards the
# landmark, and turning on the spot does not change it. The bearing changes with the sideways
# motion divided by
# the distance, which is why the second row holds $r^2$: one $r$ makes the offset a unit vector,
# the other turns metres into radians. And turning left by one degree moves every landmark one
# degree to the right.

# %% [markdown] tags=["solution"]
# Dividing the bearing row by $r$ instead of $r^2$ gives metres where radians are expected. The
# finite difference of chapter 03 finds it at once:

# %% active="ipynb" tags=["solution"]
# def by_range_only(pose, landmark):
#     r = range_bearing(pose, landmark)[0]
#     return jacobian(pose, landmark) * [[1, 1, 1], [r, r, 1]]
#
# check_jacobian(by_range_only)

# %% [markdown] tags=["statement"]
# ## Exercise 4: your filter on the unicycle
#
# Assemble it. A unicycle drives with a speed $v$ and a turn rate $\omega$ that it knows up to a
# covariance $V$, and sees one landmark, sometimes. In a step of `dt` seconds it moves by $v\,dt$
# along the heading it had before the step, then turns by $\omega\,dt$. Write the extended filter:
# the motion with its two Jacobians, then the update with your functions of exercises 1 to 3.


# %% tags=["exercise"]
def follow(
    mean: Array, cov: Array, u: Array, dt: float, V: Array, z: Array, landmark: Array, R: Array
) -> tuple[Array, Array]:
    """Follow a unicycle by one landmark.

    Parameters
    ----------
    mean : ndarray, shape (3,)
        Pose before the first step.
    cov : ndarray, shape (3, 3)
    u : ndarray, shape (T, 2)
        Speed (m/s) and turn rate (rad/s) of every step.
    dt : float
        Duration of a step (s).
    V : ndarray, shape (2, 2)
        Covariance of speed and turn rate.
    z : ndarray, shape (T, 2)
        Range (m) and bearing (rad) after every step; NaN where the landmark was
        not seen.
    landmark : ndarray, shape (2,)
    R : ndarray, shape (2, 2)
        Covariance of range and bearing.

    Returns
    -------
    means : ndarray, shape (T, 3)
        Poses after every step, headings in (-pi, pi].
    covs : ndarray, shape (T, 3, 3)
    """
    means, covs = [], []
    for (v, omega), seen in zip(u, z):
        c, s = np.cos(mean[2]), np.sin(mean[2])
        F_x = np.array([[1, 0, -v * dt * s], [0, 1, v * dt * c], [0, 0, 1]])
        F_u = dt * np.array([[c, 0], [s, 0], [0, 1]])
        mean = mean + dt * np.array([v * c, v * s, omega])
        cov = F_x @ cov @ F_x.T + F_u @ V @ F_u.T
        if np.isfinite(seen).all():
            H = jacobian(mean, landmark)
            K = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R)
            mean = mean + K @ innovation(seen, range_bearing(mean, landmark))
            cov = (np.eye(3) - K @ H) @ cov
        mean = np.append(mean[:2], wrap_angle(mean[2]))
        means.append(mean)
        covs.append(cov)
    return np.array(means), np.array(covs)


# %% active="ipynb" tags=["try"]
# follow(np.zeros(3), 0.1 * np.eye(3), np.array([[1.0, 0.2]]), 0.5, 0.01 * np.eye(2),
#        np.array([[3.1, 0.4]]), np.array([3.0, 2.0]), 0.01 * np.eye(2))

# %% [markdown] tags=["hint"]
# How does the new pose change with each number of the old one, and with $v$ and $\omega$? Two
# matrices, 3 x 3 and 3 x 2.

# %% [markdown] tags=["hint"]
# Where does the Jacobian of the measurement belong: at the pose before the motion, or at the
# predicted one?


# %% tags=["cases"]
@drawn
def _unicycle(rng: np.random.Generator, n: int, unseen: float, dt: float = 0.4) -> Any:
    mean, landmark = a_pose(rng), np.round(rng.uniform(4, 8, 2), 2)
    u = np.round(rng.uniform([0.2, -1.5], [1.5, 1.5], (n, 2)), 2)
    pose, read = mean, []
    for v, omega in u:
        pose = pose + dt * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), omega])
        read.append(range_bearing(pose, landmark) + rng.normal(0, [0.1, 0.05]))
    z = np.where(rng.random((n, 1)) < unseen, np.nan, np.round(read, 3))
    V, R = a_covariance(rng, 2, 0.02), a_covariance(rng, 2, 0.01)
    return mean, a_covariance(rng, 3, 0.02), u, dt, V, z, landmark, R


def _follow_drawn(ax: Any, function: Any) -> None:
    """Draw a drive round a landmark: true path, odometry, the filter's path and its ellipses."""
    from slamlab import plots

    rng, landmark, n = np.random.default_rng(5), np.array([2.0, 2.5]), 40
    V, R = np.diag([0.15, 0.12]) ** 2, np.diag([0.1, 0.03]) ** 2
    start, u = np.array([2.0, 0.0, 0.0]), np.tile([0.8, 0.36], (n, 1))
    drives = []
    for controls in (u + rng.multivariate_normal([0, 0], V, n), u):
        poses = [start]
        for v, omega in controls:
            x, y, heading = poses[-1]
            step = 0.4 * v * np.array([np.cos(heading), np.sin(heading)])
            poses.append(np.array([x + step[0], y + step[1], heading + 0.4 * omega]))
        drives.append(np.array(poses[1:]))
    read = [range_bearing(pose, landmark) + rng.normal(0, [0.1, 0.03]) for pose in drives[0]]
    z = np.where(np.arange(n)[:, None] % 5 < 3, np.nan, read)
    plots.path(ax, drives[0], "truth")
    plots.path(ax, drives[1], "dead_reckoning")
    plots.landmarks(ax, landmark[None])
    means, covs = function(start, np.diag([0.01, 0.01, 0.01]), u, 0.4, V, z, landmark, R)
    plots.path(ax, np.asarray(means, float))
    for k in range(0, n, 4):
        plots.ellipse(ax, np.asarray(means[k], float)[:2], np.asarray(covs[k], float)[:2, :2])
    plots.floor(ax)


check_follow = Check(
    follow,
    "means, covs",
    {
        "one step without a measurement": _unicycle(1, 1.0),
        "one step and one measurement": _unicycle(1, 0.0, 0.7),
        "the heading passes half a turn, and the measurement is far off": (
            [0, 0, 3.0],
            0.05 * np.eye(3),
            [[0.5, 0.6]],
            0.4,
            0.01 * np.eye(2),
            [[4.05, 3.1]],
            [-4.0, -0.7],
            0.01 * np.eye(2),
        ),
        "the landmark behind: expected to the right of the back, measured to its left": (
            [0, 0, -0.1],
            0.05 * np.eye(3),
            [[0.5, -0.1]],
            0.4,
            0.01 * np.eye(2),
            [[4.25, 3.1]],
            [-4.0, -0.6],
            0.01 * np.eye(2),
        ),
        "a drive": _unicycle(12, 0.0),
        "a drive on which the landmark is seen now and then": _unicycle(12, 0.5, 0.25),
    },
    tolerance=1e-5,
    picture=_follow_drawn,
)

# %% tags=["mistakes"]
check_follow.mistakes = {
    "H was taken at the pose before the motion: expected the predicted one": (
        "mean = mean + dt => old, mean = mean, mean + dt",
        "jacobian(mean, landmark) => jacobian(old, landmark)",
    ),
    "F_x and F_u were taken at the heading after the motion: expected the one before it": (
        "F_x = np => ahead = np.array([v * c, v * s, omega])\n        "
        "turned = mean[2] + dt * omega\n        c, s = np.cos(turned), np.sin(turned)\n        "
        "F_x = np",
        "np.array([v * c, v * s, omega])\n        cov => ahead\n        cov",
    ),
    "F was taken at the heading after the motion: expected the one before it": (
        "-v * dt * s], [0, 1, v * dt * c] => -v * dt * np.sin(mean[2] + dt * omega)],"
        " [0, 1, v * dt * np.cos(mean[2] + dt * omega)]"
    ),
    "motion and derivatives were taken at the heading half-way: expected the one before": (
        "np.cos(mean[2]), np.sin(mean[2])"
        " => np.cos(mean[2] + omega * dt / 2), np.sin(mean[2] + omega * dt / 2)"
    ),
    "the innovation is not wrapped: a landmark across the back throws the filter off": (
        "innovation(seen, range_bearing(mean, landmark)) => (seen - range_bearing(mean, landmark))"
    ),
    "the heading is not wrapped: it must lie in (-pi, pi]": "wrap_angle(mean[2]) => mean[2]",
    "this is F^T P F: expected F P F^T": "F_x @ cov @ F_x.T => F_x.T @ cov @ F_x",
    "the noise of the motion is missing": " + F_u @ V @ F_u.T => ",
    "R is missing in S: the sensor is not perfect": "H @ cov @ H.T + R => H @ cov @ H.T",
    "R must not be added to the gain": (
        "K = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R)"
        " => K = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R) + np.pad(R, ((0, 1), (0, 0)))"
    ),
    "F has the wrong sign in its last column: differentiate cos and sin": (
        "-v * dt * s], [0, 1, v * dt * c] => v * dt * s], [0, 1, -v * dt * c]"
    ),
    "F is the identity here: uncertainty of the heading becomes one of the position": (
        "F_x @ cov @ F_x.T => cov"
    ),
    "the sign of the innovation is reversed: measured minus predicted": (
        "mean + K @ innovation => mean - K @ innovation"
    ),
    "the covariance did not shrink: expected (I - K H) P": "(np.eye(3) - K @ H) @ cov => cov",
    "the measurements were not used": "np.isfinite(seen).all() => False",
    "dt is missing in F_u: a velocity acts for dt": ("F_u = dt * np => F_u = np"),
    "only the last belief was returned: expected one after each step": (
        lambda *given: (follow(*given)[0][-1], follow(*given)[1][-1])
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: your filter on the unicycle
#
# Five lines of motion, four of measurement. Both Jacobians of the motion are taken at the pose
# before it, that of the measurement at the predicted pose.

# %% [markdown] tags=["solution"]
# With the Jacobian of the motion on the wrong side, $F^\top P F$, the step without a measurement
# already goes wrong in its covariance, while its pose stays right:

# %% active="ipynb" tags=["solution"]
# def other_side(mean, cov, u, dt, V, z, landmark, R):
#     means, covs = [], []
#     for step, seen in zip(u, z):
#         c, s = np.cos(mean[2]), np.sin(mean[2])
#         F = np.array([[1, 0, -step[0] * dt * s], [0, 1, step[0] * dt * c], [0, 0, 1]])
#         turned = np.linalg.inv(F) @ F.T @ cov @ F @ np.linalg.inv(F).T
#         ms, cs = follow(mean, turned, step[None], dt, V, seen[None], landmark, R)
#         mean, cov = ms[0], cs[0]
#         means.append(mean)
#         covs.append(cov)
#     return np.array(means), np.array(covs)
#
# check_follow(other_side)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 03](../solutions/03_extended_kalman_filter.ipynb).
