"""Right answers of chapter 05, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.exercises import ch05_mecanum_kinematics as ch
from slamlab.geometry import wrap_angle
from slamlab.robots import YOUBOT, Mecanum


def by_centre_of_rotation(pose, u, dt):
    """Another right answer to exercise 2: turn about the instantaneous centre."""
    x, y, theta = pose
    if abs(u[2]) < 1e-9:
        world = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]]) @ u[:2]
        return [x + world[0] * dt, y + world[1] * dt, theta]
    W = np.exp(1j * theta) * complex(u[0], u[1]) * (np.exp(1j * u[2] * dt) - 1) / (1j * u[2])
    return (x + W.real, y + W.imag, np.angle(np.exp(1j * (theta + u[2] * dt))))


def by_sines_where_they_keep_their_digits(pose, u, dt):
    """Integrate to a difference of sines; near zero take the limit."""
    theta, end = pose[2], pose[2] + u[2] * dt
    s, c = dt * np.cos(theta), -dt * np.sin(theta)
    if abs(u[2]) > 1e-7:
        s, c = (np.sin(end) - np.sin(theta)) / u[2], (np.cos(end) - np.cos(theta)) / u[2]
    return [pose[0] + s * u[0] + c * u[1], pose[1] - c * u[0] + s * u[1], wrap_angle(end)]


def noise_by_library(theta, u, dt, V):
    robot = Mecanum(0.1, 0.1, 0.1, "midpoint")
    F_u = robot.jacobians([0, 0, theta], u, dt)[1]
    return (F_u @ V @ F_u.T).tolist()


def by_hubs(u, r, distance, beta):
    """Another right answer to exercise 1: the hub's velocity across the axle."""
    axles = np.stack([np.cos(beta), np.sin(beta)], -1)
    hubs = u[:2] + u[2] * distance * np.stack([-axles[:, 1], axles[:, 0]], -1)
    return (np.cross(axles, hubs) / r).tolist()


def by_library(wheels, sigma, n):
    residual = YOUBOT.slip(wheels)[:, 0] / (sigma / 2)
    sums = np.cumsum([0, *residual])
    return (sums[n:] - sums[:-n]) / np.sqrt(n)


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_wheels, by_hubs),
        (ch.check_step, by_centre_of_rotation),
        (ch.check_step, by_sines_where_they_keep_their_digits),
        (ch.check_noise, noise_by_library),
        (ch.check_slip, by_library),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
