"""Simultaneous localization and mapping: pose graphs."""

from slamlab.slam.graph import PoseGraph, Result, Scans, edge_error, edge_jacobians

__all__ = ["PoseGraph", "Result", "Scans", "edge_error", "edge_jacobians"]
