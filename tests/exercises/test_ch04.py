"""Right answers of chapter 04, written in other ways: each passes."""

import math

import numpy as np
import pytest
from scipy.special import logsumexp

from slamlab.exercises import ch04_particle_filter as ch


def by_logsumexp(weights, log_likelihood):
    with np.errstate(divide="ignore"):
        log = np.log(weights) + log_likelihood
    return np.exp(log - logsumexp(log)).tolist()


def by_wheel(weights, u):
    """Another right answer: walk along the comb."""
    indices, cumulative, i = [], weights[0], 0
    for tooth in range(len(weights)):
        while i < len(weights) - 1 and (tooth + u) / len(weights) >= cumulative:
            i += 1
            cumulative += weights[i]
        indices.append(i)
    return indices


def by_ceiling(weights, u):
    """How many points are below each cumulative sum; the last sum is 1 but for rounding."""
    below = np.ceil(len(weights) * np.cumsum(weights) - u).astype(int)
    below[np.cumsum(weights) > 1 - 1e-12] = len(weights)
    return np.repeat(np.arange(len(weights)), np.diff(below, prepend=0))


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_weights, by_logsumexp),
        (ch.check_effective_sample_size, lambda w: sum(w) ** 2 / math.fsum(x * x for x in w)),
        (ch.check_resample, by_wheel),
        (ch.check_resample, by_ceiling),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
