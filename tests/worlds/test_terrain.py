"""Rough ground: heights between cells, patches of different roughness, hills."""

import numpy as np
import pytest

from slamlab.grids import Grid
from slamlab.worlds import Terrain


def rng(seed=1):
    return np.random.default_rng(seed)


def test_heights_belong_to_the_centres_of_cells():
    grid = Grid((3, 4), 0.5, (1.0, -1.0))
    heights = rng().normal(size=grid.shape)
    ground = Terrain(grid, heights)
    np.testing.assert_allclose(ground.height(grid.centres()), heights)
    between = 0.5 * (grid.centres()[1, 1] + grid.centres()[1, 2])
    assert ground.height(between) == pytest.approx(heights[1, 1:3].mean())
    # Wrong: the corner of a cell is half a cell away.
    assert abs(ground.height(grid.origin + [0.5, 0.5]) - heights[1, 1]) > 0.05


def test_a_plane_is_a_plane_between_the_cells():
    grid = Grid((30, 40), 0.1)
    x, y = grid.centres().transpose(2, 0, 1)
    ground = Terrain(grid, 0.3 * x - 0.2 * y + 1)
    points = rng().uniform(0.1, 2.8, (50, 2))
    np.testing.assert_allclose(ground.height(points), points @ [0.3, -0.2] + 1)


def test_patches_differ_as_they_were_asked_to():
    ground = Terrain.rough(rng(), (20.0, 20.0), roughness=0.03, spread=0.9, relief=0.2)
    bumps = (ground.heights - ground.relief).reshape(40, 10, 40, 10)
    sigma = bumps.std((1, 3))
    assert np.median(sigma) == pytest.approx(0.03, rel=0.1)
    assert np.log(sigma).std() == pytest.approx(0.9, rel=0.1)
    assert ground.relief.std() == pytest.approx(0.2)
    alike = Terrain.rough(rng(), (20.0, 20.0), spread=0.0, relief=0.0)
    assert np.log(alike.heights.reshape(40, 10, 40, 10).std((1, 3))).std() < 0.1


def test_the_same_seed_draws_the_same_ground_and_nobody_can_change_it():
    one, other = Terrain.rough(rng(3), (5, 5)), Terrain.rough(rng(3), (5, 5))
    np.testing.assert_array_equal(one.heights, other.heights)
    with pytest.raises(ValueError, match="read-only"):
        one.heights[0, 0] = 1.0
    assert repr(one) == "Terrain(100 x 100 cells of 0.05 m)"
    assert one.bounds == (0.0, 0.0, 5.0, 5.0)


@pytest.mark.parametrize(
    ("message", "build"),
    [
        ("grid: expected a Grid", lambda: Terrain(3, [[1.0]])),
        ("heights: expected shape", lambda: Terrain(Grid((2, 2), 1.0), np.zeros((2, 3)))),
        ("relief: expected shape", lambda: Terrain(Grid((1, 1), 1.0), [[0.0]], [0.0])),
        ("rng", lambda: Terrain.rough(1)),
        ("patch", lambda: Terrain.rough(rng(), patch=0.01)),
        ("roughness", lambda: Terrain.rough(rng(), roughness=-1.0)),
        ("points: expected shape", lambda: Terrain.rough(rng(), (2, 2)).height([1.0])),
    ],
)
def test_bad_ground_is_named(message, build):
    with pytest.raises(ValueError, match=message):
        build()
