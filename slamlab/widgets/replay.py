"""Replay: play, pause, scrub and step through a run of a robot.

What is drawn is checked in `layers.py` and packed here, the drawing is in `replay.js` and
`shared.js`. Used by every chapter in which a robot moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_count, as_index, as_instance, as_scalar, as_tuple
from slamlab.evaluation.run import Run
from slamlab.widgets import _pack
from slamlab.widgets._pack import Figure, Packed, script
from slamlab.widgets.layers import (
    ARGUMENTS,
    FIXED,
    Landmarks,
    Layer,
    LidarPoints,
    Particles,
    Paths,
)

__all__ = ["Replay"]


class Replay(Figure):
    """An interactive replay of a run: paths, estimates with ellipses, particles, lidar, maps.

    Parameters
    ----------
    run : Run, Paths or another layer
        A run shows its poses with their ellipses, true path and landmarks if its log has them,
        the estimated map if `record` had "landmarks" (and "landmark_covs"), the particles if it
        had "particles" or "poses", and its scans where the robot believed to be.
    *layers : Paths, Landmarks, Particles, LidarPoints, WallSegments or Occupancy
        What else is drawn. What a layer gives takes the place of the same from the run or from a
        layer before; estimates given without `covs` are drawn without ellipses. All must
        have one number of steps T, and one of them must vary with time.
    times : array_like (T,), optional
        Seconds, increasing; those of the run without it. Where there is neither, the figure
        counts steps.
    captions : sequence of T str, optional
        A sentence for each step, shown below the canvas and read by screen readers.
    bounds : sequence of four floats, optional
        x low, x high, y low, y high of the first view (m); from the data without it.
    title, question : str
        Name of the figure and the question it answers.
    height : int, default 420
        Height of the canvas in pixels (less on a narrow screen), 120 at least.
    robot_radius : float, default 0.2
        Radius of the drawn robot (m).
    fps : float, default 20
        Steps a second at normal speed.
    start : int, default 0
        First step shown; negative counts from the end.

    Attributes
    ----------
    step : int
        The step that is shown; follows the figure, and moves it when set.
    payload : dict
        What the browser gets.

    Examples
    --------
    >>> path = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    >>> Replay(Paths(truth=path, estimate=[[0, 0, 0], [1, 0.1, 0], [2, 0.3, 0]]))
    Replay(3 steps of estimate, truth)
    """

    _esm = script("shared.js", "replay.js")
    step = traitlets.Int(0).tag(sync=True)

    def __init__(
        self,
        run: Run | Layer,
        *layers: Layer,
        times: ArrayLike | None = None,
        captions: Sequence[str] | None = None,
        bounds: Sequence[float] | None = None,
        title: str = "",
        question: str = "",
        height: int = 420,
        robot_radius: float = 0.2,
        fps: float = 20,
        start: int = 0,
    ) -> None:
        shown = _layers_of(run) if isinstance(run, Run) else [_layer("run", run)]
        shown += [_layer("layers", one) for one in layers]
        times = run.times if isinstance(run, Run) and times is None else times
        arrays, settings = _merged(shown)
        said = captions
        if captions is not None:
            said = [_pack.text("captions", one) for one in as_tuple("captions", captions)]
        seconds = None if times is None else as_array("times", times, ("T",))
        steps = _steps(arrays, seconds, said, settings["maps"])
        payload: dict[str, Any] = {
            "steps": steps,
            "arrays": {name: _pack.pack_numbers(array) for name, array in arrays.items()},
            "times": None if seconds is None else _times(seconds),
            "maps": settings["maps"],
            "captions": said,
            "bounds": _bounds(bounds, arrays, settings["maps"]),
            "accumulate": settings["accumulate"],
            "beams": settings["beams"],
            "height": as_count("height", height, 120),
            "robot_radius": as_scalar("robot_radius", robot_radius, 0.0, 1e6),
            "fps": as_scalar("fps", fps, 0.1, 240.0),
        }
        first = as_index("start", start, steps, "steps") % steps
        super().__init__(title, question, payload, step=first)

    def __repr__(self) -> str:
        """Name the figure, its steps and its layers: the same text on every machine."""
        shown = sorted(self.payload["arrays"]) + (["occupancy"] if self.payload["maps"] else [])
        return f"Replay({self.payload['steps']} steps of {', '.join(shown) or 'captions'})"

    @traitlets.validate("step")
    def _step_in_range(self, proposal: dict[str, Any]) -> int:
        if self.payload and not 0 <= proposal["value"] < self.payload["steps"]:
            last = self.payload["steps"] - 1
            raise ValueError(f"step: expected 0 to {last}, got {proposal['value']}")
        return int(proposal["value"])


def _layer(name: str, value: Any) -> Layer:
    wanted = "a layer such as Paths(estimate=poses)"
    layer: Layer = as_instance(
        name, value, Layer, wanted if name == "layers" else f"a Run or {wanted}"
    )
    return layer


def _layers_of(run: Run) -> list[Layer]:
    """Return what a run shows: its poses with their ellipses, beside what its log knows."""
    log, kept = run.log, run.recorded
    truth = None if log.truth is None else run.truth
    found, covs = (_grown(kept.get(name)) for name in ("landmarks", "landmark_covs"))
    layers: list[Layer] = [
        Paths(truth=truth, estimate=run.poses, covs=run.covs),
        Landmarks(log.landmarks, found, covs),
    ]
    if log.ranges is not None and log.scan is not None:
        layers.append(LidarPoints(log.scan.points(log.ranges[run.rows], run.poses)))
    for name in ("particles", "poses"):
        if name in kept:
            layers.append(Particles(np.array(kept[name])))
    return layers


def _merged(layers: Sequence[Layer]) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return all arrays and settings; those of a later layer take the place of the same before."""
    drawn: dict[str, Array | None] = {}
    settings: dict[str, Any] = {"maps": None, "accumulate": False, "beams": False}
    for layer in layers:
        drawn |= layer._arrays()
        settings |= layer._settings()
    return {name: a for name in ARGUMENTS if (a := drawn.get(name)) is not None}, settings


def _grown(maps: Sequence[Array] | None) -> Array | None:
    """Return maps (m_k, ...) that grew from step to step as one array, NaN before."""
    if maps is None:
        return None
    most = max(len(one) for one in maps)
    padded = np.full((len(maps), most, *maps[-1].shape[1:]), np.nan)
    for row, one in zip(padded, maps, strict=True):
        row[: len(one)] = one
    return padded


def _steps(
    arrays: dict[str, Array],
    times: Array | None,
    captions: Sequence[str] | None,
    maps: dict[str, Any] | None,
) -> int:
    """Return the common number of steps, or name what disagrees."""
    lengths = {ARGUMENTS[name]: len(array) for name, array in arrays.items() if name not in FIXED}
    if times is not None:
        lengths["times"] = len(times)
    if captions is not None:
        lengths["captions"] = len(captions)
    if not lengths and maps is not None:
        lengths["Occupancy.steps"] = maps["steps"][-1] + 1
    if not lengths:
        raise ValueError("layers: expected at least one that varies with time, got none")
    (first, steps), *others = lengths.items()
    if steps == 0:
        raise ValueError(f"{first}: expected at least one step, got none")
    for name, length in others:
        if length != steps:
            raise ValueError(f"{name}: expected {steps} steps as in {first}, got {length}")
    if maps is not None and maps["steps"][-1] >= steps:
        wanted = f"steps in 0 to {steps - 1}"
        raise ValueError(f"Occupancy.steps: expected {wanted}, got {maps['steps']}")
    return steps


def _times(times: Array) -> Packed:
    least = np.diff(times).min(initial=0.0)
    if least < 0:
        raise ValueError(f"times: expected increasing seconds, got a step of {least:g}")
    return _pack.pack_series(times)


def _bounds(
    bounds: Sequence[float] | None, arrays: dict[str, Array], maps: dict[str, Any] | None
) -> list[float]:
    """Return the first view: given, or all that is drawn with a margin of 5 %."""
    if bounds is not None:
        return _pack.box("bounds", bounds)
    flat = [array for name, array in arrays.items() if not name.endswith("ellipses")]
    clouds = [array[..., :2].reshape(-1, 2) for array in flat if array.size]
    if maps is not None:
        clouds.append(np.reshape(maps["extent"], (2, 2)).T)
    cloud = np.concatenate(clouds) if clouds else np.zeros((1, 2))
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    if not len(cloud):
        return [-1.0, 1.0, -1.0, 1.0]
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    margin = max(0.05 * float((high - low).max()), 0.5)
    return [float(f"{v:.6g}") for v in np.stack([low - margin, high + margin], axis=1).ravel()]
