"""The normal equations of a pose graph: a sparse matrix whose pattern never changes.

Pattern, order of elimination and the place of every entry are found once; each iteration only
scatters numbers. Used by `slamlab.slam.graph` (chapter 13 tells why the order matters).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from slamlab._checks import Array

Solve = Callable[[Array], Array]
_SYMMETRIC = {"SymmetricMode": True}


class SingularError(ValueError):
    """The matrix has no inverse; `rows` are the block rows that can move freely."""

    def __init__(self, rows: np.ndarray) -> None:
        super().__init__(f"singular at block rows {rows.tolist()}")
        self.rows = rows


class BlockSystem:
    """Symmetric sparse matrix of 3 x 3 blocks: one block row a free pose, one pair an edge.

    Parameters
    ----------
    n_poses : int
        Number of poses, fixed ones included.
    edges : ndarray of int, shape (m, 2)
        Rows of the poses that each edge joins.
    free : ndarray of int
        Rows of the poses that may move.
    """

    def __init__(self, n_poses: int, edges: np.ndarray, free: np.ndarray) -> None:
        self.free = free
        self.n = len(free)
        place = np.full(n_poses, -1)
        place[free] = np.arange(self.n)
        i, j = place[edges].T
        order = _fill_reducing_order(self.n, i, j)
        rank = np.empty(self.n, dtype=np.intp)
        rank[order] = np.arange(self.n)
        self.order = order
        i, j = np.where(i >= 0, rank[i], -1), np.where(j >= 0, rank[j], -1)
        self._build_pattern(i, j)

    def _build_pattern(self, i: np.ndarray, j: np.ndarray) -> None:
        # Block rows and columns in the order in which `factorise` gets their values:
        # diagonal blocks of edge starts and ends, then the pair blocks and their transposes.
        rows = np.concatenate([i, j, i, j])
        columns = np.concatenate([i, j, j, i])
        self._used = np.flatnonzero((rows >= 0) & (columns >= 0))
        rows, columns = rows[self._used], columns[self._used]
        a, b = np.divmod(np.arange(9), 3)
        scalar_rows = (3 * rows[:, None] + a).ravel()
        scalar_columns = (3 * columns[:, None] + b).ravel()
        keys = scalar_columns * (3 * self.n) + scalar_rows
        unique, self._slot = np.unique(keys, return_inverse=True)
        scalar_columns, self._indices = np.divmod(unique, 3 * self.n)
        self._indptr = np.searchsorted(scalar_columns, np.arange(3 * self.n + 1))
        self._diagonal = np.flatnonzero(scalar_columns == self._indices)

    def matrix(self, H_ii: Array, H_jj: Array, H_ij: Array) -> csc_matrix:
        """Sum the blocks (m, 3, 3) of all edges, in the order of elimination."""
        blocks = np.concatenate([H_ii, H_jj, H_ij, np.swapaxes(H_ij, 1, 2)])
        data = np.bincount(
            self._slot, weights=blocks[self._used].ravel(), minlength=len(self._indices)
        )
        shape = (3 * self.n, 3 * self.n)
        return csc_matrix((data, self._indices, self._indptr), shape=shape)

    def factorise(self, H: csc_matrix, damping: float = 0.0) -> Solve:
        """Return the function that solves (H + damping diag H) x = b for b (n, 3) or (n, 3, k).

        Raises
        ------
        SingularError
            If H is singular; it tells the poses that can move freely.
        """
        diagonal = H.data[self._diagonal]
        if damping:
            H = H.copy()
            H.data[self._diagonal] *= 1 + damping
        try:
            factor = self._splu(H)
        except RuntimeError as error:
            raise SingularError(self._loose(H)) from error
        # A pivot that vanished against its diagonal entry is rounding, not information.
        if (factor.U.diagonal() < 1e-13 * diagonal).any():
            raise SingularError(self._loose(H))

        def solve(b: Array) -> Array:
            permuted = b[self.order].reshape(3 * self.n, -1)
            x = np.empty_like(b)
            x[self.order] = factor.solve(permuted).reshape(b.shape)
            return x

        return solve

    @staticmethod
    def _splu(H: csc_matrix) -> object:
        return splu(H, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=_SYMMETRIC)

    def _loose(self, H: csc_matrix) -> np.ndarray:
        # Inverse iteration on a slightly shifted matrix ends in its null space.
        H = H.copy()
        diagonal = H.data[self._diagonal]
        H.data[self._diagonal] += 1e-10 * np.where(diagonal > 0, diagonal, 1.0)
        factor = self._splu(H)
        v = np.ones(3 * self.n)
        for _ in range(3):
            v = factor.solve(v)
            v /= np.abs(v).max()
        moved = np.abs(v.reshape(-1, 3)).max(1) > 1e-2
        return np.sort(self.free[self.order[moved]])


def _fill_reducing_order(n: int, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Minimum-degree order of the block rows, so that few zeros fill up in the factor."""
    inner = (i >= 0) & (j >= 0)
    rows = np.concatenate([i[inner], j[inner], np.arange(n)])
    columns = np.concatenate([j[inner], i[inner], np.arange(n)])
    values = np.concatenate([np.full(2 * inner.sum(), -1.0), np.full(n, 2.0 * len(i))])
    pattern = csc_matrix((values, (rows, columns)), shape=(n, n))
    factor = splu(pattern, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=_SYMMETRIC)
    return np.argsort(factor.perm_c)
