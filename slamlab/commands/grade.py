"""Grade a folder of submissions (.ipynb and .py), each in a process of its own.

Every function is tried on the inputs of its check; each exercise gives as much of a point as the
share of its properties that hold, and where one fails but most numbers of the result are right,
half of their share. A mistake counts once: a function that fails and calls others of the chapter
that fail is tried again with the right ones in their place. Functions that several students have
handed in alike are named, and cost nothing. A table goes into a CSV file and a page for each
student, with pictures, into the folder `feedback` beside it; with --roster the lines of a class
list come back with the points in columns of their own, which Moodle and Canvas import.

The process of a submission gets arguments and answers with numbers: references, checks and other
submissions are not in it, it may start no process, and limits of time and memory hold. Whatever
one submission does, the others keep their marks. Files elsewhere on the computer are as open to it
as to whoever runs the command: strangers' code belongs into a container or a throwaway account.
"""

from __future__ import annotations

import argparse
import csv
import inspect
import re
import textwrap
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import slamlab.exercises
from slamlab._checks import as_count, as_positive
from slamlab._optional import has
from slamlab.commands import _page
from slamlab.commands._copies import fingerprints, same_code
from slamlab.commands._process import cells_of, files_in, printable
from slamlab.commands._submission import Limits, Mark, checks_of, marked
from slamlab.exercises import Check

__all__ = ["arguments", "run"]

_FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what a spreadsheet would work out


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the command takes."""
    parser.add_argument("folder", type=Path, help="submissions; folders in it are searched too")
    parser.add_argument(
        "--chapter", required=True, help="two digits, as 02; several with commas, as 02,09"
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("marks.csv"), metavar="FILE")
    parser.add_argument(
        "--roster",
        type=Path,
        metavar="FILE",
        help="class list (.csv) of Moodle or Canvas; a gradebook is written beside the table",
    )
    parser.add_argument(
        "--variant",
        type=int,
        metavar="YEAR",
        help="draw more inputs: an answer fitted to those of the notebooks fails",
    )
    parser.add_argument("--no-pictures", action="store_true", help="in the feedback; it is faster")
    parser.add_argument("--seconds", type=float, default=10.0, help="for each cell and exercise")
    parser.add_argument("--megabytes", type=int, default=2048, help="memory of a submission")
    parser.add_argument("--jobs", type=int, default=2, help="how many run at a time")


def run(options: argparse.Namespace) -> None:
    """Grade, write the table and the pages, and print the table."""
    as_positive("seconds", options.seconds, 1e6)
    as_count("megabytes", options.megabytes, 1)
    as_count("jobs", options.jobs, 1)
    chapters = [chapter.strip() for chapter in options.chapter.split(",")]
    checks = {chapter: checks_of(chapter, options.variant) for chapter in chapters}
    roster = None if options.roster is None else read_roster(options.roster)
    paths = files_in("folder", options.folder)
    (options.output.parent / "feedback").mkdir(parents=True, exist_ok=True)
    # Every file is read before the first of them runs.
    names = _names([path.relative_to(options.folder) for path in paths])
    marks = [Mark(name, _chapter(path, chapters)) for name, path in zip(names, paths, strict=True)]
    files = [_read(path) for path in paths]
    folders = [Path(slamlab.exercises.__path__[0]), options.folder, options.output.parent]
    limits = Limits(options.seconds, options.megabytes, folders)
    pictures = not options.no_pictures and has("matplotlib")

    def judge(mark: Mark, cells: list[str] | str) -> Mark:
        if isinstance(cells, str):
            mark.notes.append(f"the file cannot be read: {cells}")
            return mark
        if not mark.chapter:
            mark.notes.append(f"which chapter? its name holds none of {', '.join(chapters)}")
            return mark
        return marked(mark, cells, checks[mark.chapter], limits, pictures)

    pool = ThreadPoolExecutor(options.jobs)
    try:
        marks = list(pool.map(judge, marks, files))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    _name_copies(marks, files, checks)
    write(marks, checks, options.output)
    for mark in marks:
        of, notes = len(checks.get(mark.chapter, ())), "; ".join(mark.notes)
        print(f"{mark.student:30s} {mark.points:5.2f} of {of}  {notes}")
    print(f"{'written to':30s} {options.output}")
    if roster is not None:
        book = options.output.with_name(f"{options.output.stem}-gradebook.csv")
        owners = [_labels(path.relative_to(options.folder)) for path in paths]
        missing = write_gradebook(roster, owners, marks, checks, book)
        print(f"{'gradebook':30s} {book}, {missing} of {len(roster)} without a submission")


def _name_copies(
    marks: list[Mark], files: list[list[str] | str], checks: dict[str, dict[str, Check]]
) -> None:
    """Note whose functions others have handed in too; it costs nothing."""
    for chapter, tried in checks.items():
        solutions = [inspect.getsource(check.reference) for check in tried.values()]
        known = list(
            fingerprints(
                map(textwrap.dedent, solutions),
                [check.reference.__name__ for check in tried.values()],
            ).values()
        )
        prints = {
            mark.student: fingerprints(cells, tried)
            for mark, cells in zip(marks, files, strict=True)
            if mark.chapter == chapter and not isinstance(cells, str)
        }
        for student, notes in same_code(prints, known).items():
            next(mark for mark in marks if mark.student == student).notes += notes


def _chapter(path: Path, chapters: list[str]) -> str:
    """Return the chapter that a file is of: the only one, or the one that its name holds."""
    found = [one for one in chapters if re.search(rf"(?<!\d){one}(?!\d)", path.stem)]
    return chapters[0] if len(chapters) == 1 else found[0] if len(found) == 1 else ""


def _read(path: Path) -> list[str] | str:
    """Cells of a file, or why it has none."""
    try:
        return cells_of(path)
    except (ValueError, OSError) as error:
        return printable(str(error))


def _names(paths: list[Path]) -> list[str]:
    """Give each file a name that no other has, and that a file can bear."""
    names = [printable("_".join(path.with_suffix("").parts)) for path in paths]
    if len(set(names)) < len(names):
        names = [printable(path.as_posix().replace("/", "_")) for path in paths]
    for k, name in enumerate(names):
        again = names[:k].count(name)
        names[k] = f"{name} ({again + 1})" if again else name
    return names


def write(marks: list[Mark], checks: dict[str, dict[str, Check]], output: Path) -> None:
    """Write the table, row by row, and a page for each student."""
    pages = output.parent / "feedback"
    several = len(checks) > 1
    columns = [(chapter, name) for chapter, names in checks.items() for name in names]
    titles = [f"{chapter}.{name}" if several else name for chapter, name in columns]
    with output.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file:
        table = csv.writer(file)
        table.writerow(["student", "points", "of", *titles, "note"])
        for mark in marks:
            exercises = list(checks.get(mark.chapter, ()))
            shares = [
                f"{mark.share(name):.2f}" if chapter == mark.chapter else ""
                for chapter, name in columns
            ]
            points = f"{mark.points:.2f}"
            row = [mark.student, points, len(exercises), *shares, "; ".join(mark.notes)]
            table.writerow([_harmless(entry) for entry in row])
            (pages / f"{mark.student}.html").write_text(
                feedback(mark, exercises), encoding="utf-8", errors="backslashreplace"
            )


def _harmless(entry: Any) -> Any:
    """Keep a spreadsheet from taking a text for a formula."""
    return f"'{entry}" if isinstance(entry, str) and entry.startswith(_FORMULA) else entry


def feedback(mark: Mark, exercises: list[str]) -> str:
    """Return the page of a student: points, notes, and the report of each exercise."""
    parts = [_page.paragraph(f"{mark.points:.2f} of {len(exercises)} points")]
    parts += [_page.paragraph(note) for note in mark.notes]
    for name in exercises:
        report = mark.reports.get(name)
        missing = _page.paragraph(f"{name}: nothing was handed in, or it did not end")
        parts.append(report._repr_html_() if report else missing)
        if report and 0 < report.right < 1 and not report.passed:
            parts.append(_page.paragraph(_in_part(mark.share(name), report.right)))
        if name in mark.pictures:
            parts.append(_page.picture(mark.pictures[name], f"{name}: yours, as it should be"))
    return _page.page(mark.student, *parts)


def _in_part(share: float, right: float) -> str:
    return f"{share:.2f} of 1 point, since {100 * right:.0f} % of the numbers are right everywhere"


# Class lists.


def read_roster(path: Path) -> list[dict[str, str]]:
    """Read the lines of a class list, as Moodle or Canvas exports it: by commas, or semicolons."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            head = file.readline()
            file.seek(0)
            delimiter = max(",;\t", key=head.count)
            rows = list(csv.DictReader(file, delimiter=delimiter, strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"roster: expected a table of text in {path.name} ({error})") from error
    if not rows or any(None in row or None in row.values() for row in rows):
        raise ValueError(f"roster: expected lines of equal length in {path.name}")
    return rows


def write_gradebook(
    roster: list[dict[str, str]],
    owners: list[set[str]],
    marks: list[Mark],
    checks: dict[str, dict[str, Check]],
    output: Path,
) -> int:
    """Write the class list with the points of each chapter; return how many lines have no file.

    A file is of a line if a word of its path is an entry of this line and of no other: a user
    name, an address, an ID, a full name. Of several files of a chapter the best counts. Of
    Canvas' own lines "Points Possible" gets the number of exercises; it takes no feedback.
    """
    titles = {chapter: f"slamlab {chapter} (of {len(names)})" for chapter, names in checks.items()}
    canvas = any(name.startswith("SIS ") for name in roster[0])
    keys = [_keys(line) for line in roster]
    known = Counter(key for line in keys for key in line)
    missing = 0
    with output.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file:
        more = [*titles.values()] + ([] if canvas else ["Feedback"])
        table = csv.DictWriter(file, [*roster[0], *more])
        table.writeheader()
        for line, words in zip(roster, keys, strict=True):
            own = [
                mark
                for mark, owner in zip(marks, owners, strict=True)
                if any(known[word] == 1 for word in words & owner)
            ]
            points, notes = {}, []
            for chapter, title in titles.items():
                files = [mark for mark in own if mark.chapter == chapter]
                best = max(files, key=lambda mark: mark.points, default=None)
                points[title] = "" if best is None else f"{best.points:.2f}"
                notes += [] if best is None else best.notes
            if canvas and _is_of_canvas(line):
                if "Points Possible" in " ".join(line.values()):
                    points = {
                        titles[chapter]: str(len(names)) for chapter, names in checks.items()
                    }
            else:
                missing += not own
            text = _harmless("; ".join(notes) if own else "no file")
            table.writerow(line | points | ({} if canvas else {"Feedback": text}))
    return missing


def _is_of_canvas(line: dict[str, str]) -> bool:
    """Say whether a line is one of those that Canvas writes below its head: no student's."""
    return not any(line.get(name, "").strip() for name in ("ID", "SIS User ID", "SIS Login ID"))


def _keys(line: dict[str, str]) -> set[str]:
    """Words that tell a line apart: its entries, the full name, a participant's number."""
    entries = [entry.strip() for entry in line.values()]
    names = [line.get(first, "").strip() for first in ("First name", "Last name", "Surname")]
    entries.append(" ".join(name for name in names if name))
    entries += [entry.removeprefix("Participant ") for entry in entries]
    return {entry.casefold() for entry in entries if len(entry) > 2}


def _labels(path: Path) -> set[str]:
    """Words that tell a path apart: its parts, and their pieces between underscores."""
    parts = [*path.parts[:-1], path.stem]
    return {word.casefold() for part in parts for word in (part, *part.split("_"))}
