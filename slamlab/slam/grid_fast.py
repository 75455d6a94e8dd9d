"""Grid FastSLAM: particles that carry occupancy maps; and DP-SLAM, one map for all of them.

Grisetti, Stachniss and Burgard, IEEE T-RO 23(1) 2007: each particle lays the scan upon its own map
before it is weighed. Eliazar and Parr, IJCAI 2003: many blind particles, a laser that may pass
through any cell. P5 section 2.4; chapter 15.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_choice, as_count, as_scalar, as_shaped
from slamlab.geometry import transform, wrap_angle
from slamlab.models import MotionModel, ScanSensor, as_scan_sensor
from slamlab.robots import RelativePose
from slamlab.slam._grid_maps import AncestryTree, MapParticles, TileMaps

__all__ = ["GridFastSlam"]

_LEAST_POINTS = 10
# Matching: more hits a metre than this make a wall; share of points that belong to the map.
_RATE, _HIT = 1.0, 0.9
# Penetration: free way of a laser in unseen cells (m), floor of a beam's likelihood.
_FREE_WAY, _FLOOR = 8.0, 1e-3


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
    n_points : int, default 180
        Beams of a scan that count, at most; evenly chosen.
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

    Raises
    ------
    ValueError
        If an argument has a wrong shape or value.

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
        n_points: int = 180,
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
        self._n_points = as_count("n_points", n_points, _LEAST_POINTS)
        self._sigma = as_scalar("sigma", sigma, 1e-6, 1e6)
        self._lost = as_scalar("lost", lost, 0.0, 1.0)
        storage = as_choice("storage", storage, ("tiles", "tree", "copies"))
        floor = self.n_particles, resolution, self.poses[0, :2]
        if storage == "tree":
            self._maps = AncestryTree(*floor)
        else:
            self._maps = TileMaps(*floor, share=storage == "tiles")
        self._empty = True

    def update(self, ranges: ArrayLike, ids: None = None) -> float:
        """Match, weigh, draw, resample.

        Parameters
        ----------
        ranges : array_like, shape (n_beams,)
            (m); NaN is a lost beam, inf or ``lidar.max_range`` one that met nothing. Only beams
            that met something count.
        ids : None
            Scans have no names.

        Returns
        -------
        float
            Logarithm of the weighted mean of the tempered likelihood; 0 for the first scan, and
            for one of fewer than ten points, which changes nothing.

        Raises
        ------
        ValueError
            If the shape is wrong or a range negative. The filter is then as it was before.
        """
        points = self.lidar.points(as_shaped("ranges", ranges, (self.lidar.n_beams,)))
        points = points[np.isfinite(points[:, 0])]
        points = np.ascontiguousarray(points[:: max(1, -(-len(points) // self._n_points))])
        if len(points) < _LEAST_POINTS:
            return 0.0
        poses, log_likelihood = self._cloud.particles.copy(), np.zeros(self.n_particles)
        # 1. Propose and 2. weigh, by the map that each particle drew so far.
        if not self._empty:
            self._weigh(points, poses, log_likelihood)
        # 3. Draw the scan into every map, before resampling: then copies share it.
        self._draw(points, poses)
        self._cloud.particles, self._empty = poses, False
        # 4. Resample particles with their maps if the weights say so.
        return self._weighed_by(log_likelihood)

    def _beams(self, points: Array, poses: Array) -> tuple[Array, Array]:
        """Where beams start (M, 2) and end (M, k, 2), in the world."""
        heading = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], -1)
        return poses[:, :2] + self.lidar.offset * heading, transform(poses, points)

    def _weigh(self, points: Array, poses: Array, score: Array) -> None:
        """Log likelihood of the scan into `score` (M,); matching moves `poses` first."""
        from slamlab.kernels.grid_fast import climb, penetrate

        where = (*self._maps.read(), self._maps.columns, self._maps.frame)
        if self.model == "matching":
            climb(*where, points, poses, (self._sigma, _RATE, _HIT, self._lost), score)
            poses[:, 2] = wrap_angle(poses[:, 2])
        else:
            settings = (self._sigma**2, _FREE_WAY, 4 * self._maps.resolution, _FLOOR)
            penetrate(*where, *self._beams(points, poses), settings, score)

    def _draw(self, points: Array, poses: Array) -> None:
        """Add the beams to every map."""
        from slamlab.kernels.grid_fast import draw, touched

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

        Raises
        ------
        ValueError
            If there is no such particle.
        """
        return self._maps.dense(self._row(particle)), self._maps.frame[1:]
