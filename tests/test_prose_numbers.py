"""Numbers in the prose of a chapter are printed by one of its cells, or say here why not.

A number counts as printed if an output, a line of code or a formula of the same notebook has it,
up to rounding and powers of ten of units. Whole numbers up to 20 are words. The others stand in
prose_numbers.txt: chapter, number, and the reason why no cell prints it.
"""

import re
from pathlib import Path

import nbformat
import pytest

from tools.seeds import NOT_PROSE

ROOT = Path(__file__).resolve().parents[1]
CHAPTERS = sorted((ROOT / "notebooks").glob("[0-9]*.ipynb"))
NUMBER = re.compile(
    r"(?<![\w.,/\[(-])(\d{1,3}(?:[ \u00a0\u202f]\d{3})+|\d+(?:\.\d+)?)(?![\w.]*\d)"
)
SCALES = (1, 100, 1000, 0.01, 0.001)


def excused():
    lines = (ROOT / "tests" / "prose_numbers.txt").read_text().splitlines()
    rows = [line.split(maxsplit=2) for line in lines if line and not line.startswith("#")]
    assert all(len(row) == 3 for row in rows)
    return {(chapter, number): reason for chapter, number, reason in rows}


def words_of(cell):
    text = cell.source
    for pattern in NOT_PROSE:
        text = re.sub(pattern, " ", text)
    return text


def said(cell):
    """Numbers of a Markdown cell that are more than words."""
    for found in NUMBER.finditer(words_of(cell)):
        number = re.sub(r"\s", "", found[1])
        if "." in number or float(number) > 20:
            yield number


def shown(notebook):
    """Numbers in outputs, code and formulas."""
    texts = []
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            texts += re.findall(r"(?s)\$\$.*?\$\$|\$[^$]*\$", cell.source)
            continue
        texts.append(cell.source.replace("_", ""))
        for output in cell.outputs:
            texts.append(output.get("text", ""))
            texts += [str(value) for value in output.get("data", {}).values()]
    return {float(n) for text in texts for n in re.findall(r"\d+(?:\.\d+)?", text)}


def unproved(notebook):
    numbers = shown(notebook)
    for cell in notebook.cells[1:]:
        if cell.cell_type != "markdown":
            continue
        for number in said(cell):
            digits = len(number.partition(".")[2])
            if not any(
                abs(round(n * scale, digits) - float(number)) < 1e-9
                for n in numbers
                for scale in SCALES
            ):
                yield number


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_a_number_in_the_prose_is_printed_by_a_cell(path):
    found = set(unproved(nbformat.read(path, as_version=4)))
    assert found - {n for chapter, n in excused() if chapter == path.stem[:2]} == set()


def test_nothing_is_excused_that_is_printed():
    due = {
        (path.stem[:2], number)
        for path in CHAPTERS
        for number in unproved(nbformat.read(path, as_version=4))
    }
    assert excused().keys() - due == set()


def test_a_number_that_nobody_prints_is_found():
    cells = [
        nbformat.v4.new_markdown_cell("# 99 Title"),
        nbformat.v4.new_markdown_cell("It is off by 0.37 m, by 41.5 % and 12 cm, $x = 7.5$ m."),
        nbformat.v4.new_code_cell(
            "1", outputs=[nbformat.v4.new_output("stream", text="0.4149 of them\n")]
        ),
    ]
    assert list(unproved(nbformat.v4.new_notebook(cells=cells))) == ["0.37"]
