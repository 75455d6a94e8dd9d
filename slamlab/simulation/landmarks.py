"""Drives among landmarks: the worlds of chapters 09 to 12, each of them a `Log`.

`room_drives` stands in for P1's experiment, `orchard_loop` is the return of chapter 11.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_count, as_covariance, as_rng, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.logs import Log
from slamlab.models import MotionModel, as_motion, as_sensor, controls_of
from slamlab.robots import YOUBOT, Unicycle, dead_reckoning
from slamlab.sensors import RangeBearing, Wall

__all__ = ["ORCHARD_SENSOR", "ROOM_SENSOR", "landmark_drives", "orchard_loop", "room_drives"]

# 5 cm, 1 degree, 0.3 m ahead of the centre, 5 m far.
ROOM_SENSOR = RangeBearing(0.05, np.radians(1.0), offset=0.3, max_range=5.0)
# 5 cm, half a degree, 4 m far.
ORCHARD_SENSOR = RangeBearing(0.05, np.radians(0.5), max_range=4.0)


def landmark_drives(
    motion: MotionModel,
    sensor: RangeBearing | Wall,
    landmarks: ArrayLike,
    u: ArrayLike,
    dt: float,
    control_cov: ArrayLike,
    n_runs: int,
    rng: np.random.Generator,
    start: ArrayLike = (0.0, 0.0, 0.0),
    start_cov: ArrayLike | None = None,
) -> Log:
    """Drive `n_runs` robots by the same controls, each with its own noise.

    Parameters
    ----------
    motion, sensor
        The right models: how the robots move, what they measure (`sensor.visible` tells what).
    landmarks : array_like, shape (n, 2)
        True landmarks, as the sensor understands them.
    u : array_like, shape (T, l)
        Controls as the robot measures them.
    dt : float
        Duration of a step (s).
    control_cov : array_like, shape (l, l)
        Covariance of the executed control around `u`.
    n_runs : int
        M, at least 1.
    rng : numpy.random.Generator
    start : array_like, shape (3,), default the origin
        True pose at the start.
    start_cov : array_like, shape (3, 3), optional
        The true starts are drawn around `start` with this covariance; equal to it if left out.

    Returns
    -------
    Log
        A batch of T + 1 steps with truth and landmarks. The first step lasts 0 s and sees
        nothing; then u, the same in all runs, and looks (M, n, 2), NaN what is not seen.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> trees, u = [[5.0, 1.0], [9.0, -2.0]], [[1.0, 0.1]] * 20
    >>> landmark_drives(Unicycle(), RangeBearing(0.1, 0.02), trees, u, 0.5, 0.01 * np.eye(2), 3,
    ...                 np.random.default_rng(1))
    Log(21 steps over 10 s, 3 runs, 120 measurements of landmarks, truth)
    """
    as_motion("motion", motion), as_sensor("sensor", sensor)
    landmarks, u = as_array("landmarks", landmarks, ("n", 2)), as_array("u", u, ("T", "l"))
    control_cov = as_covariance("control_cov", control_cov, u.shape[1])
    n_runs, rng = as_count("n_runs", n_runs, 1), as_rng("rng", rng)
    dt = as_scalar("dt", dt, low=0.0, high=1e300)
    first = np.tile(as_array("start", start, (3,)), (n_runs, 1))
    if start_cov is not None:
        start_cov = as_covariance("start_cov", start_cov, 3)
        first = first + rng.multivariate_normal(np.zeros(3), start_cov, n_runs)
        first[:, 2] = wrap_angle(first[:, 2])
    poses = [first]
    for control in u:
        poses.append(motion.sample(poses[-1], control, dt, control_cov, rng))
    truth = np.array(poses)
    there = truth[1:, :, None, :]
    noise = rng.standard_normal((len(u), n_runs, len(landmarks), 2))
    z = sensor.observe(there, landmarks) + noise * np.sqrt(np.diag(sensor.cov))
    if abs(sensor.residual([1.0, 2 * np.pi], [1.0, 0.0])[1]) < 1:  # a full turn: it is an angle
        z[..., 1] = wrap_angle(z[..., 1])
    z[~sensor.visible(there, landmarks)] = np.nan
    observations = (np.full((n_runs, len(landmarks), 2), np.nan), *z)
    ids = (np.arange(len(landmarks)),) * len(poses)
    return landmark_log(
        u,
        dt,
        control_cov,
        landmark_measurements=observations,
        ids=ids,
        truth=truth,
        landmarks=landmarks,
        controls=controls_of(motion),
    )


def room_drives(
    n_runs: int,
    rng: np.random.Generator,
    sensor: RangeBearing | Wall = ROOM_SENSOR,
    landmarks: ArrayLike | None = None,
    *,
    n_steps: int = 600,
    sigma_wheel: float = 0.4,
    start_cov: ArrayLike | None = None,
) -> Log:
    """Drive a youBot two rounds through a room of 10 x 8 m: what stands in for P1's experiment.

    The paper gives no room, no noise and no path; these are ours. The robot turns once in 30 s
    at 0.5 m/s and strafes as it goes, ten steps a second.

    Parameters
    ----------
    n_runs : int
        M, at least 1.
    rng : numpy.random.Generator
    sensor : sensor of landmarks, default `ROOM_SENSOR`
    landmarks : array_like, shape (n, 2), optional
        24 points in the room, which lies around the origin, half a metre and more off the path,
        if left out.
    n_steps : int, default 600
        T, at least 1.
    sigma_wheel : float, default 0.4
        Noise of each wheel's speed (rad/s).
    start_cov : array_like, shape (3, 3), optional
        As `landmark_drives`.

    Returns
    -------
    Log
        As `landmark_drives`.

    Examples
    --------
    >>> room_drives(2, np.random.default_rng(1), n_steps=100)
    Log(101 steps over 10 s, 2 runs, 3278 measurements of landmarks, truth)
    """
    rng, n_steps = as_rng("rng", rng), as_count("n_steps", n_steps, 1)
    dt = 0.1
    t = dt * np.arange(n_steps)
    u = np.stack([np.full(n_steps, 0.5), 0.15 * np.sin(0.5 * t), np.full(n_steps, np.pi / 15)], 1)
    control_cov = YOUBOT.control_cov(as_scalar("sigma_wheel", sigma_wheel, 0.0, 1e6))
    start = np.array([0.0, -2.4, 0.0])
    if landmarks is None:
        many = rng.uniform([-5.0, -4.0], [5.0, 4.0], (200, 2))
        gap = many[:, None] - dead_reckoning(YOUBOT, start, u, dt)[:, :2]
        landmarks = many[np.hypot(gap[..., 0], gap[..., 1]).min(1) > 0.5][:24]
    world = (YOUBOT, sensor, landmarks, u, dt, control_cov)
    return landmark_drives(*world, n_runs, rng, start, start_cov)


def orchard_loop(
    rng: np.random.Generator,
    *,
    drift: float = 1.0,
    clutter_rate: float = 1.0,
    n_landmarks: int = 40,
    p_detect: float = 0.9,
    laps: float = 1.1,
) -> Log:
    """Leave an orchard, drive round a circle with the sensor off, and come back among the trees.

    The circle has 8 m radius; the trees stand where it begins, 5 to 11 m from its centre and
    within 40 degrees of the start. A lap has 100 steps. The `Unicycle` measures while it leaves
    (ten steps) and again from three steps before the lap is closed, with `ORCHARD_SENSOR`. In
    between it has only its odometry, so what a filter believes of its pose when it returns is
    honest, and wide.

    Parameters
    ----------
    rng : numpy.random.Generator
    drift : float, default 1.0
        Scale of the odometry noise: 1 is 0.05 m/s and 0.01 rad/s in every step of half a second.
    clutter_rate : float, default 1.0
        Mean number of false measurements a step.
    n_landmarks : int, default 40
    p_detect : float, default 0.9
        Probability that a landmark within 4 m is seen.
    laps : float, default 1.1

    Returns
    -------
    Log
        With truth, landmarks, and ids, -1 for clutter.

    Examples
    --------
    >>> orchard_loop(np.random.default_rng(1))
    Log(111 steps over 55 s, 473 measurements of landmarks, truth)
    """
    rng, n = as_rng("rng", rng), as_count("n_landmarks", n_landmarks, 1)
    drift, laps = as_scalar("drift", drift, 0.0, 1e3), as_scalar("laps", laps, 0.0, 1e3)
    p_detect = as_scalar("p_detect", p_detect, 0.0, 1.0)
    clutter_rate = as_scalar("clutter_rate", clutter_rate, 0.0)
    dt, lap = 0.5, 100
    angle, radius = np.deg2rad(rng.uniform(-40, 40, n)), rng.uniform(5, 11, n)
    landmarks = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    control = np.array([2 * np.pi * 8 / (lap * dt), 2 * np.pi / (lap * dt)])
    control_cov = drift**2 * np.diag([0.05, 0.01]) ** 2
    steps = round(laps * lap)
    u = control + rng.standard_normal((steps, 2)) * np.sqrt(np.diag(control_cov))
    start = [8.0, 0.0, np.pi / 2]
    poses = dead_reckoning(Unicycle(), start, np.tile(control, (steps, 1)), dt)
    observations, ids = [np.empty((0, 2))], [np.empty(0, dtype=np.intp)]
    for k, pose in enumerate(poses[1:]):
        awake = not 10 <= k < lap - 3
        chances = dict(p_detect=p_detect * awake, clutter_rate=clutter_rate * awake)
        z, names = ORCHARD_SENSOR.measure(pose, landmarks, rng, **chances)
        observations.append(z)
        ids.append(names)
    return landmark_log(
        u,
        dt,
        control_cov,
        landmark_measurements=observations,
        ids=ids,
        truth=poses,
        landmarks=landmarks,
    )


def landmark_log(u: Array, dt: float, control_cov: Array, **parts: Any) -> Log:
    """Log of T steps of dt, after one that moved nothing, with the other `parts` of a log."""
    steps = np.arange(len(u) + 1, dtype=float)
    u = np.concatenate([np.zeros((1, *u.shape[1:])), u])
    parts = {"controls": "velocity"} | parts
    return Log(dt * steps, u, np.minimum(steps, 1.0) * dt, control_cov, **parts)
