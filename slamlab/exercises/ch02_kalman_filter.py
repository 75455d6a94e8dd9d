"""Checks of chapter 02: predict, update, Joseph's form, a filter on the cart, and its noise.

P5 (3), (4), (7)-(9).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, drawn
from slamlab.exercises._report import Array, Check, Function

__all__ = ["check_joseph", "check_predict", "check_track", "check_tune", "check_update"]

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


@drawn
def _motion(rng: np.random.Generator, n: int, noise: float = 1.0) -> Case:
    mean, F = (np.round(rng.normal(0, 2, shape), 2) for shape in (n, (n, n)))
    return mean, a_covariance(rng, n), F, noise * a_covariance(rng, n, 0.3)


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
        "F P F is no covariance: the second F must be transposed": "F.T => F",
        "the transposed F stands on the wrong side: F P F^T is due": (
            "F @ cov @ F.T => F.T @ cov @ F"
        ),
        "F stands on one side only: F P F^T is due": " @ F.T => ",
        "the covariance did not move: F P F^T is due": "F @ cov @ F.T => cov",
        "Q is missing: every motion adds uncertainty": " + Q => ",
        "Q went through the motion too: it is added after it": (
            "F @ cov @ F.T + Q => F @ (cov + Q) @ F.T"
        ),
        "Q was added twice": "+ Q => + 2 * Q",
        "Q was subtracted: predicting never makes the belief sharper": "+ Q => - Q",
        "`*` multiplies entry by entry: matrices are multiplied by `@`": (
            "F @ cov @ F.T => F * cov * F.T"
        ),
        "the mean did not move": "F @ mean => mean.copy()",
        "the mean was moved by the transposed F": "F @ mean => F.T @ mean",
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
        "R must not be added to the gain, as P1 prints (34)": "inv(S) => inv(S) + R",
        "R is missing in S: the sensor is not perfect": " + R => ",
        "this is the transposed gain: K is n x m, P H^T S^-1": (
            "cov @ H.T @ np.linalg.inv(S) => (cov @ H.T @ np.linalg.inv(S)).T"
        ),
        "S was multiplied, not inverted": "np.linalg.inv(S) => S",
        "the innovation has the wrong sign: measured minus predicted": (
            "z - H @ mean => H @ mean - z"
        ),
        "the prediction H x is missing in the innovation": "z - H @ mean => z",
        "the mean did not move: the gain times the innovation is added": (
            "mean + K @ (z - H @ mean) => mean.copy()"
        ),
        "the step alone came: it is added to the mean": "mean + K => K",
        "the covariance did not shrink: (I - K H) P is due": (
            "(np.eye(len(mean)) - K @ H) @ cov => cov.copy()"
        ),
        "the covariance grew: (I + K H) P instead of (I - K H) P": ") - K @ H => ) + K @ H",
        "I - K H alone is no covariance: it multiplies P": "K @ H) @ cov => K @ H)",
        "P stands on the wrong side: (I - K H) P is due": (
            "(np.eye(len(mean)) - K @ H) @ cov => cov @ (np.eye(len(mean)) - K @ H)"
        ),
        "R is a covariance already: it is not squared": "+ R => + R @ R",
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


@drawn
def _any_gain(rng: np.random.Generator, n: int, m: int, share: float | None = None) -> Case:
    _, cov, _, H, R = _model(rng, n, m)
    best = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R)
    K = rng.normal(0, 0.5, (n, m)) if share is None else share * best
    return cov, K, H, R


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
            "A @ cov @ A.T + K @ R @ K.T => A @ cov"
        ),
        "the noise of the sensor is missing: K R K^T must be added": " + K @ R @ K.T => ",
        "the second factor must be transposed: A P A^T": "A.T => A",
        "the transpose stands on the wrong side: A P A^T": "A @ cov @ A.T => A.T @ cov @ A",
        "K R K^T must be added, not subtracted": "+ K @ R => - K @ R",
        "this is P - K S K^T: right for the optimal gain only": (
            "A @ cov @ A.T + K @ R @ K.T => cov - K @ (H @ cov @ H.T + R) @ K.T"
        ),
        "the gain around R is missing: R lives in the world of the measurement": (
            "K @ R @ K.T => R"
        ),
        "I + K H stands where I - K H is due": "- K @ H => + K @ H",
        "the noise alone came: A P A^T is missing": "A @ cov @ A.T +  => ",
    },
    tolerance=1e-8,
)


# Exercise 4: a filter on the cart.


def _track(z: Array, dt: float, q: float, r: float) -> Belief:
    """Means (T, 2) and covariances (T, 2, 2) of a cart after each position read, NaN for none."""
    F, H = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    Q = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    R = np.array([[r**2]])
    mean, cov, means, covs = np.zeros(2), np.eye(2), [], []
    for reading in z:
        mean, cov = _predict(mean, cov, F, Q)
        if np.isfinite(reading):
            mean, cov = _update(mean, cov, np.array([reading]), H, R)
        means.append(mean)
        covs.append(cov)
    return np.array(means).reshape(-1, 2), np.array(covs).reshape(-1, 2, 2)


@drawn
def _readings(rng: np.random.Generator, n: int, lost: float = 0.0) -> Case:
    dt, q, r = np.round(rng.uniform(0.1, 1.5, 3), 2)
    z = np.round(np.cumsum(rng.normal(0.5, 1, n)), 2)
    z[rng.random(n) < lost] = np.nan
    return z, dt, q, r


check_track = Check(
    _track,
    "means, covs",
    {
        "one reading": ([0.7], 0.5, 0.1, 0.4),
        "one reading that was lost": ([np.nan], 0.5, 0.1, 0.4),
        "a cart that is not pushed": ([1.0, 2.1, 2.9], 1.0, 0.0, 0.5),
        "a drive": _readings(12),
        "a drive with lost readings": _readings(12, 0.4),
    },
    {
        "the first reading met the start itself: predict before every update": (
            "_predict(mean, cov, F, Q) => _predict(mean, cov, F, Q) if means else (mean, cov)"
        ),
        "the readings were not used: update after each prediction": (
            "if np.isfinite(reading) => if False"
        ),
        "nothing was predicted: the cart moves between readings": (
            "_predict(mean, cov, F, Q) => mean, cov"
        ),
        "a lost reading is no reading of zero: leave the update out": (
            "if np.isfinite(reading) => if True",
            "np.array([reading]) => np.array([np.nan_to_num(reading)])",
        ),
        "a lost reading was used: NaN spreads from there on": (
            "if np.isfinite(reading) => if True"
        ),
        "time passes while readings are lost: predict for them too": (
            "_predict(mean, cov, F, Q)"
            " => _predict(mean, cov, F, Q) if np.isfinite(reading) else (mean, cov)"
        ),
        "r is a standard deviation: R holds its square": "r**2 => r",
        "q stands in front of Q as it is: it was squared": "Q = q * => Q = q**2 *",
        "Q was added for the speed alone, q dt: the position is pushed as well": (
            "[[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]] => [[0.0, 0.0], [0.0, dt]]"
        ),
        "Q lacks its corners: position and speed are pushed together": (
            "[[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]] => [[dt**3 / 3, 0.0], [0.0, dt]]"
        ),
        "dt is missing in F": "[[1.0, dt], [0.0, 1.0]] => [[1.0, 1.0], [0.0, 1.0]]",
        "the last belief came: the one after each reading is due": (
            lambda *given: (_track(*given)[0][-1], _track(*given)[1][-1])
        ),
    },
    tolerance=1e-8,
)


# Exercise 5: how hard is the cart pushed?


def _tune() -> float:
    """Return q (m^2/s^3) with which the innovations are as large as the filter says."""
    return 0.5


@lru_cache(maxsize=1)
def _cart() -> Array:
    """Draw 600 readings of a cart that is pushed with q = 0.5, dt = 0.5 s, r = 0.8 m."""
    rng, dt = np.random.default_rng(2), 0.5
    root = np.linalg.cholesky([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    state, z = np.zeros(2), []
    for push in rng.standard_normal((600, 2)):
        state = np.array([state[0] + dt * state[1], state[1]]) + np.sqrt(0.5) * root @ push
        z.append(state[0] + 0.8 * rng.standard_normal())
    return np.array(z)


@lru_cache(maxsize=64)
def _innovations(q: float) -> tuple[float, float]:
    """Mean NIS, and correlation of each scaled innovation with the next."""
    z, dt, r = _cart(), 0.5, 0.8
    means, covs = _track(z, dt, q, r)
    F = np.array([[1.0, dt], [0.0, 1.0]])
    Q = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    y = z[1:] - (means[:-1] @ F.T)[:, 0]
    S = (F @ covs[:-1] @ F.T + Q)[:, 0, 0] + r**2
    scaled = y / np.sqrt(S)
    return float(np.mean(scaled**2)), float(np.mean(scaled[1:] * scaled[:-1]) / np.mean(scaled**2))


def _judged(tune: Function, aspect: str) -> Any:
    q = tune()
    if not (np.ndim(q) == 0 and np.isfinite(q) and q > 0):
        return "q must be a positive number"
    nis, next_to_next = _innovations(float(q))
    if aspect == "size" and not 0.85 < nis < 1.15:
        surer = "too small: the filter is too sure of itself" if nis > 1 else "too large"
        return f"the mean NIS is {nis:.2f}, between 0.85 and 1.15 is due: q is {surer}"
    if aspect == "order" and abs(next_to_next) > 0.12:
        late = "late, q is too small" if next_to_next > 0 else "nervous, q is too large"
        return (
            f"each innovation tells the next, correlation {next_to_next:.2f}: the filter is {late}"
        )
    return ""


check_tune = Check(
    _tune,
    "what is to be said",
    {
        "the innovations are as large as the filter says": ("size",),
        "no innovation tells the next": ("order",),
    },
    use=_judged,
)
