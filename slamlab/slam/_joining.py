"""Where in a map did another drive begin? Nobody knows: its places are searched in all of the map.

Whole-map search by branch and bound: Hess et al. 2016. What it finds is verified and confirmed as
every closure of `ScanGraphSlam` is. Chapter 13.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slamlab._checks import Array
from slamlab.geometry import between, compose, inverse, transform
from slamlab.matching import LikelihoodGrid, match_correlative, voxel_downsample
from slamlab.slam._chain import Chain
from slamlab.slam._closures import (
    CLOSURE_SPACING,
    MAX_SECOND_PEAK,
    MIN_LOOP_LENGTH,
    MIN_SEARCH_RADIUS,
    N_QUERY_SCANS,
    Closure,
    candidates,
    pairwise_consistent,
    verify,
)
from slamlab.slam._tracking import SPACING

# Travel between the drives of a map (m): no closure spans it as if it were a path.
GAP = 5 * MIN_LOOP_LENGTH
MOST_PLACES, FARTHEST = 60, 5.0  # of a drive are searched, and not farther apart (m)
COARSE_FIELD = (0.1, 0.1)  # width and cell of the field of all of the map (m)
QUERY_SPACING = 0.3  # one point of a place in every square of this side (m)
TURN_STEP = np.deg2rad(1.5)
LEAST = 0.5  # mean of that field at the points of a place that is looked at more closely
MIN_AGREEING = 4  # closures that agree on the frame: the search in all of the map ends
FRAME_TOLERANCE = (2.0, np.deg2rad(15))  # two closures agree on the frame of a drive (m, rad)

Progress = Callable[[int, int], object]


@dataclass(frozen=True, eq=False)
class Alignment:
    """How a drive lies in a map: its frame there, the closures, how many places were searched."""

    frame: Array | None
    closures: list[Closure]
    places: int


def together(old: Chain, new: Chain) -> Chain:
    """Both chains as one, with a gap of travel between them."""
    poses = np.vstack([old.poses, new.poses])
    travel = np.concatenate([old.travel, old.travel[-1] + GAP + new.travel])
    return Chain(old.nodes + new.nodes, poses, travel)


def recognised(old: Chain, new: Chain, progress: Progress) -> Alignment:
    """Search places of a new drive in all of an old map, until enough of them agree.

    Each place is found without what the others found; in the closures node k of the drive has
    number ``len(old.nodes) + k``.
    """
    placed = zip(old.poses, old.nodes, strict=True)
    walls = np.concatenate([transform(pose, node.points) for pose, node in placed])
    walls = voxel_downsample(walls, SPACING)
    whole = LikelihoodGrid.of_points(walls, *COARSE_FIELD)
    low, high = walls.min(0), walls.max(0)
    middle, reach = np.array([*(0.5 * (low + high)), 0.0]), float((high - low).max()) / 2
    found: list[Closure] = []
    places = _places(new)
    for done, k in enumerate(places, 1):
        query = _around(new, k)
        match = match_correlative(
            whole, query, middle, reach, np.pi, TURN_STEP, LEAST,
            second_peak_distance=MIN_SEARCH_RADIUS,
        )  # fmt: skip
        progress(done, len(places))
        if match is None or match.second_peak > MAX_SECOND_PEAK:
            continue
        moved = compose(_frame(match.pose, new.poses[k]), new.poses)
        both = together(old, Chain(new.nodes, moved, new.travel))
        j = int(np.hypot(*(old.poses[:, :2] - match.pose[:2]).T).argmin())
        one = verify(j, len(old.nodes) + k, MIN_SEARCH_RADIUS, both, False)
        if one is None:
            continue
        found.append(one)
        frame = _agreed(old, new, found)
        if frame is not None and sum(c.state == "confirmed" for c in found) >= MIN_AGREEING:
            return Alignment(frame, found, done)
    return Alignment(_agreed(old, new, found), found, len(places))


def _places(new: Chain) -> list[int]:
    """Nodes of a drive, a stride or more apart, that have others before and after them."""
    step = min(max(CLOSURE_SPACING, float(new.travel[-1]) / MOST_PLACES), FARTHEST)
    first = np.unique(np.searchsorted(new.travel, np.arange(0.0, new.travel[-1] + step, step)))
    return [int(k) for k in first if N_QUERY_SCANS <= k < len(new.nodes) - N_QUERY_SCANS]


def _around(new: Chain, k: int) -> Array:
    """Points of a node and of those beside it, in its frame."""
    near = range(k - N_QUERY_SCANS, k + N_QUERY_SCANS + 1)
    parts = [transform(between(new.poses[k], new.poses[n]), new.nodes[n].points) for n in near]
    return voxel_downsample(np.concatenate(parts), QUERY_SPACING)


def _frame(there: Array, here: Array) -> Array:
    """Where the frame lies in which a pose is `here`, if in the map it is `there`."""
    return compose(there, inverse(here))


def _agreed(old: Chain, new: Chain, found: list[Closure]) -> Array | None:
    """Confirm what is consistent; the frame on which twice as many agree as speak against it."""
    n = len(old.nodes)
    both = together(old, new)
    for one in found:
        agrees = pairwise_consistent(one, found, both)
        one.state = "confirmed" if agrees else "waiting"
    sure = [one for one in found if one.state == "confirmed"]
    if not sure:
        return None
    frames = np.array([_frame(compose(old.poses[c.j], c.z), new.poses[c.k - n]) for c in sure])
    off = between(frames[:, None], frames)
    distance, angle = FRAME_TOLERANCE
    alike = (np.hypot(off[..., 0], off[..., 1]) < distance) & (abs(off[..., 2]) < angle)
    best = int(alike.sum(1).argmax())
    if alike[best].sum() <= 2 * (~alike[best]).sum():
        return None
    for one, agrees in zip(sure, alike[best], strict=True):
        one.state = "confirmed" if agrees else "rejected"
    return frames[best]


def more(k: int, n: int, chain: Chain, since: float) -> list[Closure]:
    """Closures of node k with the first n, those of other drives, near where it is believed."""
    near, radius = candidates(k, chain, since, before=n)
    tried = [verify(j, k, radius, chain, False) for j in near]
    return [one for one in tried if one is not None]
