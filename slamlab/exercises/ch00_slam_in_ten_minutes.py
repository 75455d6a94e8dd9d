"""Checks of chapter 00: dead reckoning, the error of one edge, its Jacobian.

The error is that of g2o and Grisetti et al. (2010), as `slamlab.slam.PoseGraph` has it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_pose
from slamlab.exercises._report import Array, Check, Function
from slamlab.geometry import between, compose, inverse, rotation, wrap_angle

__all__ = ["check_dead_reckoning", "check_edge_error", "check_edge_jacobian"]


# Exercise 1: dead reckoning.


def _dead_reckoning(start: Array, odometry: Array) -> Array:
    """Poses (n + 1, 3) from a start (3,) and n relative motions (n, 3) in the body frame."""
    poses = [start.copy()]
    for motion in odometry:
        poses.append(compose(poses[-1], motion))
    return np.array(poses)


def _turned_by(turn: Function, wrap: Function = wrap_angle) -> Function:
    """Chain motions that are turned by `turn(heading, change of heading)`."""

    def run(start: Array, odometry: Array) -> Array:
        poses = [start]
        for motion in odometry:
            place = poses[-1][:2] + turn(poses[-1][2], motion[2]) @ motion[:2]
            poses.append(np.append(place, wrap(poses[-1][2] + motion[2])))
        return np.array(poses)

    return run


def _drive(n: int) -> Any:
    return lambda rng: (a_pose(rng), np.round(rng.uniform(-1.5, 1.5, (n, 3)), 2))


check_dead_reckoning = Check(
    _dead_reckoning,
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
    {
        "the motion was added in the world frame: turn it by the heading of the robot first": (
            _turned_by(lambda heading, turn: np.eye(2))
        ),
        "the composition is the wrong way round: the old pose comes first, then the motion": (
            "compose(poses[-1], motion)",
            "compose(motion, poses[-1])",
        ),
        "the first row must be the start: n motions make n + 1 poses": (
            "np.array(poses)",
            "np.array(poses[1:])",
        ),
        "the start was ignored: the path begins at the origin": (
            "start.copy()",
            "np.zeros(3)",
        ),
        "each motion was added to the start: add it to the last pose": ("poses[-1]", "poses[0]"),
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
        "only the last pose came: all of them are due": ("np.array(poses)", "poses[-1]"),
    },
)


# Exercise 2: the error of one edge.


def _edge_error(pose_i: Array, pose_j: Array, z: Array) -> Array:
    """Error (3,) of a measurement z of pose j seen from pose i: z^-1 (+) (i^-1 (+) j)."""
    seen = rotation(pose_i[2]).T @ (pose_j[:2] - pose_i[:2])
    position = rotation(z[2]).T @ (seen - z[:2])
    return np.append(position, wrap_angle(pose_j[2] - pose_i[2] - z[2]))


def _edge(rng: np.random.Generator) -> Any:
    return a_pose(rng), a_pose(rng), a_pose(rng)


def _perfect(rng: np.random.Generator) -> Any:
    i, j = a_pose(rng), a_pose(rng)
    return i, j, between(i, j)


check_edge_error = Check(
    _edge_error,
    "error",
    {
        "a perfect measurement has no error": _perfect,
        "one metre too far, straight ahead": ([0, 0, 0], [2, 0, 0], [1, 0, 0]),
        "a full turn is no error": ([0, 0, 3.0], [1, 0, -3.0], [1, 0, 2 * np.pi - 6.0]),
        "the measurement turns": ([1.0, 2.0, 0.5], [2.5, 2.2, 1.4], [1.1, -0.4, 0.7]),
        "a general pair of poses": _edge,
    },
    {
        "the heading difference is not wrapped: a full turn must not count as an error": (
            "wrap_angle(",
            "(",
        ),
        "R_z^T is missing: the error must be given in the frame that the measurement predicts": (
            "rotation(z[2]).T @ ",
            "",
        ),
        "R_i^T is missing: the displacement must be seen from pose i, not from the world": (
            "rotation(pose_i[2]).T @ ",
            "",
        ),
        "R_i is transposed the wrong way: R_i^T takes world coordinates into the frame of i": (
            "rotation(pose_i[2]).T",
            "rotation(pose_i[2])",
        ),
        "R_z is transposed the wrong way: R_z^T is due": ("rotation(z[2]).T", "rotation(z[2])"),
        "R_z^T turns the displacement before t_z is taken off: it turns their difference": (
            "rotation(z[2]).T @ (seen - z[:2])",
            "rotation(z[2]).T @ seen - z[:2]",
        ),
        "R_i^T turns t_j before t_i is taken off: it turns their difference": (
            "rotation(pose_i[2]).T @ (pose_j[:2] - pose_i[:2])",
            "rotation(pose_i[2]).T @ pose_j[:2] - pose_i[:2]",
        ),
        "t_z is missing: the error is predicted minus measured": ("(seen - z[:2])", "seen"),
        "the measured turn is missing: the error is predicted minus measured": (
            "- pose_i[2] - z[2]",
            "- pose_i[2]",
        ),
        "the sign is reversed: predicted minus measured is due": (
            lambda i, j, z: -_edge_error(i, j, z)
        ),
        "the poses are swapped: z is pose j seen from pose i": (
            lambda i, j, z: _edge_error(j, i, z)
        ),
        "this subtracts poses like vectors: turn the displacement into the frame of pose i": (
            lambda i, j, z: np.append((j - i - z)[:2], wrap_angle((j - i - z)[2]))
        ),
        "this subtracts poses like vectors, and the heading is not wrapped": (
            lambda i, j, z: j - i - z
        ),
        "this is the inverse of the error: z seen from the predicted pose": (
            lambda i, j, z: inverse(_edge_error(i, j, z))
        ),
    },
)


# Exercise 3: the Jacobian of the error with respect to pose i.


def _edge_jacobian(pose_i: Array, pose_j: Array, z: Array) -> Array:
    """Jacobian (3, 3) of `edge_error` with respect to pose i."""
    c, s = np.cos(pose_i[2]), np.sin(pose_i[2])
    swing = np.array([[-s, c], [-c, -s]])  # d(R_i^T)/d(theta_i)
    back = rotation(z[2]).T
    J = np.zeros((3, 3))
    J[:2, :2] = -back @ rotation(pose_i[2]).T
    J[:2, 2] = back @ swing @ (pose_j[:2] - pose_i[:2])
    J[2, 2] = -1.0
    return J


check_edge_jacobian = Check(
    _edge_jacobian,
    "J",
    {
        "both robots face along x": ([0, 0, 0], [2, 1, 0], [1, 0, 0]),
        "the first robot has turned": ([1.0, 2.0, 0.5], [2.5, 2.2, 1.4], [1.1, 0.0, 0.0]),
        "the measurement turns too": ([1.0, 2.0, 0.5], [2.5, 2.2, 1.4], [1.1, -0.4, 0.7]),
        "far away, where the lever is long": ([0, 0, -2.0], [30, -40, 1.0], [0.3, 0.2, -0.4]),
        "a general pair of poses": _edge,
    },
    {
        "this is the transpose of the Jacobian: rows are errors, columns are x, y, theta": (
            "return J",
            "return J.T",
        ),
        "this is the Jacobian with respect to pose j, not pose i": (
            "= -back",
            "= back",
            "back @ swing @ (pose_j[:2] - pose_i[:2])",
            "0.0",
            "-1.0",
            "1.0",
        ),
        "R_z^T is missing: the error is turned by it, so its derivative is too": (
            "rotation(z[2]).T",
            "np.eye(2)",
        ),
        "R_z is transposed the wrong way: R_z^T is due": ("rotation(z[2]).T", "rotation(z[2])"),
        "R_i is transposed the wrong way: R_i^T is due": (
            "rotation(pose_i[2]).T",
            "rotation(pose_i[2])",
        ),
        "the last column lacks the lever: turning robot i swings pose j around it": (
            "back @ swing @ (pose_j[:2] - pose_i[:2])",
            "0.0",
        ),
        "the sign of the last column is wrong: differentiate R_i^T, not R_i": (
            "back @ swing",
            "-back @ swing",
        ),
        "the last column is not differentiated: R_i^T itself stands there": (
            "[[-s, c], [-c, -s]]",
            "[[c, s], [-s, c]]",
        ),
        "the lever is the place of pose j: it reaches from pose i to pose j": (
            "(pose_j[:2] - pose_i[:2])",
            "pose_j[:2]",
        ),
        "the heading of pose i counts with -1: its error is theta_j - theta_i - theta_z": (
            "-1.0",
            "1.0",
        ),
        "the heading does not change the last error here: it does, one to one": ("-1.0", "0.0"),
        "the sign of the whole matrix is reversed": ("return J", "return -J"),
    },
    tolerance=1e-4,
)
