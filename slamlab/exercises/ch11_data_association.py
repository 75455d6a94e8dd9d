"""Checks of chapter 11: the gate, the joint distance, nothing twice, the search for all pairs.

P4 (2a), (2b) with the gate that page 84 lacks; joint compatibility after Neira and Tardos (2001).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, drawn
from slamlab.exercises._report import Array, Check, Function, Ints
from slamlab.gaussian import chi2_quantile
from slamlab.sensors import RangeBearing

__all__ = [
    "check_best_first",
    "check_gate",
    "check_joint",
    "check_nearest",
    "check_stacked",
    "check_together",
]


# Exercise 1: a gate for many pairs, with a pencil.


def _gate_for(share: float, pairs: int) -> float:
    """Gate of the squared distance that all true pairs pass together with probability `share`."""
    return float(-2 * np.log(1 - share ** (1 / pairs)))


def _wanted(rng: np.random.Generator) -> Any:
    return float(np.round(rng.uniform(0.5, 0.999), 3)), int(rng.integers(1, 60))


check_gate = Check(
    _gate_for,
    "gate",
    {
        "one pair": (0.99, 1),
        "eight pairs": (0.99, 8),
        "a coin for each of two": (0.5, 2),
        "any wish": _wanted,
    },
    {
        "the range and the bearing are two numbers: this is the gate of one": (
            lambda share, pairs: float(chi2_quantile(share ** (1 / pairs), 1))
        ),
        "the exponent is -c/2: the 2 is missing": "-2 * np.log => -np.log",
        "this is the gate of one pair: all of them must pass": "share ** (1 / pairs) => share",
        "this is P(D^2 < c) = share to the power n: each pair must pass oftener, not less often": (
            "share ** (1 / pairs) => share**pairs"
        ),
        "misses were added: that they are all avoided is a product": (
            "1 - share ** (1 / pairs) => (1 - share) / pairs"
        ),
        "this is the distance: the gate is for its square": (
            lambda share, pairs: np.sqrt(_gate_for(share, pairs))
        ),
        "this many lie outside, and the rest inside: P(D^2 < c) = 1 - exp(-c/2)": (
            "1 - share ** (1 / pairs) => share ** (1 / pairs)"
        ),
        "this is the probability of one pair: its gate is due": (
            lambda share, pairs: share ** (1 / pairs)
        ),
    },
    tolerance=1e-6,
    draws=12,
)


# Exercise 2: the nearest landmark inside a gate.


def _squared(y: Array, S: Array) -> Any:
    return np.einsum("ni,nij,nj->n", y, np.linalg.inv(S), y)


def _nearest(y: Array, S: Array, gate: float) -> int:
    """Row of the landmark with the smallest y^T S^-1 y, -1 if none is below the gate."""
    distance = np.einsum("ni,nij,nj->n", y, np.linalg.inv(S), y)
    if not len(distance):
        return -1
    row = int(np.argmin(distance))
    return row if distance[row] < gate else -1


def _by(measure: Function) -> Function:
    def wrong(y: Array, S: Array, gate: float) -> int:
        distance = measure(y, S)
        if not len(distance):
            return -1
        return int(np.argmin(distance)) if distance.min() < gate else -1

    return wrong


def _inside(y: Array, S: Array, gate: float) -> Any:
    return np.flatnonzero(_squared(y, S) < gate)


def _by_likelihood(y: Array, S: Array) -> Any:
    return _squared(y, S) + np.log(np.linalg.det(S))


def _scene(rng: np.random.Generator) -> Any:
    n = int(rng.integers(1, 8))
    S = np.array([a_covariance(rng, 2, size) for size in rng.uniform(0.05, 2, n)])
    return np.round(rng.normal(0, 2, (n, 2)), 2), S, 9.21


_ROUND, _WIDE = np.diag([0.04, 0.01]), np.diag([4.0, 1.0])
_SLANTED = np.array([[1.0, 0.95], [0.95, 1.0]])

check_nearest = Check(
    _nearest,
    "row",
    {
        "two landmarks, equally well known": ([[0.3, 0.1], [0.1, 0.05]], [_ROUND] * 2, 9.21),
        "the vague one is nearer in sigmas": ([[0.5, 0.1], [1.0, 0.3]], [_ROUND, _WIDE], 9.21),
        "correlated errors": ([[1.0, -1.0], [1.3, 1.3]], [_SLANTED, _SLANTED], 9.21),
        "a vague one nearer in sigmas, a sharp one likelier": (
            [[2.0, 0.5], [0.3, 0.05]],
            [_WIDE, _ROUND],
            9.21,
        ),
        "nothing inside the gate": ([[5.0, 0.5], [4.0, 0.0]], [_ROUND] * 2, 9.21),
        "exactly on the gate is not inside": ([[2.0, 0.0]], [np.eye(2)], 4.0),
        "four sigmas are outside a gate of 9.21": ([[0.8, 0.0]], [_ROUND], 9.21),
        "no landmarks yet": (np.zeros((0, 2)), np.zeros((0, 2, 2)), 9.21),
        "the nearest of several inside": (
            [[0.2, 0.1], [0.05, 0.0], [0.3, 0.1], [0.1, 0.0]],
            [_ROUND] * 4,
            9.0,
        ),
        "any scene": _scene,
    },
    {
        "the distance is Euclidean: metres and radians know nothing of the covariance": _by(
            lambda y, S: (y**2).sum(1)
        ),
        "S was multiplied, not inverted: a large doubt must make the distance small": (
            "np.linalg.inv(S) => S"
        ),
        "only the diagonal of S was used: range and bearing errors are correlated": _by(
            lambda y, S: (y**2 / np.diagonal(S, axis1=1, axis2=2)).sum(1)
        ),
        "the gate is for the squared distance: no square root": _by(
            lambda y, S: np.sqrt(_squared(y, S))
        ),
        "the gate is that of the squared distance already: its root was taken": (
            "< gate => < np.sqrt(gate)"
        ),
        "this takes the likeliest landmark, with ln det S: the nearest is asked for": _by(
            _by_likelihood
        ),
        "the gate was not used: a landmark out of reach is no match": "< gate => < np.inf",
        "exactly on the gate is not inside": "< gate => <= gate",
        "the first landmark inside the gate is not always the nearest": (
            lambda *given: int(_inside(*given)[0]) if len(_inside(*given)) else -1
        ),
        "the last landmark inside the gate is not always the nearest": (
            lambda *given: int(_inside(*given)[-1]) if len(_inside(*given)) else -1
        ),
        "this is the farthest landmark": "argmin => argmax",
        "this is the number of landmarks inside the gate, not the row of one": (
            lambda *given: len(_inside(*given))
        ),
        "this is the distance: return the row of the landmark": (
            lambda y, S, gate: float(_squared(y, S).min())
        ),
        "rows begin at 0: these are one too large": (
            lambda *given: _nearest(*given) + (_nearest(*given) >= 0)
        ),
    },
    edges=("no landmarks yet",),
)


# Exercise 3: the joint distance.


def _joint_distance(y: Array, S: Array) -> float:
    """Joint squared distance of innovations y (m, 2) with their full covariance S (2m, 2m)."""
    stacked = y.ravel()
    return float(stacked @ np.linalg.solve(S, stacked))


def _singles(y: Array, S: Array) -> Any:
    m = len(y)
    blocks = S.reshape(m, 2, m, 2)[np.arange(m), :, np.arange(m)]
    return _squared(y, blocks)


@drawn
def _pairs(rng: np.random.Generator, m: int) -> Any:
    H = rng.standard_normal((2 * m, 3))
    return np.round(rng.normal(0, 0.7, (m, 2)), 2), np.round(H @ H.T, 3) + np.eye(2 * m)


check_joint = Check(
    _joint_distance,
    "distance",
    {
        "a single pair": _pairs(1),
        "two pairs that share the robot's error": _pairs(2),
        "three pairs": _pairs(3),
        "five pairs": _pairs(5),
        "two independent pairs": ([[0.3, 0.1], [0.1, -0.2]], np.diag([0.4, 0.1, 0.4, 0.1])),
        "no innovation": (np.zeros((2, 2)), np.eye(4)),
    },
    {
        "the sum of the single distances: the blocks off the diagonal were not used": (
            lambda y, S: float(_singles(y, S).sum())
        ),
        "the largest single distance says nothing about how the pairs fit together": (
            lambda y, S: float(_singles(y, S).max())
        ),
        "S was multiplied, not inverted": "np.linalg.solve(S, stacked) => S @ stacked",
        "S is missing: its inverse weighs the innovations": (
            "np.linalg.solve(S, stacked) => stacked"
        ),
        "this is the square root of the distance": lambda y, S: np.sqrt(_joint_distance(y, S)),
        "half the distance: that is the exponent of the likelihood": (
            lambda y, S: _joint_distance(y, S) / 2
        ),
        "divided by the number of pairs: the gate of 2m degrees takes care of that": (
            lambda y, S: _joint_distance(y, S) / len(y)
        ),
        "divided by the degrees of freedom: the gate of 2m degrees takes care of that": (
            lambda y, S: _joint_distance(y, S) / y.size
        ),
        "stacked in the wrong order: first pair's range and bearing, then the second pair's": (
            "y.ravel() => y.T.ravel()"
        ),
        "only the diagonal of S was used": (
            lambda y, S: float(np.sum(y.ravel() ** 2 / S.diagonal()))
        ),
        "this is the negative log likelihood, with ln det S: the distance is asked for": (
            lambda y, S: _joint_distance(y, S) + np.log(np.linalg.det(S))
        ),
    },
    tolerance=1e-8,
)


# Exercise 4: nothing twice.


def _best_first(distance: Array, gate: float) -> Ints:
    """Rows (k,) for distances (k, n): the best pair first, no landmark twice, -1 for none."""
    left = np.where(distance < gate, distance, np.inf)
    rows = np.full(len(left), -1)
    while np.isfinite(left).any():
        j, row = np.unravel_index(np.argmin(left), left.shape)
        rows[j] = row
        left[j, :] = np.inf
        left[:, row] = np.inf
    return rows


def _each_its_nearest(distance: Array, gate: float) -> Any:
    if not distance.size:
        return np.full(len(distance), -1)
    return np.where(distance.min(1) < gate, distance.argmin(1), -1)


def _both_dropped(distance: Array, gate: float) -> Any:
    rows = _each_its_nearest(distance, gate)
    return np.array([r if r >= 0 and (rows == r).sum() == 1 else -1 for r in rows], dtype=int)


def _hungarian(distance: Array, gate: float) -> Any:
    from scipy.optimize import linear_sum_assignment

    rows = np.full(len(distance), -1)
    inside = distance < gate
    for j, row in zip(*linear_sum_assignment(np.where(inside, distance, 1e6)), strict=True):
        if inside[j, row]:
            rows[j] = row
    return rows


def _table(rng: np.random.Generator) -> Any:
    k, n = rng.integers(1, 7, 2)
    return np.round(rng.uniform(0.1, 14, (k, n)), 2), 9.0


check_best_first = Check(
    _best_first,
    "rows",
    {
        "no rivals": ([[1.0, 8.0, 20.0], [15.0, 2.0, 30.0]], 9.0),
        "two want one landmark": ([[3.0, 30.0], [1.0, 40.0]], 9.0),
        "the loser takes its second choice": ([[2.0, 5.0, 50.0], [1.0, 60.0, 70.0]], 9.0),
        "outside the gate is outside": ([[12.0, 30.0], [1.0, 40.0]], 9.0),
        "exactly on the gate is outside": ([[9.0, 30.0], [40.0, 1.0]], 9.0),
        "a chain": ([[2.0, 3.0, 60.0], [1.0, 4.0, 8.0], [50, 0.5, 7.0]], 9.0),
        "the smallest sum is another pairing": ([[1.0, 2.0], [2.0, 8.0]], 9.0),
        "no landmarks yet": (np.zeros((3, 0)), 9.0),
        "no measurements": (np.zeros((0, 3)), 9.0),
        "any table": _table,
    },
    {
        "a landmark was given to two measurements": _each_its_nearest,
        "the measurements chose in the order of the list: the best pair of all goes first": (
            "np.unravel_index(np.argmin(left), left.shape)"
            " => (j := np.isfinite(left).any(1).argmax()), left[j].argmin()"
        ),
        "a measurement that lost its nearest landmark may still take another inside the gate": (
            "left[:, row] = np.inf => left[left.argmin(1) == row] = np.inf"
        ),
        "both rivals were dropped: the nearer one keeps the landmark": _both_dropped,
        "the gate was not used": "distance < gate => distance < np.inf",
        "exactly on the gate is not inside": "distance < gate => distance <= gate",
        "this is the assignment of the smallest sum: the best pair of all goes first": _hungarian,
        "these are the measurements of the landmarks: the landmarks of the measurements are due": (
            lambda distance, gate: _best_first(distance.T, gate)
        ),
        "the distances came: the landmarks of the measurements are due": (
            lambda distance, gate: distance.min(1)
        ),
        "one pair only came: go on until nothing is inside the gate": (
            "left[j, :] = np.inf => left[:] = np.inf"
        ),
    },
    draws=12,
    edges=("no landmarks yet", "no measurements"),
)


# Exercise 5: a bug to find.


def _stacked_cov(H: Array, P: Array, R: Array) -> Array:
    """Covariance (2m, 2m) of m innovations with Jacobians H (m, 2, d), state P, sensor noise R."""
    A = H.reshape(-1, H.shape[2])
    S: Array = A @ P @ A.T + np.kron(np.eye(len(H)), R)
    return S


@drawn
def _slopes(rng: np.random.Generator, m: int) -> Any:
    d = int(rng.integers(3, 8))
    return np.round(rng.normal(0, 1, (m, 2, d)), 2), a_covariance(rng, d), a_covariance(rng, 2)


check_stacked = Check(
    _stacked_cov,
    "S",
    {
        "a single pair": _slopes(1),
        "two pairs": _slopes(2),
        "two pairs, the state known": lambda rng: (
            (given := _slopes(2)(rng))[0],
            0 * given[1],
            given[2],
        ),
        "two pairs, a perfect sensor": lambda rng: (*_slopes(2)(rng)[:2], np.zeros((2, 2))),
        "five pairs": _slopes(5),
    },
    {
        "R stands in every block: each measurement has a noise of its own": (
            "np.kron(np.eye(len(H)), R) => np.tile(R, (len(H), len(H)))"
        ),
        "the blocks off the diagonal are empty: all pairs share the error of the state": (
            lambda H, P, R: np.kron(np.eye(len(H)), np.ones((2, 2))) * _stacked_cov(H, P, R)
        ),
        "R is missing: the sensor has noise too": " + np.kron(np.eye(len(H)), R) => ",
        "R stands in the first block only: every measurement has noise": (
            "np.eye(len(H)) => np.diag([1.0] + [0.0] * (len(H) - 1))"
        ),
        "only the diagonal of R was used: range and bearing may err together": (
            "np.kron(np.eye(len(H)), R) => np.kron(np.eye(len(H)), np.diag(np.diag(R)))"
        ),
        "P is missing: the innovations share the doubt of the state, A P A^T": (
            "A @ P @ A.T => A @ A.T"
        ),
        "R counts twice": ", R) => , 2 * R)",
        "R is spread the wrong way: the order is first range, first bearing, second range": (
            "np.kron(np.eye(len(H)), R) => np.kron(R, np.eye(len(H)))"
        ),
        "stacked in the wrong order: first pair's range and bearing, then the second pair's": (
            "H.reshape(-1, H.shape[2]) => H.transpose(1, 0, 2).reshape(-1, H.shape[2])",
            "np.kron(np.eye(len(H)), R) => np.kron(R, np.eye(len(H)))",
        ),
    },
)


# Exercise 6: assembled, back in the orchard.


def _together(y: Array, H: Array, P: Array, R: Array, gates: Array) -> Ints:
    """Landmark (k,) of each measurement: the largest set of pairs that fit together, -1 for none.

    y (k, n, 2) are the innovations of every measurement with every landmark, H (n, 2, d) their
    Jacobians, gates (k,) those of 1 to k pairs. Of equally large sets the nearest.
    """
    k, n = y.shape[:2]
    S = _stacked_cov(H, P, R).reshape(n, 2, n, 2)  # of all landmarks; a set takes its blocks
    best: list[Any] = [0, 0.0, []]

    def search(j: int, pairs: list[tuple[int, int]], distance: float) -> None:
        if len(pairs) + k - j < best[0]:
            return
        if j == k:
            if (len(pairs), -distance) > (best[0], -best[1]):
                best[:] = [len(pairs), distance, pairs]
            return
        for i in range(n):
            if i not in [row for _, row in pairs]:
                more = [*pairs, (j, i)]
                js, rows = map(list, zip(*more, strict=True))
                part = S[rows][:, :, rows].reshape(2 * len(rows), -1)
                longer = _joint_distance(y[js, rows], part)
                if longer < gates[len(more) - 1]:
                    search(j + 1, more, longer)
        search(j + 1, pairs, distance)

    search(0, [], 0.0)
    answer = np.full(k, -1)
    for j, i in best[2]:
        answer[j] = i
    return answer


def _by_singles(measure: Function) -> Function:
    """Return an association that pairs by single distances alone."""

    def wrong(y: Array, H: Array, P: Array, R: Array, gates: Array) -> Any:
        S = H @ P @ H.transpose(0, 2, 1) + R
        distance = np.array([_squared(one, S) for one in y]).reshape(y.shape[:2])
        return measure(distance, gates[0] if len(gates) else 0.0)

    return wrong


def _greedy(y: Array, H: Array, P: Array, R: Array, gates: Array) -> Any:
    """Take the best pair that still fits those taken, and never give one back."""
    S = H @ P @ H.transpose(0, 2, 1) + R
    distance = np.array([_squared(one, S) for one in y]).reshape(y.shape[:2])
    pairs: list[tuple[int, int]] = []
    for flat in np.argsort(distance, axis=None).tolist():
        j, i = divmod(flat, y.shape[1])
        if j in [a for a, _ in pairs] or i in [b for _, b in pairs]:
            continue
        more = [*pairs, (j, i)]
        js, rows = map(list, zip(*more, strict=True))
        if _joint_distance(y[js, rows], _stacked_cov(H[rows], P, R)) < gates[len(pairs)]:
            pairs = more
    answer = np.full(len(y), -1)
    for j, i in pairs:
        answer[j] = i
    return answer


@drawn
def _back(
    rng: np.random.Generator,
    trees: int,
    seen: int,
    strangers: int = 0,
    echo: int = 0,
    mixed: bool = True,
) -> Any:
    """Draw what a robot sees that has lost its place by half a metre and five degrees."""
    sensor = RangeBearing(0.05, np.radians(0.5))
    believed = np.zeros(3)
    truth = rng.normal(0, 1, 3) * [0.5, 0.5, 0.08]
    orchard = rng.uniform([2.0, -2.5], [6.0, 2.5], (trees, 2))
    P = np.diag([0.25, 0.25, 0.0064, *[0.0004] * (2 * trees)])
    in_map = orchard + rng.normal(0, 0.02, (trees, 2))
    which = rng.permutation(trees)[:seen] if mixed else np.arange(seen)
    which = np.append(which, which[:echo])
    z = sensor.observe(truth, orchard[which]) + rng.normal(0, 1, (len(which), 2)) * [
        0.05,
        0.0087,
    ]
    z = np.vstack([z, rng.uniform([2.0, -0.5], [6.0, 0.5], (strangers, 2))])
    y = sensor.residual(z[:, None], sensor.observe(believed, in_map)[None])
    H_pose, H_landmark = sensor.jacobians(believed, in_map)
    H = np.zeros((trees, 2, 3 + 2 * trees))
    H[:, :, :3] = H_pose
    for i in range(trees):
        H[i, :, 3 + 2 * i : 5 + 2 * i] = H_landmark[i]
    gates = chi2_quantile(0.99, 2 * np.arange(1, len(z) + 1))
    return np.round(y, 3), np.round(H, 3), P, sensor.cov, gates


def _often(n: int) -> Any:
    """Stack n looks back into the orchard; measurement j is of tree j."""
    rng = np.random.default_rng(3)
    observations = [_back(6, 4, mixed=False)(rng) for _ in range(n)]
    y, H = (np.array([look[k] for look in observations]) for k in (0, 1))
    return y, H, *observations[0][2:]


def _paired(associate: Function, y: Array, H: Array, P: Array, R: Array, gates: Array) -> Any:
    """Pair one look, or judge the pairs of many looks."""
    if y.ndim == 3:
        return associate(y, H, P, R, gates)
    rows = [associate(one, slopes, P, R, gates) for one, slopes in zip(y, H, strict=True)]
    share = np.mean(np.array(rows).reshape(len(y), -1) == np.arange(y.shape[1]))
    return "" if share >= 0.95 else f"{share:.0%} of the trees are named rightly, 95 % are due"


check_together = Check(
    _together,
    "rows",
    {
        "one measurement, one tree": _back(1, 1),
        "two trees": _back(2, 2),
        "three of four trees": _back(4, 3),
        "a look with a measurement of nothing": _back(4, 3, strangers=1),
        "more measurements than trees": _back(2, 2, strangers=2),
        "a tree that was measured twice": _back(3, 2, echo=1),
        "a pair that only the gate of two would let pass": (
            [[[3.2, 0.0]], [[9.0, 9.0]]],
            np.zeros((1, 2, 3)),
            np.eye(3),
            np.eye(2),
            [9.21, 13.28],
        ),
        "exactly on the gate is not inside": (
            [[[2.0, 0.0]]],
            np.zeros((1, 2, 3)),
            np.eye(3),
            np.eye(2),
            [4.0],
        ),
        "nothing was measured": lambda rng: (*_back(3, 0)(rng)[:4], np.zeros(0)),
        "no trees in the map": (
            np.zeros((2, 0, 2)),
            np.zeros((0, 2, 3)),
            np.eye(3),
            np.eye(2),
            [9.21, 13.28],
        ),
        "thirty returns to the orchard": _often(30),
    },
    {
        "each tree was paired by itself: pairs that fit one by one need not fit together": (
            _by_singles(_best_first)
        ),
        "each took its nearest tree: pairs that fit one by one need not fit together": (
            _by_singles(_each_its_nearest)
        ),
        "the best pair was taken first and never given back: try other sets too": _greedy,
        "the pairs were only tried one by one: the whole set must be inside its gate": (
            "longer < gates[len(more) - 1]"
            " => _joint_distance(y[[j], [i]], _stacked_cov(H[[i]], P, R)) < gates[0]"
        ),
        "the gate of a single pair was used for all: m pairs have the gate number m": (
            "gates[len(more) - 1] => gates[0]"
        ),
        "the gate of all measurements was used for every set: m pairs have the gate number m": (
            "gates[len(more) - 1] => gates[-1]"
        ),
        "no gate was used": "if longer < gates[len(more) - 1]: => if True:",
        "a tree was given to two measurements": (
            "if i not in [row for _, row in pairs]: => if True:",
            "S[rows][:, :, rows].reshape(2 * len(rows), -1) => _stacked_cov(H[rows], P, R)",
        ),
        "a measurement may also be of no tree: try that as well": (
            "        search(j + 1, pairs, distance) =>         pass"
        ),
        "the first of the largest sets came: of equally large ones the nearest is due": (
            "(len(pairs), -distance) > (best[0], -best[1]) => len(pairs) > best[0]"
        ),
        "the farthest of the largest sets came": (
            "(len(pairs), -distance) > (best[0], -best[1])"
            " => (len(pairs), distance) > (best[0], best[1])"
        ),
        "nothing was paired: the largest set is due": (
            lambda y, H, P, R, gates: np.full(len(y), -1)
        ),
    },
    use=_paired,
    edges=("nothing was measured", "no trees in the map"),
)
