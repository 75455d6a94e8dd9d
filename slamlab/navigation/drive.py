"""Drive round an unknown room without touching anything, the route chosen by the robot.

The task that P1 sets its robot ("drive round the room, avoid collisions, build the map; time and
route are chosen by the robot"). Goals are places not yet seen from near (Yamauchi 1997), ways run
over seen floor, and a guard looks at the newest scan before every command. Chapter 09.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_rng, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.logs import ScanGeometry
from slamlab.navigation.seen_floor import SeenFloor
from slamlab.navigation.strategies import NearestFrontier, View
from slamlab.robots.mecanum import YOUBOT, Mecanum
from slamlab.sensors.lidar import Lidar
from slamlab.worlds import World

__all__ = ["YOUBOT_BODY", "Belief", "Body", "Drive", "drive_round"]

# A way point counts as reached from this near (m).
_REACHED = 0.06
# The guard looks at the body in so many places along the next two steps.
_LOOKS_AHEAD = 6
# Standing still for so many commands, the robot chooses another goal.
_PATIENCE = 5


@dataclass(frozen=True)
class Body:
    """A rectangle around the body centre.

    Parameters
    ----------
    length, width : float
        Sizes along and across the body (m), positive.

    Raises
    ------
    ValueError
        If a size is not positive.
    """

    length: float
    width: float

    def __post_init__(self) -> None:
        """Check the sizes."""
        tiny = float(np.finfo(float).tiny)
        as_scalar("length", self.length, tiny, 1e300)
        as_scalar("width", self.width, tiny, 1e300)

    @property
    def footprint(self) -> Array:
        """Corners in the body frame (m), counterclockwise, shape (4, 2)."""
        corners = np.array([[1.0, 1], [-1, 1], [-1, -1], [1, -1]])
        return 0.5 * corners * [self.length, self.width]

    @property
    def circumradius(self) -> float:
        """Distance of the corners from the centre (m)."""
        return 0.5 * float(np.hypot(self.length, self.width))

    def grown(self, by: float) -> Body:
        """Return the body with `by` (m) added on every side."""
        return Body(self.length + 2 * by, self.width + 2 * by)

    def clearance(self, points: Array) -> Array:
        """Distance (m) of points (..., 2), in the body frame, from the body; negative inside."""
        beside = np.abs(points) - 0.5 * np.array([self.length, self.width])
        outside = np.maximum(beside, 0.0)
        return np.hypot(outside[..., 0], outside[..., 1]) + np.minimum(beside.max(-1), 0.0)


# The platform of the youBot: 0.58 m long, 0.38 m wide.
YOUBOT_BODY = Body(0.58, 0.38)


class Belief(Protocol):
    """What tells the robot where it is; `slamlab.slam.wall_slam.WallSlam` is one."""

    @property
    def pose(self) -> Array:
        """Estimated pose (m, m, rad), shape (3,)."""

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> Any:
        """Move with the body velocity u (3,) for dt seconds."""

    def observe(self, ranges: ArrayLike) -> Any:
        """Take in a scan (n_beams,)."""


@dataclass(frozen=True, eq=False)
class Drive:
    """Record of a drive of n steps.

    Attributes
    ----------
    motion : Mecanum
    body : Body
    lidar : Lidar
    dt : float
        Length of a step (s).
    poses : ndarray, shape (n + 1, 3)
        True poses (m, m, rad), the start first.
    believed : ndarray, shape (n + 1, 3)
        Where the robot took itself to be.
    controls : ndarray, shape (n, 3)
        Body velocities that were commanded and that the wheels report (m/s, m/s, rad/s).
    driven : ndarray, shape (n, 3)
        Body velocities that came of it.
    ranges : ndarray, shape (n + 1, n_beams)
        Scans (m) at the poses.
    control_cov : ndarray, shape (3, 3)
        Covariance of `driven` around `controls`.
    floor : SeenFloor
        What the robot knew of the floor in the end.
    stops : int
        How often the guard let it stand still.
    finished : bool
        Whether nothing was left to see, and the robot came home if it was to.
    """

    motion: Mecanum
    body: Body
    lidar: Lidar
    dt: float
    poses: Array
    believed: Array
    controls: Array
    driven: Array
    ranges: Array
    control_cov: Array
    floor: SeenFloor
    stops: int
    finished: bool

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.controls)

    @property
    def times(self) -> Array:
        """Times of the poses (s), shape (n + 1,)."""
        return np.asarray(self.dt * np.arange(len(self.poses)), dtype=np.float64)

    @property
    def wheel_speeds(self) -> Array:
        """What the wheels report (rad/s), shape (n, 4)."""
        return self.motion.wheel_speeds(self.controls)

    @property
    def path_length(self) -> float:
        """Length of the true path (m)."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())

    def touches(self, world: World, parts: int = 5) -> NDArray[np.bool_]:
        """Tell in which steps the body may have touched something, shape (n,).

        Every step is cut into parts; no point of the body moves farther than delta in one, so the
        body grown by delta / 2 at the cuts covers all that it swept. False is therefore a proof.

        Parameters
        ----------
        world : World
            The true one.
        parts : int, default 5

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        speed = np.hypot(self.driven[:, 0], self.driven[:, 1])
        speed += np.abs(self.driven[:, 2]) * self.body.circumradius
        delta = float(speed.max(initial=0.0)) * self.dt / parts
        cuts = np.stack(
            [self.motion.step(self.poses[:-1], self.driven, self.dt * k / parts)
             for k in range(parts + 1)], 1
        )  # fmt: skip
        return np.asarray(world.collides(self.body.grown(0.5 * delta).footprint, cuts).any(1))


def drive_round(
    world: World,
    start: ArrayLike,
    rng: np.random.Generator,
    *,
    belief: Belief | None = None,
    motion: Mecanum = YOUBOT,
    body: Body = YOUBOT_BODY,
    lidar: Lidar | None = None,
    sigma_wheel: float = 0.0,
    dt: float = 0.2,
    max_speed: float = 0.5,
    max_turn: float = 0.8,
    sight: float = 2.0,
    margin: float = 0.06,
    max_time: float = 300.0,
    home: bool = True,
) -> Drive:
    """Drive until every place that can be reached was seen from near; then home.

    Parameters
    ----------
    world : World
        Only the lidar looks at it.
    start : array_like, shape (3,)
        True pose at the beginning (m, m, rad); the belief begins where it says.
    rng : numpy.random.Generator
        For the noise of wheels and lidar.
    belief : Belief, optional
        Tells the robot where it is, from its odometry and its scans. Without one it is told its
        true pose.
    motion : Mecanum, default YOUBOT
    body : Body, default YOUBOT_BODY
    lidar : Lidar, optional
        By default 360 beams all round, 0.3 m ahead of the centre, to 8 m, with 1 cm of noise.
    sigma_wheel : float, default 0.0
        Standard deviation of every wheel's speed around the command (rad/s), while it moves.
    dt : float, default 0.2
        Length of a step (s): one command and one scan each.
    max_speed, max_turn : float
        Limits of the command (m/s, rad/s), positive.
    sight : float, default 2.0
        Floor nearer to the lidar than this counts as seen (m). Smaller makes a longer drive.
    margin : float, default 0.06
        The guard refuses what would bring the body nearer than this to a point of the scan (m).
    max_time : float, default 300.0
        The drive ends after so many seconds.
    home : bool, default True
        Return to the start in the end.

    Returns
    -------
    Drive

    Raises
    ------
    ValueError
        If an argument is out of range or the body collides at the start.
    """
    start, rng = as_array("start", start, (3,)), as_rng("rng", rng)
    tiny = float(np.finfo(float).tiny)
    dt, sight = as_scalar("dt", dt, 1e-3, 10.0), as_scalar("sight", sight, 0.5, 1e3)
    limits = as_scalar("max_speed", max_speed, tiny, 1e3), as_scalar("max_turn", max_turn, 0, 1e3)
    margin, max_time = as_scalar("margin", margin, 0, 1e3), as_scalar("max_time", max_time, 0, 1e6)
    if bool(world.collides(body.footprint, start)):
        raise ValueError(f"start: expected a free pose, the body collides at {start}")
    if lidar is None:
        lidar = Lidar(360, offset=0.3, max_range=8.0, sigma_range=0.01)
    robot = _Robot(world, start, rng, belief, motion, lidar, motion.control_cov(sigma_wheel), dt)
    pilot = _Pilot(body, lidar, robot.pose, sight, limits, margin, dt, home)
    for _ in range(int(max_time / dt)):
        u = pilot.command(robot.pose, robot.ranges[-1], rng)
        if u is None:
            break
        robot.move(u)
    return robot.record(body, pilot)


class _Robot:
    """The true robot: it moves with noise, looks, and keeps the record."""

    def __init__(
        self,
        world: World,
        start: Array,
        rng: np.random.Generator,
        belief: Belief | None,
        motion: Mecanum,
        lidar: Lidar,
        control_cov: Array,
        dt: float,
    ) -> None:
        self._world, self._rng, self._belief = world, rng, belief
        self._motion, self._lidar, self._dt = motion, lidar, dt
        self._control_cov = control_cov
        self._sigma = np.sqrt(np.diag(control_cov))
        self._poses, self._believed = [start], []  # type: tuple[list[Array], list[Array]]
        self._controls, self._driven = [], []  # type: tuple[list[Array], list[Array]]
        self.ranges: list[Array] = []
        self._look()

    @property
    def pose(self) -> Array:
        """Where the robot believes it is."""
        return self._believed[-1]

    def move(self, u: Array) -> None:
        """Obey a command for one step, then look."""
        # The wheels are alike, so that V of P1 (15) is diagonal. A robot that stands, stands.
        noise = self._sigma * self._rng.standard_normal(3)
        driven = u + noise * bool(np.any(u))
        self._poses.append(self._motion.step(self._poses[-1], driven, self._dt))
        self._controls.append(u)
        self._driven.append(driven)
        if self._belief is not None:
            self._belief.predict(u, self._dt, self._control_cov)
        self._look()

    def _look(self) -> None:
        noisy = self._lidar.sigma_range > 0 or self._lidar.p_miss > 0
        scan = self._lidar.scan(self._world, self._poses[-1], self._rng if noisy else None)
        self.ranges.append(scan)
        if self._belief is not None:
            self._belief.observe(scan)
        told = self._poses[-1] if self._belief is None else self._belief.pose
        self._believed.append(np.array(told, dtype=float))

    def record(self, body: Body, pilot: _Pilot) -> Drive:
        return Drive(
            motion=self._motion,
            body=body,
            lidar=self._lidar,
            dt=self._dt,
            poses=np.array(self._poses),
            believed=np.array(self._believed),
            controls=np.array(self._controls).reshape(-1, 3),
            driven=np.array(self._driven).reshape(-1, 3),
            ranges=np.array(self.ranges),
            control_cov=self._control_cov,
            floor=pilot.floor,
            stops=pilot.stops,
            finished=pilot.finished,
        )


class _Pilot:
    """The robot's head: it sees floor, chooses goals, plans ways and gives safe commands."""

    def __init__(
        self,
        body: Body,
        lidar: Lidar,
        pose: Array,
        sight: float,
        limits: tuple[float, float],
        margin: float,
        dt: float,
        home: bool,
    ) -> None:
        self._body, self._lidar, self._limits = body, lidar, limits
        self._margin, self._dt, self._sight = margin, dt, sight
        # What lies beyond the sight is left for later, although the lidar may see it.
        self._near = ScanGeometry(lidar.beam_angles, min(sight, lidar.max_range), lidar.offset)
        self._strategy = NearestFrontier()
        self._start, self._home, self._homeward = pose[:2].copy(), home, False
        self._way: Array = np.empty((0, 2))
        self._still = self._tries = 0
        self._last_look: Array | None = None
        room = sight + 0.5
        self.floor = SeenFloor([*(pose[:2] - room), *(pose[:2] + room)])
        self.stops, self.finished = 0, False

    def command(self, pose: Array, ranges: Array, rng: np.random.Generator) -> Array | None:
        """Return the next body velocity (3,), None when the drive is over."""
        self._see(pose, ranges)
        self._drop_reached(pose)
        if len(self._way) == 0 and not self._choose(pose, ranges, rng):
            return None
        wish = self._towards(pose, self._way[0])
        u = self._guarded(wish, self._points(ranges))
        self._still = 0 if np.abs(u).max() > 1e-3 else self._still + 1
        self.stops += self._still == 1
        if self._still >= _PATIENCE:
            self._give_up(pose)
        return u

    def _see(self, pose: Array, ranges: Array) -> None:
        """Add the scan to the floor, after every 0.3 m or 0.5 rad."""
        if self._last_look is not None:
            moved = pose - self._last_look
            if np.hypot(*moved[:2]) < 0.3 and abs(wrap_angle(moved[2])) < 0.5:
                return
        self._last_look = pose.copy()
        self.floor = _with_room(self.floor, pose[:2], self._sight + 0.4)
        self.floor.insert(pose, ranges, self._near)

    def _drop_reached(self, pose: Array) -> None:
        while len(self._way) and np.hypot(*(self._way[0] - pose[:2])) < _REACHED:
            self._way = self._way[1:]

    def _choose(self, pose: Array, ranges: Array, rng: np.random.Generator) -> bool:
        """Plan the next way; False when there is nothing left to do."""
        while not self._homeward:
            self._last_look = None
            self._see(pose, ranges)
            view = View(pose, ranges, self._lidar, self._body, self.floor)  # type: ignore[arg-type]
            way = self._strategy.choose(view, rng)
            if way is None:
                self._homeward = True
                break
            self._way = way
            self._drop_reached(pose)
            if len(self._way):
                return True
        return self._turn_home(pose)

    def _turn_home(self, pose: Array) -> bool:
        """Plan the way home, three times at most; False when there, or when none is wanted."""
        if not self._home or np.hypot(*(self._start - pose[:2])) < 2 * _REACHED:
            self.finished = True
            return False
        self._tries += 1
        if self._tries > 3:
            return False
        way = self.floor.route(pose[:2], self._start, self._body.circumradius + 0.02)
        if way is None:
            return False
        self._way = way
        return True

    def _give_up(self, pose: Array) -> None:
        """Forget a way that the guard does not let it go."""
        self._way, self._still = np.empty((0, 2)), 0
        self.floor.shut_near(pose[:2], self._sight)

    def _towards(self, pose: Array, point: Array) -> Array:
        """Velocity to a point, slower near it, the nose turning to where it goes."""
        max_speed, max_turn = self._limits
        away = point - pose[:2]
        distance = float(np.hypot(*away))
        bearing = float(wrap_angle(np.arctan2(away[1], away[0]) - pose[2]))
        turn = float(np.clip(bearing / self._dt, -max_turn, max_turn))
        if distance < 0.3:
            turn *= distance / 0.3
        speed = min(max_speed, distance / self._dt, 0.05 + distance / 0.6)
        # The body turns during the step: aim for the middle of it.
        ahead = bearing - 0.5 * turn * self._dt
        return np.array([speed * np.cos(ahead), speed * np.sin(ahead), turn])

    def _points(self, ranges: Array) -> Array:
        points = self._lidar.points(ranges)
        return points[np.isfinite(points).all(-1)]

    def _guarded(self, wish: Array, points: Array) -> Array:
        """Slow down, or stand still, so that the body stays clear of the points of the scan."""
        here = float(self._body.clearance(points).min(initial=np.inf))
        # Already nearer than the margin: it may leave, and must not come nearer.
        least = min(self._margin, here - 1e-9)
        for part in ([1, 1, 1], [1, 1, 0], [0, 0, 1]):
            for scale in (1.0, 0.5, 0.25, 0.1):
                u: Array = scale * wish * part
                if self._closest(u, points) >= least:
                    return u
        return np.zeros(3)

    def _closest(self, u: Array, points: Array) -> float:
        """Least distance from the points within the next two steps if u goes on."""
        t = np.linspace(0, 2 * self._dt, _LOOKS_AHEAD + 1)[1:, None]
        reach = float(np.hypot(u[0], u[1])) * t[-1, 0] + self._body.circumradius + self._margin
        near = points[(points**2).sum(-1) < reach**2]
        if len(near) == 0:
            return np.inf
        # Where the points will be, seen from the body after a time t (P1 (10), midpoint).
        half, turned = 0.5 * u[2] * t, u[2] * t
        dx = near[:, 0] - t * (u[0] * np.cos(half) - u[1] * np.sin(half))
        dy = near[:, 1] - t * (u[0] * np.sin(half) + u[1] * np.cos(half))
        c, s = np.cos(turned), np.sin(turned)
        return float(self._body.clearance(np.stack([c * dx + s * dy, c * dy - s * dx], -1)).min())


def _with_room(floor: SeenFloor, point: Array, room: float) -> SeenFloor:
    """Return the floor, on a larger sheet if the point comes nearer than `room` to its edge."""
    left, right, bottom, top = floor.extent
    low, high = np.array([left, bottom]), np.array([right, top])
    short_low, short_high = point - room < low, point + room > high
    if not (short_low.any() or short_high.any()):
        return floor
    # Whole cells, so that what was seen keeps its place.
    extra = np.ceil(room / floor.resolution) * floor.resolution
    low, high = low - extra * short_low, high + extra * short_high
    larger = SeenFloor([*low, *high], floor.resolution)
    row, column = np.rint((floor.origin - larger.origin)[::-1] / floor.resolution).astype(int)
    rows, columns = floor.state.shape
    larger.state[row : row + rows, column : column + columns] = floor.state
    larger.shut[row : row + rows, column : column + columns] = floor.shut
    return larger
