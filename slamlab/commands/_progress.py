"""How far a long run is: one line that renews itself on a terminal, else a line each tenth."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TextIO

_EVERY = 0.2  # seconds between two states of the line on a terminal
_QUIET = 5.0  # what takes no longer needs no lines in a file (s)


class Progress:
    """Call it with how many are done, of how many; it writes what is left to standard error.

    Parameters
    ----------
    unit : str
        What is counted, such as "scans".
    stream : TextIO, optional
        Standard error by default.
    clock : callable, default time.monotonic
        Seconds.
    """

    def __init__(
        self,
        unit: str,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._unit, self._clock = unit, clock
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty()
        self._start = self._written = clock()
        self._tenth = 0

    def __call__(self, done: int, total: int) -> None:
        """Write a line if it is time for one."""
        now = self._clock()
        left = (now - self._start) * (total - done) / max(done, 1)
        line = f"{done} of {total} {self._unit}, {100 * done // total} %, {_span(left)} left"
        if self._terminal:
            if done == total:
                self.clear()
            elif now - self._written >= _EVERY:
                self._written = now
                self._put(f"\r\x1b[K{line}")
        elif (tenth := 10 * done // total) > self._tenth:
            self._tenth = tenth
            if done < total and now - self._start >= _QUIET:
                self._put(f"{line}\n")

    def clear(self) -> None:
        """Take the line off a terminal, so that what is said next stands alone."""
        if self._terminal:
            self._put("\r\x1b[K")

    def _put(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


def _span(seconds: float) -> str:
    """Words for a time: 7 s, 12 min, 1 h 20 min."""
    if seconds < 100:
        return f"about {seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 60:
        return f"about {minutes} min"
    return f"about {minutes // 60} h {minutes % 60} min"
