"""Driving round rooms: nothing is touched, everything is seen, and the record tells the truth."""

import numpy as np
import pytest

from slamlab.navigation import YOUBOT_BODY, Body, SeenFloor, drive_round
from slamlab.navigation import drive as module
from slamlab.navigation.seen_floor import FREE
from slamlab.robots import YOUBOT
from slamlab.sensors import Lidar
from slamlab.slam.wall_slam import WallSlam
from slamlab.worlds import WallWorld, free_poses, rooms

QUICK = {"sight": 3.0, "dt": 0.25}


class Odometer:
    """A belief that drifts: wheels only, the scans ignored."""

    def __init__(self, pose):
        self.pose = np.array(pose)

    def predict(self, u, dt, control_cov):
        self.pose = YOUBOT.step(self.pose, u, dt)

    def observe(self, ranges):
        pass


def case(seed):
    """A random room and a free pose in it."""
    rng = np.random.default_rng(seed)
    world = rooms.random_box_room(rng)
    return world, free_poses(world, 1, rng, clearance=0.45)[0], rng


def touched(world, start, rng, **options):
    """Whether a drive touched anything: also if it ran the lidar into a wall."""
    try:
        drive = drive_round(world, start, rng, **options)
    except ValueError as error:
        return "expected the sensor in free space" in str(error)
    return bool(drive.touches(world).any())


@pytest.fixture(scope="module")
def tour():
    """One drive round the room of P1, the true pose told."""
    world = rooms.box_room()
    start = np.array([1.0, 1.0, 0.5])
    return world, drive_round(world, start, np.random.default_rng(0), sigma_wheel=0.3)


# ------------------------------------------------------------------------- nothing is touched


def assert_clean_drives(seeds):
    for seed in seeds:
        world, start, rng = case(seed)
        drive = drive_round(world, start, rng, sigma_wheel=0.3, home=False, **QUICK)
        assert not drive.touches(world).any(), f"room {seed}"
        assert drive.finished, f"room {seed}"


def test_no_collision_in_ten_random_rooms():
    assert_clean_drives(range(10))


@pytest.mark.slow
def test_no_collision_in_a_hundred_random_rooms():
    assert_clean_drives(range(100))


def test_the_guard_saves_a_robot_that_does_not_know_where_it_is(monkeypatch):
    # Dead reckoning with bad wheels: the belief is metres off, and so are map and ways.
    def touches(seed):
        world, start, rng = case(seed)
        options = {"belief": Odometer(start), "sigma_wheel": 1.5, "max_time": 60.0, **QUICK}
        return touched(world, start, rng, **options)

    seeds = [1, 2, 4, 6, 9, 10, 11]
    assert not any(touches(seed) for seed in seeds)
    # Without the guard the same robots drive into things.
    monkeypatch.setattr(module._Pilot, "_guarded", lambda self, wish, points: wish)
    assert sum(touches(seed) for seed in seeds) >= 5


def test_the_test_of_touching_sees_what_happens_between_two_poses():
    # A thin wall crossed within one step, and one that is passed a centimetre away.
    pose, u = np.zeros((2, 3)), np.array([[1.0, 0.0, 0.0]])
    pose[1, 0] = 1.0
    record = drive_round(rooms.box_room(), [1, 1, 0], np.random.default_rng(0), max_time=0.0)
    drive = module.Drive(**{**vars(record), "dt": 1.0, "poses": pose, "controls": u, "driven": u})
    crossed = WallWorld([[[0.5, -0.01], [0.5, 0.01]]])
    assert drive.touches(crossed, parts=20).tolist() == [True]
    # Looking at the ends only would have missed it, for the post stands between them.
    assert not crossed.collides(Body(0.3, 0.3).footprint, pose).any()
    beside = WallWorld([[[-2, 0.21], [3, 0.21]]])
    assert drive.touches(beside, parts=100).tolist() == [False]
    assert drive.touches(WallWorld([[[-2, 0.185], [3, 0.185]]]), parts=100).tolist() == [True]


# -------------------------------------------------------------------- the whole room was seen


def test_every_place_that_can_be_reached_was_seen_from_near(tour):
    world, drive = tour
    assert drive.finished
    points = free_poses(world, 2000, np.random.default_rng(1), clearance=0.45)[:, :2]
    nearest = np.hypot(*(points[:, None] - drive.poses[None, ::3, :2]).transpose(2, 0, 1)).min(1)
    assert nearest.max() < 2.4
    seen = np.array([drive.floor.state[drive.floor.cell(p)] == FREE for p in points])
    assert seen.mean() > 0.99


def test_it_comes_home_if_it_is_to(tour):
    _, drive = tour
    assert np.hypot(*(drive.poses[-1] - drive.poses[0])[:2]) < 0.15
    world, start, rng = case(3)
    away = drive_round(world, start, rng, home=False, **QUICK)
    assert away.finished
    assert np.hypot(*(away.poses[-1] - away.poses[0])[:2]) > 0.5


def test_a_shorter_sight_makes_a_longer_drive():
    world, start, _ = case(4)
    lengths = [
        drive_round(world, start, np.random.default_rng(0), sight=s, dt=0.25).path_length
        for s in (2.0, 4.0)
    ]
    assert lengths[0] > 1.2 * lengths[1]


def test_the_route_is_its_own_other_rooms_other_routes(tour):
    world, drive = tour
    again = drive_round(world, drive.poses[0], np.random.default_rng(0), sigma_wheel=0.3)
    np.testing.assert_array_equal(again.poses, drive.poses)
    np.testing.assert_array_equal(again.ranges, drive.ranges)
    elsewhere = rooms.random_box_room(np.random.default_rng(5))
    other = drive_round(elsewhere, drive.poses[0], np.random.default_rng(0), max_time=20.0)
    n = min(len(other), len(drive), 100)
    assert np.abs(other.poses[:n, :2] - drive.poses[:n, :2]).max() > 0.5


def test_it_drives_on_its_own_map_of_walls():
    world, start = rooms.box_room(), np.array([1.0, 1.0, 0.5])
    lidar = Lidar(360, offset=0.3, max_range=8.0, sigma_range=0.02)
    slam = WallSlam(YOUBOT, lidar, start)
    rng = np.random.default_rng(6)
    drive = drive_round(world, start, rng, belief=slam, lidar=lidar, sigma_wheel=0.4, sight=3.0)
    assert drive.finished
    assert not drive.touches(world).any()
    error = np.hypot(*(drive.believed - drive.poses)[:, :2].T)
    assert error.max() < 0.05
    blind = Odometer(start)
    for u in drive.controls:
        blind.predict(u, drive.dt, None)
    assert np.hypot(*(blind.pose - drive.poses[-1])[:2]) > 5 * error[-1]


# --------------------------------------------------------------------------------- the record


def test_the_record_is_consistent(tour):
    world, drive = tour
    n = len(drive)
    assert drive.poses.shape == drive.believed.shape == (n + 1, 3)
    assert drive.ranges.shape == (n + 1, 360)
    assert drive.times.shape == (n + 1,)
    np.testing.assert_array_equal(drive.believed, drive.poses)
    step = YOUBOT.step(drive.poses[:-1], drive.driven, drive.dt)
    np.testing.assert_allclose(step, drive.poses[1:], atol=1e-12)
    np.testing.assert_allclose(
        YOUBOT.body_velocity(drive.wheel_speeds), drive.controls, atol=1e-12
    )
    exact = Lidar(360, offset=0.3, max_range=8.0).scan(world, drive.poses)
    met = np.isfinite(drive.ranges) & np.isfinite(exact)
    assert np.std(drive.ranges[met] - exact[met]) == pytest.approx(0.01, rel=0.02)
    assert drive.path_length == pytest.approx(
        np.hypot(*np.diff(drive.poses[:, :2], axis=0).T).sum()
    )


def test_commands_keep_the_limits_and_the_noise_its_covariance(tour):
    _, drive = tour
    assert np.hypot(*drive.controls[:, :2].T).max() <= 0.5 + 1e-12
    assert np.abs(drive.controls[:, 2]).max() <= 0.8 + 1e-12
    moving = np.abs(drive.controls).max(1) > 0
    noise = (drive.driven - drive.controls)[moving]
    np.testing.assert_allclose(drive.control_cov, YOUBOT.control_cov(0.3), rtol=1e-12)
    np.testing.assert_allclose(noise.var(0), np.diag(drive.control_cov), rtol=0.2)
    # Sideways, too: a mecanum platform does not have to turn before it drives.
    assert np.abs(drive.controls[:, 1]).max() > 0.2


def test_time_runs_out():
    drive = drive_round(rooms.box_room(), [1, 1, 0], np.random.default_rng(0), max_time=4.0)
    assert len(drive) == 20
    assert not drive.finished


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
    np.testing.assert_allclose(body.grown(0.1).footprint.max(0), [0.4, 0.3])


def test_a_growing_sheet_keeps_what_was_seen():
    floor = SeenFloor([0, 0, 2, 1], 0.05)
    floor.state[:] = np.random.default_rng(8).integers(0, 3, floor.state.shape)
    floor.shut[:] = np.random.default_rng(9).random(floor.shut.shape) < 0.1
    points = np.random.default_rng(10).uniform([0.01, 0.01], [1.99, 0.99], (300, 2))
    larger = floor
    for place in ([0.1, 0.5], [1.9, 0.9], [1.0, 0.5]):
        larger = module._with_room(larger, np.array(place), 0.7)
        left, right, bottom, top = larger.extent
        assert left <= place[0] - 0.7 + 1e-9
        assert right >= place[0] + 0.7 - 1e-9
        assert bottom <= place[1] - 0.7 + 1e-9
        assert top >= place[1] + 0.7 - 1e-9
    for p in points:
        assert larger.state[larger.cell(p)] == floor.state[floor.cell(p)]
        assert larger.shut[larger.cell(p)] == floor.shut[floor.cell(p)]
    assert (larger.state != 0).sum() == (floor.state != 0).sum()
    assert module._with_room(larger, np.array([1.0, 0.5]), 0.7) is larger


def test_the_guard_slows_down_turns_less_and_stands_still():
    lidar = Lidar(360, offset=0.3, max_range=8.0)
    pilot = module._Pilot(YOUBOT_BODY, lidar, np.zeros(3), 2.0, (0.5, 0.8), 0.06, 0.2, True)
    ahead = np.stack([np.full(41, 0.5), np.linspace(-1, 1, 41)], -1)
    forward = np.array([0.5, 0.0, 0.0])
    assert pilot._guarded(forward, ahead + [2.0, 0.0]).tolist() == [0.5, 0, 0]
    slow = pilot._guarded(forward, ahead)
    assert 0 < slow[0] < 0.5
    assert pilot._guarded(forward, ahead - [0.15, 0.0]).tolist() == [0, 0, 0]
    # Too near already: it may back out and not come nearer.
    assert pilot._guarded(-forward, ahead - [0.19, 0.0]).tolist() == [-0.5, 0, 0]
    # Between two walls it may drive and not turn.
    sides = np.concatenate([[[x, y]] for x in np.linspace(-2, 2, 81) for y in (-0.255, 0.255)])
    assert pilot._guarded(np.array([0.3, 0.0, 0.8]), sides).tolist() == [0.3, 0, 0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"start": [0.1, 0.1, 0]}, "start: expected a free pose"),
        ({"start": [1, 1]}, "start: expected shape"),
        ({"rng": 3}, "rng"),
        ({"dt": 0.0}, "dt"),
        ({"sight": 0.1}, "sight"),
        ({"max_speed": 0.0}, "max_speed"),
        ({"max_turn": -1.0}, "max_turn"),
        ({"margin": -0.1}, "margin"),
        ({"max_time": -1.0}, "max_time"),
        ({"sigma_wheel": -1.0}, "sigma_wheel"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    given = {"start": [1, 1, 0], "rng": np.random.default_rng(0), **arguments}
    with pytest.raises(ValueError, match=message):
        drive_round(rooms.box_room(), **given)


def test_a_body_has_a_size():
    with pytest.raises(ValueError, match="length"):
        Body(0.0, 1.0)
