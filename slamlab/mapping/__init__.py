"""Maps from scans: occupancy grids, walls."""

from slamlab.mapping.occupancy import BeamSensor, OccupancyGrid
from slamlab.mapping.walls import Walls, extract_walls, fit_line, line_cov, point_covs

__all__ = [
    "BeamSensor",
    "OccupancyGrid",
    "Walls",
    "extract_walls",
    "fit_line",
    "line_cov",
    "point_covs",
]
