"""``slamlab map --localize``: the map that a log is found in, and what is said of the result."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamlab.evaluation.run import Run
from slamlab.localization.global_localization import GlobalLocalization
from slamlab.logs import Log
from slamlab.models import MotionModel, as_scan_sensor
from slamlab.worlds import BitmapWorld

_SURE = 0.8  # the median scan of a path that is believed fits with this share of its points
_SEED = 0  # the same log in the same map gives the same path


@dataclass(frozen=True)
class KnownMap:
    """A map of ROS: where walls are, and where the floor is known to be free."""

    walls: BitmapWorld
    floor: BitmapWorld

    @classmethod
    def read(cls, path: Path) -> KnownMap:
        """Read map.yaml, or that of a folder of results; ValueError if it is no map."""
        file = path / "map.yaml" if path.is_dir() else path
        walls = BitmapWorld.from_file(file, unknown="free")
        if not walls.occupied.any():
            raise ValueError(f"{file}: expected a map with walls, it has none")
        return cls(walls, BitmapWorld.from_file(file))

    @property
    def resolution(self) -> float:
        """Side of a cell (m)."""
        return self.walls.resolution

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top in the world (m)."""
        return self.walls.extent

    def to_image(self) -> NDArray[np.uint8]:
        """Grey values as `OccupancyGrid.to_image`: 0 wall, 254 free, 205 unknown; top first."""
        image = np.where(self.floor.occupied, np.uint8(205), np.uint8(254))
        return np.where(self.walls.occupied, np.uint8(0), image)[::-1]

    def localizer(self, log: Log, motion: MotionModel) -> GlobalLocalization:
        """Return the system that finds the robot of a log in this map."""
        lidar = as_scan_sensor("log.scan", log.scan)
        rng = np.random.default_rng(_SEED)
        return GlobalLocalization(self.walls, lidar, motion, rng, self.floor)


def found(result: Run, distrust: str) -> list[tuple[str, str]]:
    """Say where the robot was found and how well its scans fit, or that it is not sure."""
    system: Any = result.system
    fits = np.array(system.fits)
    share = f"{100 * np.median(fits):.0f} % of the points of the median scan lie on walls"
    if not system.localized:
        return [("localized", f"not sure: no place in the map fits, {distrust}"), ("fit", share)]
    if np.median(fits[system.localized_at :]) < _SURE:
        share += f": the map may be another one or an old one, {distrust}"
    x, y, theta = system.trajectory[0]
    begin = f"({x:.2f} m, {y:.2f} m, {np.rad2deg(theta):.0f} degrees)"
    return [
        ("localized", f"from scan {system.localized_at} on, the scans before backwards"),
        ("began at", begin),
        ("fit", share),
    ]
