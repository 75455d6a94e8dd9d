"""Sphinx extension: two processes write pages while the first one resolves their references.

Pages are read by one: the extension `sphinx_jupyterbook_latex` allows no more.
"""

from typing import Any


def setup(app: Any) -> dict[str, bool]:
    """From the moment on when all pages are read, there are three processes."""
    app.connect("env-check-consistency", lambda app, environment: setattr(app, "parallel", 3))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
