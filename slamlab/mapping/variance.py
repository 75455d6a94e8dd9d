"""Maps of rough ground: how far the heights in a cell scatter; and, to compare, how high it lies.

Marks, Howard, Bajracharya, Cottrell and Matthies, ICRA 2008: a gamma distribution over the
precision of the heights in each cell. P5 section 2.3; (D)-(F) are formulas of chapters 15 and 15b.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

from slamlab._checks import Array, as_array, as_batch, as_choice, as_instance, as_scalar, as_shaped
from slamlab.geometry import transform
from slamlab.grids import Grid

__all__ = [
    "FEWEST",
    "FLOOR",
    "OF",
    "HeightGrid",
    "VarianceGrid",
    "log_density",
    "unchecked_log_density",
]

# The density of a sample variance wants two degrees of freedom or more, and no variance of nought.
FEWEST, FLOOR = 2, 1e-6
OF = ("heights", "variances")


def log_density(
    s2: ArrayLike, nu: ArrayLike, alpha: ArrayLike, beta: ArrayLike, of: str = "variances"
) -> Array:
    """Log density of what a cell will show, before it is measured.

    The heights are normal with precision tau ~ Gamma(alpha, beta), around a mean that is equally
    likely anywhere within a width L = 1 m: each cell costs ln L, which is 0 in metres. Then their
    sample variance s2 has an F distribution: alpha s2 / beta ~ F(nu, 2 alpha). And the heights
    themselves a Student distribution of 2 alpha degrees of freedom.

    Parameters
    ----------
    s2 : array_like, shape (...)
        Sample variance (m^2), positive: the sum of squares over nu, not over the number of
        heights.
    nu : array_like, shape (...)
        Degrees of freedom, positive: heights less one.
    alpha, beta : array_like, shape (...)
        Shape and rate (m^2) of the cell, positive.
    of : {"variances", "heights"}, default "variances"
        Density of s2, or of the nu + 1 heights that gave it. They differ by what does not depend
        on alpha and beta, but on how many heights fell into the cell, and how they lie.

    Examples
    --------
    >>> from scipy import stats
    >>> f = stats.f(4, 6).logpdf(3 * 0.5 / 0.2) + np.log(3 / 0.2)
    >>> bool(np.isclose(log_density(0.5, 4, 3.0, 0.2), f))
    True
    """
    as_choice("of", of, OF)
    for name, value in {"s2": s2, "nu": nu, "alpha": alpha, "beta": beta}.items():
        if not (as_array(name, value) > 0).all():
            raise ValueError(f"{name}: expected positive numbers, got {np.min(value):g}")
    s2, nu, alpha, beta = (np.asarray(value, float) for value in (s2, nu, alpha, beta))
    lead = s2.shape
    for name, array in {"nu": nu, "alpha": alpha, "beta": beta}.items():
        lead = as_batch(name, array.shape, lead)
    return unchecked_log_density(s2, nu, alpha, beta, of)


def unchecked_log_density(s2: Array, nu: Array, a: Array, b: Array, of: str) -> Array:
    """Log density as `log_density` of arguments that are known to be right; s2 may be 0."""
    half = 0.5 * nu
    # lnG(a + nu/2) - lnG(a) + a ln b - (a + nu/2) ln(b + nu s2/2)
    common = gammaln(a + half) - gammaln(a) + a * np.log(b) - (a + half) * np.log(b + half * s2)
    if of == "heights":
        # (F): ... - (nu/2) ln 2 pi - ln(n)/2 - ln L, L = 1 m
        return np.asarray(common - half * np.log(2 * np.pi) - 0.5 * np.log(nu + 1))
    # (E): ... - lnG(nu/2) + (nu/2) ln(nu/2) + (nu/2 - 1) ln s2
    return np.asarray(common - gammaln(half) + half * np.log(half) + (half - 1) * np.log(s2))


class _CellMap:
    """A grid of cells that takes in points with heights: what both maps have in common."""

    def __init__(self, grid: Grid) -> None:
        self.grid: Grid = as_instance("grid", grid, Grid)

    def __repr__(self) -> str:
        """Return size and resolution."""
        return repr(self.grid).replace("Grid", type(self).__name__)

    def _gathered(
        self, pose: ArrayLike, points: ArrayLike, heights: ArrayLike, least: int
    ) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], Array, Array, Array]:
        """Cells (rows, columns) that hold `least` points or more; their number, mean, squares."""
        pose = as_array("pose", pose, (3,))
        points = as_shaped("points", points, ("n", 2))
        heights = as_shaped("heights", heights, (len(points),))
        seen = np.isfinite(points).all(-1) & np.isfinite(heights)
        cells = self.grid.cells(transform(pose, points[seen]))
        inside = self.grid.holds(cells)
        number = np.ravel_multi_index(tuple(cells[inside].T), self.grid.shape)
        heights = heights[seen][inside]
        found, cell, n = np.unique(number, return_inverse=True, return_counts=True)
        mean = np.bincount(cell, heights, len(found)) / n
        squares: Array = np.bincount(cell, (heights - mean[cell]) ** 2, len(found)).astype(float)
        enough = n >= least
        row, column = np.divmod(found[enough], self.grid.shape[1])
        return (row, column), n[enough].astype(float), mean[enough], squares[enough]


class VarianceGrid(_CellMap):
    """How far the heights scatter in each cell: tau = 1 / variance ~ Gamma(alpha, beta).

    Nothing is kept of the heights themselves: a robot that rose by a hand sees the same map, and
    one that leans by a degree nearly the same.

    Parameters
    ----------
    grid : Grid
    alpha, beta : float, default 1 and 1e-3
        Shape and rate (m^2) of a cell that nobody saw, positive.

    Attributes
    ----------
    alpha, beta : ndarray, shape (rows, columns)
        Of each cell now.

    Examples
    --------
    >>> ground = VarianceGrid(Grid((2, 2), 1.0))
    >>> rng = np.random.default_rng(1)
    >>> ground.insert([0, 0, 0], rng.uniform(0, 1, (400, 2)), 0.05 * rng.standard_normal(400))
    >>> ground.roughness.round(2).tolist()
    [[0.05, nan], [nan, nan]]
    """

    def __init__(self, grid: Grid, alpha: float = 1.0, beta: float = 1e-3) -> None:
        super().__init__(grid)
        self._prior = as_scalar("alpha", alpha, 1e-9, 1e9), as_scalar("beta", beta, 1e-12, 1e9)
        self.alpha = np.full(grid.shape, self._prior[0])
        self.beta = np.full(grid.shape, self._prior[1])

    @property
    def roughness(self) -> Array:
        """Standard deviation (m) that goes with the mean precision; NaN where nobody saw."""
        seen = self.alpha > self._prior[0]
        return np.where(seen, np.sqrt(self.beta / self.alpha), np.nan)

    def log_likelihood(
        self, pose: ArrayLike, points: ArrayLike, heights: ArrayLike, of: str = "heights"
    ) -> float:
        """Log density of a picture, seen from `pose`.

        Parameters
        ----------
        pose : array_like, shape (3,)
        points : array_like, shape (n, 2)
            In the body frame (m); NaN is none.
        heights : array_like, shape (n,)
            Of the points, above whatever level (m).
        of : {"heights", "variances"}, default "heights"
            Of what; only the first may be compared between poses.
        """
        (row, column), s2, nu = self._variances(pose, points, heights)
        alpha, beta = self.alpha[row, column], self.beta[row, column]
        if as_choice("of", of, OF) == "heights":
            return float(unchecked_log_density(s2, nu, alpha, beta, of).sum())
        enough = nu >= FEWEST
        return float(unchecked_log_density(s2 + FLOOR, nu, alpha, beta, of)[enough].sum())

    def insert(self, pose: ArrayLike, points: ArrayLike, heights: ArrayLike) -> None:
        """Take a picture in; arguments as in `log_likelihood`."""
        where, s2, nu = self._variances(pose, points, heights)
        # (D): alpha += nu/2, beta += nu s2/2
        self.alpha[where] += 0.5 * nu
        self.beta[where] += 0.5 * nu * s2

    def _variances(
        self, pose: ArrayLike, points: ArrayLike, heights: ArrayLike
    ) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], Array, Array]:
        where, n, _, squares = self._gathered(pose, points, heights, 2)
        return where, squares / (n - 1), n - 1


class HeightGrid(_CellMap):
    """How high each cell lies: its mean height, normal, with heights that scatter by `sigma`.

    A camera that leans sees other heights; `level` makes up for that.

    Parameters
    ----------
    grid : Grid
    sigma : float, default 0.03
        Standard deviation of the heights in a cell (m), positive.
    level : bool, default False
        Take a plane off each picture before it is weighed or added: the rise, pitch and roll of
        the camera that fit the map best, by weighted least squares.
    prior : float, default 1.0
        Standard deviation (m) of the height of a cell that nobody saw, around 0; positive.

    Attributes
    ----------
    mean, var : ndarray, shape (rows, columns)
        Of the height of each cell now (m, m^2).

    Examples
    --------
    >>> ground = HeightGrid(Grid((1, 1), 1.0), sigma=0.1)
    >>> ground.insert([0, 0, 0], [[0.2, 0.3], [0.6, 0.4]], [0.4, 0.6])
    >>> ground.mean.round(2).tolist(), np.sqrt(ground.var).round(2).tolist()
    ([[0.5]], [[0.07]])
    """

    def __init__(
        self, grid: Grid, sigma: float = 0.03, level: bool = False, prior: float = 1.0
    ) -> None:
        super().__init__(grid)
        self._sigma2 = as_scalar("sigma", sigma, 1e-9, 1e9) ** 2
        self._level = bool(level)
        self.mean = np.zeros(grid.shape)
        self.var = np.full(grid.shape, as_scalar("prior", prior, 1e-9, 1e9) ** 2)

    def log_likelihood(self, pose: ArrayLike, points: ArrayLike, heights: ArrayLike) -> float:
        """Log density of the mean heights of a picture; as `VarianceGrid.log_likelihood`."""
        where, n, mean, _ = self._gathered(pose, points, heights, 1)
        S = self.var[where] + self._sigma2 / n
        gap = self._gap(where, mean, S)
        return float(-0.5 * (gap**2 / S + np.log(2 * np.pi * S)).sum())

    def insert(self, pose: ArrayLike, points: ArrayLike, heights: ArrayLike) -> None:
        """Take a picture in: a Kalman filter of one number in each cell."""
        where, n, mean, _ = self._gathered(pose, points, heights, 1)
        S = self.var[where] + self._sigma2 / n
        gain = self.var[where] / S
        self.mean[where] += gain * self._gap(where, mean, S)
        self.var[where] *= 1 - gain

    def _gap(
        self, where: tuple[NDArray[np.intp], NDArray[np.intp]], mean: Array, S: Array
    ) -> Array:
        """Mean heights of a picture less those of the map, without the plane between the two."""
        gap = mean - self.mean[where]
        if not self._level or not len(gap):
            return np.asarray(gap)
        # rise, and slopes along x and y: min sum (gap - A p)^2 / S
        row, column = (np.asarray(index, float) for index in where)
        A = np.stack([np.ones_like(row), row - row.mean(), column - column.mean()], -1)
        weight = 1 / np.sqrt(S)
        plane = np.linalg.lstsq(A * weight[:, None], gap * weight, rcond=None)[0]
        return np.asarray(gap - A @ plane)
