"""What the robot sees."""

from slamlab.sensors.lidar import Lidar
from slamlab.sensors.point import PointSensor
from slamlab.sensors.range_bearing import RangeBearing
from slamlab.sensors.scan_motion import turn_between
from slamlab.sensors.sonar import Sonar
from slamlab.sensors.stereo import StereoRig
from slamlab.sensors.visual_odometer import StereoOdometer, VisualOdometer, fit_noise, room_points
from slamlab.sensors.wall import Wall

__all__ = [
    "Lidar",
    "PointSensor",
    "RangeBearing",
    "Sonar",
    "StereoOdometer",
    "StereoRig",
    "VisualOdometer",
    "Wall",
    "fit_noise",
    "room_points",
    "turn_between",
]
