"""Kalman filter: linear motion, linear measurement, Gaussian noise.

P5 (1)-(9), P2 (6)-(11). `predict` and `update` read like the box in the paper; chapter 02 derives
them. Leading axes are batches everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_covariance
from slamlab.filters._linear import apply, innovation_root, solve_psd
from slamlab.filters._sequences import FilterResult, SmootherResult, filter, fixed_lag, smooth
from slamlab.gaussian import Gaussian, as_belief

__all__ = [
    "FilterResult",
    "Innovation",
    "SmootherResult",
    "SteadyState",
    "filter",
    "fixed_lag",
    "predict",
    "smooth",
    "steady_state",
    "update",
]


@dataclass(frozen=True, eq=False)
class Innovation:
    """What an update learned from one measurement.

    Attributes
    ----------
    residual : ndarray, shape (..., m)
        Measured minus predicted, P5 (5).
    cov : ndarray, shape (..., m, m)
        Its covariance S, P5 (6).
    gain : ndarray, shape (..., n, m)
        Kalman gain K, P5 (7).
    nis : ndarray, shape (...)
        Normalised innovation squared, chi-square of m degrees if the filter is consistent.
    log_likelihood : ndarray, shape (...)
        Log density of the measurement, as predicted.

    Examples
    --------
    >>> belief, innovation = update(Gaussian([0.0], [[3.0]]), [2.0], H=[[1.0]], R=[[1.0]])
    >>> innovation.residual.tolist(), innovation.cov.tolist(), float(innovation.nis)
    ([2.0], [[4.0]], 1.0)
    """

    residual: Array
    cov: Array
    gain: Array
    nis: Array
    log_likelihood: Array


def predict(
    belief: Gaussian,
    F: ArrayLike,
    Q: ArrayLike,
    B: ArrayLike | None = None,
    u: ArrayLike | None = None,
) -> Gaussian:
    """Move a belief through the linear motion x' = F x + B u + w, w ~ N(0, Q), P5 (1).

    Parameters
    ----------
    belief : Gaussian
        State of dimension n.
    F : array_like, shape (..., n, n)
        Evolution matrix.
    Q : array_like, shape (..., n, n)
        Covariance of the motion noise.
    B : array_like, shape (..., n, l), optional
        Control matrix; given together with `u`.
    u : array_like, shape (..., l), optional
        Control.

    Returns
    -------
    Gaussian

    Raises
    ------
    ValueError
        If a shape does not fit, a number is not finite, or `Q` is no covariance.

    Examples
    --------
    >>> belief = predict(Gaussian([2.0], [[1.0]]), F=[[1.0]], Q=[[0.5]])
    >>> belief.mean.tolist(), belief.cov.tolist()
    ([2.0], [[1.5]])
    """
    n = as_belief("belief", belief).dim
    F = as_array("F", F, ("...", n, n))
    Q = as_covariance("Q", Q, n)
    # (3): mean
    mean = apply(F, belief.mean) + _control(B, u, n)
    # (4): covariance
    cov = F @ belief.cov @ F.mT + Q
    return _belief(mean, cov)


def update(
    belief: Gaussian, z: ArrayLike, H: ArrayLike, R: ArrayLike
) -> tuple[Gaussian, Innovation]:
    """Correct a belief by the linear measurement z = H x + v, v ~ N(0, R), P5 (2).

    The covariance is corrected in Joseph's form, which stays positive semi-definite under
    rounding and holds for any gain; P5 (9) is its shorter form for the optimal gain.

    Parameters
    ----------
    belief : Gaussian
        State of dimension n.
    z : array_like, shape (..., m)
        Measurement.
    H : array_like, shape (..., m, n)
        Measurement matrix.
    R : array_like, shape (..., m, m)
        Covariance of the measurement noise.

    Returns
    -------
    Gaussian
        The corrected belief.
    Innovation

    Raises
    ------
    ValueError
        If a shape does not fit, a number is not finite, `R` is no covariance, or the innovation
        covariance S is singular.

    Examples
    --------
    >>> belief, innovation = update(Gaussian([2.0], [[1.5]]), [3.5], H=[[1.0]], R=[[1.5]])
    >>> belief.mean.round(6).tolist(), belief.cov.round(6).tolist()
    ([2.75], [[0.75]])
    >>> innovation.gain.round(6).tolist()
    [[0.5]]
    """
    z = as_array("z", z, ("...", "m"))
    H = as_array("H", H, ("...", z.shape[-1], as_belief("belief", belief).dim))
    # (5): innovation
    return correct(belief, z - apply(H, belief.mean), H, R)


def correct(
    belief: Gaussian, residual: Array, H: Array, R: ArrayLike
) -> tuple[Gaussian, Innovation]:
    """Correct a belief by a given innovation, P5 (6)-(9); shared by all filters with a gain.

    Parameters
    ----------
    belief : Gaussian
    residual : ndarray, shape (..., m)
    H : ndarray, shape (..., m, n)
    R : array_like, shape (..., m, m)

    Returns
    -------
    Gaussian
    Innovation
    """
    R = as_covariance("R", R, residual.shape[-1])
    P = belief.cov
    # (6): covariance of the innovation
    S = H @ P @ H.mT + R
    # (7): gain
    K = solve_psd(S, H @ P).mT
    # (8): mean
    mean = belief.mean + apply(K, residual)
    # (9): covariance, Joseph's form
    A = np.eye(belief.dim, dtype=P.dtype) - K @ H
    cov = A @ P @ A.mT + K @ R @ K.mT
    return _belief(mean, cov), innovation(residual, S, K)


def innovation(residual: Array, S: Array, K: Array) -> Innovation:
    """Return the record of one update, with NIS and log likelihood."""
    root = innovation_root(S)
    white = np.linalg.solve(root, residual[..., None])[..., 0]
    nis = (white * white).sum(-1)
    log_det = 2 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(-1)
    log_likelihood = -0.5 * (nis + log_det + residual.shape[-1] * np.log(2 * np.pi))
    return Innovation(residual, S, K, nis, log_likelihood)


@dataclass(frozen=True, eq=False)
class SteadyState:
    """Where the covariances of a filter with a constant model settle.

    Attributes
    ----------
    predicted_cov : ndarray, shape (n, n)
        Before the update.
    cov : ndarray, shape (n, n)
        After it.
    gain : ndarray, shape (n, m)
        The constant gain.
    """

    predicted_cov: Array
    cov: Array
    gain: Array


def steady_state(F: ArrayLike, H: ArrayLike, Q: ArrayLike, R: ArrayLike) -> SteadyState:
    """Solve the discrete algebraic Riccati equation of a constant model.

    Parameters
    ----------
    F : array_like, shape (n, n)
    H : array_like, shape (m, n)
    Q : array_like, shape (n, n)
    R : array_like, shape (m, m)

    Returns
    -------
    SteadyState

    Raises
    ------
    ValueError
        If a shape does not fit, a number is not finite, or the covariances do not settle (an
        unstable state that is never seen).

    Examples
    --------
    >>> steady = steady_state(F=[[1.0]], H=[[1.0]], Q=[[1.0]], R=[[2.0]])
    >>> steady.gain.round(6).tolist()
    [[0.5]]
    """
    F = as_array("F", F, ("n", "n"))
    n = F.shape[0]
    H = as_array("H", H, ("m", n))
    Q, R = as_covariance("Q", Q, n), as_covariance("R", R, H.shape[0])
    try:
        predicted = scipy.linalg.solve_discrete_are(F.T, H.T, Q, R)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ValueError(f"F, H: the covariances do not settle ({error})") from error
    prior = _belief(np.zeros(n), predicted)
    posterior, learned = correct(prior, np.zeros(H.shape[0]), H, R)
    return SteadyState(prior.cov, posterior.cov, learned.gain)


def _belief(mean: Array, cov: Array) -> Gaussian:
    """Build a belief from a covariance that is one by construction: symmetrised, not checked."""
    made = object.__new__(Gaussian)
    object.__setattr__(made, "mean", mean)
    object.__setattr__(made, "cov", 0.5 * (cov + cov.mT))
    return made


def _control(B: ArrayLike | None, u: ArrayLike | None, n: int) -> Array | float:
    if (B is None) != (u is None):
        raise ValueError(f"{'B' if B is None else 'u'}: expected B and u together, got one alone")
    if B is None or u is None:
        return 0.0
    u = as_array("u", u, ("...", "l"))
    return apply(as_array("B", B, ("...", n, u.shape[-1])), u)
