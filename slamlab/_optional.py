"""Packages that only some functions need: imported where they are used, or named in a sentence."""

from __future__ import annotations

import importlib
from typing import Any

__all__ = ["needed"]


def needed(name: str, purpose: str, extra: str = "course", package: str = "") -> Any:
    """Import a module, or say what it is for and how to get it (ImportError)."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = package or name
        raise ImportError(
            f"{package} is needed for {purpose}: pip install {package}, or slamlab-course[{extra}]"
        ) from error
