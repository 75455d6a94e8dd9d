"""The loop of the house: what is fed, what is recorded, what is refused."""

import numpy as np
import pytest

from slamlab.evaluation import ate, nees, nis, rpe, run
from slamlab.localization import DeadReckoning
from slamlab.logs import Log, ScanGeometry
from slamlab.robots import Unicycle
from slamlab.sensors import RangeBearing
from slamlab.slam import EKFSlam

COV = np.diag([0.01, 0.0025])
LANDMARKS = np.array([[3.0, 1.0], [3.0, -1.0], [6.0, 2.0]])
SENSOR = RangeBearing(0.1, 0.02)


def drive(rng, steps=40, clutter=False):
    motion, poses = Unicycle(), [np.zeros(3)]
    u = np.tile([0.5, 0.1], (steps, 1))
    u[0] = 0
    dt = np.r_[0.0, np.full(steps - 1, 0.2)]
    observations, ids = [], []
    for k in range(steps):
        if k:
            poses.append(motion.sample(poses[-1], u[k], 0.2, COV, rng))
        z, names = SENSOR.measure(poses[-1], LANDMARKS, rng)
        if clutter:
            z, names = np.vstack([z, [9.0, 0.0]]), np.append(names, -1)
        observations.append(z)
        ids.append(names)
    return Log(
        np.cumsum(dt),
        u,
        dt,
        COV,
        landmark_measurements=observations,
        ids=ids,
        truth=poses,
        landmarks=LANDMARKS,
    )


def test_a_run_is_the_loop_written_out():
    log = drive(np.random.default_rng(1))
    result = run(EKFSlam(Unicycle(), SENSOR, [0, 0, 0]), log, record=("landmarks",))
    slam, poses = EKFSlam(Unicycle(), SENSOR, [0, 0, 0]), []
    for step in log:
        if step.dt > 0:
            slam.predict(step.u, step.dt, step.control_cov)
        slam.update(step.z, step.ids)
        poses.append(slam.pose.copy())
    np.testing.assert_array_equal(result.poses, poses)
    np.testing.assert_array_equal(result.system.landmarks, slam.landmarks)
    assert len(result.recorded["landmarks"]) == len(log)
    assert result.seconds.shape == (len(log),)
    assert repr(result) == "Run(EKFSlam over 40 steps, 40 recorded)"


def test_errors_and_consistency_come_from_the_run():
    log = drive(np.random.default_rng(2))
    result = run(EKFSlam(Unicycle(), SENSOR, [0, 0, 0]), log)
    wheels = run(DeadReckoning(Unicycle(), [0, 0, 0]), log)
    assert ate(result).rmse == ate(result.poses, log.truth).rmse
    assert ate(result, aligned=False).rmse < ate(wheels, aligned=False).rmse
    assert rpe(result, delta=5).translation.shape == (35,)
    scores = nees(result)
    assert np.isnan(scores[0])
    assert 0.5 < np.nanmean(scores) < 12
    innovations = nis(result)
    # The first measurements found an empty map: nothing to compare with.
    assert np.isnan(innovations[0])
    assert 3 < np.nanmean(innovations) < 9


def test_every_records_some_steps_and_the_last():
    log = drive(np.random.default_rng(1), steps=12)
    result = run(DeadReckoning(Unicycle(), [0, 0, 0]), log, every=5)
    assert result.rows.tolist() == [0, 5, 10, 11]
    np.testing.assert_array_equal(result.truth, log.truth[[0, 5, 10, 11]])
    assert len(result.reports) == 12


def test_clutter_is_not_handed_over_with_known_ids():
    rng = np.random.default_rng(3)
    result = run(EKFSlam(Unicycle(), SENSOR, [0, 0, 0]), drive(rng, clutter=True))
    assert sorted(result.system.ids) == [0, 1, 2]


class Deaf:
    measures = "scan"
    pose = np.zeros(3)
    pose_cov = np.eye(3)

    def predict(self, u, dt, control_cov):
        pass

    def update(self, measurement, ids=None):
        if measurement[0] > 2:
            raise ValueError("ranges: expected less")
        return float(measurement[0])


def test_what_a_system_cannot_be_fed_is_said():
    log = drive(np.random.default_rng(1), steps=3)
    with pytest.raises(ValueError, match="log: expected ranges for Deaf, it has none"):
        run(Deaf(), log)
    with pytest.raises(ValueError, match="system: expected an estimator .*Unicycle, which has no"):
        run(Unicycle(), log)
    with pytest.raises(ValueError, match="got the class DeadReckoning itself"):
        run(DeadReckoning, log)
    with pytest.raises(ValueError, match="log: expected a Log, got list"):
        run(Deaf(), [])
    with pytest.raises(ValueError, match="record: .*got 'soul'"):
        run(DeadReckoning(Unicycle(), [0, 0, 0]), log, record=("soul",))


def test_a_refusal_names_its_step():
    scans = Log(
        [0, 1, 2], np.zeros((3, 2)), 1.0, COV, ranges=[[1.0], [2.0], [3.0]], scan=ScanGeometry([0])
    )
    assert run(Deaf(), scans[:2]).reports == (1.0, 2.0)
    with pytest.raises(ValueError, match="step 2 of the log: ranges: expected less"):
        run(Deaf(), scans)
    with pytest.raises(ValueError, match="expected a log with truth"):
        ate(run(Deaf(), scans[:2]))
