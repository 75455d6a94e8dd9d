"""Sonar: the first echo of a cone, and a turn on the spot."""

import numpy as np
import pytest

from slamlab.sensors import Lidar, Sonar
from slamlab.worlds import WallWorld

BOX = WallWorld.from_polygons([[0, 0], [4, 0], [4, 3], [0, 3]])


def test_a_slanted_wall_answers_from_its_nearest_point_in_the_cone():
    sonar = Sonar(opening=0.6)
    for slant in (0.0, 0.1, 0.3, 0.5, -0.4):
        # The wall ahead is 1.5 m away at right angles.
        due = 1.5 / np.cos(max(abs(slant) - 0.3, 0.0))
        assert sonar.measure(BOX, [2.5, 1.5, slant]) == pytest.approx(due, rel=1e-4)


def test_a_cone_without_opening_is_a_lidar():
    pose = [1.0, 1.2, 0.3]
    sweep = Sonar(opening=0.0, max_range=9.0, n_rays=1).sweep(BOX, pose, 90)
    np.testing.assert_allclose(sweep, Lidar(90).scan(BOX, pose))


def test_a_sweep_never_reads_farther_than_a_lidar_and_often_nearer():
    pose = [1.0, 1.2, 0.3]
    lidar, sonar = Lidar(90).scan(BOX, pose), Sonar(max_range=9.0).sweep(BOX, pose, 90)
    assert (sonar <= lidar + 1e-12).all()
    assert np.mean(sonar < 0.9 * lidar) > 0.2


def test_errors_of_the_turning_steps_add_up():
    sonar, pose = Sonar(opening=0.0, n_rays=1, max_range=9.0), [1.0, 1.2, 0.3]
    exact = sonar.sweep(BOX, pose, 360)
    rng = np.random.default_rng(1)
    runs = np.array([sonar.sweep(BOX, pose, 360, np.deg2rad(0.5), rng) for _ in range(100)])
    spread = np.abs(runs - exact).mean(0)
    assert spread[0] == 0
    assert spread[300:].mean() > 1.5 * spread[1:60].mean()


def test_silence_noise_and_seed():
    assert Sonar(max_range=1.0).measure(BOX, [2.0, 1.5, 0.0]) == np.inf
    poses = np.tile([2.0, 1.5, 0.0], (2000, 1))
    noisy = [Sonar(sigma_range=0.1).measure(BOX, poses, np.random.default_rng(2)) for _ in "ab"]
    np.testing.assert_array_equal(*noisy)
    assert noisy[0].std() == pytest.approx(0.1, rel=0.05)
    assert Sonar(sigma_range=9.0).measure(BOX, poses, np.random.default_rng(2)).min() == 0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Sonar(opening=-0.1), "opening: expected a number in"),
        (lambda: Sonar(max_range=0.0), "max_range: expected a positive number"),
        (lambda: Sonar(n_rays=0), "n_rays: expected at least 1"),
        (lambda: Sonar().measure(BOX, [9, 9, 0]), "poses: expected the sensor in free space"),
        (lambda: Sonar(sigma_range=0.1).measure(BOX, [1, 1, 0]), "rng: expected a numpy.random"),
        (lambda: Sonar().sweep(BOX, [1, 1, 0], 0), "n_headings: expected at least 1"),
        (
            lambda: Sonar().sweep(BOX, [1, 1, 0], 9, -1.0),
            "sigma_turn: expected a number of at least 0",
        ),
        (lambda: Sonar().sweep(BOX, [1, 1, 0], 9, 1.0), "rng: expected a numpy.random"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
