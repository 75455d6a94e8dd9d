"""Simulator: P5's program as an interactive figure, in JupyterLab and in the static page.

Rooms, a small table of signatures and the settings are packed here; driving, ray casting and
localization run in `simulator.js`. Where a kernel is alive, the library answers beside it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import anywidget
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from slamlab._checks import as_array, as_count
from slamlab.localization.signature import SignatureMap, spectrum
from slamlab.robots import SquareRobot
from slamlab.sensors import Lidar
from slamlab.widgets import _pack
from slamlab.widgets._pack import Packed, script
from slamlab.worlds import BitmapWorld

__all__ = ["Simulator"]

N_HARMONICS = 16
"""Harmonics of a signature; `simulator.js` has the same number."""


class Simulator(anywidget.AnyWidget):
    """Drive a square robot with a lidar through rooms of pixels, and see where it seems to be.

    Parameters
    ----------
    worlds : mapping of str to BitmapWorld
        Rooms by name; the reader chooses.
    starts : mapping of str to array_like (3,), optional
        Pose (m, m, rad) at which the robot starts in a room. Without it, the free place nearest
        to the middle.
    robot : SquareRobot, optional
        Side 0.30 m without it.
    lidar : Lidar, optional
        Full circle, at the centre, without noise; 120 beams without it.
    stride : int, default 10
        The page's table holds the signature of every `stride`-th cell.
    fine_stride : int, default 4
        The same for the map with which Python answers; it is built when first asked.
    title, question : str
        Name of the figure and the question it answers.

    Attributes
    ----------
    ask : dict
        What the figure last asked: number, room, pose.
    answer : dict
        Python's answer: ranges, estimated pose, whether it is ambiguous.
    payload : dict
        What the browser gets.

    Raises
    ------
    ValueError
        If there is no room, a room has no free place for the table, a start is blocked, or the
        lidar is not of the kind described.

    Examples
    --------
    >>> from slamlab.worlds import rooms
    >>> Simulator({"thesis": rooms.thesis_room()}, stride=40)
    Simulator(thesis; 120 beams)
    """

    _esm = script("shared.js", "simulator.js")
    _css = script("widgets.css", "simulator.css")
    payload = traitlets.Dict().tag(sync=True)
    ask = traitlets.Dict().tag(sync=True)
    answer = traitlets.Dict().tag(sync=True)

    def __init__(
        self,
        worlds: Mapping[str, BitmapWorld],
        starts: Mapping[str, ArrayLike] | None = None,
        robot: SquareRobot | None = None,
        lidar: Lidar | None = None,
        stride: int = 10,
        fine_stride: int = 4,
        title: str = "",
        question: str = "",
    ) -> None:
        if not isinstance(worlds, Mapping) or not worlds:
            raise ValueError(f"worlds: expected names with BitmapWorlds, got {worlds!r}")
        robot, lidar = robot or SquareRobot(0.30), _checked_lidar(lidar or Lidar(120))
        stride = as_count("stride", stride, 1)
        self._fine_stride = as_count("fine_stride", fine_stride, 1)
        self._worlds, self._lidar = list(worlds.values()), lidar
        self._maps: dict[int, SignatureMap] = {}
        given = dict(starts or {})
        unknown = set(given) - set(worlds)
        if unknown:
            raise ValueError(f"starts: expected names of rooms, got {sorted(unknown)}")
        payload = {
            "rooms": [
                _room(name, world, given.get(name), robot, lidar, stride)
                for name, world in worlds.items()
            ],
            "sensor": {
                "n_beams": lidar.n_beams,
                "max_range": None if np.isinf(lidar.max_range) else float(lidar.max_range),
            },
            "side": robot.side,
            "title": _pack.text("title", title),
            "question": _pack.text("question", question),
        }
        super().__init__(payload=payload)

    def __repr__(self) -> str:
        """Name the rooms: the same text on every machine."""
        names = ", ".join(room["name"] for room in self.payload["rooms"])
        return f"Simulator({names}; {self._lidar.n_beams} beams)"

    @traitlets.observe("ask")
    def _reply(self, change: dict[str, Any]) -> None:
        """Answer with the library: real beams, and a map of signatures that is finer."""
        asked = change["new"]
        if not asked:
            return
        room, pose = int(asked["room"]), np.array(asked["pose"], dtype=float)
        world = self._worlds[room]
        ranges = self._lidar.scan(world, pose)
        if room not in self._maps:
            self._maps[room] = SignatureMap.build(world, self._lidar, self._fine_stride)
        found = self._maps[room].locate(ranges)
        self.answer = {
            "id": asked["id"],
            "ranges": [None if np.isinf(r) else float(r) for r in ranges],
            "pose": [float(v) for v in found.pose],
            "ambiguous": bool(found.ambiguous),
        }


def _checked_lidar(lidar: Lidar) -> Lidar:
    full = lidar.field_of_view >= 2 * np.pi - 1e-9
    quiet = lidar.sigma_range == 0 and lidar.p_miss == 0
    if not full or not quiet or lidar.offset != 0 or lidar.n_beams < 2 * N_HARMONICS:
        raise ValueError(
            "lidar: expected a full circle of at least 32 beams at the centre, without noise, "
            f"got {lidar!r}"
        )
    return lidar


def _room(
    name: str,
    world: BitmapWorld,
    start: ArrayLike | None,
    robot: SquareRobot,
    lidar: Lidar,
    stride: int,
) -> dict[str, Any]:
    """One room as the browser gets it."""
    if not isinstance(world, BitmapWorld):
        raise ValueError(f"worlds[{name!r}]: expected a BitmapWorld, got {world!r}")
    rows, columns = world.occupied.shape
    pose = _start(name, world, start, robot)
    return {
        "name": _pack.text("worlds", name),
        "rows": rows,
        "columns": columns,
        "resolution": world.resolution,
        "origin": [float(v) for v in world.origin],
        "occupied": _pack.pack_image(world.occupied.astype(float), 0.0, 1.0),
        "spectra": _table(name, world, lidar, stride),
        "stride": stride,
        "start": [float(v) for v in pose],
    }


def _table(name: str, world: BitmapWorld, lidar: Lidar, stride: int) -> Packed:
    """Signatures (n, 16) of the free cells of the grid, row by row."""
    places = world.centres(stride)
    places = places[world.is_free(places)]
    if len(places) == 0:
        raise ValueError(f"worlds[{name!r}]: expected free cells on a grid of {stride}, got none")
    poses = np.column_stack([places, np.zeros(len(places))])
    left, bottom, right, top = world.bounds
    reach = min(float(lidar.max_range), float(np.hypot(right - left, top - bottom)))
    ranges = np.minimum(lidar.scan(world, poses), reach)
    return _pack.pack_numbers(spectrum(ranges, N_HARMONICS))


def _start(
    name: str, world: BitmapWorld, start: ArrayLike | None, robot: SquareRobot
) -> np.ndarray:
    """Return the start asked for, or the roomy place nearest to the middle."""
    if start is not None:
        pose = as_array(f"starts[{name!r}]", start, (3,))
        if bool(world.collides(robot.footprint, pose)):
            raise ValueError(
                f"starts[{name!r}]: expected a free pose, the robot touches at {pose}"
            )
        return pose
    places = world.centres(4).reshape(-1, 2)
    places = places[world.clearance(places) > robot.circumradius]
    if len(places) == 0:
        raise ValueError(f"worlds[{name!r}]: expected a place where the robot can turn, got none")
    left, bottom, right, top = world.bounds
    middle = 0.5 * np.array([left + right, bottom + top])
    return np.array([*places[np.argmin(np.hypot(*(places - middle).T))], 0.0])
