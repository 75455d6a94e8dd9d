"""Angles, SE(2) and SE(3): the arithmetic of poses.

Poses of the plane are arrays (..., 3): x, y (metres) and theta (radians) of a body in the world.
Poses of space are homogeneous matrices (..., 4, 4). Used by every chapter; floor 0 of the house.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array

__all__ = [
    "between",
    "compose",
    "inverse",
    "inverse_transform",
    "rotation",
    "se3",
    "se3_exp",
    "se3_inverse",
    "se3_log",
    "se3_transform",
    "so3_exp",
    "so3_log",
    "transform",
    "wrap_angle",
]


def wrap_angle(a: ArrayLike) -> Array:
    """Wrap angles to (-pi, pi].

    Parameters
    ----------
    a : array_like, any shape
        Angles in radians.

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
    angle = np.asarray(a, dtype=np.float64)
    wrapped = np.pi - np.mod(np.pi - angle, 2 * np.pi)
    # An angle already inside keeps its last bit.
    return np.where((angle > -np.pi) & (angle <= np.pi), angle, wrapped)[()]


def rotation(theta: ArrayLike) -> Array:
    """Rotation matrix of the plane, (..., 2, 2), for angles (...) in radians."""
    theta = np.asarray(theta, dtype=np.float64)
    c, s = np.cos(theta), np.sin(theta)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def _rotate(theta: Array, points: Array) -> Array:
    c, s = np.cos(theta), np.sin(theta)
    x, y = points[..., 0], points[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], -1)


def compose(a: ArrayLike, b: ArrayLike) -> Array:
    r"""Pose `b`, given in the frame of `a`, expressed in the frame of `a`'s parent: a (+) b.

    Parameters
    ----------
    a, b : array_like, shape (..., 3)
        Poses x, y (m), theta (rad); leading axes broadcast.

    Returns
    -------
    ndarray, shape (..., 3)

    Raises
    ------
    ValueError
        If a shape is wrong or a number is not finite.

    Examples
    --------
    Two metres forward, a left turn, then one metre forward:

    >>> compose([2, 0, np.pi / 2], [1, 0, 0]).round(3).tolist()
    [2.0, 1.0, 1.571]
    """
    a = as_array("a", a, ("...", 3))
    b = as_array("b", b, ("...", 3))
    position = a[..., :2] + _rotate(a[..., 2], b[..., :2])
    heading = wrap_angle(a[..., 2] + b[..., 2])
    return np.concatenate([position, heading[..., None]], -1)


def inverse(a: ArrayLike) -> Array:
    """Pose of the parent seen from `a`, so that ``compose(a, inverse(a))`` is zero.

    Parameters
    ----------
    a : array_like, shape (..., 3)

    Returns
    -------
    ndarray, shape (..., 3)
    """
    a = as_array("a", a, ("...", 3))
    position = -_rotate(-a[..., 2], a[..., :2])
    return np.concatenate([position, wrap_angle(-a[..., 2])[..., None]], -1)


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
    a = as_array("a", a, ("...", 3))
    b = as_array("b", b, ("...", 3))
    position = _rotate(-a[..., 2], b[..., :2] - a[..., :2])
    heading = wrap_angle(b[..., 2] - a[..., 2])
    return np.concatenate([position, heading[..., None]], -1)


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
    """Points of the world, expressed in the body frame; shapes as in `transform`."""
    pose, points = _pose_and_points(pose, points)
    return _rotate(-pose[..., 2], points - pose[..., :2])


def _pose_and_points(pose: ArrayLike, points: ArrayLike) -> tuple[Array, Array]:
    pose = as_array("pose", pose, ("...", 3))
    points = as_array("points", points, ("...", 2))
    if points.ndim == 1:
        return pose, points
    return pose[..., None, :], points


# Space: rotations and rigid motions as matrices.


def _skew(v: Array) -> Array:
    zero = np.zeros_like(v[..., 0])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def so3_exp(v: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in radians (Rodrigues)."""
    v = as_array("v", v, ("...", 3))
    angle_squared = (v * v).sum(-1)[..., None, None]
    angle = np.sqrt(angle_squared)
    small = angle_squared < 1e-16
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0, np.sin(safe) / safe)
    # (1 - cos x) / x^2 loses its digits for small x; the half-angle form does not.
    second = np.where(small, 0.5, 0.5 * (np.sin(safe / 2) / (safe / 2)) ** 2)
    K = _skew(v)
    return np.eye(3) + first * K + second * (K @ K)


def so3_log(R: ArrayLike) -> Array:
    """Rotation vectors (..., 3), of length in [0, pi], of rotation matrices (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    R = as_array("R", R, ("...", 3, 3))
    return Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(R.shape[:-1])


def se3(R: ArrayLike, t: ArrayLike) -> Array:
    """Homogeneous matrices (..., 4, 4) from rotations (..., 3, 3) and translations (..., 3)."""
    R = as_array("R", R, ("...", 3, 3))
    t = as_array("t", t, ("...", 3))
    lead = np.broadcast_shapes(R.shape[:-2], t.shape[:-1])
    T = np.zeros((*lead, 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = t
    T[..., 3, 3] = 1.0
    return T


def se3_inverse(T: ArrayLike) -> Array:
    """Inverse of rigid motions (..., 4, 4), by the transposed rotation."""
    T = as_array("T", T, ("...", 4, 4))
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return se3(Rt, -(Rt @ T[..., :3, 3:])[..., 0])


def se3_transform(T: ArrayLike, points: ArrayLike) -> Array:
    """Points (..., n, 3) of the body frame expressed in the world, for motions (..., 4, 4)."""
    T = as_array("T", T, ("...", 4, 4))
    points = as_array("points", points, ("...", "n", 3))
    return points @ np.swapaxes(T[..., :3, :3], -1, -2) + T[..., None, :3, 3]


def _left_jacobian(v: Array) -> Array:
    angle_squared = (v * v).sum(-1)[..., None, None]
    small = angle_squared < 1e-8
    safe = np.where(small, 1.0, angle_squared)
    angle = np.sqrt(safe)
    first = np.where(small, 0.5 - angle_squared / 24, 0.5 * (np.sin(angle / 2) / (angle / 2)) ** 2)
    second = np.where(small, 1 / 6 - angle_squared / 120, (angle - np.sin(angle)) / (safe * angle))
    K = _skew(v)
    return np.eye(3) + first * K + second * (K @ K)


def se3_exp(twist: ArrayLike) -> Array:
    """Rigid motions (..., 4, 4) of twists (..., 6): translation part (m), rotation vector."""
    twist = as_array("twist", twist, ("...", 6))
    rho, phi = twist[..., :3], twist[..., 3:]
    return se3(so3_exp(phi), (_left_jacobian(phi) @ rho[..., None])[..., 0])


def se3_log(T: ArrayLike) -> Array:
    """Twists (..., 6) of rigid motions (..., 4, 4); the inverse of `se3_exp`."""
    T = as_array("T", T, ("...", 4, 4))
    phi = so3_log(T[..., :3, :3])
    rho = np.linalg.solve(_left_jacobian(phi), T[..., :3, 3:])[..., 0]
    return np.concatenate([rho, phi], -1)
