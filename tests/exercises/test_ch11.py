"""Exercises of chapter 11: right answers pass, wrong ones are named, the stub is friendly."""

import numpy as np
import pytest

from slamlab.exercises import ch11_data_association as ch

EXERCISES = {
    "nearest": (ch.check_nearest, ch.nearest, ch.MISTAKES_NEAREST),
    "joint": (ch.check_joint, ch.joint_distance, ch.MISTAKES_JOINT),
    "best_first": (ch.check_best_first, ch.best_first, ch.MISTAKES_BEST_FIRST),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


def nearest_by_loop(y, S, gate):
    """Another right answer: one landmark after the other, by Cholesky."""
    best, row = gate, -1
    for number, (one, cov) in enumerate(zip(y, S, strict=True)):
        white = np.linalg.solve(np.linalg.cholesky(cov), one)
        if white @ white < best:
            best, row = white @ white, number
    return np.int64(row)


def by_sorting(distance, gate):
    """Another right answer: all pairs in order of their distance."""
    rows, taken = [-1] * len(distance), set()
    for flat in np.argsort(distance, axis=None):
        j, row = divmod(int(flat), distance.shape[1])
        if distance[j, row] < gate and rows[j] < 0 and row not in taken:
            rows[j] = row
            taken.add(row)
    return rows


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
        (ch.check_nearest, nearest_by_loop),
        (ch.check_joint, lambda y, S: np.ravel(y) @ np.linalg.inv(S) @ np.ravel(y)),
        (ch.check_best_first, by_sorting),
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
