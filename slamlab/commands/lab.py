"""Score a student's file on one of the five labs, beside the library's own systems.

The file (.py or .ipynb) defines `make(setting)`, which returns an estimator; in lab IV the
estimator has `command(view)` too, in lab II the file defines `map_room(setting, log)`, in lab V
`slam(ranges, beam_angles, odometry, covs)`. It runs in a process of its own, with limits of time
and memory, and is given step by step what a robot is given. The drives are drawn from a seed that
the score shows; the truth stays with the score. All files of a folder get the same drives, and
their scores end in a leaderboard.
"""

from __future__ import annotations

import argparse
import secrets
from functools import partial
from pathlib import Path

import numpy as np

from slamlab import exercises
from slamlab._checks import as_positive
from slamlab.commands._process import Gone, Process, cells_of, files_in
from slamlab.commands._remote import remote_system
from slamlab.exercises.lab_scores import Row, library_rows, row, scans_and_odometry, sheet
from slamlab.exercises.labs import LABS, Task, as_system_sees_it, tasks

CLOSED = {
    "I": ("slamlab.filters", "slamlab.slam", "slamlab.localization"),
    "II": ("slamlab.mapping", "slamlab.slam", "slamlab.localization"),
    "III": ("slamlab.filters", "slamlab.slam", "slamlab.localization"),
    "IV": ("slamlab.navigation",),
    "V": tuple(
        f"slamlab.{name}"
        for name in ("filters", "localization", "mapping", "matching", "navigation", "slam")
    ),
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the command takes."""
    parser.add_argument("lab", choices=LABS)
    parser.add_argument("file", type=Path, help=".py or .ipynb, or a folder of them")
    parser.add_argument("--seed", type=int, help="of the drives; drawn if left out")
    parser.add_argument("--seconds", type=float, default=120.0, help="for each drive")
    parser.add_argument("--megabytes", type=int, default=4096, help="memory of the file's process")
    parser.add_argument("--alone", action="store_true", help="beside dead reckoning only")


def run(options: argparse.Namespace) -> None:
    """Print the scores of a file, or those of a folder and a leaderboard."""
    as_positive("seconds", options.seconds, 1e6)
    as_positive("megabytes", options.megabytes, 1e6)
    files = files_in("file", options.file) if options.file.is_dir() else [options.file]
    seed = secrets.randbits(32) if options.seed is None else options.seed
    drives = tasks(options.lab, np.random.default_rng((21, seed)))
    bars = [library_rows(options.lab, task, not options.alone) for task in drives]
    board = []
    for file in files:
        name = file.name if file == options.file else str(file.relative_to(options.file))
        print(f"Lab {options.lab}: {name}, seed {seed}")
        try:
            cells = cells_of(file)
        except ValueError as error:
            if file == options.file:
                raise
            board.append((0, 0, name, str(error)))
            print(f"\n{error}\n")
            continue
        won = of = 0
        for task, bar in zip(drives, bars, strict=True):
            good, asked = sheet(options.lab, task, _yours(options, task, cells), bar)
            won, of = won + good, of + asked
        print(f"\n{won} of {of} points")
        board.append((won, of, name, ""))
    if len(files) > 1:
        print("\nLeaderboard")
        for won, of, name, note in sorted(board, key=lambda line: (-line[0], line[2])):
            print(f"  {won:3d} of {of:<3d} {name}{f'  ({note})' if note else ''}")


def _yours(options: argparse.Namespace, task: Task, cells: list[str]) -> Row:
    """Let the student's system do a drive in its own process."""
    closed = (*CLOSED[options.lab], "slamlab.commands")
    folders = [Path(exercises.__path__[0])]
    if options.file.is_dir():  # nobody reads what others have handed in
        folders.append(options.file)
    try:
        with Process(cells, options.seconds, options.megabytes, closed, folders) as process:
            if options.lab not in ("II", "V"):
                return row(options.lab, task, "you", partial(remote_system, process, task.setting))
            process.start_clock()
            if options.lab == "V":
                return row(
                    "V", task, "you", partial(process.ask, "slam", *scans_and_odometry(task.log))
                )
            log = as_system_sees_it(task.log)
            return row("II", task, "you", partial(process.ask, "map_room", task.setting, log))
    except Gone as error:
        return row(options.lab, task, "you", partial(_no_answer, str(error)))


def _no_answer(reason: str, *_: object) -> None:
    raise ValueError(reason)
