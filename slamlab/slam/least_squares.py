"""Least squares on a graph of poses: the error of an edge, Gauss-Newton, robust kernels.

Grisetti et al. 2010, "A tutorial on graph-based SLAM": error (30) to (33), algorithm 1; as g2o.
`PoseGraph.optimize` is the door; chapter 13 derives it: (A) to (C) and (F) are its formulas.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.linalg import splu

from slamlab._checks import Array, as_array
from slamlab.geometry import wrap_angle

try:
    import qdldl
except ImportError:  # SciPy serves, three times slower
    qdldl = None

__all__ = ["edge_error", "edge_jacobians"]

# 95 % of honest errors (three degrees of freedom) lie within this Mahalanobis distance.
KERNEL_WIDTH = 2.7955
# From a drifted start true edges look false: wide first, then narrower.
KERNEL_WIDTHS = (30.0, 10.0, 3.0)
# Levenberg-Marquardt gives up beyond this multiple of the diagonal.
LARGEST_DAMPING = 1e12

Kernel = Callable[..., tuple[Array, Array]]
# What splu must know of a symmetric matrix: its diagonal serves as pivots; supernodes are narrow
# here, so no panels and no relaxation (more than SuperLU's own 20 and 10 overruns its memory).
SYMMETRIC = {
    "diag_pivot_thresh": 0.0,
    "panel_size": 1,
    "relax": 1,
    "options": {"SymmetricMode": True},
}


# The error of an edge; the components of poses stand first, shape (3, ...)


def edge_error(pose_i: ArrayLike, pose_j: ArrayLike, measurement: ArrayLike) -> Array:
    """Error of measured relative poses, in the frame of the measurement (Grisetti 2010 (30)).

    Parameters
    ----------
    pose_i, pose_j : array_like, shape (..., 3)
        Poses x, y (m), theta (rad) in one common frame.
    measurement : array_like, shape (..., 3)
        Pose of j seen from i, as measured.

    Returns
    -------
    ndarray, shape (..., 3)
        R_z^T (R_i^T (t_j - t_i) - t_z) and the angle theta_j - theta_i - theta_z in (-pi, pi].
        Zero where the measurement fits.

    Examples
    --------
    >>> edge_error([0, 0, 0], [1, 0, 0], [0.9, 0, 0.3]).round(3).tolist()
    [0.096, -0.03, -0.3]
    """
    return np.moveaxis(errors(*_components(pose_i, pose_j, measurement)), 0, -1)


def edge_jacobians(
    pose_i: ArrayLike, pose_j: ArrayLike, measurement: ArrayLike
) -> tuple[Array, Array]:
    """Jacobians of `edge_error` by both poses (Grisetti 2010 (32), (33)).

    Parameters
    ----------
    pose_i, pose_j, measurement : array_like, shape (..., 3)
        As in `edge_error`.

    Returns
    -------
    A, B : ndarray, shape (..., 3, 3)
        d e / d pose_i and d e / d pose_j.

    Examples
    --------
    >>> A, B = edge_jacobians([0, 0, 0], [1, 0, 0], [1, 0, 0])
    >>> A.tolist()
    [[-1.0, -0.0, 0.0], [0.0, -1.0, -1.0], [-0.0, -0.0, -1.0]]
    """
    J = np.moveaxis(jacobians(*_components(pose_i, pose_j, measurement)), (0, 1), (-2, -1))
    return J[..., :3].copy(), J[..., 3:].copy()


def _components(pose_i: ArrayLike, pose_j: ArrayLike, measurement: ArrayLike) -> list[Array]:
    """Check both poses and the measurement; their components stand first, shape (3, ...)."""
    named = {"pose_i": pose_i, "pose_j": pose_j, "measurement": measurement}
    return [np.moveaxis(as_array(name, x, ("...", 3)), -1, 0) for name, x in named.items()]


def errors(x_i: Array, x_j: Array, z: Array) -> Array:
    """Error z^-1 (+) (x_i^-1 (+) x_j), shape (3, ...): Grisetti 2010 (30)."""
    dx, dy = turned_back(x_i[2], x_j[0] - x_i[0], x_j[1] - x_i[1])  # (A): R_i^T (t_j - t_i)
    ex, ey = turned_back(z[2], dx - z[0], dy - z[1])  # (A): R_z^T (... - t_z)
    return np.stack([ex, ey, wrap_angle(x_j[2] - x_i[2] - z[2])])


def turned_back(angle: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Components of R(angle)^T (x, y)."""
    c, s = np.cos(angle), np.sin(angle)
    return c * x + s * y, c * y - s * x


def jacobians(x_i: Array, x_j: Array, z: Array) -> Array:
    """Jacobians d e / d (x_i, x_j), shape (3, 6, ...): Grisetti 2010 (32), (33)."""
    phi, dx, dy = x_i[2] + z[2], x_j[0] - x_i[0], x_j[1] - x_i[1]
    c, s = np.cos(phi), np.sin(phi)
    J = np.zeros((3, 6, *np.broadcast_shapes(phi.shape, dx.shape)))
    J[0, 3], J[0, 4], J[1, 3], J[1, 4], J[2, 5] = c, s, -s, c, 1.0  # (B): B = R_z^T R_i^T, 1
    J[:, :3] = -J[:, 3:]  # (B): A is -B but for R_z^T (d R_i / d theta)^T (t_j - t_i)
    J[0, 2], J[1, 2] = c * dy - s * dx, -c * dx - s * dy
    return J


# Kernels: cost and weight of an edge as functions of its x = e^T Omega e


def quadratic(x: Array) -> tuple[Array, Array]:
    """Least squares as they are: rho = x, of weight 1."""
    return x.copy(), np.ones(len(x))


def huber(x: Array, width: float) -> tuple[Array, Array]:
    """Huber 1964: rho = x within the width k, 2 k sqrt(x) - k^2 beyond; weight = d rho / d x."""
    distance = np.sqrt(x)
    beyond = distance > width
    weight = np.where(beyond, width / np.where(beyond, distance, 1.0), 1.0)
    return np.where(beyond, 2 * width * distance - width**2, x), weight


def dcs(x: Array, width: float) -> tuple[Array, Array]:
    """Agarwal et al. 2013: weight s^2, s = min(1, 2 Phi / (Phi + x)); rho is its integral."""
    phi = width**2
    weight = np.minimum(1.0, 2 * phi / (phi + x)) ** 2  # (F)
    return np.where(x > phi, phi * (3 * x - phi) / (phi + x), x), weight


def max_mixture(x: Array, width: float) -> tuple[Array, Array]:
    """Olson and Agarwal 2013: the likelier of "true" and "false", of 1e-6 of its information."""
    scale = 1e-6
    false = x > width**2
    rho = np.where(false, scale * x + (1 - scale) * width**2, x)
    return rho, np.where(false, scale, 1.0)


def likeliest(
    x: Array, kernel: Kernel, groups: Sequence[np.ndarray], log_det: Array
) -> tuple[Array, Array]:
    """Of each group of edges only the likeliest counts (Olson and Agarwal 2013), by `kernel`.

    `log_det` (m,) is that of Omega, of each edge.
    """
    rho, weight = kernel(x)
    for group in groups:
        others = np.delete(group, np.argmin((x - log_det)[group]))
        weight[others] = rho[others] = 0.0
    return rho, weight


KERNELS: dict[str, Kernel] = {"huber": huber, "dcs": dcs, "max-mixture": max_mixture}


# The engine


class Estimate(NamedTuple):
    """Vertices x (n, 3), and what the edges say there: errors e (3, m), e^T Omega e, the cost."""

    x: Array
    e: Array
    squared: Array
    cost: float
    weights: Array


class Edges:
    """All edges of a graph: `at` gives their errors and cost, `linearise` their Jacobians.

    Parameters
    ----------
    edges : ndarray of int, shape (m, 2)
    measurements : ndarray, shape (m, 3)
    information : ndarray, shape (m, 3, 3)
    kernel : callable
        Cost and weight of each e^T Omega e.
    """

    def __init__(
        self,
        edges: np.ndarray,
        measurements: Array,
        information: Array,
        kernel: Callable[[Array], tuple[Array, Array]] = quadratic,
    ) -> None:
        (self.i, self.j), self.z = edges.T, measurements.T.copy()
        self.information = np.moveaxis(information, 0, -1).copy()  # (3, 3, m)
        self.kernel = kernel

    def at(self, x: Array) -> Estimate:
        """Errors, cost and weights of the edges where the vertices are at x (n, 3)."""
        e = errors(x[self.i].T, x[self.j].T, self.z)
        # Rounding may leave an edge of singular information a hair below zero.
        squared = np.einsum("am,abm,bm->m", e, self.information, e).clip(0.0)
        rho, weights = self.kernel(squared)
        return Estimate(x, e, squared, float(rho.sum()), weights)

    def linearise(self, here: Estimate) -> tuple[Array, Array, Array]:
        """Errors (3, m), Jacobians (3, 6, m) and weighted information (3, 3, m)."""
        J = jacobians(here.x[self.i].T, here.x[self.j].T, self.z)
        return here.e, J, self.information * here.weights

    def rounding(self, x: Array) -> float:
        """Cost that is left when all measurements agree and only rounding is seen."""
        ulp = 4 * np.finfo(float).eps * max(1.0, np.abs(x).max())
        return float(np.trace(self.information).sum()) * ulp**2


class NormalEquations:
    """H dx = -g of the free coordinates; where the entries of H lie is found once.

    Parameters
    ----------
    free : ndarray of bool, shape (n, 3)
        Which coordinates of the vertices may move.
    edges : ndarray of int, shape (m, 2)
    names : callable
        Turns rows of vertices into words, for the message about a singular graph.
    """

    def __init__(
        self, free: np.ndarray, edges: np.ndarray, names: Callable[[np.ndarray], str] = str
    ) -> None:
        self.free, self.names, self.N = free, names, int(free.sum())
        place = np.full(free.shape, self.N)  # what stays where it is: a row beyond the last
        place[free] = np.arange(self.N)
        self.rows = np.hstack([place[edges[:, 0]], place[edges[:, 1]]]).T.copy()  # (6, m)
        row, column = np.broadcast_arrays(self.rows[:, None], self.rows[None])
        upper = (row <= column) & (column < self.N)  # this triangle serves
        self.used, row, column = np.flatnonzero(upper), row[upper], column[upper]
        self.H = sp.csc_matrix((np.zeros(len(row)), (row, column)), (self.N, self.N))
        self.last = self.H.indptr[1:] - 1  # of each column: the diagonal
        self.H.data = np.arange(self.H.nnz)  # numbered: where in H each used entry is summed
        self.entry = np.asarray(self.H[row, column]).ravel()
        self.probe = np.cos(np.arange(float(self.N)))
        self.factors: Any = None

    def fill(self, e: Array, J: Array, information: Array) -> None:
        """Sum H = J^T Omega J and g = J^T Omega e over the edges."""
        OJ = np.einsum("abm,bjm->ajm", information, J)
        blocks = np.einsum("aim,ajm->ijm", J, OJ).take(self.used)
        data = np.bincount(self.entry, blocks, self.H.nnz)
        g = np.bincount(self.rows.ravel(), np.einsum("ajm,am->jm", OJ, e).ravel(), self.N)
        if not np.isfinite(data).all():
            raise ValueError("poses: expected a graph of moderate size, the equations overflow")
        self.H.data, self.g = data, g[: self.N].astype(np.float64, copy=False)

    def factorise(self, damping: float = 0.0) -> None:
        """Factorise H + damping diag H; its order is found once."""
        H, probe, first = self.H.copy(), self.probe, self.factors is None
        H.data[self.last] *= 1 + damping
        # Rounding hides an exact zero, so ask for a known vector back: sound graphs of 20000 poses
        # return it to 1e-5, singular ones miss it by its own size.
        try:
            self.factors = factorised(H, self.factors)
            if not np.abs(self.solve(times(H, probe)) - probe).max() < 1e-3:
                if first:
                    raise self.singular()
                # A kernel may leave next to nothing; but an update passes over a zero in silence.
                self.factors = factorised(H)
        except RuntimeError as error:
            raise self.singular() from error

    def solve(self, b: Array) -> Array:
        """H^-1 b by the factors, b (N,)."""
        return self.factors.solve(b)

    def moved(self, x: Array, dx: Array) -> Array:
        """Vertices x (n, 3), the free moved by dx (N,); angles wrapped, an infinite one is NaN."""
        x = x.copy()
        x[self.free] += dx
        x[:, 2] = wrap_angle(np.where(np.isinf(x[:, 2]), np.nan, x[:, 2]))
        return x

    def singular(self) -> ValueError:
        """Error that names the vertices that can move freely: the null space of H."""
        H, diagonal = self.H.copy(), self.H.diagonal()
        H.data[self.last] += 1e-12 * np.where(diagonal > 0, diagonal, 1.0)
        factors, v = factorised(H), self.probe
        for _ in range(3):  # inverse iteration
            v = factors.solve(v)
            v /= np.abs(v).max()
        loose = np.unique(np.nonzero(self.free)[0][np.abs(v) > 1e-5])
        return ValueError(
            "information: the measurements do not determine the graph, "
            f"free to move: {self.names(loose)}"
        )


def factorised(H: sp.csc_matrix, before: Any = None) -> Any:
    """Factors of a matrix given by its upper triangle; those of `before` lend their order."""
    if qdldl is None:
        return splu((H + sp.triu(H, 1).T).tocsc(), "MMD_AT_PLUS_A", **SYMMETRIC)
    if before is None:
        return qdldl.Solver(H, upper=True)
    before.update(H, upper=True)
    return before


def times(H: sp.csc_matrix, v: Array) -> Array:
    """H v of a matrix given by its upper triangle."""
    return H @ v + H.T @ v - H.data[H.indptr[1:] - 1] * v


class Outcome(NamedTuple):
    """Where a method ended: estimate, costs on the way, whether it converged, and in words."""

    estimate: Estimate
    history: list[float]
    converged: bool
    message: str


def gauss_newton(
    x: Array, edges: Edges, equations: NormalEquations, most: int, tolerance: float
) -> Outcome:
    """Grisetti 2010, algorithm 1, until neither the cost nor its model changes."""
    here, rounding = edges.at(x), edges.rounding(x)
    history = [here.cost]
    for _ in range(most):
        equations.fill(*edges.linearise(here))  # (C): H = J^T Omega J, g = J^T Omega e
        equations.factorise()
        dx = equations.solve(-equations.g)  # (C): H dx = -g
        there = edges.at(equations.moved(here.x, dx))  # (A): e at x + dx, angles wrapped
        if not np.isfinite(there.cost):
            return Outcome(here, history, False, "diverged: the next step has no finite cost")
        promised, change = -float(equations.g @ dx), abs(here.cost - there.cost)
        small, here = tolerance * here.cost + rounding, there
        history.append(here.cost)
        if promised <= small and change <= small:
            return Outcome(here, history, True, "converged")
    return Outcome(here, history, False, f"stopped after {most} iterations")


def levenberg_marquardt(
    x: Array, edges: Edges, equations: NormalEquations, most: int, tolerance: float
) -> Outcome:
    """Gauss-Newton with a damped diagonal; only steps that do not raise the cost are taken.

    The damping follows how well the model foretold the step (Marquardt 1963, More 1978).
    """
    here, rounding, damping = edges.at(x), edges.rounding(x), 1e-6
    history = [here.cost]
    for _ in range(most):
        equations.fill(*edges.linearise(here))  # (C)
        if equations.factors is None:
            equations.factorise()  # damping would hide a singular graph
        while True:
            equations.factorise(damping)
            dx = equations.solve(-equations.g)  # (C), H + damping diag H in the place of H
            there = edges.at(equations.moved(here.x, dx))  # (A)
            if there.cost <= here.cost * (1 + 1e-12) + rounding:
                break
            damping *= 10
            if damping > LARGEST_DAMPING:
                return Outcome(here, history, False, "no step lowers the cost")
        # model: -2 g.dx - dx.H dx with (H + damping D) dx = -g
        promised = float(dx @ (damping * equations.H.diagonal() * dx - equations.g))
        change, small = here.cost - there.cost, tolerance * here.cost + rounding
        here = there
        history.append(here.cost)
        if abs(change) <= small and damping < 1e-2:
            return Outcome(here, history, True, "converged")
        if change > 0.25 * max(promised, rounding):
            damping = max(0.1 * damping, 1e-12)
    return Outcome(here, history, False, f"stopped after {most} iterations")


METHODS = {"gauss-newton": gauss_newton, "levenberg-marquardt": levenberg_marquardt}
