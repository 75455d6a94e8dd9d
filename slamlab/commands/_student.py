"""The process of a submission: ``python -m slamlab.commands._student``, asked by `_process`.

It executes the cells that it is sent and does what it is asked, with a time limit for each cell.
Nothing is judged here, and no reference, check or truth ever comes here.
"""

from __future__ import annotations

import importlib.abc
import json
import os
import pickle
import signal
import struct
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib.machinery import ModuleSpec
from io import BytesIO
from types import ModuleType
from typing import Any, NoReturn

import numpy as np

__all__: list[str] = []

# What a submission does not need: other processes, signals to them.
PROCESSES = (
    "os.exec", "os.fork", "os.forkpty", "os.kill", "os.killpg", "os.posix_spawn", "os.spawn",
    "os.startfile", "os.system", "pty.spawn", "subprocess.Popen",
)  # fmt: skip
# Modules whose every public name does nothing in a submission.
OPEN = ("slamlab.exercises.capstone", "slamlab.exercises.lab_pictures")
PATHS = (
    "open", "os.chmod", "os.chown", "os.link", "os.listdir", "os.mkdir", "os.remove", "os.rename",
    "os.rmdir", "os.scandir", "os.symlink", "os.truncate", "shutil.copyfile", "shutil.rmtree",
)  # fmt: skip


class _TooLongError(BaseException):
    """Time is up; no `except Exception` of a student catches it."""


class _NoAnswers(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Checks that do nothing in place of the exercises; closed subpackages cannot be imported."""

    def __init__(self, closed: Sequence[str]) -> None:
        self.closed = tuple(closed)

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Answer for the exercises' modules; refuse closed subpackages."""
        if name.startswith(("slamlab.exercises.ch", *OPEN)):
            return ModuleSpec(name, self)
        if f"{name}.".startswith(tuple(f"{room}." for room in self.closed)):
            raise ImportError(f"{name} is not to be used here: it is what you are asked to write")
        return None

    def exec_module(self, module: ModuleType) -> None:
        """Give the module checks that do nothing."""
        module.__getattr__ = partial(_check, module.__name__)  # type: ignore[method-assign]


_CLOSED_OF_A_CHECK = {
    "reference", "mistakes", "mistaken", "inputs", "due", "judge", "observe", "passes",
    "of_variant", "parameters",
}  # fmt: skip


class _Nothing:
    """A check in a submission, its report and its picture: nothing, whatever is asked of it."""

    def __call__(self, *_: Any, **__: Any) -> _Nothing:
        """Check nothing."""
        return self

    def __getattr__(self, name: str) -> Any:
        """Have every attribute (`draw`, `text`, `passed`), but none that leads to answers."""
        if name.startswith("_") or name in _CLOSED_OF_A_CHECK:
            raise AttributeError(f"{name} of a check is not for a submission")
        return self

    def __iter__(self) -> Iterator[Any]:
        """Hold nothing."""
        return iter(())

    def __truediv__(self, _: Any) -> _Nothing:
        """Be a mark: ``report.held / report.total``."""
        return self


def _check(module: str, name: str) -> Any:
    if name.startswith("check_") or (module.startswith(OPEN) and name[:1] != "_"):
        return _Nothing()
    raise AttributeError(f"{module} has no {name} for a submission")


class _Shell:
    """What `get_ipython()` is in a submission: magics do nothing, %%time runs its cell."""

    def __init__(self, space: dict[str, Any]) -> None:
        self._space = space

    def run_cell_magic(self, name: str, line: str, cell: str) -> None:
        """Run the cell below %%time and %%capture."""
        if name in ("time", "capture", "prun"):
            exec(compile(cell, "yours", "exec"), self._space)

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: None


def _limited(seconds: float, work: Callable[[], Any]) -> Any:
    """Do some work, for so long at most; on Windows the limit of the whole process remains."""

    def ring(*_: Any) -> None:
        raise _TooLongError

    if not hasattr(signal, "SIGALRM"):
        return work()
    signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        return work()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _limit_memory(size: int) -> None:
    """Let this process take so many bytes at most; Windows knows no such limit."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_AS, (size, size))


def _watch(folders: Sequence[str]) -> None:
    """Refuse other processes, and whatever touches a closed folder; there is no way back."""
    shut = tuple(os.path.join(folder, "") for folder in folders)
    own = f"/proc/{os.getpid()}/", "/proc/self/", "/proc/cpuinfo", "/proc/meminfo", "/proc/stat"
    start, real, fspath = str.startswith, os.path.realpath, os.fspath

    def refuse(event: str, given: tuple[Any, ...]) -> None:
        if event in PROCESSES:
            raise PermissionError(f"a submission starts and ends no process ({event})")
        if event not in PATHS:
            return
        for one in given[:2]:
            if not isinstance(one, str | bytes | os.PathLike):
                continue
            path = real(os.fsdecode(fspath(one)))
            others = start(path, "/proc/") and not start(path, own)
            if others or start(os.path.join(path, ""), shut):
                raise PermissionError("a submission opens nothing there")

    sys.addaudithook(refuse)


def _set_up(
    space: dict[str, Any], kept: dict[str, ModuleType], setup: dict[str, Any]
) -> dict[str, Any]:
    """Close what is closed, then run the cells; return what went wrong, and the functions.

    `kept` are closed modules, whose classes the settings of a lab are made of.
    """
    import slamlab.exercises

    if setup["closed"]:  # a lab: its settings must be known before the rest is closed
        from slamlab.exercises import lab_scores, labs

        scores = ModuleType(lab_scores.__name__)
        scores.practise = lambda *_, **__: None  # type: ignore[attr-defined]
        slamlab.exercises.lab_scores = scores
        sys.modules[scores.__name__], sys.modules[labs.__name__] = scores, labs
        sys.modules.pop("slamlab.exercises.lab_systems", None)
    for room in setup["closed"]:  # neither `import slamlab` nor what was loaded shows them
        for name in [name for name in sys.modules if f"{name}.".startswith(f"{room}.")]:
            kept[name] = sys.modules.pop(name)
        vars(sys.modules["slamlab"]).pop(room.rpartition(".")[2], None)
    if not setup["answers"]:
        sys.meta_path.insert(0, _NoAnswers(setup["closed"]))
    _limit_memory(int(setup["megabytes"]) * 2**20)
    _watch(setup["folders"])
    shell = _Shell(space)
    space["get_ipython"] = lambda: shell
    notes = []
    for number, cell in enumerate(setup["cells"], start=1):
        try:
            _limited(setup["seconds"], partial(_executed, cell, space))
        except _TooLongError:
            notes.append(f"cell {number} did not end within {setup['seconds']:g} s")
        except BaseException as error:
            notes.append(f"cell {number} raised {_said(error)}")
    own = [name for name, value in space.items() if callable(value) and name[:1] != "_"]
    return {"notes": notes, "functions": own}


def _executed(cell: str, space: dict[str, Any]) -> None:
    exec(compile(cell, "yours", "exec"), space)


@contextmanager
def _replaced(space: dict[str, Any], names: Sequence[str], ask: Callable[..., Any]) -> Any:
    """Let some functions be answered at the other end of the pipe, for as long as one call."""
    own = {name: space[name] for name in names if name in space}
    space.update({name: partial(ask, name) for name in names})
    try:
        yield
    finally:
        for name in names:
            space.pop(name, None)
        space.update(own)


def _called(function: Callable[..., Any], given: tuple[Any, ...]) -> dict[str, Any]:
    """Call a function; say what came, what became of its arguments, and who shares memory."""
    try:
        came = function(*given)
    except Exception as error:
        return {"raised": [type(error).__name__, str(error)]}
    if (came is None or came is Ellipsis) and _is_stub(function):
        return {"raised": ["NotImplementedError", "nothing written yet"]}
    arrays = [a for one in given for a in (one if isinstance(one, list) else [one])]
    arrays = [a for a in arrays if isinstance(a, np.ndarray)]
    came = None if came is Ellipsis else came
    return {"result": _encoded(came, arrays), "after": [_encoded(one, []) for one in given]}


def _is_stub(function: Callable[..., Any]) -> bool:
    """Say whether a function has no body yet: nothing but `...` or its docstring."""
    code = getattr(function, "__code__", None)
    return code is not None and not code.co_names and len(code.co_code) <= 8


def _encoded(value: Any, arrays: list[np.ndarray]) -> Any:
    """Turn a result into what JSON can say; `arrays` are those it may share memory with."""
    if hasattr(value, "mean") and hasattr(value, "cov") and not isinstance(value, np.ndarray):
        value = (np.array(value.mean, dtype=float), np.array(value.cov, dtype=float))
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            return repr(value)
        same = (
            k for k, a in enumerate(arrays)
            if a.size == array.size > 0 and np.may_share_memory(a, array)
        )  # fmt: skip
        place = next(same, None)
        arrays.append(array)
        shape = list(array.shape)
        return {"array": array.ravel().tolist(), "shape": shape, "kind": array.dtype.kind,
                "shares": place}  # fmt: skip
    if isinstance(value, tuple):
        return {"tuple": [_encoded(entry, arrays) for entry in value]}
    if isinstance(value, list | range):
        return [_encoded(entry, arrays) for entry in value]
    return repr(value)


# A lab: a system is made, then driven step by step.


def _answer(
    space: dict[str, Any],
    notes: list[str],
    ask: Callable[..., Any],
    verb: str,
    given: tuple[Any, ...],
) -> Any:
    """Do what was asked, and return plain data."""
    if verb == "call":
        name, arguments, right = given
        function = space[name]
        with _replaced(space, right, ask):
            return _called(function, arguments)
    if verb in ("make", "map_room", "slam"):
        if not callable(space.get(verb)):
            said = f" ({'; '.join(notes)})" if notes else ""
            raise ValueError(f"the file defines no function {verb}{said}")
        came = space[verb](*given)
        if verb == "slam":  # the path first, whatever follows
            return [np.asarray(came[0], float).tolist()]
        if verb == "map_room":
            probability, resolution, origin = came
            return [np.asarray(part, float).tolist() for part in (probability, resolution, origin)]
        space["__system"] = came
        needed = ("measures", "pose", "pose_cov", "predict", "update")
        missing = [name for name in needed if not hasattr(came, name)]
        if missing:
            raise ValueError(f"what make returns has no {', '.join(missing)}")
        return {"measures": str(came.measures), "smoother": hasattr(came, "trajectory")}
    system = space["__system"]
    if verb == "trajectory":
        return np.asarray(system.trajectory, float).tolist()
    control = getattr(system, verb)(*given) if verb != "belief" else None
    if verb == "command":
        return None if control is None else np.asarray(control, float).tolist()
    pose, cov = np.asarray(system.pose, float), np.asarray(system.pose_cov, float)
    return {"pose": pose.tolist(), "cov": cov.tolist()}


def _said(error: BaseException) -> str:
    """Say what was raised and on which line of the student's file."""
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == "yours"]
    where = f", line {lines[-1]} of its cell" if lines else ""
    return f"{type(error).__name__}: {str(error)[:500]}{where}"


def _pipe(
    kept: dict[str, ModuleType],
) -> tuple[Callable[[], Any], Callable[[dict[str, Any]], None], Callable[..., Any]]:
    """Open the pipe: what receives a question, what sends an answer, and what asks back.

    A submission prints nothing into it. They are closures: a cell may change what a name means
    for everybody; theirs stay what they are.
    """
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    questions = os.fdopen(os.dup(0), "rb")
    dump, unpack = json.dumps, struct.unpack

    class Reader(pickle.Unpickler):
        """Finds classes of modules that are closed to the submission."""

        def find_class(self, module: str, name: str) -> Any:
            return (
                getattr(kept[module], name) if module in kept else super().find_class(module, name)
            )

    def receive() -> Any:
        size = questions.read(8)
        return Reader(BytesIO(questions.read(unpack("<q", size)[0]))).load() if size else None

    def send(answer: dict[str, Any]) -> None:
        answers.write(dump(answer) + "\n")
        answers.flush()

    def ask(name: str, *given: Any, **named: Any) -> Any:
        """Let the other end of the pipe work something out."""
        plain = [_encoded(one, []) for one in given]
        send({"need": [name, plain, {key: _encoded(one, []) for key, one in named.items()}]})
        came, raised = receive()
        if raised:
            raise ValueError(raised)
        return came

    return receive, send, ask


def main() -> NoReturn:
    """Answer what comes through the pipe until it is closed."""
    kept: dict[str, ModuleType] = {}
    receive, send, ask = _pipe(kept)
    sys.stdin, sys.argv = open(os.devnull, encoding="utf-8"), ["submission"]
    space: dict[str, Any] = {"__name__": "submission"}
    notes: list[str] = []
    answer: dict[str, Any]
    while True:
        try:
            question = receive()
            if question is None:
                break
            verb, given = question
            if verb == "setup":
                answer = {"came": _set_up(space, kept, *given)}
                notes += answer["came"]["notes"]
            else:
                answer = {"came": _answer(space, notes, ask, verb, given)}
        except BaseException as error:
            answer = {"error": _said(error)}
        send(answer)
    os._exit(0)  # not a line more of the submission runs


if __name__ == "__main__":
    main()
