"""Right answers of chapter 08, written in other ways: each passes."""

import numpy as np
import pytest
from scipy.special import expit, logit, xlogy

from slamlab.exercises import ch08_occupancy_maps as ch
from slamlab.logs import ScanGeometry
from slamlab.mapping import OccupancyGrid


def by_bayes(prior, hints):
    """Another right answer: turn each hint into a likelihood ratio and apply Bayes' rule."""
    p = float(prior)
    for hint in hints:
        ratio = hint / (1 - hint) * (1 - prior) / prior
        p = ratio * p / (ratio * p + 1 - p)
    return p


def by_the_library(n_cells, distance, max_range, hit, miss):
    grid = OccupancyGrid((1, n_cells), 1.0, p_hit=expit(hit), p_miss=expit(miss), grow=False)
    grid.insert([0.0, 0.5, 0.0], [distance], ScanGeometry([0.0], max_range=max_range))
    # The library frees the cell in which max_range lies, of which the beam saw the first point.
    if not distance < max_range and not np.isnan(distance):
        grid.log_odds[0, int(max_range) :] = 0.0
    return grid.log_odds[0]


def by_loop(n_cells, distance, max_range, hit, miss):
    return [
        0.0 if np.isnan(distance) or i + 1 > max_range else miss if i + 1 <= distance
        else hit if i <= distance < max_range else 0.0
        for i in range(n_cells)
    ]  # fmt: skip


def entropy_by_xlogy(log_odds):
    p = expit(np.asarray(log_odds))
    return -(xlogy(p, p) + xlogy(1 - p, 1 - p)).sum() / np.log(2)


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_fuse, by_bayes),
        (ch.check_fuse, lambda p, h: expit(logit(p) * (1 - len(h)) + logit(h).sum())),
        (ch.check_beam_evidence, by_loop),
        (ch.check_beam_evidence, by_the_library),
        (ch.check_map_entropy, entropy_by_xlogy),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
