"""Laps of a corridor that runs round a building: the loop for maps of walls.

The lidar sees a few metres: the robot meets nothing that it knows until it is round. Chapter 15.
"""

from __future__ import annotations

import numpy as np

from slamlab._checks import Array, as_array, as_rng, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.logs import Log
from slamlab.sensors import Lidar
from slamlab.simulation.drift import drifted
from slamlab.worlds import WallWorld

__all__ = ["ring_corridor", "ring_laps"]

WIDTH, TURN = 2.4, 1.2  # of the corridor, and radius of the robot's path round its corners (m)
_LIDAR = Lidar(60, np.deg2rad(240.0), max_range=5.0, sigma_range=0.02)


def ring_corridor(size: tuple[float, float], rng: np.random.Generator) -> WallWorld:
    """Draw a corridor of 2.4 m round a closed block, with pillars along its outer walls.

    Parameters
    ----------
    size : (float, float)
        Outer sides along x and y (m), at least 7.
    rng : numpy.random.Generator

    Raises
    ------
    ValueError
        If a side is too short or `rng` no generator.

    Examples
    --------
    >>> ring_corridor((12.0, 8.0), np.random.default_rng(5)).bounds
    (0.0, 0.0, 12.0, 8.0)
    """
    width, depth = _sides(size)
    rng = as_rng("rng", rng)
    outlines = [_box(0, 0, width, depth), _box(WIDTH, WIDTH, width - WIDTH, depth - WIDTH)]
    for length, horizontal, far in (
        (width, True, False),
        (width, True, True),
        (depth, False, False),
        (depth, False, True),
    ):
        along = np.cumsum(rng.uniform(1.5, 4.0, int(length)))
        for at in along[(along > 1.0) & (along < length - 1.5)]:
            across = (depth if horizontal else width) - 0.3 if far else 1e-3
            x, y = (at, across) if horizontal else (across, at)
            outlines.append(_box(x, y, x + 0.299, y + 0.299))
    return WallWorld.from_polygons(*outlines)


def ring_laps(
    size: tuple[float, float],
    rng: np.random.Generator,
    lidar: Lidar = _LIDAR,
    *,
    laps: float = 1.15,
    step: float = 0.4,
) -> Log:
    """Drive round such a corridor, and a little further, with odometry that drifts.

    Parameters
    ----------
    size : (float, float)
        As in `ring_corridor`; the pillars are the same for all drives of one size.
    rng : numpy.random.Generator
    lidar : Lidar
        By default 60 beams over 240 degrees that see 5 m.
    laps : float, default 1.15
    step : float, default 0.4
        Way between two scans (m).

    Returns
    -------
    Log
        Scans, controls as `simulation.drifted` makes them, truth.

    Raises
    ------
    ValueError
        If a number is out of range.

    Examples
    --------
    >>> ring_laps((12.0, 8.0), np.random.default_rng(1))
    Log(82 steps over 81 s, scans of 60 beams, truth)
    """
    laps, step = as_scalar("laps", laps, 1e-3, 1e3), as_scalar("step", step, 1e-3, 1e3)
    poses, rng = _round(_sides(size), laps, step), as_rng("rng", rng)
    ranges = lidar.scan(ring_corridor(size, np.random.default_rng(5)), poses, rng)
    n = len(poses)
    still, dt = np.zeros((n, 3)), np.minimum(np.arange(n), 1.0)
    log = Log(np.arange(float(n)), still, dt, np.eye(3), ranges=ranges, scan=lidar, truth=poses)
    return drifted(log, rng)


def _sides(size: tuple[float, float]) -> Array:
    sides = as_array("size", size, (2,))
    if sides.min() < 7.0:
        raise ValueError(f"size: expected sides of at least 7 m, got {size!r:.80}")
    return sides


def _round(sides: Array, laps: float, step: float) -> Array:
    """Poses every `step` along the middle of the corridor, its corners rounded."""
    straight = sides - WIDTH - 2 * TURN
    lengths = np.array([straight[0], 0.0, straight[1], 0.0] * 2)
    lengths[1::2] = 0.5 * np.pi * TURN
    ends = np.cumsum(lengths)
    s = np.arange(0.0, laps * ends[-1], step)
    # Heading along the way, then the way itself by adding up small steps, exact on each piece.
    piece = np.searchsorted(ends, s % ends[-1], side="right")
    within = s % ends[-1] - (ends - lengths)[piece]
    heading = 0.5 * np.pi * (piece // 2) + np.where(piece % 2, within / TURN, 0.0)
    low = np.array([0.5 * WIDTH, 0.5 * WIDTH])
    corners = low + TURN + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * straight
    # A straight begins a radius to the right of its corner's centre and leads to the next one.
    out = np.stack([np.sin(heading), -np.cos(heading)], -1)
    ahead = np.stack([np.cos(heading), np.sin(heading)], -1)
    centre = corners[((piece + 1) // 2) % 4]
    on_straight = (piece % 2 == 0)[:, None] * within[:, None] * ahead
    return np.concatenate([centre + TURN * out + on_straight, wrap_angle(heading)[:, None]], -1)


def _box(left: float, bottom: float, right: float, top: float) -> Array:
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top]], dtype=float)
