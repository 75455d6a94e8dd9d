"""Every test that the errata page names must exist, and every row must name one.

A table stands below a line "Proved in `tests/...`"; the last column holds names of tests in it.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
VERDICTS = {"correct", "typo", "wrong", "incomplete", "unsupported"}


def rows_of(text):
    """File, cells of every row of every table below a line that names a file of tests."""
    file, rows = None, []
    for line in text.splitlines():
        if line.startswith("## "):
            file = None
        named = re.match(r"Proved in `(tests/\S+\.py)`", line)
        if named:
            file = named[1]
        if line.startswith("|") and not re.match(r"\|[-| ]+\|$|\| paper", line):
            rows.append((file, [cell.strip() for cell in line.strip("|").split("|")]))
    return rows


def missing(rows, root=ROOT):
    """Names that stand in a row and are no test of the file, and rows that name none."""
    wrong = []
    for file, cells in rows:
        names = re.findall(r"`(test_\w+)`", cells[-1])
        path = root / (file or "")
        tree = ast.parse(path.read_text()) if path.is_file() else ast.Module([], [])
        tests = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        wrong += [name for name in names if name not in tests]
        if not names:
            wrong.append(f"row {cells[:2]} names no test")
    return wrong


ROWS = rows_of((ROOT / "book" / "errata.md").read_text())


def test_the_errata_page_has_rows_of_six_cells():
    assert len(ROWS) >= 20
    assert [cells for _, cells in ROWS if len(cells) != 6] == []


def test_every_verdict_is_one_that_the_page_explains():
    assert {cells[3] for _, cells in ROWS} <= VERDICTS


def test_every_test_named_on_the_errata_page_exists():
    assert missing(ROWS) == []


@pytest.mark.parametrize(
    ("file", "proof"),
    [
        ("tests/book/test_errata.py", "`test_that_nobody_wrote`"),
        ("tests/book/test_errata.py", "by inspection"),
        ("tests/no_such_file.py", "`test_the_guard_is_no_rubber_stamp`"),
        (None, "`test_the_guard_is_no_rubber_stamp`"),
    ],
)
def test_the_guard_is_no_rubber_stamp(file, proof):
    row = ["P1", "(18)", "x", "wrong", "y", proof]
    assert missing([(file, row)])
    assert not missing(
        [("tests/book/test_errata.py", [*row[:5], "`test_the_guard_is_no_rubber_stamp`"])]
    )
