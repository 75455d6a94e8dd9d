"""Checks of chapter 11: the gate, the joint distance, nothing twice.

P4 (2a), (2b) with the gate that page 84 lacks; joint compatibility after Neira and Tardos (2001).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance
from slamlab.exercises._report import Array, Check, Function, Ints

__all__ = ["check_best_first", "check_joint", "check_nearest"]


# Exercise 1: the nearest landmark inside a gate.


def _squared(y: Array, S: Array) -> Any:
    return np.einsum("ni,nij,nj->n", y, np.linalg.inv(S), y)


def _nearest(y: Array, S: Array, gate: float) -> int:
    """Row of the landmark with the smallest y^T S^-1 y, -1 if none is below the gate."""
    distance = np.einsum("ni,nij,nj->n", y, np.linalg.inv(S), y)
    if not len(distance):
        return -1
    row = int(np.argmin(distance))
    return row if distance[row] < gate else -1


def _by(measure: Function) -> Function:
    def wrong(y: Array, S: Array, gate: float) -> int:
        distance = measure(y, S)
        if not len(distance):
            return -1
        return int(np.argmin(distance)) if distance.min() < gate else -1

    return wrong


def _inside(y: Array, S: Array, gate: float) -> Any:
    return np.flatnonzero(_squared(y, S) < gate)


def _by_likelihood(y: Array, S: Array) -> Any:
    return _squared(y, S) + np.log(np.linalg.det(S))


def _scene(rng: np.random.Generator) -> Any:
    n = int(rng.integers(1, 8))
    S = np.array([a_covariance(rng, 2, size) for size in rng.uniform(0.05, 2, n)])
    return np.round(rng.normal(0, 2, (n, 2)), 2), S, 9.21


_ROUND, _WIDE = np.diag([0.04, 0.01]), np.diag([4.0, 1.0])
_SLANTED = np.array([[1.0, 0.95], [0.95, 1.0]])

check_nearest = Check(
    _nearest,
    "row",
    {
        "two landmarks, equally well known": ([[0.3, 0.1], [0.1, 0.05]], [_ROUND] * 2, 9.21),
        "the vague one is nearer in sigmas": ([[0.5, 0.1], [1.0, 0.3]], [_ROUND, _WIDE], 9.21),
        "correlated errors": ([[1.0, -1.0], [1.3, 1.3]], [_SLANTED, _SLANTED], 9.21),
        "a vague one nearer in sigmas, a sharp one likelier": (
            [[2.0, 0.5], [0.3, 0.05]],
            [_WIDE, _ROUND],
            9.21,
        ),
        "nothing inside the gate": ([[5.0, 0.5], [4.0, 0.0]], [_ROUND] * 2, 9.21),
        "exactly on the gate is not inside": ([[2.0, 0.0]], [np.eye(2)], 4.0),
        "four sigmas are outside a gate of 9.21": ([[0.8, 0.0]], [_ROUND], 9.21),
        "no landmarks yet": (np.zeros((0, 2)), np.zeros((0, 2, 2)), 9.21),
        "the nearest of several inside": (
            [[0.2, 0.1], [0.05, 0.0], [0.3, 0.1], [0.1, 0.0]],
            [_ROUND] * 4,
            9.0,
        ),
        "any scene": _scene,
    },
    {
        "the distance is Euclidean: metres and radians know nothing of the covariance": _by(
            lambda y, S: (y**2).sum(1)
        ),
        "S was multiplied, not inverted: a large doubt must make the distance small": (
            "np.linalg.inv(S)",
            "S",
        ),
        "only the diagonal of S was used: range and bearing errors are correlated": _by(
            lambda y, S: (y**2 / np.diagonal(S, axis1=1, axis2=2)).sum(1)
        ),
        "the gate is for the squared distance: no square root": _by(
            lambda y, S: np.sqrt(_squared(y, S))
        ),
        "the gate is that of the squared distance already: its root was taken": (
            "< gate",
            "< np.sqrt(gate)",
        ),
        "this takes the likeliest landmark, with ln det S: the nearest is asked for": _by(
            _by_likelihood
        ),
        "the gate was not used: a landmark out of reach is no match": ("< gate", "< np.inf"),
        "exactly on the gate is not inside": ("< gate", "<= gate"),
        "the first landmark inside the gate is not always the nearest": (
            lambda *given: int(_inside(*given)[0]) if len(_inside(*given)) else -1
        ),
        "the last landmark inside the gate is not always the nearest": (
            lambda *given: int(_inside(*given)[-1]) if len(_inside(*given)) else -1
        ),
        "this is the farthest landmark": ("argmin", "argmax"),
        "this is the number of landmarks inside the gate, not the row of one": (
            lambda *given: len(_inside(*given))
        ),
        "this is the distance: return the row of the landmark": (
            lambda y, S, gate: float(_squared(y, S).min())
        ),
        "rows begin at 0: these are one too large": (
            lambda *given: _nearest(*given) + (_nearest(*given) >= 0)
        ),
    },
    edges=("no landmarks yet",),
)


# Exercise 2: the joint distance.


def _joint_distance(y: Array, S: Array) -> float:
    """Joint squared distance of innovations y (m, 2) with their full covariance S (2m, 2m)."""
    stacked = y.ravel()
    return float(stacked @ np.linalg.solve(S, stacked))


def _singles(y: Array, S: Array) -> Any:
    m = len(y)
    blocks = S.reshape(m, 2, m, 2)[np.arange(m), :, np.arange(m)]
    return _squared(y, blocks)


def _pairs(m: int) -> Any:
    def draw(rng: np.random.Generator) -> Any:
        H = rng.standard_normal((2 * m, 3))
        return np.round(rng.normal(0, 0.7, (m, 2)), 2), np.round(H @ H.T, 3) + np.eye(2 * m)

    return draw


check_joint = Check(
    _joint_distance,
    "distance",
    {
        "a single pair": _pairs(1),
        "two pairs that share the robot's error": _pairs(2),
        "three pairs": _pairs(3),
        "five pairs": _pairs(5),
        "two independent pairs": ([[0.3, 0.1], [0.1, -0.2]], np.diag([0.4, 0.1, 0.4, 0.1])),
        "no innovation": (np.zeros((2, 2)), np.eye(4)),
    },
    {
        "the sum of the single distances: the blocks off the diagonal were not used": (
            lambda y, S: float(_singles(y, S).sum())
        ),
        "the largest single distance says nothing about how the pairs fit together": (
            lambda y, S: float(_singles(y, S).max())
        ),
        "S was multiplied, not inverted": ("np.linalg.solve(S, stacked)", "S @ stacked"),
        "S is missing: its inverse weighs the innovations": (
            "np.linalg.solve(S, stacked)",
            "stacked",
        ),
        "this is the square root of the distance": lambda y, S: np.sqrt(_joint_distance(y, S)),
        "half the distance: that is the exponent of the likelihood": (
            lambda y, S: _joint_distance(y, S) / 2
        ),
        "divided by the number of pairs: the gate of 2m degrees takes care of that": (
            lambda y, S: _joint_distance(y, S) / len(y)
        ),
        "divided by the degrees of freedom: the gate of 2m degrees takes care of that": (
            lambda y, S: _joint_distance(y, S) / y.size
        ),
        "stacked in the wrong order: first pair's range and bearing, then the second pair's": (
            "y.ravel()",
            "y.T.ravel()",
        ),
        "only the diagonal of S was used": (
            lambda y, S: float(np.sum(y.ravel() ** 2 / S.diagonal()))
        ),
        "this is the negative log likelihood, with ln det S: the distance is asked for": (
            lambda y, S: _joint_distance(y, S) + np.log(np.linalg.det(S))
        ),
    },
    tolerance=1e-8,
)


# Exercise 3: nothing twice.


def _best_first(distance: Array, gate: float) -> Ints:
    """Rows (k,) for distances (k, n): the best pair first, no landmark twice, -1 for none."""
    left = np.where(distance < gate, distance, np.inf)
    rows = np.full(len(left), -1)
    while np.isfinite(left).any():
        j, row = np.unravel_index(np.argmin(left), left.shape)
        rows[j] = row
        left[j, :] = np.inf
        left[:, row] = np.inf
    return rows


def _each_its_nearest(distance: Array, gate: float) -> Any:
    if not distance.size:
        return np.full(len(distance), -1)
    return np.where(distance.min(1) < gate, distance.argmin(1), -1)


def _in_order(distance: Array, gate: float) -> Any:
    left, rows = np.where(distance < gate, distance, np.inf), []
    for one in range(len(left)):
        row = int(np.argmin(left[one])) if left.size else -1
        rows.append(row if row >= 0 and np.isfinite(left[one, row]) else -1)
        if rows[-1] >= 0:
            left[:, row] = np.inf
    return np.array(rows)


def _no_second_choice(distance: Array, gate: float) -> Any:
    rows = _each_its_nearest(distance, gate)
    for row in set(rows[rows >= 0].tolist()):
        mine = np.flatnonzero(rows == row)
        rows[mine] = -1
        rows[mine[np.argmin(distance[mine, row])]] = row
    return rows


def _both_dropped(distance: Array, gate: float) -> Any:
    rows = _each_its_nearest(distance, gate)
    return np.array([r if r >= 0 and (rows == r).sum() == 1 else -1 for r in rows], dtype=int)


def _hungarian(distance: Array, gate: float) -> Any:
    from scipy.optimize import linear_sum_assignment

    rows = np.full(len(distance), -1)
    inside = distance < gate
    for j, row in zip(*linear_sum_assignment(np.where(inside, distance, 1e6)), strict=True):
        if inside[j, row]:
            rows[j] = row
    return rows


def _table(rng: np.random.Generator) -> Any:
    k, n = rng.integers(1, 7, 2)
    return np.round(rng.uniform(0.1, 14, (k, n)), 2), 9.0


check_best_first = Check(
    _best_first,
    "rows",
    {
        "no rivals": ([[1.0, 8.0, 20.0], [15.0, 2.0, 30.0]], 9.0),
        "two want one landmark": ([[3.0, 30.0], [1.0, 40.0]], 9.0),
        "the loser takes its second choice": ([[2.0, 5.0, 50.0], [1.0, 60.0, 70.0]], 9.0),
        "outside the gate is outside": ([[12.0, 30.0], [1.0, 40.0]], 9.0),
        "exactly on the gate is outside": ([[9.0, 30.0], [40.0, 1.0]], 9.0),
        "a chain": ([[2.0, 3.0, 60.0], [1.0, 4.0, 8.0], [50, 0.5, 7.0]], 9.0),
        "the smallest sum is another pairing": ([[1.0, 2.0], [2.0, 8.0]], 9.0),
        "no landmarks yet": (np.zeros((3, 0)), 9.0),
        "no measurements": (np.zeros((0, 3)), 9.0),
        "any table": _table,
    },
    {
        "a landmark was given to two measurements": _each_its_nearest,
        "the measurements chose in the order of the list: the best pair of all goes first": (
            _in_order
        ),
        "a measurement that lost its nearest landmark may still take another inside the gate": (
            _no_second_choice
        ),
        "both rivals were dropped: the nearer one keeps the landmark": _both_dropped,
        "the gate was not used": ("distance < gate", "distance < np.inf"),
        "exactly on the gate is not inside": ("distance < gate", "distance <= gate"),
        "this is the assignment of the smallest sum: the best pair of all goes first": _hungarian,
        "these are the measurements of the landmarks: the landmarks of the measurements are due": (
            lambda distance, gate: _best_first(distance.T, gate)
        ),
        "the distances came: the landmarks of the measurements are due": (
            lambda distance, gate: distance.min(1)
        ),
        "one pair only came: go on until nothing is inside the gate": (
            "left[j, :] = np.inf",
            "left[:] = np.inf",
        ),
    },
    draws=12,
    edges=("no landmarks yet", "no measurements"),
)
