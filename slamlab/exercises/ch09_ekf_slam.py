"""Exercises, chapter 09: the Jacobian with the lever arm, a new landmark's covariance, a wall.

P1 (26)-(29), (43) and the line model that P1's experiment needs.
"""

# mypy: disable-error-code="var-annotated"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, an_angle, drawn, in_the_room
from slamlab.exercises._report import Array, Check, Ints
from slamlab.geometry import wrap_angle

__all__ = ["check_add_landmark", "check_jacobian", "check_slam", "check_update", "check_wall"]


# %% [markdown] tags=["chapter"]
# # Exercises 09: EKF-SLAM
#
# Five exercises: a Jacobian that P1 gets wrong, a new landmark, a wall, an update with two bugs,
# and the whole filter; the chapter is [EKF-SLAM](../09_ekf_slam.ipynb). Replace each `...` and run
# the check below it as often as you like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 09: EKF-SLAM
#
# The exercises are in [Exercises 09](../exercises/09_ekf_slam.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle
# from slamlab.evaluation import chi2_band

# %% [markdown] tags=["statement"]
# ## Exercise 1: the Jacobian with the lever arm
#
# A sensor stands $L$ metres ahead of the robot's centre and measures range and bearing of a
# landmark. Differentiate both with respect to the pose $(x_p, y_p, \theta)$: the entries $A
# \ldots F$ of P1 (23)-(29). Do not trust the paper.


# %% tags=["exercise"]
def jacobian(pose: Array, landmark: Array, L: float) -> Array:
    """Derivative of range and bearing by the pose.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x (m), y (m) and heading (rad) of the robot's centre.
    landmark : ndarray, shape (2,)
        The landmark in the world (m).
    L : float
        Distance of the sensor ahead of the centre (m).

    Returns
    -------
    ndarray, shape (2, 3)
        Rows range and bearing; columns x, y, heading.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    px, py = pose[:2] - landmark
    dx, dy = px + L * c, py + L * s
    squared = dx**2 + dy**2
    rho = np.sqrt(squared)
    A, B, C, D = dx / rho, dy / rho, -dy / squared, dx / squared
    E, F = L * (B * c - A * s), L * (D * c - C * s) - 1
    return np.array([[A, B, E], [C, D, F]])


# %% active="ipynb" tags=["try"]
# jacobian(np.array([0.2, -0.4, 0.3]), np.array([4.0, 1.0]), 0.3)

# %% [markdown] tags=["hint"]
# Write $d = S - X_o$ with the sensor $S = (x_p + L\cos\theta,\ y_p + L\sin\theta)$. How do $d_x$
# and $d_y$ change with each of the three numbers of the pose?

# %% [markdown] tags=["hint"]
# Chain rule: the derivative by the heading is that by $(d_x, d_y)$ times $(-L\sin\theta,\
# L\cos\theta)$, and the bearing loses another 1.

# %% [markdown] tags=["hint"]
# $A = d_x/\rho$ and $D = d_x/\rho^2$; $B$ and $C$ follow the same pattern. $E$ is $L$ times a
# combination of $A$ and $B$, and $F$ is the same combination of $C$ and $D$, less one.


# %% tags=["cases"]
def _scene(rng: np.random.Generator) -> Any:
    return a_pose(rng), np.round(rng.uniform(-6, 6, 2), 2), float(np.round(rng.uniform(0, 1), 2))


def _jacobian_drawn(ax: Any, function: Any) -> None:
    """Draw what 1000 uncertain robots observe, and the ellipse of H P H^T."""
    from slamlab import plots
    from slamlab.sensors import RangeBearing

    rng, degrees = np.random.default_rng(1), np.diag([1.0, np.degrees(1)])
    pose, landmark, L = np.array([0.5, -0.4, 0.3]), np.array([2.4, 1.0]), 0.8
    P = np.diag([0.05, 0.05, 0.08]) ** 2
    robots = pose + rng.standard_normal((1000, 3)) * np.sqrt(np.diag(P))
    sensor = RangeBearing(1, 1, offset=L)
    cloud = sensor.residual(sensor.observe(robots, landmark), sensor.observe(pose, landmark))
    plots.lidar_points(ax, cloud @ degrees, s=1.6)
    H = degrees @ np.asarray(function(pose, landmark, L), float)
    plots.ellipse(ax, [0, 0], H @ P @ H.T)
    ax.set(xlabel="error of the range (m)", ylabel="error of the bearing (°)")


check_jacobian = Check(
    jacobian,
    "H",
    {
        "no lever: the range does not care about the heading": ([0, 0, 0.5], [3, 1], 0.0),
        "a lever, a landmark ahead": ([0.2, -0.4, 0.3], [4, 1], 0.3),
        "a landmark to the left": ([1, 2, -0.7], [2, 5], 0.3),
        "a landmark behind": ([1, 2, 2.5], [4, -1], 0.5),
        "a long lever": ([-1, 0.5, 1.2], [1.5, 3], 1.5),
        "a sensor behind the centre": ([-1, 0.5, 1.2], [1.5, 3], -0.4),
        "anywhere": _scene,
    },
    tolerance=1e-4,
    picture=_jacobian_drawn,
)

# %% tags=["mistakes"]
check_jacobian.mistakes = {
    "the sensor was put at the centre: it stands L ahead": ("px + L * c, py + L * s => px, py"),
    "C and D use the centre: the bearing is measured from the sensor, (26) and (27)": (
        "-dy / squared, dx / squared => -py / squared, px / squared"
    ),
    "C and D use the centre, in the distance too: the bearing is measured from the sensor": (
        "-dy / squared, dx / squared => -py / (px**2 + py**2), px / (px**2 + py**2)"
    ),
    "E lacks its factor L, (28): without a lever, turning on the spot changes no range": (
        "L * (B * c - A * s) => B * c - A * s"
    ),
    "the range row lacks its third entry: the lever swings the sensor": (
        "L * (B * c - A * s) => 0.0"
    ),
    "E has the wrong sign: a turn to the left swings the sensor by (-L sin, L cos)": (
        "L * (B * c - A * s) => L * (A * s - B * c)"
    ),
    "F has the derivative of the cosine as plus the sine, as (29) is printed": (
        "L * (D * c - C * s) - 1 => L * (px * c - py * s + L * np.cos(2 * pose[2])) / squared - 1"
    ),
    "F lacks its -1: a turn of the robot is taken off every bearing": (
        "(D * c - C * s) - 1 => (D * c - C * s)"
    ),
    "F is -1 only without a lever: the lever swings the sensor": (
        "L * (D * c - C * s) - 1 => -1.0"
    ),
    "C and D are divided by the distance: expected its square": (
        "-dy / squared, dx / squared => -dy / rho, dx / rho"
    ),
    "A and B are divided by the squared distance: expected the distance": (
        "dx / rho, dy / rho => dx / squared, dy / squared"
    ),
    "the signs of C and D are exchanged": (
        "-dy / squared, dx / squared => dy / squared, -dx / squared"
    ),
    "all signs are reversed: this is the derivative by the landmark, or d is turned": (
        "[[A, B, E], [C, D, F]] => [[-A, -B, -E], [-C, -D, -F]]"
    ),
    "this is the transpose: rows are range and bearing, columns x, y and heading": (
        "[[A, B, E], [C, D, F]] => [[A, C], [B, D], [E, F]]"
    ),
    "the rows are exchanged: range first": ("[[A, B, E], [C, D, F]] => [[C, D, F], [A, B, E]]"),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: the Jacobian with the lever arm
#
# Everything goes through $d$, sensor minus landmark. Its derivative by $x_p$ is $(1, 0)$, by
# $y_p$ it is $(0, 1)$, by the heading $(-L\sin\theta, L\cos\theta)$: the heading swings the
# sensor sideways. So the third column is a combination of the first two, and the bearing loses
# the robot's own turn.

# %% [markdown] tags=["solution"]
# The printed (29) is what one gets if the derivative of the cosine is taken for plus the sine.
# With a lever of 0.3 m it differs from the right one by 0.02 and 0.11 below, with one of 1.5 m by
# 0.61:

# %% active="ipynb" tags=["solution"]
# def as_printed(pose, landmark, L):
#     H = jacobian(pose, landmark, L)
#     c, s = np.cos(pose[2]), np.sin(pose[2])
#     px, py = pose[0] - landmark[0], pose[1] - landmark[1]
#     squared = (px + L * c) ** 2 + (py + L * s) ** 2
#     H[1, 2] = (px * c - py * s + L * np.cos(2 * pose[2])) * L / squared - 1
#     return H
#
# check_jacobian(as_printed)

# %% [markdown] tags=["statement"]
# ## Exercise 2: a landmark comes in
#
# The covariance $P$ of the state is known; a landmark is placed from the pose (the first three
# entries of the state) and a measurement with covariance $R$. What is the covariance of the
# longer state, P1 (43)?


# %% tags=["exercise"]
def add_landmark(P: Array, G_pose: Array, G_z: Array, R: Array) -> Array:
    """Covariance of the state with one landmark more.

    Parameters
    ----------
    P : ndarray, shape (n, n)
        Covariance of pose (3) and old landmarks.
    G_pose : ndarray, shape (2, 3)
        Derivative of the new landmark by the pose.
    G_z : ndarray, shape (2, 2)
        Derivative of the new landmark by the measurement.
    R : ndarray, shape (2, 2)
        Covariance of the measurement.

    Returns
    -------
    ndarray, shape (n + 2, n + 2)
        The new landmark comes last.
    """
    cross = G_pose @ P[:3, :]
    own = G_pose @ P[:3, :3] @ G_pose.T + G_z @ R @ G_z.T
    return np.block([[P, cross.T], [cross, own]])


# %% active="ipynb" tags=["try"]
# add_landmark(np.eye(3), np.array([[1.0, 0, -2], [0, 1, 1]]), np.eye(2),
#              0.01 * np.eye(2))

# %% [markdown] tags=["hint"]
# The new landmark's error is $G_x$ times the pose's error plus $G_z$ times the measurement's.
# Multiply that by every other error and take the mean.

# %% [markdown] tags=["hint"]
# The two new rows are $G_x P_{[0:3,\,:]}$: the pose's cross-covariances with *everything*, passed
# on.

# %% [markdown] tags=["hint"]
# `np.block([[P, cross.T], [cross, own]])` puts it together.


# %% tags=["cases"]
@drawn
def _map(rng: np.random.Generator, landmarks: int, doubt: float = 1.0) -> Any:
    P = doubt * a_covariance(rng, 3 + 2 * landmarks)
    G_pose, G_z = np.round(rng.normal(size=(2, 3)), 2), np.round(rng.normal(size=(2, 2)), 2)
    return P, G_pose, G_z, a_covariance(rng, 2, 0.2)


def _add_landmark_drawn(ax: Any, function: Any) -> None:
    """Draw heading against landmark of 1000 uncertain robots, and the ellipse of the result."""
    from slamlab import plots
    from slamlab.sensors import RangeBearing

    rng, pose, z = np.random.default_rng(2), np.array([0.0, 0.0, 0.4]), np.array([3.0, 0.5])
    P, R = np.diag([0.05, 0.05, 0.06]) ** 2, np.diag([0.1, 0.02]) ** 2
    robots = pose + rng.standard_normal((1000, 3)) * np.sqrt(np.diag(P))
    sensor = RangeBearing(1, 1)
    cloud = sensor.locate(robots, z + rng.standard_normal((1000, 2)) * np.sqrt(np.diag(R)))
    degrees = np.diag([np.degrees(1), 1.0])
    errors = np.column_stack([robots[:, 2] - pose[2], cloud[:, 0] - sensor.locate(pose, z)[0]])
    plots.lidar_points(ax, errors @ degrees, s=1.6)
    longer = np.asarray(function(P, *sensor.locate_jacobians(pose, z), R), float)
    plots.ellipse(ax, [0, 0], degrees @ longer[2:4, 2:4] @ degrees)
    ax.set(xlabel="error of the heading (°)", ylabel="error of the landmark's x (m)")


check_add_landmark = Check(
    add_landmark,
    "P",
    {
        "the first landmark, from a pose in doubt": _map(0),
        "from a pose without doubt": _map(0, 0.0),
        "the second landmark": _map(1),
        "the fifth landmark": _map(4),
    },
    tolerance=1e-8,
    picture=_add_landmark_drawn,
)

# %% tags=["mistakes"]
check_add_landmark.mistakes = {
    "the new landmark is tied to nothing: the blocks beside it are G_pose P[:3, :]": (
        "cross = G_pose @ P[:3, :] => cross = np.zeros((2, len(P)))"
    ),
    "it is tied to the pose but not to the old landmarks: use all columns of P[:3, :]": (
        "G_pose @ P[:3, :]\n => G_pose @ P[:3, :] * (np.arange(len(P)) < 3)\n"
    ),
    "the sensor's noise is missing: add G_z R G_z^T": " + G_z @ R @ G_z.T => ",
    "the robot's uncertainty is missing: add G_pose P_p G_pose^T": (
        "G_pose @ P[:3, :3] @ G_pose.T +  => "
    ),
    "R is in metres and radians, the map in metres: it goes through G_z": ("G_z @ R @ G_z.T => R"),
    "the noise went through G_z from the wrong side: G_z R G_z^T": (
        "G_z @ R @ G_z.T => G_z.T @ R @ G_z"
    ),
    "the second G_z is not transposed: G_z R G_z^T": "R @ G_z.T => R @ G_z",
    "G_z stands on one side only: G_z R G_z^T": "R @ G_z.T => R",
    "the noise was subtracted: a new landmark is never more certain than its sensor": (
        "+ G_z @ R => - G_z @ R"
    ),
    "the blocks beside the new landmark have the wrong sign": (
        "[[P, cross.T], [cross, own]] => [[P, -cross.T], [-cross, own]]"
    ),
    "the covariance has not grown: two rows and two columns come in": (
        "np.block([[P, cross.T], [cross, own]]) => P.copy()"
    ),
    "the new landmark stands first: it comes last": (
        "[[P, cross.T], [cross, own]] => [[own, cross], [cross.T, P]]"
    ),
    "only the block of the new landmark was returned: expected the whole covariance": (
        "np.block([[P, cross.T], [cross, own]]) => own"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: a landmark comes in
#
# The error of the new landmark is $G_x \tilde x_p + G_z v$. Its product with any other error of
# the state is $G_x$ times the pose's covariance with that one, since the measurement's noise $v$
# is independent of everything. Its own square is the two contributions added.

# %% [markdown] tags=["solution"]
# Without the cross-covariances the new landmark counts as independent information about the pose.
# It is not: it was placed *from* the pose.

# %% active="ipynb" tags=["solution"]
# def without_ties(P, G_pose, G_z, R):
#     own = G_pose @ P[:3, :3] @ G_pose.T + G_z @ R @ G_z.T
#     return np.block([[P, np.zeros((len(P), 2))], [np.zeros((2, len(P))), own]])
#
# check_add_landmark(without_ties)

# %% [markdown] tags=["statement"]
# ## Exercise 3: a wall
#
# A wall is the line $x\cos\alpha + y\sin\alpha = r$. What does a scanner, $L$ ahead of the
# centre, measure of it: the distance, never negative, and the direction of the nearest point of
# the line, seen from the scanner's own heading?


# %% tags=["exercise"]
def observe_wall(pose: Array, wall: Array, L: float) -> Array:
    """Distance and direction of a wall from the scanner.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x (m), y (m) and heading (rad) of the robot's centre.
    wall : ndarray, shape (2,)
        r (m) and alpha (rad) in the world.
    L : float
        Distance of the scanner ahead of the centre (m).

    Returns
    -------
    ndarray, shape (2,)
        Distance (m), not negative, and direction (rad) in (-pi, pi].
    """
    xs, ys = pose[0] + L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2])
    r, alpha = wall
    distance = r - (xs * np.cos(alpha) + ys * np.sin(alpha))
    direction = alpha - pose[2] + (np.pi if distance < 0 else 0.0)
    return np.array([abs(distance), wrap_angle(direction)])


# %% active="ipynb" tags=["try"]
# observe_wall(np.array([0.5, 0.0, 0.0]), np.array([3.0, 0.0]), 0.3)

# %% [markdown] tags=["hint"]
# $x_s\cos\alpha + y_s\sin\alpha$ is how far the scanner stands along the wall's normal.

# %% [markdown] tags=["hint"]
# If the scanner has passed the line, the difference comes out negative. The same line then has
# another name, with the normal turned round.

# %% [markdown] tags=["hint"]
# If the distance is negative, return its opposite and add $\pi$ to the direction; wrap at the end.


# %% tags=["cases"]
def _walled(rng: np.random.Generator) -> Any:
    wall = [float(np.round(rng.uniform(0.5, 5), 2)), an_angle(rng)]
    return np.round(a_pose(rng), 2), wall, float(np.round(rng.uniform(0, 1), 2))


def _observe_wall_drawn(ax: Any, function: Any) -> None:
    """Draw four walls, a path, and the closest point of each wall where it is observed."""
    from slamlab import plots

    L, sides = 0.3, (0, np.pi / 2, np.pi, -np.pi / 2)
    outer = [[r, side] for r, side in zip((3, 2, 3, 2), sides, strict=True)]
    inner = [[r, side] for r, side in zip((0.7, 0.4, 0.7, 0.4), sides, strict=True)]
    for corner in ([3, 2], [0.7, 0.4]):
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * corner
        plots.walls(ax, np.stack([corners, np.roll(corners, -1, 0)], 1))
    turn = np.linspace(0, 2 * np.pi, 25)
    poses = np.column_stack([1.8 * np.cos(turn), np.sin(turn), wrap_angle(turn + np.pi / 2)])
    plots.path(ax, poses, "truth")
    points = []
    for pose in poses:
        scanner = pose[:2] + L * np.array([np.cos(pose[2]), np.sin(pose[2])])
        side, along = np.abs(scanner) / [0.7, 0.4] > 1  # beside which walls of the box it is
        near = [w for w in inner if (side != along) and scanner @ _normal(w) > w[0]]
        for wall in outer + near:
            distance, direction = function(pose, np.array(wall, float), L)
            angle = direction + pose[2]
            points.append(scanner + distance * np.array([np.cos(angle), np.sin(angle)]))
    plots.lidar_points(ax, np.array(points, float), s=4)
    ax.set_aspect("equal")
    ax.set(xlabel="x (m)", ylabel="y (m)")


def _normal(wall: Any) -> Array:
    return np.array([np.cos(wall[1]), np.sin(wall[1])])


check_wall = Check(
    observe_wall,
    "distance and direction",
    {
        "a wall ahead": ([0.5, 0, 0], [3, 0], 0.3),
        "a wall at an angle, the robot turned": ([1, 2, 0.4], [4, 1.1], 0.3),
        "the robot beyond the wall's line: another name": ([4, 1, 0.5], [2, 0.2], 0.3),
        "the centre before the line, the sensor beyond it": ([1.9, 0, 0.1], [2, 0.0], 0.3),
        "a direction that crosses half a turn": ([1, -1, -2.5], [3, 2.5], 0.4),
        "a sensor behind the centre": ([1, 2, 0.4], [4, 1.1], -0.3),
        "any wall": _walled,
    },
    picture=_observe_wall_drawn,
)

# %% tags=["mistakes"]
check_wall.mistakes = {
    "measured from the centre: the sensor stands L ahead": (
        "pose[0] + L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2]) => pose[0], pose[1]"
    ),
    "the direction is that in the world: take the heading off": (
        "alpha - pose[2] + ( => alpha + ("
    ),
    "the heading is added: it must be taken off": ("alpha - pose[2] + ( => alpha + pose[2] + ("),
    "the sensor's place was added: r - (x_s cos(alpha) + y_s sin(alpha))": ("r - (xs => r + (xs"),
    "a distance is negative: the same line is (-r, alpha + pi)": (
        "np.pi if distance < 0 else 0.0 => 0.0",
        "abs(distance) => distance",
    ),
    "the distance was made positive, its direction was not turned by pi": (
        "np.pi if distance < 0 else 0.0 => 0.0"
    ),
    "the direction is not wrapped to (-pi, pi]": ("wrap_angle(direction) => direction"),
    "the lever was turned by the wall's direction: the heading turns it": (
        "L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2])"
        " => L * np.cos(wall[1]), pose[1] + L * np.sin(wall[1])"
    ),
    "the lever points along x always: the heading turns it": (
        "pose[0] + L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2]) => pose[0] + L, pose[1]"
    ),
    "sine and cosine of alpha are exchanged": (
        "xs * np.cos(alpha) + ys * np.sin(alpha) => xs * np.sin(alpha) + ys * np.cos(alpha)"
    ),
    "this is the wall as the map names it, seen from the centre: no heading, no lever": (
        lambda p, wall, L: [wall[0] - p[:2] @ [np.cos(wall[1]), np.sin(wall[1])], wall[1]]
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a wall
#
# $r$ is how far the line lies from the origin along its normal, $x_s\cos\alpha + y_s\sin\alpha$
# how far the scanner does. Their difference has a sign: beyond the line it is negative, and the
# nearest point lies in the opposite direction.

# %% [markdown] tags=["solution"]
# Making the distance positive and leaving the direction as it was puts the wall on the wrong side
# of the robot:

# %% active="ipynb" tags=["solution"]
# def half_renamed(pose, wall, L):
#     xs, ys = pose[0] + L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2])
#     r, alpha = wall
#     distance = r - (xs * np.cos(alpha) + ys * np.sin(alpha))
#     return np.array([abs(distance), wrap_angle(alpha - pose[2])])
#
# check_wall(half_renamed)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a bug to find
#
# In this update the state holds the pose and then the landmarks, two numbers each. With one
# landmark ahead it works. With three the map falls apart. Run the check, find the two bugs,
# repair them.


# %% tags=["exercise"]
def update(mean: Array, P: Array, z: Array, i: int, R: Array) -> tuple[Array, Array]:
    """State and covariance after landmark number i was seen.

    Parameters
    ----------
    mean : ndarray, shape (3 + 2 n,)
        Pose (m, m, rad), then n landmarks (m).
    P : ndarray, shape (3 + 2 n, 3 + 2 n)
    z : ndarray, shape (2,)
        Range (m) and bearing (rad), the sensor at the centre of the robot.
    i : int
        Which landmark, from 0.
    R : ndarray, shape (2, 2)

    Returns
    -------
    mean, P : ndarray
        The heading in (-pi, pi].
    """
    k = 3 + 2 * i
    dx, dy = mean[k : k + 2] - mean[:2]
    squared = dx**2 + dy**2
    rho = np.sqrt(squared)
    H = np.zeros((2, len(mean)))
    H[:, :3] = [[-dx / rho, -dy / rho, 0.0], [dy / squared, -dx / squared, -1.0]]
    H[:, k : k + 2] = [[dx / rho, dy / rho], [-dy / squared, dx / squared]]
    v = z - np.array([rho, np.arctan2(dy, dx) - mean[2]])
    v[1] = wrap_angle(v[1])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    new = mean + K @ v
    new[2] = wrap_angle(new[2])
    return new, (np.eye(len(mean)) - K @ H) @ P


# %% active="ipynb" tags=["stub"]
#     k = 3 + i
#     dx, dy = mean[k : k + 2] - mean[:2]
#     squared = dx**2 + dy**2
#     rho = np.sqrt(squared)
#     H = np.zeros((2, len(mean)))
#     H[:, :3] = [[-dx / rho, -dy / rho, 0], [dy / squared, -dx / squared, -1]]
#     H[:, k : k + 2] = [[dx / rho, dy / rho], [-dy / squared, dx / squared]]
#     v = z - np.array([rho, np.arctan2(dy, dx) - mean[2]])
#     K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
#     new = mean + K @ v
#     new[2] = wrap_angle(new[2])
#     return new, (np.eye(len(mean)) - K @ H) @ P

# %% active="ipynb" tags=["try"]
# update(np.array([0, 0, 0, 3.0, 1.0]), 0.1 * np.eye(5), np.array([3.2, 0.4]), 0,
#        0.01 * np.eye(2))[0].round(3)

# %% [markdown] tags=["hint"]
# Which properties hold? What do they have in common, and what the others?

# %% [markdown] tags=["hint"]
# Write down for a map of three landmarks which rows of the state belong to the landmark with $i =
# 1$.

# %% [markdown] tags=["hint"]
# The second bug shows only where the measured and the expected bearing differ by about a full
# turn: in what interval must a difference of two angles lie?


# %% tags=["cases"]
@drawn
def _in_a_map(rng: np.random.Generator, landmarks: int, i: int, across: bool = False) -> Any:
    mean = np.append(a_pose(rng), np.round(rng.uniform(5, 9, 2 * landmarks), 2))
    if across:
        mean[:3], mean[3 + 2 * i : 5 + 2 * i] = [0, 0, 3.0], [-5.0, -0.4]
    d = mean[3 + 2 * i : 5 + 2 * i] - mean[:2]
    z = [np.hypot(*d), wrap_angle(np.arctan2(d[1], d[0]) - mean[2])] + rng.normal(0, 0.1, 2)
    if across:
        z[1] = wrap_angle(np.arctan2(d[1], d[0]) - mean[2]) - 0.2
    return mean, a_covariance(rng, len(mean), 0.05), z, i, a_covariance(rng, 2, 0.02)


def _update_drawn(ax: Any, function: Any) -> None:
    """Draw a map of three landmarks, too far off at first, after thirty updates."""
    from slamlab import plots
    from slamlab.sensors import RangeBearing

    rng, sensor = np.random.default_rng(4), RangeBearing(0.05, 0.03)
    pose, stars = np.array([0.0, 0.0, 2.9]), np.array([[-3.0, 0.8], [1.0, 2.0], [-1.5, -1.6]])
    P = np.diag([0.01, 0.01, 0.01, *[0.3] * 6]) ** 2
    mean = np.concatenate([pose, (stars + rng.normal(0, 0.3, (3, 2))).ravel()])
    plots.landmarks(ax, stars)
    for k in range(30):
        z = sensor.observe(pose, stars[k % 3]) + rng.standard_normal(2) * [0.05, 0.03]
        z[1] = wrap_angle(z[1])
        mean, P = function(mean, P, z, k % 3, sensor.cov)
    _map_drawn(ax, np.asarray(mean, float), np.asarray(P, float))


def _map_drawn(ax: Any, mean: Array, P: Array) -> None:
    """Draw pose and landmarks with their 95 % ellipses."""
    from slamlab import plots

    ax.plot(*mean[:2], "o", color=plots.COLOURS["estimate"], markersize=5)
    for k in (0, *range(3, len(mean), 2)):
        plots.ellipse(ax, mean[k : k + 2], P[k : k + 2, k : k + 2])
    plots.landmarks(ax, mean[3:].reshape(-1, 2), estimated=True)
    ax.set_aspect("equal")
    ax.set(xlabel="x (m)", ylabel="y (m)")


check_update = Check(
    update,
    "mean, P",
    {
        "a map of one landmark": _in_a_map(1, 0),
        "the first of three landmarks": _in_a_map(3, 0),
        "the second of three": _in_a_map(3, 1),
        "the last of four": _in_a_map(4, 3),
        "a heading that is corrected past half a turn": (
            [0.0, 0.0, 3.1, -4.0, 0.3],
            np.diag([0.01, 0.01, 0.3, 0.01, 0.01]),
            [4.0, -0.4],
            0,
            0.01 * np.eye(2),
        ),
        "a heading that is corrected past half a turn to the right": (
            [0.0, 0.0, -3.1, -4.0, -0.3],
            np.diag([0.01, 0.01, 0.3, 0.01, 0.01]),
            [4.0, 0.4],
            0,
            0.01 * np.eye(2),
        ),
        "a landmark ahead, its direction across half a turn": _in_a_map(2, 1, across=True),
        "an innovation across half a turn, both bearings in (-pi, pi]": (
            [0.0, 0.0, 0.0, -5.0, 0.2],
            np.diag([0.01, 0.01, 0.01, 0.05, 0.05]),
            [5.1, -3.1],
            0,
            0.01 * np.eye(2),
        ),
        "a range that is off by more than pi": (
            [0.0, 0.0, 0.0, 9.0, 1.0],
            np.diag([1.0, 1.0, 0.01, 4.0, 4.0]),
            [5.2, 0.2],
            0,
            0.01 * np.eye(2),
        ),
    },
    tolerance=1e-6,
    picture=_update_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_update.mistakes = {
    "the expected bearing was wrapped, the innovation was not: wrap their difference": (
        "wrap_angle(v[1]) => z[1] - wrap_angle(z[1] - v[1])"
    ),
    "the range was wrapped too: it is no angle": "v[1] = wrap_angle(v[1]) => v = wrap_angle(v)",
    "landmark i begins at 3 + 2 i: each takes two rows": "3 + 2 * i => 3 + i",
    "the pose takes three rows: landmark i begins at 3 + 2 i": "3 + 2 * i => 2 + 2 * i",
    "always the first landmark: which one was seen is given by i": "3 + 2 * i => 3",
    "the landmark's columns of H are empty: it is uncertain as well": (
        "[[dx / rho, dy / rho], [-dy / squared, dx / squared]] => 0.0"
    ),
    "the pose's columns of H are empty: the robot is uncertain as well": (
        "[[-dx / rho, -dy / rho, 0.0], [dy / squared, -dx / squared, -1.0]] => 0.0"
    ),
    "the bearing does not know the heading: its entry is -1": (
        "-dx / squared, -1.0] => -dx / squared, 0.0]"
    ),
    "the heading is taken off a bearing, its derivative is -1": (
        "-dx / squared, -1.0] => -dx / squared, 1.0]"
    ),
    "the bearing lacks the heading: it is measured from the front of the robot": (
        "np.arctan2(dy, dx) - mean[2] => np.arctan2(dy, dx)"
    ),
    "the innovation is not wrapped": "wrap_angle(v[1]) => v[1]",
    "the heading is not wrapped after the correction": ("wrap_angle(new[2]) => new[2]"),
    "R is missing in S": "H @ P @ H.T + R => H @ P @ H.T",
    "only the pose was corrected: the map learns too": (
        "new = mean + K @ v => new = mean + np.append((K @ v)[:3], np.zeros(len(mean) - 3))"
    ),
    "the covariance did not shrink: expected (I - K H) P": (
        "(np.eye(len(mean)) - K @ H) @ P => P.copy()"
    ),
    "the innovation has the wrong sign: measured minus predicted": (
        "mean + K @ v => mean - K @ v"
    ),
    "the pose's columns have the signs of the landmark's": (
        "[[-dx / rho, -dy / rho, 0.0], [dy / squared, -dx / squared, -1.0]]"
        " => [[dx / rho, dy / rho, 0.0], [-dy / squared, dx / squared, -1.0]]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: two bugs
#
# Landmark $i$ begins at row $3 + 2i$: the pose takes three rows, every landmark before it two.
# With $i = 0$ the wrong formula is right, so a test with one landmark finds nothing. The second
# bug is a missing wrap: it shows where the measured and the expected bearing differ by about a
# full turn.

# %% [markdown] tags=["solution"]
# An update that takes the landmark as certain shares the innovation between robot and measurement,
# and the map is never corrected:

# %% active="ipynb" tags=["solution"]
# def landmark_is_sure(mean, P, z, i, R):
#     frozen = P.copy()
#     frozen[3:, :] = frozen[:, 3:] = 0.0
#     new, smaller = update(mean, frozen, z, i, R)
#     smaller[3:, 3:] = P[3:, 3:]
#     return new, smaller
#
# check_update(landmark_is_sure)

# %% [markdown] tags=["statement"]
# ## Exercise 5: your EKF-SLAM in the room
#
# Assemble it. A unicycle starts at the origin, which it knows, and drives by a speed $v$ and a
# turn rate $\omega$ with a covariance $V$: in a step it moves by $v\,dt$ along the heading it had
# before, then turns by $\omega\,dt$. After each step it may see one landmark, with a name. A name
# that is new makes the state longer, with your `add_landmark`; a name that is known is an
# `update`. Predict moves the pose, its block of the covariance, *and the blocks beside it*.


# %% tags=["exercise"]
def slam(u: Array, dt: float, V: Array, z: Array, ids: Ints, R: Array) -> tuple[Array, Array]:
    """EKF-SLAM over a drive.

    Parameters
    ----------
    u : ndarray, shape (T, 2)
        Speed (m/s) and turn rate (rad/s) of every step.
    dt : float
        Duration of a step (s).
    V : ndarray, shape (2, 2)
        Covariance of speed and turn rate.
    z : ndarray, shape (T, 2)
        Range (m) and bearing (rad) after every step; NaN where nothing was seen.
    ids : ndarray of int, shape (T,)
        Name of the landmark that was seen; -1 where nothing was.
    R : ndarray, shape (2, 2)

    Returns
    -------
    mean : ndarray, shape (3 + 2 n,)
        Pose, heading in (-pi, pi], and n landmarks in the order in which they
        were first seen.
    P : ndarray, shape (3 + 2 n, 3 + 2 n)
    """
    mean, P, known = np.zeros(3), np.zeros((3, 3)), []
    for (v, omega), seen, name in zip(u, z, ids, strict=True):
        c, s = np.cos(mean[2]), np.sin(mean[2])
        F = np.array([[1.0, 0.0, -v * dt * s], [0.0, 1.0, v * dt * c], [0.0, 0.0, 1.0]])
        G = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])
        mean[:2] += v * dt * np.array([c, s])
        mean[2] = wrap_angle(mean[2] + omega * dt)
        P[:3, :] = F @ P[:3, :]
        P[:, :3] = P[:, :3] @ F.T
        P[:3, :3] += G @ V @ G.T
        if name in known:
            mean, P = update(mean, P, seen, known.index(name), R)
        elif name >= 0:
            c, s = np.cos(mean[2] + seen[1]), np.sin(mean[2] + seen[1])
            G_pose = np.array([[1.0, 0.0, -seen[0] * s], [0.0, 1.0, seen[0] * c]])
            G_z = np.array([[c, -seen[0] * s], [s, seen[0] * c]])
            mean = np.append(mean, mean[:2] + seen[0] * np.array([c, s]))
            P = add_landmark(P, G_pose, G_z, R)
            known.append(name)
    return mean, P


# %% active="ipynb" tags=["try"]
# slam(np.array([[1.0, 0.2]]), 0.5, 0.01 * np.eye(2), np.array([[2.0, 0.3]]),
#      np.array([7]), 0.01 * np.eye(2))

# %% [markdown] tags=["hint"]
# Keep a list of names: its order is the order of the landmarks in the state.

# %% [markdown] tags=["hint"]
# The full derivative of the prediction is the identity but for its upper left block $F$. So the
# first three rows of $P$ are multiplied by $F$ from the left, and after that the first three
# columns by $F^\top$ from the right.

# %% [markdown] tags=["hint"]
# A new landmark stands at $(x, y) + r\,(\cos(\theta + \beta), \sin(\theta + \beta))$.
# Differentiate by the pose and by $(r, \beta)$. It is not used for an update in the step in which
# it comes in.


# %% tags=["cases"]
def _slam_drawn(ax: Any, function: Any) -> None:
    """Draw a drive round eight landmarks: truth, path and map with 95 % ellipses."""
    from slamlab import plots
    from slamlab.sensors import RangeBearing

    rng, sensor, dt, steps = np.random.default_rng(6), RangeBearing(0.05, 0.02), 0.5, 48
    turn = np.linspace(0, 2 * np.pi, 9)[:-1]
    stars = np.column_stack([4 * np.cos(turn), 3 + 4 * np.sin(turn)])
    u, V = np.tile([0.8, 0.8 / 3], (steps, 1)), np.diag([0.08, 0.05]) ** 2
    driven = u + rng.standard_normal((steps, 2)) * np.sqrt(np.diag(V))
    truth, z = [np.zeros(3)], []
    for k, (v, omega) in enumerate(driven):
        x, y, theta = truth[-1]
        move = dt * np.array([v * np.cos(theta), v * np.sin(theta), omega])
        truth.append(np.array([x, y, theta]) + move)
        noise = rng.standard_normal(2) * [0.05, 0.02]
        z.append(sensor.observe(truth[-1], stars[k % 8]) + noise)
    plots.path(ax, np.array(truth), "truth")
    plots.landmarks(ax, stars)
    seen, ids = (
        np.column_stack([np.array(z)[:, 0], wrap_angle(np.array(z)[:, 1])]),
        np.arange(48) % 8,
    )
    path = [np.zeros(2)]
    for k in range(1, steps + 1):
        mean, P = function(u[:k], dt, V, seen[:k], ids[:k], sensor.cov)
        path.append(np.asarray(mean, float)[:2])
    plots.path(ax, np.array(path))
    _map_drawn(ax, np.asarray(mean, float), np.asarray(P, float))


check_slam = Check(
    slam,
    "mean, P",
    {
        "a drive on which nothing is seen": in_the_room(4, 1, 1.0),
        "one landmark, first seen after a step": in_the_room(1, 1, dt=0.8),
        "one landmark, seen again and again": in_the_room(8, 1, dt=0.25),
        "five landmarks": in_the_room(20, 5),
        "a drive with steps that see nothing": in_the_room(20, 4, 0.4, dt=0.2),
        "a heading past half a turn to the right": (
            [[0.5, -2.5]] * 3,
            0.5,
            0.01 * np.eye(2),
            [[np.nan, np.nan]] * 3,
            [-1, -1, -1],
            0.01 * np.eye(2),
        ),
        "a heading past half a turn": (
            [[0.5, 2.5]] * 3,
            0.5,
            0.01 * np.eye(2),
            [[np.nan, np.nan]] * 3,
            [-1, -1, -1],
            0.01 * np.eye(2),
        ),
    },
    tolerance=1e-6,
    picture=_slam_drawn,
)

# %% tags=["mistakes"]
check_slam.mistakes = {
    "a new landmark's derivative by the heading lacks the beam: it swings by its length": (
        "[[1.0, 0.0, -seen[0] * s], [0.0, 1.0, seen[0] * c]] => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]"
    ),
    "F and G were taken at the heading after the motion: expected the one before it": (
        "F = np.array([[1.0, 0.0, -v * dt * s], [0.0, 1.0, v * dt * c]"
        " => ahead = np.array([c, s])\n        turned = mean[2] + omega * dt\n        "
        "c, s = np.cos(turned), np.sin(turned)\n        "
        "F = np.array([[1.0, 0.0, -v * dt * s], [0.0, 1.0, v * dt * c]",
        "mean[:2] += v * dt * np.array([c, s]) => mean[:2] += v * dt * ahead",
    ),
    "F was taken at the heading after the motion: expected the one before it": (
        "-v * dt * s], [0.0, 1.0, v * dt * c] => -v * dt * np.sin(mean[2] + omega * dt)],"
        " [0.0, 1.0, v * dt * np.cos(mean[2] + omega * dt)]"
    ),
    "V acts on a velocity for dt: G V G^T has dt squared in it, not dt": (
        "G @ V @ G.T => G @ V @ G.T / dt"
    ),
    "the cross-covariances did not move: P_xm becomes F P_xm": (
        "P[:3, :] = F @ P[:3, :] => P[:3, :3] = F @ P[:3, :3]",
        "P[:, :3] = P[:, :3] @ F.T => P[:3, :3] = P[:3, :3] @ F.T",
    ),
    "the noise of the motion is missing: add G V G^T to the block of the pose": (
        "P[:3, :3] += G @ V @ G.T => P[:3, :3] += 0.0"
    ),
    "nothing was predicted: the robot moves before it looks": (
        "mean[:2] += v * dt * np.array([c, s]) => mean[:2] += 0.0"
    ),
    "a new landmark has no cross-covariances: place it with your add_landmark": (
        "P = add_landmark(P, G_pose, G_z, R)"
        " => own = add_landmark(P, G_pose, G_z, R)[-2:, -2:]\n            "
        "P = np.block([[P, np.zeros((len(P), 2))], [np.zeros((2, len(P))), own]])"
    ),
    "a landmark that comes in was used for an update at once: it is counted twice": (
        "known.append(name)"
        " => known.append(name)\n            "
        "mean, P = update(mean, P, seen, known.index(name), R)"
    ),
    "landmarks known already are not used: update with them": (
        "mean, P = update(mean, P, seen, known.index(name), R) => pass"
    ),
    "dt is missing in G: a velocity acts for dt": (
        "G = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])"
        " => G = np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])"
    ),
    "F is the identity here: uncertainty of the heading becomes one of the position": (
        "[[1.0, 0.0, -v * dt * s], [0.0, 1.0, v * dt * c], [0.0, 0.0, 1.0]]"
        " => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]"
    ),
    "the sensor's noise is missing in a new landmark": ("G_pose, G_z, R) => G_pose, G_z, 0 * R)"),
    "a new landmark is placed as if the robot looked along x: add the heading": (
        "np.cos(mean[2] + seen[1]), np.sin(mean[2] + seen[1]) => np.cos(seen[1]), np.sin(seen[1])"
    ),
    "the heading is not wrapped after the motion": (
        "wrap_angle(mean[2] + omega * dt) => mean[2] + omega * dt"
    ),
    "only the pose was returned: expected state and covariance of all landmarks too": (
        "return mean, P => return mean[:3], P[:3, :3]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: EKF-SLAM in the room
#
# Three functions and a list of names. What to notice: the two lines that move the blocks beside
# the pose. Their absence does not show in the path of a single run; the covariance is wrong from
# the first step in which the robot drives on with a landmark in its map.

# %% [markdown] tags=["solution"]
# Is it consistent? Two hundred drives round the same room, the error of the last pose in units of
# its own covariance: 3 is expected, and the band says how far the mean of two hundred may be from
# it. Then the same filter with its cross-covariances left where they were:

# %% active="ipynb" tags=["solution"]
# def drive(rng, n_steps=30):
#     room = np.array([[4.0, 2.0], [5.0, -3.0], [-2.0, 4.0], [-3.0, -2.0], [2.0, 5.0]])
#     u = np.tile([0.5, 0.35], (n_steps, 1))
#     V, R = np.diag([0.03, 0.03]) ** 2, np.diag([0.05, 0.02]) ** 2
#     pose, z, ids = np.zeros(3), [], []
#     for v, omega in u + rng.normal(0, 0.03, (n_steps, 2)):
#         pose = pose + 0.5 * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), omega])
#         d = room[k := rng.integers(5)] - pose[:2]
#         bearing = wrap_angle(np.arctan2(d[1], d[0]) - pose[2])
#         z.append([np.hypot(*d), bearing] + rng.normal(0, [0.05, 0.02]))
#         ids.append(k)
#     return (u, 0.5, V, np.array(z), np.array(ids), R), pose

# %% active="ipynb" tags=["solution"]
# def mean_nees(filter_):
#     found = []
#     for seed in range(200):
#         given, pose = drive(np.random.default_rng(seed))
#         mean, P = filter_(*given)
#         error = mean[:3] - pose
#         error[2] = wrap_angle(error[2])
#         found.append(error @ np.linalg.solve(P[:3, :3], error))
#     return np.mean(found)
#
# low, high = chi2_band(3, 200)
# print(f"mean NEES {mean_nees(slam):.1f}, expected between {low:.1f} and {high:.1f}")

# %% active="ipynb" tags=["solution"]
# def ties_left_behind(u, dt, V, z, ids, R):
#     mean, P, known = np.zeros(3), np.zeros((3, 3)), []
#     for step in zip(u, z, ids, strict=True):
#         (v, omega), seen, name = step
#         c, s = np.cos(mean[2]), np.sin(mean[2])
#         F = np.array([[1.0, 0.0, -v * dt * s], [0.0, 1.0, v * dt * c], [0.0, 0.0, 1.0]])
#         G = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])
#         mean[:3] += dt * np.array([v * c, v * s, omega])
#         mean[2] = wrap_angle(mean[2])
#         P[:3, :3] = F @ P[:3, :3] @ F.T + G @ V @ G.T
#         if name in known:
#             mean, P = update(mean, P, seen, known.index(name), R)
#         elif name >= 0:
#             c, s = np.cos(mean[2] + seen[1]), np.sin(mean[2] + seen[1])
#             G_pose = np.array([[1.0, 0.0, -seen[0] * s], [0.0, 1.0, seen[0] * c]])
#             G_z = np.array([[c, -seen[0] * s], [s, seen[0] * c]])
#             mean = np.append(mean, mean[:2] + seen[0] * np.array([c, s]))
#             P = add_landmark(P, G_pose, G_z, R)
#             known.append(name)
#     return mean, P
#
# print(f"mean NEES {mean_nees(ties_left_behind):.1f}, "
#       f"expected between {low:.1f} and {high:.1f}")
# check_slam(ties_left_behind)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 09](../solutions/09_ekf_slam.ipynb).
