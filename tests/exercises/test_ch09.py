"""Right answers of chapter 09, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.evaluation import chi2_band
from slamlab.exercises import ch09_ekf_slam as ch
from slamlab.geometry import rotation, wrap_angle


def by_differences(pose, mount, landmark):
    """Complex steps are not needed: central differences with extrapolation are good to 1e-10."""

    def observed(x):
        sensor_position = x[:2] + rotation(x[2]) @ x[3:5]
        d = x[5:] - sensor_position
        return np.array([np.hypot(*d), np.arctan2(d[1], d[0]) - x[2]])

    x = np.concatenate([pose, mount, landmark])

    def slope(h):
        columns = []
        for step in h * np.eye(7):
            change = observed(x + step) - observed(x - step)
            columns.append([change[0] / (2 * h), wrap_angle(change[1]) / (2 * h)])
        return np.array(columns).T

    return ((4 * slope(5e-4) - slope(1e-3)) / 3).tolist()


def by_the_lesson(pose, mount, landmark):
    """The lesson's form with the length of the lever arm, and the heading in its direction."""
    L, angle = np.hypot(*mount), np.arctan2(mount[1], mount[0])
    c, s = np.cos(pose[2] + angle), np.sin(pose[2] + angle)
    (dx, dy), H = landmark - pose[:2] - L * np.array([c, s]), np.zeros((2, 7))
    rho = np.hypot(dx, dy)
    H[:, 5:] = [[dx / rho, dy / rho], [-dy / rho**2, dx / rho**2]]
    H[:, :2] = -H[:, 5:]
    H[:, 2] = H[:, :2] @ [-L * s, L * c] - [0, 1]
    H[:, 3:5] = H[:, :2] @ rotation(pose[2])
    return H


def by_one_product(P, H_x, H_m, R):
    """J blockdiag(P, R) J^T with the map from (old state, z) to the new state."""
    n, k = len(P), len(R)
    J, noise = np.eye(n + k), np.zeros((n + k, n + k))
    J[n:] = np.linalg.solve(H_m, np.hstack([-H_x, np.eye(k)]))
    noise[:n, :n], noise[n:, n:] = P, R
    return J @ noise @ J.T


def by_an_update(P, H_x, H_m, R):
    """A landmark that is not known at all, and one correction in the information form."""
    n = len(P)
    H = np.hstack([H_x, H_m])
    information = H.T @ np.linalg.solve(R, H)
    if np.linalg.matrix_rank(P) < n:
        return by_one_product(P, H_x, H_m, R)
    information[:n, :n] += np.linalg.inv(P)
    return np.linalg.inv(information)


def by_two_points(pose, wall, L):
    """Move two points of the wall into the sensor's frame and take the line through them."""
    r, alpha = wall
    normal, along = np.array([np.cos(alpha), np.sin(alpha)]), [-np.sin(alpha), np.cos(alpha)]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    sensor_position = np.asarray(pose)[:2] + float(L) * np.array([c, s])
    a, b = (
        np.array([[c, s], [-s, c]]) @ (r * normal + t * np.array(along) - sensor_position)
        for t in (0, 1)
    )
    foot = a - (b - a) * (a @ (b - a))
    return [float(np.hypot(*foot)), float(np.arctan2(foot[1], foot[0]))]


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_jacobian, by_differences),
        (ch.check_jacobian, by_the_lesson),
        (ch.check_add_landmark, by_one_product),
        (ch.check_add_landmark, by_an_update),
        (ch.check_wall, by_two_points),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def test_the_mount_is_found_in_a_room_that_is_not_known():
    off, nees = [], []
    for seed in range(20):
        found, cov = ch._mount_found(ch.jacobian, seed)
        error = found[-1] - ch._MOUNT
        off.append(np.hypot(*error))
        nees.append(error @ np.linalg.solve(cov, error))
    assert max(off) < 0.03
    assert chi2_band(2, 20)[0] < np.mean(nees) < chi2_band(2, 20)[1]


def test_a_wrong_sign_puts_the_landmark_further_off_in_the_dock():
    def off(function):
        truth, before, _, after, _ = ch._docked(function)
        return [np.hypot(*(mean[6:] - truth[6:])) for mean in (before, after)]

    before, after = off(ch.add_landmark)
    assert after < 0.3 * before
    wrong = off(lambda P, H_x, H_m, R: ch.add_landmark(P, -H_x, H_m, R))
    assert wrong[0] == before
    assert wrong[1] > 1.5 * before


@pytest.mark.parametrize("seed", [0, 1, 6])
def test_two_hundred_maps_are_consistent(seed):
    u, dt, V, R, names, seen, paths = ch._two_hundred(seed)
    nees = []
    for z, path in zip(seen, paths, strict=True):
        mean, P = ch.slam(u, dt, V, z, names, R)
        error = mean[:3] - path[-1]
        error[2] = wrap_angle(error[2])
        nees.append(error @ np.linalg.solve(P[:3, :3], error))
    low, high = chi2_band(3, 200)
    assert low < np.mean(nees) < high
