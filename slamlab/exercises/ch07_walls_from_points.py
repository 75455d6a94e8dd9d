"""Checks of chapter 07: a line, a corner, a covariance; walls from a scan and in the world.

P1 names "least squares" and "distances" and prints no formula; the chapter derives them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, drawn
from slamlab.exercises._report import Array, Check
from slamlab.geometry import wrap_angle

__all__ = ["check_corner", "check_line", "check_to_world", "check_wall_cov", "check_walls"]


# Exercise 1: a line by total least squares.


def _line(points: Array) -> tuple[float, float]:
    """Line (r, alpha), r not negative, of points (k, 2) by total least squares."""
    centre = points.mean(0)
    normal = np.linalg.svd(points - centre)[2][1]
    return _named(normal, centre)


def _named(normal: Array, centre: Array) -> tuple[float, float]:
    """R >= 0 and alpha in (-pi, pi] of the line through `centre` with this normal."""
    r = float(normal @ centre)
    if r < 0:
        r, normal = -r, -normal
    return r, float(np.arctan2(normal[1], normal[0]))


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


@drawn
def _wall(rng: np.random.Generator, r: float, alpha: float, k: int = 7) -> Any:
    normal = np.array([np.cos(alpha), np.sin(alpha)])
    along = rng.uniform(-1, 1.5, (k, 1)) * [-normal[1], normal[0]]
    return (np.round((r + rng.normal(0, 0.03, (k, 1))) * normal + along, 3),)


check_line = Check(
    _line,
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
    {
        "this is y = a x + b: it measures distances along y, so it knows which axis is x": (
            _ordinary
        ),
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
        "alpha is in degrees: radians are due": lambda p: (_line(p)[0], np.rad2deg(_line(p)[1])),
        "alpha is in [0, 2 pi): (-pi, pi] is due": (
            lambda p: (_line(p)[0], _line(p)[1] % (2 * np.pi))
        ),
        "r and alpha are exchanged: r comes first": lambda p: _line(p)[::-1],
    },
    tolerance=1e-8,
)


# Exercise 2: where to cut.


def _corner(points: Array) -> int:
    """Index of the point of (k, 2) that lies farthest from the chord between the ends."""
    u, d = points[-1] - points[0], points - points[0]
    return int(np.argmax(np.abs(u[0] * d[:, 1] - u[1] * d[:, 0])))


def _from_fit(points: Array) -> int:
    r, alpha = _line(points)
    return int(np.argmax(np.abs(points @ [np.cos(alpha), np.sin(alpha)] - r)))


def _sharpest(points: Array) -> int:
    legs = np.diff(points, axis=0)
    angles = np.arctan2(legs[:, 1], legs[:, 0])
    return 1 + int(np.argmax(np.abs((np.diff(angles) + np.pi) % (2 * np.pi) - np.pi)))


def _off(points: Array) -> Array:
    u, d = points[-1] - points[0], points - points[0]
    off: Array = np.abs(u[0] * d[:, 1] - u[1] * d[:, 0]) / np.hypot(*u)
    return off


def _stretch(rng: np.random.Generator) -> Any:
    k = int(rng.integers(3, 15))
    return (np.round(np.cumsum(rng.normal(0.2, 0.8, (k, 2)), 0) + rng.uniform(-20, 20, 2), 2),)


_BEND = np.array([[0, 0], [1, 0.02], [2, -0.01], [2.02, 1], [1.99, 2], [2, 3], [2, 4.0]])

check_corner = Check(
    _corner,
    "index",
    {
        "a corner to the right of the chord": (_BEND,),
        "the same corner to its left": (_BEND[:, ::-1],),
        "a short leg and a long one": ([[0, 0], [0.5, 0.0], [0.5, 0.5], [0.5, 1], [0.5, 4]],),
        "far from the origin, the other way round": (_BEND[::-1] + [30.0, -40.0],),
        "three points": ([[0, 0], [1, 2], [3, 0]],),
        "a chord along y": ([[1, 0], [1.5, 1], [0.2, 2], [1, 3]],),
        "any stretch": _stretch,
    },
    {
        "the distance has a sign: a corner on the other side of the chord was overlooked": (
            "np.abs( => ("
        ),
        "this is the distance from the fitted line, largest at an end: cut by the chord": (
            _from_fit
        ),
        "this is the distance from the first point: measure it from the chord": (
            lambda p: int(np.argmax(np.hypot(*(p - p[0]).T)))
        ),
        "this is the sharpest turn: the farthest from the chord is due": _sharpest,
        "this is the middle of the stretch": lambda p: len(p) // 2,
        "this is the point farthest from the middle of the points": (
            lambda p: int(np.argmax(np.hypot(*(p - p.mean(0)).T)))
        ),
        "the distance was taken along y: measure it across the chord": (
            "u[0] * d[:, 1] - u[1] * d[:, 0] => d[:, 1] - u[1] * np.arange(len(d)) / (len(d) - 1)"
        ),
        "this is the distance itself: the index of the point is due": lambda p: _off(p).max(),
        "off by one: the first point has index 0": lambda p: _corner(p) + 1,
        "this point lies nearest to the chord: the farthest is due": (
            lambda p: 1 + int(np.argmin(_off(p)[1:-1]))
        ),
        "counted among the inner points: the first point of the stretch has index 0": (
            lambda p: _corner(p) - 1
        ),
        "this is the point itself: its index is due": lambda p: p[_corner(p)],
    },
    draws=12,
)


# Exercise 3: how sure is a wall?


def _wall_cov(along: Array, variances: Array) -> Array:
    """Covariance (2, 2) of (r, alpha) from places along the wall and variances across it, (k,)."""
    t, middle = along, along.mean()
    row_alpha = -(t - middle) / np.sum((t - middle) ** 2)
    row_r = 1 / len(t) + middle * row_alpha
    J = np.stack([row_r, row_alpha])
    return (J * variances) @ J.T


def _points(rng: np.random.Generator) -> Any:
    k = int(rng.integers(2, 12))
    return np.round(rng.uniform(-3, 3, k) + rng.uniform(-4, 4), 2), np.round(rng.random(k), 3)


check_wall_cov = Check(
    _wall_cov,
    "cov",
    {
        "points around the perpendicular": (np.linspace(-1, 1, 5), [0.04] * 5),
        "points to one side of it": (np.linspace(1, 3, 9), [0.04] * 9),
        "to the other side": ([-5.0, -4.0, -2.5], [0.1, 0.3, 0.2]),
        "points without error": ([1.0, 2.0, 4.0], [0.0, 0.0, 0.0]),
        "unequal points": _points,
    },
    {
        "r and alpha err together: the corner elements are not zero": (
            lambda t, w: _wall_cov(t, w) * np.eye(2)
        ),
        "the correlation has the wrong sign: a point beyond the middle turns the normal back": (
            lambda t, w: _wall_cov(t, w) * [[1, -1], [-1, 1]]
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
        "the roots of the variances were used: the variances themselves are due": (
            "J * variances => J * np.sqrt(variances)"
        ),
        "this does not shrink with more points: the average of k errors has 1/k of it": (
            lambda t, w: _wall_cov(t, w) * len(t)
        ),
        "the variances are not used: each error counts with its own": "J * variances => J",
        "alpha comes second: rows and columns are r, alpha": (
            "[row_r, row_alpha] => [row_alpha, row_r]"
        ),
        "S is a sum of squares, not their mean": "np.sum((t - middle) ** 2) => t.var()",
    },
)


# Exercise 4: the wall in the world, with bugs.


def _to_world(pose: Array, P: Array, wall: Array, C: Array) -> tuple[Array, Array]:
    """Wall (r, alpha) in the world and its covariance (2, 2), seen from a pose with covariance P.

    The wall as seen has the covariance C; pose and wall err independently.
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


check_to_world = Check(
    _to_world,
    "wall, cov",
    {
        "a robot at the origin": _sighting(home=True),
        "a robot that knows where it is": _sighting(doubt=0.0),
        "a wall seen without error": _sighting(haze=0.0),
        "a wall between the robot and the origin": _beyond,
        "any pose, any wall": _sighting(),
    },
    {
        "C needs its lever: who errs about alpha from far away errs about r": (
            "J_wall @ C @ J_wall.T => C"
        ),
        "the wall has its other name, its covariance has not: r turned its sign, alpha did not": (
            "cov * np.array([[1.0, -1.0], [-1.0, 1.0]]) => cov"
        ),
        "r is negative: the same wall is (-r, alpha + pi)": "if r < 0: => if False:",
        "r was made positive, alpha was not turned by half a turn": (
            "-r, alpha + np.pi => -r, alpha"
        ),
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
        "the doubt about the pose is missing": "J_pose @ P @ J_pose.T +  => ",
        "the wall's own doubt is missing": " + J_wall @ C @ J_wall.T => ",
        "the lever is missing in the pose's part: a turn of the robot swings the wall": (
            "[c, s, lever] => [c, s, 0.0]"
        ),
        "the lever has the wrong sign: it is the derivative of r by alpha": (
            "pose[1] * c - pose[0] * s => pose[0] * s - pose[1] * c"
        ),
        "the doubt about the heading does not reach alpha": "[0.0, 0.0, 1.0]] => [0.0] * 3]",
    },
    tolerance=1e-6,
)


# Exercise 5: walls of a scan, assembled.


def _walls(points: Array, variance: float, threshold: float, fewest: int) -> tuple[Array, Array]:
    """Walls (n, 2) of a stretch of points and their covariances (n, 2, 2), by splitting."""
    if len(points) < fewest:
        return np.zeros((0, 2)), np.zeros((0, 2, 2))
    r, alpha = _line(points)
    normal, along = np.array([np.cos(alpha), np.sin(alpha)]), [-np.sin(alpha), np.cos(alpha)]
    if np.abs(points @ normal - r).max() <= threshold:
        places = points @ np.array(along)
        return np.array([[r, alpha]]), _wall_cov(places, np.full(len(points), variance))[None]
    cut = _corner(points)
    first = _walls(points[:cut], variance, threshold, fewest)
    second = _walls(points[cut:], variance, threshold, fewest)
    return np.vstack([first[0], second[0]]), np.concatenate([first[1], second[1]])


def _by_the_chord(points: Array, variance: float, threshold: float, fewest: int) -> Any:
    """Ask the chord, not the fitted line, whether all points lie on one wall."""
    if len(points) >= max(fewest, 3) and _off(points).max() > threshold:
        cut = _corner(points)
        parts = [_by_the_chord(p, variance, threshold, fewest) for p in np.split(points, [cut])]
        return np.vstack([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
    return _walls(points, variance, np.inf, fewest)


def _cut_once(points: Array, variance: float, threshold: float, fewest: int) -> Any:
    if len(_walls(points, variance, threshold, fewest)[0]) < 2:
        return _walls(points, variance, threshold, fewest)
    parts = [_walls(p, variance, np.inf, fewest) for p in np.split(points, [_corner(points)])]
    return np.vstack([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


@drawn
def _outline(rng: np.random.Generator, *sizes: int) -> Any:
    """Draw a scan along walls with so many points each, and how to cut it."""
    heading, corner, stretches = rng.uniform(-3, 3), rng.uniform(-3, 3, 2), []
    for size in sizes:
        d = np.array([np.cos(heading), np.sin(heading)])
        stretches.append(corner + 0.2 * np.arange(size)[:, None] * d)
        corner = stretches[-1][-1] + 0.2 * d
        heading += rng.choice([-1, 1]) * rng.uniform(1.0, 1.6)
    points = np.vstack(stretches) + rng.normal(0, 0.01, (sum(sizes), 2))
    variance = float(np.round(rng.uniform(1e-4, 1e-2), 5))
    return np.round(points, 4), variance, float(np.round(rng.uniform(0.04, 0.06), 3)), 4


_ANGLE = np.array([[0, 1], [1, 1], [2, 1], [3, 1], [4, 1.0], [4, 2], [4, 3], [4, 4], [4, 5]])

check_walls = Check(
    _walls,
    "walls, covs",
    {
        "one wall": _outline(9),
        "two walls": _outline(9, 11),
        "four walls": _outline(8, 12, 7, 9),
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
        "too few points for any wall": ([[0.0, 1.0], [1.0, 1.0], [2.0, 1.0]], 0.01, 0.1, 4),
    },
    {
        "nothing was cut: one line goes through all points": (
            ".max() <= threshold => .max() >= 0"
        ),
        "cut once only: ask the same of both pieces": _cut_once,
        "the chord decided: the distance from the fitted line is due": _by_the_chord,
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
        "only the first pieces came: the second ones hold walls too": (
            "np.vstack([first[0], second[0]]), np.concatenate([first[1], second[1]]) => first"
        ),
        "the walls came in the order of the last: the first points make the first wall": (
            "[first[0], second[0]]), np.concatenate([first[1], second[1]])"
            " => [second[0], first[0]]), np.concatenate([second[1], first[1]])"
        ),
        "places along the wall grow along (-sin, cos): the corner elements have the wrong sign": (
            "[-np.sin(alpha), np.cos(alpha)] => [np.sin(alpha), -np.cos(alpha)]"
        ),
        "places along the wall were counted from the middle: count from the foot": (
            "_wall_cov(places, => _wall_cov(places - places.mean(),"
        ),
        "places along the wall were counted from its first point: count from the foot": (
            "_wall_cov(places, => _wall_cov(places - places[0],"
        ),
    },
    tolerance=1e-7,
    draws=8,
)
