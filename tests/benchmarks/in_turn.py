"""Seconds of functions that are run in turn; the benchmarks share it."""

from __future__ import annotations

import time

import numpy as np


def alternate(*functions, rounds, burst=1):
    """Median CPU seconds of each, run in turn, so that a busy machine slows all alike.

    Some virtual machines take 20 ms for the first call into NumPy after 0.3 s of anything else,
    even of a sum; so each is called once before it is timed. A burst of several calls (one number,
    or one for each) finds its own data in the cache, as the steps of a drive do.
    """
    seconds = np.empty((rounds, len(functions)))
    bursts = np.broadcast_to(burst, len(functions))
    for row in seconds:
        for column, (function, calls) in enumerate(zip(functions, bursts, strict=True)):
            function()
            start = time.process_time()
            for _ in range(calls):
                function()
            row[column] = (time.process_time() - start) / calls
    return np.median(seconds, axis=0)
