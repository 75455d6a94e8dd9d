"""Right answers of chapter 11, written in other ways: each passes."""

import functools
import itertools

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

from slamlab.exercises import ch11_data_association as ch


def nearest_by_cases(y, S, gates):
    """Another right answer: one landmark after the other, each kind of measurement by itself."""
    best, row = np.inf, -1
    for number, (one, cov) in enumerate(zip(y, S, strict=True)):
        there = [k for k in (0, 1) if not np.isnan(one[k])]
        if len(there) == 1:
            d2 = one[there[0]] ** 2 / cov[there[0], there[0]]
        else:
            white = np.linalg.solve(np.linalg.cholesky(cov), one)
            d2 = white @ white
        if there and d2 < min(best, gates[len(there) - 1]):
            best, row = d2, number
    return np.int64(row)


def stacked_distance(y, H, P, R):
    A = np.concatenate(list(H)) if len(H) else np.zeros((0, len(P)))
    S = A @ P @ A.T + np.kron(np.eye(len(H)), R)
    return np.ravel(y) @ np.linalg.inv(S) @ np.ravel(y)


def by_differences(y, H, P, R):
    """Another right answer: by how much each pair raises the joint distance."""
    joint = [0.0] + [stacked_distance(y[: m + 1], H[: m + 1], P, R) for m in range(len(y))]
    return [b - a for a, b in itertools.pairwise(joint)]


def by_the_factor(y, H, P, R):
    """Another right answer: the Cholesky factor whitens pair by pair."""
    A = H.reshape(-1, H.shape[2])
    L = np.linalg.cholesky(A @ P @ A.T + np.kron(np.eye(len(H)), R))
    return (np.linalg.solve(L, y.ravel()).reshape(-1, 2) ** 2).sum(1)


def by_second_smallest(distance, gate, margin):
    """Another right answer: the smallest and the second smallest of each row and column."""
    k, n = distance.shape
    wide = np.pad(distance, ((0, 1), (0, 1)), constant_values=np.inf)
    rows = [-1] * k
    for j in range(k):
        i = int(wide[j].argmin())
        if i == n or not distance[j, i] < gate or wide[:, i].argmin() != j:
            continue
        second = min(np.sort(wide[j])[1], np.sort(wide[:, i])[1])
        if second >= distance[j, i] + margin:
            rows[j] = i
    return rows


def most_by_all_pairings(distance, gate):
    """Another right answer: every pairing there is."""
    k, n = distance.shape
    best = (0, 0.0, [-1] * k)
    for rows in itertools.product(range(-1, n), repeat=k):
        pairs = [(j, i) for j, i in enumerate(rows) if i >= 0]
        nothing_twice = len({i for _, i in pairs}) == len(pairs)
        if nothing_twice and all(distance[pair] < gate for pair in pairs):
            total = sum(distance[pair] for pair in pairs)
            best = max(best, (len(pairs), -total, list(rows)), key=lambda b: b[:2])
    return best[2]


def most_by_assignment(distance, gate):
    """Another right answer: the Hungarian method, with a high price for no pair."""
    inside = distance < gate
    rows = np.full(len(distance), -1)
    for j, i in zip(*linear_sum_assignment(np.where(inside, distance, 1e6)), strict=True):
        if inside[j, i]:
            rows[j] = i
    return rows


def together_by_all_pairings(y, H, P, R, gates):
    """Another right answer: every pairing there is, the best of those that are allowed."""
    k, n = y.shape[:2]

    @functools.cache
    def joint(pairs):
        js, rows = [j for j, _ in pairs], [i for _, i in pairs]
        return stacked_distance(y[js, rows], H[rows], P, R)

    best = (0, 0.0, [-1] * k)
    for rows in itertools.product(range(-1, n), repeat=k):
        pairs = tuple((j, i) for j, i in enumerate(rows) if i >= 0)
        if not pairs or len({i for _, i in pairs}) < len(pairs):
            continue
        if all(joint(pairs[: m + 1]) < gates[m] for m in range(len(pairs))):
            best = max(best, (len(pairs), -joint(pairs), list(rows)), key=lambda b: b[:2])
    return best[2]


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_gate, lambda share, pairs: chi2.ppf(share ** (1 / pairs), 2)),
        (ch.check_gate, lambda share, pairs: np.log((1 - share ** (1 / pairs)) ** -2)),
        (ch.check_nearest, nearest_by_cases),
        (ch.check_one_by_one, by_differences),
        (ch.check_one_by_one, by_the_factor),
        (ch.check_clear_pairs, by_second_smallest),
        (ch.check_most_pairs, most_by_all_pairings),
        (ch.check_most_pairs, most_by_assignment),
        (ch.check_together, together_by_all_pairings),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def test_a_lap_of_the_lesson_ends_at_home_with_joint_pairs_and_not_with_the_nearest():
    _, right, made, off = ch.lap_of_lesson(ch.together)
    assert right > 0.9 * made
    assert off < 0.1
    figure = ch.draw_lap(lambda *given: None)
    left, nearest = figure.axes
    assert left.texts[0].get_text() == "nothing returned yet"
    title = nearest.get_title(loc="left") or nearest.get_title()
    assert title.startswith("Nearest neighbour")
    assert "0.39 m off" in title


def test_a_search_that_gives_all_trees_back_gives_one_to_two_measurements():
    """It is another repair of the hunt, and a test by name refuses it."""
    wrong = ch.check_most_pairs.mistaken("taken[i] = False => taken[:] = False")
    held = {row.name: row.ok for row in ch.check_most_pairs(wrong).rows}
    assert not held["a tree that a measurement before has taken stays taken"]
    assert held["the first must leave its nearest tree"]
    np.testing.assert_array_equal(wrong(np.array([[30.0, 1.0], [5.0, 2.0]]), 9.0), [1, 1])


def test_the_sets_of_the_page_are_allowed_and_not():
    """Pairs of the distances 4, 8, 3 and 10, 1, 1, one after the other."""
    gates = np.array([9.2, 13.3, 16.8])
    for steps, allowed in (([4.0, 8.0, 3.0], True), ([10.0, 1.0, 1.0], False)):
        y = np.full((3, 3, 2), 30.0)
        y[range(3), range(3)] = np.column_stack([np.sqrt(steps), np.zeros(3)])
        rows = ch.together(y, np.zeros((3, 2, 3)), np.eye(3), np.eye(2), gates)
        assert bool((rows == [0, 1, 2]).all()) is allowed
