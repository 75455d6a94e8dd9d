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
from slamlab.gaussian import root
from slamlab.models import LandmarkSensor, MotionModel
from slamlab.slam._covariance import Covariance, downdate
from slamlab.slam.ekf import Associate, Correction, EKFSlam, as_names, entries_of, with_pose

__all__ = ["CompressedEKFSlam"]


class CompressedEKFSlam:
    """EKF-SLAM that touches only a region's landmarks in a step, and is exact all the same.

    The state falls in two: a, the pose and the landmarks of the region, and b, all others. As
    long as only landmarks of a are seen, b can wait: three small matrices remember what it will
    have to learn, and `settle` makes up for it.

    Parameters
    ----------
    motion, sensor, mean, cov, ids, associate
        As `EKFSlam`. The first region is the whole map. The association sees the region.
    radius : float, default inf
        A new region is entered, the point landmarks within `radius` (m) of the robot, when a
        known landmark outside the region is seen or the robot has driven half of `radius`.

    Attributes
    ----------
    measures : str
        "looks": sets of simultaneous measurements of landmarks.
    local : EKFSlam
        The filter of the region: its pose, landmarks and covariances are those of the full
        filter.
    regions : int
        How many regions have been entered.

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

    measures = "looks"

    def __init__(
        self,
        motion: MotionModel,
        sensor: LandmarkSensor,
        mean: ArrayLike,
        cov: ArrayLike | None = None,
        ids: Sequence[Hashable] = (),
        *,
        associate: Associate | None = None,
        radius: float = np.inf,
    ) -> None:
        self.radius, self.regions = as_scalar("radius", radius, 0.0), 1
        self._full = EKFSlam(motion, sensor, mean, cov, ids, associate=associate)
        self._open(self._full.ids)
        self._entered = self.pose

    def __repr__(self) -> str:
        """Say where it is and how much it knows."""
        return f"CompressedEKFSlam({self.n_landmarks} landmarks, local={self.local!r})"

    # The region.

    def enter(self, ids: Sequence[Hashable] | ArrayLike) -> None:
        """Settle and go on with these landmarks as the region.

        Parameters
        ----------
        ids : sequence of hashable
            Landmarks of the map. New ones join the region when they are first seen.

        Raises
        ------
        ValueError
            If a name is not in the map or comes twice; the region then stays as it was.
        """
        names = as_names("ids", ids)
        self.settle().rows_of(names)
        self._open(names)
        self._entered, self.regions = self.pose, self.regions + 1

    def near(self, radius: float) -> tuple[Hashable, ...]:
        """Settle, and return the ids of point landmarks within `radius` (m) of the robot.

        The region S_1 of P4, ready for `enter`.
        """
        radius = as_scalar("radius", radius, low=0.0)
        full = self.settle()
        close = np.hypot(*(full.landmarks - full.pose[:2]).T) <= radius
        return tuple(name for name, is_close in zip(full.ids, close, strict=True) if is_close)

    def settle(self) -> EKFSlam:
        """Bring the landmarks outside the region up to date and return the full filter.

        O(n^2 n_a) for n_a landmarks in the region. Read the returned filter, change it through
        this object only. The region stays the same.
        """
        local, full, accounts = self.local, self._full, self._accounts
        if accounts.is_untouched:
            return full
        a = with_pose(self._rows)
        outside = np.setdiff1d(np.arange(full.n_landmarks), self._rows)
        b, P = entries_of(outside), full.cov
        P_ab = P[np.ix_(a, b)]
        # P_bb - P_ba Psi P_ab by a square root of Psi, and x_b + P_ba theta.
        P_bb = P[np.ix_(b, b)]
        downdate(P_bb, root(accounts.Psi).T @ P_ab)
        cross = accounts.Phi @ P_ab
        P_bb = np.tril(P_bb) + np.tril(P_bb, -1).T
        mean = np.concatenate([local.mean, full.mean[b] + accounts.theta @ P_ab])
        # Back in the order in which the landmarks were met, new ones last.
        place = {name: k for k, name in enumerate(local.ids)}
        place |= {full.ids[row]: len(local.ids) + k for k, row in enumerate(outside)}
        order = np.array([place[name] for name in self.ids], dtype=int)
        waited = full.unseen_for[outside] + accounts.predictions
        entries = with_pose(order)
        P = np.block([[local.cov, cross], [cross.T, P_bb]])[np.ix_(entries, entries)]
        self._full = _filter(full, local.next_id, mean[entries], Covariance(P), self.ids)
        self._full.sightings = np.append(local.sightings, full.sightings[outside])[order]
        self._full.unseen_for = np.append(local.unseen_for, waited)[order]
        self._open(local.ids)
        return self._full

    # A step, in the region.

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move the pose, as `EKFSlam.predict`."""
        self.local.predict(u, dt, control_cov)

    def update(
        self,
        z: ArrayLike,
        ids: Sequence[Hashable | None] | ArrayLike | None = None,
        covs: ArrayLike | None = None,
    ) -> Correction:
        """Correct by landmarks of the region and add new ones, as `EKFSlam.update`."""
        names = () if ids is None else as_names("ids", ids)
        outside = self._known.difference(self.local.ids).intersection(names)
        driven = np.hypot(*(self.local.pose - self._entered)[:2])
        if outside or driven > self.radius / 2:
            near = self.near(self.radius)
            self.enter([*{*near, *self._known.intersection(names)}])
        return self.local.update(z, ids, covs)

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

    @property
    def landmarks(self) -> Array:
        """Estimated landmarks, shape (n, 2), in the order of `ids`; settles first."""
        return self.settle().landmarks

    def _open(self, names: Sequence[Hashable]) -> None:
        """Start a region at what the full filter says now."""
        full = self._full
        self._rows, self._known = full.rows_of(names), set(full.ids)
        a = with_pose(self._rows)
        self._accounts = _Accounts(full.cov[np.ix_(a, a)])
        self.local = _filter(full, full.next_id, full.mean[a], self._accounts, names)
        self.local.sightings = full.sightings[self._rows]
        self.local.unseen_for = full.unseen_for[self._rows]


class _Accounts(Covariance):
    """The covariance of a region, which keeps account of what the rest of the map must learn."""

    def __init__(self, P: Array) -> None:
        super().__init__(P)
        self.Phi, self.Psi, self.theta = np.eye(len(P)), np.zeros_like(P), np.zeros(len(P))
        self.predictions, self.is_untouched = 0, True

    def move(self, F: Array, Q: Array) -> None:
        super().move(F, Q)
        self.Phi[:3] = F @ self.Phi[:3]
        self.predictions, self.is_untouched = self.predictions + 1, False

    def correct(self, B: Array, **account: Any) -> None:
        super().correct(B)
        owed = account["W"] @ account["H"] @ self.Phi[account["i"]]
        self.Psi += owed.T @ owed
        self.theta += account["y"] @ owed
        self.Phi -= B.T @ owed
        self.is_untouched = False

    def append(self, G: Array, own: Array) -> None:
        super().append(G, own)
        self.Phi = np.concatenate([self.Phi, G @ self.Phi[:3]])
        self.is_untouched = False


def _filter(
    like: EKFSlam, next_id: int, mean: Array, P: Covariance, ids: Sequence[Hashable]
) -> EKFSlam:
    """Return a filter with another's models; new landmarks must not take names used elsewhere."""
    slam = EKFSlam(like.motion, like.sensor, mean, P, ids, associate=like.associate)
    slam.next_id = next_id
    return slam
