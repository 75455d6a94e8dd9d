"""The picture after a check: what *yours* gives beside what is expected, also when it fails.

How one writes a picture, in three lines::

    def _drawn(ax, function):                 # the student's function, or the reference
        plots.path(ax, TRUTH, "truth")        # the truth first, then what the function gives
        plots.path(ax, function(*DRIVE))

    check_drive = Check(_drive, ..., picture=_drawn)      # check_drive.draw(drive)
"""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

__all__ = ["Picture", "attempt", "say", "side_by_side"]

Function = Callable[..., Any]
# Draws the truth and what a function gives into axes.
Picture = Callable[[Any, Function], None]


def side_by_side(
    picture: Picture,
    student: Function,
    reference: Function,
    names: tuple[str, str] = ("Yours", "As it should be"),
) -> Any:
    """Draw a picture of the student's function and one of the reference, on one scale.

    Parameters
    ----------
    picture : callable
        ``picture(ax, function)`` draws the truth and what the function gives. What it sets as the
        title, a number say, stands below the title of its panel; its docstring, "Draw ...", is
        the caption.
    student, reference : callable
        Whatever the student's function does is shown, never raised: no result, an exception, a
        result that cannot be drawn.
    names : tuple of str
        Titles of the two panels.

    Returns
    -------
    matplotlib.figure.Figure
        A notebook shows it.
    """
    from matplotlib.figure import Figure  # the checks themselves need numpy only
    from matplotlib.layout_engine import PlaceHolderLayoutEngine

    from slamlab.plots import use_style

    use_style()
    # Not that of the style sheet, which would move the panels when the figure is shown.
    layout = PlaceHolderLayoutEngine(adjust_compatible=True, colorbar_gridspec=True)
    figure = Figure(figsize=(7, 3.4), layout=layout)
    left, right = figure.subplots(1, 2)  # the book stacks them on a phone: it finds the gap
    picture(right, reference)
    message = attempt(partial(picture, left, _watched(student)))
    left.set_aspect(right.get_aspect(), adjustable="box")
    for name in ("xlim", "ylim"):
        low, high = getattr(right, f"get_{name}")()
        for ax in (left, right):
            getattr(ax, f"set_{name}")(low - 0.1 * (high - low), high + 0.1 * (high - low))
    right.set_aspect(right.get_aspect(), adjustable="box")
    left.set(xlabel=right.get_xlabel(), ylabel=right.get_ylabel())
    for ax, whose in zip((left, right), names, strict=True):
        ax.set_title("\n".join(filter(None, [whose, ax.get_title(loc="left")])))
    say(left, message)
    below = _place(left, right)
    what = " ".join((picture.__doc__ or "").removeprefix("Draw ").split())
    if what:
        caption = "\n".join(textwrap.wrap(what[0].upper() + what[1:], 100))
        figure.supxlabel(caption, x=0.02, y=below, ha="left", va="top", fontsize=9, color="0.35")
    return figure


def _place(left: Any, right: Any) -> float:
    """Place two panels of one size, and return where a caption may begin (part of the height).

    What stands round the right one is measured once. With matplotlib's constrained layout, solved
    three times till a picture is shown, a picture takes 1.7 times as long.
    """
    figure = right.figure
    width, height = figure.get_size_inches()
    drawn, box = right.get_tightbbox(for_layout_only=True), right.bbox
    beside, beyond, below = (
        np.array([box.x0 - drawn.x0, drawn.x1 - box.x1, box.y0 - drawn.y0]) / figure.dpi
    )
    gap = beside + beyond + 0.3
    figure.subplots_adjust(
        beside / width, 0.85 / height, 1 - beyond / width, 1 - 0.4 / height,
        wspace=2 * gap / (width - beside - beyond - gap),
    )  # fmt: skip
    for ax in (left, right):
        ax.apply_aspect()
    bottom: float = min(left.bbox.y0, right.bbox.y0) / figure.dpi - below - 0.1
    return bottom / height


def _watched(student: Function) -> Function:
    """Return the function with copies as arguments; NotImplementedError where nothing comes."""

    def watched(*arguments: Any) -> Any:
        came = student(
            *(np.copy(a, subok=True) if isinstance(a, np.ndarray) else a for a in arguments)
        )
        if came is None or came is Ellipsis:
            raise NotImplementedError
        return came

    return watched


def attempt(work: Callable[[], None]) -> str:
    """Draw what a student's code gives; say in words why it cannot be drawn."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            work()
        except NotImplementedError:
            return "nothing returned yet"
        except Exception as error:
            return f"cannot be drawn: {type(error).__name__}: {str(error)[:120]}"
    return ""


def say(ax: Any, message: str) -> None:
    """Write a message, if there is one, into the middle of the axes."""
    if message:
        ax.text(
            0.5, 0.5, "\n".join(textwrap.wrap(message, 36)), transform=ax.transAxes,
            ha="center", va="center", fontsize=9, bbox={"facecolor": "white", "edgecolor": "0.5"},
        )  # fmt: skip
