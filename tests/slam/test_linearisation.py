"""A robot without a compass must not come to know its heading: three linearisations compared."""

import numpy as np
import pytest

from slamlab.evaluation import chi2_band, invariant_nees, nees, run
from slamlab.robots import YOUBOT, Unicycle
from slamlab.sensors import RangeBearing, Wall
from slamlab.simulation import ROOM_SENSOR, room_drives
from slamlab.slam import EKFSlam, EKFSlamBatch, ekf, linearisation
from slamlab.slam.linear import CompassMotion, Displacement

ALL = linearisation.LINEARISATIONS
REPAIRED = ("first-estimates", "invariant")
START, DOUBT = np.array([0.0, -2.4, 0.0]), np.diag([0.0, 0.0, np.radians(10.0) ** 2])


@pytest.fixture(scope="module")
def drives():
    """Fifty drives whose starts are drawn from the prior that the filter is told."""
    return room_drives(50, np.random.default_rng(1), n_steps=200, start_cov=DOUBT)


@pytest.fixture(scope="module")
def runs(drives):
    start = np.tile(START, (50, 1))
    return {
        name: run(
            EKFSlamBatch(YOUBOT, ROOM_SENSOR, start, DOUBT, n_landmarks=24, linearisation=name),
            drives,
            every=20,
        )
        for name in ALL
    }


def stood(linearisation, sensor=ROOM_SENSOR, landmarks=((3, 1), (4, -2), (2.5, 3)), steps=300):
    """Heading doubt (degrees) that a robot claims that stands still and looks at three things."""
    rng, landmarks = np.random.default_rng(2), np.array(landmarks, dtype=float)
    slam = EKFSlam(YOUBOT, sensor, START, DOUBT, linearisation=linearisation)
    truth = np.array([0.0, -2.4, 0.15])
    for _ in range(steps):
        slam.predict(np.zeros(3), 0.1, np.zeros((3, 3)))
        z = sensor.observe(truth, landmarks)
        slam.update(z + rng.standard_normal(z.shape) * np.sqrt(np.diag(sensor.cov)), range(3))
    return np.degrees(np.sqrt(slam.pose_cov[2, 2]))


def test_a_standing_robot_keeps_the_doubt_of_its_heading():
    assert stood("standard") < 5.0, "what nothing measured, the usual filter claims to know"
    for name in REPAIRED:
        assert stood(name) == pytest.approx(10.0, abs=1e-6)


def test_a_robot_among_walls_keeps_it_with_first_estimates():
    walls, sensor = [[5, 0.2], [4, 1.6], [5, 3.0]], Wall(0.05, np.radians(1.0), offset=0.3)
    assert stood("standard", sensor, walls) < 9.0
    assert stood("first-estimates", sensor, walls) == pytest.approx(10.0, abs=1e-6)


def test_a_driving_robot_keeps_it_too_and_the_usual_one_does_not(runs):
    claimed = {
        name: np.degrees(np.sqrt(one.covs[-1, :, 2, 2].mean())) for name, one in runs.items()
    }
    assert claimed["standard"] < 2.0
    for name in REPAIRED:
        assert claimed[name] == pytest.approx(10.0, abs=0.1)


def test_nees_of_the_repaired_filters_lies_in_its_band_over_fifty_runs(runs):
    low, high = chi2_band(3, 50, 0.999)
    # Beside a landmark whose first estimate was poor, one run in fifty errs for two steps.
    for name, outside in (("invariant", 0), ("first-estimates", 1)):
        scores = invariant_nees(runs[name])[1:].mean(1)
        assert ((scores < low) | (high < scores)).sum() <= outside, (name, scores)
    assert invariant_nees(runs["standard"])[-1].mean() > 10 * high
    # In x and y the belief is a banana, which no ellipse can hold, however it was linearised.
    assert nees(runs["invariant"])[-1].mean() > 2 * high


def test_invariant_coordinates_are_those_of_the_world_and_need_no_small_error():
    """A world turned by any angle about its origin: the error is the angle, nothing else."""
    poses = np.array([[3.0, -1.0, 0.4]])
    turn = 2.5
    c, s = np.cos(turn), np.sin(turn)
    truth = np.array([[3 * c + s, 3 * s - c, 0.4 + turn]])
    J = np.array([1.0, 3.0, 1.0])  # the same turn of a pose at the estimate, to first order
    cov = turn**2 * np.outer(J, J) + 1e-9 * np.eye(3)
    assert invariant_nees((poses, truth), cov[None])[0] == pytest.approx(1.0, abs=1e-3)
    assert nees((poses, truth), cov[None], angles=(2,))[0] > 1e6


@pytest.mark.parametrize("name", ALL)
def test_each_run_of_a_batch_is_ekf_slam_number_for_number(name):
    drives = room_drives(3, np.random.default_rng(7), n_steps=80, start_cov=DOUBT)
    start = np.tile(START, (3, 1))
    options = dict(linearisation=name)
    batch = EKFSlamBatch(YOUBOT, ROOM_SENSOR, start, DOUBT, n_landmarks=24, **options)
    together = run(batch, drives)
    for k in range(3):
        slam = EKFSlam(YOUBOT, ROOM_SENSOR, START, DOUBT, **options)
        alone = run(slam, drives.single(k))
        np.testing.assert_allclose(together.poses[:, k], alone.poses, atol=1e-9)
        np.testing.assert_allclose(together.covs[:, k], alone.covs, atol=1e-9)
        np.testing.assert_allclose(batch.landmarks[k, list(slam.ids)], slam.landmarks, atol=1e-9)


def test_in_the_linear_world_all_three_are_the_kalman_filter():
    rng, filters = np.random.default_rng(3), {}
    for name in ALL:
        start_cov = np.diag([0.04, 0.04, 0])
        filters[name] = EKFSlam(
            CompassMotion(), Displacement(0.3), [1, 2, 0.5], start_cov, linearisation=name
        )
    for k in range(30):
        u, z = rng.standard_normal(2), rng.standard_normal((3, 2))
        for slam in filters.values():
            slam.predict(u, 0.5, 0.1 * np.eye(2))
            slam.update(z, [k % 4, 7, 8])
    for name in REPAIRED:
        np.testing.assert_allclose(filters[name].mean, filters["standard"].mean, atol=1e-10)
        np.testing.assert_allclose(filters[name].cov, filters["standard"].cov, atol=1e-12)


def differences(scale):
    """How far the three are from each other after a drive whose noise is scaled."""
    rng, V = np.random.default_rng(4), scale**2 * np.diag([0.04, 0.01])
    landmarks = rng.uniform(-5, 5, (5, 2))
    sensor = RangeBearing(0.1 * scale, 0.02 * scale, offset=0.3)
    filters = [
        EKFSlam(Unicycle(), sensor, [0, 0, 0], scale**2 * 0.01 * np.eye(3), linearisation=name)
        for name in ALL
    ]
    pose = np.zeros(3)
    for _ in range(20):
        pose = Unicycle().sample(pose, [1.0, 0.3], 0.1, V, rng)
        z = sensor.observe(pose, landmarks) + rng.standard_normal((5, 2)) * [0.1, 0.02] * scale
        for slam in filters:
            slam.predict([1.0, 0.3], 0.1, V)
            slam.update(z, range(5))
    usual = filters[0]
    return [np.abs(one.mean - usual.mean).max() for one in filters[1:]]


def test_with_less_and_less_noise_the_three_come_together():
    for large, small in zip(differences(0.3), differences(0.03), strict=True):
        assert 0 < small < large / 30


def test_half_a_repair_is_none(drives, monkeypatch):
    def driven():
        options = dict(linearisation="first-estimates")
        slam = EKFSlam(YOUBOT, ROOM_SENSOR, START, DOUBT, **options)
        return np.degrees(np.sqrt(run(slam, drives.single(0)).covs[-1, 2, 2]))

    assert driven() == pytest.approx(10.0, abs=0.1)
    monkeypatch.setattr(ekf, "fej_jacobian", lambda jacobian, *_: jacobian)
    assert driven() < 9.0, "Jacobians of the map fixed, those of the pose not"
    whole = ekf.retract

    def without_reset(mean, change, linearisation):
        return whole(mean, change, linearisation)[0], None

    monkeypatch.setattr(ekf, "retract", without_reset)
    assert stood("invariant") < 9.0, "the covariance left where the estimate was"


def test_bad_linearisations_are_named():
    with pytest.raises(ValueError, match="linearisation: expected one of 'standard', 'first"):
        EKFSlam(YOUBOT, ROOM_SENSOR, START, linearisation="iterated")
    with pytest.raises(
        ValueError, match="linearisation: expected 'standard' or 'first-estimates'"
    ):
        EKFSlam(YOUBOT, Wall(0.1, 0.1), START, linearisation="invariant")
