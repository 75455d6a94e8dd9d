"""Names are those of the papers, *Probabilistic Robotics*, GTSAM, Open3D, Nav2; old ones stay out.

CHANGELOG.md has the table old -> new.
"""

import ast
import json
import pkgutil
import re
from pathlib import Path

import pytest

from tests.test_notebooks import LESSONS

ROOT = Path(__file__).resolve().parents[1]
# Names that no identifier may bear any more, whatever it stands for.
GONE = {
    "remove_unseen", "unseen_for", "sightings", "Correction", "BatchInnovation", "LocalRange",
    "initial_guess", "alternatives", "rival", "rival_distance", "Outline", "PointField",
    "of_log_odds", "lost_scans", "SeenFloor", "seen_floor", "Ways", "shut_near", "unseen_area",
    "RoomDriver", "Guard", "Homer", "Retracer", "Truth", "BELIEFS", "BUILDINGS", "WAYS",
    "COVERED", "WornWheels", "looks", "as_a", "good_points", "detection",
    "restored_on_failure", "as_complex", "as_root", "touching", "climbed", "ascend", "witnessed",
    "_ground", "_started", "_slopes", "_stretches", "_enrol", "STRIDE", "AROUND",
}  # fmt: skip
# Names that were those of one class: they are none of its attributes, methods or parameters.
MEMBERS = {
    "Log": {"looks"},
    "EKFSlam": {"sightings", "unseen_for", "remove_unseen"},
    "Innovation": {"residual", "cov"},
    "FilterResult": {"residuals"},
    "CompressedEKFSlam": {"settle", "enter", "near", "regions"},
    "IncrementalGraph": {"settle"},
    "AdaptiveRange": {"wanted", "nearest", "furthest", "reach", "region"},
    "FastSlam": {"detection", "columns", "started"},
    "PoseGraph": {"initial_guess"},
    "Result": {"rejected"},
    "Match": {"rival", "residual", "weakest"},
    "PointsWithNormals": {"of", "moved", "walls", "joined", "turned"},
    "ExplorationGrid": {"shut", "shut_near", "fits", "ways", "route", "unseen_area"},
    "ShortestPaths": {"fits"},
    "CoveragePilot": {"sight", "again", "past"},
    "Building": {"sight"},
    "CollisionGuard": {"limited", "away", "wish"},
    "ReturnPilot": {"way", "past", "relaid"},
    "Run": {"kept"},
    "ScanGraphSlam": {"_ground", "_tie", "_tied", "_tried", "_stretch"},
}
# Words of a choice.
CHOICES = {"latest", "stretch"}
# Constants, functions and classes of the scan graph that had words of our own.
SCAN_GRAPH = {
    "BASE", "FIT", "ELSEWHERE", "SLIDE", "SPAN", "WHEELS", "RIVAL", "STRIDE", "LOOP", "AROUND",
    "SURE", "SECOND", "FLOOR", "FALSE", "NEAR", "BAD_FIT", "BETTER", "LEAST_PAIRS", "LEAST_PART",
    "LEAST_WEIGHT", "WIDE", "THIN", "ENOUGH", "SAME", "Tie", "against_chain", "consistent",
}  # fmt: skip
# Functions, parameters and variables that had English words for names, which others may bear.
FUNCTIONS = {
    "matching": {"thin", "normals", "Field"},
    "matching.field": {"stamp"},
    "kernels.field": {"stamp"},
    "kernels.correlative": {"doubled", "shut", "_far"},
    "kernels.grid_fast": {"climb", "lay"},
    "slam.grid_fast": {"climb", "lay"},
    "slam.certificate": {"raised", "turned"},
    "slam.pose_graph": {"corrected"},
    "slam.linearisation": {"carried", "corrected", "shear", "turned"},
    "slam.fast": {"_rolled", "roll", "Drawn", "root"},
    "slam._particle_association": {"root"},
    "navigation.exploration_grid": {"eye"},
    "kernels.floor": {"eye"},
    "gaussian": {"root"},
}
# Words of prose for which the field has others: uncertainty, expected, given, grid, overconfident,
# second-best match, consistent closure, outlier. They stay out of the chapters written as lessons
# (tests/test_notebooks.py), of their second pages, exercises and solutions, of the other pages
# and of docstrings.
PROSE = re.compile(
    r"\b(doubts?|doubtful|in doubt|witness(es)?|rivals?|shy|kinder|kindest|sheets?|told(?! apart)"
    r"|surer|too sure|liars?|crutch|dearest|comb|teeth|ghosts?|(is|are) due(?! to)|at its word)\b",
    re.IGNORECASE,
)


def sources():
    for top in ("slamlab", "tests", "tools"):
        for path in sorted((ROOT / top).rglob("*.py")):
            yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")
    for path in sorted((ROOT / "notebooks").rglob("*.ipynb")):
        if ".ipynb_checkpoints" in path.parts:
            continue
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        plain = [re.sub(r"^\s*[%!].*$", "pass", cell, flags=re.MULTILINE) for cell in code]
        yield str(path.relative_to(ROOT)), "\n".join(plain)


def identifiers(tree):
    """Every name in code: variables, attributes, parameters, keywords, imports."""
    for node in ast.walk(tree):
        for field in ("id", "attr", "arg", "name", "asname"):
            name = getattr(node, field, None)
            if isinstance(name, str):
                yield from name.split(".")
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from node.module.split(".")


def surface(node):
    """Fields, attributes, methods of a class, and the parameters of what is public."""
    for part in ast.walk(node):
        if isinstance(part, ast.FunctionDef):
            yield part.name
            if part.name.startswith("_") and part.name != "__init__":
                continue
            yield from (a.arg for a in (*part.args.args, *part.args.kwonlyargs))
        elif isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
            yield part.target.id
        elif isinstance(part, ast.Attribute) and ast.unparse(part.value) == "self":
            yield part.attr


def choices(tree):
    return {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)} & CHOICES


@pytest.mark.parametrize(("path", "source"), list(sources()), ids=lambda value: value[-60:])
def test_no_old_name_is_left(path, source):
    tree = ast.parse(source)
    assert GONE & set(identifiers(tree)) == set()
    if path != "tests/test_names.py" and "exercises" not in path:
        assert choices(tree) == set()


def test_no_class_has_an_old_name_back():
    seen = set()
    for path in sorted((ROOT / "slamlab").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and node.name in MEMBERS:
                seen.add(node.name)
                assert MEMBERS[node.name] & set(surface(node)) == set(), f"{path.name} {node.name}"
    assert seen == set(MEMBERS)


def defined(tree):
    """Functions, classes, parameters, variables and imports of a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.alias):
            yield (node.asname or node.name).split(".")[-1]
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


@pytest.mark.parametrize("module", FUNCTIONS)
def test_no_old_function_is_left(module):
    path = ROOT.joinpath("slamlab", *module.split("."))
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    assert FUNCTIONS[module] & set(defined(ast.parse(path.read_text(encoding="utf-8")))) == set()


def test_the_scan_graph_has_no_old_name():
    from slamlab.slam import _closures, _joining, _tracking

    modules = (_closures, _joining, _tracking)
    assert {name for one in modules for name in vars(one)} & SCAN_GRAPH == set()


@pytest.mark.parametrize(
    "old",
    [
        "from slamlab.navigation import Homer",
        "import slamlab.navigation.seen_floor",
        "log.looks",
        "run(system, log).sightings",
        "FastSlam(motion, detection=(0.9, 0.1))",
    ],
)
def test_an_old_name_would_be_found(old):
    assert GONE & set(identifiers(ast.parse(old)))


def test_an_old_member_would_be_found():
    code = "class Run:\n    kept: dict\n    def __init__(self, past):\n        self.away = 1"
    assert {"kept", "past", "away"} <= set(surface(ast.parse(code).body[0]))
    assert choices(ast.parse('EKFSlam(linearisation="latest")')) == {"latest"}


def test_an_old_function_parameter_or_variable_would_be_found():
    code = "from field import stamp\ndef root(shut):\n    eye = np.eye(3)"
    assert set(defined(ast.parse(code))) == {"stamp", "root", "shut", "eye"}
    assert "eye" not in set(defined(ast.parse("position = np.eye(3) @ eye")))


def test_what_a_page_patches_in_the_library_exists():
    patched = re.compile(r"[\"'](slamlab(?:\.\w+)+)[\"']")
    pages = "\n".join(source for path, source in sources() if path.endswith(".ipynb"))
    names = set(patched.findall(pages))
    assert "slamlab.slam._closures._inflation" in names
    for name in names:
        pkgutil.resolve_name(name)


def prose(notebook):
    """Texts, docstrings and alternative texts of a notebook."""
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        image = cell["metadata"].get("mystnb", {}).get("image", {})
        if cell["cell_type"] == "markdown":
            yield re.sub(r"\[[^]]*\]\([^)]*\)", " ", source)
        else:
            yield "\n".join(re.findall(r'(?s)"""(.*?)"""', source))
        yield image.get("alt", "")


def chapters_written_as_lessons():
    for path in sorted((ROOT / "notebooks").rglob("[0-9][0-9]*_*.ipynb")):
        if path.name[:2] in LESSONS and ".ipynb_checkpoints" not in path.parts:
            yield pytest.param(path, id=f"{path.parent.name}/{path.name}")


@pytest.mark.parametrize("path", list(chapters_written_as_lessons()))
def test_the_prose_of_a_lesson_uses_the_words_of_the_field(path):
    texts = list(prose(json.loads(path.read_text(encoding="utf-8"))))
    found = [(word[0], text[max(word.start() - 40, 0) : word.end() + 20])
             for text in texts for word in PROSE.finditer(text)]  # fmt: skip
    assert found == []
    assert PROSE.search("Its doubt is 3 m where 1 m is due.")
    assert not PROSE.search("The shift is due to a wrap.")


def pages_and_docstrings():
    for path in sorted((ROOT / "book").glob("**/*")):
        if path.suffix in (".md", ".yaml") and "static" not in path.parts:
            yield path, re.sub(r"`[^`]*`", "", path.read_text(encoding="utf-8"))
    for path in sorted((ROOT / "slamlab").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                yield path, re.sub(r"`[^`]*`", "", ast.get_docstring(node) or "")
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                if " " in node.value and "exercises" not in path.parts:
                    yield path, re.sub(r"`[^`]*`", "", node.value)  # messages, help, labels


def test_pages_and_docstrings_use_the_words_of_the_field():
    # A style sheet and a project sheet are called so everywhere.
    usual = re.compile(r"(style|project) sheets?")
    found = [(path.name, word[0]) for path, text in pages_and_docstrings()
             for word in PROSE.finditer(usual.sub("", text))]  # fmt: skip
    assert found == []
    assert PROSE.search(usual.sub("", "Style sheets; the sheet."))
