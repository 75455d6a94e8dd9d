"""The stereo rig: rays, sway, noise, and what it says of the ground."""

import numpy as np
import pytest

from slamlab.geometry import compose
from slamlab.grids import Grid
from slamlab.models import as_scan_sensor
from slamlab.sensors import StereoRig
from slamlab.worlds import Terrain

RIG = StereoRig(400, depth_noise=0.0)
FLAT = Terrain(Grid((400, 400), 0.05), np.zeros((400, 400)))
HERE = np.array([9.0, 10.0, 0.7])


def hill(a=0.05, b=-0.03):
    x, y = FLAT.grid.centres().transpose(2, 0, 1)
    return Terrain(FLAT.grid, a * x + b * y)


def test_the_rays_lie_evenly_on_level_ground_within_the_field_of_view():
    assert as_scan_sensor("rig", RIG) is RIG
    points = RIG.points(RIG.scan(FLAT, HERE))
    distance, bearing = np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])
    assert np.abs(bearing).max() <= np.deg2rad(70)
    assert distance.min() >= 1.0 - 1e-6
    assert distance.max() <= 5.0 + 1e-6
    # Half of the points on half of the area; rays evenly spread in angle would be near.
    middle = np.sqrt((1**2 + 5**2) / 2)
    assert np.mean(distance < middle) == pytest.approx(0.5, abs=0.01)


def test_on_a_plane_the_rays_end_on_the_plane():
    ground = hill()
    ranges = RIG.scan(ground, HERE)
    at, up = RIG.points(ranges, HERE), RIG.heights(ranges)
    met = np.isfinite(up)
    assert met.mean() > 0.95
    due = ground.height(at[met]) - ground.height(HERE[:2])
    np.testing.assert_allclose(up[met], due, atol=1e-6)


def test_the_first_thing_in_the_way_is_seen():
    heights = np.zeros((400, 400))
    heights[:, 240:244] = 0.5  # a wall from x = 12 to 12.2, half a metre high
    wall = Terrain(FLAT.grid, heights)
    ahead = np.array([9.0, 10.0, 0.0])
    points = RIG.points(RIG.scan(wall, ahead), ahead)
    shadow = (points[:, 0] > 12.3) & (points[:, 0] < 13.0)
    assert not shadow.any()
    assert (np.abs(points[:, 0] - 12.0) < 0.2).any()


def test_sway_lifts_and_leans_what_the_rig_believes():
    up = RIG.scan(FLAT, HERE, sway=[0.05, 0, 0])
    below = RIG.heights(up)
    # A rig that is 5 cm too high takes the ground for lower, in proportion to the range.
    assert (below < -0.04).all()
    pitch = np.deg2rad(1.0)
    leaning = RIG.scan(FLAT, HERE, sway=[0, pitch, 0])
    points, heights = RIG.points(leaning), RIG.heights(leaning)
    # Looking down by a degree more, level ground seems to rise ahead by tan(1 degree) a metre.
    np.testing.assert_allclose(heights, np.tan(pitch) * points[:, 0], atol=2e-3)
    leaning = RIG.scan(FLAT, HERE, sway=[0, 0, pitch])
    points, heights = RIG.points(leaning), RIG.heights(leaning)
    np.testing.assert_allclose(heights, -np.tan(pitch) * points[:, 1], atol=2e-3)


def test_the_noise_grows_with_the_square_of_the_range():
    noisy = StereoRig(400, depth_noise=0.002)
    clean = RIG.scan(FLAT, HERE)
    rng = np.random.default_rng(1)
    errors = noisy.scan(FLAT, np.tile(HERE, (200, 1)), rng) - clean
    np.testing.assert_allclose(errors.std(0) / clean**2, 0.002, rtol=0.25)


def test_moving_rig_and_world_points_agree():
    ranges = RIG.scan(hill(), HERE)
    met = ranges < RIG.max_range
    body = np.concatenate([RIG.points(ranges)[met], np.zeros((met.sum(), 1))], -1)
    np.testing.assert_allclose(RIG.points(ranges, HERE)[met], compose(HERE, body)[:, :2])


def test_lost_rays_are_nowhere():
    ranges = RIG.scan(FLAT, HERE)
    ranges[:3] = np.nan, np.inf, RIG.max_range
    assert np.isnan(RIG.points(ranges)[:3]).all()
    assert np.isnan(RIG.heights(ranges)[:3]).all()
    assert np.isfinite(RIG.points(ranges)[3:]).all()


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("n_points", lambda: StereoRig(0)),
        ("far", lambda: StereoRig(far=0.5)),
        ("field_of_view", lambda: StereoRig(field_of_view=7.0)),
        ("ranges: expected shape", lambda: RIG.points(np.ones(7))),
        ("ranges: expected distances", lambda: RIG.points(-np.ones(400))),
        ("terrain: expected a Terrain", lambda: RIG.scan(FLAT.heights, HERE)),
        ("poses", lambda: RIG.scan(FLAT, [1.0, 2.0])),
        ("sway", lambda: RIG.scan(FLAT, HERE, sway=[0.1, np.nan, 0])),
        ("rng", lambda: RIG.scan(FLAT, HERE, rng=1)),
    ],
)
def test_bad_input_is_named(message, call):
    with pytest.raises(ValueError, match=message):
        call()
