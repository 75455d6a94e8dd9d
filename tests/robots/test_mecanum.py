"""Mecanum platform: wheel map, slip, noise, and three integration schemes with their Jacobians."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slamlab.geometry import compose, wrap_angle
from slamlab.robots import YOUBOT, Mecanum

rng = np.random.default_rng(5)
POSES = np.column_stack([rng.uniform(-5, 5, (30, 2)), rng.uniform(-np.pi, np.pi, 30)])
CONTROLS = np.column_stack([rng.uniform(-1, 1, (30, 2)), rng.uniform(-3, 3, 30)])
CONTROLS[:6, 2] = [0.0, 1e-12, 1e-6, -1e-4, 1e-3, 0.019]
SCHEMES = {name: Mecanum(0.0475, 0.235, 0.15, name) for name in ("exact", "euler", "midpoint")}


def pose_error(a, b):
    difference = np.asarray(a) - b
    difference[..., 2] = wrap_angle(difference[..., 2])
    return difference


def slopes(robot, pose, u, dt, vary):
    """Central differences of `step` by pose (0) or control (1), columns last."""
    columns = []
    for i in range(3):
        d = np.zeros((2, 3))
        d[vary, i] = 1e-6
        up, down = robot.step(pose + d[0], u + d[1], dt), robot.step(pose - d[0], u - d[1], dt)
        columns.append(pose_error(up, down) / 2e-6)
    return np.stack(columns, -1)


# --- wheels ---


def test_body_map_inverts_the_wheel_map_and_is_its_pseudo_inverse():
    np.testing.assert_allclose(YOUBOT.body_map @ YOUBOT.wheel_map, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(YOUBOT.body_map, np.linalg.pinv(YOUBOT.wheel_map), atol=1e-14)
    np.testing.assert_allclose(
        YOUBOT.body_velocity(YOUBOT.wheel_speeds(CONTROLS)), CONTROLS, atol=1e-14
    )


def test_the_three_patterns_drive_forward_left_and_turn():
    drive = YOUBOT.body_velocity([[10, 10, 10, 10], [-10, 10, 10, -10], [-10, 10, -10, 10]])
    due = np.diag([0.475, 0.475, 0.475 / 0.385])
    np.testing.assert_allclose(drive, due, atol=1e-14)
    # Wrong: rollers the other way round would strafe right.
    assert YOUBOT.body_velocity([10, -10, -10, 10])[1] == pytest.approx(-0.475)


def test_each_wheel_does_what_its_roller_allows():
    """Written without the map: along the axis of the roller on the floor, nothing slips.

    From above one sees the upper rollers, which make an X; those on the floor make a diamond.
    """
    lx, ly, r = 0.235, 0.15, 0.0475
    wheels = np.array([[lx, ly], [lx, -ly], [-lx, ly], [-lx, -ly]])
    axes = np.array([[1, -1], [1, 1], [1, 1], [1, -1]]) / np.sqrt(2)
    for u, spins in zip(CONTROLS, YOUBOT.wheel_speeds(CONTROLS), strict=True):
        contact = u[:2] + u[2] * np.column_stack([-wheels[:, 1], wheels[:, 0]])
        rim = np.column_stack([r * spins, np.zeros(4)])
        along = ((contact - rim) * axes).sum(1)
        np.testing.assert_allclose(along, 0, atol=1e-13)
        across = ((contact - rim) * axes[:, ::-1] * [1, -1]).sum(1)
        assert np.abs(across).max() > 1e-3, "without rollers the wheels would drag"


def test_slip_is_the_residual_of_least_squares_and_vanishes_without_slip():
    speeds = rng.normal(0, 10, (50, 4))
    u = np.linalg.lstsq(YOUBOT.wheel_map, speeds.T, rcond=None)[0]
    due = speeds - (YOUBOT.wheel_map @ u).T
    np.testing.assert_allclose(YOUBOT.slip(speeds), due, atol=1e-12)
    np.testing.assert_allclose(YOUBOT.slip(YOUBOT.wheel_speeds(CONTROLS)), 0, atol=1e-12)
    np.testing.assert_allclose(YOUBOT.slip(speeds), YOUBOT.slip(speeds)[:, :1] * [1, 1, -1, -1])
    assert np.abs(YOUBOT.slip(speeds)).max() > 1


def test_like_wheels_give_a_diagonal_covariance_to_the_last_bit():
    for sigma in (0.1, 0.3, 0.4, 0.7, 2.0):
        V = YOUBOT.control_cov(sigma)
        assert (V == np.diag(np.diag(V))).all()
        assert V[0, 0] == V[1, 1]


def test_control_covariance_is_that_of_drawn_wheel_noise():
    noise = rng.normal(0, 0.3, (200_000, 4))
    drawn = np.cov(YOUBOT.body_velocity(noise).T)
    V = YOUBOT.control_cov(0.3)
    np.testing.assert_allclose(drawn, V, atol=0.01 * V.max())
    r, lever = 0.0475, 0.385
    due = 0.09 / 4 * np.diag([r * r, r * r, (r / lever) ** 2])
    np.testing.assert_allclose(V, due, atol=1e-18)
    # Wrong: a quarter forgotten, as if the mean of four wheels were as noisy as one.
    assert np.abs(4 * V - drawn).max() > 0.5 * V.max()


def test_unequal_wheels_correlate_the_control():
    V = YOUBOT.control_cov([0.1, 0.1, 0.1, 0.5])
    drawn = np.cov(YOUBOT.body_velocity(rng.normal(0, [0.1, 0.1, 0.1, 0.5], (200_000, 4))).T)
    np.testing.assert_allclose(drawn, V, atol=0.01 * V.max())
    assert V[0, 1] < -0.5 * np.sqrt(V[0, 0] * V[1, 1])
    assert YOUBOT.control_cov(np.ones((7, 4))).shape == (7, 3, 3)
    assert not YOUBOT.control_cov(0).any()


# --- integration ---


def test_an_exact_step_solves_the_differential_equation_and_the_others_do_not():
    def rate(_, x, u):
        c, s = np.cos(x[2]), np.sin(x[2])
        return [c * u[0] - s * u[1], s * u[0] + c * u[1], u[2]]

    ends = [
        solve_ivp(rate, (0, 0.8), pose, args=(u,), rtol=1e-11, atol=1e-12).y[:, -1]
        for pose, u in zip(POSES, CONTROLS, strict=True)
    ]
    error = {k: pose_error(r.step(POSES, CONTROLS, 0.8), ends) for k, r in SCHEMES.items()}
    np.testing.assert_allclose(error["exact"], 0, atol=1e-8)
    assert np.abs(error["euler"][6:]).max() > 0.3
    assert 0.02 < np.abs(error["midpoint"][6:]).max() < 0.3


def test_observed_orders_are_one_two_and_exact():
    """Property 6: the error after 2 s against the step, on a log-log scale."""
    u, counts = np.array([0.5, 0.3, 0.8]), np.array([20, 40, 80, 160])
    end = YOUBOT.step(np.zeros(3), u, 2.0)

    def errors(robot):
        out = []
        for n in counts:
            pose = np.zeros(3)
            for _ in range(n):
                pose = robot.step(pose, u, 2.0 / n)
            out.append(np.linalg.norm(pose_error(pose, end)[:2]))
        return np.array(out)

    def order(robot):
        return np.polyfit(np.log(2.0 / counts), np.log(errors(robot)), 1)[0]

    assert order(SCHEMES["euler"]) == pytest.approx(1, abs=0.1)
    assert order(SCHEMES["midpoint"]) == pytest.approx(2, abs=0.1)
    assert errors(SCHEMES["exact"]).max() < 1e-13


def test_the_local_errors_have_the_constants_that_theory_names():
    """One step: Euler |V| |omega| dt^2 / 2, midpoint |V| dt phi^2 / 24."""
    u, dt = np.array([0.3, 0.4, 0.5]), 0.01
    exact = SCHEMES["exact"].step(np.zeros(3), u, dt)
    local = {
        k: np.linalg.norm((r.step(np.zeros(3), u, dt) - exact)[:2]) for k, r in SCHEMES.items()
    }
    assert local["euler"] == pytest.approx(0.5 * 0.5 * 0.5 * dt**2, rel=1e-3)
    assert local["midpoint"] == pytest.approx(0.5 * dt * (0.5 * dt) ** 2 / 24, rel=1e-3)


def test_without_turning_the_three_schemes_agree():
    straight = CONTROLS * [1, 1, 0]
    ends = [robot.step(POSES, straight, 0.7) for robot in SCHEMES.values()]
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-14)
    np.testing.assert_allclose(ends[2], ends[0], atol=1e-14)


def test_two_half_steps_are_one_exact_step():
    half = YOUBOT.step(YOUBOT.step(POSES, CONTROLS, 0.35), CONTROLS, 0.35)
    np.testing.assert_allclose(pose_error(half, YOUBOT.step(POSES, CONTROLS, 0.7)), 0, atol=1e-12)


def test_a_full_turn_in_one_step_ends_where_it_began():
    end = YOUBOT.step([1, 2, 0.3], [0.5, -0.2, 2 * np.pi], 1.0)
    np.testing.assert_allclose(end, [1, 2, 0.3], atol=1e-14)
    F_u = YOUBOT.jacobians([1, 2, 0.3], [0.5, -0.2, 2 * np.pi], 1.0)[1]
    due = slopes(YOUBOT, np.array([1, 2, 0.3]), np.array([0.5, -0.2, 2 * np.pi]), 1.0, 1)
    np.testing.assert_allclose(F_u, due, atol=1e-8)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_jacobians_equal_finite_differences(scheme):
    robot = SCHEMES[scheme]
    F_x, F_u = robot.jacobians(POSES, CONTROLS, 0.6)
    np.testing.assert_allclose(F_x, slopes(robot, POSES, CONTROLS, 0.6, 0), atol=1e-8)
    np.testing.assert_allclose(F_u, slopes(robot, POSES, CONTROLS, 0.6, 1), atol=1e-8)


def test_the_jacobians_of_one_scheme_are_wrong_for_another():
    F = {k: robot.jacobians(POSES, CONTROLS, 0.6) for k, robot in SCHEMES.items()}
    for one, other in (("exact", "euler"), ("exact", "midpoint"), ("midpoint", "euler")):
        assert np.abs(F[one][0] - F[other][0]).max() > 0.02
        assert np.abs(F[one][1] - F[other][1]).max() > 0.02


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_rigid_motion_of_the_world_commutes_with_driving(scheme):
    motion, robot = np.array([3.0, -2.0, 2.0]), SCHEMES[scheme]
    one = robot.step(compose(motion, POSES), CONTROLS, 0.5)
    two = compose(motion, robot.step(POSES, CONTROLS, 0.5))
    np.testing.assert_allclose(pose_error(one, two), 0, atol=1e-12)


# --- noise ---


def test_samples_have_the_covariance_that_the_jacobian_predicts():
    V = YOUBOT.control_cov([0.3, 0.2, 0.3, 0.5])
    poses = np.tile(POSES[9], (200_000, 1))
    drawn = YOUBOT.sample(poses, CONTROLS[9], 0.5, V, np.random.default_rng(1))
    F_u = YOUBOT.jacobians(POSES[9], CONTROLS[9], 0.5)[1]
    due = F_u @ V @ F_u.T
    deviation = pose_error(drawn, YOUBOT.step(POSES[9], CONTROLS[9], 0.5))
    np.testing.assert_allclose(np.cov(deviation.T), due, atol=0.01 * due.max())
    assert len(np.unique(drawn[:, 0])) > 199_000, "noise drawn once for all particles"


def test_a_singular_control_covariance_and_no_noise_are_allowed():
    drawn = YOUBOT.sample(POSES, [1, 0, 0.5], 0.5, np.diag([0.01, 0, 0]), np.random.default_rng(1))
    np.testing.assert_allclose(wrap_angle(drawn[:, 2] - POSES[:, 2]), 0.25, atol=1e-12)
    still = YOUBOT.sample(POSES, CONTROLS, 0.5, np.zeros((3, 3)), np.random.default_rng(1))
    np.testing.assert_array_equal(still, YOUBOT.step(POSES, CONTROLS, 0.5))


# --- shapes and refusals ---


@pytest.mark.parametrize("scheme", SCHEMES)
def test_batches_equal_single_steps_and_controls_broadcast(scheme):
    robot = SCHEMES[scheme]
    batch = robot.step(POSES, CONTROLS, 0.5)
    single = [robot.step(p, u, 0.5) for p, u in zip(POSES, CONTROLS, strict=True)]
    np.testing.assert_allclose(batch, single, rtol=0, atol=1e-15)
    F_x, F_u = robot.jacobians(POSES, CONTROLS, 0.5)
    for i, (p, u) in enumerate(zip(POSES, CONTROLS, strict=True)):
        one_x, one_u = robot.jacobians(p, u, 0.5)
        np.testing.assert_allclose(F_x[i], one_x, rtol=0, atol=1e-15)
        np.testing.assert_allclose(F_u[i], one_u, rtol=0, atol=1e-15)
    assert robot.step(POSES, [1, 0, 0], 0.5).shape == (30, 3)
    assert [F.shape for F in robot.jacobians(POSES[0], CONTROLS, 0.5)] == [(30, 3, 3)] * 2
    assert [F.shape for F in robot.jacobians(POSES, CONTROLS[9], 0.5)] == [(30, 3, 3)] * 2
    assert robot.sample(POSES[0], CONTROLS, 1, np.eye(3), rng).shape == (30, 3)
    assert robot.body_velocity(np.ones((2, 5, 4))).shape == (2, 5, 3)
    assert robot.wheel_speeds(np.ones((2, 5, 3))).shape == (2, 5, 4)
    assert robot.slip(np.ones((2, 5, 4))).shape == (2, 5, 4)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Mecanum(0, 0.2, 0.1), "wheel_radius"),
        (lambda: Mecanum(0.05, -0.2, 0.1), "half_length"),
        (lambda: Mecanum(0.05, 0.2, np.nan), "half_width"),
        (lambda: Mecanum(0.05, 0.2, 0.1, "runge-kutta"), "integration: expected one of 'exact'"),
        (lambda: YOUBOT.step([0, 0], [1, 0, 0], 1), "pose: expected shape"),
        (lambda: YOUBOT.step([0, 0, 0], [1, 0], 1), "u: expected shape"),
        (lambda: YOUBOT.jacobians([0, 0, 0], [1, 0, np.inf], 1), "u: expected finite"),
        (lambda: YOUBOT.step([0, 0, 0], [1, 0, 0], -1), "dt"),
        (lambda: YOUBOT.step([0, 0, 0], [1, 0, 0], np.nan), "dt"),
        (lambda: YOUBOT.body_velocity([1, 2, 3]), "wheel_speeds: expected shape"),
        (lambda: YOUBOT.slip([1, 2, 3, np.nan]), "wheel_speeds: expected finite"),
        (lambda: YOUBOT.wheel_speeds([1, 2]), "u: expected shape"),
        (lambda: YOUBOT.control_cov(-0.1), "sigma_wheel: expected no negative"),
        (lambda: YOUBOT.control_cov([0.1, 0.1]), "sigma_wheel: expected shape"),
        (lambda: YOUBOT.sample([0, 0, 0], [1, 0, 0], 1, -np.eye(3), rng), "control_cov"),
        (lambda: YOUBOT.sample([0, 0, 0], [1, 0, 0], 1, np.eye(3), 3), "rng"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
