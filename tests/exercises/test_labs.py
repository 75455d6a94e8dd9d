"""The drives of the labs, and what their scores tell apart."""

from functools import cache

import numpy as np
import pytest

from slamlab.exercises.lab_scores import row
from slamlab.exercises.lab_systems import systems
from slamlab.exercises.labs import LABS, as_system_sees_it, practice, tasks

drives = cache(practice)


@pytest.mark.parametrize("lab", LABS)
def test_a_seed_gives_the_same_drives_and_another_seed_others(lab):
    again = tasks(lab, np.random.default_rng((20, 3)))
    first, other = drives(lab, 3), drives(lab, 4)
    for a, b, c in zip(first, again, other, strict=True):
        assert a.setting.name == b.setting.name == c.setting.name
        if a.log is not None:
            assert np.array_equal(a.log.truth, b.log.truth)
            assert not np.array_equal(a.log.truth, c.log.truth)
            assert not np.array_equal(a.log.u[:50], c.log.u[:50])
        if a.world is not None:
            assert np.array_equal(a.world.segments, b.world.segments)


def test_practice_is_never_what_counts():
    scored = tasks("I", np.random.default_rng((21, 0)))
    assert not np.array_equal(scored[0].setting.beacons, practice("I", 0)[0].setting.beacons)
    with pytest.raises(ValueError, match="lab: expected one of 'I'"):
        practice("VI")


def test_the_tunnel_is_dark_and_echoes_are_longer():
    _, tunnel, reflections = drives("I", 3)
    dark = (tunnel.log.times >= 25) & (tunnel.log.times < 37)
    assert all(
        len(z) == 0 for z, d in zip(tunnel.log.landmark_measurements, dark, strict=True) if d
    )
    sensor, off = reflections.setting.sensor, []
    for pose, z, ids in zip(
        reflections.log.truth,
        reflections.log.landmark_measurements,
        reflections.log.ids,
        strict=True,
    ):
        off += list(z[:, 0] - sensor.observe(pose, reflections.setting.beacons[ids])[:, 0])
    echoes = np.array(off) > 0.8
    assert 0.08 < echoes.mean() < 0.18
    assert np.std(np.array(off)[~echoes]) < 0.2


def test_the_crowd_has_no_names_and_clutter():
    hall, loop, crowd = drives("III", 3)
    assert hall.log.ids is not None
    assert loop.log.ids is not None
    assert crowd.log.ids is None
    assert np.hypot(*np.diff(loop.log.truth[:, :2], axis=0).T).sum() > 80
    seen = as_system_sees_it(hall.log)
    assert seen.truth is None
    assert seen.landmarks is None
    assert not seen.notes


def test_a_map_is_judged_by_its_walls_its_floor_and_its_inventions():
    task = drives("II", 3)[0]
    left, bottom, right, top = task.world.bounds
    x, y = np.meshgrid(
        np.arange(left - 0.3, right + 0.3, 0.05), np.arange(bottom - 0.3, top, 0.05)
    )
    points = np.stack([x, y], -1) + 0.025
    near = (task.world.clearance(points) < 0.06) & task.world.is_free(points)
    corner = np.array([left - 0.3, bottom - 0.3])

    def figures(walls):
        return list(row("II", task, "you", lambda: (walls, 0.05, corner)).figures.values())

    perfect = figures(near.astype(float))
    assert perfect[0] > 80
    assert perfect[1] > 99
    assert perfect[2] < 1
    assert figures(np.zeros(x.shape))[:2] == [0.0, 100.0]
    everything = figures(np.ones(x.shape))
    assert everything[0] > 95
    assert everything[1] < 1
    assert everything[2] > 50
    unknown = figures(np.full(x.shape, 0.5))
    assert unknown == [0.0, 0.0, 100.0]


def test_the_library_explores_both_rooms_and_comes_home():
    for task in practice("IV", 1):
        best = row("IV", task, "best", systems("IV", task)["CoveragePilot, HectorSlam"]).figures
        assert best["floor seen %"] > 97
        assert best["from home (m)"] < 0.1
        assert best["hits"] == 0


def test_a_filter_that_is_right_has_an_nees_within_the_band():
    """The band from 1 to 9 around 3 is wide enough for one drive of a right filter."""
    for seed in (3, 4):
        for task in drives("I", seed):
            gated = row("I", task, "gated", systems("I", task)["EKF with a gate"]).figures
            assert 1 <= gated["NEES (3)"] <= 9
