"""Simultaneous localization and mapping: EKF-SLAM, FastSLAM, pose graphs."""

from slamlab.slam.batch import EKFSlamBatch
from slamlab.slam.compressed import CompressedEKFSlam
from slamlab.slam.ekf import EKFSlam
from slamlab.slam.fast import FastSlam
from slamlab.slam.gamma import GammaSlam
from slamlab.slam.grid_fast import GridFastSlam
from slamlab.slam.hector import HectorSlam
from slamlab.slam.incremental import IncrementalGraph
from slamlab.slam.least_squares import edge_error, edge_jacobians
from slamlab.slam.local_range import AdaptiveRange
from slamlab.slam.pose_graph import PoseGraph
from slamlab.slam.scan_graph import ScanGraphSlam
from slamlab.slam.sessions import Sessions
from slamlab.slam.wall_slam import WallSlam

__all__ = [
    "AdaptiveRange",
    "CompressedEKFSlam",
    "EKFSlam",
    "EKFSlamBatch",
    "FastSlam",
    "GammaSlam",
    "GridFastSlam",
    "HectorSlam",
    "IncrementalGraph",
    "PoseGraph",
    "ScanGraphSlam",
    "Sessions",
    "WallSlam",
    "edge_error",
    "edge_jacobians",
]
