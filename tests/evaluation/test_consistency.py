"""NEES, NIS and their band; Monte Carlo runs that do not depend on who computes them."""

import sys

import joblib
import numpy as np
import pytest
from scipy.stats import chi2

from slamlab.evaluation import chi2_band, invariant_nees, monte_carlo, nees, nis


def scalar_filter(rng, believed_r=0.25, q=0.04, r=0.25, steps=30):
    """Random walk tracked by a scalar Kalman filter: final NEES and NIS of one run."""
    truth, mean, var = rng.normal(0, 1), 0.0, 1.0
    for _ in range(steps):
        truth += rng.normal(0, np.sqrt(q))
        var += q
        S = var + believed_r
        v = truth + rng.normal(0, np.sqrt(r)) - mean
        mean, var = mean + var / S * v, var * believed_r / S
    return float(nees([truth - mean], [[var]])), float(nis([v], [[S]]))


def test_a_right_filter_stays_in_the_band_and_an_overconfident_one_leaves_it():
    low, high = chi2_band(1, 200)
    right = np.mean(monte_carlo(scalar_filter, 200, seed=1), axis=0)
    wrong = np.mean(monte_carlo(lambda rng: scalar_filter(rng, 0.05), 200, seed=1), axis=0)
    assert (low < right).all()
    assert (right < high).all()
    assert (wrong > high).all()


def test_the_band_holds_its_share_of_the_means():
    rng = np.random.default_rng(2)
    means = rng.chisquare(3, (20_000, 50)).mean(1)
    for probability in (0.5, 0.95, 0.99):
        low, high = chi2_band(3, 50, probability)
        inside = ((low < means) & (means < high)).mean()
        assert inside == pytest.approx(probability, abs=0.012)


@pytest.mark.parametrize(("dim", "runs", "p"), [(1, 1, 0.99), (3, 50, 0.99), (6, 1000, 0.95)])
def test_the_band_equals_scipys_quantiles(dim, runs, p):
    due = chi2.ppf([(1 - p) / 2, (1 + p) / 2], dim * runs) / runs
    np.testing.assert_allclose(chi2_band(dim, runs, p), due, rtol=1e-12)


def test_the_mean_of_nees_and_nis_is_the_dimension():
    rng = np.random.default_rng(3)
    cov = np.array([[2.0, 0.5, 0], [0.5, 1.0, 0.2], [0, 0.2, 0.3]])
    errors = rng.multivariate_normal(np.zeros(3), cov, 50_000)
    covs = np.broadcast_to(cov, (50_000, 3, 3))
    assert nees(errors, covs).mean() == pytest.approx(3, abs=0.06)
    assert nis(errors, covs).mean() == pytest.approx(3, abs=0.06)
    # Forgetting the correlations is seen.
    assert abs(nees(errors, covs * np.eye(3)).mean() - 3) < 0.06
    assert np.var(nees(errors, covs * np.eye(3))) > 1.05 * np.var(nees(errors, covs))


def test_a_pair_is_subtracted_and_angles_are_wrapped():
    estimates = np.array([[1.0, 2.0, 3.1], [0.0, 0.0, 0.0]])
    truths = np.array([[1.1, 2.0, -3.1], [0.0, 0.3, 0.0]])
    covs = np.tile(np.diag([0.01, 0.01, 0.01]), (2, 1, 1))
    turn = 2 * np.pi - 6.2
    due = [1 + turn**2 / 0.01, 9.0]
    np.testing.assert_allclose(nees((estimates, truths), covs, angles=(2,)), due)
    np.testing.assert_allclose(nees(estimates - truths, covs, angles=(2,)), due)
    assert nees((estimates, truths), covs)[0] > 1000


def test_inputs_are_not_changed():
    errors = np.array([[0.0, 0.0, 6.0]])
    nees(errors, np.eye(3)[None], angles=(2,))
    assert errors[0, 2] == 6.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0, 2.0], np.eye(3)), "covs: expected shape"),
        (([1.0, np.nan], np.eye(2)), "errors: expected finite"),
        (([1.0, 2.0], np.diag([1.0, -1.0])), "positive definite"),
        (([1.0, 2.0], np.eye(2), (2,)), "angles: expected indices below 2"),
        (((np.zeros((3, 2)), np.zeros((2, 2))), np.eye(2)), "one shape"),
        (((np.zeros((3, 2)), np.zeros((3, 3))), np.eye(2)), "truths"),
    ],
)
def test_bad_input_of_nees_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        nees(*arguments)


def test_bad_input_of_nis_and_band_is_named():
    with pytest.raises(ValueError, match="covs"):
        nis([1.0, 2.0], np.eye(3))
    with pytest.raises(ValueError, match="dim"):
        chi2_band(0, 5)
    with pytest.raises(ValueError, match="n_runs"):
        chi2_band(1, 0)
    with pytest.raises(ValueError, match="probability"):
        chi2_band(1, 5, 1.0)


# Monte Carlo


def draw(rng):
    return rng.normal(size=3)


def test_results_do_not_depend_on_the_number_of_jobs_or_the_backend():
    alone = monte_carlo(draw, 8, seed=4)
    for backend in ("threading", "loky"):
        with joblib.parallel_config(backend=backend):
            for other in (monte_carlo(draw, 8, 4, n_jobs=2), monte_carlo(draw, 8, 4, n_jobs=None)):
                np.testing.assert_array_equal(alone, other)


def test_a_dask_cluster_serves_as_the_backend():
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    )
    with cluster, distributed.Client(cluster) as client:
        with joblib.parallel_config(backend="dask"):
            served = monte_carlo(draw, 12, 4, n_jobs=-1)
        done = client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.transition_log)
        assert len(done) > 0, "the cluster did no work"
    np.testing.assert_array_equal(served, monte_carlo(draw, 12, 4))


def test_runs_differ_and_more_runs_keep_the_first_ones():
    few, many = monte_carlo(draw, 5, 6), monte_carlo(draw, 9, 6)
    np.testing.assert_array_equal(few, many[:5])
    assert len(np.unique(np.array(many))) == 27
    assert not np.array_equal(few, monte_carlo(draw, 5, 7))


def test_any_result_is_returned_in_order():
    results = monte_carlo(lambda rng: {"x": rng.random(), "name": "run"}, 4, 1, n_jobs=2)
    assert [r["x"] for r in results] == monte_carlo(lambda rng: rng.random(), 4, 1)


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_progress_is_shown_on_request_only(n_jobs, capsys):
    monte_carlo(draw, 5, 1, n_jobs=n_jobs)
    assert capsys.readouterr().err == ""
    monte_carlo(draw, 5, 1, n_jobs=n_jobs, progress=True)
    assert "5/5" in capsys.readouterr().err


def test_one_job_needs_no_joblib_and_others_say_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "joblib", None)
    monkeypatch.setitem(sys.modules, "tqdm", None)
    assert len(monte_carlo(draw, 3, 1)) == 3
    with pytest.raises(ImportError, match="joblib is needed for runs in parallel.*pip install"):
        monte_carlo(draw, 3, 1, n_jobs=2)
    with pytest.raises(ImportError, match="tqdm is needed for a progress bar"):
        monte_carlo(draw, 3, 1, progress=True)


def test_importing_evaluation_loads_neither_joblib_nor_tqdm():
    import subprocess

    code = """if True:
        import sys
        from slamlab.evaluation import nees
        print(*{"joblib", "tqdm", "dask"} & set(sys.modules))
    """
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == []


def test_an_error_of_a_run_is_passed_on():
    def broken(rng):
        raise RuntimeError("the robot fell over")

    for n_jobs in (1, 2):
        with pytest.raises(RuntimeError, match="fell over"):
            monte_carlo(broken, 3, 1, n_jobs=n_jobs)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((3, 5, 1), "run: expected a function"),
        ((draw, 0, 1), "n_runs"),
        ((draw, 5, -1), "seed"),
        ((draw, 5, 1, 0), "n_jobs"),
        ((draw, 5, 1, 1.5), "n_jobs"),
    ],
)
def test_bad_input_of_monte_carlo_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        monte_carlo(*arguments)


@pytest.mark.parametrize("cov", [np.zeros((3, 3)), -np.eye(3), np.diag([1.0, 1.0, 0.0])])
def test_no_score_comes_of_a_covariance_that_is_not_positive_definite(cov):
    pair = np.array([[0.1, 0.0, 0.0]]), np.zeros((1, 3))
    for score in (nees, invariant_nees):
        with pytest.raises(ValueError, match="expected a positive definite matrix"):
            score(pair, cov[None])
        assert np.isfinite(score(pair, np.eye(3)[None])).all()
