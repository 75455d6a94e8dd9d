"""Exercises, chapter 01: predict and update of a Bayes filter in a circular corridor.

P2 (4) and (5), discretised.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn, weights
from slamlab.exercises._report import Array, Check, Ints

__all__ = ["check_measurements_needed", "check_predict", "check_update", "check_wander"]


# %% [markdown] tags=["chapter"]
# # Exercises 01: the Bayes filter
#
# Four exercises carry a belief through the corridor of the chapter [The Bayes
# filter](../01_bayes_filter.ipynb). Replace each `...` and run the check below it as often as you
# like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 01: the Bayes filter
#
# The exercises are in [Exercises 01](../exercises/01_bayes_filter.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: predict
#
# The corridor is a circle of n places. At each step the robot stays with probability `p_stay`,
# moves one place to the right with `p_step`, or slips two places to the right with `p_slip`.
# Write P2 (4) for it.


# %% tags=["exercise"]
def predict(belief: Array, p_stay: float, p_step: float, p_slip: float) -> Array:
    """Move the belief by one step to the right.

    Parameters
    ----------
    belief : ndarray, shape (n,)
        Probability of each place; place n - 1 is the left neighbour of place 0.
    p_stay, p_step, p_slip : float
        Probabilities of moving by 0, 1 and 2 places; they sum to one.

    Returns
    -------
    ndarray, shape (n,)
    """
    return p_stay * belief + p_step * np.roll(belief, 1) + p_slip * np.roll(belief, 2)


# %% active="ipynb" tags=["try"]
# predict(np.array([0.0, 1.0, 0.0, 0.0]), 0.1, 0.7, 0.2)

# %% [markdown] tags=["hint"]
# From which three places can the robot have come to place i?

# %% [markdown] tags=["hint"]
# `np.roll(belief, 1)` is the whole belief moved by one place to the right, round the circle.

# %% [markdown] tags=["hint"]
# Three terms, each a probability times a rolled belief.


# %% tags=["cases"]
def _corridor(rng: np.random.Generator) -> Any:
    return weights(rng, int(rng.integers(3, 12))), *weights(rng, 3)


def _predict_drawn(ax: Any, function: Any) -> None:
    """Draw the belief after three steps, and where 100 000 simulated robots stand."""
    from slamlab import plots

    rng, belief, shares = np.random.default_rng(1), np.zeros(12), (0.1, 0.7, 0.2)
    belief[[7, 8]] = 0.7, 0.3
    robots = rng.choice(12, 100_000, p=belief) + rng.choice(3, (3, 100_000), p=shares).sum(0)
    for _ in range(3):
        belief = np.asarray(function(belief, *shares), float)
    ax.plot(np.bincount(robots % 12, minlength=12) / 100_000, **plots.line_style("truth"))
    ax.plot(np.arange(12), belief, "o", color=plots.COLOURS["estimate"], markersize=5)
    ax.set(xlabel="place; 0 follows 11", ylabel="probability", ylim=(0, 0.4))


check_predict = Check(
    predict,
    "belief",
    {
        "a sure belief spreads to the right": ([0, 1, 0, 0, 0, 0], 0.1, 0.7, 0.2),
        "over the end and back at the start": ([0, 0, 0, 0, 0, 1], 0.1, 0.7, 0.2),
        "a robot that never slips": ([0.3, 0.0, 0.7, 0.0, 0.0, 0.0], 0.25, 0.75, 0.0),
        "corridors of any length": _corridor,
    },
    picture=_predict_drawn,
)


# %% tags=["mistakes"]
def _open(belief: Array, p_stay: float, p_step: float, p_slip: float) -> Array:
    moved = p_stay * belief
    moved[1:] += p_step * belief[:-1]
    moved[2:] += p_slip * belief[:-2]
    return moved


def _in_place(belief: Array, p_stay: float, p_step: float, p_slip: float) -> Any:
    new = belief.copy()
    for i in range(len(new)):
        new[i] = p_stay * new[i] + p_step * new[i - 1] + p_slip * new[i - 2]
    return new


check_predict.mistakes = {
    "the belief was overwritten while it was read: work on a copy": _in_place,
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
        lambda belief, stay, step, slip: predict(belief, step, stay, slip)
    ),
    "step and slip are exchanged": (
        lambda belief, stay, step, slip: predict(belief, stay, slip, step)
    ),
    "the belief was predicted twice": (
        lambda belief, *shares: predict(predict(belief, *shares), *shares)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: predict
#
# Each displacement moves its own share of the belief; `np.roll` closes the circle.

# %% [markdown] tags=["solution"]
# A shift without the circle loses the probability that leaves on the right. Dividing by the sum
# afterwards hides the loss, and it is the wrong repair: the lost share belonged to the left end.

# %% active="ipynb" tags=["solution"]
# def stretched(belief, p_stay, p_step, p_slip):
#     moved = p_stay * belief
#     moved[1:] += p_step * belief[:-1]
#     moved[2:] += p_slip * belief[:-2]
#     return moved / moved.sum()
#
# check_predict(stretched)

# %% [markdown] tags=["statement"]
# ## Exercise 2: update
#
# The eye says `1.0` (door) or `0.0` (wall) and is right with probability `p_right`, wherever the
# robot stands. Write P2 (5).


# %% tags=["exercise"]
def update(belief: Array, doors: Array, sees_door: float, p_right: float) -> Array:
    """Weigh the belief by what the eye said.

    Parameters
    ----------
    belief : ndarray, shape (n,)
        Probability of each place.
    doors : ndarray, shape (n,)
        1.0 where there is a door, 0.0 where there is wall.
    sees_door : float
        1.0 or 0.0, what the eye said.
    p_right : float
        Probability that the eye is right.

    Returns
    -------
    ndarray, shape (n,)
        Probabilities; they sum to one.
    """
    likelihood = np.where(doors == sees_door, p_right, 1 - p_right)
    posterior = belief * likelihood
    return posterior / posterior.sum()


# %% active="ipynb" tags=["try"]
# update(np.full(4, 0.25), np.array([1.0, 0.0, 0.0, 1.0]), 1.0, 0.9)

# %% [markdown] tags=["hint"]
# How likely is the answer "wall" at a place where there is wall? And where there is a door?

# %% [markdown] tags=["hint"]
# `np.where(doors == sees_door, p_right, 1 - p_right)` is the likelihood of every place.

# %% [markdown] tags=["hint"]
# Multiply with the old belief, then divide by the sum.


# %% tags=["cases"]
def _seen(rng: np.random.Generator) -> Any:
    n = int(rng.integers(2, 12))
    belief, p_right = weights(rng, n, rng.integers(0, n, 1)), np.round(rng.uniform(0.1, 1), 2)
    doors = rng.integers(0, 2, n)
    return belief, [0, 1, *doors[2:]], float(rng.integers(0, 2)), p_right


_DOORS = [1, 0, 0, 1, 0, 1]


def _update_drawn(ax: Any, function: Any) -> None:
    """Draw the belief after a wall is seen, and where the robots stand whose eye says wall."""
    from slamlab import plots

    rng, doors = np.random.default_rng(2), np.array([1.0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 0])
    belief = np.exp(-0.5 * ((np.arange(12) - 5) / 2.5) ** 2)
    belief /= belief.sum()
    robots = rng.choice(12, 100_000, p=belief)
    says_door = (rng.random(100_000) < 0.8) == (doors[robots] == 1)
    counts = np.bincount(robots[~says_door], minlength=12)
    ax.plot(counts / counts.sum(), **plots.line_style("truth"))
    after = np.asarray(function(belief, doors, 0.0, 0.8), float)
    ax.plot(np.arange(12), after, "o", color=plots.COLOURS["estimate"], markersize=5)
    for place in np.flatnonzero(doors):
        ax.axvline(place, color="0.6", lw=1, ls=":")
    ax.set(xlabel="place; dotted: doors", ylabel="probability", ylim=(0, 0.35))


check_update = Check(
    update,
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
    picture=_update_drawn,
)

# %% tags=["mistakes"]
check_update.mistakes = {
    "a wall changed nothing: seeing a wall is a measurement too": (
        lambda belief, doors, sees_door, p_right: (
            update(belief, doors, sees_door, p_right) if sees_door else belief.copy()
        )
    ),
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
    "divided by its length, the root of the sum of squares: expected the sum": (
        "posterior.sum() => np.sqrt(np.sum(posterior**2))"
    ),
    "the measurement was counted twice": (
        lambda belief, *seen: update(update(belief, *seen), *seen)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: update

# %% [markdown] tags=["solution"]
# An update that forgets what was seen takes every wall for a door. A wall is a measurement too:

# %% active="ipynb" tags=["solution"]
# def only_doors(belief, doors, sees_door, p_right):
#     likelihood = np.where(doors == 1, p_right, 1 - p_right)
#     posterior = belief * likelihood
#     return posterior / posterior.sum()
#
# check_update(only_doors)

# %% [markdown] tags=["statement"]
# ## Exercise 3: how many measurements? (pencil first)
#
# The robot stands still. One place has the prior probability $p_0$ of being where it stands, and
# every measurement fits this place and no other. A measurement is right with probability $p$,
# whatever the others were. After how many of them is the belief in the place at least $g$? On
# paper: what happens to the *odds* $b / (1 - b)$ in one measurement?


# %% tags=["exercise"]
def measurements_needed(prior: float, p_right: float, goal: float) -> int:
    """Fewest agreeing measurements after which the belief is at least `goal`.

    Parameters
    ----------
    prior : float
    p_right : float
        How often the eye is right, more than one half.
    goal : float

    Returns
    -------
    int
        0 if the prior is enough.
    """
    odds, n = prior / (1 - prior), 0
    while odds / (1 + odds) < goal and n < 100_000:  # a coin never gets there
        odds, n = odds * p_right / (1 - p_right), n + 1
    return n


# %% active="ipynb" tags=["try"]
# measurements_needed(1 / 6, 0.8, 0.95)

# %% [markdown] tags=["hint"]
# The belief is multiplied by $p$, that in all other places together by $1 - p$; then both are
# divided by one number.

# %% [markdown] tags=["hint"]
# Odds are a quotient: the number by which both are divided drops out. So one measurement
# multiplies the odds by $p / (1 - p)$.


# %% tags=["cases"]
def _an_eye(rng: np.random.Generator) -> Any:
    return tuple(
        np.round([rng.uniform(0.02, 0.6), rng.uniform(0.55, 0.95), rng.uniform(0.5, 0.999)], 3)
    )


def _measurements_drawn(ax: Any, function: Any) -> None:
    """Draw the belief after each measurement, and at each goal how many reach it."""
    from slamlab import plots

    n, goals = np.arange(9), np.linspace(0.1, 0.99, 30)
    odds = 0.2 * 4.0**n
    ax.plot(n, odds / (1 + odds), "o-", color=plots.COLOURS["truth"], markersize=3, lw=1)
    needed = [float(function(1 / 6, 0.8, goal)) for goal in goals]
    ax.plot(needed, goals, "+", color=plots.COLOURS["estimate"], markersize=7)
    ax.set(xlabel="measurements", ylabel="belief (line), goal (crosses)")


check_measurements_needed = Check(
    measurements_needed,
    "measurements",
    {
        "one place in six, an eye right four times of five": (1 / 6, 0.8, 0.95),
        "believed before the first measurement": (0.6, 0.8, 0.5),
        "believed far more than is asked for": (0.99, 0.6, 0.5),
        "one measurement is enough": (0.4, 0.9, 0.8),
        "exactly the goal is enough": (0.5, 0.75, 0.75),
        "far above the goal before the first measurement": (0.99, 0.6, 0.5),
        "an eye that hardly knows": (0.5, 0.55, 0.9),
        "any eye": _an_eye,
    },
    picture=_measurements_drawn,
)


# %% tags=["mistakes"]
def _measurements(prior: float, p_right: float, goal: float) -> float:
    """Looks needed, not rounded."""
    old, each, new = (np.log(p / (1 - p)) for p in (prior, p_right, goal))
    return float((new - old) / each)


check_measurements_needed.mistakes = {
    "a number of measurements is not negative: the prior may be above the goal already": (
        lambda prior, p_right, goal: int(np.ceil(_measurements(prior, p_right, goal) - 1e-12))
    ),
    "one measurement too many where the goal is reached exactly": (
        lambda prior, p_right, goal: max(
            0, int(np.floor(_measurements(prior, p_right, goal) + 1e-12)) + 1
        )
    ),
    "no measurement is needed where the prior is enough": (
        lambda prior, p_right, goal: max(1, measurements_needed(prior, p_right, goal))
    ),
    "one measurement too few: afterwards the belief is still below the goal": (
        "    return n =>     return n - 1"
    ),
    "one measurement too many": "    return n =>     return n + 1",
    "the prior was taken for one half": ("odds, n = prior / (1 - prior), 0 => odds, n = 1.0, 0"),
    "odds were compared with a probability: p = odds / (1 + odds)": (
        "odds / (1 + odds) < goal => odds < goal"
    ),
    "the prior is a probability, not odds": "prior / (1 - prior), 0 => prior, 0",
    "the places that disagree got nothing taken off: odds grow by p / (1 - p)": (
        "odds * p_right / (1 - p_right) => odds * p_right / 0.5"
    ),
    "measurements were taken for chances to be wrong all the time: evidence multiplies odds": (
        lambda prior, p_right, goal: int(np.ceil(np.log(1 - goal) / np.log(1 - p_right)))
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: how many measurements
#
# Each measurement multiplies the odds by $p/(1-p)$, whatever the belief was. With an eye that is
# right four times of five that is a factor of four: from 1 : 5 over 4 : 5, 16 : 5 and 64 : 5 to
# 256 : 5.

# %% [markdown] tags=["solution"]
# *The chance that the eye is wrong n times is $(1 - p)^n$* answers another question: it forgets
# the prior, and how probable the same answers are if the place is the right one, $p^n$. That is
# why it fails even from a prior of one half, below with $p = 0.55$: 3 where 11 are needed.

# %% active="ipynb" tags=["solution"]
# def chance_to_be_wrong(prior, p_right, goal):
#     return int(np.ceil(np.log(1 - goal) / np.log(1 - p_right)))
#
# check_measurements_needed(chance_to_be_wrong)

# %% [markdown] tags=["statement"]
# ## Exercise 4: lost in the corridor
#
# Assemble your filter: in each step the robot moves (your `predict`), then it looks (your
# `update`). Sometimes its eyes are closed: `seen` is -1 then.


# %% tags=["exercise"]
def wander(belief: Array, doors: Array, steps: Array, seen: Ints, p_right: float) -> Array:
    """Beliefs of a robot that wanders round the corridor.

    Parameters
    ----------
    belief : ndarray, shape (n,)
        Before the first step.
    doors : ndarray, shape (n,)
        1 where there is a door, 0 where there is a wall.
    steps : ndarray, shape (T, 3)
        p_stay, p_step and p_slip of each step.
    seen : ndarray of int, shape (T,)
        1 for a door, 0 for a wall, -1 for closed eyes.
    p_right : float
        How often the eye is right.

    Returns
    -------
    ndarray, shape (T, n)
        The belief after each step.
    """
    found = []
    for step, saw in zip(steps, seen, strict=True):
        belief = predict(belief, *step)
        if saw >= 0:
            belief = update(belief, doors, saw, p_right)
        found.append(belief)
    return np.array(found)


# %% active="ipynb" tags=["try"]
# wander(np.full(4, 0.25), np.array([1, 0, 0, 0]), np.array([[0.1, 0.8, 0.1]]),
#        np.array([1]), 0.9)

# %% [markdown] tags=["hint"]
# A loop over the steps: first the motion, then the measurement, then write the belief down.

# %% [markdown] tags=["hint"]
# Closed eyes are no wall: what does a filter do that is given nothing?


# %% tags=["cases"]
@drawn
def _lost(rng: np.random.Generator, n_steps: int, closed: float = 0.0) -> Any:
    n = int(rng.integers(4, 10))
    steps = np.array([weights(rng, 3) for _ in range(n_steps)])
    seen = np.where(rng.random(n_steps) < closed, -1, rng.integers(0, 2, n_steps))
    doors = [0, 1, *rng.integers(0, 2, n - 2)]
    return weights(rng, n), doors, steps, seen, float(np.round(rng.uniform(0.6, 0.95), 2))


def _wander_drawn(ax: Any, function: Any) -> None:
    """Draw the belief of every step, the darker the likelier, and where the robot was."""
    from slamlab import plots

    rng, doors = np.random.default_rng(7), np.array([1.0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 0])
    steps = np.tile([0.05, 0.9, 0.05], (40, 1))
    places = (4 + np.cumsum(rng.choice(3, 40, p=steps[0]))) % 12
    right = rng.random(40) < 0.95
    seen = np.where(right, doors[places], 1 - doors[places]).astype(int)
    seen[15:22] = -1
    beliefs = np.asarray(function(np.full(12, 1 / 12), doors, steps, seen, 0.95), float)
    ax.imshow(beliefs.T, origin="lower", aspect="auto", cmap="Blues", vmin=0, vmax=1)
    ax.plot(places, "o", color=plots.COLOURS["truth"], markersize=2.5)
    ax.set(xlabel="step; eyes closed in 15 to 21", ylabel="place (dots: the robot)")


check_wander = Check(
    wander,
    "beliefs",
    {
        "one step with closed eyes": _lost(1, 1.0),
        "one step and one measurement": _lost(1),
        "a walk": _lost(8),
        "a walk with closed eyes now and then": _lost(10, 0.5),
    },
    picture=_wander_drawn,
)

# %% tags=["mistakes"]
check_wander.mistakes = {
    "it looked before it moved: predict first": (
        "predict(belief, *step) => belief",
        "found.append(belief) => found.append(belief := predict(belief, *step))",
    ),
    "closed eyes were taken for a wall: no measurement, no update": (
        "if saw >= 0 => if True",
        "doors, saw, => doors, max(saw, 0),",
    ),
    "only doors count here: seeing a wall is a measurement too": "if saw >= 0 => if saw > 0",
    "the robot stands still while its eyes are closed: predict at every step": (
        "predict(belief, *step) => predict(belief, *step) if saw >= 0 else belief"
    ),
    "the measurements were not used": "if saw >= 0 => if False",
    "nothing was predicted: the robot moves": "predict(belief, *step) => belief + 0.0",
    "only the last belief was returned: expected one after each step": lambda *given: wander(
        *given
    )[-1],
    "every step began at the first belief: the old result is the new prior": (
        "found = [] => found, first = [], belief",
        "predict(belief, => predict(first,",
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: lost in the corridor
#
# The old result is the new prior: that is the whole filter.

# %% [markdown] tags=["solution"]
# A robot that takes closed eyes for a wall hears news where there is none:

# %% active="ipynb" tags=["solution"]
# def dark_is_a_wall(belief, doors, steps, seen, p_right):
#     return wander(belief, doors, steps, np.maximum(seen, 0), p_right)
#
# check_wander(dark_is_a_wall)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 01](../solutions/01_bayes_filter.ipynb).
