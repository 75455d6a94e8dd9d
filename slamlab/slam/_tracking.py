"""Front end of `ScanGraphSlam`: where is this scan among the last few keyframes.

Point to line, with the wheels' guess as a measurement beside the pairs; if that fits badly, the
same from where a search leads. Page 14b measures what prior, search and memory gain.

Along a plain corridor the wheels decide. The covariance that comes out is too small there: their
errors from scan to scan are taken for independent, and a slipping wheel errs the same way again.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_distances
from slamlab.geometry import rotation
from slamlab.matching import (
    LikelihoodGrid,
    PointsWithNormals,
    match_correlative,
    match_icp,
    voxel_downsample,
)
from slamlab.matching.match import Match
from slamlab.models import ScanSensor, as_scan_sensor

REACH = 30.0  # points farther away than this (m) are not matched
SPACING = 0.1  # one point in every square of this side (m)
FIELD = (0.1, 0.1)  # width and cell of the fields (m)
LEAST_POINTS = 10
WIDTH = 0.1  # error of a pair from which on it counts less (m)
NOISE = 0.05  # standard deviation of a pair's error (m)
# Below the first score a search helps, if it gains so much; below the last no match is believed.
GOOD_SCORE, MIN_GAIN, MIN_SCORE = 0.5, 0.1, 0.25
WINDOW, TURN = 1.0, np.deg2rad(15)  # of the search (m, rad)
SEARCH_COV = np.diag(np.square([0.3, 0.3, 0.1]))  # what the search is unsure of, at least
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
    """Some nodes at their places, as walls to lie on and a field to search."""

    def __init__(self, placed: Iterable[PointsWithNormals]) -> None:
        self._outline = PointsWithNormals.concatenated(placed)
        self.walls = self._outline.on_lines()

    @cached_property
    def field(self) -> LikelihoodGrid:
        """How near a place is to a point of the map."""
        return LikelihoodGrid.of_points(voxel_downsample(self._outline.points, SPACING), *FIELD)


def track(local_map: LocalMap, points: Array, guess: Array, cov: Array) -> Match | None:
    """Most probable pose of a scan by a local map and the guess; None if it lies nowhere well."""
    if len(local_map.walls.points) < 3:
        return None
    cov = cov + MIN_COV
    match_from = partial(match_icp, local_map.walls, points, width=WIDTH, noise=NOISE)
    match = match_from(guess, prior_cov=cov)
    if match.score < GOOD_SCORE:
        found = match_correlative(local_map.field, points, guess, WINDOW, TURN)
        if found is not None:
            other = match_from(found.pose, prior_cov=cov + SEARCH_COV)
            match = other if other.score > match.score + MIN_GAIN else match
    return match if match.score > MIN_SCORE else None


def edge_cov(cov: Array, heading: Array, floor: Array) -> Array:
    """Covariance of a pose (3, 3) in its own frame instead of the world's, and a floor."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(-heading)
    cov = turn @ cov @ turn.T + floor
    return 0.5 * (cov + cov.T)
