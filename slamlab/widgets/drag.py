"""Sighting, ScanDrag, WallDrag: things of a figure are dragged, an algorithm answers in the page.

The algorithms run in `sighting.js`, `scan_drag.js` and `wall_drag.js`; tests hold them against the
library's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import as_array, as_count, as_rng, as_scalar
from slamlab.matching import PointsWithNormals
from slamlab.widgets import _pack
from slamlab.widgets._pack import Figure, script

__all__ = ["ScanDrag", "Sighting", "WallDrag"]

HEADINGS = (1, 2, 5, 10, 20, 30, 40)
"""Standard deviations of the heading (degrees) that the slider of `Sighting` offers."""

GATES = (0.1, 0.2, 0.3, 0.5, 0.8, 1.2)
"""Gates (m) that the slider of `ScanDrag` offers."""

SIGMAS = (0.01, 0.02, 0.05, 0.1, 0.2)
"""Noises of a range (m) that the slider of `WallDrag` offers."""


class Sighting(Figure):
    """A robot drives straight and blindly, then sees one landmark; drag both and watch the EKF.

    Beside the extended filter's ellipses stand sampled robots, weighed by the same sighting: the
    belief that the filter approximates. The robot's true heading follows from where it stands.

    Parameters
    ----------
    way : float, default 10.0
        Length of the blind drive from the origin along x (m).
    sigma_position : float, default 0.1
        Standard deviation of the start, each coordinate (m).
    heading : {1, 2, 5, 10, 20, 30, 40}, default 20
        Standard deviation of the heading at the start (degrees); a slider changes it.
    sigma_range, sigma_bearing : float
        Noise of the sensor (m, rad).
    robot, landmark : array_like, shape (2,)
        Where both stand at first (m).
    n_robots : int, default 4000
        How many robots are sampled.
    rng : numpy.random.Generator, optional
        Draws them; seed 0 without it.
    title, question : str
        Name of the figure and the question it answers.

    Attributes
    ----------
    payload : dict
        What the browser gets.

    Examples
    --------
    >>> Sighting(heading=10)
    Sighting(10 m blind, heading to 10 degrees)
    """

    _esm = script("shared.js", "drag.js", "sighting.js")

    def __init__(
        self,
        way: float = 10.0,
        sigma_position: float = 0.1,
        heading: int = 20,
        sigma_range: float = 0.1,
        sigma_bearing: float = np.deg2rad(1.0),
        robot: ArrayLike = (9.0, 4.0),
        landmark: ArrayLike = (14.0, 3.0),
        n_robots: int = 4000,
        rng: np.random.Generator | None = None,
        title: str = "",
        question: str = "",
    ) -> None:
        if heading not in HEADINGS:
            raise ValueError(f"heading: expected one of {HEADINGS} (degrees), got {heading!r}")
        way = as_scalar("way", way, 0.1, 1e4)
        rng = np.random.default_rng(0) if rng is None else as_rng("rng", rng)
        normals = rng.standard_normal((as_count("n_robots", n_robots, 10), 3))
        half = 0.75 * way
        spread = [as_scalar("sigma_position", sigma_position, 1e-6, 1e4)] * 2
        payload: dict[str, Any] = {
            "way": way,
            "spread": [*spread, float(np.deg2rad(heading))],
            "headings": list(HEADINGS),
            "sigmas": [
                as_scalar("sigma_range", sigma_range, 1e-6, 1e4),
                as_scalar("sigma_bearing", sigma_bearing, 1e-6, np.pi),
            ],
            "robot": as_array("robot", robot, (2,)).tolist(),
            "landmark": as_array("landmark", landmark, (2,)).tolist(),
            "normals": _pack.pack_numbers(normals),
            "bounds": [-0.05 * way, 1.75 * way, -half, half],
        }
        super().__init__(title, question, payload)

    def __repr__(self) -> str:
        """Name the drive: the same text on every machine."""
        heading = np.rad2deg(self.payload["spread"][2])
        return f"Sighting({self.payload['way']:g} m blind, heading to {heading:.0f} degrees)"


class ScanDrag(Figure):
    """A scan that lies on another one: drag it, turn it, and let ICP bring it back.

    Parameters
    ----------
    reference : array_like, shape (m, 2), or PointsWithNormals
        Points of the first scan (m), at least 3 of them on walls; those off walls are left out.
    points : array_like, shape (k, 2)
        Points of the second scan in the frame of the robot (m).
    truth : array_like, shape (3,)
        Where the robot was (m, m, rad).
    start : array_like, shape (3,), optional
        Where the scan lies at first; at the truth without it.
    gate : {0.1, 0.2, 0.3, 0.5, 0.8, 1.2}, default 0.5
        Farther neighbours (m) are no partners; a slider changes it.
    width : float, default 0.05
        As in `matching.match_icp` (m).
    bounds : sequence of four floats, optional
        x low, x high, y low, y high of the view; from the reference without it.
    title, question : str
        Name of the figure and the question it answers.

    Attributes
    ----------
    payload : dict
        What the browser gets.

    Examples
    --------
    >>> x, y = np.linspace(0, 3, 31), np.linspace(0, 2, 21)
    >>> corner = np.vstack([np.stack([x, 0 * x], -1), np.stack([0 * y, y], -1)])
    >>> ScanDrag(corner, corner, truth=[0, 0, 0], start=[0.3, 0.1, 0.1])
    ScanDrag(52 points on 48)
    """

    _esm = script("shared.js", "drag.js", "scan_drag.js")

    def __init__(
        self,
        reference: ArrayLike | PointsWithNormals,
        points: ArrayLike,
        truth: ArrayLike,
        start: ArrayLike | None = None,
        gate: float = 0.5,
        width: float = 0.05,
        bounds: Sequence[float] | None = None,
        title: str = "",
        question: str = "",
    ) -> None:
        outline = (
            reference
            if isinstance(reference, PointsWithNormals)
            else PointsWithNormals.estimate(reference)
        )
        on_wall = np.isfinite(outline.normals[:, 0])
        if on_wall.sum() < 3:
            raise ValueError("reference: expected at least 3 points on walls, got fewer")
        if gate not in GATES:
            raise ValueError(f"gate: expected one of {GATES} (m), got {gate!r}")
        base = outline.points[on_wall]
        points = as_array("points", points, ("k", 2))
        truth = as_array("truth", truth, (3,))
        start = truth if start is None else as_array("start", start, (3,))
        if bounds is None:
            low, high = base.min(axis=0) - 0.5, base.max(axis=0) + 0.5
            bounds = [low[0], high[0], low[1], high[1]]
        payload: dict[str, Any] = {
            "reference": _pack.pack_numbers(base),
            "normals": _pack.pack_numbers(outline.normals[on_wall]),
            "points": _pack.pack_numbers(points),
            "truth": truth.tolist(),
            "start": start.tolist(),
            "gates": list(GATES),
            "gate": GATES.index(gate),
            "width": as_scalar("width", width, 1e-6, 1e6),
            "bounds": _pack.box("bounds", bounds),
        }
        super().__init__(title, question, payload)

    def __repr__(self) -> str:
        """Name the sizes: the same text on every machine."""
        k, m = (self.payload[name]["shape"][0] for name in ("points", "reference"))
        return f"ScanDrag({k} points on {m})"


class WallDrag(Figure):
    """A wall before a lidar: drag its ends, and see what the fitted line claims and how it errs.

    The line is that of `mapping.fit_line`, its band that of `mapping.line_cov`. Thin lines are
    fitted to other scans of the same wall: where they lie says whether the claim is right.

    Parameters
    ----------
    ends : array_like, shape (2, 2), optional
        Where the wall begins and ends at first, in the frame of the lidar (m).
    sigma : {0.01, 0.02, 0.05, 0.1, 0.2}, default 0.05
        Noise of a range (m); a slider changes it.
    n_beams : int, default 360
        Beams all round.
    n_scans : int, default 20
        How many scans are drawn.
    rng : numpy.random.Generator, optional
        Draws their noise; seed 0 without it.
    title, question : str
        Name of the figure and the question it answers.

    Attributes
    ----------
    payload : dict
        What the browser gets.

    Examples
    --------
    >>> WallDrag(ends=[[2, -1], [2, 1]])
    WallDrag(20 scans of 360 beams)
    """

    _esm = script("shared.js", "drag.js", "wall_drag.js")

    def __init__(
        self,
        ends: ArrayLike = ((-0.5, 2.0), (0.5, 2.0)),
        sigma: float = 0.05,
        n_beams: int = 360,
        n_scans: int = 20,
        rng: np.random.Generator | None = None,
        title: str = "",
        question: str = "",
    ) -> None:
        if sigma not in SIGMAS:
            raise ValueError(f"sigma: expected one of {SIGMAS} (m), got {sigma!r}")
        n_beams = as_count("n_beams", n_beams, 8, 3600)
        n_scans = as_count("n_scans", n_scans, 2, 100)
        rng = np.random.default_rng(0) if rng is None else as_rng("rng", rng)
        payload: dict[str, Any] = {
            "ends": as_array("ends", ends, (2, 2)).tolist(),
            "sigmas": list(SIGMAS),
            "sigma": SIGMAS.index(sigma),
            "beams": np.linspace(-np.pi, np.pi, n_beams, endpoint=False).round(6).tolist(),
            "scans": _pack.pack_series(rng.standard_normal((n_scans, n_beams))),
            "bounds": [-4.0, 4.0, -1.0, 5.0],
        }
        super().__init__(title, question, payload)

    def __repr__(self) -> str:
        """Name the sizes: the same text on every machine."""
        n_scans, n_beams = self.payload["scans"]["shape"]
        return f"WallDrag({n_scans} scans of {n_beams} beams)"
