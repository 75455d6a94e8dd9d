"""Exercises of chapter 02: right answers pass, wrong ones are named, the stub is friendly."""

import numpy as np
import pytest

from slamlab.exercises import ch02_kalman_filter as ch
from slamlab.filters import kalman
from slamlab.gaussian import Gaussian

EXERCISES = {
    "predict": (ch.check_predict, ch.predict, ch.MISTAKES_PREDICT),
    "update": (ch.check_update, ch.update, ch.MISTAKES_UPDATE),
    "joseph": (ch.check_joseph, ch.joseph, ch.MISTAKES_JOSEPH),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


def information_form(mean, cov, z, H, R):
    """Another right answer: add up the information."""
    P = np.linalg.inv(np.linalg.inv(cov) + H.T @ np.linalg.inv(R) @ H)
    return P @ (np.linalg.inv(cov) @ mean + H.T @ np.linalg.inv(R) @ z), P


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
        (ch.check_predict, lambda m, P, F, Q: kalman.predict(Gaussian(m, P), F, Q)),
        (ch.check_predict, lambda m, P, F, Q: [(F @ m).tolist(), (F @ P @ F.T + Q).tolist()]),
        (ch.check_update, information_form),
        (ch.check_update, lambda m, P, z, H, R: kalman.update(Gaussian(m, P), z, H, R)[0]),
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
