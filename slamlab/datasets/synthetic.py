"""A synthetic pose graph of any size: a walk along the streets of a square town.

The graphs of Olson 2006 (Manhattan) and P5's 1802 poses with 3546 edges are of this kind.
Chapter 13 and the benchmarks use it.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slamlab._checks import Array, as_count, as_positive, as_rng
from slamlab.geometry import between, wrap_angle
from slamlab.robots import RelativePose, dead_reckoning
from slamlab.slam import PoseGraph

__all__ = ["ManhattanGraph", "manhattan_graph", "town_with_false_closures"]


class ManhattanGraph(NamedTuple):
    """A graph that starts from dead reckoning, and the truth behind it.

    Attributes
    ----------
    graph : PoseGraph
        The first ``n_poses - 1`` edges are odometry in order, the others loop closures.
    truth : ndarray, shape (n_poses, 3)
        True poses x, y (m), theta (rad).
    """

    graph: PoseGraph
    truth: Array


def manhattan_graph(
    n_poses: int,
    n_edges: int,
    rng: np.random.Generator,
    *,
    sigma_position: float = 0.05,
    sigma_heading: float = 0.01,
) -> ManhattanGraph:
    """Walk in steps of one metre, turn at crossings, and measure near poses seen before.

    Parameters
    ----------
    n_poses : int
        At least 2.
    n_edges : int
        From ``n_poses - 1`` (odometry alone) to ``n_poses (n_poses - 1) / 2`` (every pair).
    rng : numpy.random.Generator
    sigma_position : float, default 0.05
        Standard deviation of each coordinate of every measurement (m), positive.
    sigma_heading : float, default 0.01
        Standard deviation of its angle (rad), positive.

    Returns
    -------
    ManhattanGraph

    Examples
    --------
    >>> town = manhattan_graph(100, 130, np.random.default_rng(1))
    >>> town.graph.optimize().chi2 < town.graph.chi2()
    True
    """
    n_poses = as_count("n_poses", n_poses, 2)
    n_edges = as_count("n_edges", n_edges, n_poses - 1)
    most = n_poses * (n_poses - 1) // 2
    if n_edges > most:
        raise ValueError(f"n_edges: expected at most {most} for {n_poses} poses, got {n_edges}")
    rng = as_rng("rng", rng)
    position = as_positive("sigma_position", sigma_position, 1e6)
    sigma = np.array([position, position, as_positive("sigma_heading", sigma_heading, 1e6)])
    truth = _walk(n_poses, rng)
    odometry = np.column_stack([np.arange(n_poses - 1), np.arange(1, n_poses)])
    edges = np.concatenate([odometry, _closures(truth, n_edges - n_poses + 1, rng)])
    exact = between(truth[edges[:, 0]], truth[edges[:, 1]])
    measurements = exact + sigma * rng.standard_normal(exact.shape)
    measurements[:, 2] = wrap_angle(measurements[:, 2])
    start = dead_reckoning(RelativePose(), truth[0], measurements[: n_poses - 1], 1.0)
    return ManhattanGraph(PoseGraph(start, edges, measurements, np.diag(sigma**-2)), truth)


def _walk(n_poses: int, rng: np.random.Generator) -> Array:
    # Blocks are five metres long; the town is as large as the walk can cover about twice.
    half = 5 * max(1, int(np.sqrt(n_poses / 8) / 2))
    poses = np.zeros((n_poses, 3))
    x, y, quarter = 0, 0, 0
    for k in range(1, n_poses):
        x, y = x + (1, 0, -1, 0)[quarter], y + (0, 1, 0, -1)[quarter]
        if x % 5 == 0 and y % 5 == 0:
            quarter = (quarter + int(rng.choice([-1, 0, 1]))) % 4
        while max(abs(x + (1, 0, -1, 0)[quarter]), abs(y + (0, 1, 0, -1)[quarter])) > half:
            quarter = (quarter + int(rng.choice([-1, 1]))) % 4
        poses[k] = x, y, quarter * np.pi / 2
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses


def _closures(truth: Array, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw pairs of poses that are near in space and not neighbours in time."""
    if count == 0:
        return np.zeros((0, 2), dtype=np.intp)
    radius = 1.5
    while True:
        pairs = cKDTree(truth[:, :2]).query_pairs(radius, output_type="ndarray")
        pairs = pairs[pairs[:, 1] - pairs[:, 0] > 1]
        if len(pairs) >= count:
            break
        radius *= 1.5
    chosen = np.sort(rng.choice(len(pairs), size=count, replace=False))
    return pairs[chosen]


@cache
def town_with_false_closures(town: int) -> tuple[PoseGraph, NDArray[np.bool_]]:
    """Town number `town` as dead reckoning draws it, with six false closures among 61 true ones.

    Parameters
    ----------
    town : int
        Seed of the town, at least 0.

    Returns
    -------
    PoseGraph
        200 poses, 61 true closures and six false ones.
    ndarray of bool, shape (266,)
        Which of its edges are false.

    Examples
    --------
    >>> graph, false = town_with_false_closures(3)
    >>> len(graph.poses), int(false.sum())
    (200, 6)
    """
    rng = np.random.default_rng(as_count("town", town))
    base = manhattan_graph(200, 260, rng, sigma_heading=0.05).graph
    pairs = np.array([np.sort(rng.choice(200, 2, replace=False)) for _ in range(6)])
    wrong = np.column_stack([rng.uniform(-1, 1, (6, 2)), rng.uniform(-3, 3, 6)])
    edges, measurements = np.vstack([base.edges, pairs]), np.vstack([base.measurements, wrong])
    return PoseGraph(base.poses, edges, measurements, base.information[0]), np.arange(266) >= 260
