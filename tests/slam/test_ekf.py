"""EKF-SLAM: one block update, growth, removal, failure without harm, 10^4 steps."""

import copy

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamlab.filters import kalman
from slamlab.gaussian import Gaussian
from slamlab.robots import Unicycle
from slamlab.sensors import RangeBearing, Wall
from slamlab.slam import EKFSlam
from slamlab.slam.ekf import downdate

MOTION, SENSOR = Unicycle(), RangeBearing(0.1, 0.02, offset=0.3)
V, DT, U = np.diag([0.04, 0.01]), 0.1, np.array([1.0, 0.2])


def some_slam(n=6, seed=1, sensor=SENSOR):
    """A filter in the middle of its life: n landmarks, everything correlated."""
    rng = np.random.default_rng(seed)
    root = 0.05 * rng.standard_normal((3 + 2 * n, 3 + 2 * n))
    mean = np.concatenate([rng.normal(0, 1, 3), 5 + rng.uniform(0, 5, 2 * n)])
    return EKFSlam(MOTION, sensor, mean, root @ root.T, ids=range(n))


def look(slam, rows, seed=2):
    rng = np.random.default_rng(seed)
    z = slam.sensor.observe(slam.pose, slam.landmarks[rows])
    return z + rng.standard_normal(z.shape) * [0.1, 0.02]


def dense_jacobian(slam, rows):
    H = np.zeros((2 * len(rows), len(slam.mean)))
    H_pose, H_landmark = slam.sensor.jacobians(slam.pose, slam.landmarks[rows])
    for k, row in enumerate(rows):
        H[2 * k : 2 * k + 2, :3] = H_pose[k]
        H[2 * k : 2 * k + 2, 3 + 2 * row : 5 + 2 * row] = H_landmark[k]
    return H


def state(slam):
    return (
        slam.mean.copy(),
        slam.cov.copy(),
        slam.ids,
        slam.n_observations.copy(),
        slam.steps_since_observed.copy(),
    )


def assert_same_state(slam, before):
    for now, then in zip(state(slam), before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_prediction_is_the_dense_one_and_leaves_the_landmarks():
    slam = some_slam()
    F_x, F_u = MOTION.jacobians(slam.pose, U, DT)
    F = np.eye(len(slam.mean))
    F[:3, :3] = F_x
    cov = F @ slam.cov @ F.T
    cov[:3, :3] += F_u @ V @ F_u.T
    pose, landmarks = MOTION.step(slam.pose, U, DT), slam.landmarks.copy()
    slam.predict(U, DT, V)
    np.testing.assert_allclose(slam.cov, cov, atol=1e-15)
    np.testing.assert_array_equal(slam.pose, pose)
    np.testing.assert_array_equal(slam.landmarks, landmarks)


@pytest.mark.parametrize("rows", [[2], [0, 5], [4, 1, 3, 0, 2, 5]])
def test_update_is_one_dense_kalman_update(rows):
    slam = some_slam()
    H, z = dense_jacobian(slam, rows), look(slam, rows)
    v = SENSOR.residual(z, SENSOR.observe(slam.pose, slam.landmarks[rows])).ravel()
    R = np.kron(np.eye(len(rows)), SENSOR.cov)
    belief = Gaussian(slam.mean.copy(), slam.cov.copy())
    # A linear measurement with this H, whose innovation is v.
    due, innovation = kalman.update(belief, H @ belief.mean + v, H, R)
    ours = slam.update(z, rows)
    np.testing.assert_allclose(slam.mean, due.mean, atol=1e-13)
    np.testing.assert_allclose(slam.cov, due.cov, atol=1e-14)
    np.testing.assert_allclose(ours.innovation, innovation.innovation, atol=1e-13)
    np.testing.assert_allclose(ours.S, innovation.S, atol=1e-14)
    np.testing.assert_allclose(ours.gain, innovation.gain, atol=1e-12)
    assert ours.nis == pytest.approx(innovation.nis, rel=1e-9)
    assert ours.log_likelihood == pytest.approx(innovation.log_likelihood, rel=1e-9)


def test_own_covariances_take_the_place_of_the_sensors():
    slam, rows = some_slam(), [1, 4]
    covs = np.array([[[0.04, 0.01], [0.01, 0.02]], [[0.09, 0], [0, 0.01]]])
    H, z, P = dense_jacobian(slam, rows), look(slam, rows), slam.cov.copy()
    R = np.zeros((4, 4))
    R[:2, :2], R[2:, 2:] = covs
    S = H @ P @ H.T + R
    slam.update(z, rows, covs)
    np.testing.assert_allclose(slam.cov, P - P @ H.T @ np.linalg.solve(S, H @ P), atol=1e-14)
    other = some_slam()
    other.update(z, rows, covs[0])
    assert not np.allclose(other.cov, slam.cov)


def test_new_landmark_is_placed_from_the_corrected_pose():
    both, one_by_one = some_slam(), some_slam()
    known, fresh = look(both, [2]), np.array([[3.0, 2.9], [4.0, -1.0]])
    both.update(np.vstack([fresh[:1], known, fresh[1:]]), ["a", 2, "b"])
    one_by_one.update(known, [2])
    one_by_one.update(fresh[:1], ["a"])
    one_by_one.update(fresh[1:], ["b"])
    assert both.ids == one_by_one.ids == (0, 1, 2, 3, 4, 5, "a", "b")
    np.testing.assert_allclose(both.mean, one_by_one.mean, atol=1e-13)
    np.testing.assert_allclose(both.cov, one_by_one.cov, atol=1e-14)
    np.testing.assert_allclose(both.landmarks[6], SENSOR.locate(both.pose, fresh[0]))


def test_a_map_that_grows_keeps_everything():
    slam = EKFSlam(MOTION, SENSOR, [0, 0, 0], np.diag([0.01, 0.01, 0.001]))
    for k in range(60):
        before, cov = slam.mean.copy(), slam.cov.copy()
        slam.update([[2.0 + k, 0.1 * k]], [k])
        np.testing.assert_array_equal(slam.mean[: len(before)], before)
        np.testing.assert_array_equal(slam.cov[: len(before), : len(before)], cov)
    assert slam.n_landmarks == 60
    assert slam.cov.shape == (123, 123)


def test_blocks_are_those_of_the_whole_covariance():
    slam = some_slam()
    slam.predict(U, DT, V)
    pose_cov, landmark_covs, one = slam.pose_cov, slam.landmark_covs, slam.landmark_cov(3)
    cov = slam.cov
    np.testing.assert_array_equal(pose_cov, cov[:3, :3])
    for k in range(6):
        np.testing.assert_array_equal(
            landmark_covs[k], cov[3 + 2 * k : 5 + 2 * k, 3 + 2 * k : 5 + 2 * k]
        )
    np.testing.assert_array_equal(one, landmark_covs[3])


def test_innovation_covariances_single_and_joint():
    slam, rows = some_slam(), [4, 0, 3]
    slam.predict(U, DT, V)
    joint, single = slam.innovation_cov(rows), slam.innovation_covs(rows)
    H = dense_jacobian(slam, rows)
    due = H @ slam.cov @ H.T + np.kron(np.eye(3), SENSOR.cov)
    np.testing.assert_allclose(joint, due, atol=1e-14)
    for k in range(3):
        np.testing.assert_allclose(
            single[k], due[2 * k : 2 * k + 2, 2 * k : 2 * k + 2], atol=1e-14
        )
    assert abs(joint[0, 2]) > 1e-6
    assert slam.innovation_covs([]).shape == (0, 2, 2)
    assert slam.innovation_cov([]).shape == (0, 0)
    with pytest.raises(ValueError, match="rows: expected rows of 6 landmarks"):
        slam.innovation_covs([6])
    with pytest.raises(ValueError, match="rows: expected whole numbers"):
        slam.innovation_cov([0.5])


def test_removed_landmark_is_marginalised():
    slam = some_slam()
    slam.predict(U, DT, V)
    mean, cov = slam.mean.copy(), slam.cov.copy()
    slam.remove([4, 1])
    keep = np.r_[0:5, 7:11, 13:15]
    assert slam.ids == (0, 2, 3, 5)
    np.testing.assert_array_equal(slam.mean, mean[keep])
    np.testing.assert_array_equal(slam.cov, cov[np.ix_(keep, keep)])
    slam.update(look(slam, [1]), [2])
    assert slam.n_observations.tolist() == [1, 2, 1, 1]
    assert slam.landmark_cov(2)[0, 0] < cov[7, 7]


def test_landmarks_hardly_seen_are_removed():
    slam = EKFSlam(MOTION, SENSOR, [0, 0, 0])
    slam.update([[2.0, 0.1], [3.0, 1.0]], ["tree", "ghost"])
    for _ in range(10):
        slam.predict([0.0, 0.0], DT, V)
        slam.update(look(slam, [0]), ["tree"])
    assert slam.steps_since_observed.tolist() == [0, 10]
    assert slam.prune(steps=11) == ()
    assert slam.prune(steps=10) == ("ghost",)
    assert slam.prune(steps=0, n_observations=10) == ()
    assert slam.ids == ("tree",)


def test_update_tells_the_names_it_gave_and_leaves_out_what_is_ignored():
    slam = some_slam(3)
    z = np.vstack([look(slam, [1, 2]), [[4.0, 1.0], [5.0, 2.0], [6.0, -2.0]]])
    slam.associate = lambda slam, z: np.array([1, -2, -1, 2, -1])
    slam.predict(U, DT, V)
    assert slam.update(z).ids == (1, None, 3, 2, 4)
    assert slam.ids == (0, 1, 2, 3, 4)
    # A name once given is never given again.
    slam.remove([4])
    slam.associate = lambda slam, z: [-1]
    assert slam.update(z[:1]).ids == (5,)


def test_a_measurement_without_a_name_is_left_out():
    ours, without = some_slam(3), some_slam(3)
    z = look(ours, [1, 2])
    assert ours.update(z, [1, None]).ids == (1, None)
    without.update(z[:1], [1])
    assert_same_state(ours, state(without))


def test_it_associates_by_itself_if_nothing_is_said():
    landmarks = np.array([[4.0, 1.0], [3.0, -2.0], [6.0, 0.5]])
    slam, pose = EKFSlam(MOTION, SENSOR, [0, 0, 0]), np.zeros(3)
    slam.update(SENSOR.observe(pose, landmarks), range(3))
    pose = MOTION.step(pose, U, DT)
    slam.predict(U, DT, V)
    assert slam.update(SENSOR.observe(pose, landmarks[[2, 0]])).ids == (2, 0)
    slam.predict(0 * U, DT, V)
    assert slam.update(SENSOR.observe(pose, [[-5.0, 0.0]])).ids == (3,)
    assert slam.n_landmarks == 4


FAILURES = {
    "twice": ((look(some_slam(), [1, 1]), [1, 1]), "ids: .* 1 twice"),
    "new twice": (([[1, 1], [2, 2]], ["a", "a"]), "ids: .* 'a' twice"),
    "too few": (([[1, 1], [2, 2]], [1]), "ids: expected one for each of 2"),
    "nan": (([[1, np.nan]], [1]), "z: expected finite"),
    "shape": (([1, 1], [1]), "z: expected shape"),
    "names": (([[1, 1]], [0, 1]), "ids: expected one for each of 1"),
    "one name": (([[1, 1]], 5), "ids: expected a sequence"),
    "unhashable": (([[1, 1]], [[1]]), "ids: expected a sequence"),
    "overflow": (([[1.7e308, 1]], [1]), "overflows"),
    "new overflow": (([[1.7e308, 1]], [9]), "can be placed"),
    "known, then new overflow": (
        (np.vstack([look(some_slam(), [1]), [[1.7e308, 1]]]), [1, 9]),
        "can be placed",
    ),
    "covs": (([[1, 1]], [1], [[1, 2], [2, 1]]), "covs: expected a positive semi-definite"),
    "covs shape": (([[1, 1]], [1], np.zeros((2, 2, 2)) + np.eye(2)), "covs: expected shape"),
}


@pytest.mark.parametrize("case", FAILURES)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_update_that_fails_leaves_the_filter_as_it_was(case):
    arguments, message = FAILURES[case]
    slam = some_slam()
    before = state(slam)
    with pytest.raises(ValueError, match=message):
        slam.update(*arguments)
    assert_same_state(slam, before)


def test_singular_innovation_is_named():
    slam = EKFSlam(MOTION, SENSOR, [0, 0, 0, 2, 0], ids=["a"])
    before = state(slam)
    with pytest.raises(ValueError, match="innovation covariance"):
        slam.update([[2.0, 0.0]], ["a"], np.zeros((2, 2)))
    assert_same_state(slam, before)


@pytest.mark.parametrize(
    "associate",
    [
        lambda slam, z: [0],
        lambda slam, z: [0, 9],
        lambda slam, z: [0, -3],
        lambda slam, z: [0.0, 1.0],
        lambda slam, z: [0, 0],
        lambda slam, z: 1 / 0,
    ],
)
def test_association_that_fails_leaves_the_filter_as_it_was(associate):
    slam = some_slam()
    before, slam.associate = state(slam), associate
    with pytest.raises((ValueError, ZeroDivisionError)):
        slam.update([[3.0, 1.0], [4.0, 2.0]])
    assert_same_state(slam, before)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mean": [0, 0]}, "mean: expected shape"),
        ({"mean": [0, 0, 0, 1]}, "mean: expected shape"),
        ({"cov": np.eye(2)}, "cov: expected shape"),
        ({"cov": np.zeros((3, 3, 3))}, r"cov: expected shape \(3, 3\), got \(3, 3, 3\)"),
        ({"cov": -np.eye(3)}, "cov: expected a positive semi-definite"),
        ({"mean": [0, 0, 0, 1, 1, 2, 2], "ids": ["a", "a"]}, "ids: .* 'a' twice"),
    ],
)
def test_bad_start_is_named(change, message):
    arguments = {"mean": [0, 0, 0], **change}
    with pytest.raises(ValueError, match=message):
        EKFSlam(MOTION, SENSOR, **arguments)


def test_bad_motion_and_unknown_names_are_named():
    slam = some_slam()
    before = state(slam)
    for arguments, message in [
        ((U, DT, np.eye(3)), "control_cov: expected shape"),
        ((U, DT, -np.eye(2)), "control_cov: expected a positive"),
        ((U, -1.0, V), "dt"),
        ((U[None], DT, V), "u: expected shape"),
        ((U, 1e10, 1e300 * np.eye(2)), "control_cov: expected a finite motion noise"),
    ]:
        with (
            pytest.raises(ValueError, match=message),
            np.errstate(over="ignore", invalid="ignore"),
        ):
            slam.predict(*arguments)
    for call in (slam.landmark_cov, lambda name: slam.remove([0, name])):
        with pytest.raises(ValueError, match="ids: expected landmarks of the map, got \\[77\\]"):
            call(77)
    with pytest.raises(ValueError, match="ids: .* 0 twice"):
        slam.remove([0, 0])
    with pytest.raises(ValueError, match="n_observations: expected at least 1"):
        slam.prune(3, 0)
    assert_same_state(slam, before)


def test_empty_look_changes_nothing():
    slam = some_slam()
    before = state(slam)
    innovation = slam.update(np.empty((0, 2)), [])
    assert innovation.innovation.shape == (0,)
    assert innovation.gain.shape == (15, 0)
    assert innovation.nis == 0.0
    assert_same_state(slam, before)


def test_copies_live_apart():
    slam = some_slam()
    twin = copy.deepcopy(slam)
    before = state(slam)
    twin.predict(U, DT, V)
    twin.update(look(twin, [0]), [0])
    twin.remove([5])
    assert_same_state(slam, before)


def test_walls_are_landmarks_too():
    rng = np.random.default_rng(5)
    sensor = Wall(0.02, 0.01, offset=0.3)
    walls = np.array([[5.0, 0.0], [4.0, np.pi / 2], [5.0, np.pi], [4.0, -np.pi / 2]])
    slam, pose = EKFSlam(MOTION, sensor, [0, 0, 0]), np.zeros(3)
    V_small = np.diag([0.01, 0.01])
    for _ in range(300):
        pose = MOTION.sample(pose, U, DT, V_small, rng)
        z, ids = sensor.measure(pose, walls, rng)
        slam.predict(U, DT, V_small)
        slam.update(z, ids)
    order = np.argsort(slam.ids)
    np.testing.assert_allclose(slam.landmarks[order, 0], walls[:, 0], atol=0.05)
    assert np.linalg.norm(slam.pose[:2] - pose[:2]) < 0.05


@settings(derandomize=True, deadline=None, max_examples=25)
@given(seed=st.integers(0, 10_000))
def test_random_life_keeps_rows_names_and_symmetry(seed):
    rng = np.random.default_rng(seed)
    slam = EKFSlam(MOTION, SENSOR, [0, 0, 0])
    landmarks = rng.uniform(-8, 8, (12, 2)) + [20, 0]
    for _ in range(30):
        slam.predict(U, DT, V)
        seen = rng.permutation(12)[: rng.integers(0, 5)]
        slam.update(SENSOR.observe(slam.pose, landmarks[seen]), seen)
        if slam.n_landmarks > 4 and rng.random() < 0.2:
            slam.remove([slam.ids[int(rng.integers(slam.n_landmarks))]])
        assert len(slam.mean) == 3 + 2 * slam.n_landmarks == len(slam.cov)
        assert len(slam.n_observations) == len(slam.steps_since_observed) == len(set(slam.ids))
        np.testing.assert_array_equal(slam.cov, slam.cov.T)
    assert np.linalg.eigvalsh(slam.cov)[0] > -1e-12


@pytest.mark.slow
def test_ten_thousand_steps_with_200_landmarks_stay_symmetric_and_psd():
    rng = np.random.default_rng(3)
    sensor = RangeBearing(0.05, 0.02, offset=0.3)
    angles = rng.uniform(-np.pi, np.pi, 200)
    landmarks = rng.uniform(6, 14, (200, 1)) * np.stack([np.cos(angles), np.sin(angles)], 1)
    # Round and round a circle of 10 m, 62.8 s a turn.
    u, pose = np.array([1.0, 0.1]), np.array([0.0, -10.0, 0.0])
    slam = EKFSlam(MOTION, sensor, pose)
    V_small = np.diag([0.05**2, 0.02**2])
    for _ in range(20):
        path = np.array([pose := MOTION.sample(pose, u, DT, V_small, rng) for _ in range(500)])
        observations = sensor.observe(path[:, None], landmarks)
        observations += rng.standard_normal(observations.shape) * [0.05, 0.02]
        for z in observations:
            nearest = np.argsort(z[:, 0])[:10]
            slam.predict(u, DT, V_small)
            slam.update(z[nearest], nearest)
        np.testing.assert_array_equal(slam.cov, slam.cov.T)
        values = np.linalg.eigvalsh(slam.cov)
        assert values[0] >= -1e-9 * values[-1]
    assert slam.n_landmarks > 170
    assert np.linalg.norm(slam.pose[:2] - pose[:2]) < 1.0


@pytest.mark.parametrize("linearisation", ["standard", "first-estimates", "invariant"])
def test_the_heading_stays_wrapped_at_the_start_and_through_a_correction(linearisation):
    # Just short of half a turn; the landmark says that the robot has turned further, beyond it.
    start = [0.0, 0.0, np.pi - 0.01 + 2 * np.pi]
    slam = EKFSlam(
        Unicycle(), RangeBearing(0.1, 0.01), start, 0.1 * np.eye(3), linearisation=linearisation
    )
    assert slam.pose[2] == pytest.approx(np.pi - 0.01)
    slam.update([[2.0, 0.0]], ids=[0])
    sighted = EKFSlam(
        Unicycle(),
        RangeBearing(0.1, 0.01),
        [*slam.mean[:3], *slam.landmarks[0]],
        np.diag([1e-6, 1e-6, 0.1, 1e-6, 1e-6]),
        [0],
        linearisation=linearisation,
    )
    sighted.update([[2.0, -0.2]], ids=[0])
    assert sighted.pose[2] == pytest.approx(-np.pi + 0.19, abs=0.01)


def test_nan_is_no_name():
    slam = EKFSlam(Unicycle(), RangeBearing(0.1, 0.01), [0, 0, 0])
    for ids in ([np.nan], np.array([np.nan]), [float("nan")]):
        with pytest.raises(ValueError, match="ids: expected names, got NaN"):
            slam.update([[2.0, 0.0]], ids=ids)
    assert slam.n_landmarks == 0


@pytest.mark.parametrize("N", [5, 255, 1499, 1500, 1603])
def test_a_covariance_of_any_size_loses_b_transposed_b_and_stays_symmetric_to_the_last_bit(N):
    B = np.random.default_rng(3).standard_normal((4, N))
    P = np.eye(N) + np.full((N, N), 2.0)
    before = P.copy()
    downdate(P, B)
    np.testing.assert_allclose(P, before - B.T @ B, atol=1e-13)
    np.testing.assert_array_equal(P, P.T)
