"""A terminal is told when compiling takes long, once; programs that keep what is printed never."""

import io
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from slamlab import _compiling
from slamlab._compiling import _Notice

ROOT = Path(__file__).resolve().parents[1]
SENTENCE = "slamlab: compiling, once; the code is kept for later runs\n"


class Terminal(io.StringIO):
    def isatty(self):
        return True


def compiling(notice, seconds, module="slamlab.worlds._cast"):
    """What numba tells while it compiles a function, and another one inside it."""
    event = SimpleNamespace(
        data={"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__=module))}
    )
    notice.on_start(event)
    notice.on_start(event)
    time.sleep(seconds)
    notice.on_end(event)
    notice.on_end(event)


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setattr(_compiling, "_PATIENCE", 0.05)
    monkeypatch.delenv("SLAMLAB_QUIET", raising=False)
    stderr = Terminal()
    monkeypatch.setattr(_compiling, "sys", SimpleNamespace(stderr=stderr))
    return stderr


def test_a_long_compilation_is_said_once(terminal):
    notice = _Notice()
    compiling(notice, 0.2)
    compiling(notice, 0.2)
    assert terminal.getvalue() == SENTENCE


def test_short_ones_and_those_of_others_are_not_said(terminal):
    compiling(_Notice(), 0.0)
    compiling(_Notice(), 0.2, module="somebody.else")
    time.sleep(0.1)
    assert terminal.getvalue() == ""


def test_quiet_hushes_it(terminal, monkeypatch):
    monkeypatch.setenv("SLAMLAB_QUIET", "1")
    compiling(_Notice(), 0.2)
    assert terminal.getvalue() == ""


def test_a_notebook_is_not_told(terminal, monkeypatch):
    kept = io.StringIO()
    monkeypatch.setattr(_compiling, "sys", SimpleNamespace(stderr=kept))
    compiling(_Notice(), 0.2)
    assert kept.getvalue() == ""


def test_every_compiled_loop_is_cached_and_watched():
    for path in (ROOT / "slamlab").rglob("*.py"):
        text = path.read_text()
        assert text.count("@njit") == text.count("@njit(cache=True"), path
        assert "numba import" not in text or path.name == "_compiling.py", path


FRESH = """
import slamlab._compiling as c, sys
c._PATIENCE = 0.0
sys.stderr.isatty = lambda: True
from slamlab.filters import _sweeps
import numpy as np
for _ in range(2):
    _sweeps.recur(np.ones((1, 1, 2, 2)), np.zeros(3, int), np.ones((3, 1, 2)))
print(sum(_sweeps.recur.stats.cache_hits.values()))
"""


def test_a_second_run_compiles_nothing(tmp_path):
    command = [sys.executable, "-c", FRESH]
    for first in (True, False):
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=200, check=True, cwd=ROOT,
            env={"NUMBA_CACHE_DIR": str(tmp_path), "PATH": "", "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        assert done.stderr == (SENTENCE if first else "")
        assert done.stdout == ("0\n" if first else "1\n")
