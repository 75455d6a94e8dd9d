"""The graph of a log: its parts, and that it is what the log says."""

import numpy as np
import pytest

from slamlab.geometry import between, rotation
from slamlab.logs import Log
from slamlab.robots import YOUBOT, RelativePose, Unicycle
from slamlab.sensors import PointSensor, RangeBearing
from slamlab.slam import PoseGraph

SENSOR = RangeBearing(0.1, 0.02, offset=0.3)
POINTS = np.array([[4.0, 1.0], [2.0, -3.0]])


def log_of(n=6, names=False):
    u = np.array([[1.0, 0.1, 0.2]] * n)
    u[0] = 0
    dt = np.r_[0.0, np.ones(n - 1)]
    truth = [np.array([1.0, 2.0, 0.3])]
    for k in range(1, n):
        truth.append(RelativePose().step(truth[-1], u[k], 1))
    observations = [SENSOR.observe(x, POINTS) for x in truth]
    observations[3] = np.vstack([observations[3], [[1.0, 0.0]]])
    ids = [["a", "b"] if names else [5, 2]] * n
    ids[3] = [*ids[3], "c" if names else -1]
    return Log(
        np.arange(n),
        u,
        dt,
        np.diag([0.01, 0.02, 0.003]),
        landmark_measurements=observations,
        ids=ids,
    ), truth


def test_a_log_without_noise_is_a_graph_without_error():
    log, truth = log_of()
    graph = PoseGraph.from_log(log, RelativePose(), SENSOR, start=truth[0])
    assert np.allclose(graph.poses, truth)
    assert np.allclose(graph.landmarks, POINTS)
    assert len(graph.landmark_edges) == 12  # clutter (-1) is left out
    assert graph.chi2() < 1e-20
    assert np.allclose(np.trace(np.linalg.inv(graph.information[2])), 0.033)
    assert len(PoseGraph.from_log(log, RelativePose()).landmarks) == 0
    named, _ = log_of(names=True)
    assert len(PoseGraph.from_log(named, RelativePose(), SENSOR).landmarks) == 3


def test_the_noise_of_a_motion_is_turned_into_the_frame_of_the_error():
    rng, n = np.random.default_rng(2), 400
    sigma = np.array([0.3, 0.01, 0.02])
    true = np.column_stack([rng.normal(size=(n, 2)), rng.uniform(-3, 3, n)])
    true[0] = 0
    noisy = true + sigma * rng.normal(size=true.shape) * (np.arange(n) > 0)[:, None]
    path = [np.zeros(3)]
    for u in true[1:]:
        path.append(RelativePose().step(path[-1], u, 1))
    log = Log(np.arange(n), noisy, np.r_[0.0, np.ones(n - 1)], np.diag(sigma**2))
    graph = PoseGraph.from_log(log, RelativePose())
    dof = 3 * (n - 1)
    assert abs(graph.chi2(path) - dof) < 4 * np.sqrt(2 * dof)
    unturned = PoseGraph(path, graph.edges, graph.measurements, np.diag(sigma**-2.0))
    assert unturned.chi2() > 100 * dof


def test_steps_of_many_lengths_and_noises_each_become_their_own_edge():
    rng, n = np.random.default_rng(3), 30
    dt = rng.choice([0.0, 0.05, 0.1, 0.4], n)
    covs = np.eye(3) * rng.uniform(0.1, 1.0, n)[:, None, None]
    log = Log(np.cumsum(dt), rng.normal(size=(n, 3)), dt, covs)
    graph, moved = PoseGraph.from_log(log, YOUBOT), np.flatnonzero(dt)
    for k, (edge, information) in enumerate(zip(moved, graph.information, strict=True)):
        step = between(graph.poses[k], graph.poses[k + 1])
        expected = YOUBOT.step(np.zeros(3), log.u[edge], dt[edge])
        np.testing.assert_allclose([step, graph.measurements[k]], [expected] * 2, atol=1e-12)
        F = YOUBOT.jacobians(np.zeros(3), log.u[edge], dt[edge])[1]
        F[:2] = rotation(expected[2]).T @ F[:2]
        np.testing.assert_allclose(information @ F @ covs[edge] @ F.T, np.eye(3), atol=1e-9)


def test_the_noise_of_a_measurement_is_turned_into_metres():
    log, _ = log_of()
    graph = PoseGraph.from_log(log, RelativePose(), SENSOR)
    z = log.landmark_measurements[0][0]
    rng = np.random.default_rng(1)
    noisy = z + rng.normal(size=(20000, 2)) * [0.1, 0.02]
    sampled = np.cov(SENSOR.locate(np.zeros(3), noisy).T)
    assert np.allclose(np.linalg.inv(graph.landmark_information[0]), sampled, rtol=0.05, atol=1e-4)


def test_the_optimum_is_that_of_an_ekf_where_all_is_linear():
    from slamlab.evaluation import run
    from slamlab.slam import EKFSlam

    rng = np.random.default_rng(3)
    n = 12
    u = np.column_stack([np.r_[0, np.ones(n - 1)], np.zeros(n), np.zeros(n)])
    truth = np.cumsum(u, 0)
    sensor, Q = PointSensor(0.01 * np.eye(2)), np.diag([0.01, 0.01, 1e-13])
    noisy = u + rng.normal(size=u.shape) * [0.1, 0.1, 0] * (np.arange(n) > 0)[:, None]
    observations = [sensor.observe(x, POINTS) + 0.1 * rng.normal(size=(2, 2)) for x in truth]
    log = Log(
        np.arange(n),
        noisy,
        np.r_[0, np.ones(n - 1)],
        Q,
        landmark_measurements=observations,
        ids=[[0, 1]] * n,
    )
    filtered = run(EKFSlam(RelativePose(), sensor, np.zeros(3)), log)
    smoothed = PoseGraph.from_log(log, RelativePose(), sensor).optimize(tolerance=1e-12)
    assert np.allclose(filtered.poses[-1], smoothed.poses[-1], atol=1e-5)
    assert np.allclose(filtered.system.landmarks, smoothed.landmarks, atol=1e-5)
    assert not np.allclose(filtered.poses[3], smoothed.poses[3], atol=1e-3)  # it saw no future


def test_what_cannot_be_an_edge_is_named():
    log, _ = log_of()
    with pytest.raises(ValueError, match="motion: expected a motion model"):
        PoseGraph.from_log(log, SENSOR)
    with pytest.raises(ValueError, match="expected measurements of landmarks with ids"):
        PoseGraph.from_log(Log([0, 1], np.zeros((2, 3)), 1, np.eye(3)), RelativePose(), SENSOR)
    flat = Log([0, 1], np.zeros((2, 3)), 1, np.diag([1.0, 0, 1]))
    with pytest.raises(ValueError, match="control_cov of step 0: expected noise in every"):
        PoseGraph.from_log(flat, RelativePose())
    wheels = Log([0, 1], np.ones((2, 2)), 1, np.eye(2))
    with pytest.raises(ValueError, match="control_cov of step 0: expected noise in every"):
        PoseGraph.from_log(wheels, Unicycle())
    batch = Log([0, 1], np.zeros((2, 5, 3)), 1, np.eye(3))
    with pytest.raises(ValueError, match="log: expected a Log of one robot"):
        PoseGraph.from_log(batch, RelativePose())
