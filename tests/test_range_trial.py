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


def test_a_law_that_never_reaches_the_next_lane_gains_nothing():
    fixed, law, near = (found["error"] for found in RUNS["even"].values())
    assert (near > 0.8 * fixed).all()
    assert (law < 0.4 * fixed).all()


def test_the_camera_used_whole_errs_least_and_sees_three_times_as_many():
    law, whole = (RUNS["clearing"][name] for name in ("law, 5 wanted", "fixed, 40 m"))
    assert (whole["error"] < law["error"]).all()
    assert 3 < np.mean(whole["seen"]) / np.mean(law["seen"]) < 4
