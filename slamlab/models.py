"""What a robot, a sensor, a world, an estimator and a pilot must be able to do.

The protocols of the whole house, declared once. Whoever derives from `MotionModel` or
`LandmarkSensor` writes the mathematics and gets the rest. Book page "Bring your own robot".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_batch, as_covariance, as_instance, as_rng
from slamlab.gaussian import cached_sqrt

__all__ = [
    "Bounds",
    "Estimator",
    "HeightSensor",
    "LandmarkSensor",
    "MotionModel",
    "Pilot",
    "ScanSensor",
    "Smoother",
    "View",
    "World",
    "as_array",
    "as_covariance",
    "as_estimator",
    "as_motion",
    "as_scan_sensor",
    "as_sensor",
    "controls_of",
]

Bounds = tuple[float, float, float, float]


@runtime_checkable
class MotionModel(Protocol):
    """How a robot moves: x_k = f(x_{k-1}, u_k), P2 (6). Leading axes are batches."""

    def step(self, pose: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Pose (..., 3) after driving from `pose` (..., 3) with control u (..., p) for dt (s)."""

    def jacobians(self, pose: ArrayLike, u: ArrayLike, dt: float) -> tuple[Array, Array]:
        """Return the derivatives of `step` by pose, (..., 3, 3), and by control, (..., 3, p)."""

    def sample(
        self,
        pose: ArrayLike,
        u: ArrayLike,
        dt: float,
        control_cov: ArrayLike,
        rng: np.random.Generator,
    ) -> Array:
        """Draw next poses from p(x_k | x_{k-1}, u_k), P2 (3): each pose gets its own noise.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
            Poses before the step, for example particles (M, 3).
        u : array_like, shape (p,) or (..., p)
            Commanded control.
        dt : float
            Duration (s).
        control_cov : array_like, shape (p, p)
            Covariance of the control actually executed around `u`; singular is allowed.
        rng : numpy.random.Generator

        Returns
        -------
        ndarray, shape (..., 3)
        """
        pose, u = as_array("pose", pose, ("...", 3)), as_array("u", u, ("...", "p"))
        mixing = cached_sqrt("control_cov", control_cov, u.shape[-1])
        lead = as_batch("u", u.shape[:-1], pose.shape[:-1])
        noise = as_rng("rng", rng).standard_normal((*lead, u.shape[-1]))
        return self.step(pose, u + noise @ mixing.T, dt)


def controls_of(motion: MotionModel) -> str:
    """Say what the controls of a motion model are, for `Log.controls`: velocities as a rule."""
    return str(getattr(motion, "controls", "velocity"))


@runtime_checkable
class LandmarkSensor(Protocol):
    """How a sensor measures a landmark: z = h(pose, landmark) + noise of covariance `cov`."""

    @property
    def cov(self) -> Array:
        """Covariance R (2, 2) of one measurement."""

    def observe(self, pose: ArrayLike, landmark: ArrayLike) -> Array:
        """Noise-free measurements (..., 2) of landmarks (..., 2) from poses (..., 3)."""

    def jacobians(self, pose: ArrayLike, landmark: ArrayLike) -> tuple[Array, Array]:
        """Return the derivatives of `observe` by pose, (..., 2, 3), and landmark, (..., 2, 2)."""

    def locate(self, pose: ArrayLike, z: ArrayLike) -> Array:
        """Landmarks (..., 2) that measurements (..., 2) point to: the inverse of `observe`."""

    def locate_jacobians(self, pose: ArrayLike, z: ArrayLike) -> tuple[Array, Array]:
        """Return the derivatives of `locate` by pose, (..., 2, 3), and by z, (..., 2, 2)."""

    def residual(self, z: ArrayLike, predicted: ArrayLike) -> Array:
        """Difference z - predicted (..., 2); a sensor that measures angles wraps them."""
        z, predicted = as_array("z", z, ("...", 2)), as_array("predicted", predicted, ("...", 2))
        return z - predicted

    def visible(self, pose: ArrayLike, landmark: ArrayLike) -> NDArray[np.bool_]:
        """Tell which landmarks (..., 2) the sensor sees from poses (..., 3): all by default."""
        lead = np.broadcast_shapes(np.shape(pose)[:-1], np.shape(landmark)[:-1])
        return np.ones(lead, bool)

    def reach(self, z: ArrayLike) -> Array:
        """How far from the body (m) landmarks measured as z (..., 2) may lie; inf: who knows."""
        return np.full(np.shape(z)[:-1], np.inf)


@runtime_checkable
class ScanSensor(Protocol):
    """How the beams of a lidar are laid out: `logs.ScanGeometry` and `sensors.Lidar` are two."""

    @property
    def beam_angles(self) -> Array:
        """Directions of the beams in the frame of the body (rad), shape (n_beams,)."""

    @property
    def n_beams(self) -> int:
        """Number of beams."""

    @property
    def max_range(self) -> float:
        """A range of at least this (m) is a beam that met nothing."""

    @property
    def offset(self) -> float:
        """Distance of the lidar ahead of the body centre (m)."""

    def points(self, ranges: ArrayLike, poses: ArrayLike | None = None) -> Array:
        """End points (..., n_beams, 2) of scans, NaN where a beam met nothing."""


@runtime_checkable
class HeightSensor(ScanSensor, Protocol):
    """A scan sensor whose beams go down to the ground: `sensors.StereoRig` is one."""

    def heights(self, ranges: ArrayLike) -> Array:
        """Heights (..., n_beams) of the end points above the ground below (m), NaN as there."""


class World(Protocol):
    """A world with obstacles: `worlds.BitmapWorld` and `worlds.WallWorld` are two."""

    @property
    def bounds(self) -> Bounds:
        """Left, bottom, right and top (m)."""

    def is_free(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Tell which points (..., 2) lie in no obstacle."""

    def clearance(self, points: ArrayLike) -> Array:
        """Distance (m) of points (..., 2) to the nearest obstacle; 0 inside."""

    def cast(self, origins: ArrayLike, angles: ArrayLike, max_range: float = np.inf) -> Array:
        """Distance (m) at which beams meet something, inf where they meet nothing."""

    def collides(self, footprint: ArrayLike, poses: ArrayLike) -> NDArray[np.bool_]:
        """Tell at which poses (..., 3) a convex footprint (k, 2) overlaps an obstacle."""

    def sweep_collides(
        self, footprint: ArrayLike, start: ArrayLike, end: ArrayLike
    ) -> NDArray[np.bool_]:
        """Tell which straight drives or turns on the spot meet an obstacle."""


@runtime_checkable
class Estimator(Protocol):
    """A system that turns controls and measurements into a belief about the pose.

    `pose` and `pose_cov` are copies: four of them appended to a list are four poses. A call that
    is refused with ValueError leaves the system as it was, and no call changes its arguments.
    """

    measures: str
    """What `update` takes: "landmarks" (sets of measurements), "scan" (ranges) or "odometry"."""

    @property
    def pose(self) -> Array:
        """Estimated pose (m, m, rad), shape (3,), or (M, 3) of M runs side by side; a copy."""

    @property
    def pose_cov(self) -> Array:
        """Covariance of the pose, shape (3, 3) or (M, 3, 3); a copy."""

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move by control u (p,) during dt (s), executed with covariance (p, p)."""

    def update(self, measurement: Any, ids: Any = None) -> Any:
        """Correct by a measurement: landmarks (k, 2), their `ids` if known, or ranges (n,)."""


@runtime_checkable
class Smoother(Protocol):
    """An estimator that revises its past, such as graph SLAM."""

    @property
    def trajectory(self) -> Array:
        """Best poses (T, 3) of all steps so far; a copy."""


@dataclass(frozen=True, eq=False)
class View:
    """What a pilot may know when it gives its next command; of a batch, M robots side by side.

    Attributes
    ----------
    time, dt : float
        Now, and how long the command will last (s).
    pose, pose_cov : ndarray, shapes (3,) and (3, 3), or (M, 3) and (M, 3, 3)
        What the robot believes; the truth is not here.
    measurement : ndarray or None
        The newest one: ranges (n_beams,) or landmarks (k, 2); None without a sensor.
    hit : ndarray of bool, shape () or (M,)
        Whether the last command ended at an obstacle.
    """

    time: float
    dt: float
    pose: Array
    pose_cov: Array
    measurement: Any
    hit: NDArray[np.bool_]


@runtime_checkable
class Pilot(Protocol):
    """Who decides where to drive. It sees what the robot believes, never the truth."""

    def command(self, view: View) -> Array | None:
        """Return the next control u (p,), or None when there is nothing left to do."""


def as_motion(name: str, value: Any) -> MotionModel:
    """Return `value` if it is a motion model; ValueError names what it lacks."""
    return as_instance(name, value, MotionModel, "a motion model such as Unicycle()")


def as_sensor(name: str, value: Any) -> LandmarkSensor:
    """Return `value` if it is a sensor of landmarks; ValueError names what it lacks."""
    return as_instance(name, value, LandmarkSensor, "a sensor such as RangeBearing(...)")


def as_scan_sensor(name: str, value: Any) -> ScanSensor:
    """Return `value` if it knows how a lidar's beams lie; ValueError names what it lacks."""
    return as_instance(name, value, ScanSensor, "a lidar such as Lidar(...)")


def as_estimator(name: str, value: Any) -> Estimator:
    """Return `value` if it is an estimator; ValueError names what it lacks."""
    return as_instance(name, value, Estimator, "an estimator such as EKFSlam(...)")
