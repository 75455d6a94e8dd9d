"""Checks of chapter 04: weights in log space, effective sample size, systematic resampling.

P2 (14) is the weight, P2 (17) its form in a filter that proposes from the motion model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn
from slamlab.exercises._draw import weights as some_weights
from slamlab.exercises._report import Array, Check, Ints

__all__ = [
    "check_effective_sample_size",
    "check_localize",
    "check_mean_pose",
    "check_resample",
    "check_weights",
]


# Exercise 1: new weights.


def _new_weights(weights: Array, log_likelihood: Array) -> Array:
    """Weights (M,) after a measurement: old weight times likelihood, normalised, in log space."""
    log_weights = np.log(weights) + log_likelihood
    likelihood = np.exp(log_weights - log_weights.max())
    return likelihood / likelihood.sum()


def _measured(rng: np.random.Generator) -> Any:
    n = int(rng.integers(1, 9))
    return some_weights(rng, n), np.round(rng.normal(-3, 2, n), 2)


check_weights = Check(
    _new_weights,
    "weights",
    {
        "equal weights follow the likelihood": ([0.25] * 4, np.log([0.1, 0.2, 0.3, 0.4])),
        "one particle was excluded before and stays so": ([0.0, 0.5, 0.5], [0.0, -1.0, -2.0]),
        "a likelihood of zero excludes": ([0.2, 0.5, 0.3], [-np.inf, -1.0, -2.0]),
        "likelihoods of 1e-5000 do no harm": ([0.5, 0.5], [-11512.0, -11513.0]),
        "the likeliest was excluded before": ([0.0, 0.5, 0.5], [0.0, -2000.0, -2001.0]),
        "densities above one are no harm either": ([0.5, 0.5], [900.0, 899.0]),
        "old weights count": _measured,
    },
    {
        "the old weights are forgotten: the new weight is the old one times the likelihood": (
            "np.log(weights) +  => "
        ),
        "exp underflows: subtract the largest log weight before the exponential": (
            " - log_weights.max() => "
        ),
        "the largest log likelihood was subtracted: take the largest log weight, as a particle "
        "of weight zero may have the largest likelihood": (
            lambda w, log: w * np.exp(log - log.max()) / np.sum(w * np.exp(log - log.max()))
        ),
        "divided by the largest weight: weights must sum to one": (
            "likelihood.sum() => likelihood.max()"
        ),
        "weight and likelihood were added: evidence multiplies": (
            lambda w, log: (w + np.exp(log)) / np.sum(w + np.exp(log))
        ),
        "the log likelihood was used as if it were the likelihood: take its exponential": (
            lambda w, log: w * log / np.sum(w * log)
        ),
        "these are logarithms: return the weights themselves": (
            lambda w, log: np.log(_new_weights(w, log))
        ),
        "the weights did not change: the measurement was not used": (lambda w, log: np.array(w)),
        "something was added to the weights: a particle of weight zero stays excluded": (
            "np.log(weights) => np.log(weights + 1e-300)"
        ),
        "the sign of the logarithm is reversed: likely particles must gain": (
            "+ log_likelihood => - log_likelihood"
        ),
        "the measurement was counted twice": "+ log_likelihood => + 2 * log_likelihood",
    },
)


# Exercise 2: effective sample size.


def _effective_sample_size(weights: Array) -> float:
    """Effective sample size of weights (M,) that need not sum to one."""
    w = weights / weights.sum()
    return 1 / np.sum(w**2)


check_effective_sample_size = Check(
    _effective_sample_size,
    "size",
    {
        "equal weights: all particles count": ([0.2] * 5,),
        "one particle has everything": ([0.0, 1.0, 0.0],),
        "a single particle": ([0.3],),
        "something between": ([0.5, 0.3, 0.15, 0.05],),
        "weights that do not sum to one": lambda rng: (rng.integers(1, 9, rng.integers(2, 9)),),
        "any weights": lambda rng: (some_weights(rng, int(rng.integers(2, 30))),),
    },
    {
        "normalise first: doubling all weights changes nothing": (
            "weights / weights.sum() => weights"
        ),
        "this is the sum of the squares: take one over it": "1 / np.sum(w**2) => np.sum(w**2)",
        "this counts the particles, not what they weigh": lambda w: float(len(w)),
        "this counts the particles above zero: tiny weights carry almost nothing": (
            lambda w: float(np.count_nonzero(w))
        ),
        "this is one over the largest weight: all squares belong in the sum": (
            "1 / np.sum(w**2) => 1 / w.max()"
        ),
        "divided by the number of particles: the size itself is due, between 1 and M": (
            "1 / np.sum(w**2) => 1 / np.sum(w**2) / len(w)"
        ),
        "the square of the sum is missing its square": (lambda w: np.sum(w) / np.sum(w**2)),
        "this is the perplexity, exp of the entropy: another measure, never smaller": (
            lambda w: np.exp(-np.sum(np.where(w > 0, w / w.sum() * np.log(w / w.sum()), 0.0)))
        ),
        "this is the entropy: 1 / sum of the squares is due": (
            lambda w: -np.sum(np.where(w > 0, w / w.sum() * np.log(w / w.sum()), 0.0))
        ),
        "the root is too much: 1 / sum of the squares is due": (
            "1 / np.sum(w**2) => 1 / np.sqrt(np.sum(w**2))"
        ),
        "this is M / (1 + variance of the weights): the variance of M w is meant": (
            lambda w: len(w) / (1 + np.var(w / w.sum()))
        ),
        "one comes out for any weights: square each weight before the sum": (
            lambda w: 1 / np.sum(w / w.sum()) ** 2
        ),
    },
)


# Exercise 3: systematic resampling.


def _resample(weights: Array, u: float) -> Ints:
    """Draw indices (M,) by one comb of M teeth, shifted by u in [0, 1)."""
    M = len(weights)
    teeth = (np.arange(M) + u) / M
    return np.minimum(np.searchsorted(np.cumsum(weights), teeth, "right"), M - 1)


def _residual(weights: Array, u: float) -> Any:
    M = len(weights)
    copies = np.floor(M * weights).astype(int)
    rest = M * weights - copies
    n = M - copies.sum()
    more = np.searchsorted(np.cumsum(rest / rest.sum()), (np.arange(n) + u) / n, "right")
    return np.append(np.repeat(np.arange(M), copies), more)


def _exact(rng: np.random.Generator) -> Any:
    """Weights in eighths, so that teeth fall exactly on the borders, and a dead particle."""
    counts = rng.multinomial(8, np.ones(7) / 7)
    return np.append(counts / 8, 0.0), 0.0


check_resample = Check(
    _resample,
    "indices",
    {
        "equal weights: everybody survives once": ([0.25] * 4, 0.5),
        "a heavy particle is copied": ([0.1, 0.6, 0.1, 0.2], 0.3),
        "another offset, another draw": ([0.1, 0.6, 0.1, 0.2], 0.9),
        "the first particle has weight zero, the first tooth stands at zero": (
            [0.0, 0.5, 0.25, 0.25],
            0.0,
        ),
        "a tooth exactly on a border draws the next particle": _exact,
        "one particle": ([1.0], 0.7),
        "a cumulative sum that ends below one": ([0.1] * 10, 0.9999999999999999),
        "many particles": lambda rng: (
            some_weights(rng, int(rng.integers(2, 30)), [1]),
            float(np.round(rng.uniform(0.05, 0.95), 3)),
        ),
    },
    {
        "the comb does not move: shift all teeth by the random offset": (
            "(np.arange(M) + u) / M => np.arange(M) / M"
        ),
        "the offset must be divided by the number of particles: the teeth are 1/M apart": (
            "(np.arange(M) + u) / M => np.arange(M) / M + u"
        ),
        "the offset is not random: the comb stands in the middle": (
            "np.arange(M) + u => np.arange(M) + 0.5"
        ),
        "every tooth stands at the same place: they are 1/M apart": (
            "(np.arange(M) + u) / M => np.full(M, u)"
        ),
        "the best particle was copied M times: the others must survive by their weight": (
            lambda w, u: np.full(len(w), np.argmax(w))
        ),
        "indices begin at 0: these are one too large": lambda w, u: _resample(w, u) + 1,
        "these are the numbers of copies: the indices of the copies are due": (
            lambda w, u: np.bincount(_resample(w, u), minlength=len(w))
        ),
        "these are the weights of the drawn: their indices are due": (
            lambda w, u: w[_resample(w, u)]
        ),
        "these are the teeth: the particles on which they fall are due": (
            lambda w, u: (np.arange(len(w)) + u) / len(w)
        ),
        "a tooth exactly on a border draws the particle before it, which may have weight zero: "
        "search with side='right'": '"right" => "left"',
        "a tooth beyond the last cumulative sum draws no particle: rounding may end it below one, "
        "so cut at M - 1": (
            "np.minimum( => (",
            ", M - 1) => )",
        ),
        "the comb was laid over the weights, not over their cumulative sum": (
            "np.cumsum(weights) => weights"
        ),
        "this is residual resampling: whole copies first; the comb alone is asked for": _residual,
        "this is multinomial: independent draws, that ignore u": (
            lambda w, u: np.sort(np.random.default_rng(0).choice(len(w), len(w), p=w))
        ),
        "the offset counts from the other end": "+ u) => + 1 - u)",
    },
)


# Exercise 4: a bug in a mean.


def _mean_pose(poses: Array, weights: Array) -> Array:
    """Mean pose (3,) of weighted particles (M, 3); headings are averaged as directions."""
    x, y = weights @ poses[:, :2]
    return np.array(
        [x, y, np.arctan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))]
    )


@drawn
def _cloud(rng: np.random.Generator, heading: float) -> Any:
    n = int(rng.integers(2, 8))
    poses = np.round(rng.normal(0, [2.0, 2.0, 0.5], (n, 3)), 2)
    poses[:, 2] = (poses[:, 2] + heading + np.pi) % (2 * np.pi) - np.pi
    return poses, some_weights(rng, n)


check_mean_pose = Check(
    _mean_pose,
    "pose",
    {
        "one particle": ([[1.0, 2.0, -3.0]], [1.0]),
        "two headings around half a turn": ([[0, 0, 3.1], [2, 0, -3.0]], [0.5, 0.5]),
        "a weight of zero counts nothing": ([[0, 0, 0.3], [9, 9, 2.0]], [1.0, 0.0]),
        "a cloud that looks ahead": _cloud(0.0),
        "a cloud that looks back": _cloud(np.pi),
    },
    {
        "headings were averaged as numbers: the mean of 3.1 and -3.1 is not 0": (
            "np.arctan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))"
            " => weights @ poses[:, 2]"
        ),
        "the weights were not used": lambda poses, weights: _mean_pose(
            poses, np.full(len(poses), 1 / len(poses))
        ),
        "the heaviest particle came: the mean is due": lambda poses, weights: poses[
            np.argmax(weights)
        ].copy(),
        "the headings were averaged without their weights": (
            "weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2])"
            " => np.sin(poses[:, 2]).sum(), np.cos(poses[:, 2]).sum()"
        ),
        "sine and cosine are exchanged in arctan2: the sine comes first": (
            "weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2])"
            " => weights @ np.cos(poses[:, 2]), weights @ np.sin(poses[:, 2])"
        ),
        "the quotient loses the quadrant: use arctan2 with two arguments": (
            "np.arctan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))"
            " => np.arctan(weights @ np.sin(poses[:, 2]) / (weights @ np.cos(poses[:, 2])))"
        ),
        "divided by the number of particles: the weights sum to one already": (
            "weights @ poses[:, :2] => weights @ poses[:, :2] / len(poses)"
        ),
        "the headings are wrapped to [0, 2 pi) before they are averaged: that moves the trouble "
        "to zero": (
            "np.arctan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))"
            " => weights @ (poses[:, 2] % (2 * np.pi))"
        ),
    },
    tolerance=1e-8,
)


# Exercise 5: a particle filter in the corridor.


def _localize(
    x: Array, moves: Array, noise: Array, z: Array, doors: Array, sigma: float, u: Array
) -> tuple[Array, Array]:
    """Places (M,) and weights (M,) after a drive; z is the distance to the nearest door or NaN."""
    weights = np.full(len(x), 1 / len(x))
    for move, slip, reading, offset in zip(moves, noise, z, u, strict=True):
        x = x + move + slip
        if np.isfinite(reading):
            expected = np.abs(x[:, None] - doors).min(axis=1)
            weights = _new_weights(weights, -0.5 * ((reading - expected) / sigma) ** 2)
        if _effective_sample_size(weights) < len(x) / 2:
            x = x[_resample(weights, offset)]
            weights = np.full(len(x), 1 / len(x))
    return x, weights


@drawn
def _walk(
    rng: np.random.Generator, n: int, steps: int, lost: float = 0.0, sigma: float = 0.3
) -> Any:
    doors = np.round(rng.uniform(0, 12, 3), 1)
    x, place = np.round(rng.uniform(0, 8, n), 2), float(rng.uniform(0, 6))
    moves = np.round(rng.uniform(0.2, 0.8, steps), 2)
    z = np.abs((place + np.cumsum(moves))[:, None] - doors).min(axis=1)
    z = np.where(rng.random(steps) < lost, np.nan, np.round(z + rng.normal(0, sigma, steps), 2))
    noise = np.round(rng.normal(0, 0.1, (steps, n)), 3)
    return x, moves, noise, z, doors, sigma, np.round(rng.random(steps), 3)


check_localize = Check(
    _localize,
    "x, weights",
    {
        "one step, nothing seen": _walk(5, 1, 1.0),
        "one step and one reading": _walk(6, 1),
        "readings so dull that nobody is resampled": _walk(6, 4, 0.0, 20.0),
        "a drive": _walk(12, 8),
        "a drive on which the eye is closed now and then": _walk(12, 10, 0.5),
    },
    {
        "the particles were resampled and kept their weights: those count twice now": (
            "            weights = np.full(len(x), 1 / len(x)) =>             pass"
        ),
        "resampled at every step: only when fewer than half of the particles count": (
            "_effective_sample_size(weights) < len(x) / 2 => True"
        ),
        "never resampled: do so when fewer than half of the particles count": (
            "_effective_sample_size(weights) < len(x) / 2 => False"
        ),
        "resampled when the weights are good: the comparison is the wrong way round": (
            "< len(x) / 2 => > len(x) / 2"
        ),
        "one noise for all: every particle slips on its own": (
            "x + move + slip => x + move + slip[0]"
        ),
        "the slip was forgotten: particles that do not differ cannot be told apart": (
            "x + move + slip => x + move"
        ),
        "the old weights are forgotten at each reading": (
            "_new_weights(weights,  => _new_weights(np.ones(len(x)), "
        ),
        "sigma stands outside of the square: the error is counted in sigmas, then squared": (
            "((reading - expected) / sigma) ** 2 => (reading - expected) ** 2 / sigma"
        ),
        "the half in the exponent is missing": "-0.5 * (( => -1.0 * ((",
        "the first door is not the nearest: take the smallest distance": (
            ".min(axis=1) => [:, 0]"
        ),
        "the minimum was taken over the particles: each has a nearest door of its own": (
            ".min(axis=1) => .min(axis=0).mean()"
        ),
        "the likelihood of a near door is small: the exponent is negative": (
            "-0.5 * (( => 0.5 * (("
        ),
        "it looked before it moved: the reading is taken after the step": (
            "np.abs(x[:, None] - doors) => np.abs((x - move - slip)[:, None] - doors)"
        ),
    },
    tolerance=1e-8,
)
