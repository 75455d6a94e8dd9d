"""The stored trials of ranges: what page 16b says of them."""

import numpy as np
import pytest

from slamlab.datasets import stored_runs
from slamlab.evaluation import chi2_band
from tools.range_trial import FIELDS

RUNS, SHORT = stored_runs("range_trial"), stored_runs("short_range")


@pytest.mark.parametrize("field", sorted(FIELDS))
def test_the_law_errs_less_than_a_fixed_range_in_every_field(field):
    fixed, law = (RUNS[field][name] for name in list(RUNS[field])[:2])
    assert (law["error"] <= 0.8 * fixed["error"]).all()
    assert law["seen"].mean() == pytest.approx(fixed["seen"].mean(), rel=0.1)


def test_the_trees_of_other_lanes_are_most_of_the_gain_as_they_are_known_again():
    fixed, law, near, own_lane, new_names = (found["error"] for found in RUNS["even"].values())
    assert (near > 0.8 * fixed).all()
    assert (law < 0.4 * fixed).all()
    for changed in (own_lane, new_names):
        assert 0.2 < (fixed - changed).mean() / (fixed - law).mean() < 0.5
        assert (law < changed).all()


def test_the_law_that_sees_its_own_lane_alone_sees_as_many_trees():
    fixed, law, _, own_lane, new_names = (found["seen"] for found in RUNS["even"].values())
    assert own_lane.mean() == pytest.approx(law.mean(), rel=0.05)
    assert (new_names == law).all()
    assert own_lane.mean() > fixed.mean()


def test_the_camera_used_whole_errs_least_and_sees_three_times_as_many():
    law, whole = (RUNS["clearing"][name] for name in ("law, 5 wanted", "fixed, 40 m"))
    assert (whole["error"] < law["error"]).all()
    assert 3 < np.mean(whole["seen"]) / np.mean(law["seen"]) < 4


@pytest.mark.parametrize("name", ["8 m", "12 m"])
def test_with_a_short_range_the_invariant_covariance_fits_and_the_standard_does_not(name):
    low, high = chi2_band(3, 50)
    fits = {
        kind: int(((low <= rows[name]["nees"]) & (rows[name]["nees"] <= high)).sum())
        for kind, rows in SHORT.items()
    }
    assert fits["invariant"] >= 17
    assert fits["standard"] <= 1
    assert (SHORT["invariant"][name]["error"] > 0.7 * SHORT["standard"][name]["error"]).all()


@pytest.mark.parametrize("kind", ["standard", "invariant"])
def test_with_as_few_trees_a_long_range_errs_less_and_trees_of_other_lanes_are_part_of_it(kind):
    near, few, own = (
        SHORT[kind][name] for name in ("8 m", "20 m, 15 trees", "20 m, 15 trees, own lane")
    )
    assert few["seen"].mean() == pytest.approx(near["seen"].mean(), rel=0.15)
    assert few["error"].mean() < 0.5 * near["error"].mean()
    assert few["error"].mean() < 0.7 * own["error"].mean()
    assert own["error"].mean() < 0.8 * near["error"].mean()
