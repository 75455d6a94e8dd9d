"""Right answers of chapter 20, written in other ways: each passes."""

import numpy as np
import pytest
from scipy.stats import chi2

from slamlab.exercises import ch20_explore_and_return as ch
from slamlab.gaussian import mahalanobis_squared
from slamlab.geometry import compose, inverse, inverse_transform, transform


def relaid_by_loop(points, nodes, before, after):
    return [
        transform(after[k], inverse_transform(before[k], p)).tolist()
        for p, k in zip(points, nodes, strict=True)
    ]


def relaid_by_motion(points, nodes, before, after):
    motion = compose(after, inverse(before))
    return np.array([transform(motion[k], p) for p, k in zip(points, nodes, strict=True)])


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_retraced, lambda steps: inverse(steps)[::-1]),
        (ch.check_retraced, lambda steps: [inverse(u).tolist() for u in steps[::-1]]),
        (ch.check_turn_back, lambda d, h, b, r: not d < b - r * h),
        (ch.check_relaid, relaid_by_loop),
        (ch.check_relaid, relaid_by_motion),
        (ch.check_inside, lambda e, P: np.mean(mahalanobis_squared(e, P) < chi2.ppf(0.95, 2))),
        (
            ch.check_least_share,
            lambda k, n: (
                (2 * k + 1.96**2 - 1.96 * np.sqrt(1.96**2 + 4 * k * (n - k) / n))
                / (2 * (n + 1.96**2))
            ),
        ),
    ],
)
def test_another_right_answer_passes(check, answer):
    report = check(answer)
    assert report.passed, report.text
