"""Exercises, chapter 19: beams, autocorrelation, the turn between two scans, and the place.

The autocorrelation is P5's second (14), the turn what its `Whatangle` should return.
"""

# mypy: disable-error-code="return-value"
# A solution is written as a student writes it, without types inside.

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


# %% [markdown] tags=["chapter"]
# # Exercises 19: autocorrelation localization
#
# Six exercises that find a robot from one scan: the beams it needs, with a pencil; a signature, a
# turn, a bug to find, the second-best place, and all of it assembled in the room of the thesis.
# The chapter is [Autocorrelation localization](../19_autocorrelation_localization.ipynb). Replace
# each `...` and run the check below it as often as you like; then draw what you built beside what
# is expected.

# %% [markdown] tags=["solution"]
# # Solutions 19: autocorrelation localization
#
# The exercises are in [Exercises 19](../exercises/19_autocorrelation_localization.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: how many beams, with a pencil
#
# A lidar with $N$ beams on the full circle tells a turn in whole beams, so it rounds. Any true
# turn is as likely as any other. How many beams are needed, at least, for a root mean square
# error of $\sigma$?
#
# On paper: between which two numbers does the rounding error lie, how is it distributed, and what
# is the mean of its square?


# %% tags=["exercise"]
def beams_for(sigma: float) -> int:
    """Fewest beams for a given error of the heading.

    Parameters
    ----------
    sigma : float
        Root mean square error that is allowed (rad).

    Returns
    -------
    int
    """
    return int(np.ceil(2 * np.pi / (np.sqrt(12) * sigma)))


# %% active="ipynb" tags=["try"]
# beams_for(np.deg2rad(1.0))

# %% [markdown] tags=["hint"]
# With a distance $\Delta$ between beams the error is uniform between $-\Delta/2$ and $\Delta/2$.
# Integrate $e^2$ over it and divide by $\Delta$.

# %% [markdown] tags=["hint"]
# A fraction of a beam cannot be bought. Which whole number keeps the promise?


# %% tags=["cases"]
def _errors(rng: np.random.Generator) -> Any:
    return (float(np.round(np.deg2rad(rng.uniform(0.1, 20)), 4)),)


def _beams_drawn(ax: Any, function: Any) -> None:
    """Draw the error of turns rounded to whole beams, and the beams that each error asks for."""
    from slamlab import plots

    rng, errors = np.random.default_rng(1), []
    counts = np.arange(20, 260, 8)
    for count in counts:
        turned = rng.uniform(0, count, 20_000)
        errors.append(360 / count * np.sqrt(np.mean((turned - np.rint(turned)) ** 2)))
    ax.plot(counts, errors, **plots.line_style("truth"))
    allowed = np.linspace(0.45, 5, 20)
    found = [float(function(float(np.deg2rad(one)))) for one in allowed]
    ax.plot(found, allowed, "o", color=plots.COLOURS["estimate"], markersize=4)
    ax.set(xlabel="beams", ylabel="RMS error of the turn (°)")


check_beams = Check(
    beams_for,
    "beams",
    {
        "one degree": (float(np.deg2rad(1.0)),),
        "nine tenths of a degree": (float(np.deg2rad(0.9)),),
        "a hundredth of a radian": (0.01,),
        "any error": _errors,
    },
    draws=20,
    picture=_beams_drawn,
)


# %% tags=["mistakes"]
def _ranges(n: int) -> Any:
    return lambda rng: np.round(rng.uniform(0.5, 9, n), 2)


check_beams.mistakes = {
    "the turn may lie anywhere between -1/2 and 1/2 beam: this takes the worst of them": (
        lambda sigma: int(np.ceil(np.pi / sigma))
    ),
    "this is the distance of two beams: rounding errs by less": (
        lambda sigma: int(np.ceil(2 * np.pi / sigma))
    ),
    "a twelfth is the variance of a uniform number: expected its root": (
        lambda sigma: int(np.ceil(2 * np.pi / (12 * sigma)))
    ),
    "rounded down: with so few beams the error is larger than allowed": ("np.ceil => np.floor"),
    "rounded to the nearest number: with fewer beams the error is larger than allowed": (
        lambda sigma: int(np.rint(2 * np.pi / (np.sqrt(12) * sigma)))
    ),
    "the circle has 2 pi": "2 * np.pi => np.pi",
    "this takes the mean size of the error, a quarter of a beam: expected the rms": (
        lambda sigma: int(np.ceil(2 * np.pi / (4 * sigma)))
    ),
    "the error runs over one beam, half to either side, not over two": (
        lambda sigma: int(np.ceil(2 * np.pi / (np.sqrt(3) * sigma)))
    ),
    "the circle in degrees, the error in radians": "2 * np.pi => 360",
}

# %% [markdown] tags=["solution"]
# ## Solution 1: how many beams, with a pencil
#
# $\frac1\Delta\int_{-\Delta/2}^{\Delta/2} e^2\, de = \Delta^2/12$, so the error is
# $\Delta/\sqrt{12}$ with $\Delta = 2\pi/N$. The fewest beams are $2\pi/(\sqrt{12}\,\sigma)$,
# rounded up.

# %% [markdown] tags=["solution"]
# And numerically, for one degree:

# %% active="ipynb" tags=["solution"]
# turns = np.linspace(-np.pi, np.pi, 100_001)
# for n in (beams_for(np.deg2rad(1.0)) - 1, beams_for(np.deg2rad(1.0))):
#     error = turns - np.rint(turns * n / (2 * np.pi)) * 2 * np.pi / n
#     print(f"{n} beams: {np.rad2deg(np.sqrt(np.mean(error**2))):.3f} degrees")

# %% [markdown] tags=["solution"]
# Half a beam is the worst that can happen. A plan for it buys $\sqrt 3$ times as many beams:

# %% active="ipynb" tags=["solution"]
# check_beams(lambda sigma: int(np.ceil(np.pi / sigma)))

# %% [markdown] tags=["statement"]
# ## Exercise 2: a signature without heading
#
# The second (14) of P5, on a ring of beams: $R[\tau] = \sum_j d_j\, d_{(j - \tau) \bmod N}$. A
# loop will do; one FFT there and one back are faster.


# %% tags=["exercise"]
def autocorrelation(scan: Array) -> Array:
    """Circular autocorrelation of a scan.

    Parameters
    ----------
    scan : ndarray, shape (N,)
        Ranges (m) of beams spread evenly over the full circle.

    Returns
    -------
    ndarray, shape (N,)
        R[0] to R[N - 1] (m^2).
    """
    return np.fft.irfft(np.abs(np.fft.rfft(scan)) ** 2, len(scan))


# %% active="ipynb" tags=["try"]
# autocorrelation(np.array([5.0, 1.0, 4.0, 2.0]))

# %% [markdown] tags=["hint"]
# What is beam $-1$ of a ring with $N$ beams?

# %% [markdown] tags=["hint"]
# `np.roll(scan, tau)` is the scan moved by $\tau$ beams along the ring.

# %% [markdown] tags=["hint"]
# By FFT: the transform of $R$ is the squared modulus of the transform of the scan.
# `np.fft.irfft(..., len(scan))` needs the length, or an odd $N$ comes back one short.


# %% tags=["cases"]
def _scan_of_room(pose: Any, n_beams: int) -> Array:
    """Take a scan in the room of the thesis."""
    scan: Array = Lidar(n_beams).scan(rooms.thesis_room(), np.array(pose, float))
    return scan


def _autocorrelation_drawn(ax: Any, function: Any) -> None:
    """Draw the signatures of one place at two headings: they are one line."""
    from slamlab import plots

    scans = [_scan_of_room([1.2, 1.0, turn * np.pi / 30], 60) for turn in (0, 17)]
    by_hand = [scans[0] @ np.roll(scans[0], m) for m in range(60)]
    ax.plot(by_hand, **plots.line_style("truth"))
    for scan, style in zip(scans, ("o", "x"), strict=True):
        R = np.asarray(function(scan), float)
        ax.plot(np.arange(60), R, style, color=plots.COLOURS["estimate"], mfc="none", markersize=5)
    ax.set(xlabel="shift (beams)", ylabel="R (m²); crosses: turned by 17 beams")


check_autocorrelation = Check(
    autocorrelation,
    "R",
    {
        "six beams": lambda rng: (_ranges(6)(rng),),
        "an odd number of beams": lambda rng: (_ranges(7)(rng),),
        "one near beam in a ring of far ones": ([9, 9, 1, 9, 9, 9, 9.0],),
        "one beam": ([3.0],),
        "two beams": ([3.0, 1.0],),
        "many beams": lambda rng: (_ranges(int(rng.integers(8, 60)))(rng),),
    },
    tolerance=1e-8,
    picture=_autocorrelation_drawn,
)


# %% tags=["mistakes"]
def _spectrum(scan: Array) -> Any:
    return np.abs(np.fft.rfft(scan))


check_autocorrelation.mistakes = {
    "beyond its end the scan was taken for zero: the beams form a ring, so the index wraps": (
        lambda scan: np.correlate(scan, scan, "full")[len(scan) - 1 :]
    ),
    "this is d[j] d[tau - j], a convolution: correlate d[j] with d[j - tau]": (
        lambda scan: np.fft.irfft(np.fft.rfft(scan) ** 2, len(scan))
    ),
    "N + 1 values: the last repeats the first, as P5's `i <= Count` does": (
        lambda scan: np.append(autocorrelation(scan), scan @ scan)
    ),
    "the transform of R is the square of the amplitudes: the square is missing": (
        lambda scan: np.fft.irfft(_spectrum(scan), len(scan))
    ),
    "this is the power spectrum: transform it back": lambda scan: _spectrum(scan) ** 2,
    "irfft needs the number of beams: without it an odd one loses a value": (
        lambda scan: np.fft.irfft(_spectrum(scan) ** 2)
    ),
    "the mean was taken off first: (14) keeps it": (
        lambda scan: autocorrelation(scan - scan.mean())
    ),
    "divided by N: (14) is a sum, not a mean": (lambda scan: autocorrelation(scan) / len(scan)),
    "divided by R[0]: in (14) R[0] is the sum of the squares, not 1": (
        lambda scan: autocorrelation(scan) / np.sum(scan**2)
    ),
    "only shifts up to half the circle: expected all N, symmetric as they are": (
        lambda scan: autocorrelation(scan)[: len(scan) // 2 + 1]
    ),
    "the shifts begin at 1: R[0] is the sum of the squares": (
        lambda scan: np.roll(autocorrelation(scan), -1)
    ),
    "this is the sum of the differences, not of the products": (
        lambda scan: [np.sum(np.abs(scan - np.roll(scan, tau))) for tau in range(len(scan))]
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: a signature without heading
#
# The Fourier transform turns a circular correlation into a product: that of $R$ is $D_k
# \overline{D_k} = |D_k|^2$. A turn by whole beams multiplies $D_k$ by a number of modulus one,
# and the modulus forgets it.

# %% [markdown] tags=["solution"]
# `np.correlate` looks like the same thing and takes the scan for a signal with a beginning and an
# end. A turned robot then has another signature:

# %% active="ipynb" tags=["solution"]
# def over_a_line(scan):
#     return np.correlate(scan, scan, "full")[len(scan) - 1:]
#
# check_autocorrelation(over_a_line)

# %% [markdown] tags=["statement"]
# ## Exercise 3: how far did it turn?
#
# Two scans from one place, before and after a turn on the spot. Beam 0 looks straight ahead,
# beams go counterclockwise. Give the turn that makes the scans agree best, in whole beams but as
# an angle.


# %% tags=["exercise"]
def turn(before: Array, after: Array) -> float:
    """Turn between two scans of one place.

    Parameters
    ----------
    before, after : ndarray, shape (N,)
        Ranges (m) of beams spread evenly over the full circle.

    Returns
    -------
    float
        Angle (rad) in (-pi, pi], positive to the left.
    """
    N = len(before)
    product = np.fft.rfft(before) * np.conj(np.fft.rfft(after))
    m = np.fft.irfft(product, N).argmax()
    angle = m * 2 * np.pi / N
    return angle if angle <= np.pi else angle - 2 * np.pi


# %% active="ipynb" tags=["try"]
# turn(np.array([1.0, 2.0, 3.0, 4.0]), np.array([2.0, 3.0, 4.0, 1.0]))

# %% [markdown] tags=["hint"]
# After a turn to the left by $m$ beams, beam 0 sees what beam $m$ saw before.

# %% [markdown] tags=["hint"]
# For every $m$ compute the sum of `after[j] * before[j + m]`, with the index wrapped; the largest
# sum wins.

# %% [markdown] tags=["hint"]
# `np.roll(before, -m)` is `before[j + m]`. Then multiply $m$ by the distance of two beams and
# wrap: an angle above $\pi$ is a turn to the right.


# %% tags=["cases"]
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


def _turn_drawn(ax: Any, function: Any) -> None:
    """Draw a scan and, turned back by the answer, the one after a turn of 108 degrees."""
    from slamlab import plots

    before, after = (_scan_of_room([1.2, 1.0, turn], 60) for turn in (0.0, 0.6 * np.pi))
    beams = 2 * np.pi * np.arange(60) / 60
    angle = float(function(before, after))
    for scan, turn, kind in ((before, 0.0, "lidar"), (after, angle, "estimate")):
        ends = scan[:, None] * np.column_stack([np.cos(beams + turn), np.sin(beams + turn)])
        marks = {"lidar": "o", "estimate": "x"}[kind]
        ax.plot(*ends.T, marks, color=plots.COLOURS[kind], mfc="none", markersize=5)
    ax.plot(0, 0, "o", color=plots.COLOURS["truth"])
    plots.floor(ax)


check_turn = Check(
    turn,
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
    picture=_turn_drawn,
)


# %% tags=["mistakes"]
def _wrapped(angle: float) -> float:
    return float(np.pi - (np.pi - angle) % (2 * np.pi))


check_turn.mistakes = {
    "the sign is turned: a robot that turns left sees at beam 0 what it saw on its left": (
        lambda before, after: _wrapped(-turn(before, after))
    ),
    "this is a number of beams, as P5's `Whatangle` returns: multiply by 2 pi / N": (
        lambda before, after: turn(before, after) * len(before) / (2 * np.pi)
    ),
    "this is a number of beams, and not wrapped: a turn to the right is negative": (
        ("m * 2 * np.pi / N => m"),
        ("angle if angle <= np.pi else angle - 2 * np.pi => angle"),
    ),
    "these are degrees: expected radians": (lambda before, after: np.rad2deg(turn(before, after))),
    "not wrapped: a turn to the right is negative, in (-pi, pi]": (
        "angle if angle <= np.pi else angle - 2 * np.pi => angle"
    ),
    "half a turn is pi, not -pi": "<= np.pi => < np.pi",
    "N beams share the full circle: their distance is 2 pi / N, not 2 pi / (N - 1)": (
        lambda before, after: turn(before, after) * len(before) / (len(before) - 1)
    ),
    "this follows the longest beam, as P5 does: one disturbed beam decides; use them all": (
        lambda a, b: _wrapped((np.argmax(a) - np.argmax(b)) * 2 * np.pi / len(a))
    ),
    "this is the worst alignment: the correlation is largest where the scans agree": (
        "argmax => argmin"
    ),
    "the difference at the best shift was returned: expected the shift itself": (
        ("irfft(product, N).argmax() => irfft(product, N).max()"),
        ("m * 2 * np.pi / N => m"),
        ("angle if angle <= np.pi else angle - 2 * np.pi => angle"),
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: how far did it turn?
#
# All beams vote. One FFT for each scan, the product of one with the conjugate of the other, and
# back: the correlation at every shift at once.

# %% [markdown] tags=["solution"]
# Following the longest beam, as P5's `Whatangle` does, needs no correlation. After a turn by whole
# beams it works as long as this beam stays the longest. A door that opens elsewhere is enough:

# %% active="ipynb" tags=["solution"]
# def longest_beam(before, after):
#     N = len(before)
#     angle = (before.argmax() - after.argmax()) * 2 * np.pi / N
#     return np.pi - (np.pi - angle) % (2 * np.pi)
#
# check_turn(longest_beam)

# %% [markdown] tags=["statement"]
# ## Exercise 4: between two beams, a bug to find
#
# The correlation is known at whole beams. Through its largest value and the two beside it goes a
# parabola, and its top gives the turn to a fraction of a beam. This version was tested with turns
# of 40 to 120 degrees, and passed. A robot that hardly turns at all gets worse answers from it
# than without it.


# %% tags=["exercise"]
def refined(R: Array) -> float:
    """Turn at the top of the correlation.

    Parameters
    ----------
    R : ndarray, shape (N,)
        Correlation of two scans at turns of 0 to N - 1 beams to the left, N at least
        3. It has one largest value.

    Returns
    -------
    float
        Angle (rad) in (-pi, pi], to a fraction of a beam.
    """
    n, m = len(R), np.argmax(R)
    before, top, after = R[m - 1], R[m], R[(m + 1) % n]
    shift = 0.5 * (before - after) / (before - 2 * top + after)
    return np.pi - (np.pi - (m + shift) * 2 * np.pi / n) % (2 * np.pi)


# %% active="ipynb" tags=["stub"]
#     n, m = len(R), np.argmax(R)
#     before, top, after = R[max(m - 1, 0)], R[m], R[min(m + 1, n - 1)]
#     shift = 0.5 * (before - after) / (before - 2 * top + after)
#     return np.pi - (np.pi - (m + shift) * 2 * np.pi / n) % (2 * np.pi)

# %% active="ipynb" tags=["try"]
# refined(np.array([5.0, 4.0, 1.0, 0.5, 1.0, 2.0]))

# %% [markdown] tags=["hint"]
# In the call above the largest value stands first. Which two values are its neighbours, if the
# beams form a ring?

# %% [markdown] tags=["hint"]
# `max` and `min` keep the index inside the list. A ring is not a list: what does `R[-1]` give,
# and what does `%` do to `N`?


# %% tags=["cases"]
@drawn
def _peak(rng: np.random.Generator, at: int | None = None, n: int | None = None) -> Any:
    """Draw a ring with its top near a beam, a parabola round it and less elsewhere."""
    count = n or int(rng.integers(5, 30))
    m = int(rng.integers(count)) if at is None else at % count
    away = (np.arange(count) - m - rng.uniform(-0.45, 0.45) + count / 2) % count - count / 2
    R = rng.uniform(20, 90) - rng.uniform(0.5, 2) * np.minimum(away**2, 6)
    return (np.round(R + rng.uniform(-0.05, 0.05, count), 3),)


def _refined_drawn(ax: Any, function: Any) -> None:
    """Draw the error of small turns, in whole beams dashed, and refined between them."""
    from slamlab import plots

    turns, beams, k = np.linspace(-20, 20, 61), 2 * np.pi * np.arange(40) / 40, np.arange(1, 6)
    wall = np.array([0.9, 0.6, 0.4, 0.3, 0.2])  # harmonics of a smooth room
    before = np.fft.rfft(3 + np.cos(np.outer(beams, k) + k**2) @ wall)
    rounded: list[float] = []
    refined: list[float] = []
    for degrees in turns:
        angles = np.outer(beams + np.deg2rad(degrees), k)
        after = np.fft.rfft(3 + np.cos(angles + k**2) @ wall)
        R = np.fft.irfft(before * np.conj(after), 40)
        for found, into in ((np.argmax(R) * 9.0, rounded), (np.degrees(function(R)), refined)):
            into.append((float(found) - degrees + 180) % 360 - 180)
    ax.axhline(0, **plots.line_style("truth"))
    ax.plot(turns, rounded, **plots.line_style("dead_reckoning"))
    ax.plot(turns, refined, **plots.line_style("estimate"))
    ax.set(xlabel="true turn (°)", ylabel="error (°)", ylim=(-8, 8))


check_refined = Check(
    refined,
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
    tolerance=1e-8,
    picture=_refined_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
_NEXT = "R[m - 1], R[m], R[(m + 1) % n]"


check_refined.mistakes = {
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
        "return np.pi - (np.pi - (m + shift) * 2 * np.pi / n) % (2 * np.pi) => return m + shift"
    ),
    "these are degrees: expected radians": lambda R: np.rad2deg(refined(R)),
    "not wrapped: a turn to the right is negative, in (-pi, pi]": (
        "np.pi - (np.pi - (m + shift) * 2 * np.pi / n) % (2 * np.pi)"
        " => (m + shift) * 2 * np.pi / n"
    ),
    "this is the height of the top: expected its place": (lambda R: float(R.max())),
}

# %% [markdown] tags=["solution"]
# ## Solution 4: between two beams, a bug to find
#
# Where the largest value stands at an end of the list, the old version takes it for its own
# neighbour: a parabola through two equal values has its top half-way between them, so a robot
# that has not turned seems to have turned by half a beam. `R[-1]` is right already; the other
# end needs the remainder.

# %% [markdown] tags=["solution"]
# Leaving the top alone at both ends is off by up to half a beam there, where the old version may
# be off by a whole one. It gives away the fraction just where a robot that drives straight on
# needs it:

# %% active="ipynb" tags=["solution"]
# def not_at_the_ends(R):
#     m = np.argmax(R)
#     if 0 < m < len(R) - 1:
#         return refined(R)
#     return np.pi - (np.pi - m * 2 * np.pi / len(R)) % (2 * np.pi)
#
# check_refined(not_at_the_ends)

# %% [markdown] tags=["statement"]
# ## Exercise 5: the second-best place
#
# A map has proposed places, and each has been given a misfit. Report the best one, the best one
# *elsewhere*, and how much worse it fits. A robot that gets a small margin knows that it does
# not know.


# %% tags=["exercise"]
def second_best(places: Array, misfits: Array, separation: float) -> tuple[int, int, float]:
    """Best place, best distinct place, and the margin between them.

    Parameters
    ----------
    places : ndarray, shape (k, 2)
        Candidates (m).
    misfits : ndarray, shape (k,)
        Mean misfit of a beam at each candidate (m).
    separation : float
        Places are distinct if they are farther apart than this (m). At least one
        candidate is distinct from the best.

    Returns
    -------
    best : int
        Row of the best candidate.
    second : int
        Row of the best candidate that is distinct from it.
    margin : float
        How much worse the second fits (m).
    """
    best = misfits.argmin()
    far = np.linalg.norm(places - places[best], axis=1) > separation
    second = np.where(far, misfits, np.inf).argmin()
    return best, second, misfits[second] - misfits[best]


# %% active="ipynb" tags=["try"]
# second_best(np.array([[1.0, 1.0], [1.0, 1.1], [3.0, 3.0]]),
#             np.array([0.01, 0.02, 0.03]), 0.5)

# %% [markdown] tags=["hint"]
# In a room without symmetry the place with the second-smallest misfit is nearly always a neighbour
# of the best one. It says nothing about ambiguity.

# %% [markdown] tags=["hint"]
# `np.linalg.norm(places - places[best], axis=1)` are the distances from the best place.

# %% [markdown] tags=["hint"]
# `np.where(far, misfits, np.inf).argmin()` finds the best among the far ones and keeps the
# numbering of the rows.


# %% tags=["cases"]
def _candidates(rng: np.random.Generator) -> Any:
    k = int(rng.integers(3, 15))
    places = np.round(rng.uniform(0, 3, (k, 2)), 2)
    misfits = np.round((rng.permutation(k) + 1) / 100 + rng.uniform(0, 0.005, k), 4)
    distance = np.linalg.norm(places - places[np.argmin(misfits)], axis=1).max()
    return places, misfits, float(np.round(rng.uniform(0.2, 0.9) * distance, 2))


def _second_drawn(ax: Any, function: Any) -> None:
    """Draw candidates, the darker the better, a star on the best and a ring on the second."""
    from slamlab import plots

    rng = np.random.default_rng(6)
    places = np.vstack([rng.normal([1, 1], 0.15, (8, 2)), rng.normal([3, 2.2], 0.2, (8, 2))])
    apart = np.minimum(*(np.hypot(*(places - one).T) for one in ([1, 1], [3, 2.2])))
    misfits = 0.02 + 0.2 * apart + 0.02 * (places[:, 0] > 2)
    for place, misfit in zip(places, misfits, strict=True):
        shade = plots.COLOURS["estimate"]
        ax.plot(*place, "o", color=shade, alpha=float(0.02 / misfit), markersize=8, mew=0)
    best, second, _ = function(places, misfits, 0.6)
    ax.plot(*places[int(best)], "*", color=plots.COLOURS["truth"], markersize=15, mfc="none")
    ax.plot(*places[int(second)], "o", color=plots.COLOURS["truth"], markersize=14, mfc="none")
    plots.floor(ax)


check_second_best = Check(
    second_best,
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
    draws=12,
    picture=_second_drawn,
)

# %% tags=["mistakes"]
_FAR = "np.linalg.norm(places - places[best], axis=1) > separation"


check_second_best.mistakes = {
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
    "this is the farthest place: expected the best fit of those far enough": (
        "np.where(far, misfits, np.inf).argmin()"
        " => np.argmax(np.linalg.norm(places - places[best], axis=1))"
    ),
    "this is the first place far enough: expected the best fit of those": (
        "np.where(far, misfits, np.inf).argmin() => np.argmax(far)"
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
    "the row was counted among the places left over: expected rows of `places`": (
        "return best, second, => return best, far[:second].sum(),"
    ),
    "best and second are exchanged": (
        lambda *case: (second_best(*case)[1], second_best(*case)[0], second_best(*case)[2])
    ),
    "the best fit has the smallest misfit, not the largest": (
        ("best = misfits.argmin() => best = misfits.argmax()"),
        ("np.where(far, misfits, np.inf) => np.where(far, -misfits, np.inf)"),
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: the second-best place
#
# Setting the near places to infinity keeps the numbering of the rows, which cutting them out
# would not.

# %% [markdown] tags=["solution"]
# In a room without symmetry the second-smallest misfit mostly belongs to a place next door. Its
# margin is small: in three rooms a flag made from it went up for every robot, and said nothing:

# %% active="ipynb" tags=["solution"]
# def second_smallest(places, misfits, separation):
#     best, second = np.argsort(misfits)[:2]
#     return best, second, misfits[second] - misfits[best]
#
# check_second_best(second_smallest)

# %% [markdown] tags=["statement"]
# ## Exercise 6: where am I?
#
# Now assemble. A map holds one scan for each of its places, all taken while looking along x. A
# robot somewhere in it takes a scan, turned by whatever its heading is. In three steps:
#
# 1. Signatures: the moduli of the harmonics 0 to 7, of every scan of the map and of the new one.
#   The `nearest` places by the length of the difference are candidates.
# 2. Each candidate is turned by `turn` of exercise 3, and its misfit is the mean absolute
#   difference of the beams.
# 3. The best candidate gives the place, its turn the heading. The margin tells how much worse the
#   best candidate elsewhere fits.
#
# The check also takes twenty scans in the room of the thesis, with a place of the map every 20
# cm. Nine in ten must be found within 20 cm and 9 degrees.


# %% tags=["exercise"]
def locate(
    places: Array, scans: Array, scan: Array, nearest: int, separation: float
) -> tuple[Array, float]:
    """Pose of a robot from one scan.

    Parameters
    ----------
    places : ndarray, shape (P, 2)
        Places of the map (m).
    scans : ndarray, shape (P, N)
        Their scans (m), taken with heading 0.
    scan : ndarray, shape (N,)
        What the robot sees now (m).
    nearest : int
        Number of candidates.
    separation : float
        Candidates farther than this from the best one are distinct (m).

    Returns
    -------
    pose : ndarray, shape (3,)
        Place (m) and heading (rad) of the best candidate.
    margin : float
        How much worse the best distinct candidate fits (m); inf if there is none.
    """
    apart = np.abs(np.fft.rfft(scans))[:, :8] - np.abs(np.fft.rfft(scan))[:8]
    rows = np.argsort(np.linalg.norm(apart, axis=1))[:nearest]
    turns = np.array([turn(scans[row], scan) for row in rows])
    beams = np.rint(turns * len(scan) / (2 * np.pi)).astype(int)
    misfits = np.array(
        [np.mean(np.abs(np.roll(scans[row], -m) - scan)) for row, m in zip(rows, beams)]
    )
    best = misfits.argmin()
    far = np.linalg.norm(places[rows] - places[rows[best]], axis=1) > separation
    margin = misfits[far].min() - misfits[best] if far.any() else np.inf
    return np.append(places[rows[best]], turns[best]), margin


# %% active="ipynb" tags=["try"]
# scan = np.array([2.0, 3.0, 4.0, 1.0])
# locate(np.zeros((1, 2)), np.array([[1.0, 2.0, 3.0, 4.0]]), scan, 1, 0.5)

# %% [markdown] tags=["hint"]
# `np.abs(np.fft.rfft(scans))[:, :8]` are all signatures of the map at once. `np.argsort` of the
# distances gives the candidates as rows of the map.

# %% [markdown] tags=["hint"]
# `turn(before, after)` takes the scan of the map first. A heading of $m$ beams means that the
# robot's beam 0 sees what the map's beam $m$ sees: compare with `np.roll(scans[row], -m)`.

# %% [markdown] tags=["hint"]
# `second_best` promises a distinct candidate, and here there may be none. Ask first whether any
# is far enough.


# %% tags=["cases"]
@drawn
def _map_of_scans(
    rng: np.random.Generator, places: int, beams: int, turn: int | None = None, twin: bool = False
) -> Any:
    """Draw a map of scans, and a scan near one of its places, turned and with noise."""
    where = np.round(rng.uniform(-2, 2, (places, 2)), 2)
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


def _locate_drawn(ax: Any, function: Any) -> None:
    """Draw the room of the thesis, twenty robots in it, and where each is located."""
    from slamlab import plots

    places, scans, taken, truth = _room()
    plots.occupancy(ax, 0.5 * rooms.thesis_room().occupied, [0, 4, 0, 4])
    found = np.array([function(places, scans, scan, 8, 0.3)[0] for scan in taken])
    for poses, kind in ((truth, "truth"), (found, "estimate")):
        ax.plot(*poses[:, :2].T, "o", color=plots.COLOURS[kind], mfc="none", markersize=5)
        for x, y, heading in poses:
            nose = [x + 0.25 * np.cos(heading), y + 0.25 * np.sin(heading)]
            plots.path(ax, np.array([[x, y], nose]), kind)
    plots.floor(ax)
    ax.set(xlim=(-0.1, 4.1), ylim=(-0.1, 4.1))


check_locate = Check(
    locate,
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
    tolerance=1e-8,
    use=_located,
    picture=_locate_drawn,
)

# %% tags=["mistakes"]
check_locate.mistakes = {
    "the scans were compared as they are: turn each candidate to fit first": (
        "turn(scans[row], scan) for => 0.0 for"
    ),
    "the place is that of the nearest signature: the signature proposes, the scan decides": (
        "best = misfits.argmin() => best = 0"
    ),
    "all places were compared: only the nearest by signature are candidates": (
        "[:nearest] => [:]"
    ),
    "the heading has the wrong sign: the map looks along 0, the robot has turned left": (
        "turns[best]) => -turns[best])"
    ),
    "the candidates were turned the wrong way": (
        "np.roll(scans[row], -m) => np.roll(scans[row], m)"
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
    "without a distinct candidate the place is unique: the margin is infinite": (
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
        "np.mean(np.abs(np.roll(scans[row], -m) - scan))"
        " => np.mean((np.roll(scans[row], -m) - scan) ** 2)"
    ),
    "the sum of the differences was taken: the misfit is their mean": (
        "np.mean(np.abs(np.roll(scans[row], -m) - scan))"
        " => np.sum(np.abs(np.roll(scans[row], -m) - scan))"
    ),
    "exactly at the separation is not farther": "> separation => >= separation",
}

# %% [markdown] tags=["solution"]
# ## Solution 6: where am I?
#
# The signature proposes, the scan decides, and the margin says whether to believe it.

# %% [markdown] tags=["solution"]
# Why not take the nearest signature and be done? In the room of the thesis that would do. But a
# signature has lost the phases, and cannot tell a place from its mirror image:

# %% active="ipynb" tags=["solution"]
# def by_signature(places, scans, scan, nearest, separation):
#     apart = np.abs(np.fft.rfft(scans))[:, :8] - np.abs(np.fft.rfft(scan))[:8]
#     rows = np.argsort(np.linalg.norm(apart, axis=1))[:nearest]
#     heading = turn(scans[rows[0]], scan)
#     margin = locate(places, scans, scan, nearest, separation)[1]
#     return np.append(places[rows[0]], heading), margin
#
# check_locate(by_signature)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 19](../solutions/19_autocorrelation_localization.ipynb).
