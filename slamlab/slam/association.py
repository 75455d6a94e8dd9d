"""Data association: which measurement is which landmark, by neighbours, likelihood or jointly.

P4's nearest neighbour with a fixed gate, and what mends it: the Mahalanobis gate, and the joint
compatibility of Neira and Tardos (2001). Chapter 11; serves EKF-SLAM and FastSLAM's particles.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from slamlab._checks import Array, as_array, as_count, as_instance, as_positive, as_scalar
from slamlab.gaussian import block_diagonal, chi2_quantile

__all__ = [
    "IGNORED",
    "NEW",
    "Confirmation",
    "JointSearch",
    "SearchLimitWarning",
    "joint_compatibility",
    "joint_search",
    "maximum_likelihood",
    "nearest_euclidean",
    "nearest_neighbour",
]

# Answers beside a row of the map: start a landmark, or leave the measurement out.
NEW, IGNORED = -1, -2
Rows = NDArray[np.intp]
Bools = NDArray[np.bool_]
_ODDS = (1e-12, 1 - 1e-12)
# A place that waits to become a landmark: where, how well known, how often and how lately seen.
_TENTATIVE = np.dtype(
    [("place", float, 2), ("cov", float, (2, 2)), ("n_observations", int), ("unseen_for", int)]
)


class Surface(Protocol):
    """What an association needs to see; `EKFSlam` and a particle of `FastSlam` have it."""

    @property
    def pose(self) -> Array:
        """Estimated pose (3,)."""

    @property
    def landmarks(self) -> Array:
        """Estimated landmarks (n, 2)."""

    @property
    def sensor(self) -> Any:
        """Sensor of range and bearing."""

    def innovation_covs(self, rows: ArrayLike) -> Array:
        """Return the covariances (m, 2, 2) of single innovations."""

    def innovation_cov(self, rows: ArrayLike) -> Array:
        """Return the joint covariance (2m, 2m) of innovations."""


Associate = Callable[[Any, Array], ArrayLike]


class SearchLimitWarning(RuntimeWarning):
    """The joint search was cut short: its answer is compatible, but may not be the best."""


# --- one measurement at a time ---


def nearest_euclidean(
    slam: Surface, z: ArrayLike, gate: float = 1.0, covs: ArrayLike | None = None
) -> Rows:
    """Take the landmark nearest in metres, if it is nearer than a fixed gate: P4, page 84.

    The textbook's weak form, for comparison: it knows nothing of any covariance. For sensors of
    points. Where two measurements want one landmark the nearer gets it, the other is left out.

    Parameters
    ----------
    slam : EKFSlam or particle of FastSlam
    z : array_like, shape (k, 2)
        Ranges (m) and bearings (rad) of one look.
    gate : float, default 1.0
        P4's `Gate` (m), positive.
    covs : array_like, optional
        Not looked at: that is its fault.

    Returns
    -------
    ndarray of int, shape (k,)
        Row of ``slam.landmarks``, `NEW` if no landmark is near, `IGNORED` if it is taken.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> from slamlab.slam import EKFSlam
    >>> slam = EKFSlam(Unicycle(), RangeBearing(0.1, 0.02), [0, 0, 0])
    >>> _ = slam.update([[2.0, 0.0], [2.0, 0.5]], ids=["oak", "ash"])
    >>> nearest_euclidean(slam, [[2.1, 0.51], [4.0, 0.0]], gate=0.5).tolist()
    [1, -1]
    """
    as_instance("slam", slam, Surface)
    z = as_array("z", z, ("k", 2))
    gate = as_positive("gate", gate, 1e300)
    landmarks = np.asarray(slam.landmarks)
    points = slam.sensor.locate(slam.pose, z)
    j, row = _neighbours(landmarks, points, gate)
    metres = np.hypot(*(points[j] - landmarks[row]).T)
    return _answer(len(z), j, row, _best_first(j, row, np.where(metres < gate, metres, np.inf)))


def nearest_neighbour(
    slam: Surface,
    z: ArrayLike,
    probability: float = 0.99,
    *,
    new_probability: float = 0.9999,
    margin: float = 0.0,
    covs: ArrayLike | None = None,
) -> Rows:
    """Take the landmark nearest in standard deviations, within a chi-square gate.

    The squared Mahalanobis distance of the innovation, v^T S^-1 v, decides; the best pair is
    taken first and no landmark twice.

    Parameters
    ----------
    slam : EKFSlam or particle of FastSlam
    z : array_like, shape (k, 2)
        Measurements of one look.
    probability : float, default 0.99
        A true pair passes the gate with this probability.
    new_probability : float, default 0.9999
        A measurement starts a landmark only if it lies outside this wider gate of every landmark;
        between the two gates it is left out. At least `probability`.
    margin : float, default 0.0
        Ambiguous pairs are left out: those with a second candidate, another landmark for the
        measurement or another measurement for the landmark, whose squared distance is larger by
        less than this. Not negative; 4.6 asks for odds of ten to one.
    covs : array_like, shape (k, 2, 2), optional
        Covariances of the measurements, if they are not the sensor's.

    Returns
    -------
    ndarray of int, shape (k,)
        Row of ``slam.landmarks``, `NEW` (-1) or `IGNORED` (-2). No row comes twice.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> from slamlab.slam import EKFSlam
    >>> slam = EKFSlam(Unicycle(), RangeBearing(0.1, 0.02), [0, 0, 0])
    >>> _ = slam.update([[2.0, 0.0], [2.0, 0.5]], ids=["oak", "ash"])
    >>> nearest_neighbour(slam, [[2.1, 0.51], [4.0, 0.0]]).tolist()
    [1, -1]
    """
    margin = _as_margin(margin)
    c = _candidates(slam, z, probability, new_probability, covs)
    score = np.where(c.inside, c.distance, np.inf)
    chosen = _best_first(c.j, c.row, score) & ~_ambiguous(c.j, c.row, score, margin)
    return _answer(c.k, c.j, c.row, chosen)


def maximum_likelihood(
    slam: Surface,
    z: ArrayLike,
    probability: float = 0.99,
    *,
    new_probability: float = 0.9999,
    margin: float = 0.0,
    covs: ArrayLike | None = None,
) -> Rows:
    """Take the likeliest pairs of all together, within a chi-square gate.

    The likelihood of a pair, exp(-v^T S^-1 v / 2) / sqrt(det S), also counts how wide its
    Gaussian is: a landmark of which little is known is near to everything in standard deviations.
    The product over all measurements is made largest (an assignment problem), landmarks at most
    once; a measurement left without a landmark counts as one at the edge of its widest gate.

    Parameters, result and errors are those of `nearest_neighbour`; `margin` compares
    -2 log likelihoods.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> from slamlab.slam import EKFSlam
    >>> slam = EKFSlam(Unicycle(), RangeBearing(0.1, 0.02), [0, 0, 0])
    >>> _ = slam.update([[2.0, 0.0], [2.0, 0.5]], ids=["oak", "ash"])
    >>> maximum_likelihood(slam, [[2.1, 0.51], [4.0, 0.0]]).tolist()
    [1, -1]
    """
    margin = _as_margin(margin)
    c, n = _candidates(slam, z, probability, new_probability, covs), len(slam.landmarks)
    log_det = np.log(np.linalg.det(c.S))
    score = np.where(c.inside, c.distance + log_det, np.inf)  # -2 log likelihood
    # Each measurement may stay alone, in a column of its own: at the edge of its widest gate.
    alone = np.full(c.k, -np.inf)
    np.maximum.at(alone, c.j[c.inside], _gate(float(probability), 2) + log_det[c.inside])
    cost = np.full((c.k, n + c.k), np.inf)
    cost[c.j, c.row] = score
    np.fill_diagonal(cost[:, n:], np.where(np.isfinite(alone), alone, 0.0))
    from scipy.optimize import linear_sum_assignment  # loads long, few filters ask for it

    chosen = c.row == linear_sum_assignment(cost)[1][c.j]
    return _answer(c.k, c.j, c.row, chosen & ~_ambiguous(c.j, c.row, score, margin))


# --- all measurements of a look together ---


@dataclass(frozen=True, eq=False)
class JointSearch:
    """What `joint_search` found.

    Attributes
    ----------
    rows : ndarray of int, shape (k,)
        Row of ``slam.landmarks``, `NEW` or `IGNORED` for each measurement.
    pairs : int
        Number of measurements with a landmark in the best hypothesis.
    distance : float
        Joint squared Mahalanobis distance of these pairs.
    nodes : int
        Hypotheses that were looked at.
    complete : bool
        False if the search was cut short at `max_nodes`: `rows` is then the best found so far.
    """

    rows: Rows
    pairs: int
    distance: float
    nodes: int
    complete: bool


def joint_compatibility(
    slam: Surface,
    z: ArrayLike,
    probability: float = 0.99,
    *,
    new_probability: float = 0.9999,
    margin: float = 0.0,
    max_nodes: int = 1000,
    covs: ArrayLike | None = None,
) -> Rows:
    """Take the largest set of pairs that fit together, JCBB of Neira and Tardos (2001).

    All measurements of a look are made from one pose, so their errors are correlated: where the
    robot stands wrong, all its landmarks are shifted alike. A set of m pairs is jointly
    compatible if v^T S^-1 v of the stacked innovation, with its full covariance, is below the
    chi-square quantile of 2m degrees. The largest such set wins, of equally large ones the
    nearest.

    Parameters
    ----------
    slam, z, probability, new_probability, covs
        As `nearest_neighbour`; `probability` is that of the single and of the joint gates.
    margin : float, default 0.0
        Measurements are left out on which equally large sets disagree whose joint squared
        distance is larger than that of the best by less than this.
    max_nodes : int, default 1000
        Hypotheses looked at, at most; positive. The worst case is exponential; beyond the limit
        the best set found so far is returned and a `SearchLimitWarning` is given. The first set
        looked at takes the nearest compatible landmark for one measurement after another, so the
        answer is never worse than that.

    Returns
    -------
    ndarray of int, shape (k,)
        As `nearest_neighbour`.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> from slamlab.slam import EKFSlam
    >>> slam = EKFSlam(Unicycle(), RangeBearing(0.1, 0.02), [0, 0, 0])
    >>> _ = slam.update([[2.0, 0.0], [2.0, 0.5]], ids=["oak", "ash"])
    >>> joint_compatibility(slam, [[2.1, 0.51], [1.9, 0.01], [4.0, 0.0]]).tolist()
    [1, 0, -1]
    """
    found = joint_search(
        slam,
        z,
        probability,
        new_probability=new_probability,
        margin=margin,
        max_nodes=max_nodes,
        covs=covs,
    )
    if not found.complete:
        message = f"joint search cut short after {max_nodes} hypotheses, best so far returned"
        warnings.warn(message, SearchLimitWarning, stacklevel=2)
    return found.rows


def joint_search(
    slam: Surface,
    z: ArrayLike,
    probability: float = 0.99,
    *,
    new_probability: float = 0.9999,
    margin: float = 0.0,
    max_nodes: int = 1000,
    covs: ArrayLike | None = None,
) -> JointSearch:
    """Search as `joint_compatibility`, and tell how far it went; same parameters, no warning."""
    margin, max_nodes = _as_margin(margin), as_count("max_nodes", max_nodes, 1)
    c = _candidates(slam, z, probability, new_probability, covs)
    if not c.inside.any():
        return JointSearch(_answer(c.k, c.j, c.row, c.inside), 0, 0.0, 0, True)
    search = _Search(slam, c, float(probability), margin, max_nodes)
    rows = _answer(c.k, c.j, c.row, search.pairs[search.agreed()])
    return JointSearch(rows, *search.best, search.nodes, search.complete)


class _Search:
    """Depth-first branch and bound over the measurements that have candidates.

    A pair taken is a measurement of the robot's error, so it corrects what all other landmarks
    should show, as a Kalman update would: down a branch, `x` (n, 2) and `P` (2n, 2n) are mean and
    covariance of the errors of all predictions given its pairs, and what the next pair adds to
    the joint distance is its own.
    """

    def __init__(
        self, slam: Surface, c: _Candidates, probability: float, margin: float, max_nodes: int
    ) -> None:
        self.pairs = np.flatnonzero(c.inside)
        j, row = c.j[self.pairs], c.row[self.pairs]
        self.v, self.R, self.margin = c.v[self.pairs], c.R[j], margin
        rows, self.column = np.unique(row, return_inverse=True)
        # The least ambiguous measurement first: it pins the pose down for the others.
        _, place, counts = np.unique(j, return_inverse=True, return_counts=True)
        self.depth = np.argsort(np.argsort(counts, kind="stable"))[place]
        self.gates = [_gate(probability, 2 * m) for m in range(len(counts) + 1)]
        self.best: tuple[int, float] = (-1, np.inf)
        self.found: list[tuple[int, float, list[int]]] = []
        self.max_nodes, self.nodes, self.complete = max_nodes, 0, True
        # H P H^T: predictions are correlated through the pose.
        noise = np.broadcast_to(slam.sensor.cov, (len(rows), 2, 2))
        P = slam.innovation_cov(rows) - block_diagonal(noise)
        self._descend(0, 0.0, [], np.zeros((len(rows), 2)), P)

    def _descend(self, depth: int, distance: float, chosen: list[int], x: Array, P: Array) -> None:
        """Pair the measurement at `depth` with each landmark that fits, then with none."""
        m, last = len(chosen), len(self.gates) - 1
        if self.nodes >= self.max_nodes:
            self.complete = False
        if depth == last or not self.complete:
            self._record(distance, chosen)
            return
        self.nodes += 1
        free = np.ones(len(x), bool)
        free[self.column[chosen]] = False
        i = np.flatnonzero((self.depth >= depth) & free[self.column])
        k, column = np.arange(len(x)), self.column[i]
        S = P.reshape(len(x), 2, len(x), 2)[k, :, k][column] + self.R[i]
        v = self.v[i] - x[column]
        added = _squared(v, S)
        # Adding pairs never lowers the distance: what is too far now stays so further down.
        fits = distance + added <= self.gates[m + last - depth]
        waiting = set(self.depth[i[fits]].tolist())
        here = np.flatnonzero(self.depth[i] == depth)
        for pair in here[np.argsort(added[here])]:
            total = distance + float(added[pair])
            if total > self.gates[m + 1] or self._hopeless(m + len(waiting), total):
                break
            landmark = slice(2 * column[pair], 2 * column[pair] + 2)
            K = P[:, landmark] @ np.linalg.inv(S[pair])
            given = x + (K @ v[pair]).reshape(-1, 2), P - K @ P[landmark]
            self._descend(depth + 1, total, [*chosen, int(i[pair])], *given)
            if not self.complete:
                return
        if not self._hopeless(m + len(waiting - {depth}), distance):
            self._descend(depth + 1, distance, chosen, x, P)

    def _hopeless(self, pairs: int, distance: float) -> bool:
        """Tell whether `pairs` pairs at most, at this distance at least, cannot win."""
        most, nearest = self.best
        return pairs < most or (pairs == most and distance >= nearest + self.margin)

    def _record(self, distance: float, chosen: list[int]) -> None:
        if not self._hopeless(len(chosen), distance):
            if len(chosen) > self.best[0] or distance < self.best[1]:
                self.best = len(chosen), distance
            self.found.append((len(chosen), distance, chosen))

    def agreed(self) -> list[int]:
        """Pairs of the best set that all sets have that are as large and almost as near."""
        most, nearest = self.best
        close = [
            set(chosen)
            for m, distance, chosen in self.found
            if m == most and (distance == nearest or distance < nearest + self.margin)
        ]
        return sorted(set.intersection(*close))


# --- landmarks are believed when they come back ---


class Confirmation:
    """Start a landmark only when it has been seen several times: clutter rarely returns.

    Wraps any association. Measurements that it calls `NEW` first go to a tentative list; when a
    place of that list has been seen often enough the answer is `NEW`, until then `IGNORED`.
    One object for one `EKFSlam`; particles are refused. (FastSLAM keeps evidence of existence
    itself: its `detection_probabilities`.)

    Parameters
    ----------
    associate : callable, default `nearest_neighbour`
        ``associate(slam, z) -> rows (k,)``.
    n_observations : int, default 3
        Sightings after which a landmark is started; 1 starts it at once.
    patience : int, default 5
        A tentative place not seen for more than this many looks is dropped.
    probability : float, default 0.999
        Gate around a tentative place. Its covariance is twice the sum of those of the first
        measurement and of the present one: as much again for what the estimated pose moved.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> from slamlab.slam import EKFSlam
    >>> slam = EKFSlam(Unicycle(), RangeBearing(0.1, 0.02), [0, 0, 0])
    >>> careful = Confirmation(n_observations=2)
    >>> careful(slam, [[2.0, 0.0]]).tolist(), careful(slam, [[2.0, 0.0]]).tolist()
    ([-2], [-1])
    """

    def __init__(
        self,
        associate: Associate = nearest_neighbour,
        n_observations: int = 3,
        patience: int = 5,
        probability: float = 0.999,
    ) -> None:
        self.associate = associate
        self.n_observations = as_count("n_observations", n_observations, 1)
        self.patience = as_count("patience", patience)
        probability = as_scalar("probability", probability, *_ODDS)
        self._gate, self._waiting = float(chi2_quantile(probability, 2)), np.zeros(0, _TENTATIVE)

    @property
    def tentative(self) -> Array:
        """Places waiting (m, 2), in the world of the map."""
        return self._waiting["place"].copy()

    def __call__(self, slam: Surface, z: ArrayLike, covs: ArrayLike | None = None) -> Rows:
        """Return rows as any association does."""
        if hasattr(slam, "number"):
            raise ValueError("slam: expected EKFSlam, got a particle of FastSlam")
        z = as_array("z", z, ("k", 2))
        more = {} if covs is None else {"covs": covs}
        rows = np.array(self.associate(slam, z, **more), dtype=np.intp)
        new = np.flatnonzero(rows == NEW)
        R = np.broadcast_to(slam.sensor.cov if covs is None else covs, (len(z), 2, 2))
        places = self._recognise(slam, z[new], R[new])
        waiting = self._waiting
        waiting["n_observations"][places] += 1
        waiting["unseen_for"] += 1
        waiting["unseen_for"][places] = 0
        ready = waiting["n_observations"][places] >= self.n_observations
        rows[new[~ready]] = IGNORED
        keep = waiting["unseen_for"] <= self.patience
        keep[places[ready]] = False
        self._waiting = waiting[keep]
        return rows

    def _recognise(self, slam: Surface, z: Array, R: Array) -> Rows:
        """Place on the tentative list of each new measurement; a fresh one if none is near."""
        if len(z) == 0:
            return np.empty(0, dtype=np.intp)
        waiting = self._waiting
        predicted = slam.sensor.observe(slam.pose, waiting["place"])
        v = slam.sensor.residual(z[:, None], predicted[None])
        weight = np.linalg.inv(2 * (R[:, None] + waiting["cov"]))
        distance = np.einsum("kni,knij,knj->kn", v, weight, v)
        j, row = np.nonzero(distance < self._gate)
        places = _answer(len(z), j, row, _best_first(j, row, distance[j, row]))
        fresh = np.flatnonzero(places < 0)
        added = places[fresh] = len(waiting) + np.arange(len(fresh))
        grown = np.zeros(len(waiting) + len(fresh), _TENTATIVE)
        grown[: len(waiting)] = waiting
        grown["place"][added] = slam.sensor.locate(slam.pose, z[fresh])
        grown["cov"][added] = R[fresh]
        self._waiting = grown
        return places


# --- candidates ---


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Pairs (c,) of one of k measurements and a landmark, within the wider gate."""

    k: int
    j: Rows  # (c,) measurement
    row: Rows  # (c,) landmark
    v: Array  # (c, 2) innovation
    S: Array  # (c, 2, 2) its covariance
    distance: Array  # (c,) v^T S^-1 v
    inside: Bools  # (c,) within the narrower gate
    R: Array  # (k, 2, 2) covariances of the measurements


def _candidates(
    slam: Surface, z: ArrayLike, low: float, high: float, covs: ArrayLike | None = None
) -> _Candidates:
    """All pairs within the gate of probability `high`, found by a tree of predicted landmarks.

    A pair in the gate has |v_i| <= sqrt(gate S_ii), so seen from the sensor its two places are
    apart by no more than the reach in range plus the measured range times that in bearing.
    """
    as_instance("slam", slam, Surface)
    z = as_array("z", z, ("k", 2))
    low = as_scalar("probability", low, *_ODDS)
    high = as_scalar("new_probability", high, low, _ODDS[1])
    R = np.tile(slam.sensor.cov, (len(z), 1, 1))
    if covs is not None:
        R = as_array("covs", covs, (len(z), 2, 2))
    landmarks = np.asarray(slam.landmarks)
    predicted = slam.sensor.observe(slam.pose, landmarks)
    S = slam.innovation_covs(np.arange(len(landmarks))) - slam.sensor.cov
    widest = np.diag(S.max(0, initial=0.0) + R.max(0, initial=0.0))
    reach = np.sqrt(_gate(high, 2) * widest) * (1 + 1e-9)
    j, row = _neighbours(_plane(predicted), _plane(z), reach[0] + np.abs(z[:, 0]) * reach[1])
    v, S = slam.sensor.residual(z[j], predicted[row]), S[row] + R[j]
    distance = _squared(v, S)
    near = distance <= _gate(high, 2)
    j, row, v, S, distance = j[near], row[near], v[near], S[near], distance[near]
    return _Candidates(len(z), j, row, v, S, distance, distance <= _gate(low, 2), R)


@lru_cache(maxsize=256)
def _gate(probability: float, dof: int) -> float:
    """Chi-square quantile; every look asks for the same few."""
    return float(chi2_quantile(probability, dof))


def _plane(polar: Array) -> Array:
    """Points (..., 2) of the sensor's plane; both names of a wall, (r, a), (-r, a + pi), agree."""
    r, angle = polar[..., 0], polar[..., 1]
    return np.stack([r * np.cos(angle), r * np.sin(angle)], -1)


def _neighbours(there: Array, points: Array, radius: ArrayLike) -> tuple[Rows, Rows]:
    """Pairs (c,), (c,) of one of `points` and one of the points `there` within `radius` of it."""
    if len(there) == 0 or len(points) == 0:
        return np.empty(0, np.intp), np.empty(0, np.intp)
    near = cKDTree(there).query_ball_point(points, radius, return_sorted=True)
    j = np.repeat(np.arange(len(points)), [len(some) for some in near])
    return j, np.concatenate(near).astype(np.intp)


def _squared(v: Array, S: Array) -> Array:
    """Squared Mahalanobis distances of v (c, 2) by covariances (c, 2, 2), written out."""
    (a, b), (xx, xy, yy) = v.T, (S[:, 0, 0], S[:, 0, 1], S[:, 1, 1])
    return np.asarray((yy * a**2 + xx * b**2 - 2 * xy * a * b) / (xx * yy - xy * xy))


def _best_first(j: Rows, row: Rows, score: Array) -> Bools:
    """Which pairs (c,) are taken in the order of their score, nothing twice; inf never is."""
    chosen = np.zeros(len(j), bool)
    measured, taken = set[int](), set[int]()
    for i in np.argsort(score, kind="stable"):
        if j[i] not in measured and row[i] not in taken and score[i] < np.inf:
            chosen[i] = True
            measured.add(j[i])
            taken.add(row[i])
    return chosen


def _ambiguous(j: Rows, row: Rows, score: Array, margin: float) -> Bools:
    """Which pairs (c,) have a second-best match, of the same measurement or the same landmark."""
    if margin == 0.0:
        return np.zeros(len(j), bool)
    shared = (j[:, None] == j) ^ (row[:, None] == row)
    return np.asarray((shared & (score < score[:, None] + margin)).any(1))


def _answer(k: int, j: Rows, row: Rows, chosen: Bools | Rows) -> Rows:
    """Rows (k,) of the pairs `chosen`, by a mask or by number.

    A measurement without one is new, or near to something.
    """
    rows = np.full(k, NEW, dtype=np.intp)
    rows[j] = IGNORED
    rows[j[chosen]] = row[chosen]
    return rows


def _as_margin(margin: float) -> float:
    return as_scalar("margin", margin, 0.0, 1e300)
