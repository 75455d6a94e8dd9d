"""Sphinx extension: pages that carry what a reader sees, and no more.

Half of the tokens of a listing have the colour of the listing itself (names, points, blanks): they
need no element of their own. The hundred pages of the library's source code are listings that one
comes to from the API and leaves again: they get a line of links instead of the book's sidebars.
"""

import re
from typing import Any

SAME_COLOUR = re.compile(r'<span class="[npw]">([^<]*)</span>')


def plain(body: str) -> str:
    """Unwrap the tokens whose colour is that of their listing."""
    return SAME_COLOUR.sub(r"\1", body)


def make_lean(
    app: Any, page: str, template: str, context: dict[str, Any], tree: Any
) -> str | None:
    """Unwrap tokens; name the template of the source pages."""
    is_source = page.startswith("_modules/")
    if is_source:
        context["sidebars"] = []
    if context.get("body"):
        context["body"] = plain(context["body"])
        if is_source:  # wide lines scroll, with the keyboard too
            context["body"] = context["body"].replace("<pre>", '<pre tabindex="0">')
    return "source.html" if is_source else None


def setup(app: Any) -> dict[str, bool]:
    """Register."""
    # Before the theme, which would write all links of the book for sidebars that nobody shows.
    app.connect("html-page-context", make_lean, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
