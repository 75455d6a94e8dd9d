"""Checks of chapter 13: a graph on a line, the blocks of an edge, frames, kernels, a whole graph.

Formulas (A), (B), (E) and (F) of the chapter; Grisetti et al. 2010, Agarwal et al. 2013.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.datasets import town_with_false_closures
from slamlab.exercises._draw import a_covariance, a_pose, an_angle
from slamlab.exercises._report import Array, Check, Function
from slamlab.geometry import between, compose, rotation
from slamlab.slam import PoseGraph

__all__ = [
    "check_blocks",
    "check_information",
    "check_line",
    "check_map",
    "check_weight",
    "check_widths",
]


# Exercise 1: three poses on a line.


def _line(z: Array, w: Array) -> Array:
    """Positions x_1, x_2, shape (2,), from z_01, z_12, z_02, shape (3,), with weights w (3,)."""
    # (x_1 - z_01), (x_2 - x_1 - z_12), (x_2 - z_02)
    J = np.array([[1.0, 0.0], [-1.0, 1.0], [0.0, 1.0]])
    W = np.diag(w)
    return np.linalg.solve(J.T @ W @ J, J.T @ W @ z)


def _some_line(rng: np.random.Generator) -> Any:
    return np.round(rng.uniform(0.5, 3.0, 3), 2), np.round(rng.uniform(0.5, 4.0, 3), 1)


check_line = Check(
    _line,
    "positions",
    {
        "the 0.3 m of the chapter are shared equally": ([1.0, 1.0, 2.3], [1.0, 1.0, 1.0]),
        "measurements that agree are kept": ([1.0, 2.0, 3.0], [1.0, 5.0, 0.1]),
        "a sure closure is kept, the steps give way": ([1.0, 1.0, 2.3], [1.0, 1.0, 9.0]),
        "anything": _some_line,
    },
    {
        "the closure z_02 was ignored: this is dead reckoning": lambda z, w: np.array(
            [z[0], z[0] + z[1]]
        ),
        "all three count alike: the weights were forgotten": "np.diag(w) => np.eye(3)",
        "the weights are inverted: a large weight means a sure measurement": (
            "np.diag(w) => np.diag(1.0 / w)"
        ),
        "the weights are squared: each error counts w times its square": (
            "np.diag(w) => np.diag(w**2)"
        ),
        "z_12 is the motion from x_1 to x_2: its error is x_2 - x_1 - z_12": (
            "[-1.0, 1.0] => [1.0, -1.0]"
        ),
        "the closure was taken as exact: it has an error like the others": lambda z, w: np.array(
            [z[0] + (z[2] - z[0] - z[1]) * w[1] / (w[0] + w[1]), z[2]]
        ),
    },
)


# Exercise 2: what one edge adds to H and g.


def _blocks(
    A: Array, B: Array, Omega: Array, e: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Blocks H_ii, H_ij, H_jj (3, 3) and pieces g_i, g_j (3,) of an edge, formula (A)."""
    return A.T @ Omega @ A, A.T @ Omega @ B, B.T @ Omega @ B, A.T @ Omega @ e, B.T @ Omega @ e


def _an_edge(rng: np.random.Generator) -> Any:
    A, B = np.round(rng.normal(size=(2, 3, 3)), 2)
    return A, B, a_covariance(rng, 3), np.round(rng.normal(size=3), 2)


check_blocks = Check(
    _blocks,
    "H_ii, H_ij, H_jj, g_i, g_j",
    {
        "no error, no force": (
            -np.eye(3),
            np.eye(3),
            np.diag([4.0, 1.0, 9.0]),
            [0.0, 0.0, 0.0],
        ),
        "poses that face along x": (
            [[-1.0, 0, 2.0], [0, -1.0, -3.0], [0, 0, -1.0]],
            np.eye(3),
            np.diag([4.0, 1.0, 9.0]),
            [0.1, -0.2, 0.05],
        ),
        "any edge": _an_edge,
    },
    {
        "Omega was forgotten": lambda A, B, Omega, e: _blocks(A, B, np.eye(3), e),
        "A and B are exchanged: A is the derivative by pose i": lambda A, B, Omega, e: _blocks(
            B, A, Omega, e
        ),
        "the transposes are on the wrong side: A^T stands on the left": (
            lambda A, B, Omega, e: _blocks(A.T, B.T, Omega, e)
        ),
        "H_ij is transposed: rows belong to pose i, columns to pose j": (
            "A.T @ Omega @ B => B.T @ Omega @ A"
        ),
        "g has the wrong sign: the minus stands in the step -H^-1 g": (
            "A.T @ Omega @ e, B.T @ Omega @ e => -A.T @ Omega @ e, -B.T @ Omega @ e"
        ),
        "the information was inverted: Omega is already the inverse of the covariance": (
            lambda A, B, Omega, e: _blocks(A, B, np.linalg.inv(Omega), e)
        ),
    },
    tolerance=1e-8,
)


# Exercise 3: a covariance in the wrong frame (a bug to find).


def _information(cov: Array, theta_i: float, z: Array) -> Array:
    """Omega (3, 3) of an edge from a covariance (3, 3) in the frame of the world, formula (B)."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(theta_i + z[2]).T
    return np.asarray(np.linalg.inv(turn @ cov @ turn.T), dtype=np.float64)


def _a_match(rng: np.random.Generator) -> Any:
    cov = np.diag([0.09, 0.0004, 0.0001])
    turn = np.eye(3)
    turn[:2, :2] = rotation(an_angle(rng))
    return np.round(turn @ cov @ turn.T, 6), an_angle(rng), a_pose(rng)


_LONG = np.diag([0.09, 0.0004, 0.0001])

check_information = Check(
    _information,
    "Omega",
    {
        "no turn at all: the inverse": (_LONG, 0.0, [1.0, 0.0, 0.0]),
        "a quarter turn exchanges along and across": (_LONG, np.pi / 2, [1.0, 0.0, 0.0]),
        "the turn of the measurement counts too": (_LONG, 0.0, [1.0, 0.0, np.pi / 2]),
        "any match": _a_match,
    },
    {
        "this is the covariance in the frame of the error: the edge needs its inverse": (
            "np.linalg.inv(turn @ cov @ turn.T) => (turn @ cov @ turn.T)"
        ),
        "it was not turned at all: the error does not stand in the frame of the world": (
            "np.linalg.inv(turn @ cov @ turn.T) => np.linalg.inv(cov)"
        ),
        "turned into the frame of pose i only: R_z^T turns the error on into that of pose j": (
            "theta_i + z[2] => theta_i"
        ),
        "turned by the measurement only: the world must first be turned into pose i": (
            "theta_i + z[2] => z[2]"
        ),
        "turned the wrong way round: R^T takes the world into the body": ").T\n => )\n",
        "the measured turn is added to the heading, not taken off": (
            "theta_i + z[2] => theta_i - z[2]"
        ),
    },
    tolerance=1e-6,
)


# Exercise 4: the weight of a kernel.


def _weight(x: float, width: float) -> float:
    """Weight of DCS, formula (E), of an edge with x = e^T Omega e."""
    phi = width**2
    return min(1.0, 2 * phi / (phi + x)) ** 2


check_weight = Check(
    _weight,
    "weight",
    {
        "a small error counts in full": (0.5, 2.0),
        "just at the width it still does": (4.0, 2.0),
        "beyond it the weight falls": (12.0, 2.0),
        "far beyond it is next to nothing": (4000.0, 2.0),
        "a wider kernel is more patient": (4000.0, 50.0),
        "any error": lambda rng: (round(rng.uniform(0, 60), 2), round(rng.uniform(0.5, 9), 2)),
    },
    {
        "the square is missing: s scales the error, so the square of the error gets s^2": (
            " ** 2\n => \n"
        ),
        "Phi is the square of the width": "width**2 => width",
        "the 2 before Phi is missing: then even a perfect edge is doubted": (
            "2 * phi / (phi => phi / (phi"
        ),
        "the weight must never exceed 1: min(1, ...)": (
            "min(1.0, 2 * phi / (phi + x)) => (2 * phi / (phi + x))"
        ),
        "this is Huber's weight, width over distance": lambda x, width: min(
            1.0, width / np.sqrt(max(x, 1e-300))
        ),
        "a hard gate: DCS lets the weight fall gradually": lambda x, width: float(x <= width**2),
    },
)


# Exercise 5: a kernel to tune.


def _outcome(function: Function, town: int) -> Any:
    """Count the true closures that were rejected and the lies that were believed."""
    graph, false = town_with_false_closures(town)
    width = np.atleast_1d(np.asarray(function(town), dtype=float)).tolist()
    result = graph.optimize(kernel="dcs", kernel_width=width, max_iterations=60)
    rejected = result.weights < 0.1
    return int((rejected & graph.closures & ~false).sum()), int((~rejected & false).sum())


def _widths(town: int) -> tuple[float, ...]:
    """Widths of DCS, one after the other; the same for every town."""
    return 30.0, 10.0, 3.0


check_widths = Check(
    _widths,
    "rejected_true, believed_lies",
    {"town 3: no true closure rejected, no lie believed": (3,), "town 9 with the same": (9,)},
    {
        "too strict from the start: true closures look like lies while the map is drifted": (
            lambda town: (1.0,)
        ),
        "the usual width of 2.8 at once is still too strict for a drifted start": (
            lambda town: (2.7955,)
        ),
        "too wide at the end: lies are still believed": lambda town: (30.0,),
        "a kernel that wide is no kernel: every lie is believed": lambda town: (1000.0,),
        "too wide at the start: the lies bend the map before they are doubted": (
            lambda town: (300.0, 100.0, 30.0, 10.0, 3.0)
        ),
        "too strict at the end: honest noise is rejected": lambda town: (30.0, 1.0),
    },
    use=_outcome,
)


# Exercise 6: assemble a pose graph.


def _map_of(odometry: Array, closures: Array, sigma: Array) -> Array:
    """Poses (n + 1, 3) from motions (n, 3) and closures (m, 5): i, j and the relative pose."""
    n = len(odometry)
    start = [np.zeros(3)]
    for motion in odometry:
        start.append(compose(start[-1], motion))
    chain = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    edges = np.vstack([chain, closures[:, :2].astype(int)])
    measurements = np.vstack([odometry, closures[:, 2:]])
    graph = PoseGraph(np.array(start), edges, measurements, np.diag(1.0 / sigma**2))
    return graph.chordal_initialisation().optimize(tolerance=1e-12).poses


def _a_walk(rng: np.random.Generator) -> Any:
    n = 12
    true = [np.zeros(3)]
    for _ in range(n):
        true.append(compose(true[-1], [1.0, 0.0, rng.choice([0.0, np.pi / 2])]))
    path = np.array(true)
    sigma = np.array([0.05, 0.02, 0.03])
    pairs = np.array([(0, 8), (2, 10), (4, 12), (1, 7)])
    z = between(path[pairs[:, 0]], path[pairs[:, 1]]) + sigma * rng.normal(size=(4, 3))
    odometry = between(path[:-1], path[1:]) + sigma * rng.normal(size=(n, 3))
    return np.round(odometry, 3), np.column_stack([pairs, np.round(z, 3)]), sigma


check_map = Check(
    _map_of,
    "poses",
    {
        "without a closure it is dead reckoning": (
            [[1.0, 0.0, 0.5], [1.0, 0.0, 0.5]],
            np.zeros((0, 5)),
            [0.1, 0.1, 0.1],
        ),
        "the line of the chapter": (
            [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
            [[0, 2, 2.3, 0.0, 0.0]],
            [0.1, 0.1, 0.1],
        ),
        "a walk round some blocks": _a_walk,
    },
    {
        "the closures were ignored: this is dead reckoning": lambda odometry, closures, sigma: (
            _map_of(odometry, closures[:0], sigma)
        ),
        "the closures are read backwards: j is seen from i": (
            lambda odometry, closures, sigma: _map_of(
                odometry, closures[:, [1, 0, 2, 3, 4]], sigma
            )
        ),
        "all coordinates count alike: the information is the inverse of the squared sigma": (
            "np.diag(1.0 / sigma**2) => np.eye(3)"
        ),
        "the information is 1 / sigma: the square is missing": "sigma**2 => sigma",
        "sigma^2 is a covariance: the graph wants its inverse": (
            "np.diag(1.0 / sigma**2) => np.diag(sigma**2)"
        ),
        "the start came back: call optimize and return its poses": (
            "graph.chordal_initialisation().optimize(tolerance=1e-12).poses "
            "=> graph.chordal_initialisation().poses"
        ),
        "only the first closure was used": lambda odometry, closures, sigma: _map_of(
            odometry, closures[:1], sigma
        ),
    },
    tolerance=1e-5,
    draws=3,
)
