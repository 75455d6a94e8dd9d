"""The archive of `Sessions`: its arrays, and what is checked when they are read again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array, as_array, as_covariance, as_distances, as_shaped
from slamlab.logs import ScanGeometry
from slamlab.matching import PointsWithNormals
from slamlab.slam._closures import Closure
from slamlab.slam._drive import LONGEST, Drive
from slamlab.slam._tracking import LEAST_POINTS, scan_points

VERSION = 1  # of the file
_STATES = ("waiting", "confirmed", "rejected")
_BY_SCAN, _BY_NODE = ("times", "ranges", "offsets"), ("scan_of_node", "poses")
_FARTHEST = 1e6  # of what a file holds (m, rad)


def arrays_of(
    scan: ScanGeometry, joined: list[Drive], waiting: list[Drive], closures: list[Closure]
) -> dict[str, Any]:
    """Arrays of a map by their names in the archive, as `Sessions.save` lists them."""
    drives = [*joined, *waiting]
    closures, n = list(closures), sum(len(one.nodes) for one in joined)
    for drive in waiting:
        closures += [replace(c, j=c.j + n, k=c.k + n) for c in drive.closures]
        n += len(drive.nodes)

    def each(name: str) -> Array:
        return np.concatenate([getattr(one, name) for one in drives])

    def of_closures(values: Iterable[Any], *shape: int) -> Array:
        return np.reshape(list(values), (-1, *shape))

    return {
        "version": np.array(VERSION),
        "beam_angles": scan.beam_angles,
        "lidar": np.array([scan.max_range, scan.offset]),
        "names": np.array([one.name for one in drives], dtype=str),
        "joined": np.arange(len(drives)) < len(joined),
        "n_scans": np.array([len(one.times) for one in drives]),
        "n_nodes": np.array([len(one.nodes) for one in drives]),
        **{name: each(name) for name in _BY_SCAN + _BY_NODE},
        "z": np.concatenate([np.pad(one.z, [(1, 0), (0, 0)]) for one in drives]),
        "information": np.concatenate(
            [np.pad(one.information, [(1, 0), (0, 0), (0, 0)]) for one in drives]
        ),
        "closure_nodes": of_closures(((c.j, c.k) for c in closures), 2).astype(int),
        "closure_z": of_closures((c.z for c in closures), 3),
        "closure_cov": of_closures((c.cov for c in closures), 3, 3),
        "closure_fit": of_closures(((c.second_peak, c.fit) for c in closures), 2),
        "closure_state": np.array([_STATES.index(c.state) for c in closures], dtype=int),
    }


def contents_of(
    kept: dict[str, NDArray[Any]],
) -> tuple[ScanGeometry, list[Drive], list[Drive], list[Closure]]:
    """Lidar, drives that are joined and that wait, and closures; ValueError if they do not fit."""
    version = _whole("version", kept["version"], ()).item()
    if version != VERSION:
        raise ValueError(f"version: expected {VERSION}, got {version}: map the first log again")
    far, offset = as_shaped("lidar", kept["lidar"], (2,)).tolist()
    scan = ScanGeometry(kept["beam_angles"], far, offset)
    scans, nodes = (_whole(name, kept[name], ("n",), 1) for name in ("n_scans", "n_nodes"))
    D, T, N = len(scans), int(scans.sum()), int(nodes.sum())
    joined, names = _joined_and_names(kept["joined"], kept["names"], D)
    if len(nodes) != D:
        raise ValueError(f"n_nodes: expected a number for each of {D} drives, got {len(nodes)}")
    ranges = as_distances("ranges", kept["ranges"], (T, scan.n_beams)).astype(float)
    times = as_array("times", kept["times"], (T,)).astype(float)
    offsets = _poses("offsets", kept["offsets"], T)
    rows = _whole("scan_of_node", kept["scan_of_node"], (N,))
    poses, z = _poses("poses", kept["poses"], N), _poses("z", kept["z"], N)
    omega = as_shaped("information", kept["information"], (N, 3, 3))
    ends = np.cumsum(nodes)
    first, drives = ends - nodes, []
    omega = _definite("information", omega, np.setdiff1d(np.arange(N), first))
    of_scans = np.split(np.arange(T), np.cumsum(scans)[:-1])
    for name, mine, a, b in zip(names.tolist(), of_scans, first, ends, strict=True):
        keyframes = _keyframes(rows[a:b], ranges[mine], scan)
        chain = z[a + 1 : b], omega[a + 1 : b]
        drives.append(
            Drive(
                name, times[mine], ranges[mine], keyframes, rows[a:b], poses[a:b], *chain,
                offsets[mine], [],
            )
        )  # fmt: skip
    part = np.repeat(np.where(joined, -1, np.arange(D)), nodes)  # -1: the map
    closures = _closures_of(kept, part)
    n, count = int(nodes[joined].sum()), int(joined.sum())
    loop_closures = [(c.j, c.k) for c in closures if c.state == "confirmed" and c.k < n]
    if not _connected(np.repeat(np.arange(D), nodes), loop_closures, count):
        raise ValueError("closure_state: expected closures that tie all drives of the map")
    for s in range(count, D):
        drives[s].closures = [
            replace(one, j=one.j - int(first[s]), k=one.k - int(first[s]))
            for one in closures
            if part[one.k] == s
        ]
    own = [one for one in closures if part[one.k] < 0]
    return scan, drives[:count], drives[count:], own


def _joined_and_names(
    joined: NDArray[Any], names: NDArray[Any], D: int
) -> tuple[NDArray[np.bool_], NDArray[np.str_]]:
    """Which of D drives are in the map, and what they are called; checked."""
    if joined.shape != (D,) or joined.dtype != bool or not joined[0]:
        raise ValueError("joined: expected true for the first drives, false for the others")
    if (np.diff(joined.astype(int)) > 0).any():
        raise ValueError("joined: expected the drives that wait after those of the map")
    if names.shape != (D,) or names.dtype.kind != "U":
        raise ValueError(f"names: expected a word for each of {D} drives")
    if names.dtype.itemsize > 4 * LONGEST:
        raise ValueError(f"names: expected at most {LONGEST} letters each")
    return joined, names


def _whole(name: str, value: NDArray[Any], shape: Sequence[str | int], low: int = 0) -> Any:
    """Whole numbers of at least `low`."""
    array = as_array(name, value, shape)
    if value.dtype.kind not in "iu" or (array < low).any() or (array > 2**40).any():
        raise ValueError(f"{name}: expected whole numbers of at least {low}")
    return value.astype(np.int64)


def _poses(name: str, value: NDArray[Any], n: int) -> Array:
    """Poses or motions (n, 3) of somewhere on Earth."""
    array = as_array(name, value, (n, 3)).astype(float)
    if (np.abs(array) > _FARTHEST).any():
        raise ValueError(f"{name}: expected metres and radians up to {_FARTHEST:g}")
    return array


def _definite(name: str, matrices: Array, rows: Any) -> Array:
    """Matrices (n, 3, 3), of which those in `rows` are symmetric and positive definite."""
    out = np.zeros(matrices.shape)
    out[rows] = as_covariance(name, matrices[rows], 3)
    values = np.linalg.eigvalsh(out[rows])
    if len(values) and (values[:, 0] <= 1e-12 * values[:, -1]).any():
        raise ValueError(f"{name}: expected positive definite matrices, one is singular")
    return out


def _keyframes(
    rows: NDArray[np.intp], ranges: Array, scan: ScanGeometry
) -> list[PointsWithNormals]:
    """Make the scans that are nodes what they were when they were driven."""
    if (np.diff(rows) < 1).any() or rows[-1] >= len(ranges):
        raise ValueError("scan_of_node: expected numbers of scans that grow")
    points = [scan_points(ranges[row], scan) for row in rows]
    if min(map(len, points)) < LEAST_POINTS:
        raise ValueError(f"ranges: expected {LEAST_POINTS} points or more in the scan of a node")
    return list(map(PointsWithNormals.estimate, points))


def _closures_of(kept: dict[str, NDArray[Any]], part: NDArray[np.intp]) -> list[Closure]:
    """Closures of a file; `part` (N,) tells which nodes are in one frame."""
    ends = _whole("closure_nodes", kept["closure_nodes"], ("n", 2))
    C = len(ends)
    state = _whole("closure_state", kept["closure_state"], (C,))
    if (ends >= len(part)).any() or (state >= len(_STATES)).any():
        raise ValueError(f"closure_nodes, closure_state: expected some of {len(part)} nodes")
    if (ends[:, 0] >= ends[:, 1]).any() or (part[ends[:, 0]] != part[ends[:, 1]]).any():
        raise ValueError("closure_nodes: expected an older and a newer node of one frame")
    z = _poses("closure_z", kept["closure_z"], C)
    cov = as_shaped("closure_cov", kept["closure_cov"], (C, 3, 3))
    cov = _definite("closure_cov", cov, np.arange(C))
    fit = as_array("closure_fit", kept["closure_fit"], (C, 2))
    return [
        Closure(
            int(j), int(k), z[i], cov[i], float(fit[i, 0]), float(fit[i, 1]), _STATES[state[i]]
        )
        for i, (j, k) in enumerate(ends)
    ]


def _connected(
    drive: NDArray[np.intp], loop_closures: list[tuple[int, int]], n_drives: int
) -> bool:
    """Whether closures between nodes join the first `n_drives` drives."""
    reached, before = {0}, 0
    while len(reached) > before:
        before = len(reached)
        for j, k in loop_closures:
            pair = {int(drive[j]), int(drive[k])}
            reached |= pair if pair & reached else set()
    return len(reached) == n_drives
