"""P5, chapters 3.2.2 and 3.2.4: `Scan` and `distancetodots` as printed, beside exact casting."""

import numpy as np
import pytest

from slamlab.printed.p5 import dots_as_printed, scan_as_printed
from slamlab.sensors import Lidar, Sonar
from slamlab.worlds import BitmapWorld, free_poses, rooms

ROOM = rooms.thesis_room()


def centre_of(column, row):
    return np.array([column + 0.5, row + 0.5]) * ROOM.resolution


def exact(column, row, resolution):
    """The same beams, up first and clockwise, to the border of the cell (px)."""
    angles = np.pi / 2 - np.deg2rad(np.arange(0, 360, resolution))
    return ROOM.cast(centre_of(column, row), angles) / ROOM.resolution


def places(n, seed=1):
    poses = free_poses(ROOM, n, np.random.default_rng(seed), 0.1)
    return np.floor(poses[:, :2] / ROOM.resolution).astype(int)


def test_scan_measures_to_pixel_centres_most_of_the_time():
    gaps = np.concatenate(
        [scan_as_printed(ROOM.occupied, *p, 3) - exact(*p, 3) for p in places(40)]
    )
    # From centre to centre is up to a diagonal longer than to the border, and it is rounded.
    assert np.median(gaps) == pytest.approx(0.5, abs=0.2)
    assert (np.abs(gaps) < 2).mean() > 0.98


def test_scan_slips_past_corners_that_the_exact_beam_meets():
    gaps = np.concatenate(
        [scan_as_printed(ROOM.occupied, *p, 3) - exact(*p, 3) for p in places(120)]
    )
    missed = gaps > 3
    assert 0 < missed.mean() < 0.02
    assert gaps.max() > 10


def test_scan_leaks_through_a_diagonal_wall_and_the_exact_beam_does_not():
    cells = np.zeros((101, 101), bool)
    cells[[0, -1]] = cells[:, [0, -1]] = True
    cells[np.arange(101), np.arange(101)] = True
    world = BitmapWorld(cells, 1.0)
    walked = np.array(scan_as_printed(cells, 30, 70, 3))
    cast = world.cast([30.5, 70.5], np.pi / 2 - np.deg2rad(np.arange(0, 360, 3)))
    end = np.array([30.5, 70.5]) + cast[:, None] * np.stack(
        [np.sin(np.deg2rad(np.arange(0, 360, 3))), np.cos(np.deg2rad(np.arange(0, 360, 3)))], -1
    )
    # Exact beams stay above the diagonal; some of the walk's go through to the far wall.
    assert (end[:, 1] - end[:, 0] > -1.5).all()
    assert (walked - cast > 5).sum() >= 5


@pytest.mark.parametrize(
    ("resolution", "n", "covered"), [(3, 120, 360), (7, 51, 357), (11, 32, 352)]
)
def test_a_resolution_that_does_not_divide_360_leaves_a_gap(resolution, n, covered):
    scan = scan_as_printed(ROOM.occupied, 200, 200, resolution)
    assert len(scan) == n
    assert n * resolution == covered
    # ... and the dots are then drawn 360 // n degrees apart.
    assert 360 // n == resolution
    assert np.diff(np.sort(Lidar(n).beam_angles)).max() == pytest.approx(2 * np.pi / n)


def test_more_than_360_beams_are_drawn_on_one_ray():
    dots = dots_as_printed(np.full(720, 50.0))
    assert np.ptp(dots, axis=0) == pytest.approx(0)
    right = Lidar(720).points(np.full(720, 50.0))
    assert np.ptp(right, axis=0) == pytest.approx([100, 100])


def test_dots_agree_with_the_scan_in_direction():
    column, row = 180, 200
    dots = dots_as_printed(scan_as_printed(ROOM.occupied, column, row, 3))
    hits = centre_of(column, row) + ROOM.resolution * dots
    # The map of P5 in the noise-free case: dots within two pixels of the walls.
    assert (ROOM.clearance(hits) < 2 * ROOM.resolution).mean() > 0.98
    mirrored = centre_of(column, row) + ROOM.resolution * dots * [-1, 1]
    assert (ROOM.clearance(mirrored) < 2 * ROOM.resolution).mean() < 0.7


@pytest.mark.parametrize("room", [rooms.thesis_room, rooms.thesis_room_two])
def test_the_map_of_dots_agrees_with_the_room_if_the_poses_are_exact(room):
    world = room()
    inside_out = BitmapWorld(~world.occupied, world.resolution)

    def off(turn):
        """Distances (px) of the dots of 30 scans from the face of the nearest wall."""
        found = []
        for x, y, _ in free_poses(world, 30, np.random.default_rng(2), 0.1):
            column, row = int(x / 0.01), int(y / 0.01)
            dots = dots_as_printed(scan_as_printed(world.occupied, column, row, 3))
            c, s = np.cos(turn), np.sin(turn)
            points = centre_of(column, row) + 0.01 * dots @ np.array([[c, s], [-s, c]])
            on_sheet = np.clip(points, 0, 3.9999)
            found.append(world.clearance(on_sheet) + inside_out.clearance(on_sheet))
        return np.concatenate(found) / 0.01

    assert off(0.0).max() < 2
    # Five degrees of error in the heading, and the dots leave the walls.
    assert np.mean(off(np.deg2rad(5)) > 2) > 0.5


def test_a_beam_that_hits_nothing_throws_or_shifts_all_later_ones():
    open_room = ROOM.occupied.copy()
    open_room[190:210, 390:] = False
    with pytest.raises(IndexError, match="beam 30 leaves the picture"):
        scan_as_printed(open_room, 200, 200, 3)
    whole = scan_as_printed(ROOM.occupied, 200, 200, 3)
    shifted = scan_as_printed(open_room, 200, 200, 3, guarded=True)
    lost = len(whole) - len(shifted)
    assert lost >= 1
    assert shifted[:30] == whole[:30]
    assert shifted[60:] == whole[60 + lost :]
    assert shifted[60:] != whole[60:-lost]
    # Ours keeps its place: the missing beams are inf, the others are where they were.
    ours = [
        Lidar(120).scan(BitmapWorld(c, 0.01), [2.005, 2.005, 0])
        for c in (ROOM.occupied, open_room)
    ]
    assert np.isinf(ours[1]).sum() >= 1
    there = np.isfinite(ours[1])
    np.testing.assert_array_equal(ours[0][there], ours[1][there])


def test_the_printed_scan_ignores_the_heading():
    # `Scan(x, y)` has no heading: the text says that beam 0 is the robot's zero degrees.
    heading = np.deg2rad(30)
    ours = [Lidar(120).scan(ROOM, [*centre_of(200, 200), h]) for h in (0.0, heading)]
    assert np.abs(np.roll(ours[0], -10) - ours[1]).max() < 1e-9
    assert np.abs(ours[0] - ours[1]).max() > 0.5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: scan_as_printed([0, 1], 0, 0, 3), "occupied: expected shape"),
        (lambda: scan_as_printed([[0, 1]], 0, 0, 0), "resolution: expected at least 1"),
        (lambda: scan_as_printed([[0, 1]], 0.5, 0, 3), "column: expected a whole number"),
        (lambda: dots_as_printed([]), "distances: expected at least one"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_sonar_differs_from_a_lidar_even_when_it_turns_perfectly():
    # Section 1.2.1: "about the same as a lidar's, but the robot has to turn at every degree".
    poses = free_poses(ROOM, 20, np.random.default_rng(3), 0.3)
    cone, thin = Sonar(max_range=9.0), Sonar(0.0, 9.0, n_rays=1)
    due = Lidar(360).scan(ROOM, poses)
    share = [
        np.mean([np.abs(s.sweep(ROOM, p, 360) - d) > 0.1 for p, d in zip(poses, due, strict=True)])
        for s in (cone, thin)
    ]
    assert share[0] > 0.2
    assert share[1] == 0


def test_scan_asks_for_opacity_and_not_for_colour():
    # cl.A == 255 holds for every pixel of a picture without transparency, the lidar's own too.
    assert scan_as_printed(np.ones((9, 9)), 4, 4, 3) == [0] * 120


def test_dots_lose_the_remainder_of_360_degrees():
    scan = scan_as_printed(ROOM.occupied, 185, 195, 19)
    x, y = dots_as_printed(scan)[-1]
    drawn, due = np.rad2deg(np.arctan2(x, y)) % 360, 17 * 19
    assert len(scan) == 18
    assert drawn - due == pytest.approx(17.0)
    # ours: as many beams, evenly spread, so the last one is as far from the first as any other
    assert np.diff(np.unwrap(Lidar(18).beam_angles)) == pytest.approx(np.deg2rad(20.0))
