"""How the robot moves.."""

from slamlab.robots.encoders import Encoders, dead_reckoning, dead_reckoning_cov
from slamlab.robots.mecanum import YOUBOT, Mecanum
from slamlab.robots.relative_pose import RelativePose
from slamlab.robots.square import SquareRobot, can_move_as_printed
from slamlab.robots.unicycle import Unicycle

__all__ = [
    "YOUBOT",
    "Encoders",
    "Mecanum",
    "RelativePose",
    "SquareRobot",
    "Unicycle",
    "can_move_as_printed",
    "dead_reckoning",
    "dead_reckoning_cov",
]
