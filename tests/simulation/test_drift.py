"""Odometry made worse: as large as asked for, repeatable, everything else untouched."""

import numpy as np
import pytest

from slamlab.evaluation import run
from slamlab.geometry import between
from slamlab.localization import DeadReckoning
from slamlab.logs import Log
from slamlab.robots import RelativePose
from slamlab.simulation import drifted

T = 2000
TRUTH = np.column_stack([np.arange(T) * 1.0, np.zeros(T), np.zeros(T)])
LOG = Log(np.arange(T), np.zeros((T, 3)), 1.0, np.zeros((3, 3)), truth=TRUTH)


def test_without_noise_the_odometry_is_the_truth():
    log = drifted(LOG, np.random.default_rng(0), 0.0, 0.0, 0.0, 0.0)
    due = between(TRUTH[:-1], TRUTH[1:])
    np.testing.assert_allclose(log.u[1:, 0], due[:, 0])
    np.testing.assert_allclose(log.u[1:, 2], due[:, 2], atol=1e-12)


def test_bias_and_noise_are_those_asked_for():
    log = drifted(LOG, np.random.default_rng(1))
    dx, dy, turn = log.u[1:].T
    assert abs(abs(dx.mean() - 1) - 0.02) < 0.003
    assert abs(dx.std() - 0.04) < 0.003
    assert abs(dy.std() - 0.01) < 0.001
    assert abs(abs(np.rad2deg(turn.mean())) - 0.4) < 0.15
    assert abs(np.rad2deg(turn.std()) - 1.5) < 0.1


def test_its_covariance_covers_noise_and_bias():
    log = drifted(LOG, np.random.default_rng(2))
    error = log.u[1:] - between(TRUTH[:-1], TRUTH[1:])
    variance = np.diagonal(log.control_cov[1:], axis1=1, axis2=2)
    assert np.all((error**2 / variance).mean(0) < 1.2)


def test_the_same_seed_gives_the_same_odometry_and_dead_reckoning_drifts():
    one, other = (drifted(LOG, np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(one.u, other.u)
    end = run(DeadReckoning(RelativePose(), TRUTH[0]), one).poses[-1]
    assert np.hypot(*(end - TRUTH[-1])[:2]) > 30
    assert np.array_equal(one.truth, LOG.truth)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: drifted(LOG, 1), "rng"),
        (lambda: drifted(LOG, np.random.default_rng(0), bias=-1), "bias"),
        (lambda: drifted(LOG, np.random.default_rng(0), slip=2), "slip"),
        (lambda: drifted(Log([0], [[0, 0, 0]], 0, np.eye(3)), np.random.default_rng(0)), "truth"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
