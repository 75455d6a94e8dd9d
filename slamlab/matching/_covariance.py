"""Covariance of a match by ICP: the noise of both scans, and which directions the pairs hold.

After Censi, "An accurate closed-form estimate of ICP's covariance", ICRA 2007. Page 14b shows what
each part of it is for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array
from slamlab.matching.match import CAP
from slamlab.matching.normals import PointsWithNormals

# A direction whose information comes from fewer pairs than this is held by nothing.
FEW = 3.0


def covariance(
    walls: PointsWithNormals, j: NDArray[np.int64], arms: Array, e: Array, J: Array, w: Array,
    H: Array, width: float, reach: float,
) -> Array:  # fmt: skip
    """A^-1 (s^2 / 2 N) A^-1: half of the error's variance is the scan's, half the reference's.

    N is what unit noise of the points and of the reference, whose points j (n,) serve several
    pairs, puts into J^T w e. A is H = J^T w J without what noise of the normals pretends. Nothing
    holds an axis along which that is half of H or more, or whose information comes from fewer
    than `FEW` pairs, any of which may be a wrong one: its standard deviation is CAP. Pairs count
    as (sum h)^2 / sum h^2. `arms` (n, 2) are R p, and `reach` (m) is how far out points lie.
    """
    (n, d), s2 = e.shape, error_variance(e, w, width)
    same = (j[:, None] == j).astype(float)
    N = sum(A.T @ (A + same @ A) for A in (w[:, None, None] * J).swapaxes(0, 1))
    (nx, ny), (x, y) = walls.normals[j].T, arms.T
    turned = np.array([-ny, nx, nx * x + ny * y]).T  # dJ by the normal's angle
    blur = ((w * walls.normal_variances[j])[:, None] * turned).T @ turned
    # Heading counts as metres at the rim of the scan.
    scale = np.array([1.0, 1.0, 1.0 / max(reach, 1e-3)])
    values, axes = np.linalg.eigh(scale[:, None] * H * scale)
    axes = scale[:, None] * axes  # across these H is diagonal
    # Information of each pair along each axis.
    h = w[:, None] * ((J.reshape(-1, 3) @ axes) ** 2).reshape(n, d, 3).sum(1)
    crowded = values**2 >= FEW * (h**2).sum(0)
    pretended = axes.T @ blur @ axes
    A = np.diag(values) - pretended
    held = (A.diagonal() > np.maximum(pretended.diagonal(), s2 / CAP**2)) & crowded
    tight, loose = axes[:, held], CAP * axes[:, ~held]
    gain = tight @ np.linalg.inv(A[held][:, held]) @ tight.T
    cov = 0.5 * s2 * gain @ N @ gain + loose @ loose.T
    return 0.5 * (cov + cov.T)


def error_variance(e: Array, w: Array, width: float) -> float:
    """Variance s^2 of errors (n, d), as a robust fit feels it (Huber): E[psi^2] / E[psi']^2.

    psi = w e, and d numbers make an error.
    """
    (n, d), e2 = e.shape, (e**2).sum(1)
    slope = w @ ((width**2 - 3 * e2) / (width**2 + e2)) / w.sum()
    s2 = w**2 @ e2 / (w @ w) / max(slope, 0.2) ** 2 / d
    return max(s2 * n / max(n - 3, 1), 1e-8)
