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
from slamlab.slam._covariance import Covariance, times
from slamlab.slam.ekf import Associate, Correction, EKFSlam, Names, as_names, with_pose

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
        known landmark outside the region is seen or the robot has driven `radius` - `reach`.
    reach : float, optional
        How far the sensor sees (m), at most `radius`; half of it if left out. A region that is
        left after `radius` - `reach` holds all that is seen in it. Chapter 16.

    Attributes
    ----------
    measures : str
        "looks": sets of simultaneous measurements of landmarks.
    motion, sensor
        As given.
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
        reach: float | None = None,
    ) -> None:
        self.radius, self.regions = as_scalar("radius", radius, 0.0), 1
        self._reach = None if reach is None else as_scalar("reach", reach, 0.0, self.radius)
        self._full = EKFSlam(motion, sensor, mean, cov, ids, associate=associate)
        self.motion, self.sensor = self._full.motion, self._full.sensor
        self._open(self._full.ids)
        self._entered = self.pose

    def __repr__(self) -> str:
        """Say where it is and how much it knows."""
        return f"CompressedEKFSlam({self.n_landmarks} landmarks, local={self.local!r})"

    # The region.

    @property
    def reach(self) -> float:
        """How far the sensor sees (m), as given; half of `radius` if it was not."""
        return self.radius / 2 if self._reach is None else self._reach

    def enter(self, ids: Names) -> None:
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

        O(n^2 k) for k numbers measured in the region. Read the returned filter, which is the same
        object each time; change it through this one only. The region stays the same.
        """
        local, full, accounts = self.local, self._full, self._accounts
        if accounts.is_untouched:
            return full
        a, N = with_pose(self._rows), len(full.mean)
        new = local.ids[len(self._rows) :]
        entries = with_pose(np.append(self._rows, full.n_landmarks + np.arange(len(new))))
        # P_ab, with zeros where a stands: what is added there is nothing.
        P_ab = full._P.rows(a)
        P_ab[:, a] = 0.0
        # P_bb - P_ba Psi P_ab by a square root of Psi, and x_b + P_ba theta.
        W = root(accounts.Psi)
        weights = (W**2).sum(0)
        told = weights > np.finfo(float).eps * weights.max()
        full._P.correct(times(W.T[told], P_ab))
        full._mean = np.append(full._mean + accounts.theta @ P_ab, np.zeros(2 * len(new)))
        # P_ab <- Phi P_ab, and a itself as the region says.
        rows = np.zeros((len(entries), len(full._mean)))
        rows[:, :N] = times(accounts.Phi, P_ab)
        rows[:, entries] = local.cov
        full._P.put(entries, rows)
        full._mean[entries], full._first = local.mean, full._mean
        full.unseen_for += accounts.predictions
        full._enrol(new)
        seen = (entries[3::2] - 3) // 2
        full.sightings[seen], full.unseen_for[seen] = local.sightings, local.unseen_for
        full.next_id = local.next_id
        self._open(local.ids)
        return full

    # A step, in the region.

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move the pose, as `EKFSlam.predict`."""
        self.local.predict(u, dt, control_cov)

    def update(
        self, z: ArrayLike, ids: Names | None = None, covs: ArrayLike | None = None
    ) -> Correction:
        """Correct by landmarks of the region and add new ones, as `EKFSlam.update`."""
        names = () if ids is None else as_names("ids", ids)
        outside = [n for n in names if n in self._known and n not in self.local._row_of]
        driven = np.hypot(*(self.local.pose - self._entered)[:2])
        if outside or driven > self.radius - self.reach:
            near = self.near(self.radius)
            self.enter([*dict.fromkeys([*near, *(n for n in names if n in self._known)])])
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
        self._accounts = _Accounts(full._P.block(a))
        self.local = EKFSlam(
            full.motion, full.sensor, full.mean[a], self._accounts, names, associate=full.associate
        )
        self.local.next_id = full.next_id  # new landmarks must not take names used elsewhere
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
