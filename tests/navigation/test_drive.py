"""Driving round rooms: nothing is touched, everything is seen, and the record tells the truth."""

import numpy as np
import pytest

from slamlab.evaluation import run
from slamlab.evaluation.tours import coverage, path_length
from slamlab.localization import DeadReckoning
from slamlab.navigation import YOUBOT_BODY, Body, CollisionGuard, CoveragePilot
from slamlab.navigation.exploration_grid import FREE
from slamlab.robots import YOUBOT
from slamlab.sensors import Lidar
from slamlab.simulation import PerfectEstimator, record
from slamlab.slam import WallSlam
from slamlab.worlds import free_poses, rooms

LIDAR = Lidar(360, offset=0.3, max_range=8.0, sigma_range=0.01)


def drive_round(world, start, rng, belief=None, *, lidar=LIDAR, sigma_wheel=0.0, dt=0.2,
                max_time=300.0, **options):  # fmt: skip
    """A drive round a room by a youBot, and its pilot."""
    pilot = CoveragePilot(YOUBOT_BODY, lidar, **options)
    log = record(
        world,
        YOUBOT,
        lidar,
        pilot,
        PerfectEstimator() if belief is None else belief,
        rng,
        start=start,
        dt=dt,
        control_cov=YOUBOT.control_cov(sigma_wheel),
        footprint=YOUBOT_BODY.footprint,
        max_time=max_time,
    )
    return log, pilot


QUICK = {"view_range": 3.0, "dt": 0.25}


def case(seed):
    """A random room and a free pose in it."""
    rng = np.random.default_rng(seed)
    world = rooms.random_box_room(rng)
    return world, free_poses(world, 1, rng, clearance=0.45)[0], rng


@pytest.fixture(scope="module")
def tour():
    """One drive round the room of P1, the true pose told."""
    world = rooms.box_room()
    start = np.array([1.0, 1.0, 0.5])
    return world, *drive_round(world, start, np.random.default_rng(0), sigma_wheel=0.3)


# ------------------------------------------------------------------------- nothing is touched


TENS = [0, *(pytest.param(first, marks=pytest.mark.slow) for first in range(10, 100, 10))]


@pytest.mark.parametrize("first", TENS)
def test_no_collision_in_a_hundred_random_rooms(first):
    # Two commands a second: ways through gaps that are too narrow get stuck more often still.
    options = {"sigma_wheel": 0.3, "home": False, **QUICK, "dt": 0.5}
    for seed in range(first, first + 10):
        world, start, rng = case(seed)
        log, pilot = drive_round(world, start, rng, **options)
        assert not log.notes["hit"].any(), f"room {seed}"
        assert pilot.finished, f"room {seed}"


def test_the_guard_saves_a_robot_that_does_not_know_where_it_is(monkeypatch):
    # Dead reckoning with bad wheels: the belief is metres off, and so are map and ways.
    def hits(seed, max_time):
        world, start, rng = case(seed)
        options = {"sigma_wheel": 1.5, "max_time": max_time, "margin": 0.12, **QUICK}
        log, _ = drive_round(world, start, rng, DeadReckoning(YOUBOT, start), **options)
        return log.notes["hit"].sum()

    # Without the guard each of them drives into things within so many seconds.
    seconds = {11: 26.0, 1: 50.0, 9: 65.0, 2: 91.0}
    assert sum(hits(seed, 120.0) for seed in seconds) == 0
    monkeypatch.setattr(CollisionGuard, "safe_velocity", lambda self, u, points, dt: u)
    assert all(hits(seed, at_most) > 0 for seed, at_most in seconds.items())


# -------------------------------------------------------------------- the whole room was seen


def test_every_place_that_can_be_reached_was_seen_from_near(tour):
    world, log, pilot = tour
    assert pilot.finished
    points = free_poses(world, 2000, np.random.default_rng(1), clearance=0.45)[:, :2]
    nearest = np.hypot(*(points[:, None] - log.truth[None, ::3, :2]).transpose(2, 0, 1)).min(1)
    assert nearest.max() < 2.4
    seen = np.array([pilot.floor.state[pilot.floor.cell(p)] == FREE for p in points])
    assert seen.mean() > 0.99


def test_it_comes_home_if_it_is_to(tour):
    _, log, _ = tour
    assert np.hypot(*(log.truth[-1] - log.truth[0])[:2]) < 0.05
    world, start, rng = case(3)
    away, pilot = drive_round(world, start, rng, home=False, **QUICK)
    assert pilot.finished
    assert np.hypot(*(away.truth[-1] - away.truth[0])[:2]) > 0.5


class Trembling(PerfectEstimator):
    """Knows where it is within a centimetre: walls of its map are smeared by that much."""

    def __init__(self, rng):
        super().__init__()
        self.rng = rng

    def update(self, measurement, ids=None):
        super().update(measurement + self.rng.normal(0, [0.008, 0.008, 0.003]))


@pytest.mark.parametrize("seed", [1, 7])
def test_a_map_smeared_by_a_centimetre_does_not_close_the_doors_of_the_office(seed):
    """Doors of 0.9 m leave the turning body 5 cm on either side: one cell of the map."""
    world = rooms.office()
    start = free_poses(world, 1, np.random.default_rng(0), 0.45)[0]
    belief = Trembling(np.random.default_rng(100 + seed))
    rng = np.random.default_rng(seed)
    log, pilot = drive_round(world, start, rng, belief, sigma_wheel=1.5, max_time=400.0)
    assert pilot.finished
    assert coverage(log, world, 0.1)[-1] > 0.9
    assert np.hypot(*(log.truth[-1] - start)[:2]) < 0.1
    assert not log.notes["hit"].any()


def test_a_shorter_sight_makes_a_longer_drive():
    world, start, _ = case(4)
    lengths = [
        path_length(drive_round(world, start, np.random.default_rng(0), view_range=s, dt=0.25)[0])[
            -1
        ]
        for s in (2.0, 4.0)
    ]
    assert lengths[0] > 1.2 * lengths[1]


def test_the_route_is_its_own_other_rooms_other_routes(tour):
    world, log, _ = tour
    again, _ = drive_round(world, log.truth[0], np.random.default_rng(0), sigma_wheel=0.3)
    np.testing.assert_array_equal(again.truth, log.truth)
    np.testing.assert_array_equal(again.ranges, log.ranges)
    elsewhere = rooms.random_box_room(np.random.default_rng(5))
    other, _ = drive_round(elsewhere, log.truth[0], np.random.default_rng(0), max_time=20.0)
    n = min(len(other), len(log), 100)
    assert np.abs(other.truth[:n, :2] - log.truth[:n, :2]).max() > 0.5


def test_it_drives_on_its_own_map_of_walls():
    world, start = rooms.box_room(), np.array([1.0, 1.0, 0.5])
    lidar = Lidar(360, offset=0.3, max_range=8.0, sigma_range=0.02)
    slam, rng = WallSlam(YOUBOT, lidar, start), np.random.default_rng(6)
    log, pilot = drive_round(world, start, rng, slam, lidar=lidar, sigma_wheel=0.4, view_range=3.0)
    assert pilot.finished
    assert not log.notes["hit"].any()
    error = np.hypot(*(log.notes["believed"] - log.truth)[:, :2].T)
    assert error.max() < 0.05
    blind = run(DeadReckoning(YOUBOT, start), log).poses
    assert np.hypot(*(blind[-1] - log.truth[-1])[:2]) > 5 * error[-1]


def test_commands_keep_the_limits(tour):
    _, log, _ = tour
    assert np.hypot(*log.u[:, :2].T).max() <= 0.5 + 1e-12
    assert np.abs(log.u[:, 2]).max() <= 0.8 + 1e-12
    # Sideways, too: a mecanum platform does not have to turn before it drives.
    assert np.abs(log.u[:, 1]).max() > 0.2


def test_time_runs_out():
    log, pilot = drive_round(rooms.box_room(), [1, 1, 0], np.random.default_rng(0), max_time=4.0)
    assert len(log) == 21
    assert not pilot.finished


# ---------------------------------------------------------------------------------- the pieces


def test_the_clearance_of_a_body_is_the_distance_to_its_rectangle():
    body = Body(0.6, 0.4)
    points = np.random.default_rng(7).uniform(-1, 1, (400, 2))
    inside = (np.abs(points) < [0.3, 0.2]).all(1)
    nearest = np.clip(points, [-0.3, -0.2], [0.3, 0.2])
    due = np.hypot(*(points - nearest).T)
    clearance = body.clearance(points)
    np.testing.assert_allclose(clearance[~inside], due[~inside], atol=1e-12)
    assert (clearance[inside] < 0).all()
    assert body.clearance(np.zeros(2)) == pytest.approx(-0.2)
    assert body.circumradius == pytest.approx(np.hypot(0.3, 0.2))
    np.testing.assert_allclose(np.abs(YOUBOT_BODY.footprint), [[0.29, 0.19]] * 4)


def test_the_guard_slows_down_turns_less_and_stands_still():
    guard = CollisionGuard(YOUBOT_BODY)
    ahead = np.stack([np.full(41, 0.5), np.linspace(-1, 1, 41)], -1)
    forward = np.array([0.5, 0.0, 0.0])
    assert guard.safe_velocity(forward, ahead + [2.0, 0.0], 0.2).tolist() == [0.5, 0, 0]
    slow = guard.safe_velocity(forward, ahead, 0.2)
    assert 0 < slow[0] < 0.5
    assert guard.safe_velocity(forward, ahead - [0.15, 0.0], 0.2).tolist() == [0, 0, 0]
    # Too near already: it may back out and not come nearer; very near it goes back by itself.
    assert guard.safe_velocity(-forward, ahead - [0.17, 0.0], 0.2).tolist() == [-0.5, 0, 0]
    assert guard.safe_velocity(forward, ahead - [0.19, 0.0], 0.2)[0] < -0.05
    # Between two walls it may drive and not turn.
    sides = np.concatenate([[[x, y]] for x in np.linspace(-2, 2, 81) for y in (-0.255, 0.255)])
    assert guard.safe_velocity(np.array([0.3, 0.0, 0.8]), sides, 0.2).tolist() == [0.3, 0, 0]


def limits(travel=None):
    """What the guard leaves of 3000 wishes among a few points, and how often it looked closely."""
    rng, guard, observations = np.random.default_rng(8), CollisionGuard(YOUBOT_BODY), []
    closest = guard._closest
    guard._closest = lambda u, points, dt: observations.append(1) or closest(u, points, dt)
    if travel is not None:
        guard._travel = travel
    left = []
    for _ in range(3000):
        wish = rng.uniform(-1, 1, 3) * rng.choice([[0.5, 0.5, 0.8], [0.05, 0.05, 3.0], [0, 0, 0]])
        points = rng.uniform(-1.2, 1.2, (int(rng.integers(0, 6)), 2))
        left.append(guard.safe_velocity(wish, points, 0.25))
    return np.array(left), len(observations)


def test_what_is_too_far_for_the_next_two_steps_is_not_looked_at_closely():
    left, observations = limits()
    due, all_looks = limits(lambda u, dt: np.inf)
    np.testing.assert_array_equal(left, due)
    assert observations < 0.7 * all_looks
    # Who forgets that a turning corner moves, too, lets it come too near.
    turned = limits(lambda u, dt: 2 * dt * np.hypot(u[0], u[1]))[0]
    assert (turned != due).any()


@pytest.mark.parametrize("name", ["view_range", "max_speed", "max_turn", "margin"])
def test_bad_arguments_are_named(name):
    with pytest.raises(ValueError, match=name):
        CoveragePilot(YOUBOT_BODY, LIDAR, **{name: -0.1})


def test_a_body_has_a_size():
    with pytest.raises(ValueError, match="length"):
        Body(0.0, 1.0)
