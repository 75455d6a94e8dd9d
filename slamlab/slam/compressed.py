"""Compressed EKF-SLAM: work in a local region, settle the rest of the map when you leave it.

Guivant and Nebot (2001); the repair of P4's "update only inside the local region S_1". The same
numbers as EKF-SLAM at a local price per step. Chapters 10 and 16.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_landmarks, as_names, as_scalar
from slamlab.gaussian import matrix_sqrt
from slamlab.models import LandmarkSensor, MotionModel
from slamlab.slam.ekf import Associate, EKFSlam, Innovation, Names, downdate, entries

__all__ = ["CompressedEKFSlam"]


class CompressedEKFSlam:
    """EKF-SLAM that touches only a region's landmarks in a step, and is exact all the same.

    The state falls in two: a, the pose and the landmarks of the region, and b, all others. As
    long as only landmarks of a are seen, b can wait: three small matrices remember what it will
    have to learn, and `global_update` makes up for it.

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
        "landmarks": sets of simultaneous measurements of landmarks.
    motion, sensor
        As given.
    local : EKFSlam
        The filter of the region: its pose, landmarks and covariances are those of the full
        filter.
    n_regions : int
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
    >>> slam.set_region(["near"])
    >>> slam.predict([0.5, 0.0], 1.0, [[0.04, 0], [0, 0.01]])
    >>> _ = slam.update([[1.5, 0.0]], ids=["near"])
    >>> len(slam.local.mean), len(slam.global_update().mean)
    (5, 7)
    """

    measures = "landmarks"

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
        self.radius, self.n_regions = as_scalar("radius", radius, 0.0), 1
        self._reach = None if reach is None else as_scalar("reach", reach, 0.0, self.radius)
        self._full = EKFSlam(motion, sensor, mean, cov, ids, associate=associate)
        self.motion, self.sensor = self._full.motion, self._full.sensor
        self._open(self._full.ids)
        self._entered = self.pose

    def __repr__(self) -> str:
        """Say where it is and how much it knows."""
        return f"CompressedEKFSlam({self.n_landmarks} landmarks, local={self.local!r})"

    # The region.

    def _open(self, names: Sequence[Hashable]) -> None:
        """Start a region at what the full filter says now."""
        full, rows = self._full, self._full.rows_of(names)
        a = entries(rows)
        self.local = EKFSlam(
            full.motion, full.sensor, full._x[a], ids=names, associate=full.associate
        )
        self.local._P = full._P[np.ix_(a, a)]
        self.local.next_id = full.next_id  # new landmarks must not take names used elsewhere
        self.local.n_observations = full.n_observations[rows]
        self.local.steps_since_observed = full.steps_since_observed[rows]
        self._Phi, self._Psi = np.eye(len(a)), np.zeros((len(a), len(a)))
        self._theta = np.zeros(len(a))
        self._is_settled = True

    @property
    def reach(self) -> float:
        """How far the sensor sees (m), as given; half of `radius` if it was not."""
        return self.radius / 2 if self._reach is None else self._reach

    def set_region(self, ids: Names) -> None:
        """Settle and go on with these landmarks as the region.

        Parameters
        ----------
        ids : sequence of hashable
            Landmarks of the map, each once. New ones join the region when they are first seen.
        """
        names = as_names("ids", ids)
        self.global_update().rows_of(names)
        self._open(names)
        self._entered, self.n_regions = self.pose, self.n_regions + 1

    def landmarks_within(self, radius: float) -> tuple[Hashable, ...]:
        """Settle, and return the ids of point landmarks within `radius` (m) of the robot.

        The region S_1 of P4, ready for `set_region`.
        """
        radius = as_scalar("radius", radius, low=0.0)
        full = self.global_update()
        close = np.hypot(*(full.landmarks - full.pose[:2]).T) <= radius
        return tuple(name for name, is_close in zip(full.ids, close, strict=True) if is_close)

    def global_update(self) -> EKFSlam:
        """Bring the landmarks outside the region up to date and return the full filter.

        O(n^2 k) for k numbers measured in the region. Read the returned filter, which is the same
        object each time; change it through this one only. The region stays the same.
        """
        local, full = self.local, self._full
        if self._is_settled:
            return full
        known = [name for name in local.ids if name in full._row_of]
        a = entries(full.rows_of(known))
        P_ab = full._P[a]
        P_ab[:, a] = 0.0  # b alone: a is as the region says
        full._x = full._x + self._theta @ P_ab  # x_b + P_ba theta
        downdate(full._P, matrix_sqrt(self._Psi).T @ P_ab)  # P_bb - P_ba Psi P_ab
        # New landmarks of the region come in behind b.
        N, new = len(full._x), local.ids[len(known) :]
        m = 2 * len(new)
        full._append(new, local._x[len(a) :], np.zeros((m, 3)), np.zeros((m, m)))
        a = np.append(a, np.arange(N, len(full._x)))
        full._P[a, :N] = self._Phi @ P_ab  # P_ab <- Phi P_ab
        full._P[:N, a] = full._P[a, :N].T
        full._P[np.ix_(a, a)], full._x[a] = local._P, local._x
        full._first = full._x
        rows = (a[3::2] - 3) // 2
        full.n_observations[rows] = local.n_observations
        full.steps_since_observed[rows] = local.steps_since_observed
        full.next_id = local.next_id
        self._open(local.ids)
        return full

    # A step, in the region.

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move the pose, as `EKFSlam.predict`: Phi <- F Phi."""
        F, _ = self.motion.jacobians(self.local._x[:3], u, dt)  # at the old estimate
        self.local.predict(u, dt, control_cov)
        self._Phi[:3] = F @ self._Phi[:3]
        self._full.steps_since_observed += 1
        self._is_settled = False

    def update(
        self, z: ArrayLike, ids: Names | None = None, covs: ArrayLike | None = None
    ) -> Innovation:
        """Correct by landmarks of the region and add new ones, as `EKFSlam.update`."""
        z, _ = as_landmarks(z, covs, self.sensor.cov)  # refused before the region changes
        names = () if ids is None else as_names("ids", ids, len(z))
        outside = any(n in self._full._row_of and n not in self.local._row_of for n in names)
        driven = np.hypot(*(self.local._x[:2] - self._entered[:2]))
        if outside or driven > self.radius - self.reach:
            near = self.landmarks_within(self.radius)
            known = [name for name in names if name in self._full._row_of]
            self.set_region(list(dict.fromkeys([*near, *known])))
        report = self.local.update(z, ids, covs)
        owed = report.W @ report.H @ self._Phi[report.i]  # W H Phi
        self._Psi += owed.T @ owed  # Phi^T H^T S^-1 H Phi
        self._theta += report.W @ report.innovation @ owed  # Phi^T H^T S^-1 v
        self._Phi -= report.B.T @ owed  # (I - K H) Phi
        # New landmarks are correlated with b through the pose.
        self._Phi = np.concatenate([self._Phi, report.G @ self._Phi[:3]])
        self._is_settled = False
        return report

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
        known = self._full._row_of
        return (*self._full.ids, *(name for name in self.local.ids if name not in known))

    @property
    def n_landmarks(self) -> int:
        """Number of landmarks of the map."""
        return len(self.ids)

    @property
    def landmarks(self) -> Array:
        """Estimated landmarks, shape (n, 2), in the order of `ids`; settles first."""
        return self.global_update().landmarks
