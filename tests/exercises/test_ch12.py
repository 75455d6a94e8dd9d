"""Exercises of chapter 12: right answers pass, wrong ones are named, the stub is friendly."""

import copy

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from slamlab.exercises import ch12_fastslam as ch

EXERCISES = {
    "weight": (ch.check_weight, ch.log_weight, ch.MISTAKES_WEIGHT),
    "proposal": (ch.check_proposal, ch.proposal, ch.MISTAKES_PROPOSAL),
    "copies": (ch.check_copies, ch.copy_particles, ch.MISTAKES_COPIES),
    "ancestors": (ch.check_ancestors, ch.distinct_ancestors, ch.MISTAKES_ANCESTORS),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


def by_kalman_gain(x, Q, H, Z, y):
    K = Q @ H.T @ np.linalg.inv(H @ Q @ H.T + Z)
    return (x + K @ y).tolist(), Q - K @ H @ Q


def by_lists(parents):
    parents = np.asarray(parents).tolist()
    alive, counts = set(range(len(parents[0]))), []
    for one in reversed(parents):
        alive = {one[i] for i in alive}
        counts.insert(0, len(alive))
    return counts


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
        (
            ch.check_weight,
            lambda y, H, S, R: multivariate_normal.logpdf(y, np.zeros(2), H @ S @ H.T + R),
        ),
        (ch.check_proposal, by_kalman_gain),
        (ch.check_copies, lambda maps, chosen: np.array(maps)[chosen]),
        (ch.check_copies, lambda maps, chosen: [copy.deepcopy(maps[i]) for i in chosen]),
        (ch.check_copies, lambda maps, chosen: tuple(maps[i].copy() for i in chosen)),
        (ch.check_ancestors, by_lists),
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
