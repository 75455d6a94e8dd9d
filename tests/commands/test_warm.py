"""`warm` compiles what lessons call."""

import subprocess
import sys

import pytest

from slamlab.commands import main

# In a process of its own, where no other test has called a loop before.
CALLED = """
from slamlab.commands import main
main(["warm"])
import importlib, pkgutil
from slamlab import kernels
for found in pkgutil.iter_modules(kernels.__path__):
    module = importlib.import_module("slamlab.kernels." + found.name)
    for name, value in vars(module).items():
        if getattr(value, "signatures", None):
            print("warm", name, len(value.signatures))
"""


def test_warm_says_how_long_each_kind_of_loop_took(capsys):
    assert main(["warm"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5
    assert all(line.endswith(" s") for line in lines)


@pytest.mark.needs_numba(reason="there is nothing to compile")
def test_warm_runs_the_loops_that_lessons_call():
    done = subprocess.run(
        [sys.executable, "-c", CALLED], capture_output=True, text=True, check=True
    )
    words = [line.split() for line in done.stdout.splitlines() if line.startswith("warm")]
    warm = {name: int(count) for _, name, count in words}
    asked = "align splat branch_and_bound search"
    asked += " arc_length_table points_at nearest wavefront unknown_area"
    asked += " grid_clearance"
    assert set(asked.split()) <= set(warm)
    # Fields of points hold single precision, maps double: a loop for each.
    assert warm["gauss_newton"] == 2
