"""slamlab: the estimation and SLAM algorithms of a course in which every claim is executed.

Rooms (subpackages) load when first used, so that ``import slamlab`` stays cheap:
``slamlab.geometry``, ``slamlab.filters``, ``slamlab.slam`` and so on.

Every public function refuses a wrong argument with a ValueError that names the argument, what was
expected and what came; `Raises` in a docstring names only what else can happen.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

__version__ = "1.0.0"

_ROOMS = sorted(
    path.stem
    for path in Path(__file__).parent.iterdir()
    if (path.suffix == ".py" or (path / "__init__.py").exists()) and path.stem[0] != "_"
)


def __getattr__(name: str) -> ModuleType:
    if name in _ROOMS:
        return importlib.import_module(f"{__name__}.{name}")
    for room in _ROOMS:
        door = Path(__file__).parent / room / "__init__.py"
        if not name.startswith("_") and door.exists() and f'"{name}"' in door.read_text():
            raise ImportError(f"{name} lives in slamlab.{room}: from slamlab.{room} import {name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_ROOMS])
