"""Grid FastSLAM: three storages with the same maps, memory, matching, the laser's own model."""

import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from slamlab.datasets import read_carmen
from slamlab.evaluation import ate, run
from slamlab.geometry import between, compose, inverse, wrap_angle
from slamlab.kernels.grid_fast import draw, penetrate, refine, stop_rate, touched
from slamlab.logs import Log
from slamlab.sensors import Lidar
from slamlab.simulation import drifted
from slamlab.slam import GridFastSlam
from slamlab.slam._grid_maps import EMPTY, TILE, AncestryTree, TileMaps
from slamlab.worlds import rooms
from tools.grid_table import drive, read, turned, without

DATA = os.environ.get("SLAMLAB_DATA")
needs_data = pytest.mark.skipif(DATA is None, reason="SLAMLAB_DATA is not set")
LIDAR = Lidar(90, max_range=8.0, sigma_range=0.01)
START = np.array([2.0, 4.0, 0.0])
NOISE = np.array([0.05, 0.02, 0.06])
V = np.diag(NOISE) ** 2


@cache
def office(steps=25):
    """A short drive down the office: ranges, and odometry that drifts."""
    turns = np.r_[0.0, np.where(np.arange(3, steps + 2) % 12 < 6, 0.15, -0.15)]
    poses = np.zeros((steps, 3))
    poses[0] = START
    for k in range(1, steps):
        poses[k] = compose(poses[k - 1], [0.15, 0.0, turns[k]])
    rng = np.random.default_rng(1)
    u = np.zeros((steps, 3))
    u[1:] = between(poses[:-1], poses[1:]) + rng.normal(0, NOISE, (steps - 1, 3))
    ranges = LIDAR.scan(rooms.office(), poses, rng)
    dt = np.r_[0.0, np.full(steps - 1, 0.5)]
    return Log(np.cumsum(dt), u, dt, V, ranges=ranges, scan=LIDAR, truth=poses)


def slam(storage="tiles", n_particles=6, seed=2, pose=START, **options):
    rng = np.random.default_rng(seed)
    return GridFastSlam(LIDAR, pose, n_particles, rng=rng, storage=storage, **options)


# Where maps are kept.


@pytest.mark.parametrize("model", ["matching", "penetration"])
def test_the_three_storages_hold_the_same_maps_cell_for_cell(model):
    systems = [
        slam(storage, model=model, threshold=1.0) for storage in ("tiles", "tree", "copies")
    ]
    resampled = 0
    for step in office(12):
        for one in systems:
            if step.dt > 0:
                one.predict(step.u, step.dt, step.control_cov)
            one.update(step.ranges)
        resampled += systems[0].resampled
        for i in range(6):
            cells, corner = systems[0].map(i)
            for other in systems[1:]:
                theirs, their_corner = other.map(i)
                np.testing.assert_array_equal(theirs, cells)
                np.testing.assert_array_equal(their_corner, corner)
        np.testing.assert_array_equal(systems[0].poses, systems[1].poses)
    assert resampled > 5
    tiles, tree, copies = (one.map_bytes for one in systems)
    assert tree < tiles < copies
    maps = systems[1]._maps
    assert len(maps.nodes) <= 2 * 6 - 1
    assert max(len(maps.line(i)) for i in range(6)) <= 6


def random_writes(maps, rounds=25, n=5, seed=4):
    """Write to random cells, resample, grow; return plain copies {particle: {(x, y): value}}."""
    rng = np.random.default_rng(seed)
    plain = [{} for _ in range(n)]
    for k in range(rounds):
        x, y = rng.integers(-20 - 2 * k, 20 + 2 * k, (2, n, 3))
        maps.make_room(np.stack([x.ravel() + 0.5, y.ravel() + 0.5], -1))
        first = maps.low * TILE
        tile = (y - first[1]) // TILE * maps.columns + (x - first[0]) // TILE
        marked = np.zeros((n, int(maps.size.prod())), bool)
        marked[np.arange(n)[:, None], tile] = True
        pages, table = maps.write(marked)
        for i in range(n):
            for j in range(3):
                cell = (y[i, j] - first[1]) % TILE, (x[i, j] - first[0]) % TILE
                pages[table[i, tile[i, j]], cell[0], cell[1], 0] += 1
                key = int(x[i, j]), int(y[i, j])
                plain[i][key] = plain[i].get(key, 0) + 1
        maps.written()
        if rng.random() < 0.6:
            chosen = np.sort(rng.integers(0, n, n))
            maps.resample(chosen)
            plain = [dict(plain[i]) for i in chosen]
    return plain


@pytest.mark.parametrize("kind", ["tiles", "copies", "tree"])
def test_a_storage_equals_dictionaries_that_are_copied(kind):
    origin = np.zeros(2)
    maps = (
        AncestryTree(5, 1.0, origin)
        if kind == "tree"
        else TileMaps(5, 1.0, origin, kind == "tiles")
    )
    for i, due in enumerate(random_writes(maps)):
        cells = maps.dense(i)[..., 0]
        row, column = np.nonzero(cells)
        first = maps.low * TILE
        found = {
            (int(c + first[0]), int(r + first[1])): int(cells[r, c])
            for r, c in zip(row, column, strict=True)
        }
        assert found == due


def test_copies_that_share_a_map_and_write_into_it_are_noticed(monkeypatch):
    # A peer's mistake: the copy of a particle keeps pointing at the tiles of its parent.
    monkeypatch.setattr(
        "slamlab.filters.pages.SharedPages._allocate",
        lambda self, count: np.zeros(count, dtype=np.intp),
    )
    with pytest.raises(AssertionError):
        test_a_storage_equals_dictionaries_that_are_copied("tiles")


# What is drawn.


def drawn(starts, ends):
    maps = TileMaps(1, 0.1, np.zeros(2))
    starts, ends = np.array([starts], float), np.array([ends], float)
    maps.make_room(np.concatenate([starts, ends[0]]))
    marked = np.zeros((1, int(maps.size.prod())), bool)
    touched(maps.columns, maps.frame, starts, ends, marked)
    draw(*maps.write(marked), maps.columns, maps.frame, marked, starts, ends)
    return maps


def test_every_metre_of_a_beam_is_in_some_cell_and_its_end_in_one():
    ends = np.random.default_rng(3).uniform(-5, 5, (40, 2))
    maps = drawn([0.03, 0.04], ends)
    cells = maps.dense(0)
    due = np.hypot(*(ends - [0.03, 0.04]).T)
    assert cells[..., 1].sum() == pytest.approx(due.sum(), rel=1e-4)
    assert cells[..., 0].sum() == 40
    np.testing.assert_allclose(cells[..., 2:].sum((0, 1)), ends.sum(0), atol=1e-3)
    # No cell holds more of one beam than its diagonal.
    one = drawn([0.03, 0.04], ends[:1]).dense(0)
    assert one[..., 1].max() <= 0.1 * np.sqrt(2) + 1e-6
    column, row = np.floor((ends[0] - maps.frame[1:]) / 0.1).astype(int)
    assert cells[row, column, 0] >= 1
    assert (maps.shared.pages[0] == EMPTY).all()


# Matching and weighing.


def one_scan_and_its_map():
    """Where `refine` reads the map that one scan made, and the points of that scan."""
    ranges = LIDAR.scan(rooms.office(), START, np.random.default_rng(6))
    points = LIDAR.points(ranges)
    one = slam(n_particles=1)
    one.update(ranges)
    where = (*one._maps.read(), one._maps.columns, one._maps.frame)
    return where, np.ascontiguousarray(points[np.isfinite(points[:, 0])])


def test_a_scan_is_laid_back_upon_its_own_map():
    where, points = one_scan_and_its_map()
    for off in ([0.1, -0.08, 0.04], [-0.06, 0.1, -0.03]):
        poses, score = (START + off)[None], np.zeros(1)
        refine(*where, points, poses, 0.1, 0.0, score)
        np.testing.assert_allclose(poses[0], START, atol=2e-3)
        assert -0.5 < score[0] <= 0


@pytest.mark.parametrize("turn", [20.0, -13.0])
def test_a_lost_match_is_tried_from_other_headings(turn):
    where, points = one_scan_and_its_map()
    off, score = {}, {}
    for lost in (0.0, 0.6):
        poses, score[lost] = START[None] + [0.0, 0.0, np.deg2rad(turn)], np.zeros(1)
        refine(*where, points, poses, 0.1, lost, score[lost])
        off[lost] = abs(np.rad2deg(poses[0, 2]))
    assert off[0.6] < 0.1
    assert score[0.6] > -0.5
    # Wrong: one climb from where the wheels say stays in the next best place.
    assert off[0.0] > 5
    assert score[0.0] < -50


def test_wheels_that_err_by_twenty_degrees_once_are_put_right():
    log = office(12)
    u = log.u.copy()
    u[9, 2] -= np.deg2rad(20)  # the filter is told 3.4 degrees
    worst = {}
    for lost in (0.0, 0.6):
        result = run(slam(n_particles=10, lost=lost), replace(log, u=u))
        worst[lost] = np.rad2deg(abs(wrap_angle(result.poses[:, 2] - log.truth[:, 2])).max())
    assert worst[0.6] < 2
    # Wrong: one climb only.
    assert worst[0.0] > 5


def test_a_match_that_fits_is_not_searched_for():
    log = office()
    never, seldom, always = (run(slam(lost=lost), log).poses for lost in (0.0, 0.3, 1.0))
    np.testing.assert_array_equal(seldom, never)
    assert np.abs(always - never).max() > 0.01


def by_hand(ranges, rates, side, variance):
    """DP-SLAM's P for one beam along a row of cells, term by term."""
    reached, total = 1.0, 0.0
    for cell, rate in enumerate(rates):
        stop = 1 - np.exp(-rate * side)
        total += reached * stop * np.exp(-0.5 * (ranges - (cell + 0.5) * side) ** 2 / variance)
        reached *= 1 - stop
    return total


def test_a_beam_may_stop_in_every_cell_it_passes():
    maps = TileMaps(1, 0.1, np.zeros(2))
    maps.make_room(np.array([[0.0, 0.0], [2.0, 0.2]]))
    marked = np.ones((1, int(maps.size.prod())), bool)
    pages, table = maps.write(marked)
    rng = np.random.default_rng(5)
    hits, metres = rng.integers(0, 4, 60), rng.uniform(0.1, 2, 60)
    column, row = np.floor((np.array([0.0, 0.05]) - maps.frame[1:]) / 0.1 + 1e-9).astype(int)
    for k in range(30):
        c = column + k
        tile = (row // TILE) * maps.columns + c // TILE
        if tile < table.shape[1] and c < maps.columns * TILE:
            pages[table[0, tile], row % TILE, c % TILE, :2] = hits[k], metres[k]
    starts, ends, score = np.array([[1e-9, 0.05]]), np.array([[[0.73, 0.05]]]), np.zeros(1)
    penetrate(pages, table, maps.columns, maps.frame, starts, ends, np.sqrt(0.017), score)
    cells = [np.array([h, m, 0, 0]) for h, m in zip(hits, metres, strict=True)]
    rates = [stop_rate(cell, 0.4) for cell in cells]
    n = int(np.ceil((0.73 + 4 * np.sqrt(0.017)) / 0.1))
    due = np.log(by_hand(0.73, rates[:n], 0.1, 0.017) + 1e-3)
    assert score[0] == pytest.approx(due, abs=1e-3)
    # Wrong: the cell of the end point alone, as if nothing stood before it.
    alone = np.log((1 - np.exp(-rates[7] * 0.1)) * np.exp(-0.5 * 0.02**2 / 0.017) + 1e-3)
    assert abs(alone - due) > 0.05
    assert stop_rate(np.zeros(4), 0.4) == 1 / 8.0


# Runs.


def test_it_holds_where_the_wheels_drift_away():
    log = office()
    result = run(slam(n_particles=10), log)
    dead = [START]
    for u in log.u[1:]:
        dead.append(compose(dead[-1], u))
    assert ate(result).rmse < 0.03
    assert ate(np.array(dead), log.truth).rmse > 0.06


@pytest.mark.needs_numba(reason="two drives of 150 particles take more than 20 s")
def test_many_blind_particles_weighed_by_penetration_do_better_than_the_wheels():
    log = office()
    good = run(slam(n_particles=150, model="penetration", temper=0.2, sigma=0.13), log)
    blind = run(slam(n_particles=150, model="penetration", temper=1e-9), log)
    assert ate(good).rmse < 0.7 * ate(blind).rmse


def test_moving_the_start_moves_everything_with_it():
    frame = np.array([5.0, -3.0, np.pi / 2])
    log = office(10)
    here, there = run(slam(), log), run(slam(pose=compose(frame, START)), log)
    moved = compose(inverse(frame), there.poses)
    np.testing.assert_allclose(moved, here.poses, atol=0.02)


def test_same_seed_same_run_and_copies_are_given_away():
    log = office(8)
    one, other = run(slam(), log), run(slam(), log)
    np.testing.assert_array_equal(one.poses, other.poses)
    system, before = one.system, one.system.poses
    for name in ("poses", "weights", "pose", "pose_cov", "ancestors"):
        getattr(system, name)[:] = 7
    system.map(0)[0][:] = 7
    np.testing.assert_array_equal(system.poses, before)
    np.testing.assert_array_equal(system.map(0)[0], other.system.map(0)[0])
    assert repr(system).startswith("GridFastSlam(6 particles, ")
    assert "\n" not in repr(system)


def test_a_scan_that_says_nothing_changes_nothing():
    one = slam()
    one.update(office(2).ranges[0])
    before, cells = one.poses, one.map(0)[0]
    assert one.update(np.full(90, np.nan)) == 0.0
    np.testing.assert_array_equal(one.poses, before)
    np.testing.assert_array_equal(one.map(0)[0], cells)


@pytest.mark.parametrize(
    ("message", "options"),
    [
        ("storage: expected one of", dict(storage="heap")),
        ("model: expected one of", dict(model="magic")),
        ("n_particles", dict(n_particles=0)),
        ("pose: expected shape", dict(pose=[0, 0])),
        ("sigma", dict(sigma=0.0)),
        ("temper", dict(temper=0.0)),
        ("threshold", dict(threshold=2.0)),
        ("lost: expected", dict(lost=1.5)),
        ("resolution", dict(resolution=0.0)),
    ],
)
def test_bad_construction_is_named(message, options):
    with pytest.raises(ValueError, match=message):
        slam(**options)


def test_bad_input_is_named_and_harmless():
    one = slam()
    one.update(office(2).ranges[0])
    before = one.poses
    for ranges, message in ((np.ones(7), "ranges: expected shape"), (-np.ones(90), "ranges")):
        with pytest.raises(ValueError, match=message):
            one.update(ranges)
    with pytest.raises(ValueError, match="u: expected"):
        one.predict([np.nan, 0, 0], 0.5, V)
    with pytest.raises(ValueError, match="particle: expected at most 5, got 6"):
        one.map(6)
    np.testing.assert_array_equal(one.poses, before)


@needs_data
@pytest.mark.slow
@pytest.mark.needs_numba(reason="292 scans of 30 particles at 0.27 s take more than a minute")
def test_freiburg_with_drifting_wheels():
    log = read_carmen(Path(DATA) / "freiburg-101-corrected.log.gz", corrected=True)
    poor = drifted(log, np.random.default_rng(1))
    system = GridFastSlam(poor.scan, poor.truth[0], 30, rng=np.random.default_rng(11))
    # As in the table that chapter 15 stores (tools/grid_table.py, seed 1).
    assert ate(run(system, poor)).rmse == pytest.approx(0.050, abs=0.002)
    table = system._maps.shared.table
    copies = np.count_nonzero(table) * EMPTY.nbytes
    assert system.map_bytes <= copies / 3


@needs_data
@pytest.mark.slow
@pytest.mark.needs_numba(reason="490 scans of 30 particles at 0.27 s take two minutes")
def test_five_scans_of_csail_are_turned_off_their_reference():
    log, five = read("csail"), [42, 364, 397, 398, 399]
    off = np.abs(turned(log, [*five, 41, 43, 200, 363, 365, 396, 400]))
    np.testing.assert_allclose(off[:5], [11, 20, 11, 12, 11], atol=1.1)
    assert off[5:].max() < 2.5
    # Scan 42 alone against what came after it says the same: the reference is off, not the past.
    after = log[42:57]
    assert turned(after, [0], around=12.0)[0] > 10
    # There the made odometry lies: one particle takes nearly all the weight.
    for seed in (1, 9):
        assert drive(log[:43], seed, 30, 0.3, 0.0)[1].ess < 1.5
    # As stored in chapter 15: power 1, without the five scans, drive 2.
    result, *_ = drive(without(log, five), 2, 30, 1.0, 0.0)
    assert ate(result).rmse == pytest.approx(0.081, abs=0.002)


def test_before_the_first_scan_the_map_is_empty():
    cells, origin = GridFastSlam(Lidar(24, max_range=5.0), rng=np.random.default_rng(1)).map()
    assert cells.shape == (0, 0, 4)
    assert origin.shape == (2,)
