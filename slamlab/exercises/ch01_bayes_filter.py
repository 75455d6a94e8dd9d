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
# The lesson's corridor was a circle, and its eye erred alike at doors and at walls. A robot on
# night watch has neither: its corridor has two ends, and its eye sees badly in the dark. You write
# its two formulas, ask how sure it may be before it acts, and at the end a hundred robots are on
# patrol with your filter. The chapter is [The Bayes filter](../01_bayes_filter.ipynb). Replace
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
# The lesson's `predict` would carry it through the wall, back to place 0.
#
# Pencil first: the robot is sure to be in the last place but one, and the three probabilities are
# 0.1, 0.7 and 0.2. What does it believe after a step? Then write the time update P2 (4) for this
# corridor; the call below is your pencil's question.
#
# $$
# P(x_k \mid Z_{0:k-1}, U_{0:k}) = \sum_{x_{k-1}} P(x_k \mid x_{k-1}, u_k)\,
# P(x_{k-1} \mid Z_{0:k-1}, U_{0:k-1})
# $$


# %% tags=["exercise"]
def predict(belief: Array, p_stay: float, p_step: float, p_slip: float) -> Array:
    """Move the belief by one step to the right, in a corridor with an end.

    Parameters
    ----------
    belief : ndarray, shape (n,)
        Probability of each place, from left to right; n is at least 3.
    p_stay, p_step, p_slip : float
        Probabilities of moving by 0, 1 and 2 places; they sum to one. A robot
        that would pass the last place stands there.

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
# predict(np.array([0.0, 0.0, 1.0, 0.0]), 0.1, 0.7, 0.2)

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
    ax.set_xticks(range(1, 12, 2))
    for _ in range(3):
        belief = np.asarray(function(belief, *shares), float)
    there = np.bincount(robots, minlength=12) / 100_000
    ax.plot(there, label="100 000 robots", **plots.line_style("truth"))
    ax.plot(np.arange(12), belief, "o", color=plots.COLOURS["estimate"], ms=5, label="belief")
    ax.set(xlabel="place; 11 is the last", ylabel="probability", ylim=(0, 0.5))
    ax.legend(loc="upper left", fontsize=9)


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
    "a circle, as in the lesson; this corridor has ends: what would pass the end stays there": _round,
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
# The pencil's answer: 0.1 stays in the last place but one, and 0.7 + 0.2 = 0.9 is in the last.

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
# What an end is worth: on the lesson's circle a robot that knows nothing knows nothing after a
# blind step either, for each place receives as much as it gives. Here it finds itself at the wall.

# %% active="ipynb" tags=["solution"]
# print("pencil:", predict(np.array([0.0, 0.0, 1.0, 0.0]), 0.1, 0.7, 0.2).round(2))
# belief = np.full(12, 1 / 12)
# for _ in range(12):
#     belief = predict(belief, 0.1, 0.8, 0.1)
# print(f"after twelve blind steps: {belief[-1]:.2f} at the last place")

# %% [markdown] tags=["statement"]
# ## Exercise 2: an eye with a weakness
#
# The eye says `1.0` (door) or `0.0` (wall). Where there is a door it says *door* with probability
# `p_door`; where there is none it says *wall* with probability `p_wall`. In the lesson these were
# one number. A camera at night overlooks every second door and hardly ever invents one: `p_door` =
# 0.5, `p_wall` = 0.98.
#
# Predict before you write: the robot gives a door a chance of one half. Which of the two answers
# moves that further, *door* or *wall*? Then write the measurement update P2 (5). The call below
# asks for both answers; doors are at the first and the last of four places.
#
# $$
# P(x_k \mid Z_{0:k}, U_{0:k}) = \frac{P(z_k \mid x_k)\, P(x_k \mid Z_{0:k-1}, U_{0:k})}
# {P(z_k \mid Z_{0:k-1}, U_{0:k})}
# $$


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
# doors = np.array([1.0, 0.0, 0.0, 1.0])
# [update(np.full(4, 0.25), doors, says, 0.5, 0.98) for says in (1.0, 0.0)]

# %% [markdown] tags=["hint"]
# How likely is the answer *wall* at a place where there is wall? And at a place with a door? Four
# numbers, one for each pair of place and answer. Write them into a table of two by two: rows are
# places, columns are answers.

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
    ax.set_xticks(range(0, 12, 2))
    counts = np.bincount(robots[~says_door], minlength=12)
    ax.plot(counts / counts.sum(), label="robots", **plots.line_style("truth"))
    after = np.asarray(function(belief, doors, 0.0, 0.6, 0.95), float)
    ax.plot(np.arange(12), after, "o", color=plots.COLOURS["estimate"], ms=5, label="belief")
    for place in np.flatnonzero(doors):
        ax.axvline(place, color="0.6", lw=1, ls=":")
    ax.set(xlabel="place; dotted: doors", ylabel="probability", ylim=(0, 0.35))
    ax.legend(loc="upper right", fontsize=9)


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
    "at a wall the two answers are exchanged: there the eye says door with 1 - p_wall, and wall "
    "with p_wall": (
        "np.where(doors == sees_door, right, 1 - right) => (right if sees_door else 1 - right)"
    ),
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
# At night *door* tells more: it multiplies the odds of a door by 0.5 / 0.02 = 25, while *wall*
# divides them by 0.98 / 0.5 = 1.96 only. From one half the chance of a door rises to 0.96, or
# falls to 0.34. An update that takes the number by the answer and not by the place reads a row of
# the table: *door* is worth nothing then, and *wall* all but excludes every door.

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
# A robot with an arm is to push open the only door of the corridor, and an arm that pushes at a
# wall breaks. So the robot stands still and looks, until its belief $b$ in the door is at least
# $g$. At first it is $p_0$. Now its eye says *door*, again and again; wherever it looks, it is
# right with probability $p$, whatever it said before: given the place, its answers are independent
# of each other. (That is what the frozen eye of the lesson broke.) After how many measurements may
# the arm push? On paper: what does one measurement do to the *odds*, to $b / (1 - b)$?
#
# The picture counts robots, with $p_0 = 1/6$ and $p = 0.8$: of those whose eye said *door* n
# times, how many are at the door? A cross is your n for a goal. Guess first: what becomes of that
# curve if the eye is frozen, and repeats its first answer?


# %% tags=["exercise", "predict"]
def measurements_needed(prior: float, p_right: float, goal: float) -> int:
    """Fewest agreeing measurements after which the belief is at least `goal`.

    Parameters
    ----------
    prior : float
        Belief in the door before the first measurement, p_0, above 0 and below 1.
    p_right : float
        How often the eye is right, p, more than one half and below 1.
    goal : float
        Belief that is to be reached, g, above 0 and below 1.

    Returns
    -------
    int
        0 if the prior is enough; exactly the goal is enough.
    """
    odds, goal_odds = prior / (1 - prior), goal / (1 - goal)
    n = np.log(goal_odds / odds) / np.log(p_right / (1 - p_right))
    return max(0, int(np.ceil(n)))


# %% active="ipynb" tags=["try"]
# measurements_needed(1 / 6, 0.8, 0.95)

# %% [markdown] tags=["hint"]
# There are two beliefs only: that in the door, and that in all other places together. By which
# numbers does the answer *door* multiply them?

# %% [markdown] tags=["hint"]
# Then both are divided by the evidence. Odds are their quotient: what becomes of the evidence
# there? Turn $p_0$ and $g$ into odds, too.

# %% [markdown] tags=["hint"]
# One measurement multiplies the odds by $p / (1 - p)$. Multiply in a loop until they reach those
# of $g$, or ask a logarithm how often. How many if $p_0$ is above $g$ from the start?


# %% tags=["cases"]
def _an_eye(rng: np.random.Generator) -> Any:
    return tuple(
        np.round([rng.uniform(0.02, 0.6), rng.uniform(0.55, 0.95), rng.uniform(0.5, 0.999)], 3)
    )


def _measurements_drawn(ax: Any, function: Any) -> None:
    """Draw the share at the door of robots whose eye said door n times, and n for each goal."""
    from slamlab import plots

    goals = np.linspace(0.1, 0.99, 30)
    ax.set_xticks(range(0, 9, 2))
    needed = [float(function(1 / 6, 0.8, goal)) for goal in goals]
    rng = np.random.default_rng(3)
    there, right = rng.random(200_000) < 1 / 6, rng.random((8, 200_000)) < 0.8
    for eye, style in (("robots", "truth"), ("robots with a frozen eye", "wrong")):
        said_door = (right if style == "truth" else right[:1].repeat(8, 0)) == there
        always = np.vstack([there >= 0, np.logical_and.accumulate(said_door)])
        share = [there[said].mean() for said in always]
        ax.plot(share, label=eye, **plots.line_style(style))
    ax.plot(needed, goals, "+", color=plots.COLOURS["estimate"], ms=7, label="needed for a goal")
    ax.set(xlabel="measurements, all of them door", ylabel="share at the door; goal")
    ax.legend(loc="lower right", fontsize=9)


check_measurements_needed = Check(
    measurements_needed,
    "measurements",
    {
        "one place in six, an eye right four times of five": (1 / 6, 0.8, 0.95),
        "believed before the first measurement": (0.6, 0.8, 0.5),
        "believed far more than is asked for": (0.99, 0.6, 0.5),
        "one measurement is enough": (0.4, 0.9, 0.8),
        "exactly the goal is enough": (0.5, 0.75, 0.75),
        "hardly believed, and asked for nearly sure": (0.02, 0.6, 0.99),
        "an eye that hardly knows": (0.5, 0.55, 0.9),
        "any eye": _an_eye,
    },
    picture=_measurements_drawn,
)


# %% tags=["mistakes"]
check_measurements_needed.mistakes = {
    "a number of measurements is not negative: the prior may be above the goal already": (
        "max(0, int(np.ceil(n))) => int(np.ceil(n))"
    ),
    "one measurement too many where the goal is reached exactly": (
        "int(np.ceil(n)) => int(np.floor(n)) + 1"
    ),
    "no measurement is needed where the prior is enough": "max(0, => max(1,",
    "rounded down: afterwards the belief is still below the goal": (
        "int(np.ceil(n)) => int(np.floor(n))"
    ),
    "rounded to the nearest number: below the goal is not enough": (
        "int(np.ceil(n)) => int(np.rint(n))"
    ),
    "measurements are counted in whole numbers: the fewest that reach the goal": (
        "int(np.ceil(n)) => n"
    ),
    "one measurement too few: afterwards the belief is still below the goal": (
        "int(np.ceil(n))) => int(np.ceil(n))) - 1"
    ),
    "one measurement too many": "int(np.ceil(n))) => int(np.ceil(n))) + 1",
    "the prior was taken for one half": "goal_odds = prior / (1 - prior) => goal_odds = 1.0",
    "odds were compared with a probability: turn the goal into odds, too": (
        "goal / (1 - goal) => goal"
    ),
    "the prior is a probability, not odds": "prior / (1 - prior) => prior",
    "the places that disagree got nothing taken off: odds grow by p / (1 - p)": (
        "p_right / (1 - p_right) => p_right / 0.5"
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
# 256 : 5. How often it fits between the odds of $p_0$ and those of $g$ is a quotient of two
# logarithms, rounded up; a loop that multiplies is as good.
#
# In the picture the robots agree with that: of those whose eye said *door* n times, so many are
# there. With a frozen eye the first answer is repeated, and the odds stay at 4 : 5, a share of
# 0.44, however often it comes. This robot would push after four copies, and break its arm more
# often than not.

# %% [markdown] tags=["solution"]
# *The chance that the eye is wrong n times is $(1 - p)^n$* answers another question: it forgets
# the prior, and how probable the same answers are if the place is the right one, $p^n$. That is
# why it fails even from a prior of one half, below with $p = 0.55$: 3 where 11 are needed.

# %% active="ipynb" tags=["solution"]
# n = measurements_needed(1 / 6, 0.8, 0.95)
# odds = (1 / 5) * 4**n
# print(f"after {n} answers the belief is {odds / (1 + odds):.2f};",
#       f"after {n} copies of one answer {4 / (4 + 5):.2f} of the robots are at the door")

# %% active="ipynb" tags=["solution"]
# def chance_to_be_wrong(prior, p_right, goal):
#     return int(np.ceil(np.log(1 - goal) / np.log(1 - p_right)))
#
# check_measurements_needed(chance_to_be_wrong)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a hundred robots on patrol
#
# Assemble your filter. A robot patrols the corridor with two ends, to and fro. It starts anywhere
# and has a map of the doors. In each step it first walks, to the right or to the left, then it
# looks, and its eye says something. Sometimes the light fails: its eye is closed then, and `seen`
# is -1.
#
# Two things are new. Your `predict` knows the right only, and at the left end there is a wall as
# well: how can the same function serve both ways? And what does a filter do when it is given no
# measurement?
#
# A patrol is forty steps among twelve places: nine to the right, nine to the left, and so on. A
# step succeeds with 0.9 (stays or slips with 0.05 each), and the eye has `p_door` = 0.7 and
# `p_wall` = 0.95. In the last seven steps, three to the left and four to the right, it is closed.
# The picture shows the belief of one such patrol. Above it stands how many robots of a hundred are
# *found* at the end (the likeliest place is the true one) or found *within one place*; and the
# same with your filter and an eye that is closed from the first step on (*blind*). By chance one
# of twelve is found, 8 of a hundred. Guess first: how many are found with the eye, and how many
# blind?


# %% tags=["exercise", "predict"]
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
# A loop over the steps: first the motion, then the measurement, then write the belief down. The
# belief at the end of one step is what the next one starts from.

# %% [markdown] tags=["hint"]
# A closed eye is no wall, and the robot walks on. Which of your two functions has nothing to do?

# %% [markdown] tags=["hint"]
# What is a walk to the left, seen in a mirror? `belief[::-1]` is the corridor there. Predict in
# the mirror, and turn the result back.


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
    eye, counts = np.array([0.7, 0.95]), np.zeros((2, 2))
    ax.set(xticks=range(0, 40, 10), yticks=range(0, 12, 2))
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
            last = beliefs[-1] if len(beliefs) else given[0]
            # Of places that are equally likely, one is guessed: each counts with its share.
            off = abs(np.flatnonzero(last > last.max() - 1e-12) - places[-1])
            counts[k] += (off == 0).mean(), (off <= 1).mean()
            if seed == 94 and k == 0:
                ax.imshow(beliefs.T, origin="lower", aspect="auto", cmap="Blues", vmin=0, vmax=1)
                ax.plot(places[1:], "o", color=plots.COLOURS["truth"], ms=2.5, label="robot")
    ax.plot(np.full(5, -2.5), np.flatnonzero(doors), "k*", mfc="none", ms=7, label="door")
    ax.axvline(32.5, color="0.4", lw=1, ls=":", label="eye closes")
    ax.legend(loc="upper center", fontsize=8, ncols=3, columnspacing=1, handletextpad=0.2)
    ax.grid(False)
    ax.set(xlabel="step", ylabel="place", ylim=(-0.5, 14), xlim=(-3, 40))
    (found, near), (blind, near_blind) = np.rint(counts).astype(int)
    ax.set_title(
        f"found {found} of 100, blind {blind}\nwithin one place {near}, blind {near_blind}"
    )


check_wander = Check(
    wander,
    "beliefs",
    {
        "two steps with a closed eye": _lost(2, 1.0),
        "two steps and two measurements": _lost(2),
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
def _in_a_circle(
    belief: Array, doors: Array, ways: Ints, shares: Array, seen: Ints, eye: Array
) -> Array:
    found = []
    for way, saw in zip(ways, seen, strict=True):
        belief = np.array([np.roll(belief, way * k) for k in range(3)]).T @ shares
        if saw >= 0:
            belief = update(belief, doors, saw, *eye)
        found.append(belief)
    return np.array(found)


check_wander.mistakes = {
    "a circle, as in the lesson; this corridor has a wall at either end": _in_a_circle,
    "the belief before the first step was returned as well: one row a step": (
        "found = [] => found = [belief]"
    ),
    "each row is the belief before its step: expected the one after it": (
        "        belief = predict( =>         found.append(belief)\n        belief = predict(",
        "        found.append(belief)\n    return =>     return",
    ),
    "it looked before it moved: predict first": (
        "predict(belief[::way], *shares)[::way] => belief",
        "found.append(belief) => found.append(belief := predict(belief[::way], *shares)[::way])",
    ),
    "a closed eye was taken for a wall: no measurement, no update": (
        "if saw >= 0 => if True",
        "doors, saw, => doors, max(saw, 0),",
    ),
    "a closed eye was taken for a door: no measurement, no update": (
        "if saw >= 0 => if True",
        "doors, saw, => doors, abs(saw),",
    ),
    "a closed eye was handed to `update`, which knows two answers: no measurement, no update": (
        "if saw >= 0 => if True"
    ),
    "a wall was left out, and a closed eye was not: `if` takes 0 for false and -1 for true": (
        "if saw >= 0 => if saw"
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
# right in a mirror, so one `predict` serves both. A closed eye is no measurement, so there is no
# update; the motion goes on, and so does `predict`.
#
# Of the hundred robots 46 are found at the end, and 90 within one place; blind it is 30 and 68.

# %% [markdown] tags=["solution"]
# The patrol of the picture begins with an error: while the robot walks to the right the filter
# believes in the right end, where such robots gather. On the way back its eye says
# *door* twice in a row, at places 6 and 5, and from there on the likeliest place is the true one
# in every step, in the dark too. How usual is such a patrol, and what does a defect in the dark
# cost? Five hundred others of this kind:

# %% active="ipynb" tags=["solution"]
# doors = np.array([1.0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 0])
# ways, shares = np.tile(np.repeat([1, -1], 9), 3)[:40], np.array([0.05, 0.9, 0.05])
# eye, start = np.array([0.7, 0.95]), np.full(12, 1 / 12)
#
# def patrol(rng):
#     places, seen = [int(rng.integers(12))], []
#     for k, way in enumerate(ways):
#         moved = way * rng.choice(3, p=shares)
#         places.append(int(np.clip(places[-1] + moved, 0, 11)))
#         door = doors[places[-1]] == 1
#         right = rng.random() < (eye[0] if door else eye[1])
#         seen.append(-1 if k > 32 else int(right == door))
#     return np.array(places[1:]), np.array(seen)

# %% active="ipynb" tags=["solution"]
# patrols = [patrol(np.random.default_rng([4, k])) for k in range(500)]
# hit = np.array([wander(start, doors, ways, shares, seen, eye).argmax(1) == places
#                 for places, seen in patrols])
# low, high = np.percentile(hit.sum(1), [25, 75])
# dark = hit[:, 33:].sum(1)
# print(f"right in {low:.0f} to {high:.0f} of 40 steps: the middle half of the patrols")
# print(f"found just before the dark: {hit[:, 32].mean():.0%}; in the dark all seven",
#       f"steps right: {np.mean(dark == 7):.0%}, none: {np.mean(dark == 0):.0%}")

# %% [markdown] tags=["solution"]
# The patrol of the picture is right in 29 steps, and in all seven dark ones. Now the defects:

# %% active="ipynb" tags=["solution"]
# def dark_is_a_wall(belief, doors, ways, shares, seen, eye):
#     return wander(belief, doors, ways, shares, np.maximum(seen, 0), eye)
#
# def blind(belief, doors, ways, shares, seen, eye):
#     return wander(belief, doors, ways, shares, np.full(len(seen), -1), eye)
#
# def stands_still(belief, doors, ways, shares, seen, eye):
#     open_ = seen >= 0
#     return wander(belief, doors, ways[open_], shares, seen[open_], eye)
#
# def bad_robot(belief, doors, ways, shares, seen, eye):
#     return wander(belief, doors, ways, shares, seen, np.array([0.99, 0.99]))
#
# for robot in (wander, dark_is_a_wall, blind, stands_still, bad_robot):
#     off = [abs(robot(start, doors, ways, shares, seen, eye)[-1].argmax() - places[-1])
#            for places, seen in patrols]
#     print(f"{robot.__name__:14s} found at the end: {np.mean(np.equal(off, 0)):.0%},",
#           f"within one place: {np.mean(np.less(off, 2)):.0%}")

# %% [markdown] tags=["solution"]
# - **The robot that stops predicting is found least often.** It has used 33 measurements, and its
#   belief fits where it was before the dark: three steps left and four right end elsewhere, most
#   often one place on. The blind robot, which never measured anything, is found more often.
# - **Seven invented answers cost most of what the eye was worth.** The robot that takes the dark
#   for a wall is found hardly more often than the blind one here. In 38 other sets of 500 patrols
#   (5 to 42 for the 4 of the seed) it is 5 points more on average, where the eye is worth 16. In each
#   of them the right robot is found most often, and the one that stops predicting least often.
# - **A robot that trusts its eye too much** is found a little less often: 41 %, not 45.
# - **Blind is better than chance**, which finds one of twelve, or 8 of 100. It is exercise 1
#   again: a robot that walks against a wall stands there, so the two ends gather the belief,
#   whatever the eye says.
# - **Not found is seldom far off.** With the eye most of the others are one place off.
#
# You have now the whole Bayes filter, for a corridor with ends and an eye with two answers: a
# function of five lines, one of three, and a loop. Chapter 02 writes the same two functions for a
# bell curve.

# %% [markdown] tags=["statement"]
# A bet before you go: three more robots are on these patrols. One takes the closed eye for one
# that says *wall*. One does nothing in the dark, neither update nor predict, while it walks three
# steps to the left and four to the right. The third has its eye closed from the first step on.
# Which is found least often at the end?
#
# And a bad robot of your own: give `wander` an input that is wrong, or change a copy of your loop.
# Choose a defect, write down how many of the hundred it finds, and draw it. A difference of a few
# among a hundred robots can be chance. The bet can be settled here, too: the third robot is the *blind* one of the right panel. In the left panel *blind* is
# your bad robot with its eye closed from the first step on.

# %% active="ipynb" tags=["statement", "hide-output"] mystnb={"image": {"alt": "Two panels, your bad robot and the right one: the belief of a patrol, and how many robots of a hundred are found."}}
# def bad_robot(belief, doors, ways, shares, seen, eye):
#     eye = np.array([0.99, 0.99])    # trusts its eye too much: put your own defect here
#     return wander(belief, doors, ways, shares, seen, eye)
#
# check_wander.draw(bad_robot)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 01](../solutions/01_bayes_filter.ipynb).
