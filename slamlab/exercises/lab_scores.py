"""What the score of a lab says: figures of a system on a drive, and what earns a point.

`practise` makes one in a notebook, on the drives of `labs.practice`; ``python -m slamlab lab``
makes the one that counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from slamlab._checks import Array, as_array
from slamlab.evaluation import ate, nees, run
from slamlab.evaluation.run import Run
from slamlab.exercises import lab_systems
from slamlab.exercises.labs import Task, as_system_sees_it, practice, recorded
from slamlab.grids import Grid
from slamlab.logs import Log
from slamlab.models import Estimator, View
from slamlab.navigation.exploration_grid import FREE, ExplorationGrid

__all__ = ["Row", "answer", "driven", "library_rows", "practise", "row", "sheet"]

Figures = dict[str, float]
FIGURES = {
    "I": ("ATE (m)", "NEES (3)", "ms a step"),
    "II": ("walls found %", "floor right %", "invented %"),
    "III": ("ATE (m)", "NEES (3)", "ms a step"),
    "IV": ("floor seen %", "from home (m)", "hits", "drive (s)"),
    "V": ("ATE (m)",),
}


@dataclass(frozen=True)
class Row:
    """How one system did on one drive: figures, or why there are none."""

    who: str
    figures: Figures
    note: str = ""


def practise(lab: str, system: Callable[..., Any], seed: int = 0, library: bool = True) -> None:
    """Print the scores of a system on the drives to practise on, without computing times.

    Parameters
    ----------
    lab : {"I", "II", "III", "IV", "V"}
    system : callable
        Your ``make(setting)``; in lab II ``map_room(setting, log)``, in lab V ``slam(ranges,
        beam_angles, odometry, covs)``.
    seed : int, default 0
        Other seeds, other drives.
    library : bool, default True
        Let the library's systems drive too.
    """
    won = of = 0
    for task in practice(lab, seed):
        mine = row(lab, task, "you", partial(answer, lab, task, system))
        good, asked = sheet(lab, task, mine, library_rows(lab, task, library), False)
        won, of = won + good, of + asked
    print(f"\n{won} of {of} points")


def answer(lab: str, task: Task, system: Callable[..., Any]) -> Any:
    """Ask a student's function for what a drive is judged by: a map, a path or a system."""
    if lab == "V":
        return system(*scans_and_odometry(task.log))
    if lab == "II":
        return system(task.setting, as_system_sees_it(task.log))
    return system(task.setting)


def scans_and_odometry(log: Any) -> tuple[Array, ...]:
    """Return what `slam` of lab V is called with: ranges, beam angles, odometry, covariances."""
    covs = np.broadcast_to(log.control_cov, (len(log), 3, 3))
    return log.ranges.copy(), log.scan.beam_angles.copy(), log.u.copy(), covs.copy()


def row(lab: str, task: Task, who: str, answer: Callable[[], Any]) -> Row:
    """Let a system do a drive; what it refuses, or returns that is none, goes into the note."""
    judges = {"II": _map_figures, "IV": _drive_figures, "V": _path_figures}
    judge = judges.get(lab, _run_figures)
    try:
        return Row(who, judge(task, answer()))
    except (ValueError, TypeError) as error:
        return Row(who, {}, str(error))


def library_rows(lab: str, task: Task, everyone: bool = True) -> list[Row]:
    """Let the library's systems do a drive, or only dead reckoning."""
    known = list(lab_systems.systems(lab, task).items())
    if not everyone:  # the wheels alone neither draw a map nor explore
        known = [] if lab in ("II", "IV") else known[:1]
    return [row(lab, task, who, answer) for who, answer in known]


def sheet(lab: str, task: Task, mine: Row, bar: list[Row], timed: bool = True) -> tuple[int, int]:
    """Print the part of one drive; return how many points it earned, of how many."""
    columns = [name for name in FIGURES[lab] if timed or not name.startswith("ms")]
    print(f"\n{task.setting.name:28s}" + "".join(f"{column:>15s}" for column in columns))
    for one in [mine, *bar]:
        shown = [_shown(name, one.figures[name]) for name in columns] if one.figures else []
        text = "".join(f"{number:>15s}" for number in shown)
        print(f"{one.who:28s}{text or '  ' + one.note}")
    rivals = {one.who: one.figures for one in bar if one.figures and one.who[0] != "("}
    points = _points(lab, mine.figures or dict.fromkeys(FIGURES[lab], np.nan), rivals)
    points = [point for point in points if timed or "ms a step" not in point[0]]
    for text, holds in points:
        print(f"  {'ok ' if holds else 'NO '} {text}")
    return sum(bool(holds) for _, holds in points), len(points)


def _shown(column: str, value: float) -> str:
    if column.startswith("NEES") and value > 100:
        return "over 100"
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


# Labs I and III: a log goes into a system, and the run is judged.


def _run_figures(task: Task, system: Estimator) -> Figures:
    result = run(system, task.log)
    error, slow = ate(result, aligned=False).rmse, 1e3 * float(np.mean(result.seconds))
    return dict(zip(FIGURES["I"], (error, _mean_nees(result), slow), strict=True))


def _mean_nees(result: Run) -> float:
    """Mean NEES of the poses believed at the time; inf if a covariance is none."""
    try:
        values = nees(result)
    except ValueError:
        return float("inf")
    known = np.isfinite(values)
    return float(values[known].mean()) if known.mean() > 0.5 else float("inf")


# Lab II: a map is judged by the surfaces that the beams met, and by the floor that they crossed.


def _map_figures(task: Task, answer: Any) -> Figures:
    """Shares (%) of walls found, of floor called free, and of wall cells where no wall is."""
    probability, resolution, origin = answer
    probability = as_array("probability", probability, ("rows", "columns"))
    grid = Grid(probability.shape, float(resolution), origin)
    walls, floor = _looked_at(task)
    occupied = grid.centres()[probability > 0.5].reshape(-1, 2)
    found = _near(walls, occupied, 0.1)
    right = _probability(grid, probability, floor) < 0.5
    invented = task.world.clearance(occupied) > 0.15 if len(occupied) else np.ones(1)
    shares = [100 * float(np.mean(part)) for part in (found, right, invented)]
    return dict(zip(FIGURES["II"], shares, strict=True))


@lru_cache(maxsize=2)  # every system is judged on the same drive
def _looked_at(task: Task) -> tuple[Array, Array]:
    """Points (n, 2) of walls that beams without noise meet, and of floor that they cross."""
    log, lidar, world = task.log, task.setting.lidar, task.world
    clean = world.cast(_eyes(log.truth, lidar.offset), log.truth[:, 2:] + lidar.beam_angles)
    met = lidar.points(np.where(clean < lidar.max_range, clean, np.inf), log.truth)
    walls = _thinned(met[np.isfinite(met).all(-1)])
    half = lidar.points(0.5 * np.minimum(clean, lidar.max_range), log.truth)
    floor = _thinned(half.reshape(-1, 2))
    return walls, floor[world.clearance(floor) > 0.15]


def _eyes(poses: Array, offset: float) -> Array:
    heading = poses[:, 2:]
    return (poses[:, :2] + offset * np.concatenate([np.cos(heading), np.sin(heading)], 1))[:, None]


def _thinned(points: Array) -> Array:
    """One point of each square of 5 cm."""
    _, first = np.unique(np.round(points / 0.05).astype(int), axis=0, return_index=True)
    return points[first]


def _near(points: Array, others: Array, distance: float) -> Array:
    if len(others) == 0:
        return np.zeros(len(points))
    return np.isfinite(cKDTree(others).query(points, distance_upper_bound=distance)[0]).astype(
        float
    )


def _probability(grid: Grid, probability: Array, points: Array) -> Array:
    """Return what a map says of points (n, 2); outside of it, nothing: 1/2."""
    cells = grid.cells(points)
    inside = grid.holds(cells)
    said = np.full(len(points), 0.5)
    said[inside] = probability[cells[inside, 0], cells[inside, 1]]
    return said


# Lab IV: the student's pilot drives.


class _Motors:
    """Give no control larger than the limits."""

    def __init__(self, pilot: Any, limits: Array) -> None:
        self._pilot, self._limits = pilot, limits

    def command(self, view: View) -> Array | None:
        """Return the pilot's command, clipped."""
        u = self._pilot.command(view)
        return None if u is None else np.clip(u, -self._limits, self._limits)


def driven(task: Task, system: Any) -> Log:
    """Let a system of lab IV drive; return what was recorded."""
    setting, rng = task.setting, np.random.default_rng(22)
    motors = _Motors(system, setting.limits)
    return recorded(setting, task.world, setting.lidar, motors, system, rng, setting.start)


def _drive_figures(task: Task, system: Any) -> Figures:
    """Share of the floor that was seen, where the drive ended, and what it cost."""
    setting, world = task.setting, task.world
    log: Any = driven(task, system)
    floor = ExplorationGrid(world.bounds, 0.1)
    for pose, ranges in zip(log.truth, log.ranges, strict=True):
        floor.insert(pose, ranges, setting.lidar)
    open_floor = world.clearance(floor.centres()) > 0.1
    open_floor &= world.is_free(floor.centres())
    seen = 100 * float((floor.state[open_floor] == FREE).mean())
    away = float(np.hypot(*(log.truth[-1] - log.truth[0])[:2]))
    cost = (float(log.notes["hit"].sum()), float(log.times[-1]))
    return dict(zip(FIGURES["IV"], (seen, away, *cost), strict=True))


# Lab V: the path is judged up to a rigid motion.


def _path_figures(task: Task, answer: Any) -> Figures:
    """Root mean square error of a path, the first thing that `slam` returns."""
    path = as_array("path", answer[0], (len(task.log), 3))
    return {"ATE (m)": ate(path, task.log.truth).rmse}


# What earns a point: sentences, and whether they hold.


def _points(lab: str, me: Figures, bar: dict[str, Figures]) -> list[tuple[str, bool]]:
    """Compare figures with fixed bounds and, if there is a bar, with the library's."""
    found: list[tuple[str, bool]] = []
    best = {column: sorted(figures[column] for figures in bar.values()) for column in me}
    if lab in ("I", "III"):
        halved = me["ATE (m)"] <= 0.5 * bar["dead reckoning"]["ATE (m)"]
        found.append(("at most half as far off as dead reckoning", halved))
        if len(bar) > 1 and lab == "I":
            good = me["ATE (m)"] <= 1.25 * bar["EKF with a gate"]["ATE (m)"]
            found.append(("at most a quarter farther off than the EKF with a gate", good))
        elif len(bar) > 1:
            good = me["ATE (m)"] <= best["ATE (m)"][len(bar) // 2]
            found.append(("not worse than the middle one of the library's systems", good))
        sure = halved and 1 <= me["NEES (3)"] <= 9
        found.append(("so, and mean NEES between 1 and 9, where 3 is expected", sure))
        slow = 20 if lab == "I" else 50
        found.append((f"so, and less than {slow} ms a step", halved and me["ms a step"] < slow))
    elif lab == "V":
        far = me["ATE (m)"] <= 0.1 * bar["odometry"]["ATE (m)"]
        found.append(("at most a tenth as far off as the odometry", far))
        found.append(("so, and at most 5 cm off", far and me["ATE (m)"] <= 0.05))
    elif lab == "II":
        for column, sign in (("walls found %", 1), ("floor right %", 1), ("invented %", -1)):
            goal = best[column][-1 if sign > 0 else 0] if bar else 50 + 50 * sign
            near = sign * (me[column] - goal) >= -5
            found.append((f"{column[:-2]}: within 5 points of the library's best", near))
    else:
        most = 0.95 * (best["floor seen %"][-1] if bar else 100.0)
        seen = me["floor seen %"] >= most
        found.append(("19 of 20 parts of the floor that the library saw", seen))
        found.append(
            ("so, and within 0.15 m of home in the end", seen and me["from home (m)"] <= 0.15)
        )
        found.append(("so, and nothing was hit", seen and me["hits"] == 0))
    return found
