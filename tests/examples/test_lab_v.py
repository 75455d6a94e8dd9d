"""Lab V: its stubs are the signatures of the example, and the example solves it."""

import ast
import json
import re
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from slamlab.exercises.capstone import STEPS, check, save_file
from slamlab.exercises.capstone_pictures import compare, draw

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = (ROOT / "examples" / "slam_from_scratch.py").read_text()
SECTIONS = {int(p[2]): p.strip() for p in re.split(r"(?m)^(?=# \d\. )", EXAMPLE)[1:]}
NOTEBOOK = json.loads((ROOT / "notebooks" / "labs" / "V_slam_from_scratch.ipynb").read_text())
CODE = ["".join(c["source"]) for c in NOTEBOOK["cells"] if c["cell_type"] == "code"]
CELLS = {int(cell[2]): cell for cell in CODE if re.match(r"# \d\. ", cell)}


def heads(text):
    """Signature and docstring of each function."""
    functions = [node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)]
    return [(f.name, ast.unparse(f.args), ast.get_docstring(f)) for f in functions]


def namespace(cells):
    names = {}
    for number in sorted(cells):
        exec(compile(cells[number], f"cell {number}", "exec"), names)
    return names


def test_the_notebook_has_the_example_s_constants_and_loop():
    assert CELLS[0] == SECTIONS[0]
    assert CELLS[9] == SECTIONS[9]


@pytest.mark.parametrize("step", STEPS)
def test_a_stub_is_the_example_without_its_lines(step):
    assert heads(CELLS[step]) == heads(SECTIONS[step])
    assert [name for name, *_ in heads(CELLS[step])] == list(STEPS[step][1])
    assert [node.body[-1].value.value for node in ast.parse(CELLS[step]).body] == [...] * len(
        STEPS[step][1]
    )


@pytest.mark.parametrize("step", STEPS)
def test_a_step_asks_for_few_lines(step):
    """Lines beside signature and docstring: a few to forty."""
    wanted = len(SECTIONS[step].splitlines()) - len(CELLS[step].splitlines())
    assert 3 <= wanted <= 42


def test_stubs_hold_nothing_and_are_drawn():
    own = namespace(CELLS)
    for step in STEPS:
        report = check(step, own)
        assert report.held == 0
        assert "nothing returned yet" in report.text
        figure = draw(step, own)
        titles = " ".join(ax.get_title() for ax in figure.axes)
        assert "not written yet" in titles or "not yet" in titles
        plt.close(figure)
    assert compare(own)[1][1].startswith("not written yet")


def test_the_example_solves_the_lab_and_its_pictures_say_so():
    own = namespace(SECTIONS)
    said = []
    for step in STEPS:
        assert check(step, own).passed
        figure = draw(step, own)
        said += [ax.get_title() for ax in figure.axes]
        plt.close(figure)
    assert not any("not" in title or "Error" in title for title in said)
    odometry, yours, library = compare(own)
    assert yours[1] < 0.05 < 0.5 < odometry[1]
    assert library[1] < 0.05
    assert yours[2] >= 5


def test_the_map_is_drawn_without_a_message_below_it(caplog):
    figure = draw(8, namespace(SECTIONS))
    figure.canvas.draw()
    plt.close(figure)
    assert caplog.messages == []


def test_a_picture_shows_a_failure():
    wrong = SECTIONS | {
        3: SECTIONS[3].replace("step = -np.linalg.solve", "step = np.linalg.solve")
    }
    own = namespace(wrong)
    assert not check(3, own).passed
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        figure = draw(3, own)
    title = figure.axes[1].get_title()
    plt.close(figure)
    assert re.search(r"after your ICP: (\d{2,}\.|nan)", title) or "Error" in title


def test_the_cells_become_one_file(tmp_path):
    cells = ["1 + 1", *SECTIONS.values(), SECTIONS[3].replace("0.15", "0.16")]
    path = save_file(tmp_path / "my_slam.py", cells)
    text = path.read_text()
    assert "0.16 * values" in text
    assert heads(text) == heads(EXAMPLE)
    own = {}
    exec(compile(text, "my_slam", "exec"), own)
    assert np.allclose(own["compose"]([1, 2, np.pi / 2], [3.0, 0, 0]), [1, 5, np.pi / 2])
    with pytest.raises(ValueError, match=r"got no \[4\]"):
        save_file(path, [cell for number, cell in SECTIONS.items() if number != 4])
