"""Unscented Kalman filter: a few points through the function instead of its tangent.

Julier and Uhlmann (2004), scaled as van der Merwe (2004). For comparison with the extended
filter; chapter 03.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_covariance, as_function, as_scalar
from slamlab.filters.kalman import Innovation, _belief, innovation, kalman_gain
from slamlab.gaussian import Gaussian, as_belief

__all__ = ["predict", "sigma_points", "update"]

Function = Callable[[Array], ArrayLike]
Residual = Callable[[Array, Array], ArrayLike]


def sigma_points(
    belief: Gaussian, alpha: float = 0.5, beta: float = 2.0, kappa: float = 0.0
) -> tuple[Array, Array, Array]:
    """Points and weights that carry the mean and covariance of a belief.

    Parameters
    ----------
    belief : Gaussian
        State of dimension n, positive definite.
    alpha : float, default 0.5
        Spread of the points around the mean, in (0, 1].
    beta : float, default 2.0
        Knowledge about the distribution; 2 is best for a Gaussian.
    kappa : float, default 0.0
        Second scale; n + kappa must be positive.

    Returns
    -------
    points : ndarray, shape (2 n + 1, n)
        The mean first.
    mean_weights, cov_weights : ndarray, shape (2 n + 1,)

    Examples
    --------
    >>> points, weights, _ = sigma_points(Gaussian([1.0], [[4.0]]), alpha=1.0)
    >>> points.tolist(), weights.tolist()
    ([[1.0], [3.0], [-1.0]], [0.0, 0.5, 0.5])
    """
    n = as_belief("belief", belief).dim
    alpha = as_scalar("alpha", alpha, 1e-9, 1.0)
    kappa, beta = as_scalar("kappa", kappa, -n + 1e-9, 1e9), as_scalar("beta", beta, -1e9, 1e9)
    scale = alpha**2 * (n + kappa)
    try:
        root = np.linalg.cholesky(belief.cov) * np.sqrt(scale)
    except np.linalg.LinAlgError as error:
        raise ValueError("belief: expected a positive definite covariance") from error
    points = np.concatenate([belief.mean[None], belief.mean + root.T, belief.mean - root.T])
    mean_weights = np.full(2 * n + 1, 0.5 / scale)
    mean_weights[0] = 1 - n / scale
    cov_weights = mean_weights.copy()
    cov_weights[0] += 1 - alpha**2 + beta
    return points, mean_weights, cov_weights


def predict(belief: Gaussian, f: Function, Q: ArrayLike, **scaling: float) -> Gaussian:
    """Move a belief through x' = f(x) + w, w ~ N(0, Q), by sigma points.

    Parameters
    ----------
    belief : Gaussian
    f : callable
        ``f(x) -> (n,)``.
    Q : array_like, shape (n, n)
    **scaling : float
        As in `sigma_points`.

    Returns
    -------
    Gaussian

    Examples
    --------
    >>> square = lambda x: x**2
    >>> belief = predict(Gaussian([1.0], [[4.0]]), square, [[0.0]], alpha=1.0)
    >>> belief.mean.round(6).tolist()  # 1 + 4: the linearised mean would be 1
    [5.0]
    """
    Q, f = as_covariance("Q", Q, as_belief("belief", belief).dim), as_function("f", f)
    points, w_mean, w_cov = sigma_points(belief, **scaling)
    moved = as_array("f(x)", np.array([f(x) for x in points]), (len(points), belief.dim))
    mean = w_mean @ moved
    d = moved - mean
    return _belief(mean, (d * w_cov[:, None]).T @ d + Q)


def update(
    belief: Gaussian,
    z: ArrayLike,
    h: Function,
    R: ArrayLike,
    residual: Residual = np.subtract,
    **scaling: float,
) -> tuple[Gaussian, Innovation]:
    """Correct a belief by z = h(x) + v, v ~ N(0, R), by sigma points.

    Parameters
    ----------
    belief : Gaussian
    z : array_like, shape (m,)
    h : callable
        ``h(x) -> (m,)``.
    R : array_like, shape (m, m)
    residual : callable, default numpy.subtract
        ``residual(z, predicted) -> (m,)``; wraps the angles among the measurements. The predicted
        mean is taken around the prediction of the central point, so that angles do not tear.
    **scaling : float
        As in `sigma_points`.

    Returns
    -------
    Gaussian
    Innovation

    Examples
    --------
    >>> belief, innovation = update(Gaussian([0.0], [[1.0]]), [1.0], lambda x: x, [[1.0]])
    >>> belief.mean.round(6).tolist(), belief.cov.round(6).tolist()
    ([0.5], [[0.5]])
    """
    z = as_array("z", z, ("m",))
    R = as_covariance("R", R, len(z))
    h, residual = as_function("h", h), as_function("residual", residual)
    points, w_mean, w_cov = sigma_points(belief, **scaling)
    seen = as_array("h(x)", np.array([h(x) for x in points]), (len(points), len(z)))
    around = np.array([residual(s, seen[0]) for s in seen], dtype=float)
    center = w_mean @ around
    d_z, d_x = around - center, points - belief.mean
    S = (d_z * w_cov[:, None]).T @ d_z + R
    cross = (d_x * w_cov[:, None]).T @ d_z
    K = kalman_gain(S, cross.T)
    gap = np.asarray(residual(z, seen[0]), dtype=float) - center
    cov = belief.cov - K @ S @ K.T
    return _belief(belief.mean + K @ gap, cov), innovation(gap, S, K)
