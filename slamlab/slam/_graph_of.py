"""From a log to the parts of a pose graph; `PoseGraph.from_log` is the door to it."""

from __future__ import annotations

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
    n = len(moves) + 1
    measurements, information = np.empty((n - 1, 3)), np.empty((n - 1, 3, 3))
    poses, origin = np.empty((n, 3)), np.zeros(3)
    poses[0] = start
    for k, step in enumerate(log.step(int(move)) for move in moves):
        measurements[k] = motion.step(origin, step.u, step.dt)
        # The error of an edge stands in the frame of the pose as measured: e = R_z^T (noise of u)
        F = motion.jacobians(origin, step.u, step.dt)[1]
        F[:2] = rotation(measurements[k, 2]).T @ F[:2]
        information[k] = _inverse(F @ step.control_cov @ F.T, f"control_cov of step {moves[k]}")
        poses[k + 1] = motion.step(poses[k], step.u, step.dt)
    parts = {
        "poses": poses,
        "edges": np.column_stack([np.arange(n - 1), np.arange(1, n)]),
        "measurements": measurements,
        "information": information,
    }
    return parts if sensor is None else parts | _seen(log, as_sensor("sensor", sensor), poses, row)


def _seen(log: Log, sensor: LandmarkSensor, poses: Array, row: np.ndarray) -> dict[str, Any]:
    """Landmarks, and every measurement of them as a point in the frame of its pose."""
    if log.looks is None or log.ids is None:
        raise ValueError("log: expected measurements of landmarks with ids")
    known: dict[Any, int] = {}
    edges, points, information, landmarks = [], [], [], []
    for k, step in enumerate(log):
        assert step.z is not None
        assert step.ids is not None
        for m, name in enumerate(step.ids.tolist()):
            if isinstance(name, int) and name < 0:
                continue
            point = sensor.locate(np.zeros(3), step.z[m])
            G = sensor.locate_jacobians(np.zeros(3), step.z[m])[1]
            R = sensor.cov if step.covs is None else step.covs[m]
            if name not in known:
                known[name] = len(known)
                landmarks.append(sensor.locate(poses[row[k]], step.z[m]))
            edges.append((row[k], known[name]))
            points.append(point)
            information.append(_inverse(G @ R @ G.T, f"covariance of looks[{k}][{m}]"))
    return {
        "landmarks": np.reshape(landmarks, (-1, 2)),
        "landmark_edges": np.reshape(edges, (-1, 2)).astype(int),
        "landmark_measurements": np.reshape(points, (-1, 2)),
        "landmark_information": np.reshape(information, (-1, 2, 2)),
    }


def _inverse(cov: Array, name: str) -> Array:
    values, vectors = np.linalg.eigh(cov)
    if not values[0] > 1e-12 * values[-1]:
        raise ValueError(f"{name}: expected noise in every direction, the matrix is singular")
    return vectors / values @ vectors.T
