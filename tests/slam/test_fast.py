"""FastSLAM: steps against Kalman filters, shared maps against copies, bad input harmless."""

import copy

import numpy as np
import pytest

from slamlab.filters import extended
from slamlab.filters.particle import lineage
from slamlab.gaussian import Gaussian
from slamlab.geometry import compose
from slamlab.robots import YOUBOT, Unicycle
from slamlab.sensors import RangeBearing, Wall
from slamlab.slam import FastSlam, _landmark_maps, _particle_association, association
from slamlab.slam._landmark_maps import ABSENT, FIELDS, PAGE, LandmarkMaps, unpacked

MOTION = Unicycle()
SENSOR = RangeBearing(0.1, 0.03, offset=0.2, max_range=8.0)
U, DT, V = np.array([1.0, 0.3]), 0.2, np.diag([0.1, 0.1]) ** 2
rng_of = np.random.default_rng


def world(seed=1, steps=60, n=25, sensor=SENSOR):
    """Landmarks, true poses and measurements of a robot that looks, then drives in a circle."""
    rng = rng_of(seed)
    landmarks = rng.uniform(-6, 6, (n, 2)) + [0, 3]
    pose, poses, observations = np.zeros(3), [], []
    for k in range(steps):
        pose = MOTION.sample(pose, U, DT, V, rng) if k else pose
        z, ids = sensor.measure(pose, landmarks, rng)
        keep = z[:, 0] > 0
        poses.append(pose)
        observations.append((z[keep], ids[keep].tolist()))
    return landmarks, np.array(poses), observations


def step(slam, z, ids=None):
    slam.predict(U, DT, V)
    return slam.update(z, ids)


def run(observations, version=1, n_particles=100, seed=2, named=True, **options):
    slam = FastSlam(MOTION, SENSOR, [0, 0, 0], n_particles, version, rng=rng_of(seed), **options)
    for k, (z, ids) in enumerate(observations):
        if k:
            slam.predict(U, DT, V)
        slam.update(z, ids if named else None)
    return slam


def state_of(slam):
    """Everything that a failed call must leave alone."""
    blocks = [fields for _, fields in slam._maps.blocks()]
    maps = np.concatenate([np.zeros((FIELDS, slam.n_particles, 0)), *blocks], 2)
    stream = repr(slam._cloud.rng.bit_generator.state)
    unnamed, steps = slam._names is None, len(slam._steps)
    plain = (slam.ids, slam.ess, slam.resampled, unnamed, steps, stream)
    arrays = [slam.poses, slam.log_weights, slam.ancestors, *(step.before for step in slam._steps)]
    present = maps[5] > ABSENT
    return plain, [*(a.copy() for a in arrays), maps[:, present].copy(), np.nonzero(present)[1]]


def same(one, other):
    return one[0] == other[0] and all(map(np.array_equal, one[1], other[1]))


# One particle, one step.


def test_a_new_landmark_has_the_uncertainty_of_its_measurement():
    slam = FastSlam(MOTION, SENSOR, [1.0, 2.0, 0.5], 3, rng=rng_of(1))
    z = np.array([[2.0, 0.3], [3.0, -1.0]])
    slam.update(z, ids=["a", "b"])
    _, G = SENSOR.locate_jacobians([1.0, 2.0, 0.5], z)
    np.testing.assert_allclose(slam.landmarks, SENSOR.locate([1.0, 2.0, 0.5], z), atol=1e-14)
    due = G @ SENSOR.cov @ np.swapaxes(G, 1, 2)
    np.testing.assert_allclose(slam.landmark_covs, due, atol=1e-15)
    # Wrong: R in the units of the sensor, not turned into the world.
    assert np.abs(SENSOR.cov - due).max() > 1e-3


def test_a_landmark_is_corrected_by_the_kalman_filter_of_a_robot_that_knows_where_it_is():
    pose = np.array([0.3, -0.2, 0.7])
    slam = FastSlam(MOTION, SENSOR, pose, 1, rng=rng_of(1))
    first, second = np.array([[3.0, 0.4]]), np.array([[3.1, 0.42]])
    slam.update(first, ids=[7])
    before = Gaussian(slam.landmarks[0], slam.landmark_covs[0])
    evidence = slam.update(second, ids=[7])
    due, innovation = extended.update(
        before,
        second[0],
        lambda m: SENSOR.observe(pose, m),
        lambda m: SENSOR.jacobians(pose, m)[1],
        SENSOR.cov,
        residual=SENSOR.residual,
    )
    np.testing.assert_allclose(slam.landmarks[0], due.mean, atol=1e-13)
    np.testing.assert_allclose(slam.landmark_cov(7), due.cov, atol=1e-13)
    assert evidence == pytest.approx(innovation.log_likelihood, abs=1e-12)
    # Wrong: the update run twice, which counts the measurement twice.
    assert (
        np.abs(
            extended.update(
                due,
                second[0],
                lambda m: SENSOR.observe(pose, m),
                lambda m: SENSOR.jacobians(pose, m)[1],
                SENSOR.cov,
                residual=SENSOR.residual,
            )[0].cov
            - due.cov
        ).max()
        > 1e-4
    )


@pytest.mark.parametrize("version", [1, 2])
def test_the_log_weight_is_the_log_likelihood_of_each_particle(version):
    landmarks, _, observations = world()
    slam = run(observations[:5], version, threshold=0.0)
    before, views = slam.log_weights, [slam.particle(i) for i in range(4)]
    z, ids = observations[4]
    rows = [slam.ids.index(i) for i in ids]
    slam.update(z, ids)  # no motion in between: both versions weigh where they stand
    gain = (slam.log_weights - before)[:4]
    due = []
    for view in views:
        y = SENSOR.residual(z, SENSOR.observe(view.pose, view.landmarks[rows]))
        S = view.innovation_covs(rows)
        due.append(
            sum(
                -0.5 * a @ np.linalg.solve(B, a) - 0.5 * np.linalg.slogdet(B)[1]
                for a, B in zip(y, S, strict=True)
            )
        )
    np.testing.assert_allclose(np.diff(gain), np.diff(due), atol=1e-10)


# Whole runs.


@pytest.mark.parametrize("version", [1, 2])
def test_it_finds_robot_and_map_where_odometry_is_lost(version):
    landmarks, poses, observations = world(steps=120)
    slam = run(observations, version)
    dead = np.zeros(3)
    for _ in observations[1:]:
        dead = MOTION.step(dead, U, DT)
    error = np.linalg.norm(slam.pose[:2] - poses[-1, :2])
    assert error < 0.3 < np.linalg.norm(dead[:2] - poses[-1, :2])
    away = slam.landmarks - landmarks[list(slam.ids)]
    assert np.sqrt((away**2).sum(1).mean()) < 0.25


@pytest.mark.parametrize("version", [1, 2])
def test_the_same_seed_gives_the_same_numbers(version):
    _, _, observations = world(steps=20)
    one, other = run(observations, version), run(observations, version)
    assert same(state_of(one), state_of(other))
    assert not np.array_equal(one.poses, run(observations, version, seed=3).poses)


@pytest.mark.parametrize("version", [1, 2])
def test_moving_the_world_moves_everything_with_it(version):
    _, _, observations = world(steps=25)
    start = np.array([5.0, -2.0, 2.5])
    here = run(observations, version)
    there = FastSlam(MOTION, SENSOR, start, 100, version, rng=rng_of(2))
    for k, (z, ids) in enumerate(observations):
        if k:
            there.predict(U, DT, V)
        there.update(z, ids)
    np.testing.assert_allclose(there.poses, compose(start, here.poses), atol=1e-9)
    np.testing.assert_allclose(there.log_weights, here.log_weights, atol=1e-8)


@pytest.mark.parametrize("version", [1, 2])
def test_the_order_of_the_measurements_does_not_matter(version):
    _, _, observations = world(steps=15)
    turned = [(z[::-1], ids[::-1]) for z, ids in observations]
    one, other = run(observations, version), run(turned, version)
    rows = [other.ids.index(i) for i in one.ids]
    np.testing.assert_allclose(one.poses, other.poses, atol=1e-9)
    np.testing.assert_allclose(one.landmarks, other.landmarks[rows], atol=1e-9)


@pytest.mark.parametrize("version", [1, 2])
def test_a_full_turn_of_the_bearings_changes_nothing(version):
    _, _, observations = world(steps=15)
    turned = [(z + [0, 2 * np.pi], ids) for z, ids in observations]
    np.testing.assert_allclose(
        run(observations, version).poses, run(turned, version).poses, atol=1e-9
    )


@pytest.mark.parametrize("version", [1, 2])
def test_covariances_stay_covariances(version):
    sharp = RangeBearing(1e-4, 1e-5, max_range=20.0)
    landmarks, _, observations = world(steps=700, n=3, sensor=sharp)
    slam = FastSlam(MOTION, sharp, [0, 0, 0], 4, version, rng=rng_of(1))
    for k, (z, ids) in enumerate(observations):
        if k:
            slam.predict(U, DT, V)
        slam.update(z, ids)
    _, covs = slam.landmark_estimates
    assert (covs == np.swapaxes(covs, -1, -2)).all()
    assert np.linalg.eigvalsh(covs).min() > 0
    assert np.linalg.eigvalsh(slam.cov).min() > -1e-12


def test_version_2_needs_a_fraction_of_the_particles_when_the_sensor_is_sharp():
    sharp, looser = RangeBearing(0.01, 0.005, max_range=8.0), np.diag([0.5, 0.4]) ** 2

    def rmse(version, n_particles):
        errors = []
        for seed in range(5):
            rng = rng_of(seed)
            landmarks = rng.uniform(-6, 6, (20, 2)) + [0, 3]
            slam = FastSlam(MOTION, sharp, [0, 0, 0], n_particles, version, rng=rng_of(seed + 50))
            pose = np.zeros(3)
            for k in range(50):
                if k:
                    pose = MOTION.sample(pose, U, DT, looser, rng)
                    slam.predict(U, DT, looser)
                z, ids = sharp.measure(pose, landmarks, rng)
                slam.update(np.abs(z) * [1, 0] + z * [0, 1], ids.tolist())
                errors.append(slam.pose[:2] - pose[:2])
        return np.sqrt(np.mean(np.square(errors)))

    # An eightieth of the particles, and still less error.
    assert rmse(2, 5) < rmse(1, 400)


def test_version_2_looks_back_over_all_predictions_since_the_last_update():
    """One look after six odometry steps: the proposal must cover the noise of all six."""
    landmarks = np.array([[3.0, 1.0], [2.0, -2.0], [5.0, 0.5]])
    sharp = RangeBearing(0.005, 0.002)

    def effective(version, forget=False):
        slam = FastSlam(MOTION, sharp, [0, 0, 0], 300, version, rng=rng_of(3), threshold=0.0)
        slam.update(sharp.observe(np.zeros(3), landmarks), ids=[0, 1, 2])
        truth, rng = np.zeros(3), rng_of(4)
        for _ in range(6):
            truth = MOTION.sample(truth, U, DT, V, rng)
            slam.predict(U, DT, V)
        if forget:  # only the last step is drawn anew
            slam._steps = slam._steps[-1:]
        slam.update(sharp.observe(truth, landmarks), ids=[0, 1, 2])
        return slam.ess

    assert effective(2) > 200
    assert effective(1) < 10
    assert effective(2, forget=True) < 100


def test_predictions_beyond_the_look_back_keep_their_noise():
    slam = FastSlam(MOTION, SENSOR, [0, 0, 0], 20, 2, rng=rng_of(3))
    for _ in range(30):
        slam.predict(U, DT, V)
    rng = rng_of(3)
    drawn = [rng.standard_normal((20, 2)) for _ in range(30)]
    poses, _ = slam._propagate(np.concatenate(drawn[-8:], 1))
    np.testing.assert_allclose(poses, slam.poses, atol=1e-12)
    assert len(slam._steps) == 8


@pytest.mark.parametrize("version", [1, 2])
def test_without_noise_in_the_odometry_nothing_is_drawn(version):
    _, _, observations = world(steps=5)
    slam = FastSlam(MOTION, SENSOR, [0, 0, 0], 10, version, rng=rng_of(1))
    for k, (z, ids) in enumerate(observations):
        if k:
            slam.predict(U, DT, np.zeros((2, 2)))
        slam.update(z, ids)
    assert np.ptp(slam.poses, axis=0).max() < 1e-12
    assert slam.ess == pytest.approx(10)


def test_a_look_at_nothing_changes_nothing_but_the_ancestors():
    _, _, observations = world(steps=10)
    slam = run(observations)
    slam.predict(U, DT, V)
    poses, weights = slam.poses, slam.log_weights
    assert slam.update(np.zeros((0, 2)), ids=[]) == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_array_equal(slam.poses, poses)
    np.testing.assert_allclose(slam.log_weights, weights, atol=1e-12)


# Ancestry.


def test_paths_follow_the_ancestors():
    _, _, observations = world(steps=40)
    slam = FastSlam(MOTION, SENSOR, [0, 0, 0], 50, rng=rng_of(2))
    paths, rows, poses, ancestors = np.zeros((50, 0, 3)), [], [], []
    for k, (z, ids) in enumerate(observations):
        if k:
            slam.predict(U, DT, V)
        before = slam.poses
        slam.update(z, ids)
        # Kept by hand: every particle carries its own path, copied at each resampling.
        paths = np.concatenate([paths, before[:, None]], 1)[slam.ancestors]
        rows = [one[slam.ancestors] for one in rows] + [np.arange(50)]
        poses.append(slam.poses)
        ancestors.append(slam.ancestors)
    due = lineage(ancestors)
    np.testing.assert_array_equal(due, rows)
    np.testing.assert_array_equal(
        np.array(poses)[np.arange(40)[:, None], due], paths.swapaxes(0, 1)
    )
    counts = [len(np.unique(one)) for one in due]
    assert counts == sorted(counts)
    assert counts[0] < 10 <= counts[-1]
    # Wrong: the row of today taken for the row of then.
    assert not np.array_equal(np.array(poses).swapaxes(0, 1), paths)


def test_ancestors_are_the_rows_that_systematic_resampling_drew():
    _, _, observations = world(steps=40)
    slam = FastSlam(MOTION, SENSOR, [0, 0, 0], 50, rng=rng_of(2), threshold=1.0)
    for k, (z, ids) in enumerate(observations):
        if k:
            slam.predict(U, DT, V)
        poses = slam.poses
        slam.update(z, ids)
        np.testing.assert_array_equal(slam.poses, poses[slam.ancestors])
    assert slam.resampled
    assert slam.weights == pytest.approx(1 / 50)
    assert not run(observations, threshold=0.0).resampled


# Shared maps.


def test_shared_maps_equal_maps_that_are_copied():
    rng = rng_of(5)
    M, n = 7, 3 * PAGE
    shared, copies = LandmarkMaps(M), np.zeros((M, n, FIELDS))
    copies[..., 5] = ABSENT
    for _ in range(60):
        columns = np.where(rng.random((M, n)) < 0.05, np.arange(n), -1)
        fields = rng.standard_normal((FIELDS, M, n))
        shared.write(columns, *unpacked(fields, np.zeros((M, 3))))
        copies = np.where((columns >= 0)[..., None], np.moveaxis(fields, 0, -1), copies)
        if rng.random() < 0.5:
            chosen = np.sort(rng.integers(0, M, M))
            shared.shared.resample(chosen)
            copies = copies[chosen]
        ((first, fields),) = shared.blocks()
        assert first == 0
        np.testing.assert_array_equal(np.moveaxis(fields, 0, -1), copies)
        wanted = rng.integers(0, n, (M, 4))
        fields = np.moveaxis(copies[np.arange(M)[:, None], wanted], -1, 0)
        for found, expected in zip(
            shared.read(wanted, np.ones((M, 3))), unpacked(fields, np.ones((M, 3))), strict=True
        ):
            np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(shared.map_of(3), copies[3])
        np.testing.assert_array_equal(shared.estimates(n - 9)[0], copies[:, : n - 9, :2])


def test_copying_a_particle_copies_no_landmark():
    _, _, observations = world(steps=10, n=200)
    slam = run(observations, n_particles=40, threshold=0.0)
    shared = slam._maps.shared
    pages = shared.in_use
    assert slam.stored_landmarks == pages * PAGE >= 40 * slam.n_landmarks
    shared.resample(np.zeros(40, dtype=int))
    assert shared.in_use == pages // 40
    # Writing one landmark copies its page for every owner but one, and no other page.
    zero = np.zeros((40, 1))
    slam._maps.write(np.zeros((40, 1), int), np.zeros((40, 1, 2)), np.zeros((40, 1, 2, 2)), zero)
    assert shared.in_use == pages // 40 + 39


def test_memory_does_not_grow_with_the_length_of_the_run():
    _, _, observations = world(steps=200)
    slam = run(observations[:50])
    size = len(slam._maps.shared.pages)
    for z, ids in observations[50:]:
        step(slam, z, ids)
    assert len(slam._maps.shared.pages) <= 2 * size


# Unknown association.


def nearest(view, z):
    """Reference association: the nearest landmark in Mahalanobis distance within 99 %."""
    rows = np.full(len(z), -1)
    if view.n_landmarks == 0:
        return rows
    everything = np.arange(view.n_landmarks)
    S = view.innovation_covs(everything)
    score, near = np.full((len(z), view.n_landmarks), -np.inf), np.zeros(len(z), bool)
    for j, one in enumerate(z):
        y = SENSOR.residual(one, SENSOR.observe(view.pose, view.landmarks))
        d = (y * np.linalg.solve(S, y[..., None])[..., 0]).sum(1)
        density = -0.5 * d - 0.5 * np.linalg.slogdet(S)[1]
        score[j] = np.where(d <= -2 * np.log(0.01), density, -np.inf)
        near[j] = (d <= -4 * np.log(0.01)).any()
    while np.isfinite(score).any():
        j, row = np.unravel_index(score.argmax(), score.shape)
        rows[j] = row
        score[j], score[:, row] = -np.inf, -np.inf
    return np.where((rows == -1) & near, -2, rows)


@pytest.mark.parametrize("version", [1, 2])
def test_the_built_in_association_is_maximum_likelihood_with_a_gate(version):
    _, _, observations = world(steps=25, n=12)
    built_in = run(observations, version, 15, named=False)
    asked = run(observations, version, 15, named=False, associate=nearest)
    np.testing.assert_allclose(built_in.poses, asked.poses, atol=1e-9)
    np.testing.assert_allclose(built_in.landmarks, asked.landmarks, atol=1e-9)
    # The gate matters: a narrow one starts the same landmark again and again.
    assert (
        run(observations, version, 15, named=False, gate=0.3).n_landmarks > asked.n_landmarks + 5
    )


@pytest.mark.parametrize("version", [1, 2])
def test_passing_over_what_is_out_of_reach_changes_nothing(version, monkeypatch):
    near = RangeBearing(0.1, 0.03, offset=0.2, max_range=3.0)
    _, _, observations = world(steps=40, n=60, sensor=near)
    quick = run(observations, version, 15, named=False)
    skipped = []
    reach = _particle_association._in_reach

    def everything(query, means, P, present, gate):
        expected = present.any(0)
        skipped.append(expected.sum() - reach(query, means, P, present, gate).sum())
        return expected

    monkeypatch.setattr(_landmark_maps, "BLOCKS", 1)
    monkeypatch.setattr(_particle_association, "_in_reach", everything)
    slow = run(observations, version, 15, named=False)
    assert sum(skipped) > 100
    np.testing.assert_allclose(quick.poses, slow.poses, atol=1e-12)
    np.testing.assert_allclose(quick.landmarks, slow.landmarks, atol=1e-12)
    # A bound that is too near passes over true pairs, and their landmarks are started again.
    monkeypatch.setattr(
        _particle_association,
        "_in_reach",
        lambda query, *others: reach(query._replace(z=0.6 * query.z), *others),
    )
    tight = run(observations, version, 15, named=False)
    assert tight.n_landmarks > quick.n_landmarks


@pytest.mark.parametrize("version", [1, 2])
def test_unnamed_landmarks_are_found_and_told_apart(version):
    landmarks, poses, observations = world(seed=4, steps=80, n=15)
    slam = run(observations, version, 60, named=False)
    distance = np.linalg.norm(slam.landmarks[:, None] - landmarks, axis=-1)
    met = {i for _, ids in observations for i in ids}
    assert len(met) <= slam.n_landmarks <= len(met) + 1
    assert np.median(distance.min(1)) < 0.2
    assert np.linalg.norm(slam.pose[:2] - poses[-1, :2]) < 0.4
    assert slam.landmark_covs.shape == (slam.n_landmarks, 2, 2)


def test_clutter_is_forgotten_when_it_is_not_seen_again():
    landmarks, _, observations = world(seed=4, steps=60, n=12)
    rng = rng_of(9)
    dirty = []
    for z, ids in observations:
        false = rng.uniform([0.5, -np.pi], [7.5, np.pi], (1, 2))
        z = np.concatenate([z, false]) if rng.random() < 0.5 else z
        dirty.append((z, ids))
    kept = run(dirty, 2, 40, named=False)
    cleaned = run(dirty, 2, 40, named=False, detection_probabilities=(0.9, 0.05))
    assert kept.n_landmarks > 1.5 * len(landmarks)
    away = np.linalg.norm(cleaned.landmarks[:, None] - landmarks, axis=-1).min(1)
    sure = cleaned.particle(0).existence > 0.99
    assert 8 <= sure.sum() <= len(landmarks) + 1
    assert (away < 0.5).sum() >= len(away) - 3


def test_evidence_counts_sightings_and_their_absence():
    slam = FastSlam(
        MOTION, SENSOR, [0, 0, 0], 1, rng=rng_of(1), detection_probabilities=(0.8, 0.1)
    )
    both, one = [[2.0, 0.5], [2.0, -0.5]], [[2.0, 0.5]]
    odds = lambda: np.log(1 / (1 / slam.particle(0).existence - 1))  # noqa: E731
    slam.update(both)
    np.testing.assert_allclose(odds(), [np.log(8)] * 2)
    slam.update(one)
    np.testing.assert_allclose(odds(), [2 * np.log(8), np.log(8) + np.log(2 / 9)])
    slam.update(one)  # twice unseen: out
    np.testing.assert_allclose(odds(), [3 * np.log(8)])
    slam.update(both)  # a new one takes the free place
    np.testing.assert_allclose(odds(), [4 * np.log(8), np.log(8)])


def test_an_association_may_ignore_and_start_what_it_likes():
    answers = {0: [-2, -1], 1: [0], 2: np.array([-1])}
    slam = FastSlam(
        MOTION, SENSOR, [0, 0, 0], 5, rng=rng_of(1), associate=lambda view, z: answers[count]
    )
    for count, z in enumerate(([[2.0, 0.5], [3.0, -0.5]], [[3.0, -0.5]], [[3.0, -0.5]])):
        slam.update(z)
        assert slam.n_landmarks == (1, 1, 2)[count]
    np.testing.assert_allclose(slam.landmarks[0], SENSOR.locate([0, 0, 0], [3.0, -0.5]))


# One particle as an association sees it.


def test_the_view_of_a_particle_has_what_an_association_asks_for():
    _, _, observations = world(steps=20)
    slam = run(observations, 2)
    view = slam.particle(3)
    np.testing.assert_array_equal(view.pose, slam.poses[3])
    assert (view.pose_cov == 0).all()
    assert view.ids == slam.ids
    assert view.mean.shape == (3 + 2 * view.n_landmarks,)
    rows = [4, 0, 2]
    each, joint = view.innovation_covs(rows), view.innovation_cov(rows)
    for j in range(3):
        np.testing.assert_allclose(joint[2 * j : 2 * j + 2, 2 * j : 2 * j + 2], each[j])
    assert np.count_nonzero(joint) <= 12
    _, H = SENSOR.jacobians(view.pose, view.landmarks[4])
    np.testing.assert_allclose(each[0], H @ view.landmark_covs[4] @ H.T + SENSOR.cov)


def test_version_2_asks_with_the_uncertainty_of_the_odometry():
    seen = []

    def watch(view, z):
        if view.n_landmarks == 0:
            return [-1, -1]
        seen.append((view.pose, view.pose_cov, view.innovation_cov([0, 1])))
        return [0, 1]

    slam = FastSlam(MOTION, SENSOR, [0, 0, 0], 3, 2, rng=rng_of(1), associate=watch)
    z = [[2.0, 0.5], [3.0, -0.5]]
    slam.update(z)
    slam.predict(U, DT, V)
    slam.update(z)
    _, F_u = MOTION.jacobians(np.zeros(3), U, DT)
    pose, cov, joint = seen[0]
    np.testing.assert_allclose(pose, MOTION.step(np.zeros(3), U, DT))
    np.testing.assert_allclose(cov, F_u @ V @ F_u.T, atol=1e-15)
    assert np.abs(joint[:2, 2:]).max() > 1e-4


# Measurements with covariances of their own.


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("named", [True, False])
def test_covs_of_the_sensor_change_nothing_and_those_of_a_better_one_are_its_own(version, named):
    _, _, observations = world(steps=12)
    sharper = RangeBearing(0.05, 0.015, offset=0.2, max_range=8.0)

    def final(sensor, R, each=True):
        slam = FastSlam(MOTION, sensor, [0, 0, 0], 30, version, rng=rng_of(2))
        for k, (z, ids) in enumerate(observations):
            if k:
                slam.predict(U, DT, V)
            covs = np.tile(R, (len(z), 1, 1)) if each and R is not None else R
            slam.update(z, ids if named else None, covs)
        return slam

    plain, told = final(SENSOR, None), final(SENSOR, SENSOR.cov)
    assert same(state_of(plain), state_of(told))
    sharp, told = final(sharper, None), final(SENSOR, sharper.cov)
    assert same(state_of(sharp), state_of(told))
    assert same(state_of(sharp), state_of(final(SENSOR, sharper.cov, each=False)))
    assert not same(state_of(sharp), state_of(plain))


def test_each_measurement_has_its_own_covariance():
    z, covs = np.array([[2.0, 0.5], [3.0, -0.5]]), [SENSOR.cov, 100 * SENSOR.cov]
    slam = FastSlam(MOTION, SENSOR, [0, 0, 0], 3, rng=rng_of(1))
    slam.update(z, ids=["a", "b"], covs=covs)
    _, G = SENSOR.locate_jacobians(np.zeros(3), z)
    np.testing.assert_allclose(slam.landmark_covs, G @ covs @ np.swapaxes(G, 1, 2), atol=1e-15)
    # The gate knows: what is far for one measurement is near for a doubtful one.
    for factor, n in ((1.0, 2), (100.0, 1)):
        slam = FastSlam(MOTION, SENSOR, [0, 0, 0], 3, rng=rng_of(1))
        slam.update(z[:1])
        slam.update(z[:1] + [1.0, 0.0], covs=[factor * SENSOR.cov])
        assert slam.n_landmarks == n


def test_what_it_gives_is_a_copy_and_what_it_takes_is_copied():
    _, _, observations = world(steps=8)
    slam, u = run(observations, 2), U.copy()
    slam.predict(u, DT, V)
    before = state_of(slam)
    for name in ("poses", "log_weights", "weights", "pose", "pose_cov", "ancestors", "mean"):
        getattr(slam, name)[:] = 7
    for name in ("landmarks", "landmark_covs"):
        getattr(slam, name)[:] = 7
    slam.particle(0).pose[:] = slam.particle(0).landmarks[:] = 7
    assert same(state_of(slam), before)
    u[:] = 7
    np.testing.assert_array_equal(slam._steps[0].u, U)
    assert repr(slam).startswith("FastSlam(100 particles, version 2.0, 2")
    assert "\n" not in repr(slam)


# Moments.


def test_moments_of_the_mixture_equal_a_plain_sum_over_particles():
    _, _, observations = world(steps=30, n=70)
    slam = run(observations, threshold=0.0)
    w, n = slam.weights, len(slam.ids)
    views = [slam.particle(i) for i in range(100)]
    mean = sum(wi * v.landmarks for wi, v in zip(w, views, strict=True))
    np.testing.assert_allclose(slam.landmarks, mean, atol=1e-12)
    states = np.array([np.concatenate([v.pose, v.landmarks.ravel()]) for v in views])
    spread = states - slam.mean
    cov = (w[:, None] * spread).T @ spread
    for j in range(n):
        part = slice(3 + 2 * j, 5 + 2 * j)
        cov[part, part] += sum(wi * v.landmark_covs[j] for wi, v in zip(w, views, strict=True))
    np.testing.assert_allclose(slam.cov, cov, atol=1e-12)
    np.testing.assert_allclose(slam.landmark_covs[5], cov[13:15, 13:15], atol=1e-12)
    np.testing.assert_allclose(slam.pose_cov, cov[:3, :3], atol=1e-12)
    means, covs = slam.landmark_estimates
    np.testing.assert_array_equal(means[7], views[7].landmarks)
    np.testing.assert_array_equal(covs[7], views[7].landmark_covs)


def test_the_mean_heading_is_a_direction():
    poses = np.array([[0.0, 0, np.pi - 0.1], [0, 0, -np.pi + 0.1]])
    slam = FastSlam(MOTION, SENSOR, poses, 2, rng=rng_of(1))
    assert abs(slam.pose[2]) == pytest.approx(np.pi)
    assert slam.pose_cov[2, 2] == pytest.approx(0.01)


# Bad input.

GOOD = np.array([[2.0, 0.5], [3.0, -0.5]])
BAD_UPDATES = [
    ("ids: expected every landmark once", GOOD, dict(ids=[1, 1])),
    ("ids: expected one for each of 2", GOOD, dict(ids=[1])),
    ("ids: expected names as in earlier", GOOD, dict()),
    ("ids: expected a sequence of names", GOOD, dict(ids=[[1], [2]])),
    ("z: expected ranges that are not negative", [[-0.5, 0.0]], dict(ids=["new"])),
    ("z: expected shape", [1.0, 2.0], dict(ids=[1])),
    ("z: expected finite", [[np.nan, 0.0]], dict(ids=[1])),
    ("all weights are zero", [[1e200, 0.0]], dict(ids=["met"])),
    ("finite landmarks", [[1e200, 0.0]], dict(ids=["new"])),
    ("covs: expected shape", GOOD, dict(ids=[1, 2], covs=[np.eye(2)] * 3)),
    ("covs: expected a positive", GOOD, dict(ids=[1, 2], covs=[-np.eye(2)] * 2)),
]


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize(("message", "z", "options"), BAD_UPDATES)
def test_a_bad_update_is_named_and_harmless(version, message, z, options):
    _, _, observations = world(steps=6)
    slam = run(observations, version)
    slam.predict(U, DT, V)
    before = state_of(slam)
    if options.get("ids") == ["met"]:
        options = {"ids": slam.ids[:1]}
    with pytest.raises(ValueError, match=message):
        slam.update(z, **options)
    assert same(state_of(slam), before)
    # It goes on as if nothing had happened.
    twin = run(observations, version)
    twin.predict(U, DT, V)
    assert slam.update(*observations[5]) == twin.update(*observations[5])
    assert same(state_of(slam), state_of(twin))


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize(
    ("message", "answer"),
    [
        ("expected 2 rows", lambda view, z: [0]),
        ("expected 2 rows", lambda view, z: [0.0, 1.0]),
        ("expected rows of 2 landmarks, -1 or -2", lambda view, z: [0, 2]),
        ("expected rows of 2 landmarks, -1 or -2", lambda view, z: [0, -3]),
        ("expected each landmark once", lambda view, z: [1, 1]),
    ],
)
def test_a_bad_association_is_named_and_harmless(version, message, answer):
    slam = FastSlam(MOTION, SENSOR, [0, 0, 0], 5, version, rng=rng_of(1))
    slam.update(GOOD)
    slam.predict(U, DT, V)
    before = state_of(slam)
    slam.associate = answer
    with pytest.raises(ValueError, match=message):
        slam.update(GOOD)
    with pytest.raises(ValueError, match="ids: expected None"):
        slam.update(GOOD, ids=[0, 1])
    slam.associate = lambda view, z: 1 // 0
    with pytest.raises(ZeroDivisionError):
        slam.update(GOOD)
    assert same(state_of(slam), before)


@pytest.mark.parametrize(
    ("message", "arguments", "options"),
    [
        ("n_particles: expected at least 1", ([0, 0, 0], 0), {}),
        ("n_particles", ([0, 0, 0], 2.5), {}),
        ("pose: expected shape", ([0, 0], 5), {}),
        ("pose: expected shape", (np.zeros((4, 3)), 5), {}),
        ("pose: expected finite", ([0, 0, np.inf], 5), {}),
        ("version", ([0, 0, 0], 5, 3), {}),
        ("rng", ([0, 0, 0], 5), dict(rng=1)),
        ("threshold", ([0, 0, 0], 5), dict(threshold=2)),
        ("gate", ([0, 0, 0], 5), dict(gate=1.0)),
        ("detection_probabilities", ([0, 0, 0], 5), dict(detection_probabilities=(0.1, 0.8))),
        ("detection_probabilities", ([0, 0, 0], 5), dict(detection_probabilities=(0.0, 0.8))),
        ("detection_probabilities", ([0, 0, 0], 5), dict(detection_probabilities=0.8)),
    ],
)
def test_bad_construction_is_named(message, arguments, options):
    with pytest.raises(ValueError, match=message):
        FastSlam(MOTION, SENSOR, *arguments, **{"rng": rng_of(1), **options})


def test_a_robot_and_a_sensor_that_change_places_are_named():
    with pytest.raises(ValueError, match="motion: expected a motion model"):
        FastSlam(SENSOR, MOTION, [0, 0, 0], 5, rng=rng_of(1))


@pytest.mark.parametrize(
    ("message", "arguments"),
    [
        ("u: expected shape", (1.0, DT, V)),
        ("u: expected finite", ([np.nan, 0], DT, V)),
        ("dt", (U, -1.0, V)),
        ("control_cov", (U, DT, np.eye(3))),
        ("control_cov", (U, DT, -np.eye(2))),
    ],
)
def test_a_bad_prediction_is_named_and_harmless(message, arguments):
    slam = run(world(steps=4)[2], 2)
    before = state_of(slam)
    with pytest.raises(ValueError, match=message):
        slam.predict(*arguments)
    assert same(state_of(slam), before)


def test_questions_without_an_answer_are_refused():
    slam = run(world(steps=4)[2])
    with pytest.raises(ValueError, match="id: expected the name"):
        slam.landmark_cov("nobody")
    with pytest.raises(ValueError, match="i: expected a particle below 100"):
        slam.particle(100)
    unnamed = run(world(steps=4)[2], named=False)
    for name in ("mean", "cov", "landmark_estimates"):
        with pytest.raises(ValueError, match="numbering"):
            getattr(unnamed, name)


def test_before_any_landmark_the_map_is_empty():
    slam = FastSlam(MOTION, SENSOR, [0, 0, 0], 5, rng=rng_of(1))
    assert slam.landmarks.shape == (0, 2)
    assert slam.landmark_covs.shape == (0, 2, 2)
    assert slam.particle(0).landmarks.shape == (0, 2)
    assert slam.mean.shape == (3,)
    assert slam.cov.shape == (3, 3)
    assert slam.n_landmarks == 0
    assert slam.n_particles == 5
    assert copy.copy(slam).ids == ()


# Other robots, other associations.


@pytest.mark.parametrize("version", [1, 2])
def test_it_takes_a_mecanum_platform_and_a_sensor_of_walls(version):
    sensor, walls = Wall(0.05, 0.02), np.array([[9.0, 0], [9, 1.6], [9, 3.0], [9, -1.5]])
    rng, u, cov = rng_of(3), np.array([0.5, 0.2, 0.3]), np.diag([0.1, 0.1, 0.1]) ** 2
    slam = FastSlam(YOUBOT, sensor, [0, 0, 0], 100, version, rng=rng)
    pose = np.zeros(3)
    for k in range(80):
        if k:
            pose = YOUBOT.sample(pose, u, DT, cov, rng)
            slam.predict(u, DT, cov)
        slam.update(sensor.observe(pose, walls) + rng.normal(0, [0.05, 0.02], (4, 2)), range(4))
    assert np.linalg.norm(slam.pose[:2] - pose[:2]) < 0.2
    np.testing.assert_allclose(slam.landmarks, walls, atol=0.1)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize(
    "associate", [association.maximum_likelihood, association.joint_compatibility]
)
def test_each_particle_may_ask_the_associations_of_ekf_slam(version, associate):
    landmarks, poses, observations = world(seed=4, steps=25, n=10)
    slam = run(observations, version, 12, named=False, associate=associate)
    met = {i for _, ids in observations for i in ids}
    assert len(met) <= slam.n_landmarks <= len(met) + 1
    assert np.linalg.norm(slam.pose[:2] - poses[-1, :2]) < 0.3


def test_an_empty_look_counts_against_what_stands_in_view():
    slam = FastSlam(
        MOTION, SENSOR, [0, 0, 0], 3, 2, rng=rng_of(1), detection_probabilities=(0.8, 0.1)
    )
    slam.update(np.zeros((0, 2)))
    slam.update([[2.0, 0.3]])
    slam.update(np.zeros((0, 2)))
    assert slam.n_landmarks == 1
    slam.update(np.zeros((0, 2)))
    assert slam.n_landmarks == 0
