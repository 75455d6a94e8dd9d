"""Checks of chapter 03: a range-bearing prediction, its innovation, its Jacobian, and a filter.

The measurement is that of P1 (18) for a sensor in the centre of the robot (L = 0), with the
bearing repaired; P5 (11) and (13) are the innovation and the Jacobian of the extended filter.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, an_angle, drawn
from slamlab.exercises._report import Array, Check
from slamlab.geometry import wrap_angle

__all__ = ["check_follow", "check_innovation", "check_jacobian", "check_range_bearing"]


def _scene(rng: np.random.Generator) -> Any:
    return a_pose(rng), np.round(rng.uniform(-6, 6, 2), 2)


# Exercise 1: the predicted measurement.


def _range_bearing(pose: Array, landmark: Array) -> Array:
    """Range (m) and bearing (rad), shape (2,), of a landmark (2,) seen from a pose (3,)."""
    dx, dy = landmark - pose[:2]
    return np.array([np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - pose[2])])


check_range_bearing = Check(
    _range_bearing,
    "measurement",
    {
        "three ahead, four to the left": ([0, 0, 0], [3, 4]),
        "the robot has turned": ([1.0, 2.0, 0.6], [4.0, 3.0]),
        "the landmark is behind": ([1.0, 2.0, 0.4], [-2.0, 1.0]),
        "straight behind: pi, not -pi": ([0.0, 0.0, -np.pi / 2], [0.0, 3.0]),
        "across the back: the bearing stays wrapped": ([0.0, 0.0, 3.0], [-4.0, -1.0]),
        "anywhere": _scene,
    },
    {
        "the bearing is not wrapped: it must lie in (-pi, pi]": (
            "wrap_angle(np.arctan2(dy, dx) - pose[2]) => np.arctan2(dy, dx) - pose[2]"
        ),
        "the bearing was wrapped to [0, 2 pi): it must lie in (-pi, pi]": (
            "wrap_angle(np.arctan2(dy, dx) - pose[2])"
            " => (np.arctan2(dy, dx) - pose[2]) % (2 * np.pi)"
        ),
        "arctan(dy/dx) loses the quadrant: a landmark behind appears in front; use arctan2": (
            "arctan2(dy, dx) => arctan(dy / dx)"
        ),
        "the fraction is upside down, as P1 prints (18): arctan2 takes dy first": (
            "arctan2(dy, dx) => arctan2(dx, dy)"
        ),
        "the heading is missing: a bearing is measured from where the robot faces": (
            " - pose[2] => "
        ),
        "the heading is added: it must be subtracted": " - pose[2] =>  + pose[2]",
        "the direction is reversed: from the robot to the landmark, not back": (
            "landmark - pose[:2] => pose[:2] - landmark"
        ),
        "the range is squared: take the square root": "np.hypot(dx, dy) => dx**2 + dy**2",
        "the range is the sum of the sides: take the root of the sum of their squares": (
            "np.hypot(dx, dy) => abs(dx) + abs(dy)"
        ),
        "the bearing is in degrees: radians are due": (
            "wrap_angle(np.arctan2(dy, dx) - pose[2])"
            " => np.rad2deg(wrap_angle(np.arctan2(dy, dx) - pose[2]))"
        ),
        "the robot's own place was forgotten: measure from where it stands": (
            "landmark - pose[:2] => landmark"
        ),
        "bearing and range are exchanged: the range comes first": (
            lambda pose, landmark: _range_bearing(pose, landmark)[::-1]
        ),
    },
)


# Exercise 2: the innovation.


def _innovation(z: Array, predicted: Array) -> Array:
    """Measured minus predicted range and bearing, shape (2,), the bearing wrapped."""
    return np.array([z[0] - predicted[0], wrap_angle(z[1] - predicted[1])])


def _bearings(rng: np.random.Generator) -> Any:
    return [rng.integers(1, 9), an_angle(rng)], [rng.integers(1, 9), an_angle(rng)]


check_innovation = Check(
    _innovation,
    "innovation",
    {
        "a plain difference": ([5.0, 0.3], [4.8, 0.2]),
        "negative differences stay negative": ([4.0, 0.1], [4.8, 0.25]),
        "across the back, to the left": ([5.0, -3.1], [5.0, 3.1]),
        "across the back, to the right": ([9.0, 3.1], [5.0, -3.0]),
        "half a turn is pi, not -pi": ([2.0, np.pi / 2], [1.0, -np.pi / 2]),
        "a full turn changes nothing": ([5.0, 0.3 + 2 * np.pi], [4.8, 0.2]),
        "any two measurements": _bearings,
    },
    {
        "the bearing is off by 2 pi: wrap the difference": "wrap_angle( => (",
        "the sign is reversed: measured minus predicted is due": (
            lambda z, p: np.array([p[0] - z[0], wrap_angle(p[1] - z[1])])
        ),
        "the range was wrapped too: only the bearing is an angle": (
            lambda z, p: wrap_angle(z - p)
        ),
        "the bearings were wrapped before the subtraction: wrap the difference itself": (
            "wrap_angle(z[1] - predicted[1]) => wrap_angle(z[1]) - wrap_angle(predicted[1])"
        ),
        "the absolute difference loses its sign: the filter must know which way to turn": (
            lambda z, p: np.abs(_innovation(z, p))
        ),
        "wrapped to [0, 2 pi): a small turn to the right must be a small negative number": (
            "wrap_angle(z[1] - predicted[1]) => (z[1] - predicted[1]) % (2 * np.pi)"
        ),
        "wrapped to [-pi, pi): half a turn is pi": (
            "wrap_angle(z[1] - predicted[1])"
            " => (z[1] - predicted[1] + np.pi) % (2 * np.pi) - np.pi"
        ),
        "wrapped by pi: a full turn is 2 pi": (
            "wrap_angle(z[1] - predicted[1])"
            " => (z[1] - predicted[1] + np.pi / 2) % np.pi - np.pi / 2"
        ),
        "the bearing was not subtracted": "z[1] - predicted[1] => z[1]",
    },
)


# Exercise 3: the Jacobian.


def _jacobian(pose: Array, landmark: Array) -> Array:
    """Jacobian (2, 3) of `range_bearing` with respect to the pose."""
    dx, dy = landmark - pose[:2]
    q = dx**2 + dy**2
    r = np.sqrt(q)
    return np.array([[-dx / r, -dy / r, 0.0], [dy / q, -dx / q, -1.0]])


check_jacobian = Check(
    _jacobian,
    "J",
    {
        "straight ahead": ([0, 0, 0], [2, 0]),
        "ahead and to the left": ([1.0, 2.0, 0.6], [4.0, 6.0]),
        "behind, far away": ([1.0, 2.0, -2.0], [-20.0, -13.0]),
        "close by, where the bearing is quick": ([0.0, 0.0, 1.0], [0.2, -0.1]),
        "anywhere": _scene,
    },
    {
        "this is the transpose: rows are range and bearing, columns are x, y, theta": (
            lambda p, m: _jacobian(p, m).T
        ),
        "this is the Jacobian by the landmark's position: the pose moves the other way": (
            lambda p, m: _jacobian(p, m) * [-1, -1, 1]
        ),
        "this is the Jacobian by the landmark, (2, 2): the pose has three numbers": (
            lambda p, m: -_jacobian(p, m)[:, :2]
        ),
        "the last column is zero: turning the robot changes the bearing one to one": (
            "-1.0] => 0.0]"
        ),
        "the sign of the heading column is wrong: turn left and the landmark moves right": (
            "-1.0] => 1.0]"
        ),
        "the bearing row must be divided by the range squared, not by the range": (
            "dy / q, -dx / q => dy / r, -dx / r"
        ),
        "the range row must be divided by the range, not by its square": (
            "-dx / r, -dy / r => -dx / q, -dy / q"
        ),
        "the signs of the bearing row are exchanged, as in P1 (26), (27)": (
            "dy / q, -dx / q => -dy / q, dx / q"
        ),
        "dx and dy are exchanged in the bearing row": "dy / q, -dx / q => -dx / q, dy / q",
        "the signs of the range row are reversed: nearer means a shorter range": (
            "-dx / r, -dy / r => dx / r, dy / r"
        ),
        "the rows are exchanged: range first, then bearing": (lambda p, m: _jacobian(p, m)[::-1]),
    },
    tolerance=1e-4,
)


# Exercise 4: a filter on the unicycle.


def _follow(
    mean: Array, cov: Array, u: Array, dt: float, V: Array, z: Array, landmark: Array, R: Array
) -> tuple[Array, Array]:
    """Poses (T, 3) and covariances (T, 3, 3) of a unicycle that sees one landmark, NaN for not."""
    means, covs = [], []
    for (v, omega), seen in zip(u, z, strict=True):
        c, s = np.cos(mean[2]), np.sin(mean[2])
        F_x = np.array([[1.0, 0.0, -v * dt * s], [0.0, 1.0, v * dt * c], [0.0, 0.0, 1.0]])
        F_u = np.array([[dt * c, 0.0], [dt * s, 0.0], [0.0, dt]])
        mean = mean + np.array([v * dt * c, v * dt * s, omega * dt])
        cov = F_x @ cov @ F_x.T + F_u @ V @ F_u.T
        if np.isfinite(seen).all():
            H = _jacobian(mean, landmark)
            K = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R)
            mean = mean + K @ _innovation(seen, _range_bearing(mean, landmark))
            cov = (np.eye(3) - K @ H) @ cov
        mean = np.append(mean[:2], wrap_angle(mean[2]))
        means.append(mean)
        covs.append(cov)
    return np.array(means).reshape(-1, 3), np.array(covs).reshape(-1, 3, 3)


@drawn
def _unicycle(rng: np.random.Generator, n: int, unseen: float) -> Any:
    mean, landmark = a_pose(rng), np.round(rng.uniform(4, 8, 2), 2)
    u = np.round(rng.uniform([0.2, -1.5], [1.5, 1.5], (n, 2)), 2)
    pose, read = mean, []
    for v, omega in u:
        pose = pose + 0.4 * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), omega])
        read.append(_range_bearing(pose, landmark) + rng.normal(0, [0.1, 0.05]))
    z = np.where(rng.random((n, 1)) < unseen, np.nan, np.round(read, 3))
    V, R = a_covariance(rng, 2, 0.02), a_covariance(rng, 2, 0.01)
    return mean, a_covariance(rng, 3, 0.02), u, 0.4, V, z, landmark, R


check_follow = Check(
    _follow,
    "means, covs",
    {
        "one step without a measurement": _unicycle(1, 1.0),
        "one step and one measurement": _unicycle(1, 0.0),
        "the landmark across the back": (
            [0, 0, 3.0],
            0.05 * np.eye(3),
            [[0.5, 0.6]],
            0.4,
            0.01 * np.eye(2),
            [[4.05, 3.1]],
            [-4.0, -0.7],
            0.01 * np.eye(2),
        ),
        "a drive": _unicycle(12, 0.0),
        "a drive on which the landmark is seen now and then": _unicycle(12, 0.5),
    },
    {
        "the innovation is not wrapped: a landmark across the back throws the filter off": (
            "_innovation(seen, _range_bearing(mean, landmark))"
            " => (seen - _range_bearing(mean, landmark))"
        ),
        "the heading is not wrapped: it must lie in (-pi, pi]": "wrap_angle(mean[2]) => mean[2]",
        "this is F^T P F: F P F^T is due": "F_x @ cov @ F_x.T => F_x.T @ cov @ F_x",
        "the noise of the motion is missing": " + F_u @ V @ F_u.T => ",
        "R is missing in S: the sensor is not perfect": "H @ cov @ H.T + R => H @ cov @ H.T",
        "R must not be added to the gain": (
            "K = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R)"
            " => K = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R) + np.pad(R, ((0, 1), (0, 0)))"
        ),
        "F has the wrong sign in its last column: differentiate cos and sin": (
            "-v * dt * s], [0.0, 1.0, v * dt * c] => v * dt * s], [0.0, 1.0, -v * dt * c]"
        ),
        "F is the identity here: a doubt of the heading becomes one of the place": (
            "F_x @ cov @ F_x.T => cov"
        ),
        "the sign of the innovation is reversed: measured minus predicted": (
            "mean + K @ _innovation => mean - K @ _innovation"
        ),
        "the covariance did not shrink: (I - K H) P is due": "(np.eye(3) - K @ H) @ cov => cov",
        "the measurements were not used": "np.isfinite(seen).all() => False",
        "dt is missing in F_u: a velocity acts for dt": (
            "[[dt * c, 0.0], [dt * s, 0.0], [0.0, dt]] => [[c, 0.0], [s, 0.0], [0.0, 1.0]]"
        ),
        "the last belief came: the one after each step is due": (
            lambda *given: (_follow(*given)[0][-1], _follow(*given)[1][-1])
        ),
    },
    tolerance=1e-5,
)
