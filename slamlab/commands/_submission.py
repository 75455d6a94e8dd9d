"""What is tried and judged of a submission: the checks of a chapter, in the teacher's process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import slamlab.exercises
from slamlab.commands._process import Gone, Process, RemoteFunction, printable
from slamlab.exercises import Check, Report

__all__ = ["Mark", "checks_of", "marked"]


def checks_of(chapter: str) -> dict[str, Check]:
    """Return the checks of a chapter, by the name of the function that each one tries."""
    names = [module.name for module in iter_modules(slamlab.exercises.__path__)]
    found = [name for name in names if name.startswith(f"ch{chapter}_")]
    if not found:
        have = ", ".join(name[2:4] for name in names if name.startswith("ch"))
        raise ValueError(f"chapter: expected one of {have}, got {chapter}")
    module = import_module(f"slamlab.exercises.{found[0]}")
    checks = [value for value in vars(module).values() if isinstance(value, Check)]
    return {check.name: check for check in checks}


@dataclass
class Mark:
    """What one submission has earned."""

    student: str
    chapter: str
    reports: dict[str, Report] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def share(self, name: str) -> float:
        """Share of the properties of one exercise that hold."""
        report = self.reports.get(name)
        return 0.0 if report is None else report.held / report.total

    @property
    def points(self) -> float:
        """One point an exercise, or the share of it."""
        return sum(self.share(name) for name in self.reports)


def marked(
    mark: Mark,
    cells: Sequence[str],
    checks: dict[str, Check],
    seconds: float,
    megabytes: int,
    folders: Sequence[Path],
) -> Mark:
    """Run one submission and judge it; whatever it does, the mark comes back, a note says why.

    Where its process ends, hangs or floods the pipe, the exercise is lost and a new process goes
    on with the next one.
    """
    process, told = None, False
    left = list(checks)
    try:
        while left:
            if process is None:
                process = Process(cells, seconds, megabytes, (), folders)
                mark.notes += [] if told else [printable(note) for note in process.notes]
                told = True
            name = left.pop(0)
            if name not in process.functions:
                continue
            process.start_clock()
            try:
                seen = checks[name].observe(RemoteFunction(process, name))
                mark.reports[name] = checks[name].judge(seen)
            except Gone as error:
                mark.notes.append(f"{name}: {str(error).removeprefix('call: ')}")
                process.__exit__()
                process = None
    except Gone as error:
        mark.notes.append(f"its cells: {str(error).removeprefix('setup: ')}")
    except Exception as error:  # one submission must not cost the others their marks
        mark.notes.append(f"could not be judged: {type(error).__name__}: {error}")
    finally:
        if process is not None:
            process.__exit__()
    mark.notes = [printable(note) for note in mark.notes]
    return mark
