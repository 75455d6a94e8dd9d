"""Outputs are kept and compared as text: the table of a report is its HTML form."""

import contextlib

with contextlib.suppress(ImportError):  # lists the machine's fonts, once: a cell would say so
    import matplotlib.font_manager  # noqa: F401


def pytest_collectstart(collector):
    """Tell nbval to leave out HTML, which `tools/notebooks.py slim` takes out."""
    if hasattr(collector, "skip_compare"):
        collector.skip_compare += ("text/html",)
