"""Exercises, chapter 15: a gamma update, a beam, a tree of ancestors, weights of the same data."""

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


# %% [markdown] tags=["chapter"]
# # Exercises 15: Gamma-SLAM and DP-SLAM
#
# Five functions, from a cell that learns how rough it is to particles that are weighed by the
# ground ahead of them. Exercises 1 and 5 belong to the lesson [Gamma-SLAM and
# DP-SLAM](../15_other_maps.ipynb), 2 to 4 to its page on
# [DP-SLAM](../15c_other_maps.ipynb). Replace each `...` and run the check below it as often as you
# like; each check draws what your function gives.

# %% [markdown] tags=["solution"]
# # Solutions 15: Gamma-SLAM and DP-SLAM
#
# The exercises are in [Exercises 15](../exercises/15_other_maps.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% active="ipynb" tags=["imports", "solution"]
# import math
#
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: what a cell learns, with a pencil
#
# Heights are normal with the precision $\tau$, and $\tau$ is gamma distributed: $p(\tau) \propto
# \tau^{\alpha - 1} e^{-\beta\tau}$. On paper: multiply by the density of $n$ heights, average
# over their unknown mean (it leaves $\tau^{(n-1)/2}$ and the squares about the sample mean), and
# read off the new $\alpha$ and $\beta$.


# %% tags=["exercise"]
def gamma_update(alpha: float, beta: float, heights: Array) -> Any:
    """Belief of a cell after heights.

    Parameters
    ----------
    alpha, beta : float
        Shape, and rate (m^2).
    heights : ndarray, shape (n,)
        One or more (m).

    Returns
    -------
    alpha, beta : float
    """
    nu = len(heights) - 1
    return alpha + nu / 2, beta + np.sum((heights - heights.mean()) ** 2) / 2


# %% active="ipynb" tags=["try"]
# gamma_update(1.0, 0.001, np.array([0.0, 0.1, 0.2]))

# %% [markdown] tags=["hint"]
# The density of one height is $\sqrt{\tau/2\pi}\; e^{-\tau (z - \mu)^2/2}$. How does the sum of
# the squares split into squares about the sample mean and a square of the sample mean?

# %% [markdown] tags=["hint"]
# $\tau^{\alpha - 1}\,\tau^{\nu/2}$ has the shape $\alpha + \nu/2$, and $e^{-\beta\tau}\,e^{-\tau
# S/2}$ the rate $\beta + S/2$.


# %% tags=["cases"]
def _gamma_update_drawn(ax: Any, function: Any) -> None:
    """Draw the belief about the precision after three heights, and after five from 5 m up."""
    tau = np.linspace(0.5, 500.0, 200)  # 1/m^2
    for heights, style in (([0.0, 0.1, 0.2], "-"), ([5.0, 5.1, 5.2, 5.1, 5.0], "--")):
        alpha, beta = (float(number) for number in function(1.0, 0.001, np.array(heights)))
        log_p = (alpha - 1) * np.log(tau) - beta * tau
        ax.plot(tau, np.exp(log_p - log_p.max()), style, label=f"heights from {heights[0]:.0f} m")
    ax.legend(fontsize=8)
    ax.set(xlabel="precision (1/m²)", ylabel="density / largest")


check_gamma_update = Check(
    gamma_update,
    "alpha, beta",
    {
        "0, 10 and 20 cm": (1.0, 0.001, [0.0, 0.1, 0.2]),
        "the same, five metres higher": (1.0, 0.001, [5.0, 5.1, 5.2]),
        "one height says nothing": (2.0, 0.5, [0.3]),
        "heights above and below the ground": (1.5, 0.2, [-0.4, 0.1, -0.25]),
        "any heights, any cell": lambda rng: (
            np.round(rng.uniform(0.5, 9), 1),
            np.round(rng.uniform(0.001, 0.5), 3),
            np.round(rng.normal(0.4, 0.2, rng.integers(2, 9)), 2),
        ),
    },
    picture=_gamma_update_drawn,
)

# %% tags=["mistakes"]
check_gamma_update.mistakes = {
    "the mean costs one degree of freedom: nu = n - 1": "len(heights) - 1 => len(heights)",
    "alpha grows by half of nu": "alpha + nu / 2 => alpha + nu",
    "beta grows by half of the sum of squares": "** 2) / 2 => ** 2)",
    "beta grows by nu s^2 / 2, not by s^2 / 2": "** 2) / 2 => ** 2) / 2 / max(nu, 1)",
    "s^2 was taken over n, and nu is n - 1": "** 2) / 2 => ** 2) / 2 * nu / (nu + 1)",
    "heights scatter about their mean, not about zero": ("heights - heights.mean() => heights"),
    "the squares are missing": ") ** 2) / 2 => )) / 2",
    "alpha grows by nu / 2 and beta by the squares / 2: both halves are missing": (
        lambda alpha, beta, z: (alpha + len(z) - 1, beta + np.sum((z - z.mean()) ** 2))
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: what a cell learns, with a pencil
#
# The squares split: $\sum (z_i - \mu)^2 = S + n(\bar z - \mu)^2$ with $S = \sum (z_i - \bar
# z)^2$. Averaged over $\mu$, the second part leaves $\sqrt{2\pi/n\tau}$, so one of the $n$ roots
# of $\tau$ is gone: what is left is $\tau^{(n-1)/2} e^{-\tau S/2}$. Times the gamma density that
# is a gamma density again.

# %% [markdown] tags=["solution"]
# With heights about zero the map depends on how high the robot stood:

# %% active="ipynb" tags=["solution"]
# def about_zero(alpha, beta, heights):
#     return alpha + (len(heights) - 1) / 2, beta + np.sum(heights**2) / 2
#
# check_gamma_update(about_zero)

# %% [markdown] tags=["statement"]
# ## Exercise 2: where a beam ends
#
# A laser beam crosses a row of cells. Each stops it with the chance (B) of the page on
# [DP-SLAM](../15c_other_maps.ipynb), $1 - e^{-(h/d)\,l}$: $h$ hits, $d$ metres travelled in the
# cell so far, $l$ the way of this beam in it. In which cell does the beam end?


# %% tags=["exercise"]
def beam_ends(hits: Array, metres: Array, side: float) -> Array:
    """Chance that a beam ends in each cell.

    Parameters
    ----------
    hits : ndarray, shape (n,)
        Beams that ended in each cell so far, the nearest cell first.
    metres : ndarray, shape (n,)
        Metres that beams travelled in it.
    side : float
        Way of this beam in each cell (m).

    Returns
    -------
    ndarray, shape (n,)
    """
    stop = 1 - np.exp(-hits / metres * side)
    comes = np.cumprod(np.append(1.0, 1 - stop))[:-1]
    return comes * stop


# %% active="ipynb" tags=["try"]
# beam_ends(np.array([0.0, 3.0, 40.0]), np.array([2.0, 2.0, 2.0]), 0.1)


# %% tags=["cases"]
def _beam_ends_drawn(ax: Any, function: Any) -> None:
    """Draw the chances of a beam that meets a bush, then a wall."""
    hits, metres = np.array([0.0, 0, 3, 0, 0, 40, 40, 9]), np.array([2.0, 2, 2, 1, 3, 2, 1, 2])
    ax.step(0.05 + 0.1 * np.arange(8), function(hits, metres, 0.1), where="mid")
    ax.plot([0.25, 0.55], [0.0, 0.0], "ks", ms=5)
    ax.annotate("bush", (0.25, 0.05), ha="center", fontsize=9)
    ax.annotate("wall", (0.55, 0.05), ha="right", fontsize=9)
    ax.set(xlabel="along the beam (m)", ylabel="chance to end here", ylim=(-0.05, 1))


check_beam_ends = Check(
    beam_ends,
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
    picture=_beam_ends_drawn,
)

# %% tags=["mistakes"]
check_beam_ends.mistakes = {
    "it must come to the cell first: multiply by the chance to pass all cells before": (
        "comes * stop => stop"
    ),
    "to end in a cell it need not pass that cell: the product runs over the cells before": (
        "np.cumprod(np.append(1.0, 1 - stop))[:-1] => np.cumprod(1 - stop)"
    ),
    "this is the chance to come to the cell; it must stop there too": ("comes * stop => comes"),
    "the length of the way in a cell is missing": " * side => ",
    "hits a metre: divide by the metres": "hits / metres => hits",
    "this is metres a hit: hits over metres": (
        "hits / metres => metres / np.maximum(hits, 1e-12)"
    ),
    "1 - exp(-x), not x: a cell cannot stop more than all": (
        "1 - np.exp(-hits / metres * side) => hits / metres * side"
    ),
    "the first cell is the nearest: the product runs from the first cell to the last": (
        lambda hits, metres, side: beam_ends(hits[::-1], metres[::-1], side)[::-1]
    ),
    "this is the chance to pass a cell: 1 minus it": (
        "stop = 1 - np.exp(-hits / metres * side) => stop = np.exp(-hits / metres * side)"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: where a beam ends

# %% [markdown] tags=["solution"]
# There is nothing in front of the first cell, so its factor is 1. Without the product every cell
# is reached as if the wall before it were air.

# %% [markdown] tags=["statement"]
# <details><summary>Hint</summary>
#
# To end in the third cell it must pass the first and the second. `np.cumprod` multiplies from the
# left; what does the first cell need in front of it?
#
# </details>
#
# ## Exercise 3: a bug to find
#
# This function asks a node, then its parent, and so on. It was used for a month before it was
# noticed that parts of the oldest map were missing. Find the mistake and mend it.


# %% tags=["exercise"]
def look_up(parents: Ints, entries: Array, node: int, cell: int) -> float:
    """Entry of a cell as a particle sees it.

    Parameters
    ----------
    parents : ndarray of int, shape (nodes,)
        Parent of each node, -1 for the root.
    entries : ndarray, shape (nodes, cells)
        What each node wrote, NaN where it wrote nothing.
    node, cell : int

    Returns
    -------
    float
        The youngest entry on the way to the root, NaN if there is none.
    """
    while node >= 0:
        if not np.isnan(entries[node, cell]):
            return float(entries[node, cell])
        # A parent comes before its children: the walk ends, whatever is tried.
        node = min(parents[node], node - 1)
    return float("nan")


# %% active="ipynb" tags=["stub"]
#     while parents[node] >= 0:
#         if not np.isnan(entries[node, cell]):
#             return float(entries[node, cell])
#         node = parents[node]
#     return float("nan")

# %% active="ipynb" tags=["try"]
# look_up(np.array([-1, 0]), np.array([[4.0, 2.0], [np.nan, 3.0]]), 1, 1)


# %% tags=["cases"]
def _a_tree(rng: np.random.Generator) -> Any:
    n = int(rng.integers(4, 9))
    parents = [-1, *(int(rng.integers(0, k)) for k in range(1, n))]
    entries = np.where(rng.random((n, 5)) < 0.35, rng.integers(0, 9, (n, 5)), np.nan)
    return parents, entries, int(rng.integers(0, n)), int(rng.integers(0, 5))


_NONE = float("nan")


def _look_up_drawn(ax: Any, function: Any) -> None:
    """Draw what each node of a small tree reads in each cell; white is NaN."""
    parents = np.array([-1, 0, 0, 1, 1, 2])
    entries = np.full((6, 8), _NONE)
    entries[0, :5], entries[1, 3:6], entries[2, 5:], entries[3, 0], entries[5, 6] = 1, 2, 3, 0, 4
    seen = [[float(function(parents, entries, n, c)) for c in range(8)] for n in range(6)]
    ax.imshow(np.array(seen), cmap="viridis", vmin=0, vmax=4, aspect="auto")
    for node, row in enumerate(seen):
        for cell, value in enumerate(row):
            word = "" if np.isnan(value) else f"{value:.0f}"
            ax.text(cell, node, word, color="white" if value < 3 else "black", ha="center")
    ax.grid(False)
    ax.set(xlabel="cell", ylabel="node")


check_look_up = Check(
    look_up,
    "entry",
    {
        "its own entry": ([-1, 0], [[4.0], [5.0]], 1, 0),
        "the root's entry, two steps up": ([-1, 0, 1], [[4.0], [_NONE], [_NONE]], 2, 0),
        "an entry of 0 is an entry": ([-1, 0], [[4.0], [0.0]], 1, 0),
        "no node has one": ([-1, 0], [[_NONE], [_NONE]], 1, 0),
        "any tree, any node": _a_tree,
    },
    draws=20,
    picture=_look_up_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_look_up.mistakes = {
    "the root is never asked: its parent is -1, but it may have an entry": (
        "while node >= 0 => while parents[node] >= 0"
    ),
    "the parent is parents[node], not the node before": (
        "min(parents[node], node - 1) => node - 1"
    ),
    "ask the node itself first, then its parent": (
        "while node >= 0: => node = parents[node]\n    while node >= 0:"
    ),
    "the youngest entry wins: this is the oldest": lambda p, e, node, c: _oldest(p, e, node, c),
    "0 is a number like others; NaN is no entry": (
        "if not np.isnan(entries[node, cell]):"
        " => if not np.isnan(entries[node, cell]) and entries[node, cell]:"
    ),
    "what no node has seen is NaN": 'float("nan") => 0.0',
    "one step up is not enough: go on to the root": (
        "while node >= 0 => for node in [n for n in (node, parents[node]) if n >= 0]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a bug to find
#
# The loop ended when the *parent* was no node, that is, at the root, before the root was asked.
# It ends right when the *node* is none.

# %% [markdown] tags=["statement"]
# <details><summary>Hint</summary>
#
# Follow it with a pencil for a cell that only the root has written. When does the loop end?
#
# </details>
#
# ## Exercise 4: who is left in the tree
#
# Prune nodes that lead to no particle, then merge every node that has one child left with that
# child. Which nodes remain? (Count them for $M$ particles: never more than $2M - 1$.)


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
    """Draw a small tree: nodes that stay are filled."""
    parents, particles = np.array([-1, 0, 0, 1, 1, 2, 3, 3, 5, 4]), np.array([6, 7, 8])
    x = np.array([0.0, 1, 1, 2, 2, 2, 3, 3, 3, 3])
    y = np.array([0.0, 1, -1, 1.5, 0.5, -1, 2, 1.2, -1, 0.3])
    for node in range(1, len(parents)):
        ax.plot(x[[node, parents[node]]], y[[node, parents[node]]], color="0.6", zorder=0)
    stays = function(parents, particles)
    left = np.array([bool(stays[node]) for node in range(len(parents))])
    ax.plot(x, y, "o", mfc="white", mec="0.4", ms=11)
    ax.plot(x[left], y[left], "o", ms=11, label="stays")
    ax.plot(x[particles] + 0.25, y[particles], "k<", ms=6, label="particle")
    ax.legend(fontsize=8, loc="lower left")
    ax.set(xlim=(-0.4, 3.6), ylim=(-1.6, 2.4), xlabel="generation")


check_survivors = Check(
    survivors,
    "left",
    {
        "a root with two particles": ([-1, 0, 0], [1, 2]),
        "a chain is merged into its particle": ([-1, 0, 1, 2], [3]),
        "a branch that died is pruned, and its fork merged": ([-1, 0, 0, 1, 1], [3, 4]),
        "any tree": _a_family,
    },
    draws=20,
    picture=_survivors_drawn,
)


# %% tags=["mistakes"]
def _oldest(parents: Ints, entries: Array, node: int, cell: int) -> float:
    found = _NONE
    while node >= 0:
        found = found if np.isnan(entries[node, cell]) else float(entries[node, cell])
        node = parents[node]
    return found


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
# ## Solution 4: who is left in the tree

# %% [markdown] tags=["solution"]
# Every inner node that stays is a fork. Going from the root down, each fork adds at least one
# particle to the first, so there are at most M - 1 forks. Counting dead children keeps forks that
# are none:

# %% active="ipynb" tags=["solution"]
# def with_the_dead(parents, particles):
#     left = np.bincount(parents[1:], minlength=len(parents)) >= 2
#     left[particles] = True
#     return left
#
# check_survivors(with_the_dead)

# %% [markdown] tags=["statement"]
# ## Exercise 5: assemble the weights of Gamma-SLAM
#
# Every particle stands elsewhere, so it sorts the same heights into other cells of its own map.
# Weigh them all by (F) of the [chapter](../15_other_maps.ipynb), the density of the heights, and
# normalise. The unknown mean of each cell lies anywhere within a width $L$, so each cell that
# holds a height costs $\ln L$: then the weights are the same in metres and in centimetres.


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
# `math.lgamma` (after `import math`) is $\ln\Gamma$. In a cell with one height $\nu = 0$ and
# $S = 0$: all terms are zero or cancel but $-\ln L$.

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
    x = rng.uniform(0.0, 4.0, 120)
    rough = np.where(np.floor(x / side) % 3 == 0, 0.09, 0.02)
    heights = rough * rng.standard_normal(120)
    scatter = np.where(np.arange(-4, 20) % 3 == 0, 0.09, 0.02)
    alpha = np.full((len(aside), 24), 20.0)
    cells = np.floor((x + aside[:, None]) / side).astype(int) + 4
    w = np.asarray(function(alpha, alpha * scatter**2, cells, heights, 1.0), float)
    ax.plot(100 * aside, np.log10(np.maximum(w, 1e-60)))
    ax.axvline(0.0, color="0.5", lw=1)
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


check_weights.mistakes = {
    "these are densities of sample variances, (E): each particle has other ones. Weigh by the "
    "heights, (F)": _variances,
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
# ## Solution 5: assemble the weights of Gamma-SLAM

# %% [markdown] tags=["solution"]
# Without $\ln L$ the particle with one cell and the particle with two get different weights in
# metres and in centimetres. And the density of the sample variances, (E), is right as a density.
# It passes where all particles have the same cells, and fails where they have not:

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
# The solutions are in [Solutions 15](../solutions/15_other_maps.ipynb).
