"""A run in one figure: the same from a run and from plain arrays, refused calls draw nothing."""

import matplotlib as mpl
import numpy as np
import pytest

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection

from slamlab import plots
from slamlab.evaluation import run
from slamlab.localization import DeadReckoning
from slamlab.robots import YOUBOT
from slamlab.simulation import ROOM_SENSOR, room_drives
from slamlab.slam import EKFSlam


@pytest.fixture(scope="module")
def drives():
    return room_drives(2, np.random.default_rng(0), n_steps=50)


@pytest.fixture(scope="module")
def result(drives):
    log = drives.single(0)
    return run(EKFSlam(YOUBOT, ROOM_SENSOR, log.truth[0]), log)


@pytest.fixture(autouse=True)
def closed():
    plt.close("all")
    yield
    plt.close("all")


def axes_of(figure):
    return {axes.get_label(): axes for axes in figure.axes}


def drawn(figure):
    """All points of all lines of the figure."""
    return [np.array(line.get_xydata()) for axes in figure.axes for line in axes.lines]


def test_a_run_and_its_arrays_give_the_same_figure(result):
    figure = plots.show(result, title="A map")
    system = result.system
    other = plots.show(
        result.poses, result.covs, result.log,
        map_mean=system.landmarks, map_cov=system.landmark_covs, title="A map",
    )  # fmt: skip
    for a, b in zip(drawn(figure), drawn(other), strict=True):
        np.testing.assert_array_equal(a, b)
    assert [a.get_title() for a in figure.axes] == [a.get_title() for a in other.axes]
    assert len(axes_of(figure)["map"].patches) == len(system.landmarks)


def test_the_tube_is_two_sigma_and_the_heading_is_in_degrees_and_wrapped(result):
    turned = result.poses + [0, 0, 2 * np.pi]
    figure = plots.show(turned, result.covs, result.log)
    axes = axes_of(figure)["heading"]
    (tube,) = [c for c in axes.collections if isinstance(c, PolyCollection)]
    sigma = np.degrees(np.sqrt(result.covs[:, 2, 2]))
    assert tube.get_paths()[0].vertices[:, 1].max() == pytest.approx(2 * sigma.max())
    error = axes.lines[-1].get_ydata()
    assert np.abs(error).max() < 20


def test_only_some_steps_of_a_run_may_be_recorded(result):
    log = result.log
    one = run(EKFSlam(YOUBOT, ROOM_SENSOR, log.truth[0]), log, every=7)
    figure = plots.show(one)
    assert len(axes_of(figure)["x"].lines[-1].get_xdata()) == len(one.rows)


def test_the_wheels_are_dashed_and_a_system_without_a_map_is_drawn(result):
    log = result.log
    wheels = run(DeadReckoning(YOUBOT, log.truth[0]), log)
    kinds = [
        line.get_linestyle() for line in axes_of(plots.show(result, wheels=wheels))["map"].lines
    ]
    assert "--" in kinds
    assert len(plots.show(wheels).axes) == 4


def test_without_truth_there_is_the_map_only(result):
    log = result.log
    blind = type(log)(log.times, log.u, log.dt, log.control_cov)
    assert list(axes_of(plots.show(result.poses, result.covs, blind))) == ["map"]


def test_what_cannot_be_shown_is_refused_and_leaves_no_figure(result, drives):
    wrong = [
        (dict(result=result, covs=result.covs), "covs, log: expected none beside a run"),
        (dict(result=result.poses), "log: expected"),
        (dict(result=result.poses, log=result.log), "covs: expected"),
        (dict(result=result.poses[1:], covs=result.covs, log=result.log), "result: expected"),
        (dict(result=result, map_mean=[1.0]), "map_mean: expected"),
        (dict(result=run(DeadReckoning(YOUBOT, drives.truth[0]), drives)), "expected"),
    ]
    for arguments, message in wrong:
        with pytest.raises(ValueError, match=message):
            plots.show(**arguments)
    assert plt.get_fignums() == []
