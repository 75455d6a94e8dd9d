"""The recurrences of a Kalman filter and smoother through time, compiled; used by `_sequences`.

Arrays have time first, then the batch (one entry that all series share, or one for each); model
matrices have one entry in time if they are constant. Products are plain loops: for matrices of
this size they are faster than a library's, and compile in a tenth of the time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamlab.kernels.compiling import njit

Array = NDArray[np.float64]

Arrays = tuple[Array, ...]

# A sweep that stopped where little changed goes on for so many steps before it stops again.
_PATIENCE = 8


@njit(cache=True)
def _at(matrices: Array, k: int, b: int) -> Array:
    """Entry of step k and series b."""
    return matrices[min(k, len(matrices) - 1), min(b, matrices.shape[1] - 1)]


@njit(cache=True)
def _times(a: Array, b: Array) -> Array:
    """Product a b."""
    out = np.zeros((a.shape[0], b.shape[1]), a.dtype)
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@njit(cache=True)
def _plus(a: Array, b: Array, sign: float = 1.0) -> Array:
    """Sum a + sign b."""
    out = np.zeros(a.shape, a.dtype)
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[i, j] = a[i, j] + sign * b[i, j]
    return out


@njit(cache=True)
def _set(out: Array, a: Array, half: float = 1.0) -> None:
    """Write a or, with half = 0.5, its symmetric part."""
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[i, j] = a[i, j] if half == 1.0 else half * (a[i, j] + a[j, i])


@njit(cache=True)
def _whiten(S: Array, out: Array) -> bool:
    """Write the inverse of the Cholesky factor L of S; False if there is none."""
    L = np.zeros(S.shape, S.dtype)
    for i in range(len(S)):
        for j in range(i + 1):
            rest = S[i, j]
            for k in range(j):
                rest -= L[i, k] * L[j, k]
            if i == j and not rest > 0.0:
                return False
            L[i, j] = np.sqrt(rest) if i == j else rest / L[j, j]
        for j in range(len(S)):
            rest = 1.0 if i == j else 0.0
            for k in range(j, i):
                rest -= L[i, k] * out[k, j]
            out[i, j] = rest / L[i, i]
    return True


@njit(cache=True)
def _blind(H: Array, R: Array, seen: Array) -> tuple[Array, Array, bool]:
    """H and R where missing components see nothing, and have unit noise; whether all are seen."""
    H, R, complete = H.copy(), R.copy(), True
    for i in range(len(seen)):
        if not seen[i]:
            complete = False
            for j in range(H.shape[1]):
                H[i, j] = 0.0
            for j in range(len(seen)):
                R[i, j] = R[j, i] = 1.0 if i == j else 0.0
    return H, R, complete


@njit(cache=True)
def _is_still(new: Array, old: Array, limit: float) -> bool:
    """Whether no entry changed by more than `limit`, in units of its standard deviations."""
    for i in range(len(new)):
        for j in range(i + 1):
            scale = np.sqrt(abs(new[i, i] * new[j, j]))
            if not abs(new[i, j] - old[i, j]) <= limit * scale:
                return False
    return True


@njit(cache=True)
def step_covariances(
    model: Arrays, P: Array, seen: Array, start: int, limit: float, out: Arrays
) -> int:
    """P5 (4), (6), (7), (9) from step `start` on, as many as `out` holds; how many were done.

    The model is F, H, Q, R; `out` are the parts of a `_Step`.
    Ends early where no covariance changes by more than `limit`, and returns -1 - i where the
    innovation covariance of the i-th step is singular.
    """
    F, H, Q, R = model
    predicted, S, K, cov, whitening, A = out
    for i in range(len(cov)):
        k, still = start + i, i >= _PATIENCE
        for b in range(cov.shape[1]):
            before = cov[i - 1, b] if i > 0 else P[min(b, len(P) - 1)]
            F_k = _at(F, k, b)
            H_k, R_k, complete = _blind(_at(H, k, b), _at(R, k, b), _at(seen, k, b))
            # (4)
            moved = _times(_times(F_k, before), F_k.T)
            _set(predicted[i, b], _plus(moved, _at(Q, k, b)), 0.5)
            # (6)
            PHt = _times(predicted[i, b], H_k.T)
            _set(S[i, b], _plus(_times(H_k, PHt), R_k))
            # (7), by the inverse of the Cholesky factor
            if not _whiten(S[i, b], whitening[i, b]):
                return -1 - i
            _set(K[i, b], _times(_times(PHt, whitening[i, b].T), whitening[i, b]))
            # (9), Joseph's form
            keep = _plus(np.eye(len(before), dtype=P.dtype), _times(K[i, b], H_k), -1.0)
            kept = _times(_times(keep, predicted[i, b]), keep.T)
            _set(cov[i, b], _plus(kept, _times(_times(K[i, b], R_k), K[i, b].T)), 0.5)
            _set(A[i, b], _times(keep, F_k))
            still = still and complete and _is_still(cov[i, b], before, limit)
        if still:
            return i + 1
    return len(cov)


@njit(cache=True)
def recur(A: Array, rows: Array, x: Array) -> None:
    """Solve x_k = A[rows_k] x_k-1 + x_k in place, the first x given; `x` is (T, batch, n)."""
    for k in range(1, len(x)):
        for b in range(x.shape[1]):
            matrix = _at(A, rows[k], b)
            for i in range(x.shape[2]):
                for j in range(x.shape[2]):
                    x[k, b, i] += matrix[i, j] * x[k - 1, b, j]


@njit(cache=True)
def smooth_covariances(
    gains: Array, groups: Array, P: Array, ahead: Array, out: Array, k: int, limit: float
) -> int:
    """P_k|T = P_k + C_k (P_k+1|T - P_k+1|k) C_k^T, from below step k down; the last step done.

    Ends early in a run of equal gains, `groups`, where no covariance changes by more than `limit`.
    """
    stop = k - _PATIENCE
    while k > 0:
        k -= 1
        still = 0 < k < stop and groups[k] == groups[k - 1]
        for b in range(out.shape[1]):
            C, learned = _at(gains, groups[k], b), _plus(out[k + 1, b], _at(ahead, k + 1, b), -1.0)
            _set(out[k, b], _plus(_times(_times(C, learned), C.T), _at(P, k, b)), 0.5)
            still = still and _is_still(out[k, b], out[k + 1, b], limit)
        if still:
            return k
    return k
