"""The reading path: lines of all distinct library functions that one step of a system runs.

The door, `_checks.py`, is counted apart: who reads a system takes from it only that an argument is
what the docstring says. So are the `PARTS`, systems with a lesson and a row of their own, where
another system calls them: who reads FastSLAM knows how particles are resampled. And so are systems
that another one keeps whole, in its row alone (`INSIDE`): who reads WallSlam knows EKF-SLAM.
"""

import ast
import sys
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

import slamlab
from slamlab import _checks
from slamlab.evaluation import run
from slamlab.filters import kalman
from slamlab.filters.particle import ParticleFilter
from slamlab.gaussian import Gaussian
from slamlab.localization import MonteCarloLocalization, SignatureMap
from slamlab.localization.global_localization import GlobalLocalization
from slamlab.mapping import OccupancyGrid, extract_walls
from slamlab.matching import (
    LikelihoodGrid,
    PointsWithNormals,
    match_correlative,
    match_field,
    match_icp,
)
from slamlab.models import View
from slamlab.navigation import ExplorationGrid, Explorer, LongestBeam, PathMemory
from slamlab.navigation.boxes import search
from slamlab.robots import YOUBOT, RelativePose, SquareRobot
from slamlab.sensors import Lidar, RangeBearing, StereoRig
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
    PoseGraph,
    ScanGraphSlam,
    Sessions,
    WallSlam,
)
from slamlab.slam._chain import PoseChain
from slamlab.slam._closures import ClosureSearch
from slamlab.slam._joining import recognised
from slamlab.slam._landmark_maps import LandmarkMaps
from slamlab.slam.association import joint_search
from slamlab.worlds import BitmapWorld, Terrain, rooms
from tests.slam.ring import drive

ROOT = Path(slamlab.__file__).parent
SENSOR = RangeBearing(0.05, 0.02, offset=0.3)
CONTROL = np.array([0.5, 0.1, 0.2]), 0.1, YOUBOT.control_cov(0.4)
OWN, ALL, DOOR = 120, 260, 110


@cache
def code_lines(path):
    """Lines of a file that hold code: no blanks, comments or docstrings."""
    source = path.read_text()
    code = {
        number
        for number, line in enumerate(source.splitlines(), 1)
        if line.strip() and not line.strip().startswith("#")
    }
    for node in ast.walk(ast.parse(source)):
        body = getattr(node, "body", None)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            code -= set(range(body[0].lineno, body[0].end_lineno + 1))
    return code


@cache
def functions(path):
    """Lines of each function of a file, by its first line (that of a decorator, if it has one)."""
    found = {}
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef):
            first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
            found[first] = set(range(first, node.end_lineno + 1)) & code_lines(path)
    return found


def path_of(step):
    """Run a step; return how many lines of which file it reads, as {file: lines}."""
    for check in vars(_checks).values():  # what a cache remembers is read all the same
        if hasattr(check, "cache_clear"):
            check.cache_clear()
    called = set()

    def note(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(ROOT):
            called.add((path, frame.f_code.co_firstlineno))

    sys.setprofile(note)
    try:
        step()
    finally:
        sys.setprofile(None)
    lines = {}
    for path, first in called:
        lines.setdefault(path, set()).update(functions(path).get(first, ()))
    return {path.relative_to(ROOT).as_posix(): len(some) for path, some in lines.items()}


# Each returns a function that makes one step: `predict`, then `update` with what a step measures.


def ekf_slam():
    """Two landmarks of the map and a new one."""
    slam = EKFSlam(YOUBOT, SENSOR, [0, 0, 0], 0.01 * np.eye(3))
    slam.update([[2.0, 0.3], [3.0, -0.4]], ["oak", "ash"])

    def step():
        slam.predict(*CONTROL)
        slam.update([[2.0, 0.3], [3.0, -0.4], [4.0, 0.1]], ["oak", "ash", "elm"])

    return step


def joint_compatibility():
    """Two landmarks of the map and a new one, without names, associated as chapter 11 does."""
    slam = EKFSlam(
        *(YOUBOT, SENSOR, [0, 0, 0], 0.01 * np.eye(3)),
        associate=lambda slam, z: joint_search(slam, z).rows,
    )
    slam.update([[2.0, 0.3], [3.0, -0.4]], [0, 1])

    def step():
        slam.predict(*CONTROL)
        assert slam.update([[2.0, 0.3], [3.0, -0.4], [6.0, 1.5]]).ids == (0, 1, 2)

    return step


def compressed_ekf_slam():
    """Two landmarks of a region that is not left, and a new one."""
    slam = CompressedEKFSlam(YOUBOT, SENSOR, [0, 0, 0], 0.01 * np.eye(3))
    slam.update([[2.0, 0.3], [3.0, -0.4], [9.0, 0.5]], ["oak", "ash", "fir"])
    slam.set_region(["oak", "ash"])

    def step():
        slam.predict(*CONTROL)
        slam.update([[2.0, 0.3], [3.0, -0.4], [4.0, 0.1]], ["oak", "ash", "elm"])

    return step


def adaptive_range():
    """A landmark within the range and one beyond it; the range changes."""
    inner = EKFSlam(YOUBOT, SENSOR, [0, 0, 0], 0.01 * np.eye(3))
    slam = AdaptiveRange(inner, n_target=2, min_range=1.0, max_range=5.0)
    slam.update([[2.0, 0.3], [3.0, -0.4]], ["oak", "ash"])

    def step():
        slam.predict(*CONTROL)
        slam.update([[2.0, 0.3], [4.0, 0.1], [9.0, 0.2]], ["oak", "elm", "fir"])
        assert slam.n_seen == 2

    return step


def scan_of_walls(x):
    lidar = Lidar(181, np.pi / 2, offset=0.3, sigma_range=0.01)
    return lidar, lidar.scan(rooms.office(), [x, 4.0, 0.0], np.random.default_rng(0))


def wall_slam():
    """Walls of the map, and pieces that are too short to be new ones."""
    lidar, scan = scan_of_walls(2.0)
    slam = WallSlam(YOUBOT, lidar, [2.0, 4.0, 0.0])
    slam.update(scan)
    _, scan = scan_of_walls(2.1)

    def step():
        slam.predict(*CONTROL)
        ids = slam.update(scan).ids
        assert None in ids
        assert len(set(ids)) > 1

    return step


def walls():
    """A scan of a room: straight pieces, some of them of one wall."""
    lidar, scan = scan_of_walls(2.1)
    points = lidar.points(scan)

    def step():
        assert len(extract_walls(points, lidar.sigma_range)) > 3

    return step


def ekf_slam_batch():
    """Two landmarks of the map and a new one, in two runs."""
    slam = EKFSlamBatch(YOUBOT, SENSOR, np.zeros((2, 3)), 0.01 * np.eye(3), n_landmarks=3)
    z = np.tile([[2.0, 0.3], [3.0, -0.4], [4.0, 0.1]], (2, 1, 1))
    slam.update(z[:, :2], [0, 1])

    def step():
        slam.predict(*CONTROL)
        slam.update(z, [0, 1, 2])

    return step


def fast_slam(version):
    """Two landmarks of the map and a new one, without resampling."""
    rng = np.random.default_rng(0)
    slam = FastSlam(YOUBOT, SENSOR, [0, 0, 0], 20, version, rng=rng, threshold=0.0)
    slam.update([[2.0, 0.3], [3.0, -0.4]], ["oak", "ash"])

    def step():
        slam.predict(*CONTROL)
        slam.update([[2.0, 0.3], [3.0, -0.4], [4.0, 0.1]], ["oak", "ash", "elm"])

    return step


def monte_carlo(injection):
    """Three landmarks, far from where they were: particles are injected, if they may be."""
    rng, trees = np.random.default_rng(0), np.array([[1.0, 1.0], [4.0, 2.0], [2.0, 4.0]])
    bounds = [[0.0, 5.0], [0.0, 5.0]]
    mcl = MonteCarloLocalization(trees, YOUBOT, SENSOR, 500, bounds, rng, injection)
    mcl.update(SENSOR.observe([2.0, 2.0, 0.0], trees), [0, 1, 2])

    def step():
        mcl.predict(*CONTROL)
        mcl.update(SENSOR.observe([4.0, 4.0, 2.0], trees), [0, 1, 2])
        assert (mcl.injected > 0) == (injection is not None)

    return step


def global_localization(tracking):
    """A scan in which the particles become one place; or one that is matched there."""
    rng, lidar, cov = np.random.default_rng(1), Lidar(90, max_range=8.0), np.diag([4, 4, 1]) * 1e-4
    cells = np.ones((60, 100), bool)
    cells[2:58, 2:98] = cells[20:40, 50:70] = False
    cells[30:44, 50:64] = True
    hall = BitmapWorld(cells, 0.1)
    system = GlobalLocalization(hall, lidar, RelativePose(), rng, n_particles=2000)
    scans = lidar.scan(hall, np.column_stack([1 + 0.25 * np.arange(9), np.full((9, 2), [1.5, 0])]))

    def step(k):
        system.predict([0.25, 0, 0], 1.0, cov)
        system.update(scans[k])

    for k in range(3 + tracking):
        step(k)
    assert system.localized == tracking

    def last():
        step(3 + tracking)
        assert system.localized

    return last


def particle_filter():
    """Particles of one number, resampled."""
    rng = np.random.default_rng(0)
    belief = ParticleFilter(rng.normal(0.0, 2.0, (400, 1)), rng, threshold=1.0)

    def step():
        belief.predict(lambda x, rng: x + 1.0 + rng.normal(0.0, 0.5, x.shape))
        belief.update(lambda x: -2.0 * (3.0 - x[:, 0]) ** 2)
        assert belief.resampled

    return step


def grid_fast_slam(model):
    """A scan of walls that the map has, without resampling."""
    rng, lidar = np.random.default_rng(0), Lidar(40, max_range=8.0, sigma_range=0.01)
    slam = GridFastSlam(
        lidar, [2.0, 4.0, 0.0], 2, rng=rng, motion=YOUBOT, model=model, threshold=0.0
    )
    ranges = lidar.scan(rooms.office(), [2.0, 4.0, 0.0], rng)
    slam.update(ranges)

    def step():
        slam.predict(*CONTROL)
        slam.update(ranges)

    return step


def gamma_slam():
    """A picture of ground that the map has, without resampling."""
    rng, rig = np.random.default_rng(0), StereoRig(200)
    slam = GammaSlam(rig, [3.0, 3.0, 0.0], 5, rng=rng, motion=YOUBOT, threshold=0.0)
    ranges = rig.scan(Terrain.rough(rng, (6.0, 6.0)), [3.0, 3.0, 0.0])
    slam.update(ranges)

    def step():
        slam.predict(*CONTROL)
        slam.update(ranges)

    return step


def pose_graph(method, **options):
    """Four poses and a closure that contradicts them, to the end."""
    step = np.array([1.0, 0.0, np.pi / 2])
    measurements = np.vstack([np.tile(step, (3, 1)), step + 0.1])
    graph = PoseGraph(
        [[0, 0, 0], [1, 0, 1.5], [1, 1, 3], [0, 1, 4.5]],
        [[0, 1], [1, 2], [2, 3], [3, 0]],
        measurements,
        np.diag([100.0, 100.0, 400.0]),
    )
    return lambda: graph.optimize(method, **options)


def incremental_graph():
    """A pose and a closure more, with the factors of the graph before."""
    step, grown = np.array([1.0, 0.0, np.pi / 2]), IncrementalGraph()
    for _ in range(3):
        grown.add_pose(step, np.eye(3))
    grown.add_edge(3, 0, step + 0.1, np.eye(3))
    assert len(grown.poses) == 4

    def close():
        grown.add_pose(step, np.eye(3))
        grown.add_edge(4, 1, step - 0.1, np.eye(3))
        assert len(grown.poses) == 5

    return close


def made_graph():
    """Four poses and a closure, checked; its chi2."""
    edges, z = [[0, 1], [1, 2], [2, 3], [3, 0]], np.tile([1.0, 0.0, np.pi / 2], (4, 1))
    poses = [[0, 0, 0], [1, 0, 1.5], [1, 1, 3], [0, 1, 4.5]]
    return lambda: PoseGraph(poses, edges, z, np.eye(3)).chi2()


def certificate():
    """A bound from below on the cost of the graph above."""
    result = pose_graph("gauss-newton")()

    def step():
        assert result.certificate.bound <= result.chi2

    return step


def path_point():
    """A point that the curve through those before it meets: P3 steps 1.2 to 1.4."""
    memory = PathMemory(0.02)
    t = np.linspace(0.0, 0.5, 21)
    points = np.stack([t, 0.2 * t**2], -1)
    for point in points[:-1]:
        memory.add(point)

    def step():
        memory.add(points[-1])
        assert memory.n_segments == 1

    return step


def path_segment():
    """A point that closes a segment, which crosses the path: P3 steps 1.5 to 1.7."""
    memory = PathMemory(0.02)
    out, up = np.linspace(0.0, 1.0, 21), np.linspace(0.0, 0.5, 11)
    way = [(x, 0.0) for x in out] + [(1.0, y) for y in up] + [(1.0 - x, 0.5) for x in up]
    for point in [*way, *((0.5, 0.5 - y) for y in np.linspace(0.0, 0.7, 15))]:
        memory.add(point)
    assert not memory.loops

    def step():
        for point in ((0.55, -0.25), (0.6, -0.25)):
            memory.add(point)
        assert len(memory.loops) == 1

    return step


def explorer():
    """A choice of the strategy, the turn to it and a stride: a floor that nothing was seen of."""
    rng, lidar = np.random.default_rng(0), Lidar(120, max_range=8.0)
    pilot = Explorer(SquareRobot(0.3), lidar, LongestBeam(), rng)
    ranges = np.full(120, 2.0)
    ranges[30] = 5.0

    def step():
        for heading, seen in ((0.0, ranges), (np.pi / 2, np.roll(ranges, -30))):
            pose = np.array([1.0, 2.0, heading])
            u = pilot.command(View(0.0, 1.0, pose, 0.01 * np.eye(3), seen, np.False_))
        assert u[0] > 0.0

    return step


def signatures():
    """One scan with a missed return, found again in a map of a room."""
    lidar = Lidar(36, max_range=8.0)
    atlas = SignatureMap.build(rooms.thesis_room(), lidar, 16)
    scan = lidar.scan(rooms.thesis_room(), [1.0, 1.0, 0.3])
    scan[5] = np.nan
    return lambda: atlas.locate(scan)


ROOM = Lidar(90, max_range=20.0)


def icp():
    """A scan of a room on the one before it, whose normals are found, too."""
    scans = [ROOM.points(ROOM.scan(rooms.office(), [x, 4.0, 0.3])) for x in (2.0, 2.1)]

    def step():
        assert match_icp(scans[0], scans[1], [0.05, 0.0, 0.0]).score > 0.5

    return step


def normals():
    """Scans of a room, some points of which are as near as others, in one frame."""
    poses = np.array([[2.0, 4.0, 0.3], [2.1, 4.0, 0.3]])
    scans = [ROOM.points(ROOM.scan(rooms.office(), pose)) for pose in poses]
    scans[0][:11] = np.column_stack([np.arange(11) / 10, np.ones(11)])

    def step():
        walls = [PointsWithNormals.estimate(scan) for scan in scans]
        walls = [wall.transformed(pose) for wall, pose in zip(walls, poses, strict=True)]
        assert len(PointsWithNormals.concatenated(walls).on_lines().points) > 100

    return step


def hector():
    """A scan of a room that the maps have, drawn into them."""
    slam = HectorSlam(ROOM, [2.0, 4.0, 0.0], levels=2)
    first, then = (ROOM.scan(rooms.office(), [x, 4.0, 0.0]) for x in (2.0, 2.5))
    slam.update(first)

    def step():
        slam.predict([0.5, 0.0, 0.0], 1.0, 0.001 * np.eye(3))
        slam.update(then)
        assert not slam.lost

    return step


def scan_graph():
    """A scan that lies on the keyframes before it and becomes one."""
    slam = ScanGraphSlam(ROOM, [2.0, 4.0, 0.0])
    first, then = (ROOM.scan(rooms.office(), [x, 4.0, 0.0]) for x in (2.0, 2.5))
    slam.update(first)

    def step():
        slam.predict([0.5, 0.0, 0.0], 1.0, 0.001 * np.eye(3))
        slam.update(then)
        assert len(slam.nodes) == 2

    return step


def closure():
    """A second pass of a room, two nodes of which are found on the first: they agree."""
    chain, closures, cov = PoseChain(), ClosureSearch(inflate=False), np.diag([1e-3, 1e-3, 1e-4])
    x = np.tile(np.arange(2.0, 6.5, 0.5), 2)
    for pose in np.column_stack([x, np.full(18, 4.0), np.zeros(18)]):
        scan = ROOM.points(ROOM.scan(rooms.office(), pose))
        chain.append(PointsWithNormals.estimate(scan), pose, chain.from_last(pose), cov)
    chain.travel[9:] += 20.0  # what lies between both passes is not asked
    assert not closures.try_node(12, chain)

    def step():
        assert closures.try_node(15, chain)

    return step


@cache
def driven(seed):
    """A drive of some metres along a block, and what it left."""
    log = drive(seed, 0, 1)[:24]
    return run(ScanGraphSlam(log.scan), log).system, log


def place_of_a_drive():
    """Places of a drive in a map of another, until enough agree on where it began."""
    old, new = (driven(seed)[0]._chain for seed in (0, 1))

    def step():
        assert recognised(old, new, lambda done, total: None).frame is not None

    return step


def sessions():
    """A drive that is joined to another: places, more closures on the way, one graph."""
    found = Sessions(*driven(0))

    def step():
        assert found.add(*driven(1)).frame is not None

    return step


def field():
    """A scan of a room on the walls of the one before it."""
    scans = [ROOM.points(ROOM.scan(rooms.office(), [x, 4.0, 0.3])) for x in (2.0, 2.1)]

    def step():
        match = match_field(LikelihoodGrid.of_points(scans[1]), scans[0], [0.05, 0.0, 0.0])
        assert match.score > 0.5

    return step


def correlative():
    """A scan of a room in a window round a guess, and the best place elsewhere."""
    scans = [ROOM.points(ROOM.scan(rooms.office(), [x, 4.0, 0.3])) for x in (2.0, 2.1)]

    def step():
        seen = LikelihoodGrid.of_points(scans[1])
        match = match_correlative(seen, scans[0], [0.3, 0, 0], 0.5, 0.1, second_peak_distance=0.3)
        assert match.score > 0.5

    return step


def kalman_series():
    """Three series side by side, a measurement of one missing, filtered."""
    z = np.random.default_rng(0).normal(size=(3, 20, 1))
    z[0, 4] = np.nan
    F, Q = np.array([[1.0, 0.1], [0.0, 1.0]]), np.diag([1e-4, 1e-2])
    start = Gaussian(np.zeros(2), np.eye(2))
    return lambda: kalman.filter(z, F, [[1.0, 0.0]], Q, [[0.04]], start)


def occupancy():
    """A scan of a room, drawn into a map that grows."""
    grid, scan = OccupancyGrid((4, 4), 0.1), ROOM.scan(rooms.office(), [2.0, 4.0, 0.0])
    return lambda: grid.insert([2.0, 4.0, 0.0], scan, ROOM)


def exploration_grid():
    """A scan drawn into a floor that grows, and the frontier that it leaves."""
    grid = ExplorationGrid([0.0, 0.0, 2.0, 2.0], grow=True)
    scan = ROOM.scan(rooms.office(), [2.0, 4.0, 0.0])

    def step():
        grid.insert([2.0, 4.0, 0.0], scan, ROOM)
        assert grid.frontier().any()

    return step


def shared_maps():
    """Two landmarks of a map that two particles share, written by each in its own way."""
    maps = LandmarkMaps(2)
    means, covs, log_odds = np.zeros((2, 2, 2)), np.tile(np.eye(2), (2, 2, 1, 1)), np.zeros((2, 2))
    columns = np.tile([0, 1], (2, 1))
    maps.write(columns, means, covs, log_odds)

    def step():
        maps.shared.resample([0, 0])
        maps.write(columns, means + [[[1.0]], [[2.0]]], covs, log_odds)
        assert maps.read(columns, np.zeros((2, 3)))[0][:, 0, 0].tolist() == [1.0, 2.0]

    return step


def loops():
    """A new cubic, a straight one, that crosses the straight path before it."""
    path = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]])
    cubic = np.array([[0.5, -0.5], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]])
    boxes = np.array([[np.inf, np.inf, -np.inf, -np.inf], [0.0, 0.0, 1.0, 0.0]])

    def step():
        assert search(cubic, 0.0, 1.0, path, boxes, 1.0, 1e-3)[0] == (0.5, 0, 0.5)

    return step


# A system: its step and its own files, of which the step may read `OWN` lines.
SYSTEMS = {
    "EKF-SLAM": (ekf_slam, ("slam/ekf.py", "slam/linearisation.py")),
    "joint compatibility": (joint_compatibility, ("slam/association.py",)),
    "compressed EKF-SLAM": (compressed_ekf_slam, ("slam/compressed.py",)),
    "adaptive range": (adaptive_range, ("slam/local_range.py",)),
    "WallSlam": (wall_slam, ("slam/wall_slam.py",)),
    "walls of a scan": (walls, ("mapping/walls.py",)),
    "split-and-merge": (walls, ("mapping/_split_and_merge.py",)),
    "line of a wall": (walls, ("mapping/lines.py",)),
    "EKF-SLAM, side by side": (ekf_slam_batch, ("slam/batch.py", "slam/linearisation.py")),
    "FastSLAM 1": (partial(fast_slam, 1), ("slam/fast.py",)),
    "FastSLAM 2": (partial(fast_slam, 2), ("slam/fast.py",)),
    "particle filter": (particle_filter, ("filters/particle.py",)),
    "Monte Carlo": (partial(monte_carlo, None), ("localization/monte_carlo.py",)),
    "Monte Carlo, injection": (
        partial(monte_carlo, (0.05, 0.5)),
        ("localization/monte_carlo.py",),
    ),
    "global localization, found": (
        partial(global_localization, False),
        ("localization/global_localization.py",),
    ),
    "global localization, tracked": (
        partial(global_localization, True),
        ("localization/global_localization.py",),
    ),
    "grid FastSLAM": (partial(grid_fast_slam, "matching"), ("slam/grid_fast.py",)),
    "DP-SLAM": (partial(grid_fast_slam, "penetration"), ("slam/grid_fast.py",)),
    "Gamma-SLAM": (gamma_slam, ("slam/gamma.py",)),
    "pose graph": (partial(pose_graph, "gauss-newton"), ("slam/least_squares.py",)),
    "pose graph, robust": (
        partial(pose_graph, "levenberg-marquardt", kernel="dcs"),
        ("slam/least_squares.py",),
    ),
    "pose graph, made": (made_graph, ("slam/pose_graph.py",)),
    "pose graph, incremental": (incremental_graph, ("slam/incremental.py",)),
    "pose graph, certified": (certificate, ("slam/certificate.py",)),
    "path memory, a point": (path_point, ("navigation/path_memory.py",)),
    "path memory, a segment": (path_segment, ("navigation/path_memory.py",)),
    "signatures": (signatures, ("localization/signature.py",)),
    "ICP": (icp, ("matching/icp.py",)),
    "normals of a scan": (normals, ("matching/normals.py",)),
    "covariance of a match": (icp, ("matching/_covariance.py",)),
    "Hector": (hector, ("slam/hector.py",)),
    "scan graph": (
        scan_graph,
        ("slam/scan_graph.py", "slam/_tracking.py", "slam/_chain.py"),
    ),
    "scan graph, a closure": (closure, ("slam/_closures.py",)),
    "sessions, a place": (place_of_a_drive, ("slam/_joining.py",)),
    "sessions, a drive": (sessions, ("slam/sessions.py", "slam/_drive.py")),
    "scan on a field": (field, ("matching/field.py",)),
    "correlative search": (correlative, ("matching/correlative.py",)),
    "Kalman series": (kalman_series, ("filters/kalman.py",)),
    "occupancy map": (occupancy, ("mapping/occupancy.py",)),
    "exploration grid": (exploration_grid, ("navigation/exploration_grid.py",)),
    "shared maps": (shared_maps, ("slam/_landmark_maps.py", "filters/pages.py")),
    "loops": (loops, ("navigation/boxes.py",)),
    "exploration": (explorer, ("navigation/explore.py", "navigation/strategies.py")),
}
PARTS = {  # with the lessons that show them
    "filters/particle.py",  # 04
    "filters/pages.py",  # 15c
    "slam/_landmark_maps.py",  # 12, kept in such pages
    "mapping/occupancy.py",  # 08
    "matching/field.py",  # 14
    "matching/icp.py",  # 14
    "matching/normals.py",  # 14 has a use for them, 14b their noise
    "matching/_covariance.py",  # 14b
    "matching/correlative.py",  # 14
    "slam/least_squares.py",  # 13
    "navigation/boxes.py",  # 17d
    "navigation/exploration_grid.py",  # 18
}
INSIDE = {
    "joint compatibility": {"slam/ekf.py", "slam/linearisation.py"},
    "adaptive range": {"slam/ekf.py"},
    "WallSlam": {
        "slam/ekf.py",
        "mapping/walls.py",
        "mapping/_split_and_merge.py",
        "mapping/lines.py",
    },
    "global localization, found": {"localization/monte_carlo.py"},
    "sessions, a place": {"slam/_closures.py"},
    "sessions, a drive": {"slam/_closures.py", "slam/_joining.py", "slam/pose_graph.py"},
}
# Their public parts check again: points, poses, choices, numbers of each.
DOORS = {
    "Hector": 125,
    "joint compatibility": 145,
    "scan graph": 130,
    "WallSlam": 135,
    "global localization, found": 135,
    "global localization, tracked": 125,
    "sessions, a drive": 125,
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_step_can_be_read(name, monkeypatch):
    # Where a kernel serves, one reads its plain twin.
    monkeypatch.setattr("slamlab.kernels.numba_serves", lambda: False)
    monkeypatch.setattr("slamlab.kernels._SAID", ["said"])
    make, own = SYSTEMS[name]
    make()()  # the root of a noise covariance is computed once for a log: not in a later step
    lines = path_of(make())
    lines.pop("kernels/__init__.py", 0)  # what says that plain code serves
    assert sum(lines.get(file, 0) for file in own) <= OWN, lines
    assert lines.pop("_checks.py", 0) <= DOORS.get(name, DOOR)
    known = PARTS.difference(own) | INSIDE.get(name, set())
    assert sum(n for file, n in lines.items() if file not in known) <= ALL, lines


def test_each_part_that_is_counted_apart_has_a_row_of_its_own():
    rows = {file for _, own in SYSTEMS.values() for file in own}
    assert rows >= PARTS.union(*INSIDE.values())
    assert set(SYSTEMS) >= {*INSIDE, *DOORS}


def test_the_count_has_decorators_and_bodies_but_no_docstrings_comments_or_blanks(tmp_path):
    file = tmp_path / "some.py"
    file.write_text(
        '"""A file."""\n\n\n@cache\ndef f(x):\n    """Say what.\n\n    And why.\n    """\n\n'
        "    # a comment\n    return (\n        x\n    )\n"
    )
    assert {first: len(lines) for first, lines in functions(file).items()} == {4: 5}
