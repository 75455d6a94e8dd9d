"""Sphinx extension: next and previous lead from lesson to lesson.

Exercises and solutions stand under their chapter in the sidebar, but somebody who reads on wants
the next chapter.
"""

from typing import Any

ASIDE = ("notebooks/exercises/", "notebooks/solutions/")


def neighbour(relations: dict[str, list[str | None]], page: str, way: int) -> str | None:
    """Return the next (way 2) or previous (way 1) page of the book that is no exercise."""
    other = relations.get(page, [None] * 3)[way]
    while other is not None and other.startswith(ASIDE):
        other = relations.get(other, [None] * 3)[way]
    return other


def lead(app: Any, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Give the page the neighbours of a lesson; exercises keep their own."""
    if tree is None or page.startswith(ASIDE):
        return
    for name, way in (("prev", 1), ("next", 2)):
        other = neighbour(app.builder.relations, page, way)
        context[name] = other and {
            "link": app.builder.get_relative_uri(page, other),
            "title": app.builder.render_partial(app.env.titles[other])["title"],
        }


def setup(app: Any) -> dict[str, bool]:
    """Register."""
    app.connect("html-page-context", lead)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
