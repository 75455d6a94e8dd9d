"""Exercises of chapter 00: right answers pass, wrong ones are named, the stub is friendly."""

import numpy as np
import pytest

from slamlab.exercises import ch00_slam_in_ten_minutes as ch
from slamlab.geometry import compose

EXERCISES = {
    "dead_reckoning": (ch.check_dead_reckoning, ch.dead_reckoning, ch.MISTAKES_DEAD_RECKONING),
    "edge_error": (ch.check_edge_error, ch.edge_error, ch.MISTAKES_EDGE_ERROR),
    "edge_jacobian": (ch.check_edge_jacobian, ch.edge_jacobian, ch.MISTAKES_EDGE_JACOBIAN),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


def by_matrices(start, odometry):
    """Another right answer: homogeneous matrices, and lists instead of arrays."""

    def matrix(p):
        c, s = np.cos(p[2]), np.sin(p[2])
        return np.array([[c, -s, p[0]], [s, c, p[1]], [0, 0, 1]])

    T = matrix(start)
    poses = [list(start)]
    for motion in odometry:
        T = T @ matrix(motion)
        poses.append([T[0, 2], T[1, 2], np.arctan2(T[1, 0], T[0, 0])])
    return poses


def by_steps(pose_i, pose_j, z):
    """Another right answer: a plain list and the angle wrapped by arctan2."""
    dx, dy = pose_j[0] - pose_i[0], pose_j[1] - pose_i[1]
    c, s = np.cos(pose_i[2]), np.sin(pose_i[2])
    x, y = c * dx + s * dy - z[0], -s * dx + c * dy - z[1]
    c, s = np.cos(z[2]), np.sin(z[2])
    a = pose_j[2] - pose_i[2] - z[2]
    return [c * x + s * y, -s * x + c * y, np.arctan2(np.sin(a), np.cos(a))]


def by_complex_step(pose_i, pose_j, z):
    """Another right answer: the Jacobian by complex steps through the formula."""
    columns = []
    for k in range(3):
        i = np.array(pose_i, dtype=complex)
        i[k] += 1e-30j
        d = pose_j[:2] - i[:2]
        c, s = np.cos(i[2]), np.sin(i[2])
        b = np.array([c * d[0] + s * d[1] - z[0], -s * d[0] + c * d[1] - z[1]])
        c, s = np.cos(z[2]), np.sin(z[2])
        e = np.array([c * b[0] + s * b[1], -s * b[0] + c * b[1], pose_j[2] - i[2] - z[2]])
        columns.append(e.imag / 1e-30)
    return np.array(columns).T


@pytest.mark.parametrize("name", EXERCISES)
def test_at_least_five_wrong_answers_are_known(name):
    assert len(EXERCISES[name][2]) >= 5


@pytest.mark.parametrize("name", EXERCISES)
def test_the_solution_passes(name, capsys):
    check, solution, _ = EXERCISES[name]
    assert check(solution).passed
    assert "Well done" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_dead_reckoning, by_matrices),
        (ch.check_edge_error, by_steps),
        (ch.check_edge_jacobian, by_complex_step),
        (ch.check_edge_jacobian, lambda i, j, z: ch.edge_jacobian(i, j, z).tolist()),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


@pytest.mark.parametrize("name", EXERCISES)
def test_the_stub_gets_the_friendly_line_and_nothing_else(name):
    report = EXERCISES[name][0](lambda *arguments: ...)
    assert not report.passed
    assert len(report.text.splitlines()) == 2
    assert "nothing returned yet" in report.text


@pytest.mark.parametrize(("check", "wrong", "message"), WRONG)
def test_each_wrong_answer_is_caught_with_its_own_message(check, wrong, message):
    report = check(wrong)
    assert not report.passed
    assert message in report.messages


def test_messages_do_not_fit_each_others_mistakes():
    for check, _, mistakes in EXERCISES.values():
        for message, wrong in mistakes.items():
            assert check(wrong).messages == (message,)


def test_an_exception_is_shown_and_not_raised():
    report = ch.check_edge_error(lambda i, j, z: compose(i, "left"))
    assert "raised ValueError" in report.text
