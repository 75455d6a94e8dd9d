"""EKF-SLAM on walls: what the robot of P1 does with its scans, "Checking the algorithm".

Walls are taken out of each scan, told apart by their lines, and corrected together with the pose.
P1 leaves the extraction and the association to "a separate discussion"; here they are. Chapter 09.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_count, as_instance, as_positive, as_scalar
from slamlab.gaussian import chi2_quantile
from slamlab.geometry import transform
from slamlab.mapping.lines import in_name_of, on_line
from slamlab.mapping.walls import Walls, extract_walls
from slamlab.models import MotionModel, ScanSensor, as_scan_sensor
from slamlab.sensors import Wall
from slamlab.slam.association import IGNORED, NEW
from slamlab.slam.ekf import EKFSlam

__all__ = ["WallSighting", "WallSlam"]

# Along each wall the map counts how often every bin of so many metres was seen.
_BIN = 0.05
# Stretches of a wall with a gap smaller than this (m) are one.
_JOIN = 0.3
# Cutting a scan at its corners leaves errors beside the noise of the beams.
_EXTRACTION = (0.002, float(np.deg2rad(0.08)))


class NoisyLidar(ScanSensor, Protocol):
    """A lidar whose noise is known; a bare layout of beams has none."""

    @property
    def sigma_range(self) -> float:
        """Standard deviation of the ranges (m)."""


@dataclass(frozen=True, eq=False)
class WallSighting:
    """What one scan showed.

    Attributes
    ----------
    walls : Walls
        Walls in the frame of the lidar.
    ids : tuple
        For each of them the id in the map, None if it was left out.
    nis : float
        Squared, weighted innovation of the walls known before; 2 per wall are expected.
    """

    walls: Walls
    ids: tuple[Hashable | None, ...]
    nis: float


class WallSlam:
    """EKF-SLAM of a robot with a lidar among walls.

    Parameters
    ----------
    motion : motion model
        As `EKFSlam`.
    lidar : scan sensor
        Layout of the beams.
    pose : array_like, shape (3,)
        Where the map begins (m, m, rad).
    cov : array_like, shape (3, 3), optional
        Covariance of `pose`; zero if left out.
    probability : float, default 0.999
        A wall is taken for one of the map if it falls in the gate of this probability.
    min_length : float, default 0.6
        Shorter pieces (m) correct the walls of the map but start none.
    confirm : int, default 5
        A wall seen less often is no part of `segments`, and is removed if it was not seen for
        `patience` predictions.
    patience : int, default 60
    sigma_range : float, optional
        Standard deviation of a range (m), positive: it decides how well a wall is known. That of
        the lidar if left out; a bare `ScanGeometry` has none.
    sigma_wall : array_like, shape (2,), default (0.002, 0.0014)
        Standard deviation of (r, alpha) of a wall (m, rad) beside the noise of its beams. The
        default, 2 mm and 0.08 degrees, is what cutting straight walls at their corners leaves; a
        building with doors and notice boards has several times as much (chapter 09).

    Attributes
    ----------
    measures : str
        "scan": scans.
    filter : EKFSlam
        Pose and lines (r, alpha), with their covariance.

    Examples
    --------
    A wall two metres ahead of the lidar, seen twice:

    >>> from slamlab.robots import YOUBOT
    >>> from slamlab.sensors import Lidar
    >>> from slamlab.worlds import WallWorld
    >>> lidar = Lidar(181, np.pi / 2, offset=0.3, sigma_range=0.01)
    >>> slam = WallSlam(YOUBOT, lidar, [0, 0, 0])
    >>> wall = WallWorld([[[2.3, -3], [2.3, 3]]])
    >>> scan = Lidar(181, np.pi / 2, offset=0.3).scan(wall, [0, 0, 0])
    >>> slam.update(scan).ids, slam.update(scan).ids
    ((0,), (0,))
    >>> (slam.filter.landmarks.round(3) + 0.0).tolist()
    [[2.3, 0.0]]
    """

    measures = "scan"

    def __init__(
        self,
        motion: MotionModel,
        lidar: ScanSensor,
        pose: ArrayLike,
        cov: ArrayLike | None = None,
        *,
        probability: float = 0.999,
        min_length: float = 0.6,
        confirm: int = 5,
        patience: int = 60,
        sigma_range: float | None = None,
        sigma_wall: ArrayLike = _EXTRACTION,
    ) -> None:
        as_scan_sensor("lidar", lidar)
        if sigma_range is None:
            wanted = "a lidar that tells its noise, such as Lidar(...)"
            noisy: NoisyLidar = as_instance("lidar", lidar, NoisyLidar, wanted)
            self._sigma = as_positive("lidar.sigma_range", noisy.sigma_range, 1e300)
        else:
            self._sigma = as_positive("sigma_range", sigma_range, 1e300)
        own = as_array("sigma_wall", sigma_wall, (2,))
        if (own < 0).any():
            raise ValueError(f"sigma_wall: expected no negative number, got {own.tolist()}")
        self._wall_cov = np.diag(own**2)
        self._gate = float(chi2_quantile(as_positive("probability", probability, 1 - 1e-12), 2))
        self._min_length = as_scalar("min_length", min_length, 0, 1e300)
        self._confirm = as_count("confirm", confirm, 1)
        self._patience = as_count("patience", patience, 1)
        self._lidar = lidar
        # The covariance of each sighting comes from its points; the sensor's own is not used.
        self.filter = EKFSlam(motion, Wall(1.0, 1.0, offset=lidar.offset), pose, cov)
        self._spans: dict[Hashable, list[list[int]]] = {}

    def __repr__(self) -> str:
        """Say where it is and how much it knows."""
        return f"WallSlam({len(self.confirmed)} walls confirmed, filter={self.filter!r})"

    @property
    def pose(self) -> Array:
        """Estimated pose (m, m, rad), shape (3,)."""
        return self.filter.pose

    @property
    def pose_cov(self) -> Array:
        """Covariance of the pose, shape (3, 3)."""
        return self.filter.pose_cov

    @property
    def confirmed(self) -> tuple[Hashable, ...]:
        """Ids of the walls that were seen often enough to be believed."""
        often = np.flatnonzero(self.filter.n_observations >= self._confirm)
        return tuple(self.filter.ids[row] for row in often)

    @property
    def segments(self) -> Array:
        """The map: stretches of the confirmed walls that were seen, (k, 2, 2) in the world (m)."""
        lines = dict(zip(self.filter.ids, self.filter.landmarks, strict=True))
        found = [on_line(lines[id], self._observed_intervals(id)) for id in self.confirmed]
        return np.concatenate(found) if found else np.empty((0, 2, 2))

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Stage 1 of P1: move the pose, as `EKFSlam.predict`."""
        self.filter.predict(u, dt, control_cov)

    def update(self, measurement: ArrayLike, ids: None = None) -> WallSighting:
        """Stages 2 and 3 of P1: correct by the walls known already, add the others.

        Parameters
        ----------
        measurement : array_like, shape (n_beams,)
            Ranges of one scan (m), not negative; NaN or inf is a beam without return.
        ids : None
            Walls are told apart by their lines; nobody can name them.

        Returns
        -------
        WallSighting
        """
        if ids is not None:
            raise ValueError(f"ids: expected None, walls have no names in a scan, got {ids!r}")
        ekf = self.filter
        points = self._lidar.points(measurement) - [self._lidar.offset, 0.0]
        walls = extract_walls(points, self._sigma)
        covs = walls.covs + self._wall_cov
        rows = self._associate(walls, covs)
        new = [k for k in np.argsort(-walls.lengths) if rows[k] == NEW]
        number = {k: ekf.next_id + i for i, k in enumerate(new)}  # the longest first
        names = tuple(ekf.ids[row] if row >= 0 else number.get(k) for k, row in enumerate(rows))
        # Each covariance in the name, (r, alpha) or (-r, alpha + pi), that its landmark has.
        alpha, known = walls.lines[:, 1].copy(), rows >= 0
        alpha[known] = ekf.sensor.observe(ekf.pose, ekf.landmarks[rows[known]])[:, 1]
        innovation = ekf.update(walls.lines, names, in_name_of(walls.lines[:, 1], alpha, covs))
        self._extend(names, walls.ends)
        for id in ekf.prune(self._patience, max(self._confirm - 1, 1)):
            del self._spans[id]
        return WallSighting(walls, names, float(innovation.nis))

    def _associate(self, walls: Walls, covs: Array) -> NDArray[np.intp]:
        """Row (k,) of the only line inside the gate; left out if two fit, new if none does."""
        distances = self._distances(walls, covs)
        inside = distances < self._gate
        # A new wall must lie well outside every gate, or it would be an old one's double.
        new = ~(distances < 4 * self._gate).any(1) & (walls.lengths >= self._min_length)
        rows = np.where(new, NEW, IGNORED)
        # One wall of the map may be seen in several pieces: only the longest counts.
        for k in np.argsort(-walls.lengths):
            if inside[k].sum() == 1 and inside[k].argmax() not in rows:
                rows[k] = inside[k].argmax()
        return rows

    def _distances(self, walls: Walls, covs: Array) -> Array:
        """Squared Mahalanobis distance of each wall seen from each of the map, (k, n)."""
        ekf = self.filter
        predicted = ekf.sensor.observe(ekf.pose, ekf.landmarks)
        v = ekf.sensor.residual(walls.lines[:, None], predicted[None])
        own = ekf.innovation_covs(np.arange(ekf.n_landmarks)) - ekf.sensor.cov
        S = own[None] + in_name_of(walls.lines[:, None, 1], predicted[None, :, 1], covs[:, None])
        return np.asarray((v * np.linalg.solve(S, v[..., None])[..., 0]).sum(-1))

    def _extend(self, names: tuple[Hashable | None, ...], ends: Array) -> None:
        """Note which stretches of the walls were seen."""
        ekf, used = self.filter, [k for k, id in enumerate(names) if id is not None]
        if not used:
            return
        ids = [names[k] for k in used]
        alpha = ekf.landmarks[ekf.rows_of(ids), 1]
        along = np.stack([-np.sin(alpha), np.cos(alpha)], -1)
        world = transform(ekf.pose, ends[used].reshape(-1, 2) + [self._lidar.offset, 0.0])
        places = (world.reshape(-1, 2, 2) * along[:, None]).sum(-1)
        spans = np.rint(np.sort(places) / _BIN).astype(int)
        for id, span in zip(ids, spans.tolist(), strict=True):
            self._spans.setdefault(id, []).append(span)

    def _observed_intervals(self, id: Hashable) -> Array:
        """Where the wall was seen often enough, (k, 2) along it: a grazing scan errs at its ends.

        Often is as often as a wall must be seen, and a twentieth of what its best bin was.
        """
        low, high = np.transpose(self._spans[id])
        first = low.min()
        steps = np.zeros(high.max() - first + 1, int)
        np.add.at(steps, low - first, 1)
        np.add.at(steps, high - first, -1)
        counts = steps.cumsum()
        bins = first + np.flatnonzero(counts >= max(self._confirm, 0.05 * counts.max()))
        cuts = np.flatnonzero(np.diff(bins) > _JOIN / _BIN)
        if len(bins) == 0:
            return np.empty((0, 2))
        return _BIN * np.stack([bins[np.r_[0, cuts + 1]], bins[np.r_[cuts, -1]] + 1], -1)
