"""One encoding through the whole course: colours, line styles and the style sheet.

Okabe-Ito colours, and beside every colour a line style or a marker, so that a figure reads
without colour.
"""

from __future__ import annotations

from importlib import resources
from typing import Any

import matplotlib.style

from slamlab._checks import as_choice

__all__ = ["COLOURS", "line_style", "use_style"]

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


def use_style() -> None:
    """Use the course's style sheet, and in a notebook draw at twice the density."""
    sheet = resources.files("slamlab.plots") / "slamlab.mplstyle"
    with resources.as_file(sheet) as path:
        matplotlib.style.use(path)
    try:
        from IPython import get_ipython
        from matplotlib_inline.backend_inline import set_matplotlib_formats
    except ImportError:
        return
    if get_ipython() is not None:
        set_matplotlib_formats("retina")


def line_style(kind: str) -> dict[str, Any]:
    """Colour and line style of one kind of curve, as keywords for ``Axes.plot``.

    Parameters
    ----------
    kind : str
        A key of `COLOURS`.

    Raises
    ------
    ValueError
        If the kind is unknown.

    Examples
    --------
    >>> line_style("truth")
    {'color': '#000000', 'linestyle': '-', 'linewidth': 1.0}
    """
    as_choice("kind", kind, tuple(COLOURS))
    return {"color": COLOURS[kind], **_LINES[kind]}
