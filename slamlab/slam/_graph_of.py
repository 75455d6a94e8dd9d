"""From a log to the parts of a pose graph; `PoseGraph.from_log` is the door to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.geometry import rotation
from slamlab.logs import Log
from slamlab.models import LandmarkSensor, MotionModel, as_motion, as_sensor


def graph_of(
    log: Log, motion: MotionModel, sensor: LandmarkSensor | None, start: Array
) -> dict[str, Any]:
    """Arguments of `PoseGraph` for this log."""
    motion = as_motion("motion", motion)
    if not isinstance(log, Log) or log.n_runs is not None:
        raise ValueError(f"log: expected a Log of one robot, got {log!r:.80}")
    moves = np.flatnonzero(log.dt > 0)
    row = np.cumsum(log.dt > 0)  # the pose in which each step ends
    u, dt, n = log.u[moves], log.dt[moves], len(moves) + 1
    measurements, F = np.empty((n - 1, 3)), np.empty((n - 1, 3, u.shape[-1]))
    lengths, number = np.unique(dt, return_inverse=True)
    for k, length in enumerate(lengths):
        alike = number == k
        measurements[alike] = motion.step(np.zeros(3), u[alike], length)
        F[alike] = motion.jacobians(np.zeros(3), u[alike], length)[1]
    # The error of an edge stands in the frame of the pose as measured: e = R_z^T (noise of u)
    F[:, :2] = rotation(measurements[:, 2]).mT @ F[:, :2]
    V = log.control_cov if log.control_cov.ndim == 2 else log.control_cov[moves]
    information = _inverses(F @ V @ F.mT, lambda k: f"control_cov of step {moves[k]}")
    poses = np.empty((n, 3))
    poses[0] = start
    for k in range(n - 1):
        poses[k + 1] = motion.step(poses[k], u[k], dt[k])
    parts = {
        "poses": poses,
        "edges": np.column_stack([np.arange(n - 1), np.arange(1, n)]),
        "measurements": measurements,
        "information": information,
    }
    return parts if sensor is None else parts | _seen(log, as_sensor("sensor", sensor), poses, row)


def _seen(log: Log, sensor: LandmarkSensor, poses: Array, row: np.ndarray) -> dict[str, Any]:
    """Landmarks, and every measurement of them as a point in the frame of its pose."""
    if log.landmark_measurements is None or log.ids is None:
        raise ValueError("log: expected measurements of landmarks with ids")
    seen = [
        (k, m, name)
        for k, names in enumerate(log.ids)
        for m, name in enumerate(names.tolist())
        if not (isinstance(name, int) and name < 0)
    ]
    known: dict[Any, int] = {}
    number = np.array([known.setdefault(name, len(known)) for _, _, name in seen], dtype=int)
    first = np.unique(number, return_index=True)[1]
    place = row[[k for k, _, _ in seen]]
    z = np.reshape([log.landmark_measurements[k][m] for k, m, _ in seen], (-1, 2))
    R = sensor.cov
    if log.covs is not None:
        R = np.reshape([log.covs[k][m] for k, m, _ in seen], (-1, 2, 2))
    G = sensor.locate_jacobians(np.zeros(3), z)[1]
    return {
        "landmarks": sensor.locate(poses[place[first]], z[first]),
        "landmark_edges": np.column_stack([place, number]),
        "landmark_measurements": sensor.locate(np.zeros(3), z),
        "landmark_information": _inverses(
            G @ R @ G.mT, lambda i: "covariance of landmark_measurements[{}][{}]".format(*seen[i])
        ),
    }


def _inverses(covs: Array, name: Callable[[int], str]) -> Array:
    """Inverses of covariances (n, d, d); ValueError if one is singular, with its name."""
    values, vectors = np.linalg.eigh(covs)
    flat = np.flatnonzero(~(values[:, 0] > 1e-12 * values[:, -1]))
    if len(flat):
        wanted = "noise in every direction, the matrix is singular"
        raise ValueError(f"{name(int(flat[0]))}: expected {wanted}")
    return vectors / values[:, None] @ vectors.mT
