"""Right answers of chapter 03, written in other ways: each passes."""

import cmath
import math

import numpy as np
import pytest

from slamlab.exercises import ch03_extended_kalman_filter as ch


def by_complex_numbers(pose, masts, boom):
    """Another right answer: the tip as a complex number, a loop, the ray folded by hand."""
    tip = complex(*pose[:2]) + boom * cmath.exp(1j * pose[2])
    found = []
    for mast in masts:
        angle = cmath.phase(complex(*mast) - tip)  # from the tip to the mast: the same line
        while angle > math.pi / 2:
            angle -= math.pi
        while angle < -math.pi / 2:
            angle += math.pi
        found.append(angle)
    return found


def by_chain_rule(pose, masts, boom):
    """Another right answer: the derivative by the tip, times that of the tip by the pose."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    tip_by_pose = np.array([[1, 0, -boom * s], [0, 1, boom * c]])
    rows = []
    for dx, dy in pose[:2] + [boom * c, boom * s] - masts:
        rows.append(np.array([-dy, dx]) @ tip_by_pose / (dx**2 + dy**2))
    return rows


def by_cramer(z, masts, boom, compass, R):
    """Another right answer: the crossing by determinants, the covariance by `solve`."""
    b = masts[:, 1] * np.cos(z) - masts[:, 0] * np.sin(z)
    det = -np.sin(z[0]) * np.cos(z[1]) + np.cos(z[0]) * np.sin(z[1])
    x = (b[0] * np.cos(z[1]) - b[1] * np.cos(z[0])) / det
    y = (-np.sin(z[0]) * b[1] + np.sin(z[1]) * b[0]) / det
    pose = [x - boom * np.cos(compass), y - boom * np.sin(compass), compass]
    J = np.array([*by_chain_rule(np.array(pose), masts, boom), [0, 0, 1]])
    half = np.linalg.solve(J, R)
    return pose, np.linalg.solve(J, half.T)


def with_a_full_update(mean, cov, u, dt, V, compass, variance):
    """Another right answer to the hunt: all as matrices, Joseph's form."""
    for v, omega in u:
        c, s = np.cos(mean[2]), np.sin(mean[2])
        F = np.array([[1, 0, -v * dt * s], [0, 1, v * dt * c], [0, 0, 1]])
        F_u = dt * np.array([[c, 0], [s, 0], [0, 1]])
        mean, cov = mean + F_u @ [v, omega], F @ cov @ F.T + F_u @ V @ F_u.T
    H = np.array([[0.0, 0.0, 1.0]])
    K = cov @ H.T / (H @ cov @ H.T + variance)
    mean = mean + K[:, 0] * math.remainder(compass - mean[2], math.tau)
    mean[2] = math.remainder(mean[2], math.tau)
    A = np.eye(3) - K @ H
    return mean, A @ cov @ A.T + variance * K @ K.T


def one_mast_after_the_other(mean, cov, u, dt, V, z, masts, boom, sigma):
    """A stacked update of a straight function is the same in turn; of a curved one it is not."""
    means, covs = [], []
    for (v, omega), read in zip(u, z, strict=True):
        c, s = np.cos(mean[2]), np.sin(mean[2])
        F = np.array([[1, 0, -v * dt * s], [0, 1, v * dt * c], [0, 0, 1]])
        F_u = dt * np.array([[c, 0], [s, 0], [0, 1]])
        mean, cov = mean + F_u @ [v, omega], F @ cov @ F.T + F_u @ V @ F_u.T
        at = mean.copy()
        for k in np.flatnonzero(np.isfinite(read)):
            h = by_chain_rule(at, masts[k : k + 1], boom)[0]
            expected = by_complex_numbers(at, masts[k : k + 1], boom)[0] + h @ (mean - at)
            gain = cov @ h / (h @ cov @ h + sigma**2)
            mean = mean + gain * np.arctan(np.tan(read[k] - expected))
            cov = cov - np.outer(gain, h @ cov)
        mean = np.array([*mean[:2], math.remainder(mean[2], math.tau)])
        means.append(mean)
        covs.append(cov)
    return means, covs


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_readings, by_complex_numbers),
        (ch.check_innovation, lambda z, p: [math.remainder(d, math.pi) for d in z - p]),
        (ch.check_innovation, lambda z, p: np.angle(np.exp(2j * (z - p))) / 2),
        (ch.check_jacobian, by_chain_rule),
        (ch.check_jacobian, lambda *given: ch.jacobian(*given).tolist()),
        (ch.check_first_fix, by_cramer),
        (ch.check_row_end, with_a_full_update),
        (ch.check_follow, one_mast_after_the_other),
    ],
)
def test_another_right_answer_passes(check, answer):
    report = check(answer)
    assert report.passed, report


def test_the_ellipse_of_the_position_does_not_show_the_bug_of_the_row():
    """Before the compass the handed-out program and a right one report the same ellipse."""
    wrong = ch.check_row_end.mistaken("-step[1], step[0] => step[1], -step[0]")
    given = np.zeros(3), np.diag([0.05, 0.05, 0.1]) ** 2, np.tile([0.8, 0.1], (30, 1)), 0.5
    V = np.diag([0.1, 0.03]) ** 2
    (_, right), (_, shown) = (f(*given, V, 0.0, 1e12) for f in (ch.row_end, wrong))
    np.testing.assert_allclose(shown[:2, :2], right[:2, :2], atol=1e-9)
    np.testing.assert_allclose(shown[:2, 2], -right[:2, 2], atol=1e-9)
