"""One drive of a map of several: its scans, and which of them are nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array, as_instance
from slamlab.geometry import between, compose
from slamlab.logs import Log, ScanGeometry
from slamlab.matching import PointsWithNormals
from slamlab.slam._chain import Chain
from slamlab.slam._closures import Closure
from slamlab.slam.scan_graph import ScanGraphSlam

LONGEST = 200  # letters of a log's name


@dataclass(eq=False)
class Drive:
    """One drive of a map: its scans, and which of them are nodes.

    Attributes
    ----------
    name : str
        Of the log.
    times, ranges : ndarray, shapes (T,) and (T, n_beams)
        When the scans were made (s), and what they measured (m).
    nodes : list of PointsWithNormals
        The N scans that are nodes of the graph.
    scan_of_node : ndarray of int, shape (N,)
        Which scans these are.
    poses : ndarray, shape (N, 3)
        Of the nodes (m, m, rad), in the frame of the map; of a drive that waits, in its own.
    z, information : ndarray, shapes (N - 1, 3) and (N - 1, 3, 3)
        Motion from each node to the next, and its information matrix.
    offsets : ndarray, shape (T, 3)
        Pose of each scan seen from its node.
    closures : list of Closure
        Those within a drive that waits; the map keeps the others.
    """

    name: str
    times: Array
    ranges: Array
    nodes: list[PointsWithNormals]
    scan_of_node: NDArray[np.intp]
    poses: Array
    z: Array
    information: Array
    offsets: Array
    closures: list[Closure]

    @property
    def chain(self) -> Chain:
        """Its nodes, with the metres driven to each."""
        travel = np.append(0.0, np.cumsum(np.hypot(self.z[:, 0], self.z[:, 1])))
        return Chain(self.nodes, self.poses, travel)

    @property
    def trajectory(self) -> Array:
        """Poses (T, 3) of all scans."""
        return compose(self.poses[_node_of_scan(self.scan_of_node, len(self.times))], self.offsets)


def _node_of_scan(scan_of_node: NDArray[np.intp], n_scans: int) -> NDArray[np.intp]:
    """Find the node that each scan is seen from: the last before it, or the first of all."""
    rows = np.searchsorted(scan_of_node, np.arange(n_scans), "right") - 1
    return np.maximum(rows, 0)


def lidar_of(log: Log) -> ScanGeometry:
    """How the beams of a log's scans lie; ValueError if it has no scans."""
    as_instance("log", log, Log)
    if log.ranges is None or log.scan is None:
        raise ValueError("log: expected scans, got none")
    return ScanGeometry(log.scan.beam_angles, log.scan.max_range, log.scan.offset)


def drive_of(system: ScanGraphSlam, log: Log, name: str) -> Drive:
    """Keep what a drive left."""
    as_instance("system", system, ScanGraphSlam)
    lidar_of(log)
    if not system.nodes:
        raise ValueError("system: expected scans that see walls, got none with ten points")
    path, graph = system.trajectory, system.graph()
    if len(path) != len(log):
        raise ValueError(f"log: expected the {len(path)} scans that the system was fed")
    n, last_node = len(graph.poses), [node for node, _ in system._chain.steps]
    scan_of_node = np.searchsorted(last_node, np.arange(n))
    node = _node_of_scan(scan_of_node, len(path))
    return Drive(
        str(name)[:LONGEST],
        np.array(log.times, dtype=float),
        np.array(log.ranges, dtype=float),
        list(system.nodes),
        scan_of_node,
        graph.poses.copy(),
        graph.measurements[: n - 1].copy(),
        graph.information[: n - 1].copy(),
        between(graph.poses[node], path),
        [replace(one) for one in system.closures],
    )
