"""The chain that scan matching makes: nodes, and how each is seen from the one before.

Lu and Milios 1997: the poses of scans are the nodes of a network, relative poses its edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamlab._checks import Array
from slamlab.geometry import between, compose
from slamlab.matching import PointsWithNormals


@dataclass(eq=False)
class Chain:
    """Nodes in one frame, in the order of the drive, or of several drives one after the other.

    Attributes
    ----------
    nodes : list of PointsWithNormals
        Scans in the frame of the body.
    poses : ndarray, shape (n, 3)
        Of the nodes (m, m, rad).
    travel : ndarray, shape (n,)
        Metres driven to each.
    """

    nodes: list[PointsWithNormals]
    poses: Array
    travel: Array

    def outline(self, first: int, last: int) -> PointsWithNormals:
        """Walls in the world that nodes saw, from the first to the one before the last."""
        nodes = self.nodes[first:last]
        poses = np.repeat(self.poses[first:last], [len(node.points) for node in nodes], 0)
        return PointsWithNormals.concatenated(nodes).transformed(poses)


class PoseChain(Chain):
    """The chain of one drive, as it grows: its edges, and the scans between the nodes.

    Attributes
    ----------
    edges : list of tuple
        Each node but the first, seen from the one before (3,), and the covariance of that (3, 3)
        in the frame of the newer one.
    steps : list of tuple
        Of each scan the last node, and where the scan was made, seen from there (3,). Before the
        first node that is -1, and the world.
    """

    def __init__(self) -> None:
        super().__init__([], np.zeros((0, 3)), np.zeros(0))
        self.edges: list[tuple[Array, Array]] = []
        self.steps: list[tuple[int, Array]] = []
        self._placed = np.zeros((0, 3))  # poses of the scans that the trajectory was asked for

    def from_last(self, pose: Array) -> Array:
        """Return a pose as the last node sees it; before the first node, as the world does."""
        return between(self.poses[-1], pose) if self.nodes else pose.copy()

    def append(self, node: PointsWithNormals, pose: Array, z: Array, cov: Array) -> None:
        """Append a node at a pose; z and its covariance are the edge from the last node to it."""
        length = 0.0
        if self.nodes:
            self.edges.append((z, cov))
            length = self.travel[-1] + float(np.hypot(*z[:2]))
        self.nodes.append(node)
        self.poses = np.vstack([self.poses, pose])
        self.travel = np.append(self.travel, length)

    def bend(self, poses: Array) -> None:
        """Move the nodes to other poses (n, 3), and all scans with them."""
        self.poses, self._placed = poses, np.zeros((0, 3))

    @property
    def trajectory(self) -> Array:
        """Poses (T, 3) of all scans; a copy."""
        new = self.steps[len(self._placed) :]  # `bend` alone moves what was placed
        if new:
            frames = np.vstack([self.poses, np.zeros(3)])  # row -1 is the world
            added = compose(frames[[row for row, _ in new]], [off for _, off in new])
            self._placed = np.concatenate([self._placed, added])
        return self._placed.copy()
