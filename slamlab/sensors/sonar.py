"""A sonar: one number for a whole cone, the distance of the first echo.

P5, chapter 1.2.1, says that a sonar's readings are about those of a lidar, once the robot has
turned round and measured at every degree. Chapter 06 puts that to the test.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_count, as_positive, as_rng, as_scalar
from slamlab.sensors.lidar import BeamWorld, refuse_walls

__all__ = ["Sonar"]


@dataclass(frozen=True)
class Sonar:
    """Ultrasonic range finder in the body's centre, looking ahead.

    The echo that comes back first counts, whatever its direction within the cone; every surface
    sends one.

    Parameters
    ----------
    opening : float, default 25 degrees
        Full opening angle of the cone (rad).
    max_range : float, default 4.0
        Echoes from farther away (m) are not heard.
    sigma_range : float, default 0.0
        Standard deviation of the noise of a range (m).
    n_rays : int, default 41
        Rays that stand for the cone. A flat wall is found to r d^2 / 8, with d the angle between
        two rays: 1.5e-5 of its distance by default.

    Examples
    --------
    >>> from slamlab.worlds import BitmapWorld
    >>> world = BitmapWorld([[0, 0, 0, 1]], 1.0)
    >>> Sonar().measure(world, [[0.5, 0.5, 0.0], [0.5, 0.5, np.pi]]).tolist()
    [2.5, inf]
    """

    opening: float = np.deg2rad(25.0)
    max_range: float = 4.0
    sigma_range: float = 0.0
    n_rays: int = 41

    def __post_init__(self) -> None:
        """Check the parameters."""
        as_scalar("opening", self.opening, 0.0, 2 * np.pi)
        as_positive("max_range", self.max_range)
        as_scalar("sigma_range", self.sigma_range, 0.0, 1e300)
        as_count("n_rays", self.n_rays, 1)

    def measure(
        self, world: BeamWorld, poses: ArrayLike, rng: np.random.Generator | None = None
    ) -> Array:
        """Simulate single echoes.

        Parameters
        ----------
        world : BeamWorld
            For example a `BitmapWorld` or a `WallWorld`.
        poses : array_like, shape (..., 3)
            True poses of the sonar (m, m, rad).
        rng : numpy.random.Generator, optional
            Needed if there is noise.

        Returns
        -------
        ndarray, shape (...)
            Ranges (m); inf where nothing in the cone answers.

        Raises
        ------
        ValueError
            If a sonar stands inside an obstacle.
        """
        poses = as_array("poses", poses, ("...", 3))
        refuse_walls(world, poses[..., :2])
        half = self.opening / 2
        rays = np.linspace(-half, half, self.n_rays) if self.n_rays > 1 else np.zeros(1)
        directions = poses[..., 2, None] + rays
        ranges = world.cast(poses[..., None, :2], directions, self.max_range).min(-1)
        if self.sigma_range == 0:
            return ranges
        noise = as_rng("rng", rng).standard_normal(ranges.shape)
        return np.maximum(ranges + self.sigma_range * noise, 0.0)

    def sweep(
        self,
        world: BeamWorld,
        pose: ArrayLike,
        n_headings: int,
        sigma_turn: float = 0.0,
        rng: np.random.Generator | None = None,
    ) -> Array:
        """Turn once round on the spot and measure after every step, as P5 proposes.

        Parameters
        ----------
        world : BeamWorld
        pose : array_like, shape (3,)
            Pose of the first measurement (m, m, rad).
        n_headings : int
            Measurements in a full turn, at least 1; each step means to turn by 2 pi / n_headings.
        sigma_turn : float, default 0.0
            Standard deviation (rad) of a step; the errors of the steps add up.
        rng : numpy.random.Generator, optional
            Needed if there is noise.

        Returns
        -------
        ndarray, shape (n_headings,)
            Ranges (m), laid out like a scan of ``Lidar(n_headings)``.

        Raises
        ------
        ValueError
            As `measure`.
        """
        x, y, heading = as_array("pose", pose, (3,))
        n = as_count("n_headings", n_headings, 1)
        sigma_turn = as_scalar("sigma_turn", sigma_turn, 0.0, 1e300)
        turns = np.full(n, 2 * np.pi / n)
        turns[0] = 0.0
        if sigma_turn > 0:
            turns[1:] += sigma_turn * as_rng("rng", rng).standard_normal(n - 1)
        headings = heading + np.cumsum(turns)
        poses = np.stack([np.full(n, x), np.full(n, y), headings], -1)
        return self.measure(world, poses, rng)
