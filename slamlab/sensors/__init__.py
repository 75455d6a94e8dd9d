"""What the robot sees. Floor 1 of the house."""

from slamlab.sensors.range_bearing import RangeBearing
from slamlab.sensors.wall import Wall

__all__ = ["RangeBearing", "Wall"]
