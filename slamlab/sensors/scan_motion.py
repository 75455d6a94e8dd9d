"""How far did I turn? The turn on the spot between two scans, by circular cross-correlation.

It mends P5's `Whatangle`, which stands in `slamlab.printed.p5` (chapter 18). A whole motion is
found by `slamlab.matching.match_icp`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_shaped
from slamlab.geometry import wrap_angle

__all__ = ["turn_between"]


def turn_between(before: ArrayLike, after: ArrayLike) -> Array:
    """Angle of a turn on the spot: circular cross-correlation, then refined below one beam.

    The peak of the correlation gives whole beams. Around it the second scan is compared with the
    first one, interpolated between its beams; differences beyond a twentieth of the usual range
    count no more than that, because at the edge of an obstacle interpolation has no meaning.

    Parameters
    ----------
    before, after : array_like, shape (..., n_beams)
        Ranges of full-circle scans (m) of at least one beam, taken at one place; leading axes
        broadcast. NaN or inf is a missing return: it counts as the mean of its scan and says
        nothing.

    Returns
    -------
    ndarray, shape (...)
        Radians in (-pi, pi], counterclockwise positive.

    Raises
    ------
    ValueError
        If a scan has no return at all.

    Examples
    --------
    >>> from slamlab.sensors import Lidar
    >>> from slamlab.worlds import rooms
    >>> scans = Lidar(72).scan(rooms.thesis_room(), [[1.0, 2.0, 0.0], [1.0, 2.0, np.pi / 6]])
    >>> round(float(np.degrees(turn_between(*scans))), 3)
    30.0
    """
    before = as_shaped("before", before, ("...", "n_beams"))
    if before.shape[-1] == 0:
        raise ValueError("before: expected at least one beam, got none")
    before, after = np.broadcast_arrays(
        before, as_shaped("after", after, ("...", before.shape[-1]))
    )
    # The correlation is largest where the shift undoes the turn.
    shift = np.argmax(_correlation(before, after), axis=-1).astype(float)
    for width in (1.0, 0.1):
        trials = shift + np.linspace(-width, width, 21).reshape(-1, *[1] * shift.ndim)
        costs = _shifted_difference(before, after, trials)
        best = np.argmin(costs, axis=0)
        shift = np.take_along_axis(trials, best[None], axis=0)[0]
    return wrap_angle(shift * 2 * np.pi / before.shape[-1])


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
