"""Where the robot goes: routes, paths remembered and followed, exploration. Floor 4."""

from slamlab.navigation.explore import Exploration, explore
from slamlab.navigation.path_memory import Cubic, Loop, PathMemory, fit_cubic
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
    "Cubic",
    "Exploration",
    "InformationGain",
    "LongestBeam",
    "Loop",
    "NearestFrontier",
    "PathMemory",
    "Quadrants",
    "RandomFraction",
    "SeenFloor",
    "Strategy",
    "View",
    "explore",
    "fit_cubic",
]
