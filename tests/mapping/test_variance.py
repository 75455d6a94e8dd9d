"""The variance grid: densities, order, tilt, jumps; and the height map that feels the last two."""

import numpy as np
import pytest
from scipy import integrate, stats

from slamlab.grids import Grid
from slamlab.mapping.variance import HeightGrid, VarianceGrid, log_density
from slamlab.sensors import StereoRig
from slamlab.simulation import ground_laps
from slamlab.worlds import Terrain

CELLS = [(2, 1.0, 1e-3), (4, 1.0, 1e-3), (9, 3.5, 0.02), (30, 40.0, 0.05)]


def grid():
    return Grid((12, 12), 0.5, (-3.0, -3.0))


def picture(seed, n=600):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2.5, 2.5, (n, 2))
    return points, rng.normal(size=n) * np.exp(rng.normal(size=n)) * 0.03


# Densities.


@pytest.mark.parametrize(("nu", "alpha", "beta"), CELLS)
def test_the_density_of_a_sample_variance_integrates_to_1(nu, alpha, beta):
    def density(x):  # over x = ln s2
        return np.exp(log_density(np.exp(x), nu, alpha, beta) + x)

    middle = np.log(beta / alpha)
    area = sum(
        integrate.quad(density, middle + a, middle + b, epsabs=1e-13, epsrel=1e-12, limit=200)[0]
        for a, b in [(-60, -5), (-5, 0), (0, 5), (5, 60)]
    )
    assert area == pytest.approx(1, abs=1e-8)
    # Wrong: alpha + nu where alpha + nu / 2 is due.
    wrong = integrate.quad(
        lambda x: density(x) * (beta + 0.5 * nu * np.exp(x)) ** (-0.5 * nu),
        middle - 30,
        middle + 30,
        limit=200,
    )[0]
    assert abs(wrong - 1) > 1e-2


@pytest.mark.parametrize(("nu", "alpha", "beta"), CELLS)
def test_it_is_an_f_distribution(nu, alpha, beta):
    s2 = np.geomspace(1e-5, 1.0, 30)
    due = stats.f(nu, 2 * alpha).logpdf(alpha * s2 / beta) + np.log(alpha / beta)
    np.testing.assert_allclose(log_density(s2, nu, alpha, beta), due, atol=1e-9)
    # Wrong: alpha degrees of freedom instead of twice as many.
    wrong = stats.f(nu, alpha).logpdf(alpha * s2 / beta) + np.log(alpha / beta)
    assert np.abs(log_density(s2, nu, alpha, beta) - wrong).max() > 0.02


def test_drawn_variances_follow_it():
    rng, nu, alpha, beta = np.random.default_rng(1), 6, 2.5, 0.01
    tau = rng.gamma(alpha, 1 / beta, 20_000)
    s2 = (rng.standard_normal((20_000, nu + 1)) / np.sqrt(tau)[:, None]).var(1, ddof=1)
    assert stats.kstest(alpha * s2 / beta, stats.f(nu, 2 * alpha).cdf).pvalue > 0.01
    # Wrong: the sum of squares over the number of heights.
    biased = s2 * nu / (nu + 1)
    assert stats.kstest(alpha * biased / beta, stats.f(nu, 2 * alpha).cdf).pvalue < 1e-6


def test_two_heights_differ_by_a_student_number():
    alpha, beta, d = 1.7, 0.02, np.linspace(0.01, 1, 20)
    due = stats.t(2 * alpha, scale=np.sqrt(2 * beta / alpha)).logpdf(d)
    np.testing.assert_allclose(log_density(d**2 / 2, 1, alpha, beta, "heights"), due, atol=1e-12)


def test_the_density_of_heights_is_the_integral_over_mean_and_precision():
    z, alpha, beta = np.array([0.1, -0.05, 0.02, 0.3]), 2.0, 0.03

    def joint(log_tau):
        tau = np.exp(log_tau)
        s = np.sum((z - z.mean()) ** 2)
        over_mean = (tau / (2 * np.pi)) ** 2 * np.exp(-0.5 * tau * s)
        over_mean *= np.sqrt(2 * np.pi / (tau * 4))
        return over_mean * stats.gamma(alpha, scale=1 / beta).pdf(tau) * tau

    area = integrate.quad(joint, -5, 12, epsrel=1e-11)[0]
    got = log_density(z.var(ddof=1), 3, alpha, beta, "heights")
    assert got == pytest.approx(np.log(area), abs=1e-8)


def test_the_two_densities_differ_by_what_does_not_depend_on_the_map():
    rng = np.random.default_rng(2)
    s2, alpha, beta = (rng.uniform(0.01, 2, 20) for _ in range(3))
    off = log_density(s2, 5, alpha, beta) - log_density(s2, 5, 3.0, 0.1)
    same = log_density(s2, 5, alpha, beta, "heights") - log_density(s2, 5, 3.0, 0.1, "heights")
    np.testing.assert_allclose(off, same, atol=1e-9)


# The map.


def test_the_order_of_the_pictures_does_not_matter():
    pose, pictures = np.array([0.2, -0.1, 0.4]), [picture(k) for k in range(4)]
    maps = []
    for order in ([0, 1, 2, 3], [3, 1, 0, 2]):
        maps.append(VarianceGrid(grid()))
        for k in order:
            maps[-1].insert(pose, *pictures[k])
    np.testing.assert_allclose(maps[0].alpha, maps[1].alpha)
    np.testing.assert_allclose(maps[0].beta, maps[1].beta)
    # Wrong: a map that remembers the last variance only.
    last = [np.var(pictures[k][1]) for k in (3, 2)]
    assert last[0] != pytest.approx(last[1])


def test_a_cell_is_updated_as_by_hand():
    points, heights = np.array([[0.1, 0.1], [0.2, 0.1], [0.3, 0.4]]), np.array([0.0, 0.1, 0.2])
    ground = VarianceGrid(grid(), alpha=2.0, beta=0.5)
    ground.insert([0, 0, 0], points, heights)
    row, column = grid().cells([0.1, 0.1])
    # Three heights: nu = 2, s2 = 0.01; alpha = 2 + 1, beta = 0.5 + 0.01.
    assert ground.alpha[row, column] == pytest.approx(3.0)
    assert ground.beta[row, column] == pytest.approx(0.51)
    assert ground.roughness[row, column] == pytest.approx(np.sqrt(0.51 / 3))
    assert np.isnan(ground.roughness).sum() == 143


def test_a_lonely_height_says_nothing():
    ground = VarianceGrid(grid())
    point, height = np.array([[0.1, 0.1]]), np.array([7.0])
    assert ground.log_likelihood([0, 0, 0], point, height) == 0.0
    ground.insert([0, 0, 0], point, height)
    assert np.isnan(ground.roughness).all()


def test_points_outside_and_lost_points_are_nothing():
    points, heights = picture(1)
    one, other = VarianceGrid(grid()), VarianceGrid(grid())
    one.insert([0, 0, 0], points, heights)
    more = np.concatenate([points, [[50.0, 0.0], [np.nan, np.nan]]])
    other.insert([0, 0, 0], more, np.append(heights, [9.0, np.nan]))
    np.testing.assert_array_equal(one.beta, other.beta)


def drawn():
    """Two grids of one lap of level pictures, and pictures of the next lap."""
    rng = np.random.default_rng(3)
    ground, rig = Terrain.rough(rng, (18.0, 18.0)), StereoRig(2000)
    log = ground_laps(ground, rig, rng, radius=3.0, step=0.6, sway=(0, 0, 0))
    half = len(log) // 2
    maps = VarianceGrid(Grid((72, 72), 0.25)), HeightGrid(Grid((72, 72), 0.25))
    for k in range(half):
        up = rig.heights(log.ranges[k]) + log.notes["ground"][k]
        for one in maps:
            one.insert(log.truth[k], rig.points(log.ranges[k]), up)
    at = range(half, len(log), 3)
    up = [rig.heights(log.ranges[k]) + log.notes["ground"][k] for k in at]
    return maps, [
        (log.truth[k], rig.points(log.ranges[k]), z) for k, z in zip(at, up, strict=True)
    ]


def test_tilt_and_jumps_do_not_reach_the_variances_and_do_reach_the_heights():
    (rough, high), pictures = drawn()
    level, aside, tilted = (np.zeros((len(pictures), 2)) for _ in range(3))
    for k, (pose, points, heights) in enumerate(pictures):
        swayed = heights + 0.05 + np.tan(np.deg2rad(1.0)) * points[:, 0]
        for j, one in enumerate((rough, high)):
            level[k, j] = one.log_likelihood(pose, points, heights)
            aside[k, j] = one.log_likelihood(pose + [0.25, 0, 0], points, heights)
            tilted[k, j] = one.log_likelihood(pose, points, swayed)
        jumped = rough.log_likelihood(pose, points, heights + 0.05)
        assert jumped == pytest.approx(level[k, 0], rel=1e-9)
    cost_of_sway, cost_of_a_cell = np.abs(tilted - level).mean(0), (level - aside).mean(0)
    assert cost_of_sway[0] < 0.01 * np.abs(level[:, 0]).mean()
    # A degree and 5 cm: a tenth of what a cell aside costs the one map, many times that the other.
    assert cost_of_sway[0] < 0.1 * cost_of_a_cell[0]
    assert cost_of_sway[1] > 5 * cost_of_a_cell[1] > 0


def test_a_height_map_that_takes_the_plane_off_does_not_mind_a_camera_that_leans():
    _, pictures = drawn()
    plain, level = HeightGrid(Grid((72, 72), 0.25)), HeightGrid(Grid((72, 72), 0.25), level=True)
    pose, points, heights = pictures[0]
    leaning = heights + 0.05 + np.tan(np.deg2rad(1.0)) * points[:, 0]
    for one, kept in ((plain, False), (level, True)):
        one.insert(pose, points, heights)
        fits = [one.log_likelihood(pose, points, z) for z in (heights, leaning)]
        aside = one.log_likelihood(pose + [0.25, 0, 0], points, heights)
        assert (fits[0] - fits[1] < 0.01 * (fits[0] - aside)) == kept
    before = level.mean.copy()
    level.insert(pose, points, leaning)
    assert np.abs(level.mean - before).max() < 0.01
    plain.insert(pose, points, leaning)
    assert np.abs(plain.mean - before).max() > 0.02
    # A picture that shows nothing has no plane.
    assert level.log_likelihood(pose, points[:0], heights[:0]) == 0.0


def test_a_height_map_is_a_kalman_filter_of_one_number():
    one = HeightGrid(Grid((1, 1), 1.0), sigma=0.1, prior=2.0)
    z = np.array([0.4, 0.6, 0.5])
    one.insert([0, 0, 0], [[0.5, 0.5]] * 3, z)
    precision = 1 / 4 + 3 / 0.01
    assert one.var[0, 0] == pytest.approx(1 / precision)
    assert one.mean[0, 0] == pytest.approx(z.sum() / 0.01 / precision)
    due = stats.norm(one.mean[0, 0], np.sqrt(one.var[0, 0] + 0.01)).logpdf(0.7)
    assert one.log_likelihood([0, 0, 0], [[0.5, 0.5]], [0.7]) == pytest.approx(due)


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("s2: expected positive", lambda: log_density(0.0, 2, 1.0, 1.0)),
        ("of: expected one of", lambda: log_density(1.0, 2, 1.0, 1.0, "depths")),
        ("grid: expected a Grid", lambda: VarianceGrid((3, 3))),
        ("alpha", lambda: VarianceGrid(grid(), alpha=0.0)),
        ("beta", lambda: VarianceGrid(grid(), beta=-1.0)),
        ("sigma", lambda: HeightGrid(grid(), sigma=0.0)),
        ("points: expected", lambda: VarianceGrid(grid()).insert([0, 0, 0], [1.0], [1.0])),
        ("heights: expected", lambda: VarianceGrid(grid()).insert([0, 0, 0], [[1.0, 1]], [1, 2])),
        ("pose: expected", lambda: HeightGrid(grid()).log_likelihood([0, 0], [[1.0, 1]], [1.0])),
        (
            "of: expected",
            lambda: VarianceGrid(grid()).log_likelihood([0, 0, 0], [[1, 1]], [1], "x"),
        ),
    ],
)
def test_bad_input_is_named(message, call):
    with pytest.raises(ValueError, match=message):
        call()
