"""Drive round an unknown room without touching anything, the route chosen by the robot.

The task that P1 sets its robot ("drive round the room, avoid collisions, build the map; time and
route are chosen by the robot"). Goals are places not yet seen from near (Yamauchi 1997), ways run
over seen floor, and a guard looks at the newest scan before every command. Chapters 09 and 20.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slamlab._checks import Array, as_instance, as_positive, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.logs import ScanGeometry
from slamlab.models import Smoother, View, as_scan_sensor
from slamlab.navigation.exploration_grid import ExplorationGrid
from slamlab.navigation.guard import Body, CollisionGuard
from slamlab.navigation.strategies import NearestFrontier, Situation
from slamlab.sensors.lidar import Lidar

__all__ = ["CoveragePilot"]

# A path point counts as reached from this near (m), the start at the end of the way home too.
_REACHED, _HOME = 0.06, 0.03
# After standing still for so many commands the robot escapes for so many, then plans anew.
_PATIENCE, _ESCAPE = 5, 5
# It plans the way home so often without coming nearer before it gives up.
_PLANS = 10
# A robot that was so far from the start (m) and is within half of it again has come back.
_LEFT = 10.0
# A belief that moves a place by so much (m) has a new map to be drawn.
MOVED = 0.05


@dataclass
class Plan:
    """What the robot is about.

    Attributes
    ----------
    mode : str
        "explore", "revisit", "return", "done" or "stuck".
    path : ndarray, shape (k, 2)
        Points still to be driven through (m).
    goals : list of int
        On the way home: from where these scans of the floor were taken, one after the other.
    attempts : int
        Paths planned to the next goal since the robot last came nearer to it.
    nearest : float
        Least distance from the next goal when a path was planned (m).
    """

    mode: str = "explore"
    path: Array = field(default_factory=lambda: np.empty((0, 2)))
    goals: list[int] = field(default_factory=list)
    attempts: int = 0
    nearest: float = np.inf


class _FloorMap:
    """The floor as scans show it, drawn anew when the belief moves their places.

    `scans` holds step, pose from which it was drawn and ranges of each scan on the grid.
    """

    grid: ExplorationGrid

    def __init__(self, lidar: Lidar, view_range: float, smoother: Smoother | None) -> None:
        # What lies beyond the view is left for later, although the lidar may see it.
        reach = min(view_range, lidar.max_range)
        self._near = ScanGeometry(lidar.beam_angles, reach, lidar.offset)
        self.view_range, self._smoother = view_range, smoother
        self.start: Array | None = None
        self.scans: list[tuple[int, Array, Array]] = []
        self._last: Array | None = None

    def begin(self, start: Array) -> None:
        """Lay an unknown floor round the start (2,)."""
        self.start = start.copy()
        room = np.full(2, self.view_range + 0.5)
        self.grid = ExplorationGrid([*(start - room), *(start + room)], grow=True)

    def insert(self, pose: Array, ranges: Array, always: bool = False) -> None:
        """Add a scan, after every 0.3 m or 0.5 rad."""
        if self._last is not None and not always:
            moved = pose - self._last
            if np.hypot(*moved[:2]) < 0.3 and abs(wrap_angle(moved[2])) < 0.5:
                return
        self._last = pose.copy()
        step = 0 if self._smoother is None else len(self._smoother.trajectory) - 1
        self.scans.append((step, pose.copy(), ranges))
        self.grid.insert(pose, ranges, self._near)

    def revise(self) -> bool:
        """Draw the floor anew if the belief moved the place of a scan; tell whether it did."""
        if self._smoother is None or not self.scans:
            return False
        steps, poses, scans = zip(*self.scans, strict=True)
        now = self._smoother.trajectory[list(steps)]
        if np.hypot(*(now - poses)[:, :2].T).max() < MOVED:
            return False
        self.scans = list(zip(steps, now, scans, strict=True))
        assert self.start is not None
        self.begin(self.start)
        for pose, ranges in zip(now, scans, strict=True):
            self.grid.insert(pose, ranges, self._near)
        return True

    def place(self, scan: int) -> Array:
        """Where a scan was taken (2,)."""
        return self.scans[scan][1][:2]

    def scan_after(self, metres: float) -> int:
        """Find the first scan taken after so much of the way."""
        places = np.array([pose[:2] for _, pose, _ in self.scans]).reshape(-1, 2)
        driven = np.cumsum(np.hypot(*np.diff(places, axis=0).T))
        return min(int(np.searchsorted(driven, metres)), len(driven))


class CoveragePilot:
    """Drives until every place that can be reached was seen from near, then home.

    A pilot for `simulation.record`; its controls are body velocities (v_x, v_y, omega). Home is
    where it stood at its first command.

    Parameters
    ----------
    body : Body
    lidar : Lidar
    view_range : float, default 2.0
        Floor nearer to the lidar than this counts as seen (m), at least 0.5. Smaller makes a
        longer drive.
    max_speed, max_turn : float
        Limits of the command (m/s, rad/s), positive.
    margin : float, default 0.06
        The guard refuses what would bring the body nearer than this to a point of the scan (m).
    home : bool, default True
        Return to the start in the end.
    revisit_after : float, default 0.0
        When it comes near its start again, on the way out or home, it drives so much of its first
        way (m) once more: a belief that recognises places gets the chance to do so. On the way
        out this ends when the belief has moved the floor.
    smoother : Smoother, optional
        The belief itself, if it revises its past: the floor is then drawn anew, from where the
        scans were taken as it says now, whenever one of those places has moved by 5 cm.

    Attributes
    ----------
    floor : ExplorationGrid
        What the robot knows of the floor, where it believes it to be, from its first scan on.
    mode : str
        "explore", "revisit", "return", "escape", "done", or "stuck" where no way leads home.
    stops : int
        How often the guard let it stand still.
    finished : bool
        Whether nothing was left to see, and the robot came home if it was to.

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
        view_range = as_scalar("view_range", view_range, 0.5, 1e3)
        limits = as_positive("max_speed", max_speed, 1e3), as_scalar("max_turn", max_turn, 0, 1e3)
        margin = as_scalar("margin", margin, 0, 1e3)
        self._lidar, self._limits = lidar, limits
        self._guard = CollisionGuard(body, margin)
        # From a path on which the body may turn everywhere to one along which it has to lie.
        narrow = 0.5 * body.width + margin + 0.03
        self._radii = np.linspace(max(body.circumradius + 0.02, narrow), narrow, 4)
        self._revisit_after = as_scalar("revisit_after", revisit_after, 0, 1e6)
        self._map = _FloorMap(lidar, view_range, smoother)
        self._plan = Plan(goals=[0] if home else [])
        # Whether it was far from the start; commands without motion; commands of escape left.
        self._left, self._still, self._escape = False, 0, 0
        self.stops = 0

    def __repr__(self) -> str:
        """Return body and range of view."""
        return f"CoveragePilot({self._body}, view_range={self._map.view_range:g})"

    @property
    def floor(self) -> ExplorationGrid:
        """What the robot knows of the floor, from its first scan on."""
        return self._map.grid

    @property
    def mode(self) -> str:
        """What the robot does now."""
        return "escape" if self._escape else self._plan.mode

    @property
    def finished(self) -> bool:
        """Whether nothing was left to see, and the robot came home if it was to."""
        return self._plan.mode == "done"

    def command(self, view: View) -> Array | None:
        """Return the next body velocity (3,), None when the drive is over."""
        pose, ranges = as_instance("view", view, View).pose, view.measurement
        if self._map.start is None:
            self._map.begin(pose[:2])
        if self._map.revise():
            self._plan.path = np.empty((0, 2))
        self._map.insert(pose, ranges)
        points = self._lidar.points(ranges)
        points = points[np.isfinite(points).all(-1)]
        if self._escape and len(points):
            return self._escape_from(points, view.dt)
        self._drop_reached(pose)
        if self._back_at_start(pose):
            self._begin_revisit(pose)
        modes = {"explore": self._explore, "revisit": self._revisit, "return": self._return}
        while len(self._plan.path) == 0:
            if self._plan.mode not in modes:
                return None
            modes[self._plan.mode](pose, ranges)
        return self._drive(pose, points, view.dt)

    def turn_home(self) -> None:
        """Explore no further: from the next command on it drives home."""
        first = self._map.scan_after(self._revisit_after)
        self._plan = Plan("return", goals=[0, first, 0] if self._revisit_after > 0 else [0])

    # One method a mode; each leaves a path to drive, or another mode.

    def _explore(self, pose: Array, ranges: Array) -> None:
        """Plan to the nearest frontier, on a path as wide as there is; without one, "return"."""
        self._map.insert(pose, ranges, always=True)
        seen = (pose, ranges, self._lidar, self.floor, self._body.length)
        strategy, rng = NearestFrontier(), np.random.default_rng(0)
        for radius in self._radii:
            path = strategy.choose(Situation(*seen, radius), rng)
            if path is not None:
                self._plan.path = path
                self._drop_reached(pose)
                return
        self._plan.mode = "return"

    def _begin_revisit(self, pose: Array) -> None:
        """Plan to where the first way is taken once more, if a path leads there."""
        first = self._map.place(self._map.scan_after(self._revisit_after))
        path = self.floor.plan(pose[:2], first, self._radii[-1])
        if path is not None:
            self._plan.mode, self._plan.path = "revisit", path

    def _revisit(self, pose: Array, ranges: Array) -> None:
        """Explore on from the end of the first way."""
        self._plan.mode = "explore"

    def _return(self, pose: Array, ranges: Array) -> None:
        """Plan to the next goal; "done" without one, "stuck" if the robot comes no nearer."""
        plan = self._plan
        while plan.goals:
            goal = self._map.place(plan.goals[0])
            away = float(np.hypot(*(goal - pose[:2])))
            if away >= _HOME:
                break
            plan.goals, plan.attempts, plan.nearest = plan.goals[1:], 0, np.inf
        else:
            plan.mode = "done"
            return
        if away < plan.nearest - 0.1:
            plan.nearest, plan.attempts = away, 0
        plan.attempts += 1
        if plan.attempts > _PLANS:
            plan.mode = "stuck"
            return
        self._map.insert(pose, ranges, always=True)
        for radius in self._radii:
            path = self.floor.plan(pose[:2], goal, radius)
            if path is not None:
                plan.path = np.vstack([path[:-1], goal])
                return
        plan.mode = "stuck"

    def _escape_from(self, points: Array, dt: float) -> Array:
        """Go away from the nearest point of the scan."""
        self._escape -= 1
        return self._guard.safe_velocity(self._guard.escape_velocity(points), points, dt)

    # What the modes share.

    def _drop_reached(self, pose: Array) -> None:
        plan = self._plan
        while len(plan.path):
            last = plan.mode == "return" and len(plan.path) == 1
            if np.hypot(*(plan.path[0] - pose[:2])) >= (_HOME if last else _REACHED):
                return
            plan.path = plan.path[1:]

    def _back_at_start(self, pose: Array) -> bool:
        """Whether it has just come near the start, having been far from it."""
        assert self._map.start is not None
        away = float(np.hypot(*(pose[:2] - self._map.start)))
        self._left = self._left or away > _LEFT
        out = self._plan.mode in ("explore", "revisit") and self._revisit_after > 0
        if not out or not self._left or away > 0.5 * _LEFT:
            return False
        self._left = False
        return True

    def _drive(self, pose: Array, points: Array, dt: float) -> Array:
        """Go towards the next point of the path, as far as the guard allows."""
        u = self._guard.safe_velocity(self._towards(pose, self._plan.path[0], dt), points, dt)
        self._still = 0 if np.abs(u).max() > 1e-3 else self._still + 1
        self.stops += self._still == 1
        if self._still >= _PATIENCE:
            self._plan.path, self._still, self._escape = np.empty((0, 2)), 0, _ESCAPE
            self.floor.blacklist_frontier(pose[:2], self._map.view_range)
        return u

    def _towards(self, pose: Array, point: Array, dt: float) -> Array:
        """Velocity to a point, slower near it, the nose turning to where it goes."""
        max_speed, max_turn = self._limits
        away = point - pose[:2]
        distance = float(np.hypot(*away))
        bearing = float(wrap_angle(np.arctan2(away[1], away[0]) - pose[2]))
        turn = float(np.clip(bearing / dt, -max_turn, max_turn))
        if distance < 0.3:
            turn *= distance / 0.3
        speed = min(max_speed, distance / dt, 0.05 + distance / 0.6)
        # The body turns during the step: aim for the middle of it.
        ahead = bearing - 0.5 * turn * dt
        return np.array([speed * np.cos(ahead), speed * np.sin(ahead), turn])
