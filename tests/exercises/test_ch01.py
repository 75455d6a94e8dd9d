"""Exercises of chapter 01: right answers pass, wrong ones are named, the stub is friendly."""

import numpy as np
import pytest

from slamlab.exercises import ch01_bayes_filter as ch
from slamlab.filters import histogram

EXERCISES = {
    "predict": (ch.check_predict, ch.predict, ch.MISTAKES_PREDICT),
    "update": (ch.check_update, ch.update, ch.MISTAKES_UPDATE),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


def by_loops(belief, p_stay, p_step, p_slip):
    n = len(belief)
    moved = [0.0] * n
    for i, p in enumerate(belief):
        moved[i] += p_stay * p
        moved[(i + 1) % n] += p_step * p
        moved[(i + 2) % n] += p_slip * p
    return moved


def by_library(belief, p_stay, p_step, p_slip):
    return histogram.predict(belief, [p_stay, p_step, p_slip], [0, 1, 2])


def update_by_library(belief, doors, sees_door, p_right):
    return histogram.update(belief, np.where(doors == sees_door, p_right, 1 - p_right))[0]


@pytest.mark.parametrize("name", EXERCISES)
def test_at_least_five_wrong_answers_are_known(name):
    assert len(EXERCISES[name][2]) >= 5


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_predict, ch.predict),
        (ch.check_predict, by_loops),
        (ch.check_predict, by_library),
        (ch.check_update, ch.update),
        (ch.check_update, update_by_library),
    ],
)
def test_right_answers_pass(check, answer):
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
