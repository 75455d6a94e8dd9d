"""What the robot sees."""

from slamlab.logs import ScanGeometry
from slamlab.sensors.lidar import Lidar
from slamlab.sensors.range_bearing import RangeBearing
<<<<<<< HEAD
from slamlab.sensors.scan_motion import (
    displacement_as_printed,
    motion_between,
    turn_as_printed,
    turn_between,
)
=======
from slamlab.sensors.scan import ScanGeometry
from slamlab.sensors.scan_motion import motion_between, turn_between
>>>>>>> e2d3fb3 (Printed: P5's refuted formulas in a room of their own; a guard of the explorer is a function)
from slamlab.sensors.sonar import Sonar
from slamlab.sensors.visual_odometer import StereoOdometer, VisualOdometer
from slamlab.sensors.wall import Wall

__all__ = [
    "Lidar",
    "RangeBearing",
    "ScanGeometry",
    "Sonar",
    "StereoOdometer",
    "VisualOdometer",
    "Wall",
    "motion_between",
    "turn_between",
]
