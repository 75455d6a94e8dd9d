"""Drives among landmarks: what the logs hold, and what is refused."""

import numpy as np
import pytest

from slamlab.evaluation import run
from slamlab.geometry import wrap_angle
from slamlab.localization import DeadReckoning
from slamlab.robots import Unicycle
from slamlab.sensors import PointSensor, RangeBearing
from slamlab.simulation import landmark_drives, orchard_loop, room_drives


def test_a_batch_of_drives_starts_where_it_is_told_and_sees_nothing_before_it_moves():
    log = room_drives(4, np.random.default_rng(1), n_steps=20)
    assert (len(log), log.n_runs, log.landmarks.shape) == (21, 4, (24, 2))
    assert np.isnan(log.landmark_measurements[0]).all()
    np.testing.assert_array_equal(log.truth[0], np.tile([0.0, -2.4, 0.0], (4, 1)))
    assert len({tuple(pose) for pose in log.truth[-1].tolist()}) == 4
    again = room_drives(4, np.random.default_rng(1), n_steps=20)
    np.testing.assert_array_equal(again.truth, log.truth)


def test_starts_are_drawn_from_the_prior():
    cov = np.diag([0.01, 0.04, 0.09])
    log = room_drives(4000, np.random.default_rng(2), n_steps=1, start_cov=cov)
    np.testing.assert_allclose(np.cov(log.truth[0].T), cov, atol=0.01)


def test_the_orchard_is_not_seen_on_the_way_and_the_drift_is_as_its_odometry_says():
    log = orchard_loop(np.random.default_rng(3), clutter_rate=1.0)
    seen = np.array([len(z) for z in log.landmark_measurements])
    assert (seen[11:98] == 0).all()
    assert (seen[1:11] > 0).all()
    wheels = run(DeadReckoning(Unicycle(), log.truth[0]), log)
    assert 0.3 < np.sqrt(np.trace(wheels.covs[97, :2, :2])) < 1.2
    error = wheels.poses[97] - log.truth[97]
    error[2] = wrap_angle(error[2])
    assert error @ np.linalg.solve(wheels.covs[97], error) < 16
    still = orchard_loop(np.random.default_rng(3), drift=0.0, clutter_rate=0.0)
    np.testing.assert_allclose(still.truth[100], still.truth[0], atol=1e-12)


@pytest.mark.parametrize("sensor", [RangeBearing(0.01, 0.01), PointSensor(1e-4 * np.eye(2))])
def test_only_an_angle_is_wrapped(sensor):
    trees, rng = np.array([[-9.0, 0.01], [1.0, 9.0]]), np.random.default_rng(4)
    drive = np.zeros((200, 2)), 0.1, np.zeros((2, 2))
    log = landmark_drives(Unicycle(), sensor, trees, *drive, 1, rng)
    z = np.stack(log.landmark_measurements[1:])[:, 0]
    error = sensor.residual(z, sensor.observe(log.truth[1:], trees))
    assert error.std() == pytest.approx(0.01, rel=0.2)
    assert np.abs(sensor.locate(log.truth[1:], z) - trees).max() < 0.5
    assert (np.abs(z[..., 1]) <= np.pi).all() == isinstance(sensor, RangeBearing)


ARGUMENTS = dict(
    motion=Unicycle(),
    sensor=RangeBearing(0.1, 0.1),
    landmarks=[[1, 1]],
    u=[[1, 0]],
    dt=0.1,
    control_cov=np.eye(2),
    n_runs=2,
    rng=np.random.default_rng(1),
)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"n_runs": 0}, "n_runs: expected at least 1"),
        ({"landmarks": [1, 1]}, "landmarks: expected shape"),
        ({"control_cov": -np.eye(2)}, "control_cov: expected a positive"),
        ({"rng": 1}, "rng: expected a numpy"),
        ({"dt": -1}, "dt: expected"),
        ({"start": [0, 0]}, "start: expected shape"),
        ({"start_cov": np.eye(2)}, "start_cov: expected shape"),
    ],
)
def test_bad_drives_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        landmark_drives(**(ARGUMENTS | change))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: room_drives(1, r, n_steps=0), "n_steps: expected at least 1"),
        (lambda r: orchard_loop(3), "rng"),
        (lambda r: orchard_loop(r, drift=-1), "drift"),
        (lambda r: orchard_loop(r, n_landmarks=0), "n_landmarks"),
        (lambda r: orchard_loop(r, laps=-1), "laps"),
        (lambda r: orchard_loop(r, p_detect=2), "p_detect"),
    ],
)
def test_bad_worlds_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(np.random.default_rng(1))
