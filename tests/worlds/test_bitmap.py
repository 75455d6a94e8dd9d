"""BitmapWorld: beams exact on the grid, clearance, collisions."""

import numpy as np
import pytest

from slamlab.worlds import BitmapWorld, free_poses, rooms

SQUARE = 0.15 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])


def random_bitmap(rng, size=60, share=0.1):
    return BitmapWorld(rng.random((size, size)) < share, 0.05, (-1.0, 2.0))


def stepped(world, x, y, angle, step=1e-3):
    """Oracle: walk along the beam in steps of a thousandth of a cell, without mercy."""
    t = np.arange(0.0, 90.0, step)
    columns = np.floor(x + t * np.cos(angle)).astype(int)
    rows = np.floor(y + t * np.sin(angle)).astype(int)
    inside = (0 <= columns) & (columns < 60) & (0 <= rows) & (rows < 60)
    hit = np.zeros(len(t), bool)
    hit[inside] = world.occupied[rows[inside], columns[inside]]
    return t[hit.argmax()] if hit.any() else np.inf


def test_a_beam_stops_where_walking_in_tiny_steps_stops():
    rng = np.random.default_rng(1)
    world = random_bitmap(rng)
    points = rng.uniform(0, 60, (300, 2))
    angles = rng.uniform(-np.pi, np.pi, 300)
    ranges = world.cast(world.origin + 0.05 * points, angles) / 0.05
    walked = np.array([stepped(world, *p, a) for p, a in zip(points, angles, strict=True)])
    # A beam may cut a corner within less than a step: the walk may miss it, never the beam.
    assert (ranges <= walked + 1e-6).all()
    assert np.isclose(ranges, walked, rtol=0, atol=2e-3).mean() > 0.99


def test_no_beam_leaks_through_a_diagonal_wall():
    world = BitmapWorld(np.eye(50, dtype=bool), 1.0)
    rng = np.random.default_rng(2)
    origins = rng.uniform(1, 49, (2000, 2))
    origins = origins[np.abs(origins[:, 0] - origins[:, 1]) > 1.0]
    corners = rng.integers(1, 49, (len(origins), 1)) * np.ones(2)
    for targets in (corners, corners + rng.uniform(-0.5, 0.5, (len(origins), 1))):
        d = targets - origins
        ranges = world.cast(origins, np.arctan2(d[:, 1], d[:, 0]))
        assert (ranges <= np.hypot(*d.T) + 1.5).all()
    # From lattice points at exactly 45 degrees: through corners only.
    exact = world.cast([[3.0, 7.0], [9.0, 3.0]], [-np.pi / 4, 3 * np.pi / 4])
    assert exact == pytest.approx([2 * np.sqrt(2), 3 * np.sqrt(2)], abs=1e-8)


def test_cast_everywhere_gives_the_answers_of_cast():
    rng = np.random.default_rng(3)
    for world in (random_bitmap(rng, 40), random_bitmap(rng, 40, 0.01), rooms.corridor()):
        angles = np.concatenate([np.arange(8) * np.pi / 4, rng.uniform(-4, 4, 5)])
        for stride, reach in ((1, np.inf), (3, 0.4)):
            swept = world.cast_everywhere(angles, reach, stride)
            single = world.cast(world.centres(stride)[None], angles[:, None, None], reach)
            assert swept.shape == single.shape
            np.testing.assert_allclose(swept, single, rtol=0, atol=1e-9)


def test_clearance_is_the_distance_to_the_nearest_square():
    rng = np.random.default_rng(4)
    world = random_bitmap(rng, 30, 0.05)
    points = rng.uniform((-1, 2), (0.5, 3.5), (200, 2))
    corners = world.origin + 0.05 * np.argwhere(world.occupied)[:, ::-1]
    gap = np.maximum(np.maximum(corners - points[:, None], points[:, None] - corners - 0.05), 0)
    np.testing.assert_allclose(
        world.clearance(points), np.hypot(gap[..., 0], gap[..., 1]).min(1), atol=1e-12
    )


def test_a_turn_may_collide_though_both_ends_are_free():
    cells = np.zeros((40, 40), bool)
    cells[:, :3] = True
    world = BitmapWorld(cells, 0.05)
    start, end = [0.34, 1.0, 0.0], [0.34, 1.0, np.pi / 2]
    assert not world.collides(SQUARE, [start, end]).any()
    assert world.sweep_collides(SQUARE, start, end)
    assert not world.sweep_collides(SQUARE, [0.3625 + 0.01, 1.0, 0], [0.3725, 1.0, 1.5])
    # Touching is allowed, a nanometre more is not; nothing leaves the bitmap.
    assert not world.sweep_collides(SQUARE, [1.0, 1.0, 0.0], [0.3, 1.0, 0.0])
    assert world.sweep_collides(SQUARE, [1.0, 1.0, 0.0], [0.3 - 1e-8, 1.0, 0.0])
    assert world.sweep_collides(SQUARE, [1.0, 1.0, 0.0], [1.9, 1.0, 0.0])


def test_free_poses_keep_their_distance():
    world = rooms.thesis_room()
    poses = free_poses(world, 200, np.random.default_rng(5), 0.22)
    assert poses.shape == (200, 3)
    assert world.clearance(poses[:, :2]).min() >= 0.22
    assert not world.collides(SQUARE, poses).any()


def test_beams_from_lattice_points_along_grid_lines_arrive():
    rng = np.random.default_rng(6)
    world = BitmapWorld(rng.random((40, 40)) < 0.03, 1.0)
    lattice = np.stack(np.meshgrid(np.arange(1.0, 40), np.arange(1.0, 40)), -1)
    quarters = np.pi / 2 * np.arange(-4, 5)
    ranges = world.cast(lattice, quarters[:, None, None])
    # A full turn more or less changes nothing, and a point belongs to the upper right cell.
    np.testing.assert_allclose(ranges[:4], ranges[4:8], atol=1e-9)
    row, column = 7, 12
    ahead = world.occupied[row, column:]
    due = ahead.argmax() if ahead.any() else np.inf
    assert world.cast([column, row], 2 * np.pi) == pytest.approx(due)
    slanted = world.cast(lattice, np.arctan2(*np.mgrid[-3:4, -3:4].reshape(2, -1, 1, 1)))
    assert (slanted >= 0).all()


def test_beams_and_robots_from_outside_the_bitmap():
    world = BitmapWorld([[0, 0, 1, 0]], 1.0)
    # A beam flies freely until it enters the bitmap, and out there no robot may stand.
    origins = [[-3.0, 0.5], [9.0, 0.5], [-3.0, 1.5], [1e300, 0.5], [-1e12, 0.5]]
    assert world.cast(origins, [0, np.pi, 0, np.pi, 0]).tolist() == [5, 6, np.inf, np.inf, np.inf]
    poses = [[-3.0, 0.5, 0], [1e300, 0.5, 0], [0.5, 0.5, 0], [0.1, 0.5, 0]]
    assert world.collides(SQUARE, poses).tolist() == [True, True, False, True]
    assert world.is_free([[1e300, 0.5], [0.5, 0.5]]).tolist() == [False, True]
    assert world.clearance([[-3.0, 0.5], [0.5, 0.5]]).tolist() == [0.0, 1.5]


def test_empty_questions_get_empty_answers():
    world = rooms.corridor()
    assert world.cast(np.zeros((0, 2)), np.zeros(0)).shape == (0,)
    assert world.cast([1.0, 1.0], np.zeros((0,))).shape == (0,)
    assert world.cast_everywhere([]).shape == (0, 100, 600)
    assert world.collides(SQUARE, np.zeros((0, 3))).shape == (0,)
    assert world.clearance(np.zeros((2, 0, 2))).shape == (2, 0)


def test_a_bitmap_without_obstacles_stops_nothing():
    empty = BitmapWorld(np.zeros((5, 7)), 0.1)
    assert np.isinf(empty.cast([0.3, 0.2], np.linspace(-3, 3, 50))).all()
    assert np.isinf(empty.clearance([0.3, 0.2]))
    assert np.isinf(empty.cast_everywhere([0.0, 1.0])).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda w: w.cast([0.1], 0.0), "origins: expected shape"),
        (lambda w: w.cast([0.1, 0.1], np.nan), "angles: expected finite"),
        (lambda w: w.cast([0.1, 0.1], 0.0, np.nan), "max_range: expected at least 0"),
        (lambda w: w.cast_everywhere([0.0], stride=0), "stride: expected at least 1"),
        (lambda w: w.cast_everywhere([0.0], max_range=-1), "max_range: expected a number"),
        (lambda w: w.cast_everywhere(0.0), "angles: expected shape"),
        (lambda w: w.is_free([0.1, np.inf]), "points: expected finite"),
        (lambda w: w.collides(SQUARE[:2], [0, 0, 0]), "footprint: expected the vertices"),
        (lambda w: w.collides(SQUARE, [0, 0]), "poses: expected shape"),
        (lambda w: w.sweep_collides(SQUARE, [0, 0, 0], [1, 0, 1]), "end: expected a straight"),
        (lambda w: BitmapWorld(w.occupied, 0.0), "resolution: expected a number"),
        (lambda w: BitmapWorld(w.occupied, 1.0, [0.0]), "origin: expected shape"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(rooms.corridor())
