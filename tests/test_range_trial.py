"""The stored trial of ranges: a sample made again, and what page 16b says of it."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from slamlab.datasets import range_trial_runs

ROOT = Path(__file__).resolve().parents[1]
SPEC = importlib.util.spec_from_file_location("range_trial", ROOT / "tools" / "range_trial.py")
trial = importlib.util.module_from_spec(SPEC)
sys.modules["range_trial"] = trial
SPEC.loader.exec_module(trial)
RUNS = range_trial_runs()


@pytest.mark.parametrize("name", ["fixed, 20 m", "law, 5 wanted"])
@pytest.mark.parametrize("seed", [3, 17])
def test_a_stored_field_can_be_had_again(name, seed):
    row = trial.one("clearing", name, seed)
    for key, value in row.items():
        stored = RUNS["clearing"][name][key][trial.SEEDS.index(seed)]
        assert value == pytest.approx(stored, rel=0.02), key


def test_every_range_is_stored_with_every_seed_and_no_other():
    assert {field: set(ranges) for field, ranges in RUNS.items()} == {
        field: set(ranges) for field, (_, ranges) in trial.FIELDS.items()
    }
    for ranges in RUNS.values():
        for found in ranges.values():
            assert all(len(values) == len(trial.SEEDS) for values in found.values())


@pytest.mark.parametrize("field", sorted(trial.FIELDS))
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
