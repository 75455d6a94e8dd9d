"""One student's file at work in a process of its own, asked through a pipe.

``python -m slamlab.commands._student FILE MEGABYTES ROOM ...`` is that process. It is told what a
robot is told, step by step, and answers with numbers: the truth never comes here, and what it
answers is read as JSON, so that nothing of it runs where the score is made.
"""

from __future__ import annotations

import json
import os
import pickle
import struct
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn, cast

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array
from slamlab.commands import _submission
from slamlab.exercises import lab_scores
from slamlab.models import View

__all__ = ["Process", "RemoteSmoother", "RemoteSystem"]


class Process:
    """The process of one file; a context that ends it.

    Parameters
    ----------
    path : Path
        .py or .ipynb.
    seconds : float
        How long it may work for one drive.
    megabytes : int
        How much memory it may take.
    closed : sequence of str
        Rooms of the library that it may not import.
    """

    def __init__(
        self, path: Path, seconds: float, megabytes: int, closed: Sequence[str] = ()
    ) -> None:
        self.seconds = seconds
        self._place = tempfile.TemporaryDirectory()
        words = [sys.executable, "-m", "slamlab.commands._student", str(path.resolve())]
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        self._process = subprocess.Popen(
            [*words, str(megabytes), *closed],
            cwd=self._place.name,
            env={**os.environ, **threads, "MPLBACKEND": "Agg"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._late = False
        self._clock = threading.Timer(seconds, self._ring)
        self.start_clock()

    def __enter__(self) -> Process:
        """Return itself."""
        return self

    def __exit__(self, *_error: object) -> None:
        """End the process."""
        self._clock.cancel()
        self._process.kill()
        self._process.communicate()
        self._place.cleanup()

    def start_clock(self) -> None:
        """Give the process its seconds, from now on."""
        self._clock.cancel()
        self._clock = threading.Timer(self.seconds, self._ring)
        self._clock.daemon = True
        self._clock.start()

    def _ring(self) -> None:
        self._late = True
        self._process.kill()

    def ask(self, verb: str, *given: Any) -> Any:
        """Let the file's system do something; ValueError says why it did not."""
        pipe_in, pipe_out = cast(Any, self._process.stdin), cast(Any, self._process.stdout)
        message = pickle.dumps((verb, given))
        try:
            pipe_in.write(struct.pack("<q", len(message)) + message)
            pipe_in.flush()
            line = pipe_out.readline()
        except OSError:
            line = b""
        if not line.endswith(b"\n"):
            self._gone(verb)
        answer = json.loads(line)
        if "error" in answer:
            raise ValueError(f"{verb}: {answer['error']}")
        return answer["came"]

    def _gone(self, verb: str) -> NoReturn:
        if self._late:
            raise ValueError(f"{verb}: it did not end within {self.seconds:g} s")
        raise ValueError(f"{verb}: its process ended early")

    def system(self, setting: Any) -> RemoteSystem:
        """Return the system that the file's `make` builds for a drive."""
        self.start_clock()
        came = self.ask("make", setting)
        return (RemoteSmoother if came["smoother"] else RemoteSystem)(self, came["measures"])


class RemoteSystem:
    """A student's system at the other end of the pipe: an Estimator, and a Pilot if it is one."""

    def __init__(self, process: Process, measures: str) -> None:
        self.measures, self._process = measures, process
        self._pose, self._cov = np.zeros(3), np.zeros((3, 3))
        self._take(process.ask("belief"))

    def __repr__(self) -> str:
        """Return where it believes to be."""
        return f"RemoteSystem({np.round(self._pose, 2).tolist()})"

    @property
    def pose(self) -> Array:
        """Estimated pose (3,), a copy."""
        return self._pose.copy()

    @property
    def pose_cov(self) -> Array:
        """Its covariance (3, 3), a copy."""
        return self._cov.copy()

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move."""
        self._take(self._process.ask("predict", u, dt, control_cov))

    def update(self, measurement: ArrayLike, ids: Any = None) -> None:
        """Take in a measurement."""
        given = (measurement,) if self.measures == "ranges" else (measurement, ids)
        self._take(self._process.ask("update", *given))

    def command(self, view: View) -> Array | None:
        """Return the next control, None when the student's pilot is done."""
        u = self._process.ask("command", view)
        return None if u is None else as_array("command", u, ("p",))

    def _take(self, belief: dict[str, Any]) -> None:
        self._pose = as_array("pose", belief["pose"], (3,))
        self._cov = as_array("pose_cov", belief["cov"], (3, 3))


class RemoteSmoother(RemoteSystem):
    """A student's system that revises its past."""

    @property
    def trajectory(self) -> Array:
        """Best poses (T, 3) of all steps so far."""
        return as_array("trajectory", self._process.ask("trajectory"), ("T", 3))


# The other end.


def _answer(space: dict[str, Any], notes: list[str], verb: str, given: tuple[Any, ...]) -> Any:
    """Do what was asked, and return plain data."""
    if verb in ("make", "map_room"):
        if not callable(space.get(verb)):
            said = f" ({'; '.join(notes)})" if notes else ""
            raise ValueError(f"the file defines no function {verb}{said}")
        came = space[verb](*given)
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
    came = getattr(system, verb)(*given) if verb != "belief" else None
    if verb == "command":
        return None if came is None else np.asarray(came, float).tolist()
    pose, cov = np.asarray(system.pose, float), np.asarray(system.pose_cov, float)
    return {"pose": pose.tolist(), "cov": cov.tolist()}


def _said(error: BaseException) -> str:
    """Say what was raised and on which line of the student's file."""
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == "yours"]
    where = f", line {lines[-1]} of its cell" if lines else ""
    return f"{type(error).__name__}: {error}{where}"


def main(file: str, megabytes: str, *closed: str) -> None:
    """Execute a file, then answer what comes through the pipe until it is closed."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    questions = os.fdopen(os.dup(0), "rb")
    sys.stdin = open(os.devnull, encoding="utf-8")
    sys.argv = [file]
    lab_scores.practise = lambda *_, **__: None
    _submission.limit_memory(int(megabytes) * 2**20)
    for room in closed:  # `import slamlab` does not show them
        vars(sys.modules["slamlab"]).pop(room.rpartition(".")[2], None)
    space: dict[str, Any] = {"__name__": "submission"}
    notes = []
    for number, cell in enumerate(_submission.cells_of(Path(file)), start=1):
        try:
            exec(compile(cell, "yours", "exec"), space)
        except BaseException as error:
            notes.append(f"cell {number} raised {_said(error)}")
    while size := questions.read(8):
        verb, given = pickle.loads(questions.read(struct.unpack("<q", size)[0]))
        try:
            answer = {"came": _answer(space, notes, verb, given)}
        except BaseException as error:
            answer = {"error": _said(error)}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
