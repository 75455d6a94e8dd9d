"""Where the robot goes: pilots, who see what the robot believes, and what they plan with."""

from slamlab.navigation.cubic import Cubic, fit_cubic, refit_by_arc_length
from slamlab.navigation.drive import CoveragePilot
from slamlab.navigation.exploration_grid import ExplorationGrid
from slamlab.navigation.explore import Explorer
from slamlab.navigation.follow import PathFollower, RegulatedPurePursuit, ReturnLaw, ReturnPilot
from slamlab.navigation.guard import YOUBOT_BODY, Body, CollisionGuard
from slamlab.navigation.path_memory import VARIANTS, PathMemory
from slamlab.navigation.strategies import (
    InformationGain,
    LongestBeam,
    NearestFrontier,
    Quadrants,
    RandomFraction,
)

__all__ = [
    "Body",
    "Cubic",
    "Explorer",
    "CollisionGuard",
    "PathFollower",
    "InformationGain",
    "LongestBeam",
    "NearestFrontier",
    "PathMemory",
    "Quadrants",
    "RandomFraction",
    "RegulatedPurePursuit",
    "ReturnPilot",
    "ReturnLaw",
    "CoveragePilot",
    "ExplorationGrid",
    "VARIANTS",
    "YOUBOT_BODY",
    "fit_cubic",
    "refit_by_arc_length",
]
