"""Right answers of chapter 00, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.exercises import ch00_slam_in_ten_minutes as ch
from slamlab.slam import PoseGraph


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


def lamp_by_complex_step(pose, lamp):
    """Another right answer: complex steps through the error of a lamp."""
    columns = []
    for k in range(5):
        x = np.array([*pose, *lamp], dtype=complex)
        x[k] += 1e-30j
        (dx, dy), c, s = x[3:] - x[:2], np.cos(x[2]), np.sin(x[2])
        columns.append([(c * dx + s * dy).imag / 1e-30, (c * dy - s * dx).imag / 1e-30])
    return np.array(columns).T.tolist()


def by_square_roots(poses, edges, z, omega):
    """Another right answer: whitened residuals, least squares over all but the first pose."""
    rows, errors = [], []
    for (i, j), measured, weight in zip(edges.tolist(), z, omega, strict=True):
        root = np.linalg.cholesky(weight).T
        J = np.zeros((3, 3 * len(poses)))
        J[:, 3 * i : 3 * i + 3] = by_complex_step(poses[i], poses[j], measured)
        a = poses[i, 2] + measured[2]
        J[:2, 3 * j : 3 * j + 2] = [[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]
        J[2, 3 * j + 2] = 1.0
        rows.append(root @ J)
        errors.append(root @ by_steps(poses[i], poses[j], measured))
    step = np.linalg.lstsq(np.vstack(rows)[:, 3:], -np.concatenate(errors), rcond=None)[0]
    new = poses.copy()
    new[1:] += step.reshape(-1, 3)
    return [[x, y, np.arctan2(np.sin(t), np.cos(t))] for x, y, t in new]


def by_the_library(start, odometry, omega, closures, z, omega_closure):
    n, m = len(odometry), len(closures)
    pairs = [(k, k + 1) for k in range(n)] + [tuple(map(int, pair)) for pair in closures]
    weights = np.array([omega] * n + [omega_closure] * m)
    poses = np.array(by_matrices(start, odometry))
    graph = PoseGraph(poses, pairs, [*odometry, *z], weights)
    result = graph.optimize()
    return result.poses, result.chi2


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_dead_reckoning, by_matrices),
        (ch.check_edge_error, by_steps),
        (ch.check_edge_error, lambda i, j, z: ch.between(z, ch.between(i, j))),
        (ch.check_lamp_jacobian, lamp_by_complex_step),
        (ch.check_relax, by_square_roots),
        (ch.check_slam, by_the_library),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


@pytest.mark.parametrize("bugs", [[ch._ADDED], [ch._WRAPPED], [ch._ADDED, ch._WRAPPED]])
def test_a_bug_that_is_left_in_relax_is_named(bugs):
    report = ch.check_slam.judge(ch.check_slam.observe(ch._slam_with(15, *bugs)))
    assert report.messages[0].startswith("your `relax` still has")


def test_the_town_is_mapped_in_fifteen_steps():
    truth, *given = ch._town()
    poses, _ = ch.slam(*given)
    again = ch.relax(
        poses,
        np.vstack([np.column_stack([np.arange(119), np.arange(119) + 1]), given[3]]),
        np.vstack([given[1], given[4]]),
        np.array([given[2]] * 119 + [given[5]] * 41),
    )
    assert len(given[3]) == 41
    np.testing.assert_allclose(poses, again, atol=1e-9)
    assert np.hypot(*(poses - truth)[:, :2].T).mean() < 0.2
