"""Compiled loops: numba's cached machine code, and one sentence when making it takes long.

Code is compiled at its first call and kept in ``__pycache__`` beside its file or, where that
cannot be written, in numba's folder for the user (``NUMBA_CACHE_DIR`` names another one).
``python -m slamlab warm`` does it all beforehand. Every compiled loop takes `njit` from here.
"""

from __future__ import annotations

import os
import sys
from functools import partial
from threading import Timer

import numba
from numba.core import event

__all__ = ["njit"]

# No loop of ours is called from C: without a wrapper for that it compiles in a tenth less time.
njit = partial(numba.njit, no_cfunc_wrapper=True)
_PATIENCE = 1.0  # seconds of compiling that nobody is told of


class _Notice(event.Listener):
    """Says on a terminal, once a process, that compiling takes a while; SLAMLAB_QUIET=1 hushes it.

    Programs that keep what is printed, such as notebooks, are never told.
    """

    def __init__(self) -> None:
        self.depth, self.said, self.timer = 0, False, Timer(0.0, self.say)

    def on_start(self, event: event.Event) -> None:
        """Begin to count when the outermost function begins to compile."""
        module = event.data["dispatcher"].py_func.__module__
        self.depth += 1
        if self.depth == 1 and not self.said and module.startswith("slamlab."):
            self.timer = Timer(_PATIENCE, self.say)
            self.timer.daemon = True
            self.timer.start()

    def on_end(self, event: event.Event) -> None:
        """Stop counting when it is done."""
        self.depth -= 1
        if self.depth == 0:
            self.timer.cancel()

    def say(self) -> None:
        """Print the sentence."""
        self.said = True
        if sys.stderr.isatty() and os.environ.get("SLAMLAB_QUIET", "0") in ("", "0"):
            print("slamlab: compiling, once; the code is kept for later runs", file=sys.stderr)


event.register("numba:compile", _Notice())
