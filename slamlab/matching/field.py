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
    as_scalar,
    as_tuple,
)
from slamlab.geometry import transform, wrap_angle
from slamlab.grids import MOST_CELLS, Grid
from slamlab.kernels import compiled
from slamlab.matching.match import (
    Match,
    capped_inverse,
    finite_points,
    prior_information,
    solved,
)

__all__ = ["LikelihoodGrid", "match_field"]

_MOST_STEPS = 10


class LikelihoodGrid(Grid):
    """Values on square cells, read between the cell centres by bilinear interpolation.

    Of points it is their likelihood field (`of_points`), of an occupancy map its probabilities
    (`of_occupancy`).

    Parameters
    ----------
    values : array_like, shape (rows, columns)
        Values at the cell centres, at least one, copied; row 0 is at the bottom. Beyond the grid
        they are 0.
    resolution : float
        Side of a cell (m), positive.
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
            In the world (m), at least one; rows with NaN (lost beams) are left out.
        sigma : float, default 0.1
            Width of the slope on both sides of a wall (m), positive.
        resolution : float, default 0.05
            Side of a cell (m), positive.

        Raises
        ------
        ValueError
            If there would be more than 64 million cells.

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
        splat(grid.values, grid.scaled(points), sigma / resolution)
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
        return value_and_gradient(self.values, self.log_odds, self.scaled(points))[0]

    def gradient(self, points: ArrayLike) -> Array:
        """Return dM/dx and dM/dy at points (..., 2), shape (..., 2), a metre: (5), (6)."""
        _, gradient = value_and_gradient(self.values, self.log_odds, self.scaled(points))
        return gradient / self.resolution

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
        if len(self.points) == 0:
            raise ValueError("pyramid: expected a grid made by of_points, this one has no points")
        scales = [2**k for k in range(as_count("levels", levels, 1) - 1, 0, -1)]
        coarse = [self.of_points(self.points, k * self.sigma, k * self.resolution) for k in scales]
        return [*coarse, self]

    @property
    def _frame(self) -> Array:
        """Resolution and origin (m), shape (3,)."""
        return np.array([self.resolution, *self.origin])


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
    field : LikelihoodGrid or sequence of LikelihoodGrid
        A sequence is refined in its order: coarse first.
    points : array_like, shape (k, 2)
        The scan in the frame of the body (m), at least three points; rows with NaN are left out.
    guess : array_like, shape (3,)
        Where to begin (m, m, rad).
    prior_cov : array_like, shape (3, 3), optional
        Covariance of the guess, if it is to pull; one point's weight is 1. A bias of the wheels
        is not in it.
    n_iterations : int, default 10
        Steps at most, for each field.

    Returns
    -------
    Match
        `cov` is s^2 H^-1 with s^2 the mean square of 1 - M.

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
        prior = prior_information("prior_cov", prior_cov)
    for one in fields:
        H, total, left = gauss_newton(
            one.values, one._frame, one.log_odds, points, pose, prior, rounds
        )
    pose[2] = wrap_angle(pose[2])
    n = len(points)
    arm = float(np.sqrt((points**2).sum(1).mean()))
    s2 = max(left / max(n - 3, 1), 1e-9)
    cov = capped_inverse(H / s2, arm)
    return Match(pose, cov, total / n, n, rmse=float(np.sqrt(left / n)))


# The algorithm; where numba is installed its twin in `slamlab.kernels.field` serves.


@compiled("field.gauss_newton")
def gauss_newton(
    values: Array, frame: Array, log_odds: bool, points: Array, pose: Array, prior: Array,
    n_iterations: int,
) -> tuple[Array, float, float]:  # fmt: skip
    """Move `pose` (3,) to the best one met on the way up; return H, sum M, sum (1 - M)^2 there.

    `frame` is the resolution and the origin of the field (m); `prior` (3, 3) an information
    matrix that pulls towards the first pose.
    """
    guess, here, least = pose.copy(), pose.copy(), np.inf
    best = np.zeros((3, 3)), 0.0, 0.0
    for n in range(n_iterations + 1):
        world = transform(here, points)  # S_i(xi), (8)
        M, gradient = value_and_gradient(values, log_odds, (world - frame[1:]) / frame[0])
        gx, gy = gradient.T / frame[0]
        dx, dy = (world - here[:2]).T
        J = np.stack([gx, gy, gy * dx - gx * dy], -1)  # gradient times dS / dxi, (13), (14)
        H, g = J.T @ J, J.T @ (1 - M)  # (12)
        left, off = ((1 - M) ** 2).sum(), guess - here
        cost = left + off @ prior @ off  # (7), and the prior
        if cost < least:
            least, pose[:], best = cost, here, (H, M.sum(), left)
        step = solved(H + prior, g + prior @ off)  # (12)
        if n == n_iterations or step is None:
            break
        step[2] = np.clip(step[2], -0.2, 0.2)
        here = here + step
        if np.abs(step[:2]).sum() < 1e-5 and abs(step[2]) < 1e-6:
            break
    return best


def value_and_gradient(values: Array, log_odds: bool, cells: Array) -> tuple[Array, Array]:
    """M (...) and its gradient (..., 2) at points (..., 2), all in cells: Hector (4) to (6)."""
    # A value belongs to the centre of its cell; whatever is not finite lies outside.
    x, y = np.moveaxis(np.where(np.abs(cells) < 1e9, cells, -9.0) - 0.5, -1, 0)
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    a, b = x - column, y - row
    rows = np.stack([row, row, row + 1, row + 1])
    columns = np.stack([column, column + 1, column, column + 1])
    inside = (rows >= 0) & (rows < values.shape[0]) & (columns >= 0) & (columns < values.shape[1])
    M = np.where(inside, values[np.where(inside, rows, 0), np.where(inside, columns, 0)], 0.0)
    m00, m10, m01, m11 = 1 / (1 + np.exp(-M)) if log_odds else M
    value = (1 - b) * ((1 - a) * m00 + a * m10) + b * ((1 - a) * m01 + a * m11)
    gx = (1 - b) * (m10 - m00) + b * (m11 - m01)
    gy = (1 - a) * (m01 - m00) + a * (m11 - m10)
    return value, np.stack([gx, gy], -1)


@compiled("field.splat")
def splat(values: Array, cells: Array, sigma: float) -> None:
    """Raise values to exp(-d^2 / 2 sigma^2) round points (k, 2: column, row), all in cells."""
    reach = int(np.ceil(3.5 * sigma))
    for centre in cells - 0.5:
        low = np.floor(centre).astype(int) - reach
        first, last = np.maximum(low, 0), np.minimum(low + 2 * reach + 2, values.shape[::-1])
        x, y = (
            np.exp(-0.5 * ((np.arange(i, j) - c) / sigma) ** 2)
            for i, j, c in zip(first, last, centre, strict=True)
        )
        part = values[first[1] : last[1], first[0] : last[0]]
        np.maximum(part, np.outer(y, x), out=part)
