"""Exercises of chapter 05: wheel map, exact step, process noise, slip alarm.

P1 (9), (10), (14) and (17) with its dt, and the wheel map (9a) that P1 leaves out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Report, run_cases
from slamlab.geometry import wrap_angle

__all__ = [
    "MISTAKES_NOISE",
    "MISTAKES_SLIP",
    "MISTAKES_STEP",
    "MISTAKES_WHEELS",
    "check_noise",
    "check_slip",
    "check_step",
    "check_wheels",
    "exact_step",
    "process_noise",
    "slip_alarm",
    "wheel_speeds",
]

Function = Callable[..., Any]


# Exercise 1: the wheel map.


def wheel_speeds(u: Array, r: float, half_length: float, half_width: float) -> Array:
    """Wheel speeds (4,) in rad/s of a body velocity u = (V_1, V_2, omega)."""
    return _wheels(u, r, half_length + half_width)


def _wheels(u: Array, r: float, lever: float, left: float = 1.0, turn: float = 1.0) -> Array:
    forward, sideways, turning = u[0], left * u[1], turn * lever * u[2]
    return np.array(
        [
            forward - sideways - turning,
            forward + sideways + turning,
            forward + sideways - turning,
            forward - sideways + turning,
        ]
    ) / np.asarray(r)


MISTAKES_WHEELS: dict[str, Function] = {
    "left and right are swapped: V_2 is positive to the left, so front-left slows down": (
        lambda u, r, a, b: _wheels(u, r, a + b, left=-1)
    ),
    "the turn has the wrong sign: turning left speeds the right wheels up": (
        lambda u, r, a, b: _wheels(u, r, a + b, turn=-1)
    ),
    "the lever is half length plus half width: one of them is missing": (
        lambda u, r, a, b: _wheels(u, r, a)
    ),
    "the lever is the sum of the half lengths; their difference belongs to wheels mounted "
    "the other way round": lambda u, r, a, b: _wheels(u, r, a - b),
    "the lever of this wheel is the sum of the half lengths, not the distance to the centre": (
        lambda u, r, a, b: _wheels(u, r, np.hypot(a, b))
    ),
    "the turn acts at a lever: multiply omega by the half lengths": (
        lambda u, r, a, b: _wheels(u, r, 1.0)
    ),
    "multiplied by the wheel radius: a speed over the floor divided by r is a spin": (
        lambda u, r, a, b: _wheels(u, 1 / r, a + b)
    ),
    "these are speeds over the floor (m/s): divide by the wheel radius": (
        lambda u, r, a, b: _wheels(u, 1.0, a + b)
    ),
    "the wheels come in another order: front-left, front-right, rear-left, rear-right": (
        lambda u, r, a, b: _wheels(u, r, a + b)[[0, 1, 3, 2]]
    ),
    "this is the inverse map with its quarter: the wheels are asked for": (
        lambda u, r, a, b: _wheels(u, r, a + b) / 4
    ),
}


def check_wheels(student: Function) -> Report:
    """Check ``student(u (3,), r, half_length, half_width) -> wheel speeds (4,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    youbot = (0.0475, 0.235, 0.15)
    cases = [
        ("straight ahead, all wheels alike", [0.4, 0.0, 0.0], *youbot),
        ("to the left, diagonals against each other", [0.0, 0.3, 0.0], *youbot),
        ("turning left, right against left", [0.0, 0.0, 0.8], *youbot),
        ("all three at once", [0.4, -0.2, 0.5], *youbot),
        ("another robot", [-0.3, 0.1, 1.0], 0.1, 0.2, 0.4),
    ]
    return run_cases("wheel_speeds", student, wheel_speeds, cases, MISTAKES_WHEELS)


# Exercise 2: the exact step.


def exact_step(pose: Array, u: Array, dt: float) -> Array:
    """Pose (3,) after moving with the body velocity u for dt while the heading turns."""
    h = 0.5 * u[2] * dt
    return _moved(pose, u, dt, h, np.sinc(h / np.pi))


def _moved(
    pose: Array, u: Array, dt: float, turned: float, shrink: float = 1.0, wrap: bool = True
) -> Array:
    c, s = np.cos(pose[2] + turned), np.sin(pose[2] + turned)
    x = pose[0] + shrink * dt * (c * u[0] - s * u[1])
    y = pose[1] + shrink * dt * (s * u[0] + c * u[1])
    heading = pose[2] + dt * u[2]
    return np.array([x, y, float(wrap_angle(heading)) if wrap else heading])


def _rotated_back(pose: Array, u: Array, dt: float) -> Array:
    turned = exact_step(np.array([0.0, 0.0, -pose[2]]), u, dt)
    heading = float(wrap_angle(pose[2] + dt * u[2]))
    return np.array([pose[0] + turned[0], pose[1] + turned[1], heading])


def _full_angle(pose: Array, u: Array, dt: float) -> Array:
    phi = u[2] * dt
    return _moved(pose, u, dt, phi / 2, np.sinc(phi / np.pi))


def _divided(pose: Array, u: Array, dt: float) -> Array:
    h = 0.5 * np.float64(u[2]) * dt
    with np.errstate(invalid="ignore"):
        return _moved(pose, u, dt, h, np.sin(h) / h)


MISTAKES_STEP: dict[str, Function] = {
    "this is Euler's step: the velocity turns with the robot during dt": (
        lambda pose, u, dt: _moved(pose, u, dt, 0.0)
    ),
    "this is the midpoint rule: the chord is shorter than the arc, by sin(h)/h": (
        lambda pose, u, dt: _moved(pose, u, dt, 0.5 * u[2] * dt)
    ),
    "the heading of the end of the step was used: the middle one is due": (
        lambda pose, u, dt: _moved(pose, u, dt, u[2] * dt, float(np.sinc(0.5 * u[2] * dt / np.pi)))
    ),
    "h is half the turn of the step, in the factor too": _full_angle,
    "0/0 without a turn: sin(h)/h is 1 at h = 0, and np.sinc(h / np.pi) knows it": _divided,
    "rotated the wrong way round: body to world turns by plus theta": _rotated_back,
    "u is a velocity of the body: rotate it into the world": (
        lambda pose, u, dt: (
            exact_step(np.array([0.0, 0.0, 0.0]), u, dt)
            + [pose[0], pose[1], float(wrap_angle(pose[2] + dt * u[2])) - wrap_angle(dt * u[2])]
        )
    ),
    "the heading leaves (-pi, pi]: wrap it": (
        lambda pose, u, dt: _moved(
            pose, u, dt, 0.5 * u[2] * dt, float(np.sinc(0.5 * u[2] * dt / np.pi)), wrap=False
        )
    ),
    "V_2 is missing: this robot also moves to its left": (
        lambda pose, u, dt: exact_step(pose, np.array([u[0], 0.0, u[2]]), dt)
    ),
}


def check_step(student: Function) -> Report:
    """Check ``student(pose (3,), u (3,), dt) -> pose (3,)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    cases = [
        ("straight ahead", [1.0, 2.0, 0.0], [0.5, 0.0, 0.0], 0.4),
        ("a diagonal at another heading", [1.0, 2.0, 0.9], [0.5, -0.3, 0.0], 0.4),
        ("a quarter circle", [0.0, 0.0, 0.3], [1.0, 0.0, np.pi / 2], 1.0),
        ("turning while strafing", [-1.0, 0.5, -2.0], [0.2, 0.6, -1.5], 0.8),
        ("the heading passes pi", [0.0, 0.0, 3.0], [0.3, 0.1, 1.0], 0.5),
    ]
    return run_cases("exact_step", student, exact_step, cases, MISTAKES_STEP)


# Exercise 3: the process noise.


def process_noise(theta: float, dt: float, V: Array) -> Array:
    """Q (3, 3) of Euler's step for a velocity with covariance V (3, 3)."""
    F_u = dt * _turn(theta)
    return F_u @ V @ F_u.T


def _turn(theta: float) -> Array:
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=float)


MISTAKES_NOISE: dict[str, Function] = {
    "dt is missing, as in the printed (17): a velocity acts for the time dt": (
        lambda theta, dt, V: _turn(theta) @ V @ _turn(theta).T
    ),
    "dt enters once: it stands in F_u on both sides": (
        lambda theta, dt, V: dt * _turn(theta) @ V @ _turn(theta).T
    ),
    "the noise was not turned into the world": lambda theta, dt, V: dt**2 * V,
    "rotated the wrong way round: F_u V F_u^T, not F_u^T V F_u": (
        lambda theta, dt, V: dt**2 * _turn(theta).T @ V @ _turn(theta)
    ),
    "the second F_u is not transposed": (
        lambda theta, dt, V: dt**2 * _turn(theta) @ V @ _turn(theta)
    ),
    "this is F_u: the covariance F_u V F_u^T is due": lambda theta, dt, V: dt * _turn(theta),
    "the heading's noise got lost: omega acts for dt as well": (
        lambda theta, dt, V: (
            np.diag([dt, dt, 0.0]) @ _turn(theta) @ V @ _turn(theta).T @ np.diag([dt, dt, 0.0])
        )
    ),
    "dt was left out for the heading: omega acts for dt as well": (
        lambda theta, dt, V: (
            np.diag([dt, dt, 1.0]) @ _turn(theta) @ V @ _turn(theta).T @ np.diag([dt, dt, 1.0])
        )
    ),
}


def check_noise(student: Function) -> Report:
    """Check ``student(theta, dt, V (3, 3)) -> Q (3, 3)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    V = np.diag([0.04, 0.01, 0.09])
    worn = np.array([[0.04, -0.015, 0.01], [-0.015, 0.01, 0.0], [0.01, 0.0, 0.09]])
    cases = [
        ("looking along x", 0.0, 0.1, V),
        ("looking along y, the doubts change places", np.pi / 2, 0.1, V),
        ("at an angle", 0.7, 0.1, V),
        ("twice the step, four times the noise", 0.7, 0.2, V),
        ("correlated speeds of a robot with a worn wheel", -2.0, 0.5, worn),
    ]
    return run_cases("process_noise", student, process_noise, cases, MISTAKES_NOISE)


# Exercise 4: the slip alarm.


def slip_alarm(wheels: Array, sigma: float) -> Any:
    """Front minus rear in units of its standard deviation; wheels (..., 4), sigma of one wheel."""
    return (wheels @ np.array([1.0, 1.0, -1.0, -1.0])) / (2 * sigma)


def _against(*signs: float) -> Function:
    return lambda wheels, sigma: (wheels @ np.array(signs)) / (2 * sigma)


MISTAKES_SLIP: dict[str, Function] = {
    "this pattern is a turn: right against left is what a rotating robot does": (
        _against(-1, 1, -1, 1)
    ),
    "this pattern is strafing: diagonal against diagonal is a motion": _against(-1, 1, 1, -1),
    "all wheels together are forward motion, not slip": _against(1, 1, 1, 1),
    "the sum of four independent errors has 2 sigma, not sigma": (
        lambda wheels, sigma: 2 * slip_alarm(wheels, sigma)
    ),
    "the sum of four independent errors has 2 sigma, not 4: variances add": (
        lambda wheels, sigma: slip_alarm(wheels, sigma) / 2
    ),
    "divide by the standard deviation: 2 sigma, not 4 sigma squared": (
        lambda wheels, sigma: slip_alarm(wheels, sigma) / (2 * sigma)
    ),
    "this is not yet in units of its standard deviation": (
        lambda wheels, sigma: slip_alarm(wheels, sigma) * 2 * sigma
    ),
    "the sign is reversed: a front axle that spins too fast is positive": _against(-1, -1, 1, 1),
}


def check_slip(student: Function) -> Report:
    """Check ``student(wheel_speeds (..., 4), sigma) -> alarm (...)``.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    moving = np.array([[3.0, 7.0, 1.0, 9.0], [-2.0, 4.0, 4.0, -2.0], [5.0, 5.0, 5.0, 5.0]])
    cases = [
        ("a spinning front-left wheel", [8.0, 5.0, 5.0, 5.0], 0.5),
        ("a locked rear axle", [5.0, 5.0, 1.0, 1.0], 0.5),
        ("turning and strafing", [2.0, 9.0, 6.0, 5.0], 0.3),
        ("three readings at once", moving, 0.3),
        ("pulled off course by one rear wheel", [4.0, 4.5, 4.2, 6.0], 0.2),
    ]
    return run_cases("slip_alarm", student, slip_alarm, cases, MISTAKES_SLIP)
