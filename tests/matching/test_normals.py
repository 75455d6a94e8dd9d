"""Normals of the walls that a scan shows, and thinning its points."""

import numpy as np
import pytest

from slamlab.geometry import transform
from slamlab.matching import PointsWithNormals, estimate_normals, voxel_downsample
from slamlab.sensors import Lidar
from slamlab.worlds import rooms


def scan():
    lidar = Lidar(360, max_range=20.0, sigma_range=0.01)
    return voxel_downsample(
        lidar.points(lidar.scan(rooms.office(), [2.0, 4.0, 0.3], np.random.default_rng(0)))
    )


def test_normals_stand_across_walls_and_corners_have_none():
    x = np.linspace(0, 2, 21)
    wall = np.column_stack([x, np.full(21, 3.0)])
    post = np.array([[10.0, 10.0]])
    found = estimate_normals(np.concatenate([wall, post]))
    np.testing.assert_allclose(np.abs(found[:21]), np.tile([0.0, 1.0], (21, 1)), atol=1e-12)
    assert np.isnan(found[21]).all()
    cross = np.array([[0, 0], [0.1, 0], [-0.1, 0], [0, 0.1], [0, -0.1]])
    assert np.isnan(estimate_normals(cross)[0]).all()


def test_an_outline_that_moves_is_the_outline_of_the_moved_points():
    a = scan()
    frame = np.array([1.0, -2.0, 0.7])
    moved, other = (
        PointsWithNormals.estimate(a).transformed(frame),
        PointsWithNormals.estimate(transform(frame, a)),
    )
    same = np.abs((moved.normals * other.normals).sum(-1))
    assert np.array_equal(np.isnan(moved.normals[:, 0]), np.isnan(other.normals[:, 0]))
    np.testing.assert_allclose(same[np.isfinite(same)], 1.0)
    both = PointsWithNormals.concatenated([moved, other])
    assert len(both.points) == 2 * len(a)


def test_thinning_keeps_one_point_a_square():
    points = np.random.default_rng(0).uniform(-1, 1, (2000, 2))
    kept = voxel_downsample(points, 0.25)
    assert len(kept) == 64
    assert len(np.unique(np.floor(kept / 0.25), axis=0)) == 64
    assert len(voxel_downsample(np.full((5, 2), np.nan))) == 0


@pytest.mark.parametrize("size", [1.0, 1e3, 1e6, 1e300])
def test_thinning_is_the_same_however_far_apart_points_are(size):
    """From 2000 squares a side on it takes another way."""
    points = np.random.default_rng(1).uniform(-3, 3, (500, 2)).round(1)
    points = size * np.vstack([points, points[::-1]])
    seen, first = set(), []
    for k, square in enumerate(map(tuple, np.floor(points / 0.25).tolist())):
        if square not in seen:
            seen.add(square)
            first.append(k)
    assert 0 < len(first) < len(points)
    np.testing.assert_array_equal(voxel_downsample(points, 0.25), points[first])


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="points"):
        estimate_normals([[np.nan, 0.0]])
    with pytest.raises(ValueError, match="spacing"):
        voxel_downsample(scan(), 0.0)
