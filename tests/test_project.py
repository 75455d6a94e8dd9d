"""The project as a newcomer meets it: a cheap import, a README that runs, a complete lock."""

import ast
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest
from numpydoc.docscrape import NumpyDocString

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


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
    project = PROJECT["project"]
    wanted = [*project["dependencies"], *sum(project["optional-dependencies"].values(), [])]
    names = {re.match(r"[\w-]+", text).group().lower().replace("_", "-") for text in wanted}
    pins = (ROOT / "requirements.lock").read_text().splitlines()
    assert all(re.fullmatch(r"[\w.-]+==[\w.+!-]+", pin) for pin in pins)
    locked = {pin.split("==")[0].lower().replace("_", "-") for pin in pins}
    assert names - {"slamlab-course"} <= locked


def wanted_by(extra: str) -> set[str]:
    """Names of the packages that an extra asks for, those of the extras within it included."""
    extras = PROJECT["project"]["optional-dependencies"]
    found = set()
    for text in extras[extra]:
        name, inner = re.match(r"([\w-]+)(?:\[([\w,]+)\])?", text).groups()
        if name == "slamlab-course":
            found = found.union(*(wanted_by(each) for each in inner.split(",")))
        else:
            found.add(name)
    return found


def test_the_library_needs_four_packages_and_is_fast_with_two_more():
    names = {re.match(r"[\w-]+", text)[0] for text in PROJECT["project"]["dependencies"]}
    assert names == {"numpy", "scipy", "pillow", "pyyaml"}
    assert wanted_by("fast") == {"numba", "qdldl"} < wanted_by("course")


def test_a_student_installs_no_oracle_and_no_browser():
    heavy = {"gtsam", "rtb-data", "evo", "playwright", "dask", "jupyter-book"}
    assert not heavy & wanted_by("lab")
    assert wanted_by("course") < wanted_by("lab") < wanted_by("dev")
    assert heavy <= wanted_by("dev")


def test_what_a_pattern_of_the_package_names_is_there():
    patterns = PROJECT["tool"]["setuptools"]["package-data"]["slamlab"]
    lone = [pattern for pattern in patterns if not list((ROOT / "slamlab").glob(pattern))]
    assert lone == []
    files = {path for pattern in patterns for path in (ROOT / "slamlab").glob(pattern)}
    there = {p for p in (ROOT / "slamlab").rglob("*") if p.is_file() and p.suffix != ".py"}
    assert {p for p in there if "__pycache__" not in p.parts} <= files


def test_the_carried_data_are_small_and_name_source_and_licence():
    folder = ROOT / "slamlab" / "datasets" / "data"
    data = [path for path in folder.iterdir() if path.suffix == ".gz"]
    assert sum(path.stat().st_size for path in data) < 1.5e6
    said = (folder / "README.md").read_text()
    assert [path.name for path in data if path.name not in said] == []
    for name in re.findall(r"LICENSE-[\w-]+", said):
        assert (folder / name).exists()


def test_nobody_is_sent_to_the_stranger_who_has_our_name():
    files = [*(ROOT / "slamlab").rglob("*.py"), *ROOT.glob("*.md"), *(ROOT / "book").glob("*.md")]
    files += (ROOT / "notebooks").rglob("*.ipynb")
    stray = re.compile(r"pip install [^\n`]*\bslamlab(?!-course)\b|\bslamlab\[")
    assert [path.name for path in files if stray.search(path.read_text())] == []
    assert stray.search("pip install slamlab")
    assert not stray.search("pip install slamlab-course[course]")


def git_files(*options: str) -> set[str]:
    """Names of tracked files; without git, or in an unpacked archive, the test is skipped."""
    words = ["git", "ls-files", "-z", *options]
    listed = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git checkout")
    return set(listed.stdout.split("\0")) - {""}


BINARY = {".gz", ".png", ".woff", ".woff2"}
# Hidden files that are written by hand.
HIDDEN = (".gitignore", ".ci/run", ".editorconfig", ".pre-commit-config.yaml")
FOLDERS = (".github/", ".vscode/settings.json", ".devcontainer/devcontainer.json")


def does_not_belong(name: str, root: Path) -> bool:
    """Whether a file is what a tool left: hidden, a link, or bytes of an unknown kind."""
    path = root / name
    known = name in HIDDEN or name.startswith(FOLDERS)
    if path.is_symlink() or (name.startswith(".") and not known):
        return True
    return path.exists() and path.suffix not in BINARY and b"\0" in path.read_bytes()


def test_nothing_generated_is_tracked():
    tracked = git_files()
    assert git_files("--cached", "--ignored", "--exclude-per-directory=.gitignore") == set()
    assert {name for name in tracked if does_not_belong(name, ROOT)} == set()


def test_no_two_test_files_have_one_name():
    """Else pytest, called at the root, collects the first only."""
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert [name for name in names if names.count(name) > 1] == []


def test_a_generated_file_is_seen(tmp_path):
    (tmp_path / "log").write_bytes(b"\x80\x04\0")
    (tmp_path / ".log").write_text("a line")
    (tmp_path / "link").symlink_to(tmp_path / "log")
    (tmp_path / "a.py").write_text("x = 1\n")
    seen = [name for name in ("log", ".log", "link", "a.py") if does_not_belong(name, tmp_path)]
    assert seen == ["log", ".log", "link"]


def test_the_source_distribution_is_complete(tmp_path):
    tracked = git_files()
    if not tracked:
        pytest.skip("nothing is tracked")
    for name in tracked:
        if (ROOT / name).exists():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tmp_path / name)
    left = ["examples/.ruff_cache/0.17.5/1", "tests/.hypothesis/a", "slamlab/__pycache__/a.pyc"]
    for name in [*left, "notebooks/.ipynb_checkpoints/a.ipynb", "book/.pytest_cache/CACHEDIR.TAG"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    code = "from setuptools.build_meta import build_sdist; print(build_sdist('dist'))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True)
    assert done.returncode == 0, done.stderr.decode()
    (archive,) = (tmp_path / "dist").glob("slamlab_course-*.tar.gz")
    with tarfile.open(archive) as file:
        inside = {name.partition("/")[2] for name in file.getnames()}
    assert {name for name in tracked if not name.startswith(".")} - inside <= {"MANIFEST.in"}
    caches = {
        name for name in inside if re.search(r"/[._]\w*(cache|hypothesis|checkpoints)", name)
    }
    assert caches == set()


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
