"""The house of DESIGN section 1: nothing imports upwards, in circles or in disguise."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1] / "slamlab"
FLOORS = [
    {"kernels"},
    {"_checks", "_files", "_optional", "geometry", "gaussian"},
    {"models", "grids", "logs"},
    {"worlds", "robots", "sensors"},
    {"filters", "matching", "mapping"},
    {"slam", "localization"},
    {"navigation"},
    {"simulation", "datasets", "evaluation"},
    {"printed", "plots", "widgets", "testing", "exercises", "commands", "__main__"},
]
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
CORE = {"slamlab", "numpy", "scipy"}  # what every import of a core room may need
COURSE = {"plots", "widgets", "exercises"}  # subpackages that need an extra
# What makes a subpackage faster where it is installed, and only there.
FAST = {"kernels": {"numba"}, "slam": {"qdldl"}}
# What a core room may ask for inside a function, where it says which extra is missing.
LATE = {
    "kernels": {"importlib"},  # a kernel is imported when it is first called
    "_optional": {"importlib"},  # the one door to packages of an extra
    "commands": {"importlib", "pkgutil", "matplotlib", "sys"},
}
SNEAKS = {"importlib", "imp", "pkgutil", "runpy"}
FILES = [path for path in sorted(ROOT.rglob("*.py")) if path != ROOT / "__init__.py"]


def room_of(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def imports(source: str) -> list[tuple[str, bool]]:
    """Full names of everything a file imports, and whether it does so at the top of the file."""
    tree, found = ast.parse(source), []
    inside = {
        child
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for child in ast.walk(function)
    }
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            start = "." * node.level + (node.module or "")
            names = [f"{start}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Name) and node.id == "__import__":
            names = ["__import__"]
        elif isinstance(node, ast.Attribute) and ast.unparse(node) == "sys.modules":
            names = ["sys.modules"]
        found += [(name, node not in inside) for name in names]
    return found


def offence(room: str, name: str, at_top: bool) -> str | None:
    """What is wrong with a room importing a name, or None."""
    top, *rest = name.split(".")
    where = f"{room} (floor {FLOOR[room]}) imports {name}"
    if name.startswith("."):
        return f"{where}: a relative import"
    if top == "slamlab":
        other = rest[0] if rest else ""
        if other == "__version__":
            return None
        if other not in FLOOR:
            return f"{where}: name the room"
        if FLOOR[other] > FLOOR[room]:
            return f"{where} of floor {FLOOR[other]}"
        if other != room and any(part.startswith("_") for part in rest[1:]):
            return f"{where}, which is private to {other}"
        if other == "printed" and room not in {"printed", "exercises"}:
            return f"{where}: a formula that is refuted"
        return None
    if name in {"__import__", "sys.modules"} or (
        top in SNEAKS and not name.startswith("importlib.resources")
    ):
        return None if top in LATE.get(room, ()) else f"{where}: an import in disguise"
    own = top in sys.stdlib_module_names or top in CORE or room in COURSE
    own = own or top in FAST.get(room, ())
    late = not at_top and top in LATE.get(room, ())
    return None if own or late else f"{where}, no core dependency"


def offences(room: str, source: str) -> list[str]:
    found = [offence(room, name, at_top) for name, at_top in imports(source)]
    return [text for text in found if text]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_import_is_allowed(path):
    assert offences(room_of(path), path.read_text()) == []


def test_every_room_has_a_floor():
    assert {room_of(path) for path in FILES} <= set(FLOOR)


# Circles: of rooms, and of modules inside a room, however late the import.


def graph(sources: dict[str, str]) -> dict[str, set[str]]:
    """Which module imports which other modules, of sources by full module name."""
    needs: dict[str, set[str]] = {}
    for module, source in sources.items():
        names = {name for name, _ in imports(source)}
        names |= {name.rpartition(".")[0] for name in names - set(sources)}
        needs[module] = names & set(sources) - {module}
    return needs


def by_room(needs: dict[str, set[str]]) -> dict[str, set[str]]:
    rooms: dict[str, set[str]] = {}
    for module, others in needs.items():
        room = module.split(".")[1]
        rooms.setdefault(room, set()).update({o.split(".")[1] for o in others} - {room})
    return rooms


def circle(needs: dict[str, set[str]]) -> set[str]:
    """Return the nodes that stand in or above a circle: empty if there is none."""
    left = dict(needs)
    while free := [node for node, others in left.items() if not others & set(left)]:
        for node in free:
            del left[node]
    return set(left)


SOURCES = {
    ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(
        ".__init__"
    ): path.read_text()
    for path in FILES
}


def test_modules_import_in_no_circle():
    assert circle(graph(SOURCES)) == set()


def test_rooms_import_in_no_circle():
    assert circle(by_room(graph(SOURCES))) == set()


# What really happens when the library is imported.


def run(code: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def loaded(module: str) -> list[str]:
    names = run(f"import {module}, sys; print(*sys.modules)").split()
    return [name for name in names if name.startswith("slamlab.") or name == "numpy"]


def test_import_slamlab_loads_no_room_and_no_numpy():
    assert loaded("slamlab") == []
    assert {"numpy", "slamlab._checks"} <= set(loaded("slamlab.geometry"))


BARE = """
import importlib, sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] not in {allowed} | set(sys.stdlib_module_names):
            raise ImportError(name + " is in no core dependency")

import numpy, scipy.special  # what they import themselves is their own affair
sys.meta_path.insert(0, Refuse())
for module in {modules}:
    importlib.import_module(module)
print("imported", len({modules}))
"""


def bare(modules: list[str]) -> str:
    """Import modules where only the core dependencies are installed."""
    return run(BARE.replace("{allowed}", repr(CORE)).replace("{modules}", repr(modules)))


def test_every_core_room_imports_where_only_the_core_is_installed():
    modules = [name for name in SOURCES if name.split(".")[1] not in COURSE]
    assert bare(modules) == f"imported {len(modules)}\n"


def test_the_bare_machine_has_no_matplotlib():
    with pytest.raises(AssertionError, match="matplotlib.* is in no core dependency"):
        bare(["slamlab.plots"])


# Each guard, seen to refuse what it is for.

OFFENCES = {
    "upwards": ("geometry", "from slamlab.slam import PoseGraph"),
    "upwards, inside a function": ("sensors", "def f():\n    from slamlab.slam import EKFSlam"),
    "upwards, the room itself": ("filters", "from slamlab import slam"),
    "upwards, by a module's name": ("worlds", "import slamlab.slam.graph as g"),
    "upwards, star": ("robots", "from slamlab.filters import *"),
    "upwards, only for types": (
        "robots",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import slamlab.slam",
    ),
    "relative": ("slam", "from . import graph"),
    "relative, upwards": ("slam", "from ..navigation import explore"),
    "by lazy attribute": ("navigation", "import slamlab\nx = slamlab.slam.PoseGraph"),
    "by lazy attribute, renamed": ("navigation", "import slamlab as s\nx = s.slam.PoseGraph"),
    "by importlib": ("robots", "import importlib\nimportlib.import_module('slamlab.slam')"),
    "by import_module": ("robots", "from importlib import import_module"),
    "by __import__": ("robots", "__import__('slamlab.slam')"),
    "by sys.modules": ("robots", "import sys\nslam = sys.modules['slamlab.slam']"),
    "a figure below": ("slam", "def f():\n    import matplotlib.pyplot as plt"),
    "numba outside the kernels": ("slam", "import numba"),
    "a kernel that knows the library": ("kernels", "from slamlab.geometry import compose"),
    "sympy": ("slam", "import sympy"),
    "sympy, inside a function": ("slam", "def f():\n    import sympy"),
    "filterpy": ("filters", "from filterpy.kalman import KalmanFilter"),
    "anywidget": ("simulation", "import anywidget"),
    "an extra too early": ("datasets", "import rosbags"),
    "an extra too early, in a try": ("evaluation", "try:\n    import joblib\nexcept E:\n    pass"),
    "an extra in a printed formula": ("printed", "import sympy"),
    "private module of another room": ("navigation", "from slamlab.slam._edges import Edges"),
    "private name of another room": ("navigation", "from slamlab.slam.graph import _solve"),
    "private module, from the room": ("navigation", "from slamlab.slam import _edges"),
    "a refuted formula": ("plots", "from slamlab.printed.p5 import turn_as_printed"),
    "a refuted formula, the room": ("widgets", "from slamlab import printed"),
    "without a room": ("slam", "from slamlab import EKFSlam"),
}
FINE = [
    ("slam", "import numpy as np\nfrom slamlab.geometry import compose"),
    ("slam", "from slamlab.slam._edges import Edges"),
    ("slam", "from slamlab._checks import as_array"),
    ("commands", "def f():\n    import matplotlib"),
    ("exercises", "import matplotlib\nfrom slamlab.printed.p5 import turn_as_printed"),
    ("widgets", "from importlib import resources"),
]


@pytest.mark.parametrize(("room", "source"), OFFENCES.values(), ids=OFFENCES.keys())
def test_a_guard_refuses(room, source):
    assert offences(room, source)


@pytest.mark.parametrize(("room", "source"), FINE)
def test_a_guard_accepts(room, source):
    assert offences(room, source) == []


def test_a_circle_is_seen_inside_a_room_and_between_rooms():
    late = {
        "slamlab.slam.ekf": "def f():\n    from slamlab.slam.association import g",
        "slamlab.slam.association": "from slamlab.slam.ekf import EKFSlam",
    }
    assert circle(graph(late)) == set(late)
    by_the_door = {"slamlab.slam": "from slamlab.slam.ekf import E", "slamlab.slam.ekf": ""}
    assert circle(graph(by_the_door)) == set()
    assert circle(graph({**by_the_door, "slamlab.slam.ekf": "from slamlab.slam import E"}))
    rooms = {
        "slamlab.filters.a": "import slamlab.mapping.a",
        "slamlab.mapping.b": "import slamlab.filters.b",
        "slamlab.filters.b": "",
        "slamlab.mapping.a": "",
    }
    assert circle(graph(rooms)) == set()
    assert circle(by_room(graph(rooms))) == {"filters", "mapping"}
