"""Compiled loops: numba's cached machine code, and one sentence when making it takes long.

Code is compiled at its first call and kept in ``__pycache__`` beside its file or, where that
cannot be written, in numba's folder for the user (``NUMBA_CACHE_DIR`` names another one).
``python -m slamlab warm`` does it all beforehand. Every compiled loop takes `njit` from here;
where numba is not installed the loops stay Python.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from functools import partial
from threading import Timer
from typing import Any, TypeVar

try:
    import numba
    from numba.core import event
except ImportError:
    numba = None

__all__ = ["COMPILED", "njit"]

Loop = TypeVar("Loop", bound=Callable[..., Any])

COMPILED = numba is not None


def _as_it_is(cache: bool) -> Callable[[Loop], Loop]:
    """Leave a loop as it is written: what `njit` does where numba is not installed."""
    return lambda loop: loop


# No loop of ours is called from C: without a wrapper for that it compiles in a tenth less time.
njit = partial(numba.njit, no_cfunc_wrapper=True) if COMPILED else _as_it_is
_PATIENCE = 1.0  # seconds of compiling that nobody is told of


class _Notice(event.Listener if COMPILED else object):  # type: ignore[misc]
    """Says on a terminal, once a process, that compiling takes a while; SLAMLAB_QUIET=1 hushes it.

    Programs that keep what is printed, such as notebooks, get no notice.
    """

    def __init__(self) -> None:
        self.depth, self.said, self.timer = 0, False, Timer(0.0, self.say)

    def on_start(self, event: Any) -> None:
        """Begin to count when the outermost function begins to compile."""
        module = event.data["dispatcher"].py_func.__module__
        self.depth += 1
        if self.depth == 1 and not self.said and module.startswith("slamlab."):
            self.timer = Timer(_PATIENCE, self.say)
            self.timer.daemon = True
            self.timer.start()

    def on_end(self, event: Any) -> None:
        """Stop counting when it is done."""
        self.depth -= 1
        if self.depth == 0:
            self.timer.cancel()

    def say(self) -> None:
        """Print the sentence."""
        self.said = True
        if sys.stderr.isatty() and os.environ.get("SLAMLAB_QUIET", "0") in ("", "0"):
            print("slamlab: compiling, once; the code is kept for later runs", file=sys.stderr)


if COMPILED:
    event.register("numba:compile", _Notice())
