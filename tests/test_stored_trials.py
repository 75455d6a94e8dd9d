"""Stored trials: a sample of each is made again, each has seeds enough, and a change is found."""

import inspect
import json
import os
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamlab.datasets import stored_runs
from tools import grid_table
from tools import trials as tool

TRIALS = {name: tool.load(name) for name in tool.TOOLS}
# By the name of a trial, or the first word of a row.
PLAIN_CODE = {
    "14b turned": pytest.mark.needs_numba(
        reason="a beam through a corner frees another cell by rounding, and paths part by 0.1 mm"
    ),
    "15d clouds": pytest.mark.needs_numba(
        reason="rounding grows within 35 scans to another draw of the particles"
    ),
    "20 ways home": pytest.mark.needs_numba(reason="an expedition takes more than 20 s"),
    "expeditions": pytest.mark.needs_numba(reason="an expedition takes more than 20 s"),
    "grid_logs": pytest.mark.needs_numba(reason="300 scans of 10 particles take more than 25 s"),
    "return_variants": pytest.mark.needs_numba(reason="an expedition takes more than 20 s"),
}
SAMPLE = [
    pytest.param(name, *run, marks=PLAIN_CODE.get(name) or PLAIN_CODE.get(run[0], ()))
    for name, trial in TRIALS.items()
    for run in trial.sample
]
HAS_DATA = "SLAMLAB_DATA" in os.environ
SEEDS = 20
ALL = Namespace(again=True, missing=False, runs=None, row=[])


@pytest.mark.parametrize(("name", "first", "second", "seed"), SAMPLE)
@pytest.mark.slow
def test_a_sample_of_each_trial_can_be_had_again(name, first, second, seed):
    if first in TRIALS[name].needs_data and not HAS_DATA:
        pytest.skip("SLAMLAB_DATA is not set")
    assert TRIALS[name].differences(first, second, seed) == []


@pytest.mark.skipif(not HAS_DATA, reason="SLAMLAB_DATA is not set")
def test_five_scans_of_csail_are_turned_off_the_reference_as_page_15c_says():
    off = grid_table.turned(grid_table.read("csail"), [42, 364, 397, 398, 399])
    assert off.round().tolist() == [11, 20, 11, 12, 11]


@pytest.mark.parametrize("name", TRIALS)
def test_every_trial_has_a_sample_and_it_is_stored(name):
    assert TRIALS[name].sample
    for run in TRIALS[name].sample:
        assert TRIALS[name].stored(*run) is not None, run


@pytest.mark.parametrize("name", TRIALS)
def test_every_row_is_stored_with_its_seeds_and_no_other(name):
    trial = TRIALS[name]
    stored = trial.read()
    assert {(first, second) for first, rows in stored.items() for second in rows} == set(
        trial.rows
    )
    for (first, second), seeds in trial.rows.items():
        n = len(stored[first][second])
        assert n == len(seeds), (name, first, second, n)


@pytest.mark.parametrize("name", TRIALS)
def test_what_is_drawn_by_lot_has_twenty_seeds(name):
    """One run is enough where nothing is drawn: filters on real logs, and drives of the league."""
    one_is_enough = {"killian_walls", "league", "park_fitted", "park_start", "victoria_park"}
    picked = {"return_variants": "first metres to their end"}  # of thirty stored drives
    least = {1, SEEDS} if name in one_is_enough else {SEEDS}
    for row, seeds in TRIALS[name].rows.items():
        if row[0] == picked.get(name):
            continue
        assert len(seeds) in least or len(seeds) > SEEDS, (name, row)
        assert len(set(seeds)) == len(seeds)


def test_no_two_seeds_of_a_row_gave_the_same_numbers():
    all_drawn = {"expeditions", "range_trial", "short_range"}
    for name, trial in TRIALS.items():
        for first, rows in trial.read().items():
            for second, runs in rows.items():
                texts = {json.dumps(run) for run in runs}
                if name in all_drawn or second.startswith("FastSLAM"):
                    assert len(texts) == len(runs), (name, first, second)


def test_of_a_page_a_trial_has_functions_and_constants_and_runs_nothing_else():
    page = tool.of_page("13b_pose_graphs", "motion")
    assert {"town_from_the_linear_start", "motion"} <= set(page)
    assert not {"park", "large", "towns"} & set(page)
    function = page["town_from_the_linear_start"]
    assert inspect.getsource(function).startswith("def town_from_the_linear_start(")


def toy(tmp_path, monkeypatch, factor=1.0, **options):
    monkeypatch.setattr(tool, "DATA", tmp_path)

    def one(first, second, seed):
        rng = np.random.default_rng(seed)
        return {"error": factor * round(rng.random(), 3), "ms": rng.random(), "none": None}

    rows = {("a", "x"): range(3), ("a", "y"): range(1, 3)}
    return tool.Trial("toy", rows, one, (("a", "x", 1),), machine=("ms",), **options)


def test_missing_runs_are_made_and_stored_in_their_places(tmp_path, monkeypatch, capsys):
    done = []
    trial = toy(tmp_path, monkeypatch, finish=lambda: done.append(1))
    assert tool.work(trial, replace_in(ALL, again=False), np.inf) == []
    first = trial.path.read_text()
    assert [len(runs) for runs in trial.read()["a"].values()] == [3, 2]
    assert trial.stored("a", "y", 2)["error"] == round(np.random.default_rng(2).random(), 3)
    assert "toy a x 0" in capsys.readouterr().out
    tool.work(trial, replace_in(ALL, again=False, missing=True), np.inf)
    assert capsys.readouterr().out == ""
    assert trial.path.read_text() == first
    assert done == [1]


def replace_in(options, **changes):
    return Namespace(**(vars(options) | changes))


def test_a_run_that_differs_is_named_and_nothing_is_written(tmp_path, monkeypatch):
    tool.work(toy(tmp_path, monkeypatch), replace_in(ALL, again=False), np.inf)
    before = Path(tmp_path, "toy.json").read_text()
    for factor, n in ((1.0, 0), (1.01, 0), (1.05, 1)):
        other = toy(tmp_path, monkeypatch, factor)
        found = tool.work(other, ALL, np.inf)
        assert len(found) == n
        assert len(tool.work(other, replace_in(ALL, runs=5), np.inf)) == 5 * n
    assert found[0].startswith("a, x, seed 1: error ")
    assert Path(tmp_path, "toy.json").read_text() == before


@pytest.mark.parametrize(("factor", "code"), [(1.0, 0), (1.05, 1)])
def test_the_command_exits_with_one_if_a_run_differs(tmp_path, monkeypatch, factor, code):
    tool.work(toy(tmp_path, monkeypatch), replace_in(ALL, again=False), np.inf)
    monkeypatch.setattr("sys.argv", ["toy", "--again"])
    assert tool.main(toy(tmp_path, monkeypatch, factor)) == code


def test_a_run_that_is_not_stored_differs(tmp_path, monkeypatch):
    trial = toy(tmp_path, monkeypatch)
    assert trial.differences("a", "x", 1) == ["a, x, seed 1: nothing is stored"]


def test_numbers_are_compared_within_their_tolerances():
    trial = replace(TRIALS["range_trial"], rel=0.02, off=0.01)
    for old, new, same in (
        (1.0, 1.029, True),
        (1.0, 1.04, False),
        ([0.0, 1.0], [0.009, 1.0], True),
        ([0.0, 1.0], [0.0, 1.0, 1.0], False),
        (None, None, True),
        (None, 0.0, False),
        (float("nan"), float("nan"), True),
        (float("nan"), 1.0, False),
    ):
        assert trial.equal(old, new) is same, (old, new)


def test_logs_that_are_not_there_are_left_out_and_said(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("SLAMLAB_DATA", raising=False)
    trial = toy(tmp_path, monkeypatch, needs_data=("a",))
    assert tool.work(trial, ALL, np.inf) == []
    assert capsys.readouterr().out == "toy: left out, as SLAMLAB_DATA is not set: a\n"


def test_runs_by_lot_are_for_comparing(monkeypatch, capsys):
    for words in (["--runs", "3"], ["--again", "--runs", "0"]):
        monkeypatch.setattr("sys.argv", ["trials", *words])
        with pytest.raises(SystemExit):
            tool.main()
        assert "expected --runs with --again" in capsys.readouterr().err


def test_a_trial_that_there_is_not_is_refused(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["trials", "leauge"])
    with pytest.raises(SystemExit):
        tool.main()
    assert f"expected names of {', '.join(tool.TOOLS)}, got" in capsys.readouterr().err
    with pytest.raises(ValueError, match="trial: expected one of ambiguous_closures"):
        stored_runs("leauge")
