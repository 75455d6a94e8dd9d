"""Wheel encoders that slip and round, and dead reckoning with the covariance it deserves.

The control u of P1 (9) is measured, not known: this file makes it from wheels, and carries the
noise through P1 (11), (14). Chapter 05.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import (
    Array,
    as_array,
    as_count,
    as_covariance,
    as_positive,
    as_rng,
    as_scalar,
)
from slamlab.models import MotionModel, as_motion

__all__ = ["Encoders", "dead_reckoning", "dead_reckoning_cov", "moved"]


@dataclass(frozen=True)
class Encoders:
    """Counters of whole ticks on every wheel; the wheels slip at random.

    While a wheel rolls an angle a over the floor, it turns by a + e with a random e of standard
    deviation ``sigma_slip * sqrt(a)``: slip adds up like a random walk along the way, however
    finely time is cut. Its counter shows the whole ticks of the turned angle.

    Parameters
    ----------
    ticks_per_turn : int
        Ticks in one turn of the wheel, at least 1.
    sigma_slip : float, default 0.0
        Standard deviation of slip (rad) after rolling one radian, in rad^(1/2); not negative.

    Attributes
    ----------
    tick : float
        Angle of a tick (rad).

    Examples
    --------
    >>> encoders = Encoders(360)
    >>> ticks = encoders.read(np.full((3, 4), 0.06), 1.0, np.random.default_rng(1))
    >>> ticks[:, 0].tolist()
    [3, 3, 4]
    """

    ticks_per_turn: int
    sigma_slip: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        as_count("ticks_per_turn", self.ticks_per_turn, low=1)
        as_scalar("sigma_slip", self.sigma_slip, low=0.0, high=1e300)

    @property
    def tick(self) -> float:
        """Angle of one tick (rad)."""
        return 2 * np.pi / self.ticks_per_turn

    def spin(self, wheel_speeds: ArrayLike, dt: float, rng: np.random.Generator) -> Array:
        """Return the angles that wheels turn in a time dt, slip included.

        Parameters
        ----------
        wheel_speeds : array_like, shape (..., 4)
            Speeds (rad/s) at which the wheels would roll without slip.
        dt : float
            Duration (s), not negative.
        rng : numpy.random.Generator

        Returns
        -------
        ndarray, shape (..., 4)
            Angles (rad).
        """
        speeds = as_array("wheel_speeds", wheel_speeds, ("...", 4))
        dt, rng = as_scalar("dt", dt, low=0.0, high=1e300), as_rng("rng", rng)
        rolled = speeds * dt
        slipped = self.sigma_slip * np.sqrt(np.abs(rolled)) * rng.standard_normal(rolled.shape)
        return rolled + slipped

    def ticks(self, angles: ArrayLike) -> NDArray[np.int64]:
        """Return the counters' readings at wheel angles (..., 4) in rad: whole ticks, downwards.

        A step-by-step simulation keeps the angles, adds `spin` to them and takes the difference
        of two readings; so the remainder of a tick is never lost.
        """
        angles = as_array("angles", angles, ("...", 4))
        # The 1e-9 keeps an angle that is a whole number of ticks from falling below it.
        return np.floor(angles / self.tick + 1e-9).astype(np.int64)

    def read(
        self, wheel_speeds: ArrayLike, dt: float, rng: np.random.Generator
    ) -> NDArray[np.int64]:
        """Return the ticks counted in each interval of a drive.

        Parameters
        ----------
        wheel_speeds : array_like, shape (..., T, 4)
            Speeds (rad/s) at which the wheels would roll without slip, interval by interval.
        dt : float
            Length of an interval (s), not negative.
        rng : numpy.random.Generator

        Returns
        -------
        ndarray of int, shape (..., T, 4)
        """
        speeds = as_array("wheel_speeds", wheel_speeds, ("...", "T", 4))
        counts = self.ticks(np.cumsum(self.spin(speeds, dt, rng), axis=-2))
        return np.diff(counts, axis=-2, prepend=0)

    def speeds(self, ticks: ArrayLike, dt: float) -> Array:
        """Return mean wheel speeds (rad/s), shape (..., 4), of ticks counted in a time dt > 0."""
        ticks = as_array("ticks", ticks, ("...", 4))
        return ticks * (self.tick / as_positive("dt", dt, 1e300))

    def sigma_wheel(self, wheel_speeds: ArrayLike, dt: float) -> Array:
        """Return the standard deviation of measured wheel speeds that slip causes.

        The remainder of a tick is left out on purpose: what one interval loses the next one
        finds, so a wheel's angle is never off by more than a tick while slip adds up. As
        independent noise of each interval the heading error would grow without a bound.

        Parameters
        ----------
        wheel_speeds : array_like, shape (..., 4)
            Speeds (rad/s), true or measured.
        dt : float
            Length of an interval (s), positive.

        Returns
        -------
        ndarray, shape (..., 4)
            Standard deviations (rad/s), what `Mecanum.control_cov` takes.
        """
        speeds = as_array("wheel_speeds", wheel_speeds, ("...", 4))
        dt = as_positive("dt", dt, 1e300)
        return self.sigma_slip * np.sqrt(np.abs(speeds) / dt)


def moved(
    motion: MotionModel,
    pose: ArrayLike,
    u: ArrayLike,
    dt: float,
    control_cov: ArrayLike,
    *covs: Array,
) -> tuple[Array, ...]:
    """Return the pose after one step, and covariances moved with it: P1 (8), (11), (14).

    Parameters
    ----------
    motion : MotionModel
    pose : array_like, shape (..., 3)
        Before the step (m, m, rad).
    u : array_like, shape (..., p)
        Control.
    dt : float
        Duration (s).
    control_cov : array_like, shape (p, p)
        V of P1 (15).
    *covs : ndarray, shape (..., 3, 3)
        Covariances of the pose, or of what it has moved since some moment.

    Returns
    -------
    tuple of ndarray
        The pose, then each covariance, new arrays.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> pose, cov = moved(Unicycle(), [0, 0, 0], [1.0, 0.0], 1.0, np.eye(2), np.zeros((3, 3)))
    >>> pose.tolist()
    [1.0, 0.0, 0.0]
    """
    u = as_array("u", u, ("...", "p"))
    V = as_covariance("control_cov", control_cov, u.shape[-1])
    covs = tuple(as_array("covs", P, ("...", 3, 3)) for P in covs)
    F_x, F_u = as_motion("motion", motion).jacobians(pose, u, dt)
    Q = F_u @ V @ np.swapaxes(F_u, -1, -2)
    after = (F_x @ P @ np.swapaxes(F_x, -1, -2) + Q for P in covs)
    return motion.step(pose, u, dt), *after


def dead_reckoning(motion: MotionModel, pose: ArrayLike, controls: ArrayLike, dt: float) -> Array:
    """Return the poses of a drive, adding up one control after another; P1 (10) repeated.

    Parameters
    ----------
    motion : MotionModel
        A robot with `step`.
    pose : array_like, shape (..., 3)
        Where the drive begins (m, m, rad).
    controls : array_like, shape (..., T, m)
        Controls of T intervals; leading axes are drives and broadcast with `pose`.
    dt : float
        Length of an interval (s), not negative.

    Returns
    -------
    ndarray, shape (..., T + 1, 3)
        Poses, the first one is `pose`.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> dead_reckoning(Unicycle(), [0, 0, 0], [[1.0, 0.0], [1.0, 0.0]], 0.5)[:, 0].tolist()
    [0.0, 0.5, 1.0]
    """
    motion, pose = as_motion("motion", motion), as_array("pose", pose, ("...", 3))
    controls = as_array("controls", controls, ("...", "T", "m"))
    lead = np.broadcast_shapes(pose.shape[:-1], controls.shape[:-2])
    poses = np.empty((*lead, controls.shape[-2] + 1, 3))
    poses[..., 0, :] = pose
    for k in range(controls.shape[-2]):
        poses[..., k + 1, :] = motion.step(poses[..., k, :], controls[..., k, :], dt)
    return poses


def dead_reckoning_cov(
    motion: MotionModel,
    poses: ArrayLike,
    controls: ArrayLike,
    dt: float,
    control_cov: ArrayLike,
    cov: ArrayLike | None = None,
) -> Array:
    """Return the covariances of dead-reckoned poses, P1 (11) and (14) repeated.

    Parameters
    ----------
    motion : MotionModel
        A robot with `jacobians`.
    poses : array_like, shape (..., T + 1, 3)
        What `dead_reckoning` returned.
    controls : array_like, shape (..., T, m)
        The controls it was given.
    dt : float
        Length of an interval (s).
    control_cov : array_like, shape (m, m) or (..., T, m, m)
        V of P1 (15), independent from interval to interval.
    cov : array_like, shape (3, 3), optional
        Covariance of the first pose; zero if left out.

    Returns
    -------
    ndarray, shape (..., T + 1, 3, 3)

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> u = [[1.0, 0.0]] * 3
    >>> poses = dead_reckoning(Unicycle(), [0, 0, 0], u, 1.0)
    >>> covs = dead_reckoning_cov(Unicycle(), poses, u, 1.0, np.diag([0.01, 0.04]))
    >>> covs[:, 1, 1].round(3).tolist()  # across the path it grows with the cube of the time
    [0.0, 0.01, 0.1, 0.35]
    """
    controls = as_array("controls", controls, ("...", "T", "m"))
    steps, m = controls.shape[-2:]
    poses = as_array("poses", poses, ("...", steps + 1, 3))
    V = as_covariance("control_cov", control_cov, m)
    F_x, F_u = as_motion("motion", motion).jacobians(poses[..., :-1, :], controls, dt)
    # (14): Q = F_u V F_u^T for all intervals at once.
    Q = F_u @ V @ np.swapaxes(F_u, -1, -2)
    covs = np.zeros((*poses.shape, 3))
    if cov is not None:
        covs[..., 0, :, :] = as_covariance("cov", cov, 3)
    for k in range(steps):
        # (11): P = F_x P F_x^T + Q.
        F = F_x[..., k, :, :]
        P = F @ covs[..., k, :, :] @ np.swapaxes(F, -1, -2) + Q[..., k, :, :]
        covs[..., k + 1, :, :] = 0.5 * (P + np.swapaxes(P, -1, -2))
    return covs
