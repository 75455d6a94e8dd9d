"""Front end of `ScanGraphSlam`: where is this scan among the last few keyframes.

Climb a field of the last keyframes; if that fails, search; end with point to line, which has no
bias. Chapter 14 measures what each step gains.

Along a plain corridor the wheels decide. The covariance that comes out is too small there: their
errors from scan to scan are taken for independent, and a slipping wheel errs the same way again.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_distances
from slamlab.geometry import between, rotation, wrap_angle
from slamlab.matching import (
    LikelihoodGrid,
    PointsWithNormals,
    match_correlative,
    match_icp,
    voxel_downsample,
)
from slamlab.matching.field import refined
from slamlab.matching.match import Match
from slamlab.models import ScanSensor, as_scan_sensor

REACH = 30.0  # points farther away than this (m) are not matched
SPACING = 0.1  # one point in every square of this side (m)
FIELD = (0.1, 0.1)  # width and cell of the fields (m)
MAX_RMSE = 0.5  # root mean square of 1 - M from which on a climb is not believed
LEAST_POINTS = 10
MAX_RMSE_RATIO = 0.8  # what a search finds must fit so much better than the climb from the guess
# A match that is believed: so many points have a partner, their part of all, their mean weight.
MIN_CORRESPONDENCES, MIN_FITNESS, MIN_MEAN_WEIGHT = 25, 0.2, 0.45
ODOMETRY_INFLATION = 9.0  # times the covariance that wheels claim: they have a bias, too
# What a match is unsure of besides its noise: the reference is a set of points, not the wall (m,
# m, rad).
MIN_COV = np.diag(np.square([0.01, 0.01, np.deg2rad(0.15)]))


class ScanSystem:
    """What a system on scans has: a lidar, a pose and its covariance."""

    measures = "scan"

    def __init__(self, lidar: ScanSensor, pose: ArrayLike) -> None:
        self._lidar = as_scan_sensor("lidar", lidar)
        self._pose = as_array("pose", pose, (3,)).astype(np.float64)
        self._cov = np.zeros((3, 3))

    @property
    def pose(self) -> Array:
        """Estimated pose (m, m, rad), shape (3,)."""
        return self._pose.copy()

    @property
    def pose_cov(self) -> Array:
        """Its covariance, shape (3, 3)."""
        return self._cov.copy()

    def _taken(self, ranges: ArrayLike) -> Array:
        return as_distances("ranges", ranges, (self._lidar.n_beams,))


def has_moved(motion: Array, distance: float, angle: float) -> bool:
    """Whether a motion leads this far (m), or turns so much (rad), at least."""
    dx, dy, turn = motion
    return bool(np.hypot(dx, dy) >= distance or abs(turn) >= angle)


def scan_points(ranges: Array, lidar: ScanSensor) -> Array:
    """Thinned end points (k, 2) of a scan within `REACH`, in the frame of the body."""
    points = lidar.points(np.where(ranges <= REACH, ranges, np.nan))
    return voxel_downsample(points, SPACING)


class LocalMap:
    """Some nodes at their places, as a field to climb and walls to lie on."""

    def __init__(self, placed: Iterable[PointsWithNormals]) -> None:
        outline = PointsWithNormals.concatenated(placed)
        self.walls = outline.on_lines()
        self.field = LikelihoodGrid.of_points(voxel_downsample(outline.points, SPACING), *FIELD)


def track(local_map: LocalMap, points: Array, guess: Array, cov: Array) -> Match | None:
    """Match a scan against a local map; None if it does not lie well where it can be.

    `cov` (3, 3) is how unsure the guess is: how far the search looks and a match may lie.
    """
    window = 0.3 + 2 * float(np.sqrt(max(cov[0, 0], cov[1, 1])))
    turn = min(np.deg2rad(10) + 2 * float(np.sqrt(cov[2, 2])), np.pi)
    pose, misfit = refined(local_map.field, points, guess)
    if misfit > MAX_RMSE:
        found = match_correlative(local_map.field, points, guess, min(window, 3.0), turn)
        if found is not None:
            other, left = refined(local_map.field, points, found.pose)
            if left < MAX_RMSE_RATIO * misfit:
                pose = other
    if len(local_map.walls.points) < 3:
        return None
    match = match_icp(local_map.walls, points, pose)
    dx, dy, dtheta = between(guess, match.pose)
    possible = np.hypot(dx, dy) <= window and abs(dtheta) <= turn
    return match if possible and _good(match, len(points)) else None


def _good(match: Match, n: int) -> bool:
    pairs = match.n_points
    weight = match.score * n / max(pairs, 1)
    return pairs >= MIN_CORRESPONDENCES and pairs >= MIN_FITNESS * n and weight >= MIN_MEAN_WEIGHT


def edge_cov(cov: Array, heading: Array, floor: Array) -> Array:
    """Covariance of a pose (3, 3) in its own frame instead of the world's, and a floor."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(-heading)
    cov = turn @ cov @ turn.T + floor
    return 0.5 * (cov + cov.T)


def fused(match: Match, guess: Array, cov: Array) -> tuple[Array, Array]:
    """Match and guess as one pose and covariance: the Kalman filter of P5 with H = I.

    Where walls hold the scan the match decides; along a corridor, where its covariance is wide,
    the wheels do.
    """
    wide = cov + MIN_COV
    gain = wide @ np.linalg.inv(wide + match.cov)  # (6), (7)
    off = match.pose - guess  # (5)
    off[2] = wrap_angle(off[2])
    return guess + gain @ off, (np.eye(3) - gain) @ wide  # (8), (9)
