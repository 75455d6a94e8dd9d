"""Right answers of chapter 00, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.exercises import ch00_slam_in_ten_minutes as ch


def by_matrices(start, odometry):
    """Another right answer: homogeneous matrices, and lists instead of arrays."""

    def matrix(p):
        c, s = np.cos(p[2]), np.sin(p[2])
        return np.array([[c, -s, p[0]], [s, c, p[1]], [0, 0, 1]])

    T = matrix(start)
    poses = [list(start)]
    for motion in odometry:
        T = T @ matrix(motion)
        poses.append([T[0, 2], T[1, 2], np.arctan2(T[1, 0], T[0, 0])])
    return poses


def by_steps(pose_i, pose_j, z):
    """Another right answer: a plain list and the angle wrapped by arctan2."""
    dx, dy = pose_j[0] - pose_i[0], pose_j[1] - pose_i[1]
    c, s = np.cos(pose_i[2]), np.sin(pose_i[2])
    x, y = c * dx + s * dy - z[0], -s * dx + c * dy - z[1]
    c, s = np.cos(z[2]), np.sin(z[2])
    a = pose_j[2] - pose_i[2] - z[2]
    return [c * x + s * y, -s * x + c * y, np.arctan2(np.sin(a), np.cos(a))]


def by_complex_step(pose_i, pose_j, z):
    """Another right answer: the Jacobian by complex steps through the formula."""
    columns = []
    for k in range(3):
        i = np.array(pose_i, dtype=complex)
        i[k] += 1e-30j
        d = pose_j[:2] - i[:2]
        c, s = np.cos(i[2]), np.sin(i[2])
        b = np.array([c * d[0] + s * d[1] - z[0], -s * d[0] + c * d[1] - z[1]])
        c, s = np.cos(z[2]), np.sin(z[2])
        e = np.array([c * b[0] + s * b[1], -s * b[0] + c * b[1], pose_j[2] - i[2] - z[2]])
        columns.append(e.imag / 1e-30)
    return np.array(columns).T


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_dead_reckoning, by_matrices),
        (ch.check_edge_error, by_steps),
        (ch.check_edge_jacobian, by_complex_step),
        (
            ch.check_edge_jacobian,
            lambda i, j, z: ch.check_edge_jacobian.reference(i, j, z).tolist(),
        ),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
