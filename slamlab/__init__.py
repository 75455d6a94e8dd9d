"""slamlab: the estimation and SLAM algorithms of a course in which every claim is executed.

Rooms (subpackages) load when first used, so that ``import slamlab`` stays cheap:
``slamlab.geometry``, ``slamlab.filters``, ``slamlab.slam`` and so on.
"""

from __future__ import annotations

import importlib
from types import ModuleType

__version__ = "0.1.0"

_ROOMS = (
    "geometry",
    "gaussian",
    "worlds",
    "robots",
    "sensors",
    "filters",
    "mapping",
    "slam",
    "localization",
    "navigation",
    "evaluation",
    "datasets",
    "plots",
    "widgets",
    "exercises",
    "commands",
)


def __getattr__(name: str) -> ModuleType:
    if name in _ROOMS:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_ROOMS])
