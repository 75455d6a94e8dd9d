"""A robot that drives forward and turns: the velocity model with exact arcs.

The motion model f of P5 (10) and (14) and of P2 (6) in chapters 01 to 04 and 12.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.models import MotionModel

__all__ = ["Unicycle"]


def _sinc(h: Array) -> Array:
    """Return sin(h) / h, 1 at 0."""
    return np.sinc(h / np.pi)


def _pose(x: Array, y: Array, heading: Array) -> Array:
    """Poses (..., 3) of their coordinates (...)."""
    pose = np.empty((*heading.shape, 3))
    pose[..., 0], pose[..., 1], pose[..., 2] = x, y, heading
    return pose


def _sinc_slope(h: Array) -> Array:
    """Return the derivative of sin(h) / h; a series where the closed form would cancel."""
    small = np.abs(h) < 1e-2
    safe = np.where(small, 1.0, h)
    series = h * (-1 / 3 + h * h * (1 / 30 - h * h / 840))
    return np.where(small, series, (np.cos(safe) - np.sin(safe) / safe) / safe)


@dataclass(frozen=True)
class Unicycle(MotionModel):
    """Unicycle or differential-drive robot with control u = (v, omega), constant over a step.

    v is the forward speed (m/s), omega the turn rate (rad/s). The path of a step is an arc (a
    straight line if omega is 0) and is integrated exactly: the chord has length
    v dt sin(h)/h and direction theta + h, with h = omega dt / 2.

    Examples
    --------
    A quarter circle of radius 1 m:

    >>> Unicycle().step([0, 0, 0], [np.pi / 2, np.pi / 2], 1.0).round(3).tolist()
    [1.0, 1.0, 1.571]
    """

    def step(self, pose: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Return the pose after driving with u for a time dt.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
            Pose in the world (m, m, rad).
        u : array_like, shape (..., 2)
            Forward speed (m/s) and turn rate (rad/s); leading axes broadcast with `pose`.
        dt : float
            Duration (s), not negative.

        Returns
        -------
        ndarray, shape (..., 3)
            Heading in (-pi, pi].
        """
        pose, u, dt = _checked(pose, u, dt)
        half_turn = 0.5 * dt * u[..., 1]
        chord = dt * u[..., 0] * _sinc(half_turn)
        direction = pose[..., 2] + half_turn
        x = pose[..., 0] + chord * np.cos(direction)
        y = pose[..., 1] + chord * np.sin(direction)
        return _pose(x, y, wrap_angle(direction + half_turn))

    def jacobians(self, pose: ArrayLike, u: ArrayLike, dt: float) -> tuple[Array, Array]:
        """Return the derivatives of `step` by pose and control.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
        u : array_like, shape (..., 2)
        dt : float

        Returns
        -------
        F_x : ndarray, shape (..., 3, 3)
        F_u : ndarray, shape (..., 3, 2)
        """
        pose, u, dt = _checked(pose, u, dt)
        theta, v, omega = np.broadcast_arrays(pose[..., 2], u[..., 0], u[..., 1])
        h = 0.5 * dt * omega
        c, s = np.cos(theta + h), np.sin(theta + h)
        sinc = _sinc(h)
        chord = dt * v * sinc
        F_x = np.zeros((*theta.shape, 3, 3))
        F_x[...] = np.eye(3)
        F_x[..., 0, 2], F_x[..., 1, 2] = -chord * s, chord * c
        F_u = np.zeros((*theta.shape, 3, 2))
        F_u[..., 0, 0], F_u[..., 1, 0] = dt * sinc * c, dt * sinc * s
        # omega bends the chord (its length changes) and turns it (by half the heading's turn).
        bend, half = 0.5 * dt * dt * v * _sinc_slope(h), 0.5 * dt * chord
        F_u[..., 0, 1], F_u[..., 1, 1] = bend * c - half * s, bend * s + half * c
        F_u[..., 2, 1] = dt
        return F_x, F_u


def _checked(pose: ArrayLike, u: ArrayLike, dt: float, p: int = 2) -> tuple[Array, Array, float]:
    pose, u = as_array("pose", pose, ("...", 3)), as_array("u", u, ("...", p))
    return pose, u, as_scalar("dt", dt, low=0.0, high=1e300)
