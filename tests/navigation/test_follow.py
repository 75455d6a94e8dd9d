"""The way home: laws, limits, stops, self-approaches, bad input."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from slamlab.kernels import numba_serves
from slamlab.localization import DeadReckoning
from slamlab.navigation import PathFollower, PathMemory, RegulatedPurePursuit, ReturnLaw
from slamlab.robots import YOUBOT, RelativePose, Unicycle
from slamlab.sensors.visual_odometer import VisualOdometer
from slamlab.simulation import record

EXACT = VisualOdometer.simple(0.0, 0.0)
NOISY = VisualOdometer.simple(0.001, 0.004)


def rng(seed=0):
    return np.random.default_rng(seed)


def go_home(path, pose, law, motion, odometer, rng, *, estimate=None, turn_first=False, stop=0.02,
            **options):  # fmt: skip
    """Home by odometry alone: the log, the pilot; `s` is how far it still was at each step."""
    pilot = PathFollower(path, law, turn_first=turn_first, stop=stop)
    believed = DeadReckoning(RelativePose(), pose if estimate is None else estimate)
    log = record(
        None, motion, None, pilot, believed, rng, start=pose, odometer=odometer, **options
    )
    return log, pilot


def way_left(path, log, law):
    """How far it still was along the path at each step, (T, ...)."""
    s = [np.full(log.truth.shape[1:-1], path.length)]
    for pose in log.notes["believed"]:
        s.append(law.command(path, pose, s[-1])[1])
    return np.array(s[1:])


def memory_of(*corners, tolerance=0.02, step=0.02):
    memory = PathMemory(tolerance)
    memory.add(corners[0])
    for a, b in zip(corners[:-1], corners[1:], strict=True):
        n = int(np.ceil(np.hypot(b[0] - a[0], b[1] - a[1]) / step))
        for point in np.linspace(a, b, n + 1)[1:]:
            memory.add(point)
    memory.close()
    return memory


STAIRS = memory_of((0, 0), (0.5, 0), (0.5, 0.5), (1, 0.5), (1, 1))
# Out, round, and back 6 cm beside the way out: much nearer than the look-ahead distance.
HAIRPIN = memory_of((0, 0), (2, 0), (2, 0.06), (0.2, 0.06))
HOMES = {
    "P3, turned first": (ReturnLaw(), Unicycle(), True),
    "P3, backwards": (ReturnLaw(backwards=True), Unicycle(), False),
    "P3, mecanum": (ReturnLaw(mecanum=True, k_omega=0.0), YOUBOT, False),
    "P3, mecanum that turns": (ReturnLaw(mecanum=True), YOUBOT, True),
    "pursuit": (RegulatedPurePursuit(), Unicycle(), False),
    "pursuit, backwards": (RegulatedPurePursuit(backwards=True), Unicycle(), False),
}


def far_end(path):
    tangent = path.tangent_at(path.length)
    return np.array([*path.point_at(path.length), np.arctan2(tangent[1], tangent[0])])


@pytest.mark.parametrize("name", HOMES)
@pytest.mark.parametrize("path", [STAIRS, HAIRPIN], ids=["stairs", "hairpin"])
def test_every_law_comes_home_along_the_path(name, path):
    law, motion, turn = HOMES[name]
    home, pilot = go_home(path, far_end(path), law, motion, EXACT, rng(), turn_first=turn)
    assert pilot.arrived
    assert np.hypot(*home.truth[-1, :2]) < 0.05
    # In a U-turn narrower than the look-ahead distance it swings out.
    assert path.nearest(home.truth[:, :2])[1].max() < (0.06 if path is STAIRS else 0.15)
    assert_allclose(home.notes["believed"], home.truth, atol=1e-9)


@pytest.mark.parametrize("name", HOMES)
def test_the_way_left_never_grows_and_no_stretch_is_skipped(name):
    law, motion, turn = HOMES[name]
    # On plain code a hundred runs take more than 20 s.
    poses = np.tile(far_end(HAIRPIN), (100 if numba_serves() else 10, 1))
    home, pilot = go_home(HAIRPIN, poses, law, motion, NOISY, rng(1), turn_first=turn)
    assert pilot.arrived.all(), "no run is lost"
    left = way_left(HAIRPIN, home, law)
    assert (np.diff(left, axis=0) <= 0).all()
    # 0.02 m a step, more where it cuts a corner; never from one branch to the other.
    assert np.diff(left, axis=0).min() > -0.3
    farthest = home.notes["believed"][..., 0].max(0)
    assert (farthest > 1.8).all(), "every run drives round the far end of the hairpin"


def test_without_the_window_the_hairpin_is_cut_short():
    place = np.array([1.0, 0.02])
    free, _ = HAIRPIN.nearest(place)
    s = HAIRPIN.length - 0.75
    bound, _ = HAIRPIN.nearest(place, s - 0.3, s)
    assert free < 1.1, "the nearest point of all lies on the way out"
    assert bound > 2.5


def test_the_law_is_the_papers():
    line = memory_of((0, 0), (2, 0))
    law = ReturnLaw(k_v=0.7, k_omega=1.3, lookahead=0.2, max_speed=9, max_turn_rate=9)
    pose = np.array([1.0, 0.1, np.pi])
    u, s = law.command(line, pose, 1.05)
    ahead = np.array([0.8, 0.0]) - pose[:2]
    assert s == pytest.approx(1.0, abs=1e-9)
    # v = k_v |P_f P_r|, omega = k_omega alpha; P_f lies below and ahead: a left turn.
    assert u[0] == pytest.approx(0.7 * np.hypot(*ahead))
    alpha = np.arctan2(ahead[1], ahead[0]) - np.pi + 2 * np.pi
    assert u[1] == pytest.approx(1.3 * alpha)
    assert u[1] > 0
    backwards, _ = ReturnLaw(1.0, 1.3, 0.2, 9, 9, backwards=True).command(
        line, [1.0, 0.1, 0.0], 1.05
    )
    assert backwards[0] < 0
    assert backwards[1] == pytest.approx(1.3 * alpha)


def test_a_mecanum_robot_heads_for_the_point_whatever_its_heading():
    line = memory_of((0, 0), (2, 0))
    for theta in (-2.0, 0.3, 3.0):
        u, _ = ReturnLaw(mecanum=True, k_omega=0.0).command(line, [1.0, 0.1, theta], 1.05)
        direction = theta + np.arctan2(u[1], u[0])
        due = np.arctan2(-0.1, -0.15)
        assert_allclose(np.exp(1j * direction), np.exp(1j * due), atol=1e-9)
        assert u[2] == 0


@pytest.mark.parametrize("name", HOMES)
def test_speed_limits_hold(name):
    law, motion, turn = HOMES[name]
    poses = far_end(STAIRS) + rng(2).normal(0, [0.1, 0.1, 0.8], (50, 3))
    home, pilot = go_home(STAIRS, poses, law, motion, NOISY, rng(3), turn_first=turn)
    speed = np.linalg.norm(home.notes["command"][..., :-1], axis=-1)
    assert speed.max() <= law.max_speed + 1e-12
    assert np.abs(home.notes["command"][..., -1]).max() <= law.max_turn_rate + 1e-12
    assert pilot.arrived.all()


def test_pure_pursuit_slows_down_in_bends_and_before_home():
    law = RegulatedPurePursuit(min_radius=0.5, approach=0.4)
    line = memory_of((0, 0), (2, 0))
    straight, _ = law.command(line, [1.5, 0.0, np.pi], 1.6)
    bend, _ = law.command(line, [1.5, 0.12, np.pi], 1.6)
    late, _ = law.command(line, [0.2, 0.0, np.pi], 0.3)
    assert straight[0] == pytest.approx(0.2)
    assert bend[0] < 0.15
    assert late[0] == pytest.approx(0.1, abs=1e-6)
    # The arc leads through P_f: curvature 2 y / L^2.
    assert bend[1] / bend[0] == pytest.approx(2 * 0.12 / (0.15**2 + 0.12**2), rel=1e-6)
    beside, _ = law.command(line, [1.5, 0.0, 0.5 * np.pi], 1.6)
    assert beside.tolist() == [0.0, 1.5]


def test_turning_first_turns_on_the_spot():
    home, pilot = go_home(
        STAIRS, far_end(STAIRS), ReturnLaw(), Unicycle(), EXACT, rng(), turn_first=True
    )
    spot = home.notes["command"][1:, 0] == 0
    assert 15 < spot.sum() < 30, "180 degrees at 1.5 rad/s take 21 steps"
    assert spot[:15].all()


def test_the_error_at_the_far_end_comes_home_as_a_rigid_motion():
    """Perfect odometry on the way back: end = F' + R(error of heading) (start - F)."""
    believed = far_end(STAIRS)
    truth = believed + [0.25, 0.05, np.radians(7)]
    home, pilot = go_home(
        STAIRS, truth, ReturnLaw(backwards=True), Unicycle(), EXACT, rng(), estimate=believed
    )
    turn = np.radians(7)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    due = truth[:2] + R @ (home.notes["believed"][-1, :2] - believed[:2])
    assert_allclose(home.truth[-1, :2], due, atol=1e-9)
    unturned = truth[:2] + home.notes["believed"][-1, :2] - believed[:2]
    assert np.abs(home.truth[-1, :2] - unturned).max() > 0.05


def test_arrived_robots_stand_still_and_the_lost_are_reported():
    poses = np.stack([far_end(STAIRS)] * 3)
    home, pilot = go_home(
        STAIRS, poses, ReturnLaw(backwards=True), Unicycle(), NOISY, rng(4), max_time=3.0
    )
    assert not pilot.arrived.any()
    assert len(home.times) == 31
    start, pilot = go_home(STAIRS, [0.0, 0, 0], ReturnLaw(), Unicycle(), EXACT, rng(), stop=3.0)
    assert pilot.arrived
    assert len(start) == 1


def test_slipping_wheels_are_seen_by_the_odometer():
    slip = np.diag([0.05, 0.2]) ** 2
    home, pilot = go_home(
        STAIRS, far_end(STAIRS), ReturnLaw(backwards=True), Unicycle(), EXACT, rng(5),
        control_cov=slip,
    )  # fmt: skip
    assert pilot.arrived
    assert_allclose(home.notes["believed"], home.truth, atol=1e-9)
    assert np.hypot(*home.truth[-1, :2]) < 0.05


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ReturnLaw(k_v=0.0), "k_v"),
        (lambda: ReturnLaw(lookahead=-1), "lookahead"),
        (lambda: ReturnLaw(k_omega=-1), "k_omega"),
        (lambda: ReturnLaw(max_speed=np.nan), "max_speed"),
        (lambda: RegulatedPurePursuit(min_radius=0), "min_radius"),
        (lambda: RegulatedPurePursuit(turn_beyond=9), "turn_beyond"),
        (lambda: ReturnLaw().command(STAIRS, [0, 0], 1.0), "pose: expected shape"),
        (lambda: ReturnLaw().command(STAIRS, [0, np.nan, 0], 1.0), "pose: expected finite"),
        (lambda: ReturnLaw().command(PathMemory(0.1), [0, 0, 0], 0.0), "add: expected at least"),
    ],
)
def test_bad_laws_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_pilot_names_a_stop_that_is_none():
    with pytest.raises(ValueError, match="stop"):
        PathFollower(STAIRS, ReturnLaw(), stop=0.0)


def test_the_pilot_says_who_it_is():
    assert "ReturnLaw" in repr(PathFollower(STAIRS, ReturnLaw()))
    assert repr(STAIRS).startswith("PathMemory(2.0")


def test_it_turns_on_the_spot_as_fast_as_it_is_told():
    pose = far_end(STAIRS)
    for rate, most in ((None, 1.5), (0.4, 0.4)):
        pilot = PathFollower(STAIRS, ReturnLaw(), turn_first=True, turn_rate=rate)
        believed = DeadReckoning(RelativePose(), pose)
        log = record(None, Unicycle(), None, pilot, believed, rng(), start=pose, odometer=EXACT)
        on_the_spot = log.notes["command"][:, 0] == 0
        assert abs(log.notes["command"][on_the_spot, 1]).max() == pytest.approx(most)
        assert pilot.arrived
    with pytest.raises(ValueError, match="turn_rate"):
        PathFollower(STAIRS, ReturnLaw(), turn_rate=0.0)
