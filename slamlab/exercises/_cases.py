"""The older form of exercise checks, for the chapters that are not written anew yet.

A check holds a reference answer and a list of known mistakes, each a wrong function with the
message for whoever wrote it. The student's function runs on every property; where it differs
from the reference, its output is compared with what each known mistake gives there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["Mistake", "Property", "Report", "run_cases", "run_checks"]

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
    outcomes = [_try(student, item) for item in properties]
    if any(outcome.nothing for outcome in outcomes):
        return _print(title, 0, len(properties), [f"  {NOTHING_YET}"], (NOTHING_YET,))
    messages = _name_mistakes(outcomes, mistakes)
    lines = [line for outcome in outcomes for line in outcome.lines]
    lines += [f"  -> {message}" for message in messages]
    held = sum(outcome.ok for outcome in outcomes)
    return _print(title, held, len(outcomes), lines, messages)


def run_cases(
    title: str,
    student: Callable[..., Any],
    reference: Callable[..., Any],
    cases: Iterable[tuple[Any, ...]],
    mistakes: Mapping[str, Callable[..., Any]],
) -> Report:
    """Check against a reference function: the common form of an exercise.

    Parameters
    ----------
    title : str
    student, reference : callable
    cases : iterable of tuples
        The property's name, then the arguments; numbers become float arrays.
    mistakes : mapping of str to callable
        Message and wrong function of every known mistake, the most telling first.

    Returns
    -------
    Report
        Printed too.
    """
    properties = []
    for name, *arguments in cases:
        arrays = tuple(np.array(a, dtype=float) for a in arguments)
        properties.append(Property(name, arrays, reference(*_copies(arrays))))
    return run_checks(title, student, properties, [Mistake(*pair) for pair in mistakes.items()])


def _print(
    title: str, held: int, total: int, lines: list[str], messages: tuple[str, ...]
) -> Report:
    passed = held == total
    head = f"{title}: {held} of {total} properties hold" + (". Well done" if passed else "")
    text = "\n".join([head, *lines])
    print(text)
    return Report(passed, text, messages)


@dataclass(frozen=True)
class _Outcome:
    """What a student's function did on one property; `came` is None where it raised."""

    item: Property
    ok: bool
    lines: tuple[str, ...] = ()
    came: Any = None
    nothing: bool = False


def _try(student: Callable[..., Any], item: Property) -> _Outcome:
    tried = f"       tried {_show(item.arguments)}"
    try:
        came = student(*_copies(item.arguments))
    except NotImplementedError:
        return _Outcome(item, False, nothing=True)
    except Exception as error:  # a student's exception is shown, not raised
        raised = f"       your function raised {type(error).__name__}: {error}"
        return _Outcome(item, False, (f"  NO   {item.name}", tried, raised))
    if came is None or came is Ellipsis:
        return _Outcome(item, False, nothing=True)
    if _agree(came, item.expected, item.tolerance):
        return _Outcome(item, True, (f"  ok   {item.name}",), came)
    both = (f"       came  {_show(came)}", f"       due   {_show(item.expected)}")
    return _Outcome(item, False, (f"  NO   {item.name}", tried, *both), came)


def _name_mistakes(outcomes: Sequence[_Outcome], mistakes: Sequence[Mistake]) -> tuple[str, ...]:
    """Name the one mistake that explains everything that came, or else one for each failure."""
    came = [outcome for outcome in outcomes if outcome.came is not None]
    wrong = [outcome for outcome in came if not outcome.ok]
    for mistake in mistakes:
        if wrong and all(_explains(mistake, outcome) for outcome in came):
            return (mistake.message,)
    found = [_name_mistake(o.came, o.item, mistakes) for o in wrong]
    return tuple(dict.fromkeys(message for message in found if message))


def _explains(mistake: Mistake, outcome: _Outcome) -> bool:
    try:
        wrong = mistake.function(*_copies(outcome.item.arguments))
    except Exception:  # a known mistake may be undefined on these arguments
        return False
    return _agree(outcome.came, wrong, max(outcome.item.tolerance, 1e-9))


def _name_mistake(came: Any, item: Property, mistakes: Sequence[Mistake]) -> str:
    outcome = _Outcome(item, False, came=came)
    named = (mistake.message for mistake in mistakes if _explains(mistake, outcome))
    return next(named, _shape_hint(came, item.expected))


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
        and bool(np.isclose(a, b, rtol=tolerance, atol=tolerance, equal_nan=True).all())
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
