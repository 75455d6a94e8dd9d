"""Path memory: a robot's path stored as it comes, in cubics, with loops cut out.

P3 sections 1 to 4: formula (1), the four constrained fits, steps 1.1 to 1.7 of its algorithm.
Chapter 17 derives every formula; chapter 20 drives home along such a memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_choice, as_count, as_instance, as_scalar
from slamlab._files import read_npz
from slamlab.kernels import compiled
from slamlab.kernels import cubic as _loops
from slamlab.navigation import _cubic
from slamlab.navigation._spline import Loop, Spline

__all__ = ["VARIANTS", "Cubic", "Loop", "PathMemory", "fit_cubic", "refit_by_arc_length"]

VARIANTS = ("point", "point-derivative", "two-points", "two-points-derivative")
_FORMAT = 1
_MOST_POINTS = 10_000_000
_FAR = 1e9  # metres: no path is longer, and the compiled searches end


def _metres(name: str, value: ArrayLike, shape: tuple[int | str, ...]) -> Array:
    """Coordinates of a path; nothing of ours lies farther off than a million kilometres."""
    array = as_array(name, value, shape)
    if array.size and np.abs(array).max() > _FAR:
        raise ValueError(f"{name}: expected metres up to {_FAR:g}, got {np.abs(array).max():g}")
    return array


@dataclass(frozen=True, eq=False)
class Cubic:
    """A cubic curve of the plane over t0 <= t <= t1, P3 (1), in the parameter tau.

    tau = (t - t0) / (t1 - t0) runs from 0 to 1, which keeps the powers comparable.

    Attributes
    ----------
    coefficients : ndarray, shape (4, 2)
        Rows are the powers of tau, columns x and y (m).
    t0, t1 : float
        Ends of the parameter, t0 < t1.

    Examples
    --------
    >>> line = Cubic(np.array([[0, 0], [3, 4], [0, 0], [0, 0.0]]), 0.0, 5.0)
    >>> line(2.5).tolist(), round(line.length, 12)
    ([1.5, 2.0], 5.0)
    """

    coefficients: Array
    t0: float = 0.0
    t1: float = 1.0

    def __post_init__(self) -> None:
        """Check, and keep the coefficients from being changed."""
        c = np.array(_metres("coefficients", self.coefficients, (4, 2)), dtype=np.float64)
        c.setflags(write=False)
        object.__setattr__(self, "coefficients", c)
        t0 = as_scalar("t0", self.t0, -1e300, 1e300)
        if not t0 < as_scalar("t1", self.t1, -1e300, 1e300):
            raise ValueError(f"t1: expected more than t0 = {t0:g}, got {self.t1:g}")

    def _tau(self, t: ArrayLike) -> Array:
        return (as_array("t", t) - self.t0) / (self.t1 - self.t0)

    def __call__(self, t: ArrayLike) -> Array:
        """Points (..., 2) at parameters (...)."""
        tau, c = self._tau(t)[..., None], self.coefficients
        return c[0] + tau * (c[1] + tau * (c[2] + tau * c[3]))

    def derivative(self, t: ArrayLike) -> Array:
        """Differentiate by t: (..., 2) at parameters (...)."""
        tau, c = self._tau(t)[..., None], self.coefficients
        return (c[1] + tau * (2 * c[2] + tau * 3 * c[3])) / (self.t1 - self.t0)

    def powers_of_t(self) -> Array:
        """Coefficients a_0 to a_3 (first column) and b_0 to b_3 of P3 (1), shape (4, 2)."""
        shift, width = np.polynomial.Polynomial([-self.t0, 1.0]), self.t1 - self.t0
        out = np.zeros((4, 2))
        for k in range(2):
            total = np.polynomial.Polynomial(self.coefficients[:, k])(shift / width)
            out[: len(total.coef), k] = total.coef
        return out

    @property
    def length(self) -> float:
        """Arc length (m), by quadrature to about 1e-14 of it."""
        return float(_loops.length_between(self.coefficients, 0.0, 1.0))

    def arc_length(self, t: float) -> float:
        """Arc length (m) from t0 to t, which lies in [t0, t1]."""
        t = as_scalar("t", t, self.t0, self.t1)
        return float(_loops.length_between(self.coefficients, 0.0, float(self._tau(t))))

    def box(self) -> Array:
        """Exact bounding box: x low, y low, x high, y high (m), from ends and extrema."""
        box = np.empty(4)
        _loops.fill_box(self.coefficients, box)
        return box

    def self_crossing(self) -> tuple[float, float] | None:
        """Parameters t_a < t_b of the place where the curve crosses itself, or None.

        Closed form: with sigma = tau_a + tau_b and w = sigma^2 - tau_a tau_b the two equations
        x(t_a) = x(t_b) and y(t_a) = y(t_b) are linear.
        """
        first, second = _cubic.own_crossing(self.coefficients)
        if first != first:
            return None
        width = self.t1 - self.t0
        return float(self.t0 + width * first), float(self.t0 + width * second)


def fit_cubic(
    t: ArrayLike,
    points: ArrayLike,
    start: ArrayLike,
    end: ArrayLike | None = None,
    start_derivative: ArrayLike | None = None,
) -> Cubic:
    """Fit a cubic to points by least squares under constraints, P3 section 2.

    The curve passes through `start` at t[0]; through `end` at t[-1] and with `start_derivative`
    at t[0] if these are given: the paper's four variants. Solved by QR in tau = (t - t[0]) /
    (t[-1] - t[0]). If there are fewer distinct parameters than unknowns, the highest shapes that
    the data cannot tell apart are left out, so that two points give a straight line.

    Parameters
    ----------
    t : array_like, shape (n,)
        Parameters of the points, not decreasing and not all equal.
    points : array_like, shape (n, 2)
        Points of the plane (m).
    start, end : array_like, shape (2,)
        Constraints (m).
    start_derivative : array_like, shape (2,)
        Constraint on the derivative by t.

    Returns
    -------
    Cubic

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite, or `t` decreases or stands still.

    Examples
    --------
    >>> t = np.array([0.0, 1.0, 2.0, 3.0])
    >>> curve = fit_cubic(t, np.stack([t, t**2], 1), start=[0, 0], end=[3, 9])
    >>> curve.powers_of_t().round(9).T.tolist()
    [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
    """
    t = as_array("t", t, ("n",))
    points = as_array("points", points, (len(t), 2))
    if (np.diff(t) < 0).any():
        raise ValueError(f"t: expected parameters that do not decrease, got {t}")
    if len(t) < 2 or t[-1] <= t[0]:
        raise ValueError("t: expected at least two different parameters, got fewer")
    # The fit reads its constraints from the ends of the list.
    held = np.vstack([as_array("start", start, (2,)), points])
    tau = np.concatenate([[0.0], (t - t[0]) / (t[-1] - t[0])])
    if end is not None:
        held, tau = np.vstack([held, as_array("end", end, (2,))]), np.append(tau, 1.0)
    slope = np.zeros(2)
    if start_derivative is not None:
        slope = as_array("start_derivative", start_derivative, (2,)) * (t[-1] - t[0])
    c = fit(tau, held, end is not None, start_derivative is not None, *slope.tolist())
    return Cubic(c, float(t[0]), float(t[-1]))


@compiled("cubic.fit")
def fit(
    tau: Array, points: Array, has_end: bool, has_slope: bool, slope_x: float, slope_y: float
) -> Array:
    """Constrained least-squares cubic (4, 2) through points[0], P3 section 2.

    tau (n,) runs from 0 to 1, the slope is by tau. What the constraints leave free:
    1: tau, tau^2, tau^3; 2 (slope): tau^2, tau^3; 3 (end): tau - tau^2, tau^2 - tau^3;
    4 (both): tau^2 - tau^3. The highest of them that the data cannot tell apart are left out.
    """
    c = np.zeros((4, 2))
    c[0] = points[0]
    if has_slope:
        c[1] = slope_x, slope_y
    if has_end:
        c[1 + has_slope] = points[-1] - c.sum(0)
    free = np.eye(4)[1 + has_slope :]  # powers that the constraints leave, (m, 4)
    if has_end:
        free = free[:-1] - free[1:]
    powers = tau[:, None] ** np.arange(4)
    A, b = powers @ free.T, points - powers @ c
    told_apart = np.abs(np.diag(np.linalg.qr(A, mode="r"))) > 1e-9 * np.hypot.reduce(A)[: len(A)]
    m = len(told_apart) if told_apart.all() else int(np.argmin(told_apart))
    x = np.linalg.lstsq(A[:, :m], b, rcond=None)[0]
    return np.asarray(c + free[:m].T @ x)


def deviation(c: Array, tau: Array, points: Array, between: bool) -> float:
    """Largest distance of a point from the curve at its parameter (m), P3 step 1.4.

    With `between` also of the curve, halfway between two points, from the line that joins them.
    """
    if between:
        tau = np.concatenate([tau, 0.5 * (tau[:-1] + tau[1:])])
        points = np.concatenate([points, 0.5 * (points[:-1] + points[1:])])
    gap = points - tau[:, None] ** np.arange(4) @ c
    return float(np.hypot(gap[:, 0], gap[:, 1]).max())


def refit_by_arc_length(curve: Cubic, t: ArrayLike, points: ArrayLike) -> Cubic:
    """Fit the points anew over their arc length on a first curve, P3 section 4.

    The result runs through the ends of `curve`, with t0 = 0 and t1 its length, and its speed is
    *about* 1: no polynomial curve but a straight line can have it exactly, and the points may lie
    farther from it than from the first. `PathMemory` uses a table s(t) instead.

    Parameters
    ----------
    curve : Cubic
    t : array_like, shape (n,)
        Parameters of the points on `curve`.
    points : array_like, shape (n, 2)

    Returns
    -------
    Cubic
        Over arc length (m).

    Raises
    ------
    ValueError
        If a shape is wrong or a number is not finite.

    Examples
    --------
    >>> arc, t = Cubic([[0, 0], [0.3, 0], [0.9, 0], [-0.5, 0.6]]), np.linspace(0, 1, 50)
    >>> speed = np.hypot(*refit_by_arc_length(arc, t, arc(t)).derivative(t * arc.length).T)
    >>> bool(abs(speed - 1).max() < 0.1), bool(abs(speed - 1).max() > 0.01)
    (True, True)
    """
    t = as_array("t", t, ("n",))
    points = as_array("points", points, (len(t), 2))
    as_instance("curve", curve, Cubic)
    s = np.array([curve.arc_length(value) for value in t])
    s, points = np.append(s, curve.length), np.vstack([points, curve(curve.t1)])
    s, points = np.insert(s, 0, 0.0), np.vstack([curve(curve.t0), points])
    return fit_cubic(s, points, start=points[0], end=points[-1])


class PathMemory:
    """The path of a robot, stored a point at a time as cubics with loops cut out.

    Each point is fitted together with those since the last knot. As soon as one of them lies
    farther than the tolerance from the curve, the curve without the newest point becomes a
    segment, the loops that it closes are cut out, and the newest point opens the next segment.

    Parameters
    ----------
    tolerance : float
        E of P3 (m): no point lies farther from the path as stored before loops are cut out.
    variant : str, default "two-points"
        Constraints of a segment: "point", "point-derivative", "two-points" or
        "two-points-derivative". The first segment has no derivative to go on from.
    loop_accuracy : float or None, default 1e-4
        Two places of the path that come as near as this (m) count as one place, and what lies
        between them as a loop. None keeps all loops.
    check_between : bool, default True
        Also hold the curve within the tolerance of the line between two points, halfway. P3 does
        not, and its smooth variant bulges there.
    min_step : float, optional
        Nearer points than this (m) to the last one kept are not stored; a hundredth of the
        tolerance without it. What they may hide is taken off the tolerance.
    max_step : float, default 1.0
        A jump of more than this (m) is refused.
    max_points : int, default 256
        A segment closes after so many points at the latest, which bounds the time of `add`.

    Attributes
    ----------
    n_points : int
        Points stored so far, skipped ones not counted.

    Raises
    ------
    ValueError
        If a parameter lies outside its range, such as a tolerance of zero.

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
        # The open segment: points, their polygon lengths t, how many; and its curve.
        self._points, self._t = np.empty((max_points, 2)), np.empty(max_points)
        self._n = 0
        self._curve: Array | None = None
        self._slope: Array | None = None

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
            As the constructor, and as `add` of a point.

        Examples
        --------
        >>> PathMemory.from_points([[0, 0], [0.5, 0], [1, 0]], 0.05)
        PathMemory(1.00 m in 1 segments, 0 loops cut out, tolerance 0.05 m)
        """
        memory = cls(tolerance, variant, **options)
        for point in _metres("points", points, ("n", 2)):
            memory.add(point)
        memory.close()
        return memory

    def add(self, point: ArrayLike) -> None:
        """Store the next point (m, m) of the path, P3 steps 1.2 to 1.7.

        Raises
        ------
        ValueError
            If it is no finite point (2,) or a jump of more than `max_step`. What was stored stays.
        """
        point = _metres("point", point, (2,))
        if self._n == 0:
            # 1.1: the place where everything begins.
            self._points[0], self._t[0], self._n = point, 0.0, 1
            self.n_points = 1
            return
        step = self._step_to(point)
        if step > self.max_step:
            wanted = f"a step of at most {self.max_step:g} m"
            raise ValueError(f"point: expected {wanted}, got a jump of {step:.3g} m")
        if step <= self.min_step:
            return
        self.n_points += 1
        curve, deviation = self._fit_with(point, step)
        # 1.4, 1.5: too far, so the curve without the newest point becomes a segment ...
        if deviation > self.tolerance - self.min_step and self._n > 2:
            self._n -= 1
            self.close()
            # ... and the newest point, which is retained, opens the next one.
            step = self._step_to(point)
            if step > 0.0:
                self._curve, _ = self._fit_with(point, step)
        else:
            self._curve = curve
            if self._n == self.max_points:
                self.close()

    def close(self) -> None:
        """Make a segment of the points since the last knot, and cut out the loops it closes."""
        curve = self._curve
        if curve is None:
            return
        # 1.5, 1.7: the open curve becomes a segment, loops go, its end is the next knot.
        if self.loop_accuracy is None:
            self._spline.append(curve)
        else:
            self._loops += self._spline.append_without_loops(curve, self.loop_accuracy)
        if self.variant.endswith("derivative"):
            self._slope = (curve[1] + 2 * curve[2] + 3 * curve[3]) / self._t[self._n - 1]
        self._points[0], self._t[0], self._n = curve.sum(0), 0.0, 1
        self._curve = None

    def _step_to(self, point: Array) -> float:
        last = self._points[self._n - 1]
        return float(np.hypot(point[0] - last[0], point[1] - last[1]))

    def _fit_with(self, point: Array, step: float) -> tuple[Array, float]:
        """1.3: t_i = t_(i-1) + |d_i - d_(i-1)|, and the curve; 1.4: how far a point is from it."""
        n = self._n
        self._points[n], self._t[n], self._n = point, self._t[n - 1] + step, n + 1
        points, width = self._points[: n + 1], self._t[n]
        tau = self._t[: n + 1] / width
        slope = [0.0, 0.0] if self._slope is None else (self._slope * width).tolist()
        has_end = self.variant.startswith("two-points")
        curve = fit(tau, points, has_end, self._slope is not None, *slope)
        return curve, deviation(curve, tau, points, self.check_between)

    def _path(self) -> Spline:
        """Return the path as it stands: what is stored and, at its end, the open curve."""
        if self._curve is None:
            return self._spline
        whole = self._spline.copy()
        whole.append(self._curve)
        return whole

    # Asking.

    @property
    def loops(self) -> tuple[Loop, ...]:
        """Loops cut out so far."""
        return tuple(self._loops)

    def meeting(self) -> float | None:
        """Look where the open segment meets the stored path, and change nothing.

        `add` looks when a segment closes, which is enough to cut the loops out; P3 looks at every
        point. For a robot that wants to know at once that it has come back to its own way.

        Returns
        -------
        float or None
            Arc length (m) of the last place met; None if there is none.

        Raises
        ------
        ValueError
            If `loop_accuracy` is None: loops are not looked for.
        """
        if self.loop_accuracy is None:
            raise ValueError("loop_accuracy: expected a length to look for loops, got None")
        if self._curve is None:
            return None
        found = self._spline.meeting(self._curve, self.loop_accuracy)
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
        numbers = self.n_segments * (8 + _loops.PIECES + 1 + 1 + 2 * 4) + self._n * 3
        return 8 * numbers

    def point_at(self, s: ArrayLike) -> Array:
        """Points (..., 2) of the path at arc lengths (...) from the start (m).

        Raises
        ------
        ValueError
            If nothing is stored, or an arc length lies outside [0, length].
        """
        return self._ask(s, derivative=False)

    def tangent_at(self, s: ArrayLike) -> Array:
        """Return unit tangents (..., 2), in the direction of growing s; arguments as above."""
        return self._ask(s, derivative=True)

    def _ask(self, s: ArrayLike, derivative: bool) -> Array:
        path = self._path()
        s = self._arc_lengths("s", s, path.length)
        if path.n == 0:
            single = [1.0, 0.0] if derivative else self._points[0]
            return np.broadcast_to(single, (*s.shape, 2)).copy()
        return path.points(s.reshape(-1), derivative).reshape(*s.shape, 2)

    def _arc_lengths(self, name: str, s: ArrayLike, length: float) -> Array:
        s = as_array(name, s)
        if self._n == 0:
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
            Where to look from (m).
        low, high : array_like, shape (...)
            Ends of the window (m), low <= high; the whole path without them. Where a path comes
            near itself the window says which of its branches is meant.

        Returns
        -------
        s : ndarray, shape (...)
            Arc length of the nearest place (m).
        distance : ndarray, shape (...)
            How far it is (m).

        Raises
        ------
        ValueError
            If nothing is stored, a shape is wrong, or a window lies outside the path or is empty.
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
            s, distance = np.zeros(len(flat)), np.hypot(*(flat - self._points[0]).T)
        else:
            s, distance = path.nearest(np.ascontiguousarray(flat), low, high)
        return s.reshape(shape)[()], distance.reshape(shape)[()]

    # Keeping.

    def save(self, file: str | PathLike[str]) -> None:
        """Write everything, the open segment included, to an npz file (no pickle)."""
        n, accuracy = self._spline.n, self.loop_accuracy
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
            points=self._points[: self._n],
            t=self._t[: self._n],
            slope=np.zeros((0, 2)) if self._slope is None else self._slope[None],
            curve=np.zeros((0, 4, 2)) if self._curve is None else self._curve[None],
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
        for c in _metres("coefficients", kept["coefficients"], ("n", 4, 2)):
            memory._spline.append(c)
        memory._spline.box_tests = box_tests
        loops = _metres("loops", kept["loops"], ("n", 4)).tolist()
        memory._loops = [Loop(s, length, (x, y)) for s, length, x, y in loops]
        memory._n, memory.n_points = len(kept["t"]), n_points
        memory._points[: memory._n] = _metres("points", kept["points"], (memory._n, 2))
        t = as_array("t", kept["t"], ("n",))
        if (t[:1] != 0.0).any() or (np.diff(t) <= 0.0).any():
            raise ValueError("t: expected arc lengths that grow from 0, got others")
        memory._t[: memory._n] = t
        slopes = _metres("slope", kept["slope"], ("n", 2))
        curves = _metres("curve", kept["curve"], ("n", 4, 2))
        if len(slopes) > 1 or len(curves) > (memory._n > 1):
            got = f"{len(slopes)} and {len(curves)} for {memory._n} points"
            raise ValueError(f"slope, curve: expected at most one each, got {got}")
        memory._slope = next(iter(slopes), None)
        memory._curve = next(iter(curves), None)
        return memory
