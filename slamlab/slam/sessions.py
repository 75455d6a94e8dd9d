"""Several drives in one map: another drive goes on where the first ended, or is kept beside it.

What ties two drives is found as Hess et al. (2016) find a place in all of a map, and confirmed as
every closure of `ScanGraphSlam` is. Chapter 13; ``slamlab map --resume``.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import reduce

import numpy as np

from slamlab._files import read_npz
from slamlab.geometry import compose, inverse
from slamlab.logs import Log, ScanGeometry
from slamlab.slam._chain import Chain
from slamlab.slam._closures import CLOSURE_SPACING, N_QUERY_SCANS, chain_graph, confirm, optimized
from slamlab.slam._drive import Drive, drive_of, lidar_of
from slamlab.slam._joining import Alignment, more, recognised, together
from slamlab.slam._sessions_file import arrays_of, contents_of
from slamlab.slam.pose_graph import PoseGraph
from slamlab.slam.scan_graph import ScanGraphSlam

__all__ = ["Sessions"]

_SAME_LIDAR = 1e-6  # beams (rad), largest range and offset (m) of one lidar differ by at most this


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
        first = drive_of(system, log, name)
        self.scan = lidar_of(log)
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
        drive = np.repeat(np.arange(len(self.drives)), [len(one.nodes) for one in self.drives])
        k = np.flatnonzero(np.diff(drive) == 0)  # from the last node of a drive no edge leads on
        z = np.concatenate([one.z for one in self.drives])
        information = np.concatenate([one.information for one in self.drives])
        return chain_graph(self._chain().poses, k, z, information, self.closures)

    def add(
        self,
        system: ScanGraphSlam,
        log: Log,
        name: str = "",
        progress: Callable[[int, int], object] | None = None,
    ) -> Alignment:
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
        Alignment
            `frame` is None if the drive waits; else the pose in the map where its own frame began.

        Raises
        ------
        ValueError
            If the system has no node, was fed another log, or the lidar is another one.
        """
        self.check_lidar(log)
        new, report = drive_of(system, log, name), progress or (lambda done, total: None)
        alignment = self._joined(new, report)
        if alignment.frame is None:
            self.waiting.append(new)
            return alignment
        waiting, more_to_try = self.waiting, True
        while more_to_try:  # what a drive adds to the map may tie another
            still = [one for one in waiting if self._joined(one, report).frame is None]
            more_to_try, waiting = 0 < len(still) < len(waiting), still
        self.waiting = waiting
        return alignment

    def check_lidar(self, log: Log) -> None:
        """ValueError if the scans of a log are not those of the lidar of this map."""
        own, other = self.scan, lidar_of(log)
        mine, theirs = (np.r_[one.beam_angles, one.max_range, one.offset] for one in (own, other))
        if len(mine) != len(theirs) or not np.allclose(mine, theirs, 0.0, _SAME_LIDAR):
            raise ValueError(
                f"log: expected the lidar of the map, {_said(own)}; got {_said(other)}"
            )

    # Joining.

    def _chain(self) -> Chain:
        """Nodes of the map, with gaps of travel between the drives."""
        return reduce(together, (one.chain for one in self.drives))

    def _joined(self, new: Drive, progress: Callable[[int, int], object]) -> Alignment:
        """Join a drive to the map if its places agree on where it began."""
        old = self._chain()
        n = len(old.nodes)
        alignment = recognised(old, new.chain, progress)
        if alignment.frame is None:
            return alignment
        trial = copy(self)
        moved = replace(new, poses=compose(alignment.frame, new.poses), closures=[])
        trial.drives = [*map(replace, self.drives), moved]
        own = [replace(one, j=one.j + n, k=one.k + n) for one in new.closures]
        trial.closures = [*map(replace, self.closures), *own, *alignment.closures]
        trial._solve()
        trial._go_along(n, min(c.k for c in alignment.closures if c.state == "confirmed"))
        across = [c for c in trial.closures if c.j < n <= c.k]
        sure = any(one.state == "confirmed" for one in across)
        if sure:
            self.drives, self.closures = trial.drives, trial.closures
        frame = compose(moved.poses[0], inverse(new.poses[0])) if sure else None
        return Alignment(frame, across, alignment.places)

    def _go_along(self, n: int, begin: int) -> None:
        """Look for more closures of the last drive, whose first node is n: forth and back."""
        end = sum(len(one.nodes) for one in self.drives)
        for way in (range(begin, end - N_QUERY_SCANS), range(begin, n + N_QUERY_SCANS - 1, -1)):
            travel = self._chain().travel
            last_tried = last_closed = travel[begin]
            for k in way:
                if abs(travel[k] - last_tried) < CLOSURE_SPACING:
                    continue
                last_tried, chain = travel[k], self._chain()
                # Found in all of the map before, it would be consistent with itself.
                known = {(one.j, one.k) for one in self.closures}
                found = more(k, n, chain, float(abs(last_tried - last_closed)))
                self.closures += [one for one in found if (one.j, one.k) not in known]
                across = [one for one in self.closures if one.j < n <= one.k]
                if confirm(across, self.closures, chain):
                    last_closed = last_tried
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
        arrays = arrays_of(self.scan, self.drives, self.waiting, self.closures)
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
        arrays, new = read_npz(path), cls.__new__(cls)
        try:
            new.scan, new.drives, new.waiting, new.closures = contents_of(arrays)
        except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"{path}: expected a map of drives ({str(error)[:200]})") from error
        return new


def _said(scan: ScanGeometry) -> str:
    """Words for a lidar."""
    angles = np.rad2deg([scan.beam_angles.min(), scan.beam_angles.max()])
    ahead = f", {scan.offset:g} m ahead" if scan.offset else ""
    return (
        f"{scan.n_beams} beams from {angles[0]:.1f} to {angles[1]:.1f} degrees up to "
        f"{scan.max_range:g} m{ahead}"
    )
