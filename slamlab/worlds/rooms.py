"""Rooms for the lessons: drawn once, or drawn anew from a seed.

P5 shows its rooms only as pictures (figures 18 to 21), P1 its own only as a model (figure 4):
these stand in for them, with the sizes that the papers give.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from slamlab._checks import Array, as_array, as_count, as_rng
from slamlab.models import Bounds
from slamlab.worlds.bitmap import BitmapWorld
from slamlab.worlds.walls import WallWorld, segment_clearance, sides_of

__all__ = [
    "box_room",
    "corridor",
    "long_corridor",
    "mirrored_pair",
    "office",
    "random_box_room",
    "random_room",
    "ring",
    "ring_corridor",
    "symmetric_room",
    "thesis_room",
    "thesis_room_two",
]

RING_WIDTH = 2.4  # of the corridor of `ring_corridor` (m)
_WALL = 5  # thickness (px) of the outer walls


def thesis_room() -> BitmapWorld:
    """Room of P5, first trial: 400 x 400 px of 0.01 m, three obstacles, no symmetry.

    Examples
    --------
    >>> thesis_room()
    BitmapWorld(400 x 400 cells of 0.01 m)
    """
    cells = _empty(400, 400)
    _polygon(cells, _box(70, 250, 150, 320))
    _polygon(cells, [(230, 270), (330, 300), (322, 326), (222, 296)])
    _disc(cells, 270, 130, 38)
    return BitmapWorld(cells, 0.01)


def thesis_room_two() -> BitmapWorld:
    """Room of P5, second trial: the same walls, other obstacles."""
    cells = _empty(400, 400)
    _polygon(cells, [(80, 60), (150, 70), (105, 135)])
    _polygon(cells, _box(195, 165, 225, 300))
    _polygon(cells, _box(225, 165, 300, 195))
    _disc(cells, 95, 285, 30)
    return BitmapWorld(cells, 0.01)


def symmetric_room() -> BitmapWorld:
    """Room that looks the same after half a turn: every place has a twin no scan can tell."""
    cells = _empty(400, 400)
    _polygon(cells, _box(70, 230, 160, 280))
    _polygon(cells, [(240, 310), (300, 330), (260, 350)])
    _disc(cells, 90, 110, 25)
    return BitmapWorld(cells | cells[::-1, ::-1], 0.01)


def mirrored_pair() -> tuple[BitmapWorld, BitmapWorld]:
    """Return a room and its mirror image, left and right exchanged."""
    room = thesis_room()
    return room, BitmapWorld(room.occupied[:, ::-1], room.resolution)


def office() -> BitmapWorld:
    """Office floor of 12 m x 8 m: a corridor, five rooms, doors of 0.9 m, some furniture.

    Examples
    --------
    >>> office()
    BitmapWorld(400 x 600 cells of 0.02 m)
    """
    walls: list[Bounds] = [(0, 3.0, 12, 3.1), (0, 4.9, 12, 5.0), (4, 0, 4.1, 3), (8, 0, 8.1, 3)]
    doors = [(1.6, 2.9, 2.5, 3.2), (5.4, 2.9, 6.3, 3.2), (9.9, 2.9, 10.8, 3.2)]
    desks = [(0.6, 0.7, 1.8, 1.3), (5.0, 0.5, 6.6, 1.1), (9.0, 1.2, 9.6, 2.4)]
    walls += [(6, 5, 6.1, 8)]
    doors += [(2.2, 4.8, 3.1, 5.1), (8.0, 4.8, 8.9, 5.1)]
    desks += [(0.8, 6.6, 2.8, 7.2), (4.6, 5.9, 5.2, 7.3), (7.2, 6.5, 8.6, 7.3)]
    desks += [(10.6, 5.8, 11.2, 7)]
    return _plan(12, 8, 50, walls, doors, desks)


def corridor() -> BitmapWorld:
    """Empty corridor of 12 m x 2 m: along it, one scan looks like the next."""
    return BitmapWorld(_empty(100, 600), 0.02)


def long_corridor() -> BitmapWorld:
    """Empty corridor of 40 m x 2 m: with a sight of 5 m most places in it look alike."""
    return BitmapWorld(_empty(50, 1010), 0.04)


def ring() -> BitmapWorld:
    """Corridor of 2.5 m round a block, 30 m x 20 m: who drives round comes back to the start.

    Two alcoves and some cupboards make a place of the middle of the lower side; the corners have
    marks of their own, and between them the walls are plain.
    """
    block = [(2.75, 2.75, 27.25, 17.25)]
    # The entrance hall, in the middle of the lower side: two alcoves and some cupboards.
    alcoves = [(11.2, 2.7, 13.0, 4.3), (16.6, 2.7, 19.4, 4.0)]
    boxes = [(9.2, 0.0, 10.0, 0.8), (14.0, 0.0, 15.2, 0.6), (18.2, 3.4, 18.8, 4.0)]
    boxes += [(20.6, 0.0, 21.0, 0.9), (14.4, 2.3, 15.0, 3.0), (11.2, 3.9, 11.8, 4.3)]
    # Corners, lower right to lower left, and a cupboard in the middle of each other side.
    boxes += [(28.9, 0.0, 30.0, 0.8), (27.0, 4.0, 27.6, 4.3), (29.4, 9.8, 30.0, 11.0)]
    boxes += [(29.2, 18.6, 30.0, 20.0), (24.1, 19.4, 24.5, 20.0), (25.6, 17.0, 26.4, 17.6)]
    boxes += [(14.0, 17.0, 14.4, 17.5), (8.2, 19.3, 9.0, 20.0), (0.0, 19.0, 0.6, 20.0)]
    boxes += [(2.4, 15.2, 3.0, 15.5), (0.0, 8.0, 0.6, 8.9), (0.0, 0.0, 0.9, 0.9)]
    return _plan(30, 20, 20, block, alcoves, boxes)


def random_room(rng: np.random.Generator, n_obstacles: int = 5) -> BitmapWorld:
    """Draw a room of 400 x 400 px of 0.01 m with boxes, turned boxes and discs.

    Parameters
    ----------
    rng : numpy.random.Generator
    n_obstacles : int, default 5

    Returns
    -------
    BitmapWorld
        All cells with a clearance of 0.23 m or more are connected, so a square robot of 0.30 m
        (half diagonal 0.212 m) can reach every one from every other.

    Examples
    --------
    >>> random_room(np.random.default_rng(3), n_obstacles=2)
    BitmapWorld(400 x 400 cells of 0.01 m)
    """
    rng, n_obstacles = as_rng("rng", rng), as_count("n_obstacles", n_obstacles)
    cells = _empty(400, 400)
    placed = 0
    while placed < n_obstacles:
        trial = cells.copy()
        _random_obstacle(trial, rng)
        if _connected(_wide(BitmapWorld(trial, 0.01))):
            cells, placed = trial, placed + 1
    return BitmapWorld(cells, 0.01)


def box_room() -> WallWorld:
    """Room standing in for P1's figure 4: 10 m x 8 m with three boxes, one of them turned.

    Examples
    --------
    >>> box_room()
    WallWorld(16 walls, closed)
    """
    return WallWorld.from_polygons(
        _box(0, 0, 10, 8),
        _box(1.8, 5.2, 3.6, 6.4),
        _box(6.6, 4.6, 7.6, 6.6),
        _turned_box((4.6, 2.3), (2.0, 0.9), 0.35),
    )


def random_box_room(rng: np.random.Generator) -> WallWorld:
    """Draw a room of 7 m to 12 m by 6 m to 9 m with up to five turned boxes, at least one.

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    WallWorld
        Boxes keep 1 m from the walls and from each other. Grown by half of that they are convex
        and apart, so what is left hangs together: a robot of 0.6 m x 0.4 m (half diagonal 0.36 m)
        reaches every place that has a clearance of its half diagonal.

    Examples
    --------
    >>> random_box_room(np.random.default_rng(3))
    WallWorld(8 walls, closed)
    """
    rng = as_rng("rng", rng)
    size = rng.uniform((7, 6), (12, 9)).round(2)
    outlines = [_box(0, 0, *size)]
    room = WallWorld.from_polygons(*outlines)
    for _ in range(20 * rng.integers(2, 6)):
        sides = rng.uniform(0.5, 2.0, 2)
        box = _turned_box(rng.uniform(0, size), sides, rng.uniform(0, np.pi / 2)).round(4)
        apart = len(outlines) <= 5 and room.clearance(box).min() >= 1.0
        corners = np.concatenate(outlines)
        if apart and segment_clearance(sides_of(box), corners).min() >= 1.0:
            outlines.append(box)
            room = WallWorld.from_polygons(*outlines)
    return room if len(outlines) > 1 else random_box_room(rng)


def ring_corridor(size: tuple[float, float], rng: np.random.Generator) -> WallWorld:
    """Draw a corridor of 2.4 m round a closed block, with pillars along its outer walls.

    Parameters
    ----------
    size : (float, float)
        Outer sides along x and y (m), at least 7.
    rng : numpy.random.Generator

    Examples
    --------
    >>> ring_corridor((12.0, 8.0), np.random.default_rng(5)).bounds
    (0.0, 0.0, 12.0, 8.0)
    """
    width, depth = sides = as_array("size", size, (2,))
    if sides.min() < 7.0:
        raise ValueError(f"size: expected sides of at least 7 m, got {size!r:.80}")
    rng, wide = as_rng("rng", rng), RING_WIDTH
    outlines = [_box(0, 0, width, depth), _box(wide, wide, width - wide, depth - wide)]
    for horizontal, far in product((True, False), (False, True)):
        length = width if horizontal else depth
        along = np.cumsum(rng.uniform(1.5, 4.0, int(length)))
        for at in along[(along > 1.0) & (along < length - 1.5)]:
            across = (depth if horizontal else width) - 0.3 if far else 1e-3
            x, y = (at, across) if horizontal else (across, at)
            outlines.append(_box(x, y, x + 0.299, y + 0.299))
    return WallWorld.from_polygons(*outlines)


def _empty(rows: int, columns: int) -> NDArray[np.bool_]:
    """Cells with walls round the edge."""
    cells = np.ones((rows, columns), dtype=bool)
    cells[_WALL:-_WALL, _WALL:-_WALL] = False
    return cells


def _plan(width: int, depth: int, scale: int, *layers: list[Bounds]) -> BitmapWorld:
    """Floor of so many metres, and cells a metre: boxes (m) of wall, of floor in it, of wall."""
    cells = _empty(depth * scale, width * scale)
    for occupied, boxes in zip((True, False, True), layers, strict=True):
        for box in boxes:
            _polygon(cells, _box(*(scale * side for side in box)), occupied)
    return BitmapWorld(cells, 1 / scale)


def _box(left: float, bottom: float, right: float, top: float) -> Array:
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top]], dtype=float)


def _turned_box(centre: ArrayLike, sides: ArrayLike, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    corners = _box(-0.5, -0.5, 0.5, 0.5) * np.asarray(sides, dtype=float)
    return np.asarray(centre) + corners @ np.array([[c, s], [-s, c]])


def _polygon(cells: NDArray[np.bool_], vertices: ArrayLike, value: bool = True) -> None:
    """Fill the cells whose centres lie in a convex polygon given counterclockwise (px)."""
    vertices = as_array("vertices", vertices, ("k", 2))
    low, high = np.clip([vertices.min(0), vertices.max(0) + 1], 0, cells.shape[::-1]).astype(int)
    around = slice(low[1], high[1]), slice(low[0], high[0])
    y, x = np.mgrid[around] + 0.5
    inside = np.ones(x.shape, dtype=bool)
    for a, b in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        inside &= (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0
    cells[around][inside] = value


def _disc(cells: NDArray[np.bool_], x: float, y: float, radius: float) -> None:
    rows, columns = np.mgrid[: cells.shape[0], : cells.shape[1]] + 0.5
    cells |= np.hypot(columns - x, rows - y) < radius


def _random_obstacle(cells: NDArray[np.bool_], rng: np.random.Generator) -> None:
    x, y = rng.uniform(30, 370, 2)
    if rng.random() < 0.3:
        _disc(cells, x, y, rng.uniform(15, 40))
        return
    angle = 0.0 if rng.random() < 0.5 else rng.uniform(0, np.pi / 2)
    _polygon(cells, _turned_box((x, y), rng.uniform(20, 110, 2), angle))


def _wide(room: BitmapWorld) -> NDArray[np.bool_]:
    """Cells of 0.01 m whose centre has a clearance of 0.23 m or more."""
    # A cell begins 0.5 to 0.71 px before its centre: only round 23.6 px a closer look is needed.
    distance = ndimage.distance_transform_edt(~room.occupied)
    wide = np.asarray(distance > 23.8)
    near = ~wide & (distance > 23.4)
    wide[near] = room.clearance(room.centres()[near]) >= 0.23
    return wide


def _connected(wide: NDArray[np.bool_]) -> bool:
    """Tell whether the wide places form one piece, and a large one."""
    return ndimage.label(wide)[1] == 1 and wide.sum() > 0.2 * wide.size
