"""Driving home along a path memory: P3's return law, regulated pure pursuit, the whole return.

P3 section 1, steps 2.1 to 2.4. The way is looked up only towards the start, so that a path which
comes near itself cannot tempt the robot to another branch. Chapter 17 drives it home.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_covariance, as_rng, as_scalar
from slamlab.geometry import compose, wrap_angle
from slamlab.navigation.path_memory import PathMemory

__all__ = ["Law", "RegulatedPurePursuit", "Return", "ReturnLaw", "return_to_start"]


class Law(Protocol):
    """What `return_to_start` needs: a control for where the robot thinks it is."""

    def command(self, path: PathMemory, pose: ArrayLike, s: ArrayLike) -> tuple[Array, Array]:
        """Return controls (..., 2) or (..., 3) and how far it is still along the path (...)."""
        ...


class _Motion(Protocol):
    def sample(
        self,
        pose: ArrayLike,
        u: ArrayLike,
        dt: float,
        control_cov: ArrayLike,
        rng: np.random.Generator,
    ) -> Array: ...


class _Odometer(Protocol):
    def measure(self, before: ArrayLike, after: ArrayLike, rng: np.random.Generator) -> Array: ...


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

    Raises
    ------
    ValueError
        If a parameter lies outside its range.
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
            Arc length at which they were (m); they are not looked for beyond it.

        Returns
        -------
        u : ndarray, shape (..., 2), or (..., 3) for a mecanum robot
        s : ndarray, shape (...)
            Arc length of the nearest point now: never more than before.

        Raises
        ------
        ValueError
            If a shape is wrong, a number is not finite, or `s` lies outside the path.
        """
        pose = as_array("pose", pose, ("...", 3))
        s, ahead = _look_ahead(path, pose, s, self.lookahead)
        distance, alpha = _polar(pose, ahead, self.backwards)
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

    Raises
    ------
    ValueError
        If a parameter lies outside its range.
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
        pose = as_array("pose", pose, ("...", 3))
        s, ahead = _look_ahead(path, pose, s, self.lookahead)
        distance, alpha = _polar(pose, ahead, self.backwards)
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
    path: PathMemory, pose: Array, s: ArrayLike, lookahead: float
) -> tuple[Array, Array]:
    """2.1: nearest point, looked for between s and a little nearer to the start; 2.2: P_f."""
    s = np.minimum(as_array("s", s), path.length)
    near, _ = path.nearest(pose[..., :2], np.maximum(s - 2.0 * lookahead, 0.0), s)
    return near, path.point_at(np.maximum(near - lookahead, 0.0))


def _polar(pose: Array, target: Array, backwards: bool) -> tuple[Array, Array]:
    """Distance of the target, and its direction seen from the front, or from the tail."""
    delta = target - pose[..., :2]
    heading = pose[..., 2] + (np.pi if backwards else 0.0)
    return np.hypot(delta[..., 0], delta[..., 1]), wrap_angle(
        np.arctan2(delta[..., 1], delta[..., 0]) - heading
    )


@dataclass(frozen=True, eq=False)
class Return:
    """Drives home, T steps.

    Attributes
    ----------
    times : ndarray, shape (T,)
        Seconds.
    truth, estimates : ndarray, shape (T, ..., 3)
        Where the robots were and where they thought they were. Who has arrived stands still.
    s : ndarray, shape (T, ...)
        How far it still was along the path when the step was planned (m).
    controls : ndarray, shape (T - 1, ..., 2 or 3)
    arrived : ndarray of bool, shape (...)
        Who reached the start within the time.
    """

    times: Array
    truth: Array
    estimates: Array
    s: Array
    controls: Array
    arrived: np.ndarray


def return_to_start(
    path: PathMemory,
    pose: ArrayLike,
    law: Law,
    motion: _Motion,
    odometer: _Odometer,
    rng: np.random.Generator,
    *,
    estimate: ArrayLike | None = None,
    control_cov: ArrayLike | None = None,
    turn_first: bool = False,
    dt: float = 0.1,
    stop: float = 0.02,
    max_time: float = 300.0,
) -> Return:
    """Drive back along a remembered path by odometry alone, P3 steps 2.1 to 2.4.

    Parameters
    ----------
    path : PathMemory
        In the frame in which the robot believes to be.
    pose : array_like, shape (..., 3)
        True poses at the far end; a batch is a batch of runs with noise of their own.
    law : ReturnLaw or RegulatedPurePursuit
        Or anything with their `command`.
    motion : Unicycle, Mecanum
        Or anything with their `sample`; it must take the law's controls.
    odometer : VisualOdometer
        Or anything with its `measure`.
    rng : numpy.random.Generator
    estimate : array_like, shape (..., 3), optional
        Where the robots believe to be; the truth without it.
    control_cov : array_like, optional
        Covariance of what the wheels do beside the command; exact wheels without it.
    turn_first : bool, default False
        Turn on the spot until the front looks along the path before driving.
    dt : float, default 0.1
        Length of a step (s): the visual odometer's ten a second.
    stop : float, default 0.02
        Arc length (m) before the start at which the robot stops.
    max_time : float, default 300.0
        After this (s) a robot that is not home is lost.

    Returns
    -------
    Return

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite or out of range, or nothing is stored.
    """
    rng = as_rng("rng", rng)
    dt = as_scalar("dt", dt, low=1e-6, high=1e6)
    stop = as_scalar("stop", stop, low=1e-6, high=1e6)
    steps = int(np.ceil(as_scalar("max_time", max_time, low=dt, high=1e9) / dt))
    truth = as_array("pose", pose, ("...", 3)).copy()
    believed = truth if estimate is None else as_array("estimate", estimate, ("...", 3))
    believed = np.broadcast_to(believed, truth.shape).copy()
    s = np.full(truth.shape[:-1], path.length)
    u, _ = law.command(path, believed, s)
    turning = np.full(truth.shape[:-1], bool(turn_first))
    slip = np.zeros((u.shape[-1],) * 2) if control_cov is None else control_cov
    slip = as_covariance("control_cov", slip, u.shape[-1])
    track: list[tuple[Array, Array, Array]] = [(truth, believed, s)]
    controls: list[Array] = []
    for _ in range(steps):
        u, s = law.command(path, believed, s)
        if turning.any():
            u, turning = _turn(path, believed, s, u, turning, law, dt)
        # 2.4: home is where no path is left.
        home = s <= stop
        if home.all():
            break
        u = np.where(home[..., None], 0.0, u)
        after = motion.sample(truth, u, dt, slip, rng)
        measured = odometer.measure(truth, after, rng)
        still = home[..., None]
        truth = np.where(still, truth, after)
        believed = np.where(still, believed, compose(believed, measured))
        track.append((truth, believed, s))
        controls.append(u)
    truths, estimates, ss = (np.array(column) for column in zip(*track, strict=True))
    driven = np.stack(controls) if controls else np.zeros((0, *u.shape))
    times: Array = np.arange(len(track), dtype=np.float64) * dt
    return Return(times, truths, estimates, ss, driven, s <= stop)


def _turn(
    path: PathMemory, pose: Array, s: Array, u: Array, turning: np.ndarray, law: Law, dt: float
) -> tuple[Array, np.ndarray]:
    """Turn on the spot, until the front looks along the path, in place of the law's control."""
    rate = float(getattr(law, "max_turn_rate", 1.0))
    tangent = -path.tangent_at(s)
    off = wrap_angle(np.arctan2(tangent[..., 1], tangent[..., 0]) - pose[..., 2])
    turning = turning & (np.abs(off) > 0.05)
    spot = np.zeros_like(u)
    spot[..., -1] = np.clip(off / dt, -rate, rate)
    return np.where(turning[..., None], spot, u), turning
