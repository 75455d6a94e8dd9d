"""The Python examples of the book's pages run as they stand, each in an interpreter of its own."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

BOOK = Path(__file__).resolve().parents[2] / "book"


def blocks(page):
    text = (BOOK / f"{page}.md").read_text()
    return re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


EXAMPLES = [
    pytest.param(block, id=f"{page}-{number}")
    for page in ("how_to_use", "teachers_guide")
    for number, block in enumerate(blocks(page))
]
ANSWERS = """
import numpy as np
from slamlab.exercises import ch00_slam_in_ten_minutes as chapter

dead_reckoning = chapter.dead_reckoning


def edge_error(pose_i, pose_j, z):
    return np.subtract(pose_j, pose_i) - z
"""


def run(tmp_path, code, *arguments):
    file = tmp_path / "example.py"
    file.write_text(code)
    command = [sys.executable, str(file), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("code", EXAMPLES)
def test_an_example_of_a_page_runs(code, tmp_path):
    answers = tmp_path / "answers.py"
    answers.write_text(ANSWERS)
    done = run(tmp_path, code, str(answers))
    assert done.returncode == 0, done.stderr


def test_the_grader_of_the_teachers_guide_gives_points_and_names_mistakes(tmp_path):
    answers = tmp_path / "answers.py"
    answers.write_text(ANSWERS)
    grader = next(block for block in blocks("teachers_guide") if "grade.py" in block)
    lines = run(tmp_path, grader, str(answers)).stdout.splitlines()
    assert lines[0] == "dead_reckoning: passed"
    assert "like vectors" in lines[1]
    assert lines[2:] == ["edge_jacobian: not handed in", "1 of 3"]


def test_the_pages_have_examples_and_a_broken_one_would_be_seen(tmp_path):
    assert len(EXAMPLES) >= 6
    assert run(tmp_path, "import slamlab.no_such_room").returncode != 0
