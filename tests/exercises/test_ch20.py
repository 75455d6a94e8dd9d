"""Right answers of chapter 20, written in other ways: each passes."""

import numpy as np
import pytest
from scipy.stats import chi2

from slamlab.exercises import ch20_explore_and_return as ch
from slamlab.exercises.yard import _WAY, HEDGES, SHEDS, Robot, _moved, _twist, expedition
from slamlab.gaussian import mahalanobis_squared
from slamlab.geometry import between, compose, inverse, inverse_transform, rotation, transform
from slamlab.robots import YOUBOT


def next_by_loop(driven, away, home, budget, reserve):
    best = -1
    for k, (there, back) in enumerate(zip(away, home, strict=True)):
        allowed = budget - driven - there - reserve * back >= 0
        if allowed and (best < 0 or there < away[best]):
            best = k
    return best


def relaid_by_loop(poses, nodes, before, after):
    return [
        compose(after[k], between(before[k], p)).tolist()
        for p, k in zip(poses, nodes, strict=True)
    ]


def relaid_by_motion(poses, nodes, before, after):
    motion = compose(after, inverse(before))
    return compose(motion[nodes], poses)


def relaid_by_points(poses, nodes, before, after):
    turn = (after - before)[nodes, 2]
    rows = []
    for p, k, by in zip(poses, nodes, turn, strict=True):
        x, y = transform(after[k], inverse_transform(before[k], p[:2]))
        rows.append([x, y, np.angle(np.exp(1j * (p[2] + by)))])
    return np.array(rows)


def inside_on_the_floor(errors, headings, covs):
    R = rotation(headings)
    return mahalanobis_squared(errors, R @ covs @ R.swapaxes(1, 2)) < chi2.ppf(0.95, 2)


def runs_by_search(share, lost):
    runs = lost + 1
    while ch.least_share(runs - lost, runs) < share:
        runs += 1
    return runs


def runs_by_formula(share, lost):
    a, b = 1 - share, 1.96 * np.sqrt(share * (1 - share))
    return int(np.ceil(((b + np.sqrt(b**2 + 4 * a * lost)) / (2 * a)) ** 2))


def home_after_a_look(robot, steps, memory, way):
    """Skip the pose on which it stands; two loops; the count of the wheels kept as a pose."""
    path, count = ch.relaid(*memory), robot.pose()
    if way == "wheels":
        for step in steps[::-1]:
            robot.drive(inverse(step).tolist())
    if way in ("map", "counted"):
        for goal in (memory[0] if way == "counted" else path)[-2::-1]:
            robot.drive(between(robot.pose(), goal))
    if way == "mixed":
        for goal in reversed(path):
            robot.drive(between(count, goal))
            count = goal
    return robot


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_retraced, lambda steps: inverse(steps)[::-1]),
        (ch.check_retraced, lambda steps: [inverse(u).tolist() for u in steps[::-1]]),
        (ch.check_retraced, lambda steps: between(steps[::-1], np.zeros(3))),
        (ch.check_next_goal, next_by_loop),
        (ch.check_relaid, relaid_by_loop),
        (ch.check_relaid, relaid_by_motion),
        (ch.check_relaid, relaid_by_points),
        (ch.check_inside, inside_on_the_floor),
        (ch.check_inside, lambda e, a, P: list(inside_on_the_floor(e, a, P))),
        (ch.check_runs_needed, runs_by_search),
        (ch.check_runs_needed, runs_by_formula),
        (ch.check_come_home, home_after_a_look),
    ],
)
def test_another_right_answer_passes(check, answer):
    report = check(answer)
    assert report.passed, report.text


@pytest.mark.parametrize("wear", [(1.02, 0.0017), (0.98, 0.0017), (1.01, -0.001)])
def test_worn_wheels_undo_themselves_and_the_map_and_a_mixture_does_not(wear):
    off = {}
    beside = {}
    for way in ("wheels", "counted", "map", "mixed"):
        robot, steps, memory = expedition(*wear)
        ch.come_home(robot, steps, memory, way)
        off[way], beside[way] = robot.off, robot.beside
    assert off["wheels"] < 1e-9
    assert off["map"] < 0.03
    assert off["counted"] < 0.03
    assert off["mixed"] > 0.2
    assert beside["wheels"] < 1e-9
    assert beside["map"] < 0.15
    assert beside["counted"] > 0.3


def test_of_four_ways_home_the_counted_path_alone_passes_through_a_hedge():
    crossed = {}
    for way in ("wheels", "counted", "map", "mixed"):
        robot, steps, memory = expedition()
        crossed[way] = len(ch.come_home(robot, steps, memory, way).crossed)
    assert crossed == {"wheels": 0, "counted": 1, "map": 0, "mixed": 0}


def test_the_way_out_of_the_yard_is_free_and_keeps_a_metre_from_the_hedges():
    (west, south), (east, north) = SHEDS[:, 0].T, SHEDS[:, 1].T
    gaps = []
    for x, y in _WAY[:, :2]:
        across = np.maximum(np.maximum(west - x, x - east), 0)
        along = np.maximum(np.maximum(south - y, y - north), 0)
        gaps.append(np.hypot(across, along).min())
    assert min(gaps) > 0.8
    for (left, y), (right, _) in HEDGES:
        near = (_WAY[:, 0] > left) & (_WAY[:, 0] < right) & (_WAY[:, 1] < -3)
        assert np.abs(_WAY[near, 1] - y).min() > 0.99


def test_a_hunted_bug_that_is_still_there_is_suspected_in_the_last_exercise():
    def bugged(robot, steps, memory, way):
        poses, nodes, before, after = memory
        path = compose(poses, between(before, after)[nodes])
        same = (path, nodes, before, before)
        return ch.come_home(robot, steps, memory if way == "counted" else same, way)

    text = ch.check_come_home(bugged).text
    assert "is your `relaid` of Exercise 3 right?" in text


def test_to_ask_slam_only_every_second_motion_is_not_enough():
    def seldom(robot, steps, memory, way):
        if way in ("wheels", "mixed"):
            return ch.come_home(robot, steps, memory, way)
        pose = robot.pose()
        for k, goal in enumerate((memory[0] if way == "counted" else ch.relaid(*memory))[::-1]):
            motion = between(pose, goal)
            robot.drive(motion)
            pose = robot.pose() if k % 2 else compose(pose, motion)
        return robot

    report = ch.check_come_home(seldom)
    assert report.held == 5
    assert "by 'map' it drives 51 motions without asking SLAM before, expected 0" in report.text


def test_a_robot_of_the_yard_undoes_a_motion_by_the_velocity_with_the_other_sign():
    rng = np.random.default_rng(0)
    for twist in rng.uniform(-1, 1, (10, 3)):
        np.testing.assert_allclose(_moved(twist), YOUBOT.step(np.zeros(3), twist, 1.0), atol=1e-12)
        np.testing.assert_allclose(_twist(_moved(twist)), twist, atol=1e-12)


def test_what_a_colleague_found_is_what_exercise_4_says():
    found = []

    def noted(errors, headings, covs):
        found.append([ch.inside(errors, a * headings, covs).sum() for a in (0, 1)])
        return ch.inside(errors, headings, covs)

    ch.check_inside.draw(noted)
    assert found == [[21, 28]]


def test_plain_minus_signs_cost_metres_in_the_yard():
    robot, steps, _ = expedition()
    for motion in -steps[::-1]:
        robot.drive(motion)
    assert robot.off > 1.5


def test_a_robot_of_the_yard_with_good_wheels_drives_what_is_commanded():
    robot = Robot(np.array([1.0, 2.0, np.pi / 2]), 1.0, 0.0, 0.0, 0)
    robot.drive([1.0, 0.5, 0.3])
    np.testing.assert_allclose(robot.truth[-1], [0.5, 3.0, np.pi / 2 + 0.3], atol=1e-12)
    assert repr(robot) == "<Robot, 3.04 m from its marker>"


def test_a_second_pose_at_one_place_is_the_first():
    robot, *_ = expedition(noise=1.0, seed=3)
    first = robot.pose()
    np.testing.assert_array_equal(robot.pose(), first)
    robot.drive([0.0, 0.0, 0.0])
    assert np.any(robot.pose() != first)


def test_the_true_way_out_of_the_yard_is_the_same_for_every_robot():
    ends = [expedition(*wear)[0].truth[0] for wear in ((), (0.98, 0.001), (1.01, 0.0, 1.0, 3))]
    np.testing.assert_allclose(ends, [ends[0]] * 3, atol=1e-12)
    robot, steps, (path, nodes, before, after) = expedition(1.02, 0.002, 1.0, 5)
    assert len(path) == len(nodes) == len(steps) + 1
    assert len(before) == len(after) == nodes[-1] + 1
