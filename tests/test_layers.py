"""The house of DESIGN section 1: no room imports from a floor above, and no cycle exists."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1] / "slamlab"
FLOORS = [
    {"_checks", "geometry", "gaussian"},
    {"worlds", "robots", "sensors"},
    {"filters", "mapping"},
    {"slam", "localization"},
    {"navigation"},
    {"evaluation", "datasets"},
    {"plots", "widgets", "exercises", "commands", "__main__"},
]
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
FACES_ONLY = {"matplotlib", "anywidget", "ipywidgets", "IPython", "matplotlib_inline"}


def room_of(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def imported(source: str) -> set[str]:
    """Names of all modules that a file imports, those inside functions included."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                names.add("." * node.level)
            else:
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def offences(room: str, source: str) -> list[str]:
    found = []
    for name in sorted(imported(source)):
        top, *rest = name.split(".")
        if name.startswith("."):
            found.append("a relative import")
        elif top == "slamlab" and rest and rest[0] in FLOOR and FLOOR[rest[0]] > FLOOR[room]:
            found.append(
                f"{room} (floor {FLOOR[room]}) imports {rest[0]} (floor {FLOOR[rest[0]]})"
            )
        elif top in FACES_ONLY and FLOOR[room] < 6:
            found.append(f"{room} (floor {FLOOR[room]}) imports {top}")
    return found


FILES = [path for path in sorted(ROOT.rglob("*.py")) if path.parent != ROOT or path.stem in FLOOR]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_room_imports_upwards(path):
    assert offences(room_of(path), path.read_text()) == []


def test_every_room_has_a_floor():
    rooms = {room_of(path) for path in ROOT.rglob("*.py")} - {"__init__"}
    assert rooms <= set(FLOOR)


def graph_of_rooms() -> dict[str, set[str]]:
    """Which room imports which other rooms."""
    graph: dict[str, set[str]] = {}
    for path in FILES:
        names = {name.split(".")[1] for name in imported(path.read_text()) if "slamlab." in name}
        graph.setdefault(room_of(path), set()).update(names & set(FLOOR) - {room_of(path)})
    return graph


def has_cycle(graph: dict[str, set[str]]) -> bool:
    left = {room: set(needs) for room, needs in graph.items()}
    while left:
        free = [room for room, needs in left.items() if not needs & set(left)]
        if not free:
            return True
        for room in free:
            del left[room]
    return False


def test_rooms_import_in_no_circle():
    assert not has_cycle(graph_of_rooms())


def test_the_guards_see_what_they_are_for():
    assert offences("geometry", "from slamlab.slam import PoseGraph")
    assert offences("slam", "def f():\n    import matplotlib.pyplot as plt")
    assert offences("slam", "from . import graph")
    assert not offences("slam", "import numpy as np\nfrom slamlab.geometry import compose")
    assert has_cycle({"filters": {"mapping"}, "mapping": {"filters"}})
