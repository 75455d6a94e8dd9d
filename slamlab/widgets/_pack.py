"""Arrays as short text, so that an interactive figure fits into a static page.

Positions become 16-bit numbers (one part in 65 534 of their range), images 8-bit runs, all in
base64 inside the JSON of the widget. `shared.js` unpacks them. Serves `replay` and `sweep`.
"""

from __future__ import annotations

import base64
import json
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import anywidget
import numpy as np
import traitlets

from slamlab._checks import Array, as_array, as_covariance, as_finite_or_nan, as_scalar, as_shaped
from slamlab.gaussian import chi2_quantile

MISSING = -32768
"""The 16-bit code of NaN."""

Packed = dict[str, Any]


def script(*names: str) -> str:
    """Return files of this folder joined to one text (an ECMAScript module or a style sheet)."""
    folder = resources.files("slamlab.widgets")
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in names)


class Figure(anywidget.AnyWidget):
    """An interactive figure: what the browser draws is all in `payload`."""

    _css = script("widgets.css")
    payload = traitlets.Dict().tag(sync=True)

    def __init__(self, title: str, question: str, payload: dict[str, Any], **state: Any) -> None:
        words = {"title": text("title", title), "question": text("question", question)}
        super().__init__(payload=payload | words, **state)

    @property
    def html(self) -> str:
        """The figure as a piece of HTML that needs no kernel, no network and nothing beside it."""
        names = set(self.class_traits(sync=True)) - set(
            anywidget.AnyWidget.class_traits(sync=True)
        )
        state = json.dumps({name: getattr(self, name) for name in sorted(names)})
        code = str(self._esm).replace("export default { render };", "")
        return (
            f"<style>{self._css}</style><div id='figure'></div>\n"
            f"<script type='module'>{code}\n"
            f"const state = {state.replace('</', '<' + chr(92) + '/')};\n"
            "const model = { get: (k) => state[k], set: (k, v) => { state[k] = v; },\n"
            "  save_changes() {}, on() {}, off() {} };\n"
            "render({ model, el: document.getElementById('figure') });</script>\n"
        )

    def save(self, path: str | Path) -> Path:
        """Write the figure as one HTML file to show without a notebook, offline.

        Parameters
        ----------
        path : str or Path
            For example "my_drive.html".

        Returns
        -------
        Path

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        title = escape(str(self.payload["title"]) or type(self).__name__)
        head = f'<meta charset="utf-8"><title>{title}</title>'
        head += '<meta name="viewport" content="width=device-width, initial-scale=1">'
        path = Path(path)
        page = f'<!doctype html>\n<html lang="en"><head>{head}</head><body>\n{self.html}</body>\n'
        path.write_text(page + "</html>\n", encoding="utf-8")
        return path


def pack_numbers(values: Array) -> Packed:
    """Pack numbers (..., c) as 16-bit steps of each column's range; NaN stays NaN."""
    columns = values.reshape(-1, values.shape[-1]) if values.ndim else values.reshape(1, 1)
    seen = np.isfinite(columns)
    low = np.where(seen, columns, np.inf).min(axis=0, initial=np.inf)
    high = np.where(seen, columns, -np.inf).max(axis=0, initial=-np.inf)
    low, high = np.where(seen.any(axis=0), [low, high], 0.0)
    middle, scale = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-12) / 32767
    codes = np.round((np.where(seen, columns, middle) - middle) / scale)
    codes = np.where(seen, codes, MISSING).astype("<i2")
    return {
        "type": "i2",
        "shape": list(values.shape),
        "middle": _short(middle),
        "scale": _short(scale),
        "data": _base64(codes.tobytes()),
    }


def pack_series(values: Array) -> Packed:
    """Pack numbers of any shape over one common range: the last axis is no column."""
    packed = pack_numbers(values.reshape(-1, 1))
    return {**packed, "shape": list(values.shape)}


def pack_image(values: Array, low: float, high: float) -> Packed:
    """Pack images (..., H, W) as 64 grey levels in runs (count, level)."""
    levels = np.round((np.clip(values, low, high) - low) / (high - low) * 63) * 4
    flat = levels.astype(np.uint8).ravel()
    return {"type": "runs", "shape": list(values.shape), "data": _base64(_runs(flat))}


def _runs(flat: np.ndarray) -> bytes:
    """Run-length code: pairs of a count (1..255) and a value."""
    if not flat.size:
        return b""
    starts = np.flatnonzero(np.r_[True, flat[1:] != flat[:-1]])
    lengths = np.diff(np.r_[starts, flat.size])
    pieces = -(-lengths // 255)
    counts = np.full(pieces.sum(), 255, dtype=np.uint8)
    counts[np.cumsum(pieces) - 1] = lengths - 255 * (pieces - 1)
    return np.stack([counts, np.repeat(flat[starts], pieces)], axis=1).tobytes()


def ellipses(name: str, covs: Any, shape: tuple[int | str, ...]) -> Array:
    """Half axes and angle (..., 3) of the 95 % ellipses of covariances, NaN where unseen.

    The variance of a one-dimensional world gives an interval: a flat ellipse.
    """
    given = as_shaped(name, covs)
    size = given.shape[-1] if given.ndim and given.shape[-1] in (1, 3) else 2
    given = as_shaped(name, given, (*shape, size, size))
    missing = np.asarray(np.isnan(given).any(axis=(-2, -1)))
    filled = np.where(missing[..., None, None], 0.0, given)[..., :2, :2]
    plane = np.zeros((*missing.shape, 2, 2))
    plane[..., : min(size, 2), : min(size, 2)] = as_covariance(name, filled)
    spread, directions = np.linalg.eigh(plane)
    half = np.sqrt(np.maximum(spread, 0.0) * float(chi2_quantile(0.95, min(size, 2))))
    angle = np.arctan2(directions[..., 1, 1], directions[..., 0, 1])
    axes = np.stack([half[..., 1], half[..., 0], angle], axis=-1)
    return np.where(missing[..., None], np.nan, axes)


def points(name: str, value: Any, shape: tuple[int | str, ...], missing: bool = False) -> Array:
    """Points (..., 2) of the plane; the points of a one-dimensional world get y = 0."""
    given = as_shaped(name, value)
    if given.ndim == len(shape):
        given = given[..., None]
    other = given.ndim == len(shape) + 1 and given.shape[-1] in (1, 3)
    check = as_finite_or_nan if missing else as_array
    given = check(name, given, (*shape, given.shape[-1] if other else 2))
    if given.shape[-1] == 1:
        given = np.concatenate([given, np.zeros_like(given)], axis=-1)
    return given.astype(np.float64, copy=False)


def box(name: str, value: Any) -> list[float]:
    """Four finite numbers (x low, x high, y low, y high) that span an area."""
    limits = as_array(name, value, (4,))
    if not (limits[0] < limits[1] and limits[2] < limits[3]):
        raise ValueError(f"{name}: expected x low < x high and y low < y high, got {value!r}")
    return [as_scalar(name, v) for v in limits]


def text(name: str, value: Any) -> str:
    """Return `value` if it is a string."""
    if not isinstance(value, str):
        raise ValueError(f"{name}: expected a string, got {value!r}")
    return value


def _short(values: Array) -> list[float]:
    return [float(f"{v:.9g}") for v in np.atleast_1d(values)]


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
