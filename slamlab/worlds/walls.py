"""A world drawn in straight walls, as the room of P1: the beams meet segments.

It answers the same questions as `BitmapWorld`. Chapters 05, 06, 07 and 09.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_instance, as_scalar
from slamlab.geometry import transform
from slamlab.grids import MOST_CELLS, Grid
from slamlab.models import Bounds
from slamlab.worlds._world import Solid, sweep_meets, swept_boxes
from slamlab.worlds.bitmap import BitmapWorld, checked_beams

__all__ = ["WallWorld"]

Answers = TypeVar("Answers", Array, NDArray[np.bool_])


class WallWorld(Solid):
    """Segments that stop beams and robots.

    If the segments form closed outlines (every end point belongs to an even number of segments),
    they have an inside: a point is free if it lies inside the room and in no box, that is, if a
    beam from it crosses an odd number of walls on its way out. Otherwise the walls are thin, and
    everything beside them is free.

    Parameters
    ----------
    segments : array_like, shape (k, 2, 2)
        End points of each wall in the world (m); at least one wall, each with a length.

    Attributes
    ----------
    segments : ndarray, shape (k, 2, 2)
        Read-only.
    closed : bool
        Whether the segments form closed outlines.

    Examples
    --------
    >>> room = WallWorld.from_polygons([[0, 0], [4, 0], [4, 3], [0, 3]])
    >>> room.cast([1.0, 1.0], [0.0, np.pi / 2]).round(9).tolist()
    [3.0, 2.0]
    """

    def __init__(self, segments: ArrayLike) -> None:
        walls = as_array("segments", segments, ("k", 2, 2)).astype(float)
        lengths = np.hypot(*(walls[:, 1] - walls[:, 0]).T)
        if len(walls) == 0 or not (lengths > 1e-9).all():
            got = f"{len(walls)} walls of {lengths.min(initial=0.0):g} m and more"
            wanted = "at least one wall, each with a length"
            raise ValueError(f"segments: expected {wanted}, got {got}")
        walls.setflags(write=False)
        self.segments: Array = walls
        ends = np.rint(walls.reshape(-1, 2) * 1e6)
        self.closed = bool((np.unique(ends, axis=0, return_counts=True)[1] % 2 == 0).all())

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle by what it is made of: its array stays read-only."""
        return type(self), (self.segments,)

    @classmethod
    def from_polygons(cls, *polygons: ArrayLike) -> WallWorld:
        """Build a world from closed outlines, for example a room and the boxes in it.

        Parameters
        ----------
        *polygons : array_like, shape (k, 2)
            At least one outline, each of three vertices or more in order (m); the last is joined
            to the first. Outlines may not cross each other.
        """
        outlines = [as_array("polygons", polygon, ("k", 2)) for polygon in polygons]
        if not outlines or min(map(len, outlines)) < 3:
            raise ValueError("polygons: expected at least one, with three vertices or more")
        return cls(np.concatenate([sides_of(outline) for outline in outlines]))

    @classmethod
    def from_bitmap(cls, bitmap: BitmapWorld) -> WallWorld:
        """Trace the border between free and occupied cells: the same room, drawn in walls.

        Parameters
        ----------
        bitmap : BitmapWorld
            With a free cell, but none at its edge.
        """
        free = ~as_instance("bitmap", bitmap, BitmapWorld).occupied
        edge = np.concatenate([free[0], free[-1], free[:, 0], free[:, -1]])
        if not free.any() or edge.any():
            got = f"{int(free.sum())} free cells, {int(edge.sum())} at the edge"
            raise ValueError(f"bitmap: expected free cells, none of them at the edge, got {got}")
        across = _runs(free[1:] != free[:-1])
        upright = _runs((free[:, 1:] != free[:, :-1]).T)[..., ::-1]
        return cls(bitmap.origin + bitmap.resolution * np.concatenate([across, upright]))

    def to_bitmap(self, resolution: float, margin: float = 0.0) -> BitmapWorld:
        """Draw the walls in pixels.

        Parameters
        ----------
        resolution : float
            Side of a cell (m).
        margin : float, default 0.0
            Width (m) of the frame around the walls.

        Returns
        -------
        BitmapWorld
            A cell is occupied if its centre is not free or a wall runs through its interior.

        Raises
        ------
        ValueError
            If there would be more than 64 million cells.
        """
        resolution = as_scalar("resolution", resolution, 1e-9, 1e9)
        margin = as_scalar("margin", margin, 0.0, 1e9)
        left, bottom, right, top = self.bounds
        width, height = (right - left + 2 * margin), (top - bottom + 2 * margin)
        rows, columns = (int(np.ceil(n / resolution - 1e-9)) for n in (height, width))
        if rows * columns > MOST_CELLS:
            raise ValueError(f"resolution: expected fewer cells, got {rows} x {columns}")
        grid = Grid((max(rows, 1), max(columns, 1)), resolution, (left - margin, bottom - margin))
        centres = grid.centres()
        half = 0.5 * resolution
        cell = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        clearance = self.clearance(centres)
        occupied = clearance == 0
        poses = np.concatenate([centres, np.zeros((*centres.shape[:-1], 1))], -1)
        near = ~occupied & (clearance <= 1.5 * half)
        occupied[near] = hits_segments(self.segments, cell, poses[near], poses[near])
        return BitmapWorld(occupied, resolution, grid.origin)

    def __repr__(self) -> str:
        """Return the number of walls."""
        return f"WallWorld({len(self.segments)} walls{', closed' if self.closed else ''})"

    @cached_property
    def bounds(self) -> Bounds:
        """Left, bottom, right and top of the box around all walls (m)."""
        left, bottom = self.segments.min((0, 1))
        right, top = self.segments.max((0, 1))
        return float(left), float(bottom), float(right), float(top)

    def is_free(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Tell which points lie inside the room and in no box; none on a wall does.

        Parameters
        ----------
        points : array_like, shape (..., 2)
            In the world (m).

        Returns
        -------
        ndarray of bool, shape (...)
        """
        return self.clearance(points) > 0

    def clearance(self, points: ArrayLike) -> Array:
        """Distance from points to the nearest wall, exact.

        Parameters
        ----------
        points : array_like, shape (..., 2)
            In the world (m).

        Returns
        -------
        ndarray, shape (...)
            In metres; 0 where it is not free.
        """
        points = as_array("points", points, ("...", 2))
        flat = np.array(points.reshape(-1, 2), dtype=float)
        out = _in_parts(segment_clearance, self.segments, flat)
        out[out < 1e-12] = 0.0
        if self.closed:
            out[~_in_parts(inside_segments, self.segments, flat)] = 0.0
        return out.reshape(points.shape[:-1])

    def cast(self, origins: ArrayLike, angles: ArrayLike, max_range: float = np.inf) -> Array:
        """Distances at which beams meet a wall.

        Parameters
        ----------
        origins : array_like, shape (..., 2)
            Where beams start (m). From a point that is not free the distance is 0.
        angles : array_like, shape (...)
            Directions in the world (rad); leading axes broadcast with `origins`.
        max_range : float or array_like, shape (...), default inf
            Farther than this (m, not negative) nothing is met.

        Returns
        -------
        ndarray, shape (...)
            In metres; inf where a beam met nothing.
        """
        x, y, angles, reach = checked_beams(origins, angles, max_range)
        beams = x.ravel(), y.ravel(), angles.ravel()
        out = _in_parts(cast_segments, self.segments, *beams)
        out[out > reach.ravel()] = np.inf
        free = self.is_free(origins) if self.closed else np.True_
        if not free.all():
            out[np.broadcast_to(~free, angles.shape).ravel()] = 0.0
        return out.reshape(angles.shape)

    def _hits(self, footprint: Array, start: Array, end: Array) -> NDArray[np.bool_]:
        # A footprint that meets no wall lies on one side of all of them: its centre tells which.
        centre = transform(start, footprint.mean(0)[None])[:, 0]
        return hits_segments(self.segments, footprint, start, end) | ~self.is_free(centre)


def sides_of(outline: Array) -> Array:
    """Segments (k, 2, 2) from each vertex of an outline (k, 2) to the next one."""
    return np.stack([outline, np.roll(outline, -1, axis=0)], 1)


def _in_parts(answer: Callable[..., Answers], segments: Array, *columns: Array) -> Answers:
    """Every row of `columns` with every segment, so many rows at once as fit into the cache."""
    n = 1 + len(columns[0]) * len(segments) // 2**15
    parts = zip(*(np.array_split(column, n) for column in columns), strict=True)
    return cast(Answers, np.concatenate([answer(segments, *part) for part in parts]))


def cast_segments(segments: Array, x: Array, y: Array, angles: Array) -> Array:
    """Distances at which beams (n,) meet segments (k, 2, 2), infinite where they meet none.

    Solves origin + t d = a + u e for 0 <= t, 0 <= u <= 1, every beam with every wall.
    """
    dx, dy = np.cos(angles)[:, None], np.sin(angles)[:, None]
    ax, ay = segments[:, 0, 0] - x[:, None], segments[:, 0, 1] - y[:, None]
    ex, ey = (segments[:, 1] - segments[:, 0]).T
    length, cross = np.hypot(ex, ey), dx * ey - dy * ex
    with np.errstate(divide="ignore", invalid="ignore"):
        t, u = (ax * ey - ay * ex) / cross, (ax * dy - ay * dx) / cross
    # Walls that share a corner leave no gap between them.
    met = (t >= -1e-12) & (u >= -1e-9 / length) & (u <= 1.0 + 1e-9 / length)
    t = np.where(met, np.maximum(t, 0.0), np.inf)
    # Along the wall: met end on if the beam's line is the wall's.
    i, k = np.nonzero(np.abs(cross) < 1e-12 * length)
    dx, dy, ax, ay = dx[i, 0], dy[i, 0], ax[i, k], ay[i, k]
    t0, t1 = dx * ax + dy * ay, dx * (ax + ex[k]) + dy * (ay + ey[k])
    end_on = (np.abs(dx * ay - dy * ax) <= 1e-9) & (np.maximum(t0, t1) >= 0.0)
    t[i, k] = np.where(end_on, np.minimum(t0, t1).clip(0.0), np.inf)
    return t.min(1)


def segment_clearance(segments: Array, points: Array) -> Array:
    """Distance of points (n, 2) to the nearest of segments (k, 2, 2)."""
    x, y = points[:, :1], points[:, 1:]
    (px, py), (ex, ey) = segments[:, 0].T, (segments[:, 1] - segments[:, 0]).T
    u = (((x - px) * ex + (y - py) * ey) / (ex**2 + ey**2)).clip(0.0, 1.0)
    return np.sqrt(((px + u * ex - x) ** 2 + (py + u * ey - y) ** 2).min(1))


def inside_segments(segments: Array, points: Array) -> NDArray[np.bool_]:
    """Tell which points (n, 2) see an odd number of walls to their right."""
    x, y = points[:, :1], points[:, 1:]
    (x0, y0), (x1, y1) = segments[:, 0].T, segments[:, 1].T
    # Half-open, so that a corner counts once.
    between = (y0 > y) != (y1 > y)
    at = x0 + (y - y0) / np.where(y0 == y1, 1.0, y1 - y0) * (x1 - x0)
    return np.asarray((between & (at > x)).sum(1) % 2 == 1)


def hits_segments(
    segments: Array, footprint: Array, starts: Array, ends: Array
) -> NDArray[np.bool_]:
    """Tell for each motion (n, 3) whether the footprint sweeps over a segment (k, 2, 2)."""
    out = np.zeros(len(starts), np.bool_)
    a, b, turn, low, high = swept_boxes(footprint, starts, ends)
    left_bottom, right_top = segments.min(1), segments.max(1)
    for i in range(len(out)):
        near = segments[((right_top >= low[i]) & (left_bottom <= high[i])).all(1)]
        out[i] = len(near) > 0 and sweep_meets(a[i], b[i], starts[i, :2], turn[i], near)
    return out


def _runs(border: NDArray[np.bool_]) -> Array:
    """Segments (k, 2, 2: x, y in cells) along the lines between rows, from border flags."""
    padded = np.pad(border, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(padded, axis=1)
    row, begin = np.nonzero(change == 1)
    end = np.nonzero(change == -1)[1]
    starts, ends = np.stack([begin, row + 1], -1), np.stack([end, row + 1], -1)
    return np.stack([starts, ends], 1).astype(float)
