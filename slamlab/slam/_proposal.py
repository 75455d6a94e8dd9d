"""Where version 2.0 of FastSLAM draws: the noise of the odometry, given what is measured.

P2 (18) for a noise n ~ N(0, I) that the motion model carries on, x = f(x_{k-1}, u + root n): exact
also where the covariance of the pose has no inverse. Used by FastSLAM (chapter 12).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamlab._checks import Array
from slamlab.models import MotionModel

__all__ = ["Drawn", "Odometry", "draw"]

# Predictions that are drawn anew at an update; older ones keep the noise they were drawn with.
LOOK_BACK = 8
# Odometry noise of so many sigmas is no guess worth proposing.
ABSURD = 1e6

# Information about the pose, H^T Z^-1 H (M, 3, 3) and H^T Z^-1 y (M, 3), seen from poses (M, 3).
Inform = Callable[[Array], tuple[Array, Array]]


class Drawn(NamedTuple):
    """One prediction, and the white noise (M, p) that each particle drew for it."""

    u: Array
    dt: float
    root: Array
    noise: Array

    def controls(self, noise: Array) -> Array:
        """Control that each particle executes with white noise (M, p)."""
        return self.u + noise @ self.root.T


@dataclass(frozen=True)
class Odometry:
    """Predictions since the last update, and the poses (M, 3) before the first of them."""

    motion: MotionModel
    start: Array
    steps: tuple[Drawn, ...] = ()

    def followed_by(self, step: Drawn) -> Odometry:
        """Return it with one step more; what lies too far back is settled."""
        steps = (*self.steps, step)
        if len(steps) <= LOOK_BACK:
            return Odometry(self.motion, self.start, steps)
        oldest, *rest = steps
        start = self.motion.step(self.start, oldest.controls(oldest.noise), oldest.dt)
        return Odometry(self.motion, start, tuple(rest))

    def roll(self, noise: Array | None = None) -> tuple[Array, Array]:
        """Poses (M, 3) after all steps with noise (M, q), and their derivative by it (M, 3, q)."""
        if noise is None:
            noise = np.zeros((len(self.start), sum(len(step.u) for step in self.steps)))
        poses, A = self.start, np.zeros((len(noise), 3, 0))
        for step, controls in self._executed(noise):
            F_x, F_u = self.motion.jacobians(poses, controls, step.dt)
            A = np.concatenate([F_x @ A, F_u @ step.root], 2)
            poses = self.motion.step(poses, controls, step.dt)
        return poses, A

    def poses(self, noise: Array) -> Array:
        """Poses of `roll` alone."""
        poses = self.start
        for step, controls in self._executed(noise):
            poses = self.motion.step(poses, controls, step.dt)
        return poses

    def _executed(self, noise: Array) -> Iterator[tuple[Drawn, Array]]:
        """Each step with the controls (M, p) that this noise (M, q) makes of it."""
        first = 0
        for step in self.steps:
            yield step, step.controls(noise[:, first : first + len(step.u)])
            first += len(step.u)


def draw(odometry: Odometry, inform: Inform, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw poses (M, 3) from P2 (18), and log P(x | x_{k-1}, u) / pi(x), their share of (14)."""
    mean = np.zeros((len(odometry.start), sum(len(step.u) for step in odometry.steps)))
    # Linearised at the prediction, then once more where the first solution points.
    for _ in range(2):
        mean, precision = _posterior(odometry, mean, inform)
    factor = np.linalg.cholesky(precision)
    white = rng.standard_normal(mean.shape)
    # n ~ N(mean, precision^-1) with precision = L L^T: n = mean + L^-T white.
    noise = mean + np.linalg.solve(factor.mT, white[..., None])[..., 0]
    log_determinant = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(1)
    log_prior, log_proposal = _log_normal(noise), _log_normal(white) + log_determinant
    return odometry.poses(noise), log_prior - log_proposal


def _posterior(odometry: Odometry, noise: Array, inform: Inform) -> tuple[Array, Array]:
    """Mean (M, q) and precision (M, q, q) of the noise, linearised at `noise`; prior N(0, I)."""
    poses, A = odometry.roll(noise)
    matrix, vector = inform(poses)
    pull = A.mT @ matrix @ A
    precision = np.eye(A.shape[2]) + pull
    # The residual was taken at `noise`, the prior is centred at 0.
    right = (vector[:, None] @ A)[:, 0] + (pull @ noise[..., None])[..., 0]
    mean = np.linalg.solve(precision, right[..., None])[..., 0]
    # A proposal may be anything that its weight repairs: no need to follow an absurd pull.
    absurd = ~(np.abs(mean) < ABSURD).all(1)
    return np.where(absurd[:, None], 0.0, mean), precision


def _log_normal(white: Array) -> Array:
    """Log density of N(0, I) at (M, q), up to a constant."""
    return -0.5 * (white * white).sum(1)
