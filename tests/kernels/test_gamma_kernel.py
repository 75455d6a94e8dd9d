"""The compiled sorting of Gamma-SLAM is the plain one, on a chapter's log.

At 60 particles and 3000 points (chapter 15) it takes 1.0 ms and the plain code 5.4: 5.5 times.
The seconds saved: "Kernels and their plain twins" in book/performance_tables.md.
"""

import numpy as np
import pytest

from slamlab.kernels import TWINS
from slamlab.sensors import StereoRig
from slamlab.simulation import ground_laps
from slamlab.slam.gamma import gather
from slamlab.worlds import Terrain

pytestmark = pytest.mark.needs_numba(reason="there is only the plain twin")


def pictures():
    """What each picture of a drive gives `gather`: points, heights, poses of particles, frame."""
    rng, rig = np.random.default_rng(1), StereoRig(1000)
    log = ground_laps(Terrain.rough(rng, (22, 22), spread=0.9), rig, rng, laps=0.1)
    for step, truth in zip(log, log.truth, strict=True):
        points, heights = rig.points(step.ranges), rig.heights(step.ranges)
        seen = np.isfinite(points).all(-1)
        poses = truth + rng.normal(0, [0.1, 0.1, 0.05], (20, 3))
        yield points[seen], heights[seen], poses, np.array([0.25, -4.0, -4.0])


def test_the_kernel_sorts_as_the_plain_code():
    assert TWINS["gamma.gather"] is gather.plain
    drive = list(pictures())
    assert len(drive) > 5
    for picture in drive:
        kernel, plain = gather(*picture), gather.plain(*picture)
        for some, other in zip(kernel[:3], plain[:3], strict=True):
            np.testing.assert_array_equal(some, other)
        np.testing.assert_allclose(kernel[3], plain[3], rtol=1e-5, atol=1e-9)
        assert kernel[3].dtype == plain[3].dtype == np.float32


def test_a_cell_of_one_point_has_no_variance():
    points = np.array([[0.1, 0.1], [0.2, 0.1], [0.9, 0.1]])
    heights = np.array([0.0, 0.2, 5.0])
    for sort in (gather, gather.plain):
        particle, cells, nu, squares = sort(
            points, heights, np.zeros((1, 3)), np.array([0.5, 0, 0])
        )
        assert particle.tolist() == [0]
        assert cells.tolist() == [[0, 0]]
        assert nu.tolist() == [1.0]
        np.testing.assert_allclose(squares, [0.02], rtol=1e-6)


def test_without_numba_the_plain_code_serves(monkeypatch):
    monkeypatch.setattr("slamlab.kernels.numba_serves", lambda: False)
    monkeypatch.setattr("slamlab.kernels._SAID", ["said"])
    picture = next(iter(pictures()))
    for some, other in zip(gather(*picture), gather.plain(*picture), strict=True):
        np.testing.assert_array_equal(some, other)
