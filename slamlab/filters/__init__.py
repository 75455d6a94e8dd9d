"""What the robot believes: filters. Floor 2 of the house."""

from slamlab.filters import particle

__all__ = ["particle"]
