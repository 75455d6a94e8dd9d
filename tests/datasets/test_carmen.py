"""CARMEN logs: what is read is right, and whatever breaks names its line."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slamlab.datasets import read_carmen
from slamlab.evaluation import run
from slamlab.localization import DeadReckoning
from slamlab.robots import RelativePose

LASER = "FLASER 4 1.0 2.5 81.91 0.5 {x} 2.0 0.3 {x} 2.0 0.3 10.{x} host 11.5"
ODOM = "ODOM {x} 2.0 0.3 0.1 0.2 0.0 9.{x} host 11.0"
ROBOT = (
    "ROBOTLASER1 0 -1.5 3.0 1.0 40.0 0.1 0 4 1.0 2.0 41.0 3.0 0 "
    "{x} 2.0 0.3 {x} 2.0 0.3 0 0 0 0 0 12.5 host 3.5"
)
GOOD = ["# a log", "PARAM robot_length 50 0 host 0", ""]
GOOD += [form.format(x=k) for k in range(4) for form in (ODOM, LASER)]


def read(tmp_path, lines, name="a.log", **options):
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n")
    return read_carmen(path, corrected=True, **options)


def test_scans_and_motion_are_read(tmp_path):
    log = read(tmp_path, GOOD)
    assert log.ranges.shape == (4, 4)
    assert log.ranges[0].tolist() == [1.0, 2.5, np.inf, 0.5]
    assert log.notes["beyond"].tolist() == [1] * 4
    assert log.truth[:, 0].tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(log.u[1:], [[np.cos(0.3), -np.sin(0.3), 0]] * 3)
    assert log.u[0].tolist() == [0, 0, 0]
    assert log.times[2] == 10.2
    assert log.dt.round(9).tolist() == [0, 0.1, 0.1, 0.1]
    path = tmp_path / "a.log"
    assert read_carmen(path).truth is None


def test_dead_reckoning_leads_along_the_poses_of_the_log(tmp_path):
    log = read(tmp_path, GOOD)
    driven = run(DeadReckoning(RelativePose(), log.truth[0]), log)
    np.testing.assert_allclose(driven.poses, log.truth, atol=1e-12)


def test_the_range_that_means_nothing_comes_from_the_log_or_the_caller(tmp_path):
    assert read(tmp_path, GOOD).scan.max_range == 50.0
    said = ["PARAM laser_front_laser_max 81.9 nohost 0", *GOOD]
    assert read(tmp_path, said).scan.max_range == 81.9
    assert read(tmp_path, said, max_range=2.0).ranges[0].tolist() == [1.0, np.inf, np.inf, 0.5]
    with pytest.raises(ValueError, match="max_range: expected"):
        read(tmp_path, GOOD, max_range=0)


def test_time_stamps_that_stand_still_still_pass(tmp_path):
    lines = [LASER.format(x=k).replace(f"10.{k}", stamp) for k, stamp in enumerate("5578")]
    log = read(tmp_path, lines)
    assert log.dt.tolist() == [0, 1.5, 2, 1]


def test_beams_are_laid_out_from_right_to_left(tmp_path):
    even = read(tmp_path, GOOD).scan.beam_angles
    assert np.rad2deg(even).round(6).tolist() == [-90, -45, 0, 45]
    odd = LASER.replace("FLASER 4 1.0", "FLASER 5 1.0 1.0").format(x=0)
    assert np.rad2deg(read(tmp_path, [odd]).scan.beam_angles).round(6).tolist() == [
        -90, -45, 0, 45, 90,
    ]  # fmt: skip


def test_robotlaser_lines_bring_their_own_geometry(tmp_path):
    log = read(tmp_path, [ROBOT.format(x=1), ROBOT.format(x=2)])
    assert log.scan.beam_angles.tolist() == [-1.5, -0.5, 0.5, 1.5]
    assert log.scan.max_range == 40.0
    assert np.isinf(log.ranges[:, 2]).all()
    assert log.truth[:, 0].tolist() == [1, 2]


def test_a_compressed_log_reads_the_same(tmp_path):
    path = tmp_path / "a.log.gz"
    path.write_bytes(gzip.compress("\n".join(GOOD).encode()))
    np.testing.assert_array_equal(read_carmen(path).u, read(tmp_path, GOOD).u)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("FLASER", "expected 0 ranges"),
        (LASER.format(x=1)[:-12], "expected 4 ranges and 9 more fields"),
        (LASER.format(x="nan"), "expected a finite number, got nan"),
        (LASER.format(x=1).replace("2.5", "two"), "expected a number, got 'two'"),
        (LASER.format(x=1).replace("2.5", "-2.5"), "expected ranges, got -2.5"),
        (LASER.format(x=1).replace("FLASER 4", "FLASER 5 9.0"), "expected 4 beams"),
        (LASER.format(x=1).replace("FLASER 4", "FLASER -4"), "expected a number of readings"),
        (ODOM.format(x=1) + " more", "expected 10 fields in ODOM, got 11"),
        ("LIDAR 1 2 3", "expected a CARMEN tag"),
        (ROBOT.format(x=1)[:20], "expected at least 9 fields"),
        (ROBOT.format(x=1)[:-4], "expected 14 fields after the readings"),
    ],
)
def test_a_broken_line_is_named(tmp_path, line, message):
    with pytest.raises(ValueError, match=f"line 6: .*{message}"):
        read(tmp_path, [*GOOD[:5], line, *GOOD[5:]])


def test_a_log_without_scans_and_a_damaged_gzip_are_named(tmp_path):
    with pytest.raises(ValueError, match="expected at least one FLASER"):
        read(tmp_path, GOOD[:3])
    path = tmp_path / "b.log.gz"
    path.write_bytes(gzip.compress("\n".join(GOOD * 50).encode())[:-20])
    with pytest.raises(ValueError, match="cannot unpack the archive"):
        read_carmen(path)


def test_bytes_that_are_no_text_name_their_line(tmp_path):
    path = tmp_path / "c.log"
    path.write_bytes("\n".join(GOOD[:4]).encode() + b"\nFLASER \xff\n")
    with pytest.raises(ValueError, match="line 5: expected ASCII"):
        read_carmen(path)


@st.composite
def mutated(draw):
    """A log with lines dropped, doubled, shuffled, cut or overwritten by garbage."""
    lines = list(GOOD)
    for _ in range(draw(st.integers(1, 4))):
        k = draw(st.integers(0, len(lines) - 1))
        action = draw(st.sampled_from(["drop", "double", "swap", "cut", "garbage", "field"]))
        if action == "drop" and len(lines) > 1:
            del lines[k]
        elif action == "double":
            lines.insert(k, lines[k])
        elif action == "swap":
            other = draw(st.integers(0, len(lines) - 1))
            lines[k], lines[other] = lines[other], lines[k]
        elif action == "cut":
            lines[k] = lines[k][: draw(st.integers(0, max(len(lines[k]) - 1, 0)))]
        elif action == "garbage":
            lines[k] = draw(st.text(max_size=30))
        else:
            fields = lines[k].split(" ")
            fields[draw(st.integers(0, len(fields) - 1))] = draw(
                st.sampled_from(["nan", "inf", "-1", "1e999", "", "99999999999", "0x4", "4_0"])
            )
            lines[k] = " ".join(fields)
    return lines


@settings(
    max_examples=1200,
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(lines=mutated())
def test_a_mutated_log_gives_a_named_line_or_a_faithful_log(tmp_path, lines):
    path = tmp_path / "mutated.log"
    path.write_bytes("\n".join(lines).encode("utf-8", "surrogatepass"))
    log, complaint = None, ""
    try:
        log = read_carmen(path)
    except ValueError as error:
        complaint = str(error)
    if log is None:
        assert "a.log" in complaint or str(path) in complaint
        return
    text = path.read_bytes().decode("ascii").split("\n")
    scans = [line for line in text if line.split()[:1] == ["FLASER"]]
    assert len(log) == len(scans)
    assert (log.dt[1:] > 0).all()
    for row, line in zip(log.ranges, scans, strict=True):
        values = np.array([float(v) for v in line.split()[2 : 2 + len(row)]])
        np.testing.assert_array_equal(row, np.where(values < log.scan.max_range, values, np.inf))


@pytest.mark.skipif("SLAMLAB_DATA" not in os.environ, reason="SLAMLAB_DATA is not set")
@pytest.mark.parametrize(
    ("name", "shape", "metres"),
    [("csail", (406, 361), 380), ("freiburg-101", (292, 360), 211)],
)
def test_real_logs(name, shape, metres):
    log = read_carmen(Path(os.environ["SLAMLAB_DATA"]) / f"{name}-corrected.log.gz")
    assert log.ranges.shape == shape
    assert np.linalg.norm(log.u[:, :2], axis=1).sum() == pytest.approx(metres, abs=1.0)
    assert np.isinf(log.ranges).any()


@pytest.mark.filterwarnings("error")
def test_a_pose_beyond_the_earth_is_refused_without_a_warning(tmp_path):
    path = tmp_path / "far.log"
    path.write_text("FLASER 2 1.0 1.0 {x} 0 0 {x} 0 0 1.0 host 1.0\n".replace("{x}", "1e308"))
    with pytest.raises(ValueError, match="line 1: expected a pose within 1e9 m"):
        read_carmen(path)
