"""Laps of a corridor round a building."""

import numpy as np
import pytest

from slamlab.geometry import between
from slamlab.simulation import ring_laps
from slamlab.worlds import rooms


def rng(seed=1):
    return np.random.default_rng(seed)


def test_the_robot_keeps_to_the_middle_of_the_corridor_and_comes_round():
    log = ring_laps((12.0, 8.0), rng(), laps=1.0, step=0.1)
    world = rooms.ring_corridor((12.0, 8.0), rng(5))
    assert world.clearance(log.truth[:, :2]).min() > 0.5
    steps = between(log.truth[:-1], log.truth[1:])
    np.testing.assert_allclose(np.hypot(*steps[:, :2].T), 0.1, atol=1e-3)
    assert np.abs(steps[:, 2]).max() < 0.1
    assert np.linalg.norm(between(log.truth[0], log.truth[-1])) < 0.2
    # Inside is a block: it cannot look across.
    assert not world.is_free([6.0, 4.0])


def test_the_scans_are_of_that_corridor_and_the_wheels_drift():
    log = ring_laps((16.0, 11.0), rng())
    world = rooms.ring_corridor((16.0, 11.0), rng(5))
    due = log.scan.scan(world, log.truth, rng(9))
    met = np.isfinite(due) & np.isfinite(log.ranges)
    assert met.mean() > 0.8
    # Twice the noise of 2 cm; a beam along an edge may just miss it.
    assert np.percentile(np.abs(log.ranges[met] - due[met]), 99) < 0.15
    assert np.abs(log.u[1:, 0] - 0.4).max() > 0.01
    other = ring_laps((16.0, 11.0), rng())
    np.testing.assert_array_equal(log.ranges, other.ranges)


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("size: expected sides", lambda: rooms.ring_corridor((5.0, 9.0), rng())),
        ("size: expected shape", lambda: ring_laps((5.0,), rng())),
        ("laps", lambda: ring_laps((12.0, 8.0), rng(), laps=0.0)),
        ("step", lambda: ring_laps((12.0, 8.0), rng(), step=-1.0)),
        ("rng", lambda: ring_laps((12.0, 8.0), 1)),
    ],
)
def test_bad_input_is_named(message, call):
    with pytest.raises(ValueError, match=message):
        call()
