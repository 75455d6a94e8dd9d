"""A sensor that sees point landmarks as range and bearing, mounted ahead of the body centre.

P1 formulas (18)-(32) and (37)-(42), repaired: bearing by atan2 and wrapped, every lever arm kept.
Used by EKF-SLAM (chapter 09), FastSLAM (12) and Monte Carlo localization (04).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array
from slamlab.geometry import wrap_angle
from slamlab.sensors._polar import PolarSensor, matrix, pair

__all__ = ["RangeBearing"]


@dataclass(frozen=True)
class RangeBearing(PolarSensor):
    """Range and bearing of point landmarks, with Gaussian noise.

    The sensor sits `offset` metres ahead of the body centre and looks the way the body looks.
    Leading axes of poses, landmarks and measurements broadcast: one pose ``(3,)`` with landmarks
    ``(n, 2)`` gives ``(n, 2)``; particles ``(M, 1, 3)`` with landmarks ``(n, 2)`` ``(M, n, 2)``.

    Parameters
    ----------
    sigma_range : float
        Standard deviation of the range (m), positive.
    sigma_bearing : float
        Standard deviation of the bearing (rad), positive.
    offset : float, default 0.0
        L of P1: distance of the sensor ahead of the body centre (m); negative is behind.
    max_range : float, default inf
        Landmarks farther than this (m) are not seen.
    field_of_view : float, default 2 pi
        Full opening angle (rad) around the direction of the body.

    Attributes
    ----------
    cov : ndarray, shape (2, 2)
        Measurement covariance R, P1 (21): diag(sigma_range^2, sigma_bearing^2).

    Examples
    --------
    >>> sensor = RangeBearing(0.05, 0.02, offset=0.5)
    >>> sensor.observe([0, 0, np.pi / 2], [[0, 2.5], [2, 0.5]]).round(3).tolist()
    [[2.0, 0.0], [2.0, -1.571]]
    """

    def observe(self, pose: ArrayLike, landmark: ArrayLike) -> Array:
        """Return the noise-free measurement h(pose, landmark), P1 (18) repaired.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
            Body in the world (m, m, rad).
        landmark : array_like, shape (..., 2)
            Points in the world (m).

        Returns
        -------
        ndarray, shape (..., 2)
            Range (m) and bearing (rad, in (-pi, pi]) in the frame of the sensor.
        """
        pose, dx, dy, _, _ = self._to_landmark(pose, landmark)
        # (18): range, and bearing by atan2 of the vector sensor -> landmark.
        bearing = wrap_angle(np.arctan2(dy, dx) - pose[..., 2])
        return pair(np.hypot(dx, dy), bearing)

    def jacobians(self, pose: ArrayLike, landmark: ArrayLike) -> tuple[Array, Array]:
        """Return the derivatives of `observe`, P1 (22)-(32) repaired.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
        landmark : array_like, shape (..., 2)

        Returns
        -------
        H_pose : ndarray, shape (..., 2, 3)
        H_landmark : ndarray, shape (..., 2, 2)

        Raises
        ------
        ValueError
            If a landmark sits on the sensor, where the bearing has no derivative.
        """
        pose, dx, dy, c, s = self._to_landmark(pose, landmark)
        squared = dx * dx + dy * dy
        if not (squared > 0).all():
            raise ValueError("landmark: expected a point away from the sensor, distance is 0")
        distance = np.sqrt(squared)
        L = self.offset
        # (24)-(27): A, B, C, D with d = sensor - landmark, the whole lever included.
        A, B = -dx / distance, -dy / distance
        C, D = dy / squared, -dx / squared
        H_pose = np.empty((*squared.shape, 2, 3))
        # (28): how the range changes as the heading swings the sensor sideways.
        H_pose[..., 0, 0], H_pose[..., 0, 1], H_pose[..., 0, 2] = A, B, L * (B * c - A * s)
        # (29): the same for the bearing, less the turn of the body itself.
        H_pose[..., 1, 0], H_pose[..., 1, 1], H_pose[..., 1, 2] = C, D, L * (D * c - C * s) - 1
        # (31), (32): only the difference sensor - landmark matters.
        return H_pose, -H_pose[..., :2]

    def locate(self, pose: ArrayLike, z: ArrayLike) -> Array:
        """Return the landmark that a measurement points to, P1 (38): the inverse of `observe`.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
        z : array_like, shape (..., 2)
            Range (m), not negative, and bearing (rad).

        Returns
        -------
        ndarray, shape (..., 2)
            Points in the world (m).
        """
        pose, z = as_array("pose", pose, ("...", 3)), as_array("z", z, ("...", 2))
        theta, distance = pose[..., 2], z[..., 0]
        if (distance < 0).any():
            raise ValueError(f"z: expected ranges that are not negative, got {distance.min():g}")
        beam = theta + z[..., 1]
        x = pose[..., 0] + self.offset * np.cos(theta) + distance * np.cos(beam)
        y = pose[..., 1] + self.offset * np.sin(theta) + distance * np.sin(beam)
        return pair(x, y)

    def locate_jacobians(self, pose: ArrayLike, z: ArrayLike) -> tuple[Array, Array]:
        """Return the derivatives of `locate`, P1 (39)-(42) repaired.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
        z : array_like, shape (..., 2)

        Returns
        -------
        G_pose : ndarray, shape (..., 2, 3)
        G_z : ndarray, shape (..., 2, 2)
        """
        pose, z = as_array("pose", pose, ("...", 3)), as_array("z", z, ("...", 2))
        theta, distance = pose[..., 2], z[..., 0]
        beam = theta + z[..., 1]
        c, s = np.cos(beam), np.sin(beam)
        # (41): the beam turns with the body, not the lever of the sensor alone.
        turn_x = -self.offset * np.sin(theta) - distance * s
        turn_y = self.offset * np.cos(theta) + distance * c
        G_pose = matrix([[1.0, 0.0, turn_x], [0.0, 1.0, turn_y]])
        # (42)
        return G_pose, matrix([[c, -distance * s], [s, distance * c]])

    def residual(self, z: ArrayLike, predicted: ArrayLike) -> Array:
        """Return z - predicted with the bearing wrapped to (-pi, pi], P1 (19) completed.

        Parameters
        ----------
        z, predicted : array_like, shape (..., 2)

        Returns
        -------
        ndarray, shape (..., 2)
        """
        z, predicted = as_array("z", z, ("...", 2)), as_array("predicted", predicted, ("...", 2))
        difference = z - predicted
        difference[..., 1] = wrap_angle(difference[..., 1])
        return difference

    def reach(self, z: ArrayLike) -> Array:
        """Return how far from the body (m) a landmark measured as z (..., 2) may lie, (...)."""
        return as_array("z", z, ("...", 2))[..., 0] + abs(self.offset)

    def visible(self, pose: ArrayLike, landmark: ArrayLike) -> NDArray[np.bool_]:
        """Tell which landmarks lie within `max_range` and `field_of_view`, shape (...)."""
        z = self.observe(pose, landmark)
        return (z[..., 0] <= self.max_range) & (np.abs(z[..., 1]) <= self.field_of_view / 2)

    def log_likelihood(
        self, poses: ArrayLike, z: ArrayLike, landmarks: ArrayLike, covs: ArrayLike | None = None
    ) -> Array:
        """Log density of the measurements of known landmarks, for many poses at once.

        Parameters
        ----------
        poses : array_like, shape (M, 3)
            Candidate poses, for example particles.
        z : array_like, shape (k, 2)
            Measurements; they are independent given the pose (P2 (2)).
        landmarks : array_like, shape (k, 2)
            The landmark that each measurement belongs to.
        covs : array_like, shape (k, 2, 2), optional
            Covariance R of each measurement, positive definite; `cov` by default.

        Returns
        -------
        ndarray, shape (M,)
            Sum of log N(z_j; h(pose, landmark_j), R_j) over j; zeros if k is 0.
        """
        z = as_array("z", z, ("k", 2))
        landmarks = as_array("landmarks", landmarks, (len(z), 2))
        whiten, log_peak = self._whitening(covs, len(z))
        x, y, theta = self._positions(poses)
        squared = np.zeros(len(theta))
        # One landmark at a time keeps the arrays in the cache: faster than one (M, k) block.
        for one, landmark, W in zip(z, landmarks, whiten, strict=True):
            squared += _squared_error(*_polar(x, y, theta, landmark), one, W)
        return log_peak - 0.5 * squared

    def best_log_likelihood(
        self, poses: ArrayLike, z: ArrayLike, landmarks: ArrayLike, covs: ArrayLike | None = None
    ) -> Array:
        """Log density when nobody tells which landmark was measured: the best one counts.

        Parameters
        ----------
        poses : array_like, shape (M, 3)
        z : array_like, shape (k, 2)
        landmarks : array_like, shape (n, 2)
            All candidates, at least one. Two measurements may choose the same.
        covs : array_like, shape (k, 2, 2), optional
            As in `log_likelihood`.

        Returns
        -------
        ndarray, shape (M,)
            Sum over j of the largest log N(z_j; h(pose, landmark_i), R_j) over i.
        """
        z, landmarks = as_array("z", z, ("k", 2)), as_array("landmarks", landmarks, ("n", 2))
        if len(landmarks) == 0:
            raise ValueError("landmarks: expected at least one, got none")
        whiten, log_peak = self._whitening(covs, len(z))
        x, y, theta = self._positions(poses)
        least = np.full((len(z), len(theta)), np.inf)
        for landmark in landmarks:
            distance, angle = _polar(x, y, theta, landmark)
            for row, one, W in zip(least, z, whiten, strict=True):
                np.minimum(row, _squared_error(distance, angle, one, W), out=row)
        return log_peak - 0.5 * least.sum(0)

    def _whitening(self, covs: ArrayLike | None, k: int) -> tuple[Array, float]:
        """Inverse Cholesky factors (k, 2, 2) of R, and the largest log density of all together."""
        R = np.tile(self.cov, (k, 1, 1)) if covs is None else as_array("covs", covs, (k, 2, 2))
        try:
            W = np.linalg.inv(np.linalg.cholesky(R))
        except np.linalg.LinAlgError as error:
            raise ValueError("covs: expected positive definite matrices, one is not") from error
        return W, float(np.log(W[:, [0, 1], [0, 1]]).sum() - k * np.log(2 * np.pi))

    def _positions(self, poses: ArrayLike) -> tuple[Array, Array, Array]:
        """Coordinates of the sensor and headings, (M,) each."""
        poses = as_array("poses", poses, ("M", 3))
        x, y, theta = np.ascontiguousarray(poses.T)
        if self.offset:
            x, y = x + self.offset * np.cos(theta), y + self.offset * np.sin(theta)
        return x, y, theta

    def _to_landmark(
        self, pose: ArrayLike, landmark: ArrayLike
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Pose, vector from sensor to landmark, cosine and sine of the heading."""
        pose = as_array("pose", pose, ("...", 3))
        landmark = as_array("landmark", landmark, ("...", 2))
        c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        dx = landmark[..., 0] - pose[..., 0] - self.offset * c
        dy = landmark[..., 1] - pose[..., 1] - self.offset * s
        return pose, dx, dy, c, s


def _polar(x: Array, y: Array, theta: Array, landmark: Array) -> tuple[Array, Array]:
    """Distance and direction, not wrapped, of one landmark from many sensors, (M,) each."""
    dx, dy = landmark[0] - x, landmark[1] - y
    angle = np.arctan2(dy, dx)
    angle -= theta
    return np.sqrt(dx * dx + dy * dy), angle


def _squared_error(distance: Array, angle: Array, z: Array, whiten: Array) -> Array:
    """Squared Mahalanobis distance of one measurement from predicted ones, (M,)."""
    # A measurement more than 1e154 sigmas off has probability 0: infinity stands for it.
    with np.errstate(over="ignore", invalid="ignore"):
        range_error = distance - z[0]
        error = angle - z[1]
        # Wrap to [-pi, pi]; the sign of a half turn does not matter once squared.
        error -= 2 * np.pi * np.rint(error * (0.5 / np.pi))
        error *= whiten[1, 1]
        if whiten[1, 0]:
            error += whiten[1, 0] * range_error
        range_error *= whiten[0, 0]
        error *= error
        range_error *= range_error
        error += range_error
        return error
