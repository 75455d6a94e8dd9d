"""Checks of chapter 06: a beam through cells, the beams of a lidar, points that keep their place.

P5, chapters 3.2.2 (`Scan`) and 3.2.4 (`distancetodots`), repaired.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Mistake, Property, Report, run_cases, run_checks

__all__ = [
    "MISTAKES_BEAM_ANGLES",
    "MISTAKES_FIRST_HIT",
    "MISTAKES_SCAN_TO_POINTS",
    "beam_angles",
    "check_beam_angles",
    "check_first_hit",
    "check_scan_to_points",
    "first_hit",
    "scan_to_points",
]

Function = Callable[..., Any]


# Exercise 1: a beam through cells.


def first_hit(occupied: Array, x: float, y: float, angle: float) -> float:
    """Range (cells) to the border of the first occupied cell (rows, columns); inf if none."""
    dx, dy = float(np.cos(angle)), float(np.sin(angle))
    column, row, t = int(np.floor(x)), int(np.floor(y)), 0.0
    while 0 <= row < len(occupied) and 0 <= column < len(occupied[0]):
        if occupied[row][column]:
            return t
        t_x = (column + (dx > 0) - float(x)) / dx if dx else np.inf
        t_y = (row + (dy > 0) - float(y)) / dy if dy else np.inf
        t = min(t_x, t_y)
        if t_x <= t_y:
            column += 1 if dx > 0 else -1
        else:
            row += 1 if dy > 0 else -1
    return np.inf


def _sampled(occupied: Array, x: float, y: float, angle: float, step: float) -> float:
    """Range by samples every `step` along the beam."""
    for t in np.arange(0.0, 4.0 * len(occupied) + 4.0 * len(occupied[0]), step):
        column, row = int(np.floor(x + t * np.cos(angle))), int(np.floor(y + t * np.sin(angle)))
        if not (0 <= row < len(occupied) and 0 <= column < len(occupied[0])):
            return np.inf
        if occupied[row][column]:
            return float(t)
    return np.inf


def _pixel_walk(occupied: Array, x: float, y: float, angle: float) -> float:
    return _sampled(occupied, x, y, angle, 1 / max(abs(np.cos(angle)), abs(np.sin(angle))))


def _to_the_centre(occupied: Array, x: float, y: float, angle: float) -> float:
    t = first_hit(occupied, x, y, angle)
    if np.isinf(t):
        return t
    inside = t + 1e-9
    column, row = np.floor(x + inside * np.cos(angle)), np.floor(y + inside * np.sin(angle))
    return float(np.hypot(column + 0.5 - x, row + 0.5 - y))


def _to_the_edge(occupied: Array, x: float, y: float, angle: float) -> float:
    t = first_hit(occupied, x, y, angle)
    if np.isfinite(t):
        return t
    return first_hit(np.pad(occupied, 1, constant_values=1), x + 1, y + 1, angle)


def _turned_over(occupied: Array, x: float, y: float, angle: float) -> float:
    return first_hit(np.asarray(occupied)[::-1], x, y, angle)


MISTAKES_FIRST_HIT: dict[str, Function] = {
    "one step a pixel of the longer side, as P5 has it: cells cut near a corner are skipped": (
        _pixel_walk
    ),
    "samples at fixed steps: never exact, and a small corner falls between them": (
        lambda o, x, y, a: _sampled(o, x, y, a, 0.1)
    ),
    "this is the distance to the cell's centre: the beam ends at its border": _to_the_centre,
    "a beam that leaves the grid met nothing: inf is due, not the way to the edge": _to_the_edge,
    "row 0 is at the bottom: the picture was turned over": _turned_over,
    "rows and columns are exchanged: occupied[row, column], row from y": (
        lambda o, x, y, a: first_hit(np.asarray(o).T, x, y, a)
    ),
    "the angle is in radians": lambda o, x, y, a: first_hit(o, x, y, np.deg2rad(a)),
    "this is the way along x: the range runs along the beam": (
        lambda o, x, y, a: first_hit(o, x, y, a) * abs(np.cos(a))
    ),
}


def check_first_hit(student: Function) -> Report:
    """Check ``student(occupied (rows, columns), x, y, angle) -> range (cells)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cells = np.zeros((6, 9))
    cells[1, 7] = cells[4, 2] = cells[5, 0] = cells[3, 8] = 1
    diagonal = np.eye(9)[::-1]
    cases = [
        ("to the right and up", cells, 0.5, 0.4, 0.19),
        ("to the left and up", cells, 6.3, 0.7, 2.35),
        ("to the left and down", diagonal, 6.3, 7.6, -2.2),
        ("straight along a row", cells, 1.25, 1.5, 0.0),
        ("a cell that is cut only near its corner", cells, 0.5, 0.5, np.arctan2(2.45, 7.6)),
        ("between two cells that touch at a corner", diagonal, 1.2, 1.3, np.arctan2(2.78, 2.7)),
        ("a beam that leaves the grid", cells, 3.5, 2.5, -1.2),
        ("a start inside an occupied cell", cells, 2.5, 4.5, 1.0),
    ]
    return run_cases("first_hit", student, first_hit, cases, MISTAKES_FIRST_HIT)


# Exercise 2: the beams of a lidar.


def beam_angles(n_beams: int, field_of_view: float) -> Array:
    """Directions (n_beams,) of beams that fill the field of view (rad), counterclockwise."""
    if field_of_view >= 2 * np.pi:
        return 2 * np.pi * np.arange(n_beams) / n_beams
    if n_beams == 1:
        return np.zeros(1)
    return np.linspace(-field_of_view / 2, field_of_view / 2, n_beams)


def _wrapped(function: Function) -> Function:
    """Let every turn of 2 pi pass; the half turn is +pi."""

    def answer(n_beams: int, field_of_view: float) -> Any:
        came = function(n_beams, field_of_view)
        if came is None or came is Ellipsis:
            return came
        angles = np.mod(np.asarray(came, dtype=float) + np.pi, 2 * np.pi) - np.pi
        return np.where(angles < -np.pi + 1e-9, np.pi, angles)

    return answer


def _doubled(n: int, view: float) -> Array:
    return np.linspace(-view / 2, view / 2, n) if n > 1 else np.zeros(1)


def _without_last_edge(n: int, view: float) -> Array:
    whole = view >= 2 * np.pi or n == 1
    return beam_angles(n, view) if whole else -view / 2 + view * np.arange(n) / n


def _from_ahead(n: int, view: float) -> Array:
    return beam_angles(n, view) + (0.0 if view >= 2 * np.pi or n == 1 else view / 2)


def _whole_degrees(n: int, view: float) -> Array:
    full = view >= 2 * np.pi
    return np.deg2rad(360 // n) * np.arange(n) if full else beam_angles(n, view)


def _single_at_the_edge(n: int, view: float) -> Array:
    return np.array([-view / 2]) if n == 1 and view < 2 * np.pi else beam_angles(n, view)


MISTAKES_BEAM_ANGLES: dict[str, Function] = {
    "in a full circle the first and the last beam must not look the same way": _doubled,
    "these turn clockwise: angles grow counterclockwise": lambda n, v: -beam_angles(n, v),
    "these are degrees: radians are due": lambda n, v: np.rad2deg(beam_angles(n, v)),
    "a part of the circle has a beam on both of its edges": _without_last_edge,
    "a part of the circle lies symmetrically around straight ahead": _from_ahead,
    "whole degrees, as P5 has it: 360 // n leaves a gap or puts all beams on one ray": (
        _whole_degrees
    ),
    "a single beam looks straight ahead, not along the edge": _single_at_the_edge,
}


def check_beam_angles(student: Function) -> Report:
    """Check ``student(n_beams, field_of_view) -> angles (n_beams,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("a full circle begins ahead and has no beam twice", 8, 2 * np.pi),
        ("seven beams share the circle evenly", 7, 2 * np.pi),
        ("500 beams do not fall onto one ray", 500, 2 * np.pi),
        ("half a circle includes both edges", 5, np.pi),
        ("a narrow fan", 4, 0.6),
        ("a single beam looks ahead", 1, 1.0),
    ]
    due = _wrapped(beam_angles)
    properties = [Property(name, (n, view), due(n, view)) for name, n, view in cases]
    mistakes = [Mistake(text, _wrapped(wrong)) for text, wrong in MISTAKES_BEAM_ANGLES.items()]
    return run_checks("beam_angles", _wrapped(student), properties, mistakes)


# Exercise 3: points that keep their place.


def scan_to_points(pose: Array, ranges: Array, angles: Array) -> Array:
    """Points (n, 2) in the world of a scan; NaN where a beam met nothing or was lost."""
    kept = np.where(np.isfinite(ranges), ranges, np.nan)
    beams = pose[2] + np.asarray(angles)
    return np.stack([pose[0] + kept * np.cos(beams), pose[1] + kept * np.sin(beams)], -1)


def _dropped(pose: Array, ranges: Array, angles: Array) -> Array:
    there = np.isfinite(ranges)
    return scan_to_points(pose, ranges[there], angles[there])


def _moved_up(pose: Array, ranges: Array, angles: Array) -> Array:
    there = ranges[np.isfinite(ranges)]
    return scan_to_points(pose, there, angles[: len(there)])


def _infinite(pose: Array, ranges: Array, angles: Array) -> Array:
    beams = pose[2] + angles
    return np.stack([pose[0] + ranges * np.cos(beams), pose[1] + ranges * np.sin(beams)], -1)


def _as_zero(pose: Array, ranges: Array, angles: Array) -> Array:
    return scan_to_points(pose, np.where(np.isfinite(ranges), ranges, 0.0), angles)


def _turned_back(pose: Array, ranges: Array, angles: Array) -> Array:
    return scan_to_points(np.array([pose[0], pose[1], -pose[2]]), ranges, angles)


def _in_degrees(pose: Array, ranges: Array, angles: Array) -> Array:
    turned = np.array([pose[0], pose[1], np.deg2rad(pose[2])])
    return scan_to_points(turned, ranges, np.deg2rad(angles))


MISTAKES_SCAN_TO_POINTS: dict[str, Function] = {
    "beams without a return were left out: each beam keeps its place, missing ones as NaN": (
        _dropped
    ),
    "the list moved up, as P5's does: a distance now belongs to its neighbour's beam": _moved_up,
    "inf is no place: a beam that met nothing gives NaN": _infinite,
    "a missing return became a point on the robot: NaN is due": _as_zero,
    "the heading is missing: beams turn with the robot": (
        lambda p, r, a: scan_to_points(np.array([p[0], p[1], 0.0]), r, a)
    ),
    "the position is missing: these points are seen from the robot": (
        lambda p, r, a: scan_to_points(np.array([0.0, 0.0, p[2]]), r, a)
    ),
    "the scan was turned against the heading: add it, do not subtract it": _turned_back,
    "these angles are radians already": _in_degrees,
    "sine and cosine are exchanged: angle 0 points along x": (
        lambda p, r, a: (scan_to_points(p, r, a) - p[:2])[:, ::-1] + p[:2]
    ),
}


def check_scan_to_points(student: Function) -> Report:
    """Check ``student(pose (3,), ranges (n,), angles (n,)) -> points (n, 2)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    fan = [-1.0, -0.4, 0.2, 0.9]
    cases = [
        ("a robot at the origin looks along x", [0.0, 0.0, 0.0], [1.0, 2.0, 3.0, 4.0], fan),
        ("a robot somewhere, turned", [2.0, -1.0, 0.7], [1.0, 2.0, 3.0, 4.0], fan),
        ("a beam that met nothing keeps its place", [2.0, 1.0, 2.5], [1.0, np.inf, 3.0, 1.5], fan),
        ("a lost reading keeps its place", [1.0, 1.0, -2.0], [np.nan, 2.0, 0.5, 1.5], fan),
    ]
    return run_cases("scan_to_points", student, scan_to_points, cases, MISTAKES_SCAN_TO_POINTS)
