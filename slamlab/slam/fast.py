"""FastSLAM: particles carry the path, and each keeps its landmarks in small Kalman filters.

P2 (12)-(18): version 1.0 proposes from the motion, 2.0 looks at the measurement before it draws.
Chapter 12; after Montemerlo et al. (2002, 2003), maps shared between particles until changed.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, all_finite, as_array, as_count, as_names, as_rng, as_scalar
from slamlab.filters.particle import ParticleFilter, PoseParticles, restored_on_failure
from slamlab.gaussian import as_root, block_diagonal, chi2_quantile
from slamlab.geometry import wrap_angle
from slamlab.models import LandmarkSensor, MotionModel, as_motion, as_sensor
from slamlab.slam._landmark_filters import (
    Landmarks,
    as_noise,
    compare,
    correct,
    information,
    predict,
    started,
)
from slamlab.slam._landmark_maps import ABSENT, FIELDS, PAGE, LandmarkMaps
from slamlab.slam._particle_association import Associate, Seen, ask, log_density_at, most_likely
from slamlab.slam._particle_view import NEW, ParticleView
from slamlab.slam._proposal import Drawn, Odometry, draw

__all__ = ["FastSlam", "ParticleView"]

Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]


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
        self._rng = as_rng("rng", rng)
        self._gate = float(chi2_quantile(as_scalar("gate", gate, 0.0, 1 - 1e-12), 2))
        self._hit, self._miss = _log_odds(detection_probabilities)
        self._cloud = ParticleFilter(np.broadcast_to(pose, (M, 3)), self._rng, None, threshold)
        self._odometry = Odometry(motion, self._cloud.particles)
        self._maps = LandmarkMaps(M)
        self._columns: dict[Hashable, int] = {}
        self._unknown = False
        self.associations, self.is_new = np.empty((M, 0), np.intp), np.empty((M, 0), bool)

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
        u = as_array("u", u, ("p",)).copy()
        mixing = as_root("control_cov", control_cov, len(u))
        with restored_on_failure(self._rng):
            step = Drawn(u, dt, mixing, self._rng.standard_normal((self.n_particles, len(u))))
            odometry = self._odometry.followed_by(step)
            controls = step.controls(step.noise)
            self._cloud.predict(lambda poses, _: self.motion.step(poses, controls, dt))
            self._odometry = odometry

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
        covs : array_like, shape (k, 2, 2), optional
            Covariance of each measurement; the sensor's by default.

        Returns
        -------
        float
            Evidence log P(z_k | Z_{k-1}), measurements of new landmarks left out if `ids` are
            given.

        Raises
        ------
        ValueError
            If a shape is wrong, a number is not finite, the sensor cannot locate a new landmark,
            a name comes twice, `ids` are given to a filter that ran without or the reverse,
            `associate` answers something else than rows, or no particle explains the measurements
            (all weights are zero). The filter is then as it was before.
        """
        z = as_array("z", z, ("k", 2))
        R, names = as_noise(self.sensor, covs, len(z)), self._checked_ids(ids, len(z))
        with restored_on_failure(self._rng):
            added = self._columns_of_new(names or ())
            if names is None:
                columns = self._associated(z, R, covs is not None)
            else:
                book = ChainMap(self._columns, added)
                same = np.array([book[name] for name in names], dtype=np.intp)
                columns = np.tile(same, (self.n_particles, 1))
            seen, old = columns >= 0, self._landmarks(columns)
            # What is new to a particle, or left out, has nothing to compare with.
            met = seen & old.present
            some = np.asarray(met.any(0))
            pairs = z[some], R[some], old.columns(some), met[:, some]
            # 1. Propose: (16) was drawn by `predict`; (18) draws again, the measurement in sight.
            poses, log_ratio = self._proposed(*pairs)
            # 2. Weigh, (14): likelihood (15) of the measurements, the landmarks integrated out.
            log_likelihood, corrected = self._weighed(poses, *pairs)
            if names is None:
                log_likelihood += (~met) @ log_density_at(self._gate, R)
            log_likelihood += log_ratio
            if not np.isfinite((self._cloud.log_weights + log_likelihood).max()):
                raise ValueError("z: no particle explains the measurements, all weights are zero")
            # 4. Correct the landmarks that were met, start those that were not.
            fresh = seen & ~met
            maps = self._corrected(corrected, some, fresh, poses, z, R)[:, seen].T
            if not all_finite(maps):
                raise ValueError(f"z: expected measurements of finite landmarks, got {z.tolist()}")
        # Nothing can fail any more: change the filter.
        self._columns |= added
        self._unknown = self._unknown or (names is None and len(z) > 0)
        self.associations, self.is_new = columns, fresh
        self._cloud.particles = poses
        self._maps.write(np.nonzero(seen)[0], columns[seen], maps)
        if names is None and self._miss < 0:
            self._doubt_the_unseen(columns)
        # 3. Resample particles with their maps if the weights say so.
        evidence = self._cloud.update(log_likelihood)
        if self.resampled:
            self._maps.shared.resample(self._cloud.ancestors)
        self._odometry = Odometry(self.motion, self._cloud.particles)
        return evidence

    def _proposed(
        self, z: Array, R: Array, old: Landmarks, met: Bools
    ) -> tuple[Array, Array | float]:
        """Poses of this step and log P(x | ...) / pi(x | ...), the correction in (14)."""
        if self.version == 1 or not self._odometry.steps or not met.any():
            return self._cloud.particles, 0.0

        def inform(poses: Array) -> tuple[Array, Array]:
            prediction = predict(self.sensor, poses, old)
            return information(prediction, compare(self.sensor, prediction, z, R), met)

        return draw(self._odometry, inform, self._rng)

    def _weighed(
        self, poses: Array, z: Array, R: Array, old: Landmarks, met: Bools
    ) -> tuple[Array, Landmarks]:
        """Log likelihood (15) of each particle (M,), and its landmarks after the update."""
        prediction = predict(self.sensor, poses, old)
        comparison = compare(self.sensor, prediction, z, R)
        log_likelihood = np.where(met, comparison.log_density, 0.0).sum(1)
        return log_likelihood, correct(prediction, comparison, old)

    def _corrected(
        self, corrected: Landmarks, some: Bools, fresh: Bools, poses: Array, z: Array, R: Array
    ) -> Array:
        """Fields (FIELDS, M, k) of what was measured: `corrected`, or started where `fresh`."""
        new = np.zeros((FIELDS, *fresh.shape))
        new[:, :, some] = corrected.fields
        first = fresh.any(0)
        if first.any():
            there = started(self.sensor, poses, z[first], R[first])
            new[:, :, first] = np.where(fresh[:, first], there.fields, new[:, :, first])
        new[5] += self._hit
        return new

    # Which column of the maps does a measurement belong to?

    def _landmarks(self, columns: Indices) -> Landmarks:
        """Landmarks in columns (M, k); a column below 0 stands for none."""
        found = self._maps.read(np.maximum(columns, 0))
        found[5, columns < 0] = ABSENT
        return Landmarks.read(found, self._cloud.particles)

    def _checked_ids(self, ids: Sequence[Hashable] | None, k: int) -> tuple[Hashable, ...] | None:
        """Names without repetition, or None if association is unknown."""
        if ids is None:
            if self._columns and k:
                raise ValueError("ids: expected names as in earlier updates, got None")
            return () if self._columns else None
        if self._unknown and k:
            raise ValueError("ids: expected None as in earlier updates, got names")
        names = as_names("ids", ids, k)
        if None in names:
            raise ValueError("ids: expected a name for every measurement, got None")
        return names

    def _columns_of_new(self, names: Sequence[Hashable]) -> dict[Hashable, int]:
        """Column of each name that was never met: the next ones."""
        new = [name for name in names if name not in self._columns]
        return {name: i for i, name in enumerate(new, len(self._columns))}

    def _associated(self, z: Array, R: Array, told: bool) -> Indices:
        """Column (M, k) of every measurement in every particle's own map; -2: left out."""
        # Version 2 has not drawn yet: it asks at the predicted pose, and knows how uncertain.
        poses, spread = self._cloud.particles, None
        if self.version == 2 and self._odometry.steps:
            poses, spread = self._odometry.roll()
        seen = Seen(self._maps, self.sensor, poses, spread, z, R, told)
        asked = self.associate
        columns = most_likely(seen, self._gate) if asked is None else ask(seen, asked)
        # New landmarks go to the first columns that are free, one after the other.
        new = columns == NEW
        if not new.any():
            return columns
        rank = np.maximum(np.cumsum(new, 1) - 1, 0)
        free = self._maps.free_columns(len(z))
        return np.where(new, np.take_along_axis(free, rank, 1), columns)

    def _doubt_the_unseen(self, columns: Indices) -> None:
        """Lower the odds of landmarks in view that were not measured; drop the unlikely."""
        poses = self._cloud.particles
        seen = np.zeros((len(poses), self._maps.n_columns), bool)
        particle, measurement = np.nonzero(columns >= 0)
        seen[particle, columns[particle, measurement]] = True
        for first, fields in self._maps.blocks():
            landmarks = Landmarks.read(fields, poses)
            unseen = landmarks.present & ~seen[:, first : first + fields.shape[2]]
            unseen &= self.sensor.visible(poses[:, None], landmarks.mean)
            fields[5] += self._miss
            fields[5, fields[5] < 0] = ABSENT
            particle, column = np.nonzero(unseen)
            self._maps.write(particle, first + column, fields[:, unseen].T)

    # What the filter believes.

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
        if self._unknown:
            view = self.particle(int(self._cloud.log_weights.argmax()))
            return view.landmarks, view.landmark_covs
        return self._maps.mixture(self.weights, len(self._columns))

    def landmark_cov(self, id: Hashable) -> Array:
        """Covariance (2, 2) of one named landmark over all particles.

        Raises
        ------
        ValueError
            If no landmark has this name.
        """
        if as_names("id", [id])[0] not in self._columns:
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
        return self._named()._maps.estimates(len(self._columns))

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
        if as_count("i", i) >= self.n_particles:
            raise ValueError(f"i: expected a particle below {self.n_particles}, got {i}")
        pose = self._cloud.particles[i].copy()
        return ParticleView.of(i, self._maps, pose, np.zeros((3, 3)), self.sensor, self.ids)

    def _named(self) -> FastSlam:
        if self._unknown:
            raise ValueError("ids: particles that associate for themselves share no numbering")
        return self

    def _contents(self) -> str:
        return f"version {self.version}.0, {self.n_landmarks} landmarks, "


def _log_odds(detection_probabilities: tuple[float, float] | None) -> tuple[float, float]:
    """Evidence for existence in a sighting, and in its absence."""
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
