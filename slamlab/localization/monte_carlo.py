"""Monte Carlo localization: find the pose in a known map, from anywhere, also when carried off.

P2 (13)-(15) on poses; random injection after Gutmann and Fox (2002). Chapter 04.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import (
    Array,
    as_array,
    as_count,
    as_function,
    as_instance,
    as_rng,
    as_rows,
    as_shaped,
)
from slamlab.filters.particle import KLD, ParticleFilter, PoseParticles
from slamlab.localization.likelihood_field import LikelihoodField
from slamlab.models import MotionModel, as_motion, as_scan_sensor, as_sensor

__all__ = ["MonteCarloLocalization"]

_MOST_DRAWS = 1000  # until every particle lies on free floor


class Scoring(Protocol):
    """A sensor of landmarks that weighs many poses (M, 3) at once; `RangeBearing` is one."""

    def log_likelihood(
        self, poses: ArrayLike, z: ArrayLike, landmarks: ArrayLike, covs: ArrayLike | None = None
    ) -> Array:
        """Log densities (M,) of measurements z (k, 2) of these landmarks (k, 2)."""

    def best_log_likelihood(
        self, poses: ArrayLike, z: ArrayLike, landmarks: ArrayLike, covs: ArrayLike | None = None
    ) -> Array:
        """Log densities (M,), each measurement of whichever landmark (n, 2) explains it best."""


class MonteCarloLocalization(PoseParticles):
    """A robot with a map that does not know where it is.

    The map is a set of landmarks, and `update` takes measurements of them; or it is a
    `LikelihoodField` of walls, and `update` takes the ranges of a lidar.

    The particles start uniformly over `bounds` and all headings. When measurements become less
    likely than they used to be (a short-term average of the likelihood falls below the long-term
    one), a share 1 - fast/slow of the particles is replaced by uniform ones: a kidnapped robot is
    found again.

    A start over a wide floor needs many particles or a sensor model with inflated sigmas: of 3000
    particles on 10 m x 10 m a sharp sensor keeps one or two at the first update, and the cloud
    that grows from them is for a while too small for its error (sample impoverishment).

    Parameters
    ----------
    world : array_like, shape (n, 2), or LikelihoodField
        The map: landmarks (m), at least one, or how well a point fits the walls.
    motion : MotionModel
    sensor : LandmarkSensor or ScanSensor
        What measures it: a sensor of landmarks with ``log_likelihood`` and
        ``best_log_likelihood``, such as `sensors.RangeBearing`, or a lidar.
    n_particles : int
        Number of particles; with `adaptive` the initial one.
    bounds : array_like, shape (2, 2)
        ((x_min, x_max), (y_min, y_max)) of the world (m), the smaller first.
    rng : numpy.random.Generator
    injection : tuple of two floats or None, default (0.05, 0.5)
        Rates of the long-term and the short-term average of the likelihood, 0 < slow < fast <= 1.
        None never injects.
    threshold : float, default 0.5
    resample : str, default "systematic"
    adaptive : KLD, optional
        These three as in `slamlab.filters.particle.ParticleFilter`.
    free : callable, optional
        ``free(points) -> bools``, as `BitmapWorld.is_free`: particles from anywhere begin where it
        is true, not on all of `bounds`.

    Attributes
    ----------
    measures : str
        "landmarks" with landmarks, "scan" with a likelihood field.
    injected : float
        Share of particles replaced by uniform ones in the last `update`.
    ancestors : ndarray of int, shape (M,)
        -1 for an injected particle.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> sensor, trees = RangeBearing(0.2, 0.1), np.array([[1.0, 1.0], [4.0, 2.0], [2.0, 4.0]])
    >>> mcl = MonteCarloLocalization(trees, Unicycle(), sensor, 5000, [[0, 5], [0, 5]],
    ...                              np.random.default_rng(1))
    >>> evidence = mcl.update(sensor.observe([2.0, 2.0, 0.0], trees), ids=[0, 1, 2])
    >>> mcl.pose[:2].round().tolist()
    [2.0, 2.0]
    """

    def __init__(
        self,
        world: ArrayLike | LikelihoodField,
        motion: MotionModel,
        sensor: Any,
        n_particles: int,
        bounds: ArrayLike,
        rng: np.random.Generator,
        injection: tuple[float, float] | None = (0.05, 0.5),
        threshold: float = 0.5,
        resample: str = "systematic",
        adaptive: KLD | None = None,
        free: Callable[[Array], NDArray[np.bool_]] | None = None,
    ) -> None:
        self.motion = as_motion("motion", motion)
        self._map: LikelihoodField | Array  # walls, or landmarks
        if isinstance(world, LikelihoodField):
            self._map, self.measures = world, "scan"
            self.sensor: Any = as_scan_sensor("sensor", sensor)
        else:
            self._map = as_array("world", world, ("n", 2)).copy()
            if len(self._map) == 0:
                raise ValueError("world: expected at least one landmark, got none")
            self.sensor = as_instance("sensor", as_sensor("sensor", sensor), Scoring, "a sensor")
        self._bounds = as_array("bounds", bounds, (2, 2)).copy()
        if not (self._bounds[:, 0] < self._bounds[:, 1]).all():
            raise ValueError(
                f"bounds: expected ((x_min, x_max), (y_min, y_max)), got {self._bounds.tolist()}"
            )
        self._rng = as_rng("rng", rng)
        self._averages = None if injection is None else _LikelihoodAverages(injection)
        self._free = _everywhere if free is None else as_function("free", free)
        self.injected = 0.0
        start = self._anywhere(as_count("n_particles", n_particles, 1))
        self._cloud = ParticleFilter(start, rng, None, threshold, resample, adaptive)
        self._unweighed = np.zeros(n_particles, bool)

    @property
    def pose(self) -> Array:
        """Mean pose (3,); meaningless while several places are possible (see `pose_cov`).

        Particles injected by the last `update` have not been weighed yet and do not count.
        """
        return self._weighed().mean(angles=(2,))

    @property
    def pose_cov(self) -> Array:
        """Covariance (3, 3) of the particles about `pose`, newly injected ones left out."""
        return self._weighed().cov(angles=(2,))

    @property
    def degenerate(self) -> bool:
        """Whether the last measurement was impossible for every particle, and was ignored."""
        return self._cloud.degenerate

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move the particles, each with its own noise, P2 (13) and (16).

        Parameters
        ----------
        u : array_like, shape (p,)
            Control, as the motion model reads it.
        dt : float
            Duration (s).
        control_cov : array_like, shape (p, p)
            Covariance of the control.
        """
        self._cloud.predict(lambda poses, rng: self.motion.sample(poses, u, dt, control_cov, rng))

    def update(
        self, measurement: ArrayLike, ids: ArrayLike | None = None, covs: ArrayLike | None = None
    ) -> float:
        """Weigh the particles, resample, and inject uniform ones if measurements got unlikely.

        Parameters
        ----------
        measurement : array_like, shape (k, 2) or (n_beams,)
            Measurements of landmarks; or ranges of the lidar (m), NaN for a lost beam. Nothing
            measured changes nothing.
        ids : array_like of int, shape (k,), optional
            Row of the landmark of each measurement; not with ranges. Without it each particle
            takes for each measurement the landmark that explains it best (maximum likelihood).
        covs : array_like, shape (k, 2, 2), optional
            Covariance of each measurement; the sensor's by default. Not with ranges.

        Returns
        -------
        float
            Log of the evidence of the measurement.
        """
        # 1. Sample the motion: `predict` has done it.
        # 2. Weigh, (14): how well does each pose explain what was measured?
        log_likelihood, count = self._log_likelihood(measurement, ids, covs)
        if count == 0:
            self.injected = 0.0
            return 0.0
        # 3. Resample, if the weights say so.
        evidence = self._cloud.update(log_likelihood)
        # 4. Inject: replace some by particles from anywhere, if measurements got unlikely.
        share = 0.0 if self._averages is None else self._averages.share(evidence / count)
        n = int(self._rng.binomial(self.n_particles, share)) if share > 0 else 0
        if n and not self.resampled:  # those that are replaced must be of equal weight
            self._cloud.resample()
            n = min(n, self.n_particles)  # if the number is adaptive
        self._unweighed = np.zeros(self.n_particles, bool)
        if n:
            rows = self._rng.choice(self.n_particles, n, replace=False)
            self._cloud.particles[rows] = self._anywhere(n)
            self._cloud.ancestors[rows] = -1
            self._unweighed[rows] = True
        self.injected = n / self.n_particles
        return evidence

    def _log_likelihood(
        self, measurement: ArrayLike, ids: ArrayLike | None, covs: ArrayLike | None
    ) -> tuple[Array, int]:
        """Log likelihood (M,) of the poses; and of how many beams or landmarks."""
        poses = self._cloud.particles
        if isinstance(self._map, LikelihoodField):
            if ids is not None or covs is not None:
                raise ValueError("ids, covs: expected None beside ranges")
            points = self.sensor.points(as_shaped("ranges", measurement, (self.sensor.n_beams,)))
            count = int(np.isfinite(points[:, 0]).sum())
            return self._map.log_likelihood(poses, points), count
        z = as_array("z", measurement, ("k", 2))
        if ids is None:  # each pose takes the landmark that explains a measurement best
            return self.sensor.best_log_likelihood(poses, z, self._map, covs), len(z)
        known = self._map[_checked_ids(ids, len(z), len(self._map))]
        return self.sensor.log_likelihood(poses, z, known, covs), len(z)

    def _weighed(self) -> ParticleFilter:
        """Return the belief without the particles that no measurement has weighed yet."""
        cloud, old = self._cloud, ~self._unweighed
        if old.all() or not old.any():
            return cloud
        return ParticleFilter(cloud.particles[old], self._rng, cloud.weights[old])

    def _anywhere(self, n: int) -> Array:
        """Uniform poses (n, 3) over the bounds, where the floor is free, and all headings."""
        low, high = self._bounds.T
        position = self._rng.uniform(low, high, (n, 2))
        for _ in range(_MOST_DRAWS):
            off = ~np.asarray(self._free(position), bool)
            if not off.any():
                heading = -self._rng.uniform(-np.pi, np.pi, (n, 1))
                return np.concatenate([position, heading], 1)
            position[off] = self._rng.uniform(low, high, (int(off.sum()), 2))
        raise ValueError("free: expected free floor within bounds, found hardly any")


class _LikelihoodAverages:
    """Long-term and short-term average of the likelihood of one measurement.

    Augmented MCL of Probabilistic Robotics (2005), section 8.3, after Gutmann and Fox (2002).
    """

    def __init__(self, rates: tuple[float, float]) -> None:
        self._rates = slow, fast = as_array("injection", rates, (2,)).tolist()
        if not 0 < slow < fast <= 1:
            got = f"{slow:g}, {fast:g}"
            raise ValueError(f"injection: expected rates 0 < slow < fast <= 1, got {got}")
        self._slow = self._fast = -1.0  # before the first one

    def share(self, log_mean_likelihood: float) -> float:
        """Take a likelihood into both; return 1 - fast/slow, the share of particles to inject."""
        likelihood = float(np.exp(min(log_mean_likelihood, 700.0)))
        if self._slow < 0:
            self._slow = self._fast = likelihood
        slow, fast = self._rates
        self._slow += slow * (likelihood - self._slow)
        self._fast += fast * (likelihood - self._fast)
        return 1 - self._fast / self._slow if self._slow > 0 else 0.0


def _everywhere(points: Array) -> NDArray[np.bool_]:
    """Floor that is free wherever one looks."""
    return np.ones(len(points), bool)


def _checked_ids(ids: ArrayLike, count: int, n_landmarks: int) -> NDArray[np.intp]:
    rows = as_rows("ids", ids, n_landmarks)
    if len(rows) != count:
        raise ValueError(f"ids: expected {count} rows, got {len(rows)}")
    return rows
