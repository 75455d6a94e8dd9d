"""Right answers of chapter 05, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.exercises import ch05_mecanum_kinematics as ch
from slamlab.robots import YOUBOT, Mecanum


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
