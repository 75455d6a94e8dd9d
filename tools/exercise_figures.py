"""What the exercises show: how many, mutants refused, strangers passed and named, variants.

    python tools/exercise_figures.py              the table of all chapters
    python tools/exercise_figures.py 02 09        of these chapters
    python tools/exercise_figures.py --quick      without mutants, which take some minutes

Right answers written differently and the grading of sixty submissions are tests: `pytest
tests/exercises -k another_right`, `pytest tests/commands/test_grade_command.py --durations=1`.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tools"), str(ROOT / "tests" / "exercises")]

import mutate  # noqa: E402
import test_checks  # noqa: E402
import test_strangers  # noqa: E402


def strangers(chapter: str) -> list[int]:
    """Count answers of strangers: all, passed, named rightly, named wrongly."""
    counts = [0, 0, 0, 0]
    for name, said, code in test_strangers.ROWS:
        if name[2:4] != chapter:
            continue
        passed, named = test_strangers.answered(name, code)
        pieces = [piece.strip() for piece in said.split("/")]
        right = any(piece in named for piece in pieces if piece != "-")
        counts[0] += 1
        counts[1] += passed
        counts[2] += bool(named and right)
        counts[3] += bool(named and not right)
    return counts


def mutants(chapter: str) -> list[int]:
    """Count mutants: all, equivalent ones, and those that pass though they change an answer."""
    known, counts = mutate.equivalent(), [0, 0, 0]
    for solution in mutate.solutions([chapter]):
        total, passed = mutate.try_all(solution)
        same = sum(f"{solution.name} | {text}" in known for text in passed)
        counts = [counts[0] + total, counts[1] + same, counts[2] + len(passed) - same]
    return counts


def main(words: list[str]) -> int:
    """Print the table; the exit code is 1 if anything passes or is named wrongly."""
    chosen = [word for word in words if not word.startswith("-")]
    chapters = sorted({name[2:4] for name in test_checks.CHECKS})
    print("chapter  exercises  strangers passed rightly wrongly  mutants equivalent passed")
    sums = [0] * 8
    for chapter in chosen or chapters:
        n = sum(name[2:4] == chapter for name in test_checks.CHECKS)
        tried = [0, 0, 0] if "--quick" in words else mutants(chapter)
        row = [n, *strangers(chapter), *tried]
        sums = [a + b for a, b in zip(sums, row, strict=True)]
        print(_line(chapter, row), flush=True)
    print(_line("all", sums))
    return int(sums[2] + sums[4] + sums[7] > 0)


def _line(name: str, row: list[int]) -> str:
    widths = (10, 10, 7, 8, 8, 9, 11, 7)
    return f"{name:7s}" + "".join(f"{v:{w}d}" for v, w in zip(row, widths, strict=True))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
