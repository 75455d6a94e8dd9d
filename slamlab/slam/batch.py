"""Many EKF-SLAM filters at once: M runs of the same drive with other noise, in one array.

The Monte Carlo behind chapters 09 and 10: what a model that is a little wrong does to the error
and to the belief in it. One run of it is `EKFSlam`, number for number; tests hold that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_count, as_covariance, as_shaped
from slamlab.geometry import wrap_angle
from slamlab.models import LandmarkSensor, MotionModel, as_motion, as_sensor
from slamlab.slam.linearisation import as_linearisation, fej_jacobian, reset_covariance, retract

__all__ = ["Innovation", "EKFSlamBatch"]

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Innovation:
    """What an update learned in each of M runs.

    Attributes
    ----------
    nis : ndarray, shape (M,)
        Squared, weighted innovation of the landmarks known before.
    dof : ndarray of int, shape (M,)
        What is expected: two for each of these landmarks.
    """

    nis: Array
    dof: NDArray[np.intp]


class EKFSlamBatch:
    """EKF-SLAM in M runs side by side, with known landmark identities.

    The contract is that of `EKFSlam` with a leading axis M. Landmark i has its place in the state
    from the beginning, and counts from its first sighting on.

    Parameters
    ----------
    motion : MotionModel
    sensor : LandmarkSensor
    mean : array_like, shape (M, 3)
        Poses at the start (m, m, rad).
    cov : array_like, shape (3, 3), optional
        Covariance of each; zero if left out.
    n_landmarks : int
        Number n of landmarks that may be seen.
    linearisation : {"standard", "first-estimates", "invariant"}
        As `EKFSlam`.

    Attributes
    ----------
    measures : str
        "landmarks": sets of simultaneous measurements of landmarks.
    ids : tuple of int
        0 to n - 1.
    known : ndarray of bool, shape (M, n)
        Which landmarks have been seen.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> slam = EKFSlamBatch(Unicycle(), RangeBearing(0.1, 0.02), np.zeros((2, 3)), n_landmarks=1)
    >>> _ = slam.update([[[2.0, 0.0]], [[np.nan, np.nan]]], ids=[0])
    >>> slam.known[:, 0].tolist(), slam.landmarks[:, 0].tolist()
    ([True, False], [[2.0, 0.0], [nan, nan]])
    """

    measures = "landmarks"

    def __init__(
        self,
        motion: MotionModel,
        sensor: LandmarkSensor,
        mean: ArrayLike,
        cov: ArrayLike | None = None,
        *,
        n_landmarks: int,
        linearisation: str = "standard",
    ) -> None:
        self.motion, self.sensor = as_motion("motion", motion), as_sensor("sensor", sensor)
        self.linearisation = as_linearisation(linearisation, sensor)
        pose, n = as_array("mean", mean, ("M", 3)), as_count("n_landmarks", n_landmarks)
        self.ids, self._runs = tuple(range(n)), np.arange(len(pose))
        self.known = np.zeros((len(pose), n), dtype=bool)
        self._mean, N = np.hstack([pose, np.zeros((len(pose), 2 * n))]), 3 + 2 * n
        self._mean[:, 2] = wrap_angle(pose[:, 2])
        self._P, self._first = np.zeros((len(pose), N, N)), self._mean.copy()
        if cov is not None:
            self._P[:, :3, :3] = as_covariance("cov", cov, 3)

    def __repr__(self) -> str:
        """Say how many there are and how much they know."""
        runs, n = self.known.shape
        seen = f"{self.known.sum(1).mean():.1f} of {n} landmarks seen"
        return f"{type(self).__name__}({runs} runs, {seen}, linearisation={self.linearisation!r})"

    @property
    def pose(self) -> Array:
        """Estimated poses (m, m, rad), shape (M, 3)."""
        return self._mean[:, :3].copy()

    @property
    def pose_cov(self) -> Array:
        """Covariances of the poses, shape (M, 3, 3)."""
        return self._P[:, :3, :3].copy()

    @property
    def landmarks(self) -> Array:
        """Estimated landmarks, shape (M, n, 2); NaN where one was never seen."""
        return np.where(self.known[..., None], self._landmarks, np.nan)

    @property
    def landmark_covs(self) -> Array:
        """Covariances of the single landmarks, shape (M, n, 2, 2)."""
        i = _entries(np.arange(len(self.ids)))
        return self._P[:, i[:, :, None], i[:, None, :]]

    @property
    def _landmarks(self) -> Array:
        return self._mean[:, 3:].reshape(*self.known.shape, 2)

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """P1 (8), (11), (14) in all runs, as `EKFSlam.predict`; u (l,) or (M, l)."""
        u, pose = as_array("u", u, ("...", "l")), self._mean[:, :3]
        V = as_covariance("control_cov", control_cov, u.shape[-1])
        F, G = self.motion.jacobians(pose, u, dt)
        moved = self.motion.step(pose, u, dt)
        self.move_cov(fej_jacobian(F, pose, self._first, self.linearisation), G @ V @ G.mT)
        self._mean[:, :3] = self._first[:, :3] = moved

    def move_cov(self, F: Array, Q: Array) -> None:
        """P1 (11): the covariance of the pose and its cross-covariance with the map."""
        P = self._P
        P[:, :3] = F @ P[:, :3]
        P[:, :, :3] = P[:, :, :3] @ F.mT
        P[:, :3, :3] += Q

    def update(self, z: ArrayLike, ids: ArrayLike | None = None) -> Innovation:
        """Correct by the landmarks known already, then add the new ones, in all runs.

        Parameters
        ----------
        z : array_like, shape (M, k, 2)
            Measurements; NaN where a run did not see the landmark.
        ids : array_like of int, shape (k,)
            Which landmark each column belongs to, each once; always needed.
        """
        z = self._as_measurements(z, ids)
        seen = np.isfinite(z).all(-1)
        known, new = seen & self.known, seen & ~self.known
        # Side by side (M, m): runs that see fewer landmarks than others get rows of zeros.
        m = int(known.sum(1).max(initial=0))
        run, rows = self._runs[:, None], np.argsort(~known, axis=1, kind="stable")[:, :m]
        counts = known[run, rows]

        pose, landmarks = self._mean[:, None, :3], self._somewhere(self._mean, rows, counts)
        predicted = self.sensor.observe(pose, landmarks)  # (18)
        z_known = np.where(counts[..., None], z[run, rows], predicted)
        v = self.sensor.residual(z_known, predicted).reshape(len(z), 2 * m, 1)  # (19)
        i, H = self._jacobian(rows, counts)  # (22)-(32)
        HP = H @ self._P[run, i]
        S = np.take_along_axis(HP, i[:, None, :], 2) @ H.mT  # (33)
        S.reshape(len(z), m, 2, m, 2)[:, np.arange(m), :, np.arange(m)] += self.sensor.cov
        white = np.linalg.solve(np.linalg.cholesky(S), np.concatenate([v, HP], 2))
        y, B = white[..., :1], white[..., 1:]  # (34): K = B^T L^-1 with S = L L^T
        mean, reset = retract(self._mean, (B.mT @ y)[..., 0], self.linearisation)  # (35)
        k, runs = np.nonzero(new.T)
        points, G, noise = self._new_landmarks(mean[runs, :3], z[runs, k], runs)  # (37)-(42)

        # Nothing can fail any more.
        self._mean = mean
        self._P -= B.mT @ B  # (36): K S K^T = B^T B
        if reset is not None:
            # One run at a time stays in the cache: twice as fast as one block of all.
            for P, a in zip(self._P, reset, strict=True):
                reset_covariance(P, a)
        # (43), one landmark at a time in all the runs that see it first.
        for one in np.unique(k):
            first = k == one
            self._append(int(one), runs[first], points[first], G[first], noise[first])
        return Innovation((y**2).sum((1, 2)), 2 * counts.sum(1))

    def _somewhere(self, state: Array, rows: Rows, counts: NDArray[np.bool_]) -> Array:
        """Landmarks (M, m, 2) of a state; those that do not count stand in no one's way."""
        landmarks = state[:, 3:].reshape(*self.known.shape, 2)[self._runs[:, None], rows]
        return np.where(counts[..., None], landmarks, state[:, None, :2] + 10.0)

    def _jacobian(self, rows: Rows, counts: NDArray[np.bool_]) -> tuple[Rows, Array]:
        """Jacobians H (M, 2m, 3 + 2m) by the entries i (M, 3 + 2m) of the state."""
        at = self._first if self.linearisation == "first-estimates" else self._mean
        (M, m), k = rows.shape, np.arange(rows.shape[1])
        H_pose, H_landmark = self.sensor.jacobians(
            at[:, None, :3], self._somewhere(at, rows, counts)
        )
        H = np.zeros((M, m, 2, 3 + 2 * m))
        H[..., :3] = H_pose
        H[..., 3:].reshape(M, m, 2, m, 2)[:, k, :, k] = H_landmark.swapaxes(0, 1)
        i = np.hstack([np.tile(np.arange(3), (M, 1)), _entries(rows).reshape(M, 2 * m)])
        return i, (H * counts[..., None, None]).reshape(M, 2 * m, 3 + 2 * m)

    def _new_landmarks(self, pose: Array, z: Array, runs: Rows) -> tuple[Array, Array, Array]:
        """P1 (37)-(42) of c new landmarks: (c, 2), Jacobians by the pose (c, 2, 3), noise."""
        G_pose, G_z = self.sensor.locate_jacobians(pose, z)
        G = fej_jacobian(G_pose, pose, self._first[runs], self.linearisation)
        return self.sensor.locate(pose, z), G, G_z @ self.sensor.cov @ G_z.mT

    def _append(self, k: int, runs: Rows, points: Array, G: Array, noise: Array) -> None:
        """P1 (43): landmark k appears in `runs`, and is correlated with all others."""
        i = slice(3 + 2 * k, 5 + 2 * k)
        self._mean[runs, i] = self._first[runs, i] = points
        cross = G @ self._P[runs, :3, :]
        self._P[runs, i, :], self._P[runs, :, i] = cross, cross.mT
        self._P[runs, i, i] = cross[..., :3] @ G.mT + noise
        self.known[runs, k] = True

    def _as_measurements(self, z: ArrayLike, ids: ArrayLike | None) -> Array:
        """Measurements (M, n, 2) of all landmarks, NaN where one was not seen."""
        runs, n = self.known.shape
        names = np.asarray([] if ids is None else ids)
        if ids is None or names.ndim != 1 or (names.size and names.dtype.kind not in "iu"):
            raise ValueError(f"ids: expected whole numbers, one for each column of z, got {ids!r}")
        if ((names < 0) | (names >= n)).any() or len(np.unique(names)) < len(names):
            raise ValueError(f"ids: expected different landmarks of {n}, got {names.tolist()}")
        z = as_shaped("z", z, (runs, len(names), 2))
        whole = np.full((runs, n, 2), np.nan)
        whole[:, names.astype(int)] = z
        return whole


def _entries(rows: Rows) -> Rows:
    """Places (..., 2) of landmarks in the state."""
    return 3 + 2 * rows[..., None] + np.arange(2)
