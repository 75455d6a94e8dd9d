"""Where in a map made before is the robot? Particles find the place, then each scan is matched.

Particles anywhere on the free floor: Thrun, Burgard and Fox, Probabilistic Robotics (2005),
chapter 8. Matching: Hector, P5 section 2.4. Chapters 04 and 14; `slamlab map --localize`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_count, as_distances, as_instance, as_rng
from slamlab.filters.particle import KLD
from slamlab.geometry import compose, inverse, rotation, transform, wrap_angle
from slamlab.localization.likelihood_field import LikelihoodField
from slamlab.localization.monte_carlo import MonteCarloLocalization
from slamlab.matching import LikelihoodGrid, match_field
from slamlab.models import MotionModel, ScanSensor, as_motion, as_scan_sensor
from slamlab.robots.encoders import moved
from slamlab.worlds import BitmapWorld

__all__ = ["GlobalLocalization"]

_REACH = 30.0  # points farther away than this (m) are not used
_LEAST_POINTS = 10
_MOVED = 0.2, 0.1  # the particles are weighed again after so much motion (m, rad)
_SEARCH = 0.3, 0.8, 15  # of the likelihood field: sigma (m), share of hits, points a scan
_FIELDS = 0.4, 0.1  # widths of the fields that a match climbs, wide first (m)
_CONCENTRATED = np.array([0.4, 0.4, np.deg2rad(10)])  # a cloud so narrow is one place (m, rad)
_NEAR_A_WALL = 0.1  # a point so near (m), or two cells, fits the map
_FITS = 0.85  # share of points that fit where tracking begins
_MISFITS = 0.85  # below this part of the usual share a scan does not fit
_PATIENCE = 20  # scans in a row that do not fit before the particles search again
_BIAS = 9.0  # times the covariance of the odometry: it has a bias, not only noise
_FLOOR = np.diag(np.square([0.01, 0.01, np.deg2rad(0.2)]))  # of each match and step (m, m, rad)
_PER_CELL = 200  # particles for each square metre of free floor, at first
_MOST = 300_000


class GlobalLocalization:
    """A lidar on a robot that may be anywhere in a known map.

    At first a `MonteCarloLocalization` over the whole free floor searches. Once its cloud is one
    place in which 85 % of the scan lie on walls, each scan is matched to the map from where the
    odometry leads. After twenty scans in a row that fit worse than usual, the search begins anew.

    Parameters
    ----------
    walls : BitmapWorld
        Cells with a wall, at least one.
    lidar : ScanSensor
    motion : MotionModel
    rng : numpy.random.Generator
    floor : BitmapWorld, optional
        Its free cells, at least one, are where the robot may be, `walls` by default. A map of ROS
        gives both: ``BitmapWorld.from_file(path, unknown="free")`` and
        ``BitmapWorld.from_file(path)``.
    n_particles : int, optional
        At first; 200 for each square metre of free floor by default, from 1000 to 300 000.

    Attributes
    ----------
    localized_at : int or None
        Number of the scan at which one place was found; None while it is searched for.
    fits : list of float
        For each scan the share of its points near a wall (0.1 m, or two cells).

    Examples
    --------
    >>> from slamlab.robots import RelativePose
    >>> from slamlab.sensors import Lidar
    >>> cells = np.ones((60, 100), bool)
    >>> cells[2:58, 2:98] = cells[20:40, 50:70] = False
    >>> cells[30:44, 50:64] = True
    >>> room, lidar = BitmapWorld(cells, 0.1), Lidar(90, max_range=8.0)
    >>> system = GlobalLocalization(room, lidar, RelativePose(), np.random.default_rng(1))
    >>> for x in np.arange(1.0, 4.0, 0.25):
    ...     system.predict([0.25, 0, 0], 1.0, np.diag([0.02, 0.02, 0.01]) ** 2)
    ...     fit = system.update(lidar.scan(room, [x, 1.5, 0.0]))
    >>> system.localized, bool(np.abs(system.pose - [3.75, 1.5, 0.0]).max() < 0.1)
    (True, True)
    """

    measures = "scan"

    def __init__(
        self,
        walls: BitmapWorld,
        lidar: ScanSensor,
        motion: MotionModel,
        rng: np.random.Generator,
        floor: BitmapWorld | None = None,
        n_particles: int | None = None,
    ) -> None:
        walls = as_instance("walls", walls, BitmapWorld)
        floor = walls if floor is None else as_instance("floor", floor, BitmapWorld)
        self._lidar = as_scan_sensor("lidar", lidar)
        self._motion, rng = as_motion("motion", motion), as_rng("rng", rng)
        if floor.occupied.all():
            raise ValueError("floor: expected free cells, found none")
        self._walls = _WallMap(walls)
        area = float((~floor.occupied).sum()) * floor.resolution**2
        wished = int(np.clip(_PER_CELL * area, 1000, _MOST))
        M = wished if n_particles is None else as_count("n_particles", n_particles)
        size = KLD(np.array([0.5, 0.5, 0.2]), minimum=min(1000, M), maximum=M)
        bounds = np.reshape(floor.bounds, (2, 2)).T
        anywhere = partial(
            MonteCarloLocalization, self._walls.field, self._motion, self._lidar, M, bounds, rng,
            adaptive=size, free=floor.is_free,
        )  # fmt: skip
        self._search = _Search(anywhere)
        self._tracker: _Tracker | None = None  # when one place was found
        self._pose, self._cov = self._search.particles.pose, self._search.particles.pose_cov
        self.localized_at: int | None = None
        self.fits: list[float] = []
        # Motion since the last scan, and its covariance in the frame of the body then.
        self._step = np.zeros(3), np.zeros((3, 3))
        self._records: list[tuple[tuple[Array, Array], Array, Array]] = []  # step, pose, points

    @property
    def localized(self) -> bool:
        """Whether one place was found, and the scans fit there."""
        return self._tracker is not None

    @property
    def pose(self) -> Array:
        """Estimated pose (3,) (m, m, rad); of the particles' mean while it is searched for."""
        return self._pose.copy()

    @property
    def pose_cov(self) -> Array:
        """Covariance (3, 3) of `pose`."""
        return self._cov.copy()

    @property
    def trajectory(self) -> Array:
        """Best poses (T, 3): from where it was found, the scans before are matched backwards."""
        path = np.array([pose for _, pose, _ in self._records]).reshape(-1, 3)
        for k in range((self.localized_at or 0) - 1, -1, -1):
            (step, Q), _, _ = self._records[k + 1]
            guess = compose(path[k + 1], inverse(step))
            path[k], _, _ = self._walls.match(self._records[k][2], guess, _step_cov(Q, guess))
        return path

    def __repr__(self) -> str:
        """Say whether the place is known."""
        x, y, theta = self._pose
        if not self.localized:
            n = self._search.particles.n_particles
            return f"GlobalLocalization(searching with {n} particles)"
        return f"GlobalLocalization(at ({x:.2f} m, {y:.2f} m, {np.rad2deg(theta):.1f} deg))"

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move by control u (p,) during dt (s), executed with covariance (p, p)."""
        step, Q = moved(self._motion, self._step[0], u, dt, control_cov, self._step[1])
        system = self._tracker or self._search.particles
        system.predict(u, dt, control_cov)
        self._step, self._pose, self._cov = (step, Q), system.pose, system.pose_cov

    def update(self, ranges: ArrayLike, ids: None = None) -> float:
        """Search with a scan, or match it.

        Parameters
        ----------
        ranges : array_like, shape (n_beams,)
            (m), not negative; NaN is a lost beam, inf or ``lidar.max_range`` one that met nothing.
        ids : None
            Scans have no names.

        Returns
        -------
        float
            Share of the points that lie near a wall; 0 for a scan of fewer than ten.
        """
        ranges = as_distances("ranges", ranges, (self._lidar.n_beams,))
        ranges = np.where(ranges <= _REACH, ranges, np.nan)
        points = self._lidar.points(ranges)
        points = points[np.isfinite(points[:, 0])]
        self._search.add_motion(self._step[0])
        fit = 0.0
        if len(points) >= _LEAST_POINTS:
            tracker = self._tracker
            fit = self._seek(ranges, points) if tracker is None else self._track(tracker, points)
        self._records.append((self._step, self._pose, points))
        self._step = np.zeros(3), np.zeros((3, 3))
        self.fits.append(fit)
        return fit

    def _seek(self, ranges: Array, points: Array) -> float:
        """Weigh the particles; if they are one place in which the scan fits, begin to track."""
        self._search.weigh(ranges)
        self._pose, self._cov = self._search.particles.pose, self._search.particles.pose_cov
        sigma = np.sqrt(np.diag(self._cov))
        pose, cov, fit = self._walls.match(points, self._pose, self._cov)
        if (sigma < _CONCENTRATED).all() and fit >= _FITS:
            self._tracker = _Tracker(self._walls, self._motion, pose, cov, fit)
            self._pose, self._cov = pose, cov
            self.localized_at = len(self._records)
        return fit

    def _track(self, tracker: _Tracker, points: Array) -> float:
        """Match the scan from where the odometry led; search again if many do not fit."""
        fit = tracker.update(points, self._step[1])
        self._pose, self._cov = tracker.pose, tracker.pose_cov
        if tracker.misfits >= _PATIENCE:
            self._tracker = self.localized_at = None
            self._search.begin()
        return fit


class _WallMap:
    """The map, as scans are weighed in it and matched to it."""

    def __init__(self, walls: BitmapWorld) -> None:
        sigma, hit, n_points = _SEARCH
        self.field = LikelihoodField(
            walls.occupied, walls.resolution, walls.origin, sigma, hit, n_points
        )
        rows, columns = np.nonzero(walls.occupied)
        points = walls.origin + walls.resolution * (np.column_stack([columns, rows]) + 0.5)
        self._fields = [
            LikelihoodGrid.of_points(points, width, max(walls.resolution, width / 2))
            for width in _FIELDS
        ]

    def match(self, points: Array, guess: Array, cov: Array) -> tuple[Array, Array, float]:
        """Match and guess as one pose and covariance; and the share of points near walls there.

        The Kalman filter of P5 with H = I. Along a corridor, where the covariance of the match is
        wide, the odometry decides.
        """
        if len(points) < _LEAST_POINTS:
            return guess, cov, 0.0
        match = match_field(self._fields, points, guess)
        if (fit := self._fit(points, match.pose)) < 0.5:
            return guess, cov, fit
        gain = cov @ np.linalg.inv(cov + match.cov + _FLOOR)  # (6), (7)
        off = match.pose - guess  # (5)
        off[2] = wrap_angle(off[2])
        pose = guess + gain @ off  # (8)
        pose[2] = wrap_angle(pose[2])
        return pose, (np.eye(3) - gain) @ cov, self._fit(points, pose)  # (9)

    def _fit(self, points: Array, pose: Array) -> float:
        """Share of the points near a wall (0.1 m, or two cells)."""
        near = max(_NEAR_A_WALL, 2 * self.field.resolution)
        cells = self.field.cells(transform(pose, points))
        inside = self.field.holds(cells)
        row, column = (cells * inside[:, None]).T
        return float((inside & (self.field.distance[row, column] <= near)).mean())


class _Search:
    """Particles from anywhere, weighed by a scan if the robot has moved since the last."""

    def __init__(self, anywhere: Callable[[], MonteCarloLocalization]) -> None:
        self._anywhere = anywhere
        self.begin()

    def begin(self) -> None:
        """Draw new particles."""
        self.particles = self._anywhere()
        self._moved: Array | None = None  # since they were weighed; None: they never were

    def add_motion(self, step: Array) -> None:
        """Add the motion (3,) from one scan to the next."""
        if self._moved is not None:
            self._moved = compose(self._moved, step)

    def weigh(self, ranges: Array) -> None:
        """Weigh the particles by a scan, if the robot has moved."""
        if self._moved is None or _is_new(self._moved):
            self.particles.update(ranges)
            self._moved = np.zeros(3)


class _Tracker:
    """A pose, from which each scan is matched where the odometry has led it.

    `misfits` counts the last scans in a row that fitted worse than usual.
    """

    def __init__(
        self, walls: _WallMap, motion: MotionModel, pose: Array, cov: Array, fit: float
    ) -> None:
        self._walls, self._motion = walls, motion
        self.pose, self.pose_cov = pose, cov
        self._usual = fit  # share of points that fitted so far
        self.misfits = 0

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move by control u (p,) during dt (s), executed with covariance (p, p)."""
        self.pose, self.pose_cov = moved(
            self._motion, self.pose, u, dt, control_cov, self.pose_cov
        )

    def update(self, points: Array, Q: Array) -> float:
        """Match a scan; Q (3, 3) is the covariance of the step to it. Return how well it fits."""
        cov = self.pose_cov + _step_cov(Q, self.pose)
        self.pose, self.pose_cov, fit = self._walls.match(points, self.pose, cov)
        if fit >= _MISFITS * self._usual:
            self._usual += 0.05 * (fit - self._usual)
            self.misfits = 0
        else:
            self.misfits += 1
        return fit


def _is_new(motion: Array) -> bool:
    return bool(np.hypot(*motion[:2]) >= _MOVED[0] or abs(motion[2]) >= _MOVED[1])


def _step_cov(Q: Array, pose: Array) -> Array:
    """Covariance (3, 3) of a step in the world, the bias of the odometry included."""
    R = np.eye(3)
    R[:2, :2] = rotation(pose[2])
    return R @ (_BIAS * Q + _FLOOR) @ R.T
