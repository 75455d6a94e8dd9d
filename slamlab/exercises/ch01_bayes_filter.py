"""Checks of chapter 01: predict and update of a Bayes filter in a circular corridor.

P2 (4) and (5), discretised.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Report, run_cases

__all__ = [
    "MISTAKES_PREDICT",
    "MISTAKES_UPDATE",
    "check_predict",
    "check_update",
    "predict",
    "update",
]

Function = Callable[..., Any]


def predict(belief: Array, p_stay: Any, p_step: Any, p_slip: Any) -> Array:
    """Belief (n,) after a step to the right in a circle: stays, moves by one, slips by two."""
    return p_stay * belief + p_step * np.roll(belief, 1) + p_slip * np.roll(belief, 2)


def _open(belief: Array, p_stay: Any, p_step: Any, p_slip: Any) -> Array:
    moved = p_stay * belief
    moved[1:] += p_step * belief[:-1]
    moved[2:] += p_slip * belief[:-2]
    return moved


def _normalised(belief: Array, p_stay: Any, p_step: Any, p_slip: Any) -> Array:
    moved = _open(belief, p_stay, p_step, p_slip)
    return moved / moved.sum()


MISTAKES_PREDICT: dict[str, Function] = {
    "the belief moved to the left: place i receives what stood at i - 1": (
        lambda b, stay, step, slip: stay * b + step * np.roll(b, -1) + slip * np.roll(b, -2)
    ),
    "the corridor is a circle: what leaves on the right comes back on the left": _open,
    "probability fell out at the end and the rest was stretched: the corridor is a circle": (
        _normalised
    ),
    "the slip was forgotten: three displacements are possible": (
        lambda b, stay, step, slip: stay * b + step * np.roll(b, 1)
    ),
    "the whole belief moved by one place: each displacement moves its own share": (
        lambda b, stay, step, slip: np.roll(b, 1)
    ),
    "the slip moves by two places, not by minus one": (
        lambda b, stay, step, slip: stay * b + step * np.roll(b, 1) + slip * np.roll(b, -1)
    ),
    "stay and step are exchanged": (
        lambda b, stay, step, slip: step * b + stay * np.roll(b, 1) + slip * np.roll(b, 2)
    ),
}


def check_predict(student: Function) -> Report:
    """Check ``student(belief (n,), p_stay, p_step, p_slip) -> belief (n,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("a sure belief spreads to the right", [0, 1, 0, 0, 0, 0], 0.1, 0.7, 0.2),
        ("over the end and back at the start", [0, 0, 0, 0, 0, 1], 0.1, 0.7, 0.2),
        ("a wide belief", [0.1, 0.2, 0.4, 0.2, 0.1, 0.0], 0.2, 0.5, 0.3),
        ("a robot that never slips", [0.3, 0.0, 0.7, 0.0, 0.0, 0.0], 0.25, 0.75, 0.0),
    ]
    return run_cases("predict", student, predict, cases, MISTAKES_PREDICT)


def update(belief: Array, doors: Array, sees_door: Any, p_right: Any) -> Array:
    """Belief (n,) after the sensor said door or wall, being right with probability p_right."""
    likelihood = np.where(np.asarray(doors) == sees_door, p_right, 1 - p_right)
    posterior = belief * likelihood
    return posterior / posterior.sum()


def _likelihood(doors: Array, sees_door: Any, p_right: Any) -> Array:
    return np.where(np.asarray(doors) == sees_door, p_right, 1 - p_right)


def _added(belief: Array, doors: Array, sees_door: Any, p_right: Any) -> Array:
    total = belief + _likelihood(doors, sees_door, p_right)
    return total / total.sum()


def _only_doors(belief: Array, doors: Array, sees_door: Any, p_right: Any) -> Array:
    return update(belief, doors, 1.0, p_right)


def _sure(belief: Array, doors: Array, sees_door: Any, p_right: Any) -> Array:
    kept = belief * (np.asarray(doors) == sees_door)
    return kept / kept.sum() if kept.sum() > 0 else kept


MISTAKES_UPDATE: dict[str, Function] = {
    "the result is not normalised: divide by its sum": (
        lambda b, doors, z, p: b * _likelihood(doors, z, p)
    ),
    "belief and likelihood were added: evidence multiplies": _added,
    "the prior was forgotten: multiply the likelihood with the old belief": (
        lambda b, doors, z, p: _likelihood(doors, z, p) / _likelihood(doors, z, p).sum()
    ),
    "only doors count here: seeing a wall is a measurement too": _only_doors,
    "the sensor is not perfect: places that disagree keep a little": _sure,
    "the sensor was read the wrong way round: agreeing places get p_right": (
        lambda b, doors, z, p: update(b, doors, z, 1 - p)
    ),
    "divided by the largest entry: probabilities must sum to one": (
        lambda b, doors, z, p: update(b, doors, z, p) / update(b, doors, z, p).max()
    ),
}


def check_update(student: Function) -> Report:
    """Check ``student(belief (n,), doors (n,), sees_door, p_right) -> belief (n,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    doors = [1, 0, 0, 1, 0, 1]
    cases = [
        ("a door seen from anywhere", np.full(6, 1 / 6), doors, 1.0, 0.8),
        ("a wall is news too", np.full(6, 1 / 6), doors, 0.0, 0.8),
        ("the old belief counts", [0.5, 0.1, 0.1, 0.1, 0.1, 0.1], doors, 1.0, 0.9),
        ("an excluded place stays excluded", [0.0, 0.2, 0.2, 0.6, 0.0, 0.0], doors, 0.0, 0.7),
    ]
    return run_cases("update", student, update, cases, MISTAKES_UPDATE)
