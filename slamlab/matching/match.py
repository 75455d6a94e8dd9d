"""What a match says: the pose, how sure it is, and how well the points lie. Chapter 14."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_one_covariance, as_shaped, shown

__all__ = ["Match"]

# A direction that the points do not hold at all gets this standard deviation (m; of the heading:
# this at the rim of the scan), so that covariances stay finite.
CAP = 10.0


@dataclass(frozen=True, eq=False)
class Match:
    """A scan laid upon a reference.

    Attributes
    ----------
    pose : ndarray, shape (3,)
        Where the scan lies best (m, m, rad), in the frame of the reference.
    cov : ndarray, shape (3, 3)
        Covariance of that pose. Of a direction that nothing holds, a corridor's length, it says
        so: its standard deviation is large there, at most 10 m.
    score : float
        How well the points lie, 0 to 1: the mean of the field under them (`match_field`,
        `match_correlative`), the mean of their weights (`match_icp`).
    n_points : int
        Points that took part.
    second_peak : float
        Score of the best place elsewhere as a part of `score`; near 1 the place is ambiguous.
        0 if none reaches half of it, NaN if nobody searched.
    rmse : float
        Root mean square of what is left: of 1 - M for fields, in metres across the walls
        for `match_icp`.
    """

    pose: Array
    cov: Array
    score: float
    n_points: int
    second_peak: float = float("nan")
    rmse: float = float("nan")

    @property
    def weakest_direction(self) -> tuple[float, float]:
        """Largest standard deviation of the position (m), and its direction (rad, -pi/2..pi/2]."""
        values, vectors = np.linalg.eigh(self.cov[:2, :2])
        x, y = vectors[:, -1]
        angle = np.arctan2(y, x) if x > 0 or (x == 0 and y > 0) else np.arctan2(-y, -x)
        return float(np.sqrt(max(values[-1], 0.0))), float(angle)


def capped_inverse(H: Array, arm: float) -> Array:
    """Inverse of an information matrix (3, 3); where it holds next to nothing, a large variance.

    `arm` (m) makes the heading comparable with the position: how far out the points lie.
    """
    scale = np.array([1.0, 1.0, 1.0 / max(arm, 1e-3)])
    values, vectors = np.linalg.eigh(scale[:, None] * H * scale)
    inverse = (vectors / np.maximum(values, 1.0 / CAP**2)) @ vectors.T
    return scale[:, None] * inverse * scale


def prior_information(name: str, cov: ArrayLike) -> Array:
    """Information (3, 3) of a guess with this covariance; ValueError if that is singular."""
    try:
        return np.linalg.inv(as_one_covariance(name, cov, 3)).astype(np.float64)
    except np.linalg.LinAlgError as error:
        raise ValueError(f"{name}: expected a regular matrix, got {shown(cov)}") from error


def finite_points(name: str, points: ArrayLike, at_least: int = 1) -> Array:
    """Points (k, 2) without the rows of lost beams; refuses fewer than `at_least`."""
    given = as_shaped(name, points, ("k", 2))
    finite = np.isfinite(given)
    kept = given if finite.all() else given[finite[:, 0] & finite[:, 1]]
    kept = np.array(kept, dtype=np.float64, order="C")
    if len(kept) < at_least:
        raise ValueError(f"{name}: expected at least {at_least} points, got {len(kept)}")
    return kept


def solved(H: Array, g: Array) -> Array | None:
    """H^-1 g (3,); None if the points leave a direction free."""
    try:
        pivots = np.diag(np.linalg.cholesky(H)) ** 2
    except np.linalg.LinAlgError:
        return None
    if (pivots <= 1e-12 * np.diag(H)).any():
        return None
    step: Any = np.linalg.solve(H, g)
    return step
