"""Exercises of chapter 19: right answers pass, wrong ones are named, the stub is friendly."""

import math

import numpy as np
import pytest

from slamlab.exercises import ch19_autocorrelation_localization as ch
from slamlab.localization import signature
from slamlab.sensors import turn_between

EXERCISES = {
    "autocorrelation": (
        ch.check_autocorrelation,
        ch.autocorrelation,
        ch.MISTAKES_AUTOCORRELATION,
    ),
    "turn": (ch.check_turn, ch.turn, ch.MISTAKES_TURN),
    "second_best": (ch.check_second_best, ch.second_best, ch.MISTAKES_SECOND_BEST),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


def by_rolling(scan):
    return [float(np.sum(scan * np.roll(scan, tau))) for tau in range(len(scan))]


def by_index(scan):
    j = np.arange(len(scan))
    return scan[(j[:, None] - j) % len(scan)].T @ scan


def turn_by_differences(before, after):
    """Another right answer: the shift with the least sum of squares."""
    N = len(before)
    m = min(range(N), key=lambda m: ((np.roll(before, -m) - after) ** 2).sum())
    return math.remainder(m * 2 * math.pi / N, 2 * math.pi)


def second_by_sorting(places, misfits, separation):
    order = np.argsort(misfits)
    best = order[0]
    for row in order[1:]:
        if math.dist(places[row], places[best]) > separation:
            return [best, row, misfits[row] - misfits[best]]
    raise AssertionError


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
        (ch.check_autocorrelation, by_rolling),
        (ch.check_autocorrelation, by_index),
        (ch.check_autocorrelation, signature.autocorrelation),
        (ch.check_turn, turn_by_differences),
        (ch.check_second_best, second_by_sorting),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def test_the_library_agrees_with_the_turn_up_to_its_refinement():
    scan = np.random.default_rng(1).uniform(1, 3, 40)
    for beams in range(-19, 20):
        due = ch.turn(scan, np.roll(scan, -beams))
        assert due == pytest.approx(beams * 2 * np.pi / 40)
        assert turn_between(scan, np.roll(scan, -beams)) == pytest.approx(due, abs=1e-9)


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
