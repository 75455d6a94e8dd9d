"""A compiled kernel and its plain twin: the same numbers on a chapter's log."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import slamlab.kernels.occupancy as occupancy_kernels
from slamlab.datasets import killian
from slamlab.kernels import TWINS
from slamlab.mapping import occupancy

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.needs_numba(reason="there is only the plain twin")


def court_beams(n_scans):
    """Chapter 08: beams of Killian Court in cells of 0.2 m, the grid cuts some of them."""
    log = killian().log[:n_scans]
    for pose, ranges in zip(log.truth[:n_scans], log.ranges[:n_scans], strict=True):
        angles = pose[2] + log.scan.beam_angles
        met = ranges < log.scan.max_range
        start = pose[:2] / 0.2 + [60.0, 70.0]
        ways = np.stack([np.cos(angles), np.sin(angles)], -1)
        ends = np.where(met, ranges, 40.0)[:, None] * ways
        yield start, start + ends / 0.2, met


def inserted(insert, beams, loss=-0.4):
    log_odds = np.zeros((200, 200))
    for start, ends, hit in beams:
        insert(log_odds, start, ends, hit, 0.8, loss, 3.5)
    return log_odds


def test_occupancy_every_cell_of_the_court_is_the_same():
    plain, compiled = TWINS["occupancy.insert_scan"], occupancy_kernels.insert_scan
    one, other = (inserted(insert, court_beams(40)) for insert in (plain, compiled))
    np.testing.assert_array_equal(one, other)
    assert (one > 0).sum() > 100
    assert (one < 0).sum() > 1000
    assert (one != inserted(plain, court_beams(40), loss=-0.41)).sum() > 1000


@pytest.mark.parametrize(
    ("end", "cells"),
    [
        ([3.5, 0.5], [[0, 0], [1, 0], [2, 0], [3, 0]]),
        ([0.5, -9.5], [[0, 0], [0, -1]]),  # -1 is all that lies below the grid
        ([2.5, 2.5], [[0, 0], [1, 0], [1, 1], [2, 1], [2, 2]]),  # corners: columns first
    ],
)
def test_occupancy_a_beam_crosses_these_cells(end, cells):
    size = np.array([9, 9])
    way = occupancy.cells_of_beam(np.array([0.5, 0.5]), np.array(end), size)
    assert way.tolist() == cells
    log_odds = np.zeros((9, 9))
    occupancy_kernels.insert_scan(
        log_odds, np.array([0.5, 0.5]), np.array([end]), np.array([False]), 1.0, -1.0, 2.0
    )
    expected = {(row, column) for column, row in cells if row >= 0}
    assert set(zip(*np.nonzero(log_odds), strict=True)) == expected


def test_occupancy_a_beam_without_end_is_cut_at_the_grid():
    for insert in (TWINS["occupancy.insert_scan"], occupancy_kernels.insert_scan):
        log_odds = np.zeros((3, 5))
        ends = np.array([[1e9, 1.5], [np.nan, np.nan]])
        insert(log_odds, np.array([1.5, 1.5]), ends, np.array([False, False]), 1.0, -1.0, 2.0)
        assert log_odds.tolist() == [[0] * 5, [0, -1, -1, -1, -1], [0] * 5]


SOURCES = [path.read_text() for path in (ROOT / "slamlab").rglob("*.py")]
KERNELS = re.findall(r'@compiled\("([\w.]+)"\)', "\n".join(SOURCES))
TESTS = "\n".join(path.read_text() for path in Path(__file__).parent.glob("test_*.py"))


@pytest.mark.parametrize("name", KERNELS)
def test_a_test_of_this_folder_calls_each_plain_twin(name):
    function = name.partition(".")[2]
    assert re.search(rf'\b{function}(\.plain\b|")', TESTS)


@pytest.mark.parametrize("files", [["tests/mapping/test_occupancy.py"]])
def test_the_unit_tests_pass_on_plain_code(files):
    code = (
        "import sys; sys.modules['numba'] = None\n"
        "import pytest; sys.exit(pytest.main(sys.argv[1:]))"
    )
    options = ["-q", "-p", "no:cacheprovider", "-W", "ignore:numba is not installed"]
    done = subprocess.run(
        [sys.executable, "-c", code, *options, *files], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-3000:]
