"""Kalman filter and Rauch-Tung-Striebel smoother over whole sequences; public in `kalman`.

P5 (3)-(9) a step. Two facts make it fast. The covariances do not depend on the measurements, so
one run of them serves a batch of series; with a constant model they settle, and from there on one
set of matrices serves every step. With gains known, the means obey x_k = A_k x_{k-1} + g_k. Both
recurrences are compiled (`_sweeps`). Inside, time is the first axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_count, as_covariance, as_shaped
from slamlab.filters._linear import apply, singular
from slamlab.gaussian import Gaussian, as_belief
from slamlab.kernels.sequences import Arrays, recur, smooth_covariances, step_covariances

# Covariances count as settled when what is left of their way is below this many units of
# rounding: 1.1e-13 in double precision, relative to the standard deviations.
SETTLED = 500


@dataclass(frozen=True, eq=False)
class FilterResult:
    """What a filter knew along T steps; leading axes are a batch of series.

    Attributes
    ----------
    means, covs : ndarray, shape (..., T, n) and (..., T, n, n)
        After the measurement of the step.
    predicted_means, predicted_covs : ndarray, shape (..., T, n) and (..., T, n, n)
        Before it.
    residuals : ndarray, shape (..., T, m)
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
    evolution : ndarray, shape (T or 1, 1 or batch size, n, n)
        The F of the run, for the smoother.
    rows : ndarray of int, shape (T,)
        Steps of equal number share their covariances.
    """

    means: Array
    covs: Array
    predicted_means: Array
    predicted_covs: Array
    residuals: Array
    innovation_covs: Array
    gains: Array
    nis: Array
    log_likelihood: Array
    evolution: Array
    rows: np.ndarray


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


class _Step(NamedTuple):
    predicted: Array
    S: Array
    K: Array
    cov: Array
    whitening: Array
    A: Array


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
        If a shape does not fit, a number is not finite (NaN in `z` excepted), Q or R is no
        covariance, or an innovation covariance is singular.

    Examples
    --------
    >>> belief = Gaussian([0.0], [[1.0]])
    >>> run = filter([[1.0], [np.nan], [1.2]], [[1.0]], [[1.0]], [[0.0]], [[1.0]], belief)
    >>> run.means[:, 0].round(3).tolist(), run.covs[:, 0, 0].round(3).tolist()
    ([0.5, 0.5, 0.733], [0.5, 0.5, 0.333])
    """
    z = as_shaped("z", z, ("...", "T", "m"))
    if np.isinf(z).any():
        raise ValueError("z: expected finite numbers or NaN for missing, got infinity")
    (length, m), n = z.shape[-2:], as_belief("initial", initial).dim
    if length == 0:
        raise ValueError(f"z: expected at least one step, got shape {z.shape}")
    batch = _batch_shape(z, initial, F, H, Q, R, B, u)
    F = _model("F", as_array("F", F, ("...", n, n)), length, batch)
    H = _model("H", as_array("H", H, ("...", m, n)), length, batch)
    Q = _model("Q", as_covariance("Q", Q, n), length, batch)
    R = _model("R", as_covariance("R", R, m), length, batch)
    push = _push(B, u, n, length, batch)
    z = _time_first(z, batch, 1)
    seen = _shared(~np.isnan(z))
    P = _shared(_flat(initial.cov, batch, 2)[None])[0]
    steps, rows = _covariances((F, H, Q, R), P, seen)
    mean = _flat(initial.mean, batch, 1)
    means = _means(steps, rows, H, np.where(seen, z, 0), push, mean)
    before = np.concatenate([np.broadcast_to(mean, (1, *means.shape[1:])), means[:-1]])
    predicted = _apply_all(F, before) + push
    residuals = z - _apply_all(H, predicted)
    nis, log_density = _fit(steps, rows, np.where(seen, residuals, 0), seen.sum(-1))
    return FilterResult(
        means=_batch_first(means, batch),
        covs=_batch_first(steps.cov[rows], batch),
        predicted_means=_batch_first(predicted, batch),
        predicted_covs=_batch_first(steps.predicted[rows], batch),
        residuals=_batch_first(residuals, batch),
        innovation_covs=_batch_first(steps.S[rows], batch),
        gains=_batch_first(steps.K[rows], batch),
        nis=_batch_first(nis, batch),
        log_likelihood=np.broadcast_to(log_density.sum(0), (prod(batch),)).reshape(batch),
        evolution=F,
        rows=rows,
    )


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
    batch, means, predicted, P, ahead = _unpack(result)
    gains, groups = _smoother_gains(result, P, ahead)
    # x_k|T = x_k|k + C_k (x_k+1|T - x_k+1|k): the recurrence of the filter, backwards
    offset = means.copy()
    offset[:-1] -= _grouped(gains, groups, predicted[1:])
    backwards = len(gains) - 1 - groups[::-1]
    offset[:-1] = _recurrence(gains[::-1], backwards, offset[:-1][::-1], means[-1])[::-1]
    covs = _smoothed_covariances(gains, groups, P, ahead)
    return SmootherResult(_batch_first(offset, batch), _batch_first(covs, batch))


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

    Raises
    ------
    ValueError
        If `lag` is no count.

    Examples
    --------
    >>> belief = Gaussian([0.0], [[1.0]])
    >>> run = filter([[1.0], [0.8], [1.2]], [[1.0]], [[1.0]], [[0.1]], [[1.0]], belief)
    >>> np.allclose(fixed_lag(run, 2).means, smooth(run).means)
    True
    """
    lag = as_count("lag", lag)
    batch, means, predicted, P, ahead = _unpack(result)
    gains, groups = _smoother_gains(result, P, ahead)
    length = len(means)
    last = np.minimum(np.arange(length) + lag, length - 1)
    x, cov = means[last], P[last]
    for back in range(min(lag, length - 1) - 1, -1, -1):
        stop = length - 1 - back
        C = gains[groups[back:]]
        x[:stop] = means[back:-1] + apply(C, x[:stop] - predicted[back + 1 :])
        cov[:stop] = P[back:-1] + C @ (cov[:stop] - ahead[back + 1 :]) @ C.mT
    return SmootherResult(_batch_first(x, batch), _batch_first(cov, batch))


# --- covariances: once for a batch, until they settle ---


def _covariances(model: Arrays, P: Array, seen: np.ndarray) -> tuple[_Step, np.ndarray]:
    """Distinct steps of P5 (4), (6), (7), (9), stacked, and which of them each time uses."""
    # Copies of one type, in one order: each other combination would be compiled anew.
    dtype = np.result_type(*model, P)
    F, H, Q, R, P = (np.array(matrix, dtype, order="C") for matrix in (*model, P))
    model = F, H, Q, R
    seen, length = np.array(seen, order="C"), len(seen)
    complete = np.asarray(seen.all(axis=(1, 2)))
    gaps = np.append(np.flatnonzero(~complete), length)
    constant = all(len(matrix) == 1 for matrix in model)
    parts: list[_Step] = []
    rows = np.empty(length, dtype=int)
    limit = SETTLED * float(np.finfo(P.dtype).eps) if constant else -1.0
    k = n_distinct = 0
    while k < length:
        steps = _empty_steps(min(length - k, max(64, n_distinct)), H, F, seen, P)
        done = step_covariances(model, P, seen, k, limit, tuple(steps))
        if done < 0:
            raise singular(steps.S[-1 - done])
        stop = k + done
        rows[k:stop] = n_distinct + np.arange(stop - k)
        parts.append(_Step(*(part[: stop - k] for part in steps)))
        last = [P, *steps.cov[: stop - k]][-2:]
        P, n_distinct, k = last[1], n_distinct + stop - k, stop
        if constant and complete[k - 1] and _settled(P, last[0], steps.A[len(parts[-1].A) - 1]):
            k = int(gaps[np.searchsorted(gaps, k)])
            rows[stop:k] = n_distinct - 1
    return _Step(*(np.concatenate(part) for part in zip(*parts, strict=True))), rows


def _empty_steps(count: int, H: Array, F: Array, seen: np.ndarray, P: Array) -> _Step:
    m, n = H.shape[2:]
    size = max(array.shape[1] for array in (H, F, seen)) if len(P) == 1 else len(P)
    shapes = ((n, n), (m, m), (n, m), (n, n), (m, m), (n, n))
    return _Step(*(np.zeros((count, size, *shape), P.dtype) for shape in shapes))


def _settled(new: Array, old: Array, A: Array) -> bool:
    """Whether P -> A P A^T + const has arrived: last change over (1 - rho(A)^2) is rounding."""
    limit = SETTLED * np.finfo(new.dtype).eps
    sigma = np.sqrt(np.abs(np.diagonal(new, axis1=-2, axis2=-1)))
    scale = sigma[..., :, None] * sigma[..., None, :]
    change = np.abs(new - old)
    if (change > limit * scale).any():
        return False
    rate = 1 - np.abs(np.linalg.eigvals(A)).max(-1, initial=0.0) ** 2
    return bool((rate > 0).all() and (change <= limit * scale * rate[..., None, None]).all())


# --- means: a linear recurrence ---


def _means(
    steps: _Step, rows: np.ndarray, H: Array, z: Array, push: Array | float, initial: Array
) -> Array:
    """Solve (3), (5), (8): x_k = (I - K H) F x_k-1 + (I - K H) B u + K z."""
    input_ = _grouped(steps.K, rows, z)
    if not isinstance(push, float):
        input_ = input_ + push - _grouped(steps.K, rows, _apply_all(H, push))
    return _recurrence(steps.A, rows, input_, initial)


def _recurrence(A: Array, rows: np.ndarray, g: Array, x: Array) -> Array:
    """Solve x_k = A[rows_k] x_k-1 + g_k for all k; `g` is (T, batch, n)."""
    shape = np.broadcast_shapes(g.shape[1:], x.shape, A.shape[1:-1])
    out = np.array(np.broadcast_to(g, (len(g), *shape)))
    if len(out):
        out[0] += apply(A[rows[0]], x)
        recur(np.array(A, out.dtype), np.array(rows), out)
    return out


# --- smoother ---


def _smoother_gains(result: FilterResult, P: Array, ahead: Array) -> tuple[Array, np.ndarray]:
    """Distinct gains C_k = P_k F_k+1^T (P_k+1|k)^-1 and which of them each of T - 1 steps uses."""
    rows, F = result.rows, result.evolution
    change = np.diff(rows) != 0
    new = change | np.append(True, change[:-1])[: len(change)]
    first = np.flatnonzero(new)
    next_F = F[np.minimum(first + 1, len(F) - 1)]
    cross = next_F @ P[first]
    try:
        np.linalg.cholesky(ahead[first + 1])
        gains = np.linalg.solve(ahead[first + 1], cross)
    except np.linalg.LinAlgError:
        gains = np.linalg.pinv(ahead[first + 1], rcond=1e-12, hermitian=True) @ cross
    return np.asarray(gains).mT, np.cumsum(new) - 1


def _smoothed_covariances(gains: Array, groups: np.ndarray, P: Array, ahead: Array) -> Array:
    """Solve P_k|T = P_k + C_k (P_k+1|T - P_k+1|k) C_k^T backwards, jumping where it settles."""
    gains, groups, P, ahead = (np.array(part, order="C") for part in (gains, groups, P, ahead))
    out = P.copy()
    limit = SETTLED * float(np.finfo(out.dtype).eps)
    k = len(P) - 1
    while k > 0:
        k = smooth_covariances(gains, groups, P, ahead, out, k, limit)
        start = int(np.searchsorted(groups, groups[k]))
        if start < k and _settled(out[k], out[k + 1], gains[groups[k]]):
            out[start:k] = out[k]
            k = start
    return out


# --- shapes: time first, one flat batch axis of length 1 or the batch's size ---


def _batch_shape(z: Array, initial: Gaussian, *others: ArrayLike | None) -> tuple[int, ...]:
    *matrices, u = others
    shapes = [z.shape[:-2], initial.mean.shape[:-1], initial.cov.shape[:-2]]
    shapes += [np.shape(matrix)[:-3] for matrix in matrices if matrix is not None]
    shapes += [np.shape(u)[:-2]] if u is not None else []
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError as error:
        raise ValueError(f"z: expected batch axes that broadcast, got {shapes}") from error


def _flat(array: Array, batch: tuple[int, ...], n_axes: int) -> Array:
    """Gather the batch axes of (..., *core) into one: (1 or size, *core)."""
    core = array.shape[array.ndim - n_axes :]
    if array.ndim == n_axes:
        return array[None]
    return np.broadcast_to(array, (*batch, *core)).reshape(-1, *core)


def _time_first(array: Array, batch: tuple[int, ...], n_axes: int) -> Array:
    return np.ascontiguousarray(np.moveaxis(_flat(array, batch, n_axes + 1), 1, 0))


def _batch_first(array: Array, batch: tuple[int, ...]) -> Array:
    out = np.moveaxis(np.broadcast_to(array, (len(array), prod(batch), *array.shape[2:])), 0, 1)
    return out.reshape(*batch, *out.shape[1:])


def _model(name: str, matrix: Array, length: int, batch: tuple[int, ...]) -> Array:
    """Bring a model matrix to (T or 1, batch or 1, rows, columns)."""
    if matrix.ndim == 2:
        return matrix[None, None]
    if matrix.shape[-3] not in (1, length):
        raise ValueError(
            f"{name}: expected {length} steps (or 1) on the third axis from the end, "
            f"got shape {matrix.shape}"
        )
    return _time_first(matrix, batch, 2)


def _push(
    B: ArrayLike | None, u: ArrayLike | None, n: int, length: int, batch: tuple[int, ...]
) -> Array | float:
    if (B is None) != (u is None):
        raise ValueError(f"{'B' if B is None else 'u'}: expected B and u together, got one alone")
    if B is None or u is None:
        return 0.0
    u = as_array("u", u, ("...", length, "l"))
    matrix = _model("B", as_array("B", B, ("...", n, u.shape[-1])), length, batch)
    return _apply_all(matrix, _time_first(u, batch, 1))


def _shared(array: Array) -> Array:
    """Keep one member of the batch (axis 1) if all are the same."""
    same = array.shape[1] > 1 and bool((array == array[:, :1]).all())
    return array[:, :1] if same else array


def _apply_all(matrix: Array, vectors: Array) -> Array:
    """Matrices (T or 1, batch or 1, m, n) on vectors (T, batch, n); one product if constant."""
    if matrix.shape[:2] == (1, 1):
        flat = vectors.reshape(-1, vectors.shape[-1]) @ matrix[0, 0].T
        return flat.reshape(*vectors.shape[:-1], -1)
    if matrix.shape[1] == 1:
        return vectors @ matrix[:, 0].mT
    return apply(matrix, vectors)


def _grouped(matrices: Array, rows: np.ndarray, vectors: Array) -> Array:
    """Apply matrices[rows_k] to vectors_k, (T, batch, n)."""
    return _apply_all(matrices if len(matrices) == 1 else matrices[rows], vectors)


def _fit(steps: _Step, rows: np.ndarray, residuals: Array, seen: Array) -> tuple[Array, Array]:
    """Normalised innovations squared (T, batch) and log densities, `seen` components a step."""
    white = _grouped(steps.whitening, rows, residuals)
    nis = (white * white).sum(-1)
    log_det = -2 * np.log(np.diagonal(steps.whitening, axis1=-2, axis2=-1)).sum(-1)
    log_density = -0.5 * (nis + log_det[rows] + seen * np.log(2 * np.pi))
    return np.where(seen > 0, nis, np.nan), log_density


def _unpack(result: FilterResult) -> tuple[tuple[int, ...], Array, Array, Array, Array]:
    """Batch shape, means, predicted means, covariances and predicted covariances, time first."""
    batch = result.means.shape[:-2]
    means = _time_first(result.means, batch, 1)
    predicted = _time_first(result.predicted_means, batch, 1)
    P = _covs_time_first(result.covs, batch)
    return batch, means, predicted, P, _covs_time_first(result.predicted_covs, batch)


def _covs_time_first(covs: Array, batch: tuple[int, ...]) -> Array:
    """Take covariances time first, one for all where the filter shared them (zero strides)."""
    if batch and not any(covs.strides[: len(batch)]):
        covs = covs[(slice(0, 1),) * len(batch)].reshape(covs.shape[len(batch) :])
    return _time_first(covs, batch, 2)
