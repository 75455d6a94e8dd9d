"""Exercises, chapter 02: predict, update, Joseph's form, a filter on the cart, and its noise.

P5 (3), (4), (7)-(9).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, drawn
from slamlab.exercises._report import Array, Check, Function

__all__ = ["check_joseph", "check_predict", "check_track", "check_tune", "check_update"]


# %% [markdown] tags=["chapter"]
# # Exercises 02: the Kalman filter
#
# Two functions make a Kalman filter, a third allows it any gain; then it drives, and you find out
# how hard its cart is pushed; the chapter is [The Kalman filter](../02_kalman_filter.ipynb).
# Replace each `...` and run the check below it as often as you like; then draw what you built
# beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 02: the Kalman filter
#
# The exercises are in [Exercises 02](../exercises/02_kalman_filter.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: predict
#
# P5 (3) and (4), without control.

# %% tags=["private"]
Belief = tuple[Array, Array]


# %% tags=["exercise"]
def predict(mean: Array, cov: Array, F: Array, Q: Array) -> Belief:
    """Move a Gaussian belief.

    Parameters
    ----------
    mean : ndarray, shape (n,)
    cov : ndarray, shape (n, n)
    F : ndarray, shape (n, n)
        Evolution matrix.
    Q : ndarray, shape (n, n)
        Covariance of the motion noise.

    Returns
    -------
    mean : ndarray, shape (n,)
    cov : ndarray, shape (n, n)
    """
    return F @ mean, F @ cov @ F.T + Q


# %% active="ipynb" tags=["try"]
# F = np.array([[1.0, 0.5], [0.0, 1.0]])
# predict(np.array([0.0, 1.0]), np.eye(2), F, 0.1 * np.eye(2))

# %% [markdown] tags=["hint"]
# Return two things: `return new_mean, new_cov`.

# %% [markdown] tags=["hint"]
# A covariance is multiplied from both sides, and must stay symmetric.

# %% [markdown] tags=["hint"]
# The mean is multiplied once, the covariance from both sides, the second time by the transpose.
# Where does `Q` come in: before the motion or after it?

# %% tags=["cases"]
Case = tuple[Any, ...]


@drawn
def _motion(rng: np.random.Generator, n: int, noise: float = 1.0) -> Case:
    mean, F = (np.round(rng.normal(0, 2, shape), 2) for shape in (n, (n, n)))
    return mean, a_covariance(rng, n), F, noise * a_covariance(rng, n, 0.3)


_ZERO = [[0.0, 0.0], [0.0, 0.0]]


def _cloud(ax: Any, points: Array, mean: Any, cov: Any) -> None:
    """Draw samples of position and speed, and the ellipse of a belief about them."""
    from slamlab import plots

    plots.lidar_points(ax, points, s=1.6)
    plots.ellipse(ax, np.asarray(mean, float), np.asarray(cov, float))
    ax.set(xlabel="position (m)", ylabel="speed (m/s)")


def _predict_drawn(ax: Any, function: Any) -> None:
    """Draw position and speed of 1000 carts after a step, and the ellipse of the belief."""
    rng, F = np.random.default_rng(1), np.array([[1.0, 1.2], [0.0, 1.0]])
    mean, P, Q = np.array([0.0, 1.0]), np.diag([0.2, 0.5]) ** 2, np.diag([0.3, 0.2]) ** 2
    carts = rng.multivariate_normal(mean, P, 1000) @ F.T + rng.multivariate_normal([0, 0], Q, 1000)
    _cloud(ax, carts, *function(mean, P, F, Q))


check_predict = Check(
    predict,
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
    picture=_predict_drawn,
)


# %% tags=["mistakes"]
def _model(rng: np.random.Generator, n: int, m: int) -> Case:
    """Mean, covariance, measurement, H and R of n states and m readings."""
    mean, z, H = (np.round(rng.normal(0, 2, shape), 2) for shape in (n, m, (m, n)))
    return mean, a_covariance(rng, n), z, H, a_covariance(rng, m, 0.4)


check_predict.mistakes = {
    "F P F is no covariance: the second F must be transposed": "F.T => F",
    "the transposed F stands on the wrong side: expected F P F^T": (
        "F @ cov @ F.T => F.T @ cov @ F"
    ),
    "F stands on one side only: expected F P F^T": " @ F.T => ",
    "the covariance did not move: expected F P F^T": "F @ cov @ F.T => cov",
    "Q is missing: every motion adds uncertainty": " + Q => ",
    "Q went through the motion too: it is added after it": (
        "F @ cov @ F.T + Q => F @ (cov + Q) @ F.T"
    ),
    "Q was added twice": "+ Q => + 2 * Q",
    "Q was subtracted: the noise of the motion adds uncertainty": "+ Q => - Q",
    "`*` multiplies entry by entry: matrices are multiplied by `@`": (
        "F @ cov @ F.T => F * cov * F.T"
    ),
    "the mean did not move": "F @ mean => mean.copy()",
    "the mean was moved by the transposed F": "F @ mean => F.T @ mean",
    "the belief was predicted twice": lambda m, P, F, Q: predict(*predict(m, P, F, Q), F, Q),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: predict
#
# The mean goes where the state would go. The error goes through the same matrix, so its
# covariance is multiplied from both sides; the noise of the motion comes on top, unturned.

# %% [markdown] tags=["solution"]
# Forgetting the transpose passes whenever the covariance is zero or F is symmetric, and otherwise
# gives, with rare exceptions, a matrix that is not even symmetric:

# %% active="ipynb" tags=["solution"]
# def without_transpose(mean, cov, F, Q):
#     return F @ mean, F @ cov @ F + Q
#
# check_predict(without_transpose)

# %% [markdown] tags=["statement"]
# ## Exercise 2: update
#
# P5 (5) to (9).


# %% tags=["exercise"]
def update(mean: Array, cov: Array, z: Array, H: Array, R: Array) -> Belief:
    """Correct a Gaussian belief by a measurement.

    Parameters
    ----------
    mean : ndarray, shape (n,)
    cov : ndarray, shape (n, n)
    z : ndarray, shape (m,)
        Measurement.
    H : ndarray, shape (m, n)
        Measurement matrix.
    R : ndarray, shape (m, m)
        Covariance of the measurement noise.

    Returns
    -------
    mean : ndarray, shape (n,)
    cov : ndarray, shape (n, n)
    """
    innovation = z - H @ mean
    S = H @ cov @ H.T + R
    K = cov @ H.T @ np.linalg.inv(S)
    return mean + K @ innovation, (np.eye(len(mean)) - K @ H) @ cov


# %% active="ipynb" tags=["try"]
# one = np.array([[1.0]])
# update(np.array([0.0]), one, np.array([1.0]), one, one)

# %% [markdown] tags=["hint"]
# Write the five formulas as five lines, in their order: innovation, S, K, mean, covariance.

# %% [markdown] tags=["hint"]
# `np.linalg.inv(S)` is good enough here; S is as small as the measurement.

# %% [markdown] tags=["hint"]
# `K = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R)`.


# %% tags=["cases"]
def _update_drawn(ax: Any, function: Any) -> None:
    """Draw those of 6000 carts that agree with the reading, and the ellipse of the belief."""
    rng, z, R = np.random.default_rng(2), np.array([2.4]), np.array([[0.16]])
    mean, P = np.array([1.2, 1.0]), np.array([[0.8, 0.35], [0.35, 0.25]])
    carts = rng.multivariate_normal(mean, P, 6000)
    likelihood = np.exp(-0.5 * (z[0] - carts[:, 0]) ** 2 / R[0, 0])
    agreeing = carts[rng.random(6000) < likelihood]
    _cloud(ax, agreeing, *function(mean, P, z, np.array([[1.0, 0.0]]), R))


check_update = Check(
    update,
    "mean, cov",
    {
        "prior and sensor equally sure": ([0.0], [[1.0]], [1.0], [[1.0]], [[1.0]]),
        "one reading of two states": lambda rng: _model(rng, 2, 1),
        "two readings of two states": lambda rng: _model(rng, 2, 2),
        "more states than readings": lambda rng: _model(rng, 4, 2),
        "more readings than states": lambda rng: _model(rng, 1, 3),
        "a sensor that hardly knows": lambda rng: (*_model(rng, 2, 2)[:4], 100 * np.eye(2)),
    },
    tolerance=1e-8,
    picture=_update_drawn,
)

# %% tags=["mistakes"]
check_update.mistakes = {
    "R is missing, and a pseudo-inverse hides that S has no inverse": (
        " + R => ",
        "np.linalg.inv => np.linalg.pinv",
    ),
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
        "mean + K @ innovation => mean.copy()"
    ),
    "the step alone was returned: it is added to the mean": "mean + K => K",
    "the covariance did not shrink: expected (I - K H) P": (
        "(np.eye(len(mean)) - K @ H) @ cov => cov.copy()"
    ),
    "the covariance grew: (I + K H) P instead of (I - K H) P": ") - K @ H => ) + K @ H",
    "I - K H alone is no covariance: it multiplies P": "K @ H) @ cov => K @ H)",
    "P stands on the wrong side: expected (I - K H) P": (
        "(np.eye(len(mean)) - K @ H) @ cov => cov @ (np.eye(len(mean)) - K @ H)"
    ),
    "R is a covariance already: it is not squared": "+ R => + R @ R",
    "the measurement was counted twice": (
        lambda m, P, z, H, R: update(*update(m, P, z, H, R), z, H, R)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: update
#
# Five formulas, in four lines.

# %% [markdown] tags=["solution"]
# P1 prints its gain (34) with a $+ R$ behind it. In most filters the two matrices have different
# shapes, and there is no such sum. Where as many numbers are measured as are estimated, the filter
# runs and is wrong. It runs also with a single reading or a single state, where NumPy stretches
# the smaller matrix over the larger:

# %% active="ipynb" tags=["solution"]
# def as_printed_in_p1(mean, cov, z, H, R):
#     K = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R) + R
#     return mean + K @ (z - H @ mean), (np.eye(len(mean)) - K @ H) @ cov
#
# check_update(as_printed_in_p1)

# %% [markdown] tags=["statement"]
# ## Exercise 3: Joseph's form
#
# You are given a gain that is not the optimal one. How uncertain is the state after using it?


# %% tags=["exercise"]
def joseph(cov: Array, K: Array, H: Array, R: Array) -> Array:
    """Covariance after an update with any gain.

    Parameters
    ----------
    cov : ndarray, shape (n, n)
        Before the update.
    K : ndarray, shape (n, m)
        The gain that was used.
    H : ndarray, shape (m, n)
    R : ndarray, shape (m, m)

    Returns
    -------
    ndarray, shape (n, n)
    """
    A = np.eye(len(cov)) - K @ H
    return A @ cov @ A.T + K @ R @ K.T


# %% active="ipynb" tags=["try"]
# joseph(np.array([[1.0]]), np.array([[0.5]]), np.array([[1.0]]), np.array([[1.0]]))

# %% [markdown] tags=["hint"]
# The error after the update is $(I - KH)$ times the error before, plus $K$ times the noise of the
# sensor. The two are independent.

# %% [markdown] tags=["hint"]
# The covariance of $A e$ is $A P A^\top$.


# %% tags=["cases"]
@drawn
def _any_gain(rng: np.random.Generator, n: int, m: int, share: float | None = None) -> Case:
    _, cov, _, H, R = _model(rng, n, m)
    best = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R)
    K = rng.normal(0, 0.5, (n, m)) if share is None else share * best
    return cov, K, H, R


def _joseph_drawn(ax: Any, function: Any) -> None:
    """Draw the errors of 1000 filters with half the best gain, and the ellipse of the result."""
    rng, H, R = np.random.default_rng(3), np.array([[1.0, 0.0]]), np.array([[0.16]])
    P, K = np.array([[0.8, 0.35], [0.35, 0.25]]), np.array([[0.42], [0.18]])
    before, noise = rng.multivariate_normal([0, 0], P, 1000), rng.normal(0, 0.4, (1000, 1))
    cov = function(P, K, H, R)
    _cloud(ax, before - (before @ H.T + noise) @ K.T, [0, 0], cov)
    ax.set(xlabel="error of the position (m)", ylabel="error of the speed (m/s)")


check_joseph = Check(
    joseph,
    "cov",
    {
        "the optimal gain": _any_gain(2, 2, 1.0),
        "a timid gain, half of it": _any_gain(2, 1, 0.5),
        "no gain at all": _any_gain(3, 2, 0.0),
        "a gain from another filter, few readings": _any_gain(3, 1),
        "a gain from another filter, many readings": _any_gain(2, 4),
    },
    tolerance=1e-8,
    picture=_joseph_drawn,
)

# %% tags=["mistakes"]
check_joseph.mistakes = {
    "this is the short form (I - K H) P: right for the optimal gain, not for any": (
        "A @ cov @ A.T + K @ R @ K.T => A @ cov"
    ),
    "the noise of the sensor is missing: K R K^T must be added": " + K @ R @ K.T => ",
    "the second factor must be transposed: A P A^T": "A.T => A",
    "the transpose stands on the wrong side: A P A^T": "A @ cov @ A.T => A.T @ cov @ A",
    "K R K^T must be added, not subtracted": "+ K @ R => - K @ R",
    "this is P - K S K^T: right for the optimal gain, not for any": (
        "A @ cov @ A.T + K @ R @ K.T => cov - K @ (H @ cov @ H.T + R) @ K.T"
    ),
    "the gain around R is missing: R lives in the world of the measurement": ("K @ R @ K.T => R"),
    "expected I - K H, not I + K H": "- K @ H => + K @ H",
    "the noise alone was returned: A P A^T is missing": "A @ cov @ A.T +  => ",
}

# %% [markdown] tags=["solution"]
# ## Solution 3: Joseph's form
#
# The error after the update is $(I - KH)\,e - K v$: two independent parts, so their covariances
# add. Nothing in this asks the gain to be optimal.

# %% [markdown] tags=["solution"]
# The short form agrees for the optimal gain, and for no gain at all. For nearly all others it
# claims too little or too much:

# %% active="ipynb" tags=["solution"]
# def short_form(cov, K, H, R):
#     return (np.eye(len(cov)) - K @ H) @ cov
#
# check_joseph(short_form)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a filter on the cart
#
# Assemble it. A cart rolls along a rail and is pushed at random; every `dt` seconds its position
# is read, or the reading is lost. The state is position and speed. It starts as $(0, 0)$ with
# covariance $I$. Between two readings
#
# $$
# F = \begin{pmatrix} 1 & dt \\ 0 & 1 \end{pmatrix}, \qquad
# Q = q \begin{pmatrix} dt^3/3 & dt^2/2 \\ dt^2/2 & dt \end{pmatrix},
# $$
#
# also before the first one. Use your functions of exercises 1 and 2.


# %% tags=["exercise"]
def track(z: Array, dt: float, q: float, r: float) -> Belief:
    """Follow a cart.

    Parameters
    ----------
    z : ndarray, shape (T,)
        Positions read (m), NaN where a reading was lost.
    dt : float
        Time between readings (s).
    q : float
        Strength of the pushes (m^2/s^3).
    r : float
        Standard deviation of a reading (m).

    Returns
    -------
    means : ndarray, shape (T, 2)
        Position (m) and speed (m/s) after each reading.
    covs : ndarray, shape (T, 2, 2)
    """
    F, H = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    Q = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    mean, cov, means, covs = np.zeros(2), np.eye(2), [], []
    for reading in z:
        mean, cov = predict(mean, cov, F, Q)
        if np.isfinite(reading):
            mean, cov = update(mean, cov, np.array([reading]), H, np.array([[r**2]]))
        means.append(mean)
        covs.append(cov)
    return np.array(means), np.array(covs)


# %% active="ipynb" tags=["try"]
# track(np.array([0.4, np.nan, 1.3]), 0.5, 0.1, 0.2)

# %% [markdown] tags=["hint"]
# Each turn of the loop has two steps, and the second one is sometimes left out.

# %% [markdown] tags=["hint"]
# `update` wants arrays: a reading is `np.array([reading])`, and $H$ has one row.


# %% tags=["cases"]
@drawn
def _readings(rng: np.random.Generator, n: int, lost: float = 0.0) -> Case:
    dt, q, r = np.round(rng.uniform(0.1, 1.5, 3), 2)
    z = np.round(np.cumsum(rng.normal(0.5, 1, n)), 2)
    z[rng.random(n) < lost] = np.nan
    return z, dt, q, r


@lru_cache(maxsize=1)
def _cart() -> tuple[Array, Array]:
    """Draw 600 positions and readings of a cart pushed with q = 0.5; dt = 0.5 s, r = 0.8 m."""
    rng, dt = np.random.default_rng(2), 0.5
    root = np.linalg.cholesky([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    state, places, z = np.zeros(2), [], []
    for push in rng.standard_normal((600, 2)):
        state = np.array([state[0] + dt * state[1], state[1]]) + np.sqrt(0.5) * root @ push
        places.append(state[0])
        z.append(state[0] + 0.8 * rng.standard_normal())
    return np.array(places), np.array(z)


def _followed(ax: Any, z: Array, means: Any, covs: Any) -> None:
    """Draw errors of readings and of a filter along a drive, and two sigmas to either side."""
    from slamlab import plots

    n = len(z)
    t, true = 0.5 * np.arange(1, n + 1), _cart()[0][:n]
    error = np.asarray(means, float)[:, 0] - true
    sigma = np.sqrt(np.asarray(covs, float)[:, 0, 0])
    ax.axhline(0, **plots.line_style("truth"))
    plots.lidar_points(ax, np.column_stack([t, z - true]), s=3)
    plots.path(ax, np.column_stack([t, error]))
    for side in (-2, 2):
        ax.plot(t, side * sigma, color=plots.COLOURS["estimate"], lw=1, ls="--")
    ax.set(xlabel="time (s)", ylabel="error of the position (m)", ylim=(-3, 3))


def _track_drawn(ax: Any, function: Any) -> None:
    """Draw errors of readings and of the filter, ten readings lost, and two sigmas of it."""
    z = _cart()[1][:60].copy()
    z[20:30] = np.nan
    _followed(ax, z, *function(z, 0.5, 0.5, 0.8))


check_track = Check(
    track,
    "means, covs",
    {
        "one reading": ([0.7], 0.5, 0.1, 0.4),
        "one reading that was lost": ([np.nan], 0.5, 0.1, 0.4),
        "a cart that is not pushed": ([1.0, 2.1, 2.9], 1.0, 0.0, 0.5),
        "a drive": _readings(12),
        "a drive with lost readings": _readings(12, 0.4),
    },
    tolerance=1e-8,
    picture=_track_drawn,
)

# %% tags=["mistakes"]
check_track.mistakes = {
    "this is the Q of the chapter, one push for each step: here noise acts all the time": (
        "[[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]] => [[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]]"
    ),
    "the first reading met the start itself: predict before every update": (
        "predict(mean, cov, F, Q) => predict(mean, cov, F, Q) if means else (mean, cov)"
    ),
    "the readings were not used: update after each prediction": (
        "if np.isfinite(reading) => if False"
    ),
    "nothing was predicted: the cart moves between readings": (
        "predict(mean, cov, F, Q) => mean, cov"
    ),
    "a lost reading is no reading of zero: leave the update out": (
        "if np.isfinite(reading) => if True",
        "np.array([reading]) => np.array([np.nan_to_num(reading)])",
    ),
    "a lost reading was used: NaN spreads from there on": ("if np.isfinite(reading) => if True"),
    "time passes while readings are lost: predict for them too": (
        "predict(mean, cov, F, Q)"
        " => predict(mean, cov, F, Q) if np.isfinite(reading) else (mean, cov)"
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
    "only the last belief was returned: expected one after each reading": (
        lambda *given: (track(*given)[0][-1], track(*given)[1][-1])
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: a filter on the cart
#
# Predict for every reading, also for one that is lost: time passes all the same, and the
# covariance grows until the next reading comes.

# %% [markdown] tags=["solution"]
# A filter that skips a lost reading altogether forgets that time has passed. Its covariance stays
# small and its position stays behind:

# %% active="ipynb" tags=["solution"]
# def stops_the_clock(z, dt, q, r):
#     there = np.isfinite(z)
#     means, covs = track(z[there], dt, q, r)
#     means = np.concatenate([np.zeros((1, 2)), means.reshape(-1, 2)])
#     covs = np.concatenate([np.eye(2)[None], covs.reshape(-1, 2, 2)])
#     read = np.cumsum(there)                        # how many so far
#     return means[read], covs[read]
#
# check_track(stops_the_clock)

# %% [markdown] tags=["statement"]
# ## Exercise 5: how hard is the cart pushed?
#
# Nobody tells you $q$. But a filter that is given the right one makes innovations that are as
# large as it says, and of which none tells the next. The check runs the filter of exercise 4 over
# 600 readings with `dt = 0.5` and `r = 0.8`, with the $q$ that you return. Find one that it
# accepts.


# %% tags=["exercise"]
def tune() -> float:
    """Strength of the pushes.

    Returns
    -------
    float
        q (m^2/s^3).
    """
    return 0.5


# %% active="ipynb" tags=["try"]
# tune()

# %% [markdown] tags=["hint"]
# Try powers of ten first. The report says on which side you are.


# %% tags=["cases"]
@lru_cache(maxsize=64)
def _innovations(q: float) -> tuple[float, float]:
    """Mean NIS, and correlation of each scaled innovation with the next."""
    (_, z), dt, r = _cart(), 0.5, 0.8
    means, covs = track(z, dt, q, r)
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
        surer = "too small: the filter is overconfident" if nis > 1 else "too large"
        return f"expected a mean NIS between 0.85 and 1.15, got {nis:.2f}: q is {surer}"
    if aspect == "order" and abs(next_to_next) > 0.12:
        late = "late, q is too small" if next_to_next > 0 else "nervous, q is too large"
        return (
            f"each innovation tells the next, correlation {next_to_next:.2f}: the filter is {late}"
        )
    return ""


def _tune_drawn(ax: Any, function: Any) -> None:
    """Draw errors of readings and of the filter with this q, and two sigmas of it."""
    z = _cart()[1][:80]
    _followed(ax, z, *track(z, 0.5, float(function()), 0.8))


check_tune = Check(
    tune,
    "what is to be said",
    {
        "the innovations are as large as the filter says": ("size",),
        "no innovation tells the next": ("order",),
    },
    use=_judged,
    picture=_tune_drawn,
)

# %% [markdown] tags=["solution"]
# ## Solution 5: how hard is the cart pushed?
#
# The readings were drawn with $q = 0.5$. Anything from about 0.27 to 0.97 passes: the check
# leaves wide margins, and does not ask for all that 600 readings can tell.

# %% [markdown] tags=["solution"]
# A filter that expects hardly any pushes explains them by the noise of its sensor, and comes late:

# %% active="ipynb" tags=["solution"]
# def no_pushes():
#     return 0.001
#
# check_tune(no_pushes)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 02](../solutions/02_kalman_filter.ipynb).
