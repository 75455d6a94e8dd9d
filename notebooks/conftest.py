"""Outputs are kept and compared as text: the table of a report is its HTML form."""


def pytest_collectstart(collector):
    """Tell nbval to leave out HTML, which `tools/notebooks.py slim` takes out."""
    if hasattr(collector, "skip_compare"):
        collector.skip_compare += ("text/html",)
