"""Grid FastSLAM: particles that carry occupancy maps; and DP-SLAM, one map for all of them.

Grisetti, Stachniss and Burgard, IEEE T-RO 23(1) 2007: each particle lays the scan upon its own map
before it is weighed. Eliazar and Parr, IJCAI 2003, ICRA 2004: many blind particles, a laser
that may pass through any cell. P5 section 2.4; (A)-(C) are formulas of chapter 15c.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_choice, as_scalar, as_shaped
from slamlab.geometry import transform, wrap_angle
from slamlab.kernels import compiled
from slamlab.models import MotionModel, ScanSensor, as_scan_sensor
from slamlab.robots import RelativePose
from slamlab.slam._grid_maps import (
    TILE,
    AncestryTree,
    Cells,
    MapParticles,
    Pages,
    Table,
    TileMaps,
    cells_at,
    place,
)

__all__ = ["GridFastSlam"]

# Fewer points of a scan say too little; of more than the second number each n-th counts.
_LEAST_POINTS, _MOST_POINTS = 10, 180
# Matching: more hits a metre than this make a wall; share of points that belong to the map.
_RATE, _HIT = 1.0, 0.9
# Penetration: free way of a laser in unseen cells (m), sides of a cell that are added to the
# metres of a seen one, floor of a beam's likelihood.
_FREE_WAY, _PRIOR, _FLOOR = 8.0, 4.0, 1e-3
# Steps of a climb with a quarter of the points and a wider neighbourhood, and with all.
_COARSE, _FINE = 5, 6
# Turns (rad) from which a climb is tried: none, and if that is lost, to the right and to the left.
# A turn has Student's t distribution of 3 degrees of freedom and this scale (rad).
_TURNS = np.deg2rad(5.0) * np.array([0, -1, 1, -2, 2, -3, 3, -4, 4])
_SCALE = np.deg2rad(2.0)
_HITS, _METRES, _SUMS = 0, 1, slice(2, 4)

# Pages, tiles of a particle, tiles a row, (resolution, x, y) of the corner.
Where: TypeAlias = tuple[Pages, Table, int, Array]


class GridFastSlam(MapParticles):
    """Rao-Blackwellized particle filter for SLAM with a lidar: each particle draws its own map.

    Nothing closes loops: where the robot comes back, the particle whose map fits best survives,
    if it is still among the particles.

    Parameters
    ----------
    lidar : ScanSensor
        How the beams lie.
    pose : array_like, shape (3,), default (0, 0, 0)
        Where the robot stands first (m, m, rad).
    n_particles : int, default 30
    rng : numpy.random.Generator
    motion : MotionModel, default RelativePose()
    resolution : float, default 0.1
        Side of a cell (m).
    model : {"matching", "penetration"}, default "matching"
        "matching" moves each particle to where its map explains the scan best, and weighs it there
        by the distances of the end points to the nearest walls. "penetration" leaves particles
        where the odometry put them, and weighs every beam along its whole way: DP-SLAM, which
        needs many times the particles.
    sigma : float, default 0.1
        How far (m) an end point strays from its wall, or where a beam ends.
    temper : float, default 0.3
        Power of the likelihood: beams of a scan are far from independent.
    threshold : float, default 0.5
        Resample when the effective sample size falls below this share of the particles.
    lost : float, default 0
        A match that explains less than this share of the end points is tried again from headings
        up to 20 degrees to either side, for wheels may err by far more than they say; 0: never.
    storage : {"tiles", "tree", "copies"}, default "tiles"
        Tiles of 16 x 16 cells that particles share until one of them writes; DP-SLAM's tree of
        ancestors, each with the cells it changed (slow here: to learn from); or a whole map for
        every particle. All three hold the same maps.

    Attributes
    ----------
    map_bytes : int
        Memory of all maps together.

    Examples
    --------
    >>> from slamlab.sensors import Lidar
    >>> from slamlab.worlds import rooms
    >>> lidar = Lidar(180, max_range=20.0)
    >>> slam = GridFastSlam(lidar, [2.0, 4.0, 0.0], 10, rng=np.random.default_rng(1))
    >>> for x in (2.0, 2.3, 2.6):
    ...     if x > 2:
    ...         slam.predict([0.3, 0.0, 0.0], 1.0, np.diag([0.02, 0.01, 0.01]) ** 2)
    ...     evidence = slam.update(lidar.scan(rooms.office(), [x, 4.0, 0.0]))
    >>> bool(np.abs(slam.pose - [2.6, 4.0, 0.0]).max() < 0.03)
    True
    """

    def __init__(
        self,
        lidar: ScanSensor,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        n_particles: int = 30,
        *,
        rng: np.random.Generator,
        motion: MotionModel = RelativePose(),  # noqa: B008
        resolution: float = 0.1,
        model: str = "matching",
        sigma: float = 0.1,
        temper: float = 0.3,
        threshold: float = 0.5,
        lost: float = 0.0,
        storage: str = "tiles",
    ) -> None:
        super().__init__(motion, pose, n_particles, rng, temper, threshold)
        self.lidar = as_scan_sensor("lidar", lidar)
        resolution = as_scalar("resolution", resolution, 1e-3, 1e3)
        self.model = as_choice("model", model, ("matching", "penetration"))
        self._sigma = as_scalar("sigma", sigma, 1e-6, 1e6)
        self._lost = as_scalar("lost", lost, 0.0, 1.0)
        storage = as_choice("storage", storage, ("tiles", "tree", "copies"))
        floor = self.n_particles, resolution, self.poses[0, :2]
        if storage == "tree":
            self._maps = AncestryTree(*floor)
        else:
            self._maps = TileMaps(*floor, share=storage == "tiles")

    def update(self, ranges: ArrayLike, ids: None = None) -> float:
        """Match, weigh, draw, resample.

        Parameters
        ----------
        ranges : array_like, shape (n_beams,)
            (m), not negative; NaN is a lost beam, inf or ``lidar.max_range`` one that met nothing.
            Only beams that met something count, 180 of them at most, evenly chosen.
        ids : None
            Scans have no names.

        Returns
        -------
        float
            Logarithm of the weighted mean of the tempered likelihood; 0 for the first scan, and
            for one of fewer than ten points, which changes nothing.
        """
        points = self.lidar.points(as_shaped("ranges", ranges, (self.lidar.n_beams,)))
        points = points[np.isfinite(points[:, 0])]
        points = np.ascontiguousarray(points[:: max(1, -(-len(points) // _MOST_POINTS))])
        if len(points) < _LEAST_POINTS:
            return 0.0
        poses, log_likelihood = self._cloud.particles.copy(), np.zeros(self.n_particles)
        # (A): the particles carry the path; given its path, each knows its map.
        # 1. Propose and 2. weigh, by the map that each particle drew so far.
        if self._maps.size.any():
            self._weigh(points, poses, log_likelihood)
        # 3. Draw the scan into every map, before resampling: then copies share it.
        self._draw(points, poses)
        self._cloud.particles = poses
        # 4. Resample particles with their maps if the weights say so.
        return self._weighed_by(log_likelihood)

    def _beams(self, points: Array, poses: Array) -> tuple[Array, Array]:
        """Where beams start (M, 2) and end (M, k, 2), in the world."""
        return transform(poses, [[self.lidar.offset, 0.0]])[:, 0], transform(poses, points)

    def _weigh(self, points: Array, poses: Array, score: Array) -> None:
        """Log likelihood of the scan into `score` (M,); matching moves `poses` first."""
        where = (*self._maps.read(), self._maps.columns, self._maps.frame)
        if self.model == "matching":
            refine(*where, points, poses, self._sigma, self._lost, score)
            poses[:, 2] = wrap_angle(poses[:, 2])
        else:
            penetrate(*where, *self._beams(points, poses), self._sigma, score)

    def _draw(self, points: Array, poses: Array) -> None:
        """Add the beams to every map."""
        starts, ends = self._beams(points, poses)
        maps = self._maps
        maps.make_room(np.concatenate([starts, ends.reshape(-1, 2)]))
        tiles = np.zeros((len(poses), int(maps.size.prod())), bool)
        touched(maps.columns, maps.frame, starts, ends, tiles)
        draw(*maps.write(tiles), maps.columns, maps.frame, tiles, starts, ends)
        maps.written()

    def map(self, particle: int | None = None) -> tuple[NDArray[np.float32], Array]:
        """Map of a particle, the heaviest by default.

        Parameters
        ----------
        particle : int, optional
            Row of `poses`.

        Returns
        -------
        cells : ndarray, shape (rows, columns, 4)
            Hits, metres that beams travelled in the cell, and sums of the end points (x, y) in it;
            row 0 is at the bottom.
        origin : ndarray, shape (2,)
            Lower left corner (m).
        """
        return self._maps.dense(self._row(particle)), self._maps.frame[1:]


# Walls of a map. It is a table of tiles: `tiles` (slots,) names the page (TILE, TILE, 4) of each,
# `frame` is (resolution, x, y) of the corner, `columns` the tiles of a row.


def nearest_walls(where: Where, world: Array, reach: int) -> tuple[Array, Array]:
    """Squared distance (k,) of points (k, 2) to the nearest wall within `reach` cells; its place.

    A cell is wall if more than `_RATE` hits came to a metre travelled in it; its place is the mean
    of its hits. The distance is inf if none is there.
    """
    pages, tiles, columns, frame = where
    around = np.arange(-reach, reach + 1)
    neighbours = np.stack(np.meshgrid(around, around), -1).reshape(-1, 2)
    cells = np.floor((world - frame[1:]) / frame[0]).astype(np.intp)[:, None] + neighbours
    kept = cells_at(pages, tiles, columns, cells)
    hits = kept[..., _HITS]
    walls = kept[..., _SUMS] / np.maximum(hits, 1)[..., None]
    wall = hits > _RATE * kept[..., _METRES]
    squared = np.where(wall, ((walls - world[:, None]) ** 2).sum(-1), np.inf)
    each, best = np.arange(len(world)), squared.argmin(1)
    return squared[each, best], walls[each, best]


# Matching.


def normal_equations(
    where: Where, points: Array, pose: Array, reach: int, sigma: float
) -> tuple[Array, Array, float]:
    """H (3, 3) and g (3,) of sum 1 - exp(-d^2 / 2 sigma^2) at `pose`, and sum exp(...).

    d is the distance of a point (k, 2, in the body), seen from `pose`, to the nearest wall.
    """
    world = transform(pose, points)
    squared, wall = nearest_walls(where, world, reach)
    w = np.exp(-0.5 * squared / sigma**2)
    J = np.zeros((len(points), 2, 3))
    J[:, 0, 0] = J[:, 1, 1] = 1.0
    J[:, 0, 2], J[:, 1, 2] = -(world - pose[:2])[:, 1], (world - pose[:2])[:, 0]
    weighted = w[:, None, None] * J
    H = np.tensordot(weighted, J, ([0, 1], [0, 1])) + 1e-6 * np.eye(3)
    return H, np.tensordot(weighted, wall - world, ([0, 1], [0, 1])), float(w.sum())


def gauss_newton(where: Where, points: Array, start: Array, sigma: float) -> tuple[Array, float]:
    """Gauss-Newton from `start`: the best pose (3,) met, and the share of points it explains."""
    most, here, top = -1.0, start, start
    for n in range(_COARSE + _FINE):
        some, reach = (points[::4], 2) if n < _COARSE else (points, 1)
        H, g, explained = normal_equations(where, some, here, reach, sigma)
        if explained > most or n == _COARSE:
            most, top = explained, here
        step = np.linalg.solve(H, g)
        here = here + step
        if n >= _COARSE and np.abs(step[:2]).sum() < 2e-3 and abs(step[2]) < 2e-4:
            break
    return top, most / len(points)


@compiled("grid_fast.refine")
def refine(
    pages: Pages, table: Table, columns: int, frame: Array, points: Array, poses: Array,
    sigma: float, lost: float, score: Array,
) -> None:  # fmt: skip
    """Move each pose (M, 3) to where its own map explains the points (k, 2, in the body) best.

    A climb that explains less than the share `lost` of them is lost: others begin from other
    headings, and the likeliest counts. The log likelihood of the points goes to `score` (M,).
    """
    for i in range(len(poses)):
        where, most = (pages, table[i], columns, frame), -np.inf
        before = poses[i].copy()
        for turn in _TURNS:
            top, share = gauss_newton(where, points, before + [0.0, 0.0, turn], sigma)
            squared, _ = nearest_walls(where, transform(top, points), 1)
            fits = np.log(_HIT * np.exp(-0.5 * squared / sigma**2) + 1 - _HIT).sum()
            # Wheels are off by a few degrees as a rule, and now and then by far more.
            worth = fits - 2.0 * np.log1p((top[2] - before[2]) ** 2 / (3 * _SCALE**2))
            if worth > most:
                most, score[i], poses[i] = worth, fits, top
            if turn == 0 and share >= lost:
                break


# Beams.


def crossed(start: Array, ends: Array, side: float, corner: Array) -> tuple[Cells, Array]:
    """Cells (k, n, 2: column, row) of beams, and how far off (k, n + 1) (m) each begins and ends.

    Beams go from `start` (2,) to `ends` (k, 2). All have as many cells: some of length 0.
    """
    way = ends - start
    cuts = [np.zeros((len(ends), 1)), np.ones((len(ends), 1))]
    for a in range(2):  # where they cross grid lines, as parts of their length
        low, high = min(start[a], ends[:, a].min()), max(start[a], ends[:, a].max())
        first, last = np.floor((low - corner[a]) / side), np.ceil((high - corner[a]) / side)
        lines = np.arange(first, last + 1)
        along = np.where(way[:, a] == 0.0, np.inf, way[:, a])[:, None]
        cuts.append(np.clip((corner[a] + side * lines - start[a]) / along, 0.0, 1.0))
    t = np.sort(np.concatenate(cuts, 1), 1)
    middle = start + 0.5 * (t[:, :-1] + t[:, 1:])[..., None] * way[:, None]
    cells = np.floor((middle - corner) / side).astype(np.intp)
    return cells, t * np.hypot(*way.T)[:, None]


@compiled("grid_fast.touched")
def touched(
    columns: int, frame: Array, starts: Array, ends: Array, out: NDArray[np.bool_]
) -> None:
    """Mark in `out` (M, tiles) the tiles that beams from starts (M, 2) to ends (M, k, 2) meet."""
    for i in range(len(starts)):
        tiles, _ = crossed(starts[i], ends[i], frame[0] * TILE, frame[1:])
        out[i, tiles[..., 1] * columns + tiles[..., 0]] = True


@compiled("grid_fast.draw")
def draw(
    pages: Pages, table: Table, columns: int, frame: Array, marked: NDArray[np.bool_],
    starts: Array, ends: Array,
) -> None:  # fmt: skip
    """Add beams from starts (M, 2) to ends (M, k, 2) to the tiles `marked` (M, tiles)."""
    for i in range(len(starts)):
        some = ends[i][(ends[i] != starts[i]).any(-1)]
        cells, t = crossed(starts[i], some, frame[0], frame[1:])
        last = np.floor((some - frame[1:]) / frame[0]).astype(np.intp)
        hit = np.concatenate([np.ones((len(some), 1)), np.zeros((len(some), 1)), some], 1)
        for found, into, more in (
            (cells, pages[..., _METRES], np.diff(t)),
            (last, pages, hit),
        ):
            slot, row, column = place(found, columns)
            # Rounding may lead past a corner into a tile that nobody marked: leave it.
            there = marked[i, slot]
            at = table[i, slot[there]], row[there], column[there]
            np.add.at(into, at, more[there].astype(np.float32))


@compiled("grid_fast.penetrate")
def penetrate(
    pages: Pages, table: Table, columns: int, frame: Array, starts: Array, ends: Array,
    sigma: float, score: Array,
) -> None:  # fmt: skip
    """Log likelihood of beams by DP-SLAM's model of a laser that may pass through any cell.

    A cell stops a beam of length l inside it with 1 - exp(-(h / d) l); P sums over the ray the
    chance to come to a cell, to stop there, and exp(-(r - r_c)^2 / 2 sigma^2) for a measured r.
    """
    beyond, prior = 4 * sigma, _PRIOR * frame[0]
    for i in range(len(starts)):
        way = ends[i][(ends[i] != starts[i]).any(-1)] - starts[i]
        length = np.hypot(*way.T)[:, None]
        # As far as a hit may be misread, and to the end of the last cell there.
        far = starts[i] + way * (1 + (beyond + 2 * frame[0]) / length)
        cells, t = crossed(starts[i], far, frame[0], frame[1:])
        kept = cells_at(pages, table[i], columns, cells).astype(float)
        hits, metres = kept[..., _HITS], kept[..., _METRES]
        stops = np.where(metres == 0.0, 1 / _FREE_WAY, hits / (metres + prior))  # per metre
        stop = 1 - np.exp(-stops * np.diff(t))  # (B)
        passed = np.cumprod(1 - stop, 1)
        reached = np.concatenate([np.ones_like(length), passed[:, :-1]], 1)
        counts = (t[:, :-1] < length + beyond) & (reached > 1e-4)
        off = length - 0.5 * (t[:, :-1] + t[:, 1:])
        P = (reached * stop * np.exp(-0.5 * off**2 / sigma**2) * counts).sum(1)  # (C)
        score[i] = np.log(P + _FLOOR).sum()
