"""How well do lidar points fit a map? The likelihood field: look up the distance to the next wall.

Thrun, Burgard and Fox, Probabilistic Robotics (2005), section 6.4. The map of a
`MonteCarloLocalization` with a lidar.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import distance_transform_edt

from slamlab._checks import Array, as_array, as_count, as_scalar, as_shaped
from slamlab.grids import Grid

__all__ = ["LikelihoodField"]

_FAR = 2.0**40  # cells; farther off nothing is told apart


class LikelihoodField(Grid):
    """Log likelihood of lidar end points from many poses at once.

    A point at distance d from the nearest wall has, up to a constant factor, the density
    ``hit * exp(-d^2 / (2 sigma^2)) + (1 - hit)``: near a wall, or anywhere.

    Parameters
    ----------
    occupied : array_like of bool, shape (H, W)
        Cells with a wall, at least one; row 0 is at the bottom (smallest y).
    resolution : float
        Side of a cell (m).
    origin : array_like, shape (2,), default (0, 0)
        Lower left corner of cell (0, 0) in the world (m).
    sigma : float, default 0.1
        How far (m) an end point strays from its wall: sensor noise and map error together.
    hit : float, default 0.9
        Share of points that belong to the map, in (0, 1); the rest may lie anywhere, people
        included. No single point can exclude a pose.
    n_points : int, optional
        Weigh at most so many points of a scan, evenly chosen. What one beam says its neighbours
        say too; counted as independent they make the estimate overconfident.

    Attributes
    ----------
    distance : ndarray, shape (H, W)
        Distance (m) of each cell centre to the nearest centre of an occupied cell.

    Examples
    --------
    >>> walls = np.zeros((40, 60), bool)
    >>> walls[[0, -1]] = walls[:, [0, -1]] = True
    >>> field = LikelihoodField(walls, resolution=0.1)
    >>> poses = [[3.0, 2.0, 0.0], [2.0, 2.0, 0.0]]
    >>> seen_from_the_first = [[2.95, 0.0], [0.0, 1.95], [-2.95, 0.0], [0.0, -1.95]]
    >>> first, second = field.log_likelihood(poses, seen_from_the_first)
    >>> round(float(first - second), 2)
    4.61
    """

    def __init__(
        self,
        occupied: ArrayLike,
        resolution: float,
        origin: ArrayLike = (0.0, 0.0),
        sigma: float = 0.1,
        hit: float = 0.9,
        n_points: int | None = None,
    ) -> None:
        grid = np.asarray(occupied)
        if grid.ndim != 2 or grid.dtype != np.bool_ or not grid.any():
            raise ValueError(
                f"occupied: expected booleans (H, W) with a wall, got {grid.dtype} {grid.shape}"
            )
        super().__init__(grid.shape, resolution, origin)
        self._n_points = None if n_points is None else as_count("n_points", n_points, 1)
        sigma = as_scalar("sigma", sigma, 1e-9, 1e9)
        hit = as_scalar("hit", hit, 1e-9, 1 - 1e-9)
        self.distance: Array = self.resolution * distance_transform_edt(~grid)
        # One border of "nowhere near a wall" stands for everything outside the map.
        distance = np.pad(self.distance, 1, constant_values=np.inf)
        self._log_density = np.log(hit * np.exp(-0.5 * (distance / sigma) ** 2) + 1 - hit)

    def log_likelihood(self, poses: ArrayLike, points: ArrayLike) -> Array:
        """Sum of the log densities of the end points, for each pose.

        Parameters
        ----------
        poses : array_like, shape (M, 3)
            Candidate poses (m, m, rad).
        points : array_like, shape (k, 2)
            End points in the frame of the body (m); rows with NaN (lost beams) do not count.

        Returns
        -------
        ndarray, shape (M,)
        """
        poses, given = as_array("poses", poses, ("M", 3)), as_shaped("points", points, ("k", 2))
        seen = given[np.isfinite(given).all(1)]
        if self._n_points is not None and len(seen) > self._n_points:
            seen = seen[np.linspace(0, len(seen), self._n_points, endpoint=False).astype(int)]
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        with np.errstate(over="ignore"):  # what is beyond all numbers is outside the map
            x0, y0 = np.clip(self.scaled(poses[:, :2]), -_FAR, _FAR).T
            cells = np.clip(seen / self.resolution, -_FAR, _FAR)
        rows, columns = self.shape
        total = np.zeros(len(poses))
        for x, y in cells:
            # Cell of the point in the padded grid; everything outside falls on its border.
            column = np.clip(np.floor(x0 + c * x - s * y) + 1, 0, columns + 1).astype(np.intp)
            row = np.clip(np.floor(y0 + s * x + c * y) + 1, 0, rows + 1).astype(np.intp)
            total += self._log_density[row, column]
        return total
