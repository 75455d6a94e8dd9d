"""Simulator: P5's program as an interactive figure, in JupyterLab and in the static page.

Rooms are packed here; driving, ray casting, localization and exploration run in
`simulator_world.js`. Where a kernel is alive, the library answers beside it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike

from slamlab._checks import as_array, as_count
from slamlab.localization.signature import SignatureMap
from slamlab.robots import SquareRobot
from slamlab.sensors import Lidar
from slamlab.widgets import _pack
from slamlab.widgets._pack import Figure, script
from slamlab.worlds import BitmapWorld

__all__ = ["Simulator"]


class Simulator(Figure):
    """Drive a square robot with a lidar through rooms of pixels, and see where it seems to be.

    The reader may load a BMP or PNG picture as a room or draw one, place the robot, choose beams,
    noise, step and turn, let it explore by P5's strategies under its guard or a mended one, and
    save the log, which `slamlab.datasets.read_simulator` reads.

    Parameters
    ----------
    worlds : mapping of str to BitmapWorld
        Rooms by name, at least one; the reader chooses.
    starts : mapping of str to array_like (3,), optional
        Pose (m, m, rad) at which the robot starts in a room. Without it, the free place nearest
        to the middle.
    robot : SquareRobot, optional
        Side 0.30 m without it.
    lidar : Lidar, optional
        Full circle, at the centre, endless, without noise; 120 beams without it. 12 to 360 beams.
    fine_stride : int, default 4
        The map with which Python answers holds every such cell; it is built when first asked.
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
        If a room has no place for the robot, or a start is blocked.

    Examples
    --------
    >>> from slamlab.worlds import rooms
    >>> Simulator({"thesis": rooms.thesis_room()})
    Simulator(thesis; 120 beams)
    """

    _esm = script("shared.js", "simulator_world.js", "simulator.js")
    _css = script("widgets.css", "simulator.css")
    ask = traitlets.Dict().tag(sync=True)
    answer = traitlets.Dict().tag(sync=True)

    def __init__(
        self,
        worlds: Mapping[str, BitmapWorld],
        starts: Mapping[str, ArrayLike] | None = None,
        robot: SquareRobot | None = None,
        lidar: Lidar | None = None,
        fine_stride: int = 4,
        title: str = "",
        question: str = "",
    ) -> None:
        if not isinstance(worlds, Mapping) or not worlds:
            raise ValueError(f"worlds: expected names with BitmapWorlds, got {worlds!r}")
        robot, lidar = robot or SquareRobot(0.30), _checked_lidar(lidar or Lidar(120))
        self._fine_stride = as_count("fine_stride", fine_stride, 1)
        self._worlds, self._lidar = list(worlds.values()), lidar
        self._maps: dict[tuple[int, int], SignatureMap] = {}
        given = dict(starts or {})
        unknown = set(given) - set(worlds)
        if unknown:
            raise ValueError(f"starts: expected names of rooms, got {sorted(unknown)}")
        rooms = [_room(name, world, given.get(name), robot) for name, world in worlds.items()]
        payload = {"rooms": rooms, "n_beams": lidar.n_beams, "side": robot.side}
        super().__init__(title, question, payload)

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
        key = room, int(asked.get("n_beams", self._lidar.n_beams))
        world, lidar = self._worlds[room], Lidar(key[1])
        ranges = lidar.scan(world, pose)
        if key not in self._maps:
            self._maps[key] = SignatureMap.build(world, lidar, self._fine_stride)
        found = self._maps[key].locate(ranges)
        self.answer = {
            "id": asked["id"],
            "ranges": [None if np.isinf(r) else float(r) for r in ranges],
            "pose": [float(v) for v in found.pose],
            "ambiguous": bool(found.ambiguous),
        }


def _checked_lidar(lidar: Lidar) -> Lidar:
    full = lidar.field_of_view >= 2 * np.pi - 1e-9 and np.isinf(lidar.max_range)
    quiet = lidar.sigma_range == 0 and lidar.p_miss == 0
    if not full or not quiet or lidar.offset != 0 or not 12 <= lidar.n_beams <= 360:
        wanted = "a full circle of 12 to 360 endless beams at the centre, without noise"
        raise ValueError(f"lidar: expected {wanted}, got {lidar!r}")
    return lidar


def _room(
    name: str, world: BitmapWorld, start: ArrayLike | None, robot: SquareRobot
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
        "start": [float(v) for v in pose],
    }


def _start(
    name: str, world: BitmapWorld, start: ArrayLike | None, robot: SquareRobot
) -> np.ndarray:
    """Return the start asked for, or the roomy place nearest to the middle."""
    if start is not None:
        argument = f"starts[{name!r}]"
        pose = as_array(argument, start, (3,))
        if world.collides(robot.footprint, pose):
            raise ValueError(f"{argument}: expected a free pose, the robot touches at {pose}")
        return pose
    places = world.centres(4).reshape(-1, 2)
    places = places[world.clearance(places) > robot.circumradius]
    if len(places) == 0:
        raise ValueError(f"worlds[{name!r}]: expected a place where the robot can turn, got none")
    left, bottom, right, top = world.bounds
    middle = 0.5 * np.array([left + right, bottom + top])
    return np.array([*places[np.argmin(np.hypot(*(places - middle).T))], 0.0])
