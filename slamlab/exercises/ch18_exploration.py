"""Checks of chapter 18: the area that a square sweeps, four quarters, the frontier.

P5, 3.2.5: `CanMove` and the four quadrants, mended; frontiers after Yamauchi (1997).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._report import Array, Check, Ints

__all__ = ["check_frontier", "check_quarter_beams", "check_swept"]


# Exercise 1: what the body sweeps.


def _swept(points: Array, half: float, step: float) -> Any:
    """Which points (k, 2) a square of half side `half` touches on its way `step` ahead."""
    x, y = points.T
    return (np.abs(y) < half) & (x > -half) & (x < half + step)


def _at_both_ends(points: Array, half: float, step: float) -> Any:
    return _swept(points, half, 0.0) | _swept(points - [step, 0.0], half, 0.0)


def _around(rng: np.random.Generator) -> Any:
    half, step = np.round(rng.uniform(0.1, 0.4), 2), np.round(rng.uniform(0.05, 1.5), 2)
    return np.round(rng.uniform(-1, 2, (int(rng.integers(1, 60)), 2)), 2), half, step


_BORDER = [[0.5, 0.0], [0.0, 0.25], [-0.25, 0.0], [0.25, -0.25], [0.499, 0.249]]

check_swept = Check(
    _swept,
    "hit",
    {
        "straight ahead, near and far": ([[0.3, 0.0], [0.54, 0.0], [0.6, 0.0]], 0.15, 0.4),
        "beside the way, left and right": (
            [[0.3, 0.1], [0.3, -0.1], [0.3, 0.2], [0.3, -0.2]],
            0.15,
            0.4,
        ),
        "half-way, touched neither at the start nor at the end": ([[0.5, 0.05]], 0.1, 1.0),
        "behind: in the body and beyond it": ([[-0.1, 0.0], [-0.3, 0.0]], 0.15, 0.4),
        "exactly on the border": (_BORDER, 0.25, 0.25),
        "a robot that does not move": (_BORDER, 0.25, 0.0),
        "no points": (np.zeros((0, 2)), 0.2, 0.5),
        "points all around": _around,
    },
    {
        "the distance of the point was compared with the step: that guards the centre only": (
            lambda p, h, w: (np.hypot(*p.T) < w) & (p[:, 0] > 0)
        ),
        "the body was tested at the start and at the end only: it sweeps what lies between": (
            _at_both_ends
        ),
        "the body was tested at the end only: it sweeps what lies between": (
            lambda p, h, w: _swept(p - [w, 0.0], h, 0.0)
        ),
        "a disc was swept: the body is a square": (
            lambda p, h, w: np.hypot(p[:, 0] - np.clip(p[:, 0], 0, w), p[:, 1]) < h
        ),
        "the front is half a side ahead of the centre: the way ends at half + step": (
            "x < half + step",
            "x < step",
        ),
        "one flank was forgotten: take the absolute value of y": ("np.abs(y) < half", "y < half"),
        "the other flank was forgotten: take the absolute value of y": (
            "np.abs(y) < half",
            "y > -half",
        ),
        "the body reaches half a side behind its centre too: begin at -half": (
            "x > -half",
            "x > 0",
        ),
        "the body that stands at the start counts as well: begin at -half, not at half": (
            "x > -half",
            "x > half",
        ),
        "everything behind the robot was hit as well: the area begins at -half": (
            " & (x > -half)",
            "",
        ),
        "everything ahead was hit as well: the way ends at half + step": (
            " & (x < half + step)",
            "",
        ),
        "the whole side was taken for half of it": lambda p, h, w: _swept(p, 2 * h, w),
        "half was halved: it is half the side already": lambda p, h, w: _swept(p, h / 2, w),
        "x and y were exchanged: x points ahead, y to the left": ("x, y =", "y, x ="),
        "a point on the border is only touched: use < and not <=": (
            "np.abs(y) < half",
            "np.abs(y) <= half",
            "x > -half",
            "x >= -half",
            "x < half",
            "x <= half",
        ),
        "these are the points that stay free: return those that are hit": (
            lambda p, h, w: ~_swept(p, h, w)
        ),
        "these are the points themselves: true or false is due for each": (
            lambda p, h, w: p[_swept(p, h, w)]
        ),
        "one answer for all points came: each has its own": (
            lambda p, h, w: bool(_swept(p, h, w).any())
        ),
    },
)


# Exercise 2: four quarters, and not back.


def _quarter_beams(ranges: Array, degrees: Array, back: float) -> Ints:
    """Index of the longest beam of each quarter, without those within 45 degrees of `back`."""
    best = []
    for low in (0, 90, 180, 270):
        inside = np.flatnonzero((degrees >= low) & (degrees < low + 90))
        beam = inside[np.argmax(ranges[inside])]
        if abs((degrees[beam] - back + 180) % 360 - 180) > 45:
            best.append(beam)
    return np.array(best, dtype=int)


def _dropped_before(ranges: Array, degrees: Array, back: float) -> Any:
    away = np.abs((degrees - back + 180) % 360 - 180) > 45
    best = []
    for low in (0, 90, 180, 270):
        inside = np.flatnonzero((degrees >= low) & (degrees < low + 90) & away)
        if len(inside):
            best.append(inside[np.argmax(ranges[inside])])
    return np.array(best)


def _inside_the_quarter(ranges: Array, degrees: Array, back: float) -> Any:
    best = _quarter_beams(ranges, degrees, back)
    first = [np.flatnonzero(degrees >= 90 * (degrees[b] // 90))[0] for b in best]
    return np.array(best - first)


def _lengths(n: int, rng: np.random.Generator) -> Any:
    return np.round(rng.permutation(n) / n + 0.5, 3)


def _lidar(rng: np.random.Generator) -> Any:
    n = int(rng.choice([8, 12, 36, 72]))
    return _lengths(n, rng), np.arange(n) * 360 / n, float(np.round(rng.uniform(0, 360), 1))


def _on_borders(rng: np.random.Generator) -> Any:
    """Draw scans whose longest beams point exactly along 0, 90, 180 and 270 degrees."""
    ranges, degrees = _lengths(36, rng), np.arange(0.0, 360.0, 10.0)
    ranges[[0, 9, 18, 27]] = np.round(rng.permutation(4) + 3.0, 1)
    return ranges, degrees, float(rng.choice([10.0, 100.0, 200.0, 290.0]))


def _near_the_limit(rng: np.random.Generator) -> Any:
    """Draw half-degree scans: long beams just before borders, back 45 degrees from one of them."""
    ranges, degrees = _lengths(720, rng), np.arange(0.0, 360.0, 0.5)
    ranges[[179, 359, 539, 719]] = np.round(rng.permutation(4) + 3.0, 1)
    back = rng.choice([89.5, 179.5, 269.5, 359.5]) + rng.choice([-45.5, -44.5, 44.5, 45.5])
    return ranges, degrees, float(back % 360)


check_quarter_beams = Check(
    _quarter_beams,
    "beams",
    {
        "four beams": ([1.0, 2.0, 3.0, 4.0], [45.0, 135.0, 225.0, 315.0], 320.0),
        "exactly 45 degrees from the way back is within": (
            [1.0, 2.0, 3.0, 4.0],
            [10.0, 100.0, 225.0, 315.0],
            55.0,
        ),
        "back is straight ahead: 350 and 10 degrees are both near": lambda rng: (
            _lengths(36, rng) + 9.0 * np.isin(np.arange(36), [1, 35]),
            np.arange(0.0, 360.0, 10.0),
            0.0,
        ),
        "a long beam at 170 degrees belongs to the second quarter": lambda rng: (
            _lengths(36, rng) + 9.0 * (np.arange(36) == 17),
            np.arange(0.0, 360.0, 10.0),
            300.0,
        ),
        "the longest beams lie on the borders of the quarters": _on_borders,
        "half-degree beams, just within or beyond 45 degrees": _near_the_limit,
        "any lidar": _lidar,
    },
    {
        "the third quarter begins at 180 degrees; 160, as P5 prints it, counts beams twice": (
            "degrees >= low)",
            "degrees >= (160 if low == 180 else low))",
        ),
        "the way back was kept: drop beams within 45 degrees of it": ("> 45", "> -1"),
        "350 and 10 degrees are 20 apart: wrap the difference of directions": (
            "abs((degrees[beam] - back + 180) % 360 - 180)",
            "abs(degrees[beam] - back)",
        ),
        "the beams near the way back were dropped before the longest was taken: take the longest "
        "of each quarter first": _dropped_before,
        "exactly 45 degrees is within 45 degrees": ("> 45", ">= 45"),
        "45 degrees to either side, not in all": ("> 45", "> 22.5"),
        "45 degrees, not 90": ("> 45", "> 90"),
        "a beam on a border belongs to the quarter that begins there": (
            "degrees >= low",
            "degrees > low",
            "degrees < low + 90",
            "degrees <= low + 90",
        ),
        "count beams from the first of the scan, not of the quarter": _inside_the_quarter,
        "these are the shortest beams": ("argmax", "argmin"),
        "these lead back: the others are due": ("> 45", "<= 45"),
        "one beam came: the longest of each quarter is due": (
            lambda r, a, b: np.array([int(np.argmax(r))])
        ),
        "these are the directions: the indices of the beams are due": (
            lambda r, a, b: a[_quarter_beams(r, a, b)]
        ),
        "these are the lengths: the indices of the beams are due": (
            lambda r, a, b: r[_quarter_beams(r, a, b)]
        ),
        "the order of the quarters is due, not the order of the lengths": (
            lambda r, a, b: sorted(_quarter_beams(r, a, b), key=lambda k: -r[k])
        ),
    },
    draws=12,
)


# Exercise 3: the frontier.


def _frontier(state: Ints) -> Any:
    """Free cells (1) with an unknown one (0) above, below, left or right; 2 is occupied."""
    return _beside(state == 0) & (state == 1)


def _beside(mask: Any, diagonal: bool = False, outside: bool = False, sides: int = 4) -> Any:
    padded = np.pad(mask, 1, constant_values=outside)
    steps = [(0, 1), (1, 0), (0, -1), (-1, 0)][:sides]
    steps += [(1, 1), (1, -1), (-1, 1), (-1, -1)] if diagonal else []
    rows, columns = mask.shape
    parts = [padded[1 + i : 1 + i + rows, 1 + j : 1 + j + columns] for i, j in steps]
    return np.any(parts, axis=0)


def _rolled(state: Ints) -> Any:
    unknown = state == 0
    beside = [np.roll(unknown, step, axis) for step in (1, -1) for axis in (0, 1)]
    return np.any(beside, axis=0) & (state == 1)


def _a_map(rng: np.random.Generator) -> Any:
    return (rng.choice([0, 1, 1, 1, 2], size=rng.integers(1, 9, 2)),)


_ISLAND = np.pad(np.ones((3, 3), dtype=int), 1)

check_frontier = Check(
    _frontier,
    "frontier",
    {
        "an island of free floor: its rim": (_ISLAND,),
        "a wall between free and unknown": ([[1, 1, 2, 0], [1, 1, 2, 0], [1, 1, 1, 0]],),
        "everything seen: no frontier": ([[1, 1, 1], [1, 2, 1], [1, 1, 1]],),
        "unknown on the far edge": ([[1, 1, 1, 0], [1, 1, 1, 0]],),
        "unknown across the corner only": ([[1, 2, 0], [2, 1, 2], [0, 2, 1]],),
        "a single cell": ([[1]],),
        "a column": ([[0], [1], [1], [2], [0]],),
        "any map": _a_map,
    },
    {
        "these are the unknown cells beside free ones: the robot can stand on the free side": (
            lambda s: _beside(s == 1) & (s == 0)
        ),
        "cells beside a wall came too: only an unknown neighbour makes a frontier": (
            lambda s: _beside(s != 1) & (s == 1)
        ),
        "np.roll wraps around: the left edge is no neighbour of the right one": _rolled,
        "beyond the edge of the map there is nothing, and nothing is not unknown": (
            lambda s: _beside(s == 0, outside=True) & (s == 1)
        ),
        "only two of the four neighbours were looked at": (
            lambda s: _beside(s == 0, sides=2) & (s == 1)
        ),
        "only left and right were looked at": (
            lambda s: (
                (_beside(s == 0, sides=1) | _beside(s[:, ::-1] == 0, sides=1)[:, ::-1]) & (s == 1)
            )
        ),
        "walls came too: a frontier cell is free": lambda s: _beside(s == 0) & (s != 0),
        "diagonal neighbours were counted: above, below, left and right only": (
            lambda s: _beside(s == 0, diagonal=True) & (s == 1)
        ),
        "all free cells came: only those with an unknown neighbour are due": lambda s: s == 1,
        "all cells beside unknown ones came: a frontier cell is free": lambda s: _beside(s == 0),
        "these are the places of the cells: true or false is due for each": (
            lambda s: np.argwhere(_beside(s == 0) & (s == 1))
        ),
    },
)
