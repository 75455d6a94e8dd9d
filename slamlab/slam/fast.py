"""FastSLAM: particles carry the path, and each keeps its landmarks in small Kalman filters.

P2 (12)-(18): version 1.0 proposes from the motion, 2.0 looks at the measurement before it draws.
Chapter 12; after Montemerlo et al. (2002, 2003), maps shared between particles until changed.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import (
    Array,
    all_finite,
    as_array,
    as_count,
    as_landmarks,
    as_names,
    as_scalar,
)
from slamlab.filters.particle import ParticleFilter, PoseParticles, rollback
from slamlab.gaussian import block_diagonal, cached_sqrt, chi2_quantile, inverse_2x2
from slamlab.geometry import wrap_angle
from slamlab.models import LandmarkSensor, MotionModel, as_motion, as_sensor
from slamlab.slam._landmark_maps import ABSENT, PAGE, LandmarkMaps, unpacked
from slamlab.slam._particle_association import Associate, Query, ask, log_density_at, most_likely
from slamlab.slam._particle_view import ParticleView
from slamlab.slam.association import NEW

__all__ = ["FastSlam", "ParticleView"]

Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]
LOOK_BACK = 8  # predictions that are drawn again at an update; older ones keep their noise
MAX_NOISE = 1e6  # sigmas of odometry: a proposal farther off is not followed


class OdometryStep(NamedTuple):
    """One prediction, x' = f(x, u + A n) with n ~ N(0, I), from poses (M, 3) `before` it."""

    before: Array
    u: Array
    dt: float
    A: Array


class FastSlam(PoseParticles):
    """Rao-Blackwellized particle filter for SLAM: paths by particles, landmarks by Kalman filters.

    P2 (12): given its path, a particle's landmarks are independent, so that its map is a set of
    small Gaussians. Everything runs over all particles at once; the maps of copied particles are
    shared until one of them changes a landmark.

    Two ways to say which landmark was measured, not to be mixed in one filter: `ids` with every
    update (known association), or none; then every particle decides for itself, by maximum
    likelihood within a gate or by a callable `associate`. The path of each particle comes out of
    ``poses`` and ``ancestors`` of all steps by `filters.particle.lineage`.

    Parameters
    ----------
    motion : MotionModel
        Such as `robots.Unicycle`.
    sensor : LandmarkSensor
        Such as `sensors.RangeBearing`. The built-in association also asks for its ``reach``, and
        `detection_probabilities` for ``visible``.
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
    associate : callable, optional
        ``associate(particle, z) -> rows (k,)``, called with a `ParticleView` of each particle
        when no `ids` come, and with ``covs=`` if an update has them: row of its map, -1 to start
        a landmark, -2 to leave out. The built-in maximum likelihood decides for all at once.
    gate : float, default 0.99
        Probability that a true pair passes the gate of the built-in association. A measurement
        starts a landmark if it lies twice as far (in squared distance) from all others, where a
        true pair comes with probability (1 - gate)^2; in between it is left out.
    detection_probabilities : (float, float), optional
        Probability that a landmark in view is measured if it exists, and if it does not. With
        unknown association each landmark then keeps log odds of its existence, and is removed
        when they fall below even. By default no landmark is ever removed.

    Attributes
    ----------
    ids : tuple
        Known association: names of the landmarks, in the order of `landmarks`.
    associations : ndarray of int, shape (M, k)
        Column of the particle's own map that each measurement of the last update belongs to; -2
        where it was left out. Rows are the particles before they were resampled.
    is_new : ndarray of bool, shape (M, k)
        Which of these began a landmark.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> slam = FastSlam(Unicycle(), RangeBearing(0.1, 0.05), [0, 0, 0], 50, version=2,
    ...                 rng=np.random.default_rng(1))
    >>> for z in ([2.0, 0.0], [1.9, 0.0], [1.8, 0.0]):
    ...     slam.predict([1.0, 0.0], 0.1, np.eye(2) * 0.01)
    ...     evidence = slam.update([z], ids=["tree"])
    >>> slam.ids, abs(slam.landmarks).round(0).tolist()
    (('tree',), [[2.0, 0.0]])
    """

    def __init__(
        self,
        motion: MotionModel,
        sensor: LandmarkSensor,
        pose: ArrayLike,
        n_particles: int,
        version: int = 1,
        *,
        rng: np.random.Generator,
        threshold: float = 0.5,
        associate: Associate | None = None,
        gate: float = 0.99,
        detection_probabilities: tuple[float, float] | None = None,
    ) -> None:
        self.motion, self.sensor = as_motion("motion", motion), as_sensor("sensor", sensor)
        self.associate = associate
        M = as_count("n_particles", n_particles, 1)
        pose = as_array("pose", pose)
        if pose.shape not in ((3,), (M, 3)):
            raise ValueError(f"pose: expected shape (3,) or ({M}, 3), got {pose.shape}")
        if version not in (1, 2):
            raise ValueError(f"version: expected 1 or 2, got {version!r}")
        self.version = int(version)
        self._gate = float(chi2_quantile(as_scalar("gate", gate, 0.0, 1 - 1e-12), 2))
        self._evidence = _log_odds(detection_probabilities)
        self._cloud = ParticleFilter(np.broadcast_to(pose, (M, 3)), rng, None, threshold)
        self._steps: list[OdometryStep] = []  # since the last update
        self._maps = LandmarkMaps(M)
        # Columns of the names; None once each particle numbers its landmarks for itself.
        self._names: dict[Hashable, int] | None = {}
        self.associations, self.is_new = np.empty((M, 0), np.intp), np.empty((M, 0), bool)

    # The algorithm.

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move every particle by its own draw from the motion model, P2 (16).

        Parameters
        ----------
        u : array_like, shape (p,)
            Control of the motion model.
        dt : float
            Duration (s), not negative.
        control_cov : array_like, shape (p, p)
            Covariance of the control; singular is allowed.
        """
        u = as_array("u", u, ("p",)).copy()
        A = cached_sqrt("control_cov", control_cov, len(u))
        with rollback(self._cloud.rng):
            noise = self._cloud.rng.standard_normal((self.n_particles, len(u)))
            step = OdometryStep(self._cloud.particles, u, dt, A)
            self._cloud.predict(lambda poses, _: self.motion.step(poses, u + noise @ A.T, dt))
        self._steps = [*self._steps, step][-LOOK_BACK:]

    def update(
        self, z: ArrayLike, ids: Sequence[Hashable] | None = None, covs: ArrayLike | None = None
    ) -> float:
        """Weigh the particles by measurements, correct their maps, resample if they degenerate.

        Parameters
        ----------
        z : array_like, shape (k, 2)
            Measurements of k different landmarks; k may be 0.
        ids : sequence of k hashables, optional
            Names of the landmarks, each once. A name never met starts a landmark. Without them
            each particle decides for itself.
        covs : array_like, shape (2, 2) or (k, 2, 2), optional
            Covariances R of the measurements, if they are not the sensor's `cov`.

        Returns
        -------
        float
            Evidence log P(z_k | Z_{k-1}), measurements of new landmarks left out if `ids` are
            given.

        Raises
        ------
        ValueError
            If the sensor cannot locate a new landmark, `ids` are given to a filter that ran
            without or the reverse, or no particle explains the measurements (all weights are
            zero). The filter is then as it was.
        """
        z, R = as_landmarks(z, covs, self.sensor.cov)
        names = self._checked_ids(ids, len(z))
        with rollback(self._cloud.rng):
            if names is None:
                columns = self._associated(z, R, covs is not None)
            else:
                columns = self._columns_of(names)
            means, P, log_odds = self._maps.read(columns, self._cloud.particles)
            known = log_odds > ABSENT  # (M, k): has this particle met the landmark?
            is_new = (columns >= 0) & ~known
            old = known.any(0)
            # 1. Propose: (16) was drawn by `predict`; (18) draws again, the measurement in sight.
            poses, log_ratio = self._proposal(means, P, z, R, known)
            # 2. Weigh, (14): likelihood (15) of the measurements, the landmarks integrated out.
            v, H, _, S = self._compared(poses, means[:, old], P[:, old], z[old], R[old])
            S_inv, det = inverse_2x2(S)
            with np.errstate(over="ignore", invalid="ignore"):  # 1e154 sigmas off: density 0
                d2 = np.einsum("...i,...ij,...j", v, S_inv, v)
            log_density = -0.5 * d2 - 0.5 * np.log(det) - np.log(2 * np.pi)  # (15)
            log_likelihood = np.where(known[:, old], log_density, 0.0).sum(1) + log_ratio  # (14)
            if names is None:
                log_likelihood += ~known @ log_density_at(self._gate, R)
            if not np.isfinite((self._cloud.log_weights + log_likelihood).max()):
                raise ValueError("z: no particle explains the measurements, all weights are zero")
            # 4. Correct the landmarks that were met, start those that were not.
            K = P[:, old] @ H.mT @ S_inv
            A = np.eye(2) - K @ H
            means[:, old] += np.einsum("...ij,...j->...i", K, v)
            P[:, old] = A @ P[:, old] @ A.mT + K @ R[old] @ K.mT  # Joseph's form
            means[is_new], P[is_new] = self._initialise(poses, z, R, is_new)
            if not (all_finite(means[columns >= 0]) and all_finite(P[columns >= 0])):
                raise ValueError(f"z: expected measurements of finite landmarks, got {z.tolist()}")
        # Nothing can fail any more: change the filter.
        if names:
            self._names = (self._names or {}) | dict(zip(names, columns[0], strict=True))
        elif names is None and len(z):
            self._names = None
        self.associations, self.is_new = columns, is_new
        self._cloud.particles = poses
        hit, miss = self._evidence
        self._maps.write(columns, means, P, np.where(is_new, 0.0, log_odds) + hit)
        if names is None and miss < 0:
            self._lower_odds_of_unobserved(columns, miss)
        # 3. Resample particles with their maps if the weights say so.
        evidence = self._cloud.update(log_likelihood)
        if self.resampled:
            self._maps.shared.resample(self._cloud.ancestors)
        self._steps = []
        return evidence

    def _compared(
        self, poses: Array, means: Array, P: Array, z: Array, R: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Innovation, its Jacobians by landmark and by pose, its covariance; (M, k, ...) each."""
        H_pose, H = self.sensor.jacobians(poses[:, None], means)
        v = self.sensor.residual(z, self.sensor.observe(poses[:, None], means))
        return v, H, H_pose, H @ P @ H.mT + R

    def _initialise(self, poses: Array, z: Array, R: Array, is_new: Bools) -> tuple[Array, Array]:
        """Means (l, 2) and covariances (l, 2, 2) of landmarks where `is_new`: g, G_z R G_z^T."""
        new = is_new.any(0)
        if not new.any():
            return np.zeros((0, 2)), np.zeros((0, 2, 2))
        means = self.sensor.locate(poses[:, None], z[new])
        _, G = self.sensor.locate_jacobians(poses[:, None], z[new])
        with np.errstate(over="ignore", invalid="ignore"):
            P = G @ R[new] @ G.mT
            return means[is_new[:, new]], (0.5 * (P + P.mT))[is_new[:, new]]

    # Version 2.0: P2 (18) for the noise n of the odometry, x = f(x_{k-1}, u + A n), n ~ N(0, I).
    # Drawing n and not x is exact also where the covariance of the pose has no inverse.

    def _proposal(
        self, means: Array, P: Array, z: Array, R: Array, known: Bools
    ) -> tuple[Array, Array | float]:
        """Poses (M, 3) drawn from (18), and log P(x | x_{k-1}, u) / pi(x), their share of (14)."""
        if self.version == 1 or not self._steps or not known.any():
            return self._cloud.particles, 0.0
        old = known.any(0)
        means, P, z, R, known = means[:, old], P[:, old], z[old], R[old], known[:, old]
        noise = np.zeros((self.n_particles, sum(len(step.u) for step in self._steps)))
        for _ in range(2):  # linearised at the prediction, then where the first solution points
            poses, J = self._propagate(noise)
            v, _, H_pose, S = self._compared(poses, means, P, z, R)
            H = H_pose @ J[:, None]  # of the measurement by the noise
            HtS = H.mT @ inverse_2x2(S)[0] * known[..., None, None]
            information = (HtS @ H).sum(1)
            precision = np.eye(J.shape[2]) + information  # the prior of the noise is N(0, I)
            v = np.where(known[..., None], v, 0.0)
            right = (HtS @ v[..., None]).sum(1) + information @ noise[..., None]
            noise = np.linalg.solve(precision, right)[..., 0]
            noise[~(np.abs(noise) < MAX_NOISE).all(1)] = 0.0
        L = np.linalg.cholesky(precision)
        white = self._cloud.rng.standard_normal(noise.shape)
        noise = noise + np.linalg.solve(L.mT, white[..., None])[..., 0]  # precision^-1 = L^-T L^-1
        log_det = np.log(np.diagonal(L, axis1=1, axis2=2)).sum(1)
        return self._propagate(noise)[0], 0.5 * (white**2 - noise**2).sum(1) - log_det

    def _propagate(self, noise: Array) -> tuple[Array, Array]:
        """Poses (M, 3) after all steps with noise (M, q), and their derivative by it (M, 3, q)."""
        poses, J, first = self._steps[0].before, np.zeros((len(noise), 3, 0)), 0
        for _, u, dt, A in self._steps:
            executed = u + noise[:, first : first + len(u)] @ A.T
            F, G = self.motion.jacobians(poses, executed, dt)
            poses, J = self.motion.step(poses, executed, dt), np.concatenate([F @ J, G @ A], 2)
            first += len(u)
        return poses, J

    # Which column of the maps does a measurement belong to?

    def _checked_ids(self, ids: Sequence[Hashable] | None, k: int) -> tuple[Hashable, ...] | None:
        """Names without repetition, or None if association is unknown."""
        if ids is None:
            if self._names and k:
                raise ValueError("ids: expected names as in earlier updates, got None")
            return () if self._names else None
        if self._names is None and k:
            raise ValueError("ids: expected None as in earlier updates, got names")
        names = as_names("ids", ids, k)
        if None in names:
            raise ValueError("ids: expected a name for every measurement, got None")
        return names

    def _columns_of(self, names: Sequence[Hashable]) -> Indices:
        """Column (M, k) of each name, the same in all maps; new names take the next ones."""
        known = self._names or {}
        new = [name for name in names if name not in known]
        column = known | {name: i for i, name in enumerate(new, len(known))}
        row = np.array([column[name] for name in names], np.intp)
        return np.tile(row, (self.n_particles, 1))

    def _associated(self, z: Array, R: Array, given: bool) -> Indices:
        """Column (M, k) of every measurement in every particle's own map; -2: left out.

        New landmarks go to the first columns that are free, one after the other.
        """
        # Version 2 has not drawn yet: it asks at the predicted pose, and knows how uncertain.
        poses, sqrt_cov = self._cloud.particles, None
        if self.version == 2 and self._steps:
            zero = np.zeros((self.n_particles, sum(len(step.u) for step in self._steps)))
            poses, sqrt_cov = self._propagate(zero)
        query = Query(self._maps, self.sensor, poses, sqrt_cov, z, R, given)
        if self.associate is None:
            columns = most_likely(query, self._gate)
        else:
            columns = ask(query, self.associate)
        new = columns == NEW
        if not new.any():
            return columns
        rank = np.maximum(np.cumsum(new, 1) - 1, 0)
        free = self._maps.free_columns(len(z))
        return np.where(new, np.take_along_axis(free, rank, 1), columns)

    def _lower_odds_of_unobserved(self, columns: Indices, miss: float) -> None:
        """Lower the odds of landmarks in view that were not measured; drop the unlikely."""
        poses = self._cloud.particles
        observed = np.zeros((len(poses), self._maps.n_columns), bool)
        particle, measurement = np.nonzero(columns >= 0)
        observed[particle, columns[particle, measurement]] = True
        for first, fields in self._maps.blocks():
            means, P, log_odds = unpacked(fields, poses)
            n = log_odds.shape[1]
            missed = (log_odds > ABSENT) & ~observed[:, first : first + n]
            missed &= self.sensor.visible(poses[:, None], means)
            log_odds = log_odds + miss
            log_odds[log_odds < 0] = ABSENT
            block = np.where(missed, np.arange(first, first + n), -1)
            self._maps.write(block, means, P, log_odds)

    # What the filter believes.

    @property
    def ids(self) -> tuple[Hashable, ...]:
        """Names of the landmarks (known association), in the order of `landmarks`."""
        return tuple(self._names or ())

    @property
    def n_landmarks(self) -> int:
        """Number of rows of `landmarks`."""
        return len(self.landmarks) if self._names is None else len(self._names)

    @property
    def stored_landmarks(self) -> int:
        """Landmark estimates kept by all particles together, shared ones counted once.

        Counted in whole pages, so that a small map counts a little more than it holds. A filter
        that copies maps with particles keeps `n_particles` times `n_landmarks`.
        """
        return self._maps.shared.in_use * PAGE

    @property
    def landmarks(self) -> Array:
        """Estimated landmarks (n, 2) (m).

        Known association: the mean over all particles. Otherwise each particle numbers its
        landmarks for itself, and this is the map of the heaviest particle.
        """
        return self._landmarks_and_covs()[0]

    @property
    def landmark_covs(self) -> Array:
        """Covariances (n, 2, 2) of `landmarks`: of the whole mixture if association is known."""
        return self._landmarks_and_covs()[1]

    def _landmarks_and_covs(self) -> tuple[Array, Array]:
        if self._names is None:
            view = self.particle(int(self._cloud.log_weights.argmax()))
            return view.landmarks, view.landmark_covs
        return self._maps.mixture(self.weights, len(self._names))

    def landmark_cov(self, id: Hashable) -> Array:
        """Covariance (2, 2) of one named landmark over all particles."""
        names = self._names or {}
        if as_names("id", [id])[0] not in names:
            raise ValueError(f"id: expected the name of a landmark, got {id!r}")
        return self.landmark_covs[names[id]]

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
        means, covs = self.landmark_estimates
        M, n, _ = means.shape
        pose = self._cloud.particles - self.pose
        pose[:, 2] = wrap_angle(pose[:, 2])
        deviation = np.concatenate([pose, (means - self.landmarks).reshape(M, 2 * n)], 1)
        cov = (deviation * self.weights[:, None]).T @ deviation
        cov[3:, 3:] += block_diagonal(np.tensordot(self.weights, covs, 1))
        return cov

    @property
    def landmark_estimates(self) -> tuple[Array, Array]:
        """Means (M, n, 2) and covariances (M, n, 2, 2) of every particle (known association)."""
        return self._named()._maps.estimates(self.n_landmarks)

    def particle(self, i: int) -> ParticleView:
        """Return one particle: its pose and its own map.

        Parameters
        ----------
        i : int
            Row of `poses`.

        Returns
        -------
        ParticleView
        """
        if as_count("i", i) >= self.n_particles:
            raise ValueError(f"i: expected a particle below {self.n_particles}, got {i}")
        pose = self._cloud.particles[i].copy()
        return ParticleView.of(i, self._maps, pose, np.zeros((3, 3)), self.sensor, self.ids)

    def _named(self) -> FastSlam:
        if self._names is None:
            raise ValueError("ids: particles that associate for themselves share no numbering")
        return self

    def _contents(self) -> str:
        return f"version {self.version}.0, {self.n_landmarks} landmarks, "


def _log_odds(detection_probabilities: tuple[float, float] | None) -> tuple[float, float]:
    """Evidence for existence in an observation, and in its absence."""
    if detection_probabilities is None:
        return 0.0, 0.0
    both = as_array("detection_probabilities", detection_probabilities, (2,))
    real, false = (as_scalar("detection_probabilities", p, 1e-6, 1 - 1e-6) for p in both)
    if real <= false:
        raise ValueError(
            "detection_probabilities: expected the first above the second, "
            f"got {detection_probabilities}"
        )
    return float(np.log(real / false)), float(np.log((1 - real) / (1 - false)))
