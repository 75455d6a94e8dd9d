"""The picture after a check: a wrong answer looks wrong, and whatever comes is shown."""

import matplotlib as mpl
import numpy as np
import pytest

mpl.use("Agg")

from slamlab.exercises import ch00_slam_in_ten_minutes as ch00
from slamlab.exercises import ch01_bayes_filter as ch01
from slamlab.exercises import ch02_kalman_filter as ch02
from slamlab.exercises import ch03_extended_kalman_filter as ch03
from slamlab.exercises import ch04_particle_filter as ch04
from slamlab.exercises import ch05_mecanum_kinematics as ch05
from slamlab.exercises import ch06_lidar_simulation as ch06
from slamlab.exercises import ch07_walls_from_points as ch07
from slamlab.exercises import ch08_occupancy_maps as ch08
from slamlab.exercises import ch09_ekf_slam as ch
from slamlab.exercises import ch10_convergence_consistency_and_cost as ch10
from slamlab.exercises import ch11_data_association as ch11
from slamlab.exercises import ch12_fastslam as ch12
from slamlab.exercises import ch13_pose_graphs as ch13
from slamlab.exercises import ch14_scan_matching_and_hector as ch14
from slamlab.exercises import ch15_other_maps as ch15
from slamlab.exercises import ch16_uav_local_range as ch16
from slamlab.exercises import ch17_the_way_home as ch17
from slamlab.exercises import ch18_exploration as ch18
from slamlab.exercises import ch19_autocorrelation_localization as ch19
from slamlab.exercises import ch20_explore_and_return as ch20
from slamlab.exercises._report import Check

MODULES = (
    ch00,
    ch01,
    ch02,
    ch03,
    ch04,
    ch05,
    ch06,
    ch07,
    ch08,
    ch,
    ch10,
    ch11,
    ch12,
    ch13,
    ch14,
    ch15,
    ch16,
    ch17,
    ch18,
    ch19,
    ch20,
)
PICTURES = [
    (module, name)
    for module in MODULES
    for name, check in vars(module).items()
    if isinstance(check, Check) and check._picture is not None
]


def unclosed(outline):
    """Vertices of an outline without the last if it is the first: rounding decides whether."""
    closed = len(outline) > 1 and np.allclose(outline[0], outline[-1], rtol=0, atol=1e-9)
    return unclosed(outline[:-1]) if closed else outline


def drawn(axes):
    """All that was drawn into axes and those within, as numbers."""
    parts = [drawn(within) for within in axes.child_axes]
    parts += [np.asarray(line.get_xydata(), float).ravel() for line in axes.lines]
    placed = [p.get_patch_transform().transform(p.get_path().vertices) for p in axes.patches]
    parts += [np.ravel(unclosed(vertices)) for vertices in placed]
    parts += [np.ma.filled(image.get_array(), np.nan).ravel() for image in axes.images]
    bars = [one.get_segments() for one in axes.collections if hasattr(one, "get_segments")]
    parts += [np.ravel(segment) for segments in bars for segment in segments]
    return np.concatenate([*parts, []])


def texts(figure):
    return [text.get_text() for text in figure.axes[0].texts]


@pytest.fixture(params=PICTURES, ids=lambda pair: pair[1])
def check(request):
    module, name = request.param
    return getattr(module, name)


@pytest.mark.parametrize("module", MODULES)
def test_every_exercise_of_the_chapter_has_a_picture(module):
    checks = {n for n in module.__all__ if n.startswith("check_")}
    assert {name for owner, name in PICTURES if owner is module} == checks


def test_the_right_answer_looks_as_it_should(check):
    left, right = check.draw(check.reference).axes
    np.testing.assert_array_equal(drawn(left), drawn(right))
    titles = [ax.get_title(loc="left").split("\n") for ax in (left, right)]
    assert [title.pop(0) for title in titles] == ["Yours", "As it should be"]
    assert titles[0] == titles[1]
    assert left.get_xlim() == right.get_xlim()


@pytest.mark.parametrize(
    ("check", "wrong"),
    [
        (ch00.check_path_through, lambda known, k, u: ch00.path_through(known, 0, u)),
        (ch00.check_edge_error, lambda i, j, z, mount: ch00.edge_error(i, j, z, 0 * mount)),
        (ch00.check_lamp_jacobian, lambda *given: ch00.lamp_jacobian(*given) * [1, 1, 0, 1, 1]),
        (ch00.check_relax, lambda poses, edges, z, omega: poses),
        (ch00.check_slam, lambda start, u, w, *rest: (ch00.path_through(start, 0, u), 0.0)),
        (ch01.check_predict, lambda b, *p: np.roll(b, 1)),
        (ch01.check_update, lambda b, doors, *s: ch01.update(np.ones(12), doors, *s)),
        (ch01.check_measurements_needed, lambda b, p, g: ch01.measurements_needed(0.5, p, g)),
        (ch01.check_wander, lambda b, d, w, s, seen, p: ch01.wander(b, d, w, s, abs(seen), p)),
        (ch02.check_predict, lambda m, P, u, dt, sigma: ch02.predict(m, P, -u, dt, sigma)),
        (ch02.check_update, lambda m, P, z, H, variances: (m, P)),
        (ch02.check_cov_after_update, lambda P, K, H, R: ch02.cov_after_update(P, K, H, 0 * R)),
        (ch02.check_tunnel, lambda t, z, q, r: ch02.tunnel(t, np.nan_to_num(z), q, r)),
        (ch02.check_innovation_test, lambda nu, S: ch02.innovation_test(nu, np.ones(len(S)))),
        (ch02.check_track, lambda m, P, u, *rest: ch02.track(m, P, 0 * u, *rest)),
        (ch03.check_readings, lambda p, m, b: ch03.readings(p, m, 0 * b)),
        (ch03.check_innovation, lambda z, predicted: z - predicted),
        (ch03.check_jacobian, lambda p, m, b: ch03.jacobian(p, m, b) * [1, 1, -1]),
        (ch03.check_first_fix, lambda z, m, b, *more: ch03.first_fix(z, m, 0 * b, *more)),
        (ch03.check_row_end, lambda m, P, *a: (ch03.row_end(m, P, *a)[0], P)),
        (ch03.check_follow, lambda m, P, u, dt, V, *seen: ch03.follow(m, P, u, dt, 0 * V, *seen)),
        (ch05.check_wheels, lambda u, r, d, b: ch05.wheel_speeds(u, r, 1.0, b)),
        (ch05.check_step, lambda pose, u, dt: pose + dt * u),
        (ch05.check_noise, lambda theta, *a: ch05.process_noise(0, *a)),
        (ch05.check_slip, lambda w, s, n: ch05.slip_alarm(w * [1, -1, -1, 1], s, n)),
        (ch05.check_odometry, lambda pose, P, *a: ch05.odometry(pose, P + np.eye(3), *a)),
        (ch06.check_first_hit, lambda o, x, y, a: ch06.first_hit(o, x, y, a) + 0.5),
        (ch06.check_beam_angles, lambda n, v, turned: np.linspace(-v / 2, v / 2, n)),
        (ch06.check_scan_to_points, lambda p, *a: ch06.scan_to_points(p * [1, 1, -1], *a)),
        (ch06.check_nearest_wall, lambda s, x, y, a: ch06.nearest_wall(s[:4], x, y, a)),
        (ch06.check_record, lambda o, r, p, *a: ch06.record(o, r, p * [1, 1, 0], *a)),
        (ch07.check_line, lambda p, v: ch07.line(p, np.ones(len(p)))),
        (ch07.check_corner, ch07._chord_without_division),
        (ch07.check_wall_cov, ch07._equal_weights),
        (ch07.check_to_world, lambda p, P, w, C: (ch07.to_world(p, P, w, C)[0], C)),
        (ch07.check_walls, lambda p, v, width, n: ch07.walls(p, v, width / 2, n)),
        (ch07.check_room_map, lambda x, P, s, v, gate: ch07.room_map(x, P, s, v, 0.0)),
        (ch08.check_fuse, lambda prior, hints: ch08.fuse(0.5, hints)),
        (ch08.check_beam_evidence, lambda n, d, m, *s: ch08.beam_evidence(n, d, 20.0, *s)),
        (ch08.check_map_entropy, lambda log: ch08.map_entropy(log) * np.log(2)),
        (ch08.check_hits_needed, lambda p, prior, goal: ch08.hits_needed(p, 0.1, goal)),
        (ch08.check_insert, lambda o, p, r, a, *s: ch08.insert(o, p * [1, 1, 0], r, a, *s)),
        (ch04.check_sonar, lambda z, e, s, p, r: -0.5 * ((z - e) / s) ** 2),
        (ch04.check_particles_needed, lambda c, s, r: ch04.particles_needed(c, s, r / 2)),
        (ch04.check_resample, lambda x, w, *a: np.arange(len(x))),
        (ch04.check_renew, lambda x, w, *a: (x, w)),
        (ch04.check_best_place, lambda x, w, radius: (w @ x, 1.0)),
        (ch04.check_localize, lambda *a: ch04.localize(*a[:5], 0 * a[5], *a[6:])),
        (ch.check_jacobian, lambda p, q, m: ch.jacobian(p, q, m)[:, [0, 1, 2, 0, 1, 5, 6]]),
        (ch.check_add_landmark, lambda *a: np.diag(np.diag(ch.add_landmark(*a)))),
        (ch.check_wall, lambda p, w, L: np.abs(ch.observe_wall(p, w, L))),
        (ch.check_update, lambda m, P, z, i, R: (m, P)),
        (ch10.check_door_width, lambda m, P: (ch10.door_width(m, P)[0], np.trace(P))),
        (ch10.check_predict_cov, lambda P, F, Q: np.diag(np.diag(ch10.predict_cov(P, F, Q)))),
        (ch10.check_joined, lambda Phi1, Psi1, y1, Phi2, Psi2, y2: (Phi2 @ Phi1, Psi1, y1)),
        (ch10.check_leaked, lambda d, D, R: 20 * ch10.leaked(d, D, R)),
        (ch10.check_update, lambda m, P, first, *seen: ch10.update(m, P, m, *seen)),
        (ch10.check_slam, lambda P0, *given: ch10.slam(0.01 * P0, *given)),
        (ch11.check_gate, lambda share, pairs: ch11.gate_for(share, 1)),
        (ch11.check_nearest, lambda y, S, gates: -1),
        (ch11.check_one_by_one, lambda y, H, P, R: ch11.one_by_one(y, H, 0 * P, R)),
        (ch11.check_clear_pairs, lambda d, gate, m: np.where(d.min(1) < gate, d.argmin(1), -1)),
        (ch11.check_most_pairs, lambda d, gate: np.where(d.min(1) < gate, d.argmin(1), -1)),
        (ch11.check_together, lambda y, H, P, R, g: np.abs(y[..., 0]).argmin(1)),
        (ch12.check_weight, lambda p, m, Sigma, z, r: ch12.log_weight(p, m, 0 * Sigma, z, r)),
        (ch12.check_proposal, lambda x, Q, Hx, S, y: (x, Q)),
        (ch12.check_resample, lambda w, *parts: tuple(part.copy() for part in parts[:3])),
        (ch12.check_ancestors, lambda parents: [len(set(one)) for one in parents.tolist()]),
        (ch12.check_observe_landmark, lambda p, w, *rest: (w, *rest[:2])),
        (ch12.check_fast_slam, lambda s, o, n, *rest: ch12.fast_slam(s, o, 0 * n, *rest)),
        (ch13.check_line, lambda z, s, a, b, c, R: ch13.line(z, 0 * s + 1.0, a, b, c, R)),
        (ch13.check_range_edge, lambda i, j, a, r, s: ch13.range_edge(i, j, 0 * a, r, s)),
        (ch13.check_reverse, lambda z, cov: (ch13.reverse(z, cov)[0], np.linalg.inv(cov))),
        (ch13.check_narrowest, lambda e, Omega, w: ch13.narrowest(e, Omega, 1.0)),
        (ch13.check_one_width, lambda towns, widths: (*ch13.one_width(towns, widths)[:2], 7.0)),
        (ch13.check_map, lambda o, c, s: (ch13.map_of(o, c[:0], s)[0], np.zeros(len(c), bool))),
        (ch14.check_line_row, lambda p, s, n: ch14.line_row(p * [1, 1, 0], s, n)),
        (ch14.check_wall_shift, lambda gaps, width: np.mean(gaps)),
        (ch14.check_follow, lambda u, match, *far: ch14.follow(u, lambda i, k, g: g, *far)),
        (ch14.check_block_bounds, lambda f, cells, n, b: ch14.block_bounds(0.3 * f, cells, n, b)),
        (ch14.check_icp, lambda reference, normals, points, guess, cov: guess),
        (ch15.check_merged, lambda A, B, alpha, beta: (A.sum(0), B.sum(0))),
        (ch15.check_from_behind, lambda ended, sent, stretch: ended / sent),
        (ch15.check_branch, lambda parents, leaves, chosen: (parents, leaves[chosen])),
        (ch15.check_survivors, lambda parents, particles: parents >= 0),
        (ch15.check_weights, lambda a, b, c, z, L: ch15.weights(a, b, c[::-1], z, L)),
        (ch15.check_localize, lambda P, m, *more: ch15.localize(P, 0 * m, *more)),
        (ch16.check_ground_points, lambda z, r, p, h: ch16.ground_points(z, r, -p, h)),
        (ch16.check_direction_of_move, lambda a, b, R: ch16.direction_of_move(a, b, np.eye(3))),
        (ch16.check_next_range, lambda r, n, m, w, a, b: ch16.next_range(r, n, 0.0, w, a, b)),
        (ch16.check_range_update, lambda x, P, *a: (*ch16.range_update(x, P, *a)[:4], a[2])),
        (ch16.check_leave, lambda x, P, *a: (*ch16.leave(x, P, *a)[:2], x[:3], P[:3, :3])),
        (ch16.check_fly, lambda x, P, u, *a: ch16.fly(x, P, 0.9 * u, *a)),
        (ch17.check_smooth_fit, lambda p, slope: ch17.smooth_fit(p, -slope)),
        (ch17.check_bend, lambda c, tau, m: (ch17.bend(c, tau, m)[0], 0 * tau + m[0])),
        (ch17.check_steer, lambda pose, *a: ch17.steer(pose * [1, 1, -1], *a)),
        (ch17.check_gains, lambda v, ahead, zeta: (v / ahead, 2.0)),
        (ch17.check_remember, lambda p, h, tolerance: ch17.remember(p, h, 10 * tolerance)),
        (ch17.check_come_home, lambda p, h, back: ch17.come_home(p[::-1].copy(), h, back)),
        (ch18.check_free_turn, lambda p, half: ch18.free_turn(p, half)[::-1]),
        (ch18.check_swept, lambda p, half, step: np.hypot(*p.T) < step),
        (ch18.check_quarter_beams, lambda r, d, back: ch18.quarter_beams(r, d, back - 180)),
        (ch18.check_free_step, lambda p, half, margin: ch18.free_step(p, half, 0)),
        (ch18.check_frontier, lambda state: state == 1),
        (ch18.check_way, lambda state, cell: np.array([cell])),
        (ch19.check_same_signature, lambda scan, other: ch19.same_signature(other, scan)),
        (ch19.check_lost_beam, lambda scan, R: np.nanmean(scan)),
        (ch19.check_slide, lambda stored, scan: -ch19.slide(stored, scan)),
        (ch19.check_between_beams, lambda s: 2 * np.pi / len(s) * np.argmin(s)),
        (ch19.check_hypotheses, lambda p, m, gap, margin: ch19.hypotheses(p, m, gap, margin)[:2]),
        (ch19.check_locate, lambda p, s, a, d, n, *rest: ch19.locate(p, s, a, d, 1, *rest)),
        (ch20.check_retraced, lambda steps: -steps[::-1]),
        (ch20.check_next_goal, lambda d, a, h, b, r: ch20.next_goal(d, a, h, b, 0.5)),
        (ch20.check_relaid, lambda p, n, before, after: p + (after - before)[n]),
        (ch20.check_inside, lambda e, theta, P: ch20.inside(e, 0 * theta, P)),
        (ch20.check_runs_needed, lambda share, lost: ch20.runs_needed(share, 0)),
        (ch20.check_come_home, lambda r, s, m, way: ch20.come_home(r, s, m, "mixed")),
        (ch.check_slam, lambda u, dt, V, z, ids, R: ch.slam(u, 2 * dt, V, z, ids, R)),
    ],
)  # fmt: skip
def test_a_wrong_answer_looks_different(check, wrong):
    left, right = check.draw(wrong).axes
    a, b = drawn(left), drawn(right)
    assert a.shape != b.shape or not np.allclose(a, b, rtol=0, atol=0.01, equal_nan=True)


def raising(*arguments):
    raise KeyError("lost")


@pytest.mark.parametrize(
    ("student", "message"),
    [
        (lambda *arguments: None, "nothing returned yet"),
        (lambda *arguments: ..., "nothing returned yet"),
        (raising, "cannot be drawn: KeyError: 'lost'"),
        (lambda *arguments: "seven", "cannot be drawn: "),
        (lambda *arguments, missing: missing, "cannot be drawn: TypeError"),
    ],
)
def test_whatever_comes_is_told_and_never_raised(check, student, message):
    (text,) = texts(check.draw(student))
    assert text.startswith(message)


def test_a_number_is_told_where_an_array_is_expected(check):
    numbers = (
        ch01.check_measurements_needed,
        ch06.check_first_hit,
        ch06.check_nearest_wall,
        ch07.check_corner,
        ch18.check_free_step,
        ch19.check_lost_beam,
        ch19.check_between_beams,
        ch08.check_fuse,
        ch08.check_map_entropy,
        ch08.check_hits_needed,
        ch04.check_particles_needed,
        ch10.check_leaked,
        ch11.check_gate,
        ch14.check_wall_shift,
        ch12.check_weight,
        ch13.check_narrowest,
        ch15.check_from_behind,
        ch16.check_next_range,
        ch20.check_runs_needed,
    )
    told = [t for t in texts(check.draw(lambda *arguments: 7)) if t.startswith("cannot be drawn")]
    assert len(told) == (check not in numbers)


def test_numbers_that_are_none_are_drawn_or_told(check):
    nothing = check.draw(lambda *arguments: np.full((2, 2), np.nan))
    nothing.canvas.draw()


def test_a_function_that_changes_its_arguments_spoils_nothing():
    def spoiling(P, H_x, H_m, R):
        result = ch.add_landmark(P, H_x, H_m, R)
        P[:] = 0.0
        return result

    left, right = ch.check_add_landmark.draw(spoiling).axes
    np.testing.assert_array_equal(drawn(left), drawn(right))


def test_a_title_stands_below_that_of_the_panel_and_the_docstring_is_the_caption():
    def _one(x: float) -> float:
        return x

    def _drawn(ax, function):
        """Draw a way."""
        ax.set_title(f"{function(1.0):.1f} m")

    figure = Check(_one, "x", {"one": (1.0,)}, picture=_drawn).draw(lambda x: 2 * x)
    assert figure.get_supxlabel() == "A way."
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert titles == ["Yours\n2.0 m", "As it should be\n1.0 m"]


def test_an_exercise_without_a_picture_says_so():
    def _one(x: float) -> float:
        return x

    with pytest.raises(ValueError, match="draw: expected an exercise with a picture"):
        Check(_one, "x", {"one": (1.0,)}).draw(_one)
