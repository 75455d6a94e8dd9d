"""Bayes filter on a grid: equal to the enumeration of all histories, wrong forms fail."""

import itertools

import numpy as np
import pytest

from slamlab.filters import histogram

RNG = np.random.default_rng(3)
BELIEF = RNG.dirichlet(np.ones(5))
KERNEL, OFFSETS = np.array([0.1, 0.7, 0.2]), np.array([0, 1, 2])
LIKELIHOODS = RNG.uniform(0.1, 1.0, (3, 5))


def enumerated(belief, likelihoods):
    """P(x_k | z_1..k) by summing over every history: Bayes' rule and nothing else."""
    n, posterior = len(belief), np.zeros(len(belief))
    steps = range(len(KERNEL))
    for start, moves in itertools.product(range(n), itertools.product(steps, repeat=3)):
        weight, place = belief[start], start
        for move, likelihood in zip(moves, likelihoods, strict=True):
            place = (place + OFFSETS[move]) % n
            weight *= KERNEL[move] * likelihood[place]
        posterior[place] += weight
    return posterior / posterior.sum()


def recursion(predict, update):
    belief = BELIEF
    for likelihood in LIKELIHOODS:
        belief = update(predict(belief), likelihood)
    return belief


def predict(belief):
    return histogram.predict(belief, KERNEL, OFFSETS)


def update(belief, likelihood):
    return histogram.update(belief, likelihood)[0]


def test_the_recursion_equals_all_histories():
    due = enumerated(BELIEF, LIKELIHOODS)
    np.testing.assert_allclose(recursion(predict, update), due, atol=1e-15)


@pytest.mark.parametrize(
    ("wrong_predict", "wrong_update"),
    [
        (lambda b: histogram.predict(b, KERNEL, -OFFSETS), update),
        (lambda b: histogram.predict(b, KERNEL[::-1], OFFSETS), update),
        (predict, lambda b, p: (b + p) / (b + p).sum()),
        (lambda b: predict(predict(b)), update),
        (lambda b: b, update),
    ],
)
def test_wrong_forms_do_not(wrong_predict, wrong_update):
    due = enumerated(BELIEF, LIKELIHOODS)
    assert np.abs(recursion(wrong_predict, wrong_update) - due).max() > 1e-3


def test_predict_spreads_and_update_sharpens():
    sure = np.eye(5)[2]
    moved = predict(sure)
    assert histogram.entropy(moved) > histogram.entropy(sure) == 0
    sharp, _ = histogram.update(moved, [0.1, 0.1, 0.1, 0.9, 0.1])
    assert histogram.entropy(sharp) < histogram.entropy(moved)
    assert histogram.entropy(np.full(8, 1 / 8)) == pytest.approx(3.0)


def test_an_open_corridor_stops_at_its_ends():
    moved = histogram.predict(np.eye(4)[3], [1.0], [2], circular=False)
    assert moved.tolist() == [0, 0, 0, 1]
    assert histogram.predict(np.eye(4)[3], [1.0], [2]).tolist() == [0, 1, 0, 0]


def test_a_batch_equals_its_members():
    beliefs = RNG.dirichlet(np.ones(5), 7)
    np.testing.assert_allclose(predict(beliefs), [predict(b) for b in beliefs], atol=1e-15)
    posterior, evidence = histogram.update(beliefs, LIKELIHOODS[0])
    assert evidence.shape == (7,)
    np.testing.assert_allclose(posterior.sum(-1), 1.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: predict([0.5, 0.6]), "belief: expected probabilities that sum to 1"),
        (lambda: predict([1.5, -0.5]), "belief: expected no negative"),
        (lambda: histogram.predict(BELIEF, [0.5, 0.6], [0, 1]), "kernel: expected prob"),
        (lambda: histogram.predict(BELIEF, [0.5, 0.5], [0, 0.5]), "offsets: expected 2 whole"),
        (lambda: histogram.update(BELIEF, [0.1] * 4), "likelihood: expected shape"),
        (lambda: histogram.update(BELIEF, [-0.1] * 5), "likelihood: expected no negative"),
        (lambda: histogram.update(BELIEF, [0.0] * 5), "likelihood: the measurement is impossible"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
