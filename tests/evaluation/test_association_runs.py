"""The loop of chapter 11: what is counted, and that a perfect association scores one."""

import numpy as np
import pytest

from slamlab.evaluation.association_runs import run_loop, simulate_loop
from slamlab.geometry import wrap_angle
from slamlab.slam.association import IGNORED, NEW, nearest_neighbour


def oracle(loop, told):
    """An association that is told the truth; the filter's names are the true rows so far."""
    looks = iter(loop.looks[told:])
    origin = {}

    def associate(slam, z):
        _, truth = next(looks)
        for name in slam.ids:
            origin.setdefault(name, int(name))
        rows = []
        for t in truth:
            names = [slam.ids.index(name) for name in slam.ids if origin[name] == t and t >= 0]
            rows.append(names[0] if names else IGNORED)
        return np.array(rows)

    return associate


def test_the_truth_scores_one_and_comes_home():
    loop = simulate_loop(np.random.default_rng(1), clutter_rate=2.0)
    run = run_loop(loop, oracle(loop, 50))
    assert (run.precision, run.recall) == (1.0, 1.0)
    assert run.named == run.right == run.possible > 50
    assert run.error < 0.3


def test_naming_everything_wrong_scores_nothing():
    loop = simulate_loop(np.random.default_rng(1), clutter_rate=0.0)
    truth = oracle(loop, 50)

    def shifted(slam, z):
        rows = truth(slam, z)
        return np.where(rows >= 0, (rows + 1) % slam.n_landmarks, rows)

    run = run_loop(loop, shifted)
    assert run.right == 0
    assert run.precision == run.recall == 0.0
    silent = run_loop(loop, lambda slam, z: np.full(len(z), IGNORED))
    assert (silent.precision, silent.recall, silent.named) == (1.0, 0.0, 0)


def test_clutter_that_starts_landmarks_is_counted_as_clutter():
    loop = simulate_loop(np.random.default_rng(2), clutter_rate=3.0)
    run = run_loop(loop, lambda slam, z: np.full(len(z), NEW))
    assert (run.origins == -1).sum() > 20
    assert len(run.landmarks) == len(run.landmark_covs) == len(run.origins)
    assert run.poses.shape == (len(loop.poses), 3)
    assert run.covs.shape == (len(loop.poses), 3, 3)


def test_the_drive_sees_nothing_on_its_way_and_drifts_as_its_odometry_says():
    loop = simulate_loop(np.random.default_rng(3), clutter_rate=1.0)
    seen = np.array([len(z) for z, _ in loop.looks])
    assert (seen[10:97] == 0).all()
    assert (seen[:10] > 0).all()
    run = run_loop(loop, nearest_neighbour)
    before = np.sqrt(np.trace(run.covs[97, :2, :2]))
    assert 0.3 < before < 1.2
    error = run.poses[97] - loop.poses[97]
    error[2] = wrap_angle(error[2])
    assert error @ np.linalg.solve(run.covs[97], error) < 16
    still = simulate_loop(np.random.default_rng(3), drift=0.0, clutter_rate=0.0)
    np.testing.assert_allclose(still.poses[100], still.poses[0], atol=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: simulate_loop(3), "rng"),
        (lambda r: simulate_loop(r, drift=-1), "drift"),
        (lambda r: simulate_loop(r, n_landmarks=0), "n_landmarks"),
        (lambda r: simulate_loop(r, laps=-1), "laps"),
        (lambda r: simulate_loop(r, p_detect=2), "p_detect"),
        (lambda r: run_loop(simulate_loop(r, laps=0.1), nearest_neighbour, -1), "known_until"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(np.random.default_rng(1))
