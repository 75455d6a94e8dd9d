"""Sphinx extension: take thebe's scripts out of every page.

Jupyter Book loads thebe even when it is switched off, declares its address twice (an error in the
console) and would fetch it from the network.
"""

from typing import Any


def drop_thebe(app: Any, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Keep all scripts and styles of a page but thebe's."""

    def is_thebe(asset: Any) -> bool:
        text = f"{getattr(asset, 'filename', asset)} {getattr(asset, 'attributes', '')}"
        return "thebe" in text.lower()

    for kind in ("script_files", "css_files"):
        context[kind] = [asset for asset in context.get(kind, []) if not is_thebe(asset)]


def setup(app: Any) -> dict[str, bool]:
    """Register after every other extension."""
    app.connect("html-page-context", drop_thebe, priority=950)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
