"""What each system makes of one log: the numbers that a rewrite must not move.

``python -m tests.golden.runs --write`` stores those that the file lacks; ``--write NAME ...``
stores some anew (only where a commit says that a number moves, and why). The others stay.
"""

import json
import sys
from functools import cache
from pathlib import Path

import numpy as np

from slamlab.datasets import killian
from slamlab.evaluation import run
from slamlab.filters import kalman
from slamlab.gaussian import Gaussian
from slamlab.localization import MonteCarloLocalization, SignatureMap
from slamlab.mapping import OccupancyGrid
from slamlab.matching import (
    LikelihoodGrid,
    match_correlative,
    match_field,
    match_icp,
    voxel_downsample,
)
from slamlab.navigation import YOUBOT_BODY, CoveragePilot, PathMemory
from slamlab.robots import YOUBOT, RelativePose
from slamlab.sensors import Lidar, StereoRig
from slamlab.simulation import ROOM_SENSOR, PerfectEstimator, ground_laps, record, room_drives
from slamlab.slam import (
    AdaptiveRange,
    CompressedEKFSlam,
    EKFSlam,
    EKFSlamBatch,
    FastSlam,
    GammaSlam,
    GridFastSlam,
    HectorSlam,
    IncrementalGraph,
    ScanGraphSlam,
    WallSlam,
)
from slamlab.slam.association import joint_compatibility, maximum_likelihood
from slamlab.worlds import Terrain, rooms

STORED = Path(__file__).with_name("systems.json")
EXACT, MATCHED = 1e-9, 1e-6  # relative to the largest number; of what rests on scan matching


def rng(seed=5):
    return np.random.default_rng(seed)


# Logs of the chapters.


@cache
def drives():
    """Chapter 09: a round among 24 landmarks, three robots."""
    return room_drives(3, rng(0), n_steps=200, sigma_wheel=1.0)


@cache
def court():
    """Chapter 14: Killian Court, the first 300 scans."""
    return killian().log[:300]


@cache
def office():
    """Chapter 20: a drive through the office, by a robot that knows where it is."""
    lidar = Lidar(90, max_range=8.0, sigma_range=0.01)
    pilot = CoveragePilot(YOUBOT_BODY, lidar, view_range=3.0, max_speed=0.6, max_turn=1.0)
    return record(
        rooms.office(), YOUBOT, lidar, pilot, PerfectEstimator(), rng(20),
        start=[2.0, 4.0, 0.0], dt=0.2, control_cov=YOUBOT.control_cov(0.4),
        footprint=YOUBOT_BODY.footprint, max_time=50.0,
    )  # fmt: skip


@cache
def ground():
    """Chapter 15: heights of rough ground from a stereo rig."""
    return ground_laps(
        Terrain.rough(rng(1), (22, 22), spread=0.9), StereoRig(1000), rng(1), laps=0.1
    )


# What is kept of a run.


def some(array, most=24):
    """At most so many rows, evenly spread, the last among them."""
    array = np.asarray(array, dtype=float)
    return array[np.unique(np.linspace(len(array) - 1, 0, most).astype(int))]


def seen(result, **more):
    kept = {"poses": some(result.poses), "covs": some(result.covs)}
    return kept | {name: np.asarray(value, dtype=float) for name, value in more.items()}


def moments(field):
    """Sums of a map by columns and by rows, weighed by their numbers: any cell moves them."""
    field = np.nan_to_num(np.asarray(field, dtype=float))
    rows, columns = np.arange(field.shape[0]), np.arange(field.shape[1])
    return [field.sum(), np.square(field).sum(), rows @ field.sum(1), columns @ field.sum(0)]


# Systems.


def ekf(**options):
    log = drives().single(0)
    result = run(EKFSlam(YOUBOT, ROOM_SENSOR, log.truth[0], **options), log)
    return seen(result, landmarks=result.system.landmarks, last=result.system.cov[:9])


def unnamed(associate):
    log = drives().single(1)
    system = EKFSlam(YOUBOT, ROOM_SENSOR, log.truth[0], associate=associate)
    kept = []
    for step in log:
        system.predict(step.u, step.dt, step.control_cov)
        if step.z is not None and len(step.z):
            system.update(step.z)
        kept.append(system.pose)
    return {"poses": some(kept), "landmarks": system.landmarks}


def compressed():
    log = drives().single(0)
    result = run(CompressedEKFSlam(YOUBOT, ROOM_SENSOR, log.truth[0], radius=2.0), log)
    return seen(result, landmarks=result.system.landmarks)


def batch():
    log = drives()
    return seen(run(EKFSlamBatch(YOUBOT, ROOM_SENSOR, log.truth[0], n_landmarks=24), log))


def local_range():
    log = drives().single(0)
    inner = EKFSlam(YOUBOT, ROOM_SENSOR, log.truth[0])
    return seen(run(AdaptiveRange(inner, n_target=3, min_range=2.0, max_range=5.0), log))


def fast(version, **options):
    log = drives().single(0)
    system = FastSlam(YOUBOT, ROOM_SENSOR, log.truth[0], 30, version, rng=rng(), **options)
    result = run(system, log)
    return seen(result, landmarks=result.system.landmarks)


def monte_carlo():
    log = drives().single(0)
    bounds = [[-6.0, 6.0], [-5.0, 5.0]]
    return seen(
        run(MonteCarloLocalization(log.landmarks, YOUBOT, ROOM_SENSOR, 500, bounds, rng()), log)
    )


def walls():
    log = office()[:120]
    result = run(WallSlam(YOUBOT, log.scan, log.truth[0]), log)
    return seen(result)


def hector():
    log = court()
    return seen(run(HectorSlam(log.scan, log.truth[0], motion=RelativePose()), log))


def scan_graph():
    log = court()
    result = run(ScanGraphSlam(log.scan, log.truth[0]), log)
    return seen(result, trajectory=some(result.trajectory))


def scan_graph_office():
    log = office()
    result = run(ScanGraphSlam(log.scan, log.truth[0], motion=YOUBOT), log)
    return seen(result, trajectory=some(result.trajectory))


def grid_fast(model):
    log = office()[:100]
    system = GridFastSlam(log.scan, log.truth[0], 8, rng=rng(), motion=YOUBOT, model=model)
    return seen(run(system, log))


def gamma():
    log = ground()
    return seen(run(GammaSlam(log.scan, log.truth[0], 10, rng=rng()), log))


def kalman_series():
    T = 80
    F, Q = np.array([[1.0, 0.1], [0.0, 1.0]]), np.diag([1e-4, 1e-2])
    H, R = np.array([[1.0, 0.0]]), np.array([[0.04]])
    z = np.cumsum(rng().normal(0, 0.1, (3, T, 1)), axis=1)
    z[:, 10:14] = np.nan
    filtered = kalman.filter(z, F, H, Q, R, Gaussian(np.zeros(2), np.eye(2)))
    smoothed = kalman.smooth(filtered)
    return {
        "means": filtered.means,
        "covs": some(filtered.covs[0]),
        "smoothed": smoothed.means,
        "smoothed covs": some(smoothed.covs[0]),
    }


def graph():
    court = killian()
    start = court.graph.with_poses(court.dead_reckoned())
    result = start.optimize(tolerance=1e-12)
    return {"chi2": [start.chi2(), result.chi2], "poses": some(result.poses)}


def incremental():
    """A ring of 60 poses, each told to the graph as it comes, and one closure."""
    step, grown = np.array([0.5, 0.0, np.pi / 30]), IncrementalGraph()
    information = np.diag([400.0, 400.0, 900.0])
    for noise in rng().normal(0, [0.05, 0.05, 0.03], (59, 3)):
        grown.add_pose(step + noise, information)
    grown.add_edge(59, 0, step, information)
    return {"poses": some(grown.poses)}


def matching():
    log = court()
    points = [log.scan.points(scan) for scan in log.ranges[:2]]
    points = [p[np.isfinite(p).all(-1)] for p in points]
    base, guess = voxel_downsample(points[0]), np.array([0.05, 0.02, 0.03])
    field = LikelihoodGrid.of_points(base, 0.1)
    found = {"icp": match_icp(base, points[1], guess)}
    found["field"] = match_field(field, points[1], guess)
    found["search"] = match_correlative(field, points[1], guess, 0.5, 0.3)
    kept = {f"{name} pose": found[name].pose for name in found}
    kept |= {f"{name} cov": found[name].cov for name in found}
    return kept | {f"{name} score": found[name].score for name in found} | {"thinned": base}


def occupancy():
    log = court()
    grid = OccupancyGrid((400, 400), 0.2, origin=(-40.0, -40.0))
    for pose, ranges in zip(log.truth[:60], log.ranges[:60], strict=True):
        grid.insert(pose, ranges, log.scan)
    field = LikelihoodGrid.of_occupancy(grid.log_odds, grid.resolution, grid.origin)
    points = log.scan.points(log.ranges[10])
    points = points[np.isfinite(points).all(-1)]
    match = match_field(field, points, log.truth[10] + [0.05, -0.05, 0.02])
    return {"log odds": moments(grid.log_odds), "pose": match.pose}


def path_memory():
    t = np.linspace(0.0, 6.3, 400)
    memory = PathMemory(0.005)
    for point in np.stack([2 * np.cos(t), np.sin(2 * t)], -1):
        memory.add(point)
    s = np.linspace(0.0, memory.length, 24)
    near = memory.nearest([[0.3, 0.2], [1.0, -0.5]])
    return {
        "length": memory.length,
        "points": memory.point_at(s),
        "nearest": np.stack([np.asarray(part, dtype=float).ravel() for part in near]),
        "segments": len(memory.segments),
    }


def exploration():
    log = office()
    return {"truth": some(log.truth), "commands": some(log.u), "steps": len(log)}


def signatures():
    lidar = Lidar(120, max_range=8.0)
    room = rooms.thesis_room()
    atlas = SignatureMap.build(room, lidar, 8)
    poses = np.array([[1.0, 1.0, 0.3], [2.0, 1.5, -1.2]])
    found = [atlas.locate(scan) for scan in lidar.scan(room, poses)]
    return {"poses": [one.pose for one in found]}


GOLDEN = {
    "EKF-SLAM": (ekf, EXACT),
    "EKF-SLAM, first estimates": (lambda: ekf(linearisation="first-estimates"), EXACT),
    "EKF-SLAM, invariant": (lambda: ekf(linearisation="invariant"), EXACT),
    "EKF-SLAM, nearest neighbour": (lambda: unnamed(None), EXACT),
    "EKF-SLAM, maximum likelihood": (lambda: unnamed(maximum_likelihood), EXACT),
    "EKF-SLAM, joint compatibility": (lambda: unnamed(joint_compatibility), EXACT),
    "compressed EKF-SLAM": (compressed, EXACT),
    "EKF-SLAM, batch": (batch, EXACT),
    "local range": (local_range, EXACT),
    "walls": (walls, MATCHED),
    "FastSLAM 1": (lambda: fast(1), EXACT),
    "FastSLAM 2": (lambda: fast(2), EXACT),
    "Monte Carlo": (monte_carlo, EXACT),
    "Hector": (hector, 1e-5),
    "scan graph": (scan_graph, MATCHED),
    "scan graph, office": (scan_graph_office, MATCHED),
    "grid FastSLAM": (lambda: grid_fast("matching"), MATCHED),
    "grid FastSLAM, penetration": (lambda: grid_fast("penetration"), MATCHED),
    "Gamma-SLAM": (gamma, EXACT),
    "Kalman series": (kalman_series, EXACT),
    "pose graph": (graph, MATCHED),
    "pose graph, incremental": (incremental, MATCHED),
    "matching": (matching, MATCHED),
    "occupancy": (occupancy, 1e-5),
    "path memory": (path_memory, EXACT),
    "exploration": (exploration, EXACT),
    "signatures": (signatures, EXACT),
}


def digits(value):
    value = np.asarray(value, float)
    return np.array([float(f"{x:.12g}") for x in value.flat]).reshape(value.shape).tolist()


def write(names=()):
    """Store what these systems make, and what is not stored yet."""
    known = json.loads(STORED.read_text()) if STORED.exists() else {}
    stored = {}
    for name, (make, _) in GOLDEN.items():
        if name in names or name not in known:
            print(name, flush=True)
            stored[name] = {key: digits(value) for key, value in make().items()}
        else:
            stored[name] = known[name]
    text = json.dumps(stored).replace('}, "', '},\n "')
    STORED.write_text(text + "\n")


if __name__ == "__main__" and "--write" in sys.argv:
    asked = sys.argv[sys.argv.index("--write") + 1 :]
    if unknown := sorted(set(asked) - set(GOLDEN)):
        sys.exit(f"expected names of golden runs, got {', '.join(unknown)}")
    write(asked)
