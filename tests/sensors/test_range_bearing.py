"""Range-bearing sensor: P1 (18)-(32) and (37)-(42), right forms pass and printed ones fail."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamlab.geometry import compose, transform, wrap_angle
from slamlab.robots import Unicycle
from slamlab.sensors import RangeBearing
from slamlab.slam import EKFSlam

rng = np.random.default_rng(20)
SENSOR = RangeBearing(0.05, 0.02, offset=0.3)
POSES = np.column_stack([rng.uniform(-5, 5, (60, 2)), rng.uniform(-np.pi, np.pi, 60)])
# All four quadrants around the sensor, at 1 to 5 m.
ANGLES = np.linspace(-np.pi, np.pi, 60, endpoint=False) + 0.01
LANDMARKS = transform(POSES, np.stack([3 * np.cos(ANGLES), 3 * np.sin(ANGLES)], -1)[:, None])[:, 0]


def numerical(f, x, wrapped=None, step=1e-6):
    """Central differences of f at x (n,), one column a coordinate."""
    columns = []
    for d in np.eye(len(x)) * step:
        difference = f(x + d) - f(x - d)
        if wrapped is not None:
            difference[wrapped] = wrap_angle(difference[wrapped])
        columns.append(difference / (2 * step))
    return np.stack(columns, -1)


def printed_h(pose, landmark, L=0.3):
    """P1 (18) as printed: the inverted fraction, no quadrant."""
    dx = pose[..., 0] + L * np.cos(pose[..., 2]) - landmark[..., 0]
    dy = pose[..., 1] + L * np.sin(pose[..., 2]) - landmark[..., 1]
    return np.stack([np.hypot(dx, dy), np.arctan(dx / dy) - pose[..., 2]], -1)


def printed_jacobian(pose, landmark, L=0.3):
    """P1 (24)-(29) as printed, the sign of (26) and (29) in the most favourable reading."""
    px, py = pose[0] - landmark[0], pose[1] - landmark[1]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    dx, dy = px + L * c, py + L * s
    rho = np.hypot(dx, dy)
    E = (-px * s + py * c) / rho
    F = (px * c - py * s + L * np.cos(2 * pose[2])) * L / rho**2 - 1
    return np.array([[dx / rho, dy / rho, E], [-py / rho**2, px / rho**2, F]])


def test_jacobians_equal_finite_differences_and_the_printed_ones_do_not():
    H_pose, H_landmark = SENSOR.jacobians(POSES, LANDMARKS)
    worst = np.zeros((2, 3))
    for pose, landmark, Hp, Hl in zip(POSES, LANDMARKS, H_pose, H_landmark, strict=True):
        due = numerical(lambda x, m=landmark: SENSOR.observe(x, m), pose, 1)
        np.testing.assert_allclose(Hp, due, atol=1e-7)
        worst = np.maximum(worst, np.abs(printed_jacobian(pose, landmark) - due))
        due = numerical(lambda m, x=pose: SENSOR.observe(x, m), landmark, 1)
        np.testing.assert_allclose(Hl, due, atol=1e-7)
    # A and B (24), (25) are printed right; C, D, E, F (26)-(29) are not.
    assert (worst[0, :2] < 1e-7).all()
    assert (worst[[0, 1, 1, 1], [2, 0, 1, 2]] > 0.01).all()


@pytest.mark.parametrize("offset", [0.0, 0.3, -0.2, 1.5])
def test_locating_undoes_observing_in_all_quadrants(offset):
    sensor = RangeBearing(0.05, 0.02, offset=offset)
    z = np.stack([np.linspace(0.2, 30, 60), ANGLES], -1)
    again = sensor.observe(POSES, sensor.locate(POSES, z))
    np.testing.assert_allclose(sensor.residual(again, z), 0, atol=1e-12)
    np.testing.assert_allclose(
        sensor.locate(POSES, sensor.observe(POSES, LANDMARKS)), LANDMARKS, atol=1e-12
    )


def test_the_printed_bearing_contradicts_the_papers_own_inverse():
    z = np.stack([np.full(60, 3.0), ANGLES], -1)
    wrong = printed_h(POSES, SENSOR.locate(POSES, z))
    assert (np.abs(wrap_angle(wrong[:, 1] - z[:, 1])) > 0.1).mean() > 0.8


def test_locate_jacobians_equal_finite_differences_and_printed_41_does_not():
    z = SENSOR.observe(POSES, LANDMARKS)
    G_pose, G_z = SENSOR.locate_jacobians(POSES, z)
    for pose, one, Gp, Gz in zip(POSES, z, G_pose, G_z, strict=True):
        due = numerical(lambda x, one=one: SENSOR.locate(x, one), pose)
        np.testing.assert_allclose(Gp, due, atol=1e-7)
        np.testing.assert_allclose(
            Gz, numerical(lambda v, pose=pose: SENSOR.locate(pose, v), one), atol=1e-7
        )
        L, theta = SENSOR.offset, pose[2]
        printed = np.array([[1, 0, -L * np.sin(theta)], [0, 1, L * np.cos(theta)]])
        # The heading term that is missing has the length of the measured range.
        assert np.linalg.norm(printed - due) == pytest.approx(one[0], abs=1e-6)


def test_inverse_jacobians_multiply_to_one():
    # G_z is the inverse of H_landmark, and G_pose = -G_z H_pose.
    H_pose, H_landmark = SENSOR.jacobians(POSES, LANDMARKS)
    G_pose, G_z = SENSOR.locate_jacobians(POSES, SENSOR.observe(POSES, LANDMARKS))
    np.testing.assert_allclose(G_z @ H_landmark, np.tile(np.eye(2), (60, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(G_pose, -G_z @ H_pose, atol=1e-12)


coordinate = st.floats(-50, 50)
angle = st.floats(-10, 10)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(coordinate, coordinate, angle)
def test_a_rigid_motion_of_the_world_changes_no_measurement(x, y, turn):
    motion = np.array([x, y, turn])
    moved_pose, moved_landmark = compose(motion, POSES), transform(motion, LANDMARKS)
    z, moved_z = SENSOR.observe(POSES, LANDMARKS), SENSOR.observe(moved_pose, moved_landmark)
    np.testing.assert_allclose(SENSOR.residual(moved_z, z), 0, atol=1e-10)
    np.testing.assert_allclose(
        SENSOR.locate(moved_pose, z), transform(motion, SENSOR.locate(POSES, z)), atol=1e-10
    )


def test_moving_robot_and_landmark_together_is_invisible_to_the_jacobians():
    # The three gauge directions: two translations and a rotation about the origin.
    H_pose, H_landmark = SENSOR.jacobians(POSES, LANDMARKS)
    np.testing.assert_allclose(H_pose[..., :2] + H_landmark, 0, atol=1e-15)
    turn_pose = np.stack([-POSES[:, 1], POSES[:, 0], np.ones(60)], -1)
    turn_landmark = np.stack([-LANDMARKS[:, 1], LANDMARKS[:, 0]], -1)
    moved = np.einsum("nij,nj->ni", H_pose, turn_pose)
    moved += np.einsum("nij,nj->ni", H_landmark, turn_landmark)
    np.testing.assert_allclose(moved, 0, atol=1e-12)


def test_a_full_turn_of_pose_or_bearing_changes_nothing():
    turned = POSES + [0, 0, 2 * np.pi]
    np.testing.assert_allclose(
        SENSOR.observe(turned, LANDMARKS), SENSOR.observe(POSES, LANDMARKS), atol=1e-12
    )
    z = SENSOR.observe(POSES, LANDMARKS)
    np.testing.assert_allclose(SENSOR.residual(z + [0, 2 * np.pi], z), 0, atol=1e-12)
    log_likelihood = SENSOR.log_likelihood(POSES, z[:3] + [0, 2 * np.pi], LANDMARKS[:3])
    np.testing.assert_allclose(
        log_likelihood, SENSOR.log_likelihood(POSES, z[:3], LANDMARKS[:3]), rtol=1e-9
    )


def test_log_likelihood_is_the_sum_of_gaussian_log_densities():
    from scipy.stats import multivariate_normal

    z = SENSOR.observe(POSES[0], LANDMARKS[:4]) + 0.01
    due = np.zeros(60)
    for one, landmark in zip(z, LANDMARKS[:4], strict=True):
        residual = SENSOR.residual(one, SENSOR.observe(POSES, landmark))
        due += multivariate_normal.logpdf(residual, cov=SENSOR.cov)
    np.testing.assert_allclose(SENSOR.log_likelihood(POSES, z, LANDMARKS[:4]), due, rtol=1e-9)
    assert SENSOR.log_likelihood(POSES, np.empty((0, 2)), np.empty((0, 2))).tolist() == [0.0] * 60


def test_the_best_log_likelihood_takes_the_best_landmark_for_each_measurement():
    z = SENSOR.observe(POSES[0], LANDMARKS[:4]) + 0.01
    due = np.zeros(60)
    for one in z:
        due += np.max(
            [SENSOR.log_likelihood(POSES, one[None], m[None]) for m in LANDMARKS], axis=0
        )
    np.testing.assert_allclose(SENSOR.best_log_likelihood(POSES, z, LANDMARKS), due, rtol=1e-12)
    named = SENSOR.log_likelihood(POSES, z, LANDMARKS[:4])
    assert (due >= named).all()
    assert (due > named + 1).any()
    with pytest.raises(ValueError, match="landmarks: expected at least one"):
        SENSOR.best_log_likelihood(POSES, z, np.empty((0, 2)))


def test_a_measurement_beyond_all_reason_has_probability_zero():
    assert (SENSOR.log_likelihood(POSES, [[1e200, 0.0]], LANDMARKS[:1]) == -np.inf).all()


def test_batches_equal_single_calls():
    grid = SENSOR.observe(POSES[:5, None], LANDMARKS[None, :7])
    H_pose, H_landmark = SENSOR.jacobians(POSES[:5, None], LANDMARKS[None, :7])
    assert grid.shape == (5, 7, 2)
    assert H_pose.shape == (5, 7, 2, 3)
    assert H_landmark.shape == (5, 7, 2, 2)
    np.testing.assert_array_equal(grid[2, 3], SENSOR.observe(POSES[2], LANDMARKS[3]))
    np.testing.assert_array_equal(H_pose[2, 3], SENSOR.jacobians(POSES[2], LANDMARKS[3])[0])
    assert SENSOR.locate_jacobians(POSES[:5, None], grid)[0].shape == (5, 7, 2, 3)


def test_measure_sees_only_what_is_in_range_and_in_view():
    sensor = RangeBearing(1e-9, 1e-9, max_range=2.0, field_of_view=np.pi)
    landmarks = np.array([[1.0, 0], [3.0, 0], [-1.0, 0], [0.5, 1.0], [0.5, -1.0], [2.0, 0]])
    z, ids = sensor.measure([0, 0, 0], landmarks, np.random.default_rng(1))
    assert ids.tolist() == [0, 3, 4, 5]
    np.testing.assert_allclose(z, sensor.observe([0, 0, 0], landmarks[ids]), atol=1e-7)
    z, ids = sensor.measure([10, 10, 0], landmarks, np.random.default_rng(1))
    assert z.shape == (0, 2)
    assert ids.shape == (0,)


def test_the_noise_of_measure_has_the_stated_covariance():
    sensor = RangeBearing(0.1, 0.05)
    landmarks = np.tile([[-3.0, 0.0]], (40_000, 1))
    z, _ = sensor.measure([0, 0, 0], landmarks, np.random.default_rng(2))
    error = sensor.residual(z, sensor.observe([0, 0, 0], landmarks))
    np.testing.assert_allclose(np.cov(error.T), sensor.cov, atol=3e-4)
    assert (np.abs(z[:, 1]) <= np.pi).all()
    # The landmark is straight behind: about half of the bearings wrap to the other side.
    assert 0.4 < (z[:, 1] < 0).mean() < 0.6


def test_same_seed_same_measurements():
    one = SENSOR.measure(POSES[0], LANDMARKS, np.random.default_rng(3))
    two = SENSOR.measure(POSES[0], LANDMARKS, np.random.default_rng(3))
    np.testing.assert_array_equal(one[0], two[0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sigma_range": 0.0}, "sigma_range"),
        ({"sigma_bearing": -1.0}, "sigma_bearing"),
        ({"offset": np.nan}, "offset"),
        ({"max_range": 0.0}, "max_range"),
        ({"field_of_view": 7.0}, "field_of_view"),
    ],
)
def test_bad_parameters_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        RangeBearing(**{"sigma_range": 0.1, "sigma_bearing": 0.1, **arguments})


def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match=r"pose: expected shape"):
        SENSOR.observe([0, 0], [1, 1])
    with pytest.raises(ValueError, match=r"landmark: expected finite"):
        SENSOR.observe([0, 0, 0], [np.nan, 1])
    with pytest.raises(ValueError, match="distance is 0"):
        SENSOR.jacobians([0, 0, 0], [0.3, 0])
    with pytest.raises(ValueError, match="rng"):
        SENSOR.measure([0, 0, 0], LANDMARKS, 5)
    with pytest.raises(ValueError, match="landmarks: expected shape"):
        SENSOR.log_likelihood(POSES, np.zeros((2, 2)), LANDMARKS[:3])
    with pytest.raises(ValueError, match="read-only"):
        SENSOR.cov[0, 0] = 1.0


def test_noise_never_makes_a_range_negative_so_that_every_measurement_can_be_located():
    sensor, landmark = RangeBearing(0.1, 0.02), np.array([[0.05, 0.0]])
    rng = np.random.default_rng(3)
    z = np.array([sensor.measure([0, 0, 0], landmark, rng)[0][0] for _ in range(2000)])
    assert z[:, 0].min() == 0.0
    assert 0.2 < (z[:, 0] == 0).mean() < 0.4  # P(0.05 + 0.1 n < 0) = 0.31
    slam = EKFSlam(Unicycle(), sensor, [0, 0, 0])
    slam.update(z[z[:, 0] == 0][:1], ids=[0])
    assert np.isfinite(slam.landmark_covs).all()
    with pytest.raises(ValueError, match="not negative"):
        sensor.locate([0, 0, 0], [-0.05, 0.0])
