"""Right answers of chapter 16, written in other ways: each passes; and what the pages say."""

import math

import numpy as np
import pytest

from slamlab.exercises import ch16_uav_local_range as ch
from slamlab.geometry import tilt, wrap_angle


def ground_by_the_library(rays, roll, pitch, height):
    """Another right answer: the library's matrix, ray by ray, and a list."""
    found = []
    for ray in rays:
        ahead, left, up = tilt(roll, pitch) @ ray
        found.append([-height * ahead / up, -height * left / up] if up < 0 else [math.nan] * 2)
    return np.reshape(found, (-1, 2))


def direction_by_eigenvectors(a, b, R):
    rows = np.array([np.cross(R @ one, other) for one, other in zip(a, b, strict=True)])
    t = np.linalg.eigh(rows.T @ rows)[1][:, 0]
    # Depth of a tree in both pictures, by least squares: d2 b = d R a + t.
    ahead = 0
    for one, other in zip(a, b, strict=True):
        d, _ = np.linalg.lstsq(np.column_stack([-R @ one, other]), t, rcond=None)[0]
        ahead += np.sign(d)
    return list(t if ahead > 0 else -t)


def range_in_a_loop(ranges, n_seen, memory, wanted, nearest, furthest):
    trees = area = 0.0
    for r, n in zip(ranges, n_seen, strict=True):
        trees, area = memory * trees + n, memory * area + math.pi * r * r
    if not trees:
        return furthest
    return min(max(math.sqrt(wanted / (math.pi * trees / area)), nearest), furthest)


def update_in_another_order(x, P, Phi, Psi, theta, ranges, height, variance):
    """Another right answer: range by range in S, gain by solve, Joseph's form."""
    x, n = x.copy(), len(x)
    rows, v = [], []
    for j, z in enumerate(ranges):
        if np.isnan(z):
            continue
        dx, dy = x[3 + 2 * j] - x[0], x[4 + 2 * j] - x[1]
        rho = math.hypot(dx, dy, height)
        row = np.zeros(n)
        row[[0, 1]], row[[3 + 2 * j, 4 + 2 * j]] = [-dx / rho, -dy / rho], [dx / rho, dy / rho]
        rows.append(row)
        v.append(z - rho)
    H, v = np.reshape(rows, (-1, n)), np.array(v)
    R = variance * np.eye(len(v))
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    A = np.eye(n) - K @ H
    back = (H @ Phi).T @ np.linalg.inv(S)
    x += K @ v
    x[2] = (x[2] + math.pi) % (2 * math.pi) - math.pi
    return x, A @ P @ A.T + K @ R @ K.T, A @ Phi, Psi + back @ H @ Phi, theta + back @ v


def leave_as_the_lesson(x, P, entries, x_a, P_a, Phi, Psi, theta):
    """Another right answer: a is left out of the correction, the photograph comes by itself."""
    P_ab = P[entries].copy()
    photo = x[:3] + P[:3, entries] @ theta
    photo[2] = wrap_angle(photo[2])
    cov = P[:3, :3] - P[:3, entries] @ Psi @ P[entries, :3]
    P_ab[:, entries] = 0
    x, P = x + theta @ P_ab, P - P_ab.T @ Psi @ P_ab
    P[entries] = Phi @ P_ab
    P[:, entries] = P[entries].T
    x[entries], P[np.ix_(entries, entries)] = x_a, P_a
    return x, P, photo, cov


def the_full_filter(x, P, u, V, dt, ranges, height, variance, radius, stay):
    """Another right answer: EKF-SLAM with all trees; regions are only counted."""
    x, P, n, path = x.copy(), P.copy(), (len(x) - 3) // 2, []

    def inside():
        return np.flatnonzero(np.hypot(*(x[3:].reshape(-1, 2) - x[:2]).T) < radius)

    near, start = inside(), x[:2].copy()
    regions = [[0, 3 + 2 * len(near)]]
    for k, (v, omega) in enumerate(u):
        c, s = np.cos(x[2]), np.sin(x[2])
        F, G = np.eye(3), dt * np.array([[c, 0], [s, 0], [0, 1]])
        F[:2, 2] = -v * dt * s, v * dt * c
        x[:3] += G @ [v, omega]
        P[:3] = F @ P[:3]
        P[:, :3] = P[:, :3] @ F.T
        P[:3, :3] += G @ V @ G.T
        if np.hypot(*(x[:2] - start)) > stay:
            near, start = inside(), x[:2].copy()
            regions.append([k, 3 + 2 * len(near)])
        z = np.where(np.isin(np.arange(n), near), ranges[k], np.nan)
        empty = np.zeros_like(P)
        x, P, *_ = update_in_another_order(x, P, empty, empty, 0 * x, z, height, variance)
        path.append(x[:3].copy())
    return x, P, path, regions


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_ground_points, ground_by_the_library),
        (ch.check_direction_of_move, direction_by_eigenvectors),
        (ch.check_next_range, range_in_a_loop),
        (ch.check_range_update, update_in_another_order),
        (ch.check_leave, leave_as_the_lesson),
        (ch.check_fly, the_full_filter),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def test_a_photograph_is_a_pose_that_the_full_filter_keeps():
    """Three more numbers of the state, which do not move: the same mean and covariance."""
    given, *_ = ch.survey(3, 60.0, 2.0, 0.5)
    x, P, u, V, dt, ranges, height, variance = given
    P[range(3), range(3)] = 1.0, 1.0, 0.01
    near, entries, region = ch.enter(x, P, 40.0)
    n = len(x)
    # A tree and a half more: the pose at the entry, and a number that is not used.
    copy = np.r_[np.arange(n), 0, 1, 2, 2]
    big, C = x[copy], P[np.ix_(copy, copy)]
    for k in range(6):
        region = ch.range_update(
            *ch._predict(region, u[k], V, dt), ranges[k, near], height, variance
        )
        records = np.eye(n + 4), np.zeros((n + 4, n + 4)), np.zeros(n + 4)
        big, C, *records = ch._predict((big, C, *records), u[k], V, dt)
        z = np.full((n + 1) // 2, np.nan)
        z[near] = ranges[k, near]
        big, C, *_ = ch.range_update(big, C, *records, z, height, variance)
    mean, cov, photo, photo_cov = ch.leave(x, P, entries, *region)
    np.testing.assert_allclose(np.r_[mean, photo], big[:-1], atol=1e-9)
    np.testing.assert_allclose(cov, C[:n, :n], atol=1e-9)
    np.testing.assert_allclose(photo_cov, C[n : n + 3, n : n + 3], atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_flight_with_regions_ends_where_the_full_filter_ends(seed):
    given, *_ = ch.survey(seed, 60.0, 3.0, 0.5)
    local = ch.fly(*given, 40.0, 10.0)
    assert len(local[3]) > 5
    for one, other in zip(local[:3], the_full_filter(*given, np.inf, np.inf)[:3], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-8)


def test_each_bug_of_the_hunt_shows_where_the_page_says():
    """One in the region, in the air; the other outside; neither at first, on the ground."""
    reference = ch.range_update
    slope = ch.check_range_update.mistaken(
        "slope = d / expected[:, None] => slope = d / np.hypot(*d.T)[:, None]"
    )
    seen = ch.check_range_update.mistaken("seen = H @ Phi => seen = H")
    ground = [a for name, a in ch.check_range_update.inputs if name.startswith("on the ground, t")]
    for given in ground:
        for wrong in (slope, seen):
            for one, other in zip(wrong(*given), reference(*given), strict=True):
                np.testing.assert_allclose(one, other, atol=1e-9)
    region, outside = [], []
    for seed in range(10):
        given, _, trees = ch.survey(seed, 90.0, 3.0, 0.5)
        x, P, u, V, dt, ranges, height, variance = given
        off = []
        for update in (reference, slope, seen):
            near, entries, now = ch.enter(x, P, 42.0)
            for k in range(12):
                now = update(*ch._predict(now, u[k], V, dt), ranges[k, near], height, variance)
            off.append(ch.metres_off(ch.leave(x, P, entries, *now)[0], trees))
        inside = np.isin(np.arange(len(trees)), near)
        region.append([one[inside].mean() for one in off])
        outside.append([one[~inside].mean() for one in off])
    right, with_slope, with_seen = np.median(region, axis=0)
    assert right < 1.0
    assert 2.0 < with_slope < 3.0
    assert with_seen == pytest.approx(right)
    assert np.median(outside, axis=0)[2] > 100
