"""Grade a folder of submissions (.ipynb and .py), each in a process of its own.

Every function is tried on the inputs of its check; each exercise gives as much of a point as the
share of its properties that hold. A table goes into a CSV file and a page for each student into
the folder `feedback` beside it. Submissions that import the references, change the checks or look
into the interpreter get no points, and the note says why. Limits of time and memory keep one
submission from spoiling the others; run strangers' code in a container or a throwaway account
all the same.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slamlab.commands import _page, _submission
from slamlab.exercises import Check, Report


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the command takes."""
    parser.add_argument("folder", type=Path, help="submissions; folders in it are searched too")
    parser.add_argument("--chapter", required=True, help="two digits, as 02")
    parser.add_argument("-o", "--output", type=Path, default=Path("marks.csv"), metavar="FILE")
    parser.add_argument("--seconds", type=float, default=10.0, help="for each cell and exercise")
    parser.add_argument("--megabytes", type=int, default=2048, help="memory of a submission")
    parser.add_argument("--jobs", type=int, default=2, help="how many run at a time")


@dataclass
class Mark:
    """What one submission has earned."""

    student: str
    reports: dict[str, Report] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    refused: bool = False

    def share(self, name: str) -> float:
        """Share of the properties of one exercise that hold."""
        report = self.reports.get(name)
        return 0.0 if report is None or self.refused else report.held / report.total

    @property
    def points(self) -> float:
        """One point an exercise, or the share of it."""
        return sum(self.share(name) for name in self.reports)


def run(options: argparse.Namespace) -> None:
    """Grade, write the table and the pages, and print the table."""
    checks = _submission.checks_of(options.chapter)
    kinds = {".ipynb", ".py"}
    paths = sorted(path for path in options.folder.rglob("*") if path.suffix in kinds)
    paths = [path for path in paths if ".ipynb_checkpoints" not in path.parts]
    if not paths:
        raise ValueError(f"folder: expected .ipynb or .py files in {options.folder}, found none")
    with ThreadPoolExecutor(options.jobs) as pool:
        raw = list(pool.map(lambda path: _executed(path, options), paths))
    names = ["_".join(path.relative_to(options.folder).with_suffix("").parts) for path in paths]
    if len(set(names)) < len(names):
        names = [path.relative_to(options.folder).as_posix().replace("/", "_") for path in paths]
    marks = [_marked(name, lines, checks) for name, lines in zip(names, raw, strict=True)]
    write(marks, list(checks), options.output)
    for mark in marks:
        print(f"{mark.student:30s} {mark.points:5.2f} of {len(checks)}  {'; '.join(mark.notes)}")
    print(f"{'written to':30s} {options.output}")


def _executed(path: Path, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Run one submission; return what its process has written, line by line."""
    try:
        refused = _submission.refusals(_submission.cells_of(path))
    except (ValueError, OSError) as error:
        return [{"note": f"the file cannot be read: {error}"}]
    if refused:
        return [{"cheat": text} for text in refused]
    checks = _submission.checks_of(options.chapter)
    longest = options.seconds * (len(checks) + 3) + 60
    with tempfile.TemporaryDirectory() as place:
        output = Path(place, "observed.jsonl")
        words = [str(path.resolve()), options.chapter, str(output)]
        command = [sys.executable, "-m", "slamlab.commands._submission", *words]
        threads = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
        note = "its process ended early: what follows was not tried"
        try:
            subprocess.run(
                [*command, str(options.seconds), str(options.megabytes)],
                cwd=place,
                env={**os.environ, **threads},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=longest,
                check=False,
            )
        except subprocess.TimeoutExpired:
            note = f"its process was stopped after {longest:g} s"
        text = output.read_text(encoding="utf-8") if output.exists() else ""
    lines = [json.loads(line) for line in text.splitlines() if line.endswith("}")]
    return lines if lines and "done" in lines[-1] else [*lines, {"note": note}]


def _marked(student: str, lines: list[dict[str, Any]], checks: dict[str, Check]) -> Mark:
    """Judge what was observed."""
    mark = Mark(student)
    for line in lines:
        if "cheat" in line:
            mark.refused = True
            mark.notes.append(f"refused: {line['cheat']}")
        elif "exercise" in line and "seen" in line:
            check = checks[line["exercise"]]
            mark.reports[line["exercise"]] = check.judge(_submission.decoded(line["seen"]))
        elif "note" in line:
            where = f"{line['exercise']}: " if "exercise" in line else ""
            mark.notes.append(where + line["note"])
    return mark


def write(marks: list[Mark], exercises: list[str], output: Path) -> None:
    """Write the table and a page for each student."""
    pages = output.parent / "feedback"
    pages.mkdir(parents=True, exist_ok=True)
    with output.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["student", "points", "of", *exercises, "note"])
        for mark in marks:
            shares = [f"{mark.share(name):.2f}" for name in exercises]
            notes = "; ".join(mark.notes)
            points = f"{mark.points:.2f}"
            table.writerow([mark.student, points, len(exercises), *shares, notes])
            parts = [_page.paragraph(f"{points} of {len(exercises)} points")]
            parts += [_page.paragraph(note) for note in mark.notes]
            for name in exercises:
                report = mark.reports.get(name)
                missing = _page.paragraph(f"{name}: nothing was handed in, or it did not end")
                parts.append(report._repr_html_() if report else missing)
            text = _page.page(mark.student, *parts)
            (pages / f"{mark.student}.html").write_text(text, encoding="utf-8")
