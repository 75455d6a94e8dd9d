"""Two stereo pairs over rough ground: a depth picture, levelled by an accelerometer.

P5 section 2.3 cites such a rig, 140 degrees wide, on the robot of Gamma-SLAM. Neither lenses nor
numbers of pixels are given: what stands here is chosen, and said. Chapter 15.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from slamlab._checks import Array, as_array, as_count, as_instance, as_rng, as_scalar, as_shaped
from slamlab.geometry import tilt
from slamlab.kernels import compiled
from slamlab.logs import ScanGeometry
from slamlab.worlds import Terrain

__all__ = ["StereoRig"]

_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@dataclass(frozen=True)
class StereoRig:
    """Cameras that look down on the ground ahead; a ScanSensor whose beams also go downwards.

    Of all pixels, `n_points` are kept that lie evenly on level ground between `near` and `far`. A
    range is measured along the ray; its noise grows with the square of the range, as that of a
    triangle with a short base does.

    Parameters
    ----------
    n_points : int, default 5000
    field_of_view : float, default 140 degrees
        From the left edge of the left pair to the right edge of the right one (rad).
    near, far : float, default 1 and 5
        Nearest and farthest level ground in the pictures (m).
    camera_height : float, default 1.0
        Above the ground under the robot (m).
    depth_noise : float, default 0.002
        Standard deviation of a range of 1 m (m): a pixel of error in the disparity, over focal
        length (pixels) times base (m).

    Examples
    --------
    >>> rig = StereoRig(100, depth_noise=0.0)
    >>> level = Terrain.rough(np.random.default_rng(1), roughness=0.0, relief=0.0)
    >>> ranges = rig.scan(level, [9, 9, 0])
    >>> bool(np.abs(rig.heights(ranges)).max() < 1e-6)
    True
    """

    n_points: int = 5000
    field_of_view: float = np.deg2rad(140.0)
    near: float = 1.0
    far: float = 5.0
    camera_height: float = 1.0
    depth_noise: float = 0.002

    def __post_init__(self) -> None:
        """Check the parameters."""
        as_count("n_points", self.n_points, 1)
        as_scalar("field_of_view", self.field_of_view, 1e-6, 2 * np.pi)
        near = as_scalar("near", self.near, 1e-6, 1e9)
        as_scalar("far", self.far, near, 1e9)
        as_scalar("camera_height", self.camera_height, 1e-6, 1e9)
        as_scalar("depth_noise", self.depth_noise, 0.0, 1e3)

    @property
    def n_beams(self) -> int:
        """Number of rays."""
        return self.n_points

    @property
    def offset(self) -> float:
        """Distance of the cameras ahead of the body centre (m): 0."""
        return 0.0

    @property
    def max_range(self) -> float:
        """A range of at least this (m) met nothing: a quarter more than to `far`."""
        return 1.25 * float(np.hypot(self.far, self.camera_height))

    @cached_property
    def beam_angles(self) -> Array:
        """Directions of the rays in the plane (rad), shape (n_points,)."""
        turns = np.arange(self.n_points) * _GOLDEN % 1.0
        return self.field_of_view * (turns - 0.5)

    @cached_property
    def depressions(self) -> Array:
        """Angles of the rays below the horizon (rad), shape (n_points,)."""
        share = (np.arange(self.n_points) + 0.5) / self.n_points
        # Rings of the same area hold as many points.
        ahead = np.sqrt(self.near**2 + share * (self.far**2 - self.near**2))
        return np.arctan2(self.camera_height, ahead)

    @cached_property
    def geometry(self) -> ScanGeometry:
        """Layout of the rays, seen from above."""
        return ScanGeometry(self.beam_angles, self.max_range)

    def points(self, ranges: ArrayLike, poses: ArrayLike | None = None) -> Array:
        """Where the rays met the ground, seen from above, as a level rig would have it.

        Parameters
        ----------
        ranges : array_like, shape (..., n_points)
            Along the rays (m), not negative; NaN, or `max_range` and more, met nothing.
        poses : array_like, shape (..., 3), optional
            One pose a picture; without it the points are in the body frame.

        Returns
        -------
        ndarray, shape (..., n_points, 2)
            NaN where a ray met nothing.
        """
        ranges = as_shaped("ranges", ranges, ("...", self.n_points))
        flat = np.where(ranges < self.max_range, ranges * np.cos(self.depressions), np.inf)
        return self.geometry.points(flat, poses)

    def heights(self, ranges: ArrayLike) -> Array:
        """Height (..., n_points) of those points above the ground under the robot (m)."""
        ranges = np.asarray(ranges, float)
        seen = np.where(ranges < self.max_range, ranges, np.nan)
        return self.camera_height - seen * np.sin(self.depressions)

    def scan(
        self,
        terrain: Terrain,
        poses: ArrayLike,
        rng: np.random.Generator | None = None,
        sway: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Array:
        """Take depth pictures.

        Parameters
        ----------
        terrain : Terrain
        poses : array_like, shape (..., 3)
            Of the vehicle, which rides on the smooth part of the terrain (m, m, rad).
        rng : numpy.random.Generator, optional
            Noise; none without it.
        sway : array_like, shape (..., 3), default (0, 0, 0)
            What the accelerometer leaves: height (m), pitch and roll (rad) of which the rig knows
            nothing. Pitch looks down, roll leans to the right.

        Returns
        -------
        ndarray, shape (..., n_points)
            Ranges (m), inf where a ray met nothing.
        """
        as_instance("terrain", terrain, Terrain)
        poses = as_array("poses", poses, ("...", 3))
        sway = np.broadcast_to(as_array("sway", sway, ("...", 3)), poses.shape)
        frame = np.array([terrain.grid.resolution, *terrain.grid.origin])
        out: Array = np.empty((*poses.shape[:-1], self.n_points))
        each = zip(poses.reshape(-1, 3), sway.reshape(-1, 3), strict=True)
        for picture, (pose, (lift, pitch, roll)) in zip(
            out.reshape(-1, self.n_points), each, strict=True
        ):
            ground = float(terrain.height(pose[:2], relief=True))
            origin = np.array([pose[0], pose[1], ground + self.camera_height + lift])
            rays = np.ascontiguousarray(self._rays(pitch, roll) @ _about_z(pose[2]).T)
            picture[:] = march(terrain.heights, frame, origin, rays, self.max_range)
        if rng is not None:
            noise = as_rng("rng", rng).standard_normal(out.shape)
            met = out < np.inf
            out[met] += self.depth_noise * out[met] ** 2 * noise[met]
        return np.maximum(out, 0.0)

    def _rays(self, pitch: float, roll: float) -> Array:
        """Directions (n, 3) of the rays in the frame of the body, for a rig that is not level."""
        level, down = np.cos(self.depressions), np.sin(self.depressions)
        a = self.beam_angles
        rays = np.stack([level * np.cos(a), level * np.sin(a), -down], -1)
        return rays @ tilt(roll, pitch).T


@compiled("march.march")
def march(heights: Array, frame: Array, origin: Array, rays: Array, reach: float) -> Array:
    """Distances along unit rays (n, 3) from `origin` (3,) to the ground, inf beyond `reach` (m).

    Steps of half a cell; the last is cut where a straight line between its ends meets the ground.
    `frame` is the resolution and the origin of the heights (m).
    """
    ranges, step, t = np.full(len(rays), np.inf), 0.5 * frame[0], 0.0
    above = _above(heights, frame, np.tile(origin, (len(rays), 1)))
    while t < reach:
        t += step
        before, above = above, _above(heights, frame, origin + t * rays)
        met = np.isinf(ranges) & (above <= 0)
        ranges[met] = t - step * above[met] / (above - before)[met]
    return ranges


def _above(heights: Array, frame: Array, points: Array) -> Array:
    """How high above the ground points (n, 3) are (m); between cell centres it is bilinear."""
    cells = (points[:, :2] - frame[1:]) / frame[0] - 0.5
    ground = ndimage.map_coordinates(heights, cells.T[::-1], order=1, mode="nearest")
    return np.asarray(points[:, 2] - ground)


def _about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
