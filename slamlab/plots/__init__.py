"""Figures in the course's one encoding (STYLE: colours, tables, helpers)."""

from slamlab.plots._claims import claims
from slamlab.plots._draw import (
    ellipse,
    error_band,
    floor,
    landmarks,
    lidar_points,
    occupancy,
    particles,
    path,
    walls,
)
from slamlab.plots._show import show
from slamlab.plots._style import COLOURS, line_style, use_style
from slamlab.plots._table import Table

__all__ = [
    "COLOURS",
    "Table",
    "claims",
    "ellipse",
    "error_band",
    "floor",
    "landmarks",
    "lidar_points",
    "line_style",
    "occupancy",
    "particles",
    "path",
    "show",
    "use_style",
    "walls",
]
