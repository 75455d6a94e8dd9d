"""Checks of chapter 03: a range-bearing prediction, its innovation and its Jacobian.

The measurement is that of P1 (18) for a sensor in the centre of the robot (L = 0), with the
bearing repaired; P5 (11) and (13) are the innovation and the Jacobian of the extended filter.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_pose, an_angle
from slamlab.exercises._report import Array, Check
from slamlab.geometry import wrap_angle

__all__ = ["check_innovation", "check_jacobian", "check_range_bearing"]


def _scene(rng: np.random.Generator) -> Any:
    return a_pose(rng), np.round(rng.uniform(-6, 6, 2), 2)


# Exercise 1: the predicted measurement.


def _range_bearing(pose: Array, landmark: Array) -> Array:
    """Range (m) and bearing (rad), shape (2,), of a landmark (2,) seen from a pose (3,)."""
    dx, dy = landmark - pose[:2]
    return np.array([np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - pose[2])])


check_range_bearing = Check(
    _range_bearing,
    "measurement",
    {
        "three ahead, four to the left": ([0, 0, 0], [3, 4]),
        "the robot has turned": ([1.0, 2.0, 0.6], [4.0, 3.0]),
        "the landmark is behind": ([1.0, 2.0, 0.4], [-2.0, 1.0]),
        "straight behind: pi, not -pi": ([0.0, 0.0, -np.pi / 2], [0.0, 3.0]),
        "across the back: the bearing stays wrapped": ([0.0, 0.0, 3.0], [-4.0, -1.0]),
        "anywhere": _scene,
    },
    {
        "the bearing is not wrapped: it must lie in (-pi, pi]": (
            "wrap_angle(np.arctan2(dy, dx) - pose[2])",
            "np.arctan2(dy, dx) - pose[2]",
        ),
        "the bearing was wrapped to [0, 2 pi): it must lie in (-pi, pi]": (
            "wrap_angle(np.arctan2(dy, dx) - pose[2])",
            "(np.arctan2(dy, dx) - pose[2]) % (2 * np.pi)",
        ),
        "arctan(dy/dx) loses the quadrant: a landmark behind appears in front; use arctan2": (
            "arctan2(dy, dx)",
            "arctan(dy / dx)",
        ),
        "the fraction is upside down, as P1 prints (18): arctan2 takes dy first": (
            "arctan2(dy, dx)",
            "arctan2(dx, dy)",
        ),
        "the heading is missing: a bearing is measured from where the robot faces": (
            " - pose[2]",
            "",
        ),
        "the heading is added: it must be subtracted": (" - pose[2]", " + pose[2]"),
        "the direction is reversed: from the robot to the landmark, not back": (
            "landmark - pose[:2]",
            "pose[:2] - landmark",
        ),
        "the range is squared: take the square root": ("np.hypot(dx, dy)", "dx**2 + dy**2"),
        "the range is the sum of the sides: take the root of the sum of their squares": (
            "np.hypot(dx, dy)",
            "abs(dx) + abs(dy)",
        ),
        "the bearing is in degrees: radians are due": (
            "wrap_angle(np.arctan2(dy, dx) - pose[2])",
            "np.rad2deg(wrap_angle(np.arctan2(dy, dx) - pose[2]))",
        ),
        "the robot's own place was forgotten: measure from where it stands": (
            "landmark - pose[:2]",
            "landmark",
        ),
        "bearing and range are exchanged: the range comes first": (
            lambda pose, landmark: _range_bearing(pose, landmark)[::-1]
        ),
    },
)


# Exercise 2: the innovation.


def _innovation(z: Array, predicted: Array) -> Array:
    """Measured minus predicted range and bearing, shape (2,), the bearing wrapped."""
    return np.array([z[0] - predicted[0], wrap_angle(z[1] - predicted[1])])


def _bearings(rng: np.random.Generator) -> Any:
    return [rng.integers(1, 9), an_angle(rng)], [rng.integers(1, 9), an_angle(rng)]


check_innovation = Check(
    _innovation,
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
    {
        "the bearing is off by 2 pi: wrap the difference": ("wrap_angle(", "("),
        "the sign is reversed: measured minus predicted is due": (
            lambda z, p: np.array([p[0] - z[0], wrap_angle(p[1] - z[1])])
        ),
        "the range was wrapped too: only the bearing is an angle": (
            lambda z, p: wrap_angle(z - p)
        ),
        "the bearings were wrapped before the subtraction: wrap the difference itself": (
            "wrap_angle(z[1] - predicted[1])",
            "wrap_angle(z[1]) - wrap_angle(predicted[1])",
        ),
        "the absolute difference loses its sign: the filter must know which way to turn": (
            lambda z, p: np.abs(_innovation(z, p))
        ),
        "wrapped to [0, 2 pi): a small turn to the right must be a small negative number": (
            "wrap_angle(z[1] - predicted[1])",
            "(z[1] - predicted[1]) % (2 * np.pi)",
        ),
        "wrapped to [-pi, pi): half a turn is pi": (
            "wrap_angle(z[1] - predicted[1])",
            "(z[1] - predicted[1] + np.pi) % (2 * np.pi) - np.pi",
        ),
        "wrapped by pi: a full turn is 2 pi": (
            "wrap_angle(z[1] - predicted[1])",
            "(z[1] - predicted[1] + np.pi / 2) % np.pi - np.pi / 2",
        ),
        "the bearing was not subtracted": ("z[1] - predicted[1]", "z[1]"),
    },
)


# Exercise 3: the Jacobian.


def _jacobian(pose: Array, landmark: Array) -> Array:
    """Jacobian (2, 3) of `range_bearing` with respect to the pose."""
    dx, dy = landmark - pose[:2]
    q = dx**2 + dy**2
    r = np.sqrt(q)
    return np.array([[-dx / r, -dy / r, 0.0], [dy / q, -dx / q, -1.0]])


check_jacobian = Check(
    _jacobian,
    "J",
    {
        "straight ahead": ([0, 0, 0], [2, 0]),
        "ahead and to the left": ([1.0, 2.0, 0.6], [4.0, 6.0]),
        "behind, far away": ([1.0, 2.0, -2.0], [-20.0, -13.0]),
        "close by, where the bearing is quick": ([0.0, 0.0, 1.0], [0.2, -0.1]),
        "anywhere": _scene,
    },
    {
        "this is the transpose: rows are range and bearing, columns are x, y, theta": (
            lambda p, m: _jacobian(p, m).T
        ),
        "this is the Jacobian by the landmark's position: the pose moves the other way": (
            lambda p, m: _jacobian(p, m) * [-1, -1, 1]
        ),
        "this is the Jacobian by the landmark, (2, 2): the pose has three numbers": (
            lambda p, m: -_jacobian(p, m)[:, :2]
        ),
        "the last column is zero: turning the robot changes the bearing one to one": (
            "-1.0]",
            "0.0]",
        ),
        "the sign of the heading column is wrong: turn left and the landmark moves right": (
            "-1.0]",
            "1.0]",
        ),
        "the bearing row must be divided by the range squared, not by the range": (
            "dy / q, -dx / q",
            "dy / r, -dx / r",
        ),
        "the range row must be divided by the range, not by its square": (
            "-dx / r, -dy / r",
            "-dx / q, -dy / q",
        ),
        "the signs of the bearing row are exchanged, as in P1 (26), (27)": (
            "dy / q, -dx / q",
            "-dy / q, dx / q",
        ),
        "dx and dy are exchanged in the bearing row": ("dy / q, -dx / q", "-dx / q, dy / q"),
        "the signs of the range row are reversed: nearer means a shorter range": (
            "-dx / r, -dy / r",
            "dx / r, dy / r",
        ),
        "the rows are exchanged: range first, then bearing": (lambda p, m: _jacobian(p, m)[::-1]),
    },
    tolerance=1e-4,
)
