"""Checks of chapter 02: predict, update and Joseph's form of the Kalman filter.

P5 (3), (4), (7)-(9).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._report import Report, run_cases

__all__ = [
    "MISTAKES_JOSEPH",
    "MISTAKES_PREDICT",
    "MISTAKES_UPDATE",
    "check_joseph",
    "check_predict",
    "check_update",
    "joseph",
    "predict",
    "update",
]

Function = Callable[..., Any]
Belief = tuple[Array, Array]

_MEAN = [1.0, -2.0]
_COV = [[2.0, 0.5], [0.5, 1.0]]
_F = [[1.0, 0.5], [0.0, 0.9]]
_Q = [[0.1, 0.02], [0.02, 0.3]]


# Exercise 1: predict.


def predict(mean: Array, cov: Array, F: Array, Q: Array) -> Belief:
    """Mean (n,) and covariance (n, n) after the motion, P5 (3), (4)."""
    return F @ mean, F @ cov @ F.T + Q


MISTAKES_PREDICT: dict[str, Function] = {
    "F P F is no covariance: the second F must be transposed": (
        lambda m, P, F, Q: (F @ m, F @ P @ F + Q)
    ),
    "the transposed F stands on the wrong side: F P F^T is due": (
        lambda m, P, F, Q: (F @ m, F.T @ P @ F + Q)
    ),
    "Q is missing: every motion adds uncertainty": lambda m, P, F, Q: (F @ m, F @ P @ F.T),
    "Q went through the motion too: it is added after it": (
        lambda m, P, F, Q: (F @ m, F @ (P + Q) @ F.T)
    ),
    "Q was added twice": lambda m, P, F, Q: (F @ m, F @ P @ F.T + 2 * Q),
    "Q was subtracted: predicting never makes the belief sharper": (
        lambda m, P, F, Q: (F @ m, F @ P @ F.T - Q)
    ),
    "the mean did not move": lambda m, P, F, Q: (m, F @ P @ F.T + Q),
    "the mean was moved by the transposed F": lambda m, P, F, Q: (F.T @ m, F @ P @ F.T + Q),
    "the belief was predicted twice": (lambda m, P, F, Q: predict(*predict(m, P, F, Q), F, Q)),
}


def check_predict(student: Function) -> Report:
    """Check ``student(mean (n,), cov (n, n), F (n, n), Q (n, n)) -> mean, cov``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    zero = [[0.0, 0.0], [0.0, 0.0]]
    cases = [
        (
            "a known position with an unsure speed",
            [0, 1],
            [[0, 0], [0, 1]],
            [[1, 2], [0, 1]],
            zero,
        ),
        ("motion noise alone", _MEAN, zero, _F, _Q),
        ("a general belief", _MEAN, _COV, _F, _Q),
        ("one dimension", [3.0], [[2.0]], [[0.5]], [[0.1]]),
    ]
    return run_cases("predict", student, predict, cases, MISTAKES_PREDICT)


# Exercise 2: update.


def update(mean: Array, cov: Array, z: Array, H: Array, R: Array) -> Belief:
    """Mean (n,) and covariance (n, n) after the measurement, P5 (5)-(9)."""
    K = _gain(cov, H, R)
    return mean + K @ (z - H @ mean), (np.eye(len(mean)) - K @ H) @ cov


def _gain(cov: Array, H: Array, R: Array) -> Array:
    return cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R)


def _with_gain(gain: Function) -> Function:
    def wrong(mean: Array, cov: Array, z: Array, H: Array, R: Array) -> Belief:
        K = gain(cov, H, R)
        return mean + K @ (z - H @ mean), (np.eye(len(mean)) - K @ H) @ cov

    return wrong


MISTAKES_UPDATE: dict[str, Function] = {
    "this is the transposed gain: K is n x m, P H^T S^-1": _with_gain(
        lambda P, H, R: _gain(P, H, R).T
    ),
    "R must not be added to the gain, as P1 prints (34)": _with_gain(
        lambda P, H, R: _gain(P, H, R) + R
    ),
    "R is missing in S: the sensor is not perfect": _with_gain(
        lambda P, H, R: P @ H.T @ np.linalg.inv(H @ P @ H.T)
    ),
    "the innovation has the wrong sign: measured minus predicted": (
        lambda m, P, z, H, R: (m - _gain(P, H, R) @ (z - H @ m), update(m, P, z, H, R)[1])
    ),
    "the prediction H x is missing in the innovation": (
        lambda m, P, z, H, R: (m + _gain(P, H, R) @ z, update(m, P, z, H, R)[1])
    ),
    "the covariance did not shrink: (I - K H) P is due": (
        lambda m, P, z, H, R: (update(m, P, z, H, R)[0], P)
    ),
    "the covariance grew: (I + K H) P instead of (I - K H) P": (
        lambda m, P, z, H, R: (
            update(m, P, z, H, R)[0],
            (np.eye(len(m)) + _gain(P, H, R) @ H) @ P,
        )
    ),
    "the measurement was counted twice": (
        lambda m, P, z, H, R: update(*update(m, P, z, H, R), z, H, R)
    ),
}


def check_update(student: Function) -> Report:
    """Check ``student(mean (n,), cov (n, n), z (m,), H (m, n), R (m, m)) -> mean, cov``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    both = [[1.0, 0.3], [-0.2, 1.0]]
    cases = [
        ("prior and sensor equally sure", [0.0], [[1.0]], [1.0], [[1.0]], [[1.0]]),
        ("two sensors at once", _MEAN, _COV, [0.5, -1.0], both, [[0.5, 0.1], [0.1, 0.4]]),
        ("a sensor that hardly knows", _MEAN, _COV, [3.0, 2.0], both, [[50, 0], [0, 80]]),
    ]
    return run_cases("update", student, update, cases, MISTAKES_UPDATE)


# Exercise 3: Joseph's form.


def joseph(cov: Array, K: Array, H: Array, R: Array) -> Array:
    """Covariance (n, n) after an update with any gain K (n, m)."""
    A = np.eye(len(cov)) - K @ H
    return A @ cov @ A.T + K @ R @ K.T


MISTAKES_JOSEPH: dict[str, Function] = {
    "this is the short form (I - K H) P: right for the optimal gain only": (
        lambda P, K, H, R: (np.eye(len(P)) - K @ H) @ P
    ),
    "the noise of the sensor is missing: K R K^T must be added": (
        lambda P, K, H, R: joseph(P, K, H, R) - K @ R @ K.T
    ),
    "the second factor must be transposed: A P A^T": (
        lambda P, K, H, R: (np.eye(len(P)) - K @ H) @ P @ (np.eye(len(P)) - K @ H) + K @ R @ K.T
    ),
    "K R K^T must be added, not subtracted": (
        lambda P, K, H, R: joseph(P, K, H, R) - 2 * K @ R @ K.T
    ),
    "this is P - K S K^T: right for the optimal gain only": (
        lambda P, K, H, R: P - K @ (H @ P @ H.T + R) @ K.T
    ),
    "the gain in front of R is missing: R lives in the world of the measurement": (
        lambda P, K, H, R: joseph(P, K, H, R) - K @ R @ K.T + R
    ),
}


def check_joseph(student: Function) -> Report:
    """Check ``student(cov (n, n), K (n, m), H (m, n), R (m, m)) -> cov (n, n)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    H, R = np.array([[1.0, 0.3], [-0.2, 1.0]]), np.array([[0.5, 0.1], [0.1, 0.4]])
    best = _gain(np.array(_COV), H, R)
    cases = [
        ("the optimal gain", _COV, best, H, R),
        ("a timid gain, half of it", _COV, best / 2, H, R),
        ("a gain from another filter", _COV, [[0.3, -0.1], [0.2, 0.6]], H, R),
    ]
    return run_cases("joseph", student, joseph, cases, MISTAKES_JOSEPH)
