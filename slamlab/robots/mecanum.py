"""A platform on four mecanum wheels: wheel map, slip residual, and three ways to integrate.

P1 formulas (9), (10) and (15)-(17) with the missing wheel map (9a); (17) with its factor dt.
Chapter 05; the robot of EKF-SLAM in chapter 09.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_choice, as_positive
from slamlab.geometry import wrap_angle
from slamlab.models import MotionModel
from slamlab.robots.unicycle import _checked, _pose, _sinc, _sinc_slope

__all__ = ["YOUBOT", "Mecanum"]


@dataclass(frozen=True)
class Mecanum(MotionModel):
    """Four wheels with rollers at 45 degrees; seen from above, the rollers make an X.

    Wheels are numbered front-left, front-right, rear-left, rear-right. The control is the body
    velocity u = (v_x forward, v_y left, omega), P1 (9), constant over a step. Of the two half
    lengths only their sum enters the wheel map.

    Parameters
    ----------
    wheel_radius : float
        r (m), positive.
    half_length : float
        l_x (m): half the distance between front and rear axle, positive.
    half_width : float
        l_y (m): half the distance between left and right wheels, positive.
    integration : {"exact", "euler", "midpoint"}, default "exact"
        How a step turns velocity into a pose. "exact": the arc that a constant u drives.
        "euler": P1 (10), the heading of the step's start. "midpoint": the heading of its middle.

    Attributes
    ----------
    wheel_map : ndarray, shape (4, 3)
        Wheel speeds (rad/s) of a body velocity, (9a) inverted.
    body_map : ndarray, shape (3, 4)
        Its pseudo-inverse, (9a): body velocity of wheel speeds.

    Examples
    --------
    A youBot that moves left turns its wheels in the pattern (-, +, +, -):

    >>> YOUBOT.wheel_speeds([0, 0.475, 0]).round(6).tolist()
    [-10.0, 10.0, 10.0, -10.0]
    >>> YOUBOT.body_velocity([-10, 10, 10, -10]).round(6).tolist()
    [0.0, 0.475, 0.0]
    """

    wheel_radius: float
    half_length: float
    half_width: float
    integration: str = "exact"
    wheel_map: Array = field(init=False, repr=False, compare=False)
    body_map: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the parameters and set both maps."""
        r = as_positive("wheel_radius", self.wheel_radius, 1e300)
        lever = as_positive("half_length", self.half_length, 1e300)
        lever += as_positive("half_width", self.half_width, 1e300)
        as_choice("integration", self.integration, ("exact", "euler", "midpoint"))
        # (9a): forward, left and turn, wheel by wheel. Its columns are orthogonal.
        pattern = np.array([[1, -1, -1], [1, 1, 1], [1, 1, -1], [1, -1, 1]], dtype=float)
        wheel_map = pattern * [1, 1, lever] / r
        body_map = (pattern / [1, 1, lever]).T * (r / 4)
        for name, value in (("wheel_map", wheel_map), ("body_map", body_map)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def body_velocity(self, wheel_speeds: ArrayLike) -> Array:
        """Return the body velocity of given wheel speeds, (9a); least squares if they disagree.

        Parameters
        ----------
        wheel_speeds : array_like, shape (..., 4)
            Front-left, front-right, rear-left, rear-right (rad/s), forward positive.

        Returns
        -------
        ndarray, shape (..., 3)
            u = (v_x, v_y, omega) in the body frame (m/s, m/s, rad/s).
        """
        return as_array("wheel_speeds", wheel_speeds, ("...", 4)) @ self.body_map.T

    def wheel_speeds(self, u: ArrayLike) -> Array:
        """Return the wheel speeds that a body velocity demands, (9a) inverted.

        Parameters
        ----------
        u : array_like, shape (..., 3)
            Body velocity (m/s, m/s, rad/s).

        Returns
        -------
        ndarray, shape (..., 4)
            Wheel speeds (rad/s).
        """
        return as_array("u", u, ("...", 3)) @ self.wheel_map.T

    def slip(self, wheel_speeds: ArrayLike) -> Array:
        """Return what no rolling explains: wheel speeds minus their best fit by a body velocity.

        Four speeds have three causes, so one combination must vanish while nothing slips:
        front-left + front-right - rear-left - rear-right. A quarter of it, with signs
        (+, +, -, -), is the residual.

        Parameters
        ----------
        wheel_speeds : array_like, shape (..., 4)
            Measured speeds (rad/s).

        Returns
        -------
        ndarray, shape (..., 4)
            Residual (rad/s) of the least-squares fit; zero where the speeds agree.

        Examples
        --------
        >>> YOUBOT.slip([10, 10, 10, 14]).tolist()
        [-1.0, -1.0, 1.0, 1.0]
        """
        w = as_array("wheel_speeds", wheel_speeds, ("...", 4))
        signs = np.array([0.25, 0.25, -0.25, -0.25])
        return (w @ signs)[..., None] * (4 * signs)

    def control_cov(self, sigma_wheel: ArrayLike) -> Array:
        """Return the covariance V of u that noisy wheel speeds cause, P1 (15).

        Parameters
        ----------
        sigma_wheel : float or array_like, shape (4,) or (..., 4)
            Standard deviation of each wheel's speed (rad/s), not negative; wheels are independent.

        Returns
        -------
        ndarray, shape (3, 3) or (..., 3, 3)
            In (m/s)^2 and (rad/s)^2. Diagonal, as the paper has it, if the wheels are alike.

        Examples
        --------
        >>> np.sqrt(np.diag(YOUBOT.control_cov(0.4))).round(4).tolist()
        [0.0095, 0.0095, 0.0247]
        """
        sigma = as_array("sigma_wheel", sigma_wheel)
        if sigma.ndim == 0:
            sigma = np.full(4, sigma)
        sigma = as_array("sigma_wheel", sigma, ("...", 4))
        if (sigma < 0).any():
            raise ValueError(f"sigma_wheel: expected no negative number, got {sigma.min():g}")
        # (15): V = M diag(sigma^2) M^T, entry by entry: a matrix product leaves 1e-22 off the
        # diagonal on some processors, and two equal eigenvalues let that turn every draw.
        root = self.body_map * sigma[..., None, :]
        return (root[..., :, None, :] * root[..., None, :, :]).sum(-1)

    def step(self, pose: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Return the pose after moving with u for a time dt, f of P1 (10).

        Parameters
        ----------
        pose : array_like, shape (..., 3)
            Pose in the world (m, m, rad).
        u : array_like, shape (..., 3)
            Body velocity (m/s, m/s, rad/s); leading axes broadcast with `pose`.
        dt : float
            Duration (s), not negative.

        Returns
        -------
        ndarray, shape (..., 3)
            Heading in (-pi, pi].

        Examples
        --------
        A quarter turn while strafing left at 1 m/s:

        >>> YOUBOT.step([0, 0, 0], [0, np.pi / 2, np.pi / 2], 1.0).round(3).tolist()
        [-1.0, 1.0, 1.571]
        """
        pose, u, dt = _checked(pose, u, dt, 3)
        move_x, move_y = self._displacement(pose, u, dt)[:2]
        heading = wrap_angle(pose[..., 2] + dt * u[..., 2])
        return _pose(pose[..., 0] + move_x, pose[..., 1] + move_y, heading)

    def jacobians(self, pose: ArrayLike, u: ArrayLike, dt: float) -> tuple[Array, Array]:
        """Return the derivatives of `step` by pose, P1 (16), and control, (17) with its dt.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
        u : array_like, shape (..., 3)
        dt : float

        Returns
        -------
        F_x : ndarray, shape (..., 3, 3)
        F_u : ndarray, shape (..., 3, 3)
        """
        pose, u, dt = _checked(pose, u, dt, 3)
        move_x, move_y, c, s = self._displacement(pose, u, dt)
        F_x = np.zeros((*move_x.shape, 3, 3))
        F_x[...] = np.eye(3)
        # (16): the displacement turns with the heading.
        F_x[..., 0, 2], F_x[..., 1, 2] = -move_y, move_x
        F_u = np.zeros_like(F_x)
        # (17): a velocity acts for the time dt.
        F_u[..., 0, 0], F_u[..., 0, 1] = c, -s
        F_u[..., 1, 0], F_u[..., 1, 1] = s, c
        F_u[..., 2, 2] = dt
        if self.integration != "euler":
            # omega turns the displacement by half the heading's turn ...
            F_u[..., 0, 2], F_u[..., 1, 2] = -0.5 * dt * move_y, 0.5 * dt * move_x
        if self.integration == "exact":
            # ... and bends it, which shortens the chord.
            h = 0.5 * dt * u[..., 2]
            shorter = 0.5 * dt * dt * _sinc_slope(h)
            half_way = pose[..., 2] + h
            bend_x, bend_y = _rotated(np.cos(half_way), np.sin(half_way), u)
            F_u[..., 0, 2] += shorter * bend_x
            F_u[..., 1, 2] += shorter * bend_y
        return F_x, F_u

    def _displacement(self, pose: Array, u: Array, dt: float) -> tuple[Array, Array, Array, Array]:
        """Displacement in the world, and dt times the mean cosine and sine over the step."""
        omega = u[..., 2]
        h = np.zeros_like(omega) if self.integration == "euler" else 0.5 * dt * omega
        # The mean of a unit vector that turns by 2h: it points half way and has length sin(h)/h.
        mean = dt * _sinc(h) if self.integration == "exact" else dt
        half_way = pose[..., 2] + h
        c, s = np.cos(half_way), np.sin(half_way)
        move_x, move_y = _rotated(c, s, u)
        return mean * move_x, mean * move_y, mean * c, mean * s


def _rotated(c: Array, s: Array, u: Array) -> tuple[Array, Array]:
    """Velocity in the world, x and y, of the body velocity u at a heading of cosine c, sine s."""
    return c * u[..., 0] - s * u[..., 1], s * u[..., 0] + c * u[..., 1]


#: KUKA youBot: wheel radius 47.5 mm, wheels 0.47 m apart front to rear, 0.30 m left to right.
YOUBOT = Mecanum(wheel_radius=0.0475, half_length=0.235, half_width=0.15)
