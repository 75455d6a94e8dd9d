"""Logs: what goes in comes out, what does not fit is named with its step."""

import contextlib
import zipfile

import numpy as np
import pytest

from slamlab.logs import Log, ScanGeometry

COV = np.diag([0.01, 0.04])


def some_log(**changes):
    parts = {
        "times": [0.0, 1.0, 2.0, 3.0],
        "u": [[0, 0], [1, 0], [1, 0.1], [1, 0]],
        "dt": [0, 1, 1, 1],
        "control_cov": COV,
        "landmark_measurements": [[[2.0, 0.1]], [], [[1.0, 0.2], [3.0, -0.3]], [[1.5, 0.0]]],
        "ids": [[7], [], [7, -1], [3]],
        "covs": [[COV], [], [COV, 2 * COV], [COV]],
        "ranges": [[1.0, np.inf], [2.0, np.nan], [1.0, 1.0], [0.5, 0.5]],
        "scan": ScanGeometry([-0.5, 0.5], 10.0, 0.2),
        "truth": [[0, 0, 0], [1, 0, 0], [2, 0, 0.1], [3, 0.1, 0.1]],
        "landmarks": [[2.0, 0.0], [5.0, 5.0]],
        "notes": {"collisions": [0, 0, 1, 1]},
    }
    return Log(**(parts | changes))


def same(a, b):
    for name in ("times", "u", "dt", "control_cov", "ranges", "truth", "landmarks"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    for name in ("landmark_measurements", "ids", "covs"):
        for one, other in zip(getattr(a, name), getattr(b, name), strict=True):
            np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(a.scan.beam_angles, b.scan.beam_angles)
    assert (a.scan.max_range, a.scan.offset) == (b.scan.max_range, b.scan.offset)
    assert list(a.notes) == list(b.notes)


def test_steps_come_in_order_with_all_their_parts():
    steps = list(some_log())
    assert [step.dt for step in steps] == [0, 1, 1, 1]
    assert steps[2].z.tolist() == [[1.0, 0.2], [3.0, -0.3]]
    assert steps[2].ids.tolist() == [7, -1]
    assert steps[2].covs[1].tolist() == (2 * COV).tolist()
    assert steps[0].ranges.tolist() == [1.0, np.inf]
    assert steps[3].truth.tolist() == [3, 0.1, 0.1]
    assert some_log(landmark_measurements=None, ids=None, covs=None).step(1).z is None


def test_a_saved_log_is_the_same_log(tmp_path):
    log = some_log()
    log.save(tmp_path / "a.npz")
    same(Log.load(tmp_path / "a.npz"), log)
    named = some_log(ids=[["oak"], [], ["oak", "elm"], ["elm"]])
    named.save(tmp_path / "b")
    assert Log.load(tmp_path / "b").ids[2].tolist() == ["oak", "elm"]


def test_a_slice_is_a_log(tmp_path):
    part = some_log()[1:3]
    assert len(part) == 2
    assert part.times.tolist() == [1.0, 2.0]
    assert part.notes["collisions"].tolist() == [0, 1]
    part.save(tmp_path / "a.npz")
    same(Log.load(tmp_path / "a.npz"), part)
    assert len(some_log()[:0]) == 0
    with pytest.raises(ValueError, match="expected a slice"):
        some_log()[1]


def test_nothing_of_the_caller_is_kept_and_nothing_can_be_changed():
    truth = np.zeros((4, 3))
    log = some_log(truth=truth)
    truth += 1
    assert log.truth.max() == 0
    with pytest.raises(ValueError, match="read-only"):
        log.u[0] = 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"u": [[0, 0]] * 3}, r"u: expected shape \(4, p\)"),
        ({"dt": [0, 1, -1, 1]}, r"dt\[2\]: .*got -1"),
        ({"dt": [0, 1, 1]}, "dt: expected shape"),
        ({"control_cov": np.eye(3)}, "control_cov: expected"),
        ({"control_cov": np.tile(COV, (3, 1, 1))}, r"control_cov: .*\(4, 2, 2\)"),
        (
            {"landmark_measurements": [[[1, 0]], [], [[1, 0]]]},
            "landmark_measurements: expected one entry for each of 4 steps",
        ),
        (
            {"landmark_measurements": [[[2.0, 0.1]], [], [1, 2, 3], [[1.5, 0.0]]]},
            r"landmark_measurements\[2\]: expected shape",
        ),
        (
            {"landmark_measurements": [[[2.0, np.nan]], [], [[1, 2]] * 2, [[1, 0]]]},
            r"landmark_measurements\[0\]: .*finite",
        ),
        ({"ids": [[7], [], [7], [3]]}, r"ids\[2\]: expected 2 whole numbers"),
        ({"ids": [[7], [], [7.5, 1.0], [3]]}, r"ids\[2\]: .*whole numbers"),
        ({"covs": [[COV], [], [COV], [COV]]}, r"covs\[2\]: expected 2 covariances, got 1"),
        ({"landmark_measurements": None}, "landmark_measurements: expected measurements because"),
        ({"ranges": [[1.0, -2.0]] * 4}, r"ranges\[0, 1\]: .*got -2"),
        ({"ranges": [[1.0]] * 4}, r"ranges: expected shape \(4, 2\)"),
        ({"scan": None}, "scan: expected a lidar"),
        ({"truth": np.zeros((3, 3))}, r"truth: expected shape \(4, 3\)"),
        ({"notes": {"hits": [1, 2]}}, r"notes\['hits'\]: expected an array with 4 rows"),
    ],
)
def test_what_does_not_fit_is_named(changes, message):
    with pytest.raises(ValueError, match=message):
        some_log(**changes)


def test_a_batch_and_one_run_of_it():
    observations = np.full((3, 2, 4, 2), np.nan)
    observations[1, 0, 2] = 1.0, 0.5
    truth = np.arange(18.0).reshape(3, 2, 3)
    log = Log(
        [0, 1, 2],
        np.zeros((3, 2)),
        1.0,
        COV,
        landmark_measurements=observations,
        ids=[np.arange(4)] * 3,
        truth=truth,
    )
    assert log.n_runs == 2
    one = log.single(0)
    assert one.n_runs is None
    assert one.landmark_measurements[1].tolist() == [[1.0, 0.5]]
    assert one.ids[1].tolist() == [2]
    np.testing.assert_array_equal(one.truth, truth[:, 0])
    with pytest.raises(ValueError, match="expected one of 2 runs"):
        log.single(2)


def test_damaged_archives_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    some_log().save(path)
    good = path.read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(150):
        data = bytearray(good)
        for at in rng.integers(0, len(data), 4):
            data[at] = rng.integers(256)
        path.write_bytes(bytes(data[: rng.integers(1, len(data) + 1)]))
        with contextlib.suppress(ValueError):
            Log.load(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("times.npy", b"")
        archive.getinfo("times.npy").file_size = 2**30 + 1
    with pytest.raises(ValueError, match="unpacks to 1073741825 bytes"):
        Log.load(path)
    with pytest.raises(FileNotFoundError):
        Log.load(tmp_path / "none.npz")


def test_scan_geometry_keeps_its_own_angles():
    angles = np.zeros(3)
    scan = ScanGeometry(angles)
    angles += 1
    assert scan.beam_angles.tolist() == [0, 0, 0]


def test_a_log_of_foreign_byte_order_holds_the_same_numbers_in_that_of_the_machine():
    foreign = [np.array([7], ">i8"), np.array([7], ">i8"), np.array([], ">i8")]
    log = Log(
        np.array([0, 1, 2], ">f8"),
        np.array([[0, 0], [1, 0], [1, 0]], ">f4"),
        np.array([0, 1, 1], ">i2"),
        np.diag([0.04, 0.01]).astype(">f8"),
        landmark_measurements=[np.array([[2, 0]], ">f8"), np.array([[1, 0]], ">f8"), []],
        ids=foreign,
        notes={"hit": np.array([0, 1, 0], ">u2")},
    )
    assert log.control_cov.tolist() == [[0.04, 0.0], [0.0, 0.01]]
    assert log.u[1].tolist() == [1.0, 0.0]
    assert [names.tolist() for names in log.ids] == [[7], [7], []]
    assert log.notes["hit"].tolist() == [0, 1, 0]
    kept = (
        log.times,
        log.u,
        log.dt,
        log.control_cov,
        *log.landmark_measurements,
        *log.ids,
        log.notes["hit"],
    )
    assert all(array.dtype.isnative for array in kept)
    assert not foreign[0].dtype.isnative
