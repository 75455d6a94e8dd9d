"""P1's walls: its two sentences on extraction, and its point formulas applied to lines."""

import numpy as np
import sympy as sp

from slamlab.geometry import transform
from slamlab.mapping import fit_line, line_cov, point_covs
from slamlab.sensors import RangeBearing, Wall

x, y, theta, r, alpha, rho, phi = sp.symbols("x y theta r alpha rho varphi", real=True)
L = sp.symbols("L", positive=True)
POSE = sp.Matrix([x, y, theta])
X_S, Y_S = x + L * sp.cos(theta), y + L * sp.sin(theta)
# What a wall looks like from the sensor, on the side where the signed distance is positive.
H_LINE = sp.Matrix([r - X_S * sp.cos(alpha) - Y_S * sp.sin(alpha), alpha - theta])
# Which wall a measurement tells of.
BETA = phi + theta
G_LINE = sp.Matrix([rho + X_S * sp.cos(BETA) + Y_S * sp.sin(BETA), BETA])
RANDOM = np.random.default_rng(0)


def is_zero(matrix):
    return sp.simplify(matrix) == sp.zeros(*matrix.shape)


def numbers(matrix, pose, wall, z, offset):
    at = dict(zip((x, y, theta, r, alpha, rho, phi, L), (*pose, *wall, *z, offset), strict=True))
    return np.array(matrix.subs(at).evalf(), dtype=float)


def cases(n=12):
    """Poses, walls on the positive side, what is measured there; all quadrants."""
    sensor = Wall(0.02, 0.01, offset=0.3)
    while n:
        pose = RANDOM.uniform([-3, -3, -np.pi], [3, 3, np.pi])
        wall = np.array([RANDOM.uniform(4.8, 9), RANDOM.uniform(-np.pi, np.pi)])
        z = sensor.observe(pose, wall)
        n -= 1
        yield sensor, pose, wall, z


def test_the_line_model_is_inverted_by_its_initialisation():
    again = H_LINE.subs({r: G_LINE[0], alpha: G_LINE[1]}, simultaneous=True)
    assert is_zero(again - sp.Matrix([rho, phi]))
    for sensor, pose, wall, z in cases():
        np.testing.assert_allclose(numbers(H_LINE, pose, wall, z, 0.3)[0, 0], z[0], atol=1e-12)
        np.testing.assert_allclose(sensor.locate(pose, z), wall, atol=1e-12)


def test_22_32_for_lines_are_the_derivatives_of_the_line_model():
    printed_for_lines = sp.Matrix(
        [[-sp.cos(alpha), -sp.sin(alpha), -L * sp.sin(alpha - theta)], [0, 0, -1]]
    )
    assert is_zero(H_LINE.jacobian(POSE) - printed_for_lines)
    block = sp.Matrix([[1, X_S * sp.sin(alpha) - Y_S * sp.cos(alpha)], [0, 1]])
    assert is_zero(H_LINE.jacobian([r, alpha]) - block)
    # (31), (32), "minus the robot block", hold for points only.
    assert not is_zero(block + printed_for_lines[:, :2])
    for sensor, pose, wall, z in cases():
        H_pose, H_wall = sensor.jacobians(pose, wall)
        due = numbers(H_LINE.jacobian(POSE), pose, wall, z, 0.3)
        np.testing.assert_allclose(H_pose, due, rtol=1e-9, atol=1e-9)
        due = numbers(H_LINE.jacobian([r, alpha]), pose, wall, z, 0.3)
        np.testing.assert_allclose(H_wall, due, rtol=1e-9, atol=1e-9)


def test_39_42_for_lines_are_the_derivatives_of_the_initialisation():
    G_pose = sp.Matrix(
        [[sp.cos(BETA), sp.sin(BETA), y * sp.cos(BETA) - x * sp.sin(BETA)], [0, 0, 1]]
    )
    assert is_zero(G_LINE.jacobian(POSE) - G_pose)
    G_z = sp.Matrix([[1, Y_S * sp.cos(BETA) - X_S * sp.sin(BETA)], [0, 1]])
    assert is_zero(G_LINE.jacobian([rho, phi]) - G_z)
    for sensor, pose, wall, z in cases():
        G = sensor.locate_jacobians(pose, z)
        np.testing.assert_allclose(G[0], numbers(G_pose, pose, wall, z, 0.3), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(G[1], numbers(G_z, pose, wall, z, 0.3), rtol=1e-9, atol=1e-9)
        # (42) of the paper, the point form, is another matrix altogether.
        assert (
            np.abs(RangeBearing(1, 1, offset=0.3).locate_jacobians(pose, z)[1] - G[1]).max() > 0.1
        )


def test_the_foot_of_the_perpendicular_is_no_landmark():
    # Drive one metre along the wall x = 3: the point that (38) remembers slides along with it.
    sensor, point = Wall(1, 1), RangeBearing(1, 1)
    for step in (0.0, 1.0):
        pose = [0.0, step, 0.0]
        z = sensor.observe(pose, [3.0, 0.0])
        np.testing.assert_allclose(point.locate(pose, z), [3.0, step], atol=1e-12)
        np.testing.assert_allclose(sensor.locate(pose, z), [3.0, 0.0], atol=1e-12)


def test_least_squares_along_y_depends_on_the_heading_and_total_least_squares_does_not():
    wall = np.stack([np.linspace(-1, 1, 30), np.full(30, 1.5)], -1)
    wall += 0.03 * RANDOM.standard_normal(wall.shape)

    def ordinary(points):
        a, b = np.polyfit(points[:, 0], points[:, 1], 1)
        return np.array([b / np.hypot(a, 1), np.arctan2(1, -a)])

    worst = {}
    for name, fit in (("ordinary", ordinary), ("total", fit_line)):
        turns = np.linspace(0.0, np.pi, 25)
        errors = [
            Wall(1, 1).residual(fit(transform([0, 0, t], wall)), fit(wall) + [0, t]) for t in turns
        ]
        worst[name] = np.abs(errors).max()
    assert worst["total"] < 1e-10
    assert worst["ordinary"] > np.deg2rad(5)


def test_21_a_diagonal_covariance_is_wrong_for_a_wall():
    beams = np.deg2rad(np.arange(5, 66, 1.5))
    ray = np.stack([np.cos(beams), np.sin(beams)], -1)
    ranges = 2.0 / np.cos(beams) + 0.02 * RANDOM.standard_normal((4000, len(beams)))
    points = ranges[..., None] * ray
    errors = Wall(1, 1).residual(fit_line(points), [2.0, 0.0])
    covs = line_cov(points, point_covs(points, 0.02))
    inside = {}
    for name, C in (("full", covs), ("diagonal", covs * np.eye(2))):
        squared = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(C), errors)
        inside[name] = (squared < 5.991).mean()
    assert abs(inside["full"] - 0.95) < 0.01
    assert inside["diagonal"] < 0.935
    correlation = np.corrcoef(errors.T)[0, 1]
    assert correlation > 0.8
