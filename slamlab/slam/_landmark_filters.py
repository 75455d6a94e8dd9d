"""Kalman filters of landmarks seen from known poses, for many particles at once.

Step 4 of P2's algorithm, and what its steps 1 and 2 need of it. Matrices of two rows are written
out, entry by entry, because whole arrays of them pass through every line. Used by FastSLAM.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_covariance
from slamlab.models import LandmarkSensor
from slamlab.slam._landmark_maps import ABSENT

__all__ = [
    "Comparison",
    "Landmarks",
    "Prediction",
    "as_noise",
    "compare",
    "correct",
    "information",
    "predict",
    "started",
]

# Entries xx, xy, yy of symmetric matrices, each of shape (...).
Symmetric = tuple[Array, Array, Array]

FAR_AWAY = 1e6


@dataclass(frozen=True)
class Landmarks:
    """Gaussians of landmarks, shape (M, k) each: mean, covariance and log odds of existence."""

    x: Array
    y: Array
    cov: Symmetric
    log_odds: Array

    @classmethod
    def read(cls, found: Array, poses: Array) -> Landmarks:
        """Take them from a map's fields (6, M, k); absent ones are put out of everybody's way."""
        x, y, xx, xy, yy, log_odds = found
        absent = log_odds == ABSENT
        if absent.any():
            x = np.where(absent, poses[:, :1] + FAR_AWAY, x)
            y = np.where(absent, poses[:, 1:2], y)
        return cls(x, y, (xx, xy, yy), log_odds)

    def columns(self, some: NDArray[np.bool_]) -> Landmarks:
        """Return only these columns, those of a mask (k,)."""
        if some.all():
            return self
        x, y, xx, xy, yy, log_odds = self.fields[:, :, some]
        return Landmarks(x, y, (xx, xy, yy), log_odds)

    @property
    def mean(self) -> Array:
        """Means (M, k, 2)."""
        return np.stack([self.x, self.y], -1)

    @property
    def fields(self) -> Array:
        """Fields (6, M, k) of a map."""
        return np.stack([self.x, self.y, *self.cov, self.log_odds])

    @property
    def present(self) -> NDArray[np.bool_]:
        """Which are landmarks at all, (M, k)."""
        return self.log_odds > ABSENT


@dataclass(frozen=True)
class Prediction:
    """What each particle expects to measure of each of its landmarks.

    `H_pose` (M, k, 2, 3) and `H` (M, k, 2, 2) are the sensor's Jacobians, `cross` the four entries
    of S H^T (rows first), `spread` the innovation covariance without the sensor's, H S H^T.
    """

    z: Array
    H_pose: Array
    H: Array
    cross: tuple[Array, Array, Array, Array]
    spread: Symmetric


@dataclass(frozen=True)
class Comparison:
    """Measurements beside their predictions: innovation, Z^-1 and det Z, (M, k) each."""

    noise: Symmetric
    y: tuple[Array, Array]
    inverse: Symmetric
    determinant: Array

    @cached_property
    def distance(self) -> Array:
        """Squared Mahalanobis distance y^T Z^-1 y."""
        a, b = self.y
        xx, xy, yy = self.inverse
        # A measurement more than 1e154 sigmas off has probability 0: infinity stands for it.
        with np.errstate(over="ignore", invalid="ignore"):
            return xx * a * a + 2 * xy * a * b + yy * b * b

    @property
    def log_density(self) -> Array:
        """Log density (15) of the measurement."""
        return -0.5 * self.distance - 0.5 * np.log(self.determinant) - np.log(2 * np.pi)


def predict(
    sensor: LandmarkSensor, poses: Array, landmarks: Landmarks, pose_root: Array | None = None
) -> Prediction:
    """Predict the measurements of landmarks (M, k) from poses (M, 3).

    With `pose_root` A (M, 3, q) the poses are uncertain, of covariance A A^T: the spread has it.
    """
    mean = landmarks.mean
    H_pose, H = sensor.jacobians(poses[:, None], mean)
    h00, h01, h10, h11 = _entries(H)
    xx, xy, yy = landmarks.cov
    # S H^T
    c00, c01 = xx * h00 + xy * h01, xx * h10 + xy * h11
    c10, c11 = xy * h00 + yy * h01, xy * h10 + yy * h11
    # H S H^T
    z00 = h00 * c00 + h01 * c10
    z01 = h00 * c01 + h01 * c11
    z11 = h10 * c01 + h11 * c11
    if pose_root is not None:
        spread = H_pose @ pose_root[:, None]
        along, across = spread[..., 0, :], spread[..., 1, :]
        z00 = z00 + (along * along).sum(-1)
        z01 = z01 + (along * across).sum(-1)
        z11 = z11 + (across * across).sum(-1)
    expected = sensor.observe(poses[:, None], mean)
    return Prediction(expected, H_pose, H, (c00, c01, c10, c11), (z00, z01, z11))


def compare(sensor: LandmarkSensor, prediction: Prediction, z: Array, R: Array) -> Comparison:
    """Compare measurements with predictions (M, k): (15) for each landmark.

    Each has its own measurement, z (k, 2) with covariances R (k, 2, 2), or all have one, z (2,)
    with R (2, 2).
    """
    y = sensor.residual(z, prediction.z)
    noise = R[..., 0, 0], R[..., 0, 1], R[..., 1, 1]
    # Z = H S H^T + R
    z00, z01, z11 = (one + other for one, other in zip(prediction.spread, noise, strict=True))
    determinant = z00 * z11 - z01 * z01
    inverse = z11 / determinant, -z01 / determinant, z00 / determinant
    return Comparison(noise, (y[..., 0], y[..., 1]), inverse, determinant)


def correct(prediction: Prediction, comparison: Comparison, landmarks: Landmarks) -> Landmarks:
    """Kalman update of every landmark by its measurement, covariance in Joseph's form."""
    c00, c01, c10, c11 = prediction.cross
    i00, i01, i11 = comparison.inverse
    # K = S H^T Z^-1
    k00, k01 = c00 * i00 + c01 * i01, c00 * i01 + c01 * i11
    k10, k11 = c10 * i00 + c11 * i01, c10 * i01 + c11 * i11
    a, b = comparison.y
    h00, h01, h10, h11 = _entries(prediction.H)
    # (I - K H) S (I - K H)^T + K R K^T
    left = (1 - k00 * h00 - k01 * h10, -k00 * h01 - k01 * h11)
    right = (-k10 * h00 - k11 * h10, 1 - k10 * h01 - k11 * h11)
    kept = _sandwich(left, right, landmarks.cov)
    added = _sandwich((k00, k01), (k10, k11), comparison.noise)
    cov = (kept[0] + added[0], kept[1] + added[1], kept[2] + added[2])
    x, y = landmarks.x + k00 * a + k01 * b, landmarks.y + k10 * a + k11 * b
    return Landmarks(x, y, cov, landmarks.log_odds)


def information(
    prediction: Prediction, comparison: Comparison, met: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Sum up what measurements say about the pose: H^T Z^-1 H (M, 3, 3) and H^T Z^-1 y (M, 3).

    Landmarks are independent given the path, so that their measurements add up. Only those that
    are `met` (M, k) count.
    """
    M, k = met.shape
    i00, i01, i11 = (entry * met for entry in comparison.inverse)
    a, b = (np.where(met, entry, 0.0) for entry in comparison.y)
    upper, lower = prediction.H_pose[..., 0, :], prediction.H_pose[..., 1, :]
    # Rows of Z^-1 H, two a measurement
    weighted = np.empty((M, k, 2, 3))
    weighted[..., 0, :] = i00[..., None] * upper + i01[..., None] * lower
    weighted[..., 1, :] = i01[..., None] * upper + i11[..., None] * lower
    stacked = weighted.reshape(M, 2 * k, 3).mT
    y = np.stack([a, b], -1).reshape(M, 2 * k, 1)
    return stacked @ prediction.H_pose.reshape(M, 2 * k, 3), (stacked @ y)[..., 0]


def started(sensor: LandmarkSensor, poses: Array, z: Array, R: Array) -> Landmarks:
    """Landmarks (M, k) that each particle would start from each measurement: g and G_z R G_z^T."""
    mean = sensor.locate(poses[:, None], z)
    _, G = sensor.locate_jacobians(poses[:, None], z)
    with np.errstate(over="ignore", invalid="ignore"):
        xx, xy, yx, yy = _entries(G @ R @ G.mT)
    x, y = mean[..., 0], mean[..., 1]
    return Landmarks(x, y, (xx, 0.5 * (xy + yx), yy), np.zeros(x.shape))


def as_noise(sensor: LandmarkSensor, covs: ArrayLike | None, k: int) -> Array:
    """Covariances (k, 2, 2) of k measurements: the sensor's own unless others are given."""
    if covs is None:
        return np.broadcast_to(sensor.cov, (k, 2, 2))
    R = as_covariance("covs", covs, 2)
    if R.shape != (k, 2, 2):
        raise ValueError(f"covs: expected shape ({k}, 2, 2), got {R.shape}")
    return R


def _entries(matrix: Array) -> tuple[Array, Array, Array, Array]:
    """Entries of matrices (..., 2, 2), rows first."""
    return matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 0], matrix[..., 1, 1]


def _sandwich(upper: tuple[Array, Array], lower: tuple[Array, Array], middle: Any) -> Symmetric:
    """Return A S A^T for A with rows `upper` and `lower` and a symmetric S."""
    xx, xy, yy = middle
    (a, b), (c, d) = upper, lower
    u, v = a * xx + b * xy, a * xy + b * yy
    p, q = c * xx + d * xy, c * xy + d * yy
    return u * a + v * b, u * c + v * d, p * c + q * d
