"""Seeded inputs that several chapters draw, on their boundaries too."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._report import Array

__all__ = ["a_covariance", "a_pose", "an_angle", "weights"]


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
