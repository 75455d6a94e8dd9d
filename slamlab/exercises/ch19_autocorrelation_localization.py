"""Checks of chapter 19: circular autocorrelation, turn between two scans, the second-best place.

The autocorrelation is P5's second (14), the turn what its `Whatangle` should return.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._report import Array, Check, Function

__all__ = ["check_autocorrelation", "check_second_best", "check_turn"]


def _ranges(n: int) -> Any:
    return lambda rng: np.round(rng.uniform(0.5, 9, n), 2)


# Exercise 1: circular autocorrelation.


def _autocorrelation(scan: Array) -> Array:
    """R[tau] (N,) of a scan (N,), second (14) of P5 on a ring."""
    return np.array([scan @ np.roll(scan, tau) for tau in range(len(scan))])


def _spectrum(scan: Array) -> Any:
    return np.abs(np.fft.rfft(scan))


check_autocorrelation = Check(
    _autocorrelation,
    "R",
    {
        "six beams": lambda rng: (_ranges(6)(rng),),
        "an odd number of beams": lambda rng: (_ranges(7)(rng),),
        "one near beam in a ring of far ones": ([9, 9, 1, 9, 9, 9, 9.0],),
        "one beam": ([3.0],),
        "two beams": ([3.0, 1.0],),
        "many beams": lambda rng: (_ranges(int(rng.integers(8, 60)))(rng),),
    },
    {
        "beyond its end the scan was taken for zero: the beams form a ring, so the index wraps": (
            lambda scan: np.correlate(scan, scan, "full")[len(scan) - 1 :]
        ),
        "this is d[j] d[tau - j], a convolution: correlate d[j] with d[j - tau]": (
            lambda scan: np.fft.irfft(np.fft.rfft(scan) ** 2, len(scan))
        ),
        "N + 1 values: the last repeats the first, as P5's `i <= Count` does": (
            "range(len(scan))",
            "range(len(scan) + 1)",
        ),
        "the transform of R is the square of the amplitudes: the square is missing": (
            lambda scan: np.fft.irfft(_spectrum(scan), len(scan))
        ),
        "this is the power spectrum: transform it back": lambda scan: _spectrum(scan) ** 2,
        "irfft must be told the number of beams: without it an odd one loses a value": (
            lambda scan: np.fft.irfft(_spectrum(scan) ** 2)
        ),
        "the mean was taken off first: (14) keeps it": (
            lambda scan: _autocorrelation(scan - scan.mean())
        ),
        "divided by N: (14) is a sum, not a mean": (
            lambda scan: _autocorrelation(scan) / len(scan)
        ),
        "divided by R[0]: in (14) R[0] is the sum of the squares, not 1": (
            lambda scan: _autocorrelation(scan) / np.sum(scan**2)
        ),
        "only shifts up to half the circle: all N are due, symmetric as they are": (
            lambda scan: _autocorrelation(scan)[: len(scan) // 2 + 1]
        ),
        "the shifts begin at 1: R[0] is the sum of the squares": (
            "range(len(scan))",
            "range(1, len(scan) + 1)",
        ),
        "this is the sum of the differences, not of the products": (
            "scan @ np.roll(scan, tau)",
            "np.sum(np.abs(scan - np.roll(scan, tau)))",
        ),
    },
    tolerance=1e-8,
)


# Exercise 2: the turn between two scans.


def _turn(before: Array, after: Array) -> float:
    """Turn (rad, in (-pi, pi]) between two scans (N,) of one place, in whole beams."""
    n = len(before)
    fit = [before @ np.roll(after, m) for m in range(n)]  # after[j] = before[j + m]
    angle = int(np.argmax(fit)) * 2 * np.pi / n
    return angle if angle <= np.pi else angle - 2 * np.pi


def _wrapped(angle: float) -> float:
    return float(np.pi - (np.pi - angle) % (2 * np.pi))


def _turned(shift: int | None = None, door: bool = False, n: int | None = None) -> Any:
    def draw(rng: np.random.Generator) -> Any:
        count = n or int(rng.integers(5, 30))
        scan = _ranges(count)(rng)
        by = int(rng.integers(0, count)) if shift is None else shift
        after = np.roll(scan, -by)
        if door:
            after[int(rng.integers(count))] = 9.5
        return scan, after

    return draw


check_turn = Check(
    _turn,
    "turn",
    {
        "a turn to the left by two beams": _turned(2, n=12),
        "a turn to the right by three beams": _turned(-3, n=12),
        "no turn": _turned(0),
        "half a turn is pi": _turned(6, n=12),
        "a door opened meanwhile": _turned(door=True, n=24),
        "an odd number of beams": _turned(n=9),
        "any turn": _turned(),
    },
    {
        "the sign is turned: a robot that turns left sees at beam 0 what it saw on its left": (
            lambda before, after: _wrapped(-_turn(before, after))
        ),
        "this is a number of beams, as P5's `Whatangle` returns: multiply by 2 pi / N": (
            lambda before, after: _turn(before, after) * len(before) / (2 * np.pi)
        ),
        "this is a number of beams, and not wrapped: a turn to the right is negative": (
            "int(np.argmax(fit)) * 2 * np.pi / n",
            "int(np.argmax(fit))",
            "angle if angle <= np.pi else angle - 2 * np.pi",
            "angle",
        ),
        "these are degrees: radians are due": (
            lambda before, after: np.rad2deg(_turn(before, after))
        ),
        "not wrapped: a turn to the right is negative, in (-pi, pi]": (
            "angle if angle <= np.pi else angle - 2 * np.pi",
            "angle",
        ),
        "half a turn is pi, not -pi": ("<= np.pi", "< np.pi"),
        "N beams share the full circle: their distance is 2 pi / N, not 2 pi / (N - 1)": (
            lambda before, after: _turn(before, after) * len(before) / (len(before) - 1)
        ),
        "this follows the longest beam, as P5 does: one disturbed beam decides; use them all": (
            lambda before, after: _wrapped(
                (np.argmax(before) - np.argmax(after)) * 2 * np.pi / len(before)
            )
        ),
        "this is the worst alignment: the correlation is largest where the scans agree": (
            "argmax",
            "argmin",
        ),
        "the difference at the best shift came: the shift itself is due": (
            "int(np.argmax(fit)) * 2 * np.pi / n",
            "float(np.max(fit))",
            "angle if angle <= np.pi else angle - 2 * np.pi",
            "angle",
        ),
    },
)


# Exercise 3: the second-best place.


def _second_best(places: Array, misfits: Array, separation: float) -> tuple[int, int, float]:
    """Rows of the best and of the best distinct place, and how much worse that one fits."""
    best = int(np.argmin(misfits))
    far = np.linalg.norm(places - places[best], axis=1) > separation
    second = int(np.argmin(np.where(far, misfits, np.inf)))
    return best, second, float(misfits[second] - misfits[best])


_FAR = "np.linalg.norm(places - places[best], axis=1) > separation"


def _with_far(mask: Function) -> Function:
    """Return second_best with another idea of what is distinct."""

    def wrong(places: Array, misfits: Array, separation: float) -> tuple[int, int, float]:
        best = int(np.argmin(misfits))
        far = np.array(mask(places, places[best], separation))
        far[best] = False
        second = int(np.argmin(np.where(far, misfits, np.inf)))
        return best, second, float(misfits[second] - misfits[best])

    return wrong


def _from_the_neighbour(places: Array, misfits: Array, separation: float) -> Any:
    best, second, _ = _second_best(places, misfits, separation)
    return best, second, float(misfits[second] - np.sort(misfits)[1])


def _row_among_the_rest(places: Array, misfits: Array, separation: float) -> Any:
    best, second, margin = _second_best(places, misfits, separation)
    far = np.linalg.norm(places - places[best], axis=1) > separation
    return best, int(far[:second].sum()), margin


def _candidates(rng: np.random.Generator) -> Any:
    k = int(rng.integers(3, 15))
    places = np.round(rng.uniform(0, 3, (k, 2)), 2)
    misfits = np.round((rng.permutation(k) + 1) / 100 + rng.uniform(0, 0.005, k), 4)
    distance = np.linalg.norm(places - places[np.argmin(misfits)], axis=1).max()
    return places, misfits, float(np.round(rng.uniform(0.2, 0.9) * distance, 2))


check_second_best = Check(
    _second_best,
    "best, second, margin",
    {
        "two places that look alike": (
            [[1.0, 1.0], [1.02, 1.0], [3.0, 3.02], [1.0, 1.04], [3.0, 3.0], [0.2, 3.4]],
            [0.011, 0.014, 0.013, 0.012, 0.019, 0.09],
            0.14,
        ),
        "one straight above the other": (
            [[2.0, 0.5], [2.0, 0.54], [2.5, 0.5], [2.02, 3.1], [3.9, 3.9]],
            [0.010, 0.012, 0.041, 0.015, 0.030],
            0.14,
        ),
        "exactly at the separation is not farther": (
            [[0, 0], [3, 4], [6, 8]],
            [0.01, 0.02, 0.03],
            5.0,
        ),
        "near the origin": ([[0.1, 0.0], [0.05, 0.05], [-0.1, 0.0], [2, 2]], [1, 2, 3, 4], 0.15),
        "two candidates": ([[0, 0], [1, 0]], [0.3, 0.1], 0.5),
        "any candidates": _candidates,
    },
    {
        "a neighbour of the best place is no second answer: it must be farther away": (
            _with_far(lambda places, best, separation: np.ones(len(places), bool))
        ),
        "squared distances were compared with the separation: take the root": (
            _with_far(lambda p, best, separation: ((p - best) ** 2).sum(1) > separation)
        ),
        "only x was compared: a place straight above is distinct too": (
            _with_far(lambda p, best, separation: np.abs(p - best)[:, 0] > separation)
        ),
        "only y was compared: a place straight beside is distinct too": (
            _with_far(lambda p, best, separation: np.abs(p - best)[:, 1] > separation)
        ),
        "distances were taken from the origin: take them from the best place": (
            _with_far(lambda p, best, separation: np.linalg.norm(p, axis=1) > separation)
        ),
        "exactly at the separation is not farther": ("> separation", ">= separation"),
        "this is the farthest place: of those far enough the best fit is due": (
            "np.argmin(np.where(far, misfits, np.inf))",
            "np.argmax(np.linalg.norm(places - places[best], axis=1))",
        ),
        "this is the first place far enough: of those the best fit is due": (
            "np.argmin(np.where(far, misfits, np.inf))",
            "np.argmax(far)",
        ),
        "the margin is a difference of misfits (m), not a ratio": (
            "misfits[second] - misfits[best]",
            "misfits[second] / misfits[best]",
        ),
        "the margin was taken from the neighbour: take it from the best place": (
            _from_the_neighbour
        ),
        "this is the misfit of the second place: the margin is a difference": (
            "misfits[second] - misfits[best]",
            "misfits[second]",
        ),
        "the margin has the wrong sign: the second place fits worse, so it is not negative": (
            "misfits[second] - misfits[best]",
            "misfits[best] - misfits[second]",
        ),
        "the row was counted among the places left over: rows of `places` are due": (
            _row_among_the_rest
        ),
        "best and second are exchanged": (
            lambda *case: (_second_best(*case)[1], _second_best(*case)[0], _second_best(*case)[2])
        ),
        "the best fit has the smallest misfit, not the largest": (
            lambda places, misfits, separation: (
                *_second_best(places, -misfits, separation)[:2],
                -_second_best(places, -misfits, separation)[2],
            )
        ),
    },
    draws=12,
)
