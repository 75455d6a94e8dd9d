"""Wheel and source archive: nothing lacks, nothing strays in, and the wheel works alone."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from tools import check_distribution as tool

ROOT = Path(__file__).resolve().parents[1]
PARTS = {"slamlab/__init__.py", "slamlab/py.typed", "book/api.md", ".gitignore", "README.md"}
INFO = "slamlab_course-1.dist-info"
WHEEL = {"slamlab/__init__.py", "slamlab/py.typed", f"{INFO}/METADATA"}
WHEEL |= {f"{INFO}/licenses/LICENSE", f"{INFO}/licenses/LICENSE-text"}
SDIST = {"a-1", "a-1/slamlab/__init__.py", "a-1/slamlab/py.typed", "a-1/book/api.md"}
SDIST |= {"a-1/README.md", "a-1/PKG-INFO", "a-1/book", "a-1/slamlab"}


def test_whole_archives_pass():
    assert tool.wheel_troubles(WHEEL, PARTS) == []
    assert tool.sdist_troubles(SDIST, PARTS) == []


def test_what_lacks_and_what_strays_in_is_named():
    assert tool.wheel_troubles(WHEEL - {"slamlab/py.typed"}, PARTS) == [
        "the wheel lacks slamlab/py.typed"
    ]
    assert tool.wheel_troubles(WHEEL | {"tests/a.py"}, PARTS) == ["the wheel has tests/a.py too"]
    assert tool.wheel_troubles(WHEEL - {f"{INFO}/licenses/LICENSE"}, PARTS) == [
        "the wheel lacks the licence LICENSE"
    ]
    assert tool.sdist_troubles(SDIST - {"a-1/book/api.md"}, PARTS) == [
        "the source archive lacks book/api.md"
    ]
    assert tool.sdist_troubles(SDIST | {"a-1/_build/x"}, PARTS) == [
        "the source archive has _build/x too"
    ]


def test_a_tag_must_name_the_version(capsys):
    assert tool.main(["--tag", f"v{tool.VERSION}"]) == 0
    assert tool.main(["--tag", "v0.0.1"]) == 1
    assert tool.main(["--tag", ""]) == 1
    assert f"expected v{tool.VERSION}, got none" in capsys.readouterr().out


@pytest.mark.slow
def test_what_is_built_is_whole_passes_twine_and_works_alone(tmp_path):
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    for package in ("build", "twine"):
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"{package} is not installed")

    def run(*words):
        done = subprocess.run(
            [sys.executable, *map(str, words)], cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    clone, out = tmp_path / "clone", tmp_path / "dist"
    subprocess.run(["git", "clone", "-q", ROOT, clone], check=True)
    run("-m", "build", "--no-isolation", "--outdir", out, clone)
    said = run("-m", "twine", "check", "--strict", *out.iterdir())
    assert said.count("PASSED") == 2
    said = run(clone / "tools" / "check_distribution.py", out)
    assert "the README's lines, help and map work" in said
