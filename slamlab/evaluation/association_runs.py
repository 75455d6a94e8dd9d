"""A loop with drift and clutter, and how often an association names the right landmark in it.

The experiment of chapter 11: a robot drives round, loses itself a little, and comes back to where
its map begins.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array, as_count, as_rng, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.robots import Unicycle
from slamlab.sensors import RangeBearing
from slamlab.slam.ekf import EKFSlam

__all__ = ["Loop", "LoopRun", "run_loop", "simulate_loop"]


@dataclass(frozen=True, eq=False)
class Loop:
    """What happened on a drive round a circle.

    Attributes
    ----------
    poses : ndarray, shape (T + 1, 3)
        True poses.
    landmarks : ndarray, shape (n, 2)
        True landmarks.
    controls : ndarray, shape (T, 2)
        Speed and turn rate as measured.
    looks : tuple of (z, ids)
        After each step: measurements (k, 2) and true landmarks (k,), -1 for clutter.
    lap : int
        Steps of one lap.
    dt : float
        Duration of a step (s).
    control_cov : ndarray, shape (2, 2)
    motion, sensor
        The models.
    """

    poses: Array
    landmarks: Array
    controls: Array
    looks: tuple[tuple[Array, NDArray[np.intp]], ...]
    lap: int
    dt: float
    control_cov: Array
    motion: Any
    sensor: Any


@dataclass(frozen=True, eq=False)
class LoopRun:
    """What a filter made of a loop.

    Attributes
    ----------
    poses : ndarray, shape (T + 1, 3)
        Estimated poses.
    covs : ndarray, shape (T + 1, 3, 3)
    landmarks : ndarray, shape (m, 2)
        Estimated map at the end.
    landmark_covs : ndarray, shape (m, 2, 2)
    origins : ndarray of int, shape (m,)
        True landmark from which each was started, -1 for clutter.
    named : int
        Measurements that were paired with a landmark of the map by the association.
    right : int
        Of these, those paired with a landmark that was started by the same true landmark.
    possible : int
        Measurements whose true landmark stood in the map.
    error : float
        Distance of the last estimated position from the true one (m).
    """

    poses: Array
    covs: Array
    landmarks: Array
    landmark_covs: Array
    origins: NDArray[np.intp]
    named: int
    right: int
    possible: int
    error: float

    @property
    def precision(self) -> float:
        """Share of the pairs made that are right; 1 if none was made."""
        return self.right / self.named if self.named else 1.0

    @property
    def recall(self) -> float:
        """Share of the possible pairs that were made and are right; 1 if none was possible."""
        return self.right / self.possible if self.possible else 1.0


def simulate_loop(
    rng: np.random.Generator,
    *,
    drift: float = 1.0,
    clutter_rate: float = 1.0,
    n_landmarks: int = 40,
    p_detect: float = 0.9,
    laps: float = 1.1,
) -> Loop:
    """Leave an orchard, drive round a circle with the sensor off, and come back among the trees.

    The circle has 8 m radius; the trees stand where it begins, 5 to 11 m from its centre and
    within 40 degrees of the start. The robot looks while it leaves (ten steps) and again from
    three steps before the lap is closed. In between it has only its odometry, so what a filter
    believes of its pose when it returns is honest, and wide.

    Parameters
    ----------
    rng : numpy.random.Generator
    drift : float, default 1.0
        Scale of the odometry noise: 1 is 0.05 m/s and 0.01 rad/s in every step of half a second.
    clutter_rate : float, default 1.0
        Mean number of false measurements a look.
    n_landmarks : int, default 40
    p_detect : float, default 0.9
        Probability that a landmark within 4 m is seen.
    laps : float, default 1.1

    Returns
    -------
    Loop

    Raises
    ------
    ValueError
        If an argument is out of range.
    """
    rng, n = as_rng("rng", rng), as_count("n_landmarks", n_landmarks, 1)
    drift, laps = as_scalar("drift", drift, 0.0, 1e3), as_scalar("laps", laps, 0.0, 1e3)
    motion, sensor = Unicycle(), RangeBearing(0.05, np.deg2rad(0.5), max_range=4.0)
    dt, lap = 0.5, 100
    angle, radius = np.deg2rad(rng.uniform(-40, 40, n)), rng.uniform(5, 11, n)
    landmarks = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    control = np.array([2 * np.pi * 8 / (lap * dt), 2 * np.pi / (lap * dt)])
    control_cov = drift**2 * np.diag([0.05, 0.01]) ** 2
    steps = round(laps * lap)
    controls = control + rng.standard_normal((steps, 2)) * np.sqrt(np.diag(control_cov))
    poses, looks = np.empty((steps + 1, 3)), []
    poses[0] = 8.0, 0.0, np.pi / 2
    for k in range(steps):
        poses[k + 1] = motion.step(poses[k], control, dt)
        asleep = 10 <= k < lap - 3
        z, ids = sensor.measure(
            poses[k + 1],
            landmarks,
            rng,
            p_detect=0.0 if asleep else p_detect,
            clutter_rate=0.0 if asleep else clutter_rate,
        )
        looks.append((z, ids))
    return Loop(poses, landmarks, controls, tuple(looks), lap, dt, control_cov, motion, sensor)


def run_loop(
    loop: Loop, associate: Callable[[EKFSlam, Array], Any], known_until: int | None = None
) -> LoopRun:
    """Run EKF-SLAM over a loop and count what its association did.

    Parameters
    ----------
    loop : Loop
    associate : callable
        ``associate(slam, z) -> rows (k,)``.
    known_until : int, optional
        Until this step the filter is told which landmark is which, so that every association
        starts with the same map. For half the lap if left out.

    Returns
    -------
    LoopRun
        Counts from `known_until` on.

    Raises
    ------
    ValueError
        If `known_until` is negative, or as `EKFSlam.step`.
    """
    told = as_count("known_until", loop.lap // 2 if known_until is None else known_until)
    slam = EKFSlam(loop.motion, loop.sensor, loop.poses[0])
    origin: dict[Hashable, int] = {}
    counts = np.zeros(3, dtype=int)
    poses, covs = [slam.pose.copy()], [slam.pose_cov]
    for k, (u, (z, truth)) in enumerate(zip(loop.controls, loop.looks, strict=True)):
        if k < told:
            seen = truth >= 0
            slam.predict(u, loop.dt, loop.control_cov)
            slam.update(z[seen], truth[seen])
            origin |= {int(one): int(one) for one in truth[seen]}
        else:
            before = set(origin)
            names = slam.step(u, loop.dt, loop.control_cov, z, associate)
            counts += _count(names, truth, origin)
            new = {name: int(t) for name, t in zip(names, truth, strict=True)}
            origin |= {a: t for a, t in new.items() if a is not None and a not in before}
        poses.append(slam.pose.copy())
        covs.append(slam.pose_cov)
    error = float(np.hypot(*(poses[-1] - loop.poses[-1])[:2]))
    origins = np.array([origin[name] for name in slam.ids], dtype=np.intp)
    track = np.array(poses)
    track[:, 2] = wrap_angle(track[:, 2])
    named, right, possible = (int(count) for count in counts)
    return LoopRun(
        poses=track,
        covs=np.array(covs),
        landmarks=slam.landmarks.copy(),
        landmark_covs=slam.landmark_covs,
        origins=origins,
        named=named,
        right=right,
        possible=possible,
        error=error,
    )


def _count(
    names: tuple[Hashable | None, ...], truth: NDArray[np.intp], origin: dict[Hashable, int]
) -> NDArray[np.intp]:
    """Pairs made, right ones, and possible ones of one look."""
    known = set(origin.values())
    named = [(name, int(t)) for name, t in zip(names, truth, strict=True) if name in origin]
    right = sum(t >= 0 and origin[name] == t for name, t in named)
    return np.array([len(named), right, sum(int(t) in known for t in truth if t >= 0)])
