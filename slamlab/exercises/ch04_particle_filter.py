"""Checks of chapter 04: weights in log space, effective sample size, systematic resampling.

P2 (14) is the weight, P2 (17) its form in a filter that proposes from the motion model.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Report, run_cases

__all__ = [
    "MISTAKES_EFFECTIVE_SAMPLE_SIZE",
    "MISTAKES_RESAMPLE",
    "MISTAKES_WEIGHTS",
    "check_effective_sample_size",
    "check_resample",
    "check_weights",
    "effective_sample_size",
    "new_weights",
    "resample",
]

Function = Callable[..., Any]


# Exercise 1: new weights.


def new_weights(weights: Array, log_likelihood: Array) -> Array:
    """Weights (M,) after a measurement: old weight times likelihood, normalised, in log space."""
    with np.errstate(divide="ignore"):
        log_weights = np.log(weights) + log_likelihood
    likelihood = np.exp(log_weights - log_weights.max())
    return likelihood / likelihood.sum()


def _naive(weights: Array, log_likelihood: Array) -> Array:
    product = weights * np.exp(log_likelihood)
    with np.errstate(invalid="ignore"):
        return product / product.sum()


def _by_maximum(weights: Array, log_likelihood: Array) -> Array:
    new = new_weights(weights, log_likelihood)
    return new / new.max()


def _sum_of_both(weights: Array, log_likelihood: Array) -> Array:
    new = weights + np.exp(log_likelihood)
    return new / new.sum()


def _log_as_weight(weights: Array, log_likelihood: Array) -> Array:
    new = weights * log_likelihood
    return new / new.sum()


def _only_logarithms(weights: Array, log_likelihood: Array) -> Array:
    with np.errstate(divide="ignore"):
        return np.log(new_weights(weights, log_likelihood))


MISTAKES_WEIGHTS: dict[str, Function] = {
    "the old weights are forgotten: the new weight is the old one times the likelihood": (
        lambda w, log: new_weights(np.ones_like(w), log)
    ),
    "exp underflows: subtract the largest log weight before the exponential": _naive,
    "divided by the largest weight: weights must sum to one": _by_maximum,
    "weight and likelihood were added: evidence multiplies": _sum_of_both,
    "the log likelihood was used as if it were the likelihood: take its exponential": (
        _log_as_weight
    ),
    "these are logarithms: return the weights themselves": _only_logarithms,
    "the weights did not change: the measurement was not used": (
        lambda w, log: np.array(w, dtype=float)
    ),
}


def check_weights(student: Function) -> Report:
    """Check ``student(weights (M,), log_likelihood (M,)) -> weights (M,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("equal weights follow the likelihood", [0.25] * 4, np.log([0.1, 0.2, 0.3, 0.4])),
        ("old weights count", [0.7, 0.2, 0.1], np.log([0.1, 0.5, 0.9])),
        ("one particle was excluded before and stays so", [0.0, 0.5, 0.5], [0.0, -1.0, -2.0]),
        ("likelihoods of 1e-5000 do no harm", [0.5, 0.5], [-11512.0, -11513.0]),
    ]
    return run_cases("weights", student, new_weights, cases, MISTAKES_WEIGHTS)


# Exercise 2: effective sample size.


def effective_sample_size(weights: Array) -> Any:
    """Effective sample size of weights (M,) that need not sum to one."""
    w = np.asarray(weights, dtype=float) / np.sum(weights)
    return 1 / np.sum(w**2)


MISTAKES_EFFECTIVE_SAMPLE_SIZE: dict[str, Function] = {
    "normalise first: doubling all weights changes nothing": lambda w: 1 / np.sum(w**2),
    "this is the sum of the squares: take one over it": (lambda w: np.sum((w / np.sum(w)) ** 2)),
    "this counts the particles, not what they weigh": lambda w: float(len(w)),
    "this counts the particles above zero: tiny weights carry almost nothing": (
        lambda w: float(np.count_nonzero(w))
    ),
    "this is one over the largest weight: all squares belong in the sum": (
        lambda w: np.sum(w) / np.max(w)
    ),
    "divided by the number of particles: the size itself is due, between 1 and M": (
        lambda w: effective_sample_size(w) / len(w)
    ),
    "the square of the sum is missing its square": lambda w: np.sum(w) / np.sum(w**2),
}


def check_effective_sample_size(student: Function) -> Report:
    """Check ``student(weights (M,)) -> effective sample size``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("equal weights: all particles count", [0.2] * 5),
        ("one particle has everything", [0.0, 1.0, 0.0]),
        ("something between", [0.5, 0.3, 0.15, 0.05]),
        ("weights that do not sum to one", [3.0, 1.0, 4.0, 1.0, 5.0]),
    ]
    return run_cases(
        "effective_sample_size",
        student,
        effective_sample_size,
        cases,
        MISTAKES_EFFECTIVE_SAMPLE_SIZE,
    )


# Exercise 3: systematic resampling.


def resample(weights: Array, u: Array) -> Array:
    """Draw indices (M,) by one comb of M teeth, shifted by u in [0, 1)."""
    positions = (np.arange(len(weights)) + u) / len(weights)
    return np.minimum(np.searchsorted(np.cumsum(weights), positions, "right"), len(weights) - 1)


def _search(weights: Array, positions: Array) -> Array:
    index = np.searchsorted(np.cumsum(weights), positions, "right")
    return np.minimum(index, len(weights) - 1)


MISTAKES_RESAMPLE: dict[str, Function] = {
    "the comb does not move: shift all teeth by the random offset": (
        lambda w, u: _search(w, np.arange(len(w)) / len(w))
    ),
    "the offset must be divided by the number of particles: the teeth are 1/M apart": (
        lambda w, u: _search(w, np.arange(len(w)) / len(w) + u)
    ),
    "every tooth stands at the same place: they are 1/M apart": (
        lambda w, u: _search(w, np.full(len(w), u))
    ),
    "the best particle was copied M times: the others must survive by their weight": (
        lambda w, u: np.full(len(w), np.argmax(w))
    ),
    "indices begin at 0: these are one too large": lambda w, u: resample(w, u) + 1,
    "these are the numbers of copies: the indices of the copies are due": (
        lambda w, u: np.bincount(resample(w, u), minlength=len(w))
    ),
    "the comb was laid over the weights, not over their cumulative sum": (
        lambda w, u: np.minimum(
            np.searchsorted(np.asarray(w), (np.arange(len(w)) + u) / len(w)), len(w) - 1
        )
    ),
}


def check_resample(student: Function) -> Report:
    """Check ``student(weights (M,), u) -> indices (M,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("equal weights: everybody survives once", [0.25] * 4, 0.5),
        ("a heavy particle is copied", [0.1, 0.6, 0.1, 0.2], 0.3),
        ("another offset, another draw", [0.1, 0.6, 0.1, 0.2], 0.9),
        ("a particle without weight dies", [0.5, 0.0, 0.25, 0.25], 0.4),
        ("many particles", np.arange(1, 21) / 210, 0.77),
    ]
    return run_cases("resample", student, resample, cases, MISTAKES_RESAMPLE)
