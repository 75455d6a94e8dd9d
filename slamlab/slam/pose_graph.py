"""Pose graphs: a trajectory and landmarks from relative measurements, by least squares.

Grisetti et al. 2010, "A tutorial on graph-based SLAM"; P5 cites the method. `least_squares` holds
the algorithm. Chapter 00 uses it on real data, chapter 13 derives it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components

from slamlab._checks import (
    Array,
    as_array,
    as_choice,
    as_count,
    as_covariance,
    as_positive,
    as_scalar,
    as_tuple,
)
from slamlab.geometry import inverse_transform
from slamlab.logs import Log
from slamlab.models import LandmarkSensor, MotionModel
from slamlab.slam import g2o
from slamlab.slam._graph_of import graph_of
from slamlab.slam.certificate import (
    Certificate,
    Relaxation,
    certify,
    isotropic,
    tangent_quadratic,
)
from slamlab.slam.g2o import Scans
from slamlab.slam.least_squares import (
    KERNEL_WIDTH,
    KERNELS,
    METHODS,
    Edges,
    NormalEquations,
    Outcome,
    edge_error,
    gauss_newton,
    likeliest,
    quadratic,
)

__all__ = ["PoseGraph", "Result"]

# A robust kernel that leaves an edge less than this weight has rejected it.
REJECTED = 0.1


@dataclass(frozen=True, eq=False)
class Result:
    """What an optimisation ended with.

    Attributes
    ----------
    poses : ndarray, shape (n, 3)
        Optimised poses: x, y (m), theta (rad) in the world.
    landmarks : ndarray, shape (k, 2)
        Optimised landmarks: x, y (m) in the world.
    chi2 : float
        Sum of e^T Omega e at the end, without any kernel.
    history : ndarray, shape (iterations + 1,)
        What was minimised, before the first step and after every step: chi2 itself, or with a
        robust kernel the kernel's cost (of the last width, where there are several).
    iterations : int
        Number of steps taken (with the last width).
    converged : bool
        True only if the last step, and what its linear model promised, changed the cost by less
        than the tolerance. It says nothing of other minima: that is what `certified` is for.
    weights : ndarray, shape (m,)
        Weight in [0, 1] that the kernel gives each edge at the end; all 1 without a kernel.
    landmark_weights : ndarray, shape (s,)
        The same for the edges to landmarks.
    message : str
        Why it stopped, in words.
    n_rejected : int
        How many closures (see `PoseGraph.closures`) have a weight below 0.1.

    Examples
    --------
    >>> graph = PoseGraph([[0, 0, 0], [1.2, 0, 0]], [[0, 1]], [[1.0, 0, 0]], [np.eye(3)])
    >>> result = graph.optimize()
    >>> result.converged, result.poses.round(6).tolist()
    (True, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    """

    poses: Array
    landmarks: Array
    chi2: float
    history: Array
    iterations: int
    converged: bool
    weights: Array
    landmark_weights: Array
    message: str
    n_rejected: int
    _certify: Callable[[], Certificate] = field(repr=False)

    @cached_property
    def certificate(self) -> Certificate:
        """Bound from below on the chi2 of any poses; see `PoseGraph.certificate`."""
        return self._certify()

    @property
    def certified(self) -> bool:
        """True if this is proved to be the least cost of all, to 1 %; False proves nothing.

        Rejected and doubted edges count with their weights. Where numbers are too far apart for a
        bound (`certificate` says so), nothing is proved.
        """
        try:
            return self.certificate.certified
        except ValueError:
            return False


class PoseGraph:
    """Poses joined by measured relative poses, and landmarks seen from them.

    Parameters
    ----------
    poses : array_like, shape (n, 3)
        Initial poses x, y (m), theta (rad) in the world.
    edges : array_like of int, shape (m, 2)
        Rows (i, j) of the two different poses that each measurement joins.
    measurements : array_like, shape (m, 3)
        Pose of j seen from i, as measured.
    information : array_like, shape (m, 3, 3) or (3, 3)
        Inverse covariances Omega of the measurements, positive semi-definite; one matrix serves
        all edges.
    ids : sequence of int, optional
        Names of the poses, each once, for messages and files; 0, 1, ... by default.
    fixed : sequence of int, default (0,)
        Rows of the poses that stay where they are.
    scans : Scans, optional
        Lidar scans taken from the poses.
    landmarks : array_like, shape (k, 2), optional
        Initial places x, y (m) of landmarks in the world; none by default.
    landmark_edges : array_like of int, shape (s, 2)
        Row of the pose from which, and row of the landmark which was seen.
    landmark_measurements : array_like, shape (s, 2)
        Landmark as seen: x ahead, y to the left of the pose (m).
    landmark_information : array_like, shape (s, 2, 2) or (2, 2)
        Inverse covariances of these measurements (1/m^2), positive semi-definite.
    landmark_ids : sequence of int, optional
        Names of the landmarks, each once and none a pose's; by default the numbers after those of
        the poses.

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
        *,
        landmarks: ArrayLike | None = None,
        landmark_edges: ArrayLike | None = None,
        landmark_measurements: ArrayLike | None = None,
        landmark_information: ArrayLike = ((1.0, 0.0), (0.0, 1.0)),
        landmark_ids: Sequence[int] | None = None,
    ) -> None:
        self.poses = as_array("poses", poses, ("n", 3)).astype(np.float64)
        n = len(self.poses)
        if n == 0:
            raise ValueError("poses: expected at least one pose, got none")
        self.ids = _checked_ids("ids", ids, n, 0)
        self.edges = _checked_edges("edges", edges, (n, n), "poses")
        loop = np.flatnonzero(self.edges[:, 0] == self.edges[:, 1])
        if loop.size:
            itself = f"edge {loop[0]} joins pose {self.edges[loop[0], 0]} with itself"
            raise ValueError(f"edges: expected two different poses, {itself}")
        m = len(self.edges)
        self.measurements = as_array("measurements", measurements, (m, 3)).astype(np.float64)
        self.information = _checked_information("information", information, m, 3)
        self.fixed = tuple(sorted(_checked_rows("fixed", fixed, n).tolist()))
        if not self.fixed:
            raise ValueError("fixed: expected at least one pose, got none")
        if scans is not None and not isinstance(scans, Scans):
            raise ValueError(f"scans: expected Scans as read_g2o gives them, got {scans!r}")
        self.scans = scans
        nothing = np.zeros((0, 2))
        points = nothing if landmarks is None else landmarks
        self.landmarks = as_array("landmarks", points, ("k", 2)).astype(np.float64)
        k = len(self.landmarks)
        links = nothing if landmark_edges is None else landmark_edges
        self.landmark_edges = _checked_edges("landmark_edges", links, (n, k), "landmarks")
        seen = nothing if landmark_measurements is None else landmark_measurements
        s = len(self.landmark_edges)
        self.landmark_measurements = as_array("landmark_measurements", seen, (s, 2)).astype(float)
        self.landmark_information = _checked_information(
            "landmark_information", landmark_information, s, 2
        )
        after = int(self.ids.max()) + 1
        self.landmark_ids = _checked_ids("landmark_ids", landmark_ids, k, after)
        common = np.intersect1d(self.ids, self.landmark_ids)
        if common.size:
            raise ValueError(f"landmark_ids: expected ids that no pose has, got {common[0]}")

    def __repr__(self) -> str:
        text = f"{len(self.poses)} poses, {len(self.edges)} edges"
        if len(self.landmarks):
            text += f", {len(self.landmarks)} landmarks seen {len(self.landmark_edges)} times"
        return f"PoseGraph({text})"

    @classmethod
    def from_log(
        cls,
        log: Log,
        motion: MotionModel,
        sensor: LandmarkSensor | None = None,
        start: ArrayLike = (0.0, 0.0, 0.0),
    ) -> PoseGraph:
        """Make the graph of a log: a pose a motion, an edge a control, an edge a measurement.

        Parameters
        ----------
        log : Log
            Of one run. A step with dt = 0 adds no pose. Measurements need ids; those below 0 are
            left out.
        motion : MotionModel
            Its noise must reach all three coordinates.
        sensor : LandmarkSensor, optional
            What the log's measurements mean; without it only the motions count.
        start : array_like, shape (3,)
            First pose, which is fixed.

        Returns
        -------
        PoseGraph
            At dead reckoning, each landmark where it was first seen from there.

        Raises
        ------
        ValueError
            If a motion or a measurement has no noise in some direction.
        """
        return cls(**graph_of(log, motion, sensor, as_array("start", start, (3,))))

    @classmethod
    def read_g2o(cls, path: str | Path) -> PoseGraph:
        """Read a g2o or TORO file, plain, ``.gz`` or alone in a ``.zip``.

        VERTEX_SE2, EDGE_SE2, FIX, VERTEX_XY and EDGE_SE2_XY (landmarks), TORO's VERTEX2 and EDGE2
        (whose information entries stand in another order) and ROBOTLASER1 (scan of the vertex
        before it) are read, in any order of
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
        return cls(**g2o.read(path))

    def write_g2o(self, path: str | Path) -> None:
        """Write the graph as g2o text; `read_g2o` gives back exactly this graph.

        Parameters
        ----------
        path : str or Path
        """
        g2o.write(path, self)

    def with_poses(self, poses: ArrayLike, landmarks: ArrayLike | None = None) -> PoseGraph:
        """Return the same graph at other poses, for example those of a `Result`.

        Parameters
        ----------
        poses : array_like, shape (n, 3)
        landmarks : array_like, shape (k, 2), optional
            The graph's own landmarks by default.

        Returns
        -------
        PoseGraph
        """
        other, stacked = copy(self), self._stack(poses, landmarks)
        n = len(self.poses)
        other.poses, other.landmarks = stacked[:n].copy(), stacked[n:, :2].copy()
        return other

    def chordal_initialisation(self) -> PoseGraph:
        """Return the same graph at poses and landmarks found without any start, linearly.

        If headings are complex numbers and the information is isotropic, the cost is quadratic
        but for ``|u| = 1``. Forget this and solve, once for headings and positions together and
        once for the headings alone (Carlone et al. 2015), make ``|u| = 1`` again, and solve for
        the positions. The better of both is returned; the first fixed pose stays where it is.

        Returns
        -------
        PoseGraph

        Raises
        ------
        ValueError
            If the measurements do not join every pose to a fixed pose.
        """
        self._check_connected()
        edges, measurements, information = self._all_edges()
        tau, kappa = isotropic(information)
        n, k, guesses = len(self.poses), len(self.landmarks), []
        for weight in (1.0, 1e-9):
            relaxation = Relaxation(edges, measurements, weight * tau, kappa, n, k)
            with np.errstate(all="ignore"):
                try:
                    x = relaxation.guess(self._stack(None, None), self.fixed[0])
                except ValueError:  # singular without the other half of the measurements
                    continue
            if np.isfinite(x).all():
                guesses.append(self.with_poses(x[:n], x[n:, :2]))
        return min([*guesses, self], key=lambda graph: graph.chi2())

    def residuals(self, poses: ArrayLike | None = None) -> Array:
        """Return the errors e of all edges between poses; see `edge_error`.

        Parameters
        ----------
        poses : array_like, shape (n, 3), optional
            The graph's own poses by default.

        Returns
        -------
        ndarray, shape (m, 3)
        """
        x = self._stack(poses, None)
        return edge_error(x[self.edges[:, 0]], x[self.edges[:, 1]], self.measurements)

    def landmark_residuals(
        self, poses: ArrayLike | None = None, landmarks: ArrayLike | None = None
    ) -> Array:
        """Return the errors R_i^T (l - t_i) - z of all edges to landmarks.

        Parameters
        ----------
        poses : array_like, shape (n, 3), optional
        landmarks : array_like, shape (k, 2), optional
            The graph's own by default.

        Returns
        -------
        ndarray, shape (s, 2)
            Metres, in the frame of the pose.
        """
        x = self._stack(poses, landmarks)
        i, j = self.landmark_edges.T
        seen = inverse_transform(x[i], x[len(self.poses) + j, None, :2])[:, 0]
        return seen - self.landmark_measurements

    @property
    def closures(self) -> np.ndarray:
        """Which edges (m,) join two poses that do not follow each other in the rows."""
        return np.abs(self.edges[:, 1] - self.edges[:, 0]) != 1

    def chi2(self, poses: ArrayLike | None = None, landmarks: ArrayLike | None = None) -> float:
        """Sum of e^T Omega e over all edges (no factor 1/2).

        Parameters
        ----------
        poses : array_like, shape (n, 3), optional
        landmarks : array_like, shape (k, 2), optional
            The graph's own by default.

        Returns
        -------
        float
        """
        return float(Edges(*self._all_edges()).at(self._stack(poses, landmarks)).cost)

    def optimize(
        self,
        method: str = "gauss-newton",
        *,
        kernel: str | None = None,
        kernel_width: float | Sequence[float] = KERNEL_WIDTH,
        hypotheses: Sequence[Sequence[int]] = (),
        max_iterations: int = 100,
        tolerance: float = 1e-12,
    ) -> Result:
        """Move the free poses and landmarks to the least cost; the graph itself stays as it is.

        Parameters
        ----------
        method : {"gauss-newton", "levenberg-marquardt"}
            Gauss-Newton takes every step, also one that raises the cost for a moment.
            Levenberg-Marquardt takes only steps that lower it.
        kernel : {None, "huber", "dcs", "max-mixture"}
            Robust cost against false loop closures: Huber's; dynamic covariance scaling; or the
            best of the edge and of "false" (Olson and Agarwal 2013), which rejects an edge wholly
            or not at all.
        kernel_width : float or sequence of float
            Mahalanobis distance of an edge from which the kernel weighs it down; for DCS its
            square is the Phi of Agarwal et al. 2013. Of several, each begins where the one before
            ended: from a drifted start, wide ones first.
        hypotheses : sequence of sequences of int
            Groups of edges (rows) of which one each is true: only the likeliest counts.
        max_iterations : int
            Steps at most, for each width.
        tolerance : float
            Converged when a step changes the cost by less than this part of it.

        Returns
        -------
        Result

        Warns
        -----
        UserWarning
            If a kernel has rejected more than half of the closures: then the start may have been
            too far off to tell true ones from false ones.

        Raises
        ------
        ValueError
            If the measurements do not hold every pose: the graph is not connected to a fixed pose,
            or is singular. The message names the poses.
        """
        as_choice("method", method, list(METHODS))
        robust = None if kernel is None else KERNELS[as_choice("kernel", kernel, list(KERNELS))]
        widths = [as_positive("kernel_width", w, 1e150) for w in np.atleast_1d(kernel_width)]
        if not widths:
            raise ValueError("kernel_width: expected at least one width, got none")
        max_iterations = as_count("max_iterations", max_iterations)
        tolerance = as_scalar("tolerance", tolerance, 0.0, 1.0)
        edges, measurements, information = self._all_edges()
        groups = self._groups(hypotheses)
        equations = self._equations(edges, self.fixed)
        x = self._stack(None, None)
        # Poses of astronomic size overflow; they end in a message, not in a warning.
        with np.errstate(over="ignore", invalid="ignore"):
            for width in widths if robust else widths[:1]:
                rho = quadratic if robust is None else partial(robust, width=width)
                if groups:
                    log_det = np.linalg.slogdet(information)[1]
                    rho = partial(likeliest, kernel=rho, groups=groups, log_det=log_det)
                own = Edges(edges, measurements, information, rho)
                if equations.N == 0:
                    here = own.at(x)
                    found = Outcome(here, [here.cost], True, "every pose is fixed")
                else:
                    found = METHODS[method](x, own, equations, max_iterations, tolerance)
                x = found.estimate.x
        return self._result(found, robust is not None)

    def certificate(
        self, poses: ArrayLike | None = None, landmarks: ArrayLike | None = None
    ) -> Certificate:
        """Bound the chi2 of any poses from below, and compare these poses with it.

        The bound is that of SE-Sync's dual problem (Rosen et al. 2019) for a stand-in with
        isotropic information and headings measured by the chord. Edge by edge it costs no more
        than the graph, and at these poses (where they settle) exactly as much. The bound always
        holds; at a local minimum, and with errors of many degrees, it may lie far below.

        Parameters
        ----------
        poses : array_like, shape (n, 3), optional
        landmarks : array_like, shape (k, 2), optional
            Usually those of a `Result`; the graph's own by default.

        Returns
        -------
        Certificate

        Raises
        ------
        ValueError
            If the graph is disconnected or singular.
        """
        weights = np.ones(len(self.edges) + len(self.landmark_edges))
        return self._certificate(self._stack(poses, landmarks), weights)

    def marginal_cov(
        self, i: Any, poses: ArrayLike | None = None, landmarks: ArrayLike | None = None
    ) -> Array:
        """Covariance of single poses, given all measurements: blocks of the inverse of H.

        Parameters
        ----------
        i : int or sequence of int
            Row or rows of poses.
        poses : array_like, shape (n, 3), optional
        landmarks : array_like, shape (k, 2), optional
            Where to linearise, usually at a `Result`; at the graph's own by default.

        Returns
        -------
        ndarray, shape (3, 3) or (len(i), 3, 3)
            Covariance of x, y (m^2), theta (rad^2) in the world; zero for a fixed pose.

        Raises
        ------
        ValueError
            If the graph is disconnected or singular.
        """
        return self._marginals(i, len(self.poses), 0, self._stack(poses, landmarks))

    def landmark_cov(
        self, i: Any, poses: ArrayLike | None = None, landmarks: ArrayLike | None = None
    ) -> Array:
        """Covariance of single landmarks, as `marginal_cov` of poses.

        Parameters
        ----------
        i : int or sequence of int
            Row or rows of landmarks.
        poses : array_like, shape (n, 3), optional
        landmarks : array_like, shape (k, 2), optional
            Where to linearise.

        Returns
        -------
        ndarray, shape (2, 2) or (len(i), 2, 2)
            Covariance of x, y (m^2) in the world.

        Raises
        ------
        ValueError
            If the graph is disconnected or singular.
        """
        k, n = len(self.landmarks), len(self.poses)
        return self._marginals(i, k, n, self._stack(poses, landmarks))[..., :2, :2]

    # Helpers

    def _stack(self, poses: ArrayLike | None, landmarks: ArrayLike | None) -> Array:
        """Poses, then landmarks as poses whose heading nothing measures, shape (n + k, 3)."""
        x = self.poses if poses is None else as_array("poses", poses, self.poses.shape)
        points = self.landmarks
        if landmarks is not None:
            points = as_array("landmarks", landmarks, points.shape)
        return np.vstack([x, np.pad(points, ((0, 0), (0, 1)))])

    def _all_edges(self) -> tuple[np.ndarray, Array, Array]:
        """Edges, measurements and information between the rows of `_stack`."""
        if len(self.landmark_edges) == 0:
            return self.edges, self.measurements, self.information
        pad = ((0, 0), (0, 1))
        return (
            np.vstack([self.edges, self.landmark_edges + [0, len(self.poses)]]),
            np.vstack([self.measurements, np.pad(self.landmark_measurements, pad)]),
            np.vstack([self.information, np.pad(self.landmark_information, (*pad, (0, 1)))]),
        )

    def _equations(self, edges: np.ndarray, fixed: Sequence[int]) -> NormalEquations:
        self._check_connected()
        free = np.ones((len(self.poses) + len(self.landmarks), 3), dtype=bool)
        free[list(fixed)] = free[len(self.poses) :, 2] = False  # nothing measures these headings
        return NormalEquations(free, edges, self._names)

    def _result(self, found: Outcome, robust: bool) -> Result:
        here, n, m, message = found.estimate, len(self.poses), len(self.edges), found.message
        closures = self.closures & robust
        rejected = int((here.weights[:m][closures] < REJECTED).sum())
        if rejected > 0.5 * closures.sum():
            warnings.warn(
                f"the kernel rejected {rejected} of {closures.sum()} closures: from a drifted "
                "start true ones look false; a wider kernel_width rejects fewer of them and may "
                "believe false ones, chordal_initialisation() helps where no closure is false",
                stacklevel=3,
            )
        if rejected:
            message += f"; {rejected} of {closures.sum()} closures rejected"
        return Result(
            poses=here.x[:n].copy(),
            landmarks=here.x[n:, :2].copy(),
            chi2=float(here.squared.sum()),
            history=np.array(found.history),
            iterations=len(found.history) - 1,
            converged=found.converged,
            weights=here.weights[:m],
            landmark_weights=here.weights[m:],
            message=message,
            n_rejected=rejected,
            _certify=partial(self._certificate, here.x, here.weights),
        )

    def _certificate(self, x: Array, weights: Array) -> Certificate:
        """Certificate for the edges as weighted; the bound is taken where x settles."""
        edges, measurements, information = self._all_edges()
        information = weights[:, None, None] * information
        equations = self._equations(edges, self.fixed[:1])
        own = Edges(edges, measurements, information)
        found = gauss_newton(x, own, equations, 10 if equations.N else 0, 1e-12)
        here = found.estimate
        measurements, tau, kappa, offset = tangent_quadratic(here.e.T, measurements, information)
        n, k = len(self.poses), len(self.landmarks)
        relaxation = Relaxation(edges, measurements, tau, kappa, n, k)
        return certify(relaxation, here.x, found.history[0], offset)

    def _marginals(self, i: Any, count: int, first: int, x: Array) -> Array:
        rows = first + _checked_rows("i", np.atleast_1d(i), count)
        edges, measurements, information = self._all_edges()
        equations, covs = self._equations(edges, self.fixed), np.zeros((len(rows), 3, 3))
        if equations.free[rows].any():
            own = Edges(edges, measurements, information)
            equations.fill(*own.linearise(own.at(x)))
            equations.factorise()
        columns = np.cumsum(equations.free.ravel()).reshape(-1, 3) - 1
        for cov, row in zip(covs, rows, strict=True):
            free = equations.free[row]
            for a in np.flatnonzero(free):  # a column of the inverse of H
                unit = np.zeros(equations.N)
                unit[columns[row, a]] = 1.0
                cov[free, a] = equations.solve(unit)[columns[row, free]]
        covs = 0.5 * (covs + covs.mT)
        return covs[0] if np.ndim(i) == 0 else covs

    def _groups(self, hypotheses: Sequence[Sequence[int]]) -> list[np.ndarray]:
        m = len(self.edges)
        groups = [
            _checked_rows("hypotheses", group, m, "edges")
            for group in as_tuple("hypotheses", hypotheses)
        ]
        rows = np.concatenate([*groups, np.zeros(0, dtype=int)])
        if any(len(group) == 0 for group in groups) or len(np.unique(rows)) < len(rows):
            raise ValueError("hypotheses: expected groups of edges, none empty and no edge twice")
        return groups

    def _check_connected(self) -> None:
        edges, size = self._all_edges()[0], len(self.poses) + len(self.landmarks)
        links = sp.csr_matrix((np.ones(len(edges)), edges.T), shape=(size, size))
        _, part = connected_components(links, directed=False)
        adrift = ~np.isin(part, part[list(self.fixed)])
        if adrift.any():
            raise ValueError(
                "edges: expected every pose to be joined to a fixed pose, "
                f"not joined: {self._names(np.flatnonzero(adrift))}"
            )

    def _names(self, rows: np.ndarray) -> str:
        kind, mark = ("pose", " (landmark)") if rows.min() < len(self.poses) else ("landmark", "")
        all_names = [*map(str, self.ids), *(f"{name}{mark}" for name in self.landmark_ids)]
        names = ", ".join(all_names[row] for row in rows[:8])
        more = f" and {len(rows) - 8} more" if len(rows) > 8 else ""
        return f"{kind}{'s' if len(rows) > 1 else ''} {names}{more}"


# Checks at the door


def _checked_rows(name: str, rows: Any, n: int, of: str = "poses") -> np.ndarray:
    checked = [as_count(name, row) for row in as_tuple(name, rows)]
    if max(checked, default=0) >= max(n, 1):
        raise ValueError(f"{name}: expected the row of one of {n} {of}, got {max(checked)}")
    return np.array(checked, dtype=np.intp)


def _checked_ids(name: str, ids: Sequence[int] | None, n: int, first: int) -> np.ndarray:
    if ids is None:
        return np.arange(first, first + n)
    names = as_tuple(name, ids)
    array = np.array(names, dtype=None if names else int)
    if array.shape != (n,) or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(
            f"{name}: expected {n} whole numbers, got {array.dtype} of shape {array.shape}"
        )
    if (array < 0).any():
        raise ValueError(f"{name}: expected numbers from 0 on, got {array.min()}")
    unique, counts = np.unique(array, return_counts=True)
    if len(unique) < n:
        raise ValueError(f"{name}: expected each id once, got {unique[counts > 1][0]} twice")
    return array


def _checked_edges(name: str, edges: ArrayLike, counts: tuple[int, int], of: str) -> np.ndarray:
    try:
        array = np.asarray(edges)
    except ValueError as error:
        raise ValueError(f"{name}: expected pairs of rows, got rows of unequal length") from error
    if array.size == 0:
        array = np.zeros((0, 2), dtype=np.intp)
    if array.ndim != 2 or array.shape[1] != 2 or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(
            f"{name}: expected whole numbers of shape (m, 2), "
            f"got {array.dtype} of shape {array.shape}"
        )
    array = array.astype(np.intp)
    unknown = np.argwhere((array < 0) | (array >= counts))
    if len(unknown):
        k, side = unknown[0]
        wanted = f"rows of {counts[side]} {('poses', of)[side]}"
        raise ValueError(f"{name}: expected {wanted}, got {array[k, side]} in edge {k}")
    return array


def _checked_information(name: str, information: ArrayLike, m: int, size: int) -> Array:
    array = as_array(name, information, ("...", size, size))
    if array.shape not in ((size, size), (m, size, size)):
        raise ValueError(
            f"{name}: expected shape ({size}, {size}) or ({m}, {size}, {size}), got {array.shape}"
        )
    array = as_covariance(name, array, size)
    return np.broadcast_to(array, (m, size, size)).astype(np.float64)
