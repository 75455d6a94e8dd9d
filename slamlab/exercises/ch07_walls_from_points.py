"""Exercises, chapter 07: a line, a corner, a covariance; walls from a scan and in the world.

P1 names "least squares" and "distances" and prints no formula; the chapter derives them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, drawn
from slamlab.exercises._report import Array, Check
from slamlab.geometry import wrap_angle

__all__ = ["check_corner", "check_line", "check_to_world", "check_wall_cov", "check_walls"]


# %% [markdown] tags=["chapter"]
# # Exercises 07: walls from points
#
# Five exercises that turn a scan into walls: three functions, a wall on its way into the map with
# two bugs, and split-and-merge assembled; the chapter is [Walls from
# points](../07_walls_from_points.ipynb). Replace each `...` and run the check below it as often
# as you like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 07: walls from points
#
# The exercises are in [Exercises 07](../exercises/07_walls_from_points.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
#
# from slamlab.evaluation import chi2_band
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: a line that does not know which axis is x


# %% tags=["private"]
def _named(normal: Array, centre: Array) -> tuple[float, float]:
    """R >= 0 and alpha in (-pi, pi] of the line through `centre` with this normal."""
    r = float(normal @ centre)
    if r < 0:
        r, normal = -r, -normal
    return r, float(np.arctan2(normal[1], normal[0]))


# %% tags=["exercise"]
def line(points: Array) -> tuple[float, float]:
    """Fit a line by total least squares.

    Parameters
    ----------
    points : ndarray, shape (k, 2)
        Points of one wall (m), at least two.

    Returns
    -------
    tuple of float
        r (m, not negative) and alpha (rad, from -pi to pi) of the line
        x cos(alpha) + y sin(alpha) = r.
    """
    centre = points.mean(0)
    normal = np.linalg.svd(points - centre)[2][1]
    r = normal @ centre
    if r < 0:
        r, normal = -r, -normal
    return r, np.arctan2(normal[1], normal[0])


# %% active="ipynb" tags=["try"]
# line(np.array([[2.0, -1.0], [2.0, 0.0], [2.0, 1.0]]))        # the wall x = 2

# %% [markdown] tags=["hint"]
# The line goes through the centre of the points. What is left is its direction.

# %% [markdown] tags=["hint"]
# The normal is the direction in which the centred points spread least: the last row of
# `np.linalg.svd(points - points.mean(0))[2]`.

# %% [markdown] tags=["hint"]
# r = normal · centre. If it is negative, turn the normal round; then alpha by `np.arctan2`.


# %% tags=["cases"]
@drawn
def _wall(rng: np.random.Generator, r: float, alpha: float, k: int = 7) -> Any:
    normal = np.array([np.cos(alpha), np.sin(alpha)])
    along = rng.uniform(-1, 1.5, (k, 1)) * [-normal[1], normal[0]]
    return (np.round((r + rng.normal(0, 0.03, (k, 1))) * normal + along, 3),)


def _line_drawn(ax: Any, function: Any) -> None:
    """Draw the points of four walls round the robot and the lines that are fitted to them."""
    from slamlab import plots

    rng = np.random.default_rng(1)
    for r, alpha in ((2.0, 0.02), (2.5, 1.4), (1.5, -3.1), (2.0, -1.2)):
        normal = np.array([np.cos(alpha), np.sin(alpha)])
        t = np.linspace(-1.2, 1.2, 15)[:, None]
        points = r * normal + t * [-normal[1], normal[0]] + rng.normal(0, 0.05, (15, 2))
        plots.lidar_points(ax, points, s=4)
        fitted_r, fitted = (float(one) for one in function(points))
        c, s = np.cos(fitted), np.sin(fitted)
        plots.path(ax, fitted_r * np.array([c, s]) + 1.4 * np.array([[s, -c], [-s, c]]))
    ax.plot(0, 0, "o", color=plots.COLOURS["truth"])
    plots.floor(ax)


check_line = Check(
    line,
    "r, alpha",
    {
        "a slanting wall": _wall(2.0, 0.7),
        "a wall parallel to the y axis": _wall(3.0, 0.0),
        "a wall parallel to the x axis": _wall(3.0, np.pi / 2),
        "a wall on the other side of the robot": _wall(1.5, -2.4),
        "a wall behind": _wall(2.5, 3.0),
        "a wall close by": _wall(0.2, -0.9, 30),
        "two points": lambda rng: (np.round(rng.uniform(-5, 5, (2, 2)), 2),),
    },
    tolerance=1e-8,
    picture=_line_drawn,
)


# %% tags=["mistakes"]
def _ordinary(points: Array) -> tuple[float, float]:
    a, b = np.polyfit(points[:, 0], points[:, 1], 1)
    return _named(np.array([-a, 1.0]) / np.hypot(a, 1.0), np.array([0.0, b]))


def _not_renamed(points: Array) -> tuple[float, float]:
    centre = points.mean(0)
    normal = np.linalg.svd(points - centre)[2][1]
    return float(normal @ centre), float(np.arctan2(normal[1], normal[0]))


def _from_the_chord(points: Array) -> tuple[float, float]:
    u = points[-1] - points[0]
    return _named(np.array([-u[1], u[0]]) / np.hypot(*u), points.mean(0))


def _through_the_first(points: Array) -> tuple[float, float]:
    u = points[-1] - points[0]
    return _named(np.array([-u[1], u[0]]) / np.hypot(*u), points[0])


check_line.mistakes = {
    "this is y = a x + b: it measures distances along y, so it knows which axis is x": (_ordinary),
    "this is x = a y + b: it measures distances along x, so it knows which axis is x": (
        lambda p: (_ordinary(p[:, ::-1])[0], np.pi / 2 - _ordinary(p[:, ::-1])[1])
    ),
    "this is the direction along the wall: the normal is the one with the smaller spread": (
        "[2][1] => [2][0]"
    ),
    "subtract the centre of the points before looking for their spread": (
        "points - centre => points"
    ),
    "r is negative: turn the normal by half a turn and the sign of r with it": _not_renamed,
    "r lost its sign, but alpha was not turned by half a turn: that is another wall": (
        lambda p: (abs(_not_renamed(p)[0]), _not_renamed(p)[1])
    ),
    "the first and the last point decide alone: all points have a say": _from_the_chord,
    "this is the line through the first and the last point: all points have a say": (
        _through_the_first
    ),
    "alpha is in degrees: expected radians": lambda p: (line(p)[0], np.rad2deg(line(p)[1])),
    "alpha is in [0, 2 pi): expected -pi to pi": (
        lambda p: (line(p)[0], line(p)[1] % (2 * np.pi))
    ),
    "r and alpha are exchanged: r comes first": lambda p: line(p)[::-1],
}

# %% [markdown] tags=["solution"]
# ## Solution 1: a line that does not know which axis is x
#
# The singular vectors of the centred points are the directions of largest and least spread. The
# second one is the normal. Of its two signs the right one makes r positive.

# %% [markdown] tags=["solution"]
# The school's fit passes where the points lie on a line exactly, as two points do. With noise it
# errs, least where the wall runs along x, and for the wall x = 2 it has no slope to give:

# %% active="ipynb" tags=["solution"]
# def by_slope(points):
#     a, b = np.polyfit(points[:, 0], points[:, 1], 1)
#     r, alpha = b / np.hypot(a, 1), np.arctan2(1, -a)
#     return (r, alpha) if r >= 0 else (-r, alpha - np.pi if alpha > 0 else alpha + np.pi)
#
# check_line(by_slope)

# %% [markdown] tags=["statement"]
# ## Exercise 2: where does it bend?
#
# Split-and-merge cuts a bent stretch of points at the one that lies farthest from the chord
# between its two ends.


# %% tags=["exercise"]
def corner(points: Array) -> int:
    """Find the point where a stretch of a scan should be cut.

    Parameters
    ----------
    points : ndarray, shape (k, 2)
        In scan order (m), at least three; the ends do not coincide.

    Returns
    -------
    int
        Index of the point farthest from the chord.
    """
    u = points[-1] - points[0]
    d = points - points[0]
    return int(np.argmax(np.abs(u[0] * d[:, 1] - u[1] * d[:, 0])))


# %% active="ipynb" tags=["try"]
# corner(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]))

# %% [markdown] tags=["hint"]
# The area of the parallelogram that the chord spans with the vector to a point is base times
# height.

# %% [markdown] tags=["hint"]
# `u[0] * d[:, 1] - u[1] * d[:, 0]` with `u` the chord and `d` the points seen from the first one.
# Mind its sign.


# %% tags=["cases"]
def _stretch(rng: np.random.Generator) -> Any:
    k = int(rng.integers(3, 15))
    return (np.round(np.cumsum(rng.normal(0.2, 0.8, (k, 2)), 0) + rng.uniform(-20, 20, 2), 2),)


_BEND = np.array([[0, 0], [1, 0.02], [2, -0.01], [2.02, 1], [1.99, 2], [2, 3], [2, 4.0]])


def _corner_drawn(ax: Any, function: Any) -> None:
    """Draw two bent stretches, their chords, and each cut in two at the point that is found."""
    from slamlab import plots

    rng = np.random.default_rng(2)
    short = np.vstack([np.linspace([0, 0], [1.6, 0.4], 8), np.linspace([1.7, 0.6], [1, 3], 14)])
    long = np.vstack([np.linspace([3, 3], [2.6, 1.2], 10), np.linspace([2.8, 1], [5, 0.4], 12)])
    for points in (short, long):
        points = points + rng.normal(0, 0.03, points.shape)
        cut = int(function(points))
        plots.lidar_points(ax, points, s=4)
        plots.path(ax, points[[0, -1]], "truth")
        plots.path(ax, points[[0, cut, -1]])
        ax.plot(*points[cut], "o", color=plots.COLOURS["estimate"], markersize=8, mfc="none")
    plots.floor(ax)


check_corner = Check(
    corner,
    "index",
    {
        "a corner to the right of the chord": (_BEND,),
        "the same corner to its left": (_BEND[:, ::-1],),
        "a short leg and a long one": ([[0, 0], [0.5, 0.0], [0.5, 0.5], [0.5, 1], [0.5, 4]],),
        "far from the origin, the other way round": (_BEND[::-1] + [30.0, -40.0],),
        "three points": ([[0, 0], [1, 2], [3, 0]],),
        "a chord along y": ([[1, 0], [1.5, 1], [0.2, 2], [1, 3]],),
        "a point beyond the end of the chord": ([[0, 0], [-3, 0.5], [1, 1], [2, 0]],),
        "any stretch": _stretch,
    },
    draws=12,
    picture=_corner_drawn,
)


# %% tags=["mistakes"]
def _from_fit(points: Array) -> int:
    r, alpha = line(points)
    return int(np.argmax(np.abs(points @ [np.cos(alpha), np.sin(alpha)] - r)))


def _sharpest(points: Array) -> int:
    legs = np.diff(points, axis=0)
    angles = np.arctan2(legs[:, 1], legs[:, 0])
    return 1 + int(np.argmax(np.abs((np.diff(angles) + np.pi) % (2 * np.pi) - np.pi)))


def _off(points: Array) -> Array:
    u, d = points[-1] - points[0], points - points[0]
    off: Array = np.abs(u[0] * d[:, 1] - u[1] * d[:, 0]) / np.hypot(*u)
    return off


def _from_segment(points: Array) -> int:
    chord = points[-1] - points[0]
    s = np.clip((points - points[0]) @ chord / (chord @ chord), 0.0, 1.0)
    return int(np.argmax(np.hypot(*(points - points[0] - s[:, None] * chord).T)))


check_corner.mistakes = {
    "the distance from the segment was taken: its line goes on beyond both ends": _from_segment,
    "the distance has a sign: a corner on the other side of the chord was overlooked": (
        "np.abs( => ("
    ),
    "this is the distance from the fitted line, largest at an end: cut by the chord": (_from_fit),
    "this is the distance from the first point: measure it from the chord": (
        lambda p: int(np.argmax(np.hypot(*(p - p[0]).T)))
    ),
    "this is the sharpest turn: expected the farthest from the chord": _sharpest,
    "this is the middle of the stretch": lambda p: len(p) // 2,
    "this is the point farthest from the middle of the points": (
        lambda p: int(np.argmax(np.hypot(*(p - p.mean(0)).T)))
    ),
    "the distance was taken along y: measure it across the chord": (
        "u[0] * d[:, 1] - u[1] * d[:, 0] => d[:, 1] - u[1] * np.arange(len(d)) / (len(d) - 1)"
    ),
    "this is the distance itself: expected the index of the point": lambda p: _off(p).max(),
    "off by one: the first point has index 0": lambda p: corner(p) + 1,
    "this point lies nearest to the chord: expected the farthest": (
        lambda p: 1 + int(np.argmin(_off(p)[1:-1]))
    ),
    "counted among the inner points: the first point of the stretch has index 0": (
        lambda p: corner(p) - 1
    ),
    "this is the point itself: expected its index": lambda p: p[corner(p)],
}

# %% [markdown] tags=["solution"]
# ## Solution 2: where does it bend?
#
# All points share the base, so the area ranks them as the height does; no division is needed.

# %% [markdown] tags=["solution"]
# Without the absolute value the corners on one side of the chord are never found. In a room seen
# from inside the corners of the boxes bulge one way and those of the room the other:

# %% active="ipynb" tags=["solution"]
# def one_sided(points):
#     u = points[-1] - points[0]
#     d = points - points[0]
#     return int(np.argmax(u[0] * d[:, 1] - u[1] * d[:, 0]))
#
# check_corner(one_sided)

# %% [markdown] tags=["solution"]
# A distance along y, by the way, gives the same answer for a chord that is not upright: it is the
# distance across, divided by one cosine for all points.

# %% [markdown] tags=["statement"]
# ## Exercise 3: how sure is a wall?
#
# The errors $e_i$ of the points across the wall are independent with variances $w_i$. The wall
# errs by
#
# $$
# \delta\alpha = -\frac1S \sum_i (t_i - \bar t)\,e_i, \qquad
# \delta r = \frac1k \sum_i e_i + \bar t\,\delta\alpha, \qquad S = \sum_i (t_i - \bar t)^2 .
# $$


# %% tags=["exercise"]
def wall_cov(along: Array, variances: Array) -> Array:
    """Covariance of a fitted wall.

    Parameters
    ----------
    along : ndarray, shape (k,)
        Places t of the points along the wall (m), from the foot of the perpendicular.
    variances : ndarray, shape (k,)
        Variance of each point across the wall (m^2).

    Returns
    -------
    ndarray, shape (2, 2)
        Covariance of (r, alpha).
    """
    t, middle = along, along.mean()
    row_alpha = -(t - middle) / np.sum((t - middle) ** 2)
    row_r = 1 / len(t) + middle * row_alpha
    J = np.stack([row_r, row_alpha])
    return (J * variances) @ J.T


# %% active="ipynb" tags=["try"]
# wall_cov(np.array([1.0, 2.0, 3.0]), np.full(3, 0.02**2))

# %% [markdown] tags=["hint"]
# Both errors are sums of the e's with known coefficients. What is the covariance of J e?

# %% [markdown] tags=["hint"]
# `J` has two rows: the coefficients of the e's in δr, and in δα. The covariance is `J @
# np.diag(variances) @ J.T`.

# %% [markdown] tags=["hint"]
# Row of alpha: `-(t - t.mean()) / S`; row of r: `1 / k + t.mean() * row_of_alpha`.


# %% tags=["cases"]
def _points(rng: np.random.Generator) -> Any:
    k = int(rng.integers(2, 12))
    return np.round(rng.uniform(-3, 3, k) + rng.uniform(-4, 4), 2), np.round(rng.random(k), 3)


def _wall_cov_drawn(ax: Any, function: Any) -> None:
    """Draw the errors of 1000 walls fitted to twelve points, and the ellipse of the covariance."""
    from slamlab import plots

    rng, along = np.random.default_rng(3), np.linspace(0.5, 2.5, 12)
    variances = np.linspace(0.01, 0.06, 12) ** 2
    fits = []
    for errors in rng.standard_normal((1000, 12)) * np.sqrt(variances):
        slope, at_foot = np.polyfit(along, errors, 1)
        fits.append([at_foot, -slope])
    units = np.diag([100.0, np.degrees(1)])
    plots.lidar_points(ax, np.array(fits) @ units, s=1.6)
    plots.ellipse(ax, [0, 0], units @ np.asarray(function(along, variances), float) @ units)
    ax.set(xlabel="error of r (cm)", ylabel="error of alpha (°)")


check_wall_cov = Check(
    wall_cov,
    "cov",
    {
        "points around the perpendicular": (np.linspace(-1, 1, 5), [0.04] * 5),
        "points to one side of it": (np.linspace(1, 3, 9), [0.04] * 9),
        "to the other side": ([-5.0, -4.0, -2.5], [0.1, 0.3, 0.2]),
        "points without error": ([1.0, 2.0, 4.0], [0.0, 0.0, 0.0]),
        "unequal points": _points,
    },
    picture=_wall_cov_drawn,
)

# %% tags=["mistakes"]
check_wall_cov.mistakes = {
    "the turn moves r with the wrong sign": "middle * row_alpha => -middle * row_alpha",
    "r and alpha err together: the corner elements are not zero": (
        lambda t, w: wall_cov(t, w) * np.eye(2)
    ),
    "the correlation has the wrong sign: a point beyond the middle turns the normal back": (
        lambda t, w: wall_cov(t, w) * [[1, -1], [-1, 1]]
    ),
    "measure the places from their mean: the wall turns about the middle of its points": (
        "along, along.mean() => along, 0.0"
    ),
    "r is the distance at the foot of the perpendicular: the turn moves it too, by mean(t)": (
        " + middle * row_alpha =>  + 0.0 * row_alpha"
    ),
    "each point has a variance of its own: weigh by it before summing": (
        "J * variances => J * variances.mean()"
    ),
    "these look like standard deviations: the variances were given, do not square them": (
        "J * variances => J * variances**2"
    ),
    "the roots of the variances were used: expected the variances themselves": (
        "J * variances => J * np.sqrt(variances)"
    ),
    "this does not shrink with more points: the average of k errors has 1/k of it": (
        lambda t, w: wall_cov(t, w) * len(t)
    ),
    "the variances are not used: each error counts with its own": "J * variances => J",
    "alpha comes second: rows and columns are r, alpha": (
        "[row_r, row_alpha] => [row_alpha, row_r]"
    ),
    "S is a sum of squares, not their mean": "np.sum((t - middle) ** 2) => t.var()",
}

# %% [markdown] tags=["solution"]
# ## Solution 3: how sure is a wall?

# %% [markdown] tags=["solution"]
# It is tempting to keep the two variances only. Their sizes are right, and a filter that uses
# them takes r and α to err independently. Of a wall seen far to one side they err together: what
# is well known is where the wall passes its seen part, and that is lost:

# %% active="ipynb" tags=["solution"]
# def variances_only(along, variances):
#     return wall_cov(along, variances) * np.eye(2)
#
# check_wall_cov(variances_only)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a bug to find
#
# A robot sees the wall $(r, \alpha)$ and wants it in its map. With the heading added, $\alpha_w =
# \alpha + \theta$, and the robot's place along the normal, $r_w = r + x\cos\alpha_w +
# y\sin\alpha_w$. Pose and wall err independently, with covariances $P$ and $C$.
# Whoever errs about the direction of a wall that is named from far away errs about its distance
# too, by the **lever** $\partial r_w / \partial\alpha_w = y\cos\alpha_w - x\sin\alpha_w$.
#
# Near the origin this program is right. In a large building its walls claim too much. Run the
# check, find the two bugs, repair them.


# %% tags=["exercise"]
def to_world(pose: Array, P: Array, wall: Array, C: Array) -> tuple[Array, Array]:
    """Wall in the world, and how sure it is.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x (m), y (m), heading (rad) of the robot.
    P : ndarray, shape (3, 3)
        Covariance of the pose.
    wall : ndarray, shape (2,)
        r (m) and alpha (rad) as seen from the robot.
    C : ndarray, shape (2, 2)
        Covariance of (r, alpha) as seen; it is independent of the pose's error.

    Returns
    -------
    wall : ndarray, shape (2,)
        r (m, not negative) and alpha (rad, in (-pi, pi]) in the world.
    cov : ndarray, shape (2, 2)
    """
    r, alpha = wall[0], wall[1] + pose[2]
    c, s = np.cos(alpha), np.sin(alpha)
    r, lever = r + pose[0] * c + pose[1] * s, pose[1] * c - pose[0] * s
    J_pose = np.array([[c, s, lever], [0.0, 0.0, 1.0]])
    J_wall = np.array([[1.0, lever], [0.0, 1.0]])
    cov = J_pose @ P @ J_pose.T + J_wall @ C @ J_wall.T
    if r < 0:
        r, alpha = -r, alpha + np.pi
        cov = cov * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return np.array([r, wrap_angle(alpha)]), cov


# %% active="ipynb" tags=["stub"]
#     r, alpha = wall[0], wall[1] + pose[2]
#     c, s = np.cos(alpha), np.sin(alpha)
#     r, lever = r + pose[0] * c + pose[1] * s, pose[1] * c - pose[0] * s
#     J_pose = np.array([[c, s, lever], [0.0, 0.0, 1.0]])
#     cov = J_pose @ P @ J_pose.T + C
#     if r < 0:
#         r, alpha = -r, alpha + np.pi
#     return np.array([r, wrap_angle(alpha)]), cov

# %% active="ipynb" tags=["try"]
# wall = np.array([2.0, 0.5])
# to_world(np.zeros(3), 0.1 * np.eye(3), wall, 0.01 * np.eye(2))[1].round(3)

# %% [markdown] tags=["hint"]
# Which property holds? What is special about the lever there?

# %% [markdown] tags=["hint"]
# $r_w$ depends on the pose in three ways and on the wall in two. How many columns has the
# derivative by the wall, and what stands in them?

# %% [markdown] tags=["hint"]
# A wall whose $r$ has turned its sign: what has become of the error of $r$, and what of the error
# of $\alpha$? What of their mean product?


# %% tags=["cases"]
@drawn
def _sighting(
    rng: np.random.Generator, doubt: float = 1.0, haze: float = 1.0, home: bool = False
) -> Any:
    pose = a_pose(rng, 0.0 if home else 4.0)
    wall = [float(np.round(rng.uniform(0.5, 5), 2)), float(np.round(rng.uniform(-3, 3), 2))]
    return pose, doubt * a_covariance(rng, 3, 0.05), wall, haze * a_covariance(rng, 2, 0.02)


def _beyond(rng: np.random.Generator) -> Any:
    """Draw a wall that stands between the robot and the origin, which gives it its other name."""
    pose = np.append(np.round(rng.uniform(3, 5, 2), 2), 0.3)
    wall = [float(np.round(rng.uniform(0.5, 2), 2)), float(np.round(rng.uniform(-2.6, -2.2), 2))]
    return pose, a_covariance(rng, 3, 0.05), wall, a_covariance(rng, 2, 0.02)


def _to_world_drawn(ax: Any, function: Any) -> None:
    """Draw a wall as 1000 uncertain robots place it in the world, and the ellipse of yours."""
    from slamlab import plots

    rng, pose, wall = np.random.default_rng(4), np.array([3.0, 2.0, 0.7]), np.array([2.0, 0.4])
    P, C = np.diag([0.05, 0.05, 0.02]) ** 2, np.diag([0.02, 0.03]) ** 2
    robots, seen = rng.multivariate_normal(pose, P, 1000), rng.multivariate_normal(wall, C, 1000)
    alpha = robots[:, 2] + seen[:, 1]
    r = seen[:, 0] + robots[:, 0] * np.cos(alpha) + robots[:, 1] * np.sin(alpha)
    degrees = np.diag([1.0, np.degrees(1)])
    plots.lidar_points(ax, np.column_stack([r, alpha]) @ degrees, s=1.6)
    mean, cov = function(pose, P, wall, C)
    plots.ellipse(ax, degrees @ mean, degrees @ np.asarray(cov, float) @ degrees)
    ax.set(xlabel="r in the world (m)", ylabel="alpha in the world (°)")


check_to_world = Check(
    to_world,
    "wall, cov",
    {
        "a robot at the origin": _sighting(home=True),
        "a robot that knows where it is": _sighting(doubt=0.0),
        "a wall seen without error": _sighting(haze=0.0),
        "a wall between the robot and the origin": _beyond,
        "any pose, any wall": _sighting(),
    },
    tolerance=1e-6,
    picture=_to_world_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_to_world.mistakes = {
    "C needs its lever: who errs about alpha from far away errs about r": (
        "J_wall @ C @ J_wall.T => C"
    ),
    "the wall has its other name, its covariance has not: r turned its sign, alpha did not": (
        "cov * np.array([[1.0, -1.0], [-1.0, 1.0]]) => cov"
    ),
    "r is negative: the same wall is (-r, alpha + pi)": "if r < 0: => if False:",
    "r was made positive, alpha was not turned by half a turn": ("-r, alpha + np.pi => -r, alpha"),
    "alpha is not wrapped to (-pi, pi]": "wrap_angle(alpha) => alpha",
    "the heading is missing: alpha was seen from the robot": "wall[1] + pose[2] => wall[1]",
    "the heading was taken off: alpha in the world is larger by it": (
        "wall[1] + pose[2] => wall[1] - pose[2]"
    ),
    "the place of the robot was taken off: it is added along the normal": (
        "r + pose[0] * c + pose[1] * s => r - pose[0] * c - pose[1] * s"
    ),
    "r did not change: from the origin the wall is nearer or farther": (
        "r + pose[0] * c + pose[1] * s => r"
    ),
    "the uncertainty of the pose is missing": "J_pose @ P @ J_pose.T +  => ",
    "the wall's own uncertainty is missing": " + J_wall @ C @ J_wall.T => ",
    "the lever is missing in the pose's part: a turn of the robot swings the wall": (
        "[c, s, lever] => [c, s, 0.0]"
    ),
    "the lever has the wrong sign: it is the derivative of r by alpha": (
        "pose[1] * c - pose[0] * s => pose[0] * s - pose[1] * c"
    ),
    "the uncertainty of the heading does not reach alpha": "[0.0, 0.0, 1.0]] => [0.0] * 3]",
}

# %% [markdown] tags=["solution"]
# ## Solution 4: a bug to find
#
# The first bug: $C$ was added as it is. The wall's own error of $\alpha$ swings it about the
# *robot*, but $r_w$ is measured from the origin, so the lever stands in the derivative by the
# wall as well. The second: with its other name the wall has $-r$, and the error of $r$ changes
# its sign with it; the error of $\alpha$ does not. Their mean product, the corner element, turns
# its sign.

# %% [markdown] tags=["solution"]
# With the first bug repaired and the second left, every variance is right. Only the sign of one
# number is wrong, and only for walls with the origin on their other side:

# %% active="ipynb" tags=["solution"]
# def old_covariance(pose, P, wall, C):
#     (r, alpha), cov = to_world(pose, P, wall, C)
#     seen = pose[:2] @ [np.cos(alpha), np.sin(alpha)]
#     return np.array([r, alpha]), cov * [[1, -1], [-1, 1]] if seen > r else cov
#
# check_to_world(old_covariance)

# %% [markdown] tags=["statement"]
# ## Exercise 5: the walls of a scan
#
# Assemble split-and-merge without the merging. Fit a line to all points. If no point lies farther
# from it than the threshold, it is a wall: its covariance follows from the places of the points
# along $(-\sin\alpha, \cos\alpha)$. If one does, cut at the corner, which begins the second
# piece, and ask the same of both pieces. A piece with too few points is no wall.
# Use your three functions.


# %% tags=["exercise"]
def walls(points: Array, variance: float, threshold: float, fewest: int) -> tuple[Array, Array]:
    """Walls in a stretch of a scan.

    Parameters
    ----------
    points : ndarray, shape (k, 2)
        In scan order (m); they may be too few for any wall.
    variance : float
        Variance of each point, in every direction (m^2).
    threshold : float
        Largest distance of a point from its wall (m).
    fewest : int
        Fewer points than this make no wall; at least 3.

    Returns
    -------
    walls : ndarray, shape (n, 2)
        r and alpha, in the order of their points.
    covs : ndarray, shape (n, 2, 2)
    """
    if len(points) < fewest:
        return np.zeros((0, 2)), np.zeros((0, 2, 2))
    r, alpha = line(points)
    c, s = np.cos(alpha), np.sin(alpha)
    normal, along = np.array([c, s]), np.array([-s, c])
    if np.abs(points @ normal - r).max() <= threshold:
        cov = wall_cov(points @ along, np.full(len(points), variance))
        return np.array([[r, alpha]]), cov[None]
    cut = corner(points)
    first = walls(points[:cut], variance, threshold, fewest)
    second = walls(points[cut:], variance, threshold, fewest)
    return np.vstack([first[0], second[0]]), np.concatenate([first[1], second[1]])


# %% active="ipynb" tags=["try"]
# walls(np.array([[2.0, -1.0], [2.0, 0.0], [2.0, 1.0]]), 1e-4, 0.05, 3)

# %% [markdown] tags=["hint"]
# A function may call itself, with fewer points. What ends it? There are two cases.

# %% [markdown] tags=["hint"]
# The distances of all points from the line: `points @ normal - r`, with a sign that does not
# matter.

# %% [markdown] tags=["hint"]
# For no wall return arrays of the shapes (0, 2) and (0, 2, 2): they can be stacked with others.


# %% tags=["cases"]
@drawn
def _outline(rng: np.random.Generator, *sizes: int, fewest: int = 4) -> Any:
    """Draw a scan along walls with so many points each, and how to cut it."""
    heading, corner, stretches = rng.uniform(-3, 3), rng.uniform(-3, 3, 2), []
    for size in sizes:
        d = np.array([np.cos(heading), np.sin(heading)])
        stretches.append(corner + 0.2 * np.arange(size)[:, None] * d)
        corner = stretches[-1][-1] + 0.2 * d
        heading += rng.choice([-1, 1]) * rng.uniform(1.0, 1.6)
    points = np.vstack(stretches) + rng.normal(0, 0.01, (sum(sizes), 2))
    variance = float(np.round(rng.uniform(1e-4, 1e-2), 5))
    return np.round(points, 4), variance, float(np.round(rng.uniform(0.04, 0.06), 3)), fewest


_ANGLE = np.array([[0, 1], [1, 1], [2, 1], [3, 1], [4, 1.0], [4, 2], [4, 3], [4, 4], [4, 5]])


def _walls_drawn(ax: Any, function: Any) -> None:
    """Draw the points of a scan and the walls that are found in them."""
    from slamlab import plots
    from slamlab.sensors import Lidar
    from slamlab.worlds import WallWorld

    room = [(-2, -1.5), (2, -1.5), (2, 0.8), (3.2, 1.4), (2.2, 3.2), (-1, 3.2), (-2, 2.2)]
    lidar = Lidar(160, sigma_range=0.01)
    world, rng = WallWorld.from_polygons(room), np.random.default_rng(5)
    points = lidar.points(lidar.scan(world, np.array([0, 0, 0.3]), rng))
    plots.lidar_points(ax, points, s=3)
    for r, alpha in np.asarray(function(points, 1e-4, 0.05, 6)[0], float):
        normal, along = np.array([np.cos(alpha), np.sin(alpha)]), [-np.sin(alpha), np.cos(alpha)]
        near = np.flatnonzero(np.abs(points @ normal - r) < 0.05)
        runs = np.split(near, np.flatnonzero(np.diff(near) > 2) + 1)
        t = points[max(runs, key=len)] @ along if len(near) else np.array([-1.0, 1.0])
        plots.path(ax, r * normal + np.outer([t.min(), t.max()], along))
    ax.plot(0, 0, "o", color=plots.COLOURS["truth"])
    plots.floor(ax)


check_walls = Check(
    walls,
    "walls, covs",
    {
        "one wall": _outline(9),
        "two walls": _outline(9, 11, fewest=3),
        "four walls": _outline(8, 12, 7, 9, fewest=5),
        "a wall that bulges, farther from its chord than from its line": (
            np.column_stack([np.linspace(-1, 1, 9), 2.06 - 0.06 * np.linspace(-1, 1, 9) ** 2]),
            0.01,
            0.05,
            4,
        ),
        "one point of a wall bulges towards the robot": (
            [[x, 2.0 - 0.15 * (x == 0)] for x in np.arange(-2, 2.1, 0.5)],
            0.01,
            0.1,
            4,
        ),
        "a short piece between two walls is none": _outline(9, 2, 10),
        "a wall of exactly as many points as it needs": (_ANGLE, 0.01, 0.1, 4),
        "a piece of one point fewer than a wall needs": (
            np.vstack([[-1.0, 1.0], _ANGLE[:-1]]),
            0.01,
            0.1,
            5,
        ),
        "a narrow threshold tells walls apart that meet at a flat angle": (
            [[x, 2.0 + 0.07 * abs(x)] for x in np.arange(-1, 1.01, 0.2)],
            0.01,
            0.02,
            4,
        ),
        "too few points for any wall": ([[0.0, 1.0], [1.0, 1.0], [2.0, 1.0]], 0.01, 0.1, 4),
    },
    tolerance=1e-7,
    draws=8,
    picture=_walls_drawn,
)


# %% tags=["mistakes"]
def _by_the_chord(points: Array, variance: float, threshold: float, fewest: int) -> Any:
    """Ask the chord, not the fitted line, whether all points lie on one wall."""
    if len(points) >= max(fewest, 3) and _off(points).max() > threshold:
        cut = corner(points)
        parts = [_by_the_chord(p, variance, threshold, fewest) for p in np.split(points, [cut])]
        return np.vstack([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
    return walls(points, variance, np.inf, fewest)


def _cut_once(points: Array, variance: float, threshold: float, fewest: int) -> Any:
    if len(walls(points, variance, threshold, fewest)[0]) < 2:
        return walls(points, variance, threshold, fewest)
    parts = [walls(p, variance, np.inf, fewest) for p in np.split(points, [corner(points)])]
    return np.vstack([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


check_walls.mistakes = {
    "nothing was cut: one line goes through all points": (".max() <= threshold => .max() >= 0"),
    "cut once only: ask the same of both pieces": _cut_once,
    "the chord decided: expected the distance from the fitted line": _by_the_chord,
    "the mean distance decided: no point may lie farther off than the threshold": (
        ".max() <= threshold => .mean() <= threshold"
    ),
    "the distance has a sign: points on the other side were overlooked": (
        "np.abs(points @ normal - r) => (points @ normal - r)"
    ),
    "a piece with fewer than `fewest` points is no wall": (
        "len(points) < fewest => len(points) < 2"
    ),
    "a piece with exactly `fewest` points is a wall": (
        "len(points) < fewest => len(points) <= fewest"
    ),
    "the corner was given to both pieces: it begins the second": (
        "points[:cut] => points[: cut + 1]"
    ),
    "the corner was given to the first piece: it begins the second": (
        "points[:cut] => points[: cut + 1]",
        "points[cut:] => points[cut + 1 :]",
    ),
    "only the first pieces were returned: the second ones hold walls too": (
        "np.vstack([first[0], second[0]]), np.concatenate([first[1], second[1]]) => first"
    ),
    "the walls are in the order of the last: the first points make the first wall": (
        "[first[0], second[0]]), np.concatenate([first[1], second[1]])"
        " => [second[0], first[0]]), np.concatenate([second[1], first[1]])"
    ),
    "places along the wall grow along (-sin, cos): the corner elements have the wrong sign": (
        "np.array([-s, c]) => np.array([s, -c])"
    ),
    "places along the wall were counted from the middle: count from the foot": (
        "wall_cov(points @ along, => wall_cov((points - points.mean(axis=0)) @ along,"
    ),
    "places along the wall were counted from its first point: count from the foot": (
        "wall_cov(points @ along, => wall_cov((points - points[0]) @ along,"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: the walls of a scan
#
# Two cases end it: too few points, or one wall. What to notice: the corner is found by the chord,
# the decision is made by the fitted line. The chord hangs on two points and their noise, the line
# on all of them.

# %% [markdown] tags=["solution"]
# Who cuts once and stops has two walls where four are:

# %% active="ipynb" tags=["solution"]
# def one_cut(points, variance, threshold, fewest):
#     cut = corner(points)
#     halves = points[:cut], points[cut:]
#     parts = [walls(half, variance, np.inf, fewest) for half in halves]
#     return np.vstack([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
#
# check_walls(one_cut)

# %% [markdown] tags=["solution"]
# Now a room whose truth is known: 4 m by 6 m, seen from inside by 120 beams, every point off by 1
# cm in x and in y, two hundred times over. Four walls are expected; the first beam falls onto the
# middle of one, so five pieces. The threshold is yours to tune: too small, and noise cuts walls
# to pieces; too large, and walls reach round corners. Does the covariance tell the truth about
# what is left? The error of a wall in units of its covariance has the mean 2, the number of its
# entries.

# %% active="ipynb" tags=["solution"]
# TRUE = np.array([[3.0, 0.0], [2.5, np.pi / 2], [3.0, np.pi], [1.5, -np.pi / 2]])
# BEAMS = 2 * np.pi * (np.arange(120) + 0.5) / 120
#
# REACH = TRUE[:, :1] / np.maximum(np.cos(BEAMS - TRUE[:, 1:]), 1e-9)
# WHOSE, RAYS = REACH.argmin(0), np.column_stack([np.cos(BEAMS), np.sin(BEAMS)])
#
# def scan(rng):
#     return REACH.min(0)[:, None] * RAYS + 0.01 * rng.standard_normal((120, 2))
#
# def judge(found, covs):
#     error = found[:, None] - TRUE
#     error[..., 1] = wrap_angle(error[..., 1])
#     squared = np.einsum("nti,nij,ntj->nt", error, np.linalg.inv(covs), error)
#     return squared.min(1)

# %% active="ipynb" tags=["solution"]
# def with_given_corners(points):
#     lines, covs = [], []
#     for mine in WHOSE == np.arange(4)[:, None]:
#         r, alpha = line(points[mine])
#         along = points[mine] @ [-np.sin(alpha), np.cos(alpha)]
#         lines.append([r, alpha])
#         covs.append(wall_cov(along, np.full(len(along), 1e-4)))
#     return np.array(lines), np.array(covs)
#
# def report(name, found):
#     squared = np.concatenate([judge(*f) for f in found])
#     low, high = chi2_band(2, len(squared))
#     print(f"{name:20s} {len(squared) / 200:.1f} walls a scan, "
#           f"mean NEES {squared.mean():.3g}, expected {low:.2f} to {high:.2f}")
#
# scans = [scan(np.random.default_rng(k)) for k in range(200)]
# for sigmas in (2, 3, 5, 20):
#     found = [walls(s, 1e-4, sigmas * 0.01, 5) for s in scans]
#     report(f"threshold {sigmas} sigma", found)
# report("corners given", [with_given_corners(s) for s in scans])

# %% [markdown] tags=["solution"]
# With thresholds of 3 and 5 σ a scan has little more than its five pieces, and the walls err by
# more than they claim. The last line says why: given which point belongs to which wall, the same
# fit and the same covariance lie within the band. What is missing is the uncertainty of the
# corner, where the noise decides which wall gets a point. At 20 σ about two pieces of a scan carry
# points of their neighbours along, and their covariances know nothing of it.

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 07](../solutions/07_walls_from_points.ipynb).
