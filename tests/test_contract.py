"""One contract over every motion model, sensor and estimator; and every system on every log.

A new one joins by a line in a list. What breaks the contract on purpose stands in STRAY,
with its reason. Wrong models and systems stand below: the checks must refuse them.
"""

import os
import re
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import numpy as np
import pytest

from slamlab import localization, slam
from slamlab.datasets import killian, read_carmen
from slamlab.evaluation import run
from slamlab.geometry import between, compose, wrap_angle
from slamlab.localization import DeadReckoning, LikelihoodField, MonteCarloLocalization
from slamlab.localization.global_localization import GlobalLocalization
from slamlab.logs import Log
from slamlab.models import LandmarkSensor, MotionModel, as_array
from slamlab.robots import YOUBOT, Mecanum, RelativePose, Unicycle
from slamlab.sensors import Lidar, PointSensor, RangeBearing, StereoRig, Wall
from slamlab.simulation import ground_laps, landmark_drives
from slamlab.slam import (
    AdaptiveRange,
    CompressedEKFSlam,
    EKFSlam,
    EKFSlamBatch,
    FastSlam,
    GammaSlam,
    GridFastSlam,
    HectorSlam,
    ScanGraphSlam,
    WallSlam,
)
from slamlab.slam.linear import CompassMotion, Displacement
from slamlab.testing import check_estimator, check_landmark_sensor, check_motion_model
from slamlab.worlds import Terrain, rooms

MOTIONS = {
    "Unicycle": (Unicycle(), [1.0, 0.3]),
    "RelativePose": (RelativePose(), [0.3, 0.1, 0.2]),
    "CompassMotion": (CompassMotion(), [1.0, 0.3]),
    "Mecanum, exact": (YOUBOT, [0.5, 0.2, 0.3]),
    "Mecanum, euler": (Mecanum(0.05, 0.2, 0.15, "euler"), [0.5, 0.2, 0.3]),
    "Mecanum, midpoint": (Mecanum(0.05, 0.2, 0.15, "midpoint"), [0.5, 0.2, 0.3]),
}
SENSORS = {
    "RangeBearing": RangeBearing(0.1, 0.02),
    "RangeBearing, ahead": RangeBearing(0.1, 0.02, offset=0.3),
    "Wall": Wall(0.1, 0.02),
    "Wall, ahead": Wall(0.1, 0.02, offset=0.3),
    "PointSensor": PointSensor(0.01 * np.eye(2)),
    "Displacement": Displacement(0.1),
}


BODY = PointSensor(np.eye(2))


class Pixels(LandmarkSensor):
    """A stereo camera: column and disparity (pixels) of what is ahead; there is no behind."""

    cov = np.eye(2)

    def __repr__(self):
        return "Pixels()"

    def observe(self, pose, landmark):
        p = BODY.observe(pose, landmark)
        return 500 * np.stack([p[..., 1], np.full_like(p[..., 1], 0.2)], -1) / p[..., :1]

    def jacobians(self, pose, landmark):
        p, by_pose_and_point = BODY.observe(pose, landmark), BODY.jacobians(pose, landmark)
        D = np.zeros((*p.shape, 2))
        D[..., 0, 0], D[..., 0, 1] = -p[..., 1] / p[..., 0] ** 2, 1 / p[..., 0]
        D[..., 1, 0] = -0.2 / p[..., 0] ** 2
        return tuple(500 * D @ H for H in by_pose_and_point)

    def locate(self, pose, z):
        return BODY.locate(pose, self.point(z))

    def locate_jacobians(self, pose, z):
        p, z = self.point(z), np.asarray(z)
        by_pose, by_point = BODY.locate_jacobians(pose, p)
        D = np.zeros((*p.shape, 2))
        D[..., 1, 0], D[..., :, 1] = 0.2 / z[..., 1], -p / z[..., 1:]
        return by_pose, by_point @ D

    def visible(self, pose, landmark):
        return BODY.observe(pose, landmark)[..., 0] > 0.1

    def reach(self, z):
        return np.linalg.norm(self.point(z), axis=-1)

    def point(self, z):
        z = as_array("z", z, ("...", 2))
        return 0.2 * np.stack([np.full_like(z[..., 0], 500.0), z[..., 0]], -1) / z[..., 1:]


SENSORS["a camera of the caller"] = Pixels()

# The logs: landmarks of one robot and of three, scans of a room, the real corridor.

SENSOR = RangeBearing(0.05, 0.02, offset=0.3, max_range=6.0)
TREES = np.random.default_rng(7).uniform([-3, -3], [6, 5], (12, 2))
LIDAR = Lidar(180, max_range=8.0, sigma_range=0.01)
BOUNDS = ((-3, 13), (-3, 11))


@cache
def landmarks(n_runs=1):
    u, V = np.tile([0.5, 0.1, 0.2], (24, 1)), np.diag([0.05, 0.05, 0.03]) ** 2
    rng = np.random.default_rng(1)
    return landmark_drives(YOUBOT, SENSOR, TREES, u, 0.4, V, n_runs, rng)


@cache
def one_robot():
    return landmarks().single(0)


@cache
def scans(steps=12):
    """A drive through the office, told as motions from scan to scan, with noise."""
    turns = np.where(np.arange(steps) % 10 < 5, 0.12, -0.12)
    poses = [np.array([2.0, 4.0, 0.0])]
    for k in range(1, steps):
        poses.append(compose(poses[-1], [0.2, 0.0, turns[k]]))
    rng, poses = np.random.default_rng(1), np.array(poses)
    noise = np.array([0.02, 0.01, 0.01])
    u = np.zeros((steps, 3))
    u[1:] = between(poses[:-1], poses[1:]) + rng.normal(0, noise, (steps - 1, 3))
    dt = np.r_[0.0, np.full(steps - 1, 0.5)]
    ranges = LIDAR.scan(rooms.office(), poses, rng)
    V = np.diag(noise**2)
    return Log(np.cumsum(dt), u, dt, V, ranges=ranges, scan=LIDAR, truth=poses)


@cache
def ground():
    draw = np.random.default_rng(1)
    return ground_laps(Terrain.rough(draw), StereoRig(1500), draw, laps=0.1)


@cache
def corridor():
    return killian().log[:60]


@cache
def freiburg():
    """The first minutes of a real lidar log; needs SLAMLAB_DATA."""
    path = Path(os.environ.get("SLAMLAB_DATA", "")) / "freiburg-101-corrected.log.gz"
    if not path.is_file():
        pytest.skip(f"no {path.name} in SLAMLAB_DATA")
    return read_carmen(path, corrected=True)[:60]


@cache
def office_field():
    room = rooms.office()
    left, bottom, right, top = room.bounds
    x, y = np.meshgrid(np.arange(left, right, 0.1), np.arange(bottom, top, 0.1))
    return LikelihoodField(room.clearance(np.stack([x, y], -1)) < 0.1, 0.1, (left, bottom))


def rng():
    return np.random.default_rng(5)


def ekf(log, pose, **options):
    return EKFSlam(motion(log), SENSOR, pose, **options)


def motion(log):
    return YOUBOT if log.landmark_measurements is not None else RelativePose()


def fast(log, pose, version):
    return FastSlam(motion(log), SENSOR, pose, 30, version, rng=rng())


def known_trees(log, pose):
    sensor = RangeBearing(0.15, 0.06, offset=0.3, max_range=6.0)
    return MonteCarloLocalization(TREES, motion(log), sensor, 1000, BOUNDS, rng())


def known_office(log, pose):
    return MonteCarloLocalization(office_field(), RelativePose(), log.scan, 300, BOUNDS, rng())


def office_map(log, pose):
    return GlobalLocalization(rooms.office(), log.scan, RelativePose(), rng(), n_particles=2000)


def walls(log, pose):
    scan = log.scan
    lidar = Lidar(scan.n_beams, np.ptp(scan.beam_angles), scan.max_range, sigma_range=0.02)
    return WallSlam(RelativePose(), lidar, pose)


# name: (make(log, pose), what it measures)
SYSTEMS = {
    "DeadReckoning": (lambda log, pose: DeadReckoning(motion(log), pose), "odometry"),
    "EKFSlam": (ekf, "landmarks"),
    "EKFSlam, first estimates": (
        lambda log, pose: ekf(log, pose, linearisation="first-estimates"),
        "landmarks",
    ),
    "EKFSlam, invariant": (
        lambda log, pose: ekf(log, pose, linearisation="invariant"),
        "landmarks",
    ),
    "CompressedEKFSlam": (
        lambda log, pose: CompressedEKFSlam(motion(log), SENSOR, pose, radius=2.0),
        "landmarks",
    ),
    "AdaptiveRange": (
        lambda log, pose: AdaptiveRange(ekf(log, pose), n_target=3, min_range=2.0, max_range=6.0),
        "landmarks",
    ),
    "AdaptiveRange, in a region": (
        lambda log, pose: AdaptiveRange(
            CompressedEKFSlam(motion(log), SENSOR, pose),
            n_target=3,
            min_range=2.0,
            max_range=6.0,
            region_factor=1.5,
        ),
        "landmarks",
    ),
    "EKFSlamBatch": (
        lambda log, pose: EKFSlamBatch(motion(log), SENSOR, pose, n_landmarks=len(TREES)),
        "batches",
    ),
    "FastSlam 1": (lambda log, pose: fast(log, pose, 1), "landmarks"),
    "FastSlam 2": (lambda log, pose: fast(log, pose, 2), "landmarks"),
    "MonteCarloLocalization, looks": (known_trees, "landmarks"),
    "MonteCarloLocalization, ranges": (known_office, "scan"),
    "GlobalLocalization": (office_map, "scan"),
    "WallSlam": (walls, "scan"),
    "HectorSlam": (lambda log, pose: HectorSlam(log.scan, pose), "scan"),
    "ScanGraphSlam": (lambda log, pose: ScanGraphSlam(log.scan, pose), "scan"),
    "GridFastSlam": (lambda log, pose: GridFastSlam(log.scan, pose, 6, rng=rng()), "scan"),
    "GammaSlam": (lambda log, pose: GammaSlam(log.scan, pose, 20, rng=rng()), "pictures"),
}
FEEDS = {
    "landmarks": [one_robot],
    "batches": [lambda: landmarks(3)],
    "scan": [scans, corridor, freiburg],
    "pictures": [ground],
    "odometry": [one_robot, lambda: landmarks(3), scans, corridor, freiburg],
}
# How far poses may stray when the world is turned and shifted (m, rad), and why.
STRAY = {
    "MonteCarloLocalization, looks": (None, "its map stays where it is"),
    "MonteCarloLocalization, ranges": (None, "its map stays where it is"),
    "GlobalLocalization": (None, "its map stays where it is"),
    "WallSlam": (0.02, "a wall (r, alpha) is linearised about the origin of the world"),
    "HectorSlam": (0.1, "cells of 0.05 m along the axes of the world"),
    "ScanGraphSlam": (0.02, "matches on cells along the axes of the world"),
    "GridFastSlam": (0.1, "cells of 0.1 m along the axes of the world"),
    "GammaSlam": (0.1, "cells of 0.25 m along the axes of the world"),
}


def test_every_system_is_listed():
    modules = [
        import_module(f"{package.__name__}.{info.name}")
        for package in (slam, localization)
        for info in iter_modules(package.__path__)
        if not info.name.startswith("_")
    ]
    public = [getattr(module, name) for module in modules for name in module.__all__]
    systems = {one.__name__ for one in public if {"predict", "pose"} <= {*dir(one)}}
    assert systems <= {re.match(r"\w+", name)[0] for name in SYSTEMS}
    assert len(systems) > 12


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_model_keeps_the_contract(name):
    # A compass knows north.
    verdict = check_motion_model(*MOTIONS[name], equivariant=name != "CompassMotion")
    assert verdict, str(verdict)


@pytest.mark.parametrize("name", SENSORS)
def test_a_sensor_keeps_the_contract(name):
    verdict = check_landmark_sensor(SENSORS[name])
    assert verdict, str(verdict)


@pytest.mark.parametrize("name", SYSTEMS)
def test_an_estimator_keeps_the_contract(name):
    make, feed = SYSTEMS[name]
    log = FEEDS[feed][0]()
    stray, _ = STRAY.get(name, (1e-6, ""))
    verdict = check_estimator(lambda pose: make(log, pose), log, equivariance=stray)
    assert verdict, str(verdict)


# Who is not expected to end near the truth, and why.
FAR = {
    ("MonteCarloLocalization, ranges", scans): "a dozen scans fit more than one room",
    ("GlobalLocalization", corridor): "another building than that of its map",
    ("GlobalLocalization", freiburg): "another building than that of its map",
    ("WallSlam", corridor): "takes walls of the corridor for one another, worse than its wheels",
}
PRODUCT = [
    pytest.param(make, log, (name, log) in FAR, id=f"{name}-{number}")
    for name, (make, feed) in SYSTEMS.items()
    for number, log in enumerate(FEEDS[feed])
    # The map of the office is of no use elsewhere.
    if not (make is known_office and log in (corridor, freiburg))
]


@pytest.mark.parametrize(("make", "log", "far"), PRODUCT)
def test_any_system_runs_on_any_log_that_feeds_it(make, log, far):
    log = log()
    result = run(make(log, log.truth[0]), log)
    assert result.poses.shape == log.truth.shape
    assert np.isfinite(result.covs).all()
    assert len(result.reports) == len(log)
    error = np.linalg.norm((result.poses - log.truth)[-1, ..., :2], axis=-1)
    assert (error.max() > 1.0) == far


SWAPPED = [
    ("motion", lambda: EKFSlam(SENSOR, YOUBOT, [0, 0, 0])),
    ("motion", lambda: CompressedEKFSlam(SENSOR, YOUBOT, [0, 0, 0])),
    ("motion", lambda: EKFSlamBatch(SENSOR, YOUBOT, np.zeros((2, 3)), n_landmarks=1)),
    ("motion", lambda: FastSlam(SENSOR, YOUBOT, [0, 0, 0], 5, rng=rng())),
    ("motion", lambda: MonteCarloLocalization(TREES, SENSOR, YOUBOT, 5, BOUNDS, rng())),
    ("sensor", lambda: MonteCarloLocalization(TREES, YOUBOT, LIDAR, 5, BOUNDS, rng())),
    ("motion", lambda: DeadReckoning(SENSOR, [0, 0, 0])),
    ("lidar", lambda: WallSlam(LIDAR, YOUBOT, [0, 0, 0])),
    ("lidar", lambda: HectorSlam(YOUBOT)),
    ("motion", lambda: HectorSlam(LIDAR, motion=LIDAR)),
    ("lidar", lambda: ScanGraphSlam(YOUBOT, motion=LIDAR)),
    ("lidar", lambda: GridFastSlam(YOUBOT, rng=rng())),
    ("motion", lambda: GridFastSlam(LIDAR, rng=rng(), motion=LIDAR)),
    ("rig", lambda: GammaSlam(LIDAR, rng=rng())),
    ("motion", lambda: GammaSlam(StereoRig(), rng=rng(), motion=LIDAR)),
]


@pytest.mark.parametrize(("argument", "build"), SWAPPED)
def test_swapped_models_are_refused_with_a_sentence(argument, build):
    with pytest.raises(ValueError, match=f"^{argument}: expected a .*, which has no "):
        build()


# Wrong on purpose: each must be refused, by the property it breaks.


class Transposed(Unicycle):
    def jacobians(self, pose, u, dt):
        F_x, F_u = super().jacobians(pose, u, dt)
        return np.swapaxes(F_x, -1, -2), F_u


class OneNoiseForAll(Unicycle):
    def sample(self, pose, u, dt, control_cov, rng):
        noise = rng.multivariate_normal(u, control_cov, check_valid="ignore")
        return self.step(pose, noise, dt)


class Wind(MotionModel):
    """No checks, no leading axes of the derivatives, and a wind that knows north."""

    def step(self, pose, u, dt):
        pose, u = np.asarray(pose, float), np.asarray(u, float)
        return pose + dt * np.concatenate([u, np.zeros((*u.shape[:-1], 1))], -1)

    def jacobians(self, pose, u, dt):
        return np.eye(3), dt * np.eye(3)[:, :2]


class Impatient(Unicycle):
    def step(self, pose, u, dt):
        return super().step(pose, u, dt + 0.1)


class InPlace(RelativePose):
    def step(self, pose, u, dt):
        moved = super().step(pose, u, dt)
        if isinstance(pose, np.ndarray):
            pose[...] = moved
        return moved


class Unwrapped(RangeBearing):
    def residual(self, z, predicted):
        return np.subtract(z, predicted)


class WithoutLever(RangeBearing):
    def locate(self, pose, z):
        return RangeBearing(0.1, 0.1).locate(pose, z)


class PolarLandmark(RangeBearing):
    def jacobians(self, pose, landmark):
        H_pose, H_landmark = super().jacobians(pose, landmark)
        return H_pose, np.swapaxes(H_landmark, -1, -2)


class SeesAhead(Unwrapped):
    def visible(self, pose, landmark):
        return np.abs(wrap_angle(super().observe(pose, landmark)[..., 1])) < np.pi / 2


class FromNorth(SeesAhead):
    """Measures the bearing from north, and forgets to wrap what is seen ahead."""

    def observe(self, pose, landmark):
        z = super().observe(pose, landmark)
        return np.stack([z[..., 0], wrap_angle(z[..., 1] - 2.5)], -1)


WRONG_MODELS = {
    "bearing, ahead": ("residual: jumps by 6", FromNorth(0.1, 0.02), None),
    "transposed": ("jacobians: by pose: this is the transpose", Transposed(), [1.0, 0.3]),
    "one noise": ("sample: the mean of many", OneNoiseForAll(), [1.0, 0.3]),
    "wind, frame": ("equivariance: a step in a turned world", Wind(), [1.0, 0.3]),
    "wind, axes": ("leading axes: F_x: expected shape", Wind(), [1.0, 0.3]),
    "wind, checks": ("refusals: ", Wind(), [1.0, 0.3]),
    "impatient": ("dt = 0: ", Impatient(), [1.0, 0.3]),
    "in place": ("arguments: step changes its arguments", InPlace(), [0.3, 0.1, 0.2]),
    "a sensor": ("protocol: raised ValueError: model: expected a motion model", SENSOR, [1.0]),
    "bearing": ("residual: jumps by 6", Unwrapped(0.1, 0.02), None),
    "lever": ("locate: ", WithoutLever(0.1, 0.02, offset=0.3), None),
    "landmark": ("jacobians: H_landmark: this is the transpose", PolarLandmark(0.1, 0.02), None),
    "a robot": ("protocol: raised ValueError: sensor: expected a sensor", YOUBOT, None),
}


@pytest.mark.parametrize("name", WRONG_MODELS)
def test_a_wrong_model_is_refused_by_the_property_it_breaks(name):
    expected, model, u = WRONG_MODELS[name]
    verdict = check_landmark_sensor(model) if u is None else check_motion_model(model, u)
    assert not verdict
    assert any(line.startswith(expected) for line in verdict.violations), str(verdict)


class Viewed(DeadReckoning):
    pose = property(lambda self: self._pose)


class ViewedInPlace(Viewed):
    def predict(self, u, dt, control_cov):
        before = self._pose
        super().predict(u, dt, control_cov)
        before[...], self._pose = self._pose, before


class ArgumentChanged(DeadReckoning):
    def predict(self, u, dt, control_cov):
        super().predict(u, dt, control_cov)
        if control_cov.flags.writeable:
            control_cov *= 2


class Late(DeadReckoning):
    """Keeps the array it was given, and moves by it in the next step."""

    kept = None

    def predict(self, u, dt, control_cov):
        if self.kept is not None:
            super().predict(self.kept, dt, control_cov)
        self.kept = u


class OneByOne(EKFSlam):
    """An update that half happens."""

    def update(self, z, ids=None, covs=None):
        return [super(OneByOne, self).update(z[k : k + 1], ids[k : k + 1]) for k in range(len(z))]


class MovedBeforeChecked(DeadReckoning):
    def predict(self, u, dt, control_cov):
        self._pose = self.motion.step(self._pose, u, dt)
        super().predict(np.multiply(u, 0), dt, control_cov)


class Lopsided(DeadReckoning):
    pose_cov = property(lambda self: self._P + np.eye(3, k=1) * 1e-3)


class Sure(DeadReckoning):
    pose_cov = property(lambda self: self._P - 1e-3 * np.eye(3))


class NorthWind(DeadReckoning):
    def predict(self, u, dt, control_cov):
        super().predict(u, dt, control_cov)
        self._pose = self._pose + [0.0, 0.01 * dt, 0.0]


class Restless(DeadReckoning):
    def predict(self, u, dt, control_cov):
        super().predict(u, dt + 0.1, control_cov)


class Moody(DeadReckoning):
    generator = np.random.default_rng(3)

    def predict(self, u, dt, control_cov):
        super().predict(self.motion and u * self.generator.normal(1.0, 0.1), dt, control_cov)


class Unnamed(DeadReckoning):
    __repr__ = object.__repr__


class Blind:
    measures = "landmarks"


def dead(kind):
    return lambda pose: kind(YOUBOT, pose)


WRONG_SYSTEMS = {
    "view": ("copies: after writing", dead(Viewed)),
    "view, in place": ("copies: a pose kept from before", dead(ViewedInPlace)),
    "argument changed": (
        "arguments: step 1 changed its argument control_cov",
        dead(ArgumentChanged),
    ),
    "argument kept": ("arguments: step 2, arguments changed after", dead(Late)),
    "half an update": (
        "refusals: after NaN in the last measurement was refused",
        lambda pose: OneByOne(YOUBOT, SENSOR, pose),
    ),
    "half a prediction": ("refusals: after a covariance", dead(MovedBeforeChecked)),
    "not symmetric": ("covariance: pose_cov: not symmetric", dead(Lopsided)),
    "below zero": ("covariance: pose_cov: has the eigenvalue", dead(Sure)),
    "wind": ("equivariance: poses in a turned world", dead(NorthWind)),
    "restless": ("dt = 0: ", dead(Restless)),
    "own seed": ("repeatable: a second run", dead(Moody)),
    "no repr": ("repr: expected one readable line", dead(Unnamed)),
    "incomplete": ("protocol: raised ValueError: system: expected an estim", lambda pose: Blind()),
}


@pytest.mark.parametrize("name", WRONG_SYSTEMS)
def test_a_wrong_system_is_refused_by_the_property_it_breaks(name):
    expected, make = WRONG_SYSTEMS[name]
    verdict = check_estimator(make, one_robot()[:10])
    assert not verdict
    assert any(line.startswith(expected) for line in verdict.violations), str(verdict)
