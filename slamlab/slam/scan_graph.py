"""From raw scans to a map: scan matching makes a chain, closures tie it, least squares bends it.

Lu and Milios 1997; Grisetti et al. 2010; Olson 2009; Hess et al. 2016; Agarwal et al. 2013.
P5 section 2.2. Chapters 13 and 14.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_choice, as_count
from slamlab.geometry import between, compose
from slamlab.matching import PointsWithNormals
from slamlab.matching.match import Match
from slamlab.models import MotionModel, ScanSensor, as_motion
from slamlab.robots import RelativePose
from slamlab.robots.encoders import moved
from slamlab.slam._closures import (
    CLOSURE_SPACING,
    HIGH_SCORE,
    MAX_CLOSURE_CHI2,
    N_QUERY_SCANS,
    Closure,
    candidates,
    chain_chi2,
    chain_graph,
    confirm,
    inverses,
    optimized,
    verify,
)
from slamlab.slam._tracking import (
    LEAST_POINTS,
    MIN_COV,
    ODOMETRY_INFLATION,
    LocalMap,
    ScanSystem,
    edge_cov,
    has_moved,
    scan_points,
    track,
)
from slamlab.slam.pose_graph import PoseGraph

__all__ = ["Closure", "ScanGraphSlam"]

_NEW_NODE = (0.3, np.deg2rad(15))  # a scan becomes a node after so much motion (m, rad)


class ScanGraphSlam(ScanSystem):
    """Pose graph of scans, built and closed while the robot drives.

    Parameters
    ----------
    lidar : ScanSensor
        How the beams lie.
    pose : array_like, shape (3,), default (0, 0, 0)
        Where the robot stands first (m, m, rad).
    n_keyframes : int, default 20
        A scan is matched against so many nodes before it.
    motion : MotionModel, default RelativePose()
        What the controls mean.
    loops : bool, default True
        Look for closures. Without them: the front end alone.
    ambiguous : {"reject", "inflate"}
        What to do with a closure that has a second-best match, as in a corridor: reject it, or
        keep it with a covariance stretched along the direction that the walls do not hold.

    Attributes
    ----------
    pose, pose_cov : ndarray, shapes (3,) and (3, 3)
        Estimated pose (m, m, rad); its covariance along the chain since the graph was solved
        last. Along a plain corridor it claims too little: nothing but the wheels measures that
        way, and their bias is only allowed for by three times their noise.
    nodes : list of PointsWithNormals
        Scans of the graph, thinned, in the frame of the body.
    closures : list of Closure
        All that were verified; `state` tells which of them count.
    lost : bool
        Whether the last scan lay nowhere near the map: then the wheels are believed.
    unmatched_scans : list of int
        Numbers of all such scans.

    Examples
    --------
    >>> from slamlab.sensors import Lidar
    >>> from slamlab.worlds import rooms
    >>> lidar = Lidar(180, max_range=20.0)
    >>> slam = ScanGraphSlam(lidar, [2.0, 4.0, 0.0])
    >>> match = slam.update(lidar.scan(rooms.office(), [2.0, 4.0, 0.0]))
    >>> slam.predict([0.5, 0.0, 0.1], 1.0, np.diag([0.01, 0.01, 0.001]))
    >>> match = slam.update(lidar.scan(rooms.office(), [2.4, 4.0, 0.0]))
    >>> bool(np.abs(slam.pose - [2.4, 4.0, 0.0]).max() < 0.02), len(slam.nodes)
    (True, 2)
    """

    def __init__(
        self,
        lidar: ScanSensor,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        n_keyframes: int = 20,
        motion: MotionModel = RelativePose(),  # noqa: B008
        loops: bool = True,
        ambiguous: str = "reject",
    ) -> None:
        super().__init__(lidar, pose)
        self._motion = as_motion("motion", motion)
        self._n_keyframes = as_count("n_keyframes", n_keyframes, 1)
        self._loops = bool(loops)
        self._inflate = as_choice("ambiguous", ambiguous, ["reject", "inflate"]) == "inflate"
        self.nodes: list[PointsWithNormals] = []
        self.closures: list[Closure] = []
        self.lost = False
        self.unmatched_scans: list[int] = []
        self._poses = np.zeros((0, 3))  # of the nodes
        self._travel = np.zeros(0)  # metres driven to each node
        self._chain: list[tuple[Array, Array]] = []  # (z, cov in the next one's frame)
        self._steps: list[tuple[int, Array]] = []  # of each scan: its node, and where from there
        self._placed = np.zeros((0, 3))  # poses of the scans that the trajectory was asked for
        self._recent = deque[PointsWithNormals](maxlen=self._n_keyframes)  # nodes, in the world
        self._local_map: LocalMap | None = None  # made of them, until there is a new one
        self._moved_cov = np.zeros((3, 3))  # of the motion since the last match
        self._last_tried = self._last_closed = 0.0  # travel of the last trial, of the last closure

    def __repr__(self) -> str:
        count = sum(one.state == "confirmed" for one in self.closures)
        state = ", lost" if self.lost else ""
        return f"ScanGraphSlam({len(self.nodes)} nodes, {count} closures{state})"

    @property
    def trajectory(self) -> Array:
        """Best poses (T, 3) of all scans so far, as the closures have bent them."""
        # Only a closure moves what was placed; row -1, before there was a node, is the world.
        new = self._steps[len(self._placed) :]
        if new:
            frames = np.vstack([self._poses, np.zeros(3)])
            added = compose(frames[[row for row, _ in new]], [off for _, off in new])
            self._placed = np.concatenate([self._placed, added])
        return self._placed.copy()

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move by control u (p,) during dt (s), executed with covariance (p, p)."""
        wide = ODOMETRY_INFLATION * as_array("control_cov", control_cov, ("p", "p"))
        self._pose, self._cov, self._moved_cov = moved(
            self._motion, self._pose, u, dt, wide, self._cov, self._moved_cov
        )

    def update(self, ranges: ArrayLike, ids: None = None) -> Match:
        """Match a scan to the nodes before it; make it a node if the robot has moved.

        Parameters
        ----------
        ranges : array_like, shape (n_beams,)
            (m); NaN is a lost beam, inf or ``lidar.max_range`` one that met nothing.
        ids : None
            Scans have no names.

        Returns
        -------
        Match
            `score` 0: the scan matched nothing (too few points, or a bad fit).

        Raises
        ------
        ValueError
            If the shape is wrong or a range negative.
        """
        points = scan_points(self._taken(ranges), self._lidar)
        enough, nothing = len(points) >= LEAST_POINTS, Match(self.pose, self.pose_cov, 0.0, 0)
        match = None
        if enough and self.nodes:
            self._local_map = self._local_map or LocalMap(self._recent)
            match = track(self._local_map, points, self._pose, self._moved_cov)
            self.lost = match is None
        if match is not None:  # the wheels and the walls as one
            before = self._cov - self._moved_cov
            self._pose, self._moved_cov = match.pose, match.cov
            self._cov = before + self._moved_cov
        elif enough and self.nodes:  # the wheels alone
            self.unmatched_scans.append(len(self._steps))
        off = between(self._poses[-1], self._pose) if self.nodes else self._pose.copy()
        if enough and (not self.nodes or has_moved(off, *_NEW_NODE)):
            self._add_node(PointsWithNormals.estimate(points), off)
            if self._loops and self._close_loops(len(self.nodes) - 1 - N_QUERY_SCANS):
                self._solve()
            off = np.zeros(3)
        self._steps.append((len(self.nodes) - 1, off))
        return match or nothing

    def _add_node(self, node: PointsWithNormals, z: Array) -> None:
        """Append a node at the present pose, and the edge z of the chain that leads to it."""
        length = 0.0
        if self.nodes:
            self._chain.append((z, edge_cov(self._moved_cov, self._pose[2], MIN_COV)))
            length = self._travel[-1] + float(np.hypot(*z[:2]))
        self.nodes.append(node)
        self._recent.append(node.transformed(self._pose))
        self._poses = np.vstack([self._poses, self._pose])
        self._travel = np.append(self._travel, length)
        self._local_map = None
        self._moved_cov = np.zeros((3, 3))

    # Closures.

    def _close_loops(self, k: int) -> bool:
        """Look for old places at node k; tell whether any is confirmed now."""
        if k < 0 or self._travel[k] - self._last_tried < CLOSURE_SPACING:
            return False
        self._last_tried = self._travel[k]
        old, radius = candidates(k, self._poses, self._travel, self._travel[k] - self._last_closed)
        chain = self.nodes, self._poses, self._travel
        tried = [verify(j, k, radius, *chain, self._inflate) for j in old]
        found = [one for one in tried if one is not None]
        covs = np.array([cov for _, cov in self._chain])
        for one in found:  # what contradicts the chain must fit well
            if one.fit < HIGH_SCORE and chain_chi2(one, self._poses, covs) > MAX_CLOSURE_CHI2:
                one.state = "rejected"
        self.closures += found
        if not (found and confirm(self.closures, self.closures, self._poses, self._travel)):
            return False
        self._last_closed = self._travel[k]
        return True

    def graph(self) -> PoseGraph:
        """Return the pose graph: the chain, and the closures that count.

        Raises
        ------
        ValueError
            If there is no node yet.
        """
        if not self.nodes:
            raise ValueError("graph: expected at least one scan, got none")
        k = np.arange(len(self._chain))
        z = np.reshape([z for z, _ in self._chain], (-1, 3))
        information = inverses([cov for _, cov in self._chain])
        return chain_graph(self._poses, k, z, information, self.closures)

    def _solve(self) -> None:
        """Bend the chain; closures that still do not fit are dropped, and it is bent again."""
        last = between(self._poses[-1], self._pose)
        graph, poses = optimized(self.graph, self.closures)
        self._poses, self._local_map, self._placed = poses, None, np.zeros((0, 3))
        recent = slice(-self._n_keyframes, None)
        placed = map(PointsWithNormals.transformed, self.nodes[recent], self._poses[recent])
        self._recent.extend(placed)
        self._pose = compose(self._poses[-1], last)
        self._cov = graph.marginal_cov(len(self._poses) - 1, poses) + self._moved_cov
