"""Exercises, chapter 04: weights in log space, effective sample size, systematic resampling.

P2 (14) is the weight, P2 (17) its form in a filter that proposes from the motion model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn
from slamlab.exercises._draw import weights as some_weights
from slamlab.exercises._report import Array, Check, Ints

__all__ = [
    "check_effective_sample_size",
    "check_localize",
    "check_mean_pose",
    "check_resample",
    "check_weights",
]


# %% [markdown] tags=["chapter"]
# # Exercises 04: the particle filter
#
# Five exercises, from a weight to a filter that finds itself in a corridor; the chapter is [The
# particle filter](../04_particle_filter.ipynb). Replace each `...` and run the check below it as
# often as you like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 04: the particle filter
#
# The exercises are in [Exercises 04](../exercises/04_particle_filter.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: new weights
#
# Formula (17) of P2: the new weight is the old one times the likelihood. The likelihoods come as
# logarithms, and they can be as small as $10^{-5000}$.


# %% tags=["exercise"]
def new_weights(weights: Array, log_likelihood: Array) -> Array:
    """Weigh particles by a measurement.

    Parameters
    ----------
    weights : ndarray, shape (M,)
        Old weights; they sum to one, some may be zero.
    log_likelihood : ndarray, shape (M,)
        Logarithm of the likelihood of the measurement for each particle.

    Returns
    -------
    ndarray, shape (M,)
        New weights; they sum to one.
    """
    with np.errstate(divide="ignore"):
        log_w = np.log(weights) + log_likelihood
    w = np.exp(log_w - log_w.max())
    return w / w.sum()


# %% active="ipynb" tags=["try"]
# new_weights(np.array([0.5, 0.5]), np.array([-1.0, -2.0]))

# %% [markdown] tags=["hint"]
# What is the logarithm of a product?

# %% [markdown] tags=["hint"]
# Multiplying all weights by one number changes nothing after the normalisation. Which number
# keeps the largest of them at one?

# %% [markdown] tags=["hint"]
# `log_w = np.log(weights) + log_likelihood`, then `np.exp(log_w - log_w.max())`, then divide by
# the sum. (`with np.errstate(divide="ignore"):` keeps NumPy quiet about the logarithm of zero.)


# %% tags=["cases"]
def _measured(rng: np.random.Generator) -> Any:
    n = int(rng.integers(1, 9))
    return some_weights(rng, n), np.round(rng.normal(-3, 2, n), 2)


def _weights_drawn(ax: Any, function: Any) -> None:
    """Draw the new weights of 41 particles after two measurements, and the exact posterior."""
    from slamlab import plots

    x = np.linspace(0, 4, 41)
    old = np.exp(-0.5 * ((x - 1.5) / 0.6) ** 2)
    exact = old * np.exp(-0.5 * ((2.5 - x) / 0.4) ** 2)
    weights = function(old / old.sum(), -900 - 0.5 * ((2.5 - x) / 0.4) ** 2)
    ax.plot(x, exact / exact.sum(), **plots.line_style("truth"))
    ax.plot(x, np.asarray(weights, float), "o", color=plots.COLOURS["estimate"], markersize=4)
    ax.set(xlabel="place of the particle (m)", ylabel="weight")


check_weights = Check(
    new_weights,
    "weights",
    {
        "equal weights follow the likelihood": ([0.25] * 4, np.log([0.1, 0.2, 0.3, 0.4])),
        "one particle was excluded before and stays so": ([0.0, 0.5, 0.5], [0.0, -1.0, -2.0]),
        "a likelihood of zero excludes": ([0.2, 0.5, 0.3], [-np.inf, -1.0, -2.0]),
        "likelihoods of 1e-5000 do no harm": ([0.5, 0.5], [-11512.0, -11513.0]),
        "the likeliest was excluded before": ([0.0, 0.5, 0.5], [0.0, -2000.0, -2001.0]),
        "densities above one are no harm either": ([0.5, 0.5], [900.0, 899.0]),
        "old weights count": _measured,
    },
    picture=_weights_drawn,
)

# %% tags=["mistakes"]
check_weights.mistakes = {
    "the old weights are forgotten: the new weight is the old one times the likelihood": (
        "np.log(weights) +  => "
    ),
    "exp underflows: subtract the largest log weight before the exponential": (
        "log_w - log_w.max() => log_w"
    ),
    "the largest log likelihood was subtracted: take the largest log weight, as a particle "
    "of weight zero may have the largest likelihood": (
        lambda w, log: w * np.exp(log - log.max()) / np.sum(w * np.exp(log - log.max()))
    ),
    "divided by the largest weight: weights must sum to one": ("w / w.sum() => w / w.max()"),
    "weight and likelihood were added: evidence multiplies": (
        lambda w, log: (w + np.exp(log)) / np.sum(w + np.exp(log))
    ),
    "the log likelihood was used as if it were the likelihood: take its exponential": (
        lambda w, log: w * log / np.sum(w * log)
    ),
    "these are logarithms: return the weights themselves": (
        lambda w, log: np.log(new_weights(w, log))
    ),
    "the weights did not change: the measurement was not used": (lambda w, log: np.array(w)),
    "something was added to the weights: a particle of weight zero stays excluded": (
        "np.log(weights) => np.log(weights + 1e-300)"
    ),
    "the sign of the logarithm is reversed: likely particles must gain": (
        "+ log_likelihood => - log_likelihood"
    ),
    "the measurement was counted twice": "+ log_likelihood => + 2 * log_likelihood",
}

# %% [markdown] tags=["solution"]
# ## Solution 1: new weights
#
# Products become sums of logarithms, and only the ratios of weights matter. With the largest
# logarithm subtracted, the exponential makes the largest weight one: unless all particles are
# excluded, something survives.

# %% [markdown] tags=["solution"]
# Without that subtraction the function is right on paper, and divides zero by zero at the first
# measurement that is 39 standard deviations from every particle:

# %% active="ipynb" tags=["solution"]
# def underflowing(weights, log_likelihood):
#     w = weights * np.exp(log_likelihood)
#     with np.errstate(invalid="ignore"):
#         return w / w.sum()
#
# check_weights(underflowing)

# %% [markdown] tags=["statement"]
# ## Exercise 2: how many particles count?


# %% tags=["exercise"]
def effective_sample_size(weights: Array) -> float:
    """Number of particles that effectively carry the belief.

    Parameters
    ----------
    weights : ndarray, shape (M,)
        Not negative; they need not sum to one.

    Returns
    -------
    float
        M if all are equal, 1 if one particle has everything.
    """
    w = np.asarray(weights) / np.sum(weights)
    return 1 / np.sum(w**2)


# %% active="ipynb" tags=["try"]
# effective_sample_size(np.array([3.0, 1.0]))

# %% [markdown] tags=["hint"]
# Bring the weights to the sum one first.

# %% [markdown] tags=["hint"]
# For M equal weights the sum of their squares is 1/M.


# %% tags=["cases"]
def _size_drawn(ax: Any, function: Any) -> None:
    """Draw the size of 100 weighted particles against the sensor's sigma, and its two limits."""
    from slamlab import plots

    x, sigmas = np.arange(100) - 49.5, np.linspace(0.3, 80, 40)
    sizes = [float(function(np.exp(-0.5 * (x / sigma) ** 2))) for sigma in sigmas]
    for limit in (1, 100):
        ax.plot(sigmas, np.full(40, limit), **plots.line_style("truth"))
    ax.plot(sigmas, sizes, **plots.line_style("estimate"))
    ax.set(xlabel="sigma, in distances of the particles", ylabel="effective size")


check_effective_sample_size = Check(
    effective_sample_size,
    "size",
    {
        "equal weights: all particles count": ([0.2] * 5,),
        "one particle has everything": ([0.0, 1.0, 0.0],),
        "a single particle": ([0.3],),
        "something between": ([0.5, 0.3, 0.15, 0.05],),
        "weights that do not sum to one": lambda rng: (rng.integers(1, 9, rng.integers(2, 9)),),
        "any weights": lambda rng: (some_weights(rng, int(rng.integers(2, 30))),),
    },
    picture=_size_drawn,
)

# %% tags=["mistakes"]
check_effective_sample_size.mistakes = {
    "normalise first: doubling all weights changes nothing": (
        "np.asarray(weights) / np.sum(weights) => np.asarray(weights)"
    ),
    "this is the sum of the squares: take one over it": "1 / np.sum(w**2) => np.sum(w**2)",
    "this counts the particles, not what they weigh": lambda w: float(len(w)),
    "this counts the particles above zero: tiny weights carry almost nothing": (
        lambda w: float(np.count_nonzero(w))
    ),
    "this is one over the largest weight: all squares belong in the sum": (
        "1 / np.sum(w**2) => 1 / w.max()"
    ),
    "divided by the number of particles: return the size itself, between 1 and M": (
        "1 / np.sum(w**2) => 1 / np.sum(w**2) / len(w)"
    ),
    "the square of the sum is missing its square": (lambda w: np.sum(w) / np.sum(w**2)),
    "this is the perplexity, exp of the entropy: another measure, never smaller": (
        lambda w: np.exp(-np.sum(np.where(w > 0, w / w.sum() * np.log(w / w.sum()), 0.0)))
    ),
    "this is the entropy: return 1 / sum of the squares": (
        lambda w: -np.sum(np.where(w > 0, w / w.sum() * np.log(w / w.sum()), 0.0))
    ),
    "the root is too much: return 1 / sum of the squares": (
        "1 / np.sum(w**2) => 1 / np.sqrt(np.sum(w**2))"
    ),
    "this is M / (1 + variance of the weights): the variance of M w is meant": (
        lambda w: len(w) / (1 + np.var(w / w.sum()))
    ),
    "one comes out for any weights: square each weight before the sum": (
        lambda w: 1 / np.sum(w / w.sum()) ** 2
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: how many particles count?

# %% [markdown] tags=["solution"]
# Counting the particles whose weight is not zero looks reasonable and says little: after one
# sharp measurement all weights may be positive, and one of them 0.999.

# %% active="ipynb" tags=["solution"]
# def alive(weights):
#     return float(np.count_nonzero(weights))
#
# check_effective_sample_size(alive)

# %% [markdown] tags=["statement"]
# ## Exercise 3: systematic resampling
#
# Lay M equally spaced points, 1/M apart and shifted by a random part of that distance, over the
# cumulative sum of the weights. Every point draws the particle on which it falls.


# %% tags=["exercise"]
def resample(weights: Array, u: float) -> Ints:
    """Draw indices systematically.

    Parameters
    ----------
    weights : ndarray, shape (M,)
        They sum to one.
    u : float
        Random offset in [0, 1), in units of the distance of the points.

    Returns
    -------
    ndarray of int, shape (M,)
        Index of the particle that each point draws, ascending.
    """
    M = len(weights)
    positions = (np.arange(M) + u) / M
    found = np.searchsorted(np.cumsum(weights), positions, side="right")
    return np.minimum(found, M - 1)


# %% active="ipynb" tags=["try"]
# resample(np.array([0.1, 0.6, 0.1, 0.2]), 0.3)

# %% [markdown] tags=["hint"]
# Point j is at (j + u) / M.

# %% [markdown] tags=["hint"]
# `np.cumsum(weights)` gives the right end of every particle's piece of the line from 0 to 1.

# %% [markdown] tags=["hint"]
# `np.searchsorted(np.cumsum(weights), positions, side="right")`; keep the last index below M in
# case the sum ends at 0.9999999.


# %% tags=["cases"]
def _exact(rng: np.random.Generator) -> Any:
    """Weights in eighths, so that points fall exactly on the borders, and a dead particle."""
    counts = rng.multinomial(8, np.ones(7) / 7)
    return np.append(counts / 8, 0.0), 0.0


def _resample_drawn(ax: Any, function: Any) -> None:
    """Draw how often each of 20 particles is copied, and how often it should be on average."""
    from slamlab import plots

    i = np.arange(1, 21)
    weights = np.exp(-0.5 * ((i - 8) / 3.0) ** 2)
    chosen = np.array(list(function(weights / weights.sum(), 0.3))).astype(int)
    copies = np.bincount(chosen[(chosen >= 0) & (chosen < 20)], minlength=20)
    ax.plot(i, 20 * weights / weights.sum(), **plots.line_style("truth"))
    ax.plot(i, copies, "o", color=plots.COLOURS["estimate"], markersize=5)
    ax.set(xlabel="particle", ylabel="copies; line: M times the weight")


check_resample = Check(
    resample,
    "indices",
    {
        "equal weights: each survives once": ([0.25] * 4, 0.5),
        "a heavy particle is copied": ([0.1, 0.6, 0.1, 0.2], 0.3),
        "another offset, another draw": ([0.1, 0.6, 0.1, 0.2], 0.9),
        "the first particle has weight zero, the first point is at zero": (
            [0.0, 0.5, 0.25, 0.25],
            0.0,
        ),
        "a point exactly on a border draws the next particle": _exact,
        "one particle": ([1.0], 0.7),
        "a cumulative sum that ends below one, and u just below 1": (
            [0.1] * 10,
            0.9999999999999999,
        ),
        "many particles": lambda rng: (
            some_weights(rng, int(rng.integers(2, 30)), [1]),
            float(np.round(rng.uniform(0.05, 0.95), 3)),
        ),
    },
    picture=_resample_drawn,
)


# %% tags=["mistakes"]
def _residual(weights: Array, u: float) -> Any:
    M = len(weights)
    copies = np.floor(M * weights).astype(int)
    rest = M * weights - copies
    n = M - copies.sum()
    more = np.searchsorted(np.cumsum(rest / rest.sum()), (np.arange(n) + u) / n, "right")
    return np.append(np.repeat(np.arange(M), copies), more)


check_resample.mistakes = {
    "the points do not move: shift all of them by the random offset": (
        "(np.arange(M) + u) / M => np.arange(M) / M"
    ),
    "the offset must be divided by the number of particles: the points are 1/M apart": (
        "(np.arange(M) + u) / M => np.arange(M) / M + u"
    ),
    "the offset is not random: the points are always in the middle": (
        "np.arange(M) + u => np.arange(M) + 0.5"
    ),
    "all points are at the same place: they are 1/M apart": (
        "(np.arange(M) + u) / M => np.full(M, u)"
    ),
    "the best particle was copied M times: the others must survive by their weight": (
        lambda w, u: np.full(len(w), np.argmax(w))
    ),
    "indices begin at 0: these are one too large": lambda w, u: resample(w, u) + 1,
    "these are the numbers of copies: return the indices of the copies": (
        lambda w, u: np.bincount(resample(w, u), minlength=len(w))
    ),
    "these are the weights of the drawn: return their indices": (lambda w, u: w[resample(w, u)]),
    "these are the points: return the particles on which they fall": (
        lambda w, u: (np.arange(len(w)) + u) / len(w)
    ),
    "a point exactly on a border draws the particle before it, which may have weight zero: "
    "search with side='right'": '"right" => "left"',
    "a point beyond the last cumulative sum draws no particle: rounding may end it below one, "
    "so cut at M - 1": (
        "np.minimum( => (",
        ", M - 1) => )",
    ),
    "the points were laid over the weights, not over their cumulative sum": (
        "np.cumsum(weights) => weights"
    ),
    "this is residual resampling, whole copies first: use equally spaced points alone": _residual,
    "this is multinomial: independent draws, that ignore u": (
        lambda w, u: np.sort(np.random.default_rng(0).choice(len(w), len(w), p=w))
    ),
    "the offset counts from the other end": "+ u) => + 1 - u)",
}

# %% [markdown] tags=["solution"]
# ## Solution 3: systematic resampling

# %% [markdown] tags=["solution"]
# With points that never move the copies are not right on average: the first particle, for one,
# always gets $M w$ rounded up.

# %% active="ipynb" tags=["solution"]
# def fixed_points(weights, u):
#     M = len(weights)
#     found = np.searchsorted(np.cumsum(weights), np.arange(M) / M, side="right")
#     return np.minimum(found, M - 1)
#
# check_resample(fixed_points)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a bug to find
#
# A robot asks its cloud for one answer. On the way out this function worked for an hour. On the
# way back the robot turned to look at its start, and the answer pointed the other way. Run the
# check, find the bug, repair it.


# %% tags=["exercise"]
def mean_pose(poses: Array, weights: Array) -> Array:
    """Mean of a cloud of poses.

    Parameters
    ----------
    poses : ndarray, shape (M, 3)
        x (m), y (m), heading (rad).
    weights : ndarray, shape (M,)
        They sum to one.

    Returns
    -------
    ndarray, shape (3,)
        The heading in (-pi, pi]: the direction of the weighted mean of the unit vectors
        (cos, sin) of all headings.
    """
    x, y = weights @ poses[:, :2]
    c, s = weights @ np.cos(poses[:, 2]), weights @ np.sin(poses[:, 2])
    return np.array([x, y, np.arctan2(s, c)])


# %% active="ipynb" tags=["stub"]
#     return weights @ poses

# %% active="ipynb" tags=["try"]
# mean_pose(np.array([[0.0, 0, 3.1], [2, 0, -3.1]]), np.array([0.5, 0.5]))

# %% [markdown] tags=["hint"]
# What is the mean of the directions 3.1 and -3.1 on a clock face, and what is it as a number?

# %% [markdown] tags=["hint"]
# A direction is a point on the unit circle. Points can be averaged.


# %% tags=["cases"]
@drawn
def _cloud(rng: np.random.Generator, heading: float) -> Any:
    n = int(rng.integers(2, 8))
    poses = np.round(rng.normal(0, [2.0, 2.0, 0.5], (n, 3)), 2)
    poses[:, 2] = (poses[:, 2] + heading + np.pi) % (2 * np.pi) - np.pi
    return poses, some_weights(rng, n)


def _mean_pose_drawn(ax: Any, function: Any) -> None:
    """Draw thirty poses that face backwards, each as a dot with its heading, and their mean."""
    from slamlab import plots

    rng = np.random.default_rng(4)
    poses = rng.normal([0, 0, np.pi], [0.8, 0.5, 0.4], (30, 3))
    poses[:, 2] = (poses[:, 2] + np.pi) % (2 * np.pi) - np.pi
    for pose, length, kind in (
        *((pose, 0.3, "truth") for pose in poses),
        (np.asarray(function(poses, np.full(30, 1 / 30)), float), 1.2, "estimate"),
    ):
        x, y, heading = pose
        tip = [x + length * np.cos(heading)], [y + length * np.sin(heading)]
        ax.plot([x, *tip[0]], [y, *tip[1]], **plots.line_style(kind))
        ax.plot(x, y, "o", color=plots.COLOURS[kind], markersize=3 if kind == "truth" else 7)
    ax.set_aspect("equal")
    ax.set(xlabel="x (m)", ylabel="y (m)")


check_mean_pose = Check(
    mean_pose,
    "pose",
    {
        "one particle": ([[1.0, 2.0, -3.0]], [1.0]),
        "two headings around half a turn": ([[0, 0, 3.1], [2, 0, -3.0]], [0.5, 0.5]),
        "a weight of zero counts nothing": ([[0, 0, 0.3], [9, 9, 2.0]], [1.0, 0.0]),
        "a cloud that looks ahead": _cloud(0.0),
        "a cloud that looks back": _cloud(np.pi),
    },
    tolerance=1e-8,
    picture=_mean_pose_drawn,
    hunt=True,
)


# %% tags=["mistakes"]
def _about_the_first(poses: Array, weights: Array) -> Any:
    w, first = weights / weights.sum(), poses[0, 2]
    turn = w @ ((poses[:, 2] - first + np.pi) % (2 * np.pi) - np.pi)
    return np.append(w @ poses[:, :2], (first + turn + np.pi) % (2 * np.pi) - np.pi)


check_mean_pose.mistakes = {
    "this is the mean of the angles about one of them, another mean: here the direction of the "
    "mean of unit vectors is asked for": _about_the_first,
    "headings were averaged as numbers: the mean of 3.1 and -3.1 is not 0": (
        "np.arctan2(s, c) => weights @ poses[:, 2]"
    ),
    "the weights were not used": lambda poses, weights: mean_pose(
        poses, np.full(len(poses), 1 / len(poses))
    ),
    "this is the heaviest particle: return the mean": lambda poses, weights: poses[
        np.argmax(weights)
    ].copy(),
    "the headings were averaged without their weights": (
        (
            ("weights @ np.sin(poses[:, 2]) => np.sin(poses[:, 2]).sum()"),
            ("weights @ np.cos(poses[:, 2]) => np.cos(poses[:, 2]).sum()"),
        )
    ),
    "sine and cosine are exchanged in arctan2: the sine comes first": (
        "np.arctan2(s, c) => np.arctan2(c, s)"
    ),
    "the quotient loses the quadrant: use arctan2 with two arguments": (
        "np.arctan2(s, c) => np.arctan(s / c)"
    ),
    "divided by the number of particles: the weights sum to one already": (
        "weights @ poses[:, :2] => weights @ poses[:, :2] / len(poses)"
    ),
    "the headings are wrapped to [0, 2 pi) before they are averaged: that moves the trouble "
    "to zero": ("np.arctan2(s, c) => weights @ (poses[:, 2] % (2 * np.pi))"),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: a mean of directions
#
# A heading is a direction. Average its cosine and its sine, and ask `arctan2` for the direction
# of the mean point.

# %% [markdown] tags=["solution"]
# Wrapping first does not help: it only moves the trouble from half a turn to zero.

# %% active="ipynb" tags=["solution"]
# def from_zero_to_a_turn(poses, weights):
#     return weights @ np.column_stack([poses[:, :2], poses[:, 2] % (2 * np.pi)])
#
# check_mean_pose(from_zero_to_a_turn)

# %% [markdown] tags=["statement"]
# ## Exercise 5: your particle filter in the corridor
#
# Assemble it. A robot moves along a corridor and measures the distance to the nearest door, with
# an error of `sigma`; some readings are lost. Every particle makes the commanded move plus a slip
# of its own, which is given so that the check can compare. Then weigh it with `new_weights`, and
# where fewer than half of the particles count, resample and make the weights equal again.


# %% tags=["exercise"]
def localize(
    x: Array, moves: Array, noise: Array, z: Array, doors: Array, sigma: float, u: Array
) -> tuple[Array, Array]:
    """Particles after a drive along the corridor.

    Parameters
    ----------
    x : ndarray, shape (M,)
        Places of the particles before the first step (m); their weights are equal.
    moves : ndarray, shape (T,)
        Commanded move of each step (m).
    noise : ndarray, shape (T, M)
        Slip of each particle in each step (m).
    z : ndarray, shape (T,)
        Measured distance to the nearest door (m) after each step; NaN if lost.
    doors : ndarray, shape (D,)
        Where the doors are (m).
    sigma : float
        Standard deviation of z (m).
    u : ndarray, shape (T,)
        Offset of the points in each step, should resampling be needed.

    Returns
    -------
    x, weights : ndarray, shape (M,)
    """
    weights = np.full(len(x), 1 / len(x))
    for move, slip, reading, offset in zip(moves, noise, z, u, strict=True):
        x = x + move + slip
        if np.isfinite(reading):
            expected = np.abs(x[:, None] - doors).min(axis=1)
            weights = new_weights(weights, -0.5 * ((reading - expected) / sigma) ** 2)
        if effective_sample_size(weights) < len(x) / 2:
            x = x[resample(weights, offset)]
            weights = np.full(len(x), 1 / len(x))
    return x, weights


# %% active="ipynb" tags=["try"]
# localize(np.array([1.0, 2.0, 4.0]), np.array([0.5]), np.zeros((1, 3)), np.array([0.4]),
#          np.array([1.0, 5.0]), 0.3, np.array([0.5]))

# %% [markdown] tags=["hint"]
# Per step: move, weigh if there is a reading, resample if $N_{\mathrm{eff}} < M/2$.

# %% [markdown] tags=["hint"]
# `np.abs(x[:, None] - doors)` holds the distance of every particle to every door.

# %% [markdown] tags=["hint"]
# The logarithm of a Gaussian's density needs no factor in front: what all particles share drops
# out when the weights are normalised.


# %% tags=["cases"]
@drawn
def _walk(
    rng: np.random.Generator,
    n: int,
    steps: int,
    lost: float = 0.0,
    sigma: float = 0.3,
    *,
    back: bool = False,
) -> Any:
    doors = np.round(rng.uniform(0, 12, 3), 1)
    x, place = np.round(rng.uniform(0, 8, n), 2), float(rng.uniform(0, 6))
    moves = np.round(rng.uniform(0.2, 0.8, steps), 2)
    z = np.abs((place + np.cumsum(moves))[:, None] - doors).min(axis=1)
    z = np.where(rng.random(steps) < lost, np.nan, np.round(z + rng.normal(0, sigma, steps), 2))
    noise = np.round(rng.normal(0, 0.1, (steps, n)), 3)
    side = -1 if back else 1  # the same corridor, seen from its other end
    return side * x, side * moves, noise, z, side * doors, sigma, np.round(rng.random(steps), 3)


def _localize_drawn(ax: Any, function: Any) -> None:
    """Draw 200 particles along the corridor after every other step, doors, and the robot."""
    from slamlab import plots

    rng, doors, steps = np.random.default_rng(3), np.array([1.0, 4.0, 5.5, 11.0]), 24
    moves, sigma = np.full(steps, 0.3), 0.2
    place = 0.8 + np.cumsum(moves + rng.normal(0, 0.05, steps))
    z = np.abs(place[:, None] - doors).min(axis=1) + rng.normal(0, sigma, steps)
    start, noise = rng.uniform(0, 6, 200), rng.normal(0, 0.05, (steps, 200))
    u = rng.random(steps)
    for door in doors:
        ax.axhline(door, color="0.6", lw=1, ls=":")
    for k in range(2, steps + 1, 2):
        x, weights = function(start, moves[:k], noise[:k], z[:k], doors, sigma, u[:k])
        x = np.asarray(x, float)[np.asarray(weights, float) > 1e-3]  # 1/5 of an equal weight
        plots.particles(ax, np.column_stack([np.full(len(x), k), x]))
    ax.plot(np.arange(1, steps + 1), place, **plots.line_style("truth"))
    ax.set(xlabel="step", ylabel="place (m); dotted: doors")


check_localize = Check(
    localize,
    "x, weights",
    {
        "one step, nothing seen": _walk(5, 1, 1.0),
        "one step and one reading": _walk(6, 1, 0.0, 0.5),
        "readings so inexact that there is no resampling": _walk(6, 4, 0.0, 20.0),
        "a drive": _walk(12, 8),
        "a drive on which some readings are lost": _walk(12, 10, 0.5),
        "a drive backwards, left of the origin": _walk(12, 8, back=True),
    },
    tolerance=1e-8,
    picture=_localize_drawn,
)

# %% tags=["mistakes"]
check_localize.mistakes = {
    "the particles were resampled and kept their weights: those count twice now": (
        "            weights = np.full(len(x), 1 / len(x)) =>             pass"
    ),
    "resampled at every step: only when fewer than half of the particles count": (
        "effective_sample_size(weights) < len(x) / 2 => True"
    ),
    "never resampled: do so when fewer than half of the particles count": (
        "effective_sample_size(weights) < len(x) / 2 => False"
    ),
    "resampled when the weights are good: the comparison is the wrong way round": (
        "< len(x) / 2 => > len(x) / 2"
    ),
    "one noise for all: every particle slips on its own": (
        "x + move + slip => x + move + slip[0]"
    ),
    "the slip was forgotten: particles that do not differ cannot be told apart": (
        "x + move + slip => x + move"
    ),
    "the old weights are forgotten at each reading": (
        "new_weights(weights,  => new_weights(np.ones(len(x)), "
    ),
    "sigma stands outside of the square: the error is counted in sigmas, then squared": (
        "((reading - expected) / sigma) ** 2 => (reading - expected) ** 2 / sigma"
    ),
    "the half in the exponent is missing": "-0.5 * (( => -1.0 * ((",
    "the first door is not the nearest: take the smallest distance": (".min(axis=1) => [:, 0]"),
    "the minimum was taken over the particles: each has a nearest door of its own": (
        ".min(axis=1) => .min(axis=0).mean()"
    ),
    "the likelihood of a near door is small: the exponent is negative": ("-0.5 * (( => 0.5 * (("),
    "it looked before it moved: the reading is taken after the step": (
        "np.abs(x[:, None] - doors) => np.abs((x - move - slip)[:, None] - doors)"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: lost in the corridor
#
# Three of your functions in a loop. What to notice: after resampling the weights are equal, since
# what they said is now said by the number of copies.

# %% [markdown] tags=["solution"]
# A filter that keeps the weights after resampling counts old readings again, here even for
# another particle: row i holds another one now. It becomes overconfident:

# %% active="ipynb" tags=["solution"]
# def weights_kept(x, moves, noise, z, doors, sigma, u):
#     weights = np.full(len(x), 1 / len(x))
#     for move, slip, reading, offset in zip(moves, noise, z, u, strict=True):
#         x = x + move + slip
#         if np.isfinite(reading):
#             expected = np.abs(x[:, None] - doors).min(axis=1)
#             weights = new_weights(weights, -0.5 * ((reading - expected) / sigma) ** 2)
#         if effective_sample_size(weights) < len(x) / 2:
#             x = x[resample(weights, offset)]
#     return x, weights
#
# check_localize(weights_kept)

# %% [markdown] tags=["solution"]
# How many particles does it take? A hundred drives of forty steps, the same ones with 10, 50 and
# 500: how often does the mean end within half a metre of the robot?

# %% active="ipynb" tags=["solution"]
# doors = np.array([1.0, 4.0, 5.5, 11.0])
# for M in (10, 50, 500):
#     found = 0
#     for seed in range(100):
#         rng = np.random.default_rng(seed)
#         moves = np.full(40, 0.25)
#         place = rng.uniform(0, 3) + np.cumsum(moves + rng.normal(0, 0.05, 40))
#         z = np.abs(place[:, None] - doors).min(axis=1) + rng.normal(0, 0.2, 40)
#         noise = rng.normal(0, 0.05, (40, M))
#         start, u = rng.uniform(0, 3, M), rng.random(40)
#         x, w = localize(start, moves, noise, z, doors, 0.2, u)
#         found += abs(w @ x - place[-1]) < 0.5
#     print(f"{M:4d} particles: {found} of 100 drives")

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 04](../solutions/04_particle_filter.ipynb).
