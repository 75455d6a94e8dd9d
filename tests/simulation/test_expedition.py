"""Out and home again: what is stored can be had again, and the pieces do what they say."""

import numpy as np
import pytest

from slamlab.evaluation.tours import path_length
from slamlab.navigation import YOUBOT_BODY, CollisionGuard, CoveragePilot, ReturnPilot
from slamlab.robots import YOUBOT
from slamlab.sensors import Lidar
from slamlab.simulation import PerfectEstimator, record
from slamlab.simulation.expedition import (
    ENVIRONMENTS,
    ESTIMATORS,
    HOME_RADIUS,
    RETURN_METHODS,
    MiscalibratedOdometry,
    come_home,
    results,
)
from slamlab.testing import check_motion_model
from slamlab.worlds import BitmapWorld, rooms

LIDAR = Lidar(120, max_range=5.0, offset=0.3)
HALL = BitmapWorld(np.pad(np.zeros((60, 160), bool), 2, constant_values=True), 0.1)


class Revised(PerfectEstimator):
    """Knows where it is, and takes all its past to lie 0.4 m to the left from some step on."""

    def __init__(self, at):
        super().__init__()
        self.at, self.rows = at, []

    def update(self, measurement, ids=None):
        super().update(measurement)
        self.rows.append(self.pose)

    @property
    def trajectory(self):
        moved = [0.0, 0.4 if len(self.rows) > self.at else 0.0, 0.0]
        return np.array(self.rows) + moved


def drive(pilot, belief, start, max_time=60.0):
    return record(HALL, YOUBOT, LIDAR, pilot, belief, np.random.default_rng(0), start=start,
                  dt=0.2, footprint=YOUBOT_BODY.footprint, max_time=max_time)  # fmt: skip


def test_worn_wheels_keep_the_contract_and_drive_farther():
    worn = MiscalibratedOdometry(1.02, 0.01)
    assert check_motion_model(worn, [0.5, 0.1, 0.2])
    np.testing.assert_allclose(worn.step([0, 0, 0], [1, 0, 0], 1.0)[2], 0.01)
    np.testing.assert_allclose(MiscalibratedOdometry().step([0, 0, 0], [1, 0, 0], 1.0), [1, 0, 0])


@pytest.mark.parametrize("world", [rooms.ring(), rooms.long_corridor()])
def test_the_marks_stand_on_free_floor(world):
    building = next(b for b in ENVIRONMENTS.values() if b.world().bounds == world.bounds)
    assert world.clearance(np.array(building.start[:2])) > YOUBOT_BODY.circumradius


def test_the_block_of_the_ring_hides_one_side_from_the_other():
    ring = rooms.ring()
    assert ring.cast([15.8, 1.4], [np.pi / 2])[0] < 5.0
    assert ring.is_free(np.array([[1.4, 10.0], [28.4, 12.5], [15.0, 18.6]])).all()


def test_who_retraces_comes_home_tail_first_and_touches_nothing():
    way = np.stack([np.linspace(2, 12, 80), 3 + np.sin(np.linspace(0, 3, 80))], -1)
    pilot = ReturnPilot(way, CollisionGuard(YOUBOT_BODY), LIDAR)
    log = drive(pilot, PerfectEstimator(), [*way[-1], 0.0])
    assert not pilot.stuck
    assert not log.notes["hit"].any()
    assert np.hypot(*(log.truth[-1, :2] - way[0])) < 0.04
    assert np.abs(log.truth[:, 2]).max() < 0.8


class Pusher:
    """Wants along a wall, back and forth, and knows nothing but its scan."""

    def __init__(self, lidar):
        self.guard, self.lidar = CollisionGuard(YOUBOT_BODY, 0.12), lidar

    def command(self, view):
        points = self.lidar.points(view.measurement)
        points = points[np.isfinite(points).all(-1)]
        along = 0.6 if int(view.time) % 40 < 20 else -0.6
        return self.guard.safe_velocity(np.array([along, 0.0, 0.0]), points, view.dt)


@pytest.mark.parametrize("seed", range(3))
def test_who_drives_along_a_wall_for_minutes_is_not_brought_to_it_by_noise(seed):
    lidar = Lidar(180, max_range=5.0, offset=0.3, sigma_range=0.01)
    log = record(HALL, YOUBOT, lidar, Pusher(lidar), PerfectEstimator(),
                 np.random.default_rng(seed), start=[2.0, 0.42, 0.0], dt=0.2,
                 footprint=YOUBOT_BODY.footprint, control_cov=YOUBOT.control_cov(0.3),
                 max_time=120.0)  # fmt: skip
    assert not log.notes["hit"].any()
    assert HALL.clearance(log.truth[-50:, :2]).min() > 0.24  # 5 cm from its side


def test_a_wall_across_the_path_makes_it_give_up():
    way = np.stack([np.linspace(-3, 12, 80), np.full(80, 3.0)], -1)
    pilot = ReturnPilot(way, CollisionGuard(YOUBOT_BODY), LIDAR)
    log = drive(pilot, PerfectEstimator(), [12, 3, 0])
    assert pilot.stuck
    assert not log.notes["hit"].any()


def test_the_path_is_laid_anew_when_the_past_moves():
    way = np.stack([np.linspace(2, 12, 80), np.full(80, 3.0)], -1)
    belief = Revised(at=100)
    belief.rows = [np.append(p, 0.0) for p in way]
    pilot = ReturnPilot(way, CollisionGuard(YOUBOT_BODY), LIDAR, smoother=belief)
    log = drive(pilot, belief, [12, 3, 0])
    assert pilot.n_replans == 1
    np.testing.assert_allclose(log.truth[-1, :2], [2, 3.4], atol=0.05)


def test_a_loop_of_the_way_is_driven_only_if_it_is_asked_for():
    turn = np.linspace(0, 2 * np.pi, 41)[1:]
    loop = np.stack([8 + np.sin(turn), 4 - np.cos(turn)], -1)
    east = np.stack([np.linspace(2, 8, 40), np.full(40, 3.0)], -1)
    way = np.vstack([east, loop, [8.3, 2.6], [8.4, 2.3]])
    lengths = [
        ReturnPilot(way, CollisionGuard(YOUBOT_BODY), LIDAR, cut_loops=cut).memory.length
        for cut in (True, False)
    ]
    assert lengths[1] - lengths[0] > 5.0


def test_the_floor_is_drawn_anew_when_the_past_moves():
    belief = Revised(at=30)
    pilot = CoveragePilot(YOUBOT_BODY, LIDAR, view_range=1.5, home=False, smoother=belief)
    drive(pilot, belief, [2, 3, 0], max_time=5.0)
    before = pilot.floor
    drive(pilot, belief, [3, 3, 0], max_time=5.0)
    assert pilot.floor is not before


def test_near_its_start_again_it_drives_its_first_metres_once_more():
    world, start = rooms.long_corridor(), [20.0, 1.0, 0.0]
    driven = []
    for again in (0.0, 8.0):
        pilot = CoveragePilot(
            YOUBOT_BODY, LIDAR, view_range=2.5, max_speed=0.8, home=False, revisit_after=again
        )
        log = record(world, YOUBOT, LIDAR, pilot, PerfectEstimator(), np.random.default_rng(0),
                     start=start, dt=0.4, max_time=180.0)  # fmt: skip
        assert pilot.finished
        driven.append(path_length(log)[-1])
    # From 5 m ahead of the start to 8 m ahead of it, and back again.
    assert driven[1] == pytest.approx(driven[0] + 6.0, abs=2.0)


def test_a_way_that_is_none_is_refused():
    with pytest.raises(ValueError, match="way"):
        come_home(None, "stairs")


def test_every_belief_went_out_thirty_times_into_every_building_and_touched_nothing():
    stored = results()
    assert set(stored) == set(ENVIRONMENTS)
    for beliefs in stored.values():
        assert set(beliefs) == set(ESTIMATORS)
        for cell in beliefs.values():
            assert len(cell["error"]) == 30
            assert not cell["touched"].any()


def near(building, radius):
    """How many of thirty end within `radius` (m) of their marker by map, for each belief."""
    k = RETURN_METHODS.index("map")
    cells = results()[building].items()
    return {name: int((cell["error"][:, k] <= radius).sum()) for name, cell in cells}


def test_in_the_corridor_walls_as_landmarks_come_home_and_scan_on_scan_comes_near():
    home, very_near = near("corridor", HOME_RADIUS), near("corridor", 0.05)
    assert home["grid FastSLAM"] >= 20
    assert home["dead reckoning"] == 0
    assert 20 < home["scan graph"] == home["scan matching"]
    assert very_near["EKF-SLAM, walls"] >= 29
    assert very_near["scan matching"] < 15


def test_closures_bring_the_robot_within_5_cm_and_scan_on_scan_alone_does_not():
    """Of thirty in the ring: with closures at least 29, by wheels none, matching between."""
    very_near = near("ring", 0.05)
    assert very_near["scan graph"] >= 29
    assert very_near["dead reckoning"] == 0
    assert 0 < very_near["scan matching"] < 18
    assert near("ring", HOME_RADIUS)["scan matching"] >= 25
