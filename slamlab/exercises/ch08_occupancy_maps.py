"""Exercises, chapter 08: reports fused as odds, the evidence of one beam, the entropy of a map.

P5, chapter 3.2.4, draws dots only; the rest is Moravec and Elfes.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn
from slamlab.exercises._report import Array, Check
from slamlab.geometry import wrap_angle

__all__ = [
    "check_beam_evidence",
    "check_fuse",
    "check_hits_needed",
    "check_insert",
    "check_map_entropy",
]


# %% [markdown] tags=["chapter"]
# # Exercises 08: occupancy maps
#
# Five exercises, from one cell to a corridor of a real building; the chapter is [Occupancy
# maps](../08_occupancy_maps.ipynb). Replace each `...` and run the check below it as often as you
# like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 08: occupancy maps
#
# The exercises are in [Exercises 08](../exercises/08_occupancy_maps.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
# from scipy.special import expit
#
# import matplotlib.pyplot as plt
# from slamlab import plots
# from slamlab.datasets import killian
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: reports about one cell
#
# In a warehouse one cell of floor in five is occupied: the prior is 0.2, not one half. Robots send
# what they have seen of a cell, each as a probability: *given my one reading, and that prior, the
# cell is occupied with 0.6*. The readings are independent given the cell. What is known after all
# of them?
#
# The lesson added log odds of readings whose prior was one half. Before you write, answer with a
# pencil: four robots all send 0.2. What does the map know now?


# %% tags=["exercise"]
def fuse(prior: float, reports: Array) -> float:
    """Probability that a cell is occupied after all reports.

    Parameters
    ----------
    prior : float
        Probability before any reading, between 0 and 1.
    reports : ndarray, shape (k,)
        p(m | z_i) for each reading; k may be 0.

    Returns
    -------
    float
        p(m | z_1, ..., z_k).
    """
    start = np.log(prior / (1 - prior))
    total = start + np.sum(np.log(reports / (1 - reports)) - start)
    return 1 / (1 + np.exp(-total))


# %% active="ipynb" tags=["try"]
# fuse(0.5, np.array([0.7, 0.7]))

# %% [markdown] tags=["hint"]
# What multiplies, probabilities or odds?

# %% [markdown] tags=["hint"]
# Each report holds the prior already. How often would it count if you left it in?

# %% [markdown] tags=["hint"]
# With `l(p) = np.log(p / (1 - p))` the answer has log odds `l(prior) + np.sum(l(reports) -
# l(prior))`; back by `1 / (1 + np.exp(-l))`.


# %% tags=["cases"]
def _some_reports(rng: np.random.Generator) -> Any:
    prior, k = rng.uniform(0.05, 0.95), int(rng.integers(1, 6))
    return np.round(prior, 2), np.round(rng.uniform(0.05, 0.95, k), 2)


def _fuse_drawn(ax: Any, function: Any) -> None:
    """Draw what is fused of six reports, and the share of occupied cells in 200 000 (line)."""
    from slamlab import plots

    rng = np.random.default_rng(1)
    occupied = rng.random(200_000) < 0.2
    hits = (rng.random((6, 200_000)) < np.where(occupied, 0.7, 0.3)).sum(axis=0)
    share = np.bincount(hits, occupied) / np.bincount(hits)
    hit, miss = 0.14 / (0.14 + 0.24), 0.06 / (0.06 + 0.56)
    fused = [float(function(0.2, np.array([hit] * k + [miss] * (6 - k)))) for k in range(7)]
    ax.plot(share, **plots.line_style("truth"))
    ax.plot(fused, "o", color=plots.COLOURS["estimate"], markersize=5)
    ax.set(xlabel="hits among six readings", ylabel="share of occupied cells", ylim=(0, 1))


check_fuse = Check(
    fuse,
    "p",
    {
        "without reports the prior stays": (0.2, []),
        "two hits make the map more certain than one": (0.5, [0.7, 0.7]),
        "hit and miss, with a prior of one half": (0.5, [0.7, 0.4, 0.4]),
        "a cell that is probably free": (0.2, [0.6, 0.6, 0.1]),
        "reports that say nothing new change nothing": (0.3, [0.3, 0.3, 0.3, 0.3]),
        "any prior, any reports": _some_reports,
    },
    tolerance=1e-8,
    picture=_fuse_drawn,
)

# %% tags=["mistakes"]
check_fuse.mistakes = {
    "the prior is in every report: take it out of each, or it counts again and again": (
        "(np.log(reports / (1 - reports)) - start) => (np.log(reports / (1 - reports)))"
    ),
    "the prior was taken out once only: it is in every report": (
        "start + np.sum(np.log(reports / (1 - reports)) - start)"
        " => np.sum(np.log(reports / (1 - reports)))"
    ),
    "the prior itself is missing: without any report it is the answer": "start +  => ",
    "the reports were averaged: agreeing reports must make the map more certain than each of them": (
        lambda p, h: np.mean([p, *h])
    ),
    "the log odds were averaged: evidence adds up": "start + np.sum( => start + np.mean(",
    "probabilities were multiplied: odds multiply": lambda p, h: p * np.prod(h),
    "only the last report counts here: the earlier ones are evidence too": (
        lambda p, h: h[-1] if len(h) else p
    ),
    "only the largest report counts here: all are evidence": (
        lambda p, h: h.max() if len(h) else p
    ),
    "these are log odds: return the probability": "1 / (1 + np.exp(-total)) => total",
    "these are odds: return the probability": "1 / (1 + np.exp(-total)) => np.exp(total)",
    "this is the probability that the cell is free": "np.exp(-total) => np.exp(total)",
    "p / (1 + p) is no odds: p / (1 - p)": "reports / (1 - reports) => reports / (1 + reports)",
}

# %% [markdown] tags=["solution"]
# ## Solution 1: reports about one cell
#
# Odds multiply, so log odds add. Every report contains the prior once; it is taken out of each,
# and put in once at the start.
#
# Four robots that all send 0.2, with the prior 0.2, say nothing new: 0.2 it stays. A sum
# that leaves the prior in each report would say 0.001.

# %% [markdown] tags=["solution"]
# Leave the prior in, and four reports that say nothing new make a cell freer and freer. With the
# prior one half it does not show:

# %% active="ipynb" tags=["solution"]
# def prior_everywhere(prior, reports):
#     total = np.log(prior / (1 - prior)) + np.sum(np.log(reports / (1 - reports)))
#     return 1 / (1 + np.exp(-total))
#
# check_fuse(prior_everywhere)

# %% [markdown] tags=["statement"]
# ## Exercise 2: a ring of walls, two bugs to find
#
# A robot maps a large hall with a lidar of short range. Wherever it stopped, its map has a ring of
# walls around that place; and it drives against a glass door that its map holds to be open floor.
# (Of the beams towards glass many are lost.)
#
# Here is its program for one beam. The robot stands at the left end of a row of cells of 1 m, cell
# i reaches from i to i + 1 metres, and the beam runs along the row. In front of walls of brick the
# program is right. Run the check, find the two bugs, repair them.


# %% tags=["exercise"]
def beam_evidence(
    n_cells: int, distance: float, max_range: float, hit: float, miss: float
) -> Array:
    """Log odds that one beam adds to a row of cells.

    Parameters
    ----------
    n_cells : int
        Number of cells in the row.
    distance : float
        The reading (m). `max_range` and more, inf included: the beam met nothing within
        `max_range`. NaN: the reading was lost.
    max_range : float
        Range of the lidar (m), a whole number here.
    hit, miss : float
        Log odds for the cell where a beam ended, and for one that it crossed.

    Returns
    -------
    ndarray, shape (n_cells,)
        Zero where the beam says nothing. The beam may end beyond the last cell.
    """
    evidence = np.zeros(n_cells)
    if np.isnan(distance):
        return evidence
    if distance >= max_range:
        evidence[: int(max_range)] = miss
        return evidence
    end = int(distance)
    evidence[:end] = miss
    evidence[end : end + 1] = hit  # an empty slice beyond the last cell
    return evidence


# %% active="ipynb" tags=["stub"]
#     evidence = np.zeros(n_cells)
#     reach = np.nanmin([distance, max_range])  # no beam is longer than the range
#     end = int(reach)
#     evidence[:end] = miss
#     evidence[end : end + 1] = hit  # an empty slice beyond the last cell
#     return evidence

# %% active="ipynb" tags=["try"]
# print(beam_evidence(6, 2.5, 5.0, 0.85, -0.41))
# print(beam_evidence(6, np.inf, 5.0, 0.85, -0.41))

# %% [markdown] tags=["hint"]
# What did the lidar of the second call above meet, and where does the program put a wall?

# %% [markdown] tags=["hint"]
# Three cases: the beam met something; it met nothing; the reading was lost. How many does the
# program tell apart, and what becomes of a NaN in its second line?


# %% tags=["cases"]
@drawn
def _row(rng: np.random.Generator, low: float, high: float) -> Any:
    """Draw a row of cells and a reading between two shares of its length, not on a border."""
    n = int(rng.integers(2, 12))
    distance = np.floor(rng.uniform(low, high) * n) + np.round(rng.uniform(0.05, 0.95), 2)
    hit, miss = np.round(rng.uniform(0.3, 2, 2), 2)
    return n, distance, float(rng.integers(2, 15)), hit, -miss


def _beam_drawn(ax: Any, function: Any) -> None:
    """Draw the evidence of ten beams, one a row: white is free, black a hit, grey unknown."""
    from slamlab import plots

    readings = [0.5, 2.5, 3.7, 6.2, 7.9, 8.0, 9.5, np.inf, np.nan, 5.1]
    rows = [np.asarray(function(12, d, 8.0, 2.2, -2.2), float) for d in readings]
    plots.occupancy(ax, 1 / (1 + np.exp(-np.array(rows))), [0, 12, -0.5, 9.5])
    for row, reading in enumerate(readings):
        ax.plot(reading, row, "|", color=plots.COLOURS["lidar"], markersize=9, mew=2)
    ax.set(xlabel="m (green: readings; range 8 m)", ylabel="beam")


check_beam_evidence = Check(
    beam_evidence,
    "evidence",
    {
        "a wall in the middle": (6, 2.5, 5, 0.85, -0.41),
        "a wall in the first cell": (4, 0.3, 5, 0.85, -0.41),
        "a wall in the last cell": (4, 3.7, 5, 0.85, -0.41),
        "a wall beyond the last cell": (3, 4.6, 8, 0.85, -0.41),
        "a beam that met nothing": (6, np.inf, 4, 0.85, -0.41),
        "a beam that met nothing and leaves the row": (3, np.inf, 9, 0.85, -0.41),
        "a reading of max_range met nothing": (6, 4.0, 4, 0.85, -0.41),
        "a reading beyond max_range": (6, 5.7, 3, 0.85, -0.41),
        "a lost reading": (5, np.nan, 4, 0.85, -0.41),
        "a single cell": (1, 0.5, 4, 0.85, -0.41),
        "any beam in any row": _row(0.0, 1.0),
        "any beam, beyond the row too": _row(0.0, 2.0),
    },
    picture=_beam_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_beam_evidence.mistakes = {
    "nothing was seen of what lies behind the wall: no evidence there": (
        "evidence[:end] = miss => evidence[:] = miss"
    ),
    "this is P5's dot: the beam also says that the cells before its end are free": (
        lambda n, d, m, hit, miss: beam_evidence(n, d, m, hit, 0.0)
    ),
    "only the hit counts here; a beam that met nothing frees its way, as one that met a wall "
    "frees the way to it": "evidence[:end] = miss => pass",
    "the cell where the beam ended is not free as well: it gets the hit alone": (
        "evidence[end : end + 1] = hit => evidence[end : end + 1] = hit + miss"
    ),
    "a beam that met nothing frees its way up to max_range": (
        "evidence[: int(max_range)] = miss => pass"
    ),
    "a beam that met nothing hit nothing: there is no wall at max_range": (
        lambda n, d, m, hit, miss: (
            beam_evidence(n, min(d, m), np.inf, hit, miss) if not np.isnan(d) else np.zeros(n)
        )
    ),
    "a beam that met nothing says nothing beyond max_range": (
        "evidence[: int(max_range)] => evidence[:]"
    ),
    "NaN is a lost reading: it says nothing, not even that the way is free": (
        lambda n, d, m, hit, miss: beam_evidence(n, np.inf if np.isnan(d) else d, m, hit, miss)
    ),
    "one cell too far: a beam of 2.5 m ends in cell number 2": (
        "end = int(distance) => end = int(distance) + 1"
    ),
    "the distance was rounded: a beam of 2.7 m ends in cell number 2": (
        "end = int(distance) => end = round(distance)"
    ),
    "the cell before the hit is free too": "[:end] = miss => [: max(end - 1, 0)] = miss",
    "the first cell is free too: the robot looks through it": (
        "evidence[:end] => evidence[1:end]"
    ),
    "a reading of exactly max_range met nothing": ">= => >",
    "hit and miss are exchanged": (lambda n, d, m, hit, miss: beam_evidence(n, d, m, miss, hit)),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: a ring of walls
#
# The range cut every longer reading down to a number that looks like any other, so a beam that met
# nothing ended in a wall. And `np.nanmin` leaves NaN out, so a lost reading became a beam of full
# length, which frees its way: through the glass.

# %% [markdown] tags=["solution"]
# If you repair the glass alone, the ring stays:

# %% active="ipynb" tags=["solution"]
# def ring_of_walls(n_cells, distance, max_range, hit, miss):
#     kept = distance if np.isnan(distance) else min(distance, max_range)
#     return beam_evidence(n_cells, kept, np.inf, hit, miss)
#
# check_beam_evidence(ring_of_walls)

# %% [markdown] tags=["statement"]
# ## Exercise 3: what a map does not know
#
# Two doors, and the robot has time for one. It would like to go where its map knows least. For one
# cell that is the **entropy** of its two states,
#
# $$
# -p \log_2 p - (1 - p) \log_2 (1 - p) \ \text{bits}, \qquad p = \frac{1}{1 + e^{-\ell}},
# $$
#
# and for a map the sum over its cells. With a pencil: how many bits are in a cell with $p$ = 1/2,
# and in one that is certain?
#
# The lesson kept log odds between limits. Here nobody did: maps come with log odds of 1000, and
# your sum must not become NaN. In its title the picture asks your function about the doors: behind
# A 120 cells are half explored, behind B 60 cells were never seen. Which do you take?


# %% tags=["exercise"]
def map_entropy(log_odds: Array) -> float:
    """Entropy of a map.

    Parameters
    ----------
    log_odds : ndarray, any shape
        ln(p / (1 - p)) of every cell; may be as large as 1000.

    Returns
    -------
    float
        Sum over all cells (bits).
    """
    size = np.abs(log_odds)
    # With q = p of the less likely state: -q ln q - (1 - q) ln(1 - q).
    unlikely = np.exp(-size) / (1 + np.exp(-size))
    return float(np.sum(np.log1p(np.exp(-size)) + size * unlikely) / np.log(2))


# %% active="ipynb" tags=["try"]
# map_entropy(np.zeros((2, 3)))

# %% [markdown] tags=["hint"]
# A cell has two states. Both belong into the sum.

# %% [markdown] tags=["hint"]
# For a cell that is certain one of the two terms is 0 log 0, which counts as 0.
# `scipy.special.xlogy(p, p)` knows that.


# %% tags=["cases"]
def _entropy_drawn(ax: Any, function: Any) -> None:
    """Draw the entropy of one cell against its probability, certain cells at both ends."""
    from slamlab import plots

    p = np.linspace(0.001, 0.999, 200)
    log_odds = np.array([-800.0, *np.linspace(-4, 4, 23), 800.0])
    bits = [float(function(np.array([[one]]))) for one in log_odds]
    ax.plot(p, -p * np.log2(p) - (1 - p) * np.log2(1 - p), **plots.line_style("truth"))
    found = 1 / (1 + np.exp(-np.clip(log_odds, -700, 700)))
    ax.plot(found, bits, "o", color=plots.COLOURS["estimate"], markersize=4)
    ax.set(xlabel="probability that the cell is occupied", ylabel="entropy (bits)")
    half_known = np.random.default_rng(2).choice([-3.5, -0.4, 0.85, 3.5], (10, 12))
    doors = float(function(half_known)), float(function(np.zeros((6, 10))))
    ax.set_title(f"A: {doors[0]:.0f} bits, B: {doors[1]:.0f} bits")


check_map_entropy = Check(
    map_entropy,
    "bits",
    {
        "an unknown map holds one bit a cell": (np.zeros((3, 4)),),
        "free and occupied count alike": ([[0.85, -0.85]],),
        "cells that are certain hold nothing": ([[800.0, -800.0, 0.0]],),
        "cells that are nearly certain": ([40.0, -40.0, 30.0],),
        "cells that are almost certain": ([12.0, -13.0, 14.0],),
        "a row of cells": lambda rng: (np.round(rng.normal(0, 3, rng.integers(1, 20)), 2),),
        "a map": lambda rng: (np.round(rng.normal(0, 2, rng.integers(1, 6, 2)), 2),),
        "a block of cells": lambda rng: (np.round(rng.normal(0, 2, (2, 3, 2)), 2),),
    },
    tolerance=1e-8,
    picture=_entropy_drawn,
)


# %% tags=["mistakes"]
def _sure(log_odds: Array) -> Any:
    return 1 / (1 + np.exp(-np.clip(log_odds, -700, 700)))


def _terms(p: Array) -> Any:
    p = np.clip(p, 1e-300, 1 - 1e-16)
    return -p * np.log2(p)


check_map_entropy.mistakes = {
    "0 log 0 is 0, not NaN: think of a cell that is certain": (
        lambda log: np.sum(
            -(1 / (1 + np.exp(-log))) * np.log2(1 / (1 + np.exp(-log)))
            - (1 - 1 / (1 + np.exp(-log))) * np.log2(1 - 1 / (1 + np.exp(-log)))
        )
    ),
    "these are nats: divide by ln 2 for bits": " / np.log(2) => ",
    "this is the mean of the cells: expected their sum": "np.sum( => np.mean(",
    "half is missing: free is a state too, -(1 - p) log(1 - p)": (
        lambda log: np.sum(_terms(_sure(log)))
    ),
    "half is missing: occupied is a state too, -p log p": (
        lambda log: np.sum(_terms(_sure(-log)))
    ),
    "the sign: entropy is not negative": lambda log: -map_entropy(log),
    "these were taken for probabilities: turn log odds into p first": (
        lambda log: np.sum(_terms(np.abs(log)) + _terms(1 - np.abs(log)))
    ),
    "this counts the unknown cells: a cell that is half known has some entropy left": (
        lambda log: float(np.sum(log == 0))
    ),
    "one value a cell was returned: expected their sum": (
        lambda log: [map_entropy(one) for one in log.ravel()]
    ),
    "these are decimal digits: divide by ln 2 for bits": "np.log(2) => np.log(10)",
}

# %% [markdown] tags=["solution"]
# ## Solution 3: what a map does not know
#
# Let $q$ be the probability of the less likely state, $q = e^{-|\ell|} / (1 + e^{-|\ell|})$. Then
# $-\ln (1 - q) = \ln(1 + e^{-|\ell|})$ and $-\ln q = |\ell| + \ln(1 + e^{-|\ell|})$, so the
# entropy is $\ln(1 + e^{-|\ell|}) + q\,|\ell|$ in natural units: nothing in it can overflow, and 0
# times the logarithm of 0 never stands there. `scipy.special.xlogy` does it as well.

# %% [markdown] tags=["solution"]
# The formula as it is written in books gives NaN for a single cell that is certain, and with it
# for the whole map:

# %% active="ipynb" tags=["solution"]
# def by_the_book(log_odds):
#     p = expit(np.asarray(log_odds))
#     with np.errstate(divide="ignore", invalid="ignore"):
#         return -np.sum(p * np.log2(p) + (1 - p) * np.log2(1 - p))
#
# check_map_entropy(by_the_book)

# %% [markdown] tags=["statement"]
# ## Exercise 4: how many hits? (pencil first)
#
# A sensor reports hits on a cell, each with $p(m \mid z) = p_{\mathrm{hit}}$; the prior is $p_0$.
# After how many hits in a row does the map believe the cell to be occupied with probability $g$
# or more? Set up the sum of log odds on paper, solve it for the number, and round it the right
# way. (Without the lesson's limit: a map that keeps its probabilities below 0.97 never believes
# more.)


# %% tags=["exercise"]
def hits_needed(p_hit: float, prior: float, goal: float) -> int:
    """Smallest number of hits after which p(m) >= goal.

    Parameters
    ----------
    p_hit : float
        p(m | z) of one hit, larger than the prior.
    prior, goal : float
        Probabilities in (0, 1).

    Returns
    -------
    int
        0 if the prior is enough.
    """
    start, step, end = (np.log(p / (1 - p)) for p in (prior, p_hit, goal))
    return max(0, int(np.ceil((end - start) / (step - start))))


# %% active="ipynb" tags=["try"]
# hits_needed(0.7, 0.5, 0.99)

# %% [markdown] tags=["hint"]
# After $k$ hits the log odds are $l_0 + k\,(l_{\mathrm{hit}} - l_0)$.

# %% [markdown] tags=["hint"]
# For which real number $k$ do they equal the log odds of the goal? Which whole numbers are enough?


# %% tags=["cases"]
def _goal(rng: np.random.Generator) -> Any:
    prior = float(np.round(rng.uniform(0.1, 0.5), 3))
    p_hit = float(np.round(rng.uniform(prior + 0.05, 0.95), 3))
    return p_hit, prior, float(np.round(rng.uniform(0.55, 0.999), 4))


def _hits_drawn(ax: Any, function: Any) -> None:
    """Draw a cell's probability after each hit, and at each goal the hits that reach it."""
    from slamlab import plots

    n, goals = np.arange(11), np.linspace(0.05, 0.99, 30)
    odds = (0.2 / 0.8) * (1.5 / 0.25) ** (n / 2)
    ax.plot(n, odds / (1 + odds), "o-", color=plots.COLOURS["truth"], markersize=3, lw=1)
    p_hit = odds[1] / (1 + odds[1])
    hits = [float(function(p_hit, 0.2, goal)) for goal in goals]
    ax.plot(hits, goals, "+", color=plots.COLOURS["estimate"], markersize=7)
    ax.set(xlabel="hits", ylabel="probability (line), goal (crosses)")


check_hits_needed = Check(
    hits_needed,
    "hits",
    {
        "a prior of one half, hits of 0.7, sure to 0.99": (0.7, 0.5, 0.99),
        "one hit is enough": (0.9, 0.5, 0.85),
        "a floor that is mostly free": (0.6, 0.1, 0.9),
        "sure enough before the first": (0.7, 0.5, 0.2),
        "exactly the goal is enough": (0.75, 0.5, 0.75),
        "any sensor": _goal,
    },
    picture=_hits_drawn,
)

# %% tags=["mistakes"]
check_hits_needed.mistakes = {
    "one hit too many where the goal is reached exactly": (
        "int(np.ceil((end - start) / (step - start)))"
        " => int(np.floor((end - start) / (step - start) + 1e-12)) + 1"
    ),
    "rounded down: after so many hits the map is not sure yet": "np.ceil => np.floor",
    "rounded to the nearest: after so many hits the map may not be sure yet": (
        "np.ceil => np.round"
    ),
    "each hit adds log odds of p_hit less those of the prior": "(step - start) => step",
    "the map does not begin at zero: it begins at the prior": "(end - start) => end",
    "the prior was taken for one half": (
        "for p in (prior, p_hit, goal) => for p in (0.5, p_hit, goal)"
    ),
    "probabilities were multiplied: hits multiply odds": (
        lambda p_hit, prior, goal: max(0, int(np.ceil(np.log(1 - goal) / np.log(1 - p_hit))))
    ),
    "probabilities were added: hits add log odds": "np.log(p / (1 - p)) => p",
    "a negative number of hits: a map that is sure enough needs none": ("max(0,  => max(-99, "),
    "at least one hit was asked for: a map that is sure enough needs none": ("max(0,  => max(1, "),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: how many hits
#
# $l_0 + k\,(l_{\mathrm{hit}} - l_0) \ge l_g$, so $k$ is the quotient, rounded up, and never
# negative.

# %% [markdown] tags=["solution"]
# With the prior left in every hit too many of them are needed where the floor is mostly free:

# %% active="ipynb" tags=["solution"]
# def prior_in_every_hit(p_hit, prior, goal):
#     start, step, end = (np.log(p / (1 - p)) for p in (prior, p_hit, goal))
#     return max(0, int(np.ceil((end - start) / step)))
#
# check_hits_needed(prior_in_every_hit)

# %% [markdown] tags=["statement"]
# ## Exercise 5: a building from the cells' side
#
# The lesson went along each beam and asked which cells it crosses. Now turn it round: go to each
# *cell* and ask which beam passes. There is no loop left, and the map of a building is yours.
#
# For every cell: in which direction does its centre lie, seen from the lidar, and which beam
# points nearest to that direction? If none points within `spread / 2` of it, the cell is outside
# the field of view, and nothing is added. Else, if the centre is nearer than the end of that beam
# by more than half a cell, the beam passed through: add `miss`. If the centre lies within half a
# cell of the end, add `hit`. Behind that nothing was seen. A beam of `max_range` or more met
# nothing, and frees the cells whose centre is nearer than `max_range`. NaN says nothing at all.
#
# The picture runs your function on a real log: scans of MIT Killian Court
# ([Bosse et al., 2004](../../book/bibliography.md#bosse2004simultaneous)), the beginning of the
# drive, from dead reckoning that is still good there. Its lidar sees half of the circle: if
# you forget that, you map what the robot never saw. And look at the specks of floor beyond the
# wall on the right: which beams have made them, and what may stand there?


# %% tags=["exercise"]
def insert(
    log_odds: Array,
    pose: Array,
    ranges: Array,
    angles: Array,
    spread: float,
    cell: float,
    max_range: float,
    hit: float,
    miss: float,
) -> Array:
    """Log odds of a grid after a scan.

    Parameters
    ----------
    log_odds : ndarray, shape (rows, columns)
        Cell (0, 0) has its lower left corner at the origin; rows go up.
    pose : ndarray, shape (3,)
        Of the lidar (m, m, rad).
    ranges, angles : ndarray, shape (n,)
        Ranges (m), inf where a beam met nothing, NaN where it was lost, and
        directions of the beams seen from the lidar (rad).
    spread : float
        Angle between neighbouring beams (rad).
    cell : float
        Side of a cell (m).
    max_range : float
        How far the lidar sees (m).
    hit, miss : float
        What is added to the log odds.

    Returns
    -------
    ndarray, shape (rows, columns)
    """
    rows, columns = log_odds.shape
    dx = (np.arange(columns) + 0.5) * cell - pose[0]
    dy = ((np.arange(rows) + 0.5) * cell - pose[1])[:, None]
    distance = np.hypot(dx, dy)
    direction = np.arctan2(dy, dx) - pose[2]
    off = np.abs(wrap_angle(direction[..., None] - angles))
    end = np.where(ranges >= max_range, np.inf, ranges)[off.argmin(axis=-1)]
    end[off.min(axis=-1) > spread / 2] = np.nan  # outside the field of view
    new = log_odds.copy()
    new[distance < np.minimum(end - cell / 2, max_range)] += miss
    new[np.abs(distance - end) <= cell / 2] += hit
    return new


# %% active="ipynb" tags=["try"]
# insert(np.zeros((1, 4)), np.array([0.1, 0.5, 0.0]), np.array([2.4]), np.array([0.0]),
#        0.1, 1.0, 9.0, 0.8, -0.4)

# %% [markdown] tags=["hint"]
# `np.arange(columns) + 0.5` are the centres of the columns, in cells.

# %% [markdown] tags=["hint"]
# A difference of angles has to be wrapped before its size says which beam is nearest.

# %% [markdown] tags=["hint"]
# Make arrays of the shape of the grid: distance, direction, number of the nearest beam, end of
# that beam. Comparisons with NaN are False, which is what you want for a lost beam, and for a cell
# that no beam points to.


# %% tags=["cases"]
@drawn
def _scanned(
    rng: np.random.Generator,
    rows: int,
    columns: int,
    heading: float = 0.0,
    cell: float = 0.25,
    max_range: float = 3.0,
    view: float = 2 * np.pi,
) -> Any:
    n = int(rng.integers(5, 12))
    angles = np.linspace(-view / 2, view / 2, n, endpoint=False)
    ranges = np.round(rng.uniform(0.6, 4, n), 2)
    ranges[rng.integers(0, n)], ranges[rng.integers(0, n)] = np.inf, np.nan
    pose = [*np.round(rng.uniform(0.2, 1.8, 2), 2), heading + np.round(rng.normal(), 2)]
    before = np.round(rng.normal(0, 0.5, (rows, columns)), 1)
    hit, miss = np.round(rng.uniform([0.5, -0.6], [1.2, -0.2]), 2)
    return before, pose, ranges, angles, view / n, cell, max_range, hit, miss


@cache
def _corridor() -> tuple[Array, Array, Array]:
    """Return poses (15, 3), beam angles (90,) and ranges (15, 90) in a corridor of the court."""
    from slamlab.datasets import killian

    court = killian()
    assert court.log.scan is not None
    assert court.log.ranges is not None
    poses, ranges = court.dead_reckoned()[:60:4], court.log.ranges[:60:4, ::2].astype(float)
    return poses - [*(poses[:, :2].min(0) - 5.0), 0.0], court.log.scan.beam_angles[::2], ranges


def _insert_drawn(ax: Any, function: Any) -> None:
    """Draw the map of a corridor of Killian Court after fifteen scans, and the robot's path."""
    from slamlab import plots

    poses, angles, scans = _corridor()
    columns, rows = np.ceil((poses[:, :2].max(0) + 5.0) / 0.3).astype(int)
    log_odds = np.zeros((rows, columns))
    for pose, ranges in zip(poses, scans, strict=True):
        given = ranges, angles, np.deg2rad(2.0), 0.3, 5.5, 0.85, -0.4
        log_odds = np.asarray(function(log_odds, pose, *given), float)
    plots.occupancy(ax, 1 / (1 + np.exp(-log_odds)), [0, 0.3 * columns, 0, 0.3 * rows])
    plots.path(ax, poses)
    plots.floor(ax)


check_insert = Check(
    insert,
    "log_odds",
    {
        "one beam along a row": (
            np.zeros((1, 8)),
            [0.1, 0.5, 0],
            [4.5],
            [0.0],
            3.0,
            1.0,
            9.0,
            0.8,
            -0.4,
        ),
        "a beam that met nothing frees up to the reach": (
            np.zeros((1, 8)),
            [0.1, 0.5, 0],
            [np.inf],
            [0.0],
            3.0,
            1.0,
            5.0,
            0.8,
            -0.4,
        ),
        "a beam of exactly the reach met nothing": (
            np.zeros((1, 8)),
            [0.1, 0.5, 0],
            [5.0],
            [0.0],
            3.0,
            1.0,
            5.0,
            0.8,
            -0.4,
        ),
        "a wall nearer than half a cell": (
            np.zeros((1, 4)),
            [0.1, 0.5, 0],
            [0.05],
            [0.0],
            3.0,
            1.0,
            5.0,
            0.8,
            -0.4,
        ),
        "a lost beam says nothing": (
            np.full((2, 4), 0.3),
            [0.1, 0.5, 0],
            [np.nan],
            [0.0],
            3.0,
            1.0,
            5.0,
            0.8,
            -0.4,
        ),
        "a lidar that sees ahead only": (
            np.full((3, 4), 0.3),
            [2.0, 1.5, 0],
            [1.4, 1.6, np.inf],
            [-0.5, 0.0, 0.5],
            0.5,
            1.0,
            5.0,
            0.8,
            -0.4,
        ),
        "a room, wide": _scanned(6, 12, cell=0.2),
        "a room, high": _scanned(12, 6),
        "a robot that looks back": _scanned(8, 8, np.pi),
        "a lidar that sees less far than the room is wide": _scanned(
            8, 9, max_range=1.2, view=4.0
        ),
    },
    picture=_insert_drawn,
)

# %% tags=["mistakes"]
check_insert.mistakes = {
    "rows go up: row 0 is at the bottom": (
        lambda log_odds, *given: insert(log_odds[::-1], *given)[::-1]
    ),
    "a beam that met nothing frees up to the reach itself, not half a cell less": (
        "np.minimum(end - cell / 2, max_range) => np.minimum(end, max_range) - cell / 2"
    ),
    "what was known before was forgotten: evidence adds to the old log odds": (
        "new = log_odds.copy() => new = np.zeros_like(log_odds)"
    ),
    "nothing was freed: cells before the end were looked through": "] += miss => ] += 0.0",
    "nothing was hit: the cell at the end is occupied": "] += hit => ] += 0.0",
    "hit and miss are exchanged": (
        "] += miss => ] += hit",
        "cell / 2] += hit => cell / 2] += miss",
    ),
    "cells behind the end were freed: nobody has seen them": (
        "distance < np.minimum(end - cell / 2, max_range)"
        " => (distance < max_range) & (np.abs(distance - end) > cell / 2)"
    ),
    "the heading was forgotten: beams turn with the robot": (
        "np.arctan2(dy, dx) - pose[2] => np.arctan2(dy, dx)"
    ),
    "the heading was added: the direction of a cell is seen from the robot": (
        "np.arctan2(dy, dx) - pose[2] => np.arctan2(dy, dx) + pose[2]"
    ),
    "the nearest beam was looked for without a wrap": (
        "np.abs(wrap_angle(direction[..., None] - angles))"
        " => np.abs(direction[..., None] - angles)"
    ),
    "what no beam points to was mapped too: the lidar sees a part of the circle": (
        "off.min(axis=-1) > spread / 2 => off.min(axis=-1) > 4.0"
    ),
    "a beam serves half of the gap to its neighbour on either side: spread / 2": (
        "> spread / 2 => > spread"
    ),
    "the corners of cells were used: their centres are half a cell on": (
        "(np.arange(columns) + 0.5) * cell => np.arange(columns) * cell",
        "((np.arange(rows) + 0.5) * cell => (np.arange(rows) * cell",
    ),
    "rows and columns are exchanged: rows go up, y": (
        "dx = (np.arange(columns) + 0.5) * cell - pose[0]"
        " => dx = ((np.arange(rows) + 0.5) * cell - pose[0])[:, None]",
        "dy = ((np.arange(rows) + 0.5) * cell - pose[1])[:, None]"
        " => dy = (np.arange(columns) + 0.5) * cell - pose[1]",
    ),
    "a beam that met nothing was left out: it frees everything up to its reach": (
        "np.where(ranges >= max_range, np.inf, ranges)"
        " => np.where(ranges >= max_range, np.nan, ranges)"
    ),
    "a beam that met nothing freed without end: the lidar sees no farther than its reach": (
        "np.minimum(end - cell / 2, max_range) => (end - cell / 2)"
    ),
    "the map was overwritten: evidence adds up": (
        "] += miss => ] = miss",
        "cell / 2] += hit => cell / 2] = hit",
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: a building from the cells' side
#
# Arrays of the shape of the grid, and two comparisons. What to notice: the wrap, and that NaN, a
# lost beam or none at all, needs no case of its own: no comparison with it holds.

# %% [markdown] tags=["solution"]
# The specks beyond the wall on the right: four of the scans have beams in that direction that
# return from far behind the wall, or not at all:

# %% active="ipynb" tags=["solution"]
# court = killian()
# poses, angles = court.dead_reckoned()[:60:4], court.log.scan.beam_angles
# for k in (1, 2, 3, 4):
#     x, y, heading = poses[k] - [*(poses[:, :2].min(0) - 5.0), 0.0]
#     ranges = court.log.ranges[4 * k].astype(float)
#     east = x + np.minimum(ranges, 5.5) * np.cos(heading + angles)
#     north = y + np.minimum(ranges, 5.5) * np.sin(heading + angles)
#     far = ranges[(east > 26.5) & (north < 11) & (ranges > 5.5)]
#     print(f"scan {k}: {len(far)} beams, nearest {far.min():.0f} m,",
#           np.isinf(far).sum(), "inf")

# %% [markdown] tags=["solution"]
# They went through: an open door, or a pane of glass as in chapter 06. The map frees their way, and
# is right about what the beams have seen.

# %% [markdown] tags=["solution"]
# Do not free what lies behind a wall: the walls of a corridor on the other side would vanish from
# the map whenever the robot sees this one.

# %% active="ipynb" tags=["solution"]
# def free_behind(log_odds, pose, ranges, angles, spread, cell, max_range, hit, miss):
#     new = insert(log_odds, pose, ranges, angles, spread, cell, max_range, hit, miss)
#     x = (np.arange(log_odds.shape[1]) + 0.5) * cell - pose[0]
#     y = ((np.arange(log_odds.shape[0]) + 0.5) * cell - pose[1])[:, None]
#     untouched = (new == log_odds) & (np.hypot(x, y) < max_range)
#     return np.where(untouched, new + miss, new)
#
# check_insert(free_behind)

# %% [markdown] tags=["solution"]
# Your grid on more of the building: twenty scans, finer cells, a longer reach. The numbers beside
# it are those of a grid that maps behind the robot's back as well, with the nearest beam, wherever
# it points.

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "An occupancy grid of a corridor of Killian Court: free floor light, walls dark on both sides, unknown grey."}}
# log, poses = court.log, court.dead_reckoned()
# rows = np.arange(0, 60, 3)
# corner = poses[rows, :2].min(0) - 8.0
# size = np.ceil((poses[rows, :2].max(0) + 8.0 - corner) / 0.25).astype(int)
# for spread, name in ((7.0, "behind the back"), (np.deg2rad(1), "in view only")):
#     grid = np.zeros(size[::-1])
#     for k in rows:
#         scan = log.ranges[k], log.scan.beam_angles, spread
#         grid = insert(grid, poses[k] - [*corner, 0.0], *scan, 0.25, 7.5, 0.85, -0.4)
#     print(f"{name}: {(grid > 0).sum()} cells occupied, {(grid < 0).sum()} free")
# fig, ax = plt.subplots(figsize=(7, 4))
# plots.occupancy(ax, expit(grid), [0, 0.25 * size[0], 0, 0.25 * size[1]])
# plots.floor(ax)
# _ = ax.set_title("Killian Court, by a dozen lines of your own")

# %% [markdown] tags=["solution"]
# You now have a map that takes any scan of any lidar from a known pose. Where the pose comes from
# is what part III is about.

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 08](../solutions/08_occupancy_maps.ipynb).
