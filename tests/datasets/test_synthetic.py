"""The synthetic town: sizes, noise, and a graph of P5's size that converges."""

import numpy as np
import pytest

from slamlab.datasets.synthetic import manhattan_graph
from slamlab.geometry import between


def test_same_seed_same_graph():
    one, other = (manhattan_graph(60, 90, np.random.default_rng(3)).graph for _ in range(2))
    assert np.array_equal(one.poses, other.poses)
    assert np.array_equal(one.edges, other.edges)
    assert not np.array_equal(
        one.poses, manhattan_graph(60, 90, np.random.default_rng(4)).graph.poses
    )


def test_a_graph_of_the_size_in_p5_converges_from_dead_reckoning():
    graph, truth = manhattan_graph(1802, 3546, np.random.default_rng(1))
    assert (len(graph.poses), len(graph.edges)) == (1802, 3546)
    result = graph.optimize()
    dof = 3 * (3546 - 1801)
    assert result.converged
    assert graph.chi2() > 1e6
    assert abs(result.chi2 - dof) < 4 * np.sqrt(2 * dof)
    before, after = (np.hypot(*(p - truth)[:, :2].T).mean() for p in (graph.poses, result.poses))
    assert after < 0.2 * before


def test_the_start_is_dead_reckoning_and_the_noise_is_as_said():
    graph, truth = manhattan_graph(
        800, 1500, np.random.default_rng(2), sigma_position=0.1, sigma_heading=0.02
    )
    assert np.allclose(graph.residuals()[:799], 0, atol=1e-12)
    assert (graph.edges[:799] == np.column_stack([np.arange(799), np.arange(1, 800)])).all()
    error = graph.measurements - between(truth[graph.edges[:, 0]], truth[graph.edges[:, 1]])
    error[:, 2] = (error[:, 2] + np.pi) % (2 * np.pi) - np.pi
    assert np.allclose(error.std(0), [0.1, 0.1, 0.02], rtol=0.1)
    assert np.allclose(graph.information[0], np.diag([100, 100, 2500]))
    assert graph.chi2(truth) == pytest.approx(3 * 1500, rel=0.1)


@pytest.mark.parametrize(("n", "m"), [(2, 1), (5, 10), (10, 45), (30, 29)])
def test_the_extremes_exist(n, m):
    graph, _ = manhattan_graph(n, m, np.random.default_rng(0))
    assert (len(graph.poses), len(graph.edges)) == (n, m)
    assert len(np.unique(np.sort(graph.edges, 1), axis=0)) == m
    assert graph.optimize().converged


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1, 5), "n_poses"),
        ((10, 8), "n_edges: expected at least 9"),
        ((10, 46), "n_edges: expected at most 45"),
        ((10.5, 20), "n_poses"),
    ],
)
def test_impossible_sizes_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        manhattan_graph(*arguments, np.random.default_rng(0))


def test_bad_options_are_named():
    with pytest.raises(ValueError, match="rng"):
        manhattan_graph(10, 20, 7)
    with pytest.raises(ValueError, match="sigma_heading"):
        manhattan_graph(10, 20, np.random.default_rng(0), sigma_heading=-1.0)
    with pytest.raises(ValueError, match="sigma_position"):
        manhattan_graph(10, 20, np.random.default_rng(0), sigma_position=0.0)
