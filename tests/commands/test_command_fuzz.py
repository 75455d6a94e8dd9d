"""Every command, called with words and files that it cannot use: a sentence, never a traceback.

Generated from the parser: whoever adds a command or an option is tried with what others were.
"""

import argparse

import pytest

from slamlab.commands import _parser, lab, main
from slamlab.exercises.labs import tasks

COMMANDS = next(
    action.choices
    for action in _parser()._actions
    if isinstance(action, argparse._SubParsersAction)
)
WORDS = (
    "",
    " ",
    "nan",
    "-inf",
    "1e400",
    "-1",
    "0",
    "99",
    "\0",
    "x" * 300,
    "ä/\n",
    "../..",
    "None",
)
FILES = {
    "empty.g2o": b"",
    "bytes.g2o": bytes(range(256)) * 4,
    "words.g2o": b"EDGE_SE2 0 1 nan nan nan 1 0 0 1 0 1\n",
    "huge.g2o": b"VERTEX_SE2 0 1e308 -1e308 9e99\nEDGE_SE2 0 0 1 0 0 1 0 0 1 0 1\n",
    "empty.log": b"",
    "bytes.log": bytes(range(255, -1, -1)) * 4,
    "short.log": b"FLASER 3 1.0 2.0\n",
    "no.npz": b"PK\x03\x04 and nothing more",
    "no.bag": b"#ROSBAG V2.0\n",
    "no.py": b"def f(:\n",
    "no.ipynb": b'{"cells": 3}',
    "list.ipynb": b"[1, 2]",
    "deep.ipynb": b"[" * 100_000,
    "deep.py": b"x = " + b"(" * 100_000,
}


def heard(words, capsys):
    """What is wrong with the answer to these words, or None."""
    try:
        code = main(words)
    except SystemExit as stop:
        code = stop.code
    except BaseException as error:
        return f"{words}: {type(error).__name__}: {error}"[:300]
    told = capsys.readouterr()
    if code not in (0, 1, 2) or "Traceback" in told.err:
        return f"{words}: ended with {code}: {told.err[-200:]}"
    if code and not told.err.strip():
        return f"{words}: failed and said nothing"
    return f"{words}: too long a sentence" if code == 1 and len(told.err) > 1000 else None


def places(name, word):
    """The words of a command with one bad word at each of its places in turn."""
    actions = [a for a in COMMANDS[name]._actions if not isinstance(a, argparse._HelpAction)]
    needed = [a for a in actions if a.required]
    for bad in [a for a in actions if a.nargs != 0]:
        words = [name]
        for action in {id(a): a for a in (*needed, bad)}.values():
            value = word if action is bad else action.choices[0] if action.choices else "nowhere"
            words += [action.option_strings[-1], value] if action.option_strings else [value]
        yield words


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "warm"])
def test_bad_words_and_files_end_in_a_sentence(
    name, tmp_path, monkeypatch, capsys, record_property
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(lab, "tasks", lambda *given: tasks(*given)[:1])
    (tmp_path / "folder").mkdir()
    for file, content in FILES.items():
        (tmp_path / file).write_bytes(content)
    tried = [w for word in (*WORDS, "folder", *FILES) for w in places(name, word)]
    record_property("calls", len(tried))
    assert len(tried) > 40
    assert [wrong for words in tried if (wrong := heard(words, capsys))] == []
