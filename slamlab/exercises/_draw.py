"""Seeded inputs that several chapters draw, on their boundaries too."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab.exercises._report import Array

__all__ = ["a_covariance", "a_pose", "an_angle", "drawn", "in_the_room", "weights"]


def drawn(draw: Callable[..., Any]) -> Callable[..., Any]:
    """Turn ``draw(rng, *sizes)`` into a function of the sizes that gives ``draw(rng)``."""
    return lambda *sizes, **more: lambda rng: draw(rng, *sizes, **more)


def a_covariance(rng: np.random.Generator, n: int, size: float = 1.0) -> Array:
    """Return a full covariance (n, n) of about this size."""
    root = rng.standard_normal((n, n))
    P: Array = np.round(size * (root @ root.T / n + 0.2 * np.eye(n)), 3)
    return P


def an_angle(rng: np.random.Generator) -> float:
    """Return an angle in (-pi, pi], one time in six exactly on a multiple of pi/2."""
    if rng.random() < 1 / 6:
        return float(rng.choice([-np.pi / 2, 0.0, np.pi / 2, np.pi]))
    return float(np.round(rng.uniform(-3.1, 3.1), 2))


def a_pose(rng: np.random.Generator, size: float = 3.0) -> Array:
    """Return x, y within +-size metres and a heading in (-pi, pi]."""
    return np.array([*np.round(rng.uniform(-size, size, 2), 2), an_angle(rng)])


def weights(rng: np.random.Generator, n: int, dead: Any = ()) -> Array:
    """Return n weights that sum to one, those at `dead` zero."""
    w: Array = rng.random(n) + 0.05
    w[list(dead)] = 0.0
    return w / w.sum()


@drawn
def in_the_room(
    rng: np.random.Generator,
    n: int,
    names: int,
    unseen: float = 0.0,
    *,
    dt: float = 0.5,
    prior: float = 0.0,
    still: bool = False,
) -> tuple[Any, ...]:
    """Draw n steps of dt (s) among landmarks: u, dt, V, z, ids, R (and P0 before)."""
    from slamlab.sensors import RangeBearing  # most chapters' checks need no more than numpy

    room = np.round(rng.uniform(3, 6, (names, 2)) * rng.choice([-1, 1], (names, 2)), 2)
    u = np.round(rng.uniform([0.2, -0.5], [0.8, 1.0], (n, 2)), 2)
    u[1:] *= not still
    V, R = a_covariance(rng, 2, 0.01) * (not still), a_covariance(rng, 2, 0.005)
    P0 = [a_covariance(rng, 3, prior)] if prior else []
    pose = rng.multivariate_normal(np.zeros(3), P0[0]) if prior else np.zeros(3)
    z, ids = [], []
    for v, omega in u:
        pose = pose + dt * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), omega])
        name = int(rng.integers(names)) if rng.random() >= unseen else -1
        seen = RangeBearing(0.05, 0.05).observe(pose, room[name])
        z.append(np.round(seen + rng.normal(0, 0.05, 2), 3) if name >= 0 else [np.nan] * 2)
        ids.append(10 * name if name >= 0 else -1)
    return (*P0, u, dt, V, z, ids, R)
