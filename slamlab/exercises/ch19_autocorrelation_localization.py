"""Exercises, chapter 19: beams, a lost beam, two lidars, the top of a ring, twins, the place.

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
    "check_beams",
    "check_between_beams",
    "check_hypotheses",
    "check_locate",
    "check_lost_beam",
    "check_slide",
]


# %% [markdown] tags=["chapter"]
# # Exercises 19: autocorrelation localization
#
# A good lidar has mapped a house; now a cheap robot with few beams is to find itself in that map.
# Six exercises: the beams that the map needs, with a pencil; a number that the map has lost; the
# scan of the cheap lidar on the ring of the good one; a bug to find; a hall with four twins; and
# all of it assembled in the room of the thesis, where forty robots ask where they are. The
# chapter is [Autocorrelation localization](../19_autocorrelation_localization.ipynb). Replace
# each `...` and run the check below it as often as you like; then draw what you built beside what
# is expected.
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
# ## Exercise 1: how many beams, with a pencil
#
# A cleaning robot is 4 m from its dock and drives there straight, along the heading that one scan
# has given it. It may miss the dock by 7 cm, root mean square: the heading may be off by $\sigma
# = 0.07/4$ rad. The heading comes in whole beams of the map, so it is rounded (exercise 4 mends
# that). You order the lidar that makes the map: how many beams does it need, at least?
#
# On paper: with $N$ beams on the full circle, any heading as likely as any other, between which
# two numbers does the rounding error lie, how is it distributed, and what is the mean of its
# square?


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
# beams_for(0.07 / 4)

# %% [markdown] tags=["hint"]
# With a distance $\Delta$ between beams the error is uniform between $-\Delta/2$ and $\Delta/2$.
# Integrate $e^2$ over it and divide by $\Delta$.

# %% [markdown] tags=["hint"]
# A fraction of a beam cannot be bought. Which whole number keeps the promise?


# %% tags=["cases"]
def _errors(rng: np.random.Generator) -> Any:
    return (float(np.round(np.deg2rad(rng.uniform(0.1, 20)), 4)),)


def _beams_drawn(ax: Any, function: Any) -> None:
    """Draw the error of rounded turns (line), and the beams that each error asks for (dots)."""
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
# For the dock that is 104 beams; the map of the lesson has 120. Half a beam is the worst that can
# happen. A plan for it buys $\sqrt 3$ times as many beams:

# %% active="ipynb" tags=["solution"]
# check_beams(lambda sigma: int(np.ceil(np.pi / sigma)))

# %% [markdown] tags=["statement"]
# ## Exercise 2: a number that the map has lost
#
# A robot loads its map, and one byte is damaged: in the scan of one place, one range is `nan`.
# The autocorrelation of that scan was stored beside it before, and is intact:
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
        Autocorrelation of the whole scan, R[0] to R[N - 1] (m^2), without error.

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
#     np.array([119.0, 72.0, 103.0, 60.0, 103.0, 72.0]),
# )

# %% [markdown] tags=["hint"]
# The beams form a ring of six corners, and $R[1]$ adds six products, one an edge. Four edges have
# both ends: $5 \cdot 1$, $2 \cdot 8$, and which two others?

# %% [markdown] tags=["hint"]
# The two edges that meet at the lost beam $x$ are worth $x$ times one neighbour and $x$ times the
# other. Together they are what the four leave of $R[1]$.

# %% [markdown] tags=["hint"]
# With a zero in place of the `nan` the sum over the whole ring is the sum of the products that
# you know. `scan[lost - 1]` is the neighbour before, even for beam 0; what is the one after, for
# the last beam? (There are other ways: $R[0]$ is one.)


# %% tags=["cases"]
@drawn
def _damaged(rng: np.random.Generator, n: int | None = None, at: int | None = None) -> Any:
    count = n or int(rng.integers(4, 30))
    scan = np.round(rng.uniform(0.5, 9, count), 2)
    R = np.array([scan @ np.roll(scan, tau) for tau in range(count)])
    scan[int(rng.integers(count)) if at is None else at] = np.nan
    return scan, R


def _lost_beam_drawn(ax: Any, function: Any) -> None:
    """Draw a scan (circles), and each beam as it is found when it alone is lost (crosses)."""
    from slamlab import plots

    pose = [1.2, 1.0, 0.0]
    scan = Lidar(60).scan(rooms.thesis_room(), np.array(pose))
    R = np.array([scan @ np.roll(scan, tau) for tau in range(60)])
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
            [119.0, 72.0, 103.0, 60.0, 103.0, 72.0],
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
    "a sum with nan in it is nan: put 0 in its place, or leave it out": (
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
    "R[0] is the sum of the squares, not of products of neighbours": "R[1] => R[0]",
    "R[0] leaves the square of the lost range: take the root": (
        lambda scan, R: R[0] - np.nansum(scan**2)
    ),
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
# $R[0]$ does as well, $x = \sqrt{119 - 103}$, and so does every other $\tau$. That they agree says
# for nothing else being damaged: with one more number wrong they agree by accident only.

# %% active="ipynb" tags=["solution"]
# def from_squares(scan, R):
#     return np.sqrt(R[0] - np.nansum(scan**2))
#
# check_lost_beam(from_squares)

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
# Slide the scan $d$ of the robot along the ring $e$ of a place. When the robot has turned left by
# $m$ beams *of the map*, its beam $j$ looks along the map's beam $kj + m$. For every $m$ from 0
# to $N - 1$ give the **misfit**: the mean of $|d - e|$ over the beams that returned.
#
# Why not the lesson's product, $\sum_j e_{kj + m}\, d_j$? On paper: write out $\sum_j (d_j -
# e_{j + m})^2$ for $k = 1$. Only one of its three sums changes with $m$, and so the largest
# product has the least difference. Which of the other two changes with $m$ if $k$ is 3, or if a
# $d_j$ is missing?


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
    "this is the product of the lesson: with fewer beams its largest value is not the best fit": (
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
# beams for another $m$, and the product is large where the robot's beams meet far walls. A mean
# of differences has no such preference. (For equal lidars without gaps, the lesson's FFT finds
# the best turn of the squares, and much faster.)

# %% [markdown] tags=["solution"]
# How often does that matter? Forty robots stand on a place of the map, ten times over; counted are
# the headings that are off by more than 9°:

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
# number of beams. The program was tested with 120 beams and robots that had turned by up to 150°
# to either side, and passed. Then a robot turned round to back into its dock, and stood there at a
# slant. Find the bug; the picture has turns from 150° to 210°.


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
    middle = np.roll(misfits, n // 2)  # no turn: the middle of the list
    k = middle.argmin()
    before, least, after = middle[k - 1], middle[k], middle[(k + 1) % n]
    tip = k + 0.5 * (before - after) / (max(before, after) - least)
    angle = (tip - n // 2) * 2 * np.pi / n
    return np.pi - (np.pi - angle) % (2 * np.pi)


# %% active="ipynb" tags=["stub"]
#     n = len(misfits)
#     middle = np.roll(misfits, n // 2)  # no turn: the middle of the list
#     k = middle.argmin()
#     before, least, after = middle[max(k - 1, 0)], middle[k], middle[min(k + 1, n - 1)]
#     tip = k + 0.5 * (before - after) / (max(before, after) - least)
#     angle = (tip - n // 2) * 2 * np.pi / n
#     return np.pi - (np.pi - angle) % (2 * np.pi)

# %% active="ipynb" tags=["try"]
# np.rad2deg(between_beams(np.array([5.0, 4.0, 2.5, 1.0, 2.0, 4.0])))

# %% [markdown] tags=["hint"]
# In the call above there are six beams, 60° apart, and the least misfit is at three of them: half
# a turn. The neighbour with 2.0 is better than that with 2.5. On which side of 180° is the tip,
# then, and on which side is the answer?

# %% [markdown] tags=["hint"]
# Print `middle`, `k`, `before`, `least` and `after`. Are the three what you would have written
# down?

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
    """Draw the error near half a turn, in whole beams (dashed) and between beams (solid)."""
    from slamlab import plots

    world, place, step = rooms.thesis_room(), [1.2, 1.0], 9
    turns = np.linspace(150, 210, 81)
    stored = Lidar(40).scan(world, np.array([*place, 0.0]))
    poses = np.column_stack([np.full((81, 2), place), np.deg2rad(turns)])
    whole: list[float] = []
    fine: list[float] = []
    for scan, turned in zip(Lidar(40).scan(world, poses), turns, strict=True):
        ring = slide(stored, scan)
        for found, into in ((step * ring.argmin(), whole), (np.rad2deg(function(ring)), fine)):
            into.append((float(found) - turned + 180) % 360 - 180)
    ax.axhline(0, **plots.line_style("truth"))
    ax.plot(turns, whole, **plots.line_style("dead_reckoning"))
    ax.plot(turns, fine, **plots.line_style("estimate"))
    ax.set(xlabel="true turn (°)", ylabel="error (°)", ylim=(-9, 9))
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
        "half a turn, a little less or more": _vee(6, n=12),
        "almost half a turn to the left, beams odd in number": _vee(4, n=9),
        "almost half a turn to the right, beams odd in number": _vee(5, n=9),
        "any ring": _vee(),
    },
    tolerance=1e-8,
    picture=_between_beams_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
_NEXT = "middle[k - 1], middle[k], middle[(k + 1) % n]"
_WRAP = "np.pi - (np.pi - angle) % (2 * np.pi)"


check_between_beams.mistakes = {
    "the neighbours were cut off at the ends of the list: after the last comes the first": (
        f"{_NEXT} => middle[max(k - 1, 0)], middle[k], middle[min(k + 1, n - 1)]"
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
# The list was cut open at half a turn. There `max` and `min` take the least value for its own
# neighbour. A V through two equal values has its tip half-way between them, so the answer is
# always half a beam beyond the list's end. `middle[-1]` is the last entry, so `k - 1` needs
# nothing; the other end needs the remainder.

# %% [markdown] tags=["solution"]
# Another cut does not help: it moves the fault to other robots. Nor does it help to leave the tip
# alone at the ends. Such a program is right nearly always, and rounds for those who have turned
# round:

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
# A square hall looks the same after every quarter turn. The robot's best answer is one of four
# places that fit alike, and the lesson's second best names one more. The particles of chapter 04
# need *all* that come into question, or they may begin without the right one. Report every place
# that could be meant, the best first:
#
# - Go through the places from the least misfit upwards.
# - Report a place if it is farther than `separation` from **every place reported before it**,
#   whatever lies between them that is not reported.
# - Its misfit must be less than the least one plus `margin`.


# %% tags=["exercise"]
def hypotheses(places: Array, misfits: Array, separation: float, margin: float) -> Ints:
    """Rows of all places that fit about as well as the best, apart from each other.

    Parameters
    ----------
    places : ndarray, shape (k, 2)
        Candidates (m), one or more.
    misfits : ndarray, shape (k,)
        Misfit of each (m); no two are equal.
    separation : float
        A place is elsewhere if it is farther away than this (m); exactly as far is not
        farther.
    margin : float
        A place may be meant if it fits worse than the best by less than this (m),
        which is positive; by exactly as much is not less.

    Returns
    -------
    ndarray of int, shape (h,)
        Rows of `places`, the best first; h is 1 if the answer is unique.
    """
    rows: list[int] = []
    for row in np.argsort(misfits):
        apart = np.linalg.norm(places[rows] - places[row], axis=1)
        if misfits[row] - misfits.min() < margin and np.all(apart > separation):
            rows.append(int(row))
    return np.array(rows)


# %% active="ipynb" tags=["try"]
# hypotheses(
#     np.array([[1.0, 1.0], [1.0, 1.1], [3.0, 3.0], [3.0, 1.0]]),
#     np.array([0.01, 0.015, 0.02, 0.09]), 0.5, 0.02,
# )

# %% [markdown] tags=["hint"]
# The lesson's second best sets the places near the best one to infinity and takes the least of
# the rest. What if you do that again and again? When do you stop?

# %% [markdown] tags=["hint"]
# Or keep a list of the rows that you report, and go through `np.argsort(misfits)`. What must hold
# of a row, and of all rows in the list, before it is added?

# %% [markdown] tags=["hint"]
# Three places in a line, 0.4 m apart, with misfits that rise along it, and a separation of 0.5 m:
# the second is too near the first. Does it keep the third from being reported?


# %% tags=["cases"]
@drawn
def _candidates(rng: np.random.Generator, most: int, room: float = 3.0) -> Any:
    k = int(rng.integers(most // 2, most))
    places = np.round(rng.uniform(0, room, (k, 2)), 2)
    misfits = np.round((rng.permutation(k) + 1) / 100 + rng.uniform(0, 0.005, k), 4)
    return (
        places,
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
def square_hall(n: int = 40, seed: int = 4) -> Any:
    """Map of a hall with four twins, and scans of robots in it, as `thesis_room` gives them.

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
    scans = Lidar(24).scan(world, truth) + rng.normal(0, 0.02, (n, 24))
    return *_mapped(world), scans, truth


def _hypotheses_drawn(ax: Any, function: Any) -> None:
    """Draw a hall: the robot (star), the answers (rings), darker where a place fits better."""
    from slamlab import plots

    places, stored, _, scans, truth = square_hall(1, 3)
    misfits = np.array([slide(one, scans[0]).min() for one in stored])
    rows = np.asarray(function(places, misfits, 0.5, 0.04))
    if rows.ndim != 1 or rows.dtype.kind not in "iu":
        raise TypeError("expected a list of row numbers")
    plots.occupancy(ax, 0.5 * _square_world().occupied, [0, 4, 0, 4])
    good = misfits < 0.25
    for place, misfit in zip(places[good], misfits[good], strict=True):
        shade = float(np.clip(0.03 / misfit, 0, 1)) ** 1.5
        ax.plot(*place, "s", color=plots.COLOURS["estimate"], alpha=shade, ms=3, mew=0)
    ax.plot(*places[rows].T, "o", color=plots.COLOURS["wrong"], ms=13, mfc="none", mew=2)
    ax.plot(*truth[0, :2], "*", color=plots.COLOURS["truth"], ms=13, mfc="none")
    plots.floor(ax)
    centre = np.array([[2.0, 2.0]])
    off = truth[:, :2] - centre
    twins = np.vstack([centre + off @ np.array([[c, s], [-s, c]]) for c, s in _QUARTERS])
    met = [bool((np.linalg.norm(places[rows] - twin, axis=1) < 0.2).any()) for twin in twins]
    ax.set_title(f"{sum(met)} of 4 twins in {len(rows)} answers")


_QUARTERS = ((1, 0), (0, 1), (-1, 0), (0, -1))

check_hypotheses = Check(
    hypotheses,
    "rows",
    {
        "the only candidate": ([[1.5, -2.0]], [0.2], 0.5, 0.01),
        "four twins, each with a neighbour": (
            [[1, 1], [1, 1.1], [3, 1], [3.1, 1], [3, 3], [3, 3.1], [1, 3], [1.1, 3]],
            [0.014, 0.012, 0.011, 0.015, 0.013, 0.016, 0.019, 0.018],
            0.5,
            0.02,
        ),
        "three in a line: the one between is not reported": (
            [[0.0, 0.8], [0.0, 0.4], [0.0, 0.0]],
            [0.03, 0.02, 0.01],
            0.5,
            0.1,
        ),
        "far from the best, near the second": (
            [[0.0, 0.0], [2.0, 0.0], [2.2, 0.0], [2.0, -1.5]],
            [0.01, 0.02, 0.03, 0.04],
            0.5,
            0.1,
        ),
        "exactly at the separation is not farther": (
            [[0, 0], [3, 4], [6, 8]],
            [0.01, 0.02, 0.03],
            5.0,
            0.5,
        ),
        "exactly at the margin is not less": (
            [[0, 0], [5, 0], [0, 5]],
            [0.5, 0.75, 0.625],
            1,
            0.25,
        ),
        "each a little worse than the one before": (
            [[0, 0], [2, 0], [4, 0], [6, 0], [8, 0]],
            [0.01, 0.02, 0.03, 0.09, 0.1],
            1.0,
            0.015,
        ),
        "few candidates": _candidates(8),
        "many candidates": _candidates(40),
    },
    picture=_hypotheses_drawn,
)

# %% tags=["mistakes"]
_OTHERS = "places[rows] - places[row], axis=1)"


def _greedy(far: Function) -> Any:
    """Return a wrong answer with another rule; ``far(places, rows, row, rank, separation)``."""

    def answer(places: Array, misfits: Array, separation: float, margin: float) -> Ints:
        rows: list[int] = []
        rank = [int(row) for row in np.argsort(misfits)]
        for row in rank:
            better = rank[: rank.index(row)]
            if misfits[row] - misfits.min() < margin and far(
                places, rows, row, better, separation
            ):
                rows.append(row)
        return np.array(rows)

    return answer


def _norms(places: Array, rows: Any, row: int) -> Array:
    apart: Array = np.linalg.norm(places[rows] - places[row], axis=1)
    return apart


check_hypotheses.mistakes = {
    "these are the best and the second best: a hall may have more twins": (
        "return np.array(rows) => return np.array(rows[:2])"
    ),
    "each place was compared with the best only: two neighbours of a twin are one answer": (
        _greedy(lambda p, rows, row, _, gap: bool(np.all(_norms(p, rows[:1], row) > gap)))
    ),
    "each place was compared with the last one reported only": (
        _greedy(
            lambda p, rows, row, _, gap: not rows or np.linalg.norm(p[row] - p[rows[-1]]) > gap
        )
    ),
    "a place that is not reported keeps no other from being reported": (
        _greedy(lambda p, rows, row, better, gap: bool(np.all(_norms(p, better, row) > gap)))
    ),
    "one reported place far enough is not enough: all must be": (
        _greedy(lambda p, rows, row, _, gap: not rows or bool(np.any(_norms(p, rows, row) > gap)))
    ),
    "neighbours were not left out: they are the same answer": (
        "and np.all(apart > separation) => "
    ),
    "exactly at the separation is not farther": "> separation => >= separation",
    "exactly at the margin is not less": "< margin => <= margin",
    "the margin has no effect: a place that fits badly is no answer": (
        "misfits[row] - misfits.min() < margin and => "
    ),
    "the margin counts from the best, not from the place reported before": (
        "misfits.min() < margin => misfits[rows[-1] if rows else row] < margin"
    ),
    "the margin is a difference (m), not a share of the least misfit": (
        "misfits[row] - misfits.min() < margin => misfits[row] < (1 + margin) * misfits.min()"
    ),
    "the margin is how much worse a place fits, not the misfit itself": (
        "misfits[row] - misfits.min() < margin and => (misfits[row] < margin or not rows) and"
    ),
    "squared distances were compared with the separation: take the root": (
        f"np.linalg.norm({_OTHERS} => (({_OTHERS.split(',')[0]}) ** 2).sum(axis=1)"
    ),
    "only x was compared: a place straight above is elsewhere, too": (
        f"np.linalg.norm({_OTHERS} => np.abs({_OTHERS.split(',')[0]})[:, 0]"
    ),
    "go through the places from the least misfit upwards, not in the order of the rows": (
        "np.argsort(misfits) => range(len(misfits))"
    ),
    "these are ranks: expected rows of `places`": (
        lambda *case: np.argsort(np.argsort(case[1]))[hypotheses(*case)]
    ),
    "the right places, in the order of the rows: expected the best first": (
        "return np.array(rows) => return np.sort(rows)"
    ),
    "these are the places: expected their rows": lambda *case: case[0][hypotheses(*case)],
}

# %% [markdown] tags=["solution"]
# ## Solution 5: a hall with four twins
#
# This is non-maximum suppression, as in the detection of corners: the best of a neighbourhood is
# kept, its neighbours are dropped, and the next best goes on. In a room without symmetry the list
# has one row, and that is the lesson's unique answer.

# %% [markdown] tags=["solution"]
# The rule asks for places *reported* before. If any better place may suppress another, then
# of three in a line the second, which is not reported itself, suppresses the third:

# %% active="ipynb" tags=["solution"]
# def any_better_place(places, misfits, separation, margin):
#     rank = np.argsort(misfits)
#     return np.array([
#         row for k, row in enumerate(rank)
#         if misfits[row] - misfits.min() < margin
#         and np.all(np.linalg.norm(places[rank[:k]] - places[row], axis=1) > separation)
#     ])
#
# check_hypotheses(any_better_place)

# %% [markdown] tags=["statement"]
# ## Exercise 6: forty robots ask where they are
#
# Now assemble. The map of the room has a place every 10 cm, with the scan of 120 beams and its
# amplitudes. The robots have 24 beams with a noise of 2 cm, two windows return nothing, and each
# robot faces anywhere. (In the lesson `locate` gets the best answer and the second best; yours
# returns every answer that could be meant.)
#
# 1. **Propose.** Close the gaps of the scan: a beam that did not return gets its value from the
#   straight line between the nearest beams on either side that did, along the *ring*. Take as many
#   amplitudes as the map has, `spectrum(closed, n) / np.sqrt(M)`. (`spectrum` is the lesson's
#   `amplitudes`. The sum of its squares is $\sum d^2$, which grows with the number of beams; over
#   $\sqrt M$ it is the mean of $d^2$, and lidars with 24 and 120 beams can be compared. The
#   `marks` of the map were made in the same way.) The `nearest` places by the length of the
#   difference are candidates.
# 2. **Decide.** `slide` the scan, *with* its gaps, along the ring of each candidate. The least
#   value is its misfit, and `between_beams` gives the heading.
# 3. **Report.** The `hypotheses` among the candidates, as poses.
#
# The check also takes the forty scans of the picture. Nine in ten must be found within 20 cm and
# 9°. In the picture an answer that is off by more than 20 cm has a dotted line to its robot.


# %% tags=["exercise"]
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
    chosen = hypotheses(places[rows], misfits, separation, margin)
    return np.array([[*places[rows[k]], between_beams(rings[k])] for k in chosen])


# %% active="ipynb" tags=["try"]
# ring = np.array([1.0, 2.0, 3.0, 4.0, 6.0, 5.0])
# locate(np.array([[0.5, 2.0]]), ring[None], spectrum(ring[None], 2) / np.sqrt(6),
#        np.array([2.1, np.nan, 5.0]), 1, 0.5, 0.02)

# %% [markdown] tags=["hint"]
# `np.interp` has an argument `period`. What is the period, if the beams are numbered?

# %% [markdown] tags=["hint"]
# `marks - mark` are all differences at once. `np.argsort` of their lengths gives the candidates
# as rows of the map; keep the first `nearest`.

# %% [markdown] tags=["hint"]
# Two numberings meet at the end: `hypotheses(places[rows], ...)` returns rows of what you gave
# it. Which row of the map is its row `k`?


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
        rings[twin] = np.roll(rings[0], 3 * twin) + rng.normal(0, 0.01, N)
        where[twin] = where[0] + [1.5 * twin, 1.0]
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
    off, turned = _errors_of(np.array([one[0] for one in answers], float), thesis_room()[4])
    if np.mean(off > 0.2) > 0.1:
        return f"{np.sum(off > 0.2)} of {len(off)} robots are off by more than 20 cm, 4 may be"
    if np.mean(turned > 9) > 0.1:
        return f"{np.sum(turned > 9)} of {len(off)} headings are off by more than 9°, 4 may be"
    return ""


def _errors_of(poses: Array, truth: Array) -> tuple[Array, Array]:
    """Return how far answers are off (m), and how much they are turned (degrees)."""
    turned = np.abs((poses[:, 2] - truth[:, 2] + np.pi) % (2 * np.pi) - np.pi)
    return np.hypot(*(poses[:, :2] - truth[:, :2]).T), np.rad2deg(turned)


def _locate_drawn(ax: Any, function: Any) -> None:
    """Draw forty robots (circles), their best answers (crosses), misses orange, windows green."""
    from slamlab import plots

    places, stored, marks, scans, truth = thesis_room()
    answers = [function(places, stored, marks, scan, 30, 0.5, 0.02) for scan in scans]
    found = np.array([np.asarray(one, float)[0] for one in answers])
    off, turned = _errors_of(found, truth)
    plots.occupancy(ax, 0.5 * rooms.thesis_room().occupied, [0, 4, 0, 4])
    for x, y in (((3.97, 3.97), (1.2, 2.0)), ((0.4, 1.0), (3.97, 3.97))):
        ax.plot(x, y, color=plots.COLOURS["lidar"], lw=5)  # the two windows
    ax.plot(*truth[:, :2].T, "o", color=plots.COLOURS["truth"], mfc="none", ms=6)
    for pose, one, miss in zip(truth, found, off, strict=True):
        kind = "estimate" if miss <= 0.2 else "dead_reckoning"
        nose = one[:2] + 0.22 * np.array([np.cos(one[2]), np.sin(one[2])])
        ax.plot(*np.array([one[:2], nose]).T, color=plots.COLOURS[kind], lw=1)
        ax.plot(*one[:2], "x", color=plots.COLOURS[kind], ms=5)
        if miss > 0.2:
            ax.plot(*np.array([pose[:2], one[:2]]).T, color=plots.COLOURS[kind], lw=0.8, ls=":")
    plots.floor(ax)
    ax.set(xlim=(-0.1, 4.1), ylim=(-0.1, 4.1))
    ax.set_title(
        f"{np.sum(off <= 0.2)} of 40 places right,\n"
        f"median {100 * np.median(off):.0f} cm and {np.median(turned):.1f}°"
    )


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
        "a mirror image has the same amplitudes": _with_ring(lambda scan: scan[::-1], 4),
        "the same shape, a metre farther all round": _with_ring(lambda scan: scan + 1.0, 1),
        "forty robots in the thesis' room": (*thesis_room()[:4], 30, 0.5, 0.02),
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
    "the row among the candidates was taken for a row of the map": (
        "places[rows[k]] => places[k]"
    ),
    "only the best was reported: its twins are answers, too": (
        "for k in chosen => for k in chosen[:1]"
    ),
    "the heading has the wrong sign: the map looks along x, the robot has turned left": (
        "between_beams(rings[k]) => -between_beams(rings[k])"
    ),
    "the heading is that of the first candidate: each hypothesis has its own": (
        "between_beams(rings[k]) => between_beams(rings[0])"
    ),
    "the heading is a whole number of beams: `between_beams` gives the fraction": (
        "between_beams(rings[k])"
        " => (rings[k].argmin() / len(rings[k]) + 0.5) % 1 * 2 * np.pi - np.pi"
    ),
    "the misfit of a candidate is the least of its ring, not the mean": (
        "ring.min() for => ring.mean() for"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 6: forty robots ask where they are
#
# The amplitudes propose, the scan decides, and the list of hypotheses says whether to believe it.

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
# def nearest_amplitudes(places, stored, marks, scan, nearest, *rest):
#     return locate(places, stored, marks, scan, 1, *rest)

# %% [markdown] tags=["solution"]
# Ten times forty robots; *wrong* is a best answer that is off by more than 20 cm:

# %% active="ipynb" tags=["solution"]
# for how in (locate, gaps_as_zero, lesson_scale, nearest_amplitudes):
#     wrong = 0
#     for seed in range(10):
#         *known, scans, truth = thesis_room(seed=seed)
#         for scan, pose in zip(scans, truth):
#             best = how(*known, scan, 30, 0.5, 0.02)[0]
#             wrong += np.linalg.norm(best[:2] - pose[:2]) > 0.2
#     print(f"{how.__name__}: {wrong} of 400 wrong")

# %% [markdown] tags=["solution"]
# And the hall of exercise 5, where a place has three twins. How often is the best answer right,
# and how often is the right one among those reported? Five times forty robots:

# %% active="ipynb" tags=["solution"]
# best, any_of, answers = 0, 0, 0
# for seed in range(5):
#     *known, scans, truth = square_hall(seed=seed)
#     for scan, pose in zip(scans, truth):
#         found = locate(*known, scan, 120, 0.5, 0.04)
#         right = np.linalg.norm(found[:, :2] - pose[:2], axis=1) < 0.2
#         best, any_of = best + right[0], any_of + right.any()
#         answers += len(found)
# # Which twin is the best is decided by rounding: other machines count others.
# print(f"the best is right in fewer than 4 of 10: {best < 80}")
# print(f"one of those reported is right in more than 95 of 100: {any_of > 190}")
# print(f"reported: {answers / 200:.1f} in the mean")

# %% [markdown] tags=["solution"]
# About every fourth best answer is right, as chance has it with four twins. The list holds the
# right one nearly always, and the particles of chapter 04 can begin at four places.

# %% [markdown] tags=["solution"]
# A gap taken for 0 m is a deep notch in the scan, and its amplitudes propose other places:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: forty robots (circles), their best answers (crosses), misses orange, windows green; on the left dotted lines lead from robots to wrong places."}}
# check_locate.draw(gaps_as_zero)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 19](../solutions/19_autocorrelation_localization.ipynb).
