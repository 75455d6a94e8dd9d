"""A planar lidar in a world: beams, noise, lost readings.

The sensor of P5, chapter 3.2.1 (`Scan`), repaired: beams fill the field of view whatever their
number, start from the robot's own heading, and one that meets nothing keeps its place in the
scan. Chapters 06, 08, 18 and 19.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_count, as_instance, as_positive, as_rng, as_scalar
from slamlab.geometry import wrap_angle
from slamlab.logs import ScanGeometry

__all__ = ["BeamWorld", "Lidar"]


class BeamWorld(Protocol):
    """What a lidar asks of a world; see `slamlab.models.World`."""

    def is_free(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Tell which points (..., 2) lie in no obstacle."""

    def cast(self, origins: ArrayLike, angles: ArrayLike, max_range: float = np.inf) -> Array:
        """Distance (m) at which beams meet something, inf where they meet nothing."""


@dataclass(frozen=True)
class Lidar:
    """Lidar with evenly spread beams.

    Parameters
    ----------
    n_beams : int
        Number of beams, at least one.
    field_of_view : float, default 2 pi
        Opening angle (rad) around the direction of the body. A full circle has beam i at
        2 pi i / n_beams, beam 0 straight ahead; a smaller one has its first and last beam at its
        edges (a single beam looks straight ahead).
    max_range : float, default inf
        Only what is nearer than this (m) is seen.
    offset : float, default 0.0
        Distance of the lidar ahead of the body centre (m).
    sigma_range : float, default 0.0
        Standard deviation of the noise of a range (m).
    p_miss : float, default 0.0
        Probability that a reading is lost.

    Attributes
    ----------
    beam_angles : ndarray, shape (n_beams,)
        Directions in the frame of the body (rad, in (-pi, pi]), counterclockwise.

    Examples
    --------
    >>> from slamlab.worlds import BitmapWorld
    >>> world = BitmapWorld([[0, 0, 0, 1]], 1.0)
    >>> Lidar(4).scan(world, [0.5, 0.5, 0.0]).tolist()
    [2.5, inf, inf, inf]
    """

    n_beams: int
    field_of_view: float = 2 * np.pi
    max_range: float = np.inf
    offset: float = 0.0
    sigma_range: float = 0.0
    p_miss: float = 0.0
    beam_angles: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the parameters and lay out the beams."""
        n = as_count("n_beams", self.n_beams, 1)
        view = as_positive("field_of_view", self.field_of_view, 2 * np.pi + 1e-9)
        as_positive("max_range", self.max_range)
        as_scalar("offset", self.offset, -1e300, 1e300)
        as_scalar("sigma_range", self.sigma_range, 0.0, 1e300)
        as_scalar("p_miss", self.p_miss, 0.0, 1.0)
        if view >= 2 * np.pi - 1e-9:
            angles = wrap_angle(2 * np.pi * np.arange(n) / n)
        else:
            angles = np.linspace(-view / 2, view / 2, n) if n > 1 else np.zeros(1)
        angles.setflags(write=False)
        object.__setattr__(self, "beam_angles", angles)

    @cached_property
    def geometry(self) -> ScanGeometry:
        """Layout of the beams."""
        return ScanGeometry(self.beam_angles, self.max_range, self.offset)

    def scan(
        self, world: BeamWorld, poses: ArrayLike, rng: np.random.Generator | None = None
    ) -> Array:
        """Simulate scans.

        Parameters
        ----------
        world : BeamWorld
            For example a `BitmapWorld` or a `WallWorld`.
        poses : array_like, shape (..., 3)
            True poses of the body (m, m, rad).
        rng : numpy.random.Generator, optional
            Needed if there is noise or readings get lost.

        Returns
        -------
        ndarray, shape (..., n_beams)
            Ranges (m): inf where a beam met nothing within `max_range`, NaN where the reading was
            lost (it says nothing). Noise never makes a range negative: it ends at 0.

        Raises
        ------
        ValueError
            If a lidar stands inside an obstacle.
        """
        poses = as_array("poses", poses, ("...", 3))
        if rng is not None or self.sigma_range > 0 or self.p_miss > 0:
            rng = as_rng("rng", rng)
        heading = poses[..., 2]
        ahead = np.stack([np.cos(heading), np.sin(heading)], -1)
        positions = poses[..., :2] + self.offset * ahead
        refuse_walls(world, positions)
        beams = heading[..., None] + self.beam_angles
        ranges = world.cast(positions[..., None, :], beams, self.max_range)
        if rng is not None:
            noise = self.sigma_range * rng.standard_normal(ranges.shape)
            ranges = np.maximum(ranges + noise, 0.0)
        ranges[ranges >= self.max_range] = np.inf
        if rng is not None:
            ranges[rng.random(ranges.shape) < self.p_miss] = np.nan
        return ranges

    def points(self, ranges: ArrayLike, poses: ArrayLike | None = None) -> Array:
        """End points of scans, in the body frame or, with poses, in the world.

        Parameters
        ----------
        ranges : array_like, shape (..., n_beams)
            Measured ranges (m), not negative.
        poses : array_like, shape (..., 3), optional
            One pose (m, m, rad) a scan.

        Returns
        -------
        ndarray, shape (..., n_beams, 2)
            NaN where a beam met nothing or its reading was lost.
        """
        return self.geometry.points(ranges, poses)


def refuse_walls(world: BeamWorld, positions: Array) -> None:
    """Raise ValueError if a sensor at one of the positions (..., 2) would stand in a wall."""
    as_instance("world", world, BeamWorld, "a world such as BitmapWorld(...)")
    inside = ~np.asarray(world.is_free(positions))
    if inside.any():
        where = tuple(int(i) for i in np.argwhere(inside)[0])
        x, y = positions[where]
        place = f"({x:.3g}, {y:.3g}), inside an obstacle or outside the world"
        found = f"at index {where} it stands at {place}"
        raise ValueError(f"poses: expected the sensor in free space, {found}")
