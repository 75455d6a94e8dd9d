"""Exercises of chapter 03: right answers pass, wrong ones are named, the stub is friendly."""

import math

import numpy as np
import pytest

from slamlab.exercises import ch03_extended_kalman_filter as ch

EXERCISES = {
    "range_bearing": (ch.check_range_bearing, ch.range_bearing, ch.MISTAKES_RANGE_BEARING),
    "innovation": (ch.check_innovation, ch.innovation, ch.MISTAKES_INNOVATION),
    "jacobian": (ch.check_jacobian, ch.jacobian, ch.MISTAKES_JACOBIAN),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


def polar(pose, landmark):
    """Another right answer: by complex numbers, returned as a tuple."""
    seen = complex(*(landmark - pose[:2])) * complex(math.cos(pose[2]), -math.sin(pose[2]))
    return abs(seen), math.atan2(seen.imag, seen.real)


def by_differences(pose, landmark):
    """Another right answer: the Jacobian by complex step."""
    columns = []
    for k in range(3):
        p = np.array(pose, dtype=complex)
        p[k] += 1e-30j
        dx, dy = landmark[0] - p[0], landmark[1] - p[1]
        bearing = np.arctan2(dy.real, dx.real).imag
        q = dx.real**2 + dy.real**2
        bearing = (dx.real * dy.imag - dy.real * dx.imag) / q - p[2].imag
        columns.append([np.sqrt(dx * dx + dy * dy).imag / 1e-30, bearing / 1e-30])
    return np.array(columns).T


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
        (ch.check_range_bearing, polar),
        (ch.check_innovation, lambda z, p: [z[0] - p[0], math.remainder(z[1] - p[1], math.tau)]),
        (ch.check_jacobian, by_differences),
        (ch.check_jacobian, lambda p, m: ch.jacobian(p, m).tolist()),
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
