"""The compiled matching of a scan to a field is the plain one, in the office of chapter 14.

To splat 2160 points takes 0.23 ms and the plain code 37: 160 times. To climb with 180 points
takes 0.065 ms and 1.5: 23 times. To search a window of 61 x 61 shifts and 27 angles with 540
points takes 4.5 ms and 51: 11 times. The seconds saved: "Kernels and their plain twins" in
book/performance_tables.md.
"""

import subprocess
import sys

import numpy as np
import pytest

from slamlab.geometry import compose, transform
from slamlab.kernels import TWINS
from slamlab.kernels import correlative as correlative_kernels
from slamlab.mapping import OccupancyGrid
from slamlab.matching import LikelihoodGrid, match_correlative, match_field
from slamlab.matching.correlative import search
from slamlab.matching.field import gauss_newton, splat
from slamlab.sensors import Lidar
from slamlab.worlds import rooms

pytestmark = pytest.mark.needs_numba(reason="there is only the plain twin")
LIDAR = Lidar(180, max_range=20.0, sigma_range=0.01)
POSE = np.array([2.0, 4.0, 0.3])


def scans(n=12):
    """Poses and end points of a drive through the office."""
    rng = np.random.default_rng(3)
    for k in range(n):
        pose = compose(POSE, [0.15 * k, 0.0, 0.05 * k])
        yield pose, LIDAR.points(LIDAR.scan(rooms.office(), pose, rng)), rng


def finite(points):
    return points[np.isfinite(points[:, 0])]


@pytest.mark.parametrize("sigma", [0.02, 0.1, 0.3])
def test_both_splat_the_same_field(sigma):
    points = np.concatenate([transform(pose, finite(some)) for pose, some, _ in scans()])
    field = LikelihoodGrid.of_points(points, sigma)
    plain = np.zeros_like(field.values)
    splat.plain(plain, field.scaled(points), sigma / field.resolution)
    assert TWINS["field.splat"] is splat.plain
    assert plain.dtype == np.float32
    np.testing.assert_allclose(plain, field.values, atol=1e-6)


def occupancy():
    grid = OccupancyGrid((240, 320), 0.05, p_hit=0.9)
    for pose, points, _ in scans():
        grid.insert(pose, np.hypot(*points.T), LIDAR)
    return LikelihoodGrid.of_occupancy(grid.log_odds, grid.resolution, grid.origin)


def test_both_climb_to_the_same_pose():
    first = transform(POSE, finite(next(iter(scans()))[1]))
    for field in (LikelihoodGrid.of_points(first), occupancy()):
        frame = np.array([field.resolution, *field.origin])
        for prior in (np.zeros((3, 3)), np.diag([50.0, 50.0, 100.0])):
            for pose, points, rng in scans():
                start = pose + rng.normal(0, [0.05, 0.05, 0.02])
                kernel, plain = start.copy(), start.copy()
                rest = field.values, frame, field.log_odds, finite(points)
                of_kernel = gauss_newton(*rest, kernel, prior, 10)
                of_plain = gauss_newton.plain(*rest, plain, prior, 10)
                np.testing.assert_allclose(plain, kernel, atol=1e-7)
                assert (plain != start).any()
                for some, other in zip(of_plain, of_kernel, strict=True):
                    np.testing.assert_allclose(some, other, rtol=1e-5, atol=1e-4)


def test_both_stop_where_the_points_hold_nothing():
    values, points = np.zeros((20, 20), np.float32), np.eye(5, 2)
    for solve in (gauss_newton, gauss_newton.plain):
        pose = np.array([0.3, 0.2, 0.1])
        H, total, left = solve(
            values, np.array([0.1, 0.0, 0.0]), False, points, pose, np.zeros((3, 3)), 10
        )
        assert pose.tolist() == [0.3, 0.2, 0.1]
        assert not H.any()
        assert (total, left) == (0.0, 5.0)


@pytest.mark.parametrize("apart", [np.inf, 8.0, 0.0])
def test_both_searches_find_the_best_score_of_the_window(apart):
    field = LikelihoodGrid.of_points(transform(POSE, finite(next(iter(scans()))[1])), 0.1, 0.1)
    values = np.rint(255 * field.values).astype(np.uint8)
    for pose, points, _ in scans(6):
        poses = compose(pose, np.column_stack([np.zeros((5, 2)), 0.05 * np.arange(-2, 3)]))
        cells = np.floor((transform(poses, finite(points)) - field.origin) / 0.1).astype(np.int64)
        kernel = search(values, cells, 13, 100, apart)
        plain = search.plain(values, cells, 13, 100, apart)
        assert kernel == plain
        assert plain[3] > 255 * 20  # summed in bytes it could not be
        if apart == 0.0:
            assert 0 < plain[4] <= plain[3]


def test_both_searches_refuse_what_scores_too_little():
    values, cells = np.full((9, 9), 100, np.uint8), np.full((3, 1, 2), 4)
    for one in (search, search.plain):
        assert one(values, cells, 2, 99, np.inf)[3] == 100
        assert one(values, cells, 2, 100, np.inf) == (-1, 0, 0, 100, 0)
        assert one(values, np.full((3, 1, 2), -(10**6)), 2, 0, 1.0)[0] == -1


def test_the_kernel_sums_more_than_a_byte_where_it_is_not_compiled():
    """NumPy adds bytes to bytes, numba does not: what NUMBA_DISABLE_JIT=1 runs."""
    score_of = getattr(correlative_kernels.score_of, "py_func", correlative_kernels.score_of)
    full = np.full((3, 3), 255, np.uint8)
    assert score_of(full, 1, np.ones((7, 2), int), 0, 0) == 7 * 255


ALONE = """
import sys
sys.modules["numba"] = None
import numpy as np
from slamlab.matching import LikelihoodGrid, match_correlative, match_field
points = np.load(sys.argv[1])
field = LikelihoodGrid.of_points(points)
found = match_correlative(field, points, [0.2, -0.1, 0.03], 0.5, 0.1, second_peak_distance=0.3)
refined = match_field(field, points, found.pose)
print(*found.pose, found.score, found.second_peak, *refined.pose)
"""


@pytest.mark.filterwarnings("ignore:numba is not installed")
def test_without_numba_the_matches_are_the_same(tmp_path):
    points = finite(next(iter(scans()))[1])
    np.save(tmp_path / "points.npy", points)
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", ALONE, str(tmp_path / "points.npy")],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    field = LikelihoodGrid.of_points(points)
    found = match_correlative(field, points, [0.2, -0.1, 0.03], 0.5, 0.1, second_peak_distance=0.3)
    here = match_field(field, points, found.pose)
    numbers = np.array(done.stdout.split(), float)
    expected = [*found.pose, found.score, found.second_peak, *here.pose]
    np.testing.assert_allclose(numbers, expected, atol=1e-6)


def test_a_field_is_looked_up_at_points_of_any_leading_axes():
    field = LikelihoodGrid(np.arange(12.0).reshape(3, 4), 0.5)
    points = np.random.default_rng(0).uniform(-0.2, 2.2, (2, 3, 2))
    for look_up in (field.value, field.gradient):
        whole = look_up(points)
        single = [[look_up(point) for point in row] for row in points]
        np.testing.assert_array_equal(whole, single)
