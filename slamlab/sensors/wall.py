"""A sensor that sees straight walls as range and bearing of the foot of the perpendicular.

The landmark that P1's experiment uses and its formulas (18)-(42) leave out: a line, not a point.
A drop-in for `RangeBearing` in EKF-SLAM (chapter 09); chapter 07 measures it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array
from slamlab.geometry import wrap_angle
from slamlab.sensors._polar import PolarSensor, matrix, pair

__all__ = ["Wall"]


@dataclass(frozen=True)
class Wall(PolarSensor):
    """Range and bearing of straight walls without end, with Gaussian noise.

    A wall (r, alpha) is the line x cos(alpha) + y sin(alpha) = r; (-r, alpha + pi) is the same
    line. Seen from the sensor it is again (r, alpha), now called range and bearing: the distance
    to the line and the direction of the perpendicular. The sensor sits `offset` metres ahead of
    the body centre. Leading axes broadcast as in `RangeBearing`.

    Parameters
    ----------
    sigma_range : float
        Standard deviation of the range (m), positive.
    sigma_bearing : float
        Standard deviation of the bearing (rad), positive.
    offset : float, default 0.0
        L of P1: distance of the sensor ahead of the body centre (m); negative is behind.
    max_range : float, default inf
        Length of the beams (m): a wall is seen if at least one of them meets it.
    field_of_view : float, default 2 pi
        Full opening angle of the beams (rad) around the direction of the body.

    Attributes
    ----------
    cov : ndarray, shape (2, 2)
        Measurement covariance R, P1 (21): diag(sigma_range^2, sigma_bearing^2).

    Examples
    --------
    The wall x = 3 from a sensor half a metre ahead of the origin, then from beyond the wall:

    >>> sensor = Wall(0.05, 0.02, offset=0.5)
    >>> sensor.observe([[0, 0, 0], [4, 0, 0]], [3, 0]).round(3).tolist()
    [[2.5, 0.0], [1.5, 3.142]]
    """

    def observe(self, pose: ArrayLike, landmark: ArrayLike) -> Array:
        """Return the noise-free measurement h(pose, wall).

        Parameters
        ----------
        pose : array_like, shape (..., 3)
            Body in the world (m, m, rad).
        landmark : array_like, shape (..., 2)
            Walls (r, alpha) in the world (m, rad).

        Returns
        -------
        ndarray, shape (..., 2)
            Distance to the wall (m, not negative) and bearing of the perpendicular from the
            sensor (rad, in (-pi, pi]).
        """
        pose, wall, x, y = self._arrays(pose, "landmark", landmark)
        alpha = wall[..., 1]
        # Signed distance of the wall from the sensor, along its normal.
        signed = wall[..., 0] - x * np.cos(alpha) - y * np.sin(alpha)
        return _one_name(signed, alpha - pose[..., 2])

    def jacobians(self, pose: ArrayLike, landmark: ArrayLike) -> tuple[Array, Array]:
        """Return the derivatives of `observe`; on the wall itself, those of its positive side.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
        landmark : array_like, shape (..., 2)

        Returns
        -------
        H_pose : ndarray, shape (..., 2, 3)
        H_landmark : ndarray, shape (..., 2, 2)
        """
        pose, wall, x, y = self._arrays(pose, "landmark", landmark)
        alpha = wall[..., 1]
        c, s = np.cos(alpha), np.sin(alpha)
        # A wall seen from its other side turns over: the range changes sign, the bearing does not.
        side = np.where(wall[..., 0] - x * c - y * s < 0, -1.0, 1.0)
        lever = -self.offset * np.sin(alpha - pose[..., 2])
        H_pose = matrix([[-side * c, -side * s, side * lever], [0.0, 0.0, -1.0]])
        return H_pose, matrix([[side, side * (x * s - y * c)], [0.0, 1.0]])

    def locate(self, pose: ArrayLike, z: ArrayLike) -> Array:
        """Return the wall that a measurement tells of: the inverse of `observe`.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
        z : array_like, shape (..., 2)
            Range (m) and bearing (rad).

        Returns
        -------
        ndarray, shape (..., 2)
            Walls (r, alpha) in the world (m, rad), r not negative, alpha in (-pi, pi].
        """
        pose, z, x, y = self._arrays(pose, "z", z)
        alpha = pose[..., 2] + z[..., 1]
        return _one_name(z[..., 0] + x * np.cos(alpha) + y * np.sin(alpha), alpha)

    def locate_jacobians(self, pose: ArrayLike, z: ArrayLike) -> tuple[Array, Array]:
        """Return the derivatives of `locate`; where r is 0, those of the positive side.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
        z : array_like, shape (..., 2)

        Returns
        -------
        G_pose : ndarray, shape (..., 2, 3)
        G_z : ndarray, shape (..., 2, 2)
        """
        pose, z, x, y = self._arrays(pose, "z", z)
        alpha = pose[..., 2] + z[..., 1]
        c, s = np.cos(alpha), np.sin(alpha)
        side = np.where(z[..., 0] + x * c + y * s < 0, -1.0, 1.0)
        # The sensor's own lever cancels here: what turns the wall is the body centre.
        turn = pose[..., 1] * c - pose[..., 0] * s
        G_pose = matrix([[side * c, side * s, side * turn], [0.0, 0.0, 1.0]])
        return G_pose, matrix([[side, side * (y * c - x * s)], [0.0, 1.0]])

    def residual(self, z: ArrayLike, predicted: ArrayLike) -> Array:
        """Return z - predicted, both walls first written with normals less than 90 deg apart.

        (r, alpha) and (-r, alpha + pi) name one wall, so the difference of bearings is brought
        to [-pi/2, pi/2] and the range of `z` changes sign whenever that takes half a turn.

        Parameters
        ----------
        z, predicted : array_like, shape (..., 2)

        Returns
        -------
        ndarray, shape (..., 2)
        """
        z, predicted = as_array("z", z, ("...", 2)), as_array("predicted", predicted, ("...", 2))
        turn = wrap_angle(z[..., 1] - predicted[..., 1])
        opposite = np.abs(turn) > np.pi / 2
        turn = np.where(opposite, turn - np.copysign(np.pi, turn), turn)
        distance = np.where(opposite, -z[..., 0], z[..., 0])
        return pair(distance - predicted[..., 0], turn)

    def reach(self, z: ArrayLike) -> Array:
        """Return how far from the body a wall's parameters may lie: they are no place, inf."""
        return np.full(as_array("z", z, ("...", 2)).shape[:-1], np.inf)

    def visible(self, pose: ArrayLike, landmark: ArrayLike) -> NDArray[np.bool_]:
        """Tell which walls at least one beam meets within `max_range`, shape (...)."""
        z = self.observe(pose, landmark)
        # The beam that meets the wall first is the one nearest to the perpendicular.
        slant = np.maximum(np.abs(z[..., 1]) - self.field_of_view / 2, 0.0)
        facing = slant < np.pi / 2
        return facing & (z[..., 0] <= self.max_range * np.cos(np.where(facing, slant, 0.0)))

    def _arrays(
        self, pose: ArrayLike, name: str, polar: ArrayLike
    ) -> tuple[Array, Array, Array, Array]:
        """Return the checked pose and (r, alpha) or z, and where the sensor stands."""
        pose, polar = as_array("pose", pose, ("...", 3)), as_array(name, polar, ("...", 2))
        x = pose[..., 0] + self.offset * np.cos(pose[..., 2])
        y = pose[..., 1] + self.offset * np.sin(pose[..., 2])
        return pose, polar, x, y


def _one_name(signed: Array, angle: Array) -> Array:
    """Of the two names of a line, the one with r >= 0 and the angle wrapped, (..., 2)."""
    return pair(np.abs(signed), wrap_angle(np.where(signed < 0, angle + np.pi, angle)))
