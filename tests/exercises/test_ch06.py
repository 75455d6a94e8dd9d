"""Exercises of chapter 06: right answers pass, wrong ones are named, the stub is friendly."""

import numpy as np
import pytest

from slamlab.exercises import ch06_lidar_simulation as ch
from slamlab.geometry import wrap_angle
from slamlab.sensors import Lidar
from slamlab.worlds import BitmapWorld

EXERCISES = {
    "first_hit": (ch.check_first_hit, ch.first_hit, ch.MISTAKES_FIRST_HIT),
    "beam_angles": (ch.check_beam_angles, ch.beam_angles, ch.MISTAKES_BEAM_ANGLES),
    "scan_to_points": (ch.check_scan_to_points, ch.scan_to_points, ch.MISTAKES_SCAN_TO_POINTS),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


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


@pytest.mark.parametrize("name", EXERCISES)
def test_at_least_five_wrong_answers_are_known(name):
    assert len(EXERCISES[name][2]) >= 5


@pytest.mark.parametrize("name", EXERCISES)
def test_the_solution_passes(name):
    check, solution, _ = EXERCISES[name]
    assert check(solution).passed


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_first_hit, by_the_library),
        (ch.check_first_hit, by_all_crossings),
        (ch.check_beam_angles, lambda n, view: Lidar(n, view).beam_angles),
        (ch.check_beam_angles, lambda n, view: list(wrap_angle(ch.beam_angles(n, view)))),
        (ch.check_scan_to_points, by_transform),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


@pytest.mark.parametrize("name", EXERCISES)
def test_the_stub_gets_the_friendly_line_and_nothing_else(name):
    report = EXERCISES[name][0](lambda *arguments: ...)
    assert len(report.text.splitlines()) == 2
    assert "nothing returned yet" in report.text


@pytest.mark.parametrize(("check", "wrong", "message"), WRONG)
def test_each_wrong_answer_is_caught_with_its_own_message(check, wrong, message):
    report = check(wrong)
    assert not report.passed
    assert report.messages == (message,)
