"""Several drives in one map: another drive goes on where the first ended, or is kept beside it.

What ties two drives is found as Hess et al. (2016) find a place in all of a map, and confirmed as
every closure of `ScanGraphSlam` is. Chapter 13; ``slamlab map --resume``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import (
    Array,
    as_array,
    as_covariance,
    as_distances,
    as_instance,
    as_shaped,
)
from slamlab._files import read_npz
from slamlab.geometry import between, compose, inverse
from slamlab.logs import Log, ScanGeometry
from slamlab.models import ScanSensor
from slamlab.slam._closures import AROUND, STRIDE, Closure, consistent, optimized
from slamlab.slam._joining import GAP, Chain, Tie, more, recognised
from slamlab.slam._tracking import LEAST_POINTS, Keyframe, scan_points
from slamlab.slam.pose_graph import PoseGraph
from slamlab.slam.scan_graph import ScanGraphSlam

__all__ = ["Sessions"]

VERSION = 1  # of the file
_STATES = ("waiting", "confirmed", "rejected")
_BY_SCAN, _BY_NODE = ("times", "ranges", "offsets"), ("scan_of_node", "poses")
_SAME_LIDAR = 1e-6  # beams (rad), largest range and offset (m) of one lidar differ by at most this
_SAME_POSE = 1e-9  # the scan that is a node lies at the node (m, rad)
_FARTHEST = 1e6  # of what a file holds (m, rad)
_LONGEST = 200  # letters of a log's name


@dataclass(eq=False)
class Drive:
    """One drive of a map: its scans, and which of them are nodes.

    Attributes
    ----------
    name : str
        Of the log.
    times, ranges : ndarray, shapes (T,) and (T, n_beams)
        When the scans were made (s), and what they measured (m).
    nodes : list of Keyframe
        The N scans that are nodes of the graph.
    scan_of_node : ndarray of int, shape (N,)
        Which scans these are.
    poses : ndarray, shape (N, 3)
        Of the nodes (m, m, rad), in the frame of the map; of a drive that waits, in its own.
    z, information : ndarray, shapes (N - 1, 3) and (N - 1, 3, 3)
        Motion from each node to the next, and its information matrix.
    offsets : ndarray, shape (T, 3)
        Pose of each scan seen from its node.
    closures : list of Closure
        Those within a drive that waits; the map keeps the others.
    """

    name: str
    times: Array
    ranges: Array
    nodes: list[Keyframe]
    scan_of_node: NDArray[np.intp]
    poses: Array
    z: Array
    information: Array
    offsets: Array
    closures: list[Closure]

    @property
    def travel(self) -> Array:
        """Metres driven to each node, shape (N,)."""
        return np.append(0.0, np.cumsum(np.hypot(self.z[:, 0], self.z[:, 1])))

    @property
    def trajectory(self) -> Array:
        """Poses (T, 3) of all scans."""
        return compose(self.poses[_node_of_scan(self.scan_of_node, len(self.times))], self.offsets)


class Sessions:
    """A map of several drives with the same lidar; its frame is that of the first one.

    Where another drive began in the map is not known: it is joined by confirmed closures alone.
    Until there are any it waits beside the map, in a frame of its own; each drive that is joined
    later may tie it as well. Two that wait are not tied to each other, even if they share places:
    there is one map, and each is compared with that alone. For a map of the two begin another one.

    Parameters
    ----------
    system : ScanGraphSlam
        What the first drive left: its nodes, its chain and its closures.
    log : Log
        The scans that it was fed, all of them.
    name : str, default ""
        Of the log.

    Attributes
    ----------
    scan : ScanGeometry
        The lidar.
    drives, waiting : list of Drive
        Those that make the map, and those that are not joined.
    closures : list of Closure
        All that were verified in the map. Nodes are counted on from one drive to the next.

    Raises
    ------
    ValueError
        If the system has no node, or was fed another log.

    Examples
    --------
    >>> from slamlab.evaluation import run
    >>> from slamlab.sensors import Lidar
    >>> from slamlab.worlds import rooms
    >>> lidar = Lidar(180, max_range=20.0)
    >>> poses = np.column_stack([np.linspace(2, 4, 9), np.full(9, 4.0), np.zeros(9)])
    >>> u = [[0, 0, 0]] + [[0.25, 0, 0]] * 8
    >>> log = Log(range(9), u, [0] + [1] * 8, np.diag([1e-4, 1e-4, 1e-5]),
    ...           ranges=lidar.scan(rooms.office(), poses), scan=lidar)
    >>> Sessions(run(ScanGraphSlam(lidar), log).system, log)
    Sessions(1 drive of 5 nodes, 0 closures, 0 waiting)
    """

    def __init__(self, system: ScanGraphSlam, log: Log, name: str = "") -> None:
        first = _drive(system, log, name)
        assert log.scan is not None
        self.scan = _geometry(log.scan)
        self.drives, self.waiting = [first], list[Drive]()
        self.closures, first.closures = first.closures, []

    def __repr__(self) -> str:
        n, nodes = len(self.drives), sum(len(one.nodes) for one in self.drives)
        count = sum(one.state == "confirmed" for one in self.closures)
        drives = "1 drive" if n == 1 else f"{n} drives"
        wait = f"{len(self.waiting)} waiting"
        return f"Sessions({drives} of {nodes} nodes, {count} closures, {wait})"

    def graph(self) -> PoseGraph:
        """Return the pose graph of the map: the chain of each drive, and closures that count."""
        ties = [one for one in self.closures if one.state == "confirmed"]
        n, edges = 0, list[tuple[int, int]]()
        for one in self.drives:
            edges += [(k, k + 1) for k in range(n, n + len(one.nodes) - 1)]
            n += len(one.nodes)
        edges += [(one.j, one.k) for one in ties]
        z = [*(one.z for one in self.drives), np.reshape([one.z for one in ties], (-1, 3))]
        omega = np.linalg.inv(np.reshape([one.cov for one in ties], (-1, 3, 3)))
        omega = 0.5 * (omega + np.swapaxes(omega, 1, 2))
        omegas = [*(one.information for one in self.drives), omega]
        return PoseGraph(
            self._chain().poses,
            np.reshape(edges, (-1, 2)).astype(int),
            np.concatenate(z),
            np.concatenate(omegas),
        )

    def add(
        self,
        system: ScanGraphSlam,
        log: Log,
        name: str = "",
        progress: Callable[[int, int], object] | None = None,
    ) -> Tie:
        """Add a drive with the same lidar: it is joined, and others that wait, where places agree.

        Parameters
        ----------
        system : ScanGraphSlam
            What the drive left, in a frame of its own.
        log : Log
            The scans that it was fed.
        name : str, default ""
            Of the log.
        progress : callable, optional
            ``progress(done, total)`` is called after each place that was searched in the map.

        Returns
        -------
        Tie
            `frame` is None if the drive waits; else the pose in the map where its own frame began.

        Raises
        ------
        ValueError
            If the system has no node, was fed another log, or the lidar is another one.
        """
        self.check_lidar(log)
        new, report = _drive(system, log, name), progress or (lambda done, total: None)
        tie = self._joined(new, report)
        if tie.frame is None:
            self.waiting.append(new)
            return tie
        waiting, more_to_try = self.waiting, True
        while more_to_try:  # what a drive adds to the map may tie another
            still = [one for one in waiting if self._joined(one, report).frame is None]
            more_to_try, waiting = 0 < len(still) < len(waiting), still
        self.waiting = waiting
        return tie

    def check_lidar(self, log: Log) -> None:
        """ValueError if the scans of a log are not those of the lidar of this map."""
        as_instance("log", log, Log)
        if log.scan is None or log.ranges is None:
            raise ValueError("log: expected scans, got none")
        own, other = self.scan, _geometry(log.scan)
        numbers = [np.r_[one.beam_angles, one.max_range, one.offset] for one in (own, other)]
        if len(numbers[0]) != len(numbers[1]) or not np.allclose(
            numbers[0], numbers[1], 0.0, _SAME_LIDAR
        ):
            raise ValueError(
                f"log: expected the lidar of the map, {_said(own)}; got {_said(other)}"
            )

    # Joining.

    def _chain(self) -> Chain:
        """Nodes of the map, with gaps of travel between the drives."""
        travel, end = [], 0.0
        for one in self.drives:
            travel.append(end + one.travel)
            end = float(travel[-1][-1]) + GAP
        nodes = [node for one in self.drives for node in one.nodes]
        poses = np.concatenate([one.poses for one in self.drives])
        return Chain(nodes, poses, np.concatenate(travel))

    def _joined(self, new: Drive, progress: Callable[[int, int], object]) -> Tie:
        """Join a drive to the map if its places agree on where it began."""
        old = self._chain()
        n = len(old.nodes)
        tie = recognised(old, Chain(new.nodes, new.poses, new.travel), progress)
        if tie.frame is None:
            return tie
        trial = copy(self)
        moved = replace(new, poses=compose(tie.frame, new.poses), closures=[])
        trial.drives = [*map(replace, self.drives), moved]
        own = [replace(one, j=one.j + n, k=one.k + n) for one in new.closures]
        trial.closures = [*map(replace, self.closures), *own, *tie.closures]
        trial._solve()
        trial._go_along(n, min(c.k for c in tie.closures if c.state == "confirmed"))
        across = [c for c in trial.closures if c.j < n <= c.k]
        sure = any(one.state == "confirmed" for one in across)
        if sure:
            self.drives, self.closures = trial.drives, trial.closures
        frame = compose(moved.poses[0], inverse(new.poses[0])) if sure else None
        return Tie(frame, across, tie.places)

    def _go_along(self, n: int, begin: int) -> None:
        """Look for more closures of the last drive, whose first node is n: forth and back."""
        end = sum(len(one.nodes) for one in self.drives)
        for way in (range(begin, end - AROUND), range(begin, n + AROUND - 1, -1)):
            travel = self._chain().travel
            tried = tied = travel[begin]
            for k in way:
                if abs(travel[k] - tried) < STRIDE:
                    continue
                tried, nodes = travel[k], self._chain()
                # Found in all of the map before, it would be consistent with itself.
                known = {(one.j, one.k) for one in self.closures}
                found = more(k, n, nodes, float(abs(tried - tied)))
                self.closures += [one for one in found if (one.j, one.k) not in known]
                sure = [
                    one
                    for one in self.closures
                    if one.state == "waiting"
                    and one.j < n <= one.k
                    and consistent(one, self.closures, nodes.poses, nodes.travel)
                ]
                for one in sure:
                    one.state = "confirmed"
                if sure:
                    tied = tried
                    self._solve()

    def _solve(self) -> None:
        """Optimise the map; closures that do not fit are dropped, and again."""
        _, all_poses = optimized(self.graph, self.closures)
        ends = np.cumsum([len(one.nodes) for one in self.drives])[:-1]
        for drive, poses in zip(self.drives, np.split(all_poses, ends), strict=True):
            drive.poses = poses

    # Files.

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the map to a npz archive of plain arrays (no pickle); `load` reads it again.

        Of D drives with T scans and N nodes in all, those of the map first, one after the other:

        - `version` (): 1
        - `beam_angles` (n_beams,), `lidar` (2,): angles (rad); largest range and offset (m)
        - `names` (D,), `joined` (D,): the log, and whether the drive is in the map
        - `n_scans` (D,), `n_nodes` (D,): how many scans and nodes each drive has
        - `times` (T,), `ranges` (T, n_beams): of the scans (s, m)
        - `offsets` (T, 3): pose of each scan seen from its node (m, m, rad)
        - `scan_of_node` (N,), `poses` (N, 3): of each node its scan, and its pose
        - `z` (N, 3), `information` (N, 3, 3): motion to each node from the one before; zeros at
          the first of a drive
        - `closure_nodes` (C, 2), `closure_z` (C, 3), `closure_cov` (C, 3, 3): `Closure.j` and
          `k`, where k stands seen from j, and its covariance
        - `closure_fit` (C, 2): second peak and fit
        - `closure_state` (C,): 0 waiting, 1 confirmed, 2 rejected
        """
        drives = [*self.drives, *self.waiting]
        closures, n = list(self.closures), sum(len(one.nodes) for one in self.drives)
        for drive in self.waiting:
            closures += [replace(c, j=c.j + n, k=c.k + n) for c in drive.closures]
            n += len(drive.nodes)

        def each(name: str) -> Array:
            return np.concatenate([getattr(one, name) for one in drives])

        def of_closures(values: Iterable[Any], *shape: int) -> Array:
            return np.reshape(list(values), (-1, *shape))

        arrays: dict[str, Any] = {
            "version": np.array(VERSION),
            "beam_angles": self.scan.beam_angles,
            "lidar": np.array([self.scan.max_range, self.scan.offset]),
            "names": np.array([one.name for one in drives], dtype=str),
            "joined": np.arange(len(drives)) < len(self.drives),
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
        with open(path, "wb") as file:
            np.savez_compressed(file, **arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Sessions:
        """Read a map that `save` wrote.

        Raises
        ------
        ValueError
            If the file is no such archive, is of another version, damaged, or its parts do not
            fit together.
        FileNotFoundError
            If there is no such file.
        """
        arrays = read_npz(path)
        try:
            return cls._of(arrays)
        except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"{path}: expected a map of drives ({str(error)[:200]})") from error

    @classmethod
    def _of(cls, kept: dict[str, NDArray[Any]]) -> Sessions:
        """Check all arrays of a file, and build the map."""
        version = _whole("version", kept["version"], ()).item()
        if version != VERSION:
            raise ValueError(
                f"version: expected {VERSION}, got {version}: map the first log again"
            )
        far, offset = as_shaped("lidar", kept["lidar"], (2,)).tolist()
        scan = ScanGeometry(kept["beam_angles"], far, offset)
        scans, nodes = (_whole(name, kept[name], ("n",), 1) for name in ("n_scans", "n_nodes"))
        D, T, N = len(scans), int(scans.sum()), int(nodes.sum())
        joined, names = _joined_and_names(kept["joined"], kept["names"], D)
        if len(nodes) != D:
            raise ValueError(
                f"n_nodes: expected a number for each of {D} drives, got {len(nodes)}"
            )
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
        n = int(nodes[joined].sum())
        ties = [(c.j, c.k) for c in closures if c.state == "confirmed" and c.k < n]
        if not _connected(np.repeat(np.arange(D), nodes), ties, int(joined.sum())):
            raise ValueError("closure_state: expected closures that tie all drives of the map")
        new = cls.__new__(cls)
        new.scan, new.closures = scan, [one for one in closures if part[one.k] < 0]
        new.drives, new.waiting = drives[: joined.sum()], drives[joined.sum() :]
        for s in range(len(new.drives), D):
            drives[s].closures = [
                replace(one, j=one.j - int(first[s]), k=one.k - int(first[s]))
                for one in closures
                if part[one.k] == s
            ]
        return new


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
    if names.dtype.itemsize > 4 * _LONGEST:
        raise ValueError(f"names: expected at most {_LONGEST} letters each")
    return joined, names


def _node_of_scan(scan_of_node: NDArray[np.intp], n_scans: int) -> NDArray[np.intp]:
    """Find the node that each scan is seen from: the last before it, or the first of all."""
    rows = np.searchsorted(scan_of_node, np.arange(n_scans), "right") - 1
    return np.maximum(rows, 0)


def _drive(system: ScanGraphSlam, log: Log, name: str) -> Drive:
    """Keep what a drive left; which scans are nodes is found again in the trajectory."""
    as_instance("system", system, ScanGraphSlam)
    as_instance("log", log, Log)
    if log.ranges is None or log.scan is None:
        raise ValueError("log: expected scans, got none")
    if not system.nodes:
        raise ValueError("system: expected scans that see walls, got none with ten points")
    path, graph = system.trajectory, system.graph()
    rows = [0]
    for pose in graph.poses:
        same = np.abs(between(pose, path[rows[-1] :])).max(-1) < _SAME_POSE
        rows.append(rows[-1] + int(same.argmax()) if same.any() else len(path))
    scan_of_node = np.array(rows[1:])
    if len(path) != len(log) or (np.diff(scan_of_node) < 1).any() or rows[-1] >= len(path):
        raise ValueError(f"log: expected the {len(path)} scans that the system was fed")
    node = _node_of_scan(scan_of_node, len(path))
    n = len(graph.poses)
    return Drive(
        str(name)[:_LONGEST],
        np.array(log.times, dtype=float),
        np.array(log.ranges, dtype=float),
        list(system.nodes),
        scan_of_node,
        graph.poses.copy(),
        graph.measurements[: n - 1].copy(),
        graph.information[: n - 1].copy(),
        between(graph.poses[node], path),
        [replace(one) for one in system.closures],
    )


def _geometry(scan: ScanSensor) -> ScanGeometry:
    return ScanGeometry(scan.beam_angles, scan.max_range, scan.offset)


def _said(scan: ScanGeometry) -> str:
    """Words for a lidar."""
    angles = np.rad2deg([scan.beam_angles.min(), scan.beam_angles.max()])
    ahead = f", {scan.offset:g} m ahead" if scan.offset else ""
    return (
        f"{scan.n_beams} beams from {angles[0]:.1f} to {angles[1]:.1f} degrees up to "
        f"{scan.max_range:g} m{ahead}"
    )


# What a file holds is checked here.


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


def _keyframes(rows: NDArray[np.intp], ranges: Array, scan: ScanGeometry) -> list[Keyframe]:
    """Make the scans that are nodes what they were when they were driven."""
    if (np.diff(rows) < 1).any() or rows[-1] >= len(ranges):
        raise ValueError("scan_of_node: expected numbers of scans that grow")
    points = [scan_points(ranges[row], scan) for row in rows]
    if min(map(len, points)) < LEAST_POINTS:
        raise ValueError(f"ranges: expected {LEAST_POINTS} points or more in the scan of a node")
    return [Keyframe.of(one) for one in points]


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


def _connected(drive: NDArray[np.intp], ties: list[tuple[int, int]], n_drives: int) -> bool:
    """Whether ties between nodes join the first `n_drives` drives."""
    reached, before = {0}, 0
    while len(reached) > before:
        before = len(reached)
        for j, k in ties:
            pair = {int(drive[j]), int(drive[k])}
            reached |= pair if pair & reached else set()
    return len(reached) == n_drives
