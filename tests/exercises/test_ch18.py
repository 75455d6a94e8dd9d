"""Right answers of chapter 18, written in other ways: each passes."""

import math

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


def turn_by_corners(point, half):
    """Another right answer: a corner meets the line of the point's circle; smallest turns win."""
    d = math.hypot(*point)
    if d >= half * math.sqrt(2):
        return [math.inf, math.inf]
    if max(map(abs, point)) < half:
        return [0, 0]
    # The square covers the arcs between these directions on the circle of radius d.
    edge = [k * math.pi / 2 + s * math.acos(half / d) for k in range(4) for s in (-1, 1)]
    angle = math.atan2(point[1], point[0])
    ahead = [(e - angle) % (2 * math.pi) for e in edge]
    return 2 * math.pi - max(ahead), min(ahead)


def step_by_loop(points, half, margin):
    free = math.inf
    for x, y in points.tolist():
        if x > 0 and -half - margin < y < half + margin:
            free = min(free, x - half - margin)
    return 0 if free < 0 else free


def way_by_rings(state, cell):
    """Another right answer: distances spread over the map, then downhill; ties fall elsewhere."""
    far = np.where(frontier_by_dilation(state), 0.0, np.inf)
    for _ in range(state.size):
        around = np.pad(far, 1, constant_values=np.inf)
        near = np.min(
            [around[2:, 1:-1], around[:-2, 1:-1], around[1:-1, 2:], around[1:-1, :-2]], 0
        )
        far = np.where(state == 1, np.minimum(far, near + 1), np.inf)
    here, way = tuple(int(k) for k in cell), []
    while np.isfinite(far[here]):
        way.append(list(here))
        if far[here] == 0:
            return way
        steps = [(here[0] + a, here[1] + b) for a, b in ((-1, 0), (0, -1), (0, 1), (1, 0))]
        here = next(
            s
            for s in steps
            if 0 <= s[0] < len(far) and 0 <= s[1] < len(far[0]) and far[s] == far[here] - 1
        )
    return []


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_free_turn, turn_by_corners),
        (ch.check_free_step, step_by_loop),
        (ch.check_way, way_by_rings),
        (ch.check_swept, swept_by_the_robot),
        (ch.check_quarter_beams, quarters_in_a_loop),
        (ch.check_frontier, frontier_by_dilation),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
