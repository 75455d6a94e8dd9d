"""Checks of chapter 18: the areas that a square sweeps, four quarters, the frontier and the way.

P5, 3.2.5: `CanMove` and the four quadrants, mended; frontiers after Yamauchi (1997).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn
from slamlab.exercises._report import Array, Check, Function, Ints

__all__ = [
    "check_free_step",
    "check_free_turn",
    "check_frontier",
    "check_quarter_beams",
    "check_swept",
    "check_way",
]


# Exercise 1: room to turn, with a pencil.


def _free_turn(point: Array, half: float) -> tuple[float, float]:
    """How far (rad) a square of half side `half` may turn left and right before it hits a point.

    Infinite twice where its corners cannot reach the point, zero twice where it is inside.
    """
    distance = np.hypot(*point)
    if distance >= half * np.sqrt(2):
        return np.inf, np.inf
    gap = np.arccos(half / max(distance, half))
    bearing = np.arctan2(point[1], point[0])
    bearing -= np.pi / 2 * np.rint(bearing / (np.pi / 2))
    left, right = gap + bearing, gap - bearing
    return (float(left), float(right)) if min(left, right) > 0 else (0.0, 0.0)


@drawn
def _in_gap(rng: np.random.Generator, side: int | None = None) -> Any:
    """Draw a point in one of the four gaps; 0 is ahead, then counterclockwise."""
    half = float(np.round(rng.uniform(0.1, 0.5), 2))
    distance = half * rng.uniform(1.05, 1.38)
    gap = np.arccos(half / distance)
    k = int(rng.integers(4)) if side is None else side
    angle = k * np.pi / 2 + rng.uniform(-0.8, 0.8) * gap
    return distance * np.array([np.cos(angle), np.sin(angle)]), half


check_free_turn = Check(
    _free_turn,
    "left, right",
    {
        "a point straight ahead": ([0.25, 0.0], 0.2),
        "ahead, left or right of the middle": _in_gap(0),
        "on the left side": _in_gap(1),
        "behind": _in_gap(2),
        "on the right side": _in_gap(3),
        "beyond the reach of the corners": ([0.2, 0.21], 0.2),
        "inside the body": ([0.19, 0.15], 0.2),
        "inside the body, beside a corner": ([0.195, 0.195], 0.2),
        "at the centre": ([0.0, 0.0], 0.2),
        "any gap": _in_gap(),
    },
    {
        "left and right are exchanged: when the robot turns left, the point moves right": (
            "left, right = gap + bearing, gap - bearing"
            " => left, right = gap - bearing, gap + bearing"
        ),
        "both ways are the gap: that holds in its middle only": (
            "left, right = gap + bearing, gap - bearing => left, right = gap, gap"
        ),
        "the direction is counted from the front: count it from the nearest side": (
            "bearing -= np.pi / 2 * np.rint(bearing / (np.pi / 2)) => pass"
        ),
        "the gap has the half angle arccos(h / d), not arcsin": "np.arccos => np.arcsin",
        "this is the whole gap: half of it lies on either side of the middle": (
            "np.arccos(half / max(distance, half)) => 2 * np.arccos(half / max(distance, half))"
        ),
        "where the corners do not reach it may turn as it likes": (
            "return np.inf, np.inf => return np.pi / 4, np.pi / 4"
        ),
        "the corners reach half sqrt(2), not half": (
            "distance >= half * np.sqrt(2) => distance >= half"
        ),
        "a point that the corners can reach may still leave some room: how much is due": (
            "gap = np.arccos(half / max(distance, half)) => return 0.0, 0.0"
        ),
        "inside the body there is no room to turn": (
            "if min(left, right) > 0 else (0.0, 0.0)"
            " => if min(left, right) > -np.inf else (0.0, 0.0)"
        ),
    },
)


# Exercise 2: what the body sweeps.


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
            "x < half + step => x < step"
        ),
        "one flank was forgotten: take the absolute value of y": "np.abs(y) < half => y < half",
        "the other flank was forgotten: take the absolute value of y": (
            "np.abs(y) < half => y > -half"
        ),
        "the body reaches half a side behind its centre too: begin at -half": (
            "x > -half => x > 0"
        ),
        "the body that stands at the start counts as well: begin at -half, not at half": (
            "x > -half => x > half"
        ),
        "everything behind the robot was hit as well: the area begins at -half": (
            " & (x > -half) => "
        ),
        "everything ahead was hit as well: the way ends at half + step": (
            " & (x < half + step) => "
        ),
        "the whole side was taken for half of it": lambda p, h, w: _swept(p, 2 * h, w),
        "half was halved: it is half the side already": lambda p, h, w: _swept(p, h / 2, w),
        "x and y were exchanged: x points ahead, y to the left": "x, y = => y, x =",
        "a point on the border is only touched: use < and not <=": (
            "np.abs(y) < half => np.abs(y) <= half",
            "x > -half => x >= -half",
            "x < half => x <= half",
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


# Exercise 3: four quarters, and not back.


def _quarter_beams(ranges: Array, degrees: Array, back: float) -> Ints:
    """Index of the longest beam of each quarter, without those within 45 degrees of `back`."""
    best = []
    for low in (0, 90, 180, 270):
        inside = np.flatnonzero((degrees >= low) & (degrees < low + 90))
        beam = inside[np.argmax(ranges[inside])]
        if abs((degrees[beam] - back + 180) % 360 - 180) > 45:
            best.append(beam)
    return np.array(best, dtype=int)


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
            "degrees >= low) => degrees >= (160 if low == 180 else low))"
        ),
        "the way back was kept: drop beams within 45 degrees of it": "> 45 => > -1",
        "350 and 10 degrees are 20 apart: wrap the difference of directions": (
            "abs((degrees[beam] - back + 180) % 360 - 180) => abs(degrees[beam] - back)"
        ),
        "the beams near the way back were dropped before the longest was taken: take the longest "
        "of each quarter first": (
            "ranges[inside]"
            " => ranges[inside] * (np.abs((degrees[inside] - back + 180) % 360 - 180) > 45)"
        ),
        "exactly 45 degrees is within 45 degrees": "> 45 => >= 45",
        "45 degrees to either side, not in all": "> 45 => > 22.5",
        "45 degrees, not 90": "> 45 => > 90",
        "a beam on a border belongs to the quarter that begins there": (
            "degrees >= low => degrees > low",
            "degrees < low + 90 => degrees <= low + 90",
        ),
        "count beams from the first of the scan, not of the quarter": (
            "best.append(beam) => best.append(beam - inside[0])"
        ),
        "these are the shortest beams": "argmax => argmin",
        "these lead back: the others are due": "> 45 => <= 45",
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


# Exercise 4: a bug to find.


def _free_step(points: Array, half: float, margin: float) -> float:
    """How far (m) a square may drive ahead and keep `margin` to points (k, 2); inf if for ever."""
    x, y = points.T
    ahead = x[(np.abs(y) < half + margin) & (x > 0)]
    return float(max(ahead.min() - half - margin, 0.0)) if len(ahead) else np.inf


_FLANK, _SPARE = "np.abs(y) < half + margin", "ahead.min() - half - margin"


def _posts(rng: np.random.Generator) -> Any:
    half, margin = np.round(rng.uniform([0.1, 0.01], [0.4, 0.2]), 2)
    points = rng.uniform([-1, -1], [3, 1], (int(rng.integers(1, 12)), 2))
    return np.round(points, 2), half, margin


check_free_step = Check(
    _free_step,
    "step",
    {
        "a wall ahead": ([[1.0, -0.1], [1.0, 0.0], [1.0, 0.1]], 0.15, 0.05),
        "a door post within the margin": ([[0.6, 0.18], [2.0, 0.0]], 0.15, 0.05),
        "a door post beside the margin": ([[0.6, 0.21], [0.7, -0.21], [2.0, 0.0]], 0.15, 0.05),
        "no margin": ([[0.6, 0.18], [0.8, -0.1]], 0.15, 0.0),
        "what is behind does not count": ([[-0.3, 0.0], [0.9, 0.0]], 0.15, 0.05),
        "nothing in the way": ([[1.0, 2.0], [-1.0, 0.0]], 0.15, 0.05),
        "no points": (np.zeros((0, 2)), 0.15, 0.05),
        "nearer than the margin: not backwards": ([[0.25, 0.0]], 0.25, 0.125),
        "exactly at the margin beside": ([[1.0, 0.375]], 0.25, 0.125),
        "exactly beside the centre": ([[0.0, 0.25]], 0.25, 0.125),
        "any posts": _posts,
    },
    {
        "the margin is missing beside the body: the flanks need room as well as the front": (
            f"{_FLANK} => np.abs(y) < half"
        ),
        "the margin is missing ahead": f"{_SPARE} => ahead.min() - half",
        "the front stands half a side ahead of the centre: take it off": (
            f"{_SPARE} => ahead.min() - margin"
        ),
        "this is how far the centre may go: take off half a side and the margin": (
            f"{_SPARE} => ahead.min()"
        ),
        "every point ahead counts, though the body passes beside it": (
            f"{_FLANK} => np.abs(y) < np.inf"
        ),
        "points behind the robot count: it drives ahead": " & (x > 0) => ",
        "one flank was forgotten: take the absolute value of y": (
            f"{_FLANK} => y < half + margin"
        ),
        "the other flank was forgotten: take the absolute value of y": (
            f"{_FLANK} => y > -half - margin"
        ),
        "a step is never negative: a robot that is too near stays": (
            "max(ahead.min() - half - margin, 0.0) => (ahead.min() - half - margin)"
        ),
        "where nothing is in the way it may go on for ever": "else np.inf => else 0.0",
        "this is the distance of the nearest point: how far it is ahead counts": (
            "ahead = x[ => ahead = np.hypot(x, y)["
        ),
        "the farthest point ahead was taken: the nearest stops the robot": (
            "ahead.min() => ahead.max()"
        ),
    },
    edges=("no points",),
)


# Exercise 5: the frontier.


def _frontier(state: Ints) -> Any:
    """Free cells (1) with an unknown one (0) above, below, left or right; 2 is occupied."""
    return _beside(state == 0) & (state == 1)


def _beside(
    mask: Any, diagonal: bool = False, outside: bool = False, sides: Any = slice(4)
) -> Any:
    padded = np.pad(mask, 1, constant_values=outside)
    steps = [(0, 1), (1, 0), (0, -1), (-1, 0)][sides]
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
            lambda s: _beside(s == 0, sides=slice(2)) & (s == 1)
        ),
        "only left and right were looked at": (
            lambda s: _beside(s == 0, sides=slice(0, 4, 2)) & (s == 1)
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


# Exercise 6: the way to the frontier, assembled and run.


def _way_to_frontier(state: Ints, cell: Ints) -> Any:
    """Cells (k, 2) of a shortest way from a free cell to the nearest frontier cell, both in it.

    It steps up, down, left and right through free cells; shape (0, 2) if no frontier is reached.
    """
    edge, start = _frontier(state), tuple(cell.tolist())
    before: dict[Any, Any] = {start: None}
    queue = [start]
    for here in queue:
        if edge[here]:
            way = [here]
            while before[way[-1]] is not None:
                way.append(before[way[-1]])
            return np.array(way[::-1])
        for step in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            there = (here[0] + step[0], here[1] + step[1])
            if min(there) >= 0 and there[0] < len(state) and there[1] < len(state[0]):
                if state[there] == 1 and there not in before:
                    before[there] = here
                    queue.append(there)
    return np.zeros((0, 2), dtype=int)


def _fault(way: Any, state: Ints, cell: Ints) -> str:
    """Say what is wrong with a way; nothing if it is one of the shortest."""
    try:
        cells = np.array(way, dtype=float)
    except (TypeError, ValueError):
        return "the cells of the way are due, an array of shape (k, 2)"
    due = len(_way_to_frontier(state, cell))
    if cells.size == 0:
        return "" if due == 0 else f"nothing came: there is a way of {due} cells"
    if cells.ndim != 2 or cells.shape[1] != 2 or (cells != np.rint(cells)).any():
        return f"rows and columns are due, shape (k, 2): shape {cells.shape} came"
    cells = cells.astype(int)
    inside = ((cells >= 0) & (cells < state.shape)).all()
    if not inside or (state[tuple(cells.T)] != 1).any():
        return "the way leads through a cell that is not free, or off the map"
    if (cells[0] != cell).any():
        return "the way must begin at the robot's cell"
    if (np.abs(np.diff(cells, axis=0)).sum(1) != 1).any():
        return "the way jumps: it steps to the cell above, below, left or right"
    if not _frontier(state)[tuple(cells[-1])]:
        return "the way does not end at a frontier cell"
    return "" if len(cells) == due else f"a way of {len(cells)} cells came, {due} are enough"


def _toured(way: Function, world: Ints, cell: Ints) -> str:
    """Explore a world whose cells are seen from two cells away; say what is wrong."""
    known, moves = np.zeros_like(world), 0
    for _ in range(200):
        low, high = np.maximum(cell - 2, 0), cell + 3
        known[low[0] : high[0], low[1] : high[1]] = world[low[0] : high[0], low[1] : high[1]]
        cells = way(known.copy(), cell.copy())
        wrong = _fault(cells, known, cell)
        if wrong:
            return f"after {moves} moves: {wrong}"
        if len(cells) == 0:
            seen = np.mean(known[world == 1] == 1)
            due = f"{seen:.0%} of the floor is seen in {moves} moves, all of it in 250 is due"
            return "" if seen == 1 and moves <= 250 else due
        cell, moves = np.array(cells[-1], dtype=int), moves + len(cells) - 1
    return "after 200 ways it is still exploring"


def _explored(way: Function, state: Ints, cell: Ints) -> Any:
    """Judge one way, or a whole tour through the world state[0]."""
    if state.ndim == 3:
        return _toured(way, state[0], cell)
    return _fault(way(state, cell), state, cell)


def _two_rooms() -> Ints:
    """Return a flat of two rooms, a corridor and a cupboard that nobody can enter."""
    flat = np.ones((17, 24), dtype=int)
    flat[[0, -1]], flat[:, [0, -1]] = 2, 2
    flat[6], flat[10] = 2, 2
    flat[6, 5] = flat[10, 18] = flat[6, 20] = 1
    flat[1:6, 11] = 2
    flat[11:16, 8] = 2
    flat[13, 8] = 1
    flat[2:5, 15:18] = 2
    return flat[None]


def _a_place(rng: np.random.Generator) -> Any:
    state = rng.choice([0, 1, 1, 1, 1, 1, 2, 2], size=rng.integers(4, 12, 2))
    cell = rng.integers(state.shape)
    state[tuple(cell)] = 1
    return state, cell


def _big(rng: np.random.Generator) -> Any:
    state = np.where(rng.random((14, 17)) < 0.25, 2, 1)
    corner = rng.integers(0, 3, 2)
    state[tuple(corner)] = 1
    state[9:, 12:] = 0
    return state, corner


def _from(measure: Function) -> Function:
    """Return a search that goes to another frontier cell than the nearest by steps."""

    def wrong(state: Ints, cell: Ints) -> Any:
        edges = np.argwhere(_frontier(state))
        if not len(edges):
            return np.zeros((0, 2), dtype=int)
        goal = edges[int(np.argmin(measure(edges, cell)))]
        only = np.where(state == 0, 2, state)
        ways = _ways(only, cell)
        return ways.get(tuple(goal.tolist()), np.zeros((0, 2), dtype=int))

    return wrong


def _ways(state: Ints, cell: Ints) -> dict[Any, Any]:
    """Return shortest ways to all cells that can be reached."""
    start = tuple(cell.tolist())
    ways, queue = {start: [start]}, [start]
    for here in queue:
        for step in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            there = (here[0] + step[0], here[1] + step[1])
            inside = min(there) >= 0 and there[0] < len(state) and there[1] < len(state[0])
            if inside and state[there] == 1 and there not in ways:
                ways[there] = [*ways[here], there]
                queue.append(there)
    return ways


check_way = Check(
    _way_to_frontier,
    "way",
    {
        "the robot stands on the frontier": ([[1, 0], [1, 1]], [0, 0]),
        "a corridor": ([[2, 2, 2, 2], [1, 1, 1, 0], [2, 2, 2, 2]], [1, 0]),
        "round a corner": ([[1, 1, 1], [1, 2, 1], [1, 2, 0]], [2, 0]),
        "near through the wall, far on foot": (
            [[1, 2, 0, 0], [1, 2, 1, 1], [1, 2, 2, 1], [1, 1, 1, 1]],
            [1, 0],
        ),
        "everything is seen": (np.ones((3, 3), dtype=int), [1, 1]),
        "a frontier that cannot be reached": ([[1, 1, 2, 1, 0]], [0, 0]),
        "any map": _a_place,
        "a larger map": _big,
        "a tour of a flat": (_two_rooms(), [3, 3]),
    },
    {
        "the frontier cell nearest as the crow flies is not the nearest on foot": _from(
            lambda edges, cell: np.hypot(*(edges - cell).T)
        ),
        "the farthest frontier cell came: the nearest is due": _from(
            lambda edges, cell: -np.hypot(*(edges - cell).T)
        ),
        "the first frontier cell of the map came: the nearest is due": _from(
            lambda edges, cell: np.arange(len(edges))
        ),
        "the way leads through unknown cells: free ones only": (
            "if state[there] == 1 and there not in before:"
            " => if state[there] != 2 and there not in before:",
            "if edge[here]: => if state[here] == 0:",
        ),
        "the way begins at the frontier: it must begin at the robot": "way[::-1] => way",
        "the robot's own cell is missing: the way begins there": (
            "way[::-1]) => way[::-1][1:]).reshape(-1, 2)"
        ),
        "this goes deep first: the first way found is not the shortest": (
            "for here in queue: => while queue:\n        here = queue.pop()"
        ),
        "it walks through walls": (
            "if state[there] == 1 and there not in before: => if there not in before:"
        ),
    },
    use=_explored,
)
