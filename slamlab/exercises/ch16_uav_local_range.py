"""Exercises of 16: levelling, a range, records, the size of a region, eight points."""

# mypy: disable-error-code="no-untyped-def"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, drawn
from slamlab.exercises._report import Array, Check, Function

__all__ = [
    "check_fundamental",
    "check_level",
    "check_next_range",
    "check_note_update",
    "check_region_cost",
]


# %% [markdown] tags=["chapter"]
# # Exercises 16: UAV SLAM with a local range
#
# Five functions on the way from a tilted camera to a filter that works in a part of its map; the
# chapter is [UAV SLAM with a local range](../16_uav_local_range.ipynb), and its further pages are
# [16b](../16b_uav_local_range.ipynb), [16c](../16c_uav_local_range.ipynb),
# [16d](../16d_uav_local_range.ipynb) and [16e](../16e_uav_local_range.ipynb). Replace each
# `...` and run the check below it as often as you like.

# %% [markdown] tags=["solution"]
# # Solutions 16: UAV SLAM with a local range
#
# The exercises are in [Exercises 16](../exercises/16_uav_local_range.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: a measurement levelled, with a pencil
#
# An aircraft has axes ahead, left and up. It is tilted: first rolled (right wing down is
# positive), then pitched (nose down is positive). Work out on paper what a point at $z$ in the
# body's frame has as coordinates in a frame that is level and heads the same way. Begin with a
# pitch alone.


# %% tags=["exercise"]
def level(z: Array, roll: float, pitch: float) -> Array:
    """Turn a measured point from the tilted body into the level frame.

    Parameters
    ----------
    z : ndarray, shape (3,)
        Ahead, left, up in the frame of the body (m).
    roll, pitch : float
        Right wing down, nose down (rad). The level frame has R_y(pitch) R_x(roll) z.

    Returns
    -------
    ndarray, shape (3,)
        Ahead, left, up in the level frame (m).
    """
    ahead, left, up = z
    left, up = (
        np.cos(roll) * left - np.sin(roll) * up,
        np.sin(roll) * left + np.cos(roll) * up,
    )
    ahead, up = (
        np.cos(pitch) * ahead + np.sin(pitch) * up,
        np.cos(pitch) * up - np.sin(pitch) * ahead,
    )
    return np.array([ahead, left, up])


# %% active="ipynb" tags=["try"]
# level(np.array([20.0, 0.0, -17.32]), 0.0, np.pi / 6)

# %% [markdown] tags=["hint"]
# Nose straight down: where does a point ahead of the nose end? It must be below: `(0, 0, -1)` for
# `(1, 0, 0)`.

# %% [markdown] tags=["hint"]
# The roll turns left and up into each other, the pitch ahead and up. The second turn takes the
# *up* that the first one has left.


# %% tags=["cases"]
def _any_attitude(rng: np.random.Generator) -> Any:
    return np.round(rng.normal(size=3) * 10, 1), *np.round(rng.uniform(-0.8, 0.8, 2), 2)


def _level_drawn(ax: Any, function: Any) -> None:
    """Draw tree tops seen from a banking, diving aircraft as they are and as levelled."""
    from slamlab import plots

    ahead = np.linspace(-24, 24, 9)
    tops = np.column_stack([ahead, 3 * np.sin(ahead), -30 + 4 * np.cos(ahead) + 4])
    R_pitch, R_roll = _matrices(0.3, 0.5)
    levelled = [np.asarray(function(z, 0.3, 0.5), float) for z in tops @ R_pitch @ R_roll]
    plots.landmarks(ax, tops[:, [0, 2]])
    ax.plot(*np.array(levelled)[:, [0, 2]].T, "x", color=plots.COLOURS["estimate"], mew=1.5)
    ax.plot(0, 0, "o", color=plots.COLOURS["truth"])
    ax.plot(*np.array([[0.0, 0.0], [10 * np.cos(0.5), -10 * np.sin(0.5)]]).T, color="0.5")
    ax.set_aspect("equal")
    ax.set(xlabel="ahead (m)", ylabel="up (m)")


check_level = Check(
    level,
    "levelled",
    {
        "level already": ([20.0, 3.0, -17.0], 0.0, 0.0),
        "nose down by 30 degrees": ([20.0, 0.0, -17.32], 0.0, np.pi / 6),
        "right wing down by 20 degrees": ([5.0, 4.0, -20.0], np.pi / 9, 0.0),
        "any attitude": _any_attitude,
    },
    picture=_level_drawn,
)


# %% tags=["mistakes"]
def _matrices(roll: float, pitch: float) -> tuple[Array, Array]:
    c, s, C, S = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    R_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return np.array([[C, 0, S], [0, 1, 0], [-S, 0, C]]), R_x


check_level.mistakes = {
    "roll first, then pitch: here it is the other way round": lambda z, r, p: (
        _matrices(r, p)[1] @ _matrices(r, p)[0] @ z
    ),
    "this is the way from the level frame into the body: A, not its transpose": (
        lambda z, r, p: (_matrices(r, p)[0] @ _matrices(r, p)[1]).T @ z
    ),
    "roll and pitch have changed places": lambda z, r, p: (
        _matrices(p, r)[0] @ _matrices(p, r)[1] @ z
    ),
    "the sign of the pitch: a nose down turns what lies ahead down": lambda z, r, p: (
        _matrices(r, -p)[0] @ _matrices(r, -p)[1] @ z
    ),
    "the sign of the roll: a right wing down turns what lies to the left up": lambda z, r, p: (
        _matrices(-r, p)[0] @ _matrices(-r, p)[1] @ z
    ),
    "the signs of both angles": lambda z, r, p: _matrices(-r, -p)[0] @ _matrices(-r, -p)[1] @ z,
    "angles are in radians already": lambda z, r, p: (
        _matrices(*np.deg2rad([r, p]))[0] @ _matrices(*np.deg2rad([r, p]))[1] @ z
    ),
    "the height of the second turn must be that after the first": (
        "np.sin(pitch) * up => np.sin(pitch) * z[2]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: a measurement levelled, with a pencil
#
# A pitch of $\beta$ takes a point straight ahead, $(1, 0, 0)$, to $(\cos\beta, 0, -\sin\beta)$:
# down, since the nose is down. What was up, $(0, 0, 1)$, goes to $(\sin\beta, 0, \cos\beta)$. A
# roll does the same with left and up: a right wing down takes $(0, 1, 0)$ to $(0, \cos\alpha,
# \sin\alpha)$, up. Roll first, since $R_y R_x z$ reads from the right.

# %% [markdown] tags=["solution"]
# Both turns of the point as it came, none of the point that the other has turned: right for each
# angle alone, and wrong for a banking climb.

# %% active="ipynb" tags=["solution"]
# def each_alone(z, roll, pitch):
#     c, s, C, S = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
#     return np.array([C * z[0] + S * z[2], c * z[1] - s * z[2],
#                      C * (s * z[1] + c * z[2]) - S * z[0]])
#
# check_level(each_alone)

# %% [markdown] tags=["statement"]
# ## Exercise 2: the law of the range
#
# `n_seen` landmarks were seen within `reach`; `wanted` are to be seen. What should the next range
# be, if the landmarks are as dense there as here? The law is (A) of
# [page 16b](../16b_uav_local_range.ipynb).


# %% tags=["exercise"]
def next_range(reach: float, n_seen: int, wanted: float, nearest: float, furthest: float) -> float:
    """Range of the next measurements.

    Parameters
    ----------
    reach : float
        Range of the last measurements (m).
    n_seen : int
        Landmarks seen within it; may be 0.
    wanted : float
        Landmarks to see.
    nearest, furthest : float
        The range stays between them (m).

    Returns
    -------
    float
        Range (m).
    """
    if n_seen == 0:
        return furthest
    return float(np.clip(reach * np.sqrt(wanted / n_seen), nearest, furthest))


# %% active="ipynb" tags=["try"]
# next_range(20.0, 20, 5.0, 5.0, 40.0)

# %% [markdown] tags=["hint"]
# How many landmarks lie within twice the range: twice as many?

# %% [markdown] tags=["hint"]
# If nothing was seen, the range was too short, and nothing says by how much. What is the furthest
# range?


# %% tags=["cases"]
def _next_range_drawn(ax: Any, function: Any) -> None:
    """Draw the range over a dense wood and a clearing, and that which sees as many as wanted."""
    from slamlab import plots

    density = np.where((np.arange(40) > 12) & (np.arange(40) < 27), 0.004, 0.02)
    reach, kept = 30.0, []
    for rho in density:
        reach = float(function(reach, int(rho * np.pi * reach**2), 8.0, 5.0, 40.0))
        kept.append(reach)
    ax.step(range(40), np.sqrt(8.0 / (np.pi * density)), where="post", **plots.line_style("truth"))
    ax.plot(kept, ".-", color=plots.COLOURS["estimate"])
    ax.set(xlabel="step", ylabel="range (m)")


check_next_range = Check(
    next_range,
    "range",
    {
        "as many as wanted": (20.0, 10, 10.0, 3.0, 30.0),
        "four times too many": (20.0, 20, 5.0, 5.0, 40.0),
        "nothing seen": (12.0, 0, 5.0, 5.0, 40.0),
        "never nearer": (12.0, 200, 2.0, 5.0, 40.0),
        "never further": (30.0, 1, 10.0, 5.0, 40.0),
        "another drone, which flies lower: nothing seen": (6.0, 0, 5.0, 1.5, 20.0),
        "another drone: never nearer": (6.0, 300, 2.0, 1.5, 20.0),
        "another drone: never further": (15.0, 1, 10.0, 1.5, 20.0),
        "any numbers": lambda rng: (
            np.round(rng.uniform(8, 30), 1),
            int(rng.integers(3, 30)),
            np.round(rng.uniform(4, 12), 1),
            4.0,
            60.0,
        ),
    },
    picture=_next_range_drawn,
)

# %% tags=["mistakes"]
check_next_range.mistakes = {
    "landmarks grow with the area, not with the range: a square root is missing": (
        "np.sqrt(wanted / n_seen) => (wanted / n_seen)"
    ),
    "who sees too many should look less far: the ratio is upside down": (
        "wanted / n_seen => n_seen / wanted"
    ),
    "who sees nothing should look as far as it can": "return furthest => return nearest",
    "none seen is not one seen: take the furthest range": lambda r, n, w, a, b: np.clip(
        r * np.sqrt(w / max(n, 1)), a, b
    ),
    "with nothing seen the range must grow": "return furthest => return reach",
    "the range must stay between nearest and furthest": "nearest, furthest) => 0.0, np.inf)",
    "this law forgets how far it looked: the density is n / (pi r^2)": (
        lambda r, n, w, a, b: b if n == 0 else np.clip(np.sqrt(w / n) * b, a, b)
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: the law of the range
#
# $n = \rho\pi r^2$ at the last range and $n^* = \rho\pi r'^2$ at the next: divide, and $r' =
# r\sqrt{n^*/n}$. The density drops out.

# %% [markdown] tags=["solution"]
# Without the root the law overshoots: four times too many are seen, the range falls to a quarter,
# and then a quarter of what is wanted is seen. It swings for ever.

# %% active="ipynb" tags=["solution"]
# def swings(reach, n_seen, wanted, nearest, furthest):
#     if n_seen == 0:
#         return furthest
#     return float(np.clip(reach * wanted / n_seen, nearest, furthest))
#
# check_next_range(swings)

# %% [markdown] tags=["statement"]
# ## Exercise 3: a bug to find
#
# These five lines keep the records of a region at an update. With them the compressed filter's
# map is wrong from the first update on. Compare them with (B), (C) and (D) of
# [the chapter](../16_uav_local_range.ipynb), line by line, then
# mend them.


# %% tags=["exercise"]
def note_update(
    Phi: Array, Psi: Array, theta: Array, H: Array, S: Array, v: Array, K: Array
) -> tuple[Array, Array, Array]:
    """Record an update of the region for the rest of the map.

    Parameters
    ----------
    Phi, Psi : ndarray, shape (n, n)
        The records before the update.
    theta : ndarray, shape (n,)
    H : ndarray, shape (m, n)
        Jacobian of the measurement by the region's state.
    S : ndarray, shape (m, m)
        Innovation covariance.
    v : ndarray, shape (m,)
        Innovation.
    K : ndarray, shape (n, m)
        Gain.

    Returns
    -------
    Phi, Psi, theta : tuple of ndarray
        The records after it.
    """
    told = Phi.T @ H.T @ np.linalg.inv(S)
    Psi = Psi + told @ H @ Phi
    theta = theta + told @ v
    Phi = Phi - K @ H @ Phi
    return Phi, Psi, theta


# %% active="ipynb" tags=["stub"]
#     Phi = Phi - K @ H @ Phi
#     told = Phi.T @ H.T @ np.linalg.inv(S)
#     Psi = Psi + told @ H @ Phi
#     theta = theta + told @ v
#     return Phi, Psi, theta

# %% active="ipynb" tags=["try"]
# one = np.eye(1)
# note_update(one, 0 * one, np.zeros(1), one, 1.1 * one, np.array([0.5]), one / 1.1)

# %% [markdown] tags=["hint"]
# By hand, with one number: $\Phi = 1$, $H = 1$, $S = 1.1$, $K = 1/1.1$. What does the chapter
# add to $\Psi$?

# %% [markdown] tags=["hint"]
# $\Phi$ says how the region's state at the *entry* shows in its state *before* this update.


# %% tags=["cases"]
@drawn
def _an_update(rng: np.random.Generator, n: int, m: int) -> Any:
    P, H = a_covariance(rng, n), np.round(rng.normal(size=(m, n)), 2)
    S = H @ P @ H.T + 0.1 * np.eye(m)
    Phi, v = np.round(rng.normal(size=(n, n)), 2), np.round(rng.normal(size=m), 2)
    K = P @ H.T @ np.linalg.inv(S)
    return Phi, a_covariance(rng, n), np.round(rng.normal(size=n), 2), H, S, v, K


def _note_update_drawn(ax: Any, function: Any) -> None:
    """Draw a landmark outside the region, two standard deviations wide: at once, and delayed."""
    from slamlab import plots

    rng, n = np.random.default_rng(4), 3
    P = a_covariance(rng, n + 1)
    error = np.linalg.cholesky(P) @ rng.standard_normal(n + 1)
    x, P_all, first = np.zeros(n + 1), P.copy(), P.copy()
    Phi, Psi, theta = np.eye(n), np.zeros((n, n)), np.zeros(n)
    at_once, delayed = [], []
    for _ in range(12):
        H = np.append(rng.standard_normal(n), 0.0)[None]
        S = H @ P_all @ H.T + 0.09 * np.eye(1)
        K, v = P_all @ H.T / S, H @ (error - x) + rng.normal(0, 0.3, 1)
        came = function(Phi, Psi, theta, H[:, :n], S, v, K[:n])
        Phi, Psi, theta = (np.asarray(one, float) for one in came)
        x, P_all = x + K @ v, P_all - K @ H @ P_all
        P_ba = first[n:, :n]
        variance = (first[n:, n:] - P_ba @ Psi @ P_ba.T).item()
        at_once.append([x[n], np.sqrt(P_all[n, n])])
        delayed.append([(P_ba @ theta).item(), np.sqrt(max(variance, 0.0))])
    for found, kind in ((at_once, "truth"), (delayed, "estimate")):
        middle, sigma = np.array(found).T
        ax.plot(middle, **plots.line_style(kind))
        for side in (-2, 2):
            ax.plot(middle + side * sigma, color=plots.COLOURS[kind], lw=0.8)
    ax.axhline(error[n], color="0.5", ls=":")
    ax.set(xlabel="observations in the region", ylabel="a landmark outside (m)")


check_note_update = Check(
    note_update,
    "Phi, Psi, theta",
    {
        "one number, the first update": (
            [[1.0]],
            [[0.0]],
            [0.0],
            [[1.0]],
            [[1.1]],
            [0.5],
            [[1 / 1.1]],
        ),
        "one number, after others": ([[0.3]], [[2.0]], [0.4], [[1.0]], [[0.5]], [-0.2], [[0.8]]),
        "a region of three numbers": _an_update(3, 2),
        "a region of five numbers": _an_update(5, 2),
    },
    tolerance=1e-8,
    picture=_note_update_drawn,
    hunt=True,
)


# %% tags=["mistakes"]
def _phi_first(
    Phi: Array, Psi: Array, theta: Array, H: Array, S: Array, v: Array, K: Array
) -> tuple[Array, Array, Array]:
    return note_update(Phi - K @ H @ Phi, Psi, theta, H, S, v, K)[1:]  # type: ignore[return-value]


check_note_update.mistakes = {
    "Psi and theta need the Phi from before the update: do these first": lambda *a: (
        a[0] - a[6] @ a[3] @ a[0],
        *_phi_first(*a),
    ),
    "only theta was summed with the Phi from after the update": lambda *a: (
        *note_update(*a)[:2],
        _phi_first(*a)[1],
    ),
    "the information is about the state at the entry: Phi^T is missing": "Phi.T @ H.T => H.T",
    "Psi and theta are sums: what was in them before is gone": lambda *a: note_update(
        a[0], 0 * a[1], 0 * a[2], *a[3:]
    ),
    "Phi <- (I - K H) Phi: here Phi stands on the other side": (
        "Phi = Phi - K @ H @ Phi => Phi = Phi - Phi @ K @ H"
    ),
    "S must be inverted": "np.linalg.inv(S) => S",
    "S is missing: what an observation adds counts as much as the inverse of S": (
        " @ np.linalg.inv(S) => "
    ),
    "Phi starts anew here: what happened before this update is lost": (
        "Phi = Phi - K @ H @ Phi => Phi = np.eye(len(Phi)) - K @ H"
    ),
    "the Phi that is given is used nowhere: as if each update were the first": lambda *a: (
        note_update(np.eye(len(a[0])), *a[1:])
    ),
    "Psi grows: what is observed adds information": "Psi + told @ H @ Phi => Psi - told @ H @ Phi",
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a bug to find
#
# $\Phi$ was updated before it was used. What this update says about the state at the entry goes
# through the $\Phi$ from *before* it. With one number: $\Psi$ must become $1/1.1 =
# 0.91$; with $\Phi = 1 - 1/1.1$ it became 0.0075, as if next to nothing had been measured.

# %% [markdown] tags=["statement"]
# ## Exercise 4: the size of a region
#
# Write (A) of [page 16e](../16e_uav_local_range.ipynb) as a
# function of many radii, and let it choose. With $N_a = 2\rho\pi R^2$ numbers in the region
# (never more than the map's $N = 2n$), $m = 2\rho\pi r^2$ in an observation, $D = R - r$ and
# $k = 2\rho(2rD + \pi r^2)$ observed in a region (never more than $N_a$),
#
# $$
# C(R) = 2 m N_a^2 + \Big(\tfrac12 k N^2 + k^2 N + N_a^2 N\Big)\frac{s}{D} .
# $$


# %% tags=["exercise"]
def region_cost(
    R: Array, n: int, density: float, reach: float, stride: float
) -> tuple[Array, float]:
    """Products a step of a compressed filter, and the best of the radii.

    Parameters
    ----------
    R : ndarray, shape (k,)
        Radii of the region to compare (m), larger than the reach.
    n : int
        Landmarks in the map.
    density : float
        Landmarks a square metre.
    reach : float
        Range r of the sensor (m).
    stride : float
        Metres s a step.

    Returns
    -------
    cost : ndarray, shape (k,)
        Products a step.
    best : float
        The radius of the smallest (m).
    """
    N, m, drive = 2 * n, 2 * density * np.pi * reach**2, R - reach
    inside = np.minimum(2 * density * np.pi * R**2, N)
    told = np.minimum(2 * density * (2 * reach * drive + np.pi * reach**2), inside)
    settle = 0.5 * told * N**2 + told**2 * N + inside**2 * N
    cost = 2 * m * inside**2 + settle * stride / drive
    return cost, R[np.argmin(cost)]


# %% active="ipynb" tags=["try"]
# region_cost(np.array([22.0, 28.0, 37.0, 50.0]), 576, 0.01, 20.0, 2.0)

# %% [markdown] tags=["hint"]
# All radii at once, no loop. `np.minimum` keeps a count below another.

# %% [markdown] tags=["hint"]
# `np.argmin` gives the place of the smallest cost, not the radius.


# %% tags=["cases"]
def _radii(rng: np.random.Generator) -> Any:
    reach = np.round(rng.uniform(8, 25), 1)
    return (
        reach + np.sort(np.round(rng.uniform(0.5, 60, 6), 1)),
        int(rng.integers(200, 2000)),
        np.round(rng.uniform(0.004, 0.03), 3),
        reach,
        np.round(rng.uniform(0.5, 4), 1),
    )


def _region_cost_drawn(ax: Any, function: Any) -> None:
    """Draw the products of three maps against the radius, full filter = 1, and the best radii."""
    from slamlab import plots

    R = np.linspace(21.0, 90.0, 70)
    for n, style in ((196, ":"), (576, "-"), (1024, "--")):
        cost, best = function(R, n, 0.01, 20.0, 2.0)
        share = np.asarray(cost, float) / (0.5 * 8 * np.pi * (2 * n) ** 2)
        ax.plot(R, np.minimum(share, 1.6), ls=style, color=plots.COLOURS["estimate"])
        at = float(best)
        ax.plot(at, np.interp(at, R, share), "o", color=plots.COLOURS["estimate"])
    ax.axhline(1, **plots.line_style("truth"))
    ax.set(xlabel="radius of the region (m)", ylabel="products, full filter = 1", ylim=(0, 1.6))


check_region_cost = Check(
    region_cost,
    "cost, best",
    {
        "the field of the chapter": ([22.0, 28.0, 37.0, 50.0, 90.0], 576, 0.01, 20.0, 2.0),
        "a larger map": ([30.0, 40.0, 60.0, 80.0], 5000, 0.01, 20.0, 2.0),
        "a small map, all of it in the region": ([25.0, 90.0, 200.0], 60, 0.01, 20.0, 2.0),
        "a slow aircraft over dense trees": ([12.0, 15.0, 19.0, 30.0], 900, 0.04, 10.0, 0.5),
        "any field": _radii,
    },
    picture=_region_cost_drawn,
)

# %% tags=["mistakes"]
check_region_cost.mistakes = {
    "a region is left after R - r, not after R": (
        "settle * stride / drive => settle * stride / R"
    ),
    "a region is left every D / s steps: divide by D / s": (
        "settle * stride / drive => settle * drive / stride"
    ),
    "a region is left at every step here: divide by D / s": "settle * stride / drive => settle",
    "a landmark has two numbers": (
        "N, m, drive = 2 * n, 2 * density => N, m, drive = n, density",
        "np.minimum(2 * density * np.pi => np.minimum(density * np.pi",
        "np.minimum(2 * density * (2 => np.minimum(density * (2",
    ),
    "the map holds N = 2 n numbers": "N, m, drive = 2 * n, => N, m, drive = n,",
    "of the symmetric P_bb one triangle is enough: k N^2 / 2": "0.5 * told => told",
    "P_aa and Psi are symmetric, one triangle is enough of each: 2 m N_a^2": (
        "2 * m * inside**2 => 3 * m * inside**2"
    ),
    "the area of a circle has a factor pi": (
        "2 * density * np.pi * reach**2 => 2 * density * reach**2",
        "2 * density * np.pi * R**2 => 2 * density * R**2",
        "+ np.pi * reach**2 => + reach**2",
    ),
    "this is the most expensive radius": "argmin => argmax",
    "this is the place of the best radius in the list: expected the radius itself": (
        "R[np.argmin(cost)] => np.argmin(cost)"
    ),
    "this is the smallest cost: expected its radius": "R[np.argmin(cost)] => cost.min()",
    "leaving a region costs nothing here": (
        "settle = 0.5 * told * N**2 + told**2 * N + inside**2 * N => settle = 0 * told"
    ),
    "only P_bb is brought up to date: P_ab takes N_a^2 N": " + inside**2 * N => ",
    "only P_ab is brought up to date: P_bb takes k^2 N + k N^2 / 2": (
        "0.5 * told * N**2 + told**2 * N +  => "
    ),
    "Psi P_ab takes k^2 N products, too": " + told**2 * N => ",
    "a local step costs something too": "2 * m * inside**2 +  => ",
    "in a region no more numbers are observed than it holds": (
        "np.minimum(2 * density * (2 * reach * drive + np.pi * reach**2), inside)"
        " => 2 * density * (2 * reach * drive + np.pi * reach**2)"
    ),
    "a region holds no more numbers than the map": (
        "np.minimum(2 * density * np.pi * R**2, N) => 2 * density * np.pi * R**2"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: the size of a region

# %% [markdown] tags=["solution"]
# If a region lasts $R$ metres instead of $R - r$, one too small often seems the best, and the
# filter sees beyond its edge before it is left:

# %% active="ipynb" tags=["solution"]
# def lasts_too_long(R, n, density, reach, stride):
#     N, m = 2 * n, 2 * density * np.pi * reach**2
#     inside = np.minimum(2 * density * np.pi * R**2, N)
#     ring = 2 * reach * (R - reach) + np.pi * reach**2
#     told = np.minimum(2 * density * ring, inside)
#     settle = 0.5 * told * N**2 + told**2 * N + inside**2 * N
#     cost = 2 * m * inside**2 + settle * stride / R
#     return cost, R[np.argmin(cost)]
#
# check_region_cost(lasts_too_long)

# %% [markdown] tags=["statement"]
# ## Exercise 5: eight points, assembled
#
# Put the normalised eight-point algorithm together: normalise both pictures, a row of nine
# products a pair, the last right singular vector, rank 2, undo. Its scale and its sign mean
# nothing; the check does not look at them.


# %% tags=["exercise"]
def fundamental(first: Array, second: Array) -> Array:
    """Fundamental matrix of two pictures.

    Parameters
    ----------
    first, second : ndarray, shape (n, 2)
        The same n >= 8 points in both pictures (pixels).

    Returns
    -------
    ndarray, shape (3, 3)
        F of rank 2 with [second, 1] F [first, 1]^T = 0, in least squares.
    """

    def normalised(points):
        centre = points.mean(axis=0)
        s = np.sqrt(2) / np.linalg.norm(points - centre, axis=1).mean()
        T = np.array([[s, 0, -s * centre[0]], [0, s, -s * centre[1]], [0, 0, 1]])
        return np.column_stack([points, np.ones(len(points))]) @ T.T, T

    x, T = normalised(first)
    x_there, T_there = normalised(second)
    A = np.array([np.outer(b, a).ravel() for a, b in zip(x, x_there)])
    F = np.linalg.svd(A)[2][-1].reshape(3, 3)
    U, s, Vt = np.linalg.svd(F)
    return T_there.T @ U @ np.diag([s[0], s[1], 0]) @ Vt @ T


# %% active="ipynb" tags=["try"]
# fundamental(np.random.default_rng(0).uniform(0, 640, (9, 2)),
#             np.random.default_rng(1).uniform(0, 640, (9, 2)))

# %% [markdown] tags=["hint"]
# `np.column_stack([points, np.ones(len(points))]) @ T.T` moves points by a 3 by 3 matrix `T`.

# %% [markdown] tags=["hint"]
# `np.outer(b, a).ravel()` is a row: nine products of the second point `b` with the first one `a`.
# `np.linalg.svd(A)[2][-1]` is the last right singular vector.

# %% [markdown] tags=["hint"]
# If $\hat{\mathbf x} = T\mathbf x$ and $\hat{\mathbf x}'^\top \hat F \hat{\mathbf x} = 0$, which
# matrix stands between $\mathbf x'^\top$ and $\mathbf x$?


# %% tags=["cases"]
@drawn
def _two_pictures(rng: np.random.Generator, n: int, noise: float) -> Any:
    depth = rng.uniform(22, 30, n)
    points = np.column_stack([rng.uniform(-15, 15, n), rng.uniform(-11, 11, n), depth])
    return tuple(
        np.round(600 * p[:, :2] / p[:, 2:] + [320, 240] + noise * rng.normal(size=(n, 2)), 3)
        for p in (points, points + rng.uniform([1, -1, -0.5], [3, 1, 0.5]))
    )


def _of_unit_length(fundamental: Function, first: Array, second: Array) -> Any:
    """F up to its scale and sign, which mean nothing."""
    F = np.asarray(fundamental(first, second), dtype=float)
    if F.shape != (3, 3) or not np.isfinite(F).all() or not F.any():
        return F
    # In the units of a picture 1 wide, so that all nine numbers count.
    F = F * np.outer([600.0, 600.0, 1.0], [600.0, 600.0, 1.0])
    F = F / np.linalg.norm(F)
    return F * np.sign(F.flat[np.abs(F).argmax()])


def _fundamental_drawn(ax: Any, function: Any) -> None:
    """Draw the points of the second picture and the line on which each should be."""
    from slamlab import plots

    first, second = _two_pictures(40, 0.5)(np.random.default_rng(8))
    F = np.asarray(function(first, second), float)
    edge = np.array([0.0, 640.0])
    for a, b, c in (F @ np.append(point, 1.0) for point in first[:8]):
        line = np.clip(-(a * edge + c) / b, -200, 700)
        ax.plot(edge, line, color=plots.COLOURS["estimate"], lw=1)
    ax.plot(*second[:8].T, "o", mfc="none", color=plots.COLOURS["truth"])
    ax.set_aspect("equal")
    ax.set(xlim=(0, 640), ylim=(480, 0), xlabel="u (pixels)", ylabel="v (pixels)")


check_fundamental = Check(
    fundamental,
    "F of unit length, pictures one wide",
    {
        "eight pairs": _two_pictures(8, 0.5),
        "forty pairs, no noise": _two_pictures(40, 0.0),
        "forty pairs, half a pixel of noise": _two_pictures(40, 0.5),
        "two hundred pairs": _two_pictures(200, 0.5),
    },
    tolerance=1e-6,
    draws=4,
    use=_of_unit_length,
    picture=_fundamental_drawn,
)


# %% tags=["mistakes"]
def _plain(first: Array, second: Array) -> Array:
    one = np.ones((len(first), 1))
    A = np.hstack([np.hstack([second, one])[:, [i]] * np.hstack([first, one]) for i in range(3)])
    U, s, Vt = np.linalg.svd(np.linalg.svd(A)[2][-1].reshape(3, 3))
    F: Array = U @ np.diag([s[0], s[1], 0]) @ Vt
    return F


check_fundamental.mistakes = {
    "the points were not normalised": _plain,
    "the normalisation was not undone: T'^T F T": (
        "T_there.T @ U => U",
        "@ Vt @ T => @ Vt",
    ),
    "T'^T F T: the two transforms have changed places": (
        "T_there.T @ U => T.T @ U",
        "@ Vt @ T => @ Vt @ T_there",
    ),
    "F must have rank 2: set its smallest singular value to zero": (
        "np.diag([s[0], s[1], 0]) => np.diag(s)"
    ),
    "this F takes the second picture to the first: transpose it": lambda first, second: (
        fundamental(second, first)
    ),
    "the smallest |A f| has the last singular vector, not the first": "[2][-1] => [2][0]",
    "a mean distance of sqrt 2, not of 2": "np.sqrt(2) => 2",
    "T'^T F T: the transforms themselves, not their inverses": (
        "T_there.T @ U => np.linalg.inv(T_there).T @ U",
        "@ Vt @ T => @ Vt @ np.linalg.inv(T)",
    ),
    "all pairs count, not the first eight alone": lambda first, second: fundamental(
        first[:8], second[:8]
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: eight points, assembled

# %% [markdown] tags=["solution"]
# Without step 3 the epipolar lines do not meet in one point, and no camera belongs to this $F$.
# Where there is hardly noise it makes hardly a difference (the second case has rounded pixels):

# %% active="ipynb" tags=["solution"]
# def rank_three(first, second):
#     def normalised(points):
#         centre = points.mean(axis=0)
#         s = np.sqrt(2) / np.linalg.norm(points - centre, axis=1).mean()
#         T = np.array([[s, 0, -s * centre[0]], [0, s, -s * centre[1]], [0, 0, 1]])
#         return np.column_stack([points, np.ones(len(points))]) @ T.T, T
#
#     x, T = normalised(first)
#     x_there, T_there = normalised(second)
#     A = np.array([np.outer(b, a).ravel() for a, b in zip(x, x_there)])
#     return T_there.T @ np.linalg.svd(A)[2][-1].reshape(3, 3) @ T
#
# check_fundamental(rank_three)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 16](../solutions/16_uav_local_range.ipynb).
