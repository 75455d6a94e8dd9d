"""Checks of chapter 01: predict and update of a Bayes filter in a circular corridor.

P2 (4) and (5), discretised.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn, weights
from slamlab.exercises._report import Array, Check, Ints

__all__ = ["check_looks_needed", "check_predict", "check_update", "check_wander"]


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
            "belief, 1) => belief, -1)",
            "belief, 2) => belief, -2)",
        ),
        "the corridor is a circle: what leaves on the right comes back on the left": _open,
        "probability fell out at the end and the rest was stretched: the corridor is a circle": (
            lambda *given: _open(*given) / _open(*given).sum()
        ),
        "the slip was forgotten: three displacements are possible": (
            " + p_slip * np.roll(belief, 2) => "
        ),
        "the step was forgotten: three displacements are possible": (
            " + p_step * np.roll(belief, 1) => "
        ),
        "the robot that stays was forgotten: three displacements are possible": (
            "p_stay * belief +  => "
        ),
        "the whole belief moved by one place: each displacement moves its own share": (
            lambda belief, stay, step, slip: np.roll(belief, 1)
        ),
        "the slip moves by two places, not by minus one": "belief, 2) => belief, -1)",
        "the slip moves by two places, not by one": "belief, 2) => belief, 1)",
        "the slip moves by two places, not by three": "belief, 2) => belief, 3)",
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
        "the result is not normalised: divide by its sum": " / posterior.sum() => ",
        "belief and likelihood were added: evidence multiplies": "belief * => belief +",
        "the prior was forgotten: multiply the likelihood with the old belief": "belief *  => ",
        "only doors count here: seeing a wall is a measurement too": "== sees_door => == 1",
        "the sensor is not perfect: places that disagree keep a little": "1 - p_right => 0.0",
        "places that disagree get 1 - p_right, not everything": "1 - p_right => 1.0",
        "the sensor was read the wrong way round: agreeing places get p_right": (
            "p_right, 1 - p_right => 1 - p_right, p_right"
        ),
        "divided by the largest entry: probabilities must sum to one": (
            "posterior.sum() => posterior.max()"
        ),
        "divided by its length: root of the sum of squares; the sum is due": (
            "posterior.sum() => np.sqrt(np.sum(posterior**2))"
        ),
        "the measurement was counted twice": (
            lambda belief, *seen: _update(_update(belief, *seen), *seen)
        ),
    },
)


# Exercise 3: how many looks are enough?


def _looks_needed(prior: float, p_right: float, goal: float) -> int:
    """Smallest number of agreeing looks after which a door of prior probability is believed."""
    odds, n = prior / (1 - prior), 0
    while odds / (1 + odds) < goal and n < 1000:  # a mistaken eye may never get there
        odds, n = odds * p_right / (1 - p_right), n + 1
    return n


def _an_eye(rng: np.random.Generator) -> Any:
    return tuple(
        np.round([rng.uniform(0.02, 0.6), rng.uniform(0.55, 0.95), rng.uniform(0.5, 0.999)], 3)
    )


check_looks_needed = Check(
    _looks_needed,
    "looks",
    {
        "one place in six, an eye right four times of five": (1 / 6, 0.8, 0.95),
        "believed before the first look": (0.6, 0.8, 0.5),
        "one look is enough": (0.4, 0.9, 0.8),
        "exactly the goal is enough": (0.5, 0.75, 0.75),
        "an eye that hardly knows": (0.5, 0.55, 0.9),
        "any eye": _an_eye,
    },
    {
        "one look too few: afterwards the belief is still below the goal": (
            "    return n =>     return n - 1"
        ),
        "one look too many": "    return n =>     return n + 1",
        "the prior was taken for one half": (
            "odds, n = prior / (1 - prior), 0 => odds, n = 1.0, 0"
        ),
        "odds were compared with a probability: p = odds / (1 + odds)": (
            "odds / (1 + odds) < goal => odds < goal"
        ),
        "the prior is a probability, not odds": "prior / (1 - prior), 0 => prior, 0",
        "the places that disagree got nothing taken off: odds grow by p / (1 - p)": (
            "odds * p_right / (1 - p_right) => odds * p_right / 0.5"
        ),
        "looks were taken for chances to be wrong all the time: evidence multiplies odds": (
            lambda prior, p_right, goal: int(np.ceil(np.log(1 - goal) / np.log(1 - p_right)))
        ),
    },
)


# Exercise 4: lost in the corridor.


def _wander(belief: Array, doors: Array, steps: Array, seen: Ints, p_right: float) -> Array:
    """Beliefs (T, n) after each step (stay, step, slip) and look: 1 door, 0 wall, -1 none."""
    found = []
    for step, saw in zip(steps, seen, strict=True):
        belief = _predict(belief, *step)
        if saw >= 0:
            belief = _update(belief, doors, saw, p_right)
        found.append(belief)
    return np.array(found).reshape(-1, len(doors))


@drawn
def _lost(rng: np.random.Generator, n_steps: int, closed: float = 0.0) -> Any:
    n = int(rng.integers(4, 10))
    steps = np.array([weights(rng, 3) for _ in range(n_steps)])
    seen = np.where(rng.random(n_steps) < closed, -1, rng.integers(0, 2, n_steps))
    doors = [0, 1, *rng.integers(0, 2, n - 2)]
    return weights(rng, n), doors, steps, seen, float(np.round(rng.uniform(0.6, 0.95), 2))


check_wander = Check(
    _wander,
    "beliefs",
    {
        "one step with closed eyes": _lost(1, 1.0),
        "one step and one look": _lost(1),
        "a walk": _lost(8),
        "a walk with closed eyes now and then": _lost(10, 0.5),
    },
    {
        "it looked before it moved: predict first": (
            "_predict(belief, *step) => belief",
            "found.append(belief) => found.append(belief := _predict(belief, *step))",
        ),
        "closed eyes were taken for a wall: no look, no update": (
            "if saw >= 0 => if True",
            "doors, saw, => doors, max(saw, 0),",
        ),
        "only doors count here: seeing a wall is a measurement too": "if saw >= 0 => if saw > 0",
        "the robot stands still while its eyes are closed: predict at every step": (
            "_predict(belief, *step) => _predict(belief, *step) if saw >= 0 else belief"
        ),
        "the looks were not used": "if saw >= 0 => if False",
        "nothing was predicted: the robot moves": "_predict(belief, *step) => belief + 0.0",
        "the last belief came: the one after each step is due": lambda *given: _wander(*given)[-1],
        "every step began at the first belief: the old result is the new prior": (
            "found = [] => found, first = [], belief",
            "_predict(belief, => _predict(first,",
        ),
    },
)
