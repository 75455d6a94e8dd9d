"""A path of cubics that grows and is cut at its end: arc length, nearest point, loops cut out.

P3 sections 3 and 4. `slamlab.navigation.path_memory` is the face; here data is trusted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamlab._checks import Array
from slamlab._compiling import njit
from slamlab.navigation import _boxes, _cubic

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
        self.coefficients, self.tables = np.zeros((16, 4, 2)), np.zeros((16, _cubic.PIECES + 1))
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
        _boxes.set_boxes(self.boxes, self.coefficients, self.n)

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
        _refresh(self.coefficients, self.tables, self.starts, self.boxes, self.n - 1)

    def cut(self, i: int, tau: float) -> None:
        """Forget everything after parameter tau of segment i."""
        self.n = i
        if tau > 0.0:
            self.append(_cubic.restrict(self.coefficients[i], 0.0, tau))
            if self.starts[self.n] - self.starts[i] < 1e-12:
                self.n = i
        if self.n:
            # The boxes above the last segment must forget what is gone.
            _boxes.set_box(self.boxes, self.coefficients, self.n - 1, self.n)

    def locate(self, s: float) -> tuple[int, float]:
        """Segment and parameter at arc length s; the ends outside."""
        i = int(_segment_at(self.starts, self.n, s))
        tau = _cubic.parameter_at(self.coefficients[i], self.tables[i], s - self.starts[i])
        return i, float(tau)

    def arc_length(self, i: int, tau: float) -> float:
        """Arc length (m) at parameter tau of segment i."""
        inside = _cubic.length_to(self.coefficients[i], self.tables[i], tau)
        return float(self.starts[i] + inside)

    def points(self, s: Array, derivative: bool = False) -> Array:
        """Points, or unit tangents, (n, 2) at arc lengths (n,)."""
        out = np.empty((len(s), 2))
        _points(self.coefficients, self.tables, self.starts, self.n, s, derivative, out)
        return out

    def nearest(self, points: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Arc length and distance (n,) of the nearest place with low <= s <= high, each (n,)."""
        s, distance = np.empty(len(points)), np.empty(len(points))
        arrays = (self.coefficients, self.tables, self.starts, self.boxes)
        _nearest(*arrays, self.n, points, low, high, s, distance)
        return s, distance

    def meeting(self, c: Array, accuracy: float) -> tuple[float, int, float] | None:
        """Last place where `c`, which begins at our end, meets us: t, segment, tau; or None.

        Near the joint the two touch because they are one path. So the first two accuracies of
        the new cubic are not compared with the last two of the old path.
        """
        if not self.n:
            return None
        guard = 2.0 * accuracy
        table = np.empty(_cubic.PIECES + 1)
        _cubic.fill_table(c, table)
        joint = _cubic.parameter_at(c, table, guard)
        found = self._search(c, joint, 1.0, self.n, 1.0, accuracy) if joint < 1.0 else None
        if found is None and self.length > guard:
            i, tau = self.locate(self.length - guard)
            found = self._search(c, 0.0, joint, i + 1, tau, accuracy)
        return found

    def _search(
        self, c: Array, low: float, high: float, n: int, last_tau: float, accuracy: float
    ) -> tuple[float, int, float] | None:
        result = _boxes.search(
            c, low, high, self.coefficients, self.boxes, n, last_tau, accuracy, False
        )
        self.box_tests += int(result[_boxes.TESTS])
        t, touch = float(result[_boxes.CROSS_T]), float(result[_boxes.TOUCH_T])
        # A steep crossing explains all touches a few accuracies after it.
        if t >= 0.0 and _cubic.length_between(c, t, max(t, touch)) <= 10.0 * accuracy:
            return t, int(result[_boxes.CROSS_I]), float(result[_boxes.CROSS_TAU])
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
        n = _cubic.monotone_cuts(c, cuts)
        for a, b in zip(cuts[: n - 1], cuts[1:n], strict=True):
            loops += self._join(_cubic.restrict(c, a, b), accuracy)
        if not loops:
            # Nothing was met, so it is stored whole.
            self.cut(before, 0.0)
            self.append(c)
        return loops

    def _own_loop(self, c: Array, first: float, second: float) -> Loop:
        x, y = _cubic.point(c, first).tolist()
        s = self.length + float(_cubic.length_between(c, 0.0, first))
        return Loop(s, float(_cubic.length_between(c, first, second)), (x, y))

    def _join(self, c: Array, accuracy: float) -> list[Loop]:
        """Add a piece that does not meet itself, without the loops that it closes."""
        loops: list[Loop] = []
        found = self.meeting(c, accuracy)
        if found is not None:
            loops.append(self._cut_loop(c, *found))
            c = _cubic.restrict(c, found[0], 1.0)
        # What crosses within an accuracy of the joint, or of the cut, is looked for again there.
        for finer in (accuracy / 64.0, accuracy / 4096.0):
            table = np.empty(_cubic.PIECES + 1)
            _cubic.fill_table(c, table)
            near = _cubic.parameter_at(c, table, 4.0 * accuracy)
            found = self.meeting(_cubic.restrict(c, 0.0, near), finer) if near > 0.0 else None
            if found is not None:
                t, i, tau = found
                loops.append(self._cut_loop(c, near * t, i, tau))
                c = _cubic.restrict(c, near * t, 1.0)
        if _cubic.length_between(c, 0.0, 1.0) > 1e-12:
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
        removed = before - after + float(_cubic.length_between(c, 0.0, t))
        return Loop(after, removed - gap, (float(place[0]), float(place[1])))


@njit(cache=True)
def _refresh(coefficients, tables, starts, boxes, i):  # type: ignore[no-untyped-def]
    """Renew what depends on the coefficients of the last segment i."""
    _cubic.fill_table(coefficients[i], tables[i])
    starts[i + 1] = starts[i] + tables[i, _cubic.PIECES]
    _boxes.set_box(boxes, coefficients, i, i + 1)


@njit(cache=True)
def _segment_at(starts, n, s):  # type: ignore[no-untyped-def]
    i = np.searchsorted(starts[:n], s, side="right") - 1
    return min(max(i, 0), n - 1)


@njit(cache=True)
def _points(coefficients, tables, starts, n, s, derivative, out):  # type: ignore[no-untyped-def]
    for row in range(len(s)):
        i = _segment_at(starts, n, s[row])
        c = coefficients[i]
        t = _cubic.parameter_at(c, tables[i], s[row] - starts[i])
        if not derivative:
            out[row, 0], out[row, 1] = _cubic.value(c, t, _cubic.X), _cubic.value(c, t, _cubic.Y)
            continue
        dx, dy = _cubic.slope(c, t, _cubic.X), _cubic.slope(c, t, _cubic.Y)
        speed = np.hypot(dx, dy)
        out[row, 0], out[row, 1] = (dx / speed, dy / speed) if speed > 0.0 else (1.0, 0.0)


@njit(cache=True)
def _nearest(coefficients, tables, starts, boxes, n, points, low, high, s, distance):  # type: ignore[no-untyped-def]
    half = len(boxes) // 2
    for row in range(len(points)):
        x, y = points[row, 0], points[row, 1]
        first, last = _segment_at(starts, n, low[row]), _segment_at(starts, n, high[row])
        best, best_i, best_t = np.inf, first, 0.0
        for i in range(first, last + 1):
            box = boxes[half + i]
            away_x = max(box[0] - x, 0.0, x - box[2])
            away_y = max(box[1] - y, 0.0, y - box[3])
            if away_x * away_x + away_y * away_y >= best:
                continue
            a, b = 0.0, 1.0
            if i == first:
                a = _cubic.parameter_at(coefficients[i], tables[i], low[row] - starts[i])
            if i == last:
                b = _cubic.parameter_at(coefficients[i], tables[i], high[row] - starts[i])
            t, squared = _cubic.nearest_parameter(coefficients[i], x, y, a, b)
            if squared < best:
                best, best_i, best_t = squared, i, t
        at = starts[best_i] + _cubic.length_to(coefficients[best_i], tables[best_i], best_t)
        s[row] = min(max(at, low[row]), high[row])
        distance[row] = np.sqrt(best)
