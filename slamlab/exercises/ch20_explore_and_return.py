"""Checks of chapter 20: the way back, the time to turn, a memory that moves, a claim, a share."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose
from slamlab.exercises._report import Array, Check, Ints
from slamlab.geometry import compose, inverse, transform

__all__ = [
    "check_inside",
    "check_least_share",
    "check_relaid",
    "check_retraced",
    "check_turn_back",
]


# Exercise 1: the way back, with a pencil.


def _retraced(steps: Array) -> Array:
    """Return the motions (n, 3) that undo motions (n, 3), the last one first."""
    c, s = np.cos(steps[::-1, 2]), np.sin(steps[::-1, 2])
    x, y, turn = steps[::-1].T
    return np.stack([-c * x - s * y, s * x - c * y, -turn], 1)


def _steps(rng: np.random.Generator) -> Any:
    return (np.round(rng.uniform(-1, 1, (rng.integers(2, 6), 3)), 2),)


check_retraced = Check(
    _retraced,
    "steps",
    {
        "a metre ahead": ([[1.0, 0.0, 0.0]],),
        "a turn, then a metre": ([[0.0, 0.0, 0.5], [1.0, 0.0, 0.0]],),
        "an arc": ([[1.0, 0.3, 0.6]],),
        "any way out": _steps,
    },
    {
        "the last motion must be undone first": lambda p: _retraced(p)[::-1],
        "the signs are turned, but a motion is undone in the frame in which it ended": lambda p: (
            -p[::-1]
        ),
        "the displacement is turned the wrong way: it is seen from the end of the motion": (
            "-c * x - s * y, s * x - c * y => -c * x + s * y, -s * x - c * y"
        ),
        "these are motions back tail first with the nose turning on": "-turn => turn",
        "these are the motions of the way out, in another order": lambda p: p[::-1],
    },
)


# Exercise 2: when to turn back.


def _turn_back(driven: float, home: float, budget: float, reserve: float) -> bool:
    """Whether the way home, and a reserve on it, needs what is left of the budget (m)."""
    return driven + reserve * home >= budget


def _journey(rng: np.random.Generator) -> Any:
    return tuple(np.round(rng.uniform([5, 1, 20, 1], [60, 40, 90, 2]), 1).tolist())


check_turn_back = Check(
    _turn_back,
    "turn",
    {
        "at the start there is nothing to fear": (0.0, 0.0, 50.0, 1.3),
        "half the budget is gone, and home is as far": (25.0, 25.0, 50.0, 1.0),
        "the reserve decides": (25.0, 20.0, 50.0, 1.3),
        "home is near: drive on": (45.0, 2.0, 50.0, 1.3),
        "any journey": _journey,
    },
    {
        "the reserve belongs to the way home alone": (
            "driven + reserve * home => reserve * (driven + home)"
        ),
        "without the reserve the first closed door is the end": "reserve * home => home",
        "exactly enough is the last moment": ">= => >",
        "this says when it may drive on": ">= => <",
        "it turns round whatever the numbers say": lambda driven, home, budget, reserve: True,
        "it never turns round": lambda driven, home, budget, reserve: False,
        "what is driven already is gone from the budget too": (
            "driven + reserve * home => reserve * home"
        ),
    },
    draws=30,
)


# Exercise 3: a bug to find.


def _relaid(points: Array, nodes: Ints, before: Array, after: Array) -> Array:
    """Return remembered points (n, 2), each moved with its node from `before` to `after`."""
    seen = transform(inverse(before[nodes]), points[:, None])
    moved: Array = transform(after[nodes], seen)[:, 0]
    return moved


def _graph(rng: np.random.Generator) -> Any:
    before = np.array([a_pose(rng) for _ in range(4)])
    after = compose(before, np.round(rng.normal(0, 0.3, (4, 3)), 2))
    n = int(rng.integers(2, 6))
    return np.round(rng.uniform(-4, 4, (n, 2)), 2), rng.integers(0, 4, n), before, after


check_relaid = Check(
    _relaid,
    "points",
    {
        "nothing moved": ([[1.0, 2.0]], [0], [[0.0, 0.0, 0.3]], [[0.0, 0.0, 0.3]]),
        "a node was pushed": ([[1.0, 2.0]], [0], [[0.0, 0.0, 0.0]], [[0.5, -1.0, 0.0]]),
        "a node was turned": ([[1.0, 0.0]], [0], [[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.5]]),
        "any graph": _graph,
    },
    {
        "the points are pushed with their nodes and not turned": lambda p, n, b, a: (
            p + (np.asarray(a) - b)[n, :2]
        ),
        "all points moved with the last node: each has its own": lambda p, n, b, a: _relaid(
            p, np.full(len(n), len(b) - 1), b, a
        ),
        "the old pose must be undone: inverse(before)": (
            "inverse(before[nodes]) => before[nodes]"
        ),
        "from the new poses to the old ones": lambda p, n, b, a: _relaid(p, n, a, b),
        "the points were taken for points in the frame of their node": lambda p, n, b, a: (
            transform(np.asarray(a)[n], p[:, None])[:, 0]
        ),
    },
)


# Exercise 4: does the robot know how far it is off?


def _inside(errors: Array, covs: Array) -> float:
    """Return the share of errors (n, 2) inside the 95 % ellipses of their covariances."""
    squared = (errors * np.linalg.solve(covs, errors[..., None])[..., 0]).sum(-1)
    return float(np.mean(squared < -2 * np.log(0.05)))


def _ends(rng: np.random.Generator) -> Any:
    n = int(rng.integers(8, 20))
    covs = np.array([a_covariance(rng, 2) for _ in range(n)])
    errors = [np.linalg.cholesky(P) @ rng.normal(0, 2, 2) for P in covs]
    return np.round(errors, 3), covs


check_inside = Check(
    _inside,
    "share",
    {
        "one inside, one outside": ([[2.4, 0.0], [2.5, 0.0]], [np.eye(2), np.eye(2)]),
        "a long ellipse": ([[2.0, -2.0], [2.0, 2.0]], [[[1.0, 0.9], [0.9, 1.0]]] * 2),
        "any ends": _ends,
    },
    {
        "1.96 sigma is a gate of one dimension: in the plane 5.99 bounds the square": (
            "-2 * np.log(0.05) => 1.96**2"
        ),
        "the square was compared with the root of the bound": (
            "-2 * np.log(0.05) => np.sqrt(-2 * np.log(0.05))"
        ),
        "the covariance was multiplied, not divided by": (
            "np.linalg.solve(covs, errors[..., None]) => (covs @ errors[..., None])"
        ),
        "each axis for itself: the correlation is missing": lambda e, P: float(
            np.mean((e**2 / np.diagonal(P, axis1=1, axis2=2)).sum(-1) < -2 * np.log(0.05))
        ),
        "95 % lie inside: 1 - exp(-c / 2) is 0.95, so exp(-c / 2) is 0.05": (
            "np.log(0.05) => np.log(0.95)"
        ),
        "this is the share outside": lambda e, P: 1 - _inside(e, P),
    },
    draws=12,
)


# Exercise 5: how much do n runs prove?


def _least_share(successes: int, runs: int) -> float:
    """Return the lower end of Wilson's 95 % interval for the share of successes."""
    p, z = successes / runs, 1.96
    middle = p + z**2 / (2 * runs)
    spread = z * np.sqrt(p * (1 - p) / runs + z**2 / (4 * runs**2))
    return float((middle - spread) / (1 + z**2 / runs))


def _trials(rng: np.random.Generator) -> Any:
    runs = int(rng.integers(2, 40))
    return int(rng.integers(0, runs + 1)), runs


check_least_share = Check(
    _least_share,
    "share",
    {
        "three of three prove little": (3, 3),
        "thirty of thirty": (30, 30),
        "none of ten": (0, 10),
        "any count": _trials,
    },
    {
        "this is the share itself": "(middle - spread) / (1 + z**2 / runs) => p",
        "this is the upper end": "middle - spread => middle + spread",
        "p - z sqrt(p (1 - p) / n) says that three of three prove everything": lambda k, n: float(
            k / n - 1.96 * np.sqrt(k / n * (1 - k / n) / n)
        ),
        "the last division is missing": " / (1 + z**2 / runs) => ",
        "the root needs z^2 / (4 n^2), not z^2 / (4 n)": "(4 * runs**2) => (4 * runs)",
    },
    draws=12,
)
