"""Points laid upon points, or upon the lines through them: ICP.

Besl and McKay 1992; point to line: Censi, ICRA 2008; gate and weights: Vizzo et al., RA-L 2023
(KISS-ICP); covariance after Censi, ICRA 2007. Chapter 14.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import (
    Array,
    as_array,
    as_choice,
    as_count,
    as_instance,
    as_scalar,
    as_tuple,
)
from slamlab.geometry import wrap_angle
from slamlab.matching._match import CAP, Match, capped_inverse, finite_points

__all__ = ["PointsWithNormals", "match_icp", "estimate_normals", "voxel_downsample"]

# A direction whose information comes from fewer pairs than this is held by nothing.
FEW = 3.0


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
    from slamlab.kernels.icp import thinned

    points = finite_points("points", points, 0)
    spacing = as_scalar("spacing", spacing, 1e-3, 1e6)
    return points.take(thinned(points, spacing), 0)


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
        from slamlab.kernels.icp import hashed, lines_through

        points = finite_points("points", points)
        return cls(points, *lines_through(points, hashed(points, 0.5), 5, 0.5, 0.15))

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
        points = np.stack([c * x - s * y + pose[..., 0], s * x + c * y + pose[..., 1]], -1)
        return PointsWithNormals(
            points, np.stack([c * nx - s * ny, s * nx + c * ny], -1), self.normal_variances
        )

    def on_lines(self) -> PointsWithNormals:
        """Return the outline without the points whose neighbours draw no line."""
        on_wall = np.isfinite(self.normals[:, 0])
        if on_wall.all():
            return self
        rows = np.flatnonzero(on_wall)
        return PointsWithNormals(
            *(one.take(rows, 0) for one in (self.points, self.normals, self.normal_variances))
        )

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


def estimate_normals(points: ArrayLike) -> Array:
    """Return unit vectors across the walls through points (k, 2), NaN off walls.

    Examples
    --------
    >>> wall = np.stack([np.linspace(0, 1, 11), np.full(11, 2.0)], -1)
    >>> abs(estimate_normals(wall)[5]).round(6).tolist()
    [0.0, 1.0]
    """
    return PointsWithNormals.estimate(as_array("points", points, ("k", 2))).normals


def match_icp(
    reference: ArrayLike | PointsWithNormals,
    points: ArrayLike,
    guess: ArrayLike,
    metric: str = "line",
    width: float = 0.05,
    gate: float = 0.5,
    fine_gate: float = 0.2,
    n_iterations: int = 15,
) -> Match:
    """Lay points upon a reference: pair with the nearest, step, again.

    Parameters
    ----------
    reference : array_like, shape (m, 2), or PointsWithNormals
        Points of the map (m); a `PointsWithNormals` brings its normals along.
    points : array_like, shape (k, 2)
        The scan in the frame of the body (m); rows with NaN are left out.
    guess : array_like, shape (3,)
        Where to begin (m, m, rad).
    metric : {"line", "point"}
        Error of a pair: its distance across the wall, n . (R p + t - q), or all of R p + t - q.
    width : float, default 0.05
        From this error (m) on a pair counts for less: weight (width^2 / (width^2 + e^2))^2.
    gate : float, default 0.5
        Farther neighbours (m) are no pairs, until the pose rests;
    fine_gate : float, default 0.2
        then the same with this gate (never more than `gate`).
    n_iterations : int, default 15
        Rounds at most, for each gate.

    Returns
    -------
    Match
        `cov` holds the noise of scan and reference, both estimated from what is left of the
        errors; information along a wall that only the noise of its normals pretends is taken
        off, and a direction that fewer than three pairs would hold is held by none.
        `score` is the sum of the weights over the number of points; 0 if fewer than three
        pairs were found: then the pose is the guess and `cov` large.

    Raises
    ------
    ValueError
        If fewer than three points, or reference points on walls, are there, or an argument is
        out of range.

    Examples
    --------
    >>> x, y = np.linspace(0, 3, 61), np.linspace(0, 2, 41)
    >>> corner = np.vstack([np.stack([x, 0 * x], -1), np.stack([0 * y, y], -1)])
    >>> from slamlab.geometry import inverse_transform
    >>> scan = inverse_transform([0.1, 0.05, 0.02], corner)
    >>> match_icp(corner, scan, guess=[0, 0, 0]).pose.round(3).tolist()
    [0.1, 0.05, 0.02]
    """
    from slamlab.kernels import icp as kernels

    line = as_choice("metric", metric, ["line", "point"]) == "line"
    base = _reference(reference, line)
    points = finite_points("points", points, 3)
    guess = as_array("guess", guess, (3,)).astype(np.float64)
    width = as_scalar("width", width, 1e-6, 1e6)
    gate = as_scalar("gate", gate, 1e-6, 1e6)
    fine_gate = min(as_scalar("fine_gate", fine_gate, 1e-6, 1e6), gate)
    rounds = as_count("n_iterations", n_iterations, 1)
    gates = np.array([gate, fine_gate])
    hashes = kernels.hashed(base.points, 0.5 * gate)
    pose, pair = guess.copy(), np.full(len(points), -1)
    held = kernels.iterate(
        base.points, base.normals, hashes, points, pose, width, gates, rounds, line, pair
    )
    arm = float(np.sqrt((points**2).sum(1).mean()))
    if not held or not np.isfinite(pose).all():
        return Match(guess, capped_inverse(np.zeros((3, 3)), arm), 0.0, 0)
    H, g = np.empty((3, 3)), np.empty(3)
    noise, blur, shares = np.empty((3, 3)), np.empty((3, 3)), np.empty((2, 3))
    total, squares, count, weights2, psi2, slope = kernels.icp_equations(
        base.points, base.normals, points, pose, pair, width, line, H, g
    )
    # Heading counts as metres at the rim of the scan.
    scale = np.array([1.0, 1.0, 1.0 / max(arm, 1e-3)])
    axes = scale[:, None] * np.linalg.eigh(scale[:, None] * H * scale)[1]
    kernels.noise_of(
        *(base.points, base.normals, base.normal_variances, points, pose, pair, width, line),
        *(axes, noise, blur, shares),
    )
    # Variance of an error, as a robust fit feels it (Huber): E[psi^2] / E[psi']^2.
    s2 = psi2 / weights2 / max(slope / total, 0.2) ** 2 / (1 if line else 2)
    s2 = max(s2 * count / max(count - 3, 1.0), 1e-8)
    pose[2] = wrap_angle(pose[2])
    return Match(
        pose,
        _covariance(axes, H, noise, blur, shares, s2),
        total / len(points),
        int(count),
        rmse=float(np.sqrt(squares / total)),
    )


def _covariance(
    axes: Array, H: Array, noise: Array, blur: Array, shares: Array, s2: float
) -> Array:
    """A^-1 (s^2 / 2 N) A^-1: half of the error's variance is the scan's, half the reference's.

    A is H without what noise of the normals pretends. Nothing holds an axis along which that is
    half of H or more, or whose information comes from fewer than `FEW` pairs, any of which may
    be a wrong one: its standard deviation is CAP. Pairs count as (sum h)^2 / sum h^2.
    """
    A, pretended = axes.T @ (H - blur) @ axes, axes.T @ blur @ axes
    crowded = shares[0] ** 2 >= FEW * shares[1]
    held = (np.diag(A) > np.maximum(np.diag(pretended), s2 / CAP**2)) & crowded
    tight, loose = axes[:, held], CAP * axes[:, ~held]
    gain = tight @ np.linalg.inv(A[held][:, held]) @ tight.T
    cov = 0.5 * s2 * gain @ noise @ gain + loose @ loose.T
    return 0.5 * (cov + cov.T)


def _reference(reference: ArrayLike | PointsWithNormals, line: bool) -> PointsWithNormals:
    """Outline of the reference: for lines only the points on walls."""
    if not isinstance(reference, PointsWithNormals):
        if line:
            reference = PointsWithNormals.estimate(reference)
        else:
            points = finite_points("reference", reference, 3)
            reference = PointsWithNormals(points, np.zeros_like(points), np.zeros(len(points)))
    if not line:
        return reference
    walls = reference.on_lines()
    n = len(walls.points)
    if n < 3:
        raise ValueError(f"reference: expected at least 3 points on walls, got {n}")
    return walls
