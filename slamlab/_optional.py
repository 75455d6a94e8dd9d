"""Packages that only some functions need: imported where they are used, or named in a sentence."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from typing import Any, TypeVar

__all__ = ["needed", "with_bar"]

Thing = TypeVar("Thing")


def with_bar(things: Iterable[Thing], wanted: bool, total: int, unit: str) -> Iterable[Thing]:
    """Go over things, with a progress bar if one is wanted (ImportError without tqdm)."""
    if not wanted:
        return things
    bar: Iterable[Thing] = needed("tqdm", "a progress bar").tqdm(things, total=total, unit=unit)
    return bar


def needed(name: str, purpose: str, extra: str = "course", package: str = "") -> Any:
    """Import a module, or say what it is for and how to get it (ImportError)."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = package or name
        raise ImportError(
            f"{package} is needed for {purpose}: pip install {package}, or slamlab-course[{extra}]"
        ) from error
