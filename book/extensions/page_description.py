"""Sphinx extension: the first sentences of a page describe it to search engines and previews."""

import textwrap
from html import escape
from typing import Any

from docutils import nodes

LONGEST = 155  # letters that a search engine shows


def description(tree: Any) -> str:
    """Return the beginning of the first paragraph that stands under a heading of its own."""
    for paragraph in tree.findall(nodes.paragraph):
        if isinstance(paragraph.parent, nodes.section | nodes.document):
            return textwrap.shorten(paragraph.astext(), LONGEST, placeholder=" ...")
    return ""


def describe(app: Any, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Add the description to the head of a page."""
    if tree is not None and (said := description(tree)):
        tag = f'<meta name="description" content="{escape(said)}">\n'
        context["metatags"] = context.get("metatags", "") + tag


def setup(app: Any) -> dict[str, bool]:
    """Register."""
    app.connect("html-page-context", describe)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
