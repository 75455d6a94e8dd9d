"""Checks of chapter 04: weights in log space, effective sample size, systematic resampling.

P2 (14) is the weight, P2 (17) its form in a filter that proposes from the motion model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import weights as some_weights
from slamlab.exercises._report import Array, Check, Ints

__all__ = ["check_effective_sample_size", "check_resample", "check_weights"]


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
            "np.log(weights) + ",
            "",
        ),
        "exp underflows: subtract the largest log weight before the exponential": (
            " - log_weights.max()",
            "",
        ),
        "the largest log likelihood was subtracted: take the largest log weight, as a particle "
        "of weight zero may have the largest likelihood": (
            lambda w, log: w * np.exp(log - log.max()) / np.sum(w * np.exp(log - log.max()))
        ),
        "divided by the largest weight: weights must sum to one": (
            "likelihood.sum()",
            "likelihood.max()",
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
            "np.log(weights)",
            "np.log(weights + 1e-300)",
        ),
        "the sign of the logarithm is reversed: likely particles must gain": (
            "+ log_likelihood",
            "- log_likelihood",
        ),
        "the measurement was counted twice": ("+ log_likelihood", "+ 2 * log_likelihood"),
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
            "weights / weights.sum()",
            "weights",
        ),
        "this is the sum of the squares: take one over it": ("1 / np.sum(w**2)", "np.sum(w**2)"),
        "this counts the particles, not what they weigh": lambda w: float(len(w)),
        "this counts the particles above zero: tiny weights carry almost nothing": (
            lambda w: float(np.count_nonzero(w))
        ),
        "this is one over the largest weight: all squares belong in the sum": (
            "1 / np.sum(w**2)",
            "1 / w.max()",
        ),
        "divided by the number of particles: the size itself is due, between 1 and M": (
            "1 / np.sum(w**2)",
            "1 / np.sum(w**2) / len(w)",
        ),
        "the square of the sum is missing its square": (lambda w: np.sum(w) / np.sum(w**2)),
        "this is the perplexity, exp of the entropy: another measure, never smaller": (
            lambda w: np.exp(-np.sum(np.where(w > 0, w / w.sum() * np.log(w / w.sum()), 0.0)))
        ),
        "this is the entropy: 1 / sum of the squares is due": (
            lambda w: -np.sum(np.where(w > 0, w / w.sum() * np.log(w / w.sum()), 0.0))
        ),
        "the root is too much: 1 / sum of the squares is due": (
            "1 / np.sum(w**2)",
            "1 / np.sqrt(np.sum(w**2))",
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
            "(np.arange(M) + u) / M",
            "np.arange(M) / M",
        ),
        "the offset must be divided by the number of particles: the teeth are 1/M apart": (
            "(np.arange(M) + u) / M",
            "np.arange(M) / M + u",
        ),
        "the offset is not random: the comb stands in the middle": (
            "np.arange(M) + u",
            "np.arange(M) + 0.5",
        ),
        "every tooth stands at the same place: they are 1/M apart": (
            "(np.arange(M) + u) / M",
            "np.full(M, u)",
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
        "search with side='right'": ('"right"', '"left"'),
        "a tooth beyond the last cumulative sum draws no particle: rounding may end it below one, "
        "so cut at M - 1": ("np.minimum(", "(", ", M - 1)", ")"),
        "the comb was laid over the weights, not over their cumulative sum": (
            "np.cumsum(weights)",
            "weights",
        ),
        "this is residual resampling: whole copies first; the comb alone is asked for": _residual,
        "this is multinomial: independent draws, that ignore u": (
            lambda w, u: np.sort(np.random.default_rng(0).choice(len(w), len(w), p=w))
        ),
        "the offset counts from the other end": ("+ u)", "+ 1 - u)"),
    },
)
