"""Kalman filter: against filterpy and closed forms, and the wrong forms students write."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from slamlab.evaluation import chi2_band, nees
from slamlab.filters import kalman
from slamlab.gaussian import Gaussian


def random_cov(rng, n, scale=1.0):
    A = rng.standard_normal((n, n))
    return scale * (A @ A.T + 0.1 * np.eye(n))


def model(seed, n=4, m=2):
    """A random model, belief and measurement."""
    rng = np.random.default_rng(seed)
    F = np.eye(n) + 0.3 * rng.standard_normal((n, n))
    H = rng.standard_normal((m, n))
    Q, R = random_cov(rng, n, 0.1), random_cov(rng, m)
    return Gaussian(rng.standard_normal(n), random_cov(rng, n)), F, Q, H, R, rng


def test_predict_and_update_equal_filterpy():
    belief, F, Q, H, R, rng = model(1)
    B = rng.standard_normal((4, 2))
    peer = KalmanFilter(4, 2, 2)
    peer.x, peer.P, peer.F, peer.Q, peer.H, peer.R, peer.B = (
        belief.mean.copy(), belief.cov.copy(), F, Q, H, R, B,
    )  # fmt: skip
    for _ in range(50):
        u, z = rng.standard_normal(2), rng.standard_normal(2)
        belief = kalman.predict(belief, F, Q, B, u)
        belief, learned = kalman.update(belief, z, H, R)
        peer.predict(u)
        peer.update(z)
        np.testing.assert_allclose(belief.mean, peer.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.cov, peer.P, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(learned.cov, peer.S, rtol=1e-9)
        np.testing.assert_allclose(learned.gain, peer.K, rtol=1e-9, atol=1e-12)
        assert learned.log_likelihood == pytest.approx(peer.log_likelihood, rel=1e-9)
        white = np.linalg.solve(learned.cov, learned.residual)
        assert learned.nis == pytest.approx(learned.residual @ white)


@pytest.mark.parametrize("seed", range(5))
def test_gain_joseph_and_information_form_agree(seed):
    belief, _, _, H, R, rng = model(seed)
    posterior, learned = kalman.update(belief, rng.standard_normal(2), H, R)
    P, K, S = belief.cov, learned.gain, learned.cov
    np.testing.assert_allclose(posterior.cov, P - K @ S @ K.T, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(posterior.cov, (np.eye(4) - K @ H) @ P, rtol=1e-9, atol=1e-9)
    information = np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H
    np.testing.assert_allclose(posterior.cov, np.linalg.inv(information), rtol=1e-9, atol=1e-9)
    # Joseph's form holds for a gain that is not optimal, (I - K H) P does not.
    L = K + 0.1
    A = np.eye(4) - L @ H
    joseph = A @ P @ A.T + L @ R @ L.T
    assert np.linalg.eigvalsh(joseph - posterior.cov)[0] > -1e-9
    assert np.abs(A @ P - joseph).max() > 1e-3


def test_sequential_and_joint_updates_agree():
    belief, _, _, H, _, rng = model(7)
    R, z = np.diag([0.5, 2.0]), rng.standard_normal(2)
    joint, _ = kalman.update(belief, z, H, R)
    one, _ = kalman.update(belief, z[:1], H[:1], R[:1, :1])
    two, _ = kalman.update(one, z[1:], H[1:], R[1:, 1:])
    np.testing.assert_allclose(two.mean, joint.mean, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(two.cov, joint.cov, rtol=1e-12, atol=1e-12)


def test_a_batch_equals_its_members():
    belief, F, Q, H, R, rng = model(3)
    means, zs = rng.standard_normal((6, 4)), rng.standard_normal((6, 2))
    batch = Gaussian(means, np.broadcast_to(belief.cov, (6, 4, 4)))
    batch, learned = kalman.update(kalman.predict(batch, F, Q), zs, H, R)
    for k in range(6):
        single = kalman.predict(Gaussian(means[k], belief.cov), F, Q)
        single, innovation = kalman.update(single, zs[k], H, R)
        np.testing.assert_allclose(batch.mean[k], single.mean, atol=1e-12)
        np.testing.assert_allclose(batch.cov[k], single.cov, atol=1e-12)
        assert learned.nis[k] == pytest.approx(innovation.nis)


def test_scalar_riccati_has_its_closed_form():
    q, r = 0.3, 2.0
    steady = kalman.steady_state(np.eye(1), np.eye(1), [[q]], [[r]])
    due = 0.5 * (q + np.sqrt(q * q + 4 * q * r))
    assert steady.predicted_cov[0, 0] == pytest.approx(due, rel=1e-12)
    assert steady.cov[0, 0] == pytest.approx(due - q, rel=1e-12)


def test_constant_velocity_settles_at_the_alpha_beta_gain():
    dt, sigma_a, sigma_z = 0.5, 0.4, 1.5
    F, H = np.array([[1, dt], [0, 1]]), np.array([[1.0, 0]])
    G = np.array([dt**2 / 2, dt])
    gain = kalman.steady_state(F, H, sigma_a**2 * np.outer(G, G), [[sigma_z**2]]).gain
    # Kalata's tracking index and his closed form.
    index = sigma_a * dt**2 / sigma_z
    r = (4 + index - np.sqrt(8 * index + index**2)) / 4
    alpha = 1 - r**2
    beta = 2 * (2 - alpha) - 4 * np.sqrt(1 - alpha)
    assert gain[:, 0] == pytest.approx([alpha, beta / dt], rel=1e-9)


def test_the_filter_settles_at_the_steady_state():
    belief, F, Q, H, R, _ = model(2)
    F = F / (1.1 * np.abs(np.linalg.eigvals(F)).max())
    steady = kalman.steady_state(F, H, Q, R)
    for _ in range(400):
        belief, learned = kalman.update(kalman.predict(belief, F, Q), np.zeros(2), H, R)
    np.testing.assert_allclose(belief.cov, steady.cov, rtol=1e-9)
    np.testing.assert_allclose(learned.gain, steady.gain, rtol=1e-9, atol=1e-12)


def ill_conditioned(dtype):
    """Ten thousand updates with a sensor far sharper than the prior."""
    cov = np.diag([1e6, 1.0, 1e-4]).astype(dtype)
    H = np.array([[1.0, 1.0, 1.0], [1.0, 1.0 + 1e-4, 1.0]], dtype=dtype)
    return cov, H, np.eye(2, dtype=dtype) * dtype(1e-4)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_ten_thousand_ill_conditioned_steps_leave_a_covariance(dtype):
    cov, H, R = ill_conditioned(dtype)
    F = np.array([[1, 0.1, 0], [0, 1, 0.1], [0, 0, 1]], dtype=dtype)
    belief = Gaussian(np.zeros(3, dtype), cov)
    for _ in range(10_000):
        belief = kalman.predict(belief, F, np.eye(3, dtype=dtype) * dtype(1e-8))
        belief, _ = kalman.update(belief, np.zeros(2, dtype), H, R)
    np.testing.assert_array_equal(belief.cov, belief.cov.T)
    scale = np.abs(belief.cov).max()
    assert np.linalg.eigvalsh(belief.cov.astype(float))[0] > -1e-6 * scale


@settings(max_examples=50, derandomize=True, deadline=None)
@given(st.integers(0, 10_000), st.floats(1e-6, 1e6))
def test_an_update_never_adds_uncertainty(seed, scale):
    belief, _, _, H, R, rng = model(seed)
    posterior, _ = kalman.update(belief, rng.standard_normal(2), H, R * scale)
    gap = np.linalg.eigvalsh(belief.cov - posterior.cov)[0]
    assert gap > -1e-9 * np.abs(belief.cov).max()
    np.testing.assert_array_equal(posterior.cov, posterior.cov.T)


def runs(step, n_runs=200, steps=40):
    """Mean NEES of many runs of a constant-velocity robot, by a given filter step."""
    rng = np.random.default_rng(9)
    F = np.array([[1, 0.5], [0, 1]])
    Q, H, R = np.diag([0.01, 0.04]), np.array([[1.0, 0.0]]), np.array([[0.25]])
    x = rng.multivariate_normal(np.zeros(2), np.eye(2), n_runs)
    means, cov, scores = np.zeros((n_runs, 2)), np.eye(2), []
    for _ in range(steps):
        x = x @ F.T + rng.multivariate_normal(np.zeros(2), Q, n_runs)
        z = x @ H.T + 0.5 * rng.standard_normal((n_runs, 1))
        means, cov = step(means, cov, z, F, Q, H, R)
        scores.append(nees(means - x, np.broadcast_to(cov, (n_runs, 2, 2))).mean())
    return np.mean(scores[-20:])


def right(means, cov, z, F, Q, H, R):
    n = len(means)
    belief = Gaussian(means, np.broadcast_to(cov, (n, 2, 2)))
    belief, _ = kalman.update(kalman.predict(belief, F, Q), z, H, R)
    return belief.mean, belief.cov[0]


def by_hand(F_right=None, gain=lambda K: K, predictions=1):
    """The same filter, with a slip of the pen."""

    def step(means, cov, z, F, Q, H, R):
        for _ in range(predictions):
            means, cov = means @ F.T, F @ cov @ (F.T if F_right is None else F_right(F)) + Q
        K = gain(cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R))
        A = np.eye(2) - K @ H
        return means + (z - means @ H.T) @ K.T, A @ cov @ A.T + K @ R @ K.T

    return step


def test_the_filter_is_consistent_and_the_slips_are_not():
    low, high = chi2_band(2, 200)
    found = runs(right)
    assert low < found < high
    assert runs(by_hand()) == pytest.approx(found, rel=1e-9)
    assert runs(by_hand(predictions=2)) > high


def test_wrong_forms_give_other_covariances():
    belief, F, Q, H, R, rng = model(5)
    due = kalman.predict(belief, F, Q).cov
    assert np.abs(F @ belief.cov @ F + Q - due).max() > 0.1
    assert np.abs(F.T @ belief.cov @ F + Q - due).max() > 0.1
    _, learned = kalman.update(belief, rng.standard_normal(2), H, R)
    with pytest.raises(ValueError, match="broadcast"):
        learned.gain + R  # P1 (34): the shapes do not even fit
    with pytest.raises(ValueError, match="matmul"):
        learned.gain.T @ learned.residual  # the transposed gain


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda b: kalman.predict(b, np.eye(3), np.eye(2)), "F: expected shape"),
        (lambda b: kalman.predict(b, np.eye(2), -np.eye(2)), "Q: expected a positive semi"),
        (lambda b: kalman.predict(b, np.eye(2), np.eye(2), B=np.eye(2)), "u: expected B and u"),
        (lambda b: kalman.predict(b, np.eye(2), np.eye(2), u=[1, 2]), "B: expected B and u"),
        (lambda b: kalman.update(b, [np.nan], np.eye(2)[:1], np.eye(1)), "z: expected finite"),
        (lambda b: kalman.update(b, [1.0, 2.0], np.eye(2)[:1], np.eye(1)), "H: expected shape"),
        (
            lambda b: kalman.update(b, [1.0], np.eye(2)[:1], [[-1.0]]),
            "R: expected a positive semi",
        ),
        (
            lambda b: kalman.update(b, [1.0], np.zeros((1, 2)), [[0.0]]),
            "R: expected an innovation",
        ),
        (lambda b: kalman.steady_state(2 * np.eye(1), [[0.0]], [[1.0]], [[1.0]]), "do not settle"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(Gaussian(np.zeros(2), np.eye(2)))
