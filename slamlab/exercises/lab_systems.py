"""The library's own systems on the drives of the labs: the bar that a student's system meets."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array
from slamlab.evaluation import run
from slamlab.exercises.labs import Setting, Task, as_system_sees_it
from slamlab.filters import extended
from slamlab.gaussian import Gaussian
from slamlab.localization import DeadReckoning
from slamlab.mapping import OccupancyGrid
from slamlab.navigation import CoveragePilot
from slamlab.slam import Confirmation, EKFSlam, FastSlam, HectorSlam, ScanGraphSlam

__all__ = ["cartographers", "explorers", "slam_systems", "trackers"]

Makers = dict[str, Callable[[Setting], Any]]
Drawing = tuple[Array, float, Array]


class _BeaconFilter:
    """Extended Kalman filter among known beacons; readings beyond the gate are left out."""

    measures = "landmarks"

    def __init__(self, setting: Setting, gate: float) -> None:
        self._setting, self._gate = setting, gate
        self._belief = Gaussian(setting.start, setting.start_cov)

    @property
    def pose(self) -> Array:
        return self._belief.mean.copy()

    @property
    def pose_cov(self) -> Array:
        return self._belief.cov.copy()

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        motion, pose = self._setting.motion, self._belief.mean
        F_x, F_u = motion.jacobians(pose, u, dt)
        there, Q = motion.step(pose, u, dt), F_u @ np.asarray(control_cov) @ F_u.T
        self._belief = extended.predict(self._belief, lambda _: there, F_x, Q)

    def update(self, z: ArrayLike, ids: Any = None) -> None:
        sensor, beacons = self._setting.sensor, self._setting.beacons
        for reading, beacon in zip(np.asarray(z), beacons[np.asarray(ids)], strict=True):
            H, _ = sensor.jacobians(self.pose, beacon)
            h = partial(sensor.observe, landmark=beacon)
            belief, innovation = extended.update(
                self._belief, reading, h, H, sensor.cov, residual=sensor.residual
            )
            if innovation.nis < self._gate:
                self._belief = belief


def trackers(task: Task) -> Makers:
    """Return makers of the trackers of lab I, by name."""
    return {
        "dead reckoning": lambda s: DeadReckoning(s.motion, s.start, s.start_cov),
        "EKF, every reading": lambda s: _BeaconFilter(s, np.inf),
        "EKF with a gate": lambda s: _BeaconFilter(s, 9.21),
    }


def slam_systems(task: Task) -> Makers:
    """Return makers of the SLAM systems of lab III, by name."""
    named = task.log is not None and task.log.ids is not None
    chances = None if named else (0.85, 0.02)
    rng = np.random.default_rng(0)
    return {
        "dead reckoning": lambda s: DeadReckoning(s.motion, s.start),
        "EKFSlam": lambda s: EKFSlam(s.motion, s.sensor, s.start, associate=Confirmation()),
        "FastSlam": lambda s: FastSlam(
            s.motion, s.sensor, s.start, 30, version=2, rng=rng, detection_probabilities=chances
        ),
        "HectorSlam": lambda s: HectorSlam(s.lidar, s.start, motion=s.motion),
        "ScanGraphSlam": lambda s: ScanGraphSlam(s.lidar, s.start, motion=s.motion),
    }


def _drawn(task: Task, poses: Array) -> Drawing:
    """Occupancy grid of a log along some poses."""
    log, lidar = task.log, task.setting.lidar
    grid = OccupancyGrid((64, 64), 0.05, poses[0, :2] - 1.6)
    for pose, ranges in zip(poses, log.ranges, strict=True):
        grid.insert(pose, ranges, lidar)
    return grid.probability, grid.resolution, grid.origin


def cartographers() -> dict[str, Callable[[Task], Drawing]]:
    """Lab II; the truth's own map is no system, but nothing can be expected to beat it by much."""

    def follow(make: Callable[[Setting], Any]) -> Callable[[Task], Drawing]:
        def draw(task: Task) -> Drawing:
            log = as_system_sees_it(task.log)
            return _drawn(task, run(make(task.setting), log).trajectory)

        return draw

    return {
        "grid, dead reckoning": follow(lambda s: DeadReckoning(s.motion, s.start)),
        "grid, HectorSlam": follow(lambda s: HectorSlam(s.lidar, s.start, motion=s.motion)),
        "grid, ScanGraphSlam": follow(lambda s: ScanGraphSlam(s.lidar, s.start, motion=s.motion)),
        "(grid, true poses)": lambda task: _drawn(task, _truth(task)),
    }


def _truth(task: Task) -> Array:
    return task.log.truth


def mappers(everyone: bool) -> dict[str, Callable[[Task], tuple[Array]]]:
    """Return the odometry of lab V and, if asked for, the library's systems: paths of a log."""

    def path_of(make: Callable[[Setting], Any]) -> Callable[[Task], tuple[Array]]:
        return lambda task: (run(make(task.setting), task.log).trajectory,)

    known = {"odometry": path_of(lambda s: DeadReckoning(s.motion, s.start))}
    if everyone:
        known["ScanGraphSlam, no closures"] = path_of(
            lambda s: ScanGraphSlam(s.lidar, s.start, motion=s.motion, loops=False)
        )
        known["ScanGraphSlam"] = path_of(
            lambda s: ScanGraphSlam(s.lidar, s.start, motion=s.motion)
        )
    return known


class _Explorer:
    """A belief and a pilot in one."""

    def __init__(self, belief: Any, setting: Setting) -> None:
        self._belief, self._pilot = belief, CoveragePilot(setting.body, setting.lidar)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._pilot if name == "command" else self._belief, name)


def explorers(task: Task) -> Makers:
    """Return makers of the explorers of lab IV, by name."""
    return {
        "CoveragePilot, dead reckoning": lambda s: _Explorer(DeadReckoning(s.motion, s.start), s),
        "CoveragePilot, HectorSlam": lambda s: _Explorer(
            HectorSlam(s.lidar, s.start, motion=s.motion), s
        ),
    }
