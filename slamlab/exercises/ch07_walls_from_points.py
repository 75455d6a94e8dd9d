"""Checks of chapter 07: total least squares, the corner of split-and-merge, covariance of a wall.

P1 names "least squares" and "distances" and prints no formula; the chapter derives these three.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Report, run_cases

__all__ = [
    "MISTAKES_CORNER",
    "MISTAKES_LINE",
    "MISTAKES_WALL_COV",
    "check_corner",
    "check_line",
    "check_wall_cov",
    "corner",
    "line",
    "wall_cov",
]

Function = Callable[..., Any]


# Exercise 1: a line by total least squares.


def line(points: Array) -> Array:
    """Line (r, alpha), r not negative, of points (k, 2) by total least squares."""
    points = np.asarray(points, dtype=float)
    centre = points.mean(0)
    return _named(np.linalg.svd(points - centre)[2][-1], centre)


def _named(normal: Array, centre: Array) -> Array:
    """R >= 0 and alpha in (-pi, pi] of the line through `centre` with this normal."""
    r = normal @ centre
    if r < 0:
        r, normal = -r, -normal
    return np.array([r, np.arctan2(normal[1], normal[0])])


def _ordinary(points: Array) -> Array:
    a, b = np.polyfit(points[:, 0], points[:, 1], 1)
    return _named(np.array([-a, 1.0]) / np.hypot(a, 1.0), np.array([0.0, b]))


def _along(points: Array) -> Array:
    centre = points.mean(0)
    return _named(np.linalg.svd(points - centre)[2][0], centre)


def _not_centred(points: Array) -> Array:
    return _named(np.linalg.svd(points)[2][-1], points.mean(0))


def _other_name(points: Array) -> Array:
    r, alpha = line(points)
    return np.array([-r, alpha - np.pi if alpha > 0 else alpha + np.pi])


def _from_the_chord(points: Array) -> Array:
    u = points[-1] - points[0]
    return _named(np.array([-u[1], u[0]]) / np.hypot(*u), points.mean(0))


def _r_alone(points: Array) -> Array:
    r, alpha = _other_name(points)
    return np.array([-r, alpha])


MISTAKES_LINE: dict[str, Function] = {
    "this is y = a x + b: it measures distances along y, so it knows which axis is x": _ordinary,
    "this is the direction along the wall: the normal is the one with the smaller spread": _along,
    "subtract the centre of the points before looking for their spread": _not_centred,
    "r is negative: turn the normal by half a turn and the sign of r with it": _other_name,
    "r lost its sign, but alpha was not turned by half a turn: that is another wall": _r_alone,
    "the first and the last point decide alone: all points have a say": _from_the_chord,
    "alpha is in degrees: radians are due": lambda p: line(p) * [1.0, 180 / np.pi],
}


def check_line(student: Function) -> Report:
    """Check ``student(points (k, 2)) -> (r, alpha)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    noise = np.array([0.02, -0.03, 0.01, 0.02, -0.01, -0.02, 0.03])[:, None]
    along = np.linspace(-1.0, 1.5, 7)[:, None]

    def wall(r: float, alpha: float) -> Array:
        n = np.array([np.cos(alpha), np.sin(alpha)])
        return (r + noise) * n + along * [-n[1], n[0]]

    cases = [
        ("a slanting wall", wall(2.0, 0.7)),
        ("a wall parallel to the y axis", wall(3.0, 0.0)),
        ("a wall on the other side of the robot", wall(1.5, -2.4)),
        ("a wall behind", wall(2.5, 3.0)),
        ("two points", [[1.0, 2.0], [3.0, 1.0]]),
    ]
    return run_cases("line", student, line, cases, MISTAKES_LINE)


# Exercise 2: where to cut.


def corner(points: Array) -> int:
    """Index of the point of (k, 2) that lies farthest from the chord between the ends."""
    return int(np.argmax(_off(points)))


def _off(points: Array) -> Array:
    points = np.asarray(points, dtype=float)
    u, d = points[-1] - points[0], points - points[0]
    return np.abs(u[0] * d[:, 1] - u[1] * d[:, 0]) / np.hypot(*u)


def _signed(points: Array) -> int:
    u, d = points[-1] - points[0], points - points[0]
    return int(np.argmax(u[0] * d[:, 1] - u[1] * d[:, 0]))


def _from_fit(points: Array) -> int:
    r, alpha = line(points)
    return int(np.argmax(np.abs(points @ [np.cos(alpha), np.sin(alpha)] - r)))


MISTAKES_CORNER: dict[str, Function] = {
    "the distance has a sign: a corner on the other side of the chord was overlooked": _signed,
    "this is the distance from the fitted line, largest at an end: cut by the chord": _from_fit,
    "this is the distance from the first point: measure it from the chord": (
        lambda p: int(np.argmax(np.hypot(*(p - p[0]).T)))
    ),
    "this is the distance itself: the index of the point is due": lambda p: _off(p).max(),
    "off by one: the first point has index 0": lambda p: corner(p) + 1,
    "this point lies nearest to the chord: the farthest is due": (
        lambda p: 1 + int(np.argmin(_off(p)[1:-1]))
    ),
}


def check_corner(student: Function) -> Report:
    """Check ``student(points (k, 2)) -> index``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    left = np.array([[0, 0], [1, 0.02], [2, -0.01], [2.02, 1], [1.99, 2], [2, 3], [2, 4.0]])
    cases = [
        ("a corner to the right of the chord", left),
        ("the same corner to its left", left[:, ::-1]),
        ("a steep chord", [[0, 0], [0.2, 2.9], [1.5, 4.5], [1.2, 5.5], [1.0, 8.0]]),
        ("a short leg and a long one", [[0, 0], [0.5, 0.0], [0.5, 0.5], [0.5, 1], [0.5, 4]]),
        ("far from the origin", left[::-1] + [30.0, -40.0]),
    ]
    return run_cases("corner", student, corner, cases, MISTAKES_CORNER)


# Exercise 3: how sure is a wall?


def wall_cov(along: Array, variances: Array) -> Array:
    """Covariance (2, 2) of (r, alpha) from places along the wall and variances across it, (k,)."""
    t, w = np.asarray(along, dtype=float), np.asarray(variances, dtype=float)
    return _sandwich(t, w, t.mean())


def _sandwich(t: Array, w: Array, middle: Any) -> Array:
    d_alpha = -(t - middle) / np.sum((t - middle) ** 2)
    d_r = 1 / len(t) + middle * d_alpha
    J = np.stack([d_r, d_alpha])
    return (J * w) @ J.T


def _from_foot(t: Array, w: Array) -> Array:
    d_alpha = -t / np.sum(t**2)
    J = np.stack([np.full(len(t), 1 / len(t)), d_alpha])
    return (J * w) @ J.T


def _other_sign(t: Array, w: Array) -> Array:
    return wall_cov(t, w) * [[1, -1], [-1, 1]]


MISTAKES_WALL_COV: dict[str, Function] = {
    "r and alpha err together: the corner elements are not zero": (
        lambda t, w: wall_cov(t, w) * np.eye(2)
    ),
    "the correlation has the wrong sign: a point beyond the middle turns the normal back": (
        _other_sign
    ),
    "measure the places from their mean: the wall turns about the middle of its points": (
        _from_foot
    ),
    "r is the distance at the foot of the perpendicular: the turn moves it too, by mean(t)": (
        lambda t, w: _sandwich(t - t.mean(), w, 0.0)
    ),
    "each point has a variance of its own: weigh by it before summing": (
        lambda t, w: wall_cov(t, np.full(len(t), w.mean()))
    ),
    "these look like standard deviations: the variances were given, do not square them": (
        lambda t, w: wall_cov(t, w**2)
    ),
    "this does not shrink with more points: an average of k errors has 1/k of their variance": (
        lambda t, w: wall_cov(t, w) * len(t)
    ),
}


def check_wall_cov(student: Function) -> Report:
    """Check ``student(along (k,), variances (k,)) -> (2, 2)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("points around the perpendicular", np.linspace(-1, 1, 5), [0.04] * 5),
        ("points to one side of it", np.linspace(1, 3, 9), [0.04] * 9),
        ("unequal points", [-2.0, 0.5, 1.0, 4.0], [0.1, 0.2, 0.8, 1.5]),
        ("to the other side", [-5.0, -4.0, -2.5], [0.1, 0.3, 0.2]),
    ]
    return run_cases("wall_cov", student, wall_cov, cases, MISTAKES_WALL_COV)
