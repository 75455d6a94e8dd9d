"""Kalman filter: filterpy and closed forms as second opinions, properties, bad input."""

import filterpy.kalman
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from slamlab.filters import kalman
from slamlab.gaussian import Gaussian

DT = 0.1
F = np.eye(4) + DT * np.eye(4, k=2)
H = np.array([[1.0, 0, 0, 0], [0.2, 1.0, 0, 0.1]])
Q = 0.3 * np.kron([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]], np.eye(2))
R = np.array([[0.25, 0.1], [0.1, 0.36]])
START = Gaussian(np.array([1.0, -1.0, 0.5, 0.0]), np.diag([10.0, 5.0, 2.0, 1.0]))
B = np.array([[0.0], [0.005], [0.1], [0.2]])
properties = settings(derandomize=True, deadline=None, max_examples=40)


def series(*shape, seed=3):
    rng = np.random.default_rng(seed)
    return np.cumsum(0.3 * rng.normal(size=(*shape, 2)), -2)


def random_case(seed, n=4, m=2):
    rng = np.random.default_rng(seed)
    root, noise = rng.normal(size=(n, n)), rng.normal(size=(m, m))
    belief = Gaussian(rng.normal(size=n), root @ root.T + 0.1 * np.eye(n))
    return belief, rng.normal(size=m), rng.normal(size=(m, n)), noise @ noise.T + 0.5 * np.eye(m)


def by_single_steps(z, F, H, Q, R, belief, B=None, u=None):
    """The same filter, a step at a time, missing components struck from H and R."""
    means, covs, log_likelihood = [], [], 0.0
    for k, row in enumerate(z):
        control = () if B is None else (B, u[k])
        belief = kalman.predict(belief, F if np.ndim(F) == 2 else F[k], Q, *control)
        seen = ~np.isnan(row)
        if seen.any():
            part = np.ix_(seen, seen)
            belief, learned = kalman.update(belief, row[seen], H[seen], R[part])
            log_likelihood += learned.log_likelihood
        means.append(belief.mean)
        covs.append(belief.cov)
    return np.array(means), np.array(covs), log_likelihood


def peer():
    kf = filterpy.kalman.KalmanFilter(dim_x=4, dim_z=2)
    kf.x, kf.P = START.mean.copy(), START.cov.copy()
    kf.F, kf.H, kf.Q, kf.R = F, H, Q, R
    return kf


# --- second opinions ---


def test_single_steps_agree_with_filterpy():
    kf, belief = peer(), START
    for z in series(50):
        kf.predict(u=np.array([0.3]), B=B)
        kf.update(z)
        belief = kalman.predict(belief, F, Q, B, [0.3])
        belief, learned = kalman.update(belief, z, H, R)
        np.testing.assert_allclose(belief.mean, kf.x, atol=1e-9)
        np.testing.assert_allclose(belief.cov, kf.P, atol=1e-9)
        np.testing.assert_allclose(learned.gain, kf.K, atol=1e-9)
        np.testing.assert_allclose(learned.S, kf.S, atol=1e-9)
        np.testing.assert_allclose(learned.innovation, kf.y, atol=1e-9)
        np.testing.assert_allclose(learned.log_likelihood, kf.log_likelihood, atol=1e-9)
        np.testing.assert_allclose(learned.nis, kf.mahalanobis**2, atol=1e-9)


def test_filter_and_smoother_agree_with_filterpy():
    z, kf = series(800), peer()
    result = kalman.filter(z, F, H, Q, R, START)
    means, covs, predicted_means, predicted_covs = kf.batch_filter(z)
    np.testing.assert_allclose(result.means, means, atol=1e-9)
    np.testing.assert_allclose(result.covs, covs, atol=1e-9)
    np.testing.assert_allclose(result.predicted_means, predicted_means, atol=1e-9)
    np.testing.assert_allclose(result.predicted_covs, predicted_covs, atol=1e-9)
    smoothed = kalman.smooth(result)
    means, covs, _, _ = kf.rts_smoother(means, covs)
    np.testing.assert_allclose(smoothed.means, means, atol=1e-9)
    np.testing.assert_allclose(smoothed.covs, covs, atol=1e-9)


@pytest.mark.parametrize("varying", [False, True])
def test_filter_equals_single_steps_with_gaps_controls_and_changing_models(varying):
    z, rng = series(700), np.random.default_rng(5)
    z[50], z[500:520], z[600, 0] = np.nan, np.nan, np.nan
    u = rng.normal(size=(700, 1))
    model = F + 0.01 * rng.normal(size=(700, 4, 4)) if varying else F
    result = kalman.filter(z, model, H, Q, R, START, B, u)
    means, covs, log_likelihood = by_single_steps(z, model, H, Q, R, START, B, u)
    np.testing.assert_allclose(result.means, means, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(result.covs, covs, atol=1e-9)
    np.testing.assert_allclose(result.log_likelihood, log_likelihood, rtol=1e-9)


def test_smoother_equals_the_joint_least_squares_solution():
    # Nothing of the recursions: all states at once from their joint normal equations.
    T, n = 6, 4
    z = series(T)
    A, b = np.zeros((T * n, T * n)), np.zeros(T * n)
    first = kalman.predict(START, F, Q)
    for k in range(T):
        here, before = slice(k * n, k * n + n), slice(k * n - n, k * n)
        if k == 0:
            A[here, here] += np.linalg.inv(first.cov)
            b[here] += np.linalg.solve(first.cov, first.mean)
        else:
            W = np.linalg.inv(Q)
            A[here, here] += W
            A[before, before] += F.T @ W @ F
            A[here, before] -= W @ F
            A[before, here] -= F.T @ W
        A[here, here] += H.T @ np.linalg.solve(R, H)
        b[here] += H.T @ np.linalg.solve(R, z[k])
    smoothed = kalman.smooth(kalman.filter(z, F, H, Q, R, START))
    np.testing.assert_allclose(smoothed.means.ravel(), np.linalg.solve(A, b), atol=1e-7)
    joint = np.linalg.inv(A)
    for k in range(T):
        here = slice(k * n, k * n + n)
        np.testing.assert_allclose(smoothed.covs[k], joint[here, here], atol=1e-7)


# --- closed forms ---


def test_random_walk_settles_at_the_golden_ratio():
    # q = r = 1: p = p (1 - k) + 1 has the root (1 + sqrt 5) / 2, gain p / (p + 1).
    golden = (1 + np.sqrt(5)) / 2
    settled = kalman.steady_state([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    np.testing.assert_allclose(settled.predicted_cov, golden, rtol=1e-12)
    np.testing.assert_allclose(settled.gain, golden / (golden + 1), rtol=1e-12)
    start = Gaussian([0.0], [[7.0]])
    result = kalman.filter(np.zeros((60, 1)), [[1.0]], [[1.0]], [[1.0]], [[1.0]], start)
    np.testing.assert_allclose(result.predicted_covs[-1], golden, rtol=1e-12)


def test_scalar_riccati_of_any_system():
    a, q, r = 1.3, 0.4, 2.0
    half = 0.5 * (q + r * (a * a - 1))
    p = half + np.sqrt(half**2 + q * r)
    settled = kalman.steady_state([[a]], [[1.0]], [[q]], [[r]])
    np.testing.assert_allclose(settled.predicted_cov, p, rtol=1e-12)
    np.testing.assert_allclose(settled.cov, p * r / (p + r), rtol=1e-12)


def test_constant_position_shares_its_measurements_equally():
    z = np.arange(10.0)[:, None]
    start = Gaussian([0.0], [[1e12]])
    result = kalman.filter(z, [[1.0]], [[1.0]], [[0.0]], [[4.0]], start)
    np.testing.assert_allclose(result.means[-1], z.mean(), rtol=1e-9)
    np.testing.assert_allclose(result.covs[-1], 4.0 / 10, rtol=1e-9)


@pytest.mark.parametrize("sigma_a", [0.1, 1.0, 20.0])
def test_constant_velocity_settles_at_the_alpha_beta_gains(sigma_a):
    # Kalata's tracking index: L = sigma_a dt^2 / sigma_z, for a piecewise constant acceleration.
    dt, sigma_z = 0.5, 0.7
    L = sigma_a * dt**2 / sigma_z
    beta = 0.25 * (L**2 + 4 * L - L * np.sqrt(L**2 + 8 * L))
    alpha = -0.125 * (L**2 + 8 * L - (L + 4) * np.sqrt(L**2 + 8 * L))
    push = np.array([dt**2 / 2, dt])
    model = [[1, dt], [0, 1]], [[1, 0]], sigma_a**2 * np.outer(push, push), [[sigma_z**2]]
    gain = kalman.steady_state(*model).gain[:, 0]
    np.testing.assert_allclose(gain, [alpha, beta / dt], rtol=1e-8)
    result = kalman.filter(np.zeros((400, 1)), *model, Gaussian([0, 0], np.eye(2)))
    np.testing.assert_allclose(result.gains[-1, :, 0], [alpha, beta / dt], rtol=1e-8)


# --- consistency ---


def test_200_runs_are_consistent_and_a_filter_that_trusts_too_much_is_not():
    runs, T, rng = 200, 50, np.random.default_rng(8)
    x, truth, z = START.sample(rng, runs), [], []
    for _ in range(T):
        x = x @ F.T + rng.multivariate_normal(np.zeros(4), Q, runs)
        truth.append(x)
        z.append(x @ H.T + rng.multivariate_normal(np.zeros(2), R, runs))
    truth, z = np.stack(truth, 1), np.stack(z, 1)

    def mean_nees_and_nis(R):
        result = kalman.filter(z, F, H, Q, R, START)
        error = (result.means - truth)[:, -1]
        nees = (error * np.linalg.solve(result.covs[:, -1], error[..., None])[..., 0]).sum(-1)
        return nees.mean(), result.nis.mean()

    band_nees = chi2.ppf([0.005, 0.995], 4 * runs) / runs
    band_nis = chi2.ppf([0.005, 0.995], 2 * runs * T) / (runs * T)
    nees, nis = mean_nees_and_nis(R)
    assert band_nees[0] < nees < band_nees[1]
    assert band_nis[0] < nis < band_nis[1]
    nees, nis = mean_nees_and_nis(R / 4)
    assert nees > band_nees[1]
    assert nis > band_nis[1]


# --- properties ---


@properties
@given(seed=st.integers(0, 10**6))
def test_gain_form_joseph_form_and_information_form_agree(seed):
    belief, z, H, R = random_case(seed)
    posterior, learned = kalman.update(belief, z, H, R)
    short = (np.eye(4) - learned.gain @ H) @ belief.cov
    information = np.linalg.inv(belief.cov) + H.T @ np.linalg.solve(R, H)
    vector = np.linalg.solve(belief.cov, belief.mean) + H.T @ np.linalg.solve(R, z)
    scale = np.abs(belief.cov).max()
    np.testing.assert_allclose(posterior.cov, short, atol=1e-9 * scale)
    np.testing.assert_allclose(posterior.cov, np.linalg.inv(information), atol=1e-9 * scale)
    np.testing.assert_allclose(posterior.mean, np.linalg.solve(information, vector), atol=1e-8)


@properties
@given(seed=st.integers(0, 10**6))
def test_one_measurement_after_the_other_equals_both_at_once(seed):
    belief, z, H, R = random_case(seed)
    R = np.diag(np.diag(R))
    joint, _ = kalman.update(belief, z, H, R)
    for i in range(2):
        belief, _ = kalman.update(belief, z[[i]], H[[i]], R[i : i + 1, i : i + 1])
    np.testing.assert_allclose(belief.mean, joint.mean, atol=1e-9)
    np.testing.assert_allclose(belief.cov, joint.cov, atol=1e-9)


@properties
@given(seed=st.integers(0, 10**6), gaps=st.booleans(), many=st.sampled_from([1, 3, 20]))
def test_a_batch_equals_its_members(seed, gaps, many):
    z = series(many, 40, seed=seed)
    if gaps:
        z[np.random.default_rng(seed).random(z.shape) < 0.2] = np.nan
    together = kalman.filter(z, F, H, Q, R, START)
    smoothed = kalman.smooth(together)
    for i in range(0, many, 7):
        alone = kalman.filter(z[i], F, H, Q, R, START)
        np.testing.assert_allclose(together.means[i], alone.means, atol=1e-9)
        np.testing.assert_allclose(together.covs[i], alone.covs, atol=1e-9)
        np.testing.assert_allclose(together.log_likelihood[i], alone.log_likelihood, atol=1e-9)
        np.testing.assert_allclose(smoothed.means[i], kalman.smooth(alone).means, atol=1e-9)


def test_a_batch_of_models_beliefs_and_measurements_equals_its_members():
    z, rng = series(2, 3, 30), np.random.default_rng(1)
    models = F + 0.05 * rng.normal(size=(3, 1, 4, 4))
    starts = Gaussian(rng.normal(size=(2, 1, 4)), START.cov)
    together = kalman.smooth(kalman.filter(z, models, H, Q, R, starts))
    for i, j in np.ndindex(2, 3):
        start = Gaussian(starts.mean[i, 0], START.cov)
        alone = kalman.smooth(kalman.filter(z[i, j], models[j, 0], H, Q, R, start))
        np.testing.assert_allclose(together.means[i, j], alone.means, atol=1e-9)
        np.testing.assert_allclose(together.covs[i, j], alone.covs, atol=1e-9)


def test_single_steps_take_batches():
    means = np.random.default_rng(1).normal(size=(5, 4))
    beliefs = kalman.predict(Gaussian(means, np.broadcast_to(START.cov, (5, 4, 4))), F, Q)
    posterior, learned = kalman.update(beliefs, np.zeros((5, 2)), H, R)
    one, _ = kalman.update(kalman.predict(Gaussian(means[3], START.cov), F, Q), [0, 0], H, R)
    np.testing.assert_allclose(posterior.mean[3], one.mean, atol=1e-12)
    np.testing.assert_allclose(posterior.cov[3], one.cov, atol=1e-12)
    assert learned.nis.shape == (5,)


def test_a_missing_measurement_is_no_update():
    z = series(30)
    z[12] = np.nan
    result = kalman.filter(z, F, H, Q, R, START)
    np.testing.assert_allclose(result.means[12], result.predicted_means[12], atol=1e-14)
    np.testing.assert_array_equal(result.covs[12], result.predicted_covs[12])
    assert np.isnan(result.nis[12])
    assert np.isfinite(np.delete(result.nis, 12)).all()


def test_the_settled_covariance_solves_the_riccati_equation():
    settled = kalman.steady_state(F, H, Q, R)
    result = kalman.filter(series(2000), F, H, Q, R, START)
    np.testing.assert_allclose(result.covs[-1], settled.cov, rtol=1e-9)
    np.testing.assert_allclose(result.predicted_covs[-1], settled.predicted_cov, rtol=1e-9)
    np.testing.assert_allclose(result.gains[-1], settled.gain, rtol=1e-9)


@pytest.mark.parametrize("lag", [0, 1, 7, 59, 500])
def test_fixed_lag_equals_the_smoother_on_its_window(lag):
    z = series(60)
    z[20] = np.nan
    lagged = kalman.fixed_lag(kalman.filter(z, F, H, Q, R, START), lag)
    for k in (0, 13, 20, 40, 59):
        window = kalman.smooth(kalman.filter(z[: k + lag + 1], F, H, Q, R, START))
        np.testing.assert_allclose(lagged.means[k], window.means[k], atol=1e-9)
        np.testing.assert_allclose(lagged.covs[k], window.covs[k], atol=1e-9)


def test_a_motion_without_noise_and_a_known_start_can_be_smoothed():
    sure = Gaussian(START.mean, np.zeros((4, 4)))
    result = kalman.filter(series(20), F, H, np.zeros((4, 4)), R, sure)
    smoothed = kalman.smooth(result)
    np.testing.assert_allclose(smoothed.means, result.means, atol=1e-12)
    np.testing.assert_array_equal(smoothed.covs, 0)


# --- rounding ---


@pytest.mark.parametrize(("dtype", "slack"), [(np.float64, 1e-15), (np.float32, 1e-6)])
def test_covariance_stays_one_after_10_000_ill_conditioned_steps(dtype, slack):
    belief = Gaussian(np.zeros(4, dtype), np.diag([1e6, 1e-6, 1e6, 1]).astype(dtype))
    evolve, see = F.astype(dtype), H.astype(dtype)
    Q_, R_ = (1e-9 * Q).astype(dtype), (1e-6 * R).astype(dtype)
    for _ in range(10_000):
        belief = kalman.predict(belief, evolve, Q_)
        belief, _ = kalman.update(belief, np.zeros(2, dtype), see, R_)
    assert belief.cov.dtype == dtype
    np.testing.assert_array_equal(belief.cov, belief.cov.T)
    values = np.linalg.eigvalsh(belief.cov.astype(np.float64))
    assert values[0] >= -slack * values[-1]


def test_float32_breaks_the_short_form_and_not_joseph():
    root = np.random.default_rng(0).normal(size=(3, 3))
    P = (root @ np.diag([1e6, 1e2, 1.0]) @ root.T).astype(np.float32)
    belief = Gaussian(np.zeros(3, np.float32), 0.5 * (P + P.T))
    assert np.linalg.eigvalsh(belief.cov.astype(np.float64))[0] > 0
    see = np.array([[1, 1, 0.5], [0, 1, -1]], np.float32)
    noise = 1e-2 * np.eye(2, dtype=np.float32)
    posterior, learned = kalman.update(belief, np.zeros(2, np.float32), see, noise)
    short = (np.eye(3, dtype=np.float32) - learned.gain @ see) @ belief.cov
    worst = np.linalg.eigvalsh(0.5 * (short + short.T).astype(np.float64))[0]
    joseph = np.linalg.eigvalsh(posterior.cov.astype(np.float64))
    print(f"smallest eigenvalue: (I - K H) P {worst:.3g}, Joseph {joseph[0]:.3g}")
    assert posterior.cov.dtype == learned.gain.dtype == np.float32
    assert worst < -1e-3
    assert joseph[0] > 0


def test_whole_sequences_keep_float32():
    narrow = [a.astype(np.float32) for a in (series(300), F, H, Q, R)]
    start = Gaussian(START.mean.astype(np.float32), START.cov.astype(np.float32))
    result = kalman.filter(*narrow, start)
    smoothed = kalman.smooth(result)
    assert result.means.dtype == result.covs.dtype == result.nis.dtype == np.float32
    assert smoothed.means.dtype == smoothed.covs.dtype == np.float32
    wide = kalman.smooth(kalman.filter(series(300), F, H, Q, R, START))
    np.testing.assert_allclose(smoothed.means, wide.means, atol=1e-3)


# --- bad input is named ---


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("F", lambda: kalman.predict(START, np.eye(3), Q)),
        ("Q", lambda: kalman.predict(START, F, -Q)),
        ("Q", lambda: kalman.predict(START, F, np.full((4, 4), np.nan))),
        ("u", lambda: kalman.predict(START, F, Q, B=B)),
        ("B", lambda: kalman.predict(START, F, Q, u=[1.0])),
        ("B", lambda: kalman.predict(START, F, Q, B.T, [1.0])),
        ("B", lambda: kalman.predict(START, F, Q, np.stack([B] * 4), np.ones((3, 1)))),
        ("z", lambda: kalman.update(START, [np.nan, 0], H, R)),
        ("H", lambda: kalman.update(START, [0, 0], H.T, R)),
        ("R", lambda: kalman.update(START, [0, 0], H, -R)),
        ("R", lambda: kalman.update(START, [0, 0], 0 * H, 0 * R)),
        ("z", lambda: kalman.filter(np.zeros((0, 2)), F, H, Q, R, START)),
        ("z", lambda: kalman.filter([[np.inf, 0]], F, H, Q, R, START)),
        ("z", lambda: kalman.filter(np.zeros(2), F, H, Q, R, START)),
        ("F", lambda: kalman.filter(series(5), np.stack([F] * 4), H, Q, R, START)),
        ("z", lambda: kalman.filter(series(1), np.stack([F] * 4), H, Q, R, START)),
        ("z", lambda: kalman.filter(series(1), F, H, Q, R, START, np.stack([B] * 4), [[1.0]])),
        ("H", lambda: kalman.filter(series(5), F, H[:1], Q, R, START)),
        ("R", lambda: kalman.filter(series(5), F, 0 * H, Q, 0 * R, START)),
        ("u", lambda: kalman.filter(series(5), F, H, Q, R, START, B, np.zeros((4, 1)))),
        ("u", lambda: kalman.filter(series(5), F, H, Q, R, START, B)),
        ("F", lambda: kalman.filter(series(2, 5), np.ones((3, 1, 4, 4)) * F, H, Q, R, START)),
        ("u", lambda: kalman.filter(series(2, 5), F, H, Q, R, START, B, np.zeros((3, 5, 1)))),
        ("B", lambda: kalman.filter(series(5), F, H, Q, R, START, [B] * 4, np.zeros((5, 1)))),
        ("initial", lambda: kalman.filter(series(2, 5), F, H, Q, R, Gaussian([[0] * 4] * 3, Q))),
        ("lag", lambda: kalman.fixed_lag(kalman.filter(series(5), F, H, Q, R, START), -1)),
        ("F", lambda: kalman.steady_state([[2.0]], [[0.0]], [[1.0]], [[1.0]])),
    ],
)
def test_bad_input_is_named(name, call):
    with pytest.raises(ValueError, match=rf"^{name}\b"):
        call()


def test_a_singular_innovation_covariance_is_named():
    with pytest.raises(ValueError, match=r"S = H P H\^T \+ R .* positive definite"):
        kalman.update(START, [0, 0], H[[0, 0]], 0 * R)
