"""Right answers of chapter 00, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.exercises import ch00_slam_in_ten_minutes as ch
from slamlab.slam import PoseGraph


def matrix(p):
    c, s = np.cos(p[2]), np.sin(p[2])
    return np.array([[c, -s, p[0]], [s, c, p[1]], [0, 0, 1]])


def pose(T):
    return [T[0, 2], T[1, 2], np.arctan2(T[1, 0], T[0, 0])]


def by_matrices(known, k, odometry):
    """Another right answer: homogeneous matrices, and lists instead of arrays."""
    poses = [matrix(known)]
    for motion in odometry[k:]:
        poses.append(poses[-1] @ matrix(motion))
    for motion in odometry[:k][::-1]:
        poses.insert(0, poses[0] @ np.linalg.inv(matrix(motion)))
    return [pose(T) for T in poses]


def walking_both_ways(known, k, odometry):
    """Another right answer: inverses of the motions, back from the known pose."""
    return ch._walked(ch._back)(known, k, odometry)


def mounted_by_matrices(pose_i, pose_j, z, mount):
    """Another right answer: the edge of the robot that z amounts to, and then its scanner."""
    A, B, Z, M = map(matrix, (pose_i, pose_j, z, mount))
    return pose(np.linalg.inv(A @ M @ Z) @ B @ M)


def by_the_formula(pose_i, pose_j, z, mount):
    """Another right answer: (A) of the lesson, between two scanners."""
    scanners = [ch.compose(mount_of, mount) for mount_of in (pose_i, pose_j)]
    return by_steps(*scanners, z)


def by_steps(pose_i, pose_j, z):
    """The error of an edge: a plain list and the angle wrapped by arctan2."""
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


def lamp_by_complex_step(pose, lamp, mount):
    """Another right answer: complex steps through the error of a lamp."""
    columns = []
    for k in range(5):
        x = np.array([*pose, *lamp], dtype=complex)
        x[k] += 1e-30j
        (dx, dy), c, s = x[3:] - x[:2], np.cos(x[2]), np.sin(x[2])
        u, v = c * dx + s * dy - mount[0], c * dy - s * dx - mount[1]
        c, s = np.cos(mount[2]), np.sin(mount[2])
        columns.append([(c * u + s * v).imag / 1e-30, (c * v - s * u).imag / 1e-30])
    return np.array(columns).T.tolist()


def lamp_by_finite_differences(pose, lamp, mount):
    """Another right answer: the student's own test, handed in."""

    def error(x):
        camera = ch.compose(x[:3], mount)
        return ch.rotation(camera[2]).T @ (x[3:] - camera[:2])

    x = np.append(pose, lamp)
    columns = [(error(x + d) - error(x - d)) / 2e-6 for d in 1e-6 * np.eye(5)]
    return np.column_stack(columns)


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


def by_other_steps(start, odometry, omega, closures, z, omega_closure):
    """Another right answer: steps by square roots, a while loop, chi2 by the library."""
    n, m = len(odometry), len(closures)
    pairs = [(k, k + 1) for k in range(n)] + [tuple(map(int, pair)) for pair in closures]
    weights = np.array([omega] * n + [omega_closure] * m)
    poses = np.array(by_matrices(start, 0, odometry))
    steps, moved = 0, np.inf
    while steps < 10 and moved > 1e-6:
        new = np.array(by_square_roots(poses, np.array(pairs), np.array([*odometry, *z]), weights))
        moved = np.linalg.norm((new - poses)[:, :2], axis=1).max()
        poses, steps = new, steps + 1
    return poses, PoseGraph(poses, pairs, [*odometry, *z], weights).chi2()


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_path_through, by_matrices),
        (ch.check_path_through, walking_both_ways),
        (ch.check_edge_error, mounted_by_matrices),
        (ch.check_edge_error, by_the_formula),
        (ch.check_lamp_jacobian, lamp_by_complex_step),
        (ch.check_lamp_jacobian, lamp_by_finite_differences),
        (ch.check_relax, by_square_roots),
        (ch.check_slam, by_other_steps),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


BUGS = {"first": ch._IN_BODY, "second": ch._OVERWRITTEN, "both": ch._OVERWRITTEN + ch._IN_BODY}


@pytest.mark.parametrize("bugs", BUGS.values(), ids=BUGS)
def test_a_bug_that_is_left_in_relax_is_named(bugs):
    report = ch.check_slam.judge(ch.check_slam.observe(ch._slam_with(10, *bugs)))
    assert report.messages[0].startswith("your `relax` still has")


def lap(step, n):
    """Mean distance from the truth before and after each of n steps of the picture's lap."""
    truth, odometry, pairs, z = ch._loop()
    poses = ch.path_through(np.zeros(3), 0, odometry)
    edges = np.vstack([np.column_stack([np.arange(16), np.arange(16) + 1]), pairs])
    omega = np.array([np.diag([100.0, 100.0, 400.0])] * 16 + [1e4 * np.eye(3)] * 3)
    off = []
    for _ in range(n + 1):
        off.append(np.hypot(*(poses - truth)[:, :2].T).mean())
        poses = step(poses, edges, np.vstack([odometry, z]), omega)
    return off


@pytest.mark.parametrize("bugs", BUGS.values(), ids=BUGS)
def test_each_bug_alone_spoils_the_lap_and_passes_on_the_bench(bugs):
    wrong = ch.check_relax.mistaken(bugs)
    assert lap(ch.relax, 3)[-1] < 0.05
    assert min(lap(wrong, 3)[1:]) > lap(wrong, 0)[0]
    held = {row.name: row.ok for row in ch.check_relax.judge(ch.check_relax.observe(wrong)).rows}
    assert held["on the bench"]
    assert held["graph B"] == (bugs == BUGS["second"])
    assert held["graph D"] == (bugs == BUGS["first"])


def test_both_bugs_make_each_step_worse():
    off = lap(ch.check_relax.mistaken(BUGS["both"]), 3)
    assert off == sorted(off)


@pytest.mark.parametrize("bugs", BUGS.values(), ids=BUGS)
def test_a_town_that_flies_apart_is_drawn_with_its_numbers(bugs):
    left, _ = ch.check_slam.draw(ch._slam_with(10, *bugs)).axes
    assert not left.texts
    assert left.get_title(loc="left").count("→") == 2


def test_the_town_is_at_rest_before_the_tenth_step():
    truth, *given = ch._town()
    poses, chi2 = ch.slam(*given)
    again = ch.relax(
        poses,
        np.vstack([np.column_stack([np.arange(119), np.arange(119) + 1]), given[3]]),
        np.vstack([given[1], given[4]]),
        np.array([given[2]] * 119 + [given[5]] * 41),
    )
    assert len(given[3]) == 41
    np.testing.assert_allclose(poses, again, atol=1e-6)
    assert np.hypot(*(poses - truth)[:, :2].T).mean() < 0.2
    assert ch._chi2(poses, given) == pytest.approx(chi2)
    before = ch.path_through(given[0], 0, given[1])
    assert (round(chi2, 1), round(ch._chi2(before, given))) == (115.6, 13091)


def test_all_rides_but_the_one_with_a_false_closure_are_at_rest_within_ten_steps():
    more = ch.check_slam.mistaken("range(10) => range(40)")
    for name, arguments in ch.check_slam.inputs:
        (a, x), (b, y) = ch.slam(*arguments), more(*arguments)
        if name.startswith("a false closure"):
            assert np.abs(a - b)[:, :2].max() > 1e-3
        else:
            np.testing.assert_allclose(a, b, atol=1e-12)
            assert x == pytest.approx(y, abs=1e-12)


def test_the_bench_passes_one_step_of_the_handed_out_program_and_no_second():
    _, (poses, *given) = next(iter(ch.check_relax.inputs))
    once = ch.check_relax.mistaken(BUGS["both"])(poses, *given)
    twice = ch.check_relax.mistaken(BUGS["both"])(once, *given)
    assert once[:, 0].round(3).tolist() == [0.0, 0.96, 1.92, 2.88, 3.84]
    assert twice[:, 0].round(3).tolist() == [0.0, 0.952, 1.904, 2.856, 3.808]
    np.testing.assert_allclose(ch.relax(once, *given), once, atol=1e-12)


def test_the_slam_of_the_exercise_maps_killian_court():
    reference, *given = ch.thinned_killian()
    assert (len(reference), len(given[3])) == (388, 257)
    figure = ch.draw_killian(ch.slam)
    mine, dead = (ax.get_title(loc="left") or ax.get_title() for ax in figure.axes)
    assert "0.4 m from" in mine
    assert "117 (771)" in mine
    assert "34.9 m from" in dead
    assert not figure.axes[0].texts


def test_a_closure_of_the_thinned_court_joins_two_poses():
    for every in (10, 20, 40):
        closures = ch.thinned_killian(every)[4]
        assert (closures[:, 0] != closures[:, 1]).all()


def test_killian_court_by_a_slam_that_flies_apart_is_drawn():
    left, _ = ch.draw_killian(lambda start, u, *rest: (np.full((len(u) + 1, 3), np.nan), 0)).axes
    assert not left.texts
    assert "flown apart" in (left.get_title(loc="left") or left.get_title())


def test_the_second_bug_is_further_off_for_four_steps_and_does_not_come_down_in_sixty():
    off = lap(ch.check_relax.mistaken(BUGS["second"]), 60)
    assert [one > off[0] for one in off[1:6]] == [True] * 4 + [False]
    assert round(off[60], 2) == 0.65
    assert round(lap(ch.relax, 60)[60], 2) == 0.02


@pytest.mark.parametrize(
    ("said", "edit"),
    [
        (
            "before the last step",
            "edge_error(poses[i], poses[j], => edge_error(before[i], before[j],",
        ),
        ("stopped too early", "1e-6 => 1e-3"),
        ("stopped too early", "1e-6 => 1e-4"),
    ],
)
def test_a_slam_that_ends_a_little_early_is_not_called_rounded(said, edit):
    report = ch.check_slam.judge(ch.check_slam.observe(ch.check_slam.mistaken(edit)))
    assert said in report.messages[0]


def test_the_motions_of_dead_reckoning_have_no_error_and_the_closures_have_all_of_it():
    _, *given = ch._town()
    before = ch.path_through(given[0], 0, given[1])
    assert len(given[1]) + len(given[3]) == 160
    np.testing.assert_allclose(np.diag(given[2]), [400, 400, 1 / 0.03**2])
    np.testing.assert_allclose(given[5], given[2])
    without = [*given[:3], given[3][:0], given[4][:0], given[5]]
    assert ch._chi2(before, tuple(without)) == pytest.approx(0.0, abs=1e-12)
    assert round(ch._chi2(before, tuple(given)) / 41) == 319
