"""Several drives in one map: joined by confirmed closures from anywhere, and by nothing else."""

import copy
from functools import cache

import numpy as np
import pytest

from slamlab.evaluation import ate, run
from slamlab.geometry import between, compose, wrap_angle
from slamlab.logs import Log
from slamlab.sensors import Lidar
from slamlab.slam import ScanGraphSlam, Sessions
from tests.slam.ring import LIDAR, building, drive


@cache
def mapped(*which, **more):
    """The log of a drive, and what it left, in a frame of its own."""
    log = drive(*which, **more)
    return run(ScanGraphSlam(log.scan), log).system, log


FIRST, SECOND, ELSEWHERE = (0, 0, 5), (1, 2, 3), (16, 2, 4, 6)


def of_both():
    first, second = mapped(*FIRST), mapped(*SECOND)
    found = Sessions(*first, "first.log")
    return found, found.add(*second, "second.log")


def paths(found):
    return np.concatenate([one.trajectory for one in found.drives])


@pytest.mark.parametrize("which", [SECOND, (2, 1, 2), (3, 3, 2)])
def test_another_drive_from_another_start_and_heading_is_joined_where_it_was(which):
    found = Sessions(*mapped(*FIRST))
    alone = ate(paths(found), mapped(*FIRST)[1].truth).rmse
    alignment = found.add(*mapped(*which))
    truth = np.concatenate([mapped(*each)[1].truth for each in (FIRST, which)])
    assert found.waiting == []
    assert ate(paths(found), truth).rmse < alone + 0.02
    begin = compose([0, 0, 0], between(truth[0], mapped(*which)[1].truth[0]))
    off = between(begin, alignment.frame)
    assert np.hypot(*off[:2]) < 0.1
    assert abs(off[2]) < 0.02
    confirmed = [one for one in alignment.closures if one.state == "confirmed"]
    assert len(confirmed) >= 3
    n = len(mapped(*FIRST)[0].nodes)
    assert all(one.j < n <= one.k for one in confirmed)
    pairs = [(one.j, one.k) for one in found.closures]
    assert len(set(pairs)) == len(pairs)  # none speaks for itself


@pytest.mark.parametrize("seed", [6, 7, 8])
def test_a_drive_through_another_building_is_kept_beside_the_map(seed):
    first, other = mapped(*FIRST), mapped(10 + seed, 2, 4, seed)
    found = Sessions(*first)
    before, alone = paths(found).copy(), repr(found)
    alignment = found.add(*other)
    assert alignment.frame is None
    assert alignment.places > 10
    assert alone.startswith("Sessions(1 drive of 145 nodes, ")
    assert "0 waiting" in alone
    assert repr(found) == alone.replace("0 waiting", "1 waiting")
    np.testing.assert_array_equal(paths(found), before)
    np.testing.assert_allclose(found.waiting[0].trajectory, other[0].trajectory, atol=1e-12)


def test_the_frame_is_that_of_the_first_drive_and_the_graph_holds_both_chains():
    found, _ = of_both()
    first, second = (mapped(*each)[0] for each in (FIRST, SECOND))
    n, m = len(first.nodes), len(second.nodes)
    graph = found.graph()
    loop_closures = [one for one in found.closures if one.state == "confirmed"]
    np.testing.assert_allclose(graph.poses[0], 0.0, atol=1e-9)
    assert len(graph.poses) == n + m
    assert len(graph.edges) == n - 1 + m - 1 + len(loop_closures)
    assert [n - 1, n] not in graph.edges.tolist()  # nobody drove from the one to the other
    assert graph.optimize().chi2 <= graph.chi2() + 1e-6


def test_a_drive_that_waits_is_joined_when_another_has_shown_its_place():
    # The first drive has one side of the ring, the second the opposite one: they share nothing.
    found = Sessions(*mapped(0, 0, 1))
    assert found.add(*mapped(6, 2, 1), "apart").frame is None
    alignment = found.add(*mapped(7, 0, 4), "round")
    assert alignment.frame is not None
    assert [one.name for one in found.drives] == ["", "round", "apart"]
    assert found.waiting == []
    truth = [mapped(*each)[1].truth for each in ((0, 0, 1), (7, 0, 4), (6, 2, 1))]
    assert ate(paths(found), np.concatenate(truth)).rmse < 0.05


def test_two_that_wait_share_places_and_are_joined_to_the_map_alone():
    apart = [mapped(6, 2, 1), mapped(9, 2, 1)]  # the same side of the ring
    assert Sessions(*apart[0]).add(*apart[1]).frame is not None  # as a map of their own
    found = Sessions(*mapped(0, 0, 1))
    for one in apart:
        assert found.add(*one).frame is None
    assert len(found.waiting) == 2
    before = [one.trajectory for one in found.waiting]
    for (system, _), path in zip(apart, before, strict=True):
        np.testing.assert_allclose(path, system.trajectory, atol=1e-12)
    assert found.add(*mapped(7, 0, 4)).frame is not None
    assert found.waiting == []
    truth = [mapped(*each)[1].truth for each in ((0, 0, 1), (7, 0, 4), (6, 2, 1), (9, 2, 1))]
    assert ate(paths(found), np.concatenate(truth)).rmse < 0.05


def test_systems_are_not_changed_and_two_calls_agree():
    first, second = mapped(*FIRST), mapped(*SECOND)
    before = copy.deepcopy(second[0].closures), second[0].trajectory
    one, two = of_both()[0], of_both()[0]
    np.testing.assert_array_equal(paths(one), paths(two))
    assert [c.state for c in before[0]] == [c.state for c in second[0].closures]
    np.testing.assert_array_equal(before[1], second[0].trajectory)
    assert len(first[0].nodes) == 145


def test_what_is_saved_is_loaded_and_goes_on_alike(tmp_path):
    path = tmp_path / "sessions.npz"
    found = Sessions(*mapped(*FIRST), "first.log")
    found.save(path)
    again = Sessions.load(path)
    np.testing.assert_array_equal(paths(again), paths(found))
    for each in (found, again):
        each.add(*mapped(*SECOND), "second.log")
        each.add(*mapped(*ELSEWHERE), "elsewhere.log")
    np.testing.assert_allclose(paths(again), paths(found), atol=1e-9)
    found.save(path)
    again = Sessions.load(path)
    assert repr(again) == repr(found)
    assert [one.name for one in again.drives + again.waiting] == [
        "first.log", "second.log", "elsewhere.log",
    ]  # fmt: skip
    for a, b in zip(again.drives + again.waiting, found.drives + found.waiting, strict=True):
        np.testing.assert_array_equal(a.ranges, b.ranges)
        np.testing.assert_array_equal(a.trajectory, b.trajectory)
        np.testing.assert_array_equal(a.nodes[3].points, b.nodes[3].points)
    assert [vars(c)["state"] for c in again.closures] == [c.state for c in found.closures]
    assert again.graph().chi2() == pytest.approx(found.graph().chi2())


def test_scans_before_the_first_node_have_a_place_too():
    log = drive(0, 0, 1)
    blind = np.array(log.ranges)
    blind[:3] = np.nan
    log = Log(
        log.times, log.u, log.dt, log.control_cov, ranges=blind, scan=log.scan, truth=log.truth
    )
    system = run(ScanGraphSlam(log.scan), log).system
    found = Sessions(system, log)
    assert found.drives[0].scan_of_node[0] == 3
    off = between(found.drives[0].trajectory, system.trajectory)
    assert np.abs(np.column_stack([off[:, :2], wrap_angle(off[:, 2])])).max() < 1e-9


def test_a_blind_scan_at_the_place_of_a_node_is_not_taken_for_the_node(tmp_path):
    """It was, when the scan of a node was looked for by its pose: the file could not be read."""
    log = drive(0, 0, 1)[:12]
    ranges, u = np.array(log.ranges), np.array(log.u)
    u[10:] = [[0.4, 0.0, 0.0], [0.0, 0.0, 0.0]]
    ranges[10] = np.nan  # far enough for a node, but nothing is seen
    ranges[11] = np.random.default_rng(0).uniform(0.3, 4.0, LIDAR.n_beams)  # nothing that fits
    log = Log(log.times, u, log.dt, log.control_cov, ranges=ranges, scan=log.scan)
    system = run(ScanGraphSlam(log.scan), log).system
    np.testing.assert_array_equal(system.trajectory[10], system.trajectory[11])
    found = Sessions(system, log)
    assert found.drives[0].scan_of_node[-1] == 11
    found.save(tmp_path / "map.npz")
    assert len(Sessions.load(tmp_path / "map.npz").drives[0].nodes) == len(system.nodes)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Sessions(ScanGraphSlam(LIDAR), drive(0, 0, 1)),
            "system: expected scans that see",
        ),
        (lambda: Sessions(None, drive(0, 0, 1)), "system: expected a ScanGraphSlam"),
        (lambda: Sessions(mapped(0, 0, 1)[0], drive(0, 0, 1)[:5]), "log: expected the 39 scans"),
        (lambda: Sessions(mapped(0, 0, 1)[0], Log([0.0], [[0, 0, 0]], 0.0, np.eye(3))), "log: "),
    ],
)
def test_what_cannot_be_kept_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_another_lidar_is_refused_and_changes_nothing():
    found = Sessions(*mapped(0, 0, 1))
    lidar = Lidar(90, field_of_view=np.pi, max_range=8.0)
    poses = drive(0, 0, 1).truth
    log = Log(
        np.arange(len(poses)), np.zeros((len(poses), 3)), 0.0, np.eye(3) * 1e-3,
        ranges=lidar.scan(building(), poses), scan=lidar,
    )  # fmt: skip
    system = run(ScanGraphSlam(lidar), log).system
    with pytest.raises(
        ValueError, match=r"lidar of the map, 180 beams .* up to 8 m; got 90 beams"
    ):
        found.add(system, log)
    assert len(found.drives) == 1
    assert found.waiting == []


CHANGES = {
    "version": (lambda a: a + 1, "version: expected 1, got 2"),
    "joined": (lambda a: ~a, "joined: expected true"),
    "n_nodes": (lambda a: a + 1, "scan_of_node: expected shape"),
    "n_scans": (lambda a: a * 1.5, "n_scans: expected whole numbers"),
    "scan_of_node": (
        lambda a: a[::-1].copy(),
        "scan_of_node: expected numbers of scans that grow",
    ),
    "poses": (lambda a: a * np.nan, "poses: expected finite"),
    "information": (lambda a: 0 * a, "information: expected positive definite"),
    "closure_nodes": (lambda a: a[:, ::-1].copy(), "closure_nodes: expected an older"),
    "closure_cov": (lambda a: -a, "closure_cov: "),
    "closure_state": (lambda a: 0 * a, "closure_state: expected closures that tie all drives"),
    "ranges": (lambda a: a * np.inf, "ranges: expected 10 points"),
    "names": (lambda a: np.array(["x" * 201] * len(a)), "names: expected at most 200"),
}


@pytest.fixture(scope="module")
def file_of_both(tmp_path_factory):
    path = tmp_path_factory.mktemp("both") / "sessions.npz"
    of_both()[0].save(path)
    return path


@pytest.mark.parametrize("name", CHANGES)
def test_a_damaged_file_is_refused_by_name(name, file_of_both, tmp_path):
    path = tmp_path / "sessions.npz"
    change, message = CHANGES[name]
    with np.load(file_of_both) as kept:
        arrays = dict(kept)
    with np.errstate(all="ignore"):
        np.savez(path, **(arrays | {name: change(arrays[name])}))
    with pytest.raises(ValueError, match=f"sessions.npz: expected a map of drives .{message}"):
        Sessions.load(path)
    del arrays[name]
    np.savez(path, **arrays)
    with pytest.raises(ValueError, match=f"sessions.npz: expected a map of drives .'{name}"):
        Sessions.load(path)


def test_a_file_without_a_count_of_nodes_for_each_drive_is_refused(file_of_both, tmp_path):
    with np.load(file_of_both) as kept:
        arrays = dict(kept)
    np.savez(tmp_path / "few.npz", **(arrays | {"n_nodes": arrays["n_nodes"][:1]}))
    with pytest.raises(ValueError, match="n_nodes: expected a number for each of 2 drives, got 1"):
        Sessions.load(tmp_path / "few.npz")
