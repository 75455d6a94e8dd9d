"""Right answers of chapter 06, written in other ways: each passes."""

import numpy as np
import pytest

from slamlab.exercises import ch06_lidar_simulation as ch
from slamlab.geometry import wrap_angle
from slamlab.sensors import Lidar
from slamlab.worlds import BitmapWorld


def by_the_library(occupied, x, y, angle):
    return BitmapWorld(occupied, 1.0).cast([x, y], angle)


def by_all_crossings(occupied, x, y, angle):
    """Another right answer: sort all grid lines by distance, look just behind each."""
    d = np.array([np.cos(angle), np.sin(angle)])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.concatenate([(np.arange(12) - p) / q for p, q in zip((x, y), d, strict=True)])
    for s in [0.0, *np.sort(t[np.isfinite(t) & (t > 0)])]:
        column, row = np.floor(np.array([x, y]) + (s + 1e-9) * d).astype(int)
        if not (0 <= row < len(occupied) and 0 <= column < len(occupied[0])):
            return np.inf
        if occupied[row, column]:
            return float(s)
    return np.inf


def by_transform(pose, ranges, angles):
    with np.errstate(invalid="ignore"):
        local = ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    local[~np.isfinite(ranges)] = np.nan
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return (local @ np.array([[c, s], [-s, c]]) + pose[:2]).tolist()


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_first_hit, by_the_library),
        (ch.check_first_hit, by_all_crossings),
        (ch.check_beam_angles, lambda n, view: Lidar(n, view).beam_angles),
        (
            ch.check_beam_angles,
            lambda *g: list(wrap_angle(ch.check_beam_angles.reference(*g))),
        ),
        (ch.check_scan_to_points, by_transform),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
