"""Trajectory errors against evo and against closed forms."""

import numpy as np
import pytest
from evo.core import metrics, units
from evo.core.trajectory import PosePath3D

from slamlab.evaluation import align, ate, rpe
from slamlab.evaluation.trajectory import TrajectoryError
from slamlab.geometry import compose


def matrices(poses):
    T = np.tile(np.eye(4), (len(poses), 1, 1))
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = c, -s, s, c
    T[:, :2, 3] = poses[:, :2]
    return PosePath3D(poses_se3=list(T))


@pytest.fixture
def paths():
    rng = np.random.default_rng(4)
    steps = np.column_stack([np.full(80, 0.5), np.zeros(80), rng.normal(0, 0.2, 80)])
    truth = [np.zeros(3)]
    for step in steps:
        truth.append(compose(truth[-1], step))
    truth = np.array(truth)
    noisy = truth + rng.normal(0, [0.1, 0.1, 0.02], truth.shape)
    return compose([3.0, -2.0, 0.8], noisy), truth


def test_ate_equals_evo(paths):
    estimate, truth = paths
    mine, theirs = matrices(estimate), matrices(truth)
    mine.align(theirs)
    metric = metrics.APE(metrics.PoseRelation.translation_part)
    metric.process_data((theirs, mine))
    due = metric.get_all_statistics()
    found = ate(estimate, truth)
    for name in ("rmse", "mean", "median", "max"):
        assert getattr(found, name) == pytest.approx(due[name], rel=1e-9)


@pytest.mark.parametrize(
    ("relation", "entries"),
    [
        (metrics.PoseRelation.translation_part, "translation"),
        (metrics.PoseRelation.rotation_angle_rad, "rotation"),
    ],
)
def test_rpe_equals_evo(paths, relation, entries):
    estimate, truth = paths
    metric = metrics.RPE(relation, delta=5, delta_unit=units.Unit.frames, all_pairs=True)
    metric.process_data((matrices(truth), matrices(estimate)))
    found = rpe(estimate, truth, delta=5)
    np.testing.assert_allclose(getattr(found, entries), metric.error, atol=1e-9)


def test_a_rigid_motion_of_the_world_changes_no_error(paths):
    estimate, truth = paths
    moved = compose([-7.0, 1.0, 2.5], estimate)
    assert ate(moved, truth).rmse == pytest.approx(ate(estimate, truth).rmse, rel=1e-9)
    assert rpe(moved, truth).rmse == pytest.approx(rpe(estimate, truth).rmse, rel=1e-9)
    # Without alignment it does, and this is what the option is for.
    assert ate(moved, truth, aligned=False).rmse > 2 * ate(estimate, truth).rmse


def test_alignment_is_the_best_of_all_rigid_motions(paths):
    estimate, truth = paths
    best = ate(align(estimate, truth), truth, aligned=False).rmse
    rng = np.random.default_rng(1)
    for nudge in rng.normal(0, 0.01, (50, 3)):
        other = compose(nudge, align(estimate, truth))
        assert ate(other, truth, aligned=False).rmse > best


def test_rpe_over_metres_counts_driven_metres():
    truth = np.column_stack([np.arange(11.0), np.zeros(11), np.zeros(11)])
    estimate = truth * [1.1, 1, 1]
    found = rpe(estimate, truth, delta=2.0, unit="metres")
    assert len(found.translation) == 9
    assert found.rmse == pytest.approx(0.2)
    # Comparing positions in the world, as a wrong form does, would let the error grow.
    assert np.ptp(found.translation) < 1e-9


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ate(np.zeros((3, 3)), np.zeros((4, 3))), "truth: expected shape"),
        (lambda: ate(np.zeros((0, 3)), np.zeros((0, 3))), "estimate: expected at least one pose"),
        (lambda: rpe(np.zeros((3, 3)), np.zeros((3, 3)), delta=3), "delta: expected less"),
        (lambda: rpe(np.zeros((3, 3)), np.zeros((3, 3)), 1, "feet"), "unit: expected one of"),
        (lambda: ate(np.full((3, 3), np.nan), np.zeros((3, 3))), "estimate: expected finite"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_the_error_of_a_long_path_is_shown_in_one_line():
    path = np.zeros((126, 3))
    assert repr(ate(path, path + [3, 4, 0], aligned=False)) == (
        "TrajectoryError(126 poses: rmse 5 m, largest 5 m)"
    )
    assert repr(TrajectoryError(np.empty(0), np.empty(0))) == "TrajectoryError(no poses)"
