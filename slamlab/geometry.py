"""Angles and rigid motions of the plane, SE(2): the arithmetic of poses.

A pose is an array (..., 3): x, y (metres) and theta (radians) of a body in the world. Used by
every chapter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_batch, as_shaped

__all__ = [
    "between",
    "compose",
    "inverse",
    "inverse_transform",
    "rotation",
    "tilt",
    "transform",
    "wrap_angle",
]


def wrap_angle(a: ArrayLike) -> Array:
    """Wrap angles to (-pi, pi].

    Parameters
    ----------
    a : array_like, any shape
        Angles in radians, not infinite; NaN, a missing one, stays NaN.

    Returns
    -------
    ndarray, same shape
        The equal angles in (-pi, pi].

    Examples
    --------
    >>> float(wrap_angle(-np.pi)) == np.pi
    True
    >>> wrap_angle([0.5, 2 * np.pi + 0.5]).round(12).tolist()
    [0.5, 0.5]
    """
    if isinstance(a, float) and -np.pi < a < np.pi:
        return np.float64(a)
    angle = as_shaped("a", a).astype(np.float64, copy=False)
    # An angle already inside keeps its last bit.
    inside = np.abs(angle) < np.pi
    if np.count_nonzero(inside) == inside.size:
        return angle.copy()[()]
    if np.isinf(angle).any():
        raise ValueError("a: expected angles (rad), got infinity")
    return np.where(inside, angle, np.pi - np.mod(np.pi - angle, 2 * np.pi))[()]


def rotation(theta: ArrayLike) -> Array:
    """Rotation matrix of the plane, (..., 2, 2), for angles (...) in radians.

    Examples
    --------
    >>> (rotation(np.pi / 2) @ [1.0, 0.0]).round(3).tolist()
    [0.0, 1.0]
    """
    theta = as_array("theta", theta)
    R = np.empty((*theta.shape, 2, 2))
    R[..., 0, 0] = R[..., 1, 1] = np.cos(theta)
    R[..., 1, 0] = np.sin(theta)
    R[..., 0, 1] = -R[..., 1, 0]
    return R


def tilt(roll: ArrayLike, pitch: ArrayLike) -> Array:
    """Rotation (..., 3, 3) of a flying body against its level frame: R_y(pitch) R_x(roll).

    Axes ahead, left and up. Applied to what the body measured it gives the coordinates in a frame
    that is level and has the heading of the body. Chapter 16.

    Parameters
    ----------
    roll, pitch : array_like, shape (...)
        Right wing down, and nose down (rad); leading axes broadcast.

    Examples
    --------
    Nose straight down, the tree ahead of the nose stands below the aircraft:

    >>> (tilt(0.0, np.pi / 2) @ [5.0, 0.0, 0.0]).round(6).tolist()
    [0.0, 0.0, -5.0]
    """
    roll, pitch = as_array("roll", roll), as_array("pitch", pitch)
    lead = as_batch("pitch", pitch.shape, roll.shape)
    c, s = np.cos(roll), np.sin(roll)
    C, S = np.cos(pitch), np.sin(pitch)
    R = np.zeros((*lead, 3, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = C, S * s, S * c
    R[..., 1, 1], R[..., 1, 2] = c, -s
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = -S, C * s, C * c
    return R


def _rotate(theta: Array, points: Array) -> Array:
    c, s = np.cos(theta), np.sin(theta)
    x, y = points[..., 0], points[..., 1]
    ahead = c * x - s * y
    out = np.empty((*ahead.shape, 2))
    out[..., 0], out[..., 1] = ahead, s * x + c * y
    return out


def compose(a: ArrayLike, b: ArrayLike) -> Array:
    r"""Pose `b`, given in the frame of `a`, expressed in the frame of `a`'s parent: a (+) b.

    Parameters
    ----------
    a, b : array_like, shape (..., 3)
        Poses x, y (m), theta (rad); leading axes broadcast.

    Returns
    -------
    ndarray, shape (..., 3)

    Examples
    --------
    Two metres forward, a left turn, then one metre forward:

    >>> compose([2, 0, np.pi / 2], [1, 0, 0]).round(3).tolist()
    [2.0, 1.0, 1.571]
    """
    a, b = _two_poses(a, b)
    return _pose(a[..., :2] + _rotate(a[..., 2], b[..., :2]), a[..., 2] + b[..., 2])


def _pose(position: Array, heading: Array) -> Array:
    pose = np.empty((*heading.shape, 3))
    pose[..., :2], pose[..., 2] = position, wrap_angle(heading)
    return pose


def _two_poses(a: ArrayLike, b: ArrayLike) -> tuple[Array, Array]:
    a, b = as_array("a", a, ("...", 3)), as_array("b", b, ("...", 3))
    as_batch("b", b.shape[:-1], a.shape[:-1])
    return a, b


def inverse(a: ArrayLike) -> Array:
    """Pose of the parent seen from `a`, so that ``compose(a, inverse(a))`` is zero.

    Parameters
    ----------
    a : array_like, shape (..., 3)

    Returns
    -------
    ndarray, shape (..., 3)

    Examples
    --------
    >>> compose([1.0, 2.0, 0.5], inverse([1.0, 2.0, 0.5])).round(12).tolist()
    [0.0, 0.0, 0.0]
    """
    a = as_array("a", a, ("...", 3))
    return _pose(-_rotate(-a[..., 2], a[..., :2]), -a[..., 2])


def between(a: ArrayLike, b: ArrayLike) -> Array:
    """Pose of `b` seen from `a`: ``compose(a, between(a, b))`` is `b`.

    Parameters
    ----------
    a, b : array_like, shape (..., 3)
        Poses in one common frame; leading axes broadcast.

    Returns
    -------
    ndarray, shape (..., 3)

    Examples
    --------
    >>> between([1, 1, np.pi / 2], [1, 3, np.pi / 2]).round(12).tolist()
    [2.0, 0.0, 0.0]
    """
    a, b = _two_poses(a, b)
    return _pose(_rotate(-a[..., 2], b[..., :2] - a[..., :2]), b[..., 2] - a[..., 2])


def transform(pose: ArrayLike, points: ArrayLike) -> Array:
    """Points given in the body frame, expressed in the world.

    Parameters
    ----------
    pose : array_like, shape (..., 3)
        One pose for each set of points.
    points : array_like, shape (..., n, 2)
        Points in the frame of the body (m). A single point (2,) is taken with a single pose (3,).

    Returns
    -------
    ndarray, shape of `points` with the leading axes of `pose`

    Examples
    --------
    >>> transform([1, 2, np.pi / 2], [[1, 0], [0, 1]]).round(12).tolist()
    [[1.0, 3.0], [0.0, 2.0]]
    """
    pose, points = _pose_and_points(pose, points)
    return pose[..., :2] + _rotate(pose[..., 2], points)


def inverse_transform(pose: ArrayLike, points: ArrayLike) -> Array:
    """Points of the world, expressed in the body frame; shapes as in `transform`.

    Examples
    --------
    >>> inverse_transform([1.0, 0.0, np.pi / 2], [[1.0, 3.0]]).round(3).tolist()
    [[3.0, 0.0]]
    """
    pose, points = _pose_and_points(pose, points)
    return _rotate(-pose[..., 2], points - pose[..., :2])


def _pose_and_points(pose: ArrayLike, points: ArrayLike) -> tuple[Array, Array]:
    pose = as_array("pose", pose, ("...", 3))
    points = as_array("points", points, ("...", 2))
    if points.ndim == 1 and pose.ndim == 1:
        return pose, points
    if points.ndim == 1:
        raise ValueError(f"points: expected shape (..., n, 2) for many poses, got {points.shape}")
    as_batch("points", points.shape[:-2], pose.shape[:-1])
    return pose[..., None, :], points
