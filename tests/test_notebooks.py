"""The notebooks: text outputs only, alt text, a place in the table of contents, the bones."""

import ast
import copy
import os
import re
import runpy
import subprocess
import sys
import types
from pathlib import Path

import nbformat
import pytest
import yaml
from jupyter_cache import get_cache
from jupyter_cache.base import CacheBundleIn

from tools.build_book import book_notebooks, cache_key, is_cached, remaining
from tools.kernels import LocalKernelManager, saying_stderr
from tools.notebooks import SETTINGS, differences

ROOT = Path(__file__).resolve().parents[1]
# A page that is no chapter has no number, no bones and no exercises: each is named here.
PAGES = {"index", "questions", "simulator"}
CHAPTERS = [
    path for path in sorted((ROOT / "notebooks").glob("*.ipynb")) if path.stem not in PAGES
]
# Other pages of a chapter (NNb_ to NNe_) have a head, run and end; the lesson has the rest.
SECOND = [path for path in CHAPTERS if re.match(r"\d\d[b-e]_", path.stem)]
CHAPTERS = [path for path in CHAPTERS if path not in SECOND]
# Chapters whose lesson shows its algorithm whole, in cells of this tag.
LESSONS = {
    "00",
    "01",
    "02",
    "03",
    "04",
    "05",
    "06",
    "07",
    "08",
    "09",
    "10",
    "11",
    "12",
    "13",
    "17",
    "14",
    "15",
    "16",
    "18",
    "19",
    "20",
}
NOTEBOOKS = sorted((ROOT / "notebooks").rglob("*.ipynb"))
NOTEBOOKS = [path for path in NOTEBOOKS if ".ipynb_checkpoints" not in path.parts]
BONES = (
    r"^> \*\*Before you start\*\*",
    r"^## Predict, then run: ",
    r"^## (The paper on trial|From the paper): ",
    r"^## Where it breaks",
    r"^## (Exercises|Yours)",
    r"^## What to remember",
)
HEADER = ("**You will be able to**", "**You need first**", "**Minutes**", "**Symbols**")


# What JupyterLab, VS Code and Colab show raw. Write instead: <details><summary>Hint 1</summary>
# with blank lines inside, > **Before you start**, [text](../02_kalman_filter.ipynb),
# [Kalman (1960)](../book/bibliography.md#kalman1960new), \tag{A}.
RAW = {
    "directive": r"^\s*(:{3,}|[`~]{3,}\s*\{).*$",
    "option": r"^:[\w-]+:.*$",
    "role": r"(?<!`)\{[a-z][\w:.-]*\}`[^`\n]*`",
    "target": r"^\([\w:.-]+\)=\s*$",
    "label": r"\$\$[ \t]*\([^)$]*\)\s*$",
    "comment": r"^%+ .*$",
    "link without text": r"(?<!!)\[\]\([^)]*\)",
}
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


def name(path):
    return str(path.relative_to(ROOT / "notebooks"))


def outputs(notebook):
    return [o for c in notebook.cells if c.cell_type == "code" for o in c.outputs]


def not_text(notebook):
    """Kinds of outputs that do not belong in git."""
    kept = {"text/plain", "text/markdown", "text/latex"}
    kinds = {kind for o in outputs(notebook) for kind in o.get("data", {}) if kind not in kept}
    kinds |= {"error" for o in outputs(notebook) if o.output_type == "error"}
    kinds |= {"stderr" for o in outputs(notebook) if o.get("name") == "stderr"}
    if "widgets" in notebook.metadata:
        kinds.add("widget state")
    return kinds


def figures_without_alt(notebook):
    found = []
    for number, cell in enumerate(notebook.cells):
        if cell.cell_type != "code":
            continue
        text = "".join(o.get("data", {}).get("text/plain", "") for o in cell.outputs)
        alt = cell.metadata.get("mystnb", {}).get("image", {}).get("alt", "")
        if "<Figure size" in text and len(alt) < 30:
            found.append(number)
    return found


def raw_markup(notebook):
    """Markup of the book's builder that a reader of the notebook would see as it stands."""
    prose = "\n\n".join(c.source for c in notebook.cells if c.cell_type == "markdown")
    found = [m.group() for rule in RAW.values() for m in re.finditer(rule, prose, re.MULTILINE)]
    folds = [prose.count(tag) for tag in ("<details>", "<summary>", "</details>")]
    if len(set(folds)) > 1:
        found.append(f"{folds[0]} details, {folds[1]} summaries, {folds[2]} ends")
    # Without blank lines around it, what is folded is not read as Markdown.
    return found + re.findall(r"</summary>\n(?!\n).*|.*[^\n]\n</details>", prose)


def dead_links(path):
    """Links to files that are not there, to works that the bibliography lacks, to headings.

    A heading has another address in JupyterLab than in the book, so notebooks link to pages.
    """
    notebook = nbformat.read(path, as_version=4)
    keys = set(re.findall(r"(?m)^@\w+\{([\w-]+),", (ROOT / "book/references.bib").read_text()))
    found = []
    for cell in notebook.cells:
        if cell.cell_type != "markdown":
            continue
        for target in re.findall(r"\]\(([^)#\s]*(?:#[^)\s]*)?)\)", cell.source):
            file, _, anchor = target.partition("#")
            if re.match(r"https?:", file):
                continue
            lacking = file.endswith("bibliography.md") and anchor and anchor not in keys
            heading = file.endswith(".ipynb") and anchor
            if lacking or heading or (file and not (path.parent / file).exists()):
                found.append(target)
    return found


def missing_bones(notebook, *more_pages):
    """What a chapter lacks; figure and claims may stand on its other pages."""
    prose = "\n\n".join(c.source for c in notebook.cells if c.cell_type == "markdown")
    cells = notebook.cells + [cell for page in more_pages for cell in page.cells]
    code = "\n".join(c.source for c in cells if c.cell_type == "code")
    missing = [bone for bone in BONES if not re.search(bone, prose, re.MULTILINE)]
    missing += [part for part in HEADER if part not in prose]
    if not re.search(r"\b(Replay|Sweep)\(", code):
        missing.append("an interactive figure")
    if "plots.claims(" not in code:
        missing.append("the table of claims")
    return missing


def first_figure(notebook):
    """Number of code cells up to the first one that shows a figure or a widget."""
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for number, cell in enumerate(code, start=1):
        text = "".join(o.get("data", {}).get("text/plain", "") for o in cell.outputs)
        if "<Figure size" in text or re.search(r"(Replay|Sweep)\(", text):
            return number
    return len(code) + 1


def in_toc(path):
    toc = yaml.safe_load((ROOT / "_toc.yml").read_text())

    def files(node):
        if isinstance(node, dict):
            yield from (node[key] for key in ("root", "file") if key in node)
            for value in node.values():
                yield from files(value)
        elif isinstance(node, list):
            for value in node:
                yield from files(value)

    return str(path.relative_to(ROOT).with_suffix("")) in set(files(toc))


@pytest.fixture(params=NOTEBOOKS, ids=name)
def path(request):
    return request.param


@pytest.fixture(params=CHAPTERS, ids=name)
def chapter(request):
    return nbformat.read(request.param, as_version=4)


def test_outputs_are_text_only(path):
    assert not_text(nbformat.read(path, as_version=4)) == set()


def test_every_figure_has_alt_text(path):
    assert figures_without_alt(nbformat.read(path, as_version=4)) == []


def test_it_stands_in_the_table_of_contents(path):
    assert in_toc(path)


def test_it_is_small_and_knows_no_machine(path):
    text = path.read_text()
    assert len(text) < 400_000
    assert not re.search(r"/work/|/home/|/tmp/|/root/", text)


def test_every_cell_was_run(path):
    notebook = nbformat.read(path, as_version=4)
    assert all(c.execution_count for c in notebook.cells if c.cell_type == "code")


def test_no_cell_escapes_the_comparison(path):
    text = path.read_text()
    assert "NBVAL_SKIP" not in text
    assert "NBVAL_IGNORE_OUTPUT" not in text


def test_nothing_shows_raw_in_jupyterlab(path):
    assert raw_markup(nbformat.read(path, as_version=4)) == []


def test_its_links_lead_somewhere(path):
    assert dead_links(path) == []


def test_opening_it_changes_nothing(path):
    metadata = nbformat.read(path, as_version=4).metadata
    assert metadata.kernelspec == KERNEL
    language = metadata.language_info
    assert (language.name, language.file_extension) == ("python", ".py")
    assert language.nbconvert_exporter == "python"
    assert "version" not in language  # it would be another one on another machine


@pytest.mark.parametrize("path", CHAPTERS, ids=name)
def test_a_chapter_has_the_bones(path):
    second = [nbformat.read(one, as_version=4) for one in SECOND if one.stem[:2] == path.stem[:2]]
    assert missing_bones(nbformat.read(path, as_version=4), *second) == []


@pytest.mark.parametrize("path", SECOND, ids=name)
def test_a_second_page_has_a_head_a_lesson_before_it_and_an_end(path):
    notebook = nbformat.read(path, as_version=4)
    head, end = notebook.cells[0].source, notebook.cells[-1].source
    assert [part for part in HEADER if part not in head] == []
    assert re.search(r"\*\*Minutes\*\* \d+ to read\.\n", head)
    assert [one for one in CHAPTERS if one.stem[:2] == path.stem[:2]]
    assert re.search(r"(?m)^## What to remember", end)
    assert first_figure(notebook) <= 2


def lesson_faults(notebook):
    """What keeps a notebook from being a lesson: its words, its cells, its algorithm."""
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    prose = "\n".join(c.source for c in notebook.cells if c.cell_type == "markdown")
    words = len(re.sub(r"(?s)\$\$.*?\$\$", " ", prose).split())  # displayed formulas are none
    shown = [c.source for c in code if "algorithm" in c.metadata.get("tags", [])]
    lines = [line for source in shown for line in source.split("\n") if line.strip()]
    faults = [f"{words} words"] if words > 1800 else []
    faults += [f"{len(code)} code cells"] if len(code) > 14 else []
    faults += [f"{len(lines)} lines of algorithm"] if not 8 <= len(lines) <= 60 else []
    return faults


@pytest.mark.parametrize("path", [p for p in CHAPTERS if p.stem[:2] in LESSONS], ids=name)
def test_a_lesson_is_short_and_shows_its_algorithm(path):
    notebook = nbformat.read(path, as_version=4)
    assert lesson_faults(notebook) == []
    for cell in notebook.cells:
        cell.metadata.pop("tags", None)
    notebook.cells.append(nbformat.v4.new_markdown_cell("word " * 1800))
    assert len(lesson_faults(notebook)) == 2


def test_a_chapter_shows_a_figure_within_two_cells(chapter):
    assert first_figure(chapter) <= 2


@pytest.mark.parametrize("path", CHAPTERS, ids=name)
def test_a_chapter_has_exercises_and_solutions(path):
    assert (path.parent / "exercises" / path.name).exists()
    assert (path.parent / "solutions" / path.name).exists()


def test_every_chapter_has_a_number_and_every_page_exists():
    assert [path.stem for path in CHAPTERS if not re.match(r"\d\d_", path.stem)] == []
    assert {path.stem for path in (ROOT / "notebooks").glob("*.ipynb")} >= PAGES


def test_the_guards_see_what_they_are_for():
    good = nbformat.read(CHAPTERS[0], as_version=4)
    bad = copy.deepcopy(good)
    image = nbformat.v4.new_output(
        "display_data", data={"image/png": "", "text/plain": "<Figure size 7x4 with 1 Axes>"}
    )
    cell = nbformat.v4.new_code_cell("plt.plot([1])", outputs=[image])
    bad.cells.append(cell)
    assert not_text(bad) == {"image/png"}
    assert figures_without_alt(bad) == [len(bad.cells) - 1]
    bad.cells = [c for c in bad.cells if "## Where it breaks" not in c.source]
    assert missing_bones(bad)
    assert not in_toc(ROOT / "notebooks" / "99_nowhere.ipynb")
    bad.cells = [cell]
    bad.cells[0].outputs = []
    assert first_figure(bad) == 2


def test_the_comparison_refuses_a_changed_digit_and_nothing_else():
    v4 = nbformat.v4
    stored = v4.new_notebook(
        cells=[
            v4.new_markdown_cell("prose"),
            v4.new_code_cell("1", outputs=[v4.new_output("stream", text="RMSE 4.753 m\n")]),
            v4.new_code_cell(
                "2", outputs=[v4.new_output("execute_result", data={"text/plain": "17"})]
            ),
        ]
    )
    same = copy.deepcopy(stored)
    same.cells[1].outputs = [v4.new_output("stream", text=t) for t in ("RMSE 4.", "753 m\n")]
    same.cells[2].outputs[0].data["image/png"] = "drawn anew"
    assert differences(stored, same) == []
    other = copy.deepcopy(stored)
    other.cells[1].outputs[0].text = "RMSE 4.771 m\n"
    assert differences(stored, other) == ["cell [1]\n    -RMSE 4.753 m\n    +RMSE 4.771 m"]
    other.cells[2].outputs = [v4.new_output("error", ename="ValueError", evalue="no")]
    assert "+ValueError: no" in differences(stored, other)[1]


def test_the_other_setting_takes_all_that_may_round_differently():
    for other in (SETTINGS["plain"], SETTINGS["haswell"]):
        assert {"OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "NUMBA_CPU_NAME"} <= set(other)
        assert "NUMBA_CACHE_DIR" in other  # else code compiled for this processor would be taken


def test_a_warning_of_numbers_gone_wrong_is_an_error_in_every_setting():
    for name, setting in SETTINGS.items():
        words = [sys.executable, "-c", "import numpy; numpy.float64(1) / 0"]
        done = subprocess.run(words, env=os.environ | setting, capture_output=True, text=True)
        assert done.returncode == 1, name
        assert "RuntimeWarning: divide by zero" in done.stderr


def test_an_unexpected_line_on_stderr_is_told_word_for_word():
    cell = types.SimpleNamespace(comparison_traceback=["Unexpected output fields"])
    compare = saying_stderr(lambda self, test, ref, skip=None: test == ref)
    warned = {"output_type": "stream", "name": "stderr", "text": "x.py:3: DeprecationWarning"}
    assert not compare(cell, [warned], [])
    assert cell.comparison_traceback[-1] == "on stderr: x.py:3: DeprecationWarning"
    assert compare(cell, [warned], [warned])
    assert len(cell.comparison_traceback) == 2


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such sockets")
def test_kernels_do_not_share_ports(monkeypatch):
    import nbval.kernel
    from nbval.plugin import IPyNbCell

    monkeypatch.setattr(nbval.kernel, "KernelManager", None)
    monkeypatch.setattr(IPyNbCell, "compare_outputs", IPyNbCell.compare_outputs)
    runpy.run_path(str(ROOT / "conftest.py"))
    assert nbval.kernel.KernelManager is LocalKernelManager
    first, second = LocalKernelManager(), LocalKernelManager()
    assert first.transport == "ipc"
    assert first.ip != second.ip


@pytest.mark.parametrize(
    "source",
    [
        ":::{dropdown} Hint 1\nthink\n:::",
        "```{note}\nthink\n```",
        "see {doc}`../03_extended_kalman_filter`",
        "found by {cite:t}`kalman1960new`",
        "by {eq}`eq-x`",
        "$$\nx\n$$ (eq-x)",
        "(here)=\n## A heading",
        "see [](../03_extended_kalman_filter.ipynb)",
        "<details><summary>Hint 1</summary>\nthink\n</details>",
        "<details><summary>Hint 1</summary>\n\nthink",
    ],
)
def test_raw_markup_is_seen(source):
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell(source)])
    assert raw_markup(notebook)


def test_plain_markup_passes():
    source = (
        "> **Before you start**\n>\n> - bring a pencil\n\n"
        "<details><summary>Hint 1</summary>\n\nUse `{x}` and $\\{a\\}$ in\n\n"
        "```python\nx = {1: 2}\n```\n\n</details>\n\n$$\nx = 1\n\\tag{A}\n$$\n\nand (A)"
    )
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell(source)])
    assert raw_markup(notebook) == []


def test_a_dead_link_is_seen(tmp_path):
    source = "[a](no.ipynb), [b](../book/bibliography.md#nobody1900nothing), [c](x.ipynb#there)"
    cells = [nbformat.v4.new_markdown_cell(source)]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), tmp_path / "x.ipynb")
    assert len(dead_links(tmp_path / "x.ipynb")) == 3


def test_the_book_runs_every_notebook_of_its_contents():
    assert set(book_notebooks()) == set(NOTEBOOKS)


def test_only_a_notebook_whose_cells_changed_runs_again(tmp_path):
    cache, path = get_cache(str(tmp_path / "cache")), tmp_path / "a.ipynb"
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("1 + 1")])
    nbformat.write(notebook, path)
    assert not is_cached(cache, path)
    cache.cache_notebook_bundle(CacheBundleIn(notebook, str(path)), check_validity=False)
    notebook.cells.append(nbformat.v4.new_markdown_cell("prose"))
    nbformat.write(notebook, path)
    assert is_cached(cache, path)
    notebook.cells[0].source = "1 + 2"
    nbformat.write(notebook, path)
    assert not is_cached(cache, path)


def test_whatever_the_library_holds_decides_whether_outputs_count(tmp_path):
    (tmp_path / "slamlab").mkdir()
    (tmp_path / "requirements.lock").write_text("numpy==2\n")
    seen = {cache_key(tmp_path)}
    for name in ("a.py", "a.js", "data.npz"):
        (tmp_path / "slamlab" / name).write_text("1")
        seen.add(cache_key(tmp_path))
    (tmp_path / "requirements.lock").write_text("numpy==3\n")
    seen.add(cache_key(tmp_path))
    assert len(seen) == 5
    (tmp_path / "slamlab" / "a.pyc").write_text("1")
    assert cache_key(tmp_path) in seen


def test_what_is_left_is_told_in_seconds_once_they_are_known():
    assert remaining({"a", "b"}, {"a": 30.0}, 2) == "2 left"
    assert remaining({"a", "b"}, {"a": 30.0, "b": 20.0}, 2) == "2 left, about 30 s"
    assert remaining(set(), {}, 2) == "0 left"


FOLDED = {"hide-input", "hide-cell", "remove-input", "remove-cell"}


def is_one_function(source):
    """Whether a cell is one function, with the call that tries it and what that needs."""
    body = ast.parse(source).body
    functions = [node for node in body if isinstance(node, ast.FunctionDef)]
    return len(functions) == 1 and len(body) <= 3


def is_all_stubs(source):
    """Whether a cell is functions without lines, to be written by the student."""
    functions = ast.parse(source).body
    return all(
        isinstance(node, ast.FunctionDef) and ast.unparse(node.body[-1]) == "..."
        for node in functions
    )


def too_much_code(notebook, a_function=False):
    """Visible code cells that are no idea but plumbing: (cell, lines, longest line).

    In an exercise the student's own function may be longer, its docstring is the question.
    """
    found = []
    for number, cell in enumerate(notebook.cells):
        tags = set(cell.metadata.get("tags", []))
        if cell.cell_type != "code" or tags & FOLDED:
            continue
        lines = cell.source.split("\n")
        longest = max(map(len, lines))
        one = len(lines) > 20 and (
            (a_function and is_one_function(cell.source)) or is_all_stubs(cell.source)
        )
        if (len(lines) > 20 and not one) or longest > 88:
            found.append((number, len(lines), longest))
    return found


def printed_too_wide(notebook):
    """Cells that print more than a column holds: (cell, longest line)."""
    widths = [
        (number, max(map(len, output.text.split("\n"))))
        for number, cell in enumerate(notebook.cells)
        for output in (cell.outputs if cell.cell_type == "code" else ())
        if output.output_type == "stream"
    ]
    return [(number, width) for number, width in widths if width > 88]


def typed_verdicts(notebook):
    """Tables with a verdict and no criterion: a cell typed it instead of computing it."""
    return [
        number
        for number, cell in enumerate(notebook.cells)
        for output in (cell.outputs if cell.cell_type == "code" else ())
        if re.search(
            r"(?m)^(?!.*holds if).*\bverdict *$", output.get("data", {}).get("text/plain", "")
        )
    ]


def test_a_visible_cell_is_an_idea(path):
    own = path.parent.name in ("exercises", "solutions")
    assert too_much_code(nbformat.read(path, as_version=4), a_function=own) == []


def wide_code_in_prose(notebook):
    """Lines of code blocks in the prose that are wider than a column."""
    prose = [c.source for c in notebook.cells if c.cell_type == "markdown"]
    blocks = re.findall(r"(?ms)^```[^\n]*\n(.*?)^```", "\n\n".join(prose))
    return [line for block in blocks for line in block.split("\n") if len(line) > 88]


def test_code_in_the_prose_fits_the_column(path):
    assert wide_code_in_prose(nbformat.read(path, as_version=4)) == []


@pytest.mark.parametrize("path", CHAPTERS, ids=name)
def test_what_is_printed_fits_the_column(path):
    assert printed_too_wide(nbformat.read(path, as_version=4)) == []


@pytest.mark.parametrize("path", CHAPTERS, ids=name)
def test_verdicts_are_computed(path):
    assert typed_verdicts(nbformat.read(path, as_version=4)) == []


def test_the_guards_of_the_page_see_what_they_are_for():
    long, wide = "x = 1\n" * 20 + "x", "x" * 89
    for source in (long, wide):
        cell = nbformat.v4.new_code_cell(source)
        assert too_much_code(nbformat.v4.new_notebook(cells=[cell]))
        cell.metadata["tags"] = ["hide-input"]
        assert not too_much_code(nbformat.v4.new_notebook(cells=[cell]))
    answer = "def f(x):\n" + "    x += 1\n" * 20 + "    return x\n"
    for source, allowed in (
        (answer + "\nx = 1\nf(x)", True),
        (answer + "\n" + answer, False),
        (answer + "    # " + wide, False),
        (answer + "x = 1\ny = 2\nf(x + y)", False),
    ):
        notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source)])
        assert bool(too_much_code(notebook, a_function=True)) is not allowed
        assert too_much_code(notebook)
    block = nbformat.v4.new_markdown_cell("```python\n" + wide + "\n```")
    assert wide_code_in_prose(nbformat.v4.new_notebook(cells=[block])) == [wide]
    line = nbformat.v4.new_output("stream", text="short\n" + wide)
    cell = nbformat.v4.new_code_cell("", outputs=[line])
    assert printed_too_wide(nbformat.v4.new_notebook(cells=[cell])) == [(0, 89)]
    old = nbformat.v4.new_output("display_data", {"text/plain": "claim  ours  verdict\n-----"})
    assert typed_verdicts(
        nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("", outputs=[old])])
    )


def minutes_of_header(path):
    """Minutes to read and for the exercises, as the head of a chapter states them."""
    head = nbformat.read(path, as_version=4).cells[0].source
    said = re.search(r"\*\*Minutes\*\* (\d+) to read; the exercises take another (\d+)\.\n", head)
    assert said, "say: N to read; the exercises take another M."
    return tuple(map(int, said.groups()))


def minutes_of_guide(text, number):
    """The same two numbers from the row of the teacher's guide."""
    row = re.search(rf"(?m)^\| {number} [^|]*\| (\d+) min \| (\d+) min \|", text)
    return tuple(map(int, row.groups())) if row else None


@pytest.mark.parametrize("path", CHAPTERS, ids=name)
def test_the_teachers_guide_has_the_minutes_of_the_header(path):
    guide = (ROOT / "book" / "teachers_guide.md").read_text()
    assert minutes_of_guide(guide, path.stem[:2]) == minutes_of_header(path)
    assert minutes_of_guide(guide, "99") is None


def needs_of_guide(guide):
    """What each chapter and lab needs, as sets of which one will do, by the guide's two tables."""
    chapters = re.findall(r"(?m)^\| (\d\d) [^|]*\|[^|]*\|[^|]*\| ([^|]*) \|", guide)
    labs = re.findall(r"(?m)^\| ([IV]+) [^|]*\|[^|]*\| ([^|]*) \|$", guide)
    return {
        name: [set(found) for part in text.split(",") if (found := re.findall(r"\d\d", part))]
        for name, text in chapters + labs
    }


def path_of_guide(guide, heading):
    """(week, chapters, labs) of each row of a path's table."""
    part = re.search(rf"(?ms)^### {heading}:.*?(?=^##)", guide)[0]
    rows = re.findall(r"(?m)^\| (\d+) \| (.*?) \| (.*?) \|$", part)
    chapter = re.compile(r"(?<![\w/(])(\d\d)(?!\w)")
    return [(int(n), chapter.findall(read), re.findall(r"Lab (\w+)", do)) for n, read, do in rows]


def fault_of_path(rows, needs):
    """The first chapter or lab of a path that comes before what it needs."""
    read = set()
    for _, chapters, labs in rows:
        for one in chapters + labs:
            if any(not choice & read for choice in needs[one]):
                return one
            read.add(one)
    return None


@pytest.mark.parametrize(("heading", "weeks"), [("Eight weeks", 8), ("Fourteen weeks", 14)])
def test_a_path_reads_nothing_before_what_it_needs(heading, weeks):
    guide = (ROOT / "book" / "teachers_guide.md").read_text()
    needs, rows = needs_of_guide(guide), path_of_guide(guide, heading)
    assert len(needs) == 21 + 5
    assert needs["III"] == [{"09", "12"}, {"11"}]
    assert [week for week, _, _ in rows] == list(range(1, weeks + 1))
    assert {"13", "14", "I", "II"} <= {one for _, read, labs in rows for one in read + labs}
    assert fault_of_path(rows, needs) is None
    assert fault_of_path(rows[1:], needs) is not None
    assert fault_of_path(rows[::-1], needs) is not None
