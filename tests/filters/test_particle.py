"""Particle filter and resamplers: against filterpy, the Kalman filter, their definitions."""

import numpy as np
import pytest
from filterpy.monte_carlo import resampling as filterpy
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from slamlab.filters.particle import (
    KLD,
    RESAMPLERS,
    ParticleFilter,
    effective_sample_size,
    lineage,
    multinomial_resample,
    residual_resample,
    stratified_resample,
    systematic_resample,
)

PEERS = {
    "systematic": (systematic_resample, filterpy.systematic_resample),
    "stratified": (stratified_resample, filterpy.stratified_resample),
    "multinomial": (multinomial_resample, filterpy.multinomial_resample),
}
some_weights = st.lists(st.floats(0, 1), min_size=1, max_size=30).filter(lambda w: sum(w) > 1e-3)


class FixedUniform:
    """Stands for `numpy.random.random` inside filterpy: draws from a generator of ours."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def __call__(self, size=None):
        return self.rng.random(size)


# Resamplers


@pytest.mark.parametrize("name", PEERS)
def test_the_same_uniform_numbers_give_the_indices_of_filterpy(name, monkeypatch):
    ours, peer = PEERS[name]
    for seed in range(40):
        weights = np.random.default_rng(1000 + seed).dirichlet(np.full(200, 0.3))
        monkeypatch.setattr(filterpy, "random", FixedUniform(seed))
        assert ours(weights, np.random.default_rng(seed)).tolist() == peer(weights).tolist()


def test_filterpys_residual_resampling_draws_the_rest_from_wrong_weights(monkeypatch):
    # filterpy 2.0 takes w - copies where n w - copies is due: the rest is negative for any
    # particle that was copied, and its draws are biased. The copies themselves agree.
    weights = np.array([0.26, 0.24, 0.23, 0.27])
    monkeypatch.setattr(filterpy, "random", FixedUniform(1))
    peer = filterpy.residual_resample(weights)
    ours = residual_resample(weights, np.random.default_rng(1))
    assert ours[:2].tolist() == peer[:2].tolist() == [0, 3]
    share = np.zeros(4)
    for seed in range(4000):
        share += np.bincount(residual_resample(weights, np.random.default_rng(seed)), minlength=4)
    np.testing.assert_allclose(share / 4000, 4 * weights, atol=0.05)
    share[:] = 0
    for seed in range(4000):
        monkeypatch.setattr(filterpy, "random", FixedUniform(seed))
        share += np.bincount(filterpy.residual_resample(weights), minlength=4)
    assert np.abs(share / 4000 - 4 * weights).max() > 0.3


@settings(derandomize=True, deadline=None, max_examples=300)
@given(some_weights, st.integers(0, 1000), st.integers(1, 60))
def test_systematic_copies_floor_or_ceil_of_the_expected_number(weights, seed, n):
    chosen = systematic_resample(weights, np.random.default_rng(seed), n)
    copies = np.bincount(chosen, minlength=len(weights))
    expected = n * np.array(weights) / sum(weights)
    assert len(chosen) == n
    assert (copies >= np.floor(expected - 1e-9)).all()
    assert (copies <= np.ceil(expected + 1e-9)).all()


def test_multinomial_breaks_the_floor_or_ceil_property():
    weights = np.full(10, 0.1)
    copies = np.bincount(multinomial_resample(weights, np.random.default_rng(1)), minlength=10)
    assert (np.abs(copies - 1) > 0).any()


@pytest.mark.parametrize("name", RESAMPLERS)
def test_resampling_is_unbiased(name):
    weights = np.array([0.4, 0.05, 0.3, 0.0, 0.25])
    rng = np.random.default_rng(3)
    rounds, n = 20_000, 7
    copies = np.zeros(5)
    for _ in range(rounds):
        copies += np.bincount(RESAMPLERS[name](weights, rng, n), minlength=5)
    np.testing.assert_allclose(copies / rounds, n * weights, atol=5 * np.sqrt(2 / rounds))
    assert copies[3] == 0


@pytest.mark.parametrize("name", RESAMPLERS)
@settings(derandomize=True, deadline=None, max_examples=100)
@given(weights=some_weights, seed=st.integers(0, 1000), n=st.integers(1, 60))
def test_a_particle_of_weight_zero_is_never_drawn(name, weights, seed, n):
    padded = np.concatenate([[0.0], weights, [0.0, 0.0]])
    chosen = RESAMPLERS[name](padded, np.random.default_rng(seed), n)
    assert chosen.shape == (n,)
    assert (padded[chosen] > 0).all()


@pytest.mark.parametrize("name", RESAMPLERS)
def test_all_weight_on_one_particle_copies_that_one(name):
    weights = np.zeros(50)
    weights[17] = 1e-300
    assert (RESAMPLERS[name](weights, np.random.default_rng(1)) == 17).all()


@pytest.mark.parametrize("name", RESAMPLERS)
def test_an_offset_next_to_one_still_gives_n_indices(name):
    class AlmostOne(np.random.Generator):
        def random(self, size=None):
            return np.nextafter(1.0, 0.0) if size is None else np.full(size, np.nextafter(1, 0))

    weights = np.append(np.ones(100_000), np.zeros(3))
    chosen = RESAMPLERS[name](weights, AlmostOne(np.random.PCG64(1)), 100_000)
    assert len(chosen) == 100_000
    assert chosen.max() <= 99_999


@pytest.mark.parametrize("name", RESAMPLERS)
def test_an_offset_of_zero_skips_leading_particles_of_weight_zero(name):
    class Zero(np.random.Generator):
        def random(self, size=None):
            return 0.0 if size is None else np.zeros(size)

    chosen = RESAMPLERS[name]([0.0, 0.3, 0.7], Zero(np.random.PCG64(1)), 4)
    assert chosen.min() == 1


@pytest.mark.parametrize("name", RESAMPLERS)
def test_sums_of_huge_or_denormal_weights_neither_overflow_nor_vanish(name):
    for scale in (1.5e308, 5e-324):
        chosen = RESAMPLERS[name](np.full(8, scale), np.random.default_rng(1))
        assert len(chosen) == 8
    assert effective_sample_size(np.full(8, 1.5e308)) == pytest.approx(8)


def test_residual_leaves_nothing_to_chance_if_the_expected_numbers_are_whole():
    weights = np.array([0.5, 0.125, 0.25, 0.0, 0.125])
    for seed in range(20):
        chosen = residual_resample(weights, np.random.default_rng(seed), 8)
        assert chosen.tolist() == [0, 0, 0, 0, 1, 2, 2, 4]


def test_multinomial_is_by_far_the_noisiest():
    weights = np.random.default_rng(5).dirichlet(np.full(100, 1.0))
    value = np.random.default_rng(7).uniform(-1, 1, 100)
    spread = {}
    for name, resample in RESAMPLERS.items():
        rng = np.random.default_rng(6)
        spread[name] = np.var([value[resample(weights, rng)].mean() for _ in range(500)])
    noisiest = spread.pop("multinomial")
    assert max(spread.values()) < 0.6 * noisiest


@pytest.mark.parametrize("name", RESAMPLERS)
@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ([0.0, 0.0], "positive sum"),
        ([0.5, -0.1], "not negative"),
        ([0.5, np.nan], "finite"),
        ([np.inf, 1.0], "finite"),
        ([[0.5, 0.5]], "shape"),
        ([], "not negative"),
    ],
)
def test_bad_weights_are_named(name, weights, message):
    with pytest.raises(ValueError, match=f"weights: .*{message}"):
        RESAMPLERS[name](weights, np.random.default_rng(1))


def test_other_bad_arguments_of_a_resampler_are_named():
    with pytest.raises(ValueError, match="rng"):
        systematic_resample([0.5, 0.5], 1)
    with pytest.raises(ValueError, match="n: expected at least 1"):
        stratified_resample([0.5, 0.5], np.random.default_rng(1), 0)


# Effective sample size


def test_effective_sample_size_of_known_weights():
    assert effective_sample_size(np.full(40, 0.025)) == pytest.approx(40)
    assert effective_sample_size([0, 1, 0]) == pytest.approx(1)
    assert effective_sample_size([3, 1]) == pytest.approx(1 / (0.75**2 + 0.25**2))
    with pytest.raises(ValueError, match="positive sum"):
        effective_sample_size([0, 0])


@settings(derandomize=True, deadline=None)
@given(some_weights, st.floats(1e-200, 1e200))
def test_effective_sample_size_is_in_range_and_ignores_scale(weights, scale):
    ess = effective_sample_size(weights)
    assert 1 - 1e-9 <= ess <= len(weights) * (1 + 1e-9)
    assert effective_sample_size(np.multiply(weights, scale)) == pytest.approx(ess)


# The filter


def kalman_1d(z, q, r):
    """Random walk seen with noise: means and variances, written by hand."""
    mean, var, out = 0.0, 4.0, []
    for one in z:
        var += q
        gain = var / (var + r)
        mean, var = mean + gain * (one - mean), (1 - gain) * var
        out.append((mean, var))
    return np.array(out)


def run_1d(z, q, r, N, seed, forget_old_weights=False, **options):
    """Particle filter on the same model; optionally with the mistake of forgotten weights."""
    rng = np.random.default_rng(seed)
    belief = ParticleFilter(rng.normal(0, 2, (N, 1)), rng, **options)
    out = []
    for one in z:
        belief.predict(lambda x, rng: x + rng.normal(0, np.sqrt(q), x.shape))
        if forget_old_weights:
            belief.log_weights = np.full(N, -np.log(N))
        belief.update(lambda x, one=one: -0.5 * (one - x[:, 0]) ** 2 / r)
        out.append((belief.mean()[0], belief.cov()[0, 0]))
    return np.array(out)


Z = np.cumsum(np.random.default_rng(11).normal(0, 0.3, 20)) + np.random.default_rng(12).normal(
    0, 0.5, 20
)


@pytest.mark.parametrize("name", RESAMPLERS)
def test_moments_converge_to_the_kalman_filter(name):
    N = 40_000
    due = kalman_1d(Z, 0.09, 0.25)
    ours = run_1d(Z, 0.09, 0.25, N, 1, resample=name)
    # Particles are worth a little less than N independent draws.
    assert (np.abs(ours[:, 0] - due[:, 0]) < 3 * 3 * np.sqrt(due[:, 1] / N)).all()
    assert np.abs(ours[:, 0] - due[:, 0]).mean() < 3 / np.sqrt(N)
    np.testing.assert_allclose(ours[:, 1], due[:, 1], rtol=12 / np.sqrt(N))


def test_the_error_falls_as_one_over_root_n():
    due = kalman_1d(Z, 0.09, 0.25)
    sizes = np.array([100, 400, 1600])
    error = [
        np.sqrt(
            np.mean([(run_1d(Z, 0.09, 0.25, N, s)[:, 0] - due[:, 0]) ** 2 for s in range(100)])
        )
        for N in sizes
    ]
    slope = np.polyfit(np.log(sizes), np.log(error), 1)[0]
    assert slope == pytest.approx(-0.5, abs=0.05)


def test_forgetting_the_old_weights_is_found():
    due = kalman_1d(Z, 0.09, 0.25)
    right = run_1d(Z, 0.09, 0.25, 20_000, 2, threshold=0.1)
    wrong = run_1d(Z, 0.09, 0.25, 20_000, 2, threshold=0.1, forget_old_weights=True)
    assert np.abs(right[:, 0] - due[:, 0]).max() < 0.03
    assert np.abs(wrong[:, 0] - due[:, 0]).max() > 0.1


def test_without_resampling_the_weights_degenerate():
    rng = np.random.default_rng(1)
    still = ParticleFilter(rng.normal(0, 2, (1000, 1)), rng, threshold=0.0)
    kept = ParticleFilter(rng.normal(0, 2, (1000, 1)), rng)
    for one in Z:
        for belief in (still, kept):
            belief.predict(lambda x, rng: x + rng.normal(0, 0.3, x.shape))
            belief.update(lambda x, one=one: -0.5 * (one - x[:, 0]) ** 2 / 0.05)
    assert still.ess < 50 < kept.ess
    assert not still.resampled


def test_the_evidence_is_that_of_the_kalman_filter():
    rng = np.random.default_rng(1)
    belief = ParticleFilter(rng.normal(0, 2, (200_000, 1)), rng)
    peak = -np.log(0.5 * np.sqrt(2 * np.pi))
    evidence = belief.update(lambda x: peak - 0.5 * ((1.5 - x[:, 0]) / 0.5) ** 2)
    due = -0.5 * 1.5**2 / 4.25 - 0.5 * np.log(2 * np.pi * 4.25)
    assert evidence == pytest.approx(due, abs=0.01)


def test_a_proposal_other_than_the_motion_is_corrected_by_the_ratio():
    # P2 (14): drawing from a shifted, wider proposal and dividing by it gives the same posterior.
    rng = np.random.default_rng(5)
    N = 200_000

    def propose(x, rng, corrected=True):
        drawn = x + rng.normal(0.7, 1.5, x.shape)
        move = (drawn - x)[:, 0]
        log_p = -0.5 * move**2
        log_pi = -0.5 * ((move - 0.7) / 1.5) ** 2 - np.log(1.5)
        return (drawn, log_p - log_pi) if corrected else drawn

    right = ParticleFilter(np.zeros((N, 1)), rng, threshold=0.0)
    right.predict(propose)
    right.update(lambda x: -0.5 * (1.0 - x[:, 0]) ** 2)
    assert right.mean()[0] == pytest.approx(0.5, abs=0.01)
    assert right.cov()[0, 0] == pytest.approx(0.5, abs=0.01)
    wrong = ParticleFilter(np.zeros((N, 1)), rng, threshold=0.0)
    wrong.predict(lambda x, rng: propose(x, rng, corrected=False))
    wrong.update(lambda x: -0.5 * (1.0 - x[:, 0]) ** 2)
    assert abs(wrong.mean()[0] - 0.5) > 0.3


def test_log_weights_survive_ten_thousandfold_underflow():
    # Log likelihoods around -1e4 nats and far below: exp() of each is 0.
    rng = np.random.default_rng(2)
    particles = rng.normal(0, 1, (500, 1))
    relative = -0.5 * (particles[:, 0] - 0.3) ** 2
    plain = ParticleFilter(particles, rng, threshold=0.0)
    plain.update(relative)
    deep = ParticleFilter(particles, rng, threshold=0.0)
    for _ in range(10):
        deep.update(relative / 10 - 1e4 * np.log(10))
    assert np.exp(relative - 1e4).max() == 0.0
    np.testing.assert_allclose(deep.weights, plain.weights, rtol=1e-8)
    assert np.isfinite(deep.log_weights).all()


@pytest.mark.parametrize("values", [np.full(30, -np.inf), [-np.inf] * 30])
def test_zero_total_weight_is_reported_and_leaves_the_belief_alone(values):
    rng = np.random.default_rng(3)
    belief = ParticleFilter(rng.normal(0, 1, (30, 2)), rng, weights=np.arange(30))
    before = belief.particles.copy(), belief.weights
    assert belief.update(values) == -np.inf
    assert belief.degenerate
    assert not belief.resampled
    np.testing.assert_array_equal(belief.particles, before[0])
    np.testing.assert_array_equal(belief.weights, before[1])
    assert np.isfinite(belief.mean()).all()
    belief.update(np.zeros(30))
    assert not belief.degenerate


def test_one_surviving_particle_takes_all():
    rng = np.random.default_rng(3)
    belief = ParticleFilter(np.arange(30.0)[:, None], rng)
    values = np.full(30, -np.inf)
    values[12] = -5000.0
    belief.update(values)
    assert (belief.particles == 12).all()
    assert (belief.ancestors == 12).all()
    assert belief.ess == pytest.approx(1)


def test_ancestors_name_the_parents():
    rng = np.random.default_rng(4)
    belief = ParticleFilter(rng.normal(0, 1, (200, 2)), rng, threshold=1.0)
    before = belief.particles.copy()
    belief.update(lambda x: -5 * (x[:, 0] - 1) ** 2)
    assert belief.resampled
    np.testing.assert_array_equal(belief.particles, before[belief.ancestors])
    belief.resample()
    np.testing.assert_array_equal(belief.particles, before[belief.ancestors])
    belief.update(np.zeros(200))
    assert not belief.resampled
    assert belief.ancestors.tolist() == list(range(200))


def test_resampled_particles_share_no_memory_with_the_old_ones():
    rng = np.random.default_rng(4)
    start = np.zeros((10, 2))
    belief = ParticleFilter(start, rng)
    belief.resample()
    belief.particles[0] = 5.0
    assert (belief.particles[1:] == 0).all()
    assert (start == 0).all()


def test_particles_may_have_any_trailing_shape():
    rng = np.random.default_rng(4)
    belief = ParticleFilter(rng.normal(size=(50, 2, 2)), rng)
    belief.update(lambda x: -(x[:, 0, 0] ** 2) * 9)
    assert belief.mean().shape == (2, 2)
    with pytest.raises(ValueError, match="cov"):
        belief.cov()


def test_the_mean_of_angles_goes_round_the_corner():
    rng = np.random.default_rng(5)
    poses = np.column_stack([np.zeros((1000, 2)), np.pi + rng.normal(0, 0.2, 1000)])
    poses[:, 2] = np.angle(np.exp(1j * poses[:, 2]))
    belief = ParticleFilter(poses, rng)
    assert abs(np.pi - abs(belief.mean(angles=(2,))[2])) < 0.02
    assert belief.cov(angles=(2,))[2, 2] == pytest.approx(0.04, abs=0.01)
    # Wrong: the arithmetic mean points the other way, and its variance is enormous.
    assert abs(belief.mean()[2]) < 0.5
    assert belief.cov()[2, 2] > 5


def test_moments_are_weighted():
    belief = ParticleFilter([[0.0], [1.0], [4.0]], np.random.default_rng(1), weights=[2, 1, 1])
    assert belief.mean()[0] == pytest.approx(1.25)
    assert belief.cov()[0, 0] == pytest.approx(0.25 * 1 + 0.25 * 16 - 1.25**2)


def test_same_seed_same_particles():
    one, two = (run_1d(Z, 0.09, 0.25, 500, 7) for _ in range(2))
    np.testing.assert_array_equal(one, two)


# Adaptive size


def test_the_required_number_bounds_the_distance_as_promised():
    # 2 n KL is nearly chi-square with k-1 degrees: the number is its quantile over 2 epsilon.
    kld = KLD([1.0], epsilon=0.05, delta=0.01)
    k = np.array([2, 5, 20, 100, 1000])
    np.testing.assert_allclose(kld.required(k), chi2.ppf(0.99, k - 1) / 0.1, rtol=0.02)
    assert kld.required(1) == 1


def test_histograms_of_that_size_rarely_miss_the_distance():
    probability = np.random.default_rng(1).dirichlet(np.full(30, 5.0))
    n = int(np.ceil(KLD([1.0], epsilon=0.05, delta=0.05).required(30)))

    def share_missed(n):
        drawn = np.random.default_rng(2).multinomial(n, probability, 2000) / n
        log_ratio = np.log(np.where(drawn > 0, drawn, 1) / np.where(drawn > 0, probability, 1))
        return ((drawn * log_ratio).sum(1) > 0.05).mean()

    assert share_missed(n) < 0.07
    assert share_missed(n // 2) > 0.3


def test_a_spread_belief_gets_more_particles_than_a_concentrated_one():
    rng = np.random.default_rng(1)
    kld = KLD([0.5, 0.5], minimum=50, maximum=20_000)
    belief = ParticleFilter(rng.uniform(-10, 10, (20_000, 2)), rng, adaptive=kld)
    belief.update(np.zeros(20_000))
    wide = len(belief.particles)
    belief.update(lambda x: -0.5 * (x**2).sum(1) / 0.3**2)
    narrow = len(belief.particles)
    assert 50 <= narrow < wide / 10
    assert wide <= 20_000
    assert len(belief.ancestors) == len(belief.weights) == narrow
    assert belief.weights.sum() == pytest.approx(1)
    belief.predict(lambda x, rng: x + rng.normal(0, 5, x.shape))
    belief.update(np.zeros(narrow))
    assert len(belief.particles) > narrow


def test_the_size_is_that_of_drawing_one_by_one():
    rng = np.random.default_rng(9)
    particles, weights = rng.normal(0, 1, (2000, 1)), rng.random(2000)
    kld = KLD([0.2], epsilon=0.1, delta=0.05, minimum=10, maximum=5000)
    size = kld.size(particles, weights, np.random.default_rng(3))
    draws = multinomial_resample(weights, np.random.default_rng(3), 5000)
    seen, n = set(), 0
    for i in draws:
        seen.add(int(np.floor(particles[i, 0] / 0.2)))
        n += 1
        if n >= 10 and n >= kld.required(len(seen)):
            break
    assert size == n


def test_size_respects_its_limits():
    rng = np.random.default_rng(9)
    weights = np.ones(100)
    assert KLD([1.0], minimum=70).size(np.zeros((100, 1)), weights, rng) == 70
    spread = rng.uniform(0, 1000, (100, 1))
    assert KLD([1.0], minimum=10, maximum=40).size(spread, weights, rng) == 40
    with pytest.raises(ValueError, match="particles: expected shape"):
        KLD([1.0, 1.0]).size(spread, weights, rng)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bins": [0.0]}, "bins: expected positive"),
        ({"epsilon": 0.0}, "epsilon"),
        ({"delta": 1.0}, "delta"),
        ({"minimum": 0}, "minimum"),
        ({"minimum": 10, "maximum": 5}, "maximum"),
    ],
)
def test_bad_kld_parameters_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        KLD(**{"bins": [1.0], **options})


# Bad input


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"particles": np.zeros((0, 3))}, "particles: expected shape"),
        ({"particles": np.zeros(3)}, "particles: expected shape"),
        ({"particles": [[np.nan]]}, "particles: expected finite"),
        ({"rng": 1}, "rng"),
        ({"weights": [1.0, 1.0]}, "weights: expected shape"),
        ({"weights": [0.0, 0.0, 0.0]}, "weights: expected a positive sum"),
        ({"weights": [1.0, 1.0, -1.0]}, "weights: .*not negative"),
        ({"threshold": 1.5}, "threshold"),
        ({"resample": "roulette"}, "resample: expected one of 'systematic'"),
        ({"adaptive": 100}, "adaptive"),
    ],
)
def test_bad_input_is_named(options, message):
    good = {"particles": np.zeros((3, 1)), "rng": np.random.default_rng(1)}
    with pytest.raises(ValueError, match=message):
        ParticleFilter(**{**good, **options})


def test_bad_models_are_named():
    belief = ParticleFilter(np.zeros((3, 2)), np.random.default_rng(1))
    with pytest.raises(ValueError, match=r"propose: expected particles of shape \(3, 2\)"):
        belief.predict(lambda x, rng: x[:2])
    with pytest.raises(ValueError, match="finite"):
        belief.predict(lambda x, rng: x * np.nan)
    with pytest.raises(ValueError, match="corrected weights are all zero"):
        belief.predict(lambda x, rng: (x, np.full(3, -np.inf)))
    with pytest.raises(ValueError, match="log_likelihood: expected shape"):
        belief.update(np.zeros((3, 1)))
    with pytest.raises(ValueError, match="log_likelihood: expected numbers or -inf, got nan"):
        belief.update([0, np.nan, 0])
    with pytest.raises(ValueError, match="got inf at index 2"):
        belief.update([0, 0, np.inf])
    with pytest.raises(ValueError, match="angles: expected columns"):
        belief.mean(angles=(2,))
    assert np.isfinite(belief.particles).all()


# Lineage


def test_lineage_follows_parents_to_the_first_step():
    rng = np.random.default_rng(4)
    ancestors = rng.integers(0, 8, (30, 8))
    stories = np.arange(8)[:, None]  # each particle writes down the rows it came through
    for parents in ancestors[1:]:
        stories = np.column_stack([stories[parents], np.arange(8)])
    np.testing.assert_array_equal(lineage(ancestors), stories.T)
    # Wrong: parents of step k looked up among the particles of step k.
    off_by_one = lineage(np.roll(ancestors, 1, axis=0))
    assert not np.array_equal(off_by_one, stories.T)


def test_an_injected_particle_has_no_past():
    rows = lineage([[0, 1], [0, 1], [0, -1], [1, 1]])
    assert rows.tolist() == [[-1, -1], [-1, -1], [1, 1], [0, 1]]


@pytest.mark.parametrize("bad", [[0, 1], [[0, 2]], [[0, -2]], [[0.0, 1.0]]])
def test_parents_that_do_not_exist_are_named(bad):
    with pytest.raises(ValueError, match="ancestors: expected"):
        lineage(bad)


def test_a_refused_proposal_has_drawn_nothing():
    rng = np.random.default_rng(4)
    belief = ParticleFilter(np.zeros((5, 1)), rng)
    state = rng.bit_generator.state
    for bad in (lambda x, rng: rng.normal(size=(4, 1)), lambda x, rng: rng.normal() + x * np.nan):
        with pytest.raises(ValueError, match="propose"):
            belief.predict(bad)
        assert rng.bit_generator.state == state
