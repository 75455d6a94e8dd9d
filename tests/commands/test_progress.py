"""How far a run is: short runs say nothing in a file, long ones a line each tenth."""

import io

import numpy as np
import pytest

from slamlab.commands import main
from slamlab.commands._progress import Progress
from slamlab.evaluation import run
from slamlab.localization import DeadReckoning
from slamlab.logs import Log
from slamlab.robots import Unicycle


class Screen(io.StringIO):
    def isatty(self):
        return True


def written(seconds_each, total=200, stream=None):
    """Everything that is written about so many steps of so many seconds each."""
    now = [0.0]
    stream = io.StringIO() if stream is None else stream
    progress = Progress("scans", stream, lambda: now[0])
    for done in range(1, total + 1):
        now[0] += seconds_each
        progress(done, total)
    return stream.getvalue()


def test_a_short_run_leaves_a_file_empty_and_a_long_one_gets_a_line_each_tenth():
    assert written(0.02) == ""
    lines = written(1.0).splitlines()
    assert len(lines) == 9
    assert lines[0] == "20 of 200 scans, 10 %, about 3 min left"
    assert lines[-1] == "180 of 200 scans, 90 %, about 20 s left"
    assert written(90.0).splitlines()[0].endswith("about 4 h 30 min left")
    assert len(written(1.0, total=3).splitlines()) <= 2


def test_on_a_terminal_one_line_renews_itself_and_goes_at_the_end():
    text = written(0.1, stream=Screen())
    assert "\n" not in text
    assert text.endswith("\r\x1b[K")
    assert 60 <= text.count("\r") <= 110  # at most five times a second of twenty


def test_a_run_counts_its_steps_for_whoever_asks():
    log = Log(np.arange(4.0), np.ones((4, 2)), 1.0, np.eye(2))
    seen = []
    run(DeadReckoning(Unicycle(), [0, 0, 0]), log, progress=lambda *at: seen.append(at))
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_the_help_of_map_says_what_each_method_does_and_all_units(capsys):
    with pytest.raises(SystemExit):
        main(["map", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    for words in ("metres", "degrees", "m/s, rad/s", "hector: each scan", "odometry: the wheels"):
        assert words in text
