"""One picture of rough ground: what page 15b and its stored trial have in common.

P5 section 2.3 (Gamma-SLAM, Marks et al. 2008), formulas (E) and (F) of chapter 15. A picture of
the second lap is slid aside on a map of the first; `tools/rough_ground.py` stores twenty drives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

from slamlab._checks import Array
from slamlab.evaluation import run
from slamlab.evaluation.consistency import pose_errors
from slamlab.evaluation.run import Run
from slamlab.geometry import transform
from slamlab.grids import Grid
from slamlab.logs import Log
from slamlab.mapping.variance import HeightGrid, VarianceGrid
from slamlab.sensors import StereoRig, VisualOdometer
from slamlab.simulation import ground_laps
from slamlab.slam import GammaSlam
from slamlab.worlds import Terrain

__all__ = [
    "CAMERAS",
    "COARSE",
    "DEGREE",
    "FILTERS",
    "FINE",
    "FIVE",
    "LAP",
    "MAPS",
    "PLACES",
    "POWERS",
    "RIG",
    "TEN",
    "UNITS",
    "WORLDS",
    "by_particles",
    "cells_met",
    "country",
    "difference",
    "drawn",
    "filtered",
    "held",
    "interval",
    "off",
    "profiles",
    "scores",
    "slide",
    "smooth",
]

RIG, DEGREE = StereoRig(2000), float(np.deg2rad(1.0))
LAP, TEN = 62, range(65, 120, 6)  # pictures of the first lap; ten pictures of the second
FIVE = TEN[::2]  # of these, where height maps are asked
FINE = np.arange(-100, 101) / 1000  # offsets to the left (m)
COARSE = np.round(np.arange(-0.3, 0.301, 0.03), 2)
PATCH, BUMP, CELL = 0.5, 0.05, 0.25  # of the ground, and of the maps (m)

# Standard deviations of rise (m), pitch and roll (rad), drawn for each picture.
CAMERAS = {"level": (0.0, 0.0, 0.0), "sways": (0.05, DEGREE, DEGREE)}
Sway = tuple[float, float, float]
Ground = VarianceGrid | HeightGrid
MAPS: dict[str, Callable[[], Ground]] = {
    "variance": lambda: VarianceGrid(Grid((100, 100), CELL)),
    "height": lambda: HeightGrid(Grid((100, 100), CELL)),
    "height, plane fitted": lambda: HeightGrid(Grid((100, 100), CELL), level=True),
}


@lru_cache(maxsize=24)
def country(
    seed: int, sway: Sway = CAMERAS["sways"], odometer: VisualOdometer | None = None
) -> Log:
    """Two laps over the ground of a seed, as in chapter 15."""
    rng = np.random.default_rng(seed)
    terrain = Terrain.rough(rng, (25.0, 25.0))
    more: dict[str, Any] = {} if odometer is None else {"odometer": odometer}
    return ground_laps(terrain, RIG, rng, radius=4.0, step=0.4, sway=sway, **more)


# One picture, slid aside.


def poses_and_ranges(log: Log) -> tuple[Array, Array]:
    """Give true poses (T, 3) and ranges (T, n) of a drive, which has both."""
    assert log.truth is not None
    assert log.ranges is not None
    return log.truth, log.ranges


def aside(pose: Array, offsets: Array) -> Array:
    """Poses so far to the left of a pose (m)."""
    left = np.array([-np.sin(pose[2]), np.cos(pose[2]), 0.0])
    return np.asarray(pose + offsets[:, None] * left)


def slide(
    log: Log, ground: Ground, offsets: Array, pictures: Iterable[int], camera: StereoRig = RIG
) -> Array:
    """Give ln p of pictures (rows) at offsets to the left, on a map of the first lap."""
    (truth, ranges), up = poses_and_ranges(log), log.notes["ground"]

    def picture(k: int) -> tuple[Array, Array]:
        return camera.points(ranges[k]), camera.heights(ranges[k]) + up[k]

    for k in range(LAP):
        ground.insert(truth[k], *picture(k))
    lines = []
    for k in pictures:
        points, heights = picture(k)
        poses = aside(truth[k], offsets)
        lines.append([ground.log_likelihood(pose, points, heights) for pose in poses])
    return np.array(lines)


def interval(lines: Array) -> tuple[Array, Array]:
    """Give the 95 % interval (m), if before the picture all FINE offsets are equally likely."""
    total = np.cumsum(np.exp(lines - lines.max(-1, keepdims=True)), -1)
    total /= total[..., -1:]
    return FINE[(total < 0.025).sum(-1)], FINE[(total < 0.975).sum(-1)]


def held(lines: Array) -> int:
    """How many intervals hold the true place."""
    low, high = interval(lines)
    return int(((low <= 0) & (0 <= high)).sum())


def smooth(lines: Array, n: int = 20) -> Array:
    """Mean over the n millimetres to either side."""
    wide = np.pad(lines, ((0, 0), (n, n)), mode="edge")
    return np.stack([wide[:, k : k + lines.shape[1]] for k in range(2 * n + 1)]).mean(0)


def by_particles(lines: Array, n: int, seed: int) -> int:
    """How many intervals of n places, drawn within 10 cm, hold the truth to half a millimetre."""
    rng, found = np.random.default_rng(seed), 0
    for line in lines:
        places = np.sort(rng.uniform(-0.1, 0.1, n))
        ln_w = np.interp(places, FINE, line)
        total = np.cumsum(np.exp(ln_w - ln_w.max()))
        total /= total[-1]
        low, high = places[[min((total < q).sum(), n - 1) for q in (0.025, 0.975)]]
        found += bool(low - 0.0005 <= 0 <= high + 0.0005)
    return found


# Another map.


def profiles(seed: int, sway: Sway) -> dict[str, Array]:
    """Eight pictures on each map, to 30 cm aside."""
    pictures = range(LAP + 1, 126, 8)
    return {
        name: slide(country(seed, sway), make(), COARSE, pictures) for name, make in MAPS.items()
    }


def off(lines: Array) -> float:
    """Mean error of the best COARSE offset (m)."""
    return float(np.abs(COARSE[lines.argmax(axis=1)]).mean())


# Another density, another unit.


def cells(log: Log, camera: StereoRig, k: int) -> Iterable[tuple[NDArray[np.intp], Array]]:
    """At each offset: the cells of a picture's points, and their heights."""
    truth, ranges = poses_and_ranges(log)
    points, z = camera.points(ranges[k]), camera.heights(ranges[k])
    met = np.isfinite(points[:, 0])
    for pose in aside(truth[k], FINE):
        yield (transform(pose, points[met]) // CELL).astype(int) @ np.array([1, 100]), z[met]


def difference(log: Log, camera: StereoRig, k: int) -> Array:
    """(E) less (F) of a picture at each offset, by the two formulas: no map goes in."""
    found = []
    for cell, z in cells(log, camera, k):
        n, total, square = (np.bincount(cell, v) for v in (None, z, z**2))
        several = n > 1
        n, total, square = n[several], total[several], square[several]
        half, s2 = (n - 1) / 2, (square - total**2 / n) / (n - 1)
        terms = -gammaln(half) + half * np.log(half) + (half - 1) * np.log(s2)
        found.append((terms + half * np.log(2 * np.pi) + np.log(n) / 2).sum())
    return np.array(found)


def cells_met(log: Log, k: int) -> Array:
    """How many cells a picture meets, at each offset."""
    return np.array([len(np.unique(cell)) for cell, _ in cells(log, RIG, k)])


# Worlds of which the assumptions of (F) hold, or all but one.


@dataclass(frozen=True)
class DrawnRig(StereoRig):
    """A rig whose heights were drawn: `kept`, for each picture, found by its ranges."""

    kept: dict[bytes, Array] = field(default_factory=dict, compare=False, repr=False)

    def heights(self, ranges: ArrayLike) -> Array:
        """Heights (m) of the picture that has these ranges."""
        return self.kept[np.asarray(ranges).tobytes()]


def drawn(
    log: Log,
    seed: int,
    lean: bool = False,
    bumps: str = "steps",
    shared: bool = False,
    mixed: bool = False,
) -> DrawnRig:
    """Draw heights as (F) has them: independent, normal, as rough as their patch.

    Or the plane of a lean is added; or a bump of 5 cm gives its points one height (`shared`), or
    the roughness of the patch of its middle, also to points beyond the border (`mixed`). Bumps are
    "steps", steps "moved" by half a bump, or joined "smooth".
    """
    terrain = Terrain.rough(np.random.default_rng(seed), (25.0, 25.0))
    field = np.asarray(terrain.heights - terrain.relief)
    sigma, rng = field.reshape(50, 10, 50, 10).std((1, 3)), np.random.default_rng(seed)
    of_bump = sigma.repeat(10, 0).repeat(10, 1)
    corners = [(0, 0), (0, 1), (1, 0), (1, 1)] if bumps == "smooth" else [(0, 0)]
    kept = {}
    steps = zip(*poses_and_ranges(log), log.notes["sway"], strict=True)
    for pose, ranges, (up, pitch, roll) in steps:
        points = RIG.points(ranges)
        met = np.isfinite(points[:, 0])
        at = transform(pose, points[met])
        column, row = (at // PATCH).astype(int).T
        low = np.floor(at / BUMP + {"moved": 0.5, "smooth": -0.5}.get(bumps, 0.0))
        z = np.full(len(points), np.nan)
        z[met] = 0.0
        for corner in corners:
            x, y = (low + corner).astype(int).T
            # how far a point has to the other corner, along x times along y
            share = np.abs(low + 1 - corner - (at / BUMP - 0.5)).prod(1)
            one = (field / of_bump)[y, x] if shared else rng.standard_normal(met.sum())
            roughness = of_bump[y, x] if mixed else sigma[row, column]
            z[met] += (share if bumps == "smooth" else 1.0) * one * roughness
        kept[ranges.tobytes()] = z + lean * (up - pitch * points[:, 0] + roll * points[:, 1])
    return DrawnRig(RIG.n_points, kept=kept)


def pictured(seed: int, camera: StereoRig = RIG, sway: Sway = CAMERAS["sways"]) -> Array:
    """Ten pictures of a drive, slid aside."""
    return slide(country(seed, sway), MAPS["variance"](), FINE, TEN, camera)


def ideal(**how: Any) -> Callable[[int], Array]:
    """Ten pictures of a world of drawn heights."""
    return lambda seed: pictured(seed, drawn(country(seed), seed, **how))


WORLDS: dict[str, Callable[[int], Array]] = {
    "heights as (F) has them": ideal(),
    "... and the plane of a lean": ideal(lean=True),
    "... one height a bump, in steps": ideal(shared=True),
    "... steps moved by half a bump": ideal(bumps="moved", shared=True, mixed=True),
    "... of these, only shared heights": ideal(bumps="moved", shared=True),
    "... of these, only mixed roughness": ideal(bumps="moved", mixed=True),
    "... bumps joined smoothly": ideal(bumps="smooth", shared=True, mixed=True),
    "... of them, only shared heights": ideal(bumps="smooth", shared=True),
    "... of them, only mixed roughness": ideal(bumps="smooth", mixed=True),
    "the ground, camera level": lambda seed: pictured(seed, sway=CAMERAS["level"]),
    "the ground, camera leans": pictured,
}
POWERS, PLACES = (0.3, 0.1, 0.03), (60, 1000)
UNITS = {"1 km": 1000.0, "1 m": 1.0, "10 cm": 0.1, "1 cm": 0.01, "1 mm": 0.001}

# The filter.


def filtered(log: Log, seed: int, camera: StereoRig = RIG, n: int = 60, **options: Any) -> Run:
    """Gamma-SLAM over a drive, by (F) with power 0.1 if nothing else is said."""
    options = {"temper": 0.1, "rng": np.random.default_rng(100 + seed), **options}
    slam = GammaSlam(camera, poses_and_ranges(log)[0][0], n, **options)
    return run(slam, log, record=("poses", "ancestors"))


def scores(result: Run) -> dict[str, float]:
    """Path error (m), median NEES from the twentieth step on, median number of parents."""
    e = pose_errors(result.poses, result.truth)
    inverse = np.linalg.inv(result.covs + 1e-9 * np.eye(3))
    nees = np.einsum("ti,tij,tj->t", e, inverse, e)[20:]
    parents = [len(np.unique(row)) for row in result.recorded["ancestors"]]
    return {
        "error": float(np.sqrt((e[:, :2] ** 2).sum(1).mean())),
        "nees": float(np.median(nees)),
        "parents": float(np.median(parents)),
    }


QUIET = VisualOdometer.simple(0.0002, 0.0003, 0.0004, 0.002)  # a fiftieth of the noise


def driven(
    sway: Sway = CAMERAS["sways"],
    odometer: VisualOdometer | None = None,
    as_f: bool = False,
    **options: Any,
) -> Callable[[int], Run]:
    """Run the filter over the drive of a seed."""

    def one(seed: int) -> Run:
        log = country(seed, sway, odometer)
        return filtered(log, seed, drawn(log, seed) if as_f else RIG, **options)

    return one


MANY = "300 particles, a fiftieth of the odometry's noise"
FILTERS: dict[str, Callable[[int], Run]] = {
    "as derived": driven(temper=1.0),
    "camera level": driven(CAMERAS["level"], temper=1.0),
    "1: heights as (F) has them": driven(as_f=True, temper=1.0),
    f"2: {MANY}": driven(odometer=QUIET, temper=1.0, n=300),
    "1 and 2": driven(odometer=QUIET, as_f=True, temper=1.0, n=300),
    "power 0.1": driven(),
    "power 0.1, and 1": driven(as_f=True),
    "power 0.1, by variances": driven(density="variances"),
}
