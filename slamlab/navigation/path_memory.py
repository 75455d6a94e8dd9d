"""Path memory: a robot's path stored as it comes, in cubics, with loops cut out.

P3 sections 1 to 4: formula (1), the four constrained fits, steps 1.1 to 1.7 of its algorithm.
Chapter 17 derives every formula; chapter 20 drives home along such a memory.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_choice, as_count, as_scalar
from slamlab._files import read_npz
from slamlab.navigation.cubic import (
    PIECES,
    Cubic,
    as_metres,
    deviation,
    fit,
)
from slamlab.navigation.spline import Loop, Spline

__all__ = ["VARIANTS", "PathMemory"]

VARIANTS = ("point", "point-derivative", "two-points", "two-points-derivative")
_FORMAT = 1
_MOST_POINTS = 10_000_000


@dataclass(frozen=True)
class OpenSegment:
    """The points since the last knot, and the curve through them.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        The knot first (m).
    t : ndarray, shape (n,)
        Their parameters: lengths of the polygon through them (m).
    curve : ndarray, shape (4, 2), or None
        Coefficients over tau = t / t[-1]; None with fewer than two points.
    slope : ndarray, shape (2,), or None
        Derivative by t that the curve must have at the knot.
    """

    points: Array
    t: Array = field(default_factory=lambda: np.zeros(1))
    curve: Array | None = None
    slope: Array | None = None

    def distance(self, point: Array) -> float:
        """How far a point is from the last one (m)."""
        return float(np.hypot(*(point - self.points[-1])))


class PathMemory:
    """The path of a robot, stored a point at a time as cubics with loops cut out.

    Each point is fitted together with those since the last knot. As soon as one of them lies
    farther than the tolerance from the curve, the curve without the newest point becomes a
    segment, the loops that it closes are cut out, and the newest point opens the next segment.

    Parameters
    ----------
    tolerance : float
        E of P3 (m), positive: no point lies farther from the path as stored before loops are cut
        out.
    variant : str, default "two-points"
        Constraints of a segment: "point", "point-derivative", "two-points" or
        "two-points-derivative". The first segment has no derivative to go on from.
    loop_accuracy : float or None, default 1e-4
        Two places of the path that come as near as this (m) count as one place, and what lies
        between them as a loop. At most the tolerance; None keeps all loops.
    check_between : bool, default True
        Also hold the curve within the tolerance of the line between two points, halfway. P3 does
        not, and its smooth variant bulges there.
    min_step : float, optional
        Nearer points than this (m) to the last one kept are not stored; at most half of the
        tolerance, a hundredth of it by default. What they may hide is taken off the tolerance.
    max_step : float, default 1.0
        A jump of more than this (m) is refused; at least the tolerance.
    max_points : int, default 256
        A segment closes after so many points, 8 or more, at the latest, which bounds the time of
        `add`.

    Attributes
    ----------
    n_points : int
        Points stored so far, skipped ones not counted.

    Examples
    --------
    A robot drives a square of one metre, half a side further, and turns inwards:

    >>> memory = PathMemory(0.05)
    >>> side = np.linspace(0, 1, 11)
    >>> for x, y in [*[(v, 0) for v in side], *[(1, v) for v in side], *[(1 - v, 1) for v in side],
    ...              *[(0, 1 - v / 2) for v in side], *[(v / 2, 0.5 - 1.2 * v) for v in side]]:
    ...     memory.add((x, y))
    >>> memory.close()
    >>> len(memory.loops), round(memory.length, 2)
    (1, 0.96)
    """

    def __init__(
        self,
        tolerance: float,
        variant: str = "two-points",
        *,
        loop_accuracy: float | None = 1e-4,
        check_between: bool = True,
        min_step: float | None = None,
        max_step: float = 1.0,
        max_points: int = 256,
    ) -> None:
        self.tolerance = as_scalar("tolerance", tolerance, low=1e-9, high=1e9)
        self.variant = as_choice("variant", variant, VARIANTS)
        if loop_accuracy is not None:
            loop_accuracy = as_scalar("loop_accuracy", loop_accuracy, 1e-9, self.tolerance)
        self.loop_accuracy = loop_accuracy
        self.check_between = bool(check_between)
        step = 0.01 * self.tolerance if min_step is None else min_step
        self.min_step = as_scalar("min_step", step, low=0.0, high=0.5 * self.tolerance)
        self.max_step = as_scalar("max_step", max_step, low=self.tolerance)
        self.max_points = as_count("max_points", max_points, low=8)
        self.n_points = 0
        self._spline = Spline()
        self._loops: list[Loop] = []
        self._open = OpenSegment(np.empty((0, 2)), np.empty(0))

    def __repr__(self) -> str:
        """Return length, segments and tolerance."""
        return (
            f"PathMemory({self.length:.2f} m in {self.n_segments} segments, "
            f"{len(self._loops)} loops cut out, tolerance {self.tolerance:g} m)"
        )

    # Storing.

    @classmethod
    def from_points(
        cls, points: ArrayLike, tolerance: float, variant: str = "two-points", **options: Any
    ) -> PathMemory:
        """Store a whole path of points (n, 2), n >= 1, and close it; options as above.

        Raises
        ------
        ValueError
            If a step is a jump of more than `max_step`.

        Examples
        --------
        >>> PathMemory.from_points([[0, 0], [0.5, 0], [1, 0]], 0.05)
        PathMemory(1.00 m in 1 segments, 0 loops cut out, tolerance 0.05 m)
        """
        memory = cls(tolerance, variant, **options)
        for point in as_metres("points", points, ("n", 2)):
            memory.add(point)
        memory.close()
        return memory

    def add(self, point: ArrayLike) -> None:
        """Store the next point (m, m) of the path, P3 steps 1.2 to 1.7.

        Raises
        ------
        ValueError
            If it is a jump of more than `max_step`. What was stored stays.
        """
        point = as_metres("point", point, (2,))
        before = self._open
        if len(before.points) == 0:
            # 1.1: the place where everything begins.
            self._open, self.n_points = OpenSegment(point[None]), 1
            return
        step = before.distance(point)
        if step > self.max_step:
            wanted = f"a step of at most {self.max_step:g} m"
            raise ValueError(f"point: expected {wanted}, got a jump of {step:.3g} m")
        if step <= self.min_step:
            return
        # 1.2 to 1.4: the curve through this point too, and how far a point is from it.
        longer, gap = self._fitted(before, point, step)
        self.n_points += 1
        if gap <= self.tolerance - self.min_step or len(before.points) < 2:
            self._open = longer
            if len(longer.points) == self.max_points:
                self.close()
            return
        # 1.5: too far, so the curve without the newest point becomes a segment ...
        self.close()
        # ... and the newest point, which is retained, opens the next one.
        step = self._open.distance(point)
        if step > 0.0:
            self._open, _ = self._fitted(self._open, point, step)

    def close(self) -> None:
        """Make a segment of the points since the last knot, and cut out the loops it closes."""
        curve, slope = self._open.curve, self._open.slope
        if curve is None:
            return
        # 1.5, 1.7: the open curve becomes a segment, loops go, its end is the next knot.
        if self.loop_accuracy is None:
            self._spline.append(curve)
        else:
            self._loops += self._spline.append_without_loops(curve, self.loop_accuracy)
        if self.variant.endswith("derivative"):
            slope = (curve[1] + 2 * curve[2] + 3 * curve[3]) / self._open.t[-1]
        self._open = OpenSegment(curve.sum(0)[None], slope=slope)

    def _fitted(
        self, segment: OpenSegment, point: Array, step: float
    ) -> tuple[OpenSegment, float]:
        """Fit a point more, P3 steps 1.3 and 1.4; how far a point lies from the curve (m)."""
        points = np.concatenate([segment.points, point[None]])
        # 1.3: t_i = t_(i-1) + |d_i - d_(i-1)|
        t = np.concatenate([segment.t, segment.t[-1:] + step])
        tau, slope = t / t[-1], (0.0, 0.0)
        if segment.slope is not None:
            slope = (segment.slope * t[-1]).tolist()
        has_end = self.variant.startswith("two-points")
        curve = fit(tau, points, has_end, segment.slope is not None, *slope)
        gap = deviation(curve, tau, points, self.check_between)
        return OpenSegment(points, t, curve, segment.slope), gap

    def _path(self) -> Spline:
        """Return the path as it stands: what is stored and, at its end, the open curve."""
        if self._open.curve is None:
            return self._spline
        whole = self._spline.copy()
        whole.append(self._open.curve)
        return whole

    # Asking.

    @property
    def loops(self) -> tuple[Loop, ...]:
        """Loops cut out so far."""
        return tuple(self._loops)

    def meeting(self) -> float | None:
        """Search where the open segment meets the stored path, and change nothing.

        `add` searches when a segment closes, which is enough to cut the loops out; P3 does so at
        every point. For a robot that wants to know at once that it has come back to its own way.

        Returns
        -------
        float or None
            Arc length (m) of the last place met; None if there is none.

        Raises
        ------
        ValueError
            If `loop_accuracy` is None: loops are not searched for.
        """
        if self.loop_accuracy is None:
            raise ValueError("loop_accuracy: expected a length to look for loops, got None")
        if self._open.curve is None:
            return None
        found = self._spline.meeting(self._open.curve, self.loop_accuracy)
        return None if found is None else self._spline.arc_length(found[1], found[2])

    @property
    def box_tests(self) -> int:
        """Boxes compared in the search for loops so far."""
        return self._spline.box_tests

    @property
    def length(self) -> float:
        """Arc length of the stored path (m), the open segment included."""
        return self._path().length

    @property
    def n_segments(self) -> int:
        """Number of segments, the open one included."""
        return self._path().n

    @property
    def segments(self) -> tuple[Cubic, ...]:
        """The segments in order, each over [0, 1]; the open one last."""
        path = self._path()
        return tuple(Cubic(c) for c in path.coefficients[: path.n])

    @property
    def knots(self) -> Array:
        """Arc lengths (n_segments + 1,) at which segments begin and end (m)."""
        path = self._path()
        return path.starts[: path.n + 1].copy()

    @property
    def nbytes(self) -> int:
        """Memory that the segments and the open points need (bytes)."""
        numbers = self.n_segments * (8 + PIECES + 1 + 1 + 2 * 4) + len(self._open.points) * 3
        return 8 * numbers

    def point_at(self, s: ArrayLike) -> Array:
        """Points (..., 2) of the path at arc lengths (...) from the start (m), in [0, length].

        Raises
        ------
        ValueError
            If nothing is stored.
        """
        return self._ask(s, derivative=False)

    def tangent_at(self, s: ArrayLike) -> Array:
        """Return unit tangents (..., 2), in the direction of growing s; arguments as above."""
        return self._ask(s, derivative=True)

    def _ask(self, s: ArrayLike, derivative: bool) -> Array:
        path = self._path()
        s = self._arc_lengths("s", s, path.length)
        if path.n == 0:
            single = [1.0, 0.0] if derivative else self._open.points[0]
            return np.broadcast_to(single, (*s.shape, 2)).copy()
        return path.points(s.reshape(-1), derivative).reshape(*s.shape, 2)

    def _arc_lengths(self, name: str, s: ArrayLike, length: float) -> Array:
        s = as_array(name, s)
        if len(self._open.points) == 0:
            raise ValueError("add: expected at least one point in the memory, got none yet")
        room = 1e-9 * (1.0 + length)
        if s.size and not (s.min() >= -room and s.max() <= length + room):
            wanted, got = f"arc lengths in [0, {length:.6g}]", f"{s.min():g} to {s.max():g}"
            raise ValueError(f"{name}: expected {wanted}, got {got}")
        return np.clip(s, 0.0, length)

    def nearest(
        self, point: ArrayLike, low: ArrayLike = 0.0, high: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Find the nearest place of the path within a window of arc length.

        Parameters
        ----------
        point : array_like, shape (..., 2)
            Places of the plane (m).
        low, high : array_like, shape (...)
            Ends of the window (m), on the path and low <= high; the whole path without them. Where
            a path comes near itself the window says which of its branches is meant.

        Returns
        -------
        s : ndarray, shape (...)
            Arc length of the nearest place (m).
        distance : ndarray, shape (...)
            How far it is (m).

        Raises
        ------
        ValueError
            If nothing is stored.
        """
        point = as_array("point", point, ("...", 2))
        path = self._path()
        low = self._arc_lengths("low", low, path.length)
        high = self._arc_lengths("high", path.length if high is None else high, path.length)
        shape = np.broadcast_shapes(point.shape[:-1], low.shape, high.shape)
        low, high = (np.broadcast_to(v, shape).reshape(-1).copy() for v in (low, high))
        if (low > high).any():
            raise ValueError("low: expected a window with low <= high, got low above high")
        flat = np.broadcast_to(point, (*shape, 2)).reshape(-1, 2).astype(np.float64)
        if path.n == 0:
            s, distance = np.zeros(len(flat)), np.hypot(*(flat - self._open.points[0]).T)
        else:
            s, distance = path.nearest(np.ascontiguousarray(flat), low, high)
        return s.reshape(shape)[()], distance.reshape(shape)[()]

    # Keeping.

    def save(self, file: str | PathLike[str]) -> None:
        """Write everything, the open segment included, to an npz file (no pickle)."""
        n, accuracy, last = self._spline.n, self.loop_accuracy, self._open
        loops = [(loop.s, loop.length, *loop.place) for loop in self._loops]
        np.savez(
            file,
            format=_FORMAT,
            variant=self.variant,
            numbers=[self.tolerance, self.min_step, self.max_step],
            loop_accuracy=np.nan if accuracy is None else accuracy,
            counts=[self.check_between, self.max_points, self.n_points, self.box_tests],
            coefficients=self._spline.coefficients[:n],
            loops=np.array(loops).reshape(-1, 4),
            points=last.points,
            t=last.t,
            slope=np.zeros((0, 2)) if last.slope is None else last.slope[None],
            curve=np.zeros((0, 4, 2)) if last.curve is None else last.curve[None],
        )

    @classmethod
    def load(cls, file: str | PathLike[str]) -> PathMemory:
        """Read what `save` wrote; the memory goes on where it stood.

        Raises
        ------
        ValueError
            If the file is no path memory.
        """
        kept = read_npz(file, what="path memory")
        try:
            if int(kept["format"]) != _FORMAT:
                raise ValueError(f"format {kept['format']}")
            return cls._from_arrays(kept)
        except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
            reason = str(error)[:200]
            raise ValueError(f"file: expected a path memory in {file}, got {reason}") from error

    @classmethod
    def _from_arrays(cls, kept: dict[str, Any]) -> PathMemory:
        tolerance, min_step, max_step = as_array("numbers", kept["numbers"], (3,)).tolist()
        counts = as_array("counts", kept["counts"], (4,))
        check_between, max_points, n_points, box_tests = (int(v) for v in counts)
        if not 0 <= len(kept["t"]) <= max_points <= _MOST_POINTS:
            raise ValueError(f"{len(kept['t'])} points of at most {max_points}")
        accuracy = float(kept["loop_accuracy"])
        memory = cls(
            tolerance,
            str(kept["variant"]),
            loop_accuracy=None if np.isnan(accuracy) else accuracy,
            check_between=bool(check_between),
            min_step=min_step,
            max_step=max_step,
            max_points=max_points,
        )
        for c in as_metres("coefficients", kept["coefficients"], ("n", 4, 2)):
            memory._spline.append(c)
        memory._spline.box_tests = box_tests
        loops = as_metres("loops", kept["loops"], ("n", 4)).tolist()
        memory._loops = [Loop(s, length, (x, y)) for s, length, x, y in loops]
        memory.n_points = n_points
        t = as_array("t", kept["t"], ("n",))
        if (t[:1] != 0.0).any() or (np.diff(t) <= 0.0).any():
            raise ValueError("t: expected arc lengths that grow from 0, got others")
        points = as_metres("points", kept["points"], (len(t), 2))
        slopes = as_metres("slope", kept["slope"], ("n", 2))
        curves = as_metres("curve", kept["curve"], ("n", 4, 2))
        if len(slopes) > 1 or len(curves) > (len(t) > 1):
            got = f"{len(slopes)} and {len(curves)} for {len(t)} points"
            raise ValueError(f"slope, curve: expected at most one each, got {got}")
        memory._open = OpenSegment(points, t, next(iter(curves), None), next(iter(slopes), None))
        return memory
