"""Make a map of a lidar log: CARMEN (.log, .gz), ROS bag (1 or 2), or this library's .npz.

Written into the folder: map.yaml and map.pgm (as ROS' map_server reads them), map.png,
trajectory.tum, graph.g2o and sessions.npz (scan-graph only) and index.html, a report with a
replay of the drive. With --localize no map is made: the log is found in one that was made before.
With --resume the log goes on with one that was made before, which sessions.npz holds; the new
folder has the path of each drive, trajectory-1.tum, trajectory-2.tum and so on.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from slamlab._checks import as_scalar
from slamlab._files import about
from slamlab._optional import has
from slamlab.commands import _page
from slamlab.commands._localize import KnownMap, found
from slamlab.commands._progress import Progress
from slamlab.commands._results import results
from slamlab.commands._resume import FILE, PATHS, Resumed, earlier, summary, write_paths
from slamlab.commands._wheels import disagreement
from slamlab.datasets import read_carmen
from slamlab.datasets.rosbag import read_rosbag
from slamlab.datasets.tum import write_tum
from slamlab.evaluation import run as run_system
from slamlab.evaluation.run import Run
from slamlab.localization import DeadReckoning
from slamlab.localization.global_localization import GlobalLocalization
from slamlab.logs import CONTROLS, Log
from slamlab.mapping import OccupancyGrid
from slamlab.models import MotionModel, as_scan_sensor
from slamlab.robots import YOUBOT, RelativePose, Unicycle
from slamlab.slam import HectorSlam, ScanGraphSlam, Sessions

METHODS = ("scan-graph", "hector", "odometry")
FILES = ("map.yaml", "map.pgm", "map.png", "trajectory.tum", "graph.g2o", FILE, *PATHS)
_MOST_STEPS, _MOST_BEAMS = 500, 90  # of the replay: the page stays below some megabytes
_CELLS = 0.005, 10.0  # smallest and largest cell of a map (m)
_BAGS = (".bag", ".db3", ".mcap")
_DISTRUST = "do not trust the map"
_DISTRUST_PATH = "do not trust the path"
_MOST_PIXELS = 2000  # of a side of the picture
_UNKNOWN = 205  # grey of a cell that nothing was seen of
_PAUSE = 2.0  # a longer one between two scans is named where scans are lost (s)
_TRUSTED = 30.0  # beams count for the map up to this range (m)
# By kind of the controls, their axes and how many there are. Any platform that moves sideways
# integrates the velocities of its body alike.
MOTIONS: dict[tuple[str, int, int], MotionModel] = {
    ("displacement", 2, 3): RelativePose(),
    ("velocity", 2, 3): YOUBOT,
    ("velocity", 2, 2): Unicycle(),
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the command takes."""
    parser.add_argument(
        "log",
        type=Path,
        help="CARMEN log (.log, .gz), ROS bag (.bag, .db3, .mcap or its folder) or .npz",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="where the results go (default: map, localized or resumed); made if it is not there",
    )
    parser.add_argument(
        "--method",
        choices=METHODS,
        help="scan-graph: scans are matched to those before, places that come again are "
        "recognised and the graph of poses optimised (default); hector: each scan is matched to "
        "the map so far, no place is recognised; odometry: the wheels are believed",
    )
    parser.add_argument(
        "--resolution",
        type=float,
        default=0.05,
        metavar="M",
        help="side of a cell of the map in metres, 0.005 to 10 (default: 0.05)",
    )
    _of_the_log(parser)
    _of_an_earlier_map(parser)


def _of_the_log(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("what a log may not say itself")
    group.add_argument(
        "--field-of-view",
        type=float,
        default=180.0,
        metavar="DEG",
        help="opening of the FLASER scans of a CARMEN log in degrees, which the log does not say "
        "(default: 180)",
    )
    group.add_argument(
        "--controls",
        choices=CONTROLS,
        help="what the controls of an .npz are, where it does not say so: velocities (m/s, rad/s) "
        "or displacements from scan to scan (m, rad)",
    )
    group.add_argument("--scan-topic", metavar="TOPIC", help="of a bag with several lidars")
    group.add_argument(
        "--odometry-topic", metavar="TOPIC", help="of a bag with several odometries"
    )


def _of_an_earlier_map(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("with a map made before")
    group.add_argument(
        "--localize",
        type=Path,
        metavar="MAP",
        help="a map made before (map.yaml, or the folder of an earlier run): where in it was the "
        "robot? Particles search the free floor, then each scan is matched; no map is made",
    )
    group.add_argument(
        "--resume",
        type=Path,
        metavar="FOLDER",
        help="the folder of an earlier run: the log is another drive in the same map, with the "
        "same lidar, from anywhere. It is joined only by closures that confirm each other; else "
        "it is kept beside the map",
    )


def run(options: argparse.Namespace) -> None:
    """Read, run, report, write."""
    resolution = as_scalar("resolution", options.resolution, *_CELLS)
    known = known_map(options)
    before = map_before(options)
    output = options.output or Path("localized" if known else "resumed" if before else "map")
    # Numbers of astronomic size end in a sentence.
    with np.errstate(all="ignore"), about(options.log.name):
        log = read_log(options)
        if before is not None:
            before.check_lidar(log)
        with results(output, FILES) as folder:  # made now, not after an hour
            start = time.perf_counter()
            method = "localize" if known else options.method or METHODS[0]
            system = known.localizer(log, motion_of(log)) if known else system_for(method, log)
            result = with_progress("scans", run_system, system, log)
            drawn, more = result, list[tuple[str, str]]()
            if isinstance(system, ScanGraphSlam):
                drawn, more = sessions(folder, options.log.name, result, before)
            seconds = time.perf_counter() - start
            rows = report(method, result, seconds, suspects(options, log)) + more
            grid = known or draw_map(drawn, resolution)
            for name, value in rows:
                print(f"{name:24s} {value}")
            write(folder, options.log.name, drawn, grid, rows)
    print(f"{'written to':24s} {output}")


def with_progress(unit: str, work: Callable[..., Any], *given: Any) -> Any:
    """Do work that tells its progress; the line is taken away however it ends."""
    progress = Progress(unit)
    try:
        return work(*given, progress=progress)
    finally:
        progress.clear()


def sessions(
    folder: Path, name: str, result: Run, before: Sessions | None
) -> tuple[Run | Resumed, list[tuple[str, str]]]:
    """Keep what another drive needs to go on with; what is drawn, and what is said of drives."""
    system: Any = result.system
    if before is None:
        if system.nodes:
            Sessions(system, result.log, name).save(folder / FILE)
        return result, []
    if not system.nodes:
        raise ValueError("expected scans with at least ten points, got none")
    alignment = with_progress("places", before.add, system, result.log, name)
    before.save(folder / FILE)
    return Resumed(before), summary(before, alignment, name)


def known_map(options: argparse.Namespace) -> KnownMap | None:
    """Return the map that the log is to be found in, if one is given."""
    if options.localize is None:
        return None
    if options.method is not None:
        raise ValueError(f"--localize: expected no --method beside it, got {options.method}")
    folder = options.localize if options.localize.is_dir() else options.localize.parent
    _check_output(options.output, folder)
    return KnownMap.read(options.localize)


def map_before(options: argparse.Namespace) -> Sessions | None:
    """Return the map that the log is another drive in, if one is given."""
    folder: Path | None = options.resume
    if folder is None:
        return None
    if options.localize is not None:
        raise ValueError("--resume: expected no --localize beside it, got both")
    if options.method not in (None, METHODS[0]):
        raise ValueError(f"--resume: expected --method {METHODS[0]}, got {options.method}")
    _check_output(options.output, folder)
    return earlier(folder)


def _check_output(output: Path | None, folder: Path) -> None:
    """ValueError if the results would go into the folder of the map that was made before."""
    if output is not None and output.resolve() == folder.resolve():
        raise ValueError("--output: expected another folder than that of the map, got the same")


def read_log(options: argparse.Namespace) -> Log:
    """Read the log by its kind; ValueError if it has no scans, or its controls are not known."""
    path: Path = options.log
    if path.is_dir() or path.suffix in _BAGS:
        log = read_rosbag(path, options.scan_topic, options.odometry_topic)
    elif path.suffix == ".npz":
        log = Log.load(path)
    else:
        log = read_carmen(path, field_of_view=np.deg2rad(options.field_of_view))
    if log.ranges is None or len(log) == 0:
        raise ValueError(f"{path.name}: expected a log with scans, it has none")
    if options.controls is not None:
        log = replace(log, controls=options.controls)
    if log.controls is None:
        raise ValueError(
            f"{path.name}: expected a log that says what its controls are: add --controls "
            "velocity (of the body, driven for dt) or --controls displacement (dx, dy, dtheta)"
        )
    if (log.controls, log.u.ndim, log.u.shape[-1]) not in MOTIONS:
        raise ValueError(
            f"{path.name}: expected motions (dx, dy, dtheta) from scan to scan, or velocities "
            f"(forward, left, turn) or (forward, turn), got {log.controls} of shape {log.u.shape}"
        )
    return log


def system_for(method: str, log: Log) -> Any:
    """Return the system that makes the map."""
    motion = motion_of(log)
    if method == "odometry":
        return DeadReckoning(motion, np.zeros(3))
    lidar = as_scan_sensor("log.scan", log.scan)
    system = HectorSlam if method == "hector" else ScanGraphSlam
    return system(lidar, motion=motion)


def motion_of(log: Log) -> MotionModel:
    """Return how a robot with the controls of this log moves."""
    return MOTIONS[str(log.controls), log.u.ndim, log.u.shape[-1]]


def suspects(options: argparse.Namespace, log: Log) -> list[str]:
    """List what may be wrong with a log whose scans lie nowhere, the likeliest first."""
    found = []
    if options.log.suffix not in (".npz", *_BAGS) and not options.log.is_dir():
        found.append(f"the field of view ({options.field_of_view:g} degrees were taken)")
    if back := _backwards(log):
        found.append(f"times that run backwards ({back})")
    step = np.diff(log.times)
    pause = float(step.max(initial=0.0))
    if pause > max(_PAUSE, 10 * float(np.median(step)) if len(step) else 0.0):
        found.append(f"the clock, or a pause of {pause:.1f} s before scan {step.argmax() + 1}")
    if not log.u.any():
        found.append("odometry that says nothing")
    if (share := _seen(log).mean()) < 0.2:
        found.append(f"few readings that met anything ({100 * share:.0f} %)")
    return found


def _seen(log: Log) -> Any:
    """Which readings (T, n) met something."""
    assert log.ranges is not None
    assert log.scan is not None
    return (log.ranges > 0) & (log.ranges < log.scan.max_range)


def _backwards(log: Log) -> str:
    """In how many steps the times run backwards; empty if in none."""
    count = int((np.diff(log.times) < 0).sum())
    return f"{count} of {len(log) - 1} steps" if count else ""


def report(method: str, result: Run, seconds: float, causes: list[str]) -> list[tuple[str, str]]:
    """List names and values of what came of it; `causes` may be why scans were lost."""
    log, system, path = result.log, result.system, result.trajectory
    driven = float(np.hypot(*np.diff(path[:, :2], axis=0).T).sum())
    rows = [
        (
            "scans",
            f"{len(log)}, {log.ranges.shape[1]} beams each" if log.ranges is not None else "",
        ),
        ("method", method),
        ("seconds", f"{seconds:.1f}, {1e3 * seconds / len(log):.1f} ms a scan"),
    ]
    if getattr(system, "localized", True):  # else the poses are those of many places
        rows.insert(2, ("driven", f"{driven:.1f} m"))
    if back := _backwards(log):
        rows.append(("times", f"run backwards in {back}: is the file in order?"))
    if isinstance(system, ScanGraphSlam):
        counts = {state: 0 for state in ("confirmed", "waiting", "rejected")}
        for one in system.closures:
            counts[one.state] += 1
        rows.append(("nodes", f"{len(system.nodes)}"))
        rows.append(("closures", ", ".join(f"{n} {state}" for state, n in counts.items())))
    if isinstance(system, GlobalLocalization):
        rows += found(result, _DISTRUST_PATH)
    lost, apart = _lost(log, system), ""
    if lost:
        rows.append(("lost", lost))
    if isinstance(system, ScanGraphSlam | HectorSlam):
        wheels = run_system(DeadReckoning(motion_of(log), np.zeros(3)), log)
        apart = disagreement(wheels.trajectory, path)
    if apart:
        rows.append(("wheels", f"{apart}; one of the two is wrong: {_DISTRUST}"))
        causes = [*causes, "the scale of the odometry, of the ranges or of the beam angles"]
    if _DISTRUST in lost:
        causes = [*causes, "walls out of reach, glass, crowds"]
    if apart or _DISTRUST in lost:
        rows.append(("suspects", "; ".join(causes)))
    return rows


def _lost(log: Log, system: Any) -> str:
    """Where the robot was lost; empty for a method that cannot say it."""
    if not _seen(log).any():
        return f"nothing was ever seen: {_DISTRUST}"
    if isinstance(system, ScanGraphSlam):
        return _scans(system.unmatched_scans, len(log))
    if isinstance(system, HectorSlam):
        at = system.lost_at
        return "never" if at is None else f"from scan {at} on: {_DISTRUST} after it"
    return ""


def _scans(lost: list[int], total: int) -> str:
    if not lost:
        return "never"
    some = ", ".join(str(k) for k in lost[:8]) + (", ..." if len(lost) > 8 else "")
    warning = f": {_DISTRUST}" if len(lost) > 0.05 * total else ""
    return f"{len(lost)} scans lay nowhere, the wheels are believed there ({some}){warning}"


def draw_map(result: Run | Resumed, resolution: float) -> OccupancyGrid:
    """Occupancy map of all scans from the best poses."""
    log, path = result.log, result.trajectory
    corner = path[0, :2] - 5.0
    cells = max(int(10.0 / resolution), 1)
    grid = OccupancyGrid((cells, cells), resolution, corner)
    assert log.ranges is not None
    assert log.scan is not None
    try:
        grid.insert(path, log.ranges, log.scan, max_range=_TRUSTED, free_missing=False)
    except (ValueError, MemoryError) as error:
        wanted = f"a map that fits into memory at --resolution {resolution:g}"
        raise ValueError(f"expected {wanted}, got: {error}") from error
    return grid


def write(
    folder: Path,
    name: str,
    result: Run | Resumed,
    grid: OccupancyGrid | KnownMap,
    rows: list[tuple[str, str]],
) -> None:
    """Write into `folder` what `result`, `grid` and the `rows` of the report on `name` say."""
    system = result.system
    if isinstance(grid, OccupancyGrid):
        grid.save_ros(folder / "map.yaml")
    if isinstance(result, Resumed):
        write_paths(folder, result.system)
    else:
        write_tum(folder / "trajectory.tum", result.times, result.trajectory)
    parts = [_page.table(rows)]
    if has("matplotlib"):
        png = drawing(result, grid)
        (folder / "map.png").write_bytes(png)
        alt = "The map with the path; closures that count join the places that they tie."
        parts.append(_page.picture(png, alt))
    if has_graph(system):
        system.graph().write_g2o(folder / "graph.g2o")
        parts += _closure_table(system)
    if has("anywidget"):
        parts += _replay(result)
    title = f"Map of {name}" if isinstance(grid, OccupancyGrid) else f"{name} in a known map"
    (folder / "index.html").write_text(_page.page(title, *parts), encoding="utf-8")


def has_graph(system: Any) -> TypeGuard[ScanGraphSlam | Sessions]:
    """Whether what made the map is a graph that has nodes."""
    return isinstance(system, Sessions) or (
        isinstance(system, ScanGraphSlam) and len(system.nodes) > 0
    )


def drawing(result: Run | Resumed, grid: OccupancyGrid | KnownMap) -> bytes:
    """Draw map, path and closures."""
    from matplotlib.figure import Figure

    from slamlab import plots

    figure = Figure(figsize=(8, 7), layout="constrained")
    ax = figure.add_subplot()
    image, (rows, columns) = _smaller(grid.to_image())
    left, _, _, top = grid.extent
    extent = (left, left + columns * grid.resolution, top - rows * grid.resolution, top)
    ax.imshow(image, cmap="gray", vmin=0, vmax=254, extent=extent)
    for path in result.paths if isinstance(result, Resumed) else [result.trajectory]:
        plots.path(ax, path, "estimate", label="path")
    system = result.system
    if has_graph(system):
        poses = system.graph().poses
        for one in system.closures:
            if one.state == "confirmed":
                ax.plot(*poses[[one.j, one.k], :2].T, color="#009E73", lw=1)
    ax.set_aspect("equal")
    ax.set_xlabel("x (m)")
    ax.set_ylabel("y (m)")
    return _page.png_of(figure)


def _smaller(image: Any) -> tuple[Any, tuple[int, int]]:
    """Shrink an image to what a page shows, walls first; the cells that it covers.

    A picture of 20 million cells takes a gigabyte to draw.
    """
    k = -(-max(image.shape) // _MOST_PIXELS)
    if k == 1:
        return image, image.shape
    short = [-n % k for n in image.shape]
    whole = np.pad(image, [(0, n) for n in short], constant_values=_UNKNOWN)
    rows, columns = whole.shape
    blocks = whole.reshape(rows // k, k, columns // k, k)
    # Dark is a wall; else what is seen free counts more than what is unknown.
    walls = blocks.min((1, 3)) == 0
    return np.where(walls, np.uint8(0), blocks.max((1, 3))), whole.shape


def _closure_table(system: ScanGraphSlam | Sessions) -> list[str]:
    """Show the closures that fit worst, with what is left of their error."""
    loop_closures = [one for one in system.closures if one.state == "confirmed"]
    if not loop_closures:
        return [_page.paragraph("No place was recognised: the map is that of the front end.")]
    graph = system.graph()
    e = graph.residuals()[-len(loop_closures) :]
    chi2 = np.einsum("ni,nij,nj->n", e, graph.information[-len(loop_closures) :], e)
    rows: list[list[object]] = [
        ["node", "old node", "left (m)", "left (deg)", "chi2", "second peak"]
    ]
    for i in np.argsort(-chi2)[:20]:
        left, turn = f"{np.hypot(*e[i, :2]):.3f}", f"{np.rad2deg(abs(e[i, 2])):.2f}"
        one = loop_closures[i]
        rows.append([one.k, one.j, left, turn, f"{chi2[i]:.1f}", f"{one.second_peak:.2f}"])
    return [_page.paragraph("The closures that fit worst:"), _page.table(rows)]


def _replay(result: Run | Resumed) -> list[str]:
    """Show the drive as an interactive figure that needs nothing beside the page."""
    from slamlab.widgets import LidarPoints, Paths, Replay

    log, path = result.log, result.trajectory
    assert log.ranges is not None
    assert log.scan is not None
    steps = np.unique(np.linspace(0, len(path) - 1, _MOST_STEPS).astype(int))
    beams = np.unique(np.linspace(0, log.scan.n_beams - 1, _MOST_BEAMS).astype(int))
    ranges = np.where(log.ranges <= _TRUSTED, log.ranges, np.nan)
    points = log.scan.points(ranges[steps], path[steps])[:, beams]
    seen = LidarPoints(points, accumulate=True)
    figure = Replay(Paths(estimate=path[steps]), seen, title="The drive")
    return [figure.html]
