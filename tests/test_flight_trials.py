"""The stored trials of flights: what pages 16c and 16d say of them."""

import numpy as np
import pytest

from slamlab.datasets import stored_runs
from slamlab.evaluation import chi2_band

TILTED = stored_runs("tilted_flights")["flights"]
PICTURES = stored_runs("picture_flights")["flights"]["one field each"]
LOW, HIGH = chi2_band(3, 40)


def off(case, which="error"):
    return np.sqrt(np.mean(TILTED[case][which] ** 2))


@pytest.mark.parametrize("case", ["exact", "1°, anew", "1°, kept"])
def test_plane_and_heights_are_the_large_filter_also_where_the_attitude_is_off(case):
    for key in ("error", "nees", "trees"):
        assert TILTED[case][f"large {key}"] == pytest.approx(TILTED[case][key], rel=1e-5)


def test_an_attitude_that_is_kept_wrong_costs_more_than_one_drawn_anew():
    assert off("1°, kept") > 1.3 * off("1°, anew") > 2 * 1.3 * off("exact")


def test_the_covariance_has_to_hold_the_tilt_and_that_a_step_shares_it():
    for case in ("exact", "exact, 1 m along the vertical"):
        assert LOW < TILTED[case]["nees"].mean() < HIGH
    for case in ("1°, anew", "1°, anew, given", "1°, kept", "1°, kept, given"):
        assert min(TILTED[case][key].mean() for key in ("nees", "large nees")) > HIGH
    assert LOW < TILTED["1°, anew, given as shared"]["large nees"].mean() < HIGH
    assert off("1°, anew, given as shared", "large error") < 0.8 * off("1°, anew, given")


def test_the_large_filter_uses_what_ties_plane_and_height():
    given = TILTED["1°, anew, given"]
    assert (given["large error"] < given["error"]).sum() == 28


def test_trees_from_pictures_that_err_together_make_a_filter_overconfident():
    nees = {name: PICTURES[f"{name} nees"].mean() for name in "ABCDE"}
    assert LOW < nees["D"] < HIGH < nees["E"] < nees["C"] < 100 < min(nees["A"], nees["B"])
    assert LOW < PICTURES["ranger nees"].mean() < HIGH


def test_an_exact_matrix_costs_twice_the_error():
    error = {name: np.sqrt(PICTURES[f"{name} squared"].mean()) for name in ("B", "C", "ranger")}
    assert error["B"] > 2 * error["C"]
    assert error["C"] > 1.5 * error["ranger"]


def test_errors_beyond_first_derivatives_are_most_of_what_is_left_of_the_nees():
    nees = {name: PICTURES[f"{name} nees"] for name in ("C", "E", "exact", "linear")}
    less = nees["exact"] - nees["linear"]
    assert less.mean() > 2 * less.std(ddof=1) / np.sqrt(len(less))
    assert (less > 0).sum() == 26
    assert nees["linear"].mean() == pytest.approx(nees["E"].mean(), rel=0.1)
    assert nees["C"].mean() > 2 * nees["linear"].mean()
