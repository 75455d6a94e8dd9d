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
        moved[min(i + 1, n - 1)] += p_step * p
        moved[min(i + 2, n - 1)] += p_slip * p
    return moved


def by_library(belief, p_stay, p_step, p_slip):
    return histogram.predict(belief, [p_stay, p_step, p_slip], [0, 1, 2], circular=False)


def update_by_library(belief, doors, sees_door, p_door, p_wall):
    says_door = np.where(doors == 1, p_door, 1 - p_wall)
    return histogram.update(belief, says_door if sees_door else 1 - says_door)[0]


def wander_by_matrices(belief, doors, ways, shares, seen, eye):
    n, beliefs = len(belief), []
    right = np.zeros((n, n))
    for i in range(n):
        for places, share in enumerate(shares):
            right[min(i + places, n - 1), i] += share
    for way, saw in zip(ways, seen, strict=True):
        belief = (right if way > 0 else right[::-1, ::-1]) @ belief
        if saw >= 0:
            belief = update_by_library(belief, doors, saw, *eye)
        beliefs.append(belief.tolist())
    return beliefs


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_predict, by_loops),
        (ch.check_predict, by_library),
        (ch.check_update, update_by_library),
        (ch.check_wander, wander_by_matrices),
    ],
)
def test_right_answers_pass(check, answer):
    assert check(answer).passed
