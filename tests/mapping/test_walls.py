"""Walls extracted from scans of a known room."""

import numpy as np
import pytest

from slamlab.geometry import transform, wrap_angle
from slamlab.mapping import extract_walls, fit_line, line_cov, point_covs
from slamlab.sensors import Wall
from tests.mapping.test_lines import squared

METHODS = ("split-and-merge", "incremental")
BEAMS = np.arange(360) * 2 * np.pi / 360
BOXES = np.array([[0, 0, 10, 8], [2, 2, 3.2, 3], [6, 5, 7, 6.5], [7, 1.5, 8.5, 2.5]])
CORNERS = BOXES[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]
ROOM = np.stack([CORNERS, np.roll(CORNERS, -1, axis=1)], 2).reshape(-1, 2, 2).astype(float)
TRUE = fit_line(ROOM)


def cast(pose, beams=BEAMS, room=ROOM):
    """Exact ranges to the segments of a room, and the row of the segment met."""
    ray = np.stack([np.cos(pose[2] + beams), np.sin(pose[2] + beams)], -1)[:, None]
    edge, away = room[:, 1] - room[:, 0], room[:, 0] - pose[:2]
    with np.errstate(divide="ignore", invalid="ignore"):
        det = ray[..., 0] * edge[:, 1] - ray[..., 1] * edge[:, 0]
        t = (away[:, 0] * edge[:, 1] - away[:, 1] * edge[:, 0]) / det
        s = (away[:, 0] * ray[..., 1] - away[:, 1] * ray[..., 0]) / det
    t = np.where((s >= 0) & (s <= 1) & (t > 0), t, np.inf)
    return t.min(1), t.argmin(1)


def scan(pose, rng, sigma=0.02, p_miss=0.02, beams=BEAMS):
    """Noisy points in the frame of the sensor, NaN where missed, and the segments they met."""
    ranges, met = cast(pose, beams)
    ranges = ranges + sigma * rng.standard_normal(len(beams))
    ranges[rng.random(len(beams)) < p_miss] = np.nan
    return ranges[:, None] * np.stack([np.cos(beams), np.sin(beams)], -1), met


def free_pose(rng):
    """A pose at least 0.4 m from everything."""
    while True:
        x, y, theta = rng.uniform([0.5, 0.5, -np.pi], [9.5, 7.5, np.pi])
        inside = (BOXES[1:, :2] - 0.4 <= [x, y]).all(1) & ([x, y] <= BOXES[1:, 2:] + 0.4).all(1)
        if not inside.any():
            return np.array([x, y, theta])


@pytest.mark.parametrize("method", METHODS)
def test_a_room_scanned_from_120_places_gives_its_walls_and_no_ghosts(method):
    rng = np.random.default_rng(6)
    nees, found, long_seen, ghosts = [], 0, 0, 0
    for _ in range(120):
        pose = free_pose(rng)
        points, met = scan(pose, rng)
        walls = extract_walls(points, 0.02, method=method, max_gap=np.inf)
        due = Wall(1, 1).observe(pose, TRUE)
        ids = [np.bincount(met[walls.labels == i]).argmax() for i in range(len(walls))]
        error = Wall(1, 1).residual(walls.lines, due[ids])
        one = squared(error, walls.covs)
        nees += one.tolist()
        ghosts += int((one > 25).sum())
        spread = np.array([_reach(points[met == i]) for i in range(len(ROOM))])
        long_seen += int((spread > 1.0).sum())
        found += len(set(ids) & set(np.flatnonzero(spread > 1.0)))
    assert len(nees) > 700
    assert found >= 0.99 * long_seen
    assert ghosts <= 0.005 * len(nees)
    nees = np.array(nees)
    # A little above 2: which points belong to which wall is guessed from the same noise.
    assert 1.8 < nees[nees <= 25].mean() < 2.35


def _reach(points):
    points = points[np.isfinite(points).all(1)]
    return np.hypot(*np.ptp(points, axis=0)) if len(points) >= 8 else 0.0


@pytest.mark.parametrize("method", METHODS)
def test_without_noise_the_walls_of_the_room_are_exact(method):
    pose = np.array([4.5, 4.0, 0.3])
    points, met = scan(pose, np.random.default_rng(7), sigma=0.0, p_miss=0.0)
    walls = extract_walls(points, 0.01, method=method, threshold=1e-6, max_gap=np.inf)
    ids = [np.bincount(met[walls.labels == i]).argmax() for i in range(len(walls))]
    assert len(set(ids)) == len(ids)
    error = Wall(1, 1).residual(walls.lines, Wall(1, 1).observe(pose, TRUE[ids]))
    np.testing.assert_allclose(error, 0, atol=1e-9)
    # The ends lie on the true segments, and together they cover most of what was seen.
    for (start, stop), row in zip(walls.ends, ids, strict=True):
        for end in transform(pose, np.stack([start, stop])):
            along = ROOM[row, 1] - ROOM[row, 0]
            place = (end - ROOM[row, 0]) @ along / (along @ along)
            assert -1e-9 <= place <= 1 + 1e-9
    np.testing.assert_allclose(walls.lengths, np.hypot(*(walls.ends[:, 1] - walls.ends[:, 0]).T))


@pytest.mark.parametrize("method", METHODS)
def test_labels_tell_the_points_of_each_wall(method):
    points, _ = scan(np.array([4.5, 4.0, 0.3]), np.random.default_rng(8))
    walls = extract_walls(points, 0.02, method=method)
    assert walls.labels.shape == (360,)
    assert (walls.labels[np.isnan(points).any(1)] == -1).all()
    for i in range(len(walls)):
        mine = points[walls.labels == i]
        assert len(mine) >= 8
        np.testing.assert_allclose(fit_line(mine), walls.lines[i], rtol=1e-12)
        np.testing.assert_allclose(
            line_cov(mine, point_covs(mine, 0.02)), walls.covs[i], rtol=1e-9
        )
        r, alpha = walls.lines[i]
        off = walls.ends[i] @ [np.cos(alpha), np.sin(alpha)] - r
        np.testing.assert_allclose(off, 0, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_rigid_motion_of_the_points_moves_the_walls(method):
    points, _ = scan(np.array([4.5, 4.0, 0.3]), np.random.default_rng(9))
    motion = np.array([3.0, -7.0, 1.9])
    here = extract_walls(points, 0.02, 0.002, method=method)
    moved = points.copy()
    moved[np.isfinite(points).all(1)] = transform(motion, points[np.isfinite(points).all(1)])
    there = extract_walls(moved, 0.02, 0.002, method=method, origin=motion[:2])
    assert (here.labels == there.labels).all()
    due = Wall(1, 1).locate(motion, here.lines)
    np.testing.assert_allclose(Wall(1, 1).residual(there.lines, due), 0, atol=1e-9)
    _, G_z = Wall(1, 1).locate_jacobians(motion, here.lines)
    np.testing.assert_allclose(
        there.covs, G_z @ here.covs @ np.swapaxes(G_z, -1, -2), rtol=1e-6, atol=1e-12
    )


@pytest.mark.parametrize("method", METHODS)
def test_a_doorway_cuts_a_wall_unless_gaps_are_allowed(method):
    y = np.linspace(-3, 3, 241)
    wall = np.stack([np.full(241, 2.0), y], -1)
    wall += 0.005 * np.random.default_rng(10).standard_normal(wall.shape)
    wall[np.abs(y) < 0.45] = np.nan
    apart = extract_walls(wall, 0.01, method=method, max_gap=0.5)
    whole = extract_walls(wall, 0.01, method=method, max_gap=1.0)
    assert (len(apart), len(whole)) == (2, 1)
    np.testing.assert_allclose(apart.lengths, 2.55, atol=0.05)
    np.testing.assert_allclose(whole.lengths, 6.0, atol=0.05)
    # One NaN, or a few, is a missed return and no doorway.
    wall[20:23] = np.nan
    assert len(extract_walls(wall, 0.01, method=method, max_gap=0.5)) == 2


@pytest.mark.parametrize("method", METHODS)
def test_a_wall_half_hidden_by_a_box_is_one_wall_if_gaps_are_allowed(method):
    rng = np.random.default_rng(11)
    beams = np.deg2rad(np.arange(-60, 61, 1.0))
    distance = np.where(np.abs(beams) < 0.15, 1.5, 3.0) / np.cos(beams)
    distance += 0.01 * rng.standard_normal(len(beams))
    points = distance[:, None] * np.stack([np.cos(beams), np.sin(beams)], -1)
    kinds = {"max_gap": np.inf, "min_length": 0.3}
    walls = extract_walls(points, 0.01, method=method, threshold=0.05, **kinds)
    assert sorted(np.round(walls.lines[:, 0], 1)) == [1.5, 3.0]
    walls = extract_walls(points, 0.01, method=method, threshold=0.05, min_length=0.3)
    assert sorted(np.round(walls.lines[:, 0], 1)) == [1.5, 3.0, 3.0]


@pytest.mark.parametrize("method", METHODS)
def test_the_wall_where_the_scan_begins_and_ends_is_one(method):
    # Beam 0 looks straight ahead, into the middle of a wall.
    points, _ = scan(np.array([5.0, 4.0, 0.0]), np.random.default_rng(12), sigma=0.005, p_miss=0)
    walls = extract_walls(points, 0.005, method=method)
    ahead = (np.abs(wrap_angle(walls.lines[:, 1])) < 0.1) & (walls.lines[:, 0] > 4.5)
    assert ahead.sum() == 1
    assert walls.labels[0] == walls.labels[-1] >= 0


@pytest.mark.parametrize("method", METHODS)
def test_an_outlier_does_not_cut_a_wall(method):
    y = np.linspace(-2, 2, 81)
    wall = np.stack([np.full(81, 2.0), y], -1)
    wall[:, 0] += 0.005 * np.random.default_rng(13).standard_normal(81)
    wall[40, 0] = 1.2
    walls = extract_walls(wall, 0.01, method=method)
    assert len(walls) == 1
    assert walls.labels[40] == -1
    assert (walls.labels >= 0).sum() >= 78


@pytest.mark.parametrize("method", METHODS)
def test_scans_without_walls_give_none(method):
    rng = np.random.default_rng(14)
    for points in (
        np.empty((0, 2)),
        np.full((50, 2), np.nan),
        np.ones((1, 2)),
        np.ones((30, 2)),
        rng.uniform(-5, 5, (60, 2)),
    ):
        walls = extract_walls(points, 0.02, method=method)
        assert len(walls) == 0
        assert walls.ends.shape == (0, 2, 2)
        assert (walls.labels == -1).all()


def test_a_finer_threshold_finds_more_pieces_and_a_coarse_one_bends_corners():
    angles = np.linspace(0, np.pi / 2, 200)
    bow = 3 * np.stack([np.cos(angles), np.sin(angles)], -1)
    numbers = [
        len(extract_walls(bow, 0.1, threshold=t, min_length=0.1)) for t in (0.01, 0.05, 0.7)
    ]
    assert numbers[0] > numbers[1] > numbers[2] == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points": np.ones((3, 3))}, "points: expected shape"),
        ({"sigma_range": 0.0}, "sigma_range"),
        ({"sigma_bearing": -0.1}, "sigma_bearing"),
        ({"method": "hough"}, "method: expected one of"),
        ({"threshold": 0.0}, "threshold"),
        ({"max_gap": -1.0}, "max_gap"),
        ({"min_points": 3}, "min_points"),
        ({"min_length": np.nan}, "min_length"),
        ({"origin": [0.0]}, "origin"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        extract_walls(**{"points": np.ones((30, 2)), "sigma_range": 0.02, **arguments})
