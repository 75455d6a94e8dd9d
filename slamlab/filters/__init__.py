"""What the robot believes: filters."""

from slamlab.filters import extended, histogram, kalman, particle, unscented

__all__ = ["extended", "histogram", "kalman", "particle", "unscented"]
