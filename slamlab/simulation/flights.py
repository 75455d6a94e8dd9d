"""Flights over a field of trees, lane by lane: the world of chapter 16.

Stands in for the flights of P4, of which only page 84 and the abstract are at hand: no field, path
or noise of its own is known.
"""

from __future__ import annotations

import numpy as np

from slamlab._checks import Array, as_array, as_count, as_positive, as_rng, as_scalar
from slamlab.gaussian import matrix_sqrt
from slamlab.logs import Log
from slamlab.models import as_sensor
from slamlab.robots import Unicycle, dead_reckoning
from slamlab.sensors import PointSensor
from slamlab.simulation.landmarks import landmark_log

__all__ = ["FIELD_SENSOR", "field_flights"]

# Coordinates of a tree in the frame of the aircraft to 20 cm, as P4 measures them; 20 m far.
FIELD_SENSOR = PointSensor(0.2**2 * np.eye(2), max_range=20.0)


def field_flights(
    n_runs: int,
    rng: np.random.Generator,
    sensor: PointSensor = FIELD_SENSOR,
    *,
    side: float = 90.0,
    lane: float = 30.0,
    n_landmarks: int | None = None,
    sigmas: tuple[float, float] = (0.5, 0.03),
    felled: float = 0.0,
    own_lane: bool = False,
) -> Log:
    """Fly over a square field lane by lane, turn by half circles, and come home across the lanes.

    The autopilot holds the lanes: the true path is the same in every run, 5 m/s, 0.4 s a step.
    What the aircraft measures of it, its speed and turn rate, carries noise, and so does every
    measurement; the trees and the path do not depend on the sensor.

    Parameters
    ----------
    n_runs : int
        M, at least 1.
    rng : numpy.random.Generator
    sensor : PointSensor, default `FIELD_SENSOR`
    side : float, default 90.0
        Side of the field (m), which begins at the origin.
    lane : float, default 30.0
        Distance of two lanes (m), at most half the side.
    n_landmarks : int, optional
        Trees, at random places; one in 100 m^2 if left out.
    sigmas : (float, float), default (0.5, 0.03)
        Noise of the speed (m/s) and of the turn rate (rad/s) measured in a step.
    felled : float, default 0.0
        Share of trees that are missing on the right half of the field, in [0, 1].
    own_lane : bool, default False
        Of all trees in range only those of the lane are seen over which the aircraft is; noise,
        path and trees are the same.

    Returns
    -------
    Log
        A batch with truth, landmarks and ids. The first step moves nothing; each step tells the
        controls (T, M, 2) of a `Unicycle` and the looks (T, M, n, 2), NaN what is not seen.

    Examples
    --------
    >>> field_flights(2, np.random.default_rng(1))
    Log(181 steps over 72 s, 2 runs, 3548 measurements of landmarks, truth)
    """
    n_runs, rng = as_count("n_runs", n_runs, 1), as_rng("rng", rng)
    side = as_positive("side", side, 1e6)
    lane = as_positive("lane", lane, side / 2)
    n = round(side**2 / 100) if n_landmarks is None else n_landmarks
    n, felled = as_count("n_landmarks", n, 1), as_scalar("felled", felled, 0.0, 1.0)
    as_sensor("sensor", sensor)
    noise = as_array("sigmas", sigmas, (2,))
    if (noise < 0).any():
        raise ValueError(f"sigmas: expected no negative number, got {noise.min():g}")
    landmarks = rng.uniform(0.0, side, (n, 2))
    landmarks = landmarks[(landmarks[:, 0] < side / 2) | (rng.random(n) >= felled)]
    controls, dt = _lanes(side, lane), 0.4
    truth = dead_reckoning(Unicycle(), [lane / 2, lane / 2, 0.0], controls, dt)[:, None]
    steps, n = len(truth), len(landmarks)
    u = controls[:, None] + noise * rng.standard_normal((steps - 1, n_runs, 2))
    error = rng.standard_normal((steps, n_runs, n, 2)) @ matrix_sqrt(sensor.cov).T
    there = sensor.visible(truth, landmarks)
    if own_lane:
        there &= truth[..., 1] // lane == landmarks[:, 1] // lane
    measured = sensor.observe(truth, landmarks)[:, None] + error
    z = np.where(there[:, None, :, None], measured, np.nan)
    ids, cov = (np.arange(n),) * steps, np.diag(noise**2)
    truth = truth.repeat(n_runs, axis=1)
    return landmark_log(
        u, dt, cov, landmark_measurements=z, ids=ids, truth=truth, landmarks=landmarks
    )


def _leg(metres: float, turn: float = 0.0) -> Array:
    """Return controls (k, 2) of a straight flight or an arc, in steps of about two metres."""
    k = max(1, round(metres / 2.0))
    return np.tile([metres / (0.4 * k), turn / (0.4 * k)], (k, 1))


def _lanes(side: float, lane: float) -> Array:
    """Return controls (T, 2): lanes with half circles between them, then home across all lanes."""
    n, half, legs = int(side / lane + 1e-9), np.pi * lane / 2, []
    for k in range(n):
        legs += [_leg(side - lane), _leg(half, np.pi if k % 2 == 0 else -np.pi)]
    home = -np.pi / 2 if n % 2 else np.pi / 2
    legs[-1] = _leg(half / 2, home)
    return np.concatenate([*legs, _leg((n - 1) * lane)])
