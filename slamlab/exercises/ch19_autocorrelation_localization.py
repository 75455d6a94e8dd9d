"""Checks of chapter 19: beams, autocorrelation, the turn between two scans, and the place.

The autocorrelation is P5's second (14), the turn what its `Whatangle` should return.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn
from slamlab.exercises._report import Array, Check, Function
from slamlab.sensors import Lidar
from slamlab.worlds import free_poses, rooms

__all__ = [
    "check_autocorrelation",
    "check_beams",
    "check_locate",
    "check_refined",
    "check_second_best",
    "check_turn",
]


def _ranges(n: int) -> Any:
    return lambda rng: np.round(rng.uniform(0.5, 9, n), 2)


# Exercise 1: how many beams, with a pencil.


def _beams_for(sigma: float) -> int:
    """Fewest beams of a full circle whose rounding errs by at most sigma (rad, rms)."""
    return int(np.ceil(2 * np.pi / (np.sqrt(12) * sigma)))


def _errors(rng: np.random.Generator) -> Any:
    return (float(np.round(np.deg2rad(rng.uniform(0.1, 20)), 4)),)


check_beams = Check(
    _beams_for,
    "beams",
    {
        "one degree": (float(np.deg2rad(1.0)),),
        "P5's three degrees between beams": (float(np.deg2rad(0.9)),),
        "a hundredth of a radian": (0.01,),
        "any error": _errors,
    },
    {
        "the turn may lie anywhere between -1/2 and 1/2 beam: this takes the worst of them": (
            lambda sigma: int(np.ceil(np.pi / sigma))
        ),
        "this is the distance of two beams: rounding errs by less": (
            lambda sigma: int(np.ceil(2 * np.pi / sigma))
        ),
        "a twelfth is the variance of a uniform number: its root is due": (
            lambda sigma: int(np.ceil(2 * np.pi / (12 * sigma)))
        ),
        "rounded down: with so few beams the error is larger than allowed": (
            "np.ceil => np.floor"
        ),
        "rounded to the nearest number: with fewer beams the error is larger than allowed": (
            lambda sigma: int(np.rint(2 * np.pi / (np.sqrt(12) * sigma)))
        ),
        "the circle has 2 pi": "2 * np.pi => np.pi",
        "this takes the mean size of the error, a quarter of a beam: the rms is due": (
            lambda sigma: int(np.ceil(2 * np.pi / (4 * sigma)))
        ),
        "the error runs over one beam, half to either side, not over two": (
            lambda sigma: int(np.ceil(2 * np.pi / (np.sqrt(3) * sigma)))
        ),
        "the circle in degrees, the error in radians": "2 * np.pi => 360",
    },
    draws=20,
)


# Exercise 2: circular autocorrelation.


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
            "range(len(scan)) => range(len(scan) + 1)"
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
            "range(len(scan)) => range(1, len(scan) + 1)"
        ),
        "this is the sum of the differences, not of the products": (
            "scan @ np.roll(scan, tau) => np.sum(np.abs(scan - np.roll(scan, tau)))"
        ),
    },
    tolerance=1e-8,
)


# Exercise 3: the turn between two scans.


def _turn(before: Array, after: Array) -> float:
    """Turn (rad, in (-pi, pi]) between two scans (N,) of one place, in whole beams."""
    n = len(before)
    fit = after[(np.arange(n) - np.arange(n)[:, None]) % n] @ before  # after[j] = before[j + m]
    angle = int(np.argmax(fit)) * 2 * np.pi / n
    return angle if angle <= np.pi else angle - 2 * np.pi


def _wrapped(angle: float) -> float:
    return float(np.pi - (np.pi - angle) % (2 * np.pi))


@drawn
def _turned(
    rng: np.random.Generator, shift: int | None = None, door: bool = False, n: int | None = None
) -> Any:
    count = n or int(rng.integers(5, 30))
    scan = _ranges(count)(rng)
    by = int(rng.integers(0, count)) if shift is None else shift
    after = np.roll(scan, -by)
    if door:
        after[int(rng.integers(count))] = 9.5
    return scan, after


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
            "int(np.argmax(fit)) * 2 * np.pi / n => int(np.argmax(fit))",
            "angle if angle <= np.pi else angle - 2 * np.pi => angle",
        ),
        "these are degrees: radians are due": (
            lambda before, after: np.rad2deg(_turn(before, after))
        ),
        "not wrapped: a turn to the right is negative, in (-pi, pi]": (
            "angle if angle <= np.pi else angle - 2 * np.pi => angle"
        ),
        "half a turn is pi, not -pi": "<= np.pi => < np.pi",
        "N beams share the full circle: their distance is 2 pi / N, not 2 pi / (N - 1)": (
            lambda before, after: _turn(before, after) * len(before) / (len(before) - 1)
        ),
        "this follows the longest beam, as P5 does: one disturbed beam decides; use them all": (
            lambda a, b: _wrapped((np.argmax(a) - np.argmax(b)) * 2 * np.pi / len(a))
        ),
        "this is the worst alignment: the correlation is largest where the scans agree": (
            "argmax => argmin"
        ),
        "the difference at the best shift came: the shift itself is due": (
            "int(np.argmax(fit)) * 2 * np.pi / n => float(np.max(fit))",
            "angle if angle <= np.pi else angle - 2 * np.pi => angle",
        ),
    },
)


# Exercise 4: a bug to find.


def _refined(R: Array) -> float:
    """Turn (rad, in (-pi, pi]) at the top of the parabola through the largest value of a ring."""
    n = len(R)
    m = int(np.argmax(R))
    before, top, after = R[m - 1], R[m], R[(m + 1) % n]
    shift = 0.5 * (before - after) / (before - 2 * top + after)
    return float(np.pi - (np.pi - (m + shift) * 2 * np.pi / n) % (2 * np.pi))


_NEXT = "R[m - 1], R[m], R[(m + 1) % n]"


@drawn
def _peak(rng: np.random.Generator, at: int | None = None, n: int | None = None) -> Any:
    """Draw a ring with its top near a beam, a parabola round it and less elsewhere."""
    count = n or int(rng.integers(5, 30))
    m = int(rng.integers(count)) if at is None else at % count
    away = (np.arange(count) - m - rng.uniform(-0.45, 0.45) + count / 2) % count - count / 2
    R = rng.uniform(20, 90) - rng.uniform(0.5, 2) * np.minimum(away**2, 6)
    return (np.round(R + rng.uniform(-0.05, 0.05, count), 3),)


check_refined = Check(
    _refined,
    "turn",
    {
        "a top exactly on a beam": ([1.0, 2.0, 5.0, 2.0, 1.0, 0.5],),
        "a top between two beams": ([1.0, 2.0, 5.0, 4.0, 1.0, 0.5],),
        "three beams": ([2.0, 5.0, 1.0],),
        "no turn, or almost none": _peak(0),
        "a turn by almost one beam to the right": _peak(-1),
        "half a turn, a little less or more": _peak(6, n=12),
        "an odd number of beams": _peak(n=9),
        "any ring": _peak(),
    },
    {
        "the neighbour was cut off at the end of the list: after the last beam comes the first": (
            f"{_NEXT} => R[max(m - 1, 0)], R[m], R[min(m + 1, n - 1)]"
        ),
        "the neighbour before the first beam was cut off: it is the last one": (
            f"{_NEXT} => R[max(m - 1, 0)], R[m], R[(m + 1) % n]"
        ),
        "the neighbour after the last beam was cut off: it is the first one": (
            f"{_NEXT} => R[m - 1], R[m], R[min(m + 1, n - 1)]"
        ),
        "at the ends of the list the top was not refined: the ring has no ends": (
            "shift = 0.5 * => shift = (0 < m < n - 1) * 0.5 *"
        ),
        "the top was not refined: this is a whole number of beams": (
            "0.5 * (before - after) / (before - 2 * top + after) => 0.0"
        ),
        "the shift has the wrong sign: the top lies towards the larger neighbour": (
            "(m + shift) => (m - shift)"
        ),
        "the half in front of the fraction is missing": "0.5 * (before => (before",
        "the curvature is before - 2 top + after": "2 * top => top",
        "this is a number of beams: multiply by 2 pi / N": (
            "float(np.pi - (np.pi - (m + shift) * 2 * np.pi / n) % (2 * np.pi)) => m + shift"
        ),
        "these are degrees: radians are due": lambda R: np.rad2deg(_refined(R)),
        "not wrapped: a turn to the right is negative, in (-pi, pi]": (
            "np.pi - (np.pi - (m + shift) * 2 * np.pi / n) % (2 * np.pi)"
            " => (m + shift) * 2 * np.pi / n"
        ),
        "this is the height of the top: its place is due": (lambda R: float(R.max())),
    },
    tolerance=1e-8,
)


# Exercise 5: the second-best place.


def _second_best(places: Array, misfits: Array, separation: float) -> tuple[int, int, float]:
    """Rows of the best and of the best distinct place, and how much worse that one fits."""
    best = int(np.argmin(misfits))
    far = np.linalg.norm(places - places[best], axis=1) > separation
    second = int(np.argmin(np.where(far, misfits, np.inf)))
    return best, second, float(misfits[second] - misfits[best])


_FAR = "np.linalg.norm(places - places[best], axis=1) > separation"


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
            f"{_FAR} => np.arange(len(places)) != best"
        ),
        "squared distances were compared with the separation: take the root": (
            f"{_FAR} => ((places - places[best]) ** 2).sum(1) > separation"
        ),
        "only x was compared: a place straight above is distinct too": (
            f"{_FAR} => np.abs(places - places[best])[:, 0] > separation"
        ),
        "only y was compared: a place straight beside is distinct too": (
            f"{_FAR} => np.abs(places - places[best])[:, 1] > separation"
        ),
        "distances were taken from the origin: take them from the best place": (
            f"{_FAR} => (np.linalg.norm(places, axis=1) > separation) & (misfits > misfits[best])"
        ),
        "exactly at the separation is not farther": "> separation => >= separation",
        "this is the farthest place: of those far enough the best fit is due": (
            "np.argmin(np.where(far, misfits, np.inf))"
            " => np.argmax(np.linalg.norm(places - places[best], axis=1))"
        ),
        "this is the first place far enough: of those the best fit is due": (
            "np.argmin(np.where(far, misfits, np.inf)) => np.argmax(far)"
        ),
        "the margin is a difference of misfits (m), not a ratio": (
            "misfits[second] - misfits[best] => misfits[second] / misfits[best]"
        ),
        "the margin was taken from the neighbour: take it from the best place": (
            "misfits[second] - misfits[best] => misfits[second] - np.sort(misfits)[1]"
        ),
        "this is the misfit of the second place: the margin is a difference": (
            "misfits[second] - misfits[best] => misfits[second]"
        ),
        "the margin has the wrong sign: the second place fits worse, so it is not negative": (
            "misfits[second] - misfits[best] => misfits[best] - misfits[second]"
        ),
        "the row was counted among the places left over: rows of `places` are due": (
            "return best, second, => return best, far[:second].sum(),"
        ),
        "best and second are exchanged": (
            lambda *case: (_second_best(*case)[1], _second_best(*case)[0], _second_best(*case)[2])
        ),
        "the best fit has the smallest misfit, not the largest": (
            "np.argmin(misfits) => np.argmax(misfits)",
            "np.where(far, misfits, np.inf) => np.where(far, -misfits, np.inf)",
        ),
    },
    draws=12,
)


# Exercise 6: where am I? Assembled.


def _locate(
    places: Array, scans: Array, scan: Array, nearest: int, separation: float
) -> tuple[Array, float]:
    """Pose (3,) of a scan (N,) in a map of scans (P, N), and the margin to the second-best place.

    The `nearest` places by the moduli of the harmonics 0 to 7 are candidates; each is turned to
    fit the scan best, and the mean absolute difference of the beams is its misfit. The margin is
    infinite if no candidate is farther than `separation` from the best.
    """
    amplitude = np.abs(np.fft.rfft(scans))[:, :8]
    own = np.abs(np.fft.rfft(scan))[:8]
    rows = np.argsort(np.linalg.norm(amplitude - own, axis=1))[:nearest]
    turns = [_turn(scans[row], scan) for row in rows]
    beams = [int(np.rint(turn * len(scan) / (2 * np.pi))) for turn in turns]
    pairs = zip(rows, beams, strict=True)
    misfits = np.array([np.mean(np.abs(np.roll(scans[r], -m) - scan)) for r, m in pairs])
    best = int(np.argmin(misfits))
    far = np.linalg.norm(places[rows] - places[rows[best]], axis=1) > separation
    margin = misfits[far].min() - misfits[best] if far.any() else np.inf
    return np.append(places[rows[best]], turns[best]), float(margin)


@drawn
def _map_of_scans(
    rng: np.random.Generator, places: int, beams: int, turn: int | None = None, twin: bool = False
) -> Any:
    """Draw a map of scans, and a scan near one of its places, turned and with noise."""
    where = np.round(rng.uniform(0, 4, (places, 2)), 2)
    # Smooth scans: a few harmonics each.
    k, angle = np.arange(1, 6), 2 * np.pi * np.arange(beams) / beams
    waves = rng.normal(0, 0.5, (places, 2, 5)) / k
    scans = 3 + waves[:, 0] @ np.cos(np.outer(k, angle)) + waves[:, 1] @ np.sin(np.outer(k, angle))
    if twin:
        scans[-1] = scans[0] + rng.normal(0, 0.03, beams)
        where[-1] = where[0] + [2.0, 1.0]
    row = 0 if twin else int(rng.integers(places))
    m = int(rng.integers(beams)) if turn is None else turn
    scan = np.roll(scans[row], -m) + rng.normal(0, 0.02, beams)
    return where, np.round(scans, 4), np.round(scan, 4), max(places // 3, 1), 0.5


def _mirror(rng: np.random.Generator) -> Any:
    """Put the mirror image of the scan into the map: it has the same signature."""
    where, scans, scan, _, separation = _map_of_scans(6, 24)(rng)
    return np.vstack([where, [9.0, 9.0]]), np.vstack([scans, scan[::-1]]), scan, 4, separation


def _larger(rng: np.random.Generator) -> Any:
    """Put a scan of the same shape into the map, a metre farther all round."""
    where, scans, scan, _, separation = _map_of_scans(6, 24)(rng)
    return np.vstack([where, [9.0, 9.0]]), np.vstack([scans, scan + 1.0]), scan, 1, separation


@lru_cache(maxsize=1)
def _room() -> Any:
    """Return a map of the thesis' room, a place every 20 cm, and twenty scans with their poses."""
    world, lidar = rooms.thesis_room(), Lidar(40)
    grid = np.stack(np.meshgrid(np.arange(0.1, 4, 0.2), np.arange(0.1, 4, 0.2)), -1)
    places = grid.reshape(-1, 2)
    places = places[world.clearance(places) > 0.05]
    scans = lidar.scan(world, np.column_stack([places, np.zeros(len(places))]))
    truth = free_poses(world, 20, np.random.default_rng(4), 0.15)
    return places, np.round(scans, 4), np.round(lidar.scan(world, truth), 4), truth


def _located(
    locate: Function, places: Array, scans: Array, scan: Array, nearest: int, separation: float
) -> Any:
    """Locate one scan, or judge the twenty of the room."""
    if scan.ndim == 1:
        return locate(places, scans, scan, nearest, separation)
    answers = [locate(places, scans, one, nearest, separation) for one in scan]
    poses, truth = np.array([one[0] for one in answers]), _room()[3]
    off = np.hypot(*(poses[:, :2] - truth[:, :2]).T) > 0.2
    turned = np.abs((poses[:, 2] - truth[:, 2] + np.pi) % (2 * np.pi) - np.pi) > np.deg2rad(9)
    if off.mean() > 0.1:
        return f"{off.sum()} of {len(off)} places are off by more than 20 cm, 2 are allowed"
    if turned.mean() > 0.1:
        return (
            f"{turned.sum()} of {len(off)} headings are off by more than 9 degrees, 2 are allowed"
        )
    return ""


check_locate = Check(
    _locate,
    "pose, margin",
    {
        "a single place, not turned": _map_of_scans(1, 24, turn=0),
        "a few places, not turned": _map_of_scans(6, 24, turn=0),
        "a turn to the left": _map_of_scans(9, 24, turn=5),
        "a turn to the right": _map_of_scans(9, 24, turn=-4),
        "two places that look alike": _map_of_scans(12, 36, twin=True),
        "a mirror image is nearest by signature": _mirror,
        "the same shape, a metre farther all round": _larger,
        "exactly at the separation is not farther": (
            [[0.0, 0.0], [3.0, 4.0]],
            [[1.0, 2.0, 3.0, 4.0, 5.0], [1.0, 2.0, 3.0, 4.0, 6.0]],
            [1.0, 2.0, 3.0, 4.0, 5.0],
            2,
            5.0,
        ),
        "an odd number of beams": _map_of_scans(15, 25),
        "many places": _map_of_scans(60, 40),
        "twenty scans in the thesis' room": (*_room()[:3], 8, 0.3),
    },
    {
        "the scans were compared as they are: turn each candidate to fit first": (
            "turns = [_turn(scans[row], scan) for row in rows] => turns = [0.0 for row in rows]"
        ),
        "the place is that of the nearest signature: the signature proposes, the scan decides": (
            "best = int(np.argmin(misfits)) => best = 0"
        ),
        "all places were compared: only the nearest by signature are candidates": (
            "[:nearest] => [:]"
        ),
        "the heading has the wrong sign: the map looks along 0, the robot has turned left": (
            "turns[best]) => -turns[best])"
        ),
        "the candidates were turned the wrong way": (
            "np.roll(scans[r], -m) => np.roll(scans[r], m)"
        ),
        "the row among the candidates was taken for a row of the map": (
            "np.append(places[rows[best]], turns[best]) => np.append(places[best], turns[best])"
        ),
        "the margin was taken from the next candidate: it must be farther than the separation": (
            "misfits[far].min() - misfits[best] if far.any()"
            " => np.sort(misfits)[1] - misfits[best] if len(misfits) > 1"
        ),
        "this is the misfit of the second place: the margin is a difference": (
            "misfits[far].min() - misfits[best] => misfits[far].min()"
        ),
        "without a distinct candidate there is nothing to doubt: the margin is infinite": (
            "else np.inf => else 0.0"
        ),
        "the signatures were compared with their phases: the modulus forgets the turn": (
            "np.abs(np.fft.rfft(scans))[:, :8] => np.fft.rfft(scans)[:, :8]",
            "np.abs(np.fft.rfft(scan))[:8] => np.fft.rfft(scan)[:8]",
        ),
        "the harmonic 0 was left out: it is the mean of the scan, and belongs to 0 to 7": (
            "[:, :8] => [:, 1:8]",
            "[:8] => [1:8]",
        ),
        "the squared difference was taken: the misfit is the mean absolute one": (
            "np.mean(np.abs(np.roll(scans[r], -m) - scan))"
            " => np.mean((np.roll(scans[r], -m) - scan) ** 2)"
        ),
        "the sum of the differences was taken: the misfit is their mean": (
            "np.mean(np.abs(np.roll(scans[r], -m) - scan))"
            " => np.sum(np.abs(np.roll(scans[r], -m) - scan))"
        ),
        "exactly at the separation is not farther": "> separation => >= separation",
    },
    tolerance=1e-8,
    use=_located,
)
