"""Stored trials: runs over many seeds that are made apart from the pages. All tools share this.

make trials                                 (every run again; many hours)
python tools/trials.py [OPTION ...] [TRIAL ...]
python tools/range_trial.py [OPTION ...]    (one trial; all tools of trials take the same options)

Without an option every run is made again and stored. With --missing only those that are not
stored yet. With --again a sample is made again (with --runs N: N runs by lot), compared with what
is stored, and nothing is written; exits with 1 if a run differs.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
import linecache
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
DATA = ROOT / "slamlab" / "datasets" / "data"
# The tools of the trials, by the name of what they store.
TOOLS = {
    "ambiguous_closures": "ambiguous_closures",
    "certificates": "certificates",
    "court_drifts": "court_drifts",
    "expeditions": "expeditions",
    "fast_rounds": "fast_rounds",
    "grid_logs": "grid_table",
    "grid_loops": "grid_loops",
    "killian_walls": "killian_walls",
    "league": "league",
    "lesson_tables": "lesson_tables",
    "long_way": "long_way",
    "matching": "matching_table",
    "orchard": "orchard",
    "orchard_returns": "orchard_returns",
    "park_fitted": "park_fitted",
    "park_start": "park_start",
    "park_twins": "park_twins",
    "path_fits": "path_fits",
    "picture_flights": "picture_flights",
    "printed_formulas": "printed_formulas",
    "range_trial": "range_trial",
    "return_variants": "return_variants",
    "rough_ground": "rough_ground",
    "short_range": "short_range",
    "signatures": "signatures",
    "slip": "slip",
    "start_heading": "start_heading",
    "tilted_flights": "tilted_flights",
    "time_updates": "time_updates",
    "victoria_park": "victoria_park",
}


@dataclass(frozen=True)
class Trial:
    """Rows of runs: two words name a row, and each of its seeds gives one run.

    Parameters
    ----------
    name : str
        Of the file, slamlab/datasets/data/NAME.json: first word, second word, list of runs in the
        order of their seeds.
    rows : dict
        Seeds by row.
    one : function
        ``one(first, second, seed)`` makes a run: numbers, or lists of numbers, by name.
    sample : tuple
        (first, second, seed) of the runs that the unit tests make again.
    rel, off : float
        How far a number may be off the stored one: by this share, or by this much.
    needs_data : tuple
        First words whose logs are in the folder SLAMLAB_DATA.
    machine : tuple
        Numbers that depend on the computer: stored and not compared.
    finish : function
        Is called after runs were stored.
    """

    name: str
    rows: Mapping[tuple[str, str], Sequence[int]]
    one: Callable[[str, str, int], dict]
    sample: tuple[tuple[str, str, int], ...]
    rel: float = 0.02
    off: float = 0.0
    needs_data: Sequence[str] = ()
    machine: tuple[str, ...] = ()
    finish: Callable[[], object] = lambda: None

    @property
    def path(self) -> Path:
        """The file of the stored runs."""
        return DATA / f"{self.name}.json"

    def read(self) -> dict[str, dict[str, list[dict]]]:
        """Read what is stored: runs in the order of their seeds, by the words of the row."""
        return json.loads(self.path.read_text()) if self.path.exists() else {}

    def stored(self, first: str, second: str, seed: int) -> dict | None:
        """Give one stored run; None if there is none."""
        runs = self.read().get(first, {}).get(second, [])
        place = self.rows[first, second].index(seed)
        return runs[place] if place < len(runs) else None

    def write(self, first: str, second: str, seed: int, run: dict) -> None:
        """Put a run in its place; other processes wait meanwhile."""
        import fcntl  # which Windows lacks

        place = self.rows[first, second].index(seed)
        with open(Path(tempfile.gettempdir(), f"{self.name}.lock"), "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            stored = self.read()
            runs = stored.setdefault(first, {}).setdefault(second, [])
            if place > len(runs):
                raise ValueError(f"seed: expected the runs before seed {seed} to be stored")
            runs[place : place + 1] = [run]
            new = self.path.with_suffix(".new")
            new.write_text(text_of(stored))
            new.replace(self.path)  # who reads meanwhile has the old file or the new one, whole

    def runs(self) -> Iterator[tuple[str, str, int]]:
        """Give all runs, seed after seed, so that rows grow together."""
        longest = max(len(seeds) for seeds in self.rows.values())
        for place in range(longest):
            for (first, second), seeds in self.rows.items():
                if place < len(seeds):
                    yield first, second, seeds[place]

    def differences(self, first: str, second: str, seed: int) -> list[str]:
        """Make a run again; give the numbers that differ from the stored ones."""
        old, new = self.stored(first, second, seed), self.one(first, second, seed)
        if old is None:
            return [f"{first}, {second}, seed {seed}: nothing is stored"]
        return [
            f"{first}, {second}, seed {seed}: {key} {new.get(key)}, stored {old[key]}"
            for key in old
            if key not in self.machine and not self.equal(old[key], new.get(key))
        ]

    def equal(self, old: object, new: object) -> bool:
        """Whether two numbers, or lists of them, are the same within the tolerance."""
        if old is None or new is None:
            return old is new
        old, new = np.array(old, float), np.array(new, float)
        return old.shape == new.shape and np.allclose(new, old, self.rel, self.off, equal_nan=True)


def text_of(stored: dict) -> str:
    """JSON with one run a line."""
    return json.dumps(stored, separators=(",", ":")).replace("},{", "},\n{") + "\n"


def of_page(name: str, *constants: str) -> dict:
    """Give the functions of a page, its constants in capitals (two or more), and others by name.

    Nothing else of it is run. So what a page shows is what a trial runs.
    """
    path = ROOT / "notebooks" / f"{name}.ipynb"
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    defines = ast.Import, ast.ImportFrom, ast.FunctionDef, ast.ClassDef
    kept = [
        node
        for node in ast.parse(code).body
        if isinstance(node, defines)
        or isinstance(node, ast.Assign)
        and any(
            isinstance(n, ast.Name) and (n.id in constants or len(n.id) > 1 and n.id.isupper())
            for n in ast.walk(node.targets[0])
        )
    ]
    names: dict = {}
    source = f"<{name}>"
    # So that `inspect`, and with it `changed`, finds the text of the functions.
    linecache.cache[source] = len(code), None, code.splitlines(keepends=True), source
    exec(compile(ast.Module(kept, []), source, "exec"), names)
    return names


def load(name: str) -> Trial:
    """Give a trial by its name."""
    return importlib.import_module(f"tools.{TOOLS[name]}").TRIAL


def work(trial: Trial, options: argparse.Namespace, deadline: float) -> list[str]:
    """Make the runs of one trial that are asked for; give what differs from what was stored."""
    left_out = () if "SLAMLAB_DATA" in os.environ else trial.needs_data
    if left_out:
        print(f"{trial.name}: left out, as SLAMLAB_DATA is not set: {', '.join(left_out)}")
    asked = [
        run
        for run in (trial.sample if options.again and not options.runs else trial.runs())
        if all(word in run[:2] for word in options.row)
        and run[0] not in left_out
        and not (options.missing and trial.stored(*run) is not None)
    ]
    if options.again and options.runs:
        held = [run for run in asked if trial.stored(*run) is not None]
        lot = np.random.default_rng().permutation(len(held))[: options.runs]
        asked = [held[i] for i in sorted(lot)]
    found = []
    for run in asked:
        if time.time() > deadline:
            print(f"{trial.name}: stopped, the minutes are over")
            break
        if options.again:
            differs = trial.differences(*run)
            found += differs
            print(trial.name, *run, "differs" if differs else "as stored", flush=True)
        else:
            new = trial.one(*run)
            trial.write(*run, new)
            print(trial.name, *run, new, flush=True)
    if asked and not options.again:
        trial.finish()
    return found


def main(*trials: Trial) -> int:
    """Run the trials given, or those named on the command line."""
    parser = argparse.ArgumentParser(description="Make stored trials again")
    if not trials:
        parser.add_argument("trials", nargs="*", metavar="TRIAL", help=", ".join(TOOLS))
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--again", action="store_true", help="compare a sample, write nothing")
    which.add_argument("--missing", action="store_true", help="only what is not stored yet")
    parser.add_argument("--runs", type=int, help="with --again: so many runs by lot")
    parser.add_argument("--row", nargs="+", default=[], help="only rows with these words")
    parser.add_argument("--minutes", type=float, default=1e9, help="begin no run after these")
    options = parser.parse_args()
    if options.runs is not None and (not options.again or options.runs < 1):
        parser.error("expected --runs with --again, and at least 1")
    if not trials:
        unknown = set(options.trials) - set(TOOLS)
        if unknown:
            parser.error(f"expected names of {', '.join(TOOLS)}, got {', '.join(unknown)}")
        trials = tuple(load(name) for name in options.trials or TOOLS)
    deadline = time.time() + 60 * options.minutes
    differs = [line for trial in trials for line in work(trial, options, deadline)]
    for line in differs:
        print(line)
    return int(bool(differs))


if __name__ == "__main__":
    from tools.trials import main as start  # the module that the tools import, not this copy

    sys.exit(start())
