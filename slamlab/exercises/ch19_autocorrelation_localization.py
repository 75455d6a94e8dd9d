"""Exercises, chapter 19: one signature, a lost beam, two lidars, a ring's tip, twins, a place.

The map's lidar has more beams than the robot's, and some of the robot's beams do not return.
"""

# mypy: disable-error-code="return-value"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from slamlab.exercises._draw import drawn
from slamlab.exercises._report import Array, Check, Function, Ints
from slamlab.localization import spectrum
from slamlab.sensors import Lidar
from slamlab.worlds import BitmapWorld, free_poses, rooms

__all__ = [
    "check_between_beams",
    "check_hypotheses",
    "check_locate",
    "check_lost_beam",
    "check_same_signature",
    "check_slide",
]


# %% [markdown] tags=["chapter"]
# # Exercises 19: autocorrelation localization
#
# A good lidar has mapped a building; now a cheap robot with few beams is to find itself in that
# map. Six exercises: another scan with the same signature; a number that the map has lost; the
# scan of the cheap lidar on the ring of the good one; a bug to find; a hall with four twins; and
# all of it assembled in that hall, where after a power cut forty robots ask where they are. The
# chapter is [Autocorrelation localization](../19_autocorrelation_localization.ipynb). Replace each
# `...` and run the check below it as often as you like; then draw what you built beside what is
# expected.
#
# In all exercises beam 0 looks straight ahead, the beams go counterclockwise and are spread
# evenly over the full circle, and the scans of the map were taken with heading 0, along x.

# %% [markdown] tags=["solution"]
# # Solutions 19: autocorrelation localization
#
# The exercises are in [Exercises 19](../exercises/19_autocorrelation_localization.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.localization import spectrum

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
#
# from slamlab.exercises.ch19_autocorrelation_localization import square_hall, thesis_room
# from slamlab.localization import spectrum

# %% [markdown] tags=["statement"]
# ## Exercise 1: another scan, the same signature
#
# A museum is offered robots that find their place by the signature alone: no scan is compared
# afterwards. Two different places with one signature? That never happens, says the seller. You
# are the museum's engineer, and answer with an example: for the scan of a place make another scan
# with exactly the same autocorrelation, which is neither the first one turned nor mirrored. (What
# you make is a *scan*. Only with all ranges positive could a lidar measure it: about three of ten
# pairs of places in the thesis' room give such a scan.)
#
# The autocorrelation keeps the amplitude $|D_k|$ of each harmonic and loses its phase. So keep the
# amplitudes of `scan`, and take the phases of `other`, the scan of some other place.
#
# Before you run it: what must come out if `other` is `scan`, turned by a beam? And what of 1, 5, 6
# with the phases of 2, 3, 7, where both have the same $R$ = 62, 41, 41?


# %% tags=["exercise"]
def same_signature(scan: Array, other: Array) -> Array:
    """Make a scan with the amplitudes of one scan and the phases of another.

    Parameters
    ----------
    scan : ndarray, shape (N,)
        Ranges (m) at a place, N at least 2.
    other : ndarray, shape (N,)
        Ranges (m) at another place; none of its harmonics is zero.

    Returns
    -------
    ndarray, shape (N,)
        The new scan (m), real numbers. (Some may be negative: such a scan cannot be
        measured.)
    """
    amplitude = np.abs(np.fft.rfft(scan))
    phase = np.angle(np.fft.rfft(other))
    return np.fft.irfft(amplitude * np.exp(1j * phase), len(scan))


# %% active="ipynb" tags=["try"]
# same_signature(np.array([1.0, 5.0, 6.0]), np.array([2.0, 3.0, 7.0]))

# %% [markdown] tags=["hint"]
# A complex number is $D_k = |D_k|\,e^{i\varphi_k}$. NumPy gives the one factor by `np.abs`, the
# angle of the other by `np.angle`, and all harmonics of a scan by `np.fft.rfft`.

# %% [markdown] tags=["hint"]
# From harmonics back to beams: which function of `np.fft` undoes `rfft`? Five beams have three
# harmonics, and four beams as well. How does it know how many beams you want?


# %% tags=["cases"]
@drawn
def _pair(rng: np.random.Generator, n: int | None = None) -> Any:
    count = n or int(rng.integers(6, 30))
    return tuple(np.round(rng.uniform(0.5, 9, (2, count)), 2))


def _ranges(same_signature: Function, scan: Array, other: Array) -> Any:
    """Return the new scan; complex numbers are refused, even with nothing imaginary in them."""
    made = same_signature(scan, other)
    if np.iscomplexobj(made):
        raise TypeError("complex numbers came: expected ranges (m), after the way back to beams")
    return made


def _same_signature_drawn(ax: Any, function: Any) -> None:
    """Draw the scan of a place (black), and another with the same signature (blue)."""
    from slamlab import plots

    at = np.array([[1.2, 1.7, 0.0], [2.7, 2.6, 0.0]])
    scan, other = Lidar(120).scan(rooms.thesis_room(), at)
    made = np.asarray(_ranges(function, scan, other), float).reshape(120)
    beams = 2 * np.pi * np.arange(120) / 120
    for ranges, kind in ((scan, "truth"), (made, "estimate")):
        ends = ranges[:, None] * np.column_stack([np.cos(beams), np.sin(beams)])
        ax.plot(*np.vstack([ends, ends[:1]]).T, color=plots.COLOURS[kind], lw=1.2)
    ax.plot(0, 0, "o", color=plots.COLOURS["truth"], ms=4)
    plots.floor(ax)
    one, two = (spectrum(ranges, 61) / np.sqrt(120) for ranges in (scan, made))
    ax.set_title(
        f"signatures {np.linalg.norm(one - two):.2f} m apart,\n"
        f"ranges {slide(scan, made).min():.2f} m, best turned"
    )


check_same_signature = Check(
    same_signature,
    "scan",
    {
        "three beams, of one signature": ([1.0, 5.0, 6.0], [2.0, 3.0, 7.0]),
        "an even number of beams": (
            [5.0, 1.0, 4.0, 2.0, 8.0, 3.0],
            [2.0, 7.0, 1.0, 4.0, 4.0, 6.0],
        ),
        "the other is the scan, turned": ([5.0, 1.0, 4.0, 2.0, 8.0], [8.0, 5.0, 1.0, 4.0, 2.0]),
        "two beams": _pair(2),
        "seven beams": _pair(7),
        "any two scans": _pair(),
    },
    use=_ranges,
    picture=_same_signature_drawn,
)


# %% tags=["mistakes"]
_MADE = "np.fft.irfft(amplitude * np.exp(1j * phase), len(scan))"


check_same_signature.mistakes = {
    "exchanged: these are the amplitudes of the other scan, with the phases of the first": (
        lambda scan, other: same_signature(other, scan)
    ),
    "all phases are zero here: take those of the other scan": "np.exp(1j * phase) => 1",
    "the phases have the wrong sign: this is the mirror image": "1j * phase => -1j * phase",
    "the phases of both were added: expected those of the other scan alone": (
        "np.angle(np.fft.rfft(other)) => np.angle(np.fft.rfft(other) * np.fft.rfft(scan))"
    ),
    "this is the scan itself: expected the phases of the other": lambda scan, other: scan,
    "this is the scan, mirrored: expected another": lambda scan, other: scan[::-1],
    "this is the scan, turned: expected another": lambda scan, other: np.roll(scan, 1),
    "these are squares of amplitudes": (
        "np.abs(np.fft.rfft(scan)) => np.abs(np.fft.rfft(scan)) ** 2"
    ),
    "the amplitudes of both were multiplied: expected those of the first scan alone": (
        "np.abs(np.fft.rfft(scan)) => np.abs(np.fft.rfft(scan) * np.fft.rfft(other))"
    ),
    "only the cosine of the phase was taken: the sine belongs to it": (
        "np.exp(1j * phase) => np.cos(phase)"
    ),
    "the arc tangent knows half of the circle only: `np.angle` knows all of it": (
        "np.angle(np.fft.rfft(other))"
        " => np.arctan(np.fft.rfft(other).imag / np.fft.rfft(other).real)"
    ),
    "the number of beams was lost: `irfft` makes an even number unless it is given": (
        ", len(scan)) => )"
    ),
    "the amplitudes are scaled as in the lesson's (B): here take |D_k| as it is": (
        "np.abs(np.fft.rfft(scan)) => spectrum(scan, len(scan) // 2 + 1)"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: another scan, the same signature
#
# Moving a scan on by $m$ beams subtracts $2\pi k m/N$ from the phase of the $k$-th harmonic, and a
# mirror image changes the sign of all phases. Other phases make another scan, and none of them
# changes the autocorrelation. So *the other is the scan, turned* gives the turned scan, and 1, 5,
# 6 with the phases of 2, 3, 7 is 2, 3, 7. Such scans are called **homometric** ([page
# 19b](../19b_autocorrelation_localization.ipynb)). That the phases come from a real scan keeps the
# result real: the mean has phase 0, and the last harmonic of an even number of beams has 0 or
# $\pi$.

# %% [markdown] tags=["solution"]
# How often does it make something that a lidar could measure, and how different is it? Two hundred
# pairs of places in the room of the thesis; *apart* is the mean of $|d - e|$ at the best turn:

# %% active="ipynb" tags=["solution"]
# places, stored, *_ = thesis_room()
# pairs = np.random.default_rng(1).integers(len(places), size=(200, 2))
# apart, same = [], []
# for scan, other in stored[pairs]:
#     made = same_signature(scan, other)
#     if made.min() > 0:
#         same.append(np.allclose(spectrum(made, 61), spectrum(scan, 61)))
#         apart.append(min(np.abs(np.roll(scan, m) - made).mean() for m in range(120)))
# print(f"{len(apart)} of 200 have positive ranges; the same signature: {all(same)}")
# print(f"apart: median {np.median(apart):.2f} m")

# %% [markdown] tags=["solution"]
# So the scan itself must decide, as in the lesson's second step. Among the places of one room such
# pairs are rare: there the nearest of 16 amplitudes is wrong in a few cases of a thousand. With
# all phases zero the signature is right, too, but every such scan is its own mirror image:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: the scan of a place (black), and another with the same signature (blue); with all phases zero the blue outline on the left is a mirror image of itself."}}
# def all_phases_zero(scan, other):
#     return np.fft.irfft(np.abs(np.fft.rfft(scan)), len(scan))
#
# check_same_signature.draw(all_phases_zero)

# %% [markdown] tags=["statement"]
# ## Exercise 2: a number that the map has lost
#
# A robot loads its map, and one record is damaged. In the scan of a place one range is `nan`, and
# of the autocorrelation stored beside it $R[0]$ as well. The rest is intact:
#
# $$
# R[\tau] = \sum_{j=0}^{N-1} d_j\, d_{(j - \tau) \bmod N} .
# $$
#
# The lesson says that $R$ loses the phases, so it does not give back a whole scan. But a
# single range? With a pencil: the scan is 5, 1, ?, 2, 8, 3, and $R[1] = 72$. Which of the six
# products of neighbours do you know? What is left for the others?


# %% tags=["exercise"]
def lost_beam(scan: Array, R: Array) -> float:
    """Range that is missing in a scan.

    Parameters
    ----------
    scan : ndarray, shape (N,)
        Ranges (m), N at least 2; all are positive, but for exactly one that is nan.
    R : ndarray, shape (N,)
        Autocorrelation of the whole scan (m^2): R[0] is nan, R[1] to R[N - 1] are
        without error.

    Returns
    -------
    float
        The missing range (m).
    """
    lost = int(np.flatnonzero(np.isnan(scan))[0])
    known = np.nan_to_num(scan)
    left = R[1] - known @ np.roll(known, 1)
    return left / (known[lost - 1] + known[(lost + 1) % len(scan)])


# %% active="ipynb" tags=["try"]
# lost_beam(
#     np.array([5.0, 1.0, np.nan, 2.0, 8.0, 3.0]),
#     np.array([np.nan, 72.0, 103.0, 60.0, 103.0, 72.0]),
# )

# %% [markdown] tags=["hint"]
# The beams form a ring of six corners, and $R[1]$ adds six products, one an edge. Four edges have
# both ends: $5 \cdot 1$, $2 \cdot 8$, and which two others?

# %% [markdown] tags=["hint"]
# The two edges that meet at the lost beam $x$ are worth $x$ times one neighbour and $x$ times the
# other. Together they are what the four leave of $R[1]$.

# %% [markdown] tags=["hint"]
# Which number in place of the `nan` takes its two edges out of the sum over the ring? And which
# are the two neighbours of beam 0, which those of the last beam?


# %% tags=["cases"]
@drawn
def _damaged(rng: np.random.Generator, n: int | None = None, at: int | None = None) -> Any:
    count = n or int(rng.integers(4, 30))
    scan = np.round(rng.uniform(0.5, 9, count), 2)
    R = np.array([scan @ np.roll(scan, tau) for tau in range(count)])
    scan[int(rng.integers(count)) if at is None else at] = R[0] = np.nan
    return scan, R


def _lost_beam_drawn(ax: Any, function: Any) -> None:
    """Draw a scan (circles), and each beam as it is found when it alone is lost (crosses)."""
    from slamlab import plots

    pose = [1.2, 1.0, 0.0]
    scan = Lidar(60).scan(rooms.thesis_room(), np.array(pose))
    R = np.array([scan @ np.roll(scan, tau) if tau else np.nan for tau in range(60)])
    found = np.array([function(np.where(np.arange(60) == k, np.nan, scan), R) for k in range(60)])
    found = np.clip(found.astype(float), -9, 9)
    beams = 2 * np.pi * np.arange(60) / 60
    for ranges, marks, kind in ((scan, "o", "truth"), (found, "x", "estimate")):
        ends = ranges[:, None] * np.column_stack([np.cos(beams), np.sin(beams)])
        ax.plot(*ends.T, marks, color=plots.COLOURS[kind], mfc="none", markersize=5)
    plots.floor(ax)
    right = np.sum(np.abs(found - scan) < 0.01)
    ax.set_title(f"{right} of 60 beams within 1 cm")


check_lost_beam = Check(
    lost_beam,
    "range",
    {
        "the scan of the pencil": (
            [5.0, 1.0, np.nan, 2.0, 8.0, 3.0],
            [np.nan, 72.0, 103.0, 60.0, 103.0, 72.0],
        ),
        "beam 0 is lost": _damaged(at=0),
        "the last beam is lost": _damaged(at=-1),
        "three beams": _damaged(3),
        "two beams": _damaged(2),
        "an odd number of beams": _damaged(9),
        "any scan": _damaged(),
    },
    tolerance=1e-6,
    picture=_lost_beam_drawn,
)

# %% tags=["mistakes"]
_BOTH = "known[lost - 1] + known[(lost + 1) % len(scan)]"


check_lost_beam.mistakes = {
    "a sum with nan in it is nan: put 0 for the lost range, and leave R[0] alone": (
        "np.nan_to_num(scan) => scan"
    ),
    "the lost beam has two neighbours: it is in two products": (f"({_BOTH}) => known[lost - 1]"),
    "the lost beam is in two products: with the beam after it, too": (
        f"({_BOTH}) => known[(lost + 1) % len(scan)]"
    ),
    "at an end of the list a neighbour is missing: the beams form a ring": (
        f"{_BOTH} => known[max(lost - 1, 0)] + known[min(lost + 1, len(scan) - 1)]"
    ),
    "the product of the last beam with the first is missing: the beams form a ring": (
        "known @ np.roll(known, 1) => known[1:] @ known[:-1]"
    ),
    "the known products are part of R[1]: subtract them": (
        "R[1] - known @ np.roll(known, 1) => R[1]"
    ),
    "R[0] is damaged, and not 0: R[1] is intact": "R[1] => np.nan_to_num(R)[0]",
    "the mean of the neighbours is a guess: R says more": (
        lambda scan, R: np.interp(
            np.flatnonzero(np.isnan(scan))[0],
            np.flatnonzero(~np.isnan(scan)),
            scan[~np.isnan(scan)],
            period=len(scan),
        )
    ),
    "the mean of the known ranges is a guess: R says more": lambda scan, R: np.nanmean(scan),
    "what is left over is x times the sum of both neighbours, not twice their sum": (
        f"({_BOTH}) => (2 * ({_BOTH}))"
    ),
    "divide by the sum of the neighbours, not by their mean": f"({_BOTH}) => (({_BOTH}) / 2)",
    "what is left over is x times the sum of the neighbours: divide by it": (
        f"left / ({_BOTH}) => left"
    ),
    "divide by the neighbours of the lost beam, not by all known beams": (
        f"({_BOTH}) => known.sum()"
    ),
    "the difference has the wrong sign: R[1] is the larger": (
        "R[1] - known @ np.roll(known, 1) => known @ np.roll(known, 1) - R[1]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: a number that the map has lost
#
# Four edges of the ring are known, $5 + 16 + 24 + 15 = 60$. The other 12 are $x\,(1 + 2)$, so the
# range was 4. It is linear in $x$, since no edge has the lost beam at both ends.

# %% [markdown] tags=["solution"]
# If $R[0]$ were intact, $x = \sqrt{119 - 103}$ would do. Every other $\tau$ does, too. That they
# agree shows that nothing else is damaged: with one more number wrong they agree by accident only.

# %% active="ipynb" tags=["solution"]
# known = np.array([5.0, 1.0, 0.0, 2.0, 8.0, 3.0])  # beam 2 is lost
# for tau, R in enumerate([72.0, 103.0, 60.0, 103.0, 72.0], start=1):
#     print((R - known @ np.roll(known, tau)) / (known[2 - tau] + known[(2 + tau) % 6]))

# %% [markdown] tags=["solution"]
# Closing the gap by the mean of the two neighbours is right on a wall, and wrong where a beam
# jumps from one obstacle to the next:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: a scan (circles), and each beam as it is found when it alone is lost (crosses); on the left the crosses miss where the range jumps from beam to beam."}}
# def mean_of_neighbours(scan, R):
#     lost = np.flatnonzero(np.isnan(scan))[0]
#     return (scan[lost - 1] + scan[(lost + 1) % len(scan)]) / 2
#
# check_lost_beam.draw(mean_of_neighbours)

# %% [markdown] tags=["statement"]
# ## Exercise 3: a cheap lidar in the map of a good one
#
# The map was made with $N$ beams. Your robot has a cheap lidar with $M$, where $N = kM$ ($k$ is a
# whole number, 1 or more), and where a beam meets glass it does not return: its range is `nan`.
# The robot's place is known, the nearest of the map; its heading is not.
# Slide its scan $d$ along the ring $e$ of that place. When the robot has turned left by
# $m$ beams *of the map*, its beam $j$ looks along the map's beam $kj + m$. For every $m$ from 0
# to $N - 1$ give the **misfit**: the mean of $|d - e|$ over the beams that returned, without the
# lesson's cap.
#
# Why not take the peak of the lesson's $C[m] = \sum_j e_{j + m}\, d_j$? Of 400 such scans in the
# room of the thesis its heading is off by more than 9° in 43, that of the least misfit in 0. On
# paper, for $k = 1$ and no beam lost: write out $\sum_j (d_j - e_{j + m})^2$. Only one of its
# three sums changes with $m$, and so the peak of $C$ is at the least sum of squares. The cheap
# lidar meets $e_{kj + m}$ instead of $e_{j + m}$. Which of the other two sums changes with $m$ if
# $k$ is 3, or if a $d_j$ is missing?


# %% tags=["exercise"]
def slide(stored: Array, scan: Array) -> Array:
    """Misfit of a scan at every turn of a place's ring.

    Parameters
    ----------
    stored : ndarray, shape (N,)
        Ranges (m) at a place of the map.
    scan : ndarray, shape (M,)
        Ranges (m) of the robot, nan where none returned; one or more did. N is a
        multiple of M.

    Returns
    -------
    ndarray, shape (N,)
        Mean size of the difference (m) over the beams that returned, if the robot has
        turned left by m = 0 to N - 1 beams of the map.
    """
    N, M = len(stored), len(scan)
    seen = np.isfinite(scan)
    at = (np.arange(N)[:, None] + N // M * np.arange(M)) % N
    return np.abs(stored[at] - scan)[:, seen].mean(axis=1)


# %% active="ipynb" tags=["try"]
# slide(np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), np.array([2.0, np.nan, 6.0]))

# %% [markdown] tags=["hint"]
# In the call above $k = 2$. With $m = 1$ the robot's beams look along the beams 1, 3 and 5 of the
# map, which read 2, 4 and 6. What is the misfit? And along which do they look with $m = 3$?

# %% [markdown] tags=["hint"]
# `stored[at]` takes the beams of the map whose numbers are in `at`. For one $m$: which numbers,
# if the map is a ring? A loop over $m$ will do.

# %% [markdown] tags=["hint"]
# A mean that meets a `nan` is `nan`. Take the beams that returned first, `np.isfinite(scan)`, or
# use `np.nanmean`.


# %% tags=["cases"]
@drawn
def _rings(rng: np.random.Generator, M: int, k: int, lost: int = 0) -> Any:
    stored, m = np.round(rng.uniform(0.5, 9, k * M), 2), int(rng.integers(k * M))
    scan = np.round(np.roll(stored, -m)[::k] + rng.normal(0, 0.05, M), 2)
    scan[rng.permutation(M)[:lost]] = np.nan
    return stored, scan


def _glassy(scans: Array, poses: Array) -> Array:
    """Take away the beams that meet one of two panes of glass in the room of the thesis."""
    M = scans.shape[1]
    angles = poses[:, 2:] + 2 * np.pi * np.arange(M) / M
    x, y = poses[:, :1] + scans * np.cos(angles), poses[:, 1:2] + scans * np.sin(angles)
    glass = ((x > 3.9) & (y > 1.2) & (y < 2.0)) | ((y > 3.9) & (x > 0.4) & (x < 1.0))
    seen: Array = np.where(glass, np.nan, scans)
    return seen


@lru_cache(maxsize=8)
def thesis_room(n: int = 40, seed: int = 4) -> Any:
    """Map of the thesis' room by a good lidar, and scans of robots with a cheap one.

    Parameters
    ----------
    n : int
        Number of robots.
    seed : int
        Of their poses and of the noise.

    Returns
    -------
    places : ndarray, shape (P, 2)
        A place every 10 cm (m).
    stored : ndarray, shape (P, 120)
        Scans of the map (m).
    marks : ndarray, shape (P, 8)
        Their amplitudes (m).
    scans : ndarray, shape (n, 24)
        Scans of the robots (m), with noise of 2 cm; nan where a beam meets glass.
    truth : ndarray, shape (n, 3)
        Poses of the robots.
    """
    world, rng = rooms.thesis_room(), np.random.default_rng(seed)
    places, stored, marks = _mapped(world)
    truth = free_poses(world, n, rng, 0.15)
    scans = Lidar(24).scan(world, truth) + rng.normal(0, 0.02, (n, 24))
    return places, stored, marks, _glassy(scans, truth), truth


@lru_cache(maxsize=2)
def _mapped(world: BitmapWorld) -> Any:
    grid = np.stack(np.meshgrid(np.arange(0.05, 4, 0.1), np.arange(0.05, 4, 0.1)), -1)
    places = grid.reshape(-1, 2)
    places = places[world.clearance(places) > 0.05]
    stored = Lidar(120).scan(world, np.column_stack([places, np.zeros(len(places))]))
    stored = np.round(stored, 4)
    return places, stored, spectrum(stored, 8) / np.sqrt(120)


def _slide_drawn(ax: Any, function: Any) -> None:
    """Draw a ring of the map, and the cheap lidar's scan turned to the least misfit (crosses)."""
    from slamlab import plots

    world, pose = rooms.thesis_room(), np.array([[0.4, 2.5, 17 * np.pi / 60]])
    stored = Lidar(120).scan(world, np.array([0.4, 2.5, 0.0]))
    scan = _glassy(Lidar(24).scan(world, pose), pose)[0]
    m = int(np.argmin(np.asarray(function(stored, scan), float).reshape(120)))
    for ranges, ahead, kind, size in ((stored, 0, "lidar", 4), (scan, m, "estimate", 7)):
        beams = 2 * np.pi * (np.arange(len(ranges)) / len(ranges) + ahead / 120)
        ends = ranges[:, None] * np.column_stack([np.cos(beams), np.sin(beams)])
        marks = {"lidar": "o", "estimate": "x"}[kind]
        ax.plot(*ends.T, marks, color=plots.COLOURS[kind], mfc="none", markersize=size)
    tip = 0.8 * np.array([np.cos(np.pi * m / 60), np.sin(np.pi * m / 60)])
    ax.plot([0, tip[0]], [0, tip[1]], color=plots.COLOURS["estimate"])
    plots.floor(ax)
    ax.set_title(f"found {3 * m}°, it has turned 51°")


check_slide = Check(
    slide,
    "misfits",
    {
        "six beams and three, one lost": (
            [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
            [2.0, np.nan, 6.0],
        ),
        "two equal lidars": _rings(7, 1),
        "a third of the beams": _rings(8, 3),
        "a fifth of the beams, four lost": _rings(9, 5, 4),
        "equal lidars, some beams lost": _rings(12, 1, 5),
        "only one beam returned": _rings(4, 3, 3),
        "a lidar of one beam": ([3.0, 1.0, 2.0], [1.5]),
    },
    picture=_slide_drawn,
)

# %% tags=["mistakes"]
_MEAN = "np.abs(stored[at] - scan)[:, seen].mean(axis=1)"


check_slide.mistakes = {
    "a mean with nan in it is nan: take the beams that returned": "[:, seen].mean => .mean",
    "a beam that did not return has no misfit: leave it out, do not take it for 0 m": (
        f"{_MEAN} => np.abs(stored[at] - np.nan_to_num(scan)).mean(axis=1)"
    ),
    "divide by the number of beams that returned, not by all": (
        f"{_MEAN} => np.nansum(np.abs(stored[at] - scan), axis=1) / M"
    ),
    "this is the sum of the differences: expected their mean": (".mean(axis=1) => .sum(axis=1)"),
    "this is the mean square: expected the mean of the absolute difference": (
        f"{_MEAN} => ((stored[at] - scan)[:, seen] ** 2).mean(axis=1)"
    ),
    "this is the root mean square: expected the mean of the absolute difference": (
        f"{_MEAN} => np.sqrt(((stored[at] - scan)[:, seen] ** 2).mean(axis=1))"
    ),
    "this is the largest difference: expected the mean": ".mean(axis=1) => .max(axis=1)",
    "this is the median: expected the mean": (
        f"{_MEAN} => np.median(np.abs(stored[at] - scan)[:, seen], axis=1)"
    ),
    "the size of the mean was taken: take the size of each difference, then the mean": (
        f"{_MEAN} => np.abs((stored[at] - scan)[:, seen].mean(axis=1))"
    ),
    "this is the lesson's product C[m]: with fewer beams its largest value is not the best fit": (
        f"{_MEAN} => np.nansum(stored[at] * scan, axis=1)"
    ),
    "the ring is turned the wrong way: beam j looks along the map's beam kj + m": (
        "np.arange(N)[:, None] + => -np.arange(N)[:, None] +"
    ),
    "the robot's beams are k of the map's apart: j was not multiplied by k": (
        "N // M * np.arange(M) => np.arange(M)"
    ),
    "the robot turns by single beams of the map: m was multiplied by k": (
        "np.arange(N)[:, None] + N // M * => N // M * np.arange(N)[:, None] + N // M *"
    ),
    "only turns by the robot's own beams were tried: expected all N of the map": (
        lambda stored, scan: slide(stored, scan)[:: len(stored) // len(scan)]
    ),
    "beyond its last beam the map was cut off: it is a ring": (
        "(np.arange(N)[:, None] + N // M * np.arange(M)) % N"
        " => np.minimum(np.arange(N)[:, None] + N // M * np.arange(M), N - 1)"
    ),
    "this is the turn of the least misfit: expected the misfits of all turns": (
        lambda stored, scan: slide(stored, scan).argmin()
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a cheap lidar in the map of a good one
#
# $\sum (d - e)^2 = \sum d^2 - 2 \sum d\,e + \sum e^2$. On a full ring of equal lidars the last sum
# runs over all beams of the map for every $m$. With $k > 1$, or with gaps, it runs over other
# beams for another $m$, and $C$ is large where the robot's beams meet far walls. A mean
# of differences has no such preference. (For equal lidars without gaps the peak of $C$ is at the
# least sum of squares, and the lesson's FFT finds it much faster.)

# %% [markdown] tags=["solution"]
# How often does that matter? Forty robots, ten times over, each with the ring of the nearest
# place; counted are the headings that are off by more than 9°:

# %% active="ipynb" tags=["solution"]
# def product(stored, scan):
#     N, k = len(stored), len(stored) // len(scan)
#     return [-np.nansum(np.roll(stored, -m)[::k] * scan) for m in range(N)]
#
# for way in (slide, product):
#     off = 0
#     for seed in range(10):
#         places, stored, _, scans, truth = thesis_room(seed=seed)
#         for scan, pose in zip(scans, truth):
#             row = np.linalg.norm(places - pose[:2], axis=1).argmin()
#             error = np.argmin(way(stored[row], scan)) * 2 * np.pi / 120 - pose[2]
#             off += abs((error + np.pi) % (2 * np.pi) - np.pi) > np.deg2rad(9)
#     print(f"{way.__name__}: {off} of 400 headings are off by more than 9°")

# %% [markdown] tags=["solution"]
# The product in the picture:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: a ring of the map, and the cheap lidar's scan turned to the least misfit (crosses); on the left the product turns the scan to a wrong heading."}}
# check_slide.draw(lambda stored, scan: np.array(product(stored, scan)))

# %% [markdown] tags=["statement"]
# ## Exercise 4: between two beams, a bug to find
#
# `slide` gives a ring of misfits, and its least value a heading in whole beams. Near that value
# the ring falls and rises like a V with two equally steep sides. Put through the least value and
# its two neighbours, the V has its tip *between* two beams, and the heading is no longer a whole
# number of beams.
#
# The program was tested with 120 beams and a dozen headings, and passed. Then it went into robots
# whose map and lidar both have 24 beams. Most of them drive into their docks straight. One in
# twelve or so arrives at a slant, by up to a whole beam, and always in the same docks. Find the
# bug. The picture has all turns with 24 beams: by whole beams (dashed) the heading is off by up to
# half a beam, between them it should be much better.


# %% tags=["exercise"]
def between_beams(misfits: Array) -> float:
    """Turn at the tip of the V.

    Parameters
    ----------
    misfits : ndarray, shape (N,)
        Misfits (m) at turns of 0 to N - 1 beams to the left, N at least 3. One is the
        least.

    Returns
    -------
    float
        Angle (rad) in (-pi, pi], positive to the left, to a fraction of a beam.
    """
    n = len(misfits)
    middle = np.roll(misfits, n // 2)
    k = middle.argmin()
    closed = np.hstack([middle[-1], middle, middle[0]])
    before, least, after = closed[k : k + 3]
    tip = k + 0.5 * (before - after) / (max(before, after) - least)
    angle = (tip - n // 2) * 2 * np.pi / n
    return np.pi - (np.pi - angle) % (2 * np.pi)


# %% active="ipynb" tags=["stub"]
#     n = len(misfits)
#     middle = np.roll(misfits, n // 2)
#     k = middle.argmin()
#     closed = np.hstack([middle[0], middle, middle[-1]])
#     before, least, after = closed[k : k + 3]
#     tip = k + 0.5 * (before - after) / (max(before, after) - least)
#     angle = (tip - n // 2) * 2 * np.pi / n
#     return np.pi - (np.pi - angle) % (2 * np.pi)

# %% active="ipynb" tags=["try"]
# round(np.rad2deg(between_beams(np.array([1.0, 2.0, 4.0, 5.0, 4.5, 3.0]))), 1)

# %% [markdown] tags=["hint"]
# Begin with the first NO, and a pencil: a ring of six beams, 60° apart. Where is its least value,
# and which are its two neighbours? On which side of it is the tip?

# %% [markdown] tags=["hint"]
# Print `middle`, `k`, `before`, `least` and `after` for that ring. Are the last three the numbers
# that you have written down?

# %% [markdown] tags=["hint"]
# The author turned the list so that a robot that has not turned has two neighbours. The cut is
# still somewhere. Which neighbours has an entry where the ring was cut?


# %% tags=["cases"]
@drawn
def _vee(rng: np.random.Generator, at: int | None = None, n: int | None = None) -> Any:
    """Draw a ring with its least value near a beam, a V round it and more elsewhere."""
    count = n or int(rng.integers(5, 30))
    m = int(rng.integers(count)) if at is None else at % count
    away = (np.arange(count) - m - rng.uniform(-0.45, 0.45) + count / 2) % count - count / 2
    ring = rng.uniform(0.02, 0.2) + rng.uniform(0.05, 0.4) * np.minimum(np.abs(away), 2.5)
    return (np.round(ring + rng.uniform(0, 0.004, count), 4),)


def _between_beams_drawn(ax: Any, function: Any) -> None:
    """Draw the error of every turn, in whole beams (dashed) and between beams (solid)."""
    from slamlab import plots

    world, place, step = rooms.thesis_room(), [1.2, 1.0], 15
    turns = np.linspace(0, 360, 217)
    stored = Lidar(24).scan(world, np.array([*place, 0.0]))
    poses = np.column_stack([np.full((217, 2), place), np.deg2rad(turns)])
    whole: list[float] = []
    fine: list[float] = []
    for scan, turned in zip(Lidar(24).scan(world, poses), turns, strict=True):
        ring = slide(stored, scan)
        for found, into in ((step * ring.argmin(), whole), (np.rad2deg(function(ring)), fine)):
            into.append((float(found) - turned + 180) % 360 - 180)
    ax.axhline(0, **plots.line_style("truth"))
    ax.plot(turns, whole, **plots.line_style("dead_reckoning"))
    ax.plot(turns, fine, **plots.line_style("estimate"))
    ax.set(xlabel="true turn (°)", ylabel="error (°)", ylim=(-16, 16))
    ax.set_title(f"off by at most {np.abs(fine).max():.1f}°")


check_between_beams = Check(
    between_beams,
    "turn",
    {
        "the least value exactly between equal neighbours": ([1.0, 3.0, 4.0, 5.0, 3.0],),
        "a tip between two beams": ([5.0, 2.0, 1.0, 3.0, 4.0, 4.0],),
        "three beams": ([2.0, 1.0, 4.0],),
        "no turn, or almost none": _vee(0),
        "a turn by almost one beam to the right": _vee(-1),
        "twelve beams": _vee(6, n=12),
        "nine beams, a turn to the left": _vee(4, n=9),
        "nine beams, a turn to the right": _vee(5, n=9),
        "any ring": _vee(),
    },
    tolerance=1e-8,
    picture=_between_beams_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
_NEXT = "closed[k : k + 3]"
_WRAP = "np.pi - (np.pi - angle) % (2 * np.pi)"


check_between_beams.mistakes = {
    "the neighbours were cut off at the ends of the list: after the last comes the first": (
        "[middle[-1], middle, middle[0]] => [middle[0], middle, middle[-1]]"
    ),
    "the neighbour before the first entry was cut off: it is the last one": (
        f"{_NEXT} => middle[max(k - 1, 0)], middle[k], middle[(k + 1) % n]"
    ),
    "the neighbour after the last entry was cut off: it is the first one": (
        f"{_NEXT} => middle[k - 1], middle[k], middle[min(k + 1, n - 1)]"
    ),
    "at the ends of the list the tip was left on its beam: the ring has no ends": (
        "tip = k + 0.5 * => tip = k + (0 < k < n - 1) * 0.5 *"
    ),
    "the tip was left on its beam: this is a whole number of beams": (
        "0.5 * (before - after) / (max(before, after) - least) => 0.0"
    ),
    "the tip is on the side of the smaller neighbour: the sign is reversed": (
        "k + 0.5 => k - 0.5"
    ),
    "the half in front of the fraction is missing": "0.5 * (before => (before",
    "the slope is that to the larger neighbour": "max(before, after) => min(before, after)",
    "this is the lesson's parabola: here a V is put through the three": (
        "(max(before, after) - least) => (before - 2 * least + after)"
    ),
    "this is a number of beams: multiply by 2 pi / N": f"return {_WRAP} => return tip - n // 2",
    "these are degrees: expected radians": lambda misfits: np.rad2deg(between_beams(misfits)),
    "not wrapped: more than half a turn to the right is less than half to the left": (
        f"{_WRAP} => angle"
    ),
    "the list was turned by n // 2 beams, and the turn was not taken off": (
        "(tip - n // 2) => tip"
    ),
    "the middle of an odd list is n // 2, not n / 2": "(tip - n // 2) => (tip - n / 2)",
}

# %% [markdown] tags=["solution"]
# ## Solution 4: between two beams, a bug to find
#
# A list has two ends. `closed` puts the first entry before the first and the last behind the last,
# so at an end the least value is its own neighbour. A V through two equal values has its tip
# half-way between them, so the answer is always half a beam beyond the list's end. On the ring the
# last entry comes before the first, and the first behind the last: exchange `middle[0]` and
# `middle[-1]`. (Without `closed`: `middle[k - 1]` and `middle[(k + 1) % n]`.)
#
# The list was cut open opposite to heading zero. Its ends are two beams of the map: of 120 one
# heading in sixty, which a dozen trials easily miss; of 24 one in twelve; of six one in three, and
# so the ring of six beams fails at 105° already.

# %% [markdown] tags=["solution"]
# Another cut does not help: it moves the fault to other robots. Nor does it help to leave the tip
# alone at the ends. Such a program is right nearly always, and rounds to whole beams there:

# %% active="ipynb" tags=["solution"]
# def not_at_the_ends(misfits):
#     n = len(misfits)
#     m = (misfits.argmin() + n // 2) % n
#     if 0 < m < n - 1:
#         return between_beams(misfits)
#     return np.pi - (np.pi - misfits.argmin() * 2 * np.pi / n) % (2 * np.pi)
#
# check_between_beams(not_at_the_ends)

# %% [markdown] tags=["statement"]
# ## Exercise 5: a hall with four twins
#
# A square hall looks the same after every quarter turn. A robot wakes up in it: its best answer is
# one of four poses that fit alike, and the lesson's second best names one more. The particles of
# chapter [04](../04_particle_filter.ipynb) need *all* that come into question, or they may begin
# without the right one. Report every pose that could be meant, the best first:
#
# - Go through the candidates from the least misfit upwards.
# - One pose is **elsewhere** than another if its place is farther away than `separation`, *or* if
#   its heading differs by more than 30°, the shorter way round. (Near the middle of the hall the
#   four twins are almost at one place, and differ in their headings.)
# - Report a candidate if it is elsewhere than **every pose reported before it**, whatever lies
#   between them that is not reported.
# - Its misfit must be less than the least one plus `margin`.
#
# In the picture two robots ask, one aside and one near the middle. Candidates are all places of
# the map, each with the heading that fits best there.


# %% tags=["exercise"]
def hypotheses(poses: Array, misfits: Array, separation: float, margin: float) -> Ints:
    """Rows of all poses that fit about as well as the best, apart from each other.

    Parameters
    ----------
    poses : ndarray, shape (k, 3)
        Candidates: x, y (m) and heading (rad) in (-pi, pi], one or more.
    misfits : ndarray, shape (k,)
        Misfit of each (m); no two are equal.
    separation : float
        A pose is elsewhere if it is farther away than this (m), or turned by more than
        30 degrees; exactly as far is not farther.
    margin : float
        A pose may be meant if it fits worse than the best by less than this (m),
        which is positive; by exactly as much is not less.

    Returns
    -------
    ndarray of int, shape (h,)
        Rows of `poses`, the best first; h is 1 if the answer is unique.
    """
    rows: list[int] = []
    for row in np.argsort(misfits):
        apart = np.linalg.norm(poses[rows, :2] - poses[row, :2], axis=1)
        turned = np.abs((poses[rows, 2] - poses[row, 2] + np.pi) % (2 * np.pi) - np.pi)
        elsewhere = (apart > separation) | (turned > np.deg2rad(30))
        if misfits[row] - misfits.min() < margin and np.all(elsewhere):
            rows.append(int(row))
    return np.array(rows)


# %% active="ipynb" tags=["try"]
# hypotheses(
#     np.array([[1, 1, 0.1], [1, 1.1, 0.0], [1, 1.1, 1.6], [3, 3, 0.0], [3, 1, 0.0]]),
#     np.array([0.01, 0.015, 0.018, 0.02, 0.09]), 0.5, 0.02,
# )

# %% [markdown] tags=["hint"]
# The lesson's second best sets all that is not elsewhere to infinity and takes the least of the
# rest. What if you do that again and again? When do you stop?

# %% [markdown] tags=["hint"]
# Or keep a list of the rows that you report, and go through `np.argsort(misfits)`. What must hold
# of a row, and of all rows in the list, before it is added?

# %% [markdown] tags=["hint"]
# Three poses in a line, 0.4 m apart, all with one heading, with misfits that rise along it, and a
# separation of 0.5 m: the second is too near the first. Does it keep the third from being
# reported?


# %% tags=["cases"]
@drawn
def _candidates(rng: np.random.Generator, most: int, room: float = 3.0) -> Any:
    k = int(rng.integers(most // 2, most))
    places = np.round(rng.uniform(0, room, (k, 2)), 2)
    headings = rng.choice([0.0, 1.5, 3.0, -3.0], k) + rng.uniform(-0.13, 0.13, k)
    misfits = np.round((rng.permutation(k) + 1) / 100 + rng.uniform(0, 0.005, k), 4)
    return (
        np.column_stack([places, np.round(headings, 2)]),
        misfits,
        float(np.round(rng.uniform(0.2, 0.5) * room, 3)),
        float(np.round(rng.uniform(0.3, 0.9) * k / 100 + 0.00003, 5)),
    )


@lru_cache(maxsize=1)
def _square_world() -> BitmapWorld:
    """Build a hall of 4 m that looks the same after every quarter turn."""
    quarter = np.zeros((400, 400), bool)
    quarter[:6] = True
    quarter[70:110, 60:170] = True
    quarter[110:150, 60:90] = True
    turned = [np.rot90(quarter, k) for k in range(4)]
    return BitmapWorld(np.logical_or.reduce(turned), 0.01)


@lru_cache(maxsize=8)
def square_hall(n: int = 40, seed: int = 2) -> Any:
    """Map of a hall with four twins, and scans of robots in it, as `thesis_room` gives them.

    The good lidar has a noise of 1 cm here, so that twins do not fit alike to the last digit;
    each of the four walls has a window.

    Parameters
    ----------
    n : int
        Number of robots.
    seed : int
        Of their poses and of the noise.

    Returns
    -------
    places, stored, marks, scans, truth : ndarray
        As in `thesis_room`.
    """
    world, rng = _square_world(), np.random.default_rng(seed)
    truth = free_poses(world, n, rng, 0.15)
    return *_hall_map(), _hall_scans(truth, rng), truth


@lru_cache(maxsize=1)
def _hall_map() -> Any:
    places, stored, _ = _mapped(_square_world())
    noise = np.random.default_rng(19).normal(0, 0.01, stored.shape)
    stored = np.round(stored + noise, 4)
    return places, stored, spectrum(stored, 8) / np.sqrt(120)


def _hall_scans(poses: Array, rng: np.random.Generator) -> Array:
    """Scan the hall with 24 beams, noise of 2 cm, and nothing back from four windows."""
    scans = Lidar(24).scan(_square_world(), poses) + rng.normal(0, 0.02, (len(poses), 24))
    angles = poses[:, 2:] + 2 * np.pi * np.arange(24) / 24
    x = poses[:, :1] + scans * np.cos(angles) - 2
    y = poses[:, 1:2] + scans * np.sin(angles) - 2
    for c, s in _QUARTERS:
        across, along = c * x - s * y, s * x + c * y
        scans[(across > 1.88) & (along > -0.8) & (along < 0)] = np.nan
    return scans


@lru_cache(maxsize=1)
def _two_asked() -> Any:
    """Return all candidates and their misfits for a robot aside and one near the middle."""
    asked = np.array([[0.5, 1.3, 0.7], [2.16, 1.93, -2.0]])
    places, stored, *_ = _hall_map()
    answers = []
    for scan in _hall_scans(asked, np.random.default_rng(3)):
        rings = [slide(one, scan) for one in stored]
        turns = np.array([[between_beams(ring)] for ring in rings])
        answers.append((np.hstack([places, turns]), np.array([ring.min() for ring in rings])))
    return asked, answers


def _twins(pose: Array) -> Array:
    """Return the four poses of the hall at which everything looks as at this one."""
    quarters = np.array([[c, s] for c, s in _QUARTERS])
    x, y = pose[:2] - 2
    c, s = quarters.T
    turned: Array = np.column_stack(
        [2 + c * x - s * y, 2 + s * x + c * y, pose[2] + np.arctan2(s, c)]
    )
    return turned


def _right(poses: Array, truth: Array) -> Any:
    """Say which poses are within 20 cm and 9 degrees of the true one."""
    turned = np.abs((poses[:, 2] - truth[2] + np.pi) % (2 * np.pi) - np.pi)
    return (np.hypot(*(poses[:, :2] - truth[:2]).T) < 0.2) & (turned < np.deg2rad(9))


def _noses(ax: Any, poses: Array, colour: str, length: float = 0.3) -> None:
    tips = poses[:, :2] + length * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    for a, b in zip(poses[:, :2], tips, strict=True):
        ax.plot(*np.array([a, b]).T, color=colour, lw=1.3)


def _rows(hypotheses: Function, *case: Any) -> Any:
    """Return the rows; numbers that cannot be used as rows of an array are refused."""
    rows = hypotheses(*case)
    kind = np.asarray(rows)
    if kind.ndim == 1 and kind.size and kind.dtype.kind == "f":
        raise TypeError("rows are float: expected int, so that `poses[rows]` works")
    return rows


def _hypotheses_drawn(ax: Any, function: Any) -> None:
    """Draw two robots in a hall (stars), and the answers to each (rings with headings)."""
    from slamlab import plots

    asked, answers = _two_asked()
    found = [np.asarray(_rows(function, *one, 0.5, 0.03)) for one in answers]
    if any(rows.ndim != 1 or rows.dtype.kind not in "iu" for rows in found):
        raise TypeError("expected a list of row numbers")
    plots.occupancy(ax, 0.5 * _square_world().occupied, [0, 4, 0, 4])
    met = []
    for truth, (poses, _), rows, kind in zip(
        asked, answers, found, ("estimate", "wrong"), strict=True
    ):
        colour = plots.COLOURS[kind]
        ax.plot(*poses[rows, :2].T, "o", color=colour, ms=7, mfc="none", mew=1.5)
        _noses(ax, poses[rows], colour, 0.45)
        ax.plot(*truth[:2], "*", color=plots.COLOURS["truth"], ms=9, mfc="none")
        met.append(sum(_right(poses[rows], twin).any() for twin in _twins(truth)))
    plots.floor(ax)
    ax.set(xlim=(-0.1, 4.1), ylim=(-0.1, 4.1))
    ax.set_title(
        f"twins: {met[0]} of 4 aside, {met[1]} of 4\n"
        f"near the middle; {sum(map(len, found))} answers"
    )


_QUARTERS = ((1, 0), (0, 1), (-1, 0), (0, -1))

check_hypotheses = Check(
    hypotheses,
    "rows",
    {
        "the only candidate": ([[1.5, -2.0, 3.0]], [0.2], 0.5, 0.01),
        "four twins, each with a neighbour": (
            [
                *([1, 1, 0.1], [1, 1.1, 0.2], [3, 1, 1.7], [3.1, 1, 1.6]),
                *([3, 3, -3.1], [3, 3.1, 3.1], [1, 3, -1.5], [1.1, 3, -1.4]),
            ],
            [0.014, 0.012, 0.011, 0.015, 0.013, 0.016, 0.019, 0.018],
            0.5,
            0.02,
        ),
        "near the middle: four headings": (
            [[2, 2, 0.3], [2, 2.1, 1.9], [2.1, 2, -2.8], [2, 1.9, -1.3], [2.1, 2.1, 0.2]],
            [0.013, 0.012, 0.014, 0.011, 0.015],
            2.5,
            0.02,
        ),
        "headings of 170° and -170° are 20° apart": (
            [[0, 0, np.deg2rad(170)], [0.1, 0, np.deg2rad(-170)], [0.2, 0, np.deg2rad(-140)]],
            [0.01, 0.02, 0.03],
            0.5,
            0.1,
        ),
        "turned by 29.9°, by 30.1°": (
            [[0, 0, 1.0], [0.1, 0, 1.0 + np.deg2rad(29.9)], [0.2, 0, 1.0 - np.deg2rad(30.1)]],
            [0.01, 0.02, 0.03],
            0.5,
            0.1,
        ),
        "three in a line: the one between is not reported": (
            [[0.0, 0.8, 1], [0.0, 0.4, 1], [0.0, 0.0, 1]],
            [0.03, 0.02, 0.01],
            0.5,
            0.1,
        ),
        "far from the best, near the second": (
            [[0.0, 0.0, 0], [2.0, 0.0, 0], [2.2, 0.0, 0], [2.0, -1.5, 0]],
            [0.01, 0.02, 0.03, 0.04],
            0.5,
            0.1,
        ),
        "exactly at the separation is not farther": (
            [[0, 0, 0], [3, 4, 0], [6, 8, 0]],
            [0.01, 0.02, 0.03],
            5.0,
            0.5,
        ),
        "exactly at the margin is not less": (
            [[0, 0, 0], [5, 0, 0], [0, 5, 0]],
            [0.5, 0.75, 0.625],
            1,
            0.25,
        ),
        "each a little worse than the one before": (
            [[0, 0, 0], [2, 0, 0], [4, 0, 0], [6, 0, 0], [8, 0, 0]],
            [0.01, 0.02, 0.03, 0.09, 0.1],
            1.0,
            0.015,
        ),
        "few candidates": _candidates(8),
        "many candidates": _candidates(40),
    },
    use=_rows,
    picture=_hypotheses_drawn,
)

# %% tags=["mistakes"]
_APART = "np.linalg.norm(poses[rows, :2] - poses[row, :2], axis=1)"
_TURNED = "np.abs((poses[rows, 2] - poses[row, 2] + np.pi) % (2 * np.pi) - np.pi)"


def _greedy(far: Function) -> Any:
    """Return a wrong answer with another rule; ``far(elsewhere, rows, better)``."""

    def answer(poses: Array, misfits: Array, separation: float, margin: float) -> Ints:
        rows: list[int] = []
        rank = [int(row) for row in np.argsort(misfits)]
        for row in rank:

            def elsewhere(others: Any, row: int = row) -> Any:
                turned = np.abs((poses[others, 2] - poses[row, 2] + np.pi) % (2 * np.pi) - np.pi)
                apart = np.linalg.norm(poses[others, :2] - poses[row, :2], axis=1)
                return (apart > separation) | (turned > np.deg2rad(30))

            better = rank[: rank.index(row)]
            if misfits[row] - misfits.min() < margin and far(elsewhere, rows, better):
                rows.append(row)
        return np.array(rows)

    return answer


check_hypotheses.mistakes = {
    "these are the best and the second best: a hall may have more twins": (
        "return np.array(rows) => return np.array(rows[:2])"
    ),
    "one place with two headings is two answers: compare the headings, too (in radians)": (
        "(apart > separation) | (turned > np.deg2rad(30)) => apart > separation"
    ),
    "farther away or turned: one of the two is enough": (
        "separation) | (turned => separation) & (turned"
    ),
    "the shorter way round: 170° and -170° are 20° apart": (
        f"{_TURNED} => np.abs(poses[rows, 2] - poses[row, 2])"
    ),
    "metres and radians were put into one distance: compare them one by one": (
        "(apart > separation) | (turned > np.deg2rad(30))"
        " => np.linalg.norm(poses[rows] - poses[row], axis=1) > separation"
    ),
    "to the right counts as well: take the size of the difference": (
        f"{_TURNED} => {_TURNED[6:]}"
    ),
    "each pose was compared with the best only: two neighbours of a twin are one answer": (
        _greedy(lambda elsewhere, rows, _: bool(np.all(elsewhere(rows[:1]))))
    ),
    "each pose was compared with the last one reported only": (
        _greedy(lambda elsewhere, rows, _: bool(np.all(elsewhere(rows[-1:]))))
    ),
    "a pose that is not reported keeps no other from being reported": (
        _greedy(lambda elsewhere, _, better: bool(np.all(elsewhere(better))))
    ),
    "elsewhere than one reported pose is not enough: than every one": (
        _greedy(lambda elsewhere, rows, _: not rows or bool(np.any(elsewhere(rows))))
    ),
    "neighbours were not left out: they are the same answer": ("and np.all(elsewhere) => "),
    "exactly at the separation is not farther": "> separation => >= separation",
    "exactly at the margin is not less": "< margin => <= margin",
    "the margin has no effect: a pose that fits badly is no answer": (
        "misfits[row] - misfits.min() < margin and => "
    ),
    "the margin counts from the best, not from the pose reported before": (
        "misfits.min() < margin => misfits[rows[-1] if rows else row] < margin"
    ),
    "the margin is a difference (m), not a share of the least misfit": (
        "misfits[row] - misfits.min() < margin => misfits[row] < (1 + margin) * misfits.min()"
    ),
    "the margin is how much worse a pose fits, not the misfit itself": (
        "misfits[row] - misfits.min() < margin and => (misfits[row] < margin or not rows) and"
    ),
    "squared distances were compared with the separation: take the root": (
        f"{_APART} => ((poses[rows, :2] - poses[row, :2]) ** 2).sum(axis=1)"
    ),
    "only x was compared: a place straight above is elsewhere, too": (
        f"{_APART} => np.abs(poses[rows, 0] - poses[row, 0])"
    ),
    "go through the candidates from the least misfit upwards, not in the order of the rows": (
        "np.argsort(misfits) => range(len(misfits))"
    ),
    "these are ranks: expected rows of `poses`": (
        lambda *case: np.argsort(np.argsort(case[1]))[hypotheses(*case)]
    ),
    "the right poses, in the order of the rows: expected the best first": (
        "return np.array(rows) => return np.sort(rows)"
    ),
    "these are the poses: expected their rows": lambda *case: case[0][hypotheses(*case)],
}

# %% [markdown] tags=["solution"]
# ## Solution 5: a hall with four twins
#
# This is non-maximum suppression, as in the detection of corners: the best of a neighbourhood is
# kept, its neighbours are dropped, and the next best goes on. In a room without symmetry the list
# nearly always has one row, and that is the lesson's unique answer.

# %% [markdown] tags=["solution"]
# The rule asks for poses *reported* before. If any better one may suppress another, then of three
# in a line the second, which is not reported itself, suppresses the third:

# %% active="ipynb" tags=["solution"]
# def elsewhere(others, pose, separation):
#     apart = np.linalg.norm(others[:, :2] - pose[:2], axis=1)
#     turned = np.abs((others[:, 2] - pose[2] + np.pi) % (2 * np.pi) - np.pi)
#     return (apart > separation) | (turned > np.deg2rad(30))
#
# def any_better_pose(poses, misfits, separation, margin):
#     rank = np.argsort(misfits)
#     return np.array([
#         row for k, row in enumerate(rank)
#         if misfits[row] - misfits.min() < margin
#         and elsewhere(poses[rank[:k]], poses[row], separation).all()
#     ])
#
# check_hypotheses(any_better_pose)

# %% [markdown] tags=["solution"]
# Without the headings three twins of the robot near the middle are lost. (Each candidate has one
# heading here, as in the lesson's `locate`: where one place fits with several headings, only the
# best of them comes into the list. The library tries the best place with other headings as well.)

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: two robots in a hall (stars), and the answers to each (rings with headings); on the left the robot near the middle has one answer instead of four."}}
# def places_only(poses, misfits, separation, margin):
#     return hypotheses(poses * [1, 1, 0], misfits, separation, margin)
#
# check_hypotheses.draw(places_only)

# %% [markdown] tags=["statement"]
# ## Exercise 6: forty robots in a hall with four twins
#
# After a power cut forty robots wake up in the hall, and each asks where it is. The map has a
# place every 10 cm, with the scan of 120 beams and its amplitudes. The robots have 24 beams with a
# noise of 2 cm, a window in each wall returns nothing, and each robot faces anywhere. They also
# have a cheap compass, good to 20°, root mean square. It cannot say where a robot is; it can
# choose from a list, if the right pose is in the list. Write down before: how many of the forty
# best answers will be right? How many lists hold the right pose? How many are right with list and
# compass?
#
# Now assemble. (The lesson's `locate` returns the best answer and the second best; yours returns
# every answer that could be meant.)
#
# 1. **Propose.** Close the gaps of the scan: a beam that did not return gets its value from the
#   straight line between the nearest beams on either side that did, along the *ring*. Take as many
#   amplitudes as the map has, with `spectrum`, the lesson's `amplitudes`; divide them by
#   $\sqrt M$, so that lidars of different beams compare. Candidates are the `nearest` places whose
#   `marks` differ least, by the length of the difference.
# 2. **Decide.** `slide` the scan, *with* its gaps, along the ring of each candidate. The least
#   value is its misfit, and `between_beams` gives its heading.
# 3. **Report.** The `hypotheses` among the candidates, as poses.
#
# The check takes the forty robots as well, with 30 candidates, a separation of 0.5 m and a margin
# of 3 cm: in nine lists of ten there must be a pose within 20 cm and 9° of the true one. The
# picture counts what the best, the list, and list and compass get right. A robot is blue if its
# best answer is right, orange if only its list holds the right one, and a black cross if neither
# does. It is a full dot if the compass picks the right pose from its list, a ring if not. Of one
# robot (star) all answers are drawn: thin rings with headings.


# %% tags=["exercise", "predict"]
def locate(
    places: Array,
    stored: Array,
    marks: Array,
    scan: Array,
    nearest: int,
    separation: float,
    margin: float,
) -> Array:
    """Poses where a robot may be, from one scan.

    Parameters
    ----------
    places : ndarray, shape (P, 2)
        Places of the map (m).
    stored : ndarray, shape (P, N)
        Their scans (m), taken with heading 0.
    marks : ndarray, shape (P, n)
        Their amplitudes (m): ``spectrum(stored, n) / np.sqrt(N)``.
    scan : ndarray, shape (M,)
        What the robot sees now (m), nan where a beam did not return. N is a multiple
        of M, and two beams or more returned.
    nearest : int
        Number of candidates.
    separation, margin : float
        As in `hypotheses` (m).

    Returns
    -------
    ndarray, shape (h, 3)
        x, y (m) and heading (rad) of each hypothesis, the best first.
    """
    M = len(scan)
    seen = np.flatnonzero(np.isfinite(scan))
    closed = np.interp(np.arange(M), seen, scan[seen], period=M)
    mark = spectrum(closed, marks.shape[1]) / np.sqrt(M)
    rows = np.argsort(np.linalg.norm(marks - mark, axis=1))[:nearest]
    rings = [slide(stored[row], scan) for row in rows]
    misfits = np.array([ring.min() for ring in rings])
    headings = [between_beams(ring) for ring in rings]
    poses = np.column_stack([places[rows], headings])
    return poses[hypotheses(poses, misfits, separation, margin)]


# %% active="ipynb" tags=["try"]
# ring = np.array([1.0, 2.0, 3.0, 4.0, 6.0, 5.0])
# locate(np.array([[0.5, 2.0]]), ring[None], spectrum(ring[None], 2) / np.sqrt(6),
#        np.array([2.1, np.nan, 5.0]), 1, 0.5, 0.02)

# %% [markdown] tags=["hint"]
# `np.interp` has an argument `period`. What is the period, if the beams are numbered?

# %% [markdown] tags=["hint"]
# Why the root? The squares of *all* amplitudes add up to $\sum d^2$, as in (B), which is about
# five times as large with 120 beams as with 24. Divided by $\sqrt M$, they add up to the mean of
# $d^2$. The `marks` of the map were divided by $\sqrt N$ (see the docstring).

# %% [markdown] tags=["hint"]
# `marks - mark` are all differences at once. `np.argsort` of their lengths gives the candidates
# as rows of the map; keep the first `nearest`.

# %% [markdown] tags=["hint"]
# Collect for each candidate a pose (x and y from `places`, the heading from its ring) and a
# misfit. `hypotheses` returns rows of the list that you gave it, which are not rows of the map.


# %% tags=["cases"]
@drawn
def _map_of_rings(
    rng: np.random.Generator,
    places: int,
    M: int,
    k: int,
    lost: Any = (),
    twins: int = 0,
    turn: int | None = None,
    nearest: int = 0,
    at_one_place: bool = False,
) -> Any:
    """Draw a map of rings, and a scan near one of its places, turned, with gaps and noise."""
    N = k * M
    where = np.round(rng.uniform(-2, 2, (places, 2)), 2)
    # Smooth rings: a few harmonics each.
    order, angle = np.arange(1, 5), 2 * np.pi * np.arange(N) / N
    waves = rng.normal(0, 0.5, (places, 2, 4)) / order
    rings = 3 + waves[:, 0] @ np.cos(np.outer(order, angle))
    rings += waves[:, 1] @ np.sin(np.outer(order, angle))
    for twin in range(1, twins + 1):
        by, away = (N // 4, [0.05, 0.05]) if at_one_place else (3, [1.5 * twin, 1.0])
        rings[twin] = np.roll(rings[0], by * twin) + rng.normal(0, 0.01, N)
        where[twin] = where[0] + away
    row = 0 if twins else int(rng.integers(places))
    m = int(rng.integers(N)) if turn is None else turn
    scan = np.round(np.roll(rings[row], -m)[::k] + rng.normal(0, 0.02, M), 4)
    scan[list(lost)] = np.nan
    rings = np.round(rings, 4)
    marks = spectrum(rings, 5) / np.sqrt(N)
    apart, margin = 0.1 * rng.integers(4, 7), 0.01 * rng.integers(7, 10)
    return where, rings, marks, scan, nearest or max(places // 3, 1 + twins), apart, margin


def _with_ring(ring: Any, nearest: int) -> Any:
    """Add a place whose ring is made of that of the place where the robot is."""

    def draw(rng: np.random.Generator) -> Any:
        where, rings, _, scan, _, gap, margin = _map_of_rings(6, 12, 1)(rng)
        rings = np.vstack([rings, ring(scan)])
        marks = spectrum(rings, 5) / np.sqrt(12)
        return np.vstack([where, [9.0, 9.0]]), rings, marks, scan, nearest, gap, margin

    return draw


def _located(
    locate: Function,
    places: Array,
    stored: Array,
    marks: Array,
    scan: Array,
    nearest: int,
    separation: float,
    margin: float,
) -> Any:
    """Locate one scan, or judge the forty of the room."""
    if scan.ndim == 1:
        return locate(places, stored, marks, scan, nearest, separation, margin)
    answers = [locate(places, stored, marks, one, nearest, separation, margin) for one in scan]
    truth = square_hall()[4]
    held = [_right(np.array(one, float), pose).any() for one, pose in zip(answers, truth)]
    lost = len(held) - sum(held)
    return "" if lost <= 4 else f"{lost} of {len(held)} lists lack the right pose, 4 may"


def _locate_drawn(ax: Any, function: Any) -> None:
    """Draw forty robots: best right (blue), in the list (orange), or not (cross).

    A full dot is right by the compass, too, a ring is not; of one robot (star) all answers.
    """
    from slamlab import plots

    *known, scans, truth = square_hall()
    answers = [np.asarray(function(*known, scan, 30, 0.5, 0.03), float) for scan in scans]
    right = [_right(one, pose) for one, pose in zip(answers, truth, strict=True)]
    best, held = np.array([one[0] for one in right]), np.array([one.any() for one in right])
    compass = truth[:, 2] + np.random.default_rng(4).normal(0, np.deg2rad(20), len(truth))
    chosen = [one[_by_compass(a, c)] for one, a, c in zip(right, answers, compass, strict=True)]
    plots.occupancy(ax, 0.5 * _square_world().occupied, [0, 4, 0, 4])
    for c, s in _QUARTERS:  # the windows
        x, y = np.array([1.97, 1.97]), np.array([-0.8, 0.0])
        ax.plot(2 + c * x + s * y, 2 - s * x + c * y, color=plots.COLOURS["lidar"], lw=4)
    picked = np.array(chosen, bool)
    for which, kind, mark, fill in (
        (best & picked, "estimate", "o", None),
        (best & ~picked, "estimate", "o", "none"),
        (held & ~best & picked, "dead_reckoning", "o", None),
        (held & ~best & ~picked, "dead_reckoning", "o", "none"),
        (~held, "truth", "x", None),
    ):
        ax.plot(*truth[which, :2].T, mark, color=plots.COLOURS[kind], mfc=fill, ms=6, mew=1.5)
    one = _SHOWN
    for answer in answers[one]:
        ax.plot(
            *np.array([truth[one, :2], answer[:2]]).T, color=plots.COLOURS["wrong"], lw=0.8, ls=":"
        )
    _noses(ax, answers[one], plots.COLOURS["wrong"], 0.4)
    ax.plot(*answers[one][:, :2].T, "o", color=plots.COLOURS["wrong"], mfc="none", ms=10, mew=0.8)
    ax.plot(*truth[one, :2], "*", color=plots.COLOURS["truth"], ms=9)
    plots.floor(ax)
    ax.set(xlim=(-0.1, 4.1), ylim=(-0.1, 4.1))
    ax.set_title(
        f"right of {len(truth)}: best {best.sum()}, list {held.sum()},\n"
        f"list and compass {picked.sum()}"
    )


_SHOWN = 36  # the robot whose answers are drawn


def _by_compass(poses: Array, compass: float) -> int:
    """Return the row of the pose whose heading is nearest to the compass."""
    return int(np.abs((poses[:, 2] - compass + np.pi) % (2 * np.pi) - np.pi).argmin())


check_locate = Check(
    locate,
    "poses",
    {
        "a single place, all beams": _map_of_rings(1, 12, 1, turn=0),
        "equal lidars, a few places": _map_of_rings(9, 12, 1),
        "a cheap lidar, not turned": _map_of_rings(9, 12, 3, turn=0),
        "a cheap lidar, any turn": _map_of_rings(12, 12, 3),
        "beams lost in the middle": _map_of_rings(9, 15, 2, (4, 5, 9)),
        "beams lost on both sides of beam 0": _map_of_rings(9, 12, 3, (0, 1, -1)),
        "beams lost on both sides of beam 0, one candidate of sixty": _map_of_rings(
            60, 12, 3, (0, 1, 2, -1, -2), nearest=1
        ),
        "two twins": _map_of_rings(12, 16, 2, (3,), 1),
        "four twins": _map_of_rings(15, 16, 2, (3,), 3),
        "four twins almost at one place, a quarter turn apart": _map_of_rings(
            15, 16, 2, (3,), 3, at_one_place=True
        ),
        "a mirror image has the same amplitudes": _with_ring(lambda scan: scan[::-1], 4),
        "the same shape, a metre farther all round": _with_ring(lambda scan: scan + 1.0, 1),
        "forty robots in the hall": lambda: (*square_hall()[:4], 30, 0.5, 0.03),
    },
    tolerance=1e-8,
    use=_located,
    picture=_locate_drawn,
)

# %% tags=["mistakes"]
_CLOSED = "np.interp(np.arange(M), seen, scan[seen], period=M)"


check_locate.mistakes = {
    "a gap was taken for a range of 0 m: close it by a straight line": (
        f"{_CLOSED} => np.nan_to_num(scan)"
    ),
    "a gap was closed by the mean of the scan: expected a straight line between its ends": (
        f"{_CLOSED} => np.where(np.isnan(scan), np.nanmean(scan), scan)"
    ),
    "the line was not drawn across beam 0: the scan is a ring": ", period=M => ",
    "the beams that did not return were cut out: the others moved together": (
        f"{_CLOSED} => scan[seen]"
    ),
    "the closed gaps were slid along as if they had been measured: slide the scan as it is": (
        "slide(stored[row], scan) => slide(stored[row], closed)"
    ),
    "the amplitudes were not divided by the root of M: lidars of other beams differ": (
        " / np.sqrt(M) => "
    ),
    "the amplitudes were divided by M, not by its root": "np.sqrt(M) => M",
    "the squares of the amplitudes were compared: the map has amplitudes": (
        "spectrum(closed, marks.shape[1]) / np.sqrt(M)"
        " => (spectrum(closed, marks.shape[1]) / np.sqrt(M)) ** 2"
    ),
    "all places were compared: only the nearest by amplitudes are candidates": (
        "[:nearest] => [:]"
    ),
    "the places are those of the nearest amplitudes: they propose, the scan decides": (
        "misfits = np.array([ring.min() for ring in rings])"
        " => misfits = np.linalg.norm(marks - mark, axis=1)[rows]"
    ),
    "a row among the candidates was taken for a row of the map": (
        "places[rows], headings => places[np.arange(len(rows))], headings"
    ),
    "only the best was reported: its twins are answers, too": (
        "misfits, separation, margin)] => misfits, separation, margin)][:1]"
    ),
    "the heading has the wrong sign: the map looks along x, the robot has turned left": (
        "between_beams(ring) for => -between_beams(ring) for"
    ),
    "the heading is that of the first candidate: each has its own": (
        "between_beams(ring) for => between_beams(rings[0]) for"
    ),
    "the heading is a whole number of beams: `between_beams` gives the fraction": (
        "between_beams(ring) for => (ring.argmin() / len(ring) + 0.5) % 1 * 2 * np.pi - np.pi for"
    ),
    "all candidates were reported: only the hypotheses among them": (
        "poses[hypotheses(poses, misfits, separation, margin)] => poses[np.argsort(misfits)]"
    ),
    "one place with two headings is two answers: `hypotheses` needs the headings, too": (
        "hypotheses(poses, misfits => hypotheses(poses * [1, 1, 0], misfits"
    ),
    "the misfit of a candidate is the least of its ring, not the mean": (
        "ring.min() for => ring.mean() for"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 6: forty robots in a hall with four twins
#
# The amplitudes propose, the scan decides, and the list says whether to believe it. Ten times
# forty robots, in the hall and in the room of the thesis, which has no twins:

# %% active="ipynb" tags=["solution"]
# def turned(headings, heading):
#     return np.abs((headings - heading + np.pi) % (2 * np.pi) - np.pi)
#
# def counted(drives, how=locate):
#     rng, right, answers = np.random.default_rng(0), np.zeros(3, int), []
#     for *known, scans, truth in drives:
#         for scan, (x, y, heading) in zip(scans, truth):
#             found = how(*known, scan, 30, 0.5, 0.03)
#             near = np.hypot(found[:, 0] - x, found[:, 1] - y) < 0.2
#             near &= turned(found[:, 2], heading) < np.deg2rad(9)
#             compass = heading + rng.normal(0, np.deg2rad(20))
#             right += near[0], near.any(), near[turned(found[:, 2], compass).argmin()]
#             answers.append(len(found))
#     return (f"best {right[0]}, list {right[1]}, list and compass {right[2]} "
#             f"of {len(answers)}; {np.mean(answers):.1f} answers in the mean")
#
# halls = [square_hall(seed=seed) for seed in range(10)]
# print("hall:", counted(halls))
# print("thesis' room:", counted([thesis_room(seed=seed) for seed in range(10)]))

# %% [markdown] tags=["solution"]
# In the hall about every fourth best answer is right, as chance has it with four twins. All four
# poses give the same scan, so no better lidar changes that. The list holds the right pose nearly
# always. Driving on does not help either, since a hall that looks the same after a quarter turn
# looks the same all along the way. A compass that is off by 20° does: the twins face a quarter
# turn apart. But it needs the list, since from one best answer it has nothing to choose. In the
# room of the thesis the list nearly always has one pose, and that is the lesson's unique answer.

# %% [markdown] tags=["solution"]
# What does each step buy? Here are three ways to propose worse, each with one thing changed:

# %% active="ipynb" tags=["solution"]
# def gaps_as_zero(places, stored, marks, scan, nearest, *rest):
#     mark = spectrum(np.nan_to_num(scan), 8) / np.sqrt(len(scan))
#     rows = np.argsort(np.linalg.norm(marks - mark, axis=1))[:nearest]
#     return locate(places[rows], stored[rows], marks[rows], scan, nearest, *rest)
#
# def lesson_scale(places, stored, marks, scan, *rest):
#     return locate(places, stored, marks * np.sqrt(120 / 24), scan, *rest)
#
# def four_candidates(places, stored, marks, scan, nearest, *rest):
#     return locate(places, stored, marks, scan, 4, *rest)
#
# for how in (gaps_as_zero, lesson_scale, four_candidates):
#     print(f"{how.__name__}: {counted(halls, how)}")

# %% [markdown] tags=["solution"]
# A gap taken for 0 m is a deep notch in the scan, and its amplitudes propose other places:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: forty robots: best answer right (blue), in the list only (orange), or not (cross), and full where the compass picks the right pose; on the left there are many more crosses."}}
# check_locate.draw(gaps_as_zero)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 19](../solutions/19_autocorrelation_localization.ipynb).
