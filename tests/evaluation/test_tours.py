"""Judging drives: metres, coverage, revisits, collisions, read off a log."""

import numpy as np
import pytest

from slamlab.evaluation.tours import collisions, coverage, path_length, reached_at, revisits
from slamlab.logs import Log
from slamlab.sensors import Lidar
from slamlab.worlds import BitmapWorld, rooms

ROOM, LIDAR = rooms.thesis_room(), Lidar(120)


def log_along(*places, **more):
    truth = np.array([[*place, 0.0] for place in places])
    T = len(truth)
    return Log(np.arange(T), np.zeros((T, 2)), 1.0, np.eye(2), truth=truth, **more)


def scans_along(*places, world=ROOM):
    truth = np.array([[*place, 0.0] for place in places])
    ranges = LIDAR.scan(world, truth)
    return log_along(*places, ranges=ranges, scan=LIDAR)


def test_metres_add_up():
    log = log_along((0, 0), (3, 4), (3, 4), (3, 5))
    assert path_length(log).tolist() == [0, 5, 5, 6]


def test_coverage_grows_to_the_whole_room_and_is_judged_from_true_poses():
    log = scans_along((0.6, 0.6), (3.4, 0.6), (3.4, 3.4), (0.6, 3.4), (2.0, 2.0))
    seen = coverage(log, ROOM)
    assert seen.shape == (5,)
    assert (np.diff(seen) > 0).all()
    assert 0.3 < seen[0] < 0.8
    assert seen[-1] > 0.98
    # The same scans drawn from elsewhere show another room.
    moved = coverage(log_along(*[(2.0, 2.0)] * 5, ranges=log.ranges, scan=LIDAR), ROOM)
    assert moved[-1] != pytest.approx(seen[-1], abs=0.01)


def test_floor_behind_a_wall_does_not_count():
    cells = np.zeros((40, 80))
    cells[:, 40] = cells[0] = cells[-1] = 1
    cells[:, 0] = cells[:, -1] = 1
    world = BitmapWorld(cells, 0.1)
    log = scans_along((1.0, 2.0), (2.0, 2.0), (3.0, 2.0), world=world)
    assert coverage(log, world)[-1] > 0.97


def test_values_are_read_at_metres_driven():
    length, values = [0, 1, 2, 4], [0.1, 0.5, 0.4, 0.9]
    assert reached_at(length, values, [0, 0.9, 1.0, 3.9, 4.0, 1e6]).tolist() == [
        0.1, 0.1, 0.5, 0.5, 0.9, 0.9,
    ]  # fmt: skip


def test_revisits_count_entries_into_squares_left_before():
    there = [(0.15, 0.15), (1.35, 0.15)]
    assert revisits(log_along(*there), 0.3) == 0
    assert revisits(log_along(*there, there[0]), 0.3) == 4
    assert revisits(log_along(there[0]), 0.3) == 0


def test_collisions_are_what_the_simulation_noted():
    log = log_along((0, 0), (1, 0), (1, 0), notes={"hit": np.array([False, True, True])})
    assert collisions(log).tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: path_length(Log([0], [[0.0]], 0, [[1.0]])), "log: expected one with truth"),
        (lambda: collisions(log_along((0, 0))), "log: expected one with notes of hits"),
        (lambda: coverage(log_along((1, 1)), ROOM), "log: expected one with scans"),
        (
            lambda: coverage(scans_along((2, 2)), BitmapWorld(np.ones((4, 4)), 1.0)),
            "world: expected free floor",
        ),
        (
            lambda: coverage(scans_along((2, 2)), BitmapWorld(np.eye(2), 2.0, (1, 1))),
            "log: expected a start on free floor",
        ),
        (lambda: revisits(log_along((0, 0)), 0.0), "side"),
        (lambda: reached_at([0, 1], [0], 1.0), "values"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
