"""Lidar: where beams look, what a missing return is, noise, and bad input."""

import numpy as np
import pytest

from slamlab.mapping import OccupancyGrid
from slamlab.sensors import Lidar
from slamlab.worlds import BitmapWorld, WallWorld, free_poses, rooms

BOX = WallWorld.from_polygons([[0, 0], [4, 0], [4, 3], [0, 3]])
# The right half of the floor is open: beams leave the bitmap and meet nothing.
OPEN = BitmapWorld([[1, 1, 1, 1], [1, 0, 0, 0], [1, 1, 1, 1]], 1.0)


def test_full_circle_starts_ahead_and_turns_left():
    lidar = Lidar(4)
    assert lidar.beam_angles == pytest.approx([0, np.pi / 2, np.pi, -np.pi / 2])
    assert lidar.scan(BOX, [1.0, 1.0, 0.0]) == pytest.approx([3, 2, 1, 1])
    assert lidar.scan(BOX, [1.0, 1.0, np.pi / 2]) == pytest.approx([2, 1, 1, 3])


@pytest.mark.parametrize("n_beams", [1, 7, 51, 120, 720])
def test_any_number_of_beams_fills_the_circle_evenly(n_beams):
    angles = np.sort(Lidar(n_beams).beam_angles)
    gaps = np.diff([*angles, angles[0] + 2 * np.pi])
    np.testing.assert_allclose(gaps, 2 * np.pi / n_beams)
    # P5's loop runs while i < 360 / resolution, in whole degrees: 7 degrees leave a gap.
    assert 360 - (360 // 7) * 7 == 3


def test_a_part_of_the_circle_is_symmetric_and_includes_its_edges():
    assert Lidar(3, np.pi).beam_angles == pytest.approx([-np.pi / 2, 0, np.pi / 2])
    assert Lidar(1, 1.0).beam_angles == pytest.approx([0.0])


def test_turning_the_robot_by_one_step_shifts_the_scan():
    lidar = Lidar(36)
    pose = np.array([1.3, 0.9, 0.2])
    turned = lidar.scan(BOX, pose + [0, 0, 2 * np.pi / 36])
    np.testing.assert_allclose(turned, np.roll(lidar.scan(BOX, pose), -1))


def test_a_missing_return_keeps_its_place():
    scan = Lidar(4).scan(OPEN, [1.5, 1.5, 0.0])
    assert scan.tolist() == [np.inf, 0.5, 0.5, 0.5]
    short = Lidar(4, max_range=0.4).scan(OPEN, [1.5, 1.5, 0.0])
    assert np.isinf(short).all()
    # As P5's list has it, a beam without a return adds nothing and the others move up.
    as_printed = [r for r in scan if np.isfinite(r)]
    assert len(as_printed) == 3


@pytest.mark.parametrize("rng", [None, np.random.default_rng(1)])
def test_what_stands_just_at_the_greatest_range_is_not_seen(rng):
    wall = WallWorld([[[2.0, -3.0], [2.0, 3.0]]])
    for reach, seen in ((2.0, False), (2.0 + 1e-9, True)):
        lidar = Lidar(1, 1.0, max_range=reach)
        scan = lidar.scan(wall, [0.0, 0.0, 0.0], rng)
        assert np.isfinite(scan).all() == np.isfinite(lidar.points(scan)).all() == seen


def test_many_poses_at_once_equal_one_after_the_other():
    world = rooms.thesis_room()
    poses = free_poses(world, 12, np.random.default_rng(1), 0.3)
    lidar = Lidar(90, 4.0, offset=0.1)
    together = lidar.scan(world, poses.reshape(3, 4, 3))
    assert together.shape == (3, 4, 90)
    one_by_one = [lidar.scan(world, pose) for pose in poses]
    np.testing.assert_array_equal(together.reshape(12, 90), one_by_one)


def test_points_of_a_scan_lie_on_the_walls():
    lidar = Lidar(60, offset=0.2)
    pose = [1.0, 1.2, 0.7]
    points = lidar.points(lidar.scan(BOX, pose), pose)
    assert BOX.clearance(points) == pytest.approx(0, abs=1e-9)
    without_offset = Lidar(60).points(lidar.scan(BOX, pose), pose)
    assert BOX.clearance(without_offset).max() > 0.1


def test_noise_has_its_sigma_and_never_a_negative_range():
    rng = np.random.default_rng(2)
    poses = np.tile([1.0, 1.0, 0.0], (500, 1))
    noisy = Lidar(40, sigma_range=0.05).scan(BOX, poses, rng)
    errors = noisy - Lidar(40).scan(BOX, poses)
    assert errors.std() == pytest.approx(0.05, rel=0.03)
    assert abs(errors.mean()) < 0.002
    close = Lidar(40, sigma_range=2.0).scan(BOX, poses, rng)
    assert close.min() == 0.0


def test_lost_readings_are_nan_at_their_rate_and_a_noisy_far_one_is_no_hit():
    rng = np.random.default_rng(3)
    poses = np.tile([1.0, 1.0, 0.0], (500, 1))
    scans = Lidar(40, p_miss=0.1).scan(BOX, poses, rng)
    assert np.isnan(scans).mean() == pytest.approx(0.1, abs=0.01)
    limited = Lidar(40, max_range=2.0, sigma_range=0.5).scan(BOX, poses, rng)
    assert limited[np.isfinite(limited)].max() <= 2.0


def test_same_seed_same_scan():
    lidar = Lidar(40, sigma_range=0.1, p_miss=0.2)
    first, again = (lidar.scan(BOX, [1, 1, 0], np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_a_scan_drawn_in_a_map_frees_the_floor_and_hits_the_walls():
    lidar = Lidar(720, max_range=10.0)
    grid = OccupancyGrid((60, 80), 0.05, grow=False)
    poses = [[1.0, 1.0, 0.0], [3.0, 2.0, 1.0]]
    grid.insert(poses, lidar.scan(BOX, poses), lidar)
    assert (grid.probability[1:-1, 1:-1] < 0.5).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Lidar(0), "n_beams: expected at least 1, got 0"),
        (lambda: Lidar(3.5), "n_beams: expected a whole number"),
        (
            lambda: Lidar(4, field_of_view=7.0),
            "field_of_view: expected a positive number of at most",
        ),
        (lambda: Lidar(4, max_range=0.0), "max_range: expected a positive number"),
        (lambda: Lidar(4, sigma_range=-0.1), "sigma_range: expected a number of at least 0"),
        (lambda: Lidar(4, p_miss=1.1), "p_miss: expected a number in"),
        (lambda: Lidar(4, p_miss=0.1).scan(BOX, [1, 1, 0]), "rng: expected a numpy.random"),
        (lambda: Lidar(4).scan(BOX, [1, 1]), "poses: expected shape"),
        (lambda: Lidar(4).scan(BOX, [1, np.nan, 0]), "poses: expected finite"),
        (
            lambda: Lidar(4).scan(BOX, [[1, 1, 0], [9, 1, 0]]),
            r"poses: expected the sensor in free space, at index \(1,\) it stands at \(9, 1\)",
        ),
        (lambda: Lidar(4).scan(rooms.thesis_room(), [1.0, 2.8, 0]), "inside an obstacle"),
        (lambda: Lidar(4).points([1, 2, 3]), "ranges: expected shape"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
