"""Packages that only some calls need."""

from __future__ import annotations

import importlib
from typing import Any


def needed(name: str, purpose: str) -> Any:
    """Import an optional package, or say what it is for and how to get it (ImportError)."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(
            f"{name} is needed for {purpose}: pip install {name}, or slamlab-course[course]"
        ) from error
