"""Checks of chapter 15: a gamma update, a beam, a tree of ancestors, weights of the same data."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn
from slamlab.exercises._report import Array, Check, Ints, Mask

__all__ = [
    "check_beam_ends",
    "check_gamma_update",
    "check_look_up",
    "check_survivors",
    "check_weights",
]


# Exercise 1: what a cell learns.


def _gamma_update(alpha: float, beta: float, heights: Array) -> Any:
    """Return shape and rate of the precision after heights (n,)."""
    nu = len(heights) - 1
    return alpha + nu / 2, beta + np.sum((heights - heights.mean()) ** 2) / 2


check_gamma_update = Check(
    _gamma_update,
    "alpha, beta",
    {
        "0, 10 and 20 cm": (1.0, 0.001, [0.0, 0.1, 0.2]),
        "the same, five metres higher": (1.0, 0.001, [5.0, 5.1, 5.2]),
        "one height says nothing": (2.0, 0.5, [0.3]),
        "any heights, any cell": lambda rng: (
            np.round(rng.uniform(0.5, 9), 1),
            np.round(rng.uniform(0.001, 0.5), 3),
            np.round(rng.normal(0.4, 0.2, rng.integers(2, 9)), 2),
        ),
    },
    {
        "the mean costs one degree of freedom: nu = n - 1": "len(heights) - 1 => len(heights)",
        "alpha grows by half of nu": "alpha + nu / 2 => alpha + nu",
        "beta grows by half of the sum of squares": "** 2) / 2 => ** 2)",
        "beta grows by nu s^2 / 2, not by s^2 / 2": "** 2) / 2 => ** 2) / 2 / max(nu, 1)",
        "s^2 was taken over n, and nu is n - 1": "** 2) / 2 => ** 2) / 2 * nu / (nu + 1)",
        "heights scatter about their mean, not about zero": (
            "heights - heights.mean() => heights"
        ),
        "the squares are missing": ") ** 2) / 2 => )) / 2",
    },
)


# Exercise 2: where a beam ends.


def _beam_ends(hits: Array, metres: Array, side: float) -> Array:
    """Return the chance (n,) that a beam ends in each cell of a row."""
    stop = 1 - np.exp(-hits / metres * side)
    comes = np.cumprod(np.append(1.0, 1 - stop))[:-1]
    return comes * stop


check_beam_ends = Check(
    _beam_ends,
    "chance",
    {
        "one cell of 3 hits on 2 m": ([3.0], [2.0], 0.1),
        "an open floor": ([0.0, 0.0, 0.0], [1.0, 2.0, 3.0], 0.1),
        "a bush before a wall": ([0.0, 3.0, 40.0, 40.0], [2.0, 2.0, 2.0, 2.0], 0.1),
        "any row, any side": lambda rng: (
            rng.integers(0, 30, 6),
            np.round(rng.uniform(0.3, 4, 6), 2),
            np.round(rng.uniform(0.05, 0.5), 2),
        ),
    },
    {
        "it must come to the cell first: multiply by the chance to pass all cells before": (
            "comes * stop => stop"
        ),
        "to end in a cell it need not pass that cell: the product runs over the cells before": (
            "np.cumprod(np.append(1.0, 1 - stop))[:-1] => np.cumprod(1 - stop)"
        ),
        "this is the chance to come to the cell; it must stop there too": (
            "comes * stop => comes"
        ),
        "the length of the way in a cell is missing": " * side => ",
        "hits a metre: divide by the metres": "hits / metres => hits",
        "this is metres a hit: hits over metres": (
            "hits / metres => metres / np.maximum(hits, 1e-12)"
        ),
        "1 - exp(-x), not x: a cell cannot stop more than all": (
            "1 - np.exp(-hits / metres * side) => hits / metres * side"
        ),
        "this is the chance to pass a cell: 1 minus it": (
            "stop = 1 - np.exp(-hits / metres * side) => stop = np.exp(-hits / metres * side)"
        ),
    },
)


# Exercise 3: a bug to find.


def _look_up(parents: Ints, entries: Array, node: int, cell: int) -> float:
    """Return the entry of a cell as a node sees it, NaN if nobody has one."""
    while node >= 0:
        if not np.isnan(entries[node, cell]):
            return float(entries[node, cell])
        # A parent stands before its children; whatever else is tried, the walk comes to an end.
        node = min(parents[node], node - 1)
    return float("nan")


def _a_tree(rng: np.random.Generator) -> Any:
    n = int(rng.integers(4, 9))
    parents = [-1, *(int(rng.integers(0, k)) for k in range(1, n))]
    entries = np.where(rng.random((n, 5)) < 0.35, rng.integers(0, 9, (n, 5)), np.nan)
    return parents, entries, int(rng.integers(0, n)), int(rng.integers(0, 5))


_NONE = float("nan")

check_look_up = Check(
    _look_up,
    "entry",
    {
        "its own entry": ([-1, 0], [[4.0], [5.0]], 1, 0),
        "the root's entry, two steps up": ([-1, 0, 1], [[4.0], [_NONE], [_NONE]], 2, 0),
        "an entry of 0 is an entry": ([-1, 0], [[4.0], [0.0]], 1, 0),
        "nobody has one": ([-1, 0], [[_NONE], [_NONE]], 1, 0),
        "any tree, any node": _a_tree,
    },
    {
        "the root is never asked: its parent is -1, but it may have an entry": (
            "while node >= 0 => while parents[node] >= 0"
        ),
        "the parent is parents[node], not the node before": (
            "min(parents[node], node - 1) => node - 1"
        ),
        "ask the node itself first, then its parent": (
            "while node >= 0: => node = parents[node]\n    while node >= 0:"
        ),
        "the youngest entry wins: this is the oldest": lambda p, e, node, c: _oldest(
            p, e, node, c
        ),
        "0 is a number that somebody wrote; NaN is no entry": (
            "if not np.isnan(entries[node, cell]):"
            " => if not np.isnan(entries[node, cell]) and entries[node, cell]:"
        ),
        "what nobody has seen is NaN": 'float("nan") => 0.0',
        "one step up is not enough: go on to the root": (
            "while node >= 0 => for node in [n for n in (node, parents[node]) if n >= 0]"
        ),
    },
    draws=20,
)


def _oldest(parents: Ints, entries: Array, node: int, cell: int) -> float:
    found = _NONE
    while node >= 0:
        found = found if np.isnan(entries[node, cell]) else float(entries[node, cell])
        node = parents[node]
    return found


# Exercise 4: which nodes are left.


def _survivors(parents: Ints, particles: Ints) -> Mask:
    """Return which nodes (n,) are left when the tree is pruned and merged."""
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


def _a_family(rng: np.random.Generator) -> Any:
    n = int(rng.integers(4, 14))
    parents = np.array([-1, *(int(rng.integers(max(0, k - 4), k)) for k in range(1, n))])
    leaves = np.setdiff1d(np.arange(n), parents)
    some = rng.choice(leaves, int(rng.integers(1, len(leaves) + 1)), replace=False)
    return parents, np.sort(some)


check_survivors = Check(
    _survivors,
    "left",
    {
        "a root with two particles": ([-1, 0, 0], [1, 2]),
        "a chain is merged into its particle": ([-1, 0, 1, 2], [3]),
        "a branch that died is pruned, and its fork merged": ([-1, 0, 0, 1, 1], [3, 4]),
        "any tree": _a_family,
    },
    {
        "a node with one living child is merged with it: two branches or more are due": (
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
        "the root may be merged too": (
            "left = branches >= 2 => left = branches >= 2; left[0] = 1"
        ),
    },
    draws=20,
)


# Exercise 5: weigh particles by the same heights.


def _weights(alpha: Array, beta: Array, cells: Ints, heights: Array) -> Array:
    """Return weights (M,) of particles that sort heights (n,) into their own cells (M, n)."""
    log_weights = np.zeros(len(cells))
    for i in range(len(cells)):
        for c in np.unique(cells[i]):
            z = heights[cells[i] == c]
            half, a, b = (len(z) - 1) / 2, alpha[i, c], beta[i, c]
            squares = np.sum((z - z.mean()) ** 2)
            log_weights[i] += math.lgamma(a + half) - math.lgamma(a) + a * np.log(b)
            log_weights[i] -= (a + half) * np.log(b + squares / 2)
            log_weights[i] -= half * np.log(2 * np.pi) + np.log(len(z)) / 2
    weights = np.exp(log_weights - log_weights.max())
    return weights / weights.sum()


def _variances(alpha: Array, beta: Array, cells: Ints, heights: Array) -> Array:
    """Return the weights by (E): the density of the sample variances of two or more heights."""
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


@drawn
def _particles(rng: np.random.Generator, n_particles: int, size: float) -> Any:
    n = int(rng.integers(6, 15))
    return (
        rng.integers(2, 20, (n_particles, 4)) / 2,
        np.round(rng.uniform(0.01, 0.5, (n_particles, 4)), 3),
        rng.integers(0, 4, (n_particles, n)),
        np.round(rng.normal(0, size, n), 3),
    )


check_weights = Check(
    _weights,
    "weight",
    {
        "two particles, the same cells, different maps": (
            [[2.0, 3.0], [5.0, 1.0]],
            [[0.1, 0.2], [0.05, 0.3]],
            [[0, 0, 1, 1], [0, 0, 1, 1]],
            [0.1, 0.3, -0.2, 0.25],
        ),
        "the same maps, different cells": (
            [[2.0, 3.0], [2.0, 3.0]],
            [[0.1, 0.2], [0.1, 0.2]],
            [[0, 0, 1, 1], [0, 1, 1, 1]],
            [0.1, 0.3, -0.2, 0.25],
        ),
        "any particles": _particles(3, 0.2),
        "a picture so unlikely that exp gives 0": (
            [[2.0, 2.0], [90.0, 90.0]],
            [[0.1, 0.1], [0.001, 0.001]],
            np.tile(np.arange(240) % 2, (2, 1)),
            np.linspace(-400.0, 500.0, 240),
        ),
    },
    {
        "these are densities of sample variances, (E): each particle has other ones. Weigh by the "
        "heights, (F)": _variances,
        "how many heights fell into a cell counts too: the term - ln(n) / 2 is missing": (
            " + np.log(len(z)) / 2 => "
        ),
        "the normal density has 2 pi: - nu / 2 ln(2 pi) is missing, and nu differs": (
            "half * np.log(2 * np.pi) +  => "
        ),
        "the mean costs one degree of freedom: nu = n - 1": "(len(z) - 1) / 2 => len(z) / 2",
        "the heights of a cell scatter about the mean of that cell": (
            "z.mean() => heights.mean()"
        ),
        "a alone, where a + nu / 2 is due": (
            "(a + half) * np.log(b + squares / 2) => a * np.log(b + squares / 2)"
        ),
        "the logarithms are too small for exp: take the largest off first": (
            "np.exp(log_weights - log_weights.max()) => np.exp(log_weights)"
        ),
        "weights sum to 1": "weights / weights.sum() => weights",
        "alpha and beta were exchanged: the first belongs to lnGamma": (
            "alpha[i, c], beta[i, c] => beta[i, c], alpha[i, c]"
        ),
        "each particle has its own map: these are all weighed on the first": (
            "alpha[i, c], beta[i, c] => alpha[0, c], beta[0, c]"
        ),
    },
    tolerance=1e-7,
)
