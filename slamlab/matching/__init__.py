"""Scans against scans and grids: fields, Gauss-Newton, ICP, exhaustive search. Chapter 14."""

from slamlab.matching._match import Match
from slamlab.matching.correlative import match_correlative
from slamlab.matching.field import Field, PointField, match_field
from slamlab.matching.icp import AdaptiveGate, Outline, match_icp, normals, thin

__all__ = [
    "AdaptiveGate",
    "Field",
    "Match",
    "Outline",
    "PointField",
    "match_correlative",
    "match_field",
    "match_icp",
    "normals",
    "thin",
]
