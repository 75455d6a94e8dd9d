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

from slamlab._checks import Array, as_array, as_choice, as_count, as_scalar, as_shaped, shown
from slamlab.grids import Grid
from slamlab.kernels.cast import cast_everywhere, cast_grid
from slamlab.kernels.clearance import grid_clearance
from slamlab.kernels.collide import hits_grid
from slamlab.worlds._image import read_map
from slamlab.worlds._world import Solid

__all__ = ["BitmapWorld"]


class BitmapWorld(Grid, Solid):
    """A room of square cells, occupied or free.

    What lies beyond the bitmap is empty for beams and forbidden for the robot: a beam that leaves
    meets nothing, and no point out there is free.

    Parameters
    ----------
    occupied : array_like of bool, shape (rows, columns)
        Row 0 is at the bottom, column 0 at the left. A point on the line between two cells
        belongs to the right or upper one.
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

    Raises
    ------
    ValueError
        If there is no cell, an entry is neither 0 nor 1, or a number is out of range.

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
        out = np.empty(len(flat))
        grid_clearance(*self._nearest_columns, flat, out)
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
            Farther than this (m) nothing is met.

        Returns
        -------
        ndarray, shape (...)
            In metres; inf where a beam met nothing.

        Raises
        ------
        ValueError
            If a shape is wrong, a number is not finite or `max_range` is negative.
        """
        x, y, angles, reach = checked_beams(origins, angles, max_range)
        out = np.empty(angles.size)
        x = ((x - self.origin[0]) / self.resolution).ravel()
        y = ((y - self.origin[1]) / self.resolution).ravel()
        cast_grid(self._skip, x, y, angles.ravel(), (reach / self.resolution).ravel(), out)
        return out.reshape(angles.shape) * self.resolution

    def cast_everywhere(
        self, angles: ArrayLike, max_range: float = np.inf, stride: int = 1
    ) -> Array:
        """Cast the same directions from the centres of all cells: the answers of `cast`, faster.

        Parameters
        ----------
        angles : array_like, shape (n_angles,)
            Directions in the world (rad).
        max_range : float, default inf
            Farther than this (m) nothing is met.
        stride : int, default 1
            Take every `stride`-th row and column, from 0 on.

        Returns
        -------
        ndarray, shape (n_angles, rows, columns)
            Distances (m) from ``centres(stride)``; 0 in occupied cells, inf where nothing is met.

        Raises
        ------
        ValueError
            If an argument is out of range.
        """
        angles = as_array("angles", angles, ("n_angles",))
        reach = as_scalar("max_range", max_range, 0.0) / self.resolution
        stride = as_count("stride", stride, 1)
        rows, columns = (-(-n // stride) for n in self.occupied.shape)
        out = np.empty((len(angles), rows, columns))
        for sheet, angle in zip(out, angles, strict=True):
            cast_everywhere(self._skip, angle, reach, stride, sheet)
        out *= self.resolution
        return out

    def _hits(self, footprint: Array, start: Array, end: Array) -> NDArray[np.bool_]:
        out = np.empty(len(start), dtype=np.bool_)
        left, bottom = self.origin
        hits_grid(self.occupied, self.resolution, left, bottom, footprint, start, end, out)
        return out

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
