"""Initial guess and certificate: local minima are met, and told from the least one."""

import numpy as np
import pytest

from slamlab.datasets.synthetic import manhattan_graph
from slamlab.slam import PoseGraph
from slamlab.slam._relaxation import Relaxation, certify, isotropic


def ring(n=20, winding=1):
    """A circle whose measurements agree exactly for one turn, started with `winding` turns."""
    a = 2 * np.pi / n
    z = np.tile([2 * np.sin(a / 2) * np.cos(a / 2), 2 * np.sin(a / 2) ** 2, a], (n, 1))
    edges = np.column_stack([np.arange(n), (np.arange(n) + 1) % n])
    heading = winding * a * np.arange(n)
    start = np.column_stack([np.cos(heading), np.sin(heading), heading])
    return PoseGraph(start, edges, z, np.diag([100.0, 100.0, 100.0]))


def town(seed, n=300, m=400, position=0.05, heading=0.15):
    rng = np.random.default_rng(seed)
    return manhattan_graph(n, m, rng, sigma_position=position, sigma_heading=heading).graph


def test_a_ring_with_one_turn_too_many_converges_and_is_not_certified():
    wrong, right = ring(winding=2).optimize(), ring(winding=1).optimize()
    assert wrong.converged
    assert wrong.chi2 > 100
    assert not wrong.certified
    assert wrong.certificate.eigenvalue < -1
    assert wrong.certificate.bound <= 1e-6
    assert right.chi2 < 1e-9
    assert right.certified
    assert right.certificate.eigenvalue > -1e-6


def test_the_guess_turns_once_from_any_start():
    for winding in (0, 1, 2, 5):
        assert ring(winding=winding).initial_guess().chi2() < 1e-9


@pytest.mark.parametrize("seed", range(10))
def test_the_bound_lies_below_every_cost(seed):
    graph = town(seed, 40, 60)
    best = graph.initial_guess().optimize(tolerance=1e-12)
    rng = np.random.default_rng(seed)
    bounds = [best.certificate.bound]
    for size in (0.01, 0.1, 1.0):
        bounds.append(graph.certificate(best.poses + size * rng.normal(size=(40, 3))).bound)
    assert max(bounds) <= best.chi2 * (1 + 1e-9)


@pytest.mark.parametrize("seed", [2, 5, 6])
def test_where_dead_reckoning_ends_in_a_local_minimum_the_guess_is_certified(seed):
    graph = town(seed, 800, 1100, 0.1, 0.1)
    stuck, best = graph.optimize(), graph.initial_guess().optimize()
    assert stuck.converged
    assert stuck.chi2 > 2 * best.chi2
    assert not stuck.certified
    assert best.converged
    assert best.certified
    assert best.certificate.bound == pytest.approx(best.chi2, rel=1e-3)


def test_a_gap_that_cannot_be_closed_is_not_called_certified():
    best = town(7).initial_guess().optimize()
    assert best.converged
    assert not best.certified
    assert 0.97 < best.certificate.bound / best.chi2 < 0.99


def test_the_bound_holds_for_information_that_is_not_isotropic():
    graph = town(3, 60, 100)
    turned = np.array([[300.0, 80, 5], [80, 100, 10], [5, 10, 50]])
    mixed = PoseGraph(graph.poses, graph.edges, graph.measurements, turned)
    tau, kappa = isotropic(mixed.information, below=True)
    below = mixed.information[0] - np.diag([tau[0], tau[0], kappa[0]])
    assert np.linalg.eigvalsh(below)[0] > -1e-9
    tau, kappa = isotropic(mixed.information, below=False)
    above = mixed.information[0] - np.diag([tau[0], tau[0], kappa[0]])
    assert np.linalg.eigvalsh(above)[0] < -10  # the means would promise too much
    best = mixed.optimize()
    assert 0 < best.certificate.bound < best.chi2


def test_the_form_costs_what_the_graph_costs_but_for_the_chord():
    graph = town(4, 60, 100, heading=0.01)
    poses = graph.initial_guess().optimize().poses
    tau, kappa = isotropic(graph.information, below=False)
    form = Relaxation(graph.edges, graph.measurements, tau, kappa, 60, 0)
    x = np.r_[poses[:, 0] + 1j * poses[:, 1], np.exp(1j * poses[:, 2])]
    assert np.real(x.conj() @ form.M @ x) == pytest.approx(graph.chi2(poses), rel=1e-4)


def test_the_least_eigenvalue_is_that_of_the_dense_matrix():
    graph = ring(12, winding=2)
    poses = graph.optimize(tolerance=0, max_iterations=30).poses
    tau, kappa = isotropic(graph.information, below=True)
    form = Relaxation(graph.edges, graph.measurements, tau, kappa, 12, 0)
    M = form.M.toarray()
    A, B, D = M[1:12, 1:12], M[1:12, 12:], M[12:, 12:]
    Q = D - B.conj().T @ np.linalg.solve(A, B)
    u = np.exp(1j * poses[:, 2])
    S = Q - np.diag(np.real(u.conj() * (Q @ u)))
    found = certify(form, poses, graph.chi2(poses), 0.01)
    assert found.eigenvalue == pytest.approx(np.linalg.eigvalsh(S)[0], rel=1e-4)
    assert np.linalg.norm(S @ u) < 1e-6  # stationary: u lies in the null space


def test_real_graphs_are_certified_where_their_information_is_isotropic(tmp_path):
    from slamlab.datasets import killian

    for small in (True, False):
        result = killian(small).graph.optimize()
        assert result.certified
        assert result.certificate.bound == pytest.approx(result.chi2, rel=1e-4)


def test_small_graphs_have_certificates_too():
    alone = PoseGraph([[1, 2, 3.0]], [], np.zeros((0, 3)), np.eye(3))
    assert alone.optimize().certified
    pair = PoseGraph([[0, 0, 0], [5, 5, 2.0]], [[0, 1]], [[1, 0, 0]], np.eye(3))
    assert pair.optimize().certified
    assert not pair.certificate().certified
    assert pair.initial_guess().chi2() < 1e-20


def test_a_guess_of_a_broken_graph_names_what_is_adrift():
    graph = PoseGraph(np.zeros((3, 3)), [[0, 1]], [[1, 0, 0]], np.eye(3))
    for call in (graph.initial_guess, graph.certificate):
        with pytest.raises(ValueError, match="not joined: pose 2"):
            call()


@pytest.mark.parametrize("seed", [1, 3, 4])
def test_levenberg_marquardt_arrives_where_gauss_newton_does(seed):
    graph = town(seed, 800, 1100, 0.1, 0.1)
    for start in (graph, graph.initial_guess()):
        levenberg = start.optimize("levenberg-marquardt")
        assert levenberg.converged
        assert levenberg.certified
        assert levenberg.chi2 == pytest.approx(start.optimize().chi2, rel=1e-5)
        assert levenberg.iterations <= 40
