"""Exercises of chapter 11: the gate, the joint distance, nothing twice.

P4 (2a), (2b) with the gate that page 84 lacks; joint compatibility after Neira and Tardos (2001).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Report, run_cases

__all__ = [
    "MISTAKES_BEST_FIRST",
    "MISTAKES_JOINT",
    "MISTAKES_NEAREST",
    "best_first",
    "check_best_first",
    "check_joint",
    "check_nearest",
    "joint_distance",
    "nearest",
]

Function = Callable[..., Any]


# Exercise 1: the nearest landmark inside a gate.


def nearest(y: Array, S: Array, gate: Any) -> int:
    """Row of the landmark with the smallest y^T S^-1 y, -1 if none is below the gate."""
    distance = _squared(y, S)
    return int(np.argmin(distance)) if distance.min() < gate else -1


def _squared(y: Array, S: Array) -> Array:
    return np.einsum("ni,nij,nj->n", y, np.linalg.inv(S), y)


def _by(measure: Function) -> Function:
    def wrong(y: Array, S: Array, gate: Any) -> int:
        distance = measure(y, S)
        return int(np.argmin(distance)) if distance.min() < gate else -1

    return wrong


def _nearest_of_the_list_first(y: Array, S: Array, gate: Any) -> int:
    inside = np.flatnonzero(_squared(y, S) < gate)
    return int(inside[0]) if len(inside) else -1


MISTAKES_NEAREST: dict[str, Function] = {
    "the distance is Euclidean: metres and radians know nothing of the covariance": _by(
        lambda y, S: (y**2).sum(1)
    ),
    "S was multiplied, not inverted: a large doubt must make the distance small": _by(
        lambda y, S: np.einsum("ni,nij,nj->n", y, S, y)
    ),
    "only the diagonal of S was used: range and bearing errors are correlated": _by(
        lambda y, S: (y**2 / np.diagonal(S, axis1=1, axis2=2)).sum(1)
    ),
    "the gate is for the squared distance: no square root": _by(
        lambda y, S: np.sqrt(_squared(y, S))
    ),
    "the gate was not used: a landmark out of reach is no match": (
        lambda y, S, gate: int(np.argmin(_squared(y, S)))
    ),
    "the first landmark inside the gate is not always the nearest": _nearest_of_the_list_first,
    "this is the number of landmarks inside the gate, not the row of one": (
        lambda y, S, gate: int((_squared(y, S) < gate).sum())
    ),
    "this is the distance: return the row of the landmark": (
        lambda y, S, gate: float(_squared(y, S).min())
    ),
}


def check_nearest(student: Function) -> Report:
    """Check ``student(y (n, 2), S (n, 2, 2), gate) -> row, or -1``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    round_ = np.diag([0.04, 0.01])
    wide = np.diag([4.0, 1.0])
    slanted = np.array([[1.0, 0.95], [0.95, 1.0]])
    cases = [
        ("two landmarks, equally well known", [[0.3, 0.1], [0.1, 0.05]], [round_] * 2, 9.21),
        ("the vague one is nearer in sigmas", [[0.5, 0.1], [1.0, 0.3]], [round_, wide], 9.21),
        ("correlated errors", [[1.0, -1.0], [1.3, 1.3]], [slanted, slanted], 9.21),
        ("the nearer one, about which less is known", [[0.5, 0.1], [0.6, 0.1]], [wide, round_], 9),
        ("nothing inside the gate", [[5.0, 0.5], [4.0, 0.0]], [round_] * 2, 9.21),
        ("all inside, the last is nearest", [[0.2, 0.1], [0.3, 0.1], [0.1, 0.0]], [round_] * 3, 9),
        ("four sigmas are outside a gate of 9.21", [[0.8, 0.0]], [round_], 9.21),
    ]
    return run_cases("nearest", student, nearest, cases, MISTAKES_NEAREST)


# Exercise 2: the joint distance.


def joint_distance(y: Array, S: Array) -> float:
    """Joint squared distance of innovations y (m, 2) with their full covariance S (2m, 2m)."""
    stacked = np.ravel(y)
    return float(stacked @ np.linalg.solve(S, stacked))


def _blocks(S: Array) -> Array:
    m = len(S) // 2
    return S.reshape(m, 2, m, 2)[np.arange(m), :, np.arange(m)]


MISTAKES_JOINT: dict[str, Function] = {
    "the sum of the single distances: the blocks off the diagonal were not used": (
        lambda y, S: float(_squared(np.reshape(y, (-1, 2)), _blocks(S)).sum())
    ),
    "the largest single distance says nothing about how the pairs fit together": (
        lambda y, S: float(_squared(np.reshape(y, (-1, 2)), _blocks(S)).max())
    ),
    "S was multiplied, not inverted": lambda y, S: float(np.ravel(y) @ S @ np.ravel(y)),
    "this is the square root of the distance": lambda y, S: np.sqrt(joint_distance(y, S)),
    "divided by the number of pairs: the gate of 2m degrees takes care of that": (
        lambda y, S: joint_distance(y, S) / len(y)
    ),
    "stacked in the wrong order: first pair's range and bearing, then the second pair's": (
        lambda y, S: joint_distance(np.transpose(y), S)
    ),
    "only the diagonal of S was used": lambda y, S: float(np.sum(np.ravel(y) ** 2 / np.diag(S))),
}


def check_joint(student: Function) -> Report:
    """Check ``student(y (m, 2), S (2m, 2m)) -> squared distance``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    H = np.array([[1.0, 0.2], [0.0, 1.0], [1.0, -0.5], [0.1, 1.0], [0.9, 0.4], [-0.2, 1.0]])
    pose, R = np.diag([1.0, 0.3]), np.diag([0.04, 0.01])
    S = H @ pose @ H.T + np.kron(np.eye(3), R)
    cases = [
        ("a single pair", [[0.5, 0.2]], S[:2, :2]),
        ("all off by the same: that is cheap", [[0.8, 0.0], [0.8, 0.1], [0.7, -0.1]], S),
        ("each off in another direction: that is not", [[0.8, 0.3], [-0.8, 0.1], [0.7, -0.4]], S),
        ("two independent pairs", [[0.3, 0.1], [0.1, -0.2]], np.kron(np.eye(2), S[:2, :2])),
    ]
    return run_cases("joint_distance", student, joint_distance, cases, MISTAKES_JOINT)


# Exercise 3: nothing twice.


def best_first(distance: Array, gate: Any) -> Array:
    """Rows (k,) for distances (k, n): the best pair first, no landmark twice, -1 for none."""
    left = np.where(distance < gate, distance, np.inf)
    rows = np.full(len(left), -1)
    while np.isfinite(left).any():
        j, row = np.unravel_index(np.argmin(left), left.shape)
        rows[j] = row
        left[j, :] = left[:, row] = np.inf
    return rows


def _each_its_nearest(distance: Array, gate: Any) -> Array:
    return np.where(distance.min(1) < gate, distance.argmin(1), -1)


def _in_order(distance: Array, gate: Any) -> Array:
    left, rows = np.array(distance), []
    for one in range(len(left)):
        row = int(np.argmin(left[one]))
        rows.append(row if left[one, row] < gate else -1)
        if rows[-1] >= 0:
            left[:, row] = np.inf
    return np.array(rows)


def _no_second_choice(distance: Array, gate: Any) -> Array:
    rows = _each_its_nearest(distance, gate)
    for row in set(rows[rows >= 0].tolist()):
        mine = np.flatnonzero(rows == row)
        rows[mine] = -1
        rows[mine[np.argmin(distance[mine, row])]] = row
    return rows


def _both_dropped(distance: Array, gate: Any) -> Array:
    rows = _each_its_nearest(distance, gate)
    return np.array([r if r >= 0 and (rows == r).sum() == 1 else -1 for r in rows])


MISTAKES_BEST_FIRST: dict[str, Function] = {
    "a landmark was given to two measurements": _each_its_nearest,
    "the measurements chose in the order of the list: the best pair of all goes first": _in_order,
    "a measurement that lost its nearest landmark may still take another inside the gate": (
        _no_second_choice
    ),
    "both rivals were dropped: the nearer one keeps the landmark": _both_dropped,
    "the gate was not used": lambda distance, gate: best_first(distance, np.inf),
    "these are the measurements of the landmarks: the landmarks of the measurements are due": (
        lambda distance, gate: best_first(np.transpose(distance), gate)
    ),
}


def check_best_first(student: Function) -> Report:
    """Check ``student(distance (k, n), gate) -> rows (k,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("no rivals", [[1.0, 8.0, 20.0], [15.0, 2.0, 30.0]], 9.0),
        ("two want one landmark", [[3.0, 30.0], [1.0, 40.0]], 9.0),
        ("the loser takes its second choice", [[2.0, 5.0, 50.0], [1.0, 60.0, 70.0]], 9.0),
        ("outside the gate is outside", [[12.0, 30.0], [1.0, 40.0]], 9.0),
        ("three measurements, a chain", [[2.0, 3.0, 60.0], [1.0, 4.0, 8.0], [50, 0.5, 7.0]], 9.0),
    ]
    return run_cases("best_first", student, best_first, cases, MISTAKES_BEST_FIRST)
