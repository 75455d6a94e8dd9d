"""How the robot moves. Floor 1 of the house."""

from slamlab.robots.mecanum import YOUBOT, Mecanum
from slamlab.robots.unicycle import Unicycle

__all__ = ["YOUBOT", "Mecanum", "Unicycle"]
