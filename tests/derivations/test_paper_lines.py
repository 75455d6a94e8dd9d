"""Lines of the papers that no formula holds: small claims, listings and drawings, each run once.

The page "The papers, line by line" names these tests; what has a chapter or a formula is tested
there.
"""

import itertools
import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from slamlab import datasets
from slamlab.filters import kalman
from slamlab.filters.particle import effective_sample_size, systematic_resample
from slamlab.gaussian import Gaussian
from slamlab.geometry import compose, wrap_angle
from slamlab.navigation import PathMemory, fit_cubic
from slamlab.robots import YOUBOT, Unicycle
from slamlab.sensors import Lidar, RangeBearing, VisualOdometer
from slamlab.slam import EKFSlam
from slamlab.slam.association import joint_compatibility, nearest_neighbour
from slamlab.slam.linear import CompassMotion, Displacement
from slamlab.worlds import free_poses, rooms

BIB = Path(__file__).resolve().parents[2] / "book" / "references.bib"
LIDAR, ROOM = Lidar(120), rooms.thesis_room()


# P1


def test_p1_16_17_are_formulas_for_ever_and_values_for_one_step():
    u, dt = np.array([0.4, 0.1, 0.3]), 0.1
    F_x, F_u = YOUBOT.jacobians(np.array([0.0, 0.0, 0.2]), u, dt)
    moved, same = (YOUBOT.jacobians(np.array([3.0, 1.0, a]), u, dt) for a in (1.2, 0.2))
    np.testing.assert_array_equal(F_x, same[0])
    assert np.abs(F_x - moved[0]).max() > 0.02
    assert np.abs(F_u - moved[1]).max() > 0.05


# P2


def test_p2_history_every_source_named_stands_in_the_bibliography():
    text = BIB.read_text(encoding="utf-8")
    named = {
        "smith1986representation": 1986, "durrantwhyte1988uncertain": 1988,
        "crowley1989world": 1989, "chatila1985position": 1985,
        "durrantwhyte1996localisation": 1996, "smith1990estimating": 1990,
        "montemerlo2002fastslam": 2002, "durrantwhyte2006simultaneous": 2006,
    }  # fmt: skip
    for key, year in named.items():
        entry = re.search(rf"@\w+\{{{key},.*?\n\}}", text, re.DOTALL)
        assert entry is not None, key
        assert f"year = {{{year}}}" in entry[0], key
    # The grants that P2 thanks are of 2016 and 2017: both solutions are older than it.
    assert max(named.values()) < 2016


def test_p2_9_text_a_landmark_that_moves_needs_its_own_time_update():
    """P2: the time update "is needed for landmarks that may move"."""
    rng, runs, steps, walk, r = np.random.default_rng(2), 300, 60, 0.05, 0.2
    m = np.cumsum(rng.normal(0, walk, (steps, runs)), 0)
    z = (m + rng.normal(0, r, m.shape))[..., None]
    due, nees = runs, {}
    for q in (walk**2, 0.0):
        start = Gaussian(np.zeros(1), np.array([[1.0]]))
        I = np.eye(1)
        filtered = [
            kalman.filter(z[:, k], I, I, q * I, r**2 * I, start) for k in range(runs)
        ]  # fmt: skip
        error = np.array([f.means[-1, 0] - m[-1, k] for k, f in enumerate(filtered)])
        nees[q] = (error**2 / filtered[0].covs[-1, 0, 0]).sum()
    assert abs(nees[walk**2] / due - 1) < 0.25
    assert nees[0.0] / due > 10


def told(seen_at_once):
    """Share of its variance that each of 12 landmarks in a row loses when the first is told."""
    slam = EKFSlam(CompassMotion(), Displacement(0.3), [0, 0, 0], np.diag([0.04, 0.04, 0]))
    for k in range(12):
        names = range(12) if seen_at_once else range(max(k - 2, 0), min(k + 3, 12))
        slam.update(np.zeros((len(names), 2)), names)
        slam.predict([0, 0], 1.0, 0.05**2 * np.eye(2))
    order = [3 + 2 * slam.ids.index(name) for name in range(12)]
    P = slam.cov[np.ix_(order, order)]
    return P[:, 0] ** 2 / (P[0, 0] + 0.01**2) / np.diag(P)


def test_p2_the_effect_of_a_look_falls_with_distance_only_along_a_way():
    """P2: it "falls with the distance to neighbouring landmarks"; what decides is the tie."""
    along, at_once = told(False), told(True)
    assert (np.diff(along[2:]) < 0).all()
    assert along[1] < along[2], "the nearest, seen less often, gains less than the next"
    assert along[-1] < 0.75 * along[2]
    np.testing.assert_allclose(at_once[1:], at_once[1], rtol=1e-9)


def guided(rng, r, policy, steps=60, n=50):
    """Error against the Kalman filter of a particle filter that resamples when `policy` says."""
    truth, m, P, errors = 0.0, 0.0, 0.0, []
    x, w = np.zeros(n), np.full(n, 1 / n)
    for k in range(steps):
        truth += rng.normal()
        z = truth + rng.normal(0, r)
        x, P = x + rng.normal(size=n), P + 1
        gain = P / (P + r**2)
        m, P = m + gain * (z - m), P * (1 - gain)
        w = w * np.exp(-0.5 * (z - x) ** 2 / r**2) + 1e-300
        w /= w.sum()
        errors.append(w @ x - m)
        if policy(k, w):
            x, w = x[systematic_resample(w, rng)], np.full(n, 1 / n)
    return errors


def test_p2_when_to_draw_anew_a_threshold_is_no_worse_than_every_step():
    """P2: "an open question". Fixed numbers of steps lose; of the rest the sensor decides."""
    policies = {
        "each": lambda k, w: True,
        "tenth": lambda k, w: k % 10 == 9,
        "half": lambda k, w: effective_sample_size(w) < len(w) / 2,
    }
    for r in (1.0, 3.0):
        rms = {}
        for name, policy in policies.items():
            rng = np.random.default_rng(1)
            errors = [guided(rng, r, policy) for _ in range(100)]
            rms[name] = np.sqrt(np.mean(np.square(errors)))
        assert rms["half"] < 1.15 * rms["each"]
        assert rms["each"] < 1.15 * rms["half"]
        assert rms["tenth"] > 1.3 * rms["half"]


# P3


def test_p3_the_odometer_accumulates_error_as_its_own_data_say():
    """P3: visual odometry "has none of these drawbacks", accumulation of error among them."""
    odometer, rng = VisualOdometer.simple(0.001, 0.004), np.random.default_rng(5)
    before, after, off = np.zeros((60, 3)), np.array([0.007, 0, 0]) * np.ones((60, 1)), []
    believed = before
    for k in range(1, 401):
        believed = compose(believed, odometer.measure(before, after, rng))
        off.append(np.hypot(believed[:, 0] - 0.007 * k, believed[:, 1]))
    short, far = (np.sqrt(np.mean(off[k - 1] ** 2)) for k in (100, 400))
    assert far > 3 * short, "faster than the way, because the heading is lost too"
    assert np.hypot(-250 + 500, 550 - 500) == pytest.approx(255, abs=0.1)


def test_p3_2_4_a_path_past_its_start_would_end_there():
    """P3's step 2.4 stops near the start, ours when little of the path is left."""
    memory = PathMemory(0.02)
    for a, b in itertools.pairwise(np.array([[0, 0], [1, 0], [1, 1], [0.05, 1], [0.05, 0.05]])):
        for point in np.linspace(a, b, 60):
            memory.add(point)
    memory.close()
    end = memory.point_at(memory.length)
    assert np.hypot(*end) < 0.1 < memory.length - 3


def test_p3_the_residual_is_close_to_the_distance_to_the_curve():
    """P3: independent fits of x(t) and y(t) are "close to minimising the distances"."""
    rng, s = np.random.default_rng(0), np.linspace(0, 1, 60)
    bend, tau = np.stack([0.5 * s, 0.12 * np.sin(np.pi * s)], 1), np.linspace(0, 1, 1001)

    def distances(coefficients, points):
        curve = np.stack([np.polyval(c[::-1], tau) for c in coefficients], 1)
        return np.sqrt(((points[:, None] - curve) ** 2).sum(2).min(1))

    def rms_of_both(sigma):
        p = bend + rng.normal(0, sigma, bend.shape)
        p[[0, -1]] = bend[[0, -1]]
        t = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(p, axis=0).T))])
        powers = np.asarray(fit_cubic(t, p, p[0], p[-1]).powers_of_t())
        c = (powers if len(powers) == 2 else powers.T) * t[-1] ** np.arange(4)

        def at(inner):
            a = np.stack([p[0], inner[:2], inner[2:], p[-1]])
            return np.stack(
                [a[0], 3 * (a[1] - a[0]), 3 * (a[0] - 2 * a[1] + a[2]),
                 a[3] - 3 * a[2] + 3 * a[1] - a[0]], 1
            )  # fmt: skip

        guess = np.concatenate([p[0] + c[:, 1] / 3, p[-1] - c @ np.arange(4) / 3])
        best = least_squares(lambda inner: distances(at(inner), p), guess, max_nfev=20).fun
        return np.sqrt([np.mean(distances(c, p) ** 2), np.mean(best**2)])

    ours, best = rms_of_both(0.01)
    assert ours < 1.25 * best, "with noise: close"
    ours, best = rms_of_both(0.0)
    assert ours > 5 * best, "without noise: far from the smallest"
    assert ours < 0.05 / 8, "and yet a small part of the tolerance of 50 mm"


def test_p3_the_polygon_parameter_keeps_the_order_and_is_the_length_only_without_noise():
    """P3: the parameter keeps the order; "with small noise t ~ s". Steps of 7 mm, as P3's."""
    rng, ratio = np.random.default_rng(0), []
    way = np.stack([np.linspace(0, 3.5, 505), np.zeros(505)], 1)
    for sigma in (0.0, 0.001, 0.02):
        steps = np.hypot(*np.diff(way + rng.normal(0, sigma, way.shape), axis=0).T)
        assert (steps > 0).all()
        ratio.append(steps.sum() / 3.5)
    assert ratio[0] == pytest.approx(1)
    assert ratio[1] == pytest.approx(1, abs=0.05)
    assert ratio[2] > 4


def test_p3_a_fit_filters_noise_of_points_and_not_what_was_added_up():
    """P3: "the approximation is one more filter". A bend of 60 points, 10 mm of noise."""
    rng, s = np.random.default_rng(0), np.linspace(0, 1, 60)
    bend = np.stack([0.5 * s, 0.12 * s**2 - 0.1 * s**3], 1)

    def left(points):
        fit = np.stack([np.polyval(np.polyfit(s, x, 3), s) for x in points.T], 1)
        return np.sqrt(np.mean((fit - bend) ** 2) / np.mean((points - bend) ** 2))

    each = [left(bend + rng.normal(0, 0.01, bend.shape)) for _ in range(40)]
    added = [left(bend + np.cumsum(rng.normal(0, 0.01, bend.shape), 0)) for _ in range(40)]
    assert np.mean(each) == pytest.approx(np.sqrt(4 / 60), rel=0.1), "of 60 numbers 4 are left"
    assert np.mean(added) > 0.9, "a walk looks like a bend"


def test_p3_a_held_last_point_keeps_its_noise():
    """P3: hold the last point too "if the data have no noise"."""
    rng, t = np.random.default_rng(0), np.linspace(0, 0.5, 60)
    bend = np.stack([t, 0.5 * t**2 - 0.6 * t**3], 1)

    def end_errors(sigma):
        p = bend + rng.normal(0, sigma, bend.shape)
        p[0] = bend[0]
        held, free = (fit_cubic(t, p, p[0], end)(t[-1]) for end in (p[-1], None))
        return np.hypot(*(held - bend[-1])), np.hypot(*(free - bend[-1]))

    held, free = np.sqrt(np.mean(np.square([end_errors(0.01) for _ in range(200)]), 0))
    assert held == pytest.approx(0.01 * np.sqrt(2), rel=0.15), "the noise of one point"
    assert free < 0.7 * held
    assert max(end_errors(0.0)) < 1e-12, "without noise a cubic is found either way"


def test_p3_the_grid_of_a_robot_that_stands_has_no_length():
    """P3: (t_0 - t_1)^2 >> 0 "is guaranteed by the grid of the input data"."""

    def length(points):
        return np.hypot(*np.diff(points, axis=0).T).sum()

    moves = np.stack([0.007 * np.arange(20), np.zeros(20)], 1)
    stands = np.tile([0.3, 0.2], (20, 1))
    assert length(moves) ** 2 > 0.01
    assert length(stands) ** 2 == 0
    with pytest.raises(ValueError, match="t: "):
        fit_cubic(np.zeros(20), stands, stands[0], stands[-1], [1.0, 0.0])


def test_p3_seven_legs_of_half_a_metre_cannot_end_at_F():
    """505 points at 10 Hz, legs of 0.5 m, right angles; F = (-500, 500) mm."""
    ends = set()
    for turns in itertools.product((1j, -1j), repeat=6):
        directions = np.cumprod([1j, *turns])
        end = directions.sum()
        ends.add((round(end.real), round(end.imag)))
    assert (-1, 1) not in ends
    assert (-1, 2) in ends or (1, 2) in ends


def test_p3_table_1_does_not_follow_its_own_law():
    """0.1 mm to 1 mm: ten times fewer pieces, 0.5 to 0.05 ms."""
    law = (np.log2(36000) / np.log2(3600)) ** 2
    assert law == pytest.approx(1.6, abs=0.05)
    assert 0.5 / 0.05 == pytest.approx(36000 / 3600), "linear in n"


def test_p3_the_memory_keeps_up_with_10_hz():
    memory, rng, spent = PathMemory(0.05), np.random.default_rng(6), []
    points = np.cumsum(rng.normal([0.007, 0], 0.002, (505, 2)), 0)
    for point in [*points[:50], *points]:
        begun = time.perf_counter()
        memory.add(point)
        spent.append(time.perf_counter() - begun)
    assert np.mean(spent[50:]) < 0.1 / 5


# P4


def off_by_order(motion, sensor, rng, runs, spread):
    """Errors of a new landmark, placed after and before the known one corrects the pose."""
    points, errors = np.array([[4.0, 1.0], [3.0, -2.0]]), {True: [], False: []}
    for _ in range(runs):
        true = motion.step(np.zeros(3), rng.normal(0, spread), 1.0)
        z = sensor.observe(true, points) + rng.multivariate_normal([0, 0], sensor.cov, 2)
        for old_first in errors:
            slam = EKFSlam(motion, sensor, [0, 0, 0, *points[0]], np.zeros((5, 5)), ids=["old"])
            slam.predict([0, 0], 1.0, np.diag(spread) ** 2)
            for k in (0, 1) if old_first else (1, 0):
                slam.update(z[[k]], [("old", "new")[k]])
            errors[old_first].append(slam.landmarks[1] - points[1])
    return np.array(errors[True]), np.array(errors[False])


def test_p4_update_first_then_augment():
    """P4, step 4: landmarks of the map serve the update, then the new ones are added."""
    rng = np.random.default_rng(7)
    linear = off_by_order(CompassMotion(), Displacement(0.1), rng, 5, [0.5, 0.5])
    np.testing.assert_allclose(*linear, atol=1e-9, err_msg="linear: the order changes nothing")
    polar = off_by_order(Unicycle(), RangeBearing(0.05, 0.01), rng, 200, [0.3, 0.5])
    first, last = (np.sqrt((errors**2).mean()) for errors in polar)
    assert last > 1.1 * first, "nonlinear: better placed from the corrected pose"


def test_p4_the_nearest_neighbour_costs_less_than_the_joint_search():
    rng, sensor = np.random.default_rng(9), RangeBearing(0.1, 0.02)
    points = rng.uniform(-8, 8, (60, 2))
    slam = EKFSlam(Unicycle(), sensor, np.zeros(3))
    slam.update(sensor.observe(slam.pose, points), range(len(points)))
    slam.predict([0.3, 0.1], 1.0, np.diag([0.2, 0.1]) ** 2)
    z = sensor.observe(slam.pose, points[:10])
    spent = {}
    for associate in (nearest_neighbour, joint_compatibility):
        best = np.inf
        for _ in range(7):
            begun = time.perf_counter()
            associate(slam, z)
            best = min(best, time.perf_counter() - begun)
        spent[associate] = best
    assert spent[nearest_neighbour] < spent[joint_compatibility]


# P5


def test_p5_the_longest_beam_leads_back_along_the_diagonal():
    """Figure 15: after three quarters of the longest beam the longest one points back."""
    for room in (ROOM, rooms.thesis_room_two()):
        poses = free_poses(room, 300, np.random.default_rng(1), 0.25)
        scans = LIDAR.scan(room, poses)
        far, angle = scans.max(1), LIDAR.beam_angles[scans.argmax(1)]
        way = np.minimum(0.75 * far, far - 0.3)
        there = compose(poses, np.stack([way * np.cos(angle), way * np.sin(angle), angle], 1))
        next_one = LIDAR.beam_angles[LIDAR.scan(room, there).argmax(1)]
        back = np.abs(wrap_angle(next_one - np.pi)) < np.deg2rad(20)
        ahead = np.abs(wrap_angle(next_one)) < np.deg2rad(20)
        assert back.mean() > 0.65
        assert ahead.mean() < 0.02


def test_p5_1_2_without_a_sensor_the_uncertainty_only_grows_and_no_map_is_made():
    sensor = RangeBearing(0.05, np.radians(1))
    blind, seeing = (EKFSlam(YOUBOT, sensor, np.zeros(3)) for _ in range(2))
    u, spreads = np.array([0.3, 0.0, 0.1]), {"blind": [], "seeing": []}
    for _ in range(100):
        for name, slam in (("blind", blind), ("seeing", seeing)):
            slam.predict(u, 0.1, YOUBOT.control_cov(0.4))
            if name == "seeing":
                slam.update(sensor.observe(slam.pose, [[2.0, 1.0], [-1.0, 2.0]]), [1, 2])
            spreads[name].append(np.trace(slam.pose_cov[:2, :2]))
    assert (np.diff(spreads["blind"]) > 0).all()
    assert spreads["seeing"][-1] < 0.5 * spreads["blind"][-1]
    assert (blind.n_landmarks, seeing.n_landmarks) == (0, 2)


def test_p5_a_step_of_slam_costs_more_than_one_of_odometry():
    """P5 3.2.6: methods of SLAM cost more. The league's seconds a step, on every log."""
    league = json.loads((Path(datasets.__file__).parent / "data" / "league.json").read_text())
    timed = {
        name: {
            system: np.median([run["seconds"] for run in runs])
            for system, runs in systems.items()
            if runs[0]["seconds"]
        }
        for name, systems in league.items()
    }
    timed = {name: row for name, row in timed.items() if "dead reckoning" in row}
    assert len(timed) >= 5
    for name, seconds in timed.items():
        odometry = seconds.pop("dead reckoning")
        assert odometry < min(seconds.values()), name
