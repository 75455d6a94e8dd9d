"""The command line: every command is listed and explained, and failure is a sentence."""

import subprocess
import sys

import pytest

from slamlab.commands import main


def test_the_help_lists_every_command(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    assert "Optimise a pose graph" in capsys.readouterr().out


@pytest.mark.parametrize("words", [[], ["grraph"], ["graph"], ["graph", "x.g2o", "--speed"]])
def test_wrong_words_end_with_the_usage(capsys, words):
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    assert "usage: python -m slamlab" in capsys.readouterr().err


def test_a_failure_is_one_sentence_and_exit_code_1(tmp_path):
    words = [sys.executable, "-m", "slamlab", "graph", str(tmp_path / "nowhere.g2o")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("slamlab graph: ")
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1
