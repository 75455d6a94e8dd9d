"""Lab V, SLAM from scratch: the properties of its eight steps, and what becomes of the cells.

A step is checked by what its functions do, never by comparison with ours. `check` takes the
namespace of the notebook or a module; `save_file` joins the numbered cells to one file.
"""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.evaluation.consistency import pose_errors
from slamlab.exercises._report import NOTHING_YET, Report, Row
from slamlab.exercises._values import is_stub
from slamlab.geometry import inverse_transform

__all__ = ["STEPS", "NotWritten", "Own", "check", "save_file"]

Outcome = tuple[bool, str]
Property = Callable[["Own", np.random.Generator], Outcome]
STEPS = {
    1: ("Poses", ("wrap", "compose", "between", "rotation", "transform")),
    2: ("Points", ("voxel_downsample", "scan_points")),
    3: ("Point-to-line ICP", ("estimate_normals", "local_map", "icp")),
    4: ("Search by FFT", ("likelihood_field", "search")),
    5: ("Front end", ("propagate", "track")),
    6: ("Loop closures", ("candidates", "verify", "is_consistent")),
    7: ("Pose graph", ("residuals", "solve", "optimize")),
    8: ("Occupancy map", ("occupancy",)),
}
_PROPERTIES: dict[int, list[tuple[str, str, Property]]] = {step: [] for step in STEPS}


class NotWritten(Exception):
    """A function that a step needs is not there, or returns nothing yet."""


class Own:
    """The student's functions and constants by name, from a module or a namespace.

    Parameters
    ----------
    source : module or mapping of str to object
    """

    def __init__(self, source: ModuleType | Mapping[str, Any]) -> None:
        self._names = dict(vars(source)) if isinstance(source, ModuleType) else dict(source)

    def __getattr__(self, name: str) -> Any:
        """Return a constant, or a function that raises NotWritten where it returns nothing."""
        if name not in self._names:
            raise NotWritten(f"{name} is not defined")
        value = self._names[name]
        if not callable(value) or name == "verify":  # None is an answer of verify
            return value

        def call(*args: Any, **kwargs: Any) -> Any:
            result = value(*args, **kwargs)
            if result is None:
                raise NotWritten(name)
            return result

        return call

    def unwritten(self) -> list[str]:
        """Return which functions of the steps are missing, or are stubs of one docstring."""
        names = [name for _, functions in STEPS.values() for name in functions]
        return [name for name in names if name not in self._names or is_stub(self._names[name])]


def check(step: int, own: ModuleType | Mapping[str, Any]) -> Report:
    """Try the properties of one step on the functions that the student wrote so far.

    Parameters
    ----------
    step : int
        1 to 8.
    own : module or mapping
        `globals()` of the notebook.

    Returns
    -------
    Report
        One row a property; where it fails, what was returned and the likeliest reason. Never
        raises for what the functions do.

    Examples
    --------
    >>> check(1, {})
    Lab V, step 1, Poses: 0 of 6 properties hold
      -> nothing returned yet: replace the `...` by your own lines and run the cell again
    """
    if step not in STEPS:
        raise ValueError(f"step: expected a whole number from 1 to 8, got {step!r}")
    rows, unwritten = [], 0
    student = Own(own)
    for name, hint, holds in _PROPERTIES[step]:
        try:
            with np.errstate(all="ignore"):
                ok, came = holds(student, np.random.default_rng(0))
            lines = () if ok else tuple(line for line in (came, hint) if line)
        except NotWritten as error:
            ok, lines, unwritten = False, (f"not written yet: {error}",), unwritten + 1
        except Exception as error:
            ok, lines = False, (_raised(error),)
        rows.append(Row(name, bool(ok), lines))
    messages = (NOTHING_YET,) if unwritten == len(rows) else ()
    return Report(f"Lab V, step {step}, {STEPS[step][0]}", tuple(rows), messages)


def _raised(error: Exception) -> str:
    """Say what was raised, and in which of the student's functions."""
    frames = traceback.extract_tb(error.__traceback__)
    written = {name for _, names in STEPS.values() for name in names}
    inside = [frame for frame in frames if frame.name in written]
    where = f" in {inside[-1].name}, line {inside[-1].lineno} of its cell" if inside else ""
    return f"raised {type(error).__name__}: {str(error)[:100]}{where}"


def save_file(path: str | Path, cells: Iterable[str]) -> Path:
    """Join the numbered cells of the lab to one Python file, each in its newest version.

    Parameters
    ----------
    path : str or Path
        For example "my_slam.py".
    cells : iterable of str
        `In` of the notebook. A cell counts if its first line is ``# N. ...``, with N from 0 to 9.

    Returns
    -------
    Path

    Raises
    ------
    ValueError
        If a number from 0 to 9 is missing.
    """
    newest = {}
    for cell in cells:
        if number := re.match(r"# (\d)\. ", cell):
            newest[int(number[1])] = cell.strip()
    missing = sorted(set(range(10)) - set(newest))
    if missing:
        raise ValueError(f"cells: expected cells # 0. to # 9. to have been run, got no {missing}")
    path = Path(path)
    text = "\n\n\n".join(newest[number] for number in sorted(newest))
    path.write_text(text + "\n", encoding="utf-8")
    return path


def _property(step: int, name: str, hint: str = "") -> Callable[[Property], Property]:
    """Add a property to a step; `hint` is read where it fails."""

    def add(function: Property) -> Property:
        _PROPERTIES[step].append((name, hint, function))
        return function

    return add


# Places to try on.


def room(n: int = 400, w: float = 8.0, h: float = 5.0) -> Array:
    """Points (n, 2) on the walls of a room with a niche; nothing in it is symmetric."""
    t = np.linspace(0, 1, n // 4)
    corners = np.array([(0, 0), (w, 0), (w, 3), (w - 2, 3), (w - 2, h), (0, h)], float)
    sides = zip(corners, np.roll(corners, -1, 0), strict=True)
    return np.vstack([np.outer(1 - t, a) + np.outer(t, b) for a, b in sides]) - [2.0, 1.5]


def corridor(length: float = 20.0) -> Array:
    """Points (800, 2) on two parallel walls, 2 m apart, open at both ends."""
    x = np.linspace(-length / 2, length / 2, 400)
    return np.vstack([np.stack([x, 0 * x + 1], -1), np.stack([x, 0 * x - 1], -1)])


def _poses(n: int, rng: np.random.Generator) -> Array:
    return np.column_stack([rng.normal(size=(n, 2)) * 3, rng.uniform(-np.pi, np.pi, n)])


def _off(pose: Array, true: Array) -> Array:
    """Return absolute errors of a pose, the heading wrapped."""
    return np.abs(pose_errors(pose, true))


def _said(name: str, value: Any) -> str:
    return (
        f"{name} = {np.array2string(np.asarray(value, float), precision=3, suppress_small=True)}"
    )


# 1. Poses.


@_property(1, "angles come back in [-pi, pi)", "use %, and shift by pi before and after")
def _wrapped(m: Own, rng: np.random.Generator) -> Outcome:
    given = np.array([np.pi + 0.1, -np.pi - 0.1, 7.0, 0.5])
    came = m.wrap(given)
    expected = np.array([0.1 - np.pi, np.pi - 0.1, 7.0 - 2 * np.pi, 0.5])
    return np.allclose(came, expected), _said("wrap([pi + 0.1, -pi - 0.1, 7, 0.5])", came)


@_property(1, "ahead is along the heading", "b is turned by the heading of a, then added to a")
def _ahead(m: Own, rng: np.random.Generator) -> Outcome:
    came = m.compose([0, 0, np.pi / 2], [1.0, 0, 0])
    return np.allclose(came, [0, 1, np.pi / 2]), _said("compose((0, 0, pi/2), (1, 0, 0))", came)


@_property(1, "compose is associative, and its headings are wrapped", "does b turn with a?")
def _associative(m: Own, rng: np.random.Generator) -> Outcome:
    a, b, c = _poses(50, rng), _poses(50, rng), _poses(50, rng)
    left, right = m.compose(m.compose(a, b), c), m.compose(a, m.compose(b, c))
    wrapped = (np.abs(left[:, 2]) <= np.pi + 1e-12).all()
    gap = _off(left, right).max()
    return gap < 1e-9 and wrapped, _said("largest gap", gap)


@_property(1, "compose(a, between(a, b)) is b", "the difference must be seen in the frame of a")
def _undone(m: Own, rng: np.random.Generator) -> Outcome:
    a, b = _poses(50, rng), _poses(50, rng)
    gap = _off(m.compose(a, m.between(a, b)), b).max()
    return gap < 1e-9, _said("largest gap", gap)


@_property(1, "rotation(angle) turns a pose about the origin", "the heading entry is 1")
def _turns(m: Own, rng: np.random.Generator) -> Outcome:
    came = m.rotation(0.3) @ [2.0, -1.0, 0.4]
    c, s = np.cos(0.3), np.sin(0.3)
    ok = np.allclose(came, [2 * c + s, 2 * s - c, 0.4])
    return ok, _said("rotation(0.3) @ (2, -1, 0.4)", came)


@_property(1, "points move as poses do", "points are rows: multiply by the transpose")
def _carried(m: Own, rng: np.random.Generator) -> Outcome:
    (a, b), p = _poses(2, rng), rng.normal(size=(7, 2))
    came, expected = m.transform(m.compose(a, b), p), m.transform(a, m.transform(b, p))
    ahead = m.transform(np.array([1.0, 2.0, np.pi / 2]), np.array([[1.0, 0.0]]))
    gap = np.abs(came - expected).max()
    ok = gap < 1e-9 and np.allclose(ahead, [[1, 3]])
    return ok, _said("transform((1, 2, pi/2), [(1, 0)])", ahead)


# 2. Points.


@_property(2, "the first beam is the first angle", "x is r cos(a), y is r sin(a)")
def _beams(m: Own, rng: np.random.Generator) -> Outcome:
    came = m.scan_points(np.array([1.0, 2.0, np.inf]), np.deg2rad([-90, 0, 90]))
    ok = came.shape == (2, 2) and np.allclose(sorted(map(tuple, came.round(9))), [(0, -1), (2, 0)])
    return ok, _said("1 m to the right, 2 m ahead, nothing to the left", came)


@_property(2, "beams that met nothing are no points", "NaN, 0 and what is too far must go")
def _no_points(m: Own, rng: np.random.Generator) -> Outcome:
    came = m.scan_points(np.array([np.nan, 100.0, 0.0]), np.deg2rad([-90, 0, 90]))
    return len(came) == 0, f"{len(came)} points from NaN, 100 m and 0 m"


@_property(2, "each cell keeps one point, also left of the origin", "floor, do not truncate")
def _cells(m: Own, rng: np.random.Generator) -> Outcome:
    q = rng.uniform(-3, 3, (4000, 2))
    t = m.voxel_downsample(q, 0.5)
    kept = len(np.unique(np.floor(t / 0.5).astype(int), axis=0))
    cells = len(np.unique(np.floor(q / 0.5).astype(int), axis=0))
    return kept == len(t) == cells, f"{len(t)} points in {kept} of {cells} cells"


@_property(2, "points are kept, not invented", "take one of the points, not the cell's centre")
def _kept(m: Own, rng: np.random.Generator) -> Outcome:
    q = rng.uniform(-3, 3, (400, 2))
    t = m.voxel_downsample(q, 0.5)
    new = sum(not (x == q).all(1).any() for x in t)
    return new == 0, f"{new} of {len(t)} points were not among those given"


# 3. Point-to-line ICP.

_LOOSE = np.diag([1, 1, 0.3]) ** 2


def _walls(rng: np.random.Generator) -> Array:
    points = room()
    return points + 0.002 * rng.normal(size=points.shape)


def _submap(m: Own, points: Array, pose: Iterable[float] = (0.0, 0.0, 0.0)) -> Any:
    return m.local_map([(points, m.estimate_normals(points))], np.array([tuple(pose)]))


@_property(
    3, "normals have length one and stand across the walls", "smallest eigenvalue, not largest"
)
def _across(m: Own, rng: np.random.Generator) -> Outcome:
    turned = np.array([0.0, 0.0, 0.5])
    n = m.estimate_normals(inverse_transform(turned, _walls(rng)))
    walls = np.isfinite(n[:, 0])
    # The sides of the room, in order, run along x, y, x, y, x, y.
    side = np.eye(2)[np.arange(len(n)) // 100 % 2]
    along = np.abs((n * inverse_transform(turned, side)).sum(1))[walls]
    across = (along < 0.25).mean()
    ok = walls.mean() > 0.8 and np.allclose(np.hypot(*n[walls].T), 1) and across > 0.9
    have = f"{100 * walls.mean():.0f} % have a normal"
    return ok, f"{have}, {100 * across:.0f} % of these are across"


@_property(3, "a cloud has no normals", "a line has one small and one large eigenvalue")
def _cloud(m: Own, rng: np.random.Generator) -> Outcome:
    n = m.estimate_normals(rng.uniform(0, 4, (600, 2)))
    none = np.isnan(n[:, 0]).mean()
    return none > 0.5, f"{100 * (1 - none):.0f} % of a cloud were taken for walls"


@_property(3, "normals turn with their keyframe and do not shift", "a normal is a direction")
def _directions(m: Own, rng: np.random.Generator) -> Outcome:
    walls, there = _walls(rng), np.array([1.0, 2.0, 0.7])
    own = m.estimate_normals(walls)
    _, placed, _ = _submap(m, walls, there)
    again = m.estimate_normals(m.transform(there, walls))[np.isfinite(own[:, 0])]
    along = np.abs((placed * again).sum(1))
    ok = np.allclose(along, 1, atol=0.02)
    return ok, _said("smallest cosine to the wall's normal", along.min())


def _matched(m: Own, true: Array, change: Callable[[Array], Array], rng: Any) -> Array:
    """Errors of a match in the room; `change` spoils the scan, in the robot's frame."""
    submap = _submap(m, _walls(rng))
    scan = change(m.voxel_downsample(inverse_transform(true, room()), 0.15))
    return _off(m.icp(submap, scan, np.zeros(3), _LOOSE)[0], true)


_PLACES = (np.array([0.2, -0.15, 0.05]), np.array([-0.1, 0.2, -0.08]))


@_property(3, "in a room the pose is found to 1 cm", "sign of the step; lever arm of the heading")
def _found(m: Own, rng: np.random.Generator) -> Outcome:
    worst = max(_matched(m, true, lambda scan: scan, rng).max() for true in _PLACES)
    return worst < 0.01, _said("largest error", worst)


@_property(3, "a fifth of near outliers moves it less than 2 cm", "weigh by the robust kernel")
def _robust(m: Own, rng: np.random.Generator) -> Outcome:
    def near(scan: Array) -> Array:
        scan = scan.copy()
        scan[::5] += 0.13
        return scan

    def far(scan: Array) -> Array:
        scan = scan.copy()
        scan[::4] += [0.35, 0.3]
        return scan

    worst = max(_matched(m, true, bad, rng).max() for true in _PLACES for bad in (near, far))
    return worst < 0.02, _said("largest error", worst)


@_property(3, "50 m from the origin it is the same", "turn about the robot, not about the origin")
def _elsewhere(m: Own, rng: np.random.Generator) -> Outcome:
    away, true = np.array([50.0, -30.0, 0.0]), _PLACES[1]
    submap = _submap(m, _walls(rng), away)
    scan = m.voxel_downsample(inverse_transform(true, room()), 0.15)
    worst = _off(m.icp(submap, scan, away, _LOOSE)[0], away + true).max()
    return worst < 0.01, _said("largest error", worst)


@_property(3, "a certain guess stays", "the prior belongs into H and into the right side")
def _prior(m: Own, rng: np.random.Generator) -> Outcome:
    scan = m.voxel_downsample(inverse_transform(_PLACES[0], room()), 0.15)
    x, _, _ = m.icp(_submap(m, _walls(rng)), scan, np.zeros(3), np.eye(3) * 1e-6)
    return np.abs(x).max() < 0.01, _said("moved by", x)


@_property(
    3,
    "along a corridor the guess stays, and the covariance says so",
    "no wall measures the way along: only the prior does",
)
def _along(m: Own, rng: np.random.Generator) -> Outcome:
    hall, guess = _submap(m, corridor()), np.array([0.3, 0.15, 0.04])
    x, cov, _ = m.icp(hall, corridor(6.0)[::4], guess, np.diag([0.2, 0.2, 0.1]) ** 2)
    ok = np.abs(x[1:]).max() < 0.01 and abs(x[0] - 0.3) < 0.03
    sure = 0.02 < cov[0, 0] < 0.042 and cov[1, 1] < 0.01
    return ok and sure, f"{_said('pose', x)}, {_said('variances', np.diag(cov))}"


@_property(
    3, "across +-pi the heading is found", "x - guess of the prior needs no wrap, the result does"
)
def _seam(m: Own, rng: np.random.Generator) -> Outcome:
    k = np.pi - 0.02
    scan = m.voxel_downsample(inverse_transform(np.array([0, 0, k]), room()), 0.15)
    guess = np.array([0.0, 0.0, -k])
    x, _, _ = m.icp(_submap(m, _walls(rng)), scan, guess, np.diag([0.5, 0.5, 0.2]) ** 2)
    ok = _off(x, np.array([0, 0, k]))[2] < 0.01 and abs(x[2]) <= np.pi + 1e-9
    return ok, _said("heading", x[2])


# 4. Search by FFT.


@_property(4, "the field is a Gaussian one cell wide", "distance in cells, exp(-d^2 / 2)")
def _gaussian(m: Own, rng: np.random.Generator) -> Outcome:
    line = np.stack([np.linspace(-9, 9, 400), np.zeros(400)], -1)
    came = m.likelihood_field(line, np.zeros(2), 5.0, 0.1)[50, [50, 51, 52]]
    return np.allclose(came, np.exp([0, -0.5, -2])), _said("on the wall and beside it", came)


@_property(4, "it is one at the walls and zero at its edge", "make it wide enough")
def _edge(m: Own, rng: np.random.Generator) -> Outcome:
    field = m.likelihood_field(room(), np.zeros(2), 12.0, 0.1)
    largest, edge = field.max(), field[0].max()
    return largest == 1 and edge < 1e-3, _said("largest, at the edge", [largest, edge])


_FAR = np.array([1.8, -1.0, 0.2618])


def _searched(m: Own) -> tuple[Array, Any]:
    scan = m.voxel_downsample(inverse_transform(_FAR, room()), 0.2)
    return scan, m.search(room(), scan, np.zeros(3), 2.5, np.deg2rad(20))


@_property(4, "a pose 2 m and 15 degrees off is found to a cell", "shift back: roll by the radius")
def _window(m: Own, rng: np.random.Generator) -> Outcome:
    _, (x, score, second) = _searched(m)
    off = _off(x, _FAR)
    ok = np.hypot(*off[:2]) < 0.25 and off[2] < np.deg2rad(1.6) and second < 0.8 < 0.1 + score
    return ok, f"{_said('error', off)}, score {score:.2f}, second {second:.2f}"


@_property(
    4, "the score is the mean of the field under the points", "divide by the number of points"
)
def _sum(m: Own, rng: np.random.Generator) -> Outcome:
    scan, (x, score, _) = _searched(m)
    half = np.hypot(*scan.T).max() + 2.5
    field = m.likelihood_field(room(), np.zeros(2), half, 0.1)
    mean = field[tuple(np.floor((m.transform(x, scan) + half) / 0.1).astype(int).T)].mean()
    return abs(score - mean) < 1e-3, f"score {score:.3f}, mean under the points {mean:.3f}"


@_property(
    4, "what leaves on one side does not come in on the other", "pad by the reach of the scan"
)
def _wrap_around(m: Own, rng: np.random.Generator) -> Outcome:
    y = np.linspace(-0.5, 0.5, 20)
    here, there = np.stack([0 * y + 5.0, y], -1), np.stack([0 * y - 4.6, y], -1)
    score = m.search(there, here, np.zeros(3), 2.5, 0.05)[1]
    return score < 0.3, f"score {score:.2f} where nothing fits"


@_property(
    4, "a corridor has a second peak, a room has none", "mask what is near the best, in metres"
)
def _second(m: Own, rng: np.random.Generator) -> Outcome:
    *_, hall = m.search(corridor(40), corridor(6.0)[::4], np.zeros(3), 2.5, np.deg2rad(20))
    *_, other = _searched(m)[1]
    return hall > 0.95 and other < 0.8, f"corridor {hall:.2f}, room {other:.2f}"


@_property(4, "peaks count from SECOND_PEAK_DISTANCE on", "cells times their side are metres")
def _apart(m: Own, rng: np.random.Generator) -> Outcome:
    scan, shares = m.voxel_downsample(room(), 0.2), []
    for shift in (0.6, 1.2):
        double = np.concatenate([room(), room() + [shift, 0.0]])
        shares.append(m.search(double, scan, np.zeros(3), 2.0, 0.05)[2])
    came = f"a copy 0.6 m aside: {shares[0]:.2f}, 1.2 m aside: {shares[1]:.2f}"
    return shares[0] < 0.9 < shares[1], came


# 5. Front end.


@_property(
    5, "the covariance is that of 40 000 sampled poses", "F turns an error of the heading aside"
)
def _spread(m: Own, rng: np.random.Generator) -> Outcome:
    x, cov = np.array([1.0, 2.0, 0.7]), np.diag([0.04, 0.01, 0.02]) * 0.01
    u, Q = np.array([0.5, 0.1, 0.2]), np.diag([0.01, 0.002, 0.003]) * 0.01
    steps = rng.multivariate_normal(u, Q * m.ODOMETRY_INFLATION, 40000)
    sampled = np.cov(m.compose(rng.multivariate_normal(x, cov, 40000), steps).T)
    y, P = m.propagate(x, cov, u, Q)
    gap = np.abs(P - sampled).max() / sampled.max()
    ok = np.allclose(y, m.compose(x, u)) and gap < 0.05
    return ok, f"off by {100 * gap:.0f} % of the largest entry"


_SPREAD = np.diag([0.3, 0.3, 0.1]) ** 2


@_property(
    5, "a guess 1.3 m off is searched for", "a poor fit of ICP asks for a search, then ICP again"
)
def _searches(m: Own, rng: np.random.Generator) -> Outcome:
    true = np.array([-0.9, 0.9, 0.25])
    scan = m.voxel_downsample(inverse_transform(true, room()), 0.15)
    y, _ = m.track(_submap(m, room()), scan, np.zeros(3), _SPREAD)
    return _off(y, true).max() < 0.03, _said("error", _off(y, true))


@_property(5, "a scan that fits nowhere changes nothing", "give guess and covariance back")
def _nowhere(m: Own, rng: np.random.Generator) -> Outcome:
    noise = rng.uniform(-1.8, 3.3, (100, 2))
    y, P = m.track(_submap(m, room()), noise, np.zeros(3), _SPREAD)
    ok = np.allclose(y, 0) and P[0, 0] >= 0.089
    return ok, f"{_said('pose', y)}, {_said('variances', np.diag(P))}"


# 6. Loop closures.


def two_laps(m: Own, n: int = 40, r: float = 8.0) -> tuple[Array, Array, Array]:
    """Return true poses of a circle driven twice, drifted ones, and the path length at each."""
    t = np.arange(n) * 4 * np.pi / n
    true = np.column_stack([r * np.sin(t), r * (1 - np.cos(t)), m.wrap(t)])
    drifted = [true[0]]
    for step in m.between(true[:-1], true[1:]):
        drifted.append(m.compose(drifted[-1], step + [0.02, 0, 0.01]))
    path = np.array(drifted)
    return true, path, np.r_[0, np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))]


def _swaying(m: Own) -> tuple[Array, Array, Array]:
    """Two laps, every other pose 1 m aside: moves along one circle would commute."""
    true, drifted, travel = two_laps(m)
    aside = np.zeros((len(true), 3))
    aside[::2, 1] = 1.0
    return m.compose(true, aside), m.compose(drifted, aside), travel


@_property(
    6, "only old places are candidates", "old: MIN_LOOP of path ago; the radius has a maximum"
)
def _old(m: Own, rng: np.random.Generator) -> Outcome:
    _, path, travel = _swaying(m)
    k = len(path) // 2 + 5
    old, radius = m.candidates(k, path, travel, 100.0)
    youngest = min((travel[k] - travel[j] for j in old), default=np.nan)
    ok = bool(old) and youngest >= m.MIN_LOOP and radius <= m.MAX_RADIUS
    young = f"the youngest {youngest:.1f} m of path ago"
    return ok, f"{len(old)} candidates, {young}, radius {radius:.1f} m"


@_property(6, "at the start there is none", "no place is old yet")
def _none_yet(m: Own, rng: np.random.Generator) -> Outcome:
    _, path, travel = _swaying(m)
    old = m.candidates(8, path, travel, 100.0)[0]
    return not old, f"{len(old)} candidates after {travel[8]:.1f} m"


def _closures(m: Own) -> tuple[Any, ...]:
    true, path, travel = _swaying(m)
    lap = len(true) // 2 + 2

    def closure(j: int, off: tuple[float, ...] = (0, 0, 0)) -> tuple[Any, ...]:
        return j, j + lap, m.between(true[j], true[j + lap]) + off, np.eye(3) * 1e-3, 0.9

    return [closure(j) for j in (3, 4, 5)], closure(4, (2.0, 0, 0)), path, travel


@_property(
    6,
    "three closures that agree are accepted",
    "order of composition: first z, then along the path",
)
def _agree(m: Own, rng: np.random.Generator) -> Outcome:
    good, outlier, path, travel = _closures(m)
    came = [bool(m.is_consistent(one, [*good, outlier], path, travel)) for one in good]
    return all(came), f"accepted: {came}"


@_property(
    6,
    "an outlier and a lone pair are not",
    "MIN_CONSISTENT others must agree, and half of those near",
)
def _refused(m: Own, rng: np.random.Generator) -> Outcome:
    good, outlier, path, travel = _closures(m)
    alone = m.is_consistent(good[0], good[:2], path, travel)
    came = m.is_consistent(outlier, [*good, outlier], path, travel)
    return not came and not alone, f"outlier accepted: {bool(came)}, pair accepted: {bool(alone)}"


@_property(6, "a place in a room is verified, one in a corridor is not", "two peaks: return None")
def _verified(m: Own, rng: np.random.Generator) -> Outcome:
    steps = np.column_stack(
        [np.linspace(0, 1.2, 7), np.linspace(0, 0.4, 7), np.linspace(0, 0.3, 7)]
    )
    true = np.vstack([steps, steps + [0.2, 0.3, 0.1]])
    drift = np.array([0.6, -0.4, 0.1])
    believed = np.vstack([steps, m.compose(drift, true[7:])])
    travel = np.append(0.2 * np.arange(7), 30 + 0.2 * np.arange(7))
    outcome, off = [], np.nan
    for points, reach in ((room(), 20.0), (corridor(40.0), 7.0)):
        nodes = []
        for pose in true:
            scan = inverse_transform(pose, points)
            scan = m.voxel_downsample(scan[np.hypot(*scan.T) < reach], 0.1)
            nodes.append((scan, m.estimate_normals(scan)))
        came = m.verify(3, 10, 2.5, nodes, believed, travel)
        outcome.append(came is not None)
        if came is not None and reach == 20.0:
            off = _off(came[2], m.between(true[3], true[10])).max()
    return outcome == [True, False] and off < 0.05, (
        f"room verified: {outcome[0]} (off by {off:.3f}), corridor verified: {outcome[1]}"
    )


# 7. Pose graph.


@_property(
    7, "derivatives agree with differences", "four blocks; the heading of i turns the difference"
)
def _derivatives(m: Own, rng: np.random.Generator) -> Outcome:
    true, path, _ = two_laps(m)
    i, j = np.array([0, 3, 7]), np.array([1, 9, 2])
    z = m.between(true[i], true[j]) + 0.1
    e, J = m.residuals(path, i, j, z)
    worst = 0.0
    for side, rows in ((0, i), (1, j)):
        for c in range(3):
            moved = path.copy()
            moved[rows, c] += 1e-6
            numeric = (m.residuals(moved, i, j, z)[0] - e + np.pi) % (2 * np.pi) - np.pi
            worst = max(worst, np.abs(numeric / 1e-6 - J[:, :, 3 * side + c]).max())
    return worst < 1e-4, _said("largest difference", worst)


@_property(7, "errors of the heading are wrapped", "3.1 and -3.1 rad are 0.08 rad apart")
def _heading(m: Own, rng: np.random.Generator) -> Outcome:
    poses = np.array([[0, 0, 0], [0, 0, 3.1]])
    e, _ = m.residuals(poses, np.array([0]), np.array([1]), np.array([[0, 0, -3.1]]))
    return abs(e[0, 2]) < 0.1, _said("error of the heading", e[0, 2])


@_property(
    7, "two measurements are weighed by their covariances", "Lambda = C^-1 = L L^T; use L^T e"
)
def _weighed(m: Own, rng: np.random.Generator) -> Outcome:
    S = rng.normal(size=(2, 3, 3))
    C = (S @ np.swapaxes(S, 1, 2) + 0.1 * np.eye(3)) * 1e-4  # far apart, and yet no closures
    start = np.array([[0, 0, 0], [1.0, 0.2, 0.3]])
    z = np.array([[1.0, 0, 0], [1.4, 0.5, 0.1]])
    came, _ = m.solve(start, [(0, 1), (0, 1)], z, C, np.zeros(2, bool))
    information = np.linalg.inv(C)
    expected = np.linalg.solve(information.sum(0), (information @ z[:, :, None]).sum(0)[:, 0])
    ok = np.allclose(came[1], expected, atol=1e-3)
    return ok, f"{_said('got', came[1])}, {_said('expected the weighted mean', expected)}"


def _graph(m: Own) -> tuple[Any, ...]:
    true, path, _ = two_laps(m)
    half, cov = len(true) // 2, np.diag([0.02, 0.02, 0.01]) ** 2
    chain = [(z, cov) for z in m.between(path[:-1], path[1:])]
    closures = [
        (k, k + half, m.between(true[k], true[k + half]), np.eye(3) * 1e-4, 0.9)
        for k in range(2, half, 2)
    ]
    return true, path, chain, closures


@_property(
    7, "the first pose is fixed, and a chain alone stays as it is", "drop the first three columns"
)
def _fixed(m: Own, rng: np.random.Generator) -> Outcome:
    _, path, chain, closures = _graph(m)
    out, alone = m.optimize(path, chain, closures), m.optimize(path, chain, [])
    moved = _off(alone, path).max()
    return np.allclose(out[0], path[0]) and moved < 1e-6, _said("a chain alone moved by", moved)


@_property(7, "closures halve the drift", "sign of the step")
def _bent(m: Own, rng: np.random.Generator) -> Outcome:
    true, path, chain, closures = _graph(m)
    out = m.optimize(path, chain, closures)
    gap = _off(m.between(out[2], out[2 + len(true) // 2]), closures[0][2]).max()
    before, after = (np.abs(x - true)[:, :2].max() for x in (path, out))
    return gap < 0.02 and after < 0.5 * before, f"{before:.2f} m before, {after:.2f} m after"


@_property(
    7, "one false closure moves nothing", "the robust kernel weighs closures, not the chain"
)
def _rejected(m: Own, rng: np.random.Generator) -> Outcome:
    true, path, chain, closures = _graph(m)
    false = (4, 4 + len(true) // 2, np.array([5.0, 1.0, 1.0]), np.eye(3) * 1e-4, 0.9)
    spoilt, right = (m.optimize(path, chain, ends) for ends in ([*closures, false], closures))
    gap = _off(spoilt, right).max()
    return gap < 0.05, _said("moved by", gap)


# 8. Occupancy map.


def _wall_ahead(m: Own, times: int) -> tuple[Any, Callable[[float, float], float]]:
    angles = np.deg2rad(np.arange(-90, 91, 1.0))
    ranges = np.clip(2.0 / np.maximum(np.cos(angles), 1e-9), 0, 35)
    odds, low = m.occupancy(
        np.tile(ranges, (times, 1)), angles, np.array([[1.0, 0.5, 0.0]] * times), 0.1
    )
    return odds, lambda x, y: float(odds[int((y - low[1]) / 0.1), int((x - low[0]) / 0.1)])


@_property(
    8, "the wall is occupied, before it is free", "hit at the end of a beam, miss before it"
)
def _wall(m: Own, rng: np.random.Generator) -> Outcome:
    _, at = _wall_ahead(m, 3)
    wall, free = max(at(3.0, 0.55), at(3.05, 0.55)), at(2.0, 0.55)
    return wall > 0 > free, f"log odds at the wall {wall:.1f}, before it {free:.1f}"


@_property(8, "behind the wall and behind the robot nothing is known", "stop before the wall")
def _unknown(m: Own, rng: np.random.Generator) -> Outcome:
    _, at = _wall_ahead(m, 3)
    came = [at(3.15, 0.55), at(4.0, 0.55), at(0.0, 0.55)]
    return came == [0.0, 0.0, 0.0], _said("log odds there", came)


@_property(8, "evidence has a limit of 5", "clip after each scan, or a door never opens")
def _limit(m: Own, rng: np.random.Generator) -> Outcome:
    odds, _ = _wall_ahead(m, 30)
    return np.abs(odds).max() <= 5, _said("largest after 30 scans", np.abs(odds).max())


@_property(8, "beams that met nothing make no walls", "a range of inf has no end")
def _nothing(m: Own, rng: np.random.Generator) -> Outcome:
    angles = np.deg2rad(np.arange(-90, 91, 1.0))
    odds, _ = m.occupancy(np.full((3, 181), np.inf), angles, np.zeros((3, 3)), 0.1)
    return odds.max() <= 0, _said("largest log odds", odds.max())


@_property(8, "rows are y, columns are x", "odds[row of y, column of x]")
def _rows(m: Own, rng: np.random.Generator) -> Outcome:
    pose = np.array([[0, 0, np.pi / 2]])
    odds, low = m.occupancy(np.array([[2.0]]), np.array([0.0]), pose, 0.1)
    came = odds[int((2.0 - low[1]) / 0.1), int((0.0 - low[0]) / 0.1)]
    return came > 0, f"a wall at (0, 2): log odds {came:.1f} there"
