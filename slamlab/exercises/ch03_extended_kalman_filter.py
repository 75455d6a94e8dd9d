"""Checks of chapter 03: a range-bearing prediction, its innovation and its Jacobian.

The measurement is that of P1 (18) for a sensor in the centre of the robot (L = 0), with the
bearing repaired; P5 (11) and (13) are the innovation and the Jacobian of the extended filter.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._report import Report, run_cases
from slamlab.geometry import wrap_angle

__all__ = [
    "MISTAKES_INNOVATION",
    "MISTAKES_JACOBIAN",
    "MISTAKES_RANGE_BEARING",
    "check_innovation",
    "check_jacobian",
    "check_range_bearing",
    "innovation",
    "jacobian",
    "range_bearing",
]

Function = Callable[..., Any]


def _offsets(pose: Array, landmark: Array) -> tuple[Any, Any]:
    return landmark[0] - pose[0], landmark[1] - pose[1]


# Exercise 1: the predicted measurement.


def range_bearing(pose: Array, landmark: Array) -> Array:
    """Range (m) and bearing (rad), shape (2,), of a landmark (2,) seen from a pose (3,)."""
    dx, dy = _offsets(pose, landmark)
    return np.array([np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - pose[2])])


def _bearing(function: Function) -> Function:
    def wrong(pose: Array, landmark: Array) -> Array:
        dx, dy = _offsets(pose, landmark)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.array([np.hypot(dx, dy), function(dx, dy, pose[2])])

    return wrong


MISTAKES_RANGE_BEARING: dict[str, Function] = {
    "the bearing is not wrapped: it must lie in (-pi, pi]": _bearing(
        lambda dx, dy, t: np.arctan2(dy, dx) - t
    ),
    "arctan(dy/dx) loses the quadrant: a landmark behind appears in front; use arctan2": _bearing(
        lambda dx, dy, t: wrap_angle(np.arctan(dy / dx) - t)
    ),
    "the fraction is upside down, as P1 prints (18): arctan2 takes dy first": _bearing(
        lambda dx, dy, t: wrap_angle(np.arctan2(dx, dy) - t)
    ),
    "the heading is missing: a bearing is measured from where the robot faces": _bearing(
        lambda dx, dy, t: np.arctan2(dy, dx)
    ),
    "the heading is added: it must be subtracted": _bearing(
        lambda dx, dy, t: wrap_angle(np.arctan2(dy, dx) + t)
    ),
    "the direction is reversed: from the robot to the landmark, not back": _bearing(
        lambda dx, dy, t: wrap_angle(np.arctan2(-dy, -dx) - t)
    ),
    "the range is squared: take the square root": (lambda p, m: range_bearing(p, m) ** [2, 1]),
    "the bearing is in degrees: radians are due": (
        lambda p, m: range_bearing(p, m) * [1, 180 / np.pi]
    ),
}


def check_range_bearing(student: Function) -> Report:
    """Check ``student(pose (3,), landmark (2,)) -> [range, bearing]``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("three ahead, four to the left", [0, 0, 0], [3, 4]),
        ("the robot has turned", [1.0, 2.0, 0.6], [4.0, 3.0]),
        ("the landmark is behind", [1.0, 2.0, 0.4], [-2.0, 1.0]),
        ("across the back: the bearing stays wrapped", [0.0, 0.0, 3.0], [-4.0, -1.0]),
    ]
    return run_cases("range_bearing", student, range_bearing, cases, MISTAKES_RANGE_BEARING)


# Exercise 2: the innovation.


def innovation(z: Array, predicted: Array) -> Array:
    """Measured minus predicted range and bearing, shape (2,), the bearing wrapped."""
    return np.array([z[0] - predicted[0], wrap_angle(z[1] - predicted[1])])


MISTAKES_INNOVATION: dict[str, Function] = {
    "the bearing is off by 2 pi: wrap the difference": lambda z, p: np.subtract(z, p),
    "the sign is reversed: measured minus predicted is due": lambda z, p: innovation(p, z),
    "the range was wrapped too: only the bearing is an angle": (
        lambda z, p: wrap_angle(np.subtract(z, p))
    ),
    "the bearings were wrapped before the subtraction: wrap the difference itself": (
        lambda z, p: np.array([z[0] - p[0], wrap_angle(z[1]) - wrap_angle(p[1])])
    ),
    "the absolute difference loses its sign: the filter must know which way to turn": (
        lambda z, p: np.abs(innovation(z, p))
    ),
    "wrapped to [0, 2 pi): a small turn to the right must be a small negative number": (
        lambda z, p: np.array([z[0] - p[0], (z[1] - p[1]) % (2 * np.pi)])
    ),
}


def check_innovation(student: Function) -> Report:
    """Check ``student(z (2,), predicted (2,)) -> innovation (2,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("a plain difference", [5.0, 0.3], [4.8, 0.2]),
        ("negative differences stay negative", [4.0, 0.1], [4.8, 0.25]),
        ("across the back, to the left", [5.0, -3.1], [5.0, 3.1]),
        ("across the back, to the right", [9.0, 3.1], [5.0, -3.0]),
        ("a full turn changes nothing", [5.0, 0.3 + 2 * np.pi], [4.8, 0.2]),
    ]
    return run_cases("innovation", student, innovation, cases, MISTAKES_INNOVATION)


# Exercise 3: the Jacobian.


def jacobian(pose: Array, landmark: Array) -> Array:
    """Jacobian (2, 3) of `range_bearing` with respect to the pose."""
    dx, dy = _offsets(pose, landmark)
    q = dx**2 + dy**2
    r = np.sqrt(q)
    return np.array([[-dx / r, -dy / r, 0.0], [dy / q, -dx / q, -1.0]])


def _by_range(pose: Array, landmark: Array) -> Array:
    r = range_bearing(pose, landmark)[0]
    return jacobian(pose, landmark) * [[1, 1, 1], [r, r, 1]]


MISTAKES_JACOBIAN: dict[str, Function] = {
    "this is the transpose: rows are range and bearing, columns are x, y, theta": (
        lambda p, m: jacobian(p, m).T
    ),
    "this is the Jacobian by the landmark's position: the pose moves the other way": (
        lambda p, m: jacobian(p, m) * [-1, -1, 1]
    ),
    "the last column is zero: turning the robot changes the bearing one to one": (
        lambda p, m: jacobian(p, m) * [1, 1, 0]
    ),
    "the sign of the heading column is wrong: turn left and the landmark moves right": (
        lambda p, m: jacobian(p, m) * [1, 1, -1]
    ),
    "the bearing row must be divided by the range squared, not by the range": _by_range,
    "the signs of the bearing row are exchanged, as in P1 (26), (27)": (
        lambda p, m: jacobian(p, m) * [[1, 1, 1], [-1, -1, 1]]
    ),
}


def check_jacobian(student: Function) -> Report:
    """Check ``student(pose (3,), landmark (2,)) -> Jacobian (2, 3)`` of the prediction.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("straight ahead", [0, 0, 0], [2, 0]),
        ("ahead and to the left", [1.0, 2.0, 0.6], [4.0, 6.0]),
        ("behind, far away", [1.0, 2.0, -2.0], [-20.0, -13.0]),
        ("close by, where the bearing is quick", [0.0, 0.0, 1.0], [0.2, -0.1]),
    ]
    return run_cases("jacobian", student, jacobian, cases, MISTAKES_JACOBIAN)
