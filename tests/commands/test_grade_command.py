"""Grading: a heap of good, bad and hostile submissions is survived, and marked rightly."""

import csv
import json
import shutil
from pathlib import Path

import pytest

from slamlab.commands import main

SOLUTION = Path(__file__).resolve().parents[2] / "notebooks/solutions/02_kalman_filter.ipynb"
PREDICT = "def predict(mean, cov, F, Q):\n    return F @ mean, F @ cov @ F.T + Q\n"
UPDATE = """def update(mean, cov, z, H, R):
    K = cov @ H.T @ np.linalg.inv(H @ cov @ H.T + R)
    return mean + K @ (z - H @ mean), cov - K @ H @ cov
"""
JOSEPH = """def joseph(cov, K, H, R):
    A = np.eye(len(cov)) - K @ H
    return A @ cov @ A.T + K @ R @ K.T
"""
START = "import numpy as np\n\nfrom slamlab.exercises.ch02_kalman_filter import check_predict\n\n"
RIGHT = START + PREDICT + UPDATE + JOSEPH
# Text of the submission; points of three; a piece of the note.
KINDS = {
    "right": (RIGHT, 3, ""),
    "chatty": (START + "print('hello')\n" + RIGHT + "check_predict(predict)\n", 3, ""),
    "two_of_three": (START + PREDICT + JOSEPH, 2, ""),
    "empty": ("", 0, ""),
    "stub": (START + "def predict(mean, cov, F, Q):\n    ...\n", 0, ""),
    "typo": (START + PREDICT + UPDATE + "def joseph(:\n", 0, "cell 1 raised SyntaxError"),
    "raises_at_once": (START + PREDICT + "1 / 0\n" + UPDATE, 1, "ZeroDivisionError"),
    "leaves": (START + PREDICT + "raise SystemExit\n", 1, "SystemExit"),
    "dies": (
        START + "import os\n" + PREDICT + "def update(*a):\n    os._exit(0)\n",
        1,
        "its process ended early",
    ),
    "endless_function": (
        START + PREDICT + "def update(*a):\n    while True:\n        pass\n" + JOSEPH,
        2,
        "update: it did not end within",
    ),
    "endless_cell": (
        START + PREDICT + "import time\n\nwhile True:\n    time.sleep(1)\n",
        1,
        "cell 1 did not end within",
    ),
    "hungry": (START + PREDICT + "def update(*a):\n    return np.ones(10**11)\n", 1, ""),
    "hungry_cell": (START + PREDICT + "x = [0] * 10**11\n", 1, "MemoryError"),
    "reference": (
        "from slamlab.exercises.ch02_kalman_filter import _predict as predict\n",
        0,
        "refused: imports slamlab.exercises.ch02_kalman_filter._predict",
    ),
    "by_attribute": (
        "from slamlab.exercises import ch02_kalman_filter as ch\npredict = ch._predict\n",
        0,
        "refused: asks for",
    ),
    "by_check": (
        "from slamlab.exercises.ch02_kalman_filter import check_predict\n"
        "predict = check_predict.reference\n",
        0,
        "AttributeError",
    ),
    "patched": (
        "import slamlab.exercises.ch02_kalman_filter as ch\nch.check_predict = print\n" + RIGHT,
        0,
        "refused: changes slamlab.exercises.ch02_kalman_filter.check_predict",
    ),
    "private": (
        "from slamlab.exercises import _report\n" + RIGHT,
        0,
        "refused: imports slamlab.exercises._report",
    ),
    "digger": ("import gc\n" + RIGHT, 0, "refused: imports gc"),
}
WRONG = {  # less than a point
    "no_q": START + PREDICT.replace(" + Q", ""),
    "no_transpose": START + PREDICT.replace("F.T", "F"),
    "r_in_gain": START + UPDATE.replace("+ R)", "+ R) + R"),
    "no_r": START + UPDATE.replace("+ R)", ")"),
    "short": START + JOSEPH.replace("A @ cov @ A.T + K @ R @ K.T", "A @ cov"),
}


def graded(folder, *words):
    table = folder.parent / "out" / "marks.csv"
    table.parent.mkdir(exist_ok=True)
    assert main(["grade", str(folder), "--chapter", "02", "-o", str(table), *words]) == 0
    with table.open(encoding="utf-8") as file:
        return {row["student"]: row for row in csv.DictReader(file)}


def notebook(text):
    cell = {"cell_type": "code", "source": text.splitlines(True), "metadata": {}, "outputs": []}
    return json.dumps({"cells": [cell], "metadata": {}, "nbformat": 4, "nbformat_minor": 5})


@pytest.mark.slow
def test_sixty_submissions_are_survived_and_marked_rightly(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    for name, (text, *_) in KINDS.items():
        (folder / f"{name}.py").write_text(text)
        (folder / f"{name}_nb.ipynb").write_text(notebook(text))
    for name, text in WRONG.items():
        (folder / f"wrong_{name}.py").write_text(text)
        (folder / f"wrong_{name}_nb.ipynb").write_text(notebook(text))
    for number in range(10):
        folder.joinpath(f"student{number}").mkdir()
        shutil.copy(SOLUTION, folder / f"student{number}" / "02.ipynb")
    (folder / "broken.ipynb").write_text("{")
    (folder / "binary.py").write_bytes(b"\xff\xfe\x00")
    rows = graded(folder, "--seconds", "2")
    assert len(rows) == 2 * len(KINDS) + 2 * len(WRONG) + 12 == 60
    for name, (_, points, note) in KINDS.items():
        for row in (rows[name], rows[f"{name}_nb"]):
            assert float(row["points"]) == points, row
            assert note in row["note"], row
    for name in WRONG:
        assert 0 <= float(rows[f"wrong_{name}"]["points"]) < 1, name
        assert rows[f"wrong_{name}"]["points"] == rows[f"wrong_{name}_nb"]["points"]
    assert all(float(rows[f"student{number}_02"]["points"]) == 5 for number in range(10))
    assert "cannot be read" in rows["broken"]["note"]
    assert "cannot be read" in rows["binary"]["note"]
    pages = tmp_path / "out" / "feedback"
    assert len(list(pages.glob("*.html"))) == 60
    assert "R is missing in S" in (pages / "wrong_no_r.html").read_text()


def test_a_folder_without_submissions_and_an_unknown_chapter_are_said(tmp_path, capsys):
    assert main(["grade", str(tmp_path), "--chapter", "02"]) == 1
    assert "expected .ipynb or .py files" in capsys.readouterr().err
    assert main(["grade", str(tmp_path), "--chapter", "99"]) == 1
    assert "chapter: expected one of 00, 01" in capsys.readouterr().err


def test_a_handout_has_no_outputs_and_no_solutions(tmp_path, capsys):
    assert main(["handout", "02", "05", "--to", str(tmp_path)]) == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["02_kalman_filter.ipynb", "05_mecanum_kinematics.ipynb", "README.md"]
    for path in tmp_path.glob("*.ipynb"):
        notebook = json.loads(path.read_text())
        assert "solutions" not in path.read_text()
        assert all(not cell.get("outputs") for cell in notebook["cells"])
        for cell in notebook["cells"]:
            if cell["cell_type"] == "code":
                compile("".join(cell["source"]), path.name, "exec")
    assert main(["handout", "99", "--to", str(tmp_path)]) == 1
    assert "got 99" in capsys.readouterr().err
