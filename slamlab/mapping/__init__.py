"""Maps from scans: occupancy grids, walls, roughness and heights of the ground."""

from slamlab.mapping.lines import fit_line, line_cov, point_covs
from slamlab.mapping.occupancy import OccupancyGrid
from slamlab.mapping.walls import extract_walls

__all__ = ["OccupancyGrid", "extract_walls", "fit_line", "line_cov", "point_covs"]
