"""A pose graph that grows: a pose or a closure is added without solving all anew.

The idea of iSAM (Kaess, Ranganathan and Dellaert 2008), that old factors stay good, by other
means: the factors of an old H precondition conjugate gradients on the new one, so that the result
is that of the whole graph, not of an approximation. It saves factorisations; in time it is no
faster than a batch from the last answer (1.5 times slower at 2000 poses). Chapter 13.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_count, as_covariance, as_scalar
from slamlab.geometry import compose
from slamlab.slam._edges import Edges, edge_jacobians
from slamlab.slam._sparse import BlockSystem, Solve
from slamlab.slam.graph import PoseGraph

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
        self._solve: Solve | None = None
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

        Raises
        ------
        ValueError
            If a shape is wrong, a number is not finite, the information is not positive
            definite, or there is no such pose.
        """
        n = len(self._x)
        previous = n - 1 if previous is None else self._row("previous", previous)
        z = as_array("measurement", measurement, (3,)).astype(np.float64)
        Omega = as_covariance("information", as_array("information", information, (3, 3)), 3)
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
            Rows of two poses.
        measurement : array_like, shape (3,)
            Pose j seen from pose i (m, m, rad).
        information : array_like, shape (3, 3)
            Inverse covariance.

        Raises
        ------
        ValueError
            If a shape is wrong, a number is not finite, the information is not positive
            semi-definite, or a pose does not exist or is joined with itself.
        """
        i, j = self._row("i", i), self._row("j", j)
        if i == j:
            raise ValueError(f"j: expected two different poses, got {i} twice")
        z = as_array("measurement", measurement, (3,)).astype(np.float64)
        Omega = as_covariance("information", as_array("information", information, (3, 3)), 3)
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
        edges = Edges(self._edges, self._measurements, self._information)
        self.converged = False
        precondition: Solve | None = None
        for _ in range(_MAX_ITERATIONS):
            edges.linearise(self._x)
            if self._solve is None or len(self._x) - self._n_old > _MANY_POSES:
                self._factorise(edges)
                precondition = None
            precondition = precondition or self._preconditioner()
            step, count = self._conjugate_gradients(edges, precondition)
            self._x = self._x + step
            if np.abs(step).max() <= tolerance:
                self.converged = True
                break
            if count > _MANY_STEPS:
                self._solve = None
        self._x[:, 2] = np.arctan2(np.sin(self._x[:, 2]), np.cos(self._x[:, 2]))
        self._settled = True

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

    def _factorise(self, edges: Edges) -> None:
        system = BlockSystem(len(self._x), self._edges, np.arange(1, len(self._x)))
        self._solve = system.factorise(system.matrix(edges.blocks()), check=False)
        self._n_old = len(self._x)
        self.factorisations += 1

    def _conjugate_gradients(self, edges: Edges, precondition: Solve) -> tuple[Array, int]:
        """Solve H step = -gradient to 1e-3 of it; return the step and the number of rounds."""
        blocks = edges.blocks()
        r = -edges.gradient()
        r[0] = 0.0  # the first pose stays
        step, z = np.zeros_like(r), precondition(r)
        p, power, count = z, np.vdot(r, z), 0
        enough = 1e-6 * power
        while power > enough and count < 3 * len(r):
            Hp = _times(blocks, edges, p)
            length = power / np.vdot(p, Hp)
            step, r = step + length * p, r - length * Hp
            z = precondition(r)
            power, before = np.vdot(r, z), power
            p = z + power / before * p
            count += 1
        return step, count

    def _preconditioner(self) -> Solve:
        """Inverse of H as it was, with each newer pose hung on by the edge it came with.

        Where only such edges are new, H = T^T diag(H_old, Omega, ...) T. A new pose has one row
        B x + A x_parent in T: with C those to old parents, N those among the new poses,
        x_new = N^-1 (y - C x_old).
        """
        n_old, new = self._n_old, np.arange(self._n_old, len(self._x))
        births = np.array(self._births, dtype=int)[new]
        parents = self._edges[births, 0]
        A, B = edge_jacobians(self._x[parents], self._x[new], self._measurements[births])
        k, old = np.arange(len(new)), parents < n_old
        N = np.zeros((len(new), 3, len(new), 3))
        N[k, :, k, :] = B
        N[k[~old], :, parents[~old] - n_old, :] = A[~old]
        inverse = np.linalg.inv(N.reshape(3 * len(new), 3 * len(new)))
        spread = np.linalg.inv(self._information[births])
        A_old, parents = A[old], parents[old]
        solve = self._solve
        assert solve is not None

        def precondition(r: Array) -> Array:
            x, r_old = np.zeros_like(r), r[:n_old].copy()
            y = (r[n_old:].ravel() @ inverse).reshape(-1, 3)
            np.subtract.at(r_old, parents, np.einsum("kba,kb->ka", A_old, y[old]))
            if n_old > 1:
                x[1:n_old] = solve(r_old[1:])
            y = np.einsum("kab,kb->ka", spread, y)
            y[old] -= np.einsum("kab,kb->ka", A_old, x[parents])
            x[n_old:] = (inverse @ y.ravel()).reshape(-1, 3)
            return x

        return precondition


def _times(blocks: Array, edges: Edges, v: Array) -> Array:
    """H v for all poses but the first, which stays."""
    at_i, at_j = v[edges.i].T, v[edges.j].T
    to_i = np.einsum("abm,bm->am", blocks[0], at_i) + np.einsum("abm,bm->am", blocks[2], at_j)
    to_j = np.einsum("abm,bm->am", blocks[3], at_i) + np.einsum("abm,bm->am", blocks[1], at_j)
    n = len(v)
    y = np.stack(
        [
            np.bincount(edges.i, a, n) + np.bincount(edges.j, b, n)
            for a, b in zip(to_i, to_j, strict=True)
        ],
        1,
    )
    y[0] = 0.0
    return y
