"""Extended filter: the linear case, Jacobians, the iterated update, and angles."""

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from slamlab.filters import extended, kalman
from slamlab.gaussian import Gaussian
from slamlab.robots import Unicycle
from slamlab.sensors import RangeBearing

MOTION, SENSOR = Unicycle(), RangeBearing(0.1, 0.02)
LANDMARK = np.array([4.0, 1.0])
BELIEF = Gaussian([0.3, -0.2, 0.4], np.diag([0.2, 0.1, 0.05]) ** 2)


def observe(x):
    return SENSOR.observe(x, LANDMARK)


def slope(x):
    return SENSOR.jacobians(x, LANDMARK)[0]


def test_a_linear_model_gives_the_kalman_filter():
    rng = np.random.default_rng(2)
    F, H = rng.standard_normal((3, 3)), rng.standard_normal((2, 3))
    Q, R, z = np.eye(3) * 0.1, np.eye(2), rng.standard_normal(2)
    due = kalman.predict(BELIEF, F, Q)
    found = extended.predict(BELIEF, lambda x: F @ x, F, Q)
    np.testing.assert_allclose(found.mean, due.mean, atol=1e-12)
    np.testing.assert_allclose(found.cov, due.cov, atol=1e-12)
    best, learned = kalman.update(due, z, H, R)
    for iterations in (1, 4):
        after, innovation = extended.update(
            found, z, lambda x: H @ x, lambda x: H, R, iterations=iterations
        )
        np.testing.assert_allclose(after.mean, best.mean, atol=1e-12)
        np.testing.assert_allclose(after.cov, best.cov, atol=1e-12)
        assert innovation.nis == pytest.approx(learned.nis)


def test_update_equals_filterpy():
    z = np.array([3.5, -0.2])
    peer = ExtendedKalmanFilter(3, 2)
    peer.x, peer.P, peer.R = BELIEF.mean.copy(), BELIEF.cov.copy(), SENSOR.cov
    peer.update(z, slope, observe)
    after, learned = extended.update(BELIEF, z, observe, slope, SENSOR.cov)
    np.testing.assert_allclose(after.mean, peer.x, atol=1e-9)
    np.testing.assert_allclose(after.cov, peer.P, atol=1e-9)
    np.testing.assert_allclose(learned.gain, peer.K, atol=1e-9)


@pytest.mark.parametrize("iterations", [1, 2, 7, 50])
def test_an_iterated_update_counts_the_measurement_once(iterations):
    prior = Gaussian([0.0], [[1.0]])
    after, _ = extended.update(
        prior, [1.0], lambda x: x, lambda x: np.eye(1), np.eye(1), iterations=iterations
    )
    assert after.cov[0, 0] == pytest.approx(0.5, abs=1e-15)
    assert after.mean[0] == pytest.approx(0.5, abs=1e-15)


def test_feeding_the_posterior_back_counts_it_again():
    belief = Gaussian([0.0], [[1.0]])
    for _ in range(2):
        belief, _ = extended.update(belief, [1.0], lambda x: x, np.eye(1), np.eye(1))
    assert belief.cov[0, 0] == pytest.approx(1 / 3)


def test_iterating_finds_the_peak_of_the_posterior():
    z = np.array([3.0, 0.5])

    def cost(x):
        gap, step = SENSOR.residual(z, observe(x)), x - BELIEF.mean
        return gap @ np.linalg.solve(SENSOR.cov, gap) + step @ np.linalg.solve(BELIEF.cov, step)

    def gradient(x):
        return np.array([(cost(x + d) - cost(x - d)) / 2e-6 for d in 1e-6 * np.eye(3)])

    once, many = (
        extended.update(
            BELIEF, z, observe, slope, SENSOR.cov, residual=SENSOR.residual, iterations=n
        )[0]
        for n in (1, 30)
    )
    assert np.abs(gradient(many.mean)).max() < 1e-3 < np.abs(gradient(once.mean)).max()


def test_a_full_turn_of_the_bearing_changes_nothing_if_the_residual_wraps():
    z = observe(BELIEF.mean) + [0.05, 0.01]
    turned = z + [0.0, 2 * np.pi]
    right = [
        extended.update(BELIEF, v, observe, slope, SENSOR.cov, residual=SENSOR.residual)[0].mean
        for v in (z, turned)
    ]
    np.testing.assert_allclose(*right, atol=1e-12)
    wrong = extended.update(BELIEF, turned, observe, slope, SENSOR.cov)[0].mean
    assert np.abs(wrong - right[0]).max() > 1.0


def test_numerical_jacobian_confirms_the_right_form_and_refutes_the_wrong():
    x, u = np.array([1.0, 2.0, 0.7]), np.array([1.2, 0.5])
    F, _ = MOTION.jacobians(x, u, 0.8)
    due = extended.numerical_jacobian(lambda x: MOTION.step(x, u, 0.8), x)
    np.testing.assert_allclose(F, due, atol=1e-8)
    assert np.abs(F.T - due).max() > 0.1
    np.testing.assert_allclose(slope(x), extended.numerical_jacobian(observe, x), atol=1e-7)


def test_a_callable_jacobian_is_taken_before_the_step():
    seen = []

    def F(x):
        seen.append(x.copy())
        return np.eye(3)

    extended.predict(BELIEF, lambda x: x + 1.0, F, np.eye(3))
    np.testing.assert_array_equal(seen, [BELIEF.mean])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: extended.predict(BELIEF, lambda x: x, np.eye(2), np.eye(3)), "F: expected shape"),
        (lambda: extended.predict(BELIEF, lambda x: x[:2], np.eye(3), np.eye(3)), r"f\(x\): expe"),
        (lambda: extended.update(BELIEF, [1.0], observe, slope, np.eye(1)), "H: expected shape"),
        (
            lambda: extended.update(BELIEF, [1.0, np.nan], observe, slope, np.eye(2)),
            "z: expected finite",
        ),
        (
            lambda: extended.update(BELIEF, [1.0, 0], observe, slope, np.eye(2), iterations=0),
            "iterations: expected at least 1",
        ),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
