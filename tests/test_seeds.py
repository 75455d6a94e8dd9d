"""Moved seeds: what `make seeds` finds in a notebook that is made to fail."""

import os
import subprocess
import sys

import nbformat
import pytest

from tools.fork_server import server
from tools.notebooks import ROOT
from tools.seeds import (
    STEADY,
    STEP,
    UNSTEADY,
    chapters,
    executed,
    lessons,
    lines_of,
    ranges,
    report,
    said,
    turned,
)

CODE = nbformat.v4.new_code_cell
PROSE = nbformat.v4.new_markdown_cell
# Drawn with the seeds 0, 1000 and 2000: 0.64, 0.52, 0.58.
TINY = [
    PROSE("# 99 Title"),
    CODE("import numpy as np\nfirst = np.random.default_rng(0).random()\nprint(f'{first:.2f} m')"),
    PROSE("It is off by 0.64 m, that is 64 %, of 2.50 m that are set; 33.3 m is in no cell."),
    CODE("assert first > 0.6, 'too small'"),
    CODE("print('holds' if first > 0.55 else 'fails')\nlimit = 2.50"),
    CODE("print('below one:', first < 1)"),
    CODE("print(np.random.SeedSequence(0).entropy, np.random.SeedSequence((0, 7)).entropy)"),
]


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    path = tmp_path_factory.mktemp("seeds") / "99_tiny.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=TINY), path)
    nbformat.write(executed(path, 0), path)
    return path


@pytest.fixture(scope="module")
def found(tiny):
    return report(tiny, [1, 2])


def text(notebook, cell):
    return notebook.cells[cell].outputs[0].text.strip()


def test_a_shift_of_zero_changes_no_number(tiny):
    assert text(nbformat.read(tiny, as_version=4), 1) == "0.64 m"


def test_a_cell_that_raises_is_named_for_each_shift(found):
    assert found.raised == ["shift 1: [3] AssertionError: too small"] + [
        "shift 2: [3] AssertionError: too small"
    ]


def test_a_verdict_that_turns_is_named_with_its_shift(found):
    assert found.turned == ["[4] in 1 of 2 (shift 1): holds -> fails: holds"]
    assert not found.steady


def test_a_verdict_that_stays_is_not_named(found):
    assert not any(line.startswith("[5]") for line in found.turned)


def test_a_number_of_the_prose_has_its_range_and_a_number_of_the_code_has_none(found):
    assert found.ranges == ["[2] 0.64: 0.52 to 0.64", "[2] 64: 52 to 64"]


def test_seeds_of_sequences_move_by_their_first_number(tiny):
    moved = executed(tiny, 2 * STEP)
    assert text(moved, 1) == "0.58 m"
    assert text(moved, 6) == "2000 [2000, 7]"


def test_the_environment_and_the_notebook_stay_as_they_were(tiny):
    before, environment = tiny.read_bytes(), dict(os.environ)
    executed(tiny, STEP)
    assert tiny.read_bytes() == before
    assert dict(os.environ) == environment


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere no kernel is a fork")
def test_all_shifts_are_forks_of_one_process(tiny):
    # Of one for each, two hundred of them once took all memory.
    executed(tiny, STEP)
    before = server.cache_info().currsize
    executed(tiny, 2 * STEP)
    assert server.cache_info().currsize == before


def test_a_table_whose_numbers_move_and_whose_verdict_stays_has_not_turned():
    def one(line):
        output = nbformat.v4.new_output("stream", text=line)
        return nbformat.v4.new_notebook(cells=[CODE("1", outputs=[output])])

    assert turned(one("NEES 2.1  yes\n"), one("NEES 2.3  yes\n")) == {}
    assert list(turned(one("NEES 2.1  yes\n"), one("NEES 5.3  no\n"))) == [(0, 0)]
    assert ranges(one("NEES 2.1\n"), [one("NEES 2.3\n")]) == ([], 1, 1)


def test_a_line_that_a_kernel_cuts_in_two_is_one_line():
    def printed(*parts):
        streams = [nbformat.v4.new_output("stream", text=part) for part in parts]
        table = nbformat.v4.new_output("execute_result", data={"text/plain": "a table"})
        return CODE("", outputs=[*streams, table])

    whole, cut = printed("one: True\ntwo: False"), printed("one: True", "\ntwo: ", "False")
    assert lines_of(whole) == lines_of(cut) == ["one: True", "two: False", "a table"]


def test_numbers_of_formulas_links_and_chapters_are_not_prose():
    cells = [PROSE("# 0.1"), PROSE("Chapter 03.5, $x = 0.5$, [0.7](a.md), `0.9`, 0.4 m and 12 m.")]
    assert said(nbformat.v4.new_notebook(cells=cells)) == [(1, "0.4", False)]


def test_an_unknown_chapter_is_refused():
    with pytest.raises(SystemExit, match="expected a notebook or the number of a chapter"):
        chapters(["77"])


def test_every_chapter_is_steady_or_has_its_reason():
    numbers = {path.stem[:2] for path in (ROOT / "notebooks").glob("[0-9]*.ipynb")}
    assert set(STEADY).isdisjoint(UNSTEADY)
    assert set(STEADY) | UNSTEADY.keys() == numbers
    assert all(len(reason.split()) >= 4 for reason in UNSTEADY.values())


def test_a_chapter_has_all_its_pages():
    assert {path.stem for path in chapters(["02"])} >= {"02_kalman_filter"}
    assert {path.stem[:2] for path in chapters([])} == set(STEADY) | UNSTEADY.keys()


def test_steady_runs_the_lesson_of_each_steady_chapter_and_is_a_part_of_make_test():
    assert sorted(path.stem[:3] for path in lessons()) == [f"{number}_" for number in STEADY]
    makefile = (ROOT / "Makefile").read_text()
    parts = next(line for line in makefile.splitlines() if line.startswith("PARTS :="))
    assert "steady" in parts.split()


@pytest.mark.parametrize(("option", "code"), [([], 0), (["--seed-shift", "1"], 1)])
def test_seeds_of_tests_move_with_the_option(tmp_path, option, code):
    test = tmp_path / "test_drawn.py"
    test.write_text(
        "import numpy as np\n\n\n"
        "def test_it():\n    assert np.random.default_rng(0).random() > 0.6\n"
    )
    words = ["-m", "pytest", "-q", "-p", "no:nbval", "-p", "no:cacheprovider", "-p", "conftest"]
    done = subprocess.run([sys.executable, *words, *option, str(test)], cwd=ROOT)
    assert done.returncode == code
