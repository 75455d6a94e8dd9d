"""Pose graphs: a trajectory from relative measurements, by nonlinear least squares.

Grisetti et al. 2010, "A tutorial on graph-based SLAM"; error as in g2o. P5 cites the method.
Chapter 00 uses it on real data, chapter 13 derives it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from slamlab._checks import Array, as_array, as_choice, as_count, as_covariance, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.slam import _g2o
from slamlab.slam._edges import Edges, edge_error, edge_jacobians
from slamlab.slam._g2o import Scans
from slamlab.slam._sparse import BlockSystem, SingularError

__all__ = ["PoseGraph", "Result", "Scans", "edge_error", "edge_jacobians"]

# 95 % of honest errors (three degrees of freedom) lie within this Mahalanobis distance.
_KERNEL_WIDTH = 2.7955
# Gauss-Newton keeps its factors after a step that changed the cost by less than this part.
_NEAR = 0.1
# Levenberg-Marquardt gives up beyond this multiple of the diagonal.
_LARGEST_DAMPING = 1e12


@dataclass(frozen=True, eq=False)
class Result:
    """What an optimisation ended with.

    Attributes
    ----------
    poses : ndarray, shape (n, 3)
        Optimised poses: x, y (m), theta (rad) in the world.
    chi2 : float
        Sum of e^T Omega e at `poses`, without any kernel.
    history : ndarray, shape (iterations + 1,)
        What was minimised, before the first step and after every step: chi2 itself, or with a
        robust kernel the kernel's cost.
    iterations : int
        Number of steps taken.
    converged : bool
        True only if the last step changed the cost by less than the tolerance.
    weights : ndarray, shape (m,)
        Weight of every edge in the last step, in [0, 1]; all 1 without a kernel.
    message : str
        Why it stopped, in words.
    """

    poses: Array
    chi2: float
    history: Array
    iterations: int
    converged: bool
    weights: Array
    message: str


# Robust kernels: cost and weight of an edge as functions of its x = e^T Omega e.


def _huber(x: Array, width: float) -> tuple[Array, Array]:
    # rho = x within the width k, 2 k sqrt(x) - k^2 beyond; weight = d rho / d x
    distance = np.sqrt(x)
    beyond = distance > width
    weight = np.where(beyond, width / np.where(beyond, distance, 1.0), 1.0)
    return np.where(beyond, 2 * width * distance - width**2, x), weight


def _dcs(x: Array, width: float) -> tuple[Array, Array]:
    # Agarwal et al. 2013: weight = s^2 with s = min(1, 2 Phi / (Phi + x)); rho is its integral.
    phi = width**2
    weight = np.minimum(1.0, 2 * phi / (phi + x)) ** 2
    return np.where(x > phi, phi * (3 * x - phi) / (phi + x), x), weight


_KERNELS: dict[str, Callable[[Array, float], tuple[Array, Array]]] = {
    "huber": _huber,
    "dcs": _dcs,
}


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
    Three poses, measured in a circle whose measurements do not quite close:

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
        return float(self._edge_arrays().linearise(self._poses_or_own(poses)).sum())

    def optimize(
        self,
        method: str = "gauss-newton",
        *,
        kernel: str | None = None,
        kernel_width: float = _KERNEL_WIDTH,
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
            as_choice("kernel", kernel, ["huber", "dcs"])
        kernel_width = as_scalar("kernel_width", kernel_width, np.finfo(float).tiny, 1e150)
        max_iterations = as_count("max_iterations", max_iterations)
        tolerance = as_scalar("tolerance", tolerance, 0.0, 1.0)
        # Poses of astronomic size overflow; they end in a message, not in a warning.
        with np.errstate(over="ignore", invalid="ignore"):
            run = _Optimization(self, kernel, kernel_width, max_iterations, tolerance)
            if run.system.n == 0:
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
        system = self._system()
        if system.n == 0:
            return np.zeros((*np.shape(i), 3, 3))
        place = np.full(n, -1)
        place[system.free] = np.arange(system.n)
        wanted = np.flatnonzero(place[rows] >= 0)
        covs = np.zeros((len(rows), 3, 3))
        linear = self._edge_arrays()
        linear.linearise(self._poses_or_own(poses))
        solve = self._factorise(system, linear.blocks())
        for start in range(0, len(wanted), 32):
            part = wanted[start : start + 32]
            at = place[rows[part]]
            unit = np.zeros((system.n, 3, len(part), 3))
            unit[at, :, np.arange(len(part)), :] = np.eye(3)
            columns = solve(unit.reshape(system.n, 3, -1)).reshape(unit.shape)
            covs[part] = columns[at, :, np.arange(len(part)), :]
        covs = 0.5 * (covs + np.swapaxes(covs, 1, 2))
        return covs[0] if np.ndim(i) == 0 else covs

    # Helpers

    def _poses_or_own(self, poses: ArrayLike | None) -> Array:
        if poses is None:
            return self.poses
        return as_array("poses", poses, self.poses.shape)

    def _system(self) -> BlockSystem:
        free = np.setdiff1d(np.arange(len(self.poses)), self.fixed)
        self._check_connected()
        return BlockSystem(len(self.poses), self.edges, free)

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

    def _edge_arrays(self) -> Edges:
        return Edges(self.edges, self.measurements, self.information)

    def _factorise(
        self, system: BlockSystem, blocks: Array, damping: float = 0.0, check: bool = True
    ) -> Callable[[Array], Array]:
        H = system.matrix(blocks, damping)
        if not np.isfinite(H.data).all():
            raise ValueError("poses: expected a graph of moderate size, the equations overflow")
        try:
            return system.factorise(H, check)
        except SingularError as error:
            raise ValueError(
                "information: the measurements do not determine the graph, "
                f"free to move: {self._names(error.rows)}"
            ) from error


class _Optimization:
    """One run of `PoseGraph.optimize`: its state, and the two algorithms that move it."""

    def __init__(
        self,
        graph: PoseGraph,
        kernel: str | None,
        kernel_width: float,
        max_iterations: int,
        tolerance: float,
    ) -> None:
        self.graph = graph
        self.kernel = None if kernel is None else _KERNELS[kernel]
        self.kernel_width = kernel_width
        self.max_iterations = max_iterations
        self.tolerance = tolerance
        self.system = graph._system()
        self.edges = graph._edge_arrays()
        self.weights: Array | None = None
        self.history = [self.move_to(graph.poses)]
        # What is left of the cost when all measurements agree and only rounding is seen.
        trace = np.trace(graph.information, axis1=1, axis2=2).sum()
        ulp = 4 * np.finfo(float).eps * max(1.0, np.abs(graph.poses).max())
        self.rounding = float(trace) * ulp**2
        self.solve: Callable[[Array], Array] | None = None
        self.gain = np.inf

    def move_to(self, poses: Array) -> float:
        """Linearise at `poses`; return the cost there."""
        squared = self.edges.linearise(poses)
        self.chi2 = float(squared.sum())
        self.poses = poses
        if self.kernel is None:
            return self.chi2
        rho, self.weights = self.kernel(squared, self.kernel_width)
        return float(rho.sum())

    def factorise(self, damping: float = 0.0) -> Callable[[Array], Array]:
        blocks = self.edges.blocks(self.weights)
        first = len(self.history) == 1
        return self.graph._factorise(self.system, blocks, damping, check=first)

    def gradient(self) -> Array:
        return self.edges.gradient(self.weights)[self.system.free]

    def stepped(self, step: Array) -> Array:
        poses = self.poses.copy()
        poses[self.system.free] += step
        poses[:, 2] = wrap_angle(poses[:, 2])
        return poses

    def settled(self, before: float, after: float) -> bool:
        return abs(before - after) <= self.tolerance * before + self.rounding

    def gauss_newton(self) -> Result:
        """Solve H step = -gradient and move, until neither the cost nor its model changes."""
        for _ in range(self.max_iterations):
            step = self.gauss_newton_step()
            if not np.isfinite(step).all():
                return self.result(False, "diverged: a step was not finite")
            before = self.history[-1]
            self.history.append(self.move_to(self.stepped(step)))
            if self.settled(before, self.history[-1]) and self.settled(before, before - self.gain):
                return self.result(True, "converged")
        return self.result(False, f"stopped after {self.max_iterations} iterations")

    def gauss_newton_step(self) -> Array:
        """H^-1 (-gradient), with old factors of H where they still serve.

        Near the end H hardly changes. Its factors stay as long as each step with them promises
        less than a tenth of the gain of the step before.
        """
        gradient = self.gradient()
        before, here = self.history[-2:] if len(self.history) > 1 else (np.inf, 0.0)
        if self.solve is not None and abs(before - here) < _NEAR * before:
            step = self.solve(-gradient)
            gain = -float(np.vdot(gradient, step))
            if gain <= 0.1 * self.gain:
                self.gain = gain
                return step
        self.solve = self.factorise()
        step = self.solve(-gradient)
        self.gain = -float(np.vdot(gradient, step))
        return step

    def levenberg_marquardt(self) -> Result:
        """Gauss-Newton with a damped diagonal; only steps that do not raise the cost are taken."""
        damping = 1e-4
        self.factorise()  # damping would hide a singular graph
        for _ in range(self.max_iterations):
            before = self.history[-1]
            cost, damping = self.damped_step(damping)
            if damping > _LARGEST_DAMPING:
                return self.result(False, "no step lowers the cost")
            self.history.append(cost)
            if self.settled(before, cost) and damping < 1.0:
                return self.result(True, "converged")
            damping = max(damping / 10, 1e-12)
        return self.result(False, f"stopped after {self.max_iterations} iterations")

    def damped_step(self, damping: float) -> tuple[float, float]:
        """Raise the damping until a step does not raise the cost; take that step."""
        before, here, gradient = self.history[-1], self.poses, self.gradient()
        while damping <= _LARGEST_DAMPING:
            cost = self.move_to(self.stepped(self.factorise(damping)(-gradient)))
            if cost <= before * (1 + 1e-12) + self.rounding:
                return cost, damping
            self.move_to(here)
            damping *= 10
        return before, damping

    def result(self, converged: bool, message: str) -> Result:
        weights = np.ones(len(self.graph.edges)) if self.weights is None else self.weights
        return Result(
            poses=self.poses.copy(),
            chi2=self.chi2,
            history=np.array(self.history),
            iterations=len(self.history) - 1,
            converged=converged,
            weights=weights,
            message=message,
        )


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
    array = np.asarray(edges)
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
