"""Gaussian beliefs: mean and covariance, distance, ellipse.

The common currency of all filters (P5 section 1.4, P1 (5)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaincinv

from slamlab._checks import (
    Array,
    as_array,
    as_batch,
    as_count,
    as_covariance,
    as_rng,
    as_scalar,
    shown,
)

__all__ = [
    "Ellipse",
    "Gaussian",
    "as_belief",
    "block_diagonal",
    "chi2_quantile",
    "confidence_ellipse",
    "mahalanobis_squared",
    "matrix_sqrt",
]


@dataclass(frozen=True, eq=False)
class Gaussian:
    """A normal belief; leading axes are a batch of beliefs.

    Parameters
    ----------
    mean : array_like, shape (..., n)
    cov : array_like, shape (..., n, n)
        Covariance; symmetric and positive semi-definite.

    Examples
    --------
    >>> belief = Gaussian([1.0, 2.0], [[0.04, 0.0], [0.0, 0.01]])
    >>> np.sqrt(np.diag(belief.cov)).tolist()
    [0.2, 0.1]
    """

    mean: Array
    cov: Array

    def __post_init__(self) -> None:
        """Check and store copies of both."""
        mean = as_array("mean", self.mean, ("...", "n"))
        cov = as_covariance("cov", self.cov, mean.shape[-1])
        as_batch("cov", cov.shape[:-2], mean.shape[:-1])
        object.__setattr__(self, "mean", mean.copy())
        object.__setattr__(self, "cov", cov)

    @property
    def dim(self) -> int:
        """Dimension n of the state."""
        return int(self.mean.shape[-1])

    @property
    def sigma(self) -> Array:
        """Standard deviations, shape (..., n)."""
        return np.sqrt(np.diagonal(self.cov, axis1=-2, axis2=-1))

    def sample(self, rng: np.random.Generator, size: int | Sequence[int] = ()) -> Array:
        """Draw samples, shape ``(*size, ..., n)``; a singular covariance is allowed."""
        size = tuple(size) if isinstance(size, Sequence) else (size,)
        size = tuple(as_count("size", n) for n in size)
        rng = as_rng("rng", rng)
        noise = rng.standard_normal((*size, *self.mean.shape))
        return self.mean + (matrix_sqrt(self.cov) @ noise[..., None])[..., 0]


def as_belief(name: str, value: object) -> Gaussian:
    """Return `value` if it is a Gaussian.

    Raises
    ------
    ValueError
        If it is anything else, a pair of mean and covariance included.

    Examples
    --------
    >>> as_belief("belief", Gaussian([0.0], [[1.0]])).mean.tolist()
    [0.0]
    """
    if not isinstance(value, Gaussian):
        raise ValueError(f"{name}: expected a Gaussian(mean, cov), got {shown(value)}")
    return value


def matrix_sqrt(cov: ArrayLike) -> Array:
    """Return a square root A of covariances: A A^T = cov, so that A times white noise has it.

    Parameters
    ----------
    cov : array_like, shape (..., n, n)
        Symmetric positive semi-definite; may be singular, as no Cholesky factor allows.

    Returns
    -------
    ndarray, shape (..., n, n)
        Eigenvectors in the columns, each times the root of its eigenvalue: not the symmetric
        root of `scipy.linalg.sqrtm`.

    Examples
    --------
    >>> matrix_sqrt([[4.0, 0.0], [0.0, 9.0]]).tolist()
    [[2.0, 0.0], [0.0, 3.0]]
    """
    values, vectors = np.linalg.eigh(as_array("cov", cov, ("...", "n", "n")))
    return vectors * np.sqrt(np.clip(values, 0.0, None))[..., None, :]


def cached_sqrt(name: str, value: ArrayLike, dim: int) -> Array:
    """Return `matrix_sqrt` of a noise covariance (..., dim, dim), read-only.

    A log tells the same covariance step after step: the last ones are remembered. ValueError if
    it is no covariance.
    """
    cov = as_array(name, value, ("...", dim, dim))
    return _sqrt_of_bytes(name, cov.tobytes(), cov.shape, cov.dtype.char)


@lru_cache(maxsize=64)
def _sqrt_of_bytes(name: str, entries: bytes, shape: tuple[int, ...], kind: str) -> Array:
    found = matrix_sqrt(as_covariance(name, np.frombuffer(entries, kind).reshape(shape)))
    found.setflags(write=False)
    return found


def chi2_quantile(probability: ArrayLike, dof: ArrayLike) -> Array:
    """Bound that a sum of `dof` squared standard normal numbers keeps with this probability.

    Parameters
    ----------
    probability : array_like, shape (...)
        In [0, 1).
    dof : array_like, shape (...)
        Degrees of freedom, not negative; the bound of none is 0.

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> float(chi2_quantile(0.99, 2).round(3))
    9.21
    """
    probability = as_array("probability", probability)
    dof = as_array("dof", dof)
    if ((probability < 0) | (probability >= 1)).any():
        raise ValueError(f"probability: expected numbers in [0, 1), got {probability}")
    if (dof < 0).any():
        raise ValueError(f"dof: expected numbers of at least 0, got {dof}")
    as_batch("dof", dof.shape, probability.shape)
    some = dof > 0
    return np.asarray(2 * gammaincinv(np.where(some, dof, 1) / 2, probability) * some)[()]


def mahalanobis_squared(residual: ArrayLike, cov: ArrayLike) -> Array:
    """Squared Mahalanobis distance r^T C^-1 r, the number that a gate compares.

    Parameters
    ----------
    residual : array_like, shape (..., n)
    cov : array_like, shape (..., n, n)
        Positive definite; leading axes broadcast with those of `residual`.

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> float(mahalanobis_squared([2.0, 0.0], [[4.0, 0.0], [0.0, 1.0]]))
    1.0
    """
    residual = as_array("residual", residual, ("...", "n"))
    n = residual.shape[-1]
    cov = as_array("cov", cov, ("...", n, n))
    as_batch("cov", cov.shape[:-2], residual.shape[:-1])
    try:
        L = np.linalg.cholesky(cov)
    except np.linalg.LinAlgError as error:
        raise ValueError("cov: expected a positive definite matrix, Cholesky failed") from error
    white = np.linalg.solve(L, residual[..., None])[..., 0]
    return (white * white).sum(-1)


@dataclass(frozen=True)
class Ellipse:
    """Confidence ellipse of a planar Gaussian.

    Attributes
    ----------
    center : ndarray, shape (..., 2)
        Centre (m).
    half_axes : ndarray, shape (..., 2)
        Half lengths (m), the longer first.
    angle : ndarray, shape (...)
        Direction of the longer axis (rad), in (-pi/2, pi/2].
    """

    center: Array
    half_axes: Array
    angle: Array

    def points(self, n: int = 60) -> Array:
        """Return a closed polygon of n + 1 points on the ellipse, shape (..., n + 1, 2)."""
        t = np.linspace(0.0, 2 * np.pi, as_count("n", n, 1) + 1)
        a = self.half_axes[..., 0, None] * np.cos(t)
        b = self.half_axes[..., 1, None] * np.sin(t)
        angle = np.asarray(self.angle)
        c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
        return self.center[..., None, :] + np.stack([c * a - s * b, s * a + c * b], -1)


def confidence_ellipse(mean: ArrayLike, cov: ArrayLike, probability: float = 0.95) -> Ellipse:
    """Ellipse that holds a planar Gaussian with the given probability.

    Parameters
    ----------
    mean : array_like, shape (..., 2)
        Centre (m).
    cov : array_like, shape (..., 2, 2)
        Covariance (m^2); may be singular.
    probability : float, default 0.95
        In [0, 1). The half axes are sqrt(q lambda), q the chi-square quantile of 2 degrees.

    Returns
    -------
    Ellipse

    Examples
    --------
    >>> confidence_ellipse([0, 0], [[4.0, 0.0], [0.0, 1.0]]).half_axes.round(3).tolist()
    [4.895, 2.448]
    """
    mean = as_array("mean", mean, ("...", 2))
    cov = as_covariance("cov", cov, 2)
    as_batch("cov", cov.shape[:-2], mean.shape[:-1])
    probability = as_scalar("probability", probability, 0.0, np.nextafter(1.0, 0.0))
    values, vectors = np.linalg.eigh(cov)
    half_axes = np.sqrt(chi2_quantile(probability, 2) * np.clip(values[..., ::-1], 0.0, None))
    major = vectors[..., :, 1]
    angle = np.arctan2(major[..., 1], major[..., 0])
    angle = np.where(angle <= -np.pi / 2, angle + np.pi, angle)
    angle = np.where(angle > np.pi / 2, angle - np.pi, angle)
    center = np.broadcast_to(mean, half_axes.shape)
    return Ellipse(center, half_axes, angle[()])


def inverse_2x2(S: Array) -> tuple[Array, Array]:
    """Invert symmetric matrices (..., 2, 2); their determinants (...) come along.

    Written out, since many small matrices pass through every step of a particle filter. A
    singular matrix has infinite or undefined entries: the caller looks at the result.

    Examples
    --------
    >>> inverse, determinant = inverse_2x2(np.array([[2.0, 1.0], [1.0, 1.0]]))
    >>> inverse.tolist(), float(determinant)
    ([[1.0, -1.0], [-1.0, 2.0]], 1.0)
    """
    xx, xy, yy = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
    determinant = xx * yy - xy * xy
    adjugate = np.stack([yy, -xy, -xy, xx], -1).reshape(S.shape)
    return adjugate / determinant[..., None, None], determinant


def block_diagonal(blocks: Array) -> Array:
    """Matrix (2m, 2m) with the blocks (m, 2, 2) on its diagonal: independent parts together.

    Examples
    --------
    >>> block_diagonal(np.array([[[4.0, 1.0], [1.0, 2.0]], [[3.0, 0.0], [0.0, 3.0]]])).tolist()
    [[4.0, 1.0, 0.0, 0.0], [1.0, 2.0, 0.0, 0.0], [0.0, 0.0, 3.0, 0.0], [0.0, 0.0, 0.0, 3.0]]
    """
    m, k = len(blocks), np.arange(len(blocks))
    matrix = np.zeros((m, 2, m, 2))
    matrix[k, :, k] = blocks
    return matrix.reshape(2 * m, 2 * m)
