"""EKF-SLAM: one Gaussian over the pose and all landmarks, corrected by every look at the world.

P1 (1)-(8), (11), (14), (19), (33)-(43) repaired, P2 (6)-(11): predict, update, add a landmark.
Chapter 09 derives it, chapter 10 asks what it costs and whether it may be believed.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dtrtri

from slamlab._checks import Array, as_array, as_count, as_covariance
from slamlab.filters.kalman import Innovation
from slamlab.geometry import wrap_angle
from slamlab.slam._triangle import block_diagonal, downdate, mirror, times

__all__ = ["EKFSlam"]

Rows = NDArray[np.intp]
Associate = Callable[["EKFSlam", Array], ArrayLike]


class EKFSlam:
    """EKF-SLAM with known landmarks or with an association of your choice.

    The state is P1 (4): pose (x, y, theta), then two numbers a landmark, in the order in which
    the landmarks were met. What the two numbers mean is the sensor's affair: a point (x, y) with
    `RangeBearing`, a wall (r, alpha) with `Wall`.

    A prediction costs O(n) and an update O(n^2) for n landmarks: the Jacobians are never written
    out, and only the lower triangle of the covariance is kept up to date.

    Parameters
    ----------
    motion : motion model
        With ``step(pose, u, dt)`` and ``jacobians(pose, u, dt) -> (F_x, F_u)``.
    sensor : sensor model
        With ``observe``, ``jacobians``, ``residual``, ``locate``, ``locate_jacobians``, ``cov``.
    mean : array_like, shape (3 + 2n,)
        Pose (m, m, rad) and, if a map is known beforehand, its n landmarks.
    cov : array_like, shape (3 + 2n, 3 + 2n), optional
        Covariance of `mean`; zero if left out: the robot starts where the map begins. Nothing
        has to be invertible, whatever P1 says after its (5): S = H P H^T + R is.
    ids : sequence of hashable, default ()
        Names of the n landmarks in `mean`.

    Attributes
    ----------
    motion, sensor
        The models.
    ids : tuple
        Names of the landmarks in the order of the state.
    sightings : ndarray of int, shape (n,)
        How often each landmark has been seen, the first time included.
    unseen_for : ndarray of int, shape (n,)
        Predictions since each landmark was last seen.

    Raises
    ------
    ValueError
        If a shape does not fit, a number is not finite, `cov` is no covariance, or `ids` repeats
        a name.

    Notes
    -----
    `mean`, `cov`, `pose` and `landmarks` are read-only views of the filter's own arrays, valid
    until the next call that changes it: copy what you want to keep. The arrays grow by doubling.

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
        motion: Any,
        sensor: Any,
        mean: ArrayLike,
        cov: ArrayLike | None = None,
        ids: Sequence[Hashable] = (),
    ) -> None:
        self.motion, self.sensor = motion, sensor
        names = _as_ids("ids", ids)
        _refuse_repeated("ids", names)
        size = 3 + 2 * len(names)
        mean = as_array("mean", mean, (size,)).astype(float)
        mean[2] = wrap_angle(mean[2])
        P = np.zeros((size, size)) if cov is None else as_covariance("cov", cov, size)
        self._size = 0
        # One flat piece of memory each; `_P` reads the first size^2 numbers as a matrix.
        self._mean, self._flat = np.empty(size), np.empty(size * size)
        self._resize(size)
        self._mean[:size], self._P[...] = mean, P
        self._mirrored = True
        self.ids: tuple[Hashable, ...] = names
        self._row_of = {name: row for row, name in enumerate(names)}
        self._next_id, self._checked_cov = 0, np.empty((0, 0))
        self.sightings = np.ones(len(names), dtype=int)
        self.unseen_for = np.zeros(len(names), dtype=int)

    # The state, read only.

    @property
    def mean(self) -> Array:
        """Estimate P1 (4): pose, then the landmarks, shape (3 + 2n,); a view."""
        return _read_only(self._mean[: self._size])

    @property
    def cov(self) -> Array:
        """Covariance P1 (7), shape (3 + 2n, 3 + 2n); a view, exactly symmetric.

        Asking for it copies the lower triangle to the upper one if the filter has moved since:
        O(n^2). `pose_cov` and `landmark_cov` cost nothing.
        """
        P = self._P
        if not self._mirrored:
            mirror(P)
            self._mirrored = True
        return _read_only(P)

    @property
    def pose(self) -> Array:
        """Estimated pose (m, m, rad), shape (3,); a copy."""
        return self._mean[:3].copy()

    @property
    def pose_cov(self) -> Array:
        """Covariance of the pose, P1 (5), shape (3, 3)."""
        return self._block(np.arange(3))

    @property
    def n_landmarks(self) -> int:
        """Number n of landmarks in the map."""
        return len(self.ids)

    @property
    def landmarks(self) -> Array:
        """Estimated landmarks, shape (n, 2), in the order of `ids`; a view."""
        return _read_only(self._mean[3 : self._size].reshape(-1, 2))

    @property
    def landmark_covs(self) -> Array:
        """Covariances of the single landmarks, shape (n, 2, 2)."""
        i = np.arange(3, self._size).reshape(-1, 2)
        return self._pairs(i[:, :, None], i[:, None, :])

    def landmark_cov(self, id: Hashable) -> Array:
        """Covariance (2, 2) of the landmark named `id`; ValueError if it is not in the map."""
        row = self._known_rows([id])[0]
        return self._block(np.arange(3 + 2 * row, 5 + 2 * row))

    # The three stages of P1.

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Stage 1: move the pose; the landmarks stay where they are. O(n).

        Call it once a step. P1's "(16)-(36) are repeated for each landmark" would add the motion
        noise once for each landmark seen.

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
        u = as_array("u", u, ("l",))
        # (12), (13): both at the estimate before the step.
        F_x, F_u = self.motion.jacobians(self.pose, u, dt)
        V = as_array("control_cov", control_cov, u.shape * 2)
        if not np.array_equal(V, self._checked_cov):
            # Looking for negative eigenvalues takes longer than the prediction: once will do.
            as_covariance("control_cov", V)
            self._checked_cov = V.copy()
        # (8), P2 (8)
        pose = self.motion.step(self.pose, u, dt)
        # (14)
        Q = F_u @ V @ F_u.T
        if not np.isfinite(Q).all():
            raise ValueError(f"control_cov: expected a finite motion noise, got {Q.tolist()}")
        self._move(pose, F_x, Q)
        self.unseen_for += 1

    def update(
        self, z: ArrayLike, ids: Sequence[Hashable] | ArrayLike, covs: ArrayLike | None = None
    ) -> Innovation:
        """Stages 2 and 3: correct by the landmarks known already, then add the new ones.

        All known landmarks of the look are one block: one O(n^2) correction however many were
        seen. New landmarks are placed from the corrected pose.

        Parameters
        ----------
        z : array_like, shape (k, 2)
            Measurements of k different landmarks, as the sensor gives them.
        ids : sequence of hashable, length k
            Which landmark each one belongs to. A name never seen adds a landmark.
        covs : array_like, shape (2, 2) or (k, 2, 2), optional
            Covariances R of the measurements, if they are not the sensor's `cov`: a wall seen
            over its full length is known better than a stump of it.

        Returns
        -------
        Innovation
            What the landmarks known before were off by, stacked: residual (2m,), cov (2m, 2m),
            gain (3 + 2n, 2m), nis and log_likelihood, m of the k landmarks known.

        Raises
        ------
        ValueError
            If a shape does not fit, a number is not finite, `covs` is no covariance, an id comes
            twice, or the correction overflows. The filter is then as it was.
        """
        z, names, covs = self._as_look(z, ids, covs)
        known = np.array([name in self._row_of for name in names], dtype=bool)
        fresh = [name for name in names if name not in self._row_of]
        rows = self._known_rows([name for name in names if name in self._row_of])
        # Everything that may fail comes first, everything that changes the filter last.
        correction = self._innovate(rows, z[known], covs[known])
        if fresh:
            arrivals = self._locate(correction.mean[:3], z[~known], covs[~known])
        self._correct(correction)
        self.sightings[rows] += 1
        self.unseen_for[rows] = 0
        if fresh:
            self._augment(arrivals)
            self._enrol(fresh)
        return correction.innovation

    def step(
        self,
        u: ArrayLike,
        dt: float,
        control_cov: ArrayLike,
        z: ArrayLike,
        associate: Associate | Sequence[Hashable] | ArrayLike | None = None,
        covs: ArrayLike | None = None,
    ) -> tuple[Hashable | None, ...]:
        """Predict, tell which landmark is which, update: one turn of the robot's life.

        Parameters
        ----------
        u, dt, control_cov
            As `predict`.
        z : array_like, shape (k, 2)
            As `update`.
        associate : callable or sequence of hashable, optional
            ``associate(slam, z) -> rows (k,)``: for each measurement the row of `landmarks`, -1
            to start a new landmark, -2 to leave it out. Or the ids themselves, length k. Nearest
            neighbour with a Mahalanobis gate of 99 % if left out.
        covs : array_like, optional
            As `update`.

        Returns
        -------
        tuple of length k
            The id that each measurement was given, None if it was left out. New landmarks are
            named by the next whole number.

        Raises
        ------
        ValueError
            As `predict` and `update`, or if `associate` returns no rows. The filter is then as it
            was before the step.
        """
        before = self._mean[: self._size].copy(), self._P[:, :3].copy(), self.unseen_for.copy()
        z = as_array("z", z, ("k", 2))
        try:
            self.predict(u, dt, control_cov)
            names = self._associated(z, associate)
            used = np.array([name is not None for name in names], dtype=bool)
            if covs is not None and np.ndim(covs) == 3:
                covs = as_array("covs", covs, (len(z), 2, 2))[used]
            self.update(z[used], [name for name in names if name is not None], covs)
        except Exception:
            self._mean[: self._size], self._P[:, :3], self.unseen_for[:] = before
            self._mirrored = False
            raise
        return names

    def remove(self, ids: Sequence[Hashable] | ArrayLike) -> None:
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
        names = _as_ids("ids", ids)
        _refuse_repeated("ids", names)
        keep = np.ones(self.n_landmarks, dtype=bool)
        keep[self._known_rows(names)] = False
        entries = np.concatenate([np.ones(3, dtype=bool), np.repeat(keep, 2)])
        mirrored = self._mirrored
        self._replace(
            self.mean[entries],
            self._P[np.ix_(entries, entries)],
            tuple(name for name, stays in zip(self.ids, keep, strict=True) if stays),
            self.sightings[keep],
            self.unseen_for[keep],
        )
        self._mirrored = mirrored

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
        self.remove(names)
        return names

    # For the association: which measurement fits which landmark?

    def innovation_covs(self, rows: ArrayLike) -> Array:
        """Covariances (m, 2, 2) of what the landmarks in `rows` would measure, each for itself.

        P1 (33) with the sensor's R included. `rows` (m,) index `landmarks`.
        """
        rows = self._as_rows(rows)
        H_pose, H_landmark = self.sensor.jacobians(self.pose, self.landmarks[rows])
        i = 3 + 2 * rows[:, None] + np.arange(2)
        P_pp, P_lp = self.pose_cov, self._P[i, :3]
        P_ll = self._pairs(i[:, :, None], i[:, None, :])
        cross = H_landmark @ P_lp @ _t(H_pose)
        S = H_pose @ P_pp @ _t(H_pose) + cross + _t(cross) + H_landmark @ P_ll @ _t(H_landmark)
        return S + self.sensor.cov

    def innovation_cov(self, rows: ArrayLike) -> Array:
        """Joint covariance (2m, 2m) of what the landmarks in `rows` would measure together.

        P1 (33) with the sensor's R included; the blocks off the diagonal are what joint
        compatibility needs. `rows` (m,) index `landmarks`.
        """
        rows = self._as_rows(rows)
        H_pose, H_landmark = self.sensor.jacobians(self.pose, self.landmarks[rows])
        m = len(rows)
        i = np.concatenate([np.arange(3), (3 + 2 * rows[:, None] + np.arange(2)).ravel()])
        H = np.concatenate([H_pose.reshape(2 * m, 3), block_diagonal(H_landmark)], 1)
        R = block_diagonal(np.broadcast_to(self.sensor.cov, (m, 2, 2)))
        return H @ self._block(i) @ H.T + R

    # Inside: the algebra. From here on the data is trusted.

    @property
    def _P(self) -> Array:
        """The covariance; only its lower triangle counts unless `_mirrored`."""
        return self._flat[: self._size**2].reshape(self._size, self._size)

    def _pairs(self, i: Rows, j: Rows) -> Array:
        """Entries P[i, j] taken from the lower triangle; index arrays broadcast."""
        return self._P[np.maximum(i, j), np.minimum(i, j)]

    def _block(self, i: Rows) -> Array:
        """Full symmetric block P[i, i], a copy."""
        return self._pairs(i[:, None], i[None, :])

    def _full_rows(self, i: Rows) -> Array:
        """Whole rows P[i, :], a copy: left of the diagonal as stored, right of it the column."""
        P = self._P
        return np.where(np.arange(self._size) <= i[:, None], P[i], P[:, i].T)

    def _move(self, pose: Array, F_x: Array, Q: Array) -> None:
        """P1 (11), P2 (9): the pose block and, not to be forgotten, its ties to the map."""
        P_pp = F_x @ self.pose_cov @ F_x.T + Q
        P = self._P
        P[3:, :3] = P[3:, :3] @ F_x.T
        P[:3, :3] = 0.5 * (P_pp + P_pp.T)
        self._mean[:3] = pose
        self._mirrored = False

    def _innovate(self, rows: Rows, z: Array, covs: Array) -> Correction:
        """P1 (18)-(35) for all landmarks `rows` at once; nothing is changed yet."""
        pose, landmarks, m = self.pose, self.landmarks[rows], len(rows)
        # (19): wrapped innovation.
        v = self.sensor.residual(z, self.sensor.observe(pose, landmarks)).ravel()
        # (22)-(32): H has H_pose in the columns of the pose, H_landmark in those of the landmark.
        H_pose, H_landmark = self.sensor.jacobians(pose, landmarks)
        i = np.concatenate([np.arange(3), (3 + 2 * rows[:, None] + np.arange(2)).ravel()])
        # (33): S = H P H^T + R, from the rows of P that H does not multiply by zero.
        HP = times_H(H_pose, H_landmark, self._full_rows(i))
        S = times_H(H_pose, H_landmark, HP[:, i].T)
        S.reshape(m, 2, m, 2)[np.arange(m), :, np.arange(m)] += covs
        S = 0.5 * (S + S.T)
        # (34) in two halves: B = L^-1 H P with S = L L^T, so that K = B^T L^-1, K S K^T = B^T B.
        whiten = _whitener(S)
        B, white = times(whiten, HP), np.asarray(whiten @ v)
        # (35)
        mean = self.mean + white @ B
        mean[2] = wrap_angle(mean[2])
        if not (np.isfinite(mean).all() and np.isfinite(B).all()):
            raise ValueError("z: expected measurements that can be weighed, the update overflows")
        gain = times(whiten.T, B).T
        innovation = Innovation(v, S, gain, *_likelihood(white, whiten))
        return Correction(rows, H_pose, H_landmark, whiten, white, B, mean, innovation)

    def _correct(self, correction: Correction) -> None:
        """P1 (35), (36), P2 (10), (11): P - K S K^T in place, the lower triangle only."""
        if len(correction.rows):
            self._mean[: self._size] = correction.mean
            downdate(self._P, correction.B)
            self._mirrored = False

    def _locate(self, pose: Array, z: Array, covs: Array) -> Arrivals:
        """P1 (37)-(42): where new landmarks are, seen from `pose`, and how that depends on it."""
        G_pose, G_z = self.sensor.locate_jacobians(pose, z)
        new = Arrivals(self.sensor.locate(pose, z), G_pose, G_z @ covs @ _t(G_z))
        if not (np.isfinite(new.points).all() and np.isfinite(new.noise).all()):
            raise ValueError("z: expected measurements of landmarks that can be placed, got inf")
        return new

    def _augment(self, new: Arrivals) -> None:
        """P1 (43): append landmarks; they inherit the ties of the pose to everything."""
        old, k = self._size, len(new.points)
        G = new.G_pose.reshape(2 * k, 3)
        cross = G @ self._full_rows(np.arange(3))
        own = cross[:, :3] @ G.T + block_diagonal(new.noise)
        self._resize(old + 2 * k)
        self._mean[old : self._size] = new.points.ravel()
        self._P[old:, :old] = cross
        self._P[old:, old:] = 0.5 * (own + own.T)
        self._mirrored = False

    def _enrol(self, names: Sequence[Hashable]) -> None:
        """Book the names of landmarks that `_augment` appended."""
        self._row_of |= {name: self.n_landmarks + k for k, name in enumerate(names)}
        self.ids = (*self.ids, *names)
        self.sightings = np.append(self.sightings, np.ones(len(names), dtype=int))
        self.unseen_for = np.append(self.unseen_for, np.zeros(len(names), dtype=int))

    def _replace(
        self,
        mean: Array,
        P: Array,
        ids: tuple[Hashable, ...],
        sightings: NDArray[Any],
        unseen_for: NDArray[Any],
    ) -> None:
        """Take over another state, of any size, in all its parts."""
        self._size = 0
        self._resize(len(mean))
        self._mean[: self._size], self._P[...] = mean, P
        self._mirrored = True
        self.ids, self._row_of = ids, {name: row for row, name in enumerate(ids)}
        self.sightings, self.unseen_for = sightings.copy(), unseen_for.copy()

    def _resize(self, size: int) -> None:
        """Make room for a state of `size` >= the present one and keep what is there."""
        mean, P = self.mean, self._P
        if size > len(self._mean):
            self._mean = np.concatenate([mean, np.empty(max(size, 2 * len(self._mean)))])
        if size * size > len(self._flat):
            self._flat = np.empty(max(size * size, 2 * len(self._flat)))
        old, self._size = self._size, size
        # In the same memory the rows move apart; NumPy sees the overlap and copies first.
        self._P[:old, :old] = P

    # Inside: names, rows and the door.

    def _as_look(
        self, z: ArrayLike, ids: Any, covs: ArrayLike | None
    ) -> tuple[Array, tuple[Hashable, ...], Array]:
        """Check the arguments of `update`."""
        z, names = as_array("z", z, ("k", 2)), _as_ids("ids", ids)
        if len(names) != len(z):
            raise ValueError(f"ids: expected one for each of {len(z)} rows of z, got {len(names)}")
        _refuse_repeated("ids", names)
        R = self.sensor.cov if covs is None else as_covariance("covs", covs, 2)
        if R.ndim > 3 or (R.ndim == 3 and len(R) != len(z)):
            raise ValueError(f"covs: expected shape (2, 2) or ({len(z)}, 2, 2), got {R.shape}")
        return z, names, np.broadcast_to(R, (len(z), 2, 2))

    def _known_rows(self, names: Iterable[Hashable]) -> Rows:
        """Rows of landmarks in the map; an unknown name is refused."""
        names = list(names)
        missing = [name for name in names if name not in self._row_of]
        if missing:
            raise ValueError(f"ids: expected landmarks of the map, got {missing}")
        return np.array([self._row_of[name] for name in names], dtype=np.intp)

    def _as_rows(self, rows: ArrayLike) -> Rows:
        """Check rows that index `landmarks`."""
        array = np.asarray(rows)
        if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
            raise ValueError(f"rows: expected whole numbers of shape (m,), got {rows!r}")
        if ((array < 0) | (array >= self.n_landmarks)).any():
            raise ValueError(f"rows: expected rows of {self.n_landmarks} landmarks, got {rows!r}")
        return array.astype(np.intp)

    def _first_free_id(self) -> int:
        """Next whole number that is no landmark's name and never was one given by `step`."""
        numbers = [name for name in self.ids if isinstance(name, int)]
        return max([self._next_id, *(name + 1 for name in numbers)])

    def _associated(self, z: Array, associate: Any) -> tuple[Hashable | None, ...]:
        """Name the landmark of each measurement, a fresh name if it is new, None to leave out."""
        if associate is None:
            from slamlab.slam.association import nearest_neighbour

            associate = nearest_neighbour
        if not callable(associate):
            names = _as_ids("associate", associate)
            if len(names) != len(z):
                raise ValueError(f"associate: expected {len(z)} ids, got {len(names)}")
            return names
        rows = np.asarray(associate(self, z))
        if rows.shape != (len(z),) or (rows.size and rows.dtype.kind not in "iu"):
            raise ValueError(f"associate: expected {len(z)} rows, whole numbers, got {rows!r}")
        if ((rows < -2) | (rows >= self.n_landmarks)).any():
            raise ValueError(
                f"associate: expected rows of {self.n_landmarks} landmarks, -1 or -2, got {rows!r}"
            )
        fresh = self._first_free_id() + np.cumsum(rows == -1) - 1
        self._next_id = int(fresh.max(initial=self._first_free_id() - 1)) + 1
        return tuple(
            self.ids[row] if row >= 0 else int(name) if row == -1 else None
            for row, name in zip(rows, fresh, strict=True)
        )


@dataclass(frozen=True, eq=False)
class Correction:
    """What an update is about to do; m landmarks in the block, N numbers in the state."""

    rows: Rows
    H_pose: Array  # (m, 2, 3)
    H_landmark: Array  # (m, 2, 2)
    whiten: Array  # (2m, 2m) inverse L^-1 of the lower Cholesky factor of S
    white: Array  # (2m,) L^-1 v
    B: Array  # (2m, N) L^-1 H P
    mean: Array  # (N,) after the update
    innovation: Innovation


@dataclass(frozen=True, eq=False)
class Arrivals:
    """k landmarks about to enter the map."""

    points: Array  # (k, 2)
    G_pose: Array  # (k, 2, 3)
    noise: Array  # (k, 2, 2) G_z R G_z^T


def times_H(H_pose: Array, H_landmark: Array, rows: Array) -> Array:
    """H A, shape (..., 2m, N), from the rows (..., 3 + 2m, N) of A that H does not make zero."""
    *lead, m, _, _ = H_pose.shape
    N = rows.shape[-1]
    pose = H_pose.reshape(*lead, 2 * m, 3) @ rows[..., :3, :]
    landmarks = H_landmark @ rows[..., 3:, :].reshape(*lead, m, 2, N)
    return np.asarray(pose + landmarks.reshape(*lead, 2 * m, N))


def _likelihood(white: Array, whiten: Array) -> tuple[Any, Any]:
    """Squared Mahalanobis distance and log density of the innovation."""
    nis = white @ white
    log_scale = 0.5 * len(white) * np.log(2 * np.pi) - np.log(np.diag(whiten)).sum()
    return nis, -0.5 * nis - log_scale


def _whitener(S: Array) -> Array:
    """Inverse of the lower Cholesky factor of an innovation covariance S."""
    if not len(S):
        return S
    try:
        root = np.linalg.cholesky(S)
    except np.linalg.LinAlgError as error:
        raise ValueError(
            "covs: expected an innovation covariance S = H P H^T + R that is positive definite, "
            f"its smallest eigenvalue is {np.linalg.eigvalsh(S)[0]:.3g}"
        ) from error
    # LAPACK counts columns first and sees L^T, an upper triangle.
    return np.asarray(dtrtri(root.T, lower=0)[0].T)


def _t(matrix: Array) -> Array:
    return np.swapaxes(matrix, -1, -2)


def _read_only(view: Array) -> Array:
    view = view.view()
    view.setflags(write=False)
    return view


def _as_ids(name: str, ids: Any) -> tuple[Hashable, ...]:
    """Names as a tuple of plain Python values: numbers of an array compare equal to ints."""
    try:
        names = tuple(ids.tolist() if isinstance(ids, np.ndarray) else ids)
        names = tuple(one.item() if isinstance(one, np.generic) else one for one in names)
        hash(names)
    except TypeError as error:
        raise ValueError(f"{name}: expected a sequence of names, got {ids!r}") from error
    return names


def _refuse_repeated(name: str, names: Sequence[Hashable]) -> None:
    if len(set(names)) < len(names):
        twice = next(one for k, one in enumerate(names) if one in names[:k])
        raise ValueError(f"{name}: expected every landmark once, got {twice!r} twice")
