"""Where the robot goes: routes, paths remembered and followed, exploration. Floor 4."""

from slamlab.navigation.explore import Exploration, explore
from slamlab.navigation.seen_floor import SeenFloor
from slamlab.navigation.strategies import (
    InformationGain,
    LongestBeam,
    NearestFrontier,
    Quadrants,
    RandomFraction,
    Strategy,
    View,
)

__all__ = [
    "Exploration",
    "InformationGain",
    "LongestBeam",
    "NearestFrontier",
    "Quadrants",
    "RandomFraction",
    "SeenFloor",
    "Strategy",
    "View",
    "explore",
]
