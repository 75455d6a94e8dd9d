"""A mistake counts once: what calls a wrong function is judged with the right one in its place."""

import pytest

from slamlab.commands import _submission
from slamlab.commands._submission import Limits, Mark, checks_of, marked

HEAD = "def track(mean, cov, u, z, H, variances, dt, sigma):"
START = "import numpy as np\n"
WRONG = """def predict(mean, cov, u, dt, sigma):
    F = np.array([[1.0, dt, -(dt**2) / 2], [0.0, 1.0, -dt], [0.0, 0.0, 1.0]])
    B = np.array([dt**2 / 2, dt, 0.0])
    return F @ mean + B * u, F @ cov @ F + sigma**2 * np.outer(B, B)
"""
UPDATE = """def update(mean, cov, z, H, variances):
    for reading, h, variance in zip(z, H, variances):
        if np.isfinite(reading):
            K = cov @ h / (h @ cov @ h + variance)
            mean, cov = mean + K * (reading - h @ mean), cov - np.outer(K, h @ cov)
    return mean, cov
"""
TEST = """def innovation_test(innovations, variances):
    d, T = innovations / np.sqrt(variances), len(innovations)
    nis, c = np.mean(d**2), d[1:] @ d[:-1] / np.sum(d**2)
    level = np.sign(nis - 1) * (abs(nis - 1) > 2.58 * np.sqrt(2 / T))
    return int(level), int(np.sign(c) * (abs(c) > 2.58 / np.sqrt(T)))
"""
TRACK = f"""{TEST}

def track(mean, cov, u, z, H, variances, dt, sigma):
    means, covs, nu, S = [], [], [], []
    for push, readings in zip(u, z):
        mean, cov = predict(mean, cov, push, dt=dt, sigma=sigma)
        if np.isfinite(readings[0]):
            nu.append(readings[0] - H[0] @ mean)
            S.append(H[0] @ cov @ H[0] + variances[0])
        mean, cov = update(mean, cov, readings, H, variances)
        means.append(mean)
        covs.append(cov)
    return np.array(means), np.array(covs), *innovation_test(np.array(nu), np.array(S))
"""


def judged(*cells, seconds=5.0):
    return marked(Mark("one", "02"), [START, *cells], checks_of("02"), Limits(seconds, 2048))


def test_a_wrong_predict_does_not_count_again_in_the_filter_that_calls_it():
    mark = judged(WRONG, UPDATE, TRACK)
    assert 0 < mark.share("predict") < 1
    assert mark.share("update") == mark.share("track") == 1
    assert mark.notes == ["track: 0.00, and 1.00 with the right predict, which counts"]


def test_a_function_that_is_missing_does_not_count_again_either():
    assert judged(UPDATE, TRACK).share("track") == 1


def test_a_mistake_of_its_own_still_counts():
    mark = judged(WRONG, UPDATE, TRACK.replace("readings, H", "0 * readings, H"))
    assert 0 < mark.share("track") < 1


def test_a_filter_that_is_right_is_judged_with_the_students_own_functions():
    mark = judged(WRONG.replace("@ F +", "@ F.T +"), UPDATE, TRACK)
    assert mark.share("track") == 1
    assert mark.notes == []


@pytest.mark.parametrize(
    "lines",
    [
        # The right function is asked for its own answer, by the way that `predict` is answered.
        "    ask = predict.func\n"
        "    return ask('track', mean, cov, u, z, H, variances, dt, sigma)",
        "    while True:\n        predict(np.zeros(3), np.eye(3), 0.0, 1.0, 1.0)",
        "    return predict(np.zeros((3000, 3000)), np.eye(2), None, {}, 1.0)",
        "    predict.args[0].__class__ = int",
    ],
)
def test_the_way_to_the_right_function_leads_no_further(lines):
    mark = judged(WRONG, UPDATE, f"{HEAD}\n{lines}\n", seconds=2.0)
    assert mark.share("track") == 0
    assert mark.share("update") == 1


def test_the_students_own_function_is_back_after_each_call():
    cells = "def update(mean, cov, z, H, variances):\n    return predict\n"
    assert judged(WRONG, cells, TRACK).share("update") == 0


def test_the_second_judgement_takes_its_time_and_says_where_it_took_too_long(monkeypatch):
    """Each call of a right function goes through two pipes: on a busy machine that takes long."""
    monkeypatch.setattr(_submission, "_TIMES_AGAIN", 1e-3)
    mark = judged(WRONG, UPDATE, TRACK)
    assert mark.share("track") == 0
    assert mark.notes[0].startswith("track: not judged with the right predict: it did not end")
