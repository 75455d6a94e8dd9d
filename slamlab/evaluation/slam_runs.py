"""Many EKF-SLAM runs at once: the same drive with other noise, all runs in one array.

The Monte Carlo behind chapters 09 and 10: what a model that is a little wrong does to the error
and to the belief in it. One run of `run` is `slam.EKFSlam`, number for number; tests hold that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_count, as_covariance, as_rng, as_scalar
from slamlab.evaluation.consistency import nees
from slamlab.geometry import wrap_angle
from slamlab.robots import YOUBOT
from slamlab.sensors import RangeBearing
from slamlab.slam.ekf import times_H

__all__ = ["Drives", "Runs", "dead_reckoning", "room_drives", "run", "simulate"]


@dataclass(frozen=True, eq=False)
class Drives:
    """What happened in the world: M runs of T steps among n landmarks.

    Attributes
    ----------
    poses : ndarray, shape (T + 1, M, 3)
        True poses; all runs start at the same one.
    landmarks : ndarray, shape (n, 2)
        True landmarks.
    u : ndarray, shape (T, 3) or (T, 2)
        Controls as measured, the same in all runs; what was executed differs by the noise.
    dt : float
        Duration of a step (s).
    control_cov : ndarray, shape (l, l)
        Covariance V of that noise.
    z : ndarray, shape (T, M, n, 2)
        Measurement of each landmark after each step; meaningless where `seen` is False.
    seen : ndarray of bool, shape (T, M, n)
    motion, sensor
        The right models.
    """

    poses: Array
    landmarks: Array
    u: Array
    dt: float
    control_cov: Array
    z: Array
    seen: NDArray[np.bool_]
    motion: Any
    sensor: Any


@dataclass(frozen=True, eq=False)
class Runs:
    """What M filters believed along the same drives.

    Attributes
    ----------
    drives : Drives
    poses : ndarray, shape (T + 1, M, 3)
        Estimated poses.
    pose_covs : ndarray, shape (T + 1, M, 3, 3)
        Their covariances.
    landmarks : ndarray, shape (M, n, 2)
        The maps in the end; NaN where a landmark was never seen.
    landmark_covs : ndarray, shape (M, n, 2, 2)
        Covariances of the landmarks in the end.
    """

    drives: Drives
    poses: Array
    pose_covs: Array
    landmarks: Array
    landmark_covs: Array

    @property
    def nees(self) -> Array:
        """NEES of the pose after each step, shape (T, M); 3 is due on average.

        NaN where a covariance is singular: a unicycle cannot err sideways in its first step.
        """
        spread = np.linalg.eigvalsh(self.pose_covs[1:])
        regular = spread[..., 0] > 1e-12 * spread[..., -1]
        pair = self.poses[1:][regular], self.drives.poses[1:][regular]
        values = np.full(regular.shape, np.nan)
        values[regular] = nees(pair, self.pose_covs[1:][regular], angles=(2,))
        return values

    @property
    def mean_nees(self) -> float:
        """NEES of the pose, averaged over steps and runs."""
        return float(np.nanmean(self.nees))

    @property
    def position_errors(self) -> Array:
        """Distance between the estimated and the true position (m), shape (T + 1, M)."""
        difference = self.poses[..., :2] - self.drives.poses[..., :2]
        return np.hypot(difference[..., 0], difference[..., 1])

    @property
    def rmse(self) -> float:
        """Root mean square of `position_errors` over steps and runs (m)."""
        return float(np.sqrt((self.position_errors**2).mean()))

    @property
    def landmark_errors(self) -> Array:
        """Distance between point landmarks of the map and the true ones (m), shape (M, n)."""
        difference = self.landmarks - self.drives.landmarks
        return np.hypot(difference[..., 0], difference[..., 1])

    @property
    def map_rmse(self) -> float:
        """Root mean square of `landmark_errors` over runs and the landmarks seen (m)."""
        return float(np.sqrt(np.nanmean(self.landmark_errors**2)))


def simulate(
    motion: Any,
    sensor: Any,
    landmarks: ArrayLike,
    u: ArrayLike,
    dt: float,
    control_cov: ArrayLike,
    n_runs: int,
    rng: np.random.Generator,
    start: ArrayLike = (0.0, 0.0, 0.0),
) -> Drives:
    """Drive `n_runs` robots by the same controls, each with its own noise.

    Parameters
    ----------
    motion, sensor
        The right models: how the robots move, what they measure.
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

    Returns
    -------
    Drives

    Raises
    ------
    ValueError
        If a shape does not fit, a number is not finite, or a count is below 1.
    """
    landmarks, u = as_array("landmarks", landmarks, ("n", 2)), as_array("u", u, ("T", "l"))
    control_cov = as_covariance("control_cov", control_cov, u.shape[1])
    n_runs, rng = as_count("n_runs", n_runs, 1), as_rng("rng", rng)
    dt = as_scalar("dt", dt, low=0.0, high=1e300)
    poses = [np.tile(as_array("start", start, (3,)), (n_runs, 1))]
    for control in u:
        poses.append(motion.sample(poses[-1], control, dt, control_cov, rng))
    truth = np.array(poses)
    there = truth[1:, :, None, :]
    noise = rng.standard_normal((len(u), n_runs, len(landmarks), 2))
    z = sensor.observe(there, landmarks) + noise * np.sqrt(np.diag(sensor.cov))
    z[..., 1] = wrap_angle(z[..., 1])
    seen = sensor.visible(there, landmarks)
    return Drives(truth, landmarks, u, dt, control_cov, z, seen, motion, sensor)


def room_drives(
    n_runs: int,
    rng: np.random.Generator,
    sensor: Any = None,
    landmarks: ArrayLike | None = None,
    *,
    n_steps: int = 600,
    sigma_wheel: float = 0.4,
) -> Drives:
    """Drive a youBot two rounds through a room of 10 x 8 m: what stands in for P1's experiment.

    The paper gives no room, no noise and no path; these are ours. The robot turns once in 30 s
    at 0.5 m/s and strafes as it goes, ten steps a second.

    Parameters
    ----------
    n_runs : int
        M, at least 1.
    rng : numpy.random.Generator
    sensor : sensor model, optional
        Range and bearing with 5 cm, 1 degree, 0.3 m ahead of the centre, 5 m far, if left out.
    landmarks : array_like, shape (n, 2), optional
        24 points in the room, which lies around the origin, half a metre and more off the path,
        if left out.
    n_steps : int, default 600
        T, at least 1.
    sigma_wheel : float, default 0.4
        Noise of each wheel's speed (rad/s).

    Returns
    -------
    Drives

    Raises
    ------
    ValueError
        If a count is below 1 or a shape does not fit.
    """
    rng, n_steps = as_rng("rng", rng), as_count("n_steps", n_steps, 1)
    dt = 0.1
    t = dt * np.arange(n_steps)
    u = np.stack([np.full(n_steps, 0.5), 0.15 * np.sin(0.5 * t), np.full(n_steps, np.pi / 15)], 1)
    if sensor is None:
        sensor = RangeBearing(0.05, np.radians(1.0), offset=0.3, max_range=5.0)
    start, control_cov = np.array([0.0, -2.4, 0.0]), YOUBOT.control_cov(sigma_wheel)
    if landmarks is None:
        many = rng.uniform([-5.0, -4.0], [5.0, 4.0], (200, 2))
        gap = many[:, None] - _path(YOUBOT, start, u, dt)[:, :2]
        landmarks = many[np.hypot(gap[..., 0], gap[..., 1]).min(1) > 0.5][:24]
    return simulate(YOUBOT, sensor, landmarks, u, dt, control_cov, n_runs, rng, start)


def run(
    drives: Drives,
    motion: Any = None,
    sensor: Any = None,
    *,
    start_cov: ArrayLike | None = None,
    repeat_prediction: bool = False,
    forget_ties: bool = False,
) -> Runs:
    """Run EKF-SLAM with known landmark identities along all drives at once.

    The filters start at the true pose of the start and know no landmark.

    Parameters
    ----------
    drives : Drives
    motion, sensor
        What the filter believes; the right models if left out.
    start_cov : array_like, shape (3, 3), optional
        How uncertain the filter believes the start to be; zero if left out.
    repeat_prediction : bool, default False
        Predict the covariance once for each landmark seen: wrong, and what P1's text after (36)
        demands.
    forget_ties : bool, default False
        Predict P_xx and leave P_xm as it was: wrong, and what P2 (9) says if it is read alone.

    Returns
    -------
    Runs

    Raises
    ------
    ValueError
        If `start_cov` is no covariance or a model refuses what it is given.

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.sensors import RangeBearing
    >>> rng = np.random.default_rng(1)
    >>> u = np.tile([1.0, 0.2], (50, 1))
    >>> sensor = RangeBearing(0.1, 0.02)
    >>> there = rng.uniform(-5, 5, (8, 2))
    >>> drives = simulate(Unicycle(), sensor, there, u, 0.1, np.diag([0.04, 0.01]), 20, rng)
    >>> 2.0 < run(drives).mean_nees < 4.0
    True
    """
    beliefs = _Beliefs(drives, drives.sensor if sensor is None else sensor, start_cov)
    motion = drives.motion if motion is None else motion
    poses, covs = [beliefs.pose.copy()], [beliefs.P[:, :3, :3].copy()]
    for u, z, seen in zip(drives.u, drives.z, drives.seen, strict=True):
        beliefs.predict(motion, u, drives, seen.sum(1) if repeat_prediction else None, forget_ties)
        beliefs.correct(z, seen & beliefs.known)
        beliefs.add(z, seen & ~beliefs.known)
        poses.append(beliefs.pose.copy())
        covs.append(beliefs.P[:, :3, :3].copy())
    maps = np.where(beliefs.known[..., None], beliefs.landmarks, np.nan)
    i = 3 + np.arange(2 * maps.shape[1]).reshape(-1, 2)
    map_covs = beliefs.P[:, i[:, :, None], i[:, None, :]]
    return Runs(drives, np.array(poses), np.array(covs), maps, map_covs)


def dead_reckoning(drives: Drives) -> Array:
    """Return the pose that the controls alone give, shape (T + 1, 3), the same for all runs."""
    return _path(drives.motion, drives.poses[0, 0], drives.u, drives.dt)


def _path(motion: Any, start: Array, u: Array, dt: float) -> Array:
    """Poses (T + 1, 3) that controls (T, l) lead to without noise."""
    poses = [start]
    for control in u:
        poses.append(motion.step(poses[-1], control, dt))
    return np.array(poses)


class _Beliefs:
    """M EKF-SLAM states side by side, landmarks in fixed places, known or not yet."""

    def __init__(self, drives: Drives, sensor: Any, start_cov: ArrayLike | None) -> None:
        runs, n = drives.seen.shape[1:]
        self.sensor, self.runs = sensor, np.arange(runs)
        self.pose, self.landmarks = drives.poses[0].copy(), np.zeros((runs, n, 2))
        self.P, self.known = np.zeros((runs, 3 + 2 * n, 3 + 2 * n)), np.zeros((runs, n), bool)
        if start_cov is not None:
            self.P[:, :3, :3] = as_covariance("start_cov", start_cov, 3)

    def predict(
        self,
        motion: Any,
        u: Array,
        drives: Drives,
        repeats: NDArray[np.intp] | None,
        forget_ties: bool,
    ) -> None:
        """P1 (8), (11), (14); `repeats` (M,) times over if given, at least once."""
        F_x, F_u = motion.jacobians(self.pose, u, drives.dt)
        Q = F_u @ drives.control_cov @ _t(F_u)
        for k in range(1 if repeats is None else max(1, int(repeats.max()))):
            again = self.runs if repeats is None or k == 0 else np.flatnonzero(repeats > k)
            P, F = self.P[again], F_x[again]
            part = slice(3) if forget_ties else slice(None)
            P[:, :3, part] = F @ P[:, :3, part]
            P[:, part, :3] = P[:, part, :3] @ _t(F)
            P[:, :3, :3] += Q[again]
            self.P[again] = P
        self.pose = motion.step(self.pose, u, drives.dt)

    def correct(self, z: Array, seen: NDArray[np.bool_]) -> None:
        """P1 (18)-(36); runs that see fewer landmarks than others get rows of zeros."""
        m = int(seen.sum(1).max())
        if m == 0:
            return
        rows = np.argsort(~seen, axis=1, kind="stable")[:, :m]
        run = self.runs[:, None]
        counts = seen[run, rows]
        # A landmark not seen stands somewhere harmless, and then weighs nothing.
        nowhere = self.pose[:, None, :2] + [10.0, 10.0]
        landmarks = np.where(counts[..., None], self.landmarks[run, rows], nowhere)
        pose = self.pose[:, None, :]
        v = self.sensor.residual(z[run, rows], self.sensor.observe(pose, landmarks))
        H_pose, H_landmark = self.sensor.jacobians(pose, landmarks)
        v, H_pose, H_landmark = (
            np.where(counts.reshape(counts.shape + (1,) * (a.ndim - 2)), a, 0.0)
            for a in (v, H_pose, H_landmark)
        )
        i = (3 + 2 * rows[:, :, None] + np.arange(2)).reshape(len(rows), 2 * m)
        i = np.concatenate([np.tile(np.arange(3), (len(rows), 1)), i], 1)
        HP = times_H(H_pose, H_landmark, self.P[run, i])
        S = times_H(H_pose, H_landmark, _t(np.take_along_axis(HP, i[:, None, :], 2)))
        S.reshape(-1, m, 2, m, 2)[:, np.arange(m), :, np.arange(m)] += self.sensor.cov
        root = np.linalg.cholesky(S)
        white = np.linalg.solve(root, np.concatenate([v.reshape(-1, 2 * m, 1), HP], 2))
        y, B = white[..., :1], white[..., 1:]
        change = (_t(B) @ y)[..., 0]
        self.pose = self.pose + change[:, :3]
        self.pose[:, 2] = wrap_angle(self.pose[:, 2])
        self.landmarks += change[:, 3:].reshape(self.landmarks.shape)
        self.P -= _t(B) @ B

    def add(self, z: Array, fresh: NDArray[np.bool_]) -> None:
        """P1 (37)-(43), one landmark at a time in all the runs that see it first."""
        for k in np.flatnonzero(fresh.any(0)):
            runs = np.flatnonzero(fresh[:, k])
            self.landmarks[runs, k] = self.sensor.locate(self.pose[runs], z[runs, k])
            G_pose, G_z = self.sensor.locate_jacobians(self.pose[runs], z[runs, k])
            i = slice(3 + 2 * k, 5 + 2 * k)
            cross = G_pose @ self.P[runs, :3, :]
            self.P[runs, i, :], self.P[runs, :, i] = cross, _t(cross)
            own = cross[..., :3] @ _t(G_pose) + G_z @ self.sensor.cov @ _t(G_z)
            self.P[runs, i, i] = own
            self.known[runs, k] = True


def _t(matrix: Array) -> Array:
    return np.swapaxes(matrix, -1, -2)
