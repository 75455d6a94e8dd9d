"""Driving home along a path memory: two laws, and the pilot that obeys one.

P3 section 1, steps 2.1 to 2.4. The way is looked up only towards the start, so that a path which
comes near itself cannot tempt the robot to another branch. Chapter 17 drives it home.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_instance, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.models import ScanSensor, Smoother, View
from slamlab.navigation.drive import MOVED
from slamlab.navigation.guard import CollisionGuard
from slamlab.navigation.path_memory import PathMemory

__all__ = ["PathFollower", "Law", "RegulatedPurePursuit", "ReturnPilot", "ReturnLaw"]


# Where the guard refuses the direction of the path, others are tried in this order (rad).
_SIDES = (0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2)
_TOLERANCE = 0.05  # of the memory in which the way home is laid (m)
_PATIENCE = 40  # commands without progress after which a robot is stuck


class Law(Protocol):
    """What a `PathFollower` needs: a control for where the robot thinks it is."""

    @property
    def max_turn_rate(self) -> float:
        """How fast it may turn (rad/s)."""

    def command(self, path: PathMemory, pose: ArrayLike, s: ArrayLike) -> tuple[Array, Array]:
        """Return controls (..., 2) or (..., 3) and how far it is still along the path (...)."""


@dataclass(frozen=True)
class ReturnLaw:
    """P3's law: v = k_v d towards a point P_f ahead, omega = k_omega alpha, d from P_r to P_f.

    P_f lies `lookahead` nearer to the start than the point of the path nearest to the robot P_r;
    alpha is the angle between the robot's front and the direction to P_f.

    Parameters
    ----------
    k_v : float, default 1.0
        Gain of the speed (1/s).
    k_omega : float, default 2.0
        Gain of the turn rate (1/s); with 0 a mecanum robot keeps its heading.
    lookahead : float, default 0.15
        s_f of P3 (m).
    max_speed, max_turn_rate : float
        Limits (m/s) and (rad/s).
    backwards : bool, default False
        Drive tail first, so that nobody need turn round before the way home.
    mecanum : bool, default False
        Controls are (v_x, v_y, omega) and point at P_f whatever the heading.

    Examples
    --------
    >>> path = PathMemory(0.02)
    >>> for x in np.linspace(0, 1, 11):
    ...     path.add((x, 0.0))
    >>> path.close()
    >>> control, s = ReturnLaw(max_speed=0.2).command(path, [0.8, 0.0, np.pi], path.length)
    >>> control.round(3).tolist(), round(float(s), 2)
    ([0.15, 0.0], 0.8)
    """

    k_v: float = 1.0
    k_omega: float = 2.0
    lookahead: float = 0.15
    max_speed: float = 0.2
    max_turn_rate: float = 1.5
    backwards: bool = False
    mecanum: bool = False

    def __post_init__(self) -> None:
        """Check the parameters."""
        for name in ("k_v", "lookahead", "max_speed", "max_turn_rate"):
            as_scalar(name, getattr(self, name), low=1e-9, high=1e9)
        as_scalar("k_omega", self.k_omega, low=0.0, high=1e9)

    def command(self, path: PathMemory, pose: ArrayLike, s: ArrayLike) -> tuple[Array, Array]:
        """Compute controls for robots on their way home.

        Parameters
        ----------
        path : PathMemory
        pose : array_like, shape (..., 3)
            Where the robots think they are, in the frame of the path.
        s : array_like, shape (...)
            Arc length at which they were (m), on the path; they are not looked for beyond it.

        Returns
        -------
        u : ndarray, shape (..., 2), or (..., 3) for a mecanum robot
        s : ndarray, shape (...)
            Arc length of the nearest point now: never more than before.
        """
        s, distance, alpha = _look_ahead(path, pose, s, self.lookahead, self.backwards)
        # 2.3: v = k_v |P_f P_r|, omega = k_omega alpha.
        v = np.minimum(self.k_v * distance, self.max_speed)
        omega = np.clip(self.k_omega * alpha, -self.max_turn_rate, self.max_turn_rate)
        v = -v if self.backwards else v
        if self.mecanum:
            return np.stack([v * np.cos(alpha), v * np.sin(alpha), omega], -1), s
        return np.stack([v, omega], -1), s


@dataclass(frozen=True)
class RegulatedPurePursuit:
    """Pure pursuit that slows down in bends and before the goal (Macenski and others, 2023).

    The robot drives the arc that leads through P_f, of curvature 2 y / L^2; arcs tighter than
    `min_radius` slow it down in proportion, as does the last stretch. If P_f lies far to the
    side it turns on the spot first.

    Parameters
    ----------
    lookahead : float, default 0.15
        Distance L along the path (m).
    max_speed, max_turn_rate : float
        Limits (m/s) and (rad/s).
    min_radius : float, default 0.3
        Arcs of a smaller radius are driven slower (m).
    approach : float, default 0.3
        Distance from the goal at which slowing down begins (m).
    min_speed : float, default 0.02
        No regulation goes below this (m/s).
    turn_beyond : float, default 1.0
        Angle (rad) to P_f beyond which the robot turns on the spot.
    backwards : bool, default False
        Drive tail first.

    Examples
    --------
    >>> path = PathMemory(0.02)
    >>> for x in np.linspace(0, 1, 11):
    ...     path.add((x, 0.0))
    >>> path.close()
    >>> law = RegulatedPurePursuit(max_speed=0.2)
    >>> law.command(path, [0.8, 0.0, np.pi], path.length)[0].round(3).tolist()
    [0.2, 0.0]
    """

    lookahead: float = 0.15
    max_speed: float = 0.2
    max_turn_rate: float = 1.5
    min_radius: float = 0.3
    approach: float = 0.3
    min_speed: float = 0.02
    turn_beyond: float = 1.0
    backwards: bool = False

    def __post_init__(self) -> None:
        """Check the parameters."""
        names = ("lookahead", "max_speed", "max_turn_rate", "min_radius", "approach", "min_speed")
        for name in names:
            as_scalar(name, getattr(self, name), low=1e-9, high=1e9)
        as_scalar("turn_beyond", self.turn_beyond, low=1e-3, high=np.pi)

    def command(self, path: PathMemory, pose: ArrayLike, s: ArrayLike) -> tuple[Array, Array]:
        """Return controls (..., 2) and arc lengths (...); arguments as in `ReturnLaw`."""
        s, distance, alpha = _look_ahead(path, pose, s, self.lookahead, self.backwards)
        # The arc through P_f that begins along the body: curvature 2 sin(alpha) / |P_f P_r|.
        curvature = 2.0 * np.sin(alpha) / np.maximum(distance, 1e-6)
        slow_bend = np.minimum(1.0, 1.0 / np.maximum(np.abs(curvature) * self.min_radius, 1e-9))
        slow_goal = np.minimum(1.0, s / self.approach)
        v = np.maximum(self.max_speed * np.minimum(slow_bend, slow_goal), self.min_speed)
        omega = np.clip(v * curvature, -self.max_turn_rate, self.max_turn_rate)
        on_the_spot = np.abs(alpha) > self.turn_beyond
        omega = np.where(on_the_spot, np.sign(alpha) * self.max_turn_rate, omega)
        v = np.where(on_the_spot, 0.0, -v if self.backwards else v)
        return np.stack([v, omega], -1), s


def _look_ahead(
    path: PathMemory, pose: ArrayLike, s: ArrayLike, lookahead: float, backwards: bool
) -> tuple[Array, Array, Array]:
    """Arc length now, and distance and direction of P_f as seen from the front, or the tail."""
    pose = as_array("pose", pose, ("...", 3))
    as_instance("path", path, PathMemory)
    s = np.minimum(as_array("s", s), path.length)
    # 2.1: the nearest point, looked for between s and a little nearer to the start.
    near, _ = path.nearest(pose[..., :2], np.maximum(s - 2.0 * lookahead, 0.0), s)
    # 2.2: P_f.
    delta = path.point_at(np.maximum(near - lookahead, 0.0)) - pose[..., :2]
    x, y = delta[..., 0], delta[..., 1]
    heading = pose[..., 2] + (np.pi if backwards else 0.0)
    return near, np.hypot(x, y), wrap_angle(np.arctan2(y, x) - heading)


class PathFollower:
    """Drives back along a remembered path, P3 steps 2.1 to 2.4; a pilot for `simulation.record`.

    Parameters
    ----------
    path : PathMemory
        In the frame in which the robot believes to be.
    law : ReturnLaw or RegulatedPurePursuit
        Or another one with their `command` and `max_turn_rate`.
    turn_first : bool, default False
        Turn on the spot until the front looks along the path before driving.
    stop : float, default 0.02
        Arc length (m) before the start at which the robot stops.
    turn_rate : float, optional
        How fast it turns on the spot (rad/s); as fast as the law allows without it.

    Attributes
    ----------
    s : ndarray, shape (...)
        How far it still is along the path (m), for each robot of a batch.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.simulation import PerfectEstimator, record
    >>> path = PathMemory(0.02)
    >>> for x in np.linspace(0, 1, 11):
    ...     path.add((x, 0.0))
    >>> path.close()
    >>> pilot, rng = PathFollower(path, ReturnLaw(backwards=True)), np.random.default_rng(1)
    >>> log = record(None, Unicycle(), None, pilot, PerfectEstimator(), rng, start=[1, 0, 0])
    >>> abs(log.truth[-1].round(1)).tolist()
    [0.0, 0.0, 0.0]
    """

    s: Array

    def __init__(
        self,
        path: PathMemory,
        law: Law,
        *,
        turn_first: bool = False,
        stop: float = 0.02,
        turn_rate: float | None = None,
    ) -> None:
        self._path, self._law = path, as_instance("law", law, Law, "a law such as ReturnLaw()")
        self._turn_first, self._stop = bool(turn_first), as_scalar("stop", stop, 1e-6, 1e6)
        rate = law.max_turn_rate if turn_rate is None else turn_rate
        self._turn_rate = as_scalar("turn_rate", rate, 1e-6, 1e6)
        self._turning: np.ndarray | None = None

    def __repr__(self) -> str:
        """Return law and path."""
        return f"PathFollower({self._law}, {self._path})"

    @property
    def arrived(self) -> np.ndarray:
        """Who has no path left, shape (...)."""
        return np.asarray(self.s <= self._stop)

    def command(self, view: View) -> Array | None:
        """Return the next controls (..., 2 or 3), zero for who is home; None when all are."""
        as_instance("view", view, View)
        if self._turning is None:
            self._turning = np.full(view.pose.shape[:-1], self._turn_first)
            self.s = np.full(view.pose.shape[:-1], self._path.length)
        u, self.s = self._law.command(self._path, view.pose, self.s)
        if self._turning.any():
            off = _off_the_path(self._path, view.pose, self.s)
            self._turning = self._turning & (np.abs(off) > 0.05)
            spot = np.zeros_like(u)
            spot[..., -1] = np.clip(off / view.dt, -self._turn_rate, self._turn_rate)
            u = np.where(self._turning[..., None], spot, u)
        # 2.4: home is where no path is left.
        return None if self.arrived.all() else np.where(self.arrived[..., None], 0.0, u)


def _off_the_path(path: PathMemory, pose: Array, s: Array) -> Array:
    """Angle (...) from the front to the direction of the path, homewards (rad)."""
    tangent = -path.tangent_at(s)
    return wrap_angle(np.arctan2(tangent[..., 1], tangent[..., 0]) - pose[..., 2])


class ReturnPilot:
    """Drives home tail first along the way it came, guarded; a pilot for `simulation.record`.

    The way is laid into a `PathMemory`, which cuts its loops, and laid anew when the belief
    changes its mind about the past by 5 cm. Controls are body velocities (v_x, v_y, omega).

    Parameters
    ----------
    path : array_like, shape (n, 2) or (n, 3)
        Where the robot believes to have been, the start first.
    guard : CollisionGuard
    lidar : ScanSensor
    smoother : Smoother, optional
        The belief itself, if it revises its past: the first n rows of its trajectory are then
        the way.
    max_speed : float, default 0.5
        (m/s).
    cut_loops : bool, default True
        Drive the way without its loops, which P3 cuts out. Wheels undo their systematic errors
        only on the whole way.

    Attributes
    ----------
    memory : PathMemory
    n_replans : int
        How often the memory was laid anew.
    stuck : bool
        Whether it gave up before an obstacle.

    Examples
    --------
    Out along x, home tail first:

    >>> from slamlab.navigation import YOUBOT_BODY
    >>> from slamlab.sensors import Lidar
    >>> lidar, way = Lidar(4), np.stack([np.linspace(0, 3, 31), np.zeros(31)], -1)
    >>> pilot, away = ReturnPilot(way, CollisionGuard(YOUBOT_BODY), lidar), np.full(4, np.inf)
    >>> view = View(0.0, 0.2, np.array([3.0, 0.0, 0.0]), np.zeros((3, 3)), away, np.array(False))
    >>> (pilot.command(view) + 0.0).round(6).tolist()
    [-0.5, 0.0, 0.0]
    """

    memory: PathMemory
    _s: Array  # how far it still is along the path (m)

    def __init__(
        self,
        path: ArrayLike,
        guard: CollisionGuard,
        lidar: ScanSensor,
        *,
        smoother: Smoother | None = None,
        max_speed: float = 0.5,
        cut_loops: bool = True,
    ) -> None:
        self._accuracy = 1e-4 if cut_loops else None
        self._way = np.asarray(as_array("path", path, ("n", "k")))[:, :2].copy()
        self._guard, self._lidar, self._past = guard, lidar, smoother
        # A mecanum robot whose tail follows the path as its nose did on the way out.
        self._law = ReturnLaw(
            k_v=3.0, lookahead=0.25, max_speed=max_speed, backwards=True, mecanum=True
        )
        self.n_replans, self.stuck = 0, False
        self._best, self._waited = float(np.inf), 0
        self._lay()

    def __repr__(self) -> str:
        """Return the path."""
        return f"ReturnPilot({self.memory!r})"

    def command(self, view: View) -> Array | None:
        """Return the next body velocity (3,), None when home or stuck."""
        self._revise(view.pose)
        wish, self._s = self._law.command(self.memory, view.pose, self._s)
        nearer = float(self._s) < self._best - 0.05
        self._waited = 0 if nearer else self._waited + 1
        self._best = float(self._s) if nearer else self._best
        self.stuck = self._waited > _PATIENCE
        if self._s <= 0.02 or self.stuck:
            return None
        points = self._lidar.points(view.measurement)
        points = points[np.isfinite(points).all(-1)]
        for side in _SIDES:
            c, s = np.cos(side), np.sin(side)
            x, y, turn = wish
            turned = np.array([c * x - s * y, s * x + c * y, turn])
            u = self._guard.safe_velocity(turned, points, view.dt)
            if np.hypot(u[0], u[1]) > 1e-3:
                break
        return u

    def _lay(self) -> None:
        self.memory = PathMemory.from_points(
            self._way, _TOLERANCE, loop_accuracy=self._accuracy, max_step=1e3
        )
        self._s = np.asarray(self.memory.length)

    def _revise(self, pose: Array) -> None:
        """Lay the memory anew where the belief has moved the way; go on from the nearest point."""
        if self._past is None:
            return
        now = self._past.trajectory[: len(self._way), :2]
        if np.hypot(*(now - self._way).T).max() < MOVED:
            return
        part = float(self._s) / max(self.memory.length, 1e-9)
        self._way, self._best, self._waited = now, np.inf, 0
        self._lay()
        self.n_replans += 1
        middle, length = part * self.memory.length, self.memory.length
        self._s, _ = self.memory.nearest(pose[:2], max(middle - 2.0, 0.0), min(middle + 2, length))
