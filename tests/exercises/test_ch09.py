"""Right answers of chapter 09, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.exercises import ch09_ekf_slam as ch
from slamlab.sensors import RangeBearing


def by_differences(pose, landmark, L):
    """Complex steps are not needed: central differences with extrapolation are good to 1e-10."""
    sensor = RangeBearing(1, 1, offset=float(L))

    def slope(h):
        columns = []
        for k in range(3):
            step = h * np.eye(3)[k]
            ahead, behind = (
                sensor.observe(pose + step, landmark),
                sensor.observe(pose - step, landmark),
            )
            columns.append(sensor.residual(ahead, behind) / (2 * h))
        return np.array(columns).T

    return ((4 * slope(5e-4) - slope(1e-3)) / 3).tolist()


def by_one_product(P, G_pose, G_z, R):
    """J blockdiag(P, R) J^T with the map from (old state, z) to the new state."""
    n = len(P)
    J = np.zeros((n + 2, n + 2))
    J[:n, :n], J[n:, :3], J[n:, n:] = np.eye(n), G_pose, G_z
    noise = np.zeros((n + 2, n + 2))
    noise[:n, :n], noise[n:, n:] = P, R
    return J @ noise @ J.T


def by_two_points(pose, wall, L):
    """Move two points of the wall into the sensor's frame and take the line through them."""
    r, alpha = wall
    normal, along = np.array([np.cos(alpha), np.sin(alpha)]), [-np.sin(alpha), np.cos(alpha)]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    eye = np.asarray(pose)[:2] + float(L) * np.array([c, s])
    a, b = (np.array([[c, s], [-s, c]]) @ (r * normal + t * np.array(along) - eye) for t in (0, 1))
    foot = a - (b - a) * (a @ (b - a))
    return [float(np.hypot(*foot)), float(np.arctan2(foot[1], foot[0]))]


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_jacobian, by_differences),
        (ch.check_add_landmark, by_one_product),
        (ch.check_wall, by_two_points),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
