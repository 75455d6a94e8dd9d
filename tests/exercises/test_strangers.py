"""What strangers hand in: no wrong answer passes, most are named, and none by a wrong name.

`strangers.txt` holds them, one a line, as a student writes them; nobody made them by a tool.
"""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from test_checks import CHECKS

from slamlab.geometry import compose, rotation, wrap_angle

FILE = Path(__file__).with_name("strangers.txt")
LINES = [line for line in FILE.read_text().splitlines() if line and not line.startswith("#")]
ROWS = [tuple(line.split(" | ", 2)) for line in LINES]


def handed_in(name, code):
    """The stranger's function; `ok` gives a right answer."""
    known = {"np": np, "wrap": wrap_angle, "compose": compose, "rotation": rotation}
    known["log_odds"] = lambda p: np.log(np.asarray(p) / (1 - np.asarray(p)))
    return eval(code, known | {"ok": CHECKS[name].reference})


def answered(name, code):
    """Passed or not, and what was named beside an argument that was changed."""
    report = CHECKS[name].judge(CHECKS[name].observe(handed_in(name, code)))
    return report.passed, " ".join(report.messages)


@pytest.mark.parametrize("check", sorted({name for name, _, _ in ROWS}))
def test_no_stranger_passes_and_none_is_named_wrongly(check):
    for name, said, code in ROWS:
        if name == check:
            passed, named = answered(name, code)
            assert not passed, code
            pieces = [piece.strip() for piece in said.split("/")]
            right = not named if pieces == ["-"] else any(p in named for p in pieces if p != "-")
            assert right or (not named and "-" in pieces), (code, named)


def test_there_are_three_hundred_and_every_chapter_has_some():
    assert len(set(LINES)) == len(LINES) >= 300
    per_chapter = Counter(name[:4] for name, _, _ in ROWS)
    chapters = {name[:4] for name in CHECKS}
    assert all(per_chapter[chapter] >= 7 for chapter in chapters)


def test_six_of_ten_are_named():
    named = sum(said.strip() != "-" for _, said, _ in ROWS)
    assert named >= 0.6 * len(ROWS)
