"""FastSLAM: particles carry the path, and each keeps its landmarks in small Kalman filters.

P2 (12)-(18): version 1.0 proposes from the motion, 2.0 looks at the measurement before it draws.
Chapter 12; after Montemerlo et al. (2002, 2003), maps shared between particles until changed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit

from slamlab._checks import Array, as_array, as_count, as_covariance, as_rng, as_scalar
from slamlab.filters.particle import systematic_resample
from slamlab.geometry import wrap_angle
from slamlab.slam._landmark_filters import Landmarks, compare, correct, information, predict
from slamlab.slam._particle_association import most_likely
from slamlab.slam._particle_view import IGNORED, NEW, ParticleView, check_rows
from slamlab.slam._shared_maps import ABSENT, FIELDS, PAGE, SharedMaps

__all__ = ["FastSlam", "ParticleView"]

Indices = NDArray[np.intp]
Associate = Callable[[ParticleView, Array], ArrayLike]

# Predictions that version 2 redraws at an update; older ones keep the noise they were drawn with.
LOOK_BACK = 8
# Odometry noise of so many sigmas is no guess worth proposing.
ABSURD = 1e6


class _Prediction(NamedTuple):
    """One step of odometry and the white noise that each particle drew for it."""

    u: Array
    dt: float
    root: Array
    noise: Array

    def controls(self, noise: Array) -> Array:
        """Control that each particle executes with white noise (M, p)."""
        return self.u + noise @ self.root.T


class FastSlam:
    """Rao-Blackwellized particle filter for SLAM: paths by particles, landmarks by Kalman filters.

    P2 (12): given its path, a particle's landmarks are independent, so that its map is a set of
    small Gaussians. Everything runs over all particles at once; the maps of copied particles are
    shared until one of them changes a landmark.

    Two ways to say which landmark was measured, not to be mixed in one filter: `ids` with every
    update (known association), or none; then every particle decides for itself, by maximum
    likelihood within a gate or by a callable `associate`.

    Parameters
    ----------
    motion : motion model
        Has ``step``, ``sample`` and ``jacobians``, such as `robots.Unicycle`.
    sensor : sensor
        Has ``observe``, ``jacobians``, ``locate``, ``locate_jacobians``, ``residual`` and ``cov``;
        with `detection` also ``visible``. For example `sensors.RangeBearing`.
    pose : array_like, shape (3,) or (n_particles, 3)
        Where the robot starts (m, m, rad): one pose for all, or one for each particle.
    n_particles : int
        At least 1.
    version : {1, 2}, default 1
        1 proposes from the motion model, P2 (16) and (17). 2 proposes from the motion model and
        the measurement together, P2 (18): it draws the noise of the odometry steps since the last
        update (of the last eight) anew, from its Gaussian posterior.
    rng : numpy.random.Generator
        Source of all randomness.
    threshold : float, default 0.5
        Resample when the effective sample size falls below this share of the particles.
    gate : float, default 0.99
        Probability that a true pair passes the gate of the built-in association. A measurement
        starts a landmark if it lies twice as far (in squared distance) from all others, where a
        true pair comes with probability (1 - gate)^2; in between it is left out.
    detection : (float, float), optional
        Probability that a landmark in view is measured if it exists, and if it does not. With
        unknown association each landmark then keeps log odds of its existence, and is removed
        when they fall below even. By default no landmark is ever removed.
    history : bool, default False
        Keep poses and ancestors of every update, for `trajectory` and `distinct_ancestors`.

    Attributes
    ----------
    poses : ndarray, shape (M, 3)
        One pose a particle, a draw from the belief also between `predict` and `update`.
    log_weights : ndarray, shape (M,)
        Normalised.
    ess : float
        Effective sample size after the last weighting, before any resampling.
    ancestors : ndarray of int, shape (M,)
        Row of each particle's parent in the set before the last `update`.
    resampled : bool
        Whether the last `update` resampled.
    ids : tuple
        Known association: names of the landmarks, in the order of `landmarks`.

    Raises
    ------
    ValueError
        If an argument has a wrong shape or value.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> slam = FastSlam(Unicycle(), RangeBearing(0.1, 0.05), [0, 0, 0], 50, version=2,
    ...                 rng=np.random.default_rng(1))
    >>> for z in ([2.0, 0.0], [1.9, 0.0], [1.8, 0.0]):
    ...     evidence = slam.step([1.0, 0.0], 0.1, np.eye(2) * 0.01, [z], ids=["tree"])
    >>> slam.ids, abs(slam.landmarks).round(0).tolist()
    (('tree',), [[2.0, 0.0]])
    """

    def __init__(
        self,
        motion: Any,
        sensor: Any,
        pose: ArrayLike,
        n_particles: int,
        version: int = 1,
        *,
        rng: np.random.Generator,
        threshold: float = 0.5,
        gate: float = 0.99,
        detection: tuple[float, float] | None = None,
        history: bool = False,
    ) -> None:
        self.motion, self.sensor = motion, sensor
        M = as_count("n_particles", n_particles, 1)
        pose = as_array("pose", pose)
        if pose.shape not in ((3,), (M, 3)):
            raise ValueError(f"pose: expected shape (3,) or ({M}, 3), got {pose.shape}")
        if version not in (1, 2):
            raise ValueError(f"version: expected 1 or 2, got {version!r}")
        self.version = int(version)
        self._rng = as_rng("rng", rng)
        self._threshold = as_scalar("threshold", threshold, 0.0, 1.0)
        # Quantile of chi-square with two degrees of freedom.
        self._gate = -2 * np.log1p(-as_scalar("gate", gate, 0.0, 1 - 1e-12))
        self._hit, self._miss = _log_odds(detection)
        self.poses = np.broadcast_to(pose, (M, 3)).astype(np.float64)
        self.log_weights = np.full(M, -np.log(M))
        self.ess = float(M)
        self.ancestors: Indices = np.arange(M)
        self.resampled = False
        self._maps = SharedMaps(M)
        self._columns: dict[Hashable, int] = {}
        self._unknown = False
        # Predictions since the last update, and the poses before the first of them.
        self._pending: list[_Prediction] = []
        self._origin = self.poses
        self._history: list[tuple[Array, Indices]] | None = [] if history else None

    # The algorithm.

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move every particle by its own draw from the motion model, P2 (16).

        Parameters
        ----------
        u : array_like, shape (p,)
            Control of the motion model.
        dt : float
            Duration (s).
        control_cov : array_like, shape (p, p)
            Covariance of the control; singular is allowed.

        Raises
        ------
        ValueError
            If a shape is wrong, a number is not finite, `dt` is negative or `control_cov` is no
            covariance. The filter is unharmed.
        """
        u = as_array("u", u, ("p",))
        root = _root(as_covariance("control_cov", control_cov, len(u)))
        with self._all_or_nothing():
            noise = self._rng.standard_normal((len(self.poses), len(u)))
            step = _Prediction(u, dt, root, noise)
            self.poses = self.motion.step(self.poses, step.controls(noise), dt)
            self._pending = [*self._pending, step]
            if len(self._pending) > LOOK_BACK:
                oldest, *self._pending = self._pending
                self._origin = self.motion.step(
                    self._origin, oldest.controls(oldest.noise), oldest.dt
                )

    def update(
        self,
        z: ArrayLike,
        ids: Sequence[Hashable] | None = None,
        associate: Associate | None = None,
    ) -> float:
        """Weigh the particles by measurements, correct their maps, resample if they degenerate.

        Parameters
        ----------
        z : array_like, shape (k, 2)
            Measurements of k different landmarks; k may be 0.
        ids : sequence of k hashables, optional
            Names of the landmarks, each once. A name never met starts a landmark.
        associate : callable, optional
            Without `ids`: ``associate(particle, z) -> rows (k,)``, called with a `ParticleView`
            of each particle: row of its map, -1 to start a landmark, -2 to leave out. Without
            both, the built-in maximum likelihood decides for all particles at once.

        Returns
        -------
        float
            Evidence log P(z_k | Z_{k-1}), measurements of new landmarks left out if `ids` are
            given.

        Raises
        ------
        ValueError
            If a shape is wrong, a number is not finite, a range is negative, a name comes twice,
            `ids` are given to a filter that ran without or the reverse, `associate` answers
            something else than rows, or no particle explains the measurements (all weights are
            zero). The filter is then as it was before.
        """
        z = as_array("z", z, ("k", 2))
        if hasattr(self.sensor, "sigma_range") and (z[:, 0] < 0).any():
            raise ValueError(f"z: expected ranges that are not negative, got {z[:, 0].min():g}")
        names = self._checked_ids(ids, len(z), associate)
        with self._all_or_nothing():
            if names is None:
                columns = self._associate(z, associate)
            else:
                columns = np.tile(self._columns_of(names), (len(self.poses), 1))
            return self._update(z, columns, known=names is not None)

    def step(
        self,
        u: ArrayLike,
        dt: float,
        control_cov: ArrayLike,
        z: ArrayLike,
        ids: Sequence[Hashable] | None = None,
        associate: Associate | None = None,
    ) -> float:
        """`predict`, then `update`; if either fails the filter is as it was before both.

        Parameters, result and errors are those of the two.
        """
        with self._all_or_nothing():
            self.predict(u, dt, control_cov)
            return self.update(z, ids, associate)

    def _update(self, z: Array, columns: Indices, known: bool) -> float:
        """Run steps 1 to 4 of P2; measurement j (k, 2) is column (M, k) of each particle's map."""
        seen, old = columns >= 0, self._read(columns)
        # What is new to a particle, or left out, has nothing to compare with.
        met = seen & old.present
        some: NDArray[np.bool_] = np.asarray(met.any(0))
        asked, old, its_own = z[some], old.columns(some), met[:, some]
        # 1. Propose: (16) was drawn by `predict`; (18) draws again, the measurement in sight.
        poses, log_ratio = self._propose(asked, old, its_own)
        # 2. Weigh, (14): likelihood (15) of the measurements, the landmarks integrated out.
        prediction = predict(self.sensor, poses, old)
        comparison = compare(self.sensor, prediction, asked)
        log_likelihood = np.where(its_own, comparison.log_density, 0.0).sum(1)
        if not known:
            log_likelihood += self._log_density_at_the_gate() * (~met).sum(1)
        log_weights, evidence = _log_normalised(self.log_weights + log_ratio + log_likelihood)
        # 4. Correct the landmarks that were met, start those that were not.
        new = np.zeros((FIELDS, *columns.shape))
        new[:, :, some] = correct(self.sensor, prediction, comparison, old).fields
        fresh = (seen & ~met).any(0)
        if fresh.any():
            started = self._started(poses, z[fresh]).fields
            new[:, :, fresh] = np.where(met[:, fresh], new[:, :, fresh], started)
        new[5] += self._hit
        kept = new[:, seen]
        if not np.isfinite(kept).all():
            raise ValueError(f"z: expected measurements of finite landmarks, got {z.tolist()}")
        # 3. Nothing can fail any more: change the filter, and resample if the weights say so.
        self.poses, self.log_weights = poses, log_weights
        self._unknown |= not known
        self._maps.write(np.nonzero(seen)[0], columns[seen], kept.T)
        if not known and self._miss < 0:
            self._doubt_the_unseen(columns)
        self._resample_if_degenerate()
        return evidence

    def _resample_if_degenerate(self) -> None:
        """Step 3 of P2: draw particles with their maps; the weights become equal."""
        weights = self.weights
        M = len(weights)
        self.ess = 1 / float(weights @ weights)
        self.ancestors, self.resampled = np.arange(M), False
        # Equal weights do not count as degenerate because of a rounded last bit.
        if self.ess < self._threshold * M * (1 - 1e-9):
            self.ancestors, self.resampled = systematic_resample(weights, self._rng), True
            self.poses = self.poses[self.ancestors]
            self.log_weights = np.full(M, -np.log(M))
            self._maps.resample(self.ancestors)
        self._pending, self._origin = [], self.poses
        if self._history is not None:
            self._history.append((self.poses, self.ancestors))

    # The proposal of version 2.0.

    def _propose(
        self, z: Array, old: Landmarks, met: NDArray[np.bool_]
    ) -> tuple[Array, Array | float]:
        """Poses of this step and log P(x | ...) / pi(x | ...), the correction in (14)."""
        if self.version == 1 or not self._pending or not met.any():
            return self.poses, 0.0
        # The white noise n of the odometry is the unknown: its prior is N(0, I), and
        # x = f(x_{k-1}, u + root n) holds exactly, also where Q = F_u V F_u^T is singular.
        mean = np.zeros((len(self.poses), sum(len(step.u) for step in self._pending)))
        # Linearised at the prediction, then once more where the first solution points.
        for _ in range(2):
            mean, precision = self._noise_posterior(mean, z, old, met)
        factor = np.linalg.cholesky(precision)
        white = self._rng.standard_normal(mean.shape)
        # n ~ N(mean, precision^-1) with precision = L L^T: n = mean + L^-T white.
        noise = mean + np.linalg.solve(np.swapaxes(factor, 1, 2), white[..., None])[..., 0]
        log_determinant = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(1)
        log_prior, log_proposal = _log_normal(noise), _log_normal(white) + log_determinant
        return self._roll(noise)[0], log_prior - log_proposal

    def _noise_posterior(
        self, noise: Array, z: Array, old: Landmarks, met: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """Mean (M, q) and precision (M, q, q) of the odometry noise, linearised at `noise`."""
        poses, A = self._roll(noise)
        prediction = predict(self.sensor, poses, old)
        matrix, vector = information(prediction, compare(self.sensor, prediction, z), met)
        pull = np.swapaxes(A, 1, 2) @ matrix @ A
        precision = np.eye(A.shape[2]) + pull
        # The residual was taken at `noise`, the prior is centred at 0.
        right = (vector[:, None] @ A)[:, 0] + (pull @ noise[..., None])[..., 0]
        mean = np.linalg.solve(precision, right[..., None])[..., 0]
        # A proposal may be anything that its weight repairs: no need to follow an absurd pull.
        absurd = ~(np.abs(mean) < ABSURD).all(1)
        return np.where(absurd[:, None], 0.0, mean), precision

    def _roll(self, noise: Array) -> tuple[Array, Array]:
        """Poses (M, 3) after the pending predictions, and their derivative by the noise (M, q)."""
        poses, A, start = self._origin, np.zeros((len(noise), 3, 0)), 0
        for step in self._pending:
            controls = step.controls(noise[:, start : start + len(step.u)])
            F_x, F_u = self.motion.jacobians(poses, controls, step.dt)
            A = np.concatenate([F_x @ A, F_u @ step.root], 2)
            poses = self.motion.step(poses, controls, step.dt)
            start += len(step.u)
        return poses, A

    # Maps.

    def _read(self, columns: Indices) -> Landmarks:
        """Landmarks in columns (M, k); a column below 0 stands for none."""
        self._maps.grow(int(columns.max(initial=0)) + 1)
        found = self._maps.read(np.maximum(columns, 0))
        found[5, columns < 0] = ABSENT
        return Landmarks.read(found, self.poses)

    def _started(self, poses: Array, z: Array) -> Landmarks:
        """Landmarks that each particle would start from each measurement: g and G_z R G_z^T."""
        mean = self.sensor.locate(poses[:, None], z)
        _, G = self.sensor.locate_jacobians(poses[:, None], z)
        with np.errstate(over="ignore", invalid="ignore"):
            cov = G @ self.sensor.cov @ np.swapaxes(G, -1, -2)
        return Landmarks.from_moments(mean, cov, np.zeros(mean.shape[:-1]))

    def _doubt_the_unseen(self, columns: Indices) -> None:
        """Lower the odds of landmarks in view that were not measured; drop the unlikely."""
        seen = np.zeros((len(self.poses), self._maps.n_columns), bool)
        particle, measurement = np.nonzero(columns >= 0)
        seen[particle, columns[particle, measurement]] = True
        for first in range(0, self._maps.table.shape[1], 16):
            found = self._maps.read_blocks(first, first + 16)
            landmarks = Landmarks.read(found, self.poses)
            part = slice(first * PAGE, first * PAGE + found.shape[2])
            unseen = landmarks.present & ~seen[:, part]
            unseen &= self.sensor.visible(self.poses[:, None], landmarks.mean)
            found[5] += self._miss
            found[5, found[5] < 0] = ABSENT
            particle, column = np.nonzero(unseen)
            self._maps.write(particle, part.start + column, found[:, unseen].T)

    # Association.

    def _checked_ids(
        self, ids: Sequence[Hashable] | None, k: int, associate: Associate | None
    ) -> list[Hashable] | None:
        """Names as a list without repetition, or None if association is unknown."""
        if ids is None:
            if self._columns:
                raise ValueError("ids: expected names as in earlier updates, got None")
            return None
        if associate is not None:
            raise ValueError("associate: expected None beside ids, got a callable")
        if self._unknown:
            raise ValueError("ids: expected None as in earlier updates, got names")
        names = list(np.asarray(ids).tolist() if isinstance(ids, np.ndarray) else ids)
        if len(names) != k:
            raise ValueError(f"ids: expected {k} names, one a measurement, got {len(names)}")
        try:
            repeated = [name for name, count in Counter(names).items() if count > 1]
        except TypeError as error:
            raise ValueError(f"ids: expected names that can be keys, got {names!r}") from error
        if repeated:
            raise ValueError(f"ids: expected each name once, got {repeated[0]!r} twice or more")
        return names

    def _columns_of(self, names: list[Hashable]) -> Indices:
        """Column of each name; new names get the next ones."""
        known = self._columns
        if any(name not in known for name in names):
            known = dict(known)
            for name in names:
                known.setdefault(name, len(known))
            self._columns = known
        return np.array([known[name] for name in names], dtype=np.intp)

    def _associate(self, z: Array, associate: Associate | None) -> Indices:
        """Column (M, k) of every measurement in every particle's own map; -2: left out."""
        # Version 2 has not drawn yet: it asks at the predicted pose, and knows how uncertain.
        poses, root = self.poses, None
        if self.version == 2 and self._pending:
            poses, root = self._roll(np.zeros((len(poses), sum(len(s.u) for s in self._pending))))
        if associate is None:
            columns = most_likely(self._maps, self.sensor, poses, root, z, self._gate)
        else:
            columns = self._ask(associate, z, poses, root)
        # New landmarks go to the first columns that are free, one after the other.
        new = columns == NEW
        if not new.any():
            return columns
        rank = np.maximum(np.cumsum(new, 1) - 1, 0)
        free = self._maps.free_columns(len(z))
        return np.where(new, np.take_along_axis(free, rank, 1), columns)

    def _ask(self, associate: Associate, z: Array, poses: Array, root: Array | None) -> Indices:
        """Ask `associate` for every particle, and translate rows of its map to columns."""
        columns = np.empty((len(poses), len(z)), np.intp)
        for i, pose in enumerate(poses):
            cov = np.zeros((3, 3)) if root is None else root[i] @ root[i].T
            view = self._view(i, pose, cov)
            rows = np.asarray(associate(view, z))
            check_rows(rows, len(z), view.n_landmarks)
            present = np.flatnonzero(self._maps.map_of(i)[:, 5] > ABSENT)
            columns[i] = np.append(present, [IGNORED, NEW])[rows]
        return columns

    def _log_density_at_the_gate(self) -> float:
        """Return the density at the edge of the gate, for a measurement that nothing explains."""
        determinant = float(np.linalg.det(self.sensor.cov))
        return -0.5 * self._gate - 0.5 * float(np.log(determinant)) - float(np.log(2 * np.pi))

    # What the filter believes.

    @property
    def n_particles(self) -> int:
        """Number of particles M."""
        return len(self.poses)

    @property
    def weights(self) -> Array:
        """Weights, shape (M,); they sum to 1."""
        return np.exp(self.log_weights)

    @property
    def pose(self) -> Array:
        """Weighted mean of the poses, shape (3,); the heading as direction of the mean vector."""
        w, theta = self.weights, self.poses[:, 2]
        mean = w @ self.poses
        mean[2] = np.arctan2(w @ np.sin(theta), w @ np.cos(theta))
        return mean

    @property
    def pose_cov(self) -> Array:
        """Weighted covariance of the poses, shape (3, 3)."""
        deviation = self._pose_deviation()
        return (deviation * self.weights[:, None]).T @ deviation

    @property
    def ids(self) -> tuple[Hashable, ...]:
        """Names of the landmarks (known association), in the order of `landmarks`."""
        return tuple(self._columns)

    @property
    def n_landmarks(self) -> int:
        """Number of rows of `landmarks`."""
        return len(self.landmarks) if self._unknown else len(self._columns)

    @property
    def stored_landmarks(self) -> int:
        """Landmark estimates kept by all particles together, shared ones counted once.

        Counted in whole pages, so that a small map counts a little more than it holds. A filter
        that copies maps with particles keeps `n_particles` times `n_landmarks`.
        """
        return self._maps.pages_in_use * PAGE

    @property
    def landmarks(self) -> Array:
        """Estimated landmarks (n, 2) (m).

        Known association: the mean over all particles. Otherwise each particle numbers its
        landmarks for itself, and this is the map of the heaviest particle.
        """
        if self._unknown:
            return self.particle(int(self.log_weights.argmax())).landmarks
        return self._mixture()[0]

    @property
    def landmark_covs(self) -> Array:
        """Covariances (n, 2, 2) of `landmarks`: of the whole mixture if association is known."""
        if self._unknown:
            return self.particle(int(self.log_weights.argmax())).landmark_covs
        return self._mixture()[1]

    def landmark_cov(self, id: Hashable) -> Array:
        """Covariance (2, 2) of one named landmark over all particles.

        Raises
        ------
        ValueError
            If no landmark has this name.
        """
        if id not in self._columns:
            raise ValueError(f"id: expected the name of a landmark, got {id!r}")
        return self.landmark_covs[self._columns[id]]

    @property
    def mean(self) -> Array:
        """Pose and landmarks as one vector (3 + 2 n,), as EKF-SLAM has it (known association)."""
        return np.concatenate([self.pose, self._named().landmarks.ravel()])

    @property
    def cov(self) -> Array:
        """Covariance (3 + 2 n, 3 + 2 n) of the whole mixture (known association).

        Each particle's landmarks are independent; what they have in common is in the spread of
        the particles, and comes out here.
        """
        n = self._named().n_landmarks
        means, covs = self.landmark_estimates
        off = (means - self.landmarks).reshape(self.n_particles, 2 * n)
        deviation = np.concatenate([self._pose_deviation(), off], 1)
        cov = (deviation * self.weights[:, None]).T @ deviation
        inner = np.tensordot(self.weights, covs, 1)
        for j in range(n):
            part = slice(3 + 2 * j, 5 + 2 * j)
            cov[part, part] += inner[j]
        return cov

    @property
    def landmark_estimates(self) -> tuple[Array, Array]:
        """Means (M, n, 2) and covariances (M, n, 2, 2) of every particle (known association)."""
        n = self._named().n_landmarks
        x, y, xx, xy, yy, _ = self._maps.read_blocks(0, None)[:, :, :n]
        return np.stack([x, y], -1), np.stack([xx, xy, xy, yy], -1).reshape(*x.shape, 2, 2)

    def particle(self, i: int) -> ParticleView:
        """Return one particle: its pose and its own map.

        Parameters
        ----------
        i : int
            Row of `poses`.

        Returns
        -------
        ParticleView

        Raises
        ------
        ValueError
            If there is no such particle.
        """
        if as_count("i", i) >= len(self.poses):
            raise ValueError(f"i: expected a particle below {len(self.poses)}, got {i}")
        return self._view(i, self.poses[i], np.zeros((3, 3)))

    def trajectory(self, i: int) -> Array:
        """Poses (T, 3) of particle i and its ancestors after each update (needs `history`)."""
        row, path = self.particle(i).number, []
        for poses, ancestors in reversed(self._kept_history()):
            path.append(poses[row])
            row = int(ancestors[row])
        return np.array(path[::-1]).reshape(-1, 3)

    def distinct_ancestors(self) -> Indices:
        """Return how many particles of each update have living descendants (T,)."""
        rows, counts = np.arange(len(self.poses)), []
        for _, ancestors in reversed(self._kept_history()):
            counts.append(len(np.unique(rows)))
            rows = ancestors[rows]
        return np.array(counts[::-1], dtype=np.intp)

    def _kept_history(self) -> list[tuple[Array, Indices]]:
        if self._history is None:
            raise ValueError("history: expected a filter made with history=True")
        return self._history

    def _named(self) -> FastSlam:
        if self._unknown:
            raise ValueError("ids: particles that associate for themselves share no numbering")
        return self

    def _pose_deviation(self) -> Array:
        deviation = self.poses - self.pose
        deviation[:, 2] = wrap_angle(deviation[:, 2])
        return deviation

    def _mixture(self) -> tuple[Array, Array]:
        """Means (n, 2) and covariances (n, 2, 2) over all particles, some blocks at a time."""
        weights, means, covs = self.weights, [], []
        for first in range(0, self._maps.table.shape[1], 32):
            x, y, xx, xy, yy, _ = self._maps.read_blocks(first, first + 32)
            mean_x, mean_y = weights @ x, weights @ y
            x, y = x - mean_x, y - mean_y
            means.append(np.stack([mean_x, mean_y], -1))
            entries = [weights @ (xx + x * x), weights @ (xy + x * y), weights @ (yy + y * y)]
            covs.append(np.stack([entries[0], entries[1], entries[1], entries[2]], -1))
        n = len(self._columns)
        if not means:
            return np.zeros((0, 2)), np.zeros((0, 2, 2))
        return np.concatenate(means)[:n], np.concatenate(covs)[:n].reshape(n, 2, 2)

    def _view(self, i: int, pose: Array, pose_cov: Array) -> ParticleView:
        x, y, xx, xy, yy, log_odds = self._maps.map_of(i).T
        here = log_odds > ABSENT
        means = np.stack([x, y], -1)[here]
        covs = np.stack([xx, xy, xy, yy], -1)[here].reshape(-1, 2, 2)
        return ParticleView(
            i,
            pose,
            pose_cov,
            means,
            covs,
            expit(log_odds[here]),
            self.ids,
            self.sensor,
            self.motion,
        )

    @contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        """Restore the filter and its random stream if the block fails.

        Arrays are replaced, never written to, and maps are written when nothing can fail.
        """
        before, stream = dict(self.__dict__), self._rng.bit_generator.state
        try:
            yield
        except BaseException:
            self.__dict__.update(before)
            self._rng.bit_generator.state = stream
            raise


def _root(cov: Array) -> Array:
    """Matrix A with A A^T = cov; cov may be singular."""
    values, vectors = np.linalg.eigh(cov)
    return vectors * np.sqrt(np.clip(values, 0.0, None))


def _log_odds(detection: tuple[float, float] | None) -> tuple[float, float]:
    """Evidence for existence in a sighting, and in its absence."""
    if detection is None:
        return 0.0, 0.0
    both = as_array("detection", detection, (2,))
    real, false = (as_scalar("detection", p, 1e-6, 1 - 1e-6) for p in both)
    if real <= false:
        raise ValueError(f"detection: expected the first above the second, got {detection}")
    return float(np.log(real / false)), float(np.log((1 - real) / (1 - false)))


def _log_normal(white: Array) -> Array:
    """Log density of N(0, I) at (M, q), up to a constant."""
    return -0.5 * (white * white).sum(1)


def _log_normalised(log_weights: Array) -> tuple[Array, float]:
    """Log weights whose exponentials sum to 1, and the logarithm of their former sum."""
    largest = float(log_weights.max())
    if not np.isfinite(largest):
        raise ValueError("z: no particle explains the measurements, all weights are zero")
    total = largest + float(np.log(np.exp(log_weights - largest).sum()))
    return log_weights - total, total
