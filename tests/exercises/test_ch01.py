"""Right answers of chapter 01, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.exercises import ch01_bayes_filter as ch
from slamlab.filters import histogram


def by_loops(belief, p_stay, p_step, p_slip):
    n = len(belief)
    moved = [0.0] * n
    for i, p in enumerate(belief):
        moved[i] += p_stay * p
        moved[(i + 1) % n] += p_step * p
        moved[(i + 2) % n] += p_slip * p
    return moved


def by_library(belief, p_stay, p_step, p_slip):
    return histogram.predict(belief, [p_stay, p_step, p_slip], [0, 1, 2])


def update_by_library(belief, doors, sees_door, p_right):
    return histogram.update(belief, np.where(doors == sees_door, p_right, 1 - p_right))[0]


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_predict, by_loops),
        (ch.check_predict, by_library),
        (ch.check_update, update_by_library),
    ],
)
def test_right_answers_pass(check, answer):
    assert check(answer).passed
