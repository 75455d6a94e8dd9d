"""The workflows: they fit the schema of GitHub, and each step is a make target."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = set(re.findall(r"(?m)^([a-z][a-z -]*):", MAKEFILE))
TARGETS = {name for line in TARGETS for name in line.split()}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def jobs(path):
    return yaml.safe_load(path.read_text())["jobs"]


def steps(path):
    return [step for job in jobs(path).values() for step in job["steps"]]


def not_a_target(lines):
    """Commands of a workflow that are no `make TARGET` of this project."""
    named = [(line, re.fullmatch(r"make ([a-z-]+)", line.strip())) for line in lines]
    return [line for line, found in named if found is None or found.group(1) not in TARGETS]


def checked(schema, *files):
    words = ["check_jsonschema", "--builtin-schema", schema, *map(str, files)]
    return subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True)


def test_there_are_three():
    assert [path.stem for path in WORKFLOWS] == ["pages", "publish", "tests"]


@pytest.mark.parametrize(
    "schema", ["vendor.github-workflows", "custom.github-workflows-require-timeout"]
)
def test_they_fit_the_schema_and_no_job_runs_for_ever(schema, tmp_path):
    pytest.importorskip("check_jsonschema")
    done = checked(schema, *WORKFLOWS)
    assert done.returncode == 0, done.stdout
    wrong = tmp_path / "wrong.yml"
    text = WORKFLOWS[0].read_text()
    wrong.write_text(text.replace("timeout-minutes:", "timeout:"))
    assert checked(schema, wrong).returncode == 1


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_every_command_is_a_make_target(path):
    commands = [line for step in steps(path) for line in step.get("run", "").splitlines()]
    assert commands or path.stem != "tests"
    assert not_a_target(commands) == []


def test_a_command_that_is_no_target_is_seen():
    assert not_a_target(["make test", "pip install .", "make tset", "make test && true"]) == [
        "pip install .",
        "make tset",
        "make test && true",
    ]


def test_what_the_workflows_run_is_known_to_make():
    commands = {step["run"] for path in WORKFLOWS for step in steps(path) if "run" in step}
    for command in sorted(commands):
        done = subprocess.run(["make", "-n", *command.split()[1:]], cwd=ROOT, capture_output=True)
        assert done.returncode == 0, (command, done.stderr.decode())


def test_every_system_and_every_python_that_is_promised_is_tried():
    matrix = jobs(ROOT / ".github/workflows/tests.yml")["library"]["strategy"]["matrix"]
    said = {
        line.rpartition(" ")[2]
        for line in PROJECT["classifiers"]
        if re.search(r"Python :: 3\.\d+$", line)
    }
    assert set(matrix["python"]) == said
    assert PROJECT["requires-python"] == f">={min(said, key=lambda v: int(v[2:]))}"
    assert {system.partition("-")[0] for system in matrix["os"]} == {"ubuntu", "macos", "windows"}
    readme = (ROOT / "README.md").read_text()
    assert f"Python {min(said)} to {max(said)}" in readme


def test_the_index_is_told_who_publishes_and_no_password_is_stored():
    publish = ROOT / ".github/workflows/publish.yml"
    job = jobs(publish)["publish"]
    assert job["permissions"] == {"id-token": "write"}
    assert job["environment"]["name"] == "pypi"
    assert "secrets." not in publish.read_text()
    assert "run" not in {key for step in job["steps"] for key in step}


def test_nothing_may_be_written_but_where_it_is_deployed():
    for path in WORKFLOWS:
        assert yaml.safe_load(path.read_text())["permissions"] == {"contents": "read"}
