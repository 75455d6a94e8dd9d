"""Monte Carlo localization: from anywhere, carried off, with and without names of landmarks."""

import numpy as np
import pytest

from slamlab.evaluation import chi2_band, nees
from slamlab.filters.particle import KLD
from slamlab.localization import MonteCarloLocalization
from slamlab.robots import Unicycle
from slamlab.sensors import RangeBearing

LANDMARKS = np.random.default_rng(7).uniform(0, 10, (10, 2))
BOUNDS = ((0, 10), (0, 10))
SENSOR, ROBOT = RangeBearing(0.15, 0.05, max_range=5.0), Unicycle()
CONTROL_COV = np.diag([0.1**2, 0.1**2])


def step(mcl, u, z, ids=None):
    mcl.predict(u, 0.5, CONTROL_COV)
    mcl.update(z, ids)


def localize(seed, named=True, kidnap=None, steps=30, n=3000, **options):
    """Position errors (steps,) and the filter, of a robot that drives circles."""
    rng = np.random.default_rng(seed)
    mcl = MonteCarloLocalization(LANDMARKS, ROBOT, SENSOR, n, BOUNDS, rng, **options)
    truth, errors = np.array([3.0, 3.0, 0.5]), []
    for k in range(steps):
        if k == kidnap:
            truth = np.array([7.0, 6.0, -2.0])
        u = [0.5, 0.25]
        truth = ROBOT.sample(truth, u, 0.5, CONTROL_COV, rng)
        z, ids = SENSOR.measure(truth, LANDMARKS, rng)
        step(mcl, u, z, ids if named else None)
        errors.append(np.hypot(*(mcl.pose - truth)[:2]))
    return np.array(errors), mcl, truth


@pytest.mark.parametrize("named", [True, False])
def test_the_robot_is_found_from_anywhere(named):
    worst = [localize(seed, named)[0][20:].max() for seed in range(5)]
    assert np.median(worst) < 0.25
    assert max(worst) < 1.0


@pytest.mark.parametrize("named", [True, False])
def test_a_kidnapped_robot_is_found_again_only_with_injection(named):
    runs = {
        injection: [
            localize(seed, named, kidnap=30, steps=60, injection=injection)[0][50:].max()
            for seed in range(5)
        ]
        for injection in ((0.05, 0.5), None)
    }
    assert max(runs[(0.05, 0.5)]) < 0.6
    assert min(runs[None]) > 1.0


def final_nees(seed, bounds):
    rng = np.random.default_rng(seed)
    mcl = MonteCarloLocalization(LANDMARKS, ROBOT, SENSOR, 10_000, bounds, rng, injection=None)
    truth = np.array([3.0, 3.0, 0.5])
    for _ in range(8):
        truth = ROBOT.sample(truth, [0.5, 0.25], 0.5, CONTROL_COV, rng)
        z, ids = SENSOR.measure(truth, LANDMARKS, rng)
        step(mcl, [0.5, 0.25], z, ids)
    return float(nees((mcl.pose, truth), mcl.pose_cov, angles=(2,)))


def test_the_cloud_covers_its_error_if_it_did_not_start_too_thin():
    dense = [final_nees(seed, ((2.7, 3.3), (2.7, 3.3))) for seed in range(30)]
    thin = [final_nees(seed, BOUNDS) for seed in range(30)]
    low, high = chi2_band(3, 30)
    assert low < np.mean(dense) < 1.3 * high
    # A hundred and more times fewer particles a square metre: a few ancestors, overconfident.
    assert np.mean(thin) > 3 * high


def test_unnamed_measurements_take_the_best_landmark():
    rng = np.random.default_rng(1)
    mcl = MonteCarloLocalization(LANDMARKS, ROBOT, SENSOR, 200, BOUNDS, rng, injection=None)
    particles = mcl.poses
    z = SENSOR.observe([5, 5, 1], LANDMARKS[[2, 7]])
    mcl.update(z)
    due = np.zeros(200)
    for one in z:
        due += np.max(
            [SENSOR.log_likelihood(particles, one[None], m[None]) for m in LANDMARKS], axis=0
        )
    best = particles[np.argmax(due)]
    assert (mcl.poses == best).all(1).sum() >= (due > due.max() - 5).sum()
    named = MonteCarloLocalization(
        LANDMARKS, ROBOT, SENSOR, 200, BOUNDS, np.random.default_rng(1), injection=None
    )
    assert mcl.update(z) >= named.update(z, [2, 7]) - 1e-9


def test_one_landmark_leaves_a_ring_of_places():
    rng = np.random.default_rng(2)
    mcl = MonteCarloLocalization(LANDMARKS[:1], ROBOT, SENSOR, 20_000, BOUNDS, rng)
    mcl.update([[2.0, 0.3]], [0])
    radius = np.hypot(*(mcl.poses[:, :2] - LANDMARKS[0]).T)
    assert np.abs(radius - 2).max() < 5 * 0.15
    assert np.linalg.eigvalsh(mcl.pose_cov[:2, :2])[0] > 0.5


@pytest.mark.parametrize("ids", [None, [3, 5]])
def test_each_measurement_may_have_its_own_covariance(ids):
    z, doubtful = (
        SENSOR.observe([5, 5, 1], LANDMARKS[[3, 5]]),
        np.array([[0.4, 0.05], [0.05, 0.1]]),
    )
    covs = np.array([SENSOR.cov, doubtful])
    poses = np.random.default_rng(2).uniform(4.5, 5.5, (50, 3))
    due = np.zeros(50)
    candidates = LANDMARKS if ids is None else None
    for j, (one, R) in enumerate(zip(z, covs, strict=True)):
        y = SENSOR.residual(
            one, SENSOR.observe(poses[:, None], LANDMARKS[[ids[j]]] if ids else candidates)
        )
        squared = (y * np.linalg.solve(R, y[..., None])[..., 0]).sum(-1)
        due += -0.5 * squared.min(1) - 0.5 * np.linalg.slogdet(2 * np.pi * R)[1]
    weigh = SENSOR.best_log_likelihood if ids is None else SENSOR.log_likelihood
    landmarks = LANDMARKS if ids is None else LANDMARKS[ids]
    np.testing.assert_allclose(weigh(poses, z, landmarks, covs), due, atol=1e-9)
    # Wrong: the sensor's own covariance for all.
    assert np.abs(weigh(poses, z, landmarks) - due).max() > 1
    clouds = [
        MonteCarloLocalization(LANDMARKS, ROBOT, SENSOR, 500, BOUNDS, np.random.default_rng(1))
        for _ in range(3)
    ]
    clouds[0].update(z, ids)
    clouds[1].update(z, ids, np.tile(SENSOR.cov, (2, 1, 1)))
    clouds[2].update(z, ids, covs)
    np.testing.assert_array_equal(clouds[0].poses, clouds[1].poses)
    assert not np.array_equal(clouds[0].poses, clouds[2].poses)


def test_what_it_gives_and_takes_are_copies():
    landmarks, bounds = LANDMARKS.copy(), np.array(BOUNDS, float)
    mcl = MonteCarloLocalization(landmarks, ROBOT, SENSOR, 50, bounds, np.random.default_rng(1))
    twin = MonteCarloLocalization(LANDMARKS, ROBOT, SENSOR, 50, BOUNDS, np.random.default_rng(1))
    landmarks[:] = bounds[:] = 7
    for name in ("poses", "weights", "log_weights", "pose", "pose_cov", "ancestors"):
        getattr(mcl, name)[:] = 7
    z = SENSOR.observe([5, 5, 1], LANDMARKS[:3])
    assert mcl.update(z) == twin.update(z)
    np.testing.assert_array_equal(mcl.poses, twin.poses)
    assert repr(mcl).startswith("MonteCarloLocalization(50 particles, pose (")
    bins = np.array([0.5, 0.5])
    kld = KLD(bins)
    bins[:] = 7
    assert kld.bins.tolist() == [0.5, 0.5]


def test_a_refused_update_changes_nothing():
    mcl = MonteCarloLocalization(LANDMARKS, ROBOT, SENSOR, 50, BOUNDS, np.random.default_rng(1))
    before, state = mcl.poses, mcl._rng.bit_generator.state
    z = [[2.0, 0.0]]
    for bad in (
        dict(measurement=[[np.nan, 0]]),
        dict(measurement=z, ids=[99]),
        dict(measurement=z, covs=[np.zeros((2, 2))]),
        dict(measurement=z, covs=np.eye(2)),
    ):
        with pytest.raises(ValueError, match="expected"):
            mcl.update(**bad)
    with pytest.raises(ValueError, match="u: expected"):
        mcl.predict([np.nan, 0], 0.1, CONTROL_COV)
    np.testing.assert_array_equal(mcl.poses, before)
    assert mcl._rng.bit_generator.state == state


def test_no_measurement_changes_nothing():
    rng = np.random.default_rng(4)
    mcl = MonteCarloLocalization(LANDMARKS, ROBOT, SENSOR, 100, BOUNDS, rng)
    before = mcl.poses
    assert mcl.update(np.empty((0, 2))) == 0.0
    np.testing.assert_array_equal(mcl.poses, before)


def test_injected_particles_have_no_ancestor_and_do_not_move_the_estimate():
    rng = np.random.default_rng(5)
    mcl = MonteCarloLocalization(LANDMARKS, ROBOT, SENSOR, 3000, BOUNDS, rng)
    ids = [0, 1, 2]
    for _ in range(40):
        step(mcl, [0, 0], SENSOR.observe([5, 5, 1], LANDMARKS[ids]), ids)
    step(mcl, [0, 0], SENSOR.observe([5.5, 5.5, 1], LANDMARKS[ids]), ids)
    assert mcl.injected > 0.2
    new = mcl.ancestors == -1
    assert new.mean() == mcl.injected
    np.testing.assert_allclose(mcl.pose[:2], np.average(mcl.poses[~new], 0, mcl.weights[~new])[:2])
    # Wrong: averaging them in pulls the estimate towards the middle of the world.
    assert np.trace(np.cov(mcl.poses[:, :2].T)) > 10 * np.trace(mcl.pose_cov[:2, :2])
    inside = (mcl.poses[new, :2] >= 0) & (mcl.poses[new, :2] <= 10)
    assert inside.all()


def test_an_impossible_measurement_is_reported_and_never_gives_nan():
    rng = np.random.default_rng(6)
    mcl = MonteCarloLocalization(LANDMARKS, ROBOT, SENSOR, 100, BOUNDS, rng)
    mcl.update([[1.0, 0.0]], [0])
    assert mcl.update([[1e200, 0.0]], [0]) == -np.inf
    assert mcl.degenerate
    assert np.isfinite(mcl.pose).all()
    assert mcl.weights.sum() == pytest.approx(1)


def test_the_number_of_particles_falls_once_the_robot_is_found():
    kld = KLD([0.5, 0.5, 0.3], epsilon=0.1, minimum=100, maximum=8000)
    errors, mcl, _ = localize(1, n=8000, adaptive=kld, injection=None)
    assert len(mcl.poses) < 1000
    assert errors[-1] < 0.4


def test_an_impossible_measurement_may_inject_while_the_number_falls():
    # Nothing was resampled, so that the injection does it, and the number falls with it.
    kld = KLD([0.5, 0.5, 0.3], epsilon=0.3, minimum=20, maximum=8000)
    rng = np.random.default_rng(6)
    mcl = MonteCarloLocalization(
        LANDMARKS, ROBOT, SENSOR, 2000, BOUNDS, rng, injection=(0.01, 1.0), adaptive=kld
    )
    for _ in range(2):
        mcl.update(SENSOR.observe([1.0, 1.0, 0.5], LANDMARKS), range(len(LANDMARKS)))
    before = mcl.n_particles
    assert mcl.update(np.full((len(LANDMARKS), 2), 1e200), range(len(LANDMARKS))) == -np.inf
    assert mcl.resampled
    assert mcl.n_particles <= before
    assert mcl.injected == np.mean(mcl.ancestors == -1)
    assert np.isfinite(mcl.pose).all()


def test_same_seed_same_track():
    np.testing.assert_array_equal(localize(3, steps=5)[0], localize(3, steps=5)[0])


@pytest.mark.parametrize("resample", ["stratified", "residual", "multinomial"])
def test_every_resampler_finds_the_robot(resample):
    errors, mcl, _ = localize(0, resample=resample, threshold=0.8)
    assert errors[-5:].max() < 0.3
    assert mcl.ess <= 3000


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bounds": ((0, 10), (5, 5))}, "bounds"),
        ({"bounds": (0, 10)}, "bounds: expected shape"),
        ({"world": np.empty((0, 2))}, "world: expected at least one landmark"),
        ({"world": [1.0, 2.0]}, "world: expected shape"),
        ({"n_particles": 0}, "n_particles"),
        ({"motion": SENSOR}, "motion: expected a motion model"),
        ({"sensor": ROBOT}, "sensor: expected a sensor"),
        ({"injection": (0.5, 0.1)}, "injection: expected rates"),
        ({"injection": 0.5}, "injection: expected shape"),
        ({"rng": None}, "rng"),
    ],
)
def test_bad_input_is_named(options, message):
    good = {
        "world": LANDMARKS,
        "motion": ROBOT,
        "sensor": SENSOR,
        "n_particles": 10,
        "bounds": BOUNDS,
        "rng": np.random.default_rng(1),
    }
    with pytest.raises(ValueError, match=message):
        MonteCarloLocalization(**{**good, **options})


@pytest.mark.parametrize("ids", [[10], [-1], [0, 1], [0.0]])
def test_unknown_ids_are_named(ids):
    mcl = MonteCarloLocalization(LANDMARKS, ROBOT, SENSOR, 10, BOUNDS, np.random.default_rng(1))
    with pytest.raises(ValueError, match="ids: expected"):
        mcl.update([[1.0, 0.0]], ids)
