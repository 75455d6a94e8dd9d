"""Sphinx extension: a link under each chapter to its notebook, a file of the book's own folder.

It needs no network and no server: the page and the notebook are two files side by side.
"""

from pathlib import PurePosixPath
from typing import Any


def add_link(app: Any, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Append the link to the body of a page that was a notebook."""
    source = context.get("sourcename") or ""
    if context.get("body") and source.endswith(".ipynb"):
        href = context["pathto"](f"_sources/{source}", 1)
        name = PurePosixPath(source).name
        context["body"] += (
            f'<p class="download-notebook"><a href="{href}" download="{name}">'
            "Download this notebook</a></p>\n"
        )


def setup(app: Any) -> dict[str, bool]:
    """Register."""
    app.connect("html-page-context", add_link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
