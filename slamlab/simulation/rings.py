"""Laps of a corridor that runs round a building: the loop for maps of walls.

The lidar sees a few metres: the robot meets nothing that it knows until it is round. Chapter 15.
"""

from __future__ import annotations

import numpy as np

from slamlab._checks import Array, as_rng, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.logs import Log
from slamlab.sensors import Lidar
from slamlab.simulation.drift import drifted
from slamlab.worlds import rooms

__all__ = ["ring_laps"]

TURN = 1.2  # radius of the robot's path round the corners (m)
_LIDAR = Lidar(60, np.deg2rad(240.0), max_range=5.0, sigma_range=0.02)


def ring_laps(
    size: tuple[float, float],
    rng: np.random.Generator,
    lidar: Lidar = _LIDAR,
    *,
    laps: float = 1.15,
    step: float = 0.4,
) -> Log:
    """Drive round a `rooms.ring_corridor` and a little further, with odometry that drifts.

    Parameters
    ----------
    size : (float, float)
        Of the corridor (m), at least 7; the pillars are the same for all drives of one size.
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

    Examples
    --------
    >>> ring_laps((12.0, 8.0), np.random.default_rng(1))
    Log(82 steps over 81 s, scans of 60 beams, truth)
    """
    laps, step = as_scalar("laps", laps, 1e-3, 1e3), as_scalar("step", step, 1e-3, 1e3)
    world, rng = rooms.ring_corridor(size, np.random.default_rng(5)), as_rng("rng", rng)
    poses = _round(np.asarray(size, float), laps, step)
    ranges = lidar.scan(world, poses, rng)
    n = len(poses)
    still, dt = np.zeros((n, 3)), np.minimum(np.arange(n), 1.0)
    log = Log(np.arange(float(n)), still, dt, np.eye(3), ranges=ranges, scan=lidar, truth=poses)
    return drifted(log, rng)


def _round(sides: Array, laps: float, step: float) -> Array:
    """Poses every `step` along the middle of the corridor, its corners rounded."""
    straight = sides - rooms.RING_WIDTH - 2 * TURN
    lengths = np.array([straight[0], 0.0, straight[1], 0.0] * 2)
    lengths[1::2] = 0.5 * np.pi * TURN
    ends = np.cumsum(lengths)
    s = np.arange(0.0, laps * ends[-1], step)
    # Heading along the way, then the way itself by adding up small steps, exact on each piece.
    piece = np.searchsorted(ends, s % ends[-1], side="right")
    within = s % ends[-1] - (ends - lengths)[piece]
    heading = 0.5 * np.pi * (piece // 2) + np.where(piece % 2, within / TURN, 0.0)
    low = np.full(2, 0.5 * rooms.RING_WIDTH)
    corners = low + TURN + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * straight
    # A straight begins a radius to the right of its corner's centre and leads to the next one.
    out = np.stack([np.sin(heading), -np.cos(heading)], -1)
    ahead = np.stack([np.cos(heading), np.sin(heading)], -1)
    centre = corners[((piece + 1) // 2) % 4]
    on_straight = (piece % 2 == 0)[:, None] * within[:, None] * ahead
    return np.concatenate([centre + TURN * out + on_straight, wrap_angle(heading)[:, None]], -1)
