"""EKF-SLAM: one Gaussian over the pose and all landmarks, corrected by every set of observations.

P1 (1)-(8), (11), (14), (19), (33)-(43) repaired, P2 (6)-(11): predict, update, add a landmark.
Chapter 09 derives it, chapter 10 asks what it costs and whether it may be believed.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from math import isfinite, log, pi

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.blas import dsyrk
from scipy.linalg.lapack import dpotrf, dtrtri

from slamlab._checks import (
    Array,
    all_finite,
    as_array,
    as_associations,
    as_count,
    as_landmarks,
    as_names,
    as_one_covariance,
    as_rows,
)
from slamlab.gaussian import block_diagonal
from slamlab.geometry import wrap_angle
from slamlab.models import LandmarkSensor, MotionModel, as_motion, as_sensor
from slamlab.slam.association import IGNORED, NEW, nearest_neighbour
from slamlab.slam.linearisation import as_linearisation, fej_jacobian, reset_covariance, retract

__all__ = ["Innovation", "EKFSlam"]

Rows = NDArray[np.intp]
Associate = Callable[..., ArrayLike]
Names = Sequence[Hashable | None] | ArrayLike
POSE = np.arange(3)


@dataclass(frozen=True, eq=False)
class Innovation:
    """What an update learned, all measurements stacked, and the names given.

    Attributes
    ----------
    innovation : ndarray, shape (2m,)
        Innovation of the m landmarks known before, P1 (19).
    S : ndarray, shape (2m, 2m)
        Its covariance S, P1 (33).
    nis : float
        Normalised innovation squared.
    ids : tuple
        Landmark of each measurement, None if it was left out.
    i : ndarray of int, shape (3 + 2m,)
        Entries of the state that were measured: the pose and the m landmarks.
    H : ndarray, shape (2m, 3 + 2m)
        Jacobian by these, P1 (22)-(32).
    W : ndarray, shape (2m, 2m)
        Root of the inverse of S: W^T W = S^-1.
    B : ndarray, shape (2m, 3 + 2n)
        W H P: the covariance loses B^T B.
    G : ndarray, shape (2k, 3)
        Jacobian of the k new landmarks by the pose, P1 (39).
    """

    innovation: Array
    S: Array
    nis: float
    ids: tuple[Hashable | None, ...]
    i: Rows = field(repr=False)
    H: Array = field(repr=False)
    W: Array = field(repr=False)
    B: Array = field(repr=False)
    G: Array = field(repr=False)

    @property
    def gain(self) -> Array:
        """Kalman gain K = P H^T S^-1, P1 (34), shape (3 + 2n, 2m)."""
        return self.B.T @ self.W

    @property
    def log_likelihood(self) -> float:
        """Log density of the measurement, as predicted."""
        W = self.W
        return float(np.log(W.diagonal()).sum() - 0.5 * (self.nis + len(W) * log(2 * pi)))


class EKFSlam:
    """EKF-SLAM with known landmarks or with an association of your choice.

    The state is P1 (4): pose (x, y, theta), then two numbers a landmark, in the order in which
    the landmarks were met. What the two numbers mean is the sensor's affair: a point (x, y) with
    `RangeBearing`, a wall (r, alpha) with `Wall`.

    A prediction costs O(n) and an update O(n^2) for n landmarks.

    Parameters
    ----------
    motion : MotionModel
    sensor : LandmarkSensor
    mean : array_like, shape (3 + 2n,)
        Pose (m, m, rad) and, if a map is known beforehand, its n landmarks.
    cov : array_like, shape (3 + 2n, 3 + 2n), optional
        Covariance of `mean`; zero if left out: the robot starts where the map begins. Nothing
        has to be invertible, whatever P1 says after its (5): S = H P H^T + R is.
    ids : sequence of hashable, default ()
        Names of the n landmarks in `mean`, each once.
    associate : callable, optional
        ``associate(slam, z) -> rows (k,)``, asked when an update comes without ids: for each
        measurement the row of `landmarks`, -1 to start a new landmark, -2 to leave it out. If
        an update comes with covariances, also ``covs=`` (k, 2, 2). Left out: nearest neighbour
        with a Mahalanobis gate of 99 %.
    linearisation : {"standard", "first-estimates", "invariant"}
        Where the Jacobians are taken. At the latest estimate, as P1 and P2 do, the filter comes
        to believe that it knows its heading though nothing measured it. With first estimates
        (Huang, Mourikis and Roumeliotis 2008), or in the coordinates of a right-invariant error
        (Barrau and Bonnabel 2015; landmarks must be points), it does not.

    Attributes
    ----------
    measures : str
        "landmarks": sets of simultaneous measurements of landmarks.
    motion, sensor, associate, linearisation
        As given.
    ids : tuple
        Names of the landmarks in the order of the state.
    n_observations : ndarray of int, shape (n,)
        How often each landmark has been seen, the first time included.
    steps_since_observed : ndarray of int, shape (n,)
        Predictions since each landmark was last seen.
    next_id : int
        Name of the next landmark that the association starts.

    Examples
    --------
    A landmark two metres ahead, seen, then seen again half a metre later:

    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> slam = EKFSlam(Unicycle(), RangeBearing(0.1, 0.02), [0, 0, 0])
    >>> _ = slam.update([[2.0, 0.0]], ids=[7])
    >>> slam.predict([0.5, 0.0], 1.0, control_cov=[[0.04, 0], [0, 0.01]])
    >>> innovation = slam.update([[1.5, 0.0]], ids=[7])
    >>> slam.ids, slam.landmarks.round(3).tolist(), round(float(innovation.nis), 3)
    ((7,), [[2.0, 0.0]], 0.0)
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
        linearisation: str = "standard",
    ) -> None:
        self.motion, self.sensor = as_motion("motion", motion), as_sensor("sensor", sensor)
        self.associate: Associate = nearest_neighbour if associate is None else associate
        self.linearisation = as_linearisation(linearisation, sensor)
        self.ids: tuple[Hashable, ...] = as_names("ids", ids)
        n, N = len(self.ids), 3 + 2 * len(self.ids)
        self._x = as_array("mean", mean, (N,)).astype(float)  # (4)
        self._x[2] = wrap_angle(self._x[2])
        self._P = np.zeros((N, N)) if cov is None else as_one_covariance("cov", cov, N)  # (7)
        self._first = self._x.copy()  # where "first-estimates" takes its Jacobians
        self._row_of = {name: row for row, name in enumerate(self.ids)}
        self.n_observations, self.steps_since_observed = np.ones(n, int), np.zeros(n, int)
        self.next_id = 1 + max([-1, *(name for name in self.ids if isinstance(name, int))])

    # The three stages of P1.

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Stage 1: move the pose; the landmarks stay where they are. O(n).

        Call it once a step.

        Parameters
        ----------
        u : array_like, shape (l,)
            Control as the motion model takes it.
        dt : float
            Duration (s).
        control_cov : array_like, shape (l, l)
            V of P1 (15): covariance of the control.
        """
        u = as_array("u", u, ("l",))
        V = as_one_covariance("control_cov", control_cov, len(u))

        F, G = self.motion.jacobians(self._x[:3], u, dt)  # (12), (13): at the old estimate
        moved = self.motion.step(self._x[:3], u, dt)  # (8), P2 (8)
        Q = G @ V @ G.T  # (14)
        if not all_finite(Q):
            raise ValueError(f"control_cov: expected a finite motion noise, got {Q.tolist()}")
        F = fej_jacobian(F, self._x, self._first, self.linearisation)

        P = self._P
        P[:3] = F @ P[:3]  # (11), P2 (9): the pose and its covariance with the map
        P[:3, :3] = symmetric(P[:3, :3] @ F.T + Q)
        P[3:, :3] = P[:3, 3:].T
        self._x[:3] = self._first[:3] = moved
        self.steps_since_observed += 1

    def update(
        self, z: ArrayLike, ids: Names | None = None, covs: ArrayLike | None = None
    ) -> Innovation:
        """Stages 2 and 3: correct by the landmarks known already, then add the new ones.

        All landmarks known already are one block: one O(n^2) correction however many were seen.
        New landmarks are placed from the corrected pose.

        Parameters
        ----------
        z : array_like, shape (k, 2)
            Measurements of k different landmarks, as the sensor gives them.
        ids : sequence of hashable, length k, optional
            Which landmark each one belongs to. A name never seen adds a landmark, None leaves
            the measurement out. Left out altogether: `associate` tells.
        covs : array_like, shape (2, 2) or (k, 2, 2), optional
            Covariances R of the measurements, if they are not the sensor's `cov`: a wall seen
            over its full length is known better than a stump of it.

        Returns
        -------
        Innovation
            What the m landmarks known before were off by.

        Raises
        ------
        ValueError
            If the correction overflows. The filter is then as it was.
        """
        z, R = as_landmarks(z, covs, self.sensor.cov)
        names = as_names("ids", self._associated(z, R, covs) if ids is None else ids, len(z))
        rows = np.array([self._row_of.get(n, IGNORED if n is None else NEW) for n in names], int)
        known, new, rows = rows >= 0, rows == NEW, rows[rows >= 0]

        predicted = self.sensor.observe(self._x[:3], self._landmarks[rows])  # (18)
        v = self.sensor.residual(z[known], predicted).ravel()  # (19), wrapped
        i, H = self._jacobian(rows)  # (22)-(32): zero but in the columns i
        HP = H @ self._P[i]
        S = HP[:, i] @ H.T + block_diagonal(R[known])  # (33)
        W = inverse_root(S)  # S^-1 = W^T W
        B, y = W @ HP, W @ v  # (34): K = P H^T S^-1 = B^T W
        change = y @ B
        if not all_finite(change):
            raise ValueError("z: expected measurements that can be weighed, the update overflows")
        x, reset = retract(self._x, change, self.linearisation)  # (35): x + K v
        points, G, noise = self._new_landmarks(x[:3], z[new], R[new])  # (37)-(42)

        # Nothing can fail any more.
        self._x = x
        downdate(self._P, B)  # (36): P - K S K^T = P - B^T B
        if reset is not None:
            reset_covariance(self._P, reset)
        self.n_observations[rows] += 1
        self.steps_since_observed[rows] = 0
        self._append([names[k] for k in np.flatnonzero(new)], points, G, noise)  # (43)
        return Innovation(v, S, float(y @ y), names, i, H, W, B, G)

    def _append(self, names: Sequence[Hashable], points: Array, G: Array, noise: Array) -> None:
        """Add landmarks x = G pose + noise, P1 (43): they are correlated with all others."""
        if not names:
            return
        cross = G @ self._P[:3]
        self._P = np.block([[self._P, cross.T], [cross, symmetric(cross[:, :3] @ G.T + noise)]])
        self._x, self._first = np.append(self._x, points), np.append(self._first, points)
        self._row_of |= {name: len(self.ids) + k for k, name in enumerate(names)}
        self.ids = (*self.ids, *names)
        self.n_observations = np.append(self.n_observations, np.ones(len(names), int))
        self.steps_since_observed = np.append(self.steps_since_observed, np.zeros(len(names), int))
        self.next_id = max([self.next_id, *(n + 1 for n in names if isinstance(n, int))])

    def remove(self, ids: Names) -> None:
        """Take landmarks out of the map: drop their rows and columns, which marginalises them.

        What they taught about the rest stays.

        Parameters
        ----------
        ids : sequence of hashable
            Names in the map, each once.
        """
        keep = np.ones(self.n_landmarks, bool)
        keep[self.rows_of(ids)] = False
        i = entries(np.flatnonzero(keep))
        self._x, self._first, self._P = self._x[i], self._first[i], self._P[np.ix_(i, i)]
        self.n_observations = self.n_observations[keep]
        self.steps_since_observed = self.steps_since_observed[keep]
        self.ids = tuple(name for name, stays in zip(self.ids, keep, strict=True) if stays)
        self._row_of = {name: row for row, name in enumerate(self.ids)}

    def prune(self, steps: int, n_observations: int = 1) -> tuple[Hashable, ...]:
        """Remove the landmarks that were hardly ever seen and not lately; return their ids.

        A landmark born of clutter is seen once and never again.

        Parameters
        ----------
        steps : int
            Remove only what has not been seen for at least this many predictions, 0 or more.
        n_observations : int, default 1
            Remove only what was seen at most this often, 1 or more.
        """
        steps = as_count("steps", steps)
        n_observations = as_count("n_observations", n_observations, 1)
        gone = (self.steps_since_observed >= steps) & (self.n_observations <= n_observations)
        names = tuple(name for name, is_gone in zip(self.ids, gone, strict=True) if is_gone)
        if names:
            self.remove(names)
        return names

    def __repr__(self) -> str:
        """Say where it is and how much it knows."""
        x, y, theta = self._x[:3]
        return (
            f"{type(self).__name__}(pose=({x:.2f}, {y:.2f}, {theta:.2f}), "
            f"{self.n_landmarks} landmarks, linearisation={self.linearisation!r})"
        )

    # The estimate, as copies.

    @property
    def mean(self) -> Array:
        """Estimate P1 (4): pose, then the landmarks, shape (3 + 2n,)."""
        return self._x.copy()

    @property
    def cov(self) -> Array:
        """Covariance P1 (7), shape (3 + 2n, 3 + 2n), exactly symmetric."""
        return self._P.copy()

    @property
    def pose(self) -> Array:
        """Estimated pose (m, m, rad), shape (3,)."""
        return self._x[:3].copy()

    @property
    def pose_cov(self) -> Array:
        """Covariance of the pose, P1 (5), shape (3, 3)."""
        return self._P[:3, :3].copy()

    @property
    def n_landmarks(self) -> int:
        """Number n of landmarks in the map."""
        return len(self.ids)

    @property
    def landmarks(self) -> Array:
        """Estimated landmarks, shape (n, 2), in the order of `ids`."""
        return self._landmarks.copy()

    @property
    def landmark_covs(self) -> Array:
        """Covariances of the single landmarks, shape (n, 2, 2)."""
        i = np.arange(3, len(self._x)).reshape(-1, 2)
        return self._P[i[:, :, None], i[:, None, :]]

    def landmark_cov(self, id: Hashable) -> Array:
        """Covariance (2, 2) of the landmark named `id`; ValueError if it is not in the map."""
        return self.landmark_covs[self.rows_of(as_names("id", [id]))[0]]

    def rows_of(self, ids: Names) -> Rows:
        """Rows (k,) of `landmarks` that have these names; ValueError if one is not in the map."""
        names = as_names("ids", ids)
        missing = [name for name in names if name not in self._row_of]
        if missing:
            raise ValueError(f"ids: expected landmarks of the map, got {missing}")
        return np.array([self._row_of[name] for name in names], dtype=np.intp)

    # For the association: what would landmarks measure, and with what covariance?

    def innovation_covs(self, rows: ArrayLike) -> Array:
        """Covariances (m, 2, 2) of what the landmarks in `rows` would measure, each for itself.

        P1 (33) with the sensor's R included. `rows` (m,) index `landmarks`.
        """
        rows = as_rows("rows", rows, self.n_landmarks)
        i = np.hstack([np.tile(POSE, (len(rows), 1)), 3 + 2 * rows[:, None] + [0, 1]])
        H = np.concatenate(self._jacobians(rows), 2)
        return H @ self._P[i[:, :, None], i[:, None, :]] @ H.mT + self.sensor.cov

    def innovation_cov(self, rows: ArrayLike) -> Array:
        """Joint covariance (2m, 2m) of what the landmarks in `rows` would measure together.

        P1 (33) with the sensor's R included; the blocks off the diagonal are what joint
        compatibility needs. `rows` (m,) index `landmarks`.
        """
        i, H = self._jacobian(as_rows("rows", rows, self.n_landmarks))
        R = np.broadcast_to(self.sensor.cov, (len(H) // 2, 2, 2))
        return H @ self._P[np.ix_(i, i)] @ H.T + block_diagonal(R)

    # Inside.

    @property
    def _landmarks(self) -> Array:
        return self._x[3:].reshape(-1, 2)

    def _jacobians(self, rows: Rows) -> tuple[Array, Array]:
        """Jacobians of landmarks by the pose (m, 2, 3) and by the landmark (m, 2, 2)."""
        at = self._first if self.linearisation == "first-estimates" else self._x
        return self.sensor.jacobians(at[:3], at[3:].reshape(-1, 2)[rows])

    def _jacobian(self, rows: Rows) -> tuple[Rows, Array]:
        """Jacobian H (2m, 3 + 2m) of m landmarks by the entries i (3 + 2m,) of the state."""
        H_pose, H_landmark = self._jacobians(rows)
        return entries(rows), np.hstack([H_pose.reshape(-1, 3), block_diagonal(H_landmark)])

    def _new_landmarks(self, pose: Array, z: Array, R: Array) -> tuple[Array, Array, Array]:
        """P1 (37)-(42): new landmarks (2k,), their Jacobian by the pose and their own noise."""
        if not len(z):
            return np.empty(0), np.empty((0, 3)), np.empty((0, 0))
        points = self.sensor.locate(pose, z)
        G_pose, G_z = self.sensor.locate_jacobians(pose, z)
        noise = G_z @ R @ G_z.mT
        if not (all_finite(points) and all_finite(noise)):
            raise ValueError("z: expected measurements of landmarks that can be placed, got inf")
        G = fej_jacobian(G_pose.reshape(-1, 3), pose, self._first, self.linearisation)
        return points.ravel(), G, block_diagonal(noise)

    def _associated(
        self, z: Array, R: Array, covs: ArrayLike | None
    ) -> tuple[Hashable | None, ...]:
        """Ask `associate`; a new landmark gets the next number, None is left out."""
        given_covs = {} if covs is None else {"covs": R}
        rows = as_associations(self.associate(self, z, **given_covs), len(z), self.n_landmarks)
        numbers = iter(range(self.next_id, self.next_id + len(z)))
        return tuple(
            self.ids[row] if row >= 0 else next(numbers) if row == NEW else None for row in rows
        )


def entries(rows: Rows) -> Rows:
    """Places (3 + 2m,) in the state of the pose and of the landmarks in `rows` (m,)."""
    return np.concatenate([POSE, (3 + 2 * rows[:, None] + [0, 1]).ravel()])


def symmetric(P: Array) -> Array:
    """Return the symmetric part of `P`, (P + P^T) / 2."""
    return 0.5 * (P + P.T)


def inverse_root(S: Array) -> Array:
    """W with W^T W = S^-1; ValueError if an innovation covariance is not positive definite."""
    if not len(S):
        return S
    root, failed = dpotrf(S)  # S = U^T U, and W^T = U^-1
    if failed or not isfinite(root[-1, -1]):
        raise ValueError(
            "covs: expected an innovation covariance S = H P H^T + R that is positive definite, "
            f"its smallest eigenvalue is {np.linalg.eigvalsh(S)[0]:.3g}"
        )
    return np.asarray(dtrtri(root)[0].T)


def downdate(P: Array, B: Array) -> None:
    """P - B^T B in place, symmetric to the last bit."""
    if len(P) < 1500:
        P -= B.T @ B
        return
    # Without a second matrix as large as P: BLAS writes the lower triangle, then it is mirrored.
    dsyrk(-1.0, B.T, beta=1.0, c=P.T, overwrite_c=1)
    lower = np.tri(64, dtype=bool)
    for j in range(0, len(P), 64):
        own = slice(j, j + 64)
        P[own, own] = np.where(lower[: len(P) - j, : len(P) - j], P[own, own], P[own, own].T)
        P[:j, own] = P[own, :j].T
