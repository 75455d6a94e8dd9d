"""Exercises of 16: a camera's ground, a gyro, a range, a radio's update, leaving, a flight."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, call-arg, arg-type"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, an_angle, drawn
from slamlab.exercises._report import Array, Check, Ints
from slamlab.geometry import wrap_angle

__all__ = [
    "check_direction_of_move",
    "check_fly",
    "check_ground_points",
    "check_leave",
    "check_next_range",
    "check_range_update",
]


# %% [markdown] tags=["chapter"]
# # Exercises 16: UAV SLAM with a local range
#
# Six exercises on a survey aircraft: its camera's ground, with a pencil; its move from two trees;
# a range that remembers; and then a radio in place of the camera: an update with two bugs, the
# return to the whole map, and the flight that puts these together. The chapter is [UAV SLAM with a
# local range](../16_uav_local_range.ipynb); Exercises 4 to 6 need the lesson only. Exercise 1
# belongs to [16c](../16c_uav_local_range.ipynb), 2 to [16d](../16d_uav_local_range.ipynb), 3 to
# [16b](../16b_uav_local_range.ipynb). Replace each `...` and run the check below it as often as
# you like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 16: UAV SLAM with a local range
#
# The exercises are in [Exercises 16](../exercises/16_uav_local_range.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: where on the ground? With a pencil
#
# An aircraft flies 30 m above flat ground and banks: its right wing is down by 20 degrees. The
# camera under its belly is fixed to the body, and gives directions, no metres; the altimeter gives
# the height. **Write down first**: the point in the middle of the picture, is it to the left or to
# the right of the aircraft, and how many metres from the point straight below? Then write
# it for any direction and any attitude.
#
# Both frames have axes ahead, left and up. The level frame heads the way the body does. A
# direction $z$ in the body's frame is $R_y(\beta)\,R_x(\alpha)\,z$ in the level one: first the
# roll $\alpha$ turns it about the axis ahead, then the pitch $\beta$ about the axis to the left.
# Positive is *right wing down*: a roll of 90° takes $(0, 1, 0)$ to $(0, 0, 1)$. And *nose down*: a
# pitch of 90° takes $(1, 0, 0)$ to $(0, 0, -1)$.


# %% tags=["exercise"]
def ground_points(rays: Array, roll: float, pitch: float, height: float) -> Array:
    """Points of flat ground that a camera sees in these directions.

    Parameters
    ----------
    rays : ndarray, shape (n, 3)
        Directions ahead, left and up in the frame of the body, of any length; n may
        be 0.
    roll, pitch : float
        Right wing down, nose down (rad).
    height : float
        Height of the camera above the ground (m).

    Returns
    -------
    ndarray, shape (n, 2)
        Metres ahead and to the left of the point straight below the camera, in the
        level frame. NaN, twice, where a ray is level or points up: it meets no
        ground.
    """
    c, s, C, S = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    ahead, left, up = rays.T
    left, up = c * left - s * up, s * left + c * up
    ahead, up = C * ahead + S * up, C * up - S * ahead
    down = np.where(up < 0, -up, np.nan)
    return height * np.column_stack([ahead, left]) / down[:, None]


# %% active="ipynb" tags=["try"]
# ground_points(np.array([[0.0, 0.0, -1.0]]), np.radians(20), 0.0, 30.0)

# %% [markdown] tags=["hint"]
# Draw the aircraft from behind, its right wing down. To which side does its belly point?

# %% [markdown] tags=["hint"]
# The roll mixes left and up, the pitch ahead and up. The *up* that the second turn takes is the
# one that the first has left.

# %% [markdown] tags=["hint"]
# In the level frame a ray goes some way down while it goes some way aside. How much longer must it
# be made to go down by the height?


# %% tags=["cases"]
def _m(metres: Any, digits: int = 1) -> str:
    """Write metres as the title of a picture has them."""
    return f"{metres:.{digits}f} m" if metres < 100 else "over 100 m"


def _any_attitude(rng: np.random.Generator) -> Any:
    rays = np.column_stack([rng.normal(size=(5, 2)), rng.uniform(-1.5, -0.1, 5)])
    return (
        np.round(rays * rng.uniform(0.5, 3, (5, 1)), 2),
        *np.round(rng.uniform(-0.8, 0.8, 2), 2),
        np.round(rng.uniform(10, 60), 1),
    )


def _ground_drawn(ax: Any, function: Any) -> None:
    """Draw trees of a field and where three photographs of a banking aircraft put them."""
    from slamlab import plots

    rng = np.random.default_rng(3)
    trees = rng.uniform([-30, -25], [70, 25], (60, 2))
    at = [(0.0, 0.35, 0.1), (20.0, -0.3, 0.0), (40.0, 0.25, -0.3)]
    found, off = [], []
    for x, roll, pitch in at:
        near = trees[np.hypot(*(trees - [x, 0.0]).T) < 22]
        level = np.column_stack([near - [x, 0.0], np.full(len(near), -30.0)])
        R_pitch, R_roll = _matrices(roll, pitch)
        rays = level @ R_pitch @ R_roll
        here = np.reshape(function(rays / 30, roll, pitch, 30.0), (-1, 2)) + [x, 0.0]
        found.append(here)
        off.append(np.hypot(*(here - near).T))
    plots.landmarks(ax, trees)
    ax.plot([x for x, *_ in at], [0.0] * 3, "o", color=plots.COLOURS["truth"])
    for here in found:
        ax.plot(*here.T, "x", color=plots.COLOURS["estimate"], mew=1.5)
    ax.set_aspect("equal")
    ax.set(xlim=(-30, 70), ylim=(-32, 32), xlabel="ahead (m)", ylabel="left (m)")
    ax.set_title(f"off by {_m(np.concatenate(off).mean())}")


_CROSS = [[0.0, 0.0, -1.0], [0.5, 0.0, -1.0], [0.0, 0.5, -1.0], [-0.2, -0.7, -0.9]]

check_ground_points = Check(
    ground_points,
    "ground points",
    {
        "level already": (_CROSS, 0.0, 0.0, 30.0),
        "right wing down by 20 degrees": (_CROSS, np.pi / 9, 0.0, 30.0),
        "nose down by 30 degrees": (_CROSS, 0.0, np.pi / 6, 17.32),
        "a tree 20 m ahead of the nose and 17.32 m below the belly": (
            [[20.0, 0.0, -17.32]],
            0.0,
            np.pi / 6,
            25.0,
        ),
        "rays along the horizon and above it": (
            [[1.0, 0.0, 0.0], [0.0, -2.0, 0.0], [3.0, 1.0, 0.2], [1.0, 1.0, -0.5]],
            0.0,
            0.0,
            12.0,
        ),
        "above the horizon for the body, below it for the world": (
            [[1.0, 0.0, 0.2], [0.0, -1.0, 0.1], [-1.0, 0.0, -0.2]],
            0.3,
            0.5,
            40.0,
        ),
        "no ray": (np.zeros((0, 3)), 0.1, 0.2, 20.0),
        "any attitude": _any_attitude,
    },
    picture=_ground_drawn,
)


# %% tags=["mistakes"]
def _matrices(roll: float, pitch: float) -> tuple[Array, Array]:
    c, s, C, S = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    R_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return np.array([[C, 0, S], [0, 1, 0], [-S, 0, C]]), R_x


def _met(level: Array, height: float) -> Array:
    return height * level[:, :2] / np.where(level[:, 2:] < 0, -level[:, 2:], np.nan)


check_ground_points.mistakes = {
    "first the roll, then the pitch: here it is the other way round": lambda z, r, p, h: _met(
        z @ _matrices(r, p)[0].T @ _matrices(r, p)[1].T, h
    ),
    "this turns from the level frame into the body: the inverse is expected": (
        lambda z, r, p, h: _met(z @ _matrices(r, p)[0] @ _matrices(r, p)[1], h)
    ),
    "roll and pitch have changed places": lambda z, r, p, h: ground_points(z, p, r, h),
    "the sign of the pitch: a nose down turns what is ahead down": lambda z, r, p, h: (
        ground_points(z, r, -p, h)
    ),
    "the sign of the roll: a right wing down turns what is to the left up": lambda z, r, p, h: (
        ground_points(z, -r, p, h)
    ),
    "the signs of both angles": lambda z, r, p, h: ground_points(z, -r, -p, h),
    "angles are in radians already": lambda z, r, p, h: ground_points(
        z, np.deg2rad(r), np.deg2rad(p), h
    ),
    "the second turn takes the up that the first one has left": (
        "C * ahead + S * up, C * up - S * ahead => C * ahead + S * rays[:, 2], C * up - S * ahead"
    ),
    "the ray was not turned level: roll and pitch are not used": lambda z, r, p, h: _met(z, h),
    "the height is measured straight down, not along the ray": (
        "height * np.column_stack([ahead, left]) / down[:, None] => height"
        " * np.column_stack([ahead, left]) / np.linalg.norm(rays, axis=1)[:, None]"
        " * (down / down)[:, None]"
    ),
    "the ray was not made longer: it must go down by the height": (
        "height * np.column_stack([ahead, left]) / down[:, None]"
        " => np.column_stack([ahead, left]) * (down / down)[:, None]"
    ),
    "a ray above the horizon meets the ground behind the aircraft here: expected NaN": (
        "np.where(up < 0, -up, np.nan) => -up"
    ),
    "up is negative for what is below: these points are on the wrong side": (
        "np.where(up < 0, -up, np.nan) => np.where(up < 0, up, np.nan)"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: where on the ground?
#
# To the left: the right wing is down, so the belly points to the left. The roll takes the belly's
# $(0, 0, -1)$ to $(0, \sin\alpha, -\cos\alpha)$; made longer until it goes down by the height, it
# is $30 \tan 20° = 10.9$ m to the left. The levelled *measurement* of
# [16c](../16c_uav_local_range.ipynb) has three numbers; a direction has two, and the height gives
# the third. That needs flat ground: a treetop of 8 m seen 20 m aside is put $20 \cdot 8 / 22 =
# 7.3$ m too far out.

# %% [markdown] tags=["solution"]
# Both turns of the ray as it came, none of the ray that the other has turned: right for each
# angle alone, and wrong for a banking dive.

# %% active="ipynb" tags=["solution"]
# def each_alone(rays, roll, pitch, height):
#     c, s, C, S = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
#     ahead, left, up = rays.T
#     down = S * ahead - C * (s * left + c * up)
#     down = np.where(down > 0, down, np.nan)
#     level = np.column_stack([C * ahead + S * up, c * left - s * up])
#     return height * level / down[:, None]
#
# check_ground_points(each_alone)

# %% [markdown] tags=["statement"]
# ## Exercise 2: with a gyro, how many trees are enough?
#
# [Page 16d](../16d_uav_local_range.ipynb) takes the camera's move from eight points in two
# pictures, by the fundamental matrix. Over flat ground that fails: its trees were 11 m off in
# depth. And what ruined the depth elsewhere was the rotation. But the aircraft has a gyro, which
# gives the rotation $R$ between the two pictures. What is left to find? **Write down** how many
# trees that takes.
#
# A tree at $q$ from the first camera is at $q' = Rq + t$ from the second. The pictures give the
# two directions: $a$ is along $q$, $b$ along $q'$, each with 1 as its third number. So $Ra$, $b$
# and $t$ are in one plane. Write the direction of $t$, from $n \ge 2$ trees, in least squares. One
# camera gives no metres, so $t$ has length 1. But its sign has a meaning: both cameras see the
# trees ahead of them.


# %% tags=["exercise"]
def direction_of_move(a: Array, b: Array, R: Array) -> Array:
    """Direction of the move between two pictures, if the rotation is given.

    Parameters
    ----------
    a, b : ndarray, shape (n, 3)
        Directions of the same n >= 2 trees from the first camera and from the
        second, each in its camera's frame: x and y across, 1 along the view.
    R : ndarray, shape (3, 3)
        Rotation: a tree at q from the first camera is at R q + t from the second.

    Returns
    -------
    ndarray, shape (3,)
        t of length 1 with the smallest sum of (t . (R a x b))^2; of t and -t the
        one with which more of the trees are ahead of the first camera.
    """
    turned = a @ R.T
    t = np.linalg.svd(np.cross(turned, b))[2][-1]
    depth = (np.cross(b, turned) * -np.cross(b, t)).sum(axis=1)
    return t if (depth > 0).mean() > 0.5 else -t


# %% active="ipynb" tags=["try"]
# q = np.array([[3.0, 1.0, 30.0], [-8.0, 4.0, 30.0]])
# direction_of_move(q / 30, (q + [2.0, 0.0, 0.0]) / 30, np.eye(3))

# %% [markdown] tags=["hint"]
# A direction in space has two numbers. How many equations does one tree give?

# %% [markdown] tags=["hint"]
# Three vectors are in one plane if the first is perpendicular to the cross product of the other
# two: $t \cdot (Ra \times b) = 0$, linear in $t$. A row for each tree; step 2 of the eight-point
# algorithm solves the same kind of equations.

# %% [markdown] tags=["hint"]
# Let $d$ be the depth of a tree: it is at $d\,a$ from the first camera, at $d\,Ra + t$ from the
# second, and that is along $b$. Take the cross product with $b$: $d\,(b \times Ra) = -b \times t$.
# For which sign of $t$ is $d$ positive?


# %% tags=["cases"]
def _rotation(rng: np.random.Generator, size: float) -> Array:
    x, y, z = size * rng.uniform(-1, 1, 3)
    c, s = np.cos(z), np.sin(z)
    R_pitch, R_roll = _matrices(x, y)
    R: Array = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ R_pitch @ R_roll
    return R


@drawn
def _two_pictures(
    rng: np.random.Generator,
    n: int,
    noise: float,
    size: float = 0.2,
    relief: float = 8.0,
    car: float = 0.0,
) -> Any:
    """Draw directions of n trees in two pictures, half a pixel being 1/1200, and the rotation."""
    depth = 30 - rng.uniform(0, relief, n)
    q = np.column_stack([rng.uniform(-15, 15, n), rng.uniform(-11, 11, n), depth])
    R, t = _rotation(rng, size), rng.uniform(1, 3, 3) * rng.choice([-1, 1], 3) * [1, 1, 0.3]
    moved = q @ R.T + t
    moved[0] -= car * t
    pictures = [p / p[:, 2:] for p in (q, moved)]
    for p in pictures:
        p[:, :2] = np.round(p[:, :2] + noise / 600 * rng.normal(size=(n, 2)), 6)
    return (*pictures, R)


def _direction_drawn(ax: Any, function: Any) -> None:
    """Draw heights of low trees from three pairs of pictures against the true ones."""
    from slamlab import plots

    found, off = [], []
    for seed in range(1, 21):
        rng = np.random.default_rng(seed)
        q = np.column_stack([rng.uniform(-15, 15, 40), rng.uniform(-11, 11, 40), np.full(40, 30)])
        q[:, 2] -= rng.uniform(0, 2, 40)
        R, t = _rotation(rng, 0.15), np.array([2.0, 0.5, 0.2])
        a, b = (p / p[:, 2:] for p in (q, q @ R.T + t))
        for p in (a, b):
            p[:, :2] += 0.5 / 600 * rng.normal(size=(40, 2))
        move = np.linalg.norm(t) * np.asarray(function(a, b, R), float)
        left, right = np.cross(b, a @ R.T), -np.cross(b, move)
        depth = (left * right).sum(1) / (left**2).sum(1)
        found.append((30 - q[:, 2], 30 - depth))
        off.append(abs(np.median(depth - q[:, 2])))
    ax.plot([0, 2], [0, 2], **plots.line_style("truth"))
    for (true, seen), mark in zip(found[:3], "o^s", strict=True):
        ax.plot(true, seen, mark, ms=4, color=plots.COLOURS["estimate"])
    ax.set(xlabel="height of a tree (m)", ylabel="from two pictures (m)", ylim=(-2, 4))
    ax.set_title(f"trees of a pair together\noff by {_m(np.median(off), 2)}")


check_direction_of_move = Check(
    direction_of_move,
    "t",
    {
        "two trees, a camera that does not turn": _two_pictures(2, 0.0, 0.0),
        "two trees, a camera that turns": _two_pictures(2, 0.0),
        "three trees, and a car that overtakes": _two_pictures(4, 0.0, car=6.0),
        "eight trees of flat ground": _two_pictures(8, 0.0, relief=0.0),
        "forty trees, half a pixel of noise": _two_pictures(40, 0.5),
        "forty trees of flat ground, half a pixel of noise": _two_pictures(40, 0.5, relief=0.0),
    },
    tolerance=1e-6,
    picture=_direction_drawn,
)

# %% tags=["mistakes"]
check_direction_of_move.mistakes = {
    "the sign of t is open in the equations: the trees must be ahead of the camera": (
        "t if (depth > 0).mean() > 0.5 else -t => t"
    ),
    "with this sign the trees are behind the camera": lambda a, b, R: -direction_of_move(a, b, R),
    "the rotation is not used: the camera turns, too": "a @ R.T => a",
    "this turns by the inverse of R": "a @ R.T => a @ R",
    "R turns the directions of the first picture, not those of the second": (
        "np.cross(turned, b) => np.cross(a, b @ R.T)",
        "np.cross(b, turned) * -np.cross(b, t) => np.cross(b @ R.T, a) * -np.cross(b @ R.T, t)",
    ),
    "this is the move of the camera, in its first frame: expected t of q' = R q + t": (
        "return t if (depth > 0).mean() > 0.5 else -t"
        " => return -R.T @ (t if (depth > 0).mean() > 0.5 else -t)"
    ),
    "the smallest sum of squares has the last singular vector, not the first": "[2][-1] => [2][0]",
    "two trees are two rows, and a thin SVD cuts off what both leave open: full_matrices=True": (
        "np.linalg.svd(np.cross(turned, b))"
        " => np.linalg.svd(np.cross(turned, b), full_matrices=False)"
    ),
    "two trees leave a direction open, and a thin SVD cuts it off: full_matrices=True": (
        "np.linalg.svd(np.cross(turned, b))"
        " => np.linalg.svd(np.cross(b, turned), full_matrices=False)"
    ),
    "all trees count, not the first two alone": lambda a, b, R: direction_of_move(a[:2], b[:2], R),
    "length 1 is expected": "return t if => t = 2 * t\n    return t if",
}
# %% [markdown] tags=["solution"]
# ## Solution 2: with a gyro, how many trees are enough?
#
# Two: a direction has two numbers, and each tree gives one equation. Flat ground does no harm any
# more. It left open *which* rotation and move belong together; here the rotation is given.

# %% [markdown] tags=["solution"]
# How good must the gyro be? Two hundred pairs of pictures of forty trees on flat ground, metres of
# the move given, and a rotation that is off about an axis drawn by lot:

# %% active="ipynb" tags=["solution"]
# def depth_off(rng, degrees):
#     across = rng.uniform([-15, -11], [15, 11], (40, 2))
#     q = np.column_stack([across, np.full(40, 30.0)])
#     a, b = q / 30, (q + [2.0, 0.5, 0.2]) / 30.2
#     for p in (a, b):
#         p[:, :2] += 0.5 / 600 * rng.standard_normal((40, 2))
#     axis = rng.standard_normal(3)
#     x, y, z = np.radians(degrees) * axis / np.linalg.norm(axis)
#     R = np.eye(3) + [[0, -z, y], [z, 0, -x], [-y, x, 0]]
#     t = np.linalg.norm([2.0, 0.5, 0.2]) * direction_of_move(a, b, R)
#     left, right = np.cross(b, a @ R.T), -np.cross(b, t)
#     depth = (left * right).sum(1) / (left**2).sum(1)
#     return np.abs(np.median(depth) - 30)
#
# for degrees in (0.0, 0.1, 0.3, 1.0):
#     off = [depth_off(np.random.default_rng(seed), degrees) for seed in range(200)]
#     print(f"gyro off by {degrees} degrees: "
#           f"depth of all trees off by {np.median(off):.1f} m")

# %% [markdown] tags=["statement"]
# ## Exercise 3: a range that remembers
#
# The aircraft of [16b](../16b_uav_local_range.ipynb) adapts the range of its sensor, so that about
# $n^*$ trees are seen. Its law takes one observation: $n$ trees were seen within $r$, so next
# $r\sqrt{n^*/n}$. But trees are not spaced evenly. Over one and the same wood, with five wanted,
# three are seen here and eight there by chance, and the range jumps. And where none is seen the
# law divides by zero.
#
# Let the law remember. Take several observations, each with a range of its own, as *one* with many
# trees on a large area: the density is all trees divided by all areas. An observation $k$ steps
# old counts $\lambda^k$ times as much as the newest, in both sums. With $\lambda = 0$ it is the
# law of 16b ($0^0 = 1$, in NumPy too); with $\lambda = 1$ all count the same. **Write down**: at
# the edge of a clearing, which $\lambda$ is better, a small one or a large one?


# %% tags=["exercise"]
def next_range(
    ranges: Array, n_seen: Ints, memory: float, wanted: float, nearest: float, furthest: float
) -> float:
    """Range of the next observation.

    Parameters
    ----------
    ranges : ndarray, shape (k,)
        Ranges of the last k >= 1 observations (m), the newest last.
    n_seen : ndarray of int, shape (k,)
        Trees that each saw within its range; may be 0.
    memory : float
        Weight lambda of an observation as against the one after it, in [0, 1].
    wanted : float
        Trees to see.
    nearest, furthest : float
        The range stays between them (m).

    Returns
    -------
    float
        Range (m); `furthest` if the trees with their weights sum to 0.
    """
    weights = memory ** np.arange(len(ranges))[::-1]
    trees, squares = weights @ n_seen, weights @ ranges**2
    if trees == 0:
        return furthest
    return float(np.clip(np.sqrt(wanted * squares / trees), nearest, furthest))


# %% active="ipynb" tags=["try"]
# next_range(np.array([20.0, 10.0]), np.array([20, 0]), 0.5, 5.0, 5.0, 40.0)

# %% [markdown] tags=["hint"]
# With a pencil: 20 trees within 20 m, then none within 10 m, $\lambda = 1/2$. That counts as 10
# trees on an area of $\pi\,(\tfrac12 \cdot 400 + 100)$.

# %% [markdown] tags=["hint"]
# Which circle of that density has $n^*$ trees? $\pi$ drops out, the square does not.

# %% [markdown] tags=["hint"]
# The weights belong to ages $k-1, \dots, 1, 0$: `np.arange` counts the other way.


# %% tags=["cases"]
def _woods(seed: int, steps: int = 60) -> tuple[Array, Array]:
    """Density of trees along a lane with a clearing, and one number of chance a step."""
    k = np.arange(steps)
    return np.where((k >= 25) & (k < 45), 0.004, 0.02), np.random.default_rng(seed).random(steps)


def _seen(chance: float, expected: float) -> int:
    """Trees seen where this many are expected: Poisson, by its inverse."""
    n, p = 0, np.exp(-expected)
    total = p
    while total < chance and n < 200:
        n += 1
        p *= expected / n
        total += p
    return n


def _next_range_drawn(ax: Any, function: Any) -> None:
    """Draw the range along a lane over a wood, a clearing and a wood, and the best one."""
    from slamlab import plots

    density, chance = _woods(3)
    ranges, seen = [9.0], []
    for rho, one in zip(density, chance, strict=True):
        seen.append(_seen(float(one), rho * np.pi * ranges[-1] ** 2))
        last = np.array(ranges[-10:]), np.array(seen[-10:])
        ranges.append(float(function(*last, 0.7, 5.0, 4.0, 40.0)))
    best = np.sqrt(5.0 / (np.pi * density))
    ax.step(range(60), best, where="post", **plots.line_style("truth"))
    ax.plot(ranges[1:], ".-", color=plots.COLOURS["estimate"])
    ax.set(xlabel="step", ylabel="range (m)", ylim=(0, 42))
    ax.set_title(f"in the first wood +- {np.std(ranges[6:26]):.1f} m")


check_next_range = Check(
    next_range,
    "range",
    {
        "one observation, as many as wanted": ([20.0], [10], 0.5, 10.0, 3.0, 30.0),
        "one observation, four times too many": ([20.0], [20], 0.9, 5.0, 5.0, 40.0),
        "no memory: the newest alone counts": (
            [12.0, 30.0, 20.0],
            [9, 2, 20],
            0.0,
            5.0,
            5.0,
            40.0,
        ),
        "all count the same": ([10.0, 20.0, 30.0], [3, 8, 29], 1.0, 6.0, 4.0, 50.0),
        "one tree in all": ([10.0], [1], 0.5, 2.0, 5.0, 40.0),
        "none in the newest": ([20.0, 10.0], [20, 0], 0.5, 5.0, 5.0, 40.0),
        "none in the newest, no memory": ([20.0, 10.0], [20, 0], 0.0, 5.0, 5.0, 40.0),
        "none in any": ([12.0, 15.0], [0, 0], 0.7, 5.0, 5.0, 36.0),
        "never nearer": ([12.0, 10.0], [200, 150], 0.5, 2.0, 5.0, 40.0),
        "never further": ([30.0, 38.0], [1, 1], 0.8, 10.0, 5.0, 40.0),
        "another drone, which flies lower: never nearer": ([6.0], [300], 0.3, 2.0, 1.5, 20.0),
        "another drone: never further": ([15.0, 15.0], [1, 0], 0.3, 10.0, 1.5, 20.0),
        "any numbers": lambda rng: (
            np.round(rng.uniform(8, 30, 5), 1),
            rng.integers(0, 30, 5) + [1, 0, 0, 2, 0],
            np.round(rng.uniform(0.2, 0.95), 2),
            np.round(rng.uniform(4, 12), 1),
            2.0,
            90.0,
        ),
    },
    picture=_next_range_drawn,
)


# %% tags=["mistakes"]
def _mean_of(density: bool) -> Any:
    """Average what each observation says by itself, be it a density or a range."""

    def wrong(r, n, m, w, a, b):
        weights = m ** np.arange(len(r))[::-1]
        with np.errstate(all="ignore"):
            each = n / r**2 if density else np.clip(r * np.sqrt(w / n), a, b)
            mean = weights @ each / weights.sum()
            return float(np.clip(np.sqrt(w / mean), a, b)) if density else float(mean)

    return wrong


check_next_range.mistakes = {
    "trees grow with the area, not with the range: a square root is missing": (
        "np.sqrt(wanted * squares / trees) => wanted * squares / trees"
    ),
    "these are weights of ages 0, 1, ... from the oldest on: the newest is the last": (
        "np.arange(len(ranges))[::-1] => np.arange(len(ranges))"
    ),
    "if too many are seen, the range must fall: the ratio is upside down": (
        "wanted * squares / trees => squares * trees / wanted"
    ),
    "each density by itself was averaged: an observation of a large area says more": (
        _mean_of(True)
    ),
    "each observation gave a range, and the ranges were averaged: trees and areas are summed": (
        _mean_of(False)
    ),
    "the areas need the weights as well": "weights @ ranges**2 => (ranges**2).sum()",
    "the trees need the weights as well": "weights @ n_seen => n_seen.sum()",
    "areas are summed, not ranges": "weights @ ranges**2 => (weights @ ranges) ** 2",
    "only the newest observation counts here": lambda r, n, m, w, a, b: next_range(
        r[-1:], n[-1:], m, w, a, b
    ),
    "all observations count the same here: memory is not used": lambda r, n, m, w, a, b: (
        next_range(r, n, 1.0, w, a, b)
    ),
    "where none is seen the furthest range is expected": "return furthest => return nearest",
    "with nothing seen the range must grow": "return furthest => return float(ranges[-1])",
    "the range must stay between nearest and furthest": "nearest, furthest) => 0.0, np.inf)",
    "none in the newest is not none in all: what is remembered counts": (
        "if trees == 0: => if n_seen[-1] == 0:"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a range that remembers
#
# The pencil: 10 trees on $300\pi$ square metres; a circle with five has half the area, $r =
# \sqrt{150} = 12.2$ m. $\pi$ drops out.

# %% [markdown] tags=["solution"]
# What does memory buy, and what does it cost? Two hundred flights along a lane, wood, clearing and
# wood, five trees wanted: by how many trees $n$ misses the five, in the first wood and in the
# first three steps of the clearing.

# %% active="ipynb" tags=["solution"]
# def lane(rng, memory):
#     ranges, seen = [9.0], []
#     for k in range(60):
#         density = 0.004 if 25 <= k < 45 else 0.02
#         seen.append(rng.poisson(density * np.pi * ranges[-1] ** 2))
#         last = np.array(ranges[-10:]), np.array(seen[-10:])
#         ranges.append(next_range(*last, memory, 5.0, 4.0, 40.0))
#     off = np.abs(np.array(seen) - 5)
#     return off[6:25].mean(), *off[25:28], 100 * (ranges[26] == 40.0)
#
# print("mean |n - 5|   wood | clearing, step 1    2    3 | at 40 m in step 2")
# for memory in (0.0, 0.5, 0.7, 0.9):
#     lanes = [lane(np.random.default_rng(seed), memory) for seed in range(200)]
#     wood, one, two, three, stop = np.mean(lanes, axis=0)
#     print(f"memory {memory}     {wood:4.1f} | {one:16.1f} {two:4.1f} {three:4.1f} | "
#           f"{stop:.0f} % of the flights")

# %% [markdown] tags=["solution"]
# The first step of the clearing is much the same for all: the range is still the wood's. Then the
# law without memory overshoots: where that step saw no tree, it goes to the 40 m stop and sees far
# too many. Half a memory misses by half as much there, is as good a step later, and misses by half
# as much in the wood. A long memory gains little more in the wood, and is late at the edge: it
# must forget the wood first.

# %% [markdown] tags=["statement"]
# ## Exercise 4: two bugs, one in the region, one outside
#
# From here on the aircraft has no camera. Its trees bear tags, and its radio measures the distance
# to each that it hears: $\rho = \sqrt{d_x^2 + d_y^2 + h^2}$, where $d$ is the tree less the
# aircraft in the plane, and $h$ the known height of the flight. An old map has all the trees, so
# there are no new ones. This is the update of a region with its records $\Phi$, $\Psi$,
# $\vartheta$ of [the lesson](../16_uav_local_range.ipynb), for all ranges of a step at once.
#
# It was tested with a robot on the ground, on the first update after entering: all numbers were
# right. In the air, the trees of its region end some metres off, where one metre is expected. And
# when it leaves the region, the trees *outside* are thrown over a hundred metres away. There are
# two bugs.


# %% tags=["exercise"]
def range_update(
    x: Array,
    P: Array,
    Phi: Array,
    Psi: Array,
    theta: Array,
    ranges: Array,
    height: float,
    variance: float,
) -> tuple[Array, Array, Array, Array, Array]:
    """Update a region and its records by the ranges to its trees.

    Parameters
    ----------
    x : ndarray, shape (3 + 2 m,)
        Pose (m, m, rad) and m trees of the region (m).
    P : ndarray, shape (3 + 2 m, 3 + 2 m)
    Phi, Psi : ndarray, shape (3 + 2 m, 3 + 2 m)
        Records of the region before the update.
    theta : ndarray, shape (3 + 2 m,)
    ranges : ndarray, shape (m,)
        Measured distance to each of these trees (m); NaN where a tree is not heard.
    height : float
        Of the aircraft above the trees' tags (m); 0 on the ground.
    variance : float
        Of a measured range (m^2).

    Returns
    -------
    x, P, Phi, Psi, theta : tuple of ndarray
        The region and its records after it; the heading in (-pi, pi].
    """
    heard = np.flatnonzero(np.isfinite(ranges))
    d = x[3:].reshape(-1, 2)[heard] - x[:2]
    expected = np.sqrt((d**2).sum(axis=1) + height**2)
    slope = d / expected[:, None]
    H = np.zeros((len(heard), len(x)))
    for k, j in enumerate(heard):
        H[k, :2], H[k, 3 + 2 * j : 5 + 2 * j] = -slope[k], slope[k]
    v = ranges[heard] - expected
    W = np.linalg.inv(H @ P @ H.T + variance * np.eye(len(heard)))
    K = P @ H.T @ W
    seen = H @ Phi
    Psi = Psi + seen.T @ W @ seen
    theta = theta + seen.T @ W @ v
    Phi = Phi - K @ H @ Phi
    x = x + K @ v
    x[2] = wrap_angle(x[2])
    return x, P - K @ H @ P, Phi, Psi, theta


# %% active="ipynb" tags=["stub"]
#     heard = np.flatnonzero(np.isfinite(ranges))
#     d = x[3:].reshape(-1, 2)[heard] - x[:2]
#     expected = np.sqrt((d**2).sum(axis=1) + height**2)
#     slope = d / np.hypot(*d.T)[:, None]
#     H = np.zeros((len(heard), len(x)))
#     for k, j in enumerate(heard):
#         H[k, :2], H[k, 3 + 2 * j : 5 + 2 * j] = -slope[k], slope[k]
#     v = ranges[heard] - expected
#     W = np.linalg.inv(H @ P @ H.T + variance * np.eye(len(heard)))
#     K = P @ H.T @ W
#     Psi = Psi + H.T @ W @ H
#     theta = theta + H.T @ W @ v
#     Phi = Phi - K @ H @ Phi
#     x = x + K @ v
#     x[2] = wrap_angle(x[2])
#     return x, P - K @ H @ P, Phi, Psi, theta

# %% active="ipynb" tags=["try"]
# x, I = np.array([0.0, 0.0, 0.0, 3.0, 4.0]), np.eye(5)
# range_update(x, I, I, 0 * I, np.zeros(5), np.array([5.5]), 0.0, 0.09)[0]

# %% [markdown] tags=["hint"]
# The first: what is different in the air? Fly straight above a tree. When the aircraft moves a
# metre aside, by how much does the range change? And what does `H` say?

# %% [markdown] tags=["hint"]
# Which of the lines know the height? Differentiate $\sqrt{d_x^2 + d_y^2 + h^2}$ with respect to
# $d_x$ and compare.

# %% [markdown] tags=["hint"]
# The second: it does not show in the first update. What do `Phi`, `Psi` and `theta` hold just
# after entering, and which of them makes a difference later?

# %% [markdown] tags=["hint"]
# What is outside was correlated with the region as it was *at the entry*. An innovation is about
# the region *now*. What leads from one to the other?


# %% tags=["cases"]
@drawn
def _heard(
    rng: np.random.Generator, m: int, height: float, first: bool = False, share: float = 0.7
) -> Any:
    """Draw a region of m trees in an update, some of them heard."""
    pose = np.array([*np.round(rng.uniform(-3, 3, 2), 2), an_angle(rng)])
    angle = 2 * np.pi * rng.random(m)
    flat = rng.uniform(4, 15, m)
    trees = pose[:2] + flat[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    x, n = np.append(pose, np.round(trees, 2).ravel()), 3 + 2 * m
    ranges = np.round(np.sqrt(flat**2 + height**2) + rng.normal(0, 0.4, m), 2)
    ranges[rng.random(m) >= share] = np.nan
    ranges[int(rng.integers(m))] = np.round(np.hypot(10.0, height), 2)
    Phi, Psi, theta = np.eye(n), np.zeros((n, n)), np.zeros(n)
    if not first:
        Phi, theta = np.round(rng.normal(size=(n, n)), 2), np.round(rng.normal(size=n), 2)
        Psi = a_covariance(rng, n)
    return x, a_covariance(rng, n), Phi, Psi, theta, ranges, height, 0.04 * int(rng.integers(1, 9))


def _past_a_turn(heading: float, off: float) -> Any:
    """Return an update that corrects the heading past half a turn."""
    P = np.diag([0.5, 0.5, 0.5, 0.1, 0.1])
    P[0, 2] = P[2, 0] = 0.45
    I, zero = np.eye(5), np.zeros((5, 5))
    x = [0.0, 0.0, heading, 10.0, 0.0]
    return x, P, I, zero, np.zeros(5), [np.hypot(10.0, 2.0) + off], 2.0, 0.04


@cache
def survey(
    seed: int, side: float, offset: float, own: float, silent: int = 0
) -> tuple[tuple[Any, ...], Array, Array]:
    """Make a flight with a radio and an old map: what `fly` is given but radius and stay, truth.

    All trees of the old map share an error of `offset` metres, and each has one of `own`.
    """
    from slamlab.simulation import field_flights

    rng = np.random.default_rng(seed)
    log = field_flights(1, rng, side=side).single(0)
    assert log.landmarks is not None
    assert log.truth is not None
    dt, trees, n, height = 0.4, np.asarray(log.landmarks), len(log.landmarks), 30.0
    turns = wrap_angle(np.diff(log.truth[:, 2]))
    truth = [np.asarray(log.truth[0])]
    for turn in turns:
        c, s = np.cos(truth[-1][2]), np.sin(truth[-1][2])
        truth.append(truth[-1] + [5 * dt * c, 5 * dt * s, turn])
    way, noise = np.array(truth), np.array([0.5, 0.03])
    u = np.column_stack([np.full(len(turns), 5.0), turns / dt])
    u = u + noise * rng.standard_normal(u.shape)
    flat = np.linalg.norm(trees - way[1:, None, :2], axis=-1)
    ranges = np.sqrt(flat**2 + height**2) + 0.3 * rng.standard_normal(flat.shape)
    ranges[(flat > 20.0) | (np.arange(len(flat)) < silent)[:, None]] = np.nan
    old = trees + offset * rng.standard_normal(2) + own * rng.standard_normal((n, 2))
    P = np.zeros((3 + 2 * n, 3 + 2 * n))
    P[3:, 3:] = np.kron(np.ones((n, n)), offset**2 * np.eye(2)) + own**2 * np.eye(2 * n)
    x = np.append(way[0], old.ravel())
    return (x, P, u, np.diag(noise**2), dt, ranges, height, 0.09), way, trees


def _predict(region: tuple[Array, ...], u: Array, V: Array, dt: float) -> tuple[Array, ...]:
    """Predict a region, as `fly` does."""
    x, P, Phi, Psi, theta = region
    c, s = dt * np.cos(x[2]), dt * np.sin(x[2])
    F, G = np.eye(len(x)), np.zeros((len(x), 2))
    F[:2, 2] = -u[0] * s, u[0] * c
    G[:3] = [[c, 0.0], [s, 0.0], [0.0, dt]]
    x = x + G @ u
    x[2] = wrap_angle(x[2])
    return x, F @ P @ F.T + G @ V @ G.T, F @ Phi, Psi, theta


def metres_off(x: Array, trees: Array) -> Array:
    """Distances of a map's trees from the true ones."""
    off: Array = np.hypot(*(np.asarray(x, float)[3:].reshape(-1, 2) - trees).T)
    return off


def _range_update_drawn(ax: Any, function: Any) -> None:
    """Draw a flight within one region: the map after it is left, the old map and the truth."""
    from slamlab import plots

    given, truth, trees = survey(2, 90.0, 3.0, 0.5)
    (x, P, u, V, dt, ranges, height, variance), steps = given, 12
    near, entries, region = enter(x, P, 42.0)
    path = [truth[0, :2]]
    for k in range(steps):
        region = function(*_predict(region, u[k], V, dt), ranges[k, near], height, variance)
        region = tuple(np.asarray(one, float) for one in region)
        path.append(region[0][:2])
    found, *_ = leave(x, P, entries, *region)
    plots.landmarks(ax, trees)
    ax.plot(*x[3:].reshape(-1, 2).T, ".", ms=4, color="0.6")
    plots.landmarks(ax, found[3:].reshape(-1, 2), estimated=True)
    ax.plot(
        *(truth[0, :2] + 42 * np.column_stack([np.cos(t := np.linspace(0, 7, 99)), np.sin(t)])).T,
        color="0.5",
        lw=0.8,
    )
    plots.path(ax, truth[: steps + 1], "truth")
    plots.path(ax, np.array(path))
    ax.set_aspect("equal")
    ax.set(xlim=(-5, 95), ylim=(-5, 95), xlabel="x (m)", ylabel="y (m)")
    inside = np.isin(np.arange(len(trees)), near)
    off = metres_off(found, trees)
    ax.set_title(f"region: {_m(off[inside].mean())} off\noutside: {_m(off[~inside].mean())} off")


check_range_update = Check(
    range_update,
    "x, P, Phi, Psi, theta",
    {
        "on the ground, the first update": _heard(2, 0.0, True),
        "in the air, the first update": _heard(3, 12.0, True),
        "on the ground, after other updates": _heard(2, 0.0),
        "in the air, after other updates": _heard(3, 20.0),
        "a large region, few are heard": _heard(6, 30.0, share=0.3),
        "nothing is heard": (
            [1.0, -2.0, 0.5, 9.0, 3.0],
            np.diag([1.0, 2.0, 0.1, 1.0, 1.0]),
            0.5 * np.eye(5),
            np.eye(5),
            [0.1, -0.2, 0.3, 0.4, 0.5],
            [np.nan],
            15.0,
            0.09,
        ),
        "a heading that is corrected past half a turn": _past_a_turn(3.1, -0.5),
        "a heading that is corrected past half a turn to the right": _past_a_turn(-3.1, 0.5),
    },
    tolerance=1e-7,
    draws=4,
    picture=_range_update_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_range_update.mistakes = {
    "the height is missing in the derivative: d / rho is expected, rho with the height": (
        "slope = d / expected[:, None] => slope = d / np.hypot(*d.T)[:, None]"
    ),
    "the height is missing: a range is measured from the air": (
        "np.sqrt((d**2).sum(axis=1) + height**2) => np.sqrt((d**2).sum(axis=1))"
    ),
    "the records are about the region at its entry: H must be multiplied by Phi": (
        "seen = H @ Phi => seen = H"
    ),
    "Psi and theta need the Phi from before the update": (
        "seen = H @ Phi => seen = H @ Phi - H @ K @ H @ Phi"
    ),
    "the correction goes the wrong way: the sign of the innovation, or of both derivatives": (
        "v = ranges[heard] - expected => v = expected - ranges[heard]"
    ),
    "a row of H belongs to tree j of the region, not to the k-th that is heard": (
        "3 + 2 * j : 5 + 2 * j => 3 + 2 * k : 5 + 2 * k"
    ),
    "the variance of the range is missing": "+ variance * np.eye => + 1e-9 * np.eye",
    "the variance was squared": "variance * np.eye => variance**2 * np.eye",
    "theta is a sum: what was in it before is gone": "theta = theta + seen => theta = seen",
    "Psi is a sum: what was in it before is gone": "Psi = Psi + seen => Psi = seen",
    "Psi grows: what is observed adds information": "Psi = Psi + seen => Psi = Psi - seen",
    "an update changes Phi as well": "Phi = Phi - K @ H @ Phi => Phi = Phi.copy()",
    "the heading is not wrapped": "x[2] = wrap_angle(x[2]) => x[2] = x[2]",
    "the covariance did not shrink": "return x, P - K @ H @ P => return x, P.copy()",
}

# %% [markdown] tags=["solution"]
# ## Solution 4: two bugs, one in the region, one outside
#
# The derivative of $\rho$ with respect to $d_x$ is $d_x/\rho$, *with* the height in $\rho$.
# Straight above a tree it is zero: a metre aside changes nothing. Without the height `H` says one
# metre for each metre, so the filter takes a weak measurement for a strong one. On the ground both
# are the same.
#
# And the records take $H\Phi$, not $H$: an innovation is about the region now, $\Phi$ leads to it
# from the entry. In the first update $\Phi = I$, so nothing shows.

# %% [markdown] tags=["statement"]
# ## Exercise 5: leaving the region, and a photograph
#
# On entering a region the aircraft took a photograph. Since then it has flown on, and heard many
# trees; now it leaves the region. Two things are wanted: the whole map as it is now, and *where
# the camera was when the photograph was taken*, with all that has been heard since.
#
# The lesson brings $b$, the trees outside, up to date from their correlation with $a_0$, the
# region at the entry, where a 0 says *at the entry*:
#
# $$
# \hat x_b = \hat x_b^0 + P_{ba}^0\,\vartheta, \qquad
# P_{bb} = P_{bb}^0 - P_{ba}^0\,\Psi\,P_{ab}^0, \qquad
# P_{ab} = \Phi\,P_{ab}^0 .
# $$
#
# All that this needs of $b$ is that it has not moved since. **With a pencil**: one number is
# entered with variance 1, moves with noise of variance 1, and is measured with variance 0.1. So
# $\Phi = 1$ before the measurement, and $\Psi = 1/2.1$. What is now the variance of where it
# *was*? Then write `leave`, for a map without new trees. It is shorter than the lesson's.
#
# In the picture orange is the photograph's place as known at once, the blue dot the same on
# leaving, the square the aircraft now; hollow is the truth, and ellipses hold 95 %.


# %% tags=["exercise"]
def leave(
    x: Array,
    P: Array,
    entries: Ints,
    x_a: Array,
    P_a: Array,
    Phi: Array,
    Psi: Array,
    theta: Array,
) -> tuple[Array, Array, Array, Array]:
    """Return from a region to the whole map.

    Parameters
    ----------
    x : ndarray, shape (N,)
        Pose and all trees as they were estimated at the entry.
    P : ndarray, shape (N, N)
        Their covariance at the entry.
    entries : ndarray of int, shape (n,)
        Entries of x that the region has, in its order; those of the pose, 0, 1 and 2,
        come first.
    x_a, P_a : ndarray, shapes (n,) and (n, n)
        The region now; its heading is in (-pi, pi].
    Phi, Psi, theta : ndarray, shapes (n, n), (n, n) and (n,)
        Its records.

    Returns
    -------
    x, P : ndarray, shapes (N,) and (N, N)
        Pose and all trees as they are now.
    photo : ndarray, shape (3,)
        Pose at the entry, by all that was heard since; its heading in (-pi, pi].
    photo_cov : ndarray, shape (3, 3)
    """
    P_a0 = P[entries]
    x, P = x + theta @ P_a0, P - P_a0.T @ Psi @ P_a0
    photo, photo_cov = x[:3].copy(), P[:3, :3].copy()
    photo[2] = wrap_angle(photo[2])
    P[entries] = Phi @ P_a0
    P[:, entries] = P[entries].T
    x[entries], P[np.ix_(entries, entries)] = x_a, P_a
    return x, P, photo, photo_cov


# %% active="ipynb" tags=["try"]
# one, zero = np.diag([1.0, 0.0, 0.0]), np.zeros(3)
# leave(zero, one, np.arange(3), zero, one / 10.5, one / 21, one / 2.1, zero)

# %% [markdown] tags=["hint"]
# Where the camera was at the entry is a number that does not move any more. Is it more like $a$,
# or like $b$?

# %% [markdown] tags=["hint"]
# So the formulas of $b$ hold for *all* rows of the state at the entry, those of the region too:
# with `P_a0 = P[entries]`, the rows of $a_0$ with all columns, the state becomes
# $x + \vartheta^\top P_{a_0}$ and the covariance
# $P - P_{a_0}^\top \Psi P_{a_0}$. The photograph is then three of these rows.

# %% [markdown] tags=["hint"]
# After that the region moves on from its entry to now: its rows and columns are replaced. Those
# towards $b$ need $\Phi$ and the covariance *at the entry*, so keep it.


# %% tags=["cases"]
@drawn
def _a_region(rng: np.random.Generator, n_trees: int, chosen: Any, heading: float = 0.0) -> Any:
    """Draw a map of trees and a region with some of them."""
    N = 3 + 2 * n_trees
    rows = [3 + 2 * j + k for j in chosen for k in (0, 1)]
    entries = np.array([0, 1, 2, *rows])
    n = len(entries)
    x, theta = np.round(3 * rng.normal(size=N), 2), np.round(0.5 * rng.normal(size=n), 2)
    P, P_a = a_covariance(rng, N), a_covariance(rng, n, 0.3)
    x[2], x_a = heading or an_angle(rng), np.round(3 * rng.normal(size=n), 2)
    if heading:
        theta = np.sign(heading) * np.eye(n)[2] / P[2, 2]
    x_a[2] = np.round(rng.uniform(-3, 3), 2)
    Phi = np.round(rng.normal(size=(n, n)), 2)
    return x, P, entries, x_a, P_a, Phi, a_covariance(rng, n, 0.2), theta


def after_silence(seed: int) -> Any:
    """A flight without radio, a photograph, a flight with radio: what `leave` is given, truth."""
    given, truth, trees = survey(seed, 90.0, 0.5, 0.5, 40)
    x, P, u, V, dt, ranges, height, variance = given
    near, entries, region = enter(x, P, np.inf)
    for k in range(40):
        region = _predict(region, u[k], V, dt)
    x, P, *_ = leave(x, P, entries, *region)
    near, entries, region = enter(x, P, 32.0)
    for k in range(40, 46):
        region = _predict(region, u[k], V, dt)
        region = range_update(*region, ranges[k, near], height, variance)
    return (x, P, entries, *region), truth[40], truth[46], trees


def _leave_drawn(ax: Any, function: Any) -> None:
    """Draw where a photograph was taken: as believed at once, and on leaving the region."""
    from slamlab import plots

    given, then, now, trees = after_silence(10)
    x, P, photo, cov = (np.asarray(one, float) for one in function(*given))
    plots.landmarks(ax, trees)
    plots.landmarks(ax, x[3:].reshape(-1, 2), estimated=True)
    ax.plot(*then[:2], "o", ms=11, mfc="none", color=plots.COLOURS["truth"])
    ax.plot(*now[:2], "s", ms=11, mfc="none", color=plots.COLOURS["truth"])
    ax.plot(*given[0][:2], "o", ms=5, color=plots.COLOURS["dead_reckoning"])
    plots.ellipse(ax, given[0][:2], given[1][:2, :2], "dead_reckoning")
    for at, spread, mark in ((photo, cov, "o"), (x, P, "s")):
        ax.plot(*at[:2], mark, ms=5, color=plots.COLOURS["estimate"])
        plots.ellipse(ax, at[:2], spread[:2, :2])
    ax.set_aspect("equal")
    c = then[:2]
    ax.set(
        xlim=(c[0] - 18, c[0] + 18), ylim=(c[1] - 12, c[1] + 18), xlabel="x (m)", ylabel="y (m)"
    )
    off = [np.hypot(*(at[:2] - then[:2])) for at in (given[0], photo)]
    ax.set_title(f"photo off {off[0]:.1f} m, then {_m(off[1])}")


check_leave = Check(
    leave,
    "x, P, photo, photo_cov",
    {
        "one number of the pencil": (
            np.zeros(3),
            np.diag([1.0, 0.0, 0.0]),
            [0, 1, 2],
            np.zeros(3),
            np.diag([1 / 10.5, 0.0, 0.0]),
            np.diag([1 / 21, 0.0, 0.0]),
            np.diag([1 / 2.1, 0.0, 0.0]),
            np.zeros(3),
        ),
        "a region without a tree": _a_region(2, []),
        "one tree of three in the region": _a_region(3, [1]),
        "trees in another order": _a_region(4, [3, 0]),
        "the whole map is in the region": _a_region(2, [0, 1]),
        "a photograph whose heading passes half a turn": _a_region(2, [0], 2.6),
        "a photograph whose heading passes half a turn to the right": _a_region(2, [1], -2.6),
    },
    draws=4,
    picture=_leave_drawn,
)

# %% tags=["mistakes"]
check_leave.mistakes = {
    "the photograph was taken at the entry: this is the pose now": (
        "photo, photo_cov = x[:3].copy(), P[:3, :3].copy()"
        " => photo, photo_cov = x_a[:3].copy(), P_a[:3, :3].copy()"
    ),
    "this is the photograph as it was believed at the entry: what was heard since counts": (
        lambda x, P, *a: (*leave(x, P, *a)[:2], x[:3].copy(), P[:3, :3].copy())
    ),
    "Phi is missing: P_ab is Phi times its value at the entry": (
        "P[entries] = Phi @ P_a0 => P[entries] = P_a0"
    ),
    "Phi is transposed here": "Phi @ P_a0 => Phi.T @ P_a0",
    "P_ab needs the covariance at the entry: here it was corrected by Psi before": (
        "P[entries] = Phi @ P_a0 => P[entries] = Phi @ P[entries]"
    ),
    "only the rows of the region were replaced: its columns are the transposes": (
        "P[:, entries] = P[entries].T => P = P.copy()"
    ),
    "Psi is not used: what was heard makes the map more certain": (
        "P - P_a0.T @ Psi @ P_a0 => P.copy()"
    ),
    "theta is not used: what was heard moves the map": "x + theta @ P_a0 => x.copy()",
    "Psi has the wrong sign: the covariance must shrink": (
        "P - P_a0.T @ Psi @ P_a0 => P + P_a0.T @ Psi @ P_a0"
    ),
    "theta has the wrong sign": "x + theta @ P_a0 => x - theta @ P_a0",
    "the region itself was not copied back": (
        "x[entries], P[np.ix_(entries, entries)] = x_a, P_a => x[2] = wrap_angle(x[2])"
    ),
    "the state of the region was copied back, its covariance was not": (
        "x[entries], P[np.ix_(entries, entries)] = x_a, P_a => x[entries] = x_a"
    ),
    "the heading of the photograph is not wrapped": (
        "photo[2] = wrap_angle(photo[2]) => photo[2] = photo[2]"
    ),
    "the trees of the region were corrected twice: x_a has all of that": (
        "x[entries], P[np.ix_(entries, entries)] = x_a, P_a"
        " => x[entries], P[np.ix_(entries, entries)] = x_a + theta @ P_a0[:, entries], P_a"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: leaving the region, and a photograph
#
# By hand: $1 - 1 \cdot \tfrac{1}{2.1} \cdot 1 = 0.52$. The pose at the entry does not move any
# more, so it is a part of $b$. The lesson sets the columns of $a$ to zero before it corrects; here
# they stay, and the first line gives *all* of the state at the entry with what is known now. This
# is called fixed-point smoothing. Only then does the region go from the entry to now, with $\Phi$.

# %% [markdown] tags=["solution"]
# What does it buy? Twice twenty flights as in the picture: 16 s without radio, a photograph, six
# steps with radio. How far off is the photograph at once, and with what is heard after it?

# %% active="ipynb" tags=["solution"]
# from slamlab.exercises.ch16_uav_local_range import after_silence
#
# def off_by(seed):
#     given, then, *_ = after_silence(seed)
#     poses = given[0], leave(*given)[2]
#     return [np.hypot(*(pose[:2] - then[:2])) for pose in poses]
#
# for flights in (range(20), range(20, 40)):
#     off = np.array([off_by(seed) for seed in flights])
#     at_once, later = off.mean(axis=0)
#     print(f"photograph off by {at_once:.1f} m at once, {later:.1f} m on leaving; "
#           f"closer in {(off[:, 1] < off[:, 0]).sum()} of {len(off)} flights")

# %% [markdown] tags=["solution"]
# Exercise 6 hands out how a region is entered:

# %% active="ipynb" tags=["solution"]
# def enter(x, P, radius):
#     trees = x[3:].reshape(-1, 2)
#     near = np.flatnonzero(np.hypot(*(trees - x[:2]).T) < radius)
#     entries = np.r_[:3, (3 + 2 * near[:, None] + [0, 1]).ravel()]
#     n = len(entries)
#     P_a, zero = P[np.ix_(entries, entries)], np.zeros((n, n))
#     return near, entries, (x[entries], P_a, np.eye(n), zero, np.zeros(n))

# %% [markdown] tags=["statement"]
# ## Exercise 6: your local filter flies
#
# Now assemble the compressed EKF from your own pieces, and fly: 81 trees with tags on 90 by
# 90 m, ten or so heard in a step, and an old map that is some metres off, all trees in common.
# Will it end where the full filter ends? And how much of the full filter's work does it do?
#
# Each step: **predict** the region (a speed $v$ moves it by $v\,dt$ along the heading it had
# before, then it turns by $\omega\,dt$; $F$ and $G$ are the derivatives, and (A) of the lesson is
# $\Phi \leftarrow F\Phi$). If the predicted position is *more* than `stay` from where the region
# was entered, **leave**, and enter a new region there. Then **update** with the ranges to the
# region's trees. After the last step, leave once more. This enters a region; its rows are the
# pose and all trees that are nearer than the radius.
#
# In the picture crosses are the true trees; a line leads each tree from the old map to yours,
# blue. The circles are some of your regions, and the title has the mean error of the trees before
# and after. *Numbers written* counts what is written into covariances; the full filter writes all
# of $P$ in each step, 100 %.


# %% tags=["statement"]
def enter(x, P, radius):
    """Trees of the region, its entries of x, and (x_a, P_a, Phi, Psi, theta)."""
    trees = x[3:].reshape(-1, 2)
    near = np.flatnonzero(np.hypot(*(trees - x[:2]).T) < radius)
    entries = np.r_[:3, (3 + 2 * near[:, None] + [0, 1]).ravel()]
    n = len(entries)
    P_a, zero = P[np.ix_(entries, entries)], np.zeros((n, n))
    return near, entries, (x[entries], P_a, np.eye(n), zero, np.zeros(n))


# %% tags=["exercise"]
def fly(
    x: Array,
    P: Array,
    u: Array,
    V: Array,
    dt: float,
    ranges: Array,
    height: float,
    variance: float,
    radius: float,
    stay: float,
) -> tuple[Array, Array, Array, Ints]:
    """Compressed EKF-SLAM over a flight, with ranges to trees of an old map.

    Parameters
    ----------
    x, P : ndarray, shapes (3 + 2 n,) and (3 + 2 n, 3 + 2 n)
        Pose and n trees before the flight.
    u : ndarray, shape (T, 2)
        Speed (m/s) and turn rate (rad/s) of every step.
    V : ndarray, shape (2, 2)
        Covariance of speed and turn rate.
    dt : float
        Duration of a step (s).
    ranges : ndarray, shape (T, n)
        Distances to the trees after every step (m); NaN where a tree is not heard.
        Trees that are not in the region are left out.
    height, variance : float
        As `range_update` has them.
    radius, stay : float
        A region has the trees within `radius`; it is left when the predicted position
        is more than `stay` from the position where it was entered (m).

    Returns
    -------
    x, P : ndarray, shapes (3 + 2 n,) and (3 + 2 n, 3 + 2 n)
        Pose and all trees after the flight.
    path : ndarray, shape (T, 3)
        Pose after every step.
    regions : ndarray of int, shape (k, 2)
        Of every region the step in which it was entered, from 0, and how many numbers
        its state has. The first is entered before the first prediction, in step 0.
    """
    start, (near, entries, region) = x[:2], enter(x, P, radius)
    path, regions = [], [(0, len(entries))]
    for k, (v, omega) in enumerate(u):
        x_a, P_a, Phi, Psi, theta = region
        c, s = dt * np.cos(x_a[2]), dt * np.sin(x_a[2])
        F, G = np.eye(len(x_a)), np.zeros((len(x_a), 2))
        F[:2, 2] = -v * s, v * c
        G[0, 0], G[1, 0], G[2, 1] = c, s, dt
        x_a = x_a + G @ [v, omega]
        region = x_a, F @ P_a @ F.T + G @ V @ G.T, F @ Phi, Psi, theta
        if np.hypot(*(x_a[:2] - start)) > stay:
            x, P, *_ = leave(x, P, entries, *region)
            start, (near, entries, region) = x[:2], enter(x, P, radius)
            regions.append((k, len(entries)))
        region = range_update(*region, ranges[k, near], height, variance)
        path.append(region[0][:3])
    x, P, *_ = leave(x, P, entries, *region)
    return x, P, np.array(path), np.array(regions)


# %% active="ipynb" tags=["try"]
# x, u = np.array([0, 0, 0, 9, 0, 30, 0.0]), np.array([[2.0, 0.0], [2.0, 0.1]])
# fly(x, np.eye(7), u, 0.01 * np.eye(2), 1.0, np.array([[31.2, np.nan], [30.8, np.nan]]),
#     30.0, 0.09, 20.0, 3.0)

# %% [markdown] tags=["hint"]
# `region = range_update(*region, ranges[k, near], height, variance)` hands over the five arrays of
# a region and gets five back. `leave(x, P, entries, *region)` takes them, too.

# %% [markdown] tags=["hint"]
# $F$ is the identity but for the derivatives of the position by the heading. It is of the region's
# size, so $F P F^\top + G V G^\top$ and $F\Phi$ are plain products.

# %% [markdown] tags=["hint"]
# Between two visits of the whole map, `x` and `P` stay as they were at the entry: only `leave` may
# change them. You have a test of your own: with `radius` and `stay` infinite there is one region,
# the whole map, and that is the full filter.


# %% tags=["cases"]
@drawn
def _a_flight(
    rng: np.random.Generator, n: int, steps: int, radius: float, stay: float, dt: float = 0.5
) -> Any:
    """Draw a short flight over n trees."""
    P, N = a_covariance(rng, 3 + 2 * n, 0.5), 3 + 2 * n
    trees = np.round(rng.uniform([-4, -6], [12, 6], (n, 2)), 2)
    pose = np.array([*np.round(rng.uniform(-1, 1, 2), 2), np.round(rng.uniform(-0.4, 0.4), 2)])
    u = np.round(rng.uniform([1.0, -0.4], [3.0, 0.4], (steps, 2)), 2)
    height, way, ranges = float(rng.integers(5, 9)), pose.copy(), []
    for v, omega in u:
        way = way + dt * np.array([v * np.cos(way[2]), v * np.sin(way[2]), omega])
        flat = np.hypot(*(trees - way[:2]).T)
        z = np.round(np.hypot(flat, height) + rng.normal(0, 0.1, n), 2)
        ranges.append(np.where(rng.random(n) < 0.6, z, np.nan))
    x = np.append(pose, trees.ravel()) + np.round(0.5 * rng.normal(size=N), 2)
    V, variance = a_covariance(rng, 2, 0.01), float(rng.choice([0.01, 0.04, 0.09]))
    return x, P, u, V, dt, np.array(ranges), height, variance, radius, stay


def _straight(stay: float) -> Any:
    """Return a flight straight ahead, a metre a step, on which nothing is heard."""
    x, u = [0.0, 0.0, 0.0, 2.0, 1.0, 5.0, -1.0, 9.0, 0.0], np.tile([1.0, 0.0], (6, 1))
    ranges = np.full((6, 3), np.nan)
    return x, 0.5 * np.eye(9), u, 0.01 * np.eye(2), 1.0, ranges, 7.0, 0.04, 4.0, stay


def _turned(omega: float) -> Any:
    """Return a flight whose heading passes half a turn."""
    x, u = [0.0, 0.0, np.sign(omega) * 2.9, 4.0, 1.0], [[1.0, omega]] * 3
    return x, np.eye(5), u, 0.01 * np.eye(2), 0.5, [[np.nan]] * 3, 7.0, 0.04, 9.0, 0.6


@cache
def _whole_flight() -> tuple[Array, Array, Array, Ints]:
    """Fly the flight of the picture with the full filter: one region, never left."""
    given, *_ = survey(1, 90.0, 3.0, 0.5)
    return fly(*given, np.inf, np.inf)


def _apart(one: Array, other: Array) -> float:
    """Return the largest distance of two places."""
    return float(np.hypot(*(one - other).reshape(-1, 2).T).max())


def _fly_drawn(ax: Any, function: Any) -> None:
    """Draw the flight: truth, old map, path and map of the local filter, some of its regions."""
    from slamlab import plots

    given, truth, trees = survey(1, 90.0, 3.0, 0.5)
    came = function(*given, 40.0, 10.0)
    x, P, path, regions = (np.asarray(one, float) for one in came)
    full, N, T = _whole_flight(), len(given[0]), len(given[2])
    gap = max(_apart(x[3:], full[0][3:]), _apart(path[:, :2], full[2][:, :2]))
    steps = np.diff(np.append(regions[:, 0], T))
    written = (steps @ regions[:, 1] ** 2 + len(regions) * N**2) / (T * N**2)
    moved = np.stack([given[0][3:], x[3:]]).reshape(2, -1, 2)
    plots.path(ax, truth, "truth")
    plots.path(ax, path)
    ax.plot(*moved.transpose(2, 0, 1), color="0.5", lw=0.8)
    ax.plot(*trees.T, "+", ms=5, mew=0.9, color=plots.COLOURS["truth"])
    ax.plot(*moved[1].T, "o", ms=2, color=plots.COLOURS["estimate"])
    angle = np.linspace(0, 2 * np.pi, 60)
    ring = 40 * np.column_stack([np.cos(angle), np.sin(angle)])
    for k in regions[3:30:8, 0].astype(int):
        ax.plot(*(path[k, :2] + ring).T, color="0.6", lw=0.6)
    ax.set_aspect("equal")
    ax.set(xlim=(-8, 102), ylim=(-8, 102))
    exact = gap < 1e-8 and np.abs(P - full[1]).max() < 1e-8
    same = "as the full filter" if exact else f"{_m(gap)} from the full filter"
    before, after = (_m(metres_off(one, trees).mean()) for one in (given[0], x))
    ax.set(xlabel=f"x (m); numbers written: {100 * written:.0f} %", ylabel="y (m)")
    ax.set_title(f"trees {before} off, then {after}\n{same}")


check_fly = Check(
    fly,
    "x, P, path, regions",
    {
        "one region, never left": _a_flight(3, 8, 6.0, 50.0),
        "the whole map in one region: the full filter": _a_flight(4, 6, 90.0, 90.0, dt=0.4),
        "regions that are left after some steps": _a_flight(6, 12, 7.0, 3.0),
        "a region that is left in every step": _a_flight(4, 5, 5.0, 0.0, dt=0.8),
        "a region without a tree": _a_flight(2, 4, 0.0, 2.0),
        "exactly at `stay` it is not left yet": _straight(2.0),
        "nothing is heard": _straight(1.5),
        "a heading past half a turn": _turned(0.7),
        "a heading past half a turn to the right": _turned(-0.7),
    },
    tolerance=1e-7,
    draws=3,
    picture=_fly_drawn,
)

# %% tags=["mistakes"]
_SLOPE = "slope = d / expected[:, None] => slope = d / np.hypot(*d.T)[:, None]"
_SEEN = "seen = H @ Phi => seen = H"
_with_slope = check_range_update.mistaken(_SLOPE)
_with_seen = check_range_update.mistaken(_SEEN)
_with_both = check_range_update.mistaken((_SLOPE, _SEEN))

check_fly.mistakes = {
    "your `range_update` still has a bug of exercise 4, the one in the region": (
        "range_update(*region => _with_slope(*region"
    ),
    "your `range_update` still has a bug of exercise 4, the one that shows outside": (
        "range_update(*region => _with_seen(*region"
    ),
    "your `range_update` still has the two bugs of exercise 4": (
        "range_update(*region => _with_both(*region"
    ),
    "Phi was not predicted: (A), F Phi": "G @ V @ G.T, F @ Phi, => G @ V @ G.T, Phi,",
    "F is the identity here: the heading's uncertainty becomes one of the position": (
        "F[:2, 2] = -v * s, v * c => pass"
    ),
    "the noise of the motion is missing: add G V G^T": " + G @ V @ G.T => ",
    "dt is missing in G: a velocity acts for dt": (
        "c, s = dt * np.cos(x_a[2]), dt * np.sin(x_a[2]) => c, s = np.cos(x_a[2]), np.sin(x_a[2])",
        "= c, s, dt => = c, s, 1.0",
        "F[:2, 2] = -v * s, v * c => F[:2, 2] = -v * dt * s, v * dt * c",
        "x_a = x_a + G @ [v, omega] => x_a = x_a + dt * G @ [v, omega]",
    ),
    "F was taken at the heading after the motion: expected the one before it": (
        "F[:2, 2] = -v * s, v * c => e = x_a[2] + omega * dt\n        "
        "F[:2, 2] = -v * dt * np.sin(e), v * dt * np.cos(e)"
    ),
    "the aircraft was not moved": "x_a = x_a + G @ [v, omega] => x_a = x_a.copy()",
    "after the last step the region was not left: the trees outside are missing": (
        "x, P, *_ = leave(x, P, entries, *region)\n    return"
        " => x[entries], P[np.ix_(entries, entries)] = region[:2]\n    return"
    ),
    "the whole map was returned as it was at the last entry": (
        "x, P, *_ = leave(x, P, entries, *region)\n    return => return"
    ),
    "the region is never left": "> stay: => > np.inf:",
    "a region is left after more than `stay`, not exactly there": "> stay: => >= stay:",
    "the distance counts from where this region was entered, not from the first": (
        "start, (near, entries, region) = x[:2], enter(x, P, radius)\n            "
        " => near, entries, region = enter(x, P, radius)\n            "
    ),
    "the region was left with the update of this step: leave before it": (
        "region = range_update(*region, ranges[k, near], height, variance)\n        path => path",
        "        if np.hypot =>         region = range_update(*region, ranges[k, near], height, "
        "variance)\n        x_a = region[0]\n        if np.hypot",
    ),
    "the path has the predicted poses: expected those after the update": (
        "path.append(region[0][:3]) => path.append(x_a[:3])"
    ),
    "no range was used": "ranges[k, near], height => np.nan * ranges[k, near], height",
}

# %% [markdown] tags=["solution"]
# ## Solution 6: your local filter flies
#
# It is the full filter: path, map and covariance differ by less than $10^{-8}$. Prediction and
# update are those of EKF-SLAM, of the region's size; the records are four lines, and `leave` is
# paid once in several steps. *Numbers written* counts what a filter writes into $P$: the full one
# all of it in each step; yours the region's block, and on leaving all of $P$: about half of its
# numbers are written then ([16e](../16e_uav_local_range.ipynb) counts products).

# %% [markdown] tags=["solution"]
# Ten flights of the full filter, and the first four with regions of three sizes. The radio hears
# 20 m far and the old map is some metres off, so `stay` is 30 m less than the radius.

# %% active="ipynb" tags=["solution"]
# from slamlab.exercises.ch16_uav_local_range import metres_off, survey
#
# flights = [survey(seed, 90.0, 3.0, 0.5) for seed in range(10)]
# full = [fly(*given, np.inf, np.inf) for given, *_ in flights]
#
# for radius in (32.0, 40.0, 50.0):
#     local = [fly(*given, radius, radius - 30) for given, *_ in flights[:4]]
#     gap = max(np.abs(a - b).max() for f, g in zip(full, local)
#               for a, b in zip(f[:3], g[:3]))
#     print(f"R = {radius:.0f} m: {np.mean([len(g[3]) for g in local]):.0f} regions, "
#           f"from the full filter below 1e-8: {gap < 1e-8}")

# %% [markdown] tags=["solution"]
# And if the prediction leaves $\Phi$ alone? The map is as near to the truth as before. But it is
# not the full filter's, and in most flights $P$ is no covariance: it has a negative eigenvalue.

# %% active="ipynb" tags=["solution"]
# no_F_Phi = check_fly.mistaken("F @ Phi, Psi => Phi, Psi")
# wrong = [no_F_Phi(*given, 40.0, 10.0) for given, *_ in flights]
# apart = [np.abs(f[0][3:] - g[0][3:]).max() for f, g in zip(full, wrong)]
# print(f"without F Phi: from the full filter, the worst tree of a flight "
#       f"{min(apart):.1f} to {max(apart):.1f} m")
# old = [given for given, *_ in flights]
# for name, found in (("old map", old), ("full filter", full), ("without F Phi", wrong)):
#     pairs = zip(found, flights)
#     off = [metres_off(one[0], trees).mean() for one, (*_, trees) in pairs]
#     bad = sum(np.linalg.eigvalsh(one[1])[0] < -1e-6 for one in found)
#     print(f"{name}: trees off by {np.mean(off):.1f} m; P no covariance in {bad} of 10")

# %% [markdown] tags=["statement"]
# **What you have now**: the compressed EKF of the chapter, with a sensor that the chapter does not
# have, equal to the full filter to rounding. The solutions are in
# [Solutions 16](../solutions/16_uav_local_range.ipynb).
