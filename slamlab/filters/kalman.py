"""Kalman filter: linear motion, linear measurement, Gaussian noise.

P5 (1)-(9), P2 (6)-(11). `predict` and `update` read like the box in the paper; chapter 02 derives
them. Leading axes are batches everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_batch, as_count, as_covariance, as_finite_or_nan
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

Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Innovation:
    """What an update learned from one measurement.

    Attributes
    ----------
    innovation : ndarray, shape (..., m)
        Measured minus predicted, P5 (5).
    S : ndarray, shape (..., m, m)
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
    >>> innovation.innovation.tolist(), innovation.S.tolist(), float(innovation.nis)
    ([2.0], [[4.0]], 1.0)
    """

    innovation: Array
    S: Array
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

    The covariance is corrected in Joseph's form, which holds for any gain, a rounded one too;
    P5 (9) is its shorter form for the optimal gain.

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
        If the innovation covariance S is singular.

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
    K = kalman_gain(S, H @ P)
    # (8): mean
    mean = belief.mean + apply(K, residual)
    # (9): covariance, Joseph's form
    A = np.eye(belief.dim, dtype=P.dtype) - K @ H
    cov = A @ P @ A.mT + K @ R @ K.mT
    return _belief(mean, cov), innovation(residual, S, K)


def kalman_gain(S: Array, HP: Array) -> Array:
    """K = P H^T S^-1 (..., n, m), from S and the covariance H P of measurement and state."""
    try:
        return np.asarray(np.linalg.solve(S, HP)).mT
    except np.linalg.LinAlgError as error:
        raise _singular(S) from error


def innovation(residual: Array, S: Array, K: Array) -> Innovation:
    """Return the record of one update, with NIS and log likelihood; a singular S is named."""
    try:
        L = np.linalg.cholesky(S)
    except np.linalg.LinAlgError as error:
        raise _singular(S) from error
    white = np.linalg.solve(L, residual[..., None])[..., 0]
    nis = (white * white).sum(-1)
    log_det = 2 * np.log(np.diagonal(L, axis1=-2, axis2=-1)).sum(-1)
    log_likelihood = -0.5 * (nis + log_det + residual.shape[-1] * np.log(2 * np.pi))
    return Innovation(residual, S, K, nis, log_likelihood)


@dataclass(frozen=True, eq=False)
class FilterResult:
    """What a filter knew along T steps; leading axes are a batch of series.

    Attributes
    ----------
    means, covs : ndarray, shape (..., T, n) and (..., T, n, n)
        After the measurement of the step.
    predicted_means, predicted_covs : ndarray, shape (..., T, n) and (..., T, n, n)
        Before it.
    innovations : ndarray, shape (..., T, m)
        P5 (5); NaN where nothing was measured.
    innovation_covs : ndarray, shape (..., T, m, m)
        P5 (6); a missing component has variance 1 and no covariance.
    gains : ndarray, shape (..., T, n, m)
        P5 (7); zero for a missing component.
    nis : ndarray, shape (..., T)
        Normalised innovation squared, chi-square of as many degrees as components were measured;
        NaN where none was.
    log_likelihood : ndarray, shape (...)
        Log density of all measurements of a series.
    evolution : ndarray, shape (n, n) or (..., T, n, n)
        The F of the run, for the smoother.
    """

    means: Array
    covs: Array
    predicted_means: Array
    predicted_covs: Array
    innovations: Array
    innovation_covs: Array
    gains: Array
    nis: Array
    log_likelihood: Array
    evolution: Array


@dataclass(frozen=True, eq=False)
class SmootherResult:
    """Beliefs that know later measurements too.

    Attributes
    ----------
    means : ndarray, shape (..., T, n)
    covs : ndarray, shape (..., T, n, n)
    """

    means: Array
    covs: Array


def filter(
    z: ArrayLike,
    F: ArrayLike,
    H: ArrayLike,
    Q: ArrayLike,
    R: ArrayLike,
    initial: Gaussian,
    B: ArrayLike | None = None,
    u: ArrayLike | None = None,
) -> FilterResult:
    """Filter whole series: at each step predict, then update, P5 (3)-(9).

    A matrix of two axes holds for all steps; with three or more, the third from the end is time
    (T or 1) and those before it are the batch.

    Parameters
    ----------
    z : array_like, shape (..., T, m)
        Measurements; NaN marks a missing one. A step with some components missing uses the rest.
    F, Q : array_like, shape (n, n) or (..., T, n, n)
        Evolution and covariance of the motion noise; entry k leads from step k - 1 to k.
    H : array_like, shape (m, n) or (..., T, m, n)
    R : array_like, shape (m, m) or (..., T, m, m)
    initial : Gaussian
        Belief before the first step's motion; leading axes broadcast with the batch.
    B : array_like, shape (n, l) or (..., T, n, l), optional
        Control matrix; given together with `u`.
    u : array_like, shape (..., T, l), optional
        Controls; entry k acts on the way from step k - 1 to k.

    Returns
    -------
    FilterResult
        Covariances shared by the batch are read-only views.

    Raises
    ------
    ValueError
        If an innovation covariance is singular.

    Examples
    --------
    >>> belief = Gaussian([0.0], [[1.0]])
    >>> run = filter([[1.0], [np.nan], [1.2]], [[1.0]], [[1.0]], [[0.0]], [[1.0]], belief)
    >>> run.means[:, 0].round(3).tolist(), run.covs[:, 0, 0].round(3).tolist()
    ([0.5, 0.5, 0.733], [0.5, 0.5, 0.333])
    """
    z = as_finite_or_nan("z", z, ("...", "T", "m"))
    (length, m), n = z.shape[-2:], as_belief("initial", initial).dim
    if length == 0:
        raise ValueError(f"z: expected at least one step, got shape {z.shape}")
    F, H = as_array("F", F, ("...", n, n)), as_array("H", H, ("...", m, n))
    Q, R = as_covariance("Q", Q, n), as_covariance("R", R, m)
    push = _control(B, u, n, length)
    batch = _batch_shape(z, initial, push, F=F, H=H, Q=Q, R=R)
    F, H, Q, R = (_in_steps(matrix, length) for matrix in (F, H, Q, R))
    seen = ~np.isnan(z)
    z, H, R = np.where(seen, z, z.dtype.type(0)), *_without_missing(H, R, seen)
    x, P, I, steps = initial.mean, initial.cov, np.eye(n, dtype=initial.cov.dtype), []
    constant, settled = all(matrix.ndim == 2 for matrix in (F, H, Q, R)), False
    for k in range(length):
        F_k, H_k = _at(F, k), _at(H, k)
        ahead = apply(F_k, x) + push[..., k, :]  # (3)
        residual = z[..., k, :] - apply(H_k, ahead)  # (5)
        if not settled:  # of a constant model they reach the steady state and stay there
            R_k, before = _at(R, k), P
            P_ahead = F_k @ P @ F_k.mT + _at(Q, k)  # (4)
            P_ahead = 0.5 * (P_ahead + P_ahead.mT)
            HP = H_k @ P_ahead
            S = HP @ H_k.mT + R_k  # (6)
            K = kalman_gain(S, HP)  # (7)
            P = (P_ahead - K @ HP) @ (I - K @ H_k).mT + K @ R_k @ K.mT  # (9), Joseph's form
            P = 0.5 * (P + P.mT)
            settled = constant and _unchanged(P, before)
        x = ahead + apply(K, residual)  # (8)
        steps.append((x, P, ahead, P_ahead, residual, S, K))
    return _result(steps, seen, batch, F)


def smooth(result: FilterResult) -> SmootherResult:
    """Rauch-Tung-Striebel smoother: every step as seen after the last measurement.

    Parameters
    ----------
    result : FilterResult
        Of `filter`.

    Returns
    -------
    SmootherResult

    Examples
    --------
    >>> belief = Gaussian([0.0], [[1.0]])
    >>> run = filter([[1.0], [np.nan], [1.2]], [[1.0]], [[1.0]], [[0.1]], [[1.0]], belief)
    >>> bool(np.all(smooth(run).covs <= run.covs + 1e-12))
    True
    """
    means, ahead = result.means, result.predicted_means
    P, P_ahead, C = _for_smoothing(result)
    # x_k|T = x_k + C_k (x_k+1|T - x_k+1|k), and the covariances alike: what is known comes first
    known = means[..., :-1, :] - apply(C, ahead[..., 1:, :])
    known_cov = P[..., :-1, :, :] - C @ P_ahead[..., 1:, :, :] @ C.mT
    x, cov = [means[..., -1, :]], [P[..., -1, :, :]]
    for k in range(means.shape[-2] - 2, -1, -1):
        C_k = C[..., k, :, :]
        x.append(known[..., k, :] + apply(C_k, x[-1]))
        cov.append(known_cov[..., k, :, :] + C_k @ cov[-1] @ C_k.mT)
    batch = means.shape[:-2]
    return SmootherResult(_in_time(x[::-1], batch, 1), _in_time(cov[::-1], batch, 2))


def fixed_lag(result: FilterResult, lag: int) -> SmootherResult:
    """Every step as seen `lag` measurements later: what a robot can know in time to use it.

    Parameters
    ----------
    result : FilterResult
        Of `filter`.
    lag : int
        In steps; 0 returns the filter, T - 1 or more the smoother. The last steps see what is
        left.

    Returns
    -------
    SmootherResult

    Examples
    --------
    >>> belief = Gaussian([0.0], [[1.0]])
    >>> run = filter([[1.0], [0.8], [1.2]], [[1.0]], [[1.0]], [[0.1]], [[1.0]], belief)
    >>> np.allclose(fixed_lag(run, 2).means, smooth(run).means)
    True
    """
    lag = as_count("lag", lag)
    means, ahead = result.means, result.predicted_means
    P, P_ahead, C = _for_smoothing(result)
    length = means.shape[-2]
    last = np.minimum(np.arange(length) + lag, length - 1)
    x, cov = means[..., last, :], P[..., last, :, :]
    for back in range(min(lag, length - 1) - 1, -1, -1):
        stop = length - 1 - back
        now, then, gain = slice(back, -1), slice(back + 1, None), C[..., back:, :, :]
        x[..., :stop, :] = means[..., now, :] + apply(gain, x[..., :stop, :] - ahead[..., then, :])
        change = cov[..., :stop, :, :] - P_ahead[..., then, :, :]
        cov[..., :stop, :, :] = P[..., now, :, :] + gain @ change @ gain.mT
    return SmootherResult(x, np.broadcast_to(cov, (*x.shape, x.shape[-1])))


def _without_missing(H: Array, R: Array, seen: Bools) -> tuple[Array, Array]:
    """H and R; a missing component has an empty row of H, variance 1, and so no gain."""
    length, m = seen.shape[-2:]
    same = seen.reshape(-1, length, m)
    shared = same[0] if (same == same[0]).all() else seen
    if shared.all():
        return H, R
    H = np.where(shared[..., None], H, H.dtype.type(0))
    return H, np.where(shared[..., None] & shared[..., None, :], R, np.eye(m, dtype=R.dtype))


def _result(
    steps: Sequence[tuple[Array, ...]], seen: Bools, batch: tuple[int, ...], evolution: Array
) -> FilterResult:
    """Join x, P, their predictions, innovation, S and K of all steps; NaN for what is missing."""
    columns = zip(*steps, strict=True)
    axes = (1, 2, 1, 2, 1, 2, 2)
    means, covs, ahead, P_ahead, residuals, S, K = (
        _in_time(column, batch, n_axes) for column, n_axes in zip(columns, axes, strict=True)
    )
    learned = innovation(residuals, _shared(S, batch), K)
    # A missing component counts as innovation 0 of variance 1: its density is taken away.
    log_likelihood = learned.log_likelihood + 0.5 * (~seen).sum(-1) * np.log(2 * np.pi)
    return FilterResult(
        means=means,
        covs=covs,
        predicted_means=ahead,
        predicted_covs=P_ahead,
        innovations=np.where(seen, residuals, np.nan),
        innovation_covs=S,
        gains=K,
        nis=np.where(seen.any(-1), learned.nis, np.nan),
        log_likelihood=log_likelihood.sum(-1),
        evolution=evolution,
    )


def _for_smoothing(result: FilterResult) -> tuple[Array, Array, Array]:
    """Covariances, predicted ones and the smoother's gains C_k = P_k F_k+1^T (P_k+1|k)^-1."""
    batch, F = result.means.shape[:-2], result.evolution
    P, P_ahead = _shared(result.covs, batch), _shared(result.predicted_covs, batch)
    cross = (F if F.ndim == 2 else F[..., 1:, :, :]) @ P[..., :-1, :, :]
    try:
        np.linalg.cholesky(P_ahead[..., 1:, :, :])
        gains = np.linalg.solve(P_ahead[..., 1:, :, :], cross)
    except np.linalg.LinAlgError:
        gains = np.linalg.pinv(P_ahead[..., 1:, :, :], rcond=1e-12, hermitian=True) @ cross
    return P, P_ahead, np.asarray(gains).mT


def _unchanged(P: Array, before: Array) -> bool:
    """Whether a step changed a covariance by rounding only, of the standard deviations."""
    sigma = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    limit = 4 * np.finfo(P.dtype).eps * sigma[..., :, None] * sigma[..., None, :]
    return bool((np.abs(P - before) <= limit).all())


def _batch_shape(z: Array, initial: Gaussian, push: Array, **matrices: Array) -> tuple[int, ...]:
    """Leading axes of all arguments together; all but `initial` have time, too, as the last."""
    lead = z.shape[:-1]
    for name, matrix in matrices.items():
        lead = as_batch(name, matrix.shape[:-2], lead)
    lead = as_batch("u, B", push.shape[:-1], lead)
    if lead[-1] > z.shape[-2]:
        raise ValueError(f"z: expected {lead[-1]} steps, as many as the model has, got 1")
    batch = as_batch("initial", initial.mean.shape[:-1], lead[:-1])
    return as_batch("initial", initial.cov.shape[:-2], batch)


def _in_steps(matrix: Array, length: int) -> Array:
    """Bring a model matrix to two axes, or to a third from the end that is time, of length T."""
    if matrix.ndim == 2:
        return matrix
    return np.broadcast_to(matrix, (*matrix.shape[:-3], length, *matrix.shape[-2:]))


def _at(matrix: Array, k: int) -> Array:
    return matrix if matrix.ndim == 2 else matrix[..., k, :, :]


def _in_time(steps: Sequence[Array], batch: tuple[int, ...], axes: int) -> Array:
    """Join what T steps gave, time before the last `axes` axes; one for all series if shared."""
    # The first step does not know yet that the series differ.
    steps = [np.broadcast_to(steps[0], steps[-1].shape), *steps[1:]]
    joined = np.stack(steps, -1 - axes)
    return np.broadcast_to(joined, (*batch, *joined.shape[-1 - axes :]))


def _shared(matrices: Array, batch: tuple[int, ...]) -> Array:
    """Take what is the same for all series (strides of zero) once."""
    if any(matrices.strides[: len(batch)]):
        return matrices
    return matrices[(0,) * len(batch)]


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
        If the covariances do not settle (an unstable state that is never seen).

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


def apply(matrix: Array, vector: Array) -> Array:
    """Product of matrices (..., m, n) and vectors (..., n)."""
    return (matrix @ vector[..., None])[..., 0]


def _singular(S: Array) -> ValueError:
    """Make the error for an innovation covariance (..., m, m) that is not positive definite."""
    return ValueError(
        "R: expected an innovation covariance S = H P H^T + R that is positive definite, "
        f"its smallest eigenvalue is {np.linalg.eigvalsh(S)[..., 0].min():.3g}"
    )


def _control(B: ArrayLike | None, u: ArrayLike | None, n: int, *time: int) -> Array:
    """Push B u of a control, shape (..., *time, n); none if both are left out."""
    if (B is None) != (u is None):
        raise ValueError(f"{'B' if B is None else 'u'}: expected B and u together, got one alone")
    if B is None or u is None:
        return np.zeros((*time, n), np.float32)  # no number becomes wider by it
    u = as_array("u", u, ("...", *time, "l"))
    B = as_array("B", B, ("...", n, u.shape[-1]))
    as_batch("B", B.shape[:-2], u.shape[:-1])
    return apply(B, u)
