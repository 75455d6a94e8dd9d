"""Checks of chapter 14: a Jacobian, a weight, a slope with a bug, a bound, an ICP of one's own."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_pose, drawn
from slamlab.exercises._report import Array, Check, Function

__all__ = [
    "check_block_bound",
    "check_icp",
    "check_line_jacobian",
    "check_slope",
    "check_weight",
]


# Exercise 1: the Jacobian of point to line.


def _line_jacobian(pose: Array, point: Array, normal: Array) -> Array:
    """Return the derivative (3,) of n . (R s + p - q) by the pose x, y, psi."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = c * point[0] - s * point[1], s * point[0] + c * point[1]
    return np.array([normal[0], normal[1], normal[1] * x - normal[0] * y])


def _unit(rng: np.random.Generator) -> Array:
    angle = np.round(rng.uniform(-3, 3), 2)
    return np.array([np.cos(angle), np.sin(angle)])


check_line_jacobian = Check(
    _line_jacobian,
    "row",
    {
        "no turn, a wall to the left": ([1.0, 2.0, 0.0], [3.0, 0.5], [0.0, 1.0]),
        "half a turn": ([1.0, 2.0, np.pi], [3.0, 0.5], [0.6, 0.8]),
        "any pose, any wall": lambda rng: (a_pose(rng), rng.normal(size=2), _unit(rng)),
    },
    {
        "the lever is not turned: the scan has turned by psi": lambda p, s, n: np.array(
            [*n, n[1] * s[0] - n[0] * s[1]]
        ),
        "the lever has the wrong sign: a left turn moves a point ahead to the left": (
            "normal[1] * x - normal[0] * y => normal[0] * y - normal[1] * x"
        ),
        "the lever lies along the point: the derivative of R turns it by a quarter": (
            "normal[1] * x - normal[0] * y => normal[0] * x + normal[1] * y"
        ),
        "the lever is missing: a turn moves every point": "normal[1] * x - normal[0] * y => 0.0",
        "the scan was turned backwards": "np.sin(pose[2]) => -np.sin(pose[2])",
        "the lever begins at the robot: p falls out of the derivative": (
            "normal[1] * x - normal[0] * y"
            " => normal[1] * (x + pose[0]) - normal[0] * (y + pose[1])"
        ),
    },
)


# Exercise 2: how much a pair counts.


def _weight(error: Array, width: float) -> Array:
    """Geman and McClure: (width^2 / (width^2 + error^2))^2."""
    return (width**2 / (width**2 + error**2)) ** 2


check_weight = Check(
    _weight,
    "weight",
    {
        "no error counts whole": ([0.0], 0.05),
        "an error of one width": ([0.05, -0.05], 0.05),
        "any errors": lambda rng: (
            np.round(rng.normal(size=6), 3),
            np.round(rng.uniform(0.02, 2), 2),
        ),
    },
    {
        "metres were added to square metres (KISS-ICP's released weight): square the error": (
            lambda e, w: w**2 / (w + e**2) ** 2
        ),
        "the whole fraction is squared": lambda e, w: w**2 / (w**2 + e**2),
        "this is Gauss' bell: it forgets far pairs altogether": (
            lambda e, w: np.exp(-((e / w) ** 2))
        ),
        "this is Huber's weight": lambda e, w: w / np.maximum(w, np.abs(e)),
        "this is one minus the weight": lambda e, w: 1 - _weight(e, w),
        "the error is not squared": lambda e, w: (w**2 / (w**2 + np.abs(e))) ** 2,
    },
)


# Exercise 3: a bug to find.


def _slope(cells: Array, x: float, y: float) -> Array:
    """Slope (2,) of a field in x and y, of cells (rows, columns) with side 1."""
    column, row = int(np.floor(x - 0.5)), int(np.floor(y - 0.5))
    a, b = x - 0.5 - column, y - 0.5 - row
    low, high = cells[row], cells[row + 1]
    dx = (1 - b) * (low[column + 1] - low[column]) + b * (high[column + 1] - high[column])
    dy = (1 - a) * (high[column] - low[column]) + a * (high[column + 1] - low[column + 1])
    return np.array([dx, dy])


_SWAPPED = "a, b = x - 0.5 - column, y - 0.5 - row => b, a = x - 0.5 - column, y - 0.5 - row"


def _cells(rng: np.random.Generator) -> Any:
    return np.round(rng.random((6, 8)), 2), *np.round(rng.uniform([0.6, 0.6], [7.4, 5.4]), 2)


check_slope = Check(
    _slope,
    "slope",
    {
        "a ramp in x": (np.tile(np.arange(5.0), (4, 1)), 1.7, 2.2),
        "a ramp in y": (np.tile(np.arange(4.0)[:, None], (1, 5)), 2.3, 1.6),
        "any cells, any place": _cells,
    },
    {
        "a weighs the slope in y and b that in x: here they have changed places": _SWAPPED,
        "values belong to the centres of cells: half a cell is missing": lambda c, x, y: _slope(
            np.pad(c, 1, mode="edge"), x + 1.5, y + 1.5
        ),
        "x and y were exchanged: cells[row, column], row from y": lambda c, x, y: (
            _slope(c.T, *np.minimum([y, x], [len(c) - 0.6, len(c[0]) - 0.6]))
            if 0.5 <= y <= len(c[0]) - 0.5 and 0.5 <= x <= len(c) - 0.5
            else np.zeros(2)
        ),
        "the two slopes came in the wrong order: x first": lambda c, x, y: _slope(c, x, y)[::-1],
        "this slope is downhill: right minus left, upper minus lower": lambda c, x, y: (
            -_slope(c, x, y)
        ),
        "the fractions count from the other side: at a = 0 the left column counts": (
            "a, b = x - 0.5 - column, y - 0.5 - row"
            " => a, b = 1 - (x - 0.5 - column), 1 - (y - 0.5 - row)"
        ),
    },
    draws=12,
)


# Exercise 4: what a block can promise.


def _block_bound(cells: Array, width: int) -> Array:
    """Largest value (rows, columns) of the block of width x width cells that begins in each."""
    rows, columns = cells.shape
    out = np.zeros((rows, columns))
    for r in range(rows):
        for c in range(columns):
            out[r, c] = cells[r : r + width, c : c + width].max()
    return out


def _grid(rng: np.random.Generator) -> Any:
    shape = rng.integers(2, 8, 2)
    return np.round(rng.random(shape), 2), int(rng.integers(1, 5))


check_block_bound = Check(
    _block_bound,
    "bound",
    {
        "one cell promises itself": (np.arange(6.0).reshape(2, 3) / 6, 1),
        "two by two": ([[0.1, 0.9, 0.2], [0.3, 0.4, 0.5], [0.8, 0.0, 0.6]], 2),
        "a block may hang over the edge": ([[0.2, 0.7], [0.5, 0.1]], 4),
        "any cells, any width": _grid,
    },
    {
        "a mean is no bound: one good cell may still win": "max() => mean()",
        "this is the worst of the block: the best is what it can promise": "max() => min()",
        "the block begins in its cell: this one ends there": lambda m, w: _block_bound(
            m[::-1, ::-1], w
        )[::-1, ::-1],
        "the block has one cell too many on each side": (
            "cells[r : r + width, c : c + width] => cells[r : r + width + 1, c : c + width + 1]"
        ),
        "the block has one cell too few on each side": (
            "cells[r : r + width, c : c + width]"
            " => cells[r : r + max(width - 1, 1), c : c + max(width - 1, 1)]"
        ),
        "the block is square: it reaches across columns as well": "c : c + width => c : c + 1",
    },
    draws=10,
)


# Exercise 5: an ICP of one's own.


def _icp(reference: Array, normals: Array, points: Array, guess: Array) -> Array:
    """Lay points (k, 2) upon the walls through reference (m, 2); the pose (3,)."""
    pose = guess.copy()
    for _ in range(30):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        moved = points @ np.array([[c, s], [-s, c]]) + pose[:2]
        gaps = np.linalg.norm(moved[:, None] - reference, axis=-1)
        j = gaps.argmin(axis=1)
        near = gaps.min(axis=1) < 0.6
        n, arm = normals[j][near], (moved - pose[:2])[near]
        e = ((moved - reference[j])[near] * n).sum(axis=1)
        J = np.column_stack([n, n[:, 1] * arm[:, 0] - n[:, 0] * arm[:, 1]])
        pose = pose + np.linalg.lstsq(J, -e, rcond=None)[0]
    return pose


def _room() -> tuple[Array, Array]:
    """Points on the walls of a room of 5 m x 4 m with a pillar, and their normals."""
    points, normals = [], []
    sides: list[tuple[float, ...]] = [(0, 0, 5, 0), (5, 0, 5, 4), (5, 4, 0, 4), (0, 4, 0, 0)]
    sides += [(3, 1, 3.6, 1.4), (3.6, 1.4, 3.2, 2.0), (3.2, 2.0, 2.6, 1.6), (2.6, 1.6, 3, 1)]
    for x0, y0, x1, y1 in sides:
        length = np.hypot(x1 - x0, y1 - y0)
        t = np.arange(0.05, length - 0.02, 0.1)[:, None] / length
        points.append(np.array([x0, y0]) + t * np.array([x1 - x0, y1 - y0]))
        normals.append(np.tile([y0 - y1, x1 - x0], (len(t), 1)) / length)
    return np.concatenate(points), np.concatenate(normals)


def _scan_of_the_room(pose: Array, rng: np.random.Generator) -> Array:
    """Other points of the same walls, in the frame of a robot; a few are on a passer-by."""
    walls, normals = _room()
    along = np.column_stack([normals[:, 1], -normals[:, 0]])
    seen = (walls + along * rng.uniform(-0.03, 0.03, (len(walls), 1)))[::3]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    own = (seen - pose[:2]) @ np.array([[c, -s], [s, c]])
    return np.concatenate([own, [[30.0, 30.0], [-30.0, 4.0]]])


@drawn
def _task(rng: np.random.Generator, true: Array, off: Array) -> Any:
    pose = np.asarray(true) + rng.uniform(-0.1, 0.1, 3)
    return *_room(), _scan_of_the_room(pose, rng), pose + np.asarray(off), pose


def _gap(
    icp: Function, reference: Array, normals: Array, points: Array, guess: Array, pose: Array
) -> Any:
    """How far from its place the scan ended (m, m, rad)."""
    gap = np.asarray(icp(reference, normals, points, guess), dtype=float) - pose
    gap[2] = np.angle(np.exp(1j * gap[2]))
    return gap


check_icp = Check(
    _icp,
    "how far from its place the scan ended (m; m; rad)",
    {
        "a scan that already lies well": _task(np.array([1.5, 2.0, 0.4]), np.zeros(3)),
        "shifted by 20 cm": _task(np.array([1.5, 2.0, 0.4]), np.array([0.15, -0.13, 0.0])),
        "turned by 6 degrees": _task(np.array([1.2, 1.5, -2.0]), np.array([0.0, 0.0, 0.1])),
        "both, and on the other side of the pillar": _task(
            np.array([4.3, 3.0, 2.8]), np.array([-0.12, 0.1, -0.07])
        ),
    },
    {
        "it ran away: the step goes against the error": "-e => e",
        "two points on a passer-by outweigh the walls: keep near pairs only": (
            "gaps.min(axis=1) < 0.6 => gaps.min(axis=1) < 1e9"
        ),
        "one round is not enough: the pairs were guesses, find them anew": (
            "range(30) => range(1)"
        ),
        "the heading never changes: its column of J is missing": (
            "n[:, 1] * arm[:, 0] - n[:, 0] * arm[:, 1] => 0 * n[:, 0]"
        ),
        "it began at zero: begin at the guess": "guess.copy() => np.zeros(3)",
        "the scan was turned backwards": "[[c, s], [-s, c]] => [[c, -s], [s, c]]",
    },
    tolerance=2e-3,
    draws=3,
    use=_gap,
)
