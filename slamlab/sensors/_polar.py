"""What all sensors of (range, bearing) share: their noise, and how they measure a world.

Misses and clutter are what data association (chapter 11) has to live with.
Private to the room: `RangeBearing` and `Wall` are two.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_positive, as_rng, as_scalar
from slamlab.geometry import wrap_angle

CLUTTER = -1


@dataclass(frozen=True)
class PolarSensor(ABC):
    """Numbers that every such sensor has; where a landmark is seen, the sensor itself knows."""

    sigma_range: float
    sigma_bearing: float
    offset: float = 0.0
    max_range: float = np.inf
    field_of_view: float = 2 * np.pi
    cov: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the parameters and set `cov`, read-only."""
        as_scalar("offset", self.offset, low=-1e300, high=1e300)
        sigma_range = as_positive("sigma_range", self.sigma_range, 1e300)
        sigma_bearing = as_positive("sigma_bearing", self.sigma_bearing, np.pi)
        as_positive("max_range", self.max_range)
        as_positive("field_of_view", self.field_of_view, 2 * np.pi)
        cov = np.diag([sigma_range**2, sigma_bearing**2])
        cov.setflags(write=False)
        object.__setattr__(self, "cov", cov)

    @abstractmethod
    def observe(self, pose: ArrayLike, landmark: ArrayLike) -> Array:
        """Noise-free measurements (..., 2) of landmarks (..., 2) from poses (..., 3)."""

    @abstractmethod
    def visible(self, pose: ArrayLike, landmark: ArrayLike) -> NDArray[np.bool_]:
        """Tell which landmarks (..., 2) the sensor sees from poses (..., 3)."""

    def measure(
        self,
        pose: ArrayLike,
        landmarks: ArrayLike,
        rng: np.random.Generator,
        *,
        p_detect: float = 1.0,
        clutter_rate: float = 0.0,
    ) -> tuple[Array, NDArray[np.intp]]:
        """Simulate one look at the world: noisy measurements of the visible landmarks.

        Parameters
        ----------
        pose : array_like, shape (3,)
            True pose of the body.
        landmarks : array_like, shape (n, 2)
            True landmarks (m), or walls (r, alpha): without ends, nothing hides behind anything.
        rng : numpy.random.Generator
        p_detect : float, default 1.0
            Probability that a visible landmark is seen at all.
        clutter_rate : float, default 0.0
            Mean number of false alarms a look (Poisson), uniform over ranges up to `max_range`
            and bearings within `field_of_view`.

        Returns
        -------
        z : ndarray, shape (k, 2)
            Range (m) and wrapped bearing (rad) of what was seen. The noise is Gaussian, but a
            range that it would make negative ends at 0.
        ids : ndarray of int, shape (k,)
            Rows in `landmarks`, ascending; then -1 for each false alarm.

        Raises
        ------
        ValueError
            If clutter is asked of a sensor without a finite `max_range`.
        """
        pose, landmarks = as_array("pose", pose, (3,)), as_array("landmarks", landmarks, ("n", 2))
        rng = as_rng("rng", rng)
        p_detect = as_scalar("p_detect", p_detect, 0, 1)
        clutter_rate = as_scalar("clutter_rate", clutter_rate, 0, 1e6)
        if clutter_rate > 0 and not np.isfinite(self.max_range):
            raise ValueError("clutter_rate: expected 0 from a sensor without a finite max_range")
        ids = np.flatnonzero(self.visible(pose, landmarks))
        if p_detect < 1:
            ids = ids[rng.random(len(ids)) < p_detect]
        noise = rng.standard_normal((len(ids), 2)) * [self.sigma_range, self.sigma_bearing]
        z = self.observe(pose, landmarks[ids]) + noise
        z[:, 0] = np.maximum(z[:, 0], 0.0)  # as of a lidar: noise never makes a range negative
        if clutter_rate > 0:
            # False alarms: a Poisson number of them, uniform over the ranges and bearings in view.
            half = 0.5 * self.field_of_view
            n_false = rng.poisson(clutter_rate)
            false = rng.uniform([0.0, -half], [self.max_range, half], (n_false, 2))
            z, ids = np.concatenate([z, false]), np.append(ids, np.full(len(false), CLUTTER))
        z[:, 1] = wrap_angle(z[:, 1])
        return z, ids


def pair(first: Array, second: Array) -> Array:
    """Put two arrays of one shape (...) side by side, (..., 2)."""
    both = np.empty((*first.shape, 2))
    both[..., 0], both[..., 1] = first, second
    return both


def matrix(rows: list[list[Any]]) -> Array:
    """Matrices (..., rows, columns) of entries that broadcast to the last one of the first row."""
    filled = np.empty((*rows[0][-1].shape, len(rows), len(rows[0])))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            filled[..., i, j] = entry
    return filled
