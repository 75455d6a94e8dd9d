"""Trajectories in the TUM form: back and forth, as evo reads them, and what is refused."""

import numpy as np
import pytest

from slamlab.datasets.tum import read_tum, write_tum

RNG = np.random.default_rng(0)
TIMES = 1.7e9 + np.arange(40) / 7
POSES = np.column_stack([RNG.normal(size=(40, 2)) * 9, RNG.uniform(-np.pi, np.pi, 40)])


def test_what_is_written_is_read(tmp_path):
    write_tum(tmp_path / "path.txt", TIMES, POSES)
    times, poses = read_tum(tmp_path / "path.txt")
    assert np.array_equal(times, TIMES)
    assert np.array_equal(poses[:, :2], POSES[:, :2])
    assert np.allclose(poses[:, 2], POSES[:, 2], atol=1e-12)


def test_evo_reads_the_same_path(tmp_path):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    write_tum(tmp_path / "path.txt", TIMES, POSES)
    path = file_interface.read_tum_trajectory_file(str(tmp_path / "path.txt"))
    assert np.array_equal(path.timestamps, TIMES)
    assert np.array_equal(path.positions_xyz[:, :2], POSES[:, :2])
    for matrix, theta in zip(path.poses_se3, POSES[:, 2], strict=True):
        assert np.allclose(matrix[:2, 0], [np.cos(theta), np.sin(theta)])
    file_interface.write_tum_trajectory_file(str(tmp_path / "evo.txt"), path)
    assert np.allclose(read_tum(tmp_path / "evo.txt")[1], POSES, atol=1e-9)


BAD = {
    "line 2: expected 8 numbers, got 7": "0 1 2 0 0 0 0 1\n1 1 2 0 0 0 0",
    "line 1: expected numbers": "0 1 2 0 0 0 zero 1",
    "line 1: expected finite": "0 1 nan 0 0 0 0 1",
    "ends without a line": "# nothing\n",
    "line 2: expected a quaternion of length 1, got 2": "0 1 2 0 0 0 0 1\n1 1 2 0 0 0 0 2",
    "line 3: expected a path in the plane": "# x\n0 1 2 0 0 0 0 1\n1 1 2 0.5 0 0 0 1",
    "line 1: expected a path in the plane": "0 1 2 0 0.6 0 0 0.8",
}


@pytest.mark.parametrize("message", BAD)
def test_a_bad_file_is_named(tmp_path, message):
    (tmp_path / "path.txt").write_text(BAD[message])
    with pytest.raises(ValueError, match=f"path.txt.*{message}"):
        read_tum(tmp_path / "path.txt")


def test_bad_arrays_are_named(tmp_path):
    with pytest.raises(ValueError, match="poses: expected shape"):
        write_tum(tmp_path / "path.txt", TIMES, POSES[1:])
    with pytest.raises(ValueError, match="times: expected finite"):
        write_tum(tmp_path / "path.txt", TIMES * np.nan, POSES)
