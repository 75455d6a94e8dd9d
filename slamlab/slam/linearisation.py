"""Where EKF-SLAM takes its Jacobians, so that it does not learn what nothing measured.

Turning the whole world about its origin changes no measurement, but Jacobians taken at estimates
that move say otherwise. First-estimates Jacobians (Huang, Mourikis and Roumeliotis 2008) and the
right-invariant error (Barrau and Bonnabel 2015) mend that. Chapter 10. Leading axes are batches.
"""

from __future__ import annotations

import numpy as np

from slamlab._checks import Array, as_choice
from slamlab.geometry import wrap_angle
from slamlab.models import LandmarkSensor

__all__ = ["LINEARISATIONS"]  # the rest is for the filters, whose arguments are checked

LINEARISATIONS = ("standard", "first-estimates", "invariant")


def as_linearisation(value: str, sensor: LandmarkSensor) -> str:
    """Return `value` if it is one of `LINEARISATIONS` and the sensor's landmarks allow it."""
    value = as_choice("linearisation", value, LINEARISATIONS)
    z = [3.0, 0.5]
    shift = sensor.locate([2.0, 1.0, 0.3], z) - sensor.locate([0.0, 0.0, 0.3], z)
    if value == "invariant" and not np.allclose(shift, [2.0, 1.0]):
        raise ValueError(
            "linearisation: expected 'standard' or 'first-estimates' for a sensor whose landmarks "
            "are no points, got 'invariant'"
        )
    return value


def rotated_90(points: Array) -> Array:
    """How points (..., 2) move when the world turns about its origin: (-y, x)."""
    return np.stack([-points[..., 1], points[..., 0]], -1)


def fej_jacobian(jacobian: Array, pose: Array, first: Array, linearisation: str) -> Array:
    """Jacobian (..., 3) by the pose for first estimates; as it is for other linearisations.

    A turn of the world moves a pose at p by J p. Jacobians at `pose` say so for p now, those of
    the last step said so for its first estimate: the column of the heading gets the difference.
    """
    if linearisation != "first-estimates":
        return jacobian
    shift = rotated_90(pose[..., :2] - first[..., :2])
    heading = jacobian[..., 2:] + jacobian[..., :2] @ shift[..., None]
    return np.concatenate([jacobian[..., :2], heading], -1)


def reset_covariance(P: Array, a: Array) -> None:
    """P <- A P A^T in place with A = I + a e^T, e the unit vector of the heading. O(N^2)."""
    b = P[2] + 0.5 * P[2, 2] * a  # A P A^T = P + a b^T + b a^T
    P += np.outer(a, b) + np.outer(b, a)


def retract(mean: Array, change: Array, linearisation: str) -> tuple[Array, Array | None]:
    """P1 (35): the state (..., N) after a correction, and the a of `reset_covariance`."""
    if linearisation == "invariant":
        return _retract_invariant(mean, change)
    after = mean + change
    if after.ndim > 1 or not -np.pi < after[2] < np.pi:
        after[..., 2] = wrap_angle(after[..., 2])
    return after, None


def _retract_invariant(mean: Array, change: Array) -> tuple[Array, Array]:
    """State after a correction in the coordinates xi = dp - J p dtheta of every point p.

    There, with J = [[0, -1], [1, 0]], the covariance does not depend on the estimate and
    p' = R(dtheta) p + V(dtheta) xi. Back in the coordinates of the state P' = A P A^T with
    A = I + a e^T, a = J (p' - p).
    """
    theta, points = change[..., 2:3], _points(mean)
    xi = _points(change) - theta[..., None] * rotated_90(points)
    # R(theta) p + V(theta) xi, V the mean of R from 0 to theta.
    c, s = np.cos(theta)[..., None], np.sin(theta)[..., None]
    along, across = np.sinc(theta / np.pi)[..., None], _versine(theta)[..., None]
    new = c * points + s * rotated_90(points) + along * xi + across * rotated_90(xi)
    heading = wrap_angle(mean[..., 2:3] + theta)
    return _state(new, heading), _state(rotated_90(new - points), np.zeros_like(heading))


def _points(state: Array) -> Array:
    """Position and landmarks (..., 1 + n, 2) of a state (..., 3 + 2n)."""
    flat = np.concatenate([state[..., :2], state[..., 3:]], -1)
    return flat.reshape(*state.shape[:-1], -1, 2)


def _state(points: Array, heading: Array) -> Array:
    """State (..., 3 + 2n) of position and landmarks (..., 1 + n, 2) and heading (..., 1)."""
    flat = points.reshape(*heading.shape[:-1], -1)
    return np.concatenate([flat[..., :2], heading, flat[..., 2:]], -1)


def _versine(theta: Array) -> Array:
    """(1 - cos theta) / theta."""
    return 0.5 * theta * np.sinc(0.5 * theta / np.pi) ** 2
