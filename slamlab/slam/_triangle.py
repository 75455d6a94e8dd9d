"""Arithmetic on the lower triangle of a large covariance, in pieces that suit cache and threads.

What makes the update of `EKFSlam` cost O(n^2) and no more; chapter 10 measures it.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dsyrk

from slamlab._checks import Array

__all__ = ["block_diagonal", "downdate", "mirror", "times"]

# OpenBLAS starts threads for products of more multiplications than this. On a busy machine they
# wait for each other for tens of milliseconds, so small products are kept below it.
PIECE = 2**18
# From this size on the work is worth the threads.
LARGE = 1500
# Rank of the pieces into which a small P's downdate is cut.
RANK = 32


def times(A: Array, B: Array) -> Array:
    """Product A B (a, N) of a small A (a, b) and a wide B (b, N), on one thread."""
    width = max(1, PIECE // max(1, A.size))
    if B.shape[1] <= width:
        return np.asarray(A @ B)
    product = np.empty((len(A), B.shape[1]))
    for j in range(0, B.shape[1], width):
        np.matmul(A, B[:, j : j + width], out=product[:, j : j + width])
    return product


def downdate(P: Array, B: Array) -> None:
    """P - B^T B in place for a square contiguous P (N, N) and B (k, N); lower triangle only."""
    N, k = len(P), len(B)
    if N == 0 or k == 0:
        return
    if k > RANK and N < LARGE:
        for part in range(0, k, RANK):
            downdate(P, B[part : part + RANK])
        return
    step = k if N >= LARGE else PIECE // (N * (N + 1))
    if step >= 4:
        for part in range(0, k, step):
            # BLAS counts columns first: our lower triangle is its upper one, B^T its B.
            some = B[part : part + step].T
            updated = dsyrk(-1.0, some, beta=1.0, c=P.T, overwrite_c=1)
            assert np.may_share_memory(updated, P), "dsyrk worked on a copy"
        return
    width = 64
    height = max(1, PIECE // (k * width))
    for j in range(0, N, width):
        columns = slice(j, j + width)
        for i in range(j, N, height):
            P[i : i + height, columns] -= B[:, i : i + height].T @ B[:, columns]


def mirror(P: Array, width: int = 128) -> None:
    """Copy the lower triangle of P (N, N) to the upper one, in place, square by square."""
    for j in range(0, len(P), width):
        e = j + width
        square = P[j:e, j:e]
        square[...] = np.tril(square) + np.tril(square, -1).T
        for k in range(e, len(P), width):
            P[j:e, k : k + width] = P[k : k + width, j:e].T


def block_diagonal(blocks: Array) -> Array:
    """Matrix (2m, 2m) with the blocks (m, 2, 2) on its diagonal."""
    m = len(blocks)
    matrix = np.zeros((m, 2, m, 2))
    matrix[np.arange(m), :, np.arange(m)] = blocks
    return matrix.reshape(2 * m, 2 * m)
