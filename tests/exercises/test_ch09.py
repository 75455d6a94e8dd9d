"""Exercises of chapter 09: right answers pass, wrong ones are named, the stub is friendly."""

import numpy as np
import pytest

from slamlab.exercises import ch09_ekf_slam as ch
from slamlab.filters.extended import numerical_jacobian
from slamlab.sensors import RangeBearing

EXERCISES = {
    "jacobian": (ch.check_jacobian, ch.jacobian, ch.MISTAKES_JACOBIAN),
    "add_landmark": (ch.check_add_landmark, ch.add_landmark, ch.MISTAKES_ADD_LANDMARK),
    "wall": (ch.check_wall, ch.observe_wall, ch.MISTAKES_WALL),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


def by_differences(pose, landmark, L):
    """Complex steps are not needed: central differences with extrapolation are good to 1e-10."""
    sensor = RangeBearing(1, 1, offset=float(L))

    def slope(h):
        columns = []
        for k in range(3):
            step = h * np.eye(3)[k]
            ahead, behind = (
                sensor.observe(pose + step, landmark),
                sensor.observe(pose - step, landmark),
            )
            columns.append(sensor.residual(ahead, behind) / (2 * h))
        return np.array(columns).T

    return ((4 * slope(5e-4) - slope(1e-3)) / 3).tolist()


def by_one_product(P, G_pose, G_z, R):
    """J blockdiag(P, R) J^T with the map from (old state, z) to the new state."""
    n = len(P)
    J = np.zeros((n + 2, n + 2))
    J[:n, :n], J[n:, :3], J[n:, n:] = np.eye(n), G_pose, G_z
    noise = np.zeros((n + 2, n + 2))
    noise[:n, :n], noise[n:, n:] = P, R
    return J @ noise @ J.T


def by_two_points(pose, wall, L):
    """Move two points of the wall into the sensor's frame and take the line through them."""
    r, alpha = wall
    normal, along = np.array([np.cos(alpha), np.sin(alpha)]), [-np.sin(alpha), np.cos(alpha)]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    eye = np.asarray(pose)[:2] + float(L) * np.array([c, s])
    a, b = (np.array([[c, s], [-s, c]]) @ (r * normal + t * np.array(along) - eye) for t in (0, 1))
    foot = a - (b - a) * (a @ (b - a))
    return [float(np.hypot(*foot)), float(np.arctan2(foot[1], foot[0]))]


@pytest.mark.parametrize("name", EXERCISES)
def test_at_least_five_wrong_answers_are_known(name):
    assert len(EXERCISES[name][2]) >= 5


@pytest.mark.parametrize("name", EXERCISES)
def test_the_solution_passes(name):
    check, solution, _ = EXERCISES[name]
    assert check(solution).passed


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_jacobian, by_differences),
        (ch.check_add_landmark, by_one_product),
        (ch.check_wall, by_two_points),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def test_the_reference_jacobian_is_the_derivative():
    sensor = RangeBearing(1, 1, offset=0.3)
    pose, landmark = np.array([1.0, 2.0, -0.7]), np.array([2.0, 5.0])
    slope = numerical_jacobian(lambda x: sensor.observe(x, landmark), pose)
    np.testing.assert_allclose(ch.jacobian(pose, landmark, 0.3), slope, atol=1e-8)


@pytest.mark.parametrize("name", EXERCISES)
def test_the_stub_gets_the_friendly_line_and_nothing_else(name):
    report = EXERCISES[name][0](lambda *arguments: ...)
    assert len(report.text.splitlines()) == 2
    assert "nothing returned yet" in report.text


@pytest.mark.parametrize(("check", "wrong", "message"), WRONG)
def test_each_wrong_answer_is_caught_with_its_own_message(check, wrong, message):
    report = check(wrong)
    assert not report.passed
    assert report.messages == (message,)
