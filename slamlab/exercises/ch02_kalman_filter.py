"""Checks of chapter 02: predict, update and Joseph's form of the Kalman filter.

P5 (3), (4), (7)-(9).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance
from slamlab.exercises._report import Array, Check

__all__ = ["check_joseph", "check_predict", "check_update"]

Belief = tuple[Array, Array]
Case = tuple[Any, ...]


def _model(rng: np.random.Generator, n: int, m: int) -> Case:
    """Mean, covariance, measurement, H and R of n states and m readings."""
    mean, z, H = (np.round(rng.normal(0, 2, shape), 2) for shape in (n, m, (m, n)))
    return mean, a_covariance(rng, n), z, H, a_covariance(rng, m, 0.4)


# Exercise 1: predict.


def _predict(mean: Array, cov: Array, F: Array, Q: Array) -> Belief:
    """Mean (n,) and covariance (n, n) after the motion, P5 (3), (4)."""
    return F @ mean, F @ cov @ F.T + Q


def _motion(n: int, noise: float = 1.0) -> Any:
    def draw(rng: np.random.Generator) -> Case:
        mean, F = (np.round(rng.normal(0, 2, shape), 2) for shape in (n, (n, n)))
        return mean, a_covariance(rng, n), F, noise * a_covariance(rng, n, 0.3)

    return draw


_ZERO = [[0.0, 0.0], [0.0, 0.0]]

check_predict = Check(
    _predict,
    "mean, cov",
    {
        "a known position with an unsure speed": (
            [0, 1],
            [[0, 0], [0, 1]],
            [[1, 2], [0, 1]],
            _ZERO,
        ),
        "motion noise alone": (
            [1, -2],
            _ZERO,
            [[1.0, 0.5], [0.0, 0.9]],
            [[0.1, 0.02], [0.02, 0.3]],
        ),
        "one dimension": ([3.0], [[2.0]], [[0.5]], [[0.1]]),
        "two dimensions": _motion(2),
        "three and without noise": _motion(3, 0.0),
        "four dimensions": _motion(4),
    },
    {
        "F P F is no covariance: the second F must be transposed": ("F.T", "F"),
        "the transposed F stands on the wrong side: F P F^T is due": (
            "F @ cov @ F.T",
            "F.T @ cov @ F",
        ),
        "F stands on one side only: F P F^T is due": (" @ F.T", ""),
        "the covariance did not move: F P F^T is due": ("F @ cov @ F.T", "cov"),
        "Q is missing: every motion adds uncertainty": (" + Q", ""),
        "Q went through the motion too: it is added after it": (
            "F @ cov @ F.T + Q",
            "F @ (cov + Q) @ F.T",
        ),
        "Q was added twice": ("+ Q", "+ 2 * Q"),
        "Q was subtracted: predicting never makes the belief sharper": ("+ Q", "- Q"),
        "`*` multiplies entry by entry: matrices are multiplied by `@`": (
            "F @ cov @ F.T",
            "F * cov * F.T",
        ),
        "the mean did not move": ("F @ mean", "mean.copy()"),
        "the mean was moved by the transposed F": ("F @ mean", "F.T @ mean"),
        "the belief was predicted twice": lambda m, P, F, Q: _predict(*_predict(m, P, F, Q), F, Q),
    },
)


# Exercise 2: update.


def _update(mean: Array, cov: Array, z: Array, H: Array, R: Array) -> Belief:
    """Mean (n,) and covariance (n, n) after the measurement, P5 (5)-(9)."""
    S = H @ cov @ H.T + R
    K = cov @ H.T @ np.linalg.inv(S)
    return mean + K @ (z - H @ mean), (np.eye(len(mean)) - K @ H) @ cov


check_update = Check(
    _update,
    "mean, cov",
    {
        "prior and sensor equally sure": ([0.0], [[1.0]], [1.0], [[1.0]], [[1.0]]),
        "one reading of two states": lambda rng: _model(rng, 2, 1),
        "two readings of two states": lambda rng: _model(rng, 2, 2),
        "more states than readings": lambda rng: _model(rng, 4, 2),
        "more readings than states": lambda rng: _model(rng, 1, 3),
        "a sensor that hardly knows": lambda rng: (*_model(rng, 2, 2)[:4], 100 * np.eye(2)),
    },
    {
        "R must not be added to the gain, as P1 prints (34)": ("inv(S)", "inv(S) + R"),
        "R is missing in S: the sensor is not perfect": (" + R", ""),
        "this is the transposed gain: K is n x m, P H^T S^-1": (
            "cov @ H.T @ np.linalg.inv(S)",
            "(cov @ H.T @ np.linalg.inv(S)).T",
        ),
        "S was multiplied, not inverted": ("np.linalg.inv(S)", "S"),
        "the innovation has the wrong sign: measured minus predicted": (
            "z - H @ mean",
            "H @ mean - z",
        ),
        "the prediction H x is missing in the innovation": ("z - H @ mean", "z"),
        "the mean did not move: the gain times the innovation is added": (
            "mean + K @ (z - H @ mean)",
            "mean.copy()",
        ),
        "the step alone came: it is added to the mean": ("mean + K", "K"),
        "the covariance did not shrink: (I - K H) P is due": (
            "(np.eye(len(mean)) - K @ H) @ cov",
            "cov.copy()",
        ),
        "the covariance grew: (I + K H) P instead of (I - K H) P": (") - K @ H", ") + K @ H"),
        "I - K H alone is no covariance: it multiplies P": ("K @ H) @ cov", "K @ H)"),
        "P stands on the wrong side: (I - K H) P is due": (
            "(np.eye(len(mean)) - K @ H) @ cov",
            "cov @ (np.eye(len(mean)) - K @ H)",
        ),
        "R is a covariance already: it is not squared": ("+ R", "+ R @ R"),
        "the measurement was counted twice": (
            lambda m, P, z, H, R: _update(*_update(m, P, z, H, R), z, H, R)
        ),
    },
    tolerance=1e-8,
)


# Exercise 3: Joseph's form.


def _joseph(cov: Array, K: Array, H: Array, R: Array) -> Array:
    """Covariance (n, n) after an update with any gain K (n, m)."""
    A = np.eye(len(cov)) - K @ H
    return A @ cov @ A.T + K @ R @ K.T


def _any_gain(n: int, m: int, share: float | None = None) -> Any:
    def draw(rng: np.random.Generator) -> Case:
        _, cov, _, H, R = _model(rng, n, m)
        best = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R)
        K = rng.normal(0, 0.5, (n, m)) if share is None else share * best
        return cov, K, H, R

    return draw


check_joseph = Check(
    _joseph,
    "cov",
    {
        "the optimal gain": _any_gain(2, 2, 1.0),
        "a timid gain, half of it": _any_gain(2, 1, 0.5),
        "no gain at all": _any_gain(3, 2, 0.0),
        "a gain from another filter, few readings": _any_gain(3, 1),
        "a gain from another filter, many readings": _any_gain(2, 4),
    },
    {
        "this is the short form (I - K H) P: right for the optimal gain only": (
            "A @ cov @ A.T + K @ R @ K.T",
            "A @ cov",
        ),
        "the noise of the sensor is missing: K R K^T must be added": (" + K @ R @ K.T", ""),
        "the second factor must be transposed: A P A^T": ("A.T", "A"),
        "the transpose stands on the wrong side: A P A^T": ("A @ cov @ A.T", "A.T @ cov @ A"),
        "K R K^T must be added, not subtracted": ("+ K @ R", "- K @ R"),
        "this is P - K S K^T: right for the optimal gain only": (
            "A @ cov @ A.T + K @ R @ K.T",
            "cov - K @ (H @ cov @ H.T + R) @ K.T",
        ),
        "the gain around R is missing: R lives in the world of the measurement": (
            "K @ R @ K.T",
            "R",
        ),
        "I + K H stands where I - K H is due": ("- K @ H", "+ K @ H"),
        "the noise alone came: A P A^T is missing": ("A @ cov @ A.T + ", ""),
    },
    tolerance=1e-8,
)
