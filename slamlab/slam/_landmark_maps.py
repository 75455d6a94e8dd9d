"""Landmark maps of many particles, in pages that copies share until they differ.

Used by FastSLAM (chapter 12): what is kept of a landmark, where, and what all particles together
say of it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array
from slamlab.filters.pages import SharedPages

__all__ = ["ABSENT", "FIELDS", "PAGE", "LandmarkMaps", "moments", "unpacked"]

Indices = NDArray[np.intp]

PAGE = 64
# What is kept of a landmark: mean (x, y), covariance (xx, xy, yy), log odds that it exists.
FIELDS = 6
ABSENT = -np.inf
EMPTY = np.tile([0.0] * (FIELDS - 1) + [ABSENT], (PAGE, 1))
BLOCKS = 16  # pages of each particle that are read together
FAR_AWAY = 1e6


class LandmarkMaps:
    """Maps of M particles; landmark c of a particle lies in column c of its map."""

    def __init__(self, n_particles: int) -> None:
        self.shared = SharedPages(n_particles, EMPTY)

    @property
    def n_columns(self) -> int:
        """Columns that there is room for."""
        return int(self.shared.table.shape[1]) * PAGE

    def read(self, columns: Indices, poses: Array) -> tuple[Array, Array, Array]:
        """Return landmarks in columns (M, k) as `unpacked` does; below 0 a column holds none."""
        self.shared.extend(int(columns.max(initial=-1)) // PAGE + 1)
        block, place = np.divmod(np.maximum(columns, 0), PAGE)
        pages = np.take_along_axis(self.shared.table, block, 1)
        rows = self.shared.pages.reshape(-1, FIELDS)
        fields = np.moveaxis(rows.take(pages * np.intp(PAGE) + place, axis=0), -1, 0)
        fields[5, columns < 0] = ABSENT
        return unpacked(fields, poses)

    def blocks(self) -> Iterator[tuple[int, Array]]:
        """Go over all columns: the first of each block, and its fields (FIELDS, M, columns)."""
        table = self.shared.table
        for first in range(0, table.shape[1], BLOCKS):
            pages = self.shared.pages[table[:, first : first + BLOCKS]]
            fields = np.moveaxis(pages.reshape(len(table), -1, FIELDS), -1, 0)
            yield first * PAGE, np.ascontiguousarray(fields)

    def map_of(self, particle: int) -> Array:
        """Return the whole map of one particle, shape (n_columns, FIELDS)."""
        return self.shared.pages[self.shared.table[particle]].reshape(-1, FIELDS)

    def present(self, particle: int) -> Indices:
        """Columns of one particle that hold a landmark."""
        return np.flatnonzero(self.map_of(particle)[:, -1] > ABSENT)

    def free_columns(self, count: int) -> Indices:
        """Return the first `count` columns (M, count) of each particle without a landmark."""
        table = self.shared.table
        absent = (self.shared.pages[:, :, -1] == ABSENT)[table].reshape(len(table), -1)
        absent = np.pad(absent, ((0, 0), (0, count)), constant_values=True)
        row, column = np.nonzero(absent)
        start = np.searchsorted(row, np.arange(len(table)))
        return column[start[:, None] + np.arange(count)]

    def write(self, columns: Indices, means: Array, covs: Array, log_odds: Array) -> None:
        """Store landmarks (M, k) in columns (M, k) of each particle; not where a column is < 0."""
        particles, k = np.nonzero(columns >= 0)
        column = columns[particles, k]
        self.shared.extend(int(column.max(initial=-1)) // PAGE + 1)
        pages = self.shared.own(particles, column // PAGE)
        x, y = means[particles, k].T
        (xx, xy), (_, yy) = covs[particles, k].transpose(1, 2, 0)
        values = np.stack([x, y, xx, xy, yy, log_odds[particles, k]], -1)
        self.shared.pages[pages, column % PAGE] = values

    def estimates(self, n: int) -> tuple[Array, Array]:
        """Means (M, n, 2) and covariances (M, n, 2, 2) of the first n columns."""
        table = self.shared.table
        fields = self.shared.pages[table].reshape(len(table), -1, FIELDS)[:, :n]
        return moments(np.moveaxis(fields, -1, 0))

    def mixture(self, weights: Array, n: int) -> tuple[Array, Array]:
        """Means (n, 2) and covariances (n, 2, 2) of the first n columns over all particles."""
        blocks = [np.zeros((5, 0))]
        for _, (x, y, xx, xy, yy, _) in self.blocks():
            mean_x, mean_y = weights @ x, weights @ y
            x, y = x - mean_x, y - mean_y
            spread = xx + x * x, xy + x * y, yy + y * y
            blocks.append(np.stack([mean_x, mean_y, *(weights @ entry for entry in spread)]))
        return moments(np.concatenate(blocks, 1)[:, :n])


def unpacked(fields: Array, poses: Array) -> tuple[Array, Array, Array]:
    """Means (M, k, 2), covariances (M, k, 2, 2), log odds (M, k) of a map's fields (6, M, k).

    Where there is no landmark (log odds `ABSENT`), its mean is far from the particle's pose.
    """
    means, covs = moments(fields)
    absent = fields[5] == ABSENT
    if absent.any():
        far = poses[:, None, :2] + [FAR_AWAY, 0.0]
        means = np.where(absent[..., None], far, means)
    return means, covs, fields[5]


def moments(fields: Array) -> tuple[Array, Array]:
    """Means (..., 2) and covariances (..., 2, 2) from x, y, xx, xy, yy; more fields may follow."""
    x, y, xx, xy, yy = fields[:5]
    return np.stack([x, y], -1), np.stack([xx, xy, xy, yy], -1).reshape(*x.shape, 2, 2)
