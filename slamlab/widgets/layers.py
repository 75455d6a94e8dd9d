"""What a `Replay` draws, a layer each: Paths, Landmarks, Particles, LidarPoints, and two more.

The encoding is that of `plots`, as are the words. A layer is checked when it is made.
All is in metres in the world frame, angles in radians, and varies over the T steps of the replay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_shaped
from slamlab.widgets import _pack

__all__ = ["LidarPoints", "Landmarks", "Occupancy", "Particles", "Paths", "WallSegments"]

ARGUMENTS = {
    "truth": "Paths.truth",
    "estimate": "Paths.estimate",
    "dead_reckoning": "Paths.dead_reckoning",
    "wrong": "Paths.wrong",
    "landmarks": "Landmarks.true",
    "landmark_estimates": "Landmarks.estimates",
    "particles": "Particles.poses",
    "scans": "LidarPoints.points",
    "walls": "WallSegments.segments",
    "ellipses": "Paths.covs",
    "landmark_ellipses": "Landmarks.covs",
}
"""The arrays that `replay.js` draws, and which argument each comes from."""

FIXED = ("landmarks", "walls")
"""Those that do not vary with time."""


class Layer:
    """Something that a replay draws."""

    def __post_init__(self) -> None:
        self._arrays()
        self._settings()

    def _arrays(self) -> dict[str, Array | None]:
        """Return the arrays of this layer by their names in `ARGUMENTS`; None takes one away."""
        return {}

    def _settings(self) -> dict[str, Any]:
        """Return what else goes to the browser, such as maps."""
        return {}


@dataclass(frozen=True, eq=False, repr=False)
class Paths(Layer):
    """Up to four paths of one robot, and the 95 % ellipses of the estimate.

    Parameters
    ----------
    truth, estimate, dead_reckoning, wrong : array_like (T, 3) or (T, 2), optional
        Poses x, y, theta, or positions. `wrong` is a variant that is shown to fail. In a
        one-dimensional world (T,) or (T, 1), drawn at y = 0.
    covs : array_like (T, 2, 2) or (T, 3, 3), optional
        Covariances of the estimate, which must stand beside them.

    Examples
    --------
    >>> drive = Paths(truth=[[0, 0, 0], [1, 0, 0]], estimate=[[0, 0, 0], [1.2, 0.1, 0]])
    """

    truth: ArrayLike | None = None
    estimate: ArrayLike | None = None
    dead_reckoning: ArrayLike | None = None
    wrong: ArrayLike | None = None
    covs: ArrayLike | None = None

    def _arrays(self) -> dict[str, Array | None]:
        steps: int | str = "T"
        drawn: dict[str, Array | None] = {}
        for name in ("truth", "estimate", "dead_reckoning", "wrong"):
            given = getattr(self, name)
            if given is not None:
                path = _pack.points(f"Paths.{name}", given, (steps,))
                drawn[name], steps = path, len(path)
        if self.estimate is not None:
            drawn["ellipses"] = None
        if self.covs is not None:
            _needs("Paths.covs", "Paths.estimate", self.estimate)
            drawn["ellipses"] = _pack.ellipses("Paths.covs", self.covs, (steps,))
        return drawn


@dataclass(frozen=True, eq=False, repr=False)
class Landmarks(Layer):
    """True landmarks, estimated ones, and the 95 % ellipses of these.

    Parameters
    ----------
    true : array_like (n, 2), optional
        Where they are.
    estimates : array_like (T, m, 2), optional
        Where the robot believes them, NaN where not yet seen.
    covs : array_like (T, m, 2, 2), optional
        Covariances of the estimates, which must stand beside them; NaN where not yet seen.

    Examples
    --------
    >>> trees = Landmarks([[2.0, 1.0], [4.0, -1.0]])
    """

    true: ArrayLike | None = None
    estimates: ArrayLike | None = None
    covs: ArrayLike | None = None

    def _arrays(self) -> dict[str, Array | None]:
        drawn: dict[str, Array | None] = {}
        if self.true is not None:
            drawn["landmarks"] = _pack.points("Landmarks.true", self.true, ("n",))
        if self.covs is not None:
            _needs("Landmarks.covs", "Landmarks.estimates", self.estimates)
        if self.estimates is not None:
            name, covs = "Landmarks.estimates", self.covs
            estimates = _pack.points(name, self.estimates, ("T", "m"), missing=True)
            shape = estimates.shape[:2]
            ellipses = None if covs is None else _pack.ellipses("Landmarks.covs", covs, shape)
            drawn |= {"landmark_estimates": estimates, "landmark_ellipses": ellipses}
        return drawn


@dataclass(frozen=True, eq=False, repr=False)
class Particles(Layer):
    """The particles of a filter.

    Parameters
    ----------
    poses : array_like (T, M, 2) or (T, M, 3)
        Positions, or poses: then each is drawn with its heading.

    Examples
    --------
    >>> cloud = Particles(np.zeros((12, 100, 3)))
    """

    poses: ArrayLike

    def _arrays(self) -> dict[str, Array | None]:
        return {"particles": _pack.points("Particles.poses", self.poses, ("T", "M"))}


@dataclass(frozen=True, eq=False, repr=False)
class LidarPoints(Layer):
    """Lidar end points, or what else was seen from the robot.

    Parameters
    ----------
    points : array_like (T, k, 2)
        Points in the world frame, as from `Lidar.points`; NaN for a beam without echo.
    beams : bool, default False
        Draw the beams from the robot to the points of the step.
    accumulate : bool, default False
        Keep the points of all steps so far, so that the scans draw a map.

    Examples
    --------
    >>> scans = LidarPoints(np.zeros((12, 36, 2)), accumulate=True)
    """

    points: ArrayLike
    beams: bool = False
    accumulate: bool = False

    def _arrays(self) -> dict[str, Array | None]:
        return {"scans": _pack.points("LidarPoints.points", self.points, ("T", "k"), missing=True)}

    def _settings(self) -> dict[str, Any]:
        return {"beams": bool(self.beams), "accumulate": bool(self.accumulate)}


@dataclass(frozen=True, eq=False, repr=False)
class WallSegments(Layer):
    """Walls as they are.

    Parameters
    ----------
    segments : array_like (k, 2, 2)
        From point to point, as in `WallWorld.segments`.

    Examples
    --------
    >>> corridor = WallSegments([[[0, 0], [9, 0]], [[0, 2], [9, 2]]])
    """

    segments: ArrayLike

    def _arrays(self) -> dict[str, Array | None]:
        return {"walls": as_array("WallSegments.segments", self.segments, ("k", 2, 2))}


@dataclass(frozen=True, eq=False, repr=False)
class Occupancy(Layer):
    """An occupancy map, or one that grows.

    Parameters
    ----------
    probability : array_like (H, W) or (S, H, W)
        Probability in [0, 1] that a cell is occupied, row 0 at the bottom; S maps over time.
    extent : sequence of four floats
        x low, x high, y low, y high of the map, low < high.
    steps : array_like (S,), optional
        The first step at which each of the S maps holds, increasing; 0, 1, ... without it.

    Examples
    --------
    >>> room = Occupancy([[0.0, 1.0], [0.5, 0.5]], extent=[0, 2, 0, 2])
    """

    probability: ArrayLike
    extent: Sequence[float]
    steps: ArrayLike | None = None

    def _settings(self) -> dict[str, Any]:
        name, maps = "Occupancy.probability", self.probability
        maps = as_shaped(name, maps)
        maps = as_array(name, maps[None] if maps.ndim == 2 else maps, ("S", "H", "W"))
        if maps.size == 0 or maps.min() < 0.0 or maps.max() > 1.0:
            raise ValueError(f"{name}: expected numbers in [0, 1], got others or an empty map")
        name, first = "Occupancy.steps", self.steps
        first = np.arange(len(maps)) if first is None else first
        first = as_array(name, first, (len(maps),))
        if (np.diff(first) <= 0).any() or first[0] < 0:
            got = first.astype(int).tolist()
            raise ValueError(f"{name}: expected increasing steps from 0 on, got {got}")
        return {
            "maps": {
                "images": _pack.pack_image(maps, 0.0, 1.0),
                "extent": _pack.box("Occupancy.extent", self.extent),
                "steps": [int(k) for k in first],
            }
        }


def _needs(name: str, other: str, value: Any) -> None:
    if value is None:
        raise ValueError(f"{other}: expected an array because {name} is given, got None")
