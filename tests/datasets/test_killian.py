"""Killian Court as chapter 00 uses it."""

from pathlib import Path

import numpy as np
import pytest

from slamlab.datasets import killian
from slamlab.evaluation import ate, run
from slamlab.geometry import between
from slamlab.localization import DeadReckoning
from slamlab.robots import RelativePose
from slamlab.slam import PoseGraph


@pytest.fixture(scope="module")
def court():
    return killian()


def test_the_known_sizes(court):
    assert court.graph.poses.shape == (3873, 3)
    assert court.graph.edges.shape == (4987, 2)
    assert court.scans.shape == (3873, 180)
    assert court.loop_mask.sum() == 1115
    assert np.rad2deg(np.diff(court.beam_angles)).round(2).tolist() == [1.0] * 179


def test_beams_without_an_end_are_infinite_and_ranges_are_below_the_maximum(court):
    assert 0.005 < np.isinf(court.scans).mean() < 0.03
    assert not np.isnan(court.scans).any()
    assert court.scans[np.isfinite(court.scans)].max() < court.lidar.max_range == 50.0


def test_dead_reckoning_follows_the_odometry_edges(court):
    path = court.dead_reckoned()
    np.testing.assert_allclose(between(path[:-1], path[1:]), court.odometry, atol=1e-9)
    np.testing.assert_array_equal(path[0], court.graph.poses[0])
    # The file does not keep them in order: taken as they come they lead elsewhere.
    as_they_come = court.graph.measurements[~court.loop_mask]
    assert not np.array_equal(as_they_come, court.odometry)


def test_the_small_variant_has_no_scans_and_a_poor_start():
    small = killian(small=True)
    assert small.graph.poses.shape == (1941, 3)
    assert small.scans.shape[0] == 0
    assert small.graph.chi2() > 1e8


def test_the_log_drives_along_the_odometry_and_knows_a_reference(court):
    log = court.log
    assert len(log) == 3873
    assert log.dt[0] == 0
    assert log.ranges.shape == (3873, 180)
    driven = run(DeadReckoning(RelativePose(), court.graph.poses[0]), log)
    np.testing.assert_allclose(driven.poses, court.dead_reckoned(), atol=1e-9)
    # The reference is the optimum of the file's graph: odometry is lost against it.
    assert court.graph.with_poses(log.truth).chi2() == pytest.approx(1032.1001, abs=1e-3)
    assert ate(driven).rmse == pytest.approx(11.8, abs=0.1)
    with pytest.raises(ValueError, match="log: expected an odometry edge from each pose"):
        _ = killian(small=True).log


@pytest.mark.parametrize(
    ("small", "theirs"), [(False, "killian.g2o.zip"), (True, "killian-small.toro")]
)
def test_it_is_what_rtb_data_ships(small, theirs):
    rtbdata = pytest.importorskip("rtbdata")
    ours = killian(small).graph
    other = PoseGraph.read_g2o(Path(rtbdata.__file__).parent / "data" / theirs)
    for name in ("poses", "edges", "measurements", "information"):
        assert np.array_equal(getattr(ours, name), getattr(other, name))
    if not small:
        assert ours.scans.lines == other.scans.lines
        assert np.array_equal(ours.scans.ranges, other.scans.ranges)
