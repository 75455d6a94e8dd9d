"""Right answers of chapter 04, written in other ways: each passes."""

import math

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm

from slamlab.exercises import ch04_particle_filter as ch


def by_logaddexp(echo, expected, sigma, p_hit, reach):
    with np.errstate(divide="ignore"):
        good = np.log(p_hit) + norm.logpdf(echo, expected, sigma)
    return np.logaddexp(good, np.log((1 - p_hit) / reach)).tolist()


def by_counting(chance, area, reach, turn):
    n = 1
    while (1 - math.pi * reach**2 / area * turn / math.pi) ** n > 1 - chance:
        n += 1
    return n


def by_wheel(weights, n, u):
    """Walk along the comb."""
    indices, end, i = [], weights[0], 0
    for tooth in range(n):
        while i < len(weights) - 1 and (tooth + u) / n >= end:
            i += 1
            end += weights[i]
        indices.append(i)
    return indices


def resample_by_wheel(x, weights, cell, per_cell, u):
    cells = {math.floor(x[i] / cell) for i in by_wheel(weights, len(x), u)}
    return by_wheel(weights, per_cell * len(cells), u)


def about_the_first(poses, weights):
    """Means of directions differ for wide clouds that are not alike on both sides."""
    first = poses[np.argmax(weights), 2]
    turn = weights @ ((poses[:, 2] - first + np.pi) % (2 * np.pi) - np.pi)
    return [*(weights @ poses[:, :2]), (first + turn + np.pi) % (2 * np.pi) - np.pi]


def by_loop(x, weights, radius):
    best = (0.0, 0.0)
    for here in x:
        pairs = [(w, y) for w, y in zip(weights, x, strict=True) if abs(y - here) <= radius]
        share = sum(w for w, _ in pairs)
        if share > best[1]:
            best = sum(w * y for w, y in pairs) / share, share
    return best


def in_logarithms(x, moves, noise, echoes, beacons, sonar, cell, per_cell, u):
    log_w = np.zeros(len(x))
    for k in range(len(moves)):
        x = x + moves[k] + noise[k][: len(x)]
        expected = np.min([abs(x - beacon) for beacon in beacons], axis=0)
        log_w = log_w + np.asarray(by_logaddexp(echoes[k], expected, *sonar))
        log_w = log_w - logsumexp(log_w)
        if logsumexp(2 * log_w) > math.log(2 / len(x)):
            x = x[resample_by_wheel(x, np.exp(log_w), cell, per_cell, u[k])]
            log_w = np.full(len(x), -math.log(len(x)))
    return x, np.exp(log_w)


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_sonar, by_logaddexp),
        (ch.check_particles_needed, by_counting),
        (
            ch.check_particles_needed,
            lambda chance, area, reach, turn: math.ceil(
                math.log1p(-chance) / math.log1p(-(reach**2) * turn / area)
            ),
        ),
        (ch.check_resample, resample_by_wheel),
        (ch.check_mean_pose, about_the_first),
        (ch.check_best_place, by_loop),
        (ch.check_localize, in_logarithms),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
