"""Relations between poses measured by hand, the reference of the SLAM benchmark.

Kuemmerle, Steder, Dornhege, Ruhnke, Grisetti, Stachniss and Kleiner 2009. `relation_error` of
`slamlab.evaluation` judges a path by them; chapter 13 tells what they see and what not.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamlab._checks import Array, cut
from slamlab._files import read_bytes

__all__ = ["Relations", "read_relations"]


class Relations(NamedTuple):
    """Relative poses between pairs of moments.

    Attributes
    ----------
    times : ndarray, shape (m, 2)
        The two moments (s).
    measurements : ndarray, shape (m, 3)
        Pose of the second moment seen from the first (m, m, rad).
    """

    times: Array
    measurements: Array


def read_relations(path: str | Path) -> Relations:
    r"""Read a file of relations, plain or ``.gz``: a line ``t_i t_j x y z roll pitch yaw`` each.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Relations
        z, roll and pitch are left out.

    Raises
    ------
    ValueError
        If the file is damaged or empty; the message names the line.
    FileNotFoundError
        If there is no such file.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "court.relations"
    >>> _ = path.write_text("0.0 2.0 1.5 0.1 0 0 0 0.2\n")
    >>> read_relations(path).measurements.tolist()
    [[1.5, 0.1, 0.2]]
    """
    path = Path(path)
    data = read_bytes(path)
    table = numbers_of(data.decode("utf-8", errors="replace"), path.name, 8)
    return Relations(table[:, :2].copy(), table[:, [2, 3, 7]])


def numbers_of(text: str, name: str, count: int) -> Array:
    """Table of `count` numbers a line; ``#`` begins a comment. ValueError names a bad line."""
    rows = []
    for number, words in _lines(text):
        try:
            row = [float(word) for word in words]
        except ValueError as error:
            raise ValueError(f"{name}: line {number}: expected numbers, {cut(error)}") from error
        if len(row) != count:
            raise ValueError(f"{name}: line {number}: expected {count} numbers, got {len(row)}")
        if not np.isfinite(row).all():
            raise ValueError(f"{name}: line {number}: expected finite numbers")
        rows.append(row)
    if not rows:
        raise ValueError(f"{name}: the file ends without a line of {count} numbers")
    return np.array(rows)


def line_of(text: str, row: int) -> int:
    """Return the number of the line of row `row` of the table of `numbers_of`."""
    return [number for number, _ in _lines(text)][row]


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield number and words of each line that says something."""
    for number, line in enumerate(text.split("\n"), start=1):
        words = line.split()
        if words and not words[0].startswith("#"):
            yield number, words
