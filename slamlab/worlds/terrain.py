"""Rough ground: a field of heights, smooth hills with patches of rock, grass and gravel on them.

Where no wall stands, a robot still sees how rough each patch of the ground is: the world of
Gamma-SLAM (P5 section 2.3). Chapter 15.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from slamlab._checks import Array, as_array, as_instance, as_rng, as_scalar
from slamlab.grids import Grid

__all__ = ["Terrain"]


class Terrain:
    """Heights at the centres of a grid's cells, with straight lines between them.

    Parameters
    ----------
    grid : Grid
    heights : array_like, shape (rows, columns)
        Height of the ground (m).
    relief : array_like, shape (rows, columns), optional
        The smooth part of it, on which a vehicle rides; all of it if left out.

    Examples
    --------
    >>> ground = Terrain.rough(np.random.default_rng(1), size=(6.0, 4.0))
    >>> ground, ground.height([[3.0, 2.0], [3.2, 2.0]]).shape
    (Terrain(80 x 120 cells of 0.05 m), (2,))
    """

    def __init__(self, grid: Grid, heights: ArrayLike, relief: ArrayLike | None = None) -> None:
        self.grid: Grid = as_instance("grid", grid, Grid)
        self.heights = as_array("heights", heights, grid.shape).astype(np.float64)
        relief = self.heights if relief is None else relief
        self.relief = as_array("relief", relief, grid.shape).copy()
        self.heights.setflags(write=False)
        self.relief.setflags(write=False)

    @staticmethod
    def rough(
        rng: np.random.Generator,
        size: tuple[float, float] = (20.0, 20.0),
        resolution: float = 0.05,
        *,
        roughness: float = 0.03,
        spread: float = 0.9,
        patch: float = 0.5,
        relief: float = 0.2,
    ) -> Terrain:
        """Draw hills with square patches of different roughness.

        Parameters
        ----------
        rng : numpy.random.Generator
        size : (float, float), default (20, 20)
            Along x and y (m), positive.
        resolution : float, default 0.05
            Side of a cell (m).
        roughness : float, default 0.03
            Median over the patches of the standard deviation of the heights in one (m).
        spread : float, default 0.9
            Standard deviation of the logarithm of that standard deviation; 0: all alike.
        patch : float, default 0.5
            Side of a patch (m), at least that of a cell.
        relief : float, default 0.2
            Standard deviation of the hills (m); they are some metres wide.
        """
        width, depth = as_array("size", size, (2,))
        grid = Grid.over([0.0, 0.0, width, depth], resolution)
        rng, side = as_rng("rng", rng), as_scalar("patch", patch, resolution, 1e9)
        roughness = as_scalar("roughness", roughness, 0.0, 1e9)
        spread, relief = as_scalar("spread", spread, 0, 10), as_scalar("relief", relief, 0, 1e9)
        hills = ndimage.gaussian_filter(rng.standard_normal(grid.shape), 2.0 / resolution)
        hills *= relief / max(float(hills.std()), 1e-12)
        x, y = (grid.centres() // side).astype(int).transpose(2, 0, 1)
        sigma = roughness * np.exp(spread * rng.standard_normal((y.max() + 1, x.max() + 1)))
        bumps = sigma[y, x] * rng.standard_normal(grid.shape)
        return Terrain(grid, hills + bumps, hills)

    def __repr__(self) -> str:
        """Return size and resolution."""
        return repr(self.grid).replace("Grid", "Terrain")

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, bottom, right and top (m)."""
        return self.grid.bounds

    def height(self, points: ArrayLike, relief: bool = False) -> Array:
        """Height (m) of the ground, or of its smooth part, at points (..., 2); level beyond."""
        at = self.grid.scaled(points) - 0.5
        field = self.relief if relief else self.heights
        where = at.reshape(-1, 2).T[::-1]
        found = ndimage.map_coordinates(field, where, order=1, mode="nearest")
        return np.asarray(found.reshape(at.shape[:-1]))
