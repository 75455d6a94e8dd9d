"""Every test that the errata page names must exist, and every row must name one.

A table stands below a line "Proved in `tests/...`"; its last column holds letters, and a list
below the table says which test of that file each letter is.
"""

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "book" / "extensions"))
from paper_lines import errata_rows  # noqa: E402

VERDICTS = {"correct", "typo", "wrong", "wrong as read", "incomplete", "unsupported"}


def missing(rows, root=ROOT):
    """Names that are no test of the file, letters without a name, and rows without a letter."""
    wrong = []
    for file, cells, named in rows:
        path = root / (file or "")
        tree = ast.parse(path.read_text()) if path.is_file() else ast.Module([], [])
        tests = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        letters = [letter for letter in cells[-1].split(", ") if letter]
        wrong += [letter for letter in letters if named.get(letter) not in tests]
        if not letters:
            wrong.append(f"row {cells[:2]} names no test")
    return wrong


ROWS = errata_rows((ROOT / "book" / "errata.md").read_text())


def test_the_errata_page_has_rows_of_six_cells():
    assert len(ROWS) >= 20
    assert [cells for _, cells, _ in ROWS if len(cells) != 6] == []


def test_every_verdict_is_one_that_the_page_explains():
    assert {cells[3] for _, cells, _ in ROWS} <= VERDICTS


def test_every_test_named_on_the_errata_page_exists():
    assert missing(ROWS) == []


SELF = "tests/book/test_errata.py"
HERE = {"a": "test_the_guard_is_no_rubber_stamp", "b": "test_that_nobody_wrote"}


@pytest.mark.parametrize(
    ("file", "proof"),
    [(SELF, "b"), (SELF, "a, b"), (SELF, "c"), (SELF, ""), ("tests/no_such.py", "a"), (None, "a")],
)
def test_the_guard_is_no_rubber_stamp(file, proof):
    row = ["P1", "(18)", "x", "wrong", "y"]
    assert missing([(file, [*row, proof], HERE)])
    assert not missing([(SELF, [*row, "a"], HERE)])
