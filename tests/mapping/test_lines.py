"""A line through points: the fit, and its covariance."""

import numpy as np
import pytest
from scipy.stats import chi2

from slamlab.evaluation import chi2_band
from slamlab.geometry import transform
from slamlab.mapping import fit_line, line_cov, point_covs
from slamlab.sensors import Wall


def squared(error, covs):
    """Squared Mahalanobis distances (n,) of errors (n, 2)."""
    return (error * np.linalg.solve(covs, error[..., None])[..., 0]).sum(-1)


def slanted(rng, k=40, alpha=2.0):
    """Noisy points of a wall."""
    along = np.linspace(-1, 2, k)[:, None]
    points = 1.5 * np.array([np.cos(alpha), np.sin(alpha)]) + along * [
        -np.sin(alpha),
        np.cos(alpha),
    ]
    return points + 0.05 * rng.standard_normal(points.shape)


def test_the_line_is_the_smallest_singular_direction_of_the_centred_points():
    rng = np.random.default_rng(0)
    points = np.stack([slanted(rng, alpha=a) for a in np.linspace(-np.pi, np.pi, 30)])
    for cloud, (r, alpha) in zip(points, fit_line(points), strict=True):
        normal = np.linalg.svd(cloud - cloud.mean(0))[2][1]
        assert abs(normal @ [np.cos(alpha), np.sin(alpha)]) == pytest.approx(1, abs=1e-12)
        assert r == pytest.approx(abs(normal @ cloud.mean(0)), abs=1e-12)
        assert -np.pi < alpha <= np.pi


def test_no_other_line_has_less_squared_distance():
    points = slanted(np.random.default_rng(1))

    def cost(r, alpha):
        return ((points @ [np.cos(alpha), np.sin(alpha)] - r) ** 2).sum()

    r, alpha = fit_line(points)
    nearby = [cost(r + dr, alpha + da) for dr in (-0.01, 0, 0.01) for da in (-0.01, 0, 0.01)]
    assert np.argmin(nearby) == 4


def test_a_turn_of_the_points_turns_the_total_least_squares_line_and_not_the_ordinary_one():
    points = slanted(np.random.default_rng(2), alpha=0.6)

    def ordinary(points):
        # y = a x + b, written as (r, alpha).
        a, b = np.polyfit(points[:, 0], points[:, 1], 1)
        return np.array([b, 0.0]) / np.hypot(a, 1) + [0, np.arctan2(1, -a)]

    worst = {"total": 0.0, "ordinary": 0.0}
    for turn in np.linspace(-3, 3, 25):
        turned = transform([0, 0, turn], points)
        for name, fit in (("total", fit_line), ("ordinary", ordinary)):
            due = fit(points) + [0, turn]
            error = np.abs(Wall(1, 1).residual(fit(turned), due)).max()
            worst[name] = max(worst[name], float(error))
    assert worst["total"] < 1e-10
    assert worst["ordinary"] > 0.05


def test_exact_points_give_the_exact_line_also_through_the_origin_and_upright():
    for r, alpha in [(0.0, 0.3), (2.0, 0.0), (2.0, np.pi), (1.0, -np.pi / 2), (5.0, 3.0)]:
        normal = np.array([np.cos(alpha), np.sin(alpha)])
        points = r * normal + np.linspace(-1, 3, 7)[:, None] * [-normal[1], normal[0]]
        error = Wall(1, 1).residual(fit_line(points), [r, alpha])
        np.testing.assert_allclose(error, 0, atol=1e-12)


def test_batches_of_clouds_equal_single_ones():
    rng = np.random.default_rng(3)
    clouds = np.stack([slanted(rng, alpha=a) for a in (0.1, 2.0, -2.5)])
    covs = point_covs(clouds, 0.02, 0.01)
    for i, cloud in enumerate(clouds):
        np.testing.assert_allclose(fit_line(clouds)[i], fit_line(cloud), rtol=1e-14)
        np.testing.assert_allclose(line_cov(clouds, covs)[i], line_cov(cloud, covs[i]), rtol=1e-12)


def test_point_covariances_are_the_first_order_image_of_range_and_bearing():
    origin, rho, phi = np.array([0.5, -1.0]), 3.0, 2.2
    point = origin + rho * np.array([np.cos(phi), np.sin(phi)])
    J = np.array([[np.cos(phi), -rho * np.sin(phi)], [np.sin(phi), rho * np.cos(phi)]])
    due = J @ np.diag([0.02**2, 0.01**2]) @ J.T
    np.testing.assert_allclose(point_covs(point, 0.02, 0.01, origin=origin), due, rtol=1e-12)
    # As if the sensor stood at the origin of the frame: another ellipse.
    assert not np.allclose(point_covs(point, 0.02, 0.01), due, rtol=0.1)


def test_the_covariance_is_the_first_order_image_of_the_noise_of_the_points():
    rng = np.random.default_rng(4)
    for alpha in (0.4, 2.0, -1.2):
        points = slanted(rng, k=12, alpha=alpha)
        covs = point_covs(points, 0.02, 0.01)
        J = np.zeros((2, 24))
        for column in range(24):
            step = np.zeros(24)
            step[column] = 1e-6
            plus, minus = (fit_line(points + s * step.reshape(12, 2)) for s in (1, -1))
            J[:, column] = (plus - minus) / 2e-6
        due = sum(J[:, 2 * i : 2 * i + 2] @ covs[i] @ J[:, 2 * i : 2 * i + 2].T for i in range(12))
        # The formula takes the points as lying on the line; these stray by 5 cm from 3 m of it.
        np.testing.assert_allclose(line_cov(points, covs), due, rtol=0.1, atol=1e-7)


@pytest.mark.parametrize(("sigma_range", "sigma_bearing"), [(0.02, 0.0), (0.01, 0.01)])
def test_monte_carlo_errors_of_r_and_alpha_have_the_stated_covariance(sigma_range, sigma_bearing):
    rng = np.random.default_rng(5)
    n_runs, wall = 4000, np.array([2.0, 0.5])
    phi = wall[1] + np.deg2rad(np.arange(5, 66, 1.5))
    rho = wall[0] / np.cos(phi - wall[1]) + sigma_range * rng.standard_normal((n_runs, len(phi)))
    phi = phi + sigma_bearing * rng.standard_normal((n_runs, len(phi)))
    points = rho[..., None] * np.stack([np.cos(phi), np.sin(phi)], -1)
    error = Wall(1, 1).residual(fit_line(points), wall)
    covs = line_cov(points, point_covs(points, sigma_range, sigma_bearing))
    nees = squared(error, covs)
    low, high = chi2_band(2, n_runs)
    assert low < nees.mean() < high
    assert (nees < chi2.ppf(0.95, 2)).mean() == pytest.approx(0.95, abs=0.012)
    # Wrong forms: r and alpha as if independent; every point with the same round error.
    apart = (squared(error, covs * np.eye(2)) < chi2.ppf(0.95, 2)).mean()
    assert abs(apart - 0.95) > 0.012
    if sigma_bearing == 0:
        isotropic = np.broadcast_to(sigma_range**2 * np.eye(2), (*points.shape, 2))
        assert squared(error, line_cov(points, isotropic)).mean() < low


def test_fits_without_a_line_are_refused():
    with pytest.raises(ValueError, match="at least two"):
        fit_line(np.ones((1, 2)))
    with pytest.raises(ValueError, match="favour a direction"):
        fit_line(np.ones((5, 2)))
    with pytest.raises(ValueError, match="favour a direction"):
        fit_line([[1, 0], [0, 1], [-1, 0], [0, -1]])
    with pytest.raises(ValueError, match="covs: expected shape"):
        line_cov(np.ones((5, 2)), np.ones((4, 2, 2)))
    with pytest.raises(ValueError, match="points: expected finite"):
        fit_line([[np.nan, 0], [0, 1]])
