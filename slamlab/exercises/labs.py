"""The five labs: what a student's system is given, and drives to practise on.

Lab I tracks a robot among known beacons, II maps a room, III does SLAM, IV explores and comes
home, V is SLAM from scratch. ``python -m slamlab lab`` scores a system on drives of the same kind
that nobody has seen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_choice, as_count
from slamlab.geometry import wrap_angle
from slamlab.logs import Log
from slamlab.models import Estimator, MotionModel, Pilot, View
from slamlab.navigation import YOUBOT_BODY, CoveragePilot
from slamlab.robots import YOUBOT, RelativePose, Unicycle
from slamlab.sensors import Lidar, RangeBearing
from slamlab.simulation import PerfectEstimator, record, ring_laps
from slamlab.worlds import LandmarkWorld, WallWorld, free_poses, rooms

__all__ = ["LABS", "Setting", "Task", "as_system_sees_it", "practice", "tasks"]

LABS = ("I", "II", "III", "IV", "V")
_NEAREST = 0.8  # a landmark nearer than this (m) is not seen


@dataclass(frozen=True, eq=False)
class Setting:
    """What a system knows before the robot moves.

    Attributes
    ----------
    name : str
        Of the drive.
    start : ndarray, shape (3,)
        Where the robot believes to stand (m, m, rad).
    start_cov : ndarray, shape (3, 3)
        How far that may be wrong.
    motion : MotionModel
        How it moves; `control_cov` is the noise of its controls.
    control_cov : ndarray, shape (p, p)
    dt : float
        Length of a step (s).
    sensor : RangeBearing or None
        Measures beacons or landmarks.
    lidar : Lidar or None
        Measures scans.
    beacons : ndarray, shape (n, 2), or None
        Where they stand (m), if that is known; ids are their rows.
    body : Body or None
        What must not touch anything.
    limits : ndarray, shape (p,), or None
        The motors give no control larger than this, whatever was commanded.
    max_time : float
        The drive ends after so many seconds.
    """

    name: str
    start: Array
    start_cov: Array
    motion: MotionModel
    control_cov: Array
    dt: float
    sensor: Any = None
    lidar: Any = None
    beacons: Any = None
    body: Any = None
    limits: Any = None
    max_time: float = 0.0


@dataclass(frozen=True, eq=False)
class Task:
    """One drive of a lab: what the system is given, and the truth that it is judged by.

    Attributes
    ----------
    setting : Setting
    log : Log or None
        With the truth; None where the student's pilot is to drive.
    world : WallWorld or None
    """

    setting: Setting
    log: Any = None
    world: Any = None


def practice(lab: str, seed: int = 0) -> list[Task]:
    """Draw the drives of a lab to practise on, with the truth.

    Parameters
    ----------
    lab : {"I", "II", "III", "IV", "V"}
    seed : int, default 0
        At least 0; other seeds, other drives; those of the score are never among them.

    Returns
    -------
    list of Task

    Examples
    --------
    >>> [task.setting.name for task in practice("I")]
    ['clear', 'tunnel', 'reflections']
    """
    drawn = _practised(as_choice("lab", lab, LABS), as_count("seed", seed))
    # A system may write into a setting, never into a log or a world.
    return [replace(task, setting=deepcopy(task.setting)) for task in drawn]


@lru_cache(maxsize=4)  # a notebook shows the drives and then practises on them
def _practised(lab: str, seed: int) -> list[Task]:
    return tasks(lab, np.random.default_rng((20, seed)))


def tasks(lab: str, rng: np.random.Generator) -> list[Task]:
    """Draw the drives of a lab from a random stream."""
    return _MAKERS[as_choice("lab", lab, LABS)](rng)


def recorded(
    setting: Setting,
    world: Any,
    sensor: Any,
    pilot: Pilot,
    belief: Estimator,
    rng: np.random.Generator,
    start: ArrayLike,
) -> Log:
    """Let a pilot drive in a world: `simulation.record` with the robot of a setting."""
    return record(
        *(world, setting.motion, sensor, pilot, belief, rng),
        start=start,
        dt=setting.dt,
        control_cov=setting.control_cov,
        footprint=None if setting.body is None else setting.body.footprint,
        max_time=setting.max_time,
    )


def as_system_sees_it(log: Log) -> Log:
    """Return a log without truth, landmarks and notes."""
    return replace(log, truth=None, landmarks=None, notes={})


# Driving: a pilot that knows the truth goes round some way points.


@dataclass
class _Rounds:
    """Drive from point to point at `speed` (m/s), `laps` times round."""

    points: Array
    speed: float
    laps: float
    _next: int = field(default=1)

    def command(self, view: View) -> Array | None:
        """Return v and omega towards the next point, None when the laps are done."""
        n = len(self.points)
        gap = self.points[self._next % n] - view.pose[:2]
        if np.hypot(*gap) < 0.8:
            self._next += 1
            gap = self.points[self._next % n] - view.pose[:2]
        if self._next > self.laps * n:
            return None
        turn = float(wrap_angle(np.arctan2(gap[1], gap[0]) - view.pose[2]))
        return np.array([self.speed * max(np.cos(turn), 0.2), np.clip(1.5 * turn, -1.0, 1.0)])


def _driven(
    setting: Setting, world: Any, points: ArrayLike, laps: float, rng: np.random.Generator
) -> Any:
    """Drive round and write a log; the true start is drawn from what is believed of it."""
    points = np.asarray(points, dtype=float)
    start = rng.multivariate_normal(setting.start, setting.start_cov)
    pilot = _Rounds(points, 0.6, laps)
    sensor = setting.sensor if isinstance(world, LandmarkWorld) else setting.lidar
    return recorded(setting, world, sensor, pilot, PerfectEstimator(), rng, start)


# Lab I: a robot among beacons that stand where the list says.


def _track(rng: np.random.Generator) -> list[Task]:
    found = []
    for name in ("clear", "tunnel", "reflections"):
        beacons = rng.uniform([-6.0, -5.0], [6.0, 5.0], (9, 2)).round(2)
        setting = Setting(
            name,
            start=np.array([-4.0, -3.0, 0.0]),
            start_cov=np.diag([0.3, 0.3, 0.15]) ** 2,
            motion=Unicycle(),
            control_cov=np.diag([0.08, 0.06]) ** 2,
            dt=0.25,
            sensor=RangeBearing(0.15, 0.04, max_range=5.0),
            beacons=beacons,
            max_time=75.0,
        )
        rounds = [(-4, -3), (4, -3), (4, 3), (-4, 3)]
        log = _driven(setting, LandmarkWorld(beacons), rounds, 9.0, rng)
        found.append(Task(setting, _spoilt(log, name, rng)))
    return found


def _spoilt(log: Log, name: str, rng: np.random.Generator) -> Log:
    """Switch the sensor off for 12 s in a tunnel; replace one reading in eight by an echo."""
    observations, ids = _far(zip(log.landmark_measurements or (), log.ids or (), strict=True))
    for k, z in enumerate(observations):
        if name == "tunnel" and 25.0 <= log.times[k] < 37.0:
            observations[k], ids[k] = np.empty((0, 2)), np.empty(0, dtype=int)
        elif name == "reflections":
            echo = rng.random(len(z)) < 0.125
            z[echo, 0] += rng.uniform(1.0, 4.0, int(echo.sum()))
    return replace(log, landmark_measurements=tuple(observations), ids=tuple(ids))


def _far(steps: Iterable[tuple[Array, Any]]) -> tuple[list[Array], list[Any]]:
    """Measurements and ids of each step without the landmarks that are too near to be seen."""
    kept = [(z[z[:, 0] > _NEAREST], ids[z[:, 0] > _NEAREST]) for z, ids in steps]
    return [z for z, _ in kept], [ids for _, ids in kept]


# Lab II: a scan after every step, wheels that slip a little, and a room to draw.


def _map(rng: np.random.Generator) -> list[Task]:
    found = []
    for name in ("one room", "another room"):
        world = rooms.random_box_room(rng)
        setting = _youbot(name, world, rng, np.diag([0.02, 0.02, 0.01]) ** 2, 400.0)
        pilot = CoveragePilot(setting.body, setting.lidar, home=False)
        log = recorded(
            setting, world, setting.lidar, pilot, PerfectEstimator(), rng, setting.start
        )
        found.append(Task(setting, log, world))
    return found


def _youbot(
    name: str, world: WallWorld, rng: np.random.Generator, cov: Array, max_time: float
) -> Setting:
    return Setting(
        name,
        start=free_poses(world, 1, rng, 0.5)[0],
        start_cov=np.zeros((3, 3)),
        motion=YOUBOT,
        control_cov=cov,
        dt=0.2,
        lidar=Lidar(180, max_range=8.0, offset=0.2, sigma_range=0.02),
        body=YOUBOT_BODY,
        limits=np.array([0.5, 0.5, 0.8]),
        max_time=max_time,
    )


# Lab III: a hall, a long loop, and a crowd of landmarks without names.


def _slam(rng: np.random.Generator) -> list[Task]:
    hall: dict[str, Any] = dict(size=(14.0, 10.0), block=3.2, n=24, laps=2.0)
    loop: dict[str, Any] = dict(size=(24.0, 16.0), block=3.2, n=40, laps=1.5)
    crowd: dict[str, Any] = dict(size=(14.0, 10.0), block=3.2, n=40, laps=2.0)
    return [
        _ring("hall", rng, **hall),
        _ring("loop", rng, **loop),
        _ring("crowd", rng, **crowd, named=False, p_detect=0.85, clutter_rate=0.3),
    ]


def _ring(
    name: str,
    rng: np.random.Generator,
    size: tuple[float, float],
    block: float,
    n: int,
    laps: float,
    named: bool = True,
    **chances: float,
) -> Task:
    """Drive round a block in a hall, with landmarks on the floor and niches in the walls."""
    w, h = size
    world = WallWorld.from_polygons(
        [(0, 0), (w, 0), (w, h), (0, h)],
        [(block, block), (w - block, block), (w - block, h - block), (block, h - block)],
        *_niches(w, h, rng),
    )
    m = 0.5 * block
    setting = Setting(
        name,
        start=np.array([m + 1.0, m, 0.0]),
        start_cov=np.zeros((3, 3)),
        motion=Unicycle(),
        control_cov=np.diag([0.06, 0.04]) ** 2,
        dt=0.25,
        sensor=RangeBearing(0.08, 0.02, max_range=3.5),
        lidar=Lidar(120, max_range=6.0, sigma_range=0.02),
        max_time=400.0,
    )
    log = _driven(setting, world, [(m, m), (w - m, m), (w - m, h - m), (m, h - m)], laps, rng)
    landmarks = rng.uniform((0, 0), size, (20 * n, 2))
    landmarks = landmarks[world.is_free(landmarks)][:n]
    observations, ids = _far(
        setting.sensor.measure(pose, landmarks, rng, **chances) for pose in log.truth
    )
    log = replace(
        log, landmark_measurements=tuple(observations), ids=tuple(ids) if named else None
    )
    return Task(setting, log, world)


def _niches(w: float, h: float, rng: np.random.Generator) -> list[Array]:
    """Boxes along the outer walls, so that one stretch of a corridor differs from the next."""
    boxes = []
    for left in np.arange(1.0, w - 2.0, 3.0) + rng.uniform(0, 1.5):
        deep, wide = rng.uniform(0.2, 0.7), rng.uniform(0.3, 1.0)
        y = 0.0 if rng.random() < 0.5 else h - deep
        boxes.append([(left, y), (left + wide, y), (left + wide, y + deep), (left, y + deep)])
    return [np.array(box) for box in boxes]


# Lab IV: rooms to explore; the drive is the student's.


def _explore(rng: np.random.Generator) -> list[Task]:
    found = []
    for name in ("first room", "second room"):
        world = rooms.random_box_room(rng)
        setting = _youbot(name, world, rng, np.diag([0.03, 0.03, 0.02]) ** 2, 300.0)
        found.append(Task(setting, None, world))
    return found


# Lab V: laps of a corridor, scans and odometry.


def _corridors(rng: np.random.Generator) -> list[Task]:
    found = []
    lidar = Lidar(180, max_range=8.0, sigma_range=0.01)
    for name, low in (("short laps", (15.0, 11.0)), ("long laps", (24.0, 15.0))):
        width, height = rng.uniform(low, np.add(low, 3.0))
        log = ring_laps((width, height), rng, lidar, laps=1.6)
        setting = Setting(
            name, np.zeros(3), np.zeros((3, 3)), RelativePose(), np.eye(3), dt=1.0, lidar=lidar
        )
        found.append(Task(setting, log))
    return found


_MAKERS: dict[str, Callable[[np.random.Generator], list[Task]]] = {
    "I": _track,
    "II": _map,
    "III": _slam,
    "IV": _explore,
    "V": _corridors,
}
