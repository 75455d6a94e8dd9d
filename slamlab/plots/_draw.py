"""Drawing helpers: each takes the axes first and draws one thing in the course's encoding."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_choice, as_instance, as_scalar, as_shaped
from slamlab.gaussian import confidence_ellipse
from slamlab.plots._style import COLOURS, line_style


def path(
    ax: Axes, poses: ArrayLike, kind: str = "estimate", label: str | None = None, **style: Any
) -> Line2D:
    """Draw a path of poses (n, 3) or points (n, 2), in metres, as a line of the given kind.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> line = path(plt.gca(), [[0, 0, 0], [1, 0.5, 0.1]], kind="truth", label="truth")
    >>> floor(plt.gca())
    >>> plt.close()
    """
    poses = as_shaped("poses", poses, ("n", None))
    style = line_style(kind) | style
    return _axes(ax).plot(poses[:, 0], poses[:, 1], label=_label(label), **style)[0]


def ellipse(
    ax: Axes, mean: ArrayLike, cov: ArrayLike, kind: str = "estimate", probability: float = 0.95
) -> Polygon:
    """Draw the confidence ellipse of a planar belief, filled at 20 %.

    Parameters
    ----------
    ax : Axes
    mean : array_like, shape (2,) or (3,)
        Only x and y are drawn (m).
    cov : array_like, shape (2, 2) or (3, 3)
    kind : str
        A key of `COLOURS`.
    probability : float

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> patch = ellipse(plt.gca(), [1.0, 2.0], [[0.04, 0.0], [0.0, 0.01]])
    >>> plt.close()
    """
    as_choice("kind", kind, tuple(COLOURS))
    mean = as_array("mean", mean, ("n",))[:2]
    cov = as_array("cov", cov, ("n", "n"))[:2, :2]
    outline = confidence_ellipse(mean, cov, probability).points()
    patch = Polygon(outline, closed=True, facecolor=COLOURS[kind] + "33", edgecolor=COLOURS[kind])
    _axes(ax).add_patch(patch)
    ax.update_datalim(outline)
    return patch


def landmarks(
    ax: Axes, points: ArrayLike, estimated: bool = False, label: str | None = None
) -> Line2D:
    """Draw landmarks (n, 2): true ones as black star outlines, estimated ones as blue crosses.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> drawn = landmarks(plt.gca(), [[1.0, 2.0], [3.0, 1.0]])
    >>> plt.close()
    """
    points = as_shaped("points", points, ("n", 2))
    if estimated:
        return _dots(ax, points, label, "x", color=COLOURS["estimate"], markersize=7)
    return _dots(ax, points, label, "*", color=COLOURS["landmark"], markersize=11, mfc="none")


def particles(ax: Axes, poses: ArrayLike, label: str | None = None) -> Line2D:
    """Draw particles (n, 2) or (n, 3) as blue dots at 25 %.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> drawn = particles(plt.gca(), [[0.0, 1.0, 0.1], [0.2, 0.9, 0.0]])
    >>> plt.close()
    """
    poses = as_array("poses", poses, ("n", None))
    return _dots(ax, poses, label, ".", color=COLOURS["particle"], alpha=0.25, rasterized=True)


def lidar_points(ax: Axes, points: ArrayLike, s: float = 0.5, label: str | None = None) -> Line2D:
    """Draw lidar end points (..., 2), in metres; NaN (no echo) is left out.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> drawn = lidar_points(plt.gca(), [[1.0, 2.0], [float("nan"), 0.0]])
    >>> plt.close()
    """
    points = as_shaped("points", points, ("...", 2)).reshape(-1, 2)
    style = {"markersize": as_scalar("s", s, 0.0), "markeredgewidth": 0, "rasterized": True}
    return _dots(ax, points, label, "o", color=COLOURS["lidar"], **style)


def walls(ax: Axes, segments: ArrayLike, label: str | None = None) -> LineCollection:
    """Draw walls (k, 2, 2), two end points each, in metres.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> drawn = walls(plt.gca(), [[[0, 0], [2, 0]], [[2, 0], [2, 1]]])
    >>> plt.close()
    """
    segments = as_array("segments", segments, ("k", 2, 2))
    style = line_style("wall")
    lines = LineCollection(list(segments), colors=style["color"], linewidths=style["linewidth"])
    lines.set_label(_label(label) or "_nolegend_")
    _axes(ax).add_collection(lines)
    ax.autoscale_view()
    return lines


def floor(ax: Axes) -> None:
    """Make the axes a floor plan: equal scale, metres.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> floor(plt.gca())
    >>> plt.gca().get_aspect()
    1.0
    """
    _axes(ax).set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("x (m)")
    ax.set_ylabel("y (m)")


def error_band(
    ax: Axes, t: ArrayLike, error: ArrayLike, sigma: ArrayLike, label: str, kind: str = "estimate"
) -> Line2D:
    """Draw an error over time with the +-2 sigma tube that the filter reports.

    Parameters
    ----------
    ax : Axes
    t, error, sigma : array_like, shape (n,)
        Time (s), error and reported standard deviation, in one unit.
    label : str
    kind : str
        A key of `COLOURS`.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> line = error_band(plt.gca(), [0, 1, 2], [0.1, -0.1, 0.0], [0.1, 0.1, 0.1], "x")
    >>> plt.close()
    """
    t = as_array("t", t, ("n",))
    error = as_shaped("error", error, (len(t),))
    sigma = as_shaped("sigma", sigma, (len(t),))
    as_choice("kind", kind, tuple(COLOURS))
    _axes(ax).fill_between(
        t, -2 * sigma, 2 * sigma, color=COLOURS[kind], alpha=0.2, lw=0, label="reported ±2σ"
    )
    ax.axhline(0.0, color="0.3", lw=0.8)
    return ax.plot(t, error, label=_label(label), **line_style(kind))[0]


def occupancy(ax: Axes, probability: ArrayLike, extent: ArrayLike) -> AxesImage:
    """Draw an occupancy map: white free, grey unknown, black occupied.

    Parameters
    ----------
    ax : Axes
    probability : array_like, shape (rows, columns)
        Probability that a cell is occupied; row 0 at the bottom.
    extent : array_like, shape (4,)
        Left, right, bottom, top (m).

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> image = occupancy(plt.gca(), [[0.0, 0.5], [0.5, 1.0]], extent=[0, 2, 0, 2])
    >>> plt.close()
    """
    probability = as_array("probability", probability, ("rows", "columns"))
    left, right, bottom, top = as_array("extent", extent, (4,))
    extent = (left, right, bottom, top)
    style: dict[str, Any] = {"cmap": "gray_r", "origin": "lower", "interpolation": "nearest"}
    image = _axes(ax).imshow(probability, vmin=0.0, vmax=1.0, extent=extent, **style)
    ax.grid(False)
    floor(ax)
    return image


def _axes(ax: Axes) -> Axes:
    """Return what is drawn on, if it is that: who leaves it out gets a sentence."""
    return as_instance("ax", ax, Axes, "the axes to draw on, as from plt.subplots(),")


def _dots(ax: Axes, points: Array, label: str | None, marker: str, **style: Any) -> Line2D:
    """Draw a marker at each of points (n, 2 and more)."""
    x, y = points[:, 0], points[:, 1]
    return _axes(ax).plot(x, y, marker=marker, ls="none", label=_label(label), **style)[0]


def _label(label: str | None) -> str | None:
    """Return one label as text, whatever it is: of a list matplotlib makes one for each line."""
    return None if label is None else str(label)
