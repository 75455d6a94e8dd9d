"""Precision and recall of maps of walls."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamlab.evaluation.wall_maps import line_errors, seen_lengths, wall_scores

ROOM = np.array([[[0, 0], [4, 0]], [[4, 0], [4, 3]], [[4, 3], [0, 3]], [[0, 3], [0, 0]]], float)


def test_the_true_map_scores_one_in_both_directions():
    for map_ in (ROOM, ROOM[:, ::-1]):
        scores = wall_scores(map_, ROOM)
        assert scores.precision == 1.0
        np.testing.assert_allclose(scores.covered, 1.0)
        assert scores.recall(np.ones(4, bool)) == 1.0


def test_a_ghost_costs_precision_and_a_gap_recall():
    scores = wall_scores([ROOM[0], ROOM[1], [[1, 1], [2, 2]]], ROOM)
    assert scores.true.tolist() == [True, True, False]
    assert scores.recall(np.ones(4, bool)) == 0.5
    assert scores.recall([True, True, False, False]) == 1.0


def test_a_stretch_round_a_corner_or_beyond_an_end_is_no_wall():
    assert not wall_scores([[[3, 0], [4, 1]]], ROOM).true[0]
    assert not wall_scores([[[2, 0], [4.5, 0]]], ROOM).true[0]
    assert wall_scores([[[2, 0], [4.05, 0]]], ROOM).true[0]


def test_overlapping_stretches_count_once():
    twice = [[[0, 0], [2, 0]], [[1, 0], [3, 0]], [[0.5, 0], [1, 0]]]
    assert wall_scores(twice, ROOM).covered[0] == pytest.approx(0.75)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.lists(st.tuples(st.floats(0, 4), st.floats(0, 4)), max_size=6))
def test_covered_equals_a_fine_count(spans):
    found = np.array([[[a, 0], [b, 0]] for a, b in spans]).reshape(-1, 2, 2)
    grid = (np.arange(4000) + 0.5) / 1000
    inside = np.zeros(4000, bool)
    for a, b in spans:
        inside |= (grid >= min(a, b)) & (grid <= max(a, b))
    assert wall_scores(found, ROOM).covered[0] == pytest.approx(inside.mean(), abs=2e-3)


def test_an_empty_map_is_never_wrong_and_finds_nothing():
    scores = wall_scores(np.empty((0, 2, 2)), ROOM)
    assert scores.precision == 1.0
    assert scores.recall(np.ones(4, bool)) == 0.0
    assert scores.recall(np.zeros(4, bool)) == 1.0


def test_seen_lengths_span_the_points_met():
    points = [[1, 0.01], [3, -0.01], [4.01, 1], [2, 1.5], [np.nan, np.nan]]
    np.testing.assert_allclose(seen_lengths(points, ROOM), [2, 0, 0, 0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((2, 2)), ROOM), "found"),
        ((ROOM, ROOM[0]), "walls"),
        ((ROOM, np.zeros((1, 2, 2))), "walls"),
        ((ROOM, ROOM, -1.0), "tolerance"),
        ((ROOM * np.nan, ROOM), "found"),
    ],
)
def test_bad_input_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        wall_scores(*arguments)


def test_a_line_is_held_against_the_nearest_wall_under_either_name():
    truth = [[0.0, 0.5 * np.pi], [4.0, 0.0], [3.0, 0.5 * np.pi], [0.0, 0.0]]
    np.testing.assert_allclose(line_errors(truth, ROOM), 0, atol=1e-12)
    other = [[-4.0, np.pi], [-3.0, -0.5 * np.pi]]
    np.testing.assert_allclose(line_errors(other, ROOM[:, ::-1]), 0, atol=1e-12)
    np.testing.assert_allclose(line_errors([[3.9, 0.02]], ROOM), [[-0.1, 0.02]], atol=1e-12)
    # Of the other name the error of r has the other sign.
    np.testing.assert_allclose(line_errors([[-3.9, np.pi]], ROOM), [[0.1, 0.0]], atol=1e-12)
    assert line_errors(np.empty((0, 2)), ROOM).shape == (0, 2)
