"""Flights over a field: the same path for all, other noise for each, trees where they are told."""

import numpy as np
import pytest

from slamlab.evaluation import chi2_band, nees, run
from slamlab.geometry import wrap_angle
from slamlab.localization import DeadReckoning
from slamlab.robots import Unicycle
from slamlab.sensors import PointSensor
from slamlab.simulation import FIELD_SENSOR, field_flights
from slamlab.slam import EKFSlamBatch


def test_all_fly_one_path_at_one_speed_and_it_stays_over_the_field():
    for side, lane in ((90.0, 30.0), (120.0, 30.0), (60.0, 20.0)):
        log = field_flights(2, np.random.default_rng(1), side=side, lane=lane)
        path = log.truth[:, 0]
        np.testing.assert_array_equal(path, log.truth[:, 1])
        steps = np.hypot(*np.diff(path[:, :2], axis=0).T)
        assert 1.9 < steps.min() <= steps.max() < 2.1
        assert path[:, :2].min() > -1e-9
        assert path[:, :2].max() < side + 1e-9
        # home across the lanes: it ends beside the first one
        assert path[-1, 1] < lane


def test_noise_is_what_it_says():
    log = field_flights(40, np.random.default_rng(2), sigmas=(0.4, 0.02))
    u = np.array(log.u)[1:]
    spread = (u - np.median(u, axis=1, keepdims=True)).std(axis=(0, 1))
    np.testing.assert_allclose(spread, [0.4, 0.02], rtol=0.05)
    np.testing.assert_array_equal(log.control_cov, np.diag([0.4, 0.02]) ** 2)
    z = np.array(log.landmark_measurements)
    error = z - FIELD_SENSOR.observe(log.truth[:, :, None], log.landmarks)
    np.testing.assert_allclose(np.nanstd(error, axis=(0, 1, 2)), 0.2, rtol=0.02)
    near = FIELD_SENSOR.visible(log.truth[:, :, None], log.landmarks)
    np.testing.assert_array_equal(np.isfinite(z[..., 0]), near)


def test_a_correlated_sensor_is_drawn_with_its_covariance():
    cov = np.array([[0.04, 0.03], [0.03, 0.09]])
    log = field_flights(20, np.random.default_rng(3), PointSensor(cov, max_range=20.0))
    seen = log.truth[:, :, None]
    error = (
        np.array(log.landmark_measurements) - FIELD_SENSOR.observe(seen, log.landmarks)
    ).reshape(-1, 2)
    got = np.cov(error[np.isfinite(error[:, 0])].T)
    np.testing.assert_allclose(got, cov, atol=0.004)
    assert abs(got[0, 1]) > 0.02  # and not a diagonal one


def test_without_noise_the_controls_lead_along_the_path():
    log = field_flights(1, np.random.default_rng(4), sigmas=(0.0, 0.0)).single(0)
    result = run(DeadReckoning(Unicycle(), log.truth[0]), log)
    gap = result.poses - log.truth
    assert np.abs(gap[:, :2]).max() < 1e-9
    assert np.abs(wrap_angle(gap[:, 2])).max() < 1e-9


def test_trees_do_not_depend_on_the_sensor_and_some_are_felled():
    far = PointSensor(FIELD_SENSOR.cov, max_range=40.0)
    one, other = (field_flights(1, np.random.default_rng(5), s) for s in (FIELD_SENSOR, far))
    np.testing.assert_array_equal(one.landmarks, other.landmarks)
    assert len(one.landmarks) == 81
    thin = field_flights(1, np.random.default_rng(5), felled=1.0).landmarks
    assert thin[:, 0].max() < 45.0
    assert len(thin) == (one.landmarks[:, 0] < 45.0).sum()


def test_trees_of_other_lanes_can_be_hidden_and_nothing_else_changes():
    far = PointSensor(FIELD_SENSOR.cov, max_range=40.0)
    for lane in (30.0, 20.0):
        whole, own = (
            field_flights(2, np.random.default_rng(6), far, lane=lane, own_lane=hidden)
            for hidden in (False, True)
        )
        np.testing.assert_array_equal(whole.landmarks, own.landmarks)
        np.testing.assert_array_equal(np.array(whole.u), np.array(own.u))
        z, kept = (np.array(log.landmark_measurements) for log in (whole, own))
        here, there = (np.floor(y / lane) for y in (own.truth[..., 1], own.landmarks[:, 1]))
        same = here[..., None] == there
        assert (np.isfinite(z[..., 0]) & ~same).any()
        np.testing.assert_array_equal(kept, np.where(same[..., None], z, np.nan))


def test_with_four_trees_in_sight_the_usual_filter_believes_too_much_and_the_invariant_not():
    near = PointSensor(FIELD_SENSOR.cov, max_range=12.0)
    low, high = chi2_band(3, 50)
    log, score = field_flights(50, np.random.default_rng(2), near), {}
    for kind in ("standard", "invariant"):
        system = EKFSlamBatch(
            Unicycle(), near, log.truth[0], linearisation=kind, n_landmarks=len(log.landmarks)
        )
        score[kind] = nees(run(system, log))[-1].mean()
    assert score["standard"] > 1.5 * high
    assert low < score["invariant"] < high


@pytest.mark.parametrize(
    ("name", "options"),
    [("side", {"side": 0.0}), ("lane", {"lane": 46.0}), ("n_landmarks", {"n_landmarks": 0}),
     ("felled", {"felled": 1.5}), ("sigmas", {"sigmas": (-1.0, 0.0)})],
)  # fmt: skip
def test_what_cannot_be_flown_is_refused(name, options):
    with pytest.raises(ValueError, match=name):
        field_flights(1, np.random.default_rng(1), **options)
