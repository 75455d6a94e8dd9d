"""Checks of chapter 00: dead reckoning, the error of one edge, its Jacobian, the relaxed graph.

The error is that of g2o and Grisetti et al. (2010), as `slamlab.slam.PoseGraph` has it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, drawn
from slamlab.exercises._report import Array, Check, Function, Ints
from slamlab.geometry import between, compose, inverse, rotation, wrap_angle

__all__ = [
    "check_dead_reckoning",
    "check_edge_error",
    "check_edge_jacobian",
    "check_relax",
    "check_slam",
]


# Exercise 1: dead reckoning.


def _dead_reckoning(start: Array, odometry: Array) -> Array:
    """Poses (n + 1, 3) from a start (3,) and n relative motions (n, 3) in the body frame."""
    poses = [start.copy()]
    for motion in odometry:
        poses.append(compose(poses[-1], motion))
    return np.array(poses)


def _turned_by(turn: Function, wrap: Function = wrap_angle) -> Function:
    """Chain motions that are turned by `turn(heading, change of heading)`."""

    def run(start: Array, odometry: Array) -> Array:
        poses = [start]
        for motion in odometry:
            place = poses[-1][:2] + turn(poses[-1][2], motion[2]) @ motion[:2]
            poses.append(np.append(place, wrap(poses[-1][2] + motion[2])))
        return np.array(poses)

    return run


def _drive(n: int) -> Any:
    return lambda rng: (a_pose(rng), np.round(rng.uniform(-1.5, 1.5, (n, 3)), 2))


check_dead_reckoning = Check(
    _dead_reckoning,
    "poses",
    {
        "one step straight ahead": ([0, 0, 0], [[1, 0, 0]]),
        "the robot faces left: forward is up": ([1, 2, np.pi / 2], [[1, 0, 0]]),
        "four legs close a square": ([0, 0, 0.2], [[1, 0, np.pi / 2]] * 4),
        "headings stay wrapped": ([0.0, 0.0, 3.0], [[0.2, 0.0, 0.3], [0.2, 0.0, 0.3]]),
        "no motion at all": ([1.0, 2.0, 0.5], np.zeros((0, 3))),
        "turn and drive": _drive(3),
        "a long way": _drive(12),
    },
    {
        "the motion was added in the world frame: turn it by the heading of the robot first": (
            _turned_by(lambda heading, turn: np.eye(2))
        ),
        "the composition is the wrong way round: the old pose comes first, then the motion": (
            "compose(poses[-1], motion) => compose(motion, poses[-1])"
        ),
        "the first row must be the start: n motions make n + 1 poses": (
            "np.array(poses) => np.array(poses[1:])"
        ),
        "the start was ignored: the path begins at the origin": "start.copy() => np.zeros(3)",
        "each motion was added to the start: add it to the last pose": "poses[-1] => poses[0]",
        "the heading after the turn was used: the motion is given in the frame before it": (
            _turned_by(lambda heading, turn: rotation(heading + turn))
        ),
        "the heading half-way was used: the motion is given in the frame before it": (
            _turned_by(lambda heading, turn: rotation(heading + turn / 2))
        ),
        "this is the transposed rotation: it turns from the world into the body": (
            _turned_by(lambda heading, turn: rotation(heading).T)
        ),
        "the heading is not wrapped: it must stay in (-pi, pi]": (
            _turned_by(lambda heading, turn: rotation(heading), lambda angle: angle)
        ),
        "only the last pose came: all of them are due": "np.array(poses) => poses[-1]",
    },
)


# Exercise 2: the error of one edge.


def _edge_error(pose_i: Array, pose_j: Array, z: Array) -> Array:
    """Error (3,) of a measurement z of pose j seen from pose i: z^-1 (+) (i^-1 (+) j)."""
    seen = rotation(pose_i[2]).T @ (pose_j[:2] - pose_i[:2])
    position = rotation(z[2]).T @ (seen - z[:2])
    return np.append(position, wrap_angle(pose_j[2] - pose_i[2] - z[2]))


def _edge(rng: np.random.Generator) -> Any:
    return a_pose(rng), a_pose(rng), a_pose(rng)


def _perfect(rng: np.random.Generator) -> Any:
    i, j = a_pose(rng), a_pose(rng)
    return i, j, between(i, j)


check_edge_error = Check(
    _edge_error,
    "error",
    {
        "a perfect measurement has no error": _perfect,
        "one metre too far, straight ahead": ([0, 0, 0], [2, 0, 0], [1, 0, 0]),
        "a full turn is no error": ([0, 0, 3.0], [1, 0, -3.0], [1, 0, 2 * np.pi - 6.0]),
        "the measurement turns": ([1.0, 2.0, 0.5], [2.5, 2.2, 1.4], [1.1, -0.4, 0.7]),
        "a general pair of poses": _edge,
    },
    {
        "the heading difference is not wrapped: a full turn must not count as an error": (
            "wrap_angle( => ("
        ),
        "R_z^T is missing: the error must be given in the frame that the measurement predicts": (
            "rotation(z[2]).T @  => "
        ),
        "R_i^T is missing: the displacement must be seen from pose i, not from the world": (
            "rotation(pose_i[2]).T @  => "
        ),
        "R_i is transposed the wrong way: R_i^T takes world coordinates into the frame of i": (
            "rotation(pose_i[2]).T => rotation(pose_i[2])"
        ),
        "R_z is transposed the wrong way: R_z^T is due": "rotation(z[2]).T => rotation(z[2])",
        "R_z^T turns the displacement before t_z is taken off: it turns their difference": (
            "rotation(z[2]).T @ (seen - z[:2]) => rotation(z[2]).T @ seen - z[:2]"
        ),
        "R_i^T turns t_j before t_i is taken off: it turns their difference": (
            "rotation(pose_i[2]).T @ (pose_j[:2] - pose_i[:2])"
            " => rotation(pose_i[2]).T @ pose_j[:2] - pose_i[:2]"
        ),
        "t_z is missing: the error is predicted minus measured": "(seen - z[:2]) => seen",
        "the measured turn is missing: the error is predicted minus measured": (
            "- pose_i[2] - z[2] => - pose_i[2]"
        ),
        "the sign is reversed: predicted minus measured is due": (
            lambda i, j, z: -_edge_error(i, j, z)
        ),
        "the poses are swapped: z is pose j seen from pose i": (
            lambda i, j, z: _edge_error(j, i, z)
        ),
        "this subtracts poses like vectors: turn the displacement into the frame of pose i": (
            lambda i, j, z: np.append((j - i - z)[:2], wrap_angle((j - i - z)[2]))
        ),
        "this subtracts poses like vectors, and the heading is not wrapped": (
            lambda i, j, z: j - i - z
        ),
        "this is the inverse of the error: z seen from the predicted pose": (
            lambda i, j, z: inverse(_edge_error(i, j, z))
        ),
    },
)


# Exercise 3: the Jacobian of the error with respect to pose i.


def _edge_jacobian(pose_i: Array, pose_j: Array, z: Array) -> Array:
    """Jacobian (3, 3) of `edge_error` with respect to pose i."""
    c, s = np.cos(pose_i[2]), np.sin(pose_i[2])
    swing = np.array([[-s, c], [-c, -s]])  # d(R_i^T)/d(theta_i)
    back = rotation(z[2]).T
    J = np.zeros((3, 3))
    J[:2, :2] = -back @ rotation(pose_i[2]).T
    J[:2, 2] = back @ swing @ (pose_j[:2] - pose_i[:2])
    J[2, 2] = -1.0
    return J


check_edge_jacobian = Check(
    _edge_jacobian,
    "J",
    {
        "both robots face along x": ([0, 0, 0], [2, 1, 0], [1, 0, 0]),
        "the first robot has turned": ([1.0, 2.0, 0.5], [2.5, 2.2, 1.4], [1.1, 0.0, 0.0]),
        "the measurement turns too": ([1.0, 2.0, 0.5], [2.5, 2.2, 1.4], [1.1, -0.4, 0.7]),
        "far away, where the lever is long": ([0, 0, -2.0], [30, -40, 1.0], [0.3, 0.2, -0.4]),
        "a general pair of poses": _edge,
    },
    {
        "this is the transpose of the Jacobian: rows are errors, columns are x, y, theta": (
            "return J => return J.T"
        ),
        "this is the Jacobian with respect to pose j, not pose i": (
            "= -back => = back",
            "back @ swing @ (pose_j[:2] - pose_i[:2]) => 0.0",
            "-1.0 => 1.0",
        ),
        "R_z^T is missing: the error is turned by it, so its derivative is too": (
            "rotation(z[2]).T => np.eye(2)"
        ),
        "R_z is transposed the wrong way: R_z^T is due": "rotation(z[2]).T => rotation(z[2])",
        "R_i is transposed the wrong way: R_i^T is due": (
            "rotation(pose_i[2]).T => rotation(pose_i[2])"
        ),
        "the last column lacks the lever: turning robot i swings pose j around it": (
            "back @ swing @ (pose_j[:2] - pose_i[:2]) => 0.0"
        ),
        "the sign of the last column is wrong: differentiate R_i^T, not R_i": (
            "back @ swing => -back @ swing"
        ),
        "the last column is not differentiated: R_i^T itself stands there": (
            "[[-s, c], [-c, -s]] => [[c, s], [-s, c]]"
        ),
        "the lever is the place of pose j: it reaches from pose i to pose j": (
            "(pose_j[:2] - pose_i[:2]) => pose_j[:2]"
        ),
        "the heading of pose i counts with -1: its error is theta_j - theta_i - theta_z": (
            "-1.0 => 1.0"
        ),
        "the heading does not change the last error here: it does, one to one": "-1.0 => 0.0",
        "the sign of the whole matrix is reversed": "return J => return -J",
    },
    tolerance=1e-4,
)


# Exercise 4: one step of Gauss-Newton, with bugs.


def _relax(poses: Array, edges: Ints, z: Array, omega: Array) -> Array:
    """Poses (n, 3) after one step of Gauss-Newton over m edges, the first pose held fixed."""
    n = len(poses)
    H, b = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
    for (i, j), measured, weight in zip(edges, z, omega, strict=True):
        e = _edge_error(poses[i], poses[j], measured)
        A = np.zeros((3, 6))
        A[:, :3] = _edge_jacobian(poses[i], poses[j], measured)
        A[:2, 3:5], A[2, 5] = -A[:2, :2], 1.0
        rows = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        H[np.ix_(rows, rows)] += A.T @ weight @ A
        b[rows] += A.T @ weight @ e
    step = np.zeros(3 * n)
    step[3:] = np.linalg.solve(H[3:, 3:], -b[3:])
    new = poses + step.reshape(n, 3)
    new[:, 2] = wrap_angle(new[:, 2])
    return new


def _path(rng: np.random.Generator, n: int) -> Array:
    """Draw n poses of a drive that turns to the left and crosses half a turn."""
    motions = np.round(rng.uniform([0.5, -0.2, 0.2], [1.5, 0.2, 0.9], (n - 1, 3)), 2)
    start = np.array([*np.round(rng.uniform(-3, 3, 2), 2), np.round(rng.uniform(1, 2), 2)])
    return _dead_reckoning(start, motions)


@drawn
def _graph(rng: np.random.Generator, n: int, extra: int, noise: float = 0.1) -> Any:
    poses = _path(rng, n)
    edges = [(k, k + 1) for k in range(n - 1)]
    edges += [tuple(rng.choice(n, 2, replace=False)) for _ in range(extra)]
    z = np.array([between(poses[i], poses[j]) for i, j in edges])
    poses[1:, :2] += rng.normal(0, noise, (n - 1, 2))
    poses[1:, 2] = wrap_angle(poses[1:, 2] + rng.normal(0, noise, n - 1))
    return poses, edges, z, np.array([10 * a_covariance(rng, 3) for _ in edges])


def _two_readings(rng: np.random.Generator) -> Any:
    """Draw one motion that was measured twice, once well and once badly."""
    poses, _, z, omega = _graph(2, 1)(rng)
    z = np.array([z[0], z[0] + np.round(rng.normal(0, 0.3, 3), 2)])
    return poses, [(0, 1), (0, 1)], z, omega * np.array([1.0, 20.0])[:, None, None]


check_relax = Check(
    _relax,
    "poses",
    {
        "two poses and one edge": _graph(2, 0),
        "poses that contradict no edge stay where they are": _graph(4, 0, 0.0),
        "one motion measured twice, well and badly": _two_readings,
        "a chain of four": _graph(4, 0),
        "a chain with closures, some of them read backwards": _graph(5, 3),
        "across half a turn": (
            [[0.0, 0.0, 3.0], [-1.0, 0.1, -3.1], [-2.0, 0.2, -2.9]],
            [(0, 1), (1, 2), (2, 0)],
            [[1.0, 0.0, 0.2], [1.0, 0.0, 0.1], [-2.0, 0.0, -0.35]],
            [4.0 * np.eye(3), 2.0 * np.eye(3), np.eye(3)],
        ),
    },
    {
        "every edge pulls: the last edge of a pose has overwritten what the others said in b": (
            "b[rows] += A.T => b[rows] = A.T"
        ),
        "every edge holds: the last edge of a pose has overwritten the others in H": (
            "H[np.ix_(rows, rows)] += A.T => H[np.ix_(rows, rows)] = A.T"
        ),
        "the heading error is not wrapped: a full turn pulls like a wrong edge": (
            "e = _edge_error(poses[i], poses[j], measured)"
            " => e = np.append(_edge_error(poses[i], poses[j], measured)[:2], "
            "poses[j][2] - poses[i][2] - measured[2])"
        ),
        "the new headings are not wrapped: (-pi, pi] is due": (
            "wrap_angle(new[:, 2]) => new[:, 2]"
        ),
        "the step goes uphill: H step = -b": "-b[3:] => b[3:]",
        "the information is not used in H: A^T Omega A": "A.T @ weight @ A => A.T @ A",
        "the information is not used in b: A^T Omega e": "A.T @ weight @ e => A.T @ e",
        "the information is not used at all: an edge counts as much as it is sure": (
            "A.T @ weight @ => A.T @"
        ),
        "Omega was inverted: it is an information, no covariance": (
            "A.T @ weight @ => A.T @ np.linalg.inv(weight) @"
        ),
        "the lever is missing: turning pose i swings pose j": (
            "= -A[:2, :2], 1.0 => = -A[:2, :2], 1.0\n        A[:2, 2] = 0.0"
        ),
        "pose j does not move: it has columns in A too": "= -A[:2, :2], 1.0 => = 0.0, 0.0",
        "only the step came: add it to the poses": "poses + step => 0 * poses + step",
    },
    tolerance=1e-6,
)


# Exercise 5: SLAM, assembled.


def _slam(
    start: Array, odometry: Array, omega: Array, closures: Ints, z: Array, omega_closure: Array
) -> tuple[Array, float]:
    """Poses (n + 1, 3) of least chi2 after n motions and m closures, and that chi2."""
    n = len(odometry)
    poses = _dead_reckoning(start, odometry)
    edges = np.vstack([np.column_stack([np.arange(n), np.arange(n) + 1]), closures])
    measured = np.vstack([odometry, z])
    weights = np.array([omega] * n + [omega_closure] * len(closures))
    for _ in range(15):
        poses = _relax(poses, edges, measured, weights)
    chi2 = 0.0
    for (i, j), seen, weight in zip(edges, measured, weights, strict=True):
        e = _edge_error(poses[i], poses[j], seen)
        chi2 += float(e @ weight @ e)
    return poses, chi2


@drawn
def _ride(rng: np.random.Generator, n: int, closures: int) -> Any:
    truth = _path(rng, n + 1)
    pairs = [rng.choice(n + 1, 2, replace=False) for _ in range(closures)]
    sigma = np.array([0.05, 0.05, 0.03])
    odometry = np.array([between(truth[k], truth[k + 1]) for k in range(n)])
    z = np.reshape([between(truth[i], truth[j]) for i, j in pairs], (closures, 3))
    odometry = np.round(odometry + sigma * rng.standard_normal((n, 3)), 3)
    z = z + sigma / 2 * rng.standard_normal((closures, 3))
    weight = np.linalg.inv(a_covariance(rng, 3, 0.02)), np.diag((2 / sigma) ** 2)
    return truth[0], odometry, weight[0], np.reshape(pairs, (closures, 2)), z, weight[1]


check_slam = Check(
    _slam,
    "poses, chi2",
    {
        "without a closure it is dead reckoning": _ride(3, 0),
        "one motion and one closure": _ride(1, 1),
        "a closure at the end": _ride(5, 1),
        "a ride with three closures": _ride(7, 3),
    },
    {
        "the closures were not used: they are edges like the others": (
            "measured = np.vstack([odometry, z]) => edges, measured = edges[:n], odometry",
            "weights = np.array([omega] * n + [omega_closure] * len(closures))"
            " => weights = np.array([omega] * n)",
        ),
        "this is dead reckoning: nothing was relaxed": "range(15) => range(0)",
        "one step is not enough: the edges bend while the poses turn": "range(15) => range(1)",
        "a closure was read backwards: pose j is seen from pose i": (
            "np.arange(n) + 1]), closures] => np.arange(n) + 1]), closures[:, ::-1]]"
        ),
        "all edges have the information of the odometry: closures have their own": (
            "[omega_closure] * => [omega] *"
        ),
        "all edges have the information of the closures: motions have their own": (
            "[omega] * n => [omega_closure] * n"
        ),
        "chi2 is that of dead reckoning: the relaxed poses are due": (
            "_edge_error(poses[i], poses[j], seen)"
            " => _edge_error(*_dead_reckoning(start, odometry)[[i, j]], seen)"
        ),
        "chi2 lacks the information: e^T Omega e": "e @ weight @ e => e @ e",
        "chi2 is that of the closures alone: the motions are edges too": (
            "zip(edges, measured, weights, strict=True)"
            " => zip(edges[n:], measured[n:], weights[n:], strict=True)"
        ),
        "chi2 is that of the motions alone: the closures are edges too": (
            "zip(edges, measured, weights, strict=True)"
            " => zip(edges[:n], measured[:n], weights[:n], strict=True)"
        ),
        "chi2 is that of the last edge: add them all up": "chi2 +=  => chi2 = ",
        "chi2 has no one half in this book": "return poses, chi2 => return poses, chi2 / 2",
    },
    tolerance=1e-6,
    draws=3,
)
