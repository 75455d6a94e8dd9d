"""Which landmark was measured? Many particles at once, each with its own map.

Maximum likelihood within a gate, or an association of EKF-SLAM asked for every particle. Landmarks
out of reach of every particle are passed over. Used by FastSLAM (chapters 11 and 12).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_associations
from slamlab.gaussian import inverse_2x2
from slamlab.models import LandmarkSensor
from slamlab.slam._landmark_maps import ABSENT, LandmarkMaps, unpacked
from slamlab.slam._particle_view import ParticleView
from slamlab.slam.association import IGNORED, NEW

__all__ = ["Associate", "Query", "ask", "log_density_at", "most_likely"]

Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]
Associate = Callable[..., ArrayLike]


class Query(NamedTuple):
    """Measurements z (k, 2) of covariances R (k, 2, 2), from poses (M, 3), before these maps.

    With `sqrt_cov` A (M, 3, q) the poses have the covariance A A^T. `given`: R is not that of the
    sensor.
    """

    maps: LandmarkMaps
    sensor: LandmarkSensor
    poses: Array
    sqrt_cov: Array | None
    z: Array
    R: Array
    given: bool = False


def most_likely(query: Query, gate: float) -> Indices:
    """Give each measurement its most likely landmark within the gate, the best pair first.

    Parameters
    ----------
    query : Query
    gate : float
        Largest squared Mahalanobis distance of a pair.

    Returns
    -------
    ndarray of int, shape (M, k)
        Column of the particle's map; `NEW` if all landmarks are beyond twice the gate, `IGNORED`
        in between, or if the landmark is taken. No column comes twice for one particle.
    """
    M, k = len(query.poses), len(query.z)
    scores, columns = [np.zeros((M, k, 0))], [np.zeros(0, np.intp)]
    near = np.zeros((M, k), bool)
    for first, fields in query.maps.blocks() if k else ():
        means, P, log_odds = unpacked(fields, query.poses)
        present = log_odds > ABSENT
        some = _in_reach(query, means, P, present, 2 * gate)
        if some.any():
            score, close = _scores(query, means[:, some], P[:, some], present[:, some], gate)
            scores.append(score)
            columns.append(first + np.flatnonzero(some))
            near |= close
    chosen = _best_first(np.concatenate(scores, 2), np.concatenate(columns))
    # Too far to be a landmark of the map, too near to be another one.
    return np.where((chosen == NEW) & near, IGNORED, chosen)


def ask(query: Query, associate: Associate) -> Indices:
    """Ask `associate` for every particle; the result is that of `most_likely`."""
    columns = np.empty((len(query.poses), len(query.z)), np.intp)
    more = {"covs": query.R} if query.given else {}
    for i in range(len(columns)):
        cov = (
            np.zeros((3, 3)) if query.sqrt_cov is None else query.sqrt_cov[i] @ query.sqrt_cov[i].T
        )
        view = ParticleView.of(i, query.maps, query.poses[i].copy(), cov, query.sensor)
        rows = as_associations(associate(view, query.z, **more), len(query.z), view.n_landmarks)
        named = rows[rows >= 0]
        if len(np.unique(named)) < len(named):
            raise ValueError(f"associate: expected each landmark once, got {rows.tolist()}")
        columns[i] = np.append(query.maps.present(i), [IGNORED, NEW])[rows]
    return columns


def log_density_at(gate: float, R: Array) -> Array:
    """Log density (k,) at the edge of the gate, for measurements that nothing explains."""
    return -0.5 * gate - 0.5 * np.log(np.linalg.det(R)) - np.log(2 * np.pi)


def _scores(
    query: Query, means: Array, P: Array, present: Bools, gate: float
) -> tuple[Array, Bools]:
    """Log densities (M, k, n), -inf outside the gate; and who is within twice the gate (M, k)."""
    sensor, poses = query.sensor, query.poses[:, None]
    predicted, (H_pose, H) = sensor.observe(poses, means), sensor.jacobians(poses, means)
    spread = H @ P @ H.mT
    if query.sqrt_cov is not None:
        by_noise = H_pose @ query.sqrt_cov[:, None]
        spread = spread + by_noise @ by_noise.mT
    (M, n), k = present.shape, len(query.z)
    score, near = np.empty((M, k, n)), np.empty((M, k), bool)
    for j in range(k):
        v, S = sensor.residual(query.z[j], predicted), spread + query.R[j]
        S_inv, det = inverse_2x2(S)
        with np.errstate(over="ignore", invalid="ignore"):
            d2 = np.where(present, np.einsum("...i,...ij,...j", v, S_inv, v), np.inf)
        log_density = -0.5 * d2 - 0.5 * np.log(det) - np.log(2 * np.pi)
        score[:, j] = np.where(d2 <= gate, log_density, -np.inf)
        near[:, j] = (d2 <= 2 * gate).any(1)
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


def _in_reach(query: Query, means: Array, P: Array, present: Bools, gate: float) -> Bools:
    """Tell which columns (n,) hold a landmark that could pass the gate for some particle.

    The squared distance of a pair is at least that of the distance alone, whose variance is at
    most trace R + trace P + (1 + L^2) |A|^2, L from the body to the sensor or farther.
    """
    reach = float(np.max(query.sensor.reach(query.z)))
    if not np.isfinite(reach):
        return np.asarray(present.any(0))
    spread = 0.0 if query.sqrt_cov is None else float((query.sqrt_cov**2).sum((1, 2)).max())
    noise = float(np.trace(query.R, axis1=1, axis2=2).max())
    variance = noise + np.trace(P, axis1=2, axis2=3) + (1 + reach**2) * spread
    d2 = ((means - query.poses[:, None, :2]) ** 2).sum(-1)
    return np.asarray((present & (d2 <= (reach + np.sqrt(gate * variance)) ** 2)).any(0))
