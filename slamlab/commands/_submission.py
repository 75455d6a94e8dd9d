"""What is tried and judged of a submission: the checks of a chapter, in the teacher's process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from threading import Lock
from types import CodeType
from typing import Any

import slamlab.exercises
from slamlab.commands._page import png_of
from slamlab.commands._process import Gone, Process, RemoteFunction, printable
from slamlab.exercises import Check, Report

__all__ = ["Limits", "Mark", "checks_of", "marked"]

_DRAWING = Lock()
_SECONDS_TO_DRAW = 30.0  # of the teacher's process, beside those of the submission
_TIMES_AGAIN = 5.0  # as long where each call of a right function goes through two pipes


def checks_of(chapter: str, variant: int | None = None) -> dict[str, Check]:
    """Return the checks of a chapter, by the name of the function that each one tries.

    With a `variant` they draw inputs that the notebooks do not have.
    """
    names = [module.name for module in iter_modules(slamlab.exercises.__path__)]
    found = [name for name in names if name.startswith(f"ch{chapter}_")]
    if not found:
        have = ", ".join(name[2:4] for name in names if name.startswith("ch"))
        raise ValueError(f"chapter: expected one of {have}, got {chapter}")
    module = import_module(f"slamlab.exercises.{found[0]}")
    checks = [value for value in vars(module).values() if isinstance(value, Check)]
    if variant is not None:
        checks = [check.of_variant(variant) for check in checks]
    return {check.name: check for check in checks}


@dataclass
class Mark:
    """What one submission has earned."""

    student: str
    chapter: str
    reports: dict[str, Report] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    pictures: dict[str, bytes] = field(default_factory=dict)

    def share(self, name: str) -> float:
        """Give what one exercise is worth, 0 to 1."""
        report = self.reports.get(name)
        return 0.0 if report is None else report.share

    @property
    def points(self) -> float:
        """One point an exercise, or the share of it."""
        return sum(self.share(name) for name in self.reports)


@dataclass(frozen=True)
class Limits:
    """What the process of a submission may take, and the folders in which it may open nothing."""

    seconds: float
    megabytes: int
    folders: Sequence[Path] = ()

    def start(self, cells: Sequence[str]) -> Process:
        """Start the process of a submission."""
        return Process(cells, self.seconds, self.megabytes, folders=self.folders)


def marked(
    mark: Mark,
    cells: Sequence[str],
    checks: dict[str, Check],
    limits: Limits,
    pictures: bool = False,
) -> Mark:
    """Run one submission and judge it; whatever it does, the mark comes back, a note says why.

    Where its process ends, hangs or floods the pipe, the exercise is lost and a new process goes
    on with the next one. A mistake counts once: where an exercise fails that calls functions of
    others which fail, it is judged again with the right ones in their place.
    """
    process, noted = None, False
    left, raised = list(checks), dict[str, str]()
    try:
        while left:
            if process is None:
                process = limits.start(cells)
                mark.notes += [] if noted else [printable(note) for note in process.notes]
                noted = True
            name = left.pop(0)
            if name not in process.functions:
                continue
            process.start_clock()
            try:
                seen = checks[name].observe(RemoteFunction(process, name))
                mark.reports[name] = checks[name].judge(seen)
                raised |= {name: seen[0].raised} if all(one.raised for one in seen) else {}
                if pictures and checks[name].has_picture:
                    mark.pictures[name] = _drawn(checks[name], process)
            except Gone as error:
                mark.notes.append(f"{name}: {str(error).removeprefix('call: ')}")
                process.__exit__()
                process = None
        _judge_again(mark, cells, checks, limits)
        mark.notes += _reasons(mark, raised, checks)
    except Gone as error:
        mark.notes.append(f"its cells: {str(error).removeprefix('setup: ')}")
    except Exception as error:  # one submission must not cost the others their marks
        mark.notes.append(f"could not be judged: {type(error).__name__}: {error}")
    finally:
        if process is not None:
            process.__exit__()
    mark.notes = [printable(note) for note in mark.notes]
    return mark


def _reasons(mark: Mark, raised: dict[str, str], checks: dict[str, Check]) -> list[str]:
    """Say why there are no points, where no note says so yet."""
    zero = [name for name in raised if not mark.share(name)]
    notes = [f"{name}: raised on every input, first {raised[name]}" for name in zero]
    if mark.notes or notes:
        return notes
    if not mark.reports:
        return [f"defines none of {', '.join(checks)}"]
    if mark.points:
        return []
    said = [f"{name}: {', '.join(mark.reports[name].messages)}" for name in mark.reports]
    return [one if one[-2:] != ": " else f"{one}nothing holds" for one in said]


def _drawn(check: Check, process: Process) -> bytes:
    """Return what `check.draw` shows, as PNG. One at a time: matplotlib knows no threads."""
    process.stop_clock()
    with _DRAWING:
        process.start_clock(process.seconds + _SECONDS_TO_DRAW)
        try:
            figure = check.draw(RemoteFunction(process, check.name))
        except Gone as error:
            raise Gone("call: its picture could not be finished") from error
        process.stop_clock()
        return png_of(figure)


def _judge_again(
    mark: Mark, cells: Sequence[str], checks: dict[str, Check], limits: Limits
) -> None:
    """Judge what fails and calls what fails once more, with the right functions in place.

    They are worked out in a process of their own: neither the submission nor the teacher's
    process runs them.
    """
    wrong = {name for name in checks if name not in mark.reports or mark.share(name) < 1}
    again = {name: sorted(_called(checks[name]) & (wrong - {name})) for name in mark.reports}
    again = {name: right for name, right in again.items() if right and name in wrong}
    if not again:
        return
    with _references(checks, limits) as reference:
        for name, right in again.items():
            try:
                with limits.start(cells) as process:
                    process.reference = partial(_only, right, reference)
                    process.start_clock(_TIMES_AGAIN * limits.seconds)
                    seen = checks[name].observe(RemoteFunction(process, name, right))
            except Gone as error:
                said = str(error).removeprefix("call: ")
                mark.notes.append(f"{name}: not judged with the right {', '.join(right)}: {said}")
                continue
            report, before = checks[name].judge(seen), mark.share(name)
            if report.held > mark.reports[name].held:
                mark.reports[name] = report
                mark.notes.append(
                    f"{name}: {before:.2f}, and {mark.share(name):.2f} with the right "
                    f"{', '.join(right)}, which counts"
                )


def _only(right: Sequence[str], reference: Callable[..., Any], name: str, *given: Any) -> Any:
    """Work out these functions, and never the one that is judged."""
    if name not in right:
        raise ValueError(f"{name}: your own function is asked here")
    return reference(name, *given)


@contextmanager
def _references(checks: dict[str, Check], limits: Limits) -> Iterator[Callable[..., Any]]:
    """Give a function that works out what the reference of an exercise returns."""
    imports = [
        f"from {check.reference.__module__} import {check.reference.__name__} as {name}"
        for name, check in checks.items()
    ]
    cells = ["\n".join(imports)]
    with Process(cells, limits.seconds, limits.megabytes, answers=True) as process:

        def work_out(name: str, given: Sequence[Any], named: dict[str, Any]) -> Any:
            place = [one.name for one in checks[name].parameters]
            more = [named[key] for key in place[len(given) :]]
            process.start_clock()
            try:
                return RemoteFunction(process, name)(*given, *more)
            except Gone as error:
                raise ValueError(str(error)) from error

        yield work_out


def _called(check: Check) -> set[str]:
    """Names that the reference of an exercise uses, in functions inside it too."""
    found: set[str] = set()
    codes = [check.reference.__code__]
    while codes:
        code = codes.pop()
        found |= set(code.co_names)
        codes += [one for one in code.co_consts if isinstance(one, CodeType)]
    return found
