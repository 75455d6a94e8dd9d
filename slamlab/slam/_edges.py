"""The error of an edge of a pose graph, its Jacobians, and what it adds to the normal equations.

Grisetti et al. 2010, "A tutorial on graph-based SLAM", (30) to (33); error as in g2o.
The public functions read as the formulas; `Edges` does the same for all edges at speed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array
from slamlab.geometry import wrap_angle

__all__ = ["edge_error", "edge_jacobians"]


def edge_error(pose_i: ArrayLike, pose_j: ArrayLike, measurement: ArrayLike) -> Array:
    """Error of measured relative poses, in the frame of the measurement (Grisetti 2010 (30)).

    Parameters
    ----------
    pose_i, pose_j : array_like, shape (..., 3)
        Poses x, y (m), theta (rad) in one common frame.
    measurement : array_like, shape (..., 3)
        Pose of j seen from i, as measured.

    Returns
    -------
    ndarray, shape (..., 3)
        R_z^T (R_i^T (t_j - t_i) - t_z) and the angle theta_j - theta_i - theta_z in (-pi, pi].
        Zero where the measurement fits.

    Raises
    ------
    ValueError
        If a shape is wrong or a number is not finite.

    Examples
    --------
    >>> edge_error([0, 0, 0], [1, 0, 0], [0.9, 0, 0.3]).round(3).tolist()
    [0.096, -0.03, -0.3]
    """
    pose_i = as_array("pose_i", pose_i, ("...", 3))
    pose_j = as_array("pose_j", pose_j, ("...", 3))
    z = as_array("measurement", measurement, ("...", 3))
    # R_i^T (t_j - t_i) - t_z
    seen = _turned_back(pose_i[..., 2], pose_j[..., :2] - pose_i[..., :2]) - z[..., :2]
    angle = wrap_angle(pose_j[..., 2] - pose_i[..., 2] - z[..., 2])
    return np.concatenate([_turned_back(z[..., 2], seen), angle[..., None]], -1)


def _turned_back(angle: Array, v: Array) -> Array:
    # R(angle)^T v
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * v[..., 0] + s * v[..., 1], -s * v[..., 0] + c * v[..., 1]], -1)


def edge_jacobians(
    pose_i: ArrayLike, pose_j: ArrayLike, measurement: ArrayLike
) -> tuple[Array, Array]:
    """Jacobians of `edge_error` by both poses (Grisetti 2010 (32), (33)).

    Parameters
    ----------
    pose_i, pose_j, measurement : array_like, shape (..., 3)
        As in `edge_error`.

    Returns
    -------
    A, B : ndarray, shape (..., 3, 3)
        d e / d pose_i and d e / d pose_j.

    Raises
    ------
    ValueError
        If a shape is wrong or a number is not finite.

    Examples
    --------
    >>> A, B = edge_jacobians([0, 0, 0], [1, 0, 0], [1, 0, 0])
    >>> A.tolist()
    [[-1.0, -0.0, 0.0], [0.0, -1.0, -1.0], [-0.0, -0.0, -1.0]]
    """
    pose_i = as_array("pose_i", pose_i, ("...", 3))
    pose_j = as_array("pose_j", pose_j, ("...", 3))
    z = as_array("measurement", measurement, ("...", 3))
    phi = pose_i[..., 2] + z[..., 2]
    d = pose_j[..., :2] - pose_i[..., :2]
    c, s = np.cos(phi), np.sin(phi)
    B = np.zeros((*np.broadcast_shapes(phi.shape, d.shape[:-1]), 3, 3))
    # d e / d t_j = R_z^T R_i^T
    B[..., 0, 0], B[..., 0, 1] = c, s
    B[..., 1, 0], B[..., 1, 1] = -s, c
    B[..., 2, 2] = 1.0
    A = -B
    # d e / d theta_i = R_z^T (d R_i / d theta)^T (t_j - t_i)
    A[..., 0, 2] = -s * d[..., 0] + c * d[..., 1]
    A[..., 1, 2] = -c * d[..., 0] - s * d[..., 1]
    return A, B


# The blocks of one edge, entry by entry, as rows of the stack that `Edges.blocks` makes:
# 0..5 are W_xx W_xy W_xt W_yy W_yt W_tt, 6..8 are v, 9 is h; from 10 the first nine with a minus.
_W = [[0, 1, 2], [1, 3, 4], [2, 4, 5]]
_H_JJ = np.array(_W)
_H_II = np.array([[0, 1, 6], [1, 3, 7], [6, 7, 9]])
_H_IJ = 10 + np.array([_W[0], _W[1], [6, 7, 8]])
_PLACES = np.stack([_H_II, _H_JJ, _H_IJ, _H_IJ.T])


class Edges:
    """All edges of a graph, one array a component: what each adds to cost, gradient and H.

    With d = t_j - t_i and m = (-d_y, d_x) the first Jacobian is A = -B M, where M is the identity
    with m above its last corner. So with W = B^T Omega B an edge adds
    H_jj = W, H_ij = -M^T W and H_ii = M^T W M: ten numbers instead of three products.

    Parameters
    ----------
    edges : ndarray of int, shape (m, 2)
    measurements : ndarray, shape (m, 3)
    information : ndarray, shape (m, 3, 3)
    """

    def __init__(self, edges: np.ndarray, measurements: Array, information: Array) -> None:
        self.i, self.j = np.ascontiguousarray(edges.T)
        self.z_angle = measurements[:, 2].copy()
        # R_z^T t_z never changes.
        self.z = np.ascontiguousarray(_turned_back(self.z_angle, measurements[:, :2]).T)
        upper = information[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        self.information = np.ascontiguousarray(upper.T)
        self._parts = np.empty((19, len(edges)))
        self._blocks = np.empty((4, 3, 3, len(edges)))

    def linearise(self, poses: Array) -> Array:
        """Move to `poses` (n, 3); return e^T Omega e of all edges, shape (m,)."""
        x, y, theta = np.ascontiguousarray(poses.T)
        self.n = len(poses)
        phi = theta[self.i] + self.z_angle
        self.c, self.s = c, s = np.cos(phi), np.sin(phi)
        self.dx, self.dy = dx, dy = x[self.j] - x[self.i], y[self.j] - y[self.i]
        ex = c * dx + s * dy - self.z[0]
        ey = c * dy - s * dx - self.z[1]
        et = wrap_angle(theta[self.j] - phi)
        xx, xy, xt, yy, yt, tt = self.information
        # Omega e
        self.force = fx, fy, ft = (
            xx * ex + xy * ey + xt * et,
            xy * ex + yy * ey + yt * et,
            xt * ex + yt * ey + tt * et,
        )
        # Rounding may leave an edge of singular information a hair below zero.
        return np.maximum(ex * fx + ey * fy + et * ft, 0.0)

    def trace(self) -> float:
        """Sum of the diagonals of all information matrices."""
        return float(self.information[[0, 3, 5]].sum())

    def log_information(self) -> Array:
        """Logarithm of the determinant of each information matrix, shape (m,)."""
        full = np.moveaxis(self.information[_H_JJ], -1, 0)
        return np.linalg.slogdet(full)[1]

    def gradient(self, weights: Array | None = None) -> Array:
        """J^T Omega e, shape (n, 3); edges count with their `weights` (m,)."""
        fx, fy, ft = self.force
        if weights is not None:
            fx, fy, ft = fx * weights, fy * weights, ft * weights
        # q = B^T Omega e, and A^T Omega e = -M^T q
        qx, qy = self.c * fx - self.s * fy, self.s * fx + self.c * fy
        lever = self.dx * qy - self.dy * qx + ft
        at_j, at_i = (qx, qy, ft), (qx, qy, lever)
        return np.column_stack(
            [
                np.bincount(self.j, a, self.n) - np.bincount(self.i, b, self.n)
                for a, b in zip(at_j, at_i, strict=True)
            ]
        )

    def blocks(self, weights: Array | None = None) -> Array:
        """H_ii, H_jj, H_ij and H_ji of all edges, shape (4, 3, 3, m); the next call reuses it."""
        xx, xy, xt, yy, yt, tt = (
            self.information if weights is None else self.information * weights
        )
        c, s, dx, dy = self.c, self.s, self.dx, self.dy
        parts = self._parts
        # W = B^T Omega B: the information, turned into the world
        mixed = 2 * c * s * xy
        parts[0] = c * c * xx - mixed + s * s * yy
        parts[1] = c * s * (xx - yy) + (c * c - s * s) * xy
        parts[2] = c * xt - s * yt
        parts[3] = s * s * xx + mixed + c * c * yy
        parts[4] = s * xt + c * yt
        parts[5] = tt
        # v = last row of M^T W, and the last corner of M^T W M
        parts[6] = dx * parts[1] - dy * parts[0] + parts[2]
        parts[7] = dx * parts[3] - dy * parts[1] + parts[4]
        parts[8] = dx * parts[4] - dy * parts[2] + tt
        parts[9] = dx * parts[7] - dy * parts[6] + parts[8]
        np.negative(parts[:9], out=parts[10:])
        return np.take(parts, _PLACES, axis=0, out=self._blocks, mode="clip")
