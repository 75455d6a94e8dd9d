"""The sensor of points: the landmark in the body frame, its inverse, and all derivatives."""

import numpy as np
import pytest

from slamlab.geometry import compose, transform
from slamlab.models import LandmarkSensor, as_sensor
from slamlab.sensors import PointSensor

SENSOR = PointSensor(np.diag([0.04, 0.01]))
POSES = np.random.default_rng(0).uniform(-3, 3, (6, 3))
POINTS = np.random.default_rng(1).uniform(-9, 9, (6, 2))


def derivative(f, x):
    return np.stack([(f(x + d) - f(x - d)) / 2e-6 for d in 1e-6 * np.eye(x.shape[-1])], -1)


def test_it_is_a_sensor():
    assert isinstance(SENSOR, LandmarkSensor)
    assert as_sensor("sensor", SENSOR) is SENSOR
    assert SENSOR.residual([1.0, 2.0], [0.5, 4.0]).tolist() == [0.5, -2.0]
    assert SENSOR.reach([[3.0, -4.0]]).tolist() == [5.0]


def test_ahead_is_x_and_left_is_y():
    assert np.allclose(SENSOR.observe([1, 2, np.pi / 2], [1, 5]), [3, 0])
    assert np.allclose(SENSOR.observe([1, 2, np.pi / 2], [0, 2]), [0, 1])


def test_locate_is_the_inverse():
    z = SENSOR.observe(POSES, POINTS)
    assert np.allclose(SENSOR.locate(POSES, z), POINTS)
    assert np.allclose(SENSOR.observe(POSES, SENSOR.locate(POSES, POINTS)), POINTS)


def test_moving_the_world_moves_nothing_seen():
    motion = np.array([1.0, -4.0, 2.0])
    seen = SENSOR.observe(compose(motion, POSES), transform(motion, POINTS))
    assert np.allclose(seen, SENSOR.observe(POSES, POINTS))


def test_jacobians_are_the_derivatives():
    H_pose, H_point = SENSOR.jacobians(POSES, POINTS)
    G_pose, G_z = SENSOR.locate_jacobians(POSES, POINTS)
    for k, (pose, point) in enumerate(zip(POSES, POINTS, strict=True)):
        right = derivative(lambda x, p=point: SENSOR.observe(x, p), pose)
        assert np.allclose(H_pose[k], right, atol=1e-8)
        assert not np.allclose(H_pose[k] * [1, 1, -1], right, atol=0.1)  # turned the wrong way
        right = derivative(lambda p, x=pose: SENSOR.observe(x, p), point)
        assert np.allclose(H_point[k], right, atol=1e-8)
        assert not np.allclose(H_point[k].T, right, atol=0.01)
        right = derivative(lambda x, p=point: SENSOR.locate(x, p), pose)
        assert np.allclose(G_pose[k], right, atol=1e-8)
        right = derivative(lambda p, x=pose: SENSOR.locate(x, p), point)
        assert np.allclose(G_z[k], right, atol=1e-8)


def test_one_pose_sees_many_points():
    H_pose, H_point = SENSOR.jacobians(POSES[0], POINTS)
    assert SENSOR.observe(POSES[0], POINTS).shape == (6, 2)
    assert (H_pose.shape, H_point.shape) == ((6, 2, 3), (6, 2, 2))
    assert np.allclose(H_pose[2], SENSOR.jacobians(POSES[0], POINTS[2])[0])


def test_only_what_is_near_is_visible():
    near = PointSensor(np.eye(2), max_range=2.0)
    assert near.visible([1, 1, 3], [[2, 2], [3, 3]]).tolist() == [True, False]
    assert SENSOR.visible([1, 1, 3], [900, 900])


def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match="max_range"):
        PointSensor(np.eye(2), max_range=0.0)
    with pytest.raises(ValueError, match="cov: expected a positive"):
        PointSensor(np.diag([1.0, -1.0]))
    with pytest.raises(ValueError, match=r"cov: expected shape \(2, 2\)"):
        PointSensor(np.ones((3, 1, 1)) * np.eye(2))
    with pytest.raises(ValueError, match="landmark: expected shape"):
        SENSOR.observe(POSES, [1.0])
    with pytest.raises(ValueError, match="z: expected finite"):
        SENSOR.locate(POSES, [1.0, np.nan])
    with pytest.raises(ValueError, match="read-only"):
        SENSOR.cov[0, 0] = 3
