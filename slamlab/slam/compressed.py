"""Compressed EKF-SLAM: work in a local region, settle the rest of the map when you leave it.

Guivant and Nebot (2001); the repair of P4's "update only inside the local region S_1". The same
numbers as EKF-SLAM at a local price per step. Chapters 10 and 16.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_scalar
from slamlab.filters.kalman import Innovation
from slamlab.slam._triangle import downdate, mirror
from slamlab.slam.ekf import Arrivals, Associate, Correction, EKFSlam, _as_ids, times_H

__all__ = ["CompressedEKFSlam"]


class CompressedEKFSlam:
    """EKF-SLAM that touches only a region's landmarks in a step, and is exact all the same.

    The state falls in two: a, the pose and the landmarks of the region, and b, all others. As
    long as only landmarks of a are seen, b learns nothing that could not wait: three small
    matrices remember what it is owed, and `settle` pays.

    Parameters
    ----------
    motion, sensor, mean, cov, ids
        As `EKFSlam`. The first region is the whole map.

    Attributes
    ----------
    local : EKFSlam
        The filter of the region: its pose, landmarks and covariances are those of the full
        filter. Association works on it.

    Notes
    -----
    With F and H of the region alone, and a0 the region's state when it was entered:
    P_ab = Phi P_a0b, P_bb = P_b0b0 - P_b0a0 Psi P_a0b, x_b = x_b0 + P_b0a0 theta, where a
    prediction makes Phi <- F Phi, and an update Psi <- Psi + Phi^T H^T S^-1 H Phi,
    theta <- theta + Phi^T H^T S^-1 v, Phi <- (I - K H) Phi.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> slam = CompressedEKFSlam(Unicycle(), RangeBearing(0.1, 0.02), [0, 0, 0])
    >>> _ = slam.update([[2.0, 0.0], [9.0, 0.3]], ids=["near", "far"])
    >>> slam.enter(["near"])
    >>> slam.predict([0.5, 0.0], 1.0, [[0.04, 0], [0, 0.01]])
    >>> _ = slam.update([[1.5, 0.0]], ids=["near"])
    >>> len(slam.local.mean), len(slam.settle().mean)
    (5, 7)
    """

    def __init__(
        self,
        motion: Any,
        sensor: Any,
        mean: ArrayLike,
        cov: ArrayLike | None = None,
        ids: Sequence[Hashable] = (),
    ) -> None:
        self._full = EKFSlam(motion, sensor, mean, cov, ids)
        self._open(self._full.ids)

    # The region.

    def enter(self, ids: Sequence[Hashable] | ArrayLike) -> None:
        """Settle what is owed and go on with these landmarks as the region.

        Parameters
        ----------
        ids : sequence of hashable
            Landmarks of the map. New ones join the region when they are first seen.

        Raises
        ------
        ValueError
            If a name is not in the map or comes twice; the region then stays as it was.
        """
        full = self.settle()
        names = [full.ids[row] for row in full._known_rows(_as_ids("ids", ids))]
        if len(set(names)) < len(names):
            raise ValueError(f"ids: expected every landmark once, got {names!r}")
        self._open(tuple(names))

    def near(self, radius: float) -> tuple[Hashable, ...]:
        """Settle, and return the ids of point landmarks within `radius` (m) of the robot.

        The region S_1 of P4, ready for `enter`.
        """
        radius = as_scalar("radius", radius, low=0.0)
        full = self.settle()
        away = full.landmarks - full.pose[:2]
        close = np.hypot(away[:, 0], away[:, 1]) <= radius
        return tuple(name for name, is_close in zip(full.ids, close, strict=True) if is_close)

    def settle(self) -> EKFSlam:
        """Bring the landmarks outside the region up to date and return the full filter.

        O(n^2 n_a) for n_a landmarks in the region. The returned filter is a view of the state:
        read it, change it through this object only. The region stays the same.
        """
        local, full = self.local, self._full
        if local.is_untouched:
            return full
        b = np.setdiff1d(np.arange(len(full.mean)), self._entries)
        P_ab = full._pairs(self._entries[:, None], b[None, :])
        # What b is owed: its covariance by a square root of Psi, its mean by theta.
        values, vectors = np.linalg.eigh(local.Psi)
        B = (vectors * np.sqrt(np.clip(values, 0.0, None))).T @ P_ab
        P_bb = np.ascontiguousarray(full._P[np.ix_(b, b)])
        downdate(P_bb, B)
        mirror(P_bb)
        mean_b = full.mean[b] + local.theta @ P_ab
        cross = local.Phi @ P_ab
        self._write(mean_b, np.block([[local.cov, cross], [cross.T, P_bb]]))
        self._open(local.ids)
        return self._full

    # A step, in the region.

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move the pose, as `EKFSlam.predict`."""
        self.local.predict(u, dt, control_cov)

    def update(
        self, z: ArrayLike, ids: Sequence[Hashable] | ArrayLike, covs: ArrayLike | None = None
    ) -> Innovation:
        """Correct by landmarks of the region and add new ones, as `EKFSlam.update`.

        Raises
        ------
        ValueError
            As `EKFSlam.update`, or if a landmark of the map lies outside the region.
        """
        self._refuse_outside(ids)
        return self.local.update(z, ids, covs)

    def step(
        self,
        u: ArrayLike,
        dt: float,
        control_cov: ArrayLike,
        z: ArrayLike,
        associate: Associate | Sequence[Hashable] | ArrayLike | None = None,
        covs: ArrayLike | None = None,
    ) -> tuple[Hashable | None, ...]:
        """Predict, associate within the region, update, as `EKFSlam.step`."""
        if associate is not None and not callable(associate):
            self._refuse_outside(associate)
        return self.local.step(u, dt, control_cov, z, associate, covs)

    @property
    def pose(self) -> Array:
        """Estimated pose (m, m, rad), shape (3,); always up to date."""
        return self.local.pose

    @property
    def pose_cov(self) -> Array:
        """Covariance of the pose, shape (3, 3); always up to date."""
        return self.local.pose_cov

    @property
    def ids(self) -> tuple[Hashable, ...]:
        """Names of all landmarks of the map, those of the region included."""
        return (*self._full.ids, *(name for name in self.local.ids if name not in self._known))

    @property
    def n_landmarks(self) -> int:
        """Number of landmarks of the map."""
        return len(self.ids)

    # Inside.

    def _open(self, names: tuple[Hashable, ...]) -> None:
        """Start a region at what the full filter says now."""
        full = self._full
        rows = full._known_rows(names)
        landmarks = (3 + 2 * rows[:, None] + np.arange(2)).ravel()
        self._entries = np.concatenate([np.arange(3), landmarks])
        self._known, self._rows = set(full.ids), rows
        self.local = _Region(full, self._entries, names)

    def _write(self, mean_b: Array, P: Array) -> None:
        """Give the full filter the state (a, b), in its own order, new landmarks last."""
        local, full = self.local, self._full
        outside = np.setdiff1d(np.arange(full.n_landmarks), self._rows)
        names = [*local.ids, *(full.ids[row] for row in outside)]
        place = {name: k for k, name in enumerate(names)}
        order = np.array([place[name] for name in self.ids], dtype=np.intp)
        entries = np.concatenate(
            [np.arange(3), (3 + 2 * order[:, None] + np.arange(2)).ravel()]
        ).astype(np.intp)
        mean = np.concatenate([local.mean, mean_b])[entries]
        waited = full.unseen_for[outside] + local.predictions
        full._replace(
            mean,
            P[np.ix_(entries, entries)],
            self.ids,
            np.concatenate([local.sightings, full.sightings[outside]])[order],
            np.concatenate([local.unseen_for, waited])[order],
        )

    def _refuse_outside(self, ids: Any) -> None:
        outside = [
            n for n in _as_ids("ids", ids) if n in self._known and n not in self.local._row_of
        ]
        if outside:
            raise ValueError(
                f"ids: expected landmarks of the region or new ones, got {outside}; "
                "enter a region that holds them first"
            )


class _Region(EKFSlam):
    """The filter of a region, which keeps account of what the rest of the map is owed."""

    def __init__(self, full: EKFSlam, entries: Any, names: tuple[Hashable, ...]) -> None:
        super().__init__(full.motion, full.sensor, np.zeros(3))
        rows = (entries[3::2] - 3) // 2
        P = full._pairs(entries[:, None], entries[None, :])
        self._replace(full.mean[entries], P, names, full.sightings[rows], full.unseen_for[rows])
        # A new landmark must not take the name of one outside.
        self._next_id = full._first_free_id()
        self.Phi, self.Psi = np.eye(len(entries)), np.zeros((len(entries), len(entries)))
        self.theta = np.zeros(len(entries))
        self.predictions, self.is_untouched = 0, True

    def _move(self, pose: Array, F_x: Array, Q: Array) -> None:
        super()._move(pose, F_x, Q)
        self.Phi[:3] = F_x @ self.Phi[:3]
        self.predictions, self.is_untouched = self.predictions + 1, False

    def _correct(self, correction: Correction) -> None:
        rows = correction.rows
        if len(rows):
            i = np.concatenate([np.arange(3), (3 + 2 * rows[:, None] + np.arange(2)).ravel()])
            H_Phi = times_H(correction.H_pose, correction.H_landmark, self.Phi[i])
            owed = correction.whiten @ H_Phi
            self.Psi += owed.T @ owed
            self.theta += correction.white @ owed
            self.Phi -= correction.B.T @ owed
            self.is_untouched = False
        super()._correct(correction)

    def _augment(self, new: Arrivals) -> None:
        super()._augment(new)
        self.Phi = np.concatenate([self.Phi, new.G_pose.reshape(-1, 3) @ self.Phi[:3]])
        self.is_untouched = False
