"""The compressed EKF is the full EKF; updating a block of the covariance alone is no filter."""

import numpy as np
import pytest

from slamlab.evaluation import run
from slamlab.printed.p4 import LocalBlockSlam
from slamlab.robots import YOUBOT, Unicycle
from slamlab.sensors import RangeBearing
from slamlab.simulation import FIELD_SENSOR, field_flights
from slamlab.slam import CompressedEKFSlam, EKFSlam

DT, V = 0.1, YOUBOT.control_cov(0.5)
SENSOR = RangeBearing(0.05, 0.02, offset=0.3, max_range=5.0)


def drive(n_steps, seed=1, n=80):
    """Rounds through a yard of 40 x 20 m: controls, measurements, ids."""
    rng = np.random.default_rng(seed)
    landmarks = rng.uniform([-20, -10], [20, 10], (n, 2))
    angle = np.linspace(0, 4 * np.pi, n_steps + 1)
    route = np.stack([16 * np.cos(angle), 6 * np.sin(angle)], 1)
    heading = np.arctan2(6 * np.cos(angle), -16 * np.sin(angle))
    pose = np.array([*route[0], heading[0]])
    for k in range(n_steps):
        ahead = route[k + 1] - pose[:2]
        c, s = np.cos(pose[2]), np.sin(pose[2])
        turn = (heading[k + 1] - pose[2] + np.pi) % (2 * np.pi) - np.pi
        u = np.array([c * ahead[0] + s * ahead[1], c * ahead[1] - s * ahead[0], turn]) / DT
        pose = YOUBOT.sample(pose, u, DT, V, rng)
        z, ids = SENSOR.measure(pose, landmarks, rng)
        yield u, z[:6], ids[:6]


def assert_same(compressed, full):
    settled = compressed.global_update()
    assert settled.ids == full.ids
    np.testing.assert_allclose(settled.mean, full.mean, atol=1e-9)
    np.testing.assert_allclose(settled.cov, full.cov, atol=1e-9)
    np.testing.assert_array_equal(settled.n_observations, full.n_observations)
    np.testing.assert_array_equal(settled.steps_since_observed, full.steps_since_observed)


def test_compressed_equals_full_over_2000_steps_and_many_regions():
    start = [16.0, 0.0, np.pi / 2]
    full, compressed = EKFSlam(YOUBOT, SENSOR, start), CompressedEKFSlam(YOUBOT, SENSOR, start)
    regions, largest = 0, 0
    for k, (u, z, ids) in enumerate(drive(2000)):
        known = [name for name in ids.tolist() if name in compressed.ids]
        if k % 100 == 0 or not set(known) <= set(compressed.local.ids):
            compressed.set_region({*compressed.landmarks_within(7.0), *known})
            regions += 1
        for one in (full, compressed):
            one.predict(u, DT, V)
            one.update(z, ids)
        largest = max(largest, compressed.local.n_landmarks)
        np.testing.assert_allclose(compressed.pose, full.pose, atol=1e-9)
        np.testing.assert_allclose(compressed.pose_cov, full.pose_cov, atol=1e-9)
        if k % 400 == 399:
            assert_same(compressed, full)
    assert regions >= 20
    assert full.n_landmarks > 1.5 * largest
    assert_same(compressed, full)


def small(seed=3, n=6):
    rng = np.random.default_rng(seed)
    root = 0.05 * rng.standard_normal((3 + 2 * n, 3 + 2 * n))
    mean = np.concatenate([np.zeros(3), rng.uniform(3, 8, 2 * n)])
    arguments = (YOUBOT, RangeBearing(0.1, 0.02), mean, root @ root.T, range(n))
    return CompressedEKFSlam(*arguments), EKFSlam(*arguments)


def test_new_landmarks_and_known_ones_in_one_look():
    compressed, full = small()
    compressed.set_region([4, 1])
    z = full.sensor.observe(full.pose, full.landmarks[[1, 4]]) + 0.03
    for one in (compressed, full):
        one.update(np.vstack([z, [[2.0, 1.0], [3.0, -1.0]]]), [1, 4, "a", "b"])
        one.predict([0.1, 0, 0], DT, V)
        one.update([[2.0, 1.05]], ["a"])
    assert compressed.ids == full.ids == (0, 1, 2, 3, 4, 5, "a", "b")
    assert compressed.n_landmarks == 8
    assert_same(compressed, full)


def test_each_forgotten_account_is_noticed():
    """The recursions, mutated: without Phi, Psi or theta the landmarks outside go wrong."""
    for name in ("Phi", "Psi", "theta"):
        compressed, full = small()
        compressed.set_region([4, 1])
        z = full.sensor.observe(full.pose, full.landmarks[[1, 4]]) + 0.03
        for one in (compressed, full):
            one.predict([0.1, 0.2, 0.3], DT, V)
            one.update(z, [1, 4])
        account = getattr(compressed, f"_{name}")
        account[...] = np.eye(7) if name == "Phi" else 0.0
        settled = compressed.global_update()
        off = max(np.abs(settled.mean - full.mean).max(), np.abs(settled.cov - full.cov).max())
        assert off > 1e-5, name


def test_a_landmark_outside_the_region_opens_a_new_one():
    compressed, full = small()
    compressed.radius = 1.0
    compressed.set_region([4, 1])
    z = full.sensor.observe(full.pose, full.landmarks[[1, 2]]) + 0.03
    for one in (compressed, full):
        one.update(z[:1], [1])
        one.update(z, [1, 2])
    assert 2 in compressed.local.ids
    assert 0 not in compressed.local.ids
    assert compressed.n_regions == 3
    assert_same(compressed, full)


def test_a_landmark_met_in_the_old_region_and_far_away_comes_along():
    compressed, full = small()
    compressed.radius = 1.0
    compressed.set_region([4, 1])
    z = full.sensor.observe(full.pose, full.landmarks[[1, 2]]) + 0.03
    for one in (compressed, full):
        one.update([[30.0, 0.5]], ["far"])
        one.update(np.vstack([z, [[30.1, 0.5]]]), [1, 2, "far"])
    assert "far" in compressed.local.ids
    assert_same(compressed, full)


def test_a_robot_that_has_driven_on_opens_a_new_region():
    compressed, full = small()
    compressed.radius = 6.0
    compressed.set_region([0])
    compressed.predict([3.1, 0, 0], 1.0, V)
    compressed.update(np.empty((0, 2)), [])
    assert compressed.n_regions == 3
    assert compressed.local.ids == compressed.landmarks_within(6.0)
    assert 0 < len(compressed.local.ids) < 6


def test_regions_refuse_unknown_names():
    compressed, _ = small()
    with pytest.raises(ValueError, match="expected landmarks of the map, got \\[9\\]"):
        compressed.set_region([9])
    with pytest.raises(ValueError, match="every landmark once"):
        compressed.set_region([1, 1])
    for ids in (5, [[1]]):
        with pytest.raises(ValueError, match="ids: expected a sequence of names"):
            compressed.set_region(ids)
    with pytest.raises(ValueError, match="radius"):
        compressed.landmarks_within(-1.0)


def test_fresh_names_do_not_collide_with_landmarks_outside():
    compressed, _ = small()
    compressed._full.associate = lambda slam, z: [-1]
    compressed.set_region([0])
    assert compressed.update([[2.0, 1.0]]).ids == (6,)
    assert compressed.global_update().ids == (0, 1, 2, 3, 4, 5, 6)


def test_settling_twice_changes_nothing():
    compressed, _ = small()
    compressed.set_region([4, 1])
    compressed.predict([0.1, 0, 0], DT, V)
    first = compressed.global_update().cov.copy()
    np.testing.assert_array_equal(compressed.global_update().cov, first)
    assert compressed.local.ids == (4, 1)


def test_first_region_is_the_whole_map():
    slam = CompressedEKFSlam(Unicycle(), SENSOR, [0, 0, 0])
    slam.update([[2.0, 0.1]], [5])
    assert slam.local.ids == slam.ids == slam.global_update().ids == (5,)
    assert slam.landmarks_within(3.0) == (5,)
    assert slam.landmarks_within(1.0) == ()


def test_updating_the_local_block_alone_gives_no_covariance_in_any_of_200_trials():
    """P4's region read literally: P_aa is corrected, P_ab and P_bb are left as they were."""
    rng = np.random.default_rng(0)
    smallest = []
    for _ in range(200):
        root = rng.standard_normal((11, 11))
        P = root @ root.T
        H = np.zeros((2, 11))
        H[:, :5] = rng.standard_normal((2, 5))
        S = H @ P @ H.T + 0.01 * np.eye(2)
        right, local = P - P @ H.T @ np.linalg.solve(S, H @ P), P.copy()
        local[:7, :7] = right[:7, :7]
        assert np.linalg.eigvalsh(right)[0] > -1e-10
        smallest.append(np.linalg.eigvalsh(local)[0])
    assert max(smallest) < -1e-3


def test_a_region_that_knows_its_reach_lasts_until_it_could_see_out():
    compressed, full = small()
    compressed.radius, compressed._reach = 6.0, 1.0
    compressed.set_region([0])
    for _ in range(5):
        compressed.predict([0.9, 0, 0], 1.0, V)
        full.predict([0.9, 0, 0], 1.0, V)
        compressed.update(np.empty((0, 2)), [])
    assert compressed.n_regions == 2  # 4.5 m driven, 5 m allowed; half the radius would be 3 m
    compressed.predict([0.9, 0, 0], 1.0, V)
    full.predict([0.9, 0, 0], 1.0, V)
    compressed.update(np.empty((0, 2)), [])
    assert compressed.n_regions == 3
    assert_same(compressed, full)


def test_reach_is_at_most_the_radius_and_half_of_it_if_nothing_is_said():
    arguments = (Unicycle(), SENSOR, [0, 0, 0])
    assert CompressedEKFSlam(*arguments, radius=8.0).reach == 4.0
    assert CompressedEKFSlam(*arguments, radius=8.0, reach=5.0).reach == 5.0
    with pytest.raises(ValueError, match="reach"):
        CompressedEKFSlam(*arguments, radius=8.0, reach=9.0)


def test_settling_a_large_map_is_exact_too():
    """Above 256 numbers only the lower triangle of the covariance is kept."""
    log = field_flights(1, np.random.default_rng(1), side=150.0).single(0)
    arguments = (Unicycle(), FIELD_SENSOR, log.truth[0])
    full = run(EKFSlam(*arguments), log)
    local = run(CompressedEKFSlam(*arguments, radius=40.0, reach=20.0), log)
    assert len(full.system.mean) > 400
    assert local.system.n_regions > 20
    np.testing.assert_allclose(local.poses, full.poses, atol=1e-8)
    np.testing.assert_allclose(local.covs, full.covs, atol=1e-8)
    assert_same(local.system, full.system)


def test_the_local_block_alone_ends_a_flight_early():
    """P4's region read word by word; the compressed filter flies the same log to its end."""
    log = field_flights(1, np.random.default_rng(1)).single(0)
    arguments = (Unicycle(), FIELD_SENSOR, log.truth[0])
    whole = run(CompressedEKFSlam(*arguments, radius=40.0, reach=20.0), log)
    assert np.hypot(*(whole.poses[-1] - log.truth[-1])[:2]) < 1.5
    slam, smallest = LocalBlockSlam(*arguments, radius=40.0, reach=20.0), []
    for step in log[:60]:
        if step.dt:
            slam.predict(step.u, step.dt, step.control_cov)
        slam.update(step.z, step.ids)
        smallest.append(np.linalg.eigvalsh(slam.global_update().cov)[0])
    assert min(smallest) < -1e-3


@pytest.mark.parametrize(
    "arguments",
    [([[7.0, 0.3], [1.5, np.nan]], ["far", "a"]), ([[7.0, 0.3]], ["far", "a"]),
     ([[7.0, 0.3]], ["far"], -np.eye(2))],
)  # fmt: skip
def test_a_refused_update_leaves_the_region_as_it_was(arguments):
    slam = CompressedEKFSlam(Unicycle(), SENSOR, [0, 0, 0], radius=4.0)
    slam.update([[2.0, 0.0], [9.0, 0.3]], ["a", "far"])
    slam.set_region(["a"])
    slam.predict([2.5, 0], 1.0, 0.01 * np.eye(2))
    before, mean = (slam.n_regions, slam.local, slam.local.ids), slam.local.mean
    with pytest.raises(ValueError, match="z|ids|covs"):
        slam.update(*arguments)
    assert (slam.n_regions, slam.local, slam.local.ids) == before
    np.testing.assert_array_equal(slam.local.mean, mean)
    slam.update([[7.0, 0.3]], ["far"])
    assert slam.n_regions == 3
