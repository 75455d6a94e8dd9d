"""The command line: every command is listed and explained, and failure is a sentence."""

import subprocess
import sys

import pytest

import slamlab
from slamlab.commands import EXAMPLES, _parser, main


def test_the_help_lists_every_command(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    assert "Optimise a pose graph" in capsys.readouterr().out


def test_the_version_is_said(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--version"])
    assert stop.value.code == 0
    assert capsys.readouterr().out == f"slamlab {slamlab.__version__}\n"


@pytest.mark.parametrize("command", [None, *EXAMPLES])
def test_a_help_ends_with_examples_and_each_of_them_is_understood(command, capsys):
    with pytest.raises(SystemExit):
        main([command, "--help"] if command else ["--help"])
    _, _, examples = capsys.readouterr().out.partition("examples:\n")
    calls = [line.strip().removeprefix("python -m slamlab ") for line in examples.splitlines()]
    assert calls
    for call in calls:
        options = _parser().parse_args(call.split())
        assert options.command == (command or call.split()[0])
    with pytest.raises(SystemExit):
        _parser().parse_args([*calls[0].split(), "--no-such-option"])


def test_every_command_has_an_example():
    (commands,) = (a.choices for a in _parser()._actions if a.dest == "command")
    assert set(commands) == set(EXAMPLES)


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
