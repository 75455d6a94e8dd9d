"""Exercises of chapter 18: right answers pass, wrong ones are named, the stub is friendly."""

import numpy as np
import pytest
from scipy import ndimage

from slamlab.exercises import ch18_exploration as ch
from slamlab.robots import SquareRobot

EXERCISES = {
    "swept": (ch.check_swept, ch.swept, ch.MISTAKES_SWEPT),
    "quarter_beams": (ch.check_quarter_beams, ch.quarter_beams, ch.MISTAKES_QUARTER_BEAMS),
    "frontier": (ch.check_frontier, ch.frontier, ch.MISTAKES_FRONTIER),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


def swept_by_the_robot(points, half, step):
    """Another right answer: ask the library, point by point, and return a list."""
    robot = SquareRobot(2 * float(half))
    return [bool(robot.drive_hits(point[None], float(step))) for point in points]


def quarters_in_a_loop(ranges, degrees, back):
    found = {}
    for index, (length, angle) in enumerate(zip(ranges, degrees, strict=True)):
        quarter = int(angle // 90)
        if quarter not in found or length > ranges[found[quarter]]:
            found[quarter] = index
    back = np.deg2rad(back)
    return tuple(
        i for _, i in sorted(found.items())
        if np.cos(np.deg2rad(degrees[i]) - back) < np.cos(np.deg2rad(45))
    )  # fmt: skip


def frontier_by_dilation(state):
    return ndimage.binary_dilation(state == 0) & (state == 1)


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
        (ch.check_swept, swept_by_the_robot),
        (ch.check_quarter_beams, quarters_in_a_loop),
        (ch.check_frontier, frontier_by_dilation),
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
