"""Where the robot lives: rooms of pixels, of walls, of landmarks."""

from slamlab.worlds import rooms
from slamlab.worlds._world import free_poses
from slamlab.worlds.bitmap import BitmapWorld
from slamlab.worlds.landmarks import LandmarkWorld
from slamlab.worlds.terrain import Terrain
from slamlab.worlds.walls import WallWorld

__all__ = ["BitmapWorld", "LandmarkWorld", "Terrain", "WallWorld", "free_poses", "rooms"]
