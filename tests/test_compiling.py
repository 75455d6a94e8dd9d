"""A terminal is told when compiling takes long, once; programs that keep what is printed never."""

import io
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from slamlab.kernels import compiling, numba_serves
from slamlab.kernels.compiling import _Notice

ROOT = Path(__file__).resolve().parents[1]
SENTENCE = "slamlab: compiling, once; the code is kept for later runs\n"


class Terminal(io.StringIO):
    def isatty(self):
        return True


def compile_for(notice, seconds, module="slamlab.kernels.cast"):
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
    monkeypatch.setattr(compiling, "_PATIENCE", 0.05)
    monkeypatch.delenv("SLAMLAB_QUIET", raising=False)
    stderr = Terminal()
    monkeypatch.setattr(compiling, "sys", SimpleNamespace(stderr=stderr))
    return stderr


def test_a_long_compilation_is_said_once(terminal):
    notice = _Notice()
    compile_for(notice, 0.2)
    compile_for(notice, 0.2)
    assert terminal.getvalue() == SENTENCE


def test_short_ones_and_those_of_others_are_not_said(terminal):
    compile_for(_Notice(), 0.0)
    compile_for(_Notice(), 0.2, module="somebody.else")
    time.sleep(0.1)
    assert terminal.getvalue() == ""


def test_quiet_hushes_it(terminal, monkeypatch):
    monkeypatch.setenv("SLAMLAB_QUIET", "1")
    compile_for(_Notice(), 0.2)
    assert terminal.getvalue() == ""


def test_a_notebook_is_not_told(terminal, monkeypatch):
    kept = io.StringIO()
    monkeypatch.setattr(compiling, "sys", SimpleNamespace(stderr=kept))
    compile_for(_Notice(), 0.2)
    assert kept.getvalue() == ""


def test_every_compiled_loop_is_cached_and_watched():
    for path in (ROOT / "slamlab").rglob("*.py"):
        text = path.read_text()
        assert text.count("@njit") == text.count("@njit(cache=True"), path
        assert "import numba" not in text or path.name == "compiling.py", path
        assert "njit" not in text or path.parent.name == "kernels", path


FRESH = """
import slamlab.kernels.compiling as c, sys
c._PATIENCE = 0.0
sys.stderr.isatty = lambda: True
from slamlab.kernels.linear import solve3
import numpy as np
for _ in range(2):
    solve3(np.eye(3), np.ones(3), np.ones(3))
print(sum(solve3.stats.cache_hits.values()))
"""


@pytest.mark.needs_numba(reason="there is nothing to compile")
def test_a_second_run_compiles_nothing(tmp_path):
    command = [sys.executable, "-c", FRESH]
    for first in (True, False):
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=200, check=True, cwd=ROOT,
            env={"NUMBA_CACHE_DIR": str(tmp_path), "PATH": "", "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        assert done.stderr == (SENTENCE if first else "")
        assert done.stdout == ("0\n" if first else "1\n")


WITHOUT_NUMBA = """
import sys, warnings
sys.modules["numba"] = None
import numpy as np
from slamlab import kernels
assert not kernels.numba_serves()

@kernels.compiled("linear.no_such_kernel")
def plain(x):
    return 2 * x

with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    assert plain(3) == 6 and plain(4) == 8
print(len(said), said[0].message)
"""


def test_without_numba_plain_code_serves_and_says_so_once():
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_NUMBA],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    assert done.stdout.startswith("1 numba is not installed: plain NumPy serves")


def test_numba_is_imported_by_the_first_call_of_a_kernel_and_not_before():
    code = (
        "import pkgutil, sys\n"
        "import slamlab.exercises, slamlab.navigation, slamlab.plots, slamlab.slam\n"
        "import slamlab.simulation, slamlab.widgets\n"
        "for one in pkgutil.iter_modules(slamlab.exercises.__path__, 'slamlab.exercises.'):\n"
        "    __import__(one.name)\n"
        "before = 'numba' in sys.modules\n"
        "from slamlab.mapping import OccupancyGrid\n"
        "from slamlab.sensors import Lidar\n"
        "OccupancyGrid((9, 9), 0.1).insert([0.4, 0.4, 0.0], [0.3], Lidar(1))\n"
        "print(before, 'numba' in sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", str(numba_serves())]
