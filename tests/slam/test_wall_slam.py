"""The robot of P1 among walls: its map, its covariance, and what it refuses."""

import numpy as np
import pytest

from slamlab.evaluation import nees
from slamlab.geometry import wrap_angle
from slamlab.logs import ScanGeometry
from slamlab.robots import YOUBOT
from slamlab.sensors import Lidar, Wall
from slamlab.slam import wall_slam
from slamlab.slam.wall_slam import WallSlam
from slamlab.worlds import WallWorld, rooms

DT, SIGMA_WHEEL, SIGMA_RANGE = 0.1, 0.5, 0.02
VIEW = dict(n_beams=181, field_of_view=np.deg2rad(240), max_range=8.0, offset=0.3)
CLEAN, NOISY = Lidar(**VIEW), Lidar(**VIEW, sigma_range=SIGMA_RANGE)
V = YOUBOT.control_cov(SIGMA_WHEEL)
STOPS = np.array([[1, 1], [1, 3.8], [4.3, 4.0], [5.6, 7.2], [8.7, 7.0], [8.7, 1.0], [1.2, 0.9]])


def drive(stops=STOPS, speed=0.5):
    """Poses and controls along straight legs; the heading follows the leg at its own pace."""
    pose, poses, controls = np.array([*stops[0], 0.0]), [], []
    poses.append(pose)
    for stop in stops[1:]:
        while np.hypot(*(stop - pose[:2])) > 0.1:
            way = (stop - pose[:2]) / np.hypot(*(stop - pose[:2]))
            c, s = np.cos(pose[2]), np.sin(pose[2])
            turn = np.clip(wrap_angle(np.arctan2(way[1], way[0]) - pose[2]), -0.6, 0.6)
            u = np.array([*(speed * np.array([[c, s], [-s, c]]) @ way), turn])
            pose = YOUBOT.step(pose, u, DT)
            poses.append(pose)
            controls.append(u)
    return np.array(poses), np.array(controls)


POSES, CONTROLS = drive()
RANGES = CLEAN.scan(rooms.box_room(), POSES)


def run(seed, every=6, slam=None):
    """One run: the filter at the end, NEES and error of every step, error of dead reckoning."""
    rng = np.random.default_rng(seed)
    slam = slam or WallSlam(YOUBOT, NOISY, POSES[0])
    dead, errors, covs = POSES[0], [], []
    for k, u in enumerate(CONTROLS):
        measured = rng.multivariate_normal(u, V)
        dead = YOUBOT.step(dead, measured, DT)
        slam.predict(measured, DT, V)
        if k % every == 0:
            slam.update(RANGES[k + 1] + SIGMA_RANGE * rng.standard_normal(RANGES.shape[1]))
        error = slam.pose - POSES[k + 1]
        error[2] = wrap_angle(error[2])
        errors.append(error)
        covs.append(slam.pose_cov)
    score, away = nees(errors, covs).mean(), np.hypot(*np.transpose(errors)[:2])
    return slam, score, away, np.hypot(*(dead - POSES[-1])[:2])


def lines_of(world):
    """(r, alpha) of the walls of a world."""
    (x, y), (dx, dy) = world.segments[:, 0].T, (world.segments[:, 1] - world.segments[:, 0]).T
    alpha = np.arctan2(dx, -dy)
    r = x * np.cos(alpha) + y * np.sin(alpha)
    return np.stack([np.abs(r), wrap_angle(alpha + np.pi * (r < 0))], -1)


def off_truth(slam):
    """Error of each wall of the map from the nearest true line, and which line that is."""
    truth = lines_of(rooms.box_room())
    residuals = Wall(1, 1).residual(slam.filter.landmarks[:, None], truth[None])
    nearest = np.abs(residuals * [1, 3]).sum(-1).argmin(1)
    return residuals[np.arange(len(nearest)), nearest], nearest


@pytest.fixture(scope="module")
def runs():
    return [run(seed) for seed in range(9)]


def test_the_map_has_every_wall_once_and_no_ghost(runs):
    for slam, *_ in runs:
        error, nearest = off_truth(slam)
        assert sorted(nearest) == sorted(set(nearest))
        assert np.abs(error).max() < 0.2
        assert len(slam.confirmed) >= 14


def test_walls_lie_within_three_sigma(runs):
    squared = []
    for slam, *_ in runs:
        error, _ = off_truth(slam)
        covs = slam.filter.landmark_covs
        squared.append((error * np.linalg.solve(covs, error[..., None])[..., 0]).sum(-1).mean())
    assert 0.7 < np.sqrt(np.mean(squared) / 2) < 2.0, "in units of sigma; 3 is promised"


def test_the_covariance_is_honest_and_an_impudent_one_is_not(runs):
    mean = np.mean([score for _, score, *_ in runs])
    assert 2.3 < mean < 3.7
    impudent = WallSlam(YOUBOT, Lidar(**VIEW, sigma_range=SIGMA_RANGE / 8), POSES[0])
    assert run(0, slam=impudent)[1] > max(4.0, 3 * runs[0][1])


def test_walls_hold_the_pose_where_dead_reckoning_drifts(runs):
    ours = np.sqrt(np.mean([np.mean(errors**2) for *_, errors, _ in runs]))
    drift = np.sqrt(np.mean([dead**2 for *_, dead in runs]))
    assert ours < 0.2 * drift


def test_segments_lie_on_true_walls(runs):
    slam = runs[0][0]
    ends = slam.segments.reshape(-1, 2)
    assert slam.segments.shape[1:] == (2, 2)
    truth = rooms.box_room().segments
    start, along = truth[:, 0], truth[:, 1] - truth[:, 0]
    t = np.einsum("ekj,kj->ek", ends[:, None] - start, along) / (along**2).sum(-1)
    nearest = start + np.clip(t, 0, 1)[..., None] * along
    assert np.hypot(*(ends[:, None] - nearest).T).min(0).max() < 0.2


def test_a_second_wall_in_the_gate_leaves_the_sighting_out():
    twins = np.array([[2.0, 0.0], [2.02, 0.0]])
    slam = WallSlam(YOUBOT, NOISY, [0, 0, 0])
    slam.filter.update(twins, ids=["a", "b"], covs=np.diag([0.05, 0.05]) ** 2)
    scan = CLEAN.scan(WallWorld([[[2.31, -3], [2.31, 3]]]), [0, 0, 0])
    sighting = slam.update(scan)
    assert sighting.ids == (None,)
    assert slam.filter.ids == ("a", "b")


def test_a_line_through_the_lidar_keeps_its_name_and_its_covariance():
    # The wall's line passes the sensor on the other side: (r, alpha) becomes (-r, alpha + pi).
    cov = np.array([[4.0, 1.0], [1.0, 9.0]])
    same = wall_slam.in_name_of(np.array([0.3]), np.array([0.4]), cov[None])
    other = wall_slam.in_name_of(np.array([0.3]), np.array([0.3 - np.pi]), cov[None])
    np.testing.assert_array_equal(same[0], cov)
    np.testing.assert_array_equal(other[0], [[4.0, -1.0], [-1.0, 9.0]])


def test_a_wall_seen_once_is_forgotten():
    slam = WallSlam(YOUBOT, NOISY, [0, 0, 0], patience=10, confirm=3)
    slam.update(CLEAN.scan(WallWorld([[[2.0, -1], [2.0, 1]]]), [0, 0, 0]))
    assert slam.filter.n_landmarks == 1
    assert len(slam.segments) == 0, "once is not often enough"
    for _ in range(10):
        slam.predict([0.1, 0, 0], DT, V)
    slam.update(np.full(181, np.inf))
    assert slam.filter.n_landmarks == 0


def test_a_wall_is_a_line_without_end():
    slam = WallSlam(YOUBOT, NOISY, [0, 0, np.pi / 2], sigma_wall=(0.02, 0.01))
    for x, y in ((0.0, 2.0), (4.0, 2.04)):
        slam.predict([0.0, -x, 0.0], 1.0, 1e-6 * np.eye(3))
        slam.update(CLEAN.scan(WallWorld([[[x - 1, y], [x + 1, y]]]), [x, 0.0, np.pi / 2]))
    assert slam.filter.n_landmarks == 1


def test_a_bare_layout_of_beams_needs_the_noise_and_is_then_the_lidar():
    bare = ScanGeometry(NOISY.beam_angles, NOISY.max_range, NOISY.offset)
    scan = CLEAN.scan(rooms.box_room(), POSES[0])
    walls = []
    for slam in (WallSlam(YOUBOT, NOISY, POSES[0]),
                 WallSlam(YOUBOT, bare, POSES[0], sigma_range=SIGMA_RANGE)):  # fmt: skip
        slam.update(scan)
        walls.append(slam.filter.landmarks)
    np.testing.assert_array_equal(*walls)


def test_the_noise_of_a_wall_adds_to_that_of_its_beams():
    scan, covs = CLEAN.scan(rooms.box_room(), POSES[0]), []
    for own in ((0.0, 0.0), (0.05, 0.02)):
        slam = WallSlam(YOUBOT, NOISY, POSES[0], sigma_wall=own)
        slam.update(scan)
        covs.append(slam.filter.landmark_cov(slam.filter.ids[0]))
    more = covs[1] - covs[0]
    assert more[1, 1] == pytest.approx(0.02**2)
    assert np.linalg.eigvalsh(more)[0] > 0


def test_a_short_piece_starts_no_wall():
    slam = WallSlam(YOUBOT, NOISY, [0, 0, 0])
    sighting = slam.update(CLEAN.scan(WallWorld([[[1.0, -0.29], [1.0, 0.29]]]), [0, 0, 0]))
    assert len(sighting.walls) == 1
    assert sighting.ids == (None,)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"lidar": CLEAN}, "lidar.sigma_range"),
        ({"probability": 1.0}, "probability"),
        ({"confirm": 0}, "confirm"),
        ({"patience": 0}, "patience"),
        ({"min_length": -1.0}, "min_length"),
        ({"sigma_range": 0.0}, "sigma_range"),
        ({"sigma_wall": [0.0, -0.1]}, "sigma_wall"),
        ({"pose": [0, 0]}, "mean"),
    ],
)
def test_bad_parameters_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        WallSlam(**({"motion": YOUBOT, "lidar": NOISY, "pose": [0, 0, 0]} | arguments))


def test_a_bad_scan_leaves_the_filter_as_it_was():
    slam = WallSlam(YOUBOT, NOISY, [0, 0, 0])
    slam.update(RANGES[0])
    before = slam.filter.mean.copy()
    with pytest.raises(ValueError, match="ranges"):
        slam.update(RANGES[0][:-1])
    with pytest.raises(ValueError, match="ranges"):
        slam.update(-RANGES[0])
    np.testing.assert_array_equal(slam.filter.mean, before)
