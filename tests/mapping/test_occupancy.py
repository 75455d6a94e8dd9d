"""Occupancy grid: the cells of every beam, against a finely sampled walk."""

import numpy as np
import pytest

from slamlab.logs import ScanGeometry
from slamlab.mapping import OccupancyGrid
from slamlab.worlds import BitmapWorld


def walked(a, b, n=5001):
    """Cells under n points of the segment from a to b: the naive way."""
    points = a + np.linspace(0, 1, n)[:, None] * (b - a)
    return {tuple(cell) for cell in np.unique(np.floor(points).astype(int), axis=0)}


def freed(a, b):
    """Cells that a beam from a to b frees, as column and row."""
    grid = OccupancyGrid((20, 20), 1.0, (-10, -10), grow=False)
    length, angle = np.hypot(*(b - a)), np.arctan2(*(b - a)[::-1])
    grid.insert([*a, angle], [np.inf], ScanGeometry([0.0], max_range=length))
    return {(c - 10, r - 10) for r, c in np.argwhere(grid.log_odds < 0)}


def one_a_step(a, b):
    """The wrong form: one point a cell of the longer side, which skips cells at corners."""
    n = int(np.abs(b - a).max()) + 1
    points = a + np.linspace(0, 1, n + 1)[:, None] * (b - a)
    return {tuple(cell) for cell in np.floor(points).astype(int)}


def test_beams_cross_exactly_the_cells_of_the_segment():
    rng = np.random.default_rng(3)
    skipped = 0
    for _ in range(100):
        a, b = rng.uniform(-8, 8, (2, 2))
        due = walked(a, b)
        found = freed(a, b)
        # The walk may miss a corner that it cuts by less than its step, never the other way.
        assert due <= found
        assert len(found) <= len(due) + 2
        skipped += not due <= one_a_step(a, b)
    assert skipped > 50


def test_axis_parallel_beams_and_beams_within_one_cell():
    start = np.array([0.5, 0.5])
    assert freed(start, np.array([3.5, 0.5])) == {(0, 0), (1, 0), (2, 0), (3, 0)}
    assert freed(start, np.array([0.5, -2.5])) == {(0, 0), (0, -1), (0, -2), (0, -3)}
    assert freed(start, np.array([0.9, 0.1])) == {(0, 0)}


def test_a_scan_frees_what_it_crossed_and_fills_where_it_ended():
    grid = OccupancyGrid((1, 5), 0.5, origin=(0.0, 0.0), grow=False)
    grid.insert([0.25, 0.25, 0.0], [1.5], ScanGeometry([0.0]))
    assert grid.probability.round(3).tolist() == [[0.4, 0.4, 0.4, 0.7, 0.5]]
    assert grid.entropy[0, 4] == pytest.approx(1.0)
    assert (grid.entropy[0, :4] < 1.0).all()


def test_within_one_scan_a_cell_counts_once_and_a_hit_wins():
    lidar = ScanGeometry([0.0, 0.0, 0.0])
    grid = OccupancyGrid((1, 4), 1.0, grow=False)
    grid.insert([0.5, 0.5, 0.0], [2.0, 3.0, 3.0], lidar)
    assert grid.probability.round(3).tolist() == [[0.4, 0.4, 0.7, 0.7]]


def test_evidence_adds_up_and_is_clamped():
    grid = OccupancyGrid((1, 3), 1.0, clamp=0.9, grow=False)
    lidar = ScanGeometry([0.0])
    grid.insert([0.5, 0.5, 0.0], [2.0], lidar)
    grid.insert([0.5, 0.5, 0.0], [2.0], lidar)
    twice = 2 * np.log(0.7 / 0.3)
    assert grid.log_odds[0, 2] == pytest.approx(min(twice, np.log(9)))
    for _ in range(20):
        grid.insert([0.5, 0.5, 0.0], [2.0], lidar)
    assert grid.probability.round(9).tolist() == [[0.1, 0.1, 0.9]]


def test_many_scans_at_once_equal_one_after_the_other():
    rng = np.random.default_rng(2)
    lidar = ScanGeometry(np.linspace(-np.pi, np.pi, 90, endpoint=False), offset=0.2)
    poses, ranges = rng.uniform(-2, 2, (7, 3)), rng.uniform(0.5, 6.0, (7, 90))
    at_once, one_by_one = (OccupancyGrid((200, 200), 0.1, (-10, -10)) for _ in range(2))
    at_once.insert(poses, ranges, lidar)
    for pose, scan in zip(poses, ranges, strict=True):
        one_by_one.insert(pose, scan, lidar)
    np.testing.assert_array_equal(at_once.log_odds, one_by_one.log_odds)
    assert np.count_nonzero(at_once.log_odds) > 1000


def test_the_sheet_grows_and_keeps_what_it_holds():
    lidar = ScanGeometry([0.0, np.pi / 2, np.pi, -np.pi / 2])
    large = OccupancyGrid((80, 80), 0.5, (-20, -20))
    small = OccupancyGrid((2, 2), 0.5, (-0.5, -0.5))
    for pose in ([0.1, 0.1, 0.0], [4.0, -3.0, 0.5]):
        for grid in (large, small):
            grid.insert(pose, [5.0, 3.0, 6.0, 2.0], lidar)
    left, _, bottom, _ = small.extent
    column, row = round((left + 20) / 0.5), round((bottom + 20) / 0.5)
    rows, columns = small.shape
    window = large.log_odds[row : row + rows, column : column + columns]
    np.testing.assert_allclose(window, small.log_odds)
    assert np.count_nonzero(large.log_odds) == np.count_nonzero(small.log_odds)


def test_a_sheet_that_may_not_grow_cuts_the_beams():
    grid = OccupancyGrid((1, 2), 1.0, grow=False)
    grid.insert([0.5, 0.5, 0.0], [10.0], ScanGeometry([0.0]))
    assert grid.shape == (1, 2)
    assert grid.probability.round(3).tolist() == [[0.4, 0.4]]


def test_a_beam_that_met_nothing_frees_and_a_lost_reading_says_nothing():
    lidar = ScanGeometry([0.0], max_range=3.0)
    for nothing in (3.0, 99.0, np.inf):
        quiet, told = (OccupancyGrid((1, 5), 1.0) for _ in range(2))
        quiet.insert([0.5, 0.5, 0.0], [nothing], lidar, free_missing=False)
        assert not quiet.log_odds.any()
        told.insert([0.5, 0.5, 0.0], [nothing], lidar)
        assert told.probability.round(3).tolist() == [[0.4, 0.4, 0.4, 0.4, 0.5]]
    lost = OccupancyGrid((1, 5), 1.0)
    lost.insert([0.5, 0.5, 0.0], [np.nan], lidar)
    assert not lost.log_odds.any()


def test_beams_beyond_the_trusted_range_free_and_do_not_hit():
    grid = OccupancyGrid((1, 5), 1.0)
    grid.insert([0.5, 0.5, 0.0], [4.0], ScanGeometry([0.0]), max_range=2.0)
    assert grid.probability.round(3).tolist() == [[0.4, 0.4, 0.4, 0.5, 0.5]]


def test_the_map_turns_with_the_world():
    lidar = ScanGeometry(np.linspace(-1.0, 1.0, 20), offset=0.3)
    ranges = np.linspace(2.0, 4.0, 20)
    straight = OccupancyGrid((100, 100), 0.1, (-5, -5))
    turned = OccupancyGrid((100, 100), 0.1, (-5, -5))
    straight.insert([0.02, 0.03, 0.1], ranges, lidar)
    turned.insert([-0.03, 0.02, 0.1 + np.pi / 2], ranges, lidar)
    # A quarter turn takes column and row (c, r) to (n - 1 - r, c).
    np.testing.assert_allclose(turned.log_odds.T[::-1], straight.log_odds)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: OccupancyGrid((0, 4), 1.0), "shape: expected at least 1"),
        (lambda: OccupancyGrid((4, 4), 0.0), "resolution: expected a number"),
        (lambda: OccupancyGrid((4, 4), 1.0, p_hit=0.3), "p_hit: expected a number in"),
        (lambda: OccupancyGrid((4, 4), 1.0, p_miss=0.6), "p_miss: expected a number in"),
        (lambda: OccupancyGrid((4, 4), 1.0, clamp=1.5), "clamp: expected a number in"),
    ],
)
def test_bad_parameters_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(
    ("pose", "ranges", "options", "message"),
    [
        ([0, 0, np.nan], [1.0], {}, "pose: expected finite"),
        ([0, 0, 0], [1.0, 2.0], {}, "ranges: expected shape"),
        ([0, 0, 0], [-1.0], {}, "ranges: expected distances, got -1"),
        ([0, 0, 0], [np.inf], {}, "max_range: expected a finite range"),
        ([0, 0, 0.3], [1e9], {}, "ranges: expected beams near the map, it would have to grow"),
        ([1e300, 0, 0], [1.0], {}, "ranges: expected beams near the map"),
    ],
)
def test_a_bad_scan_is_named_and_changes_nothing(pose, ranges, options, message):
    grid = OccupancyGrid((3, 3), 1.0)
    with pytest.raises(ValueError, match=message):
        grid.insert(pose, ranges, ScanGeometry([0.0]), **options)
    assert not grid.log_odds.any()


def test_a_map_saved_for_ros_comes_back_as_a_world(tmp_path):
    from PIL import Image

    grid = OccupancyGrid((3, 4), 0.25, (-1.0, 2.0), grow=False)
    grid.log_odds[0] = 2.0
    grid.log_odds[1, :3] = -2.0
    grid.save_ros(tmp_path / "room.yaml")
    world = BitmapWorld.from_file(tmp_path / "room.yaml")
    # Occupied below, free in the middle, unknown elsewhere: where a robot must not go.
    assert world.occupied.tolist() == [[True] * 4, [False] * 3 + [True], [True] * 4]
    assert world.resolution == 0.25
    assert world.origin.tolist() == [-1.0, 2.0]
    image = np.asarray(Image.open(tmp_path / "room.pgm"))
    assert image.tolist() == [[205] * 4, [254] * 3 + [205], [0] * 4]
    with pytest.raises(ValueError, match="path: expected a name ending in .yaml"):
        grid.save_ros(tmp_path / "room.png")


def test_entropy_falls_as_the_room_is_seen():
    grid = OccupancyGrid((40, 40), 0.1, grow=False)
    lidar = ScanGeometry(np.linspace(-3, 3, 60))
    totals = [grid.entropy.sum()]
    for _ in range(3):
        grid.insert([2.0, 2.0, 0.0], np.full(60, 1.5), lidar)
        totals.append(grid.entropy.sum())
    assert totals[0] == grid.log_odds.size
    assert (np.diff(totals) < 0).all()


def test_entropy_is_the_formula_and_finite_for_cells_that_are_certain():
    grid = OccupancyGrid((1, 4), 1.0)
    grid.log_odds[0] = [0.0, 0.7, -2.0, 900.0]
    p = grid.probability[0, :3]
    due = -(p * np.log2(p) + (1 - p) * np.log2(1 - p))
    assert grid.entropy[0] == pytest.approx([*due, 0.0])


def test_compiled_insertion_equals_a_plain_loop_over_cells():
    rng = np.random.default_rng(8)
    lidar = ScanGeometry(rng.uniform(-3, 3, 40), max_range=6.0)
    pose, ranges = np.array([0.3, -0.2, 0.4]), rng.uniform(0.2, 8.0, 40)
    grid = OccupancyGrid((30, 30), 0.4, (-6, -6), grow=False)
    grid.insert(pose, ranges, lidar)
    angles, hits = pose[2] + lidar.beam_angles, ranges < 6
    ends = pose[:2] + np.minimum(ranges, 6)[:, None] * np.stack(
        [np.cos(angles), np.sin(angles)], -1
    )
    a, b = (pose[:2] + 6) / 0.4, (ends + 6) / 0.4
    ended = {tuple(np.floor(e).astype(int)) for e in b[hits]}
    crossed = set().union(*(walked(a, e) for e in b)) - ended
    there = {(c, r) for r, c in np.argwhere(grid.log_odds > 0)}
    freed_cells = {(c, r) for r, c in np.argwhere(grid.log_odds < 0)}
    assert there == {(c, r) for c, r in ended if 0 <= c < 30 and 0 <= r < 30}
    on_sheet = {(c, r) for c, r in crossed if 0 <= c < 30 and 0 <= r < 30}
    # A sampled walk may miss a cell that is cut by a hair.
    assert on_sheet <= freed_cells
    assert len(freed_cells - on_sheet) <= 3


def test_absurd_numbers_leave_a_fixed_sheet_alone():
    grid = OccupancyGrid((3, 3), 1.0, grow=False)
    grid.insert([1.5, 1.5, 0.0], [1e300], ScanGeometry([0.0]))
    assert (grid.log_odds[1] < 0).tolist() == [False, True, True]
    before = grid.log_odds.copy()
    grid.insert([[1e300, 0.0, 0.0], [-7.0, 1.5, 0.0]], [[1.0], [2.0]], ScanGeometry([0.0]))
    np.testing.assert_array_equal(grid.log_odds, before)
    # From outside the sheet a beam still frees what it crosses on it.
    grid.insert([-7.0, 0.5, 0.0], [20.0], ScanGeometry([0.0]))
    assert (grid.log_odds[0] < 0).all()


def test_the_image_of_a_large_map_is_that_of_its_probabilities():
    grid = OccupancyGrid((700, 3), 0.1)
    grid.log_odds[:] = np.random.default_rng(0).normal(0.0, 1.0, (700, 3))
    p, image = grid.probability[::-1], grid.to_image()
    np.testing.assert_array_equal(image == 0, p > 0.65)
    np.testing.assert_array_equal(image == 254, p < 0.35)
    np.testing.assert_array_equal(image == 205, (p >= 0.35) & (p <= 0.65))
    assert not np.array_equal(image[::-1], image)
