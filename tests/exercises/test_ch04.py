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


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_weights, by_logsumexp),
        (ch.check_effective_sample_size, lambda w: sum(w) ** 2 / math.fsum(x * x for x in w)),
        (ch.check_resample, by_wheel),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
