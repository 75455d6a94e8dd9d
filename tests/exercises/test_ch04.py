"""Exercises of chapter 04: right answers pass, wrong ones are named, the stub is friendly."""

import math

import numpy as np
import pytest
from scipy.special import logsumexp

from slamlab.exercises import ch04_particle_filter as ch

EXERCISES = {
    "weights": (ch.check_weights, ch.new_weights, ch.MISTAKES_WEIGHTS),
    "effective_sample_size": (
        ch.check_effective_sample_size,
        ch.effective_sample_size,
        ch.MISTAKES_EFFECTIVE_SAMPLE_SIZE,
    ),
    "resample": (ch.check_resample, ch.resample, ch.MISTAKES_RESAMPLE),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


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


@pytest.mark.parametrize("name", EXERCISES)
def test_at_least_five_wrong_answers_are_known(name):
    assert len(EXERCISES[name][2]) >= 5


@pytest.mark.parametrize("name", EXERCISES)
def test_the_solution_passes(name):
    check, solution, _ = EXERCISES[name]
    assert check(solution).passed


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


@pytest.mark.parametrize("name", EXERCISES)
def test_the_stub_gets_the_friendly_line_and_nothing_else(name):
    report = EXERCISES[name][0](lambda *arguments: ...)
    assert len(report.text.splitlines()) == 2
    assert "nothing returned yet" in report.text


@pytest.mark.parametrize(("check", "wrong", "message"), WRONG)
def test_each_wrong_answer_is_caught_with_its_own_message(check, wrong, message):
    report = check(wrong)
    assert not report.passed
    assert report.messages == (message,)
