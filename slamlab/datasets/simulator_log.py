"""Logs that the page of the simulator saves: P5's robot and lidar, driven by a reader.

A text of numbers with commas: time, motion, true pose, ranges; `simulator.js` writes it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from slamlab._checks import Array, cut
from slamlab._files import read_bytes
from slamlab.logs import Log, ScanGeometry

__all__ = ["read_simulator"]

_HEAD = ["time", "dx", "dy", "dtheta", "x", "y", "theta"]
_CONTROL_COV = np.diag([0.005, 0.005, np.deg2rad(0.5)]) ** 2


def read_simulator(path: str | Path) -> Log:
    r"""Read a log that the simulator saved, plain or ``.gz``.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Log
        Its first step has dt = 0. The motion of a step is the true one, seen from the pose before,
        so that `robots.RelativePose` is its motion model; ``control_cov`` grants it 5 mm and half
        a degree. A beam that met nothing is inf, a lost one NaN.

    Raises
    ------
    ValueError
        If the file is no such log or damaged; the message names the line.
    FileNotFoundError
        If there is no such file.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "simulator.csv"
    >>> _ = path.write_text("# slamlab simulator, 2 beams\n"
    ...                     "time,dx,dy,dtheta,x,y,theta,r0,r1\n"
    ...                     "0,0,0,0,1,2,0.5,3,inf\n1,0.1,0,0,1.09,2.05,0.5,2.9,nan\n")
    >>> log = read_simulator(path)
    >>> len(log), log.scan.n_beams, log.ranges.tolist()
    (2, 2, [[3.0, inf], [2.9, nan]])
    """
    path = Path(path)
    lines = read_bytes(path).decode("utf-8", errors="replace").splitlines()
    names = lines[1].split(",") if len(lines) > 1 else []
    n = len(names) - len(_HEAD)
    if n < 1 or names != [*_HEAD, *(f"r{i}" for i in range(n))]:
        raise ValueError(f"{path.name}: line 2: expected {','.join(_HEAD)},r0,r1,..., got none")
    numbers = [k for k, line in enumerate(lines[2:], 3) if line]
    if not numbers:
        raise ValueError(f"{path.name}: the file ends without a step")
    table = np.array([_row(lines[k - 1], f"{path.name}: line {k}", n) for k in numbers])
    with np.errstate(over="ignore"):
        dt = np.diff(table[:, 0], prepend=table[0, 0])
    bad = np.flatnonzero(~((dt >= 0) & (dt < np.inf)))
    if bad.size:
        before, now = table[bad[0] - 1 : bad[0] + 1, 0]
        place = f"{path.name}: line {numbers[bad[0]]}"
        raise ValueError(f"{place}: expected a time not before {before:g} s, got {now:g} s")
    scan = ScanGeometry(2 * np.pi * np.arange(n) / n)
    motion, truth, ranges = table[:, 1:4], table[:, 4:7], table[:, 7:]
    parts: dict[str, Any] = dict(ranges=ranges, scan=scan, truth=truth, controls="displacement")
    return Log(table[:, 0], motion, dt, _CONTROL_COV, **parts)


def _row(line: str, place: str, n: int) -> Array:
    """Numbers of a line: finite ones, then ranges."""
    try:
        row = np.array([float(word) for word in line.split(",")])
    except ValueError as error:
        raise ValueError(f"{place}: expected numbers, {cut(error)}") from error
    if len(row) != len(_HEAD) + n:
        raise ValueError(f"{place}: expected {len(_HEAD) + n} numbers, got {len(row)}")
    if not np.isfinite(row[: len(_HEAD)]).all() or (row[len(_HEAD) :] < 0).any():
        raise ValueError(f"{place}: expected finite numbers, then ranges that are not negative")
    return row
