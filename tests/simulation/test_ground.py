"""Laps over rough ground."""

import numpy as np
import pytest

from slamlab.geometry import between
from slamlab.sensors import StereoRig, VisualOdometer
from slamlab.simulation import ground_laps
from slamlab.worlds import Terrain

RIG = StereoRig(50)


def laps(seed=1, **options):
    ground = Terrain.rough(np.random.default_rng(seed), (10.0, 10.0))
    return ground, ground_laps(ground, RIG, np.random.default_rng(seed), radius=3.0, **options)


def test_it_drives_round_the_middle_and_comes_back():
    _, log = laps(step=0.1)
    np.testing.assert_allclose(np.hypot(*(log.truth[:, :2] - 5).T), 3.0)
    steps = between(log.truth[:-1], log.truth[1:])
    np.testing.assert_allclose(steps[:, 0], 0.1, rtol=1e-3)
    assert np.linalg.norm(log.truth[-1] - log.truth[0]) < 0.2
    assert len(log) == int(4 * np.pi * 3 / 0.1) + 1
    assert log.dt[0] == 0


def test_pictures_and_notes_are_what_the_rig_saw():
    quiet = VisualOdometer.simple(0.0, 0.0)
    ground, log = laps(sway=(0, 0, 0), odometer=quiet, step=0.5)
    np.testing.assert_allclose(log.u[1:], between(log.truth[:-1], log.truth[1:]), atol=1e-9)
    np.testing.assert_allclose(log.notes["ground"], ground.height(log.truth[:, :2], relief=True))
    assert not log.notes["sway"].any()
    clean = RIG.scan(ground, log.truth)
    met = np.isfinite(clean)
    assert np.abs(log.ranges[met] - clean[met]).max() < 0.3


def test_sways_are_drawn_as_they_were_asked_for():
    _, log = laps(step=0.05, sway=(0.05, 0.02, 0.01))
    np.testing.assert_allclose(log.notes["sway"].std(0), [0.05, 0.02, 0.01], rtol=0.1)


@pytest.mark.parametrize(
    ("message", "options"),
    [("laps", dict(laps=0)), ("step", dict(step=0.0)), ("sway: expected", dict(sway=[1.0]))],
)
def test_bad_input_is_named(message, options):
    with pytest.raises(ValueError, match=message):
        laps(**options)


def test_the_circle_fits():
    ground = Terrain.rough(np.random.default_rng(1), (5.0, 5.0))
    with pytest.raises(ValueError, match="radius: expected a circle on Terrain"):
        ground_laps(ground, RIG, np.random.default_rng(1), radius=3.0)
