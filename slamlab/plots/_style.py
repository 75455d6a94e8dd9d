"""One encoding through the whole course: colours, line styles and the style sheet.

Okabe-Ito colours, and beside every colour a line style or a marker, so that a figure reads
without colour.
"""

from __future__ import annotations

import os
from importlib import resources
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

from slamlab._checks import as_choice

COLOURS = {
    "truth": "#000000",
    "dead_reckoning": "#D55E00",
    "estimate": "#0072B2",
    "landmark": "#000000",
    "particle": "#0072B2",
    "lidar": "#009E73",
    "wall": "#555555",
    "wrong": "#CC79A7",
}

_LINES: dict[str, dict[str, Any]] = {
    "truth": {"linestyle": "-", "linewidth": 1.0},
    "dead_reckoning": {"linestyle": "--", "linewidth": 1.8},
    "estimate": {"linestyle": "-", "linewidth": 1.8},
    "wrong": {"linestyle": "-.", "linewidth": 1.8},
    "lidar": {"linestyle": ":", "linewidth": 1.2},
    "wall": {"linestyle": "-", "linewidth": 2.2},
    "landmark": {"linestyle": "none", "marker": "*"},
    "particle": {"linestyle": "none", "marker": "."},
}


MOST_POINTS = 3000
"""Figures of more points than this stay pixels: as a drawing they would be large."""


def use_style() -> None:
    """Use the course's style sheet, and in a notebook draw at twice the density.

    The environment may ask for less: where SLAMLAB_VECTOR is set, as when the book is built,
    figures of few points are drawings (SVG) instead; where SLAMLAB_TEXT_ONLY is set, as when
    only texts are compared, no figure is drawn.
    """
    sheet = resources.files("slamlab.plots") / "slamlab.mplstyle"
    with resources.as_file(sheet) as path:
        matplotlib.style.use(path)
    try:
        from IPython import get_ipython
        from matplotlib_inline.backend_inline import set_matplotlib_formats
    except ImportError:
        return
    shell = get_ipython()
    if shell is None:
        return
    set_matplotlib_formats(*([] if os.environ.get("SLAMLAB_TEXT_ONLY") else ["retina"]))
    if os.environ.get("SLAMLAB_VECTOR"):
        formatters = shell.display_formatter.formatters
        formatters["image/svg+xml"].for_type(Figure, _drawing)
        pixels = formatters["image/png"].for_type(Figure)
        formatters["image/png"].for_type(Figure, lambda f: pixels(f) if _is_heavy(f) else None)


def _drawing(figure: Figure) -> str | None:
    """Return the figure as SVG; None, which means none, if it has an image or many points."""
    from IPython.core.pylabtools import print_figure

    if _is_heavy(figure):
        return None
    with matplotlib.rc_context({"svg.hashsalt": "slamlab"}):
        return print_figure(figure, "svg", metadata={"Date": None})


def _is_heavy(figure: Figure) -> bool:
    """Whether a figure has an image or more than `MOST_POINTS` points."""
    points = 0
    for axes in figure.axes:
        if axes.images:
            return True
        points += sum(np.size(line.get_xdata()) for line in axes.lines)
        for collection in axes.collections:
            points += sum(np.size(path.vertices) // 2 for path in collection.get_paths())
            points += np.size(collection.get_offsets()) // 2
    return points > MOST_POINTS


def line_style(kind: str) -> dict[str, Any]:
    """Colour and line style of one kind of curve, as keywords for ``Axes.plot``.

    Parameters
    ----------
    kind : str
        A key of `COLOURS`.

    Examples
    --------
    >>> line_style("truth")
    {'color': '#000000', 'linestyle': '-', 'linewidth': 1.0}
    """
    as_choice("kind", kind, tuple(COLOURS))
    return {"color": COLOURS[kind], **_LINES[kind]}
