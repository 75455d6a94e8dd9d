"""Protocols: what is no model is refused by name, and whoever derives gets the rest."""

import numpy as np
import pytest

from slamlab.logs import ScanGeometry
from slamlab.models import LandmarkSensor, MotionModel, as_motion, as_scan_sensor, as_sensor
from slamlab.robots import Mecanum, RelativePose, Unicycle
from slamlab.sensors import Lidar, RangeBearing, Wall


def test_ours_are_models():
    for motion in (Unicycle(), Mecanum(0.05, 0.2, 0.15), RelativePose()):
        assert as_motion("motion", motion) is motion
    for sensor in (RangeBearing(0.1, 0.1), Wall(0.1, 0.1)):
        assert as_sensor("sensor", sensor) is sensor
    for lidar in (Lidar(4), ScanGeometry([0.0])):
        assert as_scan_sensor("lidar", lidar) is lidar


def test_swapped_arguments_and_classes_are_named():
    with pytest.raises(ValueError, match="motion: expected a motion model .*RangeBearing, which"):
        as_motion("motion", RangeBearing(0.1, 0.1))
    with pytest.raises(ValueError, match="sensor: .*which has no cov, observe"):
        as_sensor("sensor", Unicycle())
    with pytest.raises(ValueError, match="got the class Unicycle itself"):
        as_motion("motion", Unicycle)


class Balloon(MotionModel):
    """A student's robot: it drifts with the wind u = (v_x, v_y)."""

    def step(self, pose, u, dt):
        pose, u = np.asarray(pose, float), np.asarray(u, float)
        return pose + dt * np.concatenate([u, np.zeros((*u.shape[:-1], 1))], -1)

    def jacobians(self, pose, u, dt):
        return np.eye(3), dt * np.eye(3)[:, :2]


def test_a_student_derives_and_can_sample():
    rng = np.random.default_rng(1)
    poses = Balloon().sample(np.zeros((20_000, 3)), [1.0, 0.0], 2.0, np.diag([0.04, 0.01]), rng)
    np.testing.assert_allclose(poses.mean(0), [2, 0, 0], atol=0.01)
    np.testing.assert_allclose(poses.std(0), [0.4, 0.2, 0], atol=0.01)
    assert LandmarkSensor.residual(Balloon(), [3.0, 1.0], [1.0, 1.0]).tolist() == [2.0, 0.0]


def test_the_motion_between_poses_leads_from_one_to_the_other():
    pose, u = np.array([1.0, 2.0, 0.7]), np.array([0.5, -0.2, 0.3])
    F_x, F_u = RelativePose().jacobians(pose, u, 1.0)

    def difference(f, x):
        steps = 1e-6 * np.eye(3)
        return np.stack([(f(x + h) - f(x - h)) / 2e-6 for h in steps], -1)

    step = RelativePose().step
    np.testing.assert_allclose(F_x, difference(lambda x: step(x, u, 1), pose), atol=1e-8)
    np.testing.assert_allclose(F_u, difference(lambda v: step(pose, v, 1), u), atol=1e-8)
    # The wrong form, the motion taken in the frame of the world, is another matrix.
    assert np.abs(F_u - np.eye(3)).max() > 0.5
