"""Dead reckoning: believe the wheels, look at nothing: what all others are compared with."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_covariance
from slamlab.models import MotionModel, as_motion
from slamlab.robots.encoders import moved

__all__ = ["DeadReckoning"]


class DeadReckoning:
    """An estimator that only predicts, P1 (8), (11) and (14) without a map.

    Parameters
    ----------
    motion : MotionModel
    pose : array_like, shape (3,) or (M, 3)
        Where the robot starts (m, m, rad), or M robots side by side.
    cov : array_like, shape (3, 3), optional
        Covariance of `pose`; zero if left out.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> system = DeadReckoning(Unicycle(), [0, 0, 0])
    >>> system.predict([1.0, 0.0], 2.0, np.diag([0.01, 0.01]))
    >>> system.pose.tolist(), system.pose_cov.diagonal().round(2).tolist()
    ([2.0, 0.0, 0.0], [0.04, 0.04, 0.04])
    """

    measures = "odometry"

    def __init__(self, motion: MotionModel, pose: ArrayLike, cov: ArrayLike | None = None) -> None:
        self.motion = as_motion("motion", motion)
        self._pose = as_array("pose", pose, ("...", 3)).copy()
        P = np.zeros((3, 3)) if cov is None else as_covariance("cov", cov, 3)
        self._P = np.broadcast_to(P, (*self._pose.shape[:-1], 3, 3)).copy()

    @property
    def pose(self) -> Array:
        """Estimated pose (m, m, rad), shape (3,) or (M, 3)."""
        return self._pose.copy()

    @property
    def pose_cov(self) -> Array:
        """Covariance of the pose, shape (3, 3) or (M, 3, 3)."""
        return self._P.copy()

    def __repr__(self) -> str:
        """Name the motion model and the place."""
        return f"DeadReckoning({self.motion!r}, at {self._pose.round(2).tolist()!s:.60})"

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move by control u (p,) during dt (s), executed with covariance (p, p)."""
        self._pose, self._P = moved(self.motion, self._pose, u, dt, control_cov, self._P)

    def update(self, measurement: Any, ids: Any = None) -> None:
        """Look at nothing."""
