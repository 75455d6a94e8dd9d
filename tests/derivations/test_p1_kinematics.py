"""P1 (9)-(17) and the missing (9a): each formula against its derivation, beside the wrong forms.

The oracles are the rollers' constraint, sympy's derivatives and central differences; the printed
formulas are typed here once more, so that library and paper cannot share a slip.
"""

import numpy as np
import pytest
import sympy as sp

from slamlab.evaluation import chi2_band, nees
from slamlab.geometry import wrap_angle
from slamlab.robots import (
    YOUBOT,
    Encoders,
    Mecanum,
    Unicycle,
    dead_reckoning,
    dead_reckoning_cov,
)

EULER = Mecanum(0.0475, 0.235, 0.15, "euler")
SCHEMES = [Mecanum(0.0475, 0.235, 0.15, name) for name in ("exact", "euler", "midpoint")]
rng = np.random.default_rng(11)
POSES = np.column_stack([rng.uniform(-5, 5, (40, 2)), rng.uniform(-np.pi, np.pi, 40)])
CONTROLS = np.column_stack([rng.uniform(-1, 1, (40, 2)), rng.uniform(-2, 2, 40)])
DT = 0.1


def relative(a, b):
    """Largest difference, relative to the largest entry of what is due."""
    return np.abs(a - b).max() / np.abs(b).max()


def differences(function, at, h=1e-5):
    """Central differences of a function R^3 -> R^3, headings wrapped; columns last."""
    columns = []
    for i in range(3):
        d = np.zeros(3)
        d[i] = h
        rise = function(at + d) - function(at - d)
        rise[..., 2] = wrap_angle(rise[..., 2])
        columns.append(rise / (2 * h))
    return np.stack(columns, -1)


def printed_10(pose, u, dt):
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x = pose[..., 0] + (u[..., 0] * c - u[..., 1] * s) * dt
    y = pose[..., 1] + (u[..., 0] * s + u[..., 1] * c) * dt
    return np.stack([x, y, pose[..., 2] + u[..., 2] * dt], -1)


def printed_16(pose, u, dt):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array(
        [[1, 0, -(u[0] * s + u[1] * c) * dt], [0, 1, (u[0] * c - u[1] * s) * dt], [0, 0, 1]]
    )


def printed_17(pose):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


# --- (9) and the wheel map that P1 leaves out ---


def rolling_map(signs):
    """Wheel map of four wheels from the constraint: no slip along the roller on the floor."""
    r, lx, ly = sp.symbols("r l_x l_y", positive=True)
    v1, v2, w = sp.symbols("V_1 V_2 omega", real=True)
    rows = []
    for (x, y), sign in zip([(lx, ly), (lx, -ly), (-lx, ly), (-lx, -ly)], signs, strict=True):
        spin = sp.Symbol("spin", real=True)
        contact = sp.Matrix([v1 - w * y, v2 + w * x])
        axis = sp.Matrix([1, sign])
        solved = sp.solve(((contact - sp.Matrix([r * spin, 0])).T * axis)[0], spin)[0]
        rows.append([sp.diff(solved, v) for v in (v1, v2, w)])
    return sp.Matrix(rows), (r, lx, ly)


def test_9a_follows_from_the_rollers_and_is_inverted_by_its_pseudo_inverse():
    J, (r, lx, ly) = rolling_map((-1, 1, 1, -1))
    lever = lx + ly
    due = sp.Matrix([[1, -1, -lever], [1, 1, lever], [1, 1, -lever], [1, -1, lever]]) / r
    assert sp.simplify(J - due) == sp.zeros(4, 3)
    inverse = sp.Matrix(
        [[1, 1, 1, 1], [-1, 1, 1, -1], [-1 / lever, 1 / lever, -1 / lever, 1 / lever]]
    )
    assert sp.simplify((J.T * J).inv() * J.T - r / 4 * inverse) == sp.zeros(3, 4)
    numbers = {r: 0.0475, lx: 0.235, ly: 0.15}
    ours = np.array(J.subs(numbers), dtype=float)
    np.testing.assert_allclose(YOUBOT.wheel_map, ours, rtol=1e-12)


def test_9a_with_the_wheels_mounted_the_other_way_round_loses_its_lever():
    """Rollers as a diamond seen from above: turning hangs on l_x - l_y, nothing for a square."""
    J, (r, lx, ly) = rolling_map((1, -1, -1, 1))
    for wheel in range(4):
        assert sp.simplify(J[wheel, 2] ** 2 - (lx - ly) ** 2 / r**2) == 0
    assert J.subs(lx, ly).rank() == 2
    assert rolling_map((-1, 1, 1, -1))[0].subs(lx, ly).rank() == 3


def test_9_three_speeds_leave_one_combination_of_four_wheels_without_meaning():
    J, _ = rolling_map((-1, 1, 1, -1))
    null = J.T.nullspace()
    assert len(null) == 1
    assert sp.simplify(null[0] / null[0][0] - sp.Matrix([1, 1, -1, -1])) == sp.zeros(4, 1)
    np.testing.assert_allclose(YOUBOT.slip([1, 1, -1, -1]), [1, 1, -1, -1])


# --- (10) ---


def test_10_is_the_euler_step_and_exact_without_turning_only():
    ours = EULER.step(POSES, CONTROLS, DT)
    due = printed_10(POSES, CONTROLS, DT)
    np.testing.assert_allclose(ours[:, :2], due[:, :2], atol=1e-14)
    np.testing.assert_allclose(wrap_angle(ours[:, 2] - due[:, 2]), 0, atol=1e-14)
    straight = CONTROLS * [1, 1, 0]
    exact = YOUBOT.step(POSES, straight, DT)
    np.testing.assert_allclose(printed_10(POSES, straight, DT)[:, :2], exact[:, :2], atol=1e-14)
    assert np.abs(due - YOUBOT.step(POSES, CONTROLS, DT))[:, :2].max() > 1e-3


def test_10_integrated_over_the_step_is_the_exact_form():
    """Sympy integrates the rotating velocity; W of the repair is its mean."""
    t, dt, w, v1, v2 = sp.symbols("t dt omega V_1 V_2", positive=True)
    x = sp.integrate(v1 * sp.cos(w * t) - v2 * sp.sin(w * t), (t, 0, dt))
    y = sp.integrate(v1 * sp.sin(w * t) + v2 * sp.cos(w * t), (t, 0, dt))
    numbers = {dt: 0.7, w: 1.3, v1: 0.5, v2: 0.9}
    due = [float(e.subs(numbers)) for e in (x, y)]
    ours = YOUBOT.step([0, 0, 0], [0.5, 0.9, 1.3], 0.7)
    np.testing.assert_allclose(ours[:2], due, rtol=1e-12)
    # Midpoint and Euler, the first terms of the series in dt.
    lead = sp.series(x - v1 * dt, dt, 0, 3).removeO()
    assert sp.simplify(lead + v2 * w * dt**2 / 2) == 0
    middle = x - dt * (v1 * sp.cos(w * dt / 2) - v2 * sp.sin(w * dt / 2))
    lead = sp.series(middle, dt, 0, 4).removeO()
    assert sp.simplify(lead + v1 * w**2 * dt**3 / 24) == 0


# --- (11) ---


def full_prediction(P, F_x, Q):
    """Without blocks: the whole state moves, landmarks by the identity."""
    F = np.eye(len(P))
    F[:3, :3] = F_x
    added = np.zeros_like(P)
    added[:3, :3] = Q
    return F @ P @ F.T + added


def test_11_is_the_block_form_and_the_cross_block_has_2n_columns():
    n = 4
    root = rng.normal(size=(3 + 2 * n, 3 + 2 * n))
    P, pose, u = root @ root.T, POSES[3], CONTROLS[3]
    F_x, F_u = EULER.jacobians(pose, u, DT)
    Q = F_u @ EULER.control_cov(0.3) @ F_u.T
    due = full_prediction(P, F_x, Q)

    def predicted(columns):
        ours = P.copy()
        ours[:3, :3] = F_x @ P[:3, :3] @ F_x.T + Q
        ours[:3, 3:columns] = F_x @ P[:3, 3:columns]
        ours[3:columns, :3] = ours[:3, 3:columns].T
        return ours

    np.testing.assert_allclose(predicted(3 + 2 * n), due, rtol=1e-12, atol=1e-12)
    # The text's 3 x n leaves half of the landmarks uncorrelated with where the robot went.
    assert relative(predicted(3 + n), due) > 1e-3


# --- (12)-(14) ---


@pytest.mark.parametrize("robot", SCHEMES, ids=lambda r: r.integration)
def test_12_13_are_the_derivatives_of_the_step(robot):
    F_x, F_u = robot.jacobians(POSES, CONTROLS, 0.6)
    assert relative(F_x, differences(lambda p: robot.step(p, CONTROLS, 0.6), POSES)) < 1e-7
    due = differences(lambda u: robot.step(POSES, u, 0.6), CONTROLS)
    assert relative(F_u, due) < 1e-7
    assert relative(np.swapaxes(F_u, -1, -2), due) > 0.1


def test_14_is_the_spread_of_drawn_steps_and_its_transpose_is_not():
    V = YOUBOT.control_cov([0.5, 0.1, 0.3, 0.2])
    pose, u = np.array([0.4, -0.2, 0.9]), np.array([0.3, -0.1, 0.4])
    ends = YOUBOT.sample(np.tile(pose, (200_000, 1)), u, DT, V, np.random.default_rng(2))
    spread = ends - YOUBOT.step(pose, u, DT)
    spread[:, 2] = wrap_angle(spread[:, 2])
    F_u = YOUBOT.jacobians(pose, u, DT)[1]
    assert relative(F_u @ V @ F_u.T, np.cov(spread.T)) < 0.02
    assert relative(F_u.T @ V @ F_u, np.cov(spread.T)) > 0.1
    assert relative(V, np.cov(spread.T)) > 10, "V is a covariance of speeds, not of places"


# --- (15) ---


def test_15_is_diagonal_for_equal_wheels_and_only_for_them():
    J, (r, lx, ly) = rolling_map((-1, 1, 1, -1))
    M = sp.simplify((J.T * J).inv() * J.T)
    s = sp.symbols("s1:5", positive=True)
    V = sp.simplify(M * sp.diag(*[x**2 for x in s]) * M.T)
    equal = V.subs(dict.fromkeys(s, s[0]))
    due = s[0] ** 2 * r**2 / 4 * sp.diag(1, 1, 1 / (lx + ly) ** 2)
    assert sp.simplify(equal - due) == sp.zeros(3, 3)
    assert sp.simplify(V[0, 1]) != 0
    sigma = np.array([0.5, 0.1, 0.3, 0.2])
    numbers = {r: 0.0475, lx: 0.235, ly: 0.15, **dict(zip(s, sigma, strict=True))}
    np.testing.assert_allclose(
        YOUBOT.control_cov(sigma), np.array(V.subs(numbers), float), rtol=1e-12
    )


# --- (16), (17) ---


def test_16_and_17_with_dt_are_the_derivatives_of_10_symbolically():
    x, y, th, v1, v2, w, dt = sp.symbols("x y theta V_1 V_2 omega dt", real=True)
    f = sp.Matrix(
        [
            x + (v1 * sp.cos(th) - v2 * sp.sin(th)) * dt,
            y + (v1 * sp.sin(th) + v2 * sp.cos(th)) * dt,
            th + w * dt,
        ]
    )
    turn = [[sp.cos(th), -sp.sin(th), 0], [sp.sin(th), sp.cos(th), 0], [0, 0, 1]]
    sixteen = sp.Matrix(
        [
            [1, 0, -(v1 * sp.sin(th) + v2 * sp.cos(th)) * dt],
            [0, 1, (v1 * sp.cos(th) - v2 * sp.sin(th)) * dt],
            [0, 0, 1],
        ]
    )
    assert sp.simplify(f.jacobian([x, y, th]) - sixteen) == sp.zeros(3, 3)
    seventeen = f.jacobian([v1, v2, w])
    assert sp.simplify(seventeen - dt * sp.Matrix(turn)) == sp.zeros(3, 3)
    assert sp.simplify(seventeen - sp.Matrix(turn)) != sp.zeros(3, 3)


def test_16_as_printed_equals_differences_and_17_as_printed_does_not():
    for pose, u in zip(POSES, CONTROLS, strict=True):
        due = differences(lambda p, u=u: printed_10(p, u, DT), pose)
        assert relative(printed_16(pose, u, DT), due) < 1e-7
        assert relative(EULER.jacobians(pose, u, DT)[0], due) < 1e-7
        due = differences(lambda v, pose=pose: printed_10(pose, v, DT), u)
        assert relative(DT * printed_17(pose), due) < 1e-7
        assert relative(EULER.jacobians(pose, u, DT)[1], due) < 1e-7
        assert relative(printed_17(pose), due) == pytest.approx(9, abs=1e-6)


def test_16_of_euler_holds_for_the_other_schemes_with_their_own_displacement():
    """Whatever the scheme, a turned start turns the displacement."""
    for robot in SCHEMES:
        F_x, _ = robot.jacobians(POSES, CONTROLS, 0.6)
        move = (robot.step(POSES, CONTROLS, 0.6) - POSES)[:, :2]
        np.testing.assert_allclose(F_x[:, 0, 2], -move[:, 1], atol=1e-12)
        np.testing.assert_allclose(F_x[:, 1, 2], move[:, 0], atol=1e-12)
    printed = np.array([printed_16(p, u, 0.6) for p, u in zip(POSES, CONTROLS, strict=True)])
    assert relative(printed, YOUBOT.jacobians(POSES, CONTROLS, 0.6)[0]) > 0.05


def test_17_process_noise_scales_with_the_square_of_dt():
    """Property 5; the printed form does not know dt at all."""
    pose, u, V = POSES[8], CONTROLS[8], EULER.control_cov(0.3)

    def Q(dt):
        F_u = EULER.jacobians(pose, u, dt)[1]
        return F_u @ V @ F_u.T

    np.testing.assert_allclose(Q(0.4), 16 * Q(0.1), rtol=1e-12)
    np.testing.assert_allclose(EULER.jacobians(pose, u, 0.4)[1], 0.4 * printed_17(pose))
    exact = [YOUBOT.jacobians(pose, u, dt)[1] for dt in (0.02, 0.01)]
    assert relative(exact[0], 2 * exact[1]) < 0.03
    printed = printed_17(pose) @ V @ printed_17(pose).T
    assert relative(printed, Q(0.1)) == pytest.approx(99, rel=1e-9)


def test_17_without_dt_makes_dead_reckoning_a_hundred_times_too_modest():
    u = np.tile([0.3, 0.1, 0.2], (100, 1))
    V = YOUBOT.control_cov(0.4)
    measured = u + rng.multivariate_normal(np.zeros(3), V, (300, 100))
    truth = dead_reckoning(EULER, np.zeros(3), u, DT)[-1]
    poses = dead_reckoning(EULER, np.zeros(3), measured, DT)
    right = dead_reckoning_cov(EULER, poses, measured, DT, V)[:, -1]
    printed = np.zeros((300, 3, 3))
    for k in range(100):
        F_x = EULER.jacobians(poses[:, k], measured[:, k], DT)[0]
        turn = EULER.jacobians(poses[:, k], measured[:, k], DT)[1] / DT
        printed = F_x @ printed @ np.swapaxes(F_x, -1, -2) + turn @ V @ np.swapaxes(turn, -1, -2)
    error = poses[:, -1] - truth
    error[:, 2] = wrap_angle(error[:, 2])
    low, high = chi2_band(3, 300, 0.99)
    assert low < nees(error, right).mean() < high
    assert nees(error, printed).mean() == pytest.approx(nees(error, right).mean() / 100, rel=1e-6)


def test_a_robot_with_two_controls_needs_three_coordinates_too():
    # The text gives the third degree of freedom as the reason for three coordinates.
    def end(u):
        return dead_reckoning(Unicycle(), np.zeros(3), u.reshape(2, 2), 1.0)[-1]

    at, h = np.array([0.5, 0.4, 0.5, -0.3]), 1e-5
    slopes = np.stack([(end(at + d) - end(at - d)) / (2 * h) for d in h * np.eye(4)], -1)
    assert np.linalg.matrix_rank(slopes[:, :2], tol=1e-6) == 2
    assert np.linalg.matrix_rank(slopes, tol=1e-6) == 3


def test_15_by_experiment_on_single_readings_takes_whole_ticks_for_noise():
    coarse, u = Encoders(30, 0.04), np.tile([0.25, 0.0, 0.0], (400, 1))
    wheels = np.broadcast_to(YOUBOT.wheel_speeds(u), (1000, 400, 4))
    ticks = coarse.read(wheels, DT, np.random.default_rng(6))
    omega = YOUBOT.body_velocity(coarse.speeds(ticks, DT))[..., 2]
    due = np.sqrt(YOUBOT.control_cov(coarse.sigma_wheel(wheels[0, 0], DT))[2, 2])
    assert omega.sum(1).std() / np.sqrt(400) == pytest.approx(due, rel=0.1)
    assert omega.std() > 3 * due
