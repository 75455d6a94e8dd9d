"""Sphinx extension: each class and function of the API says which line imports it.

A name is defined in a module and offered by its room; the reader should import it from the room.
"""

from __future__ import annotations

import importlib
from typing import Any


def home(name: str) -> str | None:
    """Return the shortest module that offers `slamlab.a.b.Name` under its own name, or None."""
    *path, last = name.split(".")
    if not path or path[0] != "slamlab" or any(part[0].isupper() for part in path):
        return None  # a method: its class says it
    for depth in range(2, len(path) + 1):
        module = importlib.import_module(".".join(path[:depth]))
        if last in getattr(module, "__all__", ()):
            return module.__name__
    return None


def add_import(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Put the import line before the docstring."""
    room = home(name) if what in ("class", "function", "exception") else None
    if room:
        lines[:0] = [f"``from {room} import {name.rpartition('.')[2]}``", ""]


def setup(app: Any) -> dict[str, bool]:
    """Run after numpydoc, which reads the docstring by its sections."""
    app.connect("autodoc-process-docstring", add_import, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
