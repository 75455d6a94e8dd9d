"""Sweep: one or two sliders over precomputed results, with curves, scatter, bars and images.

The data are checked and packed here, the drawing is in `sweep.js` and `shared.js`.
Used where a chapter asks how an answer changes with a parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_choice, as_finite_or_nan, as_scalar, as_shaped
from slamlab.widgets import _pack
from slamlab.widgets._pack import Figure, script

__all__ = ["Bars", "Curves", "Image", "Scatter", "Sweep"]

KINDS = (
    "truth", "dead_reckoning", "estimate", "landmark", "particle", "lidar", "wall", "wrong",
)  # fmt: skip
_DEFAULT_KINDS = ("estimate", "dead_reckoning", "lidar", "wrong", "truth", "wall")


@dataclass(frozen=True)
class Curves:
    """A panel of curves over one axis.

    Attributes
    ----------
    title : str
        What the panel shows.
    x : array_like (n,)
        The common axis.
    series : mapping of str to array_like, shape ``(*grid, n)``
        Values by label, NaN for a gap; without the grid axes the curve is constant.
    x_label, y_label : str
        Names of the axes with unit.
    kinds : mapping of str to str
        The course's encoding by label, such as ``"truth"`` or ``"wrong"``.
    markers : bool
        Draw the points too.
    y_log, x_log : bool
        Logarithmic axes.

    Examples
    --------
    >>> Curves("decay", [0, 1, 2], {"error": [1.0, 0.5, 0.25]}, "step", "error (m)").title
    'decay'
    """

    title: str
    x: ArrayLike
    series: Mapping[str, ArrayLike]
    x_label: str
    y_label: str
    kinds: Mapping[str, str] = field(default_factory=dict)
    markers: bool = False
    y_log: bool = False
    x_log: bool = False

    def _pack(self, grid: tuple[int, ...]) -> dict[str, Any]:
        name = f"{self.title}: x"
        x = _logarithm(name, as_array(name, self.x, ("n",)), self.x_log)
        values = _series(self.title, self.series, grid, (len(x),))
        values = {k: _logarithm(f"{self.title}: {k}", v, self.y_log) for k, v in values.items()}
        margin = 0.04 * (x.max(initial=0.0) - x.min(initial=0.0))
        x_range = _range([x]) if len(x) < 2 else [x.min() - margin, x.max() + margin]
        return {
            "type": "curves",
            **_frame(self, values, _pack.pack_series),
            "x": _pack.pack_series(x),
            "box": [float(v) for v in (*x_range, *_range(list(values.values()), 0.06))],
            "markers": bool(self.markers),
            "x_log": bool(self.x_log),
            "y_log": bool(self.y_log),
        }


@dataclass(frozen=True)
class Bars:
    """A panel of bars over one axis, such as a belief over the cells of a corridor.

    Attributes
    ----------
    title : str
        What the panel shows.
    x : array_like (n,)
        Centres of the bars, increasing and evenly spaced.
    series : mapping of str to array_like, shape ``(*grid, n)``
        Heights by label; without the grid axes they are constant.
    x_label, y_label : str
        Names of the axes with unit.
    kinds : mapping of str to str
        The course's encoding by label.

    Examples
    --------
    >>> Bars("belief", [0, 1, 2], {"posterior": [0.2, 0.5, 0.3]}, "cell", "probability").title
    'belief'
    """

    title: str
    x: ArrayLike
    series: Mapping[str, ArrayLike]
    x_label: str
    y_label: str
    kinds: Mapping[str, str] = field(default_factory=dict)

    def _pack(self, grid: tuple[int, ...]) -> dict[str, Any]:
        x = as_array(f"{self.title}: x", self.x, ("n",))
        if len(x) == 0 or (np.diff(x) <= 0).any():
            raise ValueError(f"{self.title}: x: expected increasing centres of bars, got {x}")
        values = _series(self.title, self.series, grid, (len(x),))
        width = float(np.diff(x).min()) if len(x) > 1 else 1.0
        low, high = _range([np.zeros(1), *values.values()])
        room = 0.06 * (high - low)
        return {
            "type": "bars",
            **_frame(self, values, _pack.pack_series),
            "x": _pack.pack_series(x),
            "width": width,
            "box": [x[0] - width, x[-1] + width, low - room * (low < 0), high + room],
        }


@dataclass(frozen=True)
class Scatter:
    """A panel of points of the plane, or of lines through them.

    Attributes
    ----------
    title : str
        What the panel shows.
    series : mapping of str to array_like, shape ``(*grid, n, 2)``
        Points by label, NaN hides a point or breaks a line; without the grid axes constant.
    x_label, y_label : str
        Names of the axes with unit.
    kinds : mapping of str to str
        The course's encoding by label.
    equal : bool
        Same scale on both axes, as anything on the floor needs.
    lines : bool
        Join the points.

    Examples
    --------
    >>> Scatter("cloud", {"particles": [[0.0, 1.0], [0.5, 0.5]]}).title
    'cloud'
    """

    title: str
    series: Mapping[str, ArrayLike]
    x_label: str = "x (m)"
    y_label: str = "y (m)"
    kinds: Mapping[str, str] = field(default_factory=dict)
    equal: bool = True
    lines: bool = False

    def _pack(self, grid: tuple[int, ...]) -> dict[str, Any]:
        values = _series(self.title, self.series, grid, ("n", 2))
        xs = _range([v[..., 0] for v in values.values()], 0.05)
        ys = _range([v[..., 1] for v in values.values()], 0.05)
        return {
            "type": "scatter",
            **_frame(self, values, _pack.pack_numbers),
            "box": [*xs, *ys],
            "equal": bool(self.equal),
            "lines": bool(self.lines),
        }


@dataclass(frozen=True)
class Image:
    """A panel with an image: ink is `high`, paper is `low`, as in an occupancy map.

    Attributes
    ----------
    title : str
        What the panel shows.
    image : array_like, shape ``(*grid, H, W)``
        Values, row 0 at the bottom; without the grid axes the image is constant.
    extent : sequence of four floats
        x low, x high, y low, y high of the image in metres.
    low, high : float
        Values drawn as paper and as ink (white and black; in a dark theme the other way round).

    Examples
    --------
    >>> Image("map", [[0.0, 1.0], [0.5, 0.5]], extent=[0, 2, 0, 2]).title
    'map'
    """

    title: str
    image: ArrayLike
    extent: Sequence[float]
    low: float = 0
    high: float = 1

    def _pack(self, grid: tuple[int, ...]) -> dict[str, Any]:
        low = as_scalar(f"{self.title}: low", self.low)
        high = as_scalar(f"{self.title}: high", self.high)
        if not low < high:
            raise ValueError(f"{self.title}: low: expected less than high {high:g}, got {low:g}")
        name = f"{self.title}: image"
        values = _on_grid(name, as_array(name, self.image), grid, ("H", "W"))
        extent = _pack.box(f"{self.title}: extent", self.extent)
        return {
            "type": "image",
            "title": _pack.text("title", self.title),
            "x_label": "x (m)",
            "y_label": "y (m)",
            "box": extent,
            "extent": extent,
            "equal": True,
            "kinds": {},
            "series": {"image": _pack.pack_image(values, low, high)},
        }


Panel = Curves | Bars | Scatter | Image


class Sweep(Figure):
    """Sliders over precomputed results: nothing is recomputed, so no kernel is needed.

    Parameters
    ----------
    sliders : mapping of str to array_like (n,)
        One or two sliders: name with unit, such as ``"noise (m)"``, and the values it takes.
        Their lengths are the grid of all results, in this order.
    panels : sequence of Curves, Bars, Scatter or Image
        What is drawn, one panel at least, side by side where there is room.
    numbers : mapping of str to array_like of shape ``(*grid)``, optional
        Numbers shown in a table: label with unit, and the value for each slider position.
    start : sequence of int, optional
        First position of each slider; the middle without it. Negative counts from the end.
    title, question : str
        Name of the figure and the question it answers.

    Attributes
    ----------
    indices : list of int
        Positions of the sliders; follow the figure, and move it when set.
    payload : dict
        What the browser gets.

    Raises
    ------
    ValueError
        If an array fits neither the grid nor a constant. The message names it.

    Examples
    --------
    >>> x = np.linspace(0, 1, 5)
    >>> slopes = np.array([0.5, 1.0, 2.0])
    >>> lines = Curves("a line", x, {"slope": slopes[:, None] * x}, "x", "y")
    >>> Sweep({"slope": slopes}, [lines])
    Sweep(slope: 3; 1 panels)
    """

    _esm = script("shared.js", "sweep.js")
    indices = traitlets.List(traitlets.Int()).tag(sync=True)

    def __init__(
        self,
        sliders: Mapping[str, ArrayLike],
        panels: Sequence[Panel],
        numbers: Mapping[str, ArrayLike] | None = None,
        start: Sequence[int] | None = None,
        title: str = "",
        question: str = "",
    ) -> None:
        values = _sliders(sliders)
        grid = tuple(len(v) for v in values.values())
        panels = [panels] if isinstance(panels, Panel) else list(panels)
        if not panels or not all(isinstance(p, Panel) for p in panels):
            wanted = "a list of Curves, Bars, Scatter or Image"
            raise ValueError(f"panels: expected {wanted}, got {panels!r}")
        payload = {
            "sliders": [{"name": k, "values": _exact(v)} for k, v in values.items()],
            "panels": [p._pack(grid) for p in panels],
            "numbers": [_number(k, v, grid) for k, v in (numbers or {}).items()],
        }
        super().__init__(title, question, payload, indices=_first(start, grid))

    def __repr__(self) -> str:
        """Name the sliders and panels: the same text on every machine."""
        names = ", ".join(f"{s['name']}: {len(s['values'])}" for s in self.payload["sliders"])
        return f"Sweep({names}; {len(self.payload['panels'])} panels)"

    @traitlets.validate("indices")
    def _indices_in_range(self, proposal: dict[str, Any]) -> list[int]:
        sliders = self.payload.get("sliders", [])
        given = proposal["value"]
        fits = len(given) == len(sliders) and all(
            0 <= i < len(s["values"]) for i, s in zip(given, sliders, strict=False)
        )
        if sliders and not fits:
            raise ValueError(f"indices: expected a position on each slider, got {given}")
        return list(given)


def _sliders(sliders: Mapping[str, ArrayLike]) -> dict[str, Array]:
    if not isinstance(sliders, Mapping) or len(sliders) not in (1, 2):
        raise ValueError(f"sliders: expected one or two names with values, got {sliders!r}")
    values = {k: as_array(f"sliders[{k!r}]", v, ("n",)) for k, v in sliders.items()}
    for name, steps in values.items():
        if len(steps) == 0:
            raise ValueError(f"sliders[{name!r}]: expected at least one value, got none")
    return values


def _first(start: Sequence[int] | None, grid: tuple[int, ...]) -> list[int]:
    if start is None:
        return [n // 2 for n in grid]
    given = [start] if isinstance(start, int | np.integer) else list(start)
    if len(given) != len(grid) or not all(
        isinstance(i, int | np.integer) and -n <= i < n for i, n in zip(given, grid, strict=False)
    ):
        raise ValueError(f"start: expected a position on each slider of {grid}, got {start!r}")
    return [int(i) % n for i, n in zip(given, grid, strict=True)]


def _series(
    title: str, series: Mapping[str, ArrayLike], grid: tuple[int, ...], rest: tuple[int | str, ...]
) -> dict[str, Array]:
    if not isinstance(series, Mapping) or not series:
        raise ValueError(f"{title}: expected labelled arrays, got {series!r}")
    return {
        label: _on_grid(f"{title}: {label}", value, grid, rest) for label, value in series.items()
    }


def _on_grid(
    name: str, given: ArrayLike, grid: tuple[int, ...], rest: tuple[int | str, ...]
) -> Array:
    """Return the array if it is (*grid, *rest) or the constant (*rest); name it otherwise."""
    values = as_shaped(name, given)
    wanted = rest if values.ndim == len(rest) else (*grid, *rest)
    return as_finite_or_nan(name, values, wanted)


def _frame(
    panel: Any, values: Mapping[str, Array], pack: Callable[[Array], Any]
) -> dict[str, Any]:
    """Texts, encoding and packed values that every panel with series has."""
    title, kinds = panel.title, panel.kinds
    unknown = set(kinds) - set(values)
    if unknown:
        raise ValueError(f"{title}: kinds: expected labels of the series, got {sorted(unknown)}")
    free = [k for k in _DEFAULT_KINDS if k not in kinds.values()] or list(_DEFAULT_KINDS)
    chosen, default = {}, 0
    for label in values:
        if label in kinds:
            chosen[label] = as_choice(f"{title}: kinds[{label!r}]", kinds[label], KINDS)
        else:
            chosen[label] = free[default % len(free)]
            default += 1
    return {
        "title": _pack.text("title", title),
        "x_label": _pack.text("x_label", panel.x_label),
        "y_label": _pack.text("y_label", panel.y_label),
        "kinds": chosen,
        "series": {label: pack(value) for label, value in values.items()},
    }


def _logarithm(name: str, values: Array, wanted: bool) -> Array:
    if not wanted:
        return values
    if not (values > 0).any():
        raise ValueError(f"{name}: expected positive numbers for a logarithmic axis, got none")
    return np.log10(values, out=np.full(values.shape, np.nan), where=values > 0)


def _range(arrays: list[Array], margin: float = 0.0) -> list[float]:
    """Lowest and highest finite number of all arrays, never a single point."""
    finite = np.concatenate([a[np.isfinite(a)].ravel() for a in arrays])
    if not finite.size:
        return [0.0, 1.0]
    low, high = float(finite.min()), float(finite.max())
    room = margin * (high - low) if high > low else 0.5 * abs(high) or 0.5
    return [low - room, high + room]


def _number(name: str, values: ArrayLike, grid: tuple[int, ...]) -> dict[str, Any]:
    given = _on_grid(f"numbers[{name!r}]", values, grid, ())
    return {"name": name, "values": _exact(np.broadcast_to(given, grid).ravel())}


def _exact(values: Array) -> list[float | None]:
    """Six digits as JSON numbers; NaN as null, which JSON can say."""
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in values]
