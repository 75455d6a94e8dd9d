"""A range that adapts: as many landmarks as wanted, and what is dropped teaches nothing."""

import numpy as np
import pytest

from slamlab.evaluation import run
from slamlab.localization import DeadReckoning
from slamlab.robots import Unicycle
from slamlab.sensors import PointSensor
from slamlab.simulation import FIELD_SENSOR, field_flights
from slamlab.slam import AdaptiveRange, CompressedEKFSlam, EKFSlam, EKFSlamBatch
from slamlab.worlds import rooms

FAR = PointSensor(FIELD_SENSOR.cov, max_range=40.0)


def flight(**options):
    return field_flights(1, np.random.default_rng(1), FAR, **options).single(0)


def ekf(log):
    return EKFSlam(Unicycle(), FAR, log.truth[0])


def test_it_sees_what_is_wanted_where_trees_are_dense_and_where_they_are_not():
    log = flight(felled=0.75)
    slam = AdaptiveRange(ekf(log), n_target=8, min_range=5.0, max_range=40.0)
    result = run(slam, log, record=("n_seen", "range"))
    seen, reach = (np.array(result.recorded[name][1:]) for name in ("n_seen", "range"))
    left = result.truth[1:, 0] < 35.0
    right = result.truth[1:, 0] > 55.0
    assert 6 < seen[left].mean() < 10
    assert 6 < seen[right].mean() < 10
    assert np.median(reach[right]) > 1.4 * np.median(reach[left])
    fixed = [[np.hypot(*z.T) <= 16.0 for z in log.landmark_measurements]]
    in_reach = np.array([row.sum() for row in fixed[0]])[1:]
    # the wrong form: one range for both halves
    assert in_reach[left].mean() > 2 * in_reach[right].mean()


def test_the_law_by_hand():
    """Sixteen within 20 m and four wanted: half the range; none seen: twice as far and more."""
    slam = AdaptiveRange(
        EKFSlam(Unicycle(), FAR, [0, 0, 0]), n_target=4.0, min_range=2.0, max_range=20.0
    )
    angles = np.linspace(0, 6, 16)
    slam.update(15 * np.column_stack([np.cos(angles), np.sin(angles)]), range(16))
    assert slam.range == pytest.approx(10.0)
    assert slam.n_seen == 16
    slam.update([[15.0, 0.0]], [0])
    assert (slam.n_seen, slam.range) == (0, 20.0)


def test_what_lies_beyond_the_range_is_not_used():
    log = flight()
    slam, inner = AdaptiveRange(ekf(log), min_range=15.0, max_range=15.0), ekf(log)
    observations = [z[np.hypot(*z.T) <= 15.0] for z in log.landmark_measurements]
    names = [
        ids[np.hypot(*z.T) <= 15.0]
        for z, ids in zip(log.landmark_measurements, log.ids, strict=True)
    ]
    for step, z, ids in zip(log, observations, names, strict=True):
        for one in (slam, inner):
            if step.dt:
                one.predict(step.u, step.dt, step.control_cov)
        slam.update(step.z, step.ids)
        inner.update(z, ids)
    np.testing.assert_array_equal(slam.system.mean, inner.mean)
    assert slam.system.ids == inner.ids


def test_a_region_follows_the_range_and_changes_no_number():
    log = flight(felled=0.5)
    bounds = dict(n_target=8, min_range=8.0, max_range=40.0)
    full = run(AdaptiveRange(ekf(log), **bounds), log)
    inner = CompressedEKFSlam(Unicycle(), FAR, log.truth[0])
    local = run(AdaptiveRange(inner, region_factor=2.0, **bounds), log, record=("range",))
    np.testing.assert_allclose(local.poses, full.poses, atol=1e-8)
    np.testing.assert_allclose(local.covs, full.covs, atol=1e-8)
    assert inner.radius == 2.0 * local.recorded["range"][-1]
    assert inner.n_regions > 5


def test_unknown_landmarks_are_left_to_the_system():
    log = flight(side=60.0)
    slam = AdaptiveRange(ekf(log), min_range=5.0, max_range=40.0)
    result = run(slam, log, known_ids=False)
    assert np.hypot(*(result.poses[-1] - log.truth[-1])[:2]) < 2.0


def test_a_refused_look_changes_nothing():
    slam = AdaptiveRange(EKFSlam(Unicycle(), FAR, [0, 0, 0]), min_range=5.0, max_range=40.0)
    slam.update([[3.0, 1.0]], ["a"])
    reach, mean = slam.range, slam.system.mean
    for z, ids in (([[np.nan, 1.0]], ["a"]), ([[1.0, 1.0]], ["a", "b"]), ([1.0], ["a"])):
        with pytest.raises(ValueError, match="z|ids"):
            slam.update(z, ids)
    assert slam.range == reach
    np.testing.assert_array_equal(slam.system.mean, mean)


def test_what_cannot_be_is_refused():
    inner = EKFSlam(Unicycle(), FAR, [0, 0, 0])
    with pytest.raises(ValueError, match="region_factor: expected a system with a radius"):
        AdaptiveRange(inner, min_range=1.0, max_range=2.0, region_factor=2.0)
    with pytest.raises(ValueError, match="max_range"):
        AdaptiveRange(inner, min_range=3.0, max_range=2.0)
    with pytest.raises(ValueError, match="n_target"):
        AdaptiveRange(inner, n_target=0.0, min_range=1.0, max_range=2.0)
    with pytest.raises(ValueError, match="system: expected an estimator"):
        AdaptiveRange(rooms.office(), min_range=1.0, max_range=2.0)
    with pytest.raises(ValueError, match="system: expected one with a sensor"):
        AdaptiveRange(DeadReckoning(Unicycle(), [0, 0, 0]), min_range=1.0, max_range=2.0)


def test_runs_side_by_side_have_a_range_each_and_equal_single_ones():
    logs = field_flights(2, np.random.default_rng(1), FAR, felled=0.75)
    law = dict(n_target=5, min_range=8.0, max_range=40.0)
    filters = EKFSlamBatch(Unicycle(), FAR, logs.truth[0], n_landmarks=len(logs.landmarks))
    both = run(AdaptiveRange(filters, **law), logs, record=("range", "n_seen"))
    for i in range(2):
        log = logs.single(i)
        one = run(AdaptiveRange(ekf(log), **law), log, record=("range", "n_seen"))
        np.testing.assert_allclose(both.poses[:, i], one.poses, atol=1e-9)
        np.testing.assert_array_equal(
            [n[i] for n in both.recorded["n_seen"]], one.recorded["n_seen"]
        )
        np.testing.assert_allclose([r[i] for r in both.recorded["range"]], one.recorded["range"])
    assert (np.diff(both.recorded["range"], axis=1) != 0).any()
