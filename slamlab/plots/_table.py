"""Tables of results: a Markdown table in the notebook and in the book, plain text in a terminal.

The entries come from computed values, so that nbval compares what the prose claims.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from slamlab._checks import as_tuple


class Table:
    """A table that displays itself.

    Parameters
    ----------
    columns : sequence of str
        Column heads; Markdown and ``$math$`` may be used.
    rows : iterable of sequences
        One entry a column. Floats are shown with four significant digits.
    caption : str, optional
        One line above the table.

    Examples
    --------
    >>> Table(["filter", "NEES"], [["EKF", 2.9], ["printed", 14.0]])
    filter   NEES
    -------  ----
    EKF      2.9
    printed  14
    """

    def __init__(
        self, columns: Sequence[str], rows: Iterable[Sequence[Any]], caption: str = ""
    ) -> None:
        self.columns = [str(c) for c in as_tuple("columns", columns)]
        self.rows = [[_text(e) for e in as_tuple("rows", row)] for row in as_tuple("rows", rows)]
        self.caption = caption
        for number, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                wanted = f"{len(self.columns)} entries in row {number}"
                raise ValueError(f"rows: expected {wanted}, got {len(row)}")

    def __repr__(self) -> str:
        """Return the same table as plain text."""
        lines = [self.columns, *self.rows]
        widths = [max(len(line[i]) for line in lines) for i in range(len(self.columns))]
        text = ["  ".join(e.ljust(w) for e, w in zip(line, widths, strict=True)) for line in lines]
        text.insert(1, "  ".join("-" * w for w in widths))
        return "\n".join([*([self.caption] if self.caption else []), *(t.rstrip() for t in text)])

    def _repr_markdown_(self) -> str:
        head = [f"**{self.caption}**", ""] if self.caption else []
        rule = "|" + " --- |" * len(self.columns)
        rows = ["| " + " | ".join(row) + " |" for row in self.rows]
        return "\n".join([*head, "| " + " | ".join(self.columns) + " |", rule, *rows])


def _text(entry: Any) -> str:
    if isinstance(entry, bool | np.bool_):
        return "yes" if entry else "no"
    if isinstance(entry, float | np.floating):
        return f"{entry:.4g}"
    return str(entry).replace("\n", " ")
