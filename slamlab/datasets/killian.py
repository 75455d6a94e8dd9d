"""MIT Killian Court: a real robot, real scans, real loop closures (Bosse et al. 2004).

The files lie beside this one, with their source and licence. Chapter 00 draws its maps from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array
from slamlab.logs import Log, ScanGeometry
from slamlab.robots import RelativePose, dead_reckoning
from slamlab.slam import PoseGraph

__all__ = ["Killian", "killian"]


@dataclass(frozen=True, eq=False)
class Killian:
    """The pose graph of Killian Court and the scans taken from its poses.

    Attributes
    ----------
    graph : PoseGraph
        Poses as the file gives them, odometry and loop closures.
    loop_mask : ndarray of bool, shape (m,)
        Which edges are loop closures: all that do not join a pose with the next one.
    scans : ndarray, shape (n, n_beams)
        Ranges (m) of the scan taken at each pose; inf where a beam met nothing, NaN at a pose
        without a scan. No rows in the small variant, which has no scans.
    lidar : ScanGeometry
        Directions of the beams, and the range that means "nothing".

    Examples
    --------
    >>> killian().lidar.n_beams
    180
    """

    graph: PoseGraph
    loop_mask: NDArray[np.bool_]
    scans: Array
    lidar: ScanGeometry

    @property
    def beam_angles(self) -> Array:
        """Directions of the beams in the frame of the body (rad), shape (n_beams,)."""
        return self.lidar.beam_angles

    @property
    def odometry(self) -> Array:
        """Measured motion from each pose to the next, in the frame of the first, (n - 1, 3)."""
        return self.graph.measurements[self._odometry_edges]

    @property
    def _odometry_edges(self) -> NDArray[np.intp]:
        edges = np.flatnonzero(~self.loop_mask)
        return edges[np.argsort(self.graph.edges[edges, 0])]

    @property
    def timestamps(self) -> Array:
        """When the scans were taken (s), shape (n,); none in the small variant."""
        return np.empty(0) if self.graph.scans is None else self.graph.scans.timestamps.copy()

    def dead_reckoned(self) -> Array:
        """Poses (n, 3) by odometry alone, from the first pose of the graph."""
        return dead_reckoning(RelativePose(), self.graph.poses[0], self.odometry, 1.0)

    @cached_property
    def log(self) -> Log:
        """The drive as a log for `robots.RelativePose`: odometry edges, scans, a reference.

        Nobody measured the truth: its place is taken by the optimum of the file's own graph.
        The file's "odometry" has been scan-matched by those who made it, and has no time stamps:
        a step counts as one second. ValueError for the small variant, whose file has no odometry.
        """
        edges = self._odometry_edges
        n = len(self.graph.poses)
        if len(edges) != n - 1:
            wanted = "an odometry edge from each pose to the next"
            raise ValueError(f"log: expected {wanted}, got {len(edges)}")
        cov = np.zeros((n, 3, 3))
        cov[1:] = np.linalg.inv(self.graph.information[edges])
        times: Array = np.arange(n, dtype=np.float64)
        return Log(
            times,
            np.concatenate([np.zeros((1, 3)), self.odometry]),
            np.minimum(times, 1.0),
            0.5 * (cov + np.swapaxes(cov, 1, 2)),
            ranges=self.scans,
            scan=self.lidar,
            controls="displacement",
            truth=self.graph.with_poses(self.dead_reckoned()).optimize().poses,
        )


def killian(small: bool = False) -> Killian:
    """Load Killian Court: 3873 poses, 4987 edges, a scan of 180 beams at every pose.

    Parameters
    ----------
    small : bool, default False
        Load the smaller graph of the same buildings instead (1941 poses, 3995 edges), whose
        poses are a poor start, and which has no scans.

    Returns
    -------
    Killian

    Examples
    --------
    >>> court = killian()
    >>> court.graph.poses.shape, int(court.loop_mask.sum()), court.scans.shape
    ((3873, 3), 1115, (3873, 180))
    """
    name = "killian-small.toro.gz" if small else "killian.g2o.gz"
    graph = PoseGraph.read_g2o(Path(__file__).parent / "data" / name)
    loop_mask = graph.edges[:, 1] - graph.edges[:, 0] != 1
    if graph.scans is None:
        return Killian(graph, loop_mask, np.empty((0, 1)), ScanGeometry(np.zeros(1)))
    scans = graph.scans
    lidar = ScanGeometry(scans.angles, scans.max_range)
    ranges = np.full((len(graph.poses), lidar.n_beams), np.nan)
    ranges[scans.rows] = np.where(scans.ranges < scans.max_range, scans.ranges, np.inf)
    return Killian(graph, loop_mask, ranges, lidar)
