"""Pose graphs: a trajectory from relative measurements, by nonlinear least squares.

Grisetti et al. 2010, "A tutorial on graph-based SLAM"; error as in g2o. P5 cites the method.
Chapter 00 uses it on real data, chapter 13 derives it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from slamlab._checks import Array, as_array, as_choice, as_count, as_covariance, as_scalar
from slamlab.slam import _g2o
from slamlab.slam._edges import Edges, edge_error, edge_jacobians
from slamlab.slam._g2o import Scans
from slamlab.slam._optimize import (
    KERNEL_WIDTH,
    KERNELS,
    NormalEquations,
    Optimization,
    Result,
)
from slamlab.slam._sparse import BlockSystem

__all__ = ["PoseGraph", "Result", "Scans", "edge_error", "edge_jacobians"]


class PoseGraph:
    """Poses joined by measured relative poses.

    Parameters
    ----------
    poses : array_like, shape (n, 3)
        Initial poses x, y (m), theta (rad) in the world.
    edges : array_like of int, shape (m, 2)
        Rows (i, j) of the poses that each measurement joins.
    measurements : array_like, shape (m, 3)
        Pose of j seen from i, as measured.
    information : array_like, shape (m, 3, 3) or (3, 3)
        Inverse covariances Omega of the measurements; one matrix serves all edges.
    ids : sequence of int, optional
        Names of the poses, for messages and files; 0, 1, ... by default.
    fixed : sequence of int, default (0,)
        Rows of the poses that stay where they are.
    scans : Scans, optional
        Lidar scans taken from the poses.

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite, an edge names no pose or joins a pose with
        itself, an id stands twice, or an information matrix is not positive semi-definite.

    Examples
    --------
    Two steps of one metre, and both together measured as 2.3 m:

    >>> graph = PoseGraph(
    ...     [[0, 0, 0], [1, 0, 0], [2, 0, 0]],
    ...     [[0, 1], [1, 2], [0, 2]],
    ...     [[1, 0, 0], [1, 0, 0], [2.3, 0, 0]],
    ...     np.eye(3),
    ... )
    >>> result = graph.optimize()
    >>> result.poses.round(3)[:, 0].tolist(), round(result.chi2, 4), result.converged
    ([0.0, 1.1, 2.2], 0.03, True)
    """

    def __init__(
        self,
        poses: ArrayLike,
        edges: ArrayLike,
        measurements: ArrayLike,
        information: ArrayLike,
        ids: Sequence[int] | None = None,
        fixed: Sequence[int] = (0,),
        scans: Scans | None = None,
    ) -> None:
        self.poses = as_array("poses", poses, ("n", 3)).astype(np.float64)
        n = len(self.poses)
        if n == 0:
            raise ValueError("poses: expected at least one pose, got none")
        self.ids = _checked_ids(ids, n)
        self.edges = _checked_edges(edges, n)
        m = len(self.edges)
        self.measurements = as_array("measurements", measurements, (m, 3)).astype(np.float64)
        self.information = _checked_information(information, m)
        self.fixed = tuple(sorted({_checked_row("fixed", row, n) for row in fixed}))
        if not self.fixed:
            raise ValueError("fixed: expected at least one pose, got none")
        if scans is not None and not isinstance(scans, Scans):
            raise ValueError(f"scans: expected Scans as read_g2o gives them, got {scans!r}")
        self.scans = scans

    def __repr__(self) -> str:
        return f"PoseGraph({len(self.poses)} poses, {len(self.edges)} edges)"

    @classmethod
    def read_g2o(cls, path: str | Path) -> PoseGraph:
        """Read a g2o or TORO file, plain, ``.gz`` or alone in a ``.zip``.

        VERTEX_SE2, EDGE_SE2, FIX, TORO's VERTEX2 and EDGE2 (whose information entries stand in
        another order) and ROBOTLASER1 (scan of the vertex before it) are read, in any order of
        lines; ``#`` begins a comment. Poses keep the order of the file. Without a FIX line the
        first pose is fixed.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        PoseGraph
            With `ids` as in the file and `scans` if it holds any.

        Raises
        ------
        ValueError
            For anything else in the file, with the number of the line: an unknown tag, a missing
            or extra field, no finite number, a vertex defined twice or not at all, a vertex that
            no edge reaches, information that is not positive semi-definite.
        FileNotFoundError
            If there is no such file.
        """
        content = _g2o.read(path)
        row = {identity: k for k, identity in enumerate(content.ids)}
        return cls(
            content.poses,
            [(row[i], row[j]) for i, j in content.edges],
            content.measurements,
            content.information,
            ids=content.ids,
            fixed=[row[identity] for identity in content.fixed] or (0,),
            scans=content.scans,
        )

    def write_g2o(self, path: str | Path) -> None:
        """Write the graph as g2o text; `read_g2o` gives back exactly this graph.

        Parameters
        ----------
        path : str or Path
        """
        ids = self.ids.tolist()
        content = _g2o.Content(
            ids=ids,
            poses=self.poses.tolist(),
            edges=[(ids[i], ids[j]) for i, j in self.edges.tolist()],
            measurements=self.measurements.tolist(),
            information=self.information.tolist(),
            fixed=[] if self.fixed == (0,) else [ids[row] for row in self.fixed],
            scans=self.scans,
        )
        _g2o.write(path, content)

    def with_poses(self, poses: ArrayLike) -> PoseGraph:
        """Return the same graph at other poses, for example those of a `Result`.

        Parameters
        ----------
        poses : array_like, shape (n, 3)

        Returns
        -------
        PoseGraph

        Raises
        ------
        ValueError
            If the shape is wrong or a number is not finite.
        """
        other = object.__new__(PoseGraph)
        other.__dict__.update(self.__dict__)
        other.poses = self._poses_or_own(poses).copy()
        return other

    def residuals(self, poses: ArrayLike | None = None) -> Array:
        """Return the errors e of all edges; see `edge_error`.

        Parameters
        ----------
        poses : array_like, shape (n, 3), optional
            The graph's own poses by default.

        Returns
        -------
        ndarray, shape (m, 3)
        """
        x = self._poses_or_own(poses)
        return edge_error(x[self.edges[:, 0]], x[self.edges[:, 1]], self.measurements)

    def chi2(self, poses: ArrayLike | None = None) -> float:
        """Sum of e^T Omega e over all edges (no factor 1/2).

        Parameters
        ----------
        poses : array_like, shape (n, 3), optional
            The graph's own poses by default.

        Returns
        -------
        float
        """
        edges = Edges(self.edges, self.measurements, self.information)
        return float(edges.linearise(self._poses_or_own(poses)).sum())

    def optimize(
        self,
        method: str = "gauss-newton",
        *,
        kernel: str | None = None,
        kernel_width: float = KERNEL_WIDTH,
        max_iterations: int = 50,
        tolerance: float = 1e-7,
    ) -> Result:
        """Move the free poses to the least cost; the graph itself stays as it is.

        Parameters
        ----------
        method : {"gauss-newton", "levenberg-marquardt"}
            Gauss-Newton takes every step, also one that raises the cost for a moment.
            Levenberg-Marquardt takes only steps that lower it.
        kernel : {None, "huber", "dcs"}
            Robust cost against false loop closures.
        kernel_width : float
            Mahalanobis distance of an edge from which the kernel begins to doubt it; for DCS its
            square is the Phi of Agarwal et al. 2013.
        max_iterations : int
            Steps at most.
        tolerance : float
            Converged when a step changes the cost by less than this part of it.

        Returns
        -------
        Result

        Raises
        ------
        ValueError
            If an argument is out of range, or if the measurements do not hold every pose: the
            graph is not connected to a fixed pose, or is singular. The message names the poses.
        """
        as_choice("method", method, ["gauss-newton", "levenberg-marquardt"])
        if kernel is not None:
            as_choice("kernel", kernel, list(KERNELS))
        kernel_width = as_scalar("kernel_width", kernel_width, np.finfo(float).tiny, 1e150)
        max_iterations = as_count("max_iterations", max_iterations)
        tolerance = as_scalar("tolerance", tolerance, 0.0, 1.0)
        # Poses of astronomic size overflow; they end in a message, not in a warning.
        with np.errstate(over="ignore", invalid="ignore"):
            run = Optimization(
                self.poses, self._equations(), kernel, kernel_width, max_iterations, tolerance
            )
            if len(run.equations.free) == 0:
                return run.result(True, "every pose is fixed")
            if method == "gauss-newton":
                return run.gauss_newton()
            return run.levenberg_marquardt()

    def marginal_cov(self, i: Any, poses: ArrayLike | None = None) -> Array:
        """Covariance of single poses, given all measurements: blocks of the inverse of H.

        Parameters
        ----------
        i : int or sequence of int
            Row or rows of poses.
        poses : array_like, shape (n, 3), optional
            Where to linearise, usually ``result.poses``; the graph's own poses by default.

        Returns
        -------
        ndarray, shape (3, 3) or (k, 3, 3)
            Covariance of x, y (m^2), theta (rad^2) in the world; zero for a fixed pose.

        Raises
        ------
        ValueError
            If a row is unknown or the graph is disconnected or singular.
        """
        n = len(self.poses)
        rows = np.array([_checked_row("i", row, n) for row in np.atleast_1d(i).tolist()])
        poses = self._poses_or_own(poses)
        equations = self._equations()
        place = np.full(n, -1)
        place[equations.free] = np.arange(len(equations.free))
        wanted = np.flatnonzero(place[rows] >= 0)
        covs = np.zeros((len(rows), 3, 3))
        if wanted.size:
            equations.linearise(poses)
            covs[wanted] = equations.inverse_blocks(place[rows[wanted]])
        return covs[0] if np.ndim(i) == 0 else covs

    # Helpers

    def _poses_or_own(self, poses: ArrayLike | None) -> Array:
        if poses is None:
            return self.poses
        return as_array("poses", poses, self.poses.shape)

    def _equations(self) -> NormalEquations:
        self._check_connected()
        edges = Edges(self.edges, self.measurements, self.information)
        free = np.setdiff1d(np.arange(len(self.poses)), self.fixed)
        return NormalEquations(edges, BlockSystem(len(self.poses), self.edges, free), self._names)

    def _check_connected(self) -> None:
        n, (i, j) = len(self.poses), self.edges.T
        links = csr_matrix((np.ones(len(i)), (i, j)), shape=(n, n))
        _, part = connected_components(links, directed=False)
        adrift = ~np.isin(part, part[list(self.fixed)])
        if adrift.any():
            raise ValueError(
                "edges: expected every pose to be joined to a fixed pose, "
                f"not joined: {self._names(np.flatnonzero(adrift))}"
            )

    def _names(self, rows: np.ndarray) -> str:
        names = ", ".join(str(self.ids[row]) for row in rows[:8])
        more = f" and {len(rows) - 8} more" if len(rows) > 8 else ""
        return f"{'poses' if len(rows) > 1 else 'pose'} {names}{more}"


# Checks at the door


def _checked_row(name: str, row: Any, n: int) -> int:
    row = as_count(name, row)
    if row >= n:
        raise ValueError(f"{name}: expected the row of one of {n} poses, got {row}")
    return row


def _checked_ids(ids: Sequence[int] | None, n: int) -> np.ndarray:
    if ids is None:
        return np.arange(n)
    array = np.asarray(ids)
    if array.shape != (n,) or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(
            f"ids: expected {n} whole numbers, got {array.dtype} of shape {array.shape}"
        )
    if (array < 0).any():
        raise ValueError(f"ids: expected numbers from 0 on, got {array.min()}")
    unique, counts = np.unique(array, return_counts=True)
    if len(unique) < n:
        raise ValueError(f"ids: expected each id once, got {unique[counts > 1][0]} twice")
    return array


def _checked_edges(edges: ArrayLike, n: int) -> np.ndarray:
    try:
        array = np.asarray(edges)
    except ValueError as error:
        raise ValueError("edges: expected pairs of rows, got rows of unequal length") from error
    if array.size == 0:
        array = np.zeros((0, 2), dtype=np.intp)
    if array.ndim != 2 or array.shape[1] != 2 or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(
            "edges: expected whole numbers of shape (m, 2), "
            f"got {array.dtype} of shape {array.shape}"
        )
    unknown = np.argwhere((array < 0) | (array >= n))
    if len(unknown):
        k, side = unknown[0]
        raise ValueError(f"edges: expected rows of {n} poses, got {array[k, side]} in edge {k}")
    same = np.flatnonzero(array[:, 0] == array[:, 1])
    if same.size:
        raise ValueError(
            f"edges: expected two different poses, edge {same[0]} joins pose "
            f"{array[same[0], 0]} with itself"
        )
    return array.astype(np.intp)


def _checked_information(information: ArrayLike, m: int) -> Array:
    array = as_array("information", information, ("...", 3, 3))
    if array.shape not in ((3, 3), (m, 3, 3)):
        raise ValueError(f"information: expected shape (3, 3) or ({m}, 3, 3), got {array.shape}")
    array = as_covariance("information", array, 3)
    return np.broadcast_to(array, (m, 3, 3)).astype(np.float64)
