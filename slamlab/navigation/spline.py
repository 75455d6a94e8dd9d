"""A path of cubics that grows at its end, and the loops that are cut out of it.

P3 sections 3 and 4: what is forgotten where a new cubic meets the old path (`boxes` searches for
that), and arc length. `path_memory` stores its segments here; data is trusted. Chapter 17.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamlab._checks import Array
from slamlab.kernels import compiled
from slamlab.navigation.boxes import Meeting, search
from slamlab.navigation.cubic import (
    PIECES,
    arc_length,
    arc_length_table,
    bounding_box,
    monotone_cuts,
    nearest_parameter,
    own_crossing,
    parameter_at,
    point,
    restrict,
    runs_forward,
    slope,
)

__all__ = ["Loop"]

EMPTY = np.array([np.inf, np.inf, -np.inf, -np.inf])


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
    """Cubics joined end to end, in arrays that double when they are full.

    `boxes` is a heap: box 1 holds all, boxes 2 k and 2 k + 1 the halves of box k.
    """

    def __init__(self) -> None:
        self.n = 0
        self.box_tests = 0
        self.coefficients, self.tables = np.zeros((16, 4, 2)), np.zeros((16, PIECES + 1))
        self.starts, self.boxes = np.zeros(17), np.tile(EMPTY, (32, 1))

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
        leaves = self.boxes[self.n :]
        self.boxes = np.tile(EMPTY, (4 * self.n, 1))
        for i, box in enumerate(leaves):
            self._set_box(i, box)

    def _set_box(self, i: int, box: Array) -> None:
        """Renew the box of segment i and of all above it."""
        node = len(self.boxes) // 2 + i
        self.boxes[node] = box
        while node > 1:
            node //= 2
            halves = self.boxes[2 * node : 2 * node + 2]
            self.boxes[node, :2] = halves[:, :2].min(0)
            self.boxes[node, 2:] = halves[:, 2:].max(0)

    @property
    def length(self) -> float:
        """Arc length (m)."""
        return float(self.starts[self.n])

    def append(self, c: Array) -> None:
        """Add a cubic at the end."""
        if self.n == len(self.coefficients):
            self._double()
        i, self.n = self.n, self.n + 1
        self.coefficients[i], self.tables[i] = c, arc_length_table(c)
        self.starts[i + 1] = self.starts[i] + self.tables[i, -1]
        self._set_box(i, bounding_box(c))

    def cut(self, i: int, tau: float) -> None:
        """Forget everything after parameter tau of segment i."""
        for k in range(i, self.n):
            self._set_box(k, EMPTY)
        self.n = i
        if tau > 0.0:
            self.append(restrict(self.coefficients[i], 0.0, tau))
            if self.starts[i + 1] - self.starts[i] < 1e-12:
                self._set_box(i, EMPTY)
                self.n = i

    # Asking, P3 section 4.

    def locate(self, s: float) -> tuple[int, float]:
        """Segment and parameter at arc length s; the ends outside."""
        i = segment_at(self.starts[: self.n], s)
        return i, parameter_at(self.coefficients[i], self.tables[i], s - self.starts[i])

    def arc_length(self, i: int, tau: float) -> float:
        """Arc length (m) at parameter tau of segment i."""
        return float(self.starts[i] + length_to(self.coefficients[i], self.tables[i], tau))

    def points(self, s: Array, derivative: bool = False) -> Array:
        """Points, or unit tangents, (n, 2) at arc lengths (n,)."""
        n = self.n
        return points_at(self.coefficients[:n], self.tables[:n], self.starts[:n], s, derivative)

    def nearest(self, points: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Arc length and distance (n,) of the nearest place with low <= s <= high, each (n,)."""
        n, half = self.n, len(self.boxes) // 2
        boxes = self.boxes[half : half + n]
        path = self.coefficients[:n], self.tables[:n], self.starts[:n], boxes
        return nearest(*path, points, low, high)

    # Loops, P3 section 3.

    def append_without_loops(self, c: Array, accuracy: float) -> list[Loop]:
        """Add a cubic that begins at our end and cut out every loop that this closes."""
        waiting, loops = [c], []
        while waiting:
            piece = waiting.pop(0)
            found = None if runs_forward(piece) else own_crossing(piece)
            if found is not None:
                first, second = found
                parts = [(0.0, first), (second, 1.0)]
                loops.append(self._own_loop(piece, first, second))
                waiting = [restrict(piece, a, b) for a, b in parts if a < b] + waiting
            elif runs_forward(piece):
                loops += self._join(piece, accuracy)
            else:
                loops += self._join_in_pieces(piece, accuracy)
        return loops

    def _own_loop(self, c: Array, first: float, second: float) -> Loop:
        x, y = point(c, first).tolist()
        s = self.length + float(arc_length(c, 0.0, first))
        return Loop(s, float(arc_length(c, first, second)), (x, y))

    def _join_in_pieces(self, c: Array, accuracy: float) -> list[Loop]:
        """Add a cubic that turns back, perhaps on its own trace: between extrema it cannot."""
        before, cuts = self.n, monotone_cuts(c)
        loops = []
        for a, b in zip(cuts[:-1], cuts[1:], strict=True):
            loops += self._join(restrict(c, a, b), accuracy)
        if not loops:
            # Nothing was met, so it is stored whole.
            self.cut(before, 0.0)
            self.append(c)
        return loops

    def _join(self, c: Array, accuracy: float) -> list[Loop]:
        """Add a piece that does not meet itself, without the loops that it closes."""
        loops: list[Loop] = []
        # What crosses within an accuracy of the joint, or of the cut, is searched for again there.
        for finer in (accuracy, accuracy / 64.0, accuracy / 4096.0):
            near = 1.0
            if finer < accuracy:
                near = parameter_at(c, arc_length_table(c), 4.0 * accuracy)
            found = self.meeting(restrict(c, 0.0, near), finer) if near > 0.0 else None
            if found is not None:
                t, i, tau = found
                loops.append(self._cut_loop(c, near * t, i, tau))
                c = restrict(c, near * t, 1.0)
        if arc_length(c, 0.0, 1.0) > 1e-12:
            self.append(c)
        return loops

    def _cut_loop(self, c: Array, t: float, i: int, tau: float) -> Loop:
        """Forget what lies between tau of segment i and t of the new piece; reach that place."""
        before = self.length
        place = point(self.coefficients[i], tau)
        self.cut(i, tau)
        after = self.length
        step = point(c, t) - place
        gap = float(np.hypot(*step))
        if gap > 1e-12:
            # Where the path only touches itself a short straight piece closes the gap.
            self.append(np.stack([place, step, np.zeros(2), np.zeros(2)]))
        removed = before - after + float(arc_length(c, 0.0, t))
        return Loop(after, removed - gap, (float(place[0]), float(place[1])))

    def meeting(self, c: Array, accuracy: float) -> Meeting | None:
        """Last place where `c`, which begins at our end, meets us: t, segment, tau; or None.

        Near the joint the two touch because they are one path. So the first two accuracies of
        the new cubic are not compared with the last two of the old path.
        """
        if not self.n:
            return None
        guard = 2.0 * accuracy
        joint = parameter_at(c, arc_length_table(c), guard)
        found = self._search(c, joint, 1.0, self.n, 1.0, accuracy) if joint < 1.0 else None
        if found is None and self.length > guard:
            i, tau = self.locate(self.length - guard)
            found = self._search(c, 0.0, joint, i + 1, tau, accuracy)
        return found

    def _search(
        self, c: Array, low: float, high: float, n: int, last_tau: float, accuracy: float
    ) -> Meeting | None:
        path = self.coefficients[:n], self.boxes
        crossed, touched, tests = search(c, low, high, *path, last_tau, accuracy)
        self.box_tests += tests
        t, touch = crossed[0], touched[0]
        # A steep crossing explains all touches a few accuracies after it.
        if t >= 0.0 and arc_length(c, t, max(t, touch)) <= 10.0 * accuracy:
            return crossed
        if touch < 0.0:
            return None
        limit = self.arc_length(n - 1, last_tau)
        s, _ = self.nearest(point(c, touch)[None], np.zeros(1), np.array([limit]))
        return (touch, *self.locate(float(s[0])))


# The path in arrays: coefficients (n, 4, 2), tables of arc length (n, PIECES + 1), starts (n,).


def segment_at(starts: Array, s: float) -> int:
    """Segment on which arc length s lies."""
    i = int(np.searchsorted(starts, s, side="right")) - 1
    return min(max(i, 0), len(starts) - 1)


def length_to(c: Array, table: Array, tau: float) -> float:
    """Arc length of a cubic from 0 to tau."""
    i = min(int(tau * PIECES), PIECES - 1)
    return float(table[i] + arc_length(c, i / PIECES, tau))


@compiled("spline.points_at")
def points_at(c: Array, tables: Array, starts: Array, s: Array, derivative: bool) -> Array:
    """Points, or unit tangents, (k, 2) at arc lengths (k,)."""
    out = np.empty((len(s), 2))
    for row, length in enumerate(s):
        i = segment_at(starts, length)
        t = parameter_at(c[i], tables[i], length - starts[i])
        if not derivative:
            out[row] = point(c[i], t)
            continue
        direction = slope(c[i], t)
        speed = np.hypot(*direction)
        out[row] = direction / speed if speed > 0.0 else (1.0, 0.0)
    return out


@compiled("spline.nearest")
def nearest(
    c: Array, tables: Array, starts: Array, boxes: Array, places: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Arc length and distance (k,) of the nearest point to each place (k, 2) in its window.

    A segment whose box (n, 4) is farther away than the best so far is left out.
    """
    s, distance = np.empty(len(places)), np.empty(len(places))
    for row, place in enumerate(places):
        first, last = segment_at(starts, low[row]), segment_at(starts, high[row])
        off = np.maximum(np.maximum(boxes[:, :2] - place, place - boxes[:, 2:]), 0.0)
        best, best_i, best_t = np.inf, first, 0.0
        for i in range(first, last + 1):
            if off[i] @ off[i] >= best:
                continue
            a = parameter_at(c[i], tables[i], low[row] - starts[i]) if i == first else 0.0
            b = parameter_at(c[i], tables[i], high[row] - starts[i]) if i == last else 1.0
            t, squared = nearest_parameter(c[i], place, a, b)
            if squared < best:
                best, best_i, best_t = squared, i, t
        at = starts[best_i] + length_to(c[best_i], tables[best_i], best_t)
        s[row], distance[row] = np.clip(at, low[row], high[row]), np.sqrt(best)
    return s, distance
