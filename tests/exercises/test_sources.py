"""One source an exercise: both notebooks are what `tools/exercises.py` writes of it."""

import ast
import importlib
import re
import sys
from pathlib import Path

import pytest

from slamlab.exercises import Check
from slamlab.exercises._report import HUNT

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tools import exercises as tool  # noqa: E402

SOURCES = tool.sources()


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_both_notebooks_are_what_the_source_says(source):
    for path, cells in zip(tool.notebook_paths(source), tool.notebooks(source), strict=True):
        assert tool.differences(path, cells) == []


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_every_cell_of_a_source_has_one_kind(source):
    pairs = {frozenset(["imports", "solution"]), frozenset(["exercise", "predict"])}
    for cell in tool.cells_of(source):
        kinds = set(cell.metadata.tags) & tool.TAGS
        assert len(kinds) == 1 or kinds in pairs, cell.source


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_no_formula_is_torn(source):
    """A line of the source that begins with a minus makes a list, and tears what it is in."""
    for cells in tool.notebooks(source):
        for cell in cells:
            if cell.cell_type == "markdown":
                blocks = cell.source.split("$$")
                assert len(blocks) % 2 == 1, cell.source
                for line in "\n".join(blocks[::2]).split("\n"):
                    assert line.count("$") % 2 == 0, line


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_a_program_with_a_bug_is_not_told_which(source):
    """Its report recognises the mistake, and shows a line that names none."""
    module = importlib.import_module(f"slamlab.exercises.{source.stem}")
    checks = {c.name: c for c in vars(module).values() if isinstance(c, Check)}
    hunts, about, function = set(), "", ""
    for cell in tool.cells_of(source):
        tags = set(cell.metadata.tags) & tool.TAGS
        if tags == {"statement"} and cell.cell_type == "markdown":
            about = cell.source
        elif "exercise" in tags:
            function = tool._function(cell.source).name
        elif tags == {"stub"} and "bug" in about:
            hunts.add(function)
    assert hunts == {name for name, check in checks.items() if check.is_hunt}
    for name in hunts:
        check = checks[name]
        for message, wrong in check.mistakes.items():
            report = check.judge(check.observe(check.mistaken(wrong)))
            assert message in report.messages
            assert message not in report.text
            assert message not in report._repr_html_()
            assert HUNT in report.text


@pytest.mark.parametrize("year", [2027, 2028])
def test_a_variant_hands_out_other_bugs_that_the_check_refuses(year):
    """Its program is no stub of the source and no solution; solutions name what is wrong."""
    found = 0
    for source in SOURCES:
        plain, _ = tool.notebooks(source)
        tasks, answers = tool.notebooks(source, year)
        module = importlib.import_module(f"slamlab.exercises.{source.stem}")
        checks = {c.name: c for c in vars(module).values() if isinstance(c, Check)}
        told = [cell.source for cell in tasks if f"**Variant {year}**" in cell.source]
        named = [cell.source for cell in answers if f"variant {year}" in cell.source]
        assert len(told) == len(named)
        old = {cell.source for cell in plain}
        new = [c for c in tasks if c.cell_type == "code" and c.source not in old]
        assert len(new) == len(told)
        for cell in new:
            (function,) = (
                n for n in ast.parse(cell.source).body if isinstance(n, ast.FunctionDef)
            )
            scope = dict(vars(module))
            exec(ast.unparse(function), scope)
            assert not checks[function.name].passes(scope[function.name])
        found += len(new)
    assert found >= 12


def test_two_years_differ_and_a_year_comes_back():
    (source,) = tool.sources(["09"])
    one, again, other = (
        [cell.source for cell in tool.notebooks(source, year)[0]] for year in (2027, 2027, 2028)
    )
    assert one == again != other


def test_a_notebook_edited_by_hand_is_seen():
    (source,) = tool.sources(["01"])
    path, _ = tool.notebook_paths(source)
    cells, _ = tool.notebooks(source)
    cells[0].source += " by hand"
    assert tool.differences(path, cells) == [f"{path.name}: e01-00"]
    assert tool.differences(path, cells[:-1])[-1].endswith(
        f"{len(cells)} cells, not {len(cells) - 1}"
    )


def test_the_student_gets_the_head_and_the_docstring_and_not_the_body():
    code = (
        'def gain(P: Array, n: int = 2) -> Array:\n    """Say it.\n\n    In words.\n    """\n'
        "    # why\n    return P * n"
    )
    head = 'def gain(P, n=2):\n    """Say it.\n\n    In words.\n    """\n    ...'
    assert tool._stub(code, "    ...") == head
    assert tool._solution(code) == "def gain(P, n=2):\n    # why\n    return P * n"


@pytest.mark.parametrize(
    ("wrapped", "text"),
    [
        ("one\ntwo\n\nthree", "one two\n\nthree"),
        ("- one\n  two\n- three", "- one two\n- three"),
        ("| a |\n|---|\n| b |", "| a |\n|---|\n| b |"),
        ("so\n\n$$\nx = 1\n+ 2\n$$\n\nand\nso", "so\n\n$$\nx = 1\n+ 2\n$$\n\nand so"),
        ("```python\nx = 1\ny = 2\n```", "```python\nx = 1\ny = 2\n```"),
        ("## Head\nthe\ntext", "## Head\nthe text"),
        ("a number\n*and* more", "a number *and* more"),
    ],
)
def test_paragraphs_of_a_source_are_lines_of_a_notebook(wrapped, text):
    assert tool.unwrapped(wrapped) == text


def test_an_edit_of_a_mistake_must_be_in_the_code_and_not_only_in_the_docstring():
    def said(x):
        """Add two."""
        return x + 1

    check = Check(said, "x", {"one": ([1.0],)})
    assert check.mistaken("x + 1 => x + 2")(1) == 3
    with pytest.raises(LookupError, match="'two' is not in its source"):
        check.mistaken("two => three")


def indents_within(text):
    """Return what follows two or more spaces in the middle of a line of prose."""
    plain = re.sub(r"(?ms)\$\$.*?\$\$|```.*?```|^\|.*?$", "", text)
    return re.findall(r"[\w.,;:`*)] {2,}[\w`*(].*", plain)


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_no_text_holds_the_indent_of_a_list_in_its_middle(source):
    """What wraps lines must not put one item into the one before."""
    texts = [cell.source for cell in tool.cells_of(source) if cell.cell_type == "markdown"]
    assert [found for text in texts for found in indents_within(text)] == []


def test_an_item_in_the_one_before_is_seen():
    apart = "2. **Decide**, if it is less\n   than `gate`.\n3. **Join.** Of one wall"
    assert indents_within(apart) == []
    assert indents_within("2. **Decide**, if it is less\nthan    `gate`. 3. **Join.** Of one wall")
