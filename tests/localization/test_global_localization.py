"""A lidar in a known map: found from anywhere, tracked, lost again, and never found elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from slamlab.evaluation import run
from slamlab.geometry import between, wrap_angle
from slamlab.localization import LikelihoodField, MonteCarloLocalization
from slamlab.localization.global_localization import GlobalLocalization
from slamlab.logs import Log
from slamlab.mapping import OccupancyGrid
from slamlab.robots import RelativePose
from slamlab.sensors import Lidar
from slamlab.worlds import BitmapWorld, rooms

LIDAR = Lidar(120, max_range=20.0, sigma_range=0.02)
COV = np.diag([0.03, 0.02, 0.02]) ** 2
CELL = 0.1


def bitmap(world):
    """The walls of a room as somebody's map, and its floor as far as it was seen."""
    grid = OccupancyGrid((10, 10), CELL)
    poses = tour(world)
    ranges = LIDAR.scan(world, poses, np.random.default_rng(0))
    grid.insert(poses, ranges, LIDAR, free_missing=False)
    image = grid.to_image()[::-1]
    return (BitmapWorld(cells, CELL, grid.origin) for cells in (image == 0, image != 254))


def tour(world, n=120):
    """Poses along the corridor of the office, to its end and back."""
    x = 6.0 - 5.0 * np.cos(np.linspace(0, 2 * np.pi, n))
    y = 4.0 + 0.2 * np.sin(3 * x)
    heading = np.where(np.gradient(x) >= 0, 0.0, np.pi) + 0.1 * np.sin(x)
    return np.column_stack([x, y, heading])


WORLD = rooms.office()
WALLS, FLOOR = bitmap(WORLD)


def drive(path, seed, world=WORLD):
    rng = np.random.default_rng(seed)
    u = np.zeros((len(path), 3))
    u[1:] = between(path[:-1], path[1:]) + rng.normal(0, np.sqrt(np.diag(COV)), (len(path) - 1, 3))
    return Log(
        np.arange(len(path)),
        u,
        np.r_[0.0, np.ones(len(path) - 1)],
        COV,
        ranges=LIDAR.scan(world, path, rng),
        scan=LIDAR,
        truth=path,
        controls="displacement",
    )


def start(seed, **options):
    rng = np.random.default_rng(seed)
    return GlobalLocalization(WALLS, LIDAR, RelativePose(), rng, FLOOR, **options)


@pytest.mark.parametrize("seed", range(6))
def test_the_robot_is_found_wherever_it_begins(seed):
    path = tour(WORLD)[10 * seed :][:60]
    log = drive(path, seed)
    system = run(start(seed), log).system
    assert system.localized
    off = np.hypot(*between(path, system.trajectory)[:, :2].T)
    assert np.median(off) < 0.05
    assert off.max() < 0.5  # the scans before it was found, too
    by_wheels = run(start(seed, n_particles=1), log[:1]).system  # the wrong form: one particle
    assert not by_wheels.localized


def test_a_robot_that_was_carried_off_is_found_again():
    turn = np.linspace(0, 4 * np.pi, 80)
    round_ = np.column_stack(
        [3.7 + 0.3 * np.cos(turn), 5.8 + 0.3 * np.sin(turn), turn + np.pi / 2]
    )
    carried = np.concatenate([tour(WORLD)[:30], wrapped(round_)])
    log = drive(carried, 1)
    u = log.u.copy()
    u[30] = 0.0  # nobody told the wheels
    system = GlobalLocalization(WORLD, LIDAR, RelativePose(), np.random.default_rng(1))
    run(system, replace(log, u=u))
    assert system.localized_at > 30
    assert np.hypot(*between(carried, system.trajectory)[-1, :2]) < 0.2


def wrapped(path):
    return np.column_stack([path[:, :2], wrap_angle(path[:, 2])])


def test_in_the_map_of_another_building_it_is_not_found():
    world = rooms.thesis_room_two()
    path = np.column_stack([np.full((60, 2), 0.5), np.linspace(0.0, 3.0, 60)])
    system = run(start(2), drive(path, 2, world)).system
    assert not system.localized
    assert np.median(system.fits) < 0.8


def test_a_failed_update_changes_nothing():
    system = start(3)
    system.update(LIDAR.scan(WORLD, tour(WORLD)[0], np.random.default_rng(0)))
    before = system.pose, len(system.fits), len(system.trajectory)
    with pytest.raises(ValueError, match=r"^ranges: "):
        system.update(np.full(LIDAR.n_beams, -1.0))
    with pytest.raises(ValueError, match=r"^control_cov: "):
        system.predict([0.1], 1.0, COV)
    assert np.array_equal(system.pose, before[0])
    assert (len(system.fits), len(system.trajectory)) == before[1:]


def test_particles_from_anywhere_begin_on_free_floor():
    field = LikelihoodField(WALLS.occupied, CELL, WALLS.origin)
    bounds = [[0.0, 12.0], [0.0, 8.0]]
    given = (field, RelativePose(), LIDAR, 2000, bounds)
    cloud = MonteCarloLocalization(*given, np.random.default_rng(0), free=FLOOR.is_free)
    assert FLOOR.is_free(cloud.poses[:, :2]).all()
    anywhere = MonteCarloLocalization(*given, np.random.default_rng(0))
    assert not FLOOR.is_free(anywhere.poses[:, :2]).all()
    with pytest.raises(ValueError, match=r"^free: expected free floor within bounds"):
        MonteCarloLocalization(
            *given, np.random.default_rng(0), free=lambda points: np.zeros(len(points), bool)
        )


def test_unknown_cells_of_a_map_are_walls_or_free(tmp_path):
    grid = OccupancyGrid((20, 20), 0.1)
    grid.insert([2.0, 4.0, 0.0], Lidar(60).scan(WORLD, [2.0, 4.0, 0.0]), Lidar(60))
    grid.save_ros(tmp_path / "map.yaml")
    walls = BitmapWorld.from_file(tmp_path / "map.yaml", unknown="free")
    closed = BitmapWorld.from_file(tmp_path / "map.yaml")
    image = grid.to_image()[::-1]
    assert np.array_equal(walls.occupied, image == 0)
    assert np.array_equal(closed.occupied, image != 254)
    with pytest.raises(ValueError, match=r"^unknown: "):
        BitmapWorld.from_file(tmp_path / "map.yaml", unknown="maybe")
