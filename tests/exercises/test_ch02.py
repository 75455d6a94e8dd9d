"""Right answers of chapter 02, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.exercises import ch02_kalman_filter as ch
from slamlab.filters import kalman
from slamlab.gaussian import Gaussian


def information_form(mean, cov, z, H, R):
    """Another right answer: add up the information."""
    P = np.linalg.inv(np.linalg.inv(cov) + H.T @ np.linalg.inv(R) @ H)
    return P @ (np.linalg.inv(cov) @ mean + H.T @ np.linalg.inv(R) @ z), P


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_predict, lambda m, P, F, Q: kalman.predict(Gaussian(m, P), F, Q)),
        (ch.check_predict, lambda m, P, F, Q: [(F @ m).tolist(), (F @ P @ F.T + Q).tolist()]),
        (ch.check_update, information_form),
        (ch.check_update, lambda m, P, z, H, R: kalman.update(Gaussian(m, P), z, H, R)[0]),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
