"""Do scans and wheels tell of the same drive? Scans of another field of view may fit each other.

A wrong field of view or unit changes every angle or every range alike: scans then lie well on
each other, but on a path of other lengths and turns than what the wheels counted. Where the wheels
are a prior of each match, the path may keep their lengths and turns and still run beside theirs.
"""

from __future__ import annotations

import numpy as np

from slamlab._checks import Array
from slamlab.geometry import between

# In metres and radians:
_PIECE = 1.0, 0.5  # a piece of the drive ends when the wheels went so far or turned so much
_COUNTS = 0.5, 0.25  # the length, or the turn, of a piece that is compared is at least this
_LEAST = 5  # pieces from which on the median is believed
_APART = 1.2  # wheels and scans that differ by this factor do not tell of the same drive,
_ASIDE = 0.15  # nor do those whose pieces end so far apart (m)


def disagreement(wheels: Array, scans: Array) -> str:
    """Say by how much the path (T, 3) of the wheels and that of the scans differ; else nothing.

    The median over pieces of the drive is compared, so that neither the drift of the wheels, nor
    a slip or a pause of the odometry, nor a closure counts.
    """
    u = between(wheels[:-1], wheels[1:])
    gone = np.hypot(u[:, 0], u[:, 1]) / _PIECE[0] + np.abs(u[:, 2]) / _PIECE[1]
    gone = np.append(0.0, np.cumsum(gone))
    ends = np.unique(np.searchsorted(gone, np.arange(0.0, gone[-1], 1.0)))
    ours, theirs = (between(path[ends[:-1]], path[ends[1:]]) for path in (wheels, scans))
    length = _ratio(np.hypot(*ours[:, :2].T), np.hypot(*theirs[:, :2].T), _COUNTS[0])
    turn = _ratio(ours[:, 2], theirs[:, 2], _COUNTS[1])
    apart = []
    if not 1 / _APART <= length <= _APART:
        apart.append(f"1 m of the wheels is {length:.2f} m of the scans")
    if not 1 / _APART <= turn <= _APART:
        apart.append(f"a turn of 10 degrees by the wheels is {10 * turn:.1f} by the scans")
    aside = float(np.median(np.hypot(*(theirs - ours)[:, :2].T))) if len(ours) >= _LEAST else 0.0
    if not apart and aside > _ASIDE:
        piece = f"{_PIECE[0]:g} m, or {np.rad2deg(_PIECE[1]):.0f} degrees,"
        apart.append(f"after {piece} the scans are {aside:.2f} m beside the wheels")
    return ", ".join(apart)


def _ratio(ours: Array, theirs: Array, least: float) -> float:
    """Median of theirs / ours over the pieces that count; 1 if there are too few."""
    counts = np.abs(ours) >= least
    return float(np.median(theirs[counts] / ours[counts])) if counts.sum() >= _LEAST else 1.0
