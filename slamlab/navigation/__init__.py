"""Where the robot goes: routes, paths remembered and followed, exploration."""

from slamlab.navigation.drive import YOUBOT_BODY, Belief, Body, Drive, drive_round
from slamlab.navigation.explore import Exploration, explore
from slamlab.navigation.follow import RegulatedPurePursuit, Return, ReturnLaw, return_to_start
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
    "Belief",
    "Body",
    "Cubic",
    "Drive",
    "Exploration",
    "InformationGain",
    "LongestBeam",
    "Loop",
    "NearestFrontier",
    "PathMemory",
    "Quadrants",
    "RandomFraction",
    "RegulatedPurePursuit",
    "Return",
    "ReturnLaw",
    "SeenFloor",
    "Strategy",
    "View",
    "YOUBOT_BODY",
    "drive_round",
    "explore",
    "fit_cubic",
    "return_to_start",
]
