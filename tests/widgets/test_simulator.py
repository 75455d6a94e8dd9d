"""The simulator, Python side: what goes into the page, what Python answers, what is refused."""

import json

import numpy as np
import pytest

from slamlab.robots import SquareRobot
from slamlab.sensors import Lidar
from slamlab.widgets import Simulator
from slamlab.worlds import BitmapWorld, rooms

ROOM = rooms.thesis_room()


def simulator(**more):
    return Simulator({"first": ROOM, "second": rooms.thesis_room_two()}, **more)


def test_three_rooms_stay_under_an_eighth_of_a_megabyte():
    figure = Simulator(
        {"a": ROOM, "b": rooms.thesis_room_two(), "c": rooms.symmetric_room()}, title="t"
    )
    assert len(json.dumps(figure.get_state(), default=str, allow_nan=False)) < 125_000


def test_python_answers_with_the_librarys_beams_and_its_finer_map():
    figure = simulator(fine_stride=8)
    assert figure.answer == {}
    pose = [1.3, 1.9, 0.7]
    figure.ask = {"id": 3, "room": 0, "pose": pose}
    assert figure.answer["id"] == 3
    np.testing.assert_allclose(figure.answer["ranges"], Lidar(120).scan(ROOM, pose))
    assert np.hypot(*(np.array(figure.answer["pose"]) - pose)[:2]) < 0.1
    assert figure.answer["ambiguous"] is False
    figure.ask = {"id": 4, "room": 1, "pose": pose, "n_beams": 60}
    assert figure.answer["id"] == 4
    due = Lidar(60).scan(rooms.thesis_room_two(), pose)
    np.testing.assert_allclose(figure.answer["ranges"], due)


def test_beams_that_met_nothing_are_answered_as_nothing():
    cells = ROOM.occupied.copy()
    cells[150:250, -8:] = False  # a door
    figure = Simulator({"room": BitmapWorld(cells, ROOM.resolution)}, fine_stride=20)
    figure.ask = {"id": 1, "room": 0, "pose": [3.3, 1.9, 0.0]}
    assert None in figure.answer["ranges"]
    json.dumps(figure.answer, allow_nan=False)


def test_start_is_the_one_given_or_a_roomy_place_in_the_middle():
    given, found = simulator(starts={"first": [0.8, 1.5, 0.4]}).payload["rooms"]
    assert given["start"] == [0.8, 1.5, 0.4]
    world, robot = rooms.thesis_room_two(), SquareRobot(0.30)
    assert world.clearance(found["start"][:2]) > robot.circumradius
    assert np.hypot(found["start"][0] - 2, found["start"][1] - 2) < 1.0


def test_repr_is_stable():
    assert repr(simulator()) == "Simulator(first, second; 120 beams)"


SOLID = BitmapWorld(np.ones((40, 40)), 0.1)
NARROW = BitmapWorld(np.pad(np.zeros((38, 2)), 1, constant_values=1), 0.1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Simulator({}), "worlds"),
        (lambda: Simulator([ROOM]), "worlds"),
        (lambda: Simulator({"a": rooms.box_room()}), "expected a BitmapWorld"),
        (lambda: Simulator({"a": SOLID}), "expected a place where the robot can turn"),
        (lambda: Simulator({"a": NARROW}), "expected a place where the robot can turn"),
        (lambda: Simulator({"a": NARROW}, {"a": [0.2, 2.0, 0.0]}), "robot touches"),
        (lambda: Simulator({"a": SOLID}, {"a": [0.2, 2.0, 0.0]}), "robot touches"),
        (lambda: Simulator({"a": ROOM}, {"b": [1, 1, 0]}), "starts"),
        (lambda: Simulator({"a": ROOM}, {"a": [1, 1]}), "starts"),
        (lambda: Simulator({"a": ROOM}, fine_stride=0), "fine_stride"),
        (lambda: Simulator({"a": ROOM}, lidar=Lidar(120, sigma_range=0.1)), "lidar"),
        (lambda: Simulator({"a": ROOM}, lidar=Lidar(120, field_of_view=3.0)), "lidar"),
        (lambda: Simulator({"a": ROOM}, lidar=Lidar(10)), "lidar"),
        (lambda: Simulator({"a": ROOM}, lidar=Lidar(400)), "lidar"),
        (lambda: Simulator({"a": ROOM}, lidar=Lidar(120, max_range=1.0)), "lidar"),
        (lambda: Simulator({"a": ROOM}, title=3), "title"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
