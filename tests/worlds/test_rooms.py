"""The rooms of the lessons: sizes, symmetries, and free space that hangs together."""

import numpy as np
import pytest
from scipy import ndimage

from slamlab.worlds import BitmapWorld, LandmarkWorld, WallWorld, free_poses, rooms

BITMAPS = [
    rooms.thesis_room,
    rooms.thesis_room_two,
    rooms.symmetric_room,
    rooms.office,
    rooms.corridor,
    rooms.long_corridor,
    rooms.ring,
]


def pieces(world, clearance):
    """Connected pieces of the places with this clearance, from the exact clearance."""
    if isinstance(world, WallWorld):
        left, bottom, right, top = world.bounds
        points = np.stack(
            np.meshgrid(np.arange(left, right, 0.04), np.arange(bottom, top, 0.04)), -1
        )
    else:
        points = world.centres()
    return ndimage.label(world.clearance(points) >= clearance)[1]


@pytest.mark.parametrize("room", BITMAPS)
def test_rooms_are_shut_and_a_robot_reaches_everything(room):
    world = room()
    edge = world.occupied.copy()
    edge[1:-1, 1:-1] = True
    assert edge.all()
    assert pieces(world, 0.22) == 1


@pytest.mark.parametrize("seed", range(6))
def test_random_rooms_hang_together_and_come_again(seed):
    world = rooms.random_room(np.random.default_rng(seed))
    assert world.occupied.shape == (400, 400)
    assert pieces(world, 0.23) == 1
    again = rooms.random_room(np.random.default_rng(seed))
    assert (world.occupied == again.occupied).all()


@pytest.mark.parametrize("seed", range(8))
def test_random_box_rooms_hang_together(seed):
    world = rooms.random_box_room(np.random.default_rng(seed))
    assert world.closed
    assert 8 <= len(world.segments) <= 24
    assert [pieces(world, clearance) for clearance in (0.36, 0.42, 0.48)] == [1, 1, 1]
    assert len(free_poses(world, 20, np.random.default_rng(seed), 0.4)) == 20


def test_thesis_rooms_have_its_size_three_obstacles_and_no_symmetry():
    for world in (rooms.thesis_room(), rooms.thesis_room_two()):
        cells = world.occupied
        assert cells.shape == (400, 400)
        assert world.bounds == (0.0, 0.0, 4.0, 4.0)
        assert ndimage.label(cells, np.ones((3, 3)))[1] == 4
        for other in (cells[::-1], cells[:, ::-1], cells[::-1, ::-1], cells.T, np.rot90(cells)):
            assert (other != cells).any()


def test_the_symmetric_room_and_the_mirrored_pair_are_what_they_say():
    cells = rooms.symmetric_room().occupied
    assert (cells == cells[::-1, ::-1]).all()
    assert (cells != cells[:, ::-1]).any()
    room, mirrored = rooms.mirrored_pair()
    assert (room.occupied == mirrored.occupied[:, ::-1]).all()


def test_box_room_has_the_size_of_p1_and_three_boxes():
    room = rooms.box_room()
    assert room.bounds == (0.0, 0.0, 10.0, 8.0)
    assert len(room.segments) == 16
    assert room.closed


def test_free_poses_of_a_full_world_are_refused():
    full = BitmapWorld(np.ones((5, 5)), 0.1)
    with pytest.raises(ValueError, match="world: expected free places with a clearance of 0 m"):
        free_poses(full, 1, np.random.default_rng(0))
    with pytest.raises(ValueError, match="a clearance of 9 m"):
        free_poses(rooms.corridor(), 1, np.random.default_rng(0), 9.0)


def test_landmark_worlds():
    world = LandmarkWorld([[0, 2], [4, 1], [3, 0]])
    assert len(world) == 3
    assert world.bounds == (0, 0, 4, 2)
    assert repr(world) == "LandmarkWorld(3 landmarks)"
    with pytest.raises(ValueError, match="points: expected at least one"):
        LandmarkWorld(np.zeros((0, 2)))
