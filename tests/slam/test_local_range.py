"""A range that adapts: as many landmarks as wanted, and what is dropped teaches nothing."""

import numpy as np
import pytest

from slamlab.evaluation import run
from slamlab.localization import DeadReckoning
from slamlab.robots import Unicycle
from slamlab.sensors import PointSensor
from slamlab.simulation import FIELD_SENSOR, field_flights
from slamlab.slam import CompressedEKFSlam, EKFSlam, EKFSlamBatch, LocalRange
from slamlab.worlds import rooms

FAR = PointSensor(FIELD_SENSOR.cov, max_range=40.0)


def flight(**options):
    return field_flights(1, np.random.default_rng(1), FAR, **options).single(0)


def ekf(log):
    return EKFSlam(Unicycle(), FAR, log.truth[0])


def test_it_sees_what_is_wanted_where_trees_are_dense_and_where_they_are_not():
    log = flight(felled=0.75)
    slam = LocalRange(ekf(log), wanted=8, nearest=5.0, furthest=40.0)
    result = run(slam, log, keep=("n_seen", "reach"))
    seen, reach = (np.array(result.kept[name][1:]) for name in ("n_seen", "reach"))
    left = result.truth[1:, 0] < 35.0
    right = result.truth[1:, 0] > 55.0
    assert 6 < seen[left].mean() < 10
    assert 6 < seen[right].mean() < 10
    assert np.median(reach[right]) > 1.4 * np.median(reach[left])
    fixed = [[np.hypot(*z.T) <= 16.0 for z in log.looks]]
    in_reach = np.array([row.sum() for row in fixed[0]])[1:]
    # the wrong form: one range for both halves
    assert in_reach[left].mean() > 2 * in_reach[right].mean()


def test_the_law_by_hand():
    """Sixteen within 20 m and four wanted: half the range; none seen: twice as far and more."""
    slam = LocalRange(EKFSlam(Unicycle(), FAR, [0, 0, 0]), wanted=4.0, nearest=2.0, furthest=20.0)
    angles = np.linspace(0, 6, 16)
    slam.update(15 * np.column_stack([np.cos(angles), np.sin(angles)]), range(16))
    assert slam.reach == pytest.approx(10.0)
    assert slam.n_seen == 16
    slam.update([[15.0, 0.0]], [0])
    assert (slam.n_seen, slam.reach) == (0, 20.0)


def test_what_lies_beyond_the_range_is_not_used():
    log = flight()
    slam, inner = LocalRange(ekf(log), nearest=15.0, furthest=15.0), ekf(log)
    looks = [z[np.hypot(*z.T) <= 15.0] for z in log.looks]
    names = [ids[np.hypot(*z.T) <= 15.0] for z, ids in zip(log.looks, log.ids, strict=True)]
    for step, z, ids in zip(log, looks, names, strict=True):
        for one in (slam, inner):
            if step.dt:
                one.predict(step.u, step.dt, step.control_cov)
        slam.update(step.z, step.ids)
        inner.update(z, ids)
    np.testing.assert_array_equal(slam.system.mean, inner.mean)
    assert slam.system.ids == inner.ids


def test_a_region_follows_the_range_and_changes_no_number():
    log = flight(felled=0.5)
    bounds = dict(wanted=8, nearest=8.0, furthest=40.0)
    full = run(LocalRange(ekf(log), **bounds), log)
    inner = CompressedEKFSlam(Unicycle(), FAR, log.truth[0])
    local = run(LocalRange(inner, region=2.0, **bounds), log, keep=("reach",))
    np.testing.assert_allclose(local.poses, full.poses, atol=1e-8)
    np.testing.assert_allclose(local.covs, full.covs, atol=1e-8)
    assert inner.radius == 2.0 * local.kept["reach"][-1]
    assert inner.regions > 5


def test_unknown_landmarks_are_left_to_the_system():
    log = flight(side=60.0)
    slam = LocalRange(ekf(log), nearest=5.0, furthest=40.0)
    result = run(slam, log, known_ids=False)
    assert np.hypot(*(result.poses[-1] - log.truth[-1])[:2]) < 2.0


def test_a_refused_look_changes_nothing():
    slam = LocalRange(EKFSlam(Unicycle(), FAR, [0, 0, 0]), nearest=5.0, furthest=40.0)
    slam.update([[3.0, 1.0]], ["a"])
    reach, mean = slam.reach, slam.system.mean
    for z, ids in (([[np.nan, 1.0]], ["a"]), ([[1.0, 1.0]], ["a", "b"]), ([1.0], ["a"])):
        with pytest.raises(ValueError, match="z|ids"):
            slam.update(z, ids)
    assert slam.reach == reach
    np.testing.assert_array_equal(slam.system.mean, mean)


def test_what_cannot_be_is_refused():
    inner = EKFSlam(Unicycle(), FAR, [0, 0, 0])
    with pytest.raises(ValueError, match="region: expected a system with a radius"):
        LocalRange(inner, nearest=1.0, furthest=2.0, region=2.0)
    with pytest.raises(ValueError, match="furthest"):
        LocalRange(inner, nearest=3.0, furthest=2.0)
    with pytest.raises(ValueError, match="wanted"):
        LocalRange(inner, wanted=0.0, nearest=1.0, furthest=2.0)
    with pytest.raises(ValueError, match="system: expected an estimator"):
        LocalRange(rooms.office(), nearest=1.0, furthest=2.0)
    with pytest.raises(ValueError, match="system: expected one with a sensor"):
        LocalRange(DeadReckoning(Unicycle(), [0, 0, 0]), nearest=1.0, furthest=2.0)


def test_runs_side_by_side_have_a_range_each_and_equal_single_ones():
    logs = field_flights(2, np.random.default_rng(1), FAR, felled=0.75)
    law = dict(wanted=5, nearest=8.0, furthest=40.0)
    filters = EKFSlamBatch(Unicycle(), FAR, logs.truth[0], n_landmarks=len(logs.landmarks))
    both = run(LocalRange(filters, **law), logs, keep=("reach", "n_seen"))
    for i in range(2):
        log = logs.single(i)
        one = run(LocalRange(ekf(log), **law), log, keep=("reach", "n_seen"))
        np.testing.assert_allclose(both.poses[:, i], one.poses, atol=1e-9)
        np.testing.assert_array_equal([n[i] for n in both.kept["n_seen"]], one.kept["n_seen"])
        np.testing.assert_allclose([r[i] for r in both.kept["reach"]], one.kept["reach"])
    assert (np.diff(both.kept["reach"], axis=1) != 0).any()
