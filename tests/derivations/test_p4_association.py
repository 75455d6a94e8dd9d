"""P4 (2a)-(4c), page 84: each formula against its derivation, beside the wrong forms.

The oracle writes state and measurement as linear maps of independent noises and conditions their
joint covariance by its inverse; the augmented covariance is the full map, multiplied out.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slamlab.geometry import tilt
from slamlab.robots import Unicycle
from slamlab.sensors import PointSensor, RangeBearing
from slamlab.slam import EKFSlam
from slamlab.slam.association import IGNORED, NEW, nearest_euclidean, nearest_neighbour

rng = np.random.default_rng(4)


def covariance(n, scale=1.0):
    root = rng.normal(size=(n, n))
    return scale * (root @ root.T + 0.1 * np.eye(n))


N, M = 9, 3
P, R, H = covariance(N), covariance(M, 0.3), rng.normal(size=(M, N))
X, Z = rng.normal(size=N), rng.normal(size=M)


def conditioned():
    """Mean and covariance of the state given the measurement, by the joint information."""
    joint = np.block([[P, P @ H.T], [H @ P, H @ P @ H.T + R]])
    W = np.linalg.inv(joint)
    posterior = np.linalg.inv(W[:N, :N])
    return X - posterior @ W[:N, N:] @ (Z - H @ X), posterior


def differs(a, b):
    return np.abs(np.asarray(a) - b).max() > 0.01


# --- (2a), (2b) ---


def test_2a_is_right_for_coordinates_and_a_bearing_must_be_wrapped():
    """Page 84 measures coordinates in the body frame, by (4a); no angle is subtracted."""
    point = PointSensor(0.01 * np.eye(2))
    pose, tree, z = np.array([1.0, 2.0, 3.1]), np.array([4.0, -1.0]), np.array([0.3, 0.2])
    turned = pose + [0, 0, 2 * np.pi]
    np.testing.assert_allclose(
        z - point.observe(pose, tree), z - point.observe(turned, tree), atol=1e-12
    )
    sensor = RangeBearing(0.1, 0.02)
    slam = EKFSlam(Unicycle(), sensor, [0, 0, 3.1])
    slam.update([[2.0, 0.05]], [0])
    z = np.array([[2.0, 0.05 - 2 * np.pi]])
    y = sensor.residual(z, sensor.observe(slam.pose, slam.landmarks))
    np.testing.assert_allclose(y, 0, atol=1e-12)
    printed = z - sensor.observe(slam.pose, slam.landmarks)
    assert np.abs(printed).max() > 6


def test_2b_is_the_spread_of_innovations():
    noise = rng.multivariate_normal(np.zeros(N), P, 200_000)
    y = noise @ H.T + rng.multivariate_normal(np.zeros(M), R, 200_000)
    J = H @ P @ H.T + R
    np.testing.assert_allclose(np.cov(y.T), J, atol=0.02 * np.abs(J).max())
    assert differs(np.cov(y.T), H @ P @ H.T)
    assert differs(np.cov(y.T), R)


# --- (3a)-(3c) ---

J = H @ P @ H.T + R
K = P @ H.T @ np.linalg.inv(J)


def test_3a_3b_with_the_inverse_of_J_complete_the_square():
    mean, cov = conditioned()
    np.testing.assert_allclose(X + K @ (Z - H @ X), mean, atol=1e-9)
    np.testing.assert_allclose((np.eye(N) - K @ H) @ P, cov, atol=1e-9)


@pytest.mark.parametrize(
    "S",
    [
        pytest.param(R, id="S is R"),
        pytest.param(H @ P @ H.T, id="S without noise"),
        pytest.param(np.linalg.inv(J), id="S is the inverse already"),
        pytest.param(2 * J, id="R counted with J twice"),
    ],
)
def test_3c_with_another_reading_of_the_undefined_S_fails(S):
    mean, cov = conditioned()
    gain = P @ H.T @ np.linalg.inv(S)
    assert differs(X + gain @ (Z - H @ X), mean)
    assert differs((np.eye(N) - gain @ H) @ P, cov)


def test_3b_holds_for_the_gain_of_3c_only():
    half = 0.5 * K
    keep = np.eye(N) - half @ H
    joseph = keep @ P @ keep.T + half @ R @ half.T
    assert differs(keep @ P, joseph)
    full = np.eye(N) - K @ H
    np.testing.assert_allclose(full @ P, full @ P @ full.T + K @ R @ K.T, atol=1e-9)


# --- (4a)-(4c) ---


def test_4a_turns_from_the_body_into_the_world():
    R_B, position = Rotation.from_rotvec([0.3, -0.7, 1.1]).as_matrix(), np.array([5.0, -2.0, 30.0])
    point = np.array([12.0, 3.0, -25.0])
    seen = R_B.T @ (point - position)
    np.testing.assert_allclose(position + R_B @ seen, point, atol=1e-12)
    assert differs(position + R_B.T @ seen, point)


def blocks(n):
    """A vehicle of six numbers, n points of space, and the Jacobians of (4a)."""
    P_all = covariance(6 + 3 * n)
    return P_all, rng.normal(size=(3, 6)), rng.normal(size=(3, 3)), covariance(3, 0.2)


def augmented(P_all, g_X, g_Z, R_z):
    """What (4b) does to the covariance, without blocks: one map of state and measurement."""
    size = len(P_all)
    to = np.zeros((size + 3, size + 3))
    to[:size, :size] = np.eye(size)
    to[size:, :6], to[size:, size:] = g_X, g_Z
    both = np.zeros((size + 3, size + 3))
    both[:size, :size], both[size:, size:] = P_all, R_z
    return to @ both @ to.T


def corrected_4c(P_all, g_X, g_Z, R_z):
    vv, vm, mm = P_all[:6, :6], P_all[:6, 6:], P_all[6:, 6:]
    return np.block(
        [
            [vv, vm, vv @ g_X.T],
            [vm.T, mm, vm.T @ g_X.T],
            [g_X @ vv, g_X @ vm, g_X @ vv @ g_X.T + g_Z @ R_z @ g_Z.T],
        ]
    )


def printed_4c(P_all, g_X, g_Z):
    vv, vm, mm = P_all[:6, :6], P_all[:6, 6:], P_all[6:, 6:]
    return np.block(
        [
            [vv, vm, vv @ g_X.T],
            [vm.T, mm, mm @ g_Z.T],
            [g_X @ vv, g_Z @ mm, g_X @ vv @ g_X.T + g_Z @ mm @ g_Z.T],
        ]
    )


@pytest.mark.parametrize("n", [1, 2, 5])
def test_4b_4c_corrected_is_the_covariance_of_the_augmented_state(n):
    case = blocks(n)
    np.testing.assert_allclose(corrected_4c(*case), augmented(*case), rtol=1e-12, atol=1e-12)


def test_4c_as_printed_has_products_that_do_not_exist():
    P_all, g_X, g_Z, _ = blocks(2)
    with pytest.raises(ValueError, match="matmul"):
        printed_4c(P_all, g_X, g_Z)


def test_4c_as_printed_is_wrong_where_it_exists_and_often_no_covariance():
    indefinite = 0
    for _ in range(100):
        P_all, g_X, g_Z, R_z = blocks(1)
        wrong = printed_4c(P_all, g_X, g_Z)
        assert differs(wrong, augmented(P_all, g_X, g_Z, R_z))
        indefinite += np.linalg.eigvalsh(wrong)[0] < -1e-9
    assert indefinite > 50


def test_4c_is_what_the_library_does_when_it_adds_a_landmark():
    sensor = RangeBearing(0.1, 0.05, offset=0.3)
    P0 = covariance(5, 0.05)
    slam = EKFSlam(Unicycle(), sensor, [1.0, 2.0, 0.4, 4.0, 5.0], P0, ["old"])
    z = np.array([3.0, 0.7])
    G_pose, G_z = sensor.locate_jacobians(slam.pose, z)
    to = np.zeros((7, 7))
    to[:5, :5] = np.eye(5)
    to[5:, :3], to[5:, 5:] = G_pose, G_z
    both = np.zeros((7, 7))
    both[:5, :5], both[5:, 5:] = P0, sensor.cov
    slam.update(z[None], ["new"])
    np.testing.assert_allclose(slam.cov, to @ both @ to.T, rtol=1e-9, atol=1e-12)


# --- the association of page 84 ---


def test_a_fixed_gate_is_too_wide_and_too_narrow_for_one_and_the_same_robot():
    sensor = RangeBearing(0.05, 0.01)
    trees = [5.0, 0.0, 5.0, 1.0]
    sure = EKFSlam(Unicycle(), sensor, [0, 0, 0, *trees], 1e-4 * np.eye(7), "ab")
    unsure = EKFSlam(Unicycle(), sensor, [0, 0, 0, *trees], np.diag([1.0] + [1e-4] * 6), "ab")
    between = sensor.observe(np.zeros(3), [[5.0, 0.55]])
    shifted = sensor.observe(np.array([-1.2, 0, 0]), [[5.0, 0.0]])
    # Sure of its pose, half a metre off is another tree; unsure, 1.2 m off is still the same.
    assert nearest_neighbour(sure, between).tolist() == [NEW]
    assert nearest_neighbour(unsure, shifted).tolist() == [0]
    for gate in (0.2, 0.5, 1.0, 1.5, 2.0):
        right = (
            nearest_euclidean(sure, between, gate).tolist() == [NEW],
            nearest_euclidean(unsure, shifted, gate).tolist() == [0],
        )
        assert not all(right)


def test_the_gate_of_page_84_lets_two_measurements_claim_one_landmark():
    """Printed without mutual exclusion; here the nearer one gets it."""
    slam = EKFSlam(Unicycle(), RangeBearing(0.05, 0.01), [0, 0, 0, 5.0, 0.0], None, "a")
    z = np.array([[5.1, 0.0], [5.2, 0.0]])
    points = slam.sensor.locate(slam.pose, z)
    assert (np.hypot(*(points - slam.landmarks).T) < 1.0).all()
    assert nearest_euclidean(slam, z).tolist() == [0, IGNORED]


# --- (4a) in three dimensions, and the region S_1 ---


def test_4a_with_the_attitude_given_is_a_plane_and_heights():
    """Levelled by A, an even camera keeps plane (x, y, yaw, l) and heights (h, l_h) apart."""
    A, state = tilt(0.3, -0.2), np.array([1.0, 2.0, 0.4, 15.0, -8.0, 30.0, 5.0])

    def measured(s):
        d = np.array([s[3] - s[0], s[4] - s[1], s[6] - s[5]])
        c, w = np.cos(s[2]), np.sin(s[2])
        return A.T @ np.array([c * d[0] + w * d[1], -w * d[0] + c * d[1], d[2]])

    steps = 1e-6 * np.eye(7)
    H3 = np.array([(measured(state + e) - measured(state - e)) / 2e-6 for e in steps]).T
    prior = np.zeros((7, 7))
    prior[:5, :5], prior[5:, 5:] = covariance(5), covariance(2)

    def corrected(P, H, R):
        return P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P)

    even = corrected(prior, H3, 0.04 * np.eye(3))
    np.testing.assert_allclose(even[:5, 5:], 0, atol=1e-8)
    plane = np.hstack(PointSensor(np.eye(2)).jacobians(state[:3], state[3:5]))
    due = corrected(prior[:5, :5], plane, 0.04 * np.eye(2))
    np.testing.assert_allclose(even[:5, :5], due, atol=1e-7)
    deep = corrected(prior, H3, np.diag([0.04, 0.04, 1.0]))
    assert differs(deep[:5, 5:], 0)  # a camera worse in depth ties them together


def test_S1_may_confine_the_work_but_not_the_correction():
    """Two numbers with correlation 0.9, the first measured: left alone, the rest is no belief."""
    prior, S = np.array([[1.0, 0.9], [0.9, 1.0]]), 1.1
    due = prior - np.outer(prior[0], prior[0]) / S
    block_alone = prior.copy()
    block_alone[0, 0] = due[0, 0]
    assert np.linalg.det(block_alone) < -0.5
    # Phi = 1 - K, Psi = 1 / S: settled, it is the whole correction.
    Phi, Psi = 1 - 1 / S, 1 / S
    settled = np.array([[due[0, 0], Phi * 0.9], [Phi * 0.9, 1 - 0.9 * Psi * 0.9]])
    np.testing.assert_allclose(settled, due, atol=1e-15)
