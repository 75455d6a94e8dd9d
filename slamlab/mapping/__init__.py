"""Maps from scans: occupancy grids. Floor 2 of the house."""

from slamlab.mapping.occupancy import BeamSensor, OccupancyGrid

__all__ = ["BeamSensor", "OccupancyGrid"]
