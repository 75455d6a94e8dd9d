"""How the robot moves."""

from slamlab.robots.encoders import Encoders, dead_reckoning, dead_reckoning_cov
from slamlab.robots.mecanum import YOUBOT, Mecanum
from slamlab.robots.relative_pose import RelativePose
from slamlab.robots.square import SquareRobot
from slamlab.robots.unicycle import Unicycle

__all__ = [
    "YOUBOT",
    "Encoders",
    "Mecanum",
    "RelativePose",
    "SquareRobot",
    "Unicycle",
    "dead_reckoning",
    "dead_reckoning_cov",
]
