"""The covariance of EKF-SLAM: a symmetric matrix that grows, and how to work on it cheaply.

P1 (7): the pose comes first, then the landmarks. What makes an update cost O(n^2) and no more, and
no more than a textbook's matrices when the map is small; chapter 10 measures it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyr2, dsyrk

from slamlab._checks import Array

__all__ = ["Covariance", "block_diagonal", "diagonal", "downdate", "mirror", "times"]

Entries = NDArray[np.intp]
# OpenBLAS starts threads for products of more multiplications than this. On a busy machine they
# wait for each other for tens of milliseconds, so small products are kept below it.
PIECE = 2**18
# Up to this size both triangles are kept, above it only the lower one: half the memory traffic.
SMALL = 256
# From this size on the work is worth the threads.
LARGE = 1500
POSE = np.arange(3)
# Rank of the pieces into which the downdate of a matrix between the two is cut.
RANK = 32


class Covariance:
    """A covariance P (N, N) of a pose and landmarks.

    A small P is kept whole. Of a large one only the lower triangle is kept up to date, and
    mirrored when somebody asks for the whole `matrix`.

    Parameters
    ----------
    P : ndarray, shape (N, N)
        Symmetric; copied.
    """

    def __init__(self, P: Array) -> None:
        # One flat piece of memory; `_P` reads its first N^2 numbers as a matrix. What stands
        # above the diagonal of `_P` counts only if `_whole`.
        self._flat, self._whole = P.flatten(), True
        self._size = len(P)
        self._P: Array = self._flat.reshape(P.shape)

    def __len__(self) -> int:
        """Size N."""
        return self._size

    # Reading. All but `matrix` return copies.

    @property
    def matrix(self) -> Array:
        """All of P (N, N), exactly symmetric; a view."""
        if not self._whole:
            mirror(self._P)
            self._whole = True
        return self._P

    @property
    def pose(self) -> Array:
        """Block (3, 3) of the pose."""
        return self._P[:3, :3].copy() if self._whole else self.block(POSE)

    def pairs(self, i: Entries, j: Entries) -> Array:
        """Entries P[i, j]; index arrays broadcast."""
        if self._whole:
            return self._P[i, j]
        return self._P[np.maximum(i, j), np.minimum(i, j)]

    def block(self, i: Entries) -> Array:
        """Block P[i, i]."""
        return self.pairs(i[:, None], i[None, :])

    def rows(self, i: Entries) -> Array:
        """Whole rows P[i, :]: left of the diagonal as stored, right of it the column."""
        if self._whole:
            return self._P[i]
        return np.where(np.arange(self._size) <= i[:, None], self._P[i], self._P[:, i].T)

    # Changing.

    def move(self, F: Array, Q: Array) -> None:
        """P1 (11), P2 (9): the pose block and, not to be forgotten, its covariance with the map.

        P_pp <- F P_pp F^T + Q and P_mp <- P_mp F^T, F and Q (3, 3). O(N).
        """
        P, cross = self._P, F @ (self._P[:3] if self._whole else self.rows(POSE))
        moved = cross[:, :3] @ F.T + Q
        P[:, :3] = cross.T
        if self._whole:
            P[:3] = cross
        P[:3, :3] = 0.5 * (moved + moved.T)

    def correct(self, B: Array, **_: Any) -> None:
        """P1 (36), P2 (11): P <- P - K S K^T = P - B^T B, with B (k, N). O(k N^2)."""
        if len(B):
            downdate(self.matrix if self._size <= SMALL else self._P, B)
            self._whole = self._size <= SMALL

    def shear(self, a: Array) -> None:
        """P <- A P A^T with A = I + a e^T, e the unit vector of the heading, a (N,). O(N^2)."""
        P = self.matrix
        # A P A^T = P + a b^T + b a^T
        b = P[2] + 0.5 * P[2, 2] * a
        if self._size <= SMALL:
            change = np.outer(a, b)
            P += change + change.T
            return
        dsyr2(1.0, a, b, a=P.T, overwrite_a=1)
        self._whole = False

    def append(self, G: Array, own: Array) -> None:
        """P1 (43): landmarks x = G pose + noise of covariance `own`, G (2k, 3), own (2k, 2k)."""
        old, cross = self._size, G @ self.rows(POSE)
        own = cross[:, :3] @ G.T + own
        self._resize(old + len(G))
        self._P[old:, :old], self._P[old:, old:] = cross, 0.5 * (own + own.T)
        if self._whole:
            self._P[:old, old:] = cross.T

    def put(self, i: Entries, rows: Array) -> None:
        """Write the rows i, and the columns, of P: rows (k, M), M - N new ones among them."""
        self._resize(rows.shape[1])
        self._P[i], self._P[:, i] = rows, rows.T

    def keep(self, entries: Entries) -> None:
        """Keep these rows and columns only, which marginalises the others."""
        kept = self.matrix[np.ix_(entries, entries)]
        self._resize(0)
        self._resize(len(entries))
        self._P[...] = kept

    def _resize(self, size: int) -> None:
        """Make room for `size` rows and keep what is there; the memory grows by doubling."""
        P, old = self._P, min(self._size, size)
        if size * size > len(self._flat):
            # Zeros: what is added above the diagonal must not warn of numbers that nobody wrote.
            self._flat = np.zeros(max(size * size, 2 * len(self._flat)))
        self._size = size
        self._P = self._flat[: size * size].reshape(size, size)
        # In the same memory the rows move apart; NumPy sees the overlap and copies first.
        self._P[:old, :old] = P[:old, :old]


def times(A: Array, B: Array) -> Array:
    """Product A B (a, N) of a small A (a, b) and a wide B (b, N), on one thread."""
    if A.size * B.shape[1] <= PIECE:
        return np.asarray(A @ B)
    width = max(1, PIECE // A.size)
    product = np.empty((len(A), B.shape[1]))
    for j in range(0, B.shape[1], width):
        np.matmul(A, B[:, j : j + width], out=product[:, j : j + width])
    return product


def downdate(P: Array, B: Array) -> None:
    """P - B^T B in place, contiguous P (N, N), B (k, N); of a large P the lower triangle only."""
    N, k = len(P), len(B)
    if N <= SMALL:
        step = max(1, PIECE // max(1, N * N))
        for part in range(0, k, step):
            some = B[part : part + step]
            P -= some.T @ some
        return
    if k > RANK and N < LARGE:
        for part in range(0, k, RANK):
            downdate(P, B[part : part + RANK])
        return
    if N >= LARGE:
        # BLAS counts columns first: our lower triangle is its upper one, B^T its B.
        updated = dsyrk(-1.0, B.T, beta=1.0, c=P.T, overwrite_c=1)
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
    matrix = np.zeros((2 * len(blocks), 2 * len(blocks)))
    matrix[diagonal(len(blocks))] = blocks
    return matrix


@lru_cache(maxsize=256)
def diagonal(m: int, right: int = 0) -> tuple[Entries, Entries]:
    """Index of the blocks (m, 2, 2) on the diagonal that begins `right` of the corner."""
    entries = np.arange(2 * m)
    return entries.reshape(m, 2, 1), entries.reshape(m, 1, 2) + right
