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
import numpy as np
from numba.core import event

__all__ = ["njit", "solve3"]

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


@njit(cache=True)
def solve3(H, g, step):  # type: ignore[no-untyped-def]
    """Solve H step = g of three unknowns by Cholesky; False if H is singular.

    Where numba compiles it, `numpy.linalg.solve` takes five seconds longer.
    """
    if H[0, 0] <= 0.0:
        return False
    l00 = np.sqrt(H[0, 0])
    l10, l20 = H[1, 0] / l00, H[2, 0] / l00
    d1 = H[1, 1] - l10 * l10
    if d1 <= 1e-12 * H[1, 1]:
        return False
    l11 = np.sqrt(d1)
    l21 = (H[2, 1] - l20 * l10) / l11
    d2 = H[2, 2] - l20 * l20 - l21 * l21
    if d2 <= 1e-12 * H[2, 2]:
        return False
    l22 = np.sqrt(d2)
    a = g[0] / l00
    b = (g[1] - l10 * a) / l11
    step[2] = (g[2] - l20 * a - l21 * b) / l22 / l22
    step[1] = (b - l21 * step[2]) / l11
    step[0] = (a - l10 * step[1] - l20 * step[2]) / l00
    return True
