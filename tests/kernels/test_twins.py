"""A compiled kernel and its plain twin: the same numbers on a chapter's log; and what it saves.

Every kernel has its factor and the seconds saved in book/performance_tables.md, under "Kernels and
their plain twins"; that of the occupancy grid was measured in chapter 08.
"""

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
from tools import performance

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


KERNELS = [
    name
    for path in (ROOT / "slamlab").rglob("*.py")
    if path.parent.name != "kernels"  # a twin stands in its system's file
    for name in re.findall(r'@compiled\("([\w.]+)"\)', path.read_text())
]
TESTS = "\n".join(path.read_text() for path in Path(__file__).parent.glob("test_*.py"))


@pytest.mark.parametrize("name", KERNELS)
def test_a_test_of_this_folder_calls_each_plain_twin(name):
    function = name.partition(".")[2]
    assert re.search(rf'\b{function}(\.plain\b|")', TESTS)


# Rows that the page shows to fail the rule: there is little to mark in a small room.
ELSEWHERE = {("floor.mark_free", "18")}


def cells_of_table():
    """Cells of the rows of "Kernels and their plain twins" on the performance page."""
    page = (ROOT / "book" / "performance_tables.md").read_text()
    section = page.split("## Kernels and their plain twins")[1].split("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line[:1] == "|"]
    return [dict(zip(rows[0], row, strict=True)) for row in rows[2:]]


def test_every_kernel_has_a_row_in_the_table_and_no_other_has():
    assert len(KERNELS) == len(set(KERNELS)) > 20
    assert {row["kernel"] for row in cells_of_table()} == set(KERNELS)


@pytest.mark.parametrize("name", KERNELS)
def test_a_kernel_is_three_times_faster_and_saves_a_second(name):
    rows = [row for row in cells_of_table() if row["kernel"] == name]
    for row in rows:
        if (name, row["chapter"]) not in ELSEWHERE:
            assert float(row["factor"]) >= 3.0
    kept = [float(row["saved (s)"]) for row in rows if float(row["factor"]) >= 3.0]
    assert max(kept) >= 1.0


def test_a_table_measured_alone_leaves_the_others_and_says_when(monkeypatch):
    monkeypatch.setattr(performance, "machine", lambda: "today")
    page = ["yesterday", "A\n\n| 1 |", "B\n\n| 2 |"]
    changed = performance.with_section(page, "A\n\n| 3 |")
    assert changed == ["yesterday", "A\n\ntoday\n\n| 3 |", "B\n\n| 2 |"]
    assert performance.with_section(page, "C\n\n| 4 |") == [*page, "C\n\ntoday\n\n| 4 |"]
    assert performance.with_section(["today"], "C\n\n| 4 |") == ["today", "C\n\n| 4 |"]


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
