"""Sizes that keep the library readable: arguments, attributes, exports, users of kernels.

A number above the limit stands here with its reason, and falls when the code gets plainer.
"""

import ast
import json
import re
from functools import cache
from pathlib import Path
from textwrap import dedent

import pytest

ROOT = Path(__file__).resolve().parents[1]
LIBRARY = ROOT / "slamlab"
SOURCES = {
    path.relative_to(LIBRARY).as_posix(): path.read_text()
    for path in sorted(LIBRARY.rglob("*.py"))
}
LIMIT = 12
PARAMETERS: dict[str, tuple[int, str]] = {}
ATTRIBUTES = {
    "logs.py Log": (13, "the columns of a log"),
}


def parameters(source: str) -> dict[str, int]:
    """Number of parameters by "Class.method" or "function", self and cls left out."""
    found = {}

    def visit(node: ast.AST, prefix: str) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef):
                a = child.args
                names = [one.arg for one in (*a.posonlyargs, *a.args, *a.kwonlyargs)]
                found[prefix + child.name] = len([n for n in names if n not in ("self", "cls")])
            if isinstance(child, ast.ClassDef):
                visit(child, f"{prefix}{child.name}.")

    visit(ast.parse(source), "")
    return found


def attributes(source: str) -> dict[str, int]:
    """Number of attributes by class: fields, and what methods store in `self`."""
    found = {}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef):
            fields = {one.target.id for one in node.body if isinstance(one, ast.AnnAssign)}
            stored = {
                one.attr
                for one in ast.walk(node)
                if isinstance(one, ast.Attribute)
                and isinstance(one.ctx, ast.Store)
                and isinstance(one.value, ast.Name)
                and one.value.id == "self"
            }
            found[node.name] = len(fields | stored)
    return found


def over_the_limit(count, allowed):
    """Names whose count differs from what is allowed, as {name: count}."""
    counts = {
        f"{path} {name}": n
        for path, source in SOURCES.items()
        for name, n in count(source).items()
    }
    return {name: n for name, n in counts.items() if n > allowed.get(name, (LIMIT, ""))[0]} | {
        name: counts.get(name) for name, (n, _) in allowed.items() if counts.get(name) != n
    }


def test_no_function_takes_more_than_twelve_arguments():
    assert over_the_limit(parameters, PARAMETERS) == {}


def test_no_class_keeps_more_than_twelve_attributes():
    assert over_the_limit(attributes, ATTRIBUTES) == {}


def test_one_too_many_would_be_found():
    names = [f"a{i}" for i in range(13)]
    stored = "\n".join(f"        self.{name} = 0" for name in names)
    source = f"class A:\n    def f(self, {', '.join(names)}):\n{stored}\n"
    assert parameters(source) == {"A.f": 13}
    assert attributes(source) == {"A": 13}


# What a subpackage exports is imported from it by a page. What no page imports is reached by its
# module, as the types of results are: "from slamlab.slam.scan_graph import Closure".

NOT_FOR_NOTEBOOKS = {"commands", "exercises", "kernels", "printed"}
# Exports that no page imports, and why a reader does.
KEPT = {
    "datasets.read_carmen": "lab V names it, for a second log of the reader's own",
    "evaluation.rpe": "the page Bring your own names it, for a run of the reader's own",
    "navigation.Body": "an argument of CoveragePilot and CollisionGuard: another robot's size",
    "widgets.Occupancy": "a layer of Replay: another map",
    "widgets.WallSegments": "a layer of Replay: another room",
}
ROOMS = sorted(
    path.parent.name
    for path in LIBRARY.glob("*/__init__.py")
    if path.parent.name not in NOT_FOR_NOTEBOOKS
)


def exported(source: str) -> list[str]:
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return ast.literal_eval(node.value)
    return []


def fenced(text: str) -> str:
    """Python code of a page in Markdown."""
    blocks = re.findall(r"^```python\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    return "\n".join(map(dedent, blocks))


def code_of(path: Path) -> str:
    """Code of a page: cells, and Python blocks in Markdown."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".ipynb":
        return fenced(text) if path.suffix == ".md" else text
    codes = []
    for cell in json.loads(text)["cells"]:
        source = "".join(cell["source"])
        plain = re.sub(r"^\s*[%!].*$", "pass", source, flags=re.MULTILINE)
        codes.append(plain if cell["cell_type"] == "code" else fenced(source))
    return "\n".join(codes)


def imported(source: str) -> set[str]:
    """Names that code takes from a subpackage, as "room.name": by an import, or by a dot."""
    tree, names, homes = ast.parse(source), set(), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            for one in node.names:
                names.add(f"{node.module}.{one.name}")
                homes[one.asname or one.name] = f"{node.module}.{one.name}"
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            first, *rest = ast.unparse(node).split(".")
            names.add(".".join([homes.get(first, first), *rest]))
    return {name.removeprefix("slamlab.") for name in names if name.startswith("slamlab.")}


@cache
def used_by_pages() -> set[str]:
    """What the code of notebooks, of the book's own pages, of README and examples imports.

    Pages of the API do not count: they have all that there is.
    """
    pages = [
        *(ROOT / "notebooks").rglob("*.ipynb"),
        *(path for path in (ROOT / "book").rglob("*.md") if path.parent.name != "api"),
        *(ROOT / "examples").glob("*.py"),
        ROOT / "README.md",
    ]
    return set().union(*(imported(code_of(path)) for path in pages))


def unused(room: str, names: list[str]) -> list[str]:
    """Names of a subpackage that no page imports from it."""
    return [name for name in names if f"{room}.{name}" not in used_by_pages()]


@pytest.mark.parametrize("room", ROOMS)
def test_every_export_is_imported_by_a_page(room):
    names = exported(SOURCES[f"{room}/__init__.py"])
    assert names
    assert {f"{room}.{name}" for name in unused(room, names)} == {
        name for name in KEPT if name.startswith(f"{room}.")
    }


@pytest.mark.parametrize(
    ("room", "name", "because"),
    [
        ("slam", "NobodySlam", "there is none"),
        ("slam", "Closure", "the type of a result"),
        ("slam", "Confirmation", "notebooks import it from its module"),
        ("robots", "moved", "a word of many cells"),
        ("localization", "GlobalLocalization", "a command uses it"),
        ("worlds", "World", "other subpackages use it"),
    ],
)
def test_an_export_that_no_page_imports_would_be_found(room, name, because):
    assert unused(room, [name]) == [name], because


def test_an_import_is_found_in_each_of_its_forms():
    code = "from slamlab import plots as p\nfrom slamlab.slam import (\n    EKFSlam,\n)\np.show(1)"
    assert {"plots.show", "slam.EKFSlam"} <= imported(code)
    assert imported("from slamlab.slam.ekf import EKFSlam") == {"slam.ekf.EKFSlam"}
    assert fenced("```python\nx = 1\n```\n```text\ny\n```\n") == "x = 1\n"


# Every public function refuses wrong arguments, and the parameters say what is right: `Raises`
# names what else can happen. The checks themselves say what they refuse.

DOOR = re.compile(
    "|".join(
        [
            r"\bshapes? (is|are|do|does|differ)\b",
            r"\bwrong (shape|value)\b",
            r"\bnot finite\b",
            r"\bis negative\b",
            r"\bnot positive\b(?! semi)",  # as a file's information may be
            r"\bbelow (one|1)\b",
            r"\bout of range\b",
            r"\boutside (its|the|their) range\b",
            r"\boutside [\[(]",
            r"\bno (covariance|generator)\b",
            r"\bis (unknown|no count)\b",
            r"\bthere (is|are) no (beams?|places?|points?)\b",
        ]
    )
)


def of_the_door(source: str) -> dict[str, str]:
    """What `Raises` says of arguments alone, by "Class.method" or "function"."""
    found = {}

    def visit(node: ast.AST, prefix: str) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                doc = ast.get_docstring(child) or ""
                section = re.search(r"^Raises\n-+\n(.*?)(\n\n|\Z)", doc, re.DOTALL | re.MULTILINE)
                words = " ".join(section[1].split()) if section else ""
                if phrase := DOOR.search(words):
                    found[prefix + child.name] = phrase[0]
                visit(child, f"{prefix}{child.name}.")

    visit(ast.parse(source), "")
    return found


def test_no_raises_section_repeats_what_every_function_refuses():
    assert {
        f"{path} {name}": phrase
        for path, source in SOURCES.items()
        if path != "_checks.py"
        for name, phrase in of_the_door(source).items()
    } == {}


@pytest.mark.parametrize(
    "words",
    [
        "If a shape is wrong.",
        "If shapes do not fit, or the graph is singular.",
        "If a parameter lies outside its\n            range.",
        "If a number is not finite.",
        "If the file is damaged, or `V` is no covariance.",
        "If there is no beam.",
    ],
)
def test_a_raises_section_of_the_door_would_be_found(words):
    source = f'''class A:
    def f(self, z):
        """Do it.

        Raises
        ------
        ValueError
            {words}

        Examples
        --------
        """
'''
    assert list(of_the_door(source)) == ["A.f"]


def test_what_is_no_fault_of_an_argument_may_be_raised():
    source = '''def f(z):
    """Do it, if the shape is wrong.

    Raises
    ------
    ValueError
        If the graph is singular, or information in the file is not positive semi-definite.

    Examples
    --------
    Nothing is out of range.
    """
'''
    assert of_the_door(source) == {}
    assert of_the_door(source.replace("the graph", "a shape is wrong, the graph")) != {}


# Who calls compiled code.

USERS = {
    *("mapping/occupancy", "matching/correlative", "matching/field", "matching/icp"),
    *("navigation/boxes", "navigation/cubic", "navigation/exploration_grid", "navigation/spline"),
    *("sensors/stereo", "slam/gamma", "slam/grid_fast", "worlds/bitmap"),
}


def test_these_files_and_no_others_import_kernels():
    users = {
        path.removesuffix(".py")
        for path, source in SOURCES.items()
        if re.search(r"from slamlab(\.kernels| import kernels)", source)
        and not path.startswith("kernels/")
    }
    assert users == USERS


# A step is the paper's algorithm box: the numbers of its formulas stand at the ends of its lines.
# Where the paper has none, they bear the letter that the formula has in its chapter, as (C).

BOXES = {
    "slam/ekf.py predict": "8 11 12 13 14",
    "slam/ekf.py update": "18 19 22 32 33 34 35 36 37 42 43",
    "slam/batch.py update": "18 19 22 32 33 34 35 36 37 42 43",
    "slam/fast.py update": "14 15 16 18",
    "slam/least_squares.py errors": "A",
    "slam/least_squares.py jacobians": "B",
    "slam/least_squares.py dcs": "F",
    "slam/least_squares.py gauss_newton": "A C",
    "slam/least_squares.py levenberg_marquardt": "A C",
    "slam/grid_fast.py update": "A",
    "slam/grid_fast.py penetrate": "B C",
    "slam/gamma.py update": "D F",
    "slam/gamma.py _log_density": "E F",
    "mapping/variance.py unchecked_log_density": "E F",
    "filters/kalman.py filter": "3 4 5 6 7 8 9",
    "localization/monte_carlo.py update": "14",
    "matching/field.py gauss_newton": "7 8 12 13 14",
    "matching/icp.py align": "C",
    "matching/icp.py errors": "A B",
    "navigation/explore.py free_drive": "A figure_14",
    "navigation/explore.py _turnable": "figure_14",
    "navigation/strategies.py LongestBeam.choose": "figure_15",
    "navigation/strategies.py Quadrants.choose": "figure_16",
    "localization/global_localization.py match": "5 6 7 8 9",
    "navigation/path_memory.py add": "1.1 1.2 1.4 1.5",
    "navigation/path_memory.py _fitted": "1.3",
}
CHAPTERS = {
    "slam/least_squares.py": "13_pose_graphs",
    "matching/icp.py": "14_scan_matching_and_hector",
    "navigation/explore.py": "18_exploration",
    "slam/grid_fast.py": "15",
    "slam/gamma.py": "15",
    "mapping/variance.py": "15",
}
# A formula without a number stands there itself.
FORMULAS = {"mapping/occupancy.py insert_scan": "l_k = l_{k-1} + l(z_k)"}


def said(box: str) -> str:
    """Comments of a function, named by its file and itself."""
    path, name = box.split()
    function = ast.parse(SOURCES[path])
    for part in name.split("."):  # of a class, where several have it
        (function,) = (
            node
            for node in ast.walk(function)
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == part
        )
    lines = SOURCES[path].splitlines()[function.lineno - 1 : function.end_lineno]
    return " ".join(line.partition("# ")[2] for line in lines)


@pytest.mark.parametrize("box", BOXES)
def test_the_formulas_of_a_step_bear_their_numbers(box):
    text = said(box).replace("figure ", "figure_")
    numbers = set(re.findall(r"figure_\d+|(?<=\()(?:\d+|[A-Z])(?=\))|\d\.\d", text))
    assert set(BOXES[box].split()) <= numbers
    letters = {number for number in numbers if number.isalpha()}
    assert letters <= lettered(box.split()[0])


@pytest.mark.parametrize("box", FORMULAS)
def test_a_formula_without_a_number_stands_beside_its_step(box):
    assert FORMULAS[box] in said(box)


def lettered(path: str) -> set[str]:
    """Letters of formulas on the pages of a file's chapter."""
    if path not in CHAPTERS:
        return set()
    pages = (ROOT / "notebooks").glob(f"{CHAPTERS[path]}*.ipynb")
    return {
        tag for page in pages for tag in re.findall(r"tag\{([A-Z])\}", page.read_text("utf-8"))
    }


# Formulas that a page of ours derives bear its letter.

LETTERS = {
    "matching/normals.py estimate": "14b (D)",
    "slam/_closures.py verify": "14b (E)",
    "slam/_closures.py chain_chi2": "13 (A)",
    "slam/_closures.py pairwise_consistent": "13b (I)",
}


@pytest.mark.parametrize("function", LETTERS)
def test_a_formula_of_a_page_bears_its_letter_and_the_page_has_it(function):
    page, letter = re.fullmatch(r"(\w+) \((\w)\)", LETTERS[function]).groups()
    (notebook,) = (ROOT / "notebooks").glob(f"{page}_*.ipynb")
    assert LETTERS[function] in said(function)
    assert rf"\\tag{{{letter}}}" in notebook.read_text(encoding="utf-8")
