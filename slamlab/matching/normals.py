"""Normals of a scan: which way the walls look on which its points lie; and thinning the points.

A line through each point's neighbours by total least squares, as in chapter 07. Point-to-line ICP
needs them (chapter 14); page 14b derives how far noise turns them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from slamlab._checks import Array, as_array, as_instance, as_scalar, as_tuple
from slamlab.matching.match import finite_points

__all__ = ["PointsWithNormals", "estimate_normals", "voxel_downsample"]

Rows = NDArray[np.intp]

# Thinning has a number for each square of an area with at most so many a side.
MOST_SQUARES = 2000


def voxel_downsample(points: ArrayLike, spacing: float = 0.1) -> Array:
    """Keep one point in every square of `spacing` (m), so that the near wall does not win.

    A lidar lays thirty times as many points on a wall one metre away as on one thirty metres off.

    Parameters
    ----------
    points : array_like, shape (k, 2)
        Rows with NaN are left out.
    spacing : float, default 0.1

    Returns
    -------
    ndarray, shape (n, 2)
        The first point of each square, in their order.

    Examples
    --------
    >>> voxel_downsample([[0.01, 0.0], [0.02, 0.0], [0.15, 0.0]], spacing=0.1).tolist()
    [[0.01, 0.0], [0.15, 0.0]]
    """
    points = finite_points("points", points, 0)
    spacing = as_scalar("spacing", spacing, 1e-3, 1e6)
    squares, rows = np.floor(points / spacing), np.arange(len(points))
    column, row = (xy - xy.min(initial=np.inf) for xy in squares.T)
    columns = column.max(initial=0.0) + 1
    if max(columns, row.max(initial=0.0)) < MOST_SQUARES:
        square = (row * columns + column).astype(np.intp)
    else:  # too many to count all: only those that are met
        square = np.unique(squares.view(complex), return_inverse=True)[1].ravel()
    first = np.empty(square.max(initial=0) + 1, np.intp)
    first[square[::-1]] = rows[::-1]  # of several rows in one square the last written stays
    return points.compress(first[square] == rows, 0)


@dataclass(frozen=True, eq=False)
class PointsWithNormals:
    """Points on walls, with the direction in which each wall looks.

    Attributes
    ----------
    points : ndarray, shape (k, 2)
        (m).
    normals : ndarray, shape (k, 2)
        Unit vectors across the wall, of either sign; NaN where the neighbours draw no line.
    normal_variances : ndarray, shape (k,)
        Variance of the normal's direction (rad^2), by how far its neighbours lie off the line.
    """

    points: Array
    normals: Array
    normal_variances: Array

    @classmethod
    def estimate(cls, points: ArrayLike) -> PointsWithNormals:
        """Find the walls through points, by total least squares over the five nearest of each.

        The point itself is one of them; three must lie within half a metre. A wall's smaller
        eigenvalue is at most 0.15 of the larger one.

        Parameters
        ----------
        points : array_like, shape (k, 2)
            Rows with NaN are left out.

        Returns
        -------
        PointsWithNormals
        """
        points = finite_points("points", points)
        distance, near = cKDTree(points).query(points, 6, distance_upper_bound=0.5)
        tied = np.flatnonzero(distance[:, 5] < distance[:, 4] + 1e-9)
        if len(tied):
            near[tied] = _earlier_first(points, tied, near[tied])
        near = near[:, :5].T
        here = near < len(points)
        x, y = (here * (x.take(near, mode="clip") - x) for x in points.T.copy())
        count, sum_x, sum_y, xx, xy, yy = np.array([here, x, y, x * x, x * y, y * y]).sum(1)
        xx, xy, yy = xx - sum_x**2 / count, xy - sum_x * sum_y / count, yy - sum_y**2 / count
        half, root = 0.5 * (xx + yy), np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        large, small = half + root, np.maximum(half - root, 0.0)  # the eigenvalues
        on_line = (count >= 3) & (large > 0) & (small <= 0.15 * large)
        angle = np.where(on_line, 0.5 * np.arctan2(2 * xy, xx - yy), np.nan)  # of the larger one
        normals = np.stack([-np.sin(angle), np.cos(angle)], -1)
        # 14b (D): noise s, s^2 = small / (count - 2) across the wall, turns it by s / sqrt(large).
        variances = np.where(on_line, small / np.where(on_line, large * (count - 2), 1.0), 0.0)
        return cls(points, normals, variances)

    def transformed(self, pose: ArrayLike) -> PointsWithNormals:
        """Return the outline, given in the frame of `pose`, in the frame of its parent.

        Parameters
        ----------
        pose : array_like, shape (3,) or (k, 3)
            One pose (m, m, rad), or one for each point.
        """
        pose = as_array("pose", pose, ("...", 3))
        c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        (x, y), (nx, ny) = self.points.T, self.normals.T
        points, normals = np.empty_like(self.points), np.empty_like(self.normals)
        points[:, 0], points[:, 1] = c * x - s * y + pose[..., 0], s * x + c * y + pose[..., 1]
        normals[:, 0], normals[:, 1] = c * nx - s * ny, s * nx + c * ny
        return PointsWithNormals(points, normals, self.normal_variances)

    def on_lines(self) -> PointsWithNormals:
        """Return the outline without the points whose neighbours draw no line."""
        on_wall = np.isfinite(self.normals[:, 0])
        parts = self.points, self.normals, self.normal_variances
        return PointsWithNormals(*(part[on_wall] for part in parts))

    @classmethod
    def concatenated(cls, outlines: Iterable[PointsWithNormals]) -> PointsWithNormals:
        """Several outlines of one frame as one; ValueError if there is none."""
        parts = [
            as_instance("outlines", one, PointsWithNormals)
            for one in as_tuple("outlines", outlines)
        ]
        if not parts:
            raise ValueError("outlines: expected at least one, got none")
        return cls(
            np.concatenate([one.points for one in parts]),
            np.concatenate([one.normals for one in parts]),
            np.concatenate([one.normal_variances for one in parts]),
        )


def _earlier_first(points: Array, rows: Rows, near: Rows) -> Rows:
    """Neighbours (k, 6) of some rows; of two that are as near the earlier one comes first.

    Which of them a tree finds first is chance. Beyond the last row there is none.
    """
    d = points[np.minimum(near, len(points) - 1)] - points[rows, None]
    squares = np.where(near < len(points), (d**2).sum(-1), np.inf)
    return near[np.arange(len(near))[:, None], np.lexsort((near, squares))]


def estimate_normals(points: ArrayLike) -> Array:
    """Return unit vectors across the walls through points (k, 2), NaN off walls.

    Examples
    --------
    >>> wall = np.stack([np.linspace(0, 1, 11), np.full(11, 2.0)], -1)
    >>> abs(estimate_normals(wall)[5]).round(6).tolist()
    [0.0, 1.0]
    """
    return PointsWithNormals.estimate(as_array("points", points, ("k", 2))).normals
