"""Compile now, once, the loops that lessons call, so that they need not wait.

The code is kept: beside the library or, where that cannot be written, in numba's folder for the
user. A second call takes seconds.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from slamlab.localization import SignatureMap
from slamlab.mapping import OccupancyGrid
from slamlab.matching import (
    LikelihoodGrid,
    match_correlative,
    match_field,
    match_icp,
    voxel_downsample,
)
from slamlab.navigation import ExplorationGrid, PathMemory
from slamlab.sensors import Lidar, StereoRig
from slamlab.slam import GammaSlam, GridFastSlam
from slamlab.worlds import BitmapWorld, Terrain, WallWorld, rooms

__all__ = ["arguments", "run"]


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the command takes: nothing."""


def run(options: argparse.Namespace) -> None:
    """Run a small piece of work of every kind; print how long each took."""
    for work in WORK:
        start = time.perf_counter()
        work()
        print(f"{work.__doc__} {time.perf_counter() - start:.1f} s", flush=True)


def _scans() -> None:
    """Lidar in rooms, occupancy grid, seen floor."""
    lidar = Lidar(36, max_range=10.0)
    for world in (_room(), WallWorld([[[0, 0], [4, 0]], [[4, 0], [4, 4]], [[4, 4], [0, 0]]])):
        ranges = lidar.scan(world, [3.0, 1.0, 0.3])
        world.collides([[0.1, 0.1], [0.1, -0.1], [-0.1, 0.1]], [3.0, 1.0, 0.3])
        world.clearance([3.0, 1.0])
    rooms.random_box_room(np.random.default_rng(1))
    OccupancyGrid((40, 40), 0.1).insert([3.0, 1.0, 0.3], ranges, lidar)
    floor = ExplorationGrid([0.0, 0.0, 4.0, 4.0])
    floor.insert([3.0, 1.0, 0.3], ranges, lidar)
    floor.plan([3.0, 1.0], [3.2, 1.2], 0.1)
    floor.expected_gain([[3.0, 1.0]], 2.0)


def _matching() -> None:
    """Scan matching."""
    points = np.random.default_rng(1).uniform(-2, 2, (60, 2))
    field, guess = LikelihoodGrid.of_points(points, 0.1), np.array([0.01, 0.0, 0.01])
    # Fields of points hold single precision, maps double.
    for one in (
        field,
        LikelihoodGrid(field.values.astype(np.float64), field.resolution, field.origin),
    ):
        one.value(points)
        match_field(one, points, guess)
    match_correlative(field, points, guess, 0.3, 0.2)
    match_icp(voxel_downsample(points), points, guess)


def _grid_slam() -> None:
    """SLAM with particles that carry grids."""
    rng = np.random.default_rng(1)
    lidar, rig, here = Lidar(36, max_range=10.0), StereoRig(200), [3.0, 1.0, 0.3]
    for model in ("matching", "penetration"):
        scans = GridFastSlam(lidar, here, 2, rng=rng, model=model)
        for _ in range(2):
            scans.update(lidar.scan(_room(), here))
    ground = Terrain.rough(rng, (6.0, 6.0))
    GammaSlam(rig, here, 2, rng=rng).update(rig.scan(ground, here))


def _signatures() -> None:
    """Scan signatures."""
    lidar = Lidar(36)
    SignatureMap.build(_room(), lidar, 4).locate(lidar.scan(_room(), [3.0, 1.0, 0.3]))


def _path() -> None:
    """Path memory."""
    memory = PathMemory(0.005)
    for t in np.linspace(0.0, 6.3, 60):
        memory.add([2 * np.cos(t), np.sin(2 * t)])
    memory.nearest([0.3, 0.2])
    memory.point_at(0.5)


def _room() -> BitmapWorld:
    occupied = np.pad(np.zeros((38, 38), bool), 1, constant_values=True)
    occupied[10:14, 5:9] = True
    return BitmapWorld(occupied, 0.1)


WORK: tuple[Callable[[], None], ...] = (_scans, _matching, _grid_slam, _signatures, _path)
