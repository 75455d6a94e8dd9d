"""Right answers of chapter 07, written in other ways: each passes."""

import math

import numpy as np
import pytest

from slamlab.exercises import ch07_walls_from_points as ch
from slamlab.mapping import fit_line, line_cov


def by_eigenvectors(points):
    centre = np.mean(points, axis=0)
    normal = np.linalg.eigh(np.cov(np.transpose(points)))[1][:, 0]
    if normal @ centre < 0:
        normal = -normal
    return float(normal @ centre), math.atan2(normal[1], normal[0])


def by_normal_of_the_chord(points):
    (x0, y0), (x1, y1) = points[0], points[-1]
    off = [abs((x - x0) * (y1 - y0) - (y - y0) * (x1 - x0)) for x, y in points]
    return off.index(max(off))


def by_the_library(along, variances):
    """A wall x = 10 with points at y = along, the noise across it."""
    points = np.stack([np.full(len(along), 10.0), along], -1)
    covs = np.zeros((len(along), 2, 2))
    covs[:, 0, 0] = variances
    return line_cov(points, covs).tolist()


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_line, by_eigenvectors),
        (ch.check_line, fit_line),
        (ch.check_line, lambda points: fit_line(points).tolist()),
        (ch.check_corner, by_normal_of_the_chord),
        (ch.check_wall_cov, by_the_library),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
