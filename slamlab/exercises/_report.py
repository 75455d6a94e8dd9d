"""Exercise checks that test properties and name the mistake.

A check holds a reference answer and a list of known mistakes, each a wrong function with the
message for whoever wrote it. The student's function runs on every property; where it differs
from the reference, its output is compared with what each known mistake gives there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["Mistake", "Property", "Report", "run_checks"]

NOTHING_YET = "nothing returned yet: replace the `...` by your own lines and run the cell again"


@dataclass(frozen=True)
class Property:
    """One thing that a right answer has: on these arguments it gives this result.

    Parameters
    ----------
    name : str
        A sentence, such as "the heading difference is wrapped".
    arguments : tuple
        What the student's function is called with. Arrays are copied for every call.
    expected : object
        What is due: a number, an array, a Gaussian (anything with `mean` and `cov`), or a tuple
        or list of these.
    tolerance : float, default 1e-9
        Largest absolute difference, relative to 1 + the size of the expected entry.
    """

    name: str
    arguments: tuple[Any, ...]
    expected: Any
    tolerance: float = 1e-9


@dataclass(frozen=True)
class Mistake:
    """A wrong answer that students write, and what to tell them."""

    message: str
    function: Callable[..., Any]


@dataclass(frozen=True)
class Report:
    """Outcome of a check.

    Attributes
    ----------
    passed : bool
        True if every property holds.
    text : str
        The lines that were printed.
    messages : tuple of str
        Messages of the mistakes that were recognised, each once.
    """

    passed: bool
    text: str
    messages: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return one stable line."""
        return f"<Report: {'passed' if self.passed else 'not passed yet'}>"

    def _ipython_display_(self) -> None:
        """Show nothing: the lines were printed already."""


def run_checks(
    title: str,
    student: Callable[..., Any],
    properties: Sequence[Property],
    mistakes: Sequence[Mistake] = (),
) -> Report:
    """Try a student's function on every property and print one line for each.

    Parameters
    ----------
    title : str
        Name of the exercise, first word of the report.
    student : callable
        The function under test. Whatever it raises is shown, never raised on.
    properties : sequence of Property
    mistakes : sequence of Mistake
        Known wrong answers, the most telling first.

    Returns
    -------
    Report
        Also printed.
    """
    lines: list[str] = []
    messages: list[str] = []
    held = 0
    for item in properties:
        ok, said, message = _try(student, item, mistakes)
        held += ok
        lines += said
        if message == NOTHING_YET:
            lines = [f"  {NOTHING_YET}"]
            messages = [NOTHING_YET]
            break
        if message and message not in messages:
            messages.append(message)
            lines.append(f"       -> {message}")
    passed = held == len(properties)
    head = f"{title}: {held} of {len(properties)} properties hold"
    text = "\n".join([head + (". Well done" if passed else ""), *lines])
    print(text)
    return Report(passed, text, tuple(messages))


def _try(
    student: Callable[..., Any], item: Property, mistakes: Sequence[Mistake]
) -> tuple[bool, list[str], str]:
    """Return whether the property holds, the lines to print, and the mistake's message."""
    try:
        came = student(*_copies(item.arguments))
    except Exception as error:  # a student's exception is shown, not raised
        if isinstance(error, NotImplementedError):
            return False, [], NOTHING_YET
        lines = [
            f"  NO   {item.name}",
            f"       tried {_show(item.arguments)}",
            f"       your function raised {type(error).__name__}: {error}",
        ]
        return False, lines, ""
    if came is None or came is Ellipsis:
        return False, [], NOTHING_YET
    if _agree(came, item.expected, item.tolerance):
        return True, [f"  ok   {item.name}"], ""
    lines = [
        f"  NO   {item.name}",
        f"       tried {_show(item.arguments)}",
        f"       came  {_show(came)}",
        f"       due   {_show(item.expected)}",
    ]
    return False, lines, _name_mistake(came, item, mistakes)


def _name_mistake(came: Any, item: Property, mistakes: Sequence[Mistake]) -> str:
    for mistake in mistakes:
        try:
            wrong = mistake.function(*_copies(item.arguments))
        except Exception:  # a known mistake may be undefined on these arguments
            continue
        if _agree(came, wrong, max(item.tolerance, 1e-9)):
            return mistake.message
    return _shape_hint(came, item.expected)


def _shape_hint(came: Any, expected: Any) -> str:
    pairs = _pairs(came, expected)
    if isinstance(pairs, str):
        return pairs
    for a, b in pairs:
        if a.shape != b.shape:
            return f"a result has shape {a.shape}, due is {b.shape}"
        if not np.isfinite(a).all() and np.isfinite(b).all():
            return "a result holds NaN or infinity"
    return ""


def _agree(came: Any, expected: Any, tolerance: float) -> bool:
    pairs = _pairs(came, expected)
    if isinstance(pairs, str):
        return False
    return all(
        a.shape == b.shape
        and bool(np.all(np.abs(a - b) <= tolerance * (1 + np.abs(b))) or np.array_equal(a, b))
        for a, b in pairs
    )


def _pairs(came: Any, expected: Any) -> list[tuple[np.ndarray, np.ndarray]] | str:
    """Pair what came with what was due, axes of length one dropped; a str says why it fails.

    Lists count as arrays, and a tuple of rows counts as the array of these rows and back.
    """
    due = _parts(expected)
    parts = _parts(came)
    if due is None or parts is None:
        return "the result is not made of numbers"
    if len(parts) != len(due):
        try:
            parts = [np.asarray(came, float)] if len(due) == 1 else [np.asarray(c) for c in came]
        except (TypeError, ValueError):
            pass
    if len(parts) != len(due):
        return f"{len(due)} results are due, {len(parts)} came"
    return [(np.squeeze(a), np.squeeze(b)) for a, b in zip(parts, due, strict=True)]


def _parts(value: Any) -> list[np.ndarray] | None:
    """Flatten a result into arrays; None if it is not made of numbers."""
    if hasattr(value, "mean") and hasattr(value, "cov") and not isinstance(value, np.ndarray):
        return [np.asarray(value.mean, float), np.asarray(value.cov, float)]
    if not isinstance(value, tuple):
        try:
            return [np.asarray(value, dtype=float)]
        except (TypeError, ValueError):
            if not isinstance(value, list):
                return None
    parts = [_parts(entry) for entry in value]
    if any(part is None for part in parts):
        return None
    return [array for part in parts if part is not None for array in part]


def _copies(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(a.copy() if isinstance(a, np.ndarray) else a for a in arguments)


def _show(value: Any) -> str:
    if hasattr(value, "mean") and hasattr(value, "cov") and not isinstance(value, np.ndarray):
        return f"mean {_show(value.mean)}, cov {_show(value.cov)}"
    if isinstance(value, tuple):
        return ", ".join(_show(entry) for entry in value)
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return repr(value)
    if array.size > 40:
        return f"array of shape {array.shape}"
    return str(np.round(array, 4).tolist()).replace("-0.0,", "0.0,").replace("-0.0]", "0.0]")
