"""One particle of FastSLAM as an association sees it: a pose and a map of its own.

Has the attributes of EKF-SLAM that an association asks for. Used by FastSLAM (chapters 11, 12).
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit

from slamlab._checks import Array
from slamlab.gaussian import block_diagonal
from slamlab.models import LandmarkSensor
from slamlab.slam._landmark_maps import LandmarkMaps, moments

__all__ = ["ParticleView"]


@dataclass(frozen=True, eq=False)
class ParticleView:
    """One particle: a pose, and a map of independent landmarks.

    It has what an association asks of EKF-SLAM. The pose is known exactly, `pose_cov` is 0, except
    when version 2 asks `associate`: then it is the predicted pose with its covariance.

    Attributes
    ----------
    number : int
        Row of the particle.
    landmarks : ndarray, shape (n, 2)
    landmark_covs : ndarray, shape (n, 2, 2)
    existence : ndarray, shape (n,)
        Probability that the landmark exists; 0.5 in a filter without `detection_probabilities`.
    pose : ndarray, shape (3,)
    pose_cov : ndarray, shape (3, 3)
    sensor : LandmarkSensor
    ids : tuple
        Names (known association).
    """

    number: int
    landmarks: Array
    landmark_covs: Array
    existence: Array
    pose: Array
    pose_cov: Array
    sensor: LandmarkSensor
    ids: tuple[Hashable, ...] = ()

    @classmethod
    def of(cls, i: int, maps: LandmarkMaps, *rest: Any) -> ParticleView:
        """Particle i of these maps; then pose, its covariance, sensor and perhaps names."""
        fields = maps.map_of(i)[maps.present(i)].T
        return cls(i, *moments(fields), expit(fields[5]), *rest)

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
        robot = H_pose @ self.pose_cov @ H_pose.mT
        return robot + H @ self.landmark_covs[rows] @ H.mT + self.sensor.cov

    def innovation_cov(self, rows: ArrayLike) -> Array:
        """Joint innovation covariance of these landmarks, (2 m, 2 m), R included.

        Block diagonal if the pose is known: given the path, landmarks are independent.
        """
        rows = np.asarray(rows, dtype=np.intp)
        H_pose, H = self.sensor.jacobians(self.pose, self.landmarks[rows])
        tall = H_pose.reshape(-1, 3)
        own = H @ self.landmark_covs[rows] @ H.mT + self.sensor.cov
        return tall @ self.pose_cov @ tall.T + block_diagonal(own)
