"""How good a map of walls is: which true walls are in it, and which of its walls are true.

P1 judges its map by eye (figure 4). Precision and recall do it with a number. Chapters 07 and 09.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_scalar, as_shaped
from slamlab.geometry import wrap_angle
from slamlab.sensors import Wall

__all__ = ["WallScores", "line_errors", "seen_lengths", "wall_scores"]


@dataclass(frozen=True, eq=False)
class WallScores:
    """A map of walls beside the true ones.

    Attributes
    ----------
    true : ndarray of bool, shape (k,)
        For each stretch of the map: it lies along one true wall, from end to end.
    covered : ndarray, shape (n,)
        For each true wall the part of its length that stretches of the map lie on, 0 to 1.
    """

    true: NDArray[np.bool_]
    covered: Array

    @property
    def precision(self) -> float:
        """Part of the map's stretches that are true; 1 for an empty map."""
        return float(self.true.mean()) if len(self.true) else 1.0

    def recall(self, expected: ArrayLike, least: float = 0.5) -> float:
        """Part of the walls `expected` (n,) bool of which at least the part `least` is covered."""
        chosen = self.covered[np.asarray(expected, dtype=bool)]
        return float((chosen >= least).mean()) if len(chosen) else 1.0


def wall_scores(found: ArrayLike, walls: ArrayLike, tolerance: float = 0.1) -> WallScores:
    """Compare the stretches of a map with the true walls.

    Parameters
    ----------
    found : array_like, shape (k, 2, 2)
        End points of the map's stretches (m), in the frame of the true walls.
    walls : array_like, shape (n, 2, 2)
        End points of the true walls (m), none without a length.
    tolerance : float, default 0.1
        How far (m) a stretch may lie from a wall, and stick out beyond its ends; not negative.

    Returns
    -------
    WallScores

    Examples
    --------
    >>> scores = wall_scores([[[0, 0.02], [3, 0.01]], [[0, 1], [1, 2]]], [[[0, 0], [4, 0]]])
    >>> scores.true.tolist(), scores.covered.round(3).tolist(), scores.precision
    ([True, False], [0.75], 0.5)
    """
    found, walls = as_array("found", found, ("k", 2, 2)), _as_walls(walls)
    tolerance = as_scalar("tolerance", tolerance, 0.0)
    along, across, lengths = _on_walls(found.reshape(-1, 2), walls)
    along, across = along.reshape(-1, 2, len(walls)), across.reshape(-1, 2, len(walls))
    inside = (along >= -tolerance) & (along <= lengths + tolerance)
    lies_on = np.asarray((inside & (np.abs(across) <= tolerance)).all(1))
    covered = [_covered(along[lies_on[:, j], :, j], length) for j, length in enumerate(lengths)]
    return WallScores(np.asarray(lies_on.any(1)), np.array(covered))


def seen_lengths(points: ArrayLike, walls: ArrayLike, tolerance: float = 0.05) -> Array:
    """Return how much of each wall was ever met by a beam.

    Parameters
    ----------
    points : array_like, shape (k, 2)
        True end points of beams (m); rows with NaN count for nothing.
    walls : array_like, shape (n, 2, 2)
        End points of the true walls (m), none without a length.
    tolerance : float, default 0.05
        How near (m) to a wall a point must lie; not negative.

    Returns
    -------
    ndarray, shape (n,)
        Distance (m) between the outermost points met on each wall, 0 if there is none.

    Examples
    --------
    >>> seen_lengths([[0.0, 0.0], [1.5, 0.01]], [[[0, 0], [2, 0]], [[0, 5], [2, 5]]]).tolist()
    [1.5, 0.0]
    """
    points = as_shaped("points", points, ("k", 2))
    points = points[np.isfinite(points).all(-1)]
    walls, tolerance = _as_walls(walls), as_scalar("tolerance", tolerance, 0.0)
    along, across, lengths = _on_walls(points, walls)
    met = (np.abs(across) <= tolerance) & (along >= -tolerance) & (along <= lengths + tolerance)
    reach = np.where(met, along, np.nan)
    seen = np.zeros(len(walls))
    any_met = met.any(0)
    seen[any_met] = np.nanmax(reach[:, any_met], 0) - np.nanmin(reach[:, any_met], 0)
    return seen


def line_errors(lines: ArrayLike, walls: ArrayLike) -> Array:
    """Return how far each line of a map is from the nearest true wall.

    Parameters
    ----------
    lines : array_like, shape (k, 2)
        Lines (r, alpha) of the map, in the frame of the true walls (m, rad).
    walls : array_like, shape (n, 2, 2)
        End points of the true walls (m), none without a length.

    Returns
    -------
    ndarray, shape (k, 2)
        Errors of r and alpha (m, rad), in the name that the line has. Nearest is the wall with
        the least sum of the error of r and three metres times that of alpha.

    Examples
    --------
    >>> walls = [[[2, -1], [2, 1]], [[0, 3], [4, 3]]]
    >>> (line_errors([[2.01, 0.0]], walls).round(3) + 0.0).tolist()
    [[0.01, 0.0]]
    """
    lines, walls = as_array("lines", lines, ("k", 2)), _as_walls(walls)
    ways = walls[:, 1] - walls[:, 0]
    alpha = np.arctan2(ways[:, 0], -ways[:, 1])
    r = walls[:, 0, 0] * np.cos(alpha) + walls[:, 0, 1] * np.sin(alpha)
    # `residual` keeps the name of its second argument.
    errors = -Wall(1, 1).residual(np.stack([r, wrap_angle(alpha)], -1), lines[:, None])
    nearest = np.abs(errors * [1.0, 3.0]).sum(-1).argmin(1)
    return np.asarray(errors[np.arange(len(lines)), nearest])


def _as_walls(walls: ArrayLike) -> Array:
    walls = as_array("walls", walls, ("n", 2, 2))
    if not (np.hypot(*(walls[:, 1] - walls[:, 0]).T) > 0).all():
        raise ValueError("walls: expected walls with a length, got one without")
    return walls


def _on_walls(points: Array, walls: Array) -> tuple[Array, Array, Array]:
    """Coordinates of points along and across each wall, (k, n) each, and lengths (n,)."""
    ways = walls[:, 1] - walls[:, 0]
    lengths = np.hypot(*ways.T)
    ways = ways / lengths[:, None]
    offsets = points[:, None] - walls[:, 0]
    across = offsets[..., 0] * ways[:, 1] - offsets[..., 1] * ways[:, 0]
    return (offsets * ways).sum(-1), across, lengths


def _covered(spans: Array, length: float) -> float:
    """Part of [0, length] that the spans (k, 2) cover together."""
    total, reached = 0.0, 0.0
    # Sorting starts and ends apart pairs them anew, and covers the same.
    for low, high in np.sort(np.clip(np.sort(spans, 1), 0, length), 0).tolist():
        total += max(0.0, high - max(low, reached))
        reached = max(reached, high)
    return total / length
