"""Drive round an unknown room without touching anything, the route chosen by the robot.

The task that P1 sets its robot ("drive round the room, avoid collisions, build the map; time and
route are chosen by the robot"). Goals are places not yet seen from near (Yamauchi 1997), ways run
over seen floor, and a guard looks at the newest scan before every command. Chapters 09 and 20.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamlab._checks import Array, as_array, as_instance, as_positive, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.logs import ScanGeometry
from slamlab.models import Smoother, View, as_scan_sensor
from slamlab.navigation.exploration_grid import ExplorationGrid
from slamlab.navigation.strategies import NearestFrontier, Situation
from slamlab.sensors.lidar import Lidar

__all__ = ["YOUBOT_BODY", "Body", "CollisionGuard", "CoveragePilot"]

# A way point counts as reached from this near (m), the start at the end of the way home too.
_REACHED, _HOME = 0.06, 0.03
# The guard looks at the body in so many places along the next two steps.
_LOOKS_AHEAD = 6
# Standing still for so many commands, the robot chooses another goal.
_PATIENCE = 5
# Before it does, it moves away from the nearest obstacle for so many commands, so fast (m/s).
_RETREAT, _BACK = 5, 0.1
# It plans the way home so often without coming nearer before it gives up.
_PLANS = 10
# Who was so far from the start (m) and is within half of it again has come back.
_LEFT = 10.0
# A belief that moves a place by so much (m) has a new map to be drawn.
MOVED = 0.05


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

    Examples
    --------
    >>> Body(0.6, 0.4)
    Body(length=0.6, width=0.4)
    """

    length: float
    width: float

    def __post_init__(self) -> None:
        """Check the sizes."""
        as_positive("length", self.length, 1e300)
        as_positive("width", self.width, 1e300)

    @property
    def footprint(self) -> Array:
        """Corners in the body frame (m), counterclockwise, shape (4, 2)."""
        corners = np.array([[1.0, 1], [-1, 1], [-1, -1], [1, -1]])
        return 0.5 * corners * [self.length, self.width]

    @property
    def circumradius(self) -> float:
        """Distance of the corners from the centre (m)."""
        return 0.5 * float(np.hypot(self.length, self.width))

    def clearance(self, points: Array) -> Array:
        """Distance (m) of points (..., 2), in the body frame, from the body; negative inside."""
        half = 0.5 * np.array([self.length, self.width])
        beside = np.abs(as_array("points", points, ("...", 2))) - half
        outside = np.maximum(beside, 0.0)
        deepest = np.maximum(beside[..., 0], beside[..., 1])
        return np.hypot(outside[..., 0], outside[..., 1]) + np.minimum(deepest, 0.0)


# The platform of the youBot: 0.58 m long, 0.38 m wide.
YOUBOT_BODY = Body(0.58, 0.38)


class CollisionGuard:
    """Slows a body down, or lets it stand still, so that it stays clear of what the scan shows.

    Parameters
    ----------
    body : Body
    margin : float, default 0.06
        It refuses what would bring the body nearer than this to a point of the scan (m). If the
        body is nearer than half of it, for no wheel obeys exactly, it goes away from that point,
        whatever the wish.

    Raises
    ------
    ValueError
        If the margin is negative.

    Examples
    --------
    Ten centimetres from a wall ahead it may not go on, but sidle along:

    >>> wall = np.stack([np.full(41, 0.39), np.linspace(-1, 1, 41)], -1)
    >>> guard = CollisionGuard(YOUBOT_BODY)
    >>> guard.safe_velocity(np.array([0.5, 0.0, 0.0]), wall, 0.2).tolist()
    [0.05, 0.0, 0.0]
    >>> guard.safe_velocity(np.array([0.0, 0.5, 0.0]), wall, 0.2).tolist()
    [0.0, 0.5, 0.0]
    """

    def __init__(self, body: Body, margin: float = 0.06) -> None:
        self._body, self._margin = body, as_scalar("margin", margin, 0, 1e3)

    def __repr__(self) -> str:
        """Return body and margin."""
        return f"CollisionGuard({self._body}, margin={self._margin:g})"

    def safe_velocity(self, desired: Array, points: Array, dt: float) -> Array:
        """Return the part of the body velocity `desired` (3,) that is safe among points (k, 2)."""
        here = float(self._body.clearance(points).min(initial=np.inf))
        # Noise would bring who drives along a wall nearer to it, step by step, until they touch.
        if here < 0.5 * self._margin:
            desired = self.escape_velocity(points)
        # Already nearer than the margin: it may leave, and must not come nearer.
        least = min(self._margin, here - 1e-9)
        # In the open nothing can come so near: most wishes need no closer look.
        if here - self._travel(desired, dt) > least + 1e-9:
            return 1.0 * desired
        for part in ([1, 1, 1], [1, 1, 0], [0, 0, 1]):
            for scale in (1.0, 0.5, 0.25, 0.1):
                u: Array = scale * desired * part
                if self._closest(u, points, dt) >= least:
                    return u
        return np.zeros(3)

    def escape_velocity(self, points: Array) -> Array:
        """Return a slow body velocity (3,) away from the nearest of points (k, 2), k > 0."""
        x, y = points[np.argmin(self._body.clearance(points))]
        return np.array([-x, -y, 0.0]) * (_BACK / max(float(np.hypot(x, y)), 1e-9))

    def _travel(self, u: Array, dt: float) -> float:
        """How far any part of the body moves at most within the next two steps (m)."""
        turn = abs(float(u[2])) * self._body.circumradius
        return 2 * dt * (float(np.hypot(u[0], u[1])) + turn)

    def _closest(self, u: Array, points: Array, dt: float) -> float:
        """Least distance from the points within the next two steps if u goes on."""
        t = np.linspace(0, 2 * dt, _LOOKS_AHEAD + 1)[1:, None]
        reach = float(np.hypot(u[0], u[1])) * t[-1, 0] + self._body.circumradius + self._margin
        near = points[points[:, 0] ** 2 + points[:, 1] ** 2 < reach**2]
        if len(near) == 0:
            return np.inf
        # Where the points will be, seen from the body after a time t (P1 (10), midpoint).
        half, turned = 0.5 * u[2] * t, u[2] * t
        dx = near[:, 0] - t * (u[0] * np.cos(half) - u[1] * np.sin(half))
        dy = near[:, 1] - t * (u[0] * np.sin(half) + u[1] * np.cos(half))
        c, s = np.cos(turned), np.sin(turned)
        return float(self._body.clearance(np.stack([c * dx + s * dy, c * dy - s * dx], -1)).min())


class CoveragePilot:
    """Drives until every place that can be reached was seen from near, then home.

    A pilot for `simulation.record`; its controls are body velocities (v_x, v_y, omega). Home is
    where it stood at its first command.

    Parameters
    ----------
    body : Body
    lidar : Lidar
    view_range : float, default 2.0
        Floor nearer to the lidar than this counts as seen (m). Smaller makes a longer drive.
    max_speed, max_turn : float
        Limits of the command (m/s, rad/s), positive.
    margin : float, default 0.06
        The guard refuses what would bring the body nearer than this to a point of the scan (m).
    home : bool, default True
        Return to the start in the end.
    revisit_after : float, default 0.0
        When it comes near its start again, on the way out or home, it drives so much of its first
        way (m) once more: a belief that recognises places gets the chance to do so.
    smoother : Smoother, optional
        The belief itself, if it revises its past: the floor is then drawn anew, from where the
        scans were taken as it says now, whenever one of those places has moved by 5 cm.

    Attributes
    ----------
    floor : ExplorationGrid
        What the robot knows of the floor, where it believes it to be, from its first scan on.
    stops : int
        How often the guard let it stand still.
    finished : bool
        Whether nothing was left to see, and the robot came home if it was to.

    Raises
    ------
    ValueError
        If an argument is out of range.

    Examples
    --------
    >>> from slamlab.robots import YOUBOT
    >>> from slamlab.simulation import PerfectEstimator, record
    >>> from slamlab.worlds import rooms
    >>> lidar, rng = Lidar(90, max_range=8.0), np.random.default_rng(1)
    >>> pilot = CoveragePilot(Body(0.6, 0.4), lidar)
    >>> log = record(rooms.corridor(), YOUBOT, lidar, pilot, PerfectEstimator(), rng,
    ...              start=[6.0, 1.0, 0.0], dt=0.5)
    >>> pilot.finished, bool(np.linalg.norm(log.truth[-1, :2] - [6.0, 1.0]) < 0.1)
    (True, True)
    """

    floor: ExplorationGrid

    def __init__(
        self,
        body: Body,
        lidar: Lidar,
        *,
        view_range: float = 2.0,
        max_speed: float = 0.5,
        max_turn: float = 0.8,
        margin: float = 0.06,
        home: bool = True,
        revisit_after: float = 0.0,
        smoother: Smoother | None = None,
    ) -> None:
        self._body: Body = as_instance("body", body, Body)
        as_scan_sensor("lidar", lidar)
        self._lidar, self._home = lidar, bool(home)
        self._sight = as_scalar("view_range", view_range, 0.5, 1e3)
        self._max_speed = as_positive("max_speed", max_speed, 1e3)
        self._max_turn = as_scalar("max_turn", max_turn, 0, 1e3)
        margin = as_scalar("margin", margin, 0, 1e3)
        self._guard = CollisionGuard(body, margin)
        # What lies beyond the sight is left for later, although the lidar may see it.
        reach = min(self._sight, lidar.max_range)
        self._near = ScanGeometry(lidar.beam_angles, reach, lidar.offset)
        # From a way on which the body may turn everywhere to one along which it has to lie.
        narrow = 0.5 * body.width + margin + 0.03
        self._radii = np.linspace(max(body.circumradius + 0.02, narrow), narrow, 4)
        self._strategy, self._rng = NearestFrontier(), np.random.default_rng(0)
        self._start: Array | None = None
        self._way: Array = np.empty((0, 2))
        self._homeward, self._plans, self._nearest = False, 0, np.inf
        self._goals = [0]  # on the way home: from where these scans of the floor were taken
        self._still = self._retreat = 0
        self._last_seen: Array | None = None
        self._again = as_scalar("revisit_after", revisit_after, 0, 1e6)
        self._left, self._past = False, smoother
        # Of the scans on the floor: step, pose from which it was drawn, ranges.
        self._drawn: list[tuple[int, Array, Array]] = []
        self.stops, self.finished = 0, False

    def __repr__(self) -> str:
        """Return body and sight."""
        return f"CoveragePilot({self._body}, view_range={self._sight:g})"

    def command(self, view: View) -> Array | None:
        """Return the next body velocity (3,), None when the drive is over."""
        pose, ranges = as_instance("view", view, View).pose, view.measurement
        if self._start is None:
            self._start = pose[:2].copy()
            self.floor = self._blank()
        self._revise()
        self._see(pose, ranges)
        points = self._lidar.points(ranges)
        points = points[np.isfinite(points).all(-1)]
        if self._retreat and len(points):
            self._retreat -= 1
            return self._guarded(self._guard.escape_velocity(points), points, view.dt)
        self._drop_reached(pose)
        if self._back_again(pose):
            first = self._drawn[self._scan_after(self._again)][1][:2]
            way = self.floor.plan(pose[:2], first, self._radii[-1])
            self._way = self._way if way is None else way
        if len(self._way) == 0 and not self._choose(pose, ranges):
            return None
        u = self._guarded(self._towards(pose, self._way[0], view.dt), points, view.dt)
        self._still = 0 if np.abs(u).max() > 1e-3 else self._still + 1
        self.stops += self._still == 1
        if self._still >= _PATIENCE:
            # The guard does not let it go this way: get clear of what is near, then plan anew.
            self._way, self._still, self._retreat = np.empty((0, 2)), 0, _RETREAT
            self.floor.blacklist_frontier(pose[:2], self._sight)
        return u

    def turn_home(self) -> None:
        """Explore no further: from the next command on it drives home."""
        self._home = self._homeward = True
        self._way, self.finished = np.empty((0, 2)), False
        self._goals = [0] + [self._scan_after(self._again), 0] * (self._again > 0)

    def _scan_after(self, metres: float) -> int:
        """Find the first scan on the floor taken after so much of the way."""
        places = np.array([pose[:2] for _, pose, _ in self._drawn]).reshape(-1, 2)
        driven = np.cumsum(np.hypot(*np.diff(places, axis=0).T))
        return min(int(np.searchsorted(driven, metres)), len(driven))

    def _back_again(self, pose: Array) -> bool:
        """Whether it has just come near the start, having been far from it."""
        assert self._start is not None
        away = float(np.hypot(*(pose[:2] - self._start)))
        self._left = self._left or away > _LEFT
        if self._again == 0 or self._homeward or not self._left or away > 0.5 * _LEFT:
            return False
        self._left = False
        return True

    def _blank(self) -> ExplorationGrid:
        """Return a floor round the start of which nothing is known."""
        assert self._start is not None
        room = np.full(2, self._sight + 0.5)
        return ExplorationGrid([*(self._start - room), *(self._start + room)], grow=True)

    def _revise(self) -> None:
        """Draw the floor anew if the belief has changed its mind about the past."""
        if self._past is None or not self._drawn:
            return
        rows, poses, scans = zip(*self._drawn, strict=True)
        now = self._past.trajectory[list(rows)]
        if np.hypot(*(now - poses)[:, :2].T).max() < MOVED:
            return
        self._drawn = list(zip(rows, now, scans, strict=True))
        self.floor, self._way = self._blank(), np.empty((0, 2))
        for pose, ranges in zip(now, scans, strict=True):
            self.floor.insert(pose, ranges, self._near)

    def _see(self, pose: Array, ranges: Array, always: bool = False) -> None:
        """Add the scan to the floor, after every 0.3 m or 0.5 rad."""
        if self._last_seen is not None and not always:
            moved = pose - self._last_seen
            if np.hypot(*moved[:2]) < 0.3 and abs(wrap_angle(moved[2])) < 0.5:
                return
        self._last_seen = pose.copy()
        row = 0 if self._past is None else len(self._past.trajectory) - 1
        self._drawn.append((row, pose.copy(), ranges))
        self.floor.insert(pose, ranges, self._near)

    def _drop_reached(self, pose: Array) -> None:
        while len(self._way):
            last_of_all = self._homeward and len(self._way) == 1
            if np.hypot(*(self._way[0] - pose[:2])) >= (_HOME if last_of_all else _REACHED):
                return
            self._way = self._way[1:]

    def _choose(self, pose: Array, ranges: Array) -> bool:
        """Plan the next way; False when there is nothing left to do."""
        while not self._homeward:
            self._see(pose, ranges, always=True)
            seen = (pose, ranges, self._lidar, self.floor, self._body.length)
            for radius in self._radii:
                way = self._strategy.choose(Situation(*seen, radius), self._rng)
                if way is not None:
                    break
            self._homeward = way is None
            self._way = self._way if way is None else way
            self._drop_reached(pose)
            if len(self._way):
                return True
        return self._turn_home(pose, ranges)

    def _turn_home(self, pose: Array, ranges: Array) -> bool:
        """Plan the way home; False when there, when none is wanted, or when there is none."""
        while self._home and self._goals:
            goal = self._drawn[self._goals[0]][1][:2]
            away = float(np.hypot(*(goal - pose[:2])))
            if away >= _HOME:
                break
            self._goals, self._plans, self._nearest = self._goals[1:], 0, np.inf
        else:
            self.finished = True
            return False
        if away < self._nearest - 0.1:
            self._nearest, self._plans = away, 0
        self._plans += 1
        if self._plans > _PLANS:
            return False
        self._see(pose, ranges, always=True)
        for radius in self._radii:
            way = self.floor.plan(pose[:2], goal, radius)
            if way is not None:
                self._way = np.vstack([way[:-1], goal])
                return True
        return False

    def _towards(self, pose: Array, point: Array, dt: float) -> Array:
        """Velocity to a point, slower near it, the nose turning to where it goes."""
        away = point - pose[:2]
        distance = float(np.hypot(*away))
        bearing = float(wrap_angle(np.arctan2(away[1], away[0]) - pose[2]))
        turn = float(np.clip(bearing / dt, -self._max_turn, self._max_turn))
        if distance < 0.3:
            turn *= distance / 0.3
        speed = min(self._max_speed, distance / dt, 0.05 + distance / 0.6)
        # The body turns during the step: aim for the middle of it.
        ahead = bearing - 0.5 * turn * dt
        return np.array([speed * np.cos(ahead), speed * np.sin(ahead), turn])

    def _guarded(self, wish: Array, points: Array, dt: float) -> Array:
        return self._guard.safe_velocity(wish, points, dt)
