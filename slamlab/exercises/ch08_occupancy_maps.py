"""Checks of chapter 08: hints fused as odds, the evidence of one beam, the entropy of a map.

P5, chapter 3.2.4, draws dots only; the rest is Moravec and Elfes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Mistake, Property, Report, run_cases, run_checks

__all__ = [
    "MISTAKES_BEAM_EVIDENCE",
    "MISTAKES_FUSE",
    "MISTAKES_MAP_ENTROPY",
    "beam_evidence",
    "check_beam_evidence",
    "check_fuse",
    "check_map_entropy",
    "fuse",
    "map_entropy",
]

Function = Callable[..., Any]


# Exercise 1: hints about one cell.


def _log_odds(p: Any) -> Array:
    p = np.asarray(p, dtype=float)
    return np.log(p / (1 - p))


def _probability(log_odds: Any) -> Any:
    return 1 / (1 + np.exp(-np.asarray(log_odds, dtype=float)))


def fuse(prior: float, hints: Array) -> Any:
    """Probability that a cell is occupied, from its prior and hints p(m | z), shape (k,)."""
    start = _log_odds(prior)
    return _probability(start + np.sum(_log_odds(hints) - start))


def _product(prior: float, hints: Array) -> Any:
    return prior * np.prod(hints)


def _mean(prior: float, hints: Array) -> Any:
    return np.mean([prior, *hints])


def _last(prior: float, hints: Array) -> Any:
    return hints[-1] if len(hints) else prior


MISTAKES_FUSE: dict[str, Function] = {
    "the prior is in every hint: take it out of each, or it counts again and again": (
        lambda p, h: _probability(_log_odds(p) + np.sum(_log_odds(h)))
    ),
    "the prior itself is missing: without any hint it is the answer": (
        lambda p, h: _probability(np.sum(_log_odds(h) - _log_odds(p)))
    ),
    "the hints were averaged: agreeing hints must make the map surer than each of them": _mean,
    "probabilities were multiplied: odds multiply": _product,
    "only the last hint counts here: the earlier ones are evidence too": _last,
    "these are log odds: return the probability": (
        lambda p, h: _log_odds(p) + np.sum(_log_odds(h) - _log_odds(p))
    ),
    "these are odds: return the probability": (
        lambda p, h: np.exp(_log_odds(p) + np.sum(_log_odds(h) - _log_odds(p)))
    ),
}


def check_fuse(student: Function) -> Report:
    """Check ``student(prior, hints (k,)) -> probability``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("without hints the prior stays", 0.2, []),
        ("two hits make the map surer than one", 0.5, [0.7, 0.7]),
        ("hit and miss, with a prior of one half", 0.5, [0.7, 0.4, 0.4]),
        ("a cell that is probably free", 0.2, [0.6, 0.6, 0.1]),
        ("hints that say nothing new change nothing", 0.3, [0.3, 0.3, 0.3, 0.3]),
    ]
    return run_cases("fuse", student, fuse, cases, MISTAKES_FUSE)


# Exercise 2: the evidence of one beam.


def beam_evidence(
    n_cells: int, distance: float, max_range: float, hit: float, miss: float
) -> Array:
    """Log odds (n_cells,) that one beam adds to cells of 1 m from its start on."""
    evidence = np.zeros(n_cells)
    if np.isnan(distance):
        return evidence
    if distance >= max_range:
        evidence[: int(max_range)] = miss
        return evidence
    end = int(distance)
    evidence[:end] = miss
    evidence[end : end + 1] = hit
    return evidence


def _all_free(n: int, distance: float, max_range: float, hit: float, miss: float) -> Array:
    evidence = beam_evidence(n, distance, max_range, hit, miss)
    if distance < max_range:
        evidence[int(distance) + 1 :] = miss
    return evidence


def _dots_only(n: int, distance: float, max_range: float, hit: float, miss: float) -> Array:
    return beam_evidence(n, distance, max_range, hit, 0.0)


def _end_freed_too(n: int, distance: float, max_range: float, hit: float, miss: float) -> Array:
    evidence = beam_evidence(n, distance, max_range, hit, miss)
    return np.where(evidence == hit, hit + miss, evidence)


def _silent(n: int, distance: float, max_range: float, hit: float, miss: float) -> Array:
    kept = distance if distance < max_range else np.nan
    return beam_evidence(n, kept, max_range, hit, miss)


def _wall_at_the_end(n: int, distance: float, max_range: float, hit: float, miss: float) -> Array:
    kept = distance if not distance >= max_range else max_range
    return beam_evidence(n, kept, np.inf, hit, miss)


def _lost_frees(n: int, distance: float, max_range: float, hit: float, miss: float) -> Array:
    kept = np.inf if np.isnan(distance) else distance
    return beam_evidence(n, kept, max_range, hit, miss)


def _late(n: int, distance: float, max_range: float, hit: float, miss: float) -> Array:
    kept = distance + 1 if distance < max_range else distance
    return beam_evidence(n, kept, max_range + 1 if distance < max_range else max_range, hit, miss)


MISTAKES_BEAM_EVIDENCE: dict[str, Function] = {
    "nobody saw what lies behind the wall: no evidence there": _all_free,
    "this is P5's dot: the beam also says that the cells before its end are free": _dots_only,
    "the cell where the beam ended is not free as well: it gets the hit alone": _end_freed_too,
    "a beam that met nothing frees its way up to max_range": _silent,
    "a beam that met nothing hit nothing: there is no wall at max_range": _wall_at_the_end,
    "NaN is a lost reading: it says nothing, not even that the way is free": _lost_frees,
    "one cell too far: a beam of 2.5 m ends in cell number 2": _late,
    "hit and miss are exchanged": (lambda n, d, m, hit, miss: beam_evidence(n, d, m, miss, hit)),
}


def check_beam_evidence(student: Function) -> Report:
    """Check ``student(n_cells, distance, max_range, hit, miss) -> evidence (n_cells,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("a wall in the middle", 6, 2.5, 5.0),
        ("a wall in the first cell", 4, 0.3, 5.0),
        ("a wall beyond the last cell", 3, 4.6, 8.0),
        ("a beam that met nothing", 6, np.inf, 4.0),
        ("a reading beyond max_range", 6, 5.7, 3.0),
        ("a lost reading", 5, np.nan, 4.0),
    ]
    properties = [
        Property(name, args := (n, d, m, 0.85, -0.41), beam_evidence(*args))
        for name, n, d, m in cases
    ]
    mistakes = [Mistake(*pair) for pair in MISTAKES_BEAM_EVIDENCE.items()]
    return run_checks("beam_evidence", student, properties, mistakes)


# Exercise 3: what a map does not know.


def map_entropy(log_odds: Array) -> Any:
    """Entropy (bits) of all cells together, from log odds of any shape; never NaN."""
    size = np.abs(np.asarray(log_odds, dtype=float))
    # With q = p of the less likely state: -q ln q - (1 - q) ln(1 - q).
    unlikely = np.exp(-size) / (1 + np.exp(-size))
    return np.sum(np.log1p(np.exp(-size)) + size * unlikely) / np.log(2)


def _naive_entropy(log_odds: Array) -> Any:
    with np.errstate(all="ignore"):
        p = _probability(log_odds)
        return np.sum(-p * np.log2(p) - (1 - p) * np.log2(1 - p))


def _half(log_odds: Array) -> Any:
    p = np.clip(_probability(np.clip(log_odds, -500, 500)), 1e-300, 1)
    return np.sum(-p * np.log2(p))


def _as_if_probabilities(log_odds: Array) -> Any:
    p = np.clip(np.abs(log_odds), 1e-300, 1 - 1e-16)
    return np.sum(-p * np.log2(p) - (1 - p) * np.log2(1 - p))


MISTAKES_MAP_ENTROPY: dict[str, Function] = {
    "0 log 0 is 0, not NaN: think of a cell that is certain": _naive_entropy,
    "these are nats: divide by ln 2 for bits": lambda log: map_entropy(log) * np.log(2),
    "this is the mean of the cells: their sum is due": lambda log: map_entropy(log) / np.size(log),
    "half is missing: free is a state too, -(1 - p) log(1 - p)": _half,
    "the sign: entropy is not negative": lambda log: -map_entropy(log),
    "these were taken for probabilities: turn log odds into p first": _as_if_probabilities,
    "this counts the unknown cells: a cell that is half known has some entropy left": (
        lambda log: float(np.sum(np.asarray(log) == 0))
    ),
}


def check_map_entropy(student: Function) -> Report:
    """Check ``student(log_odds) -> bits``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("an unknown map holds one bit a cell", np.zeros((3, 4))),
        ("free and occupied count alike", [[0.85, -0.85]]),
        ("some cells known, some not", [[0.0, 1.5, -3.0], [0.4, 0.0, 3.5]]),
        ("cells that are certain hold nothing", [[800.0, -800.0, 0.0]]),
    ]
    return run_cases("map_entropy", student, map_entropy, cases, MISTAKES_MAP_ENTROPY)
