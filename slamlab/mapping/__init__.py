"""Maps from scans: occupancy grids, walls."""

from slamlab.mapping.occupancy import OccupancyGrid
from slamlab.mapping.walls import Walls, extract_walls, fit_line, line_cov, point_covs

__all__ = [
    "OccupancyGrid",
    "Walls",
    "extract_walls",
    "fit_line",
    "line_cov",
    "point_covs",
]
