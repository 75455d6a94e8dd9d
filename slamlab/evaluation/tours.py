"""How a drive went: metres, floor seen, squares entered again, metres to a wanted view.

Functions of a log with truth, whoever drove: P5, 3.3 gives pictures in place of such numbers.
Chapters 09, 18 and 20.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from slamlab._checks import Array, as_array, as_instance, as_scalar
from slamlab.logs import Log
from slamlab.models import World
from slamlab.navigation.exploration_grid import UNKNOWN, ExplorationGrid

__all__ = ["collisions", "coverage", "path_length", "reached_at", "revisits"]


def path_length(log: Log) -> Array:
    """Metres driven after each step, shape (T,) or, of a batch, (T, M).

    Examples
    --------
    >>> log = Log([0, 1], [[0, 0], [0, 0]], [0, 1], np.eye(2), truth=[[0, 0, 0], [3, 4, 0]])
    >>> path_length(log).tolist()
    [0.0, 5.0]
    """
    truth = _truth(log)
    steps = np.hypot(*np.moveaxis(np.diff(truth[..., :2], axis=0), -1, 0))
    return np.concatenate([np.zeros((1, *steps.shape[1:])), np.cumsum(steps, axis=0)])


def collisions(log: Log) -> NDArray[np.intp]:
    """Motions so far that met an obstacle, shape (T,): what `simulation.record` noted."""
    if "hit" not in as_instance("log", log, Log).notes:
        raise ValueError("log: expected one with notes of hits, such as simulation.record writes")
    return np.cumsum(log.notes["hit"], axis=0)


def coverage(log: Log, world: World, resolution: float = 0.05) -> Array:
    """Part of the free floor that the scans of a log show, from where they were truly taken.

    Parameters
    ----------
    log : Log
        With scans and truth.
    world : World
    resolution : float, default 0.05
        Side of the cells that are counted (m).

    Returns
    -------
    ndarray, shape (T,)
        In [0, 1], after each step: of the cells whose centre is free and connected with the start.

    Raises
    ------
    ValueError
        If the robot does not start on free floor, or there is none.
    """
    truth = _truth(log)
    if log.ranges is None or log.scan is None:
        raise ValueError("log: expected one with scans, got ranges=None")
    floor = ExplorationGrid(as_instance("world", world, World).bounds, resolution)
    reachable = _reachable(world, floor, truth[0])
    seen = []
    for pose, ranges in zip(truth, log.ranges, strict=True):
        floor.insert(pose, ranges, log.scan)
        seen.append(((floor.state != UNKNOWN) & reachable).sum())
    return np.array(seen) / reachable.sum()


def reached_at(length: ArrayLike, values: ArrayLike, metres: ArrayLike) -> Array:
    """Read a curve of growing values over driven metres; the last one holds on.

    Parameters
    ----------
    length, values : array_like, shape (T,)
        Such as `path_length` and `coverage` of a log.
    metres : array_like, shape (...)

    Returns
    -------
    ndarray, shape (...)
        The largest value that was reached by then.

    Examples
    --------
    >>> reached_at([0, 1, 2, 3], [0.1, 0.5, 0.7, 0.9], [0.5, 2.0]).tolist()
    [0.1, 0.7]
    """
    length = as_array("length", length, ("T",))
    values = as_array("values", values, (len(length),))
    at = np.searchsorted(length, as_array("metres", metres), side="right") - 1
    return np.asarray(np.maximum.accumulate(values)[np.maximum(at, 0)])


def revisits(log: Log, side: float) -> int:
    """Entries into squares of the floor of the given side (m) that were left before."""
    places, side = _truth(log)[:, :2], as_scalar("side", side, 1e-6, 1e6)
    steps = np.diff(places, axis=0)
    counts = np.maximum(np.ceil(4 * np.hypot(*steps.T) / side).astype(int), 1)
    legs = zip(places[:-1], steps, counts, strict=True)
    parts = [a + np.linspace(0, 1, n + 1)[1:, None] * d for a, d, n in legs]
    squares = np.floor(np.concatenate([places[:1], *parts]) / side).astype(int)
    entered = squares[np.r_[True, (np.diff(squares, axis=0) != 0).any(axis=1)]]
    return len(entered) - len(np.unique(entered, axis=0))


def _truth(log: Log) -> Array:
    as_instance("log", log, Log)
    if log.truth is None or len(log) == 0:
        raise ValueError("log: expected one with truth, got truth=None or no step")
    return log.truth


def _reachable(world: World, floor: ExplorationGrid, start: Array) -> NDArray[np.bool_]:
    """Cells whose centre is free and connected with the start, shape (rows, columns)."""
    free = world.is_free(floor.centres())
    if not free.any():
        raise ValueError("world: expected free floor, every cell is occupied")
    labels, _ = ndimage.label(free)
    label = labels[floor.cell(start[:2])]
    if label == 0:
        raise ValueError(f"log: expected a start on free floor, got {start}")
    return np.asarray(labels == label)
