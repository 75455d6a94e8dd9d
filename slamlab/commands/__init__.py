"""The command line, ``python -m slamlab COMMAND ...``: a command is one file of this room.

The file ``name.py`` is the command `name`; files that begin with an underscore help the others.
The first sentence of its docstring is its help. It has `arguments(parser)`, which declares what
it takes, and `run(options)`, which prints what it found and, where it cannot go on, raises a
ValueError, OSError or ImportError whose message is a sentence for the user.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from slamlab import __version__

__all__ = ["main"]

# Calls that the help of a command ends with; the first one of each stands in the help of all.
EXAMPLES = {
    "grade": (
        "grade submissions/ --chapter 02",
        "grade submissions/ --chapter 02,09 --roster class.csv -o marks.csv",
        "grade submissions/ --chapter 09 --variant 2027",
    ),
    "graph": ("graph court.g2o -o court/", "graph court.g2o --kernel huber"),
    "handout": ("handout 01 02 --to week1/",),
    "lab": ("lab III my_slam.py", "lab I my_tracker.ipynb --seed 7"),
    "map": (
        "map drive.log.gz -o mymap/",
        "map drive.bag --method hector --resolution 0.1",
        "map later.log.gz --localize mymap/ -o later/",
        "map later.log.gz --resume mymap/ -o both/",
    ),
    "warm": ("warm",),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; print its answer, or one sentence on why there is none.

    Parameters
    ----------
    argv : sequence of str, optional
        Words after the program's name; those of the process by default.

    Returns
    -------
    int
        0 if all went well, 1 if the command could not do its work, 130 if it was interrupted.
        Wrong words on the command line end in SystemExit with 2, as argparse does it.
    """
    try:
        options = _parser().parse_args(argv)
    except KeyboardInterrupt:
        print("slamlab: interrupted", file=sys.stderr)
        return 130
    try:
        with warnings.catch_warnings(record=True) as noted:
            warnings.simplefilter("always", UserWarning)
            options.run(options)
        for text in dict.fromkeys(str(note.message) for note in noted):
            print(f"slamlab {options.command}: note: {text}", file=sys.stderr)
    except (ValueError, OSError, ImportError, MemoryError) as error:
        sentence = str(error) or type(error).__name__
        print(f"slamlab {options.command}: {sentence}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"slamlab {options.command}: interrupted", file=sys.stderr)
        return 130
    return 0


@cache
def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m slamlab",
        description="Maps, graphs and marks from the command line.",
        epilog=_examples(*(calls[0] for calls in EXAMPLES.values())),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"slamlab {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in iter_modules(__path__):
        if module.name.startswith("_"):
            continue
        command = import_module(f"{__name__}.{module.name}")
        text = (command.__doc__ or "").strip()
        added = commands.add_parser(
            module.name,
            help=text.split("\n")[0],
            description=text,
            epilog=_examples(*EXAMPLES.get(module.name, ())),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.arguments(added)
        added.set_defaults(run=command.run)
    return parser


def _examples(*calls: str) -> str:
    """Words for the end of a help."""
    return "\n".join(["examples:", *(f"  python -m slamlab {call}" for call in calls)])
