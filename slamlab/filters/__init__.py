"""What the robot believes: filters. Floor 2 of the house."""

from slamlab.filters import extended, histogram, kalman, particle, unscented

__all__ = ["extended", "histogram", "kalman", "particle", "unscented"]
