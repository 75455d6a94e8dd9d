"""Replay: play, pause, scrub and step through a run of a robot.

The data are checked and packed here, the drawing is in `replay.js` and `shared.js`.
Used by every chapter in which a robot moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_count, as_index, as_scalar, as_shaped
from slamlab.evaluation.run import Run
from slamlab.widgets import _pack
from slamlab.widgets._pack import Figure, Packed, script

__all__ = ["Replay"]

_PATHS = ("truth", "estimate", "dead_reckoning", "wrong")


class Replay(Figure):
    """An interactive replay of a run: world, paths, estimates with ellipses, particles, lidar.

    All positions are metres in the world frame, angles radians. Every argument may be left out;
    at least one must vary with time (T steps). NaN hides a thing at a step where noted. In a
    one-dimensional world the last axis may be dropped or have length one: it is drawn at y = 0.

    Parameters
    ----------
    times : array_like (T,), optional
        Seconds, increasing. Without it the figure counts steps.
    truth, estimate, dead_reckoning, wrong : array_like (T, 3) or (T, 2), optional
        Poses x, y, theta, or positions. `wrong` is a variant that is shown to fail.
    covs : array_like (T, 2, 2) or (T, 3, 3), optional
        Covariances of the estimate; the 95 % ellipse of the position is drawn.
    landmarks : array_like (n, 2), optional
        True landmarks.
    landmark_estimates : array_like (T, m, 2), optional
        Estimated landmarks, NaN where not yet seen.
    landmark_covs : array_like (T, m, 2, 2), optional
        Their covariances, NaN where not yet seen.
    particles : array_like (T, M, 2) or (T, M, 3), optional
        Particles, with heading if there is a third column.
    scans : array_like (T, k, 2), optional
        Lidar points in the world frame, NaN for a beam without echo.
    accumulate_scans : bool
        Keep the points of all steps so far, so that the scans draw a map.
    beams : bool
        Draw the beams from the robot to the lidar points of the step.
    walls : array_like (k, 2, 2), optional
        Segments of walls, from point to point.
    occupancy : array_like (H, W) or (S, H, W), optional
        Probability of occupancy in [0, 1], row 0 at the bottom; S maps over time.
    occupancy_extent : sequence of four floats, optional
        x low, x high, y low, y high of the map in metres; needed with `occupancy`.
    occupancy_steps : array_like (S,), optional
        The first step at which each of the S maps holds, increasing.
    bounds : sequence of four floats, optional
        x low, x high, y low, y high of the first view; from the data without it.
    captions : sequence of T str, optional
        A sentence for each step, shown below the canvas and read by screen readers.
    title, question : str
        Name of the figure and the question it answers.
    height : int
        Height of the canvas in pixels (less on a narrow screen), 120 at least.
    robot_radius : float
        Radius of the drawn robot in metres.
    fps : float
        Steps a second at normal speed.
    start : int
        First step shown; negative counts from the end.

    Attributes
    ----------
    step : int
        The step that is shown; follows the figure, and moves it when set.
    payload : dict
        What the browser gets.

    Raises
    ------
    ValueError
        If an argument has another shape, another number of steps than the rest, is not finite
        where it must be, or needs another argument that is missing. The message names it.

    Examples
    --------
    >>> path = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    >>> Replay(truth=path, estimate=[[0, 0, 0], [1, 0.1, 0], [2, 0.3, 0]])
    Replay(3 steps of estimate, truth)
    """

    _esm = script("shared.js", "replay.js")
    step = traitlets.Int(0).tag(sync=True)

    def __init__(
        self,
        *,
        times: ArrayLike | None = None,
        truth: ArrayLike | None = None,
        estimate: ArrayLike | None = None,
        dead_reckoning: ArrayLike | None = None,
        wrong: ArrayLike | None = None,
        covs: ArrayLike | None = None,
        landmarks: ArrayLike | None = None,
        landmark_estimates: ArrayLike | None = None,
        landmark_covs: ArrayLike | None = None,
        particles: ArrayLike | None = None,
        scans: ArrayLike | None = None,
        accumulate_scans: bool = False,
        beams: bool = False,
        walls: ArrayLike | None = None,
        occupancy: ArrayLike | None = None,
        occupancy_extent: Sequence[float] | None = None,
        occupancy_steps: ArrayLike | None = None,
        bounds: Sequence[float] | None = None,
        captions: Sequence[str] | None = None,
        title: str = "",
        question: str = "",
        height: int = 420,
        robot_radius: float = 0.2,
        fps: float = 20,
        start: int = 0,
    ) -> None:
        paths = dict(zip(_PATHS, (truth, estimate, dead_reckoning, wrong), strict=True))
        clock = {"times": times, **paths, "covs": covs, "particles": particles, "scans": scans}
        clock |= {"landmark_estimates": landmark_estimates, "captions": captions}
        steps = _steps({**clock, "landmark_covs": landmark_covs}, occupancy_steps)
        _check_needs(covs, estimate, "covs", "estimate")
        _check_needs(landmark_covs, landmark_estimates, "landmark_covs", "landmark_estimates")
        layers = {"landmarks": landmarks, "landmark_estimates": landmark_estimates}
        layers |= {"particles": particles, "scans": scans}
        world = _world(steps, paths | layers, walls)
        arrays = world.copy()
        if covs is not None:
            arrays["ellipses"] = _pack.ellipses("covs", covs, (steps,))
        if landmark_covs is not None:
            shape = world["landmark_estimates"].shape[:2]
            arrays["landmark_ellipses"] = _pack.ellipses("landmark_covs", landmark_covs, shape)
        said = None if captions is None else [_pack.text("captions", c) for c in captions]
        payload: dict[str, Any] = {
            "steps": steps,
            "arrays": {name: _pack.pack_numbers(array) for name, array in arrays.items()},
            "times": None if times is None else _times(times, steps),
            "maps": _maps(occupancy, occupancy_extent, occupancy_steps, steps),
            "captions": said,
            "bounds": _bounds(bounds, list(world.values()), occupancy_extent),
            "accumulate": bool(accumulate_scans),
            "beams": bool(beams),
            "height": as_count("height", height, 120),
            "robot_radius": as_scalar("robot_radius", robot_radius, 0.0, 1e6),
            "fps": as_scalar("fps", fps, 0.1, 240.0),
        }
        first = as_index("start", start, steps, "steps") % steps
        super().__init__(title, question, payload, step=first)

    @classmethod
    def of(cls, run: Run, **options: Any) -> Replay:
        """Replay a run: its poses with their ellipses, beside what its log knows.

        Parameters
        ----------
        run : Run
            What `evaluation.run` returned. True path and landmarks are drawn if its log has them,
            the estimated map if `keep` had "landmarks" (and "landmark_covs"), particles if it
            had "particles" or "poses". Scans are drawn where the robot believed to be.
        **options
            Any argument of `Replay`; it takes the place of what is drawn from the run.

        Raises
        ------
        ValueError
            As `Replay`.
        """
        log, kept = run.log, run.recorded
        shown: dict[str, Any] = {"times": run.times, "estimate": run.poses, "covs": run.covs}
        if log.truth is not None:
            shown["truth"] = run.truth
        if log.landmarks is not None:
            shown["landmarks"] = log.landmarks
        if log.ranges is not None and log.scan is not None:
            shown["scans"] = log.scan.points(log.ranges[run.rows], run.poses)
        for name, argument in (("landmarks", "landmark_estimates"), ("landmark_covs",) * 2):
            if name in kept:
                shown[argument] = _grown(kept[name])
        for name in ("particles", "poses"):
            if name in kept:
                shown["particles"] = np.array(kept[name])
        return cls(**(shown | options))

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


def _world(steps: int, layers: dict[str, Any], walls: ArrayLike | None) -> dict[str, Array]:
    """Return all that lies in the plane and is given, with its number of steps checked."""
    shapes: dict[str, tuple[int | str, ...]] = {"landmarks": ("n",), "particles": (steps, "M")}
    shapes |= {"landmark_estimates": (steps, "m"), "scans": (steps, "k")}
    world = {}
    for name, value in layers.items():
        if value is not None:
            holes = name in ("landmark_estimates", "scans")
            world[name] = _pack.points(name, value, shapes.get(name, (steps,)), holes)
    if walls is not None:
        world["walls"] = as_array("walls", walls, ("k", 2, 2))
    return world


def _steps(clock: dict[str, Any], occupancy_steps: ArrayLike | None) -> int:
    """Return the common number of steps, or name the argument that disagrees."""
    first, steps = "", 0
    for name, value in clock.items():
        if value is None:
            continue
        length = len(value) if name == "captions" else (*as_shaped(name, value).shape, 0)[0]
        if not first:
            first, steps = name, length
        if length != steps:
            raise ValueError(f"{name}: expected {steps} steps as in {first}, got {length}")
        if length == 0:
            raise ValueError(f"{name}: expected at least one step, got none")
    if not first and occupancy_steps is not None:
        return int(as_array("occupancy_steps", occupancy_steps, ("S",)).max(initial=0)) + 1
    if not first:
        raise ValueError("truth: expected at least one argument that varies with time, got none")
    return steps


def _grown(maps: Sequence[Array]) -> Array:
    """Return maps (m_k, ...) that grew from step to step as one array, NaN before."""
    most = max(len(one) for one in maps)
    padded = np.full((len(maps), most, *maps[-1].shape[1:]), np.nan)
    for row, one in zip(padded, maps, strict=True):
        row[: len(one)] = one
    return padded


def _check_needs(value: Any, other: Any, name: str, needed: str) -> None:
    if value is not None and other is None:
        raise ValueError(f"{needed}: expected an array because {name} is given, got None")


def _times(times: ArrayLike, steps: int) -> Packed:
    seconds = as_array("times", times, (steps,))
    least = np.diff(seconds).min(initial=0.0)
    if least < 0:
        raise ValueError(f"times: expected increasing seconds, got a step of {least:g}")
    return _pack.pack_series(seconds)


def _maps(
    occupancy: ArrayLike | None,
    extent: Sequence[float] | None,
    first_steps: ArrayLike | None,
    steps: int,
) -> dict[str, Any] | None:
    if occupancy is None:
        return None
    _check_needs(occupancy, extent, "occupancy", "occupancy_extent")
    given = as_shaped("occupancy", occupancy)
    given = given[None] if given.ndim == 2 else given
    given = as_array("occupancy", given, ("S", "H", "W"))
    if given.size == 0 or given.min() < 0.0 or given.max() > 1.0:
        raise ValueError("occupancy: expected probabilities in [0, 1], got others or an empty map")
    first_steps = np.arange(len(given), dtype=float) if first_steps is None else first_steps
    holds = as_array("occupancy_steps", first_steps, (len(given),))
    if (np.diff(holds) <= 0).any() or holds[0] < 0 or holds[-1] >= steps:
        wanted = f"{len(given)} increasing steps in 0..{steps - 1}"
        got = holds.astype(int).tolist()
        raise ValueError(f"occupancy_steps: expected {wanted}, got {got}")
    return {
        "images": _pack.pack_image(given, 0.0, 1.0),
        "extent": _pack.box("occupancy_extent", extent),
        "steps": [int(h) for h in holds],
    }


def _bounds(
    bounds: Sequence[float] | None, world: list[Array], extent: Sequence[float] | None
) -> list[float]:
    """Return the first view: given, or all that is drawn with a margin of 5 %."""
    if bounds is not None:
        return _pack.box("bounds", bounds)
    clouds = [w[..., :2].reshape(-1, 2) for w in world if w.size]
    if extent is not None:
        clouds.append(np.reshape(_pack.box("occupancy_extent", extent), (2, 2)).T)
    cloud = np.concatenate(clouds) if clouds else np.zeros((1, 2))
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    if not len(cloud):
        return [-1.0, 1.0, -1.0, 1.0]
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    margin = max(0.05 * float((high - low).max()), 0.5)
    return [float(f"{v:.6g}") for v in np.stack([low - margin, high + margin], axis=1).ravel()]
