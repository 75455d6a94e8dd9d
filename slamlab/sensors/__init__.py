"""What the robot sees. Floor 1 of the house."""

from slamlab.sensors.range_bearing import RangeBearing

__all__ = ["RangeBearing"]
