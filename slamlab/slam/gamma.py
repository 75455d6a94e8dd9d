"""Gamma-SLAM: particles that know a place by how rough the ground is in each of its cells.

Marks, Howard, Bajracharya, Cottrell and Matthies, ICRA 2008: a stereo rig sees the heights of the
ground, visual odometry proposes, each particle keeps its own variance grid. P5 section 2.3;
(D)-(F) are formulas of chapters 15 and 15b.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_choice, as_instance, as_scalar, as_shaped
from slamlab.geometry import transform
from slamlab.grids import Grid
from slamlab.kernels import compiled
from slamlab.mapping.variance import FEWEST, FLOOR, OF, VarianceGrid, unchecked_log_density
from slamlab.models import HeightSensor, MotionModel, as_scan_sensor
from slamlab.robots import RelativePose
from slamlab.slam._grid_maps import MapParticles, TileMaps

__all__ = ["GammaSlam"]


class GammaSlam(MapParticles):
    """Rao-Blackwellized particle filter for SLAM on rough ground: each particle has its own map.

    Given the path of a particle, the precision of the heights in each cell is gamma distributed,
    exactly. Particles share the pages of their maps until one of them writes.

    Parameters
    ----------
    rig : HeightSensor
        How the rays lie, such as `sensors.StereoRig`.
    pose : array_like, shape (3,), default (0, 0, 0)
        Where the robot stands first (m, m, rad).
    n_particles : int, default 60
    rng : numpy.random.Generator
    motion : MotionModel, default RelativePose()
        How visual odometry moves the robot.
    resolution : float, default 0.25
        Side of a cell (m).
    alpha, beta : float, default 1 and 1e-3
        Shape and rate (m^2) of the precision in a cell that nobody saw.
    density : {"heights", "variances"}, default "heights"
        What a particle is weighed by: the density of the heights of a picture, or that of their
        sample variances, which is not comparable between particles that sort the same heights
        into different cells.
    temper : float, default 0.3
        Power of the likelihood. With 1 all particles soon descend from one, and the filter is
        overconfident; so it is, less, with the default (chapter 15 uses 0.1).
    threshold : float, default 0.5
        Resample when the effective sample size falls below this share of the particles.

    Attributes
    ----------
    map_bytes : int
        Memory of all maps together.

    Examples
    --------
    >>> from slamlab.sensors import StereoRig
    >>> from slamlab.worlds import Terrain
    >>> rig, ground = StereoRig(1000), Terrain.rough(np.random.default_rng(1))
    >>> slam = GammaSlam(rig, [9.0, 9.0, 0.0], 30, rng=np.random.default_rng(2))
    >>> for x in (9.0, 9.3, 9.6):
    ...     if x > 9:
    ...         slam.predict([0.3, 0.0, 0.0], 1.0, np.diag([0.05, 0.05, 0.01]) ** 2)
    ...     evidence = slam.update(rig.scan(ground, [x, 9.0, 0.0]))
    >>> bool(np.abs(slam.pose - [9.6, 9.0, 0.0]).max() < 0.06)
    True
    """

    def __init__(
        self,
        rig: HeightSensor,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        n_particles: int = 60,
        *,
        rng: np.random.Generator,
        motion: MotionModel = RelativePose(),  # noqa: B008
        resolution: float = 0.25,
        alpha: float = 1.0,
        beta: float = 1e-3,
        density: str = "heights",
        temper: float = 0.3,
        threshold: float = 0.5,
    ) -> None:
        as_scan_sensor("rig", rig)
        self.rig: HeightSensor = as_instance("rig", rig, HeightSensor, "a rig such as StereoRig()")
        super().__init__(motion, pose, n_particles, rng, temper, threshold)
        resolution = as_scalar("resolution", resolution, 1e-3, 1e3)
        self._prior = as_scalar("alpha", alpha, 1e-9, 1e9), as_scalar("beta", beta, 1e-12, 1e9)
        self.density = as_choice("density", density, OF)
        self._maps = TileMaps(self.n_particles, resolution, self.poses[0, :2], channels=2)

    def update(self, ranges: ArrayLike, ids: None = None) -> float:
        """Sort, weigh, add, resample.

        Parameters
        ----------
        ranges : array_like, shape (n_beams,)
            Along the rays (m), not negative; NaN is a lost one, inf or ``rig.max_range`` one that
            met nothing.
        ids : None
            Pictures have no names.

        Returns
        -------
        float
            Logarithm of the weighted mean of the tempered likelihood; 0 for a picture that shows
            nothing, which changes nothing.
        """
        ranges = as_shaped("ranges", ranges, (self.rig.n_beams,))
        points, heights = self.rig.points(ranges), self.rig.heights(ranges)
        seen = np.isfinite(points).all(-1)
        if not seen.any():
            return 0.0
        points, heights = points[seen], heights[seen] - heights[seen].mean()
        maps, poses, (alpha, beta) = self._maps, self._cloud.particles, self._prior
        reach = np.hypot(*points.T).max()
        maps.make_room(np.concatenate([poses[:, :2] - reach, poses[:, :2] + reach]))
        # 1. Sort the points into cells: each particle its own way, for cells are of the world.
        particle, cells, nu, squares = gather(points, heights, poses, maps.frame)
        # 2. Weigh by the map that each particle made so far.
        freedom, before = maps.values(particle, cells).T
        alpha, beta = alpha + 0.5 * freedom, beta + 0.5 * before  # (D), of all that was added
        fits = self._log_density(squares / nu, nu, alpha, beta)  # (F)
        log_likelihood = np.bincount(particle, fits, len(poses)).astype(float)
        # 3. Add nu and S = nu s^2 to every map, before resampling: then copies share.
        maps.add(particle, cells, np.stack([nu, squares], -1))
        # 4. Resample particles with their maps if the weights say so.
        return self._weighed_by(log_likelihood)

    def _log_density(self, s2: Array, nu: Array, alpha: Array, beta: Array) -> Array:
        """Log density of what each cell shows; 0 where that is too little to have a variance."""
        if self.density == "heights":
            return unchecked_log_density(s2, nu, alpha, beta, "heights")  # (F)
        log_density = unchecked_log_density(s2 + FLOOR, nu, alpha, beta, "variances")  # (E)
        return np.where(nu >= FEWEST, log_density, 0.0)

    def map(self, particle: int | None = None) -> VarianceGrid:
        """Map of a particle, the heaviest by default; a copy.

        Parameters
        ----------
        particle : int, optional
            Row of `poses`.

        Raises
        ------
        ValueError
            If nothing was seen yet.
        """
        row = self._row(particle)
        if not self._maps.size.any():
            raise ValueError("particle: expected a map, nothing was seen yet")
        cells, frame = self._maps.dense(row).astype(float), self._maps.frame
        rows, columns = cells.shape[:2]
        grid = VarianceGrid(Grid((rows, columns), frame[0], frame[1:]), *self._prior)
        grid.alpha += 0.5 * cells[..., 0]
        grid.beta += 0.5 * cells[..., 1]
        return grid


@compiled("gamma.gather")
def gather(
    points: Array, heights: Array, poses: Array, frame: Array
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, NDArray[np.float32]]:
    """Sort points (k, 2) (m, in the body) with heights (k,) into the cells of each particle.

    `frame` is the resolution and the corner of the floor (m). Returned are particle (L,), column
    and row (L, 2), degrees of freedom nu (L,) and nu s^2 (L,) (m^2, as exact as a map keeps it) of
    all cells with two points or more.
    """
    resolution, corner = frame[0], frame[1:]
    column, row = np.floor((transform(poses, points) - corner) / resolution).astype(np.intp).T
    low, high = np.array([column.min(), row.min()]), np.array([column.max(), row.max()])
    columns, rows = high - low + 1
    # One number for each cell of each particle, then sums by that number.
    number = (np.arange(len(poses)) * rows + row - low[1]) * columns + column - low[0]
    number, heights = number.T.ravel(), np.tile(heights, len(poses))
    size = len(poses) * rows * columns
    n, total, square = (np.bincount(number, w, size) for w in (None, heights, heights**2))
    some: NDArray[np.intp] = np.flatnonzero(n >= 2)
    nu = n[some].astype(float) - 1
    squares = np.maximum(square[some] - total[some] ** 2 / n[some], 0.0).astype(np.float32)
    particle, place = np.divmod(some, rows * columns)
    cells = np.stack([place % columns, place // columns], -1) + low
    return particle, cells, nu, squares
