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
    return ((axles[:, 0] * hubs[:, 1] - axles[:, 1] * hubs[:, 0]) / r).tolist()


def by_library(wheels, sigma, n):
    residual = YOUBOT.slip(wheels)[:, 0] / (sigma / 2)
    sums = np.cumsum([0, *residual])
    return (sums[n:] - sums[:-n]) / np.sqrt(n)


def odometry_by_small_moves(pose, P, wheels, dt, r, lever, sigma):
    """Another right answer to exercise 5: the derivative of the step by moving the heading."""
    A = np.linalg.pinv(Mecanum(r, lever / 2, lever / 2).wheel_map)
    poses, covs = [], []
    for u in wheels @ A.T:
        ahead, behind = (ch.exact_step(pose + [0, 0, h], u, dt) for h in (1e-6, -1e-6))
        F = np.eye(3)
        F[:2, 2] = (ahead - behind)[:2] / 2e-6
        P = F @ P @ F.T + ch.process_noise(pose[2], u, dt, (A * sigma**2) @ A.T)
        pose = ch.exact_step(pose, u, dt)
        poses.append(pose)
        covs.append(P)
    return poses, covs


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_wheels, by_hubs),
        (ch.check_step, by_centre_of_rotation),
        (ch.check_step, by_sines_where_they_keep_their_digits),
        (ch.check_noise, noise_by_library),
        (ch.check_slip, by_library),
        (ch.check_odometry, odometry_by_small_moves),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def test_wheels_that_are_alike_are_drawn_before_and_after_the_exercise_is_solved():
    left, right = ch.draw_equal_wheels(lambda *given: None).axes
    assert [text.get_text() for text in left.texts] == ["nothing returned yet"]
    left, right = ch.draw_equal_wheels(ch.odometry).axes
    one, other = (ax.get_title(loc="left") for ax in (left, right))
    assert one.startswith("Yours, all wheels alike\ninside, place, pose\nafter 1 m: 88%, 2.6")
    assert other.startswith("As it should be\ninside, place, pose\nafter 1 m: 95%, 2.0")


@pytest.mark.parametrize(
    ("heading", "sign", "said"),
    [(1.0, 1, "two bugs of Exercise 3"), (0.5, 1, "along y"), (1.0, -1, "in a curve")],
)
def test_bugs_of_exercise_3_are_named_in_a_right_odometry(monkeypatch, heading, sign, said):
    def noise(theta, u, dt, V):
        c, s = np.cos(theta + heading * u[2] * dt), np.sin(theta + heading * u[2] * dt)
        x, y = dt * (c * u[0] - s * u[1]), dt * (s * u[0] + c * u[1])
        F_u = dt * np.array([[c, -s, sign * y / 2], [s, c, x / 2], [0, 0, 1]])
        return F_u @ V @ F_u.T

    known = ch.check_odometry.due  # by the right noise
    assert len(known) == len(ch.check_odometry.inputs)
    with monkeypatch.context() as patch:
        patch.setattr(ch, "process_noise", noise)
        seen = ch.check_odometry.observe(ch.odometry)
    assert said in ch.check_odometry.judge(seen).messages[0]
