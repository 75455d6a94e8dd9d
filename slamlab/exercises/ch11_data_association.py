"""Exercises, chapter 11: the gate, the joint distance, nothing twice, the search for all pairs.

P4 (2a), (2b) with the gate that page 84 lacks; joint compatibility after Neira and Tardos (2001).
"""

# mypy: disable-error-code="return-value, no-untyped-def, attr-defined"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, drawn
from slamlab.exercises._report import Array, Check, Function, Ints
from slamlab.gaussian import chi2_quantile
from slamlab.sensors import RangeBearing

__all__ = [
    "check_best_first",
    "check_gate",
    "check_joint",
    "check_nearest",
    "check_stacked",
    "check_together",
]


# %% [markdown] tags=["chapter"]
# # Exercises 11: data association
#
# Six exercises that decide which tree is which: a gate with a pencil, three small functions, a
# bug to find, and a search that brings a robot back into its orchard. The chapter is [Data
# association](../11_data_association.ipynb). Replace each `...` and run the check below it as
# often as you like.

# %% [markdown] tags=["solution"]
# # Solutions 11: data association
#
# The exercises are in [Exercises 11](../exercises/11_data_association.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: a gate for a whole look, with a pencil
#
# A gate of 9.21 lets one true pair in a hundred fail. A robot sees many trees at once and wants
# *all* of its true pairs to pass, with a given probability. How wide must the gate of a single
# pair be?
#
# Begin on paper. In the plane, with the covariance taken out, the innovation has the density
# $e^{-(a^2+b^2)/2}/(2\pi)$. Go to polar coordinates and integrate: what is $P(D^2 < c)$? Then let
# $n$ independent pairs pass.


# %% tags=["exercise"]
def gate_for(share: float, pairs: int) -> float:
    """Gate that all true pairs pass together.

    Parameters
    ----------
    share : float
        Probability that all of them pass, between 0 and 1.
    pairs : int
        How many there are, at least 1.

    Returns
    -------
    float
        Limit of the squared Mahalanobis distance of one pair.
    """
    return -2 * np.log(1 - share ** (1 / pairs))


# %% active="ipynb" tags=["try"]
# gate_for(0.99, 8)

# %% [markdown] tags=["hint"]
# $\int_0^{\sqrt c} r\, e^{-r^2/2}\, dr$: substitute $u = r^2/2$.

# %% [markdown] tags=["hint"]
# If one pair passes with probability $p$, all $n$ pass with $p^n$. Which $p$ is wanted? For one
# pair and 0.99 your gate must be 9.21.


# %% tags=["cases"]
def _wanted(rng: np.random.Generator) -> Any:
    return float(np.round(rng.uniform(0.5, 0.999), 3)), int(rng.integers(1, 60))


def _gate_drawn(ax: Any, function: Any) -> None:
    """Draw the gate against the number of pairs, for two probabilities."""
    from slamlab import plots

    pairs = np.arange(1, 21)
    for share, marker in ((0.99, "o"), (0.9, "s")):
        gates = [float(function(share, int(n))) for n in pairs]
        ax.plot(pairs, gates, marker=marker, markersize=4, color=plots.COLOURS["estimate"])
        ax.text(20.4, gates[-1], f"{share:.0%}", va="center")
    ax.set(xlabel="pairs", ylabel="gate", xlim=(0, 24))


check_gate = Check(
    gate_for,
    "gate",
    {
        "one pair": (0.99, 1),
        "eight pairs": (0.99, 8),
        "a coin for each of two": (0.5, 2),
        "any wish": _wanted,
    },
    tolerance=1e-6,
    draws=12,
    picture=_gate_drawn,
)

# %% tags=["mistakes"]
check_gate.mistakes = {
    "the range and the bearing are two numbers: this is the gate of one": (
        lambda share, pairs: float(chi2_quantile(share ** (1 / pairs), 1))
    ),
    "this is the gate of the joint distance of all pairs: each pair has a gate of its own": (
        lambda share, pairs: float(chi2_quantile(share, 2 * pairs))
    ),
    "the exponent is -c/2: the 2 is missing": "-2 * np.log => -np.log",
    "this is the gate of one pair: all of them must pass": "share ** (1 / pairs) => share",
    "this is P(D^2 < c) = share to the power n: each pair must pass oftener, not less often": (
        "share ** (1 / pairs) => share**pairs"
    ),
    "misses were added: that they are all avoided is a product": (
        "1 - share ** (1 / pairs) => (1 - share) / pairs"
    ),
    "this is the distance: the gate is for its square": (
        lambda share, pairs: np.sqrt(gate_for(share, pairs))
    ),
    "this many lie outside, and the rest inside: P(D^2 < c) = 1 - exp(-c/2)": (
        "1 - share ** (1 / pairs) => share ** (1 / pairs)"
    ),
    "this is the probability of one pair: expected its gate": (
        lambda share, pairs: share ** (1 / pairs)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: a gate for a whole look, with a pencil
#
# In polar coordinates the angle gives $2\pi$, and $u = r^2/2$ leaves $\int_0^{c/2} e^{-u}\, du$:
# $P(D^2 < c) = 1 - e^{-c/2}$. All $n$ pairs pass with $(1 - e^{-c/2})^n$. Set this equal to the
# share and solve for $c$.

# %% [markdown] tags=["solution"]
# And numerically: a hundred thousand looks with eight true pairs each. The gate of a single pair
# loses one true pair in a hundred, and so one look in thirteen.

# %% active="ipynb" tags=["solution"]
# d2 = (np.random.default_rng(0).normal(size=(100_000, 8, 2)) ** 2).sum(-1)
# for pairs in (1, 8):
#     gate = gate_for(0.99, pairs)
#     share = np.mean((d2 < gate).all(1))
#     print(f"gate {gate:5.2f}: all eight pairs pass in {share:.1%} of the looks")

# %% active="ipynb" tags=["solution"]
# check_gate(lambda share, pairs: -2 * np.log(1 - share))

# %% [markdown] tags=["statement"]
# ## Exercise 2: the nearest landmark inside a gate
#
# One measurement, n landmarks. The innovations and their covariances (P4 (2a), (2b)) are computed
# already.


# %% tags=["exercise"]
def nearest(y: Array, S: Array, gate: float) -> int:
    """Nearest landmark by Mahalanobis distance.

    Parameters
    ----------
    y : ndarray, shape (n, 2)
        Innovation of the measurement with each landmark (m, rad), wrapped; n may be 0.
    S : ndarray, shape (n, 2, 2)
        Their covariances.
    gate : float
        Threshold of the squared distance; exactly on it is not inside.

    Returns
    -------
    int
        Row of the nearest landmark, -1 if none is inside the gate.
    """
    if len(y) == 0:
        return -1
    distance = (y * np.linalg.solve(S, y[..., None])[..., 0]).sum(1)
    row = np.argmin(distance)
    return row if distance[row] < gate else -1


# %% active="ipynb" tags=["try"]
# S = np.array([np.diag([0.04, 0.01])] * 2)
# nearest(np.array([[0.3, 0.1], [0.1, 0.05]]), S, 9.21)

# %% [markdown] tags=["hint"]
# The squared distance of one landmark is y^T S^-1 y.

# %% [markdown] tags=["hint"]
# `np.linalg.solve(S, y[..., None])[..., 0]` gives S^-1 y for all landmarks at once.


# %% tags=["cases"]
def _scene(rng: np.random.Generator) -> Any:
    n = int(rng.integers(1, 8))
    S = np.array([a_covariance(rng, 2, size) for size in rng.uniform(0.05, 2, n)])
    return np.round(rng.normal(0, 2, (n, 2)), 2), S, 9.21


_ROUND, _WIDE = np.diag([0.04, 0.01]), np.diag([4.0, 1.0])


_SLANTED = np.array([[1.0, 0.95], [0.95, 1.0]])


def _nearest_drawn(ax: Any, function: Any) -> None:
    """Draw which of two landmarks, one certain and one uncertain, an observation takes."""
    from slamlab import plots

    places, landmarks = np.linspace(1, 8, 71), np.array([3.0, 5.0])
    S = np.array([np.diag([0.04, 0.01]), np.diag([1.0, 0.01])])
    rows = [int(function(np.column_stack([x - landmarks, [0.05, 0.05]]), S, 9.21)) for x in places]
    ax.plot(places, rows, ".", color=plots.COLOURS["estimate"])
    ax.plot(landmarks, [0, 1], "*", color="none", markeredgecolor=plots.COLOURS["truth"], ms=11)
    ax.set(xlabel="observed at (m)", ylabel="row", yticks=[-1, 0, 1])


check_nearest = Check(
    nearest,
    "row",
    {
        "two landmarks, equally well known": ([[0.3, 0.1], [0.1, 0.05]], [_ROUND] * 2, 9.21),
        "the vague one is nearer in sigmas": ([[0.5, 0.1], [1.0, 0.3]], [_ROUND, _WIDE], 9.21),
        "correlated errors": ([[1.0, -1.0], [1.3, 1.3]], [_SLANTED, _SLANTED], 9.21),
        "a vague one nearer in sigmas, a sharp one likelier": (
            [[2.0, 0.5], [0.3, 0.05]],
            [_WIDE, _ROUND],
            9.21,
        ),
        "nothing inside the gate": ([[5.0, 0.5], [4.0, 0.0]], [_ROUND] * 2, 9.21),
        "exactly on the gate is not inside": ([[2.0, 0.0]], [np.eye(2)], 4.0),
        "four sigmas are outside a gate of 9.21": ([[0.8, 0.0]], [_ROUND], 9.21),
        "just inside a gate": ([[3.0, 0.0]], [np.eye(2)], 9.21),
        "no landmarks yet": (np.zeros((0, 2)), np.zeros((0, 2, 2)), 9.21),
        "the nearest of several inside": (
            [[0.2, 0.1], [0.05, 0.0], [0.3, 0.1], [0.1, 0.0]],
            [_ROUND] * 4,
            9.0,
        ),
        "any scene": _scene,
    },
    edges=("no landmarks yet",),
    picture=_nearest_drawn,
)


# %% tags=["mistakes"]
def _squared(y: Array, S: Array) -> Any:
    return np.einsum("ni,nij,nj->n", y, np.linalg.inv(S), y)


def _by(measure: Function) -> Function:
    def wrong(y: Array, S: Array, gate: float) -> int:
        distance = measure(y, S)
        if not len(distance):
            return -1
        return int(np.argmin(distance)) if distance.min() < gate else -1

    return wrong


def _inside(y: Array, S: Array, gate: float) -> Any:
    return np.flatnonzero(_squared(y, S) < gate)


def _by_likelihood(y: Array, S: Array) -> Any:
    return _squared(y, S) + np.log(np.linalg.det(S))


check_nearest.mistakes = {
    "the distance is Euclidean: metres and radians know nothing of the covariance": _by(
        lambda y, S: (y**2).sum(1)
    ),
    "S was multiplied, not inverted: a large covariance must make the distance small": (
        "np.linalg.solve(S, y[..., None]) => (S @ y[..., None])"
    ),
    "only the diagonal of S was used: range and bearing errors are correlated": _by(
        lambda y, S: (y**2 / np.diagonal(S, axis1=1, axis2=2)).sum(1)
    ),
    "the gate is for the squared distance: no square root": _by(
        lambda y, S: np.sqrt(_squared(y, S))
    ),
    "the gate is that of the squared distance already: its root was taken": (
        "< gate => < np.sqrt(gate)"
    ),
    "this takes the likeliest landmark, with ln det S: the nearest is asked for": _by(
        _by_likelihood
    ),
    "the gate was not used: a landmark out of reach is no match": "< gate => < np.inf",
    "exactly on the gate is not inside": "< gate => <= gate",
    "the first landmark inside the gate is not always the nearest": (
        lambda *given: int(_inside(*given)[0]) if len(_inside(*given)) else -1
    ),
    "the last landmark inside the gate is not always the nearest": (
        lambda *given: int(_inside(*given)[-1]) if len(_inside(*given)) else -1
    ),
    "this is the farthest landmark": "argmin => argmax",
    "this is the number of landmarks inside the gate, not the row of one": (
        lambda *given: len(_inside(*given))
    ),
    "this is the distance: return the row of the landmark": (
        lambda y, S, gate: float(_squared(y, S).min())
    ),
    "rows begin at 0: these are one too large": (
        lambda *given: nearest(*given) + (nearest(*given) >= 0)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: the nearest landmark inside a gate
#
# The innovation is measured in units of what it may be. The inverse of S makes one number of
# metres and radians, and one scale of sharp and vague landmarks.

# %% [markdown] tags=["solution"]
# A distance without S adds square metres to square radians and compares the sum with a threshold:

# %% active="ipynb" tags=["solution"]
# def by_metres(y, S, gate):
#     distance = (y**2).sum(1)
#     row = np.argmin(distance)
#     return row if distance[row] < gate else -1
#
# check_nearest(by_metres)

# %% [markdown] tags=["statement"]
# ## Exercise 3: the joint distance
#
# m pairs of one look, with the full covariance of their stacked innovation.


# %% tags=["exercise"]
def joint_distance(y: Array, S: Array) -> float:
    """Joint squared Mahalanobis distance.

    Parameters
    ----------
    y : ndarray, shape (m, 2)
        Innovations of the pairs.
    S : ndarray, shape (2m, 2m)
        Covariance of (first range, first bearing, second range, ...).

    Returns
    -------
    float
    """
    stacked = y.ravel()
    return stacked @ np.linalg.solve(S, stacked)


# %% active="ipynb" tags=["try"]
# joint_distance(np.array([[0.5, 0.2]]), np.diag([0.04, 0.01]))

# %% [markdown] tags=["hint"]
# Stack the innovations into one vector, in the order of S.

# %% [markdown] tags=["hint"]
# `y.ravel()`.


# %% tags=["cases"]
@drawn
def _pairs(rng: np.random.Generator, m: int) -> Any:
    H = rng.standard_normal((2 * m, 3))
    return np.round(rng.normal(0, 0.7, (m, 2)), 2), np.round(H @ H.T, 3) + np.eye(2 * m)


def _joint_drawn(ax: Any, function: Any) -> None:
    """Draw the joint distance of four pairs, with errors that agree or differ."""
    from slamlab import plots

    off, m = np.linspace(-1, 1, 21), 4
    shared = np.kron(np.ones((m, m)), np.diag([0.25, 0.0]))
    S = shared + np.kron(np.eye(m), np.diag([0.04, 0.01]))
    for signs, kind in (([1, 1, 1, 1], "estimate"), ([1, -1, 1, -1], "dead_reckoning")):
        y = [np.column_stack([d * np.array(signs), np.zeros(m)]) for d in off]
        ax.plot(off, [float(function(one, S)) for one in y], **plots.line_style(kind))
    ax.text(0.0, 60.0, "errors differ", ha="center", color=plots.COLOURS["dead_reckoning"])
    ax.text(0.0, -6.0, "errors agree", ha="center", color=plots.COLOURS["estimate"])
    ax.set(xlabel="each range off by (m)", ylabel="joint $D^2$", ylim=(-12, 110))


check_joint = Check(
    joint_distance,
    "distance",
    {
        "a single pair": _pairs(1),
        "two pairs that share the robot's error": _pairs(2),
        "three pairs": _pairs(3),
        "five pairs": _pairs(5),
        "two independent pairs": ([[0.3, 0.1], [0.1, -0.2]], np.diag([0.4, 0.1, 0.4, 0.1])),
        "no innovation": (np.zeros((2, 2)), np.eye(4)),
    },
    tolerance=1e-8,
    picture=_joint_drawn,
)


# %% tags=["mistakes"]
def _singles(y: Array, S: Array) -> Any:
    m = len(y)
    blocks = S.reshape(m, 2, m, 2)[np.arange(m), :, np.arange(m)]
    return _squared(y, blocks)


check_joint.mistakes = {
    "the sum of the single distances: the blocks off the diagonal were not used": (
        lambda y, S: float(_singles(y, S).sum())
    ),
    "the largest single distance says nothing about how the pairs fit together": (
        lambda y, S: float(_singles(y, S).max())
    ),
    "S was multiplied, not inverted": "np.linalg.solve(S, stacked) => S @ stacked",
    "S is missing: its inverse weighs the innovations": ("np.linalg.solve(S, stacked) => stacked"),
    "this is the square root of the distance": lambda y, S: np.sqrt(joint_distance(y, S)),
    "half the distance: that is the exponent of the likelihood": (
        lambda y, S: joint_distance(y, S) / 2
    ),
    "divided by the number of pairs: the gate of 2m degrees takes care of that": (
        lambda y, S: joint_distance(y, S) / len(y)
    ),
    "divided by the degrees of freedom: the gate of 2m degrees takes care of that": (
        lambda y, S: joint_distance(y, S) / y.size
    ),
    "stacked in the wrong order: first pair's range and bearing, then the second pair's": (
        "y.ravel() => y.T.ravel()"
    ),
    "only the diagonal of S was used": (lambda y, S: float(np.sum(y.ravel() ** 2 / S.diagonal()))),
    "this is the negative log likelihood, with ln det S: the distance is asked for": (
        lambda y, S: joint_distance(y, S) + np.log(np.linalg.det(S))
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: the joint distance

# %% [markdown] tags=["solution"]
# The sum of the single distances is right for independent pairs only. A look has one pose behind
# it, so its pairs are not:

# %% active="ipynb" tags=["solution"]
# def sum_of_singles(y, S):
#     own = [S[2 * j : 2 * j + 2, 2 * j : 2 * j + 2] for j in range(len(y))]
#     return sum(one @ np.linalg.solve(C, one) for one, C in zip(y, own))
#
# check_joint(sum_of_singles)

# %% [markdown] tags=["statement"]
# ## Exercise 4: nothing twice
#
# Squared distances of k measurements from n landmarks. The best pair of all is taken first, then
# the best of what is left, until nothing is inside the gate.


# %% tags=["exercise"]
def best_first(distance: Array, gate: float) -> Ints:
    """Pair measurements with landmarks, each at most once.

    Parameters
    ----------
    distance : ndarray, shape (k, n)
        Squared Mahalanobis distances.
    gate : float
        Pairs with a distance below it may be taken.

    Returns
    -------
    ndarray of int, shape (k,)
        Landmark of each measurement, -1 for none.
    """
    left = np.where(distance < gate, distance, np.inf)
    rows = np.full(len(left), -1)
    while np.isfinite(left).any():
        j, row = np.unravel_index(np.argmin(left), left.shape)
        rows[j] = row
        left[j, :] = left[:, row] = np.inf
    return rows


# %% active="ipynb" tags=["try"]
# best_first(np.array([[3.0, 30.0], [1.0, 40.0]]), 9.0)

# %% [markdown] tags=["hint"]
# Take a copy. After each pair, set the row of its measurement and the column of its landmark to
# infinity.

# %% [markdown] tags=["hint"]
# `j, row = np.unravel_index(np.argmin(left), left.shape)`.


# %% tags=["cases"]
def _table(rng: np.random.Generator) -> Any:
    k, n = rng.integers(1, 7, 2)
    return np.round(rng.uniform(0.1, 14, (k, n)), 2), np.round(rng.uniform(6, 12), 1)


def _best_first_drawn(ax: Any, function: Any) -> None:
    """Draw landmarks, observations and the pairs that were made."""
    rng = np.random.default_rng(4)
    stars = rng.uniform(0, 4, (7, 2))
    seen = np.vstack([stars[:5] + rng.normal(0, 0.35, (5, 2)), stars[:1] + 0.3, [[4.6, 4.6]]])
    distance = ((seen[:, None] - stars) ** 2).sum(-1) / 0.16
    _pairs_drawn(ax, stars, seen, function(distance, 9.21))


def _pairs_drawn(ax: Any, stars: Array, seen: Array, rows: Any) -> None:
    """Draw a line from each observation to its landmark."""
    from slamlab import plots

    plots.landmarks(ax, stars)
    ax.plot(*seen.T, "o", color=plots.COLOURS["lidar"], markersize=4)
    for point, row in zip(seen, np.asarray(rows), strict=True):
        if row >= 0:
            ax.plot(*np.array([point, stars[int(row)]]).T, color=plots.COLOURS["estimate"])
    ax.set_aspect("equal")
    ax.set(xlabel="x (m)", ylabel="y (m)")


check_best_first = Check(
    best_first,
    "rows",
    {
        "no rivals": ([[1.0, 8.0, 20.0], [15.0, 2.0, 30.0]], 9.0),
        "two want one landmark": ([[3.0, 30.0], [1.0, 40.0]], 9.0),
        "the loser takes its second choice": ([[2.0, 5.0, 50.0], [1.0, 60.0, 70.0]], 9.0),
        "outside the gate is outside": ([[12.0, 30.0], [1.0, 40.0]], 9.0),
        "exactly on the gate is outside": ([[9.0, 30.0], [40.0, 1.0]], 9.0),
        "a narrow gate": ([[3.0, 30.0], [40.0, 1.0]], 2.0),
        "a wide gate": ([[12.0, 30.0], [40.0, 1.0]], 15.0),
        "a chain": ([[2.0, 3.0, 60.0], [1.0, 4.0, 8.0], [50, 0.5, 7.0]], 9.0),
        "the smallest sum is another pairing": ([[1.0, 2.0], [2.0, 8.0]], 9.0),
        "no landmarks yet": (np.zeros((3, 0)), 9.0),
        "no measurements": (np.zeros((0, 3)), 9.0),
        "any table": _table,
    },
    draws=12,
    edges=("no landmarks yet", "no measurements"),
    picture=_best_first_drawn,
)


# %% tags=["mistakes"]
def _each_its_nearest(distance: Array, gate: float) -> Any:
    if not distance.size:
        return np.full(len(distance), -1)
    return np.where(distance.min(1) < gate, distance.argmin(1), -1)


def _both_dropped(distance: Array, gate: float) -> Any:
    rows = _each_its_nearest(distance, gate)
    return np.array([r if r >= 0 and (rows == r).sum() == 1 else -1 for r in rows], dtype=int)


def _hungarian(distance: Array, gate: float) -> Any:
    from scipy.optimize import linear_sum_assignment

    rows = np.full(len(distance), -1)
    inside = distance < gate
    for j, row in zip(*linear_sum_assignment(np.where(inside, distance, 1e6)), strict=True):
        if inside[j, row]:
            rows[j] = row
    return rows


def _mutual(distance: Array, gate: float) -> Any:
    """Pair those that are nearest to each other, once."""
    rows = np.full(len(distance), -1)
    if distance.size:
        for j, row in enumerate(distance.argmin(1)):
            if distance[:, row].argmin() == j and distance[j, row] < gate:
                rows[j] = row
    return rows


check_best_first.mistakes = {
    "only pairs that are nearest to each other were taken: go on with what is left": _mutual,
    "a landmark was given to two measurements": _each_its_nearest,
    "the measurements chose in the order of the list: the best pair of all goes first": (
        "np.unravel_index(np.argmin(left), left.shape)"
        " => (j := np.isfinite(left).any(1).argmax()), left[j].argmin()"
    ),
    "a measurement that lost its nearest landmark may still take another inside the gate": (
        "left[:, row] = np.inf => left[left.argmin(1) == row] = np.inf"
    ),
    "both candidates were dropped: the nearer one keeps the landmark": _both_dropped,
    "the gate was not used": "distance < gate => distance < np.inf",
    "exactly on the gate is not inside": "distance < gate => distance <= gate",
    "this is the assignment of the smallest sum: the best pair of all goes first": _hungarian,
    "these are the measurements of the landmarks: expected the landmarks of the measurements": (
        lambda distance, gate: best_first(distance.T, gate)
    ),
    "the distances were returned: expected the landmarks of the measurements": (
        lambda distance, gate: distance.min(1)
    ),
    "one pair only was returned: go on until nothing is inside the gate": (
        "left[j, :] = left[:, row] = np.inf => left[:] = np.inf"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: nothing twice

# %% [markdown] tags=["solution"]
# Each measurement's own nearest landmark is what page 84 of P4 describes. Two measurements may
# then correct one landmark in one step, though at most one of them is it:

# %% active="ipynb" tags=["solution"]
# def each_its_nearest(distance, gate):
#     return np.where(distance.min(1) < gate, distance.argmin(1), -1)
#
# check_best_first(each_its_nearest)

# %% [markdown] tags=["statement"]
# ## Exercise 5: a bug to find
#
# The covariance of the stacked innovation of m pairs, as exercise 3 took it for granted: all
# pairs share the error of the state, each measurement has noise of its own. This version was
# tested with one pair, and passed.


# %% tags=["exercise"]
def stacked_cov(H: Array, P: Array, R: Array) -> Array:
    """Covariance of the innovations of m pairs, stacked.

    Parameters
    ----------
    H : ndarray, shape (m, 2, d)
        Jacobian of each predicted measurement by the state.
    P : ndarray, shape (d, d)
        Covariance of the state, pose and landmarks.
    R : ndarray, shape (2, 2)
        Covariance of the noise of one measurement.

    Returns
    -------
    ndarray, shape (2m, 2m)
        In the order first range, first bearing, second range, ...
    """
    A = H.reshape(-1, H.shape[2])
    return A @ P @ A.T + np.kron(np.eye(len(H)), R)


# %% active="ipynb" tags=["stub"]
#     A = H.reshape(-1, H.shape[2])
#     return A @ P @ A.T + np.tile(R, (len(H), len(H)))

# %% active="ipynb" tags=["try"]
# stacked_cov(np.ones((2, 2, 3)), np.zeros((3, 3)), np.eye(2))

# %% [markdown] tags=["hint"]
# In the call above the state is known exactly, so all uncertainty comes from the sensor. What does
# an entry of 1 between the first range and the second one say about the two?

# %% [markdown] tags=["hint"]
# `np.kron` of an identity and a block puts the block on the diagonal.


# %% tags=["cases"]
@drawn
def _slopes(rng: np.random.Generator, m: int) -> Any:
    d = int(rng.integers(3, 8))
    return np.round(rng.normal(0, 1, (m, 2, d)), 2), a_covariance(rng, d), a_covariance(rng, 2)


def _stacked_drawn(ax: Any, function: Any) -> None:
    """Draw the 95 % ellipse of the two ranges of two pairs: errors in common make it slanted."""
    from slamlab import plots

    H = np.array([[[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]], [[-0.8, -0.6, 0.0], [0.0, 0.0, -1.0]]])
    P, R = np.diag([0.09, 0.04, 0.0]), np.diag([0.01, 0.0001])
    S = np.asarray(function(H, P, R), float)
    plots.ellipse(ax, np.zeros(2), S[np.ix_([0, 2], [0, 2])])
    ax.set(xlim=(-1, 1), ylim=(-1, 1), xlabel="first range (m)", ylabel="second range (m)")
    ax.set_aspect("equal")


check_stacked = Check(
    stacked_cov,
    "S",
    {
        "a single pair": _slopes(1),
        "two pairs": _slopes(2),
        "two pairs, the state known": lambda rng: (
            (given := _slopes(2)(rng))[0],
            0 * given[1],
            given[2],
        ),
        "two pairs, a perfect sensor": lambda rng: (*_slopes(2)(rng)[:2], np.zeros((2, 2))),
        "five pairs": _slopes(5),
    },
    picture=_stacked_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_stacked.mistakes = {
    "R stands in every block: each measurement has a noise of its own": (
        "np.kron(np.eye(len(H)), R) => np.tile(R, (len(H), len(H)))"
    ),
    "the blocks off the diagonal are empty: all pairs share the error of the state": (
        lambda H, P, R: np.kron(np.eye(len(H)), np.ones((2, 2))) * stacked_cov(H, P, R)
    ),
    "R is missing: the sensor has noise too": " + np.kron(np.eye(len(H)), R) => ",
    "R stands in the first block only: every measurement has noise": (
        "np.eye(len(H)) => np.diag([1.0] + [0.0] * (len(H) - 1))"
    ),
    "only the diagonal of R was used: range and bearing may err together": (
        "np.kron(np.eye(len(H)), R) => np.kron(np.eye(len(H)), np.diag(np.diag(R)))"
    ),
    "P is missing: the innovations share the uncertainty of the state, A P A^T": (
        "A @ P @ A.T => A @ A.T"
    ),
    "R counts twice": ", R) => , 2 * R)",
    "R is spread the wrong way: the order is first range, first bearing, second range": (
        "np.kron(np.eye(len(H)), R) => np.kron(R, np.eye(len(H)))"
    ),
    "stacked in the wrong order: first pair's range and bearing, then the second pair's": (
        "H.reshape(-1, H.shape[2]) => H.transpose(1, 0, 2).reshape(-1, H.shape[2])",
        "np.kron(np.eye(len(H)), R) => np.kron(R, np.eye(len(H)))",
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: a bug to find
#
# `np.tile` puts R into every block: it says that all measurements have *the same* noise, not
# noise of the same size. With one pair there is one block, so the test could not see it. A test
# of something that is stacked needs at least two.

# %% [markdown] tags=["solution"]
# The other half of the formula is as easily lost. Without the blocks off the diagonal every pair
# has a robot of its own:

# %% active="ipynb" tags=["solution"]
# def alone(H, P, R):
#     return np.kron(np.eye(len(H)), np.ones((2, 2))) * stacked_cov(H, P, R)
#
# check_stacked(alone)

# %% [markdown] tags=["statement"]
# ## Exercise 6: back in the orchard
#
# Now assemble. A robot comes back among its trees and has lost its place by half a metre and five
# degrees. It measures several trees at once. Of all ways to pair measurements with trees, each
# tree at most once, take the largest set of pairs whose joint distance is inside the gate of its
# size; a part of such a set must be inside its own gate as well. Of equally large sets the one
# with the smallest joint distance counts. Measurements that are left over get -1.
#
# The check lets your search return to the orchard thirty times, with six trees and four
# measurements each. Nineteen of twenty measurements must get the right tree.


# %% tags=["exercise"]
def together(y: Array, H: Array, P: Array, R: Array, gates: Array) -> Ints:
    """Pair all measurements of one look with the map.

    Parameters
    ----------
    y : ndarray, shape (k, n, 2)
        Innovation of every measurement with every landmark (m, rad), wrapped.
    H : ndarray, shape (n, 2, d)
        Jacobian of each landmark's predicted measurement by the state.
    P : ndarray, shape (d, d)
        Covariance of the state.
    R : ndarray, shape (2, 2)
        Covariance of one measurement.
    gates : ndarray, shape (k,)
        Limits of the joint squared distance of 1, 2, ..., k pairs.

    Returns
    -------
    ndarray of int, shape (k,)
        Landmark of each measurement, -1 for none.
    """
    k, n = y.shape[:2]
    best = [0, 0.0, []]

    def search(j, pairs, distance):
        if len(pairs) + k - j < best[0]:
            return
        if j == k:
            if (len(pairs), -distance) > (best[0], -best[1]):
                best[:] = [len(pairs), distance, pairs]
            return
        for i in range(n):
            if i not in [row for _, row in pairs]:
                more = [*pairs, (j, i)]
                js, rows = [a for a, _ in more], [b for _, b in more]
                longer = joint_distance(y[js, rows], stacked_cov(H[rows], P, R))
                if longer < gates[len(more) - 1]:
                    search(j + 1, more, longer)
        search(j + 1, pairs, distance)

    search(0, [], 0.0)
    answer = np.full(k, -1)
    for j, i in best[2]:
        answer[j] = i
    return answer


# %% active="ipynb" tags=["try"]
# together(np.array([[[0.1, 0.0], [2.0, 0.5]]]), np.zeros((2, 2, 3)), np.eye(3),
#          0.04 * np.eye(2), np.array([9.21]))

# %% [markdown] tags=["hint"]
# Write a function inside that takes the number of a measurement and the pairs chosen so far. It
# tries every free landmark for this measurement, and that it belongs to none, and calls itself
# for the next measurement. Each part of the answer must be inside its own gate, so a set outside
# its gate need not be followed.

# %% [markdown] tags=["hint"]
# With `js` and `rows` the measurements and landmarks of a set of pairs, `y[js, rows]` are its
# innovations and `H[rows]` its Jacobians. `joint_distance` and `stacked_cov` do the rest.

# %% [markdown] tags=["hint"]
# When all measurements are decided, compare with the best set so far: more pairs win, of as many
# the smaller distance. If even all measurements that are left could not make the set as large as
# the best one, turn back at once; the check will be quicker.


# %% tags=["cases"]
@drawn
def _back(
    rng: np.random.Generator,
    trees: int,
    seen: int,
    strangers: int = 0,
    echo: int = 0,
    mixed: bool = True,
    sigma: float = 0.05,
) -> Any:
    """Draw what a robot sees that has lost its place by half a metre and five degrees."""
    sensor = RangeBearing(sigma, np.radians(0.5))
    believed = np.zeros(3)
    truth = rng.normal(0, 1, 3) * [0.5, 0.5, 0.08]
    orchard = rng.uniform([2.0, -2.5], [6.0, 2.5], (trees, 2))
    P = np.diag([0.25, 0.25, 0.0064, *[0.0004] * (2 * trees)])
    in_map = orchard + rng.normal(0, 0.02, (trees, 2))
    which = rng.permutation(trees)[:seen] if mixed else np.arange(seen)
    which = np.append(which, which[:echo])
    z = sensor.observe(truth, orchard[which]) + rng.normal(0, 1, (len(which), 2)) * [
        0.05,
        0.0087,
    ]
    z = np.vstack([z, rng.uniform([2.0, -0.5], [6.0, 0.5], (strangers, 2))])
    y = sensor.residual(z[:, None], sensor.observe(believed, in_map)[None])
    H_pose, H_landmark = sensor.jacobians(believed, in_map)
    H = np.zeros((trees, 2, 3 + 2 * trees))
    H[:, :, :3] = H_pose
    for i in range(trees):
        H[i, :, 3 + 2 * i : 5 + 2 * i] = H_landmark[i]
    gates = chi2_quantile(0.99, 2 * np.arange(1, len(z) + 1))
    return np.round(y, 3), np.round(H, 3), P, sensor.cov, gates


def _often(n: int) -> Any:
    """Stack n looks back into the orchard; measurement j is of tree j."""
    rng = np.random.default_rng(3)
    observations = [_back(6, 4, mixed=False)(rng) for _ in range(n)]
    y, H = (np.array([look[k] for look in observations]) for k in (0, 1))
    return y, H, *observations[0][2:]


def _paired(associate: Function, y: Array, H: Array, P: Array, R: Array, gates: Array) -> Any:
    """Pair one look, or judge the pairs of many looks."""
    if y.ndim == 3:
        return associate(y, H, P, R, gates)
    rows = [associate(one, slopes, P, R, gates) for one, slopes in zip(y, H, strict=True)]
    share = np.mean(np.array(rows).reshape(len(y), -1) == np.arange(y.shape[1]))
    return "" if share >= 0.95 else f"expected 95 % of the trees named rightly, got {share:.0%}"


def _together_drawn(ax: Any, function: Any) -> None:
    """Draw trees, observations placed from the estimated pose, and the pairs that were made."""
    rng, sensor = np.random.default_rng(8), RangeBearing(0.05, np.radians(0.5))
    orchard = rng.uniform([2.0, -2.5], [6.0, 2.5], (7, 2))
    z = sensor.observe([0.6, -0.5, 0.06], orchard[:5])
    y = sensor.residual(z[:, None], sensor.observe(np.zeros(3), orchard)[None])
    H_pose, H_landmark = sensor.jacobians(np.zeros(3), orchard)
    H = np.zeros((7, 2, 17))
    H[:, :, :3] = H_pose
    for i in range(7):
        H[i, :, 3 + 2 * i : 5 + 2 * i] = H_landmark[i]
    P = np.diag([0.25, 0.25, 0.0064, *[0.0004] * 14])
    gates = chi2_quantile(0.99, 2 * np.arange(1, 6))
    rows = function(y, H, P, sensor.cov, gates)
    _pairs_drawn(ax, orchard, sensor.locate(np.zeros(3), z), rows)


check_together = Check(
    together,
    "rows",
    {
        "one measurement, one tree": _back(1, 1),
        "two trees": _back(2, 2, sigma=0.08),
        "three of four trees": _back(4, 3),
        "a look with a measurement of nothing": _back(4, 3, strangers=1),
        "more measurements than trees": _back(2, 2, strangers=2),
        "a tree that was measured twice": _back(3, 2, echo=1),
        "trees whose errors are opposite cannot be off to one side": (
            [[[3.0, 0.0], [30.0, 30.0]], [[30.0, 30.0], [2.5, 0.0]]],
            np.eye(4).reshape(2, 2, 4),
            4.0 * np.eye(4) - 3.8 * np.eye(4)[[2, 3, 0, 1]],
            0.1 * np.eye(2),
            [9.21, 13.28],
        ),
        "range and bearing that err together": (
            [[[2.0, 2.0]]],
            np.zeros((1, 2, 3)),
            np.eye(3),
            [[1.0, -0.9], [-0.9, 1.0]],
            [9.21],
        ),
        "a pair that only the gate of two would let pass": (
            [[[3.2, 0.0]], [[9.0, 9.0]]],
            np.zeros((1, 2, 3)),
            np.eye(3),
            np.eye(2),
            [9.21, 13.28],
        ),
        "two pairs just inside the gate of two": (
            [[[2.5, 0.0], [30.0, 30.0]], [[30.0, 30.0], [2.6, 0.0]]],
            np.zeros((2, 2, 3)),
            np.eye(3),
            np.eye(2),
            [9.21, 13.28],
        ),
        "exactly on the gate is not inside": (
            [[[2.0, 0.0]]],
            np.zeros((1, 2, 3)),
            np.eye(3),
            np.eye(2),
            [4.0],
        ),
        "nothing was measured": lambda rng: (*_back(3, 0)(rng)[:4], np.zeros(0)),
        "no trees in the map": (
            np.zeros((2, 0, 2)),
            np.zeros((0, 2, 3)),
            np.eye(3),
            np.eye(2),
            [9.21, 13.28],
        ),
        "thirty returns to the orchard": _often(30),
    },
    use=_paired,
    edges=("nothing was measured", "no trees in the map"),
    picture=_together_drawn,
)


# %% tags=["mistakes"]
def _by_singles(measure: Function) -> Function:
    """Return an association that pairs by single distances alone."""

    def wrong(y: Array, H: Array, P: Array, R: Array, gates: Array) -> Any:
        S = H @ P @ H.transpose(0, 2, 1) + R
        distance = np.array([_squared(one, S) for one in y]).reshape(y.shape[:2])
        return measure(distance, gates[0] if len(gates) else 0.0)

    return wrong


def _greedy(y: Array, H: Array, P: Array, R: Array, gates: Array) -> Any:
    """Take the best pair that still fits those taken, and never give one back."""
    S = H @ P @ H.transpose(0, 2, 1) + R
    distance = np.array([_squared(one, S) for one in y]).reshape(y.shape[:2])
    pairs: list[tuple[int, int]] = []
    for flat in np.argsort(distance, axis=None).tolist():
        j, i = divmod(flat, y.shape[1])
        if j in [a for a, _ in pairs] or i in [b for _, b in pairs]:
            continue
        more = [*pairs, (j, i)]
        js, rows = map(list, zip(*more, strict=True))
        if joint_distance(y[js, rows], stacked_cov(H[rows], P, R)) < gates[len(pairs)]:
            pairs = more
    answer = np.full(len(y), -1)
    for j, i in pairs:
        answer[j] = i
    return answer


check_together.mistakes = {
    "each tree was paired by itself: pairs that fit one by one need not fit together": (
        _by_singles(best_first)
    ),
    "each took its nearest tree: pairs that fit one by one need not fit together": (
        _by_singles(_each_its_nearest)
    ),
    "the best pair was taken first and never given back: try other sets too": _greedy,
    "the single distances were added: one pose error is in all of them, use the joint distance": (
        "longer = joint_distance(y[js, rows], stacked_cov(H[rows], P, R))"
        " => longer = sum(joint_distance(y[[a], [b]], stacked_cov(H[[b]], P, R)) for a, b in more)"
    ),
    "the pairs were only tried one by one: the whole set must be inside its gate": (
        "longer < gates[len(more) - 1]"
        " => joint_distance(y[[j], [i]], stacked_cov(H[[i]], P, R)) < gates[0]"
    ),
    "the gate of a single pair was used for all: m pairs have the gate number m": (
        "gates[len(more) - 1] => gates[0]"
    ),
    "the gate of all measurements was used for every set: m pairs have the gate number m": (
        "gates[len(more) - 1] => gates[-1]"
    ),
    "no gate was used": "if longer < gates[len(more) - 1]: => if True:",
    "a tree was given to two measurements": ("if i not in [row for _, row in pairs]: => if True:"),
    "a measurement may also be of no tree: try that as well": (
        "        search(j + 1, pairs, distance) =>         pass"
    ),
    "the first of the largest sets was returned: expected the nearest of equally large ones": (
        "(len(pairs), -distance) > (best[0], -best[1]) => len(pairs) > best[0]"
    ),
    "the farthest of the largest sets was returned": (
        "(len(pairs), -distance) > (best[0], -best[1])"
        " => (len(pairs), distance) > (best[0], best[1])"
    ),
    "nothing was paired: expected the largest set": (
        lambda y, H, P, R, gates: np.full(len(y), -1)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 6: back in the orchard
#
# A search that goes deep first: one measurement after the other, each landmark or none. Two
# things cut it short: a set outside its gate is not followed, and neither is one that cannot
# become as large as the best.

# %% [markdown] tags=["solution"]
# The short way is to take the best pair first and to keep whatever fits it. It uses the joint
# distance too, and yet half of the trees get a wrong name or none: the first pair is never given
# back, right or wrong, and all others are then measured against it.

# %% active="ipynb" tags=["solution"]
# def greedy(y, H, P, R, gates):
#     S = H @ P @ H.transpose(0, 2, 1) + R
#     distance = np.einsum("kni,nij,knj->kn", y, np.linalg.inv(S), y)
#     pairs = []
#     for flat in np.argsort(distance, axis=None).tolist():
#         j, i = divmod(flat, y.shape[1])
#         js, rows = [a for a, _ in pairs] + [j], [b for _, b in pairs] + [i]
#         if j not in js[:-1] and i not in rows[:-1]:
#             S = stacked_cov(H[rows], P, R)
#             if joint_distance(y[js, rows], S) < gates[len(pairs)]:
#                 pairs = pairs + [(j, i)]
#     answer = np.full(len(y), -1)
#     for j, i in pairs:
#         answer[j] = i
#     return answer
#
# check_together(greedy)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 11](../solutions/11_data_association.ipynb).
