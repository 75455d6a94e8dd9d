"""Right answers of chapter 11, written in other ways: each passes."""

import functools
import itertools

import numpy as np
import pytest
from scipy.stats import chi2

from slamlab.exercises import ch11_data_association as ch


def nearest_by_loop(y, S, gate):
    """Another right answer: one landmark after the other, by Cholesky."""
    best, row = gate, -1
    for number, (one, cov) in enumerate(zip(y, S, strict=True)):
        white = np.linalg.solve(np.linalg.cholesky(cov), one)
        if white @ white < best:
            best, row = white @ white, number
    return np.int64(row)


def by_sorting(distance, gate):
    """Another right answer: all pairs in order of their distance."""
    rows, taken = [-1] * len(distance), set()
    for flat in np.argsort(distance, axis=None):
        j, row = divmod(int(flat), distance.shape[1])
        if distance[j, row] < gate and rows[j] < 0 and row not in taken:
            rows[j] = row
            taken.add(row)
    return rows


def stacked_by_blocks(H, P, R):
    """Another right answer: block by block, as nested lists."""
    rows = [[a @ P @ b.T + (R if i == j else 0) for j, b in enumerate(H)] for i, a in enumerate(H)]
    return np.block(rows).tolist()


def together_by_all_pairings(y, H, P, R, gates):
    """Another right answer: every pairing there is, the best of those that fit."""
    k, n = y.shape[:2]

    @functools.cache
    def joint(pairs):
        v = np.concatenate([y[j, i] for j, i in pairs])
        S = np.array(stacked_by_blocks(H[[i for _, i in pairs]], P, R))
        return v @ np.linalg.inv(S) @ v

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
        (ch.check_stacked, stacked_by_blocks),
        (ch.check_together, together_by_all_pairings),
        (ch.check_nearest, nearest_by_loop),
        (ch.check_joint, lambda y, S: np.ravel(y) @ np.linalg.inv(S) @ np.ravel(y)),
        (ch.check_best_first, by_sorting),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
