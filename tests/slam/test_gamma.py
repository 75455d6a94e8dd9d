"""Gamma-SLAM: the same map as the plain grid, the right density, better than its odometry."""

from functools import cache

import numpy as np
import pytest

from slamlab.evaluation import ate, run
from slamlab.grids import Grid
from slamlab.localization import DeadReckoning
from slamlab.mapping.variance import VarianceGrid
from slamlab.robots import RelativePose
from slamlab.sensors import Lidar, StereoRig
from slamlab.simulation import ground_laps
from slamlab.slam import GammaSlam
from slamlab.worlds import Terrain

RIG = StereoRig(2000)


@cache
def laps(seed=1, rig=RIG, radius=3.0, spread=0.9):
    rng = np.random.default_rng(seed)
    ground = Terrain.rough(rng, (2 * radius + 12, 2 * radius + 12), spread=spread)
    return ground_laps(ground, rig, rng, radius=radius)


def slam(pose, n_particles=20, seed=2, **options):
    return GammaSlam(RIG, pose, n_particles, rng=np.random.default_rng(seed), **options)


@pytest.mark.parametrize("density", ["heights", "variances"])
def test_one_particle_draws_and_weighs_as_the_plain_grid(density):
    log, total = laps()[:6], 0.0
    one = slam(log.truth[0], 1, density=density, temper=1.0)
    plain = None
    for k, step in enumerate(log):
        if k:
            one.predict(step.u, step.dt, np.zeros((3, 3)))
        pose = one.pose
        evidence = one.update(step.ranges)
        points, heights = RIG.points(step.ranges), RIG.heights(step.ranges)
        drawn = one.map()
        if plain is not None:
            grid = Grid(drawn.grid.shape, 0.25, drawn.grid.origin)
            grown = VarianceGrid(grid)
            row, column = grid.cells(plain.grid.centres()).transpose(2, 0, 1)
            grown.alpha[row, column], grown.beta[row, column] = plain.alpha, plain.beta
            plain = grown
        else:
            plain = VarianceGrid(Grid(drawn.grid.shape, 0.25, drawn.grid.origin))
        due = plain.log_likelihood(pose, points, heights, density)
        assert evidence == pytest.approx(due, rel=1e-4)
        plain.insert(pose, points, heights)
        np.testing.assert_allclose(drawn.alpha, plain.alpha)
        np.testing.assert_allclose(drawn.beta, plain.beta, rtol=1e-4)
        total += evidence
    assert total > 0


def test_it_halves_the_error_of_its_odometry_twice():
    # Longer drives are in the slow test below, five of them in the chapter.
    log = laps(1, StereoRig(3000), 5.0)
    dead = run(DeadReckoning(RelativePose(), log.truth[0]), log)
    good = run(GammaSlam(log.scan, log.truth[0], 40, rng=np.random.default_rng(2)), log)
    assert ate(good).rmse < 0.05
    assert ate(dead).rmse > 4 * ate(good).rmse


@pytest.mark.slow
@pytest.mark.needs_numba(reason="three drives of Gamma-SLAM take more than 20 s")
def test_the_median_of_three_drives_is_less_than_half_of_the_odometrys():
    rig, errors = StereoRig(3000), []
    for seed in range(1, 4):
        log = laps(seed, rig, 7.0)
        start = log.truth[0]
        systems = [DeadReckoning(RelativePose(), start)]
        for density in ("heights", "variances"):
            rng = np.random.default_rng(seed)
            systems.append(GammaSlam(rig, start, 30, rng=rng, density=density))
        errors.append([ate(run(system, log)).rmse for system in systems])
    odometry, heights, variances = np.median(errors, axis=0)
    assert heights < 0.25 * odometry
    # Wrong: densities of different statistics, compared.
    assert variances > 2 * heights


def test_where_all_ground_is_alike_nothing_is_recognised():
    log = laps(spread=0.0)
    dead = run(DeadReckoning(RelativePose(), log.truth[0]), log)
    assert ate(run(slam(log.truth[0], 40), log)).rmse > 0.5 * ate(dead).rmse


def test_particles_share_their_maps_until_they_write():
    log = laps()[:15]
    one = run(slam(log.truth[0]), log).system
    cells = sum(int((one.map(i).alpha > 1).sum()) for i in range(20))
    assert one.map_bytes < 8 * cells * 3
    before, after = one.map(0), one.map(1)
    before.alpha[:] = 0.0
    np.testing.assert_array_equal(one.map(1).alpha, after.alpha)
    assert (one.map(0).alpha >= 1).all()


def test_a_picture_that_shows_nothing_changes_nothing():
    log = laps()
    one = slam(log.truth[0])
    one.update(log.ranges[0])
    before, poses = one.map(0), one.poses
    for nothing in (np.nan, np.inf):
        assert one.update(np.full(RIG.n_beams, nothing)) == 0.0
    np.testing.assert_array_equal(one.map(0).beta, before.beta)
    np.testing.assert_array_equal(one.poses, poses)


def test_the_same_seed_is_the_same_run_in_one_line():
    log = laps()[:10]
    one, other = run(slam(log.truth[0]), log), run(slam(log.truth[0]), log)
    np.testing.assert_array_equal(one.poses, other.poses)
    assert repr(one.system).startswith("GammaSlam(20 particles, ")
    assert "\n" not in repr(one.system)


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("rig: expected a .*, which has no heights", lambda: GammaSlam(Lidar(8), rng=None)),
        ("density: expected one of", lambda: slam([0, 0, 0], density="depths")),
        ("n_particles", lambda: slam([0, 0, 0], 0)),
        ("resolution", lambda: slam([0, 0, 0], resolution=0.0)),
        ("alpha", lambda: slam([0, 0, 0], alpha=0.0)),
        ("temper", lambda: slam([0, 0, 0], temper=0.0)),
        ("pose: expected shape", lambda: slam([0, 0])),
        ("ranges: expected shape", lambda: slam([0, 0, 0]).update(np.ones(5))),
        ("ranges", lambda: slam([0, 0, 0]).update(-np.ones(RIG.n_beams))),
        ("particle: expected a map", lambda: slam([0, 0, 0]).map()),
        ("particle: expected at most", lambda: slam([0, 0, 0]).map(20)),
    ],
)
def test_bad_input_is_named(message, call):
    with pytest.raises(ValueError, match=message):
        call()
