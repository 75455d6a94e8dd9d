"""Exercises, chapter 09: the scanner's mount, a landmark from two bearings, a wall, the filter.

P1 (24)-(32), (43) with a mount that is not known and for any sensor, and the line model that P1's
experiment needs.
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
# Five exercises: a scanner whose place on the robot is not known, a landmark from two bearings, a
# wall, an update with two bugs, and the whole filter, on 200 drives. The chapter is
# [EKF-SLAM](../09_ekf_slam.ipynb). Replace each `...` and run the check below it as often as you
# like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 09: EKF-SLAM
#
# The exercises are in [Exercises 09](../exercises/09_ekf_slam.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: where is the scanner?
#
# After a repair the scanner is back on the robot, but its place was not measured. If the filter
# takes it for the place of before, each landmark is off, in a direction that turns with the robot.
# So the filter is to estimate this place as well: the state gets the **mount** $(a, b)$, metres
# ahead of the robot's centre and to its left. The scanner still looks straight ahead. With the
# pose $(x, y, \theta)$ and the landmark $(x_j, y_j)$,
#
# $$
# d=\begin{bmatrix}x_j-x-a\cos\theta+b\sin\theta\\y_j-y-a\sin\theta-b\cos\theta\end{bmatrix},\qquad
# h=\begin{bmatrix}\rho\\\operatorname{atan2}(d_y,d_x)-\theta\end{bmatrix},\qquad\rho=\|d\|.
# $$
#
# The lesson has $a=L$, known and fixed, and $b=0$:
#
# $$
# H_j=\begin{bmatrix}d_x/\rho&d_y/\rho\\-d_y/\rho^2&d_x/\rho^2\end{bmatrix},\quad
# H_{xy}=-H_j,\quad
# H_\theta=H_{xy}\begin{bmatrix}-L\sin\theta\\L\cos\theta\end{bmatrix}
# -\begin{bmatrix}0\\1\end{bmatrix}.
# $$
#
# Write the derivative of $h$ with respect to all seven numbers, in the order $x, y, \theta, a, b,
# x_j, y_j$. Which of the lesson's columns stay as they are? And with a pencil: the robot drives
# straight on. Can the filter tell an error in $a$ from one in $x$?
#
# In the picture your derivative is in the filter of a robot that drives through a room whose
# landmarks are not known either. It shows the place of the scanner, in the robot's frame. Does the
# filter find it?


# %% tags=["exercise"]
def jacobian(pose: Array, mount: Array, landmark: Array) -> Array:
    """Derivative of range and bearing by pose, mount and landmark.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x (m), y (m) and heading (rad) of the robot's centre.
    mount : ndarray, shape (2,)
        The scanner in the robot's frame (m): a ahead of the centre, b to its left.
    landmark : ndarray, shape (2,)
        The landmark in the world (m), not at the scanner.

    Returns
    -------
    ndarray, shape (2, 7)
        Rows range and bearing; columns x, y, heading, a, b, landmark's x and y.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[c, -s], [s, c]])
    lever = turn @ mount
    dx, dy = landmark - pose[:2] - lever
    squared = dx**2 + dy**2
    rho = np.sqrt(squared)
    H_m = np.array([[dx / rho, dy / rho], [-dy / squared, dx / squared]])
    H_heading = -H_m @ [-lever[1], lever[0]] - [0.0, 1.0]
    return np.column_stack([-H_m, H_heading, -H_m @ turn, H_m])


# %% active="ipynb" tags=["try"]
# jacobian(np.zeros(3), np.array([0.3, 0.0]), np.array([3.3, 4.0]))

# %% [markdown] tags=["hint"]
# Range and bearing change because $d$ changes; the bearing also decreases by the turn of the
# robot. How does $d$ change per metre of $x_j$, of $x$, of $a$?

# %% [markdown] tags=["hint"]
# A metre of $a$ moves the scanner by $(\cos\theta, \sin\theta)$ in the world, a metre of $b$ by
# the same turned by 90°. A turn of the robot moves the scanner, too: at right angles to the
# arrow from the centre to the scanner.

# %% [markdown] tags=["hint"]
# Each column but the last two is $-H_j$ times a vector: how the scanner moves per unit of this
# number. Only the column of the heading has one more term.


# %% tags=["cases"]
def _scene(rng: np.random.Generator) -> Any:
    pose, mount = a_pose(rng), np.round(rng.uniform(-1, 1, 2), 2)
    away, angle = rng.uniform(1.6, 6), rng.uniform(-np.pi, np.pi)
    return pose, mount, np.round(pose[:2] + away * np.array([np.cos(angle), np.sin(angle)]), 2)


def _beam(pose: Any, mount: Any, landmark: Any) -> Array:
    """Return range and bearing."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    d = landmark - pose[:2] - np.array([[c, -s], [s, c]]) @ mount
    return np.array([np.hypot(*d), wrap_angle(np.arctan2(d[1], d[0]) - pose[2])])


def _mount_found(function: Any, seed: int) -> tuple[Array, Array]:
    """Run EKF-SLAM with the mount in its state: the mount after each step, its covariance."""
    rng, room = np.random.default_rng(seed), 3.5 * np.array([[1, 1], [1, -1], [-1, 0.5], [0, -1]])
    V, R, dt = np.diag([0.03, 0.03]) ** 2, np.diag([0.03, 0.02]) ** 2, 0.5
    pose, mean, P = np.zeros(3), np.zeros(5), np.diag([0, 0, 0, 0.3, 0.3]) ** 2
    found = [mean[3:5].copy()]
    for k in range(60):
        u = np.array([0.4, 0.6 * np.cos(k / 8)])
        v, omega = u + rng.normal(0, 0.03, 2)
        pose = pose + dt * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), omega])
        c, s = np.cos(mean[2]), np.sin(mean[2])
        F, G = np.eye(len(mean)), np.zeros((len(mean), 2))
        F[:2, 2], G[:3] = dt * u[0] * np.array([-s, c]), dt * np.array([[c, 0], [s, 0], [0, 1]])
        mean, P = mean + G @ u, F @ P @ F.T + G @ V @ G.T
        j = k % len(room)
        z = _beam(pose, _MOUNT, room[j]) + rng.normal(0, [0.03, 0.02])
        new, at = k < len(room), 5 + 2 * j
        if new:
            c, s, angle = np.cos(mean[2]), np.sin(mean[2]), mean[2] + z[1]
            sensor_position = mean[:2] + np.array([[c, -s], [s, c]]) @ mean[3:5]
            mean = np.append(
                mean, sensor_position + z[0] * np.array([np.cos(angle), np.sin(angle)])
            )
        came = np.asarray(function(mean[:3], mean[3:5], mean[at : at + 2]), float)
        H = np.zeros((2, len(mean)))
        H[:, :5], H[:, at : at + 2] = came[:, :5], came[:, 5:]
        if new:
            P = add_landmark(P, H[:, :-2], H[:, -2:], R)
        else:
            nu = z - _beam(mean[:3], mean[3:5], mean[at : at + 2])
            nu[1] = wrap_angle(nu[1])
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            mean, P = mean + K @ nu, P - K @ H @ P
        found.append(mean[3:5].copy())
    return np.array(found), P[3:5, 3:5]


_MOUNT = np.array([0.4, -0.2])


def _jacobian_drawn(ax: Any, function: Any) -> None:
    """Draw the mount: first guess (orange), estimate by step, 95 % ellipse (blue), truth (star)."""
    from slamlab import plots

    found, cov = _mount_found(function, 1)
    plots.landmarks(ax, _MOUNT[None])
    plots.path(ax, found)
    ax.plot(0, 0, "o", color=plots.COLOURS["dead_reckoning"], markersize=6)
    plots.ellipse(ax, found[-1], cov)
    ax.set_title(
        f"mount off by {100 * np.hypot(*(found[-1] - _MOUNT)):.1f} cm,\n"
        f"reported σ {100 * np.sqrt(max(np.trace(cov), 0.0)):.1f} cm"
    )
    ax.set_aspect("equal")
    ax.set(xlabel="ahead of the centre (m)", ylabel="to its left (m)")
    ax.set(xlim=(-0.05, 0.5), ylim=(-0.45, 0.15))


check_jacobian = Check(
    jacobian,
    "H",
    {
        "a scanner in the centre": ([0.4, -0.3, 0.5], [0, 0], [3, 1]),
        "the lesson's: ahead of the centre": ([0.2, -0.4, 0.3], [0.3, 0.0], [4, 1]),
        "at the left side": ([1, 2, -0.7], [0.0, 0.4], [2, 5]),
        "at the right side": ([1, 2, -0.7], [0.0, -0.4], [2, 5]),
        "ahead and to the left, a landmark behind": ([1, 2, 2.5], [0.5, 0.2], [4, -1]),
        "behind the centre": ([-1, 0.5, 1.2], [-0.4, 0.1], [1.5, 3]),
        "anywhere": _scene,
    },
    tolerance=1e-4,
    picture=_jacobian_drawn,
)

# %% tags=["mistakes"]
check_jacobian.mistakes = {
    "the scanner was put at the centre: it is at the mount": "turn @ mount => np.zeros(2)",
    "the mount was added as if it were in the world: the heading turns it": (
        "turn @ mount => np.asarray(mount)"
    ),
    "the mount was turned the wrong way: from the robot's frame to the world": (
        "turn @ mount => turn.T @ mount"
    ),
    "the heading's column lacks the lever arm: a turn swings the scanner": (
        "-H_m @ [-lever[1], lever[0]] - [0.0, 1.0] => np.array([0.0, -1.0])"
    ),
    "only the part ahead, a, swings in the heading's column: b swings as well": (
        "[-lever[1], lever[0]] => (mount[0] * np.array([-s, c]))"
    ),
    "the heading's column lacks its -1: a turn of the robot is taken off the bearing": (
        " - [0.0, 1.0] => "
    ),
    "the swing in the heading's column has the wrong sign: the scanner swings, not the landmark": (
        "-H_m @ [-lever[1] => H_m @ [-lever[1]"
    ),
    "a and b are taken for x and y of the world: the heading turns them": "-H_m @ turn => -H_m",
    "the columns of a and b are turned the wrong way": "-H_m @ turn => -H_m @ turn.T",
    "the columns of a and b have the wrong sign: the mount moves the scanner, not the landmark": (
        "-H_m @ turn => H_m @ turn"
    ),
    "the columns of a and b are zero: the mount is estimated, too": (
        "-H_m @ turn => np.zeros((2, 2))"
    ),
    "the columns of the landmark have the sign of the pose's": "turn, H_m] => turn, -H_m]",
    "the bearing's row is divided by the distance: expected its square": (
        "[-dy / squared, dx / squared] => [-dy / rho, dx / rho]"
    ),
    "the range's row is divided by the squared distance: expected the distance": (
        "[dx / rho, dy / rho] => [dx / squared, dy / squared]"
    ),
    "the signs in the bearing's row are exchanged": (
        "[-dy / squared, dx / squared] => [dy / squared, -dx / squared]"
    ),
    "all signs are reversed: d points from the scanner to the landmark": (
        "return np.column_stack => return -np.column_stack"
    ),
    "the landmark stands before the mount: the order is pose, mount, landmark": (
        "-H_m @ turn, H_m] => H_m, -H_m @ turn]"
    ),
    "this is the transpose: rows are range and bearing": (
        "np.column_stack([-H_m, H_heading, -H_m @ turn, H_m])"
        " => np.column_stack([-H_m, H_heading, -H_m @ turn, H_m]).T"
    ),
    "the rows are exchanged: range first": (
        "np.column_stack([-H_m, H_heading, -H_m @ turn, H_m])"
        " => np.column_stack([-H_m, H_heading, -H_m @ turn, H_m])[::-1]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: where is the scanner?
#
# Everything goes through $d$, the vector from the scanner to the landmark. What moves the
# landmark enters with $H_j$, what moves the scanner with $-H_j$: $x$ and $y$ as in the lesson, $a$
# and $b$ turned by the heading. A turn swings the scanner at right angles to its lever arm $(l_x,
# l_y)$, by $(-l_y, l_x)$ per radian, and takes the turn off the bearing.
#
# The columns of $a$ and $b$ are those of $x$ and $y$, turned by $\theta$. As long as the heading
# stays the same, an error of the mount looks like one of the position. Here are six observations
# from three poses; all positions may be off by one vector, and the mount by another, four numbers
# in all. A singular value of 0 is a combination of them that no observation shows:

# %% active="ipynb" tags=["solution"]
# mount, landmarks = np.array([0.4, -0.2]), np.array([[4.0, 2.0], [3.0, -3.0]])
# for name, turn in (("straight on", 0.0), ("in a curve", 0.3)):
#     poses = [np.array([0.4 * k, 0.0, 0.2 + turn * k]) for k in range(3)]
#     H = [jacobian(p, mount, m)[:, [0, 1, 3, 4]] for p in poses for m in landmarks]
#     print(f"{name}: {np.linalg.svd(np.concatenate(H))[1].round(2)}")

# %% [markdown] tags=["solution"]
# Straight on, two of four combinations are not seen; in the curve all are. So a robot that
# calibrates itself has to turn. A derivative that takes the mount for a vector of the world has
# the columns of $x$ and $y$ twice. To this filter every drive is a straight one, and the mount
# stays at its first value:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels: on the left the mount stays at the centre, in a large ellipse; on the right it is found."}}
# def not_turned(pose, mount, landmark):
#     H = jacobian(pose, mount, landmark)
#     H[:, 3:5] = H[:, :2]
#     return H
#
# check_jacobian.draw(not_turned)

# %% [markdown] tags=["solution"]
# The picture does not show every mistake. Without $b$ in the heading's column the mount of this
# drive comes out as well as before. It is mistake D of the lesson again, and the comparison of
# numbers finds it:

# %% active="ipynb" tags=["solution"]
# def without_b(pose, mount, landmark):
#     H = jacobian(pose, mount, landmark)
#     swing = mount[0] * np.array([-np.sin(pose[2]), np.cos(pose[2])])
#     H[:, 2] = H[:, :2] @ swing - [0, 1]
#     return H
#
# check_jacobian(without_b)

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels that hardly differ: in both the mount is found."}}
# check_jacobian.draw(without_b)

# %% [markdown] tags=["statement"]
# ## Exercise 2: a landmark from two bearings
#
# A small robot has a camera in place of a scanner. The camera measures in which direction a
# landmark is, not how far away. One bearing places nothing; two bearings, from two poses, do: the
# landmark is where the rays cross. The state holds both poses, that of now and a copy of the
# earlier one, and the landmarks so far. The lesson's
#
# $$
# P\leftarrow\begin{bmatrix}P&P\,G_x^\top\\G_xP&G_xP\,G_x^\top+G_zR\,G_z^\top\end{bmatrix}
# \tag{P1 (43)}
# $$
#
# needs $G_x$ and $G_z$, the derivatives of the *place* with respect to state and measurement. For
# a crossing of two rays they fill a page. The other direction is easier. A landmark at $m$ gives
# the observation $z = h(x, m) + v$, with a noise $v$ of covariance $R$; here $z$ is the pair of
# bearings. The derivatives of $h$ with respect to state and place, $H_x$ and $H_m$, are given:
# their rows are those of a bearing in exercise 1. The new landmark is placed where $h(x, m)$ is
# what was measured.
#
# Write the covariance of the longer state from $H_x$, $H_m$ and $R$, for any sensor for which
# $H_m$ has an inverse. With a pencil first: a robot on a line at $x$, with a variance of 0.04 m²,
# measures $z = m - x$, with 0.01 m². So $H_x = -1$ and $H_m = 1$, and the landmark is placed at
# $m = x + z$. What are its variance and its covariance with $x$?
#
# The picture: the robot has placed a landmark by two bearings. Then it drives into its dock, which
# tells it where it is *now*. Your covariance must move the landmark.


# %% tags=["exercise"]
def add_landmark(P: Array, H_x: Array, H_m: Array, R: Array) -> Array:
    """Covariance of the state with one landmark more.

    Parameters
    ----------
    P : ndarray, shape (n, n)
        Covariance of the old state: poses and landmarks.
    H_x : ndarray, shape (k, n)
        Derivative of the k measured numbers by the old state.
    H_m : ndarray, shape (k, k)
        Derivative of the measured numbers by the new landmark: k is 2 in the plane
        and 1 on a line. It has an inverse.
    R : ndarray, shape (k, k)
        Covariance of the measurement.

    Returns
    -------
    ndarray, shape (n + k, n + k)
        The new landmark comes last.
    """
    G_z = np.linalg.inv(H_m)
    G_x = -G_z @ H_x
    cross = G_x @ P
    own = cross @ G_x.T + G_z @ R @ G_z.T
    return np.block([[P, cross.T], [cross, own]])


# %% active="ipynb" tags=["try"]
# add_landmark(np.array([[0.04]]), np.array([[-1.0]]), np.array([[1.0]]),
#              np.array([[0.01]]))

# %% [markdown] tags=["hint"]
# Let the state change by a small $dx$ and the measurement by a small $dz$. By which $dm$ must the
# landmark move, so that it is still seen as measured?

# %% [markdown] tags=["hint"]
# It must hold that $dz = H_x\,dx + H_m\,dm$. Solve this for $dm$, and compare with $dm = G_x\,dx +
# G_z\,dz$.

# %% [markdown] tags=["hint"]
# The rest is (43). Test it with the pencil's numbers: a variance of 0.05 m², and a covariance with
# the robot of +0.04 m², since a robot further on puts the landmark further on.


# %% tags=["cases"]
def _bearings(poses: Any, landmark: Any, n: int) -> tuple[Array, Array]:
    """Return H_x and H_m of one bearing from each of two poses, the first six of n numbers."""
    rows = [jacobian(pose, np.zeros(2), landmark)[1] for pose in poses]
    H_x = np.zeros((2, n))
    H_x[0, :3], H_x[1, 3:6] = rows[0][:3], rows[1][:3]
    return H_x, np.array([row[5:] for row in rows])


@drawn
def _crossing(rng: np.random.Generator, landmarks: int, size: float = 1.0) -> Any:
    landmark, towards = rng.uniform(-5, 5, 2), rng.uniform(-np.pi, np.pi)
    poses, n = [], 6 + 2 * landmarks
    for angle in (towards, towards + rng.choice([-1, 1]) * rng.uniform(0.4, 1.4)):
        place = landmark - rng.uniform(2, 5) * np.array([np.cos(angle), np.sin(angle)])
        poses.append(np.append(place, an_angle(rng)))
    H_x, H_m = (np.round(H, 4) for H in _bearings(poses, landmark, n))
    return size * a_covariance(rng, n, 0.1), H_x, H_m, a_covariance(rng, 2, 0.02)


@drawn
def _range_and_bearing(rng: np.random.Generator, landmarks: int) -> Any:
    pose, _, landmark = _scene(rng)
    H, n = np.round(jacobian(pose, np.zeros(2), landmark), 4), 3 + 2 * landmarks
    H_x = np.zeros((2, n))
    H_x[:, :3] = H[:, :3]
    return a_covariance(rng, n, 0.1), H_x, H[:, 5:], a_covariance(rng, 2, 0.02)


def _beside_another(rng: np.random.Generator) -> Any:
    H_x = np.zeros((2, 9))
    H_x[:, 5:7] = -np.eye(2)
    return a_covariance(rng, 9, 0.1), H_x, np.eye(2), a_covariance(rng, 2, 0.02)


def _docked(function: Any) -> tuple[Any, ...]:
    """Place a landmark by two bearings, then learn where the robot is: truth, before, after."""
    believed = np.array([2.2, 0.2, 0.5, 0.0, 0.0, 0.1])  # now, and the pose of before
    P = np.diag([0.0, 0.0, 0.0, 0.05, 0.05, np.radians(5)]) ** 2
    F = np.eye(6)
    F[:3, :3], F[:3, 3:] = 0.0, np.array([[1, 0, -0.2], [0, 1, 2.2], [0, 0, 1]])
    Q = np.diag([0.04, 0.04, np.radians(1), 0.0, 0.0, 0.0]) ** 2
    P = F @ P @ F.T + Q
    truth = believed + np.array([-0.05, 0.22, 0.115, 0.03, 0.04, 0.1])
    landmark, R = np.array([2.0, 3.0]), np.radians(0.5) ** 2 * np.eye(2)
    z = [_beam(pose, np.zeros(2), landmark)[1] for pose in (truth[:3], truth[3:])]
    rays = np.array([z[0] + believed[2], z[1] + believed[5]])
    normals = np.column_stack([-np.sin(rays), np.cos(rays)])
    place = np.linalg.solve(normals, (normals * believed.reshape(2, 3)[:, :2]).sum(1))
    before = np.append(believed, place)
    P = np.asarray(function(P, *_bearings((believed[:3], believed[3:]), place, 6), R), float)
    S = P[:3, :3] + np.diag([0.01, 0.01, np.radians(0.3)]) ** 2
    K = P[:, :3] @ np.linalg.inv(S)
    after = before + K @ (truth[:3] - believed[:3])
    return np.append(truth, landmark), before, P, after, P - K @ S @ K.T


def _add_landmark_drawn(ax: Any, function: Any) -> None:
    """Draw two rays that cross at a landmark, before the robot is in its dock and after."""
    from slamlab import plots

    truth, *both = _docked(function)
    for kind, mean, P in (("dead_reckoning", *both[:2]), ("estimate", *both[2:])):
        plots.path(ax, np.array([mean[3:5], mean[6:8], mean[:2]]), kind)
        plots.ellipse(ax, mean[6:8], P[6:8, 6:8], kind)
    plots.landmarks(ax, truth[None, 6:])
    ax.plot(*truth[[[0, 1], [3, 4]]].T, "o", color=plots.COLOURS["truth"], markersize=5)
    off = [100 * np.hypot(*(mean[6:8] - truth[6:])) for mean in both[::2]]
    ax.set_title(f"off by {off[0]:.0f} cm (dashed),\nin the dock by {off[1]:.0f} cm")
    plots.floor(ax)
    ax.set(xlim=(-0.4, 3.2), ylim=(-0.3, 3.6))


check_add_landmark = Check(
    add_landmark,
    "P",
    {
        "on a line, the pencil's numbers": ([[0.04]], [[-1.0]], [[1.0]], [[0.01]]),
        "a scale on a line that counts half metres": ([[0.04]], [[-2.0]], [[2.0]], [[0.01]]),
        "two bearings, the first landmark": _crossing(0),
        "two bearings, poses without uncertainty": _crossing(0, 0.0),
        "two bearings, the fourth landmark": _crossing(3),
        "range and bearing, the second landmark": _range_and_bearing(1),
        "measured from another landmark, not from the robot": _beside_another,
    },
    tolerance=1e-8,
    picture=_add_landmark_drawn,
)

# %% tags=["mistakes"]
check_add_landmark.mistakes = {
    "the cross-covariances have the wrong sign: a robot further on puts the landmark further on": (
        "G_x = -G_z => G_x = G_z"
    ),
    "H_m was not inverted: it leads from the landmark to the measurement": (
        "np.linalg.inv(H_m) => H_m"
    ),
    "H_m was transposed, not inverted": "np.linalg.inv(H_m) => H_m.T",
    "the inverse of H_m was transposed": "np.linalg.inv(H_m) => np.linalg.inv(H_m).T",
    "the state's part does not go through the inverse of H_m: dm solves H_m dm = dz - H_x dx": (
        "-G_z @ H_x => -H_x"
    ),
    "the new landmark is tied to nothing: the blocks beside it are G_x P": (
        "[[P, cross.T], [cross, own]] => [[P, 0 * cross.T], [0 * cross, own]]"
    ),
    "the landmark is tied to the first pose only: use all columns of P": (
        "[[P, cross.T], [cross, own]] => [[P, (cross * (np.arange(len(P)) < 3)).T],"
        " [cross * (np.arange(len(P)) < 3), own]]"
    ),
    "the sensor's noise is missing: add G_z R G_z^T": " + G_z @ R @ G_z.T => ",
    "the uncertainty of the state is missing: add G_x P G_x^T": "cross @ G_x.T + G_z => G_z",
    "this is the covariance of the innovation: the landmark's goes through the inverse of H_m": (
        "cross @ G_x.T + G_z @ R @ G_z.T => H_x @ P @ H_x.T + R"
    ),
    "R is that of the measurement, in its units: it goes through the inverse of H_m": (
        "G_z @ R @ G_z.T => R"
    ),
    "the noise went through H_m, not its inverse": "G_z @ R @ G_z.T => H_m @ R @ H_m.T",
    "the noise went through G_z from the wrong side: G_z R G_z^T": (
        "G_z @ R @ G_z.T => G_z.T @ R @ G_z"
    ),
    "the second G_z is not transposed: G_z R G_z^T": "R @ G_z.T => R @ G_z",
    "the inverse of H_m stands on one side of R only": "R @ G_z.T => R",
    "the noise was subtracted: it makes the landmark less certain": "+ G_z @ R => - G_z @ R",
    "the covariance has not grown: the landmark's rows and columns come in": (
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
# ## Solution 2: a landmark from two bearings
#
# The landmark is placed so that it is seen as measured. If the state changes by $dx$ and the
# measurement by $dz$, this stays so if $dz = H_x\,dx + H_m\,dm$. So $dm = H_m^{-1}(dz -
# H_x\,dx)$: $G_z = H_m^{-1}$ and $G_x = -H_m^{-1}H_x$, without a formula for the place. The rest
# is (43). If the rays are nearly parallel, $H_m^{-1}$ is large, and so is the ellipse, along the
# rays.

# %% [markdown] tags=["solution"]
# The sign of $G_x$ does not show in the landmark's own block, in which $G_x$ occurs twice. Its
# ellipse is right, and the first correction that comes moves the landmark the wrong way. A robot
# on a line places a landmark and then learns where it is itself, to 1 cm (σ); 1000 times:

# %% active="ipynb" tags=["solution"]
# def wrong_sign(P, H_x, H_m, R):
#     return add_landmark(P, -H_x, H_m, R)
#
# def without_ties(P, H_x, H_m, R):
#     G_z, none = np.linalg.inv(H_m), np.zeros_like(H_x)
#     own = G_z @ (H_x @ P @ H_x.T + R) @ G_z.T
#     return np.block([[P, none.T], [none, own]])

# %% active="ipynb" tags=["solution"]
# def in_the_dock(function, n=1000):
#     rng = np.random.default_rng(1)
#     x, noise = rng.normal(0, 0.2, n), rng.normal(0, 0.1, n)  # robots, estimated at 0
#     P = function(*(np.array([[a]]) for a in (0.04, -1.0, 1.0, 0.01)))
#     S = P[0, 0] + 0.01**2
#     K = P[:, 0] / S
#     m = 3 + noise + K[1] * (x + rng.normal(0, 0.01, n))      # the landmark is at x + 3
#     error, variance = m - (x + 3), P[1, 1] - K[1]**2 * S
#     return 100 * np.sqrt(np.mean(error**2)), 100 * np.sqrt(variance)
#
# for function in (add_landmark, without_ties, wrong_sign):
#     off, sigma = in_the_dock(function)
#     print(f"{function.__name__:13s} off by {off:4.1f} cm, reported σ {sigma:4.1f} cm, "
#           f"NEES {(off / sigma)**2:4.1f}")

# %% [markdown] tags=["solution"]
# Without cross-covariances the landmark does not move in the dock: it stays off by what the
# robot was off. With the wrong sign it is off about twice as much, and reported as if it were
# right: a NEES of 16 where 1 is expected.

# %% active="ipynb" tags=["solution"]
# check_add_landmark(wrong_sign)

# %% [markdown] tags=["statement"]
# ## Exercise 3: a wall
#
# A robot drives round a block of shelves in a bare hall. There is nothing to see but walls, those
# of the hall and those of the block. So the walls become the landmarks, as on [the second
# page](../09b_ekf_slam.ipynb). A wall is a line
#
# $$
# x\cos\alpha+y\sin\alpha=r
# $$
#
# of the world: $r>0$ is its distance from the origin, $\alpha$ the direction in which one meets it
# at right angles. The lesson's scanner, $L$ ahead of the centre, measures the distance of the line
# and the direction of its nearest point, seen from the robot's heading. A distance is never
# negative, a direction is in $(-\pi,\pi]$.
#
# The origin of the map is inside the block. For the walls of the hall the scanner is on the
# origin's side of the line, and each number is one subtraction. For the walls of the block it is
# on the other side. With a pencil: a wall at $x=3$ m, a robot at $x=5$ m that looks along the $x$
# axis, $L=0.3$ m. What does the scanner measure? Write it for both sides. A scanner exactly on
# the line does not occur.
#
# With the observation a robot can draw what it has seen: in the picture each dot is the nearest
# point of a wall, placed from the scanner by your two numbers.


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
# What is the sign of the difference when the scanner has passed the line? In which direction is
# the nearest point then, compared with before?

# %% [markdown] tags=["hint"]
# The pairs $(r, \alpha)$ and $(-r, \alpha+\pi)$ are the same line. Of these two, one has the sign
# that a distance may have. Angles are wrapped last.


# %% tags=["cases"]
def _walled(rng: np.random.Generator) -> Any:
    wall = [float(np.round(rng.uniform(0.5, 5), 2)), an_angle(rng)]
    return np.round(a_pose(rng), 2), wall, float(np.round(rng.uniform(0, 1), 2))


def _observe_wall_drawn(ax: Any, function: Any) -> None:
    """Draw where a robot (black) places the walls it sees on a lap (green); blue: now."""
    from slamlab import plots

    L, sides = 0.3, (0, np.pi / 2, np.pi, -np.pi / 2)
    outer = [[r, side] for r, side in zip((3, 2, 3, 2), sides, strict=True)]
    inner = [[r, side] for r, side in zip((0.7, 0.4, 0.7, 0.4), sides, strict=True)]
    turn = np.linspace(0, 2 * np.pi, 25)
    poses = np.column_stack([1.8 * np.cos(turn), np.sin(turn), wrap_angle(turn + np.pi / 2)])
    points, rays, off = [], [], []
    for k, pose in enumerate(poses):
        scanner = pose[:2] + L * np.array([np.cos(pose[2]), np.sin(pose[2])])
        side, along = np.abs(scanner) / [0.7, 0.4] > 1  # beside which walls of the box it is
        near = [w for w in inner if (side != along) and scanner @ _normal(w) > w[0]]
        clear = [w for w in outer if all(_normal(w) @ _normal(n) > -0.5 for n in near)]
        for wall in clear + near:
            distance, direction = function(pose, np.array(wall, float), L)
            angle = direction + pose[2]
            points.append(scanner + distance * np.array([np.cos(angle), np.sin(angle)]))
            off.append(abs(points[-1] @ _normal(wall) - wall[0]))
            if k == 5:
                rays.append(np.array([scanner, points[-1]], float))
    for corner in ([3, 2], [0.7, 0.4]):
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * corner
        plots.walls(ax, np.stack([corners, np.roll(corners, -1, 0)], 1))
    plots.path(ax, poses, "truth", linewidth=0.8)
    plots.lidar_points(ax, np.array(points, float), s=4)
    for ray in rays:
        ax.plot(*ray.T, color=plots.COLOURS["estimate"], lw=1)
    _looking(ax, poses[5], "truth")
    ax.set_aspect("equal")
    ax.set_title(f"points off their walls by {np.mean(off):.1f} m")
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
# Making the distance positive and leaving the direction as it was puts the walls of the block on
# the wrong side of the robot:

# %% active="ipynb" tags=["solution"]
# def half_renamed(pose, wall, L):
#     xs, ys = pose[0] + L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2])
#     r, alpha = wall
#     distance = r - (xs * np.cos(alpha) + ys * np.sin(alpha))
#     return np.array([abs(distance), wrap_angle(alpha - pose[2])])
#
# check_wall(half_renamed)

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels: on the left the walls of the block are drawn beside those of the hall, on the right where they are."}}
# check_wall.draw(half_renamed)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a map falls apart
#
# The update below has been tried with one landmark ahead of the robot, and it worked. In the room
# there are three, and the robot looks the other way. Each is observed ten times, and the map is
# further off than the first guess was. Draw it first. Which landmark still has the ellipse of the
# start? Which crosses have left their stars, with an ellipse of centimetres?
#
# The state is the pose, then the landmarks, two numbers each. The scanner is at the robot's
# centre, and measures bearings in $(-\pi, \pi]$. There are two bugs. Find and repair them.


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
    z = [np.hypot(*d), np.arctan2(d[1], d[0]) - mean[2]] + rng.normal(0, 0.1, 2)
    if across:
        z[1] = np.arctan2(d[1], d[0]) - mean[2] - 0.2
    z[1] = wrap_angle(z[1])
    return mean, a_covariance(rng, len(mean), 0.05), z, i, a_covariance(rng, 2, 0.02)


def _update_drawn(ax: Any, function: Any) -> None:
    """Draw a map (blue) after thirty updates; true robot (black, looks left), true landmarks."""
    from slamlab import plots
    from slamlab.sensors import RangeBearing

    rng, sensor = np.random.default_rng(4), RangeBearing(0.05, 0.03)
    pose, stars = np.array([0.0, 0.0, 2.9]), np.array([[-3.0, 0.8], [1.0, 2.0], [-1.5, -1.6]])
    P = np.diag([0.01, 0.01, 0.01, *[0.3] * 6]) ** 2
    mean = np.concatenate([pose, (stars + rng.normal(0, 0.3, (3, 2))).ravel()])
    for k in range(30):
        z = sensor.observe(pose, stars[k % 3]) + rng.standard_normal(2) * [0.05, 0.03]
        z[1] = wrap_angle(z[1])
        mean, P = function(mean, P, z, k % 3, sensor.cov)
    plots.landmarks(ax, stars)
    _looking(ax, pose, "truth", 7)
    _map_drawn(ax, np.asarray(mean, float), np.asarray(P, float))
    off = np.asarray(mean, float)[3:].reshape(3, 2) - stars
    ax.set_title(f"landmarks off by {100 * np.sqrt((off**2).sum(1).mean()):.0f} cm")
    ax.set(xlim=(-4.4, 2.4), ylim=(-2.9, 3.3))


def _looking(ax: Any, pose: Any, kind: str, size: float = 5) -> None:
    """Draw a robot as a dot, and a line of 0.8 m where it looks."""
    from slamlab import plots

    x, y, theta = pose
    colour = plots.COLOURS[kind]
    ax.plot(x, y, "o", color=colour, markersize=size)
    ax.plot([x, x + 0.8 * np.cos(theta)], [y, y + 0.8 * np.sin(theta)], color=colour, lw=size / 3)


def _map_drawn(ax: Any, mean: Array, P: Array) -> None:
    """Draw pose and landmarks with their 95 % ellipses."""
    from slamlab import plots

    _looking(ax, mean[:3], "estimate")
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
        "a robot that looks the other way": (
            [0.0, 0.0, 0.0, -5.0, 0.2],
            np.diag([0.01, 0.01, 0.01, 0.05, 0.05]),
            [5.1, -3.1],
            0,
            0.01 * np.eye(2),
        ),
        "a far-off first guess": (
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
# ## Solution 4: a map falls apart, by two bugs
#
# Landmark $i$ begins at row $3 + 2i$: the pose takes three rows, every landmark before it two.
# With $i = 0$ the wrong formula is right, so a test with one landmark finds nothing. With $i = 2$
# it reads the rows of the second landmark, and with $i = 1$ the $y$ of the first and the $x$ of
# the second: the third is never touched, and keeps the ellipse of the start. The second bug is a
# missing wrap: it shows where the measured and the expected bearing differ by about a full turn.

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
# ## Exercise 5: your EKF-SLAM, on 200 drives
#
# A robot starts in an unknown room, at the origin of its map, with a pose that it knows exactly.
# It has the three pieces now: your `jacobian`, your `add_landmark` and your `update` make an
# EKF-SLAM. Assemble it for a robot that cannot drive sideways, whose scanner is at its centre.
#
# **Predict.** In a step of $dt$ it moves by $v\,dt$ along the heading that it had before, then
# turns by $\omega\,dt$. Speed and turn rate have the covariance $V$:
#
# $$
# F=\begin{bmatrix}1&0&-v\,dt\sin\theta\\0&1&v\,dt\cos\theta\\0&0&1\end{bmatrix},\quad
# G=dt\begin{bmatrix}\cos\theta&0\\\sin\theta&0\\0&1\end{bmatrix},\quad
# P\leftarrow\begin{bmatrix}FP_pF^\top+GVG^\top&FP_{pm}\\(FP_{pm})^\top&P_m\end{bmatrix}.
# $$
#
# **Correct or add.** After each step it may observe one landmark, by its name. A known name is an
# `update`. A new one makes the state longer, and its observation is then used up.
#
# The picture lets your filter make the map of one room 200 times, on 200 drives with other noise.
# Dots: where it puts the eight landmarks. Ellipses: what it reports, 95 %, round the true places,
# from the mean of its 200 covariances $P$.
# Both are drawn four times as large. Above it are the mean error and the mean NEES of the last
# pose; in 99 of 100 such sets the NEES of a consistent filter is in the band. Before you draw:
# which landmarks are the least certain, and in which direction?


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
            place = mean[:2] + seen[0] * np.array([c, s])
            H = jacobian(mean[:3], np.zeros(2), place)
            H_x = np.zeros((2, len(mean)))
            H_x[:, :3] = H[:, :3]
            mean = np.append(mean, place)
            P = add_landmark(P, H_x, H[:, 5:], R)
            known.append(name)
    return mean, P


# %% active="ipynb" tags=["try"]
# slam(np.array([[1.0, 0.2]]), 0.5, 0.01 * np.eye(2), np.array([[2.0, 0.3]]),
#      np.array([7]), 0.01 * np.eye(2))

# %% [markdown] tags=["hint"]
# Keep a list of names: its order is the order of the landmarks in the state. `list.index` gives
# the number that `update` wants.

# %% [markdown] tags=["hint"]
# The full derivative of the prediction is the identity but for its upper left block $F$. So the
# first three rows of $P$ are multiplied by $F$ from the left, and after that the first three
# columns by $F^\top$ from the right. Then the noise is added to the block of the pose.

# %% [markdown] tags=["hint"]
# A new landmark is at $(x, y) + r\,(\cos(\theta + \varphi), \sin(\theta + \varphi))$. There, with
# the mount $(0, 0)$, `jacobian` has in its columns all that `add_landmark` needs: which are $H_m$,
# which belong into $H_x$, and what is the derivative by the landmarks so far?


# %% tags=["cases"]
_ROOM = np.array([0.0, 3.0]) + 4 * np.array(
    [[np.cos(turn), np.sin(turn)] for turn in np.arange(8) * np.pi / 4]
)


def _two_hundred(seed: int = 6) -> tuple[Any, ...]:
    """Return 200 noisy drives round eight landmarks: u, dt, V, R, names, z, paths."""
    rng, dt, steps, n = np.random.default_rng(seed), 0.5, 48, 200
    u, names = np.tile([0.8, 0.8 / 3], (steps, 1)), np.arange(steps) % 8
    V, sigma = np.diag([0.06, 0.03]) ** 2, np.array([0.05, 0.02])
    driven = u + rng.standard_normal((n, steps, 2)) * np.sqrt(np.diag(V))
    poses, z = [np.zeros((n, 3))], []
    for k, name in enumerate(names):
        (x, y, theta), (v, omega) = poses[-1].T, driven[:, k].T
        x, y = x + dt * v * np.cos(theta), y + dt * v * np.sin(theta)
        poses.append(np.column_stack([x, y, theta + dt * omega]))
        d = _ROOM[name] - poses[-1][:, :2]
        seen = np.column_stack([np.hypot(*d.T), np.arctan2(d[:, 1], d[:, 0]) - poses[-1][:, 2]])
        z.append(seen + rng.standard_normal((n, 2)) * sigma)
    seen = np.stack(z, 1)
    seen[..., 1] = wrap_angle(seen[..., 1])
    return u, dt, V, np.diag(sigma**2), names, seen, np.stack(poses, 1)


def _slam_drawn(ax: Any, function: Any) -> None:
    """Draw where 200 drives put eight landmarks, and the 95 % ellipses of the mean P reported."""
    from slamlab import plots
    from slamlab.evaluation import chi2_band

    u, dt, V, R, names, seen, paths = _two_hundred()
    places, covs, nees, off = [], [], [], []
    for z, path in zip(seen, paths, strict=True):
        mean, P = (np.asarray(one, float) for one in function(u, dt, V, z, names, R))
        error = mean[:3] - path[-1]
        error[2] = wrap_angle(error[2])
        nees.append(error @ np.linalg.solve(P[:3, :3], error))
        off.append(np.hypot(*error[:2]))
        places.append(mean[3:].reshape(8, 2))
        covs.append(P[3:, 3:])
    low, high = chi2_band(3, len(nees))
    mean_nees = f"{np.mean(nees):.1f}" if abs(np.mean(nees)) < 1000 else "over 1000"
    cov, larger = np.mean(covs, axis=0), 4
    plots.lidar_points(ax, np.concatenate(_ROOM + larger * (places - _ROOM)), s=1.2)
    plots.path(ax, paths[0], "truth")
    for k, star in enumerate(_ROOM):
        own = cov[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
        if np.linalg.eigvalsh(own)[0] > 0:  # a wrong filter may report less than nothing
            plots.ellipse(ax, star, larger**2 * own).set(lw=1.5, zorder=3)
    plots.landmarks(ax, _ROOM)
    ax.set_aspect("equal")
    ax.set_title(
        f"200 drives: off by {100 * np.mean(off):.1f} cm,\n"
        f"NEES {mean_nees}; band {low:.1f} to {high:.1f}"
    )
    ax.set(xlabel="x (m); errors 4 times as large", ylabel="y (m)")
    ax.set(xlim=(-5.8, 5.8), ylim=(-2.4, 8.4))


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
    "the column of the heading is missing in H_x: a new landmark swings with the robot": (
        "H_x[:, :3] = H[:, :3] => H_x[:, :2] = H[:, :2]"
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
    "the cross-covariances did not move: P_pm becomes F P_pm": (
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
        "P = add_landmark(P, H_x, H[:, 5:], R)"
        " => own = add_landmark(P, H_x, H[:, 5:], R)[-2:, -2:]\n            "
        "P = np.block([[P, np.zeros((len(P), 2))], [np.zeros((2, len(P))), own]])"
    ),
    "a landmark that comes in was used for an update at once: it is counted twice": (
        "known.append(name)"
        " => known.append(name)\n            "
        "mean, P = update(mean, P, seen, known.index(name), R)"
    ),
    "the landmark named 0 was left out: only -1 says that nothing was seen": (
        "elif name >= 0 => elif name > 0"
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
    "the sensor's noise is missing in a new landmark": ("H[:, 5:], R) => H[:, 5:], 0 * R)"),
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
# ## Solution 5: EKF-SLAM, on 200 drives
#
# Three functions and a list of names. What to notice: the two lines that move the blocks beside
# the pose, and the new landmark, for which no derivative had to be written. With `observe_wall`
# and its derivatives in place of range and bearing, the same loop maps the walls of exercise 3.
#
# The ellipses grow with the distance from the start, and they are long across the direction in
# which the start is: most of the error is one turn of the whole map, as in the lesson. The dots
# fill the ellipses, and the mean NEES is in its band.

# %% [markdown] tags=["solution"]
# Now the same filter with new landmarks that come in without their cross-covariances, as
# `without_ties` places them in solution 2. Say before you run it what changes: the dots, the
# ellipses, the metres, the NEES?

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels of eight landmarks: on the left many dots are outside of the ellipses, on the right they fill them."}}
# right, add_landmark = add_landmark, without_ties  # slam takes this one now
# figure = check_slam.draw(slam)
# add_landmark = right
# figure

# %% [markdown] tags=["solution"]
# The robot is hardly further off, and each map may pass for a good one. But the dots leave the
# ellipses, and the NEES is far above its band: the filter takes each new landmark for information
# that is independent of the pose from which it was placed. Worse is a filter whose predict moves
# the block of the pose and leaves the blocks beside it where they were:

# %% active="ipynb" tags=["solution"]
# def ties_left_behind(u, dt, V, z, ids, R):
#     mean, P, known = np.zeros(3), np.zeros((3, 3)), []
#     for (v, omega), seen, name in zip(u, z, ids, strict=True):
#         c, s = np.cos(mean[2]), np.sin(mean[2])
#         F = np.array([[1.0, 0.0, -v * dt * s], [0.0, 1.0, v * dt * c], [0.0, 0.0, 1.0]])
#         G = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])
#         mean[:3] += dt * np.array([v * c, v * s, omega])
#         mean[2] = wrap_angle(mean[2])
#         P[:3, :3] = F @ P[:3, :3] @ F.T + G @ V @ G.T
#         if name in known:
#             mean, P = update(mean, P, seen, known.index(name), R)
#         elif name >= 0:
#             angle = mean[2] + seen[1]
#             place = mean[:2] + seen[0] * np.array([np.cos(angle), np.sin(angle)])
#             H = jacobian(mean[:3], np.zeros(2), place)
#             H_x = np.hstack([H[:, :3], np.zeros((2, len(mean) - 3))])
#             P = add_landmark(P, H_x, H[:, 5:], R)
#             mean = np.append(mean, place)
#             known.append(name)
#     return mean, P

# %% active="ipynb" tags=["solution"]
# check_slam(ties_left_behind)

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels of eight landmarks: on the left most dots are outside of the ellipses, on the right they fill them."}}
# check_slam.draw(ties_left_behind)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 09](../solutions/09_ekf_slam.ipynb).
