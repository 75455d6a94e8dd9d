"""Exercises, chapter 00: dead reckoning, the error of one edge, its Jacobian, the relaxed graph.

The error is that of g2o and Grisetti et al. (2010), as `slamlab.slam.PoseGraph` has it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, drawn
from slamlab.exercises._report import Array, Check, Function, Ints
from slamlab.geometry import between, compose, inverse, rotation, wrap_angle

__all__ = [
    "check_dead_reckoning",
    "check_edge_error",
    "check_lamp_jacobian",
    "check_relax",
    "check_slam",
]


# %% [markdown] tags=["chapter"]
# # Exercises 00: SLAM in ten minutes
#
# Five exercises: three pieces of a pose graph, an optimiser with two bugs, and the whole SLAM
# assembled; the chapter is [SLAM in ten minutes](../00_slam_in_ten_minutes.ipynb). Replace each
# `...` by your own lines and run the cell: the check below it tries your
# function on several inputs and says, one line a property, what was expected and what it got.
# Run it as often as you like.

# %% [markdown] tags=["solution"]
# # Solutions 00: SLAM in ten minutes
#
# The exercises are in [Exercises 00](../exercises/00_slam_in_ten_minutes.ipynb). Try them first:
# a check that finds your own slip teaches more than this page.

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import between, compose, inverse, rotation, wrap_angle

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
#
# from slamlab.evaluation import chi2_band
# from slamlab.geometry import between, compose, rotation, wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: dead reckoning
#
# A vacuum cleaner starts at its dock and reports how it moved, each time in its own frame: so far
# ahead, so far to the left, turned by so much. Where has it been? (The lesson did this for Killian
# Court, in a folded cell. Now you do.)


# %% tags=["exercise"]
def dead_reckoning(start: Array, odometry: Array) -> Array:
    """Chain relative motions into a path.

    Parameters
    ----------
    start : ndarray, shape (3,)
        First pose: x (m), y (m), theta (rad) in the world.
    odometry : ndarray, shape (n, 3)
        Motions, each in the frame of the pose before it (m, m, rad).

    Returns
    -------
    ndarray, shape (n + 1, 3)
        All poses, the start first; headings in (-pi, pi].
    """
    poses = [np.asarray(start, dtype=float)]
    for motion in odometry:
        poses.append(compose(poses[-1], motion))
    return np.array(poses)


# %% active="ipynb" tags=["try"]
# dead_reckoning(np.zeros(3), np.array([[1.0, 0.0, 0.5]]))

# %% [markdown] tags=["hint"]
# A motion of one metre *ahead* is a step along x only while the robot faces along x.

# %% [markdown] tags=["hint"]
# `compose(pose, motion)` turns the motion by the heading of the pose and adds it. Which of the
# two comes first matters.

# %% [markdown] tags=["hint"]
# Which pose is the first argument of `compose`, and which motion the second? Each new pose begins
# where the last one ended.


# %% tags=["cases"]
def _drive(n: int) -> Any:
    return lambda rng: (a_pose(rng), np.round(rng.uniform(-1.5, 1.5, (n, 3)), 2))


def _path_drawn(ax: Any, function: Any) -> None:
    """Draw a drive round a bent ring, with its headings."""
    from slamlab import plots

    legs = np.tile([[1.0, 0.0, 0.7], [0.8, 0.2, -0.1], [1.0, -0.1, 0.5]], (6, 1))
    path = np.asarray(function(np.array([1.0, 2.0, 0.4]), legs), float)
    plots.path(ax, path, marker="o", markersize=3)
    for x, y, theta in path:
        ax.plot([x, x + 0.4 * np.cos(theta)], [y, y + 0.4 * np.sin(theta)], color="black", lw=1)
    plots.floor(ax)


check_dead_reckoning = Check(
    dead_reckoning,
    "poses",
    {
        "one step straight ahead": ([0, 0, 0], [[1, 0, 0]]),
        "the robot faces left: forward is up": ([1, 2, np.pi / 2], [[1, 0, 0]]),
        "four legs close a square": ([0, 0, 0.2], [[1, 0, np.pi / 2]] * 4),
        "headings stay wrapped": ([0.0, 0.0, 3.0], [[0.2, 0.0, 0.3], [0.2, 0.0, 0.3]]),
        "no motion at all": ([1.0, 2.0, 0.5], np.zeros((0, 3))),
        "turn and drive": _drive(3),
        "a long way": _drive(12),
    },
    picture=_path_drawn,
)


# %% tags=["mistakes"]
def _turned_by(turn: Function, wrap: Function = wrap_angle) -> Function:
    """Chain motions that are turned by `turn(heading, change of heading)`."""

    def run(start: Array, odometry: Array) -> Array:
        poses = [start]
        for motion in odometry:
            place = poses[-1][:2] + turn(poses[-1][2], motion[2]) @ motion[:2]
            poses.append(np.append(place, wrap(poses[-1][2] + motion[2])))
        return np.array(poses)

    return run


check_dead_reckoning.mistakes = {
    "only the way ahead was added: a motion has a part to the left too": (
        "compose(poses[-1], motion) => compose(poses[-1], motion * [1.0, 0.0, 1.0])"
    ),
    "the motion was added in the world frame: turn it by the heading of the robot first": (
        _turned_by(lambda heading, turn: np.eye(2))
    ),
    "the composition is the wrong way round: the old pose comes first, then the motion": (
        "compose(poses[-1], motion) => compose(motion, poses[-1])"
    ),
    "the first row must be the start: n motions make n + 1 poses": (
        "np.array(poses) => np.array(poses[1:])"
    ),
    "the start was ignored: the path begins at the origin": (
        "np.asarray(start, dtype=float) => np.zeros(3)"
    ),
    "each motion was added to the start: add it to the last pose": "poses[-1] => poses[0]",
    "the heading after the turn was used: the motion is given in the frame before it": (
        _turned_by(lambda heading, turn: rotation(heading + turn))
    ),
    "the heading half-way was used: the motion is given in the frame before it": (
        _turned_by(lambda heading, turn: rotation(heading + turn / 2))
    ),
    "this is the transposed rotation: it turns from the world into the body": (
        _turned_by(lambda heading, turn: rotation(heading).T)
    ),
    "the heading is not wrapped: it must stay in (-pi, pi]": (
        _turned_by(lambda heading, turn: rotation(heading), lambda angle: angle)
    ),
    "only the last pose was returned: expected all of them": "np.array(poses) => poses[-1]",
}

# %% [markdown] tags=["solution"]
# ## Solution 1: dead reckoning
#
# Each motion is given in the frame of the pose before it, so each new pose is the old one
# *composed with* the motion. Composition turns the motion by the old heading, adds it, and adds
# the angles.

# %% [markdown] tags=["solution"]
# The tempting short way, adding up the columns, forgets that *ahead* changes its direction. It
# passes where the robot faces along x or does not move:

# %% active="ipynb" tags=["solution"]
# def added_up(start, odometry):
#     path = np.vstack([start, start + np.cumsum(odometry, axis=0)])
#     path[:, 2] = wrap_angle(path[:, 2])
#     return path
#
# check_dead_reckoning(added_up)

# %% [markdown] tags=["statement"]
# ## Exercise 2: the error of one edge
#
# An edge says: *pose j, seen from pose i, is at z*. By how much do the two poses contradict it?
# Write equation (A) of the chapter. And there is a way without a single rotation of your own:
# `between(a, b)` is pose b seen from pose a. What do you get if you use it twice?


# %% tags=["exercise"]
def edge_error(pose_i: Array, pose_j: Array, z: Array) -> Array:
    """Error of one edge of a pose graph.

    Parameters
    ----------
    pose_i, pose_j : ndarray, shape (3,)
        Poses in the world: x (m), y (m), theta (rad).
    z : ndarray, shape (3,)
        Measured pose of j in the frame of i.

    Returns
    -------
    ndarray, shape (3,)
        [R_z^T (R_i^T (t_j - t_i) - t_z), wrap(theta_j - theta_i - theta_z)]
    """
    seen = rotation(pose_i[2]).T @ (pose_j[:2] - pose_i[:2])
    position = rotation(z[2]).T @ (seen - z[:2])
    return np.append(position, wrap_angle(pose_j[2] - pose_i[2] - z[2]))


# %% active="ipynb" tags=["try"]
# edge_error(np.zeros(3), np.array([2.0, 0.0, 0.1]), np.array([1.0, 0.0, 0.0]))

# %% [markdown] tags=["hint"]
# Two changes of frame, one after the other: from the world into the frame of pose i, then from
# there into the frame that the measurement predicts.

# %% [markdown] tags=["hint"]
# `rotation(theta).T` takes a vector from the world into the frame that is turned by theta.

# %% [markdown] tags=["hint"]
# `predicted = between(pose_i, pose_j)` is pose j seen from pose i. What is `predicted` seen from
# `z`?


# %% tags=["cases"]
def _edge(rng: np.random.Generator) -> Any:
    return a_pose(rng), a_pose(rng), a_pose(rng)


def _perfect(rng: np.random.Generator) -> Any:
    i, j = a_pose(rng), a_pose(rng)
    return i, j, between(i, j)


def _error_drawn(ax: Any, function: Any) -> None:
    """Draw the error of position for poses on a circle, and the error of the heading as ticks."""
    from slamlab import plots

    pose, z = np.array([1.0, 2.0, 0.5]), np.array([1.1, -0.4, 0.7])
    errors = []
    for angle in np.linspace(-np.pi, np.pi, 37):
        other = np.array([3.0 + 0.8 * np.cos(angle), 2.0 + 0.8 * np.sin(angle), 1.0 + angle])
        errors.append(np.asarray(function(pose, other, z), float).reshape(3))
    found = np.array(errors)
    plots.path(ax, found[:, :2], marker="o", markersize=3)
    for x, y, theta in found:
        ax.plot([x, x], [y, y + 0.1 * theta], color=plots.COLOURS["dead_reckoning"], lw=1)
    ax.plot(0, 0, "+", color=plots.COLOURS["truth"], markersize=10)
    ax.set(xlabel="error ahead (m); ticks: heading", ylabel="error to the left (m)")


check_edge_error = Check(
    edge_error,
    "error",
    {
        "a perfect measurement has no error": _perfect,
        "one metre too far, straight ahead": ([0, 0, 0], [2, 0, 0], [1, 0, 0]),
        "a full turn is no error": ([0, 0, 3.0], [1, 0, -3.0], [1, 0, 2 * np.pi - 6.0]),
        "too far to the right, and to the left": lambda rng: (
            [0, 0, 0],
            [1, 0, turn := rng.choice([-0.3, 0.3])],
            [1, 0, turn / 3],
        ),
        "an error of the heading across half a turn, to either side": lambda rng: (
            [0.0, 0.0, -(turn := rng.choice([-2.0, 2.0]))],
            [1.0, 0.5, turn],
            [1.0, 0.0, -0.2 * turn],
        ),
        "the measurement turns": ([1.0, 2.0, 0.5], [2.5, 2.2, 1.4], [1.1, -0.4, 0.7]),
        "a general pair of poses": _edge,
    },
    picture=_error_drawn,
)

# %% tags=["mistakes"]
check_edge_error.mistakes = {
    "the turn lost its sign: an error has one": (
        "np.append(position, wrap_angle(pose_j[2] - pose_i[2] - z[2]))"
        " => np.append(position, np.abs(wrap_angle(pose_j[2] - pose_i[2] - z[2])))"
    ),
    "the turn is in degrees: expected radians": (
        "wrap_angle(pose_j[2] - pose_i[2] - z[2]) => "
        "np.rad2deg(wrap_angle(pose_j[2] - pose_i[2] - z[2]))"
    ),
    "the heading difference is not wrapped: a full turn must not count as an error": (
        "wrap_angle( => ("
    ),
    "R_z^T is missing: the error must be given in the frame that the measurement predicts": (
        "rotation(z[2]).T @  => "
    ),
    "R_i^T is missing: the displacement must be seen from pose i, not from the world": (
        "rotation(pose_i[2]).T @  => "
    ),
    "R_i is transposed the wrong way: R_i^T takes world coordinates into the frame of i": (
        "rotation(pose_i[2]).T => rotation(pose_i[2])"
    ),
    "R_z is transposed the wrong way: expected R_z^T": "rotation(z[2]).T => rotation(z[2])",
    "R_z^T turns the displacement before t_z is taken off: it turns their difference": (
        "rotation(z[2]).T @ (seen - z[:2]) => rotation(z[2]).T @ seen - z[:2]"
    ),
    "R_i^T turns t_j before t_i is taken off: it turns their difference": (
        "rotation(pose_i[2]).T @ (pose_j[:2] - pose_i[:2])"
        " => rotation(pose_i[2]).T @ pose_j[:2] - pose_i[:2]"
    ),
    "t_z is missing: the error is predicted minus measured": "(seen - z[:2]) => seen",
    "the measured turn is missing: the error is predicted minus measured": (
        "- pose_i[2] - z[2] => - pose_i[2]"
    ),
    "the sign is reversed: expected predicted minus measured": (
        lambda i, j, z: -edge_error(i, j, z)
    ),
    "the poses are swapped: z is pose j seen from pose i": (lambda i, j, z: edge_error(j, i, z)),
    "this subtracts poses like vectors: turn the displacement into the frame of pose i": (
        lambda i, j, z: np.append((j - i - z)[:2], wrap_angle((j - i - z)[2]))
    ),
    "this subtracts poses like vectors, and the heading is not wrapped": (
        lambda i, j, z: j - i - z
    ),
    "this is the inverse of the error: z seen from the predicted pose": (
        lambda i, j, z: inverse(edge_error(i, j, z))
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: the error of one edge
#
# Pose j seen from pose i is the prediction; the error is the prediction seen from the
# measurement. Both are the same operation, used twice. So two lines do as well, and their
# rotations and wraps are those of `between`:

# %% active="ipynb" tags=["solution"]
# def by_between(pose_i, pose_j, z):
#     predicted = between(pose_i, pose_j)
#     return between(z, predicted)
#
# check_edge_error(by_between)

# %% [markdown] tags=["solution"]
# Forgetting to wrap fails where $\theta_j - \theta_i - \theta_z$ is more than half a turn as a
# number, and nowhere else. With small errors that happens only where one of the headings, or the
# measured turn, has crossed the angle of 180 degrees. That is how it hides in a program.

# %% active="ipynb" tags=["solution"]
# def unwrapped(pose_i, pose_j, z):
#     seen = rotation(pose_i[2]).T @ (pose_j[:2] - pose_i[:2])
#     return np.append(rotation(z[2]).T @ (seen - z[:2]), pose_j[2] - pose_i[2] - z[2])
#
# check_edge_error(unwrapped)

# %% [markdown] tags=["statement"]
# ## Exercise 3: a lamp in the graph
#
# The vacuum cleaner has a camera, too, and over the kitchen table hangs a lamp. Whenever it sees
# the lamp, it measures its place $z$: so far ahead, so far to the left. The lamp $l$ becomes a
# node of the graph like the poses, with two numbers instead of three, and the edge has the error
#
# $$
# \mathbf e = R_i^\top (l - t_i) - z .
# $$
#
# Gauss-Newton asks how this error changes when the pose moves a little, and when the lamp does:
# two rows (ahead, left) and five columns ($x_i$, $y_i$, $\theta_i$, $l_x$, $l_y$). Derive them;
# (B) of the lesson shows the way, but here nobody has a heading except the robot.


# %% tags=["exercise"]
def lamp_jacobian(pose: Array, lamp: Array) -> Array:
    """Derivative of the error of a lamp seen from a pose.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x (m), y (m), theta (rad) in the world.
    lamp : ndarray, shape (2,)
        In the world (m).

    Returns
    -------
    ndarray, shape (2, 5)
        By x, y and theta of the pose, then by x and y of the lamp.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    into, swing = np.array([[c, s], [-s, c]]), np.array([[-s, c], [-c, -s]])
    return np.column_stack([-into, swing @ (lamp - pose[:2]), into])


# %% active="ipynb" tags=["try"]
# lamp_jacobian(np.zeros(3), np.array([2.0, 1.0]))

# %% [markdown] tags=["hint"]
# With a pencil, the robot at the origin, facing along x, the lamp 2 m ahead: the robot turns a
# little to the left. Where does it see the lamp now, more ahead or behind, to the left or right?

# %% [markdown] tags=["hint"]
# $l$ enters behind one rotation, $t_i$ behind the same with a minus. That is four of the five
# columns.

# %% [markdown] tags=["hint"]
# The third column: differentiate $R_i^\top = \begin{bmatrix}\cos\theta & \sin\theta\\
# -\sin\theta & \cos\theta\end{bmatrix}$ entry by entry, and multiply by $l - t_i$.


# %% tags=["cases"]
def _hung(rng: np.random.Generator) -> Any:
    return a_pose(rng), np.round(rng.uniform(-5, 5, 2), 2)


def _lamp_jacobian_drawn(ax: Any, function: Any) -> None:
    """Draw where a map has the lamp in six steps of Gauss-Newton, and the lamp (star)."""
    from slamlab import plots

    lamp = np.array([2.5, 2.0])
    poses = np.array([[0, 0, 0.6], [2, -0.5, 1.6], [4.5, 0.5, 2.6], [4.0, 3.5, -2.2]])
    z = np.array([rotation(x[2]).T @ (lamp - x[:2]) for x in poses])
    # The map is turned by 20 degrees about the first pose, which is held fixed.
    turned = np.vstack([poses[:1], [compose([0, 0, 0.35], x) for x in poses[1:]]])
    guess, found = np.array([0.5, 3.5]), []
    motions = between(poses[:-1], poses[1:])
    for _ in range(7):
        found.append(guess.copy())
        H, b = np.zeros((14, 14)), np.zeros(14)
        for k, x in enumerate(turned):
            J = np.asarray(function(x, guess), float).reshape(2, 5)
            at = np.r_[3 * k : 3 * k + 3, 12, 13]
            H[np.ix_(at, at)] += 400 * J.T @ J
            b[at] += 400 * J.T @ (rotation(x[2]).T @ (guess - x[:2]) - z[k])
        for k, motion in enumerate(motions):
            e, at = edge_error(turned[k], turned[k + 1], motion), np.r_[3 * k : 3 * k + 6]
            A, back = np.zeros((3, 6)), rotation(motion[2]).T @ rotation(turned[k, 2]).T
            d = turned[k + 1, :2] - turned[k, :2]
            A[:2, :2], A[:2, 3:5], A[:2, 2] = -back, back, back @ [d[1], -d[0]]
            A[2, 2], A[2, 5] = -1.0, 1.0
            H[np.ix_(at, at)] += 100 * A.T @ A
            b[at] += 100 * A.T @ e
        H += 1e-6 * np.eye(14)
        step = np.append(np.zeros(3), np.linalg.solve(H[3:, 3:], -b[3:]))
        turned, guess = turned + step[:12].reshape(4, 3), guess + step[12:]
    ax.plot(*lamp, "*", color=plots.COLOURS["truth"], markersize=13)
    ax.plot(poses[:, 0], poses[:, 1], "o", color=plots.COLOURS["truth"], markersize=4)
    plots.path(ax, np.array(found), marker="o", markersize=4)
    plots.floor(ax)
    ax.set(xlim=(-0.5, 5.5), ylim=(-1.0, 4.5))
    ax.set_title(f"the lamp is off by {np.hypot(*(found[-1] - lamp)):.2f} m")


check_lamp_jacobian = Check(
    lamp_jacobian,
    "J",
    {
        "a robot that faces along x": ([0, 0, 0], [2, 1]),
        "a lamp straight ahead": ([1.0, 2.0, 0.0], [4.0, 2.0]),
        "the robot has turned": ([1.0, 2.0, 0.5], [2.5, 2.2]),
        "far away, where the lever is long": ([0, 0, -2.0], [30, -40]),
        "a lamp above the robot": ([1.0, 2.0, 0.7], [1.0, 2.0]),
        "any pose, any lamp": _hung,
    },
    tolerance=1e-4,
    picture=_lamp_jacobian_drawn,
)

# %% tags=["mistakes"]
check_lamp_jacobian.mistakes = {
    "pose and lamp are exchanged: the pose has the minus": (
        "[-into, swing @ (lamp - pose[:2]), into] => [into, swing @ (lamp - pose[:2]), -into]"
    ),
    "the lamp's columns are the world's: they are turned into the frame of the robot": (
        "(lamp - pose[:2]), into] => (lamp - pose[:2]), np.eye(2)]"
    ),
    "R_i is transposed the wrong way: expected R_i^T": ("[[c, s], [-s, c]] => [[c, -s], [s, c]]"),
    "the third column lacks the lever: turning the robot swings the lamp around it": (
        "swing @ (lamp - pose[:2]) => np.zeros(2)"
    ),
    "the sign of the third column is wrong: turned to the left, the robot sees the lamp further "
    "to the right": "swing @ (lamp => -swing @ (lamp",
    "the third column is not differentiated: R_i^T itself stands there": (
        "swing @ (lamp => into @ (lamp"
    ),
    "the lever is the place of the lamp: it reaches from the robot to the lamp": (
        "(lamp - pose[:2]) => lamp"
    ),
    "the lever was not turned: it is seen from the robot": (
        "swing @ (lamp - pose[:2]) => np.array([[0, 1], [-1, 0]]) @ (lamp - pose[:2])"
    ),
    "the sign of the whole matrix is reversed": lambda *given: -lamp_jacobian(*given),
    "this is the transpose of the Jacobian: rows are errors": (
        lambda *given: lamp_jacobian(*given).T
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a lamp in the graph
#
# $-R_i^\top$, the derivative of $R_i^\top$ times the lever $l - t_i$, and $R_i^\top$. There is no
# $-1$ and no $1$, because a lamp has no heading.

# %% [markdown] tags=["solution"]
# Leaving out the swing sets two entries to zero whose size, together, is the distance of the lamp.
# In the picture the map begins turned by 20 degrees, and the lamp is still off by 0.09 m after six
# steps without the third column (draw it).

# %% active="ipynb" tags=["solution"]
# def without_swing(pose, lamp):
#     J = lamp_jacobian(pose, lamp)
#     J[:, 2] = 0
#     return J
#
# check_lamp_jacobian(without_swing)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a bug to find
#
# One step of Gauss-Newton: every edge adds its $A^\top \Omega A$ to $H$ and its $A^\top \Omega\,
# e$ to $b$, in the rows of its two poses; then $H\,\delta = -b$ is solved, with the first pose
# held fixed. (The lesson's $b$ has the minus already; both are in use.) Started from dead
# reckoning, on its test drive this program stays where it should. In a building it does not. Run
# the check, find the two bugs, repair them.


# %% tags=["exercise"]
def relax(poses: Array, edges: Ints, z: Array, omega: Array) -> Array:
    """Poses after one step of Gauss-Newton, the first pose held fixed.

    Parameters
    ----------
    poses : ndarray, shape (n, 3)
        x (m), y (m), theta (rad).
    edges : ndarray of int, shape (m, 2)
        Each edge says where pose j is seen from pose i: rows (i, j).
    z : ndarray, shape (m, 3)
        What was measured, in the frame of pose i.
    omega : ndarray, shape (m, 3, 3)
        Information of each edge.

    Returns
    -------
    ndarray, shape (n, 3)
        Headings in (-pi, pi].
    """
    n = len(poses)
    H, b = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
    for (i, j), measured, weight in zip(edges, z, omega):
        back, into_i = rotation(measured[2]).T, rotation(poses[i, 2]).T
        d = poses[j, :2] - poses[i, :2]
        turn = wrap_angle(poses[j, 2] - poses[i, 2] - measured[2])
        e = np.append(back @ (into_i @ d - measured[:2]), turn)
        A = np.zeros((3, 6))
        A[:2, :2], A[:2, 3:5] = -back @ into_i, back @ into_i
        A[:2, 2] = back @ into_i @ np.array([d[1], -d[0]])
        A[2, 2], A[2, 5] = -1.0, 1.0
        rows = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        H[np.ix_(rows, rows)] += A.T @ weight @ A
        b[rows] += A.T @ weight @ e
    step = np.zeros(3 * n)
    step[3:] = np.linalg.solve(H[3:, 3:], -b[3:])
    new = poses + step.reshape(n, 3)
    new[:, 2] = wrap_angle(new[:, 2])
    return new


# %% active="ipynb" tags=["stub"]
#     n = len(poses)
#     H, b = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
#     for (i, j), measured, weight in zip(edges, z, omega):
#         back, into_i = rotation(measured[2]).T, rotation(poses[i, 2]).T
#         d = poses[j, :2] - poses[i, :2]
#         turn = poses[j, 2] - poses[i, 2] - measured[2]
#         e = np.append(back @ (into_i @ d - measured[:2]), turn)
#         A = np.zeros((3, 6))              # derivative of e by pose i, then by pose j
#         A[:2, :2], A[:2, 3:5] = -back @ into_i, back @ into_i
#         A[:2, 2] = back @ into_i @ np.array([d[1], -d[0]])
#         A[2, 2], A[2, 5] = -1.0, 1.0
#         rows = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
#         H[np.ix_(rows, rows)] += A.T @ weight @ A
#         b[rows] = A.T @ weight @ e
#     step = np.zeros(3 * n)
#     step[3:] = np.linalg.solve(H[3:, 3:], -b[3:])
#     new = poses + step.reshape(n, 3)
#     new[:, 2] = wrap_angle(new[:, 2])
#     return new

# %% active="ipynb" tags=["try"]
# seen = np.array([[1.0, 0.0, 0.5]])
# relax(np.zeros((2, 3)), np.array([[0, 1]]), seen, np.eye(3)[None]).round(3)

# %% [markdown] tags=["hint"]
# Two poses and one edge pass; one motion measured *twice* fails. What does the second edge do to
# what the first one has written?

# %% [markdown] tags=["hint"]
# Compare the last two lines of the loop: one adds, the other does not.

# %% [markdown] tags=["hint"]
# The second bug needs a robot that faces west: what is -3.1 less 3.1, as a turn?


# %% tags=["cases"]
def _path(rng: np.random.Generator, n: int) -> Array:
    """Draw n poses of a drive that turns to the left and crosses half a turn."""
    motions = np.round(rng.uniform([0.5, -0.2, 0.2], [1.5, 0.2, 0.9], (n - 1, 3)), 2)
    start = np.array([*np.round(rng.uniform(-3, 3, 2), 2), np.round(rng.uniform(1, 2), 2)])
    return dead_reckoning(start, motions)


@drawn
def _graph(rng: np.random.Generator, n: int, extra: int, noise: float = 0.1) -> Any:
    poses = _path(rng, n)
    edges = [(k, k + 1) for k in range(n - 1)]
    edges += [tuple(rng.choice(n, 2, replace=False)) for _ in range(extra)]
    z = np.array([between(poses[i], poses[j]) for i, j in edges])
    poses[1:, :2] += rng.normal(0, noise, (n - 1, 2))
    poses[1:, 2] = wrap_angle(poses[1:, 2] + rng.normal(0, noise, n - 1))
    return poses, edges, z, np.array([10 * a_covariance(rng, 3) for _ in edges])


def _two_readings(rng: np.random.Generator) -> Any:
    """Draw one motion that was measured twice, once well and once badly."""
    poses, _, z, omega = _graph(2, 1)(rng)
    z = np.array([z[0], z[0] + np.round(rng.normal(0, 0.3, 3), 2)])
    return poses, [(0, 1), (0, 1)], z, omega * np.array([1.0, 20.0])[:, None, None]


def _loop() -> tuple[Array, Array, Ints, Array]:
    """Return a true ring, its odometry, which turns too little, and closures with measurements."""
    motions = np.tile([[1.0, 0.0, 2 * np.pi / 16]], (16, 1))
    truth = dead_reckoning(np.zeros(3), motions)
    pairs = np.array([[0, 16], [1, 15], [2, 9]])
    z = np.array([between(truth[i], truth[j]) for i, j in pairs])
    return truth, motions * [1.02, 1.0, 0.9], pairs, z


def _relax_drawn(ax: Any, function: Any) -> None:
    """Draw a ring by odometry and after one step with three closures."""
    from slamlab import plots

    truth, odometry, pairs, z = _loop()
    start = dead_reckoning(np.zeros(3), odometry)
    edges = np.vstack([np.column_stack([np.arange(16), np.arange(16) + 1]), pairs])
    omega = np.array([np.diag([100.0, 100.0, 400.0])] * 16 + [1e4 * np.eye(3)] * 3)
    new = np.asarray(function(start, edges, np.vstack([odometry, z]), omega), float)
    plots.path(ax, truth, "truth")
    plots.path(ax, start, "dead_reckoning")
    plots.path(ax, new.reshape(17, 3), marker="o", markersize=3)
    plots.floor(ax)


check_relax = Check(
    relax,
    "poses",
    {
        "two poses and one edge": _graph(2, 0),
        "poses that contradict no edge stay where they are": _graph(4, 0, 0.0),
        "one motion measured twice, well and badly": _two_readings,
        "a chain of four": _graph(4, 0),
        "a chain with closures, some of them read backwards": _graph(5, 3),
        "three poses, a closure": (
            [[0.0, 0.0, 3.0], [-1.0, 0.1, -3.1], [-2.0, 0.2, -2.9]],
            [(0, 1), (1, 2), (2, 0)],
            [[1.0, 0.0, 0.2], [1.0, 0.0, 0.1], [-2.0, 0.0, -0.35]],
            [4.0 * np.eye(3), 2.0 * np.eye(3), np.eye(3)],
        ),
        "a heading that is corrected past half a turn, to either side": lambda rng: (
            [[0.0, 0.0, 3.0 * (side := rng.choice([-1.0, 1.0]))], [-1.0, 0.0, 3.1 * side]],
            [(0, 1)],
            [[1.0, 0.0, 0.3 * side]],
            [np.eye(3)],
        ),
    },
    tolerance=1e-6,
    picture=_relax_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_relax.mistakes = {
    "all poses moved, the first one too: it is held, and the others move": (
        "step[3:] = np.linalg.solve(H[3:, 3:], -b[3:]) => step = np.linalg.lstsq(H, -b)[0]"
    ),
    "every edge pulls: the last edge of a pose has overwritten what the others said in b": (
        "b[rows] += A.T => b[rows] = A.T"
    ),
    "every edge holds: the last edge of a pose has overwritten the others in H": (
        "H[np.ix_(rows, rows)] += A.T => H[np.ix_(rows, rows)] = A.T"
    ),
    "the heading error is not wrapped: a full turn pulls like a wrong edge": (
        "wrap_angle(poses[j, 2] - poses[i, 2] - measured[2])"
        " => (poses[j, 2] - poses[i, 2] - measured[2])"
    ),
    "the new headings are not wrapped: expected (-pi, pi]": ("wrap_angle(new[:, 2]) => new[:, 2]"),
    "the step goes uphill: H step = -b": "-b[3:] => b[3:]",
    "the information is not used in H: A^T Omega A": "A.T @ weight @ A => A.T @ A",
    "the information is not used in b: A^T Omega e": "A.T @ weight @ e => A.T @ e",
    "the information is not used at all: an edge counts as much as it is sure": (
        "A.T @ weight @ => A.T @"
    ),
    "Omega was inverted: it is an information, no covariance": (
        "A.T @ weight @ => A.T @ np.linalg.inv(weight) @"
    ),
    "the lever is missing: turning pose i swings pose j": (
        "back @ into_i @ np.array([d[1], -d[0]]) => 0.0"
    ),
    "pose j does not move: it has columns in A too": (
        ("A[:2, :2], A[:2, 3:5] = -back @ into_i, back @ into_i => A[:2, :2] = -back @ into_i"),
        ("A[2, 2], A[2, 5] = -1.0, 1.0 => A[2, 2] = -1.0"),
    ),
    "only the step was returned: add it to the poses": "poses + step => 0 * poses + step",
}

# %% [markdown] tags=["solution"]
# ## Solution 4: a bug to find
#
# The first bug: `b[rows] = ...` writes where it must add. In a pose that has two edges the second
# one overwrites what the first one wanted. A chain whose edges contradict nothing does not
# notice, for there all that is written is zero.
# The second bug: the turn between two headings is not wrapped. Started from dead reckoning, the
# first hides until a robot closes a loop, the second until it faces west. The test drive had no
# closure and never faced west.

# %% [markdown] tags=["solution"]
# A mistake of another kind: an $H$ without the information of its edges. The place where its
# steps would end is the right one, for there $b$ is zero whatever $H$ is; the steps have the
# wrong length and the wrong direction. With informations of more than one they overshoot, by 15 m
# where a motion was measured twice:

# %% active="ipynb" tags=["solution"]
# def unweighted(poses, edges, z, omega):
#     n = len(poses)
#     H, b = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
#     for (i, j), measured, weight in zip(edges, z, omega):
#         A, back = np.diag([0.0, 0, -1]) @ np.eye(3, 6), rotation(measured[2]).T
#         A[:2, :3] = back @ lamp_jacobian(poses[i], poses[j, :2])[:, :3]
#         A[:2, 3:5], A[2, 5] = -A[:2, :2], 1.0
#         rows = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
#         H[np.ix_(rows, rows)] += A.T @ A
#         b[rows] += A.T @ weight @ edge_error(poses[i], poses[j], measured)
#     step = np.append(np.zeros(3), np.linalg.solve(H[3:, 3:], -b[3:])).reshape(n, 3)
#     return np.column_stack([(poses + step)[:, :2], wrap_angle((poses + step)[:, 2])])
#
# check_relax(unweighted)

# %% [markdown] tags=["statement"]
# ## Exercise 5: SLAM in ten minutes, yours
#
# Put it together. Dead reckoning gives the first poses; its motions and the closures are the
# edges; steps of `relax` follow until nothing moves any more; and $\chi^2 = \sum e^\top \Omega\,
# e$ over *all* edges says how much contradiction is left. Use your functions from above.
#
# The picture gives your program a small town: 120 poses, one metre apart, and 41 closures. How far
# is the path off in the mean, before and after?


# %% tags=["exercise"]
def slam(
    start: Array, odometry: Array, omega: Array, closures: Ints, z: Array, omega_closure: Array
) -> tuple[Array, float]:
    """Map a drive with closures.

    Parameters
    ----------
    start : ndarray, shape (3,)
        First pose; it stays where it is.
    odometry : ndarray, shape (n, 3)
        Motions, each in the frame of the pose before it (m, m, rad).
    omega : ndarray, shape (3, 3)
        Information of every motion.
    closures : ndarray of int, shape (m, 2)
        Rows (i, j): pose j was seen from pose i. There may be none.
    z : ndarray, shape (m, 3)
        Where it was seen.
    omega_closure : ndarray, shape (3, 3)
        Information of every closure.

    Returns
    -------
    poses : ndarray, shape (n + 1, 3)
        The poses of least chi2, headings in (-pi, pi].
    chi2 : float
    """
    poses, n = dead_reckoning(start, odometry), len(odometry)
    motions = np.column_stack([np.arange(n), np.arange(n) + 1])
    edges, measured = np.vstack([motions, closures]), np.vstack([odometry, z])
    weights = np.array([omega] * n + [omega_closure] * len(closures))
    for _ in range(15):
        poses = relax(poses, edges, measured, weights)
    chi2 = 0.0
    for (i, j), seen, weight in zip(edges, measured, weights):
        e = edge_error(poses[i], poses[j], seen)
        chi2 += e @ weight @ e
    return poses, chi2


# %% active="ipynb" tags=["try"]
# slam(np.zeros(3), np.array([[1.0, 0.0, 0.0]]), np.eye(3), np.array([[1, 0]]),
#      np.array([[-0.9, 0.0, 0.0]]), np.eye(3))

# %% [markdown] tags=["hint"]
# Motion number k is the edge (k, k + 1). Three stacks, in the same order: pairs, measurements,
# informations.

# %% [markdown] tags=["hint"]
# How many steps? Each one is exact only as far as the edges are straight in the headings. Fifteen
# are plenty here; one is not.

# %% [markdown] tags=["hint"]
# `edge_error` knows the poses and the measurement of one edge. Sum over all edges, motions too,
# at the poses that you return.


# %% tags=["cases"]
@drawn
def _ride(rng: np.random.Generator, n: int, closures: int) -> Any:
    truth = _path(rng, n + 1)
    pairs = [rng.choice(n + 1, 2, replace=False) for _ in range(closures)]
    sigma = np.array([0.05, 0.05, 0.03])
    odometry = np.array([between(truth[k], truth[k + 1]) for k in range(n)])
    z = np.reshape([between(truth[i], truth[j]) for i, j in pairs], (closures, 3))
    odometry = np.round(odometry + sigma * rng.standard_normal((n, 3)), 3)
    z = z + sigma / 2 * rng.standard_normal((closures, 3))
    omega = np.linalg.inv(a_covariance(rng, 3, 0.02))
    certain = np.round(rng.uniform(0.5, 2), 2) * (2 / sigma) ** 2
    omega_closure = np.diag(certain) @ np.array([[1, 0.3, 0], [0.3, 1, -0.4], [0, -0.4, 1]])
    omega_closure = (omega_closure + omega_closure.T) / 2
    return truth[0], odometry, omega, np.reshape(pairs, (closures, 2)), z, omega_closure


def _town() -> tuple[Any, ...]:
    """Return a drive through a small town: truth, then the six arguments of `slam`."""
    from slamlab.datasets import manhattan_graph

    town, truth = manhattan_graph(120, 160, np.random.default_rng(19), sigma_heading=0.03)
    n, omega = len(truth) - 1, town.information
    z, pairs = town.measurements, np.array(town.edges[n:])
    return truth, truth[0], np.array(z[:n]), omega[0], pairs, np.array(z[n:]), omega[-1]


def _slam_drawn(ax: Any, function: Any) -> None:
    """Draw a drive through a town: truth (black), dead reckoning (orange), after SLAM (blue)."""
    from slamlab import plots

    truth, *given = _town()
    poses, _ = function(*given)
    found = np.asarray(poses, float).reshape(truth.shape)
    before = dead_reckoning(given[0], given[1])
    plots.path(ax, truth, "truth", linewidth=2.5)
    plots.path(ax, before, "dead_reckoning", linewidth=1)
    plots.path(ax, found, linewidth=1.2)
    plots.floor(ax)
    off = [np.hypot(*(path - truth)[:, :2].T).mean() for path in (before, found)]
    ax.set_title(f"off by {off[0]:.1f} m,\nafter SLAM by {off[1]:.1f} m")


check_slam = Check(
    slam,
    "poses, chi2",
    {
        "without a closure it is dead reckoning": _ride(3, 0),
        "one motion and one closure": _ride(1, 1),
        "a closure at the end": _ride(5, 1),
        "a ride with three closures": _ride(7, 3),
    },
    tolerance=1e-6,
    draws=3,
    picture=_slam_drawn,
)

# %% tags=["mistakes"]
_ADDED = "b[rows] += A.T => b[rows] = A.T"
_WRAPPED = (
    "wrap_angle(poses[j, 2] - poses[i, 2] - measured[2])"
    " => (poses[j, 2] - poses[i, 2] - measured[2])"
)


def _slam_with(steps: int, *bugs: str) -> Function:
    """Return the solution with some steps of a `relax` that has bugs."""
    wrong = check_relax.mistaken(bugs)
    own: Function = check_slam.mistaken(f"range(15) => range({steps})")
    own.__globals__["relax"] = wrong
    return own


check_slam.mistakes = {
    "not converged: take more steps": "range(15) => range(3)",
    "two steps are not enough: the edges bend while the poses turn": "range(15) => range(2)",
    "the closures were not used: they are edges like the others": (
        ("np.vstack([motions, closures]), np.vstack([odometry, z]) => motions, odometry"),
        (
            "weights = np.array([omega] * n + [omega_closure] * len(closures))"
            " => weights = np.array([omega] * n)"
        ),
    ),
    "this is dead reckoning: nothing was relaxed": "range(15) => range(0)",
    "one step is not enough: the edges bend while the poses turn": "range(15) => range(1)",
    "a closure was read backwards: pose j is seen from pose i": (
        "np.vstack([motions, closures]) => np.vstack([motions, closures[:, ::-1]])"
    ),
    "all edges have the information of the odometry: closures have their own": (
        "[omega_closure] * => [omega] *"
    ),
    "all edges have the information of the closures: motions have their own": (
        "[omega] * n => [omega_closure] * n"
    ),
    "chi2 is that of dead reckoning: expected the relaxed poses": (
        "edge_error(poses[i], poses[j], seen)"
        " => edge_error(*dead_reckoning(start, odometry)[[i, j]], seen)"
    ),
    "chi2 lacks the information: e^T Omega e": "e @ weight @ e => e @ e",
    "chi2 is that of the closures alone: the motions are edges too": (
        "zip(edges, measured, weights) => zip(edges[n:], measured[n:], weights[n:])"
    ),
    "chi2 is that of the motions alone: the closures are edges too": (
        "zip(edges, measured, weights) => zip(edges[:n], measured[:n], weights[:n])"
    ),
    "chi2 is that of the last edge: add them all up": "chi2 +=  => chi2 = ",
    "chi2 has no one half in this book": "return poses, chi2 => return poses, chi2 / 2",
    "your `relax` still has a bug of exercise 4: run its check": _slam_with(15, _WRAPPED),
}
for _steps in (10, 15, 20):
    for _what, _bugs in (("a bug", [_ADDED]), ("the bugs", [_ADDED, _WRAPPED])):
        check_slam.mistakes[
            f"your `relax` still has {_what} of exercise 4: run its check ({_steps} steps)"
        ] = _slam_with(_steps, *_bugs)

# %% [markdown] tags=["solution"]
# ## Solution 5: SLAM in ten minutes, yours
#
# Three stacks and a loop. What to notice: nothing in it knows which edge is a motion and which a
# closure. A closure is an edge between poses that are far apart in time, no more.

# %% [markdown] tags=["solution"]
# Now a drive whose truth is known: twice round a square, 24 motions, and five times on the second
# lap the robot recognises a place of the first, one metre or a corner back. If the noise is what
# the informations say, $\chi^2$ is about the number of closures times three, and the mean of
# forty drives lies in a narrow band. The last line comes from reading the closures backwards,
# pose i seen from pose j. (Dead reckoning contradicts none of its own motions: its $\chi^2$ is
# zero and says nothing.)

# %% active="ipynb" tags=["solution"]
# SIGMA, SEEN = np.array([0.05, 0.05, 0.02]), np.array([0.03, 0.03, 0.02])
# CORNERS = np.array([[0, 13], [3, 16], [6, 19], [9, 22], [11, 24]])
#
# def drive(rng):
#     motions = np.tile([[1.0, 0, 0], [1.0, 0, 0], [1.0, 0, np.pi / 2]], (8, 1))
#     truth = dead_reckoning(np.zeros(3), motions)
#     odometry = motions + SIGMA * rng.standard_normal((24, 3))
#     z = np.array([between(truth[i], truth[j]) for i, j in CORNERS])
#     return truth, odometry, z + SEEN * rng.standard_normal(z.shape)
#
# def gap(poses, truth):
#     return np.sqrt(np.mean((poses[:, :2] - truth[:, :2]) ** 2) * 2)

# %% active="ipynb" tags=["solution"]
# rows = {"dead reckoning": [], "slam": [], "closures read backwards": []}
# for seed in range(40):
#     truth, odometry, z = drive(np.random.default_rng(seed))
#     rows["dead reckoning"].append((gap(dead_reckoning(truth[0], odometry), truth), 0.0))
#     given = truth[0], odometry, np.diag(SIGMA**-2)
#     readings = {"slam": CORNERS, "closures read backwards": CORNERS[:, ::-1]}
#     for name, pairs in readings.items():
#         poses, chi2 = slam(*given, pairs, z, np.diag(SEEN**-2))
#         rows[name].append((gap(poses, truth), chi2))
# low, high = chi2_band(15, 40)
# print(f"mean chi2 expected between {low:.1f} and {high:.1f}")
# for name, found in rows.items():
#     error, chi2 = np.mean(found, axis=0)
#     print(f"{name:24s} error {error:.2f} m, mean chi2 {chi2:.3g}")

# %% [markdown] tags=["solution"]
# $\chi^2$ needs no truth: it tells of the closures read backwards without a map to compare with.
# It does not tell of every mistake: the missing lever of chapter 00 hardly raises it.

# %% [markdown] tags=["statement"]
# *What you have now*: a SLAM whose every line is yours, from the first motion to the map, and a
# number, $\chi^2$, that says how much its measurements contradict each other. Any sensor that
# sees one pose from another, or a lamp, may add its edges to it.
#
# The solutions are in [Solutions 00](../solutions/00_slam_in_ten_minutes.ipynb).
