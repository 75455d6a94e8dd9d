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


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_autocorrelation, by_rolling),
        (ch.check_autocorrelation, by_index),
        (ch.check_autocorrelation, signature.autocorrelation),
        (ch.check_turn, turn_by_differences),
        (ch.check_second_best, second_by_sorting),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
