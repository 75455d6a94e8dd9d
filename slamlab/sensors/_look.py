"""One simulated look at the world, the same for every sensor of (range, bearing) landmarks.

Misses and clutter are what data association (chapter 11) has to live with.
Private to the room: `RangeBearing.measure` and `Wall.measure` call it.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_rng, as_scalar
from slamlab.geometry import wrap_angle

CLUTTER = -1


class PolarSensor(Protocol):
    """What a simulated look needs to know of a sensor."""

    @property
    def sigma_range(self) -> float: ...
    @property
    def sigma_bearing(self) -> float: ...
    @property
    def max_range(self) -> float: ...
    @property
    def field_of_view(self) -> float: ...
    def observe(self, pose: ArrayLike, landmark: ArrayLike) -> Array: ...
    def visible(self, pose: ArrayLike, landmark: ArrayLike) -> NDArray[np.bool_]: ...


def noise_cov(sensor: PolarSensor) -> Array:
    """Check the parameters that every such sensor has; return R, read-only (2, 2)."""
    tiny = float(np.finfo(float).tiny)
    sigma_range = as_scalar("sigma_range", sensor.sigma_range, low=tiny, high=1e300)
    sigma_bearing = as_scalar("sigma_bearing", sensor.sigma_bearing, low=tiny, high=np.pi)
    as_scalar("max_range", sensor.max_range, low=tiny)
    as_scalar("field_of_view", sensor.field_of_view, low=tiny, high=2 * np.pi)
    cov = np.diag([sigma_range**2, sigma_bearing**2])
    cov.setflags(write=False)
    return cov


def look(
    sensor: PolarSensor,
    pose: ArrayLike,
    landmarks: ArrayLike,
    rng: np.random.Generator,
    p_detect: float,
    clutter_rate: float,
) -> tuple[Array, NDArray[np.intp]]:
    """Noisy measurements (k, 2) of visible landmarks, then clutter, and ids (k,), clutter -1."""
    pose, landmarks = as_array("pose", pose, (3,)), as_array("landmarks", landmarks, ("n", 2))
    rng = as_rng("rng", rng)
    p_detect = as_scalar("p_detect", p_detect, 0, 1)
    clutter_rate = as_scalar("clutter_rate", clutter_rate, 0, 1e6)
    if clutter_rate > 0 and not np.isfinite(sensor.max_range):
        raise ValueError("clutter_rate: expected 0 from a sensor without a finite max_range")
    ids = np.flatnonzero(sensor.visible(pose, landmarks))
    if p_detect < 1:
        ids = ids[rng.random(len(ids)) < p_detect]
    noise = rng.standard_normal((len(ids), 2)) * [sensor.sigma_range, sensor.sigma_bearing]
    z = sensor.observe(pose, landmarks[ids]) + noise
    z[:, 0] = np.maximum(z[:, 0], 0.0)  # as of a lidar: noise never makes a range negative
    if clutter_rate > 0:
        # False alarms: a Poisson number of them, uniform over the ranges and bearings in view.
        half = 0.5 * sensor.field_of_view
        n_false = rng.poisson(clutter_rate)
        false = rng.uniform([0.0, -half], [sensor.max_range, half], (n_false, 2))
        z, ids = np.concatenate([z, false]), np.append(ids, np.full(len(false), CLUTTER))
    z[:, 1] = wrap_angle(z[:, 1])
    return z, ids
