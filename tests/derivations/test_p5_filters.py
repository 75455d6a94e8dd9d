"""P5 (1)-(13) and P2 (6)-(11): each formula against its derivation, beside the wrong forms.

The oracle knows no Kalman filter: it writes state and measurement as linear maps of independent
noises, multiplies out their joint covariance, and conditions by the density's exponent.
"""

import numpy as np
import pytest
import sympy as sp
from scipy import stats

from slamlab.filters import extended, kalman
from slamlab.gaussian import Gaussian
from slamlab.geometry import wrap_angle
from slamlab.robots import Unicycle
from slamlab.sensors import RangeBearing

F = np.array([[1.0, 0.4, 0.1], [-0.2, 0.9, 0.3], [0.0, 0.5, 1.1]])
H = np.array([[1.0, 0.5, -0.3], [0.2, -1.0, 0.7]])
Q = np.array([[0.3, 0.1, 0.0], [0.1, 0.4, 0.05], [0.0, 0.05, 0.2]])
R = np.array([[0.5, 0.2], [0.2, 0.6]])
B, U = np.array([[0.5], [1.0], [-0.4]]), np.array([0.7])
START = Gaussian([1.0, -2.0, 0.5], [[1.0, 0.3, 0.1], [0.3, 0.8, -0.2], [0.1, -0.2, 0.6]])
Z = np.array([0.4, 1.3])


def joint_after_motion_and_measurement():
    """Mean and covariance of (x_k, z_k) from (1), (2): maps of (x_k-1, w_k, v_k)."""
    to_x = np.hstack([F, np.eye(3), np.zeros((3, 2))])
    to_z = np.hstack([H @ F, H, np.eye(2)])
    noise = np.zeros((8, 8))
    noise[:3, :3], noise[3:6, 3:6], noise[6:, 6:] = START.cov, Q, R
    maps = np.vstack([to_x, to_z])
    x = F @ START.mean + B @ U
    return np.concatenate([x, H @ x]), maps @ noise @ maps.T


def conditioned():
    """Complete the square in x: the exponent's quadratic part is the posterior information."""
    mean, cov = joint_after_motion_and_measurement()
    W = np.linalg.inv(cov)
    posterior = np.linalg.inv(W[:3, :3])
    return mean[:3] - posterior @ W[:3, 3:] @ (Z - mean[3:]), posterior


def differs(a, b):
    return np.abs(np.asarray(a) - b).max() > 0.01


PRIOR = kalman.predict(START, F, Q, B, U)
POSTERIOR, LEARNED = kalman.update(PRIOR, Z, H, R)


def test_3_and_4_are_the_moments_of_1():
    mean, cov = joint_after_motion_and_measurement()
    np.testing.assert_allclose(PRIOR.mean, mean[:3], atol=1e-12)
    np.testing.assert_allclose(PRIOR.cov, cov[:3, :3], atol=1e-12)


@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param(F @ START.cov @ F + Q, id="F P F"),
        pytest.param(F.T @ START.cov @ F + Q, id="F^T P F"),
        pytest.param(F @ START.cov @ F.T, id="Q forgotten"),
        pytest.param(kalman.predict(PRIOR, F, Q).cov, id="predicted twice"),
    ],
)
def test_wrong_forms_of_4_fail(wrong):
    _, cov = joint_after_motion_and_measurement()
    assert differs(wrong, cov[:3, :3])


def test_5_and_6_are_the_moments_of_2():
    mean, cov = joint_after_motion_and_measurement()
    np.testing.assert_allclose(LEARNED.innovation, Z - mean[3:], atol=1e-12)
    np.testing.assert_allclose(LEARNED.S, cov[3:, 3:], atol=1e-12)
    assert differs(PRIOR.cov[:2, :2] + R, cov[3:, 3:]), "H forgotten"


def test_7_to_9_complete_the_square():
    mean, cov = conditioned()
    np.testing.assert_allclose(POSTERIOR.mean, mean, atol=1e-12)
    np.testing.assert_allclose(POSTERIOR.cov, cov, atol=1e-12)
    K = LEARNED.gain
    np.testing.assert_allclose((np.eye(3) - K @ H) @ PRIOR.cov, cov, atol=1e-12)
    # P2 (10), (11)
    np.testing.assert_allclose(PRIOR.cov - K @ LEARNED.S @ K.T, cov, atol=1e-12)


@pytest.mark.parametrize(
    "gain",
    [
        pytest.param(LEARNED.gain + np.pad(R, ((0, 1), (0, 0))), id="R added to K"),
        pytest.param(LEARNED.gain.T.reshape(3, 2), id="transposed gain"),
        pytest.param(PRIOR.cov @ H.T @ LEARNED.S, id="S not inverted"),
        pytest.param(PRIOR.cov @ H.T @ np.linalg.inv(R), id="R for S"),
    ],
)
def test_wrong_gains_fail_in_mean_and_covariance(gain):
    mean, cov = conditioned()
    assert differs(PRIOR.mean + gain @ LEARNED.innovation, mean)
    assert differs((np.eye(3) - gain @ H) @ PRIOR.cov, cov)
    # Joseph's form holds for any gain, and so tells what a wrong one costs.
    keep = np.eye(3) - gain @ H
    joseph = keep @ PRIOR.cov @ keep.T + gain @ R @ gain.T
    assert np.trace(joseph) > np.trace(cov) + 0.01


def test_the_sign_of_the_innovation_and_a_second_prediction_matter():
    mean, cov = conditioned()
    assert differs(PRIOR.mean - LEARNED.gain @ LEARNED.innovation, mean)
    twice, _ = kalman.update(kalman.predict(PRIOR, F, Q, B, U), Z, H, R)
    assert differs(twice.mean, mean)
    assert differs(twice.cov, cov)


def test_7_minimises_the_trace_of_joseph_symbolically():
    p, q, c, r, k1, k2 = sp.symbols("p q c r k1 k2", real=True)
    P, see, K = sp.Matrix([[p, c], [c, q]]), sp.Matrix([[1, 0]]), sp.Matrix([k1, k2])
    keep = sp.eye(2) - K * see
    joseph = keep * P * keep.T + K * r * K.T
    trace = sp.expand(joseph.trace())
    best = sp.solve([sp.diff(trace, k) for k in (k1, k2)], [k1, k2], dict=True)[0]
    formula = P * see.T / (p + r)
    assert sp.simplify(sp.Matrix([best[k1], best[k2]]) - formula) == sp.zeros(2, 1)
    short = (sp.eye(2) - formula * see) * P
    assert sp.simplify(joseph.subs(best) - short) == sp.zeros(2, 2)
    # With any other gain the short form (9) is not the covariance.
    assert sp.simplify((joseph - keep * P).subs({k1: 1, k2: 0})) != sp.zeros(2, 2)


def test_9_completes_the_square_symbolically():
    x, m, z = sp.symbols("x m z", real=True)
    p, r = sp.symbols("p r", positive=True)
    K = p / (p + r)
    exponent = (x - m) ** 2 / p + (z - x) ** 2 / r
    peak = (x - m - K * (z - m)) ** 2 / ((1 - K) * p)
    assert sp.simplify(sp.diff(exponent - peak, x)) == 0
    wrong = (x - m - K * (z - m)) ** 2 / ((1 + K) * p)
    assert sp.simplify(sp.diff(exponent - wrong, x)) != 0


# --- extended: (10)-(13), P2 (8)-(11) ---

MOTION, SENSOR = Unicycle(), RangeBearing(0.1, 0.05)
CONTROL, LANDMARK = np.array([1.0, 0.4]), np.array([-3.0, 0.4])
POSE = Gaussian([0.3, -0.2, 0.6], np.diag([0.02, 0.01, 0.005]))


def move(x):
    return MOTION.step(x, CONTROL, 0.5)


def see(x):
    return SENSOR.observe(x, LANDMARK)


def test_10_and_12_push_mean_and_tangent():
    F_x, _ = MOTION.jacobians(POSE.mean, CONTROL, 0.5)
    prior = extended.predict(POSE, move, F_x, 0.1 * np.eye(3))
    tangent = extended.numerical_jacobian(move, POSE.mean)
    np.testing.assert_allclose(prior.mean, move(POSE.mean))
    np.testing.assert_allclose(prior.cov, tangent @ POSE.cov @ tangent.T + 0.1 * np.eye(3), 1e-6)
    # (12) is taken before the step: a tangent at the predicted pose is another one.
    late = extended.numerical_jacobian(move, prior.mean)
    assert differs(late, tangent)
    assert differs(F_x @ POSE.mean, prior.mean), "the mean goes through f, not through F"


def test_13_is_taken_at_the_prediction_and_11_is_wrapped():
    H_pose, _ = SENSOR.jacobians(POSE.mean, LANDMARK)
    np.testing.assert_allclose(H_pose, extended.numerical_jacobian(see, POSE.mean), atol=1e-7)
    facing = Gaussian([0.3, -0.2, 0.0], POSE.cov)
    truth = see(facing.mean)
    z = np.array([truth[0], wrap_angle(truth[1] + 0.3)])
    assert abs(z[1] - truth[1]) > np.pi, "the bearing crosses the cut"

    def wrapped(z, predicted):
        return np.array([z[0] - predicted[0], wrap_angle(z[1] - predicted[1])])

    def tangent(x):
        return SENSOR.jacobians(x, LANDMARK)[0]

    noise = np.diag([0.01, 0.0025])
    right, learned = extended.update(facing, z, see, tangent, noise, residual=wrapped)
    wrong, _ = extended.update(facing, z, see, tangent, noise)
    np.testing.assert_allclose(learned.innovation, [0.0, 0.3], atol=1e-12)
    assert np.abs(wrap_angle(see(right.mean)[1] - z[1])) < 0.2
    assert np.abs(wrap_angle(see(wrong.mean)[1] - z[1])) > 1.0


def test_4_and_9_serve_the_extended_filter_unchanged():
    prior = extended.predict(START, lambda x: F @ x + B @ U, lambda x: F, Q)
    posterior, _ = extended.update(prior, Z, lambda x: H @ x, lambda x: H, R)
    mean, cov = conditioned()
    np.testing.assert_allclose(posterior.mean, mean, atol=1e-12)
    np.testing.assert_allclose(posterior.cov, cov, atol=1e-12)


# --- P2 (6), (7): a density and a map with noise are two ways to say one thing ---


def test_p2_6_and_7_name_the_same_distribution():
    rng, n = np.random.default_rng(3), 20_000
    z = see(POSE.mean) + rng.standard_normal((n, 2)) * [0.1, 0.05]
    moved = MOTION.sample(np.tile(POSE.mean, (n, 1)), CONTROL, 0.5, np.zeros((2, 2)), rng)
    x = moved + 0.1 * rng.standard_normal((n, 3))
    for samples, centre, sigma in (
        (z, see(POSE.mean), np.array([0.1, 0.05])),
        (x, move(POSE.mean), np.full(3, 0.1)),
    ):
        for column, middle, spread in zip(samples.T, centre, sigma, strict=True):
            assert stats.kstest(column, stats.norm(middle, spread).cdf).pvalue > 1e-3
            # "=" instead of "corresponds to" would take the density's value for the state.
            assert stats.kstest(stats.norm(middle, spread).pdf(column), "norm").pvalue < 1e-9


def test_p2_9_moves_the_cross_block_too():
    # Static landmark, so P_mm stays; but the robot's error turns, and its tie with the map turns.
    F_x, _ = MOTION.jacobians(POSE.mean, CONTROL, 0.5)
    whole = np.zeros((5, 5))
    root = np.random.default_rng(0).standard_normal((5, 5))
    whole[:] = root @ root.T
    F_all = np.eye(5)
    F_all[:3, :3] = F_x
    belief = Gaussian(np.concatenate([POSE.mean, LANDMARK]), whole)
    noise = np.zeros((5, 5))
    noise[:3, :3] = 0.1 * np.eye(3)
    moved = extended.predict(belief, lambda x: np.concatenate([move(x[:3]), x[3:]]), F_all, noise)
    np.testing.assert_allclose(moved.cov[:3, 3:], F_x @ whole[:3, 3:], atol=1e-14)
    np.testing.assert_allclose(moved.cov[3:, 3:], whole[3:, 3:], atol=1e-14)
    forgotten = moved.cov.copy()
    forgotten[:3, 3:], forgotten[3:, :3] = whole[:3, 3:], whole[3:, :3]
    assert np.linalg.eigvalsh(moved.cov).min() > 0
    assert differs(forgotten, moved.cov)
