"""Checks of chapter 00: dead reckoning, the error of one edge, its Jacobian.

The error is that of g2o and Grisetti et al. (2010), as `slamlab.slam.PoseGraph` has it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Report, run_cases
from slamlab.geometry import between, compose, inverse, rotation, wrap_angle

__all__ = [
    "MISTAKES_DEAD_RECKONING",
    "MISTAKES_EDGE_ERROR",
    "MISTAKES_EDGE_JACOBIAN",
    "check_dead_reckoning",
    "check_edge_error",
    "check_edge_jacobian",
    "dead_reckoning",
    "edge_error",
    "edge_jacobian",
]

Function = Callable[..., Any]


# Exercise 1: dead reckoning.


def dead_reckoning(start: Array, odometry: Array) -> Array:
    """Poses (n + 1, 3) from a start (3,) and n relative motions (n, 3) in the body frame."""
    poses = [np.asarray(start, dtype=float)]
    for motion in odometry:
        poses.append(compose(poses[-1], motion))
    return np.array(poses)


def _chain(step: Function, keep_start: bool = True) -> Function:
    def run(start: Array, odometry: Array) -> Array:
        poses = [np.asarray(start, dtype=float)]
        for motion in odometry:
            poses.append(step(poses[-1], np.asarray(motion, dtype=float)))
        return np.array(poses if keep_start else poses[1:])

    return run


def _add_in_world(pose: Array, motion: Array) -> Array:
    return np.append(pose[:2] + motion[:2], wrap_angle(pose[2] + motion[2]))


def _turn_first(pose: Array, motion: Array) -> Array:
    heading = pose[2] + motion[2]
    return np.append(pose[:2] + rotation(heading) @ motion[:2], wrap_angle(heading))


def _turn_back(pose: Array, motion: Array) -> Array:
    return np.append(pose[:2] + rotation(pose[2]).T @ motion[:2], wrap_angle(pose[2] + motion[2]))


def _never_wraps(pose: Array, motion: Array) -> Array:
    return np.append(pose[:2] + rotation(pose[2]) @ motion[:2], pose[2] + motion[2])


MISTAKES_DEAD_RECKONING: dict[str, Function] = {
    "the motion was added in the world frame: turn it by the heading of the robot first": _chain(
        _add_in_world
    ),
    "the composition is the wrong way round: the old pose comes first, then the motion": _chain(
        lambda pose, motion: compose(motion, pose)
    ),
    "the first row must be the start: n motions make n + 1 poses": _chain(
        compose, keep_start=False
    ),
    "the start was ignored: the path begins at the origin": (
        lambda start, odometry: dead_reckoning(np.zeros(3), odometry)
    ),
    "the heading after the turn was used: the motion is given in the frame before it": _chain(
        _turn_first
    ),
    "this is the transposed rotation: it turns from the world into the body": _chain(_turn_back),
    "the heading is not wrapped: it must stay in (-pi, pi]": _chain(_never_wraps),
}


def check_dead_reckoning(student: Function) -> Report:
    """Check ``student(start (3,), odometry (n, 3)) -> poses (n + 1, 3)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("one step straight ahead", [0, 0, 0], [[1, 0, 0]]),
        ("the robot faces left: forward is up", [1, 2, np.pi / 2], [[1, 0, 0]]),
        ("turn and drive", [2.0, -1.0, 0.3], [[1.0, 0.1, 0.4], [0.5, 0.2, -0.9]]),
        ("four legs close a square", [0, 0, 0.2], [[1, 0, np.pi / 2]] * 4),
        ("headings stay wrapped", [0.0, 0.0, 3.0], [[0.2, 0.0, 0.3], [0.2, 0.0, 0.3]]),
    ]
    return run_cases("dead_reckoning", student, dead_reckoning, cases, MISTAKES_DEAD_RECKONING)


# Exercise 2: the error of one edge.


def edge_error(pose_i: Array, pose_j: Array, z: Array) -> Array:
    """Error (3,) of a measurement z of pose j seen from pose i: z^-1 (+) (i^-1 (+) j)."""
    return between(z, between(pose_i, pose_j))


def _error(
    turn_i: Function = lambda i: rotation(i[2]).T,
    turn_z: Function = lambda z: rotation(z[2]).T,
    wrap: Function = wrap_angle,
) -> Function:
    def error(pose_i: Array, pose_j: Array, z: Array) -> Array:
        i, j, z = (np.asarray(a, dtype=float) for a in (pose_i, pose_j, z))
        position = turn_z(z) @ (turn_i(i) @ (j[:2] - i[:2]) - z[:2])
        return np.append(position, wrap(j[2] - i[2] - z[2]))

    return error


def _no_turn(_: Array) -> Array:
    return np.eye(2)


def _difference(i: Array, j: Array, z: Array) -> Array:
    return np.asarray(j, dtype=float) - i - z


MISTAKES_EDGE_ERROR: dict[str, Function] = {
    "the heading difference is not wrapped: a full turn must not count as an error": _error(
        wrap=lambda a: a
    ),
    "R_z^T is missing: the error must be given in the frame that the measurement predicts": (
        _error(turn_z=_no_turn)
    ),
    "R_i^T is missing: the displacement must be seen from pose i, not from the world": (
        _error(turn_i=_no_turn)
    ),
    "R_i is transposed the wrong way: R_i^T takes world coordinates into the frame of i": (
        _error(turn_i=lambda i: rotation(i[2]))
    ),
    "the sign is reversed: predicted minus measured is due": (
        lambda i, j, z: -edge_error(i, j, z)
    ),
    "the poses are swapped: z is pose j seen from pose i": (
        lambda i, j, z: between(z, between(j, i))
    ),
    "this subtracts poses like vectors: turn the displacement into the frame of pose i": (
        _difference
    ),
    "this is the inverse of the error: z seen from the predicted pose": (
        lambda i, j, z: inverse(edge_error(i, j, z))
    ),
}


def check_edge_error(student: Function) -> Report:
    """Check ``student(pose_i (3,), pose_j (3,), z (3,)) -> error (3,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    i, j = np.array([1.0, 2.0, 0.5]), np.array([2.5, 2.2, 1.4])
    shift = np.array([-3.0, 4.0, 2.1])
    z = between(i, j)
    off = np.array([1.1, -0.4, 0.7])
    cases = [
        ("a perfect measurement has no error", i, j, z),
        ("one metre too far, straight ahead", [0, 0, 0], [2, 0, 0], [1, 0, 0]),
        ("a general pair of poses", i, j, off),
        ("moving the whole world changes nothing", compose(shift, i), compose(shift, j), off),
        ("a full turn is no error", [0, 0, 3.0], [1, 0, -3.0], [1, 0, 2 * np.pi - 6.0]),
    ]
    return run_cases("edge_error", student, edge_error, cases, MISTAKES_EDGE_ERROR)


# Exercise 3: the Jacobian of the error with respect to pose i.


def edge_jacobian(pose_i: Array, pose_j: Array, z: Array) -> Array:
    """Jacobian (3, 3) of `edge_error` with respect to pose i."""
    return _jacobian(pose_i, pose_j, z, rotation(np.asarray(z, dtype=float)[2]).T)


def _jacobian(pose_i: Array, pose_j: Array, z: Array, turn_z: Array, sign: float = 1.0) -> Array:
    i, j = np.asarray(pose_i, dtype=float), np.asarray(pose_j, dtype=float)
    c, s = np.cos(i[2]), np.sin(i[2])
    # d(R_i^T)/d(theta_i): the derivative of the transposed rotation.
    turned = np.array([[-s, c], [-c, -s]])
    J = np.zeros((3, 3))
    J[:2, :2] = -turn_z @ rotation(i[2]).T
    J[:2, 2] = sign * turn_z @ turned @ (j[:2] - i[:2])
    J[2, 2] = -1.0
    return J


def _without_lever(i: Array, j: Array, z: Array) -> Array:
    J = edge_jacobian(i, j, z)
    J[:2, 2] = 0.0
    return J


def _with_respect_to_j(i: Array, j: Array, z: Array) -> Array:
    J = np.zeros((3, 3))
    J[:2, :2] = -edge_jacobian(i, j, z)[:2, :2]
    J[2, 2] = 1.0
    return J


MISTAKES_EDGE_JACOBIAN: dict[str, Function] = {
    "this is the transpose of the Jacobian: rows are errors, columns are x, y, theta": (
        lambda i, j, z: edge_jacobian(i, j, z).T
    ),
    "this is the Jacobian with respect to pose j, not pose i": _with_respect_to_j,
    "R_z^T is missing: the error is turned by it, so its derivative is too": (
        lambda i, j, z: _jacobian(i, j, z, np.eye(2))
    ),
    "the last column lacks the lever: turning robot i swings pose j around it": _without_lever,
    "the sign of the last column is wrong: differentiate R_i^T, not R_i": (
        lambda i, j, z: _jacobian(i, j, z, rotation(np.asarray(z, dtype=float)[2]).T, sign=-1.0)
    ),
    "the sign of the whole matrix is reversed": lambda i, j, z: -edge_jacobian(i, j, z),
}


def check_edge_jacobian(student: Function) -> Report:
    """Check ``student(pose_i (3,), pose_j (3,), z (3,)) -> Jacobian (3, 3)`` of the edge error.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("both robots face along x", [0, 0, 0], [2, 1, 0], [1, 0, 0]),
        ("the first robot has turned", [1.0, 2.0, 0.5], [2.5, 2.2, 1.4], [1.1, 0.0, 0.0]),
        ("the measurement turns too", [1.0, 2.0, 0.5], [2.5, 2.2, 1.4], [1.1, -0.4, 0.7]),
        ("far away, where the lever is long", [0, 0, -2.0], [30, -40, 1.0], [0.3, 0.2, -0.4]),
    ]
    return run_cases("edge_jacobian", student, edge_jacobian, cases, MISTAKES_EDGE_JACOBIAN)
