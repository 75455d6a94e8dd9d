"""Exercises, chapter 01: predict and update of a Bayes filter in a corridor with two ends.

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
# The lesson's corridor was a circle, and its eye erred alike at doors and at walls. In these four
# exercises the corridor has two ends, and the eye has a weakness; at the end a hundred robots
# patrol it with your filter. The chapter is [The Bayes filter](../01_bayes_filter.ipynb). Replace
# each `...` and run the check below it as often as you like; then draw what you built beside what
# is expected.

# %% [markdown] tags=["solution"]
# # Solutions 01: the Bayes filter
#
# The exercises are in [Exercises 01](../exercises/01_bayes_filter.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: a corridor with an end
#
# A robot walks to the right in a corridor that ends at a wall: place n - 1 is the last. In a step
# it stays with probability `p_stay`, moves one place with `p_step`, or slips two places with
# `p_slip`; but a robot that would pass the end bumps into the wall and stands at the last place.
# With a pencil: a sure belief in the last place but one, what becomes of it? Write P2 (4) for this
# corridor.


# %% tags=["exercise"]
def predict(belief: Array, p_stay: float, p_step: float, p_slip: float) -> Array:
    """Move the belief by one step to the right, in a corridor with an end.

    Parameters
    ----------
    belief : ndarray, shape (n,)
        Probability of each place, from left to right; n is at least 3.
    p_stay, p_step, p_slip : float
        Probabilities of moving by 0, 1 and 2 places; they sum to one. Whoever would
        pass the last place stands there.

    Returns
    -------
    ndarray, shape (n,)
    """
    moved = p_stay * belief
    for share, places in ((p_step, 1), (p_slip, 2)):
        moved[places:] += share * belief[:-places]
        moved[-1] += share * belief[-places:].sum()
    return moved


# %% active="ipynb" tags=["try"]
# predict(np.array([0.0, 1.0, 0.0, 0.0]), 0.1, 0.7, 0.2)

# %% [markdown] tags=["hint"]
# From which three places can the robot have come to place i?

# %% [markdown] tags=["hint"]
# The lesson's `np.roll` carries what leaves on the right back in on the left. Here
# `moved[1:] += p_step * belief[:-1]` moves one place without that. Whose share is then missing?

# %% [markdown] tags=["hint"]
# Probability must still sum to one. What would pass the end was in the last place (for a step), or
# in the last two (for a slip); it all stands in the last place now.


# %% tags=["cases"]
def _corridor(rng: np.random.Generator) -> Any:
    return weights(rng, int(rng.integers(3, 12))), *weights(rng, 3)


def _predict_drawn(ax: Any, function: Any) -> None:
    """Draw the belief after three steps near the end, and where 100 000 robots stand."""
    from slamlab import plots

    rng, belief, shares = np.random.default_rng(1), np.zeros(12), (0.1, 0.7, 0.2)
    belief[[7, 8]] = 0.7, 0.3
    robots = rng.choice(12, 100_000, p=belief) + rng.choice(3, (3, 100_000), p=shares).sum(0)
    robots = np.minimum(robots, 11)
    for _ in range(3):
        belief = np.asarray(function(belief, *shares), float)
    ax.plot(np.bincount(robots, minlength=12) / 100_000, **plots.line_style("truth"))
    ax.plot(np.arange(12), belief, "o", color=plots.COLOURS["estimate"], markersize=5)
    ax.set(xlabel="place; 11 is the last", ylabel="probability", ylim=(0, 0.5))


check_predict = Check(
    predict,
    "belief",
    {
        "a sure belief spreads to the right": ([0, 1, 0, 0, 0, 0], 0.1, 0.7, 0.2),
        "at the end: nobody leaves": ([0, 0, 0, 0, 0, 1], 0.1, 0.7, 0.2),
        "one place before the end": ([0, 0, 0, 0, 1, 0], 0.1, 0.7, 0.2),
        "two places before the end": ([0, 0, 0, 1, 0, 0], 0.1, 0.7, 0.2),
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


def _round(belief: Array, p_stay: float, p_step: float, p_slip: float) -> Any:
    return p_stay * belief + p_step * np.roll(belief, 1) + p_slip * np.roll(belief, 2)


check_predict.mistakes = {
    "this corridor is the lesson's circle: what would pass the end stays there": _round,
    "what would pass the end got lost: it stands at the last place": _open,
    "probability fell out at the end and the rest was stretched: it stands at the last place": (
        lambda *given: _open(*given) / _open(*given).sum()
    ),
    "a slip from the last place but one ends at the last place, too": (
        "belief[-places:].sum() => belief[-1]"
    ),
    "the whole share of the last two places was added for a step as well: a step from the last "
    "but one arrives": "belief[-places:].sum() => belief[-2:].sum()",
    "the robot bounced off the wall: it stands there": (
        lambda *given: (
            _open(*given)
            + np.append(
                np.zeros(len(given[0]) - 2),
                [given[2] * given[0][-1] + given[3] * given[0][-2], given[3] * given[0][-1]],
            )
        )
    ),
    "the belief moved to the left: place i receives what stood at i - 1": (
        lambda belief, *shares: predict(belief[::-1], *shares)[::-1]
    ),
    "the slip was forgotten: three displacements are possible": (
        "((p_step, 1), (p_slip, 2)) => ((p_step, 1),)"
    ),
    "the step was forgotten: three displacements are possible": (
        "((p_step, 1), (p_slip, 2)) => ((p_slip, 2),)"
    ),
    "the robot that stays was forgotten: three displacements are possible": (
        "moved = p_stay * belief => moved = 0 * belief"
    ),
    "the slip moves by two places, not by one": "(p_slip, 2) => (p_slip, 1)",
    "the slip moves by two places, not by three": "(p_slip, 2) => (p_slip, 3)",
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
# ## Solution 1: a corridor with an end
#
# Each displacement moves its own share of the belief, and what would pass the end is added to the
# last place: after a step what stood in the last place, after a slip what stood in the last two.

# %% [markdown] tags=["solution"]
# A shift that lets the share fall out, and a division by the sum that hides it: probability sums
# to one and stands at the wrong places. The lost share belonged to the end, and was dealt out to
# all.

# %% active="ipynb" tags=["solution"]
# def stretched(belief, p_stay, p_step, p_slip):
#     moved = p_stay * belief
#     moved[1:] += p_step * belief[:-1]
#     moved[2:] += p_slip * belief[:-2]
#     return moved / moved.sum()
#
# check_predict(stretched)

# %% [markdown] tags=["solution"]
# An end is worth something: a robot that knows nothing and walks on blindly finds itself there.

# %% active="ipynb" tags=["solution"]
# belief = np.full(12, 1 / 12)
# for _ in range(12):
#     belief = predict(belief, 0.1, 0.8, 0.1)
# print(f"after twelve blind steps: {belief[-1]:.2f} at the last place")

# %% [markdown] tags=["statement"]
# ## Exercise 2: an eye with a weakness
#
# The eye says `1.0` (door) or `0.0` (wall). Where there is a door it says *door* with probability
# `p_door`; where there is none it says *wall* with probability `p_wall`. A camera in the dark
# overlooks every second door and hardly ever invents one: `p_door` = 0.5, `p_wall` = 0.98. Predict
# before you write: which of its two answers tells more? Write P2 (5).


# %% tags=["exercise"]
def update(belief: Array, doors: Array, sees_door: float, p_door: float, p_wall: float) -> Array:
    """Weigh the belief by what the eye said.

    Parameters
    ----------
    belief : ndarray, shape (n,)
        Probability of each place.
    doors : ndarray, shape (n,)
        1.0 where there is a door, 0.0 where there is wall.
    sees_door : float
        1.0 or 0.0, what the eye said.
    p_door, p_wall : float
        Probability that the eye is right at a door, and at a wall.

    Returns
    -------
    ndarray, shape (n,)
        Probabilities; they sum to one.
    """
    right = np.where(doors == 1, p_door, p_wall)
    posterior = belief * np.where(doors == sees_door, right, 1 - right)
    return posterior / posterior.sum()


# %% active="ipynb" tags=["try"]
# update(np.full(4, 0.25), np.array([1.0, 0.0, 0.0, 1.0]), 0.0, 0.5, 0.98)

# %% [markdown] tags=["hint"]
# How likely is the answer *wall* at a place where there is wall? And at a place with a door? Four
# numbers, one for each pair of place and answer. Write them into a table of two by two.

# %% [markdown] tags=["hint"]
# The likelihood is a number for *every place*, for the one answer that came. In which column of
# your table does it stand?

# %% [markdown] tags=["hint"]
# `np.where(doors == 1, p_door, p_wall)` is how often the eye is right at each place. Where it
# contradicts the place, it was wrong. Then multiply, and divide by the sum.


# %% tags=["cases"]
def _seen(rng: np.random.Generator) -> Any:
    n = int(rng.integers(2, 12))
    belief, right = weights(rng, n, rng.integers(0, n, 1)), np.round(rng.uniform(0.1, 1, 2), 2)
    doors = rng.integers(0, 2, n)
    return belief, [0, 1, *doors[2:]], float(rng.integers(0, 2)), *right


_DOORS = [1, 0, 0, 1, 0, 1]


def _update_drawn(ax: Any, function: Any) -> None:
    """Draw the belief after a wall is seen, and where the robots stand whose eye says wall."""
    from slamlab import plots

    rng, doors = np.random.default_rng(2), np.array([1.0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 0])
    belief = np.exp(-0.5 * ((np.arange(12) - 5) / 2.5) ** 2)
    belief /= belief.sum()
    robots = rng.choice(12, 100_000, p=belief)
    right = rng.random(100_000) < np.where(doors[robots] == 1, 0.6, 0.95)
    says_door = right == (doors[robots] == 1)
    counts = np.bincount(robots[~says_door], minlength=12)
    ax.plot(counts / counts.sum(), **plots.line_style("truth"))
    after = np.asarray(function(belief, doors, 0.0, 0.6, 0.95), float)
    ax.plot(np.arange(12), after, "o", color=plots.COLOURS["estimate"], markersize=5)
    for place in np.flatnonzero(doors):
        ax.axvline(place, color="0.6", lw=1, ls=":")
    ax.set(xlabel="place; dotted: doors", ylabel="probability", ylim=(0, 0.35))


check_update = Check(
    update,
    "belief",
    {
        "a door seen from anywhere": (np.full(6, 1 / 6), _DOORS, 1, 0.8, 0.6),
        "a wall is news too": (np.full(6, 1 / 6), _DOORS, 0, 0.8, 0.7),
        "a dark corridor: no door seen": (np.full(6, 1 / 6), _DOORS, 0, 0.5, 0.98),
        "a dark corridor: a door seen": (np.full(6, 1 / 6), _DOORS, 1, 0.5, 0.98),
        "the old belief counts": ([0.5, 0.1, 0.1, 0.1, 0.1, 0.1], _DOORS, 1, 0.9, 0.9),
        "an excluded place stays excluded": ([0.0, 0.2, 0.2, 0.6, 0.0, 0.0], _DOORS, 0, 0.7, 0.8),
        "an eye that says door half the time, everywhere, tells nothing": (
            [0.3, 0.3, 0.4],
            [0, 1, 0],
            1,
            0.5,
            0.5,
        ),
        "an eye that always says door tells nothing": ([0.3, 0.3, 0.4], [0, 1, 0], 1, 1.0, 0.0),
        "an eye that is never wrong": ([0.3, 0.3, 0.4], [0, 1, 1], 1, 1.0, 1.0),
        "any corridor, any eye": _seen,
    },
    picture=_update_drawn,
)

# %% tags=["mistakes"]
check_update.mistakes = {
    "a wall changed nothing: seeing a wall is a measurement too": (
        lambda belief, doors, sees_door, *right: (
            update(belief, doors, sees_door, *right) if sees_door else belief.copy()
        )
    ),
    "the result is not normalised: divide by its sum": " / posterior.sum() => ",
    "belief and likelihood were added: evidence multiplies": "belief * => belief +",
    "the prior was forgotten: multiply the likelihood with the old belief": "belief *  => ",
    "only doors count here: seeing a wall is a measurement too": "== sees_door => == 1",
    "the sensor is not perfect: places that disagree keep a little": "1 - right => 0.0",
    "the place decides which of the two numbers counts, not the answer": (
        "doors == 1, p_door => sees_door == 1, p_door"
    ),
    "p_door was taken for both: at a wall the eye is right with p_wall": (
        "p_door, p_wall) => p_door, p_door)"
    ),
    "p_door and p_wall are exchanged": "p_door, p_wall) => p_wall, p_door)",
    "the sensor was read the wrong way round: agreeing places get the chance to be right": (
        "right, 1 - right => 1 - right, right"
    ),
    "divided by the largest entry: probabilities must sum to one": (
        "posterior.sum() => posterior.max()"
    ),
    "the measurement was counted twice": (
        lambda belief, *seen: update(update(belief, *seen), *seen)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: an eye with a weakness
#
# Rows are places, columns are answers, and each row sums to one: at a door `p_door` and `1 -
# p_door`, at a wall `1 - p_wall` and `p_wall`. Bayes' rule takes one *column*, the answer that
# came.

# %% [markdown] tags=["solution"]
# In the dark *door* tells more: the odds of a door rise by 0.5 : 0.02, while *wall* lowers them by
# 0.98 : 0.5 only. An update that takes the number by the answer and not by the place reads a row:

# %% active="ipynb" tags=["solution"]
# def by_the_answer(belief, doors, sees_door, p_door, p_wall):
#     right = p_door if sees_door else p_wall
#     posterior = belief * np.where(doors == sees_door, right, 1 - right)
#     return posterior / posterior.sum()
#
# for answer in (1.0, 0.0):
#     given = np.array([0.5, 0.5]), np.array([1.0, 0.0]), answer, 0.5, 0.98
#     print(f"says {answer:.0f}: door with {update(*given)[0]:.2f}, "
#           f"read by the answer {by_the_answer(*given)[0]:.2f}")

# %% [markdown] tags=["statement"]
# ## Exercise 3: how many measurements? (pencil first)
#
# The robot stands still, and the corridor has a single door. Before the first measurement the
# robot believes with $p_0$ that it stands at the door. Now its eye says *door*, again and again;
# wherever it looks, it is right with probability $p$, whatever it said before. After how many
# measurements is the belief in the door at least $g$? On paper: what happens in one measurement to
# the *odds*, to $b / (1 - b)$?


# %% tags=["exercise"]
def measurements_needed(prior: float, p_right: float, goal: float) -> int:
    """Fewest agreeing measurements after which the belief is at least `goal`.

    Parameters
    ----------
    prior : float
        Belief in the door before the first measurement, above 0 and below 1.
    p_right : float
        How often the eye is right, more than one half and below 1.
    goal : float
        Belief that is to be reached, above 0 and below 1.

    Returns
    -------
    int
        0 if the prior is enough.
    """
    odds, n = prior / (1 - prior), 0
    while odds / (1 + odds) < goal and n < 100_000:  # if the eye were a coin
        odds, n = odds * p_right / (1 - p_right), n + 1
    return n


# %% active="ipynb" tags=["try"]
# measurements_needed(1 / 6, 0.8, 0.95)

# %% [markdown] tags=["hint"]
# The belief in the door is multiplied by $p$, that in all other places together by $1 - p$; then
# both are divided by one number.

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
# ## Exercise 4: a hundred robots on patrol
#
# Assemble your filter. A robot patrols the corridor with two ends: in each step it walks to the
# right or to the left (your `predict` knows the right only; what is a walk to the left, seen in a
# mirror?), then its eye says something (your `update`). Sometimes its eye is closed: `seen` is -1
# then.
#
# The picture shows the belief of one patrol whose eye is closed in the last seven steps, and says
# how many of a hundred robots stand at their likeliest place at the end: with your filter, and
# with your filter and no eye at all (*blind*).


# %% tags=["exercise"]
def wander(
    belief: Array, doors: Array, ways: Ints, shares: Array, seen: Ints, eye: Array
) -> Array:
    """Beliefs of a robot that patrols the corridor.

    Parameters
    ----------
    belief : ndarray, shape (n,)
        Before the first step, from left to right.
    doors : ndarray, shape (n,)
        1 where there is a door, 0 where there is a wall.
    ways : ndarray of int, shape (T,)
        1 for a step to the right, -1 for one to the left.
    shares : ndarray, shape (3,)
        p_stay, p_step and p_slip, in either direction.
    seen : ndarray of int, shape (T,)
        1 for a door, 0 for a wall, -1 for a closed eye.
    eye : ndarray, shape (2,)
        p_door and p_wall.

    Returns
    -------
    ndarray, shape (T, n)
        The belief after each step.
    """
    found = []
    for way, saw in zip(ways, seen, strict=True):
        belief = predict(belief[::way], *shares)[::way]
        if saw >= 0:
            belief = update(belief, doors, saw, *eye)
        found.append(belief)
    return np.array(found)


# %% active="ipynb" tags=["try"]
# wander(np.full(4, 0.25), np.array([1, 0, 0, 0]), np.array([1]),
#        np.array([0.1, 0.8, 0.1]), np.array([1]), np.array([0.8, 0.95]))

# %% [markdown] tags=["hint"]
# A loop over the steps: first the motion, then the measurement, then write the belief down.

# %% [markdown] tags=["hint"]
# A closed eye is no wall: what does a filter do that is given nothing?

# %% [markdown] tags=["hint"]
# `belief[::-1]` is the corridor in a mirror. Predict there, and turn it back.


# %% tags=["cases"]
@drawn
def _lost(rng: np.random.Generator, n_steps: int, closed: float = 0.0) -> Any:
    n = int(rng.integers(4, 10))
    ways = rng.choice([1, -1], n_steps)
    seen = np.where(rng.random(n_steps) < closed, -1, rng.integers(0, 2, n_steps))
    doors = [0, 1, *rng.integers(0, 2, n - 2)]
    return (
        weights(rng, n),
        doors,
        ways,
        weights(rng, 3),
        seen,
        np.round(rng.uniform(0.6, 0.95, 2), 2),
    )


def _wander_drawn(ax: Any, function: Any) -> None:
    """Draw the belief of every step, the darker the likelier, and where the robot was."""
    from slamlab import plots

    doors = np.array([1.0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 0])
    ways, shares = np.tile(np.repeat([1, -1], 9), 3)[:40], np.array([0.05, 0.9, 0.05])
    eye, found = np.array([0.7, 0.95]), np.zeros(2, dtype=int)
    for seed in range(100):
        rng = np.random.default_rng(seed)
        places = [int(rng.integers(12))]
        for way, moved in zip(ways, rng.choice(3, 40, p=shares), strict=True):
            places.append(int(np.clip(places[-1] + way * moved, 0, 11)))
        door = doors[places[1:]] == 1
        right = rng.random(40) < np.where(door, *eye)
        seen = (right == door).astype(int)
        seen[33:] = -1
        for k, said in enumerate((seen, np.full(40, -1))):
            given = np.full(12, 1 / 12), doors, ways, shares, said, eye
            beliefs = np.asarray(function(*given), float)
            found[k] += beliefs[-1].argmax() == places[-1]
            if seed == 3 and k == 0:
                ax.imshow(beliefs.T, origin="lower", aspect="auto", cmap="Blues", vmin=0, vmax=1)
                ax.plot(places[1:], "o", color=plots.COLOURS["truth"], markersize=2.5)
    ax.grid(False)
    ax.set(xlabel="step; eye closed from 33 on", ylabel="place (dots: the robot)")
    ax.set(yticks=range(0, 12, 2))
    ax.set_title(f"found: {found[0]} of 100, blind {found[1]}")


check_wander = Check(
    wander,
    "beliefs",
    {
        "one step with a closed eye": _lost(1, 1.0),
        "one step and one measurement": _lost(1),
        "a walk": _lost(8),
        "a walk with a closed eye now and then": _lost(10, 0.5),
        "a patrol that turns at both ends": (
            np.full(5, 0.2),
            [1, 0, 0, 1, 0],
            [1, 1, 1, 1, 1, -1, -1, -1, -1, -1],
            [0.0, 1.0, 0.0],
            [-1] * 10,
            [0.8, 0.9],
        ),
    },
    picture=_wander_drawn,
)

# %% tags=["mistakes"]
check_wander.mistakes = {
    "it looked before it moved: predict first": (
        "predict(belief[::way], *shares)[::way] => belief",
        "found.append(belief) => found.append(belief := predict(belief[::way], *shares)[::way])",
    ),
    "a closed eye was taken for a wall: no measurement, no update": (
        "if saw >= 0 => if True",
        "doors, saw, => doors, max(saw, 0),",
    ),
    "only doors count here: seeing a wall is a measurement too": "if saw >= 0 => if saw > 0",
    "the robot stands still while its eye is closed: predict at every step": (
        "predict(belief[::way], *shares)[::way]"
        " => predict(belief[::way], *shares)[::way] if saw >= 0 else belief"
    ),
    "the measurements were not used": "if saw >= 0 => if False",
    "nothing was predicted: the robot moves": (
        "predict(belief[::way], *shares)[::way] => belief + 0.0"
    ),
    "all steps went to the right: `ways` was not used": (
        "predict(belief[::way], *shares)[::way] => predict(belief, *shares)"
    ),
    "the belief was not turned back after a step to the left": "*shares)[::way] => *shares)",
    "the directions are exchanged": lambda b, d, ways, *rest: wander(b, d, -ways, *rest),
    "only the last belief was returned: expected one after each step": lambda *given: wander(
        *given
    )[-1],
    "every step began at the first belief: the old result is the new prior": (
        "found = [] => found, first = [], belief",
        "predict(belief[ => predict(first[",
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: a hundred robots on patrol
#
# The old result is the new prior: that is the whole filter. A step to the left is a step to the
# right in a mirror, so one `predict` serves both.

# %% [markdown] tags=["solution"]
# What does it cost to take a closed eye for a wall, or to stand still while it is closed? A
# hundred patrols, eye closed in the last seven steps:

# %% active="ipynb" tags=["solution"]
# doors = np.array([1.0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 0])
# ways, shares = np.tile(np.repeat([1, -1], 9), 3)[:40], np.array([0.05, 0.9, 0.05])
# eye = np.array([0.7, 0.95])
#
# def patrol(rng):
#     place, seen = int(rng.integers(12)), []
#     for k, way in enumerate(ways):
#         place = int(np.clip(place + way * rng.choice(3, p=shares), 0, 11))
#         right = rng.random() < (eye[0] if doors[place] else eye[1])
#         seen.append(-1 if k > 32 else int(right == bool(doors[place])))
#     return place, np.array(seen)

# %% active="ipynb" tags=["solution"]
# def dark_is_a_wall(belief, doors, ways, shares, seen, eye):
#     return wander(belief, doors, ways, shares, np.maximum(seen, 0), eye)
#
# def stands_still(belief, doors, ways, shares, seen, eye):
#     open_ = seen >= 0
#     return wander(belief, doors, ways[open_], shares, seen[open_], eye)
#
# patrols = [patrol(np.random.default_rng([4, k])) for k in range(500)]
# for robot in (wander, dark_is_a_wall, stands_still):
#     known = [robot(np.full(12, 1 / 12), doors, ways, shares, seen, eye)[-1].argmax()
#              for _, seen in patrols]
#     found = np.mean(np.array(known) == [place for place, _ in patrols])
#     print(f"{robot.__name__:15s} found at the end: {found:.0%}")

# %% [markdown] tags=["solution"]
# A robot that takes its closed eye for a wall hears news where there is none, and one that does
# not predict in the dark is left behind. You have now a filter that needs two functions of three
# or four lines, for any corridor and any eye; chapter 02 writes the same two for a bell curve.

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 01](../solutions/01_bayes_filter.ipynb).
