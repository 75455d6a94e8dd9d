"""Scans against scans and grids (chapter 14), and pairs of image points (chapter 16)."""

from slamlab.matching.correlative import match_correlative
from slamlab.matching.eight_point import (
    eight_point_rows,
    epipolar_distances,
    fundamental_matrix,
    hartley_transform,
)
from slamlab.matching.field import LikelihoodGrid, match_field
from slamlab.matching.icp import match_icp
from slamlab.matching.normals import PointsWithNormals, estimate_normals, voxel_downsample

__all__ = [
    "LikelihoodGrid",
    "PointsWithNormals",
    "eight_point_rows",
    "epipolar_distances",
    "estimate_normals",
    "fundamental_matrix",
    "hartley_transform",
    "match_correlative",
    "match_field",
    "match_icp",
    "voxel_downsample",
]
