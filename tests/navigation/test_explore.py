"""Exploration: coverage, collisions, the record, the protocol; P5's faults beside their repair."""

from functools import cached_property
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import KDTree

from slamlab.evaluation.tours import collisions, coverage, path_length, revisits
from slamlab.geometry import compose
from slamlab.models import View
from slamlab.navigation import (
    ExplorationGrid,
    Explorer,
    InformationGain,
    LongestBeam,
    NearestFrontier,
    Quadrants,
    RandomFraction,
)
from slamlab.navigation.strategies import Situation
from slamlab.printed.p5 import forward_is_open_as_printed
from slamlab.robots import SquareRobot, Unicycle
from slamlab.sensors import Lidar
from slamlab.simulation import PerfectEstimator, record
from slamlab.worlds import free_poses, rooms

ROBOT, LIDAR = SquareRobot(0.30), Lidar(120)
ROOM, ROOM_TWO = rooms.thesis_room(), rooms.thesis_room_two()
STRATEGIES = {
    "longest": LongestBeam(),
    "fraction": RandomFraction(),
    "quadrants": Quadrants(),
    "frontier": NearestFrontier(),
    "information": InformationGain(),
}


def starts(world, n, seed=1):
    return free_poses(world, n, np.random.default_rng(seed), ROBOT.circumradius + 0.03)


class Tour(SimpleNamespace):
    """One exploration and what is to be said about it."""

    @cached_property
    def coverage(self):
        return coverage(self.log, self.world)


def explore(world, robot, lidar, strategy, start, rng, belief=None, **settings):
    pilot = Explorer(robot, lidar, strategy, rng, **settings)
    log = record(
        world,
        Unicycle(),
        lidar,
        pilot,
        PerfectEstimator() if belief is None else belief,
        rng,
        start=start,
        dt=1.0,
        footprint=robot.footprint,
        max_time=3000,
    )
    return Tour(
        world=world,
        log=log,
        poses=log.truth,
        ranges=log.ranges,
        path_length=path_length(log),
        collisions=collisions(log),
        revisits=revisits(log, robot.side),
        finished=pilot.finished,
        refused=pilot.refused,
        floor=pilot.floor,
    )


def runs(world, strategy, n=6, **settings):
    settings = {"max_path": 12.0, "max_moves": 60, "bounds": world.bounds, **settings}
    return [
        explore(world, ROBOT, LIDAR, strategy, pose, np.random.default_rng(k), **settings)
        for k, pose in enumerate(starts(world, n))
    ]


def view_of(ranges, **more):
    floor = ExplorationGrid([-5, -5, 5, 5])
    lidar, body = Lidar(len(ranges)), (ROBOT.side, ROBOT.circumradius + 0.02)
    return Situation(np.zeros(3), np.asarray(ranges, float), lidar, floor, *body, **more)


def bearing(point):
    return np.rad2deg(np.arctan2(point[0, 1], point[0, 0])) % 360


@pytest.mark.parametrize("name", STRATEGIES)
@pytest.mark.parametrize("world", [ROOM, ROOM_TWO], ids=["first", "second"])
def test_mended_guard_does_not_collide_and_coverage_never_falls(name, world):
    for run in runs(world, STRATEGIES[name]):
        assert run.collisions[-1] == 0
        assert (np.diff(run.coverage) >= 0).all()
        assert (np.diff(run.path_length) >= 0).all()
        assert run.coverage[-1] > 0.7
        assert len(run.poses) == len(run.ranges) == len(run.coverage) == len(run.collisions)
        assert not world.collides(ROBOT.footprint, run.poses).any()


@pytest.mark.parametrize("world", [ROOM, ROOM_TWO], ids=["first", "second"])
def test_both_trials_of_p5_from_thirty_starts(world):
    """No collision, the whole room seen, every dot of the map within a pixel of a wall pixel."""
    trial = runs(world, NearestFrontier(), n=30)
    assert sum(run.collisions[-1] for run in trial) == 0
    assert np.mean([run.coverage[-1] >= 0.98 for run in trial]) > 0.95
    pixels = KDTree(world.centres()[world.occupied] / 0.01)
    for run in trial:
        dots = LIDAR.points(run.ranges, run.poses).reshape(-1, 2)
        assert pixels.query(dots / 0.01)[0].max() < 1


@pytest.mark.slow
@pytest.mark.needs_numba(reason="sixty runs of up to a second take more than 20 s")
def test_no_collision_in_random_rooms():
    for seed in range(12):
        world = rooms.random_room(np.random.default_rng(seed))
        for strategy in STRATEGIES.values():
            (run,) = runs(world, strategy, n=1)
            assert run.collisions[-1] == 0, f"room {seed}, {strategy}"


@pytest.mark.parametrize("stride", [0.1, 0.3, np.inf])
def test_can_move_as_printed_collides_in_most_runs(stride):
    settings = {"stride": stride, "n": 4, "stop_at_hit": True}
    printed = runs(ROOM, Quadrants(), guard=forward_is_open_as_printed, **settings)
    assert np.mean([run.collisions[-1] > 0 for run in printed]) >= 0.75
    nobody = runs(ROOM, Quadrants(), guard="none", **settings)
    assert all(run.collisions[-1] > 0 for run in nobody)


def test_the_run_may_end_at_the_first_collision():
    settings = {"guard": "none", "n": 3, "stride": np.inf}
    on, ended = (runs(ROOM, LongestBeam(1.0), stop_at_hit=s, **settings) for s in (False, True))
    assert all(
        run.collisions[-1] == 1 and len(run.poses) <= len(other.poses)
        for run, other in zip(ended, on, strict=True)
    )
    assert max(run.collisions[-1] for run in on) > 1


def test_after_a_collision_the_robot_stands_at_the_contact():
    run = explore(
        ROOM, ROBOT, LIDAR, LongestBeam(1.0), [1.0, 1.0, 0.0], np.random.default_rng(0),
        guard="none", max_moves=1, stride=np.inf,
    )  # fmt: skip
    assert run.collisions[-1] == 1
    last = run.poses[-1]
    assert not ROOM.collides(ROBOT.footprint, last)
    assert ROOM.collides(ROBOT.footprint, ROBOT.forward(last, 0.01))


def test_frontiers_see_the_room_on_a_shorter_way_than_the_longest_beam():
    frontier, longest = runs(ROOM, NearestFrontier(), n=8), runs(ROOM, LongestBeam(), n=8)
    assert all(run.finished for run in frontier)
    assert min(run.coverage[-1] for run in frontier) >= 0.985
    enough = [int(np.argmax(run.coverage >= 0.985)) for run in frontier]
    assert np.mean([run.path_length[n] for run, n in zip(frontier, enough, strict=True)]) < 9
    again = [
        revisits(run.log[: n + 1], ROBOT.side) for run, n in zip(frontier, enough, strict=True)
    ]
    assert np.mean([run.coverage[-1] for run in longest]) < 0.95
    assert np.mean([run.revisits for run in longest]) > 10 * np.mean(again) + 5


def test_a_frontier_explorer_stops_by_itself_when_nothing_is_left():
    run = explore(ROOM, ROBOT, LIDAR, NearestFrontier(), [2.0, 2.0, 0.0], np.random.default_rng(0))
    assert run.finished
    assert 0.98 < run.coverage[-1] <= 1.0


def test_noise_and_lost_beams_do_not_stop_it():
    noisy = Lidar(120, max_range=3.0, sigma_range=0.005, p_miss=0.05)
    run = explore(
        ROOM,
        ROBOT,
        noisy,
        NearestFrontier(),
        [2.0, 2.0, 0.0],
        np.random.default_rng(0),
        margin=0.04,
    )
    assert run.coverage[-1] > 0.9
    assert run.collisions[-1] == 0


def test_same_seed_same_run():
    a, b = (
        explore(ROOM, ROBOT, LIDAR, Quadrants(), [2, 2, 0], np.random.default_rng(7), max_path=5)
        for _ in range(2)
    )
    np.testing.assert_array_equal(a.poses, b.poses)
    c = explore(ROOM, ROBOT, LIDAR, Quadrants(), [2, 2, 0], np.random.default_rng(8), max_path=5)
    assert len(c.poses) != len(a.poses) or not np.allclose(c.poses, a.poses)


@pytest.mark.parametrize("name", STRATEGIES)
def test_no_run_hangs_on_the_last_bit(name):
    """Arithmetic that differs by a few ulp, as on another machine, gives the same run."""

    class OtherMachine(Lidar):
        def scan(self, world, poses, rng=None):
            ranges = super().scan(world, poses, rng)
            return ranges * (1 + 1e-14 * np.sin(1e6 * ranges))

    a, b = (
        explore(
            ROOM_TWO,
            ROBOT,
            lidar,
            STRATEGIES[name],
            [2.9, 0.8, 0.3],
            np.random.default_rng(1),
            max_path=8,
        )
        for lidar in (LIDAR, OtherMachine(120))
    )
    np.testing.assert_array_equal(a.poses, b.poses)


def test_longest_beam_goes_where_the_beam_is_longest():
    ranges = np.full(120, 1.0)
    ranges[30] = 4.0
    rng = np.random.default_rng(0)
    np.testing.assert_allclose(
        LongestBeam(0.25).choose(view_of(ranges), rng), [[0, 1.0]], atol=1e-12
    )
    again = [LongestBeam().choose(view_of(ranges, refused=True), rng) for _ in range(20)]
    assert len({round(bearing(p)) for p in again}) > 10


def test_a_missing_beam_is_never_the_longest():
    ranges = np.full(120, 1.0)
    ranges[10], ranges[50] = np.nan, 2.0
    point = LongestBeam().choose(view_of(ranges), np.random.default_rng(0))
    assert bearing(point) == pytest.approx(150.0)


def test_random_fraction_as_printed_is_longer_than_the_beam_in_47_percent():
    rng = np.random.default_rng(1)
    view = view_of(np.full(120, 1.0))
    printed, mended = (
        np.array([np.hypot(*RandomFraction(p).choose(view, rng)[0]) for _ in range(4000)])
        for p in (True, False)
    )
    assert np.mean(printed > 1.0) == pytest.approx(0.9 / 1.9, abs=0.025)
    assert printed.max() > 8
    assert 0.5 <= mended.min() < mended.max() <= 1.0


def test_quarters_overlap_as_printed_and_not_when_mended():
    angles = Lidar(120).beam_angles
    printed, mended = Quadrants(True).quarters(angles), Quadrants().quarters(angles)
    assert (mended.sum(axis=0) == 1).all()
    doubled = np.flatnonzero(printed.sum(axis=0) == 2)
    np.testing.assert_array_equal(3 * doubled, np.arange(162, 180, 3))


def test_quadrants_do_not_go_back_while_another_way_is_open():
    ranges = np.full(120, 2.0)
    ranges[60] = 4.0  # straight back, at 180 degrees
    rng = np.random.default_rng(2)
    free = {round(bearing(Quadrants().choose(view_of(ranges), rng))) for _ in range(60)}
    kept = {
        round(bearing(Quadrants().choose(view_of(ranges, came_from=np.pi), rng)))
        for _ in range(60)
    }
    assert 180 in free
    assert 180 not in kept
    blocked = np.full(120, 0.1)
    blocked[60] = 2.0
    only = Quadrants().choose(view_of(blocked, came_from=np.pi), rng)
    assert bearing(only) == pytest.approx(180)


def test_any_object_with_choose_is_a_strategy_and_can_come_home():
    class ThereAndBack:
        """Explore a little, then return to the start: chapter 20's protocol."""

        home = np.array([0.6, 0.6])

        def choose(self, view, rng):
            if view.floor.state.any() and np.hypot(*(view.pose[:2] - self.home)) > 1.0:
                return view.floor.plan(view.pose[:2], self.home, view.body_radius)
            return None if self.gone else self.go(view)

        gone = False

        def go(self, view):
            self.gone = True
            return np.array([[2.0, 0.6], [2.0, 2.0]])

    run = explore(ROOM, ROBOT, LIDAR, ThereAndBack(), [0.6, 0.6, 0.0], np.random.default_rng(0))
    assert run.path_length[-1] > 4
    assert np.hypot(*(run.poses[-1, :2] - [0.6, 0.6])) < 0.1


def test_a_pilot_turns_then_drives_and_says_why_it_ended():
    class Once:
        """One point ahead and to the left, then nothing."""

        points = np.array([[1.0, 1.0]])

        def choose(self, now, rng):
            points, self.points = self.points, None
            return points

    def view(pose):
        pose = np.asarray(pose, float)
        return View(0.0, 1.0, pose, np.eye(3), np.full(120, 9.0), np.False_)

    pilots = [
        Explorer(ROBOT, LIDAR, Once(), np.random.default_rng(0), max_moves=n) for n in (9, 1)
    ]
    for pilot, end in zip(pilots, ("finished", "over"), strict=True):
        assert pilot.mode == "choose"
        assert_allclose(pilot.command(view([0, 0, 0])), [0, np.pi / 4])
        assert pilot.mode == "drive"
        assert_allclose(pilot.command(view([0, 0, np.pi / 4])), [0.5, 0])
        # Pushed aside it aims anew, which it does not while it heads for the point.
        assert pilot.mode == "drive"
        assert_allclose(pilot.command(view([0.3, 0.3, np.pi / 2]))[1], 0)
        assert pilot.mode == "turn"
        assert pilot.command(view([1.0, 1.0, 0.0])) is None
        assert (pilot.mode, pilot.finished) == (end, end == "finished")
        assert pilot.command(view([1.0, 1.0, 0.0])) is None
        assert pilot.refused == 0


def test_the_map_grows_with_what_is_seen_and_gives_the_same_tour():
    given = runs(ROOM, NearestFrontier(), n=3)
    grown = runs(ROOM, NearestFrontier(), n=3, bounds=None)
    for a, b in zip(given, grown, strict=True):
        assert b.finished
        assert b.collisions[-1] == 0
        assert b.coverage[-1] > 0.98
        assert b.path_length[-1] < 2.0 * a.path_length[-1] + 2.0
        left, right, bottom, top = b.floor.extent
        assert left < 0 < 4 < right
        assert bottom < 0 < 4 < top


class Lost(PerfectEstimator):
    """Believes to be somewhere else: everything moved and turned, and noise on top."""

    def __init__(self, frame, sigma):
        super().__init__()
        self.frame, self.sigma, self.rng = frame, sigma, np.random.default_rng(5)

    def update(self, measurement, ids=None):
        noise = self.sigma * self.rng.standard_normal(3) * [1, 1, 0.3]
        super().update(compose(self.frame, measurement) + noise)


def test_the_pilot_sees_the_belief_only_so_a_moved_frame_changes_nothing():
    """A robot that starts with a wrong idea of where north is explores the same way."""
    start, frame = [2.0, 2.0, 0.0], np.array([30.0, -20.0, np.pi / 2])
    here, there = (
        explore(ROOM, ROBOT, LIDAR, NearestFrontier(), start, np.random.default_rng(0), belief)
        for belief in (PerfectEstimator(), Lost(frame, 0.0))
    )
    believed = there.log.notes["believed"]
    np.testing.assert_allclose(believed[:, :2], compose(frame, there.poses)[:, :2], atol=1e-9)
    assert there.finished
    assert there.coverage[-1] > 0.98
    assert abs(there.path_length[-1] - here.path_length[-1]) < 4.0


def test_a_belief_that_trembles_is_good_enough():
    for seed in range(3):
        start = starts(ROOM, 3)[seed]
        belief = Lost(np.zeros(3), 0.01)
        run = explore(
            ROOM, ROBOT, LIDAR, NearestFrontier(), start, np.random.default_rng(seed), belief
        )
        assert run.collisions[-1] == 0
        assert run.coverage[-1] > 0.95


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rng": 3}, "rng"),
        ({"strategy": "frontier"}, "strategy"),
        ({"guard": "printed"}, "guard: expected one of 'swept', 'none', got"),
        ({"margin": -0.1}, "margin"),
        ({"stride": 0.0}, "stride"),
        ({"max_moves": -1}, "max_moves"),
        ({"max_path": -1.0}, "max_path"),
        ({"resolution": 0.0}, "resolution"),
        ({"bounds": [0, 0, 0, 1]}, "bounds"),
    ],
)
def test_bad_input_is_named(change, message):
    call = {
        "robot": ROBOT,
        "lidar": LIDAR,
        "strategy": NearestFrontier(),
        "rng": np.random.default_rng(0),
        **change,
    }
    with pytest.raises(ValueError, match=message):
        Explorer(**call)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LongestBeam(0.0), "fraction"),
        (lambda: LongestBeam(1.1), "fraction"),
        (lambda: NearestFrontier(0), "smallest"),
        (lambda: InformationGain(decay=-1), "decay"),
        (lambda: InformationGain(reach=-1), "reach"),
        (lambda: InformationGain(smallest=-1), "smallest"),
    ],
)
def test_bad_settings_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_the_nearest_frontier_does_not_hang_on_the_size_of_the_grid():
    lidar = Lidar(120, max_range=1.5)
    for pose in starts(ROOM, 8, seed=5):
        ranges, ways, blacklisted = lidar.scan(ROOM, pose), [], []
        for bounds, corner in (([0, 0, 4, 4], (0, 0)), ([-2, -1, 7, 5], (20, 40))):
            floor = ExplorationGrid(bounds)
            floor.insert(pose, ranges, lidar)
            now = Situation(pose, ranges, lidar, floor, ROBOT.side, ROBOT.circumradius + 0.02)
            ways.append(NearestFrontier().choose(now, np.random.default_rng(0)))
            blacklisted.append(floor.blacklisted[corner[0] :, corner[1] :][:80, :80])
        np.testing.assert_allclose(*ways, atol=1e-12)
        np.testing.assert_array_equal(*blacklisted)
        assert blacklisted[0].any()
