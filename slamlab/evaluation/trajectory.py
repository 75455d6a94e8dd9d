"""How far an estimated path lies from the true one: absolute and relative trajectory error.

Sturm et al. (2012), with the closed-form alignment of Umeyama (1991); poses of the plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_choice, as_count, as_positive
from slamlab.evaluation.run import Run
from slamlab.geometry import between, compose, rotation, wrap_angle

__all__ = ["TrajectoryError", "align", "ate", "rpe"]


@dataclass(frozen=True, eq=False)
class TrajectoryError:
    """Errors of a path, one an entry, and their summary.

    Attributes
    ----------
    translation : ndarray, shape (k,)
        Distances (m).
    rotation : ndarray, shape (k,)
        Absolute angles (rad).

    Examples
    --------
    >>> error = ate([[0, 0, 0], [1, 0.1, 0]], [[0, 0, 0], [1, 0, 0]], aligned=False)
    >>> error.translation.tolist(), round(error.rmse, 4)
    ([0.0, 0.1], 0.0707)
    """

    translation: Array
    rotation: Array

    def __repr__(self) -> str:
        """Return the summary in a line, however long the path is."""
        if len(self.translation) == 0:
            return "TrajectoryError(no poses)"
        numbers = f"rmse {self.rmse:.3g} m, largest {self.max:.3g} m"
        return f"TrajectoryError({len(self.translation)} poses: {numbers})"

    @property
    def rmse(self) -> float:
        """Root of the mean squared translation error (m)."""
        return float(np.sqrt(np.mean(self.translation**2)))

    @property
    def mean(self) -> float:
        """Mean translation error (m)."""
        return float(np.mean(self.translation))

    @property
    def median(self) -> float:
        """Median translation error (m)."""
        return float(np.median(self.translation))

    @property
    def max(self) -> float:
        """Largest translation error (m)."""
        return float(np.max(self.translation))

    @property
    def rotation_rmse(self) -> float:
        """Root of the mean squared angle error (rad)."""
        return float(np.sqrt(np.mean(self.rotation**2)))


def align(estimate: ArrayLike, truth: ArrayLike) -> Array:
    """Move a path rigidly onto another one, by least squares over the positions.

    Parameters
    ----------
    estimate, truth : array_like, shape (n, 3)
        Poses at the same times (m, m, rad), at least one.

    Returns
    -------
    ndarray, shape (n, 3)
        The moved estimate.

    Examples
    --------
    >>> path = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    >>> turned = np.array([[5, 5, 1.5708], [5, 6, 1.5708], [5, 7, 1.5708]])
    >>> (align(turned, path)[:, :2].round(3) + 0.0).tolist()
    [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]
    """
    estimate, truth = _paths(estimate, truth)
    a = estimate[:, :2] - estimate[:, :2].mean(0)
    b = truth[:, :2] - truth[:, :2].mean(0)
    # The best angle turns the cross-covariance into its largest trace.
    theta = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    shift = truth[:, :2].mean(0) - rotation(theta) @ estimate[:, :2].mean(0)
    return compose(np.append(shift, theta), estimate)


def ate(
    estimate: ArrayLike | Run, truth: ArrayLike | None = None, aligned: bool = True
) -> TrajectoryError:
    """Absolute trajectory error: distances between poses of the same time.

    Parameters
    ----------
    estimate, truth : array_like, shape (n, 3)
        Poses at the same times (m, m, rad), at least one. Of a `Run`: its trajectory, and the
        truth of its log.
    aligned : bool, default True
        Align the estimate first (a map is defined up to a rigid motion). With False both paths
        are compared as they are.

    Returns
    -------
    TrajectoryError
        One entry a pose.

    Examples
    --------
    >>> truth = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    >>> turned = compose([5, 5, 1.0], truth)
    >>> round(ate(turned, truth).rmse, 9), round(ate(turned, truth, aligned=False).max, 3)
    (0.0, 7.83)
    """
    estimate, truth = _paths(estimate, truth)
    if aligned:
        estimate = align(estimate, truth)
    distance = np.linalg.norm(estimate[:, :2] - truth[:, :2], axis=1)
    return TrajectoryError(distance, np.abs(wrap_angle(estimate[:, 2] - truth[:, 2])))


def rpe(
    estimate: ArrayLike | Run,
    truth: ArrayLike | None = None,
    delta: float = 1,
    unit: str = "steps",
) -> TrajectoryError:
    """Relative pose error: how wrong the motion over a fixed stretch is.

    Parameters
    ----------
    estimate, truth : array_like, shape (n, 3)
        Poses at the same times (m, m, rad). Of a `Run`: its trajectory, and the truth of its log.
    delta : float, default 1
        Length of the stretch.
    unit : {"steps", "metres"}, default "steps"
        Unit of `delta`; metres are driven along the true path, and the stretch from a pose ends
        at the first pose that lies at least `delta` ahead.

    Returns
    -------
    TrajectoryError
        One entry a stretch: the error of the relative motion, in the frame of the true one.

    Raises
    ------
    ValueError
        If no stretch is as long as `delta`.

    Examples
    --------
    >>> path = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    >>> rpe(path * [1.1, 1, 1], path).translation.round(3).tolist()
    [0.1, 0.1]
    """
    estimate, truth = _paths(estimate, truth)
    first, last = _pose_pairs(truth, delta, as_choice("unit", unit, ("steps", "metres")))
    if len(first) == 0:
        raise ValueError(f"delta: expected less than the whole path, got {delta:g} {unit}")
    error = between(between(truth[first], truth[last]), between(estimate[first], estimate[last]))
    return TrajectoryError(np.linalg.norm(error[:, :2], axis=1), np.abs(error[:, 2]))


def _pose_pairs(truth: Array, delta: float, unit: str) -> tuple[np.ndarray, np.ndarray]:
    rows = np.arange(len(truth))
    if unit == "steps":
        steps = as_count("delta", delta, 1)
        return rows[:-steps], rows[steps:]
    delta = as_positive("delta", delta)
    steps_driven = np.linalg.norm(np.diff(truth[:, :2], axis=0), axis=1)
    driven = np.concatenate([[0.0], np.cumsum(steps_driven)])
    # Rounding of a sum of steps must not push the end of a stretch to the next pose.
    last = np.searchsorted(driven, driven + delta * (1 - 1e-12))
    there = last < len(truth)
    return rows[there], last[there]


def _paths(estimate: ArrayLike | Run, truth: ArrayLike | None) -> tuple[Array, Array]:
    if isinstance(estimate, Run):
        truth = estimate.truth if truth is None else truth
        estimate = estimate.trajectory
    if truth is None:
        raise ValueError("truth: expected true poses, or a Run whose log has them, got None")
    estimate = as_array("estimate", estimate, ("n", 3))
    truth = as_array("truth", truth, (len(estimate), 3))
    if len(truth) == 0:
        raise ValueError("estimate: expected at least one pose, got none")
    return estimate, truth
