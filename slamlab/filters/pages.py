"""Pages of numbers that many particles share until one of them writes: copy on write.

A particle that is copied must not copy its map (P2, step 3): maps lie in pages, a copy shares
them, and a page is copied when one of its owners changes it. Landmarks in chapter 12, map tiles
in 15.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import as_count

__all__ = ["SharedPages"]

Indices = NDArray[np.intp]


class SharedPages:
    """Page tables of M particles over one store of pages.

    Read through ``pages[table[...]]``. Before writing, `own` the pages. Page 0 is empty, belongs
    to everybody, and is never written.

    Parameters
    ----------
    n_particles : int
        At least 1.
    empty : array_like, shape (...)
        What a page holds that nobody has written to; its shape and type are those of all pages.

    Attributes
    ----------
    table : ndarray of int32, shape (M, slots)
        Page in each slot of each particle.
    pages : ndarray, shape (capacity, ...)

    Examples
    --------
    >>> shared = SharedPages(3, [0.0, 0.0])
    >>> shared.extend(1)
    >>> shared.pages[shared.own([0], [0])] = [5.0, 6.0]
    >>> shared.resample([0, 0, 1])                       # particle 1 is a copy of particle 0
    >>> shared.pages[shared.own([1], [0]), 1] = 9.0      # and changes what it holds
    >>> shared.pages[shared.table[:, 0]].tolist(), shared.in_use
    ([[5.0, 6.0], [5.0, 9.0], [0.0, 0.0]], 2)
    """

    def __init__(self, n_particles: int, empty: ArrayLike) -> None:
        self.table = np.zeros((as_count("n_particles", n_particles, 1), 0), np.int32)
        self.pages: NDArray = np.array([empty])
        self._owners = np.zeros(1, np.int64)
        self._free: Indices = np.zeros(0, np.intp)

    @property
    def in_use(self) -> int:
        """Different pages that the particles own together."""
        return len(np.unique(self.table[self.table > 0]))

    @property
    def nbytes(self) -> int:
        """Memory of the pages in use and of the table."""
        return self.in_use * self.pages[0].nbytes + self.table.nbytes

    def extend(self, slots: int) -> None:
        """Make room for at least so many slots; the new ones are empty."""
        if slots > self.table.shape[1]:
            self.rearrange(np.arange(self.table.shape[1]), slots)

    def rearrange(self, where: ArrayLike, slots: int) -> None:
        """Move slot i of every particle to slot ``where[i]`` of `slots`; the others are empty."""
        table = np.zeros((len(self.table), slots), np.int32)
        table[:, np.asarray(where, np.intp)] = self.table
        self.table = table

    def own(self, particles: ArrayLike, slots: ArrayLike) -> Indices:
        """Return pages that these particles may write to in these slots, shape (L,).

        Copies what they still share; a pair may come several times.
        """
        particles, slots = np.asarray(particles, np.intp), np.asarray(slots, np.intp)
        used = np.zeros(self.table.shape[1], bool)
        used[slots] = True
        place = np.cumsum(used) - 1
        touched = np.zeros((len(self.table), int(used.sum())), bool)
        touched[particles, place[slots]] = True
        row, column = np.nonzero(touched)
        slot = np.flatnonzero(used)[column]
        page = self.table[row, slot].astype(np.intp)
        shared = (page == 0) | (self._owners[page] > 1)
        if not shared.any():
            return self.table[particles, slots].astype(np.intp)
        # Where all owners of a page write, one of them keeps the original.
        found, first, writers = np.unique(page, return_index=True, return_counts=True)
        shared[first[(writers == self._owners[found]) & (found > 0)]] = False
        row, slot, page = row[shared], slot[shared], page[shared]
        new = self._allocate(len(page))
        self.pages[new] = self.pages[page]
        np.subtract.at(self._owners, page, 1)
        self._owners[new] = 1
        self.table[row, slot] = new
        return self.table[particles, slots].astype(np.intp)

    def resample(self, chosen: ArrayLike) -> None:
        """Replace particle i by a copy of particle ``chosen[i]``: only rows of the table move."""
        self.table = self.table[np.asarray(chosen, np.intp)]
        self._owners = np.bincount(self.table.ravel(), minlength=len(self.pages))
        self._free = np.flatnonzero(self._owners[1:] == 0) + 1

    def _allocate(self, count: int) -> Indices:
        """Take `count` pages that nobody owns, after making more of them if needed."""
        missing = count - len(self._free)
        if missing > 0:
            size = len(self.pages)
            bigger = max(size + missing, size + size // 4)
            # In place: the system moves large blocks without copying. No view outlives a call.
            self.pages.resize((bigger, *self.pages.shape[1:]), refcheck=False)
            self._owners = np.concatenate([self._owners, np.zeros(bigger - size, np.int64)])
            self._free = np.concatenate([self._free, np.arange(size, bigger)])
        split = len(self._free) - count
        taken, self._free = self._free[split:], self._free[:split]
        return taken
