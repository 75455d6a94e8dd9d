"""The growing graph: always the optimum of the whole, with few factorisations."""

import numpy as np
import pytest

from slamlab.datasets.synthetic import manhattan_graph
from slamlab.slam import IncrementalGraph, PoseGraph


def town(n=120, m=170, seed=0):
    return manhattan_graph(n, m, np.random.default_rng(seed)).graph


def fed(graph, **options):
    """The graph, edge by edge in the order of driving; yields after each closure."""
    growing = IncrementalGraph(graph.poses[0], **options)
    for k in np.lexsort((graph.edges[:, 0], graph.edges[:, 1])):
        (i, j), z, Omega = graph.edges[k].tolist(), graph.measurements[k], graph.information[k]
        if j == len(growing):
            assert growing.add_pose(z, Omega, i) == j
        else:
            growing.add_edge(i, j, z, Omega)
            yield growing


def exactly(graph):
    return graph.optimize(tolerance=0.0, max_iterations=12).poses


def test_after_every_closure_it_is_the_optimum_of_the_whole():
    graph = town()
    for count, growing in enumerate(fed(graph)):
        near = growing.poses
        growing.optimize()
        assert growing.converged
        if count % 10 == 0:
            right = exactly(growing.graph())
            assert np.abs(growing.poses - right).max() < 1e-9
            assert np.abs(near - right).max() < 1e-3
    assert growing.factorisations < 0.3 * (count + 1)
    assert growing.graph().chi2() == pytest.approx(graph.optimize().chi2, rel=1e-6)
    assert repr(growing) == f"IncrementalGraph({len(growing)} poses, {count + 120} edges)"


def test_it_ends_where_isam2_ends():
    gtsam = pytest.importorskip("gtsam")
    graph = town(seed=1)
    *_, growing = fed(graph)
    growing.optimize()
    isam = gtsam.ISAM2(gtsam.ISAM2Params())
    factors, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    n = len(growing)
    for k in range(n):
        start.insert(k, gtsam.Pose2(*graph.poses[k]))
    factors.add(gtsam.NonlinearEqualityPose2(0, gtsam.Pose2(*graph.poses[0])))
    for (i, j), z, Omega in zip(graph.edges, graph.measurements, graph.information, strict=True):
        noise = gtsam.noiseModel.Gaussian.Information(Omega)
        if max(i, j) < n:
            factors.add(gtsam.BetweenFactorPose2(int(i), int(j), gtsam.Pose2(*z), noise))
    isam.update(factors, start)
    for _ in range(20):
        isam.update()
    found = isam.calculateEstimate()
    theirs = np.array([[p.x(), p.y()] for p in (found.atPose2(k) for k in range(n))])
    assert np.abs(growing.poses[:, :2] - theirs).max() < 1e-2


def test_a_pose_that_is_only_added_moves_no_other():
    growing = IncrementalGraph([1.0, 2.0, 0.5])
    for _ in range(5):
        growing.add_pose([1.0, 0.0, 0.1], np.eye(3))
    side = growing.add_pose([0.0, 1.0, 0.0], np.eye(3), previous=2)
    before = growing.poses
    assert growing.factorisations == 0
    growing.add_pose([1.0, 0.0, 0.0], np.eye(3))
    assert np.array_equal(growing.poses[:-1], before)
    growing.add_edge(5, side, [-2.0, 1.0, 0.2], np.eye(3))
    growing.optimize()
    assert np.allclose(growing.poses, exactly(growing.graph()), atol=1e-9)
    copy = growing.poses
    copy += 1
    assert not np.allclose(copy, growing.poses)


def test_a_refused_call_changes_nothing():
    growing = IncrementalGraph()
    growing.add_pose([1.0, 0, 0], np.eye(3))
    for call, message in [
        (lambda: growing.add_pose([1.0, 0], np.eye(3)), "measurement: expected shape"),
        (lambda: growing.add_pose([1.0, 0, 0], np.diag([1.0, 0, 1])), "positive definite"),
        (lambda: growing.add_pose([1.0, 0, 0], np.eye(3), previous=4), "previous: expected one"),
        (lambda: growing.add_edge(0, 2, [1.0, 0, 0], np.eye(3)), "j: expected one of 2 poses"),
        (lambda: growing.add_edge(1, 1, [1.0, 0, 0], np.eye(3)), "two different poses"),
        (
            lambda: growing.add_edge(0, 1, [np.nan, 0, 0], np.eye(3)),
            "measurement: expected finite",
        ),
        (
            lambda: growing.add_edge(0, 1, [1, 0, 0], -np.eye(3)),
            "information: expected a positive",
        ),
    ]:
        with pytest.raises(ValueError, match=message):
            call()
    assert repr(growing) == "IncrementalGraph(2 poses, 1 edges)"
    assert IncrementalGraph([1, 2, 3]).graph().poses.tolist() == [[1, 2, 3]]
    with pytest.raises(ValueError, match="tolerance"):
        IncrementalGraph(tolerance=0.0)
    assert isinstance(growing.graph(), PoseGraph)
