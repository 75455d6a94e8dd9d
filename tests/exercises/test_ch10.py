"""Right answers of chapter 10, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.exercises import ch10_convergence_consistency_and_cost as ch
from slamlab.sensors import RangeBearing


def along_the_door(mean, P):
    """Another right answer: the difference is a linear map, the width a part of it."""
    A = np.zeros((2, 7))
    A[:, 3:5], A[:, 5:7] = np.eye(2), -np.eye(2)
    d = A @ mean
    return np.linalg.norm(d), d @ (A @ P @ A.T) @ d / (d @ d)


def step_by_step(P, F, Q):
    """Another right answer: every step moves the strips too."""
    P = P.copy()
    for step, noise in zip(F, Q, strict=True):
        P[:3, 3:] = step @ P[:3, 3:]
        P[3:, :3] = P[:3, 3:].T
        P[:3, :3] = step @ P[:3, :3] @ step.T + noise
    return P


def by_stripes(P, F, Q):
    """Another right answer: the pose's rows, then its columns, by one product of all F."""
    P, Phi, noise = np.copy(P), np.eye(3), np.zeros((3, 3))
    for step, added in zip(F, Q, strict=True):
        Phi, noise = step @ Phi, step @ noise @ step.T + added
    P[:3] = Phi @ P[:3]
    P[:, :3] = P[:, :3] @ Phi.T
    P[:3, :3] += noise
    return P


def by_whole_products(P, F, Q):
    """The lesson's form, right where no variance is infinite: two whole products a step."""
    P = P.copy()
    for step, noise in zip(F, Q, strict=True):
        A, N = np.eye(len(P)), np.zeros(P.shape)
        A[:3, :3], N[:3, :3] = step, noise
        P = A @ P @ A.T + N
    return P


def by_one_matrix(Phi1, Psi1, theta1, Phi2, Psi2, theta2):
    """Another right answer: Psi and theta side by side."""
    second = Phi1.T @ np.column_stack([Psi2 @ Phi1, theta2])
    return [Phi2 @ Phi1, second[:, :-1] + Psi1, second[:, -1] + theta1]


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
        (ch.check_door_width, along_the_door),
        (ch.check_predict_cov, step_by_step),
        (ch.check_predict_cov, by_stripes),
        (ch.check_joined, by_one_matrix),
        (ch.check_leaked, by_the_jacobians),
        (ch.check_update, by_information),
        (ch.check_slam, by_whole_matrices),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def test_whole_products_fail_at_an_infinite_variance_only():
    report = ch.check_predict_cov(by_whole_products)
    assert [row.name for row in report.rows if not row.ok] == [
        "a landmark that is not seen yet: its variance stays infinite"
    ]
    assert "as large as the map" in report.messages[0]


def test_each_bug_of_the_hunt_shows_in_its_picture():
    """The one in H in the heading's sigma, the one in the innovation after four posts."""
    updates = ch.update, ch._with_leak, ch._with_old_pose
    right, leak, old = (ch._four_posts(update) for update in updates)
    assert right < 1
    assert leak < 1
    assert old > 8
    ends = []
    for update in updates:
        ax = ch.check_update.draw(update).axes[0]
        ends.append(ax.lines[0].get_ydata()[-1])
    assert abs(ends[0] - 10) < 1e-6
    assert ends[1] < 8
    assert abs(ends[2] - 10) < 1e-6


def test_each_repair_of_the_hunt_moves_the_score():
    held = [ch.check_update(f).held for f in (ch._with_both, ch._with_leak, ch._with_old_pose)]
    assert held[1] == held[2] == held[0] + 1


def test_the_picture_counts_what_a_prediction_costs():
    """The map once, a strip in each step, or the whole map twice in each."""
    answers = ch.predict_cov, step_by_step, by_whole_products
    once, strips, whole = (ch._multiplications(answer) for answer in answers)
    assert once == 9 * 200 + 20 * (27 + 54)
    assert strips == 20 * (9 * 200 + 54)
    assert whole == 20 * 2 * 203**3


def test_the_corner_alone_is_no_covariance():
    def corner(P, F, Q):
        P = P.copy()
        P[:3, :3] = ch.predict_cov(P[:3, :3], F, Q)
        return P

    titles = [ax.get_title(loc="left") for ax in ch.check_predict_cov.draw(corner).axes]
    assert "eigenvalue -" in titles[0]
    assert "eigenvalue +" in titles[1]


def test_joined_accounts_are_those_of_the_whole_filter():
    """The far landmarks are nearer in 18 of 20 drives, and as far off as is reported."""
    off, scores = [], []
    for seed in range(20):
        _, error, moved, cov = ch._day(ch.joined, seed)
        e = error - moved
        off.append((np.abs(error).mean(), np.abs(e).mean()))
        if off[-1][1] > off[-1][0]:  # the page: it began nearer than the covariance expects
            assert error @ error < np.trace(cov)
        scores.append(e @ np.linalg.solve(cov, e) / len(e))
    assert sum(after < before for before, after in off) >= 17
    assert 0.7 < np.mean(scores) < 1.4


def test_one_observation_halves_the_sigma_that_the_standing_filter_reports():
    """As the page of solutions says of its picture."""
    reported = np.array(ch._standing_robot()[3])
    assert 0.45 < (reported[1:] / reported[:-1])[3:].min() < 0.55


def test_the_sum_is_a_limit_of_what_the_standing_filter_reports():
    d, D, R, reported = ch._standing_robot()
    for k in range(3, 101):
        limit = 1 / np.sqrt(1 / np.deg2rad(10) ** 2 + ch.leaked(d[:k], D[:k], R))
        assert reported[k - 1] >= np.rad2deg(limit) - 1e-6
