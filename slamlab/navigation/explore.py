"""Exploration: a pilot that lets a strategy drive the square robot until it has seen the room.

The strategy chooses points, the pilot turns and drives there in strides, with a scan and a
collision test before each. It knows where it believes to be, not where it is. P5, 3.2.5;
chapter 18.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from slamlab._checks import Array, as_array, as_choice, as_count, as_instance, as_rng, as_scalar
from slamlab.geometry import inverse_transform, wrap_angle
from slamlab.grids import Grid
from slamlab.models import View
from slamlab.navigation.exploration_grid import ExplorationGrid
from slamlab.navigation.strategies import Situation, Strategy
from slamlab.robots import SquareRobot
from slamlab.sensors.lidar import Lidar

__all__ = ["Explorer"]

GUARDS = ("swept", "none")
CollisionGuard = Callable[[Array, float], bool]
_NEAR = 0.1  # a drive that must end this close to its point (m) has reached it
_THERE = 0.02  # a point this near (m) is not driven to
_ASTRAY = 0.05  # heading error (rad) after a stride at which the robot aims anew


class Explorer:
    """Drives where a strategy chooses; a pilot for `simulation.record`.

    Its controls are those of `SquareRobot`: in one step either forward speed or turn rate.

    Parameters
    ----------
    robot : SquareRobot
    lidar : Lidar
    strategy : Strategy
        Chooses the points to drive to; anything with `choose(situation, rng)`.
    rng : numpy.random.Generator
        For the strategy.
    guard : {"swept", "none"} or callable, default "swept"
        Who may refuse a motion: the exact swept area of the body against the points of the scan,
        nobody, or ``guard(ranges, stride) -> bool``, asked before every stride with the newest
        scan and the stride's length (m), never before a turn: may the robot go?
    margin : float, default 0.02
        Room that the swept guard keeps around the body (m).
    stride : float, default 0.5
        Farthest drive in one step (m); inf drives the whole way to the point.
    max_moves : int, default 200
        At most this many choices.
    max_path : float, default 40.0
        No new choice after so many metres.
    stop_at_hit : bool, default False
        End the drive at the first collision; otherwise the robot goes on from the contact.
    resolution : float, default 0.05
        Cell of the map that the robot keeps (m).
    bounds : array_like, shape (4,), optional
        Left, bottom, right, top (m) of the sheet, beyond which nothing is looked for. Without it
        the sheet grows as the robot sees more.

    Attributes
    ----------
    floor : ExplorationGrid
        What the robot knows of the floor, where it believes it to be, from its first scan on.
    refused : int
        Choices that the guard did not let begin.
    finished : bool
        Whether the strategy found nothing left to do.

    Raises
    ------
    ValueError
        If an argument is out of range.

    Examples
    --------
    >>> from slamlab.navigation import LongestBeam
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.evaluation.tours import collisions
    >>> from slamlab.simulation import PerfectEstimator, record
    >>> from slamlab.worlds import rooms
    >>> rng, robot, lidar = np.random.default_rng(1), SquareRobot(0.3), Lidar(120)
    >>> pilot = Explorer(robot, lidar, LongestBeam(), rng, max_path=3.0)
    >>> log = record(rooms.thesis_room(), Unicycle(), lidar, pilot, PerfectEstimator(), rng,
    ...              start=[1.0, 2.0, 0.0], dt=1.0, footprint=robot.footprint)
    >>> pilot, int(collisions(log)[-1])
    (Explorer(LongestBeam), 0)
    """

    floor: ExplorationGrid

    def __init__(
        self,
        robot: SquareRobot,
        lidar: Lidar,
        strategy: Strategy,
        rng: np.random.Generator,
        *,
        guard: str | CollisionGuard = "swept",
        margin: float = 0.02,
        stride: float = 0.5,
        max_moves: int = 200,
        max_path: float = 40.0,
        stop_at_hit: bool = False,
        resolution: float = 0.05,
        bounds: tuple[float, float, float, float] | None = None,
    ) -> None:
        as_instance("strategy", strategy, Strategy, "one with choose(situation, rng)")
        self._robot, self._lidar, self._strategy = robot, lidar, strategy
        self._rng = as_rng("rng", rng)
        self._guard = guard if callable(guard) else as_choice("guard", guard, GUARDS)
        self._margin = as_scalar("margin", margin, 0.0, 1e3)
        self._stride = as_scalar("stride", stride, float(np.finfo(float).tiny))
        self._moves_left = as_count("max_moves", max_moves)
        self._path_left = as_scalar("max_path", max_path, 0.0)
        self._stop_at_hit = bool(stop_at_hit)
        self._resolution = as_scalar("resolution", resolution, 1e-6, 1e6)
        self._sheet = None if bounds is None else Grid.over(bounds, self._resolution).bounds
        self.refused, self.finished = 0, False
        self._way: list[Array] = []
        self._begun, self._aimed, self._tries = True, False, 0
        self._came_from: float | None = None
        self._before: Array | None = None

    def __repr__(self) -> str:
        """Return the strategy."""
        return f"Explorer({type(self._strategy).__name__})"

    def command(self, view: View) -> Array | None:
        """Return the next control (v, omega), None when the exploration is over."""
        self._see(as_instance("view", view, View))
        if view.hit:
            self._way = []
            if self._stop_at_hit:
                return None
        while True:
            u = self._follow(view)
            if u is not None:
                return u / view.dt
            self.refused += not self._begun
            if self._moves_left == 0 or self._path_left <= 0:
                return None
            points = self._strategy.choose(self._situation(view), self._rng)
            if points is None:
                self.finished = True
                return None
            self._moves_left -= 1
            self._way = list(as_array("strategy's points", points, ("k", 2)))
            self._begun, self._aimed, self._tries = False, False, 0

    def _see(self, view: View) -> None:
        """Add the newest scan to the floor, and the way here to what was driven."""
        if self._before is None:
            around = np.tile(view.pose[:2], 2) + [-2.0, -2.0, 2.0, 2.0]
            sheet = around if self._sheet is None else self._sheet
            self.floor = ExplorationGrid(sheet, self._resolution, grow=self._sheet is None)
        else:
            self._path_left -= float(np.hypot(*(view.pose - self._before)[:2]))
        self._before = view.pose
        self.floor.insert(view.pose, view.measurement, self._lidar)
        points = self._lidar.points(view.measurement)
        self._points = points[np.isfinite(points[:, 0])]

    def _situation(self, view: View) -> Situation:
        robot, refused = self._robot, not self._begun
        body = robot.side, robot.circumradius + 0.02
        seen = (view.pose, view.measurement, self._lidar, self.floor)
        return Situation(*seen, *body, refused, self._came_from)

    def _follow(self, view: View) -> Array | None:
        """Turn (rad) or drive (m) towards the next point; None without one, or if refused."""
        while self._way:
            x, y = inverse_transform(view.pose, self._way[0])
            length = float(np.hypot(x, y))
            if length < _THERE:
                self._next_point(view)
                continue
            if not self._aimed:
                motion = self._turn(view, float(np.arctan2(y, x)))
                self._way = [] if motion is None else self._way
                return motion
            go = self._allowed(view, length)
            if go >= 0.99 * min(length, self._stride, 0.02):
                self._begun = True
                # After the stride the point lies there: does the robot still look at it?
                self._aimed = length - go < _NEAR or abs(np.arctan2(y, x - go)) < _ASTRAY
                return np.array([go, 0.0])
            if length >= _NEAR:
                self._way = []
                return None
            self._next_point(view)
        return None

    def _next_point(self, view: View) -> None:
        self._way, self._aimed, self._tries = self._way[1:], False, 0
        if self._begun:
            self._came_from = float(wrap_angle(view.pose[2] + np.pi))

    def _turn(self, view: View, angle: float) -> Array | None:
        """Turn towards the point; or make room for that; None if the guard objects for good."""
        margin = 0.5 * self._margin
        if self._guard != "swept" or not self._robot.turn_hits(self._points, angle, margin):
            self._aimed = True
            return np.array([0.0, angle])
        # The new scan may show what the old one had between two beams: it will ask again.
        self._tries += 1
        return self._make_room(view, angle) if self._tries <= 3 else None

    def _make_room(self, view: View, angle: float) -> Array | None:
        """Drive back, or else ahead, a few centimetres, to where the turn is free."""
        steps = 0.25 * self._robot.side * np.arange(1, 6)
        for way in np.concatenate([-steps, steps]):
            if self._robot.drive_hits(self._points, way, 0.5 * self._margin):
                continue
            if not self._robot.turn_hits(self._points - [way, 0.0], angle, self._margin):
                # The point moves along, so that the turn stays the one that was chosen.
                heading = np.array([np.cos(view.pose[2]), np.sin(view.pose[2])])
                self._way[0] = self._way[0] + way * heading
                return np.array([way, 0.0])
        return None

    def _allowed(self, view: View, left: float) -> float:
        """How far the guard lets the robot drive now (m), one stride at most."""
        wanted = min(left, self._stride)
        if self._guard == "none":
            return wanted
        if callable(self._guard):
            return wanted if self._guard(view.measurement, wanted) else 0.0
        free = min(left, float(self._robot.free_distance(self._points, self._margin)))
        return min(wanted, self._turnable(free))

    def _turnable(self, free: float) -> float:
        """Find the farthest end, up to `free` (m), at which figure 14's circle is empty."""
        radius = self._robot.circumradius + self._margin
        points = self._points[np.abs(self._points[:, 1]) < radius]
        chord = np.sqrt(radius**2 - points[:, 1] ** 2)
        low, high = points[:, 0] - chord, points[:, 0] + chord
        ends = np.concatenate([[free], low[(low > 0) & (low < free)]])
        shut = (ends[:, None] > low + 1e-12) & (ends[:, None] < high - 1e-12)
        return float(ends[~shut.any(axis=1)].max(initial=0.0))
