"""Landmark maps of many particles that share what they have in common.

The copy of a particle in step 3 of P2's algorithm must not copy its map: maps lie in pages, a copy
shares them, and a page is copied when one of its owners writes to it. Used by FastSLAM.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array

__all__ = ["ABSENT", "FIELDS", "PAGE", "SharedMaps"]

Indices = NDArray[np.intp]

PAGE = 64
# What is kept of a landmark: mean (x, y), covariance (xx, xy, yy), log odds that it exists.
FIELDS = 6
ABSENT = -np.inf


class SharedMaps:
    """Maps of M particles; landmark c of a particle lies in column c of its map.

    The index table `table` (M, blocks) names the page that holds columns ``PAGE * b`` to
    ``PAGE * (b + 1) - 1`` of each particle. Page 0 is empty, belongs to everybody, and is never
    written.

    Parameters
    ----------
    n_particles : int

    Attributes
    ----------
    table : ndarray of int32, shape (M, blocks)
    pages : ndarray, shape (capacity, PAGE, FIELDS)
    """

    def __init__(self, n_particles: int) -> None:
        self.table: NDArray[np.int32] = np.zeros((n_particles, 0), np.int32)
        self.pages = np.empty((1, PAGE, FIELDS))
        self.pages[0] = [0.0] * (FIELDS - 1) + [ABSENT]
        self._owners = np.zeros(1, np.int64)
        self._free: Indices = np.zeros(0, np.intp)

    @property
    def n_columns(self) -> int:
        """Columns that the index table has room for."""
        return int(self.table.shape[1]) * PAGE

    @property
    def pages_in_use(self) -> int:
        """Different pages that the particles own together."""
        return len(np.unique(self.table[self.table > 0]))

    def grow(self, columns: int) -> None:
        """Make room for at least so many columns; nothing is stored yet."""
        missing = -(-columns // PAGE) - self.table.shape[1]
        if missing > 0:
            more = np.zeros((len(self.table), missing), np.int32)
            self.table = np.concatenate([self.table, more], 1)

    def read(self, columns: Indices) -> Array:
        """Return columns (M, k), some for each particle, shape (FIELDS, M, k)."""
        found = self.pages.reshape(-1, FIELDS).take(self._places(None, columns), axis=0)
        return np.ascontiguousarray(np.moveaxis(found, -1, 0))

    def read_blocks(self, first: int, last: int | None) -> Array:
        """Return all columns of blocks ``first:last``, shape (FIELDS, M, columns)."""
        found = self.pages[self.table[:, first:last]].reshape(len(self.table), -1, FIELDS)
        return np.ascontiguousarray(np.moveaxis(found, -1, 0))

    def free_columns(self, count: int) -> Indices:
        """Return the first `count` columns (M, count) of each particle without a landmark."""
        absent = (self.pages[:, :, -1] == ABSENT)[self.table].reshape(len(self.table), -1)
        absent = np.pad(absent, ((0, 0), (0, count)), constant_values=True)
        row, column = np.nonzero(absent)
        start = np.searchsorted(row, np.arange(len(self.table)))
        return column[start[:, None] + np.arange(count)]

    def map_of(self, particle: int) -> Array:
        """Return the whole map of one particle, shape (n_columns, FIELDS)."""
        return self.pages[self.table[particle]].reshape(-1, FIELDS)

    def write(self, particles: Indices, columns: Indices, values: Array) -> None:
        """Store values (L, FIELDS) in columns (L,) of particles (L,)."""
        self.grow(int(columns.max(initial=-1)) + 1)
        self._own(particles, columns // PAGE)
        self.pages.reshape(-1, FIELDS)[self._places(particles, columns)] = values

    def resample(self, chosen: Indices) -> None:
        """Replace particle i by a copy of particle ``chosen[i]``: only the index table moves."""
        self.table = self.table[chosen]
        self._owners = np.bincount(self.table.ravel(), minlength=len(self.pages))
        self._free = np.flatnonzero(self._owners[1:] == 0) + 1

    def _places(self, particles: Indices | None, columns: Indices) -> Indices:
        """Rows of the landmarks in all pages; `particles` None: a row of columns for each."""
        block, place = np.divmod(columns, PAGE)
        if particles is None:
            particles = np.arange(len(self.table))[:, None]
        return self.table.take(particles * self.table.shape[1] + block) * np.intp(PAGE) + place

    def _own(self, particles: Indices, blocks: Indices) -> None:
        """Give each of these particles pages of its own: copy what it still shares."""
        used = np.zeros(self.table.shape[1], bool)
        used[blocks] = True
        place = np.cumsum(used) - 1
        touched = np.zeros((len(self.table), place[-1] + 1), bool)
        touched[particles, place[blocks]] = True
        row, column = np.nonzero(touched)
        block = np.flatnonzero(used)[column]
        page = self.table[row, block].astype(np.intp)
        shared = (page == 0) | (self._owners[page] > 1)
        # Where all owners of a page write, one of them keeps the original.
        found, first, writers = np.unique(page, return_index=True, return_counts=True)
        shared[first[(writers == self._owners[found]) & (found > 0)]] = False
        row, block, page = row[shared], block[shared], page[shared]
        new = self._allocate(len(page))
        self.pages[new] = self.pages[page]
        np.subtract.at(self._owners, page, 1)
        self._owners[new] = 1
        self.table[row, block] = new

    def _allocate(self, count: int) -> Indices:
        """Take `count` pages that nobody owns, after making more of them if needed."""
        missing = count - len(self._free)
        if missing > 0:
            size = len(self.pages)
            bigger = max(size + missing, size + size // 4)
            # In place: the system moves large blocks without copying. No view outlives a call.
            self.pages.resize((bigger, PAGE, FIELDS), refcheck=False)
            self._owners = np.concatenate([self._owners, np.zeros(bigger - size, np.int64)])
            self._free = np.concatenate([self._free, np.arange(size, bigger)])
        split = len(self._free) - count
        taken, self._free = self._free[split:], self._free[:split]
        return taken
