"""Checks of chapter 09: the Jacobian with the lever arm, a new landmark's covariance, a wall.

P1 (26)-(29), (43) and the line model that P1's experiment needs.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, an_angle
from slamlab.exercises._report import Array, Check
from slamlab.geometry import wrap_angle

__all__ = ["check_add_landmark", "check_jacobian", "check_wall"]


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
            "px + L * c, py + L * s",
            "px, py",
        ),
        "C and D use the centre: the bearing is measured from the sensor, (26) and (27)": (
            "-dy / squared, dx / squared",
            "-py / squared, px / squared",
        ),
        "C and D use the centre, in the distance too: the bearing is measured from the sensor": (
            "-dy / squared, dx / squared",
            "-py / (px**2 + py**2), px / (px**2 + py**2)",
        ),
        "E lacks its factor L, (28): without a lever, turning on the spot changes no range": (
            "L * (B * c - A * s)",
            "B * c - A * s",
        ),
        "the range row lacks its third entry: the lever swings the sensor": (
            "L * (B * c - A * s)",
            "0.0",
        ),
        "E has the wrong sign: a turn to the left swings the sensor by (-L sin, L cos)": (
            "L * (B * c - A * s)",
            "L * (A * s - B * c)",
        ),
        "F has the derivative of the cosine as plus the sine, as (29) is printed": (
            "L * (D * c - C * s) - 1",
            "L * (px * c - py * s + L * np.cos(2 * pose[2])) / squared - 1",
        ),
        "F lacks its -1: a turn of the robot is taken off every bearing": (
            "(D * c - C * s) - 1",
            "(D * c - C * s)",
        ),
        "F is -1 only without a lever: the lever swings the sensor": (
            "L * (D * c - C * s) - 1",
            "-1.0",
        ),
        "C and D are divided by the distance: its square is due": (
            "-dy / squared, dx / squared",
            "-dy / rho, dx / rho",
        ),
        "A and B are divided by the squared distance: the distance is due": (
            "dx / rho, dy / rho",
            "dx / squared, dy / squared",
        ),
        "the signs of C and D are exchanged": (
            "-dy / squared, dx / squared",
            "dy / squared, -dx / squared",
        ),
        "all signs are reversed: this is the derivative by the landmark, or d is turned": (
            "[[A, B, E], [C, D, F]]",
            "[[-A, -B, -E], [-C, -D, -F]]",
        ),
        "this is the transpose: rows are range and bearing, columns x, y and heading": (
            "[[A, B, E], [C, D, F]]",
            "[[A, C], [B, D], [E, F]]",
        ),
        "the rows are exchanged: range first": (
            "[[A, B, E], [C, D, F]]",
            "[[C, D, F], [A, B, E]]",
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


def _tied_to_the_pose_only(P: Array, G_pose: Array, G_z: Array, R: Array) -> Array:
    whole = _add_landmark(P, G_pose, G_z, R)
    whole[3:-2, -2:] = whole[-2:, 3:-2] = 0.0
    return whole


def _map(landmarks: int, doubt: float = 1.0) -> Any:
    def draw(rng: np.random.Generator) -> Any:
        P = doubt * a_covariance(rng, 3 + 2 * landmarks)
        G_pose, G_z = np.round(rng.normal(size=(2, 3)), 2), np.round(rng.normal(size=(2, 2)), 2)
        return P, G_pose, G_z, a_covariance(rng, 2, 0.2)

    return draw


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
            "cross = G_pose @ P[:3, :]",
            "cross = np.zeros((2, len(P)))",
        ),
        "it is tied to the pose but not to the old landmarks: use all columns of P[:3, :]": (
            _tied_to_the_pose_only
        ),
        "the sensor's noise is missing: add G_z R G_z^T": (" + G_z @ R @ G_z.T", ""),
        "the robot's doubt is missing: add G_pose P_p G_pose^T": (
            "G_pose @ P[:3, :3] @ G_pose.T + ",
            "",
        ),
        "R is in metres and radians, the map in metres: it goes through G_z": (
            "G_z @ R @ G_z.T",
            "R",
        ),
        "the noise went through G_z from the wrong side: G_z R G_z^T": (
            "G_z @ R @ G_z.T",
            "G_z.T @ R @ G_z",
        ),
        "the second G_z is not transposed: G_z R G_z^T": ("R @ G_z.T", "R @ G_z"),
        "G_z stands on one side only: G_z R G_z^T": ("R @ G_z.T", "R"),
        "the noise was subtracted: a new landmark is never surer than its sensor": (
            "+ G_z @ R",
            "- G_z @ R",
        ),
        "the blocks beside the new landmark have the wrong sign": (
            "[[P, cross.T], [cross, own]]",
            "[[P, -cross.T], [-cross, own]]",
        ),
        "the covariance has not grown: two rows and two columns come in": (
            "np.block([[P, cross.T], [cross, own]])",
            "P.copy()",
        ),
        "the new landmark stands first: it comes last": (
            "[[P, cross.T], [cross, own]]",
            "[[own, cross], [cross.T, P]]",
        ),
        "only the block of the new landmark came: the whole covariance is due": (
            "np.block([[P, cross.T], [cross, own]])",
            "own",
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
            "pose[0] + L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2])",
            "pose[0], pose[1]",
        ),
        "the direction is that in the world: take the heading off": (
            "alpha - pose[2] + turn",
            "alpha + turn",
        ),
        "the heading is added: it must be taken off": (
            "alpha - pose[2] + turn",
            "alpha + pose[2] + turn",
        ),
        "the sensor's place was added: r - (x_s cos(alpha) + y_s sin(alpha))": (
            "r - (xs",
            "r + (xs",
        ),
        "a distance is negative: the same line is (-r, alpha + pi)": (
            "np.pi if distance < 0 else 0.0",
            "0.0",
            "abs(distance)",
            "distance",
        ),
        "the distance was made positive, its direction was not turned by pi": (
            "np.pi if distance < 0 else 0.0",
            "0.0",
        ),
        "the direction is not wrapped to (-pi, pi]": (
            "wrap_angle(alpha - pose[2] + turn)",
            "alpha - pose[2] + turn",
        ),
        "the lever was turned by the wall's direction: the heading turns it": (
            "L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2])",
            "L * np.cos(alpha), pose[1] + L * np.sin(alpha)",
        ),
        "the lever points along x always: the heading turns it": (
            "pose[0] + L * np.cos(pose[2]), pose[1] + L * np.sin(pose[2])",
            "pose[0] + L, pose[1]",
        ),
        "sine and cosine of alpha are exchanged": (
            "xs * np.cos(alpha) + ys * np.sin(alpha)",
            "xs * np.sin(alpha) + ys * np.cos(alpha)",
        ),
        "this is the wall as the map names it, seen from the centre: no heading, no lever": (
            lambda pose, wall, L: [
                wall[0] - pose[:2] @ [np.cos(wall[1]), np.sin(wall[1])],
                wall[1],
            ]
        ),
    },
)
