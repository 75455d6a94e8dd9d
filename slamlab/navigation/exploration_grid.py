"""What an exploring robot knows of the floor: seen free, seen occupied, or unknown.

A coarse grid, fed with whole scans, that answers where the unknown begins (the frontier of
Yamauchi 1997), where the body fits, and how to get there. Chapters 18 and 20.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from slamlab._checks import Array, as_array, as_count, as_distances, as_scalar
from slamlab.grids import Grid
from slamlab.kernels import compiled
from slamlab.kernels.floor_rules import (
    FREE,
    MOST_PASSES,
    OCCUPIED,
    THROUGH,
    UNKNOWN,
    WALL_STEP,
    WIDEST_WEDGE,
)
from slamlab.models import ScanSensor, as_scan_sensor

__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "ExplorationGrid", "ShortestPaths"]


class ExplorationGrid(Grid):
    """A grid of cells that are unknown, free or occupied.

    A cell is free when its centre lies between two neighbouring beams and nearer than both their
    ends; it is occupied when a beam ended in it. Three scans that look through an occupied cell,
    and none between that meets it, free it again: walls that a pose a little wrong has smeared
    over a doorway do not close it for ever.

    Parameters
    ----------
    bounds : array_like, shape (4,)
        Left, bottom, right, top of the grid (m), left < right and bottom < top.
    resolution : float, default 0.05
        Side of a cell (m).
    grow : bool, default False
        Enlarge the grid where a beam ends near its edge or beyond. If False, beams are cut there.

    Attributes
    ----------
    state : ndarray of uint8, shape (rows, columns)
        `UNKNOWN`, `FREE` or `OCCUPIED`; row 0 at the bottom.
    blacklisted : ndarray of bool, shape (rows, columns)
        Frontier cells that a scan from close by did not clear up: they are left alone.

    Examples
    --------
    >>> from slamlab.logs import ScanGeometry
    >>> floor = ExplorationGrid([0, 0, 4, 1], 1.0)
    >>> beams = ScanGeometry(np.deg2rad([-5, 5]))
    >>> floor.insert([0.5, 0.5, 0.0], [2.0, 2.0], beams)
    >>> floor.state.tolist()
    [[1, 1, 2, 0]]
    """

    def __init__(self, bounds: ArrayLike, resolution: float = 0.05, grow: bool = False) -> None:
        frame = Grid.over(bounds, resolution)
        super().__init__(frame.shape, frame.resolution, frame.origin)
        self._grows = bool(grow)
        self.state = np.zeros(self.shape, dtype=np.uint8)
        self.blacklisted = np.zeros(self.shape, dtype=np.bool_)
        self._passes = np.zeros(self.shape, dtype=np.uint8)
        self._free, self._room = np.zeros((0, 0), dtype=np.bool_), np.zeros((0, 0))

    def cell(self, point: ArrayLike) -> tuple[int, int]:
        """Row and column of the cell of a point (2,), or of the nearest cell of the grid."""
        row, column = self.cells(as_array("point", point, (2,)))
        rows, columns = self.shape
        return int(np.clip(row, 0, rows - 1)), int(np.clip(column, 0, columns - 1))

    def insert(self, pose: ArrayLike, ranges: ArrayLike, lidar: ScanSensor) -> None:
        """Add what one scan shows.

        Parameters
        ----------
        pose : array_like, shape (3,)
            Body in the world (m, m, rad).
        ranges : array_like, shape (n_beams,)
            Measured ranges (m), not negative: inf, or ``lidar.max_range`` and more, met nothing up
            to there; NaN says nothing. Between beams more than 12.5 degrees apart nothing is
            known.
        lidar : ScanSensor
        """
        pose = as_array("pose", pose, (3,))
        angles = np.asarray(as_scan_sensor("lidar", lidar).beam_angles, dtype=float)
        ranges = as_distances("ranges", ranges, (len(angles),))
        # A lost beam is left out: its neighbours are neighbours now.
        order = np.argsort(angles)
        order = order[~np.isnan(ranges[order])]
        if len(order) == 0:
            return
        angles, ranges = angles[order], ranges[order]
        met = ranges < lidar.max_range
        reach = np.minimum(ranges, lidar.max_range)
        sensor_position = pose[:2] + lidar.offset * np.array([np.cos(pose[2]), np.sin(pose[2])])
        if self._grows:
            beams = pose[2] + angles
            self._make_room(
                sensor_position + reach[:, None] * np.stack([np.cos(beams), np.sin(beams)], -1)
            )
        x, y = self.scaled(sensor_position)
        # Endless beams are cut where they have left the grid for certain.
        longest = sum(self.shape) + np.hypot(x, y)
        reach = np.minimum(reach / self.resolution, longest)
        mark_walls(self.state, self._passes, x, y, pose[2], angles, reach, met)
        mark_free(self.state, self._passes, x, y, pose[2], angles, reach)

    def _make_room(self, ends: Array) -> None:
        """Enlarge the grid beyond the ends (n, 2) of beams; endless ones do not count."""
        ends = ends[np.isfinite(ends).all(-1)]
        # Beyond the last floor that was seen there is a cell, and it is unknown.
        added = self.grow(ends, margin=2) if len(ends) else None
        if added is not None:
            for name in ("state", "blacklisted", "_passes"):
                setattr(self, name, np.pad(getattr(self, name), added))

    def frontier(self) -> NDArray[np.bool_]:
        """Free cells beside an unknown one, shape (rows, columns), without the `blacklisted`."""
        unknown = self.state == UNKNOWN
        beside = np.zeros_like(unknown)
        beside[1:] |= unknown[:-1]
        beside[:-1] |= unknown[1:]
        beside[:, 1:] |= unknown[:, :-1]
        beside[:, :-1] |= unknown[:, 1:]
        return beside & (self.state == FREE) & ~self.blacklisted

    def blacklist_frontier(self, point: ArrayLike, radius: float) -> None:
        """Give up the frontier cells within `radius` (m) of a point (2,): the scan is taken."""
        point, radius = as_array("point", point, (2,)), as_scalar("radius", radius, 0.0, 1e9)
        row, column = self.cell(point)
        reach = int(np.ceil(radius / self.resolution))
        rows = slice(max(row - reach, 0), row + reach + 1)
        columns = slice(max(column - reach, 0), column + reach + 1)
        gap = self.centres_of(rows, columns) - point
        near = np.hypot(gap[..., 0], gap[..., 1]) <= radius
        self.blacklisted[rows, columns] |= near & self.frontier()[rows, columns]

    def traversable(self, radius: float) -> NDArray[np.bool_]:
        """Cells where a disc lies on seen free floor, shape (rows, columns).

        Parameters
        ----------
        radius : float
            Radius of the disc (m). Half the diagonal of a cell is kept in addition, for only the
            centres of cells were seen.
        """
        radius, free = as_scalar("radius", radius), np.pad(self.state == FREE, 1)
        # A plan asks for several radii in turn; the room round each cell is the same for all.
        if not np.array_equal(free, self._free):
            self._free, distance = free, np.zeros(free.shape)
            box = box_of(free, 1)
            distance[box] = ndimage.distance_transform_edt(free[box])
            self._room = distance[1:-1, 1:-1] * self.resolution
        return np.asarray(self._room >= radius + self.resolution * np.sqrt(0.5))

    def shortest_paths(self, start: ArrayLike, radius: float) -> ShortestPaths:
        """Shortest ways of a disc from a point to all cells.

        Parameters
        ----------
        start : array_like, shape (2,)
            Where the way begins (m). If the disc does not fit there, the nearest cell within
            its radius where it fits takes its place.
        radius : float
            Radius of the disc (m).
        """
        fits = self.traversable(as_scalar("radius", radius, 0.0))
        begin = self._nearest(fits, as_array("start", start, (2,)), radius)
        lengths = np.full(fits.shape, np.inf)
        parents = np.full(fits.shape, -1, dtype=np.int32)
        if begin is not None:
            wavefront(fits, *begin, lengths, parents)
        return ShortestPaths(self, lengths * self.resolution, parents, fits)

    def plan(self, start: ArrayLike, goal: ArrayLike, radius: float) -> Array | None:
        """Way of a disc from one point to another over seen free floor.

        Parameters
        ----------
        start, goal : array_like, shape (2,)
            In the world (m).
        radius : float
            Radius of the disc (m).

        Returns
        -------
        ndarray, shape (k, 2), or None
            Points to drive through, the cell of the goal last; None if there is no way.
        """
        ways = self.shortest_paths(start, radius)
        cell = self.cell(as_array("goal", goal, (2,)))
        return ways.to(cell) if np.isfinite(ways.lengths[cell]) else None

    def _nearest(
        self, mask: NDArray[np.bool_], point: Array, radius: float
    ) -> tuple[int, int] | None:
        """Cell of the mask nearest to a point, if there is one within the radius."""
        row, column = self.cell(point)
        if mask[row, column]:
            return row, column
        rows, columns = np.nonzero(mask)
        if len(rows) == 0:
            return None
        gap = np.hypot(*(self.centres()[rows, columns] - point).T)
        best = int(np.argmin(gap))
        return (int(rows[best]), int(columns[best])) if gap[best] <= radius else None

    def expected_gain(self, points: ArrayLike, reach: float, n_rays: int = 36) -> Array:
        """Unknown floor that a scan from each point would show, as far as one can tell.

        Rays run over free and unknown cells alike and stop at an occupied one.

        Parameters
        ----------
        points : array_like, shape (n, 2)
            In the world (m).
        reach : float
            Length of the rays (m).
        n_rays : int, default 36

        Returns
        -------
        ndarray, shape (n,)
            Square metres.
        """
        points = as_array("points", points, ("n", 2))
        out = np.zeros(len(points))
        scaled = np.ascontiguousarray(self.scaled(points))
        n_rays, reach = as_count("n_rays", n_rays, 1), as_scalar("reach", reach, 0.0)
        unknown_area(self.state, scaled, reach / self.resolution, n_rays, out)
        return out * self.resolution**2


@dataclass(frozen=True, eq=False)
class ShortestPaths:
    """Shortest ways of a disc from one place to all cells of a floor.

    Attributes
    ----------
    floor : ExplorationGrid
    lengths : ndarray, shape (rows, columns)
        In metres, by steps to the eight neighbours; inf where there is no way.
    parents : ndarray of int, shape (rows, columns)
        Flat index of the cell before, -1 at the start and where there is no way.
    traversable : ndarray of bool, shape (rows, columns)
        Where the disc may stand.
    """

    floor: ExplorationGrid
    lengths: Array
    parents: NDArray[np.int32]
    traversable: NDArray[np.bool_]

    def to(self, goal: tuple[int, int]) -> Array:
        """Corners (k, 2) of the way to a cell (m), shortened where a straight line fits."""
        columns = self.traversable.shape[1]
        cells = [goal]
        while (before := self.parents[cells[-1]]) >= 0:
            cells.append((int(before) // columns, int(before) % columns))
        way = np.array(cells[::-1], dtype=np.int64)
        corners = way[corners_of(self.traversable, way)]
        return self.floor.origin + self.floor.resolution * (corners[:, ::-1] + 0.5)


def box_of(mask: NDArray[np.bool_], margin: int = 0) -> tuple[slice, slice]:
    """Rows and columns that hold all true cells, and so many more on every side; none for none."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if len(rows) == 0:
        return slice(0), slice(0)
    ends = (rows[0], rows[-1]), (columns[0], columns[-1])
    row, column = (slice(low - margin, high + 1 + margin) for low, high in ends)
    return row, column


# What a scan shows and where a path leads, in cells. The compiled twins take the same arguments.


@compiled("floor.mark_walls")
def mark_walls(
    state: NDArray[np.uint8],
    passes: NDArray[np.uint8],
    x: float,
    y: float,
    heading: float,
    angles: Array,
    reach: Array,
    met: NDArray[np.bool_],
) -> None:
    """Mark the cells in which beams ended, and those between two ends that are neighbours."""
    # A little behind the surface: on a grid line the free side must not be marked.
    beams, far = heading + angles, reach + 0.02
    ends = np.stack([x + far * np.cos(beams), y + far * np.sin(beams)], -1)
    gap = np.roll(ends, -1, axis=0) - ends
    length = np.hypot(gap[:, 0], gap[:, 1])
    joined = met & np.roll(met, -1) & (length <= WALL_STEP)
    steps = np.where(joined, np.minimum(2 * length, 2 * WALL_STEP).astype(int) + 1, 0)
    k = np.arange(int(2 * WALL_STEP) + 2)
    u = k / np.maximum(steps, 1)[:, None]
    columns, rows = np.floor(ends[:, None] + u[..., None] * gap[:, None]).astype(int).T
    inside = (0 <= rows) & (rows < state.shape[0]) & (0 <= columns) & (columns < state.shape[1])
    marked = inside & met & (k[:, None] <= steps)
    state[rows[marked], columns[marked]], passes[rows[marked], columns[marked]] = OCCUPIED, 0


@compiled("floor.mark_free")
def mark_free(
    state: NDArray[np.uint8],
    passes: NDArray[np.uint8],
    x: float,
    y: float,
    heading: float,
    angles: Array,
    reach: Array,
) -> None:
    """Mark cells whose centre lies nearer than the ends of both beams beside it."""
    rows, columns = np.nonzero(state != FREE)
    dx, dy = columns + 0.5 - x, rows + 0.5 - y
    angle = np.arctan2(dy, dx) - heading
    after = np.searchsorted(angles, angle - 2 * np.pi * np.rint(angle / (2 * np.pi)))
    after, before = after % len(angles), after % len(angles) - 1
    wedge = angles[after] - angles[before]
    wedge = np.where(wedge <= 0, wedge + 2 * np.pi, wedge)
    distance, end = np.hypot(dx, dy), np.minimum(reach[before], reach[after])
    unknown = state[rows, columns] == UNKNOWN
    freed = unknown & (distance <= end) & (wedge <= WIDEST_WEDGE)
    # Nothing as large as the cell hides between two beams less than a cell apart.
    through = ~unknown & (distance <= end - THROUGH) & (distance * wedge <= 1.0)
    passes[rows[through], columns[through]] += 1
    freed |= through & (passes[rows, columns] == MOST_PASSES)
    state[rows[freed], columns[freed]] = FREE


@compiled("floor.wavefront")
def wavefront(
    fits: NDArray[np.bool_], row: int, column: int, lengths: Array, parents: NDArray[np.int32]
) -> None:
    """Lengths (cells) of the shortest eight-connected paths, and the cell before each.

    Among paths of one length the queue's order decides; SciPy's `dijkstra` chooses others.
    """
    # Lists are read far faster cell by cell; a frame of cells that do not fit stands round them.
    width = fits.shape[1] + 2
    free = np.pad(fits, 1).ravel().tolist()
    least, before = [np.inf] * len(free), [-1] * len(free)
    around = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    steps = [(i * width + j, i * width, j, float(np.hypot(i, j))) for i, j in around]
    start = (row + 1) * width + column + 1
    least[start] = 0.0
    queue, waiting = deque([start]), {start}
    while queue:
        cell = queue.popleft()
        waiting.remove(cell)
        for step, down, aside, far in steps:
            to = cell + step
            # A diagonal step must not cut a corner.
            if not (free[to] and free[cell + down] and free[cell + aside]):
                continue
            length = least[cell] + far
            if length < least[to] - 1e-9:
                least[to], before[to] = length, cell
                if to not in waiting:
                    waiting.add(to)
                    queue.append(to)
    lengths[:] = np.reshape(least, (-1, width))[1:-1, 1:-1]
    r, c = np.divmod(np.reshape(before, (-1, width))[1:-1, 1:-1], width)
    parents[:] = np.where(r < 0, -1, (r - 1) * fits.shape[1] + c - 1)


def corners_of(fits: NDArray[np.bool_], cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of the cells of a path (k, 2) at which it must bend; of one cell, that one."""
    kept, at, last = [], 0, len(cells) - 1
    while at < last:
        ahead = last
        while ahead > at + 1 and not _straight(fits, cells[at], cells[ahead]):
            ahead -= 1
        kept.append(ahead)
        at = ahead
    return np.array(kept or [0])


def _straight(fits: NDArray[np.bool_], a: NDArray[np.int64], b: NDArray[np.int64]) -> bool:
    """Tell whether all cells on the straight line between two cells fit."""
    steps = int(4 * np.abs(b - a).max())
    line = a + (np.arange(1, steps) / steps)[:, None] * (b - a)
    # A quarter of a cell to all sides: no cell that the line only grazes is left out.
    sides = 0.25 * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    rows, columns = np.rint(line[:, None] + sides).astype(int).T
    return bool(fits[rows, columns].all())


@compiled("floor.unknown_area")
def unknown_area(
    state: NDArray[np.uint8], points: Array, reach: float, n_rays: int, out: Array
) -> None:
    """Add unknown area (cells) around each point, by sectors up to the first occupied cell."""
    width = 2 * np.pi / n_rays
    reach = min(reach, sum(state.shape))  # no ray on the floor is longer
    angles, r = np.arange(n_rays) * width, 0.5 + np.arange(np.floor(reach + 0.5))
    rays = np.stack([np.cos(angles), np.sin(angles)], -1)[:, None] * r[:, None]
    columns, rows = np.moveaxis(np.floor(points[:, None, None] + rays), -1, 0)
    ringed = np.pad(state, 1, constant_values=OCCUPIED)
    rows = np.clip(rows, -1, state.shape[0]).astype(int) + 1
    columns = np.clip(columns, -1, state.shape[1]).astype(int) + 1
    seen = ringed[rows, columns]
    before_walls = np.logical_and.accumulate(seen != OCCUPIED, axis=-1)
    out += width * ((before_walls & (seen == UNKNOWN)) * r).sum((1, 2))
