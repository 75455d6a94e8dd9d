"""Exploration: a pilot that lets a strategy drive the square robot until it has seen the room.

The strategy chooses points, the pilot turns and drives there in strides, with a scan and a
collision test before each. It knows where it believes to be, not where it is. P5, 3.2.5;
chapter 18, whose formula is (A).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from slamlab._checks import (
    Array,
    as_array,
    as_choice,
    as_count,
    as_instance,
    as_positive,
    as_rng,
    as_scalar,
)
from slamlab.geometry import inverse_transform, wrap_angle
from slamlab.grids import Grid
from slamlab.models import View
from slamlab.navigation.exploration_grid import ExplorationGrid
from slamlab.navigation.strategies import Situation, Strategy
from slamlab.robots import SquareRobot
from slamlab.sensors.lidar import Lidar

__all__ = ["Explorer"]

GUARDS = ("swept", "none")
StrideTest = Callable[[Array, float], bool]  # may the robot go, by this scan, so far (m)?
_NEAR = 0.1  # a drive that must end this close to its point (m) has reached it
_THERE = 0.02  # a point this near (m) is not driven to
_ASTRAY = 0.05  # heading error (rad) after a stride at which the robot aims anew


@dataclass
class Plan:
    """What the strategy chose, and how far the robot is with it.

    Attributes
    ----------
    points : ndarray, shape (k, 2)
        Points still to be driven through (m).
    begun : bool
        Whether the guard let any drive of it begin.
    attempts : int
        Turns to the next point that the guard refused.
    came_from : float or None
        Direction in the world (rad) from the last point reached to where the robot came from.
    """

    points: Array = field(default_factory=lambda: np.empty((0, 2)))
    begun: bool = True
    attempts: int = 0
    came_from: float | None = None


@dataclass
class _Budget:
    """What is left of the choices, and of the way (m)."""

    choices: int
    metres: float


class _Guard:
    """What the robot may do, by its newest scan."""

    def __init__(
        self, robot: SquareRobot, kind: str | StrideTest, margin: float, stride: float
    ) -> None:
        self.robot, self._kind = robot, kind
        self._margin, self._stride = margin, stride

    def see(self, points: Array) -> None:
        """Take the points of a scan (n, 2) in the frame of the body (m); lost ones are NaN."""
        self._points = points[np.isfinite(points[:, 0])]

    def turn_is_free(self, angle: float) -> bool:
        """Whether the robot may turn on the spot (rad)."""
        swept = self._kind == "swept"
        return not (swept and self.robot.turn_hits(self._points, angle, 0.5 * self._margin))

    def step_aside(self, angle: float) -> float | None:
        """Few centimetres back, or else ahead, to where the turn is free; None without such."""
        steps = 0.25 * self.robot.side * np.arange(1, 6)
        for step in np.concatenate([-steps, steps]).tolist():
            if self.robot.drive_hits(self._points, step, 0.5 * self._margin):
                continue
            if not self.robot.turn_hits(self._points - [step, 0.0], angle, self._margin):
                return float(step)
        return None

    def free_drive(self, ranges: Array, left: float) -> float | None:
        """How far the robot may drive now of what is left (m), one stride at most; None: not."""
        wanted = go = min(left, self._stride)
        if callable(self._kind):
            go = wanted if self._kind(ranges, wanted) else 0.0
        elif self._kind == "swept":
            free = float(self.robot.free_distance(self._points, self._margin))  # (A)
            go = min(wanted, self._turnable(min(left, free)))  # figure 14: room to turn there
        return go if go >= 0.99 * min(wanted, 0.02) else None

    def _turnable(self, free: float) -> float:
        """Find the farthest end, up to `free` (m), at which figure 14's circle is empty."""
        radius = self.robot.circumradius + self._margin  # of the circle, figure 14
        points = self._points[np.abs(self._points[:, 1]) < radius]
        chord = np.sqrt(radius**2 - points[:, 1] ** 2)
        low, high = points[:, 0] - chord, points[:, 0] + chord
        ends = np.concatenate([[free], low[(low > 0) & (low < free)]])
        excluded = (ends[:, None] > low + 1e-12) & (ends[:, None] < high - 1e-12)
        return float(ends[~excluded.any(axis=1)].max(initial=0.0))


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
        Room that the swept guard keeps around the body to the points of the scan (m). A thin leg
        or the tip of a corner between two beams it does not see: at a stride and half a body the
        beams should be no farther apart than this.
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
        Left, bottom, right, top (m) of the floor, beyond which nothing is explored. Without it
        the floor grows as the robot sees more.

    Attributes
    ----------
    floor : ExplorationGrid
        What the robot knows of the floor, where it believes it to be, from its first scan on.
    mode : str
        "choose", "turn" to the next point, "drive" to it; "finished", or "over" where choices or
        metres ran out.
    refused : int
        Choices that the guard did not let begin.
    finished : bool
        Whether the strategy found nothing left to do.

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
        guard: str | StrideTest = "swept",
        margin: float = 0.02,
        stride: float = 0.5,
        max_moves: int = 200,
        max_path: float = 40.0,
        stop_at_hit: bool = False,
        resolution: float = 0.05,
        bounds: tuple[float, float, float, float] | None = None,
    ) -> None:
        as_instance("strategy", strategy, Strategy, "one with choose(situation, rng)")
        self._lidar, self._strategy, self._rng = lidar, strategy, as_rng("rng", rng)
        kind = guard if callable(guard) else as_choice("guard", guard, GUARDS)
        margin = as_scalar("margin", margin, 0.0, 1e3)
        stride = as_positive("stride", stride)
        self._guard = _Guard(robot, kind, margin, stride)
        self._left = _Budget(
            as_count("max_moves", max_moves), as_scalar("max_path", max_path, 0.0)
        )
        self._stop_at_hit = bool(stop_at_hit)
        resolution = as_scalar("resolution", resolution, 1e-6, 1e6)
        whole = None if bounds is None else Grid.over(bounds, resolution).bounds
        self._grid = whole, resolution
        self._plan, self.mode, self.refused = Plan(), "choose", 0
        self._before: Array | None = None

    def __repr__(self) -> str:
        """Return the strategy."""
        return f"Explorer({type(self._strategy).__name__})"

    @property
    def finished(self) -> bool:
        """Whether the strategy found nothing left to do."""
        return self.mode == "finished"

    def command(self, view: View) -> Array | None:
        """Return the next control (v, omega), None when the exploration is over."""
        self._see(as_instance("view", view, View))
        if view.hit:
            self.mode = "choose"
            if self._stop_at_hit:
                return None
        modes = {"choose": self._choose, "turn": self._turn, "drive": self._drive}
        while self.mode in modes:
            motion = modes[self.mode](view)
            if motion is not None:
                return motion / view.dt
        return None

    def _see(self, view: View) -> None:
        """Add the newest scan to the floor, and the way here to what was driven."""
        if self._before is None:
            whole, resolution = self._grid
            around = np.tile(view.pose[:2], 2) + [-2.0, -2.0, 2.0, 2.0]
            bounds = around if whole is None else whole
            self.floor = ExplorationGrid(bounds, resolution, grow=whole is None)
        else:
            self._left.metres -= float(np.hypot(*(view.pose - self._before)[:2]))
        self._before = view.pose
        self.floor.insert(view.pose, view.measurement, self._lidar)
        self._guard.see(self._lidar.points(view.measurement))

    # One method a mode; each returns a motion (m, rad), or leaves another mode.

    def _choose(self, view: View) -> None:
        """Let the strategy choose points: "turn" to the first, "finished" without any."""
        refused, robot = not self._plan.begun, self._guard.robot
        self.refused += refused
        if self._left.choices == 0 or self._left.metres <= 0:
            self.mode = "over"
            return
        seen = view.pose, view.measurement, self._lidar, self.floor
        body = robot.side, robot.circumradius + 0.02
        situation = Situation(*seen, *body, refused, self._plan.came_from)
        points = self._strategy.choose(situation, self._rng)  # which way, and how far
        if points is None:
            self.mode = "finished"
            return
        points = as_array("strategy's points", points, ("k", 2))
        self._left.choices -= 1
        self._plan = Plan(points, begun=False, came_from=self._plan.came_from)
        self.mode = "turn" if len(points) else "choose"

    def _turn(self, view: View) -> Array | None:
        """Turn to the next point, or make room for that; "choose" if the guard refuses."""
        x, y = inverse_transform(view.pose, self._plan.points[0])
        if np.hypot(x, y) < _THERE:
            self._next_point(view)
            return None
        angle = float(np.arctan2(y, x))
        if self._guard.turn_is_free(angle):  # figure 14, but only what the corners sweep
            self.mode = "drive"
            return np.array([0.0, angle])
        # The new scan may show what the old one had between two beams: it will ask again.
        self._plan.attempts += 1
        step = self._guard.step_aside(angle) if self._plan.attempts <= 3 else None
        if step is None:
            self.mode = "choose"
            return None
        # The point moves along, so that the turn stays the one that was chosen.
        heading = np.array([np.cos(view.pose[2]), np.sin(view.pose[2])])
        self._plan.points = np.vstack(
            [self._plan.points[0] + step * heading, self._plan.points[1:]]
        )
        return np.array([step, 0.0])

    def _drive(self, view: View) -> Array | None:
        """Drive a stride to the next point; near it the next one, far from it "choose"."""
        x, y = inverse_transform(view.pose, self._plan.points[0])
        length = float(np.hypot(x, y))
        go = None if length < _THERE else self._guard.free_drive(view.measurement, length)
        if go is None and length < _NEAR:
            self._next_point(view)
            return None
        if go is None:
            self.mode = "choose"
            return None
        self._plan.begun = True
        # After the stride the point is at (x - go, y): does the robot still head for it?
        aimed = length - go < _NEAR or abs(np.arctan2(y, x - go)) < _ASTRAY
        self.mode = "drive" if aimed else "turn"
        return np.array([go, 0.0])

    def _next_point(self, view: View) -> None:
        """Leave the point reached behind: "turn" to the next one, "choose" without one."""
        plan = self._plan
        plan.points, plan.attempts = plan.points[1:], 0
        if plan.begun:
            plan.came_from = float(wrap_angle(view.pose[2] + np.pi))
        self.mode = "turn" if len(plan.points) else "choose"
