"""One frame for every grid: square cells in rows and columns over a piece of the plane.

A world in pixels, an occupancy map and the floor that a robot has seen are such grids; so they
agree on which cell a point lies in, where its centre is and how a grid grows. Chapters 06 to 20.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_count, as_scalar, as_shaped, as_tuple, shown

__all__ = ["Grid"]

MOST_CELLS = 64_000_000  # half a gigabyte of floats


class Grid:
    """Rows and columns of square cells; row 0 is at the bottom, column 0 at the left.

    A point on the line between two cells belongs to the right or upper one.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns, at least 1.
    resolution : float
        Side of a cell (m), positive.
    origin : array_like, shape (2,), default (0, 0)
        Lower left corner in the world (m).

    Attributes
    ----------
    shape : (int, int)
    resolution : float
    origin : ndarray, shape (2,)
        Read-only.

    Examples
    --------
    >>> grid = Grid.over([-1, 0, 3, 1.5], 0.5)
    >>> grid, grid.cells([-0.9, 1.2]).tolist()
    (Grid(3 x 8 cells of 0.5 m), [2, 0])
    """

    def __init__(
        self, shape: tuple[int, int], resolution: float, origin: ArrayLike = (0.0, 0.0)
    ) -> None:
        sides = tuple(as_count("shape", n, 1) for n in as_tuple("shape", shape))
        if len(sides) != 2:
            raise ValueError(f"shape: expected rows and columns, got {len(sides)} numbers")
        self.shape = sides[0], sides[1]
        self.resolution = as_scalar("resolution", resolution, 1e-9, 1e9)
        self._move_to(as_array("origin", origin, (2,)))

    @staticmethod
    def over(bounds: ArrayLike, resolution: float) -> Grid:
        """Cover a rectangle with whole cells, the first at its lower left corner.

        Parameters
        ----------
        bounds : array_like, shape (4,)
            Left, bottom, right, top (m), left < right and bottom < top.
        resolution : float
            Side of a cell (m), positive.

        Raises
        ------
        ValueError
            If there would be more than 64 million cells.
        """
        left, bottom, right, top = as_array("bounds", bounds, (4,))
        resolution = as_scalar("resolution", resolution, 1e-9, 1e9)
        if not (left < right and bottom < top):
            raise ValueError(f"bounds: expected left < right and bottom < top, got {bounds!r}")
        with np.errstate(over="ignore"):
            rows, columns = np.ceil(np.array([top - bottom, right - left]) / resolution - 1e-9)
        if not rows * columns <= MOST_CELLS:
            wanted = f"a rectangle of at most {MOST_CELLS} cells of {resolution:g} m"
            raise ValueError(f"bounds: expected {wanted}, got {shown(bounds)}")
        return Grid((int(rows), int(columns)), resolution, (left, bottom))

    def __repr__(self) -> str:
        """Return size and resolution."""
        rows, columns = self.shape
        return f"{type(self).__name__}({rows} x {columns} cells of {self.resolution:g} m)"

    def _move_to(self, origin: Array) -> None:
        self.origin: Array = np.array(origin, dtype=float)
        self.origin.setflags(write=False)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, bottom, right and top (m)."""
        left, bottom = (float(v) for v in self.origin)
        rows, columns = self.shape
        return left, bottom, left + columns * self.resolution, bottom + rows * self.resolution

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top (m), as matplotlib's `imshow` wants it."""
        left, bottom, right, top = self.bounds
        return left, right, bottom, top

    def scaled(self, points: ArrayLike) -> Array:
        """Coordinates x, y of points (..., 2) in cells from the origin."""
        return (as_array("points", points, ("...", 2)) - self.origin) / self.resolution

    def cells(self, points: ArrayLike) -> NDArray[np.intp]:
        """Row and column of the cell of each point (..., 2); may lie outside the grid."""
        cells = np.clip(np.floor(self.scaled(points)), -(2**40), 2**40)
        return cells.astype(np.intp)[..., ::-1]

    def holds(self, cells: ArrayLike) -> NDArray[np.bool_]:
        """Tell which cells (..., 2), row and column, lie inside the grid."""
        cells = as_array("cells", cells, ("...", 2))
        return np.asarray(((cells >= 0) & (cells < self.shape)).all(-1))

    def centres(self, stride: int = 1) -> Array:
        """Centres (m) of every `stride`-th cell, shape (rows, columns, 2)."""
        every = slice(None, None, as_count("stride", stride, 1))
        return self.centres_of(every, every)

    def centres_of(self, rows: slice, columns: slice) -> Array:
        """Centres (m) of a part of the grid, shape (rows, columns, 2)."""
        row, column = np.arange(self.shape[0])[rows], np.arange(self.shape[1])[columns]
        x, y = np.meshgrid(column + 0.5, row + 0.5)
        return self.origin + self.resolution * np.stack([x, y], -1)

    def grow(self, points: Array, margin: int = 0) -> tuple[tuple[int, int], ...] | None:
        """Make the frame hold all points, a quarter more where it grows; old cells stay cells.

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            In the world (m); NaN is no point.
        margin : int, default 0
            So many cells are kept free around the points.

        Returns
        -------
        ((int, int), (int, int)) or None
            Rows added below and above, columns added left and right, as `numpy.pad` takes them;
            None if nothing had to grow.

        Raises
        ------
        ValueError
            If the grid would have more than 64 million cells; it is then as it was.
        """
        size, points = np.array(self.shape), as_shaped("points", points, ("...", 2))
        margin = as_count("margin", margin)
        cells = np.clip(np.floor((points - self.origin) / self.resolution), -1e12, 1e12)[:, ::-1]
        before = np.maximum(margin - np.nanmin(cells, axis=0), 0).astype(int)
        after = np.maximum(np.nanmax(cells, axis=0) + 1 + margin - size, 0).astype(int)
        if not (before.any() or after.any()):
            return None
        before += np.where(before > 0, size // 4, 0)
        after += np.where(after > 0, size // 4, 0)
        rows, columns = (int(n) for n in size + before + after)
        if rows * columns > MOST_CELLS:
            grown = f"it would have to grow to {rows} x {columns} cells"
            raise ValueError(f"ranges: expected beams near the map, {grown}")
        self.shape = rows, columns
        self._move_to(self.origin - before[::-1] * self.resolution)
        return tuple((int(a), int(b)) for a, b in zip(before, after, strict=True))
