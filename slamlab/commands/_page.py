"""One HTML page that needs nothing beside it: what a command leaves for people to read.

`page(title, table(...), picture(...))` gives the text; the caller writes it to a file.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable
from html import escape
from io import BytesIO
from typing import Any

_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem;
       color: #222; background: #fff; overflow-wrap: break-word; }
table { border-collapse: collapse; margin: 1rem 0; }
th, td { text-align: left; padding: .25rem .75rem; border-bottom: 1px solid #ccc; }
.picture { overflow-x: auto; }
img { max-width: 100%; background: #fff; }
@media (max-width: 600px) { .picture img { width: 540px; max-width: none; } }
@media (prefers-color-scheme: dark) {
  body { color: #ddd; background: #16181c; }
  th, td { border-color: #444; }
}
"""


def page(title: str, *parts: str) -> str:
    """Return the text of a page with this title over the parts, each of them HTML.

    Parameters
    ----------
    title : str
        Plain text.
    *parts : str
        HTML, as `table`, `picture` and `paragraph` give it.

    Returns
    -------
    str
    """
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style>'
    view = '<meta name="viewport" content="width=device-width, initial-scale=1">'
    body = "\n".join([f"<h1>{escape(title)}</h1>", *parts])
    return f'<!doctype html>\n<html lang="en"><head>{head}{view}</head>\n<body>\n{body}\n</body>\n'


def paragraph(text: str) -> str:
    """Show plain text as a paragraph."""
    return f"<p>{escape(text)}</p>"


def table(rows: Iterable[Iterable[object]]) -> str:
    """Show rows of cells as a table; the first cell of each row names it."""
    lines = []
    for first, *others in rows:
        cells = "".join(f"<td>{escape(str(cell))}</td>" for cell in others)
        lines.append(f'<tr><th scope="row">{escape(str(first))}</th>{cells}</tr>')
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def png_of(figure: Any) -> bytes:
    """Return a figure of matplotlib as a PNG image."""
    data = BytesIO()
    figure.savefig(data, format="png", dpi=150)
    return data.getvalue()


def picture(png: bytes, alt: str) -> str:
    """Put a PNG image into the page itself, with the text for those who do not see it."""
    data = base64.b64encode(png).decode()
    return f'<p class="picture"><img alt="{escape(alt)}" src="data:image/png;base64,{data}"></p>'
