"""Walls from the points of one scan: total least squares, split-and-merge, incremental.

P1 fits lines "by least squares" and tests distances, without a formula; here it is done so that a
turn of the robot changes nothing and the error of (r, alpha) is known. Chapter 07; chapter 09
feeds the wall sensor with it. Breaks after Borges and Aldon (2004), split-and-merge after Pavlidis
and Horowitz (1974), compared with others by Nguyen et al. (2007).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_choice, as_count, as_positive, as_scalar, as_shaped
from slamlab.geometry import wrap_angle
from slamlab.sensors.wall import Wall

__all__ = ["Walls", "extract_walls", "fit_line", "line_cov", "point_covs"]

Indices = NDArray[np.intp]

# A wall seen under less than this angle between beam and wall is told from a jump no more.
_GRAZING = np.deg2rad(5.0)
# Two pieces are one wall if their (r, alpha) differ by less than this: chi-square, 2 dof, 99.9 %.
_SAME_LINE = 13.816
# What tells lines apart; its noise does not matter.
_SENSOR = Wall(1.0, 1.0)
# A corner moves by at most so many points when they are shared out anew.
_MOST_MOVES = 5


@dataclass(frozen=True, eq=False)
class Walls:
    """Walls found in one scan, in the frame of its points.

    Attributes
    ----------
    lines : ndarray, shape (n, 2)
        r (m, not negative) and alpha (rad, in (-pi, pi]) of each wall: the line
        x cos(alpha) + y sin(alpha) = r.
    covs : ndarray, shape (n, 2, 2)
        Covariance of each (r, alpha).
    ends : ndarray, shape (n, 2, 2)
        Both ends of each wall (m): the outermost of its points, dropped onto the line.
    labels : ndarray of int, shape (k,)
        For each point of the scan the row of its wall, -1 for none.
    """

    lines: Array
    covs: Array
    ends: Array
    labels: Indices

    def __len__(self) -> int:
        """Return the number of walls."""
        return len(self.lines)

    @property
    def lengths(self) -> Array:
        """Distance between the ends of each wall (m), shape (n,)."""
        return np.hypot(*(self.ends[:, 1] - self.ends[:, 0]).T)


def extract_walls(
    points: ArrayLike,
    sigma_range: float,
    sigma_bearing: float = 0.0,
    *,
    method: str = "split-and-merge",
    threshold: float = 0.08,
    max_gap: float = 0.5,
    min_points: int = 8,
    min_length: float = 0.5,
    origin: ArrayLike = (0.0, 0.0),
) -> Walls:
    """Find the straight walls in one scan.

    Parameters
    ----------
    points : array_like, shape (k, 2)
        End points of the beams in scan order (m), in any frame; a row with NaN is a beam without
        return. For measurements of a `Wall` sensor give them in the frame of the sensor.
    sigma_range : float
        Standard deviation of a range (m), positive.
    sigma_bearing : float, default 0.0
        Standard deviation of the direction of a beam (rad).
    method : {"split-and-merge", "incremental"}
        Cut the scan where it leaves a line the most, or grow a line point by point.
    threshold : float, default 0.08
        Largest distance of a point from its wall (m). Four times the noise of a point or more.
    max_gap : float, default 0.5
        Pieces of one line are joined across at most this much without points (m); inf joins
        them across everything, as suits landmarks that are lines without end.
    min_points : int, default 8
        Fewer points make no wall, and no piece of one; at least 4.
    min_length : float, default 0.5
        A shorter wall is dropped (m).
    origin : array_like, shape (2,), default (0, 0)
        Where the sensor stands in the frame of the points (m).

    Returns
    -------
    Walls
        In the order of their first points.

    Raises
    ------
    ValueError
        If a shape is wrong, a parameter lies outside its range or `method` is unknown.

    Examples
    --------
    A corner of two walls, x = 2 and y = 1, seen from the origin:

    >>> y, x = np.linspace(-1, 1, 41), np.linspace(2, 0, 41)
    >>> corner = np.concatenate([np.stack([np.full(41, 2.0), y], -1),
    ...                          np.stack([x, np.full(41, 1.0)], -1)])
    >>> extract_walls(corner, sigma_range=0.01).lines.round(6).tolist()
    [[2.0, 0.0], [1.0, 1.570796]]
    """
    points = as_shaped("points", points, ("k", 2)).astype(float)
    sigma_range = as_positive("sigma_range", sigma_range, 1e300)
    method = as_choice("method", method, ("split-and-merge", "incremental"))
    threshold = as_positive("threshold", threshold, 1e300)
    max_gap = as_scalar("max_gap", max_gap, 0)
    min_points = as_count("min_points", min_points, 4)
    min_length = as_scalar("min_length", min_length, 0, 1e300)
    origin = as_array("origin", origin, (2,))

    valid = np.flatnonzero(np.isfinite(points).all(-1))
    seen = points[valid]
    covs = point_covs(seen, sigma_range, sigma_bearing, origin=origin)
    if len(valid) < min_points:
        return _walls(seen, covs, [], valid, len(points))
    grow = _split if method == "split-and-merge" else _extend
    pieces: list[Indices] = []
    for start, stop in _runs(seen - origin, valid, threshold, max_gap):
        if stop - start < min_points:
            continue
        cuts = grow(seen[start:stop], threshold)
        cuts = _settle_corners(seen[start:stop], _merge(seen[start:stop], cuts, threshold))
        pieces += [np.arange(start + a, start + b) for a, b in zip(cuts, cuts[1:], strict=False)]
    pieces = [p for p in pieces if len(p) >= min_points]
    pieces = _join(seen, covs, pieces, threshold, max_gap)
    cleaned = [_without_strangers(seen[p], covs[p], p, threshold) for p in pieces]
    pieces = [p for p, length in cleaned if len(p) >= min_points and length >= min_length]
    return _walls(seen, covs, sorted(pieces, key=lambda p: int(p[0])), valid, len(points))


def fit_line(points: ArrayLike) -> Array:
    """Fit a line by total least squares: least squared distance from the points.

    The normal is the direction in which the centred points vary least. In contrast to y = a x + b
    nothing here knows which axis is x: turn the points and the line turns with them.

    Parameters
    ----------
    points : array_like, shape (..., k, 2)
        At least two points (m).

    Returns
    -------
    ndarray, shape (..., 2)
        r (m, not negative) and alpha (rad, in (-pi, pi]).

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite, there are fewer than two points, or they
        scatter alike in all directions, so that no line is better than another.

    Examples
    --------
    >>> fit_line([[0, 1], [1, 1], [2, 1]]).round(6).tolist()
    [1.0, 1.570796]
    """
    points = as_array("points", points, ("...", "k", 2))
    if points.shape[-2] < 2:
        raise ValueError(f"points: expected at least two, got {points.shape[-2]}")
    centre = points.mean(-2)
    d = points - centre[..., None, :]
    skew, spread = (d[..., 0] * d[..., 1]).sum(-1), (d[..., 1] ** 2 - d[..., 0] ** 2).sum(-1)
    if not (np.hypot(skew, spread) > 1e-12 * (d**2).sum((-2, -1))).all():
        raise ValueError("points: expected them to favour a direction, they scatter alike in all")
    # The eigenvector of the scatter matrix to its smaller eigenvalue, in closed form.
    alpha = 0.5 * np.arctan2(0.0 - 2 * skew, spread)
    r = centre[..., 0] * np.cos(alpha) + centre[..., 1] * np.sin(alpha)
    # Of the two names of the line, the one with r >= 0; alpha was in [-pi/2, pi/2].
    alpha = np.where(r < 0, np.where(alpha > 0, alpha - np.pi, alpha + np.pi), alpha)
    return np.stack([np.abs(r), alpha], -1)


def line_cov(points: ArrayLike, covs: ArrayLike) -> Array:
    """Covariance of `fit_line` from the covariances of the points, to first order.

    With t_i the place of a point along the line, e_i its error across it and S = sum (t_i - t)^2:
    d alpha = -sum (t_i - t) e_i / S and d r = mean(e_i) + t d alpha, t the mean of the t_i.

    Parameters
    ----------
    points : array_like, shape (..., k, 2)
    covs : array_like, shape (..., k, 2, 2)
        Covariance of each point (m^2); points are independent.

    Returns
    -------
    ndarray, shape (..., 2, 2)
        Covariance of (r, alpha).

    Raises
    ------
    ValueError
        As `fit_line`, or if the covariances do not fit the points.

    Examples
    --------
    >>> points = [[2.0, -1.0], [2.0, 0.0], [2.0, 1.0]]
    >>> line_cov(points, 0.01**2 * np.broadcast_to(np.eye(2), (3, 2, 2))).round(7).tolist()
    [[3.33e-05, 0.0], [0.0, 5e-05]]
    """
    points = as_array("points", points, ("...", "k", 2))
    covs = as_array("covs", covs, ("...", points.shape[-2], 2, 2))
    return _line_cov(points, covs, fit_line(points)[..., 1])


def point_covs(
    points: ArrayLike,
    sigma_range: float,
    sigma_bearing: float = 0.0,
    *,
    origin: ArrayLike = (0.0, 0.0),
) -> Array:
    """Covariances of the end points of beams, from the noise of range and direction.

    Parameters
    ----------
    points : array_like, shape (..., 2)
        End points (m).
    sigma_range : float
        Standard deviation along the beam (m).
    sigma_bearing : float, default 0.0
        Standard deviation of the direction (rad): across the beam it grows with the range.
    origin : array_like, shape (2,), default (0, 0)
        Where the sensor stands (m).

    Returns
    -------
    ndarray, shape (..., 2, 2)

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite or a standard deviation is negative.

    Examples
    --------
    >>> point_covs([[2.0, 0.0]], sigma_range=0.01, sigma_bearing=0.02).round(6).tolist()
    [[[0.0001, 0.0], [0.0, 0.0016]]]
    """
    beam = as_array("points", points, ("...", 2)) - as_array("origin", origin, (2,))
    sigma_range = as_scalar("sigma_range", sigma_range, 0, 1e300)
    sigma_bearing = as_scalar("sigma_bearing", sigma_bearing, 0, 1e300)
    squared = (beam**2).sum(-1)[..., None, None]
    ray = np.einsum("...i,...j->...ij", beam, beam) / np.where(squared > 0, squared, 1.0)
    side = np.stack([-beam[..., 1], beam[..., 0]], -1)
    across = np.einsum("...i,...j->...ij", side, side)
    # C = sigma_range^2 u u^T + sigma_bearing^2 rho^2 v v^T, u along the beam, v across.
    return sigma_range**2 * ray + sigma_bearing**2 * across


def _runs(
    beams: Array, beam_numbers: Indices, threshold: float, max_gap: float
) -> Iterator[tuple[int, int]]:
    """Cut the scan where the range jumps or beams without return leave a gap."""
    if len(beams) == 0:
        return
    distance = np.hypot(*beams.T)
    turn = np.abs(np.diff(np.unwrap(np.arctan2(beams[:, 1], beams[:, 0]))))
    # On one wall the range changes by no more than this from beam to beam.
    reach = np.minimum(distance[1:], distance[:-1]) * turn / np.tan(_GRAZING) + threshold
    jump = np.abs(np.diff(distance)) > reach
    missing = np.diff(beam_numbers) > 1
    gap = missing & (np.hypot(*np.diff(beams, axis=0).T) > max_gap)
    cuts = [0, *(np.flatnonzero(jump | gap) + 1).tolist(), len(beams)]
    yield from zip(cuts, cuts[1:], strict=False)


def _split(points: Array, threshold: float) -> list[int]:
    """Split-and-merge, first half: cut until every piece is straight; its cuts, ends included."""
    cuts, todo = [0], [(0, len(points))]
    while todo:
        start, stop = todo.pop()
        piece = points[start:stop]
        if stop - start < 3 or _straight(piece, threshold):
            cuts.append(stop)
            continue
        # The corner is the point farthest from the chord; the fit only said that there is one.
        chord = piece[-1] - piece[0]
        dx, dy = (piece - piece[0]).T
        off = np.abs(chord[0] * dy - chord[1] * dx) if chord.any() else np.hypot(dx, dy)
        corner = start + 1 + int(np.argmax(off[1:-1]))
        todo += [(corner, stop), (start, corner)]
    return cuts


def _extend(points: Array, threshold: float) -> list[int]:
    """Incremental: a point farther than the threshold from the line so far starts a new one."""
    cuts, sums = [0], np.zeros(5)
    terms = np.column_stack([points, points**2, points[:, 0] * points[:, 1]])
    for i, (x, y) in enumerate(points.tolist()):
        n = i - cuts[-1]
        if n >= 3:
            # The line through all points so far, from five running sums.
            mx, my, mxx, myy, mxy = (sums / n).tolist()
            alpha = 0.5 * math.atan2(-2 * (mxy - mx * my), (myy - my * my) - (mxx - mx * mx))
            if abs((x - mx) * math.cos(alpha) + (y - my) * math.sin(alpha)) > threshold:
                cuts.append(i)
                sums = np.zeros(5)
        sums = sums + terms[i]
    return [*cuts, len(points)]


def _merge(points: Array, cuts: list[int], threshold: float) -> list[int]:
    """Split-and-merge, second half: drop a cut if both sides together are straight."""
    cuts, i = list(cuts), 1
    while i < len(cuts) - 1:
        if _straight(points[cuts[i - 1] : cuts[i + 1]], threshold):
            del cuts[i]
            i = max(i - 1, 1)  # the side before has grown, and is asked again
        else:
            i += 1
    return cuts


def _settle_corners(points: Array, cuts: list[int]) -> list[int]:
    """Give a point beside a corner to the wall that it lies nearer to."""
    cuts = list(cuts)
    for i in range(1, len(cuts) - 1):
        for _ in range(_MOST_MOVES):
            before, after = points[cuts[i - 1] : cuts[i]], points[cuts[i] : cuts[i + 1]]
            if min(len(before), len(after)) < 4:
                break
            pair = points[cuts[i] - 1 : cuts[i] + 1]
            nearer_before = _distance(pair, before[:-1]) < _distance(pair, after[1:])
            if nearer_before[0] and not nearer_before[1]:
                break
            cuts[i] += 1 if nearer_before[0] else -1
    return cuts


def _join(
    points: Array, covs: Array, pieces: list[Indices], threshold: float, max_gap: float
) -> list[Indices]:
    """Join pieces of one line that something cut apart, the most alike first."""
    fits = [_fit_and_cov(points[p], covs[p]) for p in pieces if len(pieces) > 1]
    while len(pieces) > 1:
        for i, j in _alike(fits):
            both = np.sort(np.concatenate([pieces[i], pieces[j]]))
            line = _fit(points[both])
            one, two = (_along(points[pieces[k]], line[1]) for k in (i, j))
            gap = max(one.min() - two.max(), two.min() - one.max())
            if gap <= max_gap and _across(points[both], line).max() <= threshold:
                others = [k for k in range(len(pieces)) if k not in (i, j)]
                pieces = [*(pieces[k] for k in others), both]
                fits = [*(fits[k] for k in others), _fit_and_cov(points[both], covs[both])]
                break
        else:
            break
    return pieces


def _fit_and_cov(points: Array, covs: Array) -> tuple[tuple[float, float], Array]:
    """Line (r, alpha) of a piece and its covariance."""
    line = _fit(points)
    return line, _line_cov(points, covs, line[1])


def _alike(fits: list[tuple[tuple[float, float], Array]]) -> Iterator[tuple[int, int]]:
    """Pairs of pieces whose lines agree within their covariances, the most alike first."""
    lines, line_covs = (np.array(every) for every in zip(*fits, strict=True))
    i, j = np.triu_indices(len(fits), 1)
    difference = _SENSOR.residual(lines[i], lines[j])
    total = in_name_of(lines[i, 1], lines[j, 1], line_covs[i]) + line_covs[j]
    squared = (difference * np.linalg.solve(total, difference[..., None])[..., 0]).sum(-1)
    for k in np.argsort(squared):
        if squared[k] > _SAME_LINE:
            return
        yield int(i[k]), int(j[k])


def _without_strangers(
    points: Array, covs: Array, piece: Indices, threshold: float
) -> tuple[Indices, float]:
    """Drop points that their noise does not explain, the worst first; all of them if many are.

    Returns what is left, and how far it reaches along its line.
    """
    kept = np.ones(len(piece), dtype=bool)
    while True:
        r, alpha = _fit(points[kept])
        normal = np.array([math.cos(alpha), math.sin(alpha)])
        # Noise across the wall: a range read wrong along a grazing beam hardly leaves it.
        noise = np.sqrt(np.einsum("i,kij,j->k", normal, covs, normal))
        off = np.abs(points @ normal - r) / np.maximum(4 * noise, 0.3 * threshold)
        worst = int(np.argmax(np.where(kept, off, 0.0)))
        if off[worst] <= 1:
            return piece[kept], float(np.ptp(_along(points[kept], alpha)))
        kept[worst] = False
        if kept.sum() < max(4, 0.75 * len(piece)):
            return piece[:0], 0.0


def _walls(
    points: Array, covs: Array, pieces: list[Indices], valid: Indices, n_points: int
) -> Walls:
    """Fit each piece anew and put the result together."""
    labels, n = np.full(n_points, -1), len(pieces)
    lines, line_covs, ends = np.empty((n, 2)), np.empty((n, 2, 2)), np.empty((n, 2))
    for row, piece in enumerate(pieces):
        labels[valid[piece]] = row
        lines[row] = fit_line(points[piece])
        line_covs[row] = _line_cov(points[piece], covs[piece], lines[row, 1])
        along = _along(points[piece], lines[row, 1])
        ends[row] = along.min(), along.max()
    return Walls(lines, line_covs, on_line(lines, ends), labels)


def in_name_of(alpha: ArrayLike, other: ArrayLike, covs: Array) -> Array:
    """Covariances (..., 2, 2) of lines, as they are called by the side of others.

    Where a line is called by its other name (-r, alpha + pi), cov(r, alpha) changes its sign.
    """
    turned = np.abs(wrap_angle(np.subtract(alpha, other))) > np.pi / 2
    return covs * np.where(turned[..., None, None], [[1.0, -1.0], [-1.0, 1.0]], 1.0)


def on_line(lines: Array, places: Array) -> Array:
    """Points (..., k, 2) of lines (..., 2), r and alpha each, at places (..., k) along them."""
    r, c, s = lines[..., :1], np.cos(lines[..., 1:]), np.sin(lines[..., 1:])
    return np.stack([r * c - places * s, r * s + places * c], -1)


def _fit(points: Array) -> tuple[float, float]:
    """`fit_line` of one short array (k, 2), without checks; r may be negative."""
    mx, my = (points.sum(0) / len(points)).tolist()
    x, y = points[:, 0] - mx, points[:, 1] - my
    alpha = 0.5 * math.atan2(-2 * float(x @ y), float(y @ y) - float(x @ x))
    return mx * math.cos(alpha) + my * math.sin(alpha), alpha


def _distance(points: Array, of_wall: Array) -> Array:
    """Distances of points from the line fitted to others."""
    return _across(points, _fit(of_wall))


def _across(points: Array, line: tuple[float, float]) -> Array:
    """Distances of points from a line (r, alpha)."""
    r, alpha = line
    return np.abs(points[:, 0] * math.cos(alpha) + points[:, 1] * math.sin(alpha) - r)


def _straight(points: Array, threshold: float) -> bool:
    """Tell whether all points lie within the threshold of their own line."""
    return bool(_distance(points, points).max() <= threshold)


def _along(points: Array, alpha: float | Array) -> Array:
    """Places of points along a line with normal direction alpha."""
    return points[..., 1] * np.cos(alpha) - points[..., 0] * np.sin(alpha)


def _line_cov(points: Array, covs: Array, alpha: float | Array) -> Array:
    """`line_cov` for a line already fitted."""
    alpha = np.asarray(alpha)[..., None]
    c, s = np.cos(alpha), np.sin(alpha)
    # Variance of each point across the wall: n^T C n.
    across = c * c * covs[..., 0, 0] + 2 * c * s * covs[..., 0, 1] + s * s * covs[..., 1, 1]
    along = points[..., 1] * c - points[..., 0] * s
    k = points.shape[-2]
    middle = along.sum(-1, keepdims=True) / k
    off = along - middle
    d = np.empty((*off.shape[:-1], 2, k))
    d[..., 1, :] = d_alpha = -off / (off * off).sum(-1, keepdims=True)
    d[..., 0, :] = 1.0 / k + middle * d_alpha
    return (d * across[..., None, :]) @ d.mT
