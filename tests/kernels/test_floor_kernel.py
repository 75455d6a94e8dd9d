"""The compiled loops of the exploration grid are the plain code, on scans of the office.

Their factors, and the seconds that they save in chapters 18 and 20: "Kernels and their plain
twins" in book/performance_tables.md.
"""

import numpy as np
import pytest

from slamlab.kernels import TWINS
from slamlab.navigation import ExplorationGrid, exploration_grid
from slamlab.sensors import Lidar
from slamlab.worlds import free_poses, rooms

pytestmark = pytest.mark.needs_numba(reason="there is only the plain twin")

NAMES = ("mark_walls", "mark_free", "wavefront", "unknown_area")
ROOM = rooms.office()


def explored(plain, monkeypatch, n=12):
    """A grid after some scans, the paths over it, and what scans from six places would show."""
    with monkeypatch.context() as patch:
        if plain:
            patch.setattr("slamlab.kernels.numba_serves", lambda: False)
            patch.setattr("slamlab.kernels._SAID", ["said"])
        rng, lidar = np.random.default_rng(20), Lidar(180, max_range=8.0, sigma_range=0.02)
        grid, states = ExplorationGrid(ROOM.bounds, 0.1), []
        poses = free_poses(ROOM, n, rng, 0.3)
        poses[1::2] = poses[::2] + rng.normal(0.0, 0.04, (n // 2, 3))
        for pose in np.repeat(poses, 2, axis=0):
            grid.insert(pose, lidar.scan(ROOM, pose, rng), lidar)
            states.append(grid.state.copy())
        paths = grid.shortest_paths(poses[0, :2], 0.25)
        goals = np.argwhere(np.isfinite(paths.lengths))[::97]
        ways = [paths.to((int(row), int(column))) for row, column in goals]
        gain = grid.expected_gain(poses[:6, :2], 3.0)
    return np.array(states), grid._passes, paths.lengths, paths.parents, ways, gain


def test_the_kernels_explore_as_the_plain_code(monkeypatch):
    for name in NAMES:
        assert TWINS[f"floor.{name}"] is getattr(exploration_grid, name).plain
    kernel, plain = (explored(some, monkeypatch) for some in (False, True))
    for k in (0, 1, 3):
        np.testing.assert_array_equal(kernel[k], plain[k])
    np.testing.assert_allclose(kernel[2], plain[2], rtol=1e-12)
    assert len(kernel[4]) == len(plain[4]) > 20
    for one, other in zip(kernel[4], plain[4], strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(kernel[5], plain[5], rtol=1e-12)
    assert kernel[1].any()
    assert (kernel[5] > 0).any()
    # Another set of scans leaves another grid.
    assert (explored(False, monkeypatch, n=10)[0][-1] != kernel[0][-1]).any()


@pytest.mark.parametrize("reach", [0.0, 0.3, 4.5, 30.0, np.inf])
def test_rays_end_at_their_reach_at_walls_and_at_the_edge(reach):
    state = np.random.default_rng(3).choice([0, 1, 2], (20, 30), p=[0.6, 0.35, 0.05])
    state = state.astype(np.uint8)
    points, area = np.array([[2.5, 3.5], [29.9, 19.9], [15.2, 8.8]]), []
    for count in (exploration_grid.unknown_area, exploration_grid.unknown_area.plain):
        area.append(np.zeros(3))
        count(state, points, reach, 36, area[-1])
    np.testing.assert_allclose(*area, rtol=1e-12)
    assert (area[0] > 0).any() == (reach > 0.5)
