"""Sphinx extension: plain Markdown links reach an entry of the bibliography.

A notebook says `[Kalman (1960)](../book/bibliography.md#kalman1960new)`, which every reader of
notebooks shows as a link; a `cite` role it would show raw. MyST resolves the part behind `#`
among the headings of the page only, so the keys of the entries are added to them.
"""

import re
from pathlib import Path
from typing import Any

PAGE = "book/bibliography"


def add_keys(app: Any, doctree: Any) -> None:
    """Let MyST find each key of the BibTeX file as an id of the bibliography page."""
    if app.env.docname != PAGE:
        return
    text = Path(app.srcdir, "book", "references.bib").read_text(encoding="utf-8")
    found = app.env.metadata[PAGE].setdefault("myst_slugs", {})
    for key in re.findall(r"(?m)^@\w+\{([\w-]+),", text):
        found.setdefault(key, (0, key, key))


def setup(app: Any) -> dict[str, bool]:
    """Register; `bibtex_cite_id` in _config.yml gives the entries their keys for ids."""
    app.connect("doctree-read", add_keys)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
