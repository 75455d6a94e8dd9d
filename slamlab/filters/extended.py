"""Extended Kalman filter: the mean through the function, the covariance through its tangent.

P5 (10)-(13), P2 (6)-(11). The iterated update is a Gauss-Newton search for the peak of the
posterior (Bell and Cathey 1993). Chapter 03.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_count, as_covariance, as_function, as_positive
from slamlab.filters.kalman import Innovation, _belief, correct
from slamlab.gaussian import Gaussian, as_belief

__all__ = ["numerical_jacobian", "predict", "update"]

Function = Callable[[Array], ArrayLike]
Residual = Callable[[Array, Array], ArrayLike]


def predict(belief: Gaussian, f: Function, F: ArrayLike | Function, Q: ArrayLike) -> Gaussian:
    """Move a belief through the motion x' = f(x) + w, w ~ N(0, Q).

    Parameters
    ----------
    belief : Gaussian
        State of dimension n.
    f : callable
        ``f(x) -> (n,)``, the control inside.
    F : array_like, shape (n, n), or callable
        Jacobian of f at the mean, or ``F(x)``.
    Q : array_like, shape (n, n)
        Covariance of the motion noise, already in the state's coordinates (F_u V F_u^T).

    Returns
    -------
    Gaussian

    Examples
    --------
    >>> turn = lambda x: x + [np.cos(x[2]), np.sin(x[2]), 0.0]
    >>> slopes = lambda x: [[1, 0, -np.sin(x[2])], [0, 1, np.cos(x[2])], [0, 0, 1]]
    >>> belief = predict(Gaussian([0, 0, 0], 0.01 * np.eye(3)), turn, slopes, np.zeros((3, 3)))
    >>> belief.mean.tolist(), belief.cov.round(3).tolist()
    ([1.0, 0.0, 0.0], [[0.01, 0.0, 0.0], [0.0, 0.02, 0.01], [0.0, 0.01, 0.01]])
    """
    n, f = as_belief("belief", belief).dim, as_function("f", f)
    # (12): the tangent at the estimate before the step
    F = as_array("F", F(belief.mean) if callable(F) else F, (n, n))
    Q = as_covariance("Q", Q, n)
    # (10): mean
    mean = as_array("f(x)", f(belief.mean), (n,))
    # (4): covariance
    return _belief(mean, F @ belief.cov @ F.T + Q)


def update(
    belief: Gaussian,
    z: ArrayLike,
    h: Function,
    H: ArrayLike | Function,
    R: ArrayLike,
    residual: Residual = np.subtract,
    iterations: int = 1,
) -> tuple[Gaussian, Innovation]:
    """Correct a belief by the measurement z = h(x) + v, v ~ N(0, R).

    Parameters
    ----------
    belief : Gaussian
        State of dimension n.
    z : array_like, shape (m,)
        Measurement.
    h : callable
        ``h(x) -> (m,)``, the predicted measurement.
    H : callable, or array_like of shape (m, n)
        ``H(x)``, Jacobian of h; an array serves for one iteration.
    R : array_like, shape (m, m)
        Covariance of the measurement noise.
    residual : callable, default numpy.subtract
        ``residual(z, predicted) -> (m,)``; wraps the angles among the measurements.
    iterations : int, default 1
        How often h is linearised anew where the last step led. The measurement counts once.

    Returns
    -------
    Gaussian
        The corrected belief. Angles in the state are not wrapped.
    Innovation
        Of the last linearisation: the residual is z - h(x_i) - H_i (x - x_i), x the prediction.

    Raises
    ------
    ValueError
        If the innovation covariance is singular.

    Examples
    --------
    >>> distance = lambda x: [np.hypot(x[0], x[1])]
    >>> slope = lambda x: [x / np.hypot(x[0], x[1])]
    >>> belief, _ = update(Gaussian([3.0, 4.0], np.eye(2)), [6.0], distance, slope, [[1.0]])
    >>> belief.mean.round(3).tolist()
    [3.3, 4.4]
    """
    z = as_array("z", z, ("m",))
    n, m = as_belief("belief", belief).dim, len(z)
    h, residual = as_function("h", h), as_function("residual", residual)
    x = belief.mean
    for _ in range(as_count("iterations", iterations, 1)):
        # (13): the tangent at the best estimate so far
        tangent = as_array("H", H(x) if callable(H) else H, (m, n))
        # (11): innovation; seen from the prediction, where prior and measurement meet
        gap = as_array("h(x)", residual(z, as_array("h(x)", h(x), (m,))), (m,))
        gap = gap - tangent @ (belief.mean - x)
        # (6)-(9), always from the prediction: an iteration corrects the step, not the belief
        posterior, learned = correct(belief, gap, tangent, R)
        x = posterior.mean
    return posterior, learned


def numerical_jacobian(f: Function, x: ArrayLike, step: float = 1e-6) -> Array:
    """Jacobian by central differences: for checking a formula, not for use in its place.

    Parameters
    ----------
    f : callable
        ``f(x) -> (m,)``; smooth around x (an angle that jumps there spoils the difference).
    x : array_like, shape (n,)
    step : float, default 1e-6
        How far from x the differences reach, positive.

    Returns
    -------
    ndarray, shape (m, n)

    Examples
    --------
    >>> numerical_jacobian(lambda x: [x[0] * x[1], x[0] ** 2], [2.0, 3.0]).round(6).tolist()
    [[3.0, 2.0], [4.0, 0.0]]
    """
    x, f = as_array("x", x, ("n",)), as_function("f", f)
    if not len(x):
        raise ValueError("x: expected at least one number, got none")
    step = as_positive("step", step, 1e300)
    columns = [
        (as_array("f(x)", f(x + d), ("m",)) - as_array("f(x)", f(x - d), ("m",))) / (2 * step)
        for d in step * np.eye(len(x))
    ]
    return np.stack(columns, -1)
