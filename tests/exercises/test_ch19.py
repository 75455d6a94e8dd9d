"""Right answers of chapter 19, written in other ways: each passes."""

import math

import numpy as np
import pytest

from slamlab.exercises import ch19_autocorrelation_localization as ch
from slamlab.localization import signature


def by_rolling(scan):
    return [float(np.sum(scan * np.roll(scan, tau))) for tau in range(len(scan))]


def by_index(scan):
    j = np.arange(len(scan))
    return scan[(j[:, None] - j) % len(scan)].T @ scan


def turn_by_differences(before, after):
    """Another right answer: the shift with the least sum of squares."""
    N = len(before)
    m = min(range(N), key=lambda m: ((np.roll(before, -m) - after) ** 2).sum())
    return math.remainder(m * 2 * math.pi / N, 2 * math.pi)


def second_by_sorting(places, misfits, separation):
    order = np.argsort(misfits)
    best = order[0]
    for row in order[1:]:
        if math.dist(places[row], places[best]) > separation:
            return [best, row, misfits[row] - misfits[best]]
    raise AssertionError


def beams_by_trying(sigma):
    n = 1
    while 2 * math.pi / n / 12**0.5 > sigma:
        n += 1
    return n


def top_of_a_fitted_parabola(R):
    """Another right answer: three points by polyfit, the ring turned so that none is at an end."""
    m = int(np.argmax(R))
    a, b, _ = np.polyfit([-1, 0, 1], np.roll(R, 1 - m)[:3], 2)
    return math.remainder((m - b / (2 * a)) * 2 * math.pi / len(R), 2 * math.pi)


def locate_by_loops(places, scans, scan, nearest, separation):
    """Another right answer: the least misfit over all turns is that of the best correlation."""
    own = np.abs(np.fft.fft(scan))[:8] if len(scan) > 14 else np.abs(np.fft.rfft(scan))[:8]
    rank = []
    for row, one in enumerate(scans):
        theirs = np.abs(np.fft.fft(one))[:8] if len(scan) > 14 else np.abs(np.fft.rfft(one))[:8]
        rank.append((float(np.sum((theirs - own) ** 2)), row))
    found = []
    for _, row in sorted(rank)[:nearest]:
        heading = turn_by_differences(scans[row], scan)
        m = round(heading * len(scan) / (2 * math.pi))
        turned = [scans[row][(j + m) % len(scan)] for j in range(len(scan))]
        misfit = sum(abs(a - b) for a, b in zip(turned, scan, strict=True)) / len(scan)
        found.append((misfit, row, heading))
    found.sort()
    misfit, best, heading = found[0]
    others = [f[0] for f in found if math.dist(places[f[1]], places[best]) > separation]
    return [*places[best], heading], min(others, default=math.inf) - misfit


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_beams, beams_by_trying),
        (ch.check_refined, top_of_a_fitted_parabola),
        (ch.check_locate, locate_by_loops),
        (ch.check_autocorrelation, by_rolling),
        (ch.check_autocorrelation, by_index),
        (ch.check_autocorrelation, signature.autocorrelation),
        (ch.check_turn, turn_by_differences),
        (ch.check_second_best, second_by_sorting),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
