"""Packages that only some functions need: imported where they are used, or named in a sentence."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

__all__ = ["has", "needed", "with_bar"]

Thing = TypeVar("Thing")


Report = Callable[[int, int], object]


def with_bar(
    things: Iterable[Thing], wanted: bool | Report, total: int, unit: str
) -> Iterable[Thing]:
    """Go over things, with a progress bar if one is wanted (ImportError without tqdm).

    A function in place of True is called with how many are done and how many there are.
    """
    if isinstance(wanted, type):
        raise ValueError(f"progress: expected True, False or a function, got {wanted.__name__}")
    if callable(wanted):
        return _counted(things, wanted, total)
    if not wanted:
        return things
    bar: Iterable[Thing] = needed("tqdm", "a progress bar").tqdm(things, total=total, unit=unit)
    return bar


def _counted(things: Iterable[Thing], report: Report, total: int) -> Iterator[Thing]:
    for done, thing in enumerate(things, start=1):
        yield thing
        report(done, total)


def has(name: str) -> bool:
    """Say whether a module is installed."""
    return importlib.util.find_spec(name) is not None


def needed(name: str, purpose: str, extra: str = "course", package: str = "") -> Any:
    """Import a module, or say what it is for and how to get it (ImportError)."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = package or name
        raise ImportError(
            f"{package} is needed for {purpose}: pip install {package}, or slamlab-course[{extra}]"
        ) from error
