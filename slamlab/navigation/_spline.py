"""A path of cubics that grows and is cut at its end: arc length, nearest point, loops cut out.

P3 sections 3 and 4. `slamlab.navigation.path_memory` is the face; here data is trusted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamlab._checks import Array
from slamlab.kernels import boxes, spline
from slamlab.kernels import cubic as _loops
from slamlab.navigation import _cubic

__all__ = ["Loop", "Spline"]


@dataclass(frozen=True)
class Loop:
    """A loop that was cut out.

    Attributes
    ----------
    s : float
        Arc length (m) at which the kept path was cut when the loop was found.
    length : float
        By how much the path became shorter (m).
    place : tuple of float
        Where the path met itself (m, m).
    """

    s: float
    length: float
    place: tuple[float, float]


class Spline:
    """Cubics joined end to end, in arrays that double when they are full."""

    def __init__(self) -> None:
        self.n = 0
        self.box_tests = 0
        self.coefficients, self.tables = np.zeros((16, 4, 2)), np.zeros((16, _loops.PIECES + 1))
        self.starts, self.boxes = np.zeros(17), np.zeros((32, 4))

    def copy(self) -> Spline:
        """Return a path of its own that may grow and be cut."""
        other = Spline()
        other.n, other.box_tests = self.n, self.box_tests
        for name in ("coefficients", "tables", "starts", "boxes"):
            setattr(other, name, getattr(self, name).copy())
        return other

    def _double(self) -> None:
        for name in ("coefficients", "tables", "starts"):
            full = getattr(self, name)
            setattr(self, name, np.concatenate([full, np.zeros_like(full[: self.n])]))
        self.boxes = np.zeros((2 * len(self.boxes), 4))
        boxes.set_boxes(self.boxes, self.coefficients, self.n)

    @property
    def length(self) -> float:
        """Arc length (m)."""
        return float(self.starts[self.n])

    def append(self, c: Array) -> None:
        """Add a cubic at the end."""
        if self.n == len(self.coefficients):
            self._double()
        self.coefficients[self.n] = c
        self.n += 1
        spline.refresh(self.coefficients, self.tables, self.starts, self.boxes, self.n - 1)

    def cut(self, i: int, tau: float) -> None:
        """Forget everything after parameter tau of segment i."""
        self.n = i
        if tau > 0.0:
            self.append(_cubic.restrict(self.coefficients[i], 0.0, tau))
            if self.starts[self.n] - self.starts[i] < 1e-12:
                self.n = i
        if self.n:
            # The boxes above the last segment must forget what is gone.
            boxes.set_box(self.boxes, self.coefficients, self.n - 1, self.n)

    def locate(self, s: float) -> tuple[int, float]:
        """Segment and parameter at arc length s; the ends outside."""
        i = int(spline.segment_at(self.starts, self.n, s))
        tau = _loops.parameter_at(self.coefficients[i], self.tables[i], s - self.starts[i])
        return i, float(tau)

    def arc_length(self, i: int, tau: float) -> float:
        """Arc length (m) at parameter tau of segment i."""
        inside = _loops.length_to(self.coefficients[i], self.tables[i], tau)
        return float(self.starts[i] + inside)

    def points(self, s: Array, derivative: bool = False) -> Array:
        """Points, or unit tangents, (n, 2) at arc lengths (n,)."""
        out = np.empty((len(s), 2))
        spline.points(self.coefficients, self.tables, self.starts, self.n, s, derivative, out)
        return out

    def nearest(self, points: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Arc length and distance (n,) of the nearest place with low <= s <= high, each (n,)."""
        s, distance = np.empty(len(points)), np.empty(len(points))
        arrays = (self.coefficients, self.tables, self.starts, self.boxes)
        spline.nearest(*arrays, self.n, points, low, high, s, distance)
        return s, distance

    def meeting(self, c: Array, accuracy: float) -> tuple[float, int, float] | None:
        """Last place where `c`, which begins at our end, meets us: t, segment, tau; or None.

        Near the joint the two touch because they are one path. So the first two accuracies of
        the new cubic are not compared with the last two of the old path.
        """
        if not self.n:
            return None
        guard = 2.0 * accuracy
        table = np.empty(_loops.PIECES + 1)
        _loops.fill_table(c, table)
        joint = _loops.parameter_at(c, table, guard)
        found = self._search(c, joint, 1.0, self.n, 1.0, accuracy) if joint < 1.0 else None
        if found is None and self.length > guard:
            i, tau = self.locate(self.length - guard)
            found = self._search(c, 0.0, joint, i + 1, tau, accuracy)
        return found

    def _search(
        self, c: Array, low: float, high: float, n: int, last_tau: float, accuracy: float
    ) -> tuple[float, int, float] | None:
        result = boxes.search(
            c, low, high, self.coefficients, self.boxes, n, last_tau, accuracy, False
        )
        self.box_tests += int(result[boxes.TESTS])
        t, touch = float(result[boxes.CROSS_T]), float(result[boxes.TOUCH_T])
        # A steep crossing explains all touches a few accuracies after it.
        if t >= 0.0 and _loops.length_between(c, t, max(t, touch)) <= 10.0 * accuracy:
            return t, int(result[boxes.CROSS_I]), float(result[boxes.CROSS_TAU])
        if touch < 0.0:
            return None
        place = _cubic.point(c, touch)[None]
        limit = self.arc_length(n - 1, last_tau)
        s, _ = self.nearest(place, np.zeros(1), np.array([limit]))
        return (touch, *self.locate(float(s[0])))

    def append_without_loops(self, c: Array, accuracy: float) -> list[Loop]:
        """Add a cubic that begins at our end and cut out every loop that this closes."""
        waiting, loops = [c], []
        while waiting:
            piece = waiting.pop(0)
            if _cubic.runs_forward(piece):
                loops += self._join(piece, accuracy)
                continue
            first, second = _cubic.own_crossing(piece)
            if first == first:
                parts = [(0.0, first), (second, 1.0)]
                loops.append(self._own_loop(piece, first, second))
                waiting = [_cubic.restrict(piece, a, b) for a, b in parts if a < b] + waiting
                continue
            # It turns back on itself without a crossing, perhaps on its own trace: between its
            # extrema it cannot.
            loops += self._join_in_pieces(piece, accuracy)
        return loops

    def _join_in_pieces(self, c: Array, accuracy: float) -> list[Loop]:
        cuts, before, loops = np.empty(6), self.n, []
        n = _loops.monotone_cuts(c, cuts)
        for a, b in zip(cuts[: n - 1], cuts[1:n], strict=True):
            loops += self._join(_cubic.restrict(c, a, b), accuracy)
        if not loops:
            # Nothing was met, so it is stored whole.
            self.cut(before, 0.0)
            self.append(c)
        return loops

    def _own_loop(self, c: Array, first: float, second: float) -> Loop:
        x, y = _cubic.point(c, first).tolist()
        s = self.length + float(_loops.length_between(c, 0.0, first))
        return Loop(s, float(_loops.length_between(c, first, second)), (x, y))

    def _join(self, c: Array, accuracy: float) -> list[Loop]:
        """Add a piece that does not meet itself, without the loops that it closes."""
        loops: list[Loop] = []
        found = self.meeting(c, accuracy)
        if found is not None:
            loops.append(self._cut_loop(c, *found))
            c = _cubic.restrict(c, found[0], 1.0)
        # What crosses within an accuracy of the joint, or of the cut, is looked for again there.
        for finer in (accuracy / 64.0, accuracy / 4096.0):
            table = np.empty(_loops.PIECES + 1)
            _loops.fill_table(c, table)
            near = _loops.parameter_at(c, table, 4.0 * accuracy)
            found = self.meeting(_cubic.restrict(c, 0.0, near), finer) if near > 0.0 else None
            if found is not None:
                t, i, tau = found
                loops.append(self._cut_loop(c, near * t, i, tau))
                c = _cubic.restrict(c, near * t, 1.0)
        if _loops.length_between(c, 0.0, 1.0) > 1e-12:
            self.append(c)
        return loops

    def _cut_loop(self, c: Array, t: float, i: int, tau: float) -> Loop:
        """Forget what lies between tau of segment i and t of the new piece; reach that place."""
        before = self.length
        place = _cubic.point(self.coefficients[i], tau)
        self.cut(i, tau)
        after = self.length
        reached = _cubic.point(c, t)
        gap = float(np.hypot(*(reached - place)))
        if gap > 1e-12:
            # Where the path only touches itself a short straight piece closes the gap.
            self.append(np.stack([place, reached - place, np.zeros(2), np.zeros(2)]))
        removed = before - after + float(_loops.length_between(c, 0.0, t))
        return Loop(after, removed - gap, (float(place[0]), float(place[1])))
