"""Extended Kalman filter: reduction to the linear one, iterations, angles, bad input."""

import numpy as np
import pytest

from slamlab.filters import extended, kalman
from slamlab.gaussian import Gaussian
from slamlab.geometry import wrap_angle

BELIEF = Gaussian([1.0, 2.0, 0.5], np.diag([0.5, 0.4, 0.1]))
LANDMARK, R = np.array([4.0, -1.0]), np.diag([0.01, 0.0004])


def h(x):
    d = LANDMARK - x[:2]
    return np.array([np.hypot(*d), wrap_angle(np.arctan2(d[1], d[0]) - x[2])])


def H(x):
    d = LANDMARK - x[:2]
    r = np.hypot(*d)
    return np.array([[-d[0] / r, -d[1] / r, 0], [d[1] / r**2, -d[0] / r**2, -1]])


def angle_residual(z, predicted):
    return np.array([z[0] - predicted[0], wrap_angle(z[1] - predicted[1])])


def cost(x, z):
    """Twice the negative log posterior, up to a constant: what the iterations descend."""
    a, b = x - BELIEF.mean, angle_residual(z, h(x))
    return a @ np.linalg.solve(BELIEF.cov, a) + b @ np.linalg.solve(R, b)


def test_a_linear_model_gives_the_kalman_filter():
    rng = np.random.default_rng(0)
    F, see = rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    Q, z = 0.1 * np.eye(3), np.array([0.3, -0.2])
    linear = kalman.predict(BELIEF, F, Q)
    ours = extended.predict(BELIEF, lambda x: F @ x, lambda x: F, Q)
    np.testing.assert_allclose(ours.mean, linear.mean, atol=1e-12)
    np.testing.assert_allclose(ours.cov, linear.cov, atol=1e-12)
    linear, learned = kalman.update(linear, z, see, R)
    for iterations in (1, 2, 5):
        posterior, seen = extended.update(
            ours, z, lambda x: see @ x, lambda x: see, R, iterations=iterations
        )
        np.testing.assert_allclose(posterior.mean, linear.mean, atol=1e-9)
        np.testing.assert_allclose(posterior.cov, linear.cov, atol=1e-9)
        np.testing.assert_allclose(seen.nis, learned.nis, atol=1e-9)


@pytest.mark.parametrize("iterations", [1, 2, 10])
def test_iterations_do_not_count_the_measurement_twice(iterations):
    one = [[1.0]]
    posterior, _ = extended.update(
        Gaussian([0.0], one), [2.0], lambda x: x, lambda x: one, one, iterations=iterations
    )
    np.testing.assert_allclose(posterior.cov, 0.5)
    np.testing.assert_allclose(posterior.mean, 1.0)


def test_an_update_repeated_from_its_own_posterior_counts_it_twice():
    one, twice = [[1.0]], Gaussian([0.0], [[1.0]])
    for _ in range(2):
        twice, _ = extended.update(twice, [2.0], lambda x: x, one, one)
    np.testing.assert_allclose(twice.cov, 1 / 3)


def test_iterations_find_the_peak_of_the_posterior():
    z = h(np.array([1.8, 2.6, 0.2]))
    single, _ = extended.update(BELIEF, z, h, H, R, residual=angle_residual)
    many, _ = extended.update(BELIEF, z, h, H, R, residual=angle_residual, iterations=30)
    slope = extended.numerical_jacobian(lambda x: np.array([cost(x, z)]), many.mean)
    assert np.abs(slope).max() < 1e-4 * cost(single.mean, z)
    assert cost(many.mean, z) < cost(single.mean, z)


def test_a_full_turn_of_the_bearing_changes_nothing_and_unwrapped_it_ruins_the_pose():
    behind = Gaussian([8.0, -1.0, 0.0], BELIEF.cov)
    z = h(behind.mean) + np.array([0.0, 2 * np.pi - 0.02])
    posterior, _ = extended.update(behind, z, h, H, R, residual=angle_residual)
    turned, _ = extended.update(behind, z - [0, 2 * np.pi], h, H, R, residual=angle_residual)
    np.testing.assert_allclose(posterior.mean, turned.mean, atol=1e-12)
    assert np.abs(posterior.mean - behind.mean).max() < 0.1
    wrong, learned = extended.update(behind, z, h, H, R)
    assert np.abs(wrong.mean - behind.mean).max() > 1.0
    assert learned.nis > 50


def test_the_numerical_jacobian_confirms_the_right_one_and_refutes_a_wrong_sign():
    numeric = extended.numerical_jacobian(h, BELIEF.mean)
    np.testing.assert_allclose(numeric, H(BELIEF.mean), atol=1e-8)
    coarse = extended.numerical_jacobian(h, BELIEF.mean, step=0.1)
    np.testing.assert_allclose(coarse, H(BELIEF.mean), atol=1e-2)
    wrong = H(BELIEF.mean) * [[1], [-1]]
    assert np.abs(numeric - wrong).max() > 0.1


def test_the_covariance_stays_one_over_10_000_steps():
    belief = BELIEF
    for _ in range(10_000):
        belief = extended.predict(belief, lambda x: x, np.eye(3), 1e-9 * np.eye(3))
        belief, _ = extended.update(belief, h(belief.mean), h, H, 1e-3 * R)
    np.testing.assert_array_equal(belief.cov, belief.cov.T)
    assert np.linalg.eigvalsh(belief.cov)[0] > 0


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("F", lambda: extended.predict(BELIEF, lambda x: x, np.eye(2), np.eye(3))),
        ("Q", lambda: extended.predict(BELIEF, lambda x: x, np.eye(3), -np.eye(3))),
        (r"f\(x\)", lambda: extended.predict(BELIEF, lambda x: x[:2], np.eye(3), np.eye(3))),
        ("z", lambda: extended.update(BELIEF, [np.nan, 0], h, H, R)),
        ("H", lambda: extended.update(BELIEF, [1, 0], h, lambda x: H(x).T, R)),
        ("R", lambda: extended.update(BELIEF, [1, 0], h, H, -R)),
        (r"h\(x\)", lambda: extended.update(BELIEF, [1, 0], lambda x: x, H, R)),
        ("iterations", lambda: extended.update(BELIEF, [1, 0], h, H, R, iterations=0)),
    ],
)
def test_bad_input_is_named(name, call):
    with pytest.raises(ValueError, match=rf"^{name}"):
        call()
