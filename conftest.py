"""nbval starts kernels without TCP ports (see tools/kernels.py); less garbage is looked for.

pytest --seed-shift K adds 1000 K to every integer seed, as `make seeds` does in the chapters.
Tests marked `needs_numba` are skipped where numba cannot be imported, with the reason they give.
"""

import gc
import os
import sys
from collections.abc import Iterator

import pytest

# A module that stands for numba, of tests that block it.
collect_ignore = ["tests/without_numba"]

# Where notebooks are run: pytest has loaded nbval then, and other tests leave it alone.
if "nbval.plugin" in sys.modules:
    from tools.kernels import settle_nbval

    settle_nbval()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let seeds be moved."""
    parser.addoption("--seed-shift", type=int, default=0, help="add 1000 K to integer seeds")


def pytest_configure(config: pytest.Config) -> None:
    """Move the seeds before any test is imported."""
    shift = config.getoption("--seed-shift", 0)
    if shift:
        from tools.seeds import START_UP, STEP

        os.environ["SLAMLAB_SEED_SHIFT"] = str(STEP * shift)
        exec(START_UP, {})


def pytest_collection_finish() -> None:
    """Spare Python from looking for garbage among thousands of tests that stay to the end."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what is too slow on plain code, or speaks of compiled code, where there is none."""
    marker = item.get_closest_marker("needs_numba")
    if marker is not None:
        from slamlab.kernels import numba_serves

        if not numba_serves():
            pytest.skip(marker.kwargs["reason"])


@pytest.fixture(autouse=True)
def style_left_as_found() -> Iterator[None]:
    """Put back the style: a picture of an exercise sets the one of the course."""
    matplotlib = sys.modules.get("matplotlib")
    if matplotlib is None:
        yield
    else:
        with matplotlib.rc_context():
            yield
