"""Types reach a caller: a ten-line client outside the checkout, read by mypy and by pyright."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import slamlab

ROOT = Path(slamlab.__file__).resolve().parents[1]
CLIENT = """\
import numpy as np

import slamlab
from slamlab.evaluation import ate, run
from slamlab.evaluation.run import Run
from slamlab.localization import DeadReckoning
from slamlab.logs import Log
from slamlab.robots import Unicycle

u, truth = np.ones((3, 2)), np.zeros((3, 3))
log = Log(np.arange(1.0, 4.0), u, np.ones(3), 0.01 * np.eye(2), truth=truth)
result: Run = run(DeadReckoning(Unicycle(), [0.0, 0.0, 0.0]), log)
error: float = ate(result, log.truth).rmse
version: str = slamlab.__version__
"""
WRONG = CLIENT.replace("error: float = ate", "error: str = ate")


@pytest.fixture
def client(tmp_path):
    """A folder with the client, and an environment in which only the package itself is named."""
    package = tmp_path / "site" / "slamlab"
    package.parent.mkdir()
    package.symlink_to(ROOT / "slamlab", target_is_directory=True)
    (tmp_path / "right.py").write_text(CLIENT)
    (tmp_path / "wrong.py").write_text(WRONG)
    return tmp_path


def test_the_client_runs(client):
    environment = os.environ | {"PYTHONPATH": str(client / "site")}
    words = [sys.executable, "right.py"]
    done = subprocess.run(words, cwd=client, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_mypy_reads_the_types_from_outside(client):
    pytest.importorskip("mypy")
    environment = os.environ | {"PYTHONPATH": str(client / "site"), "MYPYPATH": ""}

    def says(name):
        words = [sys.executable, "-m", "mypy", "--config-file=", "--strict", name]
        return subprocess.run(words, cwd=client, env=environment, capture_output=True, text=True)

    right, wrong = says("right.py"), says("wrong.py")
    assert right.returncode == 0, right.stdout
    assert "Incompatible types in assignment" in wrong.stdout
    # Without the marker file the types of a package count for nothing.
    (client / "site" / "slamlab").unlink()
    unmarked = shutil.ignore_patterns("py.typed", "data", "__pycache__")
    shutil.copytree(ROOT / "slamlab", client / "site" / "slamlab", ignore=unmarked)
    assert "py.typed marker" in says("right.py").stdout


def test_pyright_reads_the_types_from_outside(client):
    pytest.importorskip("pyright")
    words = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable]
    environment = os.environ | {"PYRIGHT_PYTHON_IGNORE_WARNINGS": "1"}
    (client / "pyrightconfig.json").write_text('{"extraPaths": ["site"]}')

    def says(name):
        command = [*words, "--outputjson", str(client / name)]
        done = subprocess.run(
            command, cwd=client, env=environment, capture_output=True, text=True, timeout=300
        )
        if '"version"' not in done.stdout:
            pytest.skip("pyright cannot fetch what it runs on")
        return done

    right, wrong = says("right.py"), says("wrong.py")
    assert right.returncode == 0, right.stdout
    assert "is not assignable to" in wrong.stdout
