"""Back end of `ScanGraphSlam`: has the robot been here before, and is that to be believed.

Candidates, verification, the second-best match (Olson 2009), pairwise consistency
(Mangelson et al. 2018). Page 14b shows what each of them is for; a letter in a comment is a
formula of the page before it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array
from slamlab.geometry import between, compose, rotation, transform
from slamlab.matching import match_correlative, match_field, match_icp, voxel_downsample
from slamlab.slam._chain import Chain, PoseChain
from slamlab.slam._tracking import LocalMap, edge_cov
from slamlab.slam.least_squares import KERNEL_WIDTHS, edge_error
from slamlab.slam.pose_graph import PoseGraph

CLOSURE_SPACING = 1.5  # a node is tried for closures every so many metres of travel
MIN_LOOP_LENGTH = 20.0  # a closure joins places at least so far apart along the path (m)
# And at most so far apart as believed (m), and more the longer nothing was closed: metres a metre
# since the last closure, and the limit.
MIN_SEARCH_RADIUS, DRIFT, MAX_SEARCH_RADIUS = 2.5, 0.03, 12.0
SUBMAP_LENGTH = 6.0  # the old place is drawn from the nodes within this travel (m)
N_QUERY_SCANS = 3  # scans before and after that are laid on it together with the node's own
TURN, TURN_STEP = np.deg2rad(20), np.deg2rad(1.5)
MIN_SCORE = 0.6  # 1 - mean (1 - M)^2 of the merged scans must reach this
HIGH_SCORE = 0.8  # and with this much one consistent closure is enough
SECOND_PEAK_DISTANCE = 0.8  # from so far away on (m) another place is a second peak, and
MAX_SECOND_PEAK = 0.8  # its score must stay below this part of the best
MAX_ICP_SHIFT = 0.3  # point to line must not move the result farther than this (m)
CONSISTENCY_WINDOW = 15.0  # consistent closures lie within this travel of both ends (m)
MIN_COV = np.diag(np.square([0.03, 0.03, np.deg2rad(0.4)]))
# A closure with more chi2 is dropped: by the solver, or by the chain if it fits badly.
MAX_CLOSURE_CHI2 = 60.0


@dataclass(eq=False)
class Closure:
    """Node k was found to stand at z in the frame of the older node j.

    Attributes
    ----------
    j, k : int
        Nodes.
    z : ndarray, shape (3,)
        Pose of k seen from j (m, m, rad).
    cov : ndarray, shape (3, 3)
        Covariance of z, in the frame of k as measured; see `edge_error`.
    second_peak : float
        Score of the best place elsewhere as a part of the best; near 1 in a corridor.
    fit : float
        How well the scans lie on the old place, at most 1.
    state : str
        "waiting" for consistent closures, "confirmed", or "rejected" by the chain or the solver.
    """

    j: int
    k: int
    z: Array
    cov: Array
    second_peak: float
    fit: float
    state: str = "waiting"


class ClosureSearch:
    """The search for closures of a chain while it grows.

    Attributes
    ----------
    closures : list of Closure
        All that were verified.
    """

    def __init__(self, inflate: bool) -> None:
        self.closures: list[Closure] = []
        self._inflate = inflate  # ambiguous ones, instead of rejecting them
        self._last_tried = self._last_closed = 0.0  # travel at the last trial, the last closure

    def try_node(self, k: int, chain: PoseChain) -> bool:
        """Look for old places at node k; tell whether any closure is confirmed now."""
        if k < 0 or chain.travel[k] - self._last_tried < CLOSURE_SPACING:
            return False
        travel = self._last_tried = chain.travel[k]
        old, radius = candidates(k, chain, travel - self._last_closed)
        tried = [verify(j, k, radius, chain, self._inflate) for j in old]
        found = [one for one in tried if one is not None]
        for one in found:  # what contradicts the chain must fit well
            if one.fit < HIGH_SCORE and chain_chi2(one, chain) > MAX_CLOSURE_CHI2:
                one.state = "rejected"
        self.closures += found
        if not (found and confirm(self.closures, self.closures, chain)):
            return False
        self._last_closed = travel
        return True


def candidates(
    k: int, chain: Chain, since: float, before: int | None = None
) -> tuple[list[int], float]:
    """Old nodes to try with node k, one of each of two passes at most, and how far to search (m).

    The nearest node of all, and the nearest of the oldest pass (of the newest, if these are the
    same): whoever is tied only to the pass before is tied to nothing older. `since` is the travel
    since the last closure (m); `before` leaves out that node and all after it.
    """
    poses, travel = chain.poses, chain.travel
    radius = min(MIN_SEARCH_RADIUS + DRIFT * since, MAX_SEARCH_RADIUS)
    old = np.searchsorted(travel[:before], travel[k] - MIN_LOOP_LENGTH)
    distance = np.hypot(*(poses[:old, :2] - poses[k, :2]).T)
    near = np.flatnonzero(distance < radius)
    if len(near) == 0:
        return [], radius
    passes = np.split(near, np.flatnonzero(np.diff(travel[near]) > MIN_LOOP_LENGTH) + 1)
    nearest = [int(one[np.argmin(distance[one])]) for one in passes]
    best = min(nearest, key=lambda j: distance[j])
    others = [j for j in (nearest[0], nearest[-1]) if j != best]
    return [best, *others[:1]], radius


def verify(j: int, k: int, radius: float, chain: Chain, inflate: bool) -> Closure | None:
    """Lay the scans round node k upon the place round node j; None if that convinces nobody."""
    nodes, poses, travel = chain.nodes, chain.poses, chain.travel
    # The place: walls of the nodes within some metres of travel. The query: the scans round k.
    first, last = np.searchsorted(travel, [travel[j] - SUBMAP_LENGTH, travel[j] + SUBMAP_LENGTH])
    last = min(max(int(last), j + 1), k - N_QUERY_SCANS)
    around = range(max(k - N_QUERY_SCANS, 0), min(k + N_QUERY_SCANS + 1, len(nodes)))
    seen = between(poses[k], poses[around])
    merged = [transform(pose, nodes[n].points) for pose, n in zip(seen, around, strict=True)]
    query = voxel_downsample(np.concatenate(merged), 0.15)
    local_map = LocalMap([chain.outline(first, last)])
    # Search (Olson 2009): is there a place that fits, and none elsewhere that fits nearly as well?
    found = match_correlative(
        local_map.field, query, poses[k], radius, TURN, TURN_STEP, 0.4, SECOND_PEAK_DISTANCE
    )
    if found is None or (found.second_peak > MAX_SECOND_PEAK and not inflate):
        return None
    # Refine: climb, then scan k alone, point to line.
    refined = match_field(local_map.field, query, found.pose)
    fit = 1 - refined.rmse**2
    if fit < MIN_SCORE or len(local_map.walls.points) < 3:
        return None
    match = match_icp(local_map.walls, nodes[k].points, refined.pose)
    if match.score == 0 or np.hypot(*(match.pose - refined.pose)[:2]) > MAX_ICP_SHIFT:
        return None
    cov = 4 * match.cov
    if found.second_peak > MAX_SECOND_PEAK:
        cov = cov + _inflation(refined.cov, radius)  # 14b (E)
    cov = edge_cov(cov, match.pose[2], MIN_COV)
    return Closure(j, k, between(poses[j], match.pose), cov, found.second_peak, fit)


def _inflation(cov: Array, radius: float) -> Array:
    """Spread of the window's width along the direction that holds least."""
    _, vectors = np.linalg.eigh(cov[:2, :2])
    out = np.zeros((3, 3))
    out[:2, :2] = (0.5 * radius) ** 2 * np.outer(vectors[:, -1], vectors[:, -1])
    return out


def chain_chi2(one: Closure, chain: PoseChain) -> float:
    """Squared Mahalanobis distance of a closure from where the chain leads.

    The covariances of the edges, each in the frame of its newer node, are compounded (Smith, Self
    and Cheeseman 1990): an error of heading has a lever, the way that is left to node k.
    """
    poses, covs = chain.poses, np.array([cov for _, cov in chain.edges[one.j : one.k]])
    x, y, turn = between(poses[one.k], poses[one.j + 1 : one.k + 1]).T
    jac = np.zeros((len(x), 3, 3))
    jac[:, :2, :2] = rotation(turn)
    jac[:, :, 2] = np.stack([y, -x, np.ones_like(x)], axis=-1)
    cov = one.cov + (jac @ covs @ jac.mT).sum(axis=0)
    e = edge_error(poses[one.j], poses[one.k], one.z)  # 13 (A)
    return float(e @ np.linalg.solve(cov, e))


def pairwise_consistent(one: Closure, others: list[Closure], chain: Chain) -> bool:
    """Whether two others near both ends, and half of all there, tell the same story.

    One is enough for a closure that fits well; and who fits worse does not speak against it.
    """
    poses, travel = chain.poses, chain.travel
    agree = near = 0
    for other in others:
        if other is one or other.state == "rejected":
            continue
        there, here = (abs(travel[a] - travel[b]) for a, b in ((other.j, one.j), (other.k, one.k)))
        if there > CONSISTENCY_WINDOW or here > CONSISTENCY_WINDOW:
            continue
        # 13b (I): z_a (+) x_ka,kb = x_ja,jb (+) z_b
        by_one = compose(one.z, between(poses[one.k], poses[other.k]))
        by_other = compose(between(poses[one.j], poses[other.j]), other.z)
        dx, dy, turn = between(by_one, by_other)
        path = there + here
        same = np.hypot(dx, dy) < 0.25 + 0.02 * path and abs(turn) < np.deg2rad(2 + 0.15 * path)
        agree += bool(same)
        near += bool(same or other.fit >= one.fit)
    return agree >= (1 if one.fit >= HIGH_SCORE else 2) and 2 * agree >= near


def confirm(some: Iterable[Closure], closures: list[Closure], chain: Chain) -> bool:
    """Confirm those that wait and are consistent with all others; tell whether there are any."""
    newly_confirmed = [
        one for one in some if one.state == "waiting" and pairwise_consistent(one, closures, chain)
    ]
    for one in newly_confirmed:
        one.state = "confirmed"
    return bool(newly_confirmed)


def chain_graph(
    poses: Array,
    k: NDArray[np.intp],
    z: Array,
    information: Array,
    closures: Sequence[Closure],
) -> PoseGraph:
    """Pose graph of edges from nodes k (m,) to the next, and of the closures that count."""
    loop_closures = [one for one in closures if one.state == "confirmed"]
    joined = np.reshape([(one.j, one.k) for one in loop_closures], (-1, 2)).astype(int)
    return PoseGraph(
        poses,
        np.concatenate([np.column_stack([k, k + 1]), joined]),
        np.concatenate([z, np.reshape([one.z for one in loop_closures], (-1, 3))]),
        np.concatenate([information, inverses([one.cov for one in loop_closures])]),
    )


def inverses(covs: Sequence[Array]) -> Array:
    """Information (n, 3, 3), exactly symmetric, of n covariances."""
    information = np.linalg.inv(np.reshape(covs, (-1, 3, 3)))
    return 0.5 * (information + information.mT)


def optimized(
    graph: Callable[[], PoseGraph], closures: Sequence[Closure]
) -> tuple[PoseGraph, Array]:
    """Optimise a graph that ends in the confirmed closures; drop those that do not fit; again.

    Returns the graph of the closures that are left, and its poses (n, 3).
    """
    while True:
        loop_closures, last = [one for one in closures if one.state == "confirmed"], graph()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            result = last.optimize(
                "levenberg-marquardt", kernel="dcs", kernel_width=KERNEL_WIDTHS, tolerance=1e-5
            )
        first = len(last.edges) - len(loop_closures)
        e = last.residuals(result.poses)[first:]
        chi2 = np.einsum("ni,nij,nj->n", e, last.information[first:], e)
        for one, misfit in zip(loop_closures, chi2, strict=True):
            if misfit > MAX_CLOSURE_CHI2:
                one.state = "rejected"
        if (chi2 <= MAX_CLOSURE_CHI2).all():
            return last, result.poses
