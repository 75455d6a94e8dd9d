"""Victoria Park: its sizes, its least-squares optimum, and the reader of its text."""

from pathlib import Path

import numpy as np
import pytest

from slamlab.datasets import victoria_park
from slamlab.datasets.victoria_park import read_landmark_log
from slamlab.geometry import inverse_transform
from slamlab.robots import RelativePose
from slamlab.sensors import PointSensor
from slamlab.slam import PoseGraph

TEXT = """# two steps and three views
ODOMETRY 0 1 1 0 0.1 0.01 0 0 0.02 0 0.003
LANDMARK 1 2 3 4 0.4 0.1 0.5
LANDMARK 1 7 1 1 0.4 0 0.4
ODOMETRY 1 3 1 0 0 0.01 0.001 0.002 0.02 0.004 0.03
LANDMARK 3 2 2 4 0.4 0 0.4
"""


def read(tmp_path, text):
    (tmp_path / "park.txt").write_text(text)
    return read_landmark_log(tmp_path / "park.txt")


def test_every_field_lands_where_it_belongs(tmp_path):
    log = read(tmp_path, TEXT)
    assert log.u.tolist() == [[0, 0, 0], [1, 0, 0.1], [1, 0, 0]]
    assert log.dt.tolist() == [0, 1, 1]
    assert log.control_cov[2].tolist() == [
        [0.01, 0.001, 0.002],
        [0.001, 0.02, 0.004],
        [0.002, 0.004, 0.03],
    ]
    assert [z.tolist() for z in log.landmark_measurements] == [[], [[3, 4], [1, 1]], [[2, 4]]]
    assert [names.tolist() for names in log.ids] == [[], [0, 1], [0]]
    assert log.covs[1][0].tolist() == [[0.4, 0.1], [0.1, 0.5]]


BAD = {
    "line 2: ODOMETRY: expected 11 fields, got 10": TEXT.replace(" 0.003", ""),
    "line 3: expected ODOMETRY or LANDMARK, got 'TREE'": TEXT.replace("LANDMARK 1 2", "TREE 1 2"),
    "line 4: expected numbers": TEXT.replace("7 1 1", "7 1 one"),
    "line 4: expected finite": TEXT.replace("7 1 1", "7 1 inf"),
    "line 4: covariance: expected a positive": TEXT.replace(
        "LANDMARK 1 7 1 1 ", "LANDMARK 1 7 1 1 -"
    ),
    "line 4: pose 5 was not reached": TEXT.replace("LANDMARK 1 7", "LANDMARK 5 7"),
    "line 5: expected odometry from the newest pose": TEXT.replace("ODOMETRY 1 3", "ODOMETRY 0 3"),
    "ends without odometry": "# empty\n",
}


@pytest.mark.parametrize("message", BAD)
def test_a_bad_line_is_named(tmp_path, message):
    with pytest.raises(ValueError, match=f"park.txt.*{message}"):
        read(tmp_path, BAD[message])


@pytest.fixture(scope="module")
def park():
    return victoria_park()


def test_the_park_has_its_known_size(park):
    assert (len(park), len(park.landmarks), sum(map(len, park.landmark_measurements))) == (
        6969,
        151,
        3640,
    )
    length = np.hypot(*np.diff(park.truth[:, :2], axis=0).T).sum()
    assert length == pytest.approx(4000, rel=0.03)


def test_the_guess_without_a_start_leads_to_the_known_optimum(park):
    sensor = PointSensor(0.4 * np.eye(2))
    graph = PoseGraph.from_log(park, RelativePose(), sensor)
    stuck, best = graph.optimize(), graph.chordal_initialisation().optimize()
    assert best.converged
    assert best.chi2 == pytest.approx(6183.93, abs=0.01)  # 6978 degrees of freedom
    assert not stuck.converged
    assert stuck.chi2 > 100 * best.chi2
    assert np.array_equal(best.poses, park.truth)
    k = next(k for k in range(3000, 6969) if len(park.landmark_measurements[k]))
    seen = inverse_transform(park.truth[k], park.landmarks[park.ids[k]])
    assert np.abs(seen - park.landmark_measurements[k]).max() < 3.0


def test_it_is_what_gtsam_ships(park):
    gtsam = pytest.importorskip("gtsam")
    theirs = read_landmark_log(Path(gtsam.__file__).parent / "Data" / "victoria_park.txt")
    assert np.array_equal(park.u, theirs.u)
    assert np.array_equal(park.control_cov, theirs.control_cov)
    for ours, other in (
        (park.landmark_measurements, theirs.landmark_measurements),
        (park.ids, theirs.ids),
    ):
        assert all(map(np.array_equal, ours, other))
