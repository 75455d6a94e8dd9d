"""Exercises, chapter 04: a sonar that errs, how many particles, one place of many, a corridor.

The weight is P2 (17) with a likelihood of two parts; the number of particles follows the cells
that the belief occupies, a plain form of KLD sampling.
"""

# mypy: disable-error-code="arg-type, assignment, no-untyped-def, no-untyped-call"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from math import erf
from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn
from slamlab.exercises._draw import weights as some_weights
from slamlab.exercises._report import Array, Check, Ints

__all__ = [
    "check_best_place",
    "check_localize",
    "check_particles_needed",
    "check_renew",
    "check_resample",
    "check_sonar",
]


# %% [markdown] tags=["chapter"]
# # Exercises 04: the particle filter
#
# Six exercises that end with a robot which finds itself in a corridor, with a sonar that is wrong
# in one reading of five: its likelihood, how many particles to begin with, how many to go on
# with, a bug, one answer out of many particles, and the whole drive, fifty times. The chapter is
# [The particle filter](../04_particle_filter.ipynb). Replace each `...` and run the check below
# it as often as you like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 04: the particle filter
#
# The exercises are in [Exercises 04](../exercises/04_particle_filter.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.exercises.ch04_particle_filter import resample as finished_resample

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: a sonar that is sometimes wrong
#
# A robot drives along the corridor of a hospital. Beacons hang from the ceiling, and its sonar
# measures the distance to the nearest one. In the share `p_hit` of the readings all is well, and
# the error is Gaussian, of standard deviation `sigma`. All others come from beds and people: any
# distance from 0 to `reach`, each equally likely. That is a model, the plainest: a bed in the way
# only makes an echo shorter. With the likelihood of the lesson one such reading may eliminate all
# particles round the robot.
#
# The density of a reading is the sum of two parts,
#
# $$
# p(z) = p_\mathrm{hit}\; p_\mathrm{good}(z) + (1 - p_\mathrm{hit})\; p_\mathrm{bad}(z) ,
# $$
#
# a Gaussian about what is expected, and a constant. The Gaussian is not cut off at 0 and at
# `reach`, nor is what a particle expects. Write the logarithm of the sum, for all particles at
# once.
#
# **On paper first.** Where $\hat z$ is expected, the lesson wrote
# $e^{-(z - \hat z)^2 / 2 \sigma^2}$ for a Gaussian, without a factor in front. Why may it? May
# you? Try a reading that fits and one that does not, with all lengths in metres, and once more in
# centimetres.
#
# The picture is folded: open it when you have answered. It lets sixty robots drive 4 m, each with
# two bad readings of ten, and draws where one of them began, by your likelihood and by the
# lesson's. *Found* means that more than half of the belief is within half a metre. It also says
# what one bad reading costs a particle: by which factor its weight falls below that of a particle
# whose reading fits. Whether a factor is missing in your density hardly changes how many robots
# are found: rely on the check for that.


# %% tags=["exercise", "predict"]
def sonar_log_likelihood(
    echo: float, expected: Array, sigma: float, p_hit: float, reach: float
) -> Array:
    """Log likelihood of one reading, for each particle.

    Parameters
    ----------
    echo : float
        What the sonar measured (m), within 0 and `reach`.
    expected : ndarray, shape (M,)
        Distance from each particle to its nearest beacon (m); it may exceed `reach`.
    sigma : float
        Standard deviation of a good reading (m).
    p_hit : float
        Share of the good readings, at least 0 and less than 1.
    reach : float
        Largest distance that the sonar measures (m).

    Returns
    -------
    ndarray, shape (M,)
        Natural logarithm of the density of the reading.
    """
    good = np.exp(-0.5 * ((echo - expected) / sigma) ** 2)
    good = good / (np.sqrt(2 * np.pi) * sigma)
    return np.log(p_hit * good + (1 - p_hit) / reach)


# %% active="ipynb" tags=["try"]
# sonar_log_likelihood(2.0, np.array([2.0, 2.4, 4.0]), 0.2, 0.8, 5.0)
# # about [0.49, -1.36, -3.22]

# %% [markdown] tags=["hint"]
# Only the ratio of two weights matters, since they are divided by their sum. Write down the ratio
# for a particle whose reading fits and one whose reading does not: with the lesson's density, then
# with the sum of two parts. What is left of the factor?

# %% [markdown] tags=["hint"]
# A density has the integral one. How high is one that is constant from 0 to `reach`? How high is
# a Gaussian at its top?

# %% [markdown] tags=["hint"]
# The logarithm of a sum is not the sum of the logarithms: take it last. Nothing underflows to
# $-\infty$, since the second part is never zero.


# %% tags=["cases"]
_CORRIDOR = np.array([2.0, 6.0, 11.0, 14.0, 21.0, 26.0])  # beacons (m)
_SONAR = np.array([0.2, 0.8, 5.0])  # sigma (m), p_hit, reach (m)


def _nearest(x: Any, beacons: Any) -> Any:
    """Return the distance from each place to the nearest beacon."""
    return np.abs(np.asarray(x)[..., None] - beacons).min(axis=-1)


def _heard(rng: np.random.Generator) -> Any:
    n, reach = int(rng.integers(2, 8)), float(np.round(rng.uniform(3, 9), 1))
    expected = np.round(rng.uniform(0, reach, n), 2)
    echo = float(np.round(np.clip(expected[0] + rng.normal(0, 0.2), 0, reach), 2))
    sigma, p_hit = np.round(rng.uniform([0.05, 0.3], [0.9, 0.95]), 2)
    return echo, expected, float(sigma), float(p_hit), reach


def _drives_off(seed: int) -> Any:
    """Return where a robot begins, how far it then is, and ten readings, two of them wrong."""
    rng, (sigma, _, reach) = np.random.default_rng(seed), _SONAR
    begin, steps = rng.uniform(1, 15), 0.4 * np.arange(1, 11)
    echoes = _nearest(begin + steps, _CORRIDOR) + rng.normal(0, sigma, 10)
    echoes[rng.choice(10, 2, replace=False)] = rng.uniform(0, reach, 2)
    return begin, steps, np.clip(echoes, 0, reach)


def _sonar_drawn(ax: Any, function: Any) -> None:
    """Draw the belief of where a drive began, by two likelihoods, and where it did."""
    from slamlab import plots

    x, found, beliefs = np.linspace(0, 16, 321), np.zeros(2, int), []
    for seed in range(60):
        begin, steps, echoes = _drives_off(seed)
        expected = _nearest(x + steps[:, None], _CORRIDOR)
        log_w = [
            np.asarray(function(float(z), e.copy(), *_SONAR.tolist()), float)
            for z, e in zip(echoes, expected, strict=True)
        ]
        plain = -0.5 * ((echoes[:, None] - expected) / _SONAR[0]) ** 2
        w = [np.exp(log - log.max()) for log in (np.sum(log_w, axis=0), plain.sum(0))]
        near = np.abs(x - begin) < 0.5
        found += [one[near].sum() > one.sum() / 2 for one in w]
        beliefs.append((begin, *w))
    begin, ours, lessons = beliefs[45]
    ax.axvline(begin, **plots.line_style("truth"))
    ax.plot(x, lessons, **plots.line_style("wrong"))
    ax.plot(x, ours, **plots.line_style("estimate"))
    ax.set(xlabel="begin (m); purple: lesson", ylabel="belief, largest 1")
    fits, not_at_all = np.asarray(function(2.0, np.array([2.0, 4.5]), *_SONAR.tolist()), float)
    cost = np.exp(min(fits - not_at_all, 20.0))
    cost_text = f"{cost:.0f}" if cost < 1e4 else "over 10 000"
    ax.set_title(f"{found[0]} of 60 found (lesson's {found[1]})\nbad reading: factor {cost_text}")


check_sonar = Check(
    sonar_log_likelihood,
    "log_likelihood",
    {
        "a reading that fits one particle": (2.0, [2.0, 3.0, 4.5], 0.2, 0.8, 5.0),
        "a reading that fits none": (4.5, [0.3, 1.0], 0.1, 0.9, 5.0),
        "a hundred sigmas off": (1.0, [1.0, 3.0], 0.02, 0.8, 4.0),
        "a sonar that is never right: all particles alike": (2.0, [2.0, 0.5], 0.2, 0.0, 5.0),
        "right under a beacon": (0.0, [0.0, 0.4], 0.3, 0.6, 8.0),
        "particles that are farther than `reach` from all beacons": (
            4.9, [5.2, 7.0], 0.3, 0.7, 5.0,
        ),
        "any reading": _heard,
    },
    picture=_sonar_drawn,
)  # fmt: skip


# %% tags=["mistakes"]
def _cut_off(echo: float, expected: Array, sigma: float, p_hit: float, reach: float) -> Any:
    """Divide the Gaussian by the part of it that is within 0 and `reach`."""
    ends = (np.array([[0.0], [reach]]) - expected) / (np.sqrt(2) * sigma)
    low, high = np.vectorize(erf, otypes=[float])(ends)
    good = np.exp(-0.5 * ((echo - expected) / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma)
    return np.log(p_hit * good / ((high - low) / 2) + (1 - p_hit) / reach)


check_sonar.mistakes = {
    "the factor in front of the Gaussian is missing: the second part does not share it": (
        "/ (np.sqrt(2 * np.pi) * sigma) => / 1"
    ),
    "a Gaussian of standard deviation sigma has the height 1 / (sqrt(2 pi) sigma)": (
        "np.sqrt(2 * np.pi) * sigma => 2 * np.pi * sigma"
    ),
    "sigma is missing in the factor in front of the Gaussian": (
        "np.sqrt(2 * np.pi) * sigma => np.sqrt(2 * np.pi)"
    ),
    "sqrt(2 pi) is missing in the factor in front of the Gaussian": (
        "np.sqrt(2 * np.pi) * sigma => sigma"
    ),
    "the factor in front has the variance in place of the standard deviation": (
        "(np.sqrt(2 * np.pi) * sigma) => (np.sqrt(2 * np.pi) * sigma**2)"
    ),
    "the uniform part has the height 1 / reach": "(1 - p_hit) / reach => (1 - p_hit)",
    "the two shares are exchanged": (
        "p_hit * good => (1 - p_hit) * good",
        "+ (1 - p_hit) / reach => + p_hit / reach",
    ),
    "the parts must be weighed by their shares, p_hit and 1 - p_hit": (
        "p_hit * good + (1 - p_hit) / reach => good + 1 / reach"
    ),
    "this is the density: return its logarithm": (
        "np.log(p_hit * good + (1 - p_hit) / reach) => p_hit * good + (1 - p_hit) / reach"
    ),
    "this is the sum of two logarithms: take the logarithm of the sum": (
        "np.log(p_hit * good + (1 - p_hit) / reach)"
        " => np.log(p_hit * good) + np.log((1 - p_hit) / reach)"
    ),
    "this is the larger of the two parts: add them": (
        "p_hit * good + (1 - p_hit) / reach => np.maximum(p_hit * good, (1 - p_hit) / reach)"
    ),
    "this is the lesson's likelihood: one wrong reading excludes the right particles": (
        lambda echo, expected, sigma, p_hit, reach: -0.5 * ((echo - expected) / sigma) ** 2
    ),
    "the Gaussian was divided by its part within 0 and `reach`: it is not cut off": _cut_off,
    "what is expected was cut off at `reach`: a particle may expect more": (
        "(echo - expected) => (echo - np.minimum(expected, reach))"
    ),
    "the half in the exponent is missing": "-0.5 * (( => -1.0 * ((",
    "sigma stands outside of the square": (
        "((echo - expected) / sigma) ** 2 => (echo - expected) ** 2 / sigma"
    ),
    "this is the logarithm to the base 10": "np.log( => np.log10(",
}

# %% [markdown] tags=["solution"]
# ## Solution 1: a sonar that is sometimes wrong
#
# The factor stays. In the lesson it is a factor of every weight, and the division by the sum
# removes it. Here it does not stand in front of the whole sum: the two parts are compared by their
# heights. With $\sigma = 0.2$ m and a reach of 5 m the top of the first is $0.8 \cdot 2.0 = 1.6$
# per metre, and the second is $0.2/5 = 0.04$. So one bad reading costs a particle a factor of
# $(1.6 + 0.04)/0.04 = 41$ and no more, and the next good one can give it back.

# %% [markdown] tags=["solution"]
# Without the factor the top of the Gaussian is 0.8, whatever $\sigma$ is, and a bad reading costs
# a factor of 21; nearly as many robots are found, so that in metres the mistake hardly shows. In
# centimetres it costs 2001, for the same robot and the same reading: the exponential has no unit,
# the uniform part has one. In the right form the unit makes no difference:

# %% active="ipynb" tags=["solution"]
# def no_factor(echo, expected, sigma, p_hit, reach):
#     good = np.exp(-0.5 * ((echo - expected) / sigma) ** 2)
#     return np.log(p_hit * good + (1 - p_hit) / reach)
#
# expected = np.array([2.0, 4.0])
# for name, f in (("right", sonar_log_likelihood), ("no factor", no_factor)):
#     for unit, a in (("m", 1), ("cm", 100)):
#         fits, not_at_all = f(2.0 * a, expected * a, 0.2 * a, 0.8, 5 * a)
#         cost = np.exp(fits - not_at_all)
#         print(f"{name:9s} in {unit:2s}: a bad reading costs {cost:.0f}")
# check_sonar(no_factor)

# %% [markdown] tags=["statement"]
# ## Exercise 2: how many particles, with a pencil
#
# Of a hundred robots in the lesson's hall 41 were found with 2000 particles: few began in the
# right place, and resampling only copies. How many does it take to have *one* in the right place?
# And how many for the robot in the corridor, which knows its heading and looks for one number, or
# for a drone, which looks for four?
#
# Coordinate $k$ may be anything within a range of `sizes[k]`; in the hall these are 20 m, 10 m and
# $2\pi$. The particles are drawn independently, evenly over all of it. One is near if it is off by
# at most `reach[k]` in *each* coordinate, to either side: here a box, where the lesson's near was
# a circle of 1.5 m. Take a robot that is farther than that from all walls. What is the least
# number with which the probability that at least one particle is near is `chance` or more?
#
# **On paper first.** One coordinate, and near is a tenth of its size to either side: 21 particles
# have one near with 99 %. How many does it take with two such coordinates, and with six? Guess
# before you calculate, and before you open the picture.


# %% tags=["exercise", "predict"]
def particles_needed(chance: float, sizes: Array, reach: Array) -> int:
    """Least number of particles of which one is near the robot.

    Parameters
    ----------
    chance : float
        Wanted probability that at least one is near, above 0 and below 1.
    sizes : ndarray, shape (d,)
        Range of each coordinate (m or rad).
    reach : ndarray, shape (d,)
        Largest difference of a particle that is near, to either side (m or rad); at
        most half of the size, in at least one coordinate less.

    Returns
    -------
    int
        At least 1.
    """
    share = np.prod(2 * reach / sizes)
    return int(np.ceil(np.log(1 - chance) / np.log(1 - share)))


# %% active="ipynb" tags=["try"]
# particles_needed(0.9, np.array([10.0, 5.0]), np.array([1.0, 0.5]))
# # 57

# %% [markdown] tags=["hint"]
# Begin with one particle and one coordinate: which part of the range is near? All coordinates must
# be right at once, and they are drawn independently.

# %% [markdown] tags=["hint"]
# "At least one" has many cases, and its opposite has one: all $N$ are somewhere else.

# %% [markdown] tags=["hint"]
# The probability of the opposite falls with $N$ by the same factor each time. From which $N$ on is
# it small enough? Which function brings $N$ down from the exponent, and what becomes of $\le$ if
# you divide by a negative number?


# %% tags=["cases"]
def _a_hall(rng: np.random.Generator) -> Any:
    d = int(rng.integers(1, 4))
    sizes = np.round(rng.uniform(4, 20, d), 1)
    reach = np.round(sizes * rng.uniform(0.05, 0.45, d), 2)
    return float(np.round(rng.uniform(0.3, 0.995), 3)), sizes, reach


_HALL = np.array([20.0, 10.0, 2 * np.pi]), np.array([1.5, 1.5, 1.0])  # the lesson's hall, and near


def _needed_drawn(ax: Any, function: Any) -> None:
    """Draw in how many of 400 clouds one particle is near, over their size, and the answers."""
    from slamlab import plots

    found = []
    for (sizes, reach), name in (
        ((np.array([28.0]), np.array([0.5])), "corridor"),
        (_HALL, "hall"),
    ):
        n = int(function(0.99, sizes.copy(), reach.copy()))
        off = np.random.default_rng(2).uniform(-0.5, 0.5, (400, 1200, len(sizes))) * sizes
        first = (np.abs(off) <= reach).all(axis=2).argmax(axis=1) + 1
        numbers = np.arange(0, 601, 5)
        shares = (first <= numbers[:, None]).mean(axis=1)
        ax.plot(numbers, shares, **plots.line_style("truth"))
        ax.plot([n, n], [0, 1], **plots.line_style("estimate"))
        ax.text(min(n, 500) + 10, 0.1, name, fontsize=9)
        found.append(f"{name} {n}: {(first <= n).sum()} of 400")
    ax.set(xlabel="number of particles", ylabel="share of clouds with one near", xlim=(0, 600))
    ax.set_title("\n".join(found))


check_particles_needed = Check(
    particles_needed,
    "particles",
    {
        "the lesson's hall": (0.99, *_HALL),
        "the corridor: one coordinate": (0.99, [28.0], [0.5]),
        "any heading is good enough": (0.9, [15.0, 10.0, 2 * np.pi], [1.0, 1.0, np.pi]),
        "a narrow view": (0.95, [10.0, 10.0, 2 * np.pi], [0.5, 0.5, 0.1]),
        "a drone: place, height and heading": (
            0.9, [20.0, 10.0, 3.0, 2 * np.pi], [1.5, 1.0, 0.5, 0.8],
        ),
        "a closet: one particle does": (0.5, [2.5, 2.5, 2 * np.pi], [1.2, 1.2, 3.0]),
        "a chance that is met exactly is enough": (0.75, [8.0], [2.0]),
        "any number of coordinates": _a_hall,
    },
    draws=12,
    picture=_needed_drawn,
)  # fmt: skip

# %% tags=["mistakes"]
check_particles_needed.mistakes = {
    "a particle is near on both sides: 2 reach of the size": "2 * reach / sizes => reach / sizes",
    "a particle is near on both sides in each coordinate: a factor of 2 for each": (
        "np.prod(2 * reach / sizes) => 2 * np.prod(reach / sizes)"
    ),
    "the shares of the coordinates were added: a particle must be near in all at once": (
        "np.prod( => np.sum("
    ),
    "this is the mean of the coordinates' shares: a particle must be near in all at once": (
        "np.prod( => np.mean("
    ),
    "only the first coordinate was taken: the others must be right as well": (
        "np.prod(2 * reach / sizes) => (2 * reach / sizes)[0]"
    ),
    "only two coordinates were taken: the heading must be right as well": (
        "2 * reach / sizes => (2 * reach / sizes)[:2]"
    ),
    "this is the number with which one is near on average: often none is": (
        lambda chance, sizes, reach: int(np.ceil(1 / np.prod(2 * reach / sizes)))
    ),
    "the chances of the particles were added: several may be near at once": (
        lambda chance, sizes, reach: int(np.ceil(chance / np.prod(2 * reach / sizes)))
    ),
    "none is near with the probability 1 - chance: its logarithm belongs above": (
        "np.log(1 - chance) => np.log(chance)"
    ),
    "a smaller number was returned: round up": "np.ceil( => np.floor(",
    "rounded to the nearest: round up": "np.ceil( => np.rint(",
    "this is the exponential in place of the power: log(1 - s) is not -s": (
        "np.log(1 - share) => -share"
    ),
    "one too many, where the number comes out whole": "int(np.ceil( => int(1 + np.floor(",
}

# %% [markdown] tags=["solution"]
# ## Solution 2: how many particles, with a pencil
#
# In coordinate $k$ the part $2 r_k$ of the size $L_k$ is near, in all of them together the share
# $s = \prod_k 2 r_k / L_k$. All $N$ particles miss with the probability $(1 - s)^N$, so that $N
# \ge \log(1 - \mathrm{chance}) / \log(1 - s)$: both logarithms are negative.

# %% [markdown] tags=["solution"]
# The obvious answer $1/s$, with which one particle is near *on average*, leaves out that some
# clouds have three and others none: about $e^{-1}$, 37 %, have none. And the question on paper:

# %% active="ipynb" tags=["solution"]
# def one_on_average(chance, sizes, reach):
#     return np.ceil(1 / np.prod(2 * reach / sizes))
#
# share = 3 / 20 * 3 / 10 * 2 / (2 * np.pi)
# for n in (70, 320, 2000):
#     none = (1 - share) ** n
#     print(f"{n:4d} in the hall: {n * share:4.1f} near on average, none with {none:.1%}")
# for d in (1, 2, 3, 6):
#     n = particles_needed(0.99, np.full(d, 10.0), np.ones(d))
#     print(f"d = {d}: {n} particles")
# check_particles_needed(one_on_average)

# %% [markdown] tags=["solution"]
# Each coordinate multiplies the number by about five, for near is a fifth of its range. This is
# why particles suit a robot on a floor (three numbers), and why a map of a hundred landmarks needs
# another idea ([chapter 12](../12_fastslam.ipynb)).

# %% [markdown] tags=["solution"]
# With 2000 particles about 29 are near, and still only 41 of 100 robots were found: to have one
# near is necessary, not enough. In each resampling the few near ones must win against all other
# places that explain the measurements as well.

# %% [markdown] tags=["statement"]
# ## Exercise 3: as many particles as the belief needs
#
# In the lesson's hall 8000 particles drive on to the end, though after 40 observations all of them
# are within a metre of the robot: most are a waste, and a small robot cannot afford them. In the
# corridor, too, hundreds are needed while the robot may be anywhere, and few later. So divide the
# corridor into cells, the $i$-th from `i * cell` (included) to `(i + 1) * cell` (not included),
# count those that the belief occupies, $k$, and go on with `n = per_cell * k` particles.
#
# **But when is a cell occupied?** Answer on paper before you open the rule. In the picture 300
# particles are spread over 20 m, 40 cells, and two places explain the reading; no weight is
# exactly zero, for a Gaussian never is. If each cell counts that holds a particle with a weight
# above zero, how many cells is that, and with `per_cell = 8`, do fewer particles go on, or more? A
# smallest weight that counts would have to be chosen, and changed with the number of particles.
# You know a tool that takes particles in proportion to their weights. How does it tell which cells
# count? The picture is folded: open it when you have answered.
#
# <details><summary>The rule</summary>
#
# Lay $M$ points $(j + u)/M$ over the weights as in the lesson, $j = 0 \dots M - 1$. The particles
# that they draw are survivors, and the cells that hold at least one survivor count. Then lay $n$
# points $(j + u)/n$ over the same weights, with the same $u$, and return what those draw.
#
# </details>
#
# A point that falls exactly on the border of two particles draws the second. If rounding leaves
# the sum of the weights below a point, it draws the last particle.


# %% tags=["exercise", "predict"]
def resample(x: Array, weights: Array, cell: float, per_cell: int, u: float) -> Ints:
    """Draw `per_cell` particles for each cell that the belief occupies.

    Parameters
    ----------
    x : ndarray, shape (M,)
        Places of the particles (m).
    weights : ndarray, shape (M,)
        They sum to one, some may be zero.
    cell : float
        Width of a cell (m).
    per_cell : int
        Particles for each cell that the belief occupies.
    u : float
        Random offset in [0, 1), in units of the distance of the points.

    Returns
    -------
    ndarray of int, shape (n,)
        Index of the particle that each of the n points draws, ascending.
    """
    M = len(x)

    def lay(n):
        points = (np.arange(n) + u) / n
        found = np.searchsorted(np.cumsum(weights), points, side="right")
        return np.minimum(found, M - 1)

    survivors = x[lay(M)]
    return lay(per_cell * len(np.unique(np.floor(survivors / cell))))


# %% active="ipynb" tags=["try"]
# resample(np.array([0.2, 0.4, 3.1, 8.0]), np.array([0.5, 0.4, 0.1, 0.0]), 0.5, 3, 0.25)
# # [0 0 1]

# %% [markdown] tags=["hint"]
# By the rule points are laid twice, once $M$ of them and once $n$. Which line of the lesson's
# `resample` has to change so that it takes the number from outside?

# %% [markdown] tags=["hint"]
# Each place has the number of a cell. Which function gives it, also for places below zero? How
# many *different* numbers are there?

# %% [markdown] tags=["hint"]
# The first points only count. The second fall on the old weights again, not on the survivors.


# %% tags=["cases"]
@drawn
def _belief(rng: np.random.Generator, places: int, low: float = 0.0) -> Any:
    """Draw particles round some places, a few of them dead."""
    n = int(rng.integers(6, 25))
    x = rng.uniform(low, low + 12, places)[rng.integers(places, size=n)] + rng.normal(0, 0.4, n)
    cell, per_cell = float(rng.choice([0.25, 0.5, 1.0, 2.0])), int(rng.integers(1, 6))
    u = float(np.round(rng.uniform(0.05, 0.95), 3))
    return np.round(x, 2), some_weights(rng, n, [1, n - 1]), cell, per_cell, u


def _on_border(rng: np.random.Generator) -> Any:
    """Weights in eighths, so that points fall exactly on the borders, and a dead particle."""
    counts = np.append(rng.multinomial(8, np.ones(7) / 7), 0)
    x = np.array([0.0, 0.5, 1.0, 1.5, 4.0, 4.5, 5.0, 9.0])
    return x, counts / 8, 16.0, int(rng.choice([2, 4, 8, 16])), 0.0


def _resample_drawn(ax: Any, function: Any) -> None:
    """Draw how many of the drawn particles are in each cell, and how many are expected."""
    from slamlab import plots

    rng = np.random.default_rng(6)
    x, cell, per_cell = np.sort(rng.uniform(0, 20, 300)), 0.5, 8
    weights = np.exp(-0.5 * ((x - 4) / 0.6) ** 2) + 0.4 * np.exp(-0.5 * ((x - 13) / 0.4) ** 2)
    weights = weights / weights.sum()
    rows = np.array(list(function(x, weights, cell, per_cell, 0.4))).astype(int)
    edges = np.arange(0, 20.1, cell)
    n = len(resample(x, weights, cell, per_cell, 0.4))
    expected = n * np.histogram(x, edges, weights=weights)[0]
    copies = np.histogram(x[np.clip(rows, 0, 299)], edges)[0]
    ax.step(edges[:-1], expected, where="post", **plots.line_style("truth"))
    ax.plot(edges[:-1] + cell / 2, copies, "o", color=plots.COLOURS["estimate"], markersize=4)
    ax.set(xlabel="place (m)", ylabel="particles in a cell")
    ax.set_title(f"{len(rows)} of 300 particles go on")


check_resample = Check(
    resample,
    "indices",
    {
        "equal weights, one to a cell: each survives once": (
            [0.1, 0.6, 1.1, 1.6], [0.25] * 4, 0.5, 1, 0.5,
        ),
        "all in one cell: the number falls": ([2.1, 2.2, 2.3, 2.4], [0.25] * 4, 0.5, 3, 0.5),
        "all in different cells: the number grows": (
            [0.2, 1.2, 2.2, 3.2], [0.4, 0.3, 0.2, 0.1], 0.5, 3, 0.25,
        ),
        "a dead particle occupies no cell": (
            [0.1, 0.2, 7.0, 0.3], [0.5, 0.25, 0.0, 0.25], 1.0, 4, 0.5,
        ),
        "left and right of zero are two cells": (
            [-0.2, 0.2, -0.3, 0.3], [0.25] * 4, 1.0, 2, 0.5,
        ),
        "exactly on the border of two cells": ([0.5, 1.0, 0.75], [0.3, 0.3, 0.4], 0.5, 2, 0.5),
        "the first particle has weight zero, the first point is at zero": (
            [0.0, 1.0, 2.0, 3.0], [0.0, 0.5, 0.25, 0.25], 1.0, 2, 0.0,
        ),
        "a point exactly on a border draws the next particle": _on_border,
        "one particle": ([1.0], [1.0], 0.5, 4, 0.7),
        "a cumulative sum that ends below one, and u just below 1": (
            np.arange(10.0), [0.1] * 10, 1.0, 1, 0.9999999999999999,
        ),
        "one place": _belief(1),
        "three places": _belief(3),
        "a corridor that begins below zero": _belief(3, -8.0),
    },
    picture=_resample_drawn,
)  # fmt: skip


# %% tags=["mistakes"]
def _survivors_again(
    x: Array, weights: Array, cell: float, per_cell: int, u: float, numbers: bool = False
) -> Any:
    M = len(x)
    first = np.minimum(np.searchsorted(np.cumsum(weights), (np.arange(M) + u) / M, "right"), M - 1)
    n = per_cell * len(np.unique(np.floor(x[first] / cell)))
    again = np.minimum(((np.arange(n) + u) / n * M).astype(int), M - 1)
    return again if numbers else first[again]


check_resample.mistakes = {
    "the number stays what it was: draw n = per_cell * k particles": (
        "lay(per_cell * len(np.unique(np.floor(survivors / cell)))) => lay(M)"
    ),
    "these are k particles: each occupied cell is worth per_cell of them": (
        "per_cell * len => len"
    ),
    "the cells of all particles were counted: only those of survivors are occupied": (
        "survivors / cell => x / cell"
    ),
    "the cells of all particles with a weight were counted: only those of survivors": (
        "survivors / cell => x[weights > 0] / cell"
    ),
    "different places were counted: count different cells": (
        "np.floor(survivors / cell) => survivors"
    ),
    "survivors were counted, not the cells that hold them": (
        "np.unique(np.floor(survivors / cell)) => survivors"
    ),
    "cut off towards zero: -0.2 and 0.2 are in different cells, so round down": (
        "np.floor(survivors / cell) => np.trunc(survivors / cell)"
    ),
    "rounded to the nearest: a cell begins at i * cell, so round down": (
        "np.floor(survivors / cell) => np.rint(survivors / cell)"
    ),
    "rounded up: a cell contains its lower border": "np.floor( => np.ceil(",
    "the place was not divided by the width of a cell": "survivors / cell => survivors",
    "the n points were laid over the survivors: lay them over the weights": _survivors_again,
    "these are numbers in the list of survivors: return those of the particles": (
        lambda x, weights, cell, per_cell, u: _survivors_again(
            x, weights, cell, per_cell, u, numbers=True
        )
    ),
    "the points do not move: shift all of them by the random offset": (
        "(np.arange(n) + u) / n => np.arange(n) / n"
    ),
    "the offset must be divided by the number of points: they are 1/n apart": (
        "(np.arange(n) + u) / n => np.arange(n) / n + u"
    ),
    "the points are 1/M apart: n of them are 1/n apart": (
        "(np.arange(n) + u) / n => (np.arange(n) + u) / M"
    ),
    "a point exactly on a border draws the particle before it, which may have weight zero: "
    "search with side='right'": '"right" => "left"',
    "these are places: return the indices of the particles": (
        lambda x, weights, *more: x[resample(x, weights, *more)]
    ),
    "the points were laid over the weights, not over their cumulative sum": (
        "np.cumsum(weights) => weights"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: as many particles as the belief needs
#
# One inner function lays any number of points. `np.floor` rounds down also below
# zero, where `int` would cut towards zero and make one cell of two.

# %% [markdown] tags=["solution"]
# Why survivors? Of the 300 in the picture all have a weight above zero, if only one of $10^{-67}$.
# Their 40 cells would call for 320 particles, more than there were:

# %% active="ipynb" tags=["solution"]
# x = np.sort(np.random.default_rng(6).uniform(0, 20, 300))
# w = np.exp(-0.5 * ((x - 4) / 0.6) ** 2)
# w = w + 0.4 * np.exp(-0.5 * ((x - 13) / 0.4) ** 2)
# w = w / w.sum()
# rows = resample(x, w, 0.5, 8, 0.4)
# print(f"{(w > 0).sum()} of {len(x)} have a weight above zero,",
#       f"in {len(np.unique(np.floor(x[w > 0] / 0.5)))} cells;")
# print(f"{len(rows)} are drawn, in {len(np.unique(np.floor(x[rows] / 0.5)))} cells")

# %% [markdown] tags=["solution"]
# The rule is a plain form of KLD sampling. [Chapter 04b](../04b_particle_filter.ipynb) has the
# number of Fox in its place, which asks for fewer particles per cell, the more cells there are.

# %% [markdown] tags=["statement"]
# ## Exercise 4: a bug to find, always at the door
#
# One piece is missing before the robot can wake up: what becomes of the particles after a reading.
# They are weighed by it, their effective number is compared with half of the particles that there
# are, and if it is less, they are resampled. The program below does this. It calls exercise 3,
# finished, as `finished_resample`; put your own in its place as soon as that passes. It was
# tested: particles that explain a reading badly have small weights, those that explain it well
# have large ones, and what it returns sums to one.
#
# On the robot 200 particles are laid over the corridor, from the door at 0 m to the far end at
# 28 m, in this order. Wherever the robot is switched on, it reports that it began at the door,
# and is certain of it. The picture has forty robots: where each began, and where yours says that
# it began. Above it is the share of the readings after which the particles were resampled; it
# need not be the lesson's 28 of 61. Find the bug and repair it, until *both* numbers are as they
# should be; exercise 6 uses your repair.


# %% tags=["exercise"]
def renew(
    x: Array, weights: Array, log_l: Array, cell: float, per_cell: int, u: float
) -> tuple[Array, Array]:
    """Weigh the particles by a reading; resample if fewer than half of them count.

    Parameters
    ----------
    x : ndarray, shape (M,)
        Places of the particles (m).
    weights : ndarray, shape (M,)
        Their weights before the reading; they sum to one.
    log_l : ndarray, shape (M,)
        Logarithm of the likelihood of the reading, for each particle.
    cell, per_cell, u : float, int, float
        Width of a cell (m), particles for each, and offset: exercise 3.

    Returns
    -------
    x, weights : ndarray, shape (n,)
        Places and weights after the reading. The weights sum to one; after
        resampling they are equal.
    """
    log_w = np.log(weights) + log_l
    weights = np.exp(log_w - log_w.max())
    weights = weights / weights.sum()
    if 1 / np.sum(weights**2) < len(x) / 2:
        x = x[resample(x, weights, cell, per_cell, u)]
        weights = np.full(len(x), 1 / len(x))
    return x.copy(), weights


# %% active="ipynb" tags=["stub"]
#     log_w = np.log(weights) + log_l
#     weights = np.exp(log_w - log_w.max())     # products of many small numbers become 0
#     if 1 / np.sum(weights**2) < len(x) / 2:
#         x = x[finished_resample(x, weights, cell, per_cell, u)]
#         weights = np.ones(len(x))
#     return x.copy(), weights / weights.sum()

# %% active="ipynb" tags=["try"]
# renew(np.array([1.0, 5.0, 9.0]), np.full(3, 1 / 3), np.array([-3.0, 0.0, -0.2]),
#       0.5, 2, 0.5)
# # should be the places 1, 5, 9 with the weights 0.03, 0.54, 0.44

# %% [markdown] tags=["hint"]
# In the call above two of three particles explain the reading about equally well. How many
# particles count, by the lesson's formula, and is that less than half? Which does the program
# keep?

# %% [markdown] tags=["hint"]
# Lay the particles of the picture from the far end to the door, and all robots report that they
# began at the far end. So the order of the list decides, and not the reading. Which line of the
# program knows an order? It lays points over weights. From where to where do the points go?

# %% [markdown] tags=["hint"]
# Two lines use the weights before the program returns them: the effective number and `resample`.
# What do both of them rely on? Print it, in the line before.


# %% tags=["cases"]
@drawn
def _read(rng: np.random.Generator, sharp: float, low: float = 0.0) -> Any:
    n = int(rng.integers(8, 25))
    x = np.round(rng.uniform(low, low + 12, n), 2)
    log_l = np.round(rng.uniform(-2, 3) - sharp * (x - rng.choice(x)) ** 2, 3)
    cell = float(rng.choice([0.25, 0.5, 1.0]))
    u = float(np.round(rng.uniform(0.05, 0.95), 3))
    return x, some_weights(rng, n), log_l, cell, int(rng.integers(2, 5)), u


def _renew_drawn(ax: Any, function: Any) -> None:
    """Draw where each of forty robots began, and where its particles say that it began."""
    from slamlab import plots

    began, said, equal = [], [], []
    for seed in range(40):
        place, (start, *drive), (beacons, sonar, cell, per_cell), u = _robot(seed)
        x = np.linspace(0.0, 28.0, len(start))
        weights = np.full(len(x), 1 / len(x))
        for move, slip, echo, offset in zip(*drive, u, strict=True):
            x = x + move + slip[: len(x)]
            log_l = sonar_log_likelihood(float(echo), _nearest(x, beacons), *sonar.tolist())
            after = function(x, weights, log_l, cell, per_cell, float(offset))
            x, weights = (np.array(one, float) for one in after)
            equal.append(np.ptp(weights) < 1e-12)
        began.append(place[-1] - drive[0].sum())
        said.append(best_place(x, weights, 0.5)[0] - drive[0].sum())
    found = np.sum(np.abs(np.array(began) - said) < 0.5)
    ax.plot([0, 16], [0, 16], **plots.line_style("truth"))
    ax.plot(began, said, "o", color=plots.COLOURS["estimate"], markersize=5)
    ax.set(xlabel="began at (m)", ylabel="says it began at (m)", xlim=(-1, 17), ylim=(-2, 28))
    often = np.mean(equal)
    ax.set_title(f"{found} of 40 robots found\n{often:.0%} of readings: resampled")


check_renew = Check(
    renew,
    "x, weights",
    {
        "the call below the stub": (
            [1.0, 5.0, 9.0], [1 / 3] * 3, [-3.0, 0.0, -0.2], 0.5, 2, 0.5,
        ),
        "one particle": ([3.0], [1.0], [-2.0], 0.5, 3, 0.5),
        "a reading that says nothing: all stay": (
            [2.0, 4.0, 6.0, 8.0], [0.3, 0.2, 0.1, 0.4], [-1.0] * 4, 0.5, 2, 0.3,
        ),
        "only the last of the list explains it": (
            [1.0, 2.0, 3.0, 4.0], [0.25] * 4, [-9.0, -9.0, -9.0, 0.0], 0.5, 3, 0.4,
        ),
        "only the first of the list explains it": (
            [1.0, 2.0, 3.0, 4.0], [0.25] * 4, [0.0, -9.0, -9.0, -9.0], 0.5, 3, 0.4,
        ),
        "a reading that is most unlikely for all": (
            [1.0, 2.0, 3.0, 4.0], [0.4, 0.3, 0.2, 0.1], [-900.0, -902.0, -901.0, -899.0], 1.0, 2,
            0.6,
        ),
        "exactly half of the particles count: all stay": (
            [1.0, 2.0, 3.0, 4.0], [0.25] * 4, [0.0, 0.0, -900.0, -900.0], 0.5, 3, 0.4,
        ),
        "one particle had nearly all the weight before": (
            [1.0, 2.0, 3.0, 7.0],
            [0.02, 0.9, 0.05, 0.03],
            [-0.5, -0.4, -0.2, -0.3],
            0.5,
            2,
            0.5,
        ),
        "a particle of weight zero": (
            [1.0, 2.0, 3.0], [0.5, 0.0, 0.5], [-1.0, 0, -1.2], 1.0, 2, 0.5,
        ),
        "readings that say little": _read(0.005),
        "readings that say much": _read(0.5),
        "the corridor begins below zero": _read(0.05, -9.0),
    },
    picture=_renew_drawn,
    hunt=True,
)  # fmt: skip

# %% tags=["mistakes"]
_SUM = "    weights = weights / weights.sum()\n"
_EQUAL = "weights = np.full(len(x), 1 / len(x))"

check_renew.mistakes = {
    "the weights were divided by their sum only at the end: the effective number and the points "
    "rely on it": (
        f"{_SUM} => ",
        "x.copy(), weights => x.copy(), weights / weights.sum()",
    ),
    "the effective number was taken of weights that do not sum to one": (
        f"{_SUM} => ",
        "resample(x, weights, => resample(x, weights / weights.sum(),",
        "x.copy(), weights => x.copy(), weights / weights.sum()",
    ),
    "the points were laid over weights that do not sum to one": (
        f"{_SUM} => ",
        "1 / np.sum(weights**2) => weights.sum() ** 2 / np.sum(weights**2)",
        "x.copy(), weights => x.copy(), weights / weights.sum()",
    ),
    "the weights that are returned do not sum to one": (
        f"{_SUM} => ",
        "1 / np.sum(weights**2) => weights.sum() ** 2 / np.sum(weights**2)",
        "resample(x, weights, => resample(x, weights / weights.sum(),",
    ),
    "the old weights are forgotten at each reading": "np.log(weights) + log_l => log_l",
    "resampled at every reading: only when fewer than half of the particles count": (
        "1 / np.sum(weights**2) < len(x) / 2 => True"
    ),
    "never resampled: do so when fewer than half of the particles count": (
        "1 / np.sum(weights**2) < len(x) / 2 => False"
    ),
    "resampled when the weights are good: the comparison is the wrong way round": (
        "< len(x) / 2 => > len(x) / 2"
    ),
    "resampled when exactly half of the particles count: only when fewer do": (
        "< len(x) / 2 => <= len(x) / 2"
    ),
    "the copies took the old weights along: those count twice now": (
        f"x = x[resample(x, weights, cell, per_cell, u)]\n        {_EQUAL} => "
        "rows = resample(x, weights, cell, per_cell, u)\n        "
        "x = x[rows]; weights = weights[rows] / weights[rows].sum()"
    ),
    "the likelihood is given as a logarithm: it is added to that of the weight": (
        "np.log(weights) + log_l => weights * log_l"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: weights are shares only after they are divided by their sum
#
# Less the largest logarithm, the largest weight is 1, and the sum is anything from 1 to $M$. What
# is returned was divided by it, so every test of the result passes. But two lines use the weights
# before. $1/\sum w^2$ is at most 1 then: the program resamples at every reading. And the points go
# from 0 to 1, and cover the first particles of the list only. Of a hundred robots none
# has a particle that began beyond 6 m after the first reading, nor after five readings one that
# began half a metre or more from the door. The division belongs above the first use.

# %% [markdown] tags=["solution"]
# The points are the worse of the two. With the effective number alone taken wrongly, all robots of
# the picture are found, but the particles are resampled after every reading, not after three of
# ten:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: where forty robots began and where they say that they began; in both all dots are on the diagonal, on the left the particles are resampled after every reading."}}
# def too_often(x, weights, log_l, cell, per_cell, u):
#     log_w = np.log(weights) + log_l
#     weights = np.exp(log_w - log_w.max())
#     if 1 / np.sum(weights**2) < len(x) / 2:       # at most 1: always
#         x = x[resample(x, weights / weights.sum(), cell, per_cell, u)]
#         weights = np.ones(len(x))
#     return x.copy(), weights / weights.sum()
#
# check_renew.draw(too_often)

# %% [markdown] tags=["solution"]
# That is how this bug stays in a program: with a `resample` that divides by the sum itself no
# robot is lost here. The price is different particles: a copy takes the place of another one,
# where no reading asked for it.

# %% [markdown] tags=["statement"]
# ## Exercise 5: one place, not the mean
#
# The robot in the corridor asks its particles where it is. Half of them are at 4 m, half at 21 m,
# and their mean, 12.5 m, is where no particle is. The heaviest particle is no answer either: right
# after resampling all weigh the same.
#
# Ask for a neighbourhood instead. The neighbours of a particle are all particles at most `radius`
# from it, itself included. Find the particle whose neighbours weigh most together (the first, if
# several do). Return the weighted mean of the places of its neighbours, and what they weigh.


# %% tags=["exercise"]
def best_place(x: Array, weights: Array, radius: float) -> tuple[float, float]:
    """Where most of the belief is.

    Parameters
    ----------
    x : ndarray, shape (M,)
        Places of the particles (m), in any order.
    weights : ndarray, shape (M,)
        They sum to one, some may be zero.
    radius : float
        Largest distance of a neighbour (m).

    Returns
    -------
    place : float
        Weighted mean of the neighbours (m).
    share : float
        Sum of the weights of the neighbours.
    """
    near = np.abs(x[:, None] - x) <= radius
    carried = near @ weights
    best = np.argmax(carried)
    share = carried[best]
    return (near[best] * weights) @ x / share, share


# %% active="ipynb" tags=["try"]
# best_place(np.array([4.0, 4.2, 4.4, 21.0]), np.array([0.2, 0.2, 0.2, 0.4]), 0.5)
# # (4.2, 0.6)

# %% [markdown] tags=["hint"]
# Begin with one particle. Which others are its neighbours, and what do they weigh together? A loop
# over all particles is a right answer, too.

# %% [markdown] tags=["hint"]
# Without a loop: `x[:, None] - x` holds the differences of all pairs. What is the sum of the
# weights over each row's neighbours, as a product of a matrix and a vector?

# %% [markdown] tags=["hint"]
# The neighbours' weights sum to `share`, not to one. What must a weighted mean be divided by?


# %% tags=["cases"]
@drawn
def _places(rng: np.random.Generator, places: int) -> Any:
    n = int(rng.integers(4, 15))
    x = rng.uniform(-9, 9, places)[rng.integers(places, size=n)] + rng.normal(0, 0.6, n)
    radius = float(np.round(rng.uniform(0.2, 1.5), 2) + 0.005)  # no pair is exactly that far
    return np.round(x, 2), some_weights(rng, n, [int(rng.integers(n))]), radius


def _best_place_drawn(ax: Any, function: Any) -> None:
    """Draw the weights of particles at two places; below, their mean and a band, the answer."""
    from slamlab import plots

    rng = np.random.default_rng(1)
    x = np.r_[rng.normal(4, 0.4, 60), rng.normal(21, 0.4, 60)]
    weights = np.exp(rng.normal(0, 0.5, 120)) * np.r_[np.full(60, 0.8), np.ones(60)]
    weights[7] = 12.0  # one heavy particle
    weights = weights / weights.sum()
    place, share = function(x, weights, 1.0)
    place, share = float(place), float(share)
    ax.vlines(x, 0, weights, color=plots.COLOURS["particle"], lw=0.8, alpha=0.6)
    ax.axhline(0, color="0.6", lw=0.8)
    blue = plots.COLOURS["estimate"]
    ax.plot([place - 1, place + 1], [-0.012] * 2, color=blue, lw=6, solid_capstyle="butt")
    ax.plot(place, -0.012, "^", color=blue, markersize=9, mec="white")
    ax.plot(weights @ x, -0.012, "x", color=plots.COLOURS["wrong"], markersize=9, mew=2)
    ax.set(xlabel="place (m); cross: the mean", ylabel="weight", xlim=(0, 25), ylim=(-0.02, 0.1))
    ax.set_yticks([0, 0.05, 0.1])
    ax.set_title(f"{place:.1f} m, {share:.0%} of the weight")


check_best_place = Check(
    best_place,
    "place, share",
    {
        "one particle": ([3.0], [1.0], 0.5),
        "a heavy one alone, three lighter ones together": (
            [4.0, 4.2, 4.4, 21.0],
            [0.2, 0.2, 0.2, 0.4],
            0.5,
        ),
        "equal weights: where they are dense": (
            [-3.0, 1.0, 1.2, 1.3, 7.0, 7.1],
            [1 / 6] * 6,
            0.25,
        ),
        "many particles that weigh little": (
            [0.0, 0.1, 0.2, 0.3, 5.0, 5.1],
            [0.05, 0.05, 0.05, 0.05, 0.4, 0.4],
            0.5,
        ),
        "a distance of exactly the radius is near": ([0.0, 1.0, 2.5], [0.25, 0.5, 0.25], 1.0),
        "two places weigh the same: the first": (
            [5.0, 6.0, -1.0, -2.0],
            [0.25] * 4,
            1.0,
        ),
        "two places": _places(2),
        "four places": _places(4),
    },
    draws=10,
    picture=_best_place_drawn,
)


# %% tags=["mistakes"]
def _binned(x: Array, weights: Array, radius: float) -> Any:
    cells = np.floor(x / (2 * radius))
    inside = cells == max(np.unique(cells), key=lambda c: weights[cells == c].sum())
    return weights[inside] @ x[inside] / weights[inside].sum(), weights[inside].sum()


check_best_place.mistakes = {
    "this is the heaviest particle: right after resampling all weigh the same": (
        lambda x, weights, radius: (x[np.argmax(weights)], np.max(weights))
    ),
    "this begins at the heaviest particle: its neighbours may weigh little": (
        "np.argmax(carried) => np.argmax(weights)"
    ),
    "neighbours were counted: sum what they weigh": (
        "np.argmax(carried) => np.argmax(near.sum(axis=1))"
    ),
    "divide by the weight of the neighbours: theirs do not sum to one": (
        "(near[best] * weights) @ x / share => (near[best] * weights) @ x"
    ),
    "this is the particle itself: return the mean of its neighbours": (
        "(near[best] * weights) @ x / share, share => x[best], share"
    ),
    "the mean of the neighbours was taken without their weights": (
        "(near[best] * weights) @ x / share => x[near[best]].mean()"
    ),
    "the place is the mean of all particles: only the neighbours count": (
        "(near[best] * weights) @ x / share => weights @ x"
    ),
    "the neighbours on one side were left out: take the absolute value of the difference": (
        "np.abs(x[:, None] - x) <= radius => (x[:, None] - x <= radius) & (x <= x[:, None])"
    ),
    "this is the mean of all particles: neighbours count only, and a difference may be negative": (
        "np.abs(x[:, None] - x) => x[:, None] - x"
    ),
    "exactly the radius away is near: use <=": "<= radius => < radius",
    "`radius` is the largest distance to either side, not the whole width": (
        "<= radius => <= radius / 2"
    ),
    "the weight of the best particle was returned as the share: its neighbours belong to it": (
        "/ share, share => / share, weights[best]"
    ),
    "of several that weigh the same the last was taken: take the first": (
        "np.argmax(carried) => len(x) - 1 - np.argmax(carried[::-1])"
    ),
    "the line was cut into cells: a place on a border falls apart": _binned,
}

# %% [markdown] tags=["solution"]
# ## Solution 5: one place, not the mean
#
# The matrix of pairs costs $M^2$ comparisons: nothing for a few hundred particles, too much for
# 100 000, where one counts cells instead. The share says how much of the
# belief is there: below one half there is more elsewhere. It is right only if the belief is, as a
# robot of exercise 6 shows.

# %% [markdown] tags=["solution"]
# The heaviest particle is a common answer (the "best particle" of some programs). One
# particle alone decides, and right after resampling it is the first of the list:

# %% active="ipynb" tags=["solution"]
# def heaviest(x, weights, radius):
#     best = np.argmax(weights)
#     return x[best], weights[best]
#
# x = np.r_[np.linspace(3.5, 4.5, 80), np.linspace(20, 22, 20)]
# x = np.random.default_rng(0).permutation(x)
# w = np.full(100, 0.01)
# answers = [heaviest(np.roll(x, k), w, 1.0)[0] for k in range(100)]
# right = sum(abs(one - 4) < 1 for one in answers)
# print(f"80 of 100 particles at 4 m, in 100 orders: heaviest {right} times at 4 m,")
# print(f"neighbourhood at {best_place(x, w, 1.0)[0]:.1f} m")
# check_best_place(heaviest)

# %% [markdown] tags=["statement"]
# ## Exercise 6: wake up in the corridor
#
# Assemble it: all five functions that you have. A robot is switched on somewhere in the corridor,
# knows which way it faces and where the beacons are, and has the sonar of exercise 1.
#
# 1. Of the places `x`, which were drawn evenly over the corridor, take the first $n$, with equal
#    weights. `particles_needed` says how many, so that one of them is within `near` of the robot
#    with the probability `chance`.
# 2. In each step every particle makes the commanded move plus a slip of its own. The slips are
#    given, so that the check can compare: `noise[k]` has more numbers than there are particles;
#    the i-th particle takes the i-th of them.
# 3. It expects the distance to the beacon that is nearest to it, and your sonar gives the
#    logarithm of the likelihood.
# 4. `renew`, which you repaired, weighs, and resamples with your `resample`, with the offset
#    `u[k]`. A cell is as wide as `near`.
# 5. After the last step `best_place`, with `near` as the radius, says where the robot is.
#
# The ends of the corridor are no walls to a particle: it may slip past them, and is not put back.
# Nor is the expected distance cut off at the sonar's reach. The number of particles changes on the
# way: which slips are then left over? (`renew` counts its particles itself.)
#
# Then draw the picture. It shows one robot that wakes up: the black line is where it was, blue
# dots are your particles after every second step (those above a fifth of the mean weight), orange
# circles your `best_place`, dotted lines beacons, and the columns below count the particles: the
# title has their number at the start and the largest. It rises before it falls. Why?
#
# The rest of the title is about fifty robots, which drive 12 m from starts of their own. A robot
# is *found* if your place is within half a metre of it at the end. The last line has two medians
# of the fifty: the number of particles that are left, and the NEES. The NEES is the squared error
# of the particles' mean over their variance. For a consistent filter of one dimension its median
# is 0.45, for fifty robots between 0.23 and 0.82 in 19 of 20 cases.


# %% tags=["exercise"]
def localize(
    x: Array,
    size: float,
    chance: float,
    near: float,
    moves: Array,
    noise: Array,
    echoes: Array,
    beacons: Array,
    sonar: Array,
    per_cell: int,
    u: Array,
) -> tuple[float, float, Array, Array]:
    """Where the robot is after a drive along the corridor.

    Parameters
    ----------
    x : ndarray, shape (S,)
        Places drawn evenly over the corridor (m), more than are needed.
    size : float
        Length of the corridor (m).
    chance : float
        Wanted probability that a particle is near the robot at the start.
    near : float
        What counts as near (m): `reach` in exercise 2, `cell` in 3, `radius` in 5.
    moves : ndarray, shape (T,)
        Commanded move of each step (m); T is at least 1.
    noise : ndarray, shape (T, N)
        Slips of the particles in each step (m); N is larger than their number ever is.
    echoes : ndarray, shape (T,)
        Reading of the sonar after each move (m).
    beacons : ndarray, shape (B,)
        Where the beacons are (m).
    sonar : ndarray, shape (3,)
        `sigma` (m), `p_hit` and `reach` (m) of exercise 1.
    per_cell : int
        Particles for each cell: exercise 3.
    u : ndarray, shape (T,)
        Offset of the points in each step, should resampling be needed.

    Returns
    -------
    place, share : float
        What `best_place` gives after the last step (m), and its share of the weight.
    x, weights : ndarray, shape (n,)
        Places (m) and weights of the particles after the last step.
    """
    n = particles_needed(chance, np.array([size]), np.array([near]))
    x, weights = x[:n], np.full(n, 1 / n)
    for move, slip, echo, offset in zip(moves, noise, echoes, u, strict=True):
        x = x + move + slip[: len(x)]
        expected = np.abs(x[:, None] - beacons).min(axis=1)
        log_l = sonar_log_likelihood(echo, expected, *sonar)
        x, weights = renew(x, weights, log_l, near, per_cell, offset)
    place, share = best_place(x, weights, near)
    return place, share, x, weights


# %% active="ipynb" tags=["try"]
# localize(np.array([1.0, 2.0, 4.0, 3.0]), 4.0, 0.8, 1.0,
#          np.array([0.5]), np.zeros((1, 20)), np.array([0.4]), np.array([1.0, 5.2]),
#          np.array([0.2, 0.8, 5.0]), 2, np.array([0.5]))
# # place 1.53, share 0.73; particles at 1.5, 2.5, 4.5, weights 0.71, 0.02, 0.27

# %% [markdown] tags=["hint"]
# The loop of the lesson is the ladder: move, weigh, resample. One call stands before it and one
# after it. `particles_needed` takes arrays: how many coordinates does this robot look for?

# %% [markdown] tags=["hint"]
# `np.abs(x[:, None] - beacons)` holds the distance of every particle to every beacon. Over which
# axis is the nearest one? And how many slips of `noise[k]` do you need?

# %% [markdown] tags=["hint"]
# `renew` returns places and weights, and there may be more or fewer than before. The next step
# begins with both.


# %% tags=["cases"]
@drawn
def _walk(
    rng: np.random.Generator, steps: int, radius: float, sigma: float = 0.3, *, back: bool = False
) -> Any:
    beacons, length = np.round(rng.uniform(0, 12, 3), 1), float(rng.integers(8, 13))
    start, place = np.round(rng.uniform(0, length, 80), 2), float(rng.uniform(0, length))
    moves = np.round(rng.uniform(0.2, 0.8, steps), 2)
    sonar = np.round([sigma, rng.uniform(0.5, 0.95), rng.uniform(3, 6)], 2)
    echoes = _nearest(place + np.cumsum(moves), beacons) + rng.normal(0, sigma, steps)
    bad = rng.random(steps) > sonar[1]
    echoes = np.clip(np.where(bad, rng.uniform(0, sonar[2], steps), echoes), 0, sonar[2])
    noise = np.round(rng.normal(0, 0.1, (steps, 400)), 3)
    chance, per_cell = float(rng.choice([0.6, 0.7, 0.8])), int(rng.integers(2, 6))
    side = -1 if back else 1  # the same corridor, seen from its other end
    u = np.round(rng.random(steps), 3)
    return (
        side * start, length, chance, radius, side * moves, noise, np.round(echoes, 2),
        side * beacons, sonar, per_cell, u,
    )  # fmt: skip


def _robot(seed: int, particles: int = 200, steps: int = 30) -> Any:
    """Return where a robot of the corridor was, and what its filter is given."""
    rng, (sigma, p_hit, reach) = np.random.default_rng([4, seed]), _SONAR
    moves = np.full(steps, 0.4)
    place = rng.uniform(0, 16) + np.cumsum(moves + rng.normal(0, 0.05, steps))
    echoes = np.maximum(_nearest(place, _CORRIDOR) + rng.normal(0, sigma, steps), 0)
    echoes = np.where(rng.random(steps) < p_hit, echoes, rng.uniform(0, reach, steps))
    start = rng.uniform(0, 28, particles)
    noise = rng.normal(0, 0.05, (steps, 1500))
    return place, (start, moves, noise, echoes), (_CORRIDOR, _SONAR, 0.5, 20), rng.random(steps)


def _localize_drawn(ax: Any, function: Any) -> None:
    """Draw particles along the corridor, the robot, its best place; below, how many there are."""
    from slamlab import plots

    def after(seed: int, steps: int = 30) -> Any:
        truth, (start, *drive), (beacons, sonar, radius, per_cell), u = _robot(seed, 400)
        drive, given = [one[: max(steps, 1)] for one in drive], (28.0, 0.99, radius)
        if steps == 0:  # the start: one step that moves nothing and a sonar that says nothing
            drive, sonar = [0 * one for one in drive], sonar * [1, 0, 1]
        came = function(start, *given, *drive, beacons, sonar, per_cell, u[: max(steps, 1)])
        return truth, float(came[0]), *(np.asarray(one, float) for one in came[2:])

    shown = [(k, *after(_SHOWN, k)) for k in range(0, 31, 2)]
    found, nees, ends = 0, [], []
    for seed in range(50):
        truth, place, x, weights = after(seed)
        found += abs(place - truth[-1]) < 0.5
        mean = weights @ x
        nees.append((mean - truth[-1]) ** 2 / (weights @ (x - mean) ** 2 + 1e-9))
        ends.append(len(x))
    for beacon in _CORRIDOR:
        ax.axhline(beacon, color="0.6", lw=1, ls=":")
    for k, _, place, x, weights in shown:
        kept = x[weights > 0.2 / len(x)]
        plots.particles(ax, np.column_stack([np.full(len(kept), k), kept]))
        ax.plot(k, place, "o", mfc="none", color="#E69F00", markersize=8, mew=2, zorder=6)
        ax.bar(k, len(x) / 50, 1.2, bottom=-15, color="0.55")
    ax.plot(np.arange(1, 31), shown[0][1], **plots.line_style("truth"), zorder=5)
    ax.text(30, -8, "number of particles", ha="right", fontsize=9)
    ax.set(xlabel="step", ylabel="place (m)", ylim=(-15, 28))
    ax.set_yticks([-15, -5, 0, 10, 20], ["0", "500", "0", "10", "20"])
    score, most = np.median(nees), max(len(x) for *_, x, _ in shown)
    told = f"{score:.1f}" if score < 100 else "over 100"
    ax.set_title(
        f"{len(shown[0][3])}, at most {most} particles\n"
        f"{found} of 50 robots found,\n"
        f"median: {np.median(ends):.0f} left, NEES {told}"
    )


_SHOWN = 4
check_localize = Check(
    localize,
    "place, share, x, weights",
    {
        "one step": _walk(1, 0.5),
        "readings so inexact that there is no resampling": _walk(4, 1.0, 20.0),
        "a drive": _walk(8, 0.5),
        "a longer drive, and more particles": _walk(15, 0.25, 0.2),
        "a drive backwards, left of the origin": _walk(8, 1.0, back=True),
    },
    tolerance=1e-8,
    picture=_localize_drawn,
)

# %% tags=["mistakes"]
_MOVED = "x + move + slip[: len(x)]"
_CALL = "x, weights = renew(x, weights, log_l, near, per_cell, offset)"


def _written_out(
    half: str = "len(x) / 2", weigh: str = "weights * np.exp(log_l)", after: str = "1 / len(x)"
) -> str:
    """Write the call of `renew` out as a student would who does not use it, with one change."""
    return (
        f"{_CALL} => weights = {weigh}\n"
        "        weights = weights / weights.sum()\n"
        f"        if 1 / np.sum(weights**2) < {half}:\n"
        "            rows = resample(x, weights, near, per_cell, offset)\n"
        f"            x = x[rows]; weights = np.full(len(x), {after})\n"
        "            weights = weights / weights.sum()"
    )


check_localize.mistakes = {
    "the copies took the old weights along: those count twice now": (
        _written_out(after="weights[rows]")
    ),
    "resampled at every step: only when fewer than half of the particles count": (
        _written_out(half="np.inf")
    ),
    "never resampled: do so when fewer than half of the particles count": _written_out(half="0"),
    "the threshold is half of the first number of particles: take half of the present one": (
        _written_out(half="n / 2")
    ),
    "all places were taken: `particles_needed` says how many": (
        "particles_needed(chance, np.array([size]), np.array([near])) => len(x)"
    ),
    "`near` is to either side, as `reach` in exercise 2: it was halved for the first number": (
        "np.array([near])) => np.array([near / 2]))"
    ),
    "the last places were taken: take the first": "x[:n] => x[-n:]",
    "one slip for all: every particle slips on its own": "slip[: len(x)] => slip[0]",
    "the slip was forgotten: copies stay copies": f"{_MOVED} => x + move",
    "the last slips were taken: the i-th particle takes the i-th": (
        "slip[: len(x)] => slip[-len(x) :]"
    ),
    "places were cut off at the ends of the corridor: they are no walls to a particle": (
        f"{_MOVED} => np.clip({_MOVED}, 0, size)"
    ),
    "the expected distance was cut off at the sonar's reach: leave it as it is": (
        ".min(axis=1) => .min(axis=1).clip(max=sonar[2])"
    ),
    "the old weights are forgotten at each reading": "(x, weights, log_l => (x, 0 * x + 1, log_l",
    "the first beacon is not the nearest: take the smallest distance": ".min(axis=1) => [:, 0]",
    "this is the distance to the farthest beacon": ".min(axis=1) => .max(axis=1)",
    "the minimum was taken over the particles: each has a nearest beacon of its own": (
        ".min(axis=1) => .min(axis=0).mean()"
    ),
    "it measured before it moved: the reading is taken after the move": (
        "np.abs(x[:, None] - beacons) => np.abs((x - move - slip[: len(x)])[:, None] - beacons)"
    ),
    "`renew` takes the logarithm of the likelihood: this is the likelihood": (
        "log_l = sonar_log_likelihood(echo, expected, *sonar)"
        " => log_l = np.exp(sonar_log_likelihood(echo, expected, *sonar))"
    ),
    "the weights are not those that `renew` returned: the next step begins with them": (
        "x, weights = renew => x, last = renew",
        "best_place(x, weights => best_place(x, last",
        "share, x, weights => share, x, last",
    ),
    "the place is the mean of all particles: `best_place` finds the heaviest neighbourhood": (
        "return place => return weights @ x"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 6: wake up in the corridor
#
# The lesson's loop with your likelihood and your resampling, one call before it and one after it.
# The number of particles is in the loop twice: in the slips, and in `renew`, whose threshold is
# half of the particles that there are *now*.

# %% [markdown] tags=["solution"]
# Why does their number rise? At the start 127 particles are spread over 56 cells, about two for
# each. On the robot of the picture the first two readings leave survivors in 30 cells, and 20 for
# each of them are 600. Later readings leave fewer cells, at the end two.

# %% [markdown] tags=["solution"]
# Does the pencil of exercise 2 give the right number at the start? The same hundred robots each
# time, the picture's fifty among them. The pencil counts those that begin with a particle near:

# %% active="ipynb" tags=["solution"]
# beacons = np.array([2.0, 6.0, 11.0, 14.0, 21.0, 26.0])
#
# def robot(seed, steps=30):
#     rng, moves = np.random.default_rng([4, seed]), np.full(steps, 0.4)
#     place = rng.uniform(0, 16) + np.cumsum(moves + rng.normal(0, 0.05, steps))
#     echoes = np.abs(place[:, None] - beacons).min(axis=1) + rng.normal(0, 0.2, steps)
#     echoes = np.maximum(echoes, 0)
#     echoes = np.where(rng.random(steps) < 0.8, echoes, rng.uniform(0, 5, steps))
#     start, noise = rng.uniform(0, 28, 400), rng.normal(0, 0.05, (steps, 1500))
#     return place, start, (moves, noise, echoes), rng.random(steps)

# %% active="ipynb" tags=["solution"]
# def wake(seed, steps=30, chance=0.99, p_hit=0.8, per_cell=20, localize=localize):
#     place, x, drive, u = robot(seed)
#     drive, sonar = [one[:steps] for one in drive], np.array([0.2, p_hit, 5.0])
#     given = beacons, sonar, per_cell, u[:steps]
#     return place[steps - 1], localize(x, 28.0, chance, 0.5, *drive, *given)
#
# def tried(**changed):
#     found, nees, sizes = 0, [], []
#     for seed in range(100):
#         truth, (place, _, x, w) = wake(seed, **changed)
#         mean = w @ x
#         found += abs(place - truth) < 0.5
#         nees.append((mean - truth) ** 2 / (w @ (x - mean) ** 2 + 1e-9))
#         sizes.append(len(x))
#     left, score = np.mean(sizes), np.median(nees)
#     return f"{found} of 100 found, {left:.0f} left, median NEES {score:.1f}"

# %% active="ipynb" tags=["solution"]
# for chance in (0.5, 0.9, 0.99, 0.999):
#     n, near = particles_needed(chance, np.array([28.0]), np.array([0.5])), 0
#     for seed in range(100):
#         place, x, (moves, *_), _ = robot(seed)
#         near += np.any(np.abs(x[:n] - (place[0] - moves[0])) <= 0.5)
#     print(f"{n:3d} particles, near one: {near:3d}; {tried(chance=chance)}")

# %% [markdown] tags=["solution"]
# It does: most robots with a particle near are found, and from 127 on more particles change
# little. The NEES shows a start with too few as well.

# %% [markdown] tags=["solution"]
# Who is not found? Count the particles within a metre of two robots, after each of the first
# twelve readings, and see what the two say at the end:

# %% active="ipynb" tags=["solution"]
# for seed in (4, 40):
#     near = []
#     for steps in range(1, 13):
#         truth, (_, _, x, _) = wake(seed, steps)
#         near.append(int(np.sum(np.abs(x - truth) < 1)))
#     truth, (place, share, *_) = wake(seed)
#     print(f"robot {seed:2d}: {near}")
#     print(f"  is at {truth:.1f} m, says {place:.1f} m with {share:.0%} of the weight")

# %% [markdown] tags=["solution"]
# Robot 4 is found. Robot 40 has 99 particles near it after the first reading and none after the
# fifth, and no other reading can bring them back: resampling only copies. It ends 9 m off, past
# the end of the corridor, and 70 % of the weight in one place is no warning.

# %% [markdown] tags=["solution"]
# And the answer: the mean and the heaviest neighbourhood of the *same* particles, while the robot
# is still being found:

# %% active="ipynb" tags=["solution"]
# for steps in (4, 8, 12, 30):
#     right = np.zeros(2, int)
#     for seed in range(100):
#         truth, (place, _, x, w) = wake(seed, steps)
#         right += np.abs(np.array([w @ x, place]) - truth) < 0.5
#     print(f"after {steps:2d} readings: mean right for {right[0]} of 100,",
#           f"best place for {right[1]}")

# %% [markdown] tags=["solution"]
# After four readings the best place is right for more than twice as many robots as the mean; at
# the end one place is left, and both agree.

# %% [markdown] tags=["solution"]
# What does each piece give? One thing is changed at a time: nearly the lesson's likelihood, a
# share of good readings that is far from the true 0.8, few particles for each cell, and one wrong
# line, one slip for all.

# %% active="ipynb" tags=["solution"]
# def one_slip(x, size, chance, near, moves, noise, *rest):
#     same = np.repeat(noise[:, :1], noise.shape[1], axis=1)
#     return localize(x, size, chance, near, moves, same, *rest)
#
# for name, changed in (
#     ("as it is", {}), ("the lesson's likelihood", {"p_hit": 1 - 1e-12}),
#     ("p_hit 0.5", {"p_hit": 0.5}), ("2 for each cell", {"per_cell": 2}),
#     ("one slip for all", {"localize": one_slip}),
# ):
#     print(f"{name:24s}{tried(**changed)}")
# check_localize(one_slip)

# %% [markdown] tags=["solution"]
# The second part of the likelihood makes the difference, and its share need not be known well.
# With 2 for each cell three particles are left, much closer together than the error of their mean.
# With one slip for all, four of five robots are found all the same, and the NEES reveals it:
# copies stay copies. (Of a hundred robots the median is within 0.28 and 0.70 in 19 of 20 cases, if
# the filter is consistent.)

# %% [markdown] tags=["statement"]
# *What you have now*: a particle filter that wakes up lost, with a sensor that is wrong in one
# reading of five, knows how many particles to begin with, finds itself, and goes on with a third
# of them. AMCL, the localization of ROS, is in essence this filter in the plane, with a lidar;
# [chapter 04b](../04b_particle_filter.ipynb) adds what helps a robot that is carried elsewhere.

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 04](../solutions/04_particle_filter.ipynb).
