"""A range that adapts: see as few landmarks as will do, work in a region as small as will do.

P4 adapts the range in which it looks to save time; its law stands on pages that are not at hand.
This law is ours, and chapter 16 tests it.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import (
    Array,
    as_array,
    as_instance,
    as_names,
    as_positive,
    as_scalar,
    as_shaped,
)
from slamlab.models import LandmarkSensor, as_estimator

__all__ = ["AdaptiveRange"]


class _WithSensor(Protocol):
    """A system that knows its sensor of landmarks."""

    sensor: LandmarkSensor


class _Regional(Protocol):
    """A system that works in a region."""

    radius: float


class AdaptiveRange:
    """A SLAM system that looks only as far as it takes to see so many landmarks.

    Runs side by side (`EKFSlamBatch`) have a range each.

    At a density rho of landmarks, rho pi r^2 of them lie within r. With n seen within r, the
    wanted number is therefore seen within r sqrt(wanted / n).

    Parameters
    ----------
    system : Estimator
        Any that measures landmarks and knows its sensor: `EKFSlam`, `CompressedEKFSlam`,
        `EKFSlamBatch`.
    n_target : float, default 10.0
        Landmarks to see at once, positive.
    min_range, max_range : float
        Bounds of the range (m); it begins at the furthest.
    region_factor : float, optional
        Let a `CompressedEKFSlam` work in a region of so many ranges; its `radius` is set.

    Attributes
    ----------
    measures : str
        "landmarks": sets of simultaneous measurements of landmarks.
    system : Estimator
        As given.
    range : float, or ndarray (M,) of a batch
        The range of the next measurements (m).
    n_seen : int, or ndarray (M,) of a batch
        Landmarks seen at the last update.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import PointSensor
    >>> from slamlab.slam import EKFSlam
    >>> inner = EKFSlam(Unicycle(), PointSensor(0.04 * np.eye(2)), [0, 0, 0])
    >>> slam = AdaptiveRange(inner, n_target=1, min_range=5.0, max_range=40.0)
    >>> _ = slam.update([[30.0, 0.0], [3.0, 4.0], [0.0, 8.0], [6.0, 0.0]], ids=list("abcd"))
    >>> slam.n_seen, slam.range
    (4, 20.0)
    """

    measures = "landmarks"

    def __init__(
        self,
        system: Any,
        *,
        n_target: float = 10.0,
        min_range: float,
        max_range: float,
        region_factor: float | None = None,
    ) -> None:
        self.system: Any = as_estimator("system", system)
        as_instance("system", system, _WithSensor, "one with a sensor of landmarks")
        if region_factor is not None:
            as_instance("region_factor", system, _Regional, "a system with a radius")
            region_factor = as_scalar("region_factor", region_factor, 1.0, 1e9)
        self.n_target = as_positive("n_target", n_target, 1e9)
        self.min_range = as_positive("min_range", min_range, 1e9)
        self.max_range = as_scalar("max_range", max_range, self.min_range, 1e9)
        self.region_factor = region_factor
        self.n_seen: Any = 0
        self.range: Any = self.max_range
        self._set_reach(self.range)

    def __repr__(self) -> str:
        """Say how far it sees, and in which system."""
        reach = f"{np.mean(self.range):.1f} m"
        return f"AdaptiveRange({reach} for {self.n_target:g} landmarks, {self.system!r})"

    @property
    def pose(self) -> Array:
        """Estimated pose (m, m, rad), shape (3,) or (M, 3)."""
        return np.asarray(self.system.pose)

    @property
    def pose_cov(self) -> Array:
        """Covariance of the pose, shape (3, 3) or (M, 3, 3)."""
        return np.asarray(self.system.pose_cov)

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move the pose, as the system does."""
        self.system.predict(u, dt, control_cov)

    def update(self, z: ArrayLike, ids: Sequence[Hashable | None] | None = None) -> Any:
        """Correct by the landmarks within the range, then adapt the range.

        Parameters
        ----------
        z : array_like, shape (k, 2) or (M, k, 2)
            Measurements of all landmarks that the sensor could see; in a batch NaN where a run
            did not see one.
        ids : sequence of hashable, length k, optional
            As the system takes them.

        Raises
        ------
        ValueError
            As the system; nothing has changed then.
        """
        batch = self.pose.shape[:-1]
        z = as_shaped("z", z, (*batch, "k", 2)) if batch else as_array("z", z, ("k", 2))
        seen = np.asarray(np.isfinite(z).all(-1))
        distance = self.system.sensor.reach(np.where(seen[..., None], z, 0.0))
        near = seen & (distance <= np.asarray(self.range)[..., None])
        if not batch and ids is not None:
            names = as_names("ids", ids, len(z))
            ids = [names[k] for k in np.flatnonzero(near)]
        near_z = np.where(near[..., None], z, np.nan) if batch else z[near]
        report = self.system.update(near_z, ids)
        self.n_seen = near.sum(-1) if batch else int(near.sum())
        # rho pi r^2 = n_seen, and rho pi r'^2 = wanted
        ratio = np.sqrt(self.n_target / np.maximum(self.n_seen, 0.25))
        reach = np.clip(self.range * ratio, self.min_range, self.max_range)
        self._set_reach(reach if batch else float(reach))
        return report

    def _set_reach(self, reach: Any) -> None:
        self.range = reach
        if self.region_factor is not None:
            self.system.radius = self.region_factor * reach
