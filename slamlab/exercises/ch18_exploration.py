"""Exercises, chapter 18: the areas that a square sweeps, four quarters, the frontier and the way.

P5, 3.2.5: `CanMove` and the four quadrants, mended; frontiers after Yamauchi (1997).
"""

# mypy: disable-error-code="arg-type, assignment"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn
from slamlab.exercises._report import Array, Check, Function, Ints

__all__ = [
    "check_free_step",
    "check_free_turn",
    "check_frontier",
    "check_quarter_beams",
    "check_swept",
    "check_way",
]


# %% [markdown] tags=["chapter"]
# # Exercises 18: exploration
#
# Six exercises on an explorer that touches nothing and knows when it is done: its room to turn
# with a pencil, what it sweeps, where it might go, a guard with a bug, the frontier, and the way
# there, which you let run through a flat. The chapter is [Exploration](../18_exploration.ipynb).
# Replace each `...` and run the check below it as often as you like; then draw what you built
# beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 18: exploration
#
# The exercises are in [Exercises 18](../exercises/18_exploration.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: room to turn, with a pencil
#
# A square of half side $h$ turns on the spot. A point outside it, at the distance $d$ from its
# centre with $h < d < \sqrt2\,h$, stands in one of the four gaps between the square and the
# circle of its corners. How far may the square turn to the left, and how far to the right, before
# it touches the point?
#
# Draw it. Along the circle of radius $d$ the square covers four arcs round its corners. How wide
# is the gap round the middle of a side? Where in the gap is the point, and which way does it
# move, seen from a robot that turns left?


# %% tags=["exercise"]
def free_turn(point: Array, half: float) -> tuple[float, float]:
    """How far a square may turn on the spot.

    Parameters
    ----------
    point : ndarray, shape (2,)
        In the frame of the body (m): x ahead of its centre, y to the left.
    half : float
        Half the side of the square (m).

    Returns
    -------
    left, right : float
        Angles (rad), not negative; inf twice where no corner can reach the point or
        touches it in passing (d >= sqrt(2) half), 0 twice where the point is inside
        the body. A point exactly on the border is not tried.
    """
    d = np.hypot(*point)
    if d >= half * np.sqrt(2):
        return np.inf, np.inf
    gamma = np.arccos(half / max(d, half))
    beta = np.arctan2(point[1], point[0])
    beta = beta - np.pi / 2 * np.rint(beta / (np.pi / 2))
    left, right = gamma + beta, gamma - beta
    return (left, right) if min(left, right) > 0 else (0.0, 0.0)


# %% active="ipynb" tags=["try"]
# free_turn(np.array([0.25, 0.0]), 0.2)

# %% [markdown] tags=["hint"]
# The side ahead is the line $x = h$. The circle of radius $d$ meets it at an angle $\gamma$ from
# the middle with $d \cos\gamma = h$.

# %% [markdown] tags=["hint"]
# A square looks the same after a quarter of a turn. Count the direction of the point from the
# middle of the nearest side: subtract the nearest multiple of $\pi/2$, which `np.rint` finds.

# %% [markdown] tags=["hint"]
# A point in the middle of its gap has $\gamma$ to either side. One that lies $\beta$ to the left
# of the middle moves towards it when the robot turns left.


# %% tags=["cases"]
@drawn
def _in_gap(rng: np.random.Generator, side: int | None = None) -> Any:
    """Draw a point in one of the four gaps; 0 is ahead, then counterclockwise."""
    half = float(np.round(rng.uniform(0.1, 0.5), 2))
    distance = half * rng.uniform(1.05, 1.38)
    gap = np.arccos(half / distance)
    k = int(rng.integers(4)) if side is None else side
    angle = k * np.pi / 2 + rng.uniform(-0.8, 0.8) * gap
    return distance * np.array([np.cos(angle), np.sin(angle)]), half


def _body(ax: Any, half: float, kind: str, turn: float = 0.0, ahead: float = 0.0) -> None:
    """Draw a square body, turned to the left, or driven ahead."""
    from slamlab import plots

    corners = half * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]])
    c, s = np.cos(turn), np.sin(turn)
    plots.path(ax, corners @ np.array([[c, s], [-s, c]]) + [ahead, 0], kind)


def _free_turn_drawn(ax: Any, function: Any) -> None:
    """Draw a point beside a square, and the square turned left and right as far as it may."""
    from slamlab import plots

    point = 0.24 * np.array([np.cos(-1.4), np.sin(-1.4)])
    left, right = (float(one) for one in function(point, 0.2))
    _body(ax, 0.2, "truth")
    _body(ax, 0.2, "estimate", left)
    _body(ax, 0.2, "dead_reckoning", -right)
    ax.plot(*point, "o", color=plots.COLOURS["lidar"], markersize=6)
    plots.floor(ax)
    ax.set(xlabel="x (m); dashed: to the right")


check_free_turn = Check(
    free_turn,
    "left, right",
    {
        "a point straight ahead": ([0.25, 0.0], 0.2),
        "ahead, left or right of the middle": _in_gap(0),
        "on the left side": _in_gap(1),
        "behind": _in_gap(2),
        "on the right side": _in_gap(3),
        "beyond the reach of the corners": ([0.2, 0.21], 0.2),
        "inside the body": ([0.19, 0.15], 0.2),
        "inside the body, beside a corner": ([0.195, 0.195], 0.2),
        "at the centre": ([0.0, 0.0], 0.2),
        "any gap": _in_gap(),
    },
    picture=_free_turn_drawn,
)

# %% tags=["mistakes"]
check_free_turn.mistakes = {
    "left and right are exchanged: when the robot turns left, the point moves right": (
        "left, right = gamma + beta, gamma - beta => left, right = gamma - beta, gamma + beta"
    ),
    "both ways are the gap: that holds in its middle only": (
        "left, right = gamma + beta, gamma - beta => left, right = gamma, gamma"
    ),
    "the direction is counted from the front: count it from the nearest side": (
        "beta = beta - np.pi / 2 * np.rint(beta / (np.pi / 2)) => pass"
    ),
    "the gap has the half angle arccos(h / d), not arcsin": "np.arccos => np.arcsin",
    "this is the whole gap: half of it lies on either side of the middle": (
        "np.arccos(half / max(d, half)) => 2 * np.arccos(half / max(d, half))"
    ),
    "where the corners do not reach it may turn as it likes": (
        "return np.inf, np.inf => return np.pi / 4, np.pi / 4"
    ),
    "the corners reach half sqrt(2), not half": ("d >= half * np.sqrt(2) => d >= half"),
    "a point that the corners can reach may still leave some room: return how much": (
        "gamma = np.arccos(half / max(d, half)) => return 0.0, 0.0"
    ),
    "inside the body there is no room to turn": (
        "if min(left, right) > 0 else (0.0, 0.0) => if min(left, right) > -np.inf else (0.0, 0.0)"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: room to turn, with a pencil
#
# The side ahead meets the circle of radius $d$ where $d\cos\gamma = h$: the gap reaches from
# $-\gamma$ to $\gamma$ round its middle. A turn of the robot to the left by $\delta$ moves a
# point at $\beta$ to $\beta - \delta$, which must stay above $-\gamma$: $\delta \le \gamma +
# \beta$. To the right it must stay below $\gamma$: $\delta \le \gamma - \beta$.

# %% [markdown] tags=["solution"]
# And numerically, against the corners themselves: turn the square in small steps to the left
# until the point is inside.

# %% active="ipynb" tags=["solution"]
# for point in ([0.25, 0.05], [-0.05, 0.26], [0.15, -0.22]):
#     turns = np.arange(0, 1.6, 1e-4)
#     x = np.cos(turns) * point[0] + np.sin(turns) * point[1]
#     y = np.cos(turns) * point[1] - np.sin(turns) * point[0]
#     first = turns[np.argmax((np.abs(x) < 0.2) & (np.abs(y) < 0.2))]
#     left, _ = free_turn(np.array(point), 0.2)
#     print(f"{point}: {left:.2f} rad, by small steps {first:.2f}")

# %% [markdown] tags=["solution"]
# The sign is the trap. Turning left moves the world to the right:

# %% active="ipynb" tags=["solution"]
# check_free_turn(lambda point, half: free_turn(point, half)[::-1])

# %% [markdown] tags=["statement"]
# ## Exercise 2: what the body sweeps
#
# A square robot drives straight ahead. Which of the points that its lidar has met would it touch
# on the way? P5's `CanMove` compares the *distance* of the points in its front quarter with the
# step; the body does not.


# %% tags=["exercise"]
def swept(points: Array, half: float, step: float) -> Any:
    """Which points the robot touches.

    Parameters
    ----------
    points : ndarray, shape (k, 2)
        Points in the frame of the body (m): x ahead of its centre, y to the left.
    half : float
        Half the side of the square (m).
    step : float
        How far it drives ahead (m).

    Returns
    -------
    ndarray of bool, shape (k,)
        True where the body covers the point at some moment, its start included. A
        point exactly on the border is not touched.
    """
    x, y = points.T
    return (np.abs(y) < half) & (x > -half) & (x < half + step)


# %% active="ipynb" tags=["try"]
# swept(np.array([[0.5, 0.0], [0.5, 0.2]]), 0.15, 0.4)

# %% [markdown] tags=["hint"]
# The area that the square covers on its way is a rectangle. Where does it begin, where does it
# end?

# %% [markdown] tags=["hint"]
# Its front stands `half` ahead of the centre at the start and `half + step` at the end. Its back
# begins at `-half`.

# %% [markdown] tags=["hint"]
# Three comparisons, joined by `&`: one for `np.abs(y)`, two for `x`.


# %% tags=["cases"]
def _around(rng: np.random.Generator) -> Any:
    half, step = np.round(rng.uniform(0.1, 0.4), 2), np.round(rng.uniform(0.05, 1.5), 2)
    return np.round(rng.uniform(-1, 2, (int(rng.integers(1, 60)), 2)), 2), half, step


_BORDER = [[0.5, 0.0], [0.0, 0.25], [-0.25, 0.0], [0.25, -0.25], [0.499, 0.249]]


def _swept_drawn(ax: Any, function: Any) -> None:
    """Draw a body before and after its step, points round it, and a ring round those it hits."""
    from slamlab import plots

    points = np.random.default_rng(1).uniform([-0.6, -0.5], [1.3, 0.5], (120, 2))
    hit = np.asarray(function(points, 0.2, 0.6)).astype(bool).reshape(120)
    plots.lidar_points(ax, points, s=4)
    rings = points[hit]
    ax.plot(*rings.T, "o", color=plots.COLOURS["dead_reckoning"], markersize=8, mfc="none")
    _body(ax, 0.2, "truth")
    _body(ax, 0.2, "estimate", ahead=0.6)
    plots.floor(ax)


check_swept = Check(
    swept,
    "hit",
    {
        "straight ahead, near and far": ([[0.3, 0.0], [0.54, 0.0], [0.6, 0.0]], 0.15, 0.4),
        "beside the way, left and right": (
            [[0.3, 0.1], [0.3, -0.1], [0.3, 0.2], [0.3, -0.2]],
            0.15,
            0.4,
        ),
        "half-way, touched neither at the start nor at the end": ([[0.5, 0.05]], 0.1, 1.0),
        "behind: in the body and beyond it": ([[-0.1, 0.0], [-0.3, 0.0]], 0.15, 0.4),
        "exactly on the border": (_BORDER, 0.25, 0.25),
        "a robot that does not move": (_BORDER, 0.25, 0.0),
        "five points ahead": (
            [[0.1, 0.1], [0.4, -0.2], [0.6, 0.1], [0.7, 0], [0, 0.3]],
            0.15,
            0.35,
        ),
        "no points": (np.zeros((0, 2)), 0.2, 0.5),
        "points all around": _around,
    },
    picture=_swept_drawn,
)


# %% tags=["mistakes"]
def _at_both_ends(points: Array, half: float, step: float) -> Any:
    return swept(points, half, 0.0) | swept(points - [step, 0.0], half, 0.0)


check_swept.mistakes = {
    "the distance of the point was compared with the step: that guards the centre only": (
        lambda p, h, w: (np.hypot(*p.T) < w) & (p[:, 0] > 0)
    ),
    "the body was tested at the start and at the end only: it sweeps what lies between": (
        _at_both_ends
    ),
    "the body was tested at the end only: it sweeps what lies between": (
        lambda p, h, w: swept(p - [w, 0.0], h, 0.0)
    ),
    "a disc was swept: the body is a square": (
        lambda p, h, w: np.hypot(p[:, 0] - np.clip(p[:, 0], 0, w), p[:, 1]) < h
    ),
    "the front is half a side ahead of the centre: the way ends at half + step": (
        "x < half + step => x < step"
    ),
    "one flank was forgotten: take the absolute value of y": "np.abs(y) < half => y < half",
    "the other flank was forgotten: take the absolute value of y": (
        "np.abs(y) < half => y > -half"
    ),
    "the body reaches half a side behind its centre too: begin at -half": ("x > -half => x > 0"),
    "the body that stands at the start counts as well: begin at -half, not at half": (
        "x > -half => x > half"
    ),
    "everything behind the robot was hit as well: the area begins at -half": (
        " & (x > -half) => "
    ),
    "everything ahead was hit as well: the way ends at half + step": (" & (x < half + step) => "),
    "the whole side was taken for half of it": lambda p, h, w: swept(p, 2 * h, w),
    "half was halved: it is half the side already": lambda p, h, w: swept(p, h / 2, w),
    "x and y were exchanged: x points ahead, y to the left": "x, y = => y, x =",
    "a point on the border is only touched: use < and not <=": (
        "np.abs(y) < half => np.abs(y) <= half",
        "x > -half => x >= -half",
        "x < half => x <= half",
    ),
    "these are the points that stay free: return those that are hit": (
        lambda p, h, w: ~swept(p, h, w)
    ),
    "these are the points themselves: expected true or false for each": (
        lambda p, h, w: p[swept(p, h, w)]
    ),
    "one answer for all points was returned: each has its own": (
        lambda p, h, w: bool(swept(p, h, w).any())
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: what the body sweeps
#
# The square covers a rectangle: as wide as itself, from its back at the start to its front at the
# end.

# %% [markdown] tags=["solution"]
# The test of `CanMove` asks how far the point is; here it is asked of all points ahead, not of the
# front quarter only. It lets the front of the robot run into walls that are half a side too near,
# and it stops before a wall at the side that the body would pass.

# %% active="ipynb" tags=["solution"]
# def as_printed(points, half, step):
#     return (np.hypot(*points.T) < step) & (points[:, 0] > 0)
#
# check_swept(as_printed)

# %% [markdown] tags=["statement"]
# ## Exercise 3: four quarters, and not back
#
# The robot of the chapter's first figure follows its longest beam, so it drives to and fro on
# one diagonal of the room. P5's cure: take the longest beam of each of the quarters 0 to
# 90, 90 to 180, 180 to 270 and 270 to 360 degrees (a beam at 90 belongs to the second), and leave
# out those that lead back.


# %% tags=["exercise"]
def quarter_beams(ranges: Array, degrees: Array, back: float) -> Ints:
    """Beams worth following.

    Parameters
    ----------
    ranges : ndarray, shape (n,)
        Lengths of the beams (m), no two of them equal within a quarter.
    degrees : ndarray, shape (n,)
        Their directions in [0, 360), ascending; every quarter has at least one.
    back : float
        Direction in which the robot would go back (degrees, in [0, 360)).

    Returns
    -------
    ndarray of int
        Index of the longest beam of each quarter, in the order of the quarters,
        without those whose direction is 45 degrees or less from `back`.
    """
    best = []
    for low in (0, 90, 180, 270):
        inside = np.flatnonzero((degrees >= low) & (degrees < low + 90))
        beam = inside[np.argmax(ranges[inside])]
        if abs((degrees[beam] - back + 180) % 360 - 180) > 45:
            best.append(beam)
    return np.array(best)


# %% active="ipynb" tags=["try"]
# degrees = np.array([45.0, 135.0, 225.0, 315.0])
# quarter_beams(np.array([1.0, 2.0, 3.0, 4.0]), degrees, 330.0)

# %% [markdown] tags=["hint"]
# `np.flatnonzero((degrees >= low) & (degrees < high))` gives the indices of a quarter's beams;
# `np.argmax` then counts inside the quarter.

# %% [markdown] tags=["hint"]
# 10 degrees and 350 degrees are 20 degrees apart. Wrap the difference to [-180, 180) before you
# compare it.

# %% [markdown] tags=["hint"]
# `abs((degrees[beam] - back + 180) % 360 - 180) > 45` keeps a beam.


# %% tags=["cases"]
def _lengths(n: int, rng: np.random.Generator) -> Any:
    return np.round(rng.permutation(n) / n + 0.5, 3)


def _lidar(rng: np.random.Generator) -> Any:
    n = int(rng.choice([8, 12, 36, 72]))
    return _lengths(n, rng), np.arange(n) * 360 / n, float(np.round(rng.uniform(0, 360), 1))


def _on_borders(rng: np.random.Generator) -> Any:
    """Draw scans whose longest beams point exactly along 0, 90, 180 and 270 degrees."""
    ranges, degrees = _lengths(36, rng), np.arange(0.0, 360.0, 10.0)
    ranges[[0, 9, 18, 27]] = np.round(rng.permutation(4) + 3.0, 1)
    return ranges, degrees, float(rng.choice([10.0, 100.0, 200.0, 290.0]))


def _near_the_limit(rng: np.random.Generator) -> Any:
    """Draw half-degree scans: long beams just before borders, back 45 degrees from one of them."""
    ranges, degrees = _lengths(720, rng), np.arange(0.0, 360.0, 0.5)
    ranges[[179, 359, 539, 719]] = np.round(rng.permutation(4) + 3.0, 1)
    back = rng.choice([89.5, 179.5, 269.5, 359.5]) + rng.choice([-45.5, -44.5, 44.5, 45.5])
    return ranges, degrees, float(back % 360)


def _quarters_drawn(ax: Any, function: Any) -> None:
    """Draw the 36 beams of a scan, the way back dashed, and the beams that are followed."""
    from slamlab import plots

    degrees, back = np.arange(0.0, 360.0, 10.0), 350.0
    ranges = 2 + np.sin(np.deg2rad(2 * degrees + 40)) + 0.3 * np.cos(np.deg2rad(5 * degrees))
    ends = ranges[:, None] * np.column_stack(
        [np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))]
    )
    for end in ends:
        ax.plot([0, end[0]], [0, end[1]], color=plots.COLOURS["lidar"], lw=0.8)
    for beam in np.asarray(function(ranges, degrees, back)).astype(int):
        plots.path(ax, np.array([[0, 0], ends[beam]]), marker="o")
    home = 3 * np.array([np.cos(np.deg2rad(back)), np.sin(np.deg2rad(back))])
    plots.path(ax, np.array([[0, 0], home]), "dead_reckoning")
    plots.floor(ax)


check_quarter_beams = Check(
    quarter_beams,
    "beams",
    {
        "four beams": ([1.0, 2.0, 3.0, 4.0], [45.0, 135.0, 225.0, 315.0], 320.0),
        "exactly 45 degrees from the way back is within": (
            [1.0, 2.0, 3.0, 4.0],
            [10.0, 100.0, 225.0, 315.0],
            55.0,
        ),
        "back is straight ahead: 350 and 10 degrees are both near": lambda rng: (
            _lengths(36, rng) + 9.0 * np.isin(np.arange(36), [1, 35]),
            np.arange(0.0, 360.0, 10.0),
            0.0,
        ),
        "a long beam at 170 degrees belongs to the second quarter": lambda rng: (
            _lengths(36, rng) + 9.0 * (np.arange(36) == 17),
            np.arange(0.0, 360.0, 10.0),
            300.0,
        ),
        "the longest beams lie on the borders of the quarters": _on_borders,
        "half-degree beams, just within or beyond 45 degrees": _near_the_limit,
        "any lidar": _lidar,
    },
    draws=12,
    picture=_quarters_drawn,
)

# %% tags=["mistakes"]
check_quarter_beams.mistakes = {
    "the third quarter begins at 180 degrees; 160, as P5 prints it, counts beams twice": (
        "degrees >= low) => degrees >= (160 if low == 180 else low))"
    ),
    "the way back was kept: drop beams within 45 degrees of it": "> 45 => > -1",
    "350 and 10 degrees are 20 apart: wrap the difference of directions": (
        "abs((degrees[beam] - back + 180) % 360 - 180) => abs(degrees[beam] - back)"
    ),
    "the beams near the way back were dropped before the longest was taken: take the longest "
    "of each quarter first": (
        "ranges[inside]"
        " => ranges[inside] * (np.abs((degrees[inside] - back + 180) % 360 - 180) > 45)"
    ),
    "exactly 45 degrees is within 45 degrees": "> 45 => >= 45",
    "45 degrees to either side, not in all": "> 45 => > 22.5",
    "45 degrees, not 90": "> 45 => > 90",
    "a beam on a border belongs to the quarter that begins there": (
        "degrees >= low => degrees > low",
        "degrees < low + 90 => degrees <= low + 90",
    ),
    "count beams from the first of the scan, not of the quarter": (
        "best.append(beam) => best.append(beam - inside[0])"
    ),
    "these are the shortest beams": "argmax => argmin",
    "these lead back: expected the others": "> 45 => <= 45",
    "one beam was returned: expected the longest of each quarter": (
        lambda r, a, b: np.array([int(np.argmax(r))])
    ),
    "these are the directions: expected the indices of the beams": (
        lambda r, a, b: a[quarter_beams(r, a, b)]
    ),
    "these are the lengths: expected the indices of the beams": (
        lambda r, a, b: r[quarter_beams(r, a, b)]
    ),
    "expected the order of the quarters, not the order of the lengths": (
        lambda r, a, b: sorted(quarter_beams(r, a, b), key=lambda k: -r[k])
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: four quarters, and not back

# %% [markdown] tags=["solution"]
# Without the wrap the rule works until the robot has to look across 0 degrees:

# %% active="ipynb" tags=["solution"]
# def unwrapped(ranges, degrees, back):
#     best = []
#     for low in (0, 90, 180, 270):
#         inside = np.flatnonzero((degrees >= low) & (degrees < low + 90))
#         beam = inside[np.argmax(ranges[inside])]
#         if abs(degrees[beam] - back) > 45:
#             best.append(beam)
#     return np.array(best)
#
# check_quarter_beams(unwrapped)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a guard with a bug
#
# How far may the square drive straight ahead, if it is to keep a margin to everything? This guard
# was tested in front of walls, and passed. On its first day at work the robot scraped along a
# door post.


# %% tags=["exercise"]
def free_step(points: Array, half: float, margin: float) -> float:
    """How far the robot may drive ahead.

    Parameters
    ----------
    points : ndarray, shape (k, 2)
        Points in the frame of the body (m): x ahead of its centre, y to the left.
    half : float
        Half the side of the square (m).
    margin : float
        Room that must stay free around the body (m). A point exactly there is free.

    Returns
    -------
    float
        Metres, 0 if it must stay, inf if nothing is in the way. Only points ahead
        of the centre count.
    """
    x, y = points.T
    ahead = x[(np.abs(y) < half + margin) & (x > 0)]
    return max(ahead.min() - half - margin, 0.0) if len(ahead) else np.inf


# %% active="ipynb" tags=["stub"]
#     x, y = points.T
#     ahead = x[(np.abs(y) < half) & (x > 0)]
#     return max(ahead.min() - half - margin, 0.0) if len(ahead) else np.inf

# %% active="ipynb" tags=["try"]
# free_step(np.array([[0.6, 0.18], [2.0, 0.0]]), 0.15, 0.05)

# %% [markdown] tags=["hint"]
# In the call above a post stands 18 cm beside the line of the centre. How far from the robot's
# flank does it pass?

# %% [markdown] tags=["hint"]
# A body with a margin is a larger body. How many of its four sides does the guard enlarge?


# %% tags=["cases"]
def _posts(rng: np.random.Generator) -> Any:
    half, margin = np.round(rng.uniform([0.1, 0.01], [0.4, 0.2]), 2)
    points = rng.uniform([-1, -1], [3, 1], (int(rng.integers(1, 12)), 2))
    return np.round(points, 2), half, margin


def _free_step_drawn(ax: Any, function: Any) -> None:
    """Draw a body between posts, the margin round it, and the body after the step."""
    from slamlab import plots

    points = np.array([[1.1, 0.24], [0.5, 0.31], [1.6, -0.1], [-0.3, 0.1], [0.4, -0.3]])
    step = float(function(points, 0.2, 0.06))
    plots.lidar_points(ax, points, s=6)
    _body(ax, 0.2, "truth")
    _body(ax, 0.26, "lidar", ahead=step)
    _body(ax, 0.2, "estimate", ahead=step)
    plots.floor(ax)


check_free_step = Check(
    free_step,
    "step",
    {
        "a wall ahead": ([[1.0, -0.1], [1.0, 0.0], [1.0, 0.1]], 0.15, 0.05),
        "a door post within the margin": ([[0.6, 0.18], [2.0, 0.0]], 0.15, 0.05),
        "a door post beside the margin": ([[0.6, 0.21], [0.7, -0.21], [2.0, 0.0]], 0.15, 0.05),
        "no margin": ([[0.6, 0.18], [0.8, -0.1]], 0.15, 0.0),
        "what is behind does not count": ([[-0.3, 0.0], [0.9, 0.0]], 0.15, 0.05),
        "nothing in the way": ([[1.0, 2.0], [-1.0, 0.0]], 0.15, 0.05),
        "no points": (np.zeros((0, 2)), 0.15, 0.05),
        "nearer than the margin: not backwards": ([[0.25, 0.0]], 0.25, 0.125),
        "exactly at the margin beside": ([[1.0, 0.375]], 0.25, 0.125),
        "beside the body, within the margin": ([[0.1, 0.28]], 0.25, 0.125),
        "exactly beside the centre": ([[0.0, 0.25]], 0.25, 0.125),
        "any posts": _posts,
    },
    edges=("no points",),
    picture=_free_step_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
_FLANK, _SPARE = "np.abs(y) < half + margin", "ahead.min() - half - margin"


check_free_step.mistakes = {
    "the margin is missing beside the body: the flanks need room as well as the front": (
        f"{_FLANK} => np.abs(y) < half"
    ),
    "the margin is missing ahead": f"{_SPARE} => ahead.min() - half",
    "the front stands half a side ahead of the centre: take it off": (
        f"{_SPARE} => ahead.min() - margin"
    ),
    "this is how far the centre may go: take off half a side and the margin": (
        f"{_SPARE} => ahead.min()"
    ),
    "every point ahead counts, though the body passes beside it": (
        f"{_FLANK} => np.abs(y) < np.inf"
    ),
    "points behind the robot count: it drives ahead": " & (x > 0) => ",
    "one flank was forgotten: take the absolute value of y": (f"{_FLANK} => y < half + margin"),
    "the other flank was forgotten: take the absolute value of y": (
        f"{_FLANK} => y > -half - margin"
    ),
    "a step is never negative: a robot that is too near stays": (
        "max(ahead.min() - half - margin, 0.0) => (ahead.min() - half - margin)"
    ),
    "where nothing is in the way it may go on for ever": "else np.inf => else 0.0",
    "this is the distance of the nearest point: how far it is ahead counts": (
        "ahead = x[ => ahead = np.hypot(x, y)["
    ),
    "the farthest point ahead was taken: the nearest stops the robot": (
        "ahead.min() => ahead.max()"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: a guard with a bug
#
# The margin was added in front and forgotten at the flanks. A wall reaches across the robot's
# way, so its points straight ahead hide the bug; a post does not. Test a guard with single
# points, at all its edges.

# %% [markdown] tags=["solution"]
# A guard that lets every point ahead stop the robot has no collisions, and no doors either:

# %% active="ipynb" tags=["solution"]
# def timid(points, half, margin):
#     ahead = points[points[:, 0] > 0, 0]
#     return max(ahead.min() - half - margin, 0.0) if len(ahead) else np.inf
#
# check_free_step(timid)

# %% [markdown] tags=["statement"]
# ## Exercise 5: the frontier
#
# No beam of a scan says that a building is done. A map does: as long as somewhere free floor
# borders on floor that was never seen, there is something left, and the robot can stand right
# beside it. Write the rule that finds these cells. It is the whole difference between a robot that
# wanders and one that stops; in exercise 6 yours drives.
#
# A diagonal neighbour does not count, and the map ends at its edge: think twice before you use
# `np.roll`.


# %% tags=["private"]
def _beside(
    mask: Any, diagonal: bool = False, outside: bool = False, sides: Any = slice(4)
) -> Any:
    padded = np.pad(mask, 1, constant_values=outside)
    steps = [(0, 1), (1, 0), (0, -1), (-1, 0)][sides]
    steps += [(1, 1), (1, -1), (-1, 1), (-1, -1)] if diagonal else []
    rows, columns = mask.shape
    parts = [padded[1 + i : 1 + i + rows, 1 + j : 1 + j + columns] for i, j in steps]
    return np.any(parts, axis=0)


# %% tags=["exercise"]
def frontier(state: Ints) -> Any:
    """Where the unknown begins.

    Parameters
    ----------
    state : ndarray of int, shape (rows, columns)
        0 unknown, 1 free, 2 occupied.

    Returns
    -------
    ndarray of bool, shape (rows, columns)
        True for free cells with an unknown cell directly above, below, left or
        right. Beyond the edge of the map there is nothing, and nothing is not unknown.
    """
    unknown = state == 0
    beside = np.zeros_like(unknown)
    beside[1:] |= unknown[:-1]
    beside[:-1] |= unknown[1:]
    beside[:, 1:] |= unknown[:, :-1]
    beside[:, :-1] |= unknown[:, 1:]
    return beside & (state == 1)


# %% active="ipynb" tags=["try"]
# frontier(np.array([[1, 1, 0], [2, 1, 1]]))

# %% [markdown] tags=["hint"]
# Begin with the mask `state == 0`. Which cells lie to the right of an unknown one? Shift the mask.

# %% [markdown] tags=["hint"]
# `np.roll` carries what leaves on one side back in on the other. Slices do not: `beside[:, 1:] |=
# unknown[:, :-1]`.


# %% tags=["cases"]
def _a_map(rng: np.random.Generator) -> Any:
    return (rng.choice([0, 1, 1, 1, 2], size=rng.integers(1, 9, 2)),)


_ISLAND = np.pad(np.ones((3, 3), dtype=int), 1)


def _state_drawn(ax: Any, state: Any) -> None:
    """Draw a map: white is free, dark occupied, grey unknown."""
    from slamlab import plots

    rows, columns = state.shape
    plots.occupancy(ax, np.array([0.4, 0.0, 0.85])[state], [-0.5, columns - 0.5, -0.5, rows - 0.5])
    ax.set(xlabel="column", ylabel="row")


def _frontier_drawn(ax: Any, function: Any) -> None:
    """Draw a half-explored flat, unknown grey, and a dot on each cell of the frontier."""
    from slamlab import plots

    state = _two_rooms()[0].copy()
    state[:, 14:] = 0
    state[11:, :6] = 0
    _state_drawn(ax, state)
    edge = np.asarray(function(state)).astype(bool)
    rows, columns = np.nonzero(edge)
    ax.plot(columns, rows, "o", color=plots.COLOURS["estimate"], markersize=4)


check_frontier = Check(
    frontier,
    "frontier",
    {
        "an island of free floor: its rim": (_ISLAND,),
        "a wall between free and unknown": ([[1, 1, 2, 0], [1, 1, 2, 0], [1, 1, 1, 0]],),
        "everything seen: no frontier": ([[1, 1, 1], [1, 2, 1], [1, 1, 1]],),
        "unknown on the far edge": ([[1, 1, 1, 0], [1, 1, 1, 0]],),
        "unknown across the corner only": ([[1, 2, 0], [2, 1, 2], [0, 2, 1]],),
        "a single cell": ([[1]],),
        "a column": ([[0], [1], [1], [2], [0]],),
        "any map": _a_map,
    },
    picture=_frontier_drawn,
)


# %% tags=["mistakes"]
def _rolled(state: Ints) -> Any:
    unknown = state == 0
    beside = [np.roll(unknown, step, axis) for step in (1, -1) for axis in (0, 1)]
    return np.any(beside, axis=0) & (state == 1)


check_frontier.mistakes = {
    "these are the unknown cells beside free ones: the robot can stand on the free side": (
        lambda s: _beside(s == 1) & (s == 0)
    ),
    "cells beside a wall were returned too: only an unknown neighbour makes a frontier": (
        lambda s: _beside(s != 1) & (s == 1)
    ),
    "np.roll wraps around: the left edge is no neighbour of the right one": _rolled,
    "beyond the edge of the map there is nothing, and nothing is not unknown": (
        lambda s: _beside(s == 0, outside=True) & (s == 1)
    ),
    "only two of the four neighbours were looked at": (
        lambda s: _beside(s == 0, sides=slice(2)) & (s == 1)
    ),
    "only left and right were looked at": (
        lambda s: _beside(s == 0, sides=slice(0, 4, 2)) & (s == 1)
    ),
    "walls were returned too: a frontier cell is free": lambda s: _beside(s == 0) & (s != 0),
    "diagonal neighbours were counted: above, below, left and right only": (
        lambda s: _beside(s == 0, diagonal=True) & (s == 1)
    ),
    "all free cells were returned: expected only those with an unknown neighbour": lambda s: (
        s == 1
    ),
    "all cells beside unknown ones were returned: a frontier cell is free": lambda s: _beside(
        s == 0
    ),
    "these are the places of the cells: expected true or false for each": (
        lambda s: np.argwhere(_beside(s == 0) & (s == 1))
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: the frontier
#
# Shift the mask of unknown cells by one cell each way, with slices, so that nothing comes in from
# the other side.

# %% [markdown] tags=["solution"]
# With `np.roll` a robot at the left edge would be sent to explore the unknown at the right edge:

# %% active="ipynb" tags=["solution"]
# def rolled(state):
#     unknown = state == 0
#     beside = [np.roll(unknown, step, axis) for step in (1, -1) for axis in (0, 1)]
#     return np.any(beside, axis=0) & (state == 1)
#
# check_frontier(rolled)

# %% [markdown] tags=["statement"]
# ## Exercise 6: the way to the frontier, and a tour
#
# Now assemble an explorer. It drives from its cell to the nearest frontier cell, looks round, and
# asks again, until no frontier can be reached. Nearest is meant on foot: up, down, left and
# right, through free cells only.
#
# The check tries your search on many maps; every shortest way is right. Then it lets it explore a
# flat of four rooms and a corridor, with a robot that sees two cells far: all of the floor must
# be seen within 250 moves.


# %% tags=["exercise"]
def way_to_frontier(state: Ints, cell: Ints) -> Any:
    """A shortest way to the nearest frontier cell.

    Parameters
    ----------
    state : ndarray of int, shape (rows, columns)
        0 unknown, 1 free, 2 occupied.
    cell : ndarray of int, shape (2,)
        Row and column of the robot; the cell is free.

    Returns
    -------
    ndarray of int, shape (k, 2)
        All cells of the way, from the robot's to the frontier cell, both included;
        one cell if the robot stands on the frontier, none if no frontier cell can be
        reached.
    """
    edge = frontier(state)
    start = tuple(cell)
    before, queue = {start: None}, [start]
    for here in queue:
        if edge[here]:
            way = [here]
            while before[way[-1]] is not None:
                way.append(before[way[-1]])
            return np.array(way[::-1])
        for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            there = here[0] + step[0], here[1] + step[1]
            on_map = 0 <= there[0] < state.shape[0] and 0 <= there[1] < state.shape[1]
            if on_map and state[there] == 1 and there not in before:
                before[there] = here
                queue.append(there)
    return np.zeros((0, 2), dtype=int)


# %% active="ipynb" tags=["try"]
# way_to_frontier(np.array([[1, 1, 0], [2, 1, 1]]), np.array([0, 0]))

# %% [markdown] tags=["hint"]
# A list of cells to visit, the robot's first. Take the next one from its front, put its free
# neighbours that are not yet known at its end. The first frontier cell that you take is a nearest
# one: cells come in the order of their distance.

# %% [markdown] tags=["hint"]
# A dictionary `before` tells for each cell from which one it was found, and is the list of known
# cells too. From the frontier cell it leads back to the robot; turn that list round.

# %% [markdown] tags=["hint"]
# `state[row, column]` with a row of -1 is the last row. Test that a neighbour lies on the map
# before you look at it.


# %% tags=["cases"]
def _fault(way: Any, state: Ints, cell: Ints) -> str:
    """Say what is wrong with a way; nothing if it is one of the shortest."""
    try:
        cells = np.array(way, dtype=float)
    except (TypeError, ValueError):
        return "expected the cells of the way, an array of shape (k, 2)"
    due = len(way_to_frontier(state, cell))
    if cells.size == 0:
        return "" if due == 0 else f"got nothing: there is a way of {due} cells"
    if cells.ndim != 2 or cells.shape[1] != 2 or (cells != np.rint(cells)).any():
        return f"expected rows and columns, shape (k, 2), got shape {cells.shape}"
    cells = cells.astype(int)
    inside = ((cells >= 0) & (cells < state.shape)).all()
    if not inside or (state[tuple(cells.T)] != 1).any():
        return "the way leads through a cell that is not free, or off the map"
    if (cells[0] != cell).any():
        return "the way must begin at the robot's cell"
    if (np.abs(np.diff(cells, axis=0)).sum(1) != 1).any():
        return "the way jumps: it steps to the cell above, below, left or right"
    if not frontier(state)[tuple(cells[-1])]:
        return "the way does not end at a frontier cell"
    return "" if len(cells) == due else f"expected a way of {due} cells, got one of {len(cells)}"


def _toured(way: Function, world: Ints, cell: Ints) -> str:
    """Explore a world whose cells are seen from two cells away; say what is wrong."""
    known, moves = np.zeros_like(world), 0
    for _ in range(200):
        low, high = np.maximum(cell - 2, 0), cell + 3
        known[low[0] : high[0], low[1] : high[1]] = world[low[0] : high[0], low[1] : high[1]]
        cells = way(known.copy(), cell.copy())
        wrong = _fault(cells, known, cell)
        if wrong:
            return f"after {moves} moves: {wrong}"
        if len(cells) == 0:
            seen = np.mean(known[world == 1] == 1)
            due = f"expected all of the floor seen in 250 moves, got {seen:.0%} in {moves}"
            return "" if seen == 1 and moves <= 250 else due
        cell, moves = np.array(cells[-1], dtype=int), moves + len(cells) - 1
    return "after 200 ways it is still exploring"


def _explored(way: Function, state: Ints, cell: Ints) -> Any:
    """Judge one way, or a whole tour through the world state[0]."""
    if state.ndim == 3:
        return _toured(way, state[0], cell)
    return _fault(way(state, cell), state, cell)


def _two_rooms() -> Ints:
    """Return a flat of four rooms, a corridor and a block of wall that one can drive round."""
    flat = np.ones((17, 24), dtype=int)
    flat[[0, -1]], flat[:, [0, -1]] = 2, 2
    flat[6], flat[10] = 2, 2
    flat[6, 5] = flat[10, 18] = flat[6, 20] = 1
    flat[1:6, 11] = 2
    flat[11:16, 8] = 2
    flat[13, 8] = 1
    flat[2:5, 15:18] = 2
    return flat[None]


def _a_place(rng: np.random.Generator) -> Any:
    state = rng.choice([0, 1, 1, 1, 1, 1, 2, 2], size=rng.integers(4, 12, 2))
    cell = rng.integers(state.shape)
    state[tuple(cell)] = 1
    return state, cell


def _big(rng: np.random.Generator) -> Any:
    state = np.where(rng.random((14, 17)) < 0.25, 2, 1)
    corner = rng.integers(0, 3, 2)
    state[tuple(corner)] = 1
    state[9:, 12:] = 0
    return state, corner


def _way_drawn(ax: Any, function: Any) -> None:
    """Draw the tour through a flat of a robot that sees two cells far; unseen floor is grey."""
    from slamlab import plots

    world, cell = _two_rooms()[0], np.array([3, 3])
    known, path = np.zeros_like(world), [cell]
    while len(path) < 400:
        low, high = np.maximum(cell - 2, 0), cell + 3
        known[low[0] : high[0], low[1] : high[1]] = world[low[0] : high[0], low[1] : high[1]]
        way = np.asarray(function(known.copy(), cell.copy())).astype(int).reshape(-1, 2)
        if len(way) < 2:
            break
        cell = way[-1]
        path.extend(way[1:])
    _state_drawn(ax, known)
    plots.path(ax, np.array(path)[:, ::-1])
    ax.plot(3, 3, "o", color=plots.COLOURS["estimate"])


check_way = Check(
    way_to_frontier,
    "way",
    {
        "the robot stands on the frontier": ([[1, 0], [1, 1]], [0, 0]),
        "a corridor": ([[2, 2, 2, 2], [1, 1, 1, 0], [2, 2, 2, 2]], [1, 0]),
        "round a corner": ([[1, 1, 1], [1, 2, 1], [1, 2, 0]], [2, 0]),
        "near through the wall, far on foot": (
            [[1, 2, 0, 0], [1, 2, 1, 1], [1, 2, 2, 1], [1, 1, 1, 1]],
            [1, 0],
        ),
        "everything is seen": (np.ones((3, 3), dtype=int), [1, 1]),
        "a frontier that cannot be reached": ([[1, 1, 2, 1, 0]], [0, 0]),
        "any map": _a_place,
        "a larger map": _big,
        "a tour of a flat": (_two_rooms(), [3, 3]),
    },
    use=_explored,
    picture=_way_drawn,
)


# %% tags=["mistakes"]
def _from(measure: Function) -> Function:
    """Return a search that goes to another frontier cell than the nearest by steps."""

    def wrong(state: Ints, cell: Ints) -> Any:
        edges = np.argwhere(frontier(state))
        if not len(edges):
            return np.zeros((0, 2), dtype=int)
        goal = edges[int(np.argmin(measure(edges, cell)))]
        only = np.where(state == 0, 2, state)
        ways = _ways(only, cell)
        return ways.get(tuple(goal.tolist()), np.zeros((0, 2), dtype=int))

    return wrong


def _ways(state: Ints, cell: Ints) -> dict[Any, Any]:
    """Return shortest ways to all cells that can be reached."""
    start = tuple(cell.tolist())
    ways, queue = {start: [start]}, [start]
    for here in queue:
        for step in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            there = (here[0] + step[0], here[1] + step[1])
            inside = min(there) >= 0 and there[0] < len(state) and there[1] < len(state[0])
            if inside and state[there] == 1 and there not in ways:
                ways[there] = [*ways[here], there]
                queue.append(there)
    return ways


check_way.mistakes = {
    "the frontier cell nearest as the crow flies is not the nearest on foot": _from(
        lambda edges, cell: np.hypot(*(edges - cell).T)
    ),
    "the farthest frontier cell was returned: expected the nearest": _from(
        lambda edges, cell: -np.hypot(*(edges - cell).T)
    ),
    "the first frontier cell of the map was returned: expected the nearest": _from(
        lambda edges, cell: np.arange(len(edges))
    ),
    "the way leads through unknown cells: free ones only": (
        ("on_map and state[there] == 1 and => on_map and state[there] != 2 and"),
        ("if edge[here]: => if state[here] == 0:"),
    ),
    "the way begins at the frontier: it must begin at the robot": "way[::-1] => way",
    "the robot's own cell is missing: the way begins there": (
        "way[::-1]) => way[::-1][1:]).reshape(-1, 2)"
    ),
    "this goes deep first: the first way found is not the shortest": (
        "for here in queue: => while queue:\n        here = queue.pop()"
    ),
    "it walks through walls": ("on_map and state[there] == 1 and => on_map and"),
}

# %% [markdown] tags=["solution"]
# ## Solution 6: the way to the frontier, and a tour
#
# A search in rings: all cells one step away, then all two steps away. What to notice: the list
# grows at its end while the loop walks along it, so nothing is sorted, and the first frontier
# cell met is a nearest one.

# %% [markdown] tags=["solution"]
# A stack in place of the queue finds *a* way, too. It goes as far as it can
# before it turns, so the first frontier cell it meets may be anywhere:

# %% active="ipynb" tags=["solution"]
# def deep(state, cell):
#     edge, start = frontier(state), tuple(cell)
#     before, stack = {start: None}, [start]
#     while stack:
#         here = stack.pop()
#         if edge[here]:
#             way = [here]
#             while before[way[-1]] is not None:
#                 way.append(before[way[-1]])
#             return np.array(way[::-1])
#         for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
#             there = here[0] + step[0], here[1] + step[1]
#             on_map = 0 <= there[0] < state.shape[0] and 0 <= there[1] < state.shape[1]
#             if on_map and state[there] == 1 and there not in before:
#                 before[there] = here
#                 stack.append(there)
#     return np.zeros((0, 2), dtype=int)
#
# check_way(deep)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 18](../solutions/18_exploration.ipynb).
