"""Checks of chapter 01: predict and update of a Bayes filter in a circular corridor.

P2 (4) and (5), discretised.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import weights
from slamlab.exercises._report import Array, Check

__all__ = ["check_predict", "check_update"]


# Exercise 1: predict.


def _predict(belief: Array, p_stay: float, p_step: float, p_slip: float) -> Array:
    """Belief (n,) after a step to the right in a circle: stays, moves by one, slips by two."""
    return p_stay * belief + p_step * np.roll(belief, 1) + p_slip * np.roll(belief, 2)


def _open(belief: Array, p_stay: float, p_step: float, p_slip: float) -> Array:
    moved = p_stay * belief
    moved[1:] += p_step * belief[:-1]
    moved[2:] += p_slip * belief[:-2]
    return moved


def _corridor(rng: np.random.Generator) -> Any:
    return weights(rng, int(rng.integers(3, 12))), *weights(rng, 3)


check_predict = Check(
    _predict,
    "belief",
    {
        "a sure belief spreads to the right": ([0, 1, 0, 0, 0, 0], 0.1, 0.7, 0.2),
        "over the end and back at the start": ([0, 0, 0, 0, 0, 1], 0.1, 0.7, 0.2),
        "a robot that never slips": ([0.3, 0.0, 0.7, 0.0, 0.0, 0.0], 0.25, 0.75, 0.0),
        "corridors of any length": _corridor,
    },
    {
        "the belief moved to the left: place i receives what stood at i - 1": (
            "belief, 1)",
            "belief, -1)",
            "belief, 2)",
            "belief, -2)",
        ),
        "the corridor is a circle: what leaves on the right comes back on the left": _open,
        "probability fell out at the end and the rest was stretched: the corridor is a circle": (
            lambda *given: _open(*given) / _open(*given).sum()
        ),
        "the slip was forgotten: three displacements are possible": (
            " + p_slip * np.roll(belief, 2)",
            "",
        ),
        "the step was forgotten: three displacements are possible": (
            " + p_step * np.roll(belief, 1)",
            "",
        ),
        "the robot that stays was forgotten: three displacements are possible": (
            "p_stay * belief + ",
            "",
        ),
        "the whole belief moved by one place: each displacement moves its own share": (
            lambda belief, stay, step, slip: np.roll(belief, 1)
        ),
        "the slip moves by two places, not by minus one": ("belief, 2)", "belief, -1)"),
        "the slip moves by two places, not by one": ("belief, 2)", "belief, 1)"),
        "the slip moves by two places, not by three": ("belief, 2)", "belief, 3)"),
        "stay and step are exchanged": (
            lambda belief, stay, step, slip: _predict(belief, step, stay, slip)
        ),
        "step and slip are exchanged": (
            lambda belief, stay, step, slip: _predict(belief, stay, slip, step)
        ),
        "the belief was predicted twice": (
            lambda belief, *shares: _predict(_predict(belief, *shares), *shares)
        ),
    },
)


# Exercise 2: update.


def _update(belief: Array, doors: Array, sees_door: float, p_right: float) -> Array:
    """Belief (n,) after the sensor said door or wall, being right with probability p_right."""
    likelihood = np.where(doors == sees_door, p_right, 1 - p_right)
    posterior = belief * likelihood
    return posterior / posterior.sum()


def _seen(rng: np.random.Generator) -> Any:
    n = int(rng.integers(2, 12))
    belief, p_right = weights(rng, n, rng.integers(0, n, 1)), np.round(rng.uniform(0.1, 1), 2)
    doors = rng.integers(0, 2, n)
    return belief, [0, 1, *doors[2:]], float(rng.integers(0, 2)), p_right


_DOORS = [1, 0, 0, 1, 0, 1]

check_update = Check(
    _update,
    "belief",
    {
        "a door seen from anywhere": (np.full(6, 1 / 6), _DOORS, 1, 0.8),
        "a wall is news too": (np.full(6, 1 / 6), _DOORS, 0, 0.8),
        "the old belief counts": ([0.5, 0.1, 0.1, 0.1, 0.1, 0.1], _DOORS, 1, 0.9),
        "an excluded place stays excluded": ([0.0, 0.2, 0.2, 0.6, 0.0, 0.0], _DOORS, 0, 0.7),
        "an eye that tosses a coin says nothing": ([0.3, 0.3, 0.4], [0, 1, 0], 1, 0.5),
        "an eye that is never wrong": ([0.3, 0.3, 0.4], [0, 1, 1], 1, 1.0),
        "any corridor, any eye": _seen,
    },
    {
        "the result is not normalised: divide by its sum": (" / posterior.sum()", ""),
        "belief and likelihood were added: evidence multiplies": ("belief *", "belief +"),
        "the prior was forgotten: multiply the likelihood with the old belief": ("belief * ", ""),
        "only doors count here: seeing a wall is a measurement too": ("== sees_door", "== 1"),
        "the sensor is not perfect: places that disagree keep a little": ("1 - p_right", "0.0"),
        "places that disagree get 1 - p_right, not everything": ("1 - p_right", "1.0"),
        "the sensor was read the wrong way round: agreeing places get p_right": (
            "p_right, 1 - p_right",
            "1 - p_right, p_right",
        ),
        "divided by the largest entry: probabilities must sum to one": (
            "posterior.sum()",
            "posterior.max()",
        ),
        "divided by its length: root of the sum of squares; the sum is due": (
            "posterior.sum()",
            "np.sqrt(np.sum(posterior**2))",
        ),
        "the measurement was counted twice": (
            lambda belief, *seen: _update(_update(belief, *seen), *seen)
        ),
    },
)
