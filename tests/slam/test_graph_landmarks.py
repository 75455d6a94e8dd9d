"""Landmarks in a pose graph: error, optimum (beside gtsam), covariances, bad input."""

import numpy as np
import pytest

from slamlab.datasets.synthetic import manhattan_graph
from slamlab.geometry import between, compose, inverse, inverse_transform, transform
from slamlab.slam import PoseGraph


def seen_graph(seed=0, n=25, k=12, noise=0.05, start=0.1, odometry=True):
    """A walk past landmarks with anisotropic information, and its truth."""
    rng = np.random.default_rng(seed)
    walk = manhattan_graph(n, n - 1, rng, sigma_position=noise, sigma_heading=noise / 5)
    points = rng.uniform(-8, 8, (k, 2))
    edges = np.array([(i, j) for i in range(n) for j in rng.choice(k, 4, replace=False)])
    clean = inverse_transform(walk.truth[edges[:, 0]], points[edges[:, 1], None])[:, 0]
    root = rng.normal(size=(len(edges), 2, 2)) / noise
    information = root @ np.swapaxes(root, 1, 2) + np.eye(2) / noise**2
    chain = walk.graph
    keep = slice(None) if odometry else slice(0)
    graph = PoseGraph(
        walk.truth + [[0, 0, 0]] + start * rng.normal(size=(n, 3)) * (np.arange(n) > 0)[:, None],
        chain.edges[keep],
        chain.measurements[keep],
        chain.information[keep],
        landmarks=points + start * rng.normal(size=points.shape),
        landmark_edges=edges,
        landmark_measurements=clean + noise * rng.normal(size=clean.shape),
        landmark_information=information,
    )
    return graph, walk.truth, points


def test_chi2_counts_poses_and_landmarks():
    graph, _, _ = seen_graph()
    e, f = graph.residuals(), graph.landmark_residuals()
    right = np.einsum("ka,kab,kb", e, graph.information, e)
    right += np.einsum("ka,kab,kb", f, graph.landmark_information, f)
    assert graph.chi2() == pytest.approx(right, rel=1e-12)
    for k, (i, j) in enumerate(graph.landmark_edges[:5]):
        seen = transform(graph.poses[i], (graph.landmark_measurements[k] + f[k])[None])[0]
        assert np.allclose(seen, graph.landmarks[j])  # z + e, set into the world, is the landmark


def test_moving_the_whole_world_leaves_chi2():
    graph, _, _ = seen_graph(1)
    motion = np.array([3.0, -2.0, 1.1])
    poses, points = compose(motion, graph.poses), transform(motion, graph.landmarks)
    assert graph.chi2(poses, points) == pytest.approx(graph.chi2(), rel=1e-9)
    assert graph.chi2(poses) != pytest.approx(graph.chi2(), rel=0.1)


@pytest.mark.parametrize("odometry", [True, False])
@pytest.mark.parametrize("method", ["gauss-newton", "levenberg-marquardt"])
def test_the_optimum_is_that_of_gtsam(odometry, method):
    gtsam = pytest.importorskip("gtsam")
    graph, _, _ = seen_graph(2, odometry=odometry)
    factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    n = len(graph.poses)
    for k, pose in enumerate(graph.poses):
        values.insert(k, gtsam.Pose2(*pose))
    for k, point in enumerate(graph.landmarks):
        values.insert(n + k, point)
    for (i, j), z, Omega in zip(graph.edges, graph.measurements, graph.information, strict=True):
        noise = gtsam.noiseModel.Gaussian.Information(Omega)
        factors.add(gtsam.BetweenFactorPose2(int(i), int(j), gtsam.Pose2(*z), noise))
    own = zip(
        graph.landmark_edges, graph.landmark_measurements, graph.landmark_information, strict=True
    )

    def error_of(z):
        def error(this, values, H):
            pose, point = values.atPose2(this.keys()[0]), values.atPoint2(this.keys()[1])
            first, second = np.zeros((2, 3), order="F"), np.zeros((2, 2), order="F")
            e = pose.transformTo(point, first, second) - z
            if H is not None:
                H[0], H[1] = first, second
            return e

        return error

    for (i, j), z, Omega in own:
        noise = gtsam.noiseModel.Gaussian.Information(Omega)
        factors.add(gtsam.CustomFactor(noise, [int(i), n + int(j)], error_of(z)))
    factors.add(gtsam.NonlinearEqualityPose2(0, gtsam.Pose2(*graph.poses[0])))
    found = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    points = np.array([found.atPoint2(n + k) for k in range(len(graph.landmarks))])
    result = graph.optimize(method, tolerance=1e-12)
    assert result.converged
    assert result.chi2 == pytest.approx(2 * factors.error(found), rel=1e-4)
    assert np.allclose(result.landmarks, points, atol=2e-3)


def test_both_are_found_to_their_noise_and_the_graph_stays_as_it_was():
    graph, truth, points = seen_graph(3)
    before = graph.landmarks.copy()
    result = graph.optimize()
    first = compose(graph.poses[0], inverse(truth[0]))
    assert np.abs(result.landmarks - transform(first, points)).max() < 0.3
    assert np.array_equal(graph.landmarks, before)
    settled = graph.with_poses(result.poses, result.landmarks)
    assert settled.chi2() == pytest.approx(result.chi2)


def test_covariances_are_blocks_of_the_dense_inverse():
    graph, _, _ = seen_graph(4)
    result = graph.optimize()
    n, k = len(graph.poses), len(graph.landmarks)

    def residuals(x):
        poses, points = x[: 3 * n].reshape(n, 3), x[3 * n :].reshape(k, 2)
        return np.r_[
            graph.residuals(poses).ravel(), graph.landmark_residuals(poses, points).ravel()
        ]

    x = np.r_[result.poses.ravel(), result.landmarks.ravel()]
    steps = 1e-6 * np.eye(len(x))
    J = np.stack([(residuals(x + d) - residuals(x - d)) / 2e-6 for d in steps], 1)[:, 3:]
    m, s = 3 * len(graph.edges), len(graph.landmark_edges)
    Omega = np.zeros((len(J), len(J)))
    for e, block in enumerate(graph.information):
        Omega[3 * e : 3 * e + 3, 3 * e : 3 * e + 3] = block
    for e, block in enumerate(graph.landmark_information):
        Omega[m + 2 * e : m + 2 * e + 2, m + 2 * e : m + 2 * e + 2] = block
    dense = np.linalg.inv(J.T @ Omega @ J)
    at = dict(poses=result.poses, landmarks=result.landmarks)
    assert np.allclose(graph.marginal_cov(7, **at), dense[18:21, 18:21], rtol=1e-4, atol=1e-9)
    for row in range(k):
        a = 3 * (n - 1) + 2 * row
        assert np.allclose(graph.landmark_cov(row, **at), dense[a : a + 2, a : a + 2], rtol=1e-4)
    assert graph.landmark_cov([0, 3], **at).shape == (2, 2, 2)
    assert s == 100


@pytest.mark.parametrize("odometry", [True, False])
def test_the_first_guess_needs_no_start(odometry):
    graph, _, _ = seen_graph(5, odometry=odometry)
    best = graph.optimize().chi2
    lost = np.random.default_rng(0).uniform(-50, 50, (len(graph.poses), 3))
    lost[0] = graph.poses[0]
    guess = graph.with_poses(lost, 50 * np.ones_like(graph.landmarks)).chordal_initialisation()
    assert np.array_equal(guess.poses[0], graph.poses[0])
    assert guess.chi2() < 20 * best
    assert guess.optimize().chi2 == pytest.approx(best, rel=1e-6)


def test_a_kernel_takes_the_force_from_a_landmark_mistaken_for_another():
    graph, _, _ = seen_graph(6, noise=0.02)
    edges = graph.landmark_edges.copy()
    edges[40, 1] = (edges[40, 1] + 5) % len(graph.landmarks)
    mistaken = PoseGraph(
        graph.poses, graph.edges, graph.measurements, graph.information,
        landmarks=graph.landmarks, landmark_edges=edges,
        landmark_measurements=graph.landmark_measurements,
        landmark_information=graph.landmark_information,
    )  # fmt: skip
    good = graph.optimize()
    plain = mistaken.chordal_initialisation().optimize()
    robust = mistaken.optimize(kernel="dcs", kernel_width=(30, 10, 3), max_iterations=100)
    assert robust.landmark_weights[40] < 0.01 < 0.5 < np.median(robust.landmark_weights)
    off = [np.abs(between(good.poses, r.poses)[:, :2]).max() for r in (plain, robust)]
    assert off[1] < 0.05 < off[0]


BAD = {
    "landmarks: expected shape": {"landmarks": [1.0, 2.0]},
    "landmark_edges: expected rows of 2 poses, got 2 in edge 0": {"landmark_edges": [[2, 0]]},
    "landmark_edges: expected rows of 1 landmarks, got 1": {"landmark_edges": [[0, 1]]},
    "landmark_edges: expected whole": {"landmark_edges": [[0.5, 1]]},
    "landmark_measurements: expected shape": {"landmark_measurements": [[1, 2, 3]]},
    r"landmark_information: expected shape \(2, 2\)": {"landmark_information": np.ones((3, 2, 2))},
    "landmark_information: expected a positive": {"landmark_information": -np.eye(2)},
    "landmark_ids: expected 1 whole": {"landmark_ids": [3, 4]},
    "landmark_ids: expected ids that no pose has, got 1": {"landmark_ids": [1]},
}


@pytest.mark.parametrize("message", BAD)
def test_bad_arguments_are_named(message):
    good = {
        "poses": [[0, 0, 0], [1, 0, 0]],
        "edges": [[0, 1]],
        "measurements": [[1, 0, 0]],
        "information": np.eye(3),
        "landmarks": [[1, 1]],
        "landmark_edges": [[0, 0]],
        "landmark_measurements": [[1, 1]],
    }
    graph = PoseGraph(**good)
    assert repr(graph) == "PoseGraph(2 poses, 1 edges, 1 landmarks seen 1 times)"
    with pytest.raises(ValueError, match=message):
        PoseGraph(**good | BAD[message])


def test_what_nothing_holds_is_named():
    two = [[0, 0, 0], [1, 0, 0]]
    sight = dict(landmarks=[[1, 1], [2, 2]], landmark_measurements=[[1, 1]])
    alone = PoseGraph(two, [[0, 1]], [[1, 0, 0]], np.eye(3), landmark_edges=[[0, 0]], **sight)
    with pytest.raises(ValueError, match="not joined: landmark 3"):
        alone.optimize()
    turning = PoseGraph(
        two,
        [],
        np.zeros((0, 3)),
        np.eye(3),
        landmarks=[[1, 1]],
        landmark_edges=[[0, 0], [1, 0]],
        landmark_measurements=[[1, 1], [0, 1]],
    )
    with pytest.raises(ValueError, match="free to move: pose 1$"):
        turning.optimize()
    with pytest.raises(ValueError, match="i: expected the row of one of 1 poses"):
        turning.landmark_cov(1)
