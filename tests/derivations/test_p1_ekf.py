"""P1 (1)-(8) and (18)-(43): each formula of EKF-SLAM against its derivation, beside wrong forms.

The oracles are sympy, central differences of the whole state, and the density of a joint
Gaussian; none of them knows the filter. The wheel formulas (9)-(17) are in test_p1_kinematics.
"""

import numpy as np
import pytest
import sympy as sp

from slamlab.geometry import compose, rotation, transform, wrap_angle
from slamlab.printed import p1 as printed
from slamlab.robots import YOUBOT
from slamlab.sensors import RangeBearing, Wall
from slamlab.slam import EKFSlam

L = 0.3
SENSOR = RangeBearing(0.05, 0.02, offset=L)
ARGUMENTS = (0.05, 0.02, L)
V, DT, U = YOUBOT.control_cov(2.0), 0.1, np.array([0.5, -0.2, 0.4])
rng = np.random.default_rng(11)


def some_slam(n=4, seed=1, sensor=SENSOR):
    """A filter in the middle of its life: everything uncertain, everything correlated."""
    rng = np.random.default_rng(seed)
    root = 0.05 * rng.standard_normal((3 + 2 * n, 3 + 2 * n))
    pose, angles = np.array([1.0, -2.0, 2.5]), rng.uniform(-np.pi, np.pi, n)
    there = pose[:2] + 3 * np.stack([np.cos(angles), np.sin(angles)], 1)
    return EKFSlam(
        YOUBOT, sensor, np.concatenate([pose, there.ravel()]), root @ root.T, ids=range(n)
    )


def step(slam, z, ids):
    slam.predict(U, DT, V)
    slam.update(z, ids)


def seen(slam, rows, seed=2):
    rng = np.random.default_rng(seed)
    z = slam.sensor.observe(slam.pose, slam.landmarks[rows])
    return z + rng.standard_normal(z.shape) * [0.05, 0.02]


def numerical(f, x, step=1e-6):
    """Central differences of f at x, one column a coordinate; a bearing may wrap between them."""
    columns = []
    for d in np.eye(len(x)) * step:
        difference = f(x + d) - f(x - d)
        difference[1::2] = wrap_angle(difference[1::2])
        columns.append(difference / (2 * step))
    return np.stack(columns, -1)


def whole_h(sensor, rows):
    """The measurement of landmarks `rows` as a function of the whole state, P1 (4) to (20)."""
    return lambda x: sensor.observe(x[:3], x[3:].reshape(-1, 2)[rows]).ravel()


def whole_H(slam, rows):
    """Derivative of `whole_h` by differences, (2m, 3 + 2n): no formula of the paper in it."""
    return numerical(whole_h(SENSOR, rows), slam.mean.copy())


def conditioned(mean, P, H, R, v):
    """Posterior of x given v = H (x - mean) + noise, from the information form."""
    W = np.linalg.inv(P) + H.T @ np.linalg.solve(R, H)
    cov = np.linalg.inv(W)
    return mean + cov @ H.T @ np.linalg.solve(R, v), cov


# (1)-(8): the state.


def test_1_to_4_the_state_is_the_pose_then_two_numbers_a_landmark():
    slam = EKFSlam(YOUBOT, SENSOR, [0.1, 0.2, 0.3])
    slam.update([[2.0, 0.5], [3.0, -1.0]], ["a", "b"])
    a, b = SENSOR.locate([0.1, 0.2, 0.3], [[2.0, 0.5], [3.0, -1.0]])
    np.testing.assert_allclose(slam.mean, [0.1, 0.2, 0.3, *a, *b])
    assert len(slam.mean) == 3 + 2 * 2


def test_5_off_diagonals_are_covariances_and_may_be_negative():
    slam = EKFSlam(YOUBOT, SENSOR, [0, 0, -0.7])
    for _ in range(20):
        slam.predict([0.5, 0, 0], DT, np.diag([0.04, 0, 0.01]))
    # Driving south-east, the forward error moves x up and y down: no square is negative.
    assert slam.pose_cov[0, 1] < 0


def test_6_the_landmark_covariance_is_2n_by_2n():
    slam = some_slam(n=4)
    assert slam.cov[3:, 3:].shape == (8, 8)
    # The printed n x n would leave out a coordinate of every landmark.
    assert slam.cov[3:, 3:].shape != (4, 4)


def test_7_and_43_the_blocks_of_P_are_pose_ties_and_map():
    slam, before = some_slam(3), some_slam(3)
    slam.update([[4.0, 1.0]], ["new"])
    P_p, P_po, P_o = before.cov[:3, :3], before.cov[:3, 3:], before.cov[3:, 3:]
    G, G_z = (numerical(f, x) for f, x in both_ways(before.pose, np.array([4.0, 1.0])))
    due = np.block(
        [
            [P_p, P_po, P_p @ G.T],
            [P_po.T, P_o, P_po.T @ G.T],
            [G @ P_p, G @ P_po, G @ P_p @ G.T + G_z @ SENSOR.cov @ G_z.T],
        ]
    )
    np.testing.assert_allclose(slam.cov, due, rtol=1e-7, atol=1e-10)
    # Without its ties to the old landmarks the new one is another belief ...
    untied = due.copy()
    untied[9:, 3:9] = untied[3:9, 9:] = 0
    assert np.abs(untied - slam.cov).max() > 1e-4
    # ... and P4's (4c), read as its text stands, multiplies a 2 x 2 by a 6 x 6.
    with pytest.raises(ValueError, match="matmul"):
        G_z @ P_o


def both_ways(pose, z):
    yield (lambda x: SENSOR.locate(x, z)), np.array(pose)
    yield (lambda x: SENSOR.locate(pose, x)), np.array(z)


def test_8_prediction_moves_the_pose_and_no_landmark():
    slam, before = some_slam(), some_slam()
    slam.predict(U, DT, V)
    np.testing.assert_array_equal(slam.mean[3:], before.mean[3:])
    np.testing.assert_array_equal(slam.cov[3:, 3:], before.cov[3:, 3:])
    np.testing.assert_allclose(slam.pose, YOUBOT.step(before.pose, U, DT))


def test_5_text_zero_initial_covariance_breaks_nothing():
    slam = EKFSlam(YOUBOT, SENSOR, [0, 0, 0, 2, 1], np.zeros((5, 5)), ids=["a"])
    innovation = slam.update([[2.1, 0.6]], ["a"])
    # What is inverted is S = H 0 H^T + R = R.
    np.testing.assert_allclose(innovation.S, SENSOR.cov)
    np.testing.assert_array_equal(slam.cov, np.zeros((5, 5)))
    # The matrix that the paper fears for cannot be inverted, and never is.
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.inv(slam.cov)


def test_5_text_a_positive_initial_covariance_is_a_floor_for_the_map():
    pose_cov = np.diag([0.04, 0.04, 0.01])
    slam = EKFSlam(YOUBOT, SENSOR, [0, 0, 0], pose_cov)
    fixed = EKFSlam(YOUBOT, SENSOR, [0, 0, 0])
    for _ in range(500):
        for one in (slam, fixed):
            one.update([[3.0, 0.4]], ["a"])
    assert fixed.landmark_cov("a").max() < 1e-4
    # Position 0.04 and heading 0.01 x 3.27^2 of lever stay for ever.
    assert slam.landmark_cov("a").diagonal().min() > 0.04
    np.testing.assert_allclose(slam.pose_cov, pose_cov, rtol=1e-6, atol=1e-15)


# (18)-(32): what is measured, and its derivatives.


def symbols():
    names = "x_p y_p theta x_o y_o rho phi"
    return sp.symbols(names, real=True), sp.Symbol("L", positive=True)


def repaired_h():
    """(18): polar coordinates of the landmark in the frame of the sensor, by rotation alone."""
    (x_p, y_p, theta, x_o, y_o, _, _), lever = symbols()
    turn = sp.Matrix([[sp.cos(theta), sp.sin(theta)], [-sp.sin(theta), sp.cos(theta)]])
    ahead, left = turn * sp.Matrix([x_o - x_p, y_o - y_p]) - sp.Matrix([lever, 0])
    return sp.Matrix([sp.sqrt(ahead**2 + left**2), sp.atan2(left, ahead)])


def compiled(expression):
    arguments, lever = symbols()
    return sp.lambdify([*arguments, lever], expression, "numpy")


def places(count=40):
    """Poses, and landmarks all around them."""
    poses = np.column_stack([rng.uniform(-5, 5, (count, 2)), rng.uniform(-np.pi, np.pi, count)])
    angles = np.linspace(-np.pi, np.pi, count, endpoint=False) + 0.01
    distance = rng.uniform(1, 6, count)
    local = np.stack([distance * np.cos(angles), distance * np.sin(angles)], -1)
    return poses, transform(poses, local[:, None])[:, 0]


POSES, LANDMARKS = places()


def test_18_is_polar_coordinates_in_the_frame_of_the_sensor():
    h = compiled(repaired_h())
    for pose, landmark in zip(POSES, LANDMARKS, strict=True):
        due = h(*pose, *landmark, 0, 0, L).ravel()
        np.testing.assert_allclose(
            SENSOR.residual(SENSOR.observe(pose, landmark), due), 0, atol=1e-12
        )


@pytest.mark.parametrize("wrong", [printed.BearingAsPrinted, printed.BearingWithoutQuadrant])
def test_18_as_printed_contradicts_38(wrong):
    # Without a quadrant every second bearing is half a turn off: 400 of them, to be sure of it.
    poses, z = places(400)[0], np.stack([np.full(400, 3.0), np.linspace(-3.1, 3.1, 400)], -1)
    again = SENSOR.observe(poses, SENSOR.locate(poses, z))
    np.testing.assert_allclose(SENSOR.residual(again, z), 0, atol=1e-12)
    off = SENSOR.residual(wrong(*ARGUMENTS).observe(poses, SENSOR.locate(poses, z)), z)
    assert (np.abs(off[:, 1]) > 0.1).mean() > 0.4


def test_18_to_30_h_of_g_is_z_in_all_quadrants():
    for offset in (0.0, 0.3, 1.5):
        sensor = RangeBearing(0.05, 0.02, offset=offset)
        bearing = np.linspace(-np.pi, np.pi, 64, endpoint=False) + 0.02
        z = np.stack([np.linspace(0.2, 20, 64), bearing], -1)
        for pose in POSES:
            error = sensor.residual(sensor.observe(pose, sensor.locate(pose, z)), z)
            np.testing.assert_allclose(error, 0, atol=1e-12)


def test_19_the_innovation_is_wrapped_and_lives_in_the_measurement():
    slam, other = some_slam(), some_slam()
    z = seen(slam, [2])
    first = slam.update(z, [2])
    second = other.update(z + [0, 2 * np.pi], [2])
    np.testing.assert_allclose(first.innovation, second.innovation, atol=1e-12)
    np.testing.assert_allclose(slam.mean, other.mean, atol=1e-12)
    # "Difference between predicted and actual position": it has two numbers, not three.
    assert first.innovation.shape == (2,)
    # Not wrapped, a full turn throws the estimate metres away.
    raw = other.mean + first.gain @ (first.innovation + [0, 2 * np.pi])
    assert np.abs(raw - slam.mean).max() > 1.0


def test_20_21_R_is_the_spread_of_the_measurements():
    rng = np.random.default_rng(4)
    z = np.array([SENSOR.measure([0, 0, 0], [[2.0, 1.0]], rng)[0][0] for _ in range(4_000)])
    np.testing.assert_allclose(
        np.cov(z.T) / np.sqrt(np.outer(*[SENSOR.cov.diagonal()] * 2)), np.eye(2), atol=0.05
    )


def test_22_23_H_is_zero_but_for_the_pose_and_the_landmark():
    slam = some_slam()
    H = whole_H(slam, [2])
    H_pose, H_landmark = SENSOR.jacobians(slam.pose, slam.landmarks[2])
    np.testing.assert_allclose(H[:, :3], H_pose, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(H[:, 7:9], H_landmark, rtol=1e-7, atol=1e-9)
    assert not np.delete(H, [0, 1, 2, 7, 8], 1).any()


def repaired_entries():
    """A to F of (24)-(29) as the errata give them, d = S - X_o and p = X_p - X_o."""
    (x_p, y_p, theta, x_o, y_o, _, _), lever = symbols()
    c, s = sp.cos(theta), sp.sin(theta)
    p_x, p_y = x_p - x_o, y_p - y_o
    d_x, d_y = p_x + lever * c, p_y + lever * s
    rho = sp.sqrt(d_x**2 + d_y**2)
    E = lever * (p_y * c - p_x * s) / rho
    F = lever * (p_x * c + p_y * s + lever) / rho**2 - 1
    return sp.Matrix([[d_x / rho, d_y / rho, E], [-d_y / rho**2, d_x / rho**2, F]])


def test_24_to_32_repaired_are_the_derivatives_symbolically():
    arguments, _ = symbols()
    h = repaired_h()
    by_pose, by_landmark = (
        compiled(h.jacobian(sp.Matrix(part))) for part in (arguments[:3], arguments[3:5])
    )
    entries = compiled(repaired_entries())
    for pose, landmark in zip(POSES, LANDMARKS, strict=True):
        numbers = (*pose, *landmark, 0, 0, L)
        H_pose, H_landmark = SENSOR.jacobians(pose, landmark)
        for ours in (H_pose, entries(*numbers)):
            np.testing.assert_allclose(ours, by_pose(*numbers), rtol=1e-7, atol=1e-12)
        # (31), (32): minus the position block.
        for ours in (H_landmark, -entries(*numbers)[:, :2]):
            np.testing.assert_allclose(ours, by_landmark(*numbers), rtol=1e-7, atol=1e-12)


def test_31_32_are_as_wrong_as_the_C_and_D_in_them():
    _, wrong = printed.LeverlessBearingSlopes(*ARGUMENTS).jacobians(POSES, LANDMARKS)
    _, right = SENSOR.jacobians(POSES, LANDMARKS)
    assert np.abs(wrong - right)[:, 1].max() > 0.01
    assert np.abs(wrong - right)[:, 0].max() == 0


# What each printed class gets wrong, and nothing else: rows and columns of H_pose.
PRINTED_SLOPES = {
    printed.LeverlessBearingSlopes: [(1, 0), (1, 1), (1, 2)],
    printed.LeverlessBearingSlopesWorst: [(1, 0), (1, 1), (1, 2)],
    printed.LeverlessRangeSlope: [(0, 2)],
}


@pytest.mark.parametrize("wrong", PRINTED_SLOPES)
def test_26_to_29_as_printed_are_no_derivatives(wrong):
    H_pose, _ = wrong(*ARGUMENTS).jacobians(POSES, LANDMARKS)
    off = np.zeros((2, 3))
    for H, pose, landmark in zip(H_pose, POSES, LANDMARKS, strict=True):
        due = numerical(lambda x, m=landmark: SENSOR.observe(x, m), pose)
        off = np.maximum(off, np.abs(H - due))
    is_wrong = np.zeros((2, 3), dtype=bool)
    is_wrong[tuple(zip(*PRINTED_SLOPES[wrong], strict=True))] = True
    assert (off[is_wrong] > 0.01).all()
    assert (off[~is_wrong] < 1e-7).all()


def test_26_27_29_as_printed_are_right_without_a_lever():
    flat = RangeBearing(0.05, 0.02)
    due = flat.jacobians(POSES, LANDMARKS)[0]
    kind = printed.LeverlessBearingSlopes(0.05, 0.02).jacobians(POSES, LANDMARKS)[0]
    np.testing.assert_allclose(kind, due, atol=1e-12)


# (33)-(36): the correction.


def test_33_to_36_condition_the_joint_gaussian():
    slam, rows = some_slam(), [1, 3]
    H, R, z = whole_H(slam, rows), np.kron(np.eye(2), SENSOR.cov), seen(slam, rows)
    mean, P = slam.mean.copy(), slam.cov.copy()
    v = SENSOR.residual(z, SENSOR.observe(slam.pose, slam.landmarks[rows])).ravel()
    due_mean, due_cov = conditioned(mean, P, H, R, v)
    innovation = slam.update(z, rows)
    np.testing.assert_allclose(slam.mean, due_mean, atol=1e-8)
    np.testing.assert_allclose(slam.cov, due_cov, atol=1e-9)
    # (33), (34)
    S, K = innovation.S, innovation.gain
    np.testing.assert_allclose(S, H @ P @ H.T + R, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(K, P @ H.T @ np.linalg.inv(S), atol=1e-8)
    # (36) equals Joseph's form and the short form, for this gain ...
    I_KH = np.eye(len(P)) - K @ H
    np.testing.assert_allclose(slam.cov, I_KH @ P @ I_KH.T + K @ R @ K.T, atol=1e-9)
    np.testing.assert_allclose(slam.cov, I_KH @ P, atol=1e-9)
    # ... and for no other: half the gain gives Joseph a covariance that (36) denies.
    half = np.eye(len(P)) - 0.5 * K @ H
    joseph = half @ P @ half.T + 0.25 * K @ R @ K.T
    assert np.abs(joseph - (P - 0.25 * K @ S @ K.T)).max() > 1e-4
    # Forms that a slip gives: the sign of (36), S without R.
    assert np.abs(P + K @ S @ K.T - due_cov).max() > 1e-4
    assert np.abs(P - K @ (S - R) @ K.T - due_cov).max() > 1e-6


def test_35_the_heading_stays_in_one_turn():
    start, landmark = np.array([0.0, 0.0, 3.13]), np.array([-3.0, 0.5])
    P = np.diag([1e-6, 1e-6, 0.04, 1e-6, 1e-6])
    slam = EKFSlam(YOUBOT, SENSOR, [*start, *landmark], P, ids=[0])
    z = SENSOR.observe(start + [0, 0, 0.1], landmark)
    innovation = slam.update(z[None], [0])
    plain = start[2] + (innovation.gain @ innovation.innovation)[2]
    assert plain > np.pi  # (35) to the letter
    assert abs(slam.pose[2] - (plain - 2 * np.pi)) < 1e-12
    assert abs(slam.pose[2] - (3.23 - 2 * np.pi)) < 0.01
    assert abs(EKFSlam(YOUBOT, SENSOR, [0, 0, 4.0]).pose[2] - (4.0 - 2 * np.pi)) < 1e-12


def test_34_as_printed_adds_what_cannot_be_added():
    slam = some_slam()
    H = whole_H(slam, [1])
    S = H @ slam.cov @ H.T + SENSOR.cov
    with pytest.raises(ValueError, match="broadcast"):
        printed.gain_as_printed(slam.cov, H, S, SENSOR.cov)


def test_16_to_36_text_prediction_belongs_to_the_step_not_to_the_landmark():
    once, for_each = some_slam(), some_slam()
    z = seen(once, [0, 1, 2])
    once.predict(U, DT, V)
    for k in range(3):  # the same updates, one landmark after the other; only Q comes thrice
        for_each.predict(U if k == 0 else 0 * U, DT, V)
        for_each.update(z[k : k + 1], [k])
        once.update(z[k : k + 1], [k])
    assert np.linalg.det(for_each.pose_cov) > 1.1 * np.linalg.det(once.pose_cov)


def test_16_to_36_one_block_equals_one_landmark_after_the_other_if_linear():
    """Exact for frozen Jacobians; relinearising between landmarks makes a small difference."""
    slam, rows = some_slam(), [0, 2, 3]
    H, R, z = whole_H(slam, rows), SENSOR.cov, seen(slam, rows)
    v = SENSOR.residual(z, SENSOR.observe(slam.pose, slam.landmarks[rows])).ravel()
    mean, P = slam.mean.copy(), slam.cov.copy()
    change = np.zeros_like(mean)
    for k in range(3):
        part = slice(2 * k, 2 * k + 2)
        K = P @ H[part].T @ np.linalg.inv(H[part] @ P @ H[part].T + R)
        change += K @ (v[part] - H[part] @ change)
        P = P - K @ H[part] @ P
    sequential = some_slam()
    for k, row in enumerate(rows):
        sequential.update(z[k : k + 1], [row])
    slam.update(z, rows)
    np.testing.assert_allclose(slam.mean, mean + change, atol=1e-8)
    np.testing.assert_allclose(slam.cov, P, atol=1e-9)
    assert np.abs(sequential.mean - slam.mean).max() > 1e-6


# (37)-(43): a new landmark.


def test_37_38_a_new_landmark_stands_where_the_beam_ends():
    slam = some_slam()
    pose = slam.pose.copy()
    slam.update([[4.0, -2.0]], ["new"])
    sensor_position = pose[:2] + L * np.array([np.cos(pose[2]), np.sin(pose[2])])
    beam = 4.0 * np.array([np.cos(pose[2] - 2.0), np.sin(pose[2] - 2.0)])
    np.testing.assert_allclose(slam.landmarks[-1], sensor_position + beam)
    np.testing.assert_allclose(slam.mean[-2:], slam.landmarks[-1])


def located():
    """(38) as a formula."""
    (x_p, y_p, theta, _, _, rho, phi), lever = symbols()
    x = x_p + lever * sp.cos(theta) + rho * sp.cos(phi + theta)
    y = y_p + lever * sp.sin(theta) + rho * sp.sin(phi + theta)
    return sp.Matrix([x, y])


def test_39_to_42_are_the_derivatives_of_38_and_41_as_printed_is_not():
    arguments, lever = symbols()
    theta, rho, phi = arguments[2], *arguments[5:]
    by_pose = located().jacobian(sp.Matrix(arguments[:3]))
    by_z = located().jacobian(sp.Matrix(arguments[5:]))
    beam = phi + theta
    # (42) as printed
    due = [[sp.cos(beam), -rho * sp.sin(beam)], [sp.sin(beam), rho * sp.cos(beam)]]
    assert by_z == sp.Matrix(due)
    # (41) lacks the beam, which is the larger part: rho is metres, L is not.
    as_printed = sp.Matrix([[1, 0, -lever * sp.sin(theta)], [0, 1, lever * sp.cos(theta)]])
    missing = sp.Matrix([[0, 0, -rho * sp.sin(beam)], [0, 0, rho * sp.cos(beam)]])
    assert sp.simplify(by_pose - as_printed - missing) == sp.zeros(2, 3)
    G_pose, G_z = compiled(by_pose), compiled(by_z)
    z = np.column_stack([rng.uniform(0.5, 6, 40), rng.uniform(-np.pi, np.pi, 40)])
    ours, wrong = SENSOR.locate_jacobians(POSES, z), printed.BeamlessLocate(*ARGUMENTS)
    for k, pose in enumerate(POSES):
        numbers = (*pose, 0, 0, *z[k], L)
        np.testing.assert_allclose(ours[0][k], G_pose(*numbers), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(ours[1][k], G_z(*numbers), rtol=1e-12, atol=1e-12)
    off = np.abs(wrong.locate_jacobians(POSES, z)[0] - ours[0])
    assert off[..., :2].max() == 0
    np.testing.assert_allclose(np.hypot(*off[..., 2].T), z[:, 0])


def test_43_a_positive_covariance_does_not_prove_41_right():
    wrong = some_slam(sensor=printed.BeamlessLocate(*ARGUMENTS))
    right = some_slam()
    for slam in (wrong, right):
        slam.update([[5.0, 1.0]], ["new"])
        assert np.linalg.eigvalsh(slam.cov)[0] > 0
    assert np.trace(wrong.landmark_cov("new")) < 0.8 * np.trace(right.landmark_cov("new"))


# Symmetries: what no formula of the paper says, and every right one obeys.


def gauge(mean):
    """Two translations and the rotation of the whole world, (3 + 2n, 3)."""
    vectors = np.zeros((len(mean), 3))
    vectors[[0, *range(3, len(mean), 2)], 0] = 1
    vectors[[1, *range(4, len(mean), 2)], 1] = 1
    vectors[:2, 2] = -mean[1], mean[0]
    vectors[2, 2] = 1
    vectors[3::2, 2], vectors[4::2, 2] = -mean[4::2], mean[3::2]
    return vectors


def sparse_H(sensor, mean, rows):
    H = np.zeros((2 * len(rows), len(mean)))
    H_pose, H_landmark = sensor.jacobians(mean[:3], mean[3:].reshape(-1, 2)[rows])
    for k, row in enumerate(rows):
        H[2 * k : 2 * k + 2, :3] = H_pose[k]
        H[2 * k : 2 * k + 2, 3 + 2 * row : 5 + 2 * row] = H_landmark[k]
    return H


def test_moving_the_whole_world_is_in_the_null_space_of_H():
    mean, rows = some_slam().mean.copy(), [0, 1, 2, 3]
    assert np.abs(sparse_H(SENSOR, mean, rows) @ gauge(mean)).max() < 1e-10
    for wrong in PRINTED_SLOPES:
        assert np.abs(sparse_H(wrong(*ARGUMENTS), mean, rows) @ gauge(mean)).max() > 0.01


def test_moving_the_whole_world_of_walls_is_in_the_null_space_of_H():
    walls = np.array([[5.0, 0.3], [4.0, 2.0], [3.0, -2.5]])
    mean, alpha = np.concatenate([[0.5, -0.7, 1.1], walls.ravel()]), walls[:, 1]
    vectors = np.zeros((9, 3))
    vectors[0, 0] = vectors[1, 1] = vectors[2, 2] = 1
    vectors[3::2, 0], vectors[3::2, 1] = np.cos(alpha), np.sin(alpha)
    vectors[:2, 2], vectors[4::2, 2] = [0.7, 0.5], 1
    H = sparse_H(Wall(0.05, 0.02, offset=L), mean, [0, 1, 2])
    assert np.abs(H @ vectors).max() < 1e-10
    assert np.abs(sparse_H(SENSOR, mean, [0, 1, 2]) @ vectors).max() > 0.1


def moved_world(slam, g):
    """The same belief in a world moved by the pose g."""
    mean = np.concatenate([compose(g, slam.pose), transform(g, slam.landmarks).ravel()])
    J = np.zeros((len(mean), len(mean)))
    J[2, 2] = 1
    for i in (0, *range(3, len(mean), 2)):
        J[i : i + 2, i : i + 2] = rotation(g[2])
    return EKFSlam(YOUBOT, slam.sensor, mean, J @ slam.cov @ J.T, slam.ids)


@pytest.mark.parametrize("sensor", [SENSOR, printed.BearingAsPrinted(*ARGUMENTS)])
def test_a_moved_world_gives_the_moved_posterior(sensor):
    g = np.array([3.0, -7.0, 2.2])
    slam = some_slam(sensor=sensor)
    moved, z = moved_world(slam, g), seen(some_slam(), [0, 2])
    for one in (slam, moved):
        step(one, np.vstack([z, [[3.0, 0.5]]]), [0, 2, "new"])
    due = moved_world(slam, g)
    off = np.abs(SENSOR.residual(moved.mean[1:3], due.mean[1:3])).max()
    off = max(off, np.abs(moved.mean[3:] - due.mean[3:]).max(), np.abs(moved.cov - due.cov).max())
    # (18) as printed prefers some directions of the compass.
    assert off < 1e-10 if sensor is SENSOR else off > 0.01


def test_renaming_landmarks_commutes_with_the_step():
    slam, order = some_slam(), [2, 0, 3, 1]
    entries = np.r_[0:3, (3 + 2 * np.array(order)[:, None] + [0, 1]).ravel()]
    other = EKFSlam(YOUBOT, SENSOR, slam.mean[entries], slam.cov[np.ix_(entries, entries)], order)
    z = np.vstack([seen(slam, [0, 1, 3]), [[3.0, 0.5]]])
    step(slam, z, [0, 1, 3, "new"])
    step(other, z[[2, 3, 0, 1]], [3, "new", 0, 1])
    entries = np.r_[entries, 11, 12]
    np.testing.assert_allclose(other.mean, slam.mean[entries], atol=1e-12)
    np.testing.assert_allclose(other.cov, slam.cov[np.ix_(entries, entries)], atol=1e-12)
    # A filter that loses track of which row is which is caught by this.
    assert np.abs(other.mean - slam.mean).max() > 0.1


def test_a_full_turn_of_heading_or_bearing_changes_nothing():
    z = np.vstack([seen(some_slam(), [0, 1]), [[3.0, 0.5]]])
    slam, turned = some_slam(), some_slam()
    mean = turned.mean + np.eye(11)[2] * 2 * np.pi
    turned = EKFSlam(YOUBOT, SENSOR, mean, turned.cov, turned.ids)
    step(slam, z, [0, 1, "new"])
    step(turned, z - [0, 2 * np.pi], [0, 1, "new"])
    np.testing.assert_allclose(turned.mean, slam.mean, atol=1e-12)
    np.testing.assert_allclose(turned.cov, slam.cov, atol=1e-12)
