"""The cells of every beam of a scan, and their evidence: compiled loops under `OccupancyGrid`."""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit


@njit(cache=True)
def add_scan(log_odds, mark, scan, start, ends, hit, evidence):  # type: ignore[no-untyped-def]
    """Add one scan to the sheet.

    `start` (2,) and `ends` (k, 2) are in cells, a NaN end is no beam. `mark` remembers which scan
    touched a cell last, so that a cell counts once a scan. `evidence`: of a hit, of a miss, limit.
    """
    gain, loss, limit = evidence
    rows, columns = log_odds.shape
    for k in range(len(ends)):
        if hit[k]:
            c, r = int(np.floor(ends[k, 0])), int(np.floor(ends[k, 1]))
            if 0 <= c < columns and 0 <= r < rows and mark[r, c] != scan:
                mark[r, c] = scan
                log_odds[r, c] = min(max(log_odds[r, c] + gain, -limit), limit)
    for k in range(len(ends)):
        if not np.isnan(ends[k, 0]):
            _free(log_odds, mark, scan, start, ends[k], loss, limit)


@njit(cache=True)
def _free(log_odds, mark, scan, start, end, loss, limit):  # type: ignore[no-untyped-def]
    """Walk from cell to cell along a beam and free those that this scan has not touched."""
    rows, columns = log_odds.shape
    c, r = int(np.floor(start[0])), int(np.floor(start[1]))
    last_c, last_r = int(np.floor(end[0])), int(np.floor(end[1]))
    dx, dy = end[0] - start[0], end[1] - start[1]
    step_c, step_r = (1 if last_c > c else -1), (1 if last_r > r else -1)
    # Share of the beam to the next grid line of each kind, and from line to line.
    per_c = abs(1.0 / dx) if dx != 0.0 else np.inf
    per_r = abs(1.0 / dy) if dy != 0.0 else np.inf
    next_c = (c + (step_c > 0) - start[0]) / dx if last_c != c else np.inf
    next_r = (r + (step_r > 0) - start[1]) / dy if last_r != r else np.inf
    for _ in range(abs(last_c - c) + abs(last_r - r) + 1):
        if 0 <= c < columns and 0 <= r < rows and mark[r, c] != scan:
            mark[r, c] = scan
            log_odds[r, c] = min(max(log_odds[r, c] + loss, -limit), limit)
        # Never past the last column or row, so that the walk ends in the cell of the end.
        if r == last_r or (c != last_c and next_c <= next_r):
            c += step_c
            next_c += per_c
        else:
            r += step_r
            next_r += per_r
        if (c < 0 and step_c < 0) or (r < 0 and step_r < 0):
            return
        if (c >= columns and step_c > 0) or (r >= rows and step_r > 0):
            return
