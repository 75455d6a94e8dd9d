"""The recipe of the teacher's guide inside otter-grader and nbgrader, where they are installed."""

import textwrap

import nbformat
import pytest
from nbclient import NotebookClient
from test_recipes import RECIPE

RIGHT = "carried.argmax()"
ANSWERS = {"right": RIGHT, "wrong": "weights.argmax()"}
CHECKED, _, ASSERTED = RECIPE.partition("\n\ndef ")
ANSWER, _, ASSERTED = ASSERTED.partition("\n\n\n")
ANSWER = "def " + ANSWER


@pytest.mark.parametrize("kind", ANSWERS)
def test_otter_grader_runs_the_recipe(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)  # otter writes its log where it stands
    otter = pytest.importorskip("otter", reason="otter-grader is not installed")
    case = """
    from otter.test_files import test_case

    OK_FORMAT = False
    name, points = "q1", 2

    @test_case()
    def test_answer(best_place):
    """
    body = textwrap.indent("\n".join((CHECKED, ASSERTED)).strip(), "    ")
    (tmp_path / "q1.py").write_text(textwrap.dedent(case) + body + "\n")
    scope = {}
    exec(ANSWER.replace(RIGHT, ANSWERS[kind]), scope)
    grader = otter.Notebook(tests_dir=str(tmp_path))
    result = grader.check("q1", global_env=scope)
    assert result.score == (2 if kind == "right" else 0)
    assert kind == "right" or "best_place: " in result.summary()


@pytest.mark.parametrize("kind", ANSWERS)
@pytest.mark.parametrize("partial", [False, True])
def test_nbgrader_runs_the_recipe(kind, partial):
    utils = pytest.importorskip("nbgrader.utils", reason="nbgrader is not installed")
    test = CHECKED + "\n" + ASSERTED
    if partial:
        test = test.rpartition("assert ")[0] + "report.share"
    cells = [
        nbformat.v4.new_code_cell(ANSWER.replace(RIGHT, ANSWERS[kind])),
        nbformat.v4.new_code_cell(test),
    ]
    cells[1].metadata["nbgrader"] = {
        "grade": True, "solution": False, "locked": True, "points": 1, "grade_id": "q1",
        "schema_version": 3,
    }  # fmt: skip
    notebook = nbformat.v4.new_notebook(cells=cells)
    NotebookClient(notebook, allow_errors=True, kernel_name="python3").execute()
    score, most = utils.determine_grade(notebook.cells[1])
    assert most == 1
    assert score == 1 if kind == "right" else 0 <= score < 1
    assert kind == "right" or score > 0 or not partial
