"""The closed loop: what is recorded happened, the pilot knows the belief only, bodies stop."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamlab.evaluation import run
from slamlab.localization import DeadReckoning
from slamlab.robots import YOUBOT, RelativePose, Unicycle
from slamlab.sensors import Lidar, RangeBearing, VisualOdometer
from slamlab.simulation import PerfectEstimator, record
from slamlab.simulation.record import Script, _Scene
from slamlab.slam import EKFSlam
from slamlab.worlds import BitmapWorld, LandmarkWorld, WallWorld, rooms

SQUARE = 0.15 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
ROOM = rooms.box_room()
LIDAR = Lidar(36, max_range=8.0, sigma_range=0.01)


def rng(seed=0):
    return np.random.default_rng(seed)


class Witness:
    """A pilot that keeps what it was shown, and drives on."""

    def __init__(self, u, n):
        self.u, self.n, self.views = np.array(u, float), n, []

    def command(self, view):
        self.views.append(view)
        return self.u if len(self.views) <= self.n else None


def a_drive(pilot=None, belief=None, **options):
    pilot = Script([[0.2, 0.1, 0.3]] * 20) if pilot is None else pilot
    belief = DeadReckoning(YOUBOT, [0, 0, 0]) if belief is None else belief
    options = {"start": [2.0, 1.5, 0.4], "dt": 0.2, **options}
    return record(ROOM, YOUBOT, LIDAR, pilot, belief, rng(3), **options)


def test_the_log_tells_what_happened():
    V = YOUBOT.control_cov(0.5)
    log = a_drive(control_cov=V)
    assert len(log) == 21
    assert_allclose(log.times, 0.2 * np.arange(21))
    assert log.dt.tolist() == [0.0] + [0.2] * 20
    assert_allclose(log.u[1:], [[0.2, 0.1, 0.3]] * 20)
    assert_array_equal(log.u[0], 0)
    assert_allclose(log.control_cov[1:], np.tile(V, (20, 1, 1)))
    # The truth moved by what was driven, which is the command and noise of covariance V.
    driven = log.notes["driven"][1:]
    assert_allclose(YOUBOT.step(log.truth[:-1], driven, 0.2), log.truth[1:], atol=2e-9)
    assert 0.3 < np.mean((driven - log.u[1:]) ** 2 / np.diag(V)) < 2.0
    exact = Lidar(36, max_range=8.0).scan(ROOM, log.truth)
    met = np.isfinite(log.ranges) & np.isfinite(exact)
    assert np.std(log.ranges[met] - exact[met]) == pytest.approx(0.01, rel=0.15)


def test_a_system_that_runs_over_the_log_believes_what_the_robot_believed():
    belief = DeadReckoning(YOUBOT, [0, 0, 0])
    log = a_drive(belief=belief, control_cov=YOUBOT.control_cov(0.5))
    again = run(DeadReckoning(YOUBOT, [0, 0, 0]), log)
    assert_array_equal(again.poses, log.notes["believed"])
    assert_array_equal(again.covs[-1], belief.pose_cov)


def test_the_pilot_is_shown_the_belief_and_the_newest_scan_never_the_truth():
    pilot = Witness([0.2, 0.0, 0.0], 5)
    log = a_drive(pilot)
    assert [view.time for view in pilot.views] == pytest.approx(log.times.tolist())
    for view, believed, ranges in zip(pilot.views, log.notes["believed"], log.ranges, strict=True):
        assert_array_equal(view.pose, believed)
        assert_array_equal(view.measurement, ranges)
        assert np.abs(view.pose - log.truth).min(0)[:2].max() > 0.5
    told = Witness([0.2, 0.0, 0.0], 5)
    log = a_drive(told, PerfectEstimator())
    assert_array_equal([view.pose for view in told.views], log.truth)


def test_a_robot_that_stands_stands():
    log = a_drive(Script(np.zeros((5, 3))), control_cov=YOUBOT.control_cov(5.0))
    assert_array_equal(log.truth, np.tile(log.truth[0], (6, 1)))
    walk = record(
        None, Unicycle(), None, Script([[0.0, 0.0]] * 3), DeadReckoning(RelativePose(), [1, 1, 0]),
        rng(), start=[0, 0, 0], odometer=VisualOdometer.simple(0.1, 0.1),
    )  # fmt: skip
    assert_array_equal(walk.notes["believed"], [[1, 1, 0]] * 4)


def test_an_odometer_takes_the_place_of_the_command():
    odometer, belief = VisualOdometer.simple(0.01, 0.02), DeadReckoning(RelativePose(), [0, 0, 0])
    log = record(
        None, Unicycle(), None, Script([[0.5, 0.2]] * 300), belief, rng(1),
        start=[0, 0, 0], odometer=odometer,
    )  # fmt: skip
    true_step = Unicycle().step([0, 0, 0], [0.5, 0.2], 0.1)
    error = (log.u[1:] - true_step) / [0.01, 0.01, 0.02]
    assert_allclose(error.std(0), 1.0, atol=0.15)
    assert_allclose(log.control_cov[1].diagonal(), [1e-4, 1e-4, 4e-4])


@pytest.mark.parametrize("u", [[1.0, 0.0, 0.0], [0.8, 0.1, 0.5]], ids=["straight", "arc"])
def test_a_body_stops_at_the_contact_is_counted_and_may_back_off(u):
    wall = WallWorld([[[1.0, -5], [1.0, 5]], [[-5, -5], [-5, 5]]])
    back = [-0.3, 0.0, 0.0]
    log = record(
        wall, YOUBOT, None, Script([u] * 3 + [back] * 2), PerfectEstimator(), rng(),
        start=[0, 0, 0], dt=0.5, footprint=SQUARE,
    )  # fmt: skip
    hits = log.notes["hit"].tolist()
    first = hits.index(True)
    assert first in (2, 3)
    assert hits[-2:] == [False, False]
    corner = lambda pose: float(  # noqa: E731
        (SQUARE @ np.array([np.cos(pose[2]), -np.sin(pose[2])])).max() + pose[0]
    )
    reach = [corner(pose) for pose in log.truth]
    assert max(reach) <= 1.0 + 1e-6
    assert reach[first] > 0.99
    # The wheels stop with the body: dead reckoning agrees with the truth.
    assert_allclose(run(DeadReckoning(YOUBOT, [0, 0, 0]), log).poses, log.truth, atol=1e-8)


class Endless(BitmapWorld):
    """The wrong form: a bitmap that forgets where it ends."""

    bounds = (-1e9, -1e9, 1e9, 1e9)


PIXELS = rooms.thesis_room().occupied[20:-20:5, 20:-20:5]
PLACES = {
    "closed": ROOM,
    "thin walls": WallWorld([[[0, 0], [4, 0]], [[4, 0], [4, 3]], [[1, 2], [2, 2.5]]]),
    "pixels": BitmapWorld(PIXELS, 0.05),
}


def hits_of_many_motions(world, radius=None, shortcut=True):
    """Whether a body meets something in 3000 motions, and how many of them were swept."""
    scene = _Scene(world, YOUBOT, None, rng(), SQUARE, None)
    if radius is not None:
        scene.radius = radius
    near = []
    judge = scene._all_free

    def all_free(cuts):
        near.append(np.sum(~judge(cuts)))
        return judge(cuts) if shortcut else np.zeros(cuts.shape[1:-1], bool)

    scene._all_free = all_free
    left, bottom, right, top = PLACES["pixels"].bounds
    poses = rng(1).uniform([left, bottom, -np.pi], [right, top, np.pi], (3000, 3))
    controls = rng(2).normal(0.0, [0.6, 0.6, 1.5], (3000, 3))
    controls[:1000, 2] = controls[1000:1500, :2] = 0.0
    parts = np.array_split(np.arange(3000), 30)
    hits = [scene._driven(poses[i], controls[i], 0.2)[1] for i in parts]
    return np.concatenate(hits), sum(near)


@pytest.mark.needs_numba(reason="9000 motions one by one among pixels take more than 20 s")
@pytest.mark.parametrize("world", PLACES.values(), ids=PLACES)
def test_motions_far_from_all_obstacles_are_not_swept_and_nothing_is_missed(world):
    hits, swept = hits_of_many_motions(world)
    assert_array_equal(hits, hits_of_many_motions(world, shortcut=False)[0])
    assert 100 < hits.sum() < swept < 2500
    # Were the body taken for a point, some corner would be forgotten.
    assert (hits_of_many_motions(world, radius=0.0)[0] != hits).any()


@pytest.mark.needs_numba(reason="motions one by one among pixels take more than 20 s")
def test_the_end_of_a_bitmap_is_no_way_out():
    pixels = PLACES["pixels"]
    with_edge = hits_of_many_motions(pixels)[0]
    without = hits_of_many_motions(Endless(pixels.occupied, pixels.resolution))[0]
    assert with_edge[without].all()
    assert (with_edge & ~without).any()


def test_a_post_between_two_poses_is_met():
    post = WallWorld([[[0.5, -0.01], [0.5, 0.01]], [[9, -9], [9, 9]]])
    options = {"start": [0, 0, 0], "dt": 1.0, "footprint": SQUARE}
    log = record(
        post, Unicycle(), None, Script([[1.0, 0.0]]), PerfectEstimator(), rng(), **options
    )
    assert log.notes["hit"].tolist() == [False, True]
    assert log.truth[-1, 0] == pytest.approx(0.35, abs=1e-3)
    # Looking at both ends only would have missed it; and a point passes through everything.
    assert not post.collides(SQUARE, [[0, 0, 0], [1, 0, 0]]).any()
    free = record(
        post, Unicycle(), None, Script([[1.0, 0.0]]), PerfectEstimator(), rng(), start=[0, 0, 0]
    )
    assert not free.notes["hit"].any()


def test_a_batch_is_many_runs_with_noise_of_their_own():
    start = np.zeros((50, 3))
    controls = np.tile([0.5, 0.1], (10, 50, 1))

    class Many:
        k = 0

        def command(self, view):
            assert view.pose.shape == (50, 3)
            self.k += 1
            return controls[self.k - 1] if self.k <= 10 else None

    log = record(
        None, Unicycle(), None, Many(), DeadReckoning(Unicycle(), start), rng(), start=start,
        control_cov=np.diag([0.01, 0.01]),
    )  # fmt: skip
    assert log.n_runs == 50
    assert log.truth[-1, :, 0].std() > 0.005
    assert_allclose(log.notes["believed"], np.tile(log.notes["believed"][:, :1], (1, 50, 1)))


def test_landmarks_are_measured_for_a_filter_that_makes_the_map_while_it_drives():
    world = LandmarkWorld([[2, 1], [2, -1], [4, 0.5]])
    sensor = RangeBearing(0.02, 0.01, max_range=3.0)
    slam = EKFSlam(Unicycle(), sensor, [0, 0, 0])
    V = np.diag([0.05, 0.05]) ** 2
    log = record(
        world, Unicycle(), sensor, Script([[0.5, 0.1]] * 40), slam, rng(2), start=[0, 0, 0],
        control_cov=V,
    )  # fmt: skip
    assert_array_equal(log.landmarks, world.points)
    assert log.ids[0].tolist() == [0, 1]
    assert set(np.concatenate(log.ids)) == {0, 1, 2}
    assert np.hypot(*(slam.pose - log.truth[-1])[:2]) < 0.05
    again = run(EKFSlam(Unicycle(), sensor, [0, 0, 0]), log)
    assert_allclose(again.poses[-1], slam.pose, atol=1e-12)


def test_same_seed_same_log():
    first, second = (a_drive(control_cov=YOUBOT.control_cov(0.5)) for _ in range(2))
    assert_array_equal(first.truth, second.truth)
    assert_array_equal(first.ranges, second.ranges)


def test_time_runs_out_and_a_pilot_may_not_even_begin():
    assert len(a_drive(max_time=1.0)) == 6
    log = a_drive(Script(np.zeros((0, 3))))
    assert len(log) == 1
    assert log.ranges.shape == (1, 36)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": [0.05, 0.05, 0], "footprint": SQUARE}, "start: expected a pose at which the"),
        ({"start": [1, 1]}, "start: expected shape"),
        ({"start": np.ones((2, 3))}, "start: expected one robot"),
        ({"dt": 0.0}, "dt"),
        ({"max_time": -1.0}, "max_time"),
        ({"control_cov": np.eye(2)}, "control_cov"),
        ({"footprint": [1, 2]}, "footprint"),
        ({"pilot": Witness([np.nan, 0, 0], 2)}, "command"),
        ({"belief": PerfectEstimator}, "belief: expected an estimator"),
        ({"belief": EKFSlam(YOUBOT, RangeBearing(1, 1), [0, 0, 0])}, "belief: expected one that"),
    ],
)
def test_bad_input_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        a_drive(**change)


def test_models_and_generator_are_checked():
    belief, script = PerfectEstimator(), Script([[0.1, 0.0]])
    with pytest.raises(ValueError, match="robot: expected a motion model"):
        record(None, Unicycle, None, script, belief, rng(), start=[0, 0, 0])
    with pytest.raises(ValueError, match="rng"):
        record(None, Unicycle(), None, script, belief, 3, start=[0, 0, 0])
    with pytest.raises(ValueError, match="world: expected one with obstacles"):
        record(None, Unicycle(), LIDAR, script, belief, rng(), start=[0, 0, 0])
    with pytest.raises(ValueError, match="world: expected a LandmarkWorld"):
        record(ROOM, Unicycle(), RangeBearing(1, 1), script, belief, rng(), start=[1, 1, 0])
    with pytest.raises(ValueError, match="controls"):
        Script([1.0, 2.0])
    assert repr(script) == "Script(1 controls to go)"
    assert repr(belief) == "PerfectEstimator([0.0, 0.0, 0.0])"
