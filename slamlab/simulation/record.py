"""The one closed loop: the pilot sees the belief, the world moves the robot, all is written down.

Truth is on one side: where the robot is, what it meets, what its sensors really measure. The
belief is on the other, and the pilot sees nothing else. Chapters 09, 17, 18 and 20.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_instance, as_rng, as_scalar
from slamlab.gaussian import cached_sqrt
from slamlab.geometry import wrap_angle
from slamlab.logs import Log
from slamlab.models import (
    Estimator,
    MotionModel,
    Pilot,
    View,
    World,
    as_estimator,
    as_motion,
    controls_of,
)
from slamlab.sensors import Lidar, RangeBearing
from slamlab.worlds import LandmarkWorld

__all__ = ["Odometer", "Script", "PerfectEstimator", "record"]

_DIGITS = 9  # poses and ranges in whole nanometres: no run hangs on the last bit of a machine
_PIECE = 0.01  # no part of the body moves farther (m) in one piece of an arc
_SLACK = 1e-6  # what lies farther beyond reach than this (m) is not met, whatever the rounding


class Odometer(Protocol):
    """What measures the motion itself; `sensors.VisualOdometer` is one."""

    def measure(self, before: ArrayLike, after: ArrayLike, rng: np.random.Generator) -> Array:
        """Measure the motions (..., 3) between true poses."""

    def cov(self, increment: ArrayLike) -> Array:
        """Covariance (..., 3, 3) of measured motions."""


class PerfectEstimator:
    """The estimator that is given where it is: for lessons about driving, not about knowing.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> rng = np.random.default_rng(0)
    >>> pilot = Script([[1.0, 0.0]])
    >>> log = record(None, Unicycle(), None, pilot, PerfectEstimator(), rng, start=[5, 0, 0], dt=1)
    >>> log.notes["believed"].tolist() == log.truth.tolist()
    True
    """

    measures = "truth"

    def __init__(self) -> None:
        self._pose = np.zeros(3)

    def __repr__(self) -> str:
        """Return the pose."""
        return f"PerfectEstimator({np.round(self._pose, 3).tolist()})"

    @property
    def pose(self) -> Array:
        """True pose (..., 3), a copy."""
        return self._pose.copy()

    @property
    def pose_cov(self) -> Array:
        """Zeros (..., 3, 3)."""
        return np.zeros((*self._pose.shape, 3))

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Wait for the truth."""

    def update(self, measurement: ArrayLike, ids: Any = None) -> None:
        """Take in the true pose (..., 3)."""
        self._pose = as_array("measurement", measurement, ("...", 3)).copy()


class Script:
    """The pilot that reads its controls (T, p) from a list and looks at nothing.

    Examples
    --------
    >>> Script([[1.0, 0.0], [0.0, 0.5]])
    Script(2 controls to go)
    """

    def __init__(self, controls: ArrayLike) -> None:
        self._controls = as_array("controls", controls, ("T", "p")).copy()
        self._next = 0

    def __repr__(self) -> str:
        """Return how many controls are left."""
        return f"Script({len(self._controls) - self._next} controls to go)"

    def command(self, view: View) -> Array | None:
        """Return the next control (p,), None after the last."""
        if self._next == len(self._controls):
            return None
        self._next += 1
        return self._controls[self._next - 1]


def record(
    world: World | LandmarkWorld | None,
    robot: MotionModel,
    sensor: Lidar | RangeBearing | None,
    pilot: Pilot,
    belief: Estimator,
    rng: np.random.Generator,
    *,
    start: ArrayLike,
    dt: float = 0.1,
    control_cov: ArrayLike | None = None,
    odometer: Odometer | None = None,
    footprint: ArrayLike | None = None,
    max_time: float = 300.0,
) -> Log:
    """Let a pilot drive a robot through a world, and write a log.

    In every step the pilot sees the belief and the newest measurement and gives a command; the
    robot executes it with noise, unless it stands; a body that meets an obstacle stops at the
    contact, and its wheels with it; then the sensors measure and the belief is brought up to date.

    Parameters
    ----------
    world : World, LandmarkWorld or None
        Where it happens; None is an open floor with nothing on it.
    robot : MotionModel
        How the robot really moves.
    sensor : Lidar, RangeBearing or None
        Measures after every step; None measures nothing.
    pilot : Pilot
        Gives the controls that `robot` takes.
    belief : Estimator
        Where the robot believes to be: SLAM, localization, dead reckoning, or
        `PerfectEstimator`. It begins where its maker put it, right or wrong.
    rng : numpy.random.Generator
        For the noise of motion and sensors.
    start : array_like, shape (3,) or (M, 3)
        True pose (m, m, rad); a batch is M runs side by side, with noise of their own, for
        pilots and beliefs that take one, and without a lidar.
    dt : float, default 0.1
        Length of a step (s).
    control_cov : array_like, shape (p, p), optional
        Covariance of the control executed around the command; exact wheels without it.
    odometer : Odometer, optional
        Measures the motion. Then ``log.u`` are measured motions (dx, dy, dtheta), for a belief
        with `robots.RelativePose` as its motion model; without it they are the commands.
    footprint : array_like, shape (k, 2), optional
        Corners of the body (m): what collides. A point passes through everything.
    max_time : float, default 300.0
        The drive ends after so many seconds.

    Returns
    -------
    Log
        With the truth. The first step has dt = 0: the measurement at the start. Its notes are
        ``"believed"`` (T, ..., 3), where the robot took itself to be after the step; ``"command"``
        and ``"driven"`` (T, ..., p), what the pilot wanted and what came of it; ``"hit"``
        (T, ...), whether the body met an obstacle.

    Raises
    ------
    ValueError
        If the body collides at the start.

    Examples
    --------
    >>> from slamlab.localization import DeadReckoning
    >>> from slamlab.robots import Unicycle
    >>> pilot, belief = Script([[1.0, 0.0]] * 3), DeadReckoning(Unicycle(), [0, 0, 0])
    >>> rng = np.random.default_rng(0)
    >>> log = record(None, Unicycle(), None, pilot, belief, rng, start=[5, 0, 0], dt=0.5)
    >>> log.truth[:, 0].tolist(), log.notes["believed"][:, 0].tolist()
    ([5.0, 5.5, 6.0, 6.5], [0.0, 0.5, 1.0, 1.5])
    """
    rng, robot = as_rng("rng", rng), as_motion("robot", robot)
    scene = _Scene(world, robot, sensor, rng, footprint, control_cov)
    as_estimator("belief", belief)
    as_instance("pilot", pilot, Pilot)
    if odometer is not None:
        as_instance("odometer", odometer, Odometer)
    dt = as_scalar("dt", dt, 1e-6, 1e6)
    steps = int(np.ceil(as_scalar("max_time", max_time, 0, 1e9) / dt - 1e-9))
    truth = scene.placed(as_array("start", start, ("...", 3)))
    hit = np.zeros(truth.shape[:-1], bool)
    rows: list[dict[str, Any]] = []
    measured = scene.measure(truth)
    _inform(belief, measured)
    first = {**measured, "believed": belief.pose, "hit": hit}
    for k in range(steps):
        newest = measured.get("scan", measured.get("landmarks"))
        view = View(k * dt, dt, belief.pose, belief.pose_cov, newest, hit)
        u = pilot.command(view)
        if u is None:
            break
        u = as_array("pilot's command", u, (*hit.shape, "p"))
        before = truth
        truth, driven, control, cov, hit = scene.move(before, u, dt)
        if odometer is not None:
            control, cov = _odometry(odometer, before, truth, scene.rng)
        belief.predict(control, dt, cov)
        measured = scene.measure(truth)
        _inform(belief, measured)
        said = {"believed": belief.pose, "hit": hit, "command": u, "driven": driven}
        rows.append({**measured, **said, "u": control, "cov": cov})
    controls = "displacement" if odometer is not None else controls_of(robot)
    return _log(first, rows, dt, scene, controls)


class _Scene:
    """The true side: a world, a body and its sensors."""

    def __init__(
        self,
        world: World | LandmarkWorld | None,
        robot: MotionModel,
        sensor: Lidar | RangeBearing | None,
        rng: np.random.Generator,
        footprint: ArrayLike | None,
        control_cov: ArrayLike | None,
    ) -> None:
        self.robot, self.sensor, self.rng = robot, sensor, rng
        self.control_cov = control_cov
        self.landmarks = world.points if isinstance(world, LandmarkWorld) else None
        self.obstacles = None if isinstance(world, LandmarkWorld) else world
        if isinstance(sensor, Lidar) and self.obstacles is None:
            raise ValueError(f"world: expected one with obstacles for a lidar, got {world}")
        if sensor is not None and not isinstance(sensor, Lidar) and self.landmarks is None:
            raise ValueError(f"world: expected a LandmarkWorld for {sensor}, got {world}")
        self.body = None if footprint is None else as_array("footprint", footprint, ("k", 2))
        self.radius = 0.0 if self.body is None else float(np.hypot(*self.body.T).max())

    def placed(self, start: Array) -> Array:
        """Return the start, if the body is free there."""
        body, obstacles = self.body, self.obstacles
        if body is not None and obstacles is not None and obstacles.collides(body, start).any():
            wanted = "a pose at which the robot touches no obstacle"
            raise ValueError(f"start: expected {wanted}, got {start}")
        if start.ndim > 1 and isinstance(self.sensor, Lidar):
            raise ValueError(f"start: expected one robot (3,) with a lidar, got {start.shape}")
        return np.round(start, _DIGITS)

    def move(
        self, pose: Array, u: Array, dt: float
    ) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
        """Execute a command with noise, as far as the world lets the body go.

        Returns where the robot came, what its wheels did, what they report and with which
        covariance, and whether it met something.
        """
        p = u.shape[-1]
        V = np.zeros((p, p)) if self.control_cov is None else self.control_cov
        V = as_array("control_cov", V, (p, p))
        moving = u.any(-1, keepdims=True)
        executed = u + moving * (
            self.rng.standard_normal(u.shape) @ cached_sqrt("control_cov", V, p).T
        )
        there, hit = self._driven(pose, executed, dt)
        free = np.ones(hit.shape)
        if hit.any():
            low, high = np.zeros_like(free), free
            for _ in range(12):
                middle = 0.5 * (low + high)
                _, stopped = self._driven(pose, executed * middle[..., None], dt)
                low, high = np.where(stopped, low, middle), np.where(stopped, middle, high)
            free = np.where(hit, low, 1.0)
            there = self.robot.step(pose, executed * free[..., None], dt)
        part = free[..., None]
        return np.round(there, _DIGITS), executed * part, u * part, V, hit

    def _driven(self, pose: Array, u: Array, dt: float) -> tuple[Array, NDArray[np.bool_]]:
        """Where a control leads (..., 3), and whether the body meets something on the way (...).

        A drive straight on or a turn on the spot is swept exactly. An arc is cut into pieces of a
        centimetre at most, each swept as a turn and then a drive: off by its bulge, far below a
        millimetre.
        """
        end = self.robot.step(pose, u, dt)
        hit = np.zeros(pose.shape[:-1], bool)
        if self.body is None or self.obstacles is None:
            return end, hit
        cuts = self._cuts(pose, u, end, dt)
        near = ~self._all_free(cuts)
        if near.any():
            cuts = cuts[:, near]
            turned = np.concatenate([cuts[:-1, ..., :2], cuts[1:, ..., 2:]], -1)
            starts, ends = np.concatenate([cuts[:-1], turned]), np.concatenate([turned, cuts[1:]])
            hit[near] = self.obstacles.sweep_collides(self.body, starts, ends).any(0)
        return end, hit

    def _cuts(self, pose: Array, u: Array, end: Array, dt: float) -> Array:
        """Poses (n + 1, ..., 3) between the pieces of a step, its start and end included."""
        moved = end - pose
        far, turn = np.hypot(moved[..., 0], moved[..., 1]), np.abs(wrap_angle(moved[..., 2]))
        arc = np.where((far > 1e-9) & (turn > 1e-9), far + self.radius * turn, 0.0)
        n = 1 + int(arc.max(initial=0.0) / _PIECE)
        parts = (np.arange(1, n) / n).reshape(-1, *[1] * u.ndim)
        between = np.broadcast_to(pose, (n - 1, *pose.shape))
        inner = self.robot.step(between, parts * u, dt) if n > 1 else between
        return np.concatenate([pose[None], inner, end[None]])

    def _all_free(self, cuts: Array) -> NDArray[np.bool_]:
        """Whether all is free as far round the middle as any part of the body can come (...)."""
        assert self.obstacles is not None
        middle = 0.5 * (cuts[0, ..., :2] + cuts[-1, ..., :2])
        x, y = middle[..., 0], middle[..., 1]
        away = np.hypot(cuts[..., 0] - x, cuts[..., 1] - y).max(0)
        reach = away + (self.radius + _SLACK)
        # Clearance speaks of obstacles; where a bitmap ends there is none, and no way either.
        left, bottom, right, top = self.obstacles.bounds
        edge = np.minimum(np.minimum(x - left, right - x), np.minimum(y - bottom, top - y))
        room = np.minimum(edge, self.obstacles.clearance(middle))
        return np.asarray(room > reach)

    def measure(self, truth: Array) -> dict[str, Any]:
        """Return the true pose and what the sensor says there: ranges, or looks and ids."""
        if isinstance(self.sensor, Lidar) and self.obstacles is not None:
            ranges = self.sensor.scan(self.obstacles, truth, self.rng)
            return {"truth": truth, "scan": np.round(ranges, _DIGITS)}
        if isinstance(self.sensor, RangeBearing) and self.landmarks is not None:
            z, ids = self.sensor.measure(truth, self.landmarks, self.rng)
            return {"truth": truth, "landmarks": z, "ids": ids}
        return {"truth": truth}


def _inform(belief: Estimator, measured: dict[str, Any]) -> None:
    """Give a belief what it measures."""
    if belief.measures == "odometry":
        return
    if belief.measures not in measured:
        wanted = f"one that measures {' or '.join(measured)}, which is what the sensor gives"
        raise ValueError(f"belief: expected {wanted}, got one that measures {belief.measures}")
    if belief.measures == "landmarks":
        belief.update(measured["landmarks"], measured["ids"])
    else:
        belief.update(measured[belief.measures])


def _odometry(
    odometer: Odometer, before: Array, after: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Measured motions (..., 3), exact for who stands, and their mean covariance (3, 3)."""
    moving = (before != after).any(-1, keepdims=True)
    motion = np.where(moving, odometer.measure(before, after, rng), 0.0)
    cov = odometer.cov(motion) * moving[..., None]
    return motion, cov.reshape(-1, 3, 3).mean(0)


def _log(
    first: dict[str, Any], rows: list[dict[str, Any]], dt: float, scene: _Scene, controls: str
) -> Log:
    """Columns of rows; the first step moved nothing."""
    still = np.zeros((*first["hit"].shape, 1))
    blank = {"command": still, "driven": still, "u": still, "cov": np.zeros((1, 1))}
    some = rows[0] if rows else blank
    rows = [first | {name: np.zeros_like(some[name]) for name in blank}, *rows]
    column: dict[str, Any] = {name: [row[name] for row in rows] for name in rows[0]}
    steps: Array = np.arange(len(rows), dtype=float)
    return Log(
        dt * steps,
        np.array(column["u"]),
        np.where(steps > 0, dt, 0.0),
        np.array(column["cov"]),
        landmark_measurements=column.get("landmarks"),
        ids=column.get("ids"),
        ranges=column.get("scan"),
        scan=scene.sensor if isinstance(scene.sensor, Lidar) else None,
        truth=np.array(column["truth"]),
        landmarks=scene.landmarks,
        notes={name: np.array(column[name]) for name in ("believed", "command", "driven", "hit")},
        controls=controls,
    )
