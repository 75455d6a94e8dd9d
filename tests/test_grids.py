"""The frame of every grid: cells of points, centres, extent, growing."""

import numpy as np
import pytest

from slamlab.grids import Grid
from slamlab.mapping import OccupancyGrid
from slamlab.navigation import ExplorationGrid
from slamlab.worlds import BitmapWorld

GRID = Grid((3, 5), 0.5, (-1.0, 2.0))


def test_every_grid_of_the_house_is_one():
    bitmap = BitmapWorld(np.zeros((3, 5)), 0.5, (-1.0, 2.0))
    occupancy = OccupancyGrid((3, 5), 0.5, (-1.0, 2.0))
    for grid in (bitmap, occupancy, ExplorationGrid(GRID.bounds, 0.5)):
        assert grid.shape == (3, 5)
        assert grid.extent == GRID.extent
        np.testing.assert_array_equal(grid.centres(), GRID.centres())
        np.testing.assert_array_equal(grid.cells([0.3, 2.6]), [1, 2])
        assert repr(grid) == f"{type(grid).__name__}(3 x 5 cells of 0.5 m)"


def test_centres_lie_in_their_cells_and_borders_belong_to_the_right_and_upper_cell():
    rows, columns = np.meshgrid(np.arange(3), np.arange(5), indexing="ij")
    np.testing.assert_array_equal(GRID.cells(GRID.centres()), np.stack([rows, columns], -1))
    np.testing.assert_array_equal(GRID.centres(2), GRID.centres()[::2, ::2])
    part = GRID.centres_of(slice(1, 3), slice(-2, None))
    np.testing.assert_array_equal(part, GRID.centres()[1:3, -2:])
    assert GRID.cells([-0.5, 2.5]).tolist() == [1, 1]
    assert GRID.holds([[0, 0], [2, 4], [3, 0], [0, -1]]).tolist() == [True, True, False, False]


def test_bounds_and_extent_are_the_two_orders_of_one_rectangle():
    assert GRID.bounds == (-1.0, 2.0, 1.5, 3.5)
    assert GRID.extent == (-1.0, 1.5, 2.0, 3.5)
    assert Grid.over([0, 0, 1.2, 0.9], 0.5).shape == (2, 3)
    assert Grid.over([0, 0, 1.5, 1.0], 0.5).shape == (2, 3), "rounding adds no empty column"


def test_growing_adds_whole_cells_and_a_point_keeps_its_cell():
    grid = Grid((8, 8), 0.1)
    points = np.random.default_rng(1).uniform(0, 0.8, (200, 2))
    before = grid.cells(points)
    added = grid.grow(np.array([[-0.31, 0.5], [np.nan, np.nan], [0.5, 1.29]]))
    assert added == ((0, 7), (6, 0)), "five above and four to the left, a quarter of eight more"
    assert grid.shape == (15, 14)
    np.testing.assert_array_equal(grid.cells(points) - before, [[0, 6]] * 200)
    assert grid.grow(np.array([[-0.31, 1.29]])) is None
    assert grid.grow(grid.centres()[[0], [0]], margin=1) is not None


def test_a_grid_that_would_grow_without_end_stays_as_it_was():
    grid = Grid((8, 8), 0.1)
    with pytest.raises(ValueError, match="would have to grow"):
        grid.grow(np.array([[1e9, 0.0]]))
    assert grid.shape == (8, 8)
    with pytest.raises(ValueError, match="read-only"):
        grid.origin[0] = 1.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Grid((0, 1), 1.0), "shape"),
        (lambda: Grid((1, 1), 0.0), "resolution"),
        (lambda: Grid((1, 1), 1.0, (0, np.nan)), "origin"),
        (lambda: Grid.over([0, 0, 0, 1], 1.0), "bounds: expected left < right"),
        (lambda: Grid.over([0, 0, 1, 1], -1.0), "resolution"),
        (lambda: GRID.cells([1, 2, 3]), "points"),
        (lambda: GRID.centres(0), "stride"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("shape", [(10.5, 3), (3,), (3, 4, 5), 7, "ab", None, (0, 3), (True, "x")])
def test_half_a_row_and_other_shapes_are_refused(shape):
    with pytest.raises(ValueError, match="shape"):
        Grid(shape, 0.1)
