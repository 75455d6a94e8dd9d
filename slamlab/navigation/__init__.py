"""Where the robot goes: pilots, who see what the robot believes, and what they plan with."""

from slamlab.navigation.drive import YOUBOT_BODY, Body, Guard, RoomDriver
from slamlab.navigation.explore import Explorer
from slamlab.navigation.follow import Homer, RegulatedPurePursuit, Retracer, ReturnLaw
from slamlab.navigation.path_memory import (
    VARIANTS,
    Cubic,
    Loop,
    PathMemory,
    fit_cubic,
    refit_by_arc_length,
)
from slamlab.navigation.seen_floor import SeenFloor
from slamlab.navigation.strategies import (
    InformationGain,
    LongestBeam,
    NearestFrontier,
    Quadrants,
    RandomFraction,
    Situation,
    Strategy,
)

__all__ = [
    "Body",
    "Cubic",
    "Explorer",
    "Guard",
    "Homer",
    "InformationGain",
    "LongestBeam",
    "Loop",
    "NearestFrontier",
    "PathMemory",
    "Quadrants",
    "RandomFraction",
    "RegulatedPurePursuit",
    "Retracer",
    "ReturnLaw",
    "RoomDriver",
    "SeenFloor",
    "Situation",
    "Strategy",
    "VARIANTS",
    "YOUBOT_BODY",
    "fit_cubic",
    "refit_by_arc_length",
]
