"""Simultaneous localization and mapping: EKF-SLAM, pose graphs."""

from slamlab.slam.ekf import EKFSlam
from slamlab.slam.graph import PoseGraph, Result, Scans, edge_error, edge_jacobians

__all__ = ["EKFSlam", "PoseGraph", "Result", "Scans", "edge_error", "edge_jacobians"]
