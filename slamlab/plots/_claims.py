"""Claims on trial: the verdict follows from a number and a criterion that both stand there."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from operator import eq, ge, gt, le, lt, ne
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import as_shaped, as_tuple
from slamlab.plots._table import Table

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_COMPARE = re.compile(rf"(<=|>=|==|!=|<|>) {_NUMBER}(?: .*)?")
_BAND = re.compile(rf"(in|outside) \[{_NUMBER}, {_NUMBER}\](?: .*)?")
_HOLDS = {"<": lt, "<=": le, ">": gt, ">=": ge, "==": eq, "!=": ne}


def claims(rows: Iterable[Sequence[Any]]) -> Table:
    """Return the table *claim | paper's number | ours | holds if | verdict* of every chapter.

    The verdict is computed: *confirmed* if the criterion holds for our number (for all of them if
    there are several; NaN holds for nothing), else *refuted*; *unsupported* if there is no number
    to compare, and then the fourth entry says why.

    Parameters
    ----------
    rows : iterable of sequences of 4
        Claim; the paper's number ("none given" where there is none); ours, a number, an array of
        numbers, or None; and the criterion under which the claim holds, such as ``"<= 0.56 m"``,
        ``"== 0"``, ``"in [2.18, 3.97]"`` or ``"outside [2.18, 3.97]"``: a comparison with a
        number, then a blank and a unit if you like.

    Examples
    --------
    >>> claims([
    ...     ("the map is exact", "none given", 0.31, "<= 0.05 m"),
    ...     ("97 of 100 find home", "97 %", [98, 99], ">= 97 %"),
    ...     ("it is fast", "100 ms", None, "their computer is not ours"),
    ... ])
    claim                paper's number  ours       holds if                    verdict
    -------------------  --------------  ---------  --------------------------  -----------
    the map is exact     none given      0.31       <= 0.05 m                   refuted
    97 of 100 find home  97 %            98 ... 99  >= 97 %                     confirmed
    it is fast           100 ms          no number  their computer is not ours  unsupported
    """
    table = []
    for number, row in enumerate(as_tuple("rows", rows)):
        row = as_tuple("rows", row)
        if len(row) != 4:
            raise ValueError(f"rows: expected 4 entries in row {number}, got {len(row)}")
        claim, paper, ours, criterion = row
        if ours is None:
            table.append((claim, paper, "no number", criterion, "unsupported"))
        else:
            verdict = "confirmed" if _holds(ours, str(criterion)) else "refuted"
            table.append((claim, paper, _shown(ours), criterion, verdict))
    return Table(("claim", "paper's number", "ours", "holds if", "verdict"), table)


def _holds(ours: ArrayLike, criterion: str) -> bool:
    values = as_shaped("ours", ours)
    if match := _COMPARE.fullmatch(criterion):
        return bool(np.all(_HOLDS[match[1]](values, float(match[2])) & ~np.isnan(values)))
    if match := _BAND.fullmatch(criterion):
        inside = (values >= float(match[2])) & (values <= float(match[3]))
        return bool(np.all(inside if match[1] == "in" else ~inside & ~np.isnan(values)))
    wanted = "such as '<= 0.5 m', '== 0' or 'in [1, 2]'"
    raise ValueError(f"criterion: expected {wanted}, got {criterion!r:.80}")


def _shown(ours: ArrayLike) -> str:
    """Three digits, and none of what differs from machine to machine: rounding, divergence."""
    values = as_shaped("ours", ours)
    if values.size == 0 or not np.isfinite(values).all():
        return "diverged" if values.size else "nothing"
    low, high = _digits(float(values.min())), _digits(float(values.max()))
    return low if low == high else f"{low} ... {high}"


def _digits(value: float) -> str:
    if value == 0 or abs(value) >= 1e-8:
        return f"{value:.3g}" if abs(value) < 1e5 else f"{value:.1e}"
    return "below 1e-8"
