"""Exploration: let a strategy drive the square robot until it has seen the room.

The strategy chooses points, the driver turns and drives there in strides, with a scan and a
collision test before each; the true world tells which of them collide. P5, 3.2.5; chapter 18.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from slamlab._checks import Array, as_array, as_choice, as_count, as_rng, as_scalar
from slamlab.geometry import between, transform, wrap_angle
from slamlab.navigation.seen_floor import UNKNOWN, SeenFloor
from slamlab.navigation.strategies import Strategy, View
from slamlab.robots import SquareRobot
from slamlab.sensors.lidar import Lidar
from slamlab.worlds import World

__all__ = ["Exploration", "explore"]

GUARDS = ("swept", "none")
Guard = Callable[[Array, float], bool]
_DIGITS = 9  # poses and ranges in whole nanometres: no run hangs on the last bit of a machine
_NEAR = 0.1  # a drive that ends this close to its point (m) has reached it


@dataclass(frozen=True)
class Exploration:
    """What an exploration did; n places where it scanned, the start first.

    Attributes
    ----------
    poses : ndarray, shape (n, 3)
        Places of the scans (m, m, rad).
    ranges : ndarray, shape (n, n_beams)
        The scans (m).
    path_length : ndarray, shape (n,)
        Driven so far (m).
    coverage : ndarray, shape (n,)
        Part of the connected free floor seen so far, in [0, 1].
    collisions : ndarray of int, shape (n,)
        Turns and strides so far that met an obstacle; the robot stops at the contact.
    refused : int
        Choices that the guard did not let begin.
    finished : bool
        Whether the strategy stopped by itself or the wanted coverage was reached.
    floor : SeenFloor
        What the robot knows at the end.
    revisits : int
        How often it entered a square of the floor, as large as itself, that it had left before.
    """

    poses: Array
    ranges: Array
    path_length: Array
    coverage: Array
    collisions: NDArray[np.intp]
    refused: int
    finished: bool
    floor: SeenFloor
    revisits: int = field(default=0)

    def coverage_at(self, path_length: ArrayLike) -> Array:
        """Coverage after given path lengths (...) in metres; the last one holds on."""
        wanted = as_array("path_length", path_length)
        reached = np.searchsorted(self.path_length, wanted, side="right") - 1
        return np.maximum.accumulate(self.coverage)[np.maximum(reached, 0)]


def explore(
    world: World,
    robot: SquareRobot,
    lidar: Lidar,
    strategy: Strategy,
    start: ArrayLike,
    rng: np.random.Generator,
    *,
    guard: str | Guard = "swept",
    margin: float = 0.02,
    stride: float = 0.5,
    max_moves: int = 200,
    max_path: float = 40.0,
    until: float = 1.0,
    stop_at_collision: bool = False,
    resolution: float = 0.05,
) -> Exploration:
    """Explore a world.

    Parameters
    ----------
    world : World
        Where it happens. Only the lidar looks at it, and the referee who counts collisions.
    robot : SquareRobot
    lidar : Lidar
    strategy : Strategy
        Chooses the points to drive to; anything with `choose(view, rng)`.
    start : array_like, shape (3,)
        Pose (m, m, rad).
    rng : numpy.random.Generator
        For the strategy and for the noise of the lidar.
    guard : {"swept", "none"} or callable, default "swept"
        Who may refuse a motion: the exact swept area of the body against the points of the scan,
        nobody, or ``guard(ranges, stride) -> bool``, asked before every stride with a new scan
        and the stride's length (m), never before a turn: may the robot go?
    margin : float, default 0.02
        Room that the swept guard keeps around the body (m).
    stride : float, default 0.5
        Farthest drive between two scans (m); inf takes no scan on the way.
    max_moves : int, default 200
        At most this many choices.
    max_path : float, default 40.0
        No new choice after so many metres.
    until : float, default 1.0
        Stop when this part of the free floor has been seen.
    stop_at_collision : bool, default False
        End the run at the first collision; otherwise the robot goes on from the contact.
    resolution : float, default 0.05
        Cell of the map that the robot keeps (m).

    Returns
    -------
    Exploration

    Raises
    ------
    ValueError
        If an argument is out of range, the robot starts in an obstacle, or no floor is free.
    """
    if not callable(guard):
        as_choice("guard", guard, GUARDS)
    rng, start = as_rng("rng", rng), as_array("start", start, (3,))
    if not callable(getattr(strategy, "choose", None)):
        raise ValueError(f"strategy: expected an object with choose(view, rng), got {strategy!r}")
    until = as_scalar("until", until, 0.0, 1.0)
    max_path = as_scalar("max_path", max_path, 0.0)
    stride = as_scalar("stride", stride, float(np.finfo(float).tiny))
    driver = _Driver(world, robot, lidar, start, rng, guard, margin, stride, resolution)
    finished, refusals = False, 0
    for _ in range(as_count("max_moves", max_moves)):
        if driver.coverage[-1] >= until:
            finished = True
            break
        if driver.path_length[-1] >= max_path or (stop_at_collision and driver.hit):
            break
        points = strategy.choose(driver.view(), rng)
        if points is None:
            finished = True
            break
        driver.follow(as_array("strategy's points", points, ("k", 2)))
        refusals += driver.refused
    return driver.report(finished or driver.coverage[-1] >= until, refusals)


class _Driver:
    """Turns, drives and scans; keeps the map and the record."""

    def __init__(
        self,
        world: World,
        robot: SquareRobot,
        lidar: Lidar,
        start: Array,
        rng: np.random.Generator,
        guard: str | Guard,
        margin: float,
        stride: float,
        resolution: float,
    ) -> None:
        self.world, self.robot, self.lidar, self.rng = world, robot, lidar, rng
        self.guard, self.stride = guard, stride
        self.margin = as_scalar("margin", margin, 0.0, 1e3)
        self.floor = SeenFloor(world.bounds, resolution)
        self.truth = _free_floor(world, self.floor, start)
        if bool(world.collides(robot.footprint, start)):
            raise ValueError(
                f"start: expected a pose at which the robot touches no obstacle, got {start}"
            )
        self.pose, self.refused = np.round(start, _DIGITS), False
        self.came_from: float | None = None
        self.poses: list[Array] = []
        self.scans: list[Array] = []
        self.path_length, self.coverage = [0.0], [0.0]
        self.collisions, self.trace, self._count = [0], [start[:2].copy()], 0
        self._driven = 0.0
        self._look()
        for record in (self.path_length, self.coverage, self.collisions):
            del record[0]

    def view(self) -> View:
        """Say what the strategy gets to know."""
        self._look_anew()
        parts = (self.pose.copy(), self.scans[-1], self.lidar, self.robot, self.floor)
        return View(*parts, self.refused, self.came_from)

    @property
    def hit(self) -> bool:
        """Whether something was hit so far."""
        return self._count > 0

    def follow(self, points: Array) -> None:
        """Drive through the points; stop early where the guard refuses or something is hit."""
        self.refused = True
        for point in points:
            way = point - self.pose[:2]
            length = float(np.hypot(*way))
            if length < 1e-6:
                continue
            turn = float(wrap_angle(np.arctan2(way[1], way[0]) - self.pose[2]))
            if not self._turn(turn) or not self._drive(length):
                return
            self.refused = False
            self.came_from = float(wrap_angle(self.pose[2] + np.pi))

    def _turn(self, angle: float) -> bool:
        """Turn; False if the guard objects or something is hit."""
        tries = 4 if self.guard == "swept" else 0
        for left in reversed(range(tries)):
            points = self._points()
            if not self.robot.turn_hits(points, angle, 0.5 * self.margin):
                break
            # The new scan may show what the old one had between two beams: ask again.
            if not left or not self._make_room(points, angle):
                return False
        return self._try(lambda part: self.robot.turn(self.pose, part * angle))

    def _make_room(self, points: Array, angle: float) -> bool:
        """Drive back, or else ahead, a few centimetres until the turn is free."""
        steps = 0.25 * self.robot.side * np.arange(1, 6)
        for way in np.concatenate([-steps, steps]):
            if self.robot.drive_hits(points, way, 0.5 * self.margin):
                continue
            if not self.robot.turn_hits(points - [way, 0.0], angle, self.margin):
                free = self._try(lambda part, way=way: self.robot.forward(self.pose, part * way))
                self._look()
                return free
        return False

    def _drive(self, length: float) -> bool:
        """Drive in strides with a look after each; False if the way ended early."""
        left = length
        while left > 1e-6:
            go = self._allowed(left)
            if go < 0.99 * min(left, self.stride, 0.02):
                return left < _NEAR
            self.refused = False
            free = self._try(lambda part, go=go: self.robot.forward(self.pose, part * go))
            self._look()
            if not free:
                return False
            left -= go
        return True

    def _allowed(self, left: float) -> float:
        """How far the guard lets the robot drive now (m), one stride at most."""
        wanted = min(left, self.stride)
        if self.guard == "none":
            return wanted
        if callable(self.guard):
            self._look_anew()
            return wanted if self.guard(self.scans[-1], wanted) else 0.0
        points = self._points()
        free = min(left, float(self.robot.free_distance(points, self.margin)))
        return min(wanted, self._turnable(points, free))

    def _turnable(self, points: Array, free: float) -> float:
        """Find the farthest end, up to `free` (m), at which figure 14's circle is empty."""
        radius = self.robot.circumradius + self.margin
        points = points[np.abs(points[:, 1]) < radius]
        chord = np.sqrt(radius**2 - points[:, 1] ** 2)
        low, high = points[:, 0] - chord, points[:, 0] + chord
        ends = np.concatenate([[free], low[(low > 0) & (low < free)]])
        shut = (ends[:, None] > low + 1e-12) & (ends[:, None] < high - 1e-12)
        ends = ends[~shut.any(axis=1)]
        return float(ends.max(initial=0.0))

    def _try(self, motion) -> bool:  # type: ignore[no-untyped-def]
        """Execute a motion in the true world; at a contact stop there, count it, say False."""
        footprint, start = self.robot.footprint, self.pose
        if not bool(self.world.sweep_collides(footprint, start, motion(1.0))):
            self._arrive(motion(1.0))
            return True
        self._count += 1
        free, hit = 0.0, 1.0
        for _ in range(12):
            middle = 0.5 * (free + hit)
            if bool(self.world.sweep_collides(footprint, start, motion(middle))):
                hit = middle
            else:
                free = middle
        self._arrive(motion(free))
        return False

    def _arrive(self, pose: Array) -> None:
        pose = np.round(pose, _DIGITS)
        self._driven += float(np.hypot(*(pose - self.pose)[:2]))
        self.pose = pose
        self.trace.append(pose[:2].copy())

    def _points(self) -> Array:
        """Points of the last scan in the body frame of now."""
        if np.array_equal(self.pose, self.poses[-1]):
            return self._seen
        return transform(between(self.pose, self.poses[-1]), self._seen)

    def _look_anew(self) -> None:
        """Scan, unless the robot has not moved since it last did."""
        if not np.array_equal(self.pose, self.poses[-1]):
            self._look()

    def _look(self) -> None:
        """Take a scan, add it to the map, write the record."""
        ranges = np.round(self.lidar.scan(self.world, self.pose, self.rng), _DIGITS)
        self.floor.insert(self.pose, ranges, self.lidar)
        points = self.lidar.points(ranges)
        self._seen = points[np.isfinite(points[:, 0])]
        self.poses.append(self.pose.copy())
        self.scans.append(ranges)
        self.path_length.append(self._driven)
        seen = (self.floor.state != UNKNOWN) & self.truth
        self.coverage.append(float(seen.sum() / self.truth.sum()))
        self.collisions.append(self._count)

    def report(self, finished: bool, refused: int) -> Exploration:
        """Return the record, closed with a last look."""
        self._look_anew()
        return Exploration(
            np.array(self.poses),
            np.array(self.scans),
            np.array(self.path_length),
            np.array(self.coverage),
            np.array(self.collisions, dtype=np.intp),
            refused,
            finished,
            self.floor,
            _revisits(np.array(self.trace), self.robot.side),
        )


def _free_floor(world: World, floor: SeenFloor, start: Array) -> NDArray[np.bool_]:
    """Cells whose centre is free and connected with the start, shape (rows, columns)."""
    free = world.is_free(floor.centres)
    if not free.any():
        raise ValueError("world: expected free floor, every cell is occupied")
    labels, _ = ndimage.label(free)
    label = labels[floor.cell(start[:2])]
    if label == 0:
        raise ValueError(f"start: expected a pose on free floor, got {start}")
    return labels == label


def _revisits(trace: Array, side: float) -> int:
    """Entries into squares of the given side (m) that were left before; trace (k, 2)."""
    steps = np.diff(trace, axis=0)
    counts = np.maximum(np.ceil(4 * np.hypot(*steps.T) / side).astype(int), 1)
    legs = zip(trace[:-1], steps, counts, strict=True)
    parts = [a + np.linspace(0, 1, n + 1)[1:, None] * d for a, d, n in legs]
    squares = np.floor(np.concatenate([trace[:1], *parts]) / side).astype(int)
    entered = squares[np.r_[True, (np.diff(squares, axis=0) != 0).any(axis=1)]]
    return len(entered) - len(np.unique(entered, axis=0))
