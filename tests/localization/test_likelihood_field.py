"""Likelihood field: distances, densities, and localization in a room without landmarks."""

import numpy as np
import pytest

from slamlab.geometry import compose, inverse_transform, transform, wrap_angle
from slamlab.localization import LikelihoodField, MonteCarloLocalization
from slamlab.robots import Unicycle

RESOLUTION, ORIGIN = 0.05, np.array([-1.0, -2.0])
ROOM = np.zeros((80, 120), bool)
ROOM[[0, -1]] = ROOM[:, [0, -1]] = True
ROOM[:30, 40:44] = ROOM[60:, 70:90] = True


def wall_points():
    """Centres of all occupied cells in the world."""
    rows, columns = np.nonzero(ROOM)
    return ORIGIN + (np.stack([columns, rows], -1) + 0.5) * RESOLUTION


def look(pose, rng=None, n=60, sigma=0.02):
    """Nearest wall cell in each of n directions: a rough lidar, points in the body frame."""
    points = inverse_transform(pose, wall_points())
    sector = np.floor((np.arctan2(points[:, 1], points[:, 0]) + np.pi) / (2 * np.pi / n))
    distance = np.hypot(*points.T)
    order = np.lexsort([distance, sector])
    first = np.unique(sector[order], return_index=True)[1]
    seen = points[order[first]]
    return seen if rng is None else seen + rng.normal(0, sigma, seen.shape)


def test_distances_are_those_to_the_nearest_wall_cell():
    field = LikelihoodField(ROOM, RESOLUTION, ORIGIN)
    walls = wall_points()
    for row, column in [(40, 50), (5, 60), (70, 100), (0, 3)]:
        centre = ORIGIN + (np.array([column, row]) + 0.5) * RESOLUTION
        due = np.hypot(*(walls - centre).T).min()
        assert field.distance[row, column] == pytest.approx(due, abs=1e-12)


def test_the_density_is_the_stated_mixture():
    field = LikelihoodField(ROOM, RESOLUTION, ORIGIN, sigma=0.2, hit=0.7)
    point = ORIGIN + (np.array([50, 40]) + 0.5) * RESOLUTION
    d = field.distance[40, 50]
    due = np.log(0.7 * np.exp(-0.5 * (d / 0.2) ** 2) + 0.3)
    assert field.log_likelihood([[0, 0, 0]], [point])[0] == pytest.approx(due, abs=1e-12)
    assert field.log_likelihood([[0, 0, 0]], [point, point])[0] == pytest.approx(2 * due)
    for outside in ([100.0, 0.0], [0.0, -100.0], [-1e12, 1e12]):
        assert field.log_likelihood([[0, 0, 0]], [outside])[0] == pytest.approx(np.log(0.3))


def test_lost_beams_do_not_count():
    field = LikelihoodField(ROOM, RESOLUTION, ORIGIN)
    points = look([1, 0, 0.3])
    lost = np.vstack([points, [[np.nan, np.nan]], [[np.inf, 0.0]]])
    poses = np.random.default_rng(1).uniform(-1, 1, (5, 3))
    np.testing.assert_array_equal(
        field.log_likelihood(poses, points), field.log_likelihood(poses, lost)
    )
    assert field.log_likelihood(poses, np.empty((0, 2))).tolist() == [0.0] * 5


def test_the_true_pose_is_the_most_likely_and_a_mirrored_turn_is_not():
    field = LikelihoodField(ROOM, RESOLUTION, ORIGIN)
    truth = np.array([1.3, 0.4, 0.8])
    points = look(truth)
    moves = np.random.default_rng(2).uniform(-0.6, 0.6, (400, 3))
    moves = moves[np.abs(moves).max(1) > 0.15]
    there = field.log_likelihood([truth], points)[0]
    assert there == pytest.approx(0.0, abs=1e-6)
    assert there > field.log_likelihood(compose(truth, moves), points).max() + 1
    # Wrong: turning the points the other way.
    assert field.log_likelihood([[1.3, 0.4, -0.8]], points)[0] < there - 10


def test_moving_map_and_pose_together_changes_nothing():
    one = LikelihoodField(ROOM, RESOLUTION, ORIGIN)
    two = LikelihoodField(ROOM, RESOLUTION, ORIGIN + [3.0, -7.0])
    points = transform([0.01, 0.013, 0.2], look([1, 0, 0.3]))
    poses = np.random.default_rng(3).uniform(-1, 1, (50, 3))
    moved = poses + [3.0, -7.0, 0.0]
    np.testing.assert_allclose(
        one.log_likelihood(poses, points), two.log_likelihood(moved, points), atol=1e-9
    )


class Beams:
    """A lidar whose ranges are those of the rough scan above."""

    n_beams = 60
    beam_angles = -np.pi + (np.arange(60) + 0.5) * 2 * np.pi / 60
    max_range, offset = np.inf, 0.0

    def points(self, ranges, poses=None):
        return ranges[:, None] * np.stack([np.cos(self.beam_angles), np.sin(self.beam_angles)], -1)


def ranges_at(pose, rng):
    """Ranges (60,) of the rough lidar; the direction within its sector is lost."""
    points = look(pose, rng)
    ranges = np.full(60, np.nan)
    sector = np.floor((np.arctan2(points[:, 1], points[:, 0]) + np.pi) / (2 * np.pi / 60))
    ranges[np.clip(sector, 0, 59).astype(int)] = np.hypot(*points.T)
    return ranges


def test_a_robot_with_a_lidar_finds_itself_in_the_room():
    # The floor is 6 m x 4 m; beams are nearly independent only if few: 20 of them.
    field = LikelihoodField(ROOM, RESOLUTION, ORIGIN, sigma=0.15, n_points=20)
    robot, C = Unicycle(), np.diag([0.05**2, 0.1**2])
    found = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        mcl = MonteCarloLocalization(
            field, robot, Beams(), 8000, ((-1, 5), (-2, 2)), rng, injection=None
        )
        assert mcl.measures == "scan"
        truth = np.array([2.0, 0.2, 0.3])
        for _ in range(15):
            truth = robot.sample(truth, [0.3, 0.4], 0.5, C, rng)
            mcl.predict([0.3, 0.4], 0.5, C)
            mcl.update(ranges_at(truth, rng))
        error = mcl.pose - truth
        found += np.hypot(*error[:2]) < 0.1 and abs(wrap_angle(error[2])) < 0.1
    assert found >= 3


def test_a_scan_without_an_echo_says_nothing_and_names_beside_ranges_are_refused():
    field = LikelihoodField(ROOM, RESOLUTION, ORIGIN)
    rng = np.random.default_rng(1)
    mcl = MonteCarloLocalization(field, Unicycle(), Beams(), 20, ((-1, 5), (-2, 2)), rng)
    before = mcl.poses
    assert mcl.update(np.full(60, np.nan)) == 0.0
    with pytest.raises(ValueError, match="ids, covs: expected None beside ranges"):
        mcl.update(np.ones(60), ids=[1])
    with pytest.raises(ValueError, match="ranges: expected shape"):
        mcl.update(np.ones(59))
    np.testing.assert_array_equal(mcl.poses, before)


def test_fewer_points_are_spread_over_the_scan():
    points = look([1, 0, 0.3])
    poses = np.random.default_rng(1).uniform(-1, 1, (5, 3))
    few = LikelihoodField(ROOM, RESOLUTION, ORIGIN, n_points=20)
    every = LikelihoodField(ROOM, RESOLUTION, ORIGIN)
    due = every.log_likelihood(poses, points[:60:3])
    np.testing.assert_array_equal(few.log_likelihood(poses, points[:60]), due)
    np.testing.assert_array_equal(
        few.log_likelihood(poses, points[:9]), every.log_likelihood(poses, points[:9])
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"occupied": np.zeros((4, 4), bool)}, "with a wall"),
        ({"occupied": np.ones((4, 4))}, "occupied: expected booleans"),
        ({"occupied": np.ones(4, bool)}, "occupied"),
        ({"resolution": 0.0}, "resolution"),
        ({"origin": [0.0]}, "origin"),
        ({"sigma": -1.0}, "sigma"),
        ({"hit": 1.0}, "hit"),
        ({"n_points": 0}, "n_points"),
    ],
)
def test_bad_input_is_named(options, message):
    with pytest.raises(ValueError, match=message):
        LikelihoodField(**{"occupied": ROOM, "resolution": 0.05, **options})
