"""The cells of every beam of a scan, and their evidence: compiled loops under `OccupancyGrid`."""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit


@njit(cache=True)
def insert_scan(log_odds, start, ends, hit, gain, loss, limit):  # type: ignore[no-untyped-def]
    """Add one scan to the map: `slamlab.mapping.occupancy.insert_scan`, the same numbers.

    Cells that this scan touched are marked in the part of the map that it can reach.
    """
    rows, columns = log_odds.shape
    low_c, high_c = int(np.floor(start[0])), int(np.floor(start[0]))
    low_r, high_r = int(np.floor(start[1])), int(np.floor(start[1]))
    for k in range(len(ends)):
        if not np.isnan(ends[k, 0]):
            c, r = int(np.floor(ends[k, 0])), int(np.floor(ends[k, 1]))
            low_c, high_c = min(low_c, c), max(high_c, c)
            low_r, high_r = min(low_r, r), max(high_r, r)
    low_c, high_c = max(low_c, 0), min(high_c, columns - 1)
    low_r, high_r = max(low_r, 0), min(high_r, rows - 1)
    if low_c > high_c or low_r > high_r:
        return
    part = log_odds[low_r : high_r + 1, low_c : high_c + 1]
    mark = np.zeros(part.shape, np.bool_)
    for k in range(len(ends)):
        if hit[k] and not np.isnan(ends[k, 0]):
            c, r = int(np.floor(ends[k, 0])) - low_c, int(np.floor(ends[k, 1])) - low_r
            if 0 <= c < part.shape[1] and 0 <= r < part.shape[0] and not mark[r, c]:
                mark[r, c] = True
                part[r, c] = min(max(part[r, c] + gain, -limit), limit)
    for k in range(len(ends)):
        if not np.isnan(ends[k, 0]):
            _free(part, mark, start, ends[k], low_c, low_r, loss, limit)


@njit(cache=True)
def _free(part, mark, start, end, low_c, low_r, loss, limit):  # type: ignore[no-untyped-def]
    """Walk from cell to cell along a beam and free those that this scan has not touched.

    Cell (0, 0) of `part` and `mark` is the map's (low_r, low_c).
    """
    rows, columns = low_r + part.shape[0], low_c + part.shape[1]
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
        if low_c <= c < columns and low_r <= r < rows and not mark[r - low_r, c - low_c]:
            mark[r - low_r, c - low_c] = True
            old = part[r - low_r, c - low_c]
            part[r - low_r, c - low_c] = min(max(old + loss, -limit), limit)
        # Never past the last column or row, so that the walk ends in the cell of the end.
        if r == last_r or (c != last_c and next_c <= next_r):
            c += step_c
            next_c += per_c
        else:
            r += step_r
            next_r += per_r
        if (c < low_c and step_c < 0) or (r < low_r and step_r < 0):
            return
        if (c >= columns and step_c > 0) or (r >= rows and step_r > 0):
            return
