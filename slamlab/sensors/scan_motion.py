"""How far did I turn, how far did I go? Motion recovered from two scans.

`turn_between` (circular cross-correlation) and `motion_between` (scan-to-scan alignment) mend
P5's `Whatangle` and `whatmove`, which stand in `slamlab.printed.p5`. Chapter 18.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from slamlab._checks import Array, as_array, as_count, as_shaped
from slamlab.geometry import wrap_angle
from slamlab.logs import ScanGeometry
from slamlab.models import as_scan_sensor

__all__ = ["motion_between", "turn_between"]


def turn_between(before: ArrayLike, after: ArrayLike) -> Array:
    """Angle of a turn on the spot: circular cross-correlation, then refined below one beam.

    The peak of the correlation gives whole beams. Around it the second scan is compared with the
    first one, interpolated between its beams; differences beyond a twentieth of the usual range
    count no more than that, because at the edge of an obstacle interpolation has no meaning.

    Parameters
    ----------
    before, after : array_like, shape (..., n_beams)
        Ranges of full-circle scans (m), taken at one place; leading axes broadcast. NaN or inf is
        a missing return: it counts as the mean of its scan and says nothing.

    Returns
    -------
    ndarray, shape (...)
        Radians in (-pi, pi], counterclockwise positive.

    Raises
    ------
    ValueError
        If the scans have no beams or not equally many, or a scan has no return at all.

    Examples
    --------
    >>> from slamlab.sensors import Lidar
    >>> from slamlab.worlds import rooms
    >>> scans = Lidar(72).scan(rooms.thesis_room(), [[1.0, 2.0, 0.0], [1.0, 2.0, np.pi / 6]])
    >>> round(float(np.degrees(turn_between(*scans))), 3)
    30.0
    """
    before, after = _pair(before, after)
    # The correlation is largest where the shift undoes the turn.
    shift = np.argmax(_correlation(before, after), axis=-1).astype(float)
    for width in (1.0, 0.1):
        trials = shift + np.linspace(-width, width, 21).reshape(-1, *[1] * shift.ndim)
        costs = _shifted_difference(before, after, trials)
        best = np.argmin(costs, axis=0)
        shift = np.take_along_axis(trials, best[None], axis=0)[0]
    return wrap_angle(shift * 2 * np.pi / before.shape[-1])


def motion_between(
    before: ArrayLike,
    after: ArrayLike,
    lidar: ScanGeometry,
    guess: ArrayLike | None = None,
    n_iterations: int = 40,
) -> Array:
    """Motion of the body between two scans: points of the second laid upon walls of the first.

    Every point is matched to its nearest neighbour, and its distance is measured across the wall
    that this neighbour and the ones beside it draw. The worst fifth of the matches is left out.

    Parameters
    ----------
    before, after : array_like, shape (n_beams,)
        Ranges (m); NaN, or ``lidar.max_range`` and more, is a missing return.
    lidar : ScanGeometry or Lidar
        Knows how ranges become points.
    guess : array_like, shape (3,), optional
        Where to begin: forward (m), left (m), turn (rad). Without it, the highest peaks
        of the circular cross-correlation are tried, each with a coarse grid of shifts up to 1 m.
    n_iterations : int, default 40
        At most this many rounds of matching.

    Returns
    -------
    ndarray, shape (3,)
        The second pose in the frame of the first (m, m, rad).

    Raises
    ------
    ValueError
        If the scans do not fit the lidar, or fewer than three points can be matched.

    Examples
    --------
    >>> from slamlab.sensors import Lidar
    >>> from slamlab.worlds import rooms
    >>> lidar = Lidar(120)
    >>> scans = lidar.scan(rooms.thesis_room(), [[1.0, 2.0, 0.0], [1.1, 2.0, 0.0]])
    >>> motion_between(*scans, lidar)[0].round(2).tolist()
    0.1
    """
    as_scan_sensor("lidar", lidar)
    walls, normals = _walls(lidar.points(as_shaped("before", before, (lidar.n_beams,))))
    points = lidar.points(as_shaped("after", after, (lidar.n_beams,)))
    points = points[np.isfinite(points[:, 0])]
    if min(len(walls), len(points)) < 3:
        got = f"{len(walls)} and {len(points)}"
        raise ValueError(f"before, after: expected at least 3 returns each, got {got}")
    tree, rounds = KDTree(walls), as_count("n_iterations", n_iterations, 1)
    if guess is None:
        starts = _coarse_motions(tree, points, _likely_turns(*_pair(before, after)))
    else:
        starts = as_array("guess", guess, (3,))[None]
    ends = [_aligned(tree, walls, normals, points, start, rounds) for start in starts]
    best = ends[int(np.argmin([_misfit(tree, _moved(end, points)) for end in ends]))]
    return np.array([*best[:2], wrap_angle(best[2])])


def _pair(before: ArrayLike, after: ArrayLike) -> tuple[Array, Array]:
    before = as_shaped("before", before, ("...", "n_beams"))
    if before.shape[-1] == 0:
        raise ValueError("before: expected at least one beam, got none")
    after = as_shaped("after", after, ("...", before.shape[-1]))
    first, second = np.broadcast_arrays(before, after)
    return first, second


def _correlation(before: Array, after: Array) -> Array:
    """Circular cross-correlation c[k] = sum_i before[i + k] after[i], by FFT."""
    spectrum = np.fft.rfft(_centred("before", before))
    spectrum = spectrum * np.conj(np.fft.rfft(_centred("after", after)))
    return np.fft.irfft(spectrum, before.shape[-1])


def _centred(name: str, scan: Array) -> Array:
    """Subtract the mean of each scan; a missing return becomes zero."""
    there = np.isfinite(scan)
    if not there.any(axis=-1).all():
        raise ValueError(f"{name}: expected at least one return in every scan, got none")
    known = np.where(there, scan, 0.0)
    mean = known.sum(axis=-1, keepdims=True) / there.sum(axis=-1, keepdims=True)
    return np.where(there, known - mean, 0.0)


def _shifted_difference(before: Array, after: Array, shift: Array) -> Array:
    """Mean difference (m, ...) of `after` and `before` read `shift` (m, ...) beams further on."""
    n_beams = before.shape[-1]
    limit = 0.05 * np.nanmedian(np.where(np.isfinite(before), before, np.nan), axis=-1)
    place = np.arange(n_beams) + shift[..., None]
    lower = np.floor(place).astype(np.intp)
    scans = np.broadcast_to(before, (len(shift), *before.shape))
    first = np.take_along_axis(scans, lower % n_beams, axis=-1)
    second = np.take_along_axis(scans, (lower + 1) % n_beams, axis=-1)
    with np.errstate(invalid="ignore"):
        difference = np.abs(first + (place - lower) * (second - first) - after)
    cap = np.broadcast_to(limit[..., None], difference.shape)
    return np.where(difference < cap, difference, cap).mean(axis=-1)


def _walls(points: Array) -> tuple[Array, Array]:
    """Points (m, 2) that lie on a wall with their neighbours, and the wall's normals (m, 2)."""
    left, right = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    along = right - left
    length = np.hypot(along[:, 0], along[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = np.stack([-along[:, 1], along[:, 0]], -1) / length[:, None]
        # At a corner or an edge the three points do not lie on one line.
        bend = np.abs(((points - left) * normals).sum(-1))
    straight = bend < 0.05 * length
    return points[straight], normals[straight]


def _moved(motion: Array, points: Array) -> Array:
    c, s = np.cos(motion[2]), np.sin(motion[2])
    return points @ np.array([[c, s], [-s, c]]) + motion[:2]


def _likely_turns(before: Array, after: Array, count: int = 6) -> Array:
    """Return the turns (count,) of the highest local maxima of the correlation (rad)."""
    c = _correlation(before, after)
    tops = np.flatnonzero((c >= np.roll(c, 1)) & (c >= np.roll(c, -1)))
    return tops[np.argsort(-c[tops])[:count]] * 2 * np.pi / len(c)


def _misfit(tree: KDTree, clouds: Array) -> Array:
    """Mean distance (...) of the points (..., k, 2) to the nearest of the tree, capped."""
    distance, _ = tree.query(clouds)
    return np.minimum(distance, 0.3).mean(axis=-1)


def _coarse_motions(tree: KDTree, points: Array, turns: Array) -> Array:
    """For each turn the best of the shifts on a grid of 20 cm, up to 1 m each way."""
    shifts = 0.2 * np.stack(np.meshgrid(*2 * [np.arange(-5, 6)]), -1).reshape(-1, 2)
    turned = np.stack([_moved(np.array([0.0, 0.0, turn]), points) for turn in turns])
    best = np.argmin(_misfit(tree, turned[:, None] + shifts[:, None]), axis=1)
    return np.column_stack([shifts[best], turns])


def _aligned(
    tree: KDTree, walls: Array, normals: Array, points: Array, motion: Array, rounds: int
) -> Array:
    """Refine the motion (3,) until it rests, by rounds of point-to-line least squares."""
    for _ in range(rounds):
        moved = _moved(motion, points)
        distance, nearest = tree.query(moved)
        good = distance <= np.quantile(distance, 0.8)
        moved, n = moved[good], normals[nearest[good]]
        residual = ((moved - walls[nearest[good]]) * n).sum(-1)
        arm = moved - motion[:2]
        # d(n . (R p + t)) = n . dt + n . (R p rotated by a quarter turn) dtheta
        J = np.column_stack([n, n[:, 1] * arm[:, 0] - n[:, 0] * arm[:, 1]])
        step, *_ = np.linalg.lstsq(J, -residual, rcond=1e-9)
        motion = motion + step
        if np.abs(step).max() < 1e-9:
            break
    return motion
