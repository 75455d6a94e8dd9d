"""The labs' score sheets: a good system earns its points, a bad one none, a hostile one a note."""

import io
import json
import re
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from slamlab.commands import lab, main
from slamlab.exercises.labs import tasks

LABS = Path(__file__).resolve().parents[2] / "notebooks" / "labs"
GOOD = """import numpy as np


class Tracker:
    measures = "landmarks"

    def __init__(self, setting):
        self.setting = setting
        self.pose, self.pose_cov = setting.start.copy(), setting.start_cov.copy()

    def predict(self, u, dt, control_cov):
        F, G = self.setting.motion.jacobians(self.pose, u, dt)
        self.pose = self.setting.motion.step(self.pose, u, dt)
        self.pose_cov = F @ self.pose_cov @ F.T + G @ control_cov @ G.T

    def update(self, z, ids):
        sensor = self.setting.sensor
        for reading, beacon in zip(z, self.setting.beacons[ids]):
            H, _ = sensor.jacobians(self.pose, beacon)
            v = sensor.residual(reading, sensor.observe(self.pose, beacon))
            S = H @ self.pose_cov @ H.T + sensor.cov
            if v @ np.linalg.solve(S, v) < 12.0:
                K = self.pose_cov @ H.T @ np.linalg.inv(S)
                self.pose = self.pose + K @ v
                self.pose_cov = (np.eye(3) - K @ H) @ self.pose_cov


def make(setting):
    return Tracker(setting)
"""
MAP = """import numpy as np


def map_room(setting, log):
    pose, n, cell = setting.start.copy(), 400, 0.05
    corner, odds = pose[:2] - 10.0, np.zeros((n, n))
    for u, dt, ranges in zip(log.u, log.dt, log.ranges):
        pose = setting.motion.step(pose, u, dt) if dt else pose
        ends = log.scan.points(ranges, pose)
        ends = ends[np.isfinite(ends[:, 0])]
        eye = pose[:2] + setting.lidar.offset * np.array([np.cos(pose[2]), np.sin(pose[2])])
        for share in np.arange(0.02, 0.99, 0.02):
            row, column = np.int_((eye + share * (ends - eye) - corner) / cell).T[::-1]
            np.add.at(odds, (row, column), -0.05)
        row, column = np.int_((ends - corner) / cell).T[::-1]
        np.add.at(odds, (row, column), 0.8)
    return 1 / (1 + np.exp(-np.clip(odds, -50, 50))), cell, corner
"""
WRONG = {  # what is handed in, a piece of what is said
    "no_make": ("x = 1\n", "the file defines no function make"),
    "typo": ("def make(:\n", "cell 1 raised SyntaxError"),
    "no_system": ("def make(setting):\n    return 3\n", "what make returns has no measures, pose"),
    "raises": (
        GOOD.replace("K = self", "1 / 0\n                K = self"),
        "update: ZeroDivisionError: division by zero, line 23",
    ),
    "nan": (GOOD.replace("self.pose + K @ v", "self.pose * np.nan"), "pose: expected finite"),
    "shape": (GOOD.replace("self.pose + K @ v", "K @ v[:, None]"), "pose"),
    "endless": (GOOD.replace("K = self", "while True: pass\n                K = self"), "not end"),
    "hungry": (
        GOOD.replace("import numpy as np", "import numpy as np\nx = np.ones(10**12)"),
        "no",
    ),
    "dies": (GOOD + "\n\nimport os\nos._exit(1)\n", "its process ended early"),
}
CHEATS = {  # what is handed in before a good tracker, and a piece of what is said
    "from slamlab.slam import EKFSlam\n": "ImportError: slamlab.slam is not to be used here",
    "import slamlab.filters.extended as ekf\n": "slamlab.filters is not to be used here",
    "from slamlab import filters\n": "slamlab.filters is not to be used here",
    "import slamlab\nslamlab.slam.EKFSlam\n": "slamlab.slam is not to be used here",
    "from slamlab.exercises.lab_systems import systems\n": "PermissionError",
    "__import__('slamlab.slam')\n": "slamlab.slam is not to be used here",
    "open('/proc/1/environ')\n": "PermissionError: a submission opens nothing there",
}


def sheet(place, number, text, *words, name="mine.py"):
    file, said = place / name, io.StringIO()
    file.write_text(text)
    with redirect_stdout(said):
        assert main(["lab", number, str(file), "--seed", "3", *words]) == 0
    return said.getvalue()


def points(text):
    return tuple(map(int, re.search(r"(\d+) of (\d+) points", text).groups()))


def errors(text):
    return re.findall(r"(?m)^you +(\S+ +\S+)", text)


@pytest.fixture
def only(monkeypatch):
    """Leaves the sheet some of its drives: each starts a process."""
    return lambda some: monkeypatch.setattr(lab, "tasks", lambda *given: tasks(*given)[some])


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return sheet(tmp_path_factory.mktemp("good"), "I", GOOD)


def test_a_good_tracker_earns_every_point_and_stands_beside_the_library(good):
    assert points(good) == (12, 12)
    assert good.startswith("Lab I: mine.py, seed 3\n")
    for who in ("you", "dead reckoning", "EKF, every reading", "EKF with a gate"):
        assert len(re.findall(rf"(?m)^{who}  ", good)) == 3


def test_a_notebook_is_taken_like_a_file_and_a_seed_gives_the_same_drives(tmp_path, good, only):
    only(slice(1))
    cell = {"cell_type": "code", "source": GOOD.splitlines(True), "metadata": {}, "outputs": []}
    book = json.dumps({"cells": [cell], "metadata": {}, "nbformat": 4, "nbformat_minor": 5})
    text = sheet(tmp_path, "I", book, "--alone", name="a.ipynb")
    assert points(text) == (3, 3)
    assert len(errors(good)) == 3
    assert errors(text) == errors(good)[:1]


def test_a_folder_ends_in_a_leaderboard(tmp_path, only, capsys):
    only(slice(1))
    hand_ins = tmp_path / "hand-ins"
    (hand_ins / "ben").mkdir(parents=True)
    (hand_ins / "ada.py").write_text(GOOD.replace("@ control_cov @", "@ (0 * control_cov) @"))
    (hand_ins / "ben" / "mine.py").write_text(GOOD)
    (hand_ins / "eve.ipynb").write_text("{")
    reads = f"open({str(hand_ins / 'ada.py')!r})\n{GOOD}"
    (hand_ins / "thief.py").write_text(reads.replace("def make(setting):", "def other(setting):"))
    assert main(["lab", "I", str(hand_ins), "--seed", "3", "--alone"]) == 0
    said = capsys.readouterr().out
    board = said.partition("Leaderboard\n")[2].splitlines()
    assert board[0].split() == ["3", "of", "3", "ben/mine.py"]
    assert "PermissionError" in said
    assert any("eve.ipynb" in line and "expected a notebook" in line for line in board)
    assert len(board) == 4
    (tmp_path / "empty").mkdir()
    assert main(["lab", "I", str(tmp_path / "empty")]) == 1
    assert "file: expected .ipynb or .py files" in capsys.readouterr().err


def test_a_tracker_that_believes_echoes_loses_points(tmp_path, only):
    only(slice(2, 3))
    assert points(sheet(tmp_path, "I", GOOD.replace("< 12.0", "< 1e9"))) == (2, 4)


def test_a_tracker_that_believes_itself_too_much_loses_points(tmp_path, only):
    only(slice(1))
    sure = sheet(tmp_path, "I", GOOD.replace("+ sensor.cov", "+ sensor.cov / 30"))
    assert points(sure)[0] <= 3
    assert "NO  so, and mean NEES" in sure


@pytest.mark.parametrize("name", WRONG)
def test_what_goes_wrong_is_said_and_the_sheet_goes_on(tmp_path, only, name):
    only(slice(1))
    text, said = WRONG[name]
    words = ("--alone", "--seconds", "3" if name == "endless" else "60")
    report = sheet(tmp_path, "I", text, *words)
    assert said in report
    assert points(report) == (0, 3)
    assert report.count("dead reckoning  ") == 1


@pytest.mark.parametrize("line", CHEATS)
def test_what_is_not_the_students_own_is_refused(tmp_path, only, line):
    only(slice(1))
    report = sheet(tmp_path, "I", line + GOOD, "--alone")
    assert CHEATS[line] in report
    assert points(report) == (0, 3)


def test_the_truth_is_not_told(tmp_path, only):
    only(slice(1))
    spy = MAP + "\n\ndraw = map_room\n\n\ndef map_room(setting, log):\n"
    spy += "    assert log.truth is None and not log.notes and log.landmarks is None\n"
    spy += "    assert not hasattr(setting, 'world')\n    return draw(setting, log)\n"
    text = sheet(tmp_path, "II", spy, "--alone")
    assert "AssertionError" not in text
    found = [float(x) for x in re.findall(r"(?m)^you +(\S+)", text)]
    assert min(found) > 30


def test_slam_from_scratch_earns_every_point_and_without_closures_its_path_is_worse(tmp_path):
    example = (LABS.parents[1] / "examples" / "slam_from_scratch.py").read_text()
    text = sheet(tmp_path, "V", example, "--alone")
    assert points(text) == (4, 4)
    closed = [float(x) for x in re.findall(r"(?m)^you +(\S+)", text)]
    opened = sheet(tmp_path, "V", example.replace("loops=True", "loops=False"), "--alone")
    assert sum(closed) < sum(float(x) for x in re.findall(r"(?m)^you +(\S+)", opened))
    lost = sheet(tmp_path, "V", example.replace("x, cov = track(", "_ = track("), "--alone")
    assert points(lost) == (0, 4)
    starter = (LABS / "V_slam_from_scratch.ipynb").read_text()
    unwritten = sheet(tmp_path, "V", starter, "--alone", name="starter.ipynb")
    assert points(unwritten) == (0, 4)
    assert unwritten.count("you  ") == 2


@pytest.mark.parametrize(
    "name", ["I_track", "II_map_a_room", "III_slam", "IV_explore_and_come_home"]
)
def test_the_starter_runs_and_earns_nothing(capsys, only, name):
    only(slice(-1, None))
    number = name.split("_")[0]
    assert main(["lab", number, str(LABS / f"{name}.ipynb"), "--seed", "1", "--alone"]) == 0
    text = capsys.readouterr().out
    assert points(text)[0] == 0
    assert len(re.findall(r"(?m)^you +[\d.]+ ", text)) == 1
