"""Data association: which measurement is which landmark, by neighbours, likelihood or jointly.

P4's nearest neighbour with a fixed gate, and what mends it: the Mahalanobis gate, and the joint
compatibility of Neira and Tardos (2001). Chapter 11; serves EKF-SLAM and FastSLAM's particles.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from slamlab._checks import Array, as_a, as_array, as_count, as_positive, as_scalar
from slamlab.gaussian import chi2_quantile
from slamlab.slam._particle_view import IGNORED, NEW, ParticleView

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

Rows = NDArray[np.intp]
_ODDS = (1e-12, 1 - 1e-12)


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

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite, or `gate` is not positive.

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
    as_a("slam", slam, Surface)
    z = as_array("z", z, ("k", 2))
    gate = as_positive("gate", gate, 1e300)
    landmarks = np.asarray(slam.landmarks)
    if len(landmarks) == 0 or len(z) == 0:
        return np.full(len(z), NEW, dtype=np.intp)
    points = slam.sensor.locate(slam.pose, z)
    near = cKDTree(landmarks).query_ball_point(points, gate)
    j, row = _flat(near)
    distance = np.hypot(*(points[j] - landmarks[row]).T)
    return _best_first(_Pairs(len(z), j, row, distance, distance < gate), distance, 0.0)


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
        Ambiguous pairs are left out: those with a rival, another landmark for the measurement or
        another measurement for the landmark, whose squared distance is larger by less than this.
        4.6 asks for odds of ten to one.
    covs : array_like, shape (k, 2, 2), optional
        Covariances of the measurements, if they are not the sensor's.

    Returns
    -------
    ndarray of int, shape (k,)
        Row of ``slam.landmarks``, `NEW` (-1) or `IGNORED` (-2). No row comes twice.

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite, or a probability or margin out of range.

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
    pairs = _candidates(slam, z, probability, new_probability, covs)
    return _best_first(pairs, pairs.distance, _as_margin(margin))


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
    The product over all measurements is made largest (by the Hungarian method), landmarks at most
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
    pairs = _candidates(slam, z, probability, new_probability, covs)
    margin = _as_margin(margin)
    inside, gate = pairs.inside, _gate(float(probability), 2)
    score = pairs.distance + pairs.log_det
    rows, column = np.unique(pairs.row[inside], return_inverse=True)
    cost = np.full((pairs.k, len(rows) + pairs.k), np.inf)
    cost[pairs.j[inside], column] = score[inside]
    # Each measurement may stay alone, in a column of its own.
    alone = np.full(pairs.k, 0.0)
    if inside.any():
        widest = np.full(pairs.k, -np.inf)
        np.maximum.at(widest, pairs.j[inside], pairs.log_det[inside])
        alone = np.where(np.isfinite(widest), gate + widest, 0.0)
    np.fill_diagonal(cost[:, len(rows) :], alone)
    from scipy.optimize import linear_sum_assignment  # loads long, few filters ask for it

    chosen = linear_sum_assignment(cost)[1]
    answer = pairs.unpaired()
    for j in np.flatnonzero(chosen < len(rows)):
        row = rows[chosen[j]]
        answer[j] = IGNORED if pairs.rivals(int(j), int(row), score, margin) else row
    return answer


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
        Hypotheses looked at, at most. The worst case is exponential; beyond the limit the best
        set found so far is returned and a `SearchLimitWarning` is given. The first set looked at
        takes the nearest compatible landmark for one measurement after another, so the answer
        is never worse than that.

    Returns
    -------
    ndarray of int, shape (k,)
        As `nearest_neighbour`.

    Raises
    ------
    ValueError
        As `nearest_neighbour`, or if `max_nodes` is no positive whole number.

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
    pairs = _candidates(slam, z, probability, new_probability, covs)
    if not pairs.inside.any():
        return JointSearch(pairs.unpaired(), 0, 0.0, 0, True)
    search = _Search(slam, pairs, float(probability), margin, max_nodes)
    answer = pairs.unpaired()
    for j, row in search.agreed():
        answer[j] = row
    return JointSearch(answer, search.best[0], search.best[1], search.nodes, search.complete)


class _Search:
    """Depth-first branch and bound over the measurements that have candidates.

    A pair taken is a measurement of the robot's error, so it corrects what all other landmarks
    should show, as a Kalman update would: down a branch, innovations and their joint covariance
    are those given its pairs, and what the next pair adds to the joint distance is its own.
    """

    def __init__(
        self, slam: Surface, pairs: _Pairs, probability: float, margin: float, max_nodes: int
    ) -> None:
        j, row, v, more = (a[pairs.inside] for a in (pairs.j, pairs.row, pairs.v, pairs.more))
        self.rows, column = np.unique(row, return_inverse=True)
        measurements, place, counts = np.unique(j, return_inverse=True, return_counts=True)
        # The least ambiguous measurement first: it pins the pose down for the others.
        by_counts = np.argsort(counts, kind="stable")
        self.order = measurements[by_counts]
        place = np.argsort(by_counts)[place]
        by_place = np.argsort(place, kind="stable")
        self.place, self.column, self.v = place[by_place], column[by_place], v[by_place]
        self.more = more[by_place]
        self.gates = [_gate(probability, 2 * pairs) for pairs in range(len(self.order) + 1)]
        self.margin, self.max_nodes = margin, max_nodes
        self.nodes, self.complete = 0, True
        self.chosen: list[tuple[int, int]] = []
        self.used = np.zeros(len(self.rows), dtype=bool)
        self.best: tuple[int, float] = (-1, np.inf)
        self.found: list[tuple[int, float, dict[int, int]]] = []
        # Innovations of landmarks are correlated through the pose, whoever measured them.
        n = len(self.rows)
        self.S = slam.innovation_cov(self.rows) if n else np.empty((0, 0))
        # Two rows for each pair of the branch: the whitened ties of its innovation to all.
        self.ties = np.empty((2 * len(self.order), 2 * n))
        own = self.S.reshape(n, 2, n, 2)[np.arange(n), :, np.arange(n)]
        self._descend(0, 0.0, own, np.zeros((n, 2)))

    def _descend(self, depth: int, distance: float, own: Array, shift: Array) -> None:
        """Pair the measurement at `depth` with each landmark that fits, then with none.

        `own` (n, 2, 2) and `shift` (n, 2) are covariance and mean of each innovation, given the
        pairs of the branch.
        """
        m = len(self.chosen)
        if self.nodes >= self.max_nodes:
            self.complete = False
        if depth == len(self.order) or not self.complete:
            self._record(m, distance)
            return
        self.nodes += 1
        options = np.flatnonzero((self.place >= depth) & ~self.used[self.column])
        column, v = self.column[options], self.v[options] - shift[self.column[options]]
        S = own[column] + self.more[options]
        added = _squared(v, S)
        # Adding pairs never lowers the distance: what is too far now stays so further down.
        fits = distance + added <= self.gates[m + len(self.order) - depth]
        waiting = set(self.place[options[fits]].tolist())
        here = np.flatnonzero(self.place[options] == depth)
        for i in here[np.argsort(added[here])]:
            total = distance + float(added[i])
            if total > self.gates[m + 1] or self._hopeless(m + len(waiting), total):
                break
            c = int(column[i])
            given = self._given(own, shift, c, v[i], S[i])
            self.chosen.append((depth, c))
            self.used[c] = True
            self._descend(depth + 1, total, *given)
            self.used[c] = False
            self.chosen.pop()
            if not self.complete:
                return
        if not self._hopeless(m + len(waiting - {depth}), distance):
            self._descend(depth + 1, distance, own, shift)

    def _given(self, own: Array, shift: Array, c: int, v: Array, S: Array) -> tuple[Array, Array]:
        """Covariances and means of all, once landmark c was off by v more, of covariance S."""
        a, at = 2 * len(self.chosen), slice(2 * c, 2 * c + 2)
        cross = self.S[at] - self.ties[:a, at].T @ self.ties[:a]
        # Whitened by the inverse Cholesky factor of S, written out.
        (xx, xy), (_, yy) = S
        first = np.sqrt(xx)
        second = np.sqrt(yy - xy * xy / xx)
        whiten = np.array([[1 / first, 0.0], [-xy / (xx * second), 1 / second]])
        new = whiten @ cross
        self.ties[a : a + 2] = new
        blocks = new.reshape(2, -1, 2)
        less = blocks[..., :, None] * blocks[..., None, :]
        return own - less[0] - less[1], shift + ((whiten @ v) @ new).reshape(-1, 2)

    def _hopeless(self, pairs: int, distance: float) -> bool:
        """Tell whether `pairs` pairs at most, at this distance at least, cannot win."""
        most, nearest = self.best
        return pairs < most or (pairs == most and distance >= nearest + self.margin)

    def _record(self, m: int, distance: float) -> None:
        if self._hopeless(m, distance):
            return
        if m > self.best[0] or distance < self.best[1]:
            self.best = m, distance
        named = {int(self.order[place]): int(self.rows[c]) for place, c in self.chosen}
        self.found.append((m, distance, named))

    def agreed(self) -> list[tuple[int, int]]:
        """Pairs of the best set on which no set as large and almost as near disagrees."""
        most, nearest = self.best
        close = [
            (distance, named)
            for m, distance, named in self.found
            if m == most and (distance == nearest or distance < nearest + self.margin)
        ]
        if not close:
            return []
        best = min(close, key=lambda one: one[0])[1]
        return [(j, r) for j, r in best.items() if all(named.get(j) == r for _, named in close)]


def _squared(v: Array, S: Array) -> Array:
    """Squared Mahalanobis distances of v (c, 2) by covariances (c, 2, 2), written out."""
    det = S[:, 0, 0] * S[:, 1, 1] - S[:, 0, 1] * S[:, 1, 0]
    square = S[:, 1, 1] * v[:, 0] ** 2 + S[:, 0, 0] * v[:, 1] ** 2
    return np.asarray((square - 2 * S[:, 0, 1] * v[:, 0] * v[:, 1]) / det)


# --- landmarks are believed when they come back ---


class Confirmation:
    """Start a landmark only when it has been seen several times: clutter rarely returns.

    Wraps any association. Measurements that it calls `NEW` first go to a tentative list; when a
    place of that list has been seen often enough the answer is `NEW`, until then `IGNORED`.
    One object for one `EKFSlam`. (FastSLAM keeps evidence of existence itself: its `detection`.)

    Parameters
    ----------
    associate : callable, default `nearest_neighbour`
        ``associate(slam, z) -> rows (k,)``.
    sightings : int, default 3
        Sightings after which a landmark is started; 1 starts it at once.
    patience : int, default 5
        A tentative place not seen for more than this many looks is dropped.
    probability : float, default 0.999
        Gate around a tentative place. Its covariance is twice the sum of those of the first
        measurement and of the present one: as much again for what the estimated pose moved.

    Attributes
    ----------
    tentative : ndarray, shape (m, 2)
        Places waiting, in the world of the map.

    Raises
    ------
    ValueError
        If a count or probability is out of range; when called, if `slam` is a particle.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> from slamlab.slam import EKFSlam
    >>> slam = EKFSlam(Unicycle(), RangeBearing(0.1, 0.02), [0, 0, 0])
    >>> careful = Confirmation(sightings=2)
    >>> careful(slam, [[2.0, 0.0]]).tolist(), careful(slam, [[2.0, 0.0]]).tolist()
    ([-2], [-1])
    """

    def __init__(
        self,
        associate: Associate = nearest_neighbour,
        sightings: int = 3,
        patience: int = 5,
        probability: float = 0.999,
    ) -> None:
        self.associate = associate
        self.sightings = as_count("sightings", sightings, 1)
        self.patience = as_count("patience", patience)
        probability = as_scalar("probability", probability, *_ODDS)
        self._gate, self._covs = float(chi2_quantile(probability, 2)), np.empty((0, 2, 2))
        self.tentative, self._seen = np.empty((0, 2)), np.zeros(0, dtype=int)
        self._unseen_for = np.zeros(0, dtype=int)

    def __call__(self, slam: Surface, z: ArrayLike, covs: ArrayLike | None = None) -> Rows:
        """Return rows as any association does."""
        if isinstance(slam, ParticleView):
            raise ValueError("slam: expected EKFSlam, got a particle of FastSlam")
        z = as_array("z", z, ("k", 2))
        more = {} if covs is None else {"covs": covs}
        rows = np.array(self.associate(slam, z, **more), dtype=np.intp)
        new = np.flatnonzero(rows == NEW)
        R = np.broadcast_to(slam.sensor.cov if covs is None else covs, (len(z), 2, 2))
        places = self._recognise(slam, z[new], R[new])
        self._seen[places] += 1
        self._unseen_for += 1
        self._unseen_for[places] = 0
        ready = self._seen[places] >= self.sightings
        rows[new[~ready]] = IGNORED
        keep = self._unseen_for <= self.patience
        keep[places[ready]] = False
        self.tentative, self._seen = self.tentative[keep], self._seen[keep]
        self._unseen_for, self._covs = self._unseen_for[keep], self._covs[keep]
        return rows

    def _recognise(self, slam: Surface, z: Array, R: Array) -> Rows:
        """Place on the tentative list of each new measurement; a fresh one if none is near."""
        if len(z) == 0:
            return np.empty(0, dtype=np.intp)
        predicted = slam.sensor.observe(slam.pose, self.tentative)
        v = slam.sensor.residual(z[:, None], predicted[None])
        weight = np.linalg.inv(2 * (R[:, None] + self._covs))
        distance = np.einsum("kni,knij,knj->kn", v, weight, v)
        j, row = np.nonzero(distance < self._gate)
        pairs = _Pairs(len(z), j, row, distance[j, row], np.ones(len(j), dtype=bool))
        places = _best_first(pairs, pairs.distance, 0.0)
        fresh = np.flatnonzero(places < 0)
        places[fresh] = len(self.tentative) + np.arange(len(fresh))
        located = slam.sensor.locate(slam.pose, z[fresh])
        self.tentative = np.concatenate([self.tentative, located])
        self._covs = np.concatenate([self._covs, R[fresh]])
        self._seen = np.append(self._seen, np.zeros(len(fresh), dtype=int))
        self._unseen_for = np.append(self._unseen_for, np.zeros(len(fresh), dtype=int))
        return places


# --- candidates ---


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of a measurement and a landmark that are near enough to be thought about."""

    k: int  # measurements of the look
    j: Rows  # (c,) measurement
    row: Rows  # (c,) landmark
    distance: Array  # (c,) squared Mahalanobis distance, or metres
    inside: NDArray[np.bool_]  # (c,) inside the gate; the others are near it
    v: Array = field(default_factory=lambda: np.empty((0, 2)))  # (c, 2) innovation
    log_det: Array = field(default_factory=lambda: np.empty(0))  # (c,) log det S
    more: Array = field(default_factory=lambda: np.empty((0, 2, 2)))  # (c, 2, 2) R - sensor.cov

    def unpaired(self) -> Rows:
        """Answer (k,) before any pair is made: new if no landmark is near, else left out."""
        answer = np.full(self.k, NEW, dtype=np.intp)
        answer[self.j] = IGNORED
        return answer

    def rivals(self, j: int, row: int, score: Array, margin: float) -> bool:
        """Tell whether another pair wants the same measurement or landmark almost as much."""
        if margin == 0.0:
            return False
        mine = (self.j == j) & (self.row == row)
        others = self.inside & ((self.j == j) ^ (self.row == row))
        return bool((score[others] < score[mine][0] + margin).any())


def _candidates(
    slam: Surface, z: ArrayLike, low: float, high: float, covs: ArrayLike | None = None
) -> _Pairs:
    """All pairs within the gate of probability `high`, found by a tree of predicted landmarks.

    A pair in the gate has |v_i| <= sqrt(gate S_ii), so seen from the sensor its two places are
    apart by no more than the reach in range plus the measured range times that in bearing.
    """
    as_a("slam", slam, Surface)
    z = as_array("z", z, ("k", 2))
    low = as_scalar("probability", low, *_ODDS)
    high = as_scalar("new_probability", high, low, _ODDS[1])
    inner, outer = _gate(low, 2), _gate(high, 2)
    landmarks = np.asarray(slam.landmarks)
    if len(landmarks) == 0 or len(z) == 0:
        empty = np.empty(0, dtype=np.intp)
        return _Pairs(len(z), empty, empty, np.empty(0), np.empty(0, dtype=bool))
    predicted = slam.sensor.observe(slam.pose, landmarks)
    S = slam.innovation_covs(np.arange(len(landmarks)))
    # What the measurements are less certain than the sensor says.
    more = np.zeros((len(z), 2, 2))
    if covs is not None:
        more = as_array("covs", covs, (len(z), 2, 2)) - slam.sensor.cov
    widest = S[:, [0, 1], [0, 1]].max(0) + more[:, [0, 1], [0, 1]].max(0)
    reach = np.sqrt(outer * widest) * (1 + 1e-9)
    radius = reach[0] + np.abs(z[:, 0]) * reach[1]
    tree = cKDTree(_plane(predicted))
    j, row = _flat(tree.query_ball_point(_plane(z), radius, return_sorted=True))
    v, S = slam.sensor.residual(z[j], predicted[row]), S[row] + more[j]
    distance = _squared(v, S)
    near = distance <= outer
    j, row = j[near], row[near]
    v, S, distance = v[near], S[near], distance[near]
    log_det = np.log(np.linalg.det(S))
    return _Pairs(len(z), j, row, distance, distance <= inner, v, log_det, more[j])


@lru_cache(maxsize=256)
def _gate(probability: float, dof: int) -> float:
    """Chi-square quantile; every look asks for the same few."""
    return float(chi2_quantile(probability, dof))


def _plane(polar: Array) -> Array:
    """Points (..., 2) of the sensor's plane; both names of a wall, (r, a), (-r, a + pi), agree."""
    r, angle = polar[..., 0], polar[..., 1]
    return np.stack([r * np.cos(angle), r * np.sin(angle)], -1)


def _flat(lists: Any) -> tuple[Rows, Rows]:
    """Neighbour lists as two arrays: number of the list, and entry."""
    lengths = [len(one) for one in lists]
    entries = np.concatenate([np.asarray(one, dtype=np.intp) for one in lists])
    return np.repeat(np.arange(len(lengths)), lengths), entries


def _best_first(pairs: _Pairs, score: Array, margin: float) -> Rows:
    """Take pairs inside the gate in the order of their score, nothing twice."""
    answer = pairs.unpaired()
    free, taken = np.ones(pairs.k, dtype=bool), set[int]()
    inside = np.flatnonzero(pairs.inside)
    for i in inside[np.argsort(score[inside], kind="stable")]:
        j, row = int(pairs.j[i]), int(pairs.row[i])
        if free[j] and row not in taken:
            free[j] = False
            taken.add(row)
            answer[j] = IGNORED if pairs.rivals(j, row, score, margin) else row
    return answer


def _as_margin(margin: float) -> float:
    return as_scalar("margin", margin, 0.0, 1e300)
