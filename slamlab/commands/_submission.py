"""Run one submission in a process of its own: ``python -m slamlab.commands._submission``.

The process loads the checks, hides them, executes what the student handed in, tries each
function on the inputs and writes what it observed, one line an exercise. Nothing is judged here,
so that a submission that changes the checks changes nothing.
"""

from __future__ import annotations

import ast
import builtins
import json
import signal
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import slamlab.exercises
from slamlab.exercises import Check, Observation

__all__ = ["cells_of", "checks_of", "decoded", "limit_memory", "refusals"]

OPEN = {"Check", "Report", "*", "labs", "lab_scores", "Setting", "practice", "practise"}
UNNEEDED = {"gc", "inspect", "ctypes", "importlib", "runpy", "subprocess", "multiprocessing"}
HIDDEN = ("slamlab/exercises", "solutions/", "/proc")
INSIDE = {"_getframe", "modules", "settrace", "__globals__", "__subclasses__", "__code__"}


def _chapters() -> list[str]:
    from pkgutil import iter_modules

    names = [module.name for module in iter_modules(slamlab.exercises.__path__)]
    return [name for name in names if not name.startswith("_")]


def checks_of(chapter: str) -> dict[str, Check]:
    """Return the checks of a chapter, by the name of the function that each one tries."""
    from importlib import import_module

    names = _chapters()
    found = [name for name in names if name.startswith(f"ch{chapter}_")]
    if not found:
        have = ", ".join(name[2:4] for name in names if name.startswith("ch"))
        raise ValueError(f"chapter: expected one of {have}, got {chapter}")
    module = import_module(f"slamlab.exercises.{found[0]}")
    checks = [value for value in vars(module).values() if isinstance(value, Check)]
    return {check.name: check for check in checks}


def cells_of(path: Path) -> list[str]:
    """Return the code of a file: the cells of a notebook, or all of a Python file.

    Raises
    ------
    ValueError
        If it is no text, or a notebook that is none.
    """
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return [text]
    try:
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
        sources = ["".join(cell["source"]) for cell in cells]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(f"{path.name}: expected a notebook ({reason:.80})") from error
    return ["\n".join(_plain_line(line) for line in source.split("\n")) for source in sources]


def _plain_line(line: str) -> str:
    return "" if line.lstrip().startswith(("%", "!")) else line


def refusals(cells: list[str], closed: Sequence[str] = ()) -> list[str]:
    """Say what in a submission is no answer: references, checks or the interpreter touched.

    `closed` are rooms of the library that are not to be used either.
    """
    said = []
    for cell in cells:
        try:
            tree = ast.parse(cell)
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            continue  # it will be said when the cell is run
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                module = node.module or ""
                names = [f"{module}.{alias.name}" for alias in node.names]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.Attribute):
                text = ast.unparse(node)
                said += [f"uses {text}"] if node.attr in INSIDE or text in closed else []
                continue
            elif isinstance(node, ast.Name):
                said += [f"uses {node.id}"] if node.id == "__import__" else []
                continue
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                hidden = any(place in node.value for place in HIDDEN)
                said += [f"opens {node.value}"] if hidden else []
                continue
            else:
                continue
            shut = [
                name for name in names if f"{name}.".startswith(tuple(f"{r}." for r in closed))
            ]
            said += [f"imports {name}" for name in names if _forbidden(name) or name in shut]
    return list(dict.fromkeys(said))


def _forbidden(name: str) -> bool:
    parts = name.split(".")
    if parts[0] in UNNEEDED:
        return True
    if parts[:2] != ["slamlab", "exercises"] or len(parts) == 2:
        return False
    last = parts[-1]
    return not (last.startswith(("check_", "ch")) or last in OPEN)


class _Closed(ModuleType):
    """A module of exercises as a submission sees it: checks that do nothing, and no answers."""

    touched: list[str] = []

    def __getattr__(self, name: str) -> Any:
        if name.startswith("check_"):
            return lambda *_: None
        if name.startswith("__"):
            raise AttributeError(name)
        if name.startswith("ch"):
            return sys.modules[f"{self.__name__}.{name}"]
        self.touched.append(f"asks for {self.__name__}.{name}")
        raise AttributeError(f"{name} is no part of the exercise")

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("__"):
            self.touched.append(f"changes {self.__name__}.{name}")
        super().__setattr__(name, value)


def _close() -> None:
    room = "slamlab.exercises"
    inside = [name for name in sys.modules if name.startswith(f"{room}.")]
    for name in [*inside, *(f"{room}.{chapter}" for chapter in _chapters()), room]:
        closed = _Closed(name)
        closed.__path__ = []
        sys.modules[name] = closed
    vars(slamlab)["exercises"] = sys.modules[room]


class _TooLongError(BaseException):
    """Time is up; no `except Exception` of a student catches it."""


def _limited(seconds: float, work: Callable[[], Any]) -> Any:
    """Do some work, for so long at most."""

    def ring(*_: Any) -> None:
        raise _TooLongError

    if not hasattr(signal, "SIGALRM"):  # Windows: the limit of the whole process remains
        return work()
    signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        return work()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _executed(cell: str, space: dict[str, Any]) -> None:
    exec(compile(cell, "submission", "exec"), space)


def limit_memory(size: int) -> None:
    """Let this process take so many bytes at most; Windows knows no such limit."""
    try:
        import resource
    except ImportError:  # Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (size, size))


def main(file: str, chapter: str, output: str, seconds: str, megabytes: str) -> None:
    """Execute a submission and write what was observed, one JSON line an exercise."""
    checks, limit = checks_of(chapter), float(seconds)
    looks = {name: check.observe for name, check in checks.items()}
    for check in checks.values():
        check.inputs  # noqa: B018 (drawn before anything of the student runs)
    limit_memory(int(megabytes) * 2**20)
    sys.argv = [file]
    _close()
    cells = cells_of(Path(file))
    space: dict[str, Any] = {"__name__": "submission", "__builtins__": builtins}
    with open(output, "w", encoding="utf-8") as lines:

        def write(**what: Any) -> None:
            lines.write(json.dumps(what) + "\n")
            lines.flush()

        for number, cell in enumerate(cells, start=1):
            try:
                _limited(limit, partial(_executed, cell, space))
            except _TooLongError:
                write(note=f"cell {number} did not end within {limit:g} s")
            except BaseException as error:
                write(note=f"cell {number} raised {type(error).__name__}: {error}")
        for name, observe in looks.items():
            if not callable(space.get(name)):
                continue
            try:
                seen = _limited(limit, partial(observe, space[name]))
                write(exercise=name, seen=[encoded(vars(one)) for one in seen])
            except _TooLongError:
                write(exercise=name, note=f"it did not end within {limit:g} s")
            except BaseException as error:
                write(exercise=name, note=f"it stopped with {type(error).__name__}: {error}")
        for text in dict.fromkeys(_Closed.touched):
            write(cheat=text)
        write(done=True)


def encoded(value: Any) -> Any:
    """Turn plain data into what JSON can say."""
    if isinstance(value, dict):
        return {key: encoded(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "c":
            return repr(value)
        return {"array": value.tolist(), "shape": list(value.shape)}
    if isinstance(value, tuple):
        return {"tuple": [encoded(entry) for entry in value]}
    if isinstance(value, list):
        return [encoded(entry) for entry in value]
    return value if isinstance(value, (bool, int, float, str, type(None))) else repr(value)


def decoded(seen: list[dict[str, Any]]) -> list[Observation]:
    """Turn what a submission's process wrote into observations again."""
    return [Observation(**{key: _plain(value) for key, value in one.items()}) for one in seen]


def _plain(value: Any) -> Any:
    if isinstance(value, dict) and "array" in value:
        return np.array(value["array"]).reshape(value["shape"])
    if isinstance(value, dict):
        return tuple(_plain(entry) for entry in value["tuple"])
    return [_plain(entry) for entry in value] if isinstance(value, list) else value


if __name__ == "__main__":
    main(*sys.argv[1:])
