"""The project as a newcomer meets it: a cheap import, a README that runs, a complete lock."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from numpydoc.docscrape import NumpyDocString

ROOT = Path(__file__).resolve().parents[1]


def python(code: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return done.stdout.strip()


def test_import_is_cheap_and_loads_no_plotting():
    code = (
        "import sys, time; t = time.perf_counter(); import slamlab; "
        "print(time.perf_counter() - t, 'matplotlib' in sys.modules, 'anywidget' in sys.modules)"
    )
    answers = [python(code).split() for _ in range(3)]
    assert min(float(seconds) for seconds, _, _ in answers) < 0.3
    assert {tuple(loaded) for _, *loaded in answers} == {("False", "False")}


def test_rooms_below_the_faces_load_no_plotting():
    rooms = (
        "geometry gaussian robots sensors filters mapping slam localization evaluation datasets"
    )
    code = f"import sys; import {', '.join('slamlab.' + r for r in rooms.split())}; "
    code += "print(sorted({'matplotlib', 'anywidget', 'ipywidgets'} & set(sys.modules)))"
    assert python(code) == "[]"


def test_a_room_is_reached_from_the_package_and_a_misspelt_one_is_named():
    code = "import slamlab; print(slamlab.geometry.wrap_angle(7.0) < 1, 'slam' in dir(slamlab))"
    assert python(code) == "True True"
    import slamlab

    with pytest.raises(AttributeError, match="has no attribute 'slamm'"):
        slamlab.slamm  # noqa: B018


def test_the_readme_code_runs():
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert blocks
    for block in blocks:
        assert python(block)


def test_the_lock_pins_every_declared_dependency():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *sum(project["optional-dependencies"].values(), [])]
    names = {re.match(r"[\w-]+", text).group().lower().replace("_", "-") for text in wanted}
    pins = (ROOT / "requirements.lock").read_text().splitlines()
    assert all(re.fullmatch(r"[\w.-]+==[\w.+!-]+", pin) for pin in pins)
    locked = {pin.split("==")[0].lower().replace("_", "-") for pin in pins}
    assert names - {"slamlab"} <= locked


def public_functions():
    for path in sorted((ROOT / "slamlab").rglob("*.py")):
        if path.name.startswith("_") and path.name != "__init__.py":
            continue
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                yield pytest.param(node, id=f"{path.relative_to(ROOT)}:{node.name}")


@pytest.mark.parametrize("node", list(public_functions()))
def test_a_docstring_names_every_parameter(node):
    doc = ast.get_docstring(node) or ""
    named = " ".join(p.name for p in NumpyDocString(doc)["Parameters"])
    parameters = [a.arg for a in node.args.args + node.args.kwonlyargs]
    if named:
        missing = [p for p in parameters if not re.search(rf"\b{re.escape(p)}\b", named)]
        assert missing == []
    else:
        assert len(doc) > 20
