"""Exercises of chapter 05: right answers pass, wrong ones are named, the stub is friendly."""

import numpy as np
import pytest

from slamlab.exercises import ch05_mecanum_kinematics as ch
from slamlab.robots import YOUBOT, Mecanum

EXERCISES = {
    "wheels": (ch.check_wheels, ch.wheel_speeds, ch.MISTAKES_WHEELS),
    "step": (ch.check_step, ch.exact_step, ch.MISTAKES_STEP),
    "noise": (ch.check_noise, ch.process_noise, ch.MISTAKES_NOISE),
    "slip": (ch.check_slip, ch.slip_alarm, ch.MISTAKES_SLIP),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


def by_centre_of_rotation(pose, u, dt):
    """Another right answer to exercise 2: turn about the instantaneous centre."""
    x, y, theta = pose
    if abs(u[2]) < 1e-9:
        world = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]]) @ u[:2]
        return [x + world[0] * dt, y + world[1] * dt, theta]
    W = np.exp(1j * theta) * complex(u[0], u[1]) * (np.exp(1j * u[2] * dt) - 1) / (1j * u[2])
    return (x + W.real, y + W.imag, np.angle(np.exp(1j * (theta + u[2] * dt))))


def noise_by_library(theta, dt, V):
    robot = Mecanum(0.1, 0.1, 0.1, "euler")
    F_u = robot.jacobians([0, 0, theta], [1, 2, 3], dt)[1]
    return (F_u @ V @ F_u.T).tolist()


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
        (ch.check_wheels, lambda u, r, a, b: Mecanum(r, a, b).wheel_speeds(u).tolist()),
        (ch.check_step, by_centre_of_rotation),
        (ch.check_noise, noise_by_library),
        (ch.check_slip, lambda w, s: YOUBOT.slip(w)[..., 0] / (s / 2)),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


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
