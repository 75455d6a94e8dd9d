"""A sensor that gives landmarks as points: x ahead and y to the left of the body.

What a lidar's tree detector delivers on Victoria Park (Guivant and Nebot 2001), and what the
edges of landmark graphs carry (g2o's EDGE_SE2_XY). Chapters 10 to 13.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_one_covariance, as_positive
from slamlab.geometry import inverse_transform, rotation, transform

__all__ = ["PointSensor"]


@dataclass(frozen=True, eq=False)
class PointSensor:
    """Landmarks in the frame of the body, z = R^T (landmark - t) + noise.

    Parameters
    ----------
    cov : array_like, shape (2, 2)
        Covariance of one measurement (m^2); copied.
    max_range : float, default inf
        Landmarks further away (m) are not seen; positive.

    Examples
    --------
    >>> PointSensor(0.04 * np.eye(2)).observe([1, 0, np.pi / 2], [1, 3]).round(6).tolist()
    [3.0, 0.0]
    """

    cov: Array
    max_range: float = np.inf

    def __post_init__(self) -> None:
        """Check the parameter."""
        cov = as_one_covariance("cov", self.cov, 2)
        cov.setflags(write=False)
        object.__setattr__(self, "cov", cov)
        as_positive("max_range", self.max_range)

    def __repr__(self) -> str:
        """Say in one line how well it measures, and how far."""
        return f"PointSensor(cov={self.cov.tolist()}, max_range={self.max_range:g})"

    def observe(self, pose: ArrayLike, landmark: ArrayLike) -> Array:
        """Return R^T (landmark - t), shape (..., 2), for poses (..., 3) and landmarks (..., 2)."""
        pose, landmark = _arrays(pose, landmark, "landmark")
        return inverse_transform(pose, landmark[..., None, :])[..., 0, :]

    def jacobians(self, pose: ArrayLike, landmark: ArrayLike) -> tuple[Array, Array]:
        """Return the derivatives of `observe` by pose, (..., 2, 3), and landmark, (..., 2, 2)."""
        pose, landmark = _arrays(pose, landmark, "landmark")
        z = self.observe(pose, landmark)
        back = np.swapaxes(rotation(pose[..., 2]), -1, -2)
        back = np.broadcast_to(back, (*z.shape, 2))
        # A turn of the body to the left turns what it sees to the right: d z / d theta = -S z
        turn = np.stack([z[..., 1], -z[..., 0]], -1)
        return np.concatenate([-back, turn[..., None]], -1), back.copy()

    def locate(self, pose: ArrayLike, z: ArrayLike) -> Array:
        """Return t + R z, shape (..., 2), for poses (..., 3) and measurements (..., 2)."""
        pose, z = _arrays(pose, z, "z")
        return transform(pose, z[..., None, :])[..., 0, :]

    def locate_jacobians(self, pose: ArrayLike, z: ArrayLike) -> tuple[Array, Array]:
        """Return the derivatives of `locate` by pose, (..., 2, 3), and by z, (..., 2, 2)."""
        pose, z = _arrays(pose, z, "z")
        lever = self.locate(pose, z) - pose[..., :2]
        turn = np.stack([-lever[..., 1], lever[..., 0]], -1)
        one = np.broadcast_to(np.eye(2), (*lever.shape, 2))
        R = np.broadcast_to(rotation(pose[..., 2]), one.shape)
        return np.concatenate([one, turn[..., None]], -1), R.copy()

    def residual(self, z: ArrayLike, predicted: ArrayLike) -> Array:
        """Return z - predicted, shape (..., 2): metres need no wrapping."""
        z, predicted = as_array("z", z, ("...", 2)), as_array("predicted", predicted, ("...", 2))
        return z - predicted

    def visible(self, pose: ArrayLike, landmark: ArrayLike) -> NDArray[np.bool_]:
        """Tell which landmarks (..., 2) lie within `max_range` of poses (..., 3), shape (...)."""
        return self.reach(self.observe(pose, landmark)) <= self.max_range

    def reach(self, z: ArrayLike) -> Array:
        """Return how far from the body (m) a landmark measured as z (..., 2) lies, (...)."""
        return np.linalg.norm(as_array("z", z, ("...", 2)), axis=-1)


def _arrays(pose: ArrayLike, point: ArrayLike, name: str) -> tuple[Array, Array]:
    return as_array("pose", pose, ("...", 3)), as_array(name, point, ("...", 2))
