"""A pose graph that grows: a pose or a closure is added without solving all anew.

The idea of iSAM (Kaess, Ranganathan and Dellaert 2008), that old factors stay good, by other
means: the factors of an old H precondition conjugate gradients on the new one, so that the result
is that of the whole graph, not of an approximation. It saves factorisations; in time it costs as
much as a batch from the last answer (at 2000 poses). Chapter 13.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import LinearOperator, cg

from slamlab._checks import Array, as_array, as_count, as_one_covariance, as_scalar
from slamlab.geometry import compose
from slamlab.slam.least_squares import (
    Edges,
    NormalEquations,
    edge_jacobians,
    factorised,
    times,
)
from slamlab.slam.pose_graph import PoseGraph

__all__ = ["IncrementalGraph"]

# The factors of H are made anew when conjugate gradients need more steps than this, or when more
# poses than that have come since.
_MANY_STEPS, _MANY_POSES = 15, 30
_MAX_ITERATIONS = 50


class IncrementalGraph:
    """A pose graph to which poses and closures are added, its optimum always at hand.

    Parameters
    ----------
    pose : array_like, shape (3,)
        First pose, which stays where it is (m, m, rad).
    tolerance : float, default 1e-4
        `poses` iterates until a step moves no pose further than this (m, rad).

    Attributes
    ----------
    converged : bool
        Whether the last time it was.
    factorisations : int
        How often H was factorised so far.

    Examples
    --------
    Two steps of one metre, and both together measured as 2.3 m:

    >>> graph = IncrementalGraph([0, 0, 0])
    >>> for _ in range(2):
    ...     row = graph.add_pose([1, 0, 0], np.eye(3))
    >>> graph.add_edge(0, 2, [2.3, 0, 0], np.eye(3))
    >>> graph.poses[:, 0].round(3).tolist()
    [0.0, 1.1, 2.2]
    """

    def __init__(self, pose: ArrayLike = (0.0, 0.0, 0.0), tolerance: float = 1e-4) -> None:
        self._tolerance = as_scalar("tolerance", tolerance, 1e-12)
        self._x = as_array("pose", pose, (3,)).astype(np.float64)[None].copy()
        self._edges = np.zeros((0, 2), dtype=np.intp)
        self._measurements = np.zeros((0, 3))
        self._information = np.zeros((0, 3, 3))
        self._births: list[int] = [-1]  # edge by which each pose came
        self._settled = self.converged = True
        self.factorisations = 0
        self._factors: Any = None
        self._n_old = 1  # poses that the factors know

    def __repr__(self) -> str:
        return f"IncrementalGraph({len(self._x)} poses, {len(self._edges)} edges)"

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self._x)

    @property
    def poses(self) -> Array:
        """Poses (n, 3) of least chi2, given all that was added; a copy."""
        if not self._settled:
            self.optimize(self._tolerance)
        return self._x.copy()

    def graph(self) -> PoseGraph:
        """Return the whole graph, at its optimum."""
        self.optimize()
        return PoseGraph(self._x, self._edges, self._measurements, self._information)

    def add_pose(
        self, measurement: ArrayLike, information: ArrayLike, previous: int | None = None
    ) -> int:
        """Add a pose by its measured motion from another one.

        The new measurement fits exactly, so no other pose moves, and nothing is solved.

        Parameters
        ----------
        measurement : array_like, shape (3,)
            New pose seen from the previous one (m, m, rad).
        information : array_like, shape (3, 3)
            Inverse covariance; positive definite.
        previous : int, optional
            Row of the pose it was measured from; the newest by default.

        Returns
        -------
        int
            Row of the new pose.
        """
        n = len(self._x)
        previous = n - 1 if previous is None else self._row("previous", previous)
        z = as_array("measurement", measurement, (3,)).astype(np.float64)
        Omega = as_one_covariance("information", information, 3)
        values = np.linalg.eigvalsh(Omega)
        if not values[0] > 1e-12 * values[-1]:
            raise ValueError("information: expected a positive definite matrix, it is singular")
        self._births.append(len(self._edges))
        self._append(previous, n, z, Omega)
        self._x = np.vstack([self._x, compose(self._x[previous], z)])
        return n

    def add_edge(self, i: int, j: int, measurement: ArrayLike, information: ArrayLike) -> None:
        """Add a measurement between two poses; the optimum is found when it is asked for.

        Parameters
        ----------
        i, j : int
            Rows of two different poses.
        measurement : array_like, shape (3,)
            Pose j seen from pose i (m, m, rad).
        information : array_like, shape (3, 3)
            Inverse covariance; positive semi-definite.
        """
        i, j = self._row("i", i), self._row("j", j)
        if i == j:
            raise ValueError(f"j: expected two different poses, got {i} twice")
        z = as_array("measurement", measurement, (3,)).astype(np.float64)
        Omega = as_one_covariance("information", information, 3)
        self._append(i, j, z, Omega)
        self._settled = False

    def optimize(self, tolerance: float = 1e-10) -> None:
        """Find the optimum by Gauss-Newton, each linear system by conjugate gradients.

        Parameters
        ----------
        tolerance : float
            The last step moves no pose further than this (m, rad).
        """
        tolerance = as_scalar("tolerance", tolerance, 0.0)
        if len(self._x) == 1:
            return
        free = np.arange(len(self._x)) > 0  # the first pose stays
        edges = Edges(self._edges, self._measurements, self._information)
        equations = NormalEquations(np.repeat(free[:, None], 3, 1), self._edges)
        x, converged = self._x, False
        for _ in range(_MAX_ITERATIONS):
            equations.fill(*edges.linearise(edges.at(x)))
            if self._factors is None or len(x) - self._n_old > _MANY_POSES:
                self._factors, self._n_old = factorised(equations.H), len(x)
                self.factorisations += 1
            dx, count = self._conjugate_gradients(equations, x)
            x = equations.moved(x, dx)
            if count > _MANY_STEPS:
                self._factors = None
            if np.abs(dx).max() <= tolerance:
                converged = True
                break
        self._x, self._settled, self.converged = x, True, converged

    # Helpers

    def _row(self, name: str, row: int) -> int:
        row = as_count(name, row)
        if row >= len(self._x):
            raise ValueError(f"{name}: expected one of {len(self._x)} poses, got {row}")
        return row

    def _append(self, i: int, j: int, z: Array, Omega: Array) -> None:
        self._edges = np.vstack([self._edges, [(i, j)]])
        self._measurements = np.vstack([self._measurements, z])
        self._information = np.concatenate([self._information, Omega[None]])

    def _conjugate_gradients(self, equations: NormalEquations, x: Array) -> tuple[Array, int]:
        """Solve H dx = -g to 1e-3 of it; return dx and the number of rounds."""
        rounds: list[Array] = []
        shape = (equations.N, equations.N)
        H = LinearOperator(shape, lambda v: times(equations.H, v), dtype=float)
        M = LinearOperator(shape, self._preconditioner(x), dtype=float)
        dx, _ = cg(H, -equations.g, rtol=1e-3, M=M, callback=rounds.append)
        return dx, len(rounds)

    def _preconditioner(self, x: Array) -> Callable[[Array], Array]:
        """Inverse of H as it was, with each newer pose hung on by the edge it came with.

        Where only such edges e = A x_parent + B x_new are new, H = T^T diag(H_old, Omega, ...) T:
        T takes x_new to e and leaves the old poses as they are.
        """
        new = np.arange(self._n_old, len(x))
        births = np.array(self._births)[new]
        parents = self._edges[births, 0]
        A, B = edge_jacobians(x[parents], x[new], self._measurements[births])
        inverse, cov = np.linalg.inv(B), np.linalg.inv(self._information[births])
        hung = list(zip(new, parents, A, inverse, cov, strict=True))

        def precondition(r: Array) -> Array:
            v = np.vstack([np.zeros(3), r.reshape(-1, 3)])
            for k, parent, A_k, B_inverse, _ in reversed(hung):  # T^-T
                v[k] = v[k] @ B_inverse
                v[parent] -= v[k] @ A_k
            v[0] = 0.0
            v[1 : self._n_old] = self._factors.solve(v[1 : self._n_old].ravel()).reshape(-1, 3)
            for k, parent, A_k, B_inverse, cov_k in hung:  # diag(..., Omega, ...)^-1, then T^-1
                v[k] = B_inverse @ (cov_k @ v[k] - A_k @ v[parent])
            return v[1:].ravel()

        return precondition
