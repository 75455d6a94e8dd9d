"""Checks of chapter 19: circular autocorrelation, turn between two scans, the second-best place.

The autocorrelation is P5's second (14), the turn what its `Whatangle` should return.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array
from slamlab.exercises._cases import Report, run_cases

__all__ = [
    "MISTAKES_AUTOCORRELATION",
    "MISTAKES_SECOND_BEST",
    "MISTAKES_TURN",
    "autocorrelation",
    "check_autocorrelation",
    "check_second_best",
    "check_turn",
    "second_best",
    "turn",
]

Function = Callable[..., Any]


# Exercise 1: circular autocorrelation.


def autocorrelation(scan: Array) -> Array:
    """R[tau] (N,) of a scan (N,), second (14) of P5 on a ring."""
    return np.fft.irfft(np.abs(np.fft.rfft(scan)) ** 2, len(scan))


def _over_a_line(scan: Array) -> Array:
    return np.correlate(scan, scan, "full")[len(scan) - 1 :]


MISTAKES_AUTOCORRELATION: dict[str, Function] = {
    "beyond its end the scan was taken for zero: the beams form a ring, so the index wraps": (
        _over_a_line
    ),
    "this is d[j] d[tau - j], a convolution: correlate d[j] with d[j - tau]": (
        lambda scan: np.fft.irfft(np.fft.rfft(scan) ** 2, len(scan))
    ),
    "N + 1 values: the last repeats the first, as P5's `i <= Count` does": (
        lambda scan: np.append(autocorrelation(scan), autocorrelation(scan)[0])
    ),
    "the transform of R is the square of the amplitudes: the square is missing": (
        lambda scan: np.fft.irfft(np.abs(np.fft.rfft(scan)), len(scan))
    ),
    "the mean was taken off first: (14) keeps it": lambda scan: autocorrelation(
        scan - scan.mean()
    ),
    "divided by N: (14) is a sum, not a mean": lambda scan: autocorrelation(scan) / len(scan),
    "divided by R[0]: in (14) R[0] is the sum of the squares, not 1": (
        lambda scan: autocorrelation(scan) / np.sum(scan**2)
    ),
    "only shifts up to half the circle: all N are due, symmetric as they are": (
        lambda scan: autocorrelation(scan)[: len(scan) // 2 + 1]
    ),
}


def check_autocorrelation(student: Function) -> Report:
    """Check ``student(scan (N,)) -> R (N,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    scan = np.array([5, 1, 4, 2, 8, 3.0])
    cases = [
        ("six beams", scan),
        ("the same, turned by two beams", np.roll(scan, 2)),
        ("an odd number of beams", [2.5, 0.5, 1.5, 4.0, 3.5]),
        ("one near beam in a ring of far ones", [9, 9, 1, 9, 9, 9, 9.0]),
    ]
    return run_cases("autocorrelation", student, autocorrelation, cases, MISTAKES_AUTOCORRELATION)


# Exercise 2: the turn between two scans.


def turn(before: Array, after: Array) -> float:
    """Turn (rad, in (-pi, pi]) between two scans (N,) of one place, in whole beams."""
    shift = _best_shift(before, after)
    return _wrapped(shift * 2 * np.pi / len(before))


def _best_shift(before: Array, after: Array) -> int:
    """Shift m for which after[j] = before[j + m] fits best."""
    product = np.conj(np.fft.rfft(after)) * np.fft.rfft(before)
    return int(np.argmax(np.fft.irfft(product, len(before))))


def _wrapped(angle: float) -> float:
    return float(np.pi - (np.pi - angle) % (2 * np.pi))


def _longest_beam(before: Array, after: Array) -> float:
    return _wrapped((np.argmax(before) - np.argmax(after)) * 2 * np.pi / len(before))


def _least(before: Array, after: Array) -> float:
    product = np.conj(np.fft.rfft(after)) * np.fft.rfft(before)
    return _wrapped(np.argmin(np.fft.irfft(product, len(before))) * 2 * np.pi / len(before))


MISTAKES_TURN: dict[str, Function] = {
    "the sign is turned: a robot that turns left sees at beam 0 what it saw on its left": (
        lambda before, after: _wrapped(-turn(before, after))
    ),
    "this is a number of beams, as P5's `Whatangle` returns: multiply by 2 pi / N": (
        lambda before, after: turn(before, after) * len(before) / (2 * np.pi)
    ),
    "these are degrees: radians are due": (lambda before, after: np.rad2deg(turn(before, after))),
    "not wrapped: a turn to the right is negative, in (-pi, pi]": (
        lambda before, after: _best_shift(before, after) * 2 * np.pi / len(before)
    ),
    "N beams share the full circle: their distance is 2 pi / N, not 2 pi / (N - 1)": (
        lambda before, after: turn(before, after) * len(before) / (len(before) - 1)
    ),
    "this follows the longest beam, as P5 does: one disturbed beam decides; use them all": (
        _longest_beam
    ),
    "this is the worst alignment: the correlation is largest where the scans agree": _least,
}


def check_turn(student: Function) -> Report:
    """Check ``student(before (N,), after (N,)) -> turn (rad)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    scan = np.array([3.0, 2.1, 1.2, 1.4, 2.9, 3.6, 2.2, 0.9, 0.8, 1.1, 2.0, 2.6])
    disturbed = np.roll(scan, -4)
    disturbed[9] = 3.9  # somebody opened a door
    cases = [
        ("a turn to the left by two beams", scan, np.roll(scan, -2)),
        ("a turn to the right by three beams", scan, np.roll(scan, 3)),
        ("no turn", scan, scan),
        ("a door opened meanwhile", scan, disturbed),
        ("an odd number of beams", scan[:9], np.roll(scan[:9], 1)),
    ]
    return run_cases("turn", student, turn, cases, MISTAKES_TURN)


# Exercise 3: the second-best place.


def second_best(places: Array, misfits: Array, separation: float) -> tuple[int, int, float]:
    """Rows of the best and of the best distinct place, and how much worse that one fits."""
    best = int(np.argmin(misfits))
    far = np.linalg.norm(places - places[best], axis=1) > separation
    second = int(np.argmin(np.where(far, misfits, np.inf)))
    return best, second, float(misfits[second] - misfits[best])


def _with_mask(mask: Callable[[Array, float], NDArray[np.bool_]]) -> Function:
    """Return second_best with another idea of what is distinct."""

    def wrong(places: Array, misfits: Array, separation: float) -> tuple[int, int, float]:
        best = int(np.argmin(misfits))
        far = mask(places - places[best], separation)
        far[best] = False
        second = int(np.argmin(np.where(far, misfits, np.inf)))
        return best, second, float(misfits[second] - misfits[best])

    return wrong


def _ratio(places: Array, misfits: Array, separation: float) -> tuple[int, int, float]:
    best, second, _ = second_best(places, misfits, separation)
    return best, second, float(misfits[second] / misfits[best])


def _row_among_the_rest(
    places: Array, misfits: Array, separation: float
) -> tuple[int, int, float]:
    best, second, margin = second_best(places, misfits, separation)
    far = np.linalg.norm(places - places[best], axis=1) > separation
    return best, int(far[:second].sum()), margin


def _farthest(places: Array, misfits: Array, separation: float) -> tuple[int, int, float]:
    best = int(np.argmin(misfits))
    second = int(np.argmax(np.linalg.norm(places - places[best], axis=1)))
    return best, second, float(misfits[second] - misfits[best])


def _from_the_origin(places: Array, misfits: Array, separation: float) -> tuple[int, int, float]:
    best = int(np.argmin(misfits))
    far = np.linalg.norm(places, axis=1) > separation
    far[best] = False
    second = int(np.argmin(np.where(far, misfits, np.inf)))
    return best, second, float(misfits[second] - misfits[best])


MISTAKES_SECOND_BEST: dict[str, Function] = {
    "a neighbour of the best place is no second answer: it must be farther than `separation`": (
        _with_mask(lambda offset, separation: np.ones(len(offset), bool))
    ),
    "squared distances were compared with the separation: take the root": (
        _with_mask(lambda offset, separation: (offset**2).sum(1) > separation)
    ),
    "only x was compared: a place straight above is distinct too": (
        _with_mask(lambda offset, separation: np.abs(offset[:, 0]) > separation)
    ),
    "distances were taken from the origin: take them from the best place": _from_the_origin,
    "this is the farthest place: of those far enough the best fit is due": _farthest,
    "the margin is a difference of misfits (m), not a ratio": _ratio,
    "the margin has the wrong sign: the second place fits worse, so it is not negative": (
        lambda *case: (*second_best(*case)[:2], -second_best(*case)[2])
    ),
    "the row was counted among the places left over: rows of `places` are due": (
        _row_among_the_rest
    ),
    "best and second are exchanged": (
        lambda *case: (second_best(*case)[1], second_best(*case)[0], second_best(*case)[2])
    ),
}


def check_second_best(student: Function) -> Report:
    """Check ``student(places (k, 2), misfits (k,), separation) -> (best, second, margin)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    twins = [[1.0, 1.0], [1.02, 1.0], [3.0, 3.02], [1.0, 1.04], [3.0, 3.0], [0.2, 3.4]]
    column = [[2.0, 0.5], [2.0, 0.54], [2.5, 0.5], [2.02, 3.1], [3.9, 3.9]]
    cases = [
        ("two places that look alike", twins, [0.011, 0.014, 0.013, 0.012, 0.019, 0.09], 0.14),
        ("the best place stands last", twins[::-1], [0.08, 0.02, 0.05, 0.03, 0.016, 0.01], 0.14),
        ("one straight above the other", column, [0.010, 0.012, 0.041, 0.015, 0.030], 0.14),
        ("places half a metre apart may be one", column, [0.010, 0.02, 0.03, 0.05, 0.04], 0.7),
        ("near the origin", [[0.1, 0.0], [0.05, 0.05], [-0.1, 0.0], [2, 2]], [1, 2, 3, 4], 0.15),
    ]
    return run_cases("second_best", student, second_best, cases, MISTAKES_SECOND_BEST)
