"""Association: gates, joint compatibility by brute force, ambiguity, confirmation, refusals."""

import itertools
from functools import partial

import numpy as np
import pytest
from scipy.stats import chi2

from slamlab.evaluation import association_scores, run
from slamlab.gaussian import mahalanobis_squared
from slamlab.geometry import compose, transform
from slamlab.robots import Unicycle
from slamlab.sensors import RangeBearing, Wall
from slamlab.simulation import ORCHARD_SENSOR, orchard_loop
from slamlab.slam import EKFSlam, FastSlam, association
from slamlab.slam.association import (
    IGNORED,
    NEW,
    Confirmation,
    SearchLimitWarning,
    joint_compatibility,
    joint_search,
    maximum_likelihood,
    nearest_euclidean,
    nearest_neighbour,
)

SENSOR = RangeBearing(0.1, 0.02, offset=0.2)
METHODS = [nearest_euclidean, nearest_neighbour, maximum_likelihood, joint_compatibility]
GATED = METHODS[1:]
each = pytest.mark.parametrize("associate", METHODS, ids=lambda f: f.__name__)
gated = pytest.mark.parametrize("associate", GATED, ids=lambda f: f.__name__)


def lost(landmarks, doubt=(0.3, 0.3, 0.05), sensor=SENSOR):
    """A filter that saw landmarks once from the origin and then moved a little, blindly."""
    slam = EKFSlam(Unicycle(), sensor, np.zeros(3))
    slam.update(sensor.observe(slam.pose, landmarks), range(len(landmarks)))
    P = slam.cov.copy()
    P[:3, :3] += np.diag(np.square(doubt))
    return EKFSlam(Unicycle(), sensor, slam.mean, P, slam.ids)


def scene(seed, n=30, k=6, size=3.0, doubt=(0.3, 0.3, 0.05), sensor=SENSOR):
    """A lost filter, a look from where it truly stands, and what the look shows."""
    rng = np.random.default_rng(seed)
    landmarks = rng.uniform(-size, size, (n, 2))
    slam = lost(landmarks, doubt, sensor)
    shown = rng.choice(n, k, replace=False)
    true_pose = rng.multivariate_normal(np.zeros(3), slam.pose_cov)
    noise = rng.standard_normal((k, 2)) * [sensor.sigma_range, sensor.sigma_bearing]
    return slam, sensor.observe(true_pose, landmarks[shown]) + noise, shown


def innovation(slam, z, rows):
    return slam.sensor.residual(z, slam.sensor.observe(slam.pose, slam.landmarks[rows])).ravel()


def joint_distance(slam, z, named):
    """Brute force: stack, invert, multiply."""
    j, rows = list(named), np.array(list(named.values()), dtype=int)
    v = innovation(slam, z[j], rows)
    return float(v @ np.linalg.inv(slam.innovation_cov(rows)) @ v) if j else 0.0


def all_pairings(k, n):
    for rows in itertools.product([None, *range(n)], repeat=k):
        used = [r for r in rows if r is not None]
        if len(set(used)) == len(used):
            yield {j: r for j, r in enumerate(rows) if r is not None}


# --- single gates ---


def test_the_gate_accepts_true_pairs_as_often_as_it_says():
    """Property 37; a gate without the pose's doubt, or of one degree of freedom, does not."""
    slam = lost(np.array([[3.0, 1.0]]), doubt=(0.05, 0.05, 0.01))
    rng = np.random.default_rng(1)
    S = slam.innovation_covs([0])[0]
    z = slam.sensor.observe(slam.pose, slam.landmarks[0]) + rng.multivariate_normal(
        [0, 0], S, 5000
    )
    accepted = np.mean([nearest_neighbour(slam, one[None])[0] == 0 for one in z])
    assert accepted == pytest.approx(0.99, abs=0.005)
    distance = mahalanobis_squared(z - z.mean(0), SENSOR.cov)
    assert np.mean(distance < chi2.ppf(0.99, 2)) < 0.9
    assert np.mean(mahalanobis_squared(z - z.mean(0), S) < chi2.ppf(0.99, 1)) < 0.975


@pytest.mark.parametrize("sensor", [SENSOR, Wall(0.1, 0.03, offset=0.3)], ids=["points", "walls"])
def test_the_tree_finds_every_pair_that_the_wide_gate_holds(sensor):
    rng = np.random.default_rng(2)
    for seed in range(20):
        landmarks = rng.uniform([0, -np.pi], [4, np.pi], (40, 2))
        if isinstance(sensor, RangeBearing):
            landmarks = rng.uniform(-4, 4, (40, 2))
        slam, z, _ = scene(seed, sensor=sensor)
        slam = lost(landmarks, (0.4, 0.4, 0.1), sensor)
        z = rng.uniform([0.01, -np.pi], [4, np.pi], (8, 2))
        pairs = association._candidates(slam, z, 0.99, 0.9999)
        v = sensor.residual(z[:, None], sensor.observe(slam.pose, slam.landmarks)[None])
        S = slam.innovation_covs(np.arange(40))
        dense = np.einsum("kni,nij,knj->kn", v, np.linalg.inv(S), v)
        j, row = np.nonzero(dense <= chi2.ppf(0.9999, 2))
        assert set(zip(pairs.j, pairs.row, strict=True)) == set(zip(j, row, strict=True))
        np.testing.assert_allclose(pairs.distance, dense[pairs.j, pairs.row], rtol=1e-9)
        assert (pairs.inside == (pairs.distance <= chi2.ppf(0.99, 2))).all()
        assert 0 < len(j) < dense.size


@each
def test_a_clear_look_is_named_right_whatever_its_order(associate):
    slam, z, shown = scene(3, n=12, k=5, size=8.0, doubt=(0.02, 0.02, 0.002))
    np.testing.assert_array_equal(associate(slam, z), shown)
    order = np.random.default_rng(1).permutation(len(z))
    np.testing.assert_array_equal(associate(slam, z[order]), shown[order])


@each
def test_an_empty_map_is_all_new_and_an_empty_look_is_nothing(associate):
    slam = EKFSlam(Unicycle(), SENSOR, np.zeros(3))
    assert associate(slam, [[1.0, 0.0], [2.0, 1.0]]).tolist() == [NEW, NEW]
    assert associate(lost(np.ones((3, 2))), np.empty((0, 2))).shape == (0,)
    assert associate(slam, np.empty((0, 2))).shape == (0,)


@each
def test_two_measurements_never_share_a_landmark(associate):
    slam = lost(np.array([[3.0, 0.0]]), doubt=(0.01, 0.01, 0.001))
    z = slam.sensor.observe(slam.pose, slam.landmarks[[0, 0]]) + [[0.05, 0.0], [0.01, 0.0]]
    assert associate(slam, z).tolist() == [IGNORED, 0]


@gated
def test_between_the_gates_a_measurement_is_left_out(associate):
    slam = lost(np.array([[3.0, 0.0]]), doubt=(0.01, 0.01, 0.001))
    sigma = np.sqrt(slam.innovation_covs([0])[0, 0, 0])

    def at(d):
        return slam.sensor.observe(slam.pose, slam.landmarks) + [[d * sigma, 0.0]]

    assert associate(slam, at(2.5)).tolist() == [0]
    assert associate(slam, at(3.5)).tolist() == [IGNORED]
    assert associate(slam, at(5.0)).tolist() == [NEW]
    assert associate(slam, at(3.5), new_probability=0.99).tolist() == [NEW]
    assert associate(slam, at(2.5), probability=0.9).tolist() == [IGNORED]


@gated
def test_an_ambiguous_measurement_is_left_out_if_a_margin_is_asked_for(associate):
    slam = lost(np.array([[3.0, 0.2], [3.0, -0.2]]), doubt=(0.1, 0.1, 0.05))
    z = slam.sensor.observe(slam.pose, np.array([[3.0, 0.05]]))
    assert associate(slam, z).tolist() == [0]
    assert associate(slam, z, margin=4.6).tolist() == [IGNORED]
    clear = slam.sensor.observe(slam.pose, np.array([[3.0, 0.2], [5.0, 4.0]]))
    assert associate(slam, clear, margin=0.5).tolist() == [0, NEW]


def test_a_turn_more_of_the_bearing_changes_nothing():
    slam, z, _ = scene(4)
    for associate in METHODS:
        np.testing.assert_array_equal(associate(slam, z), associate(slam, z + [0, 2 * np.pi]))


@each
def test_a_rigid_motion_of_the_world_changes_nothing(associate):
    for seed in range(5):
        slam, z, _ = scene(seed)
        motion = np.array([2.0, -3.0, 1.1])
        c, s = np.cos(1.1), np.sin(1.1)
        turn = np.eye(len(slam.mean))
        turn[:2, :2] = [[c, -s], [s, c]]
        for i in range(3, len(turn), 2):
            turn[i : i + 2, i : i + 2] = [[c, -s], [s, c]]
        mean = [compose(motion, slam.pose), transform(motion, slam.landmarks).ravel()]
        P = turn @ slam.cov @ turn.T
        moved = EKFSlam(slam.motion, SENSOR, np.concatenate(mean), 0.5 * (P + P.T), slam.ids)
        np.testing.assert_array_equal(associate(moved, z), associate(slam, z))


# --- which one is nearest? ---


def test_the_euclidean_gate_fails_where_mahalanobis_works():
    """A bearing is poor far away: the right tree is farther in metres, nearer in sigmas."""
    sensor = RangeBearing(0.05, 0.1)
    slam = lost(np.array([[10.0, 0.0], [10.5, 1.2]]), doubt=(0.01, 0.01, 0.01), sensor=sensor)
    z = sensor.observe(slam.pose, slam.landmarks[:1]) + [[0.03, 0.15]]
    assert nearest_neighbour(slam, z).tolist() == [0]
    assert nearest_euclidean(slam, z, gate=2.0).tolist() == [1]
    assert nearest_euclidean(slam, z, gate=0.5).tolist() == [NEW]


def test_likelihood_prefers_the_sharp_landmark_where_distance_prefers_the_vague_one():
    P = np.diag([0, 0, 0, 0.05**2, 0.05**2, 2.0, 2.0])
    slam = EKFSlam(Unicycle(), SENSOR, [0, 0, 0, 3.0, 0.0, 4.0, 0.0], P, ["sharp", "vague"])
    z = slam.sensor.observe(slam.pose, np.array([[3.15, 0.0]]))
    assert nearest_neighbour(slam, z).tolist() == [1]
    assert maximum_likelihood(slam, z).tolist() == [0]


def test_likelihood_is_made_largest_for_all_together():
    """The best pair first leaves the second measurement without its landmark."""
    P = np.diag([0, 0, 0, 0.04, 0.04, 0.04, 0.04])
    slam = EKFSlam(Unicycle(), RangeBearing(0.05, 0.05), [0, 0, 0, 3.0, 0.0, 3.5, 0.0], P, "ab")
    z = np.array([[3.25, 0.0], [3.75, 0.0]])
    z[0, 0] += 0.01
    greedy = nearest_neighbour(slam, z)
    assert maximum_likelihood(slam, z).tolist() == [0, 1]
    assert greedy.tolist() == [1, IGNORED]


# --- joint compatibility ---


def staged(slam, z, named, order, gates):
    """Whether every stage of the search would let this pairing through."""
    stage = {}
    for j in order:
        if j in named:
            stage[j] = named[j]
            if joint_distance(slam, z, stage) > gates[len(stage)]:
                return False
    return True


def test_joint_compatibility_equals_brute_force_over_all_pairings():
    gates = [np.inf, *chi2.ppf(0.99, 2 * np.arange(1, 5))]
    agree_without_stages = 0
    for seed in range(25):
        slam, z, _ = scene(seed, n=5, k=4, size=1.2, doubt=(0.4, 0.4, 0.1))
        z[3] = [1.0, 0.4]
        options = [
            [r for r in range(5) if joint_distance(slam, z, {j: r}) < gates[1]] for j in range(4)
        ]
        order = sorted(range(4), key=lambda j, options=options: len(options[j]))
        fits = [
            (len(named), -joint_distance(slam, z, named), named)
            for named in all_pairings(4, 5)
            if all(r in options[j] for j, r in named.items())
            and joint_distance(slam, z, named) < gates[len(named)]
        ]
        best = max(
            (one for one in fits if staged(slam, z, one[2], order, gates)), key=lambda o: o[:2]
        )
        found = joint_search(slam, z)
        assert found.complete
        assert {j: r for j, r in enumerate(found.rows) if r >= 0} == best[2]
        assert found.pairs == best[0]
        assert found.distance == pytest.approx(-best[1], rel=1e-9)
        # The stages, a shortcut of the published algorithm, hardly ever change the answer.
        agree_without_stages += max(fits, key=lambda one: one[:2])[2] == best[2]
    assert agree_without_stages >= 23


def test_the_joint_distance_is_not_the_sum_of_the_single_ones():
    slam, z, shown = scene(5, n=6, k=6, size=4.0, doubt=(0.5, 0.5, 0.1))
    found = joint_search(slam, z)
    np.testing.assert_array_equal(found.rows, shown)
    named = dict(enumerate(found.rows))
    assert found.distance == pytest.approx(joint_distance(slam, z, named), rel=1e-9)
    singles = sum(joint_distance(slam, z, {j: r}) for j, r in named.items())
    assert abs(singles - found.distance) > 0.2 * found.distance


def test_single_gates_fail_where_joint_compatibility_works():
    """A row of trees one metre apart, and a robot that stands 0.8 m farther on than it thinks."""
    trees = np.column_stack([np.arange(8.0), np.full(8, 2.0)])
    slam = lost(trees, doubt=(0.5, 0.1, 0.01))
    z = slam.sensor.observe(np.array([0.8, 0.0, 0.0]), trees[1:7])
    assert (nearest_neighbour(slam, z) == np.arange(0, 6)).sum() >= 5, "all shifted by one"
    assert (maximum_likelihood(slam, z) == np.arange(1, 7)).sum() <= 1
    trees[3, 1] = 3.0
    slam = lost(trees, doubt=(0.5, 0.1, 0.01))
    z = slam.sensor.observe(np.array([0.8, 0.0, 0.0]), trees[1:7])
    assert joint_compatibility(slam, z).tolist() == [1, 2, 3, 4, 5, 6]


def test_many_lost_looks_are_named_right_by_the_joint_search():
    score = {associate: [] for associate in GATED}
    for seed in range(40):
        slam, z, shown = scene(seed, n=40, k=8, doubt=(0.4, 0.4, 0.1))
        for associate, right in score.items():
            right.append(np.mean(associate(slam, z) == shown))
    means = {associate.__name__: np.mean(right) for associate, right in score.items()}
    assert means["joint_compatibility"] > 0.8
    assert means["nearest_neighbour"] < 0.6
    assert means["maximum_likelihood"] < 0.7


def test_a_search_that_is_cut_short_says_so_and_is_no_worse_than_the_first_descent():
    slam, z, _ = scene(2, n=60, k=10, size=1.0, doubt=(1.0, 1.0, 0.3))
    with pytest.warns(SearchLimitWarning, match="after 11 hypotheses"):
        rows = joint_compatibility(slam, z, max_nodes=11)
    first, full = joint_search(slam, z, max_nodes=11), joint_search(slam, z, max_nodes=1500)
    assert not first.complete
    assert first.nodes == 11
    np.testing.assert_array_equal(first.rows, rows)
    assert 0 < first.pairs <= full.pairs
    for found in (first, full):
        named = {j: r for j, r in enumerate(found.rows) if r >= 0}
        assert len(named) == found.pairs
        assert joint_distance(slam, z, named) < chi2.ppf(0.99, 2 * found.pairs)


def test_a_search_of_one_node_still_answers_with_a_compatible_set():
    slam, z, _ = scene(2, n=60, k=10, size=1.0, doubt=(1.0, 1.0, 0.3))
    found = [joint_search(slam, z, max_nodes=nodes) for nodes in (1, 4, 11, 300)]
    assert [one.nodes for one in found] == [1, 4, 11, 300]
    pairs = [one.pairs for one in found]
    assert pairs == sorted(pairs)
    assert pairs[0] == 1
    assert pairs[-1] > pairs[1]
    for one in found:
        named = {j: r for j, r in enumerate(one.rows) if r >= 0}
        assert joint_distance(slam, z, named) < chi2.ppf(0.99, 2 * one.pairs)
    easy, look, shown = scene(3, n=12, k=5, size=8.0, doubt=(0.02, 0.02, 0.002))
    found = joint_search(easy, look)
    assert (found.complete, found.nodes) == (True, 5)
    np.testing.assert_array_equal(found.rows, shown)


def test_a_known_pose_makes_the_joint_distance_a_sum():
    landmarks = np.random.default_rng(1).uniform(-4, 4, (10, 2))
    fast = FastSlam(Unicycle(), SENSOR, np.zeros(3), 5, rng=np.random.default_rng(1))
    fast.update(SENSOR.observe(np.zeros(3), landmarks))
    particle = fast.particle(2)
    z = SENSOR.observe(particle.pose, landmarks[:4]) + 0.02
    found = joint_search(particle, z)
    singles = [joint_distance(particle, z[[j]], {0: r}) for j, r in enumerate(found.rows)]
    assert found.distance == pytest.approx(sum(singles), rel=1e-9)


# --- in the filters ---


@each
def test_both_filters_take_every_association(associate):
    rng = np.random.default_rng(6)
    landmarks = rng.uniform(-5, 5, (6, 2))
    ekf = EKFSlam(Unicycle(), SENSOR, np.zeros(3), associate=associate)
    fast = FastSlam(Unicycle(), SENSOR, np.zeros(3), 8, version=2, rng=rng, associate=associate)
    pose, u, V = np.zeros(3), np.array([0.5, 0.2]), np.diag([1e-4, 1e-4])
    for _ in range(6):
        pose = Unicycle().step(pose, u, 0.2)
        z, _ = SENSOR.measure(pose, landmarks, rng)
        ekf.predict(u, 0.2, V)
        ekf.update(z)
        fast.predict(u, 0.2, V)
        fast.update(z)
    assert ekf.n_landmarks == 6
    assert fast.particle(0).n_landmarks == 6
    np.testing.assert_allclose(np.sort(ekf.landmarks, 0), np.sort(landmarks, 0), atol=0.5)


def test_the_filter_asks_the_nearest_neighbour_if_nobody_else_is_named():
    slam, z, _ = scene(8, size=6.0, doubt=(0.05, 0.05, 0.01))
    rows = nearest_neighbour(slam, z)
    slam.predict([0.0, 0.0], 0.1, np.zeros((2, 2)))
    names = slam.update(z).ids
    assert [slam.ids.index(name) for name, row in zip(names, rows, strict=True) if row >= 0] == [
        row for row in rows if row >= 0
    ]


# --- confirmation ---


def test_a_landmark_is_started_at_its_third_sighting_and_clutter_never():
    rng = np.random.default_rng(3)
    landmarks = rng.uniform(-4, 4, (5, 2))
    careful = Confirmation(n_observations=3)
    slam = EKFSlam(Unicycle(), SENSOR, np.zeros(3), associate=careful)
    eager = EKFSlam(Unicycle(), SENSOR, np.zeros(3))
    for k in range(12):
        z, _ = SENSOR.measure(np.zeros(3), landmarks, rng)
        z = np.concatenate([z, rng.uniform([4, -np.pi], [12, np.pi], (2, 2))])
        names = slam.update(z).ids
        eager.update(z)
        assert (slam.n_landmarks > 0) == (k >= 2)
        assert len([n for n in names if n is not None]) in (0, 5)
    assert slam.n_landmarks == 5
    assert eager.n_landmarks > 15
    assert len(careful.tentative) <= 12


def test_a_tentative_place_is_forgotten_after_its_patience():
    slam = EKFSlam(Unicycle(), SENSOR, np.zeros(3))
    careful, z = Confirmation(n_observations=2, patience=3), [[3.0, 0.0]]
    assert careful(slam, z).tolist() == [IGNORED]
    for _ in range(3):
        careful(slam, np.empty((0, 2)))
    assert len(careful.tentative) == 1
    assert careful(slam, z).tolist() == [NEW]
    assert len(careful.tentative) == 0
    careful(slam, z)
    for _ in range(4):
        careful(slam, np.empty((0, 2)))
    assert careful(slam, z).tolist() == [IGNORED]


def test_confirmation_wraps_any_association_and_one_sighting_changes_nothing():
    slam, z, _ = scene(9, doubt=(0.1, 0.1, 0.02))
    z = np.concatenate([z, [[9.0, 0.0], [9.0, 1.0]]])
    for associate in METHODS:
        once = Confirmation(associate, n_observations=1)
        np.testing.assert_array_equal(once(slam, z), associate(slam, z))
        twice = Confirmation(partial(associate), n_observations=2, probability=0.99)
        expected = associate(slam, z)
        np.testing.assert_array_equal(twice(slam, z), np.where(expected == NEW, IGNORED, expected))


def test_two_new_measurements_side_by_side_are_two_places():
    slam, careful = EKFSlam(Unicycle(), SENSOR, np.zeros(3)), Confirmation(n_observations=2)
    z = [[3.0, 0.0], [3.0, 0.02]]
    assert careful(slam, z).tolist() == [IGNORED, IGNORED]
    assert len(careful.tentative) == 2
    assert careful(slam, z).tolist() == [NEW, NEW]


# --- measurements that are better or worse known than the sensor says ---


def with_covs(seed, scale):
    """One measurement of one of two landmarks, drawn with its own covariance."""
    rng = np.random.default_rng(seed)
    slam = EKFSlam(
        Unicycle(), SENSOR, [0, 0, 0, 5, 0, 0, 8], np.diag([1e-6] * 3 + [1e-4] * 4), ids="ab"
    )
    covs = np.array([SENSOR.cov * scale])
    due = slam.innovation_covs([0])[0] - SENSOR.cov + covs[0]
    z = SENSOR.observe(slam.pose, slam.landmarks[:1])
    return slam, z + rng.multivariate_normal([0, 0], due, 1), covs


@gated
@pytest.mark.parametrize("scale", [0.1, 1.0, 25.0])
def test_the_gate_knows_the_covariance_of_each_measurement(associate, scale):
    trials = [with_covs(seed, scale) for seed in range(600)]
    accepted = np.mean([associate(slam, z, covs=covs)[0] == 0 for slam, z, covs in trials])
    assert 0.975 < accepted <= 0.9999
    if scale == 25.0:
        blind = np.mean([associate(slam, z)[0] == 0 for slam, z, _ in trials])
        assert blind < 0.5, "without them a coarse measurement fails the gate"
    filtered = []
    for slam, z, covs in trials[:100]:
        slam.associate = associate
        filtered.append(slam.update(z, covs=covs).ids == ("a",))
    assert np.mean(filtered) > 0.9


def test_joint_search_weighs_each_pair_with_its_own_covariance():
    """Two measurements, one coarse: the joint distance is that of the stacked innovation."""
    slam = lost(np.array([[3.0, 0.5], [2.0, -1.5]]))
    z = SENSOR.observe(slam.pose + [0.05, 0.05, 0.02], slam.landmarks) + [[0.3, 0.0], [0, 0.01]]
    covs = np.array([20 * SENSOR.cov, 0.5 * SENSOR.cov])
    found = joint_search(slam, z, covs=covs)
    v = SENSOR.residual(z, SENSOR.observe(slam.pose, slam.landmarks)).ravel()
    S = slam.innovation_cov([0, 1])
    for k in range(2):
        S[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += covs[k] - SENSOR.cov
    assert found.rows.tolist() == [0, 1]
    assert found.distance == pytest.approx(v @ np.linalg.solve(S, v))
    assert abs(joint_search(slam, z).distance - found.distance) > 0.1


def test_a_coarse_measurement_returns_to_its_tentative_place():
    slam, coarse = EKFSlam(Unicycle(), SENSOR, np.zeros(3)), np.array([100 * SENSOR.cov])
    for covs, due in ((coarse, NEW), (None, IGNORED)):
        careful = Confirmation(n_observations=2)
        more = {} if covs is None else {"covs": covs}
        assert careful(slam, [[3.0, 0.0]], **more).tolist() == [IGNORED]
        assert careful(slam, [[4.0, 0.1]], **more).tolist() == [due]


# --- the loop with drift and clutter ---


def loops(n_runs, **conditions):
    drives = [orchard_loop(np.random.default_rng(seed), **conditions) for seed in range(n_runs)]
    return {f.__name__: np.array([loop_scores(log, f) for log in drives]).T for f in GATED}


def loop_scores(log, associate):
    """Precision, recall and the error of the last position."""
    options = dict(associate=Confirmation(associate))
    slam = EKFSlam(Unicycle(), ORCHARD_SENSOR, log.truth[0], **options)
    result = run(slam, log, known_ids=51)
    scores = association_scores(result, 51)
    return scores.precision, scores.recall, np.hypot(*(slam.pose - log.truth[-1])[:2])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::slamlab.slam.association.SearchLimitWarning")
def test_precision_and_recall_on_a_loop_with_drift_and_clutter():
    """50 runs; the bands are those of a 99 % interval of the mean, by the runs' own spread."""
    score = loops(50, laps=1.06)
    low = {k: np.mean(p) - 2.6 * np.std(p) / np.sqrt(50) for k, (p, _, _) in score.items()}
    high = {k: np.mean(p) + 2.6 * np.std(p) / np.sqrt(50) for k, (p, _, _) in score.items()}
    assert low["joint_compatibility"] > high["maximum_likelihood"] > high["nearest_neighbour"]
    precision, recall, error = score["joint_compatibility"]
    assert precision.mean() > 0.98
    assert recall.mean() > 0.88
    assert np.mean(error < 0.25) > 0.9
    assert np.mean(score["nearest_neighbour"][0] < 0.9) > 0.25, "loops closed wrongly"


@pytest.mark.filterwarnings("ignore::slamlab.slam.association.SearchLimitWarning")
def test_a_few_loops_with_drift_and_clutter():
    score = loops(6, laps=1.03, clutter_rate=2.0)
    assert score["joint_compatibility"][0].mean() > 0.97
    assert score["nearest_neighbour"][0].mean() < 0.95


# --- refusals ---


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0, 2.0],), "z: expected shape"),
        (([[1.0, np.nan]],), "z: expected finite"),
        (([[1.0, 0.0]], 1.5), "probability"),
        (([[1.0, 0.0]], 0.0), "probability"),
    ],
)
@gated
def test_bad_input_is_named(associate, arguments, message):
    with pytest.raises(ValueError, match=message):
        associate(lost(np.ones((2, 2))), *arguments)


@gated
def test_bad_options_are_named(associate):
    slam, z = lost(np.ones((2, 2))), [[1.0, 0.0]]
    with pytest.raises(ValueError, match="margin"):
        associate(slam, z, margin=-1)
    with pytest.raises(ValueError, match="new_probability"):
        associate(slam, z, 0.99, new_probability=0.9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: nearest_euclidean(s, [[1.0, 0.0]], gate=0), "gate"),
        (lambda s: nearest_euclidean(s, [[1.0, np.inf]]), "z: expected finite"),
        (lambda s: joint_compatibility(s, [[1.0, 0.0]], max_nodes=0), "max_nodes"),
        (lambda s: joint_search(s, [[1.0, 0.0]], max_nodes=1.5), "max_nodes"),
        (lambda s: Confirmation(n_observations=0), "n_observations"),
        (lambda s: Confirmation(patience=-1), "patience"),
        (lambda s: Confirmation(probability=2), "probability"),
        (lambda s: Confirmation()(s, [1.0, 0.0]), "z: expected shape"),
    ],
)
def test_bad_input_of_the_others_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(lost(np.ones((2, 2))))


def test_confirmation_refuses_a_particle():
    fast = FastSlam(Unicycle(), SENSOR, np.zeros(3), 3, rng=np.random.default_rng(1))
    with pytest.raises(ValueError, match="slam: expected EKFSlam"):
        Confirmation()(fast.particle(0), [[1.0, 0.0]])
