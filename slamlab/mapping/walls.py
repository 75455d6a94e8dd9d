"""Walls of one scan: its straight pieces, pieces of one wall joined, points off the wall dropped.

P1 leaves this to "a separate discussion". Chapter 07 has it step by step; chapter 09 feeds the
wall sensor with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_choice, as_count, as_positive, as_scalar, as_shaped
from slamlab.mapping._split_and_merge import straight_pieces
from slamlab.mapping.lines import (
    across,
    along,
    fit_line,
    in_name_of,
    on_line,
    point_covs,
    unchecked_cov,
    unchecked_fit,
)
from slamlab.sensors.wall import Wall

__all__ = ["Walls", "extract_walls"]

Indices = NDArray[np.intp]

# Two pieces are one wall if their (r, alpha) differ by less than this: chi-square, 2 dof, 99.9 %.
_SAME_LINE = 13.816
# What tells lines apart; its noise does not matter.
_SENSOR = Wall(1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Walls:
    """Walls found in one scan, in the frame of its points.

    Attributes
    ----------
    lines : ndarray, shape (n, 2)
        r (m, not negative) and alpha (rad, in (-pi, pi]) of each wall: the line
        x cos(alpha) + y sin(alpha) = r.
    covs : ndarray, shape (n, 2, 2)
        Covariance of each (r, alpha).
    ends : ndarray, shape (n, 2, 2)
        Both ends of each wall (m): the outermost of its points, dropped onto the line.
    labels : ndarray of int, shape (k,)
        For each point of the scan the row of its wall, -1 for none.
    """

    lines: Array
    covs: Array
    ends: Array
    labels: Indices

    def __len__(self) -> int:
        """Return the number of walls."""
        return len(self.lines)

    @property
    def lengths(self) -> Array:
        """Distance between the ends of each wall (m), shape (n,)."""
        return np.hypot(*(self.ends[:, 1] - self.ends[:, 0]).T)


def extract_walls(
    points: ArrayLike,
    sigma_range: float,
    sigma_bearing: float = 0.0,
    *,
    method: str = "split-and-merge",
    threshold: float = 0.08,
    max_gap: float = 0.5,
    min_points: int = 8,
    min_length: float = 0.5,
    origin: ArrayLike = (0.0, 0.0),
) -> Walls:
    """Find the straight walls in one scan.

    Parameters
    ----------
    points : array_like, shape (k, 2)
        End points of the beams in scan order (m), in any frame; a row with NaN is a beam without
        return. For measurements of a `Wall` sensor give them in the frame of the sensor.
    sigma_range : float
        Standard deviation of a range (m), positive.
    sigma_bearing : float, default 0.0
        Standard deviation of the direction of a beam (rad).
    method : {"split-and-merge", "incremental"}
        Cut the scan where it leaves a line the most, or grow a line point by point.
    threshold : float, default 0.08
        Largest distance of a point from its wall (m). Four times the noise of a point or more.
    max_gap : float, default 0.5
        Pieces of one line are joined across at most this much without points (m); inf joins
        them across everything, as suits landmarks that are lines without end.
    min_points : int, default 8
        Fewer points make no wall, and no piece of one; at least 4.
    min_length : float, default 0.5
        A shorter wall is dropped (m).
    origin : array_like, shape (2,), default (0, 0)
        Where the sensor stands in the frame of the points (m).

    Returns
    -------
    Walls
        In the order of their first points.

    Examples
    --------
    A corner of two walls, x = 2 and y = 1, seen from the origin:

    >>> y, x = np.linspace(-1, 1, 41), np.linspace(2, 0, 41)
    >>> corner = np.concatenate([np.stack([np.full(41, 2.0), y], -1),
    ...                          np.stack([x, np.full(41, 1.0)], -1)])
    >>> extract_walls(corner, sigma_range=0.01).lines.round(6).tolist()
    [[2.0, 0.0], [1.0, 1.570796]]
    """
    points = as_shaped("points", points, ("k", 2)).astype(float)
    sigma_range = as_positive("sigma_range", sigma_range, 1e300)
    method = as_choice("method", method, ("split-and-merge", "incremental"))
    threshold = as_positive("threshold", threshold, 1e300)
    max_gap = as_scalar("max_gap", max_gap, 0)
    min_points = as_count("min_points", min_points, 4)
    min_length = as_scalar("min_length", min_length, 0, 1e300)
    origin = as_array("origin", origin, (2,))

    valid = np.flatnonzero(np.isfinite(points).all(-1))
    seen = points[valid]
    covs = point_covs(seen, sigma_range, sigma_bearing, origin=origin)
    pieces = straight_pieces(seen, valid, origin, method, threshold, max_gap, min_points)
    pieces = _join(seen, covs, pieces, threshold, max_gap)
    cleaned = [_without_outliers(seen[p], covs[p], p, threshold) for p in pieces]
    pieces = [p for p, length in cleaned if len(p) >= min_points and length >= min_length]
    return _walls(seen, covs, sorted(pieces, key=lambda p: int(p[0])), valid, len(points))


def _join(
    points: Array, covs: Array, pieces: list[Indices], threshold: float, max_gap: float
) -> list[Indices]:
    """Join pieces of one line that something cut apart, the most alike first."""
    fits = [_fit_and_cov(points[p], covs[p]) for p in pieces if len(pieces) > 1]
    while len(pieces) > 1:
        for i, j in _alike(fits):
            both = np.sort(np.concatenate([pieces[i], pieces[j]]))
            line, cov = _fit_and_cov(points[both], covs[both])
            one, two = (along(points[pieces[k]], line[1]) for k in (i, j))
            gap = max(one.min() - two.max(), two.min() - one.max())
            if gap <= max_gap and across(points[both], line).max() <= threshold:
                break
        else:
            return pieces
        others = [k for k in range(len(pieces)) if k not in (i, j)]
        pieces = [*(pieces[k] for k in others), both]
        fits = [*(fits[k] for k in others), (line, cov)]
    return pieces


def _fit_and_cov(points: Array, covs: Array) -> tuple[tuple[float, float], Array]:
    """Line (r, alpha) of a piece and its covariance."""
    line = unchecked_fit(points)
    return line, unchecked_cov(points, covs, line[1])


def _alike(fits: list[tuple[tuple[float, float], Array]]) -> Iterator[tuple[int, int]]:
    """Pairs of pieces whose lines agree within their covariances, the most alike first."""
    lines, line_covs = (np.array(every) for every in zip(*fits, strict=True))
    i, j = np.triu_indices(len(fits), 1)
    difference = _SENSOR.residual(lines[i], lines[j])
    total = in_name_of(lines[i, 1], lines[j, 1], line_covs[i]) + line_covs[j]
    squared = (difference * np.linalg.solve(total, difference[..., None])[..., 0]).sum(-1)
    for k in np.argsort(squared):
        if squared[k] > _SAME_LINE:
            return
        yield int(i[k]), int(j[k])


def _without_outliers(
    points: Array, covs: Array, piece: Indices, threshold: float
) -> tuple[Indices, float]:
    """Drop points that their noise does not explain, the worst first; all of them if many are.

    Returns what is left, and how far it reaches along its line.
    """
    kept = np.ones(len(piece), dtype=bool)
    while True:
        r, alpha = unchecked_fit(points[kept])
        normal = np.array([math.cos(alpha), math.sin(alpha)])
        # Noise across the wall: a range read wrong along a grazing beam hardly leaves it.
        noise = np.sqrt(np.einsum("i,kij,j->k", normal, covs, normal))
        off = np.abs(points @ normal - r) / np.maximum(4 * noise, 0.3 * threshold)
        worst = int(np.argmax(np.where(kept, off, 0.0)))
        if off[worst] <= 1:
            return piece[kept], float(np.ptp(along(points[kept], alpha)))
        kept[worst] = False
        if kept.sum() < max(4, 0.75 * len(piece)):
            return piece[:0], 0.0


def _walls(
    points: Array, covs: Array, pieces: list[Indices], valid: Indices, n_points: int
) -> Walls:
    """Fit each piece anew and put the result together."""
    labels, n = np.full(n_points, -1), len(pieces)
    lines, line_covs, ends = np.empty((n, 2)), np.empty((n, 2, 2)), np.empty((n, 2))
    for row, piece in enumerate(pieces):
        labels[valid[piece]] = row
        lines[row] = fit_line(points[piece])
        line_covs[row] = unchecked_cov(points[piece], covs[piece], lines[row, 1])
        places = along(points[piece], lines[row, 1])
        ends[row] = places.min(), places.max()
    return Walls(lines, line_covs, on_line(lines, ends), labels)
