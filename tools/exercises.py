"""Write the exercise and the solution notebook of a chapter from its one source.

    python tools/exercises.py            all chapters (`make exercises`)
    python tools/exercises.py 02 09      these
    python tools/exercises.py --run 02   run them even where the code is the same
    python tools/exercises.py --check    write nothing; tell which notebooks are not what it says
    python tools/exercises.py --variant 2027 FOLDER [09 ...]
                                         other bugs to find, into a folder of its own, not run

The source is `slamlab/exercises/chNN_*.py`, in the percent format that jupytext, JupyterLab and
most editors know as cells. A cell's tag says what it is:

    chapter     the head of the exercise notebook
    imports     what both notebooks import; the checks are added (with `solution`: this notebook's)
    statement   what is asked: a text, or code that stands in the exercise notebook only
    exercise    the function: its docstring is the student's, its body the solution's. It is the
                reference of the check, too. Where the check has a picture, it is drawn below it
    predict     with `exercise`: its picture is to be guessed first, and folded until clicked
    stub        what is handed out in place of `...`: the body with bugs, or with a beginning
    try         the call below the stub
    hint        one folded hint
    cases       the check: what is tried; in no notebook
    mistakes    the mistakes that are known by name; in no notebook
    solution    a text of the solution notebook, or a cell; the solution follows its first text

Code that only a notebook runs is in cells with ``active="ipynb"``, as comments. Paragraphs are
wrapped in the source and one line in the notebook. Outputs stay where the code is the same; a
notebook with other code is run.
"""

from __future__ import annotations

import ast
import re
import sys
import textwrap
from collections import defaultdict
from collections.abc import Iterator
from importlib import import_module
from itertools import combinations
from pathlib import Path

import jupytext
import nbformat
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.exercises import Check
from slamlab.exercises._report import _without_docstring
from tools.notebooks import METADATA, run, slim

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / "slamlab" / "exercises"
TAGS = {
    "chapter", "imports", "statement", "exercise", "stub", "try", "hint", "cases", "mistakes",
    "solution", "private", "predict",
}  # fmt: skip
# Folded in the book. (JupyterLab unfolds what is run, whatever a notebook says.)
FOLDED = {"tags": ["hide-output"]}
WIDTH = 88  # of a line of code on a page
# A line that begins something of its own, and one that the next does not continue.
STARTS = re.compile(r"[-*+] |\d+\. |[>|]|</?[a-z]|#+ |\$\$|```")
ALONE = re.compile(r"[|<]|#+ ")

Cell = nbformat.NotebookNode


def sources(chapters: list[str] | None = None) -> list[Path]:
    """Return the sources of some chapters, or of all."""
    paths = sorted(SOURCES.glob("ch[0-9][0-9]_*.py"))
    return [path for path in paths if not chapters or path.name[2:4] in chapters]


def notebook_paths(source: Path) -> tuple[Path, Path]:
    """Return where the exercises of a source are, and its solutions."""
    name = source.stem.removeprefix("ch") + ".ipynb"
    return ROOT / "notebooks" / "exercises" / name, ROOT / "notebooks" / "solutions" / name


def cells_of(source: Path) -> list[Cell]:
    """Read the tagged cells of a source."""
    found = []
    for cell in jupytext.reads(source.read_text(encoding="utf-8"), fmt="py:percent").cells:
        tags = cell.metadata.get("tags", [])
        if not found and not tags:
            continue  # docstring and imports of the library
        if not TAGS & set(tags):
            raise ValueError(f"{source.name}: expected a tag of {sorted(TAGS)} in {cell.source!r}")
        if cell.cell_type == "markdown":
            cell.source = unwrapped(cell.source)
        found.append(cell)
    return found


def unwrapped(text: str) -> str:
    """Return a text with each paragraph and each point of a list on one line."""
    lines: list[str] = []
    fenced = apart = False
    for line in text.split("\n"):
        fence = line.startswith("```") or line.count("$$") == 1
        if fenced or fence or apart or not line or not lines or STARTS.match(line):
            lines.append(line)
        else:
            lines[-1] += " " + line.strip()
        fenced ^= fence
        apart = fence or not line or bool(ALONE.match(line)) or line.endswith("$$")
    return "\n".join(lines)


def notebooks(source: Path, year: int | None = None) -> tuple[list[Cell], list[Cell]]:
    """Return the cells of the exercise notebook and of the solution notebook.

    With a year the programs with bugs have other bugs, chosen among the mistakes that are known.
    """
    cells = cells_of(source)
    if year is not None:
        cells = with_other_bugs(cells, source, year)
    checks = dict(_checks(cells))
    drawn = dict(_pictures(cells))
    tasks: list[Cell] = []
    answers: list[Cell] = []
    hints: list[str] = []
    stub = _code("")
    pending: list[Cell] = []  # a solution whose text is still to come
    number = 0
    for cell in cells:
        tags = set(cell.metadata.tags) & TAGS
        if tags != {"hint"} and hints and tags & {"statement", "exercise", "chapter"}:
            tasks.append(_text("\n\n".join(hints)))
            hints = []
        if "imports" in tags:
            code = _with_checks(cell.source, source.stem, sorted(checks.values()))
            if "solution" not in tags:
                tasks.append(_code(code, cell))
            answers[1:] = [_code(code, cell)]
        elif "exercise" in tags:
            number = 0
            function = _function(cell.source)
            call = f"{checks[function.name]}({function.name})"
            stub = _code(_stub(cell.source, "    ..."), cell)
            tasks += [stub, _code(call)]
            pending = [_code(f"{_solution(cell.source)}\n\n{call}", cell)]
            if function.name in drawn:
                shown = {"mystnb": {"image": {"alt": drawn[function.name]}}}
                for of in (tasks, pending):
                    of.append(_code(f"{checks[function.name]}.draw({function.name})"))
                    folded = FOLDED if of is tasks and "predict" in tags else {}
                    of[-1].metadata = nbformat.from_dict(shown | folded)
        elif "stub" in tags:
            stub.source = stub.source.removesuffix("    ...") + cell.source
        elif "try" in tags:
            stub.source += "\n\n" + cell.source
        elif "hint" in tags:
            number += 1
            head = f"<details><summary>Hint {number}</summary>"
            hints.append(f"{head}\n\n{cell.source}\n\n</details>")
        elif tags & {"chapter", "statement"}:
            tasks.append(_copy(cell))
        elif "solution" in tags:
            answers.append(_copy(cell))
            if pending and cell.cell_type == "markdown":
                answers += pending
                pending = []
    if hints:
        tasks.append(_text("\n\n".join(hints)))
    for letter, of in (("e", tasks), ("s", answers)):
        for k, cell in enumerate(of):
            cell.id = f"{letter}{source.name[2:4]}-{k:02d}"
    return tasks, answers


def with_other_bugs(cells: list[Cell], source: Path, year: int) -> list[Cell]:
    """Return the cells of a source with other bugs in each program that is handed out.

    The hints of such an exercise fall, for they lead to the bugs of the source; its statement and
    its solution say what is handed out instead.
    """
    module = import_module(f"slamlab.exercises.{source.stem}")
    checks = {c.name: c for c in vars(module).values() if isinstance(c, Check)}
    found: list[Cell] = []
    statement, function, bugs, pending = None, None, (), False
    for cell in map(nbformat.from_dict, cells):
        tags = set(cell.metadata.tags) & TAGS
        if tags == {"statement"} and cell.cell_type == "markdown":
            statement, bugs = cell, ()
        elif "exercise" in tags:
            function = cell
        elif tags == {"stub"} and "bug" in statement.source:
            check = checks[_function(function.source).name]
            number = 2 if "two bugs" in statement.source else 1
            bugs, cell.source = _bugs(check, function.source, cell.source, number, year)
            one = "one bug, another" if number == 1 else "two bugs, others"
            if bugs:
                statement.source += f"\n\n**Variant {year}**: this program has {one} than above."
                pending = True
        if bugs and tags == {"hint"}:
            continue
        found.append(cell)
        if pending and tags == {"solution"} and cell.cell_type == "markdown":
            lines = "\n".join(f"- {bug}" for bug in bugs)
            found.append(_text(f"Handed out in variant {year}:\n\n{lines}"))
            found[-1].metadata = nbformat.from_dict({"tags": ["solution"]})
            pending = False
    return found


def _bugs(
    check: Check, code: str, stub: str, number: int, year: int
) -> tuple[tuple[str, ...], str]:
    """Choose mistakes by the year; return their names and the body of the program with them.

    Each alone is refused by the check, and so are all together. Where no others than those of the
    stub go together, it is returned as it is, without a name.
    """
    solution = _without_docstring(code)
    edits = {
        message: (wrong,) if isinstance(wrong, str) else wrong
        for message, wrong in check.mistakes.items()
        if not callable(wrong)
    }
    rng = np.random.default_rng([year, *check.name.encode()])
    choices = list(combinations(edits, number))
    for k in rng.permutation(len(choices)):
        together = tuple(edit for message in choices[k] for edit in edits[message])
        program = solution
        for edit in together:
            old, new = edit.split(" => ")
            program = program.replace(old, new) if program.count(old) == 1 else ""
        body = textwrap.indent(textwrap.dedent(program.partition(":\n")[2]), "    ").rstrip()
        if body and body != stub.rstrip() and not check.passes(check.mistaken(together)):
            return choices[k], body
    return (), stub


def _checks(cells: list[Cell]) -> Iterator[tuple[str, str]]:
    """Yield the name of each function that is checked, and that of its check."""
    for made, name in _made(cells):
        yield ast.unparse(made.args[0]), name


def _pictures(cells: list[Cell]) -> Iterator[tuple[str, str]]:
    """Yield the name of each function whose result is drawn, and the alternative text."""
    bodies = [ast.parse(c.source).body for c in cells if "cases" in c.metadata.tags]
    functions = [n for body in bodies for n in body if isinstance(n, ast.FunctionDef)]
    texts = {function.name: ast.get_docstring(function) for function in functions}
    for made, _ in _made(cells):
        for word in made.keywords:
            if word.arg == "picture":
                text = " ".join(texts[ast.unparse(word.value)].removeprefix("Draw ").split())
                yield ast.unparse(made.args[0]), f"Two panels, yours and as it should be: {text}"


def _made(cells: list[Cell]) -> Iterator[tuple[ast.Call, str]]:
    """Yield each call that makes a check, and the check's name."""
    for cell in cells:
        if "cases" in cell.metadata.tags:
            for node in ast.parse(cell.source).body:
                made = node.value if isinstance(node, ast.Assign) else None
                if isinstance(made, ast.Call) and ast.unparse(made.func) == "Check":
                    yield made, ast.unparse(node.targets[0])


def _function(code: str) -> ast.FunctionDef:
    (function,) = (n for n in ast.parse(code).body if isinstance(n, ast.FunctionDef))
    return function


def _head(function: ast.FunctionDef) -> str:
    """Return the line with the name and the arguments, without types."""
    for part in ast.walk(function.args):
        if isinstance(part, ast.arg):
            part.annotation = None
    return f"def {function.name}({ast.unparse(function.args)}):"


def _stub(code: str, body: str) -> str:
    function = _function(code)
    text = function.body[0]
    lines = code.split("\n")[text.lineno - 1 : text.end_lineno]
    return "\n".join([_head(function), *lines, body])


def _solution(code: str) -> str:
    function = _function(code)
    lines = code.split("\n")
    before, body = lines[: function.lineno - 1], lines[function.body[0].end_lineno :]
    return "\n".join([*before, _head(function), *body]).rstrip()


def _with_checks(imports: str, module: str, checks: list[str]) -> str:
    """Return the imports with the one of the checks, where the alphabet has it."""
    begin = f"from slamlab.exercises.{module} import "
    line = begin + ", ".join(checks)
    if len(line) > WIDTH:
        line = begin + "(\n" + "".join(f"    {check},\n" for check in checks) + ")"
    lines = imports.split("\n")
    own = [k for k, one in enumerate(lines) if one.startswith("from slamlab.")]
    later = [k for k in own if lines[k] > begin]
    if not own:
        return f"{imports}\n\n{line}"
    lines.insert(later[0] if later else own[-1] + 1, line)
    return "\n".join(lines)


def _copy(cell: Cell) -> Cell:
    return _text(cell.source) if cell.cell_type == "markdown" else _code(cell.source, cell)


def _text(text: str) -> Cell:
    return nbformat.v4.new_markdown_cell(text)


def _code(code: str, like: Cell | None = None) -> Cell:
    cell = nbformat.v4.new_code_cell(code)
    more = dict(like.metadata) if like else {}
    shown = [tag for tag in more.pop("tags", []) if tag not in TAGS]
    for own in ("active", "lines_to_next_cell"):  # jupytext's
        more.pop(own, None)
    cell.metadata = nbformat.from_dict(more | ({"tags": shown} if shown else {}))
    return cell


def written(path: Path, cells: list[Cell], anew: bool = False) -> nbformat.NotebookNode:
    """Return the notebook of these cells; what is stored gives the outputs of code that stays.

    With `anew` it is run all the same: what a check says may have changed.
    """
    notebook = nbformat.v4.new_notebook(cells=cells, metadata=nbformat.from_dict(METADATA))
    known: dict[str, list[Cell]] = defaultdict(list)
    if path.exists():
        for cell in nbformat.read(path, as_version=4).cells:
            if cell.cell_type == "code" and cell.execution_count:
                known[cell.source].append(cell)
    code = [cell for cell in cells if cell.cell_type == "code"]
    if not anew and all(known[cell.source] for cell in code):
        for cell in code:
            old = known[cell.source]
            cell.outputs = (old.pop(0) if len(old) > 1 else old[0]).outputs
    else:
        print(f"running {path.relative_to(ROOT)}")
        run(notebook, path.parent)
    slim(notebook)
    return notebook


def differences(path: Path, cells: list[Cell]) -> list[str]:
    """Tell which cells of a notebook are not what its source says."""

    def said(cell: Cell) -> tuple[str, str, str, dict]:
        return cell.id, cell.cell_type, cell.source, dict(cell.metadata)

    stored = nbformat.read(path, as_version=4).cells
    found = [
        f"{path.name}: {a.id}" for a, b in zip(stored, cells, strict=False) if said(a) != said(b)
    ]
    if len(stored) != len(cells):
        found.append(f"{path.name}: {len(stored)} cells, not {len(cells)}")
    return found


def write_variant(year: int, folder: Path, chapters: list[str]) -> None:
    """Write exercises and solutions with other bugs, without outputs."""
    for source in sources(chapters):
        for path, cells in zip(notebook_paths(source), notebooks(source, year), strict=True):
            notebook = nbformat.v4.new_notebook(cells=cells, metadata=nbformat.from_dict(METADATA))
            to = folder / path.parent.name / path.name
            to.parent.mkdir(parents=True, exist_ok=True)
            nbformat.write(notebook, to)


def main(words: list[str]) -> int:
    if words[:1] == ["--variant"]:
        write_variant(int(words[1]), Path(words[2]), words[3:])
        return 0
    wrong: list[str] = []
    for source in sources([word for word in words if not word.startswith("-")]):
        for path, cells in zip(notebook_paths(source), notebooks(source), strict=True):
            if "--check" in words:
                wrong += differences(path, cells)
            else:
                nbformat.write(written(path, cells, "--run" in words), path)
    print("\n".join(wrong))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
