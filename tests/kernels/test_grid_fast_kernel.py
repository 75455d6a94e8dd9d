"""The compiled loops of grid FastSLAM are the plain ones, on a drive through the office.

With 30 particles and 60 beams (chapter 15) a scan takes them 0.9 ms to climb, 0.1 to mark tiles,
0.8 to draw and 1.6 to weigh by penetration; the plain code 52, 26, 21 and 17 times that. The
seconds saved: "Kernels and their plain twins" in book/performance_tables.md.
"""

from functools import cache

import numpy as np
import pytest

from slamlab.geometry import compose
from slamlab.kernels import TWINS
from slamlab.sensors import Lidar
from slamlab.slam import GridFastSlam, grid_fast
from slamlab.slam._grid_maps import TileMaps
from slamlab.worlds import rooms

pytestmark = pytest.mark.needs_numba(reason="there is only the plain twin")

LIDAR = Lidar(90, max_range=8.0, sigma_range=0.01)
START = np.array([2.0, 4.0, 0.0])


@cache
def drive():
    """The maps of a drive of eight scans, and of each scan the points and poses of particles."""
    rng = np.random.default_rng(1)
    slam, scans = GridFastSlam(LIDAR, START, 3, rng=rng), []
    for k in range(8):
        pose = compose(START, [0.2 * k, 0.0, 0.05 * k])
        if k:
            slam.predict([0.2, 0.0, 0.05], 1.0, np.diag([0.02, 0.02, 0.02]) ** 2)
        ranges = LIDAR.scan(rooms.office(), pose, rng)
        slam.update(ranges)
        points = LIDAR.points(ranges)
        poses = slam.poses + rng.normal(0, [0.04, 0.04, 0.03], (3, 3))
        scans.append((np.ascontiguousarray(points[np.isfinite(points[:, 0])]), poses))
    return slam, scans


def where():
    maps = drive()[0]._maps
    return *maps.read(), maps.columns, maps.frame


@pytest.mark.parametrize("name", ["refine", "touched", "draw", "penetrate"])
def test_the_plain_twin_stands_in_the_file_of_the_system(name):
    assert TWINS[f"grid_fast.{name}"] is getattr(grid_fast, name).plain


# Few points and a heading that is off: how far a climb turned decides between two, too.
@pytest.mark.parametrize(("lost", "every", "off"), [(0.0, 1, 0.0), (0.9, 1, 0.0), (0.9, 6, 0.3)])
def test_the_kernel_climbs_to_the_same_poses(lost, every, off):
    for points, start in drive()[1]:
        found, points = [], np.ascontiguousarray(points[::every])
        start = start + off * np.array([[0, 0, 1], [0, 0, -1], [0, 0, 0.5]])
        for refine in (grid_fast.refine, grid_fast.refine.plain):
            poses, score = start.copy(), np.zeros(len(start))
            refine(*where(), points, poses, 0.1, lost, score)
            found.append((poses, score))
        np.testing.assert_allclose(found[0][0], found[1][0], atol=1e-6)
        np.testing.assert_allclose(found[0][1], found[1][1], atol=1e-5)
        assert np.abs(found[0][0] - start).max() > 1e-3


def test_the_kernel_weighs_the_same_beams_alike():
    slam, scans = drive()
    for points, poses in scans:
        score = np.zeros((2, len(poses)))
        beams = slam._beams(points, poses)
        for penetrate, row in zip(
            (grid_fast.penetrate, grid_fast.penetrate.plain), score, strict=True
        ):
            penetrate(*where(), *beams, 0.1, row)
        np.testing.assert_allclose(score[0], score[1], rtol=1e-6)
        assert (score < 0).all()


def drawn(touched, draw, beams):
    """Maps that beams made, and the tiles that were marked for it."""
    maps = TileMaps(len(beams[0]), 0.1, START[:2])
    maps.make_room(np.concatenate([beams[0], beams[1].reshape(-1, 2)]))
    marked = np.zeros((len(beams[0]), int(maps.size.prod())), bool)
    touched(maps.columns, maps.frame, *beams, marked)
    draw(*maps.write(marked), maps.columns, maps.frame, marked, *beams)
    return marked, np.array([maps.dense(i) for i in range(len(beams[0]))])


def test_the_kernel_draws_the_same_maps():
    slam, scans = drive()
    for points, poses in scans:
        beams = slam._beams(points, poses)
        marked, cells = drawn(grid_fast.touched, grid_fast.draw, beams)
        same, plain = drawn(grid_fast.touched.plain, grid_fast.draw.plain, beams)
        np.testing.assert_array_equal(marked, same)
        np.testing.assert_allclose(cells, plain, rtol=1e-5, atol=1e-5)
        assert cells[..., 0].sum() == beams[1][..., 0].size


def test_without_numba_the_whole_system_ends_where_it_ends(monkeypatch):
    paths = []
    for compiled in (True, False):
        monkeypatch.setattr("slamlab.kernels.numba_serves", lambda here=compiled: here)
        monkeypatch.setattr("slamlab.kernels._SAID", ["said"])
        rng = np.random.default_rng(3)
        slam = GridFastSlam(LIDAR, START, 3, rng=rng)
        for k in range(4):
            if k:
                slam.predict([0.2, 0.0, 0.05], 1.0, np.diag([0.02, 0.02, 0.02]) ** 2)
            pose = compose(START, [0.2 * k, 0.0, 0.05 * k])
            slam.update(LIDAR.scan(rooms.office(), pose, rng))
        paths.append(slam.poses)
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-5)
