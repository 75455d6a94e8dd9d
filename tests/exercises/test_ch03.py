"""Right answers of chapter 03, written in other ways: each passes."""

import math

import numpy as np
import pytest

from slamlab.exercises import ch03_extended_kalman_filter as ch


def polar(pose, landmark):
    """Another right answer: by complex numbers, returned as a tuple."""
    seen = complex(*(landmark - pose[:2])) * complex(math.cos(pose[2]), -math.sin(pose[2]))
    return abs(seen), math.atan2(seen.imag, seen.real)


def by_differences(pose, landmark):
    """Another right answer: the Jacobian by complex step."""
    columns = []
    for k in range(3):
        p = np.array(pose, dtype=complex)
        p[k] += 1e-30j
        dx, dy = landmark[0] - p[0], landmark[1] - p[1]
        bearing = np.arctan2(dy.real, dx.real).imag
        q = dx.real**2 + dy.real**2
        bearing = (dx.real * dy.imag - dy.real * dx.imag) / q - p[2].imag
        columns.append([np.sqrt(dx * dx + dy * dy).imag / 1e-30, bearing / 1e-30])
    return np.array(columns).T


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_range_bearing, polar),
        (ch.check_innovation, lambda z, p: [z[0] - p[0], math.remainder(z[1] - p[1], math.tau)]),
        (ch.check_jacobian, by_differences),
        (ch.check_jacobian, lambda p, m: ch.check_jacobian.reference(p, m).tolist()),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
