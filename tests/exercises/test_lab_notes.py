"""The assistants' pages: each mistake of their tables, run, earns what stands there."""

import contextlib
import io
import re
import sys
from pathlib import Path

import pytest

from slamlab.exercises.lab_scores import practise

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "commands"))
from test_lab_command import GOOD, MAP  # noqa: E402

PAGE = (ROOT / "book" / "lab_notes.md").read_text(encoding="utf-8")
SLAM = """
import numpy as np


class Slam:
    measures = "landmarks"

    def __init__(self, setting):
        self.setting, self.names = setting, []
        self.m, self.P = setting.start.copy(), setting.start_cov.copy()

    @property
    def pose(self):
        return self.m[:3].copy()

    @property
    def pose_cov(self):
        return self.P[:3, :3].copy()

    def predict(self, u, dt, control_cov):
        F, G = self.setting.motion.jacobians(self.m[:3], u, dt)
        self.m[:3] = self.setting.motion.step(self.m[:3], u, dt)
        self.P[:3] = F @ self.P[:3]
        self.P[:, :3] = self.P[:, :3] @ F.T
        self.P[:3, :3] += G @ control_cov @ G.T

    def update(self, z, ids=None):
        for reading, name in zip(z, range(0) if ids is None else ids):
            if name in self.names:
                self.correct(reading, 3 + 2 * self.names.index(name))
            else:
                self.add(reading, name)

    def correct(self, z, k):
        sensor = self.setting.sensor
        H = np.zeros((2, len(self.m)))
        H[:, :3], H[:, k : k + 2] = sensor.jacobians(self.m[:3], self.m[k : k + 2])
        expected = sensor.observe(self.m[:3], self.m[k : k + 2])
        v = sensor.residual(z, expected)
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + sensor.cov)
        self.m = self.m + K @ v
        self.P = (np.eye(len(self.m)) - K @ H) @ self.P

    def add(self, z, name):
        sensor = self.setting.sensor
        place = sensor.locate(self.m[:3], z)
        H_pose, H_place = sensor.jacobians(self.m[:3], place)
        B = np.linalg.inv(H_place)
        G = -B @ H_pose
        cross = G @ self.P[:3]
        own = cross[:, :3] @ G.T + B @ sensor.cov @ B.T
        self.m = np.append(self.m, place)
        self.P = np.block([[self.P, cross.T], [cross, own]])
        self.names.append(name)


def make(setting):
    return Slam(setting)
"""
RESIDUAL = "sensor.residual(reading, sensor.observe(self.pose, beacon))"
# How a row of a table begins; a piece of the program, and what stands there instead.
MISTAKES = {
    "I": {
        "none": ("", ""),
        "no gate": ("< 12.0", "< 1e9"),
        "a gate at 1": ("< 12.0", "< 1.0"),
        "no noise": ("@ control_cov @", "@ (0 * control_cov) @"),
        "R missing": ("+ sensor.cov", "+ 1e-9 * sensor.cov"),
        "the covariance": ("self.pose_cov = (np.eye(3) - K @ H) @ self.pose_cov", "pass"),
        "the start": ("setting.start_cov.copy()", "1e-6 * np.eye(3)"),
        "the innovation": (RESIDUAL, "reading - sensor.observe(self.pose, beacon)"),
    },
    "II": {
        "none": ("", ""),
        "hits only": ("np.add.at(odds, (row, column), -0.05)", "pass"),
        "beams go on": ("np.arange(0.02, 0.99, 0.02)", "np.arange(0.02, 1.3, 0.02)"),
        "rows go down": ("return 1 /", "odds = odds[::-1]\n    return 1 /"),
        "the robot stands": ("setting.motion.step(pose, u, dt) if dt else pose", "pose"),
        "the lidar's": ("np.array([np.cos(pose[2]), np.sin(pose[2])])", "np.array([1.0, 0.0])"),
    },
    "III": {
        "none": ("", ""),
        "cross-covariances": (
            "self.P[:3] = F @ self.P[:3]\n        self.P[:, :3] = self.P[:, :3] @ F.T",
            "self.P[:3, :3] = F @ self.P[:3, :3] @ F.T",
        ),
        "a new landmark without": (
            "[[self.P, cross.T], [cross, own]]",
            "[[self.P, 0 * cross.T], [0 * cross, own]]",
        ),
        "the innovation": ("sensor.residual(z, expected)", "z - expected"),
        "no noise": ("+= G @ control_cov @ G.T", "+= 0.0"),
        "a new landmark is": (
            "self.add(reading, name)",
            "self.add(reading, name)\n                self.correct(reading, len(self.m) - 2)",
        ),
    },
}
PROGRAMS = {"I": (GOOD, "make", 0), "II": (MAP, "map_room", 0), "III": (SLAM, "make", 1)}


def rows(lab):
    """Cells of the table in the section of a lab."""
    section = PAGE.split(f"\n## Lab {lab}:")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("| ")][1:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def scored(lab, old, new):
    """Points, and what the sheet of one drive says of yours."""
    source, name, drive = PROGRAMS[lab]
    assert not old or source.count(old) == 1
    scope, said = {}, io.StringIO()
    exec(source.replace(old, new) if old else source, scope)
    with contextlib.redirect_stdout(said):
        practise(lab, scope[name], library=False)
    mine = [line for line in said.getvalue().splitlines() if line.startswith("you ")]
    points = re.search(r"(?m)^(\d+) of 6 points", said.getvalue())[1]
    return points, ", ".join(re.split(r"  +", mine[drive])[1:])


@pytest.mark.parametrize("lab", MISTAKES)
def test_every_row_of_a_table_is_a_program_and_back(lab):
    begins = list(MISTAKES[lab])
    assert len(rows(lab)) == len(begins)
    assert all(row[0].startswith(begin) for row, begin in zip(rows(lab), begins, strict=True))


@pytest.mark.parametrize(("lab", "begin"), [(lab, b) for lab in MISTAKES for b in MISTAKES[lab]])
def test_a_mistake_earns_what_the_page_says(lab, begin):
    (row,) = (row for row in rows(lab) if row[0].startswith(begin))
    points, figures = scored(lab, *MISTAKES[lab][begin])
    assert row[1] == points
    assert row[2].replace(" m,", ",") == figures
