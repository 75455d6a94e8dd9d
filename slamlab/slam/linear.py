"""The linear case of P2: a robot with a perfect compass that measures displacements.

Here EKF-SLAM is the exact Kalman filter, the theorems of P2's section on convergence hold to the
last digit, and each axis is a one-dimensional SLAM problem by itself. Chapter 10.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_positive, as_scalar
from slamlab.models import LandmarkSensor, MotionModel

__all__ = ["CompassMotion", "Displacement"]


@dataclass(frozen=True)
class CompassMotion(MotionModel):
    """Motion along the axes of the world: u = (v_x, v_y) in the world, the heading never changes.

    Examples
    --------
    >>> CompassMotion().step([1.0, 2.0, 0.5], [1.0, 0.0], 0.5).tolist()
    [1.5, 2.0, 0.5]
    """

    def step(self, pose: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Return the pose (..., 3) after moving with u (..., 2) in m/s for dt seconds."""
        pose, u, dt = _checked(pose, u, dt)
        moved = pose + np.zeros((*u.shape[:-1], 1))
        moved[..., :2] += dt * u
        return moved

    def jacobians(self, pose: ArrayLike, u: ArrayLike, dt: float) -> tuple[Array, Array]:
        """Return F_x = I (..., 3, 3) and F_u (..., 3, 2): constants, whatever the pose."""
        pose, u, dt = _checked(pose, u, dt)
        lead = np.broadcast_shapes(pose.shape[:-1], u.shape[:-1])
        F_x, F_u = np.zeros((*lead, 3, 3)), np.zeros((*lead, 3, 2))
        F_x[...] = np.eye(3)
        F_u[..., 0, 0] = F_u[..., 1, 1] = dt
        return F_x, F_u


@dataclass(frozen=True)
class Displacement(LandmarkSensor):
    """A sensor that measures where a point is from the robot, along the axes of the world.

    Parameters
    ----------
    sigma : float
        Standard deviation of each of the two numbers (m), positive.

    Examples
    --------
    >>> Displacement(0.1).observe([1.0, 2.0, 0.5], [4.0, 6.0]).tolist()
    [3.0, 4.0]
    """

    sigma: float

    def __post_init__(self) -> None:
        """Check `sigma`."""
        as_positive("sigma", self.sigma, 1e150)

    @property
    def cov(self) -> Array:
        """R = sigma^2 I, shape (2, 2)."""
        return float(self.sigma) ** 2 * np.eye(2)

    def observe(self, pose: ArrayLike, landmark: ArrayLike) -> Array:
        """Return landmark - position, (..., 2) in metres."""
        pose, landmark = _pair(pose, "landmark", landmark)
        return landmark - pose[..., :2]

    def jacobians(self, pose: ArrayLike, landmark: ArrayLike) -> tuple[Array, Array]:
        """Return H_pose (..., 2, 3) and H_landmark (..., 2, 2): constants."""
        return _constants(*_pair(pose, "landmark", landmark), sign=-1.0)

    def locate(self, pose: ArrayLike, z: ArrayLike) -> Array:
        """Return position + z, (..., 2) in metres."""
        pose, z = _pair(pose, "z", z)
        return z + pose[..., :2]

    def locate_jacobians(self, pose: ArrayLike, z: ArrayLike) -> tuple[Array, Array]:
        """Return G_pose (..., 2, 3) and G_z (..., 2, 2): constants."""
        return _constants(*_pair(pose, "z", z), sign=1.0)

    def reach(self, z: ArrayLike) -> Array:
        """Length (...) of displacements (..., 2)."""
        return np.asarray(np.linalg.norm(as_array("z", z, ("...", 2)), axis=-1))


def _checked(pose: ArrayLike, u: ArrayLike, dt: float) -> tuple[Array, Array, float]:
    pose, u = as_array("pose", pose, ("...", 3)), as_array("u", u, ("...", 2))
    return pose, u, as_scalar("dt", dt, low=0.0, high=1e300)


def _pair(pose: ArrayLike, name: str, two: ArrayLike) -> tuple[Array, Array]:
    return as_array("pose", pose, ("...", 3)), as_array(name, two, ("...", 2))


def _constants(pose: Array, two: Array, sign: float) -> tuple[Array, Array]:
    """Return the derivatives by pose, sign (I, 0), and by the two numbers, I."""
    lead = np.broadcast_shapes(pose.shape[:-1], two.shape[:-1])
    by_pose, by_two = np.zeros((*lead, 2, 3)), np.zeros((*lead, 2, 2))
    by_pose[..., :2], by_two[...] = sign * np.eye(2), np.eye(2)
    return by_pose, by_two
