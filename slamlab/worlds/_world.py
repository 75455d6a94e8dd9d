"""Free poses to start from, and what every world checks."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_count, as_instance, as_rng, as_scalar
from slamlab.geometry import transform, wrap_angle
from slamlab.models import World

__all__ = ["Solid", "free_poses"]


def free_poses(world: World, n: int, rng: np.random.Generator, clearance: float = 0.0) -> Array:
    """Draw random poses in free space.

    Parameters
    ----------
    world : World
    n : int
        Number of poses.
    rng : numpy.random.Generator
    clearance : float, default 0.0
        Least distance (m) to every obstacle, for example half the diagonal of a robot.

    Returns
    -------
    ndarray, shape (n, 3)
        Positions uniform over the places that qualify, headings uniform in (-pi, pi].

    Raises
    ------
    ValueError
        If there is (next to) no such place.

    Examples
    --------
    >>> from slamlab.worlds import rooms
    >>> free_poses(rooms.thesis_room(), 5, np.random.default_rng(1), clearance=0.2).shape
    (5, 3)
    """
    as_instance("world", world, World, "a world such as BitmapWorld(...)")
    n, rng = as_count("n", n), as_rng("rng", rng)
    clearance = as_scalar("clearance", clearance, 0.0)
    left, bottom, right, top = world.bounds
    found = np.empty((0, 2))
    tried = 0
    while len(found) < n:
        if tried >= 20_000 + 1000 * len(found):
            wanted = f"free places with a clearance of {clearance:g} m"
            raise ValueError(f"world: expected {wanted}, found {len(found)} in {tried} tries")
        points = rng.uniform((left, bottom), (right, top), (max(2 * n, 1000), 2))
        # Where it is not free, the clearance is 0.
        good = world.clearance(points) >= clearance if clearance else world.is_free(points)
        tried += max(2 * n, 1000)
        found = np.concatenate([found, points[good]])
    headings = wrap_angle(rng.uniform(-np.pi, np.pi, n))
    return np.column_stack([found[:n], headings])


class Solid(ABC):
    """What every world with obstacles says of a body in it."""

    def collides(self, footprint: ArrayLike, poses: ArrayLike) -> NDArray[np.bool_]:
        """Tell at which poses a footprint overlaps an obstacle or stands where it is not free.

        Parameters
        ----------
        footprint : array_like, shape (k, 2)
            Vertices of a convex polygon in the body frame (m), in order.
        poses : array_like, shape (..., 3)
            Body in the world (m, m, rad).

        Returns
        -------
        ndarray of bool, shape (...)
            Touching is no collision.
        """
        footprint = checked_footprint(footprint)
        poses = as_array("poses", poses, ("...", 3)).astype(float)
        flat = poses.reshape(-1, 3)
        return self._hits(footprint, flat, flat).reshape(poses.shape[:-1])

    def sweep_collides(
        self, footprint: ArrayLike, start: ArrayLike, end: ArrayLike
    ) -> NDArray[np.bool_]:
        """Tell which motions sweep the footprint over an obstacle or over what is not free.

        Parameters
        ----------
        footprint : array_like, shape (k, 2)
            Vertices of a convex polygon in the body frame (m), in order.
        start, end : array_like, shape (..., 3)
            Poses before and after (m, m, rad): either a straight drive with constant heading, in
            any direction, or a turn on the spot, the shorter way round.

        Returns
        -------
        ndarray of bool, shape (...)
            Exact for the whole swept area; touching is no collision.
        """
        footprint = checked_footprint(footprint)
        start, end = as_array("start", start, ("...", 3)), as_array("end", end, ("...", 3))
        start, end = np.broadcast_arrays(start, end)
        lead = start.shape[:-1]
        start, end = start.reshape(-1, 3).astype(float), end.reshape(-1, 3).astype(float)
        moved = np.hypot(*(end - start)[:, :2].T)
        turned = np.abs(wrap_angle(end[:, 2] - start[:, 2]))
        if ((moved > 1e-9) & (turned > 1e-9)).any():
            worst = np.argmax(np.minimum(moved, turned))
            got = f"a motion of {moved[worst]:.3g} m and {turned[worst]:.3g} rad"
            raise ValueError(f"end: expected a straight drive or a turn on the spot, got {got}")
        end[:, 2] = np.where(turned <= 1e-9, start[:, 2], end[:, 2])
        return self._hits(footprint, start, end).reshape(lead)

    @abstractmethod
    def _hits(self, footprint: Array, start: Array, end: Array) -> NDArray[np.bool_]:
        """Tell which checked motions (n, 3) of a checked footprint meet an obstacle, (n,)."""


def checked_footprint(footprint: ArrayLike) -> Array:
    """Footprint (k, 2) as floats; at least a triangle, convex, vertices in order."""
    footprint = np.array(as_array("footprint", footprint, ("k", 2)), dtype=float, order="C")
    edges = np.roll(footprint, -1, 0) - footprint
    after = np.roll(edges, -1, 0)
    bends = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
    if len(footprint) < 3 or not ((bends >= 0).all() or (bends <= 0).all()) or not bends.any():
        raise ValueError("footprint: expected the vertices of a convex polygon in order")
    return footprint


# A footprint is drawn in by this much (m), so that touching does not count.
_DRAW_IN = 1e-9


def swept_boxes(
    footprint: Array, starts: Array, ends: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Footprint (n, k, 2) before and after each motion, its turn (rad), a box around its sweep.

    The box is given by its lower left and its upper right corner, (n, 2) each.
    """
    centre = footprint.mean(0)
    arms = footprint - centre
    lengths = np.maximum(np.hypot(*arms.T), _DRAW_IN)[:, None]
    drawn_in = centre + np.maximum(1.0 - _DRAW_IN / lengths, 0.0) * arms
    a, b = transform(starts, drawn_in), transform(ends, drawn_in)
    turn = ends[:, 2] - starts[:, 2]
    turn = turn - 2 * np.pi * np.rint(turn / (2 * np.pi))
    low, high = np.minimum(a, b).min(1), np.maximum(a, b).max(1)
    # A vertex that turns stays on a circle about the robot.
    radius = np.hypot(*np.moveaxis(a - starts[:, None, :2], -1, 0)).max(1)[:, None]
    turns = (turn != 0.0)[:, None]
    low = np.where(turns, np.minimum(low, starts[:, :2] - radius), low)
    high = np.where(turns, np.maximum(high, starts[:, :2] + radius), high)
    return a, b, turn, low, high


def sweep_meets(a: Array, b: Array, pivot: Array, turn: float, obstacles: Array) -> bool:
    """Tell whether a footprint that moves from `a` to `b`, (k, 2), meets a convex obstacle.

    A straight drive sweeps the hull of both: separating axes decide. A turn about the pivot first
    meets an obstacle where a vertex of one touches an edge of the other, on an arc. `obstacles`
    (n, m, 2) have m = 2 vertices each, or more in order.
    """
    if turn == 0.0:
        return bool(_overlap(a, b, obstacles).any())
    standing = _overlap(a, a, obstacles) | _overlap(b, b, obstacles)
    # Seen from the footprint an obstacle turns the other way.
    return bool(
        standing.any()
        or _arcs_meet(a, pivot, turn, obstacles).any()
        or _arcs_meet(obstacles.reshape(-1, 2), pivot, -turn, a[None]).any()
    )


def _overlap(a: Array, b: Array, obstacles: Array) -> NDArray[np.bool_]:
    """Tell which obstacles (n, m, 2) the hull of `a` and its shifted copy `b` overlaps, (n,)."""
    n, hull = len(obstacles), np.concatenate([a, b])
    sides = np.roll(obstacles, -1, 1) - obstacles
    own = np.concatenate([np.roll(a, -1, 0) - a, b[:1] - a[:1]])
    axes = np.concatenate([np.broadcast_to(own, (n, *own.shape)), sides], 1)
    axes = axes[..., ::-1] * [-1.0, 1.0]  # normals, (n, k + 1 + m, 2)
    ours, theirs = axes @ hull.T, axes @ obstacles.transpose(0, 2, 1)
    apart = (ours.max(-1) < theirs.min(-1)) | (theirs.max(-1) < ours.min(-1))
    # A side without length separates nothing.
    return ~(apart & axes.any(-1)).any(-1)


def _arcs_meet(points: Array, pivot: Array, turn: float, polygons: Array) -> NDArray[np.bool_]:
    """Tell which points (n, 2), turned about the pivot, cross an edge of polygons (p, m, 2)."""
    arm = points - pivot
    squared, begin = (arm**2).sum(-1), np.arctan2(arm[:, 1], arm[:, 0])
    edges = (np.roll(polygons, -1, 1) - polygons).reshape(-1, 2)
    starts = polygons.reshape(-1, 2) - pivot
    # |start + u edge| = radius, a quadratic in u.
    A, B = (edges**2).sum(-1), (starts * edges).sum(-1)
    root = B**2 - A * ((starts**2).sum(-1) - squared[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (-B + np.array([-1.0, 1.0])[:, None, None] * np.sqrt(root)) / A
    on_edge = (u >= 0.0) & (u <= 1.0)  # NaN without an answer
    x, y = np.moveaxis(starts + np.where(on_edge, u, 0.0)[..., None] * edges, -1, 0)
    angle = np.copysign(1.0, turn) * (np.arctan2(y, x) - begin[:, None])
    return (on_edge & (angle % (2 * np.pi) <= abs(turn))).any((0, 2))
