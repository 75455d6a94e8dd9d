"""The normal equations of a pose graph: a sparse matrix whose pattern never changes.

Pattern, order of elimination and the place of every entry are found once; each iteration only
scatters numbers. Used by `slamlab.slam.graph` (chapter 13 tells why the order matters).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from slamlab._checks import Array

Solve = Callable[[Array], Array]


class SingularError(ValueError):
    """The matrix has no inverse; `rows` are the poses that can move freely."""

    def __init__(self, rows: np.ndarray) -> None:
        super().__init__(f"singular: rows {rows.tolist()} can move freely")
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
    points : ndarray of int, optional
        Rows of the poses that are landmarks: no edge says anything of their heading, which
        therefore gets a one on the diagonal and stays.
    """

    def __init__(
        self, n_poses: int, edges: np.ndarray, free: np.ndarray, points: np.ndarray | None = None
    ) -> None:
        self.free = free
        points = np.zeros(0, dtype=int) if points is None else points
        self.n = n = len(free)
        if n == 0:
            return
        place = np.full(n_poses, -1)
        place[free] = np.arange(n)
        i, j = place[edges[:, 0]], place[edges[:, 1]]
        self.order = _fill_reducing_order(n, i, j)
        rank = np.full(n + 1, -1)  # a fixed pose (-1) keeps -1
        rank[self.order] = np.arange(n)
        self._build_pattern(rank[i], rank[j])
        self._headings = self._diagonal[rank[place[points]], 2]

    def _build_pattern(self, i: np.ndarray, j: np.ndarray) -> None:
        """Lay out the blocks column by column, and find where each edge's numbers go."""
        n = self.n
        inner = (i >= 0) & (j >= 0)
        diagonal = np.arange(n) * (n + 1)
        keys = np.concatenate([diagonal, (j * n + i)[inner], (i * n + j)[inner]])
        keys, block = np.unique(keys, return_inverse=True)
        column, row = np.divmod(keys, n)
        first = np.searchsorted(column, np.arange(n + 1))
        height = 3 * np.diff(first)
        # Entry (a, b) of a block lies at base + a + b * stride of the data array.
        base = 9 * first[column] + 3 * (np.arange(len(keys)) - first[column])
        stride = height[column]
        a, b = np.arange(3)[:, None, None], np.arange(3)[:, None]
        indices = np.empty(9 * len(keys), dtype=np.int32)
        indices[base + a + b * stride] = 3 * row + a
        starts = (9 * first[:-1, None] + height[:, None] * np.arange(3)).ravel()
        indptr = np.append(starts, 9 * len(keys)).astype(np.int32)
        self._H = csc_matrix((np.zeros(len(indices)), indices, indptr), shape=(3 * n, 3 * n))
        self._H.has_canonical_format = True

        # Blocks ii, jj, ij, ji of every edge; those of a fixed pose go behind the end.
        behind = len(keys)
        at_diagonal = np.append(block[:n], behind)
        blocks = np.full((4, len(i)), behind)
        blocks[0], blocks[1] = at_diagonal[i], at_diagonal[j]
        blocks[2:, inner] = block[n:].reshape(2, -1)
        base, stride = np.append(base, 9 * behind), np.append(stride, 0)
        at = blocks[:, None, None, :]
        self._slots = (base[at] + a + b * stride[at]).ravel()
        k = np.arange(3)
        self._diagonal = base[block[:n], None] + k * (1 + stride[block[:n], None])

    def matrix(self, blocks: Array, damping: float = 0.0) -> csc_matrix:
        """Sum the blocks (4, 3, 3, m) of all edges: ii, jj, ij, ji; diagonal times 1 + damping.

        The matrix is good until the next call, which writes into it.
        """
        H = self._H
        H.data = np.bincount(self._slots, blocks.ravel(), minlength=H.nnz)[: H.nnz]
        H.data[self._headings] = 1.0
        if damping:
            H.data[self._diagonal] *= 1 + damping
        return H

    def diagonal(self) -> Array:
        """Diagonal of the matrix made last, shape (n_free, 3)."""
        values = np.empty((self.n, 3))
        values[self.order] = self._H.data[self._diagonal]
        return values

    def factorise(self, H: csc_matrix, check: bool = True) -> Solve:
        """Return the function that solves H x = b for b (n, 3) or (n, 3, k).

        Raises
        ------
        SingularError
            If H is singular (without `check`: only if it is so to the last bit).
        """
        try:
            factor = factors(H)
        except RuntimeError as error:
            raise SingularError(self._loose(H)) from error
        # Rounding hides an exact zero, so ask for a known vector back: sound graphs of 20000 poses
        # return it to 1e-5, singular ones miss it by its own size.
        probe = np.cos(np.arange(3 * self.n))
        if check and not np.abs(factor.solve(H @ probe) - probe).max() < 1e-3:
            raise SingularError(self._loose(H))

        def solve(b: Array) -> Array:
            x = np.empty_like(b)
            x[self.order] = factor.solve(b[self.order].reshape(3 * self.n, -1)).reshape(b.shape)
            return x

        return solve

    def _loose(self, H: csc_matrix) -> np.ndarray:
        # Inverse iteration on a slightly shifted matrix ends in its null space.
        H = H.copy()
        diagonal = H.diagonal()
        H.data[self._diagonal.ravel()] += 1e-12 * np.where(diagonal > 0, diagonal, 1.0)
        factor = factors(H)
        v = np.cos(np.arange(3 * self.n))
        for _ in range(3):
            v = factor.solve(v)
            v /= np.abs(v).max()
        moved = np.abs(v.reshape(-1, 3)).max(1) > 1e-5
        return np.sort(self.free[self.order[moved]])


def factors(H: csc_matrix, order: str = "NATURAL") -> Any:
    """Factors of a Hermitian matrix in its own order, or one that `splu` knows; no pivoting."""
    # Supernodes are narrow here: no panels, no relaxation. (Never raise these above SuperLU's 20
    # and 10: relax=32 overruns its memory.)
    symmetric = {"SymmetricMode": True}
    return splu(H, order, diag_pivot_thresh=0.0, panel_size=1, relax=1, options=symmetric)


def _fill_reducing_order(n: int, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Minimum-degree order of the poses, so that few zeros fill up in the factor."""
    inner = (i >= 0) & (j >= 0)
    i, j, diagonal = i[inner], j[inner], np.arange(n)
    rows, columns = np.concatenate([i, j, diagonal]), np.concatenate([j, i, diagonal])
    values = np.append(np.full(2 * len(i), -1.0), np.full(n, 2.0 * len(i) + 1))
    pattern = csc_matrix((values, (rows, columns)), shape=(n, n))
    return np.argsort(factors(pattern, "MMD_AT_PLUS_A").perm_c)
