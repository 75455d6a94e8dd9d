"""``slamlab map --resume``: another drive in the map of an earlier one, and what is said of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.logs import Log
from slamlab.slam import Sessions
from slamlab.slam.sessions import Alignment

FILE = "sessions.npz"
MOST = 99  # drives of one map
PATHS = tuple(f"trajectory-{k}.tum" for k in range(1, MOST + 1))


class Resumed:
    """The map of several drives, as a run is drawn: its scans, their poses, the graph.

    Attributes
    ----------
    system : Sessions
    log : Log
        All scans of the drives that are joined; what the wheels said is not kept.
    times, trajectory : ndarray, shapes (T,) and (T, 3)
        Of these scans.
    """

    def __init__(self, system: Sessions) -> None:
        self.system = system
        drives = system.drives
        self.times = np.concatenate([one.times for one in drives])
        self.trajectory = np.concatenate([one.trajectory for one in drives])
        ranges = np.concatenate([one.ranges for one in drives])
        still, steps = np.zeros((len(ranges), 3)), np.zeros(len(ranges))
        cov = np.zeros((3, 3))
        self.log = Log(self.times, still, steps, cov, ranges=ranges, scan=system.scan)

    @property
    def paths(self) -> list[Array]:
        """The path of each drive that is joined."""
        return [one.trajectory for one in self.system.drives]


def earlier(folder: Path) -> Sessions:
    """Read the map that a folder of results holds; ValueError if no drive can be added to it."""
    if not folder.is_dir():
        raise ValueError(f"--resume: expected the folder of an earlier run, got {folder}")
    file = folder / FILE
    if not file.is_file():
        wanted = f"a folder with {FILE}, as slamlab map --method scan-graph writes it"
        raise ValueError(f"--resume: expected {wanted}; {folder} has none")
    known = Sessions.load(file)
    if len(known.drives) + len(known.waiting) >= MOST:
        raise ValueError(f"--resume: expected a map of fewer than {MOST} drives, got {MOST}")
    return known


def summary(map_: Sessions, alignment: Alignment, name: str) -> list[tuple[str, str]]:
    """Say whether the drive of log `name` was joined, where and by what; list all drives."""
    count = sum(one.state == "confirmed" for one in alignment.closures)
    if alignment.frame is None:
        alike = len(alignment.closures)
        tried = f"{alignment.places} places of it searched in the map, {alike} looked alike"
        joined = (
            f"no: {tried}, too few agree; {name} is kept beside the map, in a frame of its own"
        )
    else:
        x, y, theta = alignment.frame
        place = f"({x:.2f} m, {y:.2f} m, {np.rad2deg(theta):.0f} degrees)"
        joined = (
            f"yes, by {count} closures with earlier drives; {name} began at {place} of the map"
        )
    rows = [("joined", joined)]
    drives: list[Any] = [*map_.drives, *map_.waiting]
    for k, one in enumerate(drives, 1):
        state = "in the map" if k <= len(map_.drives) else "waits beside the map"
        rows.append((f"drive {k}", f"{one.name}, {len(one.times)} scans, {state}"))
    return rows


def write_paths(folder: Path, map_: Sessions) -> None:
    """Write the path of each drive into a file of its own; of one that waits, in its own frame."""
    from slamlab.datasets.tum import write_tum

    for name, one in zip(PATHS, [*map_.drives, *map_.waiting], strict=False):
        write_tum(folder / name, one.times, one.trajectory)
