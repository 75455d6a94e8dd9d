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
from slamlab.slam import EKFSlam, FastSlam, HectorSlam, ScanGraphSlam
from slamlab.slam.association import Confirmation

__all__ = ["systems"]

Makers = dict[str, Callable[[Setting], Any]]


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


class _Explorer:
    """A belief and a pilot in one."""

    def __init__(self, belief: Any, setting: Setting) -> None:
        self._belief, self._pilot = belief, CoveragePilot(setting.body, setting.lidar)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._pilot if name == "command" else self._belief, name)


def _dead_reckoning(s: Setting) -> DeadReckoning:
    return DeadReckoning(s.motion, s.start)


def _hector(s: Setting) -> HectorSlam:
    return HectorSlam(s.lidar, s.start, motion=s.motion)


def _scan_graph(s: Setting, loops: bool = True) -> ScanGraphSlam:
    return ScanGraphSlam(s.lidar, s.start, motion=s.motion, loops=loops)


# What makes the systems of a lab, by name.
TRACKERS: Makers = {
    "dead reckoning": lambda s: DeadReckoning(s.motion, s.start, s.start_cov),
    "EKF, every reading": lambda s: _BeaconFilter(s, np.inf),
    "EKF with a gate": lambda s: _BeaconFilter(s, 9.21),
}
CARTOGRAPHERS: Makers = {
    "grid, dead reckoning": _dead_reckoning,
    "grid, HectorSlam": _hector,
    "grid, ScanGraphSlam": _scan_graph,
}
EXPLORERS: Makers = {
    "CoveragePilot, dead reckoning": lambda s: _Explorer(_dead_reckoning(s), s),
    "CoveragePilot, HectorSlam": lambda s: _Explorer(_hector(s), s),
}
MAPPERS: Makers = {
    "odometry": _dead_reckoning,
    "ScanGraphSlam, no closures": partial(_scan_graph, loops=False),
    "ScanGraphSlam": _scan_graph,
}


def _slam_systems(task: Task) -> Makers:
    named = task.log is not None and task.log.ids is not None
    chances = None if named else (0.85, 0.02)
    rng = np.random.default_rng(0)
    return {
        "dead reckoning": _dead_reckoning,
        "EKFSlam": lambda s: EKFSlam(s.motion, s.sensor, s.start, associate=Confirmation()),
        "FastSlam": lambda s: FastSlam(
            s.motion, s.sensor, s.start, 30, version=2, rng=rng, detection_probabilities=chances
        ),
        "HectorSlam": _hector,
        "ScanGraphSlam": _scan_graph,
    }


def systems(lab: str, task: Task) -> dict[str, Callable[[], Any]]:
    """Return what the library has to say of a drive, by the name of the system that says it.

    Each call begins anew, and gives what a student's function gives: a system, in lab II a map,
    in lab V a path. Dead reckoning comes first. The truth's own map in lab II is no system, but
    nothing can be expected to beat it by much.
    """
    known = {"I": TRACKERS, "II": CARTOGRAPHERS, "IV": EXPLORERS, "V": MAPPERS}
    makers = _slam_systems(task) if lab == "III" else known[lab]
    begun = {who: partial(make, task.setting) for who, make in makers.items()}
    if lab == "II":
        maps = {who: partial(_mapped, task, make) for who, make in begun.items()}
        return {**maps, "(grid, true poses)": partial(_drawn, task, task.log.truth)}
    if lab == "V":
        return {who: partial(_path, task, make) for who, make in begun.items()}
    return {**begun}


def _path(task: Task, make: Callable[[], Any]) -> tuple[Array]:
    return (run(make(), task.log).trajectory,)


def _mapped(task: Task, make: Callable[[], Any]) -> tuple[Array, float, Array]:
    return _drawn(task, run(make(), as_system_sees_it(task.log)).trajectory)


def _drawn(task: Task, poses: Array) -> tuple[Array, float, Array]:
    """Occupancy grid of a log along some poses."""
    grid = OccupancyGrid((64, 64), 0.05, poses[0, :2] - 1.6)
    grid.insert(poses, task.log.ranges, task.setting.lidar)
    return grid.probability, grid.resolution, grid.origin
