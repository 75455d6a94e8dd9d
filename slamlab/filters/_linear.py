"""Small pieces of linear algebra that the Gaussian filters share, on stacks of matrices."""

from __future__ import annotations

import numpy as np

from slamlab._checks import Array


def apply(matrix: Array, vector: Array) -> Array:
    """Product of matrices (..., m, n) and vectors (..., n)."""
    return (matrix @ vector[..., None])[..., 0]


def innovation_root(S: Array) -> Array:
    """Lower Cholesky factor of an innovation covariance (..., m, m); a singular S is named."""
    try:
        return np.asarray(np.linalg.cholesky(S))
    except np.linalg.LinAlgError as error:
        raise singular(S) from error


def singular(S: Array) -> ValueError:
    """Make the error for an innovation covariance (..., m, m) that has no Cholesky factor."""
    return ValueError(
        "R: expected an innovation covariance S = H P H^T + R that is positive definite, "
        f"its smallest eigenvalue is {np.linalg.eigvalsh(S)[..., 0].min():.3g}"
    )


def solve_psd(S: Array, B: Array) -> Array:
    """Solve S X = B for a positive definite S (..., m, m); a singular S is named."""
    root = innovation_root(S)
    return np.linalg.solve(root.mT, np.linalg.solve(root, B))
