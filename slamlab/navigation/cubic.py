"""One cubic of the plane: constrained fit, arc length, nearest point, where it crosses itself.

P3 formula (1), sections 2 and 4; `path_memory` joins such cubics. Chapter 17 derives every
formula. Below the public names a cubic is its coefficients c (4, 2) over tau in [0, 1].
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from slamlab._checks import Array, as_array, as_instance, as_scalar
from slamlab.kernels import compiled

__all__ = ["Cubic", "fit_cubic", "refit_by_arc_length"]

_FAR = 1e9  # metres: no path is longer, and the searches end
PIECES = 16  # pieces of a cubic whose lengths the table s(tau) keeps
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)


def as_metres(name: str, value: ArrayLike, shape: tuple[int | str, ...]) -> Array:
    """Coordinates of a path; nothing of ours lies farther off than a million kilometres."""
    array = as_array(name, value, shape)
    if array.size and np.abs(array).max() > _FAR:
        raise ValueError(f"{name}: expected metres up to {_FAR:g}, got {np.abs(array).max():g}")
    return array


@dataclass(frozen=True, eq=False)
class Cubic:
    """A cubic curve of the plane over t0 <= t <= t1, P3 (1), in the parameter tau.

    tau = (t - t0) / (t1 - t0) runs from 0 to 1, which keeps the powers comparable.

    Attributes
    ----------
    coefficients : ndarray, shape (4, 2)
        Rows are the powers of tau, columns x and y (m).
    t0, t1 : float
        Ends of the parameter, t0 < t1.

    Examples
    --------
    >>> line = Cubic(np.array([[0, 0], [3, 4], [0, 0], [0, 0.0]]), 0.0, 5.0)
    >>> line(2.5).tolist(), round(line.length, 12)
    ([1.5, 2.0], 5.0)
    """

    coefficients: Array
    t0: float = 0.0
    t1: float = 1.0

    def __post_init__(self) -> None:
        """Check, and keep the coefficients from being changed."""
        c = np.array(as_metres("coefficients", self.coefficients, (4, 2)), dtype=np.float64)
        c.setflags(write=False)
        object.__setattr__(self, "coefficients", c)
        t0 = as_scalar("t0", self.t0, -1e300, 1e300)
        if not t0 < as_scalar("t1", self.t1, -1e300, 1e300):
            raise ValueError(f"t1: expected more than t0 = {t0:g}, got {self.t1:g}")

    def _tau(self, t: ArrayLike) -> Array:
        return ((as_array("t", t) - self.t0) / (self.t1 - self.t0))[..., None]

    def __call__(self, t: ArrayLike) -> Array:
        """Points (..., 2) at parameters (...)."""
        return point(self.coefficients, self._tau(t))

    def derivative(self, t: ArrayLike) -> Array:
        """Differentiate by t: (..., 2) at parameters (...)."""
        return slope(self.coefficients, self._tau(t)) / (self.t1 - self.t0)

    def powers_of_t(self) -> Array:
        """Coefficients a_0 to a_3 (first column) and b_0 to b_3 of P3 (1), shape (4, 2)."""
        shift, width = np.polynomial.Polynomial([-self.t0, 1.0]), self.t1 - self.t0
        out = np.zeros((4, 2))
        for k in range(2):
            total = np.polynomial.Polynomial(self.coefficients[:, k])(shift / width)
            out[: len(total.coef), k] = total.coef
        return out

    @property
    def length(self) -> float:
        """Arc length (m), by quadrature to about 1e-14 of it."""
        return float(arc_length(self.coefficients, 0.0, 1.0))

    def arc_length(self, t: float) -> float:
        """Arc length (m) from t0 to t, which lies in [t0, t1]."""
        t = as_scalar("t", t, self.t0, self.t1)
        return float(arc_length(self.coefficients, 0.0, self._tau(t).item()))

    def self_crossing(self) -> tuple[float, float] | None:
        """Parameters t_a < t_b of the place where the curve crosses itself, or None.

        Closed form: with sigma = tau_a + tau_b and w = sigma^2 - tau_a tau_b the two equations
        x(t_a) = x(t_b) and y(t_a) = y(t_b) are linear.
        """
        found, width = own_crossing(self.coefficients), self.t1 - self.t0
        if found is None:
            return None
        return float(self.t0 + width * found[0]), float(self.t0 + width * found[1])


def fit_cubic(
    t: ArrayLike,
    points: ArrayLike,
    start: ArrayLike,
    end: ArrayLike | None = None,
    start_derivative: ArrayLike | None = None,
) -> Cubic:
    """Fit a cubic to points by least squares under constraints, P3 section 2.

    The curve passes through `start` at t[0]; through `end` at t[-1] and with `start_derivative`
    at t[0] if these are given: the paper's four variants. Solved by SVD in tau = (t - t[0]) /
    (t[-1] - t[0]). If there are fewer distinct parameters than unknowns, the highest shapes that
    the data cannot tell apart are left out, so that two points give a straight line.

    Parameters
    ----------
    t : array_like, shape (n,)
        Parameters of the points, not decreasing and not all equal.
    points : array_like, shape (n, 2)
        Points of the plane (m).
    start, end : array_like, shape (2,)
        Constraints (m).
    start_derivative : array_like, shape (2,)
        Constraint on the derivative by t.

    Returns
    -------
    Cubic

    Examples
    --------
    >>> t = np.array([0.0, 1.0, 2.0, 3.0])
    >>> curve = fit_cubic(t, np.stack([t, t**2], 1), start=[0, 0], end=[3, 9])
    >>> (curve.powers_of_t().round(9) + 0.0).T.tolist()  # no -0.0
    [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
    """
    t = as_array("t", t, ("n",))
    points = as_array("points", points, (len(t), 2))
    if (np.diff(t) < 0).any():
        raise ValueError(f"t: expected parameters that do not decrease, got {t}")
    if len(t) < 2 or t[-1] <= t[0]:
        raise ValueError("t: expected at least two different parameters, got fewer")
    # The fit reads its constraints from the ends of the list.
    held = np.vstack([as_array("start", start, (2,)), points])
    tau = np.concatenate([[0.0], (t - t[0]) / (t[-1] - t[0])])
    if end is not None:
        held, tau = np.vstack([held, as_array("end", end, (2,))]), np.append(tau, 1.0)
    slope = np.zeros(2)
    if start_derivative is not None:
        slope = as_array("start_derivative", start_derivative, (2,)) * (t[-1] - t[0])
    c = fit(tau, held, end is not None, start_derivative is not None, *slope.tolist())
    return Cubic(c, float(t[0]), float(t[-1]))


@compiled("cubic.fit")
def fit(
    tau: Array, points: Array, has_end: bool, has_slope: bool, slope_x: float, slope_y: float
) -> Array:
    """Constrained least-squares cubic (4, 2) through points[0], P3 section 2.

    tau (n,) runs from 0 to 1, the slope is by tau. What the constraints leave free:
    1: tau, tau^2, tau^3; 2 (slope): tau^2, tau^3; 3 (end): tau - tau^2, tau^2 - tau^3;
    4 (both): tau^2 - tau^3. The highest of them that the data cannot tell apart are left out.
    """
    c = np.zeros((4, 2))
    c[0] = points[0]
    if has_slope:
        c[1] = slope_x, slope_y
    if has_end:
        c[1 + has_slope] = points[-1] - c.sum(0)
    free = np.eye(4)[1 + has_slope :]  # powers that the constraints leave, (m, 4)
    if has_end:
        free = free[:-1] - free[1:]
    powers = tau[:, None] ** np.arange(4)
    A, b = powers @ free.T, points - powers @ c
    distinct = np.abs(np.diag(np.linalg.qr(A, mode="r"))) > 1e-9 * np.hypot.reduce(A)[: len(A)]
    m = len(distinct) if distinct.all() else int(np.argmin(distinct))
    x = np.linalg.lstsq(A[:, :m], b, rcond=None)[0]
    return np.asarray(c + free[:m].T @ x)


def deviation(c: Array, tau: Array, points: Array, between: bool) -> float:
    """Largest distance of a point from the curve at its parameter (m), P3 step 1.4.

    With `between` also of the curve, halfway between two points, from the line that joins them.
    """
    if between:
        tau = np.concatenate([tau, 0.5 * (tau[:-1] + tau[1:])])
        points = np.concatenate([points, 0.5 * (points[:-1] + points[1:])])
    gap = points - tau[:, None] ** np.arange(4) @ c
    return float(np.hypot(gap[:, 0], gap[:, 1]).max())


def refit_by_arc_length(curve: Cubic, t: ArrayLike, points: ArrayLike) -> Cubic:
    """Fit the points anew over their arc length on a first curve, P3 section 4.

    The result runs through the ends of `curve`, with t0 = 0 and t1 its length, and its speed is
    *about* 1: no polynomial curve but a straight line can have it exactly, and the points may lie
    farther from it than from the first. `PathMemory` uses a table s(t) instead.

    Parameters
    ----------
    curve : Cubic
    t : array_like, shape (n,)
        Parameters of the points on `curve`.
    points : array_like, shape (n, 2)

    Returns
    -------
    Cubic
        Over arc length (m).

    Examples
    --------
    >>> arc, t = Cubic([[0, 0], [0.3, 0], [0.9, 0], [-0.5, 0.6]]), np.linspace(0, 1, 50)
    >>> speed = np.hypot(*refit_by_arc_length(arc, t, arc(t)).derivative(t * arc.length).T)
    >>> bool(abs(speed - 1).max() < 0.1), bool(abs(speed - 1).max() > 0.01)
    (True, True)
    """
    t = as_array("t", t, ("n",))
    points = as_array("points", points, (len(t), 2))
    as_instance("curve", curve, Cubic)
    start, end = curve([curve.t0, curve.t1])
    s = [0.0, *(curve.arc_length(value) for value in t), curve.length]
    return fit_cubic(s, np.vstack([start, points, end]), start, end)


# One cubic on [0, 1].


def point(c: Array, t: float | Array) -> Array:
    """Return the point (2,) at t, or points (..., 2) at parameters (..., 1)."""
    return np.asarray(c[0] + t * (c[1] + t * (c[2] + t * c[3])))


def slope(c: Array, t: float | Array) -> Array:
    """Return the derivative by t; arguments as of `point`."""
    return np.asarray(c[1] + t * (2.0 * c[2] + t * 3.0 * c[3]))


def restrict(c: Array, a: float, b: float) -> Array:
    """Coefficients of the piece from a to b, again on [0, 1]."""
    h = b - a
    return np.stack([point(c, a), h * slope(c, a), h**2 * (c[2] + 3 * a * c[3]), h**3 * c[3]])


def monotone_cuts(c: Array) -> Array:
    """Return 0, the extrema of x and y, and 1: both are monotone from one to the next.

    They are roots of c1 + 2 c2 t + 3 c3 t^2, in the form that does not cancel.
    """
    cuts = [0.0, 1.0]
    for A, B, C in zip(3.0 * c[3], 2.0 * c[2], c[1], strict=True):
        if B * B >= 4.0 * A * C:
            q = -0.5 * (B + np.copysign(np.sqrt(B * B - 4.0 * A * C), B))
            cuts += [float(v / w) for v, w in ((q, A), (C, q)) if 0.0 < v * w and abs(v) < abs(w)]
    return np.sort(cuts)


def bounding_box(c: Array) -> Array:
    """Exact box: x low, y low, x high, y high, from the ends and the extrema."""
    points = point(c, monotone_cuts(c)[:, None])
    return np.concatenate([points.min(0), points.max(0)])


# Arc length, P3 section 4.


def arc_length(c: Array, a: float, b: float) -> float:
    """Length from a to b: the integral of the speed, piece by piece between the extrema.

    Where a curve folds the speed has a kink that the nodes of a quadrature may all miss; a fold
    is an extremum, so it can be only at the end of a piece.
    """
    length = 0.0
    for low, high in pairwise(monotone_cuts(c).tolist()):
        low, high = max(low, a), min(high, b)
        if low < high:
            length += _smooth_length(c, low, high, 0.0)
    return length


def _gauss(c: Array, a: Array, b: Array) -> Array:
    """Gauss-Legendre with ten nodes from each a (k,) to its b (k,)."""
    t = 0.5 * (a + b) + 0.5 * (b - a) * _NODES[:, None]
    speed = np.hypot(*slope(c, t[..., None]).T)
    return np.asarray(0.5 * (b - a) * (speed @ _WEIGHTS))


def _smooth_length(c: Array, a: float, b: float, before: float) -> float:
    """`before` and the length from a to b, halved until both halves agree with the whole."""
    middle = 0.5 * (a + b)
    lengths = _gauss(c, np.array([a, a, middle]), np.array([b, middle, b]))
    whole, left, right = lengths.tolist()
    if abs(left + right - whole) <= 1e-14 * (abs(whole) + abs(before)) + 1e-300 or b - a < 1e-12:
        return float(before + (left + right))
    return _smooth_length(c, middle, b, _smooth_length(c, a, middle, before))


@compiled("cubic.arc_length_table")
def arc_length_table(c: Array) -> Array:
    """Lengths (PIECES + 1,) from 0 to evenly spaced parameters: the table s(tau)."""
    t = np.arange(PIECES + 1) / PIECES
    lengths = [arc_length(c, t[i], t[i + 1]) for i in range(PIECES)]
    return np.concatenate([[0.0], np.cumsum(lengths)])


@compiled("cubic.parameter_at")
def parameter_at(c: Array, table: Array, s: float) -> float:
    """Parameter tau(s): the piece from the table, then the root of its length - s."""
    if s <= 0.0 or s >= table[-1]:
        return float(s > 0.0)
    i = int(np.searchsorted(table, s, side="right")) - 1
    low, high = i / PIECES, (i + 1) / PIECES
    return float(brentq(lambda t: table[i] + arc_length(c, low, t) - s, low, high, xtol=1e-15))


# Nearest point, and where a cubic crosses itself.


def nearest_parameter(c: Array, place: Array, a: float, b: float) -> tuple[float, float]:
    """Parameter in [a, b] of the point nearest to a place (2,), and the squared distance there.

    The distance is flat where derivative and offset are orthogonal: at each parameter where
    their product, on a grid, turns from negative to positive.
    """

    def pull(t: float) -> float:
        return float((point(c, t) - place) @ slope(c, t))

    grid = np.linspace(a, b, 25)
    along = np.array([pull(t) for t in grid])
    turns = np.flatnonzero((along[:-1] < 0.0) & (along[1:] > 0.0))
    feet = [brentq(pull, grid[k], grid[k + 1], xtol=1e-15) for k in turns]
    t = np.concatenate([grid, feet])
    squared = ((point(c, t[:, None]) - place) ** 2).sum(1)
    best = int(np.argmin(squared))
    return float(t[best]), float(squared[best])


def runs_forward(c: Array) -> bool:
    """Whether the cubic always advances along its chord, so that it cannot meet itself.

    Its advance is a parabola; where the three coefficients in Bernstein's form are positive, so
    is the parabola on [0, 1].
    """
    d1, d2, d3 = c[1:] @ c[1:].sum(0)
    return bool(min(d1, d1 + d2, d1 + 2.0 * d2 + 3.0 * d3) > 0.0)


def own_crossing(c: Array) -> tuple[float, float] | None:
    """Parameters t_a < t_b in [0, 1] at which the cubic crosses itself, or None.

    x(t_b) = x(t_a), divided by t_b - t_a, is linear in sigma = t_a + t_b and
    w = sigma^2 - t_a t_b: a_1 + a_2 sigma + a_3 w = 0, and the same in y.
    """
    c1, c2, c3 = c[1:]
    det = cross(c2, c3)
    if abs(det) <= 1e-12 * np.hypot(*c2) * np.hypot(*c3):
        return None
    sigma, w = cross(c3, c1) / det, cross(c1, c2) / det
    # Both are roots of t^2 - sigma t + (sigma^2 - w): real and distinct if 4 w > 3 sigma^2.
    if 4.0 * w <= 3.0 * sigma**2:
        return None
    root = np.sqrt(4.0 * w - 3.0 * sigma**2)
    first, second = 0.5 * (sigma - root), 0.5 * (sigma + root)
    return (float(first), float(second)) if first >= 0.0 and second <= 1.0 else None


def cross(a: Array, b: Array) -> float:
    """Cross product of two vectors of the plane."""
    return float(a[0] * b[1] - a[1] * b[0])
