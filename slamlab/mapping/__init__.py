"""Maps from scans: occupancy grids, walls, roughness and heights of the ground."""

from slamlab.mapping.occupancy import OccupancyGrid
from slamlab.mapping.variance import HeightGrid, VarianceGrid
from slamlab.mapping.walls import Walls, extract_walls, fit_line, line_cov, point_covs

__all__ = [
    "HeightGrid",
    "OccupancyGrid",
    "VarianceGrid",
    "Walls",
    "extract_walls",
    "fit_line",
    "line_cov",
    "point_covs",
]
