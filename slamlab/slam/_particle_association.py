"""Maximum likelihood association of many particles at once, each with its own map.

Landmarks are read some pages at a time, and those out of reach of every particle are passed over,
so that memory and matrices do not grow with the map. Used by FastSLAM.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array
from slamlab.sensors import RangeBearing
from slamlab.slam._landmark_filters import Landmarks, compare, predict
from slamlab.slam._particle_view import IGNORED, NEW
from slamlab.slam._shared_maps import PAGE, SharedMaps

__all__ = ["most_likely"]

Indices = NDArray[np.intp]

BLOCKS = 16


def most_likely(
    maps: SharedMaps, sensor: Any, poses: Array, root: Array | None, z: Array, gate: float
) -> Indices:
    """Give each measurement its most likely landmark within the gate, the best pair first.

    Parameters
    ----------
    maps : SharedMaps
    sensor : sensor
    poses : ndarray, shape (M, 3)
    root : ndarray, shape (M, 3, q), optional
        The poses have the covariance ``root root^T``.
    z : ndarray, shape (k, 2)
    gate : float
        Largest squared Mahalanobis distance of a pair.

    Returns
    -------
    ndarray of int, shape (M, k)
        Column of the particle's map; `NEW` if all landmarks are beyond twice the gate, `IGNORED`
        in between, or if the landmark is taken. No column comes twice for one particle.
    """
    scores, columns = [np.zeros((len(poses), len(z), 0))], [np.zeros(0, np.intp)]
    near = np.zeros((len(poses), len(z)), bool)
    for first in range(0, maps.table.shape[1], BLOCKS):
        landmarks = Landmarks.read(maps.read_blocks(first, first + BLOCKS), poses)
        some = _in_reach(sensor, poses, root, landmarks, z, 2 * gate)
        if some.any():
            score, close = _scores(sensor, poses, root, landmarks.columns(some), z, gate)
            scores.append(score)
            columns.append(first * PAGE + np.flatnonzero(some))
            near |= close
    chosen = _best_first(np.concatenate(scores, 2), np.concatenate(columns))
    # Too far to be a landmark of the map, too near to be another one.
    return np.where((chosen == NEW) & near, IGNORED, chosen)


def _scores(
    sensor: Any, poses: Array, root: Array | None, landmarks: Landmarks, z: Array, gate: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Log densities (M, k, n), -inf outside the gate; and who is within twice the gate (M, k)."""
    prediction = predict(sensor, poses, landmarks, root)
    M, n = landmarks.x.shape
    score, near = np.empty((M, len(z), n)), np.empty((M, len(z)), bool)
    for j, one in enumerate(z):
        pair = compare(sensor, prediction, one)
        distance = np.where(landmarks.present, pair.distance, np.inf)
        score[:, j] = np.where(distance <= gate, pair.log_density, -np.inf)
        near[:, j] = (distance <= 2 * gate).any(1)
    return score, near


def _best_first(score: Array, columns: Indices) -> Indices:
    """Take the best pair of each particle, strike its row and column, and again."""
    M, k, n = score.shape
    chosen = np.full((M, k), NEW)
    for _ in range(min(k, n)):
        flat = score.reshape(M, -1)
        best = flat.argmax(1)
        row = np.flatnonzero(flat[np.arange(M), best] > -np.inf)
        if len(row) == 0:
            break
        j, i = np.divmod(best[row], n)
        chosen[row, j] = columns[i]
        score[row, j] = -np.inf
        score[row, :, i] = -np.inf
    return chosen


def _in_reach(
    sensor: Any, poses: Array, root: Array | None, landmarks: Landmarks, z: Array, gate: float
) -> NDArray[np.bool_]:
    """Tell which columns (n,) hold a landmark that could pass the gate for some particle.

    A bound for `RangeBearing`: the squared distance of a pair is at least that of its range
    alone, and the variance of a range is at most R + trace S + (1 + L^2) |root|^2.
    """
    if not isinstance(sensor, RangeBearing) or len(z) == 0:
        return np.asarray(landmarks.present.any(0))
    offset = abs(sensor.offset)
    spread = 0.0 if root is None else float((root * root).sum((1, 2)).max())
    variance = sensor.cov[0, 0] + landmarks.cov[0] + landmarks.cov[2] + (1 + offset**2) * spread
    farthest = float(z[:, 0].max()) + offset + np.sqrt(gate * variance)
    dx, dy = landmarks.x - poses[:, :1], landmarks.y - poses[:, 1:2]
    return np.asarray((landmarks.present & (dx * dx + dy * dy <= farthest * farthest)).any(0))
