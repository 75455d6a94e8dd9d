"""Encoders and dead reckoning: slip adds up, rounding does not, and the covariance is honest."""

import numpy as np
import pytest

from slamlab.evaluation import chi2_band, nees
from slamlab.geometry import wrap_angle
from slamlab.robots import YOUBOT, Encoders, Mecanum, Unicycle, dead_reckoning, dead_reckoning_cov
from slamlab.robots.encoders import moved

FINE = Encoders(10**6, sigma_slip=0.05)
t = np.arange(200) * 0.1
CONTROLS = np.column_stack([0.3 * np.cos(t), 0.2 * np.sin(t), 0.3 + 0 * t])


def drives(n_runs, encoders, seed=0):
    """Measured controls (n_runs, T, 3) of one true drive."""
    wheels = np.broadcast_to(YOUBOT.wheel_speeds(CONTROLS), (n_runs, len(t), 4))
    ticks = encoders.read(wheels, 0.1, np.random.default_rng(seed))
    return YOUBOT.body_velocity(encoders.speeds(ticks, 0.1))


def test_without_slip_the_count_is_the_angle_to_one_tick():
    encoders, wheels = Encoders(500), YOUBOT.wheel_speeds(CONTROLS)
    ticks = encoders.read(wheels, 0.1, np.random.default_rng(1))
    lost = wheels.cumsum(0) * 0.1 - ticks.cumsum(0) * encoders.tick
    assert lost.min() > -1e-6
    assert lost.max() <= encoders.tick
    # Wrong: rounding each interval by itself loses half a tick every time.
    naive = np.floor(wheels * 0.1 / encoders.tick).cumsum(0) * encoders.tick
    assert np.abs(wheels.cumsum(0)[-1] * 0.1 - naive[-1]).min() > 50 * encoders.tick


def test_a_wheel_that_turns_back_counts_back():
    wheels = np.vstack([np.ones((10, 4)), -np.ones((10, 4))])
    assert Encoders(100).read(wheels, 0.37, np.random.default_rng(1)).sum() == 0


def test_slip_grows_with_the_root_of_the_way_however_time_is_cut():
    rng = np.random.default_rng(2)
    for n in (1, 10, 100):
        angles = FINE.spin(np.full((4000, n, 4), -5.0), 2.0 / n, rng).sum(1)
        assert angles.mean() == pytest.approx(-10, abs=0.01)
        assert angles.std() == pytest.approx(0.05 * np.sqrt(10), rel=0.03)


def test_sigma_wheel_is_the_spread_of_measured_speeds():
    wheels = np.broadcast_to([3.0, -8.0, 0.0, 1.0], (20_000, 1, 4))
    ticks = FINE.read(wheels, 0.2, np.random.default_rng(3))
    measured = FINE.speeds(ticks, 0.2)[:, 0]
    np.testing.assert_allclose(measured.std(0), FINE.sigma_wheel(wheels[0, 0], 0.2), rtol=0.03)


def test_reading_interval_by_interval_equals_reading_at_once():
    wheels = YOUBOT.wheel_speeds(CONTROLS)
    encoders, rng = Encoders(300, 0.02), np.random.default_rng(4)
    angles, counts = np.zeros(4), [np.zeros(4, int)]
    for one in wheels:
        angles = angles + encoders.spin(one, 0.1, rng)
        counts.append(encoders.ticks(angles))
    at_once = encoders.read(wheels, 0.1, np.random.default_rng(4))
    np.testing.assert_array_equal(np.diff(counts, axis=0), at_once)


def test_dead_reckoning_repeats_the_step_and_takes_batches():
    poses = dead_reckoning(YOUBOT, [1, 2, 3], CONTROLS, 0.1)
    pose = np.array([1.0, 2, 3])
    for k, u in enumerate(CONTROLS):
        np.testing.assert_array_equal(poses[k], pose)
        pose = YOUBOT.step(pose, u, 0.1)
    np.testing.assert_array_equal(poses[-1], pose)
    many = dead_reckoning(YOUBOT, [1, 2, 3], np.stack([CONTROLS, -CONTROLS]), 0.1)
    np.testing.assert_allclose(many[0], poses, atol=1e-14)
    assert dead_reckoning(Unicycle(), np.zeros((5, 3)), np.ones((7, 2)), 0.1).shape == (5, 8, 3)


def test_the_covariance_is_honest_and_without_dt_it_is_not():
    """Mean NEES of 300 drives at the end; the printed (17) claims a hundred times too much."""
    truth = dead_reckoning(YOUBOT, np.zeros(3), CONTROLS, 0.1)
    u = drives(300, FINE)
    poses = dead_reckoning(YOUBOT, np.zeros(3), u, 0.1)
    V = YOUBOT.control_cov(FINE.sigma_wheel(YOUBOT.wheel_speeds(CONTROLS), 0.1))
    covs = dead_reckoning_cov(YOUBOT, poses, u, 0.1, V)
    error = poses[:, -1] - truth[-1]
    error[:, 2] = wrap_angle(error[:, 2])
    low, high = chi2_band(3, 300, 0.99)
    assert low < nees(error, covs[:, -1]).mean() < high
    assert nees(error, 100 * covs[:, -1]).mean() < 0.1 * low
    # The same as the spread of the ends, number by number.
    np.testing.assert_allclose(np.cov(error.T), covs[0, -1], atol=0.2 * covs[0, -1].max())


def test_the_recursion_starts_from_the_given_covariance():
    P0, still = np.diag([0.1, 0.2, 0.3]), np.zeros((4, 3))
    poses = dead_reckoning(YOUBOT, np.zeros(3), still, 0.1)
    covs = dead_reckoning_cov(YOUBOT, poses, still, 0.1, np.zeros((3, 3)), P0)
    np.testing.assert_array_equal(covs, np.broadcast_to(P0, (5, 3, 3)))
    noisy = dead_reckoning_cov(YOUBOT, poses, still, 0.1, np.eye(3))
    np.testing.assert_allclose(noisy[-1], 4 * 0.01 * np.eye(3), atol=1e-15)


def test_a_heading_error_feeds_the_position_as_the_jacobian_says():
    """One drive of 10 m with a heading sigma of 1 degree: 0.1745 m across, nothing along."""
    u = np.tile([1.0, 0, 0], (100, 1))
    poses = dead_reckoning(YOUBOT, np.zeros(3), u, 0.1)
    P0 = np.diag([0, 0, np.radians(1) ** 2])
    end = dead_reckoning_cov(YOUBOT, poses, u, 0.1, np.zeros((3, 3)), P0)[-1]
    assert np.sqrt(end[1, 1]) == pytest.approx(10 * np.radians(1))
    assert end[0, 0] == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Encoders(0), "ticks_per_turn"),
        (lambda: Encoders(10.5), "ticks_per_turn: expected a whole number"),
        (lambda: Encoders(10, -0.1), "sigma_slip"),
        (lambda: FINE.spin([1, 2], 0.1, np.random.default_rng(1)), "wheel_speeds"),
        (lambda: FINE.spin(np.ones(4), -0.1, np.random.default_rng(1)), "dt"),
        (lambda: FINE.read(np.ones((2, 4)), 0.1, 7), "rng"),
        (lambda: FINE.read(np.ones(4), 0.1, np.random.default_rng(1)), "wheel_speeds"),
        (lambda: FINE.ticks([np.nan, 0, 0, 0]), "angles"),
        (lambda: FINE.speeds(np.ones(4), 0.0), "dt"),
        (lambda: FINE.sigma_wheel(np.ones(3), 0.1), "wheel_speeds"),
        (lambda: dead_reckoning(YOUBOT, [0, 0], CONTROLS, 0.1), "pose"),
        (lambda: dead_reckoning(YOUBOT, [0, 0, 0], [1, 0, 0], 0.1), "controls"),
        (lambda: dead_reckoning(YOUBOT, [0, 0, 0], CONTROLS, -0.1), "dt"),
        (
            lambda: dead_reckoning_cov(YOUBOT, np.zeros((3, 3)), CONTROLS, 0.1, np.eye(3)),
            "poses: expected shape",
        ),
        (
            lambda: dead_reckoning_cov(
                Mecanum(1, 1, 1), np.zeros((2, 3)), [[0, 0, 0]], 0.1, -np.eye(3)
            ),
            "control_cov",
        ),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(
    ("cov", "wanted"),
    [
        (np.full((3, 3), np.nan), "covs: expected finite numbers"),
        (np.diag([1.0, np.inf, 1.0]), "covs: expected finite numbers"),
        (np.eye(2), r"covs: expected shape \(..., 3, 3\)"),
    ],
)
def test_a_covariance_that_holds_no_numbers_is_not_moved(cov, wanted):
    step = (Unicycle(), [0, 0, 0], [1.0, 0.0], 1.0, np.eye(2))
    with pytest.raises(ValueError, match=wanted):
        moved(*step, np.eye(3), cov)
    assert len(moved(*step, np.eye(3), np.eye(3))) == 3
