"""From raw scans to a map: scan matching makes a chain, closures tie it, least squares bends it.

Lu and Milios 1997; Grisetti et al. 2010; Olson 2009; Hess et al. 2016; Agarwal et al. 2013.
P5 section 2.2. Chapters 13 and 14.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_choice, as_count
from slamlab.geometry import compose
from slamlab.matching import PointsWithNormals
from slamlab.matching.match import Match
from slamlab.models import MotionModel, ScanSensor, as_motion
from slamlab.robots import RelativePose
from slamlab.robots.encoders import moved
from slamlab.slam._chain import PoseChain
from slamlab.slam._closures import (
    N_QUERY_SCANS,
    Closure,
    ClosureSearch,
    chain_graph,
    inverses,
    optimized,
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
        n_keyframes = as_count("n_keyframes", n_keyframes, 1)
        self._loops = bool(loops)
        inflate = as_choice("ambiguous", ambiguous, ["reject", "inflate"]) == "inflate"
        self.lost = False
        self.unmatched_scans: list[int] = []
        self._keyframes = deque[PointsWithNormals](maxlen=n_keyframes)  # last nodes, in the world
        self._local_map: LocalMap | None = None  # made of them, until there is a new one
        self._moved_cov = np.zeros((3, 3))  # of the motion since the last node
        self._chain = PoseChain()
        self._search = ClosureSearch(inflate)

    def __repr__(self) -> str:
        count = sum(one.state == "confirmed" for one in self.closures)
        state = ", lost" if self.lost else ""
        return f"ScanGraphSlam({len(self.nodes)} nodes, {count} closures{state})"

    @property
    def nodes(self) -> list[PointsWithNormals]:
        """Scans of the graph, thinned, in the frame of the body."""
        return self._chain.nodes

    @property
    def closures(self) -> list[Closure]:
        """All closures that were verified; `state` tells which of them count."""
        return self._search.closures

    @property
    def trajectory(self) -> Array:
        """Best poses (T, 3) of all scans so far, as the closures have bent them."""
        return self._chain.trajectory

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
            (m), not negative; NaN is a lost beam, inf or ``lidar.max_range`` one that met nothing.
        ids : None
            Scans have no names.

        Returns
        -------
        Match
            `score` 0: the scan matched nothing (too few points, or a bad fit).
        """
        points = scan_points(self._taken(ranges), self._lidar)
        chain, enough = self._chain, len(points) >= LEAST_POINTS
        match: Match | None = None
        nothing = Match(self.pose, self.pose_cov, 0.0, 0)
        # 1. Match the scan to the last nodes.
        if enough and chain.nodes:
            self._local_map = self._local_map or LocalMap(self._keyframes)
            match = track(self._local_map, points, self._pose, self._moved_cov)
            self.lost = match is None
            # 2. Wheels and walls are one in it already; or the wheels alone.
            if match is None:
                self.unmatched_scans.append(len(chain.steps))
            else:
                before = self._cov - self._moved_cov
                self._pose, self._moved_cov = match.pose, match.cov
                self._cov = before + self._moved_cov
        # 3. Make it a node if the robot has moved.
        z = chain.from_last(self._pose)
        if enough and (not chain.nodes or has_moved(z, *_NEW_NODE)):
            node = PointsWithNormals.estimate(points)
            chain.append(node, self._pose, z, edge_cov(self._moved_cov, self._pose[2], MIN_COV))
            self._keyframes.append(node.transformed(self._pose))
            self._local_map, self._moved_cov = None, np.zeros((3, 3))
            # 4. Look for closures, where there are scans on both sides; solve.
            if self._loops and self._search.try_node(len(chain.nodes) - 1 - N_QUERY_SCANS, chain):
                self._solve()
            z = np.zeros(3)
        chain.steps.append((len(chain.nodes) - 1, z))
        return match or nothing

    def graph(self) -> PoseGraph:
        """Return the pose graph: the chain, and the closures that count.

        Raises
        ------
        ValueError
            If there is no node yet.
        """
        if not self.nodes:
            raise ValueError("graph: expected at least one scan, got none")
        edges = self._chain.edges
        z = np.reshape([z for z, _ in edges], (-1, 3))
        information = inverses([cov for _, cov in edges])
        k = np.arange(len(edges))
        return chain_graph(self._chain.poses, k, z, information, self.closures)

    def _solve(self) -> None:
        """Bend the chain; closures that still do not fit are dropped, and it is bent again."""
        seen = self._chain.from_last(self._pose)
        graph, poses = optimized(self.graph, self.closures)
        self._chain.bend(poses)
        n = len(self._keyframes)
        self._keyframes.extend(map(PointsWithNormals.transformed, self.nodes[-n:], poses[-n:]))
        self._local_map = None
        self._pose = compose(poses[-1], seen)
        self._cov = graph.marginal_cov(len(poses) - 1, poses) + self._moved_cov
