"""Exercises, chapter 13: a loop on a line, a radio edge, frames, kernels, a whole graph.

Formulas (A), (C), (E) and (F) of the lesson; Grisetti et al. 2010, Agarwal et al. 2013.
"""

# mypy: disable-error-code="return-value"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.datasets import manhattan_graph
from slamlab.exercises._draw import a_covariance, a_pose, an_angle, drawn
from slamlab.exercises._report import Array, Check, Function, Mask
from slamlab.geometry import between, compose, rotation
from slamlab.slam import PoseGraph, edge_error, edge_jacobians

__all__ = [
    "check_information",
    "check_line",
    "check_map",
    "check_narrowest",
    "check_one_width",
    "check_range_edge",
]


# %% [markdown] tags=["chapter"]
# # Exercises 13: pose graphs
#
# Six exercises on robots that come back: a loop with a pencil, two robots with a radio, a bug to
# find, a kernel read backwards, a kernel to tune, and a town in which six closures are false.
# There wheels alone are 5.8 m off and all closures together 10 m; the function that you write
# last makes half a metre of it. The chapter is [Pose graphs](../13_pose_graphs.ipynb). Replace
# each `...` and run the check below it as often as you like; then draw what you built beside what
# is expected.

# %% [markdown] tags=["solution"]
# # Solutions 13: pose graphs
#
# The exercises are in [Exercises 13](../exercises/13_pose_graphs.ipynb). Try them first: a check
# that has named your own slip teaches more than this page.

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.exercises.ch13_pose_graphs import laser_town
# from slamlab.geometry import compose, rotation
# from slamlab.slam import PoseGraph

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
#
# from slamlab.datasets import manhattan_graph, town_with_false_closures
# from slamlab.evaluation import ate
# from slamlab.exercises.ch13_pose_graphs import laser_town
# from slamlab.geometry import between, compose, rotation
# from slamlab.slam import PoseGraph

# %% [markdown] tags=["statement"]
# ## Exercise 1: a loop on a line, without a matrix (pencil first)
#
# A vacuum cleaner drives along a corridor. Its processor adds and divides, but cannot solve
# linear systems. Pose 0 is at 0; step $k$ leads from pose $k$ to pose $k + 1$ and was measured
# as $z_k$ with the variance $s_k$, on smooth floor a small one, on the carpet a large one. One
# closure measures $x_b - x_a$ as $c$ with the variance $R$. Where are the poses that make
#
# $$
# \sum_k \frac{(x_{k+1} - x_k - z_k)^2}{s_k} + \frac{(x_b - x_a - c)^2}{R}
# $$
#
# least? In the lesson three edges with equal variances shared 0.3 m equally. Take its three poses
# again, but let the second step have twice the variance, and set both derivatives to zero: which
# share does each of the three edges take? Then write the answer for any number of steps.


# %% tags=["exercise"]
def line(z: Array, variances: Array, before: int, after: int, closure: float, R: float) -> Array:
    """Best positions on a line with one closure.

    Parameters
    ----------
    z : ndarray, shape (n,)
        Measured steps, step k from pose k to pose k + 1 (m).
    variances : ndarray, shape (n,)
        Their variances (m^2), positive.
    before, after : int
        The closure joins these poses, 0 <= before < after <= n.
    closure : float
        Position of pose `after` less that of pose `before`, as measured (m).
    R : float
        Variance of the closure (m^2), positive.

    Returns
    -------
    ndarray, shape (n + 1,)
        Positions of all poses, the first is 0 (m).
    """
    steps = z.copy()
    missing = closure - z[before:after].sum()
    total = variances[before:after].sum() + R
    steps[before:after] += missing * variances[before:after] / total
    return np.r_[0.0, np.cumsum(steps)]


# %% active="ipynb" tags=["try"]
# line(np.array([1.0, 1.0]), np.ones(2), 0, 2, 2.3, 1.0)

# %% [markdown] tags=["hint"]
# Let $d_k = x_{k+1} - x_k - z_k$ be what step $k$ gives way. Which steps appear in no other term
# than their own? What is their best $d_k$?

# %% [markdown] tags=["hint"]
# Set the derivative by a pose inside the loop to zero: it has two terms. What do they say of two
# neighbouring steps? Then the derivative by pose $b$: its terms are of the last step and of the
# closure. (Think of springs in a row. What is the same in all of them?)

# %% [markdown] tags=["hint"]
# Inside the loop $d_{k-1} / s_{k-1} = d_k / s_k$: one number $\lambda$ for the whole loop. At pose
# $b$ the closure balances the last step, so its own error is $-\lambda R$. All $d_k$ of the loop
# and $\lambda R$ together make up what is missing. Poses beyond $b$ move along.


# %% tags=["cases"]
@drawn
def _some_line(rng: np.random.Generator, whole: bool = False) -> Any:
    n = int(rng.integers(3, 9))
    a = 0 if whole else int(rng.integers(0, n - 1))
    b = n if whole else int(rng.integers(a + 1, n))
    z = np.round(rng.uniform(0.5, 3.0, n) * rng.choice([1, 1, -1], n), 2)
    c = float(np.round(z[a:b].sum() + rng.uniform(-1, 1), 2))
    s = np.round(rng.uniform(0.01, 0.5, n), 2)
    return z, s, a, b, c, float(np.round(rng.uniform(0.01, 0.9), 2))


def _line_drawn(ax: Any, function: Any) -> None:
    """Draw by how much each pose of a corridor moves; one step of the loop is on a carpet."""
    from slamlab import plots

    s = np.full(9, 0.01)
    s[4] = 0.09
    x = np.asarray(function(np.ones(9), s, 1, 8, 7.6, 0.01), float).reshape(10)
    moved = x - np.arange(10.0)
    ax.axvspan(4, 5, color="0.88")
    ax.plot(moved, "o-", color=plots.COLOURS["estimate"])
    ax.set(xlabel="pose; grey: the carpet", ylabel="moved by (m)", ylim=(-0.05, 0.7))
    ax.set_title(f"carpet: {moved[5] - moved[4]:.2f} of 0.60 m")


check_line = Check(
    line,
    "positions",
    {
        "the 0.3 m of the chapter are shared equally": ([1.0, 1.0], [1.0, 1.0], 0, 2, 2.3, 1.0),
        "measurements that agree are kept": ([1.0, 2.0], [1.0, 5.0], 0, 2, 3.0, 0.1),
        "a sure closure: the steps give way": ([1.0, 1.0], [1.0, 1.0], 0, 2, 2.3, 0.01),
        "the carpet gives way, the smooth floor hardly": (
            [1.0, 1.0, 1.0],
            [0.01, 0.09, 0.01],
            0,
            3,
            3.6,
            0.01,
        ),
        "a loop round all poses": _some_line(whole=True),
        "there and back again": ([1.0, 1.0, -0.9, -1.0], [0.1, 0.2, 0.3, 0.1], 0, 4, 0.0, 0.01),
        "a loop that begins late and ends early": _some_line(),
    },
    tolerance=1e-6,
    picture=_line_drawn,
)


# %% tags=["mistakes"]
def _inside_only(
    z: Array, variances: Array, before: int, after: int, closure: float, R: float
) -> Array:
    x = line(z, variances, before, after, closure, R)
    x[after + 1 :] = np.cumsum(z)[after:]
    return x


def _last_step(
    z: Array, variances: Array, before: int, after: int, closure: float, R: float
) -> Array:
    steps = z.copy()
    steps[after - 1] = closure - z[before : after - 1].sum()
    return np.r_[0.0, np.cumsum(steps)]


check_line.mistakes = {
    "the closure was ignored: this is dead reckoning": (
        "missing = closure - z[before:after].sum() => missing = 0.0"
    ),
    "the closure was taken as exact: it has an error like the others, of variance R": (
        ".sum() + R\n => .sum()\n"
    ),
    "the steps share alike: a step of large variance gives way further": (
        "variances[before:after] / total => np.mean(variances[before:after]) / total"
    ),
    "shared by standard deviations: it is the variances that share": (
        "steps = z.copy() => steps, variances, R = z.copy(), variances**0.5, R**0.5"
    ),
    "shared by weights: the sure steps gave way, and not the others": (
        "steps = z.copy() => steps, variances, R = z.copy(), 1 / variances, 1 / R"
    ),
    "steps outside the loop gave way: nothing pulls at them": (
        "before:after] => :]",
        "z[:] => z[before:after]",
    ),
    "the poses beyond the loop stayed where they were: they move along": _inside_only,
    "the last step of the loop took all that is missing": _last_step,
    "the wrong way: what is missing is the closure less the sum of the steps": (
        "closure - z[before:after].sum() => z[before:after].sum() - closure"
    ),
    "one step too many: from pose a to pose b lead the steps a to b - 1": (
        "before:after] => before : after + 1]"
    ),
    "the first step of the loop was left out": "before:after] => before + 1 : after]",
    "the closure was counted from pose 0: it begins at pose `before`": (
        "closure - z[before:after].sum() => closure - z[:after].sum()"
    ),
    "these are the steps: the positions are their sums": (
        "np.r_[0.0, np.cumsum(steps)] => np.r_[0.0, steps]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: a loop on a line
#
# The derivative by pose $k$ inside the loop is $d_{k-1}/s_{k-1} - d_k/s_k = 0$: one force
# $\lambda$ goes through all edges of the loop, and each gives way by $\lambda$ times its variance.
# Together they make up what is missing, $\lambda\,(\sum s_k + R) = c - \sum z_k$. With the second
# step's variance doubled the 0.3 m are shared 1 : 2 : 1.

# %% [markdown] tags=["solution"]
# One pass and no matrix. (With a second closure that overlaps the first there is no longer *one*
# force, and the matrix is needed.) The matrix gives the same, here for nine steps with the carpet:

# %% active="ipynb" tags=["solution"]
# z, s = np.ones(9), np.array([1, 1, 1, 1, 9, 1, 1, 1, 1]) / 100
# J = np.eye(9) - np.eye(9, k=-1)                 # step k: x_(k+1) - x_k, pose 0 held
# J = np.vstack([J, np.eye(9)[7] - np.eye(9)[0]])       # closure: x_8 - x_1
# W = np.diag(1 / np.r_[s, 0.01])
# by_matrix = np.linalg.solve(J.T @ W @ J, J.T @ W @ np.r_[z, 7.6])
# print("same:", np.allclose(line(z, s, 1, 8, 7.6, 0.01)[1:], by_matrix))

# %% [markdown] tags=["solution"]
# Taking the closure as exact looks harmless, and is where it is precise. Here it is as uncertain
# as a step:

# %% active="ipynb" tags=["solution"]
# check_line(lambda z, variances, a, b, c, R: line(z, variances, a, b, c, 0.0))

# %% [markdown] tags=["statement"]
# ## Exercise 2: two robots and a radio
#
# Two robots drive through a hall. The wheels of B slip, those of A do not. Neither sees the
# other, but each has a radio, and the time of flight of its signal gives the *distance* of the two
# antennas, nothing else. Such a range is an edge as well, between a pose of A and a pose of B. Its
# error is one number:
#
# $$
# e = \lVert p_j - p_i \rVert - r, \qquad p_i = t_i + R(\theta_i)\, a, \quad p_j = t_j +
# R(\theta_j)\, a ,
# $$
#
# with the antenna at $a$ in the frame of its robot, the same for both. Formulas (A) and (B) of
# the lesson do not fit. What does this edge add to $H = J^\top \Omega J$ and $g = J^\top \Omega\,
# e$, with $\Omega = 1/\sigma^2$? And before you begin: if the antenna is at the centre of the
# robot, which rows and columns of $H$ are zero?
#
# The picture lets both drive forty steps with one range for each. By its wheels alone B ends 4 m
# off.


# %% tags=["exercise"]
def range_edge(
    x_i: Array, x_j: Array, antenna: Array, r: float, sigma: float
) -> tuple[Array, Array]:
    """What a measured distance adds to H and g.

    Parameters
    ----------
    x_i, x_j : ndarray, shape (3,)
        The two poses: x, y (m), theta (rad); the antennas are never at one place.
    antenna : ndarray, shape (2,)
        Where the antenna is in the frame of its robot: ahead, to the left (m).
    r : float
        Measured distance of the antennas (m).
    sigma : float
        Its standard deviation (m).

    Returns
    -------
    H : ndarray, shape (6, 6)
        Rows and columns x_i, y_i, theta_i, x_j, y_j, theta_j.
    g : ndarray, shape (6,)
    """
    a_i, a_j = rotation(x_i[2]) @ antenna, rotation(x_j[2]) @ antenna
    apart = x_j[:2] + a_j - x_i[:2] - a_i
    length = np.hypot(*apart)
    u = apart / length
    swing_i, swing_j = np.array([-a_i[1], a_i[0]]), np.array([-a_j[1], a_j[0]])
    J = np.r_[-u, -u @ swing_i, u, u @ swing_j]
    return np.outer(J, J) / sigma**2, J * (length - r) / sigma**2


# %% active="ipynb" tags=["try"]
# range_edge(np.zeros(3), np.array([3.0, 4.0, 0.0]), np.zeros(2), 4.8, 0.1)

# %% [markdown] tags=["hint"]
# Move B's antenna a little along the line between both: by how much does the distance change?
# Move it across the line: and now? Those two answers are the derivative by $p_j$, a unit vector.

# %% [markdown] tags=["hint"]
# When robot j turns, its antenna moves on a circle, to the left of $R(\theta_j)\,a = (a_x, a_y)$:
# its derivative by $\theta_j$ is $(-a_y, a_x)$. The chain rule does the rest.

# %% [markdown] tags=["hint"]
# $J$ is one row of six numbers. $J^\top J$ of a single row is `np.outer(J, J)`.


# %% tags=["cases"]
def _a_range(rng: np.random.Generator) -> Any:
    x_i, x_j = a_pose(rng), a_pose(rng) + [5.0, 0.0, 0.0]
    antenna = np.round(rng.uniform(-0.5, 0.5, 2), 2)
    return x_i, x_j, antenna, float(np.round(rng.uniform(1, 7), 2)), rng.choice([0.05, 0.1, 0.3])


def _two_robots(seed: int) -> Any:
    """Give two drives: true poses, measured motions, their sigmas, the antenna, and the ranges."""
    rng, antenna = np.random.default_rng(seed), np.array([1.0, 0.3])
    sigmas = np.array([[0.01, 0.01, 0.002], [0.1, 0.03, 0.06]])
    motions = np.tile([[[0.3, 0.0, 0.16]], [[0.35, 0.0, 0.03]]], (1, 40, 1))
    motions[1, ::9, 2] = 0.6
    measured = motions + sigmas[:, None] * rng.standard_normal((2, 40, 3))
    true = _driven(motions)
    at = true[..., :2] + rotation(true[..., 2]) @ antenna
    ranges = np.hypot(*(at[1] - at[0]).T) + 0.05 * rng.standard_normal(41)
    return true, measured, sigmas, antenna, ranges


def _driven(motions: Array) -> Array:
    poses = np.zeros((2, 41, 3))
    poses[1, 0] = [2.0, -1.5, 0.3]
    for q in range(2):
        for k in range(40):
            poses[q, k + 1] = compose(poses[q, k], motions[q, k])
    return poses


def _together(function: Function, seed: int) -> tuple[Array, Array, Array]:
    """Give the true poses of both robots, those by their wheels, and those with the ranges."""
    true, measured, sigmas, antenna, ranges = _two_robots(seed)
    wheels, free = _driven(measured), np.r_[3:123, 126:246]
    x = wheels
    for _ in range(8):
        H, g = np.zeros((82, 3, 82, 3)), np.zeros((82, 3))
        for q in range(2):
            for k in range(40):
                pair = x[q, k], x[q, k + 1], measured[q, k]
                J, i = np.hstack(edge_jacobians(*pair)), 41 * q + k
                JO = J.T @ np.diag(sigmas[q] ** -2.0)
                H[i : i + 2, :, i : i + 2] += (JO @ J).reshape(2, 3, 2, 3)
                g[i : i + 2] += (JO @ edge_error(*pair)).reshape(2, 3)
        for k in range(1, 41):
            H_k, g_k = function(x[0, k], x[1, k], antenna, float(ranges[k]), 0.05)
            both = [k, 41 + k]
            H[np.ix_(both, range(3), both, range(3))] += np.reshape(H_k, (2, 3, 2, 3))
            g[both] += np.reshape(g_k, (2, 3))
        step = np.zeros(246)
        step[free] = np.linalg.solve(H.reshape(246, 246)[np.ix_(free, free)], -g.ravel()[free])
        x = x + step.reshape(2, 41, 3)
    return true, wheels, x


def _range_edge_drawn(ax: Any, function: Any) -> None:
    """Draw robots A and B, B by its wheels alone and by a graph of wheels and ranges."""
    from slamlab import plots

    true, wheels, x = _together(function, 1)
    plots.path(ax, true[1], "truth")
    plots.path(ax, wheels[1], "dead_reckoning")
    plots.path(ax, x[1], "estimate")
    ax.plot(*true[0, :, :2].T, color="0.6", lw=1)
    plots.floor(ax)
    ax.set(xlim=(-5, 9), ylim=(-4, 9), xlabel="x (m); grey: robot A")
    before, off = (np.hypot(*(p[1, -1] - true[1, -1])[:2]) for p in (wheels, x))
    ax.set_title(f"B ends {off:.1f} m off,\nby its wheels {before:.1f} m")


check_range_edge = Check(
    range_edge,
    "H, g",
    {
        "antenna at the centre, B ahead of A": (
            [0.0, 0.0, 0.0],
            [2.0, 0.0, 0.0],
            [0.0, 0.0],
            1.9,
            0.1,
        ),
        "antenna at the centre, B to the left and behind": (
            [1.0, 1.0, 0.4],
            [-2.0, 5.0, -1.0],
            [0.0, 0.0],
            5.5,
            0.2,
        ),
        "a range that fits: no force": ([0.0, 0.0, 0.0], [3.0, 4.0, 1.0], [0.0, 0.0], 5.0, 0.3),
        "antennas ahead of the centre, robots that look across": (
            [0.0, 0.0, np.pi / 2],
            [3.0, 0.0, -np.pi / 2],
            [0.4, 0.0],
            3.0,
            0.1,
        ),
        "antennas to the left of the centre": (
            [0.0, 0.0, 0.0],
            [3.0, 1.0, 0.0],
            [0.0, 0.3],
            3.3,
            0.1,
        ),
        "any two robots": _a_range,
    },
    tolerance=1e-6,
    picture=_range_edge_drawn,
)

# %% tags=["mistakes"]
check_range_edge.mistakes = {
    "a turn moves an antenna that is not at the centre: theta has a column of its own": (
        "-u @ swing_i, u, u @ swing_j => 0.0, u, 0.0"
    ),
    "the antenna was not turned into the world: R(theta) a": (
        "rotation(x_i[2]) @ antenna, rotation(x_j[2]) @ antenna => antenna, antenna"
    ),
    "both antennas were turned by the heading of i": "rotation(x_j[2]) => rotation(x_i[2])",
    "the distance is that of the centres: the radio measures that of the antennas": (
        "apart = x_j[:2] + a_j - x_i[:2] - a_i => apart = x_j[:2] - x_i[:2]"
    ),
    "an antenna swings to the left of its own direction: (-a_y, a_x)": (
        "[-a_i[1], a_i[0]] => [a_i[1], -a_i[0]]",
        "[-a_j[1], a_j[0]] => [a_j[1], -a_j[0]]",
    ),
    "the derivative of a distance is a unit vector: divide by the length": (
        "u = apart / length => u = apart"
    ),
    "the derivative by pose i has the wrong sign: where i comes nearer, the distance falls": (
        "np.r_[-u, -u @ swing_i, => np.r_[u, u @ swing_i,"
    ),
    "the error is the predicted distance less the measured one": (
        "(length - r) / => (r - length) /"
    ),
    "sigma must be squared: Omega is 1 / sigma^2": "sigma**2 => sigma",
    "sigma is missing in H": "np.outer(J, J) / sigma**2 => np.outer(J, J)",
    "sigma is missing in g": "(length - r) / sigma**2 => (length - r)",
    "Omega is one over the variance: it was multiplied by sigma^2": "/ sigma**2 => * sigma**2",
    "the blocks between i and j are missing": (
        "np.outer(J, J) / => np.kron(np.eye(2), np.ones((3, 3))) * np.outer(J, J) /"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: two robots and a radio
#
# With the unit vector $u$ from antenna i to antenna j the derivative of the distance by $p_j$ is
# $u^\top$, by $p_i$ it is $-u^\top$, and a heading moves its own antenna along $(-a_y, a_x)$. All
# six numbers make one row $J$, so $H$ has rank 1: a range holds one direction of six. With the
# antenna at the centre the rows and columns of both headings are zero; many ranges, and the wheels
# between them, hold all of B's path.

# %% [markdown] tags=["solution"]
# A derivative that you are not sure of is compared with a difference:

# %% active="ipynb" tags=["solution"]
# x, antenna, tiny = np.array([0.0, 1, 0.5, 4, -1, 2.0]), np.array([0.3, 0.1]), 1e-6
#
# def distance(x):
#     a, b = x[:2] + rotation(x[2]) @ antenna, x[3:5] + rotation(x[5]) @ antenna
#     return np.hypot(*(b - a))
#
# changes = [distance(x + d) - distance(x - d) for d in tiny * np.eye(6)]
# g = range_edge(x[:3], x[3:], antenna, distance(x) - 1.0, 1.0)[1]   # e = 1, so g is J
# print("same:", np.allclose(g, np.array(changes) / (2 * tiny), atol=1e-6))

# %% [markdown] tags=["solution"]
# Without dividing by the length far ranges count more than near ones: in the picture B then ends
# 0.6 m off in place of 0.1 m.

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Robot B round robot A, by its wheels far off; with the wrong derivative it ends 0.6 m off, with the right one 0.1 m."}}
# def not_divided(x_i, x_j, antenna, r, sigma):
#     H, g = range_edge(x_i, x_j, antenna, r, sigma)
#     a, b = (x[:2] + rotation(x[2]) @ antenna for x in (x_i, x_j))
#     length = np.hypot(*(b - a))
#     return H * length**2, g * length
#
# check_range_edge.draw(not_divided)

# %% [markdown] tags=["statement"]
# ## Exercise 3: a bug to find
#
# A robot matches each scan against the map of its town, so the matcher reports covariances in the
# frame of the *world*: long along the street, short across. The function below makes the
# information matrix of the error (A) from one of them. Its author tried it on one long street,
# where the mean of $\mathbf e^\top \Omega\, \mathbf e$ was 3, as it should be for three numbers.
# In the whole town it is 6. Run the check, find the bug, repair it.


# %% tags=["exercise"]
def information(cov: Array, theta_i: float, z: Array) -> Array:
    """Information of an edge from a covariance in the frame of the world.

    Parameters
    ----------
    cov : ndarray, shape (3, 3)
        Covariance of the measured pose j, x and y along the axes of the world.
    theta_i : float
        Heading of pose i in the world (rad).
    z : ndarray, shape (3,)
        Measured pose of j seen from pose i.

    Returns
    -------
    ndarray, shape (3, 3)
        Omega, with which the error of the edge is weighted.
    """
    turn = np.eye(3)
    turn[:2, :2] = rotation(theta_i + z[2]).T
    return np.linalg.inv(turn @ cov @ turn.T)


# %% active="ipynb" tags=["stub"]
#     turn = np.eye(3)
#     turn[:2, :2] = rotation(theta_i).T
#     return np.linalg.inv(turn @ cov @ turn.T)

# %% active="ipynb" tags=["try"]
# information(np.diag([0.09, 0.01, 0.01]), 0.0, np.array([1.0, 0.0, np.pi / 2])).round(1)

# %% [markdown] tags=["hint"]
# Compare the inputs for which the check says *ok* with the others. Which argument is different?

# %% [markdown] tags=["hint"]
# In which frame is $\mathbf e$? Look at the last rotation in formula (A) of the lesson.

# %% [markdown] tags=["hint"]
# Draw the two poses with their axes, and those of the world beside them. By which angle are the
# axes of $\mathbf e$ turned against those of the world?


# %% tags=["cases"]
def _a_match(rng: np.random.Generator) -> Any:
    cov = np.diag([0.09, 0.0004, 0.0001])
    turn = np.eye(3)
    turn[:2, :2] = rotation(an_angle(rng))
    return np.round(turn @ cov @ turn.T, 6), an_angle(rng), a_pose(rng)


_LONG = np.diag([0.09, 0.0004, 0.0001])
_CORRELATED = np.array([[0.09, 0.01, 0.006], [0.01, 0.04, -0.004], [0.006, -0.004, 0.01]])


def _information_drawn(ax: Any, function: Any) -> None:
    """Draw the ellipse that each information allows, turned into the world, for four turns."""
    from slamlab import plots

    cov, angles = np.diag([0.09, 0.01, 0.01]), (0.0, 0.5, 1.0, 1.5)
    Omegas = [np.asarray(function(cov, 0.3, np.array([1.0, 0.0, t])), float) for t in angles]
    noise = np.random.default_rng(0).standard_normal((400, 3)) * np.sqrt(np.diag(cov))
    distances = []
    for k, (angle, Omega) in enumerate(zip(angles, Omegas, strict=True)):
        turn = rotation(0.3 + angle)
        at = np.array([2.0 * (k % 2), 2.4 * (k // 2)])
        plots.ellipse(ax, at, turn @ np.linalg.inv(Omega)[:2, :2] @ turn.T)
        ax.text(*at - [0, 0.85], f"{np.rad2deg(angle):.0f}°", ha="center", va="top")
        e = np.c_[noise[:, :2] @ turn, noise[:, 2]]
        distances.append(np.einsum("mi,ij,mj->m", e, Omega, e).mean())
    ax.set_aspect("equal")
    ax.set(xlabel="x (m), y (m); turn of z", ylabel="", xlim=(-1, 3), ylim=(-1.5, 3.3))
    ax.set_title(f"mean squared distance {np.mean(distances):.1f}")


check_information = Check(
    information,
    "Omega",
    {
        "no turn at all: the inverse": (_LONG, 0.0, [1.0, 0.0, 0.0]),
        "a quarter turn exchanges along and across": (_LONG, np.pi / 2, [1.0, 0.0, 0.0]),
        "a match round a corner": (_LONG, 0.0, [1.0, 0.0, np.pi / 2]),
        "any match": _a_match,
        "position and heading are correlated": (_CORRELATED, 0.7, [1.0, 0.2, -0.4]),
        "a robot that looks to the right": (_CORRELATED, -2.2, [0.6, -0.3, 0.5]),
    },
    tolerance=1e-6,
    picture=_information_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
_APART = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])

check_information.mistakes = {
    "position and heading were inverted one by one: they are correlated": (
        "np.linalg.inv(turn @ cov @ turn.T) => np.linalg.inv(turn @ (cov * _APART) @ turn.T)"
    ),
    "the correlation of position and heading was dropped": (
        "np.linalg.inv(turn @ cov @ turn.T) => np.linalg.inv(turn @ cov @ turn.T) * _APART"
    ),
    "this is the covariance in the frame of the error: the edge needs its inverse": (
        "np.linalg.inv(turn @ cov @ turn.T) => (turn @ cov @ turn.T)"
    ),
    "it was not turned at all: the error does not stand in the frame of the world": (
        "np.linalg.inv(turn @ cov @ turn.T) => np.linalg.inv(cov)"
    ),
    "turned into the frame of pose i only: R_z^T turns the error on into that of pose j": (
        "theta_i + z[2] => theta_i"
    ),
    "turned by the measurement only: the world must first be turned into pose i": (
        "theta_i + z[2] => z[2]"
    ),
    "turned the wrong way round: R^T takes the world into the body": ").T\n => )\n",
    "the measured turn is added to the heading, not taken off": (
        "theta_i + z[2] => theta_i - z[2]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a bug to find
#
# The error is in the frame of pose *j* as measured, whose heading in the world is $\theta_i +
# \theta_z$. The function stopped at pose *i*. In the lesson's (E) the covariance came in the frame
# of pose *i*, and the turn was by $\theta_z$ alone: which angle it takes depends on the sensor.

# %% [markdown] tags=["solution"]
# As given it passes wherever the robot measured no turn, on every straight street:

# %% active="ipynb" tags=["solution"]
# def as_given(cov, theta_i, z):
#     turn = np.eye(3)
#     turn[:2, :2] = rotation(theta_i).T
#     return np.linalg.inv(turn @ cov @ turn.T)
#
# check_information(as_given)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a kernel read backwards
#
# A robot comes home after a long tour. Its wheels say that it is 5 m beside its start, its camera
# recognises the start, and the camera is right. Formula (F) of the lesson gives the weight of such
# an edge under dynamic covariance scaling,
#
# $$
# w = \min\!\left(1, \frac{2 k^2}{k^2 + x}\right)^2, \qquad x = \mathbf e^\top \Omega\, \mathbf e ,
# $$
#
# and a narrow kernel gives it next to nothing. The operator knows a few closures that are true.
# How wide must the kernel be, so that *each* of them has at least the weight $w$ at the start?


# %% tags=["exercise"]
def narrowest(e: Array, Omega: Array, w: float) -> float:
    """Smallest width of a DCS kernel under which no edge weighs less than w.

    Parameters
    ----------
    e : ndarray, shape (m, 3)
        Errors of the edges, m >= 1, none of them exactly zero.
    Omega : ndarray, shape (m, 3, 3)
        Their information.
    w : float
        Least weight, 0 < w <= 1.

    Returns
    -------
    float
        The width k, not its square.
    """
    x = np.einsum("mi,mij,mj->m", e, Omega, e)
    s = np.sqrt(w)
    return float(np.sqrt(x.max() * s / (2 - s)))


# %% active="ipynb" tags=["try"]
# narrowest(np.array([[0.5, 0.0, 0.0]]), np.array([100 * np.eye(3)]), 1.0)

# %% [markdown] tags=["hint"]
# One edge first. Up to which $x$ is the weight exactly 1? So what is $k$ for $w = 1$?

# %% [markdown] tags=["hint"]
# For $w < 1$ the minimum is the fraction. Take the root of both sides and solve for $k^2$.

# %% [markdown] tags=["hint"]
# Several edges: which of them needs the widest kernel?


# %% tags=["cases"]
@drawn
def _closures(rng: np.random.Generator, m: int | None = None) -> Any:
    m = int(rng.integers(2, 7)) if m is None else m
    Omega = np.array([np.linalg.inv(a_covariance(rng, 3, 0.1)) for _ in range(m)])
    e = np.round(rng.normal(size=(m, 3)), 2) + 0.01
    return e, Omega, float(np.round(rng.uniform(0.02, 0.98), 2))


def _town(town: int, sigma_heading: float) -> tuple[PoseGraph, Mask, Array]:
    """Give a town with six false closures, which edges are false, and the true poses."""
    rng = np.random.default_rng(town)
    base, true = manhattan_graph(200, 260, rng, sigma_heading=sigma_heading)
    pairs = np.array([np.sort(rng.choice(200, 2, replace=False)) for _ in range(6)])
    wrong = np.column_stack([rng.uniform(-1, 1, (6, 2)), rng.uniform(-3, 3, 6)])
    edges, z = np.vstack([base.edges, pairs]), np.vstack([base.measurements, wrong])
    return PoseGraph(base.poses, edges, z, base.information[0]), np.arange(266) >= 260, true


def _narrowest_drawn(ax: Any, function: Any) -> None:
    """Draw the weights of true and false closures of town 3 before the first step."""
    from slamlab import plots

    graph, false, _ = _town(3, 0.05)
    e, kept = graph.residuals(), graph.closures & ~false
    k = float(function(e[kept], graph.information[kept], 0.1))
    x = np.einsum("mi,mij,mj->m", e, graph.information, e)
    w = np.minimum(1, 2 * k**2 / (k**2 + x)) ** 2
    ax.plot(np.sqrt(x[kept]), w[kept], "o", color=plots.COLOURS["estimate"], ms=4)
    ax.plot(np.sqrt(x[false]), w[false], "x", color=plots.COLOURS["wrong"], ms=7)
    ax.axhline(0.1, color="0.5", ls="--", lw=1)
    ax.set(xlabel="distance; o true, x false closures", ylabel="weight", ylim=(-0.05, 1.1))
    ax.set_title(f"k = {k:.1f}\n{(w[false] > 0.1).sum()} of 6 false above 0.1")


check_narrowest = Check(
    narrowest,
    "width",
    {
        "the full weight": ([[0.5, 0.0, 0.0]], [100 * np.eye(3)], 1.0),
        "one edge, a quarter of the weight": ([[0.3, -0.4, 0.1]], [100 * np.eye(3)], 0.25),
        "next to no weight": ([[3.0, -4.0, 1.0]], [100 * np.eye(3)], 0.001),
        "one edge, any information": _closures(1),
        "the longest error is not the worst where its covariance is large": (
            [[0.9, 0.0, 0.0], [0.2, 0.1, 0.0]],
            [np.eye(3), 400 * np.eye(3)],
            0.5,
        ),
        "several edges": _closures(),
    },
    tolerance=1e-6,
    picture=_narrowest_drawn,
)

# %% tags=["mistakes"]
check_narrowest.mistakes = {
    "this is k squared": "float(np.sqrt(x.max() * s / (2 - s))) => float(x.max() * s / (2 - s))",
    "the weight is the square of the fraction: take its root first": "s = np.sqrt(w) => s = w",
    "w was squared: it is its root that is the fraction": "s = np.sqrt(w) => s = w**2",
    "this is the width for the full weight: a smaller w allows a narrower kernel": (
        "s / (2 - s) => 1"
    ),
    "the 2 of the fraction is missing: k^2 (2 - s) = x s": "(2 - s) => (1 - s + 1e-300)",
    "a sign was lost: k^2 (2 - s) = x s": "(2 - s) => (2 + s)",
    "solved the wrong way round: k^2 = x s / (2 - s)": (
        "x.max() * s / (2 - s) => x.max() * (2 - s) / s"
    ),
    "this width is enough for the best edge only: each must have the weight": (
        "x.max() => x.min()"
    ),
    "this is for the mean edge: each must have the weight": "x.max() => x.mean()",
    "the edges were added up: each has a weight of its own": "x.max() => x.sum()",
    "the information was forgotten: x is e^T Omega e": (
        'np.einsum("mi,mij,mj->m", e, Omega, e) => (e**2).sum(axis=1)'
    ),
    "x is a squared distance already: its root was taken": "x.max() => np.sqrt(x.max())",
    "this is Cauchy's kernel: w = k^2 / (k^2 + x)": (
        "x.max() * s / (2 - s) => x.max() * w / (1 - w)"
    ),
    "the information was inverted: Omega is already the inverse of a covariance": (
        "e, Omega, e) => e, np.linalg.inv(Omega), e)"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: a kernel read backwards
#
# With $s = \sqrt w$ the fraction is $2k^2 = s\,(k^2 + x)$, so $k^2 = x\, s / (2 - s)$. It grows
# with $x$, so the edge that fits worst decides.

# %% [markdown] tags=["solution"]
# For $w = 1$ this is $k = \sqrt x$; for $w = 0.1$ it is $\sqrt{0.316 / 1.684} = 0.43$ of that.
# Without the root of the weight the kernel is too narrow:

# %% active="ipynb" tags=["solution"]
# def no_root(e, Omega, w):
#     x = np.einsum("mi,mij,mj->m", e, Omega, e)
#     return np.sqrt(x.max() * w / (2 - w))
#
# check_narrowest(no_root)

# %% [markdown] tags=["statement"]
# ## Exercise 5: one kernel for three robots
#
# No operator knows which closures are true. In the picture of exercise 4 a width at which all
# true ones count lets false ones count as well. But it need not be that wide: the near closures
# move the map, and then the far ones fit better. How narrow may it be? That is tried, not
# computed.
#
# Three robots drive through towns; in each, six closures of 67 are false. Their steps have 5 cm of
# noise, and their headings are not equally good: 0.6, 2.9 and 5.7 degrees for each step. In the
# lesson the closures were as exact as the steps, and $k = 7$ was right in all twenty towns. These
# robots close their loops with a laser, to 1 cm and 0.6 degrees, and $\Omega$ says so. A closure
# counts as rejected where it weighs less than 0.1 at the end.
#
# **Write down first**: must the kernel be wider for closures that are more exact, or may it be
# narrower? What goes wrong with one that is too narrow, what with one that is too wide, and which
# robot shows it? Then find *one* width with which no true closure is rejected and no false one
# believed, in all six towns. (`graph, false, true = laser_town(8, 0.1)` is a town of the third
# robot, if you want to try something yourself: the graph from dead reckoning, which of its edges
# are false, the true poses.)


# %% tags=["exercise"]
def one_width(sigma_heading: float) -> float:
    """Width of the DCS kernel for robots that close their loops with a laser.

    Parameters
    ----------
    sigma_heading : float
        Noise of the robot's heading for each step (rad). One answer for all exists.

    Returns
    -------
    float
        The width k.
    """
    return 15.0


# %% active="ipynb" tags=["try"]
# one_width(0.05)

# %% [markdown] tags=["hint"]
# Return 1.5 and then 100, and compare what the check counts: first the true closures that were
# rejected, then the false ones that were believed.

# %% [markdown] tags=["hint"]
# Which robot fails first when you make the kernel narrower, which when you make it wider? The
# third robot leaves the least room. In towns 3 and 5 you see both ends of it.


# %% tags=["cases"]
def laser_town(town: int, sigma_heading: float) -> tuple[PoseGraph, Mask, Array]:
    """Town with six false closures among 61 true ones, all measured to 1 cm and 0.01 rad.

    Parameters
    ----------
    town : int
        Seed of the town, at least 0.
    sigma_heading : float
        Noise of the robot's heading for each step (rad); that of its position is 5 cm.

    Returns
    -------
    graph : PoseGraph
        200 poses as dead reckoning has them, 199 steps and 67 closures.
    false : ndarray of bool, shape (266,)
        Which of its edges are false.
    true : ndarray, shape (200, 3)
        True poses.
    """
    rng = np.random.default_rng(town)
    base, true = manhattan_graph(200, 260, rng, sigma_heading=sigma_heading)
    pairs = np.array([np.sort(rng.choice(200, 2, replace=False)) for _ in range(6)])
    wrong = np.column_stack([rng.uniform(-1, 1, (6, 2)), rng.uniform(-3, 3, 6)])
    i, j = base.edges[199:].T
    closures = between(true[i], true[j]) + 0.01 * rng.standard_normal((61, 3))
    z = np.vstack([base.measurements[:199], closures, wrong])
    exact = np.tile(np.diag(np.full(3, 0.01**-2)), (67, 1, 1))
    Omega = np.concatenate([base.information[:199], exact])
    graph = PoseGraph(base.poses, np.vstack([base.edges, pairs]), z, Omega)
    return graph, np.arange(266) >= 260, true


def _outcome(function: Function, town: int, sigma_heading: float) -> Any:
    """Count the true closures that were rejected and the false ones that were believed."""
    graph, false, _ = laser_town(town, sigma_heading)
    width = np.atleast_1d(np.asarray(function(sigma_heading), dtype=float)).tolist()
    result = graph.optimize(kernel="dcs", kernel_width=width, max_iterations=60)
    rejected = result.weights < 0.1
    lost, believed = (rejected & graph.closures & ~false).sum(), (~rejected & false).sum()
    said = f"{lost} of 61 true closures are rejected, {believed} of 6 false ones are believed"
    return said if lost or believed else ""


def _one_width_drawn(ax: Any, function: Any) -> None:
    """Draw the map of the third robot with this width; rejected closures are dotted."""
    from slamlab import plots

    width = np.atleast_1d(np.asarray(function(0.1), dtype=float)).tolist()
    graph, false, true = laser_town(8, 0.1)
    result = graph.optimize(kernel="dcs", kernel_width=width, max_iterations=60)
    rejected = result.weights < 0.1
    plots.path(ax, true, "truth")
    plots.path(ax, result.poses, "estimate")
    for i, j in graph.edges[rejected & graph.closures]:
        ax.plot(*result.poses[[i, j], :2].T, ":", color=plots.COLOURS["wrong"], lw=1)
    plots.floor(ax)
    ax.set(xlabel="x (m); dotted: rejected")
    off = np.sqrt(((result.poses - true)[:, :2] ** 2).sum(axis=1).mean())
    lost, believed = (rejected & graph.closures & ~false).sum(), (~rejected & false).sum()
    ax.set_title(f"{off:.1f} m off\n{lost} true out, {believed} false in")


check_one_width = Check(
    one_width,
    "closures",
    {
        "the first robot, 0.6 degrees a step: town 10": (10, 0.01),
        "the second robot, 2.9 degrees a step: town 3": (3, 0.05),
        "the second robot: town 10": (10, 0.05),
        "the third robot, 5.7 degrees a step: town 3": (3, 0.1),
        "the third robot: town 5": (5, 0.1),
        "the third robot: town 8": (8, 0.1),
    },
    use=_outcome,
    picture=_one_width_drawn,
)

# %% tags=["mistakes"]
check_one_width.mistakes = {
    "far too narrow: even the first robot's true closures look false": lambda sigma_heading: 1.0,
    "the usual width of 2.8 is too narrow for a start that has drifted": (
        lambda sigma_heading: 2.7955
    ),
    "a width of 3 is too narrow for a start that has drifted": lambda sigma_heading: 3.0,
    "7 was for closures as exact as the steps: the same drift is more sigmas now": (
        lambda sigma_heading: 7.0
    ),
    "a width of 10 is enough for two robots: the third has drifted further": (
        lambda sigma_heading: 10.0
    ),
    "a width of 30 is too wide: a false closure is believed": lambda sigma_heading: 30.0,
    "a width of 43, that of exercise 4, is too wide: false closures are believed": (
        lambda sigma_heading: 43.0
    ),
    "a width of 100 lets false closures in in every one of these towns": (
        lambda sigma_heading: 100.0
    ),
    "a kernel that wide is no kernel: every false closure is believed": (
        lambda sigma_heading: 10000.0
    ),
    "narrowing step by step keeps what the first, wide kernel has let in": (
        lambda sigma_heading: (100.0, 30.0, 10.0)
    ),
    "too wide at the start: false closures bend the map before they are down-weighted": (
        lambda sigma_heading: (300.0, 100.0, 30.0, 10.0, 3.0)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: one kernel for three robots
#
# Too narrow a kernel rejects true closures, and more the further the map has drifted; too wide a
# kernel believes false ones. A drift of a metre is 20 standard deviations of a closure of 5 cm,
# and 100 of one of 1 cm: so the kernel must be wider than the lesson's 7. And it may be, as the
# false closures are more standard deviations off as well. How much room is between both? Eight
# towns for each robot, of which some are not in the check:

# %% active="ipynb" tags=["solution"]
# def is_right(town, sigma_heading, k):
#     graph, false, _ = laser_town(town, sigma_heading)
#     result = graph.optimize(kernel="dcs", kernel_width=k, max_iterations=60)
#     return np.array_equal(result.weights < 0.1, false)
#
# ks = (7, 10, 15, 20, 30, 40)
# print("towns of eight that are right, k =", ks)
# for degrees, sigma_heading in ((0.6, 0.01), (2.9, 0.05), (5.7, 0.1)):
#     right = [sum(is_right(town, sigma_heading, k) for town in range(8)) for k in ks]
#     print(f"{degrees} degrees a step:", right)

# %% [markdown] tags=["solution"]
# The room becomes narrower from both sides. Narrowing step by step does not help here: what the
# wide kernel has let in, the narrow one keeps.

# %% active="ipynb" tags=["solution"]
# check_one_width(lambda sigma_heading: (100, 30, 10))

# %% [markdown] tags=["solution"]
# And the lesson's 7 is far less than the 43 of exercise 4. In the lesson's town 3 most true
# closures weigh less than 0.1 at the start, and none at the end:

# %% active="ipynb" tags=["solution"]
# graph, false = town_with_false_closures(3)
# e, true = graph.residuals(), graph.closures & ~false
# x = np.einsum("mi,mij,mj->m", e, graph.information, e)[true]
# at_start = np.minimum(1, 2 * 49 / (49 + x)) ** 2
# at_end = graph.optimize(kernel="dcs", kernel_width=7).weights[true]
# print(f"true closures below 0.1: {(at_start < 0.1).sum()} of {true.sum()} at first,",
#       f"{(at_end < 0.1).sum()} at the end")

# %% [markdown] tags=["statement"]
# ## Exercise 6: a town, and six closures are false
#
# A robot hands you its drive: motions, closures, standard deviations. Some closures may be false,
# and nothing says which. In the town of the picture the map with all closures is worse than that
# of the wheels alone. Assemble the chapter, in three stages:
#
# 1. **Start and decide.** Chain the motions to a start at $(0, 0, 0)$, make the graph of motions
#    and closures, and optimise it from there with the kernel. Here the closures are as exact as
#    the steps, so the lesson's $k = 7$ serves. A closure is *believed* if its weight at the end is
#    more than 0.1.
# 2. **Headings first.** Make the graph anew from the motions and the believed closures alone, with
#    dead reckoning as its poses, and give it the linear start.
# 3. **Optimise** without a kernel. Now every edge that is left counts in full, and the map does
#    not depend on the width any more.
#
# The order matters, as in the lesson: headings first before the decision is a start that false
# closures have bent. And the map of stage 1 can be a bad start for stage 3: the last property of
# the check is a drive on which it ends in a local minimum.
#
# You may use `PoseGraph(poses, edges, measurements, information)`; its method
# `optimize(kernel="dcs", kernel_width=...)`, whose result has `poses` and `weights` (one for each
# edge, 1 for a motion); and `chordal_initialisation()`, the lesson's headings first (it keeps the
# poses that the graph has if they fit better). Or your own code, and the lesson's.


# %% tags=["exercise"]
def map_of(odometry: Array, closures: Array, sigma: Array) -> tuple[Array, Mask]:
    """Best poses of a drive, and which closures to believe.

    Parameters
    ----------
    odometry : ndarray, shape (n, 3)
        Motion from each pose to the next, in the frame of the first of both
        (m, m, rad).
    closures : ndarray, shape (m, 5)
        Rows i, j, x, y, theta: pose j seen from pose i. There may be none.
    sigma : ndarray, shape (3,)
        Standard deviations of every measurement (m, m, rad).

    Returns
    -------
    poses : ndarray, shape (n + 1, 3)
    believed : ndarray of bool, shape (m,)
    """
    n = len(odometry)
    start = [np.zeros(3)]
    for motion in odometry:
        start.append(compose(start[-1], motion))
    chain = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    edges = np.vstack([chain, closures[:, :2].astype(int)])
    z = np.vstack([odometry, closures[:, 2:]])
    Omega = np.diag(sigma**-2.0)
    graph = PoseGraph(start, edges, z, Omega)
    believed = graph.optimize(kernel="dcs", kernel_width=7).weights[n:] > 0.1
    kept = np.r_[np.full(n, True), believed]
    clean = PoseGraph(start, edges[kept], z[kept], Omega)
    return clean.chordal_initialisation().optimize().poses, believed


# %% active="ipynb" tags=["try"]
# odometry, closures = np.array([[1.0, 0, 0], [1, 0, 0]]), np.array([[0, 2, 2.3, 0, 0]])
# map_of(odometry, closures, 0.1 * np.ones(3))

# %% [markdown] tags=["hint"]
# Four things go into a graph: dead reckoning as a start (`compose(pose, motion)`, again and
# again), pairs of row numbers, relative poses, and one 3 x 3 information for all. What is it,
# given the standard deviations?

# %% [markdown] tags=["hint"]
# The edges are the pairs (0, 1), (1, 2), ..., and below them the first two columns of `closures`
# as whole numbers. So the weights of the closures are the last m.

# %% [markdown] tags=["hint"]
# For stage 2 make one mask for all edges: true for each motion, `believed` for the closures. What
# it selects goes into a new graph.


# %% tags=["cases"]
def _a_walk(rng: np.random.Generator) -> Any:
    n = 12
    true = [np.zeros(3)]
    for _ in range(n):
        true.append(compose(true[-1], [1.0, 0.0, rng.choice([0.0, np.pi / 2])]))
    path = np.array(true)
    sigma = np.array([0.05, 0.02, 0.03])
    pairs = np.array([(0, 8), (2, 10), (4, 12), (1, 7)])
    z = between(path[pairs[:, 0]], path[pairs[:, 1]]) + sigma * rng.normal(size=(4, 3))
    odometry = between(path[:-1], path[1:]) + sigma * rng.normal(size=(n, 3))
    return np.round(odometry, 3), np.column_stack([pairs, np.round(z, 3)]), sigma


def _a_false_one(rng: np.random.Generator) -> Any:
    """Give such a walk with a false closure among the true ones, which is read backwards."""
    odometry, closures, sigma = _a_walk(rng)
    wrong = [11.0, 3.0, *np.round(rng.uniform(3, 5, 2), 2), 2.0]
    return odometry, np.insert(closures, int(rng.integers(5)), wrong, axis=0), sigma


def _a_town(town: int) -> Any:
    graph, _, true = _town(town, 0.05)
    closures = np.column_stack([graph.edges, graph.measurements])[199:]
    return (graph.measurements[:199], closures, np.full(3, 0.05)), between(true[0], true)


def _a_long_walk() -> Any:
    """Give a hundred steps with 10 degrees each: the kernel's map leads to a local minimum."""
    rng, true = np.random.default_rng(22), [np.zeros(3)]
    for _ in range(100):
        true.append(compose(true[-1], [1.0, 0.0, rng.choice([0.0, np.pi / 2, -np.pi / 2])]))
    path = np.array(true)
    apart = np.hypot(*(path[:, None, :2] - path[None, :, :2]).transpose(2, 0, 1))
    near = np.argwhere(np.triu(apart < 1.1, 8))
    pairs = near[np.sort(rng.permutation(len(near))[:12])]
    sigma = np.array([0.05, 0.05, 0.175])
    z = between(path[pairs[:, 0]], path[pairs[:, 1]]) + sigma * rng.normal(size=(12, 3))
    odometry = between(path[:-1], path[1:]) + sigma * rng.normal(size=(100, 3))
    return np.round(odometry, 3), np.column_stack([pairs, np.round(z, 3)]), sigma


def _map_drawn(ax: Any, function: Any) -> None:
    """Draw a town with six false closures, by its wheels and as a map; rejected ones dotted."""
    from slamlab import plots

    drive, true = _a_town(3)
    came, believed = function(*drive)
    poses = np.asarray(came, float).reshape(200, 3)
    out = ~np.asarray(believed).astype(bool).reshape(67)
    graph, _, _ = _town(3, 0.05)
    wheels = between(graph.poses[0], graph.poses)
    every = between(graph.poses[0], graph.optimize().poses)
    plots.path(ax, true, "truth")
    plots.path(ax, wheels, "dead_reckoning")
    plots.path(ax, poses, "estimate")
    for i, j in drive[1][out, :2].astype(int):
        ax.plot(*poses[[i, j], :2].T, ":", color=plots.COLOURS["wrong"], lw=1)
    plots.floor(ax)
    ax.set(xlabel="x (m); dotted: rejected")
    off = [np.sqrt(((p - true)[:, :2] ** 2).sum(axis=1).mean()) for p in (wheels, every, poses)]
    ax.set_title(
        f"{off[2]:.1f} m off, {out[61:].sum()} of 6 false out\n"
        f"wheels {off[0]:.1f}, all edges {off[1]:.1f} m"
    )


check_map = Check(
    map_of,
    "poses, believed",
    {
        "without a closure it is dead reckoning": (
            [[1.0, 0.0, 0.5], [1.0, 0.0, 0.5]],
            np.zeros((0, 5)),
            [0.2, 0.1, 0.05],
        ),
        "the line of the chapter": (
            [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
            [[0, 2, 2.3, 0.0, 0.0]],
            [0.1, 0.1, 0.1],
        ),
        "a walk round some blocks": _a_walk,
        "the same with one false closure": _a_false_one,
        "a town of 200 poses, six closures are false": _a_town(3)[0],
        "a long walk: from the kernel's map the optimiser ends in a worse one": _a_long_walk(),
    },
    tolerance=1e-5,
    draws=2,
    picture=_map_drawn,
)

# %% tags=["mistakes"]
check_map.mistakes = {
    "all closures were believed: false ones bend the map": (
        "weights[n:] > 0.1 => weights[n:] > -1"
    ),
    "a local minimum: the last stage needs headings first, not dead reckoning": (
        "clean.chordal_initialisation() => clean"
    ),
    "a local minimum: the last stage needs headings first, not the kernel's map": (
        "believed = graph => found = graph",
        "kernel_width=7).weights[n:] > 0.1 => kernel_width=7)\n"
        "    believed, start = found.weights[n:] > 0.1, found.poses",
        "clean.chordal_initialisation() => clean",
    ),
    "headings first before the decision: the false closures have bent that start": (
        "graph.optimize => graph.chordal_initialisation().optimize"
    ),
    "headings first before the decision: a narrow kernel does not make up for that": (
        "graph.optimize => graph.chordal_initialisation().optimize",
        "kernel_width=7 => kernel_width=3",
    ),
    "headings first before the decision: with no width is that start unbent": (
        "graph.optimize => graph.chordal_initialisation().optimize",
        "kernel_width=7 => kernel_width=5",
    ),
    "headings first before the decision: a wider kernel believes more false closures yet": (
        "graph.optimize => graph.chordal_initialisation().optimize",
        "kernel_width=7 => kernel_width=10",
    ),
    "headings first before the decision: narrowing keeps what that start has let in": (
        "graph.optimize => graph.chordal_initialisation().optimize",
        "kernel_width=7 => kernel_width=(30, 10, 3)",
    ),
    "the usual kernel of 2.8 is too narrow for a start that has drifted": (
        "kernel_width=7 => kernel_width=2.7955"
    ),
    "so wide a kernel believes false closures": "kernel_width=7 => kernel_width=30",
    "the closures were ignored: this is dead reckoning": lambda odometry, closures, sigma: (
        map_of(odometry, closures[:0], sigma)[0],
        np.full(len(closures), False),
    ),
    "the closures are read backwards: j is seen from i": (
        lambda odometry, closures, sigma: map_of(odometry, closures[:, [1, 0, 2, 3, 4]], sigma)
    ),
    "all coordinates count alike: the information is the inverse of the squared sigma": (
        "np.diag(sigma**-2.0) => np.eye(3)"
    ),
    "the information is 1 / sigma: the square is missing": ("sigma**-2.0 => sigma**-1.0"),
    "sigma^2 is a covariance: the graph wants its inverse": ("sigma**-2.0 => sigma**2.0"),
    "the start was returned: the last stage is to optimise": (
        "clean.chordal_initialisation().optimize().poses => clean.chordal_initialisation().poses"
    ),
    "these are the closures that were rejected": (
        "optimize().poses, believed => optimize().poses, ~believed"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 6: a town, and six closures are false
#
# The whole chapter in a dozen lines. The kernel decides from dead reckoning, a start that no false
# closure has touched; headings first and Gauss-Newton draw the map of what is left.

# %% [markdown] tags=["solution"]
# One town is one town. Twelve of them, RMS error of a position in metres (pose 0 held, as the
# robot has it), and that of the map when it is laid over the truth as well as it can be:

# %% active="ipynb" tags=["solution"]
# def rms(poses, truth):
#     return np.sqrt(((poses - truth)[:, :2] ** 2).sum(axis=1).mean())
#
# for town in range(12):
#     graph, false = town_with_false_closures(town)
#     rng = np.random.default_rng(town)
#     truth = manhattan_graph(200, 260, rng, sigma_heading=0.05).truth
#     truth, wheels = between(truth[0], truth), between(graph.poses[0], graph.poses)
#     every = between(graph.poses[0], graph.optimize().poses)
#     closures = np.column_stack([graph.edges, graph.measurements])[199:]
#     poses, believed = map_of(graph.measurements[:199], closures, 0.05 * np.ones(3))
#     right = np.array_equal(believed, ~false[199:])
#     print(f"town {town:2}: wheels {rms(wheels, truth):4.1f}, all closures "
#           f"{rms(every, truth):4.1f}, the map {rms(poses, truth):4.1f}, aligned "
#           f"{ate(poses, truth).rmse:.1f}; decided right: {right}")

# %% [markdown] tags=["solution"]
# Every town is decided right, and yet the maps of towns 5 and 10 are 3 m off or more. No false
# closure is left in them: this is noise of the steps and closures. A part of it is a heading turned
# at pose 0, which swings the whole map round; laid over the truth they are 2.1 and 1.2 m off.

# %% [markdown] tags=["solution"]
# With headings first *before* the decision the same kernel keeps four of six false closures, and
# the map of town 3 is as far off as by all of them:


# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two maps of the town: with headings first before the decision it is folded, 10.1 m off; as it should be it covers the true blocks, 0.6 m off."}}
# def bent_first(odometry, closures, sigma):
#     n = len(odometry)
#     chain = np.column_stack([np.arange(n), np.arange(1, n + 1)])
#     edges = np.vstack([chain, closures[:, :2].astype(int)])
#     z = np.vstack([odometry, closures[:, 2:]])
#     graph = PoseGraph(np.zeros((n + 1, 3)), edges, z, np.diag(sigma**-2.0))
#     result = graph.chordal_initialisation().optimize(kernel="dcs", kernel_width=7)
#     return result.poses, result.weights[n:] > 0.1
#
# check_map.draw(bent_first)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 13](../solutions/13_pose_graphs.ipynb).
