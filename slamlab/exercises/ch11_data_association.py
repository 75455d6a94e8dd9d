"""Exercises, chapter 11: gates, a missing echo, pair by pair, clear pairs, searches for all pairs.

P4 (2a), (2b) with the gate that page 84 lacks; joint compatibility after Neira and Tardos (2001).
"""

# mypy: disable-error-code="return-value, no-untyped-def, attr-defined, var-annotated"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, drawn
from slamlab.exercises._report import Array, Check, Function, Ints
from slamlab.gaussian import chi2_quantile
from slamlab.sensors import RangeBearing

__all__ = [
    "check_clear_pairs",
    "check_gate",
    "check_most_pairs",
    "check_nearest",
    "check_one_by_one",
    "check_together",
]


# %% [markdown] tags=["chapter"]
# # Exercises 11: data association
#
# Six exercises that decide which tree is which: a gate with a pencil, a tree without an echo,
# pairs that are tested one after the other, a robot that prefers no pair to a wrong one, a search
# with a bug, and a search that brings a robot back into its orchard twenty-four times, and then
# drives the lesson's lap. The chapter is [Data association](../11_data_association.ipynb). Replace
# each `...` and run the check below it as often as you like; then draw what you built beside what
# is expected.

# %% [markdown] tags=["solution"]
# # Solutions 11: data association
#
# The exercises are in [Exercises 11](../exercises/11_data_association.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
#
# from slamlab.sensors import RangeBearing

# %% [markdown] tags=["statement"]
# ## Exercise 1: a gate for a whole scan, with a pencil
#
# A robot with satellite positioning knows its place and its trees to 2 cm, and its laser measures
# to 5 cm. It measures eight trees in each scan. Its gate is the lesson's 9.21: one true pair in a
# hundred is outside, so now and then a tree that it knows well is left out of a scan. It wants
# *all* true pairs of a scan to pass, with a given probability. How wide must the gate of a single
# pair be?
#
# What is left in an innovation here is nearly the noise of the laser alone, which is drawn anew
# for each tree. So take the pairs as independent.
#
# Begin on paper. In the plane, with the covariance taken out, the innovation has the density
# $e^{-(a^2+b^2)/2}/(2\pi)$. Go to polar coordinates and integrate: what is $P(D^2 < c)$? Then let
# $n$ independent pairs pass.
#
# And a guess: a robot that has lost its place by half a metre has the *same* error of its pose in
# all eight innovations, so they are not independent. Is your gate too narrow for it, or wider than
# it need be? Write it down.


# %% tags=["exercise"]
def gate_for(share: float, pairs: int) -> float:
    """Gate that all true pairs pass together.

    Parameters
    ----------
    share : float
        Probability that all of them pass, between 0 and 1.
    pairs : int
        How many there are, at least 1. They are independent.

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
    """Draw the gate of a pair against the number of pairs, for two probabilities of all."""
    from slamlab import plots

    pairs = np.arange(1, 21)
    d2 = (np.random.default_rng(0).normal(size=(100_000, 8, 2)) ** 2).sum(-1)
    for share, marker in ((0.99, "o"), (0.9, "s")):
        gates = [float(function(share, int(n))) for n in pairs]
        ax.plot(pairs, gates, marker=marker, markersize=4, color=plots.COLOURS["estimate"])
        ax.text(20.4, gates[-1], f"{share:.0%}", va="center")
        if share == 0.99:
            ax.set_title(
                f"8 pairs, 99 %:\n{np.mean((d2 < gates[7]).all(1)):.1%} of scans complete"
            )
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
    "this is P(D^2 < c) = share to the power n: each pair must pass more often, not less often": (
        "share ** (1 / pairs) => share**pairs"
    ),
    "misses were added: that they are all avoided is a product": (
        "1 - share ** (1 / pairs) => (1 - share) / pairs"
    ),
    "this is the distance: the gate is for its square": (
        lambda share, pairs: np.sqrt(gate_for(share, pairs))
    ),
    "this many are outside, and the rest inside: P(D^2 < c) = 1 - exp(-c/2)": (
        "1 - share ** (1 / pairs) => share ** (1 / pairs)"
    ),
    "this is the probability of one pair: expected its gate": (
        lambda share, pairs: share ** (1 / pairs)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: a gate for a whole scan, with a pencil
#
# In polar coordinates the angle gives $2\pi$, and $u = r^2/2$ leaves $\int_0^{c/2} e^{-u}\, du$:
# $P(D^2 < c) = 1 - e^{-c/2}$. All $n$ pairs pass with $(1 - e^{-c/2})^n$. Set this equal to the
# share and solve for $c$.

# %% [markdown] tags=["solution"]
# And numerically: a hundred thousand scans with eight true pairs each. The gate of a single pair
# loses one true pair in a hundred, and so one scan in thirteen is not complete.

# %% active="ipynb" tags=["solution"]
# d2 = (np.random.default_rng(0).normal(size=(100_000, 8, 2)) ** 2).sum(-1)
# for pairs in (1, 8):
#     gate = gate_for(0.99, pairs)
#     share = np.mean((d2 < gate).all(1))
#     print(f"gate {gate:5.2f}: all eight pairs pass in {share:.1%} of the scans")

# %% active="ipynb" tags=["solution"]
# check_gate(lambda share, pairs: -2 * np.log(1 - share))

# %% [markdown] tags=["solution"]
# And the guess? Ten orchards with eight trees each, measured by a robot that is 2 cm off in its
# place, and by one that is half a metre off (with five degrees). For each: how often your gate
# lets all eight pass, and which gate would have been enough for 99 %.

# %% active="ipynb" tags=["solution"]
# rng, sensor = np.random.default_rng(1), RangeBearing(0.05, 0.01)
# for sigmas in ([0.02, 0.02, 0.003], [0.5, 0.5, 0.08]):
#     complete, enough = [], []
#     for _ in range(10):
#         trees = rng.uniform([2, -4], [8, 4], (8, 2))
#         H = sensor.jacobians(np.zeros(3), trees)[0]
#         S = H @ np.diag(sigmas) ** 2 @ H.transpose(0, 2, 1) + sensor.cov
#         off = rng.normal(0, sigmas, (20_000, 3))       # one pose error a scan
#         noise = rng.normal(0, [0.05, 0.01], (20_000, 8, 2))
#         y = np.einsum("nij,kj->kni", H, off) + noise
#         d2 = np.einsum("kni,nij,knj->kn", y, np.linalg.inv(S), y)
#         complete.append(np.mean((d2 < gate_for(0.99, 8)).all(1)))
#         enough.append(np.quantile(d2.max(1), 0.99))
#     print(f"{sigmas[0]} m off: {min(complete):.1%} to {max(complete):.1%} complete, "
#           f"enough would be {min(enough):.1f} to {max(enough):.1f}")

# %% [markdown] tags=["solution"]
# With 2 cm the pairs are as good as independent. With half a metre they pass together and miss
# together, so all of them pass *more* often than the product says: your gate is wider than it need
# be. It is never too narrow, as long as the errors are Gaussian (the Gaussian correlation
# inequality, proved by Royen in 2014). The price is room for neighbours: the area of a gate grows
# with $c$, here by about a quarter.

# %% [markdown] tags=["statement"]
# ## Exercise 2: a tree without an echo
#
# It rains. A robot measures the bearing of a tree with its camera, but wet bark gives its laser no
# echo, and the range is `nan`. For the next tree there is a range, and no bearing. The
# lesson's gate wants both, so the robot throws away half of what it measures. Find the
# nearest landmark, that with the smallest $D^2$, for a measurement of which a number may be
# missing.
#
# One measurement has an innovation with each of $n$ landmarks, $D^2 = y^\top S^{-1} y$. What is
# missing is missing in all $n$ rows. The two errors are correlated: a robot that does not know how
# far it has driven is off in range *and* in bearing. So think first: what does the camera alone
# tell, and which covariance has it? The gate depends on how many numbers are compared: 6.63
# for one, 9.21 for two.
#
# In the picture a ray is a bearing without a range, and an arc a range without a bearing; it ends
# at the tree that you give. Blue went to the right tree, purple to a wrong one. What you refuse
# is grey and dotted: a short ray, or an arc beside its true tree.


# %% tags=["exercise"]
def nearest(y: Array, S: Array, gates: Array) -> int:
    """Landmark with the smallest distance to a measurement that may lack a number.

    Parameters
    ----------
    y : ndarray, shape (n, 2)
        Innovation of the measurement with each landmark (m, rad), wrapped. A column is
        nan where the range, or the bearing, was not measured. n may be 0.
    S : ndarray, shape (n, 2, 2)
        Covariance of each innovation, as if both had been measured.
    gates : ndarray, shape (2,)
        Limits of the squared Mahalanobis distance of one number, and of two. Exactly on
        the limit is outside.

    Returns
    -------
    int
        Row of the landmark with the smallest squared Mahalanobis distance; -1 if that
        is outside the gate, or nothing was measured.
    """
    met = np.flatnonzero(~np.isnan(y).any(axis=0))
    if len(y) == 0 or len(met) == 0:
        return -1
    y, S = y[:, met], S[:, met][:, :, met]
    distance = (y * np.linalg.solve(S, y[..., None])[..., 0]).sum(1)
    row = np.argmin(distance)
    return row if distance[row] < gates[len(met) - 1] else -1


# %% active="ipynb" tags=["try"]
# S = np.array([[[0.25, 0.09], [0.09, 0.04]]] * 2)
# nearest(np.array([[np.nan, 0.5], [np.nan, -0.3]]), S, np.array([6.63, 9.21]))

# %% [markdown] tags=["hint"]
# The bearing alone is a Gaussian with one number. Which entry of $S$ is its variance? Must you
# invert anything before you take it?

# %% [markdown] tags=["hint"]
# `np.isnan(y).any(axis=0)` tells which columns are missing. Keep the others of $y$, and the rows
# and columns of $S$ that belong to them; then all is as in the lesson, with one number or two.

# %% [markdown] tags=["hint"]
# `S[:, met][:, :, met]` keeps rows, then columns, of every matrix.
# `np.linalg.solve(S, y[..., None])[..., 0]` gives $S^{-1} y$ for all landmarks at once.


# %% tags=["cases"]
_TWO_GATES = np.array([6.635, 9.21])


def _scene(rng: np.random.Generator) -> Any:
    n = int(rng.integers(1, 8))
    S = np.array([a_covariance(rng, 2, size) for size in rng.uniform(0.05, 2, n)])
    y = np.round(rng.normal(0, 2, (n, 2)), 2)
    lacks = int(rng.integers(0, 3))
    if lacks < 2:
        y[:, lacks] = np.nan
    return y, S, np.round(_TWO_GATES * rng.uniform(0.5, 1.2), 2)


_ROUND, _WIDE = np.diag([0.04, 0.01]), np.diag([4.0, 1.0])
_SLANTED = np.array([[1.0, 0.95], [0.95, 1.0]])
_NO = np.nan


def _nearest_drawn(ax: Any, function: Any) -> None:
    """Draw bearings alone (rays) and ranges alone (arcs): right blue, wrong purple, refused dotted.

    The first 48 of 240, and of the others those that are not right.
    """
    from slamlab import plots

    sensor, rng = RangeBearing(0.05, np.radians(1)), np.random.default_rng(11)
    trees = np.array([[1.7, 2.5], [4.4, -1.2], [5.6, 2.6], [5.2, -5.2]])
    pose_cov, pose = np.diag([0.3, 0.02, 0.01]) ** 2, np.zeros(3)
    H = sensor.jacobians(pose, trees)[0]
    S = H @ pose_cov @ H.transpose(0, 2, 1) + sensor.cov
    right = wrong = 0
    expected = sensor.observe(pose, trees)
    for k in range(240):
        true, lacks = k % 4, (k // 4) % 2
        truth = rng.multivariate_normal(np.zeros(3), pose_cov)
        z = sensor.observe(truth, trees[true]) + rng.normal(0, 1, 2) * np.sqrt(np.diag(sensor.cov))
        y = sensor.residual(z, expected)
        y[:, lacks] = np.nan
        row = int(function(y, S, _TWO_GATES))
        right, wrong = right + (row == true), wrong + (row not in (true, -1))
        if k < 48 or row != true:
            colour = plots.COLOURS["estimate" if row == true else "wrong"]
            turn = z[1] if lacks == 0 else expected[row, 1] + np.linspace(-0.12, 0.12, 9)
            far = np.array([0.0, expected[row, 0]]) if lacks == 0 else np.full(9, z[0])
            style = {"color": colour}
            if row < 0:  # refused: a short grey ray, or an arc at its true tree
                style = {"color": "0.4", "ls": ":"}
                far = np.array([0.0, 1.4]) if lacks == 0 else far
                turn = turn if lacks == 0 else expected[true, 1] + np.linspace(-0.12, 0.12, 9)
            ax.plot(far * np.cos(turn), far * np.sin(turn), lw=0.9, alpha=0.8, **style)
    plots.landmarks(ax, trees)
    ax.set_title(f"{right} of 240 right,\n{wrong} wrong, {240 - right - wrong} refused")
    ax.set(xlabel="x (m)", ylabel="y (m)", xlim=(-0.3, 7.0), ylim=(-6.0, 3.8), aspect="equal")


check_nearest = Check(
    nearest,
    "row",
    {
        "both numbers, as in the lesson": ([[0.3, 0.1], [0.1, 0.05]], [_ROUND] * 2, _TWO_GATES),
        "both numbers, correlated": ([[1.0, -1.0], [1.3, 1.3]], [_SLANTED] * 2, _TWO_GATES),
        "no echo: the bearing alone": ([[_NO, 0.2], [_NO, 0.15]], [_ROUND] * 2, _TWO_GATES),
        "no picture: the range alone": ([[0.3, _NO], [0.2, _NO]], [_ROUND] * 2, _TWO_GATES),
        "the uncertain tree is nearer in sigmas": (
            [[_NO, 0.25], [_NO, 0.5]],
            [_ROUND, _WIDE],
            _TWO_GATES,
        ),
        "a bearing with a correlated range that is missing": (
            [[_NO, 1.2], [_NO, 2.9]],
            [_SLANTED] * 2,
            _TWO_GATES,
        ),
        "a correlated pair, the other a little nearer": (
            [[_NO, 1.2], [_NO, 1.4]],
            [_SLANTED, np.array([[1.0, 0.1], [0.1, 1.0]])],
            _TWO_GATES,
        ),
        "one number, between the two gates": ([[2.8, _NO]], [np.eye(2)], _TWO_GATES),
        "two numbers, between the two gates": ([[2.8, 0.3]], [np.eye(2)], _TWO_GATES),
        "two numbers, outside both gates": ([[3.5, 0.3]], [np.eye(2)], _TWO_GATES),
        "exactly on the gate is outside": ([[_NO, 2.0]], [np.eye(2)], [4.0, 9.0]),
        "nothing inside the gate": ([[_NO, 1.5], [_NO, -1.2]], [_ROUND] * 2, _TWO_GATES),
        "nothing was measured": ([[_NO, _NO], [_NO, _NO]], [_ROUND] * 2, _TWO_GATES),
        "no landmarks yet": (np.zeros((0, 2)), np.zeros((0, 2, 2)), _TWO_GATES),
        "the nearest of several inside": (
            [[0.2, _NO], [0.05, _NO], [0.3, _NO], [0.1, _NO]],
            [_ROUND] * 4,
            _TWO_GATES,
        ),
        "any scene": _scene,
    },
    draws=12,
    edges=("no landmarks yet", "nothing was measured"),
    picture=_nearest_drawn,
)


# %% tags=["mistakes"]
def _squared(y: Array, S: Array) -> Any:
    return np.einsum("ni,nij,nj->n", y, np.linalg.inv(S), y)


def _with_zero(y: Array, S: Array, gates: Array) -> Any:
    """Write a zero for what is missing."""
    n = int((~np.isnan(y).any(axis=0)).sum())
    if n == 0 or len(y) == 0:
        return -1
    distance = _squared(np.nan_to_num(y), S)
    return int(np.argmin(distance)) if distance.min() < gates[n - 1] else -1


def _only_whole(y: Array, S: Array, gates: Array) -> Any:
    return -1 if np.isnan(y).any() else nearest(y, S, gates)


_KEPT = "distance = (y * np.linalg.solve(S, y[..., None])[..., 0]).sum(1) => distance = "

check_nearest.mistakes = {
    "a zero for what is missing says that it was exactly as expected: leave its row and column "
    "out of S": _with_zero,
    "a zero for what is missing, and the gate of two": (
        lambda y, S, gates: _with_zero(y, S, gates[[1, 1]])
    ),
    "what lacks a number was thrown away: the other number can still tell": _only_whole,
    "one number has the gate of one, 6.63: this is the gate of two for all": (
        "gates[len(met) - 1] => gates[1]"
    ),
    "two numbers have the gate of two, 9.21: this is the gate of one for all": (
        "gates[len(met) - 1] => gates[0]"
    ),
    "the two gates are exchanged": "gates[len(met) - 1] => gates[2 - len(met)]",
    "S was multiplied, not inverted: a large covariance must make the distance small": (
        "np.linalg.solve(S, y[..., None]) => (S @ y[..., None])"
    ),
    "the distance is Euclidean: metres and radians know nothing of the covariance": (
        _KEPT + "(y**2).sum(1)"
    ),
    "only the diagonal of S was used: where both are measured they are correlated": (
        _KEPT + "(y**2 / np.diagonal(S, axis1=1, axis2=2)).sum(1)"
    ),
    "the gate is for the squared distance: no square root": (
        _KEPT + "np.sqrt((y * np.linalg.solve(S, y[..., None])[..., 0]).sum(1))"
    ),
    "the gate was not used: a landmark out of reach is no match": (
        "< gates[len(met) - 1] => < np.inf"
    ),
    "exactly on the gate is outside": "distance[row] < => distance[row] <=",
    "the first landmark inside the gate is not always the nearest": (
        "np.argmin(distance) => np.argmax(distance < gates[len(met) - 1])"
    ),
    "this is the farthest landmark": "argmin => argmax",
    "rows begin at 0: these are one too large": (
        lambda *given: nearest(*given) + (nearest(*given) >= 0)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: a tree without an echo
#
# The bearing alone is distributed with the variance that it has in $S$: what is not measured is
# left out of $y$, and its row and column out of $S$. Only then $S$ is inverted.

# %% [markdown] tags=["solution"]
# A zero for the missing range looks harmless. It says: *the range was measured, and it is exactly
# as expected*. Then the robot has driven as far as it believes, its bearing must be right too, and
# true pairs are outside the gate:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: to which tree a measurement goes: a bearing alone (ray) or a range alone (arc); on the left fewer right pairs and more that are refused."}}
# def with_zero(y, S, gates):
#     met = ~np.isnan(y).any(axis=0)
#     if len(y) == 0 or not met.any():
#         return -1
#     y = np.nan_to_num(y)
#     distance = np.einsum("ni,nij,nj->n", y, np.linalg.inv(S), y)
#     row = np.argmin(distance)
#     return row if distance[row] < gates[met.sum() - 1] else -1
#
# check_nearest.draw(with_zero)

# %% [markdown] tags=["statement"]
# The same few lines serve a camera without any range, and a radio without any bearing.
#
# ## Exercise 3: one pair after the other
#
# A robot is 0.8 m further on than it believes. It has made six pairs; each is inside its gate, and
# together they are far outside theirs. Which one is wrong? The joint distance of the lesson, one
# number from one large matrix, does not tell. So test the pairs **one after the other**: after
# each, correct the filter with it, and test the next against what the filter knows then.
#
# Return the squared distance of each pair, given those before it. First on paper, for two ranges
# on a line: $h = 1$ for both, $P = 1$, $R = 0.01$. Both innovations are 0.8. How large is the
# second distance? And if the second innovation is $-0.8$? What is the sum of the two, and of
# which matrix is it the distance?
#
# Chapter 02 in one line: with $S = HPH^\top + R$ and $K = PH^\top S^{-1}$ the state moves by
# $K r$, where $r$ is the innovation, and its covariance becomes $P - KSK^\top$. The Jacobians
# stay as they are given.


# %% tags=["exercise"]
def one_by_one(y: Array, H: Array, P: Array, R: Array) -> Array:
    """Squared distance of each pair, given the pairs before it.

    Parameters
    ----------
    y : ndarray, shape (m, 2)
        Innovations of the pairs (m, rad), all computed with the state before the scan.
    H : ndarray, shape (m, 2, d)
        Their Jacobians by the state, pose and landmarks.
    P : ndarray, shape (d, d)
        Covariance of the state before the scan.
    R : ndarray, shape (2, 2)
        Covariance of one measurement. Each has noise of its own.

    Returns
    -------
    ndarray, shape (m,)
        The filter has been corrected with pairs 0 to j - 1 when pair j is tested.
    """
    moved, distances = np.zeros(len(P)), []
    for innovation, A in zip(y, H):
        S = A @ P @ A.T + R
        rest = innovation - A @ moved
        distances.append(rest @ np.linalg.solve(S, rest))
        K = P @ A.T @ np.linalg.inv(S)
        moved = moved + K @ rest
        P = P - K @ S @ K.T
    return np.array(distances)


# %% active="ipynb" tags=["try"]
# H, y = np.array([np.eye(2)] * 2), np.array([[0.8, 0.0], [0.8, 0.0]])
# one_by_one(y, H, np.eye(2), 0.01 * np.eye(2))

# %% [markdown] tags=["hint"]
# On paper: $S = 1.01$, and after the first pair the state has moved by $0.8/1.01$ and has the
# variance 0.0099. What does the filter expect of the second measurement now?

# %% [markdown] tags=["hint"]
# All innovations were computed before the scan. Once the state has moved by $\delta$, the
# expected measurement has moved by $H\delta$: what is left of the innovation?

# %% [markdown] tags=["hint"]
# Carry two things from pair to pair: $P$, and how far the state has moved in all. Test a pair
# *before* you correct with it.


# %% tags=["cases"]
@drawn
def _pairs(rng: np.random.Generator, m: int) -> Any:
    d = int(rng.integers(3, 8))
    H = np.round(rng.normal(0, 1, (m, 2, d)), 2)
    return np.round(rng.normal(0, 0.7, (m, 2)), 2), H, a_covariance(rng, d), a_covariance(rng, 2)


def _own_states(rng: np.random.Generator) -> Any:
    H = np.zeros((2, 2, 4))
    H[0, :, :2], H[1, :, 2:] = np.round(rng.normal(0, 1, (2, 2, 2)), 2)
    P = np.zeros((4, 4))
    P[:2, :2], P[2:, 2:] = a_covariance(rng, 2), a_covariance(rng, 2)
    return np.round(rng.normal(0, 0.7, (2, 2)), 2), H, P, a_covariance(rng, 2)


def _jacobians(sensor: RangeBearing, pose: Array, landmarks: Array) -> Array:
    """Give the Jacobians (n, 2, 3 + 2n) by pose and landmarks."""
    n = len(landmarks)
    H_pose, H_landmark = sensor.jacobians(pose, landmarks)
    H = np.zeros((n, 2, 3 + 2 * n))
    H[:, :, :3] = H_pose
    for i in range(n):
        H[i, :, 3 + 2 * i : 5 + 2 * i] = H_landmark[i]
    return H


def _one_by_one_drawn(ax: Any, function: Any) -> None:
    """Draw the distance of each of six pairs: all right (blue), the fourth wrong (purple)."""
    from slamlab import plots

    sensor, believed = RangeBearing(0.1, 0.02), np.zeros(3)
    trees = np.column_stack([np.arange(8.0), np.full(8, 2.0)])
    z = sensor.observe([0.8, 0, 0], trees[[1, 2, 3, 5, 6, 7]])
    H, P = _jacobians(sensor, believed, trees), np.diag([0.25, 0.01, 1e-4, *[0.002] * 16])
    expected, sums, place = sensor.observe(believed, trees), [], np.arange(1, 7)
    for chosen, kind in (([1, 2, 3, 5, 6, 7], "estimate"), ([1, 2, 3, 4, 6, 7], "wrong")):
        y = sensor.residual(z, expected[chosen])
        steps = np.asarray(function(y, H[chosen], P, sensor.cov), float)
        drawn_as = plots.line_style(kind)
        ax.plot(place, np.log10(np.maximum(steps, 1e-3)), marker="o", **drawn_as)
        sums.append(steps.sum())
    ax.axhline(np.log10(9.21), color="0.5", lw=0.8)
    ax.text(0.9, 1.05, "gate of one pair", fontsize=8, va="bottom")
    ax.set_title(f"sum {sums[0]:.1f}; with a wrong\nfourth pair {sums[1]:.0f}, gate 26")
    ax.set(xlabel="pair", ylabel="$D^2$, given those before", ylim=(-3, 3), xticks=place)
    ax.set_yticks([-2, 0, 2], ["0.01", "1", "100"])


check_one_by_one = Check(
    one_by_one,
    "distance",
    {
        "a single pair": _pairs(1),
        "two ranges that agree": (
            [[0.8, 0.0], [0.8, 0.0]],
            [np.eye(2)] * 2,
            np.eye(2),
            0.01 * np.eye(2),
        ),
        "two ranges that differ": (
            [[0.8, 0.0], [-0.8, 0.0]],
            [np.eye(2)] * 2,
            np.eye(2),
            0.01 * np.eye(2),
        ),
        "two pairs": _pairs(2),
        "five pairs": _pairs(5),
        "two pairs that share nothing": _own_states,
        "the state is known: nothing to correct": lambda rng: (
            (given := _pairs(3)(rng))[0],
            given[1],
            0 * given[2],
            given[3],
        ),
        "as expected": lambda rng: (0 * (given := _pairs(2)(rng))[0], *given[1:]),
    },
    tolerance=1e-7,
    picture=_one_by_one_drawn,
)


# %% tags=["mistakes"]
check_one_by_one.mistakes = {
    "the filter was never corrected: these are the single distances": (
        "moved = moved + K @ rest => pass",
        "P = P - K @ S @ K.T => pass",
    ),
    "the filter was corrected, but the next innovation was not: what is left is y - H moved": (
        "innovation - A @ moved => innovation"
    ),
    "the state was corrected, but not its covariance": "P = P - K @ S @ K.T => pass",
    "the correction has the wrong sign: expected y - H moved": (
        "innovation - A @ moved => innovation + A @ moved"
    ),
    "only the last correction counts here: the state has moved by all of them": (
        "moved = moved + K @ rest => moved = K @ rest"
    ),
    "the state was corrected by the old innovation: use what is left of it": (
        "moved + K @ rest => moved + K @ innovation"
    ),
    "the covariance grows: a correction takes K S K^T off": (
        "P = P - K @ S @ K.T => P = P + K @ S @ K.T"
    ),
    "R is missing in S": "A @ P @ A.T + R => A @ P @ A.T + 1e-12 * R",
    "the distances were added up: expected that of each pair": (
        "return np.array(distances) => return np.cumsum(distances)"
    ),
    "this is the joint distance: expected one number per pair": (
        "return np.array(distances) => return np.sum(distances)"
    ),
    "these are square roots: the squared distance is asked for": (
        "return np.array(distances) => return np.sqrt(distances)"
    ),
    "a pair must be tested before the filter is corrected with it": (
        lambda y, H, P, R: _too_late(y, H, P, R)
    ),
    "the gain uses S, not its inverse": "np.linalg.inv(S) => S",
}


def _too_late(y: Array, H: Array, P: Array, R: Array) -> Array:
    """Test each pair after the filter was corrected with it."""
    moved, distances = np.zeros(len(P)), []
    for innovation, A in zip(y, H, strict=True):
        S = A @ P @ A.T + R
        K = P @ A.T @ np.linalg.inv(S)
        moved = moved + K @ (innovation - A @ moved)
        P = P - K @ S @ K.T
        rest = innovation - A @ moved
        distances.append(rest @ np.linalg.solve(A @ P @ A.T + R, rest))
    return np.array(distances)


# %% [markdown] tags=["solution"]
# ## Solution 3: one pair after the other
#
# On paper: the first distance is $0.64/1.01 = 0.63$. If both agree, the second is
# $(0.8 - 0.792)^2/0.0199 = 0.003$; if they differ, $(-0.8 - 0.792)^2/0.0199 = 127$. The sum is the
# joint distance: the density of all is that of the first times that of the second *given the
# first*, and so on. No term is negative: this is why a further pair never lowers $D^2$.

# %% active="ipynb" tags=["solution"]
# H = np.array([[[1.0, 0.0], [0.0, 1.0]]] * 2)
# A, R = H.reshape(4, 2), 0.01 * np.eye(2)
# S = A @ A.T + np.kron(np.eye(2), R)
# for second in (0.8, -0.8):
#     y = np.array([[0.8, 0.0], [second, 0.0]])
#     joint = y.ravel() @ np.linalg.solve(S, y.ravel())
#     steps = one_by_one(y, H, np.eye(2), R)
#     print(steps.round(3), "sum", steps.sum().round(3), "joint", joint.round(3))

# %% [markdown] tags=["solution"]
# The jump is at the pair that does not fit *those before it*. Three ranges on the same line, one
# of them wrong, in three orders:

# %% active="ipynb" tags=["solution"]
# for line in ([0.8, 0.8, -0.8], [0.8, -0.8, 0.8], [-0.8, 0.8, 0.8]):
#     y = np.column_stack([line, np.zeros(3)])
#     steps = one_by_one(y, H[[0, 0, 0]], np.eye(2), R)
#     print(line, "->", steps.round(2), "sum", steps.sum().round(1))

# %% [markdown] tags=["solution"]
# The sum is the same in any order. In the last line the wrong pair comes first, and a *right* one
# jumps; the steps are those of the line above. Where two pairs contradict each other, these two
# numbers cannot tell which is wrong: a third pair can, if both sets are tried. This is why
# exercise 6 tries sets, and does not keep the first pair come what may.

# %% [markdown] tags=["solution"]
# Without the correction these are the single distances. All are inside the gate, and the wrong set
# has the smaller sum:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: the distance of each of six pairs: all right (blue), the fourth wrong (purple); on the left the wrong pair is inside a gate of its own as well."}}
# def singles(y, H, P, R):
#     S = H @ P @ H.transpose(0, 2, 1) + R
#     return np.einsum("ni,nij,nj->n", y, np.linalg.inv(S), y)
#
# check_one_by_one.draw(singles)

# %% [markdown] tags=["statement"]
# The sum of your distances *is* the joint distance, without the large $S$, and you see where it
# jumps: that pair does not fit those before it. Before you read on: where would it jump if the
# *first* pair were the wrong one? Exercise 6 searches with your sum.
#
# ## Exercise 4: rather none than a wrong one
#
# A robot that plants between old trees must not take one tree for another: a wrong pair moves it
# into the next row. It would rather leave a tree out. So it makes a pair only if it is **clear**:
# inside the gate, and every other distance of the same measurement, and every other distance of
# the same landmark, is larger by `margin` or more.
#
# $k$ measurements, $n$ landmarks, one table of squared distances. The lesson takes the best pair
# first, then the best of what is left, in a loop. Think first: can two clear pairs want the same
# landmark? Does it matter in which order you take them?


# %% tags=["exercise"]
def clear_pairs(distance: Array, gate: float, margin: float) -> Ints:
    """Pairs without a second-best match.

    Parameters
    ----------
    distance : ndarray, shape (k, n)
        Squared Mahalanobis distances; k and n may be 0.
    gate : float
        A pair with a distance below it may be taken; exactly on it is outside.
    margin : float
        Larger than 0. How much larger every other distance in the row and in the column
        of a pair must be, inside the gate or not; exactly so much is enough.

    Returns
    -------
    ndarray of int, shape (k,)
        Landmark of each measurement, -1 for none.
    """
    rows = np.full(len(distance), -1)
    for j, i in np.argwhere(distance < gate):
        others = np.append(np.delete(distance[j], i), np.delete(distance[:, i], j))
        if (others >= distance[j, i] + margin).all():
            rows[j] = i
    return rows


# %% active="ipynb" tags=["try"]
# clear_pairs(np.array([[1.0, 30.0, 9.5], [8.0, 2.0, 3.0]]), 9.21, 4.0)

# %% [markdown] tags=["hint"]
# In the call above, which other distances does the pair of measurement 0 and landmark 0 meet? And
# the pair of 1 and 1?

# %% [markdown] tags=["hint"]
# If a clear pair is the smallest of its row and of its column, by a margin, then no other pair of
# that row or column is clear. Judge every pair by itself: nothing has to be crossed out.

# %% [markdown] tags=["hint"]
# `np.delete(distance[j], i)` is row $j$ without entry $i$; `np.argwhere(distance < gate)` lists
# the pairs inside the gate.


# %% tags=["cases"]
def _table(rng: np.random.Generator) -> Any:
    k, n = rng.integers(1, 7, 2)
    table = rng.uniform(3, 40, (k, n))
    close = min(k, n)
    table[rng.permutation(k)[:close], rng.permutation(n)[:close]] = rng.uniform(0.1, 11, close)
    return table, np.round(rng.uniform(6, 12), 1), np.round(rng.uniform(0.5, 4), 1)


def _walked(rng: np.random.Generator) -> Array:
    """Give the distances of six trees of a row, from a place that is off by some decimetres."""
    off, noise = np.array([0.4, 0.25]), 0.05
    trees = np.column_stack([np.arange(8.0), rng.normal(2.0, 0.4, 8)])
    seen = trees[1:7] + rng.normal(0, off) + rng.normal(0, noise, (6, 2))
    table: Array = ((seen[:, None] - trees) ** 2 / (off**2 + noise**2)).sum(-1)
    return table


def _clear_pairs_drawn(ax: Any, function: Any) -> None:
    """Draw how many pairs of forty scans with six trees are right and wrong, by the margin."""
    from slamlab import plots

    rng, margins = np.random.default_rng(7), [0.01, 1.0, 2.0, 3.0, 4.6, 6.0, 8.0, 10.0]
    tables, right, wrong = [_walked(rng) for _ in range(40)], [], []
    for margin in margins:
        rows = np.array([function(table, 9.21, margin) for table in tables]).reshape(40, 6)
        good = rows == np.arange(1, 7)
        right.append(good.sum())
        wrong.append(((rows >= 0) & ~good).sum())
    ax.plot(margins, right, marker="o", **plots.line_style("estimate"))
    ax.plot(margins, wrong, marker="s", **plots.line_style("wrong"))
    ax.text(1.2, right[1] + 6, "right", color=plots.COLOURS["estimate"])
    ax.text(1.2, wrong[1] + 6, "wrong", color=plots.COLOURS["wrong"])
    ax.set_title(f"margin 4.6, of 240:\n{right[4]} right, {wrong[4]} wrong")
    ax.set(xlabel="margin", ylabel="pairs of 240", ylim=(-8, 248))


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


check_clear_pairs = Check(
    clear_pairs,
    "rows",
    {
        "all clear": ([[1.0, 18.0, 20.0], [15.0, 2.0, 30.0]], 9.0, 4.0),
        "one measurement, two trees": ([[3.0, 5.0, 40.0]], 9.0, 4.0),
        "two measurements, one tree": ([[3.0], [5.0], [40.0]], 9.0, 4.0),
        "the second best is outside the gate, and near": ([[8.0, 10.0]], 9.0, 4.0),
        "what is near to an unclear pair is unclear too": (
            [[1.0, 2.0, 50.0], [60.0, 4.0, 50.0]],
            9.0,
            4.0,
        ),
        "exactly the margin is enough": ([[1.0, 5.0]], 9.0, 4.0),
        "exactly the margin is enough, in the column": ([[1.0], [5.0]], 9.0, 4.0),
        "exactly on the gate is outside": ([[9.0, 30.0], [40.0, 1.0]], 9.0, 4.0),
        "no second choice": ([[2.0, 9.0, 50.0], [1.0, 60.0, 70.0]], 9.5, 0.5),
        "a narrow gate": ([[3.0, 30.0], [40.0, 1.0]], 2.0, 4.0),
        "a wide gate": ([[12.0, 30.0], [40.0, 1.0]], 15.0, 4.0),
        "one tree, one measurement": ([[3.0]], 9.0, 4.0),
        "a tie": ([[3.0, 3.0]], 9.0, 0.5),
        "no landmarks yet": (np.zeros((3, 0)), 9.0, 4.0),
        "no measurements": (np.zeros((0, 3)), 9.0, 4.0),
        "any table": _table,
    },
    draws=16,
    edges=("no landmarks yet", "no measurements"),
    picture=_clear_pairs_drawn,
)


# %% tags=["mistakes"]
def _first_best(distance: Array, gate: float) -> Ints:
    """Take the best pair of all, then the best of what is left."""
    left = np.where(distance < gate, distance, np.inf)
    rows = np.full(len(left), -1)
    while np.isfinite(left).any():
        j, row = np.unravel_index(np.argmin(left), left.shape)
        rows[j] = row
        left[j, :] = left[:, row] = np.inf
    return rows


def _loop_with_margin(distance: Array, gate: float, margin: float) -> Any:
    """Take the best pair first; only what is left by then can be a second best."""
    left = distance.copy()
    rows = np.full(len(left), -1)
    while left.min(initial=np.inf) < gate:
        j, i = np.unravel_index(np.argmin(left), left.shape)
        others = np.append(np.delete(left[j], i), np.delete(left[:, i], j))
        if (others >= left[j, i] + margin).all():
            rows[j] = i
        left[j, :] = left[:, i] = np.inf
    return rows


def _each_its_nearest(distance: Array, gate: float) -> Any:
    if not distance.size:
        return np.full(len(distance), -1)
    return np.where(distance.min(1) < gate, distance.argmin(1), -1)


_OTHERS = "np.append(np.delete(distance[j], i), np.delete(distance[:, i], j))"

check_clear_pairs.mistakes = {
    "the margin was not used: this is the best pair first": (
        lambda distance, gate, margin: _first_best(distance, gate)
    ),
    "each measurement took its nearest landmark: clear or not": (
        lambda distance, gate, margin: _each_its_nearest(distance, gate)
    ),
    "other measurements may want the landmark: the column counts too": (
        f"{_OTHERS} => np.delete(distance[j], i)"
    ),
    "the measurement may fit other landmarks: the row counts too": (
        f"{_OTHERS} => np.delete(distance[:, i], j)"
    ),
    "what was crossed out before is still a second-best match: judge each pair by the whole "
    "table": _loop_with_margin,
    "a second-best match outside the gate counts as well": (
        "(others >= distance[j, i] + margin) => "
        "((others >= distance[j, i] + margin) | (others >= gate))"
    ),
    "exactly the margin is enough": "others >= distance => others > distance",
    "exactly on the gate is outside": "distance < gate => distance <= gate",
    "the gate was not used": "distance < gate => distance < np.inf",
    "one other distance that is larger is not enough: all must be": ".all() => .any()",
    "the margin is added, not multiplied": "distance[j, i] + margin => distance[j, i] * margin",
    "these are the unclear pairs": (
        "others >= distance[j, i] + margin).all() => others < distance[j, i] + margin).any()"
    ),
    "these are the measurements of the landmarks: expected the landmarks of the measurements": (
        lambda distance, gate, margin: clear_pairs(distance.T, gate, margin)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: rather none than a wrong one
#
# Two clear pairs of one landmark would each have to be smaller than the other. So nothing is given
# twice, no order is needed, and every pair is judged by itself, on the whole table.

# %% [markdown] tags=["solution"]
# With a loop as in the lesson, the pairs that were looked at are crossed out *before* the next is
# judged. Then a pair seems clear because its second-best match is gone. It makes more pairs, and
# more wrong ones; compare the numbers:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: how many pairs of forty scans with six trees are right and wrong, by the margin; on the left more pairs, and more of them wrong."}}
# def crossed_out(distance, gate, margin):
#     left, rows = distance.copy(), np.full(len(distance), -1)
#     while left.min(initial=np.inf) < gate:
#         j, i = np.unravel_index(left.argmin(), left.shape)
#         others = np.append(np.delete(left[j], i), np.delete(left[:, i], j))
#         if (others >= left[j, i] + margin).all():
#             rows[j] = i
#         left[j, :] = left[:, i] = np.inf
#     return rows
#
# check_clear_pairs.draw(crossed_out)

# %% [markdown] tags=["statement"]
# This is close to the lesson's row *nearest, margin 4.6* (which does not count a landmark outside
# the gate): few pairs, and nearly all of them right. The next
# two exercises go the other way and make as many pairs as fit.
#
# ## Exercise 5: a bug to find
#
# A drone with satellite positioning knows its place to a centimetre, so its pairs share no error
# and can be judged by a table of distances. It wants as many pairs as possible, and has a search
# that tries every landmark for every measurement, and none. It was tested in a wood where each
# measurement had a landmark of its own in its gate and no other, and passed. In a
# nursery it leaves out trees that it could have paired, and takes others for their neighbours;
# *which* ones depends on the order of the measurements. Run the call below the program: both
# measurements could get a tree.


# %% tags=["exercise"]
def most_pairs(distance: Array, gate: float) -> Ints:
    """Find as many pairs as possible; of equally many those with the smallest sum.

    Parameters
    ----------
    distance : ndarray, shape (k, n)
        Squared Mahalanobis distances; no two sets of pairs have the same sum.
    gate : float
        A pair with a distance below it may be taken; each landmark at most once.

    Returns
    -------
    ndarray of int, shape (k,)
        Landmark of each measurement, -1 for none.
    """
    k, n = distance.shape
    rows, taken = np.full(k, -1), np.zeros(n, dtype=bool)
    best = 0, 0.0, rows.copy()

    def walk(j, pairs, total):
        nonlocal best
        if j == k:
            if (pairs, -total) > (best[0], -best[1]):
                best = pairs, total, rows.copy()
            return
        for i in range(n):
            if distance[j, i] < gate and not taken[i]:
                rows[j], taken[i] = i, True
                walk(j + 1, pairs + 1, total + distance[j, i])
                taken[i] = False
        rows[j] = -1
        walk(j + 1, pairs, total)

    walk(0, 0, 0.0)
    return best[2]


# %% active="ipynb" tags=["stub"]
#     k, n = distance.shape
#     rows, taken = np.full(k, -1), np.zeros(n, dtype=bool)
#     best = 0, 0.0, rows.copy()
#
#     def walk(j, pairs, total):
#         nonlocal best
#         if j == k:
#             if (pairs, -total) > (best[0], -best[1]):
#                 best = pairs, total, rows.copy()
#             return
#         for i in range(n):
#             if distance[j, i] < gate and not taken[i]:
#                 rows[j], taken[i] = i, True
#                 walk(j + 1, pairs + 1, total + distance[j, i])
#         rows[j] = -1
#         walk(j + 1, pairs, total)
#
#     walk(0, 0, 0.0)
#     return best[2]

# %% active="ipynb" tags=["try"]
# most_pairs(np.array([[1.0, 2.0], [1.5, 30.0]]), 9.21)

# %% [markdown] tags=["hint"]
# Follow the call with a pencil. Write down `rows` and `taken` at each call of `walk`. The right
# answer gives landmark 1 to measurement 0: is this branch ever walked?

# %% [markdown] tags=["hint"]
# `rows` and `taken` are one array each, for all branches of the search. What does a branch leave
# behind when it is done?


# %% tags=["cases"]
def _nursery(rng: np.random.Generator) -> Any:
    k, n = (int(size) for size in rng.integers(2, 6, 2))
    return rng.uniform(0.5, 16, (k, n)), float(np.round(rng.uniform(6, 12), 1))


def _most_pairs_drawn(ax: Any, function: Any) -> None:
    """Draw the pairs of one scan in a nursery: trees are stars, measurements are dots."""
    rng, paired, right = np.random.default_rng(5), 0, 0
    for scan in range(20):
        trees = np.column_stack([np.repeat(np.arange(4.0), 2), np.tile([0.0, 1.0], 4)])
        trees += rng.normal(0, 0.15, trees.shape)
        which = rng.permutation(8)[:6]
        seen = trees[which] + rng.normal(0, 0.35, (6, 2))
        table = ((seen[:, None] - trees) ** 2).sum(-1) / 0.35**2
        rows = np.asarray(function(table, 9.21))
        paired, right = paired + (rows >= 0).sum(), right + (rows == which).sum()
        if scan == 0:
            _pairs_drawn(ax, trees, seen, rows)
    ax.set_title(f"20 scans: {right} of 120 right,\n{120 - paired} without a tree")
    ax.set(xlim=(-0.6, 3.6), ylim=(-1.7, 2.5))


check_most_pairs = Check(
    most_pairs,
    "rows",
    {
        "one tree in each gate": ([[1.0, 30.0], [40.0, 2.0]], 9.0),
        "the first must leave its nearest tree": ([[1.0, 2.0], [1.5, 30.0]], 9.0),
        "of two ways to pair both, the smaller sum": ([[2.0, 1.0], [4.0, 5.0]], 9.0),
        "the first measurement is of no tree": ([[8.0, 30.0], [1.0, 40.0]], 9.0),
        "nothing inside the gate": ([[12.0, 30.0]], 9.0),
        "exactly on the gate": ([[9.0, 30.0], [40.0, 1.0]], 9.0),
        "a narrow gate": ([[3.0, 30.0], [40.0, 1.0]], 2.0),
        "a wide gate": ([[12.0, 30.0], [40.0, 1.0]], 15.0),
        "more measurements than trees": ([[3.0], [1.0], [2.0]], 9.0),
        "a tree that a measurement before has taken stays taken": (
            [[30.0, 1.0], [5.0, 2.0]],
            9.0,
        ),
        "any nursery": _nursery,
        "no landmarks yet": (np.zeros((3, 0)), 9.0),
        "no measurements": (np.zeros((0, 3)), 9.0),
    },
    draws=8,
    edges=("no landmarks yet", "no measurements"),
    picture=_most_pairs_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_most_pairs.mistakes = {
    "a landmark stays taken after its branch is done: give it back": "taken[i] = False => pass",
    "a landmark was given to two measurements: it is taken for the whole branch": (
        "rows[j], taken[i] = i, True => rows[j] = i"
    ),
    "all landmarks are given back: those of the measurements before are still taken": (
        "taken[i] = False => taken[:] = False"
    ),
    "the branch without a landmark still holds the last one": "rows[j] = -1 => pass",
    "nothing was paired: were the best rows kept as a copy, which the search does not write on?": (
        "best = pairs, total, rows.copy() => best = pairs, total, rows"
    ),
    "there is no branch without a landmark": (
        "rows[j] = -1\n        walk(j + 1, pairs, total) => rows[j] = -1"
    ),
    "of equally many pairs the smallest sum counts": (
        "(pairs, -total) > (best[0], -best[1]) => (pairs, total) > (best[0], best[1])"
    ),
    "the first of the largest sets was kept: of equally many the smallest sum counts": (
        "(pairs, -total) > (best[0], -best[1]) => pairs > best[0]"
    ),
    "the gate was not used": "distance[j, i] < gate and not => not",
    "exactly on the gate is outside": "distance[j, i] < gate => distance[j, i] <= gate",
    "this is the best pair first, never given back: the largest set is asked for": _first_best,
}

# %% [markdown] tags=["solution"]
# ## Solution 5: a bug to find
#
# The first branch takes landmark 0 for measurement 0, and nothing gives it back. When measurement
# 0 tries landmark 1, measurement 1 still finds 0 taken: each landmark is used by the first
# branches that reach it. One line after the branch, `taken[i] = False`, undoes what was done
# before it. In the wood the first branch was the best, so the test could not show it.
# The lesson's search has no such line: it makes a new list of pairs for each branch.

# %% [markdown] tags=["solution"]
# Another repair gives everything back. Then landmarks of measurements *before* are free too, and
# one is given to two:

# %% active="ipynb" tags=["solution"]
# def all_back(distance, gate):
#     k, n = distance.shape
#     rows, taken = np.full(k, -1), np.zeros(n, dtype=bool)
#     best = 0, 0.0, rows.copy()
#
#     def walk(j, pairs, total):
#         nonlocal best
#         if j == k:
#             if (pairs, -total) > (best[0], -best[1]):
#                 best = pairs, total, rows.copy()
#             return
#         for i in range(n):
#             if distance[j, i] < gate and not taken[i]:
#                 rows[j], taken[i] = i, True
#                 walk(j + 1, pairs + 1, total + distance[j, i])
#                 taken[:] = False
#         rows[j] = -1
#         walk(j + 1, pairs, total)
#
#     walk(0, 0, 0.0)
#     return best[2]
#
# check_most_pairs(all_back)

# %% [markdown] tags=["statement"]
# ## Exercise 6: back in the orchard
#
# Now assemble. A robot comes back among its trees and has lost its place by half a metre and five
# degrees. It measures five things at once: four of its six trees, and something that is not in its
# map. Most measurements have two trees or more in their gate, for the gate is wide. Only together
# they tell which: all errors of one scan come from one pose.
#
# Take the walk of exercise 5 and the joint distance, the sum of exercise 3. **Allowed** is a set
# of pairs, each tree at most once, which stays inside the gates as it grows: put its pairs
# in the order of the measurements; the joint distance of the first is below `gates[0]`, that of
# the first two below `gates[1]`, and so on to the whole set. No other part of the set is tried.
#
# For example, with the gates 9.2, 13.3 and 16.8 three pairs for which exercise 3 gives 4, 8 and 3
# are allowed, since 4, 12 and 15 are inside. Three for which it gives 10, 1 and 1 are not: 10 is
# outside, though 11 and 12 are inside.
#
# Return the largest allowed set, of equally large ones the one with the smallest joint distance.
# Measurements that are left over get -1.
#
# The lesson's `jointly` asks, in addition, that each pair by itself be inside the gate of one.
# Here it need not: one true pair in a hundred is outside, and may still fit with the others.
#
# The picture lets the robot come back twenty-four times. Its place is corrected with your pairs,
# as in chapter 09. Each line leads from where it believed itself (a circle) to where it does then
# (a dot), in metres from the truth, which is the cross; a return with a wrong pair is purple and
# ends in a square.
#
# **Predict, then run.** Write down: how many of the 4 · 24 = 96 trees will you find, and how many
# would the nearest neighbour find? The robot was 0.7 m off: how far off is it then, with each of
# the two? Run the check, then open the picture.


# %% tags=["exercise", "predict"]
def together(y: Array, H: Array, P: Array, R: Array, gates: Array) -> Ints:
    """Pair all measurements of one scan with the map.

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
        Limits of the joint squared distance of 1, 2, ..., k pairs; exactly on the limit
        is outside.

    Returns
    -------
    ndarray of int, shape (k,)
        Landmark of each measurement, -1 for none.
    """
    k, n = y.shape[:2]
    best = 0, 0.0, []

    def walk(j, pairs, distance):
        nonlocal best
        if len(pairs) + k - j < best[0]:
            return
        if j == k:
            if (len(pairs), -distance) > (best[0], -best[1]):
                best = len(pairs), distance, pairs
            return
        for i in range(n):
            if i not in [row for _, row in pairs]:
                more = [*pairs, (j, i)]
                js, rows = [a for a, _ in more], [b for _, b in more]
                longer = one_by_one(y[js, rows], H[rows], P, R).sum()
                if longer < gates[len(more) - 1]:
                    walk(j + 1, more, longer)
        walk(j + 1, pairs, distance)

    walk(0, [], 0.0)
    answer = np.full(k, -1)
    for j, i in best[2]:
        answer[j] = i
    return answer


# %% active="ipynb" tags=["try"]
# y = np.array([[[0.8, 0.0], [-0.2, 0.0]], [[1.8, 0.0], [0.8, 0.0]]])
# together(y, np.array([np.eye(2)] * 2), np.eye(2), 0.01 * np.eye(2), np.array([9.2, 13]))

# %% [markdown] tags=["hint"]
# What does a branch need to know? The number of the measurement, the pairs chosen so far, and
# their joint distance. A new list for each branch, `[*pairs, (j, i)]`, leaves nothing to be
# undone.

# %% [markdown] tags=["hint"]
# With `js` and `rows` the measurements and landmarks of a set of pairs, `y[js, rows]` are its
# innovations and `H[rows]` its Jacobians. Both are what `one_by_one` takes.

# %% [markdown] tags=["hint"]
# When all measurements are decided, compare with the best set so far: more pairs win, of as many
# the smaller distance. If even all measurements that are left could not make the set as large as
# the best one, turn back at once; the check will be quicker.


# %% tags=["cases"]
def _return(
    rng: np.random.Generator,
    trees: int,
    seen: int,
    strangers: int = 0,
    echo: int = 0,
    mixed: bool = True,
    sigma: float = 0.05,
) -> Any:
    """Draw where a robot is that believes itself at the origin, and what it measures there."""
    sensor, believed = RangeBearing(sigma, np.radians(0.5)), np.zeros(3)
    truth = rng.normal(0, 1, 3) * [0.5, 0.5, 0.08]
    orchard = rng.uniform([2.0, -2.5], [6.0, 2.5], (trees, 2))
    P = np.diag([0.25, 0.25, 0.0064, *[0.0004] * (2 * trees)])
    in_map = orchard + rng.normal(0, 0.02, (trees, 2))
    which = rng.permutation(trees)[:seen] if mixed else np.arange(seen)
    which = np.append(which, which[:echo]).astype(int)
    others = rng.uniform([2.0, -2.5], [6.0, 2.5], (strangers, 2))
    z = sensor.observe(truth, np.vstack([orchard[which], others]))
    z = z + rng.normal(0, 1, z.shape) * [0.05, 0.0087]
    y = sensor.residual(z[:, None], sensor.observe(believed, in_map)[None])
    gates = chi2_quantile(0.99, 2 * np.arange(1, len(z) + 1))
    slopes = _jacobians(sensor, believed, in_map)
    return truth, (np.round(y, 3), np.round(slopes, 3), P, sensor.cov, gates)


@drawn
def _back(rng: np.random.Generator, trees: int, seen: int, **more: Any) -> Any:
    return _return(rng, trees, seen, **more)[1]


def orchard_returns(associate: Function, n: int = 24, seed: int = 0) -> Any:
    """Count right and wrong pairs of n returns; give the offsets (n, 2, 2) before and after."""
    rng, right, wrong, ways, spoilt = np.random.default_rng(seed), 0, 0, [], []
    for _ in range(n):
        truth, (y, H, P, R, gates) = _return(rng, 6, 4, strangers=1, mixed=False)
        rows = np.array(associate(y, H, P, R, gates), dtype=int).reshape(5)
        made, good = rows >= 0, rows == [0, 1, 2, 3, -2]
        right, wrong = right + good.sum(), wrong + (made & ~good).sum()
        moved = np.zeros(3)
        if made.any():
            A = H[rows[made]].reshape(-1, H.shape[2])
            S = A @ P @ A.T + np.kron(np.eye(made.sum()), R)
            innovation = y[np.flatnonzero(made), rows[made]].ravel()
            moved = (P @ A.T @ np.linalg.solve(S, innovation))[:3]
        ways.append([-truth[:2], (moved - truth)[:2]])
        spoilt.append(bool((made & ~good).any()))
    return int(right), int(wrong), np.array(ways), spoilt


def _paired(associate: Function, y: Array, H: Array, P: Array, R: Array, gates: Array) -> Any:
    """Pair one scan, or (without a scan) judge the pairs of many returns."""
    if y.ndim == 3:
        return associate(y, H, P, R, gates)
    right, wrong, ways, _ = orchard_returns(associate)
    off = np.hypot(*ways[:, 1].T).mean()
    if right >= 90 and off < 0.15:
        return ""
    return (
        "expected 90 or more of 96 trees paired rightly and the robot less than 0.15 m off, "
        f"got {right} right, {wrong} wrong, {off:.2f} m"
    )


def lap_of_lesson(associate: Function, seed: int = 209, laps: float = 1.03, most: int = 10) -> Any:
    """Drive a lap of the lesson, and pair what is measured on the return with `associate`.

    It gets the `most` nearest measurements of a scan that have a tree in their gate. What is left
    over is outside every gate of 99.99 % (`NEW`, may be a new tree), or left out (`IGNORED`).

    Returns
    -------
    run, right, made, off
        The run; how many of the pairs that were made are right; metres off at the end.
    """
    from slamlab.evaluation import association_scores, run
    from slamlab.robots import Unicycle
    from slamlab.simulation import ORCHARD_SENSOR, orchard_loop
    from slamlab.slam import EKFSlam
    from slamlab.slam.association import IGNORED, NEW, Confirmation

    log = orchard_loop(np.random.default_rng(seed), laps=laps)
    assert log.truth is not None
    gates = chi2_quantile(0.99, 2 * np.arange(1, most + 1))

    def pair(slam: Any, z: Any, covs: Any = None) -> Ints:
        z, P, R = np.asarray(z, float), slam.cov, slam.sensor.cov
        y = slam.sensor.residual(z[:, None], slam.sensor.observe(slam.pose, slam.landmarks))
        H = _jacobians(slam.sensor, slam.pose, slam.landmarks)
        S = H @ P @ H.transpose(0, 2, 1) + R
        distance = np.einsum("kni,nij,knj->kn", y, np.linalg.inv(S), y)
        rows = np.where((distance < chi2_quantile(0.9999, 2)).any(1), IGNORED, NEW)
        inside = distance < gates[0]
        js = np.flatnonzero(inside.any(1))
        js = js[np.argsort(z[js, 0])[:most]]
        trees = np.flatnonzero(inside[js].any(0))
        if len(js):
            state = np.r_[:3, (3 + 2 * trees[:, None] + [0, 1]).ravel()]
            found = np.asarray(
                associate(
                    y[np.ix_(js, trees)],
                    H[trees][:, :, state],
                    P[np.ix_(state, state)],
                    R,
                    gates[: len(js)],
                ),
                dtype=int,
            )
            rows[js[found >= 0]] = trees[found[found >= 0]]
        return rows

    slam = EKFSlam(Unicycle(), ORCHARD_SENSOR, log.truth[0], associate=Confirmation(pair))
    result = run(slam, log, known_ids=51)
    score = association_scores(result, 51)
    off = float(np.hypot(*(result.poses[-1] - log.truth[-1])[:2]))
    return result, score.right, score.named, off


def _lap_drawn(ax: Any, function: Any) -> None:
    """Draw true trees (stars) and those of the map (crosses), true way (black), estimated (blue)."""
    from slamlab import plots

    result, right, made, off = lap_of_lesson(function)
    plots.landmarks(ax, result.log.landmarks)
    plots.landmarks(ax, result.system.landmarks, estimated=True)
    plots.path(ax, result.log.truth[97:], "truth")
    plots.path(ax, result.poses[97:], "estimate")
    ax.set_title(f"{right} of {made} pairs right,\n{off:.2f} m off at the end")
    ax.set(xlabel="x (m)", ylabel="y (m)", xlim=(4.3, 11.2), ylim=(-2.0, 4.2), aspect="equal")


def draw_lap(associate: Function) -> Any:
    """Draw a lap of the lesson with an association, beside the nearest neighbour's."""
    from slamlab.exercises._pictures import side_by_side

    names = "Yours", "Nearest neighbour"
    return side_by_side(_lap_drawn, associate, _by_singles(_first_best), names)


def _together_drawn(ax: Any, function: Any) -> None:
    """Draw how far off each of 24 robots is, before (circle) and after; purple: a wrong pair."""
    from slamlab import plots

    right, wrong, ways, spoilt = orchard_returns(function)
    for way, bad in zip(ways, spoilt, strict=True):
        colour = plots.COLOURS["wrong" if bad else "estimate"]
        ax.plot(*way.T, color=colour, lw=0.7, alpha=0.6)
        ax.plot(*way[0], "o", color="0.5", ms=3, mfc="none")
        ax.plot(*way[1], "s" if bad else "o", color=colour, ms=4)
    ax.plot(0, 0, "+", color=plots.COLOURS["truth"], ms=12)
    before, after = np.hypot(*ways.transpose(2, 1, 0)).mean(axis=1)
    ax.set_title(f"{right} right, {wrong} wrong;\n{before:.2f} m off, then {after:.2f} m")
    right, wrong, ways, _ = orchard_returns(_by_singles(_first_best))
    off = np.hypot(*ways[:, 1].T).mean()
    ax.text(
        0.0, -2.2, f"nearest neighbour: {right} right,\n{wrong} wrong, then {off:.2f} m",
        fontsize=8, ha="center", va="center",
    )  # fmt: skip
    ax.set(xlim=(-1.7, 1.7), ylim=(-2.4, 1.5), aspect="equal")
    ax.set(xlabel="off in x (m)", ylabel="off in y (m)")


check_together = Check(
    together,
    "rows",
    {
        "one measurement, one tree": _back(1, 1),
        "two trees": _back(2, 2, sigma=0.08),
        "three of four trees": _back(4, 3),
        "a scan with a measurement of nothing": _back(4, 3, strangers=1),
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
        "the second pair alone is outside the gate of one": (
            [[[0.5, 0.0], [30.0, 30.0]], [[30.0, 30.0], [3.2, 0.0]]],
            np.zeros((2, 2, 3)),
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
        "twenty-four returns to the orchard": (
            np.zeros((1, 5, 6, 2)),
            np.zeros((6, 2, 15)),
            np.eye(15),
            np.eye(2),
            np.zeros(5),
        ),
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
        if one_by_one(y[js, rows], H[rows], P, R).sum() < gates[len(pairs)]:
            pairs = more
    answer = np.full(len(y), -1)
    for j, i in pairs:
        answer[j] = i
    return answer


_JOINT = "longer = one_by_one(y[js, rows], H[rows], P, R).sum()"

check_together.mistakes = {
    "each tree was paired by itself: pairs that fit one by one need not fit together": (
        _by_singles(_first_best)
    ),
    "each took its nearest tree: pairs that fit one by one need not fit together": (
        _by_singles(_each_its_nearest)
    ),
    "only clear pairs were made: the pattern of the trees tells more": (
        _by_singles(lambda distance, gate: clear_pairs(distance, gate, 4.6))
    ),
    "the best pair was taken first and never given back: try other sets too": _greedy,
    "the single distances were added: one pose error is in all of them, use the joint distance": (
        f"{_JOINT} => longer = distance + one_by_one(y[[j], [i]], H[[i]], P, R).sum()"
    ),
    "the pairs were only tried one by one: the whole set must be inside its gate": (
        "longer < gates[len(more) - 1] => one_by_one(y[[j], [i]], H[[i]], P, R).sum() < gates[0]"
    ),
    "the last distance only: the joint distance is the sum": (
        f"{_JOINT} => longer = one_by_one(y[js, rows], H[rows], P, R)[-1]"
    ),
    "a further pair must also be inside the gate of one: the rule has the gate of the set only": (
        "longer < gates[len(more) - 1] => longer < gates[len(more) - 1]"
        " and one_by_one(y[[j], [i]], H[[i]], P, R).sum() < gates[0]"
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
        "        walk(j + 1, pairs, distance) =>         pass"
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
# The walk of exercise 5, with the sum of exercise 3 for a distance. Two things cut it short: a set
# outside its gate is not followed, and neither is one that cannot become as large as the best.

# %% [markdown] tags=["solution"]
# The short way is the nearest neighbour: the best pair first, then the best of what is left. A
# robot that takes it is little better off than before:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: how far off each of 24 robots is, before (circle) and after; purple: a wrong pair; on the left many returns with a wrong pair, which end far from the cross."}}
# def nearest_neighbour(y, H, P, R, gates):
#     S = H @ P @ H.transpose(0, 2, 1) + R
#     left = np.einsum("kni,nij,knj->kn", y, np.linalg.inv(S), y)
#     answer = np.full(len(y), -1)
#     while left.min(initial=np.inf) < gates[0]:
#         j, i = np.unravel_index(left.argmin(), left.shape)
#         answer[j] = i
#         left[j] = left[:, i] = np.inf
#     return answer
#
# check_together.draw(nearest_neighbour)

# %% [markdown] tags=["solution"]
# The joint distance helps little if the first pair is never given back: right or
# wrong, all others are then measured against it.

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: how far off each of 24 robots is, before (circle) and after; purple: a wrong pair; on the left few pairs, and the ends are far off."}}
# def greedy(y, H, P, R, gates):
#     S = H @ P @ H.transpose(0, 2, 1) + R
#     distance = np.einsum("kni,nij,knj->kn", y, np.linalg.inv(S), y)
#     pairs = []
#     for flat in np.argsort(distance, axis=None).tolist():
#         j, i = divmod(flat, y.shape[1])
#         js, rows = [a for a, _ in pairs] + [j], [b for _, b in pairs] + [i]
#         if j not in js[:-1] and i not in rows[:-1]:
#             if one_by_one(y[js, rows], H[rows], P, R).sum() < gates[len(pairs)]:
#                 pairs = pairs + [(j, i)]
#     answer = np.full(len(y), -1)
#     for j, i in pairs:
#         answer[j] = i
#     return answer
#
# check_together.draw(greedy)

# %% [markdown] tags=["solution"]
# One scene is luck. Here are eight times twenty-four returns, with 768 trees to find, and your
# rule with the lesson's gate of a single pair in addition:

# %% active="ipynb" tags=["solution"]
# from slamlab.exercises.ch11_data_association import orchard_returns
#
# def single_gate_too(y, H, P, R, gates):
#     S = H @ P @ H.transpose(0, 2, 1) + R
#     single = np.einsum("kni,nij,knj->kn", y, np.linalg.inv(S), y)
#     y = np.where(single[..., None] < gates[0], y, 1e3)     # outside: never allowed
#     return together(y, H, P, R, gates)
#
# for associate in (nearest_neighbour, greedy, single_gate_too, together):
#     counts = []
#     for seed in range(8):
#         right, wrong, ways, _ = orchard_returns(associate, seed=seed)
#         counts.append((right, wrong, np.hypot(*ways[:, 1].T).mean()))
#     (right, wrong, off), first = np.transpose(counts), counts[0]
#     print(f"{associate.__name__:17s}: picture {first[0]} right, {first[1]:2d} wrong; "
#           f"in all {right.sum():.0f} and {wrong.sum():.0f}, {off.mean():.2f} m off")

# %% [markdown] tags=["solution"]
# The gate of a single pair changes a few of these 768 pairs, for nearly every true pair is
# inside it. (The lesson's search uses it to begin with the measurement that has the fewest trees
# in that gate.) Two other things count: all pairs of a set are judged together, and a first pair
# can be given back.

# %% [markdown] tags=["statement"]
# ## The lesson's drive, with your pairs
#
# Now your function goes into the EKF-SLAM of the lesson: on one of its twenty drives a robot leaves
# an orchard, drives round the farm, and comes back among some thirty trees. Until then the trees
# are named to it. On the return it gets, of the measurements of a scan that have a tree in their
# gate, the ten nearest. In the filter each -1 of yours becomes one of the lesson's two answers:
# `NEW` where the measurement is outside every tree's gate of 99.99 % (it may be a tree that is not
# yet in the map), else `IGNORED` (it is left out). Run it when your check holds; it takes some
# seconds.

# %% active="ipynb" tags=["statement"] mystnb={"image": {"alt": "Two maps of the return to the orchard. On the left, yours: nothing returned yet. On the right nearest neighbour: beside many trees the map has a second one, and the estimated way leaves the true one."}}
# from slamlab.exercises.ch11_data_association import draw_lap
#
# draw_lap(together)

# %% [markdown] tags=["statement"]
# With no tree named to it on the return, your association finds a robot's place by
# the pattern of its trees.
#
# The solutions are in [Solutions 11](../solutions/11_data_association.ipynb).

# %% [markdown] tags=["solution"]
# ## The lesson's drive, with your pairs
#
# The pieces of exercises 3 and 6 in the EKF-SLAM of chapter 09:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two maps of the return to the orchard. On the left with joint pairs: a cross on each star, and the estimated way on the true one. On the right nearest neighbour: beside many trees the map has a second one, and the estimated way leaves the true one."}}
# from slamlab.exercises.ch11_data_association import draw_lap
#
# draw_lap(together)

# %% [markdown] tags=["solution"]
# And on ten drives of the lesson's *Predict, then run*:

# %% active="ipynb" tags=["solution"]
# from slamlab.exercises.ch11_data_association import lap_of_lesson
#
# for associate in (nearest_neighbour, together):
#     drives = [lap_of_lesson(associate, seed)[1:] for seed in range(200, 210)]
#     right, made, off = np.transpose(drives)
#     print(f"{associate.__name__:17s} {right.sum():.0f} of {made.sum():.0f} right; "
#           f"{np.median(off):.2f} m off in the median, {off.max():.2f} m at most")

# %% [markdown] tags=["solution"]
# The drive that opens the lesson was chosen because it is hard. How many measurements of a scan
# does it need?

# %% active="ipynb" tags=["solution"]
# for most in (6, 8, 10, 11, 30):
#     _, right, made, off = lap_of_lesson(together, seed=24, laps=1.05, most=most)
#     print(f"{most:2d} measurements: {right} of {made} pairs right, {off:.2f} m off")

# %% [markdown] tags=["solution"]
# With six the robot is lost, on this drive, and with eleven again, though eight and ten are enough.
# With the whole scan, up to thirty, which the lesson's search gets too, no pair is wrong. Your walk
# takes some seconds for that: it takes trees and measurements in the order in which they come. The
# lesson's begins with the measurement that has the fewest trees in its gate, tries the nearest tree
# first, and stops after 500 sets.
