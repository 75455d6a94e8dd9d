"""A field over the floor, high where walls are, that a scan can slide up: Hector's matching.

Kohlbrecher, von Stryk, Meyer and Klingauf, SSRR 2011, formulas (4) to (12). Chapter 14.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import (
    Array,
    as_array,
    as_count,
    as_covariance,
    as_scalar,
    as_tuple,
)
from slamlab.geometry import wrap_angle
from slamlab.grids import MOST_CELLS, Grid
from slamlab.matching._match import Match, capped_inverse, finite_points

__all__ = ["LikelihoodGrid", "match_field"]

_MOST_STEPS = 10


class LikelihoodGrid(Grid):
    """Values on square cells, read between the cell centres by bilinear interpolation.

    Of points it is their likelihood field (`of_points`), of an occupancy map its probabilities
    (`of_occupancy`).

    Parameters
    ----------
    values : array_like, shape (rows, columns)
        Values at the cell centres, copied; row 0 is at the bottom. Beyond the grid they are 0.
    resolution : float
        Side of a cell (m).
    origin : array_like, shape (2,), default (0, 0)
        Lower left corner of cell (0, 0) in the world (m).
    log_odds : bool, default False
        The values are log odds, as an occupancy grid keeps them, and are read as probabilities
        (beyond the grid: 0.5).

    Attributes
    ----------
    points : ndarray, shape (k, 2)
        What the grid was made of (m), none without `of_points`.
    sigma : float
        Width of the slope on both sides of a wall (m), NaN without `of_points`.

    Raises
    ------
    ValueError
        If there is no cell, a number is not finite or the resolution is not positive.

    Examples
    --------
    >>> field = LikelihoodGrid([[0.0, 1.0], [0.0, 1.0]], resolution=1.0)
    >>> field.value([1.25, 1.0]).tolist(), field.gradient([1.25, 1.0]).tolist()
    (0.75, [1.0, 0.0])
    """

    def __init__(
        self,
        values: ArrayLike,
        resolution: float,
        origin: ArrayLike = (0.0, 0.0),
        log_odds: bool = False,
    ) -> None:
        self.values: Any = as_array("values", values, ("rows", "columns")).copy()
        if self.values.size == 0:
            raise ValueError(f"values: expected at least one cell, got {self.values.shape}")
        super().__init__(self.values.shape, resolution, origin)
        self.log_odds = bool(log_odds)
        self.points, self.sigma = np.zeros((0, 2)), float("nan")

    @classmethod
    def of_points(
        cls, points: ArrayLike, sigma: float = 0.1, resolution: float = 0.05
    ) -> LikelihoodGrid:
        """Likelihood field of points: exp(-d^2 / 2 sigma^2), d the distance to the nearest one.

        Parameters
        ----------
        points : array_like, shape (k, 2)
            In the world (m); rows with NaN (lost beams) are left out.
        sigma : float, default 0.1
            Width of the slope on both sides of a wall (m).
        resolution : float, default 0.05
            Side of a cell (m).

        Raises
        ------
        ValueError
            If there is no point, a parameter is out of range or the grid would be beyond 64
            million cells.

        Examples
        --------
        >>> field = LikelihoodGrid.of_points([[0.0, 0.0], [3.0, 0.0]])
        >>> field.value([[0.0, 0.1], [1.5, 0.0]]).round(1).tolist()
        [0.6, 0.0]
        """
        sigma = as_scalar("sigma", sigma, 1e-6, 1e6)
        resolution = as_scalar("resolution", resolution, 1e-6, 1e6)
        points = finite_points("points", points)
        # Cells lie at whole multiples of the resolution, a slope's width more on every side.
        reach = 4 * sigma + resolution
        x, y = points.T  # a coordinate at a time: numpy is slow along the short axis
        low = np.floor((np.array([x.min(), y.min()]) - reach) / resolution)
        columns, rows = np.ceil((np.array([x.max(), y.max()]) + reach) / resolution) - low
        if columns * rows > MOST_CELLS:
            raise ValueError(
                f"points: expected them on one floor, they need {columns * rows:g} cells"
            )
        grid = object.__new__(cls)
        grid.values, grid.log_odds = np.zeros((int(rows), int(columns)), np.float32), False
        Grid.__init__(grid, grid.values.shape, resolution, low * resolution)
        grid.points, grid.sigma = points, sigma
        grid._stamp(points)
        return grid

    @classmethod
    def of_occupancy(cls, log_odds: Array, resolution: float, origin: Array) -> LikelihoodGrid:
        """Read an occupancy map's log odds in place: what the map learns, the grid shows."""
        grid = object.__new__(cls)
        grid.shape, grid.log_odds = log_odds.shape, True
        grid.values, grid.resolution, grid.origin = log_odds, resolution, origin
        grid.points, grid.sigma = np.zeros((0, 2)), float("nan")
        return grid

    def value(self, points: ArrayLike) -> Array:
        """Return M at points (..., 2) of the world (m), shape (...): Hector (4)."""
        return self._look_up(points)[..., 0]

    def gradient(self, points: ArrayLike) -> Array:
        """Return dM/dx and dM/dy at points (..., 2), shape (..., 2), a metre: (5), (6)."""
        return self._look_up(points)[..., 1:] / self.resolution

    def _look_up(self, points: ArrayLike) -> Array:
        from slamlab.kernels.field import look_up_all

        cells = self.scaled(points)
        out = np.empty((*cells.shape[:-1], 3))
        look_up_all(self.values, cells.reshape(-1, 2), self.log_odds, out.reshape(-1, 3))
        return out

    def add(self, points: ArrayLike) -> None:
        """Put more points (k, 2) into a grid `of_points`; it grows with them."""
        self._needs_points("add")
        points = finite_points("points", points)
        added = self.grow(points, int(np.ceil(4 * self.sigma / self.resolution)) + 1)
        if added is not None:
            self.values = np.pad(self.values, added)
        self._stamp(points)
        self.points = np.concatenate([self.points, points])

    def pyramid(self, levels: int) -> list[LikelihoodGrid]:
        """Grids of the same points, each twice as fine and narrow as the one before; last: this.

        Parameters
        ----------
        levels : int
            How many, at least one.

        Returns
        -------
        list of LikelihoodGrid
            Ready for `match_field`.
        """
        self._needs_points("pyramid")
        scales = [2**k for k in range(as_count("levels", levels, 1) - 1, 0, -1)]
        coarse = [self.of_points(self.points, k * self.sigma, k * self.resolution) for k in scales]
        return [*coarse, self]

    def _needs_points(self, what: str) -> None:
        if len(self.points) == 0:
            raise ValueError(f"{what}: expected a grid made by of_points, this one has no points")

    def _stamp(self, points: Array) -> None:
        from slamlab.kernels.field import stamp

        stamp(self.values, self.scaled(points), self.sigma / self.resolution)


def match_field(
    field: LikelihoodGrid | Sequence[LikelihoodGrid],
    points: ArrayLike,
    guess: ArrayLike,
    prior_cov: ArrayLike | None = None,
    n_iterations: int = _MOST_STEPS,
) -> Match:
    """Slide a scan up the slopes of a field: Gauss-Newton on sum [1 - M(S_i(xi))]^2, Hector (7).

    Parameters
    ----------
    field : Field or sequence of Field
        A sequence is climbed in its order: coarse first.
    points : array_like, shape (k, 2)
        The scan in the frame of the body (m); rows with NaN are left out.
    guess : array_like, shape (3,)
        Where to begin (m, m, rad).
    prior_cov : array_like, shape (3, 3), optional
        Covariance of the guess, if it is to pull; one point's weight is 1. Wheels have a bias that
        no covariance tells: chapter 14 shows what that does.
    n_iterations : int, default 10
        Steps at most, for each field.

    Returns
    -------
    Match
        `cov` is s^2 H^-1 with s^2 the mean square of 1 - M.

    Raises
    ------
    ValueError
        If there are fewer than three points, or a shape is wrong.

    Examples
    --------
    >>> x, y = np.linspace(0, 3, 61), np.linspace(0, 2, 41)
    >>> corner = np.vstack([np.stack([x, 0 * x], -1), np.stack([0 * y, y], -1)])
    >>> from slamlab.geometry import inverse_transform
    >>> scan = inverse_transform([0.1, 0.05, 0.0], corner)
    >>> fields = [LikelihoodGrid.of_points(corner, sigma=sigma) for sigma in (0.3, 0.1)]
    >>> match_field(fields, scan, guess=[0, 0, 0]).pose[:2].round(2).tolist()
    [0.06, 0.04]
    """
    fields = [field] if isinstance(field, LikelihoodGrid) else as_tuple("field", field)
    if not fields or not all(isinstance(one, LikelihoodGrid) for one in fields):
        raise ValueError(f"field: expected a LikelihoodGrid or a sequence of them, got {field!r}")
    points = finite_points("points", points, 3)
    pose = as_array("guess", guess, (3,)).astype(np.float64)
    rounds = as_count("n_iterations", n_iterations, 1)
    prior = np.zeros((3, 3))
    if prior_cov is not None:
        prior[:] = np.linalg.inv(as_covariance("prior_cov", prior_cov, 3))
    for one in fields:
        H, total, left = _climb(one, points, pose, prior, rounds)
    pose[2] = wrap_angle(pose[2])
    n = len(points)
    arm = float(np.sqrt((points**2).sum(1).mean()))
    s2 = max(left / max(n - 3, 1), 1e-9)
    cov = capped_inverse(H / s2, arm)
    return Match(pose, cov, total / n, n, rmse=float(np.sqrt(left / n)))


def climbed(field: LikelihoodGrid, points: Array, guess: Array) -> tuple[Array, float]:
    """Pose and residual of `match_field` alone, of arguments that were checked before."""
    pose = guess.copy()
    *_, left = _climb(field, points, pose, np.zeros((3, 3)), _MOST_STEPS)
    pose[2] = wrap_angle(pose[2])
    return pose, float(np.sqrt(left / len(points)))


def _climb(
    field: LikelihoodGrid, points: Array, pose: Array, prior: Array, rounds: int
) -> tuple[Array, float, float]:
    """Move `pose` up one field; return H, sum M and sum (1 - M)^2 there."""
    from slamlab.kernels.field import gauss_newton

    frame = np.array([field.resolution, *field.origin])
    return gauss_newton(field.values, frame, field.log_odds, points, pose, prior, rounds)
