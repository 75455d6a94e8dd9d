"""Lab V, SLAM from scratch: a picture of each step, and the whole beside the library.

Each picture draws what the student's functions return; where they fail, the data alone, and the
title says why. Nothing is judged here.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from types import ModuleType
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np

from slamlab import plots
from slamlab._checks import Array
from slamlab.datasets import killian
from slamlab.evaluation import align, ate, run
from slamlab.exercises.capstone import STEPS, NotWritten, Own, room, two_laps
from slamlab.exercises.lab_scores import scans_and_odometry
from slamlab.geometry import between, inverse_transform, transform
from slamlab.logs import Log
from slamlab.plots import COLOURS
from slamlab.robots import RelativePose, dead_reckoning
from slamlab.sensors import Lidar
from slamlab.simulation import ring_laps
from slamlab.slam import ScanGraphSlam

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["compare", "draw", "practice_log"]

_DOTS: dict[str, Any] = {"marker": ".", "linestyle": "", "markersize": 2.0, "rasterized": True}


@lru_cache(maxsize=1)
def practice_log() -> Log:
    """Return the practice drive: 1.6 laps of a corridor round a building, 226 scans, with truth.

    Examples
    --------
    >>> practice_log()
    Log(226 steps over 225 s, scans of 180 beams, truth)
    """
    lidar = Lidar(180, max_range=8.0, sigma_range=0.01)
    return ring_laps((20.0, 14.0), np.random.default_rng(1), lidar, laps=1.6)


def _odometry(log: Any) -> Array:
    """Poses (T, 3) by the odometry of a log, from the first true one."""
    return dead_reckoning(RelativePose(), log.truth[0], log.u[1:], 1.0)


def draw(step: int, own: ModuleType | Mapping[str, Any]) -> Figure:
    """Draw what the functions of a step return, beside the truth, the odometry or the library.

    Parameters
    ----------
    step : int
        1 to 8.
    own : module or mapping
        `globals()` of the notebook.

    Returns
    -------
    matplotlib.figure.Figure
        Never raises for what the functions do: then the data stand there alone.
    """
    if step not in STEPS:
        raise ValueError(f"step: expected a whole number from 1 to 8, got {step!r}")
    return _PICTURES[step](Own(own))


def _tried(own: Own, what: Callable[[], Any]) -> tuple[Any, str]:
    """Return what came and how to name it in a title."""
    try:
        with np.errstate(all="ignore"):
            return what(), "yours"
    except NotWritten as error:
        return None, f"not written yet: {str(error).removesuffix(' is not defined')}"
    except Exception as error:
        if missing := own.unwritten():
            return None, f"not written yet: {missing[0]}"
        return None, f"yours: {type(error).__name__}"


def _axes(columns: int, height: float = 3.4) -> tuple[Figure, Any]:
    figure, axes = plt.subplots(1, columns, figsize=(7, height), layout="constrained")
    for ax in np.atleast_1d(axes):
        plots.floor(ax)
    return figure, axes


def _dots(ax: Any, points: Array, kind: str, label: str | None = None) -> None:
    ax.plot(*np.asarray(points).T, color=COLOURS[kind], label=label, **_DOTS)


def _poses(own: Own) -> Figure:
    court = killian()
    figure, ax = _axes(1, 3.8)
    best = court.graph.optimize().poses

    def chained() -> Array:
        path = [court.graph.poses[0]]
        for u in court.odometry:
            path.append(own.compose(path[-1], u))
        return np.array(path)[:, :3]

    path, title = _tried(own, chained)
    plots.path(ax, best, kind="truth", label="optimum of the graph")
    plots.path(ax, court.dead_reckoned(), kind="dead_reckoning", label="odometry, library")
    if path is not None:
        plots.path(ax, path, label="odometry, yours")
        title = f"Killian Court: the odometry is {ate(path, best).rmse:.0f} m off"
    ax.set_title(title, fontsize=10)
    ax.legend(fontsize=8)
    return figure


def _points(own: Own) -> Figure:
    log: Any = practice_log()
    figure, (left, right) = _axes(2)
    all_points = log.scan.points(log.ranges[40], np.zeros(3))
    plots.lidar_points(left, all_points, s=2.0)
    points, title = _tried(own, lambda: own.scan_points(log.ranges[40], log.scan.beam_angles))
    if points is not None:
        _dots(left, points, "estimate")
        title = f"one scan: {len(points)} of {np.isfinite(all_points[:, 0]).sum()} points kept"
    left.set_title(title, fontsize=10)
    odometry = _odometry(log)

    def placed() -> Array:
        scans = [own.scan_points(r, log.scan.beam_angles) for r in log.ranges[::4]]
        moved = [own.transform(x, p) for x, p in zip(odometry[::4], scans, strict=True)]
        return np.concatenate(moved)

    points, title = _tried(own, placed)
    if points is not None:
        _dots(right, points, "estimate")
        title = "by odometry: walls double"
    plots.path(right, odometry, kind="dead_reckoning")
    right.set_title(title, fontsize=10)
    return figure


def _icp(own: Own) -> Figure:
    log: Any = practice_log()
    k, j = 20, 16
    figure, axes = _axes(2)
    true = between(log.truth[j], log.truth[k])
    guess = np.array([*(true[:2] + [0.3, -0.2]), true[2] + 0.15])
    place, scan = (log.scan.points(log.ranges[i], np.zeros(3)) for i in (j, k))
    place, scan = (points[np.isfinite(points[:, 0])] for points in (place, scan))

    def matched() -> Array:
        nodes = [(place, own.estimate_normals(place))]
        submap = own.local_map(nodes, np.zeros((1, 3)))
        return own.icp(submap, scan, guess, np.diag([1, 1, 0.3]) ** 2)[0]

    pose, title = _tried(own, matched)
    for ax, x, kind in ((axes[0], guess, "dead_reckoning"), (axes[1], pose, "estimate")):
        _dots(ax, place, "wall")
        if x is not None:
            _dots(ax, transform(x, scan), kind)
    axes[0].set_title("the guess: 0.36 m and 9 degrees off", fontsize=10)
    if pose is not None:
        off = 100 * np.hypot(*(pose - true)[:2])
        title = f"after your ICP: {off:.1f} cm off"
    axes[1].set_title(title, fontsize=10)
    return figure


def _search(own: Own) -> Figure:
    figure, axes = _axes(2)
    true = np.array([1.8, -1.0, 0.2618])
    scan = inverse_transform(true, room())
    field, title = _tried(own, lambda: own.likelihood_field(room(), np.zeros(2), 9.0, 0.1))
    if field is not None:
        half = 0.1 * len(field) / 2
        axes[0].imshow(
            field.T, origin="lower", extent=(-9, 2 * half - 9, -9, 2 * half - 9), cmap="Greens"
        )
        title = "your field: 1 at the walls"
    axes[0].grid(False)
    _dots(axes[0], scan, "dead_reckoning")
    axes[0].set_title(title, fontsize=10)

    def searched() -> Any:
        thin = own.voxel_downsample(scan, 0.2)
        return own.search(room(), thin, np.zeros(3), 2.5, np.deg2rad(20))

    found, title = _tried(own, searched)
    _dots(axes[1], room(), "wall")
    if found is not None:
        x, score, second = found
        _dots(axes[1], transform(x, scan), "estimate")
        off = 100 * np.hypot(*(x - true)[:2])
        title = f"found: {off:.0f} cm off, score {score:.2f}\nsecond peak {second:.2f}"
    axes[1].set_title(title, fontsize=10)
    return figure


def _driven(own: Own, loops: bool) -> tuple[Any, str]:
    return _tried(own, lambda: own.slam(*scans_and_odometry(practice_log()), loops))


def _path(own: Own) -> Figure:
    log: Any = practice_log()
    figure, ax = _axes(1, 3.8)
    result, title = _driven(own, loops=False)
    odometry = _odometry(log)
    plots.path(ax, log.truth, kind="truth", label="truth")
    plots.path(ax, odometry, kind="dead_reckoning", label="odometry")
    if result is not None:
        path = _laid(result[0], log.truth)
        plots.path(ax, path, label="your front end")
        off, was = ate(path, log.truth).rmse, ate(odometry, log.truth).rmse
        title = f"your front end: {100 * off:.1f} cm off; odometry: {100 * was:.0f} cm"
    ax.set_title(title, fontsize=10)
    ax.legend(fontsize=8)
    return figure


def _laid(path: Array, truth: Array) -> Array:
    """Lay a path on the truth: a map is defined up to a rigid motion."""
    return align(np.asarray(path, float)[:, :3], truth)


def _loops(own: Own) -> Figure:
    log: Any = practice_log()
    figure, ax = _axes(1, 3.8)

    def tried() -> tuple[Array, Array, list[Any], list[Any]]:
        path, _, steps = own.slam(*scans_and_odometry(log), False)
        first = np.unique([node for node, _ in steps], return_index=True)[1]
        poses, nodes = path[first], []
        for r in log.ranges[first]:
            scan = own.scan_points(r, log.scan.beam_angles)
            nodes.append((scan, own.estimate_normals(scan)))
        travel = np.r_[0, np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))]
        found: list[Any] = []
        refused: list[Any] = []
        for k in range(0, len(poses), 4):
            old, radius = own.candidates(k, poses, travel, travel[k])
            for j in old:
                one = own.verify(j, k, radius, nodes, poses, travel)
                (refused if one is None else found).append(one or (j, k))
        accepted = [one for one in found if own.is_consistent(one, found, poses, travel)]
        kept = {one[:2] for one in accepted}
        return poses, travel, accepted, refused + [one[:2] for one in found if one[:2] not in kept]

    came, title = _tried(own, tried)
    if came is not None:
        poses, travel, accepted, refused = came
        plots.path(ax, poses)
        # The second lap is drawn 1.5 m aside, or the ends of a closure would cover each other.
        aside = poses[:, :2] + np.where(travel > travel[-1] / 1.6, 1.5, 0.0)[:, None]
        _dots(ax, aside, "wall")
        for ends, colour, dash in ((refused, "dead_reckoning", "--"), (accepted, "lidar", "-")):
            for j, k, *_ in ends:
                x, y = np.stack([poses[j, :2], aside[k]]).T
                ax.plot(x, y, color=COLOURS[colour], lw=1.5, ls=dash)
        title = f"{len(accepted)} closures accepted (solid), {len(refused)} refused (dashed)"
    else:
        plots.path(ax, log.truth, kind="truth")
    ax.set_title(title, fontsize=10)
    return figure


def _graph(own: Own) -> Figure:
    figure, ax = _axes(1, 3.8)

    def optimized() -> tuple[Array, ...]:
        true, path, _ = two_laps(own)
        half, cov = len(true) // 2, np.diag([0.02, 0.02, 0.01]) ** 2
        chain = [(z, cov) for z in between(path[:-1], path[1:])]
        ends = [(k, k + half) for k in range(2, half, 2)]
        closures = [(j, k, between(true[j], true[k]), np.eye(3) * 1e-4, 0.9) for j, k in ends]
        false = (4, 4 + half, np.array([5.0, 1.0, 1.0]), np.eye(3) * 1e-4, 0.9)
        return true, path, own.optimize(path, chain, [*closures, false])

    came, title = _tried(own, optimized)
    if came is not None:
        true, path, out = came
        plots.path(ax, true, kind="truth", label="truth")
        plots.path(ax, path, kind="dead_reckoning", label="before")
        plots.path(ax, out, label="after, with one false closure")
        before, after = (np.hypot(*(x - true)[:, :2].T).max() for x in (path, out))
        title = f"largest error {before:.1f} m before, {after:.2f} m after"
        ax.legend(fontsize=8)
    ax.set_title(title, fontsize=10)
    return figure


def _map(own: Own) -> Figure:
    log: Any = practice_log()
    figure, axes = _axes(2)
    result, _ = _driven(own, loops=True)
    paths = {"along the odometry": _odometry(log), "along your path": result and result[0]}
    for ax, (name, path) in zip(axes, paths.items(), strict=True):
        if path is None:
            ax.set_title("your path: not yet", fontsize=10)
            continue
        came, title = _tried(own, partial(_mapped, own, log, path))
        if came is not None:
            _occupancy(ax, *came)
            title = f"your map, {name}"
        ax.set_title(title, fontsize=10)
    return figure


def _mapped(own: Own, log: Any, path: Array) -> Any:
    return own.occupancy(log.ranges, log.scan.beam_angles, path, 0.1)


def _occupancy(ax: Any, odds: Array, low: Array, cell: float = 0.1) -> None:
    rows, columns = np.shape(odds)
    extent = [low[0], low[0] + cell * columns, low[1], low[1] + cell * rows]
    plots.occupancy(ax, 1 / (1 + np.exp(-np.asarray(odds))), extent)
    known = np.argwhere(np.abs(odds) > 0)
    if len(known):
        (bottom, left), (top, right) = known.min(0), known.max(0)
        ax.set_aspect("equal", adjustable="box")  # both limits are set
        ax.set_xlim(low[0] + cell * left, low[0] + cell * right)
        ax.set_ylim(low[1] + cell * bottom, low[1] + cell * top)


_PICTURES: dict[int, Callable[[Own], Figure]] = {
    1: _poses, 2: _points, 3: _icp, 4: _search, 5: _path, 6: _loops, 7: _graph, 8: _map,
}  # fmt: skip


def compare(own: ModuleType | Mapping[str, Any], log: Log | None = None) -> list[list[Any]]:
    """Run the student's system and the library's on a log with truth; a row each.

    Parameters
    ----------
    own : module or mapping
        `globals()` of the notebook.
    log : Log, optional
        With scans, displacements as controls, and truth. By default the practice drive.

    Returns
    -------
    list of list
        Name, root mean square error of the path (m, aligned), closures, seconds; "not yet" where
        nothing came.
    """
    log = practice_log() if log is None else log
    if log.truth is None or log.ranges is None or log.scan is None:
        raise ValueError(f"log: expected a log with scans and truth, got {log}")
    given = scans_and_odometry(log)
    rows: list[list[Any]] = [["odometry", _metres(_odometry(log), log), 0, 0.0]]
    start = time.thread_time()
    student = Own(own)
    came, title = _tried(student, lambda: student.slam(*given))
    seconds = time.thread_time() - start
    if came is None:
        rows.append(["yours", title.removeprefix("yours: "), "", ""])
    else:
        rows.append(["yours", _metres(came[0], log), len(came[1]), round(seconds, 1)])
    start = time.thread_time()
    path, closures = _library(log)
    seconds = time.thread_time() - start
    return [*rows, ["library", _metres(path, log), closures, round(seconds, 1)]]


def _library(log: Log) -> tuple[Array, int]:
    """Return path and number of closures of the library's scan graph."""
    scan: Any = log.scan
    system = ScanGraphSlam(scan, np.zeros(3), motion=RelativePose())
    return run(system, log).trajectory, sum(one.state == "confirmed" for one in system.closures)


def _metres(path: Array, log: Log) -> float:
    return round(ate(np.asarray(path, float)[:, :3], log.truth).rmse, 3)
