"""Particle filter: propose, weight in log space, resample when the particles degenerate.

P2 (13)-(17), P5 (14)-(15); adaptive size after Fox (2001). Chapter 04; the weights of everything
that has particles: localization (04), FastSLAM (12), grid FastSLAM (15).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from slamlab._checks import (
    Array,
    as_array,
    as_choice,
    as_count,
    as_function,
    as_rng,
    as_scalar,
    as_shaped,
    as_tuple,
)
from slamlab.geometry import wrap_angle

__all__ = [
    "KLD",
    "ParticleFilter",
    "PoseParticles",
    "effective_sample_size",
    "lineage",
    "multinomial_resample",
    "rollback",
    "residual_resample",
    "stratified_resample",
    "systematic_resample",
]

Indices = NDArray[np.intp]
Propose = Callable[[Array, np.random.Generator], "Array | tuple[Array, Array]"]


class ParticleFilter:
    """A cloud of weighted particles that stands for a belief.

    The model stays outside: `predict` takes a function that moves particles, `update` one that
    weighs them. Weights are kept as logarithms, so likelihoods of 1e-4000 do no harm.

    Parameters
    ----------
    particles : array_like, shape (M, d)
        Initial particles, one a row (also any (M, ...)); copied.
    rng : numpy.random.Generator
        Source of all randomness.
    weights : array_like, shape (M,), optional
        Initial weights, not negative, of positive sum; equal by default.
    threshold : float, default 0.5
        `update` resamples when the effective sample size falls below this share of the number of
        particles: 0 never, 1 at every update (unless all weights are equal).
    resample : {"systematic", "stratified", "residual", "multinomial"}, default "systematic"
    adaptive : KLD, optional
        Chooses the number of particles anew; then every update resamples, as in Fox's algorithm.

    Attributes
    ----------
    particles : ndarray, shape (M, d)
    rng : numpy.random.Generator
        As given.
    log_weights : ndarray, shape (M,)
        Normalised: their exponentials sum to 1.
    ess : float
        Effective sample size after the last weighting, before any resampling.
    ancestors : ndarray of int, shape (M,)
        Row of each particle's parent in the set before the last `predict` or `update`: 0, 1, 2,
        ... if that did not resample.
    resampled : bool
        Whether the last `predict` or `update` resampled.
    degenerate : bool
        Whether the last `update` gave every particle the likelihood 0. Its measurement was then
        ignored (weights kept, no resampling): the model excludes it, and a filter that divided
        by that 0 would hold NaN poses from then on.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> belief = ParticleFilter(rng.normal(0.0, 2.0, (4000, 1)), rng)
    >>> belief.predict(lambda x, rng: x + 1.0 + rng.normal(0.0, 0.5, x.shape))
    >>> evidence = belief.update(lambda x: -0.5 * ((3.0 - x[:, 0]) / 0.5) ** 2)
    >>> belief.mean().round(1).tolist(), belief.resampled
    ([2.9], True)
    """

    def __init__(
        self,
        particles: ArrayLike,
        rng: np.random.Generator,
        weights: ArrayLike | None = None,
        threshold: float = 0.5,
        resample: str = "systematic",
        adaptive: KLD | None = None,
    ) -> None:
        self.particles = as_array("particles", particles).copy()
        if self.particles.ndim < 2 or len(self.particles) == 0:
            raise ValueError(
                f"particles: expected shape (M, d) with M > 0, got {self.particles.shape}"
            )
        M = len(self.particles)
        self.rng = as_rng("rng", rng)
        self._threshold = as_scalar("threshold", threshold, 0.0, 1.0)
        self._resample = RESAMPLERS[as_choice("resample", resample, tuple(RESAMPLERS))]
        if adaptive is not None and not isinstance(adaptive, KLD):
            raise ValueError(f"adaptive: expected a KLD or None, got {adaptive!r}")
        self._adaptive = adaptive
        w = np.full(M, 1 / M) if weights is None else _normalised(weights, M)
        with np.errstate(divide="ignore"):
            self.log_weights: Array = np.log(w)
        self.ess = effective_sample_size(w)
        self.ancestors: Indices = np.arange(M)
        self.resampled = False
        self.degenerate = False

    @property
    def weights(self) -> Array:
        """Weights, shape (M,); they sum to 1."""
        return np.exp(self.log_weights)

    def predict(self, propose: Propose) -> None:
        """Move every particle, P2 (13): draw x_k from the proposal.

        Parameters
        ----------
        propose : callable
            ``propose(particles, rng) -> particles``, of the same shape, draws from the motion
            model; the weights stay. A proposal other than the motion model also returns, as a
            pair, the logarithm of P(x_k | x_{k-1}, u_k) / pi(x_k | ...), shape (M,): the
            correction in P2 (14).

        Raises
        ------
        ValueError
            If all corrections are minus infinity. The filter and its generator are then as they
            were.
        """
        with rollback(self.rng):
            drawn = as_function("propose", propose)(self.particles, self.rng)
            moved, correction = drawn if isinstance(drawn, tuple) else (drawn, None)
            moved = as_array("propose(particles)", moved)
            if moved.shape != self.particles.shape:
                raise ValueError(
                    f"propose: expected particles of shape {self.particles.shape}, "
                    f"got {moved.shape}"
                )
            if correction is not None:
                log_ratio = _log_values("propose: log correction", correction, len(moved))
                log_weights, total = _log_normalised(self.log_weights + log_ratio)
                if total == -np.inf:
                    raise ValueError("propose: the corrected weights are all zero")
                self.log_weights = log_weights
        self.particles = moved
        self.ancestors, self.resampled = np.arange(len(moved)), False

    def update(self, log_likelihood: ArrayLike | Callable[[Array], ArrayLike]) -> float:
        """Weigh every particle by a measurement, P2 (14), and resample if the set degenerates.

        Parameters
        ----------
        log_likelihood : callable or array_like, shape (M,)
            ``log_likelihood(particles)`` or its value: log P(z_k | x_k), finite or minus infinity.

        Returns
        -------
        float
            The evidence log P(z_k | Z_{k-1}): logarithm of the weighted mean likelihood. Minus
            infinity if no particle explains the measurement (see `degenerate`).
        """
        given = log_likelihood(self.particles) if callable(log_likelihood) else log_likelihood
        values = _log_values("log_likelihood", given, len(self.particles))
        # (14): the new weight is the OLD weight times the likelihood; products are sums of logs.
        log_weights, evidence = _log_normalised(self.log_weights + values)
        self.ancestors = np.arange(len(self.particles))
        self.resampled = False
        self.degenerate = evidence == -np.inf
        if self.degenerate:
            return evidence
        self.log_weights = log_weights
        weights = np.exp(log_weights)
        self.ess = 1 / float(weights @ weights)
        # Equal weights do not count as degenerate because of a rounded last bit.
        floor = self._threshold * len(weights) * (1 - 1e-9)
        if self._adaptive is not None or self.ess < floor:
            self._draw(weights)
        return evidence

    def resample(self) -> None:
        """Draw a new set of equal weights now, whatever the effective sample size."""
        self._draw(self.weights)

    def _draw(self, weights: Array) -> None:
        """Replace the set by a draw from itself; survivors keep no weight but their number."""
        n = len(weights)
        if self._adaptive is not None:
            n = self._adaptive.size(self.particles, weights, self.rng)
        chosen = self._resample(weights, self.rng, n)
        # Two resamplings since the last update: parents of parents.
        self.ancestors = self.ancestors[chosen]
        self.particles = self.particles.take(chosen, axis=0)
        self.log_weights = np.full(n, -np.log(n))
        self.resampled = True

    def mean(self, angles: Sequence[int] = ()) -> Array:
        """Weighted mean, shape (d,).

        Parameters
        ----------
        angles : sequence of int, default ()
            Columns that are angles (rad): their mean is the direction of the mean unit vector.
            ``(2,)`` for poses.
        """
        columns = _angles(angles, self.particles)
        weights = self.weights
        mean = np.tensordot(weights, self.particles, axes=1)
        for i in columns:
            angle = self.particles[:, i]
            mean[i] = np.arctan2(weights @ np.sin(angle), weights @ np.cos(angle))
        return mean

    def cov(self, angles: Sequence[int] = ()) -> Array:
        """Weighted covariance (d, d) about `mean`; deviations of angles are wrapped."""
        columns = _angles(angles, self.particles)
        if self.particles.ndim != 2:
            raise ValueError(f"cov: expected particles (M, d), they are {self.particles.shape}")
        deviation = self.particles - self.mean(angles)
        for i in columns:
            deviation[:, i] = wrap_angle(deviation[:, i])
        return (deviation * self.weights[:, None]).T @ deviation


class PoseParticles:
    """What a cloud of poses says: the base of everything that estimates a pose by particles.

    All arrays are copies: a list of them keeps what was.

    Attributes
    ----------
    measures : str
        What `update` takes: "landmarks" or "scan".
    """

    measures = "landmarks"
    _cloud: ParticleFilter

    @property
    def poses(self) -> Array:
        """Poses of the particles, shape (M, 3) (m, m, rad)."""
        return self._cloud.particles.copy()

    @property
    def n_particles(self) -> int:
        """Number of particles M."""
        return len(self._cloud.particles)

    @property
    def log_weights(self) -> Array:
        """Logarithms of `weights`, shape (M,)."""
        return self._cloud.log_weights.copy()

    @property
    def weights(self) -> Array:
        """Weights of the particles, shape (M,); they sum to 1."""
        return self._cloud.weights

    @property
    def pose(self) -> Array:
        """Weighted mean of the poses, shape (3,); the heading as direction of the mean vector."""
        return self._cloud.mean(angles=(2,))

    @property
    def pose_cov(self) -> Array:
        """Weighted covariance of the poses about `pose`, shape (3, 3)."""
        return self._cloud.cov(angles=(2,))

    @property
    def ess(self) -> float:
        """Effective sample size after the last weighting, before any resampling."""
        return self._cloud.ess

    @property
    def ancestors(self) -> Indices:
        """Row of each particle's parent before the last `predict` or `update`; -1: it has none."""
        return self._cloud.ancestors.copy()

    @property
    def resampled(self) -> bool:
        """Whether the last `update` resampled."""
        return self._cloud.resampled

    def __repr__(self) -> str:
        """Say in one line what it is and where the robot is believed to be."""
        x, y, theta = self.pose
        return (
            f"{type(self).__name__}({self.n_particles} particles, {self._contents()}"
            f"pose ({x:.2f} m, {y:.2f} m, {np.rad2deg(theta):.1f} deg))"
        )

    def _contents(self) -> str:
        return ""


def lineage(ancestors: Sequence[ArrayLike]) -> Indices:
    """Follow every particle of the last step back through its parents.

    Parameters
    ----------
    ancestors : array_like of int, shape (T, M)
        Attribute `ancestors` of a filter after each step.

    Returns
    -------
    ndarray of int, shape (T, M)
        Row of the forefather at each step of each particle of the last: poses (T, M, 3) of all
        steps become paths by ``poses[np.arange(T)[:, None], rows]``, and ``np.unique(rows[k])``
        are the particles of step k that have descendants. -1 before a particle without parent.

    Examples
    --------
    >>> lineage([[0, 1, 2], [0, 0, 2], [0, 1, 1]]).tolist()
    [[0, 0, 0], [0, 1, 1], [0, 1, 2]]
    """
    parents = np.asarray(ancestors)
    if parents.ndim != 2 or not np.issubdtype(parents.dtype, np.integer):
        raise ValueError(f"ancestors: expected whole numbers (T, M), got shape {parents.shape}")
    T, M = parents.shape
    if T and not (-1 <= parents.min() and parents.max() < M):
        raise ValueError(f"ancestors: expected rows of {M} particles or -1, got {parents.max()}")
    rows = np.tile(np.arange(M), (T, 1))
    for k in range(T - 2, -1, -1):
        later = rows[k + 1]
        rows[k] = np.where(later >= 0, parents[k + 1, later], -1)
    return rows


@contextmanager
def rollback(rng: np.random.Generator) -> Iterator[None]:
    """Give a generator its state back if the block fails: a refused call has drawn nothing."""
    state = rng.bit_generator.state
    try:
        yield
    except BaseException:
        rng.bit_generator.state = state
        raise


@dataclass(frozen=True)
class KLD:
    """Adaptive number of particles: as many as the occupied volume asks for (Fox 2001).

    With probability 1 - `delta` the Kullback-Leibler distance between the drawn set and the
    belief, both as histograms over bins of size `bins`, stays below `epsilon`.

    Parameters
    ----------
    bins : array_like, shape (d,)
        Bin size in each coordinate, positive, for example (0.5 m, 0.5 m, 0.2 rad).
    epsilon : float, default 0.05
        Allowed distance, positive.
    delta : float, default 0.01
        Allowed probability to miss it, in (0, 1).
    minimum, maximum : int, default 100 and 100 000
        Limits of the number.

    Examples
    --------
    >>> KLD(bins=[0.5, 0.5, 0.2]).required([1, 10, 100]).round().tolist()
    [1.0, 217.0, 1347.0]
    """

    bins: Array
    epsilon: float = 0.05
    delta: float = 0.01
    minimum: int = 100
    maximum: int = 100_000

    def __post_init__(self) -> None:
        """Check the parameters."""
        bins = as_array("bins", self.bins, ("d",)).copy()
        if not (bins > 0).all():
            raise ValueError(f"bins: expected positive sizes, got {bins.min():g}")
        object.__setattr__(self, "bins", bins)
        as_scalar("epsilon", self.epsilon, 1e-12, 1e12)
        as_scalar("delta", self.delta, 1e-12, 1 - 1e-12)
        as_count("minimum", self.minimum, 1)
        as_count("maximum", self.maximum, self.minimum)

    def required(self, occupied: ArrayLike) -> Array:
        """Particles needed for a number of occupied bins (Fox 2001, the Wilson-Hilferty form).

        Parameters
        ----------
        occupied : array_like of int, any shape
            Number of bins k that hold at least one particle, k >= 1.

        Returns
        -------
        ndarray, same shape
            (k-1)/(2 epsilon) (1 - 2/(9(k-1)) + sqrt(2/(9(k-1))) z)^3, z the normal quantile of
            1 - delta; 1 for k = 1. Not rounded, and not limited by `minimum` and `maximum`.
        """
        freedom = np.maximum(as_array("occupied", occupied) - 1, 0)
        spread = 2 / (9 * np.maximum(freedom, 1))
        quantile = (1 - spread + np.sqrt(spread) * ndtri(1 - self.delta)) ** 3
        return np.where(freedom > 0, freedom / (2 * self.epsilon) * quantile, 1.0)

    def size(self, particles: Array, weights: Array, rng: np.random.Generator) -> int:
        """Draw from the weighted set one by one until the draws suffice; return their number.

        Parameters
        ----------
        particles : ndarray, shape (M, d)
        weights : ndarray, shape (M,)
        rng : numpy.random.Generator

        Returns
        -------
        int
            Between `minimum` and `maximum`.
        """
        particles = as_array("particles", particles, ("M", len(self.bins)))
        _, cell = np.unique(np.floor(particles / self.bins), axis=0, return_inverse=True)
        draws = cell.reshape(-1)[multinomial_resample(weights, rng, self.maximum)]
        # Draw i opens a new bin if it is the first in its bin; k counts the bins open so far.
        first = np.zeros(self.maximum, dtype=int)
        first[np.unique(draws, return_index=True)[1]] = 1
        enough = np.arange(1, self.maximum + 1) >= self.required(np.cumsum(first))
        enough[: self.minimum - 1] = False
        return int(np.argmax(enough)) + 1 if enough.any() else self.maximum


def effective_sample_size(weights: ArrayLike) -> float:
    """Effective sample size 1 / sum w^2 of the normalised weights, in [1, M].

    Parameters
    ----------
    weights : array_like, shape (M,)
        Not negative, not all 0; need not sum to 1.

    Returns
    -------
    float
        M if all are equal, 1 if one has everything.

    Examples
    --------
    >>> effective_sample_size([1, 1, 1, 1]), effective_sample_size([1, 0, 0, 0])
    (4.0, 1.0)
    """
    weights = _normalised(weights)
    return 1 / float(weights @ weights)


def systematic_resample(
    weights: ArrayLike, rng: np.random.Generator, n: int | None = None
) -> Indices:
    """Draw indices with one random offset: particle i comes floor(n w_i) or ceil(n w_i) times.

    The positions are (j + u) / n for j = 0..n-1 with a single u from [0, 1).

    Parameters
    ----------
    weights : array_like, shape (M,)
        Not negative, not all 0; need not sum to 1.
    rng : numpy.random.Generator
        One uniform number is drawn.
    n : int, optional
        How many indices, at least 1; M by default.

    Returns
    -------
    ndarray of int, shape (n,)
        Ascending.

    Examples
    --------
    >>> systematic_resample([0.5, 0.25, 0.25], np.random.default_rng(1), 4).tolist()
    [0, 0, 1, 2]
    """
    cumulative, n = _cumulative(weights, n)
    u = as_rng("rng", rng).random()
    last = int(np.searchsorted(cumulative, 1.0))
    # Positions below the cumulative weight c: all j < n c - u, that is ceil(n c - u) of them.
    cumulative *= n
    cumulative -= u
    below = np.ceil(cumulative, out=cumulative).astype(np.intp)
    below[last:] = n
    return np.repeat(np.arange(len(below)), np.diff(below, prepend=0))


def stratified_resample(
    weights: ArrayLike, rng: np.random.Generator, n: int | None = None
) -> Indices:
    """Draw indices with one random position in each of n equal strata.

    Parameters, errors and result are those of `systematic_resample`; n uniform numbers are drawn.

    Examples
    --------
    >>> stratified_resample([0.5, 0.25, 0.25], np.random.default_rng(1), 4).tolist()
    [0, 0, 1, 2]
    """
    cumulative, n = _cumulative(weights, n)
    positions = (np.arange(n) + as_rng("rng", rng).random(n)) / n
    return _at(cumulative, positions)


def multinomial_resample(
    weights: ArrayLike, rng: np.random.Generator, n: int | None = None
) -> Indices:
    """Draw n independent indices; the noisiest way, kept for comparison.

    Parameters and errors are those of `systematic_resample`; n uniform numbers are drawn, and the
    indices come in the order of the draws.

    Examples
    --------
    >>> drawn = multinomial_resample([3, 1], np.random.default_rng(1), 4000)
    >>> np.bincount(drawn).round(-2).tolist()
    [3000, 1000]
    """
    cumulative, n = _cumulative(weights, n)
    return _at(cumulative, as_rng("rng", rng).random(n))


def residual_resample(
    weights: ArrayLike, rng: np.random.Generator, n: int | None = None
) -> Indices:
    """Copy particle i floor(n w_i) times and draw the rest from what remains of the weights.

    Parameters and errors are those of `systematic_resample`. The rest is multinomial over
    n w_i - floor(n w_i) (Liu and Chen 1998).

    Examples
    --------
    >>> residual_resample([0.5, 0.25, 0.25], np.random.default_rng(1), 4).tolist()
    [0, 0, 1, 2]
    """
    weights, rng = _normalised(weights), as_rng("rng", rng)
    n = len(weights) if n is None else as_count("n", n, 1)
    expected = n * weights
    copies = np.floor(expected).astype(np.intp)
    chosen = np.repeat(np.arange(len(weights)), copies)
    rest = n - len(chosen)
    remains = expected - copies
    if rest == 0 or not remains.sum() > 0:
        return chosen[:n]
    return np.concatenate([chosen, multinomial_resample(remains, rng, rest)])


RESAMPLERS: dict[str, Callable[..., Indices]] = {
    "systematic": systematic_resample,
    "stratified": stratified_resample,
    "residual": residual_resample,
    "multinomial": multinomial_resample,
}


def _normalised(weights: ArrayLike, size: int | None = None) -> Array:
    """Weights that sum to 1, or a ValueError that says what is wrong with them."""
    weights = as_array("weights", weights, ("M" if size is None else size,))
    weights = weights.astype(np.float64, copy=False)
    least = weights.min(initial=0)
    if len(weights) == 0 or least < 0:
        raise ValueError(f"weights: expected numbers that are not negative, got {least:g}")
    largest = weights.max()
    if largest == 0:
        raise ValueError("weights: expected a positive sum, all weights are 0")
    # Scaled by the largest first: a sum of huge or tiny weights must not overflow or vanish.
    scaled = weights / largest
    return scaled / scaled.sum()


def _cumulative(weights: ArrayLike, n: int | None) -> tuple[Array, int]:
    """Cumulative weights that end in exactly 1, and the number of draws."""
    cumulative = np.cumsum(_normalised(weights))
    cumulative /= cumulative[-1]
    return cumulative, len(cumulative) if n is None else as_count("n", n, 1)


def _at(cumulative: Array, positions: Array) -> Indices:
    """First index whose cumulative weight exceeds the position: one of zero weight never is."""
    # A position may round up to 1; the last particle of positive weight takes it.
    last = int(np.searchsorted(cumulative, 1.0))
    return np.minimum(np.searchsorted(cumulative, positions, side="right"), last)


def _log_values(name: str, values: ArrayLike, size: int) -> Array:
    """Logarithms (size,) that may be minus infinity but neither NaN nor plus infinity."""
    array = as_shaped(name, values, (size,))
    if not (array < np.inf).all():
        where = int(np.flatnonzero(~(array < np.inf))[0])
        raise ValueError(f"{name}: expected numbers or -inf, got {array[where]} at index {where}")
    return array


def _log_normalised(log_weights: Array) -> tuple[Array, float]:
    """Log weights whose exponentials sum to 1, and the logarithm of their former sum."""
    largest = float(log_weights.max())
    if largest == -np.inf:
        return log_weights, -np.inf
    total = largest + float(np.log(np.exp(log_weights - largest).sum()))
    return log_weights - total, total


def _angles(angles: Sequence[int], particles: Array) -> list[int]:
    """Check column numbers of angles."""
    columns = [as_count("angles", i) for i in as_tuple("angles", angles)]
    if columns and (particles.ndim != 2 or max(columns) >= particles.shape[1]):
        raise ValueError(f"angles: expected columns of particles {particles.shape}, got {columns}")
    return columns
