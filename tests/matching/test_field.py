"""Likelihood fields and Hector's Gauss-Newton: gradients, fixed points, equivariance."""

import numpy as np
import pytest

from slamlab.geometry import compose, inverse, transform
from slamlab.matching import LikelihoodGrid, match_field, voxel_downsample
from slamlab.sensors import Lidar
from slamlab.worlds import rooms

LIDAR = Lidar(360, max_range=20.0, sigma_range=0.01)
POSE = np.array([2.0, 4.0, 0.3])


def scan(pose, seed=0):
    rng = np.random.default_rng(seed)
    return voxel_downsample(LIDAR.points(LIDAR.scan(rooms.office(), pose, rng)))


def random_field(log_odds=False):
    rng = np.random.default_rng(4)
    return LikelihoodGrid(rng.normal(size=(12, 17)), 0.3, (-1.0, 0.7), log_odds=log_odds)


def inner_points(field, n=200):
    """Points that are well inside one square of four centres, where M has no kink."""
    rng = np.random.default_rng(5)
    cells = rng.integers(1, [14, 9], (n, 2)) + 0.5 + rng.uniform(0.05, 0.95, (n, 2))
    return field.origin + field.resolution * cells


def central_differences(value, points, h=1e-6):
    steps = h * np.eye(2)
    return np.stack([(value(points + s) - value(points - s)) / (2 * h) for s in steps], -1)


def released_gradient(field, points):
    """The gradient of hector_slam as released: the fractions of x and y change places."""
    x, y = ((points - field.origin) / field.resolution - 0.5).T
    c, r = np.floor(x).astype(int), np.floor(y).astype(int)
    a, b, m = x - c, y - r, field.values
    dx = (1 - a) * (m[r, c + 1] - m[r, c]) + a * (m[r + 1, c + 1] - m[r + 1, c])
    dy = (1 - b) * (m[r + 1, c] - m[r, c]) + b * (m[r + 1, c + 1] - m[r, c + 1])
    return np.stack([dx, dy], -1) / field.resolution


@pytest.mark.parametrize("log_odds", [False, True])
def test_the_gradient_is_the_derivative_of_the_value(log_odds):
    field = random_field(log_odds)
    points = inner_points(field)
    due = central_differences(field.value, points)
    np.testing.assert_allclose(field.gradient(points), due, atol=1e-7)


def test_the_released_gradient_is_not():
    field = random_field()
    points = inner_points(field)
    due = central_differences(field.value, points)
    assert np.abs(released_gradient(field, points) - due).max() > 0.5
    uphill = (released_gradient(field, points) * due).sum(-1)
    assert 0.01 < (uphill < 0).mean() < 0.3


def test_values_belong_to_cell_centres_and_nothing_lies_beyond_the_sheet():
    field = LikelihoodGrid([[1.0, 3.0], [5.0, 7.0]], 2.0, (10.0, 20.0))
    centres = [[11, 21], [13, 21], [11, 23], [13, 23]]
    assert field.value(centres).tolist() == [1, 3, 5, 7]
    assert field.value([12.0, 22.0]) == 4.0
    far = [[0.0, 0.0], [1e12, -1e12]]
    assert field.value(far).tolist() == [0, 0]
    assert not field.gradient(far).any()
    assert LikelihoodGrid([[3.0]], 1.0, log_odds=True).value([9.0, 9.0]) == 0.5


def test_a_point_field_is_the_gaussian_of_the_distance():
    points = np.random.default_rng(1).uniform(-2, 2, (30, 2))
    field = LikelihoodGrid.of_points(points, sigma=0.2, resolution=0.1)
    rows, columns = field.values.shape
    r, c = np.mgrid[:rows, :columns]
    centres = field.origin + 0.1 * (np.stack([c, r], -1) + 0.5)
    distance = np.linalg.norm(centres[:, :, None] - points, axis=-1).min(-1)
    due = np.exp(-0.5 * (distance / 0.2) ** 2)
    np.testing.assert_allclose(field.values, due, atol=np.exp(-0.5 * 3.5**2))
    near = distance < 0.6
    np.testing.assert_allclose(field.values[near], due[near], atol=1e-6)


@pytest.mark.parametrize("sigma", [1e-4, 0.01, 0.03, 0.1, 0.285, 0.287, 1.0, 3.0])
def test_a_point_field_is_right_for_wide_and_for_sharp_slopes(sigma):
    """In cells of 1 m: of a slope far below a cell, factors one after the other overflow."""
    points = np.random.default_rng(3).uniform(0, 12, (30, 2))
    points[0] = 3.5, 4.5  # upon the centre of a cell
    field = LikelihoodGrid.of_points(points, sigma, 1.0)
    centres = field.centres()
    squared = ((centres[..., None, :] - points) ** 2).sum(-1).min(-1)
    due = np.where(squared < (3 * sigma) ** 2, np.exp(-0.5 * squared / sigma**2), 0.0)
    seen = np.where(squared < (3 * sigma) ** 2, field.values, 0.0)
    np.testing.assert_allclose(seen, due, atol=1e-6)
    assert np.isfinite(field.values).all()
    assert field.values.max() == 1.0


def test_the_pyramid_goes_from_coarse_to_fine():
    field = LikelihoodGrid.of_points(scan(POSE))
    levels = field.pyramid(3)
    assert [round(level.resolution, 3) for level in levels] == [0.2, 0.1, 0.05]
    assert [round(level.sigma, 3) for level in levels] == [0.4, 0.2, 0.1]
    assert levels[-1] is field


def test_a_perfect_match_does_not_move():
    """Where M = 1 at every point the residuals are 0, so is the step (12)."""
    corners = np.array([[0.025, 0.025], [3.025, 0.025], [0.025, 2.025], [1.525, 3.025]])
    field = LikelihoodGrid.of_points(corners)
    match = match_field(field, corners, np.zeros(3))
    assert match.score == pytest.approx(1.0, abs=1e-12)
    assert np.abs(match.pose).max() < 1e-12


@pytest.mark.parametrize("seed", range(8))
def test_a_scan_finds_its_place_from_a_quarter_of_a_metre(seed):
    rng = np.random.default_rng(seed)
    motion = rng.uniform(-1, 1, 3) * [0.2, 0.2, 0.15]
    levels = LikelihoodGrid.of_points(scan(POSE)).pyramid(3)
    match = match_field(levels, scan(compose(POSE, motion), seed + 1), np.zeros(3))
    assert np.abs(match.pose - motion).max() < 0.03
    assert match.score > 0.8


def test_a_field_of_the_world_moved_by_whole_cells_gives_the_moved_pose():
    a, b = scan(POSE), scan(compose(POSE, [0.1, 0.05, 0.05]), 1)
    found = match_field(LikelihoodGrid.of_points(a), b, np.zeros(3))
    for frame in ([3.0, -2.0, 0.0], [0.25, 1.5, np.pi / 2], [0.0, 0.0, np.pi]):
        moved = match_field(LikelihoodGrid.of_points(transform(frame, a)), b, frame)
        np.testing.assert_allclose(compose(inverse(frame), moved.pose), found.pose, atol=1e-5)


def test_hector_climbs_an_occupancy_map():
    from slamlab.mapping import OccupancyGrid

    rng = np.random.default_rng(0)
    grid = OccupancyGrid((160, 240), 0.05, p_hit=0.9)
    ranges = LIDAR.scan(rooms.office(), np.tile(POSE, (3, 1)), rng)
    grid.insert(np.tile(POSE, (3, 1)), ranges, LIDAR)
    field = LikelihoodGrid(grid.log_odds, grid.resolution, grid.origin, log_odds=True)
    match = match_field(field, scan(POSE, 9), compose(POSE, [0.08, -0.06, 0.04]))
    assert np.abs(match.pose - POSE).max() < 0.02


def test_a_prior_pulls_towards_the_guess():
    field, points = LikelihoodGrid.of_points(scan(POSE)), scan(POSE, 1)
    guess = np.array([0.1, 0.0, 0.0])
    free = match_field(field, points, guess)
    held = match_field(field, points, guess, prior_cov=1e-6 * np.eye(3))
    assert abs(free.pose[0]) < 0.02
    assert abs(held.pose[0] - 0.1) < 0.005


def test_the_covariance_is_wide_along_a_wall():
    wall = np.column_stack([np.linspace(-4, 4, 81), np.ones(81)])
    match = match_field(LikelihoodGrid.of_points(wall), wall[20:60], [0.0, 0.05, 0.02])
    sigma, direction = match.weakest_direction
    assert sigma > 1.0
    assert abs(direction) < 0.05
    assert np.sqrt(match.cov[1, 1]) < 0.05


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: LikelihoodGrid(np.zeros((0, 3)), 1.0), "values"),
        (lambda: LikelihoodGrid([[np.nan]], 1.0), "values"),
        (lambda: LikelihoodGrid([[1.0]], 0.0), "resolution"),
        (lambda: LikelihoodGrid.of_points(np.full((3, 2), np.nan)), "points: expected at least 1"),
        (
            lambda: LikelihoodGrid.of_points([[0.0, 0.0], [1e6, 1e6]]),
            "points: expected them on one floor",
        ),
        (lambda: LikelihoodGrid.of_points([[0.0, 0.0]], sigma=0.0), "sigma"),
        (lambda: LikelihoodGrid.of_points([[0.0, 0.0]]).pyramid(0), "levels"),
        (lambda: match_field([], [[0.0, 0.0]] * 3, np.zeros(3)), "field"),
        (lambda: match_field("map", [[0.0, 0.0]] * 3, np.zeros(3)), "field"),
        (lambda: match_field(random_field(), [[0.0, 0.0]], np.zeros(3)), "points"),
        (lambda: match_field(random_field(), [[0.0, 0.0]] * 3, [0, 0]), "guess"),
        (lambda: match_field(random_field(), np.eye(3, 2), np.zeros(3), -np.eye(3)), "prior_cov"),
        (lambda: match_field(random_field(), np.eye(3, 2), np.zeros(3), None, 0), "n_iterations"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
