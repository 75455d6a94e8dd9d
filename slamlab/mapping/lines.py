"""A line through points: total least squares, and the covariance of (r, alpha).

P1 fits lines "by least squares", without a formula; here it is done so that a turn of the robot
changes nothing and the error of (r, alpha) is known. Chapter 07 derives both.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_scalar
from slamlab.geometry import wrap_angle

__all__ = ["fit_line", "line_cov", "point_covs"]


def fit_line(points: ArrayLike) -> Array:
    """Fit a line by total least squares: least squared distance from the points.

    The normal is the direction in which the centred points vary least. In contrast to y = a x + b
    nothing here knows which axis is x: turn the points and the line turns with them.

    Parameters
    ----------
    points : array_like, shape (..., k, 2)
        At least two points (m).

    Returns
    -------
    ndarray, shape (..., 2)
        r (m, not negative) and alpha (rad, in (-pi, pi]).

    Raises
    ------
    ValueError
        If the points scatter alike in all directions, so that no line is better than another.

    Examples
    --------
    >>> fit_line([[0, 1], [1, 1], [2, 1]]).round(6).tolist()
    [1.0, 1.570796]
    """
    points = as_array("points", points, ("...", "k", 2))
    if points.shape[-2] < 2:
        raise ValueError(f"points: expected at least two, got {points.shape[-2]}")
    centre = points.mean(-2)
    d = points - centre[..., None, :]
    skew, spread = (d[..., 0] * d[..., 1]).sum(-1), (d[..., 1] ** 2 - d[..., 0] ** 2).sum(-1)
    if not (np.hypot(skew, spread) > 1e-12 * (d**2).sum((-2, -1))).all():
        raise ValueError("points: expected them to favour a direction, they scatter alike in all")
    # The eigenvector of the scatter matrix to its smaller eigenvalue, in closed form.
    alpha = 0.5 * np.arctan2(0.0 - 2 * skew, spread)
    r = centre[..., 0] * np.cos(alpha) + centre[..., 1] * np.sin(alpha)
    # Of the two names of the line, the one with r >= 0; alpha was in [-pi/2, pi/2].
    alpha = np.where(r < 0, np.where(alpha > 0, alpha - np.pi, alpha + np.pi), alpha)
    return np.stack([np.abs(r), alpha], -1)


def line_cov(points: ArrayLike, covs: ArrayLike) -> Array:
    """Covariance of `fit_line` from the covariances of the points, to first order.

    With t_i the place of a point along the line, e_i its error across it and S = sum (t_i - t)^2:
    d alpha = -sum (t_i - t) e_i / S and d r = mean(e_i) + t d alpha, t the mean of the t_i.

    Parameters
    ----------
    points : array_like, shape (..., k, 2)
        At least two (m).
    covs : array_like, shape (..., k, 2, 2)
        Covariance of each point (m^2); points are independent.

    Returns
    -------
    ndarray, shape (..., 2, 2)
        Covariance of (r, alpha).

    Raises
    ------
    ValueError
        As `fit_line`.

    Examples
    --------
    >>> points = [[2.0, -1.0], [2.0, 0.0], [2.0, 1.0]]
    >>> line_cov(points, 0.01**2 * np.broadcast_to(np.eye(2), (3, 2, 2))).round(7).tolist()
    [[3.33e-05, 0.0], [0.0, 5e-05]]
    """
    points = as_array("points", points, ("...", "k", 2))
    covs = as_array("covs", covs, ("...", points.shape[-2], 2, 2))
    return unchecked_cov(points, covs, fit_line(points)[..., 1])


def point_covs(
    points: ArrayLike,
    sigma_range: float,
    sigma_bearing: float = 0.0,
    *,
    origin: ArrayLike = (0.0, 0.0),
) -> Array:
    """Covariances of the end points of beams, from the noise of range and direction.

    Parameters
    ----------
    points : array_like, shape (..., 2)
        End points (m).
    sigma_range : float
        Standard deviation along the beam (m).
    sigma_bearing : float, default 0.0
        Standard deviation of the direction (rad): across the beam it grows with the range.
    origin : array_like, shape (2,), default (0, 0)
        Where the sensor stands (m).

    Returns
    -------
    ndarray, shape (..., 2, 2)

    Examples
    --------
    >>> point_covs([[2.0, 0.0]], sigma_range=0.01, sigma_bearing=0.02).round(6).tolist()
    [[[0.0001, 0.0], [0.0, 0.0016]]]
    """
    beam = as_array("points", points, ("...", 2)) - as_array("origin", origin, (2,))
    sigma_range = as_scalar("sigma_range", sigma_range, 0, 1e300)
    sigma_bearing = as_scalar("sigma_bearing", sigma_bearing, 0, 1e300)
    squared = (beam**2).sum(-1)[..., None, None]
    ray = np.einsum("...i,...j->...ij", beam, beam) / np.where(squared > 0, squared, 1.0)
    side = np.stack([-beam[..., 1], beam[..., 0]], -1)
    side = np.einsum("...i,...j->...ij", side, side)
    # C = sigma_range^2 u u^T + sigma_bearing^2 rho^2 v v^T, u along the beam, v across.
    return sigma_range**2 * ray + sigma_bearing**2 * side


# Without checks, for the many short pieces of a scan.


def unchecked_fit(points: Array) -> tuple[float, float]:
    """`fit_line` of one short array (k, 2), without checks; r may be negative."""
    mx, my = (points.sum(0) / len(points)).tolist()
    x, y = points[:, 0] - mx, points[:, 1] - my
    alpha = 0.5 * math.atan2(-2 * float(x @ y), float(y @ y) - float(x @ x))
    return mx * math.cos(alpha) + my * math.sin(alpha), alpha


def unchecked_cov(points: Array, covs: Array, alpha: float | Array) -> Array:
    """`line_cov` for a line already fitted."""
    alpha = np.asarray(alpha)[..., None]
    c, s = np.cos(alpha), np.sin(alpha)
    # Variance of each point across the wall: n^T C n.
    variances = c * c * covs[..., 0, 0] + 2 * c * s * covs[..., 0, 1] + s * s * covs[..., 1, 1]
    t, k = along(points, alpha), points.shape[-2]
    middle = t.sum(-1, keepdims=True) / k
    off = t - middle
    d = np.empty((*off.shape[:-1], 2, k))
    d[..., 1, :] = d_alpha = -off / (off * off).sum(-1, keepdims=True)
    d[..., 0, :] = 1.0 / k + middle * d_alpha
    return (d * variances[..., None, :]) @ d.mT


def across(points: Array, line: tuple[float, float]) -> Array:
    """Distances of points from a line (r, alpha)."""
    r, alpha = line
    return np.abs(points[:, 0] * math.cos(alpha) + points[:, 1] * math.sin(alpha) - r)


def along(points: Array, alpha: float | Array) -> Array:
    """Places of points along a line with normal direction alpha."""
    return points[..., 1] * np.cos(alpha) - points[..., 0] * np.sin(alpha)


def on_line(lines: Array, places: Array) -> Array:
    """Points (..., k, 2) of lines (..., 2), r and alpha each, at places (..., k) along them."""
    r, c, s = lines[..., :1], np.cos(lines[..., 1:]), np.sin(lines[..., 1:])
    return np.stack([r * c - places * s, r * s + places * c], -1)


def in_name_of(alpha: ArrayLike, other: ArrayLike, covs: Array) -> Array:
    """Covariances (..., 2, 2) of lines, as they are called by the side of others.

    Where a line is called by its other name (-r, alpha + pi), cov(r, alpha) changes its sign.
    """
    turned = np.abs(wrap_angle(np.subtract(alpha, other))) > np.pi / 2
    return covs * np.where(turned[..., None, None], [[1.0, -1.0], [-1.0, 1.0]], 1.0)
