"""What a contributor is told is there: files, make targets, hooks, forms, the short selection."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
GUIDE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = set(re.findall(r"(?m)^([a-z][a-z-]*):", MAKEFILE))
FORMS = sorted(
    path for path in (ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml") if path.stem != "config"
)


def named_paths(text):
    """Paths of this project that a text names, the ones with a name to fill in left out."""
    found = re.findall(r"`((?:slamlab|tests|notebooks|book|tools)/[\w./-]*)`", text)
    found += re.findall(r"(?<= )(tests/[\w./-]+)", text)
    found += re.findall(r"\]\(([\w./-]+)\)", text)
    return {path.rstrip(".,") for path in found if not re.search(r"N[NA]", path)}


def test_every_file_that_the_guide_names_is_there():
    paths = named_paths(GUIDE)
    assert len(paths) > 15
    assert [path for path in sorted(paths) if not (ROOT / path).exists()] == []
    assert named_paths("see `slamlab/gone.py`") == {"slamlab/gone.py"}


def test_every_make_target_that_the_guide_names_is_there():
    named = set(re.findall(r"\bmake ([a-z-]+)(?=[`\s])", GUIDE))
    assert {"set-up", "quick", "lint", "test", "slim"} <= named
    assert {name for name in named - TARGETS if f"`make {name}" in GUIDE} == set()


def test_the_hooks_run_what_make_lint_runs():
    recipe = re.search(r"(?m)^lint:.*\n((?:\t.*\n)+)", MAKEFILE).group(1)
    wanted = {line.partition("$(BIN)/")[2] for line in recipe.splitlines() if "$(BIN)/" in line}
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())
    assert [repo["repo"] for repo in config["repos"]] == ["local"]
    hooks = config["repos"][0]["hooks"]
    entries = {hook["entry"].removeprefix(".venv/bin/") for hook in hooks}
    assert {entry.removesuffix(" --force-exclude") for entry in entries} == {
        line.removesuffix(" .") for line in wanted
    }
    assert {hook["language"] for hook in hooks} == {"system"}


def test_the_settings_of_editor_and_container_are_json():
    settings = json.loads((ROOT / ".vscode/settings.json").read_text())
    assert "not slow" in settings["python.testing.pytestArgs"]
    container = json.loads((ROOT / ".devcontainer/devcontainer.json").read_text())
    assert container["postCreateCommand"].removeprefix("make ") in TARGETS


def test_the_code_keeps_what_the_editor_is_told():
    text = (ROOT / ".editorconfig").read_text()
    assert "end_of_line = lf" in text
    files = [*(ROOT / "slamlab").rglob("*.py"), *(ROOT / "tests").rglob("*.py")]
    for path in files:
        data = path.read_bytes()
        assert b"\r" not in data
        assert not data or data.endswith(b"\n"), path


def checked(schema, *files):
    """What check-jsonschema says of files, by a schema that it carries."""
    words = ["check_jsonschema", "--builtin-schema", schema, *map(str, files)]
    return subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True)


def test_the_issue_forms_fit_their_schema(tmp_path):
    pytest.importorskip("check_jsonschema")
    assert len(FORMS) == 3
    done = checked("vendor.github-issue-forms", *FORMS)
    assert done.returncode == 0, done.stdout
    wrong = tmp_path / "wrong.yml"
    wrong.write_text(FORMS[0].read_text().replace("type: textarea", "type: essay"))
    assert checked("vendor.github-issue-forms", wrong).returncode == 1


def test_the_short_selection_leaves_out_slow_tests_and_its_marker_is_known():
    options = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]["ini_options"]
    assert any(line.startswith("slow:") for line in options["markers"])
    words = [sys.executable, "-m", "pytest", "-q", "--collect-only", "-p", "no:nbval"]
    plain = {name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"}
    few, every = (
        subprocess.run(
            [*words, *chosen, "tests/slam/test_graph.py"],
            cwd=ROOT,
            env=plain,
            capture_output=True,
            text=True,
        ).stdout
        for chosen in (["-m", "not slow"], [])
    )
    assert "deselected" in few
    assert few.count("::") < every.count("::")
