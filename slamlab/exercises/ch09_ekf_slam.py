"""Checks of chapter 09: the Jacobian with the lever arm, a new landmark's covariance, a wall.

P1 (26)-(29), (43) and the line model that P1's experiment needs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Report, run_cases
from slamlab.geometry import wrap_angle
from slamlab.sensors import RangeBearing, Wall

__all__ = [
    "MISTAKES_ADD_LANDMARK",
    "MISTAKES_JACOBIAN",
    "MISTAKES_WALL",
    "add_landmark",
    "check_add_landmark",
    "check_jacobian",
    "check_wall",
    "jacobian",
    "observe_wall",
]

Function = Callable[..., Any]


# Exercise 1: the derivative of range and bearing by the pose.


def jacobian(pose: Array, landmark: Array, L: Array) -> Array:
    """Differentiate range and bearing by the pose, (2, 3); the sensor stands L ahead."""
    return RangeBearing(1.0, 1.0, offset=float(L)).jacobians(pose, landmark)[0]


def _pieces(pose: Array, landmark: Array, L: Array) -> tuple[Any, ...]:
    """Return c, s, p (centre minus landmark) and d (sensor minus landmark)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    p = np.asarray(pose)[:2] - landmark
    return c, s, p, p + float(L) * np.array([c, s])


def _from_centre(pose: Array, landmark: Array, L: Array) -> Array:
    return jacobian(pose, landmark, np.array(0.0))


def _centre_in_bearing(pose: Array, landmark: Array, L: Array) -> Array:
    _, _, p, d = _pieces(pose, landmark, L)
    H = jacobian(pose, landmark, L)
    H[1, :2] = [-p[1] / (d @ d), p[0] / (d @ d)]
    return H


def _range_without_lever(pose: Array, landmark: Array, L: Array) -> Array:
    c, s, p, d = _pieces(pose, landmark, L)
    H = jacobian(pose, landmark, L)
    H[0, 2] = (p[1] * c - p[0] * s) / np.hypot(*d)
    return H


def _wrong_derivative_of_cosine(pose: Array, landmark: Array, L: Array) -> Array:
    c, s, p, d = _pieces(pose, landmark, L)
    H = jacobian(pose, landmark, L)
    H[1, 2] = (p[0] * c - p[1] * s + L * np.cos(2 * pose[2])) * L / (d @ d) - 1
    return H


def _without_own_turn(pose: Array, landmark: Array, L: Array) -> Array:
    H = jacobian(pose, landmark, L)
    H[1, 2] += 1
    return H


def _without_square(pose: Array, landmark: Array, L: Array) -> Array:
    _, _, _, d = _pieces(pose, landmark, L)
    H = jacobian(pose, landmark, L)
    H[1, :2] *= np.hypot(*d)
    return H


MISTAKES_JACOBIAN: dict[str, Function] = {
    "the sensor was put at the centre: it stands L ahead": _from_centre,
    "C and D use the centre: the bearing is measured from the sensor, (26) and (27)": (
        _centre_in_bearing
    ),
    "E lacks its factor L, (28): without a lever, turning on the spot changes no range": (
        _range_without_lever
    ),
    "F has the derivative of the cosine as plus the sine, as (29) is printed": (
        _wrong_derivative_of_cosine
    ),
    "F lacks its -1: a turn of the robot is taken off every bearing": _without_own_turn,
    "C and D are divided by the distance: its square is due": _without_square,
    "all signs are reversed: this is the derivative by the landmark, or d points the other way": (
        lambda pose, landmark, L: -jacobian(pose, landmark, L)
    ),
    "this is the transpose: rows are range and bearing, columns x, y and heading": (
        lambda pose, landmark, L: jacobian(pose, landmark, L).T
    ),
}


def check_jacobian(student: Function) -> Report:
    """Check ``student(pose (3,), landmark (2,), L) -> H_pose (2, 3)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("no lever: the range does not care about the heading", [0, 0, 0.5], [3, 1], 0.0),
        ("a lever, a landmark ahead", [0.2, -0.4, 0.3], [4, 1], 0.3),
        ("a landmark to the left", [1, 2, -0.7], [2, 5], 0.3),
        ("a landmark behind", [1, 2, 2.5], [4, -1], 0.5),
        ("a long lever", [-1, 0.5, 1.2], [1.5, 3], 1.5),
    ]
    return run_cases("jacobian", student, jacobian, cases, MISTAKES_JACOBIAN)


# Exercise 2: the covariance after a landmark was added.


def add_landmark(P: Array, G_pose: Array, G_z: Array, R: Array) -> Array:
    """Covariance (n + 2, n + 2) after a landmark was added to one of (n, n), P1 (43)."""
    cross = G_pose @ P[:3, :]
    own = G_pose @ P[:3, :3] @ G_pose.T + G_z @ R @ G_z.T
    return np.block([[P, cross.T], [cross, own]])


def _assembled(P: Array, cross: Array, own: Array) -> Array:
    return np.block([[P, cross.T], [cross, own]])


def _own(P: Array, G_pose: Array, G_z: Array, R: Array) -> Array:
    return G_pose @ P[:3, :3] @ G_pose.T + G_z @ R @ G_z.T


def _without_ties(P: Array, G_pose: Array, G_z: Array, R: Array) -> Array:
    return _assembled(P, np.zeros((2, len(P))), _own(P, G_pose, G_z, R))


def _tied_to_the_pose_only(P: Array, G_pose: Array, G_z: Array, R: Array) -> Array:
    cross = np.zeros((2, len(P)))
    cross[:, :3] = G_pose @ P[:3, :3]
    return _assembled(P, cross, _own(P, G_pose, G_z, R))


def _without_sensor(P: Array, G_pose: Array, G_z: Array, R: Array) -> Array:
    return _assembled(P, G_pose @ P[:3, :], G_pose @ P[:3, :3] @ G_pose.T)


def _without_robot(P: Array, G_pose: Array, G_z: Array, R: Array) -> Array:
    return _assembled(P, G_pose @ P[:3, :], G_z @ R @ G_z.T)


def _bare_noise(P: Array, G_pose: Array, G_z: Array, R: Array) -> Array:
    return _assembled(P, G_pose @ P[:3, :], G_pose @ P[:3, :3] @ G_pose.T + R)


def _turned_noise(P: Array, G_pose: Array, G_z: Array, R: Array) -> Array:
    own = G_pose @ P[:3, :3] @ G_pose.T + G_z.T @ R @ G_z
    return _assembled(P, G_pose @ P[:3, :], own)


MISTAKES_ADD_LANDMARK: dict[str, Function] = {
    "the new landmark is tied to nothing: the blocks beside it are G_pose P[:3, :]": _without_ties,
    "it is tied to the pose but not to the old landmarks: use all columns of P[:3, :]": (
        _tied_to_the_pose_only
    ),
    "the sensor's noise is missing: add G_z R G_z^T": _without_sensor,
    "the robot's doubt is missing: add G_pose P_p G_pose^T": _without_robot,
    "R is in metres and radians, the map in metres: it goes through G_z": _bare_noise,
    "the noise went through G_z from the wrong side: G_z R G_z^T": _turned_noise,
    "the covariance has not grown: two rows and two columns come in": (
        lambda P, G_pose, G_z, R: np.array(P)
    ),
}


def check_add_landmark(student: Function) -> Report:
    """Check ``student(P (n, n), G_pose (2, 3), G_z (2, 2), R (2, 2)) -> P (n + 2, n + 2)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    root = np.random.default_rng(9).standard_normal((7, 7))
    known = root @ root.T
    sensor = RangeBearing(0.1, 0.03, offset=0.3)
    pose, z = np.array([1.0, 2.0, 0.6]), np.array([3.0, -0.8])
    G_pose, G_z = sensor.locate_jacobians(pose, z)
    cases = [
        ("the first landmark, from a pose in doubt", known[:3, :3], G_pose, G_z, sensor.cov),
        ("from a pose without doubt", np.zeros((3, 3)), G_pose, G_z, sensor.cov),
        ("the third landmark", known, G_pose, G_z, sensor.cov),
    ]
    return run_cases("add_landmark", student, add_landmark, cases, MISTAKES_ADD_LANDMARK)


# Exercise 3: a wall.


def observe_wall(pose: Array, wall: Array, L: Array) -> Array:
    """Distance and direction (2,) of the wall (r, alpha) as the sensor sees it, r >= 0."""
    return Wall(1.0, 1.0, offset=float(L)).observe(pose, wall)


def _signed(pose: Array, wall: Array, L: Array) -> tuple[float, float]:
    """Distance with its sign, and direction of the normal, from a sensor L ahead."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + L * c, pose[1] + L * s
    r, alpha = wall
    return float(r - x * np.cos(alpha) - y * np.sin(alpha)), float(alpha - pose[2])


def _named(distance: float, angle: float) -> Array:
    """Give the line the name that has a distance >= 0."""
    turn = np.pi if distance < 0 else 0.0
    return np.array([abs(distance), wrap_angle(angle + turn)])


def _wall_from_centre(pose: Array, wall: Array, L: Array) -> Array:
    return _named(*_signed(pose, wall, np.array(0.0)))


def _wall_in_the_world(pose: Array, wall: Array, L: Array) -> Array:
    distance, angle = _signed(pose, wall, L)
    return _named(distance, angle + pose[2])


def _negative_distance(pose: Array, wall: Array, L: Array) -> Array:
    distance, angle = _signed(pose, wall, L)
    return np.array([distance, wrap_angle(angle)])


def _turned_only_the_distance(pose: Array, wall: Array, L: Array) -> Array:
    distance, angle = _signed(pose, wall, L)
    return np.array([abs(distance), wrap_angle(angle)])


def _not_wrapped(pose: Array, wall: Array, L: Array) -> Array:
    distance, angle = _signed(pose, wall, L)
    return np.array([abs(distance), angle + (np.pi if distance < 0 else 0.0)])


def _wrong_side(pose: Array, wall: Array, L: Array) -> Array:
    distance, angle = _signed(pose, wall, L)
    return _named(2 * wall[0] - distance, angle)


MISTAKES_WALL: dict[str, Function] = {
    "measured from the centre: the sensor stands L ahead": _wall_from_centre,
    "the direction is that in the world: take the heading off": _wall_in_the_world,
    "the sensor's place was added: r - (x_s cos(alpha) + y_s sin(alpha))": _wrong_side,
    "a distance is negative: the same line is (-r, alpha + pi)": _negative_distance,
    "the distance was made positive, its direction was not turned by pi": (
        _turned_only_the_distance
    ),
    "the direction is not wrapped to (-pi, pi]": _not_wrapped,
}


def check_wall(student: Function) -> Report:
    """Check ``student(pose (3,), wall (2,), L) -> (distance, direction)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("a wall ahead", [0.5, 0, 0], [3, 0], 0.3),
        ("a wall at an angle, the robot turned", [1, 2, 0.4], [4, 1.1], 0.3),
        ("the robot beyond the wall's line: another name", [4, 1, 0.5], [2, 0.2], 0.3),
        ("a direction that crosses half a turn", [1, -1, -2.5], [3, 2.5], 0.4),
    ]
    return run_cases("observe_wall", student, observe_wall, cases, MISTAKES_WALL)
