"""WallWorld: the same answers as the bitmap of the same room, and closed outlines."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamlab.worlds import BitmapWorld, WallWorld, free_poses, rooms

SQUARE = 0.15 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
ROOM = WallWorld.from_polygons([[0, 0], [4, 0], [4, 3], [0, 3]], [[1, 1], [2, 1], [2, 2], [1, 2]])


def both(world):
    return world, WallWorld.from_bitmap(world)


@pytest.fixture(scope="module", params=["thesis_room", "symmetric_room", "random"])
def pair(request):
    if request.param == "random":
        return both(rooms.random_room(np.random.default_rng(9)))
    return both(getattr(rooms, request.param)())


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda w: pickle.loads(pickle.dumps(w))])
def test_a_copy_is_the_same_world_and_stays_read_only(pair, copied):
    for world in pair:
        twin = copied(world)
        assert type(twin) is type(world)
        for name, value in vars(world).items():
            mine = getattr(twin, name)
            np.testing.assert_array_equal(mine, value)
            if isinstance(value, np.ndarray):  # writable, loops would be compiled once more
                assert mine is not value
                assert mine.flags.writeable == value.flags.writeable


def test_beams_agree_on_the_same_room(pair):
    bitmap, walls = pair
    rng = np.random.default_rng(1)
    poses = free_poses(bitmap, 3000, rng)
    ranges = bitmap.cast(poses[:, :2], poses[:, 2])
    np.testing.assert_allclose(walls.cast(poses[:, :2], poses[:, 2]), ranges, atol=1e-9)


def test_clearance_and_free_space_agree(pair):
    bitmap, walls = pair
    points = np.random.default_rng(2).uniform(-0.5, 4.5, (3000, 2))
    assert (bitmap.is_free(points) == walls.is_free(points)).all()
    np.testing.assert_allclose(bitmap.clearance(points), walls.clearance(points), atol=1e-9)


@pytest.mark.needs_numba(reason="9000 motions one by one in each world take more than 20 s")
def test_collisions_agree_standing_driving_and_turning(pair):
    bitmap, walls = pair
    rng = np.random.default_rng(3)
    start = np.column_stack([rng.uniform(0, 4, (3000, 2)), rng.uniform(-3, 3, 3000)])
    turn, drive = start.copy(), start.copy()
    turn[:, 2] += rng.uniform(-2, 2, 3000)
    drive[:, :2] += rng.uniform(-0.6, 0.6, (3000, 2))
    for footprint in (SQUARE, SQUARE * [1.5, 0.4], SQUARE[:3] + 0.1):
        assert (bitmap.collides(footprint, start) == walls.collides(footprint, start)).all()
        for end in (turn, drive):
            there = bitmap.sweep_collides(footprint, start, end)
            assert (there == walls.sweep_collides(footprint, start, end)).all()
            assert 0.1 < there.mean() < 0.9


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.booleans())
def test_a_sweep_equals_many_footprints_on_the_way(seed, turning):
    rng = np.random.default_rng(seed)
    start = np.array([*rng.uniform((0.3, 0.3), (3.7, 2.7)), rng.uniform(-3, 3)])
    end = start + [0, 0, rng.uniform(-3, 3)] if turning else start + [*rng.uniform(-1, 1, 2), 0]
    way = start + np.linspace(0, 1, 800)[:, None] * (end - start)
    footprint = SQUARE * [2.0, 0.8] + rng.uniform(-0.1, 0.1, 2)
    stepped = ROOM.collides(footprint, way).any()
    swept = ROOM.sweep_collides(footprint, start, end)
    assert swept or not stepped
    # What only the sweep sees is a corner cut by less than the steps can show.
    assert not swept or stepped or ROOM.collides(1.01 * footprint, way).any()


def test_testing_only_the_ends_misses_collisions():
    start, end = [1.5, 0.5, 0.0], [1.5, 2.5, 0.0]
    assert not ROOM.collides(SQUARE, [start, end]).any()
    assert ROOM.sweep_collides(SQUARE, start, end)


def test_the_inside_of_boxes_and_the_outside_of_the_room_are_not_free():
    assert ROOM.closed
    assert ROOM.is_free([[0.5, 0.5], [1.5, 1.5], [5, 1], [1.0, 1.5]]).tolist() == [
        True,
        False,
        False,
        False,
    ]
    assert ROOM.cast([1.5, 1.5], 0.3) == 0.0
    assert ROOM.collides(0.1 * SQUARE, [1.5, 1.5, 0.0])
    assert ROOM.collides(0.1 * SQUARE, [9.0, 1.5, 0.0])


def test_beams_into_a_corner_find_the_corner():
    box = WallWorld.from_polygons([[0, 0], [1, 0], [1, 1], [0, 1]])
    angles = np.pi / 4 + np.pi / 2 * np.arange(4)
    np.testing.assert_allclose(box.cast([0.5, 0.5], angles), np.sqrt(0.5))
    rng = np.random.default_rng(4)
    origins = rng.uniform(0.01, 0.99, (5000, 2))
    corners = rng.integers(0, 2, (5000, 2))
    to = corners - origins
    ranges = box.cast(origins, np.arctan2(to[:, 1], to[:, 0]))
    np.testing.assert_allclose(ranges, np.hypot(*to.T), atol=1e-6)


def test_open_walls_are_thin_and_have_two_free_sides():
    wall = WallWorld([[[1.0, -1.0], [1.0, 1.0]]])
    assert not wall.closed
    assert wall.is_free([[0, 0], [2, 0], [1, 0], [1, 2]]).tolist() == [True, True, False, True]
    assert wall.cast([0, 0], [0.0, np.pi, np.pi / 4 + 0.01]).tolist() == [1.0, np.inf, np.inf]
    # Seen end on it is met at its end.
    assert wall.cast([1.0, -3.0], np.pi / 2) == pytest.approx(2.0)
    assert wall.cast([0, 0], 0.0, max_range=0.99) == np.inf
    assert wall.clearance([1.0, 4.0]) == 3.0


def test_drawn_in_pixels_a_room_is_itself():
    bitmap = rooms.thesis_room()
    again = WallWorld.from_bitmap(bitmap).to_bitmap(0.01, margin=0.05)
    assert (again.occupied == bitmap.occupied).all()
    np.testing.assert_allclose(again.origin, 0.0, atol=1e-12)


def test_a_turned_box_is_drawn_with_every_cell_it_touches():
    room = rooms.box_room()
    bitmap = room.to_bitmap(0.05, margin=0.1)
    poses = free_poses(room, 2000, np.random.default_rng(6))
    exact, drawn = (w.cast(poses[:, :2], poses[:, 2]) for w in (room, bitmap))
    # Cells reach inwards by less than their diagonal; grazing beams see more of it.
    assert (drawn <= exact + 1e-9).all()
    assert np.quantile(exact - drawn, 0.9) < 0.15


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: WallWorld(np.zeros((0, 2, 2))), "segments: expected at least one wall"),
        (lambda: WallWorld([[[0, 0], [0, 0]]]), "each with a length"),
        (lambda: WallWorld([[0, 0], [0, 1]]), "segments: expected shape"),
        (lambda: WallWorld.from_polygons(), "polygons: expected at least one"),
        (lambda: WallWorld.from_polygons([[0, 0], [1, 0]]), "three vertices"),
        (lambda: WallWorld.from_bitmap(BitmapWorld([[0, 1]], 1.0)), "bitmap: expected free cells"),
        (lambda: WallWorld.from_bitmap(BitmapWorld([[1, 1]], 1.0)), "got 0 free cells"),
        (lambda: ROOM.to_bitmap(1e-5), "resolution: expected fewer cells"),
        (lambda: ROOM.to_bitmap(0.0), "resolution: expected a number"),
        (lambda: ROOM.cast([0, np.nan], 0.0), "origins: expected finite"),
        (lambda: ROOM.cast([1, 1], 0.0, -1.0), "max_range: expected at least 0"),
        (lambda: ROOM.collides(SQUARE[[0, 2, 1, 3]], [1, 1, 0]), "footprint: expected the vert"),
        (lambda: ROOM.collides(SQUARE[:2], [1, 1, 0]), "footprint: expected the vert"),
        (lambda: ROOM.sweep_collides(SQUARE, [1, 1, 0], [2, 1, 1]), "end: expected a straight"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
