"""Run the chapters with every seed moved: what raises, which verdicts turn, how numbers vary.

make seeds [CH=09] [N=5]     (one shift of all chapters takes minutes)
python tools/seeds.py [--shifts N] [--jobs N] [NOTEBOOK or NUMBER ...]
python tools/seeds.py --steady     (make steady: one shift of the lessons in STEADY; in make test)

Shift k adds 1000 k to each integer seed that goes into `numpy.random.default_rng` or
`SeedSequence`, by a start-up file of the kernel: no notebook is touched. Outputs are compared with
those stored. Exits with 1 if a cell raises or a verdict turns.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path

import nbformat

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.kernels import find_fonts
from tools.notebooks import ROOT, SETTINGS, client, n_cores

STEP = 1000
# Chapters whose lessons `make test` holds to one shift: nothing raises, no verdict turns. Their
# second pages take as long again, and are left to `make seeds`.
STEADY = tuple("00 01 02 03 04 05 06 07 08 09 10 11 12 13 14 15 16 17 18 19 20".split())
# The others: what raised or turned, in how many of two shifts. A page that is mended moves up.
UNSTEADY: dict[str, str] = {}

START_UP = '''
def _move_seeds():
    """Add SLAMLAB_SEED_SHIFT to integer seeds; others (None, sequences, generators) stay."""
    import os

    import numpy as np

    shift = int(os.environ["SLAMLAB_SEED_SHIFT"])
    default_rng, sequence = np.random.default_rng, np.random.SeedSequence

    def moved(seed):
        whole = isinstance(seed, (int, np.integer)) and not isinstance(seed, bool)
        if isinstance(seed, (list, tuple)) and seed:
            return [moved(seed[0]), *seed[1:]]
        return seed + shift if whole else seed

    np.random.default_rng = lambda seed=None: default_rng(moved(seed))
    np.random.SeedSequence = lambda entropy=None, **more: sequence(moved(entropy), **more)


_move_seeds()
del _move_seeds
'''

NUMBER = re.compile(r"(?<![\w.])[-−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
VERDICT = re.compile(
    r"\b(true|false|yes|no|none|holds|fails|failed|passed|confirmed|refuted|inside|outside|"
    r"converged|diverged|diverges|lost)\b",
    re.IGNORECASE,
)
# What is no prose; tests/test_prose_numbers.py reads numbers by it, too.
NOT_PROSE = (
    r"(?s)\$\$.*?\$\$", r"\$[^$]*\$", r"`[^`]*`", r"!?\[[^\]]*\]\([^)]*\)", r"<[^>]+>",
    r"\((?:P\d )?\d+[a-z]?\)(?:-\(\d+\))?",
    r"(?i)\b(?:P\d|chapters?|figures?|sections?|steps?|tables?|formulas?) ?"
    r"\(?\d+(?:\.\d+)?(?:(?:,| and| to) \d+)*",
)  # fmt: skip
SAID = re.compile(
    r"(?<![\w.,/\[(-])(\d{1,3}(?:[ \u00a0\u202f]\d{3})+|\d+(?:\.\d+)?)(?![\w.]*\d)"
    r"(\s*(?:%|[cmk]m\b|ms\b|percent|times))?"
)
SCALES = (100, 1000, 0.01, 0.001)  # of a number that has such a unit


@dataclass
class Report:
    """What moved seeds did to one notebook."""

    name: str
    raised: list[str] = field(default_factory=list)
    turned: list[str] = field(default_factory=list)
    ranges: list[str] = field(default_factory=list)
    n_numbers: int = 0
    n_moved: int = 0
    seconds: float = 0.0

    @property
    def steady(self) -> bool:
        """Nothing raised, no verdict turned."""
        return not self.raised and not self.turned

    def __str__(self) -> str:
        lines = [
            f"{self.name}: {len(self.raised)} raise, {len(self.turned)} verdicts turn, "
            f"{self.n_moved} of {self.n_numbers} printed numbers vary ({self.seconds:.0f} s)"
        ]
        for title, found in (
            ("raises", self.raised),
            ("turns", self.turned),
            ("prose", self.ranges),
        ):
            lines += [f"  {title:6s} {line}" for line in found]
        return "\n".join(lines)


def executed(path: Path, shift: int) -> nbformat.NotebookNode:
    """Run a copy of a notebook with its seeds moved by `shift`; a cell that raises stops none.

    The kernel's folder of start-up files is made anew and removed.
    """
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory(prefix="seeds-") as folder:
        start_up = Path(folder, "profile_default", "startup")
        start_up.mkdir(parents=True)
        (start_up / "00-move-seeds.py").write_text(START_UP, encoding="utf-8")
        environment = os.environ | {"IPYTHONDIR": folder, "SLAMLAB_SEED_SHIFT": str(shift)}
        client(notebook, path.parent, timeout=900, allow_errors=True).execute(env=environment)
    return notebook


def _code(notebook: nbformat.NotebookNode) -> list[tuple[int, nbformat.NotebookNode]]:
    return [(i, cell) for i, cell in enumerate(notebook.cells) if cell.cell_type == "code"]


def lines_of(cell: nbformat.NotebookNode) -> list[str]:
    """Give the lines that a cell printed, and its results and tables as plain text.

    A line of a stream may come in two parts; a kernel cuts where it likes.
    """
    text = ""
    for output in cell.outputs:
        if output.output_type == "stream":
            text += output.text
        else:
            line = "" if text.endswith("\n") or not text else "\n"
            text += line + output.get("data", {}).get("text/plain", "") + "\n"
    return text.splitlines()


def raised(notebook: nbformat.NotebookNode) -> list[str]:
    """Give the cells that raised, by number, with the error's last line; the first one leads."""
    return [
        f"[{i}] {output.ename}: {output.evalue.splitlines()[-1] if output.evalue else ''}"[:150]
        for i, cell in _code(notebook)
        for output in cell.outputs
        if output.output_type == "error"
    ]


def turned(
    stored: nbformat.NotebookNode, moved: nbformat.NotebookNode
) -> dict[tuple[int, int], str]:
    """Give lines of output whose verdict words differ, by cell and line: which word turned."""
    found = {}
    for (i, old), (_, new) in zip(_code(stored), _code(moved), strict=True):
        if any(output.output_type == "error" for output in new.outputs):
            continue
        for row, lines in enumerate(zip_longest(lines_of(old), lines_of(new), fillvalue="")):
            before, after = ([w.lower() for w in VERDICT.findall(line)] for line in lines)
            if before != after:
                words = [f"{a} -> {b}" for a, b in zip_longest(before, after) if a != b]
                label = re.sub(r"\s+", " ", lines[0] or lines[1]).strip()[:90]
                found[i, row] = f"{', '.join(words)}: {label}"
    return found


def numbers(notebook: nbformat.NotebookNode) -> dict[tuple[int, int, int], str]:
    """Give every number that the cells print, by cell, line and place in the line."""
    return {
        (i, row, place): text.replace("−", "-")
        for i, cell in _code(notebook)
        for row, line in enumerate(lines_of(cell))
        for place, text in enumerate(NUMBER.findall(line))
    }


def said(notebook: nbformat.NotebookNode) -> list[tuple[int, str, bool]]:
    """Give numbers of the prose: cell, number, may its unit differ from the printed one's.

    They are fractions, and whole numbers above 20.
    """
    found = []
    for i, cell in enumerate(notebook.cells):
        if cell.cell_type != "markdown" or i == 0:
            continue
        text = cell.source
        for pattern in NOT_PROSE:
            text = re.sub(pattern, " ", text)
        for match in SAID.finditer(text):
            number = re.sub(r"\s", "", match[1])
            if "." in number or float(number) > 20:
                found.append((i, number, match[2] is not None))
    return list(dict.fromkeys(found))


def ranges(
    stored: nbformat.NotebookNode, moved: list[nbformat.NotebookNode]
) -> tuple[list[str], int, int]:
    """Give the range of each number of the prose that moves; how many are printed, and move.

    A number of the prose is the one of the nearest cell, in its code or its output, that equals it
    up to rounding; it moves if it is printed and moves there.
    """
    printed = numbers(stored)
    runs = [numbers(one) for one in moved]
    moves = {key for key, text in printed.items() if any(r.get(key, text) != text for r in runs)}
    written = {
        (i, -1, place): text
        for i, cell in _code(stored)
        for place, text in enumerate(NUMBER.findall(cell.source.replace("_", "")))
    }
    lines = []
    for i, number, scaled in said(stored):
        digits = len(number.partition(".")[2])
        matches = [
            (scale != 1, abs(key[0] - i), key, scale)
            for scale in (1, *SCALES * scaled)
            for key, text in [*written.items(), *printed.items()]
            if abs(round(abs(float(text)) * scale, digits) - float(number)) < 1e-9
        ]
        if not matches:
            continue
        _, _, key, scale = min(matches)
        if key not in moves:
            continue
        values = [abs(float(r[key])) * scale for r in [printed, *runs] if key in r]
        low, high = (f"{value:.{digits}f}" for value in (min(values), max(values)))
        if low != high:
            lines.append(f"[{i}] {number}: {low} to {high}")
    return lines, len(printed), len(moves)


def report(path: Path, shifts: list[int]) -> Report:
    """Run one notebook with each shift and compare with what is stored."""
    begin = time.perf_counter()
    stored = nbformat.read(path, as_version=4)
    moved = [executed(path, STEP * k) for k in shifts]
    result = Report(path.stem)
    turns: dict[tuple[int, int], list[tuple[int, str]]] = {}
    for k, one in zip(shifts, moved, strict=True):
        errors = raised(one)
        if errors:
            more = f" (and {len(errors) - 1} more cells)" if len(errors) > 1 else ""
            result.raised.append(f"shift {k}: {errors[0]}{more}")
        for key, line in turned(stored, one).items():
            turns.setdefault(key, []).append((k, line))
    for (cell, _), found in sorted(turns.items()):
        at = ", ".join(str(k) for k, _ in found)
        result.turned.append(
            f"[{cell}] in {len(found)} of {len(shifts)} (shift {at}): {found[0][1]}"
        )
    result.ranges, result.n_numbers, result.n_moved = ranges(stored, moved)
    result.seconds = time.perf_counter() - begin
    return result


def chapters(names: list[str]) -> list[Path]:
    """Find notebooks: by path, or all pages of a chapter by its number; all without names."""
    folder = ROOT / "notebooks"
    found = []
    for name in names or ["[0-9]"]:
        paths = [Path(name)] if name.endswith(".ipynb") else sorted(folder.glob(f"{name}*.ipynb"))
        if not paths or not all(path.is_file() for path in paths):
            raise SystemExit(f"expected a notebook or the number of a chapter, got {name!r}")
        found += paths
    return found


def lessons() -> list[Path]:
    """Find the lessons of the steady chapters, the later and longer ones first."""
    paths = [path for path in chapters(list(STEADY)) if path.stem[2] == "_"]
    return sorted(paths, key=lambda path: path.stem[0] == "0")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("chapters", nargs="*", help="paths or numbers; all chapters without")
    parser.add_argument("--shifts", type=int, default=5, help="how many shifts (5)")
    parser.add_argument("--jobs", type=int, default=n_cores(), help="kernels side by side")
    parser.add_argument("--steady", action="store_true", help="one shift of the steady lessons")
    arguments = parser.parse_args()
    if arguments.shifts < 1 or arguments.jobs < 1:
        parser.error("expected at least one shift and one job")
    paths = lessons() if arguments.steady else chapters(arguments.chapters)
    shifts = [1] if arguments.steady else list(range(1, arguments.shifts + 1))
    find_fonts()
    os.environ.update(SETTINGS["own"] | {"SLAMLAB_TEXT_ONLY": "1"})
    failed = 0
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for result in pool.map(lambda path: report(path, shifts), paths):
            print(result, flush=True)
            failed += not result.steady
    print(f"{len(paths) - failed} of {len(paths)} notebooks hold on {len(shifts)} shift(s)")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
