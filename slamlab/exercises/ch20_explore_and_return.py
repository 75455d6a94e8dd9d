"""Exercises, chapter 20: the way back, the time to turn, a memory that moves, a claim, a share."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose
from slamlab.exercises._report import Array, Check, Ints
from slamlab.geometry import compose, inverse, transform

__all__ = [
    "check_inside",
    "check_least_share",
    "check_relaid",
    "check_retraced",
    "check_turn_back",
]


# %% [markdown] tags=["chapter"]
# # Exercises 20: explore and return
#
# Five functions that a robot needs to come home, and that you need to believe it; the chapter is
# [Explore and return](../20_explore_and_return.ipynb). Replace each `...` and run the check below
# it as often as you like.

# %% [markdown] tags=["solution"]
# # Solutions 20: explore and return
#
# The exercises are in [Exercises 20](../exercises/20_explore_and_return.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
#
# from slamlab.geometry import inverse, transform

# %% [markdown] tags=["statement"]
# ## Exercise 1: the way back, with a pencil
#
# A robot has noted its motions on the way out: forward, to the left, and a turn, each in the
# frame of the robot *before* the motion. Which motions bring it back tail first? Derive on paper
# what undoes $(x, y, \theta)$: where is the old place, seen from the new one, and which way does
# the robot look there?


# %% tags=["exercise"]
def retraced(steps: Array) -> Array:
    """Motions that undo the way out.

    Parameters
    ----------
    steps : ndarray, shape (n, 3)
        Motions dx, dy (m) and turn (rad), each in the frame of the pose before it.

    Returns
    -------
    ndarray, shape (n, 3)
        The motions back, in the order in which they are driven.
    """
    c, s = np.cos(steps[::-1, 2]), np.sin(steps[::-1, 2])
    x, y, turn = steps[::-1].T
    return np.stack([-c * x - s * y, s * x - c * y, -turn], 1)


# %% active="ipynb" tags=["try"]
# retraced(np.array([[0.0, 0.0, 0.5], [1.0, 0.0, 0.0]]))

# %% [markdown] tags=["hint"]
# The last motion is undone first. A turn is undone by the opposite turn. For a motion with both,
# stand at its end and look back.

# %% [markdown] tags=["hint"]
# $T(\mathbf u)^{-1}$ has the turn $-\theta$ and the displacement $-R(\theta)^\top (x, y)$.


# %% tags=["cases"]
def _steps(rng: np.random.Generator) -> Any:
    return (np.round(rng.uniform(-1, 1, (rng.integers(2, 6), 3)), 2),)


def _retraced_drawn(ax: Any, function: Any) -> None:
    """Draw a way out with its headings, and where the motions lead from its end."""
    from slamlab import plots

    out = np.array([[1.0, 0.0, 0.5], [1.0, 0.2, 0.9], [0.8, 0.0, -0.6], [0.6, -0.3, 0.3]])
    ways = {"truth": (np.zeros(3), out)}
    end = np.zeros(3)
    for step in out:
        end = compose(end, step)
    ways["estimate"] = (end, np.asarray(function(out), float).reshape(-1, 3))
    for kind, (pose, steps) in ways.items():
        poses = [pose]
        for step in steps:
            poses.append(compose(poses[-1], step))
        path = np.array(poses)
        plots.path(ax, path, kind, marker="o", markersize=4)
        for x, y, theta in path:
            ax.plot(
                [x, x + 0.3 * np.cos(theta)],
                [y, y + 0.3 * np.sin(theta)],
                color=plots.COLOURS[kind],
                linewidth=3 if kind == "truth" else 1.5,
            )
    plots.floor(ax)


check_retraced = Check(
    retraced,
    "steps",
    {
        "a metre ahead": ([[1.0, 0.0, 0.0]],),
        "a turn, then a metre": ([[0.0, 0.0, 0.5], [1.0, 0.0, 0.0]],),
        "an arc": ([[1.0, 0.3, 0.6]],),
        "any way out": _steps,
    },
    picture=_retraced_drawn,
)

# %% tags=["mistakes"]
check_retraced.mistakes = {
    "this robot has turned its nose round: tail first means that it has not": (
        lambda p: np.column_stack([p[::-1, :2], -p[::-1, 2]])
    ),
    "the last motion must be undone first": lambda p: retraced(p)[::-1],
    "the signs are turned, but a motion is undone in the frame in which it ended": lambda p: (
        -p[::-1]
    ),
    "the displacement is turned the wrong way: it is seen from the end of the motion": (
        "-c * x - s * y, s * x - c * y => -c * x + s * y, -s * x - c * y"
    ),
    "these are motions back tail first with the nose turning on": "-turn => turn",
    "these are the motions of the way out, in another order": lambda p: p[::-1],
    "this robot has made half a turn first: tail first means that it has not": (
        "-c * x - s * y, s * x - c * y => c * x + s * y, -s * x + c * y"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: the way back, with a pencil
#
# The motion is $T(\mathbf u)$; what undoes it is $T(\mathbf u)^{-1}$, with the turn $-\theta$ and
# the displacement $-R(\theta)^\top(x, y)$. And $(AB)^{-1} = B^{-1}A^{-1}$: the last one first.

# %% [markdown] tags=["solution"]
# Turning all signs is the wheels' answer: driven as a *velocity* for the same time, $-\mathbf u$
# does undo $\mathbf u$. As a displacement in the frame of the pose before it, it does not:

# %% active="ipynb" tags=["solution"]
# check_retraced(lambda steps: -steps[::-1])

# %% [markdown] tags=["statement"]
# ## Exercise 2: when to turn back
#
# A robot may drive `budget` metres in all. It has driven some, knows how long the way home is,
# and keeps a reserve on it, for doors that have closed: with `reserve` 1.3 it wants 30 % more
# than the map says. It must turn back as soon as what is left is no more than that.


# %% tags=["exercise"]
def turn_back(driven: float, home: float, budget: float, reserve: float) -> bool:
    """Whether it is time to go home.

    Parameters
    ----------
    driven, home, budget : float
        Metres driven, metres to the mark by the map, metres allowed in all.
    reserve : float
        Factor on the way home, at least 1.

    Returns
    -------
    bool
    """
    return driven + reserve * home >= budget


# %% active="ipynb" tags=["try"]
# turn_back(25.0, 20.0, 50.0, 1.3)


# %% tags=["cases"]
def _journey(rng: np.random.Generator) -> Any:
    return tuple(np.round(rng.uniform([5, 1, 20, 1], [60, 40, 90, 2]), 1).tolist())


def _turn_drawn(ax: Any, function: Any) -> None:
    """Draw for which journeys the robot turns back, with 50 m in all and a reserve of 1.3."""
    from slamlab import plots

    for driven in np.linspace(0.0, 50.0, 16):
        for home in np.linspace(0.0, 40.0, 11):
            back = float(function(driven, home, 50.0, 1.3)) > 0.5
            kind, marker = ("dead_reckoning", "x") if back else ("estimate", "o")
            shape = {"marker": marker, "markersize": 6 if back else 3}
            ax.plot([driven, driven], [home, home], color=plots.COLOURS[kind], **shape)
            if back:
                ax.plot([driven, driven], [home, home - 1.2], color=plots.COLOURS[kind], lw=1)
    ax.set(xlabel="driven (m); x: turn back", ylabel="way home (m)")


check_turn_back = Check(
    turn_back,
    "turn",
    {
        "at the start there is nothing to fear": (0.0, 0.0, 50.0, 1.3),
        "half the budget is gone, and home is as far": (25.0, 25.0, 50.0, 1.0),
        "the reserve decides": (25.0, 20.0, 50.0, 1.3),
        "home is near: drive on": (45.0, 2.0, 50.0, 1.3),
        "half a metre is left": (30.0, 13.0, 50.0, 1.5),
        "any journey": _journey,
    },
    draws=30,
    picture=_turn_drawn,
)

# %% tags=["mistakes"]
check_turn_back.mistakes = {
    "the reserve belongs to the way home alone": (
        "driven + reserve * home => reserve * (driven + home)"
    ),
    "without the reserve the first closed door is the end": "reserve * home => home",
    "exactly enough is the last moment": ">= => >",
    "this says when it may drive on": ">= => <",
    "it turns round whatever the numbers say": lambda driven, home, budget, reserve: True,
    "it never turns round": lambda driven, home, budget, reserve: False,
    "what is driven already is gone from the budget too": (
        "driven + reserve * home => reserve * home"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: when to turn back

# %% [markdown] tags=["solution"]
# A reserve on the whole journey makes a robot that has driven far turn round too early, even if
# home is near:

# %% active="ipynb" tags=["solution"]
# check_turn_back(
#     lambda driven, home, budget, reserve: reserve * (driven + home) >= budget
# )

# %% [markdown] tags=["statement"]
# <details><summary>Hint</summary>
#
# At the start, with nothing driven and the mark under its feet, it may go.
#
# </details>
#
# ## Exercise 3: a bug to find
#
# A closure has moved the nodes of the graph, and the remembered points must move along, formula
# (B) of the chapter. This version was tested with a graph that was only pushed, and passed.


# %% tags=["exercise"]
def relaid(points: Array, nodes: Ints, before: Array, after: Array) -> Array:
    """Remembered points, moved with their nodes.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        In the world, as noted (m).
    nodes : ndarray of int, shape (n,)
        From which node each was noted.
    before, after : ndarray, shape (m, 3)
        Poses of the nodes when the points were noted, and now.

    Returns
    -------
    ndarray, shape (n, 2)
    """
    seen = transform(inverse(before[nodes]), points[:, None])
    return transform(after[nodes], seen)[:, 0]


# %% active="ipynb" tags=["stub"]
#     return points + (after - before)[nodes, :2]

# %% active="ipynb" tags=["try"]
# relaid(np.array([[1.0, 0.0]]), np.array([0]), np.zeros((1, 3)),
#        np.array([[0.0, 0.0, 0.5]]))

# %% [markdown] tags=["hint"]
# A node at the origin turns by half a radian. Where does a point one metre ahead of it go?

# %% [markdown] tags=["hint"]
# `slamlab.geometry` has `inverse`, `transform` and `inverse_transform`. Into the frame of the old
# node, out of the frame of the new one; `points[:, None]` gives each node a list of one point.


# %% tags=["cases"]
def _graph(rng: np.random.Generator) -> Any:
    before = np.array([a_pose(rng) for _ in range(4)])
    after = compose(before, np.round(rng.normal(0, 0.3, (4, 3)), 2))
    n = int(rng.integers(2, 6))
    return np.round(rng.uniform(-4, 4, (n, 2)), 2), rng.integers(0, 4, n), before, after


def _relaid_drawn(ax: Any, function: Any) -> None:
    """Draw two walls as noted from two nodes, the nodes before and after, and the walls moved."""
    from slamlab import plots

    before = np.array([[0.0, 0.0, 0.2], [3.0, 0.5, 0.0]])
    after = np.array([[0.1, -0.2, -0.1], [3.1, -0.7, -0.6]])
    side = np.linspace(-1.0, 1.5, 9)
    seen = np.concatenate([np.stack([side, np.full(9, 1.0)], -1)] * 2)
    nodes = np.repeat([0, 1], 9)
    noted = transform(before[nodes], seen[:, None])[:, 0]
    moved = np.asarray(function(noted, nodes, before, after), float)
    ax.plot(*noted.T, ".", color=plots.COLOURS["wrong"], markersize=4)
    ax.plot(*moved.T, "o", color=plots.COLOURS["estimate"], markersize=5, mfc="none")
    for poses, kind in ((before, "wrong"), (after, "truth")):
        for x, y, theta in poses:
            ax.plot(x, y, "s", color=plots.COLOURS[kind], markersize=5)
            ax.plot(
                [x, x + 0.5 * np.cos(theta)],
                [y, y + 0.5 * np.sin(theta)],
                color=plots.COLOURS[kind],
            )
    plots.floor(ax)


check_relaid = Check(
    relaid,
    "points",
    {
        "nothing moved": ([[1.0, 2.0]], [0], [[0.0, 0.0, 0.3]], [[0.0, 0.0, 0.3]]),
        "a node was pushed": ([[1.0, 2.0]], [0], [[0.0, 0.0, 0.0]], [[0.5, -1.0, 0.0]]),
        "a node was turned": ([[1.0, 0.0]], [0], [[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.5]]),
        "any graph": _graph,
    },
    picture=_relaid_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_relaid.mistakes = {
    "the points are pushed with their nodes and not turned": lambda p, n, b, a: (
        p + (np.asarray(a) - b)[n, :2]
    ),
    "all points moved with the last node: each has its own": lambda p, n, b, a: relaid(
        p, np.full(len(n), len(b) - 1), b, a
    ),
    "the old pose must be undone: inverse(before)": ("inverse(before[nodes]) => before[nodes]"),
    "from the new poses to the old ones": lambda p, n, b, a: relaid(p, n, a, b),
    "the points were taken for points in the frame of their node": lambda p, n, b, a: transform(
        np.asarray(a)[n], p[:, None]
    )[:, 0],
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a bug to find
#
# The old version pushes points and never turns them. A node turned by one degree leaves a point
# ten metres ahead 17 cm from where it belongs.

# %% active="ipynb" tags=["solution"]
# check_relaid(lambda points, nodes, before, after: points + (after - before)[nodes, :2])

# %% [markdown] tags=["statement"]
# ## Exercise 4: does the robot know how far it is off?
#
# Each of n robots ends with an error of its position and a covariance. In which share of the runs
# does the true position lie inside the 95 % ellipse? In the plane the squared, weighted error has
# the distribution $P(d^2 < c) = 1 - e^{-c/2}$.


# %% tags=["exercise"]
def inside(errors: Array, covs: Array) -> float:
    """Share of errors inside the 95 % ellipses.

    Parameters
    ----------
    errors : ndarray, shape (n, 2)
        (m).
    covs : ndarray, shape (n, 2, 2)
        (m^2).

    Returns
    -------
    float
        Between 0 and 1; an error on the ellipse does not count.
    """
    squared = (errors * np.linalg.solve(covs, errors[..., None])[..., 0]).sum(-1)
    return float(np.mean(squared < -2 * np.log(0.05)))


# %% active="ipynb" tags=["try"]
# inside(np.array([[2.4, 0.0], [2.5, 0.0]]), np.array([np.eye(2), np.eye(2)]))


# %% tags=["cases"]
def _ends(rng: np.random.Generator) -> Any:
    n = int(rng.integers(8, 20))
    covs = np.array([a_covariance(rng, 2) for _ in range(n)])
    errors = [np.linalg.cholesky(P) @ rng.normal(0, 2, 2) for P in covs]
    return np.round(errors, 3), covs


def _inside_drawn(ax: Any, function: Any) -> None:
    """Draw the share inside for covariances of many sizes; right ones hold 95 %."""
    from slamlab import plots

    rng = np.random.default_rng(3)
    covs = np.array([a_covariance(rng, 2) for _ in range(200)])
    unit = rng.normal(size=(200, 2, 1))
    errors = (np.linalg.cholesky(covs) @ unit)[..., 0]
    sizes = np.linspace(0.3, 2.0, 18)
    shares = [float(function(errors, f**2 * covs)) for f in sizes]
    ax.plot([0.3, 2.0], [0.95, 0.95], ":", color=plots.COLOURS["truth"])
    ax.plot(sizes, shares, "o-", color=plots.COLOURS["estimate"], markersize=4)
    ax.set(xlabel="ellipse, in sizes of the right one", ylabel="share inside")


check_inside = Check(
    inside,
    "share",
    {
        "one inside, one outside": ([[2.4, 0.0], [2.5, 0.0]], [np.eye(2), np.eye(2)]),
        "a long ellipse": ([[2.0, -2.0], [2.0, 2.0]], [[[1.0, 0.9], [0.9, 1.0]]] * 2),
        "any ends": _ends,
    },
    draws=12,
    picture=_inside_drawn,
)

# %% tags=["mistakes"]
check_inside.mistakes = {
    "1.96 sigma is a gate of one dimension: in the plane 5.99 bounds the square": (
        "-2 * np.log(0.05) => 1.96**2"
    ),
    "the square was compared with the root of the bound": (
        "-2 * np.log(0.05) => np.sqrt(-2 * np.log(0.05))"
    ),
    "the covariance was multiplied, not divided by": (
        "np.linalg.solve(covs, errors[..., None]) => (covs @ errors[..., None])"
    ),
    "each axis for itself: the correlation is missing": lambda e, P: float(
        np.mean((e**2 / np.diagonal(P, axis1=1, axis2=2)).sum(-1) < -2 * np.log(0.05))
    ),
    "95 % lie inside: 1 - exp(-c / 2) is 0.95, so exp(-c / 2) is 0.05": (
        "np.log(0.05) => np.log(0.95)"
    ),
    "this is the share outside": lambda e, P: 1 - inside(e, P),
    "this is a count: a share lies between 0 and 1": lambda e, P: inside(e, P) * len(e),
    "this is in per cent: a share lies between 0 and 1": lambda e, P: inside(e, P) * 100,
    "1.96 sigma for each axis is a rectangle, and holds another share": lambda e, P: float(
        np.mean((np.abs(e) < 1.96 * np.sqrt(np.diagonal(P, axis1=1, axis2=2))).all(-1))
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: does the robot know how far it is off?

# %% [markdown] tags=["solution"]
# The 1.96 of one dimension squared is 3.84, and an ellipse with it holds less than its 95 %:

# %% active="ipynb" tags=["solution"]
# print(f"{1 - np.exp(-1.96**2 / 2):.0%}")

# %% [markdown] tags=["statement"]
# <details><summary>Hint</summary>
#
# Solve $1 - e^{-c/2} = 0.95$ for $c$. `np.linalg.solve(covs, errors[..., None])` solves all n
# systems at once.
#
# </details>
#
# ## Exercise 5: how much do n runs prove?
#
# Three robots of three came home. Wilson's interval says which shares of successes are compatible
# with $k$ of $n$; its lower end is
#
# $$
# \frac{p + \frac{z^2}{2n} - z\sqrt{\frac{p(1-p)}{n} + \frac{z^2}{4n^2}}}{1 + \frac{z^2}{n}},
# \qquad p = \frac kn,\; z = 1.96 .
# $$


# %% tags=["exercise"]
def least_share(successes: int, runs: int) -> float:
    """Lower end of Wilson's 95 % interval.

    Parameters
    ----------
    successes, runs : int
        0 <= successes <= runs, runs at least 1.

    Returns
    -------
    float
    """
    p, z = successes / runs, 1.96
    middle = p + z**2 / (2 * runs)
    spread = z * np.sqrt(p * (1 - p) / runs + z**2 / (4 * runs**2))
    return (middle - spread) / (1 + z**2 / runs)


# %% active="ipynb" tags=["try"]
# least_share(3, 3)


# %% tags=["cases"]
def _trials(rng: np.random.Generator) -> Any:
    runs = int(rng.integers(2, 40))
    return int(rng.integers(0, runs + 1)), runs


def _least_drawn(ax: Any, function: Any) -> None:
    """Draw the lower end for each count of ten and of thirty runs, and the share itself."""
    from slamlab import plots

    ax.plot([0, 1], [0, 1], ":", color=plots.COLOURS["truth"])
    for runs, marker in ((10, "o"), (30, ".")):
        least = [float(function(k, runs)) for k in range(runs + 1)]
        ax.plot(
            np.arange(runs + 1) / runs,
            least,
            marker + "-",
            color=plots.COLOURS["estimate"],
            markersize=5,
            lw=1,
        )
    ax.set(xlabel="share seen (o: of 10, dots: of 30)", ylabel="share of all, at least")


check_least_share = Check(
    least_share,
    "share",
    {
        "three of three prove little": (3, 3),
        "thirty of thirty": (30, 30),
        "none of ten": (0, 10),
        "any count": _trials,
    },
    draws=12,
    picture=_least_drawn,
)

# %% tags=["mistakes"]
check_least_share.mistakes = {
    "this is the share itself": "(middle - spread) / (1 + z**2 / runs) => p",
    "this is the upper end": "middle - spread => middle + spread",
    "p - z sqrt(p (1 - p) / n) says that three of three prove everything": lambda k, n: float(
        k / n - 1.96 * np.sqrt(k / n * (1 - k / n) / n)
    ),
    "z = 1.645 leaves 5 % at this end alone; the 95 % here have 2.5 % at each": "1.96 => 1.645",
    "the last division is missing": " / (1 + z**2 / runs) => ",
    "the root needs z^2 / (4 n^2), not z^2 / (4 n)": "(4 * runs**2) => (4 * runs)",
}

# %% [markdown] tags=["solution"]
# ## Solution 5: how much do n runs prove?

# %% [markdown] tags=["solution"]
# The textbook's $p \pm z\sqrt{p(1-p)/n}$ has no width when all succeed, and would have three runs
# prove certainty:

# %% active="ipynb" tags=["solution"]
# for k, n in ((3, 3), (10, 10), (30, 30)):
#     print(f"{k} of {n}: at least {least_share(k, n):.0%}")

# %% [markdown] tags=["statement"]
# <details><summary>Hint</summary>
#
# For three of three the root is not zero, and the result is below one half.
#
# </details>

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 20](../solutions/20_explore_and_return.ipynb).
