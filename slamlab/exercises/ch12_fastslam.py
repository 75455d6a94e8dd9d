"""Exercises, chapter 12: the weight of a landmark, the proposal of 2.0, copies, ancestors.

P2 (15) is the weight, (18) the proposal; copies and ancestors are its step 3.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, drawn
from slamlab.exercises._report import Array, Check, Function, Ints
from slamlab.geometry import wrap_angle

__all__ = [
    "check_ancestors",
    "check_copies",
    "check_observe_landmark",
    "check_proposal",
    "check_weight",
]


# %% [markdown] tags=["chapter"]
# # Exercises 12: FastSLAM
#
# Five exercises, four functions that FastSLAM stands on and one step of all particles; the
# chapter is [FastSLAM](../12_fastslam.ipynb). Replace each `...` and run the check below it as
# often as you like.

# %% [markdown] tags=["solution"]
# # Solutions 12: FastSLAM
#
# The exercises are in [Exercises 12](../exercises/12_fastslam.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: the weight of a landmark
#
# Formula (15) of P2 for one Gaussian landmark: the particle predicts a measurement, the
# innovation is $y$, and the landmark itself is known only up to its covariance $S$. How likely
# was the measurement?


# %% tags=["exercise"]
def log_weight(y: Array, H: Array, S: Array, R: Array) -> float:
    """Logarithm of the likelihood (15) of one measurement.

    Parameters
    ----------
    y : ndarray, shape (2,)
        Innovation (m, rad).
    H : ndarray, shape (2, 2)
        Jacobian of the measurement with respect to the landmark.
    S : ndarray, shape (2, 2)
        Covariance of the landmark in this particle (m^2).
    R : ndarray, shape (2, 2)
        Covariance of the sensor.

    Returns
    -------
    float
    """
    Z = H @ S @ H.T + R
    d2 = y @ np.linalg.solve(Z, y)
    return -0.5 * d2 - 0.5 * np.log(np.linalg.det(Z)) - np.log(2 * np.pi)


# %% active="ipynb" tags=["try"]
# log_weight(np.array([0.1, 0.0]), np.eye(2), 0.2 * np.eye(2), 0.01 * np.eye(2))

# %% [markdown] tags=["hint"]
# If the landmark moves by $\delta$, the measurement moves by $H\delta$. What is the covariance of
# $H\delta$?

# %% [markdown] tags=["hint"]
# A normal density in two dimensions is $\exp(-\tfrac12 y^\top Z^{-1} y) / (2\pi\sqrt{\det Z})$.

# %% [markdown] tags=["hint"]
# `Z = H @ S @ H.T + R`; `y @ np.linalg.solve(Z, y)` is the quadratic form,
# `np.log(np.linalg.det(Z))` the logarithm of the determinant.


# %% tags=["cases"]
@drawn
def _seen(rng: np.random.Generator, uncertainty: float) -> Any:
    y, H = np.round(rng.normal(0, 0.4, 2), 2), np.round(rng.normal(0, 1, (2, 2)), 2)
    return y, H, uncertainty * a_covariance(rng, 2, 0.3), a_covariance(rng, 2, 0.05)


def _weight_drawn(ax: Any, function: Any) -> None:
    """Draw the density of the innovation of a range, for three uncertainties of the landmark."""
    from slamlab import plots

    y = np.linspace(-1.2, 1.2, 81)
    for sigma in (0.05, 0.2, 0.4):
        S, R = np.diag([sigma**2, 1e-4]), np.diag([0.01, 0.01])
        density = [np.exp(float(function(np.array([r, 0.0]), np.eye(2), S, R))) for r in y]
        ax.plot(y, density, color=plots.COLOURS["estimate"], lw=2 - 3 * sigma)
        side = np.hypot(sigma, 0.1)
        ax.text(side, np.interp(side, y, density), f" {sigma:.2f} m", va="bottom")
    ax.set(xlabel="innovation of the range (m)", ylabel="density")


check_weight = Check(
    log_weight,
    "log weight",
    {
        "a tree seen from the side": _seen(1.0),
        "a tree that is almost known": _seen(0.01),
        "a tree that is known exactly": _seen(0.0),
        "no innovation at all": lambda rng: (np.zeros(2), *_seen(1.0)(rng)[1:]),
        "an exact sensor: a density may be above one": (
            [0.02, -0.01],
            [[0.8, 0.3], [-0.4, 1.1]],
            0.0004 * np.eye(2),
            0.0009 * np.eye(2),
        ),
        "a surprise": lambda rng: (np.array([2.5, -1.5]), *_seen(1.0)(rng)[1:]),
        "a surprise whose density underflows": lambda rng: (
            np.array([60.0, -50.0]),
            *_seen(0.1)(rng)[1:],
        ),
    },
    tolerance=1e-8,
    picture=_weight_drawn,
)

# %% tags=["mistakes"]
_DETERMINANT = " - 0.5 * np.log(np.linalg.det(Z))"


check_weight.mistakes = {
    "R alone: the landmark is uncertain too, add H S H^T": "H @ S @ H.T + R => R",
    "S and R live in different spaces: turn S by H before they are added": (
        "H @ S @ H.T + R => S + R"
    ),
    "this is H^T S H: the Jacobian stands the other way round": "H @ S @ H.T => H.T @ S @ H",
    "the second H is not transposed: H S H^T": "@ H.T => @ H",
    "R is missing: the sensor has noise too": " + R => ",
    "R counts twice": "+ R => + 2 * R",
    "R is a covariance already: it is not squared": "+ R => + R @ R",
    "the determinant is missing: it separates an uncertain landmark from a certain one": (
        f"{_DETERMINANT} => "
    ),
    "expected the root of the determinant: its logarithm counts half": (
        f"{_DETERMINANT} =>  - np.log(np.linalg.det(Z))"
    ),
    "the determinant has the wrong sign: an uncertain landmark spreads its likelihood": (
        f"{_DETERMINANT} =>  + 0.5 * np.log(np.linalg.det(Z))"
    ),
    "the 2 pi is missing: new landmarks and known ones are compared by their likelihood": (
        " - np.log(2 * np.pi) => "
    ),
    "the 2 pi stands there for one dimension: two numbers were measured": (
        "- np.log(2 * np.pi) => - 0.5 * np.log(2 * np.pi)"
    ),
    "this is the density: expected its logarithm": lambda *given: np.exp(log_weight(*given)),
    "this is the logarithm of the density after it underflowed": (
        lambda *given: np.log(np.exp(log_weight(*given)))
    ),
    "one half is missing in front of the quadratic form": ("-0.5 * d2 => -d2"),
    "the logarithm is the natural one: log, not log10": (
        lambda *given: log_weight(*given) / np.log(10.0)
    ),
    "Z was multiplied, not inverted": "np.linalg.solve(Z, y) => Z @ y",
    "the sign is turned: a large innovation makes a small weight": (
        lambda *given: -log_weight(*given)
    ),
    "the distance alone was returned: (15) is a likelihood": lambda y, H, S, R: (
        y @ np.linalg.solve(H @ S @ H.T + R, y)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: the weight of a landmark
#
# The innovation has two causes, the landmark and the sensor. They are independent, so their
# covariances add, once both are in the space of the measurement.

# %% [markdown] tags=["solution"]
# Leaving out the determinant looks harmless, because "constants do not matter". It is no
# constant: particles know their landmarks differently well, and without it those that know least
# fit best.

# %% active="ipynb" tags=["solution"]
# def without_determinant(y, H, S, R):
#     Z = H @ S @ H.T + R
#     return -0.5 * y @ np.linalg.solve(Z, y) - np.log(2 * np.pi)
#
# check_weight(without_determinant)

# %% [markdown] tags=["statement"]
# ## Exercise 2: the proposal of version 2.0
#
# Formula (18): the proposal of version 2.0 is the product of what the odometry says (a Gaussian
# around `x` with covariance `Q`) and what one measurement says (an innovation `y` at `x`, with
# Jacobian `H` with respect to the pose, and covariance `Z`, the landmark's share included).


# %% tags=["exercise"]
def proposal(x: Array, Q: Array, H: Array, Z: Array, y: Array) -> tuple[Any, Any]:
    """Gaussian proposal of FastSLAM 2.0 after one measurement.

    Parameters
    ----------
    x : ndarray, shape (3,)
        Predicted pose (m, m, rad).
    Q : ndarray, shape (3, 3)
        Its covariance, invertible.
    H : ndarray, shape (2, 3)
        Jacobian of the measurement with respect to the pose.
    Z : ndarray, shape (2, 2)
        Covariance of the measurement if the pose were known.
    y : ndarray, shape (2,)
        Measurement minus prediction.

    Returns
    -------
    mean : ndarray, shape (3,)
    cov : ndarray, shape (3, 3)
    """
    P = np.linalg.inv(np.linalg.inv(Q) + H.T @ np.linalg.solve(Z, H))
    return x + P @ H.T @ np.linalg.solve(Z, y), P


# %% active="ipynb" tags=["try"]
# H = np.array([[-1.0, 0.0, 0.0], [0.0, -0.5, -1.0]])
# proposal(np.zeros(3), 0.04 * np.eye(3), H, 0.01 * np.eye(2), np.array([0.1, 0.0]))

# %% [markdown] tags=["hint"]
# Information adds: inverse covariances of independent Gaussians about one unknown may be summed.
# A measurement speaks about the pose through $H$.

# %% [markdown] tags=["hint"]
# $P = (Q^{-1} + H^\top Z^{-1} H)^{-1}$. The mean moves from `x` by $P$ times something that pulls.

# %% [markdown] tags=["hint"]
# The pull is $H^\top Z^{-1} y$. (A Kalman gain gives the same two results.)


# %% tags=["cases"]
@drawn
def _odometry(rng: np.random.Generator, noise: float, surprise: float = 1.0) -> Any:
    x, y, H = (np.round(rng.normal(0, 1, shape), 2) for shape in (3, 2, (2, 3)))
    return x, a_covariance(rng, 3, 0.1), H, noise * a_covariance(rng, 2), surprise * y


def _proposal_drawn(ax: Any, function: Any) -> None:
    """Draw particles of the odometry, the robot, and the ellipse of the proposal."""
    from slamlab import plots
    from slamlab.sensors import RangeBearing

    rng, sensor = np.random.default_rng(3), RangeBearing(0.05, 0.02)
    truth, tree = np.array([1.25, -0.1, 0.1]), np.array([3.0, 1.5])
    x, Q = np.array([1.0, 0.0, 0.0]), np.diag([0.2, 0.15, 0.1]) ** 2
    odometry = x + rng.standard_normal((300, 3)) * np.sqrt(np.diag(Q))
    H, H_tree = sensor.jacobians(x, tree)
    Z = H_tree @ (0.02**2 * np.eye(2)) @ H_tree.T + sensor.cov
    y = sensor.residual(sensor.observe(truth, tree), sensor.observe(x, tree))
    plots.lidar_points(ax, odometry[:, :2], s=1.6)
    ax.plot(*truth[:2], "+", color=plots.COLOURS["truth"], markersize=14)
    mean, cov = (np.asarray(part, float) for part in function(x, Q, H, Z, y))
    plots.ellipse(ax, mean[:2], cov[:2, :2])
    ax.plot(*mean[:2], "o", color=plots.COLOURS["estimate"], markersize=4)
    ax.set_aspect("equal")
    ax.set(xlabel="x (m)", ylabel="y (m)")


check_proposal = Check(
    proposal,
    "mean, cov",
    {
        "measurement and odometry disagree": _odometry(0.05),
        "no innovation: only the covariance shrinks": _odometry(0.05, 0.0),
        "a dull sensor changes little": _odometry(20.0),
        "a sharp sensor": _odometry(0.002),
    },
    tolerance=1e-8,
    picture=_proposal_drawn,
)

# %% tags=["mistakes"]
check_proposal.mistakes = {
    "this is the motion model, version 1.0: the measurement was not used": (
        lambda x, Q, H, Z, y: (x.copy(), Q.copy())
    ),
    "the covariance shrinks, but the mean must move too": (
        "x + P @ H.T @ np.linalg.solve(Z, y) => x.copy()"
    ),
    "the mean moves the wrong way: y is the measurement minus its prediction": ("x + P => x - P"),
    "this is the information matrix: invert it": (
        "solve(Z, y), P => solve(Z, y), np.linalg.inv(P)"
    ),
    "the pull uses Q: it must be the new covariance P": "x + P => x + Q",
    "Z must be inverted: a noisy measurement pulls less": (
        ("np.linalg.solve(Z, H) => Z @ H"),
        ("np.linalg.solve(Z, y) => Z @ y"),
    ),
    "Z is missing: its inverse weighs the measurement": (
        (("np.linalg.solve(Z, H) => H"), ("np.linalg.solve(Z, y) => y"))
    ),
    "Z is missing in the mean: its inverse weighs the innovation": ("np.linalg.solve(Z, y) => y"),
    "Q must be inverted: what each source knows adds up": "np.linalg.inv(Q) + => Q +",
    "Q was left out: odometry and measurement speak together": (
        "np.linalg.inv(np.linalg.inv(Q) + H.T @ np.linalg.solve(Z, H))"
        " => np.linalg.pinv(H.T @ np.linalg.solve(Z, H))"
    ),
    "covariances were added: their inverses add up": (
        "np.linalg.inv(np.linalg.inv(Q) + H.T @ np.linalg.solve(Z, H)) => Q + H.T @ Z @ H"
    ),
    "the step alone was returned: add it to x": "x + P @ H => P @ H",
    "Z is missing in the gain: K = Q H^T (H Q H^T + Z)^-1": (
        lambda x, Q, H, Z, y: (
            x + Q @ H.T @ np.linalg.solve(H @ Q @ H.T, y),
            Q - Q @ H.T @ np.linalg.solve(H @ Q @ H.T, H @ Q),
        )
    ),
    "the mean has moved, the covariance must shrink too": (
        lambda x, Q, H, Z, y: (proposal(x, Q, H, Z, y)[0], Q.copy())
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: the proposal of version 2.0
#
# Two Gaussians about the same pose are multiplied by adding their information.

# %% [markdown] tags=["solution"]
# With a sharp sensor, a version 2.0 that shrinks the cloud but leaves it where the odometry put it
# is worse than version 1.0: it draws all its particles in the wrong place.

# %% active="ipynb" tags=["solution"]
# def stays(x, Q, H, Z, y):
#     return x, np.linalg.inv(np.linalg.inv(Q) + H.T @ np.linalg.solve(Z, H))
#
# check_proposal(stays)

# %% [markdown] tags=["statement"]
# ## Exercise 3: copies that stay apart
#
# Resampling has chosen the particles. Each map is an array of landmarks. The check lets every
# particle of the new set write into its own first landmark, and then compares all maps, the new
# and the old.


# %% tags=["exercise"]
def copy_particles(maps: list[Array], chosen: Ints) -> list[Array]:
    """Maps of the particles after resampling.

    Parameters
    ----------
    maps : list of M ndarrays, shape (n, 2) each
        Landmarks of every particle (m).
    chosen : ndarray of int, shape (M,)
        New particle i is a copy of old particle chosen[i].

    Returns
    -------
    list of M ndarrays, shape (n, 2) each
        Each may be changed without changing another, or an old one.
    """
    return [maps[i].copy() for i in chosen]


# %% active="ipynb" tags=["try"]
# copy_particles([np.zeros((1, 2)), np.ones((1, 2))], np.array([1, 1]))

# %% [markdown] tags=["hint"]
# `a = b` gives a second name to the same array. Which of your arrays have two names?

# %% [markdown] tags=["hint"]
# `array.copy()` is a new array. One of them for each *new* particle.


# %% tags=["cases"]
def _written(copy: Function, maps: list[Array], chosen: Ints) -> Any:
    """Copy, then let every particle write its number into its first landmark."""
    kept = [one.copy() for one in maps]
    after = list(copy(kept, chosen))
    for number, one in enumerate(after):
        one[0] = number
    return np.array(after), np.array(kept)


def _resampled(rng: np.random.Generator) -> Any:
    m, n = rng.integers(2, 7, 2)
    return list(np.round(rng.normal(0, 5, (m, n, 2)), 1)), rng.integers(0, m, m)


def _copies_drawn(ax: Any, function: Any) -> None:
    """Draw the maps of four copies, after each has moved its own first landmark."""
    from slamlab import plots

    triangle = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 1.5]])
    maps = [triangle + np.array([3.0 * i, 0.3 * i]) for i in range(3)]
    copies = list(function(maps, np.array([0, 1, 1, 1])))
    for number, one in enumerate(copies):
        one[0] = one[2] + np.array([0.7 * number - 0.7, -3.0])
    for number, one in enumerate(copies):
        corners = np.vstack([one, one[:1]])
        ax.plot(*corners.T, marker="osvD"[number], color=plots.COLOURS["estimate"], lw=0.8, ms=5)
    ax.set_aspect("equal")
    ax.set(xlabel="x (m)", ylabel="y (m)")


_MAPS = list(10.0 * np.arange(1, 5)[:, None, None] + np.arange(4).reshape(2, 2))


check_copies = Check(
    copy_particles,
    "new maps, old maps",
    {
        "one particle survives twice, one is eliminated": (_MAPS, [0, 1, 1, 3]),
        "one particle survives alone": (_MAPS, [2, 2, 2, 2]),
        "all survive, in another order": (_MAPS, [3, 0, 1, 2]),
        "a single particle": (_MAPS[:1], [0]),
        "any draw": _resampled,
    },
    use=_written,
    picture=_copies_drawn,
)


# %% tags=["mistakes"]
def _shared(maps: list[Array], chosen: Ints) -> list[Array]:
    """Copy each chosen particle once only."""
    fresh = {int(i): maps[i].copy() for i in chosen}
    return [fresh[int(i)] for i in chosen]


def _counts(maps: list[Array], chosen: Ints) -> list[Array]:
    new = [m.copy() for m, n in zip(maps, chosen, strict=True) for _ in range(int(n))]
    return (new + [m.copy() for m in maps])[: len(chosen)]


check_copies.mistakes = {
    "nothing was copied: these are the old arrays, and copies of one particle are one array": (
        "maps[i].copy() => maps[i]"
    ),
    "copies of the same particle share one array: each needs its own": _shared,
    "the first copy of each particle is the old array itself: copy that one too": (
        lambda maps, chosen: [
            maps[i] if i not in list(chosen[:k]) else maps[i].copy() for k, i in enumerate(chosen)
        ]
    ),
    "the particles are still the old ones: take those that were chosen": (
        lambda maps, chosen: [m.copy() for m in maps]
    ),
    "`chosen` holds indices, not numbers of copies": _counts,
    "each chosen particle was returned once: one chosen twice must be returned twice": (
        "for i in chosen => for i in sorted(set(chosen.tolist()))"
    ),
    "the order is lost: copy number i comes from particle chosen[i]": (
        "for i in chosen => for i in chosen[::-1]"
    ),
    "the copies were sorted: copy number i comes from particle chosen[i]": (
        "for i in chosen => for i in sorted(chosen)"
    ),
    "the old maps were overwritten: the new set is made of new arrays": (
        lambda maps, chosen: _overwritten(maps, chosen)
    ),
    "counted from one: particle 0 is the first": "maps[i] => maps[i - 1]",
}

# %% [markdown] tags=["solution"]
# ## Solution 3: copies that stay apart

# %% [markdown] tags=["solution"]
# Without `.copy()` the program runs, draws a map, and raises nothing. Every copy of a particle
# then writes into one array, and the map is that of the particle that wrote last:

# %% active="ipynb" tags=["solution"]
# def shared(maps, chosen):
#     return [maps[i] for i in chosen]
#
# check_copies(shared)

# %% [markdown] tags=["solution"]
# The library copies neither: it shares pages of 64 landmarks, counts their owners, and copies a
# page when one of several owners writes to it.

# %% [markdown] tags=["statement"]
# ## Exercise 4: ancestors
#
# `parents[t]` is what resampling number t has drawn: row i of the set after it came from row
# `parents[t][i]` of the set before it. For every t, how many rows of the set before it have a
# descendant in the last set?


# %% tags=["exercise"]
def distinct_ancestors(parents: Ints) -> Ints:
    """Number of particles before each resampling that have living descendants.

    Parameters
    ----------
    parents : ndarray of int, shape (T, M)

    Returns
    -------
    ndarray of int, shape (T,)
    """
    rows, counts = np.arange(parents.shape[1]), []
    for one in parents[::-1]:
        rows = one[rows]
        counts.append(len(np.unique(rows)))
    return np.array(counts[::-1])


# %% active="ipynb" tags=["try"]
# distinct_ancestors(np.array([[0, 0, 1, 3], [1, 2, 2, 3]]))

# %% [markdown] tags=["hint"]
# Begin at the end: after the last resampling, all M rows are alive.

# %% [markdown] tags=["hint"]
# If `rows` are the ancestors of all particles after resampling t, then `parents[t][rows]` are
# those before it.

# %% [markdown] tags=["hint"]
# Loop over `parents[::-1]`, count `len(np.unique(rows))`, and turn the list of counts round at
# the end.


# %% tags=["cases"]
def _history(rng: np.random.Generator) -> Any:
    steps, m = rng.integers(1, 9), rng.integers(2, 30)
    return (np.sort(rng.integers(0, m, (steps, m)), axis=1),)


def _ancestors_drawn(ax: Any, function: Any) -> None:
    """Draw the number of ancestors before each of forty resamplings of thirty particles."""
    from slamlab import plots

    rng = np.random.default_rng(1)
    parents = np.sort(rng.choice(30, (40, 30), p=np.arange(1, 31) / 465), axis=1)
    counts = [float(count) for count in function(parents)]
    ax.plot(np.arange(40), counts, drawstyle="steps-post", color=plots.COLOURS["estimate"])
    ax.set(xlabel="resampling", ylabel="particles with descendants", ylim=(0, 31))


check_ancestors = Check(
    distinct_ancestors,
    "counts",
    {
        "no particle is ever eliminated": (np.tile(np.arange(4), (3, 1)),),
        "two steps": ([[0, 0, 1, 3], [1, 2, 2, 3]],),
        "one particle takes all in the middle": ([[0, 1, 2, 3], [2, 2, 2, 2], [0, 1, 1, 3]],),
        "a single resampling": ([[1, 1, 2]],),
        "not sorted": lambda rng: (rng.integers(0, 6, (4, 6)),),
        "any history": _history,
    },
    picture=_ancestors_drawn,
)


# %% tags=["mistakes"]
def _overwritten(maps: list[Array], chosen: Ints) -> list[Array]:
    new = [maps[i].copy() for i in chosen]
    for old, one in zip(maps, new, strict=True):
        old[...] = one
    return new


check_ancestors.mistakes = {
    "each resampling was counted alone: follow the lines through all later ones": (
        lambda parents: np.array([len(np.unique(one)) for one in parents])
    ),
    "this counts living lines of the first step: walk back from the end": (
        "in parents[::-1] => in parents",
        "rows = one[rows] => rows = rows[one]",
        "counts[::-1] => counts",
    ),
    "composed the wrong way round: the parent of row i is parents[t][i]": (
        "one[rows] => rows[one]"
    ),
    "off by one step: resampling t is counted before it is followed": (
        lambda parents: np.append(distinct_ancestors(parents)[1:], parents.shape[1])
    ),
    "the steps are in reverse order": "counts[::-1] => counts",
    "these are shares: expected the numbers themselves": (
        lambda parents: distinct_ancestors(parents) / parents.shape[1]
    ),
    "one number was returned: each resampling has its own": (
        lambda parents: distinct_ancestors(parents)[0]
    ),
    "this is the running minimum of the single counts, which only bounds the living lines": (
        lambda parents: np.minimum.accumulate([len(np.unique(p)) for p in parents[::-1]])[::-1]
    ),
    "this counts those without descendants": (
        lambda parents: parents.shape[1] - distinct_ancestors(parents)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: ancestors

# %% [markdown] tags=["solution"]
# Counting what each resampling drew counts one generation only. By that count many particles
# survive every step, while the lines die out:

# %% active="ipynb" tags=["solution"]
# def one_generation(parents):
#     return np.array([len(np.unique(one)) for one in parents])
#
# check_ancestors(one_generation)

# %% [markdown] tags=["statement"]
# ## Exercise 5: one observation, all particles
#
# Assemble a step of FastSLAM 1.0. Every particle has a pose and its own idea of one landmark, a
# mean and a covariance. A measurement of range and bearing comes in. Each particle updates its
# landmark with a small Kalman filter, and its weight is multiplied by the probability density of
# the measurement, given *its* pose and *its* landmark.


# %% tags=["exercise"]
def observe_landmark(
    poses: Array, weights: Array, means: Array, covs: Array, z: Array, R: Array
) -> tuple[Array, Array, Array]:
    """One measurement of one landmark, taken in by every particle.

    Parameters
    ----------
    poses : ndarray, shape (M, 3)
    weights : ndarray, shape (M,)
    means : ndarray, shape (M, 2)
        Where each particle takes the landmark to be (m).
    covs : ndarray, shape (M, 2, 2)
    z : ndarray, shape (2,)
        Range (m) and bearing (rad).
    R : ndarray, shape (2, 2)
        Covariance of z.

    Returns
    -------
    weights : ndarray, shape (M,)
        They sum to one.
    means : ndarray, shape (M, 2)
    covs : ndarray, shape (M, 2, 2)
    """
    new_means, new_covs, log = [], [], []
    for pose, mean, cov in zip(poses, means, covs, strict=True):
        d = mean - pose[:2]
        squared = d @ d
        rho = np.sqrt(squared)
        H = np.array([[d[0] / rho, d[1] / rho], [-d[1] / squared, d[0] / squared]])
        bearing = np.arctan2(d[1], d[0]) - pose[2]
        v = np.array([z[0] - rho, wrap_angle(z[1] - bearing)])
        S = H @ cov @ H.T + R
        K = cov @ H.T @ np.linalg.inv(S)
        new_means.append(mean + K @ v)
        new_covs.append(cov - K @ S @ K.T)
        log.append(-0.5 * v @ np.linalg.inv(S) @ v - 0.5 * np.log(np.linalg.det(S)))
    new = weights * np.exp(np.array(log) - max(log))
    return new / new.sum(), np.array(new_means), np.array(new_covs)


# %% active="ipynb" tags=["try"]
# observe_landmark(np.zeros((2, 3)), np.array([0.5, 0.5]), np.array([[2.0, 0], [3.0, 0]]),
#      np.array([np.eye(2)] * 2), np.array([2.1, 0.1]), 0.01 * np.eye(2))

# %% [markdown] tags=["hint"]
# Write it for one particle first: predicted measurement, derivative with respect to the landmark,
# innovation (wrapped), $S = H P H^\top + R$, gain.

# %% [markdown] tags=["hint"]
# Which uncertainty is in the density of $z$? The pose of a particle is certain; its landmark is
# not.

# %% [markdown] tags=["hint"]
# A factor that is the same for all particles drops out. $\sqrt{\det S}$ is not the same for all.


# %% tags=["cases"]
@drawn
def _particles(rng: np.random.Generator, n: int, alike: bool = False, past: bool = False) -> Any:
    poses = np.array([a_pose(rng, 1.0) for _ in range(n)])
    poses[:, 2] = rng.normal(3.0 if past else 0.3, 0.1, n)
    means = poses[:, :2] + np.round(rng.normal([-4.0 if past else 4.0, -0.5], 0.5, (n, 2)), 2)
    covs = np.array(
        [a_covariance(rng, 2, 0.1 if alike else float(10 ** rng.uniform(-2, 0))) for _ in range(n)]
    )
    d = means[0] - poses[0, :2]
    bearing = wrap_angle(np.arctan2(d[1], d[0]) - poses[0, 2])
    z = np.round([np.hypot(*d), bearing] + rng.normal(0, 0.1, 2), 3)
    w = rng.random(n) + 0.1
    return poses, w / w.sum(), means, covs, z, a_covariance(rng, 2, 0.02)


def _observe_landmark_drawn(ax: Any, function: Any) -> None:
    """Draw five particles, as large as their weights, with the ellipses of their landmarks."""
    from slamlab import plots

    rng = np.random.default_rng(6)
    tree, weights = np.array([4.0, 2.5]), np.full(5, 0.2)
    poses = np.column_stack([rng.normal(0, 0.3, 5), 0.8 * np.arange(5), rng.normal(0, 0.1, 5)])
    means = tree + rng.normal(0, 0.4, (5, 2))
    covs = np.array([size * np.array([[0.2, 0.05], [0.05, 0.1]]) for size in (1, 1, 3, 1, 0.3)])
    z, R = np.array([4.1, 0.3]), np.diag([0.1, 0.05]) ** 2
    new, means, covs = (np.asarray(part) for part in function(poses, weights, means, covs, z, R))
    plots.landmarks(ax, tree[None])
    for pose, w, mean, cov in zip(poses, new, means, covs, strict=True):
        ax.plot(*pose[:2], "o", color=plots.COLOURS["particle"], markersize=3 + 14 * float(w))
        ax.plot(*np.array([pose[:2], mean]).T, color=plots.COLOURS["particle"], lw=0.6)
        ax.text(pose[0] - 0.4, pose[1], f"{float(w):.2f}", ha="right", va="center", fontsize=9)
        plots.ellipse(ax, mean, cov)
    ax.set_aspect("equal")
    ax.set(xlabel="x (m)", ylabel="y (m)")


check_observe_landmark = Check(
    observe_landmark,
    "weights, means, covs",
    {
        "one particle": _particles(1),
        "two particles that know the landmark equally well": _particles(2, alike=True),
        "particles that know it more and less well": _particles(5),
        "a landmark ahead, across half a turn": _particles(4, past=True),
        "a landmark ahead, across half a turn from the other side": (
            [[0.0, 0.0, -3.0]],
            [1.0],
            [[-4.0, 0.4]],
            [0.1 * np.eye(2)],
            [4.1, -0.3],
            0.01 * np.eye(2),
        ),
        "an innovation across half a turn, both bearings in (-pi, pi]": (
            np.array([[0.0, 0.0, 0.0], [0.1, 0.3, 0.0]]),
            np.array([0.5, 0.5]),
            np.array([[-4.0, 0.16], [-4.0, -0.1]]),
            np.array([0.05 * np.eye(2), 0.02 * np.eye(2)]),
            np.array([4.1, -3.1]),
            np.diag([0.02, 0.01]),
        ),
        "a surprise to all of them": lambda rng: (
            *(given := _particles(3)(rng))[:4],
            given[4] + np.array([30.0, 0.0]),
            given[5],
        ),
    },
    tolerance=1e-6,
    picture=_observe_landmark_drawn,
)


# %% tags=["mistakes"]
def _weighed_late(poses: Array, w: Array, means: Array, covs: Array, z: Array, R: Array) -> Any:
    """Correct the landmarks first, and weigh with what came."""
    _, new_means, new_covs = observe_landmark(poses, w, means, covs, z, R)
    return observe_landmark(poses, w, new_means, new_covs, z, R)[0], new_means, new_covs


check_observe_landmark.mistakes = {
    "the expected bearing was wrapped, the innovation was not: wrap their difference": (
        "wrap_angle(z[1] - bearing) => z[1] - wrap_angle(bearing)"
    ),
    "the weight was computed with R alone: the landmark is uncertain too, S = H P H^T + R": (
        "np.linalg.inv(S) @ v - 0.5 * np.log(np.linalg.det(S)) => np.linalg.inv(R) @ v"
    ),
    "the determinant is missing: a wide density is low everywhere": (
        " - 0.5 * np.log(np.linalg.det(S)) => "
    ),
    "the determinant stands without its root: -1/2 log det S": (
        "- 0.5 * np.log(np.linalg.det => - np.log(np.linalg.det"
    ),
    "the determinant has the wrong sign": (
        "- 0.5 * np.log(np.linalg.det => + 0.5 * np.log(np.linalg.det"
    ),
    "the half in the exponent is missing": ("log.append(-0.5 * v => log.append(-1.0 * v"),
    "the densities underflow: subtract the largest logarithm before the exponential": (
        "np.exp(np.array(log) - max(log)) => np.exp(np.array(log))"
    ),
    "the old weights are forgotten": "new = weights * np.exp => new = np.exp",
    "the weights do not sum to one: divide by their sum": "new / new.sum(), => new,",
    "divided by the largest weight: they must sum to one": ("new / new.sum() => new / new.max()"),
    "the bearing is not wrapped": "wrap_angle(z[1] - bearing) => z[1] - bearing",
    "the heading of each particle must be taken off the bearing": (
        "np.arctan2(d[1], d[0]) - pose[2] => np.arctan2(d[1], d[0])"
    ),
    "R is missing in S": ("cov @ H.T + R => cov @ H.T"),
    "the covariances did not shrink: expected P - K S K^T": ("cov - K @ S @ K.T => cov.copy()"),
    "the means did not move": ("mean + K @ v => mean.copy()"),
    "the innovation has the wrong sign: measured minus predicted": (
        "mean + K @ v => mean - K @ v"
    ),
    "all particles observe from the pose of the first: each has its own": (
        lambda poses, *rest: observe_landmark(np.repeat(poses[:1], len(poses), 0), *rest)
    ),
    "the likelihood was taken after the correction: weigh with the landmark as it was before": (
        lambda *given: _weighed_late(*given)
    ),
    "all particles share the map of the first": lambda poses, w, means, covs, z, R: (
        observe_landmark(
            poses, w, np.repeat(means[:1], len(w), 0), np.repeat(covs[:1], len(w), 0), z, R
        )
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: one observation, all particles
#
# A loop over the particles is right as well; `einsum` does them all at once. What to notice: the
# weight uses $S$, not $R$. For a particle with an uncertain landmark few measurements are far
# off, but the density at the centre of a wide bell is low: that is what the determinant says.

# %% [markdown] tags=["solution"]
# With $R$ alone in the weight the error of the landmark counts as if the sensor had made it:
# particles that happened to start their landmark well take over:

# %% active="ipynb" tags=["solution"]
# def weighed_by_sensor_noise(poses, weights, means, covs, z, R):
#     _, new_means, new_covs = observe_landmark(poses, weights, means, covs, z, R)
#     d = means - poses[:, :2]
#     bearing = np.arctan2(d[:, 1], d[:, 0]) - poses[:, 2]
#     v = np.stack([z[0] - np.hypot(*d.T), wrap_angle(z[1] - bearing)], -1)
#     log = -0.5 * np.einsum("mi,ij,mj->m", v, np.linalg.inv(R), v)
#     new = weights * np.exp(log - log.max())
#     return new / new.sum(), new_means, new_covs
#
# check_observe_landmark(weighed_by_sensor_noise)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 12](../solutions/12_fastslam.ipynb).
