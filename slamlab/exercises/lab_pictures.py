"""The picture after a lab: what *your* system makes of each drive, beside the library's.

`draw` shows it also where the score says NO: the picture then shows the failure. `replay` is
one drive to watch, and to save as one HTML file. Lab V has pictures of its own, one a step
(`capstone_pictures`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from slamlab._checks import Array, as_choice, as_count
from slamlab.evaluation import run
from slamlab.evaluation.run import Run
from slamlab.exercises import lab_systems
from slamlab.exercises._pictures import attempt, say
from slamlab.exercises.lab_scores import answer, driven
from slamlab.exercises.labs import Task, practice
from slamlab.grids import Grid
from slamlab.localization import DeadReckoning

__all__ = ["draw", "replay"]

System = Callable[..., Any]
# The system of the library that stands beside the student's.
BESIDE = {
    "I": "EKF with a gate",
    "II": "(grid, true poses)",
    "III": "EKFSlam",
    "IV": "CoveragePilot, HectorSlam",
}


def draw(lab: str, system: System, seed: int = 0) -> Any:
    """Draw a system on the drives to practise on: yours on the left, the library's on the right.

    Parameters
    ----------
    lab : {"I", "II", "III", "IV"}
    system : callable
        As `lab_scores.practise` takes it. Whatever it does is shown, never raised.
    seed : int, default 0
        At least 0; other seeds, other drives.

    Returns
    -------
    matplotlib.figure.Figure
        A row a drive. A notebook shows it.
    """
    from matplotlib.figure import Figure

    from slamlab.plots import use_style

    use_style()
    drives = practice(as_choice("lab", lab, tuple(BESIDE)), as_count("seed", seed))
    figure = Figure(figsize=(7, 3.3 * len(drives)), layout="constrained")
    rows = figure.subplots(len(drives), 2, squeeze=False)
    for (left, right), task in zip(rows, drives, strict=True):
        _library(lab, right, task)
        message = attempt(partial(_DRAWERS[lab], left, task, system))
        for ax in (left, right):
            ax.set_aspect("equal", adjustable="box")
            ax.set(xlim=right.get_xlim(), ylim=right.get_ylim())
        left.set_title(f"{task.setting.name}: yours", fontsize=10)
        beside = "as it should be" if lab == "II" else f"library, {BESIDE[lab]}"
        right.set_title(beside, fontsize=10)
        right.set(ylabel="")
        say(left, message)
    return figure


def replay(lab: str, system: System, seed: int = 0, drive: int = 0) -> Any:
    """Play what a system makes of a drive, beside truth and dead reckoning.

    Parameters
    ----------
    lab : {"I", "II", "III", "IV"}
    system : callable
        As `lab_scores.practise` takes it.
    seed : int, default 0
        At least 0; other seeds, other drives.
    drive : int, default 0
        Which of them.

    Returns
    -------
    slamlab.widgets.Replay
        A notebook plays it; ``.save("my_drive.html")`` writes a page that plays anywhere.

    Raises
    ------
    ValueError
        If the system returns none of what the lab asks for.
    """
    from slamlab import widgets

    drives = practice(as_choice("lab", lab, tuple(BESIDE)), as_count("seed", seed))
    if as_count("drive", drive) >= len(drives):
        raise ValueError(f"drive: expected 0 to {len(drives) - 1}, got {drive}")
    task = drives[drive]
    title = f"Lab {lab}, {task.setting.name}: yours"
    world: list[Any] = [] if task.world is None else [widgets.WallSegments(task.world.segments)]
    if lab in ("I", "III"):
        if task.setting.beacons is not None:
            world.append(widgets.Landmarks(task.setting.beacons))
        beside = widgets.Paths(dead_reckoning=_dead_reckoned(task))
        return widgets.Replay(
            run(answer(lab, task, system), task.log), beside, *world, title=title
        )
    if lab == "II":
        log: Any = task.log
        world.append(widgets.Occupancy(*_map_and_extent(answer("II", task, system))))
        paths = widgets.Paths(truth=log.truth, dead_reckoning=_dead_reckoned(task))
    else:
        log = driven(task, answer("IV", task, system))
        paths = widgets.Paths(truth=log.truth, estimate=log.notes["believed"])
    points = task.setting.lidar.points(log.ranges, log.truth)
    seen = widgets.LidarPoints(points[:, ::3])
    return widgets.Replay(paths, seen, *world, times=log.times, title=title)


def _dead_reckoned(task: Task) -> Array:
    """Poses (T, 3) by the controls alone."""
    return run(DeadReckoning(task.setting.motion, task.setting.start), task.log).poses


def _library(lab: str, ax: Any, task: Task) -> None:
    """Draw the system of the library, on axes that hold all of the drive."""
    theirs = lab_systems.systems(lab, task)[BESIDE[lab]]
    _DRAWERS[lab](ax, task, lambda *_: theirs())
    if lab == "II":
        left, bottom, right, top = task.world.bounds
        ax.set(xlim=(left - 0.5, right + 0.5), ylim=(bottom - 0.5, top + 0.5))


# Labs I and III: the true path, dead reckoning, the system's path and some of its ellipses.


def _run_drawn(ax: Any, task: Task, system: System) -> None:
    from slamlab import plots

    if task.world is not None:
        plots.walls(ax, task.world.segments)
    if task.setting.beacons is not None:
        plots.landmarks(ax, task.setting.beacons)
    plots.path(ax, _dead_reckoned(task), "dead_reckoning")
    plots.path(ax, task.log.truth, "truth")
    plots.floor(ax)
    result = run(answer("I", task, system), task.log)
    plots.path(ax, result.trajectory)
    _ellipses(ax, result)


def _ellipses(ax: Any, result: Run) -> None:
    """Draw twelve of the covariances that were reported, those that are none left out."""
    from slamlab import plots

    for k in np.linspace(0, len(result.poses) - 1, 12).astype(int):
        cov = np.asarray(result.covs[k], float)[:2, :2]
        if np.isfinite(cov).all() and np.linalg.eigvalsh(cov)[0] >= 0:
            plots.ellipse(ax, result.poses[k], 0.5 * (cov + cov.T))


# Lab II: the map, and the walls that are there.


def _map_drawn(ax: Any, task: Task, system: System) -> None:
    from slamlab import plots

    plots.floor(ax)
    for wall in task.world.segments:
        ax.plot(*wall.T, color=plots.COLOURS["dead_reckoning"], lw=0.8)
    plots.occupancy(ax, *_map_and_extent(answer("II", task, system)))


def _map_and_extent(answer: Any) -> tuple[Any, tuple[float, float, float, float]]:
    """Give the map that `map_room` returned, and what of the plane it covers (m)."""
    probability, resolution, origin = answer
    return probability, Grid(np.shape(probability), resolution, origin).extent


# Lab IV: where the robot drove, and where it believed to be.


def _drive_drawn(ax: Any, task: Task, system: System) -> None:
    from slamlab import plots

    plots.walls(ax, task.world.segments)
    plots.floor(ax)
    log: Any = driven(task, answer("IV", task, system))
    points = task.setting.lidar.points(log.ranges, log.truth)[::5, ::3].reshape(-1, 2)
    plots.lidar_points(ax, points[np.isfinite(points[:, 0])], s=1)
    plots.path(ax, log.truth, "truth")
    plots.path(ax, log.notes["believed"])
    ax.plot(*log.truth[-1, :2], "o", color=plots.COLOURS["truth"])


_DRAWERS: dict[str, Callable[[Any, Task, System], None]] = {
    "I": _run_drawn,
    "II": _map_drawn,
    "III": _run_drawn,
    "IV": _drive_drawn,
}
