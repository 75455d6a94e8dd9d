"""Robust kernels from a drifted start: graduated widths, warnings, and alternatives."""

import warnings

import numpy as np
import pytest

from slamlab.datasets.synthetic import manhattan_graph
from slamlab.geometry import between
from slamlab.slam import PoseGraph
from slamlab.slam.least_squares import KERNELS


def lied_to(seed=0, n=300, m=400, lies=8):
    """A town from dead reckoning with false closures behind the true ones, and its optimum."""
    rng = np.random.default_rng(seed)
    graph = manhattan_graph(n, m, rng, sigma_position=0.05, sigma_heading=0.02).graph
    pairs = np.array([np.sort(rng.choice(n, 2, replace=False)) for _ in range(lies)])
    pairs[:, 1] += pairs[:, 1] - pairs[:, 0] < 2
    false = np.column_stack([rng.uniform(-1, 1, (lies, 2)), rng.uniform(-3, 3, lies)])
    lied = PoseGraph(
        graph.poses,
        np.vstack([graph.edges, np.minimum(pairs, n - 1)]),
        np.vstack([graph.measurements, false]),
        graph.information[0],
    )
    return lied, graph.chordal_initialisation().optimize()


def test_dcs_at_once_rejects_true_closures_and_says_so():
    lied, best = lied_to()
    with pytest.warns(UserWarning, match=r"rejected \d+ of 109 closures"):
        strict = lied.optimize(kernel="dcs", kernel_width=1.0, max_iterations=200)
    assert strict.n_rejected > 55
    assert f"{strict.n_rejected} of 109 closures rejected" in strict.message
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        patient = lied.optimize(kernel="dcs", kernel_width=(30, 10, 3))
    assert patient.converged
    assert patient.n_rejected == (patient.weights[lied.closures] < 0.1).sum()
    assert (patient.weights[-8:] < 0.1).all()
    assert (patient.weights[:-8] > 0.1).all()
    error = [np.hypot(*between(best.poses, r.poses)[:, :2].T).max() for r in (strict, patient)]
    assert error[1] < 0.3 < 1.0 < error[0]


def test_widths_are_taken_one_after_the_other():
    lied, _ = lied_to(1)
    one = lied.optimize(kernel="dcs", kernel_width=30)
    two = lied.with_poses(one.poses).optimize(kernel="dcs", kernel_width=3)
    both = lied.optimize(kernel="dcs", kernel_width=(30, 3))
    assert np.array_equal(two.poses, both.poses)
    assert np.array_equal(two.history, both.history)
    with pytest.raises(ValueError, match="kernel_width: expected at least one"):
        lied.optimize(kernel="dcs", kernel_width=())


@pytest.mark.parametrize("name", KERNELS)
def test_the_weight_is_the_slope_of_the_cost(name):
    x, width = np.array([0.1, 1.0, 3.9, 4.1, 9.0, 50.0]), 2.0
    rho, weight = KERNELS[name](x, width)
    up, down = KERNELS[name](x + 1e-6, width)[0], KERNELS[name](x - 1e-6, width)[0]
    assert np.allclose(weight, (up - down) / 2e-6, atol=1e-6)
    assert (np.diff(rho) >= 0).all()
    assert rho[0] == x[0]


def test_max_mixture_believes_wholly_or_not_at_all():
    lied, best = lied_to(2)
    result = lied.with_poses(np.r_[best.poses]).optimize(kernel="max-mixture", kernel_width=5)
    assert set(np.round(result.weights, 3)) == {0.0, 1.0}
    assert (result.weights[-8:] < 0.1).all()
    assert np.abs(between(best.poses, result.poses)).max() < 0.05


def two_places():
    """A walk round a square whose last pose saw either the first pose or the third."""
    turn = np.pi / 2
    z = np.tile([1.0, 0.0, turn], (4, 1))
    edges = [[0, 1], [1, 2], [2, 3], [3, 4], [4, 0], [4, 2]]
    measured = np.vstack([z, [[0.05, 0, 0]], [[0.05, 0, 0]]])
    start = np.array([[0, 0, 0], [1, 0, 1], [1, 1, 2], [0, 1, 3], [0, 0, 4]]) * [1, 1, turn]
    return start, edges, measured


@pytest.mark.parametrize("order", [[4, 5], [5, 4]])
def test_of_alternatives_only_the_likeliest_counts(order):
    start, edges, measured = two_places()
    graph = PoseGraph(start, edges, measured, 100 * np.eye(3))
    both, one = graph.optimize(), graph.optimize(hypotheses=[order])
    assert both.chi2 > 20
    assert one.weights.tolist() == [1, 1, 1, 1, 1, 0]
    assert one.history[-1] < 0.2
    alone = PoseGraph(start, edges[:5], measured[:5], 100 * np.eye(3)).optimize()
    assert np.allclose(one.poses, alone.poses, atol=1e-6)


def test_a_vague_alternative_does_not_win_by_its_vagueness():
    start, edges, measured = two_places()
    information = np.tile(100 * np.eye(3), (6, 1, 1))
    information[5] *= 1e-9  # says next to nothing, and so costs next to nothing
    graph = PoseGraph(start, edges, measured, information)
    assert graph.optimize(hypotheses=[[4, 5]]).weights[4] == 1
    x = graph.residuals()
    costs = np.einsum("ka,kab,kb->k", x, information, x)
    assert costs[5] < costs[4]  # without the determinant the vague one would win


@pytest.mark.parametrize("groups", [[[4, 4]], [[4, 5], [5]], [[]]])
def test_alternatives_that_make_no_sense_are_refused(groups):
    start, edges, measured = two_places()
    with pytest.raises(ValueError, match="hypotheses: expected groups"):
        PoseGraph(start, edges, measured, np.eye(3)).optimize(hypotheses=groups)
    with pytest.raises(ValueError, match="hypotheses: expected the row of one of 6 edges"):
        PoseGraph(start, edges, measured, np.eye(3)).optimize(hypotheses=[[6]])
