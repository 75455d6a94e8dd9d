"""Exercises, chapter 15: one map of several, a beam from behind, a tree, a place by roughness."""

from __future__ import annotations

import math
from functools import lru_cache, wraps
from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn
from slamlab.exercises._report import Array, Check, Ints, Mask
from slamlab.geometry import compose, transform

__all__ = [
    "check_draw_scan",
    "check_from_behind",
    "check_localize",
    "check_merged",
    "check_survivors",
    "check_weights",
]


# %% [markdown] tags=["chapter"]
# # Exercises 15: Gamma-SLAM and DP-SLAM
#
# Six functions, two stories. **Gamma-SLAM**: four robots bring home four maps of one field, and a
# picture weighs particles (exercises 1 and 2, of the lesson
# [Gamma-SLAM and DP-SLAM](../15_other_maps.ipynb)). **DP-SLAM**: a beam comes from behind a hedge,
# a map shows a wall that its robot never saw, and a tree is tidied (3 to 5, of the page on
# [DP-SLAM](../15c_other_maps.ipynb)). At the end a robot that does not know its place finds it by
# how rough the ground is, with your functions of 1 and 2. Replace each `...` and run the check
# below it as often as you like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 15: Gamma-SLAM and DP-SLAM
#
# The exercises are in [Exercises 15](../exercises/15_other_maps.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import compose, transform

# %% active="ipynb" tags=["imports", "solution"]
# import math
#
# import numpy as np
#
# from slamlab.geometry import compose, transform

# %% [markdown] tags=["statement"]
# ## Exercise 1: four robots, one field
#
# A robot mapped a field in March: each cell has a belief about the precision $\tau$ of its
# heights, $p(\tau) \propto \tau^{\alpha - 1} e^{-\beta\tau}$. In May several robots take a
# copy of that map, drive each its own way, and each adds its own pictures with the update of the
# lesson, $\alpha \leftarrow \alpha + \nu/2$ and $\beta \leftarrow \beta + S/2$. In the
# evening you have their maps, but no picture: those are deleted. Make **one** map of what all of
# them saw, in March and in May.
#
# First on paper: each belief is (what was known in March) times (what this robot saw). What is the
# product of *all* that was seen?
#
# The picture merges forty cells of four robots. A dot is the roughness $\sqrt{\beta/\alpha}$ of
# your map and its bar the 95 % interval of the belief; a black dash is the truth. How many of the
# forty bars should hold it?


# %% tags=["exercise"]
def merged(alphas: Array, betas: Array, alpha: Array, beta: Array) -> Any:
    """One map from the maps of several robots.

    Parameters
    ----------
    alphas, betas : ndarray, shape (m, C)
        Shape, and rate (m^2), of each of C cells in the maps of m robots; m is 1 or
        more. Where a robot did not look, its map is as it was in March.
    alpha, beta : ndarray, shape (C,)
        The map of March, with which all began.

    Returns
    -------
    alpha, beta : ndarray, shape (C,)
    """
    again = len(alphas) - 1
    return alphas.sum(axis=0) - again * alpha, betas.sum(axis=0) - again * beta


# %% active="ipynb" tags=["try"]
# merged(
#     np.array([[3.0, 2.0], [4.5, 2.0]]),
#     np.array([[0.05, 0.01], [0.07, 0.01]]),
#     np.array([2.0, 2.0]),
#     np.array([0.03, 0.01]),
# )

# %% [markdown] tags=["hint"]
# What did the first robot see in the first cell? Its map has $\alpha = 3$, that of March 2. And
# the second robot, with 4.5?

# %% [markdown] tags=["hint"]
# The belief of each robot holds March once. In the product of $m$ beliefs, how often is March in
# it, and how often should it be?


# %% tags=["cases"]
@drawn
def _fields(rng: np.random.Generator, m: int) -> Any:
    alpha, beta = rng.integers(2, 20, 4) / 2, np.round(rng.uniform(0.001, 0.2, 4), 3)
    nu = rng.integers(0, 12, (m, 4)) * (rng.random((m, 4)) < 0.7)
    return (
        alpha + nu / 2,
        beta + np.round(nu * rng.uniform(0.001, 0.02, (m, 4)), 4),
        alpha,
        beta,
    )


def _merged_drawn(ax: Any, function: Any) -> None:
    """Draw how rough the merged map says that forty cells are, and how rough they are."""
    from slamlab import plots

    rng, cells = np.random.default_rng(15), 40
    truth = np.exp(rng.normal(np.log(0.03), 0.4, cells))  # m

    def seen(n: int) -> Any:
        z = truth[:, None] * rng.standard_normal((cells, n))
        return (n - 1) / 2, np.sum((z - z.mean(axis=1, keepdims=True)) ** 2, axis=1) / 2

    half, squares = seen(21)
    alpha, beta = np.full(cells, 1.0 + half), 1e-3 + squares
    news = [seen(5) for _ in range(4)]
    alphas = np.array([alpha + half for half, _ in news])
    betas = np.array([beta + squares for _, squares in news])
    a, b = (np.asarray(part, float) for part in function(alphas, betas, alpha, beta))
    middle, factor = 100 * np.sqrt(b / a), np.exp(1.96 / (2 * np.sqrt(a)))
    place, blue = np.arange(cells), plots.COLOURS["estimate"]
    ax.vlines(place, middle / factor, middle * factor, color=blue, lw=3, alpha=0.4)
    ax.plot(place, middle, ".", color=blue, ms=4, label="merged, 95 %")
    ax.plot(place, 100 * truth, "_", color=plots.COLOURS["truth"], ms=6, label="truth")
    held = np.sum((100 * truth > middle / factor) & (100 * truth < middle * factor))
    ax.set_title(f"{held} of {cells} bars hold the truth")
    ax.set(xlabel="cell", ylabel="roughness (cm)", ylim=(0, 9))
    ax.legend(fontsize=8, loc="upper right")


check_merged = Check(
    merged,
    "alpha, beta",
    {
        "two robots, two cells": (
            [[3.0, 2.0], [4.5, 2.0]],
            [[0.05, 0.01], [0.07, 0.01]],
            [2.0, 2.0],
            [0.03, 0.01],
        ),
        "one robot: its own map": ([[3.0, 5.5]], [[0.02, 0.04]], [2.0, 1.0], [0.01, 0.001]),
        "no robot looked": ([[2.5]] * 3, [[0.04]] * 3, [2.5], [0.04]),
        "two robots, any field": _fields(2),
        "five robots, any field": _fields(5),
    },
    picture=_merged_drawn,
)

# %% tags=["mistakes"]
check_merged.mistakes = {
    "March is counted once for every robot: it was seen once": "- again *  => - 0 * ",
    "March is lost: take it off once less than there are robots": (
        "len(alphas) - 1 => len(alphas)"
    ),
    "a mean of maps is no more certain than one of them": (
        lambda alphas, betas, alpha, beta: (alphas.mean(axis=0), betas.mean(axis=0))
    ),
    "March is still counted twice in one of the two numbers: beta needs it as alpha does": (
        "betas.sum(axis=0) - again * beta => betas.sum(axis=0)"
    ),
    "March is still counted more than once in alpha": (
        "alphas.sum(axis=0) - again * alpha => alphas.sum(axis=0)"
    ),
    "the exponent of tau is alpha - 1: alpha is one more than the exponent": (
        "- again * alpha,  => - again * alpha - 1, "
    ),
    "take off March for all robots but one, not for one only": (
        "len(alphas) - 1 => min(len(alphas) - 1, 1)"
    ),
    "sums run over the robots, axis 0": (
        lambda alphas, betas, alpha, beta: (
            alphas.sum() - (len(alphas) - 1) * alpha,
            betas.sum() - (len(betas) - 1) * beta,
        )
    ),
    "this is the map of the robot that saw most; what the others saw is lost": (
        lambda alphas, betas, alpha, beta: (alphas.max(axis=0), betas.max(axis=0))
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: four robots, one field
#
# The belief of robot $i$ is March times what it saw: $p_i = p_0\, l_i$. All that was seen is
# $p_0\, l_1 \cdots l_m = p_1 \cdots p_m / p_0^{m - 1}$. The exponents of $\tau$ are $\sum
# (\alpha_i - 1) - (m - 1)(\alpha_0 - 1) = \sum \alpha_i - (m - 1)\,\alpha_0 - 1$, which is
# the new $\alpha$ less one; those of $e^{-\tau}$ are $\sum \beta_i - (m - 1)\,\beta_0$. About 95 %
# of forty bars, 38, should hold the truth.

# %% [markdown] tags=["solution"]
# The sum of the maps counts March four times. Its roughness is nearly as good, but it is
# overconfident, and fewer bars hold the truth:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: how rough the merged map says that forty cells are, and how rough they are; on the left many of the bars miss the truth."}}
# def summed(alphas, betas, alpha, beta):
#     return alphas.sum(axis=0), betas.sum(axis=0)
#
# check_merged.draw(summed)

# %% [markdown] tags=["statement"]
# You need no picture: $\alpha$ and $\beta$ keep all that pictures say about a cell, and maps that
# began alike can be merged. In the last exercise four robots come home, your `merged` makes one
# map, and a fifth robot finds its place on it.
#
# ## Exercise 2: the weights of Gamma-SLAM
#
# Sixty-one particles, one picture. Every particle stands elsewhere, so it sorts the *same* heights
# into other cells of its own map, here into three and there into four. Weigh them all by the
# density of the heights, and normalise. For each cell in which the particle has $n \ge 1$
# heights, with $\nu = n - 1$ and the sum of squares $S$ about the mean of these heights, the
# logarithm grows by
#
# $$
# \begin{aligned}
# & \ln\Gamma(\alpha + \tfrac{\nu}{2}) - \ln\Gamma(\alpha) + \alpha\ln\beta
# - (\alpha + \tfrac{\nu}{2}) \ln\big(\beta + \tfrac{S}{2}\big) \\
# & - \tfrac{\nu}{2} \ln 2\pi - \tfrac12 \ln n - \ln L .
# \end{aligned}
# $$
#
# The unknown mean of each cell is anywhere within a width $L$. Before you write: a particle
# sorts a height alone into a cell. What does this height cost? And what would be different in
# centimetres if you left that cell out?
#
# In the picture each dot is one of the sixty-one, in a row across the way, 2 cm apart; the one in
# the middle, at the line, stands where the robot is.


# %% tags=["exercise"]
def weights(alpha: Array, beta: Array, cells: Ints, heights: Array, width: float) -> Array:
    """Weights of particles.

    Parameters
    ----------
    alpha, beta : ndarray, shape (M, C)
        Map of each particle: shape and rate of each of its C cells.
    cells : ndarray of int, shape (M, n)
        Cell into which each particle sorts each height.
    heights : ndarray, shape (n,)
        (m)
    width : float
        L, in the unit of the heights.

    Returns
    -------
    ndarray, shape (M,)
        They sum to 1.
    """
    log_weights = np.zeros(len(cells))
    for i in range(len(cells)):
        for c in np.unique(cells[i]):
            z = heights[cells[i] == c]
            half, a, b = (len(z) - 1) / 2, alpha[i, c], beta[i, c]
            squares = np.sum((z - z.mean()) ** 2)
            log_weights[i] += math.lgamma(a + half) - math.lgamma(a) + a * np.log(b)
            log_weights[i] -= (a + half) * np.log(b + squares / 2)
            log_weights[i] -= half * np.log(2 * np.pi) + np.log(len(z)) / 2
            log_weights[i] -= np.log(width)
    result = np.exp(log_weights - log_weights.max())
    return result / result.sum()


# %% active="ipynb" tags=["try"]
# weights(np.ones((2, 2)), np.ones((2, 2)), np.array([[0, 0, 1], [0, 1, 1]]),
#         np.array([0.1, 0.2, 0.4]), 1.0)

# %% [markdown] tags=["hint"]
# Two loops: over particles, and over `np.unique(cells[i])`. The heights of a cell are
# `heights[cells[i] == c]`.

# %% [markdown] tags=["hint"]
# `math.lgamma` (after `import math`) is $\ln\Gamma$. For a height alone in its cell put $n = 1$,
# its $\nu$ and its $S$ into the formula: which terms are left?

# %% [markdown] tags=["hint"]
# Logarithms of -5000 are too small for `exp`. The largest of them may be taken off all before.


# %% tags=["cases"]
@drawn
def _particles(rng: np.random.Generator, n_particles: int, size: float) -> Any:
    n = int(rng.integers(6, 15))
    return (
        rng.integers(2, 20, (n_particles, 4)) / 2,
        np.round(rng.uniform(0.01, 0.5, (n_particles, 4)), 3),
        rng.integers(0, 4, (n_particles, n)),
        np.round(rng.normal(0, size, n), 3),
        float(np.round(rng.uniform(0.1, 4.0), 1)),
    )


_TWO_PLACES: tuple[Any, ...] = (
    np.array([[2.0, 3.0], [2.0, 3.0]]),
    np.array([[0.1, 0.2], [0.1, 0.2]]),
    np.array([[0, 0, 0, 0], [0, 1, 1, 1]]),
    np.array([0.1, 0.3, -0.2, 0.25]),
    0.5,
)


def _weights_drawn(ax: Any, function: Any) -> None:
    """Draw the weights of particles that stand to either side of the true place."""
    aside, side = np.linspace(-0.6, 0.6, 61), 0.25
    rng = np.random.default_rng(3)
    scatter = rng.choice([0.02, 0.04, 0.09], 24)  # of cells from -1 m to 5 m
    x = rng.uniform(0.0, 4.0, 120)
    heights = scatter[np.floor(x / side).astype(int) + 4] * rng.standard_normal(120)
    alpha = np.full((len(aside), 24), 20.0)
    cells = np.floor((x + aside[:, None]) / side).astype(int) + 4
    w = np.asarray(function(alpha, alpha * scatter**2, cells, heights, 1.0), float)
    ax.plot(100 * aside, np.log10(np.maximum(w, 1e-60)), ".-", lw=0.8, ms=5)
    ax.axvline(0.0, color="0.5", lw=1)
    ax.set_title(f"{len(w)} particles, heaviest at {100 * aside[np.argmax(w)]:.0f} cm")
    ax.set(xlabel="particle stands aside by (cm)", ylabel="log10 of its weight")


check_weights = Check(
    weights,
    "weight",
    {
        "two particles, the same cells, different maps": (
            [[2.0, 3.0], [5.0, 1.0]],
            [[0.1, 0.2], [0.05, 0.3]],
            [[0, 0, 1, 1], [0, 0, 1, 1]],
            [0.1, 0.3, -0.2, 0.25],
            1.0,
        ),
        "the same maps, different cells": (
            [[2.0, 3.0], [2.0, 3.0]],
            [[0.1, 0.2], [0.1, 0.2]],
            [[0, 0, 1, 1], [0, 1, 1, 1]],
            [0.1, 0.3, -0.2, 0.25],
            1.0,
        ),
        "one cell against two": _TWO_PLACES,
        "the same in centimetres": (
            _TWO_PLACES[0],
            1e4 * _TWO_PLACES[1],
            _TWO_PLACES[2],
            100 * _TWO_PLACES[3],
            50.0,
        ),
        "any particles": _particles(3, 0.2),
        "a picture so unlikely that exp gives 0": (
            [[2.0, 2.0], [90.0, 90.0]],
            [[0.1, 0.1], [0.001, 0.001]],
            np.tile(np.arange(240) % 2, (2, 1)),
            np.linspace(-400.0, 500.0, 240),
            2.0,
        ),
    },
    tolerance=1e-7,
    picture=_weights_drawn,
)


# %% tags=["mistakes"]
def _variances(alpha: Array, beta: Array, cells: Ints, heights: Array, width: float) -> Array:
    """Return the weights by the density of the sample variances of two or more heights."""
    log_weights = np.zeros(len(cells))
    for i in range(len(cells)):
        for c in np.unique(cells[i]):
            z = heights[cells[i] == c]
            if len(z) < 2:
                continue
            half, a, b = (len(z) - 1) / 2, alpha[i, c], beta[i, c]
            s2 = np.var(z, ddof=1)
            log_weights[i] += math.lgamma(a + half) - math.lgamma(a) + a * np.log(b)
            log_weights[i] -= (a + half) * np.log(b + half * s2) + math.lgamma(half)
            log_weights[i] += half * np.log(half) + (half - 1) * np.log(s2)
    weights = np.exp(log_weights - log_weights.max())
    return weights / weights.sum()


check_weights.mistakes = {
    "these are densities of sample variances: each particle has other ones. Weigh by the density "
    "of the heights": _variances,
    "a height alone in its cell was left out: it has no scatter, but it costs ln L": (
        "half, a, b = => if len(z) < 2:\n                continue\n            half, a, b ="
    ),
    "how many heights fell into a cell counts too: the term - ln(n) / 2 is missing": (
        " + np.log(len(z)) / 2 => "
    ),
    "each cell costs ln L: without it the weights change with the unit of length": (
        "log_weights[i] -= np.log(width) => pass"
    ),
    "each cell lowers the logarithm by ln L": "-= np.log(width) => += np.log(width)",
    "the normal density has 2 pi: - nu / 2 ln(2 pi) is missing, and nu differs": (
        "half * np.log(2 * np.pi) +  => "
    ),
    "the mean costs one degree of freedom: nu = n - 1": "(len(z) - 1) / 2 => len(z) / 2",
    "the heights of a cell scatter about the mean of that cell": ("z.mean() => heights.mean()"),
    "expected a + nu / 2, not a alone": (
        "(a + half) * np.log(b + squares / 2) => a * np.log(b + squares / 2)"
    ),
    "the logarithms are too small for exp: take the largest off first": (
        "np.exp(log_weights - log_weights.max()) => np.exp(log_weights)"
    ),
    "weights sum to 1": ("result / result.sum() => result"),
    "alpha and beta were exchanged: the first belongs to lnGamma": (
        "alpha[i, c], beta[i, c] => beta[i, c], alpha[i, c]"
    ),
    "each particle has its own map: these are all weighed on the first": (
        "alpha[i, c], beta[i, c] => alpha[0, c], beta[0, c]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: the weights of Gamma-SLAM

# %% [markdown] tags=["solution"]
# A height alone in its cell costs $\ln L$. Without $\ln L$ the particle with one cell and the
# particle with two get different weights in metres and in centimetres. And the density of the
# sample variances, from the [second page](../15b_other_maps.ipynb), is right as a density. It
# passes where all particles have the same cells, and fails where they have not:

# %% active="ipynb" tags=["solution"]
# def by_variances(alpha, beta, cells, heights, width):
#     log_weights = np.zeros(len(cells))
#     for i in range(len(cells)):
#         for c in np.unique(cells[i]):
#             z = heights[cells[i] == c]
#             if len(z) < 2:
#                 continue
#             half, s2 = (len(z) - 1) / 2, np.var(z, ddof=1)
#             a, b = alpha[i, c], beta[i, c]
#             log_weights[i] += math.lgamma(a + half) - math.lgamma(a) + a * np.log(b)
#             log_weights[i] -= (a + half) * np.log(b + half * s2) + math.lgamma(half)
#             log_weights[i] += half * np.log(half) + (half - 1) * np.log(s2)
#     result = np.exp(log_weights - log_weights.max())
#     return result / result.sum()
#
# check_weights(by_variances)

# %% [markdown] tags=["statement"]
# Your weights compare particles on one scale, however each sorts the picture. They drive the robot
# of the last exercise. Now to DP-SLAM, whose cells count beams.
#
# ## Exercise 3: the hedge from behind
#
# Robot A stands still before a hedge with a fence behind it and sends `sent` beams along one line
# through $n$ cells. `ended[k]` of them end in cell $k$; what is left flies out beyond the last
# cell. Robot B comes from the other side and sends a beam along the same line, towards A. In which
# cell will it end?
#
# A's shares `ended / sent` are no answer. With 100 beams that end in 0, 50 and 50, what is the
# third cell? Every cell has its own hits per metre $h/d$, and stops a beam that comes to it, and
# travels $l$ metres in it, with the chance $1 - e^{-(h/d)\,l}$. B's way in each cell is `stretch`
# times A's: its beam runs slantwise.
#
# In the picture a bar is the chance of your function; the dash across it is the share of 2000
# beams of B that did end there, and the dotted line A's own shares.


# %% tags=["exercise"]
def from_behind(ended: Ints, sent: int, stretch: float) -> Array:
    """Chance that B's beam ends in each cell.

    Parameters
    ----------
    ended : ndarray of int, shape (n,)
        Beams of A that ended in each cell, the cell nearest to A first.
    sent : int
        All beams of A. One or more came to every cell.
    stretch : float
        B's way in a cell over A's way in it.

    Returns
    -------
    ndarray, shape (n,)
        In the order of `ended`: the cell nearest to A first. Less than 1 together, if
        B's beam may fly through all.
    """
    came = sent - np.cumsum(ended) + ended
    free = (1 - ended / came) ** stretch
    before = np.cumprod(np.append(1.0, free[::-1]))[:-1]
    return before[::-1] * (1 - free)


# %% active="ipynb" tags=["try"]
# from_behind(np.array([0, 50, 50]), 100, 1.0)

# %% [markdown] tags=["hint"]
# Of A's 100 beams, how many came to the third cell? How many of these did it stop?

# %% [markdown] tags=["hint"]
# A beam survives $l$ metres with $e^{-(h/d)\,l}$. If that is $q$ for A's way, what is it for a
# way that is twice as long? You do not need $h/d$ itself, which is infinite for a cell that stops
# all.

# %% [markdown] tags=["hint"]
# For B the last cell is the first: `[::-1]` turns an array round. Turn the result round again.


# %% tags=["cases"]
_HEDGE = np.array([0.0, 0.3, 0.5, 0.3, 0.0, 0.0, 0.4, 0.4])  # a cell stops for A


def _from_behind_drawn(ax: Any, function: Any) -> None:
    """Draw where B's beams will end, where 2000 of them end, and A's own shares."""
    from slamlab import plots

    rng, sent, stretch = np.random.default_rng(2), 4000, 1.3

    def ends(stop: Array, n: int) -> Ints:
        stopped = rng.random((n, len(stop))) < stop
        return np.bincount(stopped.argmax(axis=1)[stopped.any(axis=1)], minlength=len(stop))

    ended = ends(_HEDGE, sent)
    place, n = 0.05 + 0.1 * np.arange(len(_HEDGE)), 2000
    met = ends((1 - (1 - _HEDGE) ** stretch)[::-1], n)[::-1] / n
    chance = np.asarray(function(ended, sent, stretch), float)
    ax.bar(place, chance, 0.08, color=plots.COLOURS["estimate"], label="B, by the function")
    ax.plot(place, met, "k_", ms=12, mew=2, label="B, 2000 beams")
    ax.plot(place, ended / sent, ":", color=plots.COLOURS["wrong"], label="A's shares")
    ax.set_title(f"off by at most {np.abs(chance - met).max():.2f}")
    ax.text(0.25, -0.05, "hedge", ha="center", va="center", fontsize=9)
    ax.text(0.7, -0.05, "fence", ha="center", va="center", fontsize=9)
    ax.legend(fontsize=8, loc="upper left")
    ax.set(xlabel="way from A (m)", ylabel="chance to end", ylim=(-0.05, 0.9), xlim=(0, 0.8))


def _a_hedge(rng: np.random.Generator) -> Any:
    n, left, ended = int(rng.integers(3, 7)), int(rng.integers(60, 300)), []
    sent = left
    for _ in range(n):
        ended.append(int(rng.integers(0, max(left // 2, 1))))
        left -= ended[-1]
    return ended, sent, float(np.round(rng.uniform(0.6, 2.5), 2))


check_from_behind = Check(
    from_behind,
    "chance",
    {
        "two cells": ([10, 30], 100, 1.0),
        "half in the hedge, half in the wall": ([0, 50, 50], 100, 1.0),
        "an open floor": ([0, 0, 0], 50, 1.5),
        "slantwise through one cell": ([36], 100, 2.0),
        "a hedge, a wall that stops all, slantwise": ([0, 40, 30, 10, 20], 100, 1.4),
        "any line": _a_hedge,
    },
    picture=_from_behind_drawn,
)

# %% tags=["mistakes"]
check_from_behind.mistakes = {
    "divide by the beams that reached the cell, not by all that were sent": (
        "sent - np.cumsum(ended) + ended => sent"
    ),
    "beams that end in a cell reached it: they count among those that did": (
        "np.cumsum(ended) + ended => np.cumsum(ended)"
    ),
    "this is what A sees: for B the last cell is the first": (
        "free[::-1] => free",
        "before[::-1] => before",
    ),
    "expected the order of `ended`, the cell nearest to A first": (
        "before[::-1] * (1 - free) => (before[::-1] * (1 - free))[::-1]"
    ),
    "B must come to the cell first: multiply by the chance to pass all cells behind it": (
        "before[::-1] * (1 - free) => 1 - free"
    ),
    "to end in a cell B need not pass that cell": (
        "np.cumprod(np.append(1.0, free[::-1]))[:-1] => np.cumprod(free[::-1])"
    ),
    "this is the chance to come to the cell; it must end there too": ("* (1 - free) => * 1"),
    "`stretch` belongs to the chance to pass: (1 - P) ** stretch": (
        "(1 - ended / came) ** stretch => 1 - (ended / came) ** stretch"
    ),
    "a chance does not grow with the way: 1 - e^(-x), not x": (
        "(1 - ended / came) ** stretch => 1 - np.minimum(stretch * ended / came, 1)"
    ),
    "A's beams that flew through all reached every cell too": (
        "sent - np.cumsum(ended) + ended => ended.sum() - np.cumsum(ended) + ended"
    ),
    "expected chances as they are: what is left flies through": (
        lambda ended, sent, stretch: (
            from_behind(ended, sent, stretch) / from_behind(ended, sent, stretch).sum()
        )
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: the hedge from behind

# %% [markdown] tags=["solution"]
# The third cell stopped 50 of the 50 beams that came: it is a wall, and B sees nothing else. Over
# a way that is $s$ times as long, $e^{-(h/d)\,ls} = (1 - P)^s$: $h/d$ is not needed. With all
# beams in the denominator the fence in the shadow of the hedge seems thin, and most of B's beams
# are expected in the hedge:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: where B's beams will end, where 2000 of them end, and A's own shares; on the left beams of B are expected deep in the hedge."}}
# def by_all(ended, sent, stretch):
#     free = (1 - ended / sent) ** stretch
#     before = np.cumprod(np.append(1.0, free[::-1]))[:-1]
#     return before[::-1] * (1 - free)
#
# check_from_behind.draw(by_all)

# %% [markdown] tags=["statement"]
# A cell has to be judged by the beams that came to it. DP-SLAM's metres $d$ do that: a cell in
# the shadow has few metres, and few hits are many per metre.
#
# ## Exercise 4: a wall that this particle never saw
#
# DP-SLAM keeps the maps of all particles in one tree. This program has a bug, and the robot shows
# it: the map of the best particle has a corridor wall twice, 20 cm apart. The second one was drawn
# by another particle, which is lost by now. In the laboratory, with one particle, every map was
# right. Find the bug and mend it.
#
# The picture shows it: particles A and B are children of one node, B is 20 cm off, and both have
# drawn three scans. You see the map that A reads. A dashed frame stands where B drew its wall: in
# A's map it should be empty.


# %% tags=["exercise"]
def draw_scan(parents: Ints, entries: Array, node: int, cells: Ints) -> Array:
    """Count the beams of one scan in the map of one particle.

    A particle reads in a cell the youngest entry: that of its own node or, where that
    is NaN, of its parent, and so on to the root; 0 if none has one.

    Parameters
    ----------
    parents : ndarray of int, shape (nodes,)
        Parent of each node, -1 for the root; a parent has a smaller number.
    entries : ndarray, shape (nodes, cells)
        Number of beams that ended in each cell, NaN where a node has no entry.
    node : int
        Node of the particle.
    cells : ndarray of int, shape (n,)
        Cells in which the beams ended; a cell occurs as often as it was hit.

    Returns
    -------
    ndarray, shape (nodes, cells)
        The entries afterwards. For each beam this particle reads one more in its cell.
    """
    entries = entries.copy()
    for cell in cells:
        reader = node
        while np.isnan(entries[reader, cell]) and parents[reader] >= 0:
            reader = parents[reader]
        entries[node, cell] = np.nan_to_num(entries[reader, cell]) + 1
    return entries


# %% active="ipynb" tags=["stub"]
#     entries = entries.copy()
#     for cell in cells:
#         while np.isnan(entries[node, cell]) and parents[node] >= 0:
#             node = parents[node]
#         entries[node, cell] = np.nan_to_num(entries[node, cell]) + 1
#     return entries

# %% active="ipynb" tags=["try"]
# draw_scan(np.array([-1, 0, 0]), np.array([[4.0], [np.nan], [np.nan]]), 1, np.array([0]))

# %% [markdown] tags=["hint"]
# In the call above the root holds a 4, and particle 1 has one more hit. What should particle 2
# read afterwards? What does it read?

# %% [markdown] tags=["hint"]
# Follow the variables with a pencil through two beams. Which of them changes, and what is it
# needed for afterwards?


# %% tags=["cases"]
_NONE = float("nan")


def _a_tree(rng: np.random.Generator) -> Any:
    n = int(rng.integers(4, 9))
    parents = [-1, *(int(rng.integers(max(0, k - 3), k)) for k in range(1, n))]
    entries = np.where(rng.random((n, 5)) < 0.35, rng.integers(0, 9, (n, 5)), np.nan)
    return parents, entries, int(rng.integers(0, n)), rng.integers(0, 5, int(rng.integers(1, 7)))


def _draw_scan_drawn(ax: Any, function: Any) -> None:
    """Draw the hits that particle A reads, after it and its brother B drew three scans."""
    from slamlab import plots

    rows, columns, colour = 12, 18, plots.COLOURS["wrong"]
    row, column = np.arange(rows * columns).reshape(rows, columns), np.arange(columns)
    parents, entries = np.array([-1, 0, 0]), np.full((3, rows * columns), _NONE)
    entries[0, row[4, :9]] = 3.0  # what both saw before
    for _ in range(3):
        for node, wall in ((1, row[4, column]), (2, row[6, column])):
            entries = np.array(function(parents, entries, node, wall), float)
    seen = np.where(np.isnan(entries[1]), np.nan_to_num(entries[0]), entries[1])
    ax.imshow(seen.reshape(rows, columns), cmap="Greys", vmin=0, vmax=6, origin="lower")
    ax.plot([-0.5, 17.5, 17.5, -0.5, -0.5], [5.5, 5.5, 6.5, 6.5, 5.5], "--", color=colour, lw=1)
    ax.text(8.5, 7.6, "where B drew its wall", ha="center", va="center", fontsize=9, color=colour)
    ax.text(8.5, 2.4, "A's own wall", ha="center", va="center", fontsize=9)
    for hits, at in ((3, 1.0), (6, 10.0)):  # the key
        ax.plot(at, 10.3, "s", color=str(1 - hits / 6), mec="0.4", ms=9)
        ax.text(at + 1.0, 10.3, f"{hits} hits", va="center", fontsize=9)
    strange = np.sum(seen[row[6]] > 0)
    ax.set_title(f"{strange} cells are not A's")
    ax.grid(False)
    ax.set(xlabel="cells of 10 cm", yticks=[], xlim=(-0.5, 17.5), ylim=(-0.5, 11.5))


def _in_a_tree(function: Any) -> Any:
    """Give the same function; of what is no tree it raises, where a walk would not end."""

    @wraps(function)
    def checked(parents: Ints, *given: Any) -> Any:
        if np.any(np.asarray(parents) >= np.arange(len(parents))):
            raise ValueError("a parent has a smaller number than its children")
        return function(parents, *given)

    return checked


check_draw_scan = Check(
    draw_scan,
    "entries",
    {
        "one particle, alone": ([-1], [[4.0, _NONE]], 0, [0]),
        "one particle, a new cell": ([-1], [[4.0, _NONE]], 0, [1]),
        "after a resampling": ([-1, 0, 0], [[4.0], [_NONE], [_NONE]], 1, [0]),
        "after two resamplings": (
            [-1, 0, 0, 1, 1],
            [[4.0, _NONE], *[[_NONE, _NONE]] * 4],
            4,
            [0, 1],
        ),
        "two beams in one cell": ([-1, 0], [[_NONE, 2.0], [1.0, _NONE]], 1, [1, 0, 1]),
        "any tree, any scan": _a_tree,
    },
    draws=20,
    picture=_draw_scan_drawn,
    hunt=True,
)
check_draw_scan.reference = _in_a_tree(draw_scan)

# %% tags=["mistakes"]
check_draw_scan.mistakes = {
    "the beam is written into the node in which the entry was found: its other children read it": (
        "reader = node => pass",
        "reader => node",
    ),
    "the node's own entry only: what its ancestors counted is lost": (
        "reader = parents[reader] => reader = -1",
        "while np.isnan(entries[reader, cell]) and parents[reader] >= 0 => while False",
    ),
    "the walk goes on to the root, not one step only": (
        "while np.isnan(entries[reader, cell]) and parents[reader] >= 0"
        " => if np.isnan(entries[reader, cell]) and parents[reader] >= 0"
    ),
    "the root has entries too": ("and parents[reader] >= 0 => and parents[parents[reader]] >= 0"),
    "the walk begins in each cell at the particle's own node": (
        "for cell in cells:\n        reader = node => reader = node\n    for cell in cells:"
    ),
    "a cell that was hit twice has two beams more": "in cells: => in np.unique(cells):",
    "one beam more, not the first": "+ 1\n    return => + 0\n    return",
    "the parent is parents[node], not the node before": (
        "reader = parents[reader] => reader = reader - 1"
    ),
    "0 is an entry like others": (
        "while np.isnan(entries[reader, cell]) => while not np.nan_to_num(entries[reader, cell])"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: a wall that this particle never saw
#
# The walk used `node` itself, so `node` was an ancestor when the beam was written, and all its
# descendants read the beam. With one particle there are no others to read it. A second variable
# walks, and `node` stays. Reading may go up the tree; writing never does.

# %% [markdown] tags=["statement"]
# Your tree is safe to share: a particle reads what its ancestors drew, and writes for itself
# alone.
#
# ## Exercise 5: who is left in the tree
#
# After an hour the computer of the robot runs out of memory: at every resampling each particle
# gets a new node. Most of them lead to no particle any more. *Prune* these; then *merge* every
# node that has one child left with that child: the child stays, and the node goes. The root may go
# too. Which nodes remain? Answer with a mask, without changing the tree: the robot asks first
# whether tidying is worth it.
#
# Before you write: of $M$ particles, how many nodes can remain at most? Draw trees for $M = 2$, 3
# and 4 first. The answer does not depend on the length of the drive.
#
# The picture is that hour: sixteen particles, resampled once a minute. Grey is the tree before;
# blue dots are the nodes that stay, blue lines lead to the next one that stays.


# %% tags=["exercise"]
def survivors(parents: Ints, particles: Ints) -> Mask:
    """Nodes that stay.

    Parameters
    ----------
    parents : ndarray of int, shape (n,)
        Parent of each node, -1 for node 0, the root; a parent has a smaller number.
    particles : ndarray of int, shape (M,)
        Nodes that are particles; they have no children.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    n = len(parents)
    leads, branches = np.zeros(n, bool), np.zeros(n, int)
    leads[particles] = True
    for node in range(n - 1, 0, -1):
        if leads[node]:
            leads[parents[node]] = True
            branches[parents[node]] += 1
    left = branches >= 2
    left[particles] = True
    return left


# %% active="ipynb" tags=["try"]
# survivors(np.array([-1, 0, 0, 1, 1]), np.array([3, 4]))

# %% [markdown] tags=["hint"]
# Go through the nodes from the last to the first: a child tells its parent whether it leads to a
# particle.

# %% [markdown] tags=["hint"]
# Count for each node how many of its children lead to particles. Which counts let it stay?


# %% tags=["cases"]
def _a_family(rng: np.random.Generator) -> Any:
    n = int(rng.integers(4, 14))
    parents = np.array([-1, *(int(rng.integers(max(0, k - 4), k)) for k in range(1, n))])
    leaves = np.setdiff1d(np.arange(n), parents)
    some = rng.choice(leaves, int(rng.integers(1, len(leaves) + 1)), replace=False)
    return parents, np.sort(some)


def _survivors_drawn(ax: Any, function: Any) -> None:
    """Draw the tree of an hour, in grey, and on it the nodes that stay, in blue."""
    from slamlab import plots

    parents, x, y = _an_hour()
    n, M = len(parents), 16
    stays = function(parents, np.arange(n - M, n))
    left = np.array([bool(stays[node]) for node in range(n)])
    ends = np.stack([np.arange(1, n), parents[1:]], -1)
    ways = []  # from a node that stays to the next one above it
    for node in np.flatnonzero(left):
        above = parents[node]
        while above >= 0 and not left[above]:
            above = parents[above]
        ways.append([node, above if above >= 0 else node])
    tidy = np.array(ways, int).reshape(-1, 2)
    for pairs, colour, width in ((ends, "0.65", 0.7), (tidy, plots.COLOURS["estimate"], 1.2)):
        gap = np.full((len(pairs), 1), np.nan)
        lines = [np.append(values[pairs], gap, axis=1).ravel() for values in (x, y)]
        ax.plot(*lines, color=colour, lw=width)
    ax.plot(x[left], y[left], ".", ms=5, color=plots.COLOURS["estimate"])
    ax.set_title(f"{left.sum()} of {n} nodes stay")
    ax.set(xlim=(0, 60), ylim=(-1, M), xlabel="time (min)", yticks=[], ylabel="particles")
    ax.grid(False)


@lru_cache(maxsize=1)
def _an_hour() -> Any:
    """Give the tree of sixteen particles that were resampled sixty times: parents, x, y."""
    rng, M = np.random.default_rng(1), 16
    parents, last = [-1], np.zeros(M, int)
    for _ in range(60):
        sums = np.cumsum(rng.uniform(0.4, 1.0, M))
        chosen = np.searchsorted(sums / sums[-1], (np.arange(M) + rng.random()) / M)
        new = len(parents) + np.arange(M)
        parents.extend(last[chosen].tolist())
        last = new
    nodes = np.arange(len(parents) - 1)
    return np.array(parents), np.append(0, 1 + nodes // M), np.append(7.5, nodes % M)


check_survivors = Check(
    survivors,
    "left",
    {
        "a root with two particles": ([-1, 0, 0], [1, 2]),
        "a chain is merged into its particle": ([-1, 0, 1, 2], [3]),
        "a branch that died is pruned, and its fork merged": ([-1, 0, 0, 1, 1], [3, 4]),
        "as many as can remain": ([-1, 0, 0, 1, 1, 2, 2], [3, 4, 5, 6]),
        "any tree": _a_family,
    },
    draws=20,
    picture=_survivors_drawn,
)


# %% tags=["mistakes"]
check_survivors.mistakes = {
    "a node with one living child is merged with it: expected two branches or more": (
        "branches >= 2 => branches >= 1"
    ),
    "prune first: a child without particles below it does not count": (
        "if leads[node]:\n            leads[parents[node]] = True\n"
        "            branches[parents[node]] += 1"
        " => leads[parents[node]] |= leads[node]\n        branches[parents[node]] += 1"
    ),
    "a fork may have more than two branches": "branches >= 2 => branches == 2",
    "particles stay, though they have no children": (
        "left[particles] = True => left[particles] = False"
    ),
    "the root may be merged too": ("left = branches >= 2 => left = branches >= 2; left[0] = 1"),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: who is left in the tree

# %% [markdown] tags=["solution"]
# Every inner node that stays is a fork. Go from the root down: one way in, and each fork makes at
# least one more. $M$ ways come out, so there are at most $M - 1$ forks, and with the particles at
# most $2M - 1$ nodes. Of sixteen particles that is 31, after an hour or a year; it is less where
# a node has three branches. Counting dead children keeps forks that are none:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: the tree of an hour, in grey, and on it the nodes that stay, in blue; on the left forks with dead children remain."}}
# def with_the_dead(parents, particles):
#     left = np.bincount(parents[1:], minlength=len(parents)) >= 2
#     left[particles] = True
#     return left
#
# check_survivors.draw(with_the_dead)

# %% [markdown] tags=["statement"]
# With exercises 3 to 5 you have the map of DP-SLAM: beams that may stop anywhere, one tree for all
# particles, and its size after any drive. Back to rough ground.
#
# ## Exercise 6: a robot finds its place on rough ground
#
# A field of 20 m by 20 m was mapped in March. In May four robots took copies, drove round it, and
# came home with four maps, as in exercise 1. In June a fifth robot is put on it. It knows its
# place to about half a metre and its heading to about six degrees; there is no wall, no landmark
# and no satellite. All its particles use one map, and nothing is added to it. Assemble the filter:
#
# 1. make one map of all, with your `merged` of exercise 1.
#
# Then, for each picture:
#
# 2. move each particle by its own motion, `compose(poses, move)`;
# 3. sort the heights into cells, each particle for itself: `transform(poses, points)` has the
#    shape (M, n, 2). A cell is 0.5 m wide; row $r$ and column $c$ of the map hold $0.5\,c \le x <
#    0.5\,(c + 1)$ and $0.5\,r \le y < 0.5\,(r + 1)$;
# 4. raise your `weights` of exercise 2, with $L = 1$ m, to `power`; multiply the weight of each
#    particle by that, and normalise;
# 5. note the weighted mean of the positions, and the positions themselves;
# 6. if $1 / \sum w^2 < M/2$, resample as in [chapter 04](../04_particle_filter.ipynb): the $k$-th
#    new particle, $k = 0, \ldots, M - 1$, is a copy of the first one at which the running sum of
#    the weights is larger than $(k + u)/M$. Then all weights are $1/M$.
#
# The picture drives it over the field, with 100 heights a picture: thirty particles, drawn at the
# start and at two later pictures (dots), and the robot there (stars). The numbers are mean errors
# over the second half of the way. It drives twice, with the power 0.1 and with 1, the likelihood
# as it was derived. **Bet first**: which of the two is nearer to the truth? And is the other one
# at least better than the odometry, which trusts its first guess and measures no ground at all?


# %% tags=["exercise"]
def localize(
    poses: Array,
    moves: Array,
    points: Array,
    heights: Array,
    maps: Array,
    march: Array,
    u: Array,
    power: float,
) -> Any:
    """Find the way of a robot on a map of roughness.

    Parameters
    ----------
    poses : ndarray, shape (M, 3)
        Particles at the start: x, y (m) and heading (rad).
    moves : ndarray, shape (T, M, 3)
        Motion of each particle before each picture, with its noise, in the frame of
        the particle.
    points : ndarray, shape (T, n, 2)
        Where each picture shows heights, in the frame of the robot (m).
    heights : ndarray, shape (T, n)
        The heights (m).
    maps : ndarray, shape (2, m, rows, columns)
        Alpha and beta of m robots; all points fall on their field.
    march : ndarray, shape (2, rows, columns)
        Alpha and beta of March, with which all robots began.
    u : ndarray, shape (T,)
        Offset of the resampling at each picture, in [0, 1).
    power : float
        Exponent of `weights`.

    Returns
    -------
    track : ndarray, shape (T, 2)
        Weighted mean of the positions at each picture, before resampling (m).
    clouds : ndarray, shape (T, M, 2)
        The positions of all particles at the same moments (m).
    """
    alpha, beta = merged(*maps, *march)
    M, columns = len(poses), alpha.shape[1]
    alphas, betas = np.tile(alpha.ravel(), (M, 1)), np.tile(beta.ravel(), (M, 1))
    w, track, clouds = np.full(M, 1 / M), [], []
    for move, at, z, start in zip(moves, points, heights, u):
        poses = compose(poses, move)
        column, row = np.floor(transform(poses, at) / 0.5).astype(int).T
        cells = (row * columns + column).T
        w = w * weights(alphas, betas, cells, z, 1.0) ** power
        w = w / w.sum()
        track.append(w @ poses[:, :2])
        clouds.append(poses[:, :2])
        if 1 / np.sum(w**2) < M / 2:
            marks = (np.arange(M) + start) / M
            poses = poses[np.searchsorted(np.cumsum(w), marks, side="right")]
            w = np.full(M, 1 / M)
    return np.array(track), np.array(clouds)


# %% active="ipynb" tags=["try"]
# cells = 0.01 * np.arange(1.0, 33.0).reshape(4, 8)
# localize(
#     np.array([[1.0, 1.0, 0.0], [1.5, 1.0, 0.0]]),
#     np.zeros((1, 2, 3)),
#     np.array([[[1.1, 0.2], [1.2, 0.3], [1.3, 0.2]]]),
#     np.array([[0.01, 0.20, -0.10]]),
#     np.array([[np.full((4, 8), 5.0)], [cells]]),
#     np.array([np.full((4, 8), 2.0), 0.4 * cells]),
#     np.array([0.5]),
#     0.1,
# )

# %% [markdown] tags=["hint"]
# `maps[0]` are the alphas of all robots, `maps[1]` their betas, and sums over robots run over axis
# 0: does your `merged` care whether cells are in one row or in several?

# %% [markdown] tags=["hint"]
# `weights` wants a map for each particle, shape (M, C), and one number for each cell. Number the
# cells row by row, as `ravel` does, and repeat the one map with `np.tile`. How many cells are
# before row $r$? Column and row are the two numbers in the last axis of `transform(...) / 0.5`,
# rounded down.

# %% [markdown] tags=["hint"]
# Weights are carried from picture to picture until they are made equal by resampling. Which of the
# two, the old weight or the new factor, gets the power?


# %% tags=["cases"]
def _a_way(rng: np.random.Generator) -> Any:
    M, T, n = 6, 5, 24
    poses = rng.uniform([2.5, 2.5, -3.0], [4.0, 4.0, 3.0], (M, 3))
    poses[:2, 2] = -3.1, 3.1
    moves = rng.normal(0.0, [0.3, 0.1, 0.3], (T, M, 3))
    points = rng.uniform([0.4, -0.6], [1.2, 0.6], (T, n, 2))
    heights = rng.normal(0.0, rng.choice([0.02, 0.2], (T, 1)), (T, n))
    rough, m = rng.uniform(0.02, 0.25, (14, 15)) ** 2, int(rng.integers(1, 4))
    begin = rng.integers(2, 8, (14, 15)) / 2
    more = rng.integers(0, 12, (m, 14, 15)) / 2
    march = np.array([begin, begin * rough])
    maps = np.array([begin + more, begin * rough + more * rough * rng.uniform(0.5, 2, more.shape)])
    u = rng.uniform(0.02, 0.98, T)
    return poses, moves, points, heights, maps, march, u, float(rng.choice([0.1, 0.3, 0.5]))


def _a_row(rng: np.random.Generator, M: int, T: int, n: int) -> Any:
    """Give particles in a row of cells of 0.5 m, heights in the cell of each, and a map."""
    poses = np.append(rng.uniform(0.15, 0.35, (M, 2)), np.zeros((M, 1)), axis=1)
    poses[:, 0] += 0.5 * np.arange(M)
    moves = np.append(rng.uniform(-0.05, 0.05, (T, M, 2)), np.zeros((T, M, 1)), axis=2)
    moves[0] = 0.0
    at = rng.uniform(-0.04, 0.04, (T, n, 2))
    z = 0.1 * np.tile(np.linspace(-1.0, 1.0, n), (T, 1)) if n > 1 else np.ones((T, 1))
    return poses, moves, at, z


def _alone(rng: np.random.Generator) -> Any:
    march = np.array([rng.uniform(1, 9, (1, 5)), rng.uniform(0.01, 0.1, (1, 5))])
    maps = march[:, None] + rng.uniform(0, 1, (2, 2, 1, 5))
    return *_a_row(rng, 5, 3, 1), maps, march, rng.random(3), 0.1


def _alike(rng: np.random.Generator, fit: int) -> Any:
    """Give eight particles: some stand on cells that fit, all alike, the others on glass."""
    fits = np.zeros(8, bool)
    fits[rng.choice(np.arange(1, 8), fit, replace=False)] = True
    march = np.array([np.where(fits, 3.0, 500.0), np.where(fits, 0.03, 0.0005)])[:, None]
    maps = march[:, None] + np.array([1.0, 0.01])[:, None, None, None] * fits
    return *_a_row(rng, 8, 2, 12), maps, march, np.zeros(2), 0.1


@lru_cache(maxsize=1)
def _field(seed: int = 8) -> Any:
    """Give a drive in June and what particles need for it, the truth, and the odometry."""
    from slamlab.worlds import Terrain

    rng, M, n = np.random.default_rng(seed), 30, 100
    terrain = Terrain.rough(rng, (20.0, 20.0))

    def drive(laps: float) -> Any:
        """Give poses on a circle of 4 m, and what pictures show; the rig bounces and leans."""
        turn = np.arange(0, 2 * np.pi * laps, 0.125)
        way = np.stack([10 + 4 * np.sin(turn), 10 - 4 * np.cos(turn), turn], -1)
        ahead = np.sqrt(rng.uniform(1, 9, (len(way), n)))
        side = rng.uniform(-1.2, 1.2, (len(way), n))
        at = ahead[..., None] * np.stack([np.cos(side), np.sin(side)], -1)
        lift, pitch, roll = rng.normal(0, [0.05, 0.0175, 0.0175], (len(way), 3)).T[..., None]
        z = terrain.height(transform(way, at)) + lift + pitch * at[..., 0] + roll * at[..., 1]
        return way, at, z

    sums = np.zeros((2, 5, 1600))
    for alpha, beta in sums.swapaxes(0, 1):  # a lap in March, four in May, at surveyed poses
        for pose, at, z in zip(*drive(1.0), strict=True):
            column, row = np.floor(transform(pose, at) / 0.5).astype(int).T
            count, total, squares = (
                np.bincount(40 * row + column, values, 1600) for values in (None, z, z**2)
            )
            alpha += np.maximum(count - 1, 0) / 2
            beta += np.maximum(squares - total**2 / np.maximum(count, 1), 0) / 2
    added = sums.reshape(2, 5, 40, 40)
    march = added[:, 0] + np.array([1.0, 1e-3])[:, None, None]
    truth, points, heights = drive(0.6)
    c, s = np.cos(truth[:-1, 2]), np.sin(truth[:-1, 2])
    (dx, dy, turn), noise = np.diff(truth, axis=0).T, [0.013, 0.013, 0.02]
    odometry = np.stack([c * dx + s * dy, c * dy - s * dx, turn], -1)
    odometry = odometry + rng.normal(0, noise, odometry.shape)
    driven = [truth[0] + [0.5, -0.4, 0.1]]
    poses = driven[0] + rng.normal(0, [0.4, 0.4, 0.1], (M, 3))
    moves = np.zeros((len(truth), M, 3))
    moves[1:] = odometry[:, None] + rng.normal(0, noise, (len(odometry), M, 3))
    for step in odometry:
        driven.append(compose(driven[-1], step))
    maps = march[:, None] + added[:, 1:]
    given = poses, moves, points, heights, maps, march, rng.random(len(truth))
    return given, truth[:, :2], np.array(driven)[:, :2]


def _both(function: Any) -> Any:
    """Give track and clouds with the power 0.1, and the track with the power 1."""
    given, *_ = _field()
    track, clouds = (np.asarray(part, float) for part in function(*given, 0.1))
    return track, clouds, np.asarray(function(*given, 1.0)[0], float)


@lru_cache(maxsize=1)
def _as_it_should_be() -> Any:
    return _both(localize)


def _localize_drawn(ax: Any, function: Any) -> None:
    """Draw the map, the true way, the odometry, and the tracks and particles that are found."""
    from slamlab import plots

    given, truth, driven = _field()
    track, clouds, sharp = _both(function) if function is not localize else _as_it_should_be()
    late = len(truth) // 2
    astray, odometry, error = (
        np.hypot(*(way - truth).T)[late:].mean() for way in (sharp, driven, track)
    )
    alpha, beta = merged(*given[4], *given[5])
    rough = np.where(alpha > 1, 100 * np.sqrt(beta / alpha), np.nan)
    shades: dict[str, Any] = {"cmap": "Greys", "vmin": 0, "vmax": 12, "alpha": 0.7}
    ax.imshow(rough, origin="lower", extent=(0, 20, 0, 20), **shades)
    plots.path(ax, truth, "truth", "truth")
    plots.path(ax, driven, "dead_reckoning", f"odometry\n({odometry:.2f} m)")
    plots.path(ax, sharp, "wrong", "power 1")
    plots.path(ax, track, "estimate", "power 0.1")
    for k in (0, 8, len(truth) - 1):
        ax.plot(*clouds[k].T, ".", color=plots.COLOURS["estimate"], ms=5, mew=0, alpha=0.8)
        ax.plot(*truth[k], "k*", mfc="white", ms=8)
    bar = ax.inset_axes((0.04, 0.88, 0.26, 0.03))
    bar.imshow(np.linspace(0, 12, 64)[None], aspect="auto", extent=(0, 12, 0, 1), **shades)
    bar.set(yticks=[], xticks=[0, 4, 8, 12])
    bar.tick_params(labelsize=7, length=2, pad=1)
    bar.grid(False)
    bar.set_title("roughness (cm)", fontsize=7, loc="left", pad=2, fontweight="normal")
    ax.set_title(f"{error:.2f} m off; power 1: {astray:.2f} m")
    ax.legend(fontsize=7, loc="center", handlelength=1.4, bbox_to_anchor=(0.47, 0.48))
    ax.grid(False)
    ax.set(xlim=(3.3, 16.7), ylim=(3.3, 17.5), xlabel="x (m)", ylabel="y (m)", aspect="equal")


_ONE_PICTURE: tuple[Any, ...] = (
    [[1.0, 1.0, 0.0], [1.5, 1.0, 0.0]],
    np.zeros((1, 2, 3)),
    [[[1.1, 0.2], [1.2, 0.3], [1.3, 0.2]]],
    [[0.01, 0.20, -0.10]],
    [[np.full((4, 8), 5.0)], [0.01 * np.arange(1.0, 33.0).reshape(4, 8)]],
    [np.full((4, 8), 2.0), 0.004 * np.arange(1.0, 33.0).reshape(4, 8)],
    [0.5],
    0.1,
)

check_localize = Check(
    localize,
    "track, clouds",
    {
        "one picture, two particles, the map of one robot": _ONE_PICTURE,
        "pictures of one height: no weight changes, particles only move": _alone,
        "two of eight particles fit, exactly alike": lambda rng: _alike(rng, 2),
        "half of the particles fit: no resampling yet": lambda rng: _alike(rng, 4),
        "any ground, any way, the maps of some robots": _a_way,
    },
    tolerance=1e-7,
    draws=8,
    picture=_localize_drawn,
)

# %% tags=["mistakes"]
check_localize.mistakes = {
    "motion is in the frame of each particle: compose, do not add": (
        "compose(poses, move) => poses + move"
    ),
    "the power has no effect: `weights` as they are are too sharp": " ** power => ",
    "the power belongs to the new factor, not to the weights carried so far": (
        "w * weights(alphas, betas, cells, z, 1.0) ** power"
        " => (w * weights(alphas, betas, cells, z, 1.0)) ** power"
    ),
    "weights are carried from picture to picture: multiply the old ones": (
        "w = w * weights( => w = weights("
    ),
    "this is the map of the first robot alone": (
        "merged(*maps, *march) => (maps[0, 0], maps[1, 0])"
    ),
    "this is the map of March: what the robots saw in May is lost": (
        "merged(*maps, *march) => march"
    ),
    "March is counted once for every robot: merge the maps with `merged`": (
        "merged(*maps, *march) => maps.sum(axis=1)"
    ),
    "row and column are exchanged: x counts columns": "column, row = => row, column =",
    "a row has as many cells as there are columns": "alpha.shape[1] => alpha.shape[0]",
    "a cell begins at its lower border: floor, do not round": "np.floor => np.round",
    "resampled particles weigh alike: 1/M": "            w = np.full(M, 1 / M)\n => ",
    "resample only when few particles carry the weight: 1 / sum w^2 < M/2": (
        "if 1 / np.sum(w**2) < M / 2 => if True"
    ),
    "at 1 / sum w^2 = M/2 nothing is resampled": (
        "1 / np.sum(w**2) < M / 2 => 1 / np.sum(w**2) <= M / 2 * (1 + 1e-9)"
    ),
    "particles are never resampled": "if 1 / np.sum(w**2) < M / 2 => if False",
    "the first at which the running sum is larger than the mark, not as large": "right => left",
    "the mean is weighted": "w @ poses[:, :2] => poses[:, :2].mean(axis=0)",
    "mean and positions are noted before resampling, with the weights of this picture": (
        lambda *given: _noted_late(*given)
    ),
    "particles are moved before the heights are sorted": (
        "        poses = compose(poses, move)\n => ",
        "track.append(w @ poses[:, :2])"
        " => poses = compose(poses, move); track.append(w @ poses[:, :2])",
    ),
    "resampling begins at u / M, not at 0": "np.arange(M) + start => np.arange(M)",
}


def _noted_late(*given: Any) -> Any:
    """Return the track and the particles that are noted after resampling."""
    poses, moves, points, heights, maps, march, u, power = given
    alpha, beta = merged(*maps, *march)
    M, columns = len(poses), alpha.shape[1]
    alphas, betas = np.tile(alpha.ravel(), (M, 1)), np.tile(beta.ravel(), (M, 1))
    w, track, clouds = np.full(M, 1 / M), [], []
    for move, at, z, start in zip(moves, points, heights, u, strict=True):
        poses = compose(poses, move)
        column, row = np.floor(transform(poses, at) / 0.5).astype(int).T
        w = w * weights(alphas, betas, (row * columns + column).T, z, 1.0) ** power
        w = w / w.sum()
        if 1 / np.sum(w**2) < M / 2:
            marks = (np.arange(M) + start) / M
            poses = poses[np.searchsorted(np.cumsum(w), marks, side="right")]
            w = np.full(M, 1 / M)
        track.append(w @ poses[:, :2])
        clouds.append(poses[:, :2])
    return np.array(track), np.array(clouds)


# %% [markdown] tags=["solution"]
# ## Solution 6: a robot finds its place on rough ground

# %% [markdown] tags=["solution"]
# Nothing but roughness is compared, and with the power 0.1 the second half of the track is on the
# true way. The bet: on this drive the likelihood as derived ends *further* off than the odometry.
# Other drives end otherwise, some with power 1 on the true way: one drive shows what can happen,
# not how often. How it happens, the weights of the first picture tell, printed below: with power 1
# one particle of thirty has nearly all the weight, right or wrong, and after resampling its copies
# are nearly all that is left. With 0.1 many go on until later pictures tell more.
#
# And a wrong way with its price: no resampling. The thirty particles go on as they began:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: the map, the true way, the odometry, and the tracks and particles that are found; on the left without resampling the track leaves the way."}}
# def never_resampled(poses, moves, points, heights, maps, march, u, power):
#     alpha, beta = merged(*maps, *march)
#     M, columns = len(poses), alpha.shape[1]
#     alphas, betas = np.tile(alpha.ravel(), (M, 1)), np.tile(beta.ravel(), (M, 1))
#     w, track, clouds = np.full(M, 1 / M), [], []
#     for move, at, z in zip(moves, points, heights):
#         poses = compose(poses, move)
#         column, row = np.floor(transform(poses, at) / 0.5).astype(int).T
#         w = w * weights(alphas, betas, (row * columns + column).T, z, 1.0) ** power
#         w = w / w.sum()
#         if not track:
#             print(f"power {power}: the heaviest of {M} has {w.max():.2f} of the weight")
#         track.append(w @ poses[:, :2])
#         clouds.append(poses[:, :2])
#     return np.array(track), np.array(clouds)
#
# check_localize.draw(never_resampled)

# %% [markdown] tags=["statement"]
# **What you have now**: a localisation that needs no wall, no landmark and no satellite, on a map
# that four robots made together. Give each particle a map of its own, which grows by $\nu/2$ and
# $S/2$ after step 4 and is copied with its particle in step 6, and it is Gamma-SLAM.

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 15](../solutions/15_other_maps.ipynb).
