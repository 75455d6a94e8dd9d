"""Logs of the simulator: what a page saved comes back, and a damaged file is named."""

import numpy as np
import pytest

from slamlab.datasets import read_simulator
from slamlab.evaluation import ate, run
from slamlab.geometry import between
from slamlab.localization import DeadReckoning
from slamlab.robots import RelativePose
from slamlab.sensors import Lidar
from slamlab.worlds import rooms

HEAD = "time,dx,dy,dtheta,x,y,theta,"


def saved(path, n_beams=24, steps=12):
    """The text of the page, written by other hands."""
    poses = [np.array([1.0, 2.0, 0.3])]
    for k in range(steps):
        x, y, a = poses[-1]
        poses.append(
            np.array([x + 0.05 * np.cos(a), y + 0.05 * np.sin(a), a + 0.1 * (k % 3 == 0)])
        )
    ranges = Lidar(n_beams).scan(rooms.thesis_room(), poses)
    ranges[3, 5], ranges[4, 6] = np.nan, np.inf
    rows = [
        f"# slamlab simulator, {n_beams} beams",
        HEAD + ",".join(f"r{i}" for i in range(n_beams)),
    ]
    for k, (pose, scan) in enumerate(zip(poses, ranges, strict=True)):
        motion = between(poses[max(k - 1, 0)], pose)
        rows.append(",".join(f"{v:.9f}" for v in [k, *motion, *pose, *scan]))
    path.write_text("\n".join(rows) + "\n")
    return np.array(poses), ranges


def test_what_was_saved_comes_back(tmp_path):
    poses, ranges = saved(tmp_path / "a.csv")
    log = read_simulator(tmp_path / "a.csv")
    assert log.dt[0] == 0
    assert (log.dt[1:] == 1).all()
    np.testing.assert_allclose(log.truth, poses, atol=1e-8)
    np.testing.assert_allclose(log.ranges, ranges, atol=1e-8)
    np.testing.assert_allclose(log.scan.beam_angles, 2 * np.pi * np.arange(24) / 24)


def test_a_system_runs_on_it(tmp_path):
    saved(tmp_path / "a.csv")
    log = read_simulator(tmp_path / "a.csv")
    result = run(DeadReckoning(RelativePose(), log.truth[0]), log)
    assert ate(result).rmse < 1e-6
    turned = run(DeadReckoning(RelativePose(), log.truth[0] + [0, 0, 0.5]), log)
    assert np.hypot(*(turned.poses - log.truth)[-1, :2]) > 0.1


GOOD = ["# slamlab simulator, 2 beams", HEAD + "r0,r1", "0,0,0,0,1,2,0.5,3,inf"]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], "line 2"),
        ([GOOD[0], "time,x,y"], "line 2"),
        ([GOOD[0], HEAD + "r1,r0", GOOD[2]], "line 2"),
        (GOOD[:2], "ends without a step"),
        ([*GOOD, "1,0,0,0,1,2,0.5,3"], "line 4: expected 9 numbers, got 8"),
        ([*GOOD, "1,0,0,0,1,2,nan,3,3"], "line 4: expected finite"),
        ([*GOOD, "1,0,0,0,1,2,0.5,-3,3"], "line 4: .*not negative"),
        ([*GOOD, "1,0,0,0,1,2,0.5,far,3"], "line 4: expected numbers"),
        ([*GOOD, "", "-2,0,0,0,1,2,0.5,3,3"], "b.csv: line 5: expected a time not before 0 s"),
        ([*GOOD, *("".join([t, GOOD[2][1:]]) for t in ("-0", "9e307", "-9e307"))], "line 6"),
    ],
)
def test_a_damaged_file_is_named(tmp_path, lines, message):
    (tmp_path / "b.csv").write_text("\n".join(lines))
    with pytest.raises(ValueError, match=message):
        read_simulator(tmp_path / "b.csv")
