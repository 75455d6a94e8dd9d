"""The stored trial of ranges: what page 16b says of it."""

import numpy as np
import pytest

from slamlab.datasets import stored_runs
from tools.range_trial import FIELDS

RUNS = stored_runs("range_trial")


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
