"""Exercises of 14: a Jacobian, a weight, a slope with a bug, a bound, an ICP of one's own."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_pose, drawn
from slamlab.exercises._report import Array, Check, Function

__all__ = [
    "check_block_bound",
    "check_icp",
    "check_line_jacobian",
    "check_slope",
    "check_weight",
]


# %% [markdown] tags=["chapter"]
# # Exercises 14: scan matching and Hector
#
# Five functions on the way from two drawings of a wall to a robot that knows where it is; the
# chapter is [Scan matching, Hector, and a map from a raw
# log](../14_scan_matching_and_hector.ipynb). Replace each `...` and run the check below it as
# often as you like.

# %% [markdown] tags=["solution"]
# # Solutions 14: scan matching and Hector
#
# The exercises are in [Exercises 14](../exercises/14_scan_matching_and_hector.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: the lever arm, with a pencil
#
# Derive it on paper first: how does the distance of a point across a wall change when the scan is
# shifted a little, and when it is turned a little?


# %% tags=["exercise"]
def line_jacobian(pose: Array, point: Array, normal: Array) -> Array:
    """Derivative of the error of point to line by the pose.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x, y, heading (m, m, rad).
    point : ndarray, shape (2,)
        A point of the scan in the frame of the robot (m).
    normal : ndarray, shape (2,)
        Unit vector across the wall, in the world.

    Returns
    -------
    ndarray, shape (3,)
        Derivative of n . (R(heading) point + (x, y) - q) by x, y and heading.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = c * point[0] - s * point[1], s * point[0] + c * point[1]
    return np.array([normal[0], normal[1], normal[1] * x - normal[0] * y])


# %% active="ipynb" tags=["try"]
# line_jacobian(np.array([1.0, 2.0, 0.0]), np.array([3.0, 0.5]), np.array([0.0, 1.0]))

# %% [markdown] tags=["hint"]
# Where does a point two metres ahead of you go when you turn to the left by a hundredth of a
# radian?

# %% [markdown] tags=["hint"]
# With `x, y` the turned point, the derivative of the turned point by the heading is `(-y, x)`.
# What is its part along the normal?


# %% tags=["cases"]
def _unit(rng: np.random.Generator) -> Array:
    angle = np.round(rng.uniform(-3, 3), 2)
    return np.array([np.cos(angle), np.sin(angle)])


def _jacobian_drawn(ax: Any, function: Any) -> None:
    """Draw the error over shifts in x and y and a turn, and the tangents that the row promises."""
    from slamlab import plots

    pose, s, n = np.array([1.0, 2.0, 0.9]), np.array([3.0, 0.5]), np.array([0.6, 0.8])
    J, step = np.asarray(function(pose, s, n), float), np.linspace(-0.5, 0.5, 41)
    for k, name in ((0, "shift in x (m)"), (1, "shift in y (m)"), (2, "turn (rad)")):
        c, d = np.cos(pose[2] + (k == 2) * step), np.sin(pose[2] + (k == 2) * step)
        e = n[0] * (c * s[0] - d * s[1]) + n[1] * (d * s[0] + c * s[1])
        e = e - e[20] + (n[k] * step if k < 2 else 0.0)
        ax.plot(step, e, color=plots.COLOURS["truth"], lw=1)
        ax.plot(step, J[k] * step, "--", color=plots.COLOURS["estimate"])
        ax.text(0.5, e[-1], name, ha="right", va="bottom")
    ax.set(xlabel="change of the pose", ylabel="error across the wall (m)")


check_line_jacobian = Check(
    line_jacobian,
    "row",
    {
        "no turn, a wall to the left": ([1.0, 2.0, 0.0], [3.0, 0.5], [0.0, 1.0]),
        "half a turn": ([1.0, 2.0, np.pi], [3.0, 0.5], [0.6, 0.8]),
        "any pose, any wall": lambda rng: (a_pose(rng), rng.normal(size=2), _unit(rng)),
    },
    picture=_jacobian_drawn,
)

# %% tags=["mistakes"]
check_line_jacobian.mistakes = {
    "the lever is not turned: the scan has turned by psi": lambda p, s, n: np.array(
        [*n, n[1] * s[0] - n[0] * s[1]]
    ),
    "the lever has the wrong sign: a left turn moves a point ahead to the left": (
        "normal[1] * x - normal[0] * y => normal[0] * y - normal[1] * x"
    ),
    "the lever lies along the point: the derivative of R turns it by a quarter": (
        "normal[1] * x - normal[0] * y => normal[0] * x + normal[1] * y"
    ),
    "the lever is missing: a turn moves every point": "normal[1] * x - normal[0] * y => 0.0",
    "the scan was turned backwards": "np.sin(pose[2]) => -np.sin(pose[2])",
    "the entries are in the wrong order: x, y, heading": lambda p, s, n: line_jacobian(p, s, n)[
        [2, 0, 1]
    ],
    "the lever begins at the robot: p falls out of the derivative": (
        "normal[1] * x - normal[0] * y => normal[1] * (x + pose[0]) - normal[0] * (y + pose[1])"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: the lever arm, with a pencil
#
# Shifted by $dx$, the point moves by $dx$, and across the wall by $n_x\,dx$: the first two
# entries are the normal itself. Turned by $d\psi$, the point $R\mathbf s = (x, y)$ moves by $(-y,
# x)\,d\psi$, and across the wall by $(n_y x - n_x y)\,d\psi$.

# %% [markdown] tags=["solution"]
# Without turning the point you have a Jacobian that is right at heading zero, the pose of many
# a first test:

# %% active="ipynb" tags=["solution"]
# def not_turned(pose, point, normal):
#     return np.array([*normal, normal[1] * point[0] - normal[0] * point[1]])
#
# check_line_jacobian(not_turned)

# %% [markdown] tags=["statement"]
# ## Exercise 2: how much a pair counts
#
# A pair far apart is probably no pair. Geman and McClure's weight is $\big(k^2 / (k^2 +
# e^2)\big)^2$ with the width $k$.


# %% tags=["exercise"]
def weight(error: Array, width: float) -> Array:
    """Weight of pairs in the least squares.

    Parameters
    ----------
    error : ndarray, shape (n,)
        Errors of the pairs (m), of either sign.
    width : float
        The error (m) whose weight is a quarter.

    Returns
    -------
    ndarray, shape (n,)
        Between 0 and 1.
    """
    return (width**2 / (width**2 + error**2)) ** 2


# %% active="ipynb" tags=["try"]
# weight(np.array([0.0, 0.05, 0.5]), 0.05)


# %% tags=["cases"]
def _weight_drawn(ax: Any, function: Any) -> None:
    """Draw the weight over the error, for two widths."""
    from slamlab import plots

    e = np.linspace(-1.0, 1.0, 81)
    for width in (0.1, 0.4):
        ax.plot(e, function(e, width), color=plots.COLOURS["estimate"])
        ax.text(width, 0.27, f" k = {width} m")
    ax.set(xlabel="error of a pair (m)", ylabel="weight")


check_weight = Check(
    weight,
    "weight",
    {
        "no error counts whole": ([0.0], 0.05),
        "an error of one width": ([0.05, -0.05], 0.05),
        "any errors": lambda rng: (
            np.round(rng.normal(size=6), 3),
            np.round(rng.uniform(0.02, 2), 2),
        ),
    },
    picture=_weight_drawn,
)

# %% tags=["mistakes"]
check_weight.mistakes = {
    "this is Gauss' bell with its half: it forgets far pairs altogether": (
        lambda e, w: np.exp(-0.5 * (e / w) ** 2)
    ),
    "metres were added to square metres (KISS-ICP's released weight): square the error": (
        lambda e, w: w**2 / (w + e**2) ** 2
    ),
    "the whole fraction is squared": lambda e, w: w**2 / (w**2 + e**2),
    "this is Gauss' bell: it forgets far pairs altogether": (lambda e, w: np.exp(-((e / w) ** 2))),
    "this is Huber's weight": lambda e, w: w / np.maximum(w, np.abs(e)),
    "this is one minus the weight": lambda e, w: 1 - weight(e, w),
    "the error is not squared": lambda e, w: (w**2 / (w**2 + np.abs(e))) ** 2,
}

# %% [markdown] tags=["solution"]
# ## Solution 2: how much a pair counts

# %% [markdown] tags=["statement"]
# <details><summary>Hint</summary>
#
# Check the units: what may be added to square metres? A released program adds metres there: its
# weights change with the unit of length.
#
# </details>
#
# ## Exercise 3: a bug to find
#
# This function should give the slope of a field between the centres of its cells, (5) and (6) of
# the chapter. It has the mistake of Hector's released program. Compare
# it with finite differences, then mend it.


# %% tags=["exercise"]
def slope(cells: Array, x: float, y: float) -> Array:
    """Slope of a field of square cells with side 1.

    Parameters
    ----------
    cells : ndarray, shape (rows, columns)
        Values at the centres of the cells; row 0 at the bottom.
    x, y : float
        A place at least half a cell inside the grid.

    Returns
    -------
    ndarray, shape (2,)
        Derivatives by x and by y.
    """
    column, row = int(np.floor(x - 0.5)), int(np.floor(y - 0.5))
    a, b = x - 0.5 - column, y - 0.5 - row
    low, high = cells[row], cells[row + 1]
    left, right = column, column + 1
    dx = (1 - b) * (low[right] - low[left]) + b * (high[right] - high[left])
    dy = (1 - a) * (high[left] - low[left]) + a * (high[right] - low[right])
    return np.array([dx, dy])


# %% active="ipynb" tags=["stub"]
#     column, row = int(np.floor(x - 0.5)), int(np.floor(y - 0.5))
#     a, b = x - 0.5 - column, y - 0.5 - row
#     low, high = cells[row], cells[row + 1]
#     left, right = column, column + 1
#     dx = (1 - a) * (low[right] - low[left]) + a * (high[right] - high[left])
#     dy = (1 - b) * (high[left] - low[left]) + b * (high[right] - low[right])
#     return np.array([dx, dy])

# %% active="ipynb" tags=["try"]
# slope(np.arange(12.0).reshape(3, 4), 1.7, 1.2)


# %% tags=["cases"]
def _cells(rng: np.random.Generator) -> Any:
    return np.round(rng.random((6, 8)), 2), *np.round(rng.uniform([0.6, 0.6], [7.4, 5.4]), 2)


def _slope_drawn(ax: Any, function: Any) -> None:
    """Draw a field, and its slopes as strokes from dots."""
    from slamlab import plots

    cells = np.round(np.random.default_rng(1).random((4, 5)), 2)
    ax.imshow(cells, origin="lower", extent=(0, 5, 0, 4), cmap="Greys", vmin=-1, vmax=2)
    for x in np.arange(0.75, 4.5, 0.5):
        for y in np.arange(0.75, 3.5, 0.5):
            dx, dy = function(cells, x, y)
            ax.plot([x, x + 0.5 * dx], [y, y + 0.5 * dy], color=plots.COLOURS["estimate"], lw=1.5)
            ax.plot(x, y, ".", ms=3, color=plots.COLOURS["truth"])
    ax.set(xlabel="x (cells)", ylabel="y (cells)")


check_slope = Check(
    slope,
    "slope",
    {
        "a ramp in x": (np.tile(np.arange(5.0), (4, 1)), 1.7, 2.2),
        "a ramp in y": (np.tile(np.arange(4.0)[:, None], (1, 5)), 2.3, 1.6),
        "any cells, any place": _cells,
    },
    draws=12,
    picture=_slope_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
_SWAPPED = "a, b = x - 0.5 - column, y - 0.5 - row => b, a = x - 0.5 - column, y - 0.5 - row"


check_slope.mistakes = {
    "a weighs the slope in y and b that in x: here they have changed places": _SWAPPED,
    "values belong to the centres of cells: half a cell is missing": lambda c, x, y: slope(
        np.pad(c, 1, mode="edge"), x + 1.5, y + 1.5
    ),
    "x and y were exchanged: cells[row, column], row from y": lambda c, x, y: (
        slope(c.T, *np.minimum([y, x], [len(c) - 0.6, len(c[0]) - 0.6]))
        if 0.5 <= y <= len(c[0]) - 0.5 and 0.5 <= x <= len(c) - 0.5
        else np.zeros(2)
    ),
    "the two slopes are in the wrong order: x first": lambda c, x, y: slope(c, x, y)[::-1],
    "this slope is downhill: right minus left, upper minus lower": lambda c, x, y: -slope(c, x, y),
    "the fractions count from the other side: at a = 0 the left column counts": (
        "a, b = x - 0.5 - column, y - 0.5 - row"
        " => a, b = 1 - (x - 0.5 - column), 1 - (y - 0.5 - row)"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a bug to find
#
# Each slope is a mean of two differences: that of x is taken along the lower and along the upper
# pair of cells, and *b* says how high the place lies between the pairs. Along a ramp both weights
# give the same, which is why ramps are poor tests.

# %% [markdown] tags=["statement"]
# <details><summary>Hint</summary>
#
# The slope in x is taken once along the lower pair of cells and once along the upper pair. Which
# of the two numbers a, b says how far up the place lies between them?
#
# </details>
#
# ## Exercise 4: what a block can promise
#
# Branch and bound leaves a block of shifts unopened if its promise is too small. What can the
# square block of cells that begins in each cell promise at most?


# %% tags=["exercise"]
def block_bound(cells: Array, width: int) -> Array:
    """Bound for blocks of cells.

    Parameters
    ----------
    cells : ndarray, shape (rows, columns)
        Values, not negative.
    width : int
        Cells a side of a block.

    Returns
    -------
    ndarray, shape (rows, columns)
        Entry [r, c] belongs to the block of the rows r to r + width - 1 and the columns
        c to c + width - 1; what lies beyond the grid does not count.
    """
    rows, columns = cells.shape
    out = np.zeros((rows, columns))
    for r in range(rows):
        for c in range(columns):
            out[r, c] = cells[r : r + width, c : c + width].max()
    return out


# %% active="ipynb" tags=["try"]
# block_bound(np.array([[0.1, 0.9, 0.2], [0.3, 0.4, 0.5]]), 2)


# %% tags=["cases"]
def _grid(rng: np.random.Generator) -> Any:
    shape = rng.integers(2, 8, 2)
    return np.round(rng.random(shape), 2), int(rng.integers(1, 5))


def _bound_drawn(ax: Any, function: Any) -> None:
    """Draw the bounds of blocks of two by two cells; small figures are the cells' own values."""
    cells = np.round(np.random.default_rng(2).random((4, 5)), 1)
    bounds = np.asarray(function(cells, 2), float)
    ax.imshow(bounds, origin="lower", cmap="Blues", vmin=0, vmax=1.5)
    for (row, column), bound in np.ndenumerate(bounds):
        ax.text(column, row, f"{bound:.1f}", ha="center", va="bottom", fontsize=11)
        ax.text(column, row, f"{cells[row, column]:.1f}", ha="center", va="top", fontsize=8)
    ax.set(xlabel="column", ylabel="row")


check_block_bound = Check(
    block_bound,
    "bound",
    {
        "one cell promises itself": (np.arange(6.0).reshape(2, 3) / 6, 1),
        "two by two": ([[0.1, 0.9, 0.2], [0.3, 0.4, 0.5], [0.8, 0.0, 0.6]], 2),
        "a block may hang over the edge": ([[0.2, 0.7], [0.5, 0.1]], 4),
        "any cells, any width": _grid,
    },
    draws=10,
    picture=_bound_drawn,
)

# %% tags=["mistakes"]
check_block_bound.mistakes = {
    "a mean is no bound: one good cell may still win": "max() => mean()",
    "a sum promises more than any shift can score: take the best": "max() => sum()",
    "this is the worst of the block: the best is what it can promise": "max() => min()",
    "the block begins in its cell: this one ends there": lambda m, w: block_bound(
        m[::-1, ::-1], w
    )[::-1, ::-1],
    "the block has one cell too many on each side": (
        "cells[r : r + width, c : c + width] => cells[r : r + width + 1, c : c + width + 1]"
    ),
    "the block has one cell too few on each side": (
        "cells[r : r + width, c : c + width]"
        " => cells[r : r + max(width - 1, 1), c : c + max(width - 1, 1)]"
    ),
    "the block is square: it reaches across columns as well": "c : c + width => c : c + 1",
}

# %% [markdown] tags=["solution"]
# ## Solution 4: what a block can promise

# %% [markdown] tags=["solution"]
# The mean is what a shrunken picture of the map has. It looks reasonable, but the search may then
# throw away the best pose without a word:

# %% active="ipynb" tags=["solution"]
# def mean_of_blocks(cells, width):
#     rows, columns = cells.shape
#     blocks = [[cells[r : r + width, c : c + width].mean() for c in range(columns)]
#               for r in range(rows)]
#     return np.array(blocks)
#
# check_block_bound(mean_of_blocks)

# %% [markdown] tags=["statement"]
# <details><summary>Hint</summary>
#
# A slice such as `cells[r:r + width]` simply ends at the edge.
#
# </details>
#
# ## Exercise 5: assemble your ICP
#
# A robot stands in a room of 5 m by 4 m with a pillar. It knows points on the walls and the
# normals there, and a guess that is off by some centimetres and degrees. Bring its scan home. Two
# points of the scan are on people who walk by far away.


# %% tags=["exercise"]
def icp(reference: Array, normals: Array, points: Array, guess: Array) -> Array:
    """Lay a scan upon walls.

    Parameters
    ----------
    reference : ndarray, shape (m, 2)
        Points on the walls (m).
    normals : ndarray, shape (m, 2)
        Unit vectors across the wall at these points.
    points : ndarray, shape (k, 2)
        The scan in the frame of the robot (m).
    guess : ndarray, shape (3,)
        Where to begin (m, m, rad).

    Returns
    -------
    ndarray, shape (3,)
        Where the scan was taken, to 2.5 mm and 0.0025 rad.
    """
    pose = guess.copy()
    for _ in range(30):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        moved = points @ np.array([[c, s], [-s, c]]) + pose[:2]
        gaps = np.linalg.norm(moved[:, None] - reference, axis=-1)
        j = gaps.argmin(axis=1)
        near = gaps.min(axis=1) < 0.6
        n, arm = normals[j][near], (moved - pose[:2])[near]
        e = ((moved - reference[j])[near] * n).sum(axis=1)
        J = np.column_stack([n, n[:, 1] * arm[:, 0] - n[:, 0] * arm[:, 1]])
        pose = pose + np.linalg.lstsq(J, -e, rcond=None)[0]
    return pose


# %% active="ipynb" tags=["try"]
# reference = np.array([[1.0, 0.0], [0.0, 1.0], [2.0, 2.0]])
# icp(reference, np.eye(3, 2), np.zeros((2, 2)), np.zeros(3))

# %% [markdown] tags=["hint"]
# Five lines in a loop: move the points, find the nearest reference point of each, keep the pairs
# that are near, write down errors and Jacobians, take the step.

# %% [markdown] tags=["hint"]
# `np.linalg.norm(moved[:, None] - reference, axis=-1)` has all distances; `argmin(axis=1)` the
# partners.

# %% [markdown] tags=["hint"]
# `J = np.column_stack([n, n[:, 1] * arm[:, 0] - n[:, 0] * arm[:, 1]])` with `arm = moved -
# pose[:2]`; the step is `np.linalg.lstsq(J, -e, rcond=None)[0]`.


# %% tags=["cases"]
def _room(step: float = 0.1) -> tuple[Array, Array]:
    """Points on the walls of a room of 5 m x 4 m with a pillar, and their normals."""
    points, normals = [], []
    sides: list[tuple[float, ...]] = [(0, 0, 5, 0), (5, 0, 5, 4), (5, 4, 0, 4), (0, 4, 0, 0)]
    sides += [(3, 1, 3.6, 1.4), (3.6, 1.4, 3.2, 2.0), (3.2, 2.0, 2.6, 1.6), (2.6, 1.6, 3, 1)]
    for x0, y0, x1, y1 in sides:
        length = np.hypot(x1 - x0, y1 - y0)
        t = np.arange(step / 2, length - 0.02, step)[:, None] / length
        points.append(np.array([x0, y0]) + t * np.array([x1 - x0, y1 - y0]))
        normals.append(np.tile([y0 - y1, x1 - x0], (len(t), 1)) / length)
    return np.concatenate(points), np.concatenate(normals)


def _scan_of_the_room(pose: Array, rng: np.random.Generator) -> Array:
    """Other points of the same walls, in the frame of a robot; two are on passers-by."""
    walls, normals = _room()
    along = np.column_stack([normals[:, 1], -normals[:, 0]])
    seen = walls + along * rng.uniform(-0.03, 0.03, (len(walls), 1))
    c, s = np.cos(pose[2]), np.sin(pose[2])
    own = (seen - pose[:2]) @ np.array([[c, -s], [s, c]])
    return np.concatenate([own, [[30.0, 30.0], [-30.0, 4.0]]])


@drawn
def _task(rng: np.random.Generator, true: Array, off: Array, step: float = 0.1) -> Any:
    pose = np.asarray(true) + rng.uniform(-0.1, 0.1, 3)
    return *_room(step), _scan_of_the_room(pose, rng), pose + np.asarray(off), pose


def _gap(
    icp: Function, reference: Array, normals: Array, points: Array, guess: Array, pose: Array
) -> Any:
    """How far from its place the scan ended (m, m, rad)."""
    gap = np.asarray(icp(reference, normals, points, guess), dtype=float) - pose
    gap[2] = np.angle(np.exp(1j * gap[2]))
    return gap


def _icp_drawn(ax: Any, function: Any) -> None:
    """Draw the room, and the scan where the function places it."""
    from slamlab import plots

    true = np.array([1.2, 1.5, -2.0])
    scan = _scan_of_the_room(true, np.random.default_rng(3))
    x, y, heading = function(*_room(), scan, true + [0.12, 0.1, 0.1])
    c, s = np.cos(heading), np.sin(heading)
    ax.plot(*_room()[0].T, ".", ms=2, color=plots.COLOURS["wall"])
    placed = scan[:-2] @ np.array([[c, s], [-s, c]]) + [x, y]
    ax.plot(*placed.T, "x", ms=4, color=plots.COLOURS["estimate"])
    ax.set(xlabel="x (m)", ylabel="y (m)", xlim=(-0.5, 5.5), ylim=(-0.5, 4.5))
    ax.set_aspect("equal", adjustable="box")


check_icp = Check(
    icp,
    "how far from its place the scan ended (m; m; rad)",
    {
        "a scan that already lies well": _task(np.array([1.5, 2.0, 0.4]), np.zeros(3)),
        "shifted by 20 cm": _task(np.array([1.5, 2.0, 0.4]), np.array([0.15, -0.13, 0.0]), 0.08),
        "turned by 6 degrees": _task(np.array([1.2, 1.5, -2.0]), np.array([0.0, 0.0, 0.1]), 0.12),
        "both, and on the other side of the pillar": _task(
            np.array([4.3, 3.0, 2.8]), np.array([-0.12, 0.1, -0.07])
        ),
    },
    tolerance=2.5e-3,
    draws=3,
    use=_gap,
    picture=_icp_drawn,
)

# %% tags=["mistakes"]
check_icp.mistakes = {
    "it ran away: the step goes against the error": "-e => e",
    "two points on passers-by outweigh the walls: keep near pairs only": (
        "gaps.min(axis=1) < 0.6 => gaps.min(axis=1) < 1e9"
    ),
    "this is point to point: a partner is another spot of the wall, use only its normal": (
        "((moved - reference[j])[near] * n).sum(axis=1) => (moved - reference[j])[near].T.ravel()",
        "J = np.column_stack([n, n[:, 1] * arm[:, 0] - n[:, 0] * arm[:, 1]])"
        " => J = np.concatenate([np.c_[[np.eye(2)[k]] * len(n), (2 * k - 1) * arm[:, 1 - k]]"
        " for k in (0, 1)])",
    ),
    "one round is not enough: the pairs were guesses, find them anew": ("range(30) => range(1)"),
    "the heading never changes: its column of J is missing": (
        "n[:, 1] * arm[:, 0] - n[:, 0] * arm[:, 1] => 0 * n[:, 0]"
    ),
    "it began at zero: begin at the guess": "guess.copy() => np.zeros(3)",
    "the scan was turned backwards": "[[c, s], [-s, c]] => [[c, -s], [s, c]]",
}

# %% [markdown] tags=["solution"]
# ## Solution 5: assemble your ICP

# %% [markdown] tags=["solution"]
# Try it without the lever's second half, or with `moved` for `arm`: the check passes. Where every
# error is zero every step is zero too, whatever the Jacobian, and these two still lead there, in
# more rounds. Not every wrong one does: without the lever the heading stays as it was. And without
# the line that keeps near pairs only, two points on passers-by outweigh two hundred on walls:

# %% active="ipynb" tags=["solution"]
# def everybody_counts(reference, normals, points, guess):
#     pose = guess.copy()
#     for _ in range(30):
#         c, s = np.cos(pose[2]), np.sin(pose[2])
#         moved = points @ np.array([[c, s], [-s, c]]) + pose[:2]
#         j = np.linalg.norm(moved[:, None] - reference, axis=-1).argmin(axis=1)
#         n, arm = normals[j], moved - pose[:2]
#         e = ((moved - reference[j]) * n).sum(axis=1)
#         J = np.column_stack([n, n[:, 1] * arm[:, 0] - n[:, 0] * arm[:, 1]])
#         pose = pose + np.linalg.lstsq(J, -e, rcond=None)[0]
#     return pose
#
# report = check_icp(everybody_counts)     # it wanders off, and its digits mean nothing
# print(f"{report.held} of {report.total} properties hold")

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 14](../solutions/14_scan_matching_and_hector.ipynb).
