"""One particle of FastSLAM as an association sees it: a pose and a map of its own.

Has the attributes of EKF-SLAM that an association asks for. Used by FastSLAM (chapters 11, 12).
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array

__all__ = ["IGNORED", "NEW", "ParticleView", "check_rows"]

# Answers of an association beside a row of the map: start a landmark, or leave out.
NEW, IGNORED = -1, -2


@dataclass(frozen=True, eq=False)
class ParticleView:
    """One particle: a pose, and a map of independent landmarks.

    It has what an association asks of EKF-SLAM. The pose is known exactly, `pose_cov` is 0, except
    when version 2 asks `associate`: then it is the predicted pose with its covariance.

    Attributes
    ----------
    number : int
        Row of the particle.
    pose : ndarray, shape (3,)
    pose_cov : ndarray, shape (3, 3)
    landmarks : ndarray, shape (n, 2)
    landmark_covs : ndarray, shape (n, 2, 2)
    existence : ndarray, shape (n,)
        Probability that the landmark exists; 0.5 in a filter without `detection`.
    ids : tuple
        Names (known association).
    """

    number: int
    pose: Array
    pose_cov: Array
    landmarks: Array
    landmark_covs: Array
    existence: Array
    ids: tuple[Hashable, ...]
    sensor: Any
    motion: Any

    @property
    def n_landmarks(self) -> int:
        """Number of landmarks n."""
        return len(self.landmarks)

    @property
    def mean(self) -> Array:
        """Pose and landmarks, shape (3 + 2 n,)."""
        return np.concatenate([self.pose, self.landmarks.ravel()])

    def innovation_covs(self, rows: ArrayLike) -> Array:
        """Innovation covariance of each of these landmarks, (m, 2, 2), R included."""
        rows = np.asarray(rows, dtype=np.intp)
        H_pose, H = self.sensor.jacobians(self.pose, self.landmarks[rows])
        robot = H_pose @ self.pose_cov @ np.swapaxes(H_pose, -1, -2)
        return robot + H @ self.landmark_covs[rows] @ np.swapaxes(H, -1, -2) + self.sensor.cov

    def innovation_cov(self, rows: ArrayLike) -> Array:
        """Joint innovation covariance of these landmarks, (2 m, 2 m), R included.

        Block diagonal if the pose is known: given the path, landmarks are independent.
        """
        rows = np.asarray(rows, dtype=np.intp)
        H_pose, H = self.sensor.jacobians(self.pose, self.landmarks[rows])
        tall = H_pose.reshape(-1, 3)
        joint = tall @ self.pose_cov @ tall.T
        own = H @ self.landmark_covs[rows] @ np.swapaxes(H, -1, -2) + self.sensor.cov
        for j, block in enumerate(own):
            part = slice(2 * j, 2 * j + 2)
            joint[part, part] += block
        return joint


def check_rows(rows: Array, k: int, n: int) -> None:
    """Refuse an answer of `associate` that is no row of the map for every measurement."""
    if rows.shape != (k,) or not np.issubdtype(rows.dtype, np.integer):
        raise ValueError(f"associate: expected {k} rows as whole numbers, got {rows!r}")
    if ((rows < IGNORED) | (rows >= n)).any():
        raise ValueError(f"associate: expected rows from -2 to {n - 1}, got {rows.tolist()}")
    named = rows[rows >= 0]
    if len(np.unique(named)) < len(named):
        raise ValueError(f"associate: expected each landmark once, got {rows.tolist()}")
