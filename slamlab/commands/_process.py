"""A student's file at work in a process of its own, asked through a pipe.

The process gets the cells of the file, names and arguments, and answers with plain data, read as
JSON. References, checks, the truth of a drive and other submissions are never sent there. What it
may take is limited: time, memory, the length of an answer. It may start no process, and opens no
file in the folders that are closed to it. That keeps accidents and plain tricks out; whoever
attacks the interpreter itself is kept out by a container.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import tokenize
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, NoReturn, cast

import numpy as np

from slamlab._optional import needed

__all__ = ["Gone", "Process", "RemoteFunction", "cells_of", "files_in", "printable"]

LONGEST = 2**27  # bytes of an answer


class Gone(BaseException):
    """The process did not answer: it ended, was too slow, or said too much."""


def files_in(name: str, folder: Path) -> list[Path]:
    """Return the notebooks and programs of a folder and the folders in it.

    Raises
    ------
    ValueError
        If there is none; `name` is that of the argument, for the message.
    """
    files = [path for path in sorted(folder.rglob("*")) if path.suffix in (".ipynb", ".py")]
    files = [path for path in files if ".ipynb_checkpoints" not in path.parts]
    if not files:
        raise ValueError(f"{name}: expected .ipynb or .py files in {folder}, found none")
    return files


def cells_of(path: Path) -> list[str]:
    """Return the code of a file, as Python reads a module and IPython a notebook.

    Raises
    ------
    ValueError
        If it is no text, or a notebook that is none.
    """
    data = path.read_bytes()
    if path.suffix == ".py":
        try:
            encoding, _ = tokenize.detect_encoding(BytesIO(data).readline)
            return [data.decode(encoding)]
        except (SyntaxError, UnicodeDecodeError) as error:
            raise ValueError(f"{path.name}: expected text ({str(error):.80})") from error
    try:
        cells = json.loads(data.decode("utf-8-sig"))["cells"]
        sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(f"{path.name}: expected a notebook ({reason:.80})") from error
    ipython = needed("IPython.core.inputtransformer2", "notebooks", "course", "ipython")
    transform = ipython.TransformerManager().transform_cell
    return [_transformed(transform, source) for source in sources]


def _transformed(transform: Any, source: str) -> str:
    try:
        return str(transform(source))
    except SyntaxError:  # it is said when the cell is run
        return source


def printable(text: str) -> str:
    """Write what no file can hold (a lone surrogate) in another way."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


class Process:
    """The process of one submission; a context that ends it.

    Parameters
    ----------
    cells : sequence of str
        Its code.
    seconds : float
        How long it may take from one `start_clock` to the next.
    megabytes : int
        How much memory it may take.
    closed : sequence of str
        Subpackages of the library that it may not import.
    folders : sequence of Path
        Folders in which it may open nothing.
    answers : bool
        The cells are the teacher's own: they may import the exercises with their answers.
    """

    def __init__(
        self,
        cells: Sequence[str],
        seconds: float,
        megabytes: int,
        closed: Sequence[str] = (),
        folders: Sequence[Path] = (),
        answers: bool = False,
    ) -> None:
        self.seconds = seconds
        # Works out what a submission is given in place of its own function.
        self.reference: Callable[..., Any] | None = None
        self._place = tempfile.TemporaryDirectory()
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "slamlab.commands._student"],
            cwd=self._place.name,
            env={**os.environ, **threads, "MPLBACKEND": "Agg"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._late = False
        self._clock = threading.Timer(seconds, self._ring)
        setup = {
            "cells": list(cells),
            "seconds": seconds,
            "megabytes": megabytes,
            "closed": list(closed),
            "answers": answers,
            "folders": [str(folder.resolve()) for folder in folders],
        }
        try:
            # To start Python and load the library takes a while on a busy machine.
            self.start_clock(60.0 + seconds * (len(cells) + 1))
            came = self.ask("setup", setup)
        except BaseException:
            self.__exit__()
            raise
        self.notes, self.functions = came["notes"], came["functions"]

    def __enter__(self) -> Process:
        """Return itself."""
        return self

    def __exit__(self, *_error: object) -> None:
        """End the process, and all that it may have started."""
        self._clock.cancel()
        self._kill()
        self._process.communicate()
        self._place.cleanup()

    def start_clock(self, seconds: float | None = None) -> None:
        """Give the process its seconds, from now on."""
        self._clock.cancel()
        self._clock = threading.Timer(self.seconds if seconds is None else seconds, self._ring)
        self._clock.daemon = True
        self._clock.start()

    def stop_clock(self) -> None:
        """Let nothing count: the submission is not at work."""
        self._clock.cancel()

    def _ring(self) -> None:
        self._late = True
        self._kill()

    def _kill(self) -> None:
        try:
            if hasattr(os, "killpg"):
                os.killpg(self._process.pid, signal.SIGKILL)
            else:  # Windows
                self._process.kill()
        except (ProcessLookupError, PermissionError):
            self._process.kill()

    def ask(self, verb: str, *given: Any) -> Any:
        """Let the file's code do something.

        Raises
        ------
        ValueError
            If its code raised something; the message says what.
        Gone
            If the process does not answer any more.
        """
        answer = self._asked(verb, given)
        if "error" in answer:
            raise ValueError(f"{verb}: {answer['error']}")
        return answer["came"]

    def _asked(self, verb: str, given: tuple[Any, ...]) -> dict[str, Any]:
        answer, line = self._exchanged((verb, given))
        while self.reference is not None and isinstance(answer, dict) and "need" in answer:
            answer, line = self._exchanged(self._worked_out(answer["need"]))
        if not isinstance(answer, dict) or not {"came", "error"} & set(answer):
            self._gone(verb, len(line) >= LONGEST, bool(line))
        return cast(dict[str, Any], answer)

    def _exchanged(self, message: tuple[Any, ...]) -> tuple[Any, bytes]:
        """Send a message; return what came as data, and as it came."""
        pipe_in, pipe_out = cast(Any, self._process.stdin), cast(Any, self._process.stdout)
        text = pickle.dumps(message)
        try:
            pipe_in.write(struct.pack("<q", len(text)) + text)
            pipe_in.flush()
            line = pipe_out.readline(LONGEST)
        except (OSError, ValueError):
            line = b""
        try:
            return (json.loads(line) if line.endswith(b"\n") else None), line
        except (ValueError, RecursionError):
            return None, line

    def _worked_out(self, need: Any) -> tuple[Any, str]:
        """Return a result of the reference, and why there is none."""
        assert self.reference is not None
        try:
            name, given, named = need
            arguments = [decoded(one) for one in given]
            return self.reference(name, arguments, {k: decoded(v) for k, v in named.items()}), ""
        except Exception as error:
            return None, f"{type(error).__name__}: {error}"

    def _gone(self, verb: str, much: bool, odd: bool) -> NoReturn:
        if self._late:
            raise Gone(f"{verb}: it did not end within {self.seconds:g} s")
        if much:
            raise Gone(f"{verb}: its answer is longer than {LONGEST >> 20} MB")
        if odd:
            raise Gone(f"{verb}: its process wrote into the pipe of the answers")
        raise Gone(f"{verb}: its process ended early")


class RemoteFunction:
    """A function of a submission at the other end of the pipe; a check calls it like any other."""

    def __init__(self, process: Process, name: str, right: Sequence[str] = ()) -> None:
        self._process, self.__name__ = process, name
        self._right = list(right)  # functions that are worked out by the process' reference

    def __call__(self, *given: Any) -> Any:
        """Answer as the student's function does, its marks on the arguments included."""
        answer = self._process._asked("call", (self.__name__, given, self._right))
        if "error" in answer:
            raise ValueError(answer["error"])
        came = answer["came"]
        if "raised" in came:
            kind, text = (printable(str(part)) for part in came["raised"])
            known = {"NotImplementedError": NotImplementedError}
            raise known.get(kind, type(kind, (Exception,), {}))(text)
        after = [decoded(one) for one in came["after"]]
        arrays: list[np.ndarray] = []
        for one, new in zip(given, after, strict=True):
            arrays += _changed_in_place(one, new)
        return decoded(came["result"], arrays)


def _changed_in_place(one: Any, new: Any) -> list[np.ndarray]:
    """Do to an argument what the function did to its copy; return its arrays."""
    if isinstance(one, np.ndarray):
        if isinstance(new, np.ndarray) and new.shape == one.shape:
            one[...] = new
        return [one]
    if isinstance(one, list) and isinstance(new, list):
        old, one[:] = list(one), new
        for k in range(min(len(old), len(new))):
            if isinstance(old[k], np.ndarray):
                one[k] = old[k]
                _changed_in_place(old[k], new[k])
        return [entry for entry in one if isinstance(entry, np.ndarray)]
    return []


def decoded(came: Any, earlier: Sequence[np.ndarray] = ()) -> Any:
    """Turn what came as JSON into plain data: numbers, texts, arrays, tuples and lists.

    An array that shares its memory with an earlier one, of those given or of these data, does so
    here, too.
    """
    return _decoded(came, list(earlier))


def _decoded(came: Any, arrays: list[np.ndarray]) -> Any:
    if isinstance(came, list):
        return [_decoded(entry, arrays) for entry in came]
    if not isinstance(came, dict):
        return printable(came) if isinstance(came, str) else came
    if "tuple" in came:
        return tuple(_decoded(entry, arrays) for entry in came["tuple"])
    kind = {"b": bool, "i": np.int64, "u": np.uint64, "f": np.float64}[came["kind"]]
    array = np.array(came["array"], dtype=kind).reshape(came["shape"])
    place = came.get("shares")
    if isinstance(place, int) and 0 <= place < len(arrays) and arrays[place].size == array.size:
        array = arrays[place].reshape(array.shape)
    arrays.append(array)
    return array
