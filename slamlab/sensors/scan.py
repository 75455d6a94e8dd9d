"""How a lidar's beams are laid out: what a map needs to know to read a scan.

Anything with these four attributes (a simulated lidar too) can be given to an occupancy grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_scalar, as_shaped

__all__ = ["ScanGeometry"]


@dataclass(frozen=True, eq=False)
class ScanGeometry:
    """Beams of a planar lidar.

    Parameters
    ----------
    beam_angles : array_like, shape (n_beams,)
        Directions of the beams in the frame of the body (rad).
    max_range : float, default inf
        A range of at least this (m) is a beam that met nothing.
    offset : float, default 0.0
        Distance of the lidar ahead of the body centre (m).

    Raises
    ------
    ValueError
        If there is no beam, a number is not finite, or `max_range` is not positive.
    """

    beam_angles: Array
    max_range: float = np.inf
    offset: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        angles = as_array("beam_angles", self.beam_angles, ("n_beams",))
        if len(angles) == 0:
            raise ValueError("beam_angles: expected at least one beam, got none")
        object.__setattr__(self, "beam_angles", angles)
        as_scalar("max_range", self.max_range, float(np.finfo(float).tiny))
        as_scalar("offset", self.offset, -1e300, 1e300)

    @property
    def n_beams(self) -> int:
        """Number of beams."""
        return len(self.beam_angles)

    def points(self, ranges: ArrayLike, poses: ArrayLike | None = None) -> Array:
        """End points of scans, in the body frame or, with poses, in the world.

        Parameters
        ----------
        ranges : array_like, shape (..., n_beams)
            Measured ranges (m); NaN, or `max_range` and more, is a beam that met nothing.
        poses : array_like, shape (..., 3), optional
            One pose (m, m, rad) a scan.

        Returns
        -------
        ndarray, shape (..., n_beams, 2)
            NaN where a beam met nothing.

        Raises
        ------
        ValueError
            If a shape is wrong or a range is negative.
        """
        ranges = as_shaped("ranges", ranges, ("...", self.n_beams))
        if (ranges < 0).any():
            raise ValueError(f"ranges: expected distances, got {np.nanmin(ranges):g}")
        ranges = np.where(ranges < self.max_range, ranges, np.nan)
        pose = np.zeros(3) if poses is None else as_array("poses", poses, ("...", 3))
        heading = pose[..., 2, None]
        beams = heading + self.beam_angles
        x = pose[..., 0, None] + self.offset * np.cos(heading) + ranges * np.cos(beams)
        y = pose[..., 1, None] + self.offset * np.sin(heading) + ranges * np.sin(beams)
        return np.stack([x, y], -1)
