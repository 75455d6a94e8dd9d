"""A world drawn in pixels, as the rooms of P5: occupied cells are square and solid.

Beams are exact on the grid: a beam stops at the border of the first occupied cell it enters, and
never slips between two cells that touch at a corner. Chapters 06, 08, 18 and 19.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from slamlab._checks import Array, as_array, as_choice, as_scalar, as_shaped, shown
from slamlab.grids import Grid
from slamlab.kernels import compiled
from slamlab.worlds._image import read_map
from slamlab.worlds._world import Solid, sweep_meets, swept_boxes

__all__ = ["BitmapWorld"]


class BitmapWorld(Grid, Solid):
    """A room of square cells, occupied or free.

    What lies beyond the bitmap is empty for beams and forbidden for the robot: a beam that leaves
    meets nothing, and no point out there is free.

    Parameters
    ----------
    occupied : array_like of bool, shape (rows, columns)
        At least one cell; row 0 is at the bottom, column 0 at the left. A point on the line
        between two cells belongs to the right or upper one.
    resolution : float
        Side of a cell (m).
    origin : array_like, shape (2,), default (0, 0)
        Lower left corner of the bitmap in the world (m).

    Attributes
    ----------
    occupied : ndarray of bool, shape (rows, columns)
        Read-only.
    resolution : float
    origin : ndarray, shape (2,)

    Examples
    --------
    >>> world = BitmapWorld([[0, 0, 0, 1]], 1.0)
    >>> world.cast([0.5, 0.5], [0.0, np.pi]).tolist()
    [2.5, inf]
    """

    def __init__(
        self, occupied: ArrayLike, resolution: float, origin: ArrayLike = (0.0, 0.0)
    ) -> None:
        cells = as_array("occupied", occupied, ("rows", "columns"))
        if cells.size == 0 or not np.isin(cells, (0.0, 1.0)).all():
            wanted = "at least one cell, each True or False"
            raise ValueError(f"occupied: expected {wanted}, got {shown(occupied)}")
        self.occupied: NDArray[np.bool_] = cells.astype(bool)
        self.occupied.setflags(write=False)
        super().__init__((cells.shape[0], cells.shape[1]), resolution, origin)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle by what it is made of: its arrays stay read-only."""
        return type(self), (self.occupied, self.resolution, self.origin)

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        resolution: float | None = None,
        origin: ArrayLike | None = None,
        *,
        threshold: float = 0.5,
        unknown: str = "occupied",
    ) -> BitmapWorld:
        """Read an image (BMP, PNG, PGM and whatever Pillow knows) or a map of ROS (YAML).

        In an image a pixel darker than `threshold` is occupied. A YAML file is what ROS'
        `map_server` writes: `image`, `resolution`, `origin`, `negate`, `occupied_thresh`,
        `free_thresh`; cells between the thresholds are unknown and count as occupied, for a robot
        must not go there, unless `unknown` says "free".

        Parameters
        ----------
        path : str or Path
        resolution : float, optional
            Side of a pixel (m). Needed for an image; a YAML file brings its own.
        origin : array_like, shape (2,), optional
            Lower left corner in the world (m), by default (0, 0) or the one in the YAML file.
        threshold : float, default 0.5
            Of an image: part of white. A room drawn in light colours needs a higher one.
        unknown : {"occupied", "free"}
            Of a map of ROS: what cells are that nothing was seen of.

        Raises
        ------
        ValueError
            If the file is no readable image or map, is an image without a dark pixel, is larger
            than 64 million pixels, or misses an entry; the message names the file.
        FileNotFoundError
            If there is no such file.
        """
        unknown = as_choice("unknown", unknown, ("occupied", "free"))
        image = read_map(Path(path), threshold, unknown == "occupied")
        resolution = image.resolution if resolution is None else resolution
        if resolution is None:
            raise ValueError(f"resolution: expected the side of a pixel of {path}, got None")
        return cls(image.occupied, resolution, image.origin if origin is None else origin)

    def is_free(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Tell which points lie in a free cell; no point beyond the bitmap does.

        Parameters
        ----------
        points : array_like, shape (..., 2)
            In the world (m).

        Returns
        -------
        ndarray of bool, shape (...)
        """
        cells, (rows, columns) = self.cells(points), self.shape
        row, column = cells[..., 0], cells[..., 1]
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.asarray(inside & ~self.occupied[row * inside, column * inside])

    def clearance(self, points: ArrayLike) -> Array:
        """Distance from points to the nearest occupied cell, exact.

        Parameters
        ----------
        points : array_like, shape (..., 2)
            In the world (m).

        Returns
        -------
        ndarray, shape (...)
            In metres; 0 in an occupied cell and beyond the bitmap, inf if no cell is occupied.
        """
        points = as_array("points", points, ("...", 2))
        flat = np.ascontiguousarray(self.scaled(points).reshape(-1, 2))
        out = grid_clearance(*self._nearest_columns, flat)
        return out.reshape(points.shape[:-1]) * self.resolution

    def cast(self, origins: ArrayLike, angles: ArrayLike, max_range: float = np.inf) -> Array:
        """Distances at which beams meet an occupied cell.

        Parameters
        ----------
        origins : array_like, shape (..., 2)
            Where beams start (m). From inside an occupied cell the distance is 0.
        angles : array_like, shape (...)
            Directions in the world (rad); leading axes broadcast with `origins`.
        max_range : float or array_like, shape (...), default inf
            Farther than this (m, not negative) nothing is met.

        Returns
        -------
        ndarray, shape (...)
            In metres; inf where a beam met nothing.
        """
        x, y, angles, reach = checked_beams(origins, angles, max_range)
        x = ((x - self.origin[0]) / self.resolution).ravel()
        y = ((y - self.origin[1]) / self.resolution).ravel()
        out = cast_grid(self._skip, x, y, angles.ravel(), (reach / self.resolution).ravel())
        return out.reshape(angles.shape) * self.resolution

    def cast_everywhere(
        self, angles: ArrayLike, max_range: float = np.inf, stride: int = 1
    ) -> Array:
        """Cast the same directions from the centres of all cells.

        Parameters
        ----------
        angles : array_like, shape (n_angles,)
            Directions in the world (rad).
        max_range : float, default inf
            Farther than this (m, not negative) nothing is met.
        stride : int, default 1
            Take every `stride`-th row and column, from 0 on.

        Returns
        -------
        ndarray, shape (n_angles, rows, columns)
            Distances (m) from ``centres(stride)``; 0 in occupied cells, inf where nothing is met.
        """
        angles = as_array("angles", angles, ("n_angles",))
        max_range, centres = as_scalar("max_range", max_range, 0.0), self.centres(stride)
        out = np.empty((len(angles), *centres.shape[:-1]))
        for ranges, angle in zip(out, angles, strict=True):
            ranges[:] = self.cast(centres, angle, max_range)
        return out

    def _hits(self, footprint: Array, start: Array, end: Array) -> NDArray[np.bool_]:
        left, bottom = self.origin
        return hits_grid(self.occupied, self.resolution, left, bottom, footprint, start, end)

    @cached_property
    def _skip(self) -> NDArray[np.uint16]:
        """Chessboard distance (cells) to the nearest occupied cell, 0 in one."""
        if not self.occupied.any():
            return np.full(self.occupied.shape, min(max(self.occupied.shape), 65535), np.uint16)
        distance = ndimage.distance_transform_cdt(~self.occupied, "chessboard")
        # Two bytes a cell stay in the cache; a shorter jump is as right as a long one.
        return np.minimum(distance, 65535).astype(np.uint16)

    @cached_property
    def _nearest_columns(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Occupied column at or before, and at or after, each cell of its row; far if none."""
        columns, far = np.arange(self.occupied.shape[1], dtype=np.int32), np.int32(10**9)
        before = np.maximum.accumulate(np.where(self.occupied, columns, -far), axis=1)
        after = np.where(self.occupied, columns, far)[:, ::-1]
        after = np.minimum.accumulate(after, axis=1)[:, ::-1]
        return before, np.ascontiguousarray(after)


def checked_beams(
    origins: ArrayLike, angles: ArrayLike, max_range: ArrayLike
) -> tuple[Array, Array, Array, Array]:
    """Coordinates, directions and reach of beams, broadcast."""
    origins = as_array("origins", origins, ("...", 2))
    angles = as_array("angles", angles)
    reach = as_shaped("max_range", max_range)
    if not (reach >= 0).all():
        raise ValueError(f"max_range: expected at least 0, got {np.min(reach):g}")
    shape = np.broadcast_shapes(origins.shape[:-1], angles.shape, reach.shape)
    beams = np.empty((4, *shape))
    beams[0], beams[1], beams[2], beams[3] = origins[..., 0], origins[..., 1], angles, reach
    return beams[0], beams[1], beams[2], beams[3]


# A jump ends this far (cells) short of its safe square, which is far more than any rounding; a
# beam that passes a corner at this distance or less goes through it: blocked if the cells on both
# sides are occupied, free otherwise.
_TOUCH = 1e-9
# Directions this close to an axis run along it: the cosine of a quarter turn is 6e-17, not 0.
_AXIS = 1e-12
# From farther away than a billion cells rounding would choose the cell.
_FAR = 1e9


@compiled("cast.cast_grid")
def cast_grid(
    skip: NDArray[np.uint16], x: Array, y: Array, angles: Array, max_range: Array
) -> Array:
    """Ranges (cells) of beams (n,) through a grid; infinite where a beam met nothing.

    `skip` (rows, columns) is the chessboard distance to the nearest occupied cell, 0 in one. All
    beams go on together, from grid line to grid line (Amanatides and Woo 1987), or by a jump.
    """
    size, out = np.array(skip.shape[::-1]), np.full(len(x), np.inf)
    start, way = np.stack([x, y], -1), np.stack([np.cos(angles), np.sin(angles)], -1)
    way[np.abs(way) <= _AXIS] = 0.0
    step, t = np.where(way > 0, 1, -1), _entry(start, way, size)
    i = np.flatnonzero(t <= np.minimum(max_range, _FAR))  # the beams that go on
    t = t[i]
    cell = np.floor(start[i] + t[:, None] * way[i]).astype(int)
    cell = np.where((t > 0.0)[:, None] | (cell == size), cell.clip(0, size - 1), cell)
    while len(i):
        free = skip[cell[:, 1], cell[:, 0]].astype(int)
        out[i[free == 0]] = t[free == 0]
        # How far it is to the grid lines ahead: the far sides of this cell.
        with np.errstate(divide="ignore", invalid="ignore"):
            lines = (cell + (way[i] > 0) - start[i]) / way[i]
        lines[way[i] == 0] = np.inf
        corner = np.abs(lines[:, 0] - lines[:, 1]) <= _TOUCH
        across = corner[:, None] | (lines == lines.min(1, keepdims=True))
        # All cells nearer than `free` are empty: nothing can be met on the way.
        jump = t + (free - 1) / np.abs(way[i]).max(1) - _TOUCH
        far = cell + across * step[i]
        shut = (free == 1) & corner & _corner_is_shut(skip, cell, far)
        out[i[shut]] = np.where(lines[shut, 0] <= max_range[i[shut]], lines[shut, 0], np.inf)
        # A start on a grid line may cross it late, after a jump: never step back.
        ahead = np.maximum(t, np.where(corner, lines.max(1), lines.min(1)))
        t = np.where(free > 1, jump, ahead)
        landed = np.floor(start[i] + t[:, None] * way[i])
        cell = np.where((free > 1)[:, None], landed, far).astype(int)
        on = (free > 0) & ~shut & (t <= max_range[i]) & ((cell >= 0) & (cell < size)).all(1)
        i, t, cell = i[on], t[on], cell[on]
    return out


def _entry(start: Array, way: Array, size: NDArray[np.int_]) -> Array:
    """Distance at which beams enter the grid: 0 if they start there, inf if they pass by."""
    inside = (start >= 0) & (start < size)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([-start / way, (size - start) / way])
    # Along an axis a beam is always between its two lines, or never.
    near = np.where(way == 0, np.where(inside, -np.inf, np.inf), ends.min(0)).max(1).clip(0.0)
    far = np.where(way == 0, np.inf, ends.max(0)).min(1)
    met = near < np.minimum(far, _FAR)
    return np.where(inside.all(1), 0.0, np.where(met, near, np.inf))


def _corner_is_shut(
    skip: NDArray[np.uint16], cell: NDArray[np.int_], far: NDArray[np.int_]
) -> NDArray[np.bool_]:
    """Tell whether both cells beside the corner between `cell` and `far` are occupied, (n,)."""
    there = np.asarray(((far >= 0) & (far < skip.shape[::-1])).all(1))
    far = np.where(there[:, None], far, cell)
    return there & (skip[cell[:, 1], far[:, 0]] == 0) & (skip[far[:, 1], cell[:, 0]] == 0)


@compiled("clearance.grid_clearance")
def grid_clearance(before: NDArray[np.int32], after: NDArray[np.int32], points: Array) -> Array:
    """Distance (cells) of points (n, 2: x, y in cells) to the nearest occupied square.

    In each row only the nearest occupied column on either side can matter; rows farther away than
    the best distance so far need no look.
    """
    rows, columns = before.shape
    inside = ((points >= 0) & (points < (columns, rows))).all(1)
    best = np.where(inside, np.inf, 0.0)
    for k in range(rows):
        i = np.flatnonzero(best > np.maximum(k - 1, 0) ** 2)
        if not len(i):
            break
        x, y = points[i].T
        c, r = points[i].T.astype(int)
        for row, dy in ((r - k, y - (r - k + 1)), (r + k, r + k - y)):
            there = np.clip(row, 0, rows - 1)
            dx = np.minimum(x - (before[there, c] + 1), after[there, c] - x).clip(0.0)
            squared = np.where((there == row) & (dx < 1e8), dx**2 + dy.clip(0.0) ** 2, np.inf)
            best[i] = np.minimum(best[i], squared)
    return np.sqrt(best)


@compiled("collide.hits_grid")
def hits_grid(
    solid: NDArray[np.bool_],
    resolution: float,
    left: float,
    bottom: float,
    footprint: Array,
    starts: Array,
    ends: Array,
) -> NDArray[np.bool_]:
    """Tell for each motion (n, 3) whether it sweeps over a solid cell or leaves the grid."""
    a, b, turn, low, high = swept_boxes(footprint, starts, ends)
    size, origin = np.array(solid.shape[::-1]), np.array([left, bottom])
    far = origin + resolution * size
    out = np.asarray(((high <= origin) | (low >= far)).any(1))
    square = resolution * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    for i in np.flatnonzero(~out):
        first, last = ((ends - origin) // resolution for ends in (low[i], high[i]))
        x, y = (np.arange(u, v + 1, dtype=int) for u, v in zip(first, last, strict=True))
        cells = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        within = np.asarray(((cells >= 0) & (cells < size)).all(1))
        column, row = np.where(within[:, None], cells, 0).T
        near = (origin + resolution * cells[~within | solid[row, column]])[:, None] + square
        out[i] = len(near) > 0 and sweep_meets(a[i], b[i], starts[i, :2], turn[i], near)
    return out
