"""Odometry as bad as wheels make it, from a reference that is better. Chapters 13 and 14.

Logs of the Radish archive give corrected poses only: the drift that a robot has to live with is
put back on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamlab._checks import as_instance, as_rng, as_scalar
from slamlab.geometry import between
from slamlab.logs import Log

__all__ = ["drifted"]


def drifted(
    log: Log,
    rng: np.random.Generator,
    bias: float = 0.02,
    turn_bias: float = np.deg2rad(0.4),
    slip: float = 0.04,
    turn_noise: float = np.deg2rad(1.5),
) -> Log:
    """Return the log with odometry made from its true poses: wheels of the wrong size, and slip.

    Parameters
    ----------
    log : Log
        One run with truth; its controls are replaced by increments for `robots.RelativePose`.
    rng : numpy.random.Generator
    bias : float, default 0.02
        All steps are too long, or all too short, by this part.
    turn_bias : float, default 0.4 degrees
        Heading error of one sign (rad a metre).
    slip : float, default 0.04
        Standard deviation of the length of a step, as a part of it; sideways 1 cm on a metre.
    turn_noise : float, default 1.5 degrees
        Standard deviation of the heading after a metre (rad), besides 5 % of each turn.

    Returns
    -------
    Log
        Same scans, same truth; `control_cov` covers noise and bias alike.

    Examples
    --------
    >>> log = Log([0, 1, 2], np.zeros((3, 3)), [0, 1, 1], np.eye(3),
    ...           truth=[[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    >>> drifted(log, np.random.default_rng(1)).u.shape
    (3, 3)
    """
    rng = as_rng("rng", rng)
    bias, turn_bias = as_scalar("bias", bias, 0, 0.5), as_scalar("turn_bias", turn_bias, 0, 1)
    slip, turn_noise = as_scalar("slip", slip, 0, 1), as_scalar("turn_noise", turn_noise, 0, 1)
    as_instance("log", log, Log)
    if log.truth is None or log.truth.ndim != 2:
        raise ValueError("log: expected one run with truth, from which odometry can be made")
    u = np.zeros((len(log), 3))
    u[1:] = between(log.truth[:-1], log.truth[1:])
    length, turn = np.hypot(u[:, 0], u[:, 1]), u[:, 2].copy()
    signs = rng.choice([-1.0, 1.0], 2)
    noise = rng.standard_normal((3, len(u)))
    u[:, :2] *= (1 + bias * signs[0] + slip * noise[0])[:, None]
    u[:, 1] += 0.01 * np.sqrt(length) * noise[1]
    spread = np.sqrt(turn_noise**2 * length + (0.05 * turn) ** 2)
    u[:, 2] += turn_bias * signs[1] * length + spread * noise[2]
    cov = np.zeros((len(u), 3, 3))
    cov[:, 0, 0] = (bias**2 + slip**2) * length**2 + 1e-6
    cov[:, 1, 1] = cov[:, 0, 0] + 1e-4 * length
    cov[:, 2, 2] = spread**2 + (turn_bias * length) ** 2 + 1e-8
    dt = np.maximum(np.diff(log.times, prepend=log.times[:1]), 0.0)
    dt[1:] = np.maximum(dt[1:], 1e-3)
    return replace(log, u=u, dt=dt, control_cov=cov, controls="displacement")
