"""The normalised eight-point algorithm against the closed form, and what it is without Hartley."""

import numpy as np
import pytest

from slamlab.geometry import rotation
from slamlab.matching import (
    eight_point_rows,
    epipolar_distances,
    fundamental_matrix,
    hartley_transform,
)

CAMERA = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
MOVE = np.array([2.0, 0.5, 0.2])


def turned():
    R = np.eye(3)
    R[:2, :2] = rotation(0.05)
    return R


def pictures(rng, n=40, depth=(25.0, 40.0), noise=0.0):
    """The same n points in two pictures of 640 x 480 pixels, taken 2 m apart."""
    deep = rng.uniform(*depth, n)
    X = deep[:, None] * np.column_stack(
        [rng.uniform(-0.5, 0.5, n), rng.uniform(-0.35, 0.35, n), np.ones(n)]
    )
    images = []
    for points in (X, X @ turned().T + MOVE):
        seen = points @ CAMERA.T
        images.append(seen[:, :2] / seen[:, 2:] + noise * rng.standard_normal((n, 2)))
    return images


def due():
    """F = K^-T [t]_x R K^-1, of unit length."""
    x, y, z = MOVE
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    back = np.linalg.inv(CAMERA)
    F = back.T @ cross @ turned() @ back
    return F / np.linalg.norm(F)


def test_it_is_the_closed_form_without_noise():
    F = fundamental_matrix(*pictures(np.random.default_rng(0)))
    F *= np.sign((F * due()).sum())
    np.testing.assert_allclose(F, due(), atol=1e-8)
    assert abs(np.linalg.det(F)) < 1e-18
    wrong = due().T  # the pictures exchanged
    assert np.abs(F - wrong).max() > 1e-3


def test_eight_pairs_are_enough_and_seven_are_not():
    first, second = pictures(np.random.default_rng(1), 8)
    assert epipolar_distances(fundamental_matrix(first, second), first, second).max() < 1e-6
    with pytest.raises(ValueError, match="first: expected at least 8 points, got 7"):
        fundamental_matrix(first[:7], second[:7])


def test_normalisation_makes_the_problem_well_conditioned():
    """Hartley's reason: numbers of 1 to 400 000 in one row, against numbers of about 1."""
    first, second = pictures(np.random.default_rng(2), noise=0.5)

    def condition(one, other):
        s = np.linalg.svd(eight_point_rows(one, other), compute_uv=False)
        return s[0] / s[7]

    T, T_there = hartley_transform(first), hartley_transform(second)
    moved = [p @ M[:2, :2].T + M[:2, 2] for p, M in ((first, T), (second, T_there))]
    assert condition(*moved) < 1e3
    assert condition(first, second) > 1e5


def test_without_normalisation_noise_of_half_a_pixel_misses_by_pixels():
    rng, right, raw = np.random.default_rng(3), [], []
    clean = pictures(np.random.default_rng(9))
    for _ in range(40):
        noisy = pictures(rng, noise=0.5)
        right.append(epipolar_distances(fundamental_matrix(*noisy), *clean).mean())
        bare = fundamental_matrix(*noisy, normalised=False)
        raw.append(epipolar_distances(bare, *clean).mean())
    assert np.median(right) < 0.8
    assert np.median(raw) > 2 * np.median(right)


def test_flat_ground_leaves_it_open():
    """All points in one plane: the rows have rank 6, and any camera would do."""
    first, second = pictures(np.random.default_rng(4), depth=(30.0, 30.0))
    rows = eight_point_rows(
        *(p @ (T := hartley_transform(p))[:2, :2].T + T[:2, 2] for p in (first, second))
    )
    s = np.linalg.svd(rows, compute_uv=False)
    assert s[5] > 1e-2
    assert s[6] < 1e-9


def test_hartley_centres_and_scales():
    points = np.random.default_rng(5).uniform(0, 640, (30, 2))
    T = hartley_transform(points)
    moved = points @ T[:2, :2].T + T[:2, 2]
    np.testing.assert_allclose(moved.mean(0), 0, atol=1e-12)
    assert np.linalg.norm(moved, axis=1).mean() == pytest.approx(np.sqrt(2))


@pytest.mark.parametrize("points", [np.ones((9, 2)), np.empty((0, 2))])
def test_points_at_one_place_are_refused(points):
    with pytest.raises(ValueError, match="points: expected different points"):
        hartley_transform(points)


def test_pairs_must_be_pairs():
    first, second = pictures(np.random.default_rng(6))
    for call in (fundamental_matrix, eight_point_rows):
        with pytest.raises(ValueError, match="second"):
            call(first, second[:-1])
    with pytest.raises(ValueError, match="F"):
        epipolar_distances(np.eye(2), first, second)


def test_a_matrix_that_allows_a_point_no_line_gives_no_distance():
    points = np.array([[100.0, 40.0], [0.0, 0.0]])
    with pytest.raises(ValueError, match="F: expected a line for each point .* point 0"):
        epipolar_distances(np.zeros((3, 3)), points, points)
    # The epipole itself has none either: here it is the point (0, 0).
    forward = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    with pytest.raises(ValueError, match="point 1"):
        epipolar_distances(forward, points, points)
    assert np.isfinite(epipolar_distances(forward, points[:1], points[:1])).all()


@pytest.mark.parametrize("normalised", [True, False])
@pytest.mark.parametrize("case", ["stood still", "only turned", "one plane", "come again"])
def test_pairs_that_many_f_fit_are_refused(case, normalised):
    rng, n = np.random.default_rng(3), 12
    pixels = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])

    def picture(points, turn=0.0, shift=(0.0, 0.0, 0.0)):
        c, s = np.cos(turn), np.sin(turn)
        seen = (points @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T + shift) @ pixels.T
        return seen[:, :2] / seen[:, 2:]

    points = rng.uniform([-5, -3, 4], [5, 3, 20], (n, 3))
    motion = {"stood still": (0.0,), "only turned": (0.1,)}.get(case, (0.1, (-0.5, 0.0, 0.1)))
    if case == "one plane":
        points[:, 2] = 8.0 + 0.3 * points[:, 0]
    if case == "come again":
        points = points[np.arange(n) % 7]
    pairs = picture(points), picture(points, *motion)
    with pytest.raises(ValueError, match="first, second: expected pairs that determine F"):
        fundamental_matrix(*pairs, normalised=normalised)
    # A millimetre of motion, and points in a relief, are enough.
    points = rng.uniform([-5, -3, 4], [5, 3, 20], (n, 3))
    pairs = picture(points), picture(points, 0.0, (-1e-3, 0.0, 0.0))
    F = fundamental_matrix(*pairs, normalised=normalised)
    assert epipolar_distances(F, *pairs).max() < 1e-6
