"""Sphinx extension: pages under book/ru say that they are Russian, for voices and translators."""

from typing import Any


def language(page: str) -> str:
    """Return the language of a page by its folder, or nothing for the book's own."""
    return "ru" if page.startswith("book/ru/") else ""


def mark(app: Any, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Wrap the body of a page in its language."""
    if language(page) and context.get("body"):
        context["body"] = f'<div lang="{language(page)}">{context["body"]}</div>'


def setup(app: Any) -> dict[str, bool]:
    """Register."""
    app.connect("html-page-context", mark)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
