"""Beliefs: an ellipse holds what it says, a root squares to its covariance, arrays are copied."""

import numpy as np
import pytest
from scipy.stats import chi2

from slamlab.gaussian import (
    Ellipse,
    Gaussian,
    chi2_quantile,
    confidence_ellipse,
    mahalanobis_squared,
    matrix_sqrt,
)

MEAN = np.array([3.0, -2.0])
COV = np.array([[4.0, 1.5], [1.5, 1.0]])


def inside(ellipse, points):
    """Which points an ellipse holds, by its own numbers."""
    c, s = np.cos(ellipse.angle), np.sin(ellipse.angle)
    along_axes = (points - ellipse.center) @ np.array([[c, -s], [s, c]])
    return ((along_axes / ellipse.half_axes) ** 2).sum(-1) <= 1


@pytest.mark.parametrize("probability", [0.5, 0.95, 0.99])
def test_an_ellipse_covers_what_it_promises_and_turned_the_other_way_it_does_not(probability):
    drawn = Gaussian(MEAN, COV).sample(np.random.default_rng(3), 40_000)
    ellipse = confidence_ellipse(MEAN, COV, probability)
    off = 4 * np.sqrt(probability * (1 - probability) / len(drawn))
    assert inside(ellipse, drawn).mean() == pytest.approx(probability, abs=off)
    reversed_angle = Ellipse(ellipse.center, ellipse.half_axes, -ellipse.angle)
    assert inside(reversed_angle, drawn).mean() < probability - 5 * off
    swapped = Ellipse(ellipse.center, ellipse.half_axes[::-1], ellipse.angle)
    assert inside(swapped, drawn).mean() < probability - 5 * off


@pytest.mark.parametrize("turn", np.deg2rad([0, 30, 90, -45, 120]))
def test_points_of_an_ellipse_lie_on_the_level_set(turn):
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, -s], [s, c]])
    cov = R @ np.diag([9.0, 0.25]) @ R.T
    ellipse = confidence_ellipse(MEAN, cov, 0.9)
    level = mahalanobis_squared(ellipse.points(36) - MEAN, cov)
    np.testing.assert_allclose(level, chi2.ppf(0.9, 2))
    assert np.sin(ellipse.angle - turn) == pytest.approx(0.0, abs=1e-9)
    assert -np.pi / 2 < ellipse.angle <= np.pi / 2


def test_a_flat_covariance_has_a_flat_ellipse():
    ellipse = confidence_ellipse([0, 0], np.diag([0.0, 4.0]))
    np.testing.assert_allclose(ellipse.half_axes, [2 * np.sqrt(chi2.ppf(0.95, 2)), 0.0])
    assert ellipse.angle == pytest.approx(np.pi / 2)


def test_ellipses_of_a_batch_are_those_of_each():
    covs = np.stack([COV, np.eye(2), np.diag([1.0, 9.0])])
    many = confidence_ellipse(np.zeros(2), covs)
    assert many.center.shape == many.half_axes.shape == (3, 2)
    assert many.points(8).shape == (3, 9, 2)
    for i, cov in enumerate(covs):
        one = confidence_ellipse([0, 0], cov)
        np.testing.assert_allclose(many.points(8)[i], one.points(8), atol=1e-12)


# Distance, quantile, root.


def test_mahalanobis_is_the_quadratic_form_of_the_inverse():
    r = np.random.default_rng(1).normal(size=(6, 2))
    due = np.einsum("ni,ij,nj->n", r, np.linalg.inv(COV), r)
    np.testing.assert_allclose(mahalanobis_squared(r, COV), due)
    assert not np.allclose(mahalanobis_squared(r, COV), np.einsum("ni,ij,nj->n", r, COV, r))


def test_the_quantile_is_that_of_scipy():
    p, dof = np.array([[0.0], [0.5], [0.99]]), np.array([1, 2, 12, 300])
    np.testing.assert_allclose(chi2_quantile(p, dof), chi2.ppf(p, dof), rtol=1e-12)
    np.testing.assert_allclose(chi2_quantile(0.95, 2), -2 * np.log(0.05))
    np.testing.assert_array_equal(chi2_quantile(0.99, [0, 2]), [0.0, chi2_quantile(0.99, 2)])


@pytest.mark.parametrize("rank", [1, 2, 4])
def test_a_root_times_its_transpose_is_the_covariance(rank):
    half = np.random.default_rng(rank).normal(size=(5, 4, rank))
    cov = half @ np.swapaxes(half, -1, -2)
    A = matrix_sqrt(cov)
    np.testing.assert_allclose(A @ np.swapaxes(A, -1, -2), cov, atol=1e-12)
    assert not np.allclose(np.swapaxes(A, -1, -2) @ A, cov)


# The belief itself.


def test_samples_have_the_mean_and_the_covariance():
    drawn = Gaussian(MEAN, COV).sample(np.random.default_rng(5), 50_000)
    np.testing.assert_allclose(drawn.mean(0), MEAN, atol=0.04)
    np.testing.assert_allclose(np.cov(drawn.T), COV, atol=0.1)


def test_samples_of_a_certain_belief_are_its_mean():
    drawn = Gaussian(MEAN, np.diag([0.0, 1.0])).sample(np.random.default_rng(5), (3, 4))
    assert drawn.shape == (3, 4, 2)
    np.testing.assert_array_equal(drawn[..., 0], MEAN[0])


def test_a_belief_keeps_copies():
    mean, cov = MEAN.copy(), COV.copy()
    belief = Gaussian(mean, cov)
    mean += 1
    cov += 1
    np.testing.assert_array_equal(belief.mean, MEAN)
    np.testing.assert_array_equal(belief.cov, COV)


def test_dim_and_sigma():
    belief = Gaussian(np.zeros((7, 2)), COV)
    assert belief.dim == 2
    np.testing.assert_allclose(belief.sigma, [2.0, 1.0])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Gaussian([0, 0], np.eye(3)), r"cov: expected shape \(\.\.\., 2, 2\)"),
        (lambda: Gaussian(0.0, [[1.0]]), r"mean: expected shape \(\.\.\., n\), got \(\)"),
        (lambda: Gaussian([0, 0], [[1, 2], [0, 1]]), "cov: expected a symmetric matrix"),
        (lambda: Gaussian([0, 0], np.diag([1, -1])), "smallest eigenvalue is -1"),
        (lambda: mahalanobis_squared([1, 2], np.zeros((2, 2))), "cov: expected a positive def"),
        (lambda: confidence_ellipse([0, 0], np.eye(2), 1.0), "probability: expected"),
        (lambda: chi2_quantile(1.0, 2), "probability: expected numbers in"),
        (lambda: chi2_quantile(0.5, -1), "dof: expected numbers of at least 0"),
        (lambda: chi2_quantile([0.5, 0.6], [1, 2, 3]), "dof: expected leading axes"),
        (lambda: matrix_sqrt(np.ones(3)), "cov: expected shape"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
