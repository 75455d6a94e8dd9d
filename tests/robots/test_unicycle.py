"""Unicycle: exact arcs, their derivatives, and noise for every particle of its own."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slamlab.geometry import compose, wrap_angle
from slamlab.robots import Unicycle

ROBOT = Unicycle()
rng = np.random.default_rng(8)
POSES = np.column_stack([rng.uniform(-5, 5, (30, 2)), rng.uniform(-np.pi, np.pi, 30)])
CONTROLS = np.column_stack([rng.uniform(-2, 2, 30), rng.uniform(-3, 3, 30)])
CONTROLS[:6, 1] = [0.0, 1e-12, 1e-6, -1e-4, 1e-3, 0.019]


def euler(pose, u, dt):
    """One step with the heading of its start: the wrong form beside the exact arc."""
    theta = pose[..., 2]
    move = np.stack([u[..., 0] * np.cos(theta), u[..., 0] * np.sin(theta), u[..., 1]], -1)
    return pose + dt * move


def test_a_step_solves_the_differential_equation_and_euler_does_not():
    for pose, u in zip(POSES, CONTROLS, strict=True):
        path = solve_ivp(
            lambda _, x, u=u: [u[0] * np.cos(x[2]), u[0] * np.sin(x[2]), u[1]],
            (0, 0.8),
            pose,
            rtol=1e-11,
            atol=1e-12,
        )
        error = ROBOT.step(pose, u, 0.8) - path.y[:, -1]
        error[2] = wrap_angle(error[2])
        np.testing.assert_allclose(error, 0, atol=1e-8)
    wrong = euler(POSES, CONTROLS, 0.8) - ROBOT.step(POSES, CONTROLS, 0.8)
    assert np.abs(wrong[6:, :2]).max() > 0.1


def test_two_half_steps_are_one_step():
    half = ROBOT.step(ROBOT.step(POSES, CONTROLS, 0.35), CONTROLS, 0.35)
    whole = ROBOT.step(POSES, CONTROLS, 0.7)
    np.testing.assert_allclose(half[:, :2], whole[:, :2], atol=1e-12)
    np.testing.assert_allclose(wrap_angle(half[:, 2] - whole[:, 2]), 0, atol=1e-12)
    twice = euler(euler(POSES, CONTROLS, 0.35), CONTROLS, 0.35)
    assert np.abs(twice - euler(POSES, CONTROLS, 0.7)).max() > 0.05


def test_jacobians_equal_finite_differences():
    F_x, F_u = ROBOT.jacobians(POSES, CONTROLS, 0.6)

    def slope(vary):
        columns = []
        for i in range(3 if vary == "pose" else 2):
            d = np.zeros(3 if vary == "pose" else 2)
            d[i] = 1e-6
            up = (POSES + d, CONTROLS) if vary == "pose" else (POSES, CONTROLS + d)
            down = (POSES - d, CONTROLS) if vary == "pose" else (POSES, CONTROLS - d)
            difference = ROBOT.step(*up, 0.6) - ROBOT.step(*down, 0.6)
            difference[:, 2] = wrap_angle(difference[:, 2])
            columns.append(difference / 2e-6)
        return np.stack(columns, -1)

    np.testing.assert_allclose(F_x, slope("pose"), atol=1e-7)
    np.testing.assert_allclose(F_u, slope("control"), atol=1e-7)
    # Wrong: the heading at the start of the step in place of the direction of the chord.
    u, theta = CONTROLS, POSES[:, 2]
    wrong = np.stack([-u[:, 0] * np.sin(theta), u[:, 0] * np.cos(theta)], -1) * 0.6
    assert np.abs(wrong - F_x[:, :2, 2]).max() > 0.1


def test_the_slope_of_sinc_is_smooth_where_series_and_closed_form_meet():
    from slamlab.robots.unicycle import _sinc_slope

    h = np.array([-0.0100001, -0.0099999, 0.0099999, 0.0100001])
    np.testing.assert_allclose(_sinc_slope(h), -h / 3 + h**3 / 30, rtol=1e-9)


def test_a_rigid_motion_of_the_world_commutes_with_driving():
    motion = np.array([3.0, -2.0, 2.0])
    one = ROBOT.step(compose(motion, POSES), CONTROLS, 0.5)
    two = compose(motion, ROBOT.step(POSES, CONTROLS, 0.5))
    np.testing.assert_allclose(one[:, :2], two[:, :2], atol=1e-12)
    np.testing.assert_allclose(wrap_angle(one[:, 2] - two[:, 2]), 0, atol=1e-12)


def test_samples_have_the_covariance_that_the_jacobian_predicts():
    C = np.array([[0.02**2, 0.5e-4], [0.5e-4, 0.01**2]])
    poses = np.tile(POSES[9], (200_000, 1))
    drawn = ROBOT.sample(poses, CONTROLS[9], 0.5, C, np.random.default_rng(1))
    F_u = ROBOT.jacobians(POSES[9], CONTROLS[9], 0.5)[1]
    deviation = drawn - ROBOT.step(POSES[9], CONTROLS[9], 0.5)
    deviation[:, 2] = wrap_angle(deviation[:, 2])
    due = F_u @ C @ F_u.T
    np.testing.assert_allclose(np.cov(deviation.T), due, atol=0.01 * due.max())
    assert len(np.unique(drawn[:, 0])) > 199_000, "noise drawn once for all particles"


def test_a_singular_control_covariance_and_no_noise_are_allowed():
    drawn = ROBOT.sample(POSES, [1, 0.5], 0.5, np.diag([0.01, 0.0]), np.random.default_rng(1))
    np.testing.assert_allclose(wrap_angle(drawn[:, 2] - POSES[:, 2]), 0.25, atol=1e-12)
    still = ROBOT.sample(POSES, CONTROLS, 0.5, np.zeros((2, 2)), np.random.default_rng(1))
    np.testing.assert_array_equal(still, ROBOT.step(POSES, CONTROLS, 0.5))


def test_batches_equal_single_steps_and_controls_broadcast():
    batch = ROBOT.step(POSES, CONTROLS, 0.5)
    np.testing.assert_array_equal(batch[7], ROBOT.step(POSES[7], CONTROLS[7], 0.5))
    assert ROBOT.step(POSES, [1, 0], 0.5).shape == (30, 3)
    F_x, F_u = ROBOT.jacobians(POSES[0], CONTROLS, 0.5)
    assert (F_x.shape, F_u.shape) == ((30, 3, 3), (30, 3, 2))
    assert ROBOT.sample(POSES[0], CONTROLS, 1, np.eye(2), rng).shape == (30, 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0, 0], [1, 0], 1), "pose: expected shape"),
        (([0, 0, 0], [1, np.inf], 1), "u: expected finite"),
        (([0, 0, 0], [1, 0], -1), "dt"),
        (([0, 0, 0], [1, 0], np.nan), "dt"),
    ],
)
def test_bad_input_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        ROBOT.step(*arguments)


def test_a_bad_control_covariance_or_generator_is_named():
    with pytest.raises(ValueError, match="control_cov"):
        ROBOT.sample([0, 0, 0], [1, 0], 1, np.diag([1, -1]), rng)
    with pytest.raises(ValueError, match="rng"):
        ROBOT.sample([0, 0, 0], [1, 0], 1, np.eye(2), 3)
