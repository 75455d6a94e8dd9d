"""Drives over rough ground: laps of a circle, a rig that sways, visual odometry that drifts.

What Gamma-SLAM needs (P5 section 2.3) and no log that we may ship has. Chapter 15.
"""

from __future__ import annotations

import numpy as np

from slamlab._checks import as_array, as_rng, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.logs import Log
from slamlab.sensors import StereoRig, VisualOdometer
from slamlab.worlds import Terrain

__all__ = ["ground_laps"]

# Stands for the odometry of P5's robot, of which no figure is given: noise of a step (m, rad),
# relative errors of distance and turn.
_ODOMETER = VisualOdometer.simple(0.01, 0.015, 0.02, 0.1)


def ground_laps(
    terrain: Terrain,
    rig: StereoRig,
    rng: np.random.Generator,
    *,
    laps: float = 2.0,
    radius: float = 7.0,
    step: float = 0.3,
    sway: tuple[float, float, float] = (0.05, np.deg2rad(1.0), np.deg2rad(1.0)),
    odometer: VisualOdometer = _ODOMETER,
) -> Log:
    """Drive round the middle of a terrain.

    Parameters
    ----------
    terrain : Terrain
    rig : StereoRig
    rng : numpy.random.Generator
    laps : float, default 2
    radius : float, default 7
        Of the circle (m).
    step : float, default 0.3
        Way between two pictures (m).
    sway : (float, float, float), default 5 cm, 1 and 1 degree
        Standard deviations of height, pitch and roll of the rig, drawn anew for each picture:
        what suspension and accelerometer leave.
    odometer : VisualOdometer
        What tells the motion from picture to picture.

    Returns
    -------
    Log
        Ranges of the rig, increments of the odometer with their covariance, truth; the sways are
        in ``notes["sway"]`` (T, 3) and the heights of the ground under the robot in
        ``notes["ground"]`` (T,).

    Raises
    ------
    ValueError
        If the circle leaves the terrain.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> ground_laps(Terrain.rough(rng), StereoRig(100), rng, laps=0.5)
    Log(74 steps over 73 s, scans of 100 beams, truth)
    """
    rng, radius = as_rng("rng", rng), as_scalar("radius", radius, 1e-3, 1e9)
    laps, step = as_scalar("laps", laps, 1e-3, 1e9), as_scalar("step", step, 1e-3, 1e9)
    spread = as_array("sway", sway, (3,))
    left, bottom, right, top = terrain.bounds
    if 2 * radius > min(right - left, top - bottom):
        raise ValueError(f"radius: expected a circle on {terrain!r}, got {radius:g} m")
    angle = np.arange(0.0, laps * 2 * np.pi, step / radius)
    middle = np.array([0.5 * (left + right), 0.5 * (bottom + top)])
    at = middle + radius * np.stack([np.sin(angle), -np.cos(angle)], -1)
    poses = np.concatenate([at, wrap_angle(angle)[:, None]], -1)
    u, cov = np.zeros((len(poses), 3)), np.zeros((len(poses), 3, 3))
    u[1:] = odometer.measure(poses[:-1], poses[1:], rng)
    cov[1:] = odometer.cov(u[1:])
    sways = spread * rng.standard_normal((len(poses), 3))
    ranges = rig.scan(terrain, poses, rng, sways)
    dt = np.where(np.arange(len(poses)) > 0, 1.0, 0.0)
    notes = {"sway": sways, "ground": terrain.height(at, relief=True)}
    return Log(
        np.cumsum(dt),
        u,
        dt,
        cov,
        ranges=ranges,
        scan=rig,
        truth=poses,
        notes=notes,
        controls="displacement",
    )
