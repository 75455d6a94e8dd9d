"""The straight pieces of a scan: cut it at gaps and jumps, then by split-and-merge.

Pavlidis and Horowitz 1974; breaks after Borges and Aldon 2004; compared with incremental and other
methods by Nguyen et al. 2007. Chapter 07.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array
from slamlab.mapping.lines import across, unchecked_fit

Indices = NDArray[np.intp]

# A wall seen under less than this angle between beam and wall is told from a jump no more.
GRAZING = np.deg2rad(5.0)
# A corner moves by at most so many points when they are shared out anew.
MOST_MOVES = 5


def straight_pieces(
    points: Array, beam_numbers: Indices, origin: Array, method: str, threshold: float,
    max_gap: float, min_points: int,
) -> list[Indices]:  # fmt: skip
    """Rows of the points of each piece, in the order of the scan; short ones are left out.

    `beam_numbers` (k,) tell where beams without return lie between the points.
    """
    cut = split if method == "split-and-merge" else extend
    pieces: list[Indices] = []
    for start, stop in runs(points - origin, beam_numbers, threshold, max_gap):
        if stop - start < min_points:
            continue
        run = points[start:stop]
        cuts = settle(run, merge(run, cut(run, threshold), threshold))
        pieces += [np.arange(start + a, start + b) for a, b in pairwise(cuts)]
    return [piece for piece in pieces if len(piece) >= min_points]


def runs(
    beams: Array, beam_numbers: Indices, threshold: float, max_gap: float
) -> Iterator[tuple[int, int]]:
    """Cut the scan where the range jumps or beams without return leave a gap."""
    distance = np.hypot(*beams.T)
    turn = np.abs(np.diff(np.unwrap(np.arctan2(beams[:, 1], beams[:, 0]))))
    # On one wall the range changes by no more than this from beam to beam.
    reach = np.minimum(distance[1:], distance[:-1]) * turn / np.tan(GRAZING) + threshold
    jump = np.abs(np.diff(distance)) > reach
    missing = np.diff(beam_numbers) > 1
    gap = missing & (np.hypot(*np.diff(beams, axis=0).T) > max_gap)
    cuts = [0, *(np.flatnonzero(jump | gap) + 1).tolist(), len(beams)]
    return pairwise(cuts)


def split(points: Array, threshold: float) -> list[int]:
    """Split-and-merge, first half: cut until every piece is straight; its cuts, ends included."""
    cuts, todo = [0], [(0, len(points))]
    while todo:
        start, stop = todo.pop()
        piece = points[start:stop]
        if stop - start < 3 or straight(piece, threshold):
            cuts.append(stop)
            continue
        # The corner is the point farthest from the chord; the fit only said that there is one.
        chord = piece[-1] - piece[0]
        dx, dy = (piece - piece[0]).T
        off = np.abs(chord[0] * dy - chord[1] * dx) if chord.any() else np.hypot(dx, dy)
        corner = start + 1 + int(np.argmax(off[1:-1]))
        todo += [(corner, stop), (start, corner)]
    return cuts


def merge(points: Array, cuts: list[int], threshold: float) -> list[int]:
    """Split-and-merge, second half: drop a cut if both sides together are straight."""
    cuts, i = list(cuts), 1
    while i < len(cuts) - 1:
        if straight(points[cuts[i - 1] : cuts[i + 1]], threshold):
            del cuts[i]
            i = max(i - 1, 1)  # the side before has grown, and is asked again
        else:
            i += 1
    return cuts


def settle(points: Array, cuts: list[int]) -> list[int]:
    """Give a point beside a corner to the wall that it lies nearer to."""
    cuts = list(cuts)
    for i in range(1, len(cuts) - 1):
        for _ in range(MOST_MOVES):
            before, after = points[cuts[i - 1] : cuts[i]], points[cuts[i] : cuts[i + 1]]
            if min(len(before), len(after)) < 4:
                break
            pair = points[cuts[i] - 1 : cuts[i] + 1]
            nearer_before = distances(pair, before[:-1]) < distances(pair, after[1:])
            if nearer_before[0] and not nearer_before[1]:
                break
            cuts[i] += 1 if nearer_before[0] else -1
    return cuts


def extend(points: Array, threshold: float) -> list[int]:
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


def straight(points: Array, threshold: float) -> bool:
    """Tell whether all points lie within the threshold of their own line."""
    return bool(distances(points, points).max() <= threshold)


def distances(points: Array, of_wall: Array) -> Array:
    """Distances of points from the line fitted to others."""
    return across(points, unchecked_fit(of_wall))
