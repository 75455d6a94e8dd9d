"""ICP: Jacobians, recovery of a motion, equivariance, honest covariances."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from slamlab.geometry import compose, inverse, rotation, transform
from slamlab.kernels.icp import _pairs, hashed
from slamlab.matching import PointsWithNormals, estimate_normals, match_icp, voxel_downsample
from slamlab.matching.icp import errors
from slamlab.sensors import Lidar
from slamlab.worlds import rooms

POSE = np.array([2.0, 4.0, 0.3])
MOTION = np.array([0.2, 0.05, 0.1])


def scan(pose, rng, lidar=None, room=None):
    lidar = lidar or Lidar(360, max_range=20.0, sigma_range=0.01)
    return voxel_downsample(lidar.points(lidar.scan(room or rooms.office(), pose, rng)))


def pair_of_scans(seed=0):
    rng = np.random.default_rng(seed)
    return scan(POSE, rng), scan(compose(POSE, MOTION), rng)


def error(metric, normal, p, q, pose):
    d = rotation(pose[2]) @ p + pose[:2] - q
    return np.array([normal @ d]) if metric == "line" else d


@pytest.mark.parametrize("metric", ["line", "point"])
def test_the_equations_are_those_of_the_derivatives(metric):
    """J by central differences, one pair at a time."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        p, q, pose = rng.normal(size=2), rng.normal(size=2), rng.normal(size=3)
        angle = rng.uniform(0, 7)
        n = np.array([np.cos(angle), np.sin(angle)])
        e, J, w = errors(q[None], n[None], p[None], pose, np.zeros(1, int), 0.05, metric == "line")
        step = 1e-6 * np.eye(3)
        slopes = [
            (error(metric, n, p, q, pose + h) - error(metric, n, p, q, pose - h)) / 2e-6
            for h in step
        ]
        np.testing.assert_allclose(J[0], np.stack(slopes, -1), atol=1e-7)
        np.testing.assert_allclose(e[0], error(metric, n, p, q, pose), atol=1e-12)
        np.testing.assert_allclose(w, (0.0025 / (0.0025 + (e**2).sum())) ** 2)
        # The form without the turned lever arm (n . p for the heading) fails.
        assert metric == "point" or abs(J[0, 0, 2] - n @ p) > 1e-3


@pytest.mark.parametrize("metric", ["line", "point"])
def test_a_scan_on_itself_does_not_move(metric):
    points, _ = pair_of_scans()
    points = points[np.isfinite(estimate_normals(points)[:, 0])]
    match = match_icp(points, points, np.zeros(3), metric)
    np.testing.assert_allclose(match.pose, 0.0, atol=1e-9)
    assert match.rmse < 1e-9
    if metric == "point":
        assert match.score == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(5))
def test_point_to_line_finds_the_motion_and_point_to_point_stays_behind(seed):
    a, b = pair_of_scans(seed)
    line, point = (match_icp(a, b, np.zeros(3), metric) for metric in ("line", "point"))
    assert np.abs(line.pose - MOTION).max() < 0.01
    assert np.hypot(*(point.pose - MOTION)[:2]) > 2 * np.hypot(*(line.pose - MOTION)[:2])


def test_the_match_moves_with_the_world():
    a, b = pair_of_scans()
    found = match_icp(a, b, np.zeros(3))
    frame = np.array([-7.0, 3.0, 2.5])
    moved = match_icp(transform(frame, a), b, frame)
    np.testing.assert_allclose(compose(inverse(frame), moved.pose), found.pose, atol=1e-6)
    turn = np.eye(3)
    turn[:2, :2] = rotation(frame[2])
    np.testing.assert_allclose(moved.cov, turn @ found.cov @ turn.T, rtol=1e-3, atol=1e-12)


def nees_of(room, lidar, pose, motion, n_runs=150):
    rng = np.random.default_rng(0)
    found, weakest = [], []
    for _ in range(n_runs):
        a, b = scan(pose, rng, lidar, room), scan(compose(pose, motion), rng, lidar, room)
        match = match_icp(a, b, motion)
        error = match.pose - motion  # in the frame of the reference, as the covariance
        found.append(error @ np.linalg.solve(match.cov, error))
        weakest.append(match.weakest_direction)
    return np.array(found), np.array(weakest)


@pytest.mark.parametrize("sigma", [0.01, 0.03])
@pytest.mark.parametrize("pose", [[2.0, 4.0, 0.3], [2.0, 1.8, 0.3]])
def test_covariances_are_honest_where_the_room_holds_the_pose(pose, sigma):
    """Mean NEES of three degrees of freedom; s^2 H^-1 with half the noise has 6 and more."""
    lidar = Lidar(360, max_range=20.0, sigma_range=sigma)
    nees, _ = nees_of(rooms.office(), lidar, np.array(pose), MOTION)
    assert 2.3 < nees.mean() < 5.0


def test_a_corridor_flags_its_length():
    lidar = Lidar(360, max_range=2.5, sigma_range=0.01)
    _, weakest = nees_of(rooms.corridor(), lidar, np.array([6.0, 1.0, 0.4]), MOTION, 60)
    flagged = weakest[:, 0] > 0.5
    assert flagged.mean() > 0.9
    along = np.angle(np.exp(2j * (weakest[flagged, 1] + 0.4))) / 2
    assert np.abs(along).max() < 0.1


def test_no_pairs_is_a_match_that_knows_nothing():
    a, b = pair_of_scans()
    match = match_icp(a, b, [100.0, 0.0, 0.0])
    assert match.score == 0.0
    assert match.n_points == 0
    assert match.weakest_direction[0] > 5
    assert match.pose.tolist() == [100.0, 0.0, 0.0]


@pytest.mark.parametrize("seed", range(5))
def test_with_a_prior_the_result_is_the_most_probable_pose(seed):
    """The gradient of both terms is zero, and the covariance is the inverse of both together."""
    a, b = pair_of_scans(seed)
    walls = PointsWithNormals.estimate(a).on_lines()
    guess, noise = MOTION + [0.05, -0.04, 0.03], 0.05
    prior_cov = np.array([[4.0, 1.0, 0.2], [1.0, 3.0, 0.1], [0.2, 0.1, 1.0]]) * 1e-4
    match = match_icp(walls, b, guess, prior_cov=prior_cov, noise=noise, n_iterations=50)
    distance, j = cKDTree(walls.points).query(transform(match.pose, b))
    pair = np.where(distance < 0.2, j, -1)
    e, J, w = errors(walls.points, walls.normals, b, match.pose, pair, 0.05, True)
    e, J, P = e[:, 0], J[:, 0], np.linalg.inv(prior_cov)
    pairs_pull, prior_pulls = J.T @ (w * e) / noise**2, P @ (match.pose - guess)
    assert np.abs(pairs_pull + prior_pulls).max() < 1e-2 < 0.1 * np.abs(prior_pulls).max()
    together = np.linalg.inv(J.T @ (w[:, None] * J) / noise**2 + P)
    np.testing.assert_allclose(match.cov, together, rtol=1e-9, atol=1e-12)
    free = match_icp(walls, b, guess, n_iterations=50)  # the wrong form: no prior
    assert np.abs(free.pose - match.pose).max() > 1e-4


@pytest.mark.parametrize("seed", range(5))
def test_where_no_wall_holds_the_pose_the_prior_does(seed):
    rng, hall = np.random.default_rng(seed), rooms.corridor()
    sight = Lidar(360, max_range=2.5, sigma_range=0.01)
    here = np.array([6.0, 1.0, 0.0])
    a, b = (scan(p, rng, sight, hall) for p in (here, compose(here, [0.3, 0.05, 0.1])))
    guess, sigmas = np.array([0.4, 0.0, 0.05]), np.array([0.2, 0.2, 0.1])
    match = match_icp(a, b, guess, width=0.1, prior_cov=np.diag(sigmas**2))
    assert np.abs(match.pose[1:] - [0.05, 0.1]).max() < 0.01
    claimed = np.sqrt(np.diag(match.cov))
    assert abs(match.pose[0] - 0.4) < claimed[0]  # the guess's, although it is 0.1 m off
    assert 0.08 < claimed[0] < 0.2  # the rest is what tilted normals pretend
    assert claimed[1] < 0.02
    assert claimed[2] < 0.02


def test_without_pairs_the_prior_is_all_there_is():
    a, b = pair_of_scans()
    match = match_icp(a, b, [100.0, 0.0, 0.0], prior_cov=0.01 * np.eye(3))
    assert match.score == 0.0
    assert match.pose.tolist() == [100.0, 0.0, 0.0]
    np.testing.assert_array_equal(match.cov, 0.01 * np.eye(3))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda a: match_icp(a[:2], a, np.zeros(3)), "reference"),
        (lambda a: match_icp(a, a[:2], np.zeros(3)), "points"),
        (lambda a: match_icp(a, a, np.zeros(2)), "guess"),
        (lambda a: match_icp(a, a, np.zeros(3), "plane"), "metric"),
        (lambda a: match_icp(a, a, np.zeros(3), width=0), "width"),
        (lambda a: match_icp(a, a, np.zeros(3), gate=-1), "gate"),
        (lambda a: match_icp(a, a, np.zeros(3), n_iterations=0), "n_iterations"),
        (lambda a: match_icp(a, a, np.zeros(3), prior_cov=np.zeros((3, 3))), "prior_cov.*regular"),
        (lambda a: match_icp(a, a, np.zeros(3), prior_cov=np.eye(2)), "prior_cov"),
        (lambda a: match_icp(a, a, np.zeros(3), noise=0.0), "noise"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(pair_of_scans()[0])


def corridor_map(rng, lidar, x, n_scans=20):
    """Outline of the last scans in a plain corridor of 40 m, 0.3 m apart, the newest at x."""
    poses = np.column_stack(
        [x - 0.3 * np.arange(n_scans)[::-1], np.ones(n_scans), np.zeros(n_scans)]
    )
    world = rooms.long_corridor()
    return PointsWithNormals.concatenated(
        [PointsWithNormals.estimate(scan(p, rng, lidar, world)).transformed(p) for p in poses]
    )


PLAIN_LIDARS = [
    Lidar(180, max_range=5.0, offset=0.3, sigma_range=0.01),
    Lidar(360, max_range=5.0, sigma_range=0.03),
    Lidar(180, field_of_view=np.pi, max_range=5.0, sigma_range=0.01),
]


@pytest.mark.parametrize("lidar", PLAIN_LIDARS)
def test_a_map_of_many_scans_flags_a_plain_corridor_too(lidar):
    """By the errors of the nearest of many points the noise of the normals is missed."""
    rng, flagged, missed = np.random.default_rng(1), [], []
    for x in rng.uniform(12, 25, 30):
        walls, now = corridor_map(rng, lidar, x), np.array([x + 0.1, 1.0, 0.0])
        points = scan(now, rng, lidar, rooms.long_corridor())
        match = match_icp(walls, points, now)
        flagged.append(match.weakest_direction[0] > 0.5)
        assert match.rmse < 0.6 * np.sqrt(2) * lidar.sigma_range
        # Errors across the walls: what two points with this noise would have is the whole of it.
        across = np.mean(points[:, 1] ** 2 / (points**2).sum(1))
        share = match.rmse**2 / (2 * lidar.sigma_range**2 * across)
        wrong = match_icp(
            replace(walls, normal_variances=share * walls.normal_variances), points, now
        )
        missed.append(wrong.weakest_direction[0] < 0.1)
    assert all(flagged)
    assert any(missed)


def test_one_wrong_pair_at_the_end_of_a_corridor_does_not_hold_its_length(monkeypatch):
    """The map has the end wall, the scan no longer: a point beside the corner pairs with it."""
    rng, lidar, sure = np.random.default_rng(0), PLAIN_LIDARS[0], {3.0: [], 0.0: []}
    for x in np.linspace(4.95, 5.55, 20):
        walls, now = corridor_map(rng, lidar, x - 0.1, 8), np.array([x, 1.0, 0.0])
        points = scan(now, rng, lidar, rooms.long_corridor())
        guess = now - [rng.uniform(0.1, 0.5), 0.0, 0.0]
        for few in sure:
            monkeypatch.setattr("slamlab.matching._covariance.FEW", few)
            match = match_icp(walls, points, guess)
            error = abs(match.pose[0] - x)
            sure[few].append(error > 0.1 and error > 4 * np.sqrt(match.cov[0, 0]))
    assert not any(sure[3.0])
    assert sum(sure[0.0]) >= 3


def test_partners_are_the_nearest_although_few_are_looked_for_again():
    rng = np.random.default_rng(3)
    reference, points = rng.uniform(-2, 2, (400, 2)), rng.uniform(-2.3, 2.3, (200, 2))
    hashes, gate = hashed(reference, 0.25), 0.15
    pair, places, kept = np.full(200, -1), np.zeros((200, 3)), None
    n_searched, wrong, pose = [], 0, np.zeros(3)
    for step in 0.2 ** np.arange(7):
        pose = pose + step * rng.uniform(-0.1, 0.1, 3)
        before = places.copy()
        count = _pairs(reference, hashes, points, pose, gate, pair, places)
        distance, nearest = cKDTree(reference).query(transform(pose, points))
        assert np.array_equal(pair, np.where(distance < gate, nearest, -1))
        assert count == (distance < gate).sum()
        n_searched.append((places != before).any(1).sum())
        # Who takes the others for far away keeps partners that are not the nearest any more.
        kept = pair.copy() if kept is None else kept
        far_away = np.tile([0.0, 0.0, np.inf], (200, 1))
        _pairs(reference, hashes, points, pose, gate, kept, far_away)
        wrong += not np.array_equal(kept, pair)
    assert n_searched[0] == 200
    assert n_searched[-1] < 5
    assert wrong >= 5
