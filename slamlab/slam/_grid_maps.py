"""Where the grid maps of many particles are kept: tiles shared until written, copies, or a tree.

Three answers to one question, equal cell for cell: what does the copy of a particle cost? Used by
grid FastSLAM and Gamma-SLAM (chapter 15); the tree is DP-SLAM's (Eliazar and Parr 2003).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_count, as_rng, as_scalar
from slamlab.filters.pages import SharedPages
from slamlab.filters.particle import ParticleFilter, PoseParticles
from slamlab.models import MotionModel, as_motion

__all__ = ["TILE", "AncestryTree", "MapParticles", "TileMaps", "cells_at", "place"]

TILE = 16
# What is kept of a cell: hits, metres that beams travelled in it, sums of the end points in it.
EMPTY = np.zeros((TILE, TILE, 4), np.float32)

Pages: TypeAlias = NDArray[np.float32]
Table: TypeAlias = NDArray[np.int32]
Cells: TypeAlias = NDArray[np.intp]


def place(cells: Cells, columns: int) -> tuple[Cells, Cells, Cells]:
    """Slot of the tile of cells (..., 2: column, row), `columns` tiles a row; row and column."""
    tile, inside = np.divmod(cells, TILE)
    return tile[..., 1] * columns + tile[..., 0], inside[..., 1], inside[..., 0]


def cells_at(pages: Pages, tiles: Table, columns: int, cells: Cells) -> Pages:
    """Return what a map keeps (..., channels) of cells (..., 2: column, row); beyond it nothing.

    `tiles` (slots,) names the page of each of its tiles.
    """
    slot, row, column = place(cells, columns)
    there = (cells >= 0).all(-1) & (cells[..., 0] < columns * TILE) & (slot < len(tiles))
    page = np.where(there, tiles[np.where(there, slot, 0)], 0)  # page 0 is empty
    return pages[page, row, column]


class TileMaps:
    """Maps of M particles on one growing floor of tiles; tile (0, 0) begins at `origin`.

    Parameters
    ----------
    n_particles : int
    resolution : float
        Side of a cell (m).
    origin : ndarray, shape (2,)
    share : bool
        Whether copies share tiles until one of them writes, or each gets its own at once.
    channels : int
        Numbers kept of a cell.
    """

    def __init__(
        self,
        n_particles: int,
        resolution: float,
        origin: Array,
        share: bool = True,
        channels: int = EMPTY.shape[-1],
    ) -> None:
        self.resolution, self.origin, self.share = resolution, origin, share
        self.shared = SharedPages(n_particles, np.zeros((TILE, TILE, channels), np.float32))
        self.low, self.size = np.zeros(2, int), np.zeros(2, int)  # column, row; in tiles

    @property
    def columns(self) -> int:
        """Tiles in a row of the floor."""
        return int(self.size[0])

    @property
    def frame(self) -> Array:
        """Resolution and corner of the floor (m)."""
        return np.array([self.resolution, *(self.origin + self.low * TILE * self.resolution)])

    @property
    def nbytes(self) -> int:
        """Memory of all maps together."""
        return self.shared.nbytes

    def make_room(self, points: Array) -> None:
        """Let the floor reach to points (k, 2), in the world (m), and a cell beyond."""
        side = TILE * self.resolution
        first = np.floor((points.min(0) - self.origin - self.resolution) / side).astype(int)
        last = np.floor((points.max(0) - self.origin + self.resolution) / side).astype(int)
        if self.size.any():
            first = np.minimum(first, self.low)
            last = np.maximum(last, self.low + self.size - 1)
        size = last + 1 - first
        if (size == self.size).all():
            return
        row, column = np.divmod(np.arange(self.size.prod()), max(self.columns, 1))
        column, row = column + self.low[0] - first[0], row + self.low[1] - first[1]
        self._move(row * size[0] + column, int(size.prod()))
        self.low, self.size = first, size

    def _move(self, where: NDArray[np.intp], slots: int) -> None:
        self.shared.rearrange(where, slots)

    def read(self) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Pages and table to look things up in."""
        return self.shared.pages, self.shared.table

    def write(self, tiles: NDArray[np.bool_]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Pages and table to write to, in these tiles (M, slots) of each particle only."""
        self.shared.own(*np.nonzero(tiles))
        return self.shared.pages, self.shared.table

    def written(self) -> None:
        """Take in what was written."""

    def values(self, particles: NDArray[np.intp], cells: NDArray[np.intp]) -> Array:
        """Return what particles (L,) keep of cells (L, 2: column, row), (L, channels)."""
        tile, row, column = place(cells, self.columns)
        pages, table = self.read()
        return pages[table[particles, tile], row, column].astype(float)

    def add(self, particles: NDArray[np.intp], cells: NDArray[np.intp], values: Array) -> None:
        """Add values (L, channels) to cells (L, 2: column, row) of particles (L,), each once."""
        tile, row, column = place(cells, self.columns)
        page = self.shared.own(particles, tile)
        self.shared.pages[page, row, column] += values

    def resample(self, chosen: NDArray[np.intp]) -> None:
        """Replace particle i by a copy of particle ``chosen[i]``."""
        self.shared.resample(chosen)
        if not self.share:
            self.shared.own(*np.nonzero(self.shared.table))

    def dense(self, particle: int) -> NDArray[np.float32]:
        """Whole map of one particle, shape (rows, columns, channels)."""
        pages, table = self.read()
        columns, rows = self.size
        channels = pages.shape[-1]  # told, for before the first scan there is no tile
        tiles = pages[table[particle]].reshape(rows, columns, TILE, TILE, channels)
        return tiles.swapaxes(1, 2).reshape(rows * TILE, columns * TILE, channels)


class MapParticles(PoseParticles):
    """Particles that move by a motion model, see by ranges and keep a map each: `_maps`."""

    measures = "scan"
    _maps: TileMaps

    def __init__(
        self,
        motion: MotionModel,
        pose: ArrayLike,
        n_particles: int,
        rng: np.random.Generator,
        temper: float,
        threshold: float,
    ) -> None:
        self.motion, pose = as_motion("motion", motion), as_array("pose", pose, (3,))
        M = as_count("n_particles", n_particles, 1)
        self._temper = as_scalar("temper", temper, 1e-9, 1e9)
        self._cloud = ParticleFilter(np.tile(pose, (M, 1)), as_rng("rng", rng), None, threshold)

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move every particle by its own draw from the motion model: control u (p,), dt (s)."""
        self._cloud.predict(lambda poses, rng: self.motion.sample(poses, u, dt, control_cov, rng))

    def _weighed_by(self, log_likelihood: Array) -> float:
        """Weigh, and resample particles with their maps if the weights say so."""
        evidence = self._cloud.update(self._temper * log_likelihood)
        if self.resampled:
            self._maps.resample(self._cloud.ancestors)
        return evidence

    @property
    def map_bytes(self) -> int:
        """Memory of all maps together."""
        return self._maps.nbytes

    def _row(self, particle: int | None) -> int:
        """Row of `poses`: the heaviest particle's if none is named."""
        if particle is None:
            return int(self._cloud.log_weights.argmax())
        return as_count("particle", particle, 0, self.n_particles - 1)

    def _contents(self) -> str:
        return f"{self.map_bytes / 1e6:.1f} MB of maps, "


@dataclass
class _Node:
    """What one ancestor saw: cells of tiles as (mask, values); and how many children it has."""

    parent: int
    children: int = 0
    tiles: dict[int, tuple[NDArray[np.bool_], NDArray[np.float32]]] = field(default_factory=dict)


class AncestryTree(TileMaps):
    """DP-SLAM's one map for all: a node for each ancestor, with the cells that it changed.

    A cell of a particle is looked up in its own node, then in its parent's, and so on. A node
    without children is cut off, a node with one child is merged with it: M particles have at most
    2 M - 1 nodes.
    """

    def __init__(self, n_particles: int, resolution: float, origin: Array) -> None:
        super().__init__(n_particles, resolution, origin)
        self.nodes = {0: _Node(-1, n_particles)}
        self.nodes.update({i + 1: _Node(0) for i in range(n_particles)})
        self.leaves = np.arange(1, n_particles + 1)
        self._next = n_particles + 1
        self._open: tuple[NDArray[np.bool_], Pages, Pages, Table] | None = None

    @property
    def n_cells(self) -> int:
        """Cells stored in all nodes."""
        return sum(int(m.sum()) for node in self.nodes.values() for m, _ in node.tiles.values())

    @property
    def nbytes(self) -> int:
        """Memory of the cells and of their numbers."""
        return self.n_cells * (EMPTY[0, 0].nbytes + 4)

    def _move(self, where: NDArray[np.intp], slots: int) -> None:
        for node in self.nodes.values():
            node.tiles = {int(where[slot]): entry for slot, entry in node.tiles.items()}

    def line(self, particle: int) -> list[_Node]:
        """Nodes from the leaf of a particle to the root."""
        found, number = [], int(self.leaves[particle])
        while number >= 0:
            found.append(self.nodes[number])
            number = found[-1].parent
        return found

    def read(self) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Pages and table put together for this moment: the root's cells, then what changed."""
        table = np.zeros((len(self.leaves), int(self.size.prod())), np.int32)
        pages = [EMPTY]
        for i in range(len(self.leaves)):
            for node in reversed(self.line(i)):
                for slot, (mask, values) in node.tiles.items():
                    if table[i, slot] == 0:
                        table[i, slot] = len(pages)
                        pages.append(EMPTY.copy())
                    np.copyto(pages[table[i, slot]], values, where=mask[..., None])
        return np.array(pages), table

    def write(self, tiles: NDArray[np.bool_]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Pages and table to write to; `written` finds out what has changed."""
        pages, table = self.read()
        fresh = tiles & (table == 0)
        table[fresh] = len(pages) + np.arange(fresh.sum())
        pages = np.concatenate([pages, np.tile(EMPTY, (int(fresh.sum()), 1, 1, 1))])
        self._open = tiles, pages, pages.copy(), table
        return pages, table

    def written(self) -> None:
        """Give each leaf the cells that have changed: what it inherits, and what it saw."""
        assert self._open is not None
        tiles, pages, before, table = self._open
        changed = (pages != before).any(-1)
        for i, slot in zip(*np.nonzero(tiles), strict=True):
            page, node = table[i, slot], self.nodes[int(self.leaves[i])]
            if changed[page].any():
                mask, _ = node.tiles.get(int(slot), (False, None))
                node.tiles[int(slot)] = (changed[page] | mask, pages[page].copy())
        self._open = None

    def resample(self, chosen: NDArray[np.intp]) -> None:
        """Give each survivor a child for every copy; cut off and merge what is left over."""
        parents = self.leaves[chosen]
        dead = set(self.leaves.tolist()) - set(parents.tolist())
        self.leaves = np.arange(self._next, self._next + len(chosen))
        self._next += len(chosen)
        for leaf, parent in zip(self.leaves.tolist(), parents.tolist(), strict=True):
            self.nodes[leaf] = _Node(parent)
            self.nodes[parent].children += 1
        for number in dead:
            self._cut(number)
        for leaf in self.leaves.tolist():
            self._merge(leaf)

    def _cut(self, number: int) -> None:
        """Remove a node without children, and its parent if that has none then."""
        while number >= 0 and self.nodes[number].children == 0:
            parent = self.nodes.pop(number).parent
            if parent >= 0:
                self.nodes[parent].children -= 1
            number = parent

    def _merge(self, number: int) -> None:
        """Pour every ancestor that has one child only into that child, whose cells win."""
        while number >= 0:
            node = self.nodes[number]
            while node.parent >= 0 and self.nodes[node.parent].children == 1:
                above = self.nodes.pop(node.parent)
                for slot, (mask, values) in above.tiles.items():
                    if slot in node.tiles:
                        own, mine = node.tiles[slot]
                        node.tiles[slot] = own | mask, np.where(own[..., None], mine, values)
                    else:
                        node.tiles[slot] = mask, values
                node.parent = above.parent
            number = node.parent
