"""The compiled ICP is the plain one, scan on scan and scan on many at Killian Court.

Of 71 points on 71 the kernel takes 0.08 ms and the plain code 4.2; of 96 on 2141, 0.11 and 4.2:
38 times and more. `slamlab map` of the court, 3873 scans, saves 16 s by it.
"""

import numpy as np
import pytest

from slamlab.datasets import killian
from slamlab.geometry import between
from slamlab.kernels import TWINS
from slamlab.matching import PointsWithNormals, voxel_downsample
from slamlab.matching.icp import align

pytestmark = pytest.mark.needs_numba(reason="there is only the plain twin")
GATES = np.array([0.5, 0.2])
FREE = np.zeros((3, 3))  # no prior


def court():
    """Outlines of scans that follow one another, and where the wheels say the later one stands."""
    log = killian().log[:60]
    walls = [PointsWithNormals.estimate(voxel_downsample(log.scan.points(r))) for r in log.ranges]
    for k in range(len(log) - 1):
        yield walls[k].on_lines(), walls[k + 1].points, between(*log.truth[k : k + 2])
    twenty = [one.transformed(pose) for one, pose in zip(walls[:20], log.truth, strict=False)]
    for k in range(20, 30):
        yield PointsWithNormals.concatenated(twenty).on_lines(), walls[k].points, log.truth[k]


@pytest.mark.parametrize("prior", [np.zeros((3, 3)), np.diag([3.0, 0.3, 9.0]) + 0.1])
@pytest.mark.parametrize("line", [True, False])
def test_both_find_the_same_partners_and_the_same_pose(line, prior):
    assert TWINS["icp.align"] is align.plain
    found = []
    for walls, points, guess in court():
        kernel, plain = guess.copy(), guess.copy()
        rest = 0.05, GATES, 15, line, prior
        pairs = align(walls.points, walls.normals, points, kernel, *rest)
        again = align.plain(walls.points, walls.normals, points, plain, *rest)
        np.testing.assert_array_equal(again, pairs)
        np.testing.assert_allclose(plain, kernel, atol=1e-9)
        assert (plain != guess).any()
        found.append((pairs >= 0).sum())
    assert np.median(found) > 25


def test_a_prior_pulls_towards_the_guess():
    walls, points, guess = next(court())
    ends = []
    for strength in (0.0, 10.0, 1e6):
        pose, prior = guess.copy(), strength * np.eye(3)
        align.plain(walls.points, walls.normals, points, pose, 0.05, GATES, 15, True, prior)
        ends.append(np.abs(pose - guess).max())
    assert ends[0] > ends[1] > ends[2]
    assert ends[2] < 1e-4


def test_one_round_less_is_another_pose():
    walls, points, guess = next(court())
    poses = []
    for rounds in (2, 3):
        poses.append(guess.copy())
        align.plain(
            walls.points, walls.normals, points, poses[-1], 0.05, GATES, rounds, True, FREE
        )
    assert np.abs(poses[0] - poses[1]).max() > 1e-6


@pytest.mark.parametrize("shift", [100.0, 0.0])
def test_both_find_no_partner_where_the_points_hold_no_pose(shift):
    """Far away there are none; and two points have less than three pairs."""
    walls, points, _ = next(court())
    some = points if shift else points[:2]
    for one in (align, align.plain):
        pose = np.array([shift, 0.0, 0.0])
        pairs = one(walls.points, walls.normals, some, pose, 0.05, GATES, 15, True, FREE)
        assert pairs.tolist() == [-1] * len(some)
