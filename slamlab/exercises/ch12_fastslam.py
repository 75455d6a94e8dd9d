"""Checks of chapter 12: the weight of a landmark, the proposal of 2.0, copies, ancestors.

P2 (15) is the weight, (18) the proposal; copies and ancestors are its step 3.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Report, run_cases

__all__ = [
    "MISTAKES_ANCESTORS",
    "MISTAKES_COPIES",
    "MISTAKES_PROPOSAL",
    "MISTAKES_WEIGHT",
    "check_ancestors",
    "check_copies",
    "check_proposal",
    "check_weight",
    "copy_particles",
    "distinct_ancestors",
    "log_weight",
    "proposal",
]

Function = Callable[..., Any]


# Exercise 1: the weight of a landmark.


def log_weight(y: Array, H: Array, S: Array, R: Array) -> Any:
    """Logarithm of (15): innovation y (2,), landmark covariance S, Jacobian H, sensor noise R."""
    return _log_normal(y, H @ S @ H.T + R)


def _log_normal(y: Array, Z: Array) -> Any:
    quadratic = y @ np.linalg.solve(Z, y)
    return -0.5 * quadratic - 0.5 * np.log(np.linalg.det(Z)) - np.log(2 * np.pi)


MISTAKES_WEIGHT: dict[str, Function] = {
    "R alone: the landmark is uncertain too, add H S H^T": (
        lambda y, H, S, R: _log_normal(y, np.asarray(R))
    ),
    "S and R live in different spaces: turn S by H before they are added": (
        lambda y, H, S, R: _log_normal(y, S + R)
    ),
    "this is H^T S H: the Jacobian stands the other way round": (
        lambda y, H, S, R: _log_normal(y, H.T @ S @ H + R)
    ),
    "R is missing: the sensor has noise too": lambda y, H, S, R: _log_normal(y, H @ S @ H.T),
    "the determinant is missing: it tells an uncertain landmark from a certain one": (
        lambda y, H, S, R: -0.5 * y @ np.linalg.solve(H @ S @ H.T + R, y) - np.log(2 * np.pi)
    ),
    "this is the density: its logarithm is due": lambda y, H, S, R: np.exp(log_weight(y, H, S, R)),
    "one half is missing in front of the quadratic form": (
        lambda y, H, S, R: log_weight(y, H, S, R) - 0.5 * y @ np.linalg.solve(H @ S @ H.T + R, y)
    ),
    "the sign is turned: a large innovation makes a small weight": (
        lambda y, H, S, R: -log_weight(y, H, S, R)
    ),
}


def check_weight(student: Function) -> Report:
    """Check ``student(y (2,), H (2, 2), S (2, 2), R (2, 2)) -> log weight``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    turned, R = [[0.6, 0.8], [-0.4, 0.3]], [[0.02, 0.0], [0.0, 0.01]]
    S = [[0.3, 0.1], [0.1, 0.2]]
    cases = [
        ("a tree seen from the side", [0.2, -0.1], turned, S, R),
        ("a surprise", [1.5, 0.9], turned, S, R),
        ("a tree that is almost known", [0.2, -0.1], turned, np.array(S) / 100, R),
        ("correlated noise of the sensor", [0.1, 0.3], turned, S, [[0.05, 0.02], [0.02, 0.04]]),
        ("no innovation at all", [0.0, 0.0], turned, S, R),
    ]
    return run_cases("log_weight", student, log_weight, cases, MISTAKES_WEIGHT)


# Exercise 2: look before you draw.


def proposal(x: Array, Q: Array, H: Array, Z: Array, y: Array) -> tuple[Any, Any]:
    """Mean and covariance of (18): predicted pose x (3,), its noise Q, innovation y with cov Z."""
    P = np.linalg.inv(np.linalg.inv(Q) + H.T @ np.linalg.inv(Z) @ H)
    return x + P @ H.T @ np.linalg.solve(Z, y), P


def _product(
    x: Array, Q: Array, H: Array, Z: Array, y: Array, pull: float = 1.0
) -> tuple[Any, Any]:
    mean, P = proposal(x, Q, H, Z, y)
    return x + pull * (mean - x), P


def _information(x: Array, Q: Array, H: Array, Z: Array, y: Array) -> tuple[Any, Any]:
    mean, P = proposal(x, Q, H, Z, y)
    return mean, np.linalg.inv(P)


def _prior_gain(x: Array, Q: Array, H: Array, Z: Array, y: Array) -> tuple[Any, Any]:
    _, P = proposal(x, Q, H, Z, y)
    return x + Q @ H.T @ np.linalg.solve(Z, y), P


def _not_inverted(x: Array, Q: Array, H: Array, Z: Array, y: Array) -> tuple[Any, Any]:
    P = np.linalg.inv(np.linalg.inv(Q) + H.T @ Z @ H)
    return x + P @ H.T @ Z @ y, P


def _likelihood_only(x: Array, Q: Array, H: Array, Z: Array, y: Array) -> tuple[Any, Any]:
    P = np.linalg.pinv(H.T @ np.linalg.inv(Z) @ H)
    return x + P @ H.T @ np.linalg.solve(Z, y), P


MISTAKES_PROPOSAL: dict[str, Function] = {
    "this is the motion model, version 1.0: the measurement was not used": (
        lambda x, Q, H, Z, y: (np.array(x), np.array(Q))
    ),
    "the covariance shrinks, but the mean must move too": (
        lambda x, Q, H, Z, y: _product(x, Q, H, Z, y, 0.0)
    ),
    "the mean moves the wrong way: y is the measurement minus its prediction": (
        lambda x, Q, H, Z, y: _product(x, Q, H, Z, y, -1.0)
    ),
    "this is the information matrix: invert it": _information,
    "the pull uses Q: it must be the new covariance P": _prior_gain,
    "Z must be inverted: a noisy measurement pulls less": _not_inverted,
    "Q was left out: odometry and measurement speak together": _likelihood_only,
    "the step alone came: add it to x": (
        lambda x, Q, H, Z, y: (proposal(x, Q, H, Z, y)[0] - x, proposal(x, Q, H, Z, y)[1])
    ),
}


def check_proposal(student: Function) -> Report:
    """Check ``student(x (3,), Q (3, 3), H (2, 3), Z (2, 2), y (2,)) -> mean, covariance``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    x = [1.0, 2.0, 0.3]
    Q = [[0.04, 0.01, 0.0], [0.01, 0.02, 0.005], [0.0, 0.005, 0.01]]
    H = [[-0.8, -0.6, 0.1], [0.3, -0.4, -1.0]]
    Z = np.diag([0.01, 0.004])
    cases = [
        ("measurement and odometry disagree a little", x, Q, H, Z, [0.1, -0.05]),
        ("no innovation: only the covariance shrinks", x, Q, H, Z, [0.0, 0.0]),
        ("a dull sensor changes little", x, Q, H, 100 * Z, [0.1, -0.05]),
        ("a correlated innovation", x, Q, H, [[0.02, 0.01], [0.01, 0.03]], [0.2, 0.1]),
    ]
    return run_cases("proposal", student, proposal, cases, MISTAKES_PROPOSAL)


# Exercise 3: copies that stay apart.


def copy_particles(maps: Any, chosen: Any) -> list[Array]:
    """Return maps of which entry i is a copy of ``maps[chosen[i]]`` that may change alone."""
    return [np.array(maps[int(i)]) for i in chosen]


def _written(copy: Function) -> Function:
    """Copy, then let every particle write its number into its first landmark."""

    def run(maps: Array, chosen: Array) -> Any:
        kept = [np.array(one) for one in maps]
        new = copy(kept, np.asarray(chosen).astype(int))
        if new is None or new is Ellipsis:
            return None
        after = list(new)
        for number, one in enumerate(after):
            one[0] = number
        return np.array(after), np.array(kept)

    return run


def _shared(maps: Any, chosen: Any) -> list[Array]:
    """Copy each chosen particle once only."""
    fresh = {int(i): np.array(maps[int(i)]) for i in chosen}
    return [fresh[int(i)] for i in chosen]


def _counts(maps: Any, chosen: Any) -> list[Array]:
    new = [np.array(m) for m, n in zip(maps, chosen, strict=True) for _ in range(int(n))]
    return (new + [np.array(m) for m in maps])[: len(chosen)]


MISTAKES_COPIES: dict[str, Function] = {
    "nothing was copied: these are the old arrays, and copies of one particle are one array": (
        lambda maps, chosen: [maps[int(i)] for i in chosen]
    ),
    "copies of the same particle share one array: each needs its own": _shared,
    "the particles are still the old ones: take those that were chosen": (
        lambda maps, chosen: [np.array(m) for m in maps]
    ),
    "`chosen` holds indices, not numbers of copies": _counts,
    "each chosen particle came once: one chosen twice must come twice": (
        lambda maps, chosen: [np.array(maps[i]) for i in sorted(set(np.asarray(chosen).tolist()))]
    ),
    "the order is lost: copy number i comes from particle chosen[i]": (
        lambda maps, chosen: copy_particles(maps, list(chosen)[::-1])
    ),
}


def check_copies(student: Function) -> Report:
    """Check ``student(maps, chosen (M,)) -> list of M maps``, each array (n, 2) its own.

    After the call every particle writes its number into its first landmark; what the maps hold
    then, the new ones and the old, is compared.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    maps = 10.0 * np.arange(1, 5)[:, None, None] + np.arange(4).reshape(2, 2)
    cases = [
        ("one particle survives twice, one dies", maps, [0, 1, 1, 3]),
        ("one particle survives alone", maps, [2, 2, 2, 2]),
        ("everybody survives, in another order", maps, [3, 0, 1, 2]),
    ]
    mistakes = {message: _written(wrong) for message, wrong in MISTAKES_COPIES.items()}
    return run_cases("copies", _written(student), _written(copy_particles), cases, mistakes)


# Exercise 4: how many ancestors live on?


def distinct_ancestors(parents: Array) -> Array:
    """Particles (T,) of each step with a descendant at the end; parents (T, M) as indices.

    ``parents[t, i]`` is the row, before resampling t, of what is row i after it.
    """
    rows = np.arange(np.shape(parents)[1])
    counts = []
    for one in np.asarray(parents, dtype=int)[::-1]:
        rows = one[rows]
        counts.append(len(np.unique(rows)))
    return np.array(counts[::-1])


def _forward(parents: Array) -> Array:
    rows, counts = np.arange(np.shape(parents)[1]), []
    for one in np.asarray(parents, dtype=int):
        rows = rows[one]
        counts.append(len(np.unique(rows)))
    return np.array(counts)


def _wrong_way_round(parents: Array) -> Array:
    rows, counts = np.arange(np.shape(parents)[1]), []
    for one in np.asarray(parents, dtype=int)[::-1]:
        rows = rows[one]
        counts.append(len(np.unique(rows)))
    return np.array(counts[::-1])


def _one_step_late(parents: Array) -> Array:
    return np.append(distinct_ancestors(parents)[1:], np.shape(parents)[1])


MISTAKES_ANCESTORS: dict[str, Function] = {
    "each resampling was counted alone: follow the lines through all later ones": (
        lambda parents: np.array([len(np.unique(one)) for one in parents])
    ),
    "this counts living lines of the first step: walk back from the end": _forward,
    "composed the wrong way round: the parent of row i is parents[t][i]": _wrong_way_round,
    "off by one step: resampling t is counted before it is followed": _one_step_late,
    "the steps came in reverse order": lambda parents: distinct_ancestors(parents)[::-1],
    "these are shares: the numbers themselves are due": (
        lambda parents: distinct_ancestors(parents) / np.shape(parents)[1]
    ),
}


def check_ancestors(student: Function) -> Report:
    """Check ``student(parents (T, M)) -> counts (T,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    rng = np.random.default_rng(12)
    many = np.sort(rng.integers(0, 30, (8, 30)), axis=1)
    cases = [
        ("nobody ever dies", np.tile(np.arange(4), (3, 1))),
        ("two steps", [[0, 0, 1, 3], [1, 2, 2, 3]]),
        ("one particle takes all in the middle", [[0, 1, 2, 3], [2, 2, 2, 2], [0, 1, 1, 3]]),
        ("thirty particles, eight steps", many),
    ]

    def with_indices(function: Function) -> Function:
        return lambda parents: function(np.asarray(parents).astype(int))

    mistakes = {message: with_indices(wrong) for message, wrong in MISTAKES_ANCESTORS.items()}
    return run_cases("ancestors", with_indices(student), distinct_ancestors, cases, mistakes)
