"""A robot of which only its measured motion is known: odometry increments, scan to scan.

What real logs carry (Killian Court, CARMEN, Victoria Park). Chapters 00, 13, 14.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array
from slamlab.geometry import compose, rotation
from slamlab.models import MotionModel
from slamlab.robots.unicycle import _checked

__all__ = ["RelativePose"]


@dataclass(frozen=True)
class RelativePose(MotionModel):
    """Motion model whose control is the motion itself, seen from the pose before it.

    u = (dx forward, dy left, dtheta) in (m, m, rad), the same for every robot; `dt` plays no
    part. Its covariance is that of the measured motion.

    Examples
    --------
    >>> RelativePose().step([2, 0, np.pi / 2], [1, 0, 0], dt=0.1).round(3).tolist()
    [2.0, 1.0, 1.571]
    """

    controls: ClassVar[str] = "displacement"

    def step(self, pose: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Return the pose after the motion: x (+) u.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
            Pose in the world (m, m, rad).
        u : array_like, shape (..., 3)
            Motion in the frame of `pose` (m, m, rad); leading axes broadcast.
        dt : float
            Not used, but checked as other robots check it: not negative.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        pose, u, _ = _checked(pose, u, dt, 3)
        return compose(pose, u)

    def jacobians(self, pose: ArrayLike, u: ArrayLike, dt: float) -> tuple[Array, Array]:
        """Return the derivatives of `step` by pose and motion, both of shape (..., 3, 3)."""
        pose, u, _ = _checked(pose, u, dt, 3)
        theta, dx, dy = pose[..., 2], u[..., 0], u[..., 1]
        c, s = np.cos(theta), np.sin(theta)
        ahead, left = c * dx - s * dy, s * dx + c * dy
        F_x, F_u = np.zeros((2, *ahead.shape, 3, 3))
        F_x[...] = np.eye(3)
        F_x[..., 0, 2], F_x[..., 1, 2] = -left, ahead
        F_u[..., :2, :2], F_u[..., 2, 2] = rotation(theta), 1.0
        return F_x, F_u
