"""What an exploring robot knows of the floor: seen free, seen occupied, or unknown.

A coarse grid, fed with whole scans, that answers where the unknown begins (the frontier of
Yamauchi 1997), where the body fits, and how to get there. Chapters 18 and 20.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from slamlab._checks import Array, as_array, as_count, as_distances, as_scalar
from slamlab._compiling import njit
from slamlab.grids import Grid
from slamlab.models import ScanSensor, as_scan_sensor

__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "SeenFloor", "Ways"]

UNKNOWN, FREE, OCCUPIED = 0, 1, 2

# Between beams that are farther apart than this (rad) nothing is known.
_WIDEST_WEDGE = np.deg2rad(12.5)
# End points of neighbouring beams nearer than this many cells belong to one wall.
_WALL_STEP = 3.0
# So many scans must look through an occupied cell, by so many cells, to free it again.
_DOUBTS, _THROUGH = 3, 1.5


class SeenFloor(Grid):
    """A grid of cells that are unknown, free or occupied.

    A cell is free when its centre lies between two neighbouring beams and nearer than both their
    ends; it is occupied when a beam ended in it. Three scans that look through an occupied cell,
    and none between that meets it, free it again: walls that a pose a little wrong has smeared
    over a doorway do not close it for ever.

    Parameters
    ----------
    bounds : array_like, shape (4,)
        Left, bottom, right, top of the sheet (m).
    resolution : float, default 0.05
        Side of a cell (m).
    grow : bool, default False
        Enlarge the sheet where a beam ends near its edge or beyond. If False, beams are cut there.

    Attributes
    ----------
    state : ndarray of uint8, shape (rows, columns)
        `UNKNOWN`, `FREE` or `OCCUPIED`; row 0 at the bottom.
    shut : ndarray of bool, shape (rows, columns)
        Frontier cells that a scan from close by did not clear up: they are left alone.

    Raises
    ------
    ValueError
        If the sheet is empty or a number is out of range.

    Examples
    --------
    >>> from slamlab.logs import ScanGeometry
    >>> floor = SeenFloor([0, 0, 4, 1], 1.0)
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
        self.shut = np.zeros(self.shape, dtype=np.bool_)
        self._doubt = np.zeros(self.shape, dtype=np.uint8)
        self._free, self._room = np.zeros((0, 0), dtype=np.bool_), np.zeros((0, 0))

    def cell(self, point: ArrayLike) -> tuple[int, int]:
        """Row and column of the cell of a point (2,), or of the nearest cell of the sheet."""
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
            Measured ranges (m): inf, or ``lidar.max_range`` and more, met nothing up to there;
            NaN says nothing. Between beams more than 12.5 degrees apart nothing is known.
        lidar : ScanSensor

        Raises
        ------
        ValueError
            If a shape does not fit, the pose is not finite or a range is negative.
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
        eye = pose[:2] + lidar.offset * np.array([np.cos(pose[2]), np.sin(pose[2])])
        if self._grows:
            beams = pose[2] + angles
            self._make_room(eye + reach[:, None] * np.stack([np.cos(beams), np.sin(beams)], -1))
        x, y = self.scaled(eye)
        # Endless beams are cut where they have left the sheet for certain.
        longest = sum(self.shape) + np.hypot(x, y)
        reach = np.minimum(reach / self.resolution, longest)
        _mark_walls(self.state, self._doubt, x, y, pose[2], angles, reach, met)
        _mark_free(self.state, self._doubt, x, y, pose[2], angles, reach)

    def _make_room(self, ends: Array) -> None:
        """Enlarge the sheet beyond the ends (n, 2) of beams; endless ones do not count."""
        ends = ends[np.isfinite(ends).all(-1)]
        # Beyond the last floor that was seen there is a cell, and it is unknown.
        added = self.grow(ends, margin=2) if len(ends) else None
        if added is not None:
            for name in ("state", "shut", "_doubt"):
                setattr(self, name, np.pad(getattr(self, name), added))

    def frontier(self) -> NDArray[np.bool_]:
        """Free cells beside an unknown one, shape (rows, columns), without the `shut` ones."""
        unknown = self.state == UNKNOWN
        beside = np.zeros_like(unknown)
        beside[1:] |= unknown[:-1]
        beside[:-1] |= unknown[1:]
        beside[:, 1:] |= unknown[:, :-1]
        beside[:, :-1] |= unknown[:, 1:]
        return beside & (self.state == FREE) & ~self.shut

    def shut_near(self, point: ArrayLike, radius: float) -> None:
        """Give up the frontier cells within `radius` (m) of a point (2,): the scan is taken."""
        point, radius = as_array("point", point, (2,)), as_scalar("radius", radius, 0.0, 1e9)
        row, column = self.cell(point)
        reach = int(np.ceil(radius / self.resolution))
        rows = slice(max(row - reach, 0), row + reach + 1)
        columns = slice(max(column - reach, 0), column + reach + 1)
        gap = self.centres_of(rows, columns) - point
        near = np.hypot(gap[..., 0], gap[..., 1]) <= radius
        self.shut[rows, columns] |= near & self.frontier()[rows, columns]

    def fits(self, radius: float) -> NDArray[np.bool_]:
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

    def ways(self, start: ArrayLike, radius: float) -> Ways:
        """Shortest ways of a disc from a point to all cells.

        Parameters
        ----------
        start : array_like, shape (2,)
            Where the way begins (m). If the disc does not fit there, the nearest cell within
            its radius where it fits takes its place.
        radius : float
            Radius of the disc (m).
        """
        fits = self.fits(as_scalar("radius", radius, 0.0))
        begin = self._nearest(fits, as_array("start", start, (2,)), radius)
        lengths = np.full(fits.shape, np.inf)
        parents = np.full(fits.shape, -1, dtype=np.int32)
        if begin is not None:
            _wavefront(fits, *begin, lengths, parents)
        return Ways(self, lengths * self.resolution, parents, fits)

    def route(self, start: ArrayLike, goal: ArrayLike, radius: float) -> Array | None:
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
        ways = self.ways(start, radius)
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

    def unseen_area(self, points: ArrayLike, reach: float, n_rays: int = 36) -> Array:
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
        _unseen(self.state, scaled, reach / self.resolution, n_rays, out)
        return out * self.resolution**2


@dataclass(frozen=True, eq=False)
class Ways:
    """Shortest ways of a disc from one place to all cells of a floor.

    Attributes
    ----------
    floor : SeenFloor
    lengths : ndarray, shape (rows, columns)
        In metres, by steps to the eight neighbours; inf where there is no way.
    parents : ndarray of int, shape (rows, columns)
        Flat index of the cell before, -1 at the start and where there is no way.
    fits : ndarray of bool, shape (rows, columns)
        Where the disc may stand.
    """

    floor: SeenFloor
    lengths: Array
    parents: NDArray[np.int32]
    fits: NDArray[np.bool_]

    def to(self, goal: tuple[int, int]) -> Array:
        """Corners (k, 2) of the way to a cell (m), shortened where a straight line fits."""
        columns = self.fits.shape[1]
        cells = [goal]
        while (before := self.parents[cells[-1]]) >= 0:
            cells.append((int(before) // columns, int(before) % columns))
        way = np.array(cells[::-1], dtype=np.int64)
        corners = way[_corners(self.fits, way)]
        return self.floor.origin + self.floor.resolution * (corners[:, ::-1] + 0.5)


def box_of(mask: NDArray[np.bool_], margin: int = 0) -> tuple[slice, slice]:
    """Rows and columns that hold all true cells, and so many more on every side; none for none."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if len(rows) == 0:
        return slice(0), slice(0)
    ends = (rows[0], rows[-1]), (columns[0], columns[-1])
    row, column = (slice(low - margin, high + 1 + margin) for low, high in ends)
    return row, column


# Compiled loops; coordinates in cells.


@njit(cache=True)
def _mark_walls(state, doubt, x, y, heading, angles, reach, met):  # type: ignore[no-untyped-def]
    """Mark the cells in which beams ended, and those between two ends that are neighbours."""
    n, rows, columns = len(angles), state.shape[0], state.shape[1]
    for i in range(n):
        if not met[i]:
            continue
        # A little behind the surface: on a grid line the free side must not be blamed.
        a, r = heading + angles[i], reach[i] + 0.02
        x0, y0 = x + r * np.cos(a), y + r * np.sin(a)
        steps, x1, y1 = 0, x0, y0
        j = (i + 1) % n
        if met[j]:
            a, r = heading + angles[j], reach[j] + 0.02
            x1, y1 = x + r * np.cos(a), y + r * np.sin(a)
            length = np.hypot(x1 - x0, y1 - y0)
            if length <= _WALL_STEP:
                steps = int(2 * length) + 1
        for k in range(steps + 1):
            u = k / steps if steps else 0.0
            column = int(np.floor(x0 + u * (x1 - x0)))
            row = int(np.floor(y0 + u * (y1 - y0)))
            if 0 <= row < rows and 0 <= column < columns:
                state[row, column], doubt[row, column] = OCCUPIED, 0


@njit(cache=True)
def _mark_free(state, doubt, x, y, heading, angles, reach):  # type: ignore[no-untyped-def]
    """Mark cells whose centre lies nearer than the ends of both beams beside it."""
    n = len(angles)
    left, right = _spans(state.shape, x, y, heading, angles, reach)
    for row in range(len(left)):
        for column in range(left[row], right[row]):
            if state[row, column] == FREE:
                continue
            dx, dy = column + 0.5 - x, row + 0.5 - y
            angle = np.arctan2(dy, dx) - heading
            angle -= 2 * np.pi * np.rint(angle / (2 * np.pi))
            after = np.searchsorted(angles, angle) % n
            before = after - 1 if after > 0 else n - 1
            wedge = angles[after] - angles[before]
            if wedge <= 0:
                wedge += 2 * np.pi
            distance, end = np.hypot(dx, dy), min(reach[before], reach[after])
            if state[row, column] == UNKNOWN:
                if distance <= end and wedge <= _WIDEST_WEDGE:
                    state[row, column] = FREE
            # Nothing as large as the cell hides between two beams less than a cell apart.
            elif distance <= end - _THROUGH and distance * wedge <= 1.0:
                doubt[row, column] += 1
                if doubt[row, column] == _DOUBTS:
                    state[row, column] = FREE


@njit(cache=True)
def _spans(shape, x, y, heading, angles, reach):  # type: ignore[no-untyped-def]
    """Row by row the first column in reach of a wedge between two beams, and that after the last.

    A wedge lies in the box round its three corners, and all boxes hold the eye. So a box is noted
    in its lowest and its highest row, and those between have what the rows outside them have.
    """
    rows, columns = shape
    left, right = np.full(rows, columns), np.zeros(rows, np.int64)
    # A wedge too wide for unknown cells may still raise doubts about occupied ones right here.
    near = 1.0 + 1.0 / _WIDEST_WEDGE
    _hold(left, right, columns, (x - near, x + near, y - near, y + near))
    for after in range(len(angles)):
        before = after - 1 if after > 0 else len(angles) - 1
        wedge = angles[after] - angles[before]
        if (wedge if wedge > 0 else wedge + 2 * np.pi) > _WIDEST_WEDGE:
            continue
        end, a, b = min(reach[before], reach[after]), angles[before], angles[after]
        px, py = x + end * np.cos(heading + a), y + end * np.sin(heading + a)
        qx, qy = x + end * np.cos(heading + b), y + end * np.sin(heading + b)
        # An arc bulges by less than 0.6 % of its radius beyond its ends.
        pad = 1.0 + 0.006 * end
        beside = min(x, px, qx) - pad, max(x, px, qx) + pad
        _hold(left, right, columns, (*beside, min(y, py, qy) - pad, max(y, py, qy) + pad))
    eye = min(max(int(np.floor(y)), 0), rows - 1)
    for row in range(rows - 1, eye, -1):
        _widen(left, right, row - 1, left[row], right[row])
    for row in range(eye):
        _widen(left, right, row + 1, left[row], right[row])
    return left, right


@njit(cache=True)
def _hold(left, right, columns, box):  # type: ignore[no-untyped-def]
    """Note a box (x low, x high, y low, y high) in its lowest and its highest row."""
    first = max(int(np.floor(box[0])), 0)
    last = min(int(np.floor(box[1])) + 1, columns)
    for y in box[2:]:
        _widen(left, right, min(max(int(np.floor(y)), 0), len(left) - 1), first, last)


@njit(cache=True)
def _widen(left, right, row, first, last):  # type: ignore[no-untyped-def]
    left[row], right[row] = min(left[row], first), max(right[row], last)


@njit(cache=True)
def _wavefront(fits, row, column, lengths, parents):  # type: ignore[no-untyped-def]
    """Lengths (cells) of the shortest eight-connected ways, and the cell before each.

    SciPy's `dijkstra` gives the same lengths (a test holds that) and takes 5 to 18 times as long,
    most of it to build its graph anew for every floor.
    """
    rows, columns = fits.shape
    size = rows * columns
    queue, waiting = np.empty(size, dtype=np.int32), np.zeros(size, dtype=np.bool_)
    queue[0], head, count = row * columns + column, 0, 1
    lengths[row, column] = 0.0
    while count:
        cell = queue[head]
        head, count = (head + 1) % size, count - 1
        waiting[cell] = False
        r, c = cell // columns, cell % columns
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                i, j = r + dr, c + dc
                if not (0 <= i < rows and 0 <= j < columns) or not fits[i, j]:
                    continue
                # A diagonal step must not cut a corner.
                if dr != 0 and dc != 0 and not (fits[r, j] and fits[i, c]):
                    continue
                length = lengths[r, c] + np.sqrt(float(dr * dr + dc * dc))
                if length < lengths[i, j] - 1e-9:
                    lengths[i, j], parents[i, j] = length, cell
                    if not waiting[i * columns + j]:
                        waiting[i * columns + j] = True
                        queue[(head + count) % size] = i * columns + j
                        count += 1


@njit(cache=True)
def _corners(fits, cells):  # type: ignore[no-untyped-def]
    """Numbers of the cells of a way (k, 2) at which it must bend; of one cell, that one."""
    kept = np.zeros(len(cells), np.int64)
    count = at = 0
    while at < len(cells) - 1:
        ahead = len(cells) - 1
        while ahead > at + 1 and not _straight(fits, cells[at], cells[ahead]):
            ahead -= 1
        kept[count] = at = ahead
        count += 1
    return kept[: max(count, 1)]


@njit(cache=True)
def _straight(fits, a, b):  # type: ignore[no-untyped-def]
    """Tell whether all cells on the straight line between two cells fit."""
    steps = int(4 * max(abs(b[0] - a[0]), abs(b[1] - a[1])))
    for k in range(1, steps):
        u = k / steps
        row, column = a[0] + u * (b[0] - a[0]), a[1] + u * (b[1] - a[1])
        # A quarter of a cell to all sides: no cell that the line only grazes is left out.
        for i in (row - 0.25, row + 0.25):
            for j in (column - 0.25, column + 0.25):
                if not fits[int(np.rint(i)), int(np.rint(j))]:
                    return False
    return True


@njit(cache=True)
def _unseen(state, points, reach, n_rays, out):  # type: ignore[no-untyped-def]
    """Unknown area (cells) around each point, sector by sector up to the first occupied cell."""
    rows, columns = state.shape
    width = 2 * np.pi / n_rays
    for i in range(len(points)):
        for k in range(n_rays):
            dx, dy = np.cos(k * width), np.sin(k * width)
            r = 0.5
            while r <= reach:
                row = int(np.floor(points[i, 1] + r * dy))
                column = int(np.floor(points[i, 0] + r * dx))
                inside = 0 <= row < rows and 0 <= column < columns
                if not inside or state[row, column] == OCCUPIED:
                    break
                if state[row, column] == UNKNOWN:
                    out[i] += r * width
                r += 1.0
