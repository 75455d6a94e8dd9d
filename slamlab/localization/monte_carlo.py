"""Monte Carlo localization: find the pose in a known map, from anywhere, also when carried off.

P2 (13)-(15) on poses; random injection after Gutmann and Fox (2002). Chapter 04.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_count, as_rng, as_scalar
from slamlab.filters.particle import KLD, ParticleFilter

__all__ = ["Motion", "MonteCarloLocalization", "Sensor"]


class Motion(Protocol):
    """What localization needs of a robot; `slamlab.robots.Unicycle` is one."""

    def sample(
        self,
        pose: ArrayLike,
        u: ArrayLike,
        dt: float,
        control_cov: ArrayLike,
        rng: np.random.Generator,
    ) -> Array:
        """Draw next poses (M, 3) from poses (M, 3)."""


class Sensor(Protocol):
    """What localization needs of a sensor of landmarks; `slamlab.sensors.RangeBearing` is one."""

    def log_likelihood(self, poses: ArrayLike, z: ArrayLike, landmarks: ArrayLike) -> Array:
        """Log density (M,) of measurements (k, 2) of landmarks (k, 2) from poses (M, 3)."""

    def best_log_likelihood(self, poses: ArrayLike, z: ArrayLike, landmarks: ArrayLike) -> Array:
        """Give the same for unknown landmarks: each of (k, 2) takes the best of (n, 2)."""


class MonteCarloLocalization:
    """A robot with a map of landmarks that does not know where it is.

    The particles start uniformly over `bounds` and all headings. When measurements become less
    likely than they used to be (a short-term average of the likelihood falls below the long-term
    one), a share 1 - fast/slow of the particles is replaced by uniform ones: a kidnapped robot is
    found again.

    A start over a wide floor needs many particles or a sensor model with inflated sigmas: of 3000
    particles on 10 m x 10 m a sharp sensor keeps one or two at the first update, and the cloud
    that grows from them is for a while too small for its error (sample impoverishment).

    Parameters
    ----------
    landmarks : array_like, shape (n, 2)
        The map (m). Not used with `log_likelihood`.
    motion : Motion
        Has ``sample(poses, u, dt, control_cov, rng)``.
    sensor : Sensor or None
        Has ``log_likelihood(poses, z, landmarks)`` and ``best_log_likelihood``; None with
        `log_likelihood`.
    n_particles : int
        Number of particles; with `adaptive` the initial one.
    bounds : array_like, shape (2, 2)
        ((x_min, x_max), (y_min, y_max)) of the world (m).
    rng : numpy.random.Generator
    injection : tuple of two floats or None, default (0.05, 0.5)
        Rates of the long-term and the short-term average of the likelihood, 0 < slow < fast <= 1.
        None never injects.
    threshold : float, default 0.5
    resample : str, default "systematic"
    adaptive : KLD, optional
        These three as in `slamlab.filters.particle.ParticleFilter`.
    log_likelihood : callable, optional
        ``log_likelihood(poses, z) -> (M,)``: takes the place of sensor and landmarks, for example
        for a lidar and a likelihood field. `z` is passed through untouched.

    Attributes
    ----------
    injected : float
        Share of particles replaced by uniform ones in the last `update`.

    Raises
    ------
    ValueError
        If a shape is wrong, bounds are empty, rates are not ordered, or neither sensor nor
        likelihood is given.
    """

    def __init__(
        self,
        landmarks: ArrayLike,
        motion: Motion,
        sensor: Sensor | None,
        n_particles: int,
        bounds: ArrayLike,
        rng: np.random.Generator,
        injection: tuple[float, float] | None = (0.05, 0.5),
        threshold: float = 0.5,
        resample: str = "systematic",
        adaptive: KLD | None = None,
        log_likelihood: Callable[[Array, ArrayLike], ArrayLike] | None = None,
    ) -> None:
        self._landmarks = as_array("landmarks", landmarks, ("n", 2))
        self._motion, self._sensor, self._given = motion, sensor, log_likelihood
        if log_likelihood is None and (sensor is None or len(self._landmarks) == 0):
            raise ValueError(
                "sensor: expected a sensor and at least one landmark, or log_likelihood"
            )
        self._bounds = as_array("bounds", bounds, (2, 2))
        if not (self._bounds[:, 0] < self._bounds[:, 1]).all():
            raise ValueError(
                f"bounds: expected ((x_min, x_max), (y_min, y_max)), got {self._bounds.tolist()}"
            )
        self._rng = as_rng("rng", rng)
        self._rates = _checked_rates(injection)
        self._slow = self._fast = -1.0
        self.injected = 0.0
        start = self._anywhere(as_count("n_particles", n_particles, 1))
        self._filter = ParticleFilter(
            start, rng, threshold=threshold, resample=resample, adaptive=adaptive
        )

    @property
    def particles(self) -> Array:
        """Poses of the particles, shape (M, 3)."""
        return self._filter.particles

    @property
    def weights(self) -> Array:
        """Weights of the particles, shape (M,); they sum to 1."""
        return self._filter.weights

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
    def ess(self) -> float:
        """Effective sample size after the last weighting, before resampling."""
        return self._filter.ess

    @property
    def ancestors(self) -> NDArray[np.intp]:
        """Row of each particle's parent before the last `update`; -1 for an injected one."""
        return self._filter.ancestors

    @property
    def degenerate(self) -> bool:
        """Whether the last measurement was impossible for every particle, and was ignored."""
        return self._filter.degenerate

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move the particles, each with its own noise, P2 (13) and (16).

        Parameters
        ----------
        u : array_like
            Control, as the motion model reads it.
        dt : float
            Duration (s).
        control_cov : array_like
            Covariance of the control.
        """
        self._filter.predict(
            lambda poses, rng: self._motion.sample(poses, u, dt, control_cov, rng)
        )

    def update(self, z: ArrayLike, ids: ArrayLike | None = None) -> float:
        """Weigh the particles, resample, and inject uniform ones if measurements got unlikely.

        Parameters
        ----------
        z : array_like, shape (k, 2)
            Measurements; none (k = 0) changes nothing. With the callable likelihood, anything.
        ids : array_like of int, shape (k,), optional
            Row of the landmark of each measurement. Without it each particle takes for each
            measurement the landmark that explains it best (maximum likelihood).

        Returns
        -------
        float
            Log of the evidence of the measurement.

        Raises
        ------
        ValueError
            If a shape is wrong, a number is not finite, or an id does not exist.
        """
        count = 1
        if self._given is not None:
            values = np.asarray(self._given(self.particles, z), dtype=float)
        else:
            z = as_array("z", z, ("k", 2))
            self.injected = 0.0
            if len(z) == 0:
                return 0.0
            count = len(z)
            values = self._log_likelihood(z, ids)
        evidence = self._filter.update(values)
        self._inject(evidence / count)
        return evidence

    def step(
        self,
        u: ArrayLike,
        dt: float,
        control_cov: ArrayLike,
        z: ArrayLike,
        ids: ArrayLike | None = None,
    ) -> None:
        """Predict, then update."""
        self.predict(u, dt, control_cov)
        self.update(z, ids)

    def _log_likelihood(self, z: Array, ids: ArrayLike | None) -> Array:
        """Log likelihood (M,), landmarks given or chosen by each particle for each measurement."""
        assert self._sensor is not None
        if ids is not None:
            rows = _checked_ids(ids, len(z), len(self._landmarks))
            return self._sensor.log_likelihood(self.particles, z, self._landmarks[rows])
        return self._sensor.best_log_likelihood(self.particles, z, self._landmarks)

    def _inject(self, log_mean_likelihood: float) -> None:
        """Follow the likelihood of one measurement; replace 1 - fast/slow of the particles."""
        self.injected = 0.0
        if self._rates is None:
            return
        likelihood = float(np.exp(min(log_mean_likelihood, 700.0)))
        if self._slow < 0:
            self._slow = self._fast = likelihood
        self._slow += self._rates[0] * (likelihood - self._slow)
        self._fast += self._rates[1] * (likelihood - self._fast)
        share = 1 - self._fast / self._slow if self._slow > 0 else 0.0
        M = len(self.particles)
        n = int(self._rng.binomial(M, share)) if share > 0 else 0
        if n:
            self._replace(n)
        self.injected = n / len(self.particles)

    def _replace(self, n: int) -> None:
        """Replace n particles of a set of equal weights by uniform ones."""
        if not self._filter.resampled:
            self._filter.resample()
        n = min(n, len(self.particles))
        rows = self._rng.choice(len(self.particles), n, replace=False)
        self._filter.particles[rows] = self._anywhere(n)
        self._filter.ancestors[rows] = -1

    def _weighed(self) -> ParticleFilter:
        """Return the belief without the particles that no measurement has weighed yet."""
        old = self.ancestors >= 0
        if old.all() or not old.any():
            return self._filter
        return ParticleFilter(self.particles[old], self._rng, self.weights[old])

    def _anywhere(self, n: int) -> Array:
        """Uniform poses (n, 3) over the bounds and all headings."""
        low, high = self._bounds.T
        position = self._rng.uniform(low, high, (n, 2))
        heading = -self._rng.uniform(-np.pi, np.pi, (n, 1))
        return np.concatenate([position, heading], 1)


def _checked_rates(injection: tuple[float, float] | None) -> tuple[float, float] | None:
    if injection is None:
        return None
    slow, fast = as_array("injection", injection, (2,))
    if not 0 < slow < fast <= 1:
        raise ValueError(f"injection: expected rates 0 < slow < fast <= 1, got {slow:g}, {fast:g}")
    return as_scalar("injection", slow), as_scalar("injection", fast)


def _checked_ids(ids: ArrayLike, count: int, n_landmarks: int) -> NDArray[np.intp]:
    rows = np.asarray(ids)
    if rows.shape != (count,) or not np.issubdtype(rows.dtype, np.integer):
        raise ValueError(
            f"ids: expected {count} whole numbers, got {rows.dtype} of shape {rows.shape}"
        )
    if rows.min() < 0 or rows.max() >= n_landmarks:
        raise ValueError(f"ids: expected rows of {n_landmarks} landmarks, got {rows.tolist()}")
    return rows.astype(np.intp)
