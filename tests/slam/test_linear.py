"""The linear models: constants for Jacobians, and EKF-SLAM with them is the Kalman filter."""

import numpy as np
import pytest

from slamlab.filters import kalman
from slamlab.gaussian import Gaussian
from slamlab.slam import EKFSlam
from slamlab.slam.linear import CompassMotion, Displacement

MOTION, SENSOR = CompassMotion(), Displacement(0.3)
rng = np.random.default_rng(3)


def test_jacobians_are_the_derivatives_and_do_not_depend_on_the_pose():
    for pose in rng.normal(size=(5, 3)):
        u, landmark = rng.normal(size=(2, 2))
        F_x, F_u = MOTION.jacobians(pose, u, 0.5)
        H_pose, H_landmark = SENSOR.jacobians(pose, landmark)
        G_pose, G_z = SENSOR.locate_jacobians(pose, landmark)
        d, e = rng.normal(size=3), rng.normal(size=2)
        step = MOTION.step(pose + d, u + e, 0.5) - MOTION.step(pose, u, 0.5)
        np.testing.assert_allclose(step, F_x @ d + F_u @ e, atol=1e-12)
        seen = SENSOR.observe(pose + d, landmark + e) - SENSOR.observe(pose, landmark)
        np.testing.assert_allclose(seen, H_pose @ d + H_landmark @ e, atol=1e-12)
        there = SENSOR.locate(pose + d, landmark + e) - SENSOR.locate(pose, landmark)
        np.testing.assert_allclose(there, G_pose @ d + G_z @ e, atol=1e-12)


def test_batches_broadcast():
    poses, landmarks = rng.normal(size=(4, 1, 3)), rng.normal(size=(6, 2))
    assert SENSOR.observe(poses, landmarks).shape == (4, 6, 2)
    assert SENSOR.jacobians(poses, landmarks)[0].shape == (4, 6, 2, 3)
    assert SENSOR.visible(poses, landmarks).all()
    assert MOTION.sample(poses[:, 0], [1.0, 0.0], 0.1, np.eye(2), rng).shape == (4, 3)
    spread = MOTION.sample(np.zeros((20_000, 3)), [0, 0], 1.0, [[4, 1], [1, 1]], rng)
    np.testing.assert_allclose(np.cov(spread[:, :2].T), [[4, 1], [1, 1]], atol=0.15)
    assert not MOTION.sample(np.zeros(3), [0, 0], 1.0, np.zeros((2, 2)), rng).any()


def test_ekf_slam_is_the_kalman_filter():
    root = rng.normal(size=(7, 7))
    slam = EKFSlam(MOTION, SENSOR, rng.normal(size=7) * 0.3, root @ root.T, ids=[0, 1])
    belief = Gaussian(slam.mean.copy(), slam.cov.copy())
    H = np.zeros((4, 7))
    H[:, :2], H[:2, 3:5], H[2:, 5:] = np.tile(-np.eye(2), (2, 1)), np.eye(2), np.eye(2)
    Q = np.zeros((7, 7))
    Q[:2, :2] = 0.25 * np.diag([0.1, 0.2])
    for _ in range(20):
        u, z = rng.normal(size=2), rng.normal(size=(2, 2))
        slam.predict(u, 0.5, np.diag([0.1, 0.2]))
        slam.update(z, [0, 1])
        belief = kalman.predict(belief, np.eye(7), Q)
        belief = Gaussian(belief.mean + np.r_[0.5 * u, np.zeros(5)], belief.cov)
        belief, _ = kalman.update(belief, z.ravel(), H, 0.09 * np.eye(4))
        np.testing.assert_allclose(slam.mean, belief.mean, atol=1e-10)
        np.testing.assert_allclose(slam.cov, belief.cov, atol=1e-10)


def test_bad_parameters_are_named():
    with pytest.raises(ValueError, match="sigma: expected"):
        Displacement(0.0)
    with pytest.raises(ValueError, match="u: expected shape"):
        MOTION.step([0, 0, 0], [1, 2, 3], 0.1)
    with pytest.raises(ValueError, match="landmark: expected shape"):
        SENSOR.observe([0, 0, 0], [1, 2, 3])
    with pytest.raises(ValueError, match="dt: expected"):
        MOTION.jacobians([0, 0, 0], [1, 2], -1)
