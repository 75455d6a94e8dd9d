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


def run(tmp_path, code, *arguments):
    file = tmp_path / "example.py"
    file.write_text(code)
    command = [sys.executable, str(file), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("code", EXAMPLES)
def test_an_example_of_a_page_runs(code, tmp_path):
    done = run(tmp_path, code)
    assert done.returncode == 0, done.stderr


def test_the_cell_for_other_graders_passes_a_right_answer_and_fails_a_wrong_one(tmp_path):
    cell = next(block for block in blocks("teachers_guide") if "assert report.passed" in block)
    assert run(tmp_path, cell).returncode == 0
    wrong = run(tmp_path, cell.replace("<= radius", "< radius"))
    assert wrong.returncode != 0
    assert "exactly the radius away is near" in wrong.stderr


def story(page):
    """The code of a page that goes on from block to block, and what it says is printed."""
    text = (BOOK / f"{page}.md").read_text()
    printed = re.findall(r"^```text\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return "\n".join(blocks(page)), "".join(printed)


def test_your_own_robot_sensor_and_filter_run_and_print_what_the_page_says(tmp_path):
    code, printed = story("bring_your_own")
    done = run(tmp_path, code)
    assert done.returncode == 0, done.stderr
    assert done.stdout == printed
    wrong = run(tmp_path, code.replace("F_u[..., 2, 1] = dt * v", "F_u[..., 2, 1] = v"))
    assert wrong.stdout != printed


def test_the_pages_have_examples_and_a_broken_one_would_be_seen(tmp_path):
    assert len(EXAMPLES) >= 6
    assert run(tmp_path, "import slamlab.no_such_room").returncode != 0
