"""Trials: the criterion can fail, the same code changed in one place, one row of a table."""

import numpy as np
import pytest

from slamlab.evaluation import changed, chi2_band, nees, run, trial
from slamlab.localization import DeadReckoning
from slamlab.robots import YOUBOT
from slamlab.simulation import room_drives


def wheels(log):
    return run(DeadReckoning(YOUBOT, log.truth[0]), log)


@pytest.fixture(scope="module")
def sets():
    return [room_drives(20, np.random.default_rng(seed), n_steps=60) for seed in range(3)]


def scaled(factor):
    def estimate(log):
        one = wheels(log)
        return one.poses, factor * one.covs

    return estimate


def test_the_right_covariance_is_in_its_band_and_one_of_half_the_size_is_not(sets):
    assert trial(scaled(1.0), sets).consistent()
    assert not trial(scaled(0.5), sets).consistent()
    assert not trial(scaled(2.0), sets).consistent()


def test_the_band_is_that_of_all_drives(sets):
    result = trial(wheels, sets)
    assert result.band() == chi2_band(3, 60)
    assert result.n_runs == 20
    assert trial(wheels, sets[0]).band() == chi2_band(3, 20)


def test_it_is_the_mean_nees_and_the_error_of_the_position(sets):
    one = wheels(sets[0])
    result = trial(wheels, sets[:1])
    np.testing.assert_allclose(result.nees[0, 5], nees(one)[5].mean())
    assert np.isnan(result.nees[0, 0])  # at the start the pose is known exactly
    error = ((one.poses - one.truth)[1:, :, :2] ** 2).sum(-1)
    np.testing.assert_allclose(result.rmse[0], np.sqrt(error.mean()))


def test_one_by_one_gives_the_same_as_side_by_side(sets):
    together, single = (trial(wheels, sets[0], one_by_one=each) for each in (False, True))
    np.testing.assert_allclose(single.nees, together.nees)
    np.testing.assert_allclose(single.rmse, together.rmse)


def test_a_full_turn_of_the_heading_is_no_error(sets):
    def turned(log):
        one = wheels(log)
        return one.poses + [0, 0, 2 * np.pi], one.covs

    np.testing.assert_allclose(trial(turned, sets[0]).nees, trial(wheels, sets[0]).nees)


def test_a_row_tells_the_spread_and_of_what_diverges_only_that(sets):
    result = trial(wheels, sets)
    name, cm, each, together, verdict = result.row("wheels")
    assert (name, verdict) == ("wheels", "yes")
    assert cm == f"{100 * result.rmse.min():.1f} to {100 * result.rmse.max():.1f}"
    assert " to " in each
    assert float(together) == pytest.approx(result.mean_nees(), abs=0.05)

    def lost(log):
        one = wheels(log)
        return one.poses + [500.0, 0, 0], one.covs

    assert trial(lost, sets[0]).row("lost")[1:] == ("over 100", "over 1000", "over 1000", "no")


@pytest.mark.parametrize(
    ("estimate", "which", "message"),
    [
        (3, slice(None), "estimate: expected a function"),
        (lambda log: 3, slice(None), "estimate: expected a Run, or a pair"),
        (lambda log: (log.truth[1:], log.truth), slice(None), "estimate: poses"),
        (wheels, slice(0, 0), "sets: expected at least one log"),
    ],
)
def test_what_is_no_trial_is_refused(sets, estimate, which, message):
    with pytest.raises(ValueError, match=message):
        trial(estimate, sets[which])


def test_a_single_drive_is_no_set(sets):
    with pytest.raises(ValueError, match="sets: expected batches of drives with truth"):
        trial(wheels, sets[0].single(0))


# A program of three functions that the tests change.


def half(x):
    return x / 2


def double(x):
    return 2 * x


def both(x, inner=double):
    return half(x) + inner(x)


def test_a_changed_function_is_used_by_the_others_and_the_given_ones_stay():
    assert changed([half, double, both], "x / 2", "x / 4")(8) == 2 + 16
    assert changed([half, double, both], "2 * x", "3 * x")(8) == 4 + 24
    assert both(8) == 4 + 16


@pytest.mark.parametrize(
    ("old", "count", "found"), [("x / 3", 1, 0), ("return", 1, 3), ("x / 2", 2, 1)]
)
def test_a_piece_must_occur_as_often_as_said(old, count, found):
    with pytest.raises(
        ValueError, match=f"occurs {count} time.* in half, double, both, got {found}"
    ):
        changed([half, double, both], old, "", count)


def test_several_pieces_are_replaced_if_that_is_asked_for():
    assert changed([half, double, both], "return", "return 1 +", count=3)(8) == 1 + 5 + 17


@pytest.mark.parametrize(
    ("functions", "old", "new", "message"),
    [
        ([], "a", "b", "functions: expected functions"),
        ([np.sin], "a", "b", "functions: expected functions"),
        ([half], "", "b", "old, new: expected two pieces"),
        ([half], "x / 2", "x / (", "new: expected what leaves Python"),
    ],
)
def test_what_cannot_be_changed_is_refused(functions, old, new, message):
    with pytest.raises(ValueError, match=message):
        changed(functions, old, new)
