"""The API pages list every public module of the library, and no module that is gone."""

import importlib.util
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = "\n".join(path.read_text() for path in sorted((ROOT / "book" / "api").glob("*.md")))
LISTED = set(re.findall(r"automodule:: (\S+)", PAGE))
CLASSES = set(re.findall(r"autoclass:: (\S+)", PAGE))


def public_modules():
    """Names of the modules without a leading underscore; exercise checks have their chapter."""
    for path in sorted((ROOT / "slamlab").rglob("*.py")):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        if not path.stem.startswith("_") and ".exercises." not in name:
            yield name


def covered(name):
    """Whether the page has the module, or the class that the module `x.replay` is for."""
    room, _, last = name.rpartition(".")
    return name in LISTED or f"{room}.{last.title()}" in CLASSES


def test_every_public_module_is_on_the_api_page():
    assert [name for name in public_modules() if not covered(name)] == []
    assert not covered("slamlab.filters.nobody_wrote_this")


def test_every_module_on_the_api_page_exists():
    assert [name for name in LISTED if importlib.util.find_spec(name) is None] == []
