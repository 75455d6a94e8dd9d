"""Simultaneous localization and mapping: EKF-SLAM, FastSLAM, pose graphs."""

from slamlab.slam.compressed import CompressedEKFSlam
from slamlab.slam.ekf import EKFSlam
from slamlab.slam.fast import FastSlam
from slamlab.slam.graph import PoseGraph, Result, Scans, edge_error, edge_jacobians
from slamlab.slam.wall_slam import WallSlam

__all__ = [
    "CompressedEKFSlam",
    "EKFSlam",
    "FastSlam",
    "PoseGraph",
    "Result",
    "Scans",
    "edge_error",
    "edge_jacobians",
    "WallSlam",
]
