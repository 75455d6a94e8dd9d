"""Unscented filter: against filterpy, the linear case, and moments."""

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from slamlab.filters import kalman, unscented
from slamlab.gaussian import Gaussian
from slamlab.robots import Unicycle
from slamlab.sensors import RangeBearing

MOTION, SENSOR = Unicycle(), RangeBearing(0.1, 0.02)
LANDMARK, U = np.array([4.0, 1.0]), np.array([1.0, 0.3])
BELIEF = Gaussian([0.3, -0.2, 0.4], np.diag([0.2, 0.1, 0.05]) ** 2)
SCALING = {"alpha": 0.3, "beta": 2.0, "kappa": 0.5}


def move(x):
    return MOTION.step(x, U, 0.5)


def observe(x):
    return SENSOR.observe(x, LANDMARK)


def test_points_carry_mean_and_covariance():
    points, w_mean, w_cov = unscented.sigma_points(BELIEF, **SCALING)
    assert points.shape == (7, 3)
    assert w_mean.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(w_mean @ points, BELIEF.mean, atol=1e-12)
    d = points - BELIEF.mean
    np.testing.assert_allclose((d * w_cov[:, None]).T @ d, BELIEF.cov, atol=1e-12)


def test_steps_equal_filterpy():
    points = MerweScaledSigmaPoints(3, SCALING["alpha"], SCALING["beta"], SCALING["kappa"])
    peer = UnscentedKalmanFilter(3, 2, 0.5, observe, lambda x, dt: move(x), points)
    peer.x, peer.P = BELIEF.mean.copy(), BELIEF.cov.copy()
    peer.Q, peer.R = np.eye(3) * 1e-3, SENSOR.cov
    belief, rng = BELIEF, np.random.default_rng(3)
    for _ in range(10):
        z = observe(belief.mean) + 0.05 * rng.standard_normal(2)
        peer.predict()
        # filterpy keeps the points of the prediction; ours are drawn anew with Q in them.
        belief = unscented.predict(belief, move, peer.Q, **SCALING)
        np.testing.assert_allclose(belief.mean, peer.x, atol=1e-9)
        np.testing.assert_allclose(belief.cov, peer.P, atol=1e-9)
        peer.sigmas_f = points.sigma_points(peer.x, peer.P)
        peer.update(z)
        belief, _ = unscented.update(belief, z, observe, SENSOR.cov, **SCALING)
        np.testing.assert_allclose(belief.mean, peer.x, atol=1e-9)
        np.testing.assert_allclose(belief.cov, peer.P, atol=1e-9)


def test_a_linear_model_gives_the_kalman_filter():
    rng = np.random.default_rng(2)
    F, H = rng.standard_normal((3, 3)), rng.standard_normal((2, 3))
    Q, R, z = np.eye(3) * 0.1, np.eye(2), rng.standard_normal(2)
    due, _ = kalman.update(kalman.predict(BELIEF, F, Q), z, H, R)
    found = unscented.predict(BELIEF, lambda x: F @ x, Q)
    found, _ = unscented.update(found, z, lambda x: H @ x, R)
    np.testing.assert_allclose(found.mean, due.mean, atol=1e-10)
    np.testing.assert_allclose(found.cov, due.cov, atol=1e-10)


def test_the_mean_of_a_square_is_exact_where_the_tangent_is_blind():
    belief = Gaussian([1.0], [[0.25]])
    moved = unscented.predict(belief, lambda x: x**2, np.zeros((1, 1)))
    assert moved.mean[0] == pytest.approx(1.25)
    assert moved.cov[0, 0] == pytest.approx(4 * 0.25 + 2 * 0.25**2)


def test_angles_across_the_back_do_not_tear():
    behind = Gaussian([0.0, 0.0, np.pi - 0.37], BELIEF.cov)
    landmark = np.array([4.0, -1.5])
    z = SENSOR.observe([0.05, 0.0, np.pi - 0.3], landmark)

    def h(x):
        return SENSOR.observe(x, landmark)

    right, learned = unscented.update(behind, z, h, SENSOR.cov, residual=SENSOR.residual)
    _, torn = unscented.update(behind, z, h, SENSOR.cov)
    assert abs(right.mean[2] - (np.pi - 0.3)) < 0.1
    # The spread of the predicted bearings is a tenth of a radian, torn it is radians.
    assert learned.cov[1, 1] < 0.1 < 1.0 < torn.cov[1, 1]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: unscented.sigma_points(Gaussian([0.0], [[0.0]])), "positive definite"),
        (lambda: unscented.sigma_points(BELIEF, alpha=0.0), "alpha: expected a number"),
        (lambda: unscented.sigma_points(BELIEF, kappa=-3.0), "kappa: expected a number"),
        (lambda: unscented.predict(BELIEF, move, np.eye(2)), "Q: expected shape"),
        (lambda: unscented.update(BELIEF, [np.nan, 0], observe, SENSOR.cov), "z: expected finite"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
