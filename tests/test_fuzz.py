"""Every public callable, called well and then with one argument spoilt: refused by name, or fine.

Generated from the signatures: whoever adds a public function is tried with what others were.
"""

import copy
import datetime
import functools
import importlib
import inspect
import pkgutil
import re
import warnings

import ipywidgets
import numpy as np
import pytest
from matplotlib.figure import Figure

import slamlab
from slamlab.evaluation import run
from slamlab.filters.pages import SharedPages
from slamlab.gaussian import Gaussian
from slamlab.geometry import between
from slamlab.grids import Grid
from slamlab.localization import DeadReckoning
from slamlab.logs import Log, ScanGeometry
from slamlab.matching import LikelihoodGrid, PointsWithNormals
from slamlab.models import View
from slamlab.navigation import (
    YOUBOT_BODY,
    CollisionGuard,
    ExplorationGrid,
    NearestFrontier,
    PathMemory,
    ReturnLaw,
    fit_cubic,
)
from slamlab.navigation.strategies import Situation
from slamlab.robots import YOUBOT, SquareRobot, Unicycle
from slamlab.sensors import Lidar, RangeBearing, StereoOdometer
from slamlab.simulation import landmark_drives, record
from slamlab.simulation.record import Script
from slamlab.slam import (
    CompressedEKFSlam,
    EKFSlam,
    FastSlam,
    IncrementalGraph,
    PoseGraph,
    ScanGraphSlam,
    Sessions,
)
from slamlab.widgets.sweep import Curves
from slamlab.worlds import BitmapWorld, rooms

# Checks of exercises never raise by design, and have their own fuzz; the command line has one too.
ROOMS = (
    "geometry", "gaussian", "grids", "models", "logs", "worlds", "robots", "sensors", "filters",
    "matching", "mapping", "slam", "localization", "navigation", "simulation", "datasets",
    "evaluation", "widgets", "plots", "printed",
)  # fmt: skip
BEAMS = np.linspace(-3, 3, 12)
POINTS = np.random.default_rng(0).normal(size=(12, 2))
SEGMENT = [[[0.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [1.0, 2.0]]]


def square(v):
    return np.asarray(v, float) ** 2


# A good value for each parameter by its name, or by "callable.name" where that differs.
GOOD = {
    "F": np.eye(2), "H": np.eye(2), "Q": np.eye(2), "R": np.eye(2), "a": [1.0, 2.0, 0.3],
    "after": np.arange(1.0, 13), "angle": 0.3, "angles": [0.1, 0.4], "b": [0.1, 0.2, 0.3],
    "beam_angles": BEAMS, "before": np.arange(1.0, 13) ** 1.1, "bins": 0.1,
    "belief": Gaussian([0.5, 1.0], np.eye(2)), "bounds": [0.0, 0.0, 3.0, 3.0], "column": 5,
    "control_cov": 0.01 * np.eye(2), "controls": np.full((4, 2), 0.1), "cov": np.eye(2),
    "covs": np.tile(np.eye(2), (12, 1, 1)), "delta": 0.05, "distances": [3.0, 4.0, 5.0],
    "dof": 2, "dt": 0.1, "end": [1.0, 0.0], "epsilon": 0.1, "f": square, "h": square,
    "field": LikelihoodGrid.of_points(POINTS, 0.1), "field_of_view": 3.0, "guess": [0.0, 0.0, 0.1],
    "half_length": 0.2, "half_width": 0.2, "increment": [0.1, 0.0, 0.1], "inliers": 12,
    "initial": Gaussian([0.5, 1.0], np.eye(2)), "kernel": [0.2, 0.6, 0.2], "lag": 2,
    "landmark": [2.0, 1.0], "landmarks": POINTS, "least": 0.1, "lidar": ScanGeometry(BEAMS),
    "likelihood": [0.2, 0.5, 0.9], "lower": 0.0, "margin": 0.01, "maximum": 50, "mean": [1.0, 2.0],
    "measured_steps": np.random.default_rng(1).normal(size=(12, 3)), "minimum": 10,
    "motion": Unicycle(), "n": 5, "n_beams": 12, "n_particles": 8, "neighbours": 3,
    "normals": POINTS / np.linalg.norm(POINTS, axis=1)[:, None], "occupied": np.eye(8) > 0,
    "offsets": [-1, 0, 1], "p": np.random.default_rng(2).normal(size=(6, 3)), "pairs": 3,
    "particles": np.zeros((8, 3)), "pitch": 0.1, "places": POINTS, "point": [0.3, 0.2],
    "points": POINTS, "pose": [0.5, 0.6, 0.2], "poses": np.tile([0.5, 0.6, 0.2], (5, 1)),
    "probability": 0.9, "q": np.random.default_rng(3).normal(size=(6, 3)), "radius": 2.0,
    "ranges": np.full(12, 1.5), "reference": POINTS, "residual": [0.1, 0.2], "resolution": 0.1,
    "roll": 0.1,
    "row": 4, "scan": np.arange(1.0, 13), "scans": np.tile(np.arange(1.0, 13), (12, 1)),
    "segments": SEGMENT, "sensor": RangeBearing(0.1, 0.1), "shape": (10, 8), "side": 0.3,
    "sigma": 0.1, "sigma_bearing": 0.02, "sigma_range": 0.1, "spacing": 0.5,
    "spread": np.ones(12), "start": [0.5, 0.6, 0.2], "step": 0.2, "theta": 0.4, "ticks": [3, 4],
    "ticks_per_turn": 500, "true_steps": np.random.default_rng(4).normal(size=(12, 3)),
    "u": [0.3, 0.1], "values": np.eye(8), "weights": np.full(8, 0.125), "wheel_radius": 0.05,
    "wheel_speeds": [1.0, 2.0, 1.0, 2.0], "world": rooms.box_room(), "x": [0.5, 1.0],
    "z": [1.0, 0.5], "max_range": 5.0, "sigma_turn": 0.1, "width": 0.2, "size": 3, "shift": 1,
    "log_odds": np.eye(8), "start_gate": 1.0, "max_distance": 3.0, "bearing": 0.2,
    "Ellipse.center": np.zeros(2), "Ellipse.half_axes": np.array([2.0, 1.0]),
    "chi2_quantile.probability": 0.9, "dead_reckoning_cov.cov": 0.1 * np.eye(3),
    "dead_reckoning.controls": np.full((4, 2), 0.1), "extended.update.residual": None,
    "scan_as_printed.occupied": np.pad(np.zeros((6, 6)), 3, constant_values=1),
    "scan_as_printed.resolution": 45, "unscented.update.residual": None,
    "match_field.prior_cov": np.eye(3), "gate": 1.0, "KLD.bins": [0.5, 0.5, 0.5],
    "SignatureMap.pitch": 0.5, "SignatureMap.reach": 5.0, "reach": 5.0, "offset": 0.1,
    "sample.size": 3, "entropy.belief": [0.2, 0.3, 0.5],
    "histogram.predict.belief": [0.2, 0.3, 0.5],
    "histogram.update.belief": [0.2, 0.3, 0.5], "predicted": [0.9, 0.4], "distance": 0.3,
    "sigma_wheel": 0.1, "n_headings": 8, "name": "belief", "value": Gaussian([0.5], [[1.0]]),
    "integration": "exact", "method": "split-and-merge",
}  # fmt: skip


SENSOR, LIDAR = RangeBearing(0.1, 0.1), Lidar(24, max_range=5.0, sigma_range=0.01)
ROOM = rooms.box_room()
V3, EYE3 = 0.01 * np.eye(3), np.eye(3)
TRACK = np.cumsum(np.random.default_rng(6).normal(size=(12, 3)) * [0.3, 0.3, 0.1], axis=0)


def made():
    """What only the library can make: a log, a filter, a graph, a path, a floor seen."""
    drive = np.tile([0.5, 0.1, 0.2], (8, 1)), 0.4, 0.01 * np.eye(3)
    logs = landmark_drives(YOUBOT, SENSOR, POINTS, *drive, 2, np.random.default_rng(5))
    slam = EKFSlam(YOUBOT, SENSOR, np.zeros(3), 0.01 * np.eye(3))
    slam.update(SENSOR.observe(np.zeros(3), POINTS[:5]), range(5))
    corners = np.array([[0, 0, 0], [1, 0, 1.6], [1, 1, 3.1], [0, 1, -1.6]])
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    path, floor = PathMemory(0.02), ExplorationGrid([0, 0, 4, 4], 0.1)
    for s in np.linspace(0, 2, 30):
        path.add([s, 0.3 * np.sin(s)])
    pose = np.array([1.5, 1.5, 0.2])
    scan = LIDAR.scan(ROOM, pose, np.random.default_rng(7))
    floor.insert(pose, scan, LIDAR)
    t = np.linspace(0, 1, 9)
    compressed = CompressedEKFSlam(YOUBOT, SENSOR, np.zeros(3), 0.01 * np.eye(3))
    fast = FastSlam(YOUBOT, SENSOR, np.zeros(3), 5, rng=np.random.default_rng(9))
    for system in (compressed, fast):
        system.update(SENSOR.observe(np.zeros(3), POINTS[:5]), range(5))
    z = between(corners[edges[:, 0]], corners[edges[:, 1]])
    marks = {
        "landmarks": [[0.5, 0.5]],
        "landmark_edges": [[0, 0]],
        "landmark_measurements": [[0.5, 0.5]],
    }
    graph = PoseGraph(corners, edges, z, np.tile(100.0 * np.eye(3), (4, 1, 1)), **marks)
    grown = IncrementalGraph()
    grown.add_pose([1, 0, 0.1], np.eye(3))
    scans = ScanGraphSlam(LIDAR)
    scans.update(scan)
    one_scan = Log([0.0], [[0, 0, 0]], 0.0, EYE3, ranges=scan[None], scan=LIDAR)
    return {
        "one scan": one_scan,
        "sessions": Sessions(scans, one_scan),
        "compressed": compressed,
        "fast": fast,
        "graph": graph,
        "grown": grown,
        "scans": scans,
        "logs": logs,
        "log": logs.single(0),
        "slam": slam,
        "poses": corners,
        "edges": edges,
        "path": path,
        "floor": floor,
        "measurements": between(corners[edges[:, 0]], corners[edges[:, 1]]),
        "scan": scan,
        "t": t,
        "arc": np.stack([t, t**2], -1),
        "now": Situation(pose, scan, LIDAR, floor, 0.3, 0.2),
        "view": View(0.0, 0.1, pose, 0.01 * np.eye(3), scan, np.array(False)),
    }


MADE = made()
PAGES = SharedPages(3, np.zeros((4, 2)))
PAGES.extend(2)
LOG, SLAM, PATH = MADE["log"], MADE["slam"], MADE["path"]
INSTANCES = {
    "EKFSlam": SLAM,
    "CompressedEKFSlam": MADE["compressed"],
    "PathMemory": PATH,
    "PoseGraph": MADE["graph"],
    "ExplorationGrid": MADE["floor"],
    "SharedPages": PAGES,
    "Log": MADE["logs"],
    "FastSlam": MADE["fast"],
    "ScanGraphSlam": MADE["scans"],
    "Sessions": MADE["sessions"],
    "IncrementalGraph": MADE["grown"],
}
DROVE = record(
    ROOM,
    Unicycle(),
    LIDAR,
    Script(np.tile([0.3, 0.1], (5, 1))),
    DeadReckoning(Unicycle(), [1.5, 1.5, 0.2]),
    np.random.default_rng(8),
    start=[1.5, 1.5, 0.2],
    footprint=[[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]],
)
SCAN = MADE["scan"]
SPACE = np.random.default_rng(9).uniform([1, -1, 0], [4, 1, 1], (40, 3))
PIXELS = StereoOdometer().observe([0, 0, 0], SPACE, np.random.default_rng(10))
HALL = BitmapWorld(np.pad(np.zeros((30, 40)), 1, constant_values=1) > 0, 0.1)
WALL = [[[0.0, 0.0], [4.0, 0.0]], [[4.0, 0.0], [4.0, 3.0]]]
FOOT = [[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]]
GOOD |= (
    {
        "log": LOG,
        "system": DeadReckoning(YOUBOT, LOG.truth[0]),
        "run": run(SLAM, LOG),
        "slam": SLAM,
        "path": PATH,
        "law": ReturnLaw(),
        "now": MADE["now"],
        "view": MADE["view"],
        "body": YOUBOT_BODY,
        "robot": SquareRobot(0.3),
        "strategy": NearestFrontier(),
        "pilot": Script(np.tile([0.3, 0.1], (5, 1))),
        "estimate": TRACK,
        "truth": TRACK + 0.01,
        "edges": MADE["edges"],
        "measurements": MADE["measurements"],
        "tolerance": 0.05,
        "information": np.tile(100.0 * EYE3, (4, 1, 1)),
        "measurement": [1.0, 0.0, 0.1],
        "landmark_drives.motion": YOUBOT,
        "landmark_drives.u": np.tile([0.5, 0.1, 0.2], (4, 1)),
        "landmark_drives.control_cov": V3,
        "n_runs": 2,
        "room_drives.n_steps": 5,
        "dim": 2,
        "n_poses": 30,
        "n_edges": 40,
        "seed": 1,
        "errors": 0.1 * TRACK,
        "found": [[0.0, 0.0]],
        "walls": WALL,
        "wall_scores.walls": WALL,
        "monte_carlo.run": lambda rng: float(rng.normal()),
        "times": np.arange(12.0),
        "nees.covs": np.tile(EYE3, (12, 1, 1)),
        "invariant_nees.poses": (TRACK, TRACK + 0.01),
        "residuals": 0.1 * POINTS,
        "relation_error.poses": TRACK,
        "length": np.linspace(0, 3, 8),
        "relation_error.relations": (np.array([[0.0, 2.0], [1.0, 4.0]]), np.zeros((2, 3))),
        "reached_at.values": np.linspace(0, 1, 8),
        "window": 0.2,
        "angle_window": 0.1,
        "levels": 2,
        "origin": [0.0, 0.0],
        "rows": [1, 2],
        "columns": [1, 2],
        "cells": np.array([[1, 1], [2, 2]]),
        "empty": np.zeros((4, 2)),
        "slots": 2,
        "slot": 1,
        "chosen": np.arange(8) % 5,
        "ancestors": np.tile(np.arange(6), (4, 1)),
        "t": MADE["t"],
        "propose": lambda particles, rng: particles + 0.1,
        "goal": [2.0, 1.5],
        "s": 0.4,
        "log_likelihood": lambda particles: -np.abs(particles[:, 0]),
        "check_motion_model.model": Unicycle(),
        "as_motion.value": Unicycle(),
        "as_sensor.value": SENSOR,
        "as_scan_sensor.value": LIDAR,
        "as_estimator.value": SLAM,
        "fit_cubic.points": MADE["arc"],
        "fit_cubic.start": [0.0, 0.0],
        "curve": fit_cubic(MADE["t"], MADE["arc"], [0.0, 0.0]),
        "refit_by_arc_length.points": MADE["arc"],
        "coefficients": np.ones((2, 4)),
        "matched": [0.0, 0.01, 0.1],
        "outlines": [],
        "model": Unicycle(),
        "make": lambda pose: DeadReckoning(YOUBOT, pose),
        "footprint": FOOT,
        "n_landmarks": 5,
        "EKFSlamBatch.mean": np.zeros((2, 3)),
        "EKFSlam.mean": np.zeros(3),
        "CompressedEKFSlam.mean": np.zeros(3),
        "EKFSlam.motion": YOUBOT,
        "PoseGraph.poses": MADE["poses"],
        "run.system": SLAM,
        "edge_error.poses": MADE["poses"],
        "edge_jacobians.poses": MADE["poses"],
        "i": 0,
        "j": 1,
        "k": 1,
        "metres": [1.0],
        "measurements ": 0,
        "ids": [0, 1],
        "names": ["a"],
        "record.belief": DeadReckoning(Unicycle(), [1.5, 1.5, 0.2]),
        "record.robot": Unicycle(),
        "record.start": [1.5, 1.5, 0.2],
        "record.sensor": LIDAR,
        "radius": 2.0,
        "Encoders.read.wheel_speeds": np.ones((5, 4)),
        "Encoders.speeds.ticks": [3, 4, 5, 6],
        "Encoders.ticks.angles": [0.1, 0.2, 0.3, 0.4],
        "Encoders.spin.wheel_speeds": np.ones(4),
        "Mecanum.step.u": [0.3, 0.1, 0.1],
        "Mecanum.jacobians.u": [0.3, 0.1, 0.1],
        "Mecanum.sample.u": [0.3, 0.1, 0.1],
        "Mecanum.sample.control_cov": V3,
        "Mecanum.wheel_speeds.u": [0.3, 0.1, 0.1],
        "RelativePose.step.u": [0.3, 0.1, 0.1],
        "RelativePose.jacobians.u": [0.3, 0.1, 0.1],
        "RelativePose.sample.u": [0.3, 0.1, 0.1],
        "RelativePose.sample.control_cov": V3,
        "RangeBearing.log_likelihood.z": [[2.0, 0.1]],
        "RangeBearing.log_likelihood.landmarks": POINTS[:1],
        "RangeBearing.best_log_likelihood.z": [[2.0, 0.1]],
        "RangeBearing.best_log_likelihood.landmarks": POINTS[:1],
        "invariant_nees.covs": np.tile(EYE3, (12, 1, 1)),
        "steps": 3,
        "id": 0,
        "signature": "magnitude",
        "collisions.log": DROVE,
        "coverage.log": DROVE,
        "Body.length": 0.4,
        "Body.width": 0.3,
        "wall_scores.found": [[[0.0, 0.0], [3.9, 0.0]]],
        "SharedPages.own.particles": [0, 1],
        "SharedPages.own.slots": [0, 0],
        "where": [1, 0],
        "Log.u": TRACK,
        "Sessions.system": MADE["scans"],
        "Sessions.log": MADE["one scan"],
        "Sessions.add.system": MADE["scans"],
        "Sessions.add.log": MADE["one scan"],
        "Sessions.add.name": "a.log",
        "Sessions.check_lidar.log": MADE["one scan"],
        "Log.dt": 0.1 * np.ones(12),
        "Log.control_cov": V3,
        "SignatureMap.build.lidar": LIDAR,
        "ExplorationGrid.plan.start": [1.5, 1.5],
        "ExplorationGrid.shortest_paths.start": [1.5, 1.5],
        "PointsWithNormals.concatenated.outlines": [PointsWithNormals.estimate(POINTS)] * 2,
        "WallSlam.lidar": LIDAR,
        "WallSlam.motion": YOUBOT,
        "MonteCarloLocalization.world": POINTS,
        "CoveragePilot.lidar": LIDAR,
        "Explorer.lidar": LIDAR,
        "Cubic.coefficients": np.ones((4, 2)),
        "pixels": np.full((12, 3), 100.0),
        "StereoOdometer.observe.points": SPACE,
        "StereoOdometer.project.points": SPACE,
        "StereoOdometer.estimate.before": SPACE,
        "StereoOdometer.estimate.after": SPACE,
        "StereoOdometer.match.before": PIXELS,
        "StereoOdometer.match.after": PIXELS,
        "StereoOdometer.observe.pose": [0.0, 0.0, 0.0],
        "EKFSlamBatch.move_cov.F": np.tile(EYE3, (2, 1, 1)),
        "EKFSlamBatch.move_cov.Q": V3,
        "PoseGraph.from_log.motion": YOUBOT,
        "PoseGraph.with_poses.poses": MADE["poses"],
        "add_edge.information": EYE3,
        "IncrementalGraph.add_pose.information": EYE3,
        "IncrementalGraph.add_edge.information": EYE3,
        "worlds": {"room": HALL},
        "start": [0.5, 0.6, 0.2],
        "title": "A",
        "series": {"a": [1.0, 2.0]},
        "x_label": "x",
        "y_label": "y",
        "image": np.eye(3),
        "extent": [0.0, 1.0, 0.0, 1.0],
        "Scatter.series": {"a": [[1.0, 2.0]]},
        "sliders": {"a": [0.0, 1.0]},
        "panels": [Curves("A", [1.0, 2.0], {"a": np.ones((2, 2))}, "x", "y")],
        "origins": [1.5, 1.5],
        "sweep_collides.start": [1.5, 1.5, 0.2],
        "end": [1.0, 0.0],
        "bitmap": HALL,
        "BitmapWorld.sweep_collides.start": [1.5, 1.5, 0.2],
        "BitmapWorld.sweep_collides.end": [1.6, 1.5, 0.2],
        "WallWorld.sweep_collides.start": [1.5, 1.5, 0.2],
        "WallWorld.sweep_collides.end": [1.6, 1.5, 0.2],
        "Log.single.run": 0,
        "SharedPages.resample.chosen": [0, 2, 2],
        "from_polygons.polygons": WALL,
        "nis.covs": np.tile(np.eye(2), (12, 1, 1)),
        "ate.truth": TRACK + 0.01,
        "rpe.truth": TRACK + 0.01,
        "MonteCarloLocalization.bounds": [[0.0, 3.0], [0.0, 3.0]],
        "SignatureMap.build.resolution": 0.5,
        "with_signature.signature": "spectrum",
        "SignatureMap.with_signature.signature": "spectrum",
        "Cubic.arc_length.t": 0.5,
        "PathMemory.add.point": [2.05, 0.2],
        "StereoOdometer.run.points": SPACE,
        "EKFSlamBatch.update.ids": [0, 1],
        "EKFSlamBatch.update.z": np.full((2, 2, 2), 0.7),
        "FastSlam.predict.u": [0.1, 0.0, 0.01],
        "FastSlam.predict.control_cov": V3,
        "FastSlam.update.ids": [0, 1],
        "ScanGraphSlam.update.ranges": SCAN,
        "WallSlam.predict.u": [0.1, 0.0, 0.01],
        "WallSlam.predict.control_cov": V3,
        "WallSlam.update.ranges": SCAN,
        "WallSlam.update.measurement": SCAN,
        "MonteCarloLocalization.update.measurement": [[2.0, 0.1]],
        "HectorSlam.predict.u": [0.1, 0.0, 0.01],
        "Paths.truth": TRACK,
        "Paths.estimate": TRACK,
        "Landmarks.true": POINTS,
        "Landmarks.estimates": np.tile(POINTS, (3, 1, 1)),
        "Particles.poses": np.tile(POINTS, (3, 1, 1)),
        "LidarPoints.points": np.tile(POINTS, (3, 1, 1)),
        "Occupancy.probability": 0.5 * np.eye(3),
        "Occupancy.extent": [0.0, 1.0, 0.0, 1.0],
        "name": "belief",
        "WallWorld.from_polygons.polygons": None,
        "error": 0.1 * np.ones(12),
        "plots.error_band.t": np.arange(12.0),
        "plots.error_band.sigma": np.ones(12),
        "label": "a",
        "line_style.kind": "truth",
        "probability": 0.9,
        "occupancy.probability": 0.5 * np.eye(3),
        "Table.columns": ["a", "b"],
        "Table.rows": [["a", 1.0]],
        "claims.rows": [["all is well", "none given", 1.0, "< 2 m"]],
        "P": np.eye(2),
        "S": np.eye(2),
        "arr": [5, 1, 4],
        "dot1": [1.0, 2.0],
        "dot2": [2.0, 0.0],
        "dot": [1.0, 2.0],
        "centre": [0.0, 1.0],
        "degrees": 30.0,
        "RobotAsPrinted.lidar": LIDAR,
        "RobotAsPrinted.pose": [1.5, 1.5, 0.2],
        "RobotAsPrinted.move.step": 3,
        "ForgetsCrossCovariance.mean": np.zeros((2, 3)),
        "ForcedDecorrelation.mean": np.zeros((2, 3)),
        "LocalBlockSlam.mean": np.zeros(3),
        "LocalBlockSlam.motion": YOUBOT,
        "first": 100.0 * POINTS,
        "second": 100.0 * POINTS + 1.0,
        "epipolar_distances.F": EYE3,
        "pose_i": [0.0, 0.1, 0.2],
        "pose_j": [1.0, 0.1, 0.2],
        "s2": 0.1 * np.ones(4),
        "nu": 3.0 * np.ones(4),
        "log_density.alpha": 2.0,
        "log_density.beta": 0.1,
        "grid": Grid((8, 8), 0.5),
        "Terrain.heights": 0.1 * np.eye(8),
        "lines": [[1.0, 0.2]],
        "ReturnPilot.path": np.stack([np.linspace(0, 3, 31), np.zeros(31)], -1),
        "ReturnPilot.guard": CollisionGuard(YOUBOT_BODY),
        "ReturnPilot.lidar": LIDAR,
        "min_range": 3.0,
        "max_range": 9.0,
        "AdaptiveRange.system": MADE["compressed"],
    }
    | {
        f"{name}.{parameter}": value
        for name in ("EKFSlam", "CompressedEKFSlam", "HectorSlam", "ScanGraphSlam", "GridFastSlam")
        for parameter, value in (("predict.u", [0.1, 0.0, 0.01]), ("predict.control_cov", V3))
    }
    | {
        f"{name}.z": SENSOR.observe(np.zeros(3), POINTS[:2])
        for name in (
            "joint_compatibility",
            "joint_search",
            "maximum_likelihood",
            "nearest_euclidean",
            "nearest_neighbour",
            "EKFSlam.update",
            "CompressedEKFSlam.update",
            "FastSlam.update",
        )
    }
)
BAD = {
    "None": None, "word": "90", "complex": 1 + 2j, "huge": 10**400, "nan": np.nan, "inf": np.inf,
    "minus": -1.0, "zero": 0, "object": object(), "dict": {"a": 1}, "empty": [],
    "ragged": [[1], 2],
    "date": np.datetime64("2024-01-01"), "masked": np.ma.array([1.0, 2.0, 3.0], mask=[0, 1, 0]),
    "duration": datetime.timedelta(1), "five": np.ones(5), "cube": np.ones((2, 3, 4)),
    "nans": np.full(3, np.nan), "large": 1e308 * np.ones(3), "int": np.int64(3), "type": dict,
}  # fmt: skip
# Inside the house data is trusted: what calls these checked it at its own door.
TRUSTED = (
    "SharedPages.extend", "SharedPages.own", "SharedPages.rearrange", "SharedPages.resample",
    ".choose", ".quarters", "ReturnPilot.command", ".centres_of", ".of_occupancy", ".move_cov",
)  # fmt: skip
# May be functions: what a function does that is none of the library's is its own affair.
FUNCTIONS = {"F", "H", "f", "h", "residual", "run", "make", "propose", "log_likelihood"}
# Made by the library, for reading; a reader of files has a fuzz of its own.
RECORDS = {
    "Simulator",
    "Sweep",
    "AssociationScores",
    "Innovation",
    "Certificate",
    "Ellipse",
    "JointSearch",
    "Killian",
    "Location",
    "ManhattanGraph",
    "Result",
    "Run",
    "Sighting",
    "Situation",
    "SteadyState",
    "Step",
    "TrajectoryError",
    "Trial",
    "Verdict",
    "View",
    "VisualOdometer",
    "WallScores",
    "WallSighting",
    "Walls",
    "ShortestPaths",
    "Relations",
    "Motion",
    "Closure",
}
READERS = ("read_", "write_", "save", "load", "from_file", "from_polygons")


def targets():
    """All public functions, classes and methods of the rooms: a name, and what calls it afresh."""
    for info in pkgutil.walk_packages(slamlab.__path__, "slamlab."):
        parts = info.name.split(".")
        if parts[1] not in ROOMS or any(part.startswith("_") for part in parts):
            continue
        module = importlib.import_module(info.name)
        for name in getattr(module, "__all__", []):
            target = getattr(module, name)
            home = str(getattr(target, "__module__", "")).split("._")[0]  # of plots._draw: plots
            here = home == info.name and callable(target)
            if not here or name.startswith(READERS) or getattr(target, "_is_protocol", False):
                continue
            if not inspect.isclass(target):
                yield f"{parts[-1]}.{name}", target
            elif not issubclass(target, Warning):
                yield f"{parts[-1]}.{name}", target


# Formulas as printed keep the faults of the print: a NaN may be one of them.
MAY_BE_NAN = ("p1.", "p2.", "p4.", "p5.")


def good(name, function):
    """Good arguments for all parameters that have no default; None if one has no value."""
    found = {}
    for p in inspect.signature(function).parameters.values():
        keys = (f"{name}.{p.name}", f"{name.split('.', 1)[-1]}.{p.name}", p.name)
        known = [GOOD[key] for key in keys if key in GOOD and GOOD[key] is not None]
        if p.name == "rng" and p.default is p.empty:
            found[p.name] = np.random.default_rng(1)
        elif p.name == "ax":
            found[p.name] = Figure().subplots()
        elif p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD) or p.name == "self":
            continue
        elif p.default is p.empty or ".".join(keys[1].split(".")) in GOOD:
            if not known:
                return None
            found[p.name] = copy.deepcopy(known[0])
    return found


def copied(arguments):
    return {key: x if key == "ax" else copy.deepcopy(x) for key, x in arguments.items()}


def has_nan(value):
    parts = value if isinstance(value, tuple) else (value,)
    return any(isinstance(x, np.ndarray | float) and np.isnan(x).any() for x in parts)


def same(a, b):
    number = isinstance(a, np.ndarray) and a.dtype.kind in "fiub"
    return not number or np.array_equal(a, b, equal_nan=True)


# What NumPy says of a flag that is an array and of lists of unequal length is plain enough.
PLAIN = "The truth value of an array|setting an array element with a sequence"


def tried(function, arguments, finite):
    """What is wrong with a call, or None."""
    before = copied(arguments)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            result = function(**arguments)
    except (ValueError, OSError, ImportError) as error:
        said = str(error)
        foreign = type(error) is ValueError and not re.match(rf"[^ ]+.*: |{PLAIN}", said)
        return f"what is said: {said[:80]!r}" if foreign or len(said) > 600 else None
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:80]}"
    finally:
        changed = [key for key in before if not same(before[key], arguments[key])]
    if changed:
        return f"changed {changed}"
    return "a silent NaN" if finite and has_nan(result) else None


CALLS = {"bad": 0, "dressed": 0}


def named_parameters(function):
    """Those that can be spoilt one by one."""
    parameters = inspect.signature(function).parameters.values()
    return [p.name for p in parameters if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)]


def complaints(name, function):
    parameters = named_parameters(function)
    arguments = good(name, function) if parameters else None
    if arguments is None:
        return
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            usual = function(**copied(arguments))
    except ValueError:
        return  # what is good elsewhere is not good here
    for parameter in parameters:
        for label, bad in BAD.items():
            if label == "type" and parameter in FUNCTIONS:  # what it does is its own affair
                continue
            spoilt = copied(arguments) | {parameter: bad}
            finite = "nan" not in label and label != "inf" and not has_nan(usual)
            finite &= not name.startswith(MAY_BE_NAN)
            wrong = tried(function, spoilt, finite)
            CALLS["bad"] += 1
            if wrong:
                yield f"{name}({parameter}={label}): {wrong}"


def methods(name, cls):
    """The public methods of a good instance, each called on a copy of its own."""
    instance = INSTANCES.get(cls.__name__)
    arguments = good(name, cls)
    if (instance is None and arguments is None) or issubclass(cls, ipywidgets.Widget):
        return  # a figure's methods are those of ipywidgets
    try:
        instance = cls(**arguments) if instance is None else instance
    except ValueError:
        return
    for method in dir(instance):
        if method.startswith(("_", *READERS)) or isinstance(getattr(cls, method, None), property):
            continue
        bound = getattr(instance, method, None)
        if inspect.ismethod(bound) and not f"{name}.{method}".endswith(TRUSTED):
            yield f"{name}.{method}", afresh(instance, method, bound)


def afresh(instance, method, bound):
    """What calls the method of a copy, and has the signature of the method."""

    @functools.wraps(bound)
    def call(**arguments):
        return getattr(copy.deepcopy(instance), method)(**arguments)

    return call


TARGETS = {name: target for name, target in targets() if name.split(".")[-1] not in RECORDS}


def test_nearly_all_that_is_public_is_tried():
    # A newcomer may wait for its good values; not many may.
    waiting = [name for name, target in TARGETS.items() if good(name, target) is None]
    assert len(waiting) < 0.15 * len(TARGETS), waiting


@pytest.mark.parametrize("name", TARGETS)
def test_bad_arguments_are_refused_with_a_sentence(name, record_property):
    before = CALLS["bad"]
    target = TARGETS[name]
    found = list(complaints(name, target))
    if inspect.isclass(target):
        for method, bound in methods(name, target):
            found += complaints(method, bound)
    record_property("calls", CALLS["bad"] - before)
    assert found == []


# The same numbers in other clothes; a column of every second number is not contiguous.
DRESSES = {
    "list": lambda a: a.tolist(),
    "tuple": lambda a: tuple(a.tolist()),
    "other byte order": lambda a: a.astype(a.dtype.newbyteorder("S")),
    "read only": lambda a: frozen(a),
    "by columns": lambda a: np.asfortranarray(a),
    "every second": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
    "long": lambda a: a.astype(np.longdouble) if a.dtype.kind == "f" else a.astype(np.int64),
    "objects": lambda a: a.astype(object),
}


def frozen(a):
    copied_ = a.copy()
    copied_.setflags(write=False)
    return copied_


def numbers_of(value, depth=3):
    """All numbers of an answer, in order."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        return [value.astype(float).ravel()]
    if isinstance(value, float | int | np.number):
        return [np.array([float(value)])]
    if isinstance(value, tuple | list):
        return [x for part in value for x in numbers_of(part, depth)]
    parts = getattr(value, "__dict__", {}) if depth else {}
    return [x for part in parts.values() for x in numbers_of(part, depth - 1)]


def answer(function, arguments):
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        return numbers_of(function(**copied(arguments)))


# What is drawn holds the figure; records keep what they are given, as it is.
UNDRESSED = (
    "plots.", "layers.", "sweep.", "visual_odometer.MeasuredMotion", "pages.SharedPages",
    "eight_point.fundamental_matrix",  # of equal points: any antisymmetric matrix fits
)  # fmt: skip


def changed_by_dress(name, function):
    """In which clothes the same numbers give another answer, or are refused."""
    arguments = good(name, function) if named_parameters(function) else None
    if arguments is None:
        return
    try:
        usual = answer(function, arguments)
    except ValueError:
        return
    for parameter, value in arguments.items():
        try:
            plain = np.asarray(value)
        except ValueError:
            continue
        if isinstance(value, str) or plain.dtype.kind not in "fi" or plain.ndim == 0:
            continue
        for label, dress in DRESSES.items():
            if label == "objects" and plain.dtype.kind == "i":
                continue  # whole numbers that are no integers are refused
            CALLS["dressed"] += 1
            try:
                same_numbers = answer(function, arguments | {parameter: dress(plain)})
            except Exception as error:
                yield f"{name}({parameter} as {label}): {type(error).__name__}: {error}"[:200]
                continue
            alike = len(usual) == len(same_numbers) and all(
                a.shape == b.shape and np.allclose(a, b, 1e-9, 1e-12, equal_nan=True)
                for a, b in zip(usual, same_numbers, strict=True)
            )
            if not alike:
                yield f"{name}({parameter} as {label}): another answer"


@pytest.mark.parametrize("name", TARGETS)
def test_the_same_numbers_in_other_clothes_give_the_same_answer(name, record_property):
    if name.startswith(UNDRESSED):
        return
    target, before = TARGETS[name], CALLS["dressed"]
    found = list(changed_by_dress(name, target))
    if inspect.isclass(target):
        for method, bound in methods(name, target):
            found += changed_by_dress(method, bound)
    record_property("calls", CALLS["dressed"] - before)
    assert found == []
