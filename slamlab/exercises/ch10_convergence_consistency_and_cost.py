"""Checks of chapter 10: a difference, P2 (9), the accounts of a region, a filter made consistent.

P2's springs between landmarks, its time update (9) with the cross block, the recursions of the
compressed EKF, and first-estimates Jacobians (Huang, Mourikis and Roumeliotis, 2008).
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, drawn, in_the_room
from slamlab.exercises._report import Array, Check, Ints
from slamlab.geometry import wrap_angle

__all__ = [
    "check_accounts",
    "check_difference_cov",
    "check_predict_cov",
    "check_slam",
    "check_update",
]


# Exercise 1: the spring between two landmarks.


def _difference_cov(P: Array) -> Array:
    """Covariance (2, 2) of m1 - m2 from that of (pose, m1, m2), (7, 7)."""
    one, two, cross = P[3:5, 3:5], P[5:7, 5:7], P[3:5, 5:7]
    return one + two - cross - cross.T


def _interleaved(P: Array) -> Array:
    one, two, cross = P[3::2, 3::2], P[4::2, 4::2], P[3::2, 4::2]
    return one + two - cross - cross.T


_RIGID = np.zeros((7, 7))
_RIGID[3:, 3:] = np.tile(0.04 * np.eye(2), (2, 2))

check_difference_cov = Check(
    _difference_cov,
    "cov",
    {
        "two landmarks without any cross-covariance": (
            np.diag([0.1, 0.2, 0.3, 0.04, 0.05, 0.06, 0.07]),
        ),
        "a rigid pair, known only together": (_RIGID,),
        "a general map": lambda rng: (a_covariance(rng, 7),),
    },
    {
        "the cross-covariances are missing: they are the spring": " - cross - cross.T => ",
        "this is the covariance of m1 + m2: the cross blocks come off": (
            "- cross - cross.T => + cross + cross.T"
        ),
        "one cross block is not enough: both come off, one of them transposed": " - cross.T => ",
        "the second cross block is the transpose of the first: P_21 = P_12^T": (
            "- cross - cross.T => - 2 * cross"
        ),
        "variances of a difference add, they do not subtract": "one + two => one - two",
        "the state starts with three numbers of the pose: m1 stands at 3 and 4": (
            "P[3:5, 3:5], P[5:7, 5:7], P[3:5, 5:7] => P[2:4, 2:4], P[4:6, 4:6], P[2:4, 4:6]"
        ),
        "x and y of a landmark stand side by side: (x, y, theta, x1, y1, x2, y2)": _interleaved,
        "this is the covariance of pose and first landmark": lambda P: P[:2, :2] + P[3:5, 3:5],
        "only the first landmark's covariance came": lambda P: P[3:5, 3:5].copy(),
    },
)


# Exercise 2: the time update of the whole covariance.


def _predict_cov(P: Array, F: Array, Q: Array) -> Array:
    """Covariance (N, N) after a prediction of the pose by F (3, 3) with noise Q (3, 3)."""
    predicted = P.copy()
    strip = F @ P[:3, 3:]
    predicted[:3, 3:] = strip
    predicted[3:, :3] = strip.T
    predicted[:3, :3] = F @ P[:3, :3] @ F.T + Q
    return predicted


@drawn
def _drive(rng: np.random.Generator, landmarks: int, noise: float = 1.0) -> Any:
    F = np.eye(3) + np.round(rng.normal(0, 0.5, (3, 3)), 2)
    return a_covariance(rng, 3 + 2 * landmarks), F, noise * a_covariance(rng, 3, 0.3)


check_predict_cov = Check(
    _predict_cov,
    "P",
    {
        "a pose without landmarks": _drive(0),
        "one landmark": _drive(1),
        "three landmarks, no motion noise": _drive(3, 0.0),
        "four landmarks": _drive(4),
        "a robot that stands still gets its noise all the same": lambda rng: (
            a_covariance(rng, 7),
            np.eye(3),
            a_covariance(rng, 3),
        ),
    },
    {
        "P_xm stayed as it was: it turns with the robot, F P_xm": "F @ P[:3, 3:] => P[:3, 3:]",
        "P_xm turned in the rows only: a covariance is symmetric, P_mx = P_xm^T": (
            "predicted[3:, :3] = strip.T => pass"
        ),
        "P_mx turned in the columns only: a covariance is symmetric, P_mx = P_xm^T": (
            "predicted[:3, 3:] = strip => pass"
        ),
        "P_xm turned twice: one F from the side of the pose is due": (
            "F @ P[:3, 3:] => F @ F @ P[:3, 3:]"
        ),
        "P_xm turned by the transposed F": "F @ P[:3, 3:] => F.T @ P[:3, 3:]",
        "the motion noise Q is missing": " + Q => ",
        "the motion noise went through F too: it is added after the motion": (
            "F @ P[:3, :3] @ F.T + Q => F @ (P[:3, :3] + Q) @ F.T"
        ),
        "Q was added to the landmarks as well: they do not move": (
            lambda P, F, Q: _predict_cov(P, F, Q) + _noisy_map(P, Q)
        ),
        "this is F^T P F: F P F^T is due": (
            "F @ P[:3, 3:] => F.T @ P[:3, 3:]",
            "F @ P[:3, :3] @ F.T => F.T @ P[:3, :3] @ F",
        ),
        "the pose block is F^T P F: F P F^T is due": (
            "F @ P[:3, :3] @ F.T => F.T @ P[:3, :3] @ F"
        ),
        "the pose block needs F from both sides: F P_xx F^T": (
            "F @ P[:3, :3] @ F.T => F @ P[:3, :3]"
        ),
        "the second F of the pose block is not transposed: F P_xx F^T": "@ F.T => @ F",
        "P_xm became zero: pose and map stay correlated": "strip = F => strip = 0 * F",
        "only the block of the pose came: the whole covariance is due": (
            "return predicted => return predicted[:3, :3]"
        ),
    },
)


def _noisy_map(P: Array, Q: Array) -> Array:
    noise = np.zeros_like(P)
    noise[3:, 3:] = Q[0, 0] * np.eye(len(P) - 3)
    return noise


# Exercise 3: what the rest of the map is owed.


def _accounts(
    Phi: Array, Psi: Array, theta: Array, H: Array, S: Array, v: Array, K: Array
) -> tuple[Array, Array, Array]:
    """Phi, Psi (a, a) and theta (a,) after an update within the region."""
    G = H @ Phi
    W = np.linalg.inv(S)
    return Phi - K @ G, Psi + G.T @ W @ G, theta + G.T @ W @ v


@drawn
def _region(rng: np.random.Generator, fresh: bool) -> Any:
    a, m = int(rng.integers(2, 8)), int(rng.integers(1, 4))
    P, H = a_covariance(rng, a), rng.standard_normal((m, a))
    S = H @ P @ H.T + 0.5 * np.eye(m)
    start = np.eye(a), np.zeros((a, a)), np.zeros(a)
    if not fresh:
        start = rng.standard_normal((a, a)), a_covariance(rng, a), rng.standard_normal(a)
    return (*start, H, S, rng.standard_normal(m), P @ H.T @ np.linalg.inv(S))


check_accounts = Check(
    _accounts,
    "Phi, Psi, theta",
    {
        "the first update after entering": _region(fresh=True),
        "an update later on": _region(fresh=False),
    },
    {
        "Phi was changed before Psi and theta used it: they need the Phi from before": (
            "G = H @ Phi => G = H @ (Phi - K @ H @ Phi)",
            "K @ G => K @ H @ Phi",
        ),
        "Phi is missing: H speaks of the region now, the accounts of the region as entered": (
            "G = H @ Phi => G = H",
            "K @ G => K @ H @ Phi",
        ),
        "Phi is multiplied from the left: (I - K H) Phi": "Phi - K @ G => Phi - Phi @ K @ H",
        "Phi lost its past: (I - K H) multiplies the old Phi": (
            "Phi - K @ G => np.eye(len(Phi)) - K @ H"
        ),
        "Phi has the wrong sign: (I - K H) Phi": "Phi - K @ G => Phi + K @ G",
        "S must be inverted": "np.linalg.inv(S) => S",
        "S is missing: its inverse weighs the measurement": "np.linalg.inv(S) => np.eye(len(S))",
        "Psi is a sum over all updates: the old Psi is missing": "Psi + G => G",
        "Psi has the wrong sign: information adds up": "Psi + G => Psi - G",
        "theta is a sum over all updates: the old theta is missing": "theta + G => G",
        "theta has the wrong sign: v is measured minus predicted and adds": (
            "theta + G => theta - G"
        ),
        "theta took the state's correction K v: it gathers Phi^T H^T S^-1 v": (
            "theta + G.T @ W @ v => theta + K @ v"
        ),
        "Psi and theta are exchanged": (
            lambda *given: (_accounts(*given)[0], *_accounts(*given)[:0:-1])
        ),
    },
    tolerance=1e-8,
)


# Exercise 4: an update at first estimates, with bugs.


def _update(
    mean: Array, P: Array, first: Array, z: Array, i: int, R: Array
) -> tuple[Array, Array]:
    """State (n,) and covariance (n, n) after range and bearing z of landmark i.

    Jacobians are taken at `first` (n,), the pose as predicted and the landmarks as first placed;
    the innovation at `mean`.
    """
    k = 3 + 2 * i
    dx, dy = first[k : k + 2] - first[:2]
    squared = dx**2 + dy**2
    rho = np.sqrt(squared)
    H = np.zeros((2, len(mean)))
    H[:, :3] = [[-dx / rho, -dy / rho, 0.0], [dy / squared, -dx / squared, -1.0]]
    H[:, k : k + 2] = [[dx / rho, dy / rho], [-dy / squared, dx / squared]]
    east, north = mean[k : k + 2] - mean[:2]
    v = z - np.array([np.hypot(east, north), np.arctan2(north, east) - mean[2]])
    v[1] = wrap_angle(v[1])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    new = mean + K @ v
    new[2] = wrap_angle(new[2])
    return new, (np.eye(len(mean)) - K @ H) @ P


@drawn
def _in_a_map(
    rng: np.random.Generator, landmarks: int, i: int, moved: float = 0.3, behind: bool = False
) -> Any:
    mean = np.append(a_pose(rng), np.round(rng.uniform(5, 9, 2 * landmarks), 2))
    if behind:
        mean[:3], mean[3 + 2 * i : 5 + 2 * i] = [0, 0, 3.0], [-5.0, -0.4]
    d = mean[3 + 2 * i : 5 + 2 * i] - mean[:2]
    z = np.array([np.hypot(*d), wrap_angle(np.arctan2(d[1], d[0]) - mean[2])])
    z += rng.normal(0, 0.1, 2)
    if behind:
        z[1] = wrap_angle(np.arctan2(d[1], d[0]) - mean[2]) - 0.2
    first = mean + np.round(moved * rng.uniform(-1, 1, len(mean)), 2)
    return mean, a_covariance(rng, len(mean), 0.05), first, z, i, a_covariance(rng, 2, 0.02)


check_update = Check(
    _update,
    "mean, P",
    {
        "estimates that have not moved since the first": _in_a_map(2, 1, 0.0),
        "one landmark that has moved": _in_a_map(1, 0),
        "the second of three landmarks": _in_a_map(3, 1),
        "the last of four": _in_a_map(4, 3),
        "a bearing across the back": _in_a_map(2, 1, behind=True),
        "a heading that is corrected past half a turn": (
            [0.0, 0.0, 3.1, -4.0, 0.3],
            np.diag([0.01, 0.01, 0.3, 0.01, 0.01]),
            [0.1, 0.0, 3.0, -4.2, 0.4],
            [4.0, -0.4],
            0,
            0.01 * np.eye(2),
        ),
    },
    {
        "H takes the landmark at its latest estimate: its first one is due, for ever": (
            "first[k : k + 2] - first[:2] => mean[k : k + 2] - first[:2]"
        ),
        "H takes the pose at its latest estimate: the predicted one in `first` is due": (
            "first[k : k + 2] - first[:2] => first[k : k + 2] - mean[:2]"
        ),
        "H is taken at the latest estimates: this is the usual EKF, which learns where north is": (
            "first[k : k + 2] - first[:2] => mean[k : k + 2] - mean[:2]"
        ),
        "the innovation was taken at the first estimates: what is expected now is due": (
            "mean[k : k + 2] - mean[:2] => first[k : k + 2] - first[:2]",
            "np.arctan2(north, east) - mean[2] => np.arctan2(north, east) - first[2]",
        ),
        "the innovation takes the pose from `first`: what is expected now is due": (
            "mean[k : k + 2] - mean[:2] => mean[k : k + 2] - first[:2]",
            "np.arctan2(north, east) - mean[2] => np.arctan2(north, east) - first[2]",
        ),
        "the innovation takes the landmark from `first`: what is expected now is due": (
            "mean[k : k + 2] - mean[:2] => first[k : k + 2] - mean[:2]"
        ),
        "the innovation takes the heading from `first`: what is expected now is due": (
            "np.arctan2(north, east) - mean[2] => np.arctan2(north, east) - first[2]"
        ),
        "the correction was added to the first estimates: they stay, the mean moves": (
            "mean + K @ v => first + K @ v"
        ),
        "landmark i begins at 3 + 2 i: each takes two rows": "3 + 2 * i => 3 + i",
        "the innovation is not wrapped": "wrap_angle(v[1]) => v[1]",
        "the heading is not wrapped after the correction": ("wrap_angle(new[2]) => new[2]"),
        "R is missing in S": "H @ P @ H.T + R => H @ P @ H.T",
        "the covariance did not shrink: (I - K H) P is due": (
            "(np.eye(len(mean)) - K @ H) @ P => P.copy()"
        ),
        "the innovation has the wrong sign: measured minus predicted": (
            "mean + K @ v => mean - K @ v"
        ),
    },
    tolerance=1e-6,
)


# Exercise 5: a filter that does not learn where north is.


def _slam(
    P0: Array, u: Array, dt: float, V: Array, z: Array, ids: Ints, R: Array
) -> tuple[Array, Array]:
    """State and covariance after a drive from a doubted start, by first-estimates Jacobians."""
    known: list[int] = []
    mean, P, first = np.zeros(3), P0.copy(), np.zeros(3)
    for (v, omega), seen, name in zip(u, z, ids, strict=True):
        c, s = np.cos(mean[2]), np.sin(mean[2])
        G = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])
        mean[:2] += v * dt * np.array([c, s])
        mean[2] = wrap_angle(mean[2] + omega * dt)
        F = np.eye(3)
        F[:2, 2] = first[1] - mean[1], mean[0] - first[0]
        P = _predict_cov(P, F, G @ V @ G.T)
        first[:3] = mean[:3]
        if name in known:
            mean, P = _update(mean, P, first, seen, known.index(name), R)
        elif name >= 0:
            c, s = np.cos(mean[2] + seen[1]), np.sin(mean[2] + seen[1])
            G_pose = np.array([[1.0, 0.0, -seen[0] * s], [0.0, 1.0, seen[0] * c]])
            G_z = np.array([[c, -seen[0] * s], [s, seen[0] * c]])
            point = mean[:2] + seen[0] * np.array([c, s])
            mean, first = np.append(mean, point), np.append(first, point)
            cross = G_pose @ P[:3]
            P = np.block([[P, cross.T], [cross, cross[:, :3] @ G_pose.T + G_z @ R @ G_z.T]])
            known.append(name)
    return mean, P


_in_the_room = partial(in_the_room, dt=0.4, doubt=0.02)

check_slam = Check(
    _slam,
    "mean, P",
    {
        "a drive on which nothing is seen": _in_the_room(4, 1, 1.0),
        "one landmark, first seen after a step": _in_the_room(1, 1),
        "a robot that stands still after its first step": _in_the_room(12, 3, still=True),
        "one landmark, seen again and again": _in_the_room(8, 1),
        "five landmarks": _in_the_room(20, 5),
        "a drive with steps that see nothing": _in_the_room(20, 4, 0.4),
        "a heading past half a turn": (
            0.01 * np.eye(3),
            [[0.5, 2.5]] * 3,
            0.5,
            0.01 * np.eye(2),
            [[np.nan, np.nan]] * 3,
            [-1, -1, -1],
            0.01 * np.eye(2),
        ),
    },
    {
        "this is the usual EKF: F and H are taken at the latest estimates": (
            "first[1] - mean[1], mean[0] - first[0] => -v * dt * s, v * dt * c",
            "_update(mean, P, first,  => _update(mean, P, mean, ",
        ),
        "H is taken at the latest estimates: landmarks in `first` stay where they were placed": (
            "_update(mean, P, first,  => _update(mean, P, mean, "
        ),
        "F runs from the corrected pose: it runs from the pose as predicted a step ago": (
            "first[1] - mean[1], mean[0] - first[0] => -v * dt * s, v * dt * c"
        ),
        "the pose in `first` stayed at the start: it is the predicted one, step by step": (
            "first[:3] = mean[:3] => pass"
        ),
        "the start is in doubt: P begins as P0": "P0.copy() => np.zeros((3, 3))",
        "the noise of the motion is missing: add G V G^T to the block of the pose": (
            "G @ V @ G.T) => np.zeros((3, 3)))"
        ),
        "nothing was predicted: the robot moves before it looks": (
            "mean[:2] += v * dt * np.array([c, s]) => mean[:2] += 0.0"
        ),
        "F is the identity here: a doubt of the heading becomes one of the place": (
            "F[:2, 2] = first[1] - mean[1], mean[0] - first[0] => pass"
        ),
        "the turn in F goes the wrong way: (-y, x) of the way is due": (
            "first[1] - mean[1], mean[0] - first[0] => mean[1] - first[1], first[0] - mean[0]"
        ),
        "a new landmark has no cross-covariances: it was placed from the pose": (
            "[[P, cross.T], [cross,  => [[P, 0 * cross.T], [0 * cross, "
        ),
        "landmarks known already are not used: update with them": (
            "mean, P = _update(mean, P, first, seen, known.index(name), R) => pass"
        ),
        "the heading is not wrapped after the motion": (
            "wrap_angle(mean[2] + omega * dt) => mean[2] + omega * dt"
        ),
        "only the pose came: state and covariance of all landmarks are due": (
            "return mean, P => return mean[:3], P[:3, :3]"
        ),
    },
    tolerance=1e-6,
)
