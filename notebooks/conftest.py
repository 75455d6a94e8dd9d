"""Outputs are kept and compared as text: the table of a report is its HTML form."""

import contextlib
import os

os.environ.setdefault("SLAMLAB_TEXT_ONLY", "1")  # kernels inherit it: no figure is looked at here

with contextlib.suppress(ImportError):  # a student may have the notebooks alone
    from tools.kernels import find_fonts

    find_fonts()


def pytest_collectstart(collector):
    """Tell nbval to leave out HTML, which `tools/notebooks.py slim` takes out."""
    if hasattr(collector, "skip_compare"):
        collector.skip_compare += ("text/html",)
