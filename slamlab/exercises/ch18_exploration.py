"""Checks of chapter 18: the area that a square sweeps, four quarters, the frontier.

P5, 3.2.5: `CanMove` and the four quadrants, mended; frontiers after Yamauchi (1997).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Report, run_cases

__all__ = [
    "MISTAKES_FRONTIER",
    "MISTAKES_QUARTER_BEAMS",
    "MISTAKES_SWEPT",
    "check_frontier",
    "check_quarter_beams",
    "check_swept",
    "frontier",
    "quarter_beams",
    "swept",
]

Function = Callable[..., Any]


# Exercise 1: what the body sweeps.


def swept(points: Array, half: float, step: float) -> Any:
    """Which points (k, 2) a square of half side `half` touches on its way `step` ahead."""
    x, y = np.asarray(points, dtype=float).T
    return (np.abs(y) < half) & (x > -half) & (x < half + step)


MISTAKES_SWEPT: dict[str, Function] = {
    "the distance of the point was compared with the step: that guards the centre, as CanMove": (
        lambda p, h, w: (np.hypot(*p.T) < w) & (p[:, 0] > 0)
    ),
    "the front is half a side ahead of the centre: the way ends at half + step": (
        lambda p, h, w: (np.abs(p[:, 1]) < h) & (p[:, 0] > -h) & (p[:, 0] < w)
    ),
    "one flank was forgotten: take the absolute value of y": (
        lambda p, h, w: (p[:, 1] < h) & (p[:, 0] > -h) & (p[:, 0] < h + w)
    ),
    "the body reaches half a side behind its centre too: begin at -half": (
        lambda p, h, w: (np.abs(p[:, 1]) < h) & (p[:, 0] > 0) & (p[:, 0] < h + w)
    ),
    "everything behind the robot was hit as well: the area begins at -half": (
        lambda p, h, w: (np.abs(p[:, 1]) < h) & (p[:, 0] < h + w)
    ),
    "the whole side was taken for half of it": lambda p, h, w: swept(p, 2 * h, w),
    "x and y were exchanged: x points ahead, y to the left": (
        lambda p, h, w: swept(p[:, ::-1], h, w)
    ),
    "a point on the border is only touched: use < and not <=": (
        lambda p, h, w: (np.abs(p[:, 1]) <= h) & (p[:, 0] >= -h) & (p[:, 0] <= h + w)
    ),
    "these are the points that stay free: return those that are hit": (
        lambda p, h, w: ~swept(p, h, w)
    ),
}


def check_swept(student: Function) -> Report:
    """Check ``student(points (k, 2), half, step) -> hit (k,) of bool``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    beside = [[0.3, 0.1], [0.3, -0.1], [0.3, 0.2], [0.3, -0.2]]
    spread = np.random.default_rng(1).uniform(-1, 1, (40, 2))
    cases = [
        ("straight ahead, near and far", [[0.3, 0.0], [0.54, 0.0], [0.6, 0.0]], 0.15, 0.4),
        ("beside the way, left and right", beside, 0.15, 0.4),
        ("behind: in the body and beyond it", [[-0.1, 0.0], [-0.3, 0.0]], 0.15, 0.4),
        ("exactly on the border", [[0.5, 0.0], [0.0, 0.25], [-0.25, 0.0]], 0.25, 0.25),
        ("points all around", spread, 0.2, 0.5),
    ]
    return run_cases("swept", student, swept, cases, MISTAKES_SWEPT)


# Exercise 2: four quarters, and not back.


def quarter_beams(ranges: Array, degrees: Array, back: float) -> Any:
    """Index of the longest beam of each quarter, without those within 45 degrees of `back`."""
    ranges, degrees = np.asarray(ranges, dtype=float), np.asarray(degrees, dtype=float)
    return _best(ranges, degrees, back, [(0, 90), (90, 180), (180, 270), (270, 360)])


def _best(
    ranges: Array, degrees: Array, back: float, quarters: list[tuple[int, int]], near: float = 45.0
) -> Array:
    best = []
    for low, high in quarters:
        inside = np.flatnonzero((degrees >= low) & (degrees < high))
        beam = inside[np.argmax(ranges[inside])]
        away = abs((degrees[beam] - back + 180) % 360 - 180)
        if away > near:
            best.append(beam)
    return np.array(best, dtype=float)


_QUARTERS = [(0, 90), (90, 180), (180, 270), (270, 360)]


def _unwrapped(ranges: Array, degrees: Array, back: float) -> Array:
    best = _best(ranges, degrees, back, _QUARTERS, near=-1.0).astype(int)
    return best[np.abs(degrees[best] - back) > 45].astype(float)


def _inside_the_quarter(ranges: Array, degrees: Array, back: float) -> Array:
    best = quarter_beams(ranges, degrees, back).astype(int)
    first = [np.flatnonzero(degrees >= 90 * (degrees[b] // 90))[0] for b in best]
    return np.array(best - first, dtype=float)


def _shortest(ranges: Array, degrees: Array, back: float) -> Array:
    return quarter_beams(-ranges, degrees, back)


def _only_back(ranges: Array, degrees: Array, back: float) -> Array:
    best = _best(ranges, degrees, back, _QUARTERS, near=-1.0)
    return np.setdiff1d(best, quarter_beams(ranges, degrees, back))


MISTAKES_QUARTER_BEAMS: dict[str, Function] = {
    "the third quarter begins at 180 degrees; 160, as P5 prints it, counts beams twice": (
        lambda r, a, b: _best(r, a, b, [(0, 90), (90, 180), (160, 270), (270, 360)])
    ),
    "the way back was kept: drop beams within 45 degrees of it": (
        lambda r, a, b: _best(r, a, b, _QUARTERS, near=-1.0)
    ),
    "350 and 10 degrees are 20 apart: wrap the difference of directions": _unwrapped,
    "count beams from the first of the scan, not of the quarter": _inside_the_quarter,
    "these are the shortest beams": _shortest,
    "these lead back: the others are due": _only_back,
    "one beam came: the longest of each quarter is due": (
        lambda r, a, b: np.array([float(np.argmax(r))])
    ),
    "these are the directions: the indices of the beams are due": (
        lambda r, a, b: a[quarter_beams(r, a, b).astype(int)]
    ),
}


def check_quarter_beams(student: Function) -> Report:
    """Check ``student(ranges (n,), degrees (n,), back) -> indices of beams``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    rng = np.random.default_rng(2)
    degrees = np.arange(0.0, 360.0, 10.0)
    behind, front = rng.uniform(1, 2, 36), rng.uniform(1, 2, 36)
    behind[[3, 12, 17, 20, 30]] = [3.0, 2.5, 3.2, 2.8, 3.1]
    front[[1, 11, 22, 35]] = 3.0
    cases = [
        ("the longest of each quarter, none leads back", front, degrees, 55.0),
        ("a long beam at 170 degrees belongs to the second quarter", behind, degrees, 60.0),
        ("the beam that leads back is left out", behind, degrees, 175.0),
        ("back is straight ahead: 350 and 10 degrees are both near", front, degrees, 0.0),
        ("a finer lidar", rng.uniform(0.5, 4.0, 120), np.arange(0.0, 360.0, 3.0), 200.0),
    ]
    return run_cases("quarter_beams", student, quarter_beams, cases, MISTAKES_QUARTER_BEAMS)


# Exercise 3: the frontier.


def frontier(state: Array) -> Any:
    """Free cells (1) with an unknown one (0) above, below, left or right; 2 is occupied."""
    state = np.asarray(state)
    return _beside(state == 0) & (state == 1)


def _beside(mask: Array, diagonal: bool = False) -> Any:
    padded = np.pad(mask, 1)
    steps = [(0, 1), (0, -1), (1, 0), (-1, 0)]
    steps += [(1, 1), (1, -1), (-1, 1), (-1, -1)] if diagonal else []
    rows, columns = mask.shape
    parts = [padded[1 + i : 1 + i + rows, 1 + j : 1 + j + columns] for i, j in steps]
    return np.any(parts, axis=0)


def _rolled(state: Array) -> Any:
    unknown = state == 0
    beside = [np.roll(unknown, step, axis) for step in (1, -1) for axis in (0, 1)]
    return np.any(beside, axis=0) & (state == 1)


def _two_sides(state: Array) -> Any:
    unknown = np.pad(state == 0, 1)
    return (unknown[1:-1, 2:] | unknown[2:, 1:-1]) & (state == 1)


MISTAKES_FRONTIER: dict[str, Function] = {
    "these are the unknown cells beside free ones: the robot can stand on the free side": (
        lambda s: _beside(s == 1) & (s == 0)
    ),
    "cells beside a wall came too: only an unknown neighbour makes a frontier": (
        lambda s: _beside(s != 1) & (s == 1)
    ),
    "np.roll wraps around: the left edge is no neighbour of the right one": _rolled,
    "only two of the four neighbours were looked at": _two_sides,
    "walls came too: a frontier cell is free": lambda s: _beside(s == 0) & (s != 0),
    "diagonal neighbours were counted: above, below, left and right only": (
        lambda s: _beside(s == 0, diagonal=True) & (s == 1)
    ),
    "all free cells came: only those with an unknown neighbour are due": lambda s: s == 1,
}


def check_frontier(student: Function) -> Report:
    """Check ``student(state (rows, columns)) -> frontier (rows, columns) of bool``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    island = np.zeros((5, 5))
    island[1:4, 1:4] = 1
    random_map = np.random.default_rng(3).choice([0, 1, 1, 1, 2], size=(8, 9))
    cases = [
        ("an island of free floor: its rim", island),
        ("a wall between free and unknown", [[1, 1, 2, 0], [1, 1, 2, 0], [1, 1, 1, 0]]),
        ("everything seen: no frontier", [[1, 1, 1], [1, 2, 1], [1, 1, 1]]),
        ("unknown on the far edge", [[1, 1, 1, 0], [1, 1, 1, 0]]),
        ("a map with everything", random_map),
    ]
    return run_cases("frontier", student, frontier, cases, MISTAKES_FRONTIER)
