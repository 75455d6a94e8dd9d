"""Right answers of chapter 17, written in other ways: each passes."""

import math

import numpy as np
import pytest

from slamlab.exercises import ch17_the_way_home as ch
from slamlab.navigation import fit_cubic
from slamlab.navigation.cubic import Cubic


def by_library(t, points):
    return fit_cubic(t, points, points[0], points[-1]).coefficients


def by_multipliers(t, points):
    """Another right answer: least squares with Lagrange multipliers."""
    A = np.vander((t - t[0]) / (t[-1] - t[0]), 4, increasing=True)
    C = A[[0, -1]]
    left = np.block([[A.T @ A, C.T], [C, np.zeros((2, 2))]])
    return np.linalg.solve(left, np.vstack([A.T @ points, points[[0, -1]]]))[:4].tolist()


def by_elimination(t, points):
    """P3's own elimination, with the typo repaired, in tau: t0 = 0, t1 = 1."""
    tau = ((t - t[0]) / (t[-1] - t[0]))[:, None]
    due = -points + tau * (points[-1] - points[0]) + points[0]
    shapes = np.hstack([-(tau**3) + tau, -(tau**2) + tau])
    a3, a2 = np.linalg.lstsq(shapes, due, rcond=None)[0]
    return [points[0], points[-1] - points[0] - a3 - a2, a2, a3]


def loop_by_library(c):
    found = Cubic(c).self_crossing()
    return (np.nan, np.nan) if found is None else found


def loop_by_cramer(c):
    (a1, b1), (a2, b2), (a3, b3) = c[1:]
    det = a2 * b3 - a3 * b2
    sigma, w = (a3 * b1 - a1 * b3) / det, (a1 * b2 - a2 * b1) / det
    product = sigma**2 - w
    roots = np.roots([1, -sigma, product])
    if np.iscomplex(roots).any() or roots.min() < 0 or roots.max() > 1:
        return [float("nan")] * 2
    return sorted(roots.real)


def steer_by_complex_numbers(pose, point, gains, limits):
    """Another right answer: the angle of a quotient of complex numbers is wrapped already."""
    way = complex(*(point - pose[:2])) / complex(math.cos(pose[2]), math.sin(pose[2]))
    turn = gains[1] * math.atan2(way.imag, way.real)
    return [min(gains[0] * abs(way), limits[0]), math.copysign(min(abs(turn), limits[1]), turn)]


def remember_by_halving(points, tolerance):
    """Another right answer: runs as lists, the newest point put back when it breaks the fit."""
    t = [0.0]
    for a, b in zip(points[:-1].tolist(), points[1:].tolist(), strict=True):
        t.append(t[-1] + math.dist(a, b))
    cubics, run = [], [0]
    for new in range(1, len(points)):
        if len(run) > 2:
            c = by_multipliers(np.array([t[k] for k in [*run, new]]), points[[*run, new]])
            tau = (np.array([t[k] for k in [*run, new]]) - t[run[0]]) / (t[new] - t[run[0]])
            curve = np.polynomial.polynomial.polyval(tau, np.array(c)).T
            if max(map(math.dist, curve, points[[*run, new]])) > tolerance:
                cubics.append(ch.check_fit.reference(np.array([t[k] for k in run]), points[run]))
                run = run[-1:]
        run.append(new)
    return [*cubics, ch.check_fit.reference(np.array([t[k] for k in run]), points[run])]


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_steer, steer_by_complex_numbers),
        (ch.check_remember, remember_by_halving),
        (ch.check_fit, by_library),
        (ch.check_fit, by_multipliers),
        (ch.check_fit, by_elimination),
        (ch.check_loop, loop_by_library),
        (ch.check_loop, loop_by_cramer),
        (ch.check_tune, lambda: [1.5, 2.5, 0.12]),
        (ch.check_tune, lambda: np.array([1.2, 3.0, 0.18])),
        (ch.check_tune, lambda: (0.8, 1.8, 0.2)),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
