"""Exercises, chapter 07: a line, a corner, a covariance; walls from a scan and in the world.

P1 names "least squares" and "distances" and prints no formula; the chapter derives them.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, var-annotated"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, an_angle, drawn
from slamlab.exercises._report import Array, Check
from slamlab.geometry import wrap_angle

__all__ = [
    "check_corner",
    "check_line",
    "check_room_map",
    "check_to_world",
    "check_wall_cov",
    "check_walls",
]


# %% [markdown] tags=["chapter"]
# # Exercises 07: walls from points
#
# Six exercises, most with the lidar of a vacuum cleaner, whose far points are poor: a fit that
# weighs them, a cut in a scan that goes all the way round, what one more point tells,
# a wall on its way into the map with two bugs, the walls of a whole room, and the map of this room
# from two scans, made by your own functions. The chapter is [Walls from
# points](../07_walls_from_points.ipynb). Replace each `...` and run the check below it as often as
# you like; then draw what you built beside what is expected.

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
# from slamlab.evaluation import changed, chi2_band
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: a wall whose far end is blurred
#
# A vacuum cleaner drives along a wall, 80 cm away. Its lidar is a cheap one: it triangulates, and
# its noise grows with the *square* of the range, 5 mm at one metre and 8 cm at four. The far end
# of the wall is a cloud. In the lesson's fit each point counts alike, so the cloud turns the
# wall, although the near points are good to millimetres.
#
# Let a good point count more. The error of the point $p_i$ has the variance $v_i$, the same in
# every direction. The lesson lets a point err along its beam only, and projects that onto the
# normal of the wall, once the wall is known; here the wall is what you look for. With a round
# error the weight of a point is the same whichever way the wall turns, and one step finds the best
# line. (Where the noise *is* along the beam this costs a little.)
#
# Choose the line $(r, \alpha)$ with the normal $n = (\cos\alpha, \sin\alpha)$ that makes
#
# $$
# \sum_i \frac{(n \cdot p_i - r)^2}{v_i}
# $$
#
# smallest. Of the two names of the line return the one with $r \ge 0$; the lidar, at the origin,
# is on none of the walls.
#
# Once yours is right, `check_line.draw(lambda p, v: line(p, np.ones(len(p))))` draws the lesson's
# fit.


# %% tags=["private"]
def _named(normal: Array, centre: Array) -> tuple[float, float]:
    """R >= 0 and alpha in (-pi, pi] of the line through `centre` with this normal."""
    r = float(normal @ centre)
    if r < 0:
        r, normal = -r, -normal
    return r, float(np.arctan2(normal[1], normal[0]))


# %% tags=["exercise"]
def line(points: Array, variances: Array) -> tuple[float, float]:
    """Fit a line by weighted total least squares.

    Parameters
    ----------
    points : ndarray, shape (k, 2)
        Points of one wall (m), at least two.
    variances : ndarray, shape (k,)
        Variance of each point (m^2), positive and the same in every direction.

    Returns
    -------
    tuple of float
        r (m, not negative) and alpha (rad, from -pi to pi) of the line
        x cos(alpha) + y sin(alpha) = r.
    """
    weights = 1 / variances
    centre = weights @ points / weights.sum()
    x, y = (points - centre).T
    S_xx, S_xy, S_yy = weights @ x**2, weights @ (x * y), weights @ y**2
    alpha = 0.5 * np.arctan2(-2 * S_xy, S_yy - S_xx)
    r = centre @ [np.cos(alpha), np.sin(alpha)]
    if r < 0:
        r, alpha = -r, alpha + np.pi
    return r, np.arctan2(np.sin(alpha), np.cos(alpha))


# %% active="ipynb" tags=["try"]
# points = np.array([[2.0, -1.0], [2.0, 0.0], [2.0, 1.0], [2.6, 2.0]])
# line(points, np.array([0.01, 0.01, 0.01, 1.0]) ** 2)    # x = 2; one poor point

# %% [markdown] tags=["hint"]
# The lesson splits its sum into the spread about a centre and a penalty for missing the centre.
# Divide each square by its $v_i$ and do the same. Which centre makes the mixed term vanish now?

# %% [markdown] tags=["hint"]
# The centre is the weighted mean, with the weights $1 / v_i$. What is left to minimise has the
# lesson's form, and $S_{xx}$, $S_{xy}$, $S_{yy}$ are sums in which each product has its weight.

# %% [markdown] tags=["hint"]
# Then the lesson's $\alpha = \tfrac12\,\mathrm{atan2}(-2 S_{xy}, S_{yy} - S_{xx})$ with the new
# sums, and $r$ is the centre along the normal. If $r$ is negative, the wall has a second name;
# mind the range of $\alpha$.


# %% tags=["cases"]
@drawn
def _wall(rng: np.random.Generator, r: float, alpha: float, k: int = 7, even: bool = False) -> Any:
    normal = np.array([np.cos(alpha), np.sin(alpha)])
    along = rng.uniform(-1, 1.5, (k, 1)) * [-normal[1], normal[0]]
    sigmas = np.full(k, 0.03) if even else np.round(rng.uniform(0.01, 0.1, k), 3)
    off = rng.standard_normal((k, 1)) * sigmas[:, None]
    return np.round((r + off) * normal + along, 3), sigmas**2


def _line_drawn(ax: Any, function: Any) -> None:
    """Draw one scan of a wall whose far end is blurred, and the fits of ten scans."""
    from slamlab import plots

    rng, beams = np.random.default_rng(1), np.deg2rad(np.arange(-30, 80, 2.0))
    exact = 0.8 / np.cos(beams)[:, None] * np.column_stack([np.sin(beams), np.cos(beams)])
    sigmas = 0.005 * (exact**2).sum(1)
    ends, turned = np.array([-0.5, 4.7]), []
    for k in range(200):
        points = exact + sigmas[:, None] * rng.standard_normal(exact.shape)
        r, alpha = (float(one) for one in function(points, sigmas**2))
        turned.append(wrap_angle(alpha - np.pi / 2))
        if k < 10:
            height = (r - ends * np.cos(alpha)) / np.sin(alpha)
            plots.path(ax, np.column_stack([ends, 100 * height]), linewidth=0.8)
        if k == 0:
            plots.lidar_points(ax, points * [1, 100], s=4)
    plots.path(ax, np.column_stack([ends, [80, 80]]), "truth")
    ax.set(xlabel="along the wall (m)", ylabel="distance (cm)", ylim=(60, 100))
    error = np.rad2deg(np.sqrt(np.mean(np.square(turned))))
    ax.set_title(f"200 scans: turned by {error:.2f}°", loc="left")


check_line = Check(
    line,
    "r, alpha",
    {
        "a slanting wall, all points alike": _wall(2.0, 0.7, even=True),
        "a slanting wall": _wall(2.0, 0.7),
        "a wall parallel to the y axis": _wall(3.0, 0.0),
        "a wall parallel to the x axis": _wall(3.0, np.pi / 2),
        "a wall on the other side of the robot": _wall(1.5, -2.4),
        "a wall behind": _wall(2.5, 3.0),
        "a wall close by": _wall(0.2, -0.9, 30),
        "one point far off, and known to be poor": (
            [[2.0, -1.0], [2.0, 0.0], [2.0, 1.0], [2.6, 2.0]],
            [1e-4, 1e-4, 1e-4, 1.0],
        ),
        "two points": lambda rng: (np.round(rng.uniform(-5, 5, (2, 2)), 2), [0.01, 0.04]),
    },
    tolerance=1e-8,
    picture=_line_drawn,
)


# %% tags=["mistakes"]
def _ordinary(points: Array, variances: Array) -> tuple[float, float]:
    a, b = np.polyfit(points[:, 0], points[:, 1], 1, w=1 / np.sqrt(variances))
    return _named(np.array([-a, 1.0]) / np.hypot(a, 1.0), np.array([0.0, b]))


def _through_the_ends(points: Array) -> tuple[float, float]:
    u = points[-1] - points[0]
    return _named(np.array([-u[1], u[0]]) / np.hypot(*u), points[0])


check_line.mistakes = {
    "this is the lesson's fit: here a point of small variance counts more": (
        "weights = 1 / variances => weights = np.ones(len(points))"
    ),
    "the weights are turned over: now the poor points decide": (
        "weights = 1 / variances => weights = variances"
    ),
    "the weights are 1 / v, not its square: these v are variances already": (
        "weights = 1 / variances => weights = 1 / variances**2"
    ),
    "the weights are 1 / v, not 1 / sqrt(v): a square is divided by a variance": (
        "weights = 1 / variances => weights = 1 / np.sqrt(variances)"
    ),
    "the centre is the plain mean: the best line goes through the weighted one": (
        "weights @ points / weights.sum() => points.mean(0)"
    ),
    "the centre is weighted, the sums S are not": (
        "weights @ x**2, weights @ (x * y), weights @ y**2 => x @ x, x @ y, y @ y"
    ),
    "this is y = a x + b: it measures distances along y, so it knows which axis is x": (_ordinary),
    "this is x = a y + b: it measures distances along x, so it knows which axis is x": (
        lambda p, v: (_ordinary(p[:, ::-1], v)[0], np.pi / 2 - _ordinary(p[:, ::-1], v)[1])
    ),
    "this is the direction along the wall: the normal is the one with the smaller spread": (
        "(-2 * S_xy, S_yy - S_xx) => (2 * S_xy, S_xx - S_yy)"
    ),
    "subtract the centre of the points before looking for their spread": (
        "(points - centre).T => points.T"
    ),
    "r is negative: turn the normal by half a turn and the sign of r with it": (
        "r, alpha = -r, alpha + np.pi => pass"
    ),
    "r lost its sign, but alpha was not turned by half a turn: that is another wall": (
        "-r, alpha + np.pi => -r, alpha"
    ),
    "this is the line through the first and the last point: all points have a say": (
        lambda p, v: _through_the_ends(p)
    ),
    "alpha is in degrees: expected radians": (
        lambda p, v: (line(p, v)[0], np.rad2deg(line(p, v)[1]))
    ),
    "alpha is in [0, 2 pi): expected -pi to pi": (
        lambda p, v: (line(p, v)[0], line(p, v)[1] % (2 * np.pi))
    ),
    "r and alpha are exchanged: r comes first": lambda p, v: line(p, v)[::-1],
}

# %% [markdown] tags=["solution"]
# ## Solution 1: a wall whose far end is blurred
#
# With $\bar p$ the weighted mean the sum splits as in the lesson: $\sum_i (n \cdot (p_i - \bar
# p))^2 / v_i + (n\cdot\bar p - r)^2 \sum_i 1/v_i$. The mixed term is $\sum_i n \cdot (p_i - \bar
# p) / v_i$ times a constant, and the weighted mean makes it zero. So the best line goes through
# $\bar p$, and its normal points where the *weighted* spread is least.

# %% [markdown] tags=["solution"]
# What do the weights buy? Two hundred scans of the wall beside the vacuum cleaner, in each of ten
# runs:

# %% active="ipynb" tags=["solution"]
# def turned_by(weighted, rng):
#     beams = np.deg2rad(np.arange(-30, 80, 2.0))
#     rays = np.column_stack([np.sin(beams), np.cos(beams)])
#     exact = 0.8 / np.cos(beams)[:, None] * rays
#     sigmas = 0.005 * (exact**2).sum(1)
#     used = sigmas**2 if weighted else np.ones(len(sigmas))
#     turned = []
#     for _ in range(200):
#         scan = exact + sigmas[:, None] * rng.standard_normal(exact.shape)
#         turned.append(line(scan, used)[1] - np.pi / 2)
#     return np.rad2deg(np.sqrt(np.mean(np.square(turned))))
#
# for name, weighted in (("all points alike", False), ("weighted", True)):
#     runs = [turned_by(weighted, np.random.default_rng(k)) for k in range(10)]
#     print(f"{name:18s} direction off by {min(runs):.2f}° to {max(runs):.2f}°")

# %% [markdown] tags=["solution"]
# The same points, more than three times as good. Now let each point err along its beam only, as in
# the lesson. The best weights then need the direction of the wall: fit once with round errors, and
# once more with the variances projected onto the normal that came out.

# %% active="ipynb" tags=["solution"]
# def along_the_beam(method, rng):
#     beams = np.deg2rad(np.arange(-30, 80, 2.0))
#     rays = np.column_stack([np.sin(beams), np.cos(beams)])
#     sigmas = 0.005 * (0.8 / np.cos(beams)) ** 2
#     turned = []
#     for _ in range(200):
#         ranges = 0.8 / np.cos(beams) + sigmas * rng.standard_normal(len(beams))
#         scan = ranges[:, None] * rays
#         used = np.ones(len(beams)) if method == "all points alike" else sigmas**2
#         alpha = line(scan, used)[1]
#         if method == "fitted twice":
#             across = sigmas * (rays @ [np.cos(alpha), np.sin(alpha)])
#             alpha = line(scan, across**2)[1]
#         turned.append(alpha - np.pi / 2)
#     return np.rad2deg(np.sqrt(np.mean(np.square(turned))))

# %% active="ipynb" tags=["solution"]
# for method in ("all points alike", "round errors", "fitted twice"):
#     runs = [along_the_beam(method, np.random.default_rng(k)) for k in range(10)]
#     print(f"{method:18s} direction off by {min(runs):.3f}° to {max(runs):.3f}°")

# %% [markdown] tags=["solution"]
# At a grazing angle an error along the beam hardly leaves the wall, so all three are good, and
# the round weights lie between the other two.
#
# And the school's fit, $y = ax + b$, with the same weights? For a wall along y it has no slope to
# give:

# %% active="ipynb" tags=["solution"]
# def by_slope(points, variances):
#     a, b = np.polyfit(points[:, 0], points[:, 1], 1, w=1 / np.sqrt(variances))
#     r, alpha = b / np.hypot(a, 1), np.arctan2(1, -a)
#     return (r, alpha) if r >= 0 else (-r, alpha - np.pi if alpha > 0 else alpha + np.pi)
#
# check_line(by_slope)

# %% [markdown] tags=["statement"]
# ## Exercise 2: a scan that goes all the way round
#
# The vacuum cleaner's successor stands in the middle of a room. Its lidar is precise, 3 mm, and
# gives whole centimetres. Split-and-merge begins: no single line fits, so cut at the point
# farthest from the chord. But this scan goes all the way round. Its first and its last point are
# neighbours on one wall, the chord between them is a small part of the wall, and the line through
# it runs along that wall. *All* points of the opposite wall are about equally far from this line,
# and a rounding error decides where it is cut: in about seven of ten scans somewhere in the middle
# of a straight wall.
#
# So let the chord end where the points end: find the point that is farthest from the
# **segment** between the first and the last point. The distance of a point from a segment is its
# distance from the nearest point of it, which may be one of its two ends. Some lidars send the
# first beam once more as the last one. Then both ends coincide, and the segment is a single point.


# %% tags=["exercise"]
def corner(points: Array) -> int:
    """Find the point where a stretch of a scan should be cut.

    Parameters
    ----------
    points : ndarray, shape (k, 2)
        In scan order (m), at least three; not all of them on the segment. The first and
        the last may coincide.

    Returns
    -------
    int
        Index of the point farthest from the segment between the first and the last;
        two equally far are not tried.
    """
    u, d = points[-1] - points[0], points - points[0]
    s = np.clip(d @ u / max(u @ u, 1e-300), 0.0, 1.0)
    off = np.hypot(*(d - s[:, None] * u).T)
    return 1 + int(np.argmax(off[1:-1]))


# %% active="ipynb" tags=["try"]
# corner(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]))

# %% [markdown] tags=["hint"]
# Draw a short segment and three points: one beside it, one before its beginning, one beyond its
# end. To which point of the segment does each of them measure?

# %% [markdown] tags=["hint"]
# A point of the segment is `points[0] + s * u` with the chord `u` and `s` from 0 to 1. Which `s`
# is the foot of the perpendicular from a point? What if that `s` is negative, or above 1?

# %% [markdown] tags=["hint"]
# The foot is at $s = (d \cdot u) / (u \cdot u)$ with $d$ from the first point; `np.clip` keeps it
# on the segment. And if $u \cdot u = 0$, every $s$ names the same point.


# %% tags=["cases"]
def _stretch(rng: np.random.Generator) -> Any:
    k = int(rng.integers(3, 15))
    return (np.round(np.cumsum(rng.normal(0.2, 0.8, (k, 2)), 0) + rng.uniform(-20, 20, 2), 2),)


_BEND = np.array([[0, 0], [1, 0.02], [2, -0.01], [2.02, 1], [1.99, 2], [2, 3], [2, 4.0]])

# Distance and direction of the normals of a rectangular room, 6 m by 4 m, and its corners.
_BOX = np.array([[3.0, 0.0], [2.5, np.pi / 2], [3.0, np.pi], [1.5, -np.pi / 2]])
_BOX_CORNERS = np.array([[3, 2.5], [-3, 2.5], [-3, -1.5], [3, -1.5]])


def _exact_scan(room: Array, n: int) -> tuple[Array, Array]:
    """Ranges (n,) and unit vectors (n, 2) of n beams from inside a room with these walls."""
    beams = 2 * np.pi * (np.arange(n) + 0.5) / n
    reach = room[:, :1] / np.maximum(np.cos(beams - room[:, 1:]), 1e-9)
    return reach.min(0), np.column_stack([np.cos(beams), np.sin(beams)])


def _round_scan(rng: np.random.Generator, n: int = 120) -> Array:
    """One scan (n, 2) of the rectangular room, in whole centimetres along the beams."""
    ranges, rays = _exact_scan(_BOX, n)
    points: Array = np.round(ranges + 0.003 * rng.standard_normal(n), 2)[:, None] * rays
    return points


def _repeated(rng: np.random.Generator) -> Any:
    """Draw a scan of the room that begins anywhere and ends on its first point."""
    points = np.roll(_round_scan(rng, 30), int(rng.integers(30)), axis=0)
    return (np.vstack([points, points[:1]]),)


def _corner_drawn(ax: Any, function: Any) -> None:
    """Draw a scan that goes round a room, and where the scans of forty drives are cut."""
    from slamlab import plots

    rng, cuts = np.random.default_rng(2), []
    for _ in range(40):
        points = _round_scan(rng)
        cuts.append(points[int(function(points))])
    off = np.hypot(*(np.array(cuts)[:, None] - _BOX_CORNERS).T).min(0)
    plots.path(ax, np.vstack([_BOX_CORNERS, _BOX_CORNERS[:1]]), "truth")
    plots.lidar_points(ax, points, s=3)
    ax.plot(*np.array(cuts).T, "o", color=plots.COLOURS["estimate"], markersize=8, mfc="none")
    ax.plot(0, 0, "o", color=plots.COLOURS["truth"], markersize=4)
    plots.floor(ax)
    ax.set_title(f"40 scans: {(off < 0.3).sum()} cuts at a corner", loc="left")


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
        "a point beyond the end of the chord": ([[0, 0], [1, 1], [3.2, 0.5], [2, 0]],),
        "a point before its beginning": ([[0, 0], [-1.2, 0.5], [1, 1], [2, 0]],),
        "a scan that goes all the way round": lambda rng: (_round_scan(rng, 40),),
        "a scan whose last point is the first once more": _repeated,
        "any stretch": _stretch,
    },
    draws=12,
    picture=_corner_drawn,
)


# %% tags=["mistakes"]
def _chord(points: Array) -> Array:
    """Distances from the line through both ends; from the first point where they coincide."""
    u, d = points[-1] - points[0], points - points[0]
    if not u.any():
        return np.asarray(np.hypot(*d.T))
    off: Array = np.abs(u[0] * d[:, 1] - u[1] * d[:, 0]) / np.hypot(*u)
    return off


def _segment(points: Array) -> Array:
    u, d = points[-1] - points[0], points - points[0]
    s = np.clip(d @ u / max(float(u @ u), 1e-300), 0.0, 1.0)
    return np.asarray(np.hypot(*(d - s[:, None] * u).T))


def _chord_without_division(points: Array) -> int:
    u, d = points[-1] - points[0], points - points[0]
    return int(np.argmax(np.abs(u[0] * d[:, 1] - u[1] * d[:, 0])))


def _from_fit(points: Array) -> int:
    r, alpha = line(points, np.ones(len(points)))
    return int(np.argmax(np.abs(points @ [np.cos(alpha), np.sin(alpha)] - r)))


def _sharpest(points: Array) -> int:
    legs = np.diff(points, axis=0)
    angles = np.arctan2(legs[:, 1], legs[:, 0])
    return 1 + int(np.argmax(np.abs((np.diff(angles) + np.pi) % (2 * np.pi) - np.pi)))


check_corner.mistakes = {
    "this is the lesson's chord, a line that goes on beyond both ends: a segment ends": (
        _chord_without_division
    ),
    "the distance from the line was taken: the segment ends where the points end": (
        lambda p: int(np.argmax(_chord(p)))
    ),
    "the ends coincide and 0 / 0 is no number: the segment is a single point then": (
        "max(u @ u, 1e-300) => (u @ u)"
    ),
    "beyond the end of the segment the nearest point is its end: s is at most 1": (
        "np.clip(d @ u / max(u @ u, 1e-300), 0.0, 1.0)"
        " => np.maximum(d @ u / max(u @ u, 1e-300), 0.0)"
    ),
    "before the beginning of the segment the nearest point is its first: s is at least 0": (
        "np.clip(d @ u / max(u @ u, 1e-300), 0.0, 1.0)"
        " => np.minimum(d @ u / max(u @ u, 1e-300), 1.0)"
    ),
    "the place along the segment is d u / (u u): divided by its length, it is in metres": (
        "max(u @ u, 1e-300) => max(np.sqrt(u @ u), 1e-300)"
    ),
    "this is the distance from the nearer of both ends: between them the segment counts too": (
        lambda p: int(np.argmax(np.minimum(np.hypot(*(p - p[0]).T), np.hypot(*(p - p[-1]).T))))
    ),
    "this is the sum of the distances to both ends: expected that to the nearest point between": (
        lambda p: int(np.argmax(np.hypot(*(p - p[0]).T) + np.hypot(*(p - p[-1]).T)))
    ),
    "this is the distance from the middle of the chord: each point has a nearest one of its own": (
        lambda p: int(np.argmax(np.hypot(*(p - (p[0] + p[-1]) / 2).T)))
    ),
    "this is the distance from the fitted line, largest at an end: cut by the segment": (
        _from_fit
    ),
    "this is the distance from the first point: measure it from the segment": (
        lambda p: int(np.argmax(np.hypot(*(p - p[0]).T)))
    ),
    "this is the sharpest turn: expected the farthest from the segment": _sharpest,
    "this is the middle of the stretch": lambda p: len(p) // 2,
    "this is the point farthest from the middle of the points": (
        lambda p: int(np.argmax(np.hypot(*(p - p.mean(0)).T)))
    ),
    "this is the distance itself: expected the index of the point": lambda p: _segment(p).max(),
    "off by one: the first point has index 0": lambda p: corner(p) + 1,
    "this point lies nearest to the segment: expected the farthest": (
        lambda p: 1 + int(np.argmin(_segment(p)[1:-1]))
    ),
    "counted among the inner points: the first point of the stretch has index 0": (
        lambda p: corner(p) - 1
    ),
    "this is the point itself: expected its index": lambda p: p[corner(p)],
}

# %% [markdown] tags=["solution"]
# ## Solution 2: a scan that goes all the way round
#
# The foot of the perpendicular, kept on the segment by `np.clip`. Where both ends coincide, $d
# \cdot u$ is zero as well, and any positive number below the fraction gives $s = 0$. Seen from a
# segment that is nearly a point, the farthest point of a room is a corner: along a straight wall
# the distance from a segment has its maximum at one end.

# %% [markdown] tags=["solution"]
# The lesson's chord measures from a line. In whole centimetres the first and the last range are
# often the same number; then the line runs exactly along the wall:

# %% active="ipynb" tags=["solution"]
# def from_the_line(points):
#     u = points[-1] - points[0]
#     d = points - points[0]
#     return int(np.argmax(np.abs(u[0] * d[:, 1] - u[1] * d[:, 0])))
#
# ROOM = np.array([[3.0, 0.0], [2.5, np.pi / 2], [3.0, np.pi], [1.5, -np.pi / 2]])
# CORNERS = np.array([[3, 2.5], [-3, 2.5], [-3, -1.5], [3, -1.5]])
# BEAMS = 2 * np.pi * (np.arange(120) + 0.5) / 120
# RAYS = np.column_stack([np.cos(BEAMS), np.sin(BEAMS)])
# REACH = (ROOM[:, :1] / np.maximum(np.cos(BEAMS - ROOM[:, 1:]), 1e-9)).min(0)

# %% active="ipynb" tags=["solution"]
# for unit, digits in (("whole centimetres", 2), ("not rounded", 9)):
#     rng, at_corner = np.random.default_rng(1), {from_the_line: 0, corner: 0}
#     for _ in range(1000):
#         ranges = np.round(REACH + 0.003 * rng.standard_normal(120), digits)
#         scan = ranges[:, None] * RAYS
#         for cut in at_corner:
#             off = np.hypot(*(CORNERS - scan[cut(scan)]).T).min()
#             at_corner[cut] += off < 0.3
#     print(f"{unit:18s} cut at a corner in 1000 scans: by the line "
#           f"{at_corner[from_the_line]}, by the segment {at_corner[corner]}")

# %% [markdown] tags=["solution"]
# The lesson's `merge` would undo most such cuts later. A cut that is right needs no repair. The
# check finds the line by the points beyond its ends:

# %% active="ipynb" tags=["solution"]
# check_corner(from_the_line)

# %% [markdown] tags=["statement"]
# ## Exercise 3: what does one more point tell?
#
# The vacuum cleaner sees a wall by ten points that are good to a centimetre. Now an eleventh comes
# in, from far away, and it is off by half a metre or so. Predict: is the wall better known with
# it, or worse, by the lesson's fit and by that of exercise 1?
#
# The lesson's covariance is that of a fit which weighs all points alike. The weighted fit needs
# one of its own, and you can build it from single points. Let the wall's two numbers err by
# $\delta r$ and $\delta\alpha$. At the place $t$ along the wall, counted from the foot of the
# perpendicular, the wall is then too far out by
#
# $$
# e = \delta r - t\,\delta\alpha
# $$
#
# (for a larger $\alpha$ the wall comes nearer at positive $t$). A point at $t$ measures this one
# combination of the two unknowns, with its variance $v$; the errors of the points are independent
# of each other. The **information** of an estimate is the inverse of its covariance; of one number
# with the variance $v$ it is $1/v$. What is the covariance of $(r, \alpha)$ if all points are
# used, each with its weight $1/v_i$?


# %% tags=["exercise"]
def wall_cov(along: Array, variances: Array) -> Any:
    """Covariance of a wall from a weighted fit.

    Parameters
    ----------
    along : ndarray, shape (k,)
        Places t of the points along the wall (m), from the foot of the perpendicular;
        at least two differ.
    variances : ndarray, shape (k,)
        Variance of each point across the wall (m^2), positive; errors are independent.

    Returns
    -------
    ndarray, shape (2, 2)
        Covariance of (r, alpha).
    """
    H = np.column_stack([np.ones(len(along)), -along])
    return np.linalg.inv((H.T / variances) @ H)


# %% active="ipynb" tags=["try"]
# wall_cov(np.array([1.0, 2.0, 3.0]), np.full(3, 0.02**2))

# %% [markdown] tags=["hint"]
# One point measures $e = h\,(\delta r, \delta\alpha)^T$ with a row $h$ of two numbers. Which?

# %% [markdown] tags=["hint"]
# Where errors are independent, information adds. One point brings the matrix $h^T h / v$: it is
# large where $h$ points, and zero across it. What do all points bring together?

# %% [markdown] tags=["hint"]
# With the rows $h_i$ as a matrix $H$ of shape (k, 2) the sum is $H^T V^{-1} H$, where $V$ is
# diagonal. The covariance is its inverse.

# %% [markdown] tags=["statement"]
# <details><summary>After your prediction</summary>
#
# Ten points within half a metre of the foot, and the eleventh 4 m away: by the lesson's fit the
# standard deviation of $\alpha$ grows from 0.57° to 6.69°, by the weighted fit it is 0.57° before
# and after.
#
# </details>


# %% tags=["cases"]
@drawn
def _points(rng: np.random.Generator, even: bool = False) -> Any:
    k = int(rng.integers(3, 12))
    variances = np.round(rng.uniform(0.01, 1.0, 1 if even else k), 3) * np.ones(k)
    return np.round(rng.uniform(-3, 3, k) + rng.uniform(-4, 4), 2), variances


def _wall_cov_drawn(ax: Any, function: Any) -> None:
    """Draw the errors of 1000 walls from weighted fits, and the ellipse of the covariance."""
    from slamlab import plots

    rng, along = np.random.default_rng(3), np.linspace(0.5, 3.5, 16)
    sigmas = 0.005 * (0.64 + along**2)
    fits = []
    for errors in rng.standard_normal((1000, 16)) * sigmas:
        slope, at_foot = np.polyfit(along, errors, 1, w=1 / sigmas)
        fits.append([at_foot, -slope])
    cov = np.asarray(function(along, sigmas**2), float)
    units = np.diag([100.0, np.degrees(1)])
    plots.lidar_points(ax, np.array(fits) @ units, s=1.6)
    plots.ellipse(ax, [0, 0], units @ cov @ units)
    ax.set(xlabel="error of r (cm)", ylabel="error of alpha (°)")
    nees = np.einsum("ni,ij,nj->n", fits, np.linalg.inv(cov), fits).mean()
    ax.set_title(f"NEES {nees:.1f} (expected 2)", loc="left")


check_wall_cov = Check(
    wall_cov,
    "cov",
    {
        "points around the perpendicular": (np.linspace(-1, 1, 5), [0.04] * 5),
        "points to one side of it": (np.linspace(1, 3, 9), [0.04] * 9),
        "two points to the other side": ([-5.0, -2.5], [0.1, 0.3]),
        "ten good points and a poor one": (
            np.append(np.linspace(-0.5, 0.5, 10), 4.0),
            np.append(np.full(10, 1e-4), 0.25),
        ),
        "points that are all alike": _points(even=True),
        "unequal points": _points(),
    },
    picture=_wall_cov_drawn,
)


# %% tags=["mistakes"]
def _equal_weights(along: Array, variances: Array) -> Array:
    """Return the covariance of the lesson's fit, which weighs all points alike."""
    t, middle = along, along.mean()
    row_alpha = -(t - middle) / np.sum((t - middle) ** 2)
    J = np.stack([1 / len(t) + middle * row_alpha, row_alpha])
    return np.asarray((J * variances) @ J.T)


check_wall_cov.mistakes = {
    "this is the covariance of the lesson's fit: a weighted fit lets poor points count less": (
        _equal_weights
    ),
    "this is the information: the covariance is its inverse": (
        lambda t, v: np.linalg.inv(wall_cov(t, v))
    ),
    "information is divided by the variance: a poor point brings little": (
        "H.T / variances => H.T * variances"
    ),
    "the variances were given: do not square them": "H.T / variances => H.T / variances**2",
    "the roots of the variances were used: expected the variances themselves": (
        "H.T / variances => H.T / np.sqrt(variances)"
    ),
    "the variances are not used: each point counts with its own": "H.T / variances => H.T",
    "all points have the mean variance: each counts with its own": (
        "H.T / variances => H.T / variances.mean()"
    ),
    "information adds: this is the mean of what the points bring, not the sum": (
        lambda t, v: wall_cov(t, v) * len(t)
    ),
    "the turn has the wrong sign: e = dr - t dalpha": "-along] => along]",
    "r and alpha err together: the corner elements are not zero": (
        lambda t, v: wall_cov(t, v) * np.eye(2)
    ),
    "the places were counted from their mean: count from the foot of the perpendicular": (
        lambda t, v: wall_cov(t - t.mean(), v)
    ),
    "the places were counted from the weighted mean: count from the foot of the perpendicular": (
        lambda t, v: wall_cov(t - (t / v).sum() / (1 / v).sum(), v)
    ),
    "alpha comes second: rows and columns are r, alpha": (
        "[np.ones(len(along)), -along] => [-along, np.ones(len(along))]"
    ),
    "each entry was inverted by itself: a matrix has an inverse of its own": (
        "np.linalg.inv((H.T / variances) @ H) => 1 / ((H.T / variances) @ H)"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: what does one more point tell?
#
# One point with $h = (1, -t)$ brings $h^T h / v$, a matrix of rank one: it says how far out the
# wall is at $t$, and nothing else, so it cannot be inverted. Two points at different places are
# enough. Every further point adds a matrix that is nowhere negative: the wall is known better with
# it, or as well, never worse.

# %% [markdown] tags=["solution"]
# That holds for a fit that weighs. With equal weights the eleventh point does harm:

# %% active="ipynb" tags=["solution"]
# def equal_weights(along, variances):
#     t, middle = along, along.mean()
#     row_alpha = -(t - middle) / np.sum((t - middle) ** 2)
#     J = np.stack([1 / len(t) + middle * row_alpha, row_alpha])
#     return (J * variances) @ J.T
#
# along = np.append(np.linspace(-0.5, 0.5, 10), 4.0)
# variances = np.append(np.full(10, 0.01**2), 0.5**2)
# for name, cov in (("equal weights", equal_weights), ("weighted", wall_cov)):
#     for k in (10, 11):
#         sigma = np.rad2deg(np.sqrt(cov(along[:k], variances[:k])[1, 1]))
#         print(f"{name:14s} {k} points: sigma of alpha {sigma:.3f}°")

# %% [markdown] tags=["solution"]
# Where all variances are equal, both are the same matrix. A filter that keeps only the two
# variances takes r and α to err independently; of a wall to one side they do not, and the check
# says so:

# %% active="ipynb" tags=["solution"]
# def variances_only(along, variances):
#     return wall_cov(along, variances) * np.eye(2)
#
# check_wall_cov(variances_only)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a bug to find
#
# A robot maps an office floor and keeps a wall by its two numbers as seen from the origin, the
# door where it started. It stands at $(x, y)$ with the heading $\theta$ and sees the wall $(r,
# \alpha)$. With the heading added, $\alpha_w = \alpha + \theta$; with its own place along the
# normal, $r_w = r + x\cos\alpha_w + y\sin\alpha_w$. If $r_w$ comes out negative, the wall gets its
# other name. The covariance is to first order; pose and wall err independently, with $P$ and $C$.
#
# Near the door all is well, and no wall lies between robot and door, so none changes its name: a
# wall that is seen again passes the gate. At the far end of the floor, twelve metres away, the
# gate rejects walls that the robot saw a minute ago, and the map has them twice. Both kinds of
# walls suffer: those beyond the robot, and, worse, those between the robot and the door.
#
# The picture shows one wall of each kind: green where a thousand robots with these errors would
# put it, and as an ellipse (95 %) what the program below claims. There are two bugs. Run the
# check, draw the picture, find them, repair them.


# %% tags=["exercise"]
def to_world(pose: Array, P: Array, wall: Array, C: Array) -> tuple[Array, Array]:
    """Wall in the world, and its covariance.

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
        Covariance of these two numbers.
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
# Begin with the wall beyond the robot, and with a robot that knows its pose exactly ($P = 0$).
# Suppose that it misjudges $\alpha$ by one degree, twelve metres from the origin. What happens to
# the line at the origin?

# %% [markdown] tags=["hint"]
# $r_w$ is a function of the three numbers of the pose and of the two of the wall. Write down its
# derivatives by all five, and compare them with the program. What it calls the lever is $\partial
# r_w / \partial\alpha_w = y\cos\alpha_w - x\sin\alpha_w$.

# %% [markdown] tags=["hint"]
# When the wall beyond the robot is right, the other one looks worse than before. Compare the slant
# of its ellipse with that of its cloud. What are the errors of $-r_w$ and $\alpha_w + \pi$, if
# those of $r_w$ and $\alpha_w$ are $\delta r$ and $\delta\alpha$? And what is the mean of their
# product?


# %% tags=["cases"]
@drawn
def _sighting(
    rng: np.random.Generator, prior: float = 1.0, noise: float = 1.0, side: int = 0, rho: float = 4
) -> Any:
    """Draw a wall beyond the robot (side 1), or between it and the origin (-1): its other name."""
    side = side or int(rng.choice([-1, 1]))
    towards, heading = rng.uniform(-3, 3), an_angle(rng)
    place = rho * rng.uniform(0.8, 1.2) * np.array([np.cos(towards), np.sin(towards)])
    normal = towards + (rng.uniform(-1.2, 1.2) if side > 0 else np.pi + rng.uniform(-0.6, 0.6))
    away = float(place @ [np.cos(normal), np.sin(normal)])
    r = rng.uniform(0.3, 5) if side > 0 else -away * rng.uniform(0.3, 0.95)
    wall = np.array([r, float(wrap_angle(normal - heading))])
    P, C = prior * a_covariance(rng, 3, 0.05), noise * a_covariance(rng, 2, 0.02)
    return np.array([*np.round(place, 2), heading]), P, np.round(wall, 2).tolist(), C


def _to_world_drawn(ax: Any, function: Any) -> None:
    """Draw two walls as 1000 uncertain robots place them in the map, and the ellipses claimed."""
    from slamlab import plots

    pose, P = np.array([12.0, 4.0, 0.7]), np.diag([0.03, 0.03, 0.003]) ** 2
    C = wall_cov(np.linspace(0.5, 2.5, 12), np.full(12, 0.03**2))
    units, nees = np.diag([100.0, np.degrees(1)]), []
    for k, alpha in enumerate((0.4, 0.4 + np.pi)):
        wall, rng = np.array([2.0, alpha]), np.random.default_rng(4)
        mean, cov = (np.asarray(one, float) for one in function(pose, P, wall, C))
        truth = to_world(pose, P, wall, C)[0]
        robots = rng.multivariate_normal(pose, P, 1000)
        seen = rng.multivariate_normal(wall, C, 1000)
        placed = [to_world(*pair, C)[0] for pair in zip(robots, [P] * 1000, seen, strict=True)]
        errors, off = np.array(placed) - truth, mean - truth
        errors[:, 1], off[1] = wrap_angle(errors[:, 1]), wrap_angle(off[1])
        shift = np.array([120.0 * k, 0.0])
        plots.lidar_points(ax, errors @ units + shift, s=1.6)
        plots.ellipse(ax, units @ off + shift, units @ cov @ units)
        nees.append(np.einsum("ni,ij,nj->n", errors, np.linalg.inv(cov), errors).mean())
    ax.set(xlabel="error of r (cm)\nleft: beyond the robot\nright: nearer (120 cm added)")
    ax.set(ylabel="error of alpha (°)")
    ax.set_title(f"NEES {nees[0]:.1f} and {nees[1]:.1f} (expected 2)", loc="left")


check_to_world = Check(
    to_world,
    "wall, cov",
    {
        "a robot at the origin": _sighting(side=1, rho=0.0),
        "a wall beyond the robot": _sighting(side=1),
        "a wall beyond a robot that knows its pose": _sighting(prior=0.0, side=1),
        "a wall between the robot and the origin": _sighting(side=-1),
        "a wall between both, seen without error": _sighting(noise=0.0, side=-1),
        "any pose, any wall": _sighting(),
    },
    tolerance=1e-6,
    draws=10,
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
# What does each of them cost? The two walls of the picture, each seen by a thousand robots, and a
# program with one bug or both; and, near the door, a wall between robot and door:

# %% active="ipynb" tags=["solution"]
# def as_handed_out(pose, P, wall, C):
#     c, s = np.cos(wall[1] + pose[2]), np.sin(wall[1] + pose[2])
#     J = np.array([[c, s, pose[1] * c - pose[0] * s], [0.0, 0.0, 1.0]])
#     return to_world(pose, P, wall, C)[0], J @ P @ J.T + C
#
# FLIP = np.array([[1.0, -1.0], [-1.0, 1.0]])
#
# def flipped(pose, P, wall, C):
#     alpha = wall[1] + pose[2]
#     return wall[0] + pose[:2] @ [np.cos(alpha), np.sin(alpha)] < 0
#
# def first_repaired(pose, P, wall, C):
#     mean, cov = to_world(pose, P, wall, C)
#     return mean, cov * FLIP if flipped(pose, P, wall, C) else cov
#
# def second_repaired(pose, P, wall, C):
#     mean, cov = as_handed_out(pose, P, wall, C)
#     return mean, cov * FLIP if flipped(pose, P, wall, C) else cov

# %% active="ipynb" tags=["solution"]
# P = np.diag([0.03, 0.03, 0.003]) ** 2
# C = wall_cov(np.linspace(0.5, 2.5, 12), np.full(12, 0.03**2))
#
# def mean_nees(program, pose, wall, seed):
#     rng, squared = np.random.default_rng(seed), []
#     truth = to_world(pose, P, wall, C)[0]
#     for _ in range(1000):
#         at, seen = rng.multivariate_normal(pose, P), rng.multivariate_normal(wall, C)
#         mean, cov = program(at, P, seen, C)
#         error = mean - truth
#         error[1] = wrap_angle(error[1])
#         squared.append(error @ np.linalg.solve(cov, error))
#     return np.mean(squared)

# %% active="ipynb" tags=["solution"]
# both_walls = np.array([[2.0, 0.4], [2.0, 0.4 + np.pi]])
# between = np.array([[0.2, 0.4 + np.pi]])
# door, far = np.array([0.4, 0.3, 0.7]), np.array([12.0, 4.0, 0.7])
# rows = (("near the door", door, both_walls), ("a wall between", door, between),
#         ("far away", far, both_walls))
# for program in (as_handed_out, first_repaired, second_repaired, to_world):
#     for name, pose, seen in rows:
#         nees = [f"{mean_nees(program, pose, wall, 7):4.1f}" for wall in seen]
#         print(f"{program.__name__:16s} {name:14s} NEES", " and ".join(nees))

# %% [markdown] tags=["solution"]
# Near the door the first bug costs nothing yet, for the lever is short. The second cannot act:
# neither wall changes its name. A wall between robot and door does, and as long as the second bug
# is left, its NEES is about 4. Far away the first repair alone makes the second wall *worse*: with
# the lever r and α are strongly correlated, and a thin ellipse that slants the wrong way misses
# nearly everything. That is how bugs in pairs survive; here the repair of the lever alone seems to
# do harm.
#
# The check, with the second bug left:

# %% active="ipynb" tags=["solution"]
# check_to_world(first_repaired)

# %% [markdown] tags=["statement"]
# ## Exercise 5: the walls of a room
#
# Back to the vacuum cleaner, with a better lidar: 2 mm at one metre, 3 cm at four. It stands in a
# room of five walls and turns its 180 beams round once; the noise of each point grows with the
# square of the range. A threshold in metres does not fit: what is a dent in a wall nearby is noise
# at four metres. So a point may lie off its line by at most `width` times its *own* standard
# deviation $\sqrt{v_i}$. Assemble split-and-merge from your three functions:
#
# 1. **Split.** Begin with all points as one piece. A piece is *straight* if each of its points
#    is at most `width` $\cdot \sqrt{v_i}$ from the piece's `line`, or if it has fewer than three
#    points. Cut a piece that is not straight at its `corner`, which begins the second part; go on
#    with both parts.
# 2. **Close** (no general merge). The scan goes all the way round, so it began somewhere on a
#    wall: if there are several pieces, and the points of the last and of the first piece *together*
#    are straight, they are one piece, and it comes first.
# 3. **Report.** Drop pieces of fewer than `fewest` points. Each of the others is a wall, in scan
#    order, with the covariance from your `wall_cov`: its points have the places $t_i = p_i \cdot
#    (-\sin\alpha, \cos\alpha)$ along it.
#
# Then draw it: the room, one scan and your walls in it, and what two hundred scans say about them.


# %% tags=["exercise"]
def walls(points: Array, variances: Array, width: float, fewest: int) -> tuple[Array, Array]:
    """Walls in a scan that goes all the way round.

    Parameters
    ----------
    points : ndarray, shape (k, 2)
        In scan order (m); they may be too few for any wall.
    variances : ndarray, shape (k,)
        Variance of each point, in every direction (m^2).
    width : float
        Largest distance of a point from its wall, in its own standard deviations.
    fewest : int
        Fewer points than this make no wall; at least 3.

    Returns
    -------
    walls : ndarray, shape (n, 2)
        r and alpha, in the order of the scan; the joined wall comes first.
    covs : ndarray, shape (n, 2, 2)
    """

    def straight(piece):
        r, alpha = line(points[piece], variances[piece])
        off = points[piece] @ [np.cos(alpha), np.sin(alpha)] - r
        return (np.abs(off) <= width * np.sqrt(variances[piece])).all()

    todo, pieces = [np.arange(len(points))], []
    while todo:
        piece = todo.pop()
        if len(piece) < 3 or straight(piece):
            pieces.append(piece)
        else:
            cut = corner(points[piece])
            todo += [piece[cut:], piece[:cut]]
    if len(pieces) > 1:
        both = np.append(pieces[-1], pieces[0])
        if straight(both):
            pieces = [both, *pieces[1:-1]]
    lines, covs = np.zeros((0, 2)), np.zeros((0, 2, 2))
    for piece in pieces:
        if len(piece) >= fewest:
            r, alpha = line(points[piece], variances[piece])
            along = points[piece] @ [-np.sin(alpha), np.cos(alpha)]
            lines = np.vstack([lines, [[r, alpha]]])
            covs = np.vstack([covs, [wall_cov(along, variances[piece])]])
    return lines, covs


# %% active="ipynb" tags=["try"]
# square = np.array([[2, 1.5], [2, 2], [1, 2], [0, 2], [-1, 2], [-1, 1], [-1, 0],
#                    [-1, -1], [0, -1], [1, -1], [2, -1], [2, 0]])
# walls(square, np.full(12, 1e-4), 4.0, 3)                       # its four walls

# %% [markdown] tags=["hint"]
# Handle pieces as arrays of *indices*, from `np.arange(len(points))` on: then `points[piece]` and
# `variances[piece]` always fit together. The same question, *is this piece straight?*, comes up in
# step 1 and in step 2. Make it a function of its own.

# %% [markdown] tags=["hint"]
# Two ways to split. A list of pieces to do: take the last one off; put back its two parts, the
# second part first, and the finished pieces come in scan order. Or a function that calls itself
# with fewer points; what ends it?

# %% [markdown] tags=["hint"]
# A short piece is kept until step 3: it may be the beginning of the last wall. And if all points
# are one piece, there is nothing to close.


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
    points, sigmas = np.vstack(stretches), np.round(rng.uniform(0.004, 0.02, sum(sizes)), 4)
    points = points + sigmas[:, None] * rng.uniform(-1.5, 1.5, points.shape)
    return np.round(points, 4), sigmas**2, 4.0, fewest


@drawn
def _all_round(rng: np.random.Generator, n: int = 60, *, begin: int | None = None) -> Any:
    """Draw a scan of a room with five walls that begins at a beam, or at any."""
    ranges, rays = _exact_scan(_BAY, n)
    sigmas = 0.002 * ranges**2
    points = ranges[:, None] * rays + sigmas[:, None] * rng.standard_normal((n, 2))
    first = int(rng.integers(n)) if begin is None else begin
    return np.roll(points, -first, 0), np.roll(sigmas**2, -first), 4.5, 4


_ANGLE = np.array([[0, 1], [1, 1], [2, 1], [3, 1], [4, 1.0], [4, 2], [4, 3], [4, 4], [4, 5]])

# A room of five walls, seen from inside: distance and direction of each normal.
_BAY = np.array([[3.0, 0.0], [2.5, np.pi / 2], [3.0, np.pi], [2.6, -2.65], [1.5, -np.pi / 2]])


def _corners_of(room: Array) -> Array:
    """Corners (n + 1, 2) of a room whose walls follow each other; the first comes last again."""
    n = np.column_stack([np.cos(room[:, 1]), np.sin(room[:, 1])])
    pairs = zip(n, np.roll(n, -1, 0), room[:, 0], np.roll(room[:, 0], -1), strict=True)
    corners = [np.linalg.solve(np.array([a, b]), [r, q]) for a, b, r, q in pairs]
    return np.array(corners + corners[:1])


def _walls_drawn(ax: Any, function: Any) -> None:
    """Draw a room, one noisy scan of it and the walls found; judge those of 200 scans."""
    from slamlab import plots

    ranges, rays = _exact_scan(_BAY, 180)
    sigmas, counts, off, squared = 0.002 * ranges**2, [], [], []
    for k in range(200):
        noise = np.random.default_rng(k).standard_normal((180, 2))
        points = ranges[:, None] * rays + sigmas[:, None] * noise
        found, covs = (np.asarray(one, float) for one in function(points, sigmas**2, 4.0, 6))
        error = found[:, None] - _BAY
        error[..., 1] = wrap_angle(error[..., 1])
        nearest = np.abs(error / [0.1, 0.05]).max(-1).argmin(1)
        error = error[np.arange(len(found)), nearest]
        counts.append(len(found))
        off.append(error)
        squared.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(covs), error))
        if k == 0:
            shown, scan = found, points
    plots.path(ax, _corners_of(_BAY), "truth", linewidth=4, alpha=0.3)
    plots.lidar_points(ax, scan, s=3)
    for r, alpha in shown:
        normal, along = np.array([np.cos(alpha), np.sin(alpha)]), [-np.sin(alpha), np.cos(alpha)]
        far = np.abs(scan @ normal - r) > 4 * sigmas
        order = np.roll(np.arange(180), -int(np.argmax(far)))
        near = np.flatnonzero(~far[order])
        runs = np.split(near, np.flatnonzero(np.diff(near) > 3) + 1)
        t = scan[order[max(runs, key=len)]] @ along if len(near) else np.array([-1.0, 1.0])
        ends = r * normal + np.outer([t.min(), t.max()], along)
        plots.path(ax, ends, linewidth=1.5, marker="o", markersize=6, mfc="none")
    ax.plot(0, 0, "o", color=plots.COLOURS["truth"], markersize=4)
    plots.floor(ax)
    cm, turn = np.sqrt(np.mean(np.vstack(off) ** 2, axis=0)) * [100, np.degrees(1)]
    ax.set_title(
        f"200 scans: {np.mean(counts):.1f} walls each,\n"
        f"off {cm:.1f} cm, {turn:.1f}°; NEES {np.concatenate(squared).mean():.1f}",
        loc="left",
    )


check_walls = Check(
    walls,
    "walls, covs",
    {
        "one wall": _outline(9),
        "two walls": _outline(9, 11, fewest=3),
        "four walls": _outline(8, 12, 7, 9, fewest=5),
        "a room that goes all the way round": _all_round(),
        "a scan that begins in the middle of a wall": _all_round(begin=20),
        "a scan that begins one point before a corner": _all_round(begin=6),
        "three walls, of which the last is not the first": _outline(9, 7, 9),
        "a wall that bulges, farther from its segment than from its line": (
            np.column_stack([np.linspace(-1, 1, 9), 2.06 - 0.06 * np.linspace(-1, 1, 9) ** 2]),
            [0.0125**2] * 9,
            4.0,
            4,
        ),
        "one point of a wall bulges towards the robot": (
            [[x, 2.0 - 0.15 * (x == 0)] for x in np.arange(-2, 2.1, 0.5)],
            [0.025**2] * 9,
            4.0,
            4,
        ),
        "a poor point far off its wall, within its own width": (
            [[x, 2.0 + 0.3 * (x == 0)] for x in np.arange(-2, 2.1, 0.5)],
            [0.01**2] * 4 + [0.1**2] + [0.01**2] * 4,
            4.0,
            4,
        ),
        "a short piece between two walls is none": _outline(9, 2, 10),
        "a wall of exactly as many points as it needs": (_ANGLE, [0.01] * 9, 1.0, 4),
        "a piece of one point fewer than a wall needs": (
            np.vstack([[-1.0, 1.0], _ANGLE[:-1]]),
            [0.01] * 9,
            1.0,
            5,
        ),
        "three points round a corner": ([[0, 1], [1, 1], [1, 2.0]], [0.01**2] * 3, 4.0, 3),
        "a narrow width tells walls apart that meet at a flat angle": (
            [[x, 2.0 + 0.07 * abs(x)] for x in np.arange(-1, 1.01, 0.2)],
            [0.01**2] * 11,
            2.0,
            4,
        ),
        "too few points for any wall": ([[0.0, 1.0], [1.0, 1.0], [2.0, 1.0]], [0.01] * 3, 1.0, 4),
    },
    tolerance=1e-7,
    draws=8,
    picture=_walls_drawn,
)


# %% tags=["mistakes"]
def _by_the_segment(points: Array, variances: Array, width: float, fewest: int) -> Any:
    """Split where a point is off the segment, not off the line; then as it should be."""
    todo, pieces = [np.arange(len(points))], []
    while todo:
        i = todo.pop()
        bent = len(i) > 2 and (_segment(points[i]) > width * np.sqrt(variances[i])).any()
        if bent:
            cut = corner(points[i])
            todo += [i[cut:], i[:cut]]
        else:
            pieces.append(i)
    kept = [
        walls(points[i], variances[i], np.inf, fewest) for i in _closed(pieces, points, variances)
    ]
    return np.vstack([one[0] for one in kept]), np.concatenate([one[1] for one in kept])


def _closed(pieces: Any, points: Array, variances: Array, width: float = 4.0) -> Any:
    both = np.append(pieces[-1], pieces[0])
    r, alpha = line(points[both], variances[both])
    off = np.abs(points[both] @ [np.cos(alpha), np.sin(alpha)] - r)
    if len(pieces) > 1 and (off <= width * np.sqrt(variances[both])).all():
        return [both, *pieces[1:-1]]
    return pieces


check_walls.mistakes = {
    "nothing was cut: one line goes through all points": (
        "if len(piece) < 3 or straight(piece): => if True:"
    ),
    "the scan was not closed: its first and its last piece may be one wall": (
        "if len(pieces) > 1: => if False:"
    ),
    "the last piece and the first were always joined: only if they are straight together": (
        "if straight(both): => if True:"
    ),
    "the joined wall comes first, not last": ("[both, *pieces[1:-1]] => [*pieces[1:-1], both]"),
    "the joined wall was added, its two parts were kept": (
        "[both, *pieces[1:-1]] => [both, *pieces]"
    ),
    "short pieces were dropped before the scan was closed: one may begin the last wall": (
        "if len(pieces) > 1: => pieces = [p for p in pieces if len(p) >= fewest]\n"
        "    if len(pieces) > 1:"
    ),
    "the segment decided: expected the distance from the fitted line": _by_the_segment,
    "the mean distance decided: no point may lie farther off than its own width": ".all() => .mean() > 0.5",
    "all points have one width in metres: each has its own standard deviation": (
        "width * np.sqrt(variances[piece]) => width * np.sqrt(variances[piece].mean())"
    ),
    "the width is in standard deviations, not in variances": (
        "width * np.sqrt(variances[piece]) => width * variances[piece]"
    ),
    "the width is in standard deviations of each point, not in metres": (
        "width * np.sqrt(variances[piece]) => width"
    ),
    "the distance has a sign: points on the other side were overlooked": "np.abs(off) => (off)",
    "a piece with fewer than `fewest` points is no wall": (
        "if len(piece) >= fewest: => if len(piece) >= 2:"
    ),
    "a piece with exactly `fewest` points is a wall": (
        "if len(piece) >= fewest: => if len(piece) > fewest:"
    ),
    "the corner was given to both pieces: it begins the second": "piece[:cut] => piece[: cut + 1]",
    "the corner was given to the first piece: it begins the second": (
        "piece[:cut] => piece[: cut + 1]",
        "piece[cut:] => piece[cut + 1 :]",
    ),
    "the walls are in the order of the last: the first points make the first wall": (
        "[piece[cut:], piece[:cut]] => [piece[:cut], piece[cut:]]"
    ),
    "places along the wall grow along (-sin, cos): the corner elements have the wrong sign": (
        "[-np.sin(alpha), np.cos(alpha)] => [np.sin(alpha), -np.cos(alpha)]"
    ),
    "places along the wall were counted from the middle: count from the foot": (
        "wall_cov(along, => wall_cov(along - along.mean(),"
    ),
    "places along the wall were counted from its first point: count from the foot": (
        "wall_cov(along, => wall_cov(along - along[0],"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: the walls of a room
#
# The cut is found by the segment, the decision is made by the fitted line: a segment hangs on two
# points and their noise, the line on all of them. There is no general `merge` here. At a width of
# four standard deviations a needless cut is rare, and the one cut that every scan has, where it
# begins, is closed.

# %% [markdown] tags=["solution"]
# The room of the picture again, where the truth is known. Each line is compared with the true wall
# that is nearest to it. `r off by` is the root mean square error of $r$ over all lines of two
# hundred scans; `best` leaves, of several lines of one true wall, only the one with the smallest
# variance of $r$. The NEES, the squared error in units of the covariance, has the mean 2, the
# number of entries.

# %% active="ipynb" tags=["solution"]
# ROOM = np.array([[3.0, 0.0], [2.5, np.pi / 2], [3.0, np.pi],
#                  [2.6, -2.65], [1.5, -np.pi / 2]])
# BEAMS = 2 * np.pi * (np.arange(180) + 0.5) / 180
# RAYS = np.column_stack([np.cos(BEAMS), np.sin(BEAMS)])
# REACH = ROOM[:, :1] / np.maximum(np.cos(BEAMS - ROOM[:, 1:]), 1e-9)
# WHOSE, REACH = REACH.argmin(0), REACH.min(0)
# SIGMAS = 0.002 * REACH**2
#
# def rms(errors):
#     return 100 * np.sqrt(np.mean(np.square(errors)))

# %% active="ipynb" tags=["solution"]
# def report(name, find):
#     off, best, squared = [], [], []
#     for k in range(200):
#         noise = np.random.default_rng(k).standard_normal((180, 2))
#         found, covs = find(REACH[:, None] * RAYS + SIGMAS[:, None] * noise)
#         error = found[:, None] - ROOM
#         error[..., 1] = wrap_angle(error[..., 1])
#         nearest = np.abs(error / [0.1, 0.05]).max(-1).argmin(1)
#         error = error[np.arange(len(found)), nearest]
#         order = np.argsort(covs[:, 0, 0])
#         first = np.unique(nearest[order], return_index=True)[1]
#         best += error[order[first], 0].tolist()
#         off += error[:, 0].tolist()
#         inverse = np.linalg.inv(covs)
#         squared += np.einsum("ni,nij,nj->n", error, inverse, error).tolist()
#     print(f"{name:13s} {len(off):4d} lines, r off by {rms(off):3.1f} cm "
#           f"(at most {100 * np.abs(off).max():.0f}), "
#           f"best {rms(best):3.1f} cm, NEES {np.mean(squared):6.1f}")

# %% active="ipynb" tags=["solution"]
# def corners_given(scan):
#     lines, covs = [], []
#     for mine in WHOSE == np.arange(5)[:, None]:
#         r, alpha = line(scan[mine], SIGMAS[mine] ** 2)
#         along = scan[mine] @ [-np.sin(alpha), np.cos(alpha)]
#         lines.append([r, alpha])
#         covs.append(wall_cov(along, SIGMAS[mine] ** 2))
#     return np.array(lines), np.array(covs)

# %% active="ipynb" tags=["solution"]
# for width in (2, 3, 4, 6, 20):
#     report(f"width {width}", lambda scan: walls(scan, SIGMAS**2, width, 6))
# each, same = "width * np.sqrt(variances[piece])", "width * np.sqrt(variances.mean())"
# report("one for all", lambda scan, find=changed([walls], each, same):
#        find(scan, SIGMAS**2, 4, 6))
# report("corners given", corners_given)
# low, high = chi2_band(2, 1000)
# print(f"expected NEES of a thousand lines: {low:.2f} to {high:.2f}")

# %% [markdown] tags=["solution"]
# From width 4 to 6 a scan has its five walls. At width 2 the noise cuts straight walls; at width
# 20 a line reaches round a corner, and its covariance holds nothing of that: NEES near 2000. *One
# for all* changes only the width: 4 times the root of the mean variance, in metres, for every
# point, while the fit and the covariance stay. That is too narrow for the far points, and straight
# walls are cut again.
#
# Why is $r$ off by 1.2 cm at width 4, and by 0.5 cm where the corners are given, each line fitted
# to all points of its wall and to no other? Both numbers are measured in the same way, over all
# lines. But at width 4 there are 1005 of them for 1000 walls: five times
# a wall was cut once more, and one of these pieces is off by 28 cm. With the best line of each
# wall alone the error is 0.6 cm.
#
# What remains is a NEES of 2.4 where 2 is expected. Given which point belongs to which wall, the
# same fit and the same covariance lie within the band. Near a corner the noise decides which wall
# gets a point, and no covariance of a fit holds that.

# %% [markdown] tags=["statement"]
# ## Exercise 6: two scans, one map
#
# One scan shows the walls nearby well and the far ones badly. So the vacuum cleaner is put down
# twice in this room, on two marks on the floor, and each time turns its lidar round once: what is
# a cloud from one mark is a clear wall from the other. The marks are good to a centimetre and
# 0.06°; each pose errs on its own, with the covariance $P$. Make one map of both scans.
#
# The origin of the map is the door, and the door is in a wall. For this wall $r$ is zero but for
# the noise, and the noise decides under which of its two names it arrives: as $(0.005, -90°)$ from
# one mark, perhaps, and as $(0.005, 90°)$ from the other.
#
# The program below uses your own functions, so exercises 1 to 5 come first: `walls` finds the
# walls of each scan, and `to_world` places them. But then it adds every wall to the map, also one
# that is there already. Join the two. Take the walls one after the other, as they come:
#
# 1. **Compare** the new wall $(r, \alpha)$, of covariance $C$, with each wall $(r_m, \alpha_m)$ of
#    the map so far, of covariance $M$. If their directions differ by more than 90°, the new one
#    goes by its other name here. With the difference $\delta = (r - r_m, \alpha - \alpha_m)$, its
#    angle wrapped, the squared distance is $d^2 = \delta^T (C + M)^{-1} \delta$.
# 2. **Decide.** The wall of the map with the smallest $d^2$ is the same wall, if $d^2$ is less
#    than `gate`. If there is none, the new wall is added at the end, with the name it came by.
# 3. **Join.** Of one wall there are now two estimates; take their errors as independent. Replace
#    the one in the map by the best that can be made of both, each weighed with the inverse of its
#    covariance. The wall keeps the name it has in the map, so $r$ may come out a little below
#    zero.
#
# Then draw it: the walls from either mark alone and from both, with their errors enlarged tenfold,
# and above it what sixty such maps are worth, in centimetres.


# %% tags=["exercise"]
def room_map(
    poses: Array, P: Array, scans: Array, variances: Array, gate: float
) -> tuple[Array, Array]:
    """Map of the walls in several scans of a room.

    Parameters
    ----------
    poses : ndarray, shape (m, 3)
        x (m), y (m), heading (rad) from which each scan was taken.
    P : ndarray, shape (3, 3)
        Covariance of each pose; the errors of two poses are independent.
    scans : ndarray, shape (m, k, 2)
        Points of each scan as seen from its pose, in scan order (m).
    variances : ndarray, shape (m, k)
        Variance of each point, in every direction (m^2).
    gate : float
        Squared distance from which on two walls are not the same; 13.8 lets 999 of
        1000 right pairs pass.

    Returns
    -------
    found : ndarray, shape (n, 2)
        r (m) and alpha (rad, in (-pi, pi]) of each wall in the world.
    covs : ndarray, shape (n, 2, 2)
    """

    def beside(wall, C, mean):
        turn = wrap_angle(wall[1] - mean[1])
        if abs(turn) <= np.pi / 2:
            return np.array([wall[0] - mean[0], turn]), C
        off = np.array([-wall[0] - mean[0], turn - np.sign(turn) * np.pi])
        return off, C * np.array([[1.0, -1.0], [-1.0, 1.0]])

    found, covs = [], []
    for pose, points, v in zip(poses, scans, variances):
        for seen, C in zip(*walls(points, v, 4.0, 10)):
            wall, C = to_world(pose, P, seen, C)
            pairs = [beside(wall, C, mean) for mean in found]
            squared = [d @ np.linalg.solve(W + M, d) for (d, W), M in zip(pairs, covs)]
            if min(squared, default=np.inf) < gate:
                k = np.argmin(squared)
                (off, W), M = pairs[k], covs[k]
                K = M @ np.linalg.inv(M + W)
                r, alpha = found[k] + K @ off
                found[k], covs[k] = np.array([r, wrap_angle(alpha)]), M - K @ M
            else:
                found.append(wall)
                covs.append(C)
    return np.reshape(found, (-1, 2)), np.reshape(covs, (-1, 2, 2))


# %% active="ipynb" tags=["stub"]
#     found, covs = [], []
#     for pose, points, v in zip(poses, scans, variances):
#         seen = walls(points, v, 4.0, 10)
#         if seen is None:
#             raise NotImplementedError("exercises 1 to 5 come first")
#         for wall, C in zip(*seen):
#             wall, C = to_world(pose, P, wall, C)
#             ...  # is it a wall of the map so far? Then join the two
#             found.append(wall)
#             covs.append(C)
#     return np.reshape(found, (-1, 2)), np.reshape(covs, (-1, 2, 2))

# %% [markdown] tags=["hint"]
# Write a function of its own for step 1: given the new wall, its covariance and one wall of the
# map, it returns the difference and the covariance that goes with it. If the wall takes its other
# name, what does exercise 4 say about its covariance?

# %% [markdown] tags=["hint"]
# Collect the squared distances from all walls of the map in a list; the smallest one decides. An
# empty map has no smallest one, and the first wall of all is new.

# %% [markdown] tags=["hint"]
# Joining is a Kalman update in which the wall itself is measured: with $K = M (M + C)^{-1}$ the
# wall of the map moves by $K\delta$, and its covariance becomes $M - KM$. The same in information:
# $(M^{-1} + C^{-1})^{-1}$.


# %% tags=["cases"]
_DOOR = np.array([1.0, -1.5])


def _seen_from_door(room: Array, door: Array) -> Array:
    """Walls (r, alpha) of a room, their normals outwards, with the origin at the door."""
    normals = np.column_stack([np.cos(room[:, 1]), np.sin(room[:, 1])])
    return np.column_stack([room[:, 0] - normals @ door, room[:, 1]])


def _scan_from(rng: np.random.Generator, room: Array, pose: Array, n: int) -> tuple[Array, Array]:
    """Points (n, 2) and their variances (n,): one scan from a pose in a room."""
    seen = _seen_from_door(room, pose[:2]) - [0.0, pose[2]]
    ranges, rays = _exact_scan(seen, n)
    sigmas = 0.002 * ranges**2
    return ranges[:, None] * rays + sigmas[:, None] * rng.standard_normal((n, 2)), sigmas**2


@drawn
def _visits(
    rng: np.random.Generator, m: int, door: Any = (0.0, 0.0), gate: float = 13.8, apart: float = 0
) -> Any:
    """Draw m scans of the room with five walls, from about where the poses are."""
    poses = np.column_stack(
        [rng.uniform([-1.2, -0.4], [1.5, 1.0], (m, 2)) - door, rng.uniform(-3, 3, m)]
    )
    P = np.outer([0.01, 0.01, 0.001], [0.01, 0.01, 0.001]) * a_covariance(rng, 3)
    room = _seen_from_door(_BAY, np.array(door))
    pairs = [_scan_from(rng, room, rng.multivariate_normal(p, P), 120) for p in poses]
    poses[1:, 0] += apart
    return np.round(poses, 9), P, *map(np.array, zip(*pairs, strict=True)), gate


def _straight(distance: float, tilt: float = 0.0) -> Any:
    """Return twelve points on a wall ahead, at this distance."""
    y = np.linspace(-1, 1, 12)
    return np.column_stack([distance + tilt * y, y])


# Two parts of a wall ahead with a niche between them, and a wall to the left.
_NICHE = np.vstack(
    [
        np.column_stack([np.full(12, 2.0), np.linspace(-1.2, -0.3, 12)]),
        np.column_stack([np.full(5, 2.4), np.linspace(-0.2, 0.2, 5)]),
        np.column_stack([np.full(12, 2.004), np.linspace(0.3, 1.2, 12)]),
        np.column_stack([np.linspace(1.9, 0.4, 14), np.full(14, 1.3)]),
    ]
)


def _one_wall_each(distances: Any, sigmas: Any = 0.01) -> Any:
    """Return scans from one place, each of a wall ahead at a distance of its own."""
    scans, P = [_straight(distance) for distance in distances], np.diag([0.02, 0.02, 0.001]) ** 2
    variances = np.outer(sigmas * np.ones(len(scans)), np.ones(12)) ** 2
    return np.zeros((len(scans), 3)), P, scans, variances, 13.8


def _named_as_found(found: Array, truth: Array) -> tuple[Array, Array]:
    """Errors (n, 2) from the nearest true wall, under the name that each has; and which it is."""
    error = found[:, None] - np.vstack([truth, truth * [-1, 1] + [0, np.pi]])
    error[..., 1] = wrap_angle(error[..., 1])
    nearest = np.abs(error / [0.1, 0.05]).max(-1).argmin(1)
    return error[np.arange(len(found)), nearest], nearest % len(truth)


def _ends(walls: Array, errors: Array, whose: Array, corners: Array) -> list[Array]:
    """Ends (2, 2) of each wall, as long as the true one, its errors ten times as large."""
    found = []
    for (r, alpha), j in zip(walls + 9 * errors, whose, strict=True):
        normal, along = np.array([np.cos(alpha), np.sin(alpha)]), [-np.sin(alpha), np.cos(alpha)]
        found.append(r * normal + np.outer(corners[[j - 1 if j else -2, j]] @ along, along))
    return found


def _room_map_drawn(ax: Any, function: Any) -> None:
    """Draw a room and its walls, errors enlarged tenfold: from each mark (thin) and from both."""
    from slamlab import plots

    room, corners = _seen_from_door(_BAY, _DOOR), _corners_of(_BAY) - _DOOR
    poses = np.array([[1.2, 0.2, 0.3], [-0.8, 0.8, 2.0]]) - [*_DOOR, 0.0]
    P, counts, squared = np.diag([0.01, 0.01, 0.001]) ** 2, [], []
    marks = {"dead_reckoning": slice(0, 1), "wrong": slice(1, 2), "estimate": slice(0, 2)}
    off: dict[str, list[Array]] = {kind: [] for kind in marks}
    lines: dict[str, list[Array]] = {}
    for k in range(60):
        rng = np.random.default_rng(k)
        robots = rng.multivariate_normal(np.zeros(3), P, 2) + poses
        pairs = [_scan_from(rng, room, robot, 180) for robot in robots]
        scans, variances = map(np.array, zip(*pairs, strict=True))
        for kind, of in marks.items():
            given = poses[of], P, scans[of], variances[of], 13.8
            found, covs = (np.asarray(one, float) for one in function(*given))
            errors, whose = _named_as_found(found, room)
            off[kind].append(errors[:, 0])
            lines.setdefault(kind, _ends(found, errors, whose, corners))
        counts.append(len(found))
        squared.append(np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covs), errors))
    plots.path(ax, corners, "truth", linewidth=6, alpha=0.25)
    for kind, width in (("dead_reckoning", 1.0), ("wrong", 1.0), ("estimate", 2.0)):
        for ends in lines[kind]:
            plots.path(ax, ends, kind, linewidth=width)
    for pose, kind in zip(poses, marks, strict=False):
        ax.plot(*pose[:2], "o", color=plots.COLOURS[kind], markersize=7)
    ax.plot(0, 0, "o", color=plots.COLOURS["truth"], markersize=4)
    plots.floor(ax)
    one, other, both = (100 * np.sqrt(np.mean(np.concatenate(e) ** 2)) for e in off.values())
    ax.set_title(
        f"60 maps: {np.mean(counts):.1f} walls, off {both:.1f} cm\n"
        f"(alone {one:.1f}, {other:.1f}); NEES {np.concatenate(squared).mean():.1f}",
        loc="left",
    )


check_room_map = Check(
    room_map,
    "found, covs",
    {
        "one scan: its walls in the world": _visits(1),
        "two scans of a room": _visits(2),
        "three scans": _visits(3, gate=9.0),
        "a room with its door, the origin, in a wall": _visits(3, _DOOR),
        "a narrow gate": _visits(2, gate=1.0),
        "walls that were somewhere else before": _visits(2, apart=0.5),
        "two walls of the map pass: the nearer is the same": _one_wall_each([2.0, 2.14, 2.08]),
        "two walls of the map pass: the nearer was there first": _one_wall_each([2.14, 2.0, 2.08]),
        "two walls of the map pass: the one farther off is the poorer": (
            _one_wall_each([2.0, 2.2, 2.09], [0.01, 0.1, 0.01])
        ),
        "a niche cuts a wall in two, in one scan: the map has it once": (
            [[1.0, -0.5, 0.3]],
            np.diag([0.02, 0.02, 0.001]) ** 2,
            [_NICHE],
            np.full((1, len(_NICHE)), 0.01**2),
            13.8,
        ),
        "a wall through the origin, turned a little to either side": (
            np.tile([-2.0, 0.0, 0.0], (3, 1)),
            np.diag([0.02, 0.02, 0.001]) ** 2,
            [_straight(2.01), _straight(1.99, 0.004), _straight(1.98, -0.006)],
            np.full((3, 12), 0.01**2),
            13.8,
        ),
        "scans without a wall": (
            np.zeros((2, 3)),
            0.01 * np.eye(3),
            [_straight(2.0)[:9]] * 2,
            np.full((2, 9), 0.01**2),
            13.8,
        ),
    },
    tolerance=1e-7,
    draws=4,
    picture=_room_map_drawn,
)


# %% tags=["mistakes"]
def _renamed(poses: Array, P: Array, scans: Array, variances: Array, gate: float) -> Any:
    found, covs = room_map(poses, P, scans, variances, gate)
    behind = found[:, 0] < 0
    covs[behind] *= [[1.0, -1.0], [-1.0, 1.0]]
    found[behind] = found[behind] * [-1, 1] + [0, np.pi]
    return np.column_stack([found[:, 0], wrap_angle(found[:, 1])]), covs


_LEVER = "J_wall @ C @ J_wall.T => C"
_SIGN = "cov * np.array([[1.0, -1.0], [-1.0, 1.0]]) => cov"
_as_handed_out = check_to_world.mistaken((_LEVER, _SIGN))
_without_lever, _without_sign = check_to_world.mistaken(_LEVER), check_to_world.mistaken(_SIGN)

check_room_map.mistakes = {
    "each scan brings its own walls: a wall that is in the map already is joined with it": (
        "if min(squared, default=np.inf) < gate: => if False:"
    ),
    "the wall at the door has its other name and is in the map twice": (
        "if abs(turn) <= np.pi / 2: => if True:"
    ),
    "with its other name a wall has another covariance: r turned its sign": (
        "return off, C * np.array([[1.0, -1.0], [-1.0, 1.0]]) => return off, C"
    ),
    "the difference of the directions is not wrapped": (
        "turn = wrap_angle(wall[1] - mean[1]) => turn = wall[1] - mean[1]"
    ),
    "the first wall that passes was taken: expected the nearest": (
        "k = np.argmin(squared) => k = next(i for i, s in enumerate(squared) if s < gate)"
    ),
    "the last wall that passes was taken: expected the nearest": (
        "k = np.argmin(squared) => k = max(i for i, s in enumerate(squared) if s < gate)"
    ),
    "the nearest in metres and radians was taken: expected the smallest squared distance": (
        "if min(squared, default=np.inf) < gate:"
        " => k = np.argmin([np.hypot(*d) for d, W in pairs] or [0])\n"
        "            if squared and squared[k] < gate:",
        "                k = np.argmin(squared)\n => ",
    ),
    "only walls of earlier scans were compared: the map so far has this scan's, too": (
        "for seen, C in zip => n = len(found)\n        for seen, C in zip",
        "for mean in found] => for mean in found[:n]]",
    ),
    "one scan alone is wrong, with exercise 4 as handed out: try `check_to_world` first": (
        "to_world(pose => _as_handed_out(pose"
    ),
    "one scan alone is wrong, and nothing was joined: try `check_to_world` first": (
        "to_world(pose => _as_handed_out(pose",
        "if min(squared, default=np.inf) < gate: => if False:",
    ),
    "one scan alone is wrong, a bug of exercise 4 is left: try `check_to_world` first": (
        "to_world(pose => _without_lever(pose"
    ),
    "one scan alone is wrong, one bug of exercise 4 is left: try `check_to_world` first": (
        "to_world(pose => _without_sign(pose"
    ),
    "both walls err: the squared distance is in units of C + M": (
        "np.linalg.solve(W + M, d) => np.linalg.solve(M, d)"
    ),
    "the wall in the map errs too: the squared distance is in units of C + M": (
        "np.linalg.solve(W + M, d) => np.linalg.solve(W, d)"
    ),
    "the gate is for the squared distance: no root": (
        "if min(squared, default=np.inf) < gate: => if min(squared, default=np.inf) < gate**2:"
    ),
    "the mean of both was taken: each is weighed with the inverse of its covariance": (
        "found[k] + K @ off => found[k] + off / 2"
    ),
    "the weights are exchanged: the better estimate counts more": (
        "found[k] + K @ off => found[k] + off - K @ off"
    ),
    "the wall in the map was replaced by the new one: both count": (
        "found[k] + K @ off => found[k] + off",
        "M - K @ M => W",
    ),
    "the wall in the map stayed as it was: the new one counts too": (
        "found[k], covs[k] = np.array([r, wrap_angle(alpha)]), M - K @ M => pass"
    ),
    "two estimates of a wall are better than one: its covariance stayed": "M - K @ M => M",
    "the covariances were added: information adds": "M - K @ M => M + W",
    "alpha of a joined wall is not in (-pi, pi]": (
        "np.array([r, wrap_angle(alpha)]) => np.array([r, alpha])"
    ),
    "a wall keeps the name it has in the map: r may come out a little below zero": _renamed,
    "the walls are as the robot saw them: place them in the world": (
        "wall, C = to_world(pose, P, seen, C) => wall = seen"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 6: two scans, one map
#
# The difference of two walls is taken under one name, and the covariance goes by that name, too:
# with $-r$ the corner element turns its sign, as in exercise 4. The rest is a gate and a Kalman
# update.

# %% [markdown] tags=["solution"]
# What is each of your pieces worth? The two marks of the picture and two hundred pairs of scans,
# with one change at a time:

# %% active="ipynb" tags=["solution"]
# DOOR = np.array([1.0, -1.5])
# NORMALS = np.column_stack([np.cos(ROOM[:, 1]), np.sin(ROOM[:, 1])])
# TRUTH = np.column_stack([ROOM[:, 0] - NORMALS @ DOOR, ROOM[:, 1]])
# MARKS = np.array([[0.2, 1.7, 0.3], [-1.8, 2.3, 2.0]])
# P = np.diag([0.01, 0.01, 0.001]) ** 2
#
# def scan_from(pose, rng):
#     x, y, heading = pose
#     beams = BEAMS[:, None] + heading - ROOM[:, 1]
#     ranges = (TRUTH[:, 0] - NORMALS @ [x, y]) / np.maximum(np.cos(beams), 1e-9)
#     ranges = ranges.min(1)
#     noise = 0.002 * ranges[:, None] ** 2 * rng.standard_normal((180, 2))
#     return ranges[:, None] * RAYS + noise, (0.002 * ranges**2) ** 2

# %% active="ipynb" tags=["solution"]
# def report_map(name, program, marks=slice(0, 2)):
#     counts, off, squared = [], [], []
#     for k in range(200):
#         rng = np.random.default_rng(k)
#         robots = rng.multivariate_normal(np.zeros(3), P, 2) + MARKS
#         scans, variances = zip(*(scan_from(robot, rng) for robot in robots))
#         found, covs = program(MARKS[marks], P, scans[marks], variances[marks], 13.8)
#         error = found[:, None] - np.vstack([TRUTH, TRUTH * [-1, 1] + [0, np.pi]])
#         error[..., 1] = wrap_angle(error[..., 1])
#         nearest = np.abs(error / [0.1, 0.05]).max(-1).argmin(1)
#         error = error[np.arange(len(found)), nearest]
#         counts.append(len(found))
#         off += error[:, 0].tolist()
#         squared += np.einsum("ni,nij,nj->n", error, np.linalg.inv(covs), error).tolist()
#     print(f"{name:21s} {np.mean(counts):4.1f} walls, r off by {rms(off):3.1f} cm "
#           f"(half of them below {100 * np.median(np.abs(off)):3.1f}), "
#           f"NEES {np.mean(squared):3.1f}")

# %% active="ipynb" tags=["solution"]
# report_map("the first mark alone", room_map, slice(0, 1))
# report_map("the second mark alone", room_map, slice(1, 2))
# report_map("both, joined", room_map)
# for name, old, new in (
#     ("nothing joined", "< gate", "< 0"),
#     ("one name only", "abs(turn) <= np.pi / 2", "True"),
#     ("C without the lever", "J_wall @ C @ J_wall.T", "C"),
#     ("the mean of both", "K @ off", "off / 2"),
# ):
#     report_map(name, changed([to_world, room_map], old, new))

# %% [markdown] tags=["solution"]
# From the first mark the walls on the left are far away, and $r$ is off by 3.1 cm; the second mark
# has them nearby. Joined, half of the errors are below 0.6 cm, where either mark alone has about 1
# cm. With one name only, the wall at the door is in about half of the maps twice. Without the
# lever, the first bug of exercise 4, the gate rejects right pairs, and the weights are wrong: 2.3
# cm and a NEES of 4.2. And the plain mean of both estimates has a larger RMS than the second mark
# alone: the poor one counts as much as the good one.

# %% [markdown] tags=["statement"]
# *What you have now*: a map that begins with raw points and holds five walls, each with a
# covariance that is nearly right. One thing it leaves out: all walls of one scan share the error
# of its pose. The EKF-SLAM of [chapter 09](../09_ekf_slam.ipynb) keeps that, and needs no marks on
# the floor.

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 07](../solutions/07_walls_from_points.ipynb).
