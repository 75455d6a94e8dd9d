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


def by_counting(chance, sizes, reach):
    share, n = 1.0, 1
    for size, r in zip(sizes, reach, strict=True):
        share *= 2 * r / size
    while (1 - share) ** n > 1 - chance:
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


def renew_by_shares(x, weights, log_l, cell, per_cell, u):
    """Another right answer to the hunt: lists, the sum by `logsumexp`, the wheel."""
    log_w = np.array([math.log(w) if w else -math.inf for w in weights]) + log_l
    shares = np.exp(log_w - logsumexp(log_w))
    if (2 / len(x)) < (shares**2).sum():
        rows = resample_by_wheel(x, shares, cell, per_cell, u)
        return [x[i] for i in rows], [1 / len(rows)] * len(rows)
    return x.tolist(), shares


def by_loop(x, weights, radius):
    best = (0.0, 0.0)
    for here in x:
        pairs = [(w, y) for w, y in zip(weights, x, strict=True) if abs(y - here) <= radius]
        share = sum(w for w, _ in pairs)
        if share > best[1]:
            best = sum(w * y for w, y in pairs) / share, share
    return best


def in_logarithms(
    start, length, chance, radius, moves, noise, echoes, beacons, sonar, per_cell, u
):
    x = start[: by_counting(chance, [length], [radius])]
    log_w = np.zeros(len(x))
    for k in range(len(moves)):
        x = x + moves[k] + noise[k][: len(x)]
        expected = np.min([abs(x - beacon) for beacon in beacons], axis=0)
        log_w = log_w + np.asarray(by_logaddexp(echoes[k], expected, *sonar))
        log_w = log_w - logsumexp(log_w)
        if logsumexp(2 * log_w) > math.log(2 / len(x)):
            x = x[resample_by_wheel(x, np.exp(log_w), radius, per_cell, u[k])]
            log_w = np.full(len(x), -math.log(len(x)))
    return *by_loop(x, np.exp(log_w), radius), x, np.exp(log_w)


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_sonar, by_logaddexp),
        (ch.check_particles_needed, by_counting),
        (
            ch.check_particles_needed,
            lambda chance, sizes, reach: math.ceil(
                math.log1p(-chance) / math.log1p(-math.prod(2 * reach) / math.prod(sizes))
            ),
        ),
        (ch.check_resample, resample_by_wheel),
        (ch.check_renew, renew_by_shares),
        (ch.check_best_place, by_loop),
        (ch.check_localize, in_logarithms),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


@pytest.mark.parametrize("turned", [False, True])
def test_the_program_with_the_bug_reports_the_first_particle_of_the_list(turned):
    """Which end of the corridor is reported depends on the order of the particles."""
    wrong = ch.check_renew.mistaken(next(iter(ch.check_renew.mistakes.values())))
    places = np.linspace(0, 28, 200)[:: -1 if turned else 1]
    log_l = ch.sonar_log_likelihood(0.5, np.abs(places - 14), 0.2, 0.8, 5.0)
    left, _ = wrong(places, np.full(200, 1 / 200), log_l, 0.5, 20, 0.5)
    assert np.abs(left - places[0]).max() < 6


def half_of_the_first(
    start, length, chance, radius, moves, noise, echoes, beacons, sonar, per_cell, u, plain
):
    n = by_counting(chance, [length], [radius])
    x, weights = start[:n], np.full(n, 1 / n)
    for k, (move, slip) in enumerate(zip(moves, noise, strict=True)):
        x = x + move + slip[: len(x)]
        expected = np.abs(x[:, None] - beacons).min(axis=1)
        log_l = ch.sonar_log_likelihood(echoes[k], expected, *sonar)
        weights = weights * np.exp(log_l) if plain else np.exp(np.log(weights) + log_l)
        weights = weights / weights.sum()
        if 1 / np.sum(weights**2) < n / 2:
            x = x[ch.resample(x, weights, radius, per_cell, u[k])]
            weights = np.full(len(x), 1 / len(x))
    return *ch.best_place(x, weights, radius), x, weights


@pytest.mark.parametrize("plain", [False, True])
def test_half_of_the_first_number_is_named_with_products_and_with_logarithms(plain):
    report = ch.check_localize(lambda *given: half_of_the_first(*given, plain))
    assert any("half of the first number" in message for message in report.messages), report


def test_half_a_repair_finds_the_robots_and_is_told_apart_by_how_often_it_resamples():
    sentence = "the effective number was taken of weights that do not sum to one"
    half = ch.check_renew.mistaken(ch.check_renew.mistakes[sentence])
    left, right = (ax.get_title(loc="left") for ax in ch.check_renew.draw(half).axes)
    assert "40 of 40" in left
    assert "40 of 40" in right
    assert "100% of readings" in left
    assert "30% of readings" in right
