"""Right answers of chapter 10, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.exercises import ch10_convergence_consistency_and_cost as ch
from slamlab.sensors import RangeBearing


def by_a_matrix(P):
    """Another right answer: m1 - m2 is a linear map of the state."""
    A = np.zeros((2, 7))
    A[:, 3:5], A[:, 5:7] = np.eye(2), -np.eye(2)
    return (A @ P @ A.T).tolist()


def block_by_block(P, F, Q):
    """Another right answer: the blocks of P1 (11), in place of a copy."""
    P = P.copy()
    P[:3, 3:] = F @ P[:3, 3:]
    P[3:, :3] = P[:3, 3:].T
    P[:3, :3] = F @ P[:3, :3] @ F.T + Q
    return P


def by_square_roots(Phi, Psi, theta, H, S, v, K):
    """Another right answer: whiten the measurement first."""
    root = np.linalg.cholesky(S)
    A, w = np.linalg.solve(root, H @ Phi), np.linalg.solve(root, v)
    return [(np.eye(len(Phi)) - K @ H) @ Phi, Psi + A.T @ A, theta + A.T @ w]


def by_the_jacobians(d, D, R):
    """Another right answer: H and t as matrices, the robot at the origin, the library's sensor."""
    sensor, total = RangeBearing(1.0, 1.0), 0.0
    for newest, first in zip(d, D, strict=True):
        H_pose, H_point = sensor.jacobians(np.zeros(3), newest)
        Ht = H_pose @ [0, 0, 1] + H_point @ [-first[1], first[0]]
        total += Ht @ np.linalg.inv(R) @ Ht
    return total


def by_information(mean, P, first, z, i, R):
    """Another right answer: the inverse covariance grows, Jacobians from the library's sensor."""
    sensor, k = RangeBearing(1.0, 1.0), 3 + 2 * int(i)
    H = np.zeros((2, len(mean)))
    H[:, :3], H[:, k : k + 2] = sensor.jacobians(first[:3], first[k : k + 2])
    v = sensor.residual(z, sensor.observe(mean[:3], mean[k : k + 2]))
    smaller = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.solve(R, H))
    new = mean + smaller @ H.T @ np.linalg.solve(R, v)
    new[2] = np.arctan2(np.sin(new[2]), np.cos(new[2]))
    return new.tolist(), smaller.tolist()


def by_whole_matrices(P0, u, dt, V, z, ids, R):
    """Another right answer: every step is one product of matrices as large as the state."""
    mean, first, P, names = np.zeros(3), np.zeros(3), np.array(P0), []
    for (v, omega), seen, ids_now in zip(u, z, ids.tolist(), strict=True):
        n, heading = len(mean), mean[2]
        new = mean.copy()
        new[:3] += dt * np.array([v * np.cos(heading), v * np.sin(heading), omega])
        new[2] = np.arctan2(np.sin(new[2]), np.cos(new[2]))
        F, G = np.eye(n), np.zeros((n, 2))
        F[0, 2], F[1, 2] = -(new[1] - first[1]), new[0] - first[0]
        G[:3] = dt * np.array([[np.cos(heading), 0], [np.sin(heading), 0], [0, 1]])
        mean, P = new, F @ P @ F.T + G @ V @ G.T
        first = np.concatenate([new[:3], first[3:]])
        fresh = [k for k, name in enumerate(ids_now) if name >= 0 and name not in names]
        known = [k for k, name in enumerate(ids_now) if name in names]
        for k in fresh:
            sensor, n = RangeBearing(1.0, 1.0), len(mean)
            G_pose, G_z = sensor.locate_jacobians(mean[:3], seen[k])
            J = np.vstack([np.eye(n), np.hstack([G_pose, np.zeros((2, n - 3))])])
            point = sensor.locate(mean[:3], seen[k])
            P = J @ P @ J.T
            P[n:, n:] += G_z @ R @ G_z.T
            mean, first = np.append(mean, point), np.append(first, point)
            names.append(ids_now[k])
        for k in known:
            i = names.index(ids_now[k])
            mean, P = map(np.array, by_information(mean, P, first, seen[k], i, R))
    return mean, P


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_difference_cov, by_a_matrix),
        (ch.check_predict_cov, block_by_block),
        (ch.check_accounts, by_square_roots),
        (ch.check_leaked, by_the_jacobians),
        (ch.check_update, by_information),
        (ch.check_slam, by_whole_matrices),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def test_each_bug_of_the_hunt_shows_in_its_picture():
    """The one in H in the heading's sigma, the one in the innovation after four posts."""
    updates = ch.update, ch._with_leak, ch._with_old_pose
    right, leak, old = (ch._four_posts(update) for update in updates)
    assert right < 0.2
    assert leak == right
    assert old > 1.0
