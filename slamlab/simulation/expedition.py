"""Out into an unknown building and back to the marked start: the experiment of chapter 20.

Newman, Leonard, Tardos and Neira, ICRA 2002, showed a robot that explores and comes home; P2 names
it among its examples, P3 brings a robot home without a map. One way out, three ways back.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from slamlab import datasets
from slamlab._checks import Array, as_array, as_choice, as_count
from slamlab.evaluation.tours import coverage, path_length
from slamlab.gaussian import chi2_quantile, mahalanobis_squared
from slamlab.localization import DeadReckoning
from slamlab.logs import Log
from slamlab.models import Estimator, MotionModel, Smoother, World
from slamlab.navigation import YOUBOT_BODY, CollisionGuard, CoveragePilot, ReturnPilot
from slamlab.robots import YOUBOT
from slamlab.sensors import Lidar
from slamlab.simulation.record import record
from slamlab.slam import GridFastSlam, ScanGraphSlam, WallSlam
from slamlab.worlds import rooms

__all__ = [
    "ESTIMATORS",
    "ENVIRONMENTS",
    "RETURN_METHODS",
    "Building",
    "Outward",
    "Return",
    "MiscalibratedOdometry",
    "come_home",
    "explore",
    "results",
]

STORED = Path(datasets.__file__).parent / "data" / "expeditions.json"
HOME_RADIUS = 0.15  # home is within so much of the mark (m)
COVERAGE_TARGET = 0.95  # and after having seen so much of the floor
_SPEED, _TURN, _DT = 0.6, 1.0, 0.2
_AGAIN = 8.0  # of the first way, driven once more before the robot stops (m)
_GATE = float(chi2_quantile(0.95, 2))


@dataclass(frozen=True)
class MiscalibratedOdometry(MotionModel):
    """A youBot whose wheels are not what its odometry takes them for.

    Parameters
    ----------
    scale : float, default 1.0
        Every wheel is so many times as large: it drives and turns that much farther.
    drift : float, default 0.0
        Heading gained on each metre ahead (rad/m): one side is larger than the other.
    """

    scale: float = 1.0
    drift: float = 0.0

    def _really(self, u: ArrayLike) -> Array:
        u = as_array("u", u, ("...", 3))
        return self.scale * u + self.drift * u[..., :1] * [0.0, 0.0, 1.0]

    def step(self, pose: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Pose (..., 3) after u = (v_x, v_y, omega) as the odometry has it, for dt (s)."""
        return YOUBOT.step(pose, self._really(u), dt)

    def jacobians(self, pose: ArrayLike, u: ArrayLike, dt: float) -> tuple[Array, Array]:
        """Return the derivatives of `step` by pose, (..., 3, 3), and by u, (..., 3, 3)."""
        F_x, F_u = YOUBOT.jacobians(pose, self._really(u), dt)
        really = self.scale * np.eye(3)
        really[2, 0] += self.drift
        return F_x, F_u @ really


@dataclass(frozen=True)
class Building:
    """Where an expedition takes place.

    Attributes
    ----------
    world : callable
        Makes the building.
    start : tuple of float
        The mark (m, m, rad).
    lidar : Lidar
    view_range : float
        Floor nearer than this counts as explored (m).
    margin : float
        Room that the guard keeps round the body (m).
    sigma_wheel : float
        Noise of each wheel (rad/s).
    scale, drift : float
        How far the wheels are worn at most, see `MiscalibratedOdometry`.
    budget : float
        Seconds for the way out, and again for the way home.
    """

    world: Callable[[], World]
    start: tuple[float, float, float]
    lidar: Lidar
    view_range: float
    margin: float
    sigma_wheel: float = 0.3
    scale: float = 0.02
    drift: float = np.deg2rad(0.1)
    budget: float = 240.0

    @cached_property
    def built(self) -> World:
        """The building itself: out and home, and for everybody, it is the same."""
        return self.world()


_NEAR_SIGHTED = Lidar(180, max_range=5.0, offset=0.3, sigma_range=0.01)
#: The three buildings of the chapter.
ENVIRONMENTS = {
    "office": Building(
        rooms.office,
        (2.0, 4.0, 0.0),
        Lidar(180, max_range=8.0, offset=0.3, sigma_range=0.01),
        view_range=2.0,
        margin=0.06,
    ),
    "ring": Building(rooms.ring, (15.8, 1.4, 0.0), _NEAR_SIGHTED, view_range=2.5, margin=0.12),
    "corridor": Building(
        rooms.long_corridor, (2.5, 1.0, 0.0), _NEAR_SIGHTED, view_range=2.5, margin=0.12
    ),
}

Maker = Callable[[Lidar, Array, np.random.Generator], Estimator]
#: What the robot may believe with; each is made from lidar, start and random numbers.
ESTIMATORS: dict[str, Maker] = {
    "dead reckoning": lambda lidar, start, rng: DeadReckoning(YOUBOT, start),
    "scan matching": lambda lidar, start, rng: ScanGraphSlam(
        lidar, start, motion=YOUBOT, loops=False
    ),
    "scan graph": lambda lidar, start, rng: ScanGraphSlam(lidar, start, motion=YOUBOT),
    "grid FastSLAM": lambda lidar, start, rng: GridFastSlam(
        lidar, start, 30, rng=rng, motion=YOUBOT
    ),
    "EKF-SLAM, walls": lambda lidar, start, rng: WallSlam(YOUBOT, lidar, start),
}
#: How it may come back: by a route on its map; along its own path, believing as before; along its
#: own path by the wheels alone (P3).
RETURN_METHODS = ("map", "path", "path by wheels")


@dataclass(frozen=True, eq=False)
class Outward:
    """A robot at the end of its way out.

    Attributes
    ----------
    building : Building
    seed : int
    robot : MiscalibratedOdometry
        How it really moves.
    pilot : CoveragePilot
    belief : Estimator
    log : Log
    coverage : float
        Part of the floor that its scans showed.
    """

    building: Building
    seed: int
    robot: MiscalibratedOdometry
    pilot: CoveragePilot
    belief: Estimator
    log: Log
    coverage: float


@dataclass(frozen=True, eq=False)
class Return:
    """How a way home ended.

    Attributes
    ----------
    log : Log
        Of the way home alone.
    error : float
        Distance of the robot from the mark (m).
    believed : float
        The same as it believes (m).
    nees : float
        Squared error of its own position in units of its covariance; 2 is expected.
    touched : bool
        On the way out or home.
    seconds, metres : float
        Of both ways together.
    home : bool
        Within 15 cm of the mark, nothing touched, 95 % of the floor seen.
    """

    log: Log
    error: float
    believed: float
    nees: float
    touched: bool
    seconds: float
    metres: float
    home: bool

    @property
    def inside(self) -> bool:
        """Whether the robot stands in the 95 % ellipse that it claims."""
        return self.nees < _GATE


def explore(building: Building, maker: Maker, seed: int) -> Outward:
    """Send a robot into a building until it has seen it, or its time is up.

    Parameters
    ----------
    building : Building
    maker : callable
        One of `ESTIMATORS`, or your own: ``maker(lidar, start, rng)`` gives an estimator whose
        controls are those of a youBot.
    seed : int
        Of the wheels and of all noise.

    Returns
    -------
    Outward
    """
    rng = np.random.default_rng([as_count("seed", seed), 20])
    scale, drift = building.scale, building.drift
    robot = MiscalibratedOdometry(1 + rng.uniform(-scale, scale), rng.uniform(-drift, drift))
    world, start = building.built, np.array(building.start)
    belief = maker(building.lidar, start, np.random.default_rng([seed, 21]))
    past = belief if isinstance(belief, Smoother) else None
    pilot = CoveragePilot(
        YOUBOT_BODY,
        building.lidar,
        view_range=building.view_range,
        max_speed=_SPEED,
        max_turn=_TURN,
        margin=building.margin,
        home=False,
        revisit_after=_AGAIN,
        smoother=past,
    )
    log = _drive(building, robot, pilot, belief, rng, start)
    return Outward(building, seed, robot, pilot, belief, log, coverage(log, world, 0.1)[-1])


def come_home(out: Outward, way: str) -> Return:
    """Bring a robot back to its mark; the same way out may be asked again for another way.

    Parameters
    ----------
    out : Outward
    way : {"map", "path", "path by wheels"}

    Returns
    -------
    Return
    """
    way = as_choice("way", way, RETURN_METHODS)
    pilot: CoveragePilot | ReturnPilot
    pilot, belief = copy.deepcopy((out.pilot, out.belief))
    past = belief if isinstance(belief, Smoother) else None
    if way == "map":
        pilot.turn_home()
    else:
        trail = out.log.notes["believed"] if past is None else past.trajectory
        if way == "path by wheels":
            belief, past = DeadReckoning(YOUBOT, belief.pose, belief.pose_cov), None
        pilot = ReturnPilot(
            trail,
            CollisionGuard(YOUBOT_BODY, out.building.margin),
            out.building.lidar,
            smoother=past,
            max_speed=_SPEED,
        )
    rng = np.random.default_rng([out.seed, 22 + RETURN_METHODS.index(way)])
    truth = out.log.truth
    assert truth is not None
    log = _drive(out.building, out.robot, pilot, belief, rng, truth[-1])
    return _judged(out, log, belief)


def _drive(
    building: Building,
    robot: MiscalibratedOdometry,
    pilot: CoveragePilot | ReturnPilot,
    belief: Estimator,
    rng: np.random.Generator,
    start: Array,
) -> Log:
    return record(
        building.built,
        robot,
        building.lidar,
        pilot,
        belief,
        rng,
        start=start,
        dt=_DT,
        control_cov=YOUBOT.control_cov(building.sigma_wheel),
        footprint=YOUBOT_BODY.footprint,
        max_time=building.budget,
    )


def _judged(out: Outward, log: Log, belief: Estimator) -> Return:
    """Compare where the robot stands with the mark and with what it claims."""
    assert log.truth is not None
    end, mark = log.truth[-1, :2], np.array(out.building.start[:2])
    error = float(np.hypot(*(end - mark)))
    own = belief.pose[:2] - end
    cov = belief.pose_cov[:2, :2] + 1e-12 * np.eye(2)
    touched = bool(out.log.notes["hit"].any() or log.notes["hit"].any())
    return Return(
        log,
        error,
        float(np.hypot(*(belief.pose[:2] - mark))),
        float(mahalanobis_squared(own, cov)),
        touched,
        float(out.log.times[-1] + log.times[-1]),
        float(path_length(out.log)[-1] + path_length(log)[-1]),
        error <= HOME_RADIUS and not touched and out.coverage >= COVERAGE_TARGET,
    )


def results() -> dict[str, dict[str, dict[str, Array]]]:
    """Return the stored runs of `tools/expeditions.py`.

    Returns
    -------
    dict
        ``results()[building][belief]`` maps "coverage" to (n,) and "error", "believed" (m),
        "nees", "touched", "seconds" and "metres" to (n, 3): one row a seed from 0 on, one column
        for each of `RETURN_METHODS`; see `Return`. A belief that was not tried in a building is
        missing.
    """
    stored = json.loads(STORED.read_text())
    return {
        building: {
            belief: {name: np.array([row[name] for row in rows], float) for name in rows[0]}
            for belief, rows in beliefs.items()
            if rows
        }
        for building, beliefs in stored.items()
    }
