"""Right answers of chapter 18, written in other ways: each passes."""

import numpy as np
import pytest
from scipy import ndimage

from slamlab.exercises import ch18_exploration as ch
from slamlab.robots import SquareRobot


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
