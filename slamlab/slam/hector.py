"""Hector SLAM: a map and a pose from a fast lidar, with or without wheels, and no loop closing.

Kohlbrecher, von Stryk, Meyer and Klingauf, SSRR 2011; P5 section 2.4. Chapter 14.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_count, as_scalar
from slamlab.geometry import between, transform
from slamlab.mapping import OccupancyGrid
from slamlab.matching import LikelihoodGrid, match_field
from slamlab.matching.match import Match
from slamlab.models import MotionModel, ScanSensor, as_motion
from slamlab.robots import RelativePose
from slamlab.robots.encoders import moved
from slamlab.slam._tracking import LEAST_POINTS, ScanSystem, has_moved

__all__ = ["HectorSlam"]

# The map is drawn anew after so much motion (m, rad); the paper's system does the same.
_NEW_MAP = (0.4, 0.13)


class HectorSlam(ScanSystem):
    """A scan slides up the slopes of the map that the scans before it drew.

    One map a level, each twice as coarse as the one below it and each filled on its own; a scan
    is matched to the coarsest first. The map is drawn only after 0.4 m or 0.13 rad of motion.

    Parameters
    ----------
    lidar : ScanSensor
        How the beams lie.
    pose : array_like, shape (3,), default (0, 0, 0)
        Where the robot stands first (m, m, rad).
    resolution : float, default 0.05
        Cell of the finest map (m).
    levels : int, default 3
        Number of maps.
    motion : MotionModel or None, default RelativePose()
        What the wheels tell, as the start of each match. None: lidar alone, every match
        starts from the pose before it.

    Attributes
    ----------
    pose, pose_cov : ndarray, shapes (3,) and (3, 3)
        Estimated pose (m, m, rad); covariance of the last match and of the motion since.
    maps : list of OccupancyGrid
        The finest first.
    lost : bool
        Whether the last scan contradicts the map: more of its points lie on floor that was seen
        free than on walls.
    lost_at : int or None
        Number of the first scan that did. What was drawn after it cannot be trusted.

    Examples
    --------
    >>> from slamlab.sensors import Lidar
    >>> from slamlab.worlds import rooms
    >>> lidar = Lidar(180, max_range=20.0)
    >>> slam = HectorSlam(lidar, [2.0, 4.0, 0.0], motion=None)
    >>> for x in (2.0, 2.1, 2.2):
    ...     match = slam.update(lidar.scan(rooms.office(), [x, 4.0, 0.0]))
    >>> cell = slam.maps[0].resolution
    >>> bool(np.abs(slam.pose - [2.2, 4.0, 0.0]).max() < cell), slam.lost
    (True, False)
    """

    def __init__(
        self,
        lidar: ScanSensor,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        resolution: float = 0.05,
        levels: int = 3,
        motion: MotionModel | None = RelativePose(),  # noqa: B008
    ) -> None:
        super().__init__(lidar, pose)
        self._motion = None if motion is None else as_motion("motion", motion)
        resolution = as_scalar("resolution", resolution, 1e-3, 1e3)
        self.maps = [
            OccupancyGrid(
                (64, 64), resolution * 2**k, self._pose[:2] - 32 * resolution * 2**k, p_hit=0.9
            )
            for k in range(as_count("levels", levels, 1))
        ]
        self._drawn: Array | None = None  # the pose from which the map was drawn last
        self.lost = False
        self.lost_at: int | None = None
        self._n_scans = 0

    def __repr__(self) -> str:
        x, y, heading = self._pose
        state = ", lost" if self.lost else ""
        return f"HectorSlam(at ({x:.2f}, {y:.2f}, {np.rad2deg(heading):.1f} deg){state})"

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move by what the wheels tell: control u (p,) during dt (s), covariance (p, p)."""
        if self._motion is not None:
            self._pose, self._cov = moved(self._motion, self._pose, u, dt, control_cov, self._cov)

    def update(self, ranges: ArrayLike, ids: None = None) -> Match:
        """Match a scan to the map, and draw it in if the robot has moved.

        Parameters
        ----------
        ranges : array_like, shape (n_beams,)
            (m), not negative; NaN is a lost beam, inf or ``lidar.max_range`` one that met nothing.
        ids : None
            Scans have no names.

        Returns
        -------
        Match
            `score` is the mean probability of a wall under the points; 0.5 is "never seen". A
            scan of fewer than ten points matches nothing (score 0) and changes nothing.
        """
        ranges = self._taken(ranges)
        points = self._lidar.points(ranges)
        points = points[np.isfinite(points[:, 0])]
        self._n_scans += 1
        if len(points) < LEAST_POINTS:
            return Match(self.pose, self.pose_cov, 0.0, 0)
        if self._drawn is None:  # the first scan begins the map
            match = Match(self.pose, self.pose_cov, 1.0, len(points))
        else:
            fields = [
                LikelihoodGrid.of_occupancy(grid.log_odds, grid.resolution, grid.origin)
                for grid in reversed(self.maps)
            ]
            match = match_field(fields, points, self._pose)  # (4) to (14), coarse first
            self._pose, self._cov = match.pose.copy(), match.cov.copy()
            p = fields[-1].value(transform(self._pose, points))
            self.lost = bool((p < 0.4).sum() > (p > 0.6).sum())  # more on free floor than on walls
            if self.lost and self.lost_at is None:
                self.lost_at = self._n_scans - 1
        if self._drawn is None or has_moved(between(self._drawn, self._pose), *_NEW_MAP):
            self._drawn = self._pose.copy()
            for grid in self.maps:
                grid.insert(self._pose, ranges, self._lidar, free_missing=False)
        return match
