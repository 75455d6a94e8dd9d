"""Which landmark was measured? Many particles at once, each with its own map.

Maximum likelihood within a gate, or an association of EKF-SLAM asked for every particle. Landmarks
out of reach of every particle are passed over. Used by FastSLAM (chapters 11 and 12).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array
from slamlab.models import LandmarkSensor
from slamlab.slam._landmark_filters import Landmarks, compare, predict
from slamlab.slam._landmark_maps import LandmarkMaps
from slamlab.slam._particle_view import IGNORED, NEW, ParticleView

__all__ = ["Associate", "Seen", "ask", "log_density_at", "most_likely"]

Indices = NDArray[np.intp]
Associate = Callable[..., ArrayLike]


class Seen(NamedTuple):
    """Measurements z (k, 2) of covariances R (k, 2, 2), from poses (M, 3), before these maps.

    With `root` A (M, 3, q) the poses have the covariance A A^T. `told`: R is not the sensor's.
    """

    maps: LandmarkMaps
    sensor: LandmarkSensor
    poses: Array
    root: Array | None
    z: Array
    R: Array
    told: bool = False


def most_likely(seen: Seen, gate: float) -> Indices:
    """Give each measurement its most likely landmark within the gate, the best pair first.

    Parameters
    ----------
    seen : Seen
    gate : float
        Largest squared Mahalanobis distance of a pair.

    Returns
    -------
    ndarray of int, shape (M, k)
        Column of the particle's map; `NEW` if all landmarks are beyond twice the gate, `IGNORED`
        in between, or if the landmark is taken. No column comes twice for one particle.
    """
    M, k = len(seen.poses), len(seen.z)
    scores, columns = [np.zeros((M, k, 0))], [np.zeros(0, np.intp)]
    near = np.zeros((M, k), bool)
    for first, fields in seen.maps.blocks() if k else ():
        landmarks = Landmarks.read(fields, seen.poses)
        some = _in_reach(seen, landmarks, 2 * gate)
        if some.any():
            score, close = _scores(seen, landmarks.columns(some), gate)
            scores.append(score)
            columns.append(first + np.flatnonzero(some))
            near |= close
    chosen = _best_first(np.concatenate(scores, 2), np.concatenate(columns))
    # Too far to be a landmark of the map, too near to be another one.
    return np.where((chosen == NEW) & near, IGNORED, chosen)


def ask(seen: Seen, associate: Associate) -> Indices:
    """Ask `associate` for every particle; the result is that of `most_likely`."""
    columns = np.empty((len(seen.poses), len(seen.z)), np.intp)
    more = {"covs": seen.R} if seen.told else {}
    for i in range(len(columns)):
        cov = np.zeros((3, 3)) if seen.root is None else seen.root[i] @ seen.root[i].T
        view = ParticleView.of(i, seen.maps, seen.poses[i].copy(), cov, seen.sensor)
        rows = np.asarray(associate(view, seen.z, **more))
        _check_rows(rows, len(seen.z), view.n_landmarks)
        columns[i] = np.append(seen.maps.present(i), [IGNORED, NEW])[rows]
    return columns


def log_density_at(gate: float, R: Array) -> Array:
    """Log density (k,) at the edge of the gate, for measurements that nothing explains."""
    return -0.5 * gate - 0.5 * np.log(np.linalg.det(R)) - np.log(2 * np.pi)


def _check_rows(rows: Array, k: int, n: int) -> None:
    """Refuse an answer of `associate` that is no row of the map for every measurement."""
    if rows.shape != (k,) or not np.issubdtype(rows.dtype, np.integer):
        raise ValueError(f"associate: expected {k} rows as whole numbers, got {rows!r}")
    if ((rows < IGNORED) | (rows >= n)).any():
        raise ValueError(f"associate: expected rows from -2 to {n - 1}, got {rows.tolist()}")
    named = rows[rows >= 0]
    if len(np.unique(named)) < len(named):
        raise ValueError(f"associate: expected each landmark once, got {rows.tolist()}")


def _scores(seen: Seen, landmarks: Landmarks, gate: float) -> tuple[Array, NDArray[np.bool_]]:
    """Log densities (M, k, n), -inf outside the gate; and who is within twice the gate (M, k)."""
    prediction = predict(seen.sensor, seen.poses, landmarks, seen.root)
    M, n = landmarks.x.shape
    k = len(seen.z)
    score, near = np.empty((M, k, n)), np.empty((M, k), bool)
    for j in range(k):
        pair = compare(seen.sensor, prediction, seen.z[j], seen.R[j])
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


def _in_reach(seen: Seen, landmarks: Landmarks, gate: float) -> NDArray[np.bool_]:
    """Tell which columns (n,) hold a landmark that could pass the gate for some particle.

    The squared distance of a pair is at least that of the distance alone, whose variance is at
    most trace R + trace S + (1 + L^2) |root|^2, L from the body to the sensor or farther.
    """
    reach = float(np.max(seen.sensor.reach(seen.z)))
    if not np.isfinite(reach):
        return np.asarray(landmarks.present.any(0))
    spread = 0.0 if seen.root is None else float((seen.root * seen.root).sum((1, 2)).max())
    noise = float(np.trace(seen.R, axis1=1, axis2=2).max())
    variance = noise + landmarks.cov[0] + landmarks.cov[2] + (1 + reach**2) * spread
    farthest = reach + np.sqrt(gate * variance)
    dx, dy = landmarks.x - seen.poses[:, :1], landmarks.y - seen.poses[:, 1:2]
    return np.asarray((landmarks.present & (dx * dx + dy * dy <= farthest * farthest)).any(0))
