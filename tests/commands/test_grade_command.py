"""Grading: a heap of good, bad and hostile submissions is survived, and marked rightly."""

import csv
import json
import os
import re
import shutil
import textwrap
from pathlib import Path

import pytest

from slamlab.commands import _submission, main
from slamlab.commands._copies import same_code

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"
SOLUTION = NOTEBOOKS / "solutions" / "02_kalman_filter.ipynb"
PREDICT = """def predict(mean, cov, u, dt, sigma):
    F = np.array([[1.0, dt, -(dt**2) / 2], [0.0, 1.0, -dt], [0.0, 0.0, 1.0]])
    B = np.array([dt**2 / 2, dt, 0.0])
    return F @ mean + B * u, F @ cov @ F.T + sigma**2 * np.outer(B, B)
"""
UPDATE = """def update(mean, cov, z, H, variances):
    for reading, h, variance in zip(z, H, variances):
        if np.isfinite(reading):
            K = cov @ h / (h @ cov @ h + variance)
            mean, cov = mean + K * (reading - h @ mean), cov - np.outer(K, h @ cov)
    return mean, cov
"""
AFTER = """def cov_after_update(cov, K, H, R):
    A = np.eye(len(cov)) - K @ H
    return A @ cov @ A.T + K @ R @ K.T
"""
START = "import numpy as np\n\nfrom slamlab.exercises.ch02_kalman_filter import check_predict\n\n"
RIGHT = START + PREDICT + UPDATE + AFTER
# Text of the submission; points of three; a piece of the note.
KINDS = {
    "right": (RIGHT, 3, ""),
    "chatty": (START + "print('hello')\n" + RIGHT + "check_predict(predict)\n", 3, ""),
    "two_of_three": (START + PREDICT + AFTER, 2, ""),
    "empty": ("", 0, ""),
    "stub": (START + "def predict(mean, cov, u, dt, sigma):\n    ...\n", 0, ""),
    "typo": (
        START + PREDICT + UPDATE + "def cov_after_update(:\n",
        0,
        "cell 1 raised SyntaxError",
    ),
    "raises_at_once": (START + PREDICT + "1 / 0\n" + UPDATE, 1, "ZeroDivisionError"),
    "leaves": (START + PREDICT + "raise SystemExit\n", 1, "SystemExit"),
    "dies": (
        START + "import os\n" + PREDICT + "def update(*a):\n    os._exit(0)\n" + AFTER,
        2,
        "its process ended early",
    ),
    "endless_function": (
        START + PREDICT + "def update(*a):\n    while True:\n        pass\n" + AFTER,
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
        "ImportError: cannot import name '_predict'",
    ),
    "by_attribute": (
        "from slamlab.exercises import ch02_kalman_filter as ch\npredict = ch._predict\n",
        0,
        "has no _predict for a submission",
    ),
    "by_check": (
        "from slamlab.exercises.ch02_kalman_filter import check_predict\n"
        "predict = check_predict.reference\n",
        0,
        "AttributeError",
    ),
    "patched": (
        "import slamlab.exercises.ch02_kalman_filter as ch\nch.check_predict = print\n" + RIGHT,
        3,
        "",
    ),
    "private": ("from slamlab.exercises import _report\n" + RIGHT, 3, ""),
    "digger": ("import gc\n" + RIGHT, 3, ""),
}
WRONG = {  # less than a point
    "no_q": START + PREDICT.replace(" + sigma**2 * np.outer(B, B)", ""),
    "no_transpose": START + PREDICT.replace("F.T", "F"),
    "r_in_gain": START + UPDATE.replace("+ variance)", "+ variance) + variance"),
    "no_r": START + UPDATE.replace(" + variance)", ")"),
    "short": START + AFTER.replace("A @ cov @ A.T + K @ R @ K.T", "A @ cov"),
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
    assert all(float(rows[f"student{number}_02"]["points"]) == 6 for number in range(10))
    assert "cannot be read" in rows["broken"]["note"]
    assert "cannot be read" in rows["binary"]["note"]
    pages = tmp_path / "out" / "feedback"
    assert len(list(pages.glob("*.html"))) == 60
    assert "the variance is missing in S" in (pages / "wrong_no_r.html").read_text()


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
    assert main(["handout", "02", "05", "--to", str(tmp_path)]) == 0
    mine = tmp_path / "02_kalman_filter.ipynb"
    mine.write_text(mine.read_text() + "\n")
    assert main(["handout", "02", "05", "--to", str(tmp_path)]) == 1
    assert "02_kalman_filter.ipynb differs" in capsys.readouterr().err
    assert main(["handout", "99", "--to", str(tmp_path)]) == 1
    assert "got 99" in capsys.readouterr().err


def says_of_solutions(notebook):
    """Sentences that promise what a handout has not."""
    text = "\n".join("".join(cell["source"]) for cell in notebook["cells"])
    return re.findall(r"[^\n.]*\b(?:(?:the|its) solution|solutions)\b[^\n.]*", text, re.I)


def test_no_statement_of_a_handout_names_the_solutions(tmp_path):
    found = sorted(path.name[:2] for path in (NOTEBOOKS / "exercises").glob("*.ipynb"))
    assert len(found) == 21
    assert main(["handout", *found, "--to", str(tmp_path)]) == 0
    said = {
        path.name[:2]: says_of_solutions(json.loads(path.read_text()))
        for path in sorted(tmp_path.glob("*.ipynb"))
    }
    assert {number: lines for number, lines in said.items() if lines} == {}
    one = {"cells": [{"source": ["Which? (The solution tries it.)"]}]}
    assert says_of_solutions(one) == ["Which? (The solution tries it"]
    assert not says_of_solutions({"cells": [{"source": ["It has no single solution."]}]})


# What the review of the grader found (reviews of release 1.0, G1 to G3 and M1 to M4).

HONEST = {
    "a docstring about process noise": RIGHT.replace(
        "def update(mean, cov, z, H, variances):\n",
        "def update(mean, cov, z, H, variances):\n"
        '    """Q: motion/process noise; see solutions/02."""\n',
    ),
    "a path in a string": RIGHT + "data = 'data/processed.npy'\n",
    "a line that begins with a percent sign": RIGHT.replace(
        "    A = np.eye", "    n = (7\n        % 4\n        - 2)\n    A = n * np.eye"
    ),
    "a magic, a question and a shell line": "%matplotlib inline\n!pip list\n"
    + RIGHT
    + "np.linalg.inv?",
    "a cell magic": "%%time\n" + RIGHT,
}


@pytest.mark.parametrize("name", HONEST)
def test_honest_work_keeps_its_points(name, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "ada.ipynb").write_text(notebook(HONEST[name]))
    if "magic" not in name:
        (folder / "ben.py").write_text(HONEST[name])
    for row in graded(folder).values():
        assert (float(row["points"]), row["note"]) == (3, ""), row


@pytest.mark.parametrize(
    "data",
    [
        b"\xef\xbb\xbf" + RIGHT.encode(),
        b"# coding: latin-1\n# M\xfcller\n" + RIGHT.encode("latin-1"),
    ],
    ids=["byte-order mark", "latin-1"],
)
def test_files_of_other_editors_are_read_as_python_reads_them(data, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "ada.py").write_bytes(data)
    assert float(graded(folder)["ada"]["points"]) == 3


WRITES = """import os
for k in range(3, 12):
    try:
        os.write(k, TEXT)
    except OSError:
        pass
"""
ASKS_ANOTHER_PYTHON = """import os, sys
def predict(*a):
    return os.popen(sys.executable + ' -c "print(1)"').read()
"""
READS_REFERENCES = """import slamlab
from pathlib import Path
text = (Path(slamlab.__file__).parent / 'exercises' / 'ch02_kalman_filter.py').read_text()
exec(text[text.index('def _predict'):text.index('check_predict =')])
predict = _predict
"""
CLIMBS_FRAMES = """import sys
def predict(*a):
    f = sys._getframe()
    while f:
        if hasattr(f.f_locals.get('self'), 'reference'):
            return f.f_locals['self'].reference(*a)
        f = f.f_back
"""
EMPTIES_OTHERS = """import glob
for name in glob.glob(PLACE + '/*.py'):
    open(name, 'w').write('')
"""
HOSTILE = {  # what is handed in, and the most that it may earn
    "a lone surrogate": ("raise ValueError('\\ud800')\n", 0),
    "rubbish in the pipe": (WRITES.replace("TEXT", "b'{}\\n'"), 0),
    "a flood": ("while True:\n" + textwrap.indent(WRITES.replace("TEXT", "b'x' * 10**6"), " "), 0),
    "the answers of another process": (ASKS_ANOTHER_PYTHON, 0),
    "the references on the disk": (READS_REFERENCES, 0),
    "the frame of the caller": (CLIMBS_FRAMES, 0),
    "the files of others": (EMPTIES_OTHERS, 0),
    "a child that stays": ("import os, time\nif os.fork() == 0:\n    time.sleep(60)\n", 0),
    "an end at exit": ("import atexit, os\natexit.register(lambda: os.write(1, b'bye'))\n", 0),
    "odd answers": ("def predict(*a):\n    return {1: object()}, float\n", 0.5),
}


def test_whatever_one_submission_does_the_others_keep_their_marks(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "ada.py").write_text(RIGHT)
    for number, (text, _) in enumerate(HOSTILE.values()):
        (folder / f"bad{number}.py").write_text(f"PLACE = {str(folder)!r}\n" + text)
    (folder / "zoe.py").write_text(RIGHT)
    rows = graded(folder, "--seconds", "2")
    assert float(rows["ada"]["points"]) == float(rows["zoe"]["points"]) == 3
    for number, (name, (_, most)) in enumerate(HOSTILE.items()):
        assert float(rows[f"bad{number}"]["points"]) <= most, name
    assert (folder / "zoe.py").read_text() == RIGHT
    assert "surrogate" not in rows["bad0"]["note"]
    assert "PermissionError" in rows["bad4"]["note"]


def test_names_of_real_life_have_a_page_each(tmp_path):
    folder = tmp_path / "in"
    (folder / "a").mkdir(parents=True)
    for name in ("a/b.py", "a_b.py", "=1+2.py"):
        (folder / name).write_text(RIGHT)
    odd = Path(os.fsdecode(os.fsencode(str(folder)) + b"/M\xfcller.py"))
    try:
        odd.write_text(RIGHT)
    except OSError:  # a file system that knows UTF-8 only
        (folder / "Mueller.py").write_text(RIGHT)
    rows = graded(folder)
    assert len(rows) == 4
    assert all(float(row["points"]) == 3 for row in rows.values())
    assert not any(name.startswith("=") for name in rows)
    assert len(list((tmp_path / "out" / "feedback").iterdir())) == 4


@pytest.mark.parametrize("words", [("--seconds", "-1"), ("--seconds", "nan"), ("--seconds", "0"),
                                   ("--megabytes", "0"), ("--jobs", "0")])  # fmt: skip
def test_senseless_limits_are_named(words, tmp_path, capsys):
    (tmp_path / "a.py").write_text(RIGHT)
    assert main(["grade", str(tmp_path), "--chapter", "02", *words]) == 1
    assert f"{words[0][2:]}: expected" in capsys.readouterr().err


def test_a_class_list_becomes_a_gradebook(tmp_path, capsys):
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "ada_123_02_kalman.py").write_text(RIGHT)
    (folder / "ada_123_02_second.py").write_text(START + PREDICT)
    (folder / "ben_02.py").write_text(START + PREDICT)
    (folder / "ben_01.py").write_text("")
    (folder / "ben.py").write_text("")
    roster = tmp_path / "class.csv"
    lines = "Ada L.,123,ada@x.org", "Ben K.,ben,b@x.org", "Eve,777,e@x.org"
    roster.write_text("\n".join(["\ufeffStudent,ID number,Email address", *lines, ""]))
    table = tmp_path / "marks.csv"
    words = ["--chapter", "01,02", "--roster", str(roster), "-o", str(table)]
    assert main(["grade", str(folder), *words]) == 0
    assert "1 of 3 without a submission" in capsys.readouterr().out
    with (tmp_path / "marks-gradebook.csv").open(encoding="utf-8") as file:
        ada, ben, eve = csv.DictReader(file)
    assert list(ada)[:3] == ["Student", "ID number", "Email address"]
    assert tuple(list(ada.values())[3:5]) == ("", "3.00")
    assert tuple(list(ben.values())[3:5]) == ("0.00", "1.00")
    assert (eve["slamlab 02 (of 6)"], eve["Feedback"]) == ("", "no file")
    with table.open(encoding="utf-8") as file:
        rows = {row["student"]: row for row in csv.DictReader(file)}
    assert rows["ben_02"]["02.predict"] == "1.00"
    assert "which chapter?" in rows["ben"]["note"]


TRACKER = """def track({mean}, cov, u, z, H, variances, dt, sigma):
    # {comment}
    means, covs = [], []
    for push, readings in zip(u, z):
        {mean}, cov = predict({mean}, cov, push, dt, sigma)
        for k in range(len(readings)):
            if np.isfinite(readings[k]):
                one = readings[k : k + 1], H[k : k + 1], variances[k : k + 1]
                {mean}, cov = update({mean}, cov, *one)
        means.append({mean}.copy())
        covs.append(1.0 * cov)
    return np.array(means), np.array(covs)
"""


def test_copies_are_named_and_cost_nothing(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    for name, mean, q in (("ada", "mean", ""), ("ben", "state", ""), ("eve", "mean", "1.0 * ")):
        code = TRACKER.format(mean=mean, comment=name).replace("push, dt", f"{q}push, dt")
        (folder / f"{name}.py").write_text(START + PREDICT + UPDATE + code)
    rows = graded(folder, "--no-pictures")
    assert rows["ada"]["note"] == "same code as ben: track"
    assert rows["ben"]["note"] == "same code as ada: track"
    assert rows["eve"]["note"] == ""
    assert len({row["points"] for row in rows.values()}) == 1


def test_what_a_notebook_asks_of_a_check_is_answered(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    asks = (
        "report = check_predict(lambda *_: ...)\nassert report.passed, report.text\n"
        "mark = report.held / report.total\nfigure = check_predict.draw(update)\n"
        "figure.savefig('mine.png')\nlist(report.rows)\n"
    )
    (folder / "ada.ipynb").write_text(notebook(START + UPDATE + "\n" + asks))
    (row,) = graded(folder, "--no-pictures").values()
    assert (float(row["update"]), row["note"]) == (1, "")


def test_the_published_solution_is_nobodys_copy(tmp_path):
    folder = tmp_path / "in"
    for name in ("ada", "ben"):
        (folder / name).mkdir(parents=True)
        shutil.copy(SOLUTION, folder / name / "02.ipynb")
    assert {row["note"] for row in graded(folder, "--no-pictures").values()} == {""}


def test_one_wrong_entry_of_fourteen_is_not_nothing(tmp_path):
    """The derivative of the range by the heading is wrong everywhere."""
    folder = tmp_path / "in"
    folder.mkdir()
    source = SOLUTION.with_name("09_ekf_slam.ipynb").read_text(encoding="utf-8")
    cells = [c for c in json.loads(source)["cells"] if c["cell_type"] == "code"]
    (code,) = ("".join(c["source"]) for c in cells if "def jacobian(" in "".join(c["source"]))
    right = "import numpy as np\n\n\n" + code.split("\n\ncheck_")[0] + "\n"
    own = right.replace("def jacobian(", "def own(")
    wrong = "\n\ndef jacobian(*given):\n    H = own(*given)\n    H[{at}] += 1\n    return H\n"
    (folder / "right.py").write_text(right)
    (folder / "one.py").write_text(own + wrong.format(at="0, 2"))
    (folder / "all.py").write_text(own + wrong.format(at=":"))
    rows = graded(folder, "--chapter", "09")
    share = {name: float(row["jacobian"]) for name, row in rows.items()}
    assert share["right"] == 1
    assert 0.35 < share["one"] < 0.5, "thirteen of fourteen numbers, counted half"
    assert share["all"] == 0
    page = (tmp_path / "out" / "feedback" / "one.html").read_text(encoding="utf-8")
    assert "93 % of the numbers are right everywhere" in page
    assert page.count("data:image/png") == 1


def test_a_picture_of_a_function_that_never_ends_costs_nobody_anything(tmp_path, monkeypatch):
    """The check is passed, the picture is not: the exercise counts, and the next one too."""
    monkeypatch.setattr(_submission, "_SECONDS_TO_DRAW", 2.0)
    folder = tmp_path / "in"
    folder.mkdir()
    tried = len(_submission.checks_of("02")["update"].inputs)
    calls = "\ncalls = []\n\n\ndef update(*arguments):\n    calls.append(1)\n"
    ends = f"    while len(calls) > {tried}:\n        pass\n    return right(*arguments)\n"
    (folder / "ada.py").write_text(
        START + UPDATE.replace("def update", "def right") + calls + ends
    )
    (row,) = graded(folder, "--seconds", "5").values()
    assert float(row["update"]) == 1
    assert row["note"] == "update: its picture could not be finished"


ROSTERS = {  # the head and lines of an export, and the path of a hand-in of its first student
    "Moodle, grades": (
        "First name,Last name,ID number,Institution,Email address\n"
        "Ada,Lovelace,,Uni,ada@x.org\nAda,Byron,,Uni,byron@x.org\n",
        "Ada Lovelace_5318_assignsubmission_file/02.py",
    ),
    "Moodle, worksheet": (
        "Identifier,Full name,Email address,Status\n"
        "Participant 5318,Ada Lovelace,ada@x.org,Submitted\n"
        "Participant 5319,Ben K,ben@x.org,Submitted\n",
        "Ada Lovelace_5318_assignsubmission_file_02.py",
    ),
    "Moodle, with semicolons": (
        "First name;Last name;ID number;Email address\n"
        "Ada;Lovelace;b1234;ada@x.org\nBen;K;b1235;ben@x.org\n",
        "b1234/02_kalman.py",
    ),
    "Canvas": (
        "Student,ID,SIS User ID,SIS Login ID,Section\n"
        "    Points Possible,,,,\n"
        '"Lovelace, Ada",7001,s1,ada,SLAM 2027\n"K, Ben",7002,s2,ben,SLAM 2027\n',
        "lovelaceada_7001_9912_02_kalman.py",
    ),
}


@pytest.mark.parametrize("name", ROSTERS)
def test_the_exports_of_moodle_and_canvas_come_back_with_points(name, tmp_path, capsys):
    text, path = ROSTERS[name]
    file = tmp_path / "in" / path
    file.parent.mkdir(parents=True)
    file.write_text(RIGHT)
    (tmp_path / "class.csv").write_text(text)
    words = ["--chapter", "02", "--roster", str(tmp_path / "class.csv"), "--no-pictures"]
    assert main(["grade", str(tmp_path / "in"), *words, "-o", str(tmp_path / "marks.csv")]) == 0
    assert "1 of " in capsys.readouterr().out
    with (tmp_path / "marks-gradebook.csv").open(encoding="utf-8") as table:
        *own, ada, ben = csv.DictReader(table)
    assert (ada["slamlab 02 (of 6)"], ben["slamlab 02 (of 6)"]) == ("3.00", "")
    assert ("Feedback" in ada) == (name != "Canvas")
    assert [line["slamlab 02 (of 6)"] for line in own] == (["6"] if name == "Canvas" else [])


def test_a_word_that_two_lines_share_gives_no_points_to_either(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "ada_02.py").write_text(RIGHT)
    (tmp_path / "class.csv").write_text("First name,Last name\nAda,Lovelace\nAda,Byron\n")
    words = ["--chapter", "02", "--roster", str(tmp_path / "class.csv"), "--no-pictures"]
    assert main(["grade", str(tmp_path / "in"), *words, "-o", str(tmp_path / "marks.csv")]) == 0
    with (tmp_path / "marks-gradebook.csv").open(encoding="utf-8") as table:
        assert {row["Feedback"] for row in csv.DictReader(table)} == {"no file"}


def test_no_points_come_without_a_reason_in_the_row(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "ada.py").write_text("x = 1\n")
    (folder / "ben.py").write_text("def predict(*a):\n    return undefined\n")
    (folder / "eve.py").write_text("def predict(*a):\n    ...\n")
    (folder / "zoe.py").write_text("def predict(*a):\n    return 7, 7\n")
    rows = graded(folder, "--no-pictures")
    names = "predict, update, cov_after_update, tunnel, innovation_test, track"
    assert rows["ada"]["note"] == f"defines none of {names}"
    assert rows["eve"]["note"].startswith("predict: nothing returned yet")
    assert rows["zoe"]["note"] == "predict: nothing holds"
    assert rows["ben"]["note"].startswith("predict: raised on every input, first NameError: ")


def test_copies_of_a_whole_class_are_one_line():
    prints = {f"s{k}": {"track": "one", "predict": "two"} for k in range(7)} | {
        "eve": {"track": "x"}
    }
    told = same_code(prints)
    assert told["s0"] == ["same code as s1, s2, s3 and 3 more: track, predict"]
    assert "eve" not in told
    assert same_code({"a": {"f": "1"}, "b": {"f": "1"}}, ["1"]) == {}
