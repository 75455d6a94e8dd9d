"""The square robot: it moves as told, and its collision test is the polygon's, exactly."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from slamlab.geometry import transform
from slamlab.printed.p5 import can_move_as_printed, turndot_as_printed
from slamlab.robots import SquareRobot

ROBOT = SquareRobot(0.30)


def scenes(n, rng, reach=0.6):
    """Random poses (n, 3), motions (n,) and one obstacle point each (n, 2), in the world."""
    poses = rng.uniform([-3, -3, -np.pi], [3, 3, np.pi], (n, 3))
    points = poses[:, :2] + rng.uniform(-reach, reach, (n, 2))
    return poses, points


def body(poses, points):
    """The points (n, 2) in the frame of their poses, as clouds of one (n, 1, 2)."""
    delta = points - poses[:, :2]
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = c * delta[:, 0] + s * delta[:, 1]
    return np.stack([x, -s * delta[:, 0] + c * delta[:, 1]], -1)[:, None]


def strictly_inside(corners, point):
    equations = ConvexHull(corners).equations
    return bool((equations[:, :2] @ point + equations[:, 2] < 0).all())


def ring(n_beams, distances):
    """A scan that meets nothing but what is told: {degrees: metres}."""
    ranges = np.full(n_beams, 10.0)
    for degrees, distance in distances.items():
        ranges[round(degrees * n_beams / 360) % n_beams] = distance
    return ranges


def test_swept_rectangle_is_the_hull_of_both_footprints():
    rng = np.random.default_rng(1)
    poses, points = scenes(10_000, rng)
    distance = rng.uniform(-0.8, 0.8, 10_000)
    ours = ROBOT.drive_hits(body(poses, points), distance)
    ends = ROBOT.forward(poses, distance)
    outlines = np.concatenate(
        [transform(p, np.broadcast_to(ROBOT.footprint, (10_000, 4, 2))) for p in (poses, ends)], 1
    )
    due = [strictly_inside(*pair) for pair in zip(outlines, points, strict=True)]
    assert 800 < np.sum(due) < 5000
    assert np.count_nonzero(ours != due) == 0


def test_can_move_as_printed_misses_what_the_polygon_hits():
    rng = np.random.default_rng(2)
    bearing = rng.integers(0, 120, 10_000) * 3
    distance = rng.uniform(ROBOT.circumradius, 1.2, 10_000)
    step = rng.uniform(0.05, 0.8, 10_000)
    angle = np.deg2rad(bearing)
    points = (distance * np.array([np.cos(angle), np.sin(angle)])).T[:, None]
    hits = ROBOT.drive_hits(points, step)
    answers = np.array(
        [
            can_move_as_printed(ring(120, {b: d}), s)
            for b, d, s in zip(bearing, distance, step, strict=True)
        ]
    )
    allowed = ~np.isin(answers, (2, 3))
    missed, needless = (hits & allowed).sum(), (~hits & ~allowed).sum()
    assert missed > 100, "the printed test lets the robot run into walls"
    assert needless > 100, "and it refuses free ways"


def test_printed_test_compares_the_centre_and_the_mended_one_the_body():
    straight_ahead = np.array([[0.40, 0.0]])
    assert can_move_as_printed(ring(120, {0: 0.40}), 0.35) == 0
    assert ROBOT.drive_hits(straight_ahead, 0.35)
    assert not ROBOT.drive_hits(straight_ahead, 0.24)


@pytest.mark.parametrize(
    ("degrees", "answer"),
    [(0, 2), (42, 2), (-45, 2), (45, 0), (135, 1), (180, 1), (222, 1), (225, 0), (90, 0)],
)
def test_printed_answers_are_those_of_the_text(degrees, answer):
    assert can_move_as_printed(ring(120, {degrees: 0.2}), 0.3) == answer
    both = ring(120, {degrees: 0.2, 0: 0.2, 180: 0.2})
    assert can_move_as_printed(both, 0.3) == 3


def test_printed_eighths_skew_when_eight_does_not_divide_the_beams():
    # 100 beams: 12 are an "eighth", so the right front sector starts at beam 84, 302 degrees.
    assert can_move_as_printed(ring(100, {306: 0.2}), 0.3) == 2
    assert can_move_as_printed(ring(120, {306: 0.2}), 0.3) == 0


def test_turn_sweeps_what_the_turning_polygon_sweeps():
    rng = np.random.default_rng(3)
    n, samples = 3000, np.linspace(0, 1, 1500)
    r, bearing = rng.uniform(0.10, 0.24, n), rng.uniform(-np.pi, np.pi, n)
    angle = rng.uniform(-2.2, 2.2, n)
    points = (r * np.array([np.cos(bearing), np.sin(bearing)])).T[:, None]
    ours = ROBOT.turn_hits(points, angle)
    turned = bearing[:, None] - angle[:, None] * samples
    across = r[:, None] * np.maximum(np.abs(np.cos(turned)), np.abs(np.sin(turned)))
    deepest = across.min(axis=1)
    clear = np.abs(deepest - ROBOT.half) > 1e-5
    assert clear.mean() > 0.99
    assert 800 < np.count_nonzero(ours) < 2900
    np.testing.assert_array_equal(ours[clear], deepest[clear] < ROBOT.half)


def test_a_turn_test_by_the_end_pose_alone_would_miss():
    point = np.array([[0.0, 0.17]])
    assert not ROBOT.turn_hits(point, 0.1)
    assert ROBOT.turn_hits(point, np.pi / 2)  # the end pose is free again


def test_free_distance_is_where_contact_begins():
    rng = np.random.default_rng(4)
    points = rng.uniform(-2, 2, (400, 25, 2))
    points[rng.random((400, 25)) < 0.2] = np.nan
    outside = np.where(np.abs(points).max(-1) < 0.2, np.nan, points.max(-1))
    points[np.isnan(outside)] = np.nan
    free = ROBOT.free_distance(points, margin=0.02)
    known = np.isfinite(free)
    assert 50 < known.sum() < 400
    go = np.where(known, free, 1.0)
    assert not ROBOT.drive_hits(points, go - 1e-9, margin=0.02).any()
    assert ROBOT.drive_hits(points, go + 1e-9, margin=0.02)[known].all()


def test_no_points_hit_nothing():
    nothing = np.full((3, 2), np.nan)
    assert not ROBOT.drive_hits(nothing, 5.0)
    assert not ROBOT.turn_hits(nothing, 5.0)
    assert ROBOT.free_distance(np.zeros((0, 2))) == np.inf


def test_turn_and_drive_back_and_forth_return():
    pose = np.array([1.0, 2.0, 0.7])
    np.testing.assert_allclose(ROBOT.forward(ROBOT.forward(pose, 0.4), -0.4), pose, atol=1e-15)
    np.testing.assert_allclose(ROBOT.turn(ROBOT.turn(pose, 3.0), -3.0), pose, atol=1e-15)
    assert ROBOT.turn([0, 0, 3.0], 1.0)[2] == pytest.approx(4.0 - 2 * np.pi)
    assert ROBOT.forward(np.zeros((5, 3)), np.arange(5.0)).shape == (5, 3)


def test_four_left_turns_of_p5_turndot_close_the_square():
    """P5's `Turndot` rotates every corner about the centre: the footprint's pose does the same."""
    pose = np.array([0.5, -0.2, 0.3])
    turned = transform(ROBOT.turn(pose, np.pi / 2), ROBOT.footprint)
    np.testing.assert_allclose(
        turned, np.roll(transform(pose, ROBOT.footprint), -1, 0), atol=1e-15
    )
    corners = transform(pose, ROBOT.footprint)
    printed = [turndot_as_printed(corner, pose[:2], 90.0) for corner in corners]
    np.testing.assert_allclose(printed, turned, atol=1e-15)
    # As it would be without `xt`, with the new x in the second line, the square is torn.
    x = pose[0] - (corners[0, 1] - pose[1])
    assert abs(pose[1] + (x - pose[0]) - turned[0, 1]) > 0.01


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: SquareRobot(0.0), "side"),
        (lambda: SquareRobot(float("nan")), "side"),
        (lambda: ROBOT.forward([0, 0], 1.0), "pose"),
        (lambda: ROBOT.forward([0, 0, 0], np.inf), "distance"),
        (lambda: ROBOT.turn([0, 0, 0], np.nan), "angle"),
        (lambda: ROBOT.drive_hits([[1.0, 0.0]], 1.0, margin=-0.1), "margin"),
        (lambda: ROBOT.drive_hits([1.0, 0.0], 1.0), "points"),
        (lambda: can_move_as_printed([], 1.0), "ranges"),
        (lambda: can_move_as_printed([1.0], -1.0), "step"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
