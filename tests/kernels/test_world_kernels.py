"""The compiled beams, distances and collisions of a bitmap are the plain ones, in two rooms.

In the office, 360 beams take 0.03 ms and the plain code 6: more than 40 times. The factors of all
three, and the seconds saved: "Kernels and their plain twins" in book/performance_tables.md.
"""

import numpy as np
import pytest

from slamlab.kernels import TWINS
from slamlab.worlds import BitmapWorld, bitmap, free_poses, rooms

pytestmark = pytest.mark.needs_numba(reason="there is only the plain twin")

SQUARE = 0.15 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
WORLDS = {"office": rooms.office(), "thesis": rooms.thesis_room()}


def beams(world, n=3000):
    """Beams inside and around a room: many start on grid lines, run along them, meet corners."""
    rng = np.random.default_rng(6)
    rows, columns = world.occupied.shape
    x, y = rng.uniform(-20, columns + 20, n), rng.uniform(-20, rows + 20, n)
    x[::3], y[::4] = np.rint(x[::3]), np.rint(y[::4])
    angles = rng.uniform(-np.pi, np.pi, n)
    angles[::5] = np.pi / 4 * rng.integers(-4, 5, len(angles[::5]))
    return x, y, angles, np.where(rng.random(n) < 0.5, np.inf, 100.0)


@pytest.mark.parametrize("world", WORLDS)
def test_beams_end_at_the_same_distance(world):
    world = WORLDS[world]
    assert TWINS["cast.cast_grid"] is bitmap.cast_grid.plain
    kernel = bitmap.cast_grid(world._skip, *beams(world))
    plain = bitmap.cast_grid.plain(world._skip, *beams(world))
    np.testing.assert_allclose(plain, kernel, atol=1e-9)
    assert np.isfinite(kernel).sum() > 1000
    assert np.isinf(kernel).sum() > 300


def test_beams_between_two_cells_that_touch_at_a_corner_are_stopped_by_both():
    world = BitmapWorld(np.eye(50, dtype=bool), 1.0)
    x, y = (np.array(some) for some in ([3.0, 9.0, 3.0], [7.0, 3.0, 7.0]))
    angles, reach = np.array([-1, 3, 1]) * np.pi / 4, np.full(3, 20.0)
    for cast in (bitmap.cast_grid, bitmap.cast_grid.plain):
        ranges = cast(world._skip, x, y, angles, reach)
        np.testing.assert_allclose(ranges, [np.sqrt(8), np.sqrt(18), np.inf], atol=1e-9)
    # Alone, each of the two cells beside the corner lets the beam pass.
    alone = np.array([[0, 1], [0, 0]])
    for cells in (alone, alone.T):
        skip = BitmapWorld(cells, 1.0)._skip
        for cast in (bitmap.cast_grid, bitmap.cast_grid.plain):
            assert cast(skip, *np.array([[0.5], [0.5], [np.pi / 4], [9.0]])) == np.inf


@pytest.mark.parametrize("world", WORLDS)
def test_points_are_equally_far_from_the_nearest_cell(world):
    world = WORLDS[world]
    rows, columns = world.occupied.shape
    points = np.random.default_rng(7).uniform(-10, (columns + 10, rows + 10), (1000, 2))
    arguments = *world._nearest_columns, points
    kernel = bitmap.grid_clearance(*arguments)
    np.testing.assert_array_equal(bitmap.grid_clearance.plain(*arguments), kernel)
    assert (kernel > 20).any()
    assert (kernel == 0).any()
    empty = BitmapWorld(np.zeros((5, 5), bool), 1.0)._nearest_columns
    for clearance in (bitmap.grid_clearance, bitmap.grid_clearance.plain):
        assert clearance(*empty, np.full((1, 2), 2.5)) == np.inf


def motions(world, kind, n=400):
    """Drives, turns or stands of a square from free places."""
    rng = np.random.default_rng(8)
    start = free_poses(world, n, rng, 0.15)
    end = start.copy()
    if kind == "turns":
        end[:, 2] += rng.uniform(-4, 4, n)
    if kind == "drives":
        end[:, :2] += rng.normal(0, 0.3, (n, 2))
    return start, end


@pytest.mark.parametrize("kind", ["drives", "turns", "stands"])
@pytest.mark.parametrize("world", WORLDS)
def test_the_same_motions_collide_with_cells(world, kind):
    world = WORLDS[world]
    arguments = world.occupied, world.resolution, *world.origin, SQUARE, *motions(world, kind)
    kernel = bitmap.hits_grid(*arguments)
    np.testing.assert_array_equal(bitmap.hits_grid.plain(*arguments), kernel)
    assert 0.02 < kernel.mean() < 0.98


def test_to_drive_out_of_the_grid_is_to_collide():
    starts = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    ends = starts + [[0.5, 0.0, 0.0], [0.95, 0.0, 0.0]]
    arguments = np.zeros((20, 20), bool), 0.1, 0.0, 0.0, SQUARE, starts, ends
    for hits in (bitmap.hits_grid, bitmap.hits_grid.plain):
        assert hits(*arguments).tolist() == [False, True]
