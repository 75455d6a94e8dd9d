"""Unscented Kalman filter: filterpy's as second opinion, reduction to the linear one, angles."""

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from slamlab.filters import kalman, unscented
from slamlab.gaussian import Gaussian
from slamlab.geometry import wrap_angle

BELIEF = Gaussian([1.0, 2.0, 0.5], [[0.5, 0.1, 0], [0.1, 0.4, 0.05], [0, 0.05, 0.1]])
Q, R = np.diag([0.02, 0.01, 0.005]), np.diag([0.01, 0.02])
SCALING = [
    {"alpha": 0.5, "beta": 2.0, "kappa": 0.0},
    {"alpha": 0.1, "beta": 2.0, "kappa": 1.0},
    {"alpha": 1.0, "beta": 0.0, "kappa": -1.0},
]


def f(x):
    return np.array([x[0] + 0.3 * np.cos(x[2]), x[1] + 0.3 * np.sin(x[2]), x[2] + 0.1])


def h(x):
    return np.array([np.hypot(x[0] - 6, x[1] + 1), x[0] * x[1]])


@pytest.mark.parametrize("scaling", SCALING)
def test_predict_and_update_agree_with_filterpy(scaling):
    points = MerweScaledSigmaPoints(3, **scaling)
    peer = UnscentedKalmanFilter(3, 2, 1.0, lambda x: h(x), lambda x, dt: f(x), points)
    peer.x, peer.P, peer.Q, peer.R = BELIEF.mean.copy(), BELIEF.cov.copy(), Q, R
    belief, z = BELIEF, np.array([5.0, 3.0])
    for _ in range(5):
        belief = unscented.predict(belief, f, Q, **scaling)
        peer.predict()
        np.testing.assert_allclose(belief.mean, peer.x, atol=1e-9)
        np.testing.assert_allclose(belief.cov, peer.P, atol=1e-9)
        belief, learned = unscented.update(belief, z, h, R, **scaling)
        peer.update(z)
        np.testing.assert_allclose(belief.mean, peer.x, atol=1e-9)
        np.testing.assert_allclose(belief.cov, peer.P, atol=1e-9)
        np.testing.assert_allclose(learned.gain, peer.K, atol=1e-9)
        np.testing.assert_allclose(learned.S, peer.S, atol=1e-9)


@pytest.mark.parametrize("scaling", SCALING)
def test_sigma_points_carry_mean_and_covariance(scaling):
    points, w_mean, w_cov = unscented.sigma_points(BELIEF, **scaling)
    assert points.shape == (7, 3)
    np.testing.assert_allclose(w_mean.sum(), 1)
    np.testing.assert_allclose(w_mean @ points, BELIEF.mean, atol=1e-12)
    d = points - BELIEF.mean
    np.testing.assert_allclose((d * w_cov[:, None]).T @ d, BELIEF.cov, atol=1e-12)


def test_a_linear_model_gives_the_kalman_filter():
    rng = np.random.default_rng(0)
    F, H = rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    ours = unscented.predict(BELIEF, lambda x: F @ x, Q)
    linear = kalman.predict(BELIEF, F, Q)
    np.testing.assert_allclose(ours.cov, linear.cov, atol=1e-9)
    ours, seen = unscented.update(ours, [1, 2], lambda x: H @ x, R)
    linear, learned = kalman.update(linear, [1, 2], H, R)
    np.testing.assert_allclose(ours.mean, linear.mean, atol=1e-9)
    np.testing.assert_allclose(ours.cov, linear.cov, atol=1e-9)
    np.testing.assert_allclose(seen.log_likelihood, learned.log_likelihood, atol=1e-9)


def test_bearings_across_the_cut_need_their_residual():
    behind = Gaussian([-3.0, 0.0], np.diag([0.1, 0.2]))

    def bearing(x):
        return np.array([np.arctan2(x[1], x[0])])

    def residual(z, predicted):
        return wrap_angle(z - predicted)

    z = [-np.pi + 0.02]
    right, learned = unscented.update(behind, z, bearing, [[0.01]], residual=residual)
    wrong, _ = unscented.update(behind, z, bearing, [[0.01]])
    assert abs(learned.innovation[0]) < 0.1
    assert abs(right.mean[1] + 0.06) < 0.05
    # Torn at the cut, the points see noise of 2 pi and the measurement teaches nothing.
    assert abs(wrong.mean[1]) < 0.01
    assert wrong.cov[1, 1] > 2 * right.cov[1, 1]


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("alpha", lambda: unscented.sigma_points(BELIEF, alpha=0.0)),
        ("kappa", lambda: unscented.sigma_points(BELIEF, kappa=-3.0)),
        ("belief", lambda: unscented.sigma_points(Gaussian(np.zeros(2), np.zeros((2, 2))))),
        ("Q", lambda: unscented.predict(BELIEF, f, -Q)),
        (r"f\(x\)", lambda: unscented.predict(BELIEF, lambda x: x[:2], Q)),
        ("z", lambda: unscented.update(BELIEF, [np.inf, 0], h, R)),
        ("R", lambda: unscented.update(BELIEF, [0, 0], h, np.eye(3))),
        (r"h\(x\)", lambda: unscented.update(BELIEF, [0, 0], lambda x: x, R)),
    ],
)
def test_bad_input_is_named(name, call):
    with pytest.raises(ValueError, match=rf"^{name}"):
        call()
