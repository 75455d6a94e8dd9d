"""How the robot moves."""

from slamlab.robots.encoders import Encoders, dead_reckoning, dead_reckoning_cov
from slamlab.robots.mecanum import YOUBOT, Mecanum
<<<<<<< HEAD
from slamlab.robots.relative_pose import RelativePose
from slamlab.robots.square import SquareRobot, can_move_as_printed
=======
from slamlab.robots.square import SquareRobot
>>>>>>> e2d3fb3 (Printed: P5's refuted formulas in a room of their own; a guard of the explorer is a function)
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
