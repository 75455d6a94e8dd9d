"""Right answers of chapter 17, written in other ways: each passes."""

import math

import numpy as np
import pytest

from slamlab.exercises import ch17_the_way_home as ch


def polygon(points):
    t = [0.0]
    for a, b in zip(points[:-1].tolist(), points[1:].tolist(), strict=True):
        t.append(t[-1] + math.dist(a, b))
    return np.array(t)


def smooth_by_multipliers(points, slope):
    """Another right answer: least squares with Lagrange multipliers."""
    t = polygon(points)
    if len(points) == 2:
        c1 = slope * t[-1]
        return [points[0], c1, points[1] - points[0] - c1, [0.0, 0.0]]
    A = np.vander(t / t[-1], 4, increasing=True)
    C = np.vstack([A[[0, -1]], [0, 1, 0, 0]])
    left = np.block([[A.T @ A, C.T], [C, np.zeros((3, 3))]])
    right = np.vstack([A.T @ points, points[[0, -1]], slope * t[-1]])
    return np.linalg.lstsq(left, right, rcond=None)[0][:4].tolist()


def smooth_in_metres(points, slope):
    """Another right answer: powers of t, scaled at the end."""
    t, n = polygon(points), len(points)
    chord = points[-1] - points[0]
    parabola = points[0] + np.outer(t, slope) + np.outer(t**2, chord / t[-1] ** 2 - slope / t[-1])
    bump = t**2 * (t[-1] - t)
    mu = np.linalg.lstsq(bump[:, None], points - parabola, rcond=None)[0][0] * (n > 2)
    c = [points[0], slope, chord / t[-1] ** 2 - slope / t[-1] + mu * t[-1], -mu]
    return [one * t[-1] ** k for k, one in enumerate(c)]


def bend_by_complex_numbers(c, tau, limits):
    """Another right answer: x + i y; the speeds one by one."""
    z = np.polynomial.Polynomial(c @ [1, 1j])
    first, second = z.deriv(1)(tau), z.deriv(2)(tau)
    kappa = np.imag(np.conj(first) * second) / np.abs(first) ** 3
    v = [limits[0] if abs(k) * limits[0] <= limits[1] else limits[1] / abs(k) for k in kappa]
    return kappa.tolist(), v


def bend_by_division(c, tau, limits):
    """Another right answer: divides by zero on a straight line, where infinity is right."""
    t = tau[:, None]
    d, dd = c[1] + 2 * c[2] * t + 3 * c[3] * t**2, 2 * c[2] + 6 * c[3] * t
    kappa = (d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0]) / (d**2).sum(1) ** 1.5
    return kappa, np.minimum(limits[0], limits[1] / np.abs(kappa))


def steer_by_complex_numbers(pose, point, gains, limits):
    """Another right answer: the angle of a quotient of complex numbers is wrapped already."""
    way = complex(*(point - pose[:2])) / complex(math.cos(pose[2]), math.sin(pose[2]))
    alpha, sign = math.atan2(way.imag, way.real), 1
    if abs(alpha) > math.pi / 2:
        alpha, sign = math.atan2(-way.imag, -way.real), -1
    turn = gains[1] * alpha
    return [
        sign * min(gains[0] * abs(way), limits[0]),
        math.copysign(min(abs(turn), limits[1]), turn),
    ]


def steer_wrapped_twice(pose, point, gains, limits):
    x, y = point - pose[:2]
    alpha = (math.atan2(y, x) - pose[2] + math.pi) % (2 * math.pi) - math.pi
    v = min(gains[0] * math.hypot(x, y), limits[0])
    if abs(alpha) > math.pi / 2:
        v, alpha = -v, (alpha - math.pi + math.pi) % (2 * math.pi) - math.pi
    return v, np.clip(gains[1] * alpha, -limits[1], limits[1])


def remember_by_runs(points, heading, tolerance):
    """Another right answer: runs as lists, the newest point put back when it breaks the fit."""
    fit = ch.check_smooth_fit.reference
    cubics, run, slope = [], [points[0]], np.array([math.cos(heading), math.sin(heading)])
    for new in points[1:]:
        tried = np.array([*run, new])
        c, t = fit(tried, slope), polygon(tried)
        curve = np.polynomial.polynomial.polyval(t / t[-1], c).T
        if len(run) > 1 and max(map(math.dist, curve, tried)) > tolerance:
            cubics.append(fit(np.array(run), slope))
            slope = np.arange(4) @ cubics[-1] / polygon(np.array(run))[-1]
            run = run[-1:]
        run.append(new)
    return [*cubics, fit(np.array(run), slope)]


def home_by_interpolation(points, heading, turn_back):
    """Another right answer: a way with a point each 5 mm, start last."""
    cubics = np.array(remember_by_runs(points, heading, 0.05))
    pose, move = turn_back(cubics.tolist())
    fine = np.linspace(0, 1, 200)[:, None] ** np.arange(4) @ cubics
    way = fine.reshape(-1, 2)
    s = polygon(way)
    at = np.linspace(s[-1], 0, int(s[-1] / 0.005) + 2)
    way = np.stack([np.interp(at, s, way[:, 0]), np.interp(at, s, way[:, 1])], 1)
    k, trail = 0, [np.array(pose)]
    while at[k] > 0.03:
        window = slice(k, k + 60)
        k += int(np.hypot(*(way[window] - trail[-1][:2]).T).argmin())
        ahead = way[min(k + 30, len(way) - 1)]
        law = np.array([0.2 / 0.15, 4 * 0.2 / 0.15]), np.array([0.2, 1.5])
        dx, dy, turn = move(*steer_by_complex_numbers(trail[-1], ahead, *law))
        c, s_ = math.cos(trail[-1][2]), math.sin(trail[-1][2])
        x, y, theta = trail[-1]
        trail.append(np.array([x + c * dx - s_ * dy, y + s_ * dx + c * dy, theta + turn]))
    return trail


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_smooth_fit, smooth_by_multipliers),
        (ch.check_smooth_fit, smooth_in_metres),
        (ch.check_bend, bend_by_complex_numbers),
        (ch.check_bend, bend_by_division),
        (ch.check_steer, steer_by_complex_numbers),
        (ch.check_steer, steer_wrapped_twice),
        (ch.check_gains, lambda v, L, zeta: [v / L, (2 * zeta) ** 2 * v / L]),
        (ch.check_remember, remember_by_runs),
        (ch.check_come_home, home_by_interpolation),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


@pytest.mark.parametrize("back", [11, 61])
def test_the_nearest_point_may_be_sought_a_little_to_the_other_side(back):
    wider = f"way[low : near + 1] => way[low : near + {back}]"
    assert ch.check_come_home(ch.check_come_home.mistaken(wider)).passed


def test_a_copy_of_the_points_is_no_memory():
    """The robot keeps cubics, and drives along its points all the same."""

    def copied(points, heading, turn_back):
        cubics, points = ch.remember(points, heading, 0.05), points.copy()
        return ch.come_home(points, heading, lambda _: turn_back(cubics))

    def along_the_points(points, heading, turn_back):
        copy = points.copy()
        pose, move = turn_back(ch.remember(points, heading, 0.05))
        s, near, believed = polygon(copy), len(copy) - 1, [pose]
        while s[near] > 0.03:
            low = np.searchsorted(s, s[near] - 0.3)
            near = low + np.hypot(*(copy[low : near + 1] - believed[-1][:2]).T).argmin()
            ahead = copy[np.searchsorted(s, s[near] - 0.15)]
            law = ch.gains(0.2, 0.15, 1.0), (0.2, 1.5)
            believed.append(ch.compose(believed[-1], move(*ch.steer(believed[-1], ahead, *law))))
        return np.array(believed)

    assert ch.check_come_home(copied).passed
    report = ch.check_come_home(along_the_points)
    assert not report.passed
    assert "drives elsewhere, up to" in report.text


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        ("gains(0.2, 0.15, 1.0) => (1.3, 2.2)", "exercise 4's gains drives elsewhere, up to"),
        ("turn_back(cubics) => turn_back(cubics + 0.001)", "not keep the cubics of `remember`"),
        ("remember(points, heading, 0.05) => _pieces(points, heading, 0.05)", "`remember`"),
    ],
)
def test_other_gains_and_other_cubics_are_told_as_what_they_are(edit, said):
    report = ch.check_come_home(ch.check_come_home.mistaken(edit))
    assert not report.passed
    assert said in report.text
