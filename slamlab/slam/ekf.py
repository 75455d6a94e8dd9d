"""EKF-SLAM: one Gaussian over the pose and all landmarks, corrected by every set of observations.

P1 (1)-(8), (11), (14), (19), (33)-(43) repaired, P2 (6)-(11): predict, update, add a landmark.
Chapter 09 derives it, chapter 10 asks what it costs and whether it may be believed.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from math import isfinite, log, pi
from operator import ne
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dpotrf, dtrtri

from slamlab._checks import Array, all_finite, as_array, as_count, as_covariance
from slamlab.geometry import wrap_angle
from slamlab.models import LandmarkSensor, MotionModel, as_motion, as_sensor
from slamlab.slam._covariance import POSE, Covariance, block_diagonal, diagonal, times
from slamlab.slam._linearise import as_linearisation, carried, corrected
from slamlab.slam.association import IGNORED, NEW, nearest_neighbour

__all__ = ["Correction", "EKFSlam"]

Rows = NDArray[np.intp]
Associate = Callable[..., ArrayLike]
Names = Sequence[Hashable | None] | ArrayLike


@dataclass(frozen=True, eq=False)
class Correction:
    """What an update learned, all measurements stacked, and the names given.

    Attributes
    ----------
    residual : ndarray, shape (2m,)
        Innovation of the m landmarks known before, P1 (19).
    cov : ndarray, shape (2m, 2m)
        Its covariance S, P1 (33).
    nis : float
        Normalised innovation squared.
    ids : tuple
        Landmark of each measurement, None if it was left out.
    """

    residual: Array
    cov: Array
    nis: float
    ids: tuple[Hashable | None, ...]
    _roots: tuple[Array, Array] = field(repr=False)

    @property
    def gain(self) -> Array:
        """Kalman gain K = P H^T S^-1, P1 (34), shape (3 + 2n, 2m)."""
        # S^-1 = W^T W and B = W H P
        W, B = self._roots
        return times(W.T, B).T

    @property
    def log_likelihood(self) -> float:
        """Log density of the measurement, as predicted."""
        W = self._roots[0]
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
        Names of the n landmarks in `mean`.
    associate : callable, optional
        ``associate(slam, z) -> rows (k,)``, asked when an update comes without ids: for each
        measurement the row of `landmarks`, -1 to start a new landmark, -2 to leave it out. If
        an update comes with covariances, also ``covs=`` (k, 2, 2). Left out: nearest neighbour
        with a Mahalanobis gate of 99 %.
    linearisation : {"latest", "first-estimates", "invariant"}
        Where the Jacobians are taken. At the latest estimate, as P1 and P2 do, the filter comes
        to believe that it knows its heading though nothing measured it. With first estimates
        (Huang, Mourikis and Roumeliotis 2008), or in the coordinates of a right-invariant error
        (Barrau and Bonnabel 2015; landmarks must be points), it does not.

    Attributes
    ----------
    measures : str
        "looks": sets of simultaneous measurements of landmarks.
    motion, sensor, associate, linearisation
        As given.
    ids : tuple
        Names of the landmarks in the order of the state.
    sightings : ndarray of int, shape (n,)
        How often each landmark has been seen, the first time included.
    unseen_for : ndarray of int, shape (n,)
        Predictions since each landmark was last seen.
    next_id : int
        Name of the next landmark that the association starts.

    Raises
    ------
    ValueError
        If a shape does not fit, a number is not finite, `cov` is no covariance, or `ids` repeats
        a name.

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

    measures = "looks"

    def __init__(
        self,
        motion: MotionModel,
        sensor: LandmarkSensor,
        mean: ArrayLike,
        cov: ArrayLike | Covariance | None = None,
        ids: Sequence[Hashable] = (),
        *,
        associate: Associate | None = None,
        linearisation: str = "latest",
    ) -> None:
        self.motion, self.sensor = as_motion("motion", motion), as_sensor("sensor", sensor)
        self.associate: Associate = nearest_neighbour if associate is None else associate
        self.linearisation = as_linearisation(linearisation, sensor)
        names = as_names("ids", ids)
        size = 3 + 2 * len(names)
        # Pose and landmarks, P1 (4), and P1 (7).
        self._mean = as_array("mean", mean, (size,)).astype(float)
        self._mean[2] = wrap_angle(self._mean[2])
        if cov is None:
            cov = Covariance(np.zeros((size, size)))
        if not isinstance(cov, Covariance):
            cov = Covariance(as_covariance("cov", cov, size))
        self._P, self._first = cov, self._mean.copy()
        self.ids: tuple[Hashable, ...] = ()
        self._row_of: dict[Hashable, int] = {}
        self.sightings, self.unseen_for = np.zeros((2, 0), dtype=int)
        self.next_id = 0
        self._checked_cov = b""
        self._enrol(names)

    def __repr__(self) -> str:
        """Say where it is and how much it knows."""
        x, y, theta = self._mean[:3]
        return (
            f"{type(self).__name__}(pose=({x:.2f}, {y:.2f}, {theta:.2f}), "
            f"{self.n_landmarks} landmarks, linearisation={self.linearisation!r})"
        )

    # The state, as copies.

    @property
    def mean(self) -> Array:
        """Estimate P1 (4): pose, then the landmarks, shape (3 + 2n,)."""
        return self._mean.copy()

    @property
    def cov(self) -> Array:
        """Covariance P1 (7), shape (3 + 2n, 3 + 2n), exactly symmetric."""
        return self._P.matrix.copy()

    @property
    def pose(self) -> Array:
        """Estimated pose (m, m, rad), shape (3,)."""
        return self._mean[:3].copy()

    @property
    def pose_cov(self) -> Array:
        """Covariance of the pose, P1 (5), shape (3, 3)."""
        return self._P.pose

    @property
    def n_landmarks(self) -> int:
        """Number n of landmarks in the map."""
        return len(self.ids)

    @property
    def landmarks(self) -> Array:
        """Estimated landmarks, shape (n, 2), in the order of `ids`."""
        return self._mean[3:].reshape(-1, 2).copy()

    @property
    def landmark_covs(self) -> Array:
        """Covariances of the single landmarks, shape (n, 2, 2)."""
        i = np.arange(3, len(self._mean)).reshape(-1, 2)
        return self._P.pairs(i[:, :, None], i[:, None, :])

    def landmark_cov(self, id: Hashable) -> Array:
        """Covariance (2, 2) of the landmark named `id`; ValueError if it is not in the map."""
        return self._P.block(entries_of(self.rows_of(as_names("id", [id]))))

    def rows_of(self, ids: Names) -> Rows:
        """Rows (k,) of `landmarks` that have these names; ValueError if one is not in the map."""
        names = as_names("ids", ids)
        missing = [name for name in names if name not in self._row_of]
        if missing:
            raise ValueError(f"ids: expected landmarks of the map, got {missing}")
        return np.array([self._row_of[name] for name in names], dtype=np.intp)

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

        Raises
        ------
        ValueError
            If a shape does not fit, a number is not finite, or `control_cov` is no covariance.
        """
        u, pose = as_array("u", u, ("l",)), self._mean[:3]
        V = self._as_control_cov(control_cov, len(u))
        # (12), (13): both at the estimate before the step.
        F_x, F_u = self.motion.jacobians(pose, u, dt)
        # (8), P2 (8)
        moved = self.motion.step(pose, u, dt)
        # (14)
        Q = F_u @ V @ F_u.T
        if not all_finite(Q):
            raise ValueError(f"control_cov: expected a finite motion noise, got {Q.tolist()}")
        # (11), P2 (9)
        self._P.move(carried(F_x, pose, self._first, self.linearisation), Q)
        self._mean[:3] = self._first[:3] = moved
        self.unseen_for += 1

    def update(
        self, z: ArrayLike, ids: Names | None = None, covs: ArrayLike | None = None
    ) -> Correction:
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
        Correction
            What the m landmarks known before were off by.

        Raises
        ------
        ValueError
            If a shape does not fit, a number is not finite, `covs` is no covariance, an id comes
            twice, or the correction overflows. The filter is then as it was.
        """
        z, R = self._as_measurements(z, covs)
        names = self._associated(z, None if covs is None else R) if ids is None else ids
        names = as_names("ids", names, len(z))
        if all(name is None for name in names):
            # A look at nothing teaches nothing.
            none = np.empty((0, 0))
            B = np.empty((0, len(self._mean)))
            return Correction(np.empty(0), none, 0.0, names, (none, B))
        rows = np.array([self._row_of.get(n, IGNORED if n is None else NEW) for n in names], int)
        known, new = rows >= 0, rows == NEW
        seen = rows[known]
        # (18), (19): predicted observation and innovation, wrapped.
        landmarks = self._mean[3:].reshape(-1, 2)[seen]
        v = self.sensor.residual(z[known], self.sensor.observe(self._mean[:3], landmarks)).ravel()
        # (22)-(32)
        i, H = with_pose(seen), side_by_side(*self._slopes(seen))
        # (33): S = H P H^T + R, from the rows i of P that H does not multiply by zero.
        HP = times(H, self._P.rows(i))
        S = HP[:, i] @ H.T + block_diagonal(R[known])
        # (34): K = P H^T S^-1 = B^T W with S^-1 = W^T W and B = W H P.
        W = whitener(S)
        B, y = times(W, HP), W @ v
        # (35): x + K v
        change = y @ B
        if not all_finite(change):
            raise ValueError("z: expected measurements that can be weighed, the update overflows")
        mean, shear = corrected(self._mean, change, self.linearisation)
        # (37)-(42): new landmarks, seen from the corrected pose.
        arrivals = self._locate(mean[:3], z[new], R[new]) if np.count_nonzero(new) else None
        # Nothing can fail any more. (36): P - K S K^T = P - B^T B
        self._mean = mean
        self._P.correct(B, i=i, H=H, W=W, y=y)
        if shear is not None:
            self._P.shear(shear)
        # (43)
        if arrivals is not None:
            points, G, noise = arrivals
            self._P.append(G, noise)
            self._mean = np.append(mean, points)
            self._first = np.append(self._first, points)
            self._enrol([names[k] for k in np.flatnonzero(new)])
        self.sightings[seen] += 1
        self.unseen_for[seen] = 0
        return Correction(v, S, float(y @ y), names, (W, B))

    def remove(self, ids: Names) -> None:
        """Take landmarks out of the map: drop their rows and columns, which marginalises them.

        What they taught about the rest stays.

        Parameters
        ----------
        ids : sequence of hashable
            Names in the map.

        Raises
        ------
        ValueError
            If a name is not in the map or comes twice; the filter is then as it was.
        """
        keep = np.ones(self.n_landmarks, dtype=bool)
        keep[self.rows_of(ids)] = False
        entries = with_pose(np.flatnonzero(keep))
        self._P.keep(entries)
        self._mean, self._first = self._mean[entries], self._first[entries]
        self.sightings, self.unseen_for = self.sightings[keep], self.unseen_for[keep]
        self.ids = tuple(name for name, stays in zip(self.ids, keep, strict=True) if stays)
        self._row_of = {name: row for row, name in enumerate(self.ids)}

    def remove_unseen(self, steps: int, sightings: int = 1) -> tuple[Hashable, ...]:
        """Remove the landmarks that were hardly ever seen and not lately; return their ids.

        A landmark born of clutter is seen once and never again.

        Parameters
        ----------
        steps : int
            Remove only what has not been seen for at least this many predictions.
        sightings : int, default 1
            Remove only what was seen at most this often.

        Raises
        ------
        ValueError
            If a count is no whole number, `steps` negative or `sightings` below 1.
        """
        steps, sightings = as_count("steps", steps), as_count("sightings", sightings, 1)
        gone = (self.unseen_for >= steps) & (self.sightings <= sightings)
        names = tuple(name for name, is_gone in zip(self.ids, gone, strict=True) if is_gone)
        if names:
            self.remove(names)
        return names

    # For the association: which measurement fits which landmark?

    def innovation_covs(self, rows: ArrayLike) -> Array:
        """Covariances (m, 2, 2) of what the landmarks in `rows` would measure, each for itself.

        P1 (33) with the sensor's R included. `rows` (m,) index `landmarks`.
        """
        rows = self._as_rows(rows)
        H_pose, H_landmark = self._slopes(rows)
        i = entries_of(rows).reshape(-1, 2)
        P_lp = self._P.pairs(i[..., None], POSE)
        P_ll = self._P.pairs(i[:, :, None], i[:, None, :])
        cross = H_landmark @ P_lp @ H_pose.mT
        own = H_landmark @ P_ll @ H_landmark.mT + self.sensor.cov
        return H_pose @ self._P.pose @ H_pose.mT + cross + cross.mT + own

    def innovation_cov(self, rows: ArrayLike) -> Array:
        """Joint covariance (2m, 2m) of what the landmarks in `rows` would measure together.

        P1 (33) with the sensor's R included; the blocks off the diagonal are what joint
        compatibility needs. `rows` (m,) index `landmarks`.
        """
        rows = self._as_rows(rows)
        H = side_by_side(*self._slopes(rows))
        R = block_diagonal(self.sensor.cov[None].repeat(len(rows), 0))
        return H @ self._P.block(with_pose(rows)) @ H.T + R

    # Inside.

    def _slopes(self, rows: Rows) -> tuple[Array, Array]:
        """H_pose (m, 2, 3) and H_landmark (m, 2, 2) of landmarks, P1 (22)-(32)."""
        at = self._first if self.linearisation == "first-estimates" else self._mean
        return self.sensor.jacobians(at[:3], at[3:].reshape(-1, 2)[rows])

    def _locate(self, pose: Array, z: Array, R: Array) -> tuple[Array, Array, Array]:
        """P1 (37)-(42): new landmarks (2k,), their slopes by the pose and their own noise."""
        points = self.sensor.locate(pose, z)
        G_pose, G_z = self.sensor.locate_jacobians(pose, z)
        noise = G_z @ R @ G_z.mT
        if not (np.isfinite(points).all() and np.isfinite(noise).all()):
            raise ValueError("z: expected measurements of landmarks that can be placed, got inf")
        G = carried(G_pose.reshape(-1, 3), pose, self._first, self.linearisation)
        return points.ravel(), G, block_diagonal(noise)

    def _enrol(self, names: Sequence[Hashable]) -> None:
        """Book the names of new landmarks."""
        if names:
            self._row_of |= {name: self.n_landmarks + k for k, name in enumerate(names)}
            self.ids = (*self.ids, *names)
            self.sightings = np.append(self.sightings, np.ones(len(names), dtype=int))
            self.unseen_for = np.append(self.unseen_for, np.zeros(len(names), dtype=int))
            numbers = [name + 1 for name in names if isinstance(name, int)]
            self.next_id = max([self.next_id, *numbers])

    def _associated(self, z: Array, covs: Array | None) -> tuple[Hashable | None, ...]:
        """Name the landmark of each measurement, a fresh name if it is new, None to leave out."""
        asked = self.associate(self, z) if covs is None else self.associate(self, z, covs=covs)
        rows = np.asarray(asked)
        if rows.shape != (len(z),) or (rows.size and rows.dtype.kind not in "iu"):
            raise ValueError(f"associate: expected {len(z)} rows, whole numbers, got {rows!r}")
        if ((rows < IGNORED) | (rows >= self.n_landmarks)).any():
            raise ValueError(
                f"associate: expected rows of {self.n_landmarks} landmarks, -1 or -2, got {rows!r}"
            )
        fresh = iter(range(self.next_id, self.next_id + len(z)))
        return tuple(
            self.ids[row] if row >= 0 else next(fresh) if row == NEW else None for row in rows
        )

    # Inside: the door.

    def _as_control_cov(self, control_cov: ArrayLike, size: int) -> Array:
        """Check V; looking for negative eigenvalues takes longer than a prediction: once."""
        V = as_array("control_cov", control_cov, (size, size))
        if V.tobytes() != self._checked_cov:
            as_covariance("control_cov", V)
            self._checked_cov = V.tobytes()
        return V

    def _as_measurements(self, z: ArrayLike, covs: ArrayLike | None) -> tuple[Array, Array]:
        """Check measurements (k, 2) and give each its R, (k, 2, 2)."""
        z = as_array("z", z, ("k", 2))
        R = self.sensor.cov if covs is None else as_covariance("covs", covs, 2)
        if R.ndim == 2:
            R = R[None].repeat(len(z), 0)
        if R.shape != (len(z), 2, 2):
            raise ValueError(f"covs: expected shape (2, 2) or ({len(z)}, 2, 2), got {R.shape}")
        return z, R

    def _as_rows(self, rows: ArrayLike) -> Rows:
        """Check rows that index `landmarks`."""
        array = np.asarray(rows)
        if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
            raise ValueError(f"rows: expected whole numbers of shape (m,), got {rows!r}")
        if ((array < 0) | (array >= self.n_landmarks)).any():
            raise ValueError(f"rows: expected rows of {self.n_landmarks} landmarks, got {rows!r}")
        return array.astype(np.intp)


PAIR = np.array([3, 4])


def entries_of(rows: Rows) -> Rows:
    """Places (2m,) in the state of the landmarks in `rows` (m,)."""
    return with_pose(rows)[3:]


def with_pose(rows: Rows) -> Rows:
    """Places (3 + 2m,) in the state of the pose and of the landmarks in `rows` (m,)."""
    return np.concatenate([POSE, (2 * rows[:, None] + PAIR).ravel()])


def side_by_side(H_pose: Array, H_landmark: Array) -> Array:
    """Jacobian H (2m, 3 + 2m) by pose and m landmarks, each landmark measured by itself."""
    m = len(H_pose)
    H = np.zeros((2 * m, 3 + 2 * m))
    H[:, :3], H[diagonal(m, 3)] = H_pose.reshape(2 * m, 3), H_landmark
    return H


def whitener(S: Array) -> Array:
    """Inverse of the lower Cholesky factor of an innovation covariance S."""
    if not len(S):
        return S
    root, failed = dpotrf(S)
    if failed or not isfinite(root[-1, -1]):
        raise ValueError(
            "covs: expected an innovation covariance S = H P H^T + R that is positive definite, "
            f"its smallest eigenvalue is {np.linalg.eigvalsh(S)[0]:.3g}"
        )
    # The upper factor U with S = U^T U: its inverse is W^T.
    return np.asarray(dtrtri(root)[0].T)


def as_names(name: str, ids: Any, length: int | None = None) -> tuple[Hashable | None, ...]:
    """Names as a tuple of plain Python values, none twice; numbers of an array become ints."""
    try:
        listed = ids.tolist() if isinstance(ids, np.ndarray) else ids
        names = tuple(one.item() if isinstance(one, np.generic) else one for one in listed)
        different = len(set(names))
    except TypeError as error:
        raise ValueError(f"{name}: expected a sequence of names, got {ids!r}") from error
    if length is not None and len(names) != length:
        raise ValueError(f"{name}: expected one for each of {length} rows of z, got {len(names)}")
    if any(map(ne, names, names)):
        raise ValueError(f"{name}: expected names, got NaN, which is never the same twice")
    if different < len(names):
        twice = [one for k, one in enumerate(names) if one is not None and one in names[:k]]
        if twice:
            raise ValueError(f"{name}: expected every landmark once, got {twice[0]!r} twice")
    return names
