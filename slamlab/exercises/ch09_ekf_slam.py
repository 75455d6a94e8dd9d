"""Checks of chapter 09: the Jacobian with the lever arm, a new landmark's covariance, a wall.

P1 (26)-(29), (43) and the line model that P1's experiment needs.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, an_angle, drawn, in_the_room
from slamlab.exercises._report import Array, Check, Ints
from slamlab.geometry import wrap_angle

__all__ = ["check_add_landmark", "check_jacobian", "check_slam", "check_update", "check_wall"]


# Exercise 1: the derivative of range and bearing by the pose.


def _jacobian(pose: Array, landmark: Array, L: float) -> Array:
    """Differentiate range and bearing by the pose, (2, 3); the sensor stands L ahead."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    px, py = pose[:2] - landmark
    dx, dy = px + L * c, py + L * s
    squared = dx**2 + dy**2
    rho = np.sqrt(squared)
    A, B, C, D = dx / rho, dy / rho, -dy / squared, dx / squared
    E, F = L * (B * c - A * s), L * (D * c - C * s) - 1
    return np.array([[A, B, E], [C, D, F]])


def _scene(rng: np.random.Generator) -> Any:
    return a_pose(rng), np.round(rng.uniform(-6, 6, 2), 2), float(np.round(rng.uniform(0, 1), 2))


check_jacobian = Check(
    _jacobian,
    "H",
    {
        "no lever: the range does not care about the heading": ([0, 0, 0.5], [3, 1], 0.0),
        "a lever, a landmark ahead": ([0.2, -0.4, 0.3], [4, 1], 0.3),
        "a landmark to the left": ([1, 2, -0.7], [2, 5], 0.3),
        "a landmark behind": ([1, 2, 2.5], [4, -1], 0.5),
        "a long lever": ([-1, 0.5, 1.2], [1.5, 3], 1.5),
        "a sensor behind the centre": ([-1, 0.5, 1.2], [1.5, 3], -0.4),
        "anywhere": _scene,
    },
    {
        "the sensor was put at the centre: it stands L ahead": (
            "px + L * c, py + L * s => px, py"
        ),
        "C and D use the centre: the bearing is measured from the sensor, (26) and (27)": (
            "-dy / squared, dx / squared => -py / squared, px / squared"
        ),
        "C and D use the centre, in the distance too: the bearing is measured from the sensor": (
            "-dy / squared, dx / squared => -py / (px**2 + py**2), px / (px**2 + py**2)"
        ),
        "E lacks its factor L, (28): without a lever, turning on the spot changes no range": (
            "L * (B * c - A * s) => B * c - A * s"
        ),
        "the range row lacks its third entry: the lever swings the sensor": (
            "L * (B * c - A * s) => 0.0"
        ),
        "E has the wrong sign: a turn to the left swings the sensor by (-L sin, L cos)": (
            "L * (B * c - A * s) => L * (A * s - B * c)"
        ),
        "F has the derivative of the cosine as plus the sine, as (29) is printed": (
            "L * (D * c - C * s) - 1"
            " => L * (px * c - py * s + L * np.cos(2 * pose[2])) / squared - 1"
        ),
        "F lacks its -1: a turn of the robot is taken off every bearing": (
            "(D * c - C * s) - 1 => (D * c - C * s)"
        ),
        "F is -1 only without a lever: the lever swings the sensor": (
            "L * (D * c - C * s) - 1 => -1.0"
        ),
        "C and D are divided by the distance: its square is due": (
            "-dy / squared, dx / squared => -dy / rho, dx / rho"
        ),
        "A and B are divided by the squared distance: the distance is due": (
            "dx / rho, dy / rho => dx / squared, dy / squared"
        ),
        "the signs of C and D are exchanged": (
            "-dy / squared, dx / squared => dy / squared, -dx / squared"
        ),
        "all signs are reversed: this is the derivative by the landmark, or d is turned": (
            "[[A, B, E], [C, D, F]] => [[-A, -B, -E], [-C, -D, -F]]"
        ),
        "this is the transpose: rows are range and bearing, columns x, y and heading": (
            "[[A, B, E], [C, D, F]] => [[A, C], [B, D], [E, F]]"
        ),
        "the rows are exchanged: range first": (
            "[[A, B, E], [C, D, F]] => [[C, D, F], [A, B, E]]"
        ),
    },
    tolerance=1e-4,
)


# Exercise 2: the covariance after a landmark was added.


def _add_landmark(P: Array, G_pose: Array, G_z: Array, R: Array) -> Array:
    """Covariance (n + 2, n + 2) after a landmark was added to one of (n, n), P1 (43)."""
    cross = G_pose @ P[:3, :]
    own = G_pose @ P[:3, :3] @ G_pose.T + G_z @ R @ G_z.T
    return np.block([[P, cross.T], [cross, own]])


@drawn
def _map(rng: np.random.Generator, landmarks: int, doubt: float = 1.0) -> Any:
    P = doubt * a_covariance(rng, 3 + 2 * landmarks)
    G_pose, G_z = np.round(rng.normal(size=(2, 3)), 2), np.round(rng.normal(size=(2, 2)), 2)
    return P, G_pose, G_z, a_covariance(rng, 2, 0.2)


check_add_landmark = Check(
    _add_landmark,
    "P",
    {
        "the first landmark, from a pose in doubt": _map(0),
        "from a pose without doubt": _map(0, 0.0),
        "the second landmark": _map(1),
        "the fifth landmark": _map(4),
    },
    {
        "the new landmark is tied to nothing: the blocks beside it are G_pose P[:3, :]": (
            "cross = G_pose @ P[:3, :] => cross = np.zeros((2, len(P)))"
        ),
        "it is tied to the pose but not to the old landmarks: use all columns of P[:3, :]": (
            "G_pose @ P[:3, :]\n => G_pose @ P[:3, :] * (np.arange(len(P)) < 3)\n"
        ),
        "the sensor's noise is missing: add G_z R G_z^T": " + G_z @ R @ G_z.T => ",
        "the robot's doubt is missing: add G_pose P_p G_pose^T": (
            "G_pose @ P[:3, :3] @ G_pose.T +  => "
        ),
        "R is in metres and radians, the map in metres: it goes through G_z": (
            "G_z @ R @ G_z.T => R"
        ),
        "the noise went through G_z from the wrong side: G_z R G_z^T": (
            "G_z @ R @ G_z.T => G_z.T @ R @ G_z"
        ),
        "the second G_z is not transposed: G_z R G_z^T": "R @ G_z.T => R @ G_z",
        "G_z stands on one side only: G_z R G_z^T": "R @ G_z.T => R",
        "the noise was subtracted: a new landmark is never surer than its sensor": (
            "+ G_z @ R => - G_z @ R"
        ),
        "the blocks beside the new landmark have the wrong sign": (
            "[[P, cross.T], [cross, own]] => [[P, -cross.T], [-cross, own]]"
        ),
        "the covariance has not grown: two rows and two columns come in": (
            "np.block([[P, cross.T], [cross, own]]) => P.copy()"
        ),
        "the new landmark stands first: it comes last": (
            "[[P, cross.T], [cross, own]] => [[own, cross], [cross.T, P]]"
        ),
        "only the block of the new landmark came: the whole covariance is due": (
            "np.block([[P, cross.T], [cross, own]]) => own"
        ),
    },
    tolerance=1e-8,
)


# Exercise 3: a wall.


def _observe_wall(pose: Array, wall: Array, L: float) -> Array:
    """Distance and direction (2,) of the wall (r, alpha) as the sensor sees it, r >= 0."""
    r, alpha = wall
    xs, ys = pose[0] + L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2])
    distance = r - (xs * np.cos(alpha) + ys * np.sin(alpha))
    turn = np.pi if distance < 0 else 0.0
    return np.array([abs(distance), wrap_angle(alpha - pose[2] + turn)])


def _walled(rng: np.random.Generator) -> Any:
    wall = [float(np.round(rng.uniform(0.5, 5), 2)), an_angle(rng)]
    return np.round(a_pose(rng), 2), wall, float(np.round(rng.uniform(0, 1), 2))


check_wall = Check(
    _observe_wall,
    "distance and direction",
    {
        "a wall ahead": ([0.5, 0, 0], [3, 0], 0.3),
        "a wall at an angle, the robot turned": ([1, 2, 0.4], [4, 1.1], 0.3),
        "the robot beyond the wall's line: another name": ([4, 1, 0.5], [2, 0.2], 0.3),
        "the centre before the line, the sensor beyond it": ([1.9, 0, 0.1], [2, 0.0], 0.3),
        "a direction that crosses half a turn": ([1, -1, -2.5], [3, 2.5], 0.4),
        "any wall": _walled,
    },
    {
        "measured from the centre: the sensor stands L ahead": (
            "pose[0] + L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2]) => pose[0], pose[1]"
        ),
        "the direction is that in the world: take the heading off": (
            "alpha - pose[2] + turn => alpha + turn"
        ),
        "the heading is added: it must be taken off": (
            "alpha - pose[2] + turn => alpha + pose[2] + turn"
        ),
        "the sensor's place was added: r - (x_s cos(alpha) + y_s sin(alpha))": (
            "r - (xs => r + (xs"
        ),
        "a distance is negative: the same line is (-r, alpha + pi)": (
            "np.pi if distance < 0 else 0.0 => 0.0",
            "abs(distance) => distance",
        ),
        "the distance was made positive, its direction was not turned by pi": (
            "np.pi if distance < 0 else 0.0 => 0.0"
        ),
        "the direction is not wrapped to (-pi, pi]": (
            "wrap_angle(alpha - pose[2] + turn) => alpha - pose[2] + turn"
        ),
        "the lever was turned by the wall's direction: the heading turns it": (
            "L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2])"
            " => L * np.cos(alpha), pose[1] + L * np.sin(alpha)"
        ),
        "the lever points along x always: the heading turns it": (
            "pose[0] + L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2]) => pose[0] + L, pose[1]"
        ),
        "sine and cosine of alpha are exchanged": (
            "xs * np.cos(alpha) + ys * np.sin(alpha) => xs * np.sin(alpha) + ys * np.cos(alpha)"
        ),
        "this is the wall as the map names it, seen from the centre: no heading, no lever": (
            lambda p, wall, L: [wall[0] - p[:2] @ [np.cos(wall[1]), np.sin(wall[1])], wall[1]]
        ),
    },
)


# Exercise 4: a bug in an update.


def _update(mean: Array, P: Array, z: Array, i: int, R: Array) -> tuple[Array, Array]:
    """State (n,) and covariance (n, n) after range and bearing z (2,) of landmark number i."""
    k = 3 + 2 * i
    dx, dy = mean[k : k + 2] - mean[:2]
    squared = dx**2 + dy**2
    rho = np.sqrt(squared)
    H = np.zeros((2, len(mean)))
    H[:, :3] = [[-dx / rho, -dy / rho, 0.0], [dy / squared, -dx / squared, -1.0]]
    H[:, k : k + 2] = [[dx / rho, dy / rho], [-dy / squared, dx / squared]]
    v = z - np.array([rho, np.arctan2(dy, dx) - mean[2]])
    v[1] = wrap_angle(v[1])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    new = mean + K @ v
    new[2] = wrap_angle(new[2])
    return new, (np.eye(len(mean)) - K @ H) @ P


@drawn
def _in_a_map(rng: np.random.Generator, landmarks: int, i: int, behind: bool = False) -> Any:
    mean = np.append(a_pose(rng), np.round(rng.uniform(5, 9, 2 * landmarks), 2))
    if behind:
        mean[:3], mean[3 + 2 * i : 5 + 2 * i] = [0, 0, 3.0], [-5.0, -0.4]
    d = mean[3 + 2 * i : 5 + 2 * i] - mean[:2]
    z = [np.hypot(*d), wrap_angle(np.arctan2(d[1], d[0]) - mean[2])] + rng.normal(0, 0.1, 2)
    if behind:
        z[1] = wrap_angle(np.arctan2(d[1], d[0]) - mean[2]) - 0.2
    return mean, a_covariance(rng, len(mean), 0.05), z, i, a_covariance(rng, 2, 0.02)


check_update = Check(
    _update,
    "mean, P",
    {
        "a map of one landmark": _in_a_map(1, 0),
        "the first of three landmarks": _in_a_map(3, 0),
        "the second of three": _in_a_map(3, 1),
        "the last of four": _in_a_map(4, 3),
        "a heading that is corrected past half a turn": (
            [0.0, 0.0, 3.1, -4.0, 0.3],
            np.diag([0.01, 0.01, 0.3, 0.01, 0.01]),
            [4.0, -0.4],
            0,
            0.01 * np.eye(2),
        ),
        "a bearing across the back": _in_a_map(2, 1, behind=True),
    },
    {
        "landmark i begins at 3 + 2 i: each takes two rows": "3 + 2 * i => 3 + i",
        "the pose takes three rows: landmark i begins at 3 + 2 i": "3 + 2 * i => 2 + 2 * i",
        "always the first landmark: which one was seen is told by i": "3 + 2 * i => 3",
        "the landmark's columns of H are empty: it is in doubt as well": (
            "[[dx / rho, dy / rho], [-dy / squared, dx / squared]] => 0.0"
        ),
        "the pose's columns of H are empty: the robot is in doubt as well": (
            "[[-dx / rho, -dy / rho, 0.0], [dy / squared, -dx / squared, -1.0]] => 0.0"
        ),
        "the bearing does not know the heading: its entry is -1": (
            "-dx / squared, -1.0] => -dx / squared, 0.0]"
        ),
        "the heading is taken off a bearing, its derivative is -1": (
            "-dx / squared, -1.0] => -dx / squared, 1.0]"
        ),
        "the bearing lacks the heading: it is measured from the front of the robot": (
            "np.arctan2(dy, dx) - mean[2] => np.arctan2(dy, dx)"
        ),
        "the innovation is not wrapped": "wrap_angle(v[1]) => v[1]",
        "the heading is not wrapped after the correction": ("wrap_angle(new[2]) => new[2]"),
        "R is missing in S": "H @ P @ H.T + R => H @ P @ H.T",
        "only the pose was corrected: the map learns too": (
            "new = mean + K @ v => new = mean + np.append((K @ v)[:3], np.zeros(len(mean) - 3))"
        ),
        "the covariance did not shrink: (I - K H) P is due": (
            "(np.eye(len(mean)) - K @ H) @ P => P.copy()"
        ),
        "the innovation has the wrong sign: measured minus predicted": (
            "mean + K @ v => mean - K @ v"
        ),
        "the pose's columns have the signs of the landmark's": (
            "[[-dx / rho, -dy / rho, 0.0], [dy / squared, -dx / squared, -1.0]]"
            " => [[dx / rho, dy / rho, 0.0], [-dy / squared, dx / squared, -1.0]]"
        ),
    },
    tolerance=1e-6,
)


# Exercise 5: EKF-SLAM, assembled.


def _slam(u: Array, dt: float, V: Array, z: Array, ids: Ints, R: Array) -> tuple[Array, Array]:
    """State and covariance after a drive; landmarks in the order in which they were first seen."""
    known: list[int] = []
    mean, P = np.zeros(3), np.zeros((3, 3))
    for (v, omega), seen, name in zip(u, z, ids, strict=True):
        c, s = np.cos(mean[2]), np.sin(mean[2])
        F = np.array([[1.0, 0.0, -v * dt * s], [0.0, 1.0, v * dt * c], [0.0, 0.0, 1.0]])
        G = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])
        mean[:2] += v * dt * np.array([c, s])
        mean[2] = wrap_angle(mean[2] + omega * dt)
        P[:3, :] = F @ P[:3, :]
        P[:, :3] = P[:, :3] @ F.T
        P[:3, :3] += G @ V @ G.T
        if name in known:
            mean, P = _update(mean, P, seen, known.index(name), R)
        elif name >= 0:
            c, s = np.cos(mean[2] + seen[1]), np.sin(mean[2] + seen[1])
            G_pose = np.array([[1.0, 0.0, -seen[0] * s], [0.0, 1.0, seen[0] * c]])
            G_z = np.array([[c, -seen[0] * s], [s, seen[0] * c]])
            mean = np.append(mean, mean[:2] + seen[0] * np.array([c, s]))
            P = _add_landmark(P, G_pose, G_z, R)
            known.append(name)
    return mean, P


check_slam = Check(
    _slam,
    "mean, P",
    {
        "a drive on which nothing is seen": in_the_room(4, 1, 1.0),
        "one landmark, first seen after a step": in_the_room(1, 1),
        "one landmark, seen again and again": in_the_room(8, 1),
        "five landmarks": in_the_room(20, 5),
        "a drive with steps that see nothing": in_the_room(20, 4, 0.4),
        "a heading past half a turn": (
            [[0.5, 2.5]] * 3,
            0.5,
            0.01 * np.eye(2),
            [[np.nan, np.nan]] * 3,
            [-1, -1, -1],
            0.01 * np.eye(2),
        ),
    },
    {
        "the cross-covariances did not move: P_xm becomes F P_xm": (
            "P[:3, :] = F @ P[:3, :] => P[:3, :3] = F @ P[:3, :3]",
            "P[:, :3] = P[:, :3] @ F.T => P[:3, :3] = P[:3, :3] @ F.T",
        ),
        "the noise of the motion is missing: add G V G^T to the block of the pose": (
            "P[:3, :3] += G @ V @ G.T => P[:3, :3] += 0.0"
        ),
        "nothing was predicted: the robot moves before it looks": (
            "mean[:2] += v * dt * np.array([c, s]) => mean[:2] += 0.0"
        ),
        "a new landmark has no cross-covariances: place it with your add_landmark": (
            "P = _add_landmark(P, G_pose, G_z, R)"
            " => own = _add_landmark(P, G_pose, G_z, R)[-2:, -2:]\n            "
            "P = np.block([[P, np.zeros((len(P), 2))], [np.zeros((2, len(P))), own]])"
        ),
        "a landmark that comes in was used for an update at once: it is counted twice": (
            "known.append(name)"
            " => known.append(name)\n            "
            "mean, P = _update(mean, P, seen, known.index(name), R)"
        ),
        "landmarks known already are not used: update with them": (
            "mean, P = _update(mean, P, seen, known.index(name), R) => pass"
        ),
        "dt is missing in G: a velocity acts for dt": (
            "G = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])"
            " => G = np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])"
        ),
        "F is the identity here: a doubt of the heading becomes one of the place": (
            "[[1.0, 0.0, -v * dt * s], [0.0, 1.0, v * dt * c], [0.0, 0.0, 1.0]]"
            " => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]"
        ),
        "the sensor's noise is missing in a new landmark": (
            "G_pose, G_z, R) => G_pose, G_z, 0 * R)"
        ),
        "a new landmark is placed as if the robot looked along x: add the heading": (
            "np.cos(mean[2] + seen[1]), np.sin(mean[2] + seen[1])"
            " => np.cos(seen[1]), np.sin(seen[1])"
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
