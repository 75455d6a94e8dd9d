"""Victoria Park, Sydney: a car among trees, odometry and trunks in view (Guivant and Nebot 2001).

The file is the one that iSAM made (Kaess et al. 2008); who is who is known. It lies beside this
one, with its source and licence.
Chapters 10 to 13.
"""

from __future__ import annotations

import gzip
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TextIO

import numpy as np

from slamlab._checks import Array, as_covariance, cut
from slamlab.datasets.trials import stored
from slamlab.logs import Log
from slamlab.robots import RelativePose
from slamlab.sensors import PointSensor
from slamlab.slam import PoseGraph

__all__ = ["read_landmark_log", "victoria_park", "victoria_park_runs"]

# Where the last numbers of a line, the upper triangle of a covariance, stand in its matrix.
_COVS = {
    "ODOMETRY": np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]]),
    "LANDMARK": np.array([[0, 1], [1, 2]]),
}


def victoria_park() -> Log:
    """Load Victoria Park: 6969 poses over 4 km, 151 trees measured 3640 times.

    For `robots.RelativePose` and ``sensors.PointSensor(0.4 * np.eye(2))``. Nobody measured the
    truth: `truth` and `landmarks` are the least-squares optimum of all measurements. The file has
    no times; a step counts as one second.

    Returns
    -------
    Log

    Examples
    --------
    >>> victoria_park()
    Log(6969 steps over 6968 s, 3640 measurements of landmarks, truth)
    """
    path = Path(__file__).parent / "data" / "victoria_park.txt.gz"
    with gzip.open(path, "rt", encoding="utf-8") as file:
        log = _parse(file, path.name)
    graph = PoseGraph.from_log(log, RelativePose(), PointSensor(0.4 * np.eye(2)))
    best = graph.chordal_initialisation().optimize()
    return replace(log, truth=best.poses, landmarks=best.landmarks)


def victoria_park_runs() -> dict[str, dict[int, dict[str, Array]]]:
    """Return the stored runs of `tools/victoria_park.py` over the whole drive.

    Returns
    -------
    dict
        ``victoria_park_runs()[system][scale]``, scale the factor on the odometry's variance of the
        file, maps names to one number a seed: "error", "largest" and "end" of the place, "claimed"
        in the end (m); "trees" in the map and "claimed of a tree" (m); "nis" over its degrees of
        freedom; if they are given by name their error "map", "map
        aligned" (m) and how far the map is "turned" (degrees), else "precision" and "recall".

    Examples
    --------
    >>> runs = victoria_park_runs()
    >>> bool(runs["EKF-SLAM, invariant"][1]["error"] < runs["EKF-SLAM"][1]["error"])
    True
    """
    return {
        system: {int(scale): numbers for scale, numbers in scales.items()}
        for system, scales in stored("victoria_park").items()
    }


def read_landmark_log(path: str | Path) -> Log:
    r"""Read a text of ODOMETRY and LANDMARK lines with covariances.

    ``ODOMETRY i j dx dy dtheta`` is the motion from pose i to pose j in the frame of i, then the
    upper triangle of its covariance, row by row; ``LANDMARK i l x y`` is landmark l as seen from
    pose i, then its covariance xx, xy, yy. Poses come in the order of their odometry; landmarks
    are numbered in the order in which they are first seen.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Log
        For `robots.RelativePose` and `sensors.PointSensor`; one second a step.

    Raises
    ------
    ValueError
        If a line is damaged or odometry does not go from each pose to the next; the message names
        the line.
    FileNotFoundError
        If there is no such file.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> path = Path(tempfile.mkdtemp()) / "park.txt"
    >>> _ = path.write_text("ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\nLANDMARK 1 5 2 3 1 0 1\n")
    >>> read_landmark_log(path)
    Log(2 steps over 1 s, 1 measurements of landmarks)
    """
    with Path(path).open(encoding="utf-8", errors="surrogateescape") as file:
        return _parse(file, Path(path).name)


def _parse(file: TextIO, name: str) -> Log:
    rows: dict[int, int] = {}  # step in which a pose was reached
    landmarks: dict[int, int] = {}
    motions = [[0.0] * 9]  # u and the upper triangle of its covariance
    observations: list[list[list[float]]] = [[]]  # landmark, z and the upper triangle of R
    for number, line in enumerate(file, start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        where = f"{name}: line {number}"
        i, j, values = _numbers(words, where)
        if not rows:
            rows[i] = 0
        if words[0] == "ODOMETRY":
            if rows.get(i) != len(motions) - 1 or j in rows:
                raise ValueError(f"{where}: expected odometry from the newest pose to a new one")
            rows[j] = len(motions)
            motions.append(values)
            observations.append([])
        elif i in rows:
            observations[rows[i]].append([landmarks.setdefault(j, len(landmarks)), *values])
        else:
            raise ValueError(f"{where}: pose {i} was not reached before")
    if len(motions) == 1:
        raise ValueError(f"{name}: the file ends without odometry")
    moved, seen = np.array(motions), [np.reshape(some, (-1, 6)) for some in observations]
    steps: Array = np.arange(len(moved), dtype=np.float64)
    return Log(
        steps,
        moved[:, :3],
        np.minimum(steps, 1.0),
        moved[:, 3:][:, _COVS["ODOMETRY"]],
        controls="displacement",
        landmark_measurements=tuple(some[:, 1:3] for some in seen),
        ids=tuple(some[:, 0].astype(int) for some in seen),
        covs=tuple(some[:, 3:][:, _COVS["LANDMARK"]] for some in seen),
    )


def _numbers(words: list[str], where: str) -> tuple[int, int, list[float]]:
    if words[0] not in _COVS:
        raise ValueError(f"{where}: expected ODOMETRY or LANDMARK, got {words[0][:40]!r}")
    triangle = _COVS[words[0]]
    size = len(triangle)
    count = 2 + size + size * (size + 1) // 2
    if len(words) != 1 + count:
        raise ValueError(f"{where}: {words[0]}: expected {count} fields, got {len(words) - 1}")
    try:
        values = [float(word) for word in words[3:]]
        pair = int(words[1]), int(words[2])
    except ValueError as error:
        raise ValueError(f"{where}: expected numbers, {cut(error)}") from error
    if not all(map(isfinite, values)):
        raise ValueError(f"{where}: expected finite numbers, got NaN or infinity")
    as_covariance(f"{where}: covariance", np.array(values[size:])[triangle])
    return *pair, values
